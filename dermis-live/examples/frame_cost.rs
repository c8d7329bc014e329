//! What a frame of the paper's skin costs on the thread that makes contacts, touched at four places:
//! `frame_cost [METHOD] [FRAMES]`.

use dermis::design::SkinDesign;
use dermis::twin::TwinOptions;
use dermis_live::device::Stream;
use dermis_live::emulator::{Emulator, EmulatorOptions, Script};
use dermis_live::{Incoming, LiveSkin, Moment, Processor, Settings};
use dermis_wire::{Decoder, Received, ToHost};
use std::sync::Arc;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let method = arguments.next().unwrap_or_default();
    let count: u64 = arguments.next().map_or(Ok(960), |text| text.parse())?;
    let design = SkinDesign::shipped("cylinder30").expect("it is shipped");
    let skin = Arc::new(LiveSkin::new(SkinDesign::shipped_text("cylinder30").unwrap(), "cylinder30", None)?);
    let options = EmulatorOptions {
        twin: TwinOptions::shipped("lab").expect("it is shipped"),
        seed: 1,
        script: Script::load("four", &design, &TwinOptions::load("lab")?, 1)?,
        faults: Vec::new(),
        speed: 1.0,
        prerendered: 0,
        unpaced: true,
    };
    let emulator = Emulator::new(&design, options)?;
    let frames = (0..count).map(|index| emulator.frame_packet(index)).collect::<Result<Vec<Vec<u8>>, _>>()?;
    for pause in [Duration::ZERO, Duration::from_micros(8333)] {
        let mut processor =
            Processor::new(Arc::clone(&skin), Settings { method: method.clone(), ..Settings::default() })?;
        let (mut stream, mut decoder) = (Stream::default(), Decoder::new(vec![0; 1 << 16]));
        decoder.feed(&emulator.hello_packet(120_000), |received| {
            if let Received::Message(message) = received
                && let Ok(ToHost::Hello(hello)) = ToHost::parse(message)
            {
                stream.hello(&hello, &skin);
            }
        });
        let mut times_us: [Vec<f64>; 5] = Default::default();
        for (index, packet) in frames.iter().enumerate() {
            std::thread::sleep(pause);
            let begun = Instant::now();
            let at = Moment { unix_ns: 1_800_000_000_000_000_000 + index as u64 * 8_333_333 };
            let mut incoming: Option<Incoming> = None;
            decoder.feed(packet, |received| {
                if let Received::Message(message) = received
                    && let Ok(ToHost::Frame(frame)) = ToHost::parse(message)
                {
                    incoming = stream.frame(&frame, message, at);
                }
            });
            let frame = processor.process(incoming.ok_or("no frame")?)?;
            if index > 100 {
                times_us[frame.contacts.len().min(4)].push(begun.elapsed().as_secs_f64() * 1e6);
            }
        }
        println!("{} us between frames", pause.as_micros());
        for (contacts, times_us) in times_us.iter_mut().enumerate().filter(|(_, times)| !times.is_empty()) {
            times_us.sort_by(f64::total_cmp);
            let at = |part: f64| times_us[((times_us.len() - 1) as f64 * part) as usize];
            println!(
                "  {contacts} contacts, {:>4} frames: median {:>6.1} us, 99 % within {:>6.1} us, longest {:>7.1} us",
                times_us.len(),
                at(0.5),
                at(0.99),
                at(1.0)
            );
        }
    }
    Ok(())
}
