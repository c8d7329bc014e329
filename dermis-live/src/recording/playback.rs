//! The place of a player in its recording, which pages show, pause and move.

use dermis::pipeline::Timestamp;
use serde_json::{Value, json};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The place of a player in its recording.
#[derive(Debug, Default)]
pub(crate) struct Playback {
    place: Mutex<Place>,
}

#[derive(Debug, Default)]
struct Place {
    first: Option<Timestamp>,
    /// Time since the first frame, s.
    time_s: f64,
    /// The part of the file that is read.
    part: f64,
    paused: bool,
    wanted: Option<f64>,
}

impl Playback {
    /// Pauses or continues.
    pub(crate) fn pause(&self, on: bool) {
        self.lock().paused = on;
    }

    pub(crate) fn is_paused(&self) -> bool {
        self.lock().paused
    }

    /// Requests another place, as a part of the file.
    pub(crate) fn seek(&self, part: f64) {
        self.lock().wanted = Some(part);
    }

    /// The place that was requested since the last call.
    pub(super) fn take_wanted(&self) -> Option<f64> {
        self.lock().wanted.take()
    }

    /// Whether a pause or another place is requested.
    pub(super) fn is_asked(&self) -> bool {
        let place = self.lock();
        place.paused || place.wanted.is_some()
    }

    /// A frame is played.
    pub(super) fn at(&self, measured_at: Timestamp, part: f64) {
        let mut place = self.lock();
        let first = *place.first.get_or_insert(measured_at);
        (place.time_s, place.part) = (measured_at.seconds_since(first), part);
    }

    /// As pages receive it.
    pub(crate) fn status(&self) -> Value {
        let place = self.lock();
        json!({ "time_s": place.time_s, "part": place.part })
    }

    fn lock(&self) -> MutexGuard<'_, Place> {
        self.place.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
