//! The position errors of contacts, measured on known touches.

use crate::contact::REGION_95_SD;
use crate::stats::order_statistic;
use serde::{Deserialize, Serialize};

/// Quantities that predict the position error of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circumstances {
    /// Height of its peak in standard deviations of the noise there; infinite without noise.
    pub signal: f64,
    /// Standard deviation of its position per axis due to noise and pixel size alone, by error propagation, m.
    pub noise_m: f64,
    /// Radius of a disk of its area, m.
    pub radius_m: f64,
    /// Distance to the next contact, m; infinite without one.
    pub next_m: f64,
}

/// A contact that was matched with a touch, and its position error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misplacement {
    /// How it was detected.
    pub circumstances: Circumstances,
    /// Number of touches in its frame.
    pub touches: usize,
    /// Whether its frame has a touch without a contact: then this contact may be two merged touches.
    pub is_shared: bool,
    /// The stated standard deviation of its position, m.
    pub stated_m: f64,
    /// Its distance from the touch along the surface, m.
    pub error_m: f64,
    /// The touch's force, N; `NaN` if it is unknown.
    pub force_n: f64,
    /// The touch's force over the contact's strength; `NaN` if the force is unknown.
    pub newtons_per_strength: f64,
}

/// The standard deviation of contacts' positions as measured on touches at known positions: a typical one times a
/// factor for each of the [circumstances](Circumstances).
///
/// "Standard deviation" is that of the Gaussian whose 95 % region has the radius that contains 95 % of the errors
/// ([`REGION_95_SD`] of them): the errors are not Gaussian, and the 95 % region is what users need.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionSpread {
    /// Typical standard deviation per axis, m.
    pub typical_m: f64,
    /// By the height of the peak in standard deviations of its noise.
    pub signal: Factor,
    /// By the radius of the contact, m: a wide one may be two merged touches.
    pub radius_m: Factor,
    /// By the distance to the next contact, m.
    pub next_m: Factor,
}

/// A factor that depends on one number: linear in its logarithm, with linear extrapolation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Factor {
    /// Numbers, ascending and positive.
    pub(crate) at: Vec<f64>,
    /// The factor at each.
    pub(crate) times: Vec<f64>,
}

/// Minimum number of contacts for a factor: the 95th percentile of 300 is known to about 5 %.
const MIN_CONTACTS: usize = 300;
/// Maximum number of points of a factor.
const MAX_STEPS: usize = 8;
/// Number of passes in which each factor is fitted with the others fixed.
const SWEEPS: usize = 6;
/// Upper limit of the signal, for images without noise.
const MAX_SIGNAL: f64 = 1e9;
/// Upper limit of the distance to the next contact, m: larger distances have no effect.
const FARTHEST_NEXT_M: f64 = 0.15;

impl Circumstances {
    /// Signal, radius and distance, each limited to its range.
    fn values(&self) -> [f64; 3] {
        [self.signal.min(MAX_SIGNAL), self.radius_m, self.next_m.min(FARTHEST_NEXT_M)]
    }
}

impl PositionSpread {
    /// Measures the spread on contacts of known error: each factor in turn is set, in bins of equal numbers of
    /// contacts, so that 95 % of the errors of a bin are within their regions. Contacts that may be two merged touches
    /// are ignored, as their error is not defined. `None` if fewer than 300 are left.
    pub fn fit(contacts: &[Misplacement]) -> Option<Self> {
        let contacts: Vec<&Misplacement> = contacts.iter().filter(|contact| !contact.is_shared).collect();
        let typical_m = region_sd(contacts.iter().map(|contact| contact.error_m).collect())?;
        let one = || Factor { at: vec![1.0], times: vec![1.0] };
        let mut spread = PositionSpread { typical_m, signal: one(), radius_m: one(), next_m: one() };
        for _ in 0..SWEEPS {
            for which in 0..3 {
                *spread.factor(which) = one();
                let relative = |contact: &&Misplacement| {
                    (contact.circumstances.values()[which], contact.error_m / spread.sd_m(&contact.circumstances))
                };
                *spread.factor(which) = Factor::fit(contacts.iter().map(relative).collect());
            }
        }
        Some(spread)
    }

    fn factor(&mut self, which: usize) -> &mut Factor {
        match which {
            0 => &mut self.signal,
            1 => &mut self.radius_m,
            _ => &mut self.next_m,
        }
    }

