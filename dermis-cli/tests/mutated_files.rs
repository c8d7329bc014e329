//! Mutated files of every kind that the program reads: no panic, no abort, at most 1 GiB of memory and 20 s. The command
//! succeeds, or refuses the file with exit code 2.
#![cfg(target_os = "linux")]

#[path = "../../fuzz/src/mutation.rs"]
mod mutation;

use crate::bounded;
use crate::workplace::Workplace;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Files in the ordinary tests, and with `--ignored`. `DERMIS_MUTATED_FILES` sets another number for both.
const FEW: usize = 200;
const MANY: usize = 10_000;
const SEED: u64 = 1;

const MAX_TIME: Duration = Duration::from_secs(20);

/// A kind of file.
struct Kind {
    /// Valid files, one of which is mutated; `{}` in the command is its name.
    files: &'static [&'static str],
    /// Files that are copied beside it.
    beside: &'static [&'static str],
    command: &'static str,
}

const fn kind(files: &'static [&'static str], beside: &'static [&'static str], command: &'static str) -> Kind {
    Kind { files, beside, command }
}

const OWN: &[&str] = &[
    "own/calibration.json",
    "own/mean.npy",
    "own/nodes.npy",
    "own/presses.npy",
    "own/triangles.npy",
    "own/variances.npy",
    "own/weights.npy",
    "own/whitening.npy",
];
const NET: &[&str] = &["net/card.json", "net/weights.safetensors"];
const SIMULATED: &[&str] = &["sim/run.json", "sim/manifest.json", "sim/samples-00000.safetensors"];
const RECORDINGS: &[&str] = &["press.mcap", "open.mcap", "lz4.mcap", "joined.mcap"];
const FRAMES: &[&str] = &["ohm.csv", "ohm.npy", "ohm.npz"];
const MSH: &[&str] = &["sheet_2.2_ascii.msh", "sheet_2.2_binary.msh", "sheet_4.1_ascii.msh", "sheet_4.1_binary.msh"];

const KINDS: &[Kind] = &[
    kind(RECORDINGS, &[], "replay {} --summary"),
    kind(RECORDINGS, &[], "recover {} -o out.mcap"),
    kind(&["press.mcap", "open.mcap", "joined.mcap"], &[], "convert {} -o out"),
    kind(&["disk.toml", "cylinder30.toml", "skin16.toml", "tank16.toml"], &[], "scan-table {} -o out.csv"),
    kind(&["disk.toml"], &[], "mesh {}"),
    kind(&["channels.csv"], &["table.toml"], "scan-table table.toml -o out.csv"),
    kind(&["plate.obj"], &["obj.toml"], "mesh obj.toml"),
    kind(&["plate.ply"], &["ply.toml"], "mesh ply.toml"),
    kind(&["plate.stl"], &["stl.toml"], "mesh stl.toml"),
    kind(MSH, &[], "mesh msh.toml"),
    kind(&["lab.toml", "harsh.toml"], &[], "live ../disk.toml --serve off --method noser --for 0 --twin {}"),
    kind(&["script.toml"], &[], "live ../disk.toml --serve off --method noser --for 0 --touch {}"),
    kind(&["state.json"], &[], "live ../disk.toml --serve off --method noser --for 0 --state {}"),
    kind(&["gaussian.toml", "fine-soft.toml"], &[], "simulate ../disk.toml --recipe {} --samples 2 --seed 1 -o out"),
    kind(SIMULATED, SIMULATED, "simulate ../disk.toml --verify sim"),
    kind(FRAMES, &[], "contacts ../disk.toml --method noser --frames {} --baseline ../rest.csv -o out.csv"),
    kind(FRAMES, &[], "contacts ../disk.toml --method noser --frames ../ohm.csv --baseline {} -o out.csv"),
    kind(FRAMES, &[], "check-frames ../disk.toml --frames {} --baseline ../rest.csv"),
    kind(FRAMES, &[], "check-build ../disk.toml --frames {} -o out.html"),
    kind(&["currents.csv"], &[], "check-build ../disk.toml --frames ../rest.csv --currents {} --json"),
    kind(&["disk.toml"], &[], "check-build {} --frames ../rest.csv"),
    kind(&["rest.csv"], &[], "fit ../disk.toml --frames {} -o out.toml"),
    kind(
        &["truth.csv"],
        &[],
        "evaluate ../disk.toml --method noser --frames ../ohm.csv --baseline ../rest.csv --truth {}",
    ),
    kind(&["truth.csv"], &[], "forward ../disk.toml --touches {} -o out.csv"),
    kind(&["truth.csv"], &[], "calibrate ../disk.toml --frames ../ohm.csv --baseline ../rest.csv --truth {} -o out"),
    kind(
        &["currents.csv"],
        &[],
        "reconstruct ../disk.toml --method noser --frames ../ohm.csv --baseline ../rest.csv --currents {} -o out.npy",
    ),
    kind(
        &["noise.csv"],
        &[],
        "reconstruct ../disk.toml --method noser --frames ../ohm.csv --baseline ../rest.csv --channel-noise {} -o o.npy",
    ),
    kind(OWN, OWN, "contacts ../disk.toml --method ./own --frames ../ohm.csv --baseline ../rest.csv -o out.csv"),
    kind(
        &["starts.json"],
        &[],
        "optimise ../disk.toml --twin ideal --noise 60 --starts 1 --rounds 0 --moves 1 --state {} -o o.toml",
    ),
    kind(&["arm.toml"], &["arm.urdf"], "robot run {} --for 0"),
    kind(&["arm.urdf"], &["tube.stl"], "robot links {}"),
    kind(
        &["arm.urdf"],
        &["tube.stl"],
        "new link {} base --along x:0.01..0.09 --around 10..170 --electrodes 8 -o out.toml",
    ),
    kind(
        &["tube.stl"],
        &["arm.urdf"],
        "new link arm.urdf base --along x:0.01..0.09 --around 10..170 --electrodes 8 -o out.toml",
    ),
    kind(NET, NET, "export skin16 --method ./net --onnx out.onnx"),
];

