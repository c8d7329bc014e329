//! Control designs for the paper's claims on structure: the same electrodes at other positions, and the same skin cut
//! open.

use dermis::design::{Body, Electrode, ElectrodeShape, SkinDesign};
use dermis::geom::{Chart, Point3, Surface};
use std::f64::consts::TAU;

/// A design that differs from the design under study in one aspect.
pub(crate) struct Control {
    /// Its identifier.
    pub key: &'static str,
    /// Its name in tables and pictures.
    pub name: &'static str,
    /// The design.
    pub design: SkinDesign,
}

/// The design under study and its controls, and the angle of the cut.
pub(crate) struct Controls {
    /// The designs; the first is the design under study.
    pub designs: Vec<Control>,
    /// Angle of the cut, rad; as far as possible from all electrodes.
    pub cut_rad: f64,
}

/// The design under study and its controls.
///
/// - **On the rims only**: the same number of electrodes of the same size, half of them on each rim at uniform angles,
///   with the second rim rotated by half a step. The electrode numbers determine the drive pairs, and the paper does
///   not state the numbering for this case. One control numbers one rim and then the other, so that all but two pairs
///   drive along a rim; another alternates between the rims, so that every pair drives from rim to rim.
/// - **Cut open**: the same coat, electrodes and size, cut along a line from rim to rim. Conduction in a sheet depends
///   only on lengths within the sheet (Eq. 1 has no curvature), so the cut cylinder is modelled as a flat rectangle of
///   the same size. The cut avoids the electrodes; it would otherwise split some of them, and the control would differ
///   in two aspects.
///
/// `None` for a body that is not a cylinder, for electrodes that are not discs, and for electrodes without room for a
/// cut.
pub(crate) fn controls(design: &SkinDesign) -> Option<Controls> {
    let Surface::Cylinder { radius_m, length_m } = design.body.surface() else { return None };
    let cut_rad = cut(design, radius_m)?;
    let own = |key, name, design| Control { key, name, design };
    let designs = vec![
        own("designed", "as designed", design.clone()),
        own("rims", "rims only, driven along", rims(design, length_m, Numbering::RimByRim)?),
        own("rims-across", "rims only, driven across", rims(design, length_m, Numbering::ToAndFro)?),
        own("cut", "cut open", opened(design, cut_rad)?),
    ];
    Some(Controls { designs, cut_rad })
}

/// The angle at the centre of the widest gap between electrodes.
fn cut(design: &SkinDesign, radius_m: f64) -> Option<f64> {
    let surface = design.body.surface();
    let mut angles: Vec<f64> =
        design.electrodes.iter().map(|electrode| surface.theta_rad(electrode.centre_m)).collect::<Option<_>>()?;
    angles.sort_by(f64::total_cmp);
    let first = *angles.first()?;
    let next = angles[1..].iter().copied().chain([first + TAU]);
    let gaps = angles.iter().zip(next).map(|(&from, to)| (to - from, 0.5 * (from + to)));
    // Of equal gaps the first, so that rounding errors do not decide.
    let (gap, middle) = gaps.fold((0.0, 0.0), |best, gap| if gap.0 > best.0 + 1e-9 { gap } else { best });
    let largest_m =
        design.electrodes.iter().map(|electrode| disc_m(electrode).unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
    // The space between cut and electrode is at least as wide as the electrode, so that the mesh is regular there.
    (0.5 * gap * radius_m >= 3.0 * largest_m).then(|| middle.rem_euclid(TAU))
}

fn disc_m(electrode: &Electrode) -> Option<f64> {
    match electrode.shape {
        ElectrodeShape::Disc { radius_m } => Some(radius_m),
        ElectrodeShape::Point => Some(0.0),
        _ => None,
    }
}

/// Numbering of electrodes on two rims.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Numbering {
    RimByRim,
    ToAndFro,
}

fn rims(design: &SkinDesign, length_m: f64, numbering: Numbering) -> Option<SkinDesign> {
    let count = design.electrodes.len();
    if !count.is_multiple_of(2) {
        return None;
    }
    let per_rim = count / 2;
    let surface = design.body.surface();
    let moved = |(number, electrode): (usize, &Electrode)| {
        let (rim, place) = match numbering {
            Numbering::RimByRim => (number / per_rim, number % per_rim),
            Numbering::ToAndFro => (number % 2, number / 2),
        };
        let theta = TAU * (place as f64 + 0.5 * rim as f64) / per_rim as f64;
        Some(Electrode { centre_m: surface.at(rim as f64 * length_m, theta)?, ..electrode.clone() })
    };
    let electrodes = design.electrodes.iter().enumerate().map(moved).collect::<Option<_>>()?;
    checked(SkinDesign { name: format!("{}-rims", design.name), electrodes, ..design.clone() })
}

/// The cut cylinder as a flat skin: x is the arc from the cut, y is z.
fn opened(design: &SkinDesign, cut_rad: f64) -> Option<SkinDesign> {
    if !design.sheet.regions.is_empty() {
        return None;
    }
    let surface = design.body.surface();
    let moved = |electrode: &Electrode| {
        let [x, y] = place_m(&surface, electrode.centre_m, cut_rad);
        Electrode { centre_m: [x, y, 0.0], ..electrode.clone() }
    };
    let electrodes = design.electrodes.iter().map(moved).collect();
    let [width_m, height_m] = Chart::of(&surface).size_m();
    let body = Body::Rectangle { width_m, height_m };
    checked(SkinDesign { name: format!("{}-cut", design.name), body, electrodes, ..design.clone() })
}

