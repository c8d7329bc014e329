//! From an image to contacts.
//!
//! A pixel is used if it exceeds [`DetectOptions::noise_factor`] standard deviations of its noise and
//! [`DetectOptions::peak_fraction`] of the image's peak. Peaks are separated by the saddle between them and located by
//! their centroid. Low peaks below [`DetectOptions::strength_fraction`] of the strongest contact are artefacts. Each
//! contact has a standard deviation of its position and the probability that it is real. Each method defines the options
//! for its images.

mod forces;
mod noise;
mod peaks;
mod spots;
mod spread;
#[cfg(test)]
mod tests;

pub use forces::Forces;
pub use noise::ImageNoise;
pub use spread::{Circumstances, Factor, Misplacement, PositionSpread, blur_share};

use crate::contact::{ConductanceChange, Contact, DOUBT, GATE_M};
use crate::estimate::reciprocal_pairs::ReciprocalPairs;
use crate::geom::Surface;
use crate::geom::vector::{Point3, dot, normalize, scale, sub};
use crate::image::Image;
use peaks::Basin;
use serde::{Deserialize, Serialize};
use spots::Spot;
use std::borrow::Cow;
use std::sync::Arc;

/// Detection options. The defaults are those of linear images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectOptions {
    /// A contact's peak exceeds this many standard deviations of the image's noise at its pixel. At 5 the noise of 900
    /// independent pixels gives a false contact in one image of 4,000.
    pub noise_factor: f64,
    /// A contact's peak exceeds this fraction of the image's maximum: above the side lobes of linear images.
    pub peak_fraction: f64,
    /// A contact whose peak is lower than that of the strongest contact has a strength (the integral of its image) above
    /// this fraction of the strongest one's. Below it are artefacts of linear images: narrow peaks at electrodes and edges
    /// where the model of a real skin is wrong. Cards of networks without this key have none.
    #[serde(default = "no_least_strength")]
    pub strength_fraction: f64,
    /// Two peaks are two contacts if the image between them falls below this fraction of the lower one.
    pub saddle_fraction: f64,
    /// The weight of a pixel in the centroid and the strength is its value above this fraction of its contact's peak.
    pub weight_fraction: f64,
    /// For images in which the square root of every touch is a Gaussian of this standard deviation, m: spots of this
    /// shape are fitted, and neither centroids nor the saddle are used.
    pub spot_width_m: Option<f64>,
    /// Measured position errors of contacts for the method and its skin; `None` uses those of linear images.
    pub spread: Option<PositionSpread>,
    /// Measured conversion of strengths to forces for the method and its skin; `None` leaves forces unknown.
    pub forces: Option<Forces>,
}

/// The fraction in cards that do not state one, where the [default](DetectOptions::default) does not apply.
fn no_least_strength() -> f64 {
    0.0
}

impl Default for DetectOptions {
    fn default() -> Self {
        DetectOptions {
            noise_factor: 5.0,
            peak_fraction: 0.35,
            strength_fraction: 0.2,
            saddle_fraction: 0.7,
            weight_fraction: 0.15,
            spot_width_m: None,
            spread: None,
            forces: None,
        }
    }
}

impl DetectOptions {
    /// Checks values that were read from a file.
    ///
    /// # Errors
    /// The field and its value.
    pub fn check(&self) -> Result<(), String> {
        let DetectOptions { noise_factor, peak_fraction, strength_fraction, saddle_fraction, weight_fraction, .. } =
            self;
        let shares = [
            ("peak_fraction", peak_fraction),
            ("strength_fraction", strength_fraction),
            ("saddle_fraction", saddle_fraction),
            ("weight_fraction", weight_fraction),
        ];
        if let Some((name, share)) = shares.iter().find(|(_, share)| !(0.0..=1.0).contains(*share)) {
            return Err(format!("{name} is {share}: it must be from 0 to 1"));
        }
        if !(*noise_factor >= 0.0 && noise_factor.is_finite()) {
            return Err(format!("noise_factor is {noise_factor}: it must not be negative"));
        }
        if let Some(width_m) = self.spot_width_m.filter(|width_m| !(*width_m > 0.0 && width_m.is_finite())) {
            return Err(format!("spot_width_m is {width_m}: it must be positive"));
        }
        self.spread.as_ref().map_or(Ok(()), PositionSpread::check)?;
        self.forces.as_ref().map_or(Ok(()), Forces::check)
    }
}

