//! Elementary functions of eight numbers at once, with the same bits on every system: no operation is fused, and none comes
//! from a library.
//!
//! They are compiled into vector instructions where their caller is: [`replace_in_lanes`], or `pulp::WithSimd` of another.

use pulp::{Simd, WithSimd};
use std::f64::consts::{LN_2, LOG2_E};

/// Eight numbers.
pub type Lanes = [f64; 8];

/// Replaces values by a function of them, eight at a time; the last ones together with zeros.
pub fn replace_in_lanes(values: &mut [f64], of: impl Fn(&Lanes) -> Lanes) {
    pulp::Arch::new().dispatch(Replaced { values, of });
}

struct Replaced<'a, F> {
    values: &'a mut [f64],
    of: F,
}

impl<F: Fn(&Lanes) -> Lanes> WithSimd for Replaced<'_, F> {
    type Output = ();

    /// Compiled once per instruction set, with the same bits: no operation is fused.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (eights, rest) = self.values.as_chunks_mut::<8>();
        for eight in eights {
            *eight = (self.of)(eight);
        }
        if !rest.is_empty() {
            let mut last = [0.0; 8];
            last[..rest.len()].copy_from_slice(rest);
            rest.copy_from_slice(&(self.of)(&last)[..rest.len()]);
        }
    }
}

/// The bits of 1/2^(1/2): mantissas are between it and its double.
const ROOT_OF_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
const ONE: u64 = 0x3ff0_0000_0000_0000;
const MANTISSA_BITS: u32 = 52;
const MANTISSA: u64 = (1 << MANTISSA_BITS) - 1;
/// `2^52` as bits: an integer below it, joined to them, is that number plus `2^52`.
const INTEGERS: u64 = 0x4330_0000_0000_0000;
/// Added to a number of at most `2^51`, it rounds it to an integer, which is in the lowest bits.
const ROUNDING: f64 = 6_755_399_441_055_744.0;
/// Powers of two beyond this are clamped: they are at the end of what a number can be.
const MAX_DOUBLINGS: f64 = 1000.0;

/// `x^exponent` for positive numbers that are not subnormal; results beyond `2^1000` and below `2^-1000` are these. The
/// relative error is at most `3e-16 (1 + |ln x^exponent|)`.
#[inline(always)]
pub fn powf_lanes(x: &Lanes, exponent: f64) -> Lanes {
    let mut doublings = log2_lanes(x);
    for value in &mut doublings {
        *value *= exponent;
    }
    exp2_lanes(&doublings)
}

/// `e^x`, clamped as [`powf_lanes`].
#[inline(always)]
pub fn exp_lanes(x: &Lanes) -> Lanes {
    let mut doublings = *x;
    for value in &mut doublings {
        *value *= LOG2_E;
    }
    exp2_lanes(&doublings)
}

/// The binary logarithm: `x = 2^e m` with `m` between `1/2^(1/2)` and `2^(1/2)`, and `ln m = 2 artanh s`,
/// `s = (m - 1) / (m + 1)`, by its series; the first term left out is below `2e-17` of the sum.
#[inline(always)]
fn log2_lanes(x: &Lanes) -> Lanes {
    let mut logarithms = [0.0; 8];
    for (logarithm, x) in logarithms.iter_mut().zip(x) {
        let shifted = x.to_bits().wrapping_add(ONE - ROOT_OF_HALF);
        let biased = f64::from_bits((shifted >> MANTISSA_BITS) | INTEGERS);
        let exponent = biased - (f64::from_bits(INTEGERS) + 1023.0);
        let mantissa = f64::from_bits((shifted & MANTISSA) + ROOT_OF_HALF);
        let s = (mantissa - 1.0) / (mantissa + 1.0);
        let z = s * s;
        let mut sum = 1.0 / 21.0;
        for odd in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0] {
            sum = sum * z + 1.0 / odd;
        }
        *logarithm = exponent + 2.0 * LOG2_E * (s * sum);
    }
    logarithms
}

/// `2^x`: the integer part in the exponent's bits, the rest by the series of `e^r`, `|r| <= ln(2) / 2`, whose first term
/// left out is below `5e-18`.
#[inline(always)]
fn exp2_lanes(x: &Lanes) -> Lanes {
    const INVERSE_FACTORIALS: [f64; 13] = [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let mut powers = [0.0; 8];
    for (power, x) in powers.iter_mut().zip(x) {
        let x = x.clamp(-MAX_DOUBLINGS, MAX_DOUBLINGS);
        let rounded = x + ROUNDING;
        let r = (x - (rounded - ROUNDING)) * LN_2;
        let mut sum = 1.0 / 6_227_020_800.0;
        for factor in INVERSE_FACTORIALS {
            sum = sum * r + factor;
        }
        *power = sum * f64::from_bits((rounded.to_bits().wrapping_add(1023)) << MANTISSA_BITS);
    }
    powers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_the_library() {
        let mut worst = 0.0f64;
        for exponent in [0.2, 0.62, 0.7, 1.0, 1.5, -0.5] {
            for k in -300..300 {
                let x: Lanes = std::array::from_fn(|lane| 1.083f64.powi(k) * (1.0 + 0.11 * lane as f64));
                for (power, x) in powf_lanes(&x, exponent).iter().zip(x) {
                    let exact = libm::pow(x, exponent);
                    let allowed = 3e-16 * (1.0 + exact.ln().abs());
                    worst = worst.max((power / exact - 1.0).abs() / allowed);
                }
            }
        }
        println!("the error is at most {worst:.2} of its bound");
        assert!(worst < 1.0);
    }

    #[test]
    fn exponentials_are_those_of_the_library_and_end_without_an_overflow() {
        for k in -400..400 {
            let x: Lanes = std::array::from_fn(|lane| 1.7 * f64::from(k) + 0.2 * lane as f64);
            for (power, x) in exp_lanes(&x).iter().zip(x) {
                let exact = libm::exp(x.clamp(-MAX_DOUBLINGS * LN_2, MAX_DOUBLINGS * LN_2));
                assert!((power / exact - 1.0).abs() < 3e-16 * (1.0 + x.abs()), "{x}: {power} {exact}");
            }
        }
    }
}
