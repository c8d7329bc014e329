use crate::dataset::record::file_name;
use crate::dataset::skins::SkinMaker;
use crate::dataset::{
    DatasetError, GaussianTouches, Generator, Manifest, PatchTouches, Recipe, Record, Run, Shard, SkinSpread, Skins,
    Touch, TouchKind, finish, verify,
};
use crate::touch::touched_conductivity;
use crate::twin::PatchedSkin;
use dermis::design::{SkinDesign, TouchEffect};
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis::stats::mean_and_sd;
use std::path::Path;

/// A small skin: 8 arcs on the rim of a disk, 40 values.
const DISK: &str = r#"
[body.disk]
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.005
contact_impedance_ohm_m = 0.01
layout.rim.count = 8
[protocol]
pattern = "adjacent_undriven"
[image.grid]
rows = 8
columns = 8
[mesh]
max_edge_m = 0.012
electrode_edge_m = 0.004
"#;

fn skin(text: &str) -> (SkinDesign, ForwardModel) {
    let design = SkinDesign::parse(text, "disk.toml").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let forward = ForwardModel::new(&design, &mesh).unwrap();
    (design, forward)
}

fn recipe(samples: u64) -> Recipe {
    let touch = Touch::Gaussian(GaussianTouches::for_effect(TouchEffect::ConductanceRises));
    Recipe { seed: 5, samples, touch, skins: Skins::Even }
}

fn generator(samples: u64) -> Generator {
    let (design, forward) = skin(DISK);
    Generator::new(&design, &forward, &recipe(samples)).unwrap()
}

/// Generates a dataset, or the missing part of it.
fn make(generator: &Generator, folder: &Path, shard: Shard) -> crate::Result<super::RunReport> {
    let record = Record::new(generator, "disk", DISK);
    Run::new(generator, &record, folder, shard)?.make(|_| Ok::<_, crate::Error>(()))
}

fn bytes(folder: &Path, file: u64) -> Vec<u8> {
    std::fs::read(folder.join(file_name(file))).unwrap()
}

/// The frames are stored in single precision: relative error 6e-8.
const STORED: f64 = 2e-7;

#[test]
fn a_sample_is_what_the_plain_rasteriser_and_the_plain_solver_make_of_its_touches() {
    for (name, samples) in [("cylinder30", 24), ("tank16", 24)] {
        let design = SkinDesign::shipped(name).unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let forward = ForwardModel::new(&design, &mesh).unwrap();
        let effect = design.sheet.touch;
        let touch = Touch::Gaussian(GaussianTouches::for_effect(effect));
        let generator =
            Generator::new(&design, &forward, &Recipe { seed: 2, samples, touch, skins: Skins::Even }).unwrap();
        let (surface, rest) = (design.body.surface(), forward.rest_conductivity());
        let plain_rest = forward.solve(rest).unwrap();
        let largest = plain_rest.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
        let (mut worst_frame, mut worst_image) = (0.0f64, 0.0f64);
        for sample in generator.stream(0).take(samples as usize) {
            let sample = sample.unwrap();
            let touches = generator.touches(sample.index);
            let conductivity = touched_conductivity(&mesh, &surface, effect, rest, &touches).unwrap();
            let frame = forward.solve(&conductivity).unwrap();
            for (&got, &want) in sample.frame.iter().zip(frame.iter()) {
                worst_frame = worst_frame.max((f64::from(got) - want).abs() / largest);
            }
            assert!(
                sample.rest.iter().zip(plain_rest.iter()).all(|(&a, &b)| (f64::from(a) - b).abs() < STORED * largest)
            );
            // The pixels' mean over the cells approximates the exact mean over the pixel.
            let change: Vec<f64> =
                conductivity.iter().zip(rest).map(|(now, rest)| effect.sign() * (now / rest - 1.0)).collect();
            let pixels = generator.pixels().average_cells(&mesh, &change);
            let strongest: f64 = touches.iter().map(|touch| touch.amplitude).sum();
            for (&got, want) in sample.image.iter().zip(pixels) {
                worst_image = worst_image.max((f64::from(got) - want).abs() / strongest);
            }
            assert_eq!(sample.touches.len(), touches.len());
            let TouchKind::Gaussian { amplitude, .. } = sample.touches[0].kind else { panic!("a Gaussian touch") };
            assert_eq!(amplitude, touches[0].amplitude as f32);
        }
        println!(
            "{name}: frames off by {worst_frame:.1e} of the largest value, images by {worst_image:.3} of the amplitude"
        );
        assert!(worst_frame < STORED, "{worst_frame}");
        assert!(worst_image < 0.1, "{worst_image}");
    }
}

