//! One digital twin: a skin drawn from a seed, its presses and its frames.

use super::electronics::{Electronics, ElectronicsReport, Readings, SlotReader, Switching, not_negative};
use super::imperfections::Drift;
use super::sheet::TouchedSheet;
use super::{ContactHistory, PatchedSkin, Press, TouchOptions, TwinError, TwinOptions};
use crate::noise::Noise;
use dermis::design::SkinDesign;
use dermis::forward::{ElectrodeNetwork, ForwardModel, rest_conductivity};
use dermis::frame::Frame;
use dermis::mesh::Mesh;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// A manufactured skin and its instrument, drawn from a seed; it does not change afterwards.
///
/// Frames may be taken from several threads at once.
#[derive(Debug)]
pub struct Twin {
    options: TwinOptions,
    seed: u64,
    design: SkinDesign,
    skin: Skin,
    /// Additional series resistance of each electrode, ohm; empty if there is none.
    series_ohm: Vec<f64>,
    drift: Drift,
    untouched: ElectrodeNetwork,
    electronics: Electronics,
}

/// A coating on its mesh, and the effect of a press on it.
#[derive(Debug)]
struct Skin {
    forward: ForwardModel,
    touch: Touch,
    /// The last solution: a touch that is held is solved only once.
    last: Mutex<Option<Solution>>,
}

/// The network of some presses, with the history of the contacts before them.
#[derive(Debug)]
struct Solution {
    presses: Vec<Press>,
    before: ContactHistory,
    after: ContactHistory,
    network: ElectrodeNetwork,
}

#[derive(Debug)]
enum Touch {
    Sheet(TouchedSheet),
    Patches(Box<PatchedSkin>),
}

impl Twin {
    /// Draws a twin of a design: its electrode positions, its mesh, its coating, its contacts and its instrument.
    ///
    /// Fabric patches and a piezoresistive layer need a body with a chart, and they raise the conductance of the
    /// coating. On any other body, and on a skin whose conductance falls when touched (a stretched membrane), a press is
    /// a Gaussian change of 8 mm instead: a rise of 0.5 per newton as in `ideal`, or a fall of 0.1 per newton, so that
    /// half of the conductance remains at 5 N. The name of the twin in its [options](Self::options) then ends in
    /// `without patches` or `without a layer`.
    ///
    /// # Errors
    /// Invalid options, or options that do not fit the design: missing electrodes, patches larger than its body. If the
    /// options were read from a file, the error contains the line. A design without a solution.
    pub fn new(design: &SkinDesign, options: &TwinOptions, seed: u64) -> crate::Result<Self> {
        Self::draw(design, options, seed).map_err(|error| match error {
            crate::Error::Twin(error) => options.locate(error),
            error => error,
        })
    }

    fn draw(design: &SkinDesign, options: &TwinOptions, seed: u64) -> crate::Result<Self> {
        options.check()?;
        let options = &options.clone().made_of(design);
        options.electronics.check(&design.protocol)?;
        options.faults.check(design)?;
        let mut drawn = options.electrodes.draw(design, seed)?;
        drawn.mesh = drawn.mesh.scaled(options.mesh_scale);
        let mesh = Mesh::generate(&drawn)?;
        let surface = drawn.body.surface();
        let mut coat = rest_conductivity(&drawn, &mesh);
        let unevenness = options.coat.draw(surface, &mesh, seed)?;
        coat.iter_mut().zip(unevenness).for_each(|(value, factor)| *value *= factor);

        // The noise is defined on the skin without faults; only the frames are those of the skin with faults.
        let sound = Skin::new(&drawn, &mesh, &coat, options)?;
        let sound_network = sound.network(&[], &mut ContactHistory::default())?;
        let electronics = Electronics::new(&options.electronics, &drawn.protocol, &sound_network, seed)?;
        let contacts_ohm: Vec<f64> =
            (0..drawn.electrodes.len()).map(|electrode| sound.forward.contact_resistance_ohm(electrode)).collect();
        let drift = Drift::draw(options.drift, options.temperature, &contacts_ohm, seed);
        let mut twin = Twin {
            options: options.clone(),
            seed,
            series_ohm: Vec::new(),
            drift,
            untouched: sound_network,
            electronics,
            skin: sound,
            design: drawn,
        };
        if !options.faults.none() {
            twin.break_down(&mesh, coat)?;
        }
        Ok(twin)
    }

