//! The grid of fabric patches on a body.

use super::contact_law::ContactLaw;
use super::error::{check_between, check_positive};
use super::patch_shape::{self, PatchLattice, PatchShape, is_default};
use super::{Foam, TwinError};
use crate::elementary::{Chart, unrolled};
use dermis::design::Body;
use dermis::geom::{Point2, polygon};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of rows or columns: larger numbers are probably typing errors.
const MAX_LINES: usize = 1000;
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
    /// Shape of the patches.
    #[serde(default, skip_serializing_if = "is_default")]
    pub shape: PatchShape,
    /// Arrangement of the patches.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lattice: PatchLattice,
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
        check_between("rows", self.rows as f64, [1.0, MAX_LINES as f64], "the paper's skin has about 30")?;
        check_between("columns", self.columns as f64, [1.0, MAX_LINES as f64], "the paper's skin has about 30")?;
        check_between("gap_m", self.gap_m, [0.0, 1.0], "patches must not overlap; 0.001 is usual")?;
        for offset in self.offset_m {
            check_between("offset_m", offset, [-10.0, 10.0], "0 lays the first patch at the body's edge")?;
        }
        for pitch in self.pitch_m.into_iter().flatten() {
            check_positive("pitch_m", pitch, "leave it out to cover the body")?;
            check_between("pitch_m", pitch, [1e-5, 10.0], "leave it out to cover the body")?;
        }
        self.foam.check()?;
        self.contact.check()
    }

    /// The first field with a physics that is kept for the measurement of networks, so that no training may use it:
    /// another shape, lattice or indentation than those of the twin `lab`.
    pub(crate) fn kept_for_evaluation(&self) -> Option<&'static str> {
        let fields = [
            ("shape", is_default(&self.shape)),
            ("lattice", is_default(&self.lattice)),
            ("foam.indentation", is_default(&self.foam.indentation)),
        ];
        fields.into_iter().find(|(_, usual)| !usual).map(|(field, _)| field)
    }

    /// The grid on a body.
    ///
    /// # Errors
    /// As [`check`](Self::check); patches that are larger than the body, a gap that leaves nothing of them, columns
    /// that do not close around a cylinder, a body known only by its mesh.
    pub(crate) fn on_body(&self, body: &Body) -> Result<PatchGrid, TwinError> {
        self.check()?;
        let chart = body.chart().ok_or(TwinError::NoChart)?;
        let ([mut low, _], mut size, wraps) = (chart.bounds_m(), chart.size_m(), chart.period_m().is_some());
        // Rows are along the second axis of the chart.
        low.reverse();
        size.reverse();
        let counts = [self.rows, self.columns];
        let mut lines = Vec::with_capacity(2);
        for axis in 0..2 {
            let pitch_m = self.pitch_m.map_or(size[axis] / counts[axis] as f64, |pitch| pitch[axis]);
            self.check_fits(axis, pitch_m, size[axis], wraps && axis == 1)?;
            let closed = wraps && axis == 1;
            lines.push(Lines::new(low[axis], size[axis], counts[axis], pitch_m, self.offset_m[axis], closed));
        }
        self.grid([lines[0], lines[1]], body)
    }

    fn grid(&self, [along, mut round]: [Lines; 2], body: &Body) -> Result<PatchGrid, TwinError> {
        let pitch_m = [along.pitch_m, round.pitch_m];
        let widest_m = self.shape.widest_m(self.lattice, pitch_m);
        if self.shape != PatchShape::Square && self.gap_m >= widest_m {
            let must = format!("smaller than {widest_m:.5} m, at which neighbours without a gap touch");
            let fix = "take fewer rows or columns".into();
            return Err(TwinError::OutOfRange { field: "gap_m", value: self.gap_m, must, fix });
        }
        if self.lattice == PatchLattice::Staggered && round.covers && round.period_m.is_none() {
            // The shifted rows begin half a pitch before the others.
            round.count += 1;
        }
        let corners_m = self.shape.corners_m(self.lattice, pitch_m, self.gap_m);
        let beyond = |axis: usize, pitch_m: f64| {
            let most = corners_m.iter().flatten().map(|corner| corner[axis]).fold(0.0, f64::max);
            (most - 0.5 * pitch_m).max(0.0)
        };
        let overhang_m = [beyond(0, round.pitch_m), beyond(1, along.pitch_m)];
        let (gap_m, lattice) = (self.gap_m, self.lattice);
        let chart = unrolled(&body.surface());
        Ok(PatchGrid { along, round, lattice, gap_m, corners_m, overhang_m, body: body.clone(), chart })
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
    /// Whether the lines cover the body.
    covers: bool,
    /// Number of the first line in an endless lattice that moves with the offset: even lines stay even.
    first: i64,
}

