//! Known values come back from simulated frames; what the frames do not tell is said.

use crate::design::{ElectrodeShape, SkinDesign};
use crate::fit::{Contacts, Determination, Fit, FitError, FitOptions, Quantity, fit};
use crate::forward::ForwardModel;
use crate::frame::Frame;
use crate::mesh::Mesh;
use dermis_sim::random::{sample_rng, standard_normal};

/// A disk with twelve arcs on its rim.
fn design(pattern: &str) -> SkinDesign {
    let text = format!(
        "body.disk.diameter_m = 0.1\n[sheet]\nsheet_resistance_ohm = 1000\ntouch = \"conductance_rises\"\n[electrodes]\n\
         shape.arc.length_m = 0.01\ncontact_impedance_ohm_m = 1\nlayout.rim.count = 12\n[protocol]\n{pattern}\n\
         [mesh]\nmax_edge_m = 0.008\nelectrode_edge_m = 0.001\n"
    );
    SkinDesign::parse(&text, "disk12.toml").unwrap()
}

/// The same design with other values: a sheet of 1370 ohm per square, contacts three times the design's, with a spread.
fn real(design: &SkinDesign, spread: f64) -> SkinDesign {
    let mut real = design.clone();
    real.sheet.conductance = 1.0 / 1370.0;
    for (index, electrode) in real.electrodes.iter_mut().enumerate() {
        electrode.contact_impedance *= 3.0 * (spread * (2.4 * index as f64).sin()).exp();
    }
    real
}

/// The untouched frame of a design on a mesh of other resolution.
fn untouched(design: &SkinDesign, mesh_scale: f64) -> Frame {
    let mut other = design.clone();
    other.mesh = other.mesh.scaled(mesh_scale);
    let mesh = Mesh::generate(&other).unwrap();
    let model = ForwardModel::new(design, &mesh).unwrap();
    model.solve(model.rest_conductivity()).unwrap()
}

/// Frames with Gaussian noise, ohm.
fn noisy(frame: &Frame, count: usize, sd_ohm: f64, seed: u64) -> Vec<Frame> {
    let mut rng = sample_rng(seed, 0);
    (0..count).map(|_| Frame(frame.iter().map(|value| value + sd_ohm * standard_normal(&mut rng)).collect())).collect()
}

fn fitted(design: &SkinDesign, frames: &[Frame], contacts: Contacts) -> Fit {
    fitted_on(&Mesh::generate(design).unwrap(), design, frames, contacts)
}

fn fitted_on(mesh: &Mesh, design: &SkinDesign, frames: &[Frame], contacts: Contacts) -> Fit {
    fit(design, mesh, frames, &FitOptions { contacts, left_out: Vec::new() }).unwrap()
}

/// The error of each quantity in stated standard deviations.
fn errors_in_sd(fit: &Fit, truth: &SkinDesign) -> Vec<f64> {
    let truth_of = |quantity: Quantity| match quantity {
        Quantity::Resistance => 1.0 / truth.sheet.conductance,
        Quantity::CommonContact => truth.electrodes[0].contact_impedance,
        Quantity::Contact(electrode) => truth.electrodes[electrode].contact_impedance,
    };
    let error = |found: &crate::fit::FittedQuantity| (found.value / truth_of(found.quantity)).ln() / found.relative_sd;
    fit.quantities.iter().map(error).collect()
}

#[test]
fn values_come_back_to_rounding_where_the_model_is_exact() {
    for pattern in ["pattern = \"adjacent\"", "pattern = \"adjacent\"\namplitude_only = true"] {
        let design = design(pattern);
        let truth = real(&design, 0.5);
        let mut frame = untouched(&truth, 1.0);
        design.protocol.drop_signs(&mut frame);
        let fit = fitted(&design, &[frame], Contacts::Each);
        assert_eq!(fit.quantities.len(), 13);
        assert!(fit.quantities.iter().all(|found| found.determination == Determination::Determined));
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-7, "{a} for {b}");
        close(fit.design.sheet.conductance, truth.sheet.conductance);
        for (found, expected) in fit.design.electrodes.iter().zip(&truth.electrodes) {
            close(found.contact_impedance, expected.contact_impedance);
        }
    }
}

