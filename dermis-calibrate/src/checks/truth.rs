//! Positions of the presses that belong to other rows.

use crate::ridge::Regression;
use dermis::finding::{Finding, FindingKind};
use dermis::geom::Point3;
use dermis::text::counted;
use faer::Mat;
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
const FEWEST_ROWS: usize = 60;
/// The best shift explains at least this part of the components ...
const LEAST: f64 = 0.1;
/// ... and this much more than no shift.
const MORE: f64 = 0.05;

/// The part of the leading components of the frames that smooth functions of the position explain, for each of
/// [`SHIFTS`], by cross-validation: position `i + shift` for frame `i`. Empty for few rows.
pub(crate) fn explained(components: &Mat<f64>, positions_m: &[Point3]) -> Vec<f64> {
    if components.nrows() < FEWEST_ROWS || components.ncols() == 0 {
        return Vec::new();
    }
    let features = features(positions_m);
    SHIFTS.map(|shift| explained_by(components, &features, shift)).collect()
}

/// The part of the leading components that the position of the press before explains besides that of the press itself;
/// `None` for few rows.
pub(crate) fn memory(components: &Mat<f64>, positions_m: &[Point3]) -> Option<f64> {
    if components.nrows() < FEWEST_ROWS || components.ncols() == 0 {
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
    let evidence = format!("part of the frames that the shifted positions explain; {zero:.3} without a shift");
    let (rows, from) = (counted(shift.abs(), "row"), if shift > 0 { "after" } else { "before" });
    let fix = format!("the press of each frame is {rows} {from} it in the truth: move the rows of the truth");
    let finding = Finding { lag: shift, ..Finding::new(FindingKind::TruthShifted, best, evidence, fix) };
    (shift != 0 && best > LEAST && best - zero > MORE).then_some(finding)
}

/// The monomials of the position up to a degree, in standardised coordinates; coordinates that hardly vary are left
/// out.
fn features(positions_m: &[Point3]) -> Mat<f64> {
    let count = positions_m.len() as f64;
    let axis = |axis: usize| {
        let mean = positions_m.iter().map(|p| p[axis]).sum::<f64>() / count;
        let sd = (positions_m.iter().map(|p| (p[axis] - mean).powi(2)).sum::<f64>() / count).sqrt();
        (mean, sd)
    };
    let axes = [0, 1, 2].map(axis);
    let widest = axes.iter().map(|(_, sd)| *sd).fold(0.0, f64::max);
    let used: Vec<usize> = (0..3).filter(|&axis| axes[axis].1 > 0.02 * widest).collect();
    let degree = if used.len() > 2 { DEGREE - 1 } else { DEGREE };
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
