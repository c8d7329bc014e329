//! Checks of recordings that were corrupted on purpose: late channels, another order, signs, dead channels.
//!
//! `cargo test --release -p dermis-calibrate --test corrupted_recordings -- --ignored --nocapture` prints the table of
//! `docs/check-frames.md`. The corruptions follow from a seed; the method was developed on other seeds than those of the table.

use dermis::frame::{Frame, read_frames};
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis_calibrate::checks::{Checked, Finding, FindingKind, Recording, check_recording, realigned};
use dermis_sim::noise::Noise;
use dermis_sim::random::{log_uniform, sample_rng, uniform};
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Recordings for the table, and the first of their seeds.
const RECORDINGS: u64 = 50;
const SEED: u64 = 7000;
/// Channels of the real recordings that are measured while the robot moves: partly late, partly noise. Findings on them alone do
/// not count.
const MOVING: usize = 36;

/// A recording that is sound.
#[derive(Clone)]
struct Sound {
    name: &'static str,
    skin: Skin,
    frames: Vec<Frame>,
    /// Raw untouched frames; empty for a recording of differences.
    untouched: Vec<Frame>,
    /// Channels before this one are not judged.
    first: usize,
}

impl Sound {
    fn check(&self) -> Checked {
        let recording = Recording { frames: &self.frames, untouched: &self.untouched, positions_m: None };
        check_recording(&self.skin, &recording).unwrap()
    }

    fn channels(&self) -> usize {
        self.frames[0].len()
    }

    /// The drives with judged channels, as ranges of channels.
    fn drives(&self) -> Vec<Vec<usize>> {
        let (drives, of_channel) = self.skin.design().protocol.drives();
        let group =
            |drive: usize| (self.first..self.channels()).filter(|&c| of_channel[c] == drive).collect::<Vec<_>>();
        (0..drives.len()).map(group).filter(|group| !group.is_empty()).collect()
    }

    fn change(&mut self, change: impl Fn(usize, &mut Frame)) {
        self.frames.iter_mut().chain(&mut self.untouched).enumerate().for_each(|(row, frame)| change(row, frame));
    }
}

/// A real membrane, realigned; `None` where the recordings are not there.
fn real(name: &'static str) -> Option<Sound> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let folder = PathBuf::from(std::env::var("DERMIS_DATA").unwrap_or(default.into())).join("skins_real");
    if !folder.is_dir() {
        println!("skipped: there is no {} (DERMIS_DATA names the folder above it)", folder.display());
        return None;
    }
    let skin = Skin::load("skin16").unwrap();
    let frames = read_frames(&folder.join(format!("inp_{name}.csv")), &skin.design().protocol).unwrap();
    let lags: Vec<i32> = (0..192).map(|channel| i32::from(channel < 24)).collect();
    let frames = realigned(&frames, &lags).unwrap();
    Some(Sound { name, skin, frames, untouched: Vec::new(), first: MOVING })
}

/// A disk with 12 electrodes; drives d to d + 4, so that the values have both signs.
const DISK12: &str = r#"
name = "disk12"
[body.disk]
diameter_m = 0.08
[sheet]
sheet_resistance_ohm = 1000.0
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.006
contact_impedance_ohm_m = 0.002
layout.rim.count = 12
[protocol]
pattern.skip = 3
[image.grid]
rows = 24
columns = 24
[mesh]
max_edge_m = 0.005
electrode_edge_m = 0.0015
"#;

/// Single presses of random place, strength and size on a skin with a slightly uneven coat, with white noise, and 50 untouched
/// frames.
fn simulated(name: &'static str, skin: &Skin, seed: u64, presses: usize, snr_db: f64, difference: bool) -> Sound {
    let (design, mesh, pixels) = (skin.design(), skin.mesh(), skin.pixels());
    let surface = design.body.surface();
    let rest = skin.forward().rest_conductivity();
    let mut rng = sample_rng(seed, 0);
    let area_m = pixels.areas.iter().sum::<f64>().sqrt();
    let mut bump = || GaussianTouch {
        centre_m: place(skin, &mut rng),
        amplitude: uniform(&mut rng, [0.0, 0.3]),
        width_m: 0.3 * area_m,
    };
    let bumps: Vec<GaussianTouch> = (0..3).map(|_| bump()).collect();
    let coat = touched_conductivity(mesh, &surface, design.sheet.touch, rest, &bumps).unwrap();
    let clean = Frame(skin.forward().solve(&coat).unwrap().0);
    let noise = Noise::at_snr_db(snr_db, &clean, &design.protocol, 1000.0).unwrap();
    let drive_of = design.protocol.drives().1;
    let press = |row: usize| {
        let mut rng = sample_rng(seed, 1 + row as u64);
        let centre_m = place(skin, &mut rng);
        let (amplitude, width_m) = (log_uniform(&mut rng, [0.2, 2.0]), area_m * uniform(&mut rng, [0.05, 0.1]));
        let touch = GaussianTouch { centre_m, amplitude, width_m };
        let touched = touched_conductivity(mesh, &surface, design.sheet.touch, &coat, &[touch]).unwrap();
        noise.apply(&skin.forward().solve(&touched).unwrap(), &drive_of, &mut rng)
    };
    let mut frames: Vec<Frame> = (0..presses).into_par_iter().map(press).collect();
    let mut rng = sample_rng(seed, 1_000_000);
    let mut untouched: Vec<Frame> = (0..50).map(|_| noise.apply(&clean, &drive_of, &mut rng)).collect();
    if difference {
        let baseline = dermis::frame::mean(&untouched).unwrap();
        frames = frames.iter().map(|frame| frame - &baseline).collect();
        untouched = Vec::new();
    }
    Sound { name, skin: skin.clone(), frames, untouched, first: 0 }
}

