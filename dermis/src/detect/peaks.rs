//! Separate peaks of an image: a watershed from the highest pixel down.

use crate::image::Image;

/// One peak and the pixels of its basin.
#[derive(Debug, Clone)]
pub(super) struct Basin {
    /// The highest pixel.
    pub peak: usize,
    /// Its value.
    pub height: f64,
    /// Its pixels of positive value, the highest first.
    pub pixels: Vec<usize>,
}

/// The positive peaks of an image, the highest first.
///
/// Pixels are visited from the highest down. A pixel without a visited neighbour starts a basin; any other joins the
/// basin of its highest neighbour. Where two basins meet, at the saddle, the lower one is merged into the other unless
/// it is prominent: its peak times `saddle_fraction` and its peak less `least_prominence` must both exceed the saddle.
pub(super) fn basins(image: &Image, saddle_fraction: f64, least_prominence: impl Fn(usize) -> f64) -> Vec<Basin> {
    let values = &image.values;
    let mut order: Vec<usize> = (0..values.len()).filter(|&p| values[p].is_finite() && values[p] > 0.0).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    let mut basin_of: Vec<Option<usize>> = vec![None; values.len()];
    // The basin into which each was merged (itself if not merged); the peak of each.
    let (mut into, mut peak): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    let stands = |into: &[usize], mut basin: usize| {
        while into[basin] != basin {
            basin = into[basin];
        }
        basin
    };
    for &pixel in &order {
        let mut around: Vec<usize> = (image.space.neighbours[pixel].iter())
            .filter_map(|&other| basin_of[other])
            .map(|basin| stands(&into, basin))
            .collect();
        // Basins are numbered from the highest down, so the others are merged into the first.
        around.sort_unstable();
        around.dedup();
        let Some(&highest) = around.first() else {
            basin_of[pixel] = Some(into.len());
            into.push(into.len());
            peak.push(pixel);
            continue;
        };
        for &lower in &around[1..] {
            let top = values[peak[lower]];
            if values[pixel] >= (saddle_fraction * top).min(top - least_prominence(peak[lower])) {
                into[lower] = highest;
            }
        }
        let best = (image.space.neighbours[pixel].iter().copied())
            .filter(|&other| basin_of[other].is_some())
            .max_by(|&a, &b| values[a].total_cmp(&values[b]).then(b.cmp(&a)))
            .expect("a basin is around");
        basin_of[pixel] = basin_of[best];
    }
    let mut found: Vec<Basin> =
        peak.iter().map(|&peak| Basin { peak, height: values[peak], pixels: Vec::new() }).collect();
    for &pixel in &order {
        let basin = stands(&into, basin_of[pixel].expect("every positive pixel was visited"));
        found[basin].pixels.push(pixel);
    }
    found.retain(|basin| !basin.pixels.is_empty());
    found
}