#[test]
fn a_sample_depends_on_its_seed_and_number_alone() {
    let generator = generator(40);
    let all: Vec<_> = generator.stream(0).take(40).map(Result::unwrap).collect();
    for first in [7, 16, 33] {
        let from: Vec<_> = generator.stream(first).take(5).map(Result::unwrap).collect();
        assert_eq!(from[..], all[first as usize..first as usize + 5]);
    }
    assert_ne!(all[0].frame, all[1].frame);
    let (design, forward) = skin(DISK);
    let other = Generator::new(&design, &forward, &Recipe { seed: 6, ..recipe(40) }).unwrap();
    assert_ne!(other.stream(0).next().unwrap().unwrap().frame, all[0].frame);
}

#[test]
fn touches_are_drawn_as_stated() {
    let generator = generator(1);
    let touches: Vec<_> = (0..20_000).map(|index| generator.touches(index)).collect();
    for count in 1..=4 {
        let share = touches.iter().filter(|touches| touches.len() == count).count() as f64 / 20_000.0;
        assert!((share - 0.25).abs() < 0.015, "{count}: {share}");
    }
    let all = || touches.iter().flatten();
    let share = |holds: &dyn Fn(&crate::touch::GaussianTouch) -> bool| {
        all().filter(|touch| holds(touch)).count() as f64 / all().count() as f64
    };
    assert!(all().all(|touch| (0.005..=0.015).contains(&touch.width_m) && (0.1..=2.0).contains(&touch.amplitude)));
    assert!((share(&|touch| touch.width_m < 0.01) - 0.5).abs() < 0.01);
    // Half of the amplitudes are below the geometric mean of their bounds.
    assert!((share(&|touch| touch.amplitude < 0.2f64.sqrt()) - 0.5).abs() < 0.01);
}

#[test]
fn bytes_do_not_depend_on_threads_shards_or_interruptions() {
    let folder = tempfile::tempdir().unwrap();
    let generator = generator(20_000);
    let at = |name: &str| folder.path().join(name);
    let in_threads = |threads: usize, name: &str, shard: Shard| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| make(&generator, &at(name), shard)).unwrap()
    };
    let whole = in_threads(1, "one", Shard::WHOLE);
    assert_eq!((whole.made_samples, whole.made_files, whole.found_files), (20_000, 3, 0));
    in_threads(2, "two", Shard::new(0, 2).unwrap());
    let second = in_threads(2, "two", Shard::new(1, 2).unwrap());
    assert_eq!((second.made_samples, second.made_files), (8192, 1));
    in_threads(3, "three", Shard::WHOLE);
    // A killed run: a file is missing, one is half written under its temporary name, a lock file is left.
    std::fs::remove_file(at("three").join(file_name(1))).unwrap();
    std::fs::write(at("three").join(".part-00001"), [0; 1000]).unwrap();
    std::fs::write(at("three").join(".lock-00001"), []).unwrap();
    std::fs::write(at("three").join(".lock-00002"), []).unwrap();
    let resumed = in_threads(2, "three", Shard::WHOLE);
    assert_eq!((resumed.made_files, resumed.found_files), (1, 2));
    for file in 0..3 {
        assert!(bytes(&at("one"), file) == bytes(&at("two"), file), "file {file}");
        assert!(bytes(&at("one"), file) == bytes(&at("three"), file), "file {file}");
    }
    for name in ["one", "three"] {
        finish(&at(name), || ()).unwrap();
    }
    let names = |name: &str| {
        let mut names: Vec<_> = std::fs::read_dir(at(name)).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names("three").len(), 5, "leftovers are gone: {:?}", names("three"));
    let manifest = |name: &str| std::fs::read(at(name).join("manifest.json")).unwrap();
    assert_eq!(manifest("one"), manifest("three"));
    assert!(verify(&at("one"), || ()).unwrap().problems.is_empty());
}

