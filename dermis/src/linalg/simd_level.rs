//! The instruction sets for which vector loops are compiled.

use serde::{Deserialize, Serialize};

/// An instruction set. One level gives the same bits on every machine that has it; the rounding of sums differs between
/// levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SimdLevel {
    /// No vector instructions.
    Plain,
    /// 256-bit vectors with fused multiply-add (x86-64-v3).
    Avx2,
    /// 512-bit vectors (x86-64-v4).
    Avx512,
    /// 128-bit vectors of 64-bit ARM.
    Neon,
}

impl SimdLevel {
    /// All levels that this machine supports, the best last.
    pub fn available() -> Vec<SimdLevel> {
        let all = [SimdLevel::Plain, SimdLevel::Neon, SimdLevel::Avx2, SimdLevel::Avx512];
        all.into_iter().filter(|level| level.try_arch().is_some()).collect()
    }

    /// The best level of this machine.
    pub fn best() -> Self {
        Self::available().last().copied().unwrap_or(SimdLevel::Plain)
    }

    /// The dispatcher for this level; plain code if the machine does not support it.
    pub fn arch(self) -> pulp::Arch {
        self.try_arch().unwrap_or(pulp::Arch::Scalar)
    }

    #[cfg(target_arch = "x86_64")]
    fn try_arch(self) -> Option<pulp::Arch> {
        use pulp::x86::{V3, V4};
        match self {
            SimdLevel::Plain => Some(pulp::Arch::Scalar),
            SimdLevel::Avx2 => V3::try_new().map(pulp::Arch::V3),
            SimdLevel::Avx512 => V4::try_new().map(pulp::Arch::V4),
            SimdLevel::Neon => None,
        }
    }

    #[cfg(target_arch = "aarch64")]
    fn try_arch(self) -> Option<pulp::Arch> {
        match self {
            SimdLevel::Plain => Some(pulp::Arch::Scalar),
            SimdLevel::Neon => pulp::aarch64::Neon::try_new().map(pulp::Arch::Neon),
            SimdLevel::Avx2 | SimdLevel::Avx512 => None,
        }
    }

    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    fn try_arch(self) -> Option<pulp::Arch> {
        (self == SimdLevel::Plain).then_some(pulp::Arch::Scalar)
    }
}
