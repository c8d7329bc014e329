//! Conversion of device time to host time.

use dermis::pipeline::Timestamp;
use std::time::Duration;

/// Converts the times of a device to the host clock.
///
/// A message arrives with a delay after the event that it reports. The smallest delay is taken as zero (Cristian 1989,
/// DOI 10.1007/BF01784024, in one direction). The two clocks may drift apart by 1e-4. When all messages have been late
/// by more than one second for longer than one second, one of the clocks was set. (A connection that merely stalled
/// delivers its delayed messages together.) When that happens again soon, the device's clock is too slow. Device time that does not increase from message to message, or that runs far
/// ahead of the host's, is that of a faulty clock. The time of arrival replaces it, and that of a slow clock.
#[derive(Debug, Clone, Default)]
pub(crate) struct DeviceClock {
    /// Only the first message is set to the host's clock: the device may be slower than real time.
    pub is_free: bool,
    /// Host time minus device time at the smallest delay, ns, and the device time of that message, us.
    least: Option<(i128, u64)>,
    /// Time since which messages are late by more than one second.
    late_since: Option<Timestamp>,
    /// When messages had been late for so long that a clock must have been set.
    set_at: Option<Timestamp>,
    /// While its seconds are longer than those of the host: its time, us, and that of the host when they were compared last.
    slow_since: Option<(u64, Timestamp)>,
    /// The last returned time; later times are never earlier.
    last: Timestamp,
    /// Device time, us, and time of arrival of the last message.
    before: Option<(u64, Timestamp)>,
    /// Messages with a faulty time.
    faults: u64,
}

/// Device time that runs ahead of the host's by more than this between two messages jumps, s.
const AHEAD_S: f64 = 1.0;
/// Rate at which the smallest delay expires: 100 ppm, the difference between cheap oscillators.
const DRIFT: f64 = 1e-4;
/// A message later than this is late, ns.
const LATE_NS: i128 = 1_000_000_000;
/// After messages have been late for this long, a clock must have been set, s.
const SET_S: f64 = 1.0;
/// A clock that must have been set twice in this time is slow, s, ...
const SET_AGAIN_S: f64 = 100.0;
/// ... and stays so while its seconds are longer by this part of one: it is late by `LATE_NS` again in this time.
const SLOW: f64 = 0.01;

impl DeviceClock {
    /// The host time of an event that the device reports at `time_us` and that was received at `received_at`; never
    /// earlier than the last returned time.
    pub(super) fn moment(&mut self, time_us: u64, received_at: Timestamp) -> Timestamp {
        if self.jumps(time_us, received_at) || self.is_slow(time_us, received_at) && !self.is_free {
            self.faults += 1;
            self.least = None;
            self.late_since = None;
        }
        self.before = Some((time_us, received_at));
        let device_ns = i128::from(time_us) * 1000;
        let offset_ns = i128::from(received_at.unix_ns) - device_ns;
        let offset_ns = match self.least {
            Some((first_ns, _)) if self.is_free => first_ns,
            _ => self.least_offset_ns(offset_ns, time_us, received_at),
        };
        let moment = Timestamp { unix_ns: u64::try_from(device_ns + offset_ns).unwrap_or(0) };
        self.last = self.last.max(moment);
        self.last
    }

    /// The offset of the smallest delay, after a message with the offset `offset_ns`.
    fn least_offset_ns(&mut self, offset_ns: i128, time_us: u64, received_at: Timestamp) -> i128 {
        let allowed_ns = self.least.map(|(least_ns, at_us)| {
            let since_s = Duration::from_micros(time_us.saturating_sub(at_us)).as_secs_f64();
            least_ns + (since_s * DRIFT * 1e9) as i128
        });
        let allowed_ns = allowed_ns.filter(|allowed_ns| !self.was_set(offset_ns - allowed_ns, time_us, received_at));
        match allowed_ns {
            Some(allowed_ns) if allowed_ns < offset_ns => allowed_ns,
            _ => {
                self.least = Some((offset_ns, time_us));
                offset_ns
            }
        }
    }

