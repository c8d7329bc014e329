//! Several skins on one robot, read live.

use crate::workplace::{Running, Workplace};
use serde_json::Value;
use std::io::BufRead;

/// A robot with the two skins of the template, at addresses.
fn robot(at: &Workplace, addresses: [&str; 2]) {
    at.good("new robot -o arm.toml");
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    let text = text.replace("serial:/dev/ttyACM0", addresses[0]).replace("serial:/dev/ttyACM1", addresses[1]);
    at.write("arm.toml", text);
}

/// The snapshots and events of a run, and what it said.
fn run(at: &Workplace, arguments: &str) -> (Vec<Value>, Vec<Value>, String) {
    let output = at.command(&format!("robot run arm.toml --serve off --jsonl - {arguments}")).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let lines: Vec<Value> =
        String::from_utf8_lossy(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |kind: &str| lines.iter().filter_map(|line| line.get(kind).cloned()).collect();
    (of("snapshot"), of("event"), said)
}

/// The zone of a skin, or why it is unknown.
fn zone(snapshot: &Value, skin: usize) -> String {
    let skin = &snapshot["skins"][skin];
    skin["reason"].as_str().or(skin["zone"].as_str()).unwrap().to_string()
}

/// The zones of a skin in turn, without repetitions.
fn zones(snapshots: &[Value], skin: usize) -> Vec<String> {
    let mut zones: Vec<String> = snapshots.iter().map(|snapshot| zone(snapshot, skin)).collect();
    zones.dedup();
    zones
}

/// A device in a process of its own, whose first line is its address.
fn emulated(at: &Workplace, arguments: &str) -> Running {
    Running::start(at, &format!("emulate {arguments} --tcp 127.0.0.1:0 --prerender 100"))
}

#[test]
fn a_simulated_robot_is_pressed_and_its_contacts_are_in_the_frame_of_the_base() {
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    let (snapshots, events, said) = run(&at, "--emulate --touch press --for 6");
    assert!(snapshots.len() > 150, "{} {said}", snapshots.len());
    let causes: Vec<&str> = events.iter().map(|event| event["cause"].as_str().unwrap()).collect();
    assert!(causes[0] == "unknown" && causes.contains(&"touched"), "{causes:?}");
    let contacts: Vec<&Value> =
        snapshots.iter().flat_map(|snapshot| snapshot["contacts"].as_array().unwrap()).collect();
    assert!(!contacts.is_empty(), "{said}");
    for contact in &contacts {
        let length = |key: &str| {
            let place: Vec<f64> = contact[key].as_array().unwrap().iter().map(|part| part.as_f64().unwrap()).collect();
            place.iter().map(|part| part * part).sum::<f64>().sqrt()
        };
        // The arm reaches 0.2 + 0.35 + 0.36 m and a skin's length up.
        assert!((0.3..1.1).contains(&length("position_base_m")), "{contact}");
        assert!((length("normal_base") - 1.0).abs() < 1e-9, "{contact}");
        assert!(contact["sd_base_m"].is_number() && contact["skin"].is_string(), "{contact}");
    }
}

#[test]
fn a_skin_without_a_device_is_unknown_and_the_other_one_is_not() {
    let at = Workplace::empty();
    let device = emulated(&at, "cylinder30");
    robot(&at, [&device.line, "tcp:127.0.0.1:1"]);
    let (snapshots, events, said) = run(&at, "--for 5");
    assert_eq!(zones(&snapshots, 1), ["absent"], "{said}");
    assert!(zones(&snapshots, 0).contains(&"clear".to_string()), "{:?} {said}", zones(&snapshots, 0));
    assert!(snapshots.iter().all(|snapshot| snapshot["touched"] != Value::Bool(false)), "{said}");
    assert_eq!(events.len(), 1, "{events:?}");
}

#[test]
fn swapped_cables_are_named() {
    let at = Workplace::empty();
    let devices = [emulated(&at, "skin16 --seed 17"), emulated(&at, "skin16 --seed 18")];
    robot(&at, [&devices[1].line, &devices[0].line]);
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap().replace("\"cylinder30\"", "\"skin16\"");
    let text = text
        .replace("# serial = 17 ", "serial = 17 ")
        .replace("link = \"hand_link\"", "link = \"hand_link\"\nserial = 18");
    at.write("arm.toml", text);
    let (snapshots, _, said) = run(&at, "--for 4");
    assert!(said.contains("forearm: the device has the serial number 18, that of `palm`, in place of 17"), "{said}");
    for skin in 0..2 {
        let zones = zones(&snapshots, skin);
        assert!(zones.iter().all(|zone| ["absent", "other_device"].contains(&zone.as_str())), "{zones:?}");
        assert_eq!(zones.last().unwrap(), "other_device");
    }
}

#[test]
fn devices_of_other_skins_of_the_robot_are_named() {
    let at = Workplace::empty();
    let devices = [emulated(&at, "skin16 --seed 17"), emulated(&at, "cylinder30 --seed 18")];
    robot(&at, [&devices[0].line, &devices[1].line]);
    let (snapshots, _, said) = run(&at, "--for 4");
    let swap = |skin: &str, serial: u32, owner: &str| {
        format!("{skin}: the device has the serial number {serial} and is that of `{owner}`: swap the cables")
    };
    for message in [swap("forearm", 17, "palm"), swap("palm", 18, "forearm")] {
        assert_eq!(said.matches(&message).count(), 1, "{said}");
    }
    for skin in 0..2 {
        assert_eq!(zones(&snapshots, skin).last().unwrap(), "other_device");
    }
}

#[test]
fn joint_states_that_do_not_come_are_missed_once_and_those_from_before_are_not_of_another_clock() {
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    at.write("arm.toml", text.replace("joints = \"none\"", &format!("joints = \"udp:127.0.0.1:{port}\"")));
    let (begun, is_over) = (std::time::Instant::now(), std::sync::atomic::AtomicBool::new(false));
    let said = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(std::sync::atomic::Ordering::Relaxed) {
                // They come while the skins are prepared, and stop after some seconds.
                if begun.elapsed().as_secs_f64() < 4.0 {
                    let states = r#"{"name": ["shoulder", "elbow", "wrist"], "position": [0.0, 0.1, 0.2]}"#;
                    let _ = socket.send_to(states.as_bytes(), ("127.0.0.1", port));
                }
                std::thread::sleep(std::time::Duration::from_millis(10));
            }
        });
        let (_, _, said) = run(&at, "--emulate --for 7");
        is_over.store(true, std::sync::atomic::Ordering::Relaxed);
        said
    });
    assert!(!said.contains("set both clocks alike"), "{said}");
    assert_eq!(said.matches(&format!("no joint states from udp:127.0.0.1:{port} for")).count(), 1, "{said}");
}

