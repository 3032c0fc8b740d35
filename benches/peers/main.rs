//! This library and other widely used simulators on identical networks with identical steps, one process each, taking
//! turns: processor time per spring and step, memory, and the error compared with a fine step.
//!
//! Run `reference/peers/install`, then `cargo bench --bench peers`; names of networks after `--` select some.

mod floors;
mod network;
mod peer;
mod serve;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant, SystemTime};

use serde::Serialize;
use stickslip::Vec3;
use stickslip::dynamics::constraint::{Threads, Unconstrained};
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};

use crate::network::{NetworkFile, STEP, cases, largest, root_mean_square, vectors};
use crate::peer::{Failure, PEERS, Peer, Program, Running};

/// Steps of the trajectory, 0.05 s.
const STEPS: u32 = 50;
/// RK4 substeps of the reference in one step: fourth order, compared with the first order of the peers.
const SUBSTEPS: u32 = 16;
/// Time limit of a reply, by the clock, for building the model or for the trajectory. A slower peer is cut off.
const BUDGET: Duration = Duration::from_secs(60);
/// Time that a peer's turns on one network may take, s; within the limits of rounds, the peer then stops.
const TURNS_BUDGET: f64 = 5.0;
const LEAST_ROUNDS: usize = 3;
const MOST_ROUNDS: usize = 31;
/// Least duration of a peer's turn, s, if that takes no more than `MOST_REPEATS` trajectories.
const TURN: f64 = 0.02;
const MOST_REPEATS: u32 = 100;

/// Figures of one peer on one network.
#[derive(Debug, Serialize)]
struct Row {
    peer: &'static str,
    differs: &'static str,
    /// Reason for which there are no figures.
    failure: Option<String>,
    /// Whether that reason is other than time.
    broken: bool,
    #[serde(flatten)]
    figures: Option<Figures>,
}

#[derive(Debug, Serialize)]
struct Figures {
    build_s: f64,
    memory_growth_bytes: Option<u64>,
    /// RMS of the differences to the reference, in units of the initial displacement's RMS.
    error: f64,
    /// Largest difference to the first peer, in those units, and its accepted bound.
    difference: f64,
    agreement: Option<f64>,
    /// Median over rounds, ns.
    ns_per_spring_step: f64,
    /// Quartiles of the ratios to the first peer within rounds.
    ratio_quartiles: [f64; 3],
    rounds: usize,
}

#[derive(Debug, Serialize)]
struct Case {
    network: String,
    nodes: usize,
    springs: usize,
    rows: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Report {
    unix_seconds: u64,
    processor: Option<String>,
    step_s: f64,
    steps: u32,
    root_and_division_ns: f64,
    root_and_division_avx2_ns: Option<f64>,
    /// Time to read k, c and L of every spring of the largest block from memory, ns per spring.
    reading_ns: f64,
    cases: Vec<Case>,
}

/// Peer that has done its first trajectory.
struct Contender {
    running: Running,
    build_s: f64,
    memory_growth_bytes: Option<u64>,
    positions: Vec<Vec3>,
    repeats: u32,
    /// Time per trajectory in each round, s.
    seconds: Vec<f64>,
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["serve", name, threads, path] => {
            let all = [GlobalIntegrator::SemiImplicitEuler, GlobalIntegrator::ImplicitEuler];
            let integrator = all.into_iter().find(|integrator| integrator.name() == *name);
            let threads = if *threads == "2" { Threads::Two } else { Threads::One };
            serve::serve(integrator.ok_or("not an integrator to serve")?, threads, Path::new(path))?;
            Ok(ExitCode::SUCCESS)
        }
        chosen => compare(chosen),
    }
}

