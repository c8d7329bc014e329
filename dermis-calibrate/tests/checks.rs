//! Checks of recordings with one fault each, and of sound ones.

use crate::recordings::{CYLINDER, DISK12, STRIP, Sound, press_positions, simulated};
use dermis::finding::{Finding, FindingKind};
use dermis::frame::{Frame, Truth, read_frames, read_truth};
use dermis::geom::{PlaceLimits, Point3, Surface};
use dermis::skin::Skin;
use dermis_calibrate::checks::{Recording, check_recording, realigned};
use dermis_calibrate::{Calibration, Label, LabelFrame};
use std::sync::LazyLock;

/// Presses on a disk with 12 electrodes, simulated once for all tests.
fn disk() -> Sound {
    static DISK: LazyLock<Sound> =
        LazyLock::new(|| simulated("disk", &Skin::parse(DISK12, "disk12.toml").unwrap(), 41, 240, 65.0, false));
    DISK.clone()
}

/// The only fault.
fn only(sound: &Sound) -> Finding {
    let checked = sound.check();
    let faults: Vec<&Finding> = checked.faults().collect();
    assert_eq!(faults.len(), 1, "{faults:?}");
    faults[0].clone()
}

#[test]
fn a_sound_recording_has_no_findings() {
    let mut sound = disk();
    assert_eq!(sound.check().findings, vec![]);
    let baseline = dermis::frame::mean(&sound.untouched).unwrap();
    sound.frames.iter_mut().for_each(|frame| *frame = &*frame - &baseline);
    sound.untouched.clear();
    assert_eq!(sound.check().findings, vec![]);
    // Too few rows for statistics.
    sound.frames.truncate(5);
    assert_eq!(sound.check().findings, vec![]);
}

#[test]
fn the_order_of_pyeit_is_named() {
    let skin = Skin::load("tank16").unwrap();
    let rest = Frame(skin.forward().solve(skin.forward().rest_conductivity()).unwrap().0);
    // pyEIT measures V[m + 1] - V[m].
    let reversed = vec![Frame(rest.iter().map(|value| -value).collect())];
    let sound = Sound { name: "", skin: skin.clone(), frames: reversed.clone(), untouched: reversed, first: 0 };
    let found = only(&sound);
    assert!(found.kind == FindingKind::SignTurned && found.value < -0.999, "{found:?}");
    assert_eq!(found.fix, "set protocol.measures_reversed = true");
    // Its default order of the measurements starts at electrode 0; the design says that it starts at the drive.
    let channels = skin.design().protocol.channels();
    let mut order: Vec<usize> = (0..rest.len()).collect();
    order.sort_by_key(|&channel| (channels[channel].drive[0], channels[channel].measure[0]));
    let frames = vec![Frame(order.iter().map(|&channel| rest[channel]).collect())];
    let found = only(&Sound { frames: frames.clone(), untouched: frames, ..sound });
    assert_eq!((found.kind, &found.fix[..]), (FindingKind::Order, "set protocol.measures_start = \"electrode_zero\""));
}

#[test]
fn measures_reversed_in_the_design_alone_is_named_without_a_baseline() {
    let sound = disk();
    let baseline = dermis::frame::mean(&sound.untouched).unwrap();
    let text = DISK12.replace("pattern.skip = 3", "pattern.skip = 3\nmeasures_reversed = true");
    let skin = Skin::parse(&text, "disk12.toml").unwrap();
    let frames = sound.frames.iter().map(|frame| frame - &baseline).collect();
    let found = only(&Sound { skin, frames, untouched: Vec::new(), ..sound });
    assert_eq!(found.kind, FindingKind::SignTurned);
    assert!(found.channels.is_empty() && found.fix.starts_with("set protocol.measures_reversed = false"), "{found:?}");
}

#[test]
fn a_thousandth_is_named() {
    let mut sound = disk();
    sound.change(|_, frame| frame.0.iter_mut().for_each(|value| *value *= 1e-3));
    let found = only(&sound);
    assert!(found.kind == FindingKind::Magnitude && found.fix.contains("multiply the values by 1000"), "{found:?}");
}

#[test]
fn late_dead_and_turned_channels_are_named() {
    let mut sound = disk();
    let original = sound.frames.clone();
    for row in 2..original.len() {
        (8..16).for_each(|channel| sound.frames[row][channel] = original[row - 2][channel]);
    }
    sound.change(|_, frame| {
        frame[60] = 0.25;
        (24..32).for_each(|channel| frame[channel] = -frame[channel]);
    });
    let checked = sound.check();
    let found: Vec<(FindingKind, i32, Vec<usize>)> =
        checked.faults().map(|fault| (fault.kind, fault.lag, fault.channels.clone())).collect();
    let expected = [
        (FindingKind::SignTurned, 0, (24..32).collect()),
        (FindingKind::Late, 2, (8..16).collect()),
        (FindingKind::Dead, 0, vec![60]),
    ];
    assert_eq!(found, expected);
    let mended = realigned(&sound.frames, &checked.lags).unwrap();
    assert_eq!(mended[100][15], original[100][15]);
    assert_eq!(mended.len(), original.len());
    let again = Sound { frames: mended, ..sound }.check();
    assert!(again.faults().all(|fault| fault.kind != FindingKind::Late), "{:?}", again.findings);
}