#[test]
fn a_device_that_is_killed_makes_its_skin_unknown_and_a_new_one_brings_it_back() {
    let at = Workplace::empty();
    let mut device = emulated(&at, "skin16 --seed 2");
    let other = emulated(&at, "cylinder30");
    robot(&at, [&other.line, &device.line]);
    let address = device.line.strip_prefix("tcp:").unwrap().to_string();
    // Each step waits for the one before, however slow the computer is; without them the run ends by itself.
    let mut running = at.command("robot run arm.toml --serve off --jsonl - --for 60").spawn().unwrap();
    let errors = std::io::BufReader::new(running.stderr.take().unwrap());
    let said = std::thread::spawn(move || errors.lines().map_while(Result::ok).collect::<Vec<_>>().join("\n"));
    let (mut zones, mut unknown, mut begins, mut again) = (Vec::new(), Vec::new(), 0, None);
    for line in std::io::BufReader::new(running.stdout.take().unwrap()).lines().map_while(Result::ok) {
        let line: Value = serde_json::from_str(&line).unwrap();
        begins += usize::from(line["event"]["event"] == "begins");
        let Some(snapshot) = line.get("snapshot") else { continue };
        if zone(snapshot, 0) == "lost" {
            unknown.push(snapshot.clone());
        }
        zones.push(zone(snapshot, 1));
        zones.dedup();
        match zones.last().unwrap().as_str() {
            "clear" if zones.iter().any(|zone| zone == "lost") => break,
            // Both skins are clear, and the rule has ended.
            "clear" if snapshot["rules"].as_object().is_some_and(|rules| rules.is_empty()) => {
                let _ = device.child.kill();
            }
            "lost" if again.is_none() => {
                device.child.wait().unwrap();
                let empty = Workplace::empty();
                let arguments = format!("emulate skin16 --seed 2 --tcp {address} --prerender 100");
                again =
                    Some((Running { child: empty.command(&arguments).spawn().unwrap(), line: String::new() }, empty));
            }
            _ => {}
        }
    }
    let _ = running.kill();
    let _ = running.wait();
    let said = said.join().unwrap();
    assert_eq!(zones.last().unwrap(), "clear", "{zones:?} {said}");
    assert!(again.is_some(), "{zones:?} {said}");
    // 0.2 s after the kill it is unknown, and the rule has begun again.
    assert!(begins >= 2, "{begins} {said}");
    assert!(unknown.is_empty(), "{unknown:?} {said}");
}

