use crate::contact::{ConductanceChange, GATE_M};
use crate::detect::{DetectOptions, Detector, ImageNoise, detect, normal_tail, whole_image_centroid};
use crate::forward::Matrix;
use crate::geom::Surface;
use crate::image::tests::{bumps, cylinder_space};
use crate::image::{Image, PixelSpace};
use crate::mesh::{Cells, Mesh};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::sync::Arc;

/// A standard normal number (Box and Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (TAU * rng.random::<f64>()).cos()
}

fn with_white_noise(image: &Image, sd: f64, rng: &mut ChaCha8Rng) -> Image {
    let values = image.values.iter().map(|value| value + sd * normal(rng)).collect();
    Image { space: Arc::clone(&image.space), values }
}

/// White noise in the pixels.
fn white(space: &PixelSpace, sd: f64) -> ImageNoise {
    let count = space.len();
    let mut unit = Matrix { rows: count, columns: count, values: vec![0.0; count * count] };
    (0..count).for_each(|pixel| unit.values[pixel * count + pixel] = 1.0);
    ImageNoise::from_matrix(&unit, &vec![sd; count])
}

#[test]
fn a_peak_is_found_at_its_centre_also_across_the_seam() {
    let space = cylinder_space();
    for theta in [0.0, 0.03, 0.1, 1.234, TAU - 0.05] {
        let centre = space.surface.at(0.1537, theta).unwrap();
        let image = bumps(&space, &[(centre, 2.0, 0.015)]);
        let contacts = detect(&image, &DetectOptions::default());
        assert_eq!(contacts.len(), 1, "theta {theta}");
        // A twentieth of a pixel.
        let error = space.surface.distance_m(contacts[0].position_m, centre);
        assert!(error < 0.5e-3, "theta {theta}: {error}");
        // Half height of a Gaussian: pi 2 ln 2 width^2.
        let area = std::f64::consts::PI * 2.0 * 2.0_f64.ln() * 0.015 * 0.015;
        assert!((contacts[0].area_m2 / area - 1.0).abs() < 0.15, "{}", contacts[0].area_m2);
        assert!(contacts[0].sd_m < GATE_M && contacts[0].confidence > 0.95);
        let outwards = space.surface.normal(centre).unwrap();
        assert!(crate::geom::vector::dot(contacts[0].normal, outwards) > 0.999);
        assert!(space.surface.distance_m(whole_image_centroid(&image).unwrap(), centre) < 0.5e-3);
    }
}

/// Contacts of both signs, the highest first; thresholds are those of the highest of either sign.
#[test]
fn contacts_of_both_signs_say_which_they_have() {
    let space = cylinder_space();
    let place = |theta| space.surface.at(0.15, theta).unwrap();
    let image = bumps(&space, &[(place(0.5), 1.0, 0.012), (place(2.5), -2.0, 0.012), (place(4.5), 0.5, 0.012)]);
    assert_eq!(detect(&image, &DetectOptions::default()).len(), 2);
    let detector = Detector::new(DetectOptions::default()).with_both_signs(ConductanceChange::Falls);
    let contacts = detector.detect(&image);
    let found: Vec<_> = contacts.iter().map(|contact| (contact.id, contact.conductance)).collect();
    assert_eq!(found, [(0, Some(ConductanceChange::Rises)), (1, Some(ConductanceChange::Falls))]);
    assert!(space.surface.distance_m(contacts[0].position_m, place(2.5)) < 1e-3);
    assert!(space.surface.distance_m(contacts[1].position_m, place(0.5)) < 1e-3);
    assert!(contacts.iter().all(|contact| contact.strength > 0.0));
    assert!(detect(&image, &DetectOptions::default()).iter().all(|contact| contact.conductance.is_none()));
}

