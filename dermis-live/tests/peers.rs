//! Third-party programs read the recorded and published data: rosbags and Cyclone DDS, both from PyPI.
//!
//! They are installed into a virtual environment under `target/`, at the versions in `python/requirements.txt`. If that
//! is not possible, the tests print a message and pass, unless `DERMIS_REQUIRE_PYTHON` is set.

use crate::interpreter::{self, run};
use crate::synthetic::{self, SyntheticSkin};
use dermis::contact::Contact;
use dermis::pipeline::TrackedContact;
use dermis_live::LiveFrame;
use dermis_live::recording::{Event, Recorder, Session};
use dermis_live::sinks::ros2::Reference;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const FRAMES: u64 = 300;

fn scripts() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python")
}

/// The interpreter with the peers installed; `None` if it is not available.
fn python() -> Option<&'static Path> {
    static PYTHON: OnceLock<Option<PathBuf>> = OnceLock::new();
    PYTHON.get_or_init(|| interpreter::with(&scripts().join("requirements.txt"))).as_deref()
}

fn skin() -> &'static SyntheticSkin {
    static SKIN: OnceLock<SyntheticSkin> = OnceLock::new();
    SKIN.get_or_init(|| SyntheticSkin::shipped("skin16"))
}

/// The expected contents of the messages, computed from the frames and not from the messages.
fn expected(folder: &Path) -> PathBuf {
    let reference = &skin().reference;
    let frames: Vec<Value> = (0..FRAMES).map(|index| expected_of(reference, &skin().frame(index))).collect();
    let fields = [
        &["x", "y", "z", "nx", "ny", "nz", "force", "force_sd", "strength", "area"][..],
        &[
            "direction_x",
            "direction_y",
            "direction_z",
            "half_length",
            "half_width",
            "edge",
            "sd",
            "confidence",
            "conductance",
        ],
        &["cx", "cy", "cz", "px", "py", "pz", "vx", "vy", "vz", "seen", "age", "id"],
    ]
    .concat();
    let whole =
        json!({"frame_id": reference.frame_id, "picture": reference.picture(), "fields": fields, "frames": frames});
    let path = folder.join("expected.json");
    std::fs::write(&path, whole.to_string()).unwrap();
    path
}

fn expected_of(reference: &Reference, frame: &LiveFrame) -> Value {
    let [rows, columns] = reference.picture();
    let mut picture = vec![Value::Null; rows * columns];
    for (pixel, &position) in reference.space.position_in_grid.iter().enumerate() {
        picture[position] = json!(frame.result.image[pixel]);
    }
    let contacts: Vec<Value> = frame.result.contacts.iter().map(point).collect();
    // At most one contact of known force: F = -n f, M = r x F.
    let mut wrench = [0.0; 6];
    for TrackedContact { contact, .. } in &frame.result.contacts {
        if contact.force_n.is_finite() {
            let [x, y, z] = contact.position_m;
            let [fx, fy, fz] = contact.normal.map(|part| -part * contact.force_n);
            wrench = [fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx];
        }
    }
    let message: String = frame.message.iter().map(|byte| format!("{byte:02x}")).collect();
    json!({
        "measured_ns": frame.result.measured_at.unix_ns,
        "values_ohm": frame.result.values_ohm,
        "picture": picture,
        "contacts": contacts,
        "wrench": wrench,
        "at_m": frame.result.contacts.first().map(|tracked| tracked.contact.position_m),
        "message": message,
    })
}

/// The numbers of a contact in a point cloud.
fn point(tracked: &TrackedContact) -> Value {
    let Contact { id, position_m, normal, force_n, force_sd_n, strength, area_m2, direction, .. } = tracked.contact;
    let Contact { half_length_m, half_width_m, edge_m, sd_m, confidence, conductance, .. } = tracked.contact;
    let TrackedContact { centroid_m, centre_of_pressure_m, velocity_m_s, seen, age_s, .. } = tracked;
    let numbers = json!([force_n, force_sd_n, strength, area_m2]);
    let form = json!([half_length_m, half_width_m, edge_m, sd_m, confidence, conductance.map(|change| change.sign())]);
    let ends = json!([u8::from(*seen), age_s, id]);
    let vectors = [position_m, normal, direction, *centroid_m, *centre_of_pressure_m, *velocity_m_s];
    let [position_m, normal, direction, centroid_m, centre_of_pressure_m, velocity_m_s] =
        vectors.map(|vector| json!(vector));
    let parts = [position_m, normal, numbers, direction, form, centroid_m, centre_of_pressure_m, velocity_m_s, ends];
    parts.iter().flat_map(|part| part.as_array().expect("an array").clone()).collect()
}

#[test]
fn rosbags_reads_a_recording() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("presses.mcap");
    let session = Session { design_toml: "# a design\n".into(), ..Session::default() };
    let mut recorder = Recorder::create(&path, skin().reference.clone(), &session).unwrap();
    for index in 0..FRAMES {
        recorder.frame(&skin().frame(index)).unwrap();
    }
    recorder.event(skin().frame(FRAMES).result.measured_at, &Event::Command(json!({"tare": null}))).unwrap();
    recorder.finish().unwrap();
    let expected = expected(folder.path());
    let said = run(Command::new(python).arg(scripts().join("check_recording.py")).arg(&path).arg(expected));
    println!("{}", said.unwrap_or_else(|why| panic!("{why}")));
    // The example of the documentation, as a user runs it.
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/read_recording.py");
    let printed = run(Command::new(python).arg(example).arg(&path)).unwrap_or_else(|why| panic!("{why}"));
    let last = printed.lines().last().unwrap_or_default();
    let touched = (0..FRAMES).filter(|&index| !skin().frame(index).result.contacts.is_empty()).count();
    assert!(last.starts_with(&format!("{FRAMES} frames, {touched} with contacts, ")), "{printed}");
}

#[cfg(feature = "ros2")]
#[test]
fn cyclone_receives_what_is_published() {
    use dermis_live::sinks::ros2::dds::{Publisher, PublisherOptions};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    const PATIENCE_S: u32 = 60;
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let expected = expected(folder.path());
    // A separate domain per process, so that parallel tests do not receive each other's messages.
    let domain = 100 + (std::process::id() % 100) as u16;
    let options = PublisherOptions { domain: Some(domain), namespace: "/left_arm".into(), frame_id: None };
    let mut publisher = Publisher::new(skin().reference.clone(), &options).unwrap();
    let (over, stop) = (AtomicBool::new(false), folder.path().join("stop"));
    let said = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut index = 0;
            while !over.load(Ordering::Relaxed) && !stop.exists() {
                publisher.frame(&skin().frame(index % FRAMES)).unwrap();
                index += 1;
                std::thread::sleep(Duration::from_secs(1) / synthetic::RATE as u32);
            }
        });
        let mut peer = Command::new(python);
        peer.arg(scripts().join("check_published.py")).args([&domain.to_string(), "/left_arm"]);
        let said = run(peer.arg(expected).arg(PATIENCE_S.to_string()).arg(&stop));
        over.store(true, Ordering::Relaxed);
        said
    });
    println!("{}", said.unwrap_or_else(|why| panic!("{why}")));
}