/// A limb in a process of its own: the robot says the same of it, notices its end and its return, and takes no contacts of another
/// design.
#[test]
fn a_limb_that_another_process_reads_is_joined_lost_and_found_again() {
    let at = Workplace::empty();
    let limb =
        "name = \"left arm\"\n[[skin]]\nname = \"palm\"\ndesign = \"skin16\"\nsource = \"emulate\"\nserial = 18\n";
    at.write("limb.toml", limb);
    let shared = |address: &str| {
        let arguments = format!("robot run limb.toml --touch press --prerender 240 --serve off --share {address}");
        Running::start_said(&at, &arguments, "shared at")
    };
    let mut part = shared("127.0.0.1:0");
    let source = part.line.rsplit(' ').next().unwrap().to_string();
    assert!(source.starts_with("robot:127.0.0.1:"), "{}", part.line);
    robot(&at, ["tcp:127.0.0.1:1", &source]);
    let recorded = at.command("robot run arm.toml --serve off --jsonl - --record rec --for 5").output().unwrap();
    assert!(recorded.status.success(), "{}", String::from_utf8_lossy(&recorded.stderr));
    assert_eq!(recorded.stdout, at.command("robot replay rec").output().unwrap().stdout);
    let mut running = at.command("robot run arm.toml --serve off --jsonl - --for 60").spawn().unwrap();
    let errors = std::io::BufReader::new(running.stderr.take().unwrap());
    let said = std::thread::spawn(move || errors.lines().map_while(Result::ok).collect::<Vec<_>>().join("\n"));
    let (mut zones, mut contacts, mut is_killed) = (Vec::new(), 0, false);
    for line in std::io::BufReader::new(running.stdout.take().unwrap()).lines().map_while(Result::ok) {
        let line: Value = serde_json::from_str(&line).unwrap();
        let Some(snapshot) = line.get("snapshot") else { continue };
        assert_ne!(snapshot["touched"], Value::Bool(false), "the forearm is unknown");
        zones.push(zone(snapshot, 1));
        zones.dedup();
        let of_palm = snapshot["contacts"].as_array().unwrap();
        assert!(of_palm.iter().all(|contact| contact["skin"] == "palm" && contact["position_link_m"].is_array()));
        contacts += of_palm.len();
        match zones.last().unwrap().as_str() {
            "touched" | "clear" if is_killed && zones.iter().any(|zone| zone == "lost") => break,
            "touched" if contacts > 10 && !is_killed => {
                assert_eq!(snapshot["skins"][1]["device_serial"], 18);
                part.child.kill().unwrap();
                part.child.wait().unwrap();
                is_killed = true;
                part = shared(source.strip_prefix("robot:").unwrap());
            }
            _ => {}
        }
    }
    let _ = running.kill();
    let _ = running.wait();
    let said = said.join().unwrap();
    assert!(["touched", "clear"].contains(&zones.last().unwrap().as_str()), "{zones:?} {said}");
    assert!(zones.iter().any(|zone| zone == "lost") && said.contains("connected again"), "{zones:?} {said}");
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    for (from, to, message) in [
        ("\"skin16\"", "\"cylinder30\"", "its skin `palm` has another design"),
        ("\"palm\"", "\"hand\"", "it has no skin `hand`: it reads `palm`"),
    ] {
        at.write("arm.toml", text.replace(from, to));
        let (snapshots, _, said) = run(&at, "--for 3");
        assert_eq!(self::zones(&snapshots, 1), ["absent"], "{said}");
        assert_eq!(said.matches(message).count(), 1, "{said}");
    }
    at.write("arm.toml", text.replace(&source, "robot:7440"));
    assert!(at.refused("robot check arm.toml").contains("robot:HOST:PORT"));
    assert!(at.refused("robot run limb.toml --serve off --share 0.0.0.0:7440").contains("--share 127.0.0.1:PORT"));
}

