//! Frames of pressed skins, computed from their number alone, for tests that write, send and read them.
#![allow(dead_code, reason = "each test takes what it needs")]

use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::pipeline::{ElectrodeHealth, ElectrodeState, Health, PipelineFrame, Timestamp, TrackedContact, Validity};
use dermis_live::LiveFrame;
use dermis_live::sinks::ros2::Reference;
use std::sync::Arc;

/// Version on the card of a [`retrained`] network.
pub const RETRAINED: &str = "0.0.1-retrained";

/// A copy of the shipped network for `skin16` with another version on its card; returns its folder, in `folder`.
pub fn retrained(folder: &std::path::Path) -> String {
    let shipped = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-learn/models/skin16/shapes");
    let card = std::fs::read_to_string(shipped.join("card.json")).expect("its card");
    let another = card.replacen("\"version\": \"", &format!("\"version\": \"{RETRAINED} of "), 1);
    assert_ne!(another, card);
    let own = folder.join("own");
    std::fs::create_dir(&own).expect("a folder");
    std::fs::write(own.join("card.json"), another).expect("written");
    std::fs::copy(shipped.join("weights.safetensors"), own.join("weights.safetensors")).expect("copied");
    own.display().to_string()
}

/// Frames per second.
pub const RATE: u64 = 120;
/// Time of the first frame: 1 January 2026.
pub const BEGINNING: Timestamp = Timestamp { unix_ns: 1_767_225_600_000_000_000 };

/// A skin and its frames.
pub struct SyntheticSkin {
    pub design: SkinDesign,
    pub reference: Reference,
    health: Arc<Health>,
}

impl SyntheticSkin {
    /// A shipped skin.
    pub fn shipped(name: &str) -> Self {
        let design = SkinDesign::shipped(name).expect("a shipped design");
        let mesh = Mesh::generate(&design).expect("a mesh");
        let space = Arc::new(PixelSpace::for_design(&design, &mesh).expect("pixels"));
        let sound = ElectrodeHealth { state: ElectrodeState::Sound, contact_ohm: Some(120.0), noise: Some(1.0) };
        let electrodes = vec![sound; design.electrodes.len()];
        let health = Health { electrodes, noise: Some(1.0), rate_hz: RATE as f64, ..Health::default() };
        SyntheticSkin {
            reference: Reference { frame_id: "skin".into(), name: "dermis".into(), space },
            design,
            health: Arc::new(health),
        }
    }

    /// Frame `index`: two presses with varying force, the first of known force; some frames have none.
    pub fn frame(&self, index: u64) -> LiveFrame {
        let measured_at = BEGINNING.after(std::time::Duration::from_nanos(index * 1_000_000_000 / RATE));
        let pressing = index / 60 % 4 != 3;
        let contacts = if pressing { [7, 8].map(|id| self.contact(index, measured_at, id)).into() } else { Vec::new() };
        let channels = self.design.protocol.channel_count();
        let result = PipelineFrame {
            sequence: index,
            measured_at,
            values_ohm: (0..channels).map(|channel| 10.0 + noise(index, channel as u64)).collect(),
            image: (0..self.reference.space.len()).map(|pixel| noise(index, 1_000_000 + pixel as u64) as f32).collect(),
            validity: Validity::Ok,
            touched: Some(pressing),
            contacts,
            health: Arc::clone(&self.health),
        };
        LiveFrame {
            result,
            received_at: measured_at.after(std::time::Duration::from_micros(200)),
            output_at: measured_at.after(std::time::Duration::from_micros(300)),
            message: message(index, channels),
        }
    }

    fn contact(&self, index: u64, measured_at: Timestamp, id: u64) -> TrackedContact {
        let space = &self.reference.space;
        let pixel = (id as usize * 7919) % space.len();
        let strength = 1e-4 * (1.0 + (index as f64 * 0.1).sin());
        let force_n = if id == 7 { 2.5 } else { f64::NAN };
        TrackedContact {
            contact: Contact {
                id,
                strength,
                area_m2: 3e-4,
                force_sd_n: 0.1 * force_n,
                sd_m: 0.002,
                confidence: 0.95,
                ..Contact::truth(space.centres_m[pixel], space.normals[pixel], force_n)
            },
            centroid_m: space.centres_m[pixel],
            centre_of_pressure_m: space.centres_m[pixel],
            velocity_m_s: [0.01, 0.0, -0.02],
            seen: true,
            since: BEGINNING,
            age_s: measured_at.seconds_since(BEGINNING),
            zone: None,
        }
    }
}

/// A disk-shaped skin, and a frame with two contacts.
pub fn pressed() -> (Reference, LiveFrame) {
    let skin = SyntheticSkin::shipped("skin16");
    let frame = skin.frame(3);
    (skin.reference, frame)
}

/// A message of the device: a frame of four-byte readings.
fn message(index: u64, channels: usize) -> Vec<u8> {
    let readings: Vec<i32> = (0..channels).map(|channel| (1e6 * noise(index, channel as u64)) as i32).collect();
    let readings = dermis_wire::Readings::I32(&readings);
    let flags = dermis_wire::FrameFlags::default();
    let frame = dermis_wire::Frame { sequence: index as u32, time_us: index * 8333, flags, readings };
    let mut packet = vec![0; dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE)];
    let length = dermis_wire::ToHost::Frame(frame).encode(&mut packet).expect("room");
    let mut message = Vec::new();
    let mut decoder = dermis_wire::Decoder::new(vec![0; packet.len()]);
    decoder.feed(&packet[..length], |received| {
        if let dermis_wire::Received::Message(bytes) = received {
            message = bytes.to_vec();
        }
    });
    message
}

/// A hash of two integers to a number between -1 and 1: the output of SplitMix64 (Steele, Lea and Flood, 2014, DOI
/// 10.1145/2660193.2660195).
fn noise(a: u64, b: u64) -> f64 {
    let mut z = a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.wrapping_mul(0xd1b5_4a32_d192_ed03);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}
