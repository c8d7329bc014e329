//! Objects in a round tank, each at an electrode.

use dermis::detect::{DetectOptions, Detector};
use dermis::geom::Point3;
use dermis::geom::surface::angle_difference;
use dermis::image::Image;
use dermis::linalg::smallest_total;
use std::f64::consts::TAU;
use std::sync::Arc;

/// The material of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// Conducts better than the water: a maximum of the image.
    Metal,
    /// Does not conduct: a minimum of the image.
    Plastic,
}

/// An object at an electrode of a round tank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TankObject {
    /// The electrode, counted from 0.
    pub electrode: usize,
    /// Its material.
    pub material: Material,
}

/// The detected position of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundObject {
    /// The object, as named in the recording.
    pub object: TankObject,
    /// Its detected position, m; `None` if the image has fewer spots of its kind than objects.
    pub position_m: Option<Point3>,
    /// Its angle minus that of its electrode, in electrode spacings, from -L/2 to L/2; `NaN` if it was not found.
    pub off_spacings: f64,
}

impl FoundObject {
    /// Whether it was found within half of a spacing of its electrode.
    pub fn is_at_its_electrode(&self) -> bool {
        self.off_spacings.abs() <= 0.5
    }
}

/// Finds objects in the image of a round tank around the origin with equally spaced electrodes, electrode 0 on the
/// x-axis. The highest maxima, as many as there are metal objects, and the lowest minima, as many as there are plastic
/// ones, are assigned to the objects with the smallest total angle error.
pub fn find_objects(image: &Image, objects: &[TankObject], electrode_count: usize) -> Vec<FoundObject> {
    let detector = Detector::new(DetectOptions::default());
    let spacing = TAU / electrode_count as f64;
    let mut found: Vec<FoundObject> =
        objects.iter().map(|&object| FoundObject { object, position_m: None, off_spacings: f64::NAN }).collect();
    for (material, sign) in [(Material::Metal, 1.0), (Material::Plastic, -1.0)] {
        let named: Vec<usize> = (0..objects.len()).filter(|&index| objects[index].material == material).collect();
        let turned =
            Image { space: Arc::clone(&image.space), values: image.values.iter().map(|value| sign * value).collect() };
        let spots: Vec<Point3> =
            detector.detect(&turned).iter().take(named.len()).map(|contact| contact.position_m).collect();
        let off = |object: usize, spot: usize| {
            let [x, y, _] = spots[spot];
            angle_difference(y.atan2(x), spacing * objects[named[object]].electrode as f64) / spacing
        };
        for (object, spot) in smallest_total(named.len(), spots.len(), &|o, s| off(o, s).abs()) {
            let place = &mut found[named[object]];
            (place.position_m, place.off_spacings) = (Some(spots[spot]), off(object, spot));
        }
    }
    found
}