/// Pixels below this many standard deviations of noise have no weight in a centroid.
const FLOOR_SD: f64 = 2.0;

/// The position error of a linear image per axis, in addition to the noise and the pixel size, as a fraction of a
/// contact's radius (of a disk of its area): as measured by `dermis calibrate cylinder30` ([`blur_share`]), to 10 %.
const BLUR_ERROR: f64 = 0.1;

/// The depth of a side lobe over the height of its touch, at most. Of NOSER: 0.11 to 0.38 in 240 presses on `cylinder30`
/// with objects of many shapes, 0.2 for metal in a tank; 0.62 to 1.01 for metal with plastic.
const MAX_SIDE_LOBE: f64 = 0.5;

/// Finds contacts in images whose noise is known, or estimated from each image.
#[derive(Debug, Clone, Default)]
pub struct Detector {
    options: DetectOptions,
    noise: Option<ImageNoise>,
    /// The change of conductance where the image is positive, if contacts of both signs are looked for.
    positive: Option<ConductanceChange>,
    /// Whether nothing is known of the noise, or frames do not fit: no contact is then more probable than not.
    is_doubtful: bool,
    /// Tell spikes of single channels, and the noise of a frame.
    reciprocal: Option<Arc<ReciprocalPairs>>,
}

/// The noise of one image.
struct FrameNoise<'a> {
    known: Option<&'a ImageNoise>,
    /// The standard deviation of a pixel, where nothing else is known.
    even_sd: f64,
    /// The noise over the known one.
    ratio: f64,
}

impl FrameNoise<'_> {
    /// The standard deviation of a pixel.
    fn sd(&self, pixel: usize) -> f64 {
        self.known.map_or(self.even_sd, |noise| self.ratio * noise.sd()[pixel])
    }
}

impl Detector {
    /// A detector that estimates the noise from each image, by the difference of pixels from the mean of their
    /// neighbours. This is the standard deviation of white noise; it is zero for a smooth image.
    pub fn new(options: DetectOptions) -> Self {
        Detector { options, ..Detector::default() }
    }

    /// The same detector for images of known noise.
    pub fn with_noise(self, noise: ImageNoise) -> Self {
        Detector { noise: Some(noise), ..self }
    }

    /// The same detector for frames whose reciprocal channels tell spikes of single channels, which are taken out, and noise that is
    /// larger than that of the untouched frames, which then counts.
    pub fn with_reciprocal_pairs(self, pairs: ReciprocalPairs) -> Self {
        Detector { reciprocal: Some(Arc::new(pairs)), ..self }
    }

