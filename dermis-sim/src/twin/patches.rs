//! The grid of fabric patches on a body.

use super::TwinError;
use super::contact_law::ContactLaw;
use super::error::{check_between, check_positive};
use super::press::Foam;
use crate::unrolled::Unrolled;
use dermis::design::Body;
use dermis::geom::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Maximum number of rows or columns: larger numbers are probably typing errors.
const MOST_LINES: usize = 1000;
/// Relative tolerance for equal sizes: those in a file are rounded.
const RELATIVE_ROUNDING: f64 = 1e-6;

/// Conductive patches in rows and columns over the coating, and the foam above them.
///
/// Rows are along the axis of a cylinder, or along y of the bounding box of a flat skin; columns are around the
/// cylinder, or along x. Patches are clipped at the edge of the body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatchOptions {
    /// Rows of patches.
    pub rows: usize,
    /// Columns of patches; on a cylinder they are closed around it.
    pub columns: usize,
    /// Width of the gaps between patches, m.
    pub gap_m: f64,
    /// Shift of the grid [along, around], m. If the grid covers the body, parts shifted out at one end enter at the
    /// other.
    #[serde(default)]
    pub offset_m: [f64; 2],
    /// Pitch of the patches [along, around], m; by default the grid covers the body.
    #[serde(default)]
    pub pitch_m: Option<[f64; 2]>,
    /// The foam between a tip and the patches.
    pub foam: Foam,
    /// Contact conductance between patch and coating.
    pub contact: ContactLaw,
}

impl PatchOptions {
    /// All checks that need no body.
    ///
    /// # Errors
    /// An invalid number, with its name, its value and a fix.
    pub fn check(&self) -> Result<(), TwinError> {
        check_between("rows", self.rows as f64, [1.0, MOST_LINES as f64], "the paper's skin has about 30")?;
        check_between("columns", self.columns as f64, [1.0, MOST_LINES as f64], "the paper's skin has about 30")?;
        check_between("gap_m", self.gap_m, [0.0, 1.0], "patches must not overlap; 0.001 is usual")?;
        for offset in self.offset_m {
            check_between("offset_m", offset, [-10.0, 10.0], "0 lays the first patch at the body's edge")?;
        }
        for pitch in self.pitch_m.into_iter().flatten() {
            check_positive("pitch_m", pitch, "leave it out to cover the body")?;
            check_between("pitch_m", pitch, [1e-5, 10.0], "leave it out to cover the body")?;
        }
        check_positive("thickness_m", self.foam.thickness_m, "0.003 is a thin neoprene foam")?;
        check_positive("modulus_pa", self.foam.modulus_pa, "200000 is a soft neoprene foam")?;
        // Thicker foam spreads each press over the whole skin.
        check_between("thickness_m", self.foam.thickness_m, [1e-5, 0.1], "0.003 is a thin neoprene foam")?;
        check_between("modulus_pa", self.foam.modulus_pa, [1.0, 1e12], "200000 is a soft neoprene foam")?;
        self.contact.check()
    }

    /// The grid on a body.
    ///
    /// # Errors
    /// As [`check`](Self::check); patches that are larger than the body, a gap that leaves nothing of them, columns
    /// that do not close around a cylinder, a body known only by its mesh.
    pub(crate) fn on_body(&self, body: &Body) -> Result<PatchGrid, TwinError> {
        self.check()?;
        let (low, size, wraps) = match *body {
            Body::Cylinder { length_m, diameter_m } => ([0.0; 2], [length_m, PI * diameter_m], true),
            Body::Rectangle { width_m, height_m } => ([0.0; 2], [height_m, width_m], false),
            Body::Disk { diameter_m } => ([-diameter_m / 2.0; 2], [diameter_m; 2], false),
            Body::Mesh { .. } => return Err(TwinError::NoChart),
        };
        let counts = [self.rows, self.columns];
        let mut lines = Vec::with_capacity(2);
        for axis in 0..2 {
            let pitch_m = self.pitch_m.map_or(size[axis] / counts[axis] as f64, |pitch| pitch[axis]);
            self.check_fits(axis, pitch_m, size[axis], wraps && axis == 1)?;
            let closed = wraps && axis == 1;
            lines.push(Lines::new(low[axis], size[axis], counts[axis], pitch_m, self.offset_m[axis], closed));
        }
        let [along, round] = [lines[0], lines[1]];
        Ok(PatchGrid { along, round, gap_m: self.gap_m, body: body.clone() })
    }