/// A folder with a valid file of each kind.
fn valid() -> Workplace {
    let at = Workplace::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let copy = |from: &str, to: &str| assert!(std::fs::copy(root.join(from), at.path(to)).unwrap() > 0);
    let names = [
        ("dermis/designs", "cylinder30.toml"),
        ("dermis/designs", "skin16.toml"),
        ("dermis/designs", "tank16.toml"),
        ("dermis-sim/twins", "lab.toml"),
        ("dermis-sim/twins", "harsh.toml"),
        ("dermis-study/recipes", "gaussian.toml"),
        ("dermis-study/recipes", "fine-soft.toml"),
    ];
    names.iter().for_each(|(folder, name)| copy(&format!("{folder}/{name}"), name));
    MSH.iter().for_each(|name| copy(&format!("data/bodies/{name}"), name));
    copy("data/recordings/disk12-lz4.mcap", "lz4.mcap");
    presses(&at);
    at.plates();
    let design = std::fs::read_to_string(at.path("disk.toml")).unwrap();
    at.write("table.toml", design.replace("\"adjacent_undriven\"", "{ table = \"channels.csv\" }"));
    at.good("scan-table disk.toml -o channels.csv");
    at.write(
        "arm.urdf",
        "<robot name=\"arm\"><link name=\"base\"><collision><geometry><mesh filename=\"tube.stl\"/></geometry></collision></link>\
         <link name=\"hand\"/><joint name=\"wrist\" type=\"revolute\"><parent link=\"base\"/><child link=\"hand\"/>\
         <origin xyz=\"0 0 0.1\" rpy=\"0 0.5 0\"/><axis xyz=\"0 1 0\"/><limit velocity=\"3\"/></joint></robot>",
    );
    at.write(
        "arm.toml",
        "name = 'arm'\ndescription = 'arm.urdf'\n[[skin]]\nname = 'palm'\ndesign = '../disk.toml'\nlink = 'hand'\nmethod = 'noser'\n\
         origin = { xyz_m = [0, 0, 0.01], rpy_rad = [0, 1.5, 0] }\nsource = 'tcp:127.0.0.1:9'\nserial = 3\n[[rule]]\nname = 'stop'\n\
         on = ['p*']\nwhen = { force_n = 2.0 }\nclear_s = 0.1\n",
    );
    at.write("tube.stl", tube());
    let search = "--twin ideal --noise 60 --starts 1 --rounds 0 --moves 1";
    at.good(&format!("optimise disk.toml {search} --state starts.json -o optimised.toml"));
    at.write(
        "script.toml",
        "repeat_s = 10.0\n[[touch]]\nat_s = 0.1\nfor_s = 2.0\nfrom = [0.01, 0.01, 0]\nforce_n = 2.0\n",
    );
    let live = "live disk.toml --serve off --method noser --touch script.toml --for 0.9 --record press.mcap --state state.json";
    assert!(at.run(live).status.success());
    at.write("open.mcap", opened(&std::fs::read(at.path("press.mcap")).unwrap()));
    at.write("joined.mcap", std::fs::read(at.path("open.mcap")).unwrap().repeat(2));
    at.good("simulate disk.toml --recipe gaussian.toml --samples 4 --seed 1 -o sim");
    at.good("simulate --finish sim");
    std::fs::create_dir(at.path("net")).unwrap();
    NET.iter().for_each(|name| copy(&name.replace("net/", "dermis-learn/models/skin16/shapes/"), name));
    at
}