#[test]
fn limits_outliers_and_shifted_truth_are_named() {
    let sound = disk();
    let mut limited = sound.clone();
    let mut sorted: Vec<f64> = sound.frames.iter().map(|frame| frame[7]).collect();
    sorted.sort_by(f64::total_cmp);
    limited.frames.iter_mut().for_each(|frame| frame[7] = frame[7].clamp(sorted[40], sorted[200]));
    let found = only(&limited);
    assert_eq!((found.kind, found.channels), (FindingKind::Saturated, vec![7]));
    let mut spiked = sound.clone();
    spiked.frames[33][9] = 1e6;
    let found = only(&spiked);
    assert_eq!((found.kind, found.channels, found.rows), (FindingKind::OutlierValue, vec![9], vec![33]));
    // The truth of the press after each frame.
    let mut positions_m = press_positions(&sound, 41);
    positions_m.rotate_right(1);
    let recording = Recording {
        frames: &sound.frames,
        untouched: &sound.untouched,
        positions_m: Some(&positions_m),
        label_frame: LabelFrame::Skin,
    };
    let checked = check_recording(&sound.skin, &recording).unwrap();
    let faults: Vec<&Finding> = checked.faults().collect();
    assert_eq!((faults.len(), faults[0].kind, faults[0].lag), (1, FindingKind::TruthShifted, 1), "{faults:?}");
}

#[test]
fn input_that_cannot_be_checked_is_refused() {
    let sound = disk();
    let check = |frames: &[Frame], untouched: &[Frame], positions_m: Option<&[[f64; 3]]>| {
        check_recording(&sound.skin, &Recording { frames, untouched, positions_m, label_frame: LabelFrame::Skin })
            .unwrap_err()
            .to_string()
    };
    assert!(check(&[], &[], None).contains("no frame"));
    assert!(check(&[Frame(vec![0.0; 9])], &[], None).contains("9 channels"));
    let mut frames = sound.frames.clone();
    frames[3][5] = f64::NAN;
    assert!(check(&frames, &[], None).contains("frame 3, channel 5"));
    assert!(check(&sound.frames, &frames, None).contains("untouched frame 3"));
    assert!(check(&sound.frames, &[], Some(&[[0.0; 3]; 7])).contains("7 positions for 240 frames"));
    assert!(realigned(&sound.frames, &[0; 3]).is_err());
}

/// The truth_axes finding of presses at some positions.
fn axes(sound: &Sound, positions_m: &[Point3]) -> Option<Finding> {
    let recording = Recording {
        frames: &sound.frames,
        untouched: &sound.untouched,
        positions_m: Some(positions_m),
        label_frame: LabelFrame::Skin,
    };
    let findings = check_recording(&sound.skin, &recording).unwrap().findings;
    findings.into_iter().find(|finding| finding.kind == FindingKind::TruthAxes)
}