/// The positions of the presses of [`simulated`].
fn press_positions(sound: &Sound, seed: u64) -> Vec<Point3> {
    (0..sound.frames.len()).map(|row| place(&sound.skin, &mut sample_rng(seed, 1 + row as u64))).collect()
}

/// A random place on a skin.
fn place(skin: &Skin, rng: &mut impl Rng) -> Point3 {
    skin.pixels().centres_m[uniform(rng, [0.0, skin.pixels().len() as f64]) as usize]
}

/// What a check should find.
#[derive(Debug, Clone)]
struct Expected {
    kind: FindingKind,
    /// Channels with their lag (0 for other kinds); empty for all.
    channels: BTreeMap<usize, i32>,
    /// For another order, the original channel of each column.
    originals: Vec<usize>,
    what: String,
}

/// Some of the judged drives or channels.
fn chosen(sound: &Sound, rng: &mut impl Rng) -> Vec<usize> {
    let mut drives = sound.drives();
    drives.shuffle(rng);
    if rng.random_bool(0.5) {
        let count = rng.random_range(1..=3);
        return drives.into_iter().take(count).flatten().collect();
    }
    let mut channels: Vec<usize> = drives.concat();
    channels.shuffle(rng);
    channels.truncate(rng.random_range(1..=sound.channels() / 8));
    channels
}

fn late(sound: &mut Sound, rng: &mut impl Rng) -> Expected {
    let channels = chosen(sound, rng);
    let lag = rng.random_range(1..=3usize);
    let original = sound.frames.clone();
    for row in lag..original.len() {
        channels.iter().for_each(|&channel| sound.frames[row][channel] = original[row - lag][channel]);
    }
    let what = format!("{} channels {lag} late", channels.len());
    let channels = channels.into_iter().map(|channel| (channel, lag as i32)).collect();
    Expected { kind: FindingKind::Late, channels, originals: Vec::new(), what }
}

fn dead(sound: &mut Sound, rng: &mut impl Rng) -> Expected {
    let channels = chosen(sound, rng);
    let noise = rng.random_bool(0.5);
    for &channel in &channels {
        let values: Vec<f64> = sound.frames.iter().map(|frame| frame[channel]).collect();
        let (mean, sd) = dermis::stats::mean_and_sd(&values);
        let level = if noise { log_uniform(rng, [0.01, 0.1]) * sd } else { 0.0 };
        let mut value = || mean * f64::from(u8::from(noise)) + level * dermis_sim::random::standard_normal(rng);
        sound.frames.iter_mut().chain(&mut sound.untouched).for_each(|frame| frame[channel] = value());
    }
    let what = format!("{} channels {}", channels.len(), if noise { "noise" } else { "constant" });
    let channels = channels.into_iter().map(|channel| (channel, 0)).collect();
    Expected { kind: FindingKind::Dead, channels, originals: Vec::new(), what }
}

fn signs(sound: &mut Sound, rng: &mut impl Rng) -> Expected {
    let nothing = Expected {
        kind: FindingKind::SignTurned,
        channels: BTreeMap::new(),
        originals: Vec::new(),
        what: String::new(),
    };
    match rng.random_range(0..3) {
        // The untouched values of `tank16` have one sign, so that amplitudes are only turned values.
        0 if sound.untouched.is_empty() || sound.skin.design().name == "disk12" => {
            sound.change(|_, frame| frame.0.iter_mut().for_each(|value| *value = value.abs()));
            Expected { kind: FindingKind::SignLost, what: "absolute values".into(), ..nothing }
        }
        1 if !sound.untouched.is_empty() => {
            sound.change(|_, frame| frame.0.iter_mut().for_each(|value| *value = -*value));
            Expected { what: "all signs turned".into(), ..nothing }
        }
        _ => {
            let mut drives = sound.drives();
            drives.shuffle(rng);
            let count = rng.random_range(1..=2);
            let channels: Vec<usize> = drives.into_iter().take(count).flatten().collect();
            sound.change(|_, frame| channels.iter().for_each(|&channel| frame[channel] = -frame[channel]));
            let what = format!("{count} drives turned");
            Expected { channels: channels.into_iter().map(|channel| (channel, 0)).collect(), what, ..nothing }
        }
    }
}

