//! Reading, drawing, faults and frames of twins.

use super::*;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::mesh::Mesh;
use std::f64::consts::TAU;

const LAB: &str = include_str!("../../twins/lab.toml");

fn cylinder() -> SkinDesign {
    SkinDesign::shipped("cylinder30").unwrap()
}

/// A shipped twin on a mesh coarse enough for tests.
fn coarse(name: &str) -> TwinOptions {
    let mut options = TwinOptions::shipped(name).unwrap();
    options.mesh_scale = 1.6;
    options
}

fn press(z_m: f64, theta_rad: f64, force_n: f64) -> Press {
    Press { centre_m: cylinder().body.surface().at(z_m, theta_rad).unwrap(), force_n, tip_radius_m: 0.005 }
}

fn relative(a: &Frame, b: &Frame) -> f64 {
    let norm = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>().sqrt();
    norm(&(a - b)) / norm(b)
}

#[test]
fn every_shipped_twin_is_read_and_names_itself() {
    for name in TwinOptions::SHIPPED {
        let options = TwinOptions::load(name).unwrap();
        assert_eq!(options.name, name);
        assert!(options.faults.none(), "faults are asked for by name");
    }
    let error = TwinOptions::load("lap").unwrap_err().to_string();
    assert!(error.contains("did you mean `lab`?"), "{error}");
    let schema = TwinOptions::json_schema().to_string();
    assert!(schema.contains("line_capacitance_f") && schema.contains("amplitude_per_n"));
}

#[test]
fn the_lab_twin_is_as_stated() {
    let lab = TwinOptions::shipped("lab").unwrap();
    assert_eq!((lab.coat.rms, lab.coat.correlation_m), (0.10, 0.040));
    assert_eq!((lab.electrodes.displacement_rms_m, lab.electrodes.contact_impedance_rms), (0.0005, 0.30));
    let electronics = &lab.electronics;
    assert_eq!((electronics.on_resistance_ohm, electronics.on_resistance_spread_ohm), (120.0, 5.0));
    assert_eq!((electronics.snr_db, electronics.line_capacitance_f), (Some(50.0), 150e-12));
    assert_eq!((lab.press.force_n(0.0), lab.press.force_n(1.0)), (1.0, 5.0));
    assert!((lab.press.force_n(0.5) - 5f64.sqrt()).abs() < 1e-12, "log-uniform");
    let harsh = TwinOptions::shipped("harsh").unwrap();
    assert_eq!((harsh.coat.rms, harsh.electrodes.displacement_rms_m), (0.20, 0.0010));
    assert_eq!(harsh.electronics.snr_db, Some(40.0));
    assert!(harsh.electronics.hum.is_some() && harsh.drift.is_some());
}

#[test]
fn mistakes_in_a_twins_file_are_named_with_their_line() {
    let broken = |from: &str, to: &str| {
        assert!(LAB.contains(from), "{from} is not in the twin");
        let line = 1 + LAB.lines().position(|line| line.contains(from)).unwrap();
        let error = TwinOptions::parse(&LAB.replacen(from, to, 1), "my.toml").expect_err(to);
        assert_eq!(error.line(), Some(line), "{error}");
        error.to_string()
    };
    let error = broken("correlation_m = 0.040", "correlation_m = -0.040");
    assert!(error.contains("`coat.correlation_m` is -0.04: it must be positive"), "{error}");
    assert!(broken("bits = 12", "bits = 99").contains("`electronics.adc.bits` is 99: it must be 2 to 32"));
    assert!(broken("contact_impedance_rms = 0.30", "contact_impedance_rms = 30").contains("10 % is 0.10"));
    assert!(broken("least_force_n = 1.0", "least_force_n = nan").contains("press.least_force_n"));
    assert!(broken("snr_db = 50.0", "snr_bd = 50.0").contains("did you mean `snr_db`?"));
    assert!(broken("line_capacitance_f = 150e-12", "line_capacitance_pf = 150").contains("did you mean"));
    assert!(broken("source_v = 5.0", "source_v = \"5 V\"").contains("invalid type"));
}

