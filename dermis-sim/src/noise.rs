//! White measurement noise of a frame.
//!
//! ```
//! use dermis::frame::Frame;
//! use dermis::protocol::Protocol;
//! use dermis_sim::noise::Noise;
//! use dermis_sim::random::sample_rng;
//!
//! let protocol = Protocol::adjacent(8)?;
//! let clean = Frame(vec![10.0; protocol.channel_count()]);
//! let noise = Noise::at_snr_db(40.0, &clean, &protocol, f64::INFINITY)?;
//! assert!((noise.sd_ohm - 0.1).abs() < 1e-12);
//! let (_, drive_of) = protocol.drives();
//! let noisy = noise.apply(&clean, &drive_of, &mut sample_rng(1, 0));
//! assert!(noisy != clean);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::elementary::powf;
use crate::random::standard_normal;
use crate::touch::TouchError;
use dermis::frame::Frame;
use dermis::protocol::Protocol;
use rand_chacha::ChaCha8Rng;

/// White noise of the readings of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of every reading, as an equivalent resistance at the drive current, ohm.
    pub sd_ohm: f64,
    /// The resistor in series with the drive, across which each drive's current is measured, ohm. The reading of the
    /// current has the same noise as any other: a frame's value is `(z + n) / (1 + n_ref / R_ref)`, with one `n_ref`
    /// per drive and frame. Infinite if the current is known exactly.
    pub reference_ohm: f64,
}

impl Noise {
    /// The noise of a signal-to-noise ratio in dB, `SNR = 20 log10(r / s)`: `s` is [`sd_ohm`](Self::sd_ohm), `r` the
    /// root mean square of the values of the untouched frame that share no electrode with their drive.
    ///
    /// # Errors
    /// A ratio that is not finite; a protocol without such a value.
    pub fn at_snr_db(
        snr_db: f64,
        untouched: &Frame,
        protocol: &Protocol,
        reference_ohm: f64,
    ) -> Result<Self, TouchError> {
        let signal_ohm = protocol.undriven_rms(untouched);
        if signal_ohm.is_nan() {
            return Err(TouchError::NoUndrivenValue);
        }
        if !snr_db.is_finite() {
            return Err(TouchError::NotPositive { what: "the signal-to-noise ratio in dB", value: snr_db });
        }
        let sd_ohm = signal_ohm / powf(10.0, snr_db / 20.0);
        Ok(Noise { sd_ohm, reference_ohm })
    }

    /// A frame with noise, from the frame without. `drive_of` contains the index of each value's drive, as returned by
    /// [`Protocol::drives`].
    ///
    /// # Panics
    /// If `drive_of` is shorter than the frame.
    pub fn apply(&self, clean: &Frame, drive_of: &[usize], rng: &mut ChaCha8Rng) -> Frame {
        let drive_count = drive_of.iter().max().map_or(0, |last| last + 1);
        let noise = self.readings(drive_count, clean.len(), rng);
        let noisy = |(index, value): (usize, &f64)| {
            (value + noise.values_ohm[index]) / (1.0 + noise.references_ohm[drive_of[index]] / self.reference_ohm)
        };
        Frame(clean.iter().enumerate().map(noisy).collect())
    }

    /// The noise of all readings of one frame.
    pub fn readings(&self, drive_count: usize, value_count: usize, rng: &mut ChaCha8Rng) -> NoisyReadings {
        let mut draw = |count: usize| (0..count).map(|_| self.sd_ohm * standard_normal(rng)).collect();
        NoisyReadings { references_ohm: draw(drive_count), values_ohm: draw(value_count) }
    }
}

/// The noise of each reading of a frame, as an equivalent resistance at the drive current, ohm.
#[derive(Debug, Clone, PartialEq)]
pub struct NoisyReadings {
    /// In the reading of each drive's current across the reference resistor.
    pub references_ohm: Vec<f64>,
    /// In the reading of each value.
    pub values_ohm: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::sample_rng;

    #[test]
    fn fifty_decibels_are_fifty_decibels_of_the_values_that_no_contact_impedance_touches() {
        let protocol = Protocol::adjacent(30).unwrap();
        // Driven values are made very large: they must have no effect.
        let clean = Frame(
            protocol
                .channels()
                .iter()
                .enumerate()
                .map(|(i, c)| if c.touches_driven() { 1e4 } else { 1.0 + (i % 3) as f64 })
                .collect(),
        );
        let noise = Noise::at_snr_db(50.0, &clean, &protocol, f64::INFINITY).unwrap();
        let (_, drive_of) = protocol.drives();
        let (mut sum, mut count) = (0.0, 0);
        for index in 0..400 {
            let noisy = noise.apply(&clean, &drive_of, &mut sample_rng(7, index));
            sum += (&noisy - &clean).iter().map(|n| n * n).sum::<f64>();
            count += clean.len();
        }
        let rms = protocol.undriven_rms(&clean);
        let measured_db = 20.0 * (rms / (sum / f64::from(count as u32)).sqrt()).log10();
        println!("noise asked for 50 dB, measured {measured_db:.3} dB over {count} readings");
        // The standard deviation of a standard deviation over 348,000 readings is 0.12 %, or 0.01 dB.
        assert!((measured_db - 50.0).abs() < 0.05);
    }

    #[test]
    fn a_noisy_reference_reading_scales_all_values_of_its_drive_together() {
        let protocol = Protocol::adjacent(16).unwrap();
        let (_, drive_of) = protocol.drives();
        let clean = Frame(vec![1e6; protocol.channel_count()]);
        let noise = Noise { sd_ohm: 1.0, reference_ohm: 1000.0 };
        let noisy = noise.apply(&clean, &drive_of, &mut sample_rng(1, 0));
        // Relative to 1e6 the reading's own noise is 1e-6, the reference's 1e-3: values of one drive agree to the
        // former.
        for drive in 0..16 {
            let values: Vec<f64> = noisy.iter().zip(&drive_of).filter(|(_, d)| **d == drive).map(|(v, _)| *v).collect();
            let spread = values.iter().map(|v| (v / values[0] - 1.0).abs()).fold(0.0, f64::max);
            assert!(spread < 1e-5, "{spread}");
        }
        let factors: Vec<f64> = (0..16).map(|drive| noisy[drive * 15] / 1e6 - 1.0).collect();
        let sd = (factors.iter().map(|f| f * f).sum::<f64>() / 16.0).sqrt();
        assert!(sd > 0.5e-3 && sd < 2e-3, "{sd}");
    }
}
