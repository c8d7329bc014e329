//! Faults of an emulated device, on demand.

use crate::LiveError;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// A fault and its time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimedFault {
    /// Time, s from the start of the device.
    pub at_s: f64,
    /// The fault.
    pub fault: Fault,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// Additional noise on every reading, for some time.
    Noise {
        /// Its standard deviation, counts.
        counts: f64,
        /// Duration, s.
        for_s: f64,
    },
    /// Damage to packets with some probability: a byte changed, lost or doubled, or noise before the packet; for some
    /// time.
    Bytes {
        /// Probability for each packet.
        share: f64,
        /// Duration, s.
        for_s: f64,
    },
    /// A loose electrode: from then on, a resistance in series with it. 0 repairs it.
    Loose {
        /// The electrode.
        electrode: usize,
        /// Resistance, ohm.
        ohm: f64,
    },
    /// The device is unplugged, and plugged in again after some time.
    Unplug {
        /// Duration, s.
        for_s: f64,
    },
}

/// Default resistance of a loose contact, ohm.
const LOOSE_OHM: f64 = 1000.0;

/// The largest number of a fault, in its unit.
const MOST: f64 = 1e9;

impl FromStr for TimedFault {
    type Err = LiveError;

    /// Parses `noise:COUNTS@SECONDS+FOR`, `bytes:SHARE@SECONDS+FOR`, `loose:ELECTRODE[:OHM]@SECONDS`,
    /// `mend:ELECTRODE@SECONDS`, `unplug@SECONDS+FOR`.
    fn from_str(text: &str) -> Result<Self, LiveError> {
        parse(text).ok_or_else(|| {
            LiveError::Given(format!(
                "`{text}` is no fault: write noise:COUNTS@SECONDS+FOR, bytes:SHARE@SECONDS+FOR, loose:ELECTRODE[:OHM]@SECONDS, \
                 mend:ELECTRODE@SECONDS or unplug@SECONDS+FOR, as in loose:7@10, with numbers from 0 to 1e9"
            ))
        })
    }
}

fn parse(text: &str) -> Option<TimedFault> {
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| (0.0..=MOST).contains(value));
    let (what, when) = text.split_once('@')?;
    let (at_s, for_s) = match when.split_once('+') {
        Some((at_s, for_s)) => (number(at_s)?, Some(number(for_s)?)),
        None => (number(when)?, None),
    };
    let mut parts = what.split(':');
    let fault = match (parts.next()?, parts.next(), parts.next(), for_s) {
        ("noise", Some(counts), None, Some(for_s)) => Fault::Noise { counts: number(counts)?, for_s },
        ("bytes", Some(share), None, Some(for_s)) => {
            Fault::Bytes { share: number(share).filter(|share| *share <= 1.0)?, for_s }
        }
        ("loose", Some(electrode), ohm, None) => {
            Fault::Loose { electrode: electrode.parse().ok()?, ohm: ohm.map_or(Some(LOOSE_OHM), number)? }
        }
        ("mend", Some(electrode), None, None) => Fault::Loose { electrode: electrode.parse().ok()?, ohm: 0.0 },
        ("unplug", None, None, Some(for_s)) => Fault::Unplug { for_s },
        _ => return None,
    };
    parts.next().is_none().then_some(TimedFault { at_s, fault })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_are_written() {
        let read = |text: &str| text.parse::<TimedFault>().unwrap();
        assert_eq!(read("loose:7@10"), TimedFault { at_s: 10.0, fault: Fault::Loose { electrode: 7, ohm: 1000.0 } });
        assert_eq!(read("loose:7:50@1").fault, Fault::Loose { electrode: 7, ohm: 50.0 });
        assert_eq!(read("mend:7@1.5").fault, Fault::Loose { electrode: 7, ohm: 0.0 });
        assert_eq!(read("bytes:0.01@0+60").fault, Fault::Bytes { share: 0.01, for_s: 60.0 });
        assert_eq!(read("unplug@20+3").fault, Fault::Unplug { for_s: 3.0 });
        for wrong in [
            "",
            "loose@1",
            "bytes:2@0+1",
            "noise:1e300@0+1",
            "unplug@nan+1",
            "noise:5@1",
            "unplug@1",
            "loose:x@1",
            "loose:1:2:3@1",
            "fire@1",
        ] {
            assert!(wrong.parse::<TimedFault>().is_err(), "{wrong}");
        }
    }
}
