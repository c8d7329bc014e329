//! `dermis live --source csv:...`: frames of an instrument that sends rows of values.

use crate::workplace::{self, Workplace};
use dermis::frame::Frame;
use dermis::method::MethodSet;
use dermis::pipeline::{FrameInput, Pipeline, Settings, Timestamp};
use dermis::skin::Skin;
use dermis_sim::noise::Noise;
use dermis_sim::random::{sample_rng, standard_normal};
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use serde_json::Value;
use std::io::Write;
use std::net::TcpListener;
use std::process::{Output, Stdio};
use std::time::Duration;

const TARE: u64 = 100;
const RATE_HZ: f64 = 120.0;

/// Frames of the skin `disk.toml`: pressed from 110 to 169 of 200.
fn frames(skin: &Skin) -> Vec<Frame> {
    let (design, rest) = (skin.design(), skin.forward().rest_conductivity());
    let touch = GaussianTouch { centre_m: [0.02, 0.01, 0.0], amplitude: 0.5, width_m: 0.01 };
    let touched =
        touched_conductivity(skin.mesh(), &design.body.surface(), design.sheet.touch, rest, &[touch]).unwrap();
    let solved = [skin.forward().solve(rest).unwrap(), skin.forward().solve(&touched).unwrap()];
    let noise = Noise::at_snr_db(60.0, &solved[0], &design.protocol, f64::INFINITY).unwrap();
    let (_, drive_of) = design.protocol.drives();
    let is_pressed = |number: u64| (110..170).contains(&number);
    let frame = |number| noise.apply(&solved[usize::from(is_pressed(number))], &drive_of, &mut sample_rng(5, number));
    (0..200).map(frame).collect()
}

fn row(frame: &Frame) -> String {
    frame.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(",")
}

/// Runs `dermis live disk.toml` with lines on standard input, slowly enough that no line of JSON is dropped.
fn piped(at: &Workplace, arguments: &str, lines: &[String]) -> Output {
    piped_to(at, "disk.toml", arguments, lines)
}