    /// Whether the device time of a message cannot follow that of the message before.
    fn jumps(&self, time_us: u64, received_at: Timestamp) -> bool {
        self.before.is_some_and(|(before_us, before_at)| {
            let step_s = (i128::from(time_us) - i128::from(before_us)) as f64 * 1e-6;
            step_s <= 0.0 || step_s > received_at.seconds_since(before_at).max(0.0) + AHEAD_S
        })
    }

    /// Whether the device's seconds are still longer than those of the host.
    fn is_slow(&mut self, time_us: u64, received_at: Timestamp) -> bool {
        let Some((since_us, since)) = self.slow_since else { return false };
        let host_s = received_at.seconds_since(since);
        if host_s < SET_AGAIN_S {
            return true;
        }
        let device_s = time_us.saturating_sub(since_us) as f64 * 1e-6;
        self.slow_since = (device_s < (1.0 - SLOW) * host_s).then_some((time_us, received_at));
        if self.slow_since.is_none() {
            self.set_at = None;
        }
        self.slow_since.is_some()
    }

    /// Messages with a faulty time.
    pub(super) fn faults(&self) -> u64 {
        self.faults
    }

    /// Whether messages have been late for so long, this one by `late_ns`, that a clock must have been set.
    fn was_set(&mut self, late_ns: i128, time_us: u64, received_at: Timestamp) -> bool {
        if late_ns < LATE_NS {
            self.late_since = None;
            return false;
        }
        let since = *self.late_since.get_or_insert(received_at);
        let was_set = received_at.seconds_since(since) > SET_S;
        if was_set {
            self.late_since = None;
            let before = self.set_at.replace(received_at);
            if before.is_some_and(|before| received_at.seconds_since(before) < SET_AGAIN_S) {
                self.slow_since = Some((time_us, received_at));
            }
        }
        was_set
    }

