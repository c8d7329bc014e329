//! The figures of refined contacts in `docs/validation.md`: experiments on ten digital twins of each kind, with seeds that
//! no other measurement and no choice has used. Minutes each:
//! `cargo test --release -p dermis-learn --test refined_figures -- --ignored --nocapture`.

use dermis::contact::Contact;
use dermis::detect::REGION_95_SD;
use dermis::frame::{Differences, broken_channels};
use dermis::geom::Surface;
use dermis::method::{Method, MethodOptions, Methods};
use dermis::skin::Skin;
use dermis::stats::{Summary, mean};
use dermis_sim::evaluate::{match_contacts, resolves_two};
use dermis_sim::experiment::{PaperExperiment, PressSet, Recording, Sizes, truth};
use dermis_sim::random::sample_rng;
use dermis_sim::twin::TwinOptions;
use rand::RngExt;
use std::collections::BTreeMap;

const SEEDS: std::ops::Range<u64> = 9001..9011;

fn sizes() -> Sizes {
    let separations_m = vec![0.025, 0.03, 0.035, 0.04, 0.045, 0.05];
    Sizes { grid_step: 7, random: 271, separations_m, pairs: 20, fours: 60 }
}

/// Fewer, on twins whose frames take longer to compute.
fn few() -> Sizes {
    Sizes { grid_step: 13, random: 100, separations_m: vec![0.05], pairs: 10, fours: 20 }
}

/// Distances of touches from their contacts, and counts.
#[derive(Default)]
struct Found {
    frames: usize,
    touches: usize,
    distances_m: Vec<f64>,
    misses: usize,
    false_positives: usize,
    /// Touches in the 95 % region of their contact, where all of a frame were found.
    covered: usize,
    of_covered: usize,
    /// Frames with a contact within 15 mm of each touch and nothing else.
    all_found: usize,
}

impl Found {
    fn add(&mut self, surface: &Surface, contacts: &[Contact], touches: &[Contact]) {
        let found = match_contacts(touches, contacts, surface);
        let near = found.pairs.len() == touches.len() && found.pairs.iter().all(|pair| pair.2 <= 0.015);
        self.frames += 1;
        self.touches += touches.len();
        self.misses += found.missed.len();
        self.false_positives += found.false_positives.len();
        self.all_found += usize::from(near && found.false_positives.is_empty());
        for (_, contact, distance_m) in found.pairs {
            self.distances_m.push(distance_m);
            if found.missed.is_empty() {
                self.covered += usize::from(distance_m <= REGION_95_SD * contacts[contact].sd_m);
                self.of_covered += 1;
            }
        }
    }

    fn row(&self) -> String {
        let summary = Summary::of(&self.distances_m);
        let percent = |part: usize, of: usize| 100.0 * part as f64 / of as f64;
        format!(
            "{:.2} | {:.1} | {:.2} % | {:.2} % | {:.1} % | {:.1} %",
            1e3 * summary.mean,
            1e3 * summary.p95,
            percent(self.misses, self.touches),
            percent(self.false_positives, self.touches),
            percent(self.all_found, self.frames),
            percent(self.covered, self.of_covered)
        )
    }
}

/// The results of a method.
struct Figures {
    name: &'static str,
    sets: [Found; 4],
    /// Mean of both single sets, of each twin, m.
    of_twins_m: Vec<f64>,
    /// Pairs and resolved ones, by separation in mm.
    resolved: BTreeMap<u32, [usize; 2]>,
}

impl Figures {
    fn new(name: &'static str) -> Self {
        Figures { name, sets: Default::default(), of_twins_m: Vec::new(), resolved: BTreeMap::new() }
    }

    fn add(&mut self, skin: &Skin, experiment: &PaperExperiment, recordings: [&Recording; 4]) {
        let methods = dermis_learn::methods();
        let method = methods.method(skin, self.name, &MethodOptions::default()).unwrap();
        let method = method.without_channels(skin, &broken_channels(&recordings[0].untouched)).unwrap();
        let surface = skin.design().body.surface();
        let [grid, random, two, four] = [0, 1, 2, 3].map(|index| contacts(&method, recordings[index]));
        let before: Vec<usize> = self.sets.iter().map(|found| found.distances_m.len()).collect();
        let sets = [&experiment.sets.grid, &experiment.sets.random, &experiment.sets.two, &experiment.sets.four];
        for ((found, set), contacts) in self.sets.iter_mut().zip(sets).zip([&grid, &random, &two, &four]) {
            for (contacts, presses) in contacts.iter().zip(&set.presses) {
                found.add(&surface, contacts, &truth(&surface, presses));
            }
        }
        let of_twin: Vec<f64> = self
            .sets
            .iter()
            .zip(before)
            .take(2)
            .flat_map(|(found, before)| found.distances_m[before..].to_vec())
            .collect();
        self.of_twins_m.push(mean(&of_twin));
        self.add_pairs(&surface, &experiment.sets.two, &two);
    }