fn checked(design: SkinDesign) -> Option<SkinDesign> {
    design.check().is_ok().then_some(design)
}

/// A position for the comparison of the controls: the arc from the cut and the height, m. On the opened skin these are
/// x and y.
pub(crate) fn place_m(surface: &Surface, place: Point3, cut_rad: f64) -> [f64; 2] {
    let chart = Chart::of(surface).with_seam(cut_rad);
    let [x, y] = chart.unroll(place);
    [if chart.period_m().is_some() { x - chart.bounds_m()[0][0] } else { x }, y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::mesh::Mesh;
    use dermis_sim::twin::{Twin, TwinOptions};

    fn made() -> (SkinDesign, Controls) {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let controls = controls(&design).unwrap();
        (design, controls)
    }

    #[test]
    fn the_cut_passes_every_electrode_at_the_same_distance() {
        let (design, controls) = made();
        // There is an electrode every 36 degrees: the cut is at 18, 15.7 mm from the nearest one.
        assert!((controls.cut_rad.to_degrees() - 18.0).abs() < 1e-9);
        let opened = &controls.designs[3].design;
        let margin = |electrode: &Electrode| electrode.centre_m[0].min(TAU * 0.05 - electrode.centre_m[0]);
        let nearest = opened.electrodes.iter().map(margin).fold(f64::INFINITY, f64::min);
        assert!((nearest - 0.05 * 18f64.to_radians()).abs() < 1e-9);
        assert_eq!(opened.protocol, design.protocol);
    }

    #[test]
    fn distances_between_neighbours_are_those_of_the_cylinder() {
        let (design, controls) = made();
        let opened = &controls.designs[3].design;
        let (round, flat) = (design.body.surface(), opened.body.surface());
        for a in 0..30 {
            for b in 0..30 {
                let [there, here] = [&opened.electrodes, &design.electrodes].map(|e| [e[a].centre_m, e[b].centre_m]);
                let (flat_m, round_m) = (flat.distance_m(there[0], there[1]), round.distance_m(here[0], here[1]));
                // The path around the cylinder may be shorter than the flat one, never longer.
                assert!(flat_m >= round_m - 1e-12, "{a} {b}");
                let across = (there[0][0] - there[1][0]).abs() > 0.5 * TAU * 0.05;
                assert!(across || (flat_m - round_m).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn the_rims_hold_all_electrodes_evenly() {
        let (design, controls) = made();
        let rims = &controls.designs[1].design;
        assert_eq!(rims.electrodes.len(), 30);
        assert!(rims.electrodes[..15].iter().all(|electrode| electrode.centre_m[2] == 0.0));
        assert!(rims.electrodes[15..].iter().all(|electrode| (electrode.centre_m[2] - 0.3).abs() < 1e-12));
        let surface = design.body.surface();
        let step = surface.distance_m(rims.electrodes[3].centre_m, rims.electrodes[4].centre_m);
        assert!((step - TAU * 0.05 / 15.0).abs() < 1e-12);
    }

    #[test]
    fn to_and_fro_every_pair_drives_from_rim_to_rim() {
        let (_, controls) = made();
        let [along, across] = [1, 2].map(|control| &controls.designs[control].design.electrodes);
        let crosses = |electrodes: &[Electrode]| {
            let height = |number: usize| electrodes[number % 30].centre_m[2];
            (0..30).filter(|&number| height(number) != height(number + 1)).count()
        };
        assert_eq!([crosses(along), crosses(across)], [2, 30]);
        // The same positions, in another order.
        for electrode in across {
            assert!(
                along.iter().any(|other| dermis::geom::vector::distance(other.centre_m, electrode.centre_m) < 1e-12)
            );
        }
    }

    #[test]
    fn every_control_and_its_twins_can_be_meshed() {
        let (_, controls) = made();
        let options = TwinOptions::shipped("lab").unwrap();
        for control in &controls.designs {
            let mesh = Mesh::generate(&control.design).unwrap_or_else(|error| panic!("{}: {error}", control.key));
            assert_eq!(mesh.electrodes.len(), 30);
            for seed in [1001, 1002, 2001] {
                let twin = Twin::new(&control.design, &options, seed);
                assert!(twin.is_ok(), "{}, twin {seed}: {}", control.key, twin.unwrap_err());
            }
        }
    }

    #[test]
    fn a_flat_skin_has_no_such_controls() {
        assert!(controls(&SkinDesign::shipped("skin16").unwrap()).is_none());
    }

    #[test]
    fn places_are_counted_from_the_cut() {
        let surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let place = surface.at(0.1, 0.2).unwrap();
        let [arc, height] = place_m(&surface, place, 0.3);
        assert!((arc - 0.05 * (TAU - 0.1)).abs() < 1e-12 && height == 0.1);
        assert_eq!(place_m(&Surface::Plane, [0.2, 0.1, 0.0], 0.3), [0.2, 0.1]);
    }
}