/// The same lines, byte for byte; a recording that was cut off says so, and nothing is overwritten.
#[test]
fn a_recorded_robot_says_the_same_when_it_is_replayed() {
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    // A model of its own travels with the recording.
    let model = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-learn/models/skin16/shapes");
    std::fs::create_dir(at.path("model")).unwrap();
    for file in std::fs::read_dir(&model).unwrap().map(|file| file.unwrap().path()) {
        std::fs::copy(&file, at.path("model").join(file.file_name().unwrap())).unwrap();
    }
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    at.write("arm.toml", text.replace("design = \"skin16\"", "design = \"skin16\"\nmethod = \"./model\""));
    let run = "robot run arm.toml --emulate --touch random --prerender 240 --serve off --jsonl - --record rec --for 5";
    let live = at.command(run).output().unwrap();
    assert!(live.status.success(), "{}", String::from_utf8_lossy(&live.stderr));
    std::fs::rename(at.path("rec"), at.path("elsewhere")).unwrap();
    ["arm.toml", "arm.urdf"].iter().for_each(|name| std::fs::remove_file(at.path(name)).unwrap());
    std::fs::remove_dir_all(at.path("model")).unwrap();
    let replayed = at.command("robot replay elsewhere").output().unwrap();
    assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
    assert!(live.stdout.len() > 50_000, "{} bytes", live.stdout.len());
    let lines = |output: &[u8]| String::from_utf8_lossy(output).lines().map(String::from).collect::<Vec<_>>();
    let (said, again) = (lines(&live.stdout), lines(&replayed.stdout));
    let unlike = said.iter().zip(&again).find(|(said, again)| said != again);
    assert!(unlike.is_none() && said.len() == again.len(), "{} and {} lines, {unlike:?}", said.len(), again.len());
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    assert!(
        at.refused("robot run arm.toml --emulate --serve off --record elsewhere --for 1").contains("not overwritten")
    );
    assert!(at.refused("robot replay .").contains("robot.toml"));
    let inputs = std::fs::read(at.path("elsewhere/inputs.jsonl")).unwrap();
    at.write("elsewhere/inputs.jsonl", &inputs[..inputs.len() / 2]);
    let cut = at.command("robot replay elsewhere --summary --json").output().unwrap();
    assert!(String::from_utf8_lossy(&cut.stderr).contains("has no end: it was cut off"));
    let counts: Value = serde_json::from_slice(&cut.stdout).unwrap();
    assert!(counts["snapshots"].as_u64().unwrap() > 50 && counts["missing_frames"] == 0, "{counts}");
    at.write("elsewhere/inputs.jsonl", [&inputs[..inputs.len() / 2], b"\n"].concat());
    assert!(at.refused("robot replay elsewhere").contains("inputs.jsonl, line "));
    at.write("elsewhere/inputs.jsonl", &inputs);
    let design = std::fs::read_to_string(at.path("elsewhere/skins/forearm.toml")).unwrap();
    at.write("elsewhere/skins/forearm.toml", design.replacen("length_m = 0.3", "length_m = 0.31", 1));
    assert!(at.refused("robot replay elsewhere --summary").contains("than its design has now"));
    at.write("elsewhere/skins/forearm.toml", design);
    let frames = std::fs::read(at.path("elsewhere/skins/forearm.mcap")).unwrap();
    at.write("elsewhere/skins/forearm.mcap", &frames[..frames.len() / 2]);
    let lacking = at.refused("robot replay elsewhere --summary");
    assert!(lacking.contains("lack") && lacking.contains("frames"), "{lacking}");
    std::fs::remove_file(at.path("elsewhere/skins/forearm.mcap")).unwrap();
    let missing = at.refused("robot replay elsewhere --summary");
    assert!(missing.contains("elsewhere/skins/forearm.mcap is missing"), "{missing}");
}

