//! A skin under its patches: from presses to the network between the electrodes.

use super::contact_law::ContactLaw;
use super::coverage::{Cover, cover};
use super::load::Load;
use super::patches::{PatchGrid, PatchOptions};
use super::press::{Footprint, Press};
use super::strength;
use super::{Foam, TwinError};
use dermis::design::Body;
use dermis::forward::{ConductorContact, ElectrodeNetwork, FloatingConductors, ForwardModel, Matrix, OnceMemory};
use dermis::frame::Frame;
use dermis::geom::Point2;
use std::collections::HashMap;
use std::sync::Arc;

/// Degree of the polynomials for the potential under a patch. With the patches of `lab` on `cylinder30`, degree 3 (10
/// moments per patch) has an error of 1.5 % of a press's change of the frame, degree 2 of 1.6 % but 11 % at worst.
/// (Sites of constant potential converge only with second order.)
pub const MOMENT_DEGREE: usize = 3;

/// Contacts below this fraction of the sheet's conductance are ignored: their effect is below rounding.
const MIN_SHARE: f64 = 1e-12;

/// A skin under a grid of patches and a layer of foam.
///
/// Each patch is a floating equipotential; a press connects it to the coating with a conductance per area that follows
/// from the pressure ([`ContactLaw`]), integrated over the patch with the moments of the potential below it. Everything
/// that does not depend on the presses is computed once.
#[derive(Debug)]
pub struct PatchedSkin {
    grid: PatchGrid,
    foam: Foam,
    contact: ContactLaw,
    conductors: FloatingConductors,
    covers: Vec<Option<Cover>>,
    at_rest: Vec<ConductorContact>,
    /// Mean conductance of the coating, S.
    coat_s: f64,
    least_s: f64,
}

/// The history of contacts with [hysteresis](ContactLaw::hysteresis): the highest pressure at each point since the
/// contact closed there. The default is the untouched skin. It stays empty without hysteresis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ContactHistory {
    /// By patch and point of the patch, Pa.
    highest_pa: HashMap<(usize, usize), f64>,
}

impl PatchedSkin {
    /// The skin of a forward model on a body, with the coating's conductance per cell, S.
    ///
    /// # Errors
    /// Patches that do not fit the body; a body or mesh without a chart; an invalid conductance of the coating.
    pub fn new(options: &PatchOptions, body: &Body, model: &ForwardModel, conductivity: &[f64]) -> crate::Result<Self> {
        Self::with_degree(options, body, model, conductivity, MOMENT_DEGREE)
    }