/// The same with a design.
fn piped_to(at: &Workplace, design: &str, arguments: &str, lines: &[String]) -> Output {
    let mut command = at.command(&format!("live {design} --serve off --source csv:- {arguments}"));
    let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    for line in lines {
        // The program may have refused the first lines.
        let _ = writeln!(input, "{line}");
        std::thread::sleep(Duration::from_millis(2));
    }
    drop(input);
    child.wait_with_output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn rows_of_a_pipe_give_the_contacts_of_the_same_frames() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let frames = frames(&skin);
    let time_s = |number: usize| 3.0 + number as f64 / RATE_HZ;
    let rows = frames.iter().enumerate().map(|(number, frame)| format!("{:?},{}", time_s(number), row(frame)));
    let lines: Vec<String> = ["# an instrument".into(), "time,a,b".into()].into_iter().chain(rows).collect();
    let output = piped(&at, "--jsonl - --record rows.mcap", &lines);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("csv:- has ended"), "{}", said(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    let live: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(live.len(), frames.len());

    let methods = MethodSet::new(&dermis_learn::methods(), skin.clone(), None).unwrap();
    let mut pipeline = Pipeline::new(methods.into(), Settings::default()).unwrap();
    let start = Timestamp { unix_ns: live[0]["measured_at"].as_u64().unwrap() };
    let mut touched = 0;
    for (number, (frame, line)) in frames.iter().zip(&live).enumerate() {
        let measured_at = start.after(Duration::from_secs_f64(time_s(number) - time_s(0)));
        assert_eq!(line["measured_at"], measured_at.unix_ns);
        let result = pipeline.process(FrameInput::new(number as u64, measured_at, frame.0.clone())).unwrap();
        assert_eq!(line["contacts"], serde_json::to_value(&result.contacts).unwrap(), "frame {number}");
        touched += result.contacts.len();
    }
    assert!((58..70).contains(&touched), "{touched} contacts");

    // A recording of rows is replayed.
    let replayed = at.good("replay rows.mcap --contacts");
    let contacts: Vec<Value> = replayed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(contacts.len(), live.len(), "frames of the replay");
    for (contacts, line) in contacts.iter().zip(&live) {
        assert_eq!(contacts, &line["contacts"], "contacts of the replay");
    }

    // The command for files finds them at the same place.
    at.write("frames.csv", frames.iter().map(|frame| row(frame) + "\n").collect::<String>());
    at.write("untouched.csv", frames[..TARE as usize].iter().map(|frame| row(frame) + "\n").collect::<String>());
    at.good("contacts disk.toml --frames frames.csv --baseline untouched.csv -o contacts.jsonl");
    let text = std::fs::read_to_string(at.path("contacts.jsonl")).unwrap();
    for (line, by_file) in live.iter().zip(text.lines()).skip(120).take(40) {
        let by_file: Value = serde_json::from_str(by_file).unwrap();
        let place = |contact: &Value| [0, 1].map(|axis| contact["position_m"][axis].as_f64().unwrap());
        let ([x, y], [u, v]) = (place(&line["contacts"][0]), place(&by_file["contacts"][0]));
        assert!((x - u).hypot(y - v) < 0.001, "{x}, {y} and {u}, {v}");
    }
}

/// The loose wire of electrode 3 reads anything; without the electrode the press is found, live and from files.
#[test]
fn an_electrode_that_is_left_out_spoils_nothing() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let protocol = &skin.design().protocol;
    let mut frames = frames(&skin);
    for (number, frame) in frames.iter_mut().enumerate() {
        let mut rng = sample_rng(6, number as u64);
        for (value, _) in frame.0.iter_mut().zip(protocol.channels()).filter(|(_, channel)| channel.uses(3)) {
            *value = 1e4 * standard_normal(&mut rng);
        }
    }
    let lines: Vec<String> = frames.iter().map(row).collect();
    let contacts = |arguments: &str| -> Vec<Vec<Value>> {
        let output = piped(&at, &format!("--jsonl - {arguments}"), &lines);
        assert!(output.status.success(), "{}", said(&output));
        let text = String::from_utf8(output.stdout).unwrap();
        let of = |line: &str| serde_json::from_str::<Value>(line).unwrap()["contacts"].as_array().unwrap().clone();
        text.lines().map(of).collect()
    };
    let is_found = |contact: &Value| {
        let [x, y] = [0, 1].map(|axis| contact["position_m"][axis].as_f64().unwrap());
        (x - 0.02).hypot(y - 0.01) < 0.01
    };
    let count_found = |frames: &[Vec<Value>]| {
        frames[120..165].iter().filter(|contacts| contacts.len() == 1 && is_found(&contacts[0])).count()
    };
    let without = contacts("--leave-out-electrode 3");
    let counts = [&without, &contacts("")].map(|frames| count_found(frames));
    assert!(counts[0] > 40 && counts[1] < 5, "{counts:?} of 45 frames");
    assert!(without[TARE as usize..105].iter().all(Vec::is_empty));

    let write =
        |name: &str, lines: &[String]| at.write(name, lines.iter().map(|line| format!("{line}\n")).collect::<String>());
    write("untouched.csv", &lines[..TARE as usize]);
    write("frames.csv", &lines[120..160]);
    let files = "contacts disk.toml --frames frames.csv --baseline untouched.csv -o contacts.jsonl";
    assert!(at.run(&format!("{files} --leave-out-electrode 3")).status.success());
    let text = std::fs::read_to_string(at.path("contacts.jsonl")).unwrap();
    for line in text.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        assert!(
            line["contacts"].as_array().is_some_and(|contacts| contacts.len() == 1 && is_found(&contacts[0])),
            "{line}"
        );
    }
    let refused = at.refused(&format!("{files} --leave-out-electrode 8"));
    assert!(refused.contains("--leave-out-electrode 8: the skin has electrodes 0 to 7"), "{refused}");
}

/// The numbers of a text after `noise of the channels`, ohm.
fn noise_in(text: &str) -> Vec<f64> {
    let (_, noise) = text.split_once("noise of the channels ").unwrap_or_else(|| panic!("no noise: {text}"));
    let parts = noise.split(" and ").take(2);
    parts.map(|part| part.split_whitespace().next().unwrap().parse().unwrap()).collect()
}