/// The page is served with its files, to its own host alone; what another page asks for is refused.
#[test]
fn a_robot_has_a_page() {
    use std::io::{Read, Write};
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    let run = Running::start_said(
        &at,
        "robot run arm.toml --emulate --prerender 100 --serve 127.0.0.1:0",
        "the viewer is at",
    );
    let address = run.line.split("http://").nth(1).unwrap().trim_end_matches('/').to_string();
    let ask = |path: &str, more: &str| {
        let mut stream = std::net::TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(std::time::Duration::from_secs(10))).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\n{more}\r\n").unwrap();
        let mut answer = vec![0; 4096];
        let length = stream.read(&mut answer).unwrap();
        String::from_utf8_lossy(&answer[..length]).into_owned()
    };
    for (path, kind) in [("/", "text/html"), ("/robot.js", "javascript"), ("/robot.css", "css"), ("/viewer.css", "css")]
    {
        let answer = ask(path, "");
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains(kind), "{path}: {answer}");
    }
    let socket = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";
    let opened = ask("/live", socket);
    assert!(opened.starts_with("HTTP/1.1 101"), "{opened}");
    let refused = ask("/live", &format!("{socket}Origin: http://elsewhere.example\r\n"));
    assert!(refused.starts_with("HTTP/1.1 403"), "{refused}");
    assert!(at.refused("robot run arm.toml --emulate --serve 0.0.0.0:0 --for 1").contains("token"));
}

#[test]
fn lines_go_to_every_program_that_connects() {
    use std::io::BufRead;
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    let running =
        Running::start_said(&at, "robot run arm.toml --serve off --jsonl tcp:127.0.0.1:0", "lines of JSON are at tcp:");
    let read = || {
        let (_, address) = running.line.split_once("tcp:").unwrap();
        let stream = std::net::TcpStream::connect(address.trim()).unwrap();
        let line = std::io::BufReader::new(stream).lines().next().unwrap().unwrap();
        serde_json::from_str::<Value>(&line).unwrap()
    };
    for _ in 0..2 {
        assert_eq!(read()["snapshot"]["touched"], Value::Null);
    }
}

#[cfg(feature = "ros2")]
#[test]
fn another_middleware_receives_a_robot_and_sends_its_joints() {
    use crate::interpreter;
    let scripts = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-live/tests/python");
    let Some(python) = interpreter::with(&scripts.join("requirements.txt")) else { return };
    let at = Workplace::empty();
    robot(&at, ["tcp:127.0.0.1:1", "tcp:127.0.0.1:2"]);
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    at.write("arm.toml", text.replace("joints = \"none\"", "joints = \"ros2:/joint_states\""));
    // A domain of this process.
    let domain = (100 + std::process::id() % 100).to_string();
    let command = "robot run arm.toml --serve off --emulate --touch press --ros2 --namespace /arm --for 90";
    let mut run = at.command(command).env("ROS_DOMAIN_ID", &domain).spawn().unwrap();
    let mut peer = std::process::Command::new(python);
    let said = interpreter::run(peer.arg(scripts.join("check_robot.py")).args([&domain, "60"]));
    let _ = run.kill();
    let _ = run.wait();
    println!("{}", said.unwrap_or_else(|why| panic!("{why}")));
}
