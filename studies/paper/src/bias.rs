//! Effects of the structure of a skin: error, sensitivity and bias by position.

use crate::bench::Bench;
use crate::choose::Choice;
use crate::controls::{Control, place_m};
use crate::scale::{REPORTED_SEED, Scale};
use crate::stage::Work;
use dermis::contact::Contact;
use dermis::detect::whole_image_centroid;
use dermis::geom::{Chart, Shape, Surface};
use dermis::stats::mean_and_sd;
use dermis_sim::evaluate::match_contacts;
use dermis_study::Result;
use dermis_study::comparison::{Named, Shown};
use serde::{Deserialize, Serialize};

/// Number of bins of a profile.
const BINS: usize = 15;
/// Maximum distance from the cut or from a rim that counts as near, m (`docs/conventions.md`: rim).
const NEAR_M: f64 = 0.02;

/// A press and its estimate. Lengths along the surface, m: the circumferential coordinate is the arc from the cut.
#[derive(Debug, Clone, Copy)]
struct ScoredPress {
    round_m: f64,
    along_m: f64,
    /// Offset of the contact from the touch, circumferential and axial; `None` for a miss.
    off_m: Option<[f64; 2]>,
    /// Offset of the centroid of the whole image (Eq. 11) from the touch, circumferential and axial.
    eq11_off_m: Option<[f64; 2]>,
    /// Peak of the image divided by the force.
    peak_per_n: f64,
}

/// Results of one method on one structure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Structure {
    /// The design's identifier.
    pub design: String,
    /// The method's identifier.
    pub method: String,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
    /// Number of presses on all twins.
    pub presses: usize,
    /// Presses without a contact within the gate.
    pub misses: usize,
    /// Fraction of missed presses in the middle third of the length.
    pub missed_middle: f64,
    /// Contacts without a press.
    pub false_positives: usize,
    /// Readings out of the range of the converter in a hundred untouched frames of each twin.
    pub saturated_readings: usize,
    /// Distance of contacts from their presses, m.
    pub localisation: MeanSd,
    /// The same in the middle third of the length.
    pub localisation_middle: MeanSd,
    /// The same within 20 mm of the cut, on both sides.
    pub localisation_cut: MeanSd,
    /// Spread of the peak per newton: standard deviation divided by mean.
    pub sensitivity_spread: f64,
    /// Mean peak per newton in the middle third of the length, divided by that in the outer thirds.
    pub sensitivity_middle: f64,
    /// Mean axial error towards the middle of the cylinder, m; negative is outwards.
    pub bias_along_m: f64,
    /// Mean circumferential error away from the cut, m.
    pub bias_round_m: f64,
    /// Mean axial error within 20 mm of a rim, m.
    pub bias_along_near_rims_m: f64,
    /// Mean circumferential error within 20 mm of the cut, m.
    pub bias_round_near_cut_m: f64,
    /// Mean axial error of the centroid of the whole image (Eq. 11) towards the middle of the cylinder, m.
    pub eq11_bias_along_m: f64,
    /// The same in the circumferential direction, away from the cut.
    pub eq11_bias_round_m: f64,
    /// Mean signed error (m, positive towards larger z) by z (m).
    pub along_profile_m: Vec<[f64; 2]>,
    /// Mean signed error (m, positive towards a larger arc) by the arc from the cut (m).
    pub round_profile_m: Vec<[f64; 2]>,
}

/// Mean and standard deviation; zero without values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct MeanSd {
    /// Number of values.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation.
    pub sd: f64,
}

impl MeanSd {
    /// Of some values.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
        let count = values.len();
        if count == 0 {
            return MeanSd { count, mean: 0.0, sd: 0.0 };
        }
        let (mean, sd) = mean_and_sd(&values);
        MeanSd { count, mean, sd }
    }

    /// The mean of lengths as text, mm.
    pub(crate) fn mean_mm(&self) -> String {
        if self.count == 0 { "none".into() } else { format!("{:.1}", self.mean * 1e3) }
    }

    /// The same with the standard deviation.
    pub(crate) fn mean_and_sd_mm(&self) -> String {
        if self.count == 0 { "none".into() } else { format!("{} \u{b1} {:.1}", self.mean_mm(), self.sd * 1e3) }
    }
}

/// Presses the twins of a design and evaluates all methods on the structure; saved results are reused.
pub(crate) fn structures(
    control: &Control,
    cut_rad: f64,
    bench: &Bench<'_>,
    methods: &[Named],
    scale: Scale,
    work: &Work,
) -> Result<Vec<Structure>> {
    let how: Vec<&str> = methods.iter().map(|method| method.identity.as_str()).collect();
    let name = format!("structure-{}", control.key);
    work.kept(&name, &how.join("; "), || press_and_summarize(control, cut_rad, bench, methods, scale))
}

