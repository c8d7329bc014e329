//! Faults that may be behind a frame.

use super::data::Data;
use super::fault::Fault;
use super::fit::{Fit, Model};
use dermis::linalg::{Matrix, dot};
use dermis::stats::{rms, upper_median};

/// What an uneven skin may change of a value, and of all values relative to the root mean square of the frame.
const UNEVEN_SHARE: f64 = 0.2;
const UNEVEN_SIZE: f64 = 0.05;
/// Faults of each kind that are fitted.
const KEPT: usize = 2;
/// Factor by which the values of a drive without current are off, at least half of them.
const WITHOUT_CURRENT: f64 = 3.0;
/// A value of an open electrode counts like one that is this many standard deviations off.
const OPEN_SD: f64 = 3.0;

/// The most likely faults of each kind that change some values much, beside those already found. Rough: the skin is
/// taken as even, and a wrong value counts by the logarithm of its distance.
pub(super) fn gross(model: &Model, data: &Data, found: &[Fault]) -> Vec<Fault> {
    let count = model.protocol.electrode_count();
    let pairs = || (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
    let even = model.values(&model.even, found);
    let without_current = (0..count).filter(|&electrode| may_be_open(model, data, &even, electrode));
    let open = without_current.map(|electrode| Fault::OpenElectrode { electrode }).collect();
    let shorts = pairs().map(|electrodes| Fault::Short { electrodes, ohm: 0.0 }.with_size(0.0, model.typical_ohm));
    let shorts = shorts.collect();
    let exchanged = pairs().map(|electrodes| Fault::ExchangedWires { electrodes }).collect();
    let references = (0..model.drives).filter_map(|drive| reference(model, data, found, drive)).collect();
    let kinds: [Vec<Fault>; 4] = [open, shorts, exchanged, references];
    let mut all = Vec::new();
    for kind in kinds {
        let mut costs: Vec<(f64, Fault)> =
            kind.into_iter().map(|fault| (cost(model, data, found, fault), fault)).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.extend(costs.into_iter().take(KEPT).map(|(_, fault)| fault));
    }
    all
}

/// Whether an electrode may be open: its drives carry no current, so that their values are noise, or far from those of the model.
/// (The values of an open electrode may be anything: it explains any other fault beside it, such as a cut.)
fn may_be_open(model: &Model, data: &Data, even: &[f64], electrode: usize) -> bool {
    let channels = model.protocol.channels().iter().enumerate();
    let driven = channels.filter(|(_, one)| one.drive.contains(&electrode));
    let factors: Vec<f64> = driven
        .map(|(channel, _)| match data.is_noise[channel] {
            true => f64::INFINITY,
            false => (data.values[channel].abs().max(f64::MIN_POSITIVE) / even[channel].abs()).ln().abs(),
        })
        .collect();
    upper_median(&factors).is_none_or(|factor| factor > WITHOUT_CURRENT.ln())
}

/// How badly the even skin with a fault fits.
fn cost(model: &Model, data: &Data, found: &[Fault], fault: Fault) -> f64 {
    let mut faults = found.to_vec();
    faults.push(fault);
    let network = model.network(&model.even, &faults);
    let frame = network.frame(&model.protocol, &model.drive_of);
    let size = UNEVEN_SIZE * rms(model.frame.iter().copied());
    let channels = model.protocol.channels().iter().enumerate();
    channels
        .map(|(channel, one)| {
            let sd = data.sd[channel].hypot(UNEVEN_SHARE * frame[channel]).hypot(size);
            let off = if network.is_open(one) {
                OPEN_SD
            } else {
                (data.value(channel, frame[channel]) - frame[channel]) / sd
            };
            (1.0 + off * off).ln()
        })
        .sum()
}

/// A reference resistor of a drive: the median of the model over the values. `None` where they have the other sign.
fn reference(model: &Model, data: &Data, found: &[Fault], drive: usize) -> Option<Fault> {
    let frame = model.values(&model.even, found);
    let own: Vec<usize> = (0..frame.len()).filter(|&channel| model.drive_of[channel] == drive).collect();
    let sizes: Vec<f64> = own.iter().map(|&channel| frame[channel].abs()).collect();
    let least = upper_median(&sizes)?;
    let large = own.iter().filter(|&&channel| frame[channel].abs() >= least && data.values[channel] != 0.0);
    let ratios: Vec<f64> = large.map(|&channel| frame[channel] / data.value(channel, frame[channel])).collect();
    let factor = upper_median(&ratios).filter(|factor| *factor > 0.0)?;
    Some(Fault::Reference { drive, factor })
}

/// The most likely small faults beside those of a fit, with what each adds to the logarithm of the likelihood, to first
/// order (the score test; Rao, 1948, DOI 10.1017/S0305004100023987).
pub(super) fn small(model: &Model, fit: &Fit, impedance: &Matrix) -> Vec<(f64, Fault)> {
    let contacts = (0..model.protocol.electrode_count()).map(|electrode| Fault::PoorContact { electrode, ohm: 0.0 });
    let references = (0..model.drives).map(|drive| Fault::Reference { drive, factor: 1.0 });
    let mut all = Vec::new();
    for kind in [contacts.collect::<Vec<Fault>>(), references.collect()] {
        let fresh = kind.into_iter().filter(|fault| !fit.faults.iter().any(|known| known.is_like(fault)));
        let mut gains: Vec<(f64, Fault)> = fresh.map(|fault| (gain(model, fit, impedance, fault), fault)).collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.extend(gains.into_iter().take(KEPT));
    }
    all
}

fn gain(model: &Model, fit: &Fit, impedance: &Matrix, fault: Fault) -> f64 {
    let mut faults = fit.faults.clone();
    faults.push(fault);
    let network = model.network(impedance, &faults);
    let mut change = model.by_size(impedance, &faults, faults.len() - 1);
    for (channel, one) in model.protocol.channels().iter().enumerate() {
        change[channel] = if network.is_open(one) { 0.0 } else { change[channel] / fit.data.sd[channel] };
    }
    let passed = fit.linear.transposed_product(&change);
    let adapted = fit.linear.factor.solve(&passed);
    let score = dot(&change, &fit.residuals);
    // A contact has no negative resistance.
    if score < 0.0 && matches!(fault, Fault::PoorContact { .. }) {
        return 0.0;
    }
    0.5 * score * score / (1.0 + dot(&change, &change) - dot(&passed, &adapted))
}
