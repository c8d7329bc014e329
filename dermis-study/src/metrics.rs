//! The figures of a method on a digital twin, for tables and JSON: one list for all commands.
//!
//! ```
//! use dermis_study::metrics::figures;
//!
//! let resolved = figures().find(|figure| figure.key == "two_resolved_from_m").expect("a figure");
//! assert_eq!(resolved.show(0.04), "40"); // mm
//! assert_eq!(resolved.worst(&[0.03, 0.04]), 0.04);
//! ```

use dermis::stats::mean;
use dermis_plot::report::Table;
use dermis_sim::evaluate::{
    BenchmarkBound, BenchmarkOptions, BenchmarkResult, FORCES_PER_POSITION, FamiliesResult, FamilyScore,
};
use dermis_sim::experiment::{Family, Sizes};

/// One figure of a result.
pub struct Figure {
    /// Its identifier in JSON, where values are in SI units.
    pub key: &'static str,
    /// Its name in tables, with the unit used there.
    pub name: &'static str,
    /// Its value in SI units; `NaN` if there is none.
    pub of: fn(&BenchmarkResult) -> f64,
    /// Factor from SI units to the unit in tables.
    pub factor: f64,
    /// Decimals in tables.
    pub decimals: usize,
    /// Which of two values is worse.
    pub worse: Worse,
}

/// Which of two values of a figure is worse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Worse {
    /// The greater one, as for an error.
    More,
    /// The lesser one, as for a success rate.
    Less,
}

macro_rules! figures {
    ($([$key:expr, $name:expr, $factor:literal, $decimals:literal, $worse:ident, $of:expr])*) => {
        &[$(Figure { key: $key, name: $name, of: $of, factor: $factor, decimals: $decimals, worse: Worse::$worse }),*]
    };
}

/// The figures of a set of single touches.
macro_rules! single_touches {
    ($set:ident) => {
        single_touches! { $set
            ["_localisation_mean_m", ": localisation, mean, mm", 1e3, 2, |t| t.$set.localisation_m.mean]
            ["_localisation_sd_m", ": localisation, sd, mm", 1e3, 2, |t| t.$set.localisation_m.sd]
            ["_localisation_median_m", ": localisation, median, mm", 1e3, 2, |t| t.$set.localisation_m.median]
            ["_localisation_p95_m", ": localisation, 95th percentile, mm", 1e3, 2, |t| t.$set.localisation_m.p95]
            ["_localisation_largest_tenth_m", ": localisation, mean of the largest tenth, mm", 1e3, 2,
                |t| t.$set.localisation_m.largest_tenth]
            ["_eq11_mean_m", ": whole image (Eq. 11), mean, mm", 1e3, 1, |t| t.$set.eq11_m.mean]
            ["_misses", ": misses", 1.0, 1, |t| t.$set.misses as f64]
            ["_ghosts", ": false positives", 1.0, 1, |t| t.$set.false_positives as f64]
            ["_sensitivity_spread", ": sensitivity spread", 1.0, 2, |t| t.$set.sensitivity_spread]
            ["_strength_spread", ": spread of the contact's strength per newton", 1.0, 2, |t| t.$set.strength_spread]
        }
    };
    ($set:ident $([$key:literal, $name:literal, $factor:literal, $decimals:literal, $of:expr])*) => {
        figures! {
            $([concat!(stringify!($set), $key), concat!(stringify!($set), $name), $factor, $decimals, More, $of])*
        }
    };
}

/// All figures, in the order of the tables.
pub fn figures() -> impl Iterator<Item = &'static Figure> {
    GRID.iter().chain(RANDOM).chain(OTHERS)
}