#[test]
fn two_bumps_are_two_contacts_the_higher_first_and_a_ripple_is_none() {
    let space = cylinder_space();
    let (a, b) = (space.surface.at(0.10, 0.02).unwrap(), space.surface.at(0.16, 6.2).unwrap());
    let contacts = detect(&bumps(&space, &[(a, 1.0, 0.012), (b, 2.0, 0.012)]), &DetectOptions::default());
    assert_eq!(contacts.iter().map(|contact| contact.id).collect::<Vec<_>>(), vec![0, 1]);
    assert!(space.surface.distance_m(contacts[0].position_m, b) < 1e-3);
    assert!(space.surface.distance_m(contacts[1].position_m, a) < 1e-3);
    assert!(contacts[0].confidence > contacts[1].confidence);
    // Closer than a width they are one contact.
    let near = space.surface.at(0.111, 0.02).unwrap();
    assert_eq!(detect(&bumps(&space, &[(a, 1.0, 0.012), (near, 1.0, 0.012)]), &DetectOptions::default()).len(), 1);
    // A narrow artefact: below the accepted fraction of the contact's strength.
    let narrow = |height: f64| bumps(&space, &[(a, height, 0.006), (b, 2.0, 0.02)]);
    assert_eq!(detect(&narrow(2.0), &DetectOptions::default()).len(), 1);
    let all = DetectOptions { strength_fraction: 0.0, ..DetectOptions::default() };
    assert_eq!(detect(&narrow(2.0), &all).len(), 2);
    // A touch that is higher than a wide change, such as that of a drifting sheet, is none.
    let contacts = detect(&narrow(8.0), &DetectOptions::default());
    assert_eq!(contacts.len(), 2);
    assert!(space.surface.distance_m(contacts[0].position_m, a) < 5e-3);
    // A side lobe below the accepted fraction of the peak.
    assert_eq!(detect(&bumps(&space, &[(a, 0.2, 0.012), (b, 2.0, 0.012)]), &DetectOptions::default()).len(), 1);
}

#[test]
fn cards_without_a_least_strength_have_none() {
    let card: DetectOptions = serde_json::from_str("{\"peak_fraction\": 0.15}").unwrap();
    assert_eq!((card.peak_fraction, card.strength_fraction), (0.15, 0.0));
    assert_eq!(card.noise_factor, DetectOptions::default().noise_factor);
}