/// Discs in an interior have a series resistance that depends on their contact impedance.
#[test]
fn values_of_discs_come_back_too() {
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.mesh = design.mesh.scaled(3.0);
    let mut truth = design.clone();
    truth.sheet.conductance = 1.0 / 700.0;
    truth.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance *= 20.0);
    let fit = fitted(&design, &[untouched(&truth, 1.0)], Contacts::Common);
    let [sheet, contact] = [fit.quantities[0], fit.quantities[1]];
    assert!((sheet.value / 700.0 - 1.0).abs() < 1e-7, "{sheet:?}");
    assert!((contact.value / contact.initial / 20.0 - 1.0).abs() < 1e-6, "{contact:?}");
}

/// Frames of a finer mesh with noise: the errors are those of the stated deviations. The noise exceeds the error that
/// all channels share on this mesh, which no scatter shows. In a draw, the errors of the contacts share that of the
/// sheet, so the shares vary more than those of independent errors.
#[test]
fn stated_deviations_hold() {
    const DRAWS: u64 = 60;
    for (contacts, spread, sd_ohm) in [(Contacts::Common, 0.0, 150.0), (Contacts::Each, 0.3, 150.0)] {
        let design = design("pattern = \"adjacent\"");
        let truth = real(&design, spread);
        let (frame, mesh) = (untouched(&truth, 0.6), Mesh::generate(&design).unwrap());
        let mut errors = Vec::new();
        for seed in 0..DRAWS {
            let fit = fitted_on(&mesh, &design, &noisy(&frame, 40, sd_ohm, seed), contacts);
            errors.extend(errors_in_sd(&fit, &truth));
        }
        let within = |sd: f64| errors.iter().filter(|error| error.abs() < sd).count() as f64 / errors.len() as f64;
        let (one, two) = (within(1.0), within(2.0));
        println!(
            "{contacts:?}: {:.1} % within 1 sd, {:.1} % within 2 sd of {}",
            100.0 * one,
            100.0 * two,
            errors.len()
        );
        // Of 120 values at 95.4 %, one or none outside has a probability of 3 %: 99.2 %.
        assert!((0.90..=0.995).contains(&two), "{contacts:?}: {two} within 2 sd");
        assert!((0.55..=0.80).contains(&one), "{contacts:?}: {one} within 1 sd");
    }
}

/// Without a voltage at a driven electrode, noise hides the contact impedances; with it, the noise does not matter.
#[test]
fn what_the_frames_do_not_tell_is_kept() {
    let design = design("pattern = \"adjacent_undriven\"");
    let truth = real(&design, 0.0);
    let frames = noisy(&untouched(&truth, 0.6), 10, 3.0, 1);
    let fit = fitted(&design, &frames, Contacts::Common);
    let [sheet, contact] = [fit.quantities[0], fit.quantities[1]];
    println!("{sheet:?}\n{contact:?}\n{:?}", fit.others);
    assert_eq!((contact.determination, contact.value), (Determination::Kept, contact.initial));
    assert!(contact.relative_sd.is_nan() && fit.driven.is_none());
    assert_eq!(sheet.determination, Determination::Determined);
    assert!((sheet.value / 1370.0 - 1.0).abs() < 0.02, "{sheet:?}");
    // A contact impedance that is kept is wrong, here by a factor of three, and with little noise nothing else is.
    let fit = |sd_ohm: f64| fitted(&design, &noisy(&untouched(&truth, 1.0), 20, sd_ohm, 2), Contacts::Common);
    let is_kept = |fit: &Fit| fit.quantities[1].determination == Determination::Kept;
    let kept: Vec<Fit> = [0.1, 0.2, 0.5, 1.0].map(fit).into_iter().filter(is_kept).collect();
    assert!(!kept.is_empty() && kept.iter().all(|fit| errors_in_sd(fit, &truth)[0].abs() < 2.0), "{kept:?}");
    let each = fitted(&design, &frames, Contacts::Each);
    assert!(each.quantities[1..].iter().all(|found| found.determination == Determination::Kept), "{each:?}");
    assert_eq!(fitted(&design, &frames, Contacts::Kept).quantities.len(), 1);
    let mut points = design.clone();
    points.electrodes.iter_mut().for_each(|electrode| electrode.shape = ElectrodeShape::Point);
    assert_eq!(fitted(&points, &[untouched(&points, 1.0)], Contacts::Each).quantities.len(), 1);
}

