//! The machine that a loop ran on, as Linux describes it.

use std::fs;

use serde::Serialize;

use crate::output::folder::sha256;

/// Instruction sets that decide which kernels the program selects.
const FEATURES: [&str; 6] = ["sse2", "sse4_2", "avx", "avx2", "fma", "avx512f"];

/// Description of the machine. Unknown properties are `None`.
///
/// ```
/// use stickslip::realtime::machine::Machine;
///
/// let machine = Machine::describe(0);
/// assert!(machine.program_sha256.is_some_and(|digits| digits.len() == 64)); // the running program
/// assert!(machine.kernel.is_some_and(|version| version.starts_with("Linux")));
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    /// Name of the machine.
    pub host: Option<String>,
    /// Release and build of the kernel; contains `PREEMPT_RT` for a real-time kernel.
    pub kernel: Option<String>,
    /// Clock source of the kernel.
    pub clock_source: Option<String>,
    /// Frequency governor of the servo's CPU.
    pub governor: Option<String>,
    /// Whether the machine runs under a hypervisor.
    pub hypervisor: bool,
    /// Name of the processor.
    pub processor: Option<String>,
    /// Number of CPUs.
    pub cpus: usize,
    /// CPUs that are isolated from the scheduler.
    pub isolated: Option<String>,
    /// Supported instruction sets, of those that decide which kernels are selected.
    pub cpu_features: Vec<&'static str>,
    /// CPU time that real-time threads may use, µs per second; −1 without limit.
    pub rt_runtime_us: Option<String>,
    /// SHA-256 of the program that ran.
    pub program_sha256: Option<String>,
}

fn line(path: &str) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().next()?.trim();
    (!line.is_empty()).then(|| line.to_owned())
}

impl Machine {
    /// Describes this machine; `cpu` is the servo's.
    pub fn describe(cpu: usize) -> Self {
        let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let field = |name: &str| {
            let line = info.lines().find(|line| line.starts_with(name))?;
            Some(line.split_once(':')?.1.trim().to_owned())
        };
        let flags = field("flags").unwrap_or_default();
        let has = |flag: &str| flags.split_whitespace().any(|word| word == flag);
        Self {
            host: line("/proc/sys/kernel/hostname"),
            kernel: line("/proc/version"),
            clock_source: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            governor: line(&format!("/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor")),
            hypervisor: has("hypervisor"),
            processor: field("model name"),
            cpus: info.lines().filter(|line| line.starts_with("processor")).count(),
            isolated: line("/sys/devices/system/cpu/isolated"),
            cpu_features: FEATURES.into_iter().filter(|flag| has(flag)).collect(),
            rt_runtime_us: line("/proc/sys/kernel/sched_rt_runtime_us"),
            program_sha256: program_sha256(),
        }
    }
}

fn program_sha256() -> Option<String> {
    sha256(&std::env::current_exe().ok()?).ok()
}

/// Returns the time that the hypervisor has taken from all CPUs so far, in ticks of the kernel's accounting (usually 10
/// ms).
///
/// ```
/// use stickslip::realtime::machine::stolen;
///
/// let before = stolen();
/// assert!(stolen() >= before); // a count; on a physical machine it stays 0
/// ```
pub fn stolen() -> Option<u64> {
    // cpu user nice system idle iowait irq softirq steal …
    line("/proc/stat")?.split_whitespace().nth(8)?.parse().ok()
}