#[test]
fn the_manifest_has_the_mean_and_spread_of_a_plain_sum() {
    let folder = tempfile::tempdir().unwrap();
    let generator = generator(9000);
    make(&generator, folder.path(), Shard::WHOLE).unwrap();
    let manifest = finish(folder.path(), || ()).unwrap();
    assert_eq!(Manifest::read(folder.path()).unwrap(), manifest);
    assert_eq!(manifest.files.iter().map(|file| file.samples).collect::<Vec<_>>(), [8192, 808]);
    let spread = |values: &mut dyn Iterator<Item = f64>| mean_and_sd(&values.collect::<Vec<f64>>());
    let samples: Vec<_> = generator.stream(0).take(9000).map(Result::unwrap).collect();
    let (mean, sd) = spread(&mut samples.iter().map(|sample| f64::from(sample.frame[3])));
    let statistics = &manifest.statistics;
    assert!((statistics.frame_mean_ohm[3] / mean - 1.0).abs() < 1e-12);
    assert!((statistics.frame_sd_ohm[3] / sd - 1.0).abs() < 1e-9);
    let mut differences = samples.iter().map(|sample| f64::from(sample.frame[7]) - f64::from(sample.rest[7]));
    let (mean, sd) = spread(&mut differences);
    assert!((statistics.difference_mean_ohm[7] / mean - 1.0).abs() < 1e-12);
    assert!((statistics.difference_sd_ohm[7] / sd - 1.0).abs() < 1e-12);
    let (mean, sd) = spread(&mut samples.iter().flat_map(|sample| sample.image.iter().map(|&value| f64::from(value))));
    assert!((statistics.image_mean / mean - 1.0).abs() < 1e-12 && (statistics.image_sd / sd - 1.0).abs() < 1e-12);
}

#[test]
fn damaged_foreign_and_missing_files_are_named_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let generator = generator(9000);
    make(&generator, folder.path(), Shard::WHOLE).unwrap();
    let path = folder.path().join(file_name(1));
    let good = std::fs::read(&path).unwrap();
    let refused = |content: &[u8]| {
        std::fs::write(&path, content).unwrap();
        let message = make(&generator, folder.path(), Shard::WHOLE).unwrap_err().to_string();
        assert!(std::fs::read(&path).unwrap() == content, "a bad file was overwritten");
        assert!(message.contains("samples-00001.safetensors"), "{message}");
        message
    };
    assert!(refused(&good[..good.len() - 4]).contains("its length"));
    assert!(refused(b"").contains("too short"));
    assert!(refused(&[b'x'; 4000]).contains("not a safetensors file"));
    assert!(refused(&bytes(folder.path(), 0)).contains("other samples"));
    // A flipped bit is detected when the file is read.
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 4;
    std::fs::write(&path, &flipped).unwrap();
    let message = finish(folder.path(), || ()).unwrap_err().to_string();
    assert!(message.contains("samples-00001") && message.contains("damaged"), "{message}");
    assert_eq!(verify(folder.path(), || ()).unwrap().problems.len(), 1);
    std::fs::remove_file(&path).unwrap();
    let error = finish(folder.path(), || ()).unwrap_err();
    assert!(matches!(error, DatasetError::Missing { count: 1, of: 2, .. }), "{error}");
    make(&generator, folder.path(), Shard::WHOLE).unwrap();
    assert!(bytes(folder.path(), 1) == good);
    // After the manifest, a file that is valid in itself but differs from the original.
    finish(folder.path(), || ()).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(verify(folder.path(), || ()).unwrap().problems, ["1 file missing"]);
}

