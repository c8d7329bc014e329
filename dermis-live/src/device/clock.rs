//! A device's time on the host's clock.

use crate::moment::Moment;
use std::time::Duration;

/// Brings the times of a device onto the host's clock.
///
/// A message arrives some time after what it tells of, never before: the least delay of late is taken as none (Cristian 1989,
/// DOI 10.1007/BF01784024, in one direction). The two clocks may drift apart by a ten-thousandth.
#[derive(Debug, Clone, Default)]
pub struct DeviceClock {
    /// The host's time less the device's at the least delay, ns; and the device's time then, us.
    least: Option<(i128, u64)>,
}

/// How fast the least delay is forgotten: 100 parts in a million, what cheap oscillators differ by.
const DRIFT: f64 = 1e-4;

impl DeviceClock {
    /// When something happened on the host's clock that the device says was at `time_us` and that came at `received_at`.
    pub fn moment(&mut self, time_us: u64, received_at: Moment) -> Moment {
        let device_ns = i128::from(time_us) * 1000;
        let offset_ns = i128::from(received_at.unix_ns) - device_ns;
        let allowed_ns = self.least.map(|(least_ns, at_us)| {
            let since_s = Duration::from_micros(time_us.saturating_sub(at_us)).as_secs_f64();
            least_ns + (since_s * DRIFT * 1e9) as i128
        });
        let offset_ns = match allowed_ns {
            Some(allowed_ns) if allowed_ns < offset_ns => allowed_ns,
            _ => {
                self.least = Some((offset_ns, time_us));
                offset_ns
            }
        };
        Moment { unix_ns: u64::try_from(device_ns + offset_ns).unwrap_or(0) }
    }

    /// Forgets the device, which was powered up again.
    pub fn restart(&mut self) {
        self.least = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_do_not_move_the_time_of_measurement() {
        let mut clock = DeviceClock::default();
        let start_ns = 1_800_000_000_000_000_000u64;
        for frame in 0..1000u64 {
            let device_us = frame * 8333;
            // Every seventh message is late by up to 30 ms.
            let delay_ns = if frame % 7 == 3 { (1 + frame % 31) * 1_000_000 } else { 200_000 };
            let received_at = Moment { unix_ns: start_ns + device_us * 1000 + delay_ns };
            let told = clock.moment(device_us, received_at);
            let true_ns = start_ns + device_us * 1000 + 200_000;
            assert!(told.unix_ns.abs_diff(true_ns) < 10_000, "frame {frame}");
        }
    }
}
