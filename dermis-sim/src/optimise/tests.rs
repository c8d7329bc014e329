use super::judge::with_noise_of;
use super::*;
use crate::bound::Bounds;
use crate::twin::TouchOptions;
use dermis::geom::vector::distance;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use std::sync::LazyLock;

/// A tube with ten discs in two rings, none of them in the upper half.
const TUBE: &str = r#"
name = "tube"
[body.cylinder]
length_m = 0.1
diameter_m = 0.06
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.disc.radius_m = 0.003
contact_impedance_ohm_m2 = 2e-5
[electrodes.layout]
positions = [
    { z_m = 0.01, theta_rad = 0.000 },
    { z_m = 0.01, theta_rad = 1.257 },
    { z_m = 0.01, theta_rad = 2.513 },
    { z_m = 0.01, theta_rad = 3.770 },
    { z_m = 0.01, theta_rad = 5.026 },
    { z_m = 0.04, theta_rad = 0.628 },
    { z_m = 0.04, theta_rad = 1.885 },
    { z_m = 0.04, theta_rad = 3.141 },
    { z_m = 0.04, theta_rad = 4.398 },
    { z_m = 0.04, theta_rad = 5.655 },
]
[protocol]
pattern = "adjacent"
[image.grid]
rows = 7
columns = 12
[mesh]
max_edge_m = 0.005
electrode_edge_m = 0.0015
"#;

/// `lab`, with patches of 10 mm on the tube.
fn twin() -> TwinOptions {
    let mut twin = TwinOptions::shipped("lab").unwrap();
    if let TouchOptions::Patches(patches) = &mut twin.touch {
        (patches.rows, patches.columns) = (10, 19);
    }
    twin
}

fn optimiser(options: &OptimiseOptions) -> Optimiser {
    Optimiser::new(TUBE, "tube", &twin(), options).unwrap()
}

/// An optimiser with few moves, and its first two starts: they take long.
static FEW_MOVES: LazyLock<(Optimiser, [Start; 2])> = LazyLock::new(|| {
    let optimiser = optimiser(&OptimiseOptions { moves: 3, ..OptimiseOptions::default() });
    let layouts = optimiser.layouts(10).unwrap();
    let starts = [0, 1].map(|index| layouts.start(index).unwrap());
    (optimiser, starts)
});

fn moved(electrodes_m: &[Point3]) -> SkinDesign {
    SkinDesign::parse(&design_text(TUBE, "tube", "moved", electrodes_m, None).unwrap(), "moved").unwrap()
}

/// Discs shield what is beside them, which the fast model leaves out: presses within two radii of a disc are not compared.
#[test]
fn the_fast_model_has_the_exact_bounds() {
    let (optimiser, starts) = &*FEW_MOVES;
    let layouts = optimiser.layouts(10).unwrap();
    for Start { electrodes_m, .. } in starts {
        let design = moved(electrodes_m);
        let bounds = Bounds::new(&design, &twin(), &BoundOptions::default()).unwrap();
        let mut logarithms = Vec::new();
        for (place_m, model_m) in layouts.model_bounds(electrodes_m).unwrap() {
            let away = |centre: &Point3| design.body.surface().distance_m(*centre, place_m);
            if electrodes_m.iter().map(away).fold(f64::INFINITY, f64::min) > 0.012 {
                let exact_m =
                    bounds.position(place_m, [place_m[0] / 0.03, place_m[1] / 0.03, 0.0]).unwrap().unwrap().sd_m;
                logarithms.push([model_m.ln(), exact_m.ln()]);
            }
        }
        let (correlation, ratio) = compared(&logarithms);
        println!("{} places: correlation {correlation:.3}, ratio {ratio:.3}", logarithms.len());
        assert!(correlation > 0.93 && (0.9..1.1).contains(&ratio), "{correlation} {ratio}");
    }
}

/// Correlation, and the geometric mean of the ratios.
fn compared(logarithms: &[[f64; 2]]) -> (f64, f64) {
    let count = logarithms.len() as f64;
    let mean = [0, 1].map(|k| logarithms.iter().map(|pair| pair[k]).sum::<f64>() / count);
    let sum = |i: usize, j: usize| logarithms.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>();
    (sum(0, 1) / (sum(0, 0) * sum(1, 1)).sqrt(), (mean[0] - mean[1]).exp())
}