#[test]
fn another_design_seed_or_machine_is_refused_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let (design, forward) = skin(DISK);
    let generator = generator(100);
    make(&generator, folder.path(), Shard::WHOLE).unwrap();
    let record = Record::new(&generator, "disk", DISK);
    let refused = |record: &Record| Run::new(&generator, record, folder.path(), Shard::WHOLE).unwrap_err().to_string();
    let other = Recipe { seed: 6, ..recipe(100) };
    let other = Record::new(&Generator::new(&design, &forward, &other).unwrap(), "disk", DISK);
    assert!(refused(&other).contains("`recipe.seed` is 5, not 6"), "{}", refused(&other));
    let message = refused(&Record::new(&generator, "disk", &format!("{DISK}\n# another")));
    assert!(message.contains("`design.sha256` is"), "{message}");
    let cpu = Record { cpu: dermis::linalg::SimdLevel::Neon, ..record.clone() };
    assert!(refused(&cpu).contains("`cpu` is"), "{}", refused(&cpu));
    let mut mesh = record.clone();
    mesh.mesh.hash = "0".into();
    assert!(refused(&mesh).contains("`mesh.hash` is"));
    assert!(record.check_design(folder.path(), DISK).is_ok());
    // Another name is no other skin; another protocol is one on the same mesh.
    assert_eq!(record.other_table(&SkinDesign { name: "same".into(), ..design.clone() }).unwrap(), None);
    let protocol = design.protocol.clone().with_amplitude_only(true);
    assert_eq!(record.other_table(&SkinDesign { protocol, ..design.clone() }).unwrap(), Some("protocol"));
    let error = record.check_design(folder.path(), "name = \"other\"").unwrap_err();
    assert!(matches!(&error, DatasetError::Mismatch { field, .. } if field == "design.sha256"), "{error}");
}

#[test]
fn impossible_runs_are_refused() {
    let (design, forward) = skin(DISK);
    let refused = |recipe: &Recipe| Generator::new(&design, &forward, recipe).unwrap_err().to_string();
    assert!(refused(&recipe(0)).contains("the number of samples is 0"));
    let gaussian = |most, width_m, amplitude| Recipe {
        touch: Touch::Gaussian(GaussianTouches { most, width_m, amplitude }),
        ..recipe(1)
    };
    let good = ([0.005, 0.01], [0.1, 1.0]);
    assert!(refused(&gaussian(0, good.0, good.1)).contains("the most touches of a sample is 0"));
    assert!(refused(&gaussian(17, good.0, good.1)).contains("is 17: it must be 1 to 16"));
    assert!(refused(&gaussian(1, [0.0, 0.01], good.1)).contains("the width of touches in m is 0"));
    assert!(refused(&gaussian(1, [0.02, 0.01], good.1)).contains("at least 0.02"));
    assert!(refused(&gaussian(1, good.0, [0.1, f64::NAN])).contains("the amplitude of touches is NaN"));
    assert!(refused(&gaussian(1, [1e-4, 0.01], good.1)).contains("no narrower than the mesh can carry"));
    let falls = GaussianTouches { most: 4, width_m: good.0, amplitude: [0.1, 0.25] };
    assert!(falls.check(TouchEffect::ConductanceFalls).unwrap_err().to_string().contains("below 1"));
    assert!(GaussianTouches::for_effect(TouchEffect::ConductanceFalls).check(TouchEffect::ConductanceFalls).is_ok());
    let error = Shard::new(2, 2).unwrap_err().to_string();
    assert!(error.contains("shard 2 of 2") && error.contains("0 to 1"), "{error}");
    assert!(Shard::new(0, 0).is_err());
    // More than the capacity of any disk.
    let generator = generator(u64::MAX / 2);
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("new");
    let error = make(&generator, &inside, Shard::WHOLE).unwrap_err();
    let crate::Error::Dataset(error) = error else { panic!("{error}") };
    assert!(matches!(*error, DatasetError::Space { .. }), "{error}");
    assert!(!inside.exists(), "a refusal leaves nothing behind");
}