/// A recording has one noise in every command, live and from files.
#[test]
fn one_recording_has_one_noise() {
    let at = Workplace::new();
    at.write("disk.toml", workplace::DISK.replace("adjacent_undriven", "adjacent"));
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let lines: Vec<String> = frames(&skin)[..TARE as usize].iter().map(row).collect();
    at.write("untouched.csv", lines.iter().map(|line| format!("{line}\n")).collect::<String>());

    let fit: Value =
        serde_json::from_str(&at.good("fit disk.toml --frames untouched.csv -o fitted.toml --json")).unwrap();
    let expected = ["others", "driven"].map(|group| fit[group]["noise_ohm"].as_f64().unwrap());
    let same = |found: &[f64], what: &str| {
        assert_eq!(found.len(), 2, "{what}");
        for (found, expected) in found.iter().zip(expected) {
            // Texts have four digits.
            assert!((found / expected - 1.0).abs() < 5e-4, "{what}: {found} instead of {expected}");
        }
    };
    for command in [
        "check-build disk.toml --frames untouched.csv",
        "check-frames disk.toml --frames untouched.csv --baseline untouched.csv",
    ] {
        // Findings have an exit code of their own.
        let output = at.command(&format!("{command} --json")).output().unwrap();
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        let noise: Vec<f64> = json["noise_ohm"].as_array().unwrap().iter().map(|sd| sd.as_f64().unwrap()).collect();
        same(&noise, command);
    }
    let contacts = at.good("contacts disk.toml --frames untouched.csv --baseline untouched.csv -o contacts.csv");
    same(&noise_in(&contacts), "contacts");
    let live = piped(&at, "--rate 120", &lines);
    same(&noise_in(&said(&live)), "live");
    // 60 dB of the values without a driven electrode, of which the simulation made the noise.
    let rest = skin.forward().solve(skin.forward().rest_conductivity()).unwrap();
    let sd_ohm = Noise::at_snr_db(60.0, &rest, &skin.design().protocol, f64::INFINITY).unwrap().sd_ohm;
    assert!(expected.iter().all(|found| (found / sd_ohm - 1.0).abs() < 0.05), "{expected:?} of {sd_ohm}");
}

#[test]
fn wrong_rows_are_lost_and_named() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let mut lines: Vec<String> = frames(&skin).iter().take(60).map(row).collect();
    lines[10] = "1,2,3".into();
    lines[20] = lines[20].replacen(',', ",oops,", 1).rsplit_once(',').unwrap().0.to_string();
    lines[30] = lines[30].rsplit_once(',').unwrap().0.to_string() + ",NaN";
    let output = piped(&at, "--json --rate 120", &lines);
    assert!(output.status.success(), "{}", said(&output));
    let said = said(&output);
    for words in [
        "a row of csv:- is lost: line 11: too few values: 3, but frames have 40",
        "line 21, column 2: `oops` is not a number",
        "line 31, column 40: the value is NaN",
    ] {
        assert!(said.contains(words), "no `{words}` in: {said}");
    }
    let counts: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&counts["frames"], &counts["lost"]), (&57.into(), &3.into()));
}

#[test]
fn rows_that_never_fit_are_refused() {
    let at = Workplace::new();
    let refused = |lines: &[&str], words: &[&str]| {
        let lines: Vec<String> = lines.iter().map(|line| (*line).to_string()).collect();
        let output = piped(&at, "", &lines);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        let said = said(&output).split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
        for word in words {
            assert!(said.contains(word), "no `{word}` in: {said}");
        }
    };
    refused(&["1,2,3"; 12], &["csv:-", "none of its first 10 rows", "too few values: 3, but frames have 40"]);
    refused(&["a,b"], &["ended after 1 line without a row"]);
    let refused = |arguments: &str, words: &[&str]| {
        let said = at.refused(&format!("live disk.toml --serve off {arguments}"));
        words.iter().for_each(|word| assert!(said.contains(word), "no `{word}` in: {said}"));
    };
    refused("--source csv:tcp:127.0.0.1:1 --for 0.5", &["tcp:127.0.0.1:1", "nobody listens there", "no device came"]);
    refused("--source csv:file.csv", &["`file.csv` is no device", "csv:-"]);
    refused("--source csv:- --rate 0", &["--rate", "0.001 to 1000000"]);
}

#[test]
fn a_device_that_is_not_there_yet_is_waited_for() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let rows: Vec<String> = frames(&skin).iter().take(60).map(row).collect();
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let serve = move || {
        std::thread::sleep(Duration::from_millis(1500));
        let (mut stream, _) = TcpListener::bind(address).unwrap().accept().unwrap();
        for row in &rows {
            writeln!(stream, "{row}").unwrap();
            std::thread::sleep(Duration::from_millis(4));
        }
        std::thread::sleep(Duration::from_secs(2));
    };
    let server = std::thread::spawn(serve);
    let output = at.run(&format!("live disk.toml --serve off --source csv:tcp:{address} --for 4 --json"));
    server.join().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(
        said(&output).contains("nobody listens") && said(&output).contains("the device is connected"),
        "{output:?}"
    );
    let counts: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&counts["frames"], &counts["reconnected"]), (&60.into(), &0.into()));
}

