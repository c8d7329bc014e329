//! Positions of the presses that belong to other rows.

use crate::ridge::Regression;
use dermis::finding::{Finding, FindingKind};
use dermis::geom::Point3;
use dermis::stats::mean_and_sd;
use dermis::text::counted;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use std::ops::RangeInclusive;

/// Shifts that are tried, rows.
pub(crate) const SHIFTS: RangeInclusive<i32> = -5..=5;
/// Degree of the polynomials of the position.
const DEGREE: usize = 4;
/// Ridge of the regression.
const RIDGE: f64 = 1e-3;
/// Blocks of rows for cross-validation.
const FOLDS: usize = 8;
/// Fewest rows.
const MIN_ROWS: usize = 60;
/// The best shift explains at least this part of the components ...
pub(crate) const MIN: f64 = 0.1;
/// ... and this much more than no shift.
const MORE: f64 = 0.05;

/// In noise: shifts up to this one that are not among [`SHIFTS`] tell what chance explains, ...
const FAR: i32 = 30;
/// ... the best shift explains so many of its standard deviations more, ...
const CHANCE_SD: f64 = 10.0;
/// ... with this ridge over the mean square of a frame, in at most so many rows.
const NOISE_RIDGE: f64 = 10.0;
const MAX_ROWS: usize = 1000;

/// The part of the leading components of the frames that smooth functions of the position explain, for each of
/// [`SHIFTS`], by cross-validation: position `i + shift` for frame `i`. Empty for few rows.
pub(crate) fn explained(components: &Mat<f64>, positions_m: &[Point3]) -> Vec<f64> {
    if components.nrows() < MIN_ROWS || components.ncols() == 0 {
        return Vec::new();
    }
    let features = features(positions_m);
    SHIFTS.map(|shift| explained_by(components, &features, shift)).collect()
}

/// The part of the leading components that the position of the press before explains besides that of the press itself;
/// `None` for few rows.
pub(crate) fn memory(components: &Mat<f64>, positions_m: &[Point3]) -> Option<f64> {
    if components.nrows() < MIN_ROWS || components.ncols() == 0 {
        return None;
    }
    let own = features(positions_m);
    let (rows, count) = (own.nrows() - 1, own.ncols());
    let after = Mat::from_fn(rows, components.ncols(), |i, k| components[(i + 1, k)]);
    let alone = Mat::from_fn(rows, count, |i, k| own[(i + 1, k)]);
    let both = Mat::from_fn(rows, 2 * count, |i, k| if k < count { own[(i + 1, k)] } else { own[(i, k - count)] });
    Some(explained_by(&after, &both, 0) - explained_by(&after, &alone, 0))
}

/// Positions that belong to other rows.
pub(crate) fn shifted(explained: &[f64]) -> Option<Finding> {
    let zero = *explained.get((-SHIFTS.start()) as usize)?;
    let (shift, best) = SHIFTS.zip(explained.iter().copied()).max_by(|a, b| a.1.total_cmp(&b.1))?;
    (shift != 0 && best > MIN && best - zero > MORE).then(|| finding(shift, best, zero))
}

/// Positions that belong to other rows, where noise hides most of each press: all channels together locate the presses best at
/// another shift, far better than at shifts that are too large to be one.
///
/// For each shift the part of the positions is computed that a linear function of the frames explains, by ridge regression and
/// leaving each row out: with `C` the inverse of `X X' + l`, the residual of row `i` is `(C y)_i / C_ii` (Hoerl and Kennard 1970, DOI
/// 10.1080/00401706.1970.10488634; Golub, Heath and Wahba 1979, DOI 10.1080/00401706.1979.10489751, section 2).
pub(crate) fn shifted_in_noise(standardised: &Mat<f64>, positions_m: &[Point3]) -> Option<Finding> {
    let rows = standardised.nrows().min(MAX_ROWS);
    if rows < MIN_ROWS.max(4 * FAR as usize) {
        return None;
    }
    let frames = standardised.subrows(0, rows);
    let mut kernel = frames * frames.transpose();
    let ridge = NOISE_RIDGE * (0..rows).map(|row| kernel[(row, row)]).sum::<f64>() / rows as f64;
    (0..rows).for_each(|row| kernel[(row, row)] += ridge);
    let inverse = kernel.llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(rows, rows));
    // The positions themselves, without higher powers.
    let places = features_to(positions_m.get(..rows)?, 1);
    let all = places.squared_norm_l2();
    let explained = |shift: i32| {
        let place = |row: usize, axis: usize| places[((row as i32 + shift).rem_euclid(rows as i32) as usize, axis)];
        let moved = Mat::from_fn(rows, places.ncols(), place);
        let left = &inverse * &moved;
        let residual = Mat::from_fn(rows, left.ncols(), |row, axis| left[(row, axis)] / inverse[(row, row)]);
        1.0 - residual.squared_norm_l2() / all
    };
    let by_chance: Vec<f64> =
        (-FAR..=FAR).filter(|shift| !SHIFTS.contains(shift)).map(&explained).filter(|part| part.is_finite()).collect();
    let (mean, sd) = mean_and_sd(&by_chance);
    let (shift, best) = SHIFTS.map(|shift| (shift, explained(shift))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let zero = explained(0);
    (shift != 0 && best - mean > CHANCE_SD * sd && best - zero > MORE).then(|| finding(shift, best, zero))
}

/// The finding that positions belong to other rows.
fn finding(shift: i32, best: f64, zero: f64) -> Finding {
    let evidence =
        format!("part that the shifted positions explain of the frames, or these of them; {zero:.3} without a shift");
    shifted_by(shift, best, evidence)
}

