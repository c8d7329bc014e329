//! Checks of recordings that were corrupted on purpose: late channels, another order, signs, dead channels.
//!
//! `cargo test --release -p dermis-calibrate --test integration corrupted_recordings:: -- --ignored --nocapture` prints the table of
//! `docs/check-frames.md`. The corruptions follow from a seed; the method was developed on other seeds than those of
//! the table.

use crate::recordings::{DISK12, Sound, simulated};
use dermis::finding::FindingKind;
use dermis::frame::{Frame, read_frames};
use dermis::skin::Skin;
use dermis_calibrate::checks::{Checked, realigned};
use dermis_sim::experiment::{PaperExperiment, Recording, Sizes};
use dermis_sim::random::{log_uniform, sample_rng};
use dermis_sim::twin::TwinOptions;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Recordings for the table, and the first of their seeds.
const RECORDINGS: u64 = 50;
const SEED: u64 = 7000;
/// Channels of the real recordings that are measured while the robot moves: partly late, partly noise. Findings on them
/// alone do not count.
const MOVING: usize = 36;

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

/// Whether the faults are those of the corruption: the same kind, nothing else, and nine tenths of the channels with
/// their lag.
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
        count(sound.name, expected.kind.to_string(), is_right);
        if !is_right {
            let found = judged(&checked, sound.first);
            println!("{number} {}: {} rows, {}", sound.name, sound.frames.len(), expected.what);
            let channels: Vec<usize> = expected.channels.keys().copied().collect();
            println!("   expected {} {channels:?}", expected.kind);
            found.iter().for_each(|(kind, lag, channels)| println!("   found {} {lag} {channels:?}", kind));
            checked.faults().for_each(|fault| println!("   {} {:.3} {}", fault.kind, fault.value, fault.evidence));
        }
    }
    println!("| recording | kind | right | of |\n|---|---|---|---|");
    for (base, kinds) in &table {
        kinds.iter().for_each(|(kind, [right, of])| println!("| {base} | {kind} | {right} | {of} |"));
    }
    println!("{right} of {RECORDINGS} corrupted recordings right");
    assert!(100 * right >= 95 * RECORDINGS as usize, "{right} of {RECORDINGS}");
}

/// Presses on the twins of the paper's skin: in the order of a grid (neighbours follow each other) and at random.
#[test]
#[ignore = "slow: two minutes; prints a table"]
fn twins_of_the_papers_skin_have_no_fault() {
    let skin = Skin::load("cylinder30").unwrap();
    let sizes = Sizes { random: 300, pairs: 0, fours: 0, ..Sizes::default() };
    println!("| twin, seed | faults in a grid of 900 presses | in 300 at random |\n|---|---|---|");
    let mut all = Vec::new();
    for (twin, seed) in [("lab", SEED + 20), ("lab", SEED + 21), ("harsh", SEED + 20), ("harsh", SEED + 21)] {
        let options = TwinOptions::load(twin).unwrap();
        let (design, mesh, pixels) = (skin.design(), skin.mesh(), skin.pixels());
        let experiment = PaperExperiment::draw(design, mesh, pixels, &options, seed, &sizes).unwrap();
        let recorded = experiment.record(|| ()).unwrap();
        let faults = [recorded.grid, recorded.random].map(|Recording { frames, untouched, .. }| {
            let sound = Sound { name: "cylinder30", skin: skin.clone(), frames, untouched, first: 0 };
            judged(&sound.check(), 0)
        });
        println!("| `{twin}`, {seed} | {} | {} |", faults[0].len(), faults[1].len());
        all.extend(faults.concat());
    }
    assert!(all.is_empty(), "{all:?}");
}
