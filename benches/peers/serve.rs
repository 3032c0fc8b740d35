//! Our side of the protocol of `reference/peers/protocol.py`: the library is a peer like the others, in a process of
//! its own.

use std::error::Error;
use std::hint::black_box;
use std::io::{Write, stdin, stdout};
use std::path::Path;

use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper, Unconstrained};
use stickslip::model::network::{Network, State};

use crate::network::{NetworkFile, STEP};

/// The network as the library has it, and where it is.
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

    fn run(&mut self, integrator: GlobalIntegrator, h: f64, steps: u32) {
        for _ in 0..steps {
            self.stepper.step(integrator, &self.network, black_box(&mut self.state), h, &Unconstrained);
        }
    }
}

/// Of this thread, which is the only one that computes.
#[cfg(all(feature = "realtime", target_os = "linux"))]
fn processor_time_s() -> f64 {
    stickslip::realtime::os::thread_cpu_ns() as f64 * 1e-9
}

/// The library reads that clock on Linux only; elsewhere all time passes for it.
#[cfg(not(all(feature = "realtime", target_os = "linux")))]
fn processor_time_s() -> f64 {
    use std::sync::LazyLock;
    use std::time::Instant;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

/// Answers standard input until it ends.
pub fn serve(integrator: GlobalIntegrator, path: &Path) -> Result<(), Box<dyn Error>> {
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
                let steps = steps.parse()?;
                let start = processor_time_s();
                simulation.run(integrator, STEP, steps);
                let seconds = processor_time_s() - start;
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