/// Another order: the measurements of each drive rotated or reversed, drives rotated, reversed or exchanged.
fn permutation(sound: &mut Sound, rng: &mut impl Rng) -> Expected {
    let (drives, of_channel) = sound.skin.design().protocol.drives();
    let mut blocks = vec![Vec::new(); drives.len()];
    of_channel.iter().enumerate().for_each(|(channel, &drive)| blocks[drive].push(channel));
    let (count, electrodes) = (blocks.len(), sound.skin.design().protocol.electrode_count());
    let what = match rng.random_range(0..5) {
        0 => {
            let (from, at_drive) = (rng.random_range(1..electrodes), rng.random_bool(0.5));
            let channels = sound.skin.design().protocol.channels();
            for block in &mut blocks {
                block.sort_by_key(|&c| {
                    let start = from + if at_drive { channels[c].drive[0] } else { 0 };
                    let [a, b] = channels[c].measure;
                    let first = if (b + 1) % electrodes == a { b } else { a };
                    (first + 2 * electrodes - start) % electrodes
                });
            }
            format!("measurements from {}{from}", if at_drive { "the drive + " } else { "" })
        }
        1 => {
            blocks.iter_mut().for_each(|block| block.reverse());
            "measurements reversed".to_string()
        }
        2 => {
            let by = rng.random_range(1..count);
            blocks.rotate_left(by);
            format!("drives rotated by {by}")
        }
        3 => {
            blocks.reverse();
            "drives reversed".to_string()
        }
        _ => {
            let (a, b) = (rng.random_range(0..count), rng.random_range(1..count));
            blocks.swap(a, (a + b) % count);
            format!("drives {a} and {} exchanged", (a + b) % count)
        }
    };
    let originals = blocks.concat();
    sound.change(|_, frame| *frame = Frame(originals.iter().map(|&channel| frame[channel]).collect()));
    Expected { kind: FindingKind::Order, channels: BTreeMap::new(), originals, what }
}

fn corrupt(sound: &mut Sound, number: u64, rng: &mut impl Rng) -> Expected {
    match number % 4 {
        0 => late(sound, rng),
        1 => permutation(sound, rng),
        2 => signs(sound, rng),
        _ => dead(sound, rng),
    }
}

/// The faults that count: kinds with their judged channels.
fn judged(checked: &Checked, first: usize) -> Vec<(FindingKind, i32, Vec<usize>)> {
    let own = |channels: &[usize]| channels.iter().copied().filter(|channel| *channel >= first).collect::<Vec<_>>();
    let faults = checked.faults().map(|fault| (fault.kind, fault.lag, fault.channels.is_empty(), own(&fault.channels)));
    faults
        .filter(|(_, _, all, channels)| *all || !channels.is_empty())
        .map(|(kind, lag, _, own)| (kind, lag, own))
        .collect()
}

/// Whether an order is that of the corruption, up to the symmetries of the model.
fn same_order(checked: &Checked, originals: &[usize]) -> bool {
    let all: Vec<usize> = (0..originals.len()).collect();
    let columns = if checked.columns.is_empty() { &all } else { &checked.columns };
    let found: Vec<usize> = columns.iter().map(|&column| originals[column]).collect();
    let model = &checked.figures.model_correlation;
    let (mut apart, mut size) = (0.0, 0.0);
    for a in 0..found.len() {
        for b in 0..a {
            apart += (model[a][b].abs() - model[found[a]][found[b]].abs()).powi(2);
            size += model[a][b].powi(2);
        }
    }
    if apart >= 0.02 * size {
        println!("   order: {apart:.2} of {size:.2} differ");
    }
    apart < 0.02 * size
}

/// Whether the faults are those of the corruption: the same kind, nothing else, and nine tenths of the channels with their lag.
fn is_right(sound: &Sound, checked: &Checked, expected: &Expected) -> bool {
    let found = judged(checked, sound.first);
    if expected.kind == FindingKind::Order {
        // Channels that are not judged are now in other columns.
        let is_judged = |columns: &[usize]| columns.iter().any(|&column| expected.originals[column] >= sound.first);
        let named = found.iter().all(|(kind, _, own)| *kind == FindingKind::Order || !is_judged(own));
        return named && same_order(checked, &expected.originals);
    }
    let kinds = !found.is_empty() && found.iter().all(|(kind, ..)| *kind == expected.kind);
    if expected.channels.is_empty() {
        return kinds && found.iter().all(|(_, _, channels)| channels.is_empty());
    }
    let channels: BTreeMap<usize, i32> =
        found.iter().flat_map(|(_, lag, channels)| channels.iter().map(move |&channel| (channel, *lag))).collect();
    let both = channels.iter().filter(|(channel, lag)| expected.channels.get(channel) == Some(lag)).count();
    let either = channels.len() + expected.channels.len() - both;
    kinds && 10 * both >= 9 * either
}