/// Contacts far better than the design says: values on that side fit equally well, so only a limit is known.
#[test]
fn a_contact_impedance_that_vanishes_is_a_limit() {
    let design = design("pattern = \"adjacent\"");
    let mut truth = design.clone();
    truth.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance = 1e-7);
    let fit = fitted(&design, &noisy(&untouched(&truth, 1.0), 10, 30.0, 2), Contacts::Common);
    let contact = fit.quantities[1];
    assert_eq!(contact.determination, Determination::Limit, "{contact:?}");
    assert!(contact.value < 0.1 * contact.initial, "{contact:?}");
}

/// The offsets are those that were added, and the misfit is in the channels that have them.
#[test]
fn offsets_and_misfit_are_found() {
    let design = design("pattern = \"adjacent\"");
    let mut frame = untouched(&design, 1.0);
    let (driven, others): (Vec<usize>, Vec<usize>) =
        (0..frame.len()).partition(|&channel| design.protocol.channels()[channel].touches_driven());
    for (index, &channel) in others.iter().enumerate() {
        frame[channel] += if index % 2 == 0 { 5.0 } else { -5.0 };
    }
    let fit = fitted(&design, &noisy(&frame, 20, 0.1, 3), Contacts::Common);
    let (at_driven, rest) = (fit.driven.unwrap(), fit.others.unwrap());
    assert_eq!((at_driven.channels, rest.channels), (driven.len(), others.len()));
    assert!((rest.misfit_ohm / 5.0 - 1.0).abs() < 0.05 && at_driven.misfit_ohm < 0.5, "{at_driven:?} {rest:?}");
    assert!((rest.noise_ohm / 0.1 - 1.0).abs() < 0.1, "{rest:?}");
    let right = |channel: &usize| (fit.offsets[*channel].offset_ohm.abs() - 5.0).abs() < 1.0;
    assert!(others.iter().filter(|channel| right(channel)).count() * 20 > others.len() * 19);
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let design = design("pattern = \"adjacent\"");
    let mesh = Mesh::generate(&design).unwrap();
    let frame = untouched(&design, 1.0);
    let refused = |frames: &[Frame], left_out: &[usize]| {
        let options = FitOptions { left_out: left_out.to_vec(), ..FitOptions::default() };
        match fit(&design, &mesh, frames, &options).unwrap_err() {
            crate::Error::Fit(error) => error,
            error => panic!("{error}"),
        }
    };
    assert_eq!(refused(&[], &[]), FitError::NoFrame);
    assert_eq!(refused(&[Frame(vec![1.0])], &[]), FitError::FrameLength { frame: 0, got: 1, expected: 132 });
    assert_eq!(refused(std::slice::from_ref(&frame), &[132]), FitError::NoSuchChannel { channel: 132, last: 131 });
    let mut gap = frame.clone();
    gap[7] = f64::NAN;
    assert!(matches!(refused(std::slice::from_ref(&gap), &[]), FitError::NotFinite { frame: 0, channel: 7, .. }));
    gap[7] = 0.0;
    assert!(fit(&design, &mesh, &[gap], &FitOptions { left_out: vec![7], ..FitOptions::default() }).is_ok());
    let all_but_one: Vec<usize> = (1..132).collect();
    assert_eq!(
        refused(std::slice::from_ref(&frame), &all_but_one),
        FitError::TooFewChannels { channels: 1, unknowns: 2 }
    );
    // Another sign, another order, nothing.
    for wrong in [
        frame.iter().map(|value| -value).collect(),
        (0..132).map(|channel| frame[5 * channel % 132]).collect(),
        vec![0.0; 132],
    ] {
        let error = refused(&[Frame(wrong)], &[]);
        println!("{error}");
        assert!(matches!(error, FitError::Unlike { .. }), "{error}");
    }
}