/// The same with its own evidence.
pub(crate) fn shifted_by(shift: i32, best: f64, evidence: String) -> Finding {
    let (rows, from) = (counted(shift.abs(), "row"), if shift > 0 { "after" } else { "before" });
    let fix = format!("the press of each frame is {rows} {from} it in the truth: move the rows of the truth");
    Finding { lag: shift, ..Finding::new(FindingKind::TruthShifted, best, evidence, fix) }
}

/// The monomials of the position up to a degree, in standardised coordinates; coordinates that hardly vary are left
/// out.
fn features(positions_m: &[Point3]) -> Mat<f64> {
    features_to(positions_m, DEGREE)
}

fn features_to(positions_m: &[Point3], degree: usize) -> Mat<f64> {
    let count = positions_m.len() as f64;
    let axis = |axis: usize| {
        let mean = positions_m.iter().map(|p| p[axis]).sum::<f64>() / count;
        let sd = (positions_m.iter().map(|p| (p[axis] - mean).powi(2)).sum::<f64>() / count).sqrt();
        (mean, sd)
    };
    let axes = [0, 1, 2].map(axis);
    let widest = axes.iter().map(|(_, sd)| *sd).fold(0.0, f64::max);
    let used: Vec<usize> = (0..3).filter(|&axis| axes[axis].1 > 0.02 * widest).collect();
    let degree = if used.len() > 2 { (degree - 1).max(1) } else { degree };
    let mut powers = vec![vec![]];
    for _ in &used {
        let more = |power: &Vec<usize>| (0..=degree).map(|next| [&power[..], &[next]].concat()).collect::<Vec<_>>();
        powers = powers.iter().flat_map(more).filter(|power| power.iter().sum::<usize>() <= degree).collect();
    }
    powers.retain(|power| power.iter().sum::<usize>() > 0);
    Mat::from_fn(positions_m.len(), powers.len(), |row, k| {
        let factor = |(&axis, &power): (&usize, &usize)| {
            ((positions_m[row][axis] - axes[axis].0) / axes[axis].1).clamp(-3.0, 3.0).powi(power as i32)
        };
        used.iter().zip(&powers[k]).map(factor).product()
    })
}

fn explained_by(components: &Mat<f64>, features: &Mat<f64>, shift: i32) -> f64 {
    let rows = components.nrows() as i32;
    let (first, last) = ((-shift).max(0), rows - shift.max(0));
    let all: Vec<usize> = (first..last).map(|row| row as usize).collect();
    let position = |row: usize| (row as i32 + shift) as usize;
    let (mut residual, mut total) = (0.0, 0.0);
    for fold in 0..FOLDS {
        let is_test = |row: &usize| row * FOLDS / components.nrows() == fold;
        let (test, fit): (Vec<usize>, Vec<usize>) = all.iter().partition(|row| is_test(row));
        let input =
            |rows: &[usize]| Mat::from_fn(rows.len(), features.ncols(), |i, k| features[(position(rows[i]), k)]);
        let target = |rows: &[usize]| Mat::from_fn(rows.len(), components.ncols(), |i, k| components[(rows[i], k)]);
        let Some(regression) = Regression::fit(&input(&fit), &target(&fit), RIDGE) else { return 0.0 };
        let (predicted, target) = (input(&test) * &regression.weights, target(&test));
        for k in 0..target.ncols() {
            for i in 0..target.nrows() {
                residual += (target[(i, k)] - regression.offsets[k] - predicted[(i, k)]).powi(2);
                total += target[(i, k)].powi(2);
            }
        }
    }
    if total > 0.0 { 1.0 - residual / total } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};
    use rand::RngExt;

    /// Standardised frames of presses at random places, whose channels change smoothly with the place, in noise.
    fn recording(noise: f64, seed: u64) -> (Mat<f64>, Vec<Point3>) {
        let mut rng = sample_rng(93, seed);
        let places: Vec<Point3> =
            (0..400).map(|_| [0.1 * rng.random::<f64>(), 0.1 * rng.random::<f64>(), 0.0]).collect();
        let waves: Vec<[f64; 3]> = (0..200).map(|_| std::array::from_fn(|_| standard_normal(&mut rng))).collect();
        let mut values = Mat::from_fn(places.len(), waves.len(), |row, k| {
            let [a, b, phase] = waves[k];
            (20.0 * (a * places[row][0] + b * places[row][1]) + phase).sin() + noise * standard_normal(&mut rng)
        });
        for k in 0..values.ncols() {
            let mean = values.col(k).iter().sum::<f64>() / 400.0;
            let sd = (values.col(k).iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 400.0).sqrt();
            values.col_mut(k).iter_mut().for_each(|value| *value = (*value - mean) / sd);
        }
        (values, places)
    }

    #[test]
    fn presses_of_other_rows_are_found_in_noise_and_none_by_chance() {
        for seed in 0..20 {
            let (values, mut places) = recording(5.0, seed);
            assert!(shifted_in_noise(&values, &places).is_none(), "{seed}");
            places.rotate_right(1);
            assert_eq!(shifted_in_noise(&values, &places).map(|found| found.lag), Some(1), "{seed}");
            places.rotate_left(4);
            assert_eq!(shifted_in_noise(&values, &places).map(|found| found.lag), Some(-3), "{seed}");
            let (noise, _) = recording(1e6, seed);
            assert!(shifted_in_noise(&noise, &places).is_none(), "{seed}: noise");
        }
    }
}
