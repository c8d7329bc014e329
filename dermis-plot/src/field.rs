//! Fields on the skin as colours: images and the sensitivity.

use crate::colour::Scale;
use crate::drawing::Drawing;
use crate::scene::{Key, Scene};
use dermis::design::TouchEffect;
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::Quantity;

/// Fractions of the area with the lowest and with the highest sensitivity that are clipped to the ends of the scale.
/// Under an electrode the sensitivity falls by 100 dB; without clipping, the rest would have a single colour.
const SENSITIVITY_ENDS: [f64; 2] = [0.05, 0.005];

impl Drawing<'_> {
    /// An image as colours: white where there is no change.
    pub fn image(&self, image: &Image, quantity: Quantity) -> Scene {
        let label = match (quantity, self.design.sheet.touch) {
            (Quantity::Touch, _) => "touch strength (units of the training)",
            (Quantity::Density, _) => "density of the position, relative to its largest value",
            (Quantity::Change, TouchEffect::ConductanceRises) => "relative rise of conductance",
            (Quantity::Change, TouchEffect::ConductanceFalls) => "relative fall of conductance",
        };
        let scale = Scale::diverging(image.values.iter().copied());
        self.field(&image.space, &image.values, Key { scale, label: label.into() })
    }

    /// The sensitivity in dB relative to its area-weighted median, because it spans decades.
    pub fn sensitivity(&self, space: &PixelSpace, sensitivity: &[f64]) -> Scene {
        let mut order: Vec<usize> = (0..sensitivity.len()).collect();
        order.sort_by(|&a, &b| sensitivity[a].total_cmp(&sensitivity[b]));
        let total: f64 = space.areas.iter().sum();
        let quantile = |part: f64| {
            let mut below = 0.0;
            let reaches = |&&pixel: &&usize| {
                below += space.areas[pixel];
                below >= part * total
            };
            order.iter().find(reaches).or(order.last()).map_or(1.0, |&pixel| sensitivity[pixel])
        };
        let median = quantile(0.5);
        let decibels = |value: f64| 20.0 * (value / median).log10();
        let values: Vec<f64> = sensitivity.iter().map(|&value| decibels(value)).collect();
        let [low, high] = [quantile(SENSITIVITY_ENDS[0]), quantile(1.0 - SENSITIVITY_ENDS[1])].map(decibels);
        let key =
            Key { scale: Scale::sequential([low, high]), label: "sensitivity above its median, limited (dB)".into() };
        let subtitle = "change of a frame by a small touch".to_string();
        Scene { subtitle, ..self.field(space, &values, key) }
    }
}
