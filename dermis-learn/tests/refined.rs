//! Contacts of the shipped network refined on the skin that its untouched frames identify, on digital twins.

use dermis::method::{MethodOptions, Methods};
use dermis::skin::Skin;
use dermis_sim::evaluate::{Benchmark, BenchmarkOptions, BenchmarkResult};
use dermis_sim::experiment::Sizes;
use dermis_sim::twin::TwinOptions;
use std::time::Instant;

fn benchmark(twin: &str, method: &str, seed: u64, sizes: Sizes) -> BenchmarkResult {
    let skin = Skin::load("cylinder30").unwrap();
    let method = dermis_learn::methods().method(&skin, method, &MethodOptions::default()).unwrap();
    let options = BenchmarkOptions { sizes, untouched: 1200, force_step: 300, places: 2, dead_electrodes: 0 };
    let benchmark = Benchmark {
        design: skin.design(),
        mesh: skin.mesh(),
        pixels: skin.pixels(),
        options: &TwinOptions::load(twin).unwrap(),
        method: method.reconstruct().as_ref(),
        alpha: None,
    };
    let start = Instant::now();
    let result = benchmark.run(seed, &options, |_| {}).unwrap();
    println!(
        "{twin} {seed} {}: grid {:.3} mm, random {:.3} mm (95th percentile {:.2} mm), four {:.3} mm; covered {:.3}, {:.3}, {:.3}; \
         missed {} {}, false {} {}; resolved from {:.0} mm; strength per newton {:.3} {:.3}, true {:.3} {:.3}; {:.0} s",
        method.name(),
        result.grid.localisation_m.mean * 1e3,
        result.random.localisation_m.mean * 1e3,
        result.single_m.p95 * 1e3,
        result.four.localisation_m.mean * 1e3,
        result.covered.single,
        result.covered.two,
        result.covered.four,
        result.random.misses,
        result.four.misses,
        result.random.false_positives,
        result.four.false_positives,
        result.resolved_from_m() * 1e3,
        result.grid.strength_spread,
        result.random.strength_spread,
        result.force.true_spread[0],
        result.force.true_spread[1],
        start.elapsed().as_secs_f64(),
    );
    result
}

fn small() -> Sizes {
    Sizes { grid_step: 12, random: 75, separations_m: vec![0.06], pairs: 10, fours: 40, ..Sizes::default() }
}

/// A twin has uneven coating, displaced electrodes, patches, contacts, noise and a mesh that the refinement knows
/// nothing of but by its untouched frames.
#[test]
fn refined_contacts_are_nearer_and_their_deviations_true() {
    for (twin, least_gain) in [("lab", 0.85), ("harsh", 0.75)] {
        let [plain, refined] = ["spots", Methods::REFINED].map(|method| benchmark(twin, method, 1001, small()));
        let gain = refined.single_m.mean / plain.single_m.mean;
        assert!(gain < least_gain, "{twin}: {gain}");
        assert!(refined.four.localisation_m.mean < least_gain * plain.four.localisation_m.mean);
        // The standard error of the part over 150 touches is 1.8 %.
        assert!((0.88..=1.0).contains(&refined.covered.single), "{twin}: {}", refined.covered.single);
        // Strengths spread hardly more than those of the presses themselves, and forces have no bias of a third.
        assert!(refined.random.strength_spread < plain.random.strength_spread);
        assert!(refined.random.strength_spread < 1.2 * refined.force.true_spread[1]);
        let force = refined.random.force.expect("the method states forces");
        println!("{twin}: forces {:.2}, {:.2} before", force.error, plain.random.force.expect("as it does").error);
        assert!(force.error < 0.33, "{twin}: {}", force.error);
    }
}

/// The time of one frame's refinement, on one core.
#[test]
fn the_time_of_a_refinement() {
    let skin = Skin::load("cylinder30").unwrap();
    let method = dermis_learn::methods().method(&skin, Methods::REFINED, &MethodOptions::default()).unwrap();
    let twin = dermis_sim::twin::Twin::new(skin.design(), &TwinOptions::load("lab").unwrap(), 2001).unwrap();
    let untouched = (0..100).map(|index| twin.frame(&[], index).unwrap()).collect();
    let surface = skin.design().body.surface();
    let press = |z_m: f64, theta_rad: f64| dermis_sim::twin::Press {
        centre_m: surface.at(z_m, theta_rad).unwrap(),
        force_n: 2.0,
        tip_radius_m: 0.005,
    };
    let presses = [press(0.05, 1.0), press(0.15, 3.0), press(0.22, 5.0), press(0.28, 0.2)];
    for count in [1, 4] {
        let frame = twin.frame(&presses[..count], 500).unwrap();
        let differences = dermis::frame::Differences::new(vec![frame], Vec::clone(&untouched));
        let start = Instant::now();
        let adapted = method.adapted(&differences).unwrap();
        let prepared_s = start.elapsed().as_secs_f64();
        let detector = adapted.detector(&differences.untouched, &skin.design().protocol).unwrap();
        let image = adapted.image(&differences.frames[0]).unwrap();
        let found = detector.detect(&image);
        assert_eq!(found.len(), count);
        let start = Instant::now();
        let times = 500;
        for _ in 0..times {
            let mut contacts = found.clone();
            adapted.reconstruct().correct(&differences.frames[0], &mut contacts);
            std::hint::black_box(contacts);
        }
        let milliseconds = start.elapsed().as_secs_f64() / f64::from(times) * 1e3;
        println!("adapted in {prepared_s:.2} s; {count} contacts refined in {milliseconds:.3} ms");
        // The bar with one contact is 0.35 ms on a quiet machine; a crowded one takes several times as long.
        assert!(milliseconds < 5.0 * count as f64);
    }
}