#[test]
fn a_connection_that_is_lost_is_opened_again() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let rows: Vec<String> = frames(&skin).iter().take(60).map(row).collect();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let serve = move || {
        for stream in listener.incoming().take(2) {
            let mut stream = stream.unwrap();
            for row in &rows {
                writeln!(stream, "{row}").unwrap();
                std::thread::sleep(Duration::from_millis(4));
            }
        }
    };
    let server = std::thread::spawn(serve);
    let output = at.run(&format!("live disk.toml --serve off --source csv:tcp:{address} --for 4 --json"));
    server.join().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("was lost") && said(&output).contains("connected again"), "{}", said(&output));
    let counts: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&counts["frames"], &counts["lost"]), (&120.into(), &0.into()));
    assert_eq!(counts["reconnected"], 1);
}

#[test]
fn rows_that_end_before_the_tare_are_said() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let lines: Vec<String> = frames(&skin).iter().take(30).map(row).collect();
    let output = piped(&at, "", &lines);
    assert!(output.status.success() && said(&output).contains("ended before the tare did"), "{}", said(&output));
}

#[test]
fn objects_of_the_other_sign_are_named_once_and_touches_are_not() {
    let at = Workplace::empty();
    let tank = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-study/tank");
    let said_of = |name: &str, arguments: &str| {
        let output = at.run(&format!(
            "contacts tank16 --frames {tank}/{name}_objects.csv --baseline {tank}/{name}_empty.csv -o c.csv {arguments}"
        ));
        assert!(output.status.success(), "{}", said(&output));
        said(&output)
    };
    let hint = "in 1 of 1 frame a change of the other sign";
    for name in ["metal1_plastic5_55uA", "metal1_plastic5_plastic9_metal13_20uA"] {
        assert_eq!(said_of(name, "--method noser").matches(hint).count(), 1, "{name}");
        assert!(!said_of(name, "--method noser --both-signs").contains("other sign"), "{name}");
    }
    assert!(!said_of("metal1_55uA", "--method noser").contains("other sign"));
}

#[test]
fn contacts_in_a_tank_say_whether_they_conduct() {
    let at = Workplace::empty();
    let recorded = |what: &str| -> Vec<f64> {
        let tank = "/../dermis-study/tank/metal1_plastic5_plastic9_metal13_55uA_";
        let text = std::fs::read_to_string(format!("{}{tank}{what}.csv", env!("CARGO_MANIFEST_DIR"))).unwrap();
        text.trim().split(',').map(|value| value.parse().unwrap()).collect()
    };
    let [empty, objects] = ["empty", "objects"].map(recorded);
    // The files have one frame each.
    let largest = empty.iter().copied().map(f64::abs).fold(0.0, f64::max);
    let line = |number: u64| {
        let mut rng = sample_rng(3, number);
        let frame = if number < 110 { &empty } else { &objects };
        row(&Frame(frame.iter().map(|value| value + 1e-4 * largest * standard_normal(&mut rng)).collect()))
    };
    let lines: Vec<String> = (0..150).map(line).collect();
    let output = piped_to(&at, "tank16", "--method noser --both-signs --jsonl -", &lines);
    assert!(output.status.success(), "{}", said(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    let last: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let found: Vec<(f64, &str)> = (last["contacts"].as_array().unwrap().iter())
        .map(|contact| {
            let [x, y] = [0, 1].map(|axis| contact["position_m"][axis].as_f64().unwrap());
            (y.atan2(x).to_degrees().rem_euclid(360.0), contact["conductance"].as_str().unwrap())
        })
        .collect();
    // Metal at the electrodes 0 and 12, plastic at 4 and 8.
    for (angle, sign) in [(0.0_f64, "rises"), (90.0, "falls"), (180.0, "falls"), (270.0, "rises")] {
        let near =
            |(at, of): &(f64, &str)| ((at - angle + 180.0).rem_euclid(360.0) - 180.0).abs() < 15.0 && *of == sign;
        assert!(found.iter().any(near), "{sign} at {angle} degrees in {found:?}");
    }
    let network = at.refused("live skin16 --method shapes --both-signs --serve off --for 1");
    assert!(network.contains("contacts of both signs") && network.contains("--method noser"), "{network}");
}
