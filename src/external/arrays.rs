//! Arrays that are lent to a library. In a child process each ends at a page that may not be touched, and those that the
//! library may only read are write-protected: a write beyond an array ends the process at once, in the call that did it.
#![allow(unsafe_code)]

use std::fmt;
use std::ptr::{self, NonNull};

/// Memory of lent arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// Ordinary memory.
    Ordinary,
    /// Memory that ends at a page without access.
    Guarded,
}

/// What a library may do with an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Read it.
    Read,
    /// Read and write it.
    Write,
}

/// An array that is lent to a library.
#[derive(Debug)]
pub enum Array<T> {
    /// In ordinary memory.
    Ordinary(Box<[T]>),
    /// Before a guard page.
    Guarded(Guarded<T>),
}

impl<T: Copy> Array<T> {
    /// Copies values into an array.
    pub fn new(values: &[T], memory: Memory, access: Access) -> Self {
        match memory {
            Memory::Ordinary => Self::Ordinary(values.into()),
            Memory::Guarded => Self::Guarded(Guarded::new(values, access)),
        }
    }

    /// Returns the first element's address.
    pub fn as_ptr(&self) -> *const T {
        match self {
            Self::Ordinary(values) => values.as_ptr(),
            Self::Guarded(values) => values.first.as_ptr(),
        }
    }

    /// Returns the first element's address, for a library that may write.
    pub fn as_mut_ptr(&mut self) -> *mut T {
        match self {
            Self::Ordinary(values) => values.as_mut_ptr(),
            Self::Guarded(values) => values.first.as_ptr(),
        }
    }

    /// Returns the values.
    pub fn values(&self) -> &[T] {
        match self {
            Self::Ordinary(values) => values,
            // SAFETY: the mapping holds `count` initialised values for as long as it lives, and nobody else has it.
            Self::Guarded(values) => unsafe { std::slice::from_raw_parts(values.first.as_ptr(), values.count) },
        }
    }
}

/// A mapping of its own whose last page may not be touched; the array ends where that page begins.
pub struct Guarded<T> {
    mapping: NonNull<libc::c_void>,
    bytes: usize,
    first: NonNull<T>,
    count: usize,
}

// SAFETY: the mapping belongs to this value alone.
unsafe impl<T: Send> Send for Guarded<T> {}
// SAFETY: a shared reference only reads.
unsafe impl<T: Sync> Sync for Guarded<T> {}

impl<T: Copy> Guarded<T> {
    fn new(values: &[T], access: Access) -> Self {
        let page = page_bytes();
        let size = size_of_val(values);
        let usable = size.div_ceil(page) * page;
        let bytes = usable + page;
        // SAFETY: an anonymous private mapping at an address of the system's choice; every result is checked.
        unsafe {
            let (protection, flags) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
            let mapping = libc::mmap(ptr::null_mut(), bytes, protection, flags, -1, 0);
            assert!(mapping != libc::MAP_FAILED, "no memory for an array of {size} bytes");
            let first = mapping.byte_add(usable - size).cast::<T>();
            ptr::copy_nonoverlapping(values.as_ptr(), first, values.len());
            let guarded = libc::mprotect(mapping.byte_add(usable), page, libc::PROT_NONE);
            let protected = match access {
                Access::Read if usable > 0 => libc::mprotect(mapping, usable, libc::PROT_READ),
                Access::Read | Access::Write => 0,
            };
            assert!(guarded == 0 && protected == 0, "the system refuses a guard page");
            Self {
                mapping: NonNull::new_unchecked(mapping),
                bytes,
                first: NonNull::new_unchecked(first),
                count: values.len(),
            }
        }
    }
}

impl<T> Drop for Guarded<T> {
    fn drop(&mut self) {
        // SAFETY: the mapping is this value's own, and nothing refers to it any more.
        unsafe { libc::munmap(self.mapping.as_ptr(), self.bytes) };
    }
}

impl<T> fmt::Debug for Guarded<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Guarded").field("count", &self.count).finish_non_exhaustive()
    }
}

fn page_bytes() -> usize {
    // SAFETY: a query without arguments in memory.
    usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096)
}
