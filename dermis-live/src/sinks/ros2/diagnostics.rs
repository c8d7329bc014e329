//! The state of the skin and its instrument as ROS diagnostics.

use crate::LiveFrame;
use crate::sinks::ros2::{DiagnosticArray, DiagnosticStatus, KeyValue, Reference};
use dermis::pipeline::{ElectrodeHealth, ElectrodeState, Health, PipelineFrame, Validity};
use std::fmt::Display;

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// The rate may differ from the nominal one by this part, the default of `diagnostic_updater`.
const RATE_TOLERANCE: f64 = 0.1;

/// Three statuses: the instrument with its noise and losses, the electrodes with the state of each, and the rate.
pub fn diagnostics(reference: &Reference, live: &LiveFrame) -> DiagnosticArray {
    DiagnosticArray {
        header: reference.header(live.result.measured_at),
        status: vec![
            instrument(reference, &live.result),
            electrodes(reference, &live.result.health),
            frequency(reference, &live.result),
        ],
    }
}

fn instrument(reference: &Reference, result: &PipelineFrame) -> DiagnosticStatus {
    let PipelineFrame { health, validity, .. } = result;
    let counts = &health.counts;
    let saturated = health.saturated_channels;
    let (level, message) = match validity {
        Validity::Stale { .. } => (STALE, validity.to_string()),
        Validity::Invalid { .. } => (ERROR, validity.to_string()),
        Validity::Degraded(_) => (WARN, validity.to_string()),
        Validity::Ok if saturated > 0 => (WARN, format!("readings out of the converter's range: {saturated}")),
        Validity::Ok => (OK, format!("{:.1} frames a second", health.rate_hz)),
    };
    let values = vec![
        value("validity", validity.name()),
        value("serial number", health.device_serial.map_or_else(|| "none".into(), |serial| serial.to_string())),
        value("noise (times that at the tare)", known(health.noise)),
        value("reciprocity (times what noise explains)", known(health.reciprocity)),
        value("saturated channels", saturated),
        value("masked channels", health.masked_channels),
        value("frames", counts.frames),
        value("lost", counts.lost),
        value("repeated", counts.repeated),
        value("reordered", counts.reordered),
        value("damaged", counts.damaged),
        value("reconnected", counts.reconnected),
    ];
    status(reference, "instrument", level, message, values)
}

/// The rate of frames, with the keys of the `FrequencyStatus` of `diagnostic_updater`.
fn frequency(reference: &Reference, result: &PipelineFrame) -> DiagnosticStatus {
    let Health { rate_hz, nominal_rate_hz, counts, .. } = &*result.health;
    let limits = nominal_rate_hz.map(|rate_hz| [1.0 - RATE_TOLERANCE, 1.0 + RATE_TOLERANCE].map(|part| part * rate_hz));
    let (level, message) = match (&result.validity, limits) {
        (Validity::Stale { .. }, _) => (STALE, "no frames"),
        (_, Some([lowest, _])) if *rate_hz < lowest => (WARN, "below the nominal rate"),
        (_, Some([_, highest])) if *rate_hz > highest => (WARN, "above the nominal rate"),
        (_, Some(_)) => (OK, "at the nominal rate"),
        (_, None) => (OK, "the instrument states no rate"),
    };
    let mut values = vec![value("Events since startup", counts.frames), value("Actual frequency (Hz)", rate_hz)];
    if let (Some(nominal_hz), Some([lowest, highest])) = (nominal_rate_hz, limits) {
        values.push(value("Target frequency (Hz)", nominal_hz));
        values.push(value("Minimum acceptable frequency (Hz)", lowest));
        values.push(value("Maximum acceptable frequency (Hz)", highest));
    }
    status(reference, "frequency", level, message.into(), values)
}

fn electrodes(reference: &Reference, health: &Health) -> DiagnosticStatus {
    let level = health.electrodes.iter().map(|electrode| level(electrode.state)).max().unwrap_or(OK);
    let ill: Vec<String> = health.electrodes.iter().enumerate().filter_map(named).collect();
    let message = if ill.is_empty() { "all sound".to_owned() } else { ill.join(", ") };
    let about = |(index, electrode): (usize, &ElectrodeHealth)| {
        let contact = electrode.contact_ohm.map(|ohm| format!(", {ohm:.0} ohm")).unwrap_or_default();
        value(&format!("electrode {index}"), format!("{}{contact}", word(electrode.state)))
    };
    let values = health.electrodes.iter().enumerate().map(about).collect();
    status(reference, "electrodes", level, message, values)
}

fn named((index, electrode): (usize, &ElectrodeHealth)) -> Option<String> {
    (electrode.state != ElectrodeState::Sound).then(|| format!("electrode {index} is {}", word(electrode.state)))
}

fn level(state: ElectrodeState) -> u8 {
    match state {
        ElectrodeState::Sound => OK,
        ElectrodeState::Doubtful | ElectrodeState::Suspect | ElectrodeState::OnTrial => WARN,
        ElectrodeState::Loose | ElectrodeState::Open => ERROR,
    }
}

fn word(state: ElectrodeState) -> &'static str {
    match state {
        ElectrodeState::Sound => "sound",
        ElectrodeState::Doubtful => "doubtful",
        ElectrodeState::Loose => "loose",
        ElectrodeState::Open => "open",
        ElectrodeState::Suspect => "suspect",
        ElectrodeState::OnTrial => "on trial",
    }
}

fn status(reference: &Reference, part: &str, level: u8, message: String, values: Vec<KeyValue>) -> DiagnosticStatus {
    let hardware_id = reference.frame_id.clone();
    DiagnosticStatus { level, name: format!("{}: {part}", reference.name), message, hardware_id, values }
}

fn value(key: &str, value: impl Display) -> KeyValue {
    KeyValue { key: key.into(), value: value.to_string() }
}

fn known(number: Option<f64>) -> String {
    number.map_or_else(|| "unknown".to_owned(), |number| format!("{number:.3}"))
}