/// A part of a recording with this many rows and more.
fn part(sound: &Sound, least: usize, rng: &mut impl Rng) -> Sound {
    let rows = sound.frames.len();
    let count = if rows > least { rng.random_range(least..=rows) } else { rows };
    let first = rng.random_range(0..=rows - count);
    Sound { frames: sound.frames[first..first + count].to_vec(), ..sound.clone() }
}

/// Sound recordings: real ones where they are there, and simulated ones.
fn bases(seed: u64) -> Vec<Sound> {
    let mut bases: Vec<Sound> = ["noPattern", "parallel"].into_iter().filter_map(real).collect();
    let tank = Skin::load("tank16").unwrap();
    let disk = Skin::parse(DISK12, "disk12.toml").unwrap();
    bases.push(simulated("simulated, undriven", &tank, seed, 500, 70.0, false));
    bases.push(simulated("simulated, differences", &tank, seed + 1, 500, 65.0, true));
    bases.push(simulated("simulated, skip 3", &disk, seed + 2, 500, 65.0, false));
    bases
}

/// Presses on a disk with 12 electrodes.
fn disk() -> Sound {
    simulated("disk", &Skin::parse(DISK12, "disk12.toml").unwrap(), 41, 240, 65.0, false)
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
    let recording = Recording { frames: &sound.frames, untouched: &sound.untouched, positions_m: Some(&positions_m) };
    let checked = check_recording(&sound.skin, &recording).unwrap();
    let faults: Vec<&Finding> = checked.faults().collect();
    assert_eq!((faults.len(), faults[0].kind, faults[0].lag), (1, FindingKind::TruthShifted, 1), "{faults:?}");
}

#[test]
fn input_that_cannot_be_checked_is_refused() {
    let sound = disk();
    let check = |frames: &[Frame], untouched: &[Frame], positions_m: Option<&[[f64; 3]]>| {
        check_recording(&sound.skin, &Recording { frames, untouched, positions_m }).unwrap_err().to_string()
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

#[test]
#[ignore = "slow: some minutes; prints a table"]
fn fifty_corrupted_recordings() {
    let seed = std::env::var("DERMIS_SEED").map_or(SEED, |seed| seed.parse().expect("a number"));
    let bases = bases(seed);
    let mut table: BTreeMap<&str, BTreeMap<String, [usize; 2]>> = BTreeMap::new();
    let mut count = |base: &'static str, kind: String, right: bool| {
        let cell = table.entry(base).or_default().entry(kind).or_default();
        *cell = [cell[0] + usize::from(right), cell[1] + 1];
    };
    let mut right = 0;
    for number in 0..RECORDINGS {
        let mut rng = sample_rng(seed, number);
        let base = &bases[(number as usize / 4) % bases.len()];
        let mut sound = part(base, 200, &mut rng);
        let is_sound = judged(&sound.check(), sound.first);
        count(sound.name, "sound".into(), is_sound.is_empty());
        if !is_sound.is_empty() {
            println!("{number} {}: {} rows, sound, but {is_sound:?}", sound.name, sound.frames.len());
        }
        let expected = corrupt(&mut sound, number, &mut rng);
        let checked = sound.check();
        let is_right = is_right(&sound, &checked, &expected);
        right += usize::from(is_right);
        count(sound.name, expected.kind.name().into(), is_right);
        if !is_right {
            let found = judged(&checked, sound.first);
            println!("{number} {}: {} rows, {}", sound.name, sound.frames.len(), expected.what);
            let channels: Vec<usize> = expected.channels.keys().copied().collect();
            println!("   expected {} {channels:?}", expected.kind.name());
            found.iter().for_each(|(kind, lag, channels)| println!("   found {} {lag} {channels:?}", kind.name()));
            checked
                .faults()
                .for_each(|fault| println!("   {} {:.3} {}", fault.kind.name(), fault.value, fault.evidence));
        }
    }
    println!("| recording | kind | right | of |\n|---|---|---|---|");
    for (base, kinds) in &table {
        kinds.iter().for_each(|(kind, [right, of])| println!("| {base} | {kind} | {right} | {of} |"));
    }
    println!("{right} of {RECORDINGS} corrupted recordings right");
    assert!(100 * right >= 95 * RECORDINGS as usize, "{right} of {RECORDINGS}");
}