#[test]
fn noise_alone_makes_no_contact() {
    let space = cylinder_space();
    let nothing = bumps(&space, &[]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let known = Detector::default().with_noise(white(&space, 0.3));
    for _ in 0..50 {
        let image = with_white_noise(&nothing, 0.3, &mut rng);
        assert!(known.detect(&image).is_empty());
        assert!(detect(&image, &DetectOptions::default()).is_empty());
    }
    assert!(detect(&nothing, &DetectOptions::default()).is_empty());
    assert_eq!(whole_image_centroid(&nothing), None);
}

#[test]
fn the_scatter_of_positions_equals_the_stated_standard_deviation() {
    let space = cylinder_space();
    let centre = space.surface.at(0.152, 3.0).unwrap();
    let image = bumps(&space, &[(centre, 1.0, 0.02)]);
    let sd = 0.03;
    let noise = white(&space, sd);
    let detector = Detector::default().with_noise(noise.clone());
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let still = detector.detect(&image)[0].position_m;
    let (peak, height) = image.peak().unwrap();
    let floor = DetectOptions::default().weight_fraction * height;
    let (mut scatter, mut predicted, count) = (0.0, 0.0, 400);
    for _ in 0..count {
        let noisy = with_white_noise(&image, sd, &mut rng);
        let contacts = detector.detect(&noisy);
        assert_eq!(contacts.len(), 1);
        let [round, along] = space.surface.chart(still, contacts[0].position_m);
        scatter += 0.5 * (round * round + along * along) / count as f64;
        let inside: Vec<usize> = (0..space.len()).filter(|&p| image.values[p] > floor).collect();
        predicted += noise.centroid_variance_m2(&image, &inside, peak, floor, still) / count as f64;
    }
    // 400 draws of two axes give a standard deviation to 2.5 %; noise at the border of the contact adds a little.
    let ratio = (scatter / predicted).sqrt();
    assert!((0.9..1.3).contains(&ratio), "{ratio}");
}

#[test]
fn untouched_images_give_the_noise_and_no_pixel_is_below_the_root_mean_square() {
    let space = cylinder_space();
    let nothing = bumps(&space, &[]);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let loud = |pixel: usize| pixel.is_multiple_of(4);
    let image = |_| {
        let mut image = with_white_noise(&nothing, 0.5, &mut rng);
        image.values.iter_mut().enumerate().filter(|(pixel, _)| !loud(*pixel)).for_each(|(_, value)| *value = 0.0);
        image
    };
    let images: Vec<Image> = (0..200).map(image).collect();
    let noise = ImageNoise::from_untouched(&images).unwrap();
    let mean = |which: &dyn Fn(usize) -> bool| {
        let sd: Vec<f64> =
            (0..noise.pixel_count()).filter(|&pixel| which(pixel)).map(|pixel| noise.sd()[pixel]).collect();
        sd.iter().sum::<f64>() / sd.len() as f64
    };
    // A quarter of the pixels is noisy: the root mean square is half of their deviation.
    let [loud, quiet] = [mean(&loud), mean(&|pixel| !loud(pixel))];
    assert!((loud / 0.5 - 1.0).abs() < 0.01, "{loud}");
    assert!((quiet / 0.25 - 1.0).abs() < 0.01, "{quiet}");
    assert!(ImageNoise::from_untouched(&[]).is_none());
}

#[test]
fn values_that_are_not_finite_are_no_contact() {
    let space = cylinder_space();
    let centre = space.surface.at(0.15, 1.0).unwrap();
    let mut image = bumps(&space, &[(centre, 1.0, 0.02)]);
    image.values[0] = f64::NAN;
    image.values[1] = f64::INFINITY;
    let contacts = detect(&image, &DetectOptions::default());
    assert_eq!(contacts.len(), 1);
    assert!(space.surface.distance_m(contacts[0].position_m, centre) < 1e-3);
    image.values.fill(f64::NAN);
    assert!(detect(&image, &DetectOptions::default()).is_empty());
    assert_eq!(whole_image_centroid(&image), None);
}

#[test]
fn on_a_free_surface_a_contact_lies_on_the_surface() {
    // A square tilted by 45 degrees about x.
    let n = 12;
    let half = 0.5_f64.sqrt();
    let node = |i: usize, j: usize| j * (n + 1) + i;
    let nodes =
        (0..=n).flat_map(|j| (0..=n).map(move |i| [0.01 * i as f64, 0.01 * j as f64 * half, 0.01 * j as f64 * half]));
    let cells = (0..n).flat_map(|j| {
        (0..n).flat_map(move |i| {
            let corners = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
        })
    });
    let mesh = Mesh {
        nodes: nodes.collect(),
        cells: Cells::Triangles(cells.collect()),
        electrodes: Vec::new(),
        regions: Vec::new(),
    };
    let space = Arc::new(PixelSpace::cells(&mesh, Surface::Free));
    let centre = [0.06, 0.05 * half, 0.05 * half];
    let contacts = detect(&bumps(&space, &[(centre, 1.0, 0.015)]), &DetectOptions::default());
    assert_eq!(contacts.len(), 1);
    let [x, y, z] = contacts[0].position_m;
    assert!((y - z).abs() < 1e-12 && (x - 0.06).hypot((y - centre[1]).hypot(z - centre[2])) < 1e-3);
    assert!((contacts[0].normal[2] - half).abs() < 1e-12);
}

#[test]
fn the_tail_of_the_normal_distribution_is_known() {
    for (z, tail) in [(0.0, 0.5), (1.0, 0.158_655_254), (3.0, 1.349_898e-3), (5.0, 2.866_516e-7)] {
        assert!((normal_tail(z) - tail).abs() < 8e-8, "{z}: {}", normal_tail(z));
    }
}
