//! Power management of the servo's CPU: idle states, which take time to wake from, and its frequency.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::Path;

use serde::Serialize;

/// File that states the largest allowed wake-up latency, and that bounds it for as long as it is kept open.
const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

/// Settings of the servo's CPU in the window. What the system does not report is `None`.
///
/// ```
/// use stickslip::realtime::power::CpuSettings;
///
/// let mut settings = CpuSettings::of(0);
/// assert!(!settings.is_dma_latency_held); // nothing was asked for yet
/// assert!(settings.dma_latency_us.is_none_or(|us| us >= 0));
/// settings.frequency_khz = [Some(2_000_000), None];
/// assert!(settings.frequency().starts_with("2000000, unknown"));
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct CpuSettings {
    /// Enabled idle states (C-states), each with the latency of waking from it.
    pub idle_states: Option<Vec<String>>,
    /// Largest allowed latency of waking from an idle state, µs.
    pub dma_latency_us: Option<i32>,
    /// Whether `/dev/cpu_dma_latency` was held open at 0 µs for the window.
    pub is_dma_latency_held: bool,
    /// CPUs that share the core, including this one.
    pub smt_siblings: Option<String>,
    /// Slack of the thread's timers, ns.
    pub timer_slack_ns: Option<u64>,
    /// Frequency before and after the window, kHz.
    pub frequency_khz: [Option<u64>; 2],
    /// Lowest and highest frequency that the governor may choose, kHz.
    pub frequency_limits_khz: [Option<u64>; 2],
}

impl CpuSettings {
    /// Reads the settings of a CPU.
    pub fn of(cpu: usize) -> Self {
        let path = format!("/sys/devices/system/cpu/cpu{cpu}");
        let path = Path::new(&path);
        let limit = |name: &str| read(&path.join("cpufreq").join(name))?.parse().ok();
        Self {
            idle_states: idle_states(&path.join("cpuidle")),
            dma_latency_us: dma_latency_us(),
            is_dma_latency_held: false,
            smt_siblings: read(&path.join("topology/thread_siblings_list")),
            timer_slack_ns: None,
            frequency_khz: [frequency_khz(cpu), None],
            frequency_limits_khz: [limit("scaling_min_freq"), limit("scaling_max_freq")],
        }
    }

    /// Returns the frequencies as text: before and after the window, lower and upper limit.
    pub fn frequency(&self) -> String {
        let all = self.frequency_khz.iter().chain(&self.frequency_limits_khz);
        all.map(|khz| khz.map_or("unknown".to_owned(), |khz| khz.to_string())).collect::<Vec<_>>().join(", ")
    }
}

/// Returns the present frequency of a CPU, kHz.
pub fn frequency_khz(cpu: usize) -> Option<u64> {
    read(Path::new(&format!("/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_cur_freq")))?.parse().ok()
}

/// Keeps all CPUs out of idle states with a wake-up latency, for as long as the returned file is open.
///
/// # Errors
/// If the system has no such file, or the process may not write it.
pub fn hold_dma_latency() -> io::Result<File> {
    let mut file = OpenOptions::new().write(true).open(DMA_LATENCY)?;
    file.write_all(&0_i32.to_ne_bytes())?;
    Ok(file)
}

fn dma_latency_us() -> Option<i32> {
    let mut bytes = [0; 4];
    File::open(DMA_LATENCY).ok()?.read_exact(&mut bytes).ok()?;
    Some(i32::from_ne_bytes(bytes))
}

fn read(path: &Path) -> Option<String> {
    Some(fs::read_to_string(path).ok()?.trim().to_owned())
}

fn idle_states(folder: &Path) -> Option<Vec<String>> {
    let mut states: Vec<_> = fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    states.sort();
    let enabled = states.iter().filter(|state| read(&state.join("disable")).is_none_or(|disabled| disabled == "0"));
    let named = enabled.filter_map(|state| {
        let latency = read(&state.join("latency")).unwrap_or_default();
        Some(format!("{} ({latency} µs)", read(&state.join("name"))?))
    });
    Some(named.collect())
}
