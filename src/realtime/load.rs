//! Background load on the machine while a servo loop is measured.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// A kind of background load.
///
/// ```
/// use stickslip::realtime::load::Load;
///
/// let threads = || std::fs::read_dir("/proc/self/task").map(|tasks| tasks.count());
/// let before = threads()?;
/// let load = Load::Cpu.start(2);
/// assert_eq!(threads()?, before + 2);
/// drop(load); // ends them
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// No background load.
    None,
    /// A thread per CPU that computes without end.
    Cpu,
    /// A thread per CPU that writes through 64 MiB without end, so that caches and memory bandwidth are shared.
    Memory,
}

/// Number of words of a memory load, 64 MiB.
const WORDS: usize = 8 << 20;

/// A background load that runs until it is dropped.
#[derive(Debug)]
pub struct Running {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    /// Starts the load on a number of threads of ordinary priority.
    pub fn start(self, threads: usize) -> Running {
        let stop = Arc::new(AtomicBool::new(false));
        let threads = match self {
            Load::None => Vec::new(),
            Load::Cpu => (0..threads).map(|_| spawn(&stop, compute)).collect(),
            Load::Memory => (0..threads).map(|_| spawn(&stop, write_through)).collect(),
        };
        Running { stop, threads }
    }
}

fn spawn(stop: &Arc<AtomicBool>, work: fn(&AtomicBool)) -> JoinHandle<()> {
    let stop = stop.clone();
    std::thread::spawn(move || work(&stop))
}

fn compute(stop: &AtomicBool) {
    let mut x = 1.0_f64;
    while !stop.load(Ordering::Relaxed) {
        for _ in 0..10_000 {
            x = black_box((x + 1.0).sqrt());
        }
    }
}

fn write_through(stop: &AtomicBool) {
    let mut words = vec![0_u64; WORDS];
    let mut round = 0;
    while !stop.load(Ordering::Relaxed) {
        round += 1;
        for chunk in words.chunks_mut(WORDS / 64) {
            chunk.iter_mut().for_each(|word| *word = word.wrapping_add(round));
            if stop.load(Ordering::Relaxed) {
                break;
            }
        }
        black_box(&mut words);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A load that panicked has ended too.
            let _ = thread.join();
        }
    }
}