/// The linear methods with the best alpha for a control, chosen on its own twins.
pub(crate) fn linear(control: &Control, bench: &Bench<'_>, scale: Scale, work: &Work) -> Result<Vec<Named>> {
    let name = format!("alpha-{}", control.key);
    let choice: Choice = work.kept(&name, &bench.skin.design().name, || Choice::make(bench, scale))?;
    choice.methods(bench)
}

fn press_and_summarize(
    control: &Control,
    cut_rad: f64,
    bench: &Bench<'_>,
    methods: &[Named],
    scale: Scale,
) -> Result<Vec<Structure>> {
    let surface = bench.skin.design().body.surface();
    let (mut scored, mut false_positives) = (vec![Vec::new(); methods.len()], vec![0; methods.len()]);
    let mut saturated_readings = 0;
    let seeds = REPORTED_SEED..REPORTED_SEED + scale.twins();
    let count = scale.structure_presses();
    let task = bench.progress.begin(&format!("pressing twins, {}", control.name), count * scale.twins() as usize);
    for seed in seeds {
        // Not on the grid: its columns interfere with the columns of patches, which would bias the circumferential
        // error.
        let presses = bench.presses(seed).at_random(count).presses;
        let pressed = bench.press(seed, &presses, scale.untouched(), &*task)?;
        saturated_readings += pressed.saturated_readings;
        for (number, method) in methods.iter().enumerate() {
            let detector = method.method.detector(&pressed.untouched, &bench.skin.design().protocol)?;
            let shown = Shown::of(method, &pressed.recording, &pressed.truth, &detector, bench.progress)?;
            false_positives[number] += shown.score.false_positives;
            scored[number].extend(score_presses(&surface, cut_rad, &pressed.truth, &shown));
        }
    }
    let extent = Extent::of(bench);
    let structure = methods.iter().zip(scored).zip(false_positives);
    Ok(structure
        .map(|((method, scored), false_positives)| {
            let mut structure = summarize(&scored, extent);
            (structure.design, structure.method) = (control.key.to_string(), method.key.clone());
            (structure.alpha, structure.false_positives) = (method.method.alpha(), false_positives);
            structure.saturated_readings = saturated_readings;
            structure
        })
        .collect())
}

fn score_presses(surface: &Surface, cut_rad: f64, truth: &[Vec<Contact>], shown: &Shown) -> Vec<ScoredPress> {
    let frames = truth.iter().zip(&shown.contacts).zip(&shown.images);
    let one = |((touches, contacts), image): ((&Vec<Contact>, &Vec<Contact>), &dermis::image::Image)| {
        let [touch] = touches[..] else { return None };
        let [round_m, along_m] = place_m(surface, touch.position_m, cut_rad);
        let found = match_contacts(touches, contacts, surface);
        let off = |to| surface.chart(touch.position_m, to);
        Some(ScoredPress {
            round_m,
            along_m,
            off_m: found.pairs.first().map(|&(_, contact, _)| off(contacts[contact].position_m)),
            eq11_off_m: whole_image_centroid(image).map(off),
            peak_per_n: image.peak().map_or(f64::NAN, |(_, peak)| peak) / touch.force_n,
        })
    };
    frames.filter_map(one).collect()
}

/// Dimensions of a skin, circumferential and axial, m.
#[derive(Debug, Clone, Copy)]
struct Extent {
    round_m: f64,
    along_m: f64,
}

impl Extent {
    fn of(bench: &Bench<'_>) -> Self {
        let with_ends = |chart: &Chart| !matches!(chart.shape(), Shape::Disk { .. });
        let chart = bench.skin.design().body.chart().filter(with_ends);
        let [round_m, along_m] = chart.map_or([f64::NAN; 2], |chart| chart.size_m());
        Extent { round_m, along_m }
    }
}