    /// A difference, ohm, without spikes of single channels, if the reciprocal channels of a frame tell them.
    pub(crate) fn without_spikes<'a>(&self, difference: &'a [f64]) -> Cow<'a, [f64]> {
        match &self.reciprocal {
            Some(pairs) => pairs.without_spikes(difference),
            None => Cow::Borrowed(difference),
        }
    }

    /// The noise of a difference, ohm, over the known one, as far as reciprocal channels tell it; else 1.
    pub fn noise_ratio(&self, difference: &[f64]) -> f64 {
        self.reciprocal.as_ref().map_or(1.0, |pairs| pairs.noise_ratio(difference))
    }

    /// Whether a difference, ohm, with this ratio of noise is noise alone, as far as reciprocal channels tell it.
    pub(crate) fn is_noise_alone(&self, difference: &[f64], noise_ratio: f64) -> bool {
        self.reciprocal.as_ref().is_some_and(|pairs| pairs.is_noise_alone(difference, noise_ratio))
    }

    /// The probability of a contact as far as there are grounds for it.
    pub(crate) fn with_grounds(&self, confidence: f64) -> f64 {
        if self.is_doubtful { confidence.min(DOUBT) } else { confidence }
    }

    /// The same detector for images of which nothing tells the noise: no contact is then more probable than not.
    pub fn with_doubt(self) -> Self {
        Detector { is_doubtful: true, ..self }
    }

    /// The same detector for contacts of both signs, each with its [sign](Contact::conductance). `positive` is the
    /// change of conductance where the image is positive, that of a touch. Thresholds relative to the image's peak
    /// and to the strongest contact apply to both signs together, since side lobes of the one are peaks of the other.
    pub fn with_both_signs(self, positive: ConductanceChange) -> Self {
        Detector { positive: Some(positive), ..self }
    }

    /// Whether it looks for contacts of both signs.
    pub(crate) fn has_both_signs(&self) -> bool {
        self.positive.is_some()
    }

    /// The contacts in an image, the strongest peak first.
    ///
    /// Values that are not finite belong to no contact.
    ///
    /// # Panics
    /// If the number of values differs from the number of pixels, or the noise belongs to other pixels.
    pub fn detect(&self, image: &Image) -> Vec<Contact> {
        self.detect_under(image, 1.0).into_iter().map(|(contact, _)| contact).collect()
    }

    /// The contacts in an image whose noise is the known one times a factor, each with the circumstances that determine the standard
    /// deviation of its position.
    ///
    /// # Panics
    /// As [`detect`](Self::detect).
    pub fn detect_under(&self, image: &Image, noise_ratio: f64) -> Vec<(Contact, Circumstances)> {
        assert_eq!(image.values.len(), image.space.len(), "a value per pixel");
        if let Some(noise) = &self.noise {
            assert_eq!(noise.pixel_count(), image.space.len(), "the noise of these pixels");
        }
        let size = |value: f64| if self.positive.is_some() { value.abs() } else { value };
        let finite = image.values.iter().copied().filter(|value| value.is_finite());
        let highest = finite.map(size).fold(0.0, f64::max);
        let noise = self.noise(image, noise_ratio);
        let mut found = self.found(image, highest, self.positive, &noise);
        if let Some(positive) = self.positive {
            let values = image.values.iter().map(|value| -value).collect();
            let negative = Image { space: Arc::clone(&image.space), values };
            found.extend(self.found(&negative, highest, Some(positive.reversed()), &noise));
            found.sort_by(|a, b| b.height.total_cmp(&a.height));
        }
        self.remove_artefacts(&mut found);
        (0..found.len()).map(|index| self.rated(image, &found, index, highest)).collect()
    }

    /// The noise of an image: the known one times a factor.
    fn noise(&self, image: &Image, ratio: f64) -> FrameNoise<'_> {
        let even_sd = if self.noise.is_none() { noise::roughness(image) } else { 0.0 };
        FrameNoise { known: self.noise.as_ref(), even_sd, ratio }
    }

    /// Whether an image of a linear method shows a change of the sign that is not that of a touch, above the noise and too
    /// strong for a side lobe of a touch: contacts found in it may be side lobes of that change. The image is that of a difference, ohm.
    ///
    /// # Panics
    /// As [`detect`](Self::detect).
    pub fn shows_other_sign(&self, difference: &[f64], image: &Image) -> bool {
        let noise = self.noise(image, self.noise_ratio(difference));
        let highest = image.values.iter().copied().fold(0.0, f64::max);
        let is_other = |(pixel, value): (usize, &f64)| {
            -value > (MAX_SIDE_LOBE * highest).max(self.options.noise_factor * noise.sd(pixel))
        };
        image.values.iter().enumerate().any(is_other)
    }

    /// Removes the contacts that are lower and far weaker than the strongest one.
    fn remove_artefacts(&self, found: &mut Vec<Found>) {
        let strongest = found.iter().max_by(|a, b| a.strength.total_cmp(&b.strength));
        let Some((height, strength)) = strongest.map(|contact| (contact.height, contact.strength)) else { return };
        let least = self.options.strength_fraction * strength;
        found.retain(|contact| contact.height >= height || contact.strength >= least);
    }

    /// The peaks of an image, which are contacts of the given sign.
    fn found(
        &self,
        image: &Image,
        highest: f64,
        conductance: Option<ConductanceChange>,
        noise: &FrameNoise<'_>,
    ) -> Vec<Found> {
        let found = match self.options.spot_width_m {
            Some(width_m) => self.spots(image, width_m, noise),
            None => self.basins(image, highest, noise),
        };
        found.into_iter().map(|found| Found { conductance, ..found }).collect()
    }

    fn spots(&self, image: &Image, width_m: f64, noise: &FrameNoise<'_>) -> Vec<Found> {
        let least = |pixel: usize, first: f64| {
            (self.options.noise_factor * noise.sd(pixel)).max(self.options.peak_fraction * first * first).sqrt()
        };
        spots::spots(image, width_m, least)
            .iter()
            .map(|spot| found_spot(image, spot, width_m, noise.sd(spot.pixel)))
            .collect()
    }

    fn basins(&self, image: &Image, highest: f64, noise: &FrameNoise<'_>) -> Vec<Found> {
        let least =
            |pixel: usize| (self.options.noise_factor * noise.sd(pixel)).max(self.options.peak_fraction * highest);
        let basins = peaks::basins(image, self.options.saddle_fraction, |pixel| 2.0 * noise.sd(pixel));
        let high = basins.iter().filter(|basin| basin.height > least(basin.peak));
        high.map(|basin| self.found_basin(image, basin, noise)).collect()
    }

    fn found_basin(&self, image: &Image, basin: &Basin, noise: &FrameNoise<'_>) -> Found {
        let space = &image.space;
        let peak_sd = noise.sd(basin.peak);
        // Far from the peak the noise exceeds the contact.
        let floor = (self.options.weight_fraction * basin.height).max(FLOOR_SD * peak_sd);
        let inside: Vec<usize> = basin.pixels.iter().copied().filter(|&p| image.values[p] > floor).collect();
        let weight = |pixel: usize| (image.values[pixel] - floor) * space.areas[pixel];
        let origin = space.centres_m[basin.peak];
        let mean = space.surface.weighted_mean(origin, inside.iter().map(|&p| (space.centres_m[p], weight(p))));
        let half_up = inside.iter().filter(|&&p| image.values[p] > 0.5 * basin.height);
        let noise_variance_m2 = match noise.known {
            Some(known) => noise.ratio.powi(2) * known.centroid_variance_m2(image, &inside, basin.peak, floor, mean),
            None => white_centroid_variance_m2(image, &inside, floor, peak_sd, mean),
        };
        Found {
            place: place_on_surface(image, &inside, mean),
            strength: inside.iter().map(|&p| image.values[p] * space.areas[p]).sum(),
            area_m2: half_up.map(|&p| space.areas[p]).sum(),
            height: basin.height,
            peak_sd,
            noise_variance_m2,
            conductance: None,
        }
    }

    /// A contact with all values that follow from its own image and from the neighbouring contacts.
    fn rated(&self, image: &Image, found: &[Found], index: usize, highest: f64) -> (Contact, Circumstances) {
        let own = &found[index];
        let surface = &image.space.surface;
        let others = found.iter().enumerate().filter(|(other, _)| *other != index);
        let distance_m = |(_, other): (usize, &Found)| surface.distance_m(own.place.0, other.place.0);
        let circumstances = Circumstances {
            signal: own.height / own.peak_sd,
            // The pixel size: a uniform distribution over a pixel has the variance of its side squared over twelve.
            noise_m: (own.noise_variance_m2 + image.space.half_pixel_m().powi(2) / 3.0).sqrt(),
            radius_m: (own.area_m2 / std::f64::consts::PI).sqrt(),
            next_m: others.map(distance_m).fold(f64::INFINITY, f64::min),
        };
        let sd_m = match &self.options.spread {
            Some(spread) => spread.sd_m(&circumstances),
            None => circumstances.noise_m.hypot(BLUR_ERROR * circumstances.radius_m),
        };
        // The table of forces is that of touches.
        let forces = self.options.forces.filter(|_| own.conductance == self.positive);
        let [force_n, force_sd_n] = forces.map_or([f64::NAN; 2], |forces| forces.of(own.strength));
        let confidence = confidence(own.height, own.peak_sd, highest, sd_m, image.space.len());
        let contact = Contact {
            id: index as u64,
            strength: own.strength,
            area_m2: own.area_m2,
            force_sd_n,
            sd_m,
            confidence: if self.is_doubtful { DOUBT * confidence } else { confidence },
            conductance: own.conductance,
            ..Contact::truth(own.place.0, own.place.1, force_n)
        };
        (contact, circumstances)
    }
}