    fn check_fits(&self, axis: usize, pitch_m: f64, size_m: f64, closed: bool) -> Result<(), TwinError> {
        let (count_field, count) = [("rows", self.rows), ("columns", self.columns)][axis];
        let taken_m = pitch_m * count as f64;
        let misfit =
            |fix: &str| Err(TwinError::PatchesMisfit { count_field, count, pitch_m, taken_m, size_m, fix: fix.into() });
        if taken_m > size_m * (1.0 + RELATIVE_ROUNDING) {
            return misfit("the patches are larger than the body; take fewer, or leave `pitch_m` out");
        }
        if closed && taken_m < size_m * (1.0 - RELATIVE_ROUNDING) {
            return misfit("a whole number of columns must go round; leave `pitch_m` out");
        }
        let widest = format!("smaller than the pitch of {pitch_m:.5} m");
        let fix = format!("with `{count_field}` = {count} nothing is left of the patches");
        match self.gap_m < pitch_m {
            true => Ok(()),
            false => Err(TwinError::OutOfRange { field: "gap_m", value: self.gap_m, must: widest, fix }),
        }
    }
}

/// The rows or the columns of a grid: intervals of one pitch each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lines {
    /// Start of the first interval, m.
    pub start_m: f64,
    pub pitch_m: f64,
    pub count: usize,
    /// The period of a closed axis.
    pub period_m: Option<f64>,
}

impl Lines {
    fn new(low_m: f64, size_m: f64, count: usize, pitch_m: f64, offset_m: f64, closed: bool) -> Self {
        let covers = (pitch_m * count as f64 - size_m).abs() <= RELATIVE_ROUNDING * size_m;
        if closed {
            return Lines { start_m: low_m + offset_m, pitch_m, count, period_m: Some(size_m) };
        }
        let shift = offset_m.rem_euclid(pitch_m);
        match covers && shift > RELATIVE_ROUNDING * pitch_m {
            // One more line, clipped at both ends.
            true => Lines { start_m: low_m + shift - pitch_m, pitch_m, count: count + 1, period_m: None },
            false if covers => Lines { start_m: low_m, pitch_m, count, period_m: None },
            false => Lines { start_m: low_m + offset_m, pitch_m, count, period_m: None },
        }
    }

    /// The lines that overlap an interval, each with its shift by whole periods, m.
    pub(super) fn lines_between(&self, low_m: f64, high_m: f64) -> impl Iterator<Item = (usize, f64)> + Clone + use<> {
        let Lines { start_m, pitch_m, count, period_m } = *self;
        let line = |value: f64| ((value - start_m) / pitch_m).floor() as i64;
        let (mut first, mut last) = (line(low_m), line(high_m));
        if period_m.is_none() {
            (first, last) = (first.max(0), last.min(count as i64 - 1));
        }
        (first..=last).map(move |line| {
            let inside = line.rem_euclid(count as i64);
            (inside as usize, (line - inside) as f64 * pitch_m)
        })
    }

    /// The part of the fabric in a line, m.
    pub(super) fn fabric(&self, line: usize, gap_m: f64) -> [f64; 2] {
        let start = self.start_m + line as f64 * self.pitch_m;
        [start + 0.5 * gap_m, start + self.pitch_m - 0.5 * gap_m]
    }
}

/// The patches of one body.
///
/// Positions are given in the chart `[around, along]`: (radius * theta, z) on a cylinder, (x, y) on a flat skin.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PatchGrid {
    pub(super) along: Lines,
    pub(super) round: Lines,
    gap_m: f64,
    pub(super) body: Body,
}