    /// Resets the relation between the clocks, after the device was restarted or disconnected.
    pub(super) fn restart(&mut self) {
        *self = DeviceClock { last: self.last, faults: self.faults, is_free: self.is_free, ..Self::default() };
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
            // Every seventh message is delayed by up to 30 ms.
            let delay_ns = if frame % 7 == 3 { (1 + frame % 31) * 1_000_000 } else { 200_000 };
            let received_at = Timestamp { unix_ns: start_ns + device_us * 1000 + delay_ns };
            let time = clock.moment(device_us, received_at);
            let true_ns = start_ns + device_us * 1000 + 200_000;
            assert!(time.unix_ns.abs_diff(true_ns) < 10_000, "frame {frame}");
        }
    }
    /// The delay of the converted times in each of ten seconds, for frames of 1/100 s that arrive at the times of
    /// `arrives_s`.
    fn late_s(arrives_s: impl Fn(f64) -> f64) -> Vec<f64> {
        let (mut clock, mut last) = (DeviceClock::default(), Timestamp::default());
        let frames = (0..1000).map(|frame| {
            let device_s = f64::from(frame) * 0.01;
            let received_at = Timestamp { unix_ns: ((1e6 + arrives_s(device_s)) * 1e9) as u64 };
            let time = clock.moment((device_s * 1e6) as u64, received_at);
            assert!(time >= last, "time runs back at frame {frame}");
            last = time;
            received_at.seconds_since(time)
        });
        frames.collect()
    }

    #[test]
    fn a_clock_that_was_set_is_followed_and_a_line_that_stood_still_is_not_one() {
        let set_forward = late_s(|device_s| device_s + if device_s < 5.0 { 0.0 } else { 13.0 });
        assert!(set_forward[700..].iter().all(|late_s| *late_s < 1e-3), "{}", set_forward[999]);
        let set_back = late_s(|device_s| device_s - if device_s < 5.0 { 0.0 } else { 13.0 });
        assert!(set_back[499] < 1e-3);
        // Nothing arrives for three seconds, then all delayed frames together.
        let stood_still =
            late_s(|device_s| if (4.0..7.0).contains(&device_s) { 7.0 + 1e-4 * device_s } else { device_s });
        assert!((stood_still[400] - 3.0).abs() < 0.01 && (stood_still[600] - 1.0).abs() < 0.01);
        assert!(stood_still[701].abs() < 1e-3);
    }

    #[test]
    fn a_slow_clock_is_replaced_by_the_time_of_arrival() {
        for slower in [1.25, 2.0, 1000.0] {
            let late_s = late_s(|device_s| slower * device_s);
            let from = late_s.iter().rposition(|late_s| *late_s > 1e-3).unwrap() + 1;
            // A fifth of a second is lost in each, and after another second it is set, twice; that takes four frames at least.
            assert!(
                from <= 4 || from as f64 * 0.01 * slower < 12.1,
                "{slower}: late until {} s",
                from as f64 * 0.01 * slower
            );
            assert!(late_s.iter().all(|late_s| *late_s < 2.1 + 0.01 * slower));
        }
        // A good clock whose host was set twice is used again.
        let (mut clock, mut last_late_s) = (DeviceClock::default(), 0.0);
        for frame in 0..30_000u64 {
            let device_s = frame as f64 * 0.01;
            let set_s = if device_s < 20.0 {
                0.0
            } else if device_s < 40.0 {
                5.0
            } else {
                10.0
            };
            // Every third message is delayed.
            let received_at = 1e6 + device_s + set_s + if frame % 3 == 0 { 0.02 } else { 0.0 };
            let received_at = Timestamp { unix_ns: (received_at * 1e9) as u64 };
            last_late_s = received_at.seconds_since(clock.moment((device_s * 1e6) as u64, received_at));
            if frame == 29_997 {
                assert!((last_late_s - 0.02).abs() < 1e-3, "{last_late_s}");
            }
        }
        assert!(last_late_s < 1e-3, "{last_late_s}");
        // Oscillators differ by less.
        assert!(late_s(|device_s| 1.001 * device_s).iter().all(|late_s| *late_s < 0.02));
    }

    #[test]
    fn a_free_clock_keeps_its_rate_whatever_the_host_shows() {
        let mut clock = DeviceClock { is_free: true, ..DeviceClock::default() };
        let start = Timestamp { unix_ns: 1_800_000_000_000_000_000 };
        // The device takes three seconds of the host for one of its own.
        for frame in 0..1000u64 {
            let device = Duration::from_micros(frame * 8333);
            let time = clock.moment(frame * 8333, start.after(3 * device));
            assert_eq!(time, start.after(device), "frame {frame}");
        }
        assert_eq!(clock.faults(), 0);
    }

    #[test]
    fn a_clock_that_stands_still_or_is_set_is_replaced_by_the_time_of_arrival() {
        let at = |frame: u64| Timestamp { unix_ns: 1_800_000_000_000_000_000 + frame * 8_333_333 };
        let device_us = |frame: u64| match frame {
            0..200 => 1_000_000 + frame * 8333,
            200..400 => 2_000_000,
            400..600 => 90_000_000 + frame * 8333,
            _ => frame * 8333,
        };
        let mut clock = DeviceClock::default();
        for frame in 0..800 {
            let late_s = at(frame).seconds_since(clock.moment(device_us(frame), at(frame)));
            assert!(late_s.abs() < 1e-3, "frame {frame}: {late_s} s");
        }
        // 200 frames without progress, a step forward, a step back.
        assert_eq!(clock.faults(), 202);
    }

    #[test]
    fn times_after_a_restart_are_never_earlier() {
        let mut clock = DeviceClock::default();
        let at = |ms: u64| Timestamp { unix_ns: 1_800_000_000_000_000_000 + ms * 1_000_000 };
        assert_eq!(clock.moment(0, at(0)), at(0));
        clock.restart();
        assert_eq!(clock.moment(20_000, at(33_000)), at(33_000), "its time stood still meanwhile");
        clock.restart();
        assert_eq!(clock.moment(0, at(32_999)), at(33_000));
    }
}
