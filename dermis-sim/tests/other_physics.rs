//! The twins whose presses obey another physics than those of any training: `lab-b`, round patches in a hexagonal lattice
//! under rubber, and `lab-c`, a layer without patches.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::mesh::Mesh;
use dermis::stats::upper_median;
use dermis_sim::twin::{MOMENT_DEGREE, PatchLattice, PatchOptions, PatchShape, PatchedSkin, Press, TouchOptions};
use dermis_sim::twin::{Twin, TwinOptions};
use std::f64::consts::{PI, TAU};

fn cylinder() -> SkinDesign {
    SkinDesign::load("cylinder30").unwrap()
}

fn lab_b() -> PatchOptions {
    let TouchOptions::Patches(patches) = TwinOptions::shipped("lab-b").unwrap().touch else { panic!("patches") };
    patches
}

fn model(mesh_scale: f64) -> (SkinDesign, ForwardModel) {
    let mut design = cylinder();
    design.mesh = design.mesh.scaled(mesh_scale);
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    (design, model)
}

fn press(z_m: f64, theta_rad: f64, force_n: f64) -> Press {
    let (sin, cos) = theta_rad.sin_cos();
    Press { centre_m: [0.05 * cos, 0.05 * sin, z_m], force_n, tip_radius_m: 0.005 }
}

/// Positions that cover the skin uniformly: the two-dimensional golden ratio sequence (Roberts, 2018).
fn spread_press(k: usize, force_n: f64) -> Press {
    press(0.3 * (k as f64 * 0.754_877_67).fract(), TAU * (k as f64 * 0.569_840_29).fract(), force_n)
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|value| value * value).sum::<f64>().sqrt()
}

/// The size of the change of the values without a driven electrode, relative to their size at rest.
fn change(twin: &Twin, rest: &Frame, presses: &[Press]) -> f64 {
    let touched = twin.clean(presses).unwrap();
    let undriven = |frame: &Frame| {
        let channels = frame.iter().copied().zip(twin.design().protocol.channels());
        channels.filter(|(_, channel)| !channel.touches_driven()).map(|(value, _)| value).collect::<Vec<f64>>()
    };
    let (touched, rest) = (undriven(&touched), undriven(rest));
    norm(touched.iter().zip(&rest).map(|(touched, rest)| touched - rest)) / norm(rest.iter().copied())
}

/// The calibration of `lab-b` and `lab-c`, the same as that of `lab`: a press of 2 N changes the values without a driven
/// electrode by 0.5 to 2 % in the median. The instrument and its noise are those of `lab`.
#[test]
fn a_press_of_two_newtons_changes_the_frame_by_about_one_per_cent() {
    let lab = TwinOptions::shipped("lab").unwrap();
    for name in ["lab", "lab-b", "lab-c"] {
        let options = TwinOptions::shipped(name).unwrap();
        assert_eq!(options.electronics, lab.electronics, "{name}");
        let twin = Twin::new(&cylinder(), &options, 2001).unwrap();
        let rest = twin.clean(&[]).unwrap();
        let share = |force_n: f64| {
            let of = |k: usize| change(&twin, &rest, &[spread_press(k, force_n)]);
            upper_median(&(0..60).map(of).collect::<Vec<f64>>()).unwrap()
        };
        let [one, two, five] = [1.0, 2.0, 5.0].map(share);
        let report = twin.report(0..50).unwrap();
        assert_eq!(report.saturated_readings, 0, "{name}");
        println!(
            "{name}: median change at 1, 2, 5 N: {:.3} %, {:.3} %, {:.3} %; total noise {:.1} dB",
            one * 100.0,
            two * 100.0,
            five * 100.0,
            -20.0 * report.total.relative.log10()
        );
        assert!((0.005..0.02).contains(&two), "{name}: {two}");
        assert!(one < two && two < five);
    }
}

/// A uniform contact under all patches: the total conductance of a whole patch is that of the exact area of its shape,
/// and the moments see the same contact in every function.
#[test]
fn patches_of_every_shape_have_their_area() {
    let (design, model) = model(1.0);
    for (shape, lattice) in [
        (PatchShape::Square, PatchLattice::Staggered),
        (PatchShape::Round, PatchLattice::Rectangular),
        (PatchShape::Round, PatchLattice::Staggered),
        (PatchShape::Hexagonal, PatchLattice::Rectangular),
        (PatchShape::Hexagonal, PatchLattice::Staggered),
    ] {
        let (rows, columns, gap_m) = (30, 31, 0.0015);
        let mut options = PatchOptions { shape, lattice, rows, columns, gap_m, ..lab_b() };
        options.contact.preload_pa = 100.0;
        let (pitch, row) = (0.1 * PI / columns as f64, 0.3 / rows as f64);
        let beside = if lattice == PatchLattice::Staggered { 0.5 * pitch } else { 0.0 };
        let area_m2 = match shape {
            PatchShape::Square => (pitch - gap_m) * (row - gap_m),
            PatchShape::Round => PI / 4.0 * (pitch.min(row.hypot(beside)) - gap_m).powi(2),
            PatchShape::Hexagonal => {
                let across = pitch.min(0.5 * beside + 0.75f64.sqrt() * row);
                0.75f64.sqrt() * (across - gap_m).powi(2)
            }
        };
        let per_m2 = options.contact.conductance_s_per_m2(100.0);
        let skin = PatchedSkin::new(&options, &design.body, &model, model.rest_conductivity()).unwrap();
        let whole = |total: f64| (total / (per_m2 * area_m2) - 1.0).abs() < 1e-9;
        let totals: Vec<f64> = skin.contacts_at_rest().iter().map(|contact| contact.conductance.at(0, 0)).collect();
        let fits = totals.iter().filter(|total| whole(**total)).count();
        println!("{shape:?}, {lattice:?}: {fits} of {} patches have the exact area", totals.len());
        assert_eq!(totals.len(), rows * columns);
        // Those of the outermost rows may extend beyond the rims.
        assert!(fits >= (rows - 2) * columns && totals.iter().all(|total| *total < per_m2 * area_m2 * (1.0 + 1e-9)));
        let contact = &skin.contacts_at_rest()[15 * columns + 4].conductance;
        for (i, j) in (0..contact.rows).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let expected = if i == j { per_m2 * area_m2 } else { 0.0 };
            assert!((contact.at(i, j) - expected).abs() < 1e-9 * per_m2 * area_m2, "{shape:?} {i} {j}");
        }
    }
}