    /// The standard deviation of a contact's position per axis, m.
    pub fn sd_m(&self, circumstances: &Circumstances) -> f64 {
        let [signal, radius_m, next_m] = circumstances.values();
        self.typical_m * self.signal.of(signal) * self.radius_m.of(radius_m) * self.next_m.of(next_m)
    }

    /// Checks values that were read from a file.
    ///
    /// # Errors
    /// The field and its value.
    pub fn check(&self) -> Result<(), String> {
        let is_positive = |value: f64| value > 0.0 && value.is_finite();
        if !is_positive(self.typical_m) {
            return Err(format!("typical_m is {}: it must be positive", self.typical_m));
        }
        for (name, factor) in [("signal", &self.signal), ("radius_m", &self.radius_m), ("next_m", &self.next_m)] {
            let Factor { at, times } = factor;
            let positive = at.iter().chain(times).all(|&value| is_positive(value));
            if at.is_empty() || at.len() != times.len() || !positive || at.windows(2).any(|pair| pair[0] >= pair[1]) {
                return Err(format!("{name} is {at:?} times {times:?}: as many of both, positive, `at` ascending"));
            }
        }
        Ok(())
    }
}

impl Factor {
    /// The factor at a number.
    pub fn of(&self, value: f64) -> f64 {
        let above = self.at.partition_point(|&at| at < value);
        if above == 0 || above == self.at.len() {
            return self.times[above.min(self.at.len() - 1)];
        }
        let (low, high) = (self.at[above - 1], self.at[above]);
        let part = (value / low).ln() / (high / low).ln();
        self.times[above - 1] + part * (self.times[above] - self.times[above - 1])
    }

    /// From numbers and the errors there in standard deviations.
    fn fit(mut pairs: Vec<(f64, f64)>) -> Factor {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let steps = (pairs.len() / MIN_CONTACTS).clamp(1, MAX_STEPS);
        let (mut at, mut times) = (Vec::new(), Vec::new());
        let mut first = 0;
        for step in 1..=steps {
            // Equal numbers stay in one bin.
            let end = pairs.len() * step / steps;
            let last = end + same_as_before(&pairs, end);
            if last < first + MIN_CONTACTS.min(pairs.len()) {
                continue;
            }
            let step = &pairs[first..last];
            at.push(step[step.len() / 2].0);
            times.push(region_sd(step.iter().map(|pair| pair.1).collect()).expect("as many as are needed"));
            first = last;
        }
        Factor { at, times }
    }
}

/// The number of values from an index on that equal the value before it.
fn same_as_before(pairs: &[(f64, f64)], place: usize) -> usize {
    pairs[place..].iter().take_while(|pair| pair.0 == pairs[place - 1].0).count()
}

/// The standard deviation of the two-dimensional Gaussian whose 95 % region contains 95 % of some distances; `None` if
/// there are too few.
fn region_sd(distances: Vec<f64>) -> Option<f64> {
    if distances.len() < MIN_CONTACTS {
        return None;
    }
    let rank = (0.95 * distances.len() as f64) as usize;
    Some(order_statistic(&distances, rank) / REGION_95_SD)
}

