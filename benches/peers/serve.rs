//! The library's side of the protocol of `reference/peers/protocol.py`: it is a peer like the others, in a process of
//! its own.

use std::error::Error;
use std::hint::black_box;
use std::io::{Write, stdin, stdout};
use std::path::Path;
use std::time::Instant;

use stickslip::dynamics::constraint::{Steps, Threads, Unconstrained};
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::model::network::Network;
use stickslip::model::state::State;

use crate::network::{NetworkFile, STEP};

/// The library's network, and its state.
struct Simulation {
    network: Network,
    state: State,
    stepper: Stepper,
}

impl Simulation {
    fn build(file: &NetworkFile) -> Self {
        let network = file.network();
        Self { state: file.initial(), stepper: Stepper::new(&network), network }
    }

    fn run(&mut self, integrator: GlobalIntegrator, steps: Steps) {
        self.stepper.steps(integrator, &self.network, black_box(&mut self.state), steps, |_| Unconstrained);
    }
}

/// Returns the CPU time of this thread.
#[cfg(all(feature = "realtime", target_os = "linux"))]
fn processor_time_s() -> f64 {
    stickslip::realtime::os::thread_cpu_ns() as f64 * 1e-9
}

/// Returns the time by the clock: the library reads CPU time on Linux only.
#[cfg(not(all(feature = "realtime", target_os = "linux")))]
fn processor_time_s() -> f64 {
    use std::sync::LazyLock;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

/// Serves requests from standard input until it ends. With two threads the time is that of the clock.
pub fn serve(integrator: GlobalIntegrator, threads: Threads, path: &Path) -> Result<(), Box<dyn Error>> {
    let file = NetworkFile::read(path)?;
    let mut simulation = None;
    let mut answer = "read".to_owned();
    loop {
        writeln!(stdout(), "{answer}")?;
        stdout().flush()?;
        let mut line = String::new();
        if stdin().read_line(&mut line)? == 0 {
            return Ok(());
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        answer = match (words.as_slice(), &mut simulation) {
            (["build"], _) => {
                simulation = Some(Simulation::build(&file));
                "built".to_owned()
            }
            (["reset"], Some(simulation)) => {
                simulation.state = file.initial();
                "reset".to_owned()
            }
            (["run", steps], Some(simulation)) => {
                let steps = Steps { length: STEP, count: steps.parse()?, threads };
                let (start, began) = (processor_time_s(), Instant::now());
                simulation.run(integrator, steps);
                let seconds = match threads {
                    Threads::One => processor_time_s() - start,
                    Threads::Two => began.elapsed().as_secs_f64(),
                };
                if let Some(failure) = simulation.stepper.failure() {
                    return Err(failure.into());
                }
                seconds.to_string()
            }
            (["state"], Some(simulation)) => {
                let x: Vec<[f64; 3]> = simulation.state.x.iter().map(|&x| x.into()).collect();
                serde_json::to_string(&x)?
            }
            _ => return Err(format!("not a command here: {line:?}").into()),
        };
    }
}
