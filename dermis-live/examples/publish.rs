//! Publishes frames of a pressed skin over DDS: `publish SECONDS [DOMAIN] [NAMESPACE]`.

use dermis_live::sinks::ros2::dds::{Publisher, PublisherOptions};
use std::time::{Duration, Instant};

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().ok_or("publish SECONDS [DOMAIN] [NAMESPACE]")?.parse()?;
    let domain = arguments.next().map(|text| text.parse()).transpose()?;
    let namespace = arguments.next().unwrap_or_default();
    let skin = synthetic::SyntheticSkin::shipped("skin16");
    let mut publisher =
        Publisher::new(skin.reference.clone(), &PublisherOptions { domain, namespace, frame_id: None })?;
    let begun = Instant::now();
    let mut index = 0;
    while begun.elapsed().as_secs_f64() < seconds {
        publisher.frame(&skin.frame(index))?;
        index += 1;
        std::thread::sleep(Duration::from_secs(1) / synthetic::RATE as u32);
    }
    println!("{index} frames, {} messages dropped", publisher.dropped());
    Ok(())
}
