use super::*;
use crate::twin::TwinOptions;
use dermis::design::SkinDesign;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use std::sync::atomic::{AtomicUsize, Ordering};

struct Bench {
    design: SkinDesign,
    mesh: Mesh,
    pixels: PixelSpace,
}

impl Bench {
    fn new(name: &str) -> Self {
        // The forearm is an example beside the program.
        let path = format!("{}/../dermis/designs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let mut design = SkinDesign::load(&path).expect("a design of the project");
        design.mesh = design.mesh.scaled(2.0);
        let mesh = Mesh::generate(&design).expect("a mesh");
        let pixels = PixelSpace::for_design(&design, &mesh).expect("pixels");
        Bench { design, mesh, pixels }
    }

    fn presses(&self, seed: u64) -> Presses<'_> {
        let lab = TwinOptions::shipped("lab").expect("a shipped twin");
        Presses::new(&self.design, &self.mesh, &self.pixels, lab.press, seed)
    }

    fn twin(&self, name: &str) -> Twin {
        Twin::new(&self.design, &TwinOptions::shipped(name).expect("a shipped twin"), 3).expect("a twin")
    }
}

#[test]
fn sets_have_the_places_and_distances_that_they_name() {
    let bench = Bench::new("cylinder30");
    let (presses, surface) = (bench.presses(5), bench.design.body.surface());
    let grid = presses.on_grid(1);
    assert_eq!(grid.presses.len(), 900);
    assert!(grid.presses.iter().zip(&bench.pixels.centres_m).all(|(frame, centre)| frame[0].centre_m == *centre));
    let pairs = presses.in_pairs(&[0.01, 0.08], 20);
    assert_eq!(pairs.presses.len(), 40);
    for (pair, separation_m) in pairs.presses.iter().zip(&pairs.separations_m) {
        assert!((surface.distance_m(pair[0].centre_m, pair[1].centre_m) - separation_m).abs() < 1e-8);
        assert!(pair.iter().all(|press| bench.design.body.holds(press.centre_m)));
    }
    for four in presses.apart(4, 0.06, 20).presses {
        for (i, a) in four.iter().enumerate() {
            assert!(four[..i].iter().all(|b| surface.distance_m(a.centre_m, b.centre_m) >= 0.06));
        }
    }
}

#[test]
fn places_are_even_and_forces_log_uniform_and_independent_of_them() {
    for name in ["cylinder30", "skin16"] {
        let bench = Bench::new(name);
        let set = bench.presses(6).at_random(4000);
        let [sum_x, sum_y, logs, products] = set.presses.iter().fold([0.0; 4], |[x, y, l, p], frame| {
            let (centre, log) = (frame[0].centre_m, frame[0].force_n.ln() / 5f64.ln());
            assert!((1.0..=5.0).contains(&frame[0].force_n));
            [x + centre[0], y + centre[1], l + log, p + centre[0] * (log - 0.5)]
        });
        let extent = bench.mesh.nodes.iter().fold(0.0f64, |most, node| most.max(node[0].abs()));
        for mean in [sum_x, sum_y, products].map(|sum| sum / 4000.0 / extent) {
            assert!(mean.abs() < 0.05, "{name}: {mean}");
        }
        assert!((logs / 4000.0 - 0.5).abs() < 0.02, "{name}: {logs}");
    }
}

#[test]
fn what_is_recorded_depends_on_nothing_but_twin_presses_and_number() {
    let bench = Bench::new("cylinder30");
    let twin = bench.twin("lab");
    let presses = bench.presses(7).at_random(6).presses;
    let calls = AtomicUsize::new(0);
    let count = || {
        calls.fetch_add(1, Ordering::Relaxed);
    };
    let all = record(&twin, &presses, 0, count).expect("a recording");
    assert_eq!((calls.load(Ordering::Relaxed), all.frames.len()), (6, 6));
    let few = record(&twin, &presses[..2], 0, || ()).expect("a recording");
    assert_eq!((&all.baseline, &all.frames[..2]), (&few.baseline, &few.frames[..]));
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    assert_eq!(alone.install(|| record(&twin, &presses, 0, || ())).expect("a recording"), all);
    let later = record(&twin, &presses[..1], all.next_index, || ()).expect("a recording");
    assert_ne!(later.frames[0], all.frames[0], "another time has another noise");
}