    /// Adds the faults.
    fn break_down(&mut self, mesh: &Mesh, mut coat: Vec<f64>) -> crate::Result<()> {
        let faults = &self.options.faults;
        faults.cut(self.design.body.surface(), mesh, &mut coat);
        for (index, electrode) in self.design.electrodes.iter_mut().enumerate() {
            electrode.contact_impedance *= faults.contact_factor(index);
        }
        if !faults.torn_wires.is_empty() {
            self.series_ohm = (0..self.design.electrodes.len()).map(|index| faults.series_ohm(index)).collect();
        }
        self.electronics.replace_references(|drive| faults.reference_factor(drive));
        self.skin = Skin::new(&self.design, mesh, &coat, &self.options)?;
        self.untouched = self.network(&[])?;
        Ok(())
    }

    /// Its options, as they hold for its design.
    pub fn options(&self) -> &TwinOptions {
        &self.options
    }

    /// Its seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// The design as manufactured: displaced electrodes, their contact impedances, and the mesh options of the twin.
    pub fn design(&self) -> &SkinDesign {
        &self.design
    }

    /// The mesh on which its frames are solved.
    pub fn mesh(&self) -> &Mesh {
        self.skin.forward.mesh()
    }

    /// Conductance of the untouched coating, a value per cell of its mesh.
    pub fn coat(&self) -> &[f64] {
        self.skin.forward.rest_conductivity()
    }

    /// The instrument.
    pub fn electronics(&self) -> &Electronics {
        &self.electronics
    }

    /// The white noise of the instrument, if it has any.
    pub fn noise(&self) -> Option<Noise> {
        self.electronics.noise()
    }

    /// The network between the electrodes of the untouched skin, before any drift.
    pub fn untouched(&self) -> &ElectrodeNetwork {
        &self.untouched
    }

    /// The network during some presses that start on the untouched skin, before any drift.
    ///
    /// # Errors
    /// Presses that the twin cannot simulate: off the skin, without a force, too strong for a touch that lowers the
    /// conductance.
    pub fn network(&self, presses: &[Press]) -> crate::Result<ElectrodeNetwork> {
        self.network_after(presses, &mut ContactHistory::default())
    }

    /// The network during some presses that follow others, before any drift: contacts with hysteresis
    /// ([`ContactLaw::hysteresis`](crate::twin::ContactLaw::hysteresis)) depend on the highest pressure since they
    /// closed. `history` contains it, and is updated.
    fn network_after(&self, presses: &[Press], history: &mut ContactHistory) -> crate::Result<ElectrodeNetwork> {
        let network = self.skin.network(presses, history)?;
        let network = if self.series_ohm.is_empty() { network } else { network.with_series(&self.series_ohm)? };
        Ok(self.options.faults.wired(network))
    }