#[test]
fn a_file_in_another_process_hands_is_left_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let generator = generator(9000);
    let record = Record::new(&generator, "disk", DISK);
    let run = Run::new(&generator, &record, folder.path(), Shard::WHOLE).unwrap();
    let lock = std::fs::File::create(folder.path().join(".lock-00000")).unwrap();
    lock.lock().unwrap();
    let error = run.make(|_| Ok::<_, crate::Error>(())).unwrap_err();
    let crate::Error::Dataset(error) = error else { panic!("{error}") };
    assert!(matches!(*error, DatasetError::Busy { count: 1, .. }), "{error}");
    assert!(error.to_string().contains("samples-00000"), "{error}");
    assert!(!folder.path().join(file_name(0)).exists() && folder.path().join(file_name(1)).exists());
    drop(lock);
    assert_eq!(make(&generator, folder.path(), Shard::WHOLE).unwrap().made_files, 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fills_up_leaves_no_file_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let generator = generator(100);
    let record = Record::new(&generator, "disk", DISK);
    let run = Run::new(&generator, &record, folder.path(), Shard::WHOLE).unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.path().join(".part-00000")).unwrap();
    let error = run.make(|_| Ok::<_, crate::Error>(())).unwrap_err().to_string();
    assert!(error.contains("samples-00000.safetensors: No space left"), "{error}");
    assert!(!folder.path().join(file_name(0)).exists());
    assert_eq!(make(&generator, folder.path(), Shard::WHOLE).unwrap().made_files, 1);
}

/// The relative norm of a difference, over the values without a driven electrode.
fn off(got: &[f32], want: &[f64], less: &[f64]) -> f64 {
    let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
    let error = squares(&mut got.iter().zip(want).map(|(&got, want)| f64::from(got) - want));
    (error / squares(&mut want.iter().zip(less).map(|(want, less)| want - less))).sqrt()
}

#[test]
fn a_sample_of_random_skins_is_what_the_plain_solver_makes_of_its_own_skin() {
    for name in ["cylinder30", "tank16"] {
        let design = SkinDesign::shipped(name).unwrap();
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let effect = design.sheet.touch;
        let spread = SkinSpread::usual();
        let touch = Touch::Gaussian(GaussianTouches::for_effect(effect));
        let recipe = Recipe { seed: 8, samples: 100, touch, skins: Skins::Random(spread.clone()) };
        let generator = Generator::new(&design, &forward, &recipe).unwrap();
        let maker = SkinMaker::new(&design, &forward, 8, &spread).unwrap();
        let mut worst = 0.0f64;
        for index in [0, 15, 16, 35] {
            let sample = generator.stream(index).next().unwrap().unwrap();
            let skin = maker.make(index / 16).unwrap().forward;
            let rest = skin.solve(skin.rest_conductivity()).unwrap();
            let touches = generator.touches(index);
            let surface = design.body.surface();
            let touched =
                touched_conductivity(skin.mesh(), &surface, effect, skin.rest_conductivity(), &touches).unwrap();
            let frame = skin.solve(&touched).unwrap();
            assert!(off(&sample.rest, &rest, &vec![0.0; rest.len()]) < STORED);
            worst = worst.max(off(&sample.frame, &frame, &rest));
        }
        println!("{name}: frames of random skins off by {worst:.1e} of what their touches change");
        // Single precision, and quadrature points that follow the moved nodes to second order.
        assert!(worst < 3e-4, "{worst}");
        let all: Vec<_> = generator.stream(0).take(48).map(Result::unwrap).collect();
        assert!(all[..16].iter().all(|sample| sample.rest == all[0].rest));
        assert!(all[16].rest != all[0].rest && all[47].rest != all[16].rest);
        assert_eq!(generator.stream(20).next().unwrap().unwrap(), all[20], "its skin's other samples do not matter");
    }
}