/// The measurements of a contact in an image.
struct Found {
    /// Its position, and the outward normal there.
    place: (Point3, Point3),
    strength: f64,
    area_m2: f64,
    height: f64,
    /// Standard deviation of the noise at its peak.
    peak_sd: f64,
    /// Variance of its position per axis due to noise.
    noise_variance_m2: f64,
    conductance: Option<ConductanceChange>,
}

/// A contact from a fitted spot.
fn found_spot(image: &Image, spot: &Spot, width_m: f64, peak_sd: f64) -> Found {
    let height = spot.height * spot.height;
    Found {
        place: place_on_surface(image, &[spot.pixel], spot.centre_m),
        // The square of a Gaussian is a Gaussian of half the variance.
        strength: height * std::f64::consts::PI * width_m * width_m,
        area_m2: std::f64::consts::PI * width_m * width_m * std::f64::consts::LN_2,
        height,
        peak_sd,
        noise_variance_m2: spots::centre_variance_m2(&image.space, spot, peak_sd),
        conductance: None,
    }
}

/// The contacts in an image, the strongest peak first; the noise is estimated from the image itself, as in
/// [`Detector::new`].
pub fn detect(image: &Image, options: &DetectOptions) -> Vec<Contact> {
    Detector::new(options.clone()).detect(image)
}