#[test]
fn the_baseline_is_ten_times_quieter_than_a_frame_and_a_press_is_seen() {
    let bench = Bench::new("cylinder30");
    let twin = bench.twin("lab");
    let clean = twin.clean(&[]).expect("a frame");
    let rms = |frame: &Frame| bench.design.protocol.undriven_rms(&(frame - &clean));
    let press = bench.presses(8).at_random(1).presses.remove(0);
    let recording = record(&twin, &[vec![], press], 0, || ()).expect("a recording");
    let (baseline, untouched, touched) =
        (rms(&recording.baseline), rms(&recording.frames[0]), rms(&recording.frames[1]));
    println!("baseline {baseline:.2e}, untouched {untouched:.2e}, pressed {touched:.2e} ohm");
    // The errors of gain and settling are equal in both; the noise decreases with the square root of a hundred.
    assert!(baseline < 0.6 * untouched && touched > 2.0 * untouched);
}

#[test]
fn presses_on_a_membrane_lower_its_conductance() {
    let bench = Bench::new("skin16");
    let mut options = TwinOptions::shipped("lab").expect("a shipped twin");
    options.electronics = TwinOptions::shipped("ideal").expect("a shipped twin").electronics;
    (options.drift, options.temperature) = (None, None);
    let sizes = Sizes { grid_step: 120, random: 4, separations_m: vec![0.02], pairs: 2, fours: 0, ..Sizes::default() };
    let experiment =
        PaperExperiment::draw(&bench.design, &bench.mesh, &bench.pixels, &options, 3, &sizes).expect("an experiment");
    assert_eq!(experiment.twin.options().name, "lab without patches");
    let total = |frame: &Frame| frame.iter().map(|value| value.abs()).sum::<f64>();
    for recording in experiment.record(|| ()).expect("recordings").iter() {
        let rest = total(&recording.baseline);
        // The voltages between neighbours grow where less of the coat conducts.
        assert!(recording.frames.iter().all(|frame| total(frame) > rest));
    }
}

#[test]
fn objects_are_whole_on_the_skin_and_their_truth_is_their_middle() {
    for name in ["cylinder30", "forearm"] {
        let bench = Bench::new(name);
        let (presses, surface) = (bench.presses(8), bench.design.body.surface());
        for family in Family::ALL {
            let objects = presses.of_family(family, 12);
            assert!(objects.len() >= 10, "{name} {family:?}: {} frames have space", objects.len());
            for Objects { presses, truth } in &objects {
                assert_eq!(truth.len(), if family == Family::Fingers { 2 } else { 1 });
                assert!(presses.iter().all(|press| bench.design.body.holds(press.centre_m)));
                let [force_n, true_n]: [f64; 2] =
                    [presses.iter().map(|press| press.force_n).sum(), truth.iter().map(|c| c.force_n).sum()];
                assert!((force_n / true_n - 1.0).abs() < 1e-12);
                let (centre, half_m) = (truth[0].position_m, truth[0].half_length_m);
                let farthest_m = presses.iter().map(|p| surface.distance_m(p.centre_m, centre)).fold(0.0, f64::max);
                match family {
                    // Exact on a cylinder; a mesh has straight distances, which are shorter on a curved body.
                    Family::Edges => {
                        assert!((0.85..1.0 + 1e-9).contains(&(farthest_m / half_m)), "{name} {farthest_m} {half_m}")
                    }
                    Family::Palms => assert!(farthest_m < 1.16 * half_m && truth[0].half_width_m <= half_m),
                    Family::Fingers => {
                        assert!((0.0249 * 0.9..0.0601).contains(&surface.distance_m(centre, truth[1].position_m)))
                    }
                    Family::Pins | Family::Balls => assert!(farthest_m == 0.0 && half_m.is_nan()),
                }
                let mean = surface.weighted_mean(centre, presses.iter().map(|press| (press.centre_m, press.force_n)));
                if matches!(family, Family::Edges | Family::Palms) {
                    // On a mesh by the curvature: a part of the depth of the arc.
                    assert!(surface.distance_m(mean, centre) < if name == "forearm" { 6e-3 } else { 1e-9 });
                }
            }
        }
    }
}