#[test]
fn a_press_sample_is_what_the_patched_skin_makes_of_its_presses() {
    let design = SkinDesign::shipped("cylinder30").unwrap();
    let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
    let touches = PatchTouches::usual();
    let recipe = |skins| Recipe { seed: 8, samples: 20, touch: Touch::Patch(touches.clone()), skins };
    let even = Generator::new(&design, &forward, &recipe(Skins::Even)).unwrap();
    let skin = PatchedSkin::new(&touches.patches, &design.body, &forward, forward.rest_conductivity()).unwrap();
    let rest = skin.network(&[]).unwrap().frame(&design.protocol);
    for sample in even.stream(0).take(4) {
        let sample = sample.unwrap();
        let presses = even.presses(sample.index);
        let frame = skin.network(&presses).unwrap().frame(&design.protocol);
        assert!(off(&sample.frame, &frame, &rest) < 1e-3);
        assert_eq!(sample.touches.len(), presses.len());
        assert_eq!(sample.touches[0].force_n(), Some(presses[0].force_n as f32));
        let peak = sample.image.iter().copied().fold(0.0, f32::max);
        assert!(peak > 0.05, "{peak}");
    }
    let random = Generator::new(&design, &forward, &recipe(Skins::Random(SkinSpread::usual()))).unwrap();
    let all: Vec<_> = random.stream(0).take(20).map(Result::unwrap).collect();
    assert_eq!(random.stream(18).next().unwrap().unwrap(), all[18]);
    assert!(all[0].rest == all[15].rest && all[15].rest != all[16].rest);
    for (sample, even) in all.iter().zip(even.stream(0)) {
        let even = even.unwrap();
        assert_eq!(sample.touches, even.touches, "places do not depend on the skin");
        let change = |sample: &super::Sample| {
            let changes = sample.frame.iter().zip(&sample.rest).map(|(a, b)| f64::from(a - b).powi(2));
            changes.sum::<f64>().sqrt()
        };
        let ratio = change(sample) / change(&even);
        assert!((0.3..3.0).contains(&ratio), "a skin of the same kind answers alike: {ratio}");
    }
    let folder = tempfile::tempdir().unwrap();
    make(&random, folder.path(), Shard::WHOLE).unwrap();
    let manifest = finish(folder.path(), || ()).unwrap();
    assert_eq!(manifest.record.tensors[0].rows, "n");
    let mean = all.iter().map(|sample| f64::from(sample.frame[9]) - f64::from(sample.rest[9])).sum::<f64>() / 20.0;
    assert!((manifest.statistics.difference_mean_ohm[9] / mean - 1.0).abs() < 1e-9);
}

#[test]
fn presses_and_skins_that_cannot_be_are_refused() {
    let (design, forward) = skin(DISK);
    let usual = PatchTouches::usual();
    let refused = |touch: PatchTouches, skins: Skins| {
        let recipe = Recipe { seed: 1, samples: 1, touch: Touch::Patch(touch), skins };
        Generator::new(&design, &forward, &recipe).unwrap_err().to_string()
    };
    assert!(refused(PatchTouches { tip_radius_m: [0.001, 0.01], ..usual.clone() }, Skins::Even).contains("sinks"));
    assert!(refused(PatchTouches { force_n: [5.0, 1.0], ..usual.clone() }, Skins::Even).contains("at least 5"));
    assert!(refused(PatchTouches { most: 0, ..usual.clone() }, Skins::Even).contains("the most touches"));
    let spread = SkinSpread { patch_rows: [5, 4], ..SkinSpread::usual() };
    assert!(refused(usual, Skins::Random(spread)).contains("the rows of patches is 4"));
}

/// Networks are measured on the twins `lab-b` and `lab-c` because no training has seen their physics.
#[test]
fn no_recipe_has_the_physics_that_is_kept_for_evaluation() {
    use crate::twin::{Indentation, PatchLattice, PatchShape, TouchOptions, TwinOptions};

    let usual = PatchTouches::usual();
    let refusal = |change: &dyn Fn(&mut PatchTouches)| {
        let mut touches = usual.clone();
        change(&mut touches);
        let recipe = Recipe { seed: 1, samples: 16, touch: Touch::Patch(touches), skins: Skins::Even };
        recipe.check(TouchEffect::ConductanceRises).unwrap_err().to_string()
    };
    assert!(refusal(&|touches| touches.patches.shape = PatchShape::Hexagonal).contains("`touch.patch.patches.shape`"));
    assert!(refusal(&|touches| touches.patches.lattice = PatchLattice::Staggered).contains("patches.lattice`"));
    let rubber = Indentation::HalfSpace;
    assert!(refusal(&|touches| touches.patches.foam.indentation = rubber).contains("patches.foam.indentation`"));
    let lab_b = TwinOptions::shipped("lab-b").unwrap().touch;
    let TouchOptions::Patches(lab_b) = lab_b else { panic!("patches") };
    assert!(refusal(&|touches| touches.patches = lab_b.clone()).contains("no training has seen it"));
    let layer = "skins = \"even\"\n[touch.layer]\ngreatest_rise = 3.0\n";
    let error = Recipe::parse(layer, Path::new("mine.toml"), 1, 16).unwrap_err().to_string();
    assert!(error.contains("unknown variant `layer`"), "{error}");
}
