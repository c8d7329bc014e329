//! Performance limits of one core of this machine.

use pulp::{Arch, Simd, WithSimd};
use std::hint::black_box;
use std::time::Instant;

/// Number of runs of each loop; the fastest is used, as the others were disturbed.
const TRIES: usize = 15;
/// Number of independent sums: more than two pipes of latency four need, and few enough for 16 registers.
const SUMS: usize = 12;

/// One line per limit: instruction set, quantity, working set in KiB (0: registers), value, unit.
pub fn print() {
    println!("level,what,working_set_kib,value,unit");
    println!("-,clock,0,{:.2},GHz", clock_ghz());
    for (name, arch) in levels() {
        println!("{name},multiply-adds,0,{:.1},G/s", arch.dispatch(MultiplyAdds));
        for kib in [24, 512, 8 << 10, 128 << 10] {
            // Not zeros, which would share one page of memory until written to.
            let mut numbers = vec![1.0; kib * 1024 / size_of::<f64>()];
            println!("{name},read,{kib},{:.1},GB/s", arch.dispatch(Read(&numbers)));
            println!("{name},add to,{kib},{:.1},GB/s", arch.dispatch(AddTo(&mut numbers)));
        }
    }
}

fn levels() -> Vec<(&'static str, Arch)> {
    let mut levels = vec![("plain", Arch::Scalar)];
    #[cfg(target_arch = "x86_64")]
    {
        levels.extend(pulp::x86::V3::try_new().map(|v3| ("avx2", Arch::V3(v3))));
        levels.extend(pulp::x86::V4::try_new().map(|v4| ("avx512", Arch::V4(v4))));
    }
    #[cfg(target_arch = "aarch64")]
    levels.extend(pulp::aarch64::Neon::try_new().map(|neon| ("neon", Arch::Neon(neon))));
    levels
}

/// The clock frequency, from a chain of dependent integer multiplications and additions: three cycles and one on every
/// x86-64 core of the last decade.
fn clock_ghz() -> f64 {
    let steps = 500_000_u64;
    let seconds = fastest(|| {
        let factor = black_box(6364136223846793005_u64);
        let mut value = black_box(1_u64);
        for _ in 0..steps {
            value = value.wrapping_mul(factor).wrapping_add(1442695040888963407);
        }
        black_box(value);
    });
    4.0 * steps as f64 / seconds / 1e9
}

struct MultiplyAdds;

impl WithSimd for MultiplyAdds {
    type Output = f64;

    /// Scalar multiply-adds per second, 1e9.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let rounds = 1_000_000;
        let (factor, term) = (simd.splat_f64s(black_box(0.999)), simd.splat_f64s(black_box(1e-3)));
        let seconds = fastest(
            #[inline(always)]
            || {
                let mut sums = [term; SUMS];
                for _ in 0..rounds {
                    for sum in &mut sums {
                        *sum = simd.mul_add_e_f64s(*sum, factor, term);
                    }
                }
                black_box(total(simd, &sums));
            },
        );
        (rounds * SUMS * S::F64_LANES) as f64 / seconds / 1e9
    }
}

struct Read<'a>(&'a [f64]);

impl WithSimd for Read<'_> {
    type Output = f64;

    /// Bytes read per second, 1e9.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let vectors = S::as_simd_f64s(self.0).0;
        let passes = passes(self.0.len());
        let seconds = fastest(
            #[inline(always)]
            || {
                let mut sums = [simd.splat_f64s(0.0); 8];
                for _ in 0..passes {
                    for chunk in black_box(vectors).chunks_exact(8) {
                        for (sum, &value) in sums.iter_mut().zip(chunk) {
                            *sum = simd.add_f64s(*sum, value);
                        }
                    }
                }
                black_box(total(simd, &sums));
            },
        );
        (passes * size_of_val(self.0)) as f64 / seconds / 1e9
    }
}

struct AddTo<'a>(&'a mut [f64]);

impl WithSimd for AddTo<'_> {
    type Output = f64;

    /// Bytes changed in place per second, 1e9: each is read and written.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (passes, bytes) = (passes(self.0.len()), size_of_val(self.0));
        let term = simd.splat_f64s(black_box(1e-3));
        let numbers = self.0;
        let seconds = fastest(
            #[inline(always)]
            || {
                for _ in 0..passes {
                    for value in S::as_mut_simd_f64s(black_box(&mut *numbers)).0 {
                        *value = simd.add_f64s(*value, term);
                    }
                }
            },
        );
        (passes * bytes) as f64 / seconds / 1e9
    }
}

/// The number of passes for a total of about 256 MiB.
fn passes(numbers: usize) -> usize {
    ((256 << 20) / (numbers * size_of::<f64>())).max(1)
}

#[inline(always)]
fn total<S: Simd>(simd: S, sums: &[S::f64s]) -> f64 {
    sums.iter().map(|&sum| simd.reduce_sum_f64s(sum)).sum()
}

#[inline(always)]
fn fastest(mut run: impl FnMut()) -> f64 {
    let mut fastest = f64::INFINITY;
    for _ in 0..TRIES {
        let start = Instant::now();
        run();
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    fastest
}