#[test]
fn mistakes_in_a_layer_are_named_with_their_line() {
    let text = TwinOptions::shipped_text("lab-c").unwrap();
    for (key, value) in [("greatest_rise", "-3.0"), ("thickness_m", "0.0")] {
        let line = 1 + text.lines().position(|line| line.starts_with(key)).unwrap();
        let wrong =
            text.lines().map(|line| if line.starts_with(key) { format!("{key} = {value}") } else { line.into() });
        let error = TwinOptions::parse(&wrong.collect::<Vec<String>>().join("\n"), "my.toml").unwrap_err();
        assert_eq!(error.line(), Some(line), "{error}");
        assert!(error.to_string().contains(&format!("`{key}` is")), "{error}");
    }
}

#[test]
fn what_does_not_fit_the_skin_is_named_with_its_line() {
    let text = LAB.replacen("dead_electrodes = []", "dead_electrodes = [3, 30]", 1);
    let options = TwinOptions::parse(&text, "my.toml").unwrap();
    let error = Twin::new(&cylinder(), &options, 1).unwrap_err();
    let crate::Error::Dermis(dermis::Error::Design(error)) = error else { panic!("{error}") };
    assert_eq!(error.line(), Some(1 + text.lines().position(|line| line.contains("dead_")).unwrap()));
    assert!(error.to_string().contains("electrode 30, but the skin has electrodes 0 to 29"), "{error}");

    let text = LAB.replacen("frame_rate_hz = 120.0", "frame_rate_hz = 150.0", 1);
    let error = Twin::new(&cylinder(), &TwinOptions::parse(&text, "my.toml").unwrap(), 1).unwrap_err().to_string();
    assert!(error.starts_with("my.toml:") && error.contains("at most 133.333"), "{error}");
}

#[test]
fn an_ideal_twin_is_the_forward_model() {
    let options = coarse("ideal");
    let twin = Twin::new(&cylinder(), &options, 5).unwrap();
    let mut design = cylinder();
    design.mesh = design.mesh.scaled(1.6);
    let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
    let rest = forward.solve(forward.rest_conductivity()).unwrap();
    let worst = |a: &Frame, b: &Frame| a.iter().zip(b.iter()).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
    let apart = worst(&twin.frame(&[], 3).unwrap(), &rest);
    println!("ideal twin against the forward model: {apart:.1e}");
    assert!(apart < 1e-12);

    let touch =
        crate::touch::GaussianTouch { centre_m: press(0.14, 1.0, 2.0).centre_m, amplitude: 1.0, width_m: 0.008 };
    let conductivity = crate::touch::touched_conductivity(
        forward.mesh(),
        &design.body.surface(),
        design.sheet.touch,
        forward.rest_conductivity(),
        &[touch],
    );
    let touched = forward.solve(&conductivity.unwrap()).unwrap();
    assert!(worst(&twin.clean(&[press(0.14, 1.0, 2.0)]).unwrap(), &touched) < 1e-12);
    assert!(relative(&touched, &rest) > 1e-4);
}

#[test]
fn a_twin_is_drawn_from_its_seed_and_never_on_the_designs_own_mesh() {
    let mut options = coarse("lab");
    options.touch = coarse("ideal").touch;
    let twin = Twin::new(&cylinder(), &options, 5).unwrap();
    let again = Twin::new(&cylinder(), &options, 5).unwrap();
    let presses = [press(0.1, 0.3, 2.0)];
    assert_eq!(twin.frame(&presses, 8).unwrap(), again.frame(&presses, 8).unwrap());
    assert_eq!(twin.mesh().hash(), again.mesh().hash());
    let other = Twin::new(&cylinder(), &options, 6).unwrap();
    assert!(relative(&other.clean(&[]).unwrap(), &twin.clean(&[]).unwrap()) > 0.01);
    let design = cylinder();
    assert_ne!(twin.mesh().hash(), Mesh::generate(&design).unwrap().hash());

    let threads: Vec<Frame> = std::thread::scope(|scope| {
        let work: Vec<_> = (0..4).map(|_| scope.spawn(|| twin.frame(&presses, 8).unwrap())).collect();
        work.into_iter().map(|work| work.join().unwrap()).collect()
    });
    assert!(threads.iter().all(|frame| *frame == threads[0]));
    assert_eq!(threads[0], again.frame(&presses, 8).unwrap());
}