impl PatchGrid {
    /// Pitch of the patches [along, around], m.
    pub(crate) fn pitch_m(&self) -> [f64; 2] {
        [self.along.pitch_m, self.round.pitch_m]
    }

    /// Number of patches, including those that are completely clipped by the body's edge.
    pub(crate) fn patch_count(&self) -> usize {
        self.along.count * self.round.count
    }

    /// The patch of a row and column.
    pub(crate) fn patch(&self, row: usize, column: usize) -> usize {
        row * self.round.count + column
    }

    /// Lower and upper corner of a patch in the chart `[around, along]`, m. On a cylinder the upper one may be beyond
    /// the seam.
    pub(crate) fn corners_m(&self, patch: usize) -> [Point2; 2] {
        let along = self.along.fabric(patch / self.round.count, self.gap_m);
        let round = self.round.fabric(patch % self.round.count, self.gap_m);
        [[round[0], along[0]], [round[1], along[1]]]
    }

    /// A point of the skin in the chart, m.
    pub(super) fn chart(&self, point_m: Point3) -> Point2 {
        let [round, along, _] = Unrolled::of(&self.body.surface()).place(point_m);
        [round, along]
    }

    /// The patches that may be within a distance of a position in the chart.
    pub(super) fn patches_near(&self, place: Point2, reach_m: f64) -> Vec<usize> {
        let columns = self.round.lines_between(place[0] - reach_m, place[0] + reach_m);
        let rows = self.along.lines_between(place[1] - reach_m, place[1] + reach_m);
        rows.flat_map(|(row, _)| columns.clone().map(move |(column, _)| (row, column)))
            .map(|(row, column)| self.patch(row, column))
            .collect()
    }

    /// The shorter way from one position of the chart to another.
    pub(super) fn step(&self, from: Point2, to: Point2) -> Point2 {
        let place = |[round, along]: Point2| [round, along, 0.0];
        let [round, along, _] = Unrolled::of(&self.body.surface()).step(place(from), place(to));
        [round, along]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::twin) fn options() -> PatchOptions {
        PatchOptions {
            rows: 30,
            columns: 31,
            gap_m: 0.001,
            offset_m: [0.0; 2],
            pitch_m: None,
            foam: Foam { thickness_m: 0.003, modulus_pa: 2e5 },
            contact: ContactLaw {
                conductance_s_per_m2: 20.0,
                reference_pressure_pa: 1e4,
                exponent: 0.7,
                saturation_s_per_m2: 200.0,
                preload_pa: 0.0,
                hysteresis: 0.0,
            },
        }
    }

