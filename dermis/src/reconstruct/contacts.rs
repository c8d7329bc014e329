//! From a frame to its contacts: one function for files, live skins, replays and Python.

use crate::contact::Contact;
use crate::detect::{Circumstances, Detector};
use crate::geom::Surface;
use crate::image::Image;
use crate::reconstruct::{Reconstruct, ReconstructError};

/// A contact that a method adds is a part of a detected one within this distance, m.
const PART_OF_CONTACT_M: f64 = 0.02;

/// How the contacts of a frame are looked for.
#[derive(Debug, Clone, Copy)]
pub struct Search<'a> {
    /// Finds the contacts in images.
    pub(crate) detector: &'a Detector,
    /// The signal-to-noise ratio of a touch that the method adds where its image shows none; `None` leaves these out, as
    /// where a touch detector has not felt a touch.
    pub(crate) unseen: Option<f64>,
    /// Whether such a touch may be the only one of a frame.
    pub(crate) alone: bool,
}

/// A contact found in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// The contact.
    pub contact: Contact,
    /// The signal-to-noise ratio of its peak in the image; infinite if the method located it itself.
    pub signal: f64,
}

/// A contact with its distance from the edge of the skin, and the confidence that there are grounds for.
fn completed(contact: Contact, image: &Image, detector: &Detector) -> Contact {
    Contact {
        edge_m: image.space.edge_distance_m(contact.position_m),
        confidence: detector.with_grounds(contact.confidence),
        ..contact
    }
}

impl dyn Reconstruct + '_ {
    /// The contacts of a difference (frame minus baseline, ohm): located by the method itself, or the peaks of its image,
    /// [corrected](Reconstruct::correct) by the method. The image is written to `image`.
    ///
    /// # Errors
    /// A difference of another length than the protocol's, or with values that are not finite; an iteration that fails.
    ///
    /// # Panics
    /// If the image has other pixels than the method's.
    pub fn find_contacts(
        &self,
        difference: &[f64],
        search: Search<'_>,
        image: &mut Image,
    ) -> Result<Vec<Detection>, ReconstructError> {
        let difference = &search.detector.without_spikes(difference);
        self.reconstruct_into(difference, &mut image.values)?;
        let noise_ratio = search.detector.noise_ratio(difference);
        if search.detector.is_noise_alone(difference, noise_ratio) {
            return Ok(Vec::new());
        }
        if let Some(contacts) = self.contacts(difference)? {
            let located =
                |contact| Detection { contact: completed(contact, image, search.detector), signal: f64::INFINITY };
            return Ok(contacts.into_iter().map(located).collect());
        }
        let detected = search.detector.detect_under(image, self.image_noise_ratio(noise_ratio));
        let mut contacts: Vec<Contact> = detected.iter().map(|(contact, _)| *contact).collect();
        // What raises and what lowers the conductance is no touch alone.
        if !search.detector.has_both_signs() {
            self.correct(difference, &mut contacts);
        }
        contacts.iter_mut().for_each(|contact| *contact = completed(*contact, image, search.detector));
        let unseen = search.unseen.filter(|_| search.alone || !detected.is_empty());
        Ok(with_signals(&image.space.surface, contacts, &detected, unseen))
    }

    /// The noise of an image over that of untouched ones, from that of its difference. Images without a matrix may rise
    /// faster, as those of networks, which are trained to suppress noise: with twice, three and six times that of 50 dB,
    /// the root mean square of those of `spots` and `paper` is about 7, 12 and 30 times as large.
    fn image_noise_ratio(&self, noise_ratio: f64) -> f64 {
        noise_ratio.powi(if self.matrix().is_some() { 1 } else { 2 })
    }

    /// The image of a difference and its contacts, as of `find_contacts`, in a frame without a touch detector.
    ///
    /// # Errors
    /// As `find_contacts`.
    pub fn image_and_contacts(
        &self,
        difference: &[f64],
        detector: &Detector,
    ) -> Result<(Image, Vec<Contact>), ReconstructError> {
        let mut image = Image::zeros(self.pixels());
        let search = Search { detector, unseen: Some(f64::INFINITY), alone: true };
        let found = self.find_contacts(difference, search, &mut image)?;
        Ok((image, found.into_iter().map(|found| found.contact).collect()))
    }
}

/// Contacts after a correction by the method, each with the signal-to-noise ratio with which it was detected. The method may
/// have removed some. One that it has added has the ratio of the nearest detected one if it is a part of that, and else the
/// ratio `unseen`; without, it is left out.
fn with_signals(
    surface: &Surface,
    contacts: Vec<Contact>,
    detected: &[(Contact, Circumstances)],
    unseen: Option<f64>,
) -> Vec<Detection> {
    let signal = |contact: &Contact| {
        let same = detected.iter().find(|(other, _)| other.id == contact.id);
        let apart_m = |(other, _): &&(Contact, Circumstances)| surface.distance_m(contact.position_m, other.position_m);
        let nearest = || detected.iter().min_by(|a, b| apart_m(a).total_cmp(&apart_m(b)));
        let of = same.or_else(|| nearest().filter(|near| apart_m(near) <= PART_OF_CONTACT_M));
        of.map(|(_, under)| under.signal).or(unseen)
    };
    contacts.into_iter().filter_map(|contact| Some(Detection { contact, signal: signal(&contact)? })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_that_the_method_removes_and_adds_keep_the_signals_of_the_others() {
        let contact = |id: u64, x_m: f64| Contact { id, ..Contact::truth([x_m, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0) };
        let detected = [(0, 0.0, 9.0), (1, 0.02, 8.0), (2, 0.10, 7.0)].map(|(id, x_m, signal)| {
            (contact(id, x_m), Circumstances { signal, noise_m: 1e-3, radius_m: 5e-3, next_m: 0.02 })
        });
        // The one in the middle is removed, the first one moves past its place, the last one is split, and one is added.
        let corrected = vec![contact(0, 0.021), contact(2, 0.09), contact(3, 0.115), contact(4, 0.2)];
        let signals = |unseen: Option<f64>| -> Vec<(u64, f64)> {
            let signals = with_signals(&Surface::Plane, corrected.clone(), &detected, unseen);
            signals.iter().map(|found| (found.contact.id, found.signal)).collect()
        };
        assert_eq!(signals(Some(4.0)), [(0, 9.0), (2, 7.0), (3, 7.0), (4, 4.0)]);
        assert_eq!(signals(None), [(0, 9.0), (2, 7.0), (3, 7.0)]);
    }
}