const GRID: &[Figure] = single_touches!(grid);
const RANDOM: &[Figure] = single_touches!(random);
const OTHERS: &[Figure] = figures! {
    ["rim_and_seam_mean_m", "rim and seam: localisation, mean, mm", 1e3, 2, More, |t| t.rim_and_seam_m.mean]
    ["rim_and_seam_p95_m", "rim and seam: localisation, 95th percentile, mm", 1e3, 2, More, |t| t.rim_and_seam_m.p95]
    ["rim_and_seam_over_all", "rim and seam: mean over that of both sets", 1.0, 2, More,
        |t| t.rim_and_seam_m.mean / t.single_m.mean]
    ["grid_true_spread", "grid: spread of the true strength per newton", 1.0, 2, More, |t| t.force.true_spread[0]]
    ["random_true_spread", "random: spread of the true strength per newton", 1.0, 2, More, |t| t.force.true_spread[1]]
    ["rank_correlation_median", "peak and force at one place: rank correlation, median", 1.0, 3, Less,
        |t| t.force.rank_correlation()[0]]
    ["rank_correlation_least", "peak and force at one place: rank correlation, least", 1.0, 3, Less,
        |t| t.force.rank_correlation()[1]]
    ["peak_ratio_median", "peak at 4 N over 1 N, over the true ratio: median", 1.0, 2, Less,
        |t| t.force.peak_ratio()[0]]
    ["peak_ratio_least", "peak at 4 N over 1 N, over the true ratio: least", 1.0, 2, Less, |t| t.force.peak_ratio()[1]]
    ["covered_single", "95 % region holds the truth: one touch, %", 100.0, 1, Less, |t| t.covered.single]
    ["covered_two", "95 % region holds the truth: two touches, both found, %", 100.0, 1, Less, |t| t.covered.two]
    ["covered_two_as_one", "95 % region holds the nearer of two taken for one, %", 100.0, 1, Less,
        |t| t.covered.two_as_one]
    ["covered_four", "95 % region holds the truth: four touches, all found, %", 100.0, 1, Less, |t| t.covered.four]
    ["two_resolved_from_m", "two touches: 90 % resolved from, mm", 1e3, 0, More, BenchmarkResult::resolved_from_m]
    ["two_resolved_at_20_mm", "two touches: resolved at 20 mm, %", 100.0, 1, Less, |t| t.resolved_at(0.02)]
    ["two_resolved_at_40_mm", "two touches: resolved at 40 mm, %", 100.0, 1, Less, |t| t.resolved_at(0.04)]
    ["two_resolved_at_60_mm", "two touches: resolved at 60 mm, %", 100.0, 1, Less, |t| t.resolved_at(0.06)]
    ["two_resolved_at_80_mm", "two touches: resolved at 80 mm, %", 100.0, 1, Less, |t| t.resolved_at(0.08)]
    ["four_localisation_mean_m", "four touches: localisation, mean, mm", 1e3, 2, More, |t| t.four.localisation_m.mean]
    ["four_localisation_p95_m", "four touches: localisation, 95th percentile, mm", 1e3, 2, More,
        |t| t.four.localisation_m.p95]
    ["four_misses_per_touch", "four touches: misses, % of touches", 100.0, 1, More,
        |t| t.four.misses as f64 / (4 * t.four.frames) as f64]
    ["four_ghosts_per_touch", "four touches: false positives, % of touches", 100.0, 1, More,
        |t| t.four.false_positives as f64 / (4 * t.four.frames) as f64]
    ["noise_factor", "threshold, sd of noise", 1.0, 2, More, |t| t.noise_factor]
    ["least_force_median_n", "smallest force found, median, N", 1.0, 3, More, |t| t.least_force_n()[0]]
    ["least_force_p95_n", "smallest force found, 95th percentile, N", 1.0, 3, More, |t| t.least_force_n()[1]]
    ["four_all_found", "four touches: all found, nothing else, %", 100.0, 1, Less, |t| t.four.all_found]
};

impl Figure {
    /// The value as printed in tables.
    pub fn show(&self, value: f64) -> String {
        if !value.is_finite() { "none".into() } else { format!("{:.*}", self.decimals, self.factor * value) }
    }

    /// What the skin allows any unbiased method, in SI units; `None` for figures without a bound.
    pub(crate) fn bound(&self, bound: &BenchmarkBound) -> Option<f64> {
        let value = match self.key {
            "grid_localisation_mean_m" | "random_localisation_mean_m" => bound.localisation_m,
            "grid_misses" => bound.misses.map_or(f64::NAN, |misses| misses[0]),
            "random_misses" => bound.misses.map_or(f64::NAN, |misses| misses[1]),
            "two_resolved_from_m" => bound.resolved_from_m(),
            "two_resolved_at_20_mm" => bound.resolved_at(0.02),
            "two_resolved_at_40_mm" => bound.resolved_at(0.04),
            "two_resolved_at_60_mm" => bound.resolved_at(0.06),
            "two_resolved_at_80_mm" => bound.resolved_at(0.08),
            "least_force_median_n" => bound.least_force_n[0],
            "least_force_p95_n" => bound.least_force_n[1],
            _ => f64::NAN,
        };
        value.is_finite().then_some(value)
    }

    /// The worst of some values; `NaN` if one of them is `NaN`.
    pub fn worst(&self, values: &[f64]) -> f64 {
        let worse = |a: f64, b: f64| match self.worse {
            _ if a.is_nan() || b.is_nan() => f64::NAN,
            Worse::More => a.max(b),
            Worse::Less => a.min(b),
        };
        values.iter().copied().reduce(worse).unwrap_or(f64::NAN)
    }
}

/// Every figure: its mean over the twins and the worst twin; where it has a bound, the bound and the mean over it.
pub fn table(twins: &[BenchmarkResult], bound: Option<&BenchmarkBound>) -> Table {
    let mut table = Table::new(&["figure", "mean of twins", "worst twin", "bound", "mean / bound"]);
    for figure in figures() {
        let values: Vec<f64> = twins.iter().map(figure.of).collect();
        let of_twins = mean(&values);
        let limit = bound.and_then(|bound| figure.bound(bound));
        table.row([
            figure.name.to_string(),
            figure.show(of_twins),
            figure.show(figure.worst(&values)),
            limit.map(|limit| figure.show(limit)).unwrap_or_default(),
            limit.map(|limit| of_bound(of_twins / limit)).unwrap_or_default(),
        ]);
    }
    table
}

fn of_bound(ratio: f64) -> String {
    if ratio.is_finite() { format!("{ratio:.2}") } else { "none".into() }
}

