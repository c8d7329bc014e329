//! Presses on the twins of one skin.

use dermis::contact::Contact;
use dermis::frame::Frame;
use dermis::skin::Skin;
use dermis_learn::Model;
use dermis_sim::experiment::{Presses, Recording, record, truth};
use dermis_sim::twin::{Press, Twin, TwinOptions};
use dermis_study::Result;
use dermis_study::comparison::Named;
use dermis_study::{Progress, Task};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// A nominal skin and its twins.
pub(crate) struct Bench<'a> {
    /// The nominal skin; methods have no other information on the twins.
    pub skin: Skin,
    /// The distribution of the twins.
    pub twin: &'a TwinOptions,
    /// Receives the progress of long computations.
    pub progress: &'a dyn Progress,
}

/// Results of pressing one twin.
pub(crate) struct Pressed {
    /// The frames of its instrument.
    pub recording: Recording,
    /// True positions of the touches in each frame.
    pub truth: Vec<Vec<Contact>>,
    /// Differences of further untouched frames from the baseline.
    pub untouched: Vec<Frame>,
    /// Number of nodes of its mesh.
    pub nodes: usize,
    /// Readings out of the range of the converter in the untouched frames of the baseline.
    pub saturated_readings: usize,
}

impl Bench<'_> {
    /// Loads the network in a folder for this skin.
    pub(crate) fn network(&self, folder: &Path) -> Result<Named> {
        Ok(Named::network(Model::load(folder, self.skin.forward(), Arc::clone(self.skin.pixels()))?))
    }

    /// The positions and forces of the presses with this seed.
    pub(crate) fn presses(&self, seed: u64) -> Presses<'_> {
        Presses::new(self.skin.design(), self.skin.mesh(), self.skin.pixels(), self.twin.press, seed)
    }

    /// Draws a twin, presses it, and reads some untouched frames at the end.
    pub(crate) fn press(&self, seed: u64, presses: &[Vec<Press>], untouched: u64, task: &dyn Task) -> Result<Pressed> {
        let twin = Twin::new(self.skin.design(), self.twin, seed)?;
        let recording = record(&twin, presses, 0, || task.advance(1))?;
        let frame = |index: u64| Ok(&twin.frame(&[], recording.next_index + index)? - &recording.baseline);
        let untouched = (0..untouched).into_par_iter().map(frame).collect::<dermis_sim::Result<Vec<Frame>>>()?;
        let surface = self.skin.design().body.surface();
        Ok(Pressed {
            truth: presses.iter().map(|frame| truth(&surface, frame)).collect(),
            saturated_readings: twin.report(0..dermis_sim::experiment::UNTOUCHED_FRAMES)?.saturated_readings,
            nodes: twin.mesh().node_count(),
            untouched,
            recording,
        })
    }
}
