//! Counts of a thread's allocations in a release build. A program to be certified takes [`Counting`] as its allocator.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    // Constant and without a destructor: reading and writing it allocates nothing.
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

static COUNTS: AtomicBool = AtomicBool::new(false);

/// The system's allocator, with a count of its calls by thread.
///
/// ```standalone_crate
/// use std::hint::black_box;
/// use stickslip::realtime::allocations::{Counting, on_this_thread};
///
/// #[global_allocator]
/// static ALLOCATOR: Counting = Counting;
///
/// let before = on_this_thread().expect("the allocator counts");
/// let samples = black_box(vec![1.0; 100]);
/// assert_eq!(on_this_thread(), Some(before + 1));
/// drop(samples);
/// assert_eq!(on_this_thread(), Some(before + 2)); // freeing counts too
/// ```
#[derive(Debug, Default)]
pub struct Counting;

/// Counts a call of the allocator by this thread.
#[inline]
pub fn count() {
    CALLS.with(|calls| calls.set(calls.get() + 1));
    COUNTS.store(true, Ordering::Relaxed);
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Returns the number of allocator calls by this thread so far, freeing included; `None` if nothing counts them.
pub fn on_this_thread() -> Option<u64> {
    COUNTS.load(Ordering::Relaxed).then(|| CALLS.with(Cell::get))
}
