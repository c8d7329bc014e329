//! What masked channels cost.

use crate::forward::Matrix;
use crate::image::PixelSpace;
use crate::skin::Skin;
use crate::stats::upper_median;
use crate::text::counted;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Masked channels, and what they cost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Degradation {
    /// The masked channels, ascending.
    pub channels: Vec<usize>,
    /// What they cost; `null` until the method is prepared without them.
    pub cost: Option<Cost>,
}

/// Bounds of what is lost with masked channels, as factors on those of all channels: 1 is no loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Factor on the smallest standard deviation of the position that any method can reach.
    pub position_sd: Loss,
    /// Factor on the smallest force that can be detected.
    pub smallest_force: Loss,
}

/// A loss over the skin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Loss {
    /// At the median pixel.
    pub median: f64,
    /// At the worst pixel; `null` if nothing is left there.
    pub worst: Option<f64>,
}

impl Cost {
    /// Of masked channels, by the Cramer-Rao bound of a small touch at each pixel (Kay 1993, ISBN 0133457117, section
    /// 3.9, for noise that is independent between channels): its change is a column `j` of the Jacobian `J`, in units of
    /// the noise. The smallest force is as `1 / |j|`, the deviation of the position as `1 / |grad j|`, with differences
    /// between neighbouring pixels as gradient.
    ///
    /// # Errors
    /// A forward problem that cannot be solved.
    pub(super) fn of(skin: &Skin, noise_ohm: &[f64], masked: &[usize]) -> crate::Result<Self> {
        let jacobian = &skin.linearised()?.jacobian;
        let pixels = skin.pixels();
        let mut is_masked = vec![false; jacobian.rows];
        masked.iter().for_each(|&channel| is_masked[channel] = true);
        let [mut force, mut position] = [(); 2].map(|()| Information::new(pixels.len()));
        let neighbours = neighbours(pixels);
        for channel in 0..jacobian.rows {
            let row = whitened(jacobian, channel, noise_ohm[channel]);
            row.iter().enumerate().for_each(|(pixel, value)| force.add(pixel, value * value, is_masked[channel]));
            for &(ends, apart_m) in &neighbours {
                let square = ((row[ends[0]] - row[ends[1]]) / apart_m).powi(2);
                ends.into_iter().for_each(|end| position.add(end, square, is_masked[channel]));
            }
        }
        Ok(Cost { position_sd: position.loss(), smallest_force: force.loss() })
    }
}

/// The pairs of neighbouring pixels, and their distances, m.
fn neighbours(pixels: &PixelSpace) -> Vec<([usize; 2], f64)> {
    let distance_m = |[a, b]: [usize; 2]| pixels.surface.distance_m(pixels.centres_m[a], pixels.centres_m[b]);
    let pairs_of = |pixel: usize| {
        let others = pixels.neighbours[pixel].iter().filter(move |&&other| other < pixel);
        others.map(move |&other| [pixel, other])
    };
    (0..pixels.len()).flat_map(pairs_of).map(|pair| (pair, distance_m(pair))).collect()
}

/// The row of a channel in units of its noise.
fn whitened(jacobian: &Matrix, channel: usize, noise_ohm: f64) -> Vec<f64> {
    jacobian.row(channel).iter().map(|value| value / noise_ohm).collect()
}

/// Information of each pixel, of all channels and of those in use.
struct Information {
    all: Vec<f64>,
    used: Vec<f64>,
}

impl Information {
    fn new(count: usize) -> Self {
        Information { all: vec![0.0; count], used: vec![0.0; count] }
    }

    fn add(&mut self, pixel: usize, value: f64, is_masked: bool) {
        self.all[pixel] += value;
        if !is_masked {
            self.used[pixel] += value;
        }
    }

    fn loss(&self) -> Loss {
        // Where no channel is sensitive, nothing is lost.
        let factor = |(all, used): (&f64, &f64)| if *all > 0.0 { (all / used).sqrt() } else { 1.0 };
        let factors: Vec<f64> = self.all.iter().zip(&self.used).map(factor).collect();
        let worst = factors.iter().copied().fold(1.0, f64::max);
        Loss { median: upper_median(&factors).unwrap_or(1.0), worst: Some(worst).filter(|worst| worst.is_finite()) }
    }
}

impl fmt::Display for Degradation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} masked", counted(self.channels.len(), "channel"))?;
        let Some(Cost { position_sd, smallest_force }) = &self.cost else { return Ok(()) };
        let worst =
            |loss: &Loss| loss.worst.map_or("no contacts in places".into(), |worst| format!("up to {worst:.1}"));
        write!(
            f,
            "; deviation of positions {:.1} times ({}), smallest force {:.1} times ({})",
            position_sd.median,
            worst(position_sd),
            smallest_force.median,
            worst(smallest_force)
        )
    }
}
