//! How long a reader waits until the lines of each slot have settled.

use super::{Connection, Electronics, ElectronicsOptions, Switching};
use dermis::forward::ElectrodeNetwork;
use dermis::protocol::Protocol;

/// The waiting time of each slot of a skin's [scan](Protocol::scan).
#[derive(Debug, Clone)]
pub struct SettlingPlan {
    /// The electronics, with switches of the greatest resistance.
    pub electronics: Electronics,
    /// The wait in each slot, s.
    pub waits_s: Vec<f64>,
    /// A wait that is enough for any slot, whatever its electrodes, s.
    pub otherwise_s: f64,
}

impl SettlingPlan {
    /// Waits are the settling times of the design times this: coats and contacts of a built skin differ from it.
    const MARGIN: f64 = 1.25;

    /// The plan of a skin: each slot settles to half a step of the converter from any voltage within the supply, with all
    /// switches of the greatest resistance that three standard deviations allow.
    ///
    /// # Errors
    /// Options out of their ranges.
    pub fn new(
        options: &ElectronicsOptions,
        protocol: &Protocol,
        network: &ElectrodeNetwork,
        switching: Switching,
    ) -> crate::Result<Self> {
        let slowest = ElectronicsOptions {
            on_resistance_ohm: options.on_resistance_ohm + 3.0 * options.on_resistance_spread_ohm,
            on_resistance_spread_ohm: 0.0,
            snr_db: None,
            ..options.clone()
        };
        let electronics = Electronics::new(&slowest, protocol, network, 0)?;
        let wait_s = |connection: Connection| {
            let half_step_v = electronics.half_step_v(connection).unwrap_or(f64::INFINITY);
            Self::MARGIN * electronics.settling_s(network, connection, switching, half_step_v)
        };
        let scan = protocol.scan();
        Ok(SettlingPlan {
            waits_s: scan.iter().map(|slot| wait_s((slot.drive, slot.measure.map(|(pair, _)| pair)))).collect(),
            otherwise_s: Self::MARGIN * electronics.longest_settling_s(network, switching),
            electronics,
        })
    }
}
