use crate::evaluate::{EvaluateError, match_contacts, resolves_two, score};
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::Detector;
use dermis::geom::{Point3, Surface};
use dermis::image::{Image, PixelSpace};
use dermis::mesh::Mesh;
use std::sync::Arc;

/// The pixels of the paper's skin.
fn cylinder_space() -> Arc<PixelSpace> {
    let design = SkinDesign::shipped("cylinder30").unwrap();
    Arc::new(PixelSpace::for_design(&design, &Mesh::generate(&design).unwrap()).unwrap())
}

/// An image of Gaussian peaks: position, height and width.
fn bumps(space: &Arc<PixelSpace>, bumps: &[(Point3, f64, f64)]) -> Image {
    let value = |&at: &Point3| -> f64 {
        let bump = |&(centre, height, width): &(Point3, f64, f64)| {
            height * (-0.5 * (space.surface.distance_m(at, centre) / width).powi(2)).exp()
        };
        bumps.iter().map(bump).sum()
    };
    Image { values: space.centres_m.iter().map(value).collect(), space: Arc::clone(space) }
}

fn touch(surface: &Surface, z_m: f64, theta_rad: f64, force_n: f64) -> Contact {
    let position = surface.at(z_m, theta_rad).unwrap();
    Contact::truth(position, surface.normal(position).unwrap(), force_n)
}

#[test]
fn the_smallest_total_wins_over_the_nearest_pair_and_far_pairs_are_misses_and_false_positives() {
    let surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    let at = |z: f64| touch(&surface, z, 0.0, 1.0);
    // The contact at 12 is nearest to the touch at 11, but then the one at 19 would be assigned to 0.
    let found = match_contacts(&[at(0.100), at(0.111)], &[at(0.112), at(0.119)], &surface);
    assert_eq!(found.pairs.iter().map(|pair| (pair.0, pair.1)).collect::<Vec<_>>(), vec![(0, 0), (1, 1)]);
    let found = match_contacts(&[at(0.05)], &[at(0.071), at(0.2)], &surface);
    assert_eq!((found.pairs.len(), found.missed, found.false_positives), (0, vec![0], vec![0, 1]));
    let found = match_contacts(&[], &[at(0.1)], &surface);
    assert_eq!(found.false_positives, vec![0]);
}

#[test]
fn the_score_of_a_small_experiment_is_known() {
    let space = cylinder_space();
    let surface = space.surface;
    // Frame 0: contact 3 mm off along z. Frame 1: contact far from the touch, 43 mm away. Frame 2: no contact.
    let image = |z: f64, height: f64| bumps(&space, &[(surface.at(z, 0.01).unwrap(), height, 0.015)]);
    let images = [image(0.153, 2.0), image(0.193, 3.0), bumps(&space, &[])];
    let truth = vec![
        vec![touch(&surface, 0.15, 0.01, 1.0)],
        vec![touch(&surface, 0.15, 0.01, 1.5)],
        vec![touch(&surface, 0.15, 0.01, f64::NAN)],
    ];
    let score = score(&images, &truth, &Detector::default(), "test", Some(0.3)).unwrap();
    assert_eq!((score.presses, score.misses, score.false_positives), (3, 2, 1));
    assert!((score.localisation_m.mean - 0.003).abs() < 2e-4 && score.localisation_m.sd == 0.0);
    // Eq. 11 has no gate; the image without a positive value has no centroid.
    assert!((score.eq11_m.mean - 0.023).abs() < 5e-4, "{:?}", score.eq11_m);
    // Peaks of 2 and 3 over 1 and 1.5 N, both 2 mm from a pixel centre.
    assert!(score.sensitivity_spread < 1e-3);
    let json = serde_json::to_value(&score).unwrap();
    let mut keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    assert_eq!(
        keys,
        [
            "alpha",
            "eq11_m",
            "false_positives",
            "force",
            "localisation_m",
            "method",
            "misses",
            "presses",
            "sensitivity_spread",
            "strength_spread"
        ]
    );
    for key in ["localisation_m", "eq11_m"] {
        let mut keys: Vec<&str> = json[key].as_object().unwrap().keys().map(String::as_str).collect();
        keys.sort_unstable();
        assert_eq!(keys, ["largest_tenth", "mean", "median", "p95", "sd"]);
    }
}

#[test]
fn an_unknown_force_leaves_the_spread_open_and_a_missing_frame_is_an_error() {
    let space = cylinder_space();
    let truth = vec![vec![touch(&space.surface, 0.15, 1.0, f64::NAN)]];
    let images = [bumps(&space, &[(space.surface.at(0.15, 1.0).unwrap(), 1.0, 0.015)])];
    let found = score(&images, &truth, &Detector::default(), "test", None).unwrap();
    assert!(found.sensitivity_spread.is_nan());
    assert!(serde_json::to_value(&found).unwrap()["sensitivity_spread"].is_null());
    let error = score(&images, &[], &Detector::default(), "test", None).unwrap_err();
    assert_eq!(error, EvaluateError::Count { images: 1, truths: 0 });
}

#[test]
fn two_touches_are_resolved_by_two_near_contacts_alone() {
    let surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    let at = |z: f64| touch(&surface, z, 0.0, 1.0);
    let touches = [at(0.100), at(0.124)];
    assert!(resolves_two(&touches, &[at(0.093), at(0.125)], &surface));
    // 9 mm is within 10 mm, but more than a third of 24 mm.
    assert!(!resolves_two(&touches, &[at(0.091), at(0.125)], &surface));
    assert!(!resolves_two(&touches, &[at(0.1), at(0.124), at(0.2)], &surface));
    assert!(!resolves_two(&touches, &[at(0.1)], &surface));
    // 11 mm is too far, for any distance of the touches.
    assert!(!resolves_two(&[at(0.1), at(0.2)], &[at(0.1), at(0.211)], &surface));
}

#[test]
fn a_method_that_finds_nothing_at_all_gets_advice() {
    let space = cylinder_space();
    let truth = vec![vec![touch(&space.surface, 0.1, 1.0, 2.0)]];
    let place = truth[0][0].position_m;
    let scored = |height: f64| {
        score(&[bumps(&space, &[(place, height, 0.01)])], &truth, &Detector::default(), "a method", None).unwrap()
    };
    assert!(scored(0.0).advice().is_some_and(|advice| advice.contains("train a network longer")));
    assert_eq!(scored(1.0).advice(), None);
}