/// Statistics over many seeds: the root mean squares are the specified ones.
#[test]
fn imperfections_have_the_size_that_is_stated() {
    let (design, lab) = (cylinder(), TwinOptions::shipped("lab").unwrap());
    let surface = design.body.surface();
    let mut coarse = design.clone();
    coarse.mesh = coarse.mesh.scaled(3.0);
    let mesh = Mesh::generate(&coarse).unwrap();
    let (mut inner, mut rim, mut contacts, mut coat) = (vec![], vec![], vec![], vec![]);
    for seed in 0..60 {
        let drawn = lab.electrodes.draw(&design, seed).unwrap();
        for (before, after) in design.electrodes.iter().zip(&drawn.electrodes) {
            let [round, along] = surface.chart(before.centre_m, after.centre_m);
            if before.centre_m[2] == 0.0 || before.centre_m[2] == 0.3 {
                assert_eq!(along, 0.0, "a half disc stays on its rim");
                rim.push(round);
            } else {
                inner.push(round.hypot(along));
            }
            contacts.push(after.contact_impedance / before.contact_impedance - 1.0);
        }
        coat.extend(lab.coat.draw(surface, &mesh, seed).unwrap().into_iter().map(|factor| factor - 1.0));
    }
    let rms = |values: &[f64]| (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    println!(
        "electrodes {:.3} mm, on the rims {:.3} mm; contacts {:.3}, mean {:+.3}; coat {:.3}, mean {:+.3}",
        1e3 * rms(&inner),
        1e3 * rms(&rim),
        rms(&contacts),
        mean(&contacts),
        rms(&coat),
        mean(&coat)
    );
    assert!((rms(&inner) / 0.0005 - 1.0).abs() < 0.06 && (rms(&rim) / 0.0005 - 1.0).abs() < 0.1);
    assert!((rms(&contacts) / 0.30 - 1.0).abs() < 0.08 && mean(&contacts).abs() < 0.02);
    // A coating of 300 x 314 mm contains about 20 areas of its correlation length: 60 coatings determine 10 % to 0.003.
    assert!((rms(&coat) / 0.10 - 1.0).abs() < 0.08 && mean(&coat).abs() < 0.01);
}

/// The resistance between two electrodes.
fn between(twin: &Twin, [a, b]: [usize; 2]) -> f64 {
    let s = &twin.untouched().transfer_impedance;
    s.at(a, a) - 2.0 * s.at(a, b) + s.at(b, b)
}

fn with_faults(faults: FaultOptions) -> Twin {
    Twin::new(&cylinder(), &TwinOptions { faults, ..coarse("ideal") }, 1).unwrap()
}

#[test]
fn faults_do_what_their_names_say() {
    let sound = with_faults(FaultOptions::default());
    let dead = with_faults(FaultOptions { dead_electrodes: vec![7], ..FaultOptions::default() });
    assert!(between(&dead, [7, 8]) > 1e6 && (between(&dead, [12, 13]) / between(&sound, [12, 13]) - 1.0).abs() < 0.01);
    let torn = with_faults(FaultOptions { torn_wires: vec![7], ..FaultOptions::default() });
    assert!(between(&torn, [7, 8]) > 1e7);
    // The electrode itself is still on the coating: other pairs are not affected by the broken wire.
    assert!((between(&torn, [12, 13]) / between(&sound, [12, 13]) - 1.0).abs() < 1e-9);
    let loose = FaultOptions { loose_electrodes: vec![7], loose_factor: 1e4, ..FaultOptions::default() };
    let more = between(&with_faults(loose), [7, 8]) - between(&sound, [7, 8]);
    // A contact of 2e-5 * 1e4 ohm m2 under a disc of 4 mm.
    println!("a loose contact adds {more:.0} ohm of {:.0}", 0.2 / (TAU / 2.0 * 1.6e-5));
    assert!(more > 0.5 * 0.2 / (TAU / 2.0 * 1.6e-5) && more < 1.1 * 0.2 / (TAU / 2.0 * 1.6e-5));

    // A cut all the way around at half the length: no current crosses it; a cut of the same length across the seam is
    // crossed.
    let cut = |from_m, to_m| {
        let cuts = vec![CutOptions { from_m, to_m }];
        with_faults(FaultOptions { cuts, ..FaultOptions::default() })
    };
    let round_m = TAU * 0.05;
    assert!(between(&cut([0.15, 0.0], [0.15, round_m]), [2, 27]) > 1e6);
    assert!(between(&cut([0.15, 0.5 * round_m], [0.15, 1.5 * round_m]), [2, 27]) > 1e6, "over the seam");
    let partial = between(&cut([0.15, 0.1], [0.15, 0.15]), [2, 27]) / between(&sound, [2, 27]);
    assert!(partial > 1.001 && partial < 2.0, "{partial}");
    let shorts = vec![ShortOptions { electrodes: [7, 19], ohm: 2.0 }];
    let short = with_faults(FaultOptions { shorts, ..FaultOptions::default() });
    assert!((1.0 / between(&short, [7, 19]) - 1.0 / between(&sound, [7, 19]) - 0.5).abs() < 1e-9);
    let exchanged = with_faults(FaultOptions { exchanged_wires: vec![[7, 19]], ..FaultOptions::default() });
    assert!((between(&exchanged, [7, 8]) / between(&sound, [19, 8]) - 1.0).abs() < 1e-9);
    for twin in [&dead, &torn] {
        assert!(twin.frame(&[], 0).unwrap().iter().all(|value| value.is_finite()));
    }
}

/// The instrument takes a resistor of another value for the expected one: the current is read wrongly by their ratio, and
/// so are the values of the drive, whatever the current is.
#[test]
fn another_reference_resistor_divides_the_values_of_its_drive() {
    let sound = with_faults(FaultOptions::default()).frame(&[], 0).unwrap();
    let references = vec![ReferenceOptions { drive: Some(4), factor: 1.25 }];
    let one = with_faults(FaultOptions { references, ..FaultOptions::default() }).frame(&[], 0).unwrap();
    let references = vec![ReferenceOptions { drive: None, factor: 1.25 }];
    let all = with_faults(FaultOptions { references, ..FaultOptions::default() }).frame(&[], 0).unwrap();
    // The adjacent protocol has 29 values for each drive.
    for (channel, value) in sound.iter().enumerate() {
        let expected = if channel / 29 == 4 { value / 1.25 } else { *value };
        assert!((one[channel] - expected).abs() < 1e-9 * value.abs(), "channel {channel}");
        assert!((all[channel] - value / 1.25).abs() < 1e-9 * value.abs(), "channel {channel}");
    }
}

#[test]
fn a_torn_wire_reads_noise_and_never_infinity() {
    let mut options = coarse("lab");
    options.touch = coarse("ideal").touch;
    options.faults.torn_wires = vec![4];
    let twin = Twin::new(&cylinder(), &options, 1).unwrap();
    let frame = twin.frame(&[], 0).unwrap();
    assert!(frame.iter().all(|value| value.is_finite()));
    let clean = twin.clean(&[]).unwrap();
    let of_drive = |drive: usize| {
        let channels = twin.design().protocol.channels().iter().enumerate();
        let own = channels.filter(|(_, c)| c.drive[0] == drive && !c.touches_driven());
        own.map(|(index, _)| (frame[index] - clean[index]).abs()).fold(0.0, f64::max)
    };
    assert!(of_drive(4) > 20.0 * of_drive(12), "{} against {}", of_drive(4), of_drive(12));
}

#[test]
fn drift_begins_at_nothing_and_ends_at_its_amplitude() {
    let mut options = coarse("ideal");
    options.drift = Some(DriftOptions { conductance_rms: 0.02, contact_rms: 0.2, time_constant_s: 10.0 });
    let twin = Twin::new(&cylinder(), &options, 9).unwrap();
    let (clean, frame) = (twin.clean(&[]).unwrap(), |index| twin.frame(&[], index).unwrap());
    assert!(relative(&frame(0), &clean) < 1e-9);
    let (middle, late, later) = (frame(1200), frame(120_000), frame(240_000));
    assert!(relative(&late, &later) < 1e-9 && relative(&late, &clean) > 1e-4);
    let undriven =
        |frame: &Frame| twin.design().protocol.undriven().map(|channel| frame[channel]).collect::<Vec<f64>>();
    // Values without a driven electrode depend only on the coating: after one time constant 63 % of the change.
    let share = |frame: &Frame| undriven(&clean)[5] / undriven(frame)[5] - 1.0;
    assert!((share(&middle) / share(&late) - (1.0 - (-1f64).exp())).abs() < 1e-6);

    let mut options = coarse("ideal");
    options.temperature = Some(TemperatureOptions { coefficient_per_k: -2e-3, change_k: 5.0, rate_k_per_s: 0.5 });
    let warm = Twin::new(&cylinder(), &options, 9).unwrap().frame(&[], 1200).unwrap();
    let cold = Twin::new(&cylinder(), &coarse("ideal"), 9).unwrap().clean(&[]).unwrap();
    // 5 K and 10 s at 0.5 K/s: the coating's conductance is 2 % lower.
    assert!(warm.iter().zip(cold.iter()).all(|(warm, cold)| (warm * 0.98 / cold - 1.0).abs() < 1e-9));
}

#[test]
fn a_twin_without_patches_where_they_cannot_be_or_would_turn_a_touch_round() {
    let lab = TwinOptions::shipped("lab").unwrap();
    for name in ["cylinder30", "tank16"] {
        assert_eq!(lab.clone().made_of(&SkinDesign::shipped(name).unwrap()), lab);
    }
    let design = SkinDesign::shipped("skin16").unwrap();
    let twin = Twin::new(&design, &lab, 1).unwrap();
    assert_eq!(*twin.options(), lab.made_of(&design));
    let layer = TwinOptions::shipped("lab-c").unwrap().made_of(&design);
    assert_eq!((layer.name.as_str(), &layer.touch), ("lab-c without a layer", &twin.options().touch));
    assert_eq!(twin.options().name, "lab without patches");
    let press = |x_m: f64, force_n: f64| Press { centre_m: [x_m, 0.0, 0.0], force_n, tip_radius_m: 0.005 };
    // A membrane has a lower conductance where it is pressed: equal or higher voltage between all neighbours of a
    // drive's electrodes.
    let [rest, soft, firm] = [vec![], vec![press(0.0, 1.0)], vec![press(0.0, 5.0)]].map(|presses| {
        let frame = twin.clean(&presses).unwrap();
        frame.iter().map(|value| value.abs()).sum::<f64>()
    });
    assert!(rest < soft && soft < firm, "{rest} {soft} {firm} ohm");
}

#[test]
fn a_touch_that_is_held_is_what_a_fresh_twin_says_of_it() {
    let design = SkinDesign::shipped("skin16").unwrap();
    let options = TwinOptions::shipped("lab").unwrap();
    let twin = || Twin::new(&design, &options, 3).unwrap();
    let press = |x_m: f64| Press { centre_m: [x_m, 0.01, 0.0], force_n: 2.0, tip_radius_m: 0.005 };
    let held = twin();
    for presses in [vec![press(0.0)], vec![press(0.0)], vec![press(0.01)], vec![], vec![press(0.0), press(0.01)]] {
        assert_eq!(held.clean(&presses).unwrap(), twin().clean(&presses).unwrap());
    }
}

/// The curve of releasing presses is above that of loading ones, and a released skin has no history.
#[test]
fn contacts_with_hysteresis_depend_on_earlier_frames() {
    let mut options = coarse("lab");
    let TouchOptions::Patches(patches) = &mut options.touch else { panic!("`lab` has patches") };
    patches.contact.hysteresis = 0.3;
    let twin = Twin::new(&cylinder(), &options, 3).unwrap();
    let rest = twin.readings(&[], 0).unwrap().values_v;
    let mut history = ContactHistory::default();
    let mut change = |force_n: f64| {
        let presses: Vec<Press> = (force_n > 0.0).then(|| press(0.14, 1.0, force_n)).into_iter().collect();
        let values_v = twin.readings_after(&presses, &mut history, 0).unwrap().values_v;
        values_v.iter().zip(&rest).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let [up, highest, held, down] = [1.0, 4.0, 4.0, 1.0].map(&mut change);
    println!("1 N after 4 N changes the readings {:.2} times as much as before", down / up);
    assert!(down > 1.05 * up && down < highest);
    assert_eq!((held, change(1.0)), (highest, down), "a held press stays as it is");
    assert_eq!([change(0.0), change(1.0)], [0.0, up], "let go, the contact forgets");
}
