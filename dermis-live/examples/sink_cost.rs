//! Time to record and to publish a frame of `cylinder30`, on the thread of the sink: `sink_cost [DESIGN] [FRAMES]`.

use dermis_live::LiveFrame;
use dermis_live::recording::{Recorder, Session};
use std::time::{Duration, Instant};

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let design = arguments.next().unwrap_or_else(|| "cylinder30".into());
    let count: u64 = arguments.next().map_or(Ok(6_000), |text| text.parse())?;
    let skin = synthetic::SyntheticSkin::shipped(&design);
    let frames: Vec<LiveFrame> = (0..count).map(|index| skin.frame(index)).collect();
    let values = frames[0].result.values_ohm.len();
    println!(
        "{design}: {values} values, {} pixels, {count} frames, two contacts in most",
        frames[0].result.image.len()
    );

    let folder = tempfile::tempdir()?;
    let path = folder.path().join("cost.mcap");
    let mut recorder = Recorder::create(&path, skin.reference.clone(), &Session::default())?;
    tell("recording", Duration::ZERO, &frames, |frame| Ok(recorder.frame(frame)?))?;
    recorder.finish()?;
    println!("  {:.1} kB a frame", std::fs::metadata(&path)?.len() as f64 * 1e-3 / count as f64);

    #[cfg(feature = "ros2")]
    {
        use dermis_live::sinks::ros2::dds::{Publisher, PublisherOptions};
        let options = PublisherOptions { domain: Some(99), ..PublisherOptions::default() };
        let mut publisher = Publisher::new(skin.reference.clone(), &options)?;
        // At the live rate, so that the thread of the middleware can keep up.
        let pause = Duration::from_secs(1) / synthetic::RATE as u32;
        tell("publishing", pause, &frames[..frames.len().min(600)], |frame| Ok(publisher.frame(frame)?))?;
    }
    Ok(())
}

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Prints the mean, the median, the 99th percentile and the maximum time of `sink`; the pause before each frame is not
/// counted.
fn tell(what: &str, pause: Duration, frames: &[LiveFrame], mut sink: impl FnMut(&LiveFrame) -> Outcome) -> Outcome {
    let mut times_us = Vec::with_capacity(frames.len());
    for frame in frames {
        std::thread::sleep(pause);
        let begun = Instant::now();
        sink(frame)?;
        times_us.push(begun.elapsed().as_secs_f64() * 1e6);
    }
    let mean = times_us.iter().sum::<f64>() / times_us.len() as f64;
    times_us.sort_by(f64::total_cmp);
    let at = |part: f64| times_us[((times_us.len() - 1) as f64 * part) as usize];
    println!(
        "{what}: mean {mean:.1} us a frame, median {:.1} us, 99 % below {:.1} us, longest {:.1} us",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}
