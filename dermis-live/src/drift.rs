//! What drifts in the frame of a skin beside what touches it: the coat's conductance as a whole and along each axis, and each
//! electrode's contact.

use crate::skin::LiveSkin;
use dermis::forward::Matrix;
use dermis::geom::Point3;
use dermis::geom::vector::centroid;
use dermis::linalg::invert_spd;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Pixels so near a contact may have changed by it, m.
const REACH_M: f64 = 0.035;
/// Standard deviation of the relative change of a touched pixel.
const TOUCH_SD: f64 = 0.5;
/// Standard deviation of the relative drift of a coat.
const COAT_SD: f64 = 0.03;
/// Standard deviation of the drift of a contact's resistance, relative to itself, and at least, ohm.
const CONTACT_SD: f64 = 0.5;
const CONTACT_LEAST_OHM: f64 = 0.5;

/// The ways in which the frame of a skin drifts.
#[derive(Debug, Clone)]
pub struct Drifts {
    /// What each changes in a frame for one standard deviation of it, drifts x channels, ohm.
    pub modes: Matrix,
}

impl Drifts {
    /// Of a skin: its coat as a whole and along each axis, then each electrode's contact.
    pub fn of(skin: &LiveSkin) -> Self {
        let channel_count = skin.design.protocol.channel_count();
        let extent_m = 0.5 * skin.pixels.extent_m();
        let mut modes: Vec<Vec<f64>> = Vec::new();
        let shapes: [Box<dyn Fn(Point3) -> f64>; 4] = [
            Box::new(|_| 1.0),
            Box::new(|[x, _, _]| x / extent_m),
            Box::new(|[_, y, _]| y / extent_m),
            Box::new(|[_, _, z]| z / extent_m),
        ];
        let centre = centroid(&skin.pixels.centres_m);
        for shape in shapes {
            let weights: Vec<f64> = (skin.pixels.centres_m.iter())
                .map(|place| COAT_SD * shape([0, 1, 2].map(|axis| place[axis] - centre[axis])))
                .map(|weight| if weight.is_finite() { weight } else { 0.0 })
                .collect();
            let mode =
                |channel: usize| skin.linear.jacobian.row(channel).iter().zip(&weights).map(|(j, w)| j * w).sum();
            // The constant shape is the coat as a whole; a body without extent along an axis has no such mode.
            modes.push((0..channel_count).map(mode).collect());
        }
        for electrode in 0..skin.design.electrodes.len() {
            let sd_ohm = (CONTACT_SD * skin.contact_ohm(electrode)).max(CONTACT_LEAST_OHM);
            // The voltage of an electrode that a current leaves through differs from the coat's below by its contact's.
            modes.push(skin.contact_gains(electrode).map(|gain| sd_ohm * gain).collect());
        }
        let values: Vec<f64> = modes.iter().flatten().copied().collect();
        Drifts { modes: Matrix { rows: modes.len(), columns: channel_count, values } }
    }
}

/// What a map from frames to drifts is made for.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// Where the contacts are, m.
    pub places: Vec<Point3>,
    /// Standard deviation of the noise of each channel, ohm.
    pub sd_ohm: Vec<f64>,
    /// Channels that are left out.
    pub masked: Vec<bool>,
}

/// Makes the maps from frames to drifts, on a thread of its own where it is asked early enough.
///
/// The answer depends on the question alone, not on when it was asked: a replay gets the same.
#[derive(Debug)]
pub struct Fitter {
    skin: Arc<LiveSkin>,
    drifts: Arc<Drifts>,
    asked: Option<(Question, JoinHandle<Matrix>)>,
}

impl Fitter {
    /// For a skin.
    pub fn new(skin: Arc<LiveSkin>) -> Self {
        Fitter { drifts: Arc::new(Drifts::of(&skin)), skin, asked: None }
    }

    /// The drifts that are fitted.
    pub fn drifts(&self) -> &Drifts {
        &self.drifts
    }

    /// Begins to make a map.
    pub fn ask(&mut self, question: &Question) {
        let (skin, drifts, own) = (Arc::clone(&self.skin), Arc::clone(&self.drifts), question.clone());
        let thread = std::thread::Builder::new().name("dermis-drift".into());
        // Without a thread it is made when the answer is wanted.
        self.asked = thread.spawn(move || fit(&skin, &drifts, &own)).ok().map(|thread| (question.clone(), thread));
    }

    /// The map from a frame's difference to the drifts in it, channels x drifts.
    pub fn answer(&mut self, question: &Question) -> Matrix {
        let asked = self.asked.take().filter(|(asked, _)| asked == question);
        let made = asked.and_then(|(_, thread)| thread.join().ok());
        made.unwrap_or_else(|| fit(&self.skin, &self.drifts, question))
    }
}

/// The map from a difference to the drifts in it, fitted together with changes of the pixels near the contacts: the rows of
/// `(A' W A + 1)^-1 A' W` that belong to drifts, with the columns of `A` for one standard deviation each and
/// `W` the inverse variances of the noise. Given as its transpose, channels x drifts.
fn fit(skin: &LiveSkin, drifts: &Drifts, Question { places, sd_ohm, masked }: &Question) -> Matrix {
    let (jacobian, pixels) = (&skin.linear.jacobian, &skin.pixels);
    let reached = |pixel: &usize| {
        places.iter().any(|&place| pixels.surface.distance_m(place, pixels.centres_m[*pixel]) <= REACH_M)
    };
    let touched: Vec<usize> = (0..pixels.len()).filter(reached).collect();
    let (drift_count, channel_count) = (drifts.modes.rows, jacobian.rows);
    let count = drift_count + touched.len();
    // Columns of A over the deviations of the noise, one after another.
    let mut columns = Matrix::zeros(count, channel_count);
    for (row, values) in columns.values.chunks_exact_mut(channel_count).enumerate() {
        for (channel, value) in values.iter_mut().enumerate().filter(|(channel, _)| !masked[*channel]) {
            let effect = match row.checked_sub(drift_count) {
                None => drifts.modes.at(row, channel),
                Some(pixel) => TOUCH_SD * jacobian.at(channel, touched[pixel]),
            };
            *value = effect / sd_ohm[channel];
        }
    }
    let mut gram = Matrix::zeros(count, count);
    for i in 0..count {
        for j in 0..=i {
            let product: f64 = columns.row(i).iter().zip(columns.row(j)).map(|(a, b)| a * b).sum();
            *gram.at_mut(i, j) = product;
            *gram.at_mut(j, i) = product;
        }
        *gram.at_mut(i, i) += 1.0;
    }
    let mut fit = Matrix::zeros(channel_count, drift_count);
    // The ones on the diagonal keep it positive definite, if the noise is finite.
    let Ok(gram) = invert_spd(&gram) else { return fit };
    for (channel, row) in fit.values.chunks_exact_mut(drift_count).enumerate() {
        for (drift, value) in row.iter_mut().enumerate() {
            let sum: f64 = (0..count).map(|other| gram.at(drift, other) * columns.at(other, channel)).sum();
            *value = sum / sd_ohm[channel];
        }
    }
    fit
}
