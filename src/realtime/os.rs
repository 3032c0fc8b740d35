//! Linux system calls for real time: clocks, an absolute sleep, the scheduler, locked memory, and a thread's counters.
//! This is the only unsafe code of the library, besides the counting allocator.
#![allow(unsafe_code)]

use std::io;
use std::mem::{MaybeUninit, size_of};

/// Reads a clock, ns.
fn read(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a local timespec; it stays zero for a clock that does not exist.
    unsafe { libc::clock_gettime(clock, &mut time) };
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// Returns `CLOCK_MONOTONIC`, ns.
///
/// ```
/// use stickslip::realtime::os::now_ns;
///
/// let before = now_ns();
/// assert!(now_ns() >= before); // it never goes back
/// ```
pub fn now_ns() -> u64 {
    read(libc::CLOCK_MONOTONIC)
}

/// Returns the CPU time of the calling thread, ns.
///
/// ```
/// use stickslip::realtime::os::{now_ns, sleep_until_ns, thread_cpu_ns};
///
/// let (cpu, wall) = (thread_cpu_ns(), now_ns());
/// sleep_until_ns(wall + 5_000_000);
/// assert!(thread_cpu_ns() - cpu < now_ns() - wall); // a sleeping thread takes no CPU time
/// ```
pub fn thread_cpu_ns() -> u64 {
    read(libc::CLOCK_THREAD_CPUTIME_ID)
}

/// Sleeps until a time of `CLOCK_MONOTONIC`, ns; returns at once if it has passed.
///
/// ```
/// use stickslip::realtime::os::{now_ns, sleep_until_ns};
///
/// let release = now_ns() + 1_000_000;
/// sleep_until_ns(release);
/// assert!(now_ns() >= release); // never too early
/// sleep_until_ns(release); // and at once if that has passed
/// ```
pub fn sleep_until_ns(until: u64) {
    let time = libc::timespec {
        tv_sec: (until / 1_000_000_000) as libc::time_t,
        tv_nsec: (until % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `time` is valid, and no remainder is requested.
    while unsafe { libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &time, std::ptr::null_mut()) }
        == libc::EINTR
    {}
}

fn done(result: libc::c_int) -> io::Result<()> {
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Requests `SCHED_FIFO` for the calling thread.
///
/// # Errors
/// If the process has no right to real-time scheduling.
///
/// ```
/// use stickslip::realtime::os::{policy, request_fifo};
///
/// let before = policy();
/// match request_fifo(10) {
///     Ok(()) => assert_eq!(policy(), ("SCHED_FIFO", 10)),
///     Err(_) => assert_eq!(policy(), before), // as for most users
/// }
/// ```
pub fn request_fifo(priority: i32) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 is the calling thread; the parameters are local.
    done(unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) })
}

/// Returns the scheduling policy of the calling thread, and its priority.
pub fn policy() -> (&'static str, i32) {
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: 0 is the calling thread; the parameters are local.
    let policy = unsafe {
        libc::sched_getparam(0, &mut parameters);
        libc::sched_getscheduler(0)
    };
    let name = match policy {
        libc::SCHED_FIFO => "SCHED_FIFO",
        libc::SCHED_RR => "SCHED_RR",
        libc::SCHED_OTHER => "SCHED_OTHER",
        libc::SCHED_BATCH => "SCHED_BATCH",
        libc::SCHED_IDLE => "SCHED_IDLE",
        _ => "unknown",
    };
    (name, parameters.sched_priority)
}

/// Requests that sleeps of the calling thread end with the least delay, and returns the slack of its timers that it got,
/// ns; `None` if the system has none. Threads under `SCHED_FIFO` have no slack, whatever the value.
///
/// ```
/// use stickslip::realtime::os::least_timer_slack_ns;
///
/// assert!(least_timer_slack_ns().is_none_or(|slack| slack <= 50_000)); // 50 µs is the default
/// ```
pub fn least_timer_slack_ns() -> Option<u64> {
    // SAFETY: no pointer is passed.
    let slack = unsafe {
        libc::prctl(libc::PR_SET_TIMERSLACK, 1);
        libc::prctl(libc::PR_GET_TIMERSLACK)
    };
    u64::try_from(slack).ok()
}