/// The area below a round patch that a rim cuts is that of the circle's segment, up to the polygon that stands for the
/// circle, wherever the rim cuts it.
#[test]
fn a_round_patch_is_cut_by_a_rim_as_a_circle_is() {
    let (design, model) = model(1.0);
    for share in [0.15, 0.35, 0.5, 0.8] {
        let mut options = lab_b();
        options.lattice = PatchLattice::Rectangular;
        options.contact.preload_pa = 100.0;
        let row = 0.3 / options.rows as f64;
        options.offset_m = [share * row, 0.0];
        let radius = 0.5 * (row.min(0.1 * PI / options.columns as f64) - options.gap_m);
        // The middle of the first row lies below the rim, or above it, by this much.
        let height = (share - 0.5) * row;
        let t = (height / radius).clamp(-1.0, 1.0);
        let exact = radius * radius * (PI - t.acos() + t * (1.0 - t * t).sqrt());
        let skin = PatchedSkin::new(&options, &design.body, &model, model.rest_conductivity()).unwrap();
        let first = skin.contacts_at_rest().iter().find(|contact| contact.conductor < options.columns);
        let area =
            first.map_or(0.0, |contact| contact.conductance.at(0, 0) / options.contact.conductance_s_per_m2(100.0));
        let error = (area - exact) / (PI * radius * radius);
        println!(
            "rim at {share} of the row: {:.2} of {:.2} mm2, error {error:.1e} of the disk",
            area * 1e6,
            exact * 1e6
        );
        assert!(error.abs() < 5e-3, "{error}");
    }
}

/// Every way to solve for round patches: the table, the forward substitution, and a direct factorisation; and the net
/// current of every patch.
#[test]
fn the_low_rank_update_of_round_patches_equals_the_direct_solve() {
    let (design, model) = model(1.0);
    let model = model.with_series_resistances(&[0.0; 30]).unwrap();
    let skin = PatchedSkin::new(&lab_b(), &design.body, &model, model.rest_conductivity()).unwrap();
    let conductors = skin.conductors();
    let presses = [press(0.155, 1.1, 2.0), press(0.2995, 0.4, 1.0), press(0.12, 0.002, 3.0)];
    let contacts = skin.contacts(&presses).unwrap();
    let direct = model.network_with_conductors(model.rest_conductivity(), conductors.moments(), &contacts).unwrap();
    let direct = direct.frame(model.protocol());
    for network in [skin.network(&presses).unwrap(), skin.network_once(&presses).unwrap()] {
        let frame = network.frame(model.protocol());
        let error = norm((&frame - &direct).iter().copied()) / norm(direct.iter().copied());
        println!("{} patches: error {error:.1e} of the frame", contacts.len());
        assert!(error < 1e-10);
    }
    let impedance = &skin.network(&presses).unwrap().transfer_impedance;
    let mut worst = 0.0f64;
    for drive in 0..30 {
        let potentials: Vec<f64> =
            (0..30).map(|k| impedance.at(k, drive) - impedance.at(k, (drive + 1) % 30)).collect();
        for [current, of_one] in skin.conductors().currents(&contacts, &potentials).unwrap() {
            worst = worst.max(current.iter().zip(&of_one).map(|(current, one)| current * one).sum::<f64>().abs());
        }
    }
    println!("net current of a patch: at most {worst:.1e} A of 1 A driven");
    assert!(worst < 1e-12);
}

#[test]
fn the_polynomials_under_a_round_patch_are_fine_enough() {
    let (design, model) = model(0.65);
    let at = |degree: usize| {
        PatchedSkin::with_degree(&lab_b(), &design.body, &model, model.rest_conductivity(), degree).unwrap()
    };
    let rest = model.solve(model.rest_conductivity()).unwrap();
    let (usual, fine) = (at(MOMENT_DEGREE), at(6));
    let error = |k: usize| {
        let presses = [spread_press(k, 1.0 + 0.17 * k as f64)];
        let [usual, fine] = [&usual, &fine].map(|skin| skin.network_once(&presses).unwrap().frame(model.protocol()));
        norm((&usual - &fine).iter().copied()) / norm((&fine - &rest).iter().copied())
    };
    let errors: Vec<f64> = (0..24).map(error).collect();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    let median = upper_median(&errors).unwrap();
    println!("degree {MOMENT_DEGREE}: median {:.2} %, worst {:.2} %", median * 100.0, worst * 100.0);
    assert!(median < 0.03);
}
