//! Small diagrams that show no skin.

use crate::picture::colour::{Colour, INK};
use crate::picture::frame::{self, Axis};
use crate::picture::svg::{Anchor, Picture, Style, Text, text_width};

const WIDTH: f64 = 470.0;
const HEIGHT: f64 = 230.0;
const LEFT: f64 = 66.0;
const BELOW: f64 = 52.0;
const BARS: Colour = [66, 113, 158];

/// How often values fall into even steps, with vertical lines that mark numbers of interest.
pub struct Histogram<'a> {
    /// What the picture shows.
    pub title: &'a str,
    /// What the values are, with their unit.
    pub label: &'a str,
    /// The values.
    pub values: &'a [f64],
    /// Width of a step.
    pub step: f64,
    /// Marked numbers and their names.
    pub marks: Vec<(f64, String)>,
}

impl Histogram<'_> {
    /// The picture. Values beyond the largest 99.5th percentile or mark stand in the last step.
    pub fn draw(&self) -> Picture {
        let steps = self.step_count();
        let mut counts = vec![0usize; steps];
        for &value in self.values.iter().filter(|value| value.is_finite()) {
            counts[((value / self.step).max(0.0) as usize).min(steps - 1)] += 1;
        }
        let highest = counts.iter().copied().max().unwrap_or(0).max(1) as f64 * 1.12;
        let top = frame::title_height(self.title, "");
        let mut picture = Picture::new(LEFT + WIDTH + 24.0, top + HEIGHT + BELOW);
        frame::title(&mut picture, self.title, "");
        let x = |value: f64| LEFT + WIDTH * value / (steps as f64 * self.step);
        let y = |count: f64| top + HEIGHT * (1.0 - count / highest);
        for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let (from, to) = (x(index as f64 * self.step) + 0.5, x((index + 1) as f64 * self.step) - 0.5);
            let bar = [[from, y(0.0)], [to, y(0.0)], [to, y(count as f64)], [from, y(count as f64)]];
            picture.polygon(&bar, Style::fill(BARS));
        }
        for (index, (value, name)) in self.marks.iter().enumerate() {
            let at = x(*value);
            picture.line(&[[at, top], [at, y(0.0)]], Style::line(INK, 1.2).dashed(4.0));
            // Names one below the other cannot overlap.
            let y = top + 15.0 + 17.0 * index as f64;
            let fits = at + 10.0 + text_width(name, 12.0) < LEFT + WIDTH;
            let (x, anchor) = if fits { (at + 5.0, Anchor::Start) } else { (at - 5.0, Anchor::End) };
            picture.text([x, y], name, Text::new(12.0, anchor).rimmed());
        }
        frame::border(&mut picture, [LEFT, top], WIDTH, HEIGHT);
        let below = Axis { range: [0.0, steps as f64 * self.step], label: self.label, wanted: 8 };
        frame::axis_below(&mut picture, [LEFT, top + HEIGHT], WIDTH, &below);
        let left = Axis { range: [0.0, highest], label: "presses", wanted: 5 };
        frame::axis_left(&mut picture, [LEFT, top + HEIGHT], HEIGHT, &left);
        picture
    }

    fn step_count(&self) -> usize {
        let mut sorted: Vec<f64> = self.values.iter().copied().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let nearly_all = sorted.get((sorted.len() as f64 * 0.995) as usize).or(sorted.last()).copied().unwrap_or(0.0);
        let marked = self.marks.iter().map(|(value, _)| *value).fold(0.0, f64::max);
        (nearly_all.max(1.3 * marked) / self.step) as usize + 1
    }
}
