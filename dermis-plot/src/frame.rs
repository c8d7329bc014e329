//! The frame of a picture: title, axes with ticks, colour bar, legend.

use crate::colour::{BLACK, FAINT, INK, WHITE};
use crate::scene::{Key, Mark};
use crate::svg::{Anchor, Picture, Place, Style, Text, text_width};

/// Size of ordinary text, pixels.
pub(crate) const TEXT_SIZE: f64 = 13.0;
/// Size of titles, pixels.
pub(crate) const TITLE_SIZE: f64 = 16.0;
/// Width of a colour bar with its numbers and label, pixels.
pub(crate) const KEY_WIDTH: f64 = 100.0;

/// About `wanted` round numbers that cover a range.
pub(crate) fn ticks(low: f64, high: f64, wanted: usize) -> Vec<f64> {
    let rough = (high - low) / wanted.max(1) as f64;
    if !(rough > 0.0 && rough.is_finite()) {
        return Vec::new();
    }
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * power).find(|&step| step >= rough * 0.999);
    let step = step.unwrap_or(10.0 * power);
    // A tolerance of a thousandth of a step for rounding errors at the limits.
    let first = (low / step - 1e-3).ceil() as i64;
    let last = (high / step + 1e-3).floor() as i64;
    (first..=last).map(|index| index as f64 * step).collect()
}

/// The numbers of an axis, all with the decimals that the finest needs.
pub(crate) fn tick_labels(values: &[f64]) -> Vec<String> {
    let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let decimals = if step.is_finite() { (-(step * 1.001).log10().floor()).max(0.0) as usize } else { 0 };
    let largest = values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
    let text = |&value: &f64| {
        let text = if largest != 0.0 && (largest >= 1e5 || decimals > 4) {
            format!("{value:.1e}")
        } else {
            format!("{value:.decimals$}")
        };
        text.replace('-', "\u{2212}")
    };
    values.iter().map(text).collect()
}

/// Draws the title and its second line; returns their height.
pub(crate) fn title(picture: &mut Picture, title: &str, subtitle: &str) -> f64 {
    let mut y = 8.0;
    let width = picture.width;
    let fit = |text: &str, size: f64| size.min(size * (width - 24.0) / text_width(text, size).max(1.0));
    let (title_size, subtitle_size) = (fit(title, TITLE_SIZE), fit(subtitle, TEXT_SIZE));
    if !title.is_empty() {
        y += TITLE_SIZE;
        picture.text([12.0, y], title, Text::new(title_size, Anchor::Start).coloured(BLACK));
        y += 6.0;
    }
    if !subtitle.is_empty() {
        y += TEXT_SIZE;
        picture.text([12.0, y], subtitle, Text::new(subtitle_size, Anchor::Start).coloured([95, 100, 110]));
        y += 6.0;
    }
    y + 4.0
}

/// Height of [`title`] before anything is drawn.
pub(crate) fn title_height(title: &str, subtitle: &str) -> f64 {
    let line = |text: &str, size: f64| if text.is_empty() { 0.0 } else { size + 6.0 };
    12.0 + line(title, TITLE_SIZE) + line(subtitle, TEXT_SIZE)
}

/// A colour bar with its numbers on the right, followed by its label.
pub(crate) fn colour_bar(picture: &mut Picture, [x, y]: Place, height: f64, key: &Key) {
    const STEPS: usize = 128;
    const WIDTH: f64 = 16.0;
    let (low, high) = (key.scale.low, key.scale.high);
    let step = height / STEPS as f64;
    for index in 0..STEPS {
        let value = high - (high - low) * (index as f64 + 0.5) / STEPS as f64;
        let top = y + index as f64 * step;
        // Half a pixel of overlap hides the gaps between the strips.
        let bottom = (top + step + 0.5).min(y + height);
        let strip = [[x, top], [x + WIDTH, top], [x + WIDTH, bottom], [x, bottom]];
        picture.polygon(&strip, Style::fill(key.scale.colour(value)));
    }
    let frame = [[x, y], [x + WIDTH, y], [x + WIDTH, y + height], [x, y + height]];
    picture.polygon(&frame, Style::line(INK, 1.0));
    let values = ticks(low, high, (height / 60.0) as usize);
    let labels = tick_labels(&values);
    let mut widest = 0.0f64;
    for (value, label) in values.iter().zip(&labels) {
        let at = y + height * (high - value) / (high - low);
        picture.line(&[[x + WIDTH, at], [x + WIDTH + 5.0, at]], Style::line(INK, 1.0));
        picture.text([x + WIDTH + 8.0, at + 4.5], label, Text::new(12.0, Anchor::Start));
        widest = widest.max(text_width(label, 12.0));
    }
    let label_size = TEXT_SIZE.min(TEXT_SIZE * height / text_width(&key.label, TEXT_SIZE));
    let place = [x + WIDTH + 8.0 + widest + 18.0, y + height / 2.0];
    picture.text(place, &key.label, Text::new(label_size, Anchor::Middle).upwards());
}

