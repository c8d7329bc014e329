//! `dermis live` and related commands with invalid input: exit code 2, and a message with the fix.

use crate::workplace::{self, Running, Workplace};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The arguments of every run: a skin that is prepared quickly, without a page.
const DISK: &str = "live disk.toml --serve off";

/// Checks that a command is rejected with a message that contains all of these words.
fn refused(at: &Workplace, arguments: &str, words: &[&str]) {
    let said = at.refused(arguments);
    for word in words {
        assert!(said.contains(word), "dermis {arguments}: no `{word}` in: {said}");
    }
}

/// Calls `serve` for every connection to the returned address.
fn served(serve: impl Fn(TcpStream) + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || listener.incoming().for_each(|stream| serve(stream.unwrap())));
    format!("tcp:{address}")
}

#[test]
fn a_device_that_cannot_be_reached_says_why() {
    let at = Workplace::new();
    let source = |source: &str, words: &[&str]| refused(&at, &format!("{DISK} --source {source}"), words);
    source("serial:/dev/nothing --for 0.5", &["there is no port", "nothing", "no device came"]);
    let absent =
        ["127.0.0.1:1", "nobody listens there", "is the port right", "tried again until it answers", "no device came"];
    source("tcp:127.0.0.1:1 --for 0.5", &absent);
    source("tcp:localhost", &["tcp:HOST:PORT"]);
    source("usb:1", &["no device", "tcp:HOST:PORT", "serial:PATH[@BAUD]"]);
    source("serial:/dev/nothing@fast", &["@4000000"]);
}

#[test]
fn silent_and_foreign_devices_are_distinguished() {
    let at = Workplace::new();
    let begun = Instant::now();
    let silent = served(|stream| {
        std::thread::sleep(Duration::from_secs(5));
        drop(stream);
    });
    refused(&at, &format!("{DISK} --source {silent}"), &["nothing came in 2 s", "is it on"]);
    assert!(begun.elapsed() < Duration::from_secs(4), "about two seconds");
    let web = served(|mut stream| {
        let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n<html>nothing</html>");
    });
    refused(&at, &format!("{DISK} --source {web}"), &["no hello", "something else speaks there"]);
}