/// The centroid of a whole image, weighted by the positive values and the areas of all pixels (the paper's Eq. 11); on
/// a cylinder the circular mean. `None` if no value is positive.
///
/// The paper sums over raw values; its network's images are not negative. In a linear image the negative side lobes
/// would also enter the denominator, which can become zero, so they have no weight.
pub fn whole_image_centroid(image: &Image) -> Option<Point3> {
    let (mut total, mut sum) = (0.0, [0.0; 3]);
    for ((&value, centre), area) in image.values.iter().zip(&image.space.centres_m).zip(&image.space.areas) {
        if value.is_finite() && value > 0.0 {
            let weight = value * area;
            total += weight;
            (0..3).for_each(|axis| sum[axis] += weight * centre[axis]);
        }
    }
    if total <= 0.0 {
        return None;
    }
    let mean = scale(sum, 1.0 / total);
    match image.space.surface {
        // The sums of cosine and sine give the mean direction.
        Surface::Cylinder { .. } => image.space.surface.at(mean[2], mean[1].atan2(mean[0])),
        Surface::Plane => Some(mean),
        Surface::Free => {
            let pixels: Vec<usize> = (0..image.space.len()).collect();
            Some(place_on_surface(image, &pixels, mean).0)
        }
    }
}

/// The point of the surface nearest to a mean of points on it, and the outward normal there. On a surface known only by
/// its pixels it is projected onto the tangent plane of the nearest pixel.
fn place_on_surface(image: &Image, pixels: &[usize], mean: Point3) -> (Point3, Point3) {
    let space = &image.space;
    if let Some(normal) = space.surface.normal(mean) {
        return (mean, normal);
    }
    let away = |&pixel: &usize| dot(sub(space.centres_m[pixel], mean), sub(space.centres_m[pixel], mean));
    let nearest = pixels.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
    let nearest = nearest.expect("a contact holds its peak's pixel");
    let normal = normalize(space.normals[nearest]);
    let height = dot(sub(mean, space.centres_m[nearest]), normal);
    (sub(mean, scale(normal, height)), normal)
}

