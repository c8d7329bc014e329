//! Times of the reconstruction methods on images of 64 x 64 pixels: set-up, and one frame.
//!
//! `cylinder30` (870 channels) with two touches, simulated with noise at 50 dB; `tank16` (208 channels) with a frame of
//! the real tank. One thread; times are those of its processor on Linux, so that other programs hardly change them. Expected: the peak of every image of `cylinder30` is in a touch or at most a pixel beside it.
//! `cargo run --release -p dermis --example method_times`

use dermis::design::{ImageLayout, SkinDesign};
use dermis::frame::{Frame, read_frames};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::method::{MethodOptions, Methods};
use dermis::skin::Skin;
use dermis::stats::rms;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

const METHODS: [&str; 4] = ["noser", "laplace", "gauss-newton", "tv"];
const SIZE: usize = 64;
const RADIUS_M: f64 = 0.015;

/// The time that this thread has run; elsewhere than on Linux the time since the first call.
fn now() -> Duration {
    static FIRST: OnceLock<Instant> = OnceLock::new();
    let statistics = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let running_ns = statistics.and_then(|text| text.split_whitespace().next()?.parse().ok());
    running_ns.map_or_else(|| FIRST.get_or_init(Instant::now).elapsed(), Duration::from_nanos)
}

fn skin(name: &str) -> dermis::Result<Skin> {
    let design = SkinDesign::shipped(name).expect("a shipped design");
    Skin::new(SkinDesign { image: ImageLayout::Grid { rows: SIZE, columns: SIZE }, ..design })
}

/// The untouched frame and that of touches at some places, each a disc of twice the conductance.
fn touched_cylinder(skin: &Skin, places: &[Point3]) -> dermis::Result<[Frame; 2]> {
    let mut conductivity = skin.forward().rest_conductivity().to_vec();
    for (cell, value) in conductivity.iter_mut().enumerate() {
        let centre = skin.mesh().cell_centre(cell);
        if places.iter().any(|&place| distance(place, centre) < RADIUS_M) {
            *value *= 2.0;
        }
    }
    let untouched = skin.forward().solve(skin.forward().rest_conductivity())?;
    let mut touched = skin.forward().solve(&conductivity)?;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    // 50 dB below the frame; the sum of twelve uniform numbers has the variance 1.
    let noise_ohm = 10.0_f64.powf(-2.5) * rms(untouched.iter().copied());
    for value in &mut touched.0 {
        *value += noise_ohm * ((0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0);
    }
    Ok([untouched, touched])
}

/// The frames of the empty tank and of the tank with four objects.
fn tank(skin: &Skin) -> dermis::Result<[Frame; 2]> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-study/tank"));
    let read = |part: &str| -> dermis::Result<Frame> {
        let path = folder.join(format!("metal1_plastic5_plastic9_metal13_55uA_{part}.csv"));
        Ok(read_frames(&path, &skin.design().protocol)?.remove(0))
    };
    Ok([read("empty")?, read("objects")?])
}

fn times(skin: &Skin, [untouched, touched]: &[Frame; 2], places: &[Point3]) -> Result<(), Box<dyn std::error::Error>> {
    let difference = touched - untouched;
    for name in METHODS {
        let options = MethodOptions { baseline: Some(untouched.clone()), ..MethodOptions::default() };
        skin.linearised()?;
        let start = now();
        let method = Methods::linear().method(skin, name, &options)?;
        let set_up = now() - start;
        let start = now();
        let image = method.image(&difference)?;
        let frame = now() - start;
        let (channels, pixels) = (difference.len(), image.values.len());
        println!("| `{}` | {channels} x {pixels} | {name} | {set_up:.2?} | {frame:.2?} |", skin.design().name);
        let peak = image.peak().map(|(pixel, _)| image.space.centres_m[pixel]).expect("finite values");
        let off_m = places.iter().map(|&place| distance(place, peak)).fold(f64::INFINITY, f64::min);
        assert!(places.is_empty() || off_m < RADIUS_M + 2.0 * image.space.half_pixel_m(), "{name}: {off_m} m off");
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cylinder = skin("cylinder30")?;
    let places: [Point3; 2] = [SIZE * 20 + 10, SIZE * 40 + 45].map(|pixel| cylinder.pixels().centres_m[pixel]);
    times(&cylinder, &touched_cylinder(&cylinder, &places)?, &places)?;
    let tank16 = skin("tank16")?;
    times(&tank16, &tank(&tank16)?, &[])
}