/// Height of a legend of a given width, and the position of each entry.
fn legend_places(legend: &[(Mark, String)], width: f64) -> (f64, Vec<Place>) {
    let mut places = Vec::with_capacity(legend.len());
    let [mut x, mut y] = [0.0, 0.0];
    for (_, text) in legend {
        let entry = 26.0 + text_width(text, TEXT_SIZE) + 14.0;
        if x > 0.0 && x + entry > width {
            x = 0.0;
            y += 22.0;
        }
        places.push([x, y]);
        x += entry;
    }
    (if legend.is_empty() { 0.0 } else { y + 22.0 }, places)
}

/// Height of [`legend`].
pub(crate) fn legend_height(entries: &[(Mark, String)], width: f64) -> f64 {
    legend_places(entries, width).0
}

/// The legend of the marks, in as many rows as needed.
pub(crate) fn legend(picture: &mut Picture, [x, y]: Place, width: f64, entries: &[(Mark, String)]) {
    let (_, places) = legend_places(entries, width);
    for ((mark, text), [dx, dy]) in entries.iter().zip(places) {
        let centre = [x + dx + 9.0, y + dy + 10.0];
        draw_mark(picture, centre, 5.0, *mark);
        picture.text([x + dx + 22.0, y + dy + 14.5], text, Text::new(TEXT_SIZE, Anchor::Start));
    }
}

/// Draws a mark.
pub(crate) fn draw_mark(picture: &mut Picture, [x, y]: Place, radius: f64, mark: Mark) {
    match mark {
        Mark::Disc(colour, false) => picture.circle([x, y], radius, Style::fill(colour)),
        Mark::Disc(colour, true) => picture.circle([x, y], radius, Style::fill(colour).outlined(INK, 1.0)),
        Mark::OutlinedDisc(colour) => picture.circle([x, y], radius, Style::fill(colour).outlined(WHITE, 1.2)),
        Mark::Cross(colour) => {
            for style in [Style::line(WHITE, 4.4), Style::line(colour, 1.8)] {
                picture.line(&[[x - radius, y], [x + radius, y]], style);
                picture.line(&[[x, y - radius], [x, y + radius]], style);
            }
        }
        Mark::Diamond(colour) => {
            let corners = [[x, y - radius], [x + radius, y], [x, y + radius], [x - radius, y]];
            picture.polygon(&corners, Style::fill(colour).outlined(WHITE, 1.0));
        }
        Mark::Ring(colour) => picture.circle([x, y], radius, Style::line(colour, 1.4)),
        Mark::Line(colour) => picture.line(&[[x - 8.0, y], [x + 8.0, y]], Style::line(colour, 1.4)),
    }
}

/// An axis below or left of a plot: ticks with numbers, and a label with its unit.
pub(crate) struct Axis<'a> {
    /// Limits of the axis, the larger one first on a linear axis that counts backwards; their common logarithms on a
    /// logarithmic axis.
    pub range: [f64; 2],
    /// Whether the axis is logarithmic.
    pub logarithmic: bool,
    /// The label, with its unit.
    pub label: &'a str,
    /// Approximate number of ticks.
    pub wanted: usize,
}

impl Axis<'_> {
    /// Positions of the ticks, as fractions of the axis, with their numbers; a minor tick has no number.
    fn ticks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.range;
        let (values, labels) = if self.logarithmic {
            log_ticks(low, high)
        } else {
            let values = ticks(low.min(high), low.max(high), self.wanted);
            let labels = tick_labels(&values);
            (values, labels)
        };
        values.iter().map(|value| (value - low) / (high - low)).zip(labels).collect()
    }
}