    /// The frame of an instrument without errors, before any drift; ohm.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn clean(&self, presses: &[Press]) -> crate::Result<Frame> {
        let mut frame = self.network_or_untouched(presses)?.frame(&self.design.protocol);
        self.design.protocol.drop_signs(&mut frame);
        Ok(frame)
    }

    /// Frame `index` as delivered by the instrument, at the time `index / frame_rate`, of presses that start on the
    /// untouched skin; ohm. Its noise depends only on the seed and the index.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn frame(&self, presses: &[Press], index: u64) -> crate::Result<Frame> {
        let mut frame = self.electronics.values(&self.readings(presses, index)?);
        self.design.protocol.drop_signs(&mut frame);
        Ok(frame)
    }

    /// [`readings_after`](Self::readings_after) of presses that start on the untouched skin.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn readings(&self, presses: &[Press], index: u64) -> crate::Result<Readings> {
        self.readings_after(presses, &mut ContactHistory::default(), index)
    }

    /// The readings of frame `index`, before conversion to ohm, of presses that follow those of earlier frames:
    /// `history` is the history of contacts with hysteresis, and is updated.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn readings_after(
        &self,
        presses: &[Press],
        history: &mut ContactHistory,
        index: u64,
    ) -> crate::Result<Readings> {
        Ok(self.electronics.readings(&self.network_of_frame(presses, history, index)?, index))
    }

    /// Frame `index` for firmware that reads slot by slot at its own times, of presses that follow those of earlier
    /// frames as in [`readings_after`](Self::readings_after).
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn slot_reader_after(
        &self,
        presses: &[Press],
        history: &mut ContactHistory,
        index: u64,
        switching: Switching,
    ) -> crate::Result<SlotReader<'_>> {
        Ok(self.electronics.slot_reader(self.network_of_frame(presses, history, index)?, index, switching))
    }

    /// The network of frame `index`, with its drift.
    fn network_of_frame(
        &self,
        presses: &[Press],
        history: &mut ContactHistory,
        index: u64,
    ) -> crate::Result<ElectrodeNetwork> {
        let network = match presses {
            [] => {
                *history = ContactHistory::default();
                self.untouched.clone()
            }
            _ => self.network_after(presses, history)?,
        };
        Ok(self.drift.at(network, self.electronics.time_s(index))?)
    }

    /// Sets a resistance in series with an electrode from now on, ohm: a contact that becomes loose during a recording,
    /// or a broken wire. 0 repairs it.
    ///
    /// # Errors
    /// An electrode that does not exist, a resistance that is negative or infinite.
    pub fn loosen(&mut self, electrode: usize, series_ohm: f64) -> crate::Result<()> {
        let electrode_count = self.design.electrodes.len();
        if electrode >= electrode_count {
            return Err(TwinError::NoSuchElectrode { field: "electrode", electrode, electrode_count }.into());
        }
        not_negative("series_ohm", series_ohm)?;
        self.series_ohm.resize(electrode_count, 0.0);
        self.series_ohm[electrode] = series_ohm + self.options.faults.series_ohm(electrode);
        self.untouched = self.network(&[])?;
        Ok(())
    }

    /// Limits the memory of the Green's functions of its patches, which otherwise grows with every place that is pressed
    /// for the first time. The frames are the same.
    pub fn limit_table(&mut self, most_bytes: usize) {
        if let Touch::Patches(patched) = &mut self.skin.touch {
            patched.limit_table(most_bytes);
        }
    }

    /// Memory of these Green's functions, bytes.
    pub fn table_bytes(&self) -> usize {
        match &self.skin.touch {
            Touch::Patches(patched) => patched.conductors().table_bytes()[0],
            Touch::Sheet(_) => 0,
        }
    }

    /// The true strength of some presses together: the relative change of conductance integrated over the surface, m2.
    /// For patches see [`PatchedSkin::strength_m2`].
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn strength_m2(&self, presses: &[Press]) -> crate::Result<f64> {
        match &self.skin.touch {
            Touch::Patches(patched) => Ok(patched.strength_m2(presses)?),
            Touch::Sheet(sheet) => sheet.strength_m2(&self.skin.forward, presses),
        }
    }

    fn network_or_untouched(&self, presses: &[Press]) -> crate::Result<ElectrodeNetwork> {
        if presses.is_empty() { Ok(self.untouched.clone()) } else { self.network(presses) }
    }

    /// The contribution of each part of the instrument to frames of the untouched skin.
    ///
    /// # Errors
    /// A drift that makes the network invalid.
    ///
    /// # Panics
    /// If there are no frames.
    pub fn report(&self, indices: Range<u64>) -> crate::Result<ElectronicsReport> {
        let network = self.drift.at(self.untouched.clone(), self.electronics.time_s(indices.start))?;
        Ok(self.electronics.report(&network, indices))
    }
}

impl Skin {
    fn new(design: &SkinDesign, mesh: &Mesh, coat: &[f64], options: &TwinOptions) -> crate::Result<Self> {
        let forward = ForwardModel::with_coat(design, mesh, coat)?;
        let touch = match &options.touch {
            TouchOptions::Gaussian(gaussian) => {
                Touch::Sheet(TouchedSheet::gaussian(*gaussian, &design.body, design.sheet.touch))
            }
            TouchOptions::Layer(layer) => Touch::Sheet(TouchedSheet::layer(*layer, &design.body)),
            TouchOptions::Patches(patches) => {
                Touch::Patches(Box::new(PatchedSkin::new(patches, &design.body, &forward, coat)?))
            }
        };
        Ok(Skin { forward, touch, last: Mutex::new(None) })
    }

    fn network(&self, presses: &[Press], history: &mut ContactHistory) -> crate::Result<ElectrodeNetwork> {
        // After a panic in another thread the stored solution is still consistent.
        let last = || self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = last().as_ref().filter(|known| known.presses == presses && known.before == *history) {
            *history = known.after.clone();
            return Ok(known.network.clone());
        }
        let before = history.clone();
        let network = self.solve(presses, history)?;
        let (presses, after) = (presses.to_vec(), history.clone());
        *last() = Some(Solution { presses, before, after, network: network.clone() });
        Ok(network)
    }

    fn solve(&self, presses: &[Press], history: &mut ContactHistory) -> crate::Result<ElectrodeNetwork> {
        match &self.touch {
            Touch::Patches(patched) => patched.network_after(presses, history),
            Touch::Sheet(sheet) => sheet.network(&self.forward, presses),
        }
    }
}
