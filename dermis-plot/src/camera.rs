//! Viewing directions of a scene.

use crate::projection::{Light, Projection};
use crate::scene::Scene;
use dermis::geom::Point3;
use dermis::geom::vector::cross;

/// A viewing direction. Angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Azimuth around the z axis, from +x towards +y.
    pub azimuth_rad: f64,
    /// Elevation above the plane z = 0.
    pub elevation_rad: f64,
}

/// Smallest cosine between view and normal at which a mark or a number on the skin is readable.
pub(crate) const READABLE: f64 = 0.3;
/// Step of the azimuth when choosing views, degrees: a divisor of the angles between 2, 3 and 4 evenly spaced views.
const STEP_DEGREES: usize = 10;
/// Elevation of evenly spaced views, degrees: the upper rim of a cylinder shows that it is open.
const ELEVATION_DEGREES: f64 = 22.0;
/// Further elevations, for marks on the top or the bottom.
const FURTHER_DEGREES: [f64; 4] = [ELEVATION_DEGREES, -ELEVATION_DEGREES, 65.0, -65.0];
/// Maximum number of views of a picture.
const MAX_VIEWS: usize = 6;

impl Camera {
    /// A camera by its angles in degrees.
    pub(crate) fn degrees(azimuth: f64, elevation: f64) -> Self {
        Camera { azimuth_rad: azimuth.to_radians(), elevation_rad: elevation.to_radians() }
    }

    /// Right, up, and towards the viewer.
    pub(crate) fn axes(&self) -> [Point3; 3] {
        let ((sa, ca), (se, ce)) = (self.azimuth_rad.sin_cos(), self.elevation_rad.sin_cos());
        let towards = [ce * ca, ce * sa, se];
        let right = [-sa, ca, 0.0];
        [right, cross(towards, right), towards]
    }

    /// The cameras for a scene: as few as are needed to show every mark and every label, evenly spaced around the body
    /// if possible, and rotated so that the least visible target faces its camera as much as possible. A flat skin
    /// needs one.
    pub fn for_scene(scene: &Scene) -> Vec<Camera> {
        let heights = || scene.tiles.iter().flat_map(|tile| tile.corners.iter().map(|corner| corner[2]));
        if heights().all(|z_m| Some(z_m) == heights().next()) {
            // x to the right and y to the back.
            return vec![Camera::degrees(-75.0, 42.0)];
        }
        let targets: Vec<(Point3, Point3)> = scene
            .dots
            .iter()
            .map(|dot| (dot.at, dot.normal))
            .chain(scene.labels.iter().map(|label| (label.at, label.normal)))
            .collect();
        let steps = 360 / STEP_DEGREES;
        let ring =
            |elevation: f64| (0..steps).map(move |step| Camera::degrees((step * STEP_DEGREES) as f64, elevation));
        let level: Vec<Sight> = ring(ELEVATION_DEGREES).map(|camera| Sight::of(scene, camera, &targets)).collect();
        for count in 2..=4 {
            let apart = steps / count;
            let even = |turn: usize| (0..count).map(move |view| turn + view * apart);
            let worst =
                |turn: &usize| worst(&even(*turn).map(|index| &level[index]).collect::<Vec<_>>(), targets.len());
            // `max_by` returns the last of equal elements: in reverse order, the first.
            let turn = (0..apart).rev().max_by(|a, b| worst(a).total_cmp(&worst(b))).unwrap_or(0);
            if worst(&turn) > READABLE {
                return even(turn).map(|index| level[index].camera).collect();
            }
        }
        let all: Vec<Sight> =
            FURTHER_DEGREES.into_iter().flat_map(ring).map(|camera| Sight::of(scene, camera, &targets)).collect();
        one_by_one(&all, targets.len())
    }
}

/// The visibility of targets from a camera.
struct Sight {
    camera: Camera,
    /// Cosine between each target and the camera; -1 if it is hidden.
    facing: Vec<f64>,
}

impl Sight {
    fn of(scene: &Scene, camera: Camera, targets: &[(Point3, Point3)]) -> Self {
        let view = Projection::new(&camera, &scene.tiles);
        let skin = view.see_all(&scene.tiles, Light::Even);
        let facing = |&(at, normal): &(Point3, Point3)| match view.facing(normal) {
            facing if facing > READABLE && view.unobstructed(at, &skin) => facing,
            _ => -1.0,
        };
        Sight { camera, facing: targets.iter().map(facing).collect() }
    }
}

/// The smallest cosine over all targets, each for its best camera.
fn worst(sights: &[&Sight], targets: usize) -> f64 {
    let best = |target: usize| sights.iter().map(|sight| sight.facing[target]).fold(-1.0, f64::max);
    (0..targets).map(best).fold(1.0, f64::min)
}

/// Cameras chosen greedily, each for most of the targets that are not yet visible; at least two.
fn one_by_one(all: &[Sight], targets: usize) -> Vec<Camera> {
    let mut seen = vec![false; targets];
    let mut chosen: Vec<Camera> = Vec::new();
    while chosen.len() < MAX_VIEWS {
        let gain = |sight: &Sight| {
            sight.facing.iter().zip(&seen).filter(|(facing, seen)| **facing > READABLE && !**seen).count()
        };
        let Some(best) = all.iter().rev().max_by_key(|sight| gain(sight)).filter(|sight| gain(sight) > 0) else {
            break;
        };
        best.facing.iter().zip(&mut seen).for_each(|(&facing, seen)| *seen |= facing > READABLE);
        chosen.push(best.camera);
    }
    match chosen.is_empty() {
        true => vec![Camera::degrees(0.0, ELEVATION_DEGREES), Camera::degrees(180.0, ELEVATION_DEGREES)],
        false => chosen,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::geom::vector::distance;

    #[test]
    fn the_camera_sees_a_right_handed_world() {
        let [right, up, towards] = Camera { azimuth_rad: 0.7, elevation_rad: 0.4 }.axes();
        let off = distance(cross(right, up), towards);
        assert!(off < 1e-12, "{off}");
        assert!(up[2] > 0.0);
    }
}
