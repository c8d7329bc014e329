//! Processing time of a frame of the paper's skin on the pipeline thread, untouched, with one touch and with four, at full
//! speed and at 120 frames per second: `frame_cost [METHOD]`.

use dermis::pipeline::Settings;
use dermis_emulate::emulator::Stroke;
use std::time::{Duration, Instant};

#[path = "../tests/rows/bench.rs"]
#[allow(dead_code)]
mod bench;

use bench::{Bench, lab, place, stroke};

/// Frames of each case.
const FRAMES: u64 = 600;

fn main() {
    let method = std::env::args().nth(1).unwrap_or_default();
    let four = [(0.05, 10.0), (0.12, 100.0), (0.2, 190.0), (0.26, 300.0)];
    let four: Vec<Stroke> = four.map(|(z_m, theta)| stroke(0.9, 60.0, place(z_m, theta), None, 2.0)).to_vec();
    for pause in [Duration::ZERO, Duration::from_micros(8333)] {
        println!("{} us between frames", pause.as_micros());
        for touches in [&four[..0], &four[..1], &four] {
            let settings = Settings { method: method.clone(), ..Settings::default() };
            let mut bench = Bench::new(lab(), 1, touches.to_vec(), settings);
            bench.rebuild();
            let first = bench.next;
            let packets: Vec<Vec<u8>> =
                (first..first + FRAMES).map(|index| bench.emulator.frame_packet(index).expect("a frame")).collect();
            let (mut times_us, mut contacts) = (Vec::new(), 0);
            for (index, packet) in (first..).zip(&packets) {
                std::thread::sleep(pause);
                let begun = Instant::now();
                let incoming = bench.receive(packet, index).pop().expect("a whole frame");
                contacts = bench.pipeline.process(incoming.input).expect("contacts").contacts.len();
                times_us.push(begun.elapsed().as_secs_f64() * 1e6);
            }
            times_us.sort_by(f64::total_cmp);
            let at = |part: f64| times_us[((times_us.len() - 1) as f64 * part) as usize];
            println!(
                "  {contacts} contacts: median {:.0} us, 99 % within {:.0} us, longest {:.0} us",
                at(0.5),
                at(0.99),
                at(1.0)
            );
        }
    }
}