/// A change of positions, and what the fix says of it.
type Change = (fn(Point3) -> Point3, &'static str);

/// Changes of positions on a disk.
const FLAT: [Change; 5] = [
    (|[x, y, z]| [y, x, z], "exchange the columns x_m and y_m of the truth;"),
    (|[x, y, z]| [x, -y, z], "write -y_m in place of y_m in the truth;"),
    (|[x, y, z]| [-x, y, z], "write -x_m in place of x_m in the truth;"),
    (|[x, y, z]| [-x, -y, z], "write -x_m in place of x_m in the truth, write -y_m"),
    (|[x, y, z]| [-y, x, z], "exchange the columns x_m and y_m of the truth, then write -y_m"),
];

/// Presses with the right axes, and with others.
fn check_axes(sound: &Sound, positions_m: &[Point3], changes: &[Change]) {
    let name = sound.name;
    assert_eq!(axes(sound, positions_m), None, "{name}");
    // Those of the first 30 presses, and of presses on one part of the skin.
    let few = Sound { frames: sound.frames[..30].to_vec(), ..sound.clone() };
    assert_eq!(axes(&few, &positions_m[..30]), None, "{name}");
    for (change, fix) in changes {
        let changed: Vec<Point3> = positions_m.iter().map(|position_m| change(*position_m)).collect();
        for (sound, changed) in [(sound, &changed[..]), (&few, &changed[..30])] {
            let found = axes(sound, changed).unwrap_or_else(|| panic!("{name}: {fix}"));
            assert!(found.fix.starts_with(fix), "{name}: {fix}: {}", found.fix);
        }
    }
}

#[test]
fn reversed_and_exchanged_axes_of_a_disk_are_named() {
    let sound = disk();
    check_axes(&sound, &press_positions(&sound, 41), &FLAT);
    check_axes(
        &sound,
        &press_positions(&sound, 41),
        &[(turned, "turn the positions by about -45 degrees about the middle")],
    );
}

/// A position turned by 45 degrees about the axis z.
fn turned([x, y, z]: Point3) -> Point3 {
    let (sin, cos) = 45_f64.to_radians().sin_cos();
    [cos * x - sin * y, sin * x + cos * y, z]
}

#[test]
fn reversed_axes_of_a_rectangle_and_a_cylinder_are_named() {
    let text = DISK12.replace("[body.disk]\ndiameter_m = 0.08", "[body.rectangle]\nwidth_m = 0.10\nheight_m = 0.06");
    let sound = simulated("rectangle", &Skin::parse(&text, "rectangle12.toml").unwrap(), 42, 160, 65.0, true);
    let changes: [Change; 2] = [
        (|[x, y, z]| [x, 0.06 - y, z], "write height_m - y_m in place of y_m in the truth;"),
        (|[x, y, z]| [0.1 - x, y, z], "write width_m - x_m in place of x_m in the truth;"),
    ];
    check_axes(&sound, &press_positions(&sound, 42), &changes);
    let sound = simulated("cylinder", &Skin::parse(CYLINDER, "cylinder12.toml").unwrap(), 43, 160, 65.0, false);
    let changes: [Change; 2] = [
        (|[x, y, z]| [x, y, 0.12 - z], "write length_m - z_m in place of z_m in the truth;"),
        (|[x, y, z]| [x, -y, z], "write -theta_rad in place of theta_rad in the truth;"),
    ];
    check_axes(
        &sound,
        &press_positions(&sound, 43),
        &[(turned, "turn the positions by about -45 degrees about the axis")],
    );
    check_axes(&sound, &press_positions(&sound, 43), &changes);
}

#[test]
fn axes_that_the_frames_cannot_tell_are_not_named() {
    // All electrodes on the line y = height / 2: presses at both sides of it give the same frames.
    let skin = Skin::parse(STRIP, "strip.toml").unwrap();
    let sound = simulated("strip", &skin, 44, 160, 65.0, true);
    let positions_m = press_positions(&sound, 44);
    let across: Vec<Point3> = positions_m.iter().map(|[x, y, z]| [*x, 0.06 - y, *z]).collect();
    assert_eq!(axes(&sound, &across), None);
    // Positions in a robot's frame have a pose; noise has no positions.
    let disk = disk();
    let turned: Vec<Point3> = press_positions(&disk, 41).iter().map(|[x, y, z]| [*x, -y, *z]).collect();
    let recording = Recording {
        frames: &disk.frames,
        untouched: &disk.untouched,
        positions_m: Some(&turned),
        label_frame: LabelFrame::Robot,
    };
    let found = check_recording(&disk.skin, &recording).unwrap();
    assert!(found.findings.iter().all(|finding| finding.kind != FindingKind::TruthAxes));
}

/// Real membranes, whose coat the even model describes roughly: their presses on the skin, by the estimated pose.
#[test]
fn reversed_axes_of_real_membranes_are_named_or_not_judged() {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let folder = std::path::PathBuf::from(std::env::var("DERMIS_DATA").unwrap_or(default.into())).join("skins_real");
    if !folder.is_dir() {
        println!("skipped: there is no {} (DERMIS_DATA names the folder above it)", folder.display());
        return;
    }
    for (name, named) in [("noPattern", true), ("parallel", false)] {
        let skin = Skin::load("skin16").unwrap();
        let frames = read_frames(&folder.join(format!("inp_{name}.csv")), &skin.design().protocol).unwrap();
        let limits = PlaceLimits::of_box(Surface::Plane, [[0.0; 3]], 0.04);
        let truth = read_truth(&folder.join(format!("out_{name}.csv")), &limits, frames.len()).unwrap();
        let Truth::Elsewhere { positions_m: presses, .. } = truth else { panic!("presses in a robot's frame") };
        let label = |row: usize| Label { row, position_m: presses[row], force_n: f64::NAN };
        let labels: Vec<Label> = (0..120).map(label).collect();
        let calibration = Calibration::fit(&skin, &frames[..120], &labels, LabelFrame::Robot).unwrap();
        let pose = calibration.pose().unwrap();
        // The estimated pose is some millimetres off: a few presses would lie outside.
        let on_disk = |press: &Point3| {
            let [x, y, _] = pose.to_skin(*press);
            let inwards = (0.0399 / x.hypot(y)).min(1.0);
            [inwards * x, inwards * y, 0.0]
        };
        let positions_m: Vec<Point3> = presses.iter().map(on_disk).collect();
        let sound = Sound { name: "membrane", skin, frames, untouched: Vec::new(), first: 0 };
        assert_eq!(axes(&sound, &positions_m), None, "{name}");
        for (change, fix) in FLAT {
            let changed: Vec<Point3> = positions_m.iter().map(|position_m| change(*position_m)).collect();
            let found = axes(&sound, &changed);
            assert!(found.as_ref().is_none_or(|found| found.fix.starts_with(fix)), "{name}: {found:?}");
            assert!(found.is_some() || !named, "{name}: {fix}");
        }
    }
}
