//! Figures of merit of the image of a small target (Adler et al. 2009, DOI 10.1088/0967-3334/30/6/S03).

use crate::geom::Point3;
use crate::image::Image;

/// Figures of merit of the image of a small target.
///
/// They use the quarter-amplitude set: the pixels whose value is at least a quarter of the maximum. Adler et al. sum
/// over equal pixels; here every pixel is weighted by its area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiguresOfMerit {
    /// The image's integral over the target's contrast times area: should be constant over the skin.
    pub amplitude_response: f64,
    /// Distance along the surface from the target to the centre of gravity of the quarter-amplitude set, m.
    pub position_error_m: f64,
    /// Square root of the fraction of the body in the quarter-amplitude set: should be small and constant over the
    /// skin.
    pub resolution: f64,
    /// The fraction of the quarter-amplitude set outside the circle of equal area around its centre of gravity.
    pub shape_deformation: f64,
    /// The negative sum outside that circle over the sum inside it.
    pub ringing: f64,
}

/// The figures of merit of the image of a small target at `target_m` whose relative contrast times area is
/// `target_strength_m2`; `None` for an image without a positive value.
pub fn figures_of_merit(image: &Image, target_m: Point3, target_strength_m2: f64) -> Option<FiguresOfMerit> {
    /// The quarter-amplitude set.
    const PART: f64 = 0.25;
    let space = &image.space;
    let (peak, largest) = image.values.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    if !(largest.is_finite() && largest > 0.0) {
        return None;
    }
    let set: Vec<usize> = (0..space.len()).filter(|&pixel| image.values[pixel] >= PART * largest).collect();
    let weighted = set.iter().map(|&pixel| (space.centres_m[pixel], space.areas[pixel]));
    let centre = space.surface.weighted_mean(space.centres_m[peak], weighted);
    let set_area: f64 = set.iter().map(|&pixel| space.areas[pixel]).sum();
    let radius = (set_area / std::f64::consts::PI).sqrt();
    let outside = |pixel: usize| space.surface.distance_m(centre, space.centres_m[pixel]) > radius;
    let (mut inside_sum, mut negative_sum, mut total) = (0.0, 0.0, 0.0);
    for (pixel, (&value, &area)) in image.values.iter().zip(&space.areas).enumerate() {
        total += value * area;
        if !outside(pixel) {
            inside_sum += value * area;
        } else {
            negative_sum += (-value).max(0.0) * area;
        }
    }
    let outside_area: f64 = set.iter().filter(|&&pixel| outside(pixel)).map(|&pixel| space.areas[pixel]).sum();
    Some(FiguresOfMerit {
        amplitude_response: total / target_strength_m2,
        position_error_m: space.surface.distance_m(centre, target_m),
        resolution: (set_area / space.areas.iter().sum::<f64>()).sqrt(),
        shape_deformation: outside_area / set_area,
        ringing: negative_sum / inside_sum,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Surface;
    use crate::image::PixelSpace;
    use std::sync::Arc;

    /// A square of 20 x 20 pixels of 1 m.
    fn square(of: impl Fn(f64, f64) -> f64) -> Image {
        let centres: Vec<Point3> = (0..400).map(|at| [(at % 20) as f64 + 0.5, (at / 20) as f64 + 0.5, 0.0]).collect();
        let values = centres.iter().map(|centre| of(centre[0], centre[1])).collect();
        let space = PixelSpace {
            surface: Surface::Plane,
            grid: Some([20, 20]),
            position_in_grid: (0..400).collect(),
            normals: vec![[0.0, 0.0, 1.0]; 400],
            areas: vec![1.0; 400],
            neighbours: vec![Vec::new(); 400],
            edge_m: Vec::new(),
            overlaps: vec![Vec::new(); 400],
            centres_m: centres,
        };
        Image { space: Arc::new(space), values }
    }

    #[test]
    fn an_even_square_has_figures_that_can_be_counted() {
        // 4 x 4 pixels of value 2 from (8, 4) to (12, 8), and one pixel of -1 far away.
        let image = square(|x, y| {
            if (8.0..12.0).contains(&x) && (4.0..8.0).contains(&y) {
                2.0
            } else if x < 1.0 && y > 19.0 {
                -1.0
            } else {
                0.0
            }
        });
        let merit = figures_of_merit(&image, [10.0, 9.0, 0.0], 62.0).unwrap();
        assert!((merit.amplitude_response - 31.0 / 62.0).abs() < 1e-12);
        assert!((merit.position_error_m - 3.0).abs() < 1e-12);
        assert!((merit.resolution - (16.0_f64 / 400.0).sqrt()).abs() < 1e-12);
        // The circle of 16 m2 has the radius 2.26 m: it contains all pixels except the corner pixels, which are at 2.12
        // m.
        assert_eq!(merit.shape_deformation, 0.0);
        assert!((merit.ringing - 1.0 / 32.0).abs() < 1e-12);
    }

    #[test]
    fn a_long_shape_is_deformed() {
        // 1 x 9 pixels: the circle has the radius 1.69 m and contains three of them.
        let image = square(|x, y| if (5.0..14.0).contains(&x) && (7.0..8.0).contains(&y) { 1.0 } else { 0.0 });
        let merit = figures_of_merit(&image, [9.5, 7.5, 0.0], 9.0).unwrap();
        assert!((merit.shape_deformation - 6.0 / 9.0).abs() < 1e-12);
        assert!(figures_of_merit(&square(|_, _| -1.0), [0.0; 3], 1.0).is_none());
    }
}
