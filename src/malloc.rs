//! The C allocator of the program, which counts its calls by thread and passes them on to glibc's. Symbols of the program
//! come before those of libc, so this counts what a renderer in a shared library allocates too: with `malloc` and its
//! relatives, and with C++'s `new`, which calls them. It cannot see memory that a library maps itself, nor an allocator of
//! its own that was filled before.
#![allow(unsafe_code)]

use std::ffi::{c_int, c_void};

use stickslip::realtime::allocations::count;

unsafe extern "C" {
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_calloc(count: usize, size: usize) -> *mut c_void;
    fn __libc_realloc(pointer: *mut c_void, size: usize) -> *mut c_void;
    fn __libc_memalign(alignment: usize, size: usize) -> *mut c_void;
    fn __libc_free(pointer: *mut c_void);
}

#[unsafe(no_mangle)]
extern "C" fn malloc(size: usize) -> *mut c_void {
    count();
    // SAFETY: the caller's; so with all below.
    unsafe { __libc_malloc(size) }
}

#[unsafe(no_mangle)]
extern "C" fn calloc(number: usize, size: usize) -> *mut c_void {
    count();
    unsafe { __libc_calloc(number, size) }
}

#[unsafe(no_mangle)]
extern "C" fn realloc(pointer: *mut c_void, size: usize) -> *mut c_void {
    count();
    unsafe { __libc_realloc(pointer, size) }
}

#[unsafe(no_mangle)]
extern "C" fn memalign(alignment: usize, size: usize) -> *mut c_void {
    count();
    unsafe { __libc_memalign(alignment, size) }
}

#[unsafe(no_mangle)]
extern "C" fn aligned_alloc(alignment: usize, size: usize) -> *mut c_void {
    memalign(alignment, size)
}

#[unsafe(no_mangle)]
extern "C" fn posix_memalign(result: *mut *mut c_void, alignment: usize, size: usize) -> c_int {
    const EINVAL: c_int = 22;
    const ENOMEM: c_int = 12;
    if !alignment.is_power_of_two() || !alignment.is_multiple_of(size_of::<usize>()) {
        return EINVAL;
    }
    let pointer = memalign(alignment, size);
    if pointer.is_null() {
        return ENOMEM;
    }
    unsafe { *result = pointer };
    0
}

#[unsafe(no_mangle)]
extern "C" fn free(pointer: *mut c_void) {
    if !pointer.is_null() {
        count();
    }
    unsafe { __libc_free(pointer) };
}
