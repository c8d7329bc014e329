//! Notices of changes of state: of the validity of frames, of the method, of electrodes, drives and channels.

use crate::finding::Severity;
use crate::pipeline::electrodes::{Change, ElectrodeTopology};
use crate::pipeline::health::ElectrodeState;
use crate::pipeline::validity::{InvalidReason, Validity};
use crate::text::counted;

/// Channels that a notice names.
const MAX_NAMED: usize = 8;

/// A notice without its time.
pub(super) type Text = (Severity, String);

/// What was last reported; only changes are reported.
#[derive(Debug, Default)]
pub(super) struct Reports {
    /// Why frames are invalid.
    reason: Option<InvalidReason>,
    bad_drives: Vec<usize>,
    are_channels_bad: bool,
    /// The warning of the method.
    method: Option<String>,
}

impl Reports {
    /// Reports that frames become invalid, and that they are valid again.
    pub(super) fn validity(&mut self, validity: &Validity) -> Option<Text> {
        let reason = match validity {
            Validity::Invalid { reason: InvalidReason::OnTrial | InvalidReason::Tare } => return None,
            Validity::Invalid { reason } => Some(*reason),
            _ => None,
        };
        let before = std::mem::replace(&mut self.reason, reason);
        (before != reason).then(|| match reason {
            Some(reason) => (Severity::Error, format!("frames are invalid: {}", reason.text())),
            None => (Severity::Info, "frames are valid again".into()),
        })
    }

    /// Reports the warning of a method.
    pub(super) fn method(&mut self, warning: Option<&str>) -> Option<Text> {
        if self.method.as_deref() == warning {
            return None;
        }
        self.method = warning.map(String::from);
        Some((Severity::Warning, self.method.clone()?))
    }

    /// Reports drives that become bad or sound again.
    pub(super) fn drives(&mut self, topology: &ElectrodeTopology, bad: Vec<usize>) -> Vec<Text> {
        let bad_now = |&drive: &usize| {
            let [source, sink] = topology.ends_of(drive);
            let text = format!(
                "the current of drive {drive} (electrodes {source} and {sink}) is wrong and its channels are masked: check \
                 the source and the reference resistor"
            );
            (Severity::Warning, text)
        };
        let sound_now = |drive: &usize| (Severity::Info, format!("the current of drive {drive} is sound again"));
        let before = std::mem::replace(&mut self.bad_drives, bad);
        let mut texts: Vec<Text> =
            self.bad_drives.iter().filter(|drive| !before.contains(drive)).map(bad_now).collect();
        texts.extend(before.iter().filter(|drive| !self.bad_drives.contains(drive)).map(sound_now));
        texts
    }

    /// Reports that some channels are bad, and that none is any more.
    pub(super) fn channels(&mut self, bad: &[usize]) -> Option<Text> {
        let were_bad = std::mem::replace(&mut self.are_channels_bad, !bad.is_empty());
        match (were_bad, bad.is_empty()) {
            (false, false) => {
                let named: Vec<String> = bad.iter().take(MAX_NAMED).map(usize::to_string).collect();
                let others = if bad.len() > MAX_NAMED { ", ..." } else { "" };
                let text = format!(
                    "{} out of range, above the voltage of the drive or unlike the reciprocal one, and masked: {}{others}",
                    counted(bad.len(), "channel"),
                    named.join(", ")
                );
                Some((Severity::Warning, text))
            }
            (true, true) => Some((Severity::Info, "all channels are sound again".into())),
            _ => None,
        }
    }
}

/// The notice of an electrode that has changed.
pub(super) fn electrode(change: &Change) -> Text {
    let (level, what) = match change.state {
        ElectrodeState::Loose => (Severity::Warning, "is loose and its channels are masked: fix its contact"),
        ElectrodeState::Open => (Severity::Warning, "carries no current and its channels are masked: check its wire"),
        _ => (Severity::Info, "is sound again"),
    };
    (level, format!("electrode {} {what}", change.electrode))
}
