//! A continuous piezoresistive layer: a coating that conducts better where it is pressed.

use super::error::{check_between, check_positive};
use super::load::Load;
use super::press::{Footprint, Press};
use super::{Foam, TwinError};
use crate::elementary::unrolled;
use crate::quadrature::LocalFunction;
use dermis::design::Body;
use dermis::geom::Point3;
use dermis::geom::vector::{distance, longest_edge};
use dermis::mesh::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Longest edge of a triangle and of a tetrahedron over the foam's thickness, the scale of the pressure: with 1/2 the
/// mean over a triangle is correct to 1e-5 of the highest value.
const LONGEST_EDGE_THICKNESSES: [f64; 2] = [0.5, 0.25];

/// A coating without patches, whose own sheet conductance rises with the pressure below the foam.
///
/// `s(p) = s_rest (1 + r(p))` with `r(p) = r_max p / (p + p_half)`: proportional to a low pressure, as the number of
/// conducting paths through a filled polymer or a fabric of conductive fibres is, and bounded, since the paths are
/// finite in number. The form is the simplest with these two limits; an assumption without a source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerOptions {
    /// `r_max`: relative rise of conductance that no pressure exceeds.
    pub greatest_rise: f64,
    /// `p_half`: pressure at which half of it is reached, Pa.
    pub half_pressure_pa: f64,
    /// The foam between a tip and the layer.
    pub foam: Foam,
}

impl LayerOptions {
    /// The relative rise of conductance at a pressure.
    pub fn rise(&self, pressure_pa: f64) -> f64 {
        self.greatest_rise * (pressure_pa / (pressure_pa + self.half_pressure_pa))
    }

    /// # Errors
    /// Invalid values.
    pub(super) fn check(&self) -> Result<(), TwinError> {
        check_positive("greatest_rise", self.greatest_rise, "1 doubles the conductance at most")?;
        check_between("greatest_rise", self.greatest_rise, [1e-6, 1e6], "1 doubles the conductance at most")?;
        check_positive("half_pressure_pa", self.half_pressure_pa, "10000 is the pressure of a finger")?;
        check_between("half_pressure_pa", self.half_pressure_pa, [1e-3, 1e12], "10000 is the pressure of a finger")?;
        self.foam.check()
    }