/// Two tables of a benchmark of families: a row for each family over all skins, and a row for each skin over all families.
pub fn families_tables(skins: &[FamiliesResult]) -> [Table; 2] {
    const SCORES: [&str; 5] = ["misses", "false", "mean, mm", "95 %, mm", "in region, %"];
    let mut families = Table::new(&[&["family", "objects"][..], &SCORES, &["length"]].concat());
    for (index, family) in Family::ALL.into_iter().enumerate() {
        let of: Vec<&FamilyScore> = skins.iter().map(|skin| &skin.families[index]).collect();
        let objects: usize = of.iter().map(|score| score.objects).sum();
        let lengths: Vec<f64> = of.iter().map(|score| score.length_ratio).collect();
        let length = Some(mean(&lengths)).filter(|length| length.is_finite());
        let mut row = vec![family.name().to_string(), objects.to_string()];
        row.extend(scores(&of));
        row.push(length.map(|length| format!("{length:.2}")).unwrap_or_default());
        families.push(row);
    }
    let header = ["seed", "patches, mm", "foam, mm", "coat, %", "electrodes, mm", "dB"];
    let mut each = Table::new(&[&header[..], &SCORES].concat());
    for FamiliesResult { seed, skin, families } in skins {
        let mut row = vec![
            seed.to_string(),
            skin.patches_m.map_or("none".into(), |pitch_m| format!("{:.1}", 1e3 * pitch_m)),
            format!("{:.1}", 1e3 * skin.foam_m),
            format!("{:.0}", 100.0 * skin.coat_rms),
            format!("{:.1}", 1e3 * skin.displacement_rms_m),
            format!("{:.0}", skin.snr_db),
        ];
        row.extend(scores(&families.iter().collect::<Vec<_>>()));
        each.push(row);
    }
    [families, each]
}

/// Misses, false positives, mean and the mean of the 95th percentiles of the error, and the share in the 95 % region.
fn scores(of: &[&FamilyScore]) -> [String; 5] {
    let found = |score: &FamilyScore| (score.objects - score.misses) as f64;
    let all: f64 = of.iter().map(|score| found(score)).sum();
    let mean = |value: &dyn Fn(&FamilyScore) -> f64| {
        of.iter().filter(|score| found(score) > 0.0).map(|score| found(score) * value(score)).sum::<f64>() / all
    };
    [
        of.iter().map(|score| score.misses).sum::<usize>().to_string(),
        of.iter().map(|score| score.false_positives).sum::<usize>().to_string(),
        format!("{:.2}", 1e3 * mean(&|score| score.localisation_m.mean)),
        format!("{:.2}", 1e3 * mean(&|score| score.localisation_m.p95)),
        format!("{:.1}", 100.0 * mean(&|score| score.covered)),
    ]
}

/// Number of frames of [`dermis_sim::evaluate::Benchmark::run`] for this size, on a skin with `pixels` pixels.
pub fn benchmark_frames(size: &BenchmarkOptions, pixels: usize) -> usize {
    let Sizes { grid_step, random, separations_m, pairs, fours, .. } = &size.sizes;
    pixels.div_ceil(*grid_step)
        + random
        + separations_m.len() * pairs
        + fours
        + size.places * FORCES_PER_POSITION
        + size.untouched
        + dermis_sim::experiment::UNTOUCHED_FRAMES as usize
        + pixels.div_ceil(size.force_step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_has_a_key_of_its_own_and_knows_its_worst_twin() {
        let mut keys: Vec<&str> = figures().map(|figure| figure.key).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), figures().count());
        let figure = |key: &str| figures().find(|figure| figure.key == key).expect("a figure");
        assert_eq!(figure("grid_misses").worst(&[1.0, 3.0, 2.0]), 3.0);
        assert_eq!(figure("four_all_found").worst(&[0.9, 0.7, 0.8]), 0.7);
        assert!(figure("grid_misses").worst(&[1.0, f64::NAN, 2.0]).is_nan());
        assert_eq!(figure("four_all_found").show(0.905), "90.5");
        assert_eq!(figure("two_resolved_from_m").show(f64::NAN), "none");
    }

    #[test]
    fn figures_with_a_bound_show_it() {
        let bound = BenchmarkBound {
            misses: None,
            localisation_m: 5e-4,
            least_force_n: [0.01, 0.02],
            two_resolved: vec![(0.02, 0.7), (0.04, 0.95), (0.06, 1.0)],
        };
        let of = |key: &str| figures().find(|figure| figure.key == key).expect("a figure").bound(&bound);
        assert_eq!(of("random_localisation_mean_m"), Some(5e-4));
        assert_eq!(of("two_resolved_from_m"), Some(0.04));
        assert_eq!(of("two_resolved_at_20_mm"), Some(0.7));
        assert_eq!((of("two_resolved_at_80_mm"), of("grid_misses")), (None, None));
        let bound = BenchmarkBound { misses: Some([2.5, 1.0]), ..bound };
        let misses = figures().find(|figure| figure.key == "random_misses").expect("a figure");
        assert_eq!(misses.bound(&bound), Some(1.0));
    }
}