fn summarize(scored: &[ScoredPress], extent: Extent) -> Structure {
    let in_middle = |one: &ScoredPress| (one.along_m / extent.along_m - 0.5).abs() <= 1.0 / 6.0;
    let near_cut = |one: &ScoredPress| one.round_m.min(extent.round_m - one.round_m) <= NEAR_M;
    let near_rim = |one: &ScoredPress| one.along_m.min(extent.along_m - one.along_m) <= NEAR_M;
    let inwards = |place: f64, whole: f64, off: f64| if place < 0.5 * whole { off } else { -off };
    let along = |one: &ScoredPress, off: [f64; 2]| inwards(one.along_m, extent.along_m, off[1]);
    let round = |one: &ScoredPress, off: [f64; 2]| inwards(one.round_m, extent.round_m, off[0]);
    type Pick<'a> = &'a dyn Fn(&ScoredPress) -> bool;
    type Value<'a> = &'a dyn Fn(&ScoredPress) -> Option<f64>;
    let mean_sd =
        |pick: Pick<'_>, value: Value<'_>| MeanSd::of(scored.iter().filter(|one| pick(one)).filter_map(value));
    let all = |_: &ScoredPress| true;
    let distance = |one: &ScoredPress| one.off_m.map(|off| off[0].hypot(off[1]));
    let off_along = |one: &ScoredPress| one.off_m.map(|off| along(one, off));
    let off_round = |one: &ScoredPress| one.off_m.map(|off| round(one, off));
    let peak = |one: &ScoredPress| Some(one.peak_per_n);
    let missed = mean_sd(&in_middle, &|one| Some(f64::from(u8::from(one.off_m.is_none()))));
    let peaks = mean_sd(&all, &peak);
    let [middle, outer] = [mean_sd(&in_middle, &peak).mean, mean_sd(&|one| !in_middle(one), &peak).mean];
    let profile = |place: &dyn Fn(&ScoredPress) -> f64, whole: f64, axis: usize| {
        let bin = |number: usize| {
            let inside = |one: &ScoredPress| ((place(one) / whole * BINS as f64) as usize).min(BINS - 1) == number;
            let off = mean_sd(&inside, &|one| one.off_m.map(|off| off[axis]));
            (off.count > 0).then_some([(number as f64 + 0.5) / BINS as f64 * whole, off.mean])
        };
        (0..BINS).filter_map(bin).collect()
    };
    Structure {
        design: String::new(),
        method: String::new(),
        alpha: None,
        presses: scored.len(),
        misses: scored.iter().filter(|one| one.off_m.is_none()).count(),
        missed_middle: missed.mean,
        false_positives: 0,
        saturated_readings: 0,
        localisation: mean_sd(&all, &distance),
        localisation_middle: mean_sd(&in_middle, &distance),
        localisation_cut: mean_sd(&near_cut, &distance),
        sensitivity_spread: peaks.sd / peaks.mean,
        sensitivity_middle: middle / outer,
        bias_along_m: mean_sd(&all, &off_along).mean,
        bias_round_m: mean_sd(&all, &off_round).mean,
        bias_along_near_rims_m: mean_sd(&near_rim, &off_along).mean,
        bias_round_near_cut_m: mean_sd(&near_cut, &off_round).mean,
        eq11_bias_along_m: mean_sd(&all, &|one| one.eq11_off_m.map(|off| along(one, off))).mean,
        eq11_bias_round_m: mean_sd(&all, &|one| one.eq11_off_m.map(|off| round(one, off))).mean,
        along_profile_m: profile(&|one| one.along_m, extent.along_m, 1),
        round_profile_m: profile(&|one| one.round_m, extent.round_m, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pull_to_the_middle_is_positive_on_both_sides_and_a_shift_is_none() {
        let extent = Extent { round_m: 0.3, along_m: 0.3 };
        let press = |along_m: f64, off: [f64; 2]| ScoredPress {
            round_m: 0.01,
            along_m,
            off_m: Some(off),
            eq11_off_m: None,
            peak_per_n: if along_m == 0.15 { 0.5 } else { 1.0 },
        };
        let pulled =
            summarize(&[press(0.01, [0.001, 0.002]), press(0.29, [0.001, -0.002]), press(0.15, [0.0, 0.0])], extent);
        assert!((pulled.bias_along_near_rims_m - 0.002).abs() < 1e-12, "{pulled:?}");
        assert!((pulled.bias_round_near_cut_m - 0.002 / 3.0).abs() < 1e-12);
        assert!((pulled.sensitivity_middle - 0.5).abs() < 1e-12);
        assert_eq!(pulled.localisation_middle.count, 1);
        let shifted = summarize(&[press(0.01, [0.0, 0.002]), press(0.29, [0.0, 0.002])], extent);
        assert!(shifted.bias_along_m.abs() < 1e-12);
        assert!(shifted.along_profile_m.iter().all(|bin| (bin[1] - 0.002).abs() < 1e-12));
    }

    #[test]
    fn a_missed_press_counts_as_missed_and_as_nothing_else() {
        let scored = ScoredPress { round_m: 0.1, along_m: 0.12, off_m: None, eq11_off_m: None, peak_per_n: 1.0 };
        let structure = summarize(&[scored], Extent { round_m: 0.3, along_m: 0.3 });
        assert_eq!((structure.misses, structure.localisation.count, structure.missed_middle), (1, 0, 1.0));
        assert!(structure.along_profile_m.is_empty());
    }
}