#[cfg(unix)]
#[test]
fn a_wrong_baud_rate_is_reported() {
    let at = Workplace::new();
    let (port, path) = dermis_emulate::emulator::pseudo_terminal().unwrap();
    let dermis_emulate::emulator::Port::Terminal { mut device, _host } = port else { panic!("a terminal") };
    std::thread::spawn(move || {
        // Bytes at a wrong baud rate, as a UART reads them.
        while device.write_all(&[0xF8, 0x00, 0xFE, 0xE0, 0x80]).is_ok() {
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    let source = format!("serial:{}@115200", path.display());
    refused(&at, &format!("{DISK} --source {source}"), &["115200 bits a second", "@BAUD"]);
}

#[test]
fn a_device_of_another_skin_or_version_is_refused() {
    let at = Workplace::new();
    let emulated = Running::start(&at, "emulate skin16 --tcp 127.0.0.1:0");
    let source = format!("--source {}", emulated.line);
    refused(&at, &format!("{DISK} {source}"), &["is refused", "16 electrodes", "`disk` has 8"]);
    refused(&at, &format!("live cylinder30 --serve off {source}"), &["16 electrodes", "`cylinder30` has 30"]);
    // The same number of electrodes on another body.
    at.write("other.toml", workplace::DISK.replace("diameter_m = 0.1", "diameter_m = 0.2"));
    let other = Running::start(&at, "emulate other.toml --tcp 127.0.0.1:0");
    refused(&at, &format!("{DISK} --source {}", other.line), &["another skin", "hash", "scan-table"]);
    // The first bytes of a hello contain the version; this packet has four bytes and their checksum.
    let newer = served(|mut stream| {
        let mut packet = [0; 32];
        let length = dermis_wire::encode(&[1, 2, 9, 0], &mut packet).unwrap();
        let _ = stream.write_all(&packet[..length]);
        std::thread::sleep(Duration::from_secs(1));
    });
    refused(&at, &format!("{DISK} --source {newer}"), &["version 9", "version 1", "update the older one"]);
}

#[test]
fn addresses_that_are_taken_or_open_to_all_are_refused() {
    let at = Workplace::new();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap();
    refused(&at, &format!("live disk.toml --serve {taken}"), &["another program listens there", "0 for any"]);
    refused(&at, &format!("{DISK} --jsonl tcp:{taken}"), &["another program listens there", "0 for any"]);
    refused(&at, "live disk.toml --serve 0.0.0.0:0", &["other machines", "--token"]);
    refused(&at, "live disk.toml --serve 0.0.0.0:0 --token=", &["token of 0 characters", "at least 8"]);
    refused(&at, "live disk.toml --serve 127.0.0.1:0 --token 1234567", &["token of 7 characters", "openssl rand"]);
    refused(&at, "live disk.toml --serve nowhere", &["HOST:PORT"]);
    refused(&at, &format!("{DISK} --jsonl here"), &["`here`", "--jsonl tcp:127.0.0.1:PORT"]);
    refused(
        &at,
        &format!("{DISK} --jsonl tcp:0.0.0.0:0"),
        &["0.0.0.0:0 can be reached", "tcp:127.0.0.1:PORT", "ssh -L"],
    );
    refused(&at, &format!("{DISK} --jsonl tcp:nowhere"), &["nowhere", "tcp:HOST:PORT"]);
    refused(&at, &format!("emulate disk.toml --tcp {taken}"), &["cannot listen", "port 0"]);
}

/// A token from a file or the environment is not printed.
#[test]
fn a_token_of_a_file_or_the_environment_stays_hidden() {
    const TOKEN: &str = "0123456789abcdef";
    let at = Workplace::new();
    let run = "live disk.toml --serve 127.0.0.1:0 --for 0.1";
    at.write("token", format!("{TOKEN}\n"));
    let of_file = at.run(&format!("{run} --token-file token"));
    let of_environment = at.command(run).env("DERMIS_TOKEN", TOKEN).output().unwrap();
    for output in [of_file, of_environment] {
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.contains("?token=TOKEN"), "{said}");
        assert!(!said.contains(TOKEN), "{said}");
    }
    at.write("short", "1234567\n");
    refused(&at, &format!("{run} --token-file short"), &["token of 7 characters"]);
    at.write("spaced", "1234 5678 9\n");
    refused(&at, &format!("{run} --token-file spaced"), &["no spaces"]);
    refused(&at, &format!("{run} --token-file none"), &["token in none", "openssl rand"]);
    refused(&at, &format!("{run} --token-file token --token {TOKEN}"), &["cannot be used with"]);
}

#[test]
fn arguments_that_cannot_be_name_themselves_and_the_fix() {
    let at = Workplace::new();
    let wrong = |arguments: &str, words: &[&str]| refused(&at, &format!("{DISK} {arguments}"), words);
    wrong("--zone palm=1,2", &["`palm=1,2`", "NAME=X,Y,Z,RADIUS,TIMES"]);
    wrong("--zone palm=0,0,0,-1,2", &["zone `palm`", "a positive radius"]);
    wrong("--threshold 0", &["--threshold", "0.000001 to 1000000"]);
    wrong("--threshold NaN", &["--threshold", "NaN"]);
    wrong("--fault fire@1", &["`fire@1`", "loose:7@10"]);
    wrong("--fault loose:8@1", &["electrode 8", "0 to 7"]);
    wrong("--speed 0", &["--speed", "0.001 to 1000"]);
    wrong("--rate 1e6", &["frames a second are asked for", "at most"]);
    wrong("--touch nothing.toml", &["nothing.toml", "random, press"]);
    at.write("script.toml", "repeat_s = 4\n[[touch]]\nat_s = 1\nfor_s = \"long\"\n");
    wrong("--touch script.toml", &["script.toml", "line 4", "for_s"]);
    at.write("off.toml", "[[touch]]\nat_s = 1\nfor_s = 1\nforce_n = 2\nfrom = [1.0, 0.0, 0.0]\n");
    wrong("--touch off.toml", &["off.toml", "touch 0", "off the skin"]);
    wrong("--method wonderful", &["`wonderful`", "noser"]);
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-learn/models/skin16/shapes");
    wrong(&format!("--method {}", model.display()), &["skin16"]);
    at.write("there.mcap", "");
    wrong("--record there.mcap", &["there.mcap", "give another name"]);
    at.write("kept.json", "{");
    wrong("--state kept.json", &["kept.json", "tare anew"]);
    wrong("--source replay:none.mcap", &["none.mcap"]);
    wrong("--record nowhere/a.mcap", &["nowhere/a.mcap", "there is no folder nowhere"]);
    wrong("--source replay:there.mcap", &["there.mcap", "no MCAP recording", "empty"]);
    wrong("--source replay:there.mcap --state x.json", &["takes no --state", "leave them out"]);
    wrong("--source replay:there.mcap --both-signs", &["takes no", "--both-signs"]);
    wrong("--source replay:there.mcap --leave-out-electrode 2", &["takes no", "--leave-out-electrode"]);
    wrong("--leave-out-electrode 8", &["--leave-out-electrode 8: the skin has electrodes 0 to 7"]);
    wrong("--source replay:there.mcap --device-time", &["--device-time"]);
}

/// A recording of some presses.
fn record(at: &Workplace, name: &str) {
    let output = at.run(&format!("{DISK} --touch press --for 2.2 --record {name}"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn recordings_are_replayed_recovered_and_made_tables() {
    let at = Workplace::new();
    record(&at, "good.mcap");
    let whole = at.json("recover good.mcap -o again.mcap --json");
    assert_eq!(whole["was_whole"], true);
    let frames = whole["frames"].as_u64().unwrap();
    assert!(frames > 200, "{frames} frames");
    let contacts = at.good("replay good.mcap --contacts");
    assert_eq!(contacts.lines().count() as u64, frames);
    assert!(contacts.lines().any(|line| line.contains("position_m")));
    assert_eq!(at.good("replay again.mcap --contacts"), contacts);
    at.good("convert good.mcap -o tables");
    assert!(at.path("tables/contacts.csv").exists());

    // The same as if its frames came from a device.
    let output = at.run(&format!("{DISK} --source replay:good.mcap --speed 4 --jsonl -"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    let told = lines
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["contacts"].clone());
    let replayed = contacts.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    assert!(told.eq(replayed), "the contacts of the replay");
    refused(&at, "live skin16 --serve off --source replay:good.mcap", &["another skin", "8 electrodes", "`skin16`"]);

    let bytes = std::fs::read(at.path("good.mcap")).unwrap();
    at.write("cut.mcap", &bytes[..bytes.len() / 2]);
    let cut = at.json("recover cut.mcap -o mended.mcap --json");
    assert_eq!(cut["was_whole"], false);
    assert!((1..frames).contains(&cut["frames"].as_u64().unwrap()));
    assert!(contacts.starts_with(&at.good("replay mended.mcap --contacts")));
    assert!(at.good("convert cut.mcap -o cut").contains("cut"));
    let replayed = at.run("replay cut.mcap --summary");
    assert!(replayed.status.success() && String::from_utf8_lossy(&replayed.stderr).contains("cut.mcap ends early"));
    assert_eq!(std::fs::read(at.path("cut.mcap")).unwrap(), &bytes[..bytes.len() / 2], "the original stays");

    at.write("frames.mcap", "sequence,measured_s\n");
    for command in ["recover frames.mcap -o x.mcap", "convert frames.mcap -o x", "replay frames.mcap"] {
        refused(&at, command, &["frames.mcap", "no MCAP recording"]);
    }
    for command in ["recover none.mcap -o x.mcap", "convert none.mcap -o x", "replay none.mcap"] {
        refused(&at, command, &["none.mcap"]);
    }
    refused(&at, "recover cut.mcap -o good.mcap", &["good.mcap", "exists already", "another name"]);
    refused(&at, "convert cut.mcap -o tables", &["tables", "exists already"]);
}

/// The serial number of an emulated device is the seed of its twin.
#[test]
fn a_state_of_another_device_is_not_used() {
    let at = Workplace::new();
    let lived = |seed: u32| {
        let output = at.run(&format!("{DISK} --seed {seed} --for 2 --jsonl - --state kept.json"));
        let [lines, notices] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        let numbers = lines.lines().last().map(|line| {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            line["device_serial"].as_u64()
        });
        assert_eq!(numbers, Some(Some(seed.into())), "{notices}");
        notices
    };
    let another = "the device is number 7, the baseline is of number 3";
    let first = lived(3);
    assert!(first.contains("tared with 100 frames") && !first.contains("the device is number"), "{first}");
    let same = lived(3);
    assert!(!same.contains("tared with") && !same.contains("the device is number"), "{same}");
    let other = lived(7);
    assert!(other.contains(another) && other.contains("tared with 100 frames"), "{other}");
    let again = lived(7);
    assert!(!again.contains("tared with") && !again.contains("the device is number"), "{again}");
}

/// The number and the contacts of each frame in lines of JSON.
fn contacts(lines: &str) -> Vec<(u64, serde_json::Value)> {
    let lines = lines.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.map(|line| (line["sequence"].as_u64().unwrap(), line["contacts"].clone())).collect()
}

/// Each part replays alone, to the contacts that the skin had then; no frame is missing between parts.
#[test]
fn parts_of_a_recording_replay_to_the_contacts_of_the_skin() {
    let at = Workplace::new();
    let output = at.run(&format!(
        "{DISK} --touch press --for 4.5 --record run.mcap --record-split 1s --record-split 1GiB --jsonl -"
    ));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains(" in ") && said.contains(" files"), "{said}");
    let live = contacts(&String::from_utf8(output.stdout).unwrap());
    let mut names = vec!["run.mcap".to_string()];
    names.extend((1..9).map(|number| format!("run_{number}.mcap")).take_while(|name| at.path(name).exists()));
    assert!((3..=5).contains(&names.len()), "{names:?}");
    let parts: Vec<_> = names.iter().map(|name| contacts(&at.good(&format!("replay {name}")))).collect();
    let replayed = parts.concat();
    let touched = |frames: &[(u64, serde_json::Value)]| frames.iter().any(|(_, contacts)| contacts[0].is_object());
    assert!(parts.iter().filter(|part| touched(part)).count() >= 2, "some parts begin during a press");
    let from = live.iter().position(|(number, _)| *number == replayed[0].0).unwrap();
    assert!(replayed.len() > 350, "{} frames", replayed.len());
    assert_eq!(replayed, live[from..from + replayed.len()]);

    // Joined, they are one recording again.
    let joined: Vec<u8> = names.iter().flat_map(|name| std::fs::read(at.path(name)).unwrap()).collect();
    at.write("joined.mcap", joined);
    let said = at.good("recover joined.mcap -o whole.mcap");
    assert!(
        said.contains(&format!("{} recordings were joined", names.len())) && said.contains("nothing was left out"),
        "{said}"
    );
    for name in ["joined.mcap", "whole.mcap"] {
        assert!(contacts(&at.good(&format!("replay {name}"))) == replayed, "{name}");
    }
    let command = format!("{DISK} --for 1 --record run_3.mcap --record-split 1s");
    at.write("run_3_7.mcap", "");
    std::fs::remove_file(at.path("run_3.mcap")).unwrap_or_default();
    refused(&at, &command, &["run_3_7.mcap", "give another name"]);
}

/// Limits the size of a file, as on a full disk.
#[cfg(unix)]
#[test]
fn a_disk_without_room_ends_the_recording_and_not_the_contacts() {
    let at = Workplace::new();
    let dermis = env!("CARGO_BIN_EXE_dermis");
    let run = format!(
        "trap '' XFSZ; ulimit -f 40; exec {dermis} {DISK} --touch press --for 2.5 --jsonl - --record touch.mcap"
    );
    let mut command = Command::new("sh");
    command.args(["-c", &run]).current_dir(at.folder()).env("NO_COLOR", "1").stdin(Stdio::null());
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("the recording has ended") && said.contains("contacts go on"), "{said}");
    let lines = String::from_utf8_lossy(&output.stdout);
    let frames = lines.lines().filter(|line| line.contains("\"sequence\"")).count();
    assert!(frames > 250, "{frames} frames: contacts went on");
    // Data recorded before are kept.
    let kept = at.json("recover touch.mcap -o kept.mcap --json")["frames"].as_u64().unwrap();
    assert!(kept > 0 && kept < frames as u64, "{kept} of {frames} frames");
}

/// A program that stops reading lines of JSON does not delay frames for others.
#[test]
fn who_stops_reading_lines_holds_nobody_up() {
    let at = Workplace::new();
    let mut live = at.command(&format!("{DISK} --jsonl tcp:127.0.0.1:0 --for 3")).spawn().unwrap();
    let mut told = BufReader::new(live.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("lines of JSON are at tcp:") {
        line.clear();
        assert!(told.read_line(&mut line).unwrap() > 0, "it ended");
    }
    let address = line.trim().rsplit_once("tcp:").unwrap().1.to_string();
    let stalled = TcpStream::connect(&address).unwrap();
    let reading = TcpStream::connect(&address).unwrap();
    let mut text = String::new();
    BufReader::new(reading).read_to_string(&mut text).unwrap();
    let numbers: Vec<u64> = text
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["sequence"].as_u64().unwrap())
        .collect();
    assert!(numbers.len() > 200, "{} lines", numbers.len());
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "a line for each frame");
    drop(stalled);
    assert!(live.wait().unwrap().success());
}

/// Networks for `skin16` with the name of the shipped one but another version.
fn retrained(at: &Workplace, folder: &str) {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-learn/models/skin16/shapes");
    std::fs::create_dir(at.path(folder)).unwrap();
    let card = std::fs::read_to_string(shipped.join("card.json")).unwrap();
    let card = card.replacen("\"version\": \"", &format!("\"version\": \"{folder} of "), 1);
    at.write(&format!("{folder}/card.json"), card);
    std::fs::copy(shipped.join("weights.safetensors"), at.path(&format!("{folder}/weights.safetensors"))).unwrap();
}

#[test]
fn what_was_recorded_with_a_network_of_ones_own_is_replayed_with_it_and_no_other() {
    let at = Workplace::new();
    retrained(&at, "own");
    retrained(&at, "other");
    let run = "live skin16 --serve off --touch press --threshold 0.3 --for 3.4 --record own.mcap --method ./own";
    let output = at.run(run);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    refused(&at, "replay own.mcap", &["own.mcap", "recorded with `./own`", "--method FOLDER"]);
    refused(&at, "replay own.mcap --method ./other", &["own.mcap", "other is another one", "card"]);
    std::fs::rename(at.path("own"), at.path("moved")).unwrap();
    let contacts = at.good("replay own.mcap --method ./moved --contacts");
    assert!(contacts.lines().any(|line| line.contains("position_m")));
    let played = "live skin16 --serve off --speed 4 --jsonl - --source replay:own.mcap";
    refused(&at, played, &["recorded with `./own`", "--method FOLDER"]);
    let output = at.run(&format!("{played} --method ./moved"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    let told = lines.lines().filter(|line| !line.is_empty());
    let told = told.map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["contacts"].clone());
    let replayed = contacts.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    assert!(told.eq(replayed), "the contacts of the replay");
}

#[test]
fn who_stops_reading_standard_output_does_not_keep_it_from_ending() {
    let at = Workplace::new();
    let run = format!("{DISK} --prerender 200 --rate 1000 --jsonl - --for 4 --record held.mcap --state kept.json");
    let begun = Instant::now();
    // Standard output is not read; the pipe buffer has 64 KiB.
    let mut live = at.command(&run).spawn().unwrap();
    let mut told = String::new();
    live.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert!(begun.elapsed() < Duration::from_secs(15), "{told}");
    assert!(live.wait().unwrap().success(), "{told}");
    assert!(told.contains("warning: lines of JSON: too slow") && told.contains("dropped by lines of JSON"), "{told}");
    assert_eq!(at.json("recover held.mcap -o again.mcap --json")["was_whole"], true);
    assert!(at.path("kept.json").exists());
}

#[cfg(not(feature = "ros2"))]
#[test]
fn ros2_without_its_feature_names_the_command_that_installs_it() {
    let at = Workplace::new();
    let words = ["--ros2", "cargo install --locked --path dermis-cli --features ros2"];
    refused(&at, &format!("{DISK} --for 1 --record a.mcap --ros2"), &words);
    assert!(!at.path("a.mcap").exists(), "a recording that never began");
}

#[test]
fn what_was_recorded_with_a_calibration_is_replayed_with_that_one() {
    let at = Workplace::empty();
    at.run("experiment skin16 --twin lab --seed 1 --sets random --presses 80 -o set");
    let set = "--frames set/random/frames.npy --baseline set/random/baseline.npy --truth set/random/truth.csv";
    for (labels, name) in [("0..40", "own"), ("40..80", "other")] {
        at.run(&format!("calibrate skin16 {set} --labels {labels} --method refined -o {name} --force"));
    }
    for (method, name) in [("./own", "own.mcap"), ("noser", "noser.mcap")] {
        at.run(&format!("live skin16 --method {method} --touch press --serve off --for 3 --record {name}"));
    }
    let replayed = at.run("replay own.mcap --method ./own --summary");
    assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
    refused(&at, "replay own.mcap", &["recorded with `./own`", "--method FOLDER"]);
    let unused = at.run("replay noser.mcap --method ./own --summary");
    assert!(String::from_utf8_lossy(&unused.stderr).contains("./own is not used for it"));
    std::fs::rename(at.path("own"), at.path("before")).unwrap();
    std::fs::rename(at.path("other"), at.path("own")).unwrap();
    refused(&at, "replay own.mcap --method ./own", &["./own is another one"]);
}

/// A device that measures nothing is told, though there is no frame to call stale.
#[test]
fn a_device_without_a_frame_is_told() {
    let at = Workplace::new();
    let output = at.run("live skin16 --method noser --serve off --for 5 --fault silent@0+100 --jsonl -");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.stdout.is_empty() && text.contains("no frame has arrived"), "{text}");
}
