use super::*;
use crate::reconstruct::Prior;
use crate::reconstruct::testing::{blurring, rows_of_pixels};

/// Both forms solve the same equations of condition number up to 1e6.
const FORMS: f64 = 1e-9;
/// A gradient is a difference of larger terms.
const GRADIENT: f64 = 1e-7;

fn relative(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    (a - b).norm_l2() / b.norm_l2()
}

/// Parameter space and data space give the same matrix, for either size relation and for every prior; a Laplace prior
/// of pixels in several pieces has several constants in its null space.
#[test]
fn both_forms_are_equal() {
    for (channels, pieces) in [(12, vec![30]), (30, vec![12]), (20, vec![9, 1, 15])] {
        let pixels = rows_of_pixels(&pieces);
        let model = blurring(channels, pixels.len(), 3).jacobian;
        let jacobian = MatRef::from_row_major_slice(&model.values, model.rows, model.columns).to_owned();
        for prior in [Prior::Tikhonov, Prior::Noser { exponent: 0.5 }, Prior::Noser { exponent: 1.0 }, Prior::Laplace] {
            let penalty = prior.matrix(jacobian.as_ref(), &pixels).unwrap();
            let parameter = System::parameter(jacobian.clone(), penalty.clone());
            let data = System::data(jacobian.clone(), penalty).unwrap();
            let mu = 1e-3 * parameter.scale().unwrap();
            let difference = relative(&data.inverse(mu).unwrap(), &parameter.inverse(mu).unwrap());
            println!("{channels} channels, {pieces:?} pixels, {}: forms differ by {difference:.1e}", prior.name());
            assert!(difference < FORMS);
            for system in [&parameter, &data] {
                let frame: Vec<f64> = (0..channels).map(|channel| (channel as f64).cos()).collect();
                let whole = system.inverse(mu).unwrap() * faer::ColRef::from_slice(&frame).as_mat();
                let alone = system.solve(&frame, mu).unwrap();
                assert!((0..alone.len()).all(|p| (alone[p] - whole[(p, 0)]).abs() < FORMS * whole.norm_l2()));
            }
        }
    }
}

/// The matrix solves the normal equations that define it.
#[test]
fn the_gradient_vanishes_at_the_image() {
    let pixels = rows_of_pixels(&[25, 4]);
    let model = blurring(10, 29, 5).jacobian;
    let jacobian = MatRef::from_row_major_slice(&model.values, 10, 29).to_owned();
    let penalty = Prior::Laplace.matrix(jacobian.as_ref(), &pixels).unwrap();
    let system = System::new(jacobian.clone(), penalty.clone()).unwrap();
    let mu = 0.01;
    let inverse = system.inverse(mu).unwrap();
    let back = jacobian.transpose() * (&jacobian * &inverse - Mat::<f64>::identity(10, 10));
    for channel in 0..10 {
        let image: Vec<f64> = inverse.col(channel).iter().copied().collect();
        for (pull, gradient) in penalty.apply(&image).iter().zip(back.col(channel).iter()) {
            let scale = mu * penalty.apply(&image).iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            assert!((mu * pull + gradient).abs() < GRADIENT * scale, "{} of {scale}", mu * pull + gradient);
        }
    }
}

/// A pixel without sensitivity stays at zero in both forms.
#[test]
fn an_unseen_pixel_stays_at_zero() {
    let pixels = rows_of_pixels(&[8]);
    let mut model = blurring(5, 8, 1).jacobian;
    (0..5).for_each(|channel| *model.at_mut(channel, 3) = 0.0);
    let jacobian = MatRef::from_row_major_slice(&model.values, 5, 8).to_owned();
    let penalty = Prior::default().matrix(jacobian.as_ref(), &pixels).unwrap();
    let parameter = System::parameter(jacobian.clone(), penalty.clone()).inverse(0.1).unwrap();
    let data = System::data(jacobian, penalty).unwrap().inverse(0.1).unwrap();
    assert!(relative(&data, &parameter) < FORMS);
    assert_eq!(data.row(3).norm_l2(), 0.0);
}

/// With a Laplace prior, the level of a piece without sensitivity is not determined.
#[test]
fn an_unseen_piece_is_an_error_with_a_laplace_prior() {
    let pixels = rows_of_pixels(&[6, 2]);
    let mut model = blurring(5, 8, 1).jacobian;
    (0..5).for_each(|channel| (6..8).for_each(|pixel| *model.at_mut(channel, pixel) = 0.0));
    let jacobian = MatRef::from_row_major_slice(&model.values, 5, 8).to_owned();
    let penalty = Prior::Laplace.matrix(jacobian.as_ref(), &pixels).unwrap();
    assert!(matches!(System::data(jacobian, penalty).unwrap().inverse(0.1), Err(ReconstructError::Singular(_))));
}
