//! Images of presses on patches.
//!
//! A press does not change the coating but lets current pass through the fabric. The effect on a strip of the coating
//! of the same length `p` as a patch, connected to it by a conductance `c` per area, is known exactly: with `s` the
//! coating's sheet conductance the strip conducts as if its conductance were `s k / tanh k`, `k = (p / 2) sqrt(c / s)`
//! (a transmission line that floats at its middle; for a weak contact `s + c p^2 / 12`). The image is the pixel mean of
//! this relative change, `k / tanh k - 1`, for the contact that the pressure would make without gaps. It shows the
//! position of a press and not the patches under it, because the positions of the patches are unknown in use.

use crate::dataset::quadrature::Rule;
use crate::elementary::{Chart, Lanes, exp_lanes, replace_in_lanes, unrolled};
use crate::twin::{ContactLaw, Footprint, PatchOptions, TwinError};
use dermis::design::{Body, ImageLayout, SkinDesign};
use dermis::geom::{self, Point3};
use dermis::image::PixelSpace;
use dermis::mesh::{Cells, Mesh};

/// Points along each side of a pixel: midpoints of equal parts.
const POINTS_PER_SIDE: usize = 6;

/// How the image of some presses is made.
#[derive(Debug, Clone)]
pub(super) struct PressTarget {
    chart: Chart,
    contact: ContactLaw,
    /// Half of a patch's side over the square root of the coating's conductance: `k / sqrt(c)`.
    half_side: f64,
    /// The change without a press.
    at_rest: f64,
    pixels: Vec<Pixel>,
}

/// The points for a pixel's mean, with equal weights.
#[derive(Debug, Clone)]
struct Pixel {
    centre: Point3,
    radius_m: f64,
    area_m2: f64,
    points: Vec<Point3>,
}

impl PressTarget {
    pub(super) fn new(
        design: &SkinDesign,
        mesh: &Mesh,
        space: &PixelSpace,
        patches: &PatchOptions,
    ) -> Result<Self, TwinError> {
        let chart = unrolled(&design.body.surface());
        let pixels = match (&design.image, &mesh.cells, design.body.chart()) {
            (&ImageLayout::Grid { rows, columns }, _, Some(body)) => grid_pixels(&body, space, [rows, columns]),
            (_, Cells::Triangles(_), _) => cell_pixels(&chart, mesh),
            _ => return Err(TwinError::NoChart),
        };
        let mut target = PressTarget {
            chart,
            contact: patches.contact,
            half_side: 0.5 * (mean_side_m(patches, &design.body)?.powi(2) / design.sheet.conductance).sqrt(),
            at_rest: 0.0,
            pixels: Vec::new(),
        };
        let mut at_rest = [patches.contact.preload_pa];
        target.replace_by_changes(&mut at_rest);
        target.at_rest = at_rest[0];
        let pixel = |(points, &area_m2): (Vec<Point3>, &f64)| {
            let centre = points[points.len() / 2];
            let radius_m = points.iter().map(|&point| target.distance_m(centre, point)).fold(0.0, f64::max);
            Pixel { centre, radius_m, area_m2, points }
        };
        target.pixels = pixels.into_iter().zip(&space.areas).map(pixel).collect();
        Ok(target)
    }

    fn distance_m(&self, a: Point3, b: Point3) -> f64 {
        self.chart.squared_distance_m2(a, b).sqrt()
    }

    /// The image of some presses together, and the strength of each alone: the integral of its own image, m2.
    pub(super) fn image_into(&self, footprints: &[Footprint], image: &mut [f64], strengths_m2: &mut [f64]) {
        let presses: Vec<(Point3, &Footprint)> =
            footprints.iter().map(|footprint| (self.chart.unroll_in_space(footprint.centre_m()), footprint)).collect();
        strengths_m2.fill(0.0);
        let (mut near, mut memory) = (Vec::with_capacity(presses.len()), [Vec::new(), Vec::new()]);
        for (value, pixel) in image.iter_mut().zip(&self.pixels) {
            let reaches = |&(_, (centre, footprint)): &(usize, (Point3, &Footprint))| {
                let bound_m = pixel.radius_m + footprint.reach_m();
                // A coordinate first, which is less work.
                (pixel.centre[1] - centre[1]).abs() < bound_m && self.distance_m(pixel.centre, centre) < bound_m
            };
            near.clear();
            near.extend(presses.iter().copied().enumerate().filter(reaches));
            *value = self.mean_change(pixel, &near, &mut memory);
            for only in &near {
                let own = match near.len() {
                    1 => *value,
                    _ => self.mean_change(pixel, std::slice::from_ref(only), &mut memory),
                };
                strengths_m2[only.0] += own * pixel.area_m2;
            }
        }
    }