#[test]
fn a_bad_layout_becomes_better_and_obeys_the_rules() {
    let zone = Zone { centre_m: [0.03, 0.0, 0.05], radius_m: 0.012 };
    let rules = PlaceRules { least_distance_m: Some(0.015), edge_m: 0.006, forbidden: vec![zone] };
    let options = OptimiseOptions { moves: 30, rules, ..OptimiseOptions::default() };
    let given = SkinDesign::parse(TUBE, "tube").unwrap();
    let start = optimiser(&options).layouts(10).unwrap().start(0).unwrap();
    let judged = |design: &SkinDesign| judge(design, &twin(), &options.bound).unwrap();
    let (before, after) = (judged(&given), judged(&moved(&start.electrodes_m)));
    println!("{:.3} mm, {:.3} mm", 1e3 * before.mean_m, 1e3 * after.mean_m);
    assert!(after.mean_m < 0.5 * before.mean_m, "the upper half of the tube has no electrodes");
    let surface = given.body.surface();
    for (index, place_m) in start.electrodes_m.iter().enumerate() {
        assert!((0.006 - 1e-9..=0.094 + 1e-9).contains(&place_m[2]), "{place_m:?}");
        assert!(distance(*place_m, zone.centre_m) >= zone.radius_m, "{place_m:?}");
        for other in &start.electrodes_m[..index] {
            assert!(surface.distance_m(*other, *place_m) >= 0.015 - 1e-9, "{other:?} {place_m:?}");
        }
    }
}

#[test]
fn arcs_keep_no_distance_from_the_edge() {
    let options =
        OptimiseOptions { rules: PlaceRules { edge_m: 0.005, ..PlaceRules::default() }, ..OptimiseOptions::default() };
    let options = SearchOptions { optimise: options, ..SearchOptions::default() };
    let refused = optimise("skin16", &twin(), &options, "unwritten.toml".as_ref(), || ()).unwrap_err();
    assert!(refused.to_string().contains("arcs lie on the edge"), "{refused}");
}

/// A map of the bounds needs a value for each pixel.
#[test]
fn a_pixel_under_an_electrode_has_no_bound_and_keeps_its_place() {
    let given = SkinDesign::parse(TUBE, "tube").unwrap();
    let pixels = PixelSpace::for_design(&given, &Mesh::generate(&given).unwrap()).unwrap();
    let mut electrodes_m = centres_m(&given);
    electrodes_m[9] = pixels.centres_m[70];
    let judgement = judge(&moved(&electrodes_m), &twin(), &BoundOptions::default()).unwrap();
    let places_m: Vec<Point3> = judgement.places.iter().map(|place| place.position_m).collect();
    assert_eq!(places_m, pixels.centres_m);
    assert!(judgement.places[70].sd_m.is_nan() && judgement.mean_m.is_finite());
}

#[test]
fn a_start_depends_on_its_index_and_the_seed_alone() {
    let (optimiser, [_, another]) = &*FEW_MOVES;
    let start = || optimiser.layouts(10).unwrap().start(2).unwrap();
    let third = start();
    assert_eq!(third, start());
    assert_ne!(another.electrodes_m, third.electrodes_m);
}

/// Half of the readings of an adjacent pattern repeat the others by reciprocity: the best half costs less than the noise
/// of half the frames, and it is not any half.
#[test]
fn the_best_half_of_the_readings_is_chosen() {
    let (design, options) = (moved(&FEW_MOVES.1[0].electrodes_m), BoundOptions::default());
    let select = |slots: usize| select_readings(&design, &twin(), &options, Objective::Mean, slots, |_| {});
    // 10 drives x 9 measures and 10 currents.
    let all = select(100).unwrap();
    assert_eq!(all, design.protocol.channels());
    let half = select(45 + 10).unwrap();
    let repeated = half.iter().filter(|channel| half.contains(&channel.reciprocal())).count();
    let mean = |channels: &[Channel]| {
        let protocol = dermis::protocol::Protocol::new(10, channels.to_vec()).unwrap();
        let part = SkinDesign { protocol, ..design.clone() };
        judge(&part, &with_noise_of(&twin(), &part, &design).unwrap(), &options).unwrap().mean_m
    };
    let [full, chosen, first] = [mean(&all), mean(&half), mean(&all[..half.len()])];
    println!(
        "mean {:.3} mm, half {:.3} mm, first half {:.3} mm; {repeated} of {} are read both ways",
        1e3 * full,
        1e3 * chosen,
        1e3 * first,
        half.len()
    );
    assert!(full < chosen && chosen < 2f64.sqrt() * full && chosen < first, "{full} {chosen} {first}");
    for slots in [4, 101] {
        let message = select(slots).unwrap_err().to_string();
        assert!(message.contains(&slots.to_string()), "{message}");
    }
}

#[test]
fn the_text_of_a_design_keeps_all_but_the_electrodes() {
    let given = SkinDesign::parse(TUBE, "tube").unwrap();
    let mut electrodes_m = centres_m(&given);
    electrodes_m[0] = [0.03, 0.0, 0.08];
    let new = moved(&electrodes_m);
    let moved_m = centres_m(&new).into_iter().zip(electrodes_m).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
    assert!(moved_m < 1e-6, "rounded to a micrometre: {moved_m}");
    assert_eq!((&new.body, &new.sheet, &new.mesh), (&given.body, &given.sheet, &given.mesh));
    assert_eq!(new.electrodes[0].contact_impedance, 2e-5);
    assert_eq!(new.electrodes[5].shape, given.electrodes[5].shape);
}