    const CYLINDER: Body = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };

    fn middle([low, high]: [Point2; 2]) -> Point2 {
        [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]
    }

    #[test]
    fn patches_of_one_size_cover_a_cylinder_across_seam_and_shift() {
        for offset_m in [[0.0; 2], [0.0037, -0.0021], [-0.25, 1.3]] {
            let grid = PatchOptions { offset_m, ..options() }.on_body(&CYLINDER).unwrap();
            for patch in 0..grid.patch_count() {
                let [low, high] = grid.corners_m(patch);
                assert_eq!(grid.patches_near(middle(grid.corners_m(patch)), 1e-6), [patch]);
                assert!((high[0] - low[0] - (PI * 0.1 / 31.0 - 0.001)).abs() < 1e-12);
                assert!((high[1] - low[1] - 0.009).abs() < 1e-12);
            }
        }
        let grid = options().on_body(&CYLINDER).unwrap();
        assert_eq!(grid.patch_count(), 930);
        assert!((grid.corners_m(0)[0][0] - 0.0005).abs() < 1e-12, "a gap lies at theta = 0");
        assert_eq!(PatchOptions { offset_m: [0.004, 0.0], ..options() }.on_body(&CYLINDER).unwrap().patch_count(), 961);
    }

    #[test]
    fn flat_skins_are_covered_too() {
        let disk = Body::Disk { diameter_m: 0.08 };
        let grid = PatchOptions { rows: 8, columns: 8, ..options() }.on_body(&disk).unwrap();
        let is_at = |grid: &PatchGrid, patch: usize, place: Point2| {
            let centre = middle(grid.corners_m(patch));
            crate::elementary::hypot(centre[0] - place[0], centre[1] - place[1]) < 1e-12
        };
        assert!(is_at(&grid, 0, [-0.035, -0.035]) && is_at(&grid, 7, [0.035, -0.035]));
        let sheet = Body::Rectangle { width_m: 0.2, height_m: 0.1 };
        let some = PatchOptions { rows: 4, columns: 5, pitch_m: Some([0.01, 0.01]), ..options() };
        let grid = PatchOptions { offset_m: [0.02, 0.03], ..some }.on_body(&sheet).unwrap();
        assert!(is_at(&grid, 0, [0.035, 0.025]) && is_at(&grid, 19, [0.075, 0.055]));
    }

    #[test]
    fn impossible_patches_are_refused_with_field_value_and_fix() {
        let good = options();
        let law = good.contact;
        let foam = good.foam;
        let refused = [
            (PatchOptions { rows: 0, ..good.clone() }, "`rows` is 0"),
            (PatchOptions { columns: 5000, ..good.clone() }, "`columns` is 5000"),
            (PatchOptions { gap_m: 0.0102, ..good.clone() }, "`gap_m` is 0.0102: it must be smaller than the pitch"),
            (PatchOptions { gap_m: -0.001, ..good.clone() }, "`gap_m` is -0.001"),
            (PatchOptions { gap_m: f64::NAN, ..good.clone() }, "`gap_m` is NaN"),
            (PatchOptions { offset_m: [f64::INFINITY, 0.0], ..good.clone() }, "`offset_m` is inf"),
            (PatchOptions { pitch_m: Some([0.02, 0.01]), ..good.clone() }, "larger than the body"),
            (PatchOptions { pitch_m: Some([0.01, 0.01]), ..good.clone() }, "a whole number of columns must go round"),
            (PatchOptions { pitch_m: Some([0.0, 0.01]), ..good.clone() }, "`pitch_m` is 0"),
            (PatchOptions { foam: Foam { thickness_m: 0.0, ..foam }, ..good.clone() }, "`thickness_m` is 0"),
            (PatchOptions { foam: Foam { modulus_pa: -1.0, ..foam }, ..good.clone() }, "`modulus_pa` is -1"),
            (PatchOptions { contact: ContactLaw { exponent: 3.0, ..law }, ..good.clone() }, "`exponent` is 3"),
            (PatchOptions { contact: ContactLaw { hysteresis: 1.0, ..law }, ..good.clone() }, "`hysteresis` is 1"),
            (PatchOptions { contact: ContactLaw { preload_pa: -5.0, ..law }, ..good.clone() }, "`preload_pa` is -5"),
            (
                PatchOptions { contact: ContactLaw { conductance_s_per_m2: 0.0, ..law }, ..good.clone() },
                "`conductance_s_per_m2` is 0",
            ),
        ];
        for (options, expected) in refused {
            let message = options.on_body(&CYLINDER).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        let mesh = Body::Mesh { path: "arm.stl".into(), unit_m: 1.0 };
        assert_eq!(good.on_body(&mesh).unwrap_err(), TwinError::NoChart);
    }

    #[test]
    fn options_are_read_from_toml_and_unknown_fields_are_refused() {
        let text = toml::to_string(&options()).unwrap();
        assert_eq!(toml::from_str::<PatchOptions>(&text).unwrap(), options());
        let error = toml::from_str::<PatchOptions>(&format!("gap_mm = 1.0\n{text}")).unwrap_err();
        assert!(error.to_string().contains("gap_mm"), "{error}");
    }
}