impl Lines {
    fn new(low_m: f64, size_m: f64, count: usize, pitch_m: f64, offset_m: f64, closed: bool) -> Self {
        let covers = (pitch_m * count as f64 - size_m).abs() <= RELATIVE_ROUNDING * size_m;
        let fixed = Lines { start_m: low_m + offset_m, pitch_m, count, period_m: None, covers, first: 0 };
        if closed {
            return Lines { period_m: Some(size_m), ..fixed };
        }
        let shift = offset_m.rem_euclid(pitch_m);
        let first = -((offset_m - shift) / pitch_m).round() as i64;
        match covers && shift > RELATIVE_ROUNDING * pitch_m {
            // One more line, clipped at both ends.
            true => Lines { start_m: low_m + shift - pitch_m, count: count + 1, first: first - 1, ..fixed },
            false if covers => Lines { start_m: low_m, first, ..fixed },
            false => fixed,
        }
    }

    /// The lines that overlap an interval, each with its shift by whole periods, m.
    fn lines_between(&self, low_m: f64, high_m: f64) -> impl Iterator<Item = (usize, f64)> + use<> {
        let Lines { start_m, pitch_m, count, period_m, .. } = *self;
        let line = |value: f64| floor((value - start_m) / pitch_m);
        let (mut first, mut last) = (line(low_m), line(high_m));
        if period_m.is_none() {
            (first, last) = (first.max(0), last.min(count as i64 - 1));
        }
        (first..=last).map(move |line| {
            let inside = if (0..count as i64).contains(&line) { line } else { line.rem_euclid(count as i64) };
            (inside as usize, (line - inside) as f64 * pitch_m)
        })
    }

    /// The part of the fabric in a line, m.
    fn fabric(&self, line: usize, gap_m: f64) -> [f64; 2] {
        let start = self.start_m + line as f64 * self.pitch_m;
        [start + 0.5 * gap_m, start + self.pitch_m - 0.5 * gap_m]
    }
}

/// The largest integer that is not above a number: that of the standard library is a call without SSE 4.1.
fn floor(value: f64) -> i64 {
    let truncated = value as i64;
    truncated - i64::from(value < truncated as f64)
}

