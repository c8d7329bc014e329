//! Files that would take more than 1 GiB of memory or 20 s are errors that name the limit.
#![cfg(target_os = "linux")]

use crate::bounded;
use crate::workplace::{DISK, Workplace};
use std::fmt::Write;
use std::io::Write as _;
use std::time::Duration;

const MAX_TIME: Duration = Duration::from_secs(20);

/// Runs a command that must refuse a file within the limits; its message.
fn refused(at: &Workplace, arguments: &str, words: &[&str]) {
    let bounded::Ended { status, stderr } =
        bounded::run(at.folder(), arguments, MAX_TIME).unwrap_or_else(|why| panic!("dermis {arguments}: {why}"));
    assert!(stderr.len() < 10_000, "{} bytes are said about {arguments}", stderr.len());
    let said = stderr.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
    assert_eq!(status.code(), Some(2), "dermis {arguments}: {said}");
    words.iter().for_each(|word| assert!(said.contains(word), "dermis {arguments}: no `{word}` in: {said}"));
}

#[test]
fn tables_have_a_limit() {
    let at = Workplace::new();
    let contacts = |frames: &str, words: &[&str]| {
        refused(&at, &format!("contacts disk.toml --method noser --frames {frames} --difference -o x.csv"), words);
    };
    contacts("/dev/zero", &["/dev/zero", "256 MiB"]);
    let line = at.write("line.csv", "");
    let mut file = std::fs::File::create(line).unwrap();
    (0..1000).for_each(|_| file.write_all(&b"0,".repeat(500_000)).unwrap());
    contacts("line.csv", &["line.csv", "256 MiB"]);
    drop(file);
    at.write("line.csv", b"0,".repeat(100_000_000));
    contacts("line.csv", &["line.csv", "at most 10000000"]);
    at.write("line.csv", b"0\n".repeat(100_000_000));
    contacts("line.csv", &["line.csv", "at most 33554432"]);
    at.write("line.csv", "");
}

#[test]
fn frames_of_touches_have_a_limit() {
    let at = Workplace::new();
    for frame in ["100000000000", "999999999", "1e300"] {
        at.write("truth.csv", format!("frame,x_m,y_m\n{frame},0.01,0.01\n"));
        refused(&at, "forward disk.toml --touches truth.csv -o x.csv", &["truth.csv", "at most 800000"]);
    }
}

#[test]
fn designs_and_meshes_have_a_limit() {
    let at = Workplace::new();
    for length in ["1e-9", "1e-300"] {
        at.write("tiny.toml", DISK.replace("0.005", length).replace("electrode_edge_m = 0.0025", ""));
        refused(&at, "mesh tiny.toml", &["length_m", "at least 0.00001 m"]);
    }
    at.write("edges.toml", DISK.replace("0.0025", "1e-9"));
    refused(&at, "mesh edges.toml", &["electrode_edge_m", "at least 0.000001 m"]);
    at.write("line.toml", format!("{DISK}\nname = \"{}\"", "x".repeat(100_000_000)));
    refused(&at, "mesh line.toml", &["line.toml", "4 MiB"]);
    at.write("line.toml", format!("name = \"{}\"\n{DISK}", "x".repeat(3_000_000)));
    refused(&at, "mesh line.toml", &["line.toml", "`name` must have 1 to 200 bytes"]);
    at.write("line.toml", format!("{} = 1\n{DISK}", "x".repeat(3_000_000)));
    refused(&at, "mesh line.toml", &["line.toml", "unknown field"]);
    let many = |count| DISK.replace("layout.rim.count = 8", &positions(count));
    at.write("many.toml", many(1_000_000));
    refused(&at, "mesh many.toml", &["many.toml", "4 MiB"]);
    at.write("many.toml", many(150_000));
    refused(&at, "mesh many.toml", &["150000 electrodes", "1024"]);
    refused(&at, "mesh /dev/zero", &["/dev/zero", "4 MiB"]);

    // A square of 0.1 m whose last corner is far away.
    let far = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 100 100 0\nf 1 2 3\nf 2 4 3\n";
    at.write("far.obj", far);
    let body = "[body.mesh]\npath = \"far.obj\"\nunit_m = 1.0";
    let design = DISK.replace("[body.disk]\ndiameter_m = 0.1", body);
    let points = "layout.positions = [{ x_m = 0.01, y_m = 0.01, z_m = 0 }, { x_m = 0.06, y_m = 0.01, z_m = 0 }, \
                  { x_m = 0.01, y_m = 0.06, z_m = 0 }, { x_m = 0.04, y_m = 0.04, z_m = 0 }]";
    let design =
        design.replace("layout.rim.count = 8", points).replace("shape.arc.length_m = 0.005", "shape = \"point\"");
    let design = design.replace("contact_impedance_ohm_m = 0.01\n", "");
    at.write("far.toml", &design[..design.find("[image.grid]").unwrap()]);
    refused(&at, "mesh far.toml", &["far.obj", "100.000 m long", "at most 20 m"]);
    at.write("zero.toml", design[..design.find("[image.grid]").unwrap()].replace("far.obj", "zero.obj"));
    std::os::unix::fs::symlink("/dev/zero", at.path("zero.obj")).unwrap();
    refused(&at, "mesh zero.toml", &["zero.obj", "256 MiB"]);
}

/// Positions of electrodes on a disk.
fn positions(count: usize) -> String {
    let mut text = "layout.positions = [".to_string();
    (0..count).for_each(|_| write!(text, "{{x_m=0.01,y_m=0.02}},").unwrap());
    text + "]"
}

#[test]
fn settings_have_a_limit() {
    let at = Workplace::empty();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-study/recipes");
    let recipe = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let with = |name: &str, key: &str, value: &str| {
        let text = recipe(name);
        let line = text.lines().find(|line| line.trim_start().starts_with(key)).unwrap().to_string();
        at.write("recipe.toml", text.replacen(&line, &format!("{key} = {value}"), 1));
    };
    let simulate = "simulate cylinder30 --recipe recipe.toml --samples 16 --seed 1 -o out";
    for (key, value, limit) in [
        ("tip_radius_m", "[1e9, 1e9]", "0.00001 to 1"),
        ("force_n", "[1, 1e300]", "0.000001 to 10000"),
        ("thickness_m", "3", "0.00001 to 0.1"),
        ("correlation_m", "1e308", "at most 1000"),
    ] {
        with("fine-soft.toml", key, value);
        refused(&at, simulate, &[limit]);
    }
    with("gaussian.toml", "width_m", "[1e-300, 1]");
    refused(&at, simulate, &["0.0001 to 100"]);
    for (command, word) in [
        ("simulate cylinder30 --recipe /dev/zero --samples 16 --seed 1 -o out", "16 MiB"),
        ("benchmark cylinder30 --twin /dev/zero --method noser", "16 MiB"),
        ("emulate cylinder30 --touch ./zero", "16 MiB"),
        ("live cylinder30 --serve off --method noser --state /dev/zero", "128 MiB"),
    ] {
        let zero = at.path("zero");
        if !zero.exists() {
            std::fs::File::create(&zero).unwrap().set_len(1 << 32).unwrap();
        }
        refused(&at, command, &[word]);
    }
}