/// A tube of 12 sides along x, as a text.
fn tube() -> String {
    let vertex = |x: f64, side: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / 12.0).sin_cos();
        format!("vertex {x} {:.4} {:.4}\n", 0.04 * cos, 0.04 * sin)
    };
    let facet = |corners: String| format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n");
    let side = |side: u32| {
        let [a, b] = [side, side + 1].map(|side| vertex(0.0, side));
        let [c, d] = [side, side + 1].map(|side| vertex(0.1, side));
        facet(format!("{a}{b}{c}")) + &facet(format!("{b}{d}{c}"))
    };
    format!("solid tube\n{}endsolid tube\n", (0..12).map(side).collect::<String>())
}

/// Presses of the disk, and a calibration.
fn presses(at: &Workplace) {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut truth = "frame,x_m,y_m,force_n\n".to_string();
    for frame in 0..24 {
        let (radius, angle) = (0.04 * random.random::<f64>().sqrt(), std::f64::consts::TAU * random.random::<f64>());
        let force = 1.0 + 3.0 * random.random::<f64>();
        truth += &format!("{frame},{:.4},{:.4},{force:.2}\n", radius * angle.cos(), radius * angle.sin());
    }
    at.write("truth.csv", truth);
    at.write("currents.csv", "1,1,1,1,1,1,1,1\n");
    at.write("noise.csv", ["0.1"; 40].join(","));
    at.good("forward disk.toml -o rest.csv");
    for extension in ["csv", "npy", "npz"] {
        at.good(&format!("forward disk.toml --touches truth.csv -o ohm.{extension}"));
    }
    at.good("calibrate disk.toml --frames ohm.csv --baseline rest.csv --truth truth.csv -o own");
}