/// Locks all present and future memory of the process.
///
/// # Errors
/// If the process has no right to lock its memory.
///
/// ```
/// use stickslip::realtime::os::{lock_memory, unlock_memory};
///
/// match lock_memory() {
///     Ok(()) => unlock_memory(),
///     Err(refused) => assert!(refused.raw_os_error().is_some()), // the system says why
/// }
/// ```
pub fn lock_memory() -> io::Result<()> {
    // SAFETY: no pointer is passed.
    done(unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) })
}

/// Unlocks the memory.
pub fn unlock_memory() {
    // SAFETY: no pointer is passed.
    unsafe { libc::munlockall() };
}

/// Returns the CPUs that the calling thread may run on, ascending.
pub fn affinity() -> Vec<usize> {
    let mut set = MaybeUninit::<libc::cpu_set_t>::zeroed();
    // SAFETY: the set is local and of the stated size; all zero is a valid set.
    let set = unsafe {
        libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), set.as_mut_ptr());
        set.assume_init()
    };
    // SAFETY: every index is below the size of the set.
    (0..libc::CPU_SETSIZE as usize).filter(|&cpu| unsafe { libc::CPU_ISSET(cpu, &set) }).collect()
}

/// Pins the calling thread to these CPUs.
///
/// # Errors
/// If none of these CPUs exists.
///
/// ```
/// use stickslip::realtime::os::{affinity, pin};
///
/// let cpus = affinity();
/// pin(&cpus[..1])?;
/// assert_eq!(affinity(), cpus[..1]);
/// assert!(pin(&[]).is_err()); // it has to run somewhere
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn pin(cpus: &[usize]) -> io::Result<()> {
    let mut set = MaybeUninit::<libc::cpu_set_t>::zeroed();
    // SAFETY: all zero is a valid set; indices beyond it are omitted; its size is as stated.
    unsafe {
        for &cpu in cpus.iter().filter(|&&cpu| cpu < libc::CPU_SETSIZE as usize) {
            libc::CPU_SET(cpu, &mut *set.as_mut_ptr());
        }
        done(libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), set.as_ptr()))
    }
}

/// Counters of the calling thread since its start.
///
/// ```
/// use stickslip::realtime::os::{Usage, now_ns, sleep_until_ns};
///
/// let before = Usage::of_this_thread();
/// sleep_until_ns(now_ns() + 1_000_000);
/// assert!(Usage::of_this_thread().since(before).voluntary_switches >= 1); // it yielded the CPU to sleep
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Usage {
    /// Number of page faults, minor and major.
    pub page_faults: u64,
    /// Number of times the thread yielded the CPU, as it does to sleep.
    pub voluntary_switches: u64,
    /// Number of times the thread was preempted.
    pub involuntary_switches: u64,
}

impl Usage {
    /// Reads the counters of the calling thread.
    pub fn of_this_thread() -> Self {
        let mut usage = MaybeUninit::<libc::rusage>::zeroed();
        // SAFETY: the structure is local, and all zero is a valid value.
        let usage = unsafe {
            libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr());
            usage.assume_init()
        };
        Self {
            page_faults: usage.ru_minflt as u64 + usage.ru_majflt as u64,
            voluntary_switches: usage.ru_nvcsw as u64,
            involuntary_switches: usage.ru_nivcsw as u64,
        }
    }

    /// Returns the difference from an earlier reading.
    pub fn since(self, before: Self) -> Self {
        Self {
            page_faults: self.page_faults - before.page_faults,
            voluntary_switches: self.voluntary_switches - before.voluntary_switches,
            involuntary_switches: self.involuntary_switches - before.involuntary_switches,
        }
    }
}
