//! Colours and colour maps. Both maps are readable with any kind of colour vision.

use dermis::stats::sorted;

/// An opaque colour: red, green, blue.
pub type Colour = [u8; 3];

/// Black.
pub(crate) const BLACK: Colour = [0, 0, 0];
/// White.
pub(crate) const WHITE: Colour = [255, 255, 255];
/// Text and axes.
pub(crate) const INK: Colour = [40, 44, 52];
/// Lines in the background of the data.
pub(crate) const FAINT: Colour = [150, 156, 166];
/// Electrodes, as in the paper's Fig. 7.
pub(crate) const ELECTRODE: Colour = [255, 213, 45];
/// Estimates, as in the paper's Fig. 7.
pub(crate) const ESTIMATE: Colour = [214, 40, 40];
/// False positives.
pub(crate) const FALSE_POSITIVE: Colour = [126, 47, 142];
/// Bare skin.
pub(crate) const SKIN: Colour = [206, 216, 228];

/// Viridis (van der Walt and Smith 2015, CC0), sampled at 17 uniform positions.
const VIRIDIS: [Colour; 17] = [
    [68, 1, 84],
    [72, 24, 106],
    [71, 45, 123],
    [66, 64, 134],
    [59, 82, 139],
    [51, 99, 141],
    [44, 114, 142],
    [38, 130, 142],
    [33, 145, 140],
    [31, 159, 136],
    [39, 173, 129],
    [61, 188, 116],
    [92, 200, 99],
    [129, 211, 77],
    [170, 220, 50],
    [213, 226, 26],
    [253, 231, 37],
];

/// Blue over white to red (ColorBrewer's RdBu reversed, Brewer and Harrower, Apache 2.0), at 11 uniform positions.
const BLUE_RED: [Colour; 11] = [
    [5, 48, 97],
    [34, 103, 172],
    [67, 147, 195],
    [147, 198, 222],
    [209, 229, 240],
    [247, 246, 246],
    [253, 219, 199],
    [243, 164, 129],
    [214, 96, 77],
    [177, 24, 43],
    [103, 0, 31],
];

/// A colour map with its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Number at the first colour.
    pub low: f64,
    /// Number at the last colour.
    pub high: f64,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Sequential,
    Diverging,
}

impl Scale {
    /// From the minimum to the maximum of some numbers; numbers that are not finite are ignored.
    pub fn sequential(values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = finite_range(values);
        // A constant image still needs a scale with an extent.
        let high = if high > low { high } else { low + low.abs().max(1.0) };
        Scale { low, high, kind: Kind::Sequential }
    }

    /// Between two quantiles of some numbers, given as fractions; numbers beyond have the colours of the ends.
    pub fn between_quantiles(values: impl IntoIterator<Item = f64>, parts: [f64; 2]) -> Self {
        let sorted = sorted(values.into_iter().filter(|value| value.is_finite()));
        let last = sorted.len().saturating_sub(1) as f64;
        Self::sequential(parts.iter().filter_map(|part| sorted.get((part * last).round() as usize)).copied())
    }

    /// White at zero, with symmetric limits.
    pub fn diverging(values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = finite_range(values);
        let extent = low.abs().max(high.abs());
        let extent = if extent > 0.0 { extent } else { 1.0 };
        Scale { low: -extent, high: extent, kind: Kind::Diverging }
    }

    /// The colour of a number; numbers that are not finite are grey.
    pub(crate) fn colour(&self, value: f64) -> Colour {
        if !value.is_finite() {
            return [220, 220, 220];
        }
        let place = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        match self.kind {
            Kind::Sequential => interpolate(&VIRIDIS, place),
            Kind::Diverging => interpolate(&BLUE_RED, place),
        }
    }
}

/// A mixture of two colours; `share` is the fraction of the second.
pub(crate) fn mix(a: Colour, b: Colour, share: f64) -> Colour {
    let channel = |i: usize| (f64::from(a[i]) * (1.0 - share) + f64::from(b[i]) * share).round() as u8;
    [channel(0), channel(1), channel(2)]
}

fn interpolate(map: &[Colour], place: f64) -> Colour {
    let position = place * (map.len() - 1) as f64;
    let index = (position as usize).min(map.len() - 2);
    mix(map[index], map[index + 1], position - index as f64)
}

fn finite_range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { (low, high) } else { (0.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diverging_scale_is_white_at_zero_and_even_to_both_sides() {
        let scale = Scale::diverging([-0.2, 0.5, f64::NAN]);
        assert_eq!((scale.low, scale.high), (-0.5, 0.5));
        assert_eq!(scale.colour(0.0), [247, 246, 246]);
        assert_eq!(scale.colour(9.0), [103, 0, 31]);
    }

    #[test]
    fn a_sequential_map_only_ever_grows_brighter() {
        let scale = Scale::sequential([0.0, 1.0]);
        let luminance = |[r, g, b]: Colour| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
        let mut last = -1.0;
        for step in 0..=100 {
            let now = luminance(scale.colour(f64::from(step) / 100.0));
            assert!(now > last, "step {step}");
            last = now;
        }
    }

    #[test]
    fn outliers_do_not_stretch_a_scale_between_quantiles() {
        let values = (0..=100).map(f64::from).chain([1e6, f64::NAN]);
        let scale = Scale::between_quantiles(values, [0.02, 0.98]);
        assert_eq!((scale.low, scale.high), (2.0, 99.0));
        assert_eq!(scale.colour(1e6), scale.colour(99.0));
    }

    #[test]
    fn even_and_empty_pictures_have_a_scale() {
        assert!(Scale::sequential([3.0, 3.0]).high > 3.0);
        assert!(Scale::sequential([]).high > 0.0);
        assert!(Scale::diverging([0.0]).high > 0.0);
    }
}
