//! The data that a recording contains before its first frame.

use crate::recording::walk::Item;
use mcap::records::Metadata;
use serde_json::Value;
use std::collections::BTreeMap;

/// The inputs of a recording at its start; together with the frames and events, all data that a replay needs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Session {
    /// Version of Dermis that made the recording; a [`Recorder`](crate::recording::Recorder) writes its own version.
    pub version: String,
    /// The design file.
    pub design_toml: String,
    /// The twin file of an emulated device.
    pub twin_toml: Option<String>,
    /// The card of the network that computed the images, if any.
    pub model_card_json: Option<String>,
    /// The device's hello.
    pub hello: Vec<u8>,
    /// The options of the pipeline.
    pub options: Value,
    /// The state of the pipeline at the start: baseline, noise, thresholds.
    pub state: Value,
}

const NAME: &str = "dermis";
const DESIGN: &str = "design.toml";
const TWIN: &str = "twin.toml";
const CARD: &str = "model-card.json";

impl Session {
    pub(super) fn metadata(&self) -> Metadata {
        let entries = [
            ("version", self.version.clone()),
            ("options", self.options.to_string()),
            ("state", self.state.to_string()),
            ("hello", dermis::text::hexadecimal(&self.hello)),
        ];
        let metadata: BTreeMap<String, String> = entries.map(|(key, value)| (key.to_owned(), value)).into();
        Metadata { name: NAME.into(), metadata }
    }

    /// Name, media type and text of each attachment.
    pub(super) fn attachments(&self) -> impl Iterator<Item = (&'static str, &'static str, &str)> {
        let all = [
            (DESIGN, "application/toml", Some(self.design_toml.as_str())),
            (TWIN, "application/toml", self.twin_toml.as_deref()),
            (CARD, "application/json", self.model_card_json.as_deref()),
        ];
        all.into_iter().filter_map(|(name, kind, text)| Some((name, kind, text?)))
    }

    /// Adds an item of a recording. Returns whether it was the last one of a session.
    pub(super) fn take(&mut self, item: &Item) -> bool {
        match item {
            Item::Metadata(Metadata { name, metadata }) if name == NAME => {
                let text = |key: &str| metadata.get(key).map_or("", String::as_str);
                self.version = text("version").to_owned();
                self.options = serde_json::from_str(text("options")).unwrap_or_default();
                self.state = serde_json::from_str(text("state")).unwrap_or_default();
                self.hello = crate::recording::event::from_hex(text("hello")).unwrap_or_default();
                return true;
            }
            Item::Attachment { header, data } => {
                let text = || String::from_utf8_lossy(data).into_owned();
                match header.name.as_str() {
                    DESIGN => self.design_toml = text(),
                    TWIN => self.twin_toml = Some(text()),
                    CARD => self.model_card_json = Some(text()),
                    _ => {}
                }
            }
            _ => {}
        }
        false
    }
}