    /// The same with polynomials up to another degree; their integrals are exact up to degree 4.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_degree(
        options: &PatchOptions,
        body: &Body,
        model: &ForwardModel,
        conductivity: &[f64],
        degree: usize,
    ) -> crate::Result<Self> {
        let grid = options.on_body(body)?;
        Self::of_patches(options, grid, model, conductivity, degree, None)
    }

    /// The skin with only those patches that some presses reach, for the case of many skins with few presses each: for
    /// these presses [`network_once`](Self::network_once) gives the same result as on the whole skin.
    ///
    /// # Errors
    /// As [`new`](Self::new) and [`network`](Self::network).
    pub fn for_presses(
        options: &PatchOptions,
        body: &Body,
        model: &ForwardModel,
        conductivity: &[f64],
        presses: &[Press],
    ) -> crate::Result<Self> {
        let grid = options.on_body(body)?;
        // With a preload all patches are in contact.
        let wanted = match options.contact.preload_pa > 0.0 {
            true => None,
            false => {
                let reach = |press: &Press| {
                    Ok((grid.chart.unroll(press.centre_m), Footprint::reach_of(press, &options.foam, &grid.body)?))
                };
                let reaches = presses.iter().map(reach).collect::<Result<Vec<(Point2, f64)>, TwinError>>()?;
                let mut wanted = vec![false; grid.patch_count()];
                patches_near(&grid, reaches.into_iter()).into_iter().for_each(|patch| wanted[patch] = true);
                Some(wanted)
            }
        };
        Self::of_patches(options, grid, model, conductivity, MOMENT_DEGREE, wanted.as_deref())
    }

    fn of_patches(
        options: &PatchOptions,
        grid: PatchGrid,
        model: &ForwardModel,
        conductivity: &[f64],
        degree: usize,
        wanted: Option<&[bool]>,
    ) -> crate::Result<Self> {
        let (moments, covers) = cover(&grid, model.mesh(), degree, wanted)?;
        let rest = options.contact.conductance_s_per_m2(options.contact.preload_pa);
        let at_rest = (covers.iter().enumerate())
            .filter(|_| rest > 0.0)
            .filter_map(|(conductor, cover)| Some((conductor, cover.as_ref()?.conductance(|_, _| rest))))
            .map(|(conductor, conductance)| ConductorContact { conductor, conductance })
            .collect::<Vec<ConductorContact>>();
        let conductors = FloatingConductors::new(model, conductivity, Arc::new(moments), &at_rest)?;
        let mean = conductivity.iter().sum::<f64>() / conductivity.len() as f64;
        Ok(PatchedSkin {
            grid,
            foam: options.foam,
            contact: options.contact,
            conductors,
            covers,
            at_rest,
            coat_s: mean,
            least_s: MIN_SHARE * mean,
        })
    }

    /// The sheet under them.
    pub fn conductors(&self) -> &FloatingConductors {
        &self.conductors
    }

    /// Limits the memory of its Green's functions: [`FloatingConductors::limit_table`].
    pub fn limit_table(&mut self, most_bytes: usize) {
        self.conductors.limit_table(most_bytes);
    }

    /// The contacts due to the preload; none if patches are loose.
    pub fn contacts_at_rest(&self) -> &[ConductorContact] {
        &self.at_rest
    }

    /// The network between the electrodes during some presses; the presses' pressures add up.
    ///
    /// The Green's functions of a patch are computed when it is first touched; [`prepare`](FloatingConductors::prepare)
    /// computes all of them.
    ///
    /// # Errors
    /// A force or radius that is not positive, a centre off the skin, a tip whose indentation exceeds the foam
    /// thickness.
    pub fn network(&self, presses: &[Press]) -> crate::Result<ElectrodeNetwork> {
        Ok(self.conductors.network(&self.contacts(presses)?)?)
    }

    /// [`network`](Self::network) without a table of Green's functions, for a skin that is touched only a few times.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn network_once(&self, presses: &[Press]) -> crate::Result<ElectrodeNetwork> {
        Ok(self.conductors.network_once(&self.contacts(presses)?)?)
    }

    /// The frames of [`network_once`](Self::network_once) under the footprints of some presses together, for several
    /// such lists; contacts without hysteresis.
    pub(crate) fn frames_under(&self, lists: &[Vec<Footprint>], memory: &mut OnceMemory) -> crate::Result<Vec<Frame>> {
        let contacts = lists.iter().map(|footprints| self.contacts_without_history(footprints)).collect::<Vec<_>>();
        Ok(self.conductors.frames_once(&contacts, memory)?)
    }

    fn footprints(&self, presses: &[Press]) -> Result<Vec<Footprint>, TwinError> {
        Footprint::of_all(presses, &self.foam, &self.grid.body)
    }

    /// The network between the electrodes during some presses that follow others, for contacts with hysteresis, which
    /// depend on the highest pressure. `history` is updated.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn network_after(&self, presses: &[Press], history: &mut ContactHistory) -> crate::Result<ElectrodeNetwork> {
        Ok(self.conductors.network(&self.contacts_after(presses, history)?)?)
    }

    /// The patches that presses bring into contact, with their conductances.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn contacts(&self, presses: &[Press]) -> Result<Vec<ConductorContact>, TwinError> {
        self.contacts_after(presses, &mut ContactHistory::default())
    }

    fn contacts_after(
        &self,
        presses: &[Press],
        history: &mut ContactHistory,
    ) -> Result<Vec<ConductorContact>, TwinError> {
        let footprints = self.footprints(presses)?;
        if self.contact.hysteresis == 0.0 {
            return Ok(self.contacts_under(&footprints, |_, pressure| self.contact.conductance_s_per_m2(pressure)));
        }
        let mut highest_pa = HashMap::new();
        let contacts = self.contacts_under(&footprints, |point, pressure| {
            let before = history.highest_pa.get(&point).copied().unwrap_or(0.0);
            let highest = self.contact.highest_pa(pressure, before);
            if pressure > self.contact.preload_pa {
                highest_pa.insert(point, highest);
            }
            self.contact.conductance_after_s_per_m2(pressure, highest)
        });
        history.highest_pa = highest_pa;
        Ok(contacts)
    }

    /// The true strength of some presses together: the relative rise of the coating's conductance, integrated over the
    /// surface, that would change the field around it as the contacts do, m2. The contribution of each patch depends on
    /// the conductance and the extent of its contact (see the theory, "Presses on patches"); interaction of patches is
    /// neglected, and the coating is assumed uniform.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub fn strength_m2(&self, presses: &[Press]) -> Result<f64, TwinError> {
        let preload_pa = self.contact.preload_pa;
        let footprints = self.footprints(presses)?;
        let load = Load::new(&footprints, self.grid.chart, preload_pa);
        let of_patch = |cover: &Cover, pressure_pa: &dyn Fn(Point2) -> f64| {
            let conductance_s = |&(point, area_m2): &(Point2, f64)| {
                (point, area_m2 * self.contact.conductance_s_per_m2(pressure_pa(point)))
            };
            let (whole_s, moment_s_m2) = moments(cover.points.iter().map(conductance_s));
            strength::of_contact(whole_s, moment_s_m2, self.coat_s)
        };
        let covers =
            patches_near(&self.grid, load.reaches_m()).into_iter().filter_map(|patch| self.covers[patch].as_ref());
        let rise = |cover: &Cover| of_patch(cover, &|point| load.pressure_pa(point)) - of_patch(cover, &|_| preload_pa);
        Ok(covers.map(rise).sum())
    }

    /// The contacts of [`contacts_under`](Self::contacts_under) without hysteresis, up to rounding, in less time.
    fn contacts_without_history(&self, footprints: &[Footprint]) -> Vec<ConductorContact> {
        self.contacts_of(footprints, |_, cover, load| {
            let mut values = load.pressures_pa(cover.points.iter().map(|(point, _)| *point));
            self.contact.replace_by_conductances(&mut values);
            cover.conductance_of(&values)
        })
    }

    fn contacts_under(
        &self,
        footprints: &[Footprint],
        mut conductance_s_per_m2: impl FnMut((usize, usize), f64) -> f64,
    ) -> Vec<ConductorContact> {
        self.contacts_of(footprints, |conductor, cover, load| {
            cover.conductance(|index, point| conductance_s_per_m2((conductor, index), load.pressure_pa(point)))
        })
    }

    /// The patches that some presses bring into contact, from the conductance of a patch under the load near it.
    fn contacts_of(
        &self,
        footprints: &[Footprint],
        mut conductance: impl FnMut(usize, &Cover, &Load<'_>) -> Matrix,
    ) -> Vec<ConductorContact> {
        let load = Load::new(footprints, self.grid.chart, self.contact.preload_pa);
        let mut contacts = Vec::new();
        for conductor in patches_near(&self.grid, load.reaches_m()) {
            let Some(cover) = &self.covers[conductor] else { continue };
            let conductance = conductance(conductor, cover, &load.near(self.grid.bounds_m(conductor)));
            // The first moment is the mean, so that the first value is the total conductance.
            let resting = self.at_rest.binary_search_by_key(&conductor, |contact| contact.conductor);
            let resting_s = resting.map_or(0.0, |index| self.at_rest[index].conductance.at(0, 0));
            if conductance.at(0, 0) - resting_s > self.least_s {
                contacts.push(ConductorContact { conductor, conductance });
            }
        }
        contacts
    }
}

/// The sum of some weights and their second moment about their centre.
fn moments(points: impl Iterator<Item = (Point2, f64)> + Clone) -> (f64, f64) {
    let (whole, x, y) = points.clone().fold((0.0, 0.0, 0.0), |(whole, x, y), (point, weight)| {
        (whole + weight, x + weight * point[0], y + weight * point[1])
    });
    let centre = [x / whole, y / whole];
    let square = |[x, y]: Point2| (x - centre[0]).powi(2) + (y - centre[1]).powi(2);
    let moment = points.map(|(point, weight)| weight * square(point)).sum();
    (whole, if whole > 0.0 { moment } else { 0.0 })
}

/// The patches that some presses may reach, in order, from their centres in the chart and reaches, m.
fn patches_near(grid: &PatchGrid, reaches: impl Iterator<Item = (Point2, f64)>) -> Vec<usize> {
    let mut patches: Vec<usize> = reaches.flat_map(|(centre, reach_m)| grid.patches_near(centre, reach_m)).collect();
    patches.sort_unstable();
    patches.dedup();
    patches
}