    /// The conductance of each cell during some presses, S: the mean of `s(p)` over the cell.
    ///
    /// # Errors
    /// Presses that are invalid for the body and the foam.
    pub(super) fn conductivity(
        &self,
        presses: &[Press],
        body: &Body,
        mesh: &Mesh,
        rest: &[f64],
    ) -> Result<Vec<f64>, TwinError> {
        let mut rises = vec![0.0; rest.len()];
        let footprints = Footprint::of_all(presses, &self.foam, body)?;
        let chart = unrolled(&body.surface());
        let load = Load::new(&footprints, chart, 0.0);
        let rise = LocalFunction {
            // A distance in space is at most the distance along the surface.
            reaches: |corners: &[Point3]| {
                let size_m = longest_edge(corners);
                footprints.iter().any(|press| distance(corners[0], press.centre_m()) <= press.reach_m() + size_m)
            },
            value: |point_m| self.rise(load.pressure_pa(chart.unroll(point_m))),
            longest_edge_m: LONGEST_EDGE_THICKNESSES.map(|thicknesses| thicknesses * self.foam.thickness_m),
        };
        rise.add_cell_means(mesh, &mut rises);
        Ok(rest.iter().zip(rises).map(|(rest, rise)| rest * (1.0 + rise)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Indentation;
    use super::*;
    use crate::quadrature::gauss_legendre;
    use dermis::design::SkinDesign;
    use dermis::forward::ForwardModel;
    use dermis::geom::vector::{dot, sub};
    use std::f64::consts::{PI, TAU};

    const LAYER: LayerOptions = LayerOptions {
        greatest_rise: 3.0,
        half_pressure_pa: 2e4,
        foam: Foam { thickness_m: 0.003, modulus_pa: 2e5, indentation: Indentation::Foundation },
    };

    fn skin() -> (SkinDesign, ForwardModel) {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let forward = ForwardModel::new(&design, &mesh).unwrap();
        (design, forward)
    }

    fn press(z_m: f64, theta_rad: f64, force_n: f64) -> Press {
        Press { centre_m: [0.05 * theta_rad.cos(), 0.05 * theta_rad.sin(), z_m], force_n, tip_radius_m: 0.005 }
    }

    fn touched(layer: &LayerOptions, (design, forward): &(SkinDesign, ForwardModel), presses: &[Press]) -> Vec<f64> {
        layer.conductivity(presses, &design.body, forward.mesh(), forward.rest_conductivity()).unwrap()
    }

    /// The relative rise integrated over the surface, m2.
    fn strength_m2(layer: &LayerOptions, skin: &(SkinDesign, ForwardModel), presses: &[Press]) -> f64 {
        let (mesh, rest) = (skin.1.mesh(), skin.1.rest_conductivity());
        let rises = touched(layer, skin, presses).into_iter().zip(rest).map(|(touched, rest)| touched / rest - 1.0);
        rises.enumerate().map(|(cell, rise)| rise * mesh.cell_measure(cell)).sum()
    }

    fn norm(values: impl Iterator<Item = f64>) -> f64 {
        values.map(|value| value * value).sum::<f64>().sqrt()
    }

    #[test]
    fn the_law_is_linear_for_low_pressures_and_bounded() {
        assert_eq!((LAYER.rise(0.0), LAYER.rise(2e4)), (0.0, 1.5));
        let slope = LAYER.rise(1e-3) / 1e-3;
        assert!((slope / (3.0 / 2e4) - 1.0).abs() < 1e-7);
        assert!(LAYER.rise(1e12) < 3.0 && LAYER.rise(1e12) > 2.999_999);
    }

    /// The integral of the rise over the surface equals that over the plane by a fine rule in polar coordinates; what is
    /// left is the mesh, whose flat triangles are a little smaller than the surface.
    #[test]
    fn the_rise_of_the_cells_integrates_to_that_of_the_surface() {
        let skin = skin();
        for (z_m, theta_rad, force_n) in [(0.15, 0.0, 2.0), (0.1437, 2.0, 0.2), (0.081, 4.4, 5.0)] {
            let press = press(z_m, theta_rad, force_n);
            let footprints = [Footprint::new(&press, &LAYER.foam, &skin.0.body).unwrap()];
            let load = Load::new(&footprints, unrolled(&skin.0.body.surface()), 0.0);
            let (centre, reach_m) = load.reaches_m().next().unwrap();
            let panels = 200;
            let width = reach_m / f64::from(panels);
            let ring = |r: f64| TAU * r * LAYER.rise(load.pressure_pa([centre[0], centre[1] + r]));
            let exact: f64 = (0..panels)
                .flat_map(|panel| gauss_legendre(3).into_iter().map(move |(t, w)| (panel, t, w)))
                .map(|(panel, t, w)| 0.5 * w * width * ring((f64::from(panel) + 0.5 * (1.0 + t)) * width))
                .sum();
            let error = strength_m2(&LAYER, &skin, &[press]) / exact - 1.0;
            println!("{force_n} N: strength {:.2} mm2, relative error {error:.1e}", exact * 1e6);
            assert!(error.abs() < 2e-3, "{error}");
        }
    }

    /// The mean over a triangle of the longest edge that is not split, anywhere in a footprint.
    #[test]
    fn cells_are_fine_enough_for_the_foam() {
        let press = press(0.15, 0.0, 2.0);
        let body = SkinDesign::shipped("cylinder30").unwrap().body;
        let footprints = [Footprint::new(&press, &LAYER.foam, &body).unwrap()];
        let load = Load::new(&footprints, unrolled(&body.surface()), 0.0);
        let value = |point: Point3| LAYER.rise(load.pressure_pa([point[0], point[1] + 0.15]));
        let of_edge =
            |longest_m: f64| LocalFunction { reaches: |_: &[Point3]| true, value, longest_edge_m: [longest_m; 2] };
        let edge_m = LONGEST_EDGE_THICKNESSES[0] * LAYER.foam.thickness_m;
        let error = |k: usize| {
            let [x, y] = [0.4e-3 * (k % 20) as f64, 0.4e-3 * (k / 20) as f64];
            let corners = [[x, y, 0.0], [x + edge_m, y, 0.0], [x + 0.5 * edge_m, y + 0.86 * edge_m, 0.0]];
            of_edge(1.001 * edge_m).triangle_mean(corners) - of_edge(0.07 * edge_m).triangle_mean(corners)
        };
        let worst = (0..400).map(|k| error(k).abs()).fold(0.0, f64::max) / value([0.0; 3]);
        println!("largest error of a triangle's mean: {worst:.1e} of the highest rise");
        assert!(worst < 1e-5, "{worst}");
    }

    /// The pressure integrates to the force, so a weak press of `F` has the strength `F r_max / p_half`, in the middle
    /// and at a rim.
    #[test]
    fn a_weak_press_has_the_strength_of_its_force() {
        let skin = skin();
        for (z_m, theta_rad) in [(0.15, 0.0), (0.298, 2.0)] {
            let per_newton = |force_n: f64| {
                let strength = strength_m2(&LAYER, &skin, &[press(z_m, theta_rad, force_n)]);
                strength / force_n / (LAYER.greatest_rise / LAYER.half_pressure_pa)
            };
            let [weak, firm, strong] = [1e-4, 1.0, 5.0].map(per_newton);
            println!("z = {z_m} m: strength over its limit at 0.1 mN, 1 N, 5 N: {weak:.4}, {firm:.3}, {strong:.3}");
            assert!((weak - 1.0).abs() < 3e-3, "{weak}");
            assert!(firm < 0.9 * weak && strong < 0.9 * firm, "saturation");
        }
    }

    /// The change of the frame is the Jacobian times the change of conductance to first order: the error falls with the
    /// square of the rise.
    #[test]
    fn the_change_of_a_frame_is_that_of_the_jacobian_to_first_order() {
        let skin = skin();
        let forward = &skin.1;
        let rest = forward.rest_conductivity();
        let untouched = forward.solve(rest).unwrap();
        let jacobian = forward.jacobian(rest).unwrap();
        let full = touched(&LAYER, &skin, &[press(0.14, 1.0, 2.0), press(0.2, 4.0, 1.0)]);
        let error = |share: f64| {
            let step: Vec<f64> = full.iter().zip(rest).map(|(full, rest)| share * (full - rest)).collect();
            let conductivity: Vec<f64> = rest.iter().zip(&step).map(|(rest, step)| rest + step).collect();
            let change = &forward.solve(&conductivity).unwrap() - &untouched;
            let linear = |row: usize| jacobian.row(row).iter().zip(&step).map(|(j, step)| j * step).sum::<f64>();
            let off = norm(change.iter().enumerate().map(|(row, change)| change - linear(row)));
            off / norm(change.iter().copied())
        };
        let errors = [0.04, 0.02, 0.01].map(error);
        let rates = [0, 1].map(|k| (errors[k] / errors[k + 1]).log2());
        println!("error of the linearisation {errors:.5?} of the change, rates {rates:.3?}");
        assert!(rates.iter().all(|rate| (rate - 1.0).abs() < 0.05) && errors[2] < 0.02);
    }

    /// Saturation, and the law of Rayleigh: more conductance anywhere lowers the resistance of every pair of electrodes.
    #[test]
    fn the_change_saturates_and_no_resistance_rises() {
        let skin = skin();
        let forward = &skin.1;
        let untouched = forward.solve(forward.rest_conductivity()).unwrap();
        let size = |force_n: f64| {
            let frame = forward.solve(&touched(&LAYER, &skin, &[press(0.14, 1.0, force_n)])).unwrap();
            norm((&frame - &untouched).iter().copied())
        };
        let exponents =
            [1e-4, 0.1, 1.0, 5.0].map(|force_n: f64| (size(1.02 * force_n) / size(force_n)).ln() / 1.02f64.ln());
        println!("exponent of the change with the force at 0.1 mN, 0.1, 1, 5 N: {exponents:.3?}");
        assert!((exponents[0] - 1.0).abs() < 0.02 && exponents.is_sorted_by(|a, b| a > b));
        let presses = [press(0.14, 1.0, 5.0), press(0.14, 1.2, 5.0), press(0.3, 3.0, 1.0)];
        let conductivity = touched(&LAYER, &skin, &presses);
        let rest = forward.rest_conductivity();
        assert!(conductivity.iter().zip(rest).all(|(touched, rest)| (1.0..4.0).contains(&(touched / rest))));
        let [before, after] = [rest, &conductivity].map(|sheet| forward.network(sheet).unwrap().transfer_impedance);
        for (a, b) in (0..30).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let [before, after] = [&before, &after].map(|s| s.at(a, a) - s.at(a, b) - s.at(b, a) + s.at(b, b));
            assert!(after < before, "electrodes {a} and {b}: {after} ohm, untouched {before}");
        }
    }

    /// Kirchhoff: the currents into every node that is not below an electrode sum to zero. A triangle with the
    /// conductance `s` is three resistors between its corners, each with half of the cotangent of the opposite angle
    /// times `s` (Duffin, 1959, DOI 10.1512/iumj.1959.8.58051).
    #[test]
    fn no_node_keeps_a_current() {
        let skin = skin();
        let (mesh, forward) = (skin.1.mesh(), &skin.1);
        let conductivity = touched(&LAYER, &skin, &[press(0.14, 1.0, 5.0), press(0.2, 4.0, 1.0)]);
        let potentials = forward.potentials(&conductivity).unwrap();
        let dermis::mesh::Cells::Triangles(triangles) = &mesh.cells else { panic!("a surface") };
        let (mut net, mut passed) = (vec![0.0; mesh.node_count()], vec![0.0f64; mesh.node_count()]);
        for (cell, nodes) in triangles.iter().enumerate() {
            for corner in 0..3 {
                let [apex, from, to] = [0, 1, 2].map(|k| nodes[(corner + k) % 3]);
                let [a, b] = [from, to].map(|node| sub(mesh.nodes[node], mesh.nodes[apex]));
                let half_cotangent = dot(a, b) / (4.0 * mesh.cell_measure(cell));
                let volts = [from, to].map(|node| potentials.at(node, 3) - potentials.at(node, 20));
                let current = conductivity[cell] * half_cotangent * (volts[0] - volts[1]);
                for (node, current) in [(from, current), (to, -current)] {
                    net[node] += current;
                    passed[node] += current.abs();
                }
            }
        }
        let centres: Vec<Point3> = skin.0.electrodes.iter().map(|electrode| electrode.centre_m).collect();
        // Electrodes have a radius of 4 mm.
        let is_free = |node: &usize| centres.iter().all(|&centre| distance(centre, mesh.nodes[*node]) > 0.005);
        let free: Vec<usize> = (0..mesh.node_count()).filter(is_free).collect();
        let worst = free.iter().map(|&node| net[node].abs()).fold(0.0, f64::max);
        let most = free.iter().map(|&node| passed[node]).fold(0.0, f64::max);
        println!("{} free nodes: net current at most {worst:.1e} A of 1 A driven; up to {most:.2} A pass", free.len());
        assert!(worst < 1e-12 && most > 1e-2 && free.len() > 3000);
    }

    #[test]
    fn impossible_layers_are_refused_with_field_and_value() {
        for (layer, expected) in [
            (LayerOptions { greatest_rise: 0.0, ..LAYER }, "`greatest_rise` is 0"),
            (LayerOptions { greatest_rise: f64::NAN, ..LAYER }, "`greatest_rise` is NaN"),
            (LayerOptions { half_pressure_pa: -1.0, ..LAYER }, "`half_pressure_pa` is -1"),
            (LayerOptions { foam: Foam { thickness_m: 0.0, ..LAYER.foam }, ..LAYER }, "`thickness_m` is 0"),
        ] {
            let message = layer.check().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        let crushed =
            Footprint::new(&press(0.1, 0.0, 20.0), &LAYER.foam, &SkinDesign::shipped("cylinder30").unwrap().body);
        assert!(crushed.unwrap_err().to_string().contains("4.37 mm"));
    }

    #[test]
    fn presses_share_the_pressure_where_they_overlap() {
        let skin = skin();
        let of = |presses: &[Press]| strength_m2(&LAYER, &skin, presses);
        let (a, b, far) = (press(0.14, 1.0, 2.0), press(0.141, 1.0, 2.0), press(0.24, 1.0 + PI, 2.0));
        assert!(of(&[a, b]) < 0.9 * (of(&[a]) + of(&[b])));
        assert!((of(&[a, far]) / (of(&[a]) + of(&[far])) - 1.0).abs() < 1e-12);
    }
}
