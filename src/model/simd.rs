//! Vector instructions, chosen at run time.

use pulp::Arch;

/// Runs `work` with the vector instructions of `arch`, which change no result: the compiler fuses no operations.
#[inline(always)]
pub(crate) fn vectorize(arch: Arch, work: impl FnOnce()) {
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => simd.vectorize(work),
        _ => work(),
    }
}