    fn add_pairs(&mut self, surface: &Surface, set: &PressSet, contacts: &[Vec<Contact>]) {
        for ((contacts, presses), separation_m) in contacts.iter().zip(&set.presses).zip(&set.separations_m) {
            let [a, b] = truth(surface, presses)[..] else { panic!("two presses") };
            let [pairs, resolved] = self.resolved.entry((1e3 * separation_m).round() as u32).or_default();
            *pairs += 1;
            *resolved += usize::from(resolves_two(&[a, b], contacts, surface));
        }
    }
}

fn contacts(method: &Method, recording: &Recording) -> Vec<Vec<Contact>> {
    let differences = Differences::new(recording.frames.clone(), recording.untouched.clone());
    let method = method.adapted(&differences).unwrap();
    let detector = method.detector(&differences.untouched).unwrap();
    differences.frames.iter().map(|frame| method.contacts(frame, &detector).unwrap()).collect()
}

/// A twin's options with dead electrodes drawn from a seed.
fn with_dead(options: &TwinOptions, seed: u64, count: usize) -> TwinOptions {
    let mut options = options.clone();
    let mut rng = sample_rng(seed, 1 << 60);
    while options.faults.dead_electrodes.len() < count {
        let electrode = rng.random_range(0..30u32) as usize;
        if !options.faults.dead_electrodes.contains(&electrode) {
            options.faults.dead_electrodes.push(electrode);
        }
    }
    options
}

/// Prints the figures of methods on the same frames; returns the means of single touches, m.
fn measure(options: &TwinOptions, dead: usize, sizes: &Sizes, names: &[&'static str]) -> Vec<f64> {
    let skin = Skin::load("cylinder30").unwrap();
    let mut all: Vec<Figures> = names.iter().map(|name| Figures::new(name)).collect();
    for seed in SEEDS {
        let options = with_dead(options, seed, dead);
        let (design, mesh, pixels) = (skin.design(), skin.mesh(), skin.pixels());
        let experiment = PaperExperiment::draw(design, mesh, pixels, &options, seed, sizes).unwrap();
        let recordings = experiment.record(|| {}).unwrap();
        let recordings: Vec<&Recording> = recordings.iter().collect();
        let recordings = [0, 1, 2, 3].map(|index| recordings[index]);
        all.iter_mut().for_each(|figures| figures.add(&skin, &experiment, recordings));
        let means: Vec<f64> = all.iter().map(|figures| 1e3 * figures.of_twins_m.last().unwrap()).collect();
        println!("{} {seed}: {means:.3?} mm", options.name);
    }
    println!(
        "| {}, {dead} dead | mean, mm | 95th | misses | false positives | all found | in the 95 % region |",
        options.name
    );
    for Figures { name, sets, resolved, .. } in &all {
        for (set, found) in ["grid", "random", "two", "four"].iter().zip(sets) {
            println!("| {name}: {set} | {} |", found.row());
        }
        let part =
            |(mm, [pairs, good]): (&u32, &[usize; 2])| format!("{mm} mm {:.0} %", 100.0 * *good as f64 / *pairs as f64);
        let parts = resolved.iter().map(part);
        println!("| {name}: resolved | {} |", parts.collect::<Vec<_>>().join(", "));
    }
    all.iter().map(|figures| mean(&figures.of_twins_m)).collect()
}

fn twin(name: &str) -> TwinOptions {
    TwinOptions::load(name).unwrap()
}

const BEST: &str = "best";
const REFINED: &str = Methods::REFINED;

#[test]
#[ignore = "minutes"]
fn lab() {
    let means_m = measure(&twin("lab"), 0, &sizes(), &[BEST, REFINED]);
    assert!(means_m[1] < 0.9e-3);
}

#[test]
#[ignore = "minutes"]
fn harsh() {
    let means_m = measure(&twin("harsh"), 0, &sizes(), &[BEST, REFINED]);
    assert!(means_m[1] < 1.8e-3);
}

/// Physics that no training and no choice has seen, at two levels of noise.
fn other_physics(name: &str) {
    for snr_db in [52.0, 42.0] {
        let mut options = twin(name);
        options.electronics.snr_db = Some(snr_db);
        println!("{snr_db} dB");
        let means_m = measure(&options, 0, &few(), &["paper", BEST, REFINED]);
        assert!(means_m[2] < means_m[0] && means_m[2] < means_m[1], "{name}, {snr_db} dB: {means_m:?}");
    }
}

#[test]
#[ignore = "minutes"]
fn lab_b() {
    other_physics("lab-b");
}

#[test]
#[ignore = "minutes"]
fn lab_c() {
    other_physics("lab-c");
}

#[test]
#[ignore = "minutes"]
fn harsh_with_dead_electrodes() {
    for dead in [1, 2] {
        let means_m = measure(&twin("harsh"), dead, &sizes(), &[BEST, REFINED]);
        assert!(means_m[1] < means_m[0]);
    }
}