fn compare(chosen: &[&str]) -> Result<ExitCode, Box<dyn Error>> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/peers");
    fs::create_dir_all(&directory)?;
    if !directory.join("venv/bin/python").exists() {
        println!("Only this library takes part: reference/peers/install installs the others.");
    }
    let all = cases();
    if let Some(unknown) = chosen.iter().find(|&&chosen| all.iter().all(|(name, _)| name != chosen)) {
        let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
        return Err(format!("no network is called `{unknown}`; there are {}", names.join(", ")).into());
    }
    let (root_ns, root_avx2_ns) = floors::root_and_division_ns();
    let mut report = Report {
        unix_seconds: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_secs(),
        processor: processor(),
        step_s: STEP,
        steps: STEPS,
        root_and_division_ns: root_ns,
        root_and_division_avx2_ns: root_avx2_ns,
        reading_ns: floors::reading_ns(all.iter().map(|(_, file)| file.spring_count()).max().unwrap_or(1)),
        cases: Vec::new(),
    };
    // Peers that were cut off, with the number of springs: larger networks are not tried.
    let mut cut_off: Vec<(&'static str, usize)> = Vec::new();
    print_floors(&report);
    for (name, file) in all.iter().filter(|(name, _)| chosen.is_empty() || chosen.contains(&name.as_str())) {
        let case = measure(name, file, &directory, &mut cut_off)?;
        print(&case, root_avx2_ns.unwrap_or(root_ns));
        report.cases.push(case);
    }
    let path = directory.join("peers.json");
    fs::write(&path, serde_json::to_string_pretty(&report)?)?;
    println!("\nwritten: {}", path.display());
    let wrong = report.cases.iter().flat_map(|case| &case.rows).any(|row| row.broken || row.disagrees());
    Ok(if wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Measures one network: every peer's first trajectory, then rounds in which the remaining peers take turns.
fn measure(
    name: &str,
    file: &NetworkFile,
    directory: &Path,
    cut_off: &mut Vec<(&'static str, usize)>,
) -> Result<Case, Box<dyn Error>> {
    let path: PathBuf = directory.join(format!("{name}.json"));
    file.write(&path)?;
    let springs = file.spring_count();
    let installed = directory.join("venv/bin/python").exists();
    let peers = PEERS.iter().filter(|peer| installed || matches!(peer.program, Program::Ours(..)));
    let mut contenders: Vec<(&Peer, Result<Contender, Failure>)> = Vec::new();
    for peer in peers {
        let earlier = cut_off.iter().find(|&&(cut, at)| cut == peer.name && at <= springs);
        let contender = match earlier {
            Some(&(_, springs)) => Err(Failure::NotTried { springs }),
            None => Contender::start(peer, directory, &path),
        };
        if let Err(Failure::Budget { .. }) = contender {
            cut_off.push((peer.name, springs));
        }
        contenders.push((peer, contender));
    }
    for _ in 0..MOST_ROUNDS {
        for (_, contender) in &mut contenders {
            if let Ok(turning) = contender
                && turning.stays()
                && let Err(failure) = turning.turn()
            {
                *contender = Err(failure);
            }
        }
    }
    let reference = fine_trajectory(file);
    let unit = file.initial_displacement();
    let (first, ours) = match contenders.first() {
        Some((_, Ok(first))) => (first.seconds.clone(), first.positions.clone()),
        Some((_, Err(failure))) => return Err(format!("this library: {failure}").into()),
        None => return Err("there is no peer".into()),
    };
    let rows = contenders.into_iter().map(|(peer, contender)| match contender {
        Ok(contender) => {
            let figures = Figures {
                build_s: contender.build_s,
                memory_growth_bytes: contender.memory_growth_bytes,
                error: root_mean_square(&contender.positions, &reference) / unit,
                difference: largest(&contender.positions, &ours) / unit,
                agreement: peer.agreement,
                ns_per_spring_step: quartiles(&contender.seconds)[1] * 1e9 / (springs as f64 * f64::from(STEPS)),
                ratio_quartiles: quartiles(
                    &contender.seconds.iter().zip(&first).map(|(a, b)| a / b).collect::<Vec<_>>(),
                ),
                rounds: contender.seconds.len(),
            };
            Row { peer: peer.name, differs: peer.differs, failure: None, broken: false, figures: Some(figures) }
        }
        Err(failure) => Row {
            peer: peer.name,
            differs: peer.differs,
            failure: Some(failure.to_string()),
            broken: !failure.is_for_time(),
            figures: None,
        },
    });
    Ok(Case { network: name.to_owned(), nodes: file.node_count(), springs, rows: rows.collect() })
}

impl Contender {
    /// Starts a peer and runs the trajectory once.
    fn start(peer: &Peer, directory: &Path, network: &Path) -> Result<Self, Failure> {
        let mut running = Running::start(peer, directory, network)?;
        running.answer("starting", BUDGET)?;
        let before = running.resident_bytes();
        let start = Instant::now();
        running.ask("build", BUDGET)?;
        let build_s = start.elapsed().as_secs_f64();
        let seconds = seconds(&mut running)?;
        let after = running.resident_bytes();
        let state = running.ask("state", BUDGET)?;
        let positions: Vec<[f64; 3]> = serde_json::from_str(&state)
            .map_err(|error| Failure::Answer { to: "state".into(), answer: error.to_string() })?;
        let repeats = ((TURN / seconds).ceil() as u32).clamp(1, MOST_REPEATS);
        let memory_growth_bytes = before.zip(after).map(|(before, after)| after.saturating_sub(before));
        let positions = vectors(&positions);
        Ok(Self { running, build_s, memory_growth_bytes, positions, repeats, seconds: Vec::new() })
    }

    /// Returns whether the peer takes part in one more round.
    fn stays(&self) -> bool {
        let spent = self.seconds.iter().sum::<f64>() * f64::from(self.repeats);
        self.seconds.len() < LEAST_ROUNDS || spent < TURNS_BUDGET
    }

    /// Takes a turn in a round: the trajectory from the start, several times.
    fn turn(&mut self) -> Result<(), Failure> {
        let mut sum = 0.0;
        for _ in 0..self.repeats {
            self.running.ask("reset", BUDGET)?;
            sum += seconds(&mut self.running)?;
        }
        self.seconds.push(sum / f64::from(self.repeats));
        Ok(())
    }
}

/// Runs the trajectory and returns its processor time, s.
fn seconds(running: &mut Running) -> Result<f64, Failure> {
    let command = format!("run {STEPS}");
    let answer = running.ask(&command, BUDGET)?;
    answer.parse().map_err(|_| Failure::Answer { to: command, answer })
}

/// Returns the end of the trajectory by RK4 with a fine step.
fn fine_trajectory(file: &NetworkFile) -> Vec<Vec3> {
    let network = file.network();
    let mut state = file.initial();
    let mut stepper = Stepper::new(&network);
    for _ in 0..STEPS * SUBSTEPS {
        stepper.step(GlobalIntegrator::Rk4, &network, &mut state, STEP / f64::from(SUBSTEPS), &Unconstrained);
    }
    state.x
}

fn quartiles(values: &[f64]) -> [f64; 3] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| sorted.get(sorted.len() * quarter / 4).copied().unwrap_or(f64::NAN))
}

/// Returns the processor's name; none without Linux's /proc.
fn processor() -> Option<String> {
    let info = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = info.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

impl Row {
    /// Returns whether the positions are further from the first peer's than accepted.
    fn disagrees(&self) -> bool {
        let limits = self.figures.as_ref().and_then(|figures| Some((figures.difference, figures.agreement?)));
        limits.is_some_and(|(difference, agreement)| !(difference <= agreement))
    }
}

fn print_floors(report: &Report) {
    println!("{}", report.processor.as_deref().unwrap_or("processor unknown"));
    let avx2 = report.root_and_division_avx2_ns.map_or("no AVX2".to_owned(), |ns| format!("{ns:.2} ns with AVX2"));
    println!("a root and a division: {:.2} ns per spring without, {avx2}", report.root_and_division_ns);
    println!("k, c and L from memory, all springs of the largest network: {:.2} ns per spring", report.reading_ns);
}

/// Prints the table of one network; `floor_ns` is the time of the root and division of a spring.
fn print(case: &Case, floor_ns: f64) {
    println!("\n{}: {} nodes, {} springs, {STEPS} steps of {STEP} s", case.network, case.nodes, case.springs);
    println!(
        "{:<30} {:>9} {:>7} {:>15} {:>8} {:>9} {:>9} {:>9}  differs",
        "", "ns/spr/st", "ratio", "(quartiles)", "build s", "memory MB", "error", "to ours"
    );
    for row in &case.rows {
        let Some(figures) = &row.figures else {
            println!("{:<30} {}", row.peer, row.failure.as_deref().unwrap_or_default());
            continue;
        };
        let [low, ratio, high] = figures.ratio_quartiles;
        let memory = figures.memory_growth_bytes.map_or("-".to_owned(), |bytes| format!("{:.1}", bytes as f64 / 1e6));
        let quartiles = format!("{low:.2} .. {high:.2}");
        let verdict = if row.disagrees() { "DISAGREES: " } else { "" };
        println!(
            "{:<30} {:>9.2} {ratio:>7.2} {quartiles:>15} {:>8.2} {memory:>9} {:>9.1e} {:>9.1e}  {verdict}{}",
            row.peer, figures.ns_per_spring_step, figures.build_s, figures.error, figures.difference, row.differs
        );
    }
    if let Some(figures) = case.rows.first().and_then(|row| row.figures.as_ref()) {
        println!("root and division are {:.0} % of ours", 100.0 * floor_ns / figures.ns_per_spring_step);
    }
}
