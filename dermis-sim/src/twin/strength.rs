//! The true strength of a touch.

/// The relative rise of conductance, integrated over the sheet, that changes the field around it in the same way as a
/// round contact under a floating patch, m2.
///
/// A disk of radius `a` that is connected to the patch with the conductance `c` per area obeys
/// `laplace(phi) = (c / s) phi` in it, `s` being the sheet's conductance, and `laplace(phi) = 0` outside. In a uniform
/// field its response is the dipole `a^2 I2(x) / I0(x)`, `x = a sqrt(c / s)` (modified Bessel functions); the response
/// of a small change of conductance with the integral `q` is `q / (2 pi)`; so
///
/// `q = 2 pi a^2 I2(x) / I0(x)`:
///
/// `pi a^4 c / (4 s)` for a weak contact, twice the disk's area for a perfect one.
///
/// Here the contact is described by its total conductance `G = integral of c` (S) and its second moment about its own
/// centre `m = integral of c |r - centre|^2` (S m2). It is replaced by the uniform disk with the same values,
/// `a^2 = 2 m / G` and `x^2 = G / (pi s)`, which is exact for weak contacts of any shape.
pub(super) fn of_contact(conductance_s: f64, moment_s_m2: f64, sheet_s: f64) -> f64 {
    if conductance_s <= 0.0 {
        return 0.0;
    }
    let square_m2 = 2.0 * moment_s_m2 / conductance_s;
    std::f64::consts::TAU * square_m2 * second_over_zeroth((conductance_s / (std::f64::consts::PI * sheet_s)).sqrt())
}

/// `I2(x) / I0(x)` for `x > 0`, by the continued fraction of ratios of neighbouring orders
/// `I_n / I_(n-1) = 1 / (2 n / x + I_(n+1) / I_n)` (Abramowitz and Stegun 1964, 9.6.26), from an order far above `x`
/// down.
fn second_over_zeroth(x: f64) -> f64 {
    let highest = 20 + (2.0 * x) as usize;
    let second = (2..=highest).rev().fold(0.0, |ratio, n| 1.0 / (2.0 * n as f64 / x + ratio));
    second / (2.0 / x + second)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn the_ratio_of_bessel_functions_is_right() {
        // Tables: I0, I1 at 1 and 5 (Abramowitz and Stegun 1964, table 9.8); I2 = I0 - 2 I1 / x.
        for (x, i0, i1) in [(1.0, 1.266_065_878, 0.565_159_104), (5.0, 27.239_871_82, 24.335_642_14)] {
            let exact = 1.0 - 2.0 * i1 / (x * i0);
            assert!((second_over_zeroth(x) - exact).abs() < 1e-8, "{x}");
        }
        assert!((second_over_zeroth(1e-3) / (1e-6 / 8.0) - 1.0).abs() < 1e-6);
        assert!((second_over_zeroth(200.0) - 1.0 + 2.0 / 200.0).abs() < 1e-4);
    }

    #[test]
    fn an_even_disk_is_right_weak_and_strong() {
        let (a, s) = (0.004, 1e-3);
        let strength = |c: f64| {
            let conductance = c * PI * a * a;
            of_contact(conductance, conductance * a * a / 2.0, s)
        };
        assert!((strength(1e-3) / (PI * a.powi(4) * 1e-3 / (4.0 * s)) - 1.0).abs() < 1e-5);
        assert!((strength(1e9) / (2.0 * PI * a * a) - 1.0).abs() < 1e-3);
        assert_eq!(of_contact(0.0, 0.0, s), 0.0);
    }
}