/// Ticks of a logarithmic axis between two common logarithms: their logarithms and their numbers. Decades have numbers;
/// 2 and 5 times a decade have numbers too if the range contains fewer than two decades.
fn log_ticks(low: f64, high: f64) -> (Vec<f64>, Vec<String>) {
    let powers = low.floor() as i32..=high.ceil() as i32;
    let inside = |value: f64| (low - 1e-9..=high + 1e-9).contains(&value);
    let decades = powers.clone().filter(|&power| inside(f64::from(power))).count();
    let digits = powers.flat_map(|power| (1..10).map(move |digit| (digit, power)));
    let place = |(digit, power): (i32, i32)| f64::from(digit).log10() + f64::from(power);
    let numbered = |digit: i32| digit == 1 || decades < 2 && (digit == 2 || digit == 5);
    let label = |(digit, power): (i32, i32)| match power {
        _ if !numbered(digit) => String::new(),
        0..=4 => format!("{digit}{}", "0".repeat(power as usize)),
        -3..0 => format!("0.{}{digit}", "0".repeat(-power as usize - 1)),
        _ => format!("{digit}e{power}").replace('-', "\u{2212}"),
    };
    digits.filter(|&tick| inside(place(tick))).map(|tick| (place(tick), label(tick))).unzip()
}

/// Length of a tick, pixels: ticks without a number are shorter.
fn tick_length(label: &str) -> f64 {
    if label.is_empty() { 3.0 } else { 5.0 }
}

/// The axis below a plot whose lower left corner is given.
pub(crate) fn axis_below(picture: &mut Picture, [x, y]: Place, width: f64, axis: &Axis<'_>) {
    for (part, label) in axis.ticks() {
        let at = x + width * part;
        picture.line(&[[at, y], [at, y + tick_length(&label)]], Style::line(INK, 1.0));
        picture.text([at, y + 19.0], &label, Text::new(12.0, Anchor::Middle));
    }
    picture.text([x + width / 2.0, y + 38.0], axis.label, Text::new(TEXT_SIZE, Anchor::Middle));
}

/// The axis left of a plot whose lower left corner is given.
pub(crate) fn axis_left(picture: &mut Picture, [x, y]: Place, height: f64, axis: &Axis<'_>) {
    for (part, label) in axis.ticks() {
        let at = y - height * part;
        picture.line(&[[x - tick_length(&label), at], [x, at]], Style::line(INK, 1.0));
        picture.text([x - 8.0, at + 4.5], &label, Text::new(12.0, Anchor::End));
    }
    picture.text([x - 46.0, y - height / 2.0], axis.label, Text::new(TEXT_SIZE, Anchor::Middle).upwards());
}

/// The frame of a plot.
pub(crate) fn border(picture: &mut Picture, [x, y]: Place, width: f64, height: f64) {
    let corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
    picture.polygon(&corners, Style::line(FAINT, 1.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 314.2, 6), vec![0.0, 100.0, 200.0, 300.0]);
        assert_eq!(tick_labels(&ticks(-0.02, 0.021, 5)), vec!["\u{2212}0.02", "\u{2212}0.01", "0.00", "0.01", "0.02"]);
        assert_eq!(tick_labels(&ticks(0.0, 300.0, 6)), vec!["0", "50", "100", "150", "200", "250", "300"]);
        assert!(ticks(1.0, 1.0, 5).is_empty());
    }

    #[test]
    fn a_logarithmic_axis_has_decades_and_between_two_of_them_multiples() {
        let numbers = |low: f64, high: f64| {
            let labels: Vec<String> = log_ticks(low.log10(), high.log10()).1;
            labels.into_iter().filter(|label| !label.is_empty()).collect::<Vec<_>>()
        };
        assert_eq!(numbers(0.5, 200.0), ["1", "10", "100"]);
        assert_eq!(numbers(3e-5, 0.02), ["1e\u{2212}4", "0.001", "0.01"]);
        assert_eq!(numbers(1.5, 12.0), ["2", "5", "10"]);
        assert_eq!(log_ticks(0.0, 1.0).0.len(), 10, "every digit has a tick");
    }

    #[test]
    fn a_legend_wraps_into_rows_that_fit() {
        let entries: Vec<_> = (0..6).map(|i| (Mark::Line(INK), format!("entry number {i}"))).collect();
        assert_eq!(legend_height(&entries, 1e4), 22.0);
        assert!(legend_height(&entries, 300.0) > 60.0);
        assert_eq!(legend_height(&[], 300.0), 0.0);
    }
}