/// Variance of a centroid per axis for white pixel noise: `sum (w_p' (x_p - c))^2 sd^2 / W^2 / 2`; the factor 1/2 is
/// the average over two axes.
fn white_centroid_variance_m2(image: &Image, inside: &[usize], floor: f64, sd: f64, mean: Point3) -> f64 {
    let space = &image.space;
    let total: f64 = inside.iter().map(|&p| (image.values[p] - floor) * space.areas[p]).sum();
    let sum: f64 =
        (inside.iter()).map(|&p| (space.areas[p] * space.surface.distance_m(space.centres_m[p], mean)).powi(2)).sum();
    0.5 * sum * (sd / total).powi(2)
}

/// The probability that a true contact is within the [gate](GATE_M): that the peak is not noise, times that it is not a
/// side lobe of a higher peak, times that its position error is less than the gate.
///
/// - Not noise: a white image of `n` pixels has a pixel above `z` standard deviations with a probability of at most
///   `n Q(z)`.
/// - Not a side lobe: the probability rises linearly with the peak relative to the image's maximum, from 0.5 at the
///   lowest accepted height to 1 at the same height.
/// - Position: the error is Gaussian with `sd_m` per axis, so it is less than r with probability
///   `1 - exp(-r^2 / (2 sd^2))`.
fn confidence(height: f64, noise_sd: f64, highest: f64, sd_m: f64, pixel_count: usize) -> f64 {
    let false_alarm = if noise_sd > 0.0 { pixel_count as f64 * normal_tail(height / noise_sd) } else { 0.0 };
    let real = 1.0 - false_alarm.min(1.0);
    // A fitted spot may be higher than any pixel.
    let main = 0.5 + 0.5 * (height / highest).min(1.0);
    let near = 1.0 - (-0.5 * (GATE_M / sd_m).powi(2)).exp();
    real * main * near
}

/// The probability that a standard normal variable exceeds `z >= 0`: `exp(-z^2 / 2) / 2` times a rational function
/// (Abramowitz and Stegun 1964, 26.2.17, absolute error below 7.5e-8).
fn normal_tail(z: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let polynomial = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let sum = polynomial.iter().rev().fold(0.0, |sum, coefficient| (sum + coefficient) * t);
    (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt() * sum
}

/// Two centres of a contact in its image: of the area where the image exceeds half of the contact's peak, and of the
/// image itself near the contact (its centre of pressure); m. Both are its position if it has no pixels.
///
/// The pixels within three radii of a disk of its area are used: those below zero for a contact whose change of
/// conductance is not `positive`, that of a positive image.
pub fn centres(image: &Image, contact: &Contact, positive: ConductanceChange) -> [Point3; 2] {
    let space = &image.space;
    let sign = if contact.conductance.is_some_and(|change| change != positive) { -1.0 } else { 1.0 };
    let height = |pixel: usize| sign * image.values[pixel];
    let reach_m = 3.0 * (contact.area_m2 / std::f64::consts::PI).sqrt() + 2.0 * space.half_pixel_m();
    let near = |pixel: &usize| space.surface.distance_m(space.centres_m[*pixel], contact.position_m) <= reach_m;
    let around = space.near(contact.position_m, reach_m);
    let pixels: Vec<usize> = around.filter(|&pixel| height(pixel) > 0.0).filter(near).collect();
    let peak = pixels.iter().map(|&pixel| height(pixel)).fold(0.0, f64::max);
    if peak <= 0.0 {
        return [contact.position_m; 2];
    }
    let middle = |weight: &dyn Fn(usize) -> f64| {
        let weights = pixels.iter().map(|&pixel| (space.centres_m[pixel], weight(pixel) * space.areas[pixel]));
        let mean = space.surface.weighted_mean(contact.position_m, weights);
        place_on_surface(image, &pixels, mean).0
    };
    let upper = |pixel: usize| f64::from(height(pixel) > 0.5 * peak);
    [middle(&upper), middle(&height)]
}
