//! The wire channels of a base, where they run into one another as one groove, and the wires that they hold.

use crate::model::Fabrication;
use crate::outline::Outline;
use crate::solid;
use dermis::geom::Chart;

/// Channels whose places differ by less are one line, m: rounding of the layouts.
const ROUNDING_M: f64 = 1e-9;

/// A groove of one or more channels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Groove {
    /// Its outline on the unrolled base, before it is cut at the base's edge.
    pub(crate) outline: Outline,
    /// The electrodes whose wires it holds.
    pub(crate) electrodes: Vec<usize>,
    /// The least distance of two of its channels that are not one line, m; `None` if all are.
    pub(crate) overlapping_m: Option<f64>,
}

/// A channel: its middle, the height to which it goes up, and the electrode.
type Channel = (f64, f64, usize);

/// The grooves of a base that unrolls, from the lower edge of an outline up to the bores.
pub(crate) fn grooves(fabrication: &Fabrication, chart: &Chart, low_m: f64) -> Vec<Groove> {
    if fabrication.options.channel_depth_m == 0.0 {
        return Vec::new();
    }
    let half_m = 0.5 * fabrication.options.channel_width_m;
    let places = |one: &crate::model::FabricatedElectrode| {
        let number = one.number;
        let at = chart.copies_within(chart.unroll(one.bore.centre_m), half_m);
        at.map(move |[s, t]| (s, t, number)).collect::<Vec<_>>()
    };
    let mut channels: Vec<Channel> = fabrication.electrodes.iter().flat_map(places).collect();
    channels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let meet = |a: &Channel, b: &Channel| b.0 - a.0 < 2.0 * half_m - ROUNDING_M;
    channels.chunk_by(meet).map(|channels| groove(channels, half_m, low_m)).collect()
}

/// The groove of channels that overlap, in the order of their places.
fn groove(channels: &[Channel], half_m: f64, low_m: f64) -> Groove {
    let steps = channels.windows(2).map(|pair| pair[1].0 - pair[0].0).filter(|step| *step > ROUNDING_M);
    let mut electrodes: Vec<usize> = channels.iter().map(|&(_, _, electrode)| electrode).collect();
    electrodes.sort_unstable();
    Groove { outline: skyline(channels, half_m, low_m), electrodes, overlapping_m: steps.reduce(f64::min) }
}

/// The union of bands that stand on a line.
fn skyline(channels: &[Channel], half_m: f64, low_m: f64) -> Outline {
    let mut edges: Vec<f64> = channels.iter().flat_map(|&(s, _, _)| [s - half_m, s + half_m]).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup_by(|a, b| (*a - *b).abs() < ROUNDING_M);
    let height = |middle: f64| {
        let over = channels.iter().filter(|(s, _, _)| (s - middle).abs() < half_m);
        over.map(|&(_, t, _)| t).fold(low_m, f64::max)
    };
    let mut corners = vec![[edges[0], low_m], [edges[edges.len() - 1], low_m]];
    for pair in edges.windows(2).rev() {
        let top = height(0.5 * (pair[0] + pair[1]));
        corners.extend([[pair[1], top], [pair[0], top]]);
    }
    corners.dedup();
    Outline::Polygon(corners)
}

/// Share of a channel's room that wires may fill: they do not lie straight, and insulation is thicker by up to a tenth than
/// its data sheet says.
const FILLED: f64 = 0.8;

/// The largest outer diameter that wires in the channels can have, m, and how many lie in one; `None` without channels.
///
/// They lie beside one another, and pass below the joints of the pins, which take half of the depth.
pub(crate) fn wires(fabrication: &Fabrication) -> Option<(f64, usize)> {
    let options = &fabrication.options;
    if options.channel_depth_m == 0.0 {
        return None;
    }
    let counted: Vec<(f64, usize)> = match &fabrication.chart {
        Some(chart) => {
            let of = |groove: Groove| {
                let [[left, _], [right, _]] = groove.outline.bounds_m();
                (right - left, groove.electrodes.len())
            };
            grooves(fabrication, chart, 0.0).into_iter().map(of).collect()
        }
        None => vec![(options.channel_width_m, solid::most_wires(fabrication)?)],
    };
    let most = counted.iter().map(|(_, count)| *count).max()?;
    let deep_m = if most > 1 { 0.5 * options.channel_depth_m } else { options.channel_depth_m };
    let beside_m = counted.iter().map(|&(wide_m, count)| wide_m / count as f64).fold(f64::INFINITY, f64::min);
    Some((FILLED * deep_m.min(beside_m), most))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;

    fn made(name: &str, change: (&str, &str)) -> Fabrication {
        let text = SkinDesign::shipped_text(name).unwrap();
        assert!(text.contains(change.0));
        Fabrication::new(&SkinDesign::parse(&text.replace(change.0, change.1), "test.toml").unwrap()).unwrap()
    }

    fn of(made: &Fabrication) -> Vec<Groove> {
        grooves(made, made.chart.as_ref().unwrap(), -0.04)
    }

    /// With the bores on a radius of 38 mm the channels of electrodes 1 and 15 are one line, 38 mm (1 - cos 22.5 degrees)
    /// = 2.89 mm beside that of electrode 0.
    #[test]
    fn channels_that_overlap_are_one_groove_without_overlap() {
        let disk = made("skin16", ("bore_m = 0.002", "bore_m = 0.002"));
        let found = of(&disk);
        let last = found.last().unwrap();
        assert_eq!(last.electrodes, [0, 1, 15]);
        let apart_m = 0.038 * (1.0 - (std::f64::consts::PI / 8.0).cos());
        assert!((last.overlapping_m.unwrap() - apart_m).abs() < 1e-9, "{last:?}");
        for pair in found.windows(2) {
            assert!(pair[0].outline.bounds_m()[1][0] <= pair[1].outline.bounds_m()[0][0], "{pair:?}");
        }
        let all: usize = found.iter().map(|groove| groove.electrodes.len()).sum();
        assert_eq!(all, 16);
        let narrow = made("skin16", ("bore_m = 0.002", "bore_m = 0.002\nchannel_width_m = 0.0025"));
        assert!(of(&narrow).iter().all(|groove| groove.overlapping_m.is_none()));
    }

    /// Two bands of 3 mm, 2 mm apart: 2 mm are 20 mm high, 3 mm 30 mm.
    #[test]
    fn a_skyline_is_the_union_of_its_bands() {
        let outline = skyline(&[(0.0, 0.020, 0), (0.002, 0.030, 1)], 0.0015, 0.0);
        assert!((1e6 * outline.area_m2() - (2.0 * 20.0 + 3.0 * 30.0)).abs() < 1e-6, "{outline:?}");
    }

    /// Three rings share a line on the paper's skin: three wires beside one another in four fifths of 3 mm.
    #[test]
    fn wires_fit_beside_one_another() {
        let whole = made("cylinder30", ("wall_m", "wall_m"));
        let (wide_m, most) = wires(&whole).unwrap();
        assert!((wide_m - 0.0008).abs() < 1e-12 && most == 3, "{wide_m} {most}");
        let narrow = made("cylinder30", ("channel_width_m = 0.003", "channel_width_m = 0.0015"));
        assert!((wires(&narrow).unwrap().0 - 0.0004).abs() < 1e-12);
        assert_eq!(wires(&made("cylinder30", ("channel_depth_m = 0.002", "channel_depth_m = 0.0"))), None);
    }
}