/// The position error of images in addition to noise, as a fraction of a contact's radius, such that 95 % of the errors
/// are within the regions: the only parameter of the position error without a measured [`PositionSpread`]. Contacts
/// that may be two merged touches are ignored. `None` if too few are left.
pub fn blur_share(contacts: &[Misplacement]) -> Option<f64> {
    let share = |contact: &Misplacement| {
        let Circumstances { noise_m, radius_m, .. } = contact.circumstances;
        ((contact.error_m / REGION_95_SD).powi(2) - noise_m * noise_m).max(0.0).sqrt() / radius_m
    };
    let shares: Vec<f64> = contacts.iter().filter(|contact| !contact.is_shared).map(share).collect();
    if shares.len() < MIN_CONTACTS {
        return None;
    }
    let rank = (0.95 * shares.len() as f64) as usize;
    Some(order_statistic(&shares, rank))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};
    use rand::RngExt;

    /// Contacts with Gaussian errors of known deviation.
    fn contacts(count: u64, sd_m: impl Fn(&Circumstances) -> f64) -> Vec<Misplacement> {
        let contact = |index: u64| {
            let mut rng = sample_rng(11, index);
            let next_m = if rng.random::<f64>() < 0.4 { f64::INFINITY } else { 0.02 + 0.2 * rng.random::<f64>() };
            let circumstances = Circumstances {
                signal: 5.0 * 100f64.powf(rng.random()),
                noise_m: f64::NAN,
                radius_m: 0.01 + 0.01 * rng.random::<f64>(),
                next_m,
            };
            let error = standard_normal(&mut rng).hypot(standard_normal(&mut rng));
            let stated_m = sd_m(&circumstances);
            Misplacement {
                circumstances,
                touches: 1,
                is_shared: false,
                stated_m,
                error_m: stated_m * error,
                force_n: f64::NAN,
                newtons_per_strength: f64::NAN,
            }
        };
        (0..count).map(contact).collect()
    }

    fn covered(spread: &PositionSpread, contacts: &[Misplacement]) -> f64 {
        let inside = |c: &&Misplacement| c.error_m <= REGION_95_SD * spread.sd_m(&c.circumstances);
        contacts.iter().filter(inside).count() as f64 / contacts.len() as f64
    }

    #[test]
    fn a_known_deviation_is_found_again() {
        let truly = |c: &Circumstances| {
            let beside = if c.next_m < 0.05 { 2.0 } else { 1.0 };
            1e-3 * (1.0 + 15.0 / c.signal) * (c.radius_m / 0.015) * beside
        };
        let all = contacts(40_000, truly);
        let (known, fresh) = all.split_at(20_000);
        let spread = PositionSpread::fit(known).expect("contacts enough");
        spread.check().expect("what is fitted is valid");
        assert!((covered(&spread, fresh) - 0.95).abs() < 0.006, "{}", covered(&spread, fresh));
        // In every combination of the circumstances, not only overall.
        for is_in in [
            |c: &Circumstances| c.signal < 10.0,
            |c: &Circumstances| c.signal > 100.0,
            |c: &Circumstances| c.radius_m < 0.012,
            |c: &Circumstances| c.radius_m > 0.018,
            |c: &Circumstances| c.next_m < 0.04,
            |c: &Circumstances| c.next_m.is_infinite(),
        ] {
            let part: Vec<Misplacement> = fresh.iter().copied().filter(|m| is_in(&m.circumstances)).collect();
            let part = covered(&spread, &part);
            assert!((0.925..0.975).contains(&part), "{part}");
        }
        // Within the bins the deviation itself is correct to about 10 %.
        for signal in [8.0, 30.0, 200.0] {
            let c = Circumstances { signal, noise_m: f64::NAN, radius_m: 0.015, next_m: f64::INFINITY };
            assert!((spread.sd_m(&c) / truly(&c) - 1.0).abs() < 0.12, "{signal}: {}", spread.sd_m(&c) / truly(&c));
        }
    }

    #[test]
    fn the_part_of_the_radius_is_found_again() {
        let mut all = contacts(10_000, |c| 1.5e-3f64.hypot(0.2 * c.radius_m));
        all.iter_mut().for_each(|contact| contact.circumstances.noise_m = 1.5e-3);
        let share = blur_share(&all).expect("contacts enough");
        assert!((share - 0.2).abs() < 0.005, "{share}");
        assert!(blur_share(&all[..100]).is_none());
    }

    #[test]
    fn few_contacts_and_equal_circumstances_are_no_trouble() {
        assert!(PositionSpread::fit(&contacts(299, |_| 1e-3)).is_none());
        let mut even = contacts(1000, |_| 2e-3);
        even.iter_mut().for_each(|contact| contact.circumstances.radius_m = 0.01);
        let spread = PositionSpread::fit(&even).expect("contacts enough");
        assert_eq!(spread.radius_m.at, vec![0.01]);
        let read: PositionSpread = serde_json::from_str(&serde_json::to_string(&spread).unwrap()).unwrap();
        assert_eq!(read, spread);
        let wrong = PositionSpread { signal: Factor { at: vec![2.0, 1.0], times: vec![1.0, 1.0] }, ..spread };
        assert!(wrong.check().unwrap_err().contains("signal"));
    }

    #[test]
    fn a_factor_is_even_beyond_its_ends_and_runs_with_the_logarithm() {
        let factor = Factor { at: vec![10.0, 1000.0], times: vec![3.0, 1.0] };
        assert_eq!((factor.of(1.0), factor.of(f64::INFINITY)), (3.0, 1.0));
        assert!((factor.of(100.0) - 2.0).abs() < 1e-12);
    }
}