/// A recording whose chunks are neither compressed nor checked, so that mutations reach their contents.
fn opened(bytes: &[u8]) -> Vec<u8> {
    use mcap::records::Record;
    let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false).profile("ros2");
    let mut writer = mcap::Writer::with_options(std::io::Cursor::new(Vec::new()), options).unwrap();
    let reader = mcap::read::ChunkFlattener::new(bytes).unwrap();
    for record in reader.take_while(|record| !matches!(record, Ok(Record::DataEnd(_)))) {
        match record.unwrap() {
            Record::Schema { header, data } => {
                writer.add_schema_with_id(header.id, &header.name, &header.encoding, &data).unwrap();
            }
            Record::Channel(channel) => {
                let mcap::records::Channel { id, schema_id, topic, message_encoding, metadata } = channel;
                writer.add_channel_with_id(id, schema_id, &topic, &message_encoding, &metadata).unwrap();
            }
            Record::Message { header, data } => writer.write_to_known_channel(&header, &data).unwrap(),
            Record::Attachment { header, data, .. } => {
                let mcap::records::AttachmentHeader { log_time, create_time, name, media_type } = header;
                writer.attach(&mcap::Attachment { log_time, create_time, name, media_type, data }).unwrap();
            }
            Record::Metadata(metadata) => writer.write_metadata(&metadata).unwrap(),
            _ => {}
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// Runs a command on files in a folder of its own; what is wrong with how it ended.
fn run(folder: &Path, command: &str) -> Result<i32, String> {
    let bounded::Ended { status, stderr } = bounded::run(folder, command, MAX_TIME)?;
    match status.code() {
        Some(code @ (0 | 2)) if !stderr.contains("panicked") => Ok(code),
        _ => Err(format!("{status}: {}", stderr.chars().take(2000).collect::<String>())),
    }
}

/// Case `number`: a mutated file.
fn case(at: &Workplace, number: usize) -> Result<i32, String> {
    let kind = &KINDS[number % KINDS.len()];
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    random.set_stream(number as u64);
    let name = kind.files[random.random_range(0..kind.files.len())];
    let bytes = mutation::mutated(&[std::fs::read(at.path(name)).unwrap()], &mut random);
    run_kind(at, kind, name, &bytes, number)
}

/// Runs the command of a kind on a file with some bytes. Returns the exit code; the folder of a finding is kept.
fn run_kind(at: &Workplace, kind: &Kind, name: &str, bytes: &[u8], number: usize) -> Result<i32, String> {
    let folder = at.path(&format!("case-{number}"));
    std::fs::create_dir(&folder).unwrap();
    for beside in kind.beside {
        let to = folder.join(beside);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(at.path(beside), to).unwrap();
    }
    if kind.command == "mesh msh.toml" {
        std::fs::write(folder.join("msh.toml"), GROUPS.replace("NAME", name)).unwrap();
    }
    std::fs::write(folder.join(name), bytes).unwrap();
    let command = kind.command.replace("{}", name);
    let ended = run(&folder, &command);
    if ended.is_err() {
        let kept = std::env::temp_dir().join(format!("dermis-mutated-{number}"));
        let copied = Command::new("cp").arg("-r").arg(&folder).arg(&kept).status();
        assert!(copied.is_ok_and(|status| status.success()), "cannot copy to {}", kept.display());
        eprintln!("the files of case {number} are in {}", kept.display());
    }
    std::fs::remove_dir_all(folder).unwrap();
    ended.map_err(|why| format!("case {number}, {name}: dermis {command}: {why}"))
}

/// A design on a mesh with electrodes.
const GROUPS: &str = r#"
[body.mesh]
path = "NAME"
unit_m = 0.001
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape = "group"
layout.groups.count = 4
contact_impedance_ohm_m2 = 1e-5
[protocol]
pattern = "adjacent"
"#;

fn run_all(count: usize) {
    let count = std::env::var("DERMIS_MUTATED_FILES").ok().and_then(|text| text.parse().ok()).unwrap_or(count);
    let at = valid();
    let next = AtomicUsize::new(0);
    let work = || {
        let mut findings = Vec::new();
        let mut codes = [0; 3];
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                return (findings, codes);
            }
            match case(&at, number) {
                Ok(code) => codes[code as usize] += 1,
                Err(finding) => findings.push(finding),
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let results: Vec<_> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        running.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    let findings: Vec<_> = results.iter().flat_map(|(findings, _)| findings.clone()).collect();
    let of = |code: usize| results.iter().map(|(_, codes)| codes[code]).sum::<usize>();
    println!("{count} mutated files: {} read, {} refused, {} findings", of(0), of(2), findings.len());
    assert!(findings.is_empty(), "{}", findings.join("\n"));
    // Mutations that are all refused, or all read, would test little.
    assert!(of(0) > count / 10 && of(2) > count / 4, "{} read, {} refused", of(0), of(2));
}

#[test]
fn each_kind_is_read_where_it_is_valid() {
    let at = valid();
    for kind in KINDS {
        for name in kind.files {
            let bytes = std::fs::read(at.path(name)).unwrap();
            assert_eq!(run_kind(&at, kind, name, &bytes, 0), Ok(0), "{name}: {}", kind.command);
        }
    }
}

/// Values whose squares overflow are of no calibration.
#[test]
fn a_calibration_with_huge_values_is_refused() {
    let at = Workplace::new();
    presses(&at);
    for name in ["weights.npy", "whitening.npy", "presses.npy", "variances.npy"] {
        let path = at.path("own").join(name);
        let good = std::fs::read(&path).unwrap();
        let mut bytes = good.clone();
        let last = bytes.len() - 8;
        bytes[last..].copy_from_slice(&(-1e300f64).to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let said = at.refused("contacts disk.toml --method ./own --frames ohm.csv --baseline rest.csv -o contacts.csv");
        assert!(said.contains(name) && said.contains("-1e300") && said.contains("calibrate again"), "{said}");
        std::fs::write(&path, good).unwrap();
    }
}

#[test]
fn mutated_files_are_read_or_refused() {
    run_all(FEW);
}

#[test]
#[ignore = "slow: 10,000 files take minutes"]
fn ten_thousand_mutated_files_are_read_or_refused() {
    run_all(MANY);
}
