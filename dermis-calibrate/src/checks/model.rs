//! What the model of the skin says of the channels: values of the untouched skin, and changes under single touches.

use crate::checks::correlation::{correlations, standardised};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis::stats::upper_median;
use faer::Mat;

/// Standard deviation of the simulated touches, as a part of the square root of the skin's area: 4 mm on a disk of 80
/// mm.
const WIDTH: f64 = 0.056;
/// Touches that are simulated, at most.
const MAX_TOUCHES: usize = 1200;

/// The channels of a model.
#[derive(Clone)]
pub(crate) struct ModelChannels {
    /// Values of the untouched skin, ohm; amplitudes where the protocol says so.
    pub untouched: Vec<f64>,
    /// Changes of the channels by a touch at each of many places, touches x channels, ohm per relative change of the
    /// conductance.
    pub touches: Mat<f64>,
    /// Where they are, m.
    pub places_m: Vec<Point3>,
    /// Signs that [`untouched`](Self::untouched) has lost: 1 or -1.
    signs: Vec<f64>,
    /// Correlation of the channels over the touches.
    pub correlation: Mat<f64>,
}

impl ModelChannels {
    /// Simulates touches of one width at all pixels, in the linear model.
    pub(crate) fn new(skin: &Skin) -> dermis::Result<Self> {
        let linearised = skin.linearised()?;
        let (channels, pixels) = (linearised.channel_count(), linearised.pixel_count());
        let area_m2: f64 = skin.pixels().areas.iter().sum();
        let width_m = WIDTH * area_m2.sqrt();
        let centres = &skin.pixels().centres_m;
        let step = pixels.div_ceil(MAX_TOUCHES);
        let places: Vec<usize> = (0..pixels).step_by(step).collect();
        let weight = |i: usize, pixel: usize| {
            let apart = distance(centres[places[i]], centres[pixel]) / width_m;
            (-0.5 * apart * apart).exp()
        };
        let weights = Mat::from_fn(places.len(), pixels, weight);
        let sign = skin.design().sheet.touch.sign();
        let jacobian = Mat::from_fn(pixels, channels, |pixel, channel| sign * linearised.jacobian.at(channel, pixel));
        let touches = weights * jacobian;
        let correlation = correlations(&standardised(&compressed(&touches)));
        // The linear model of an instrument of amplitudes has no signs; the forward model has.
        let signed = skin.untouched()?;
        let signs = signed.iter().zip(&linearised.rest_frame).map(|(a, b)| if a * b < 0.0 { -1.0 } else { 1.0 });
        Ok(ModelChannels {
            untouched: linearised.rest_frame.clone(),
            signs: signs.collect(),
            touches,
            places_m: places.iter().map(|&pixel| centres[pixel]).collect(),
            correlation,
        })
    }

    /// The untouched frame with its signs, where the protocol has amplitudes.
    pub(crate) fn signed_untouched(&self) -> Vec<f64> {
        self.untouched.iter().zip(&self.signs).map(|(value, sign)| value * sign).collect()
    }

    /// The model of an instrument that reports amplitudes: `d|V| = sign(V) dV`.
    pub(crate) fn drop_signs(&mut self) {
        let signs: Vec<f64> = self.untouched.iter().map(|value| if *value < 0.0 { -1.0 } else { 1.0 }).collect();
        for j in 0..signs.len() {
            self.untouched[j] *= signs[j];
            self.signs[j] *= signs[j];
            self.touches.col_mut(j).iter_mut().for_each(|value| *value *= signs[j]);
            for i in 0..signs.len() {
                self.correlation[(i, j)] *= signs[i] * signs[j];
            }
        }
    }

    /// Number of channels.
    pub(crate) fn channel_count(&self) -> usize {
        self.untouched.len()
    }
}

/// Values in units of the median absolute value of their column, with large ones compressed by asinh, as
/// `ChannelUnits` does; not centred.
pub(crate) fn compressed(values: &Mat<f64>) -> Mat<f64> {
    let scale = |column: usize| {
        let sizes: Vec<f64> = values.col(column).iter().map(|value| value.abs()).collect();
        upper_median(&sizes).unwrap_or(0.0)
    };
    let scales: Vec<f64> = (0..values.ncols()).map(scale).collect();
    let unit = |i: usize, j: usize| if scales[j] > 0.0 { (values[(i, j)] / scales[j]).asinh() } else { 0.0 };
    Mat::from_fn(values.nrows(), values.ncols(), unit)
}