/// The patches of one body.
///
/// Positions are given in the chart `[around, along]`: (radius * theta, z) on a cylinder, (x, y) on a flat skin.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PatchGrid {
    along: Lines,
    round: Lines,
    lattice: PatchLattice,
    gap_m: f64,
    /// The corners of a patch relative to the middle of its cell of the lattice, m; `None` for a rectangle in the cell.
    corners_m: Option<Vec<Point2>>,
    /// How far a patch extends beyond its cell [around, along], m.
    overhang_m: Point2,
    pub(super) body: Body,
    pub(super) chart: Chart,
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

    /// The columns of a row: in a staggered lattice those of every other row are shifted by half a pitch.
    fn columns(&self, row: usize) -> Lines {
        let is_shifted = self.lattice == PatchLattice::Staggered && (self.along.first + row as i64).rem_euclid(2) == 1;
        let shift_m = if is_shifted { 0.5 * self.round.pitch_m } else { 0.0 };
        Lines { start_m: self.round.start_m - shift_m, ..self.round }
    }

    /// Lower and upper corner of a patch's cell of the lattice, less the gap, in the chart `[around, along]`, m. On a
    /// cylinder the upper one may be beyond the seam.
    pub(crate) fn corners_m(&self, patch: usize) -> [Point2; 2] {
        let (row, column) = (patch / self.round.count, patch % self.round.count);
        let along = self.along.fabric(row, self.gap_m);
        let round = self.columns(row).fabric(column, self.gap_m);
        [[round[0], along[0]], [round[1], along[1]]]
    }

    fn middle_m(&self, patch: usize) -> Point2 {
        let [low, high] = self.corners_m(patch);
        [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]
    }

    /// Area of a patch that is not clipped, m2.
    pub(super) fn area_m2(&self, patch: usize) -> f64 {
        let [low, high] = self.corners_m(patch);
        self.corners_m.as_ref().map_or((high[0] - low[0]) * (high[1] - low[1]), |corners| polygon::signed_area(corners))
    }

    /// Points of a patch that is not clipped with their areas, m2; `None` for a rectangle.
    pub(super) fn points(&self, patch: usize) -> Option<Vec<(Point2, f64)>> {
        let middle = self.middle_m(patch);
        let moved = |(point, area): (Point2, f64)| ([middle[0] + point[0], middle[1] + point[1]], area);
        Some(patch_shape::points(self.corners_m.as_ref()?).into_iter().map(moved).collect())
    }

    /// Lower and upper corner of the box around a patch that is not clipped, in the chart, m.
    pub(super) fn bounds_m(&self, patch: usize) -> [Point2; 2] {
        let [low, high] = self.corners_m(patch);
        let [round_m, along_m] = self.overhang_m;
        [[low[0] - round_m, low[1] - along_m], [high[0] + round_m, high[1] + along_m]]
    }

    /// The part of a triangle of the chart below a patch, in the first list of the caller's memory.
    pub(super) fn clip_in(&self, patch: usize, triangle: &[Point2; 3], memory: &mut [Vec<Point2>; 2]) {
        let [low, high] = self.corners_m(patch);
        match &self.corners_m {
            None => polygon::clip_box_in(triangle, low, high, memory),
            Some(corners) => memory[0] = patch_shape::clip(triangle, self.middle_m(patch), corners),
        }
    }

    /// Visits the patches that may overlap a box of the chart, each with its shift by whole periods, m.
    ///
    /// Two loops, not a nested iterator: samples with small patches take 4 % less time.
    #[inline]
    pub(super) fn visit_between(&self, low: Point2, high: Point2, mut visit: impl FnMut(usize, f64)) {
        let [round_m, along_m] = self.overhang_m;
        for (row, _) in self.along.lines_between(low[1] - along_m, high[1] + along_m) {
            for (column, shift_m) in self.columns(row).lines_between(low[0] - round_m, high[0] + round_m) {
                visit(self.patch(row, column), shift_m);
            }
        }
    }

    /// The patches that may be within a distance of a position in the chart.
    pub(super) fn patches_near(&self, [round, along]: Point2, reach_m: f64) -> Vec<usize> {
        let (low, high) = ([round - reach_m, along - reach_m], [round + reach_m, along + reach_m]);
        let mut patches = Vec::new();
        self.visit_between(low, high, |patch, _| patches.push(patch));
        patches
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::Indentation;
    use super::*;
    use std::f64::consts::PI;

    pub(in crate::twin) fn options() -> PatchOptions {
        PatchOptions {
            rows: 30,
            columns: 31,
            gap_m: 0.001,
            shape: PatchShape::Square,
            lattice: PatchLattice::Rectangular,
            offset_m: [0.0; 2],
            pitch_m: None,
            foam: Foam { thickness_m: 0.003, modulus_pa: 2e5, indentation: Indentation::Foundation },
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

    /// Every point of every body lies in exactly one cell of a lattice that covers the body, wherever it is shifted.
    #[test]
    fn staggered_rows_cover_a_body_once() {
        let bodies = [CYLINDER, Body::Rectangle { width_m: 0.2, height_m: 0.1 }, Body::Disk { diameter_m: 0.15 }];
        for (body, (low, size)) in bodies.iter().zip([
            ([-0.05 * PI, 0.0], [0.1 * PI, 0.3]),
            ([0.0, 0.0], [0.2, 0.1]),
            ([-0.075, -0.075], [0.15, 0.15]),
        ]) {
            for offset_m in [[0.0; 2], [0.0037, -0.0021], [-0.25, 1.3], [0.0999, 0.0051]] {
                let lattice = PatchLattice::Staggered;
                let options = PatchOptions { offset_m, lattice, gap_m: 0.0, rows: 10, columns: 11, ..options() };
                let grid = options.on_body(body).unwrap();
                for k in 0..500 {
                    let share = [(k as f64 * 0.754_877_67).fract(), (k as f64 * 0.569_840_29).fract()];
                    let point = [low[0] + share[0] * size[0], low[1] + share[1] * size[1]];
                    let mut holding = 0;
                    grid.visit_between(point, point, |patch, shift_m| {
                        let [low, high] = grid.corners_m(patch);
                        let inside = (low[0]..high[0]).contains(&(point[0] - shift_m));
                        holding += usize::from(inside && (low[1]..high[1]).contains(&point[1]));
                    });
                    assert_eq!(holding, 1, "{body:?} {point:?}");
                }
            }
        }
    }

    /// An offset moves all patches of a staggered lattice by as much, also beyond a pitch.
    #[test]
    fn a_staggered_lattice_moves_with_its_offset() {
        let sheet = Body::Rectangle { width_m: 0.2, height_m: 0.1 };
        let staggered = PatchOptions { lattice: PatchLattice::Staggered, rows: 10, columns: 20, ..options() };
        let at = |along_m: f64| PatchOptions { offset_m: [along_m, 0.0], ..staggered.clone() }.on_body(&sheet).unwrap();
        for along_m in [0.004, 0.013, -0.008, 0.01, 0.02] {
            let (fixed, moved) = (at(0.0), at(along_m));
            let patch = fixed.patches_near([0.1, 0.052], 0.0)[0];
            let [round, along] = fixed.middle_m(patch);
            let found = moved.patches_near([round, along + along_m], 0.0)[0];
            let middle = moved.middle_m(found);
            assert!((middle[0] - round).abs() < 1e-12 && (middle[1] - along - along_m).abs() < 1e-12, "{along_m}");
        }
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
            (
                PatchOptions { gap_m: 0.009, shape: PatchShape::Hexagonal, ..good.clone() },
                "`gap_m` is 0.009: it must be smaller than 0.00866",
            ),
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
        let mesh = Body::Mesh { file: "arm.stl".into(), unit_m: 1.0 };
        assert_eq!(good.on_body(&mesh).unwrap_err(), TwinError::NoChart);
    }

    #[test]
    fn options_are_read_from_toml_and_unknown_fields_are_refused() {
        let text = toml::to_string(&options()).unwrap();
        assert_eq!(toml::from_str::<PatchOptions>(&text).unwrap(), options());
        assert!(!text.contains("shape") && !text.contains("lattice") && !text.contains("indentation"), "{text}");
        let round = format!("shape = \"round\"\nlattice = \"staggered\"\n{text}");
        let round = round.replace("[foam]", "[foam]\nindentation = \"half_space\"");
        let round: PatchOptions = toml::from_str(&round).unwrap();
        let other = (round.shape, round.lattice, round.foam.indentation);
        assert_eq!(other, (PatchShape::Round, PatchLattice::Staggered, Indentation::HalfSpace));
        assert_eq!(toml::from_str::<PatchOptions>(&toml::to_string(&round).unwrap()).unwrap(), round);
        let error = toml::from_str::<PatchOptions>(&format!("gap_mm = 1.0\n{text}")).unwrap_err();
        assert!(error.to_string().contains("gap_mm"), "{error}");
    }
}