    /// The mean over a pixel of the change by some presses.
    fn mean_change(
        &self,
        pixel: &Pixel,
        presses: &[(usize, (Point3, &Footprint))],
        [values, own]: &mut [Vec<f64>; 2],
    ) -> f64 {
        if presses.is_empty() {
            return 0.0;
        }
        values.clear();
        values.resize(pixel.points.len(), 0.0);
        for (_, (centre, footprint)) in presses {
            let distances_m = pixel.points.iter().map(|&point| self.distance_m(point, *centre));
            footprint.add_pressures(distances_m, own, values);
        }
        values.iter_mut().for_each(|sum| *sum += self.contact.preload_pa);
        self.replace_by_changes(values);
        values.iter().sum::<f64>() / values.len() as f64 - self.at_rest
    }

    /// Replaces pressures, Pa, by the relative changes of conductance under them.
    fn replace_by_changes(&self, values: &mut [f64]) {
        self.contact.replace_by_conductances(values);
        replace_in_lanes(values, |conductances| rises(self.half_side, conductances));
    }
}

/// Below this value of `k` the first six terms of the series have a relative error of `(k / pi)^12`, 6e-13.
const SERIES_BELOW: f64 = 0.3;

/// `k coth k - 1` with `k = half_side sqrt(c)`.
#[inline(always)]
fn rises(half_side: f64, conductances: &Lanes) -> Lanes {
    let (mut k, mut twice) = ([0.0; 8], [0.0; 8]);
    for lane in 0..8 {
        k[lane] = half_side * conductances[lane].sqrt();
        twice[lane] = 2.0 * k[lane];
    }
    let exponentials = exp_lanes(&twice);
    let mut rises = [0.0; 8];
    for lane in 0..8 {
        let (k, z, e) = (k[lane], k[lane] * k[lane], exponentials[lane]);
        let mut series = -1382.0 / 638_512_875.0;
        for factor in [2.0 / 93_555.0, -1.0 / 4725.0, 2.0 / 945.0, -1.0 / 45.0, 1.0 / 3.0] {
            series = series * z + factor;
        }
        // At 0 the quotient is not a number, and not used.
        let whole = k * ((e + 1.0) / (e - 1.0)) - 1.0;
        rises[lane] = if k < SERIES_BELOW { series * z } else { whole };
    }
    rises
}

/// The root mean square of a patch's sides, m.
fn mean_side_m(patches: &PatchOptions, body: &Body) -> Result<f64, TwinError> {
    let grid = patches.on_body(body)?;
    let [low, high] = grid.corners_m(0);
    Ok((0.5 * ((high[0] - low[0]).powi(2) + (high[1] - low[1]).powi(2))).sqrt())
}

fn grid_pixels(body: &geom::Chart, space: &PixelSpace, [rows, columns]: [usize; 2]) -> Vec<Vec<Point3>> {
    let ([low, _], size) = (body.bounds_m(), body.size_m());
    let middle = |line: usize, part: usize, count: usize| {
        (line as f64 + (part as f64 + 0.5) / POINTS_PER_SIDE as f64) / count as f64
    };
    let pixel = |&position: &usize| {
        let point = |part: usize| {
            let across = middle(position % columns, part % POINTS_PER_SIDE, columns);
            let along = middle(position / columns, part / POINTS_PER_SIDE, rows);
            [low[0] + size[0] * across, low[1] + size[1] * along, 0.0]
        };
        let inside = |&[x, y, _]: &Point3| body.depth_m([x, y]) >= 0.0;
        let points: Vec<Point3> = (0..POINTS_PER_SIDE * POINTS_PER_SIDE).map(point).filter(inside).collect();
        // A narrow part of a pixel at the rim that contains none of the points.
        if points.is_empty() {
            let index = space.position_in_grid.iter().position(|&other| other == position);
            return vec![index.map_or([0.0; 3], |index| space.centres_m[index])];
        }
        points
    };
    space.position_in_grid.iter().map(pixel).collect()
}

