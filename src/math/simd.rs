//! One kernel, compiled for the instruction sets that it may meet.
//!
//! A kernel is plain code that the compiler vectorises; [`run`] picks the widest copy that the processor has. No copy
//! uses fused multiply-add, and floating-point sums are never reordered, so every copy gives the same bits: an asset
//! does not depend on the machine that compiled it.

/// Work that is worth a copy for each instruction set. `run` must be `#[inline(always)]`, so that it is compiled anew
/// in each.
pub trait Kernel {
    /// What the work gives.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with the widest instruction set of this processor.
#[inline]
#[allow(unsafe_code, reason = "the features are detected right before the call; measured gain in benches/README.md")]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("popcnt") {
        // SAFETY: `run_v3` needs exactly the features that were just detected.
        return unsafe { run_v3(kernel) };
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,popcnt")]
fn run_v3<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
