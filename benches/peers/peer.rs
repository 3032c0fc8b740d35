//! Peers as processes that serve requests: their list, and how one is started, asked and observed.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

/// Program of a peer.
#[derive(Debug, Clone, Copy)]
pub enum Program {
    /// This program, with an integrator of the library and a number of threads.
    Ours(&'static str, &'static str),
    /// A script in `reference/peers`, and its second argument.
    Python(&'static str, &'static str),
}

/// Row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Peer {
    pub name: &'static str,
    pub program: Program,
    /// Differences from the first peer's method.
    pub differs: &'static str,
    /// Largest accepted difference of its positions from the first peer's, in units of the initial displacement; none
    /// where the scheme differs.
    pub agreement: Option<f64>,
}

/// All peers compute in one thread, except for the one that states two. All are compared with the first.
///
/// Agreement: sums of some 26 forces a node in another order differ by a few roundings of 1e-16 a step, which
/// accumulate over fifty steps and persist in a lightly damped network. Measured: 7e-15. In single precision a rounding
/// is 6e-8, and positions are up to ten times as large as displacements: fifty of them are 3e-5. Measured: 3.6e-6.
pub const PEERS: [Peer; 8] = [
    Peer {
        name: "stickslip semi-implicit Euler",
        program: Program::Ours("semi-implicit-euler", "1"),
        differs: "",
        agreement: Some(0.0),
    },
    Peer {
        name: "stickslip, two threads",
        program: Program::Ours("semi-implicit-euler", "2"),
        differs: "by the clock, not processor time; one thread below 8,192 springs",
        agreement: Some(0.0),
    },
    Peer {
        name: "MuJoCo Euler",
        program: Program::Python("in_mujoco.py", "Euler"),
        differs: "the same scheme; bodies and tendons, general machinery",
        agreement: Some(1e-12),
    },
    Peer {
        name: "Newton SolverSemiImplicit",
        program: Program::Python("in_newton.py", ""),
        differs: "the same scheme in float32; steps captured, no contacts",
        agreement: Some(3e-5),
    },
    Peer {
        name: "Warp kernel",
        program: Program::Python("in_warp.py", ""),
        differs: "the same scheme; steps captured",
        agreement: Some(1e-11),
    },
    Peer {
        name: "numpy",
        program: Program::Python("in_numpy.py", ""),
        differs: "the same scheme",
        agreement: Some(1e-12),
    },
    Peer {
        name: "stickslip implicit Euler",
        program: Program::Ours("implicit-euler", "1"),
        differs: "implicit: Newton's method, sparse Cholesky",
        agreement: None,
    },
    Peer {
        name: "MuJoCo discrete",
        program: Program::Python("in_mujoco.py", "discrete"),
        differs: "implicit, linearised, without geometric stiffness; iterative",
        agreement: None,
    },
];

/// Why a peer has no figures.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    #[error("cut off: no reply to `{to}` within {} s", .budget.as_secs())]
    Budget { to: String, budget: Duration },
    #[error("not tried: cut off at {springs} springs")]
    NotTried { springs: usize },
    #[error("ended at `{to}`; see {log}")]
    Ended { to: String, log: String },
    #[error("replied `{answer}` to `{to}`")]
    Answer { to: String, answer: String },
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Failure {
    /// Returns whether the peer only took too long.
    pub fn is_for_time(&self) -> bool {
        matches!(self, Failure::Budget { .. } | Failure::NotTried { .. })
    }
}

/// Running peer; its process is ended on drop.
pub struct Running {
    child: Child,
    commands: ChildStdin,
    answers: Receiver<String>,
    log: String,
}

impl Running {
    /// Starts a peer on a network; `directory` contains the Python environment and receives the peer's output.
    pub fn start(peer: &Peer, directory: &Path, network: &Path) -> Result<Self, Failure> {
        let directory = fs::canonicalize(directory)?;
        let mut command = match peer.program {
            Program::Ours(integrator, threads) => {
                let mut command = Command::new(std::env::current_exe()?);
                command.args(["serve", integrator, threads]).arg(fs::canonicalize(network)?);
                command
            }
            Program::Python(script, argument) => {
                let mut command = Command::new(directory.join("venv/bin/python"));
                let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference/peers").join(script);
                command.arg(script).arg(fs::canonicalize(network)?).arg(argument);
                command
            }
        };
        let log = directory.join(format!("{}.log", peer.name.to_lowercase().replace(' ', "-")));
        let mut child = command
            // MuJoCo writes a log to its working directory, Warp keeps compiled kernels.
            .current_dir(&directory)
            .env("WARP_CACHE_PATH", directory.join("warp"))
            .envs(["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"].map(|name| (name, "1")))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(&log)?)
            .spawn()?;
        let log = log.display().to_string();
        let commands = child.stdin.take().ok_or_else(|| io::Error::other("no pipe to the peer"))?;
        let output = child.stdout.take().ok_or_else(|| io::Error::other("no pipe from the peer"))?;
        let (sender, answers) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Ok(Self { child, commands, answers, log })
    }

    /// Sends a command and waits for the reply.
    pub fn ask(&mut self, command: &str, budget: Duration) -> Result<String, Failure> {
        // A peer that has ended is noticed when its reply does not come.
        let _ = writeln!(self.commands, "{command}");
        self.answer(command, budget)
    }

    /// Waits for a reply.
    pub fn answer(&mut self, to: &str, budget: Duration) -> Result<String, Failure> {
        self.answers.recv_timeout(budget).map_err(|error| match error {
            RecvTimeoutError::Timeout => Failure::Budget { to: to.to_owned(), budget },
            RecvTimeoutError::Disconnected => Failure::Ended { to: to.to_owned(), log: self.log.clone() },
        })
    }

    /// Returns the process's resident memory, bytes; none without Linux's /proc.
    pub fn resident_bytes(&self) -> Option<u64> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        Some(1024 * line.trim().strip_suffix(" kB")?.parse::<u64>().ok()?)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // The process may already have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