fn cell_pixels(chart: &Chart, mesh: &Mesh) -> Vec<Vec<Point3>> {
    let points = |cell: usize| {
        let corners: Vec<Point3> = mesh.cells.corners(cell).iter().map(|&node| mesh.nodes[node]).collect();
        // The midpoints of 16 equal parts, with equal weights.
        let points = Rule::Triangle.points(&corners, 2);
        points.chunks_exact(Rule::Triangle.weights().len()).map(|part| chart.unroll_in_space(part[0])).collect()
    };
    (0..mesh.cell_count()).map(points).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::PatchTouches;
    use crate::twin::Press;

    fn target() -> PressTarget {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let space = PixelSpace::for_design(&design, &mesh).unwrap();
        PressTarget::new(&design, &mesh, &space, &PatchTouches::usual().patches).unwrap()
    }

    #[test]
    fn the_change_is_that_of_a_strip_joined_to_a_floating_patch() {
        // The strip as 4,000 resistors in a row, each connected to the patch; its ends are at +-1/2 V, the patch at 0.
        let target = target();
        let (side_m, sheet_s) = (2.0 * target.half_side * 1e-3f64.sqrt(), 1e-3);
        let change_at = |pressure_pa: f64| {
            let mut values = [pressure_pa];
            target.replace_by_changes(&mut values);
            values[0]
        };
        for pressure_pa in [3.0, 300.0, 3e4] {
            let contact = target.contact.conductance_s_per_m2(pressure_pa);
            let parts = 4000;
            let (step, joint) = (sheet_s * parts as f64 / side_m, contact * side_m / parts as f64);
            // From the middle outwards: the current and the potential of one half; the potential is odd about the
            // middle.
            let (mut potential, mut current) = (0.5 / step, 1.0);
            for _ in 0..parts / 2 {
                current += joint * potential;
                potential += current / step;
            }
            potential -= 0.5 * current / step;
            let change = current / (2.0 * potential) * side_m / sheet_s - 1.0;
            println!("{pressure_pa} Pa: {:.5}, by resistors {change:.5}", change_at(pressure_pa));
            assert!((change_at(pressure_pa) / change - 1.0).abs() < 5e-3);
        }
        // The series and the exponential meet, and a contact of none has no effect.
        for k in [1e-9, 1e-3, 0.1, SERIES_BELOW * (1.0 - 1e-12), SERIES_BELOW, 1.0, 7.0] {
            let [rise, ..] = rises(1.0, &[k * k; 8]);
            let exact = if k < 0.01 { k * k / 3.0 - k.powi(4) / 45.0 } else { k / libm::tanh(k) - 1.0 };
            assert!((rise / exact - 1.0).abs() < 1e-10, "{k}: {rise}, {exact}");
        }
        assert_eq!(rises(1.0, &[0.0; 8]), [0.0; 8]);
    }

    #[test]
    fn an_image_peaks_under_its_press_and_wraps_at_the_seam() {
        let target = target();
        let surface = SkinDesign::shipped("cylinder30").unwrap().body.surface();
        let (body, foam) = (SkinDesign::shipped("cylinder30").unwrap().body, PatchTouches::usual().patches.foam);
        let (mut image, mut strengths) = (vec![0.0; 900], [0.0; 2]);
        let press = |theta_rad: f64| Press {
            centre_m: surface.at(0.145, theta_rad).unwrap(),
            force_n: 2.0,
            tip_radius_m: 0.005,
        };
        let one = Footprint::new(&press(0.0), &foam, &body).unwrap();
        target.image_into(std::slice::from_ref(&one), &mut image, &mut strengths[..1]);
        let row = &image[14 * 30..15 * 30];
        assert!(row[0] > 0.1 && (row[0] / row[29] - 1.0).abs() < 1e-9, "{row:?}");
        assert!(image.iter().filter(|value| **value > 0.0).count() < 20);
        let integral: f64 = image.iter().zip(&target.pixels).map(|(value, pixel)| value * pixel.area_m2).sum();
        assert!((strengths[0] / integral - 1.0).abs() < 1e-12);
        // Two presses at one position have the effect of the sum of their pressures, and each its own strength.
        let mut both = vec![0.0; 900];
        target.image_into(&[one.clone(), one], &mut both, &mut strengths);
        assert!(both[420] > image[420] && both[420] < 2.0 * image[420]);
        assert_eq!(strengths[0], strengths[1]);
        assert!((strengths[0] / integral - 1.0).abs() < 1e-12);
    }
}
