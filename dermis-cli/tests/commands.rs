//! The commands, as scripts use them: shapes of results, exit codes, messages.

use crate::workplace::{DISK, Workplace};
use std::path::{Path, PathBuf};

const VALUES: usize = 40;

/// Input files for several tests.
trait Inputs {
    /// Frames of the small skin: an untouched one, and one for each of several conductivity maps.
    fn frames(&self);
    fn cell_count(&self) -> usize;
    /// Runs a command that writes an NPY file.
    fn npy(&self, arguments: &str, name: &str) -> PathBuf;
}

impl Inputs for Workplace {
    fn frames(&self) {
        self.good("forward disk.toml -o rest.csv");
        let cells = self.cell_count();
        let touched = |from: usize| {
            let value = |cell: usize| if (from..from + 3).contains(&cell) { "1.5e-3" } else { "1e-3" };
            (0..cells).map(value).collect::<Vec<_>>().join(",")
        };
        self.write("cells.csv", format!("{}\n{}\n", touched(10), touched(40)));
        self.good("forward disk.toml --conductivity cells.csv -o frames.csv");
    }

    fn cell_count(&self) -> usize {
        let matrix = read_npy_shape(&self.npy("jacobian disk.toml --per cell -o per_cell.npy", "per_cell.npy"));
        matrix[1]
    }

    fn npy(&self, arguments: &str, name: &str) -> PathBuf {
        self.good(arguments);
        self.path(name)
    }
}

/// The shape in the header of an NPY file.
fn read_npy_shape(path: &Path) -> Vec<usize> {
    let bytes = std::fs::read(path).unwrap();
    let header = String::from_utf8_lossy(&bytes[..128]).into_owned();
    assert!(header.contains("'descr': '<f8'"), "{header}");
    let shape = header.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0;
    let shape: Vec<usize> =
        shape.split(',').filter(|side| !side.trim().is_empty()).map(|side| side.trim().parse().unwrap()).collect();
    let header_length = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!(header_length % 64, 0);
    assert_eq!(bytes.len() - header_length, 8 * shape.iter().product::<usize>());
    shape
}

/// The numbers of a CSV file.
fn read_csv(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect()
}

#[test]
fn results_have_the_shapes_that_scripts_expect() {
    let at = Workplace::new();
    at.frames();
    assert!(at.good("mesh disk.toml -o m.vtu").contains("nodes"));
    let report: serde_json::Value = serde_json::from_str(&at.good("mesh disk.toml --json")).unwrap();
    assert_eq!(report["electrodes"].as_array().unwrap().len(), 8);
    assert!((report["electrodes"][0]["size"].as_f64().unwrap() / 0.005 - 1.0).abs() < 0.01, "{report}");
    for mesh in ["m.msh", "m.stl"] {
        at.good(&format!("mesh disk.toml -o {mesh}"));
        assert!(at.path(mesh).is_file());
    }
    let frames = read_csv(&at.path("frames.csv"));
    assert_eq!((frames.len(), frames[0].len()), (2, VALUES));
    let cells = at.cell_count();
    let pixels = read_npy_shape(&at.npy("jacobian disk.toml -o j.npy", "j.npy"));
    assert_eq!(pixels[0], VALUES);
    assert!(pixels[1] > 40 && pixels[1] <= 64, "the pixels that overlap the disk: {}", pixels[1]);
    let input = "disk.toml --frames frames.csv --baseline rest.csv";
    let images = at.npy(&format!("reconstruct {input} -o images.npy"), "images.npy");
    assert_eq!(read_npy_shape(&images), [2, 8, 8]);
    let images = at.npy(&format!("reconstruct {input} --per cell --alpha 0.1 -o cells.npy"), "cells.npy");
    assert_eq!(read_npy_shape(&images), [2, cells]);
    at.good(&format!("reconstruct {input} -o images.csv"));
    let images = read_csv(&at.path("images.csv"));
    assert_eq!((images.len(), images[0].len()), (2, 64));
    assert!(images[0][0].is_nan() && images[0][28].is_finite(), "NaN outside the disk, numbers inside");
    at.good(&format!("reconstruct {input} -o images.vtu"));
    let mesh = std::fs::read_to_string(at.path("images.vtu")).unwrap();
    assert!(mesh.contains("Name=\"frame 0\"") && mesh.contains("Name=\"frame 1\""), "a field for each frame");
    assert!(at.refused(&format!("reconstruct {input} -o images.mat")).contains(".npy, .npz, .csv or .vtu"));
    at.good(&format!("contacts {input} -o contacts.csv"));
    let contacts = std::fs::read_to_string(at.path("contacts.csv")).unwrap();
    let header = "frame,id,x_m,y_m,z_m,normal_x,normal_y,normal_z,force_n,force_sd_n,strength,area_m2,direction_x,direction_y,\
                  direction_z,half_length_m,half_width_m,edge_m,sd_m,confidence,theta_rad\n";
    assert!(contacts.starts_with(header), "{contacts}");
    let first: Vec<&str> = contacts.lines().nth(1).expect("a contact").split(',').collect();
    assert_eq!((first.len(), first[20]), (21, ""), "theta is empty except on cylinders");
}

/// A disconnected electrode shows in the untouched frames: its channels are left out, as with `--leave-out`.
#[test]
fn channels_that_scatter_in_the_untouched_frames_are_left_out() {
    let at = Workplace::new();
    at.frames();
    let rest = &read_csv(&at.path("rest.csv"))[0];
    let broken = [3, 4, 17];
    let row = |k: usize| {
        let value = |(channel, value): (usize, &f64)| {
            let noise = ((7 * k * k + 13 * channel * (k + 1)) as f64).sin();
            (value + noise * if broken.contains(&channel) { 50.0 } else { 1e-3 }).to_string()
        };
        rest.iter().enumerate().map(value).collect::<Vec<_>>().join(",")
    };
    at.write("untouched.csv", (0..20).map(|k| row(k) + "\n").collect::<String>());
    let input = "contacts disk.toml --frames frames.csv --baseline untouched.csv --method noser";
    let said = at.run(&format!("{input} -o found.csv"));
    let warning = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(warning.contains("3 channels of 40 scatter in the untouched frames"), "{warning}");
    assert!(warning.contains("(3-4, 17)"), "{warning}");
    at.good(&format!("{input} --leave-out 3,4,17 -o given.csv"));
    // Up to the area; deviations follow the noise of the untouched frames, which has one estimate without the channels.
    let places = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(at.path(name)).unwrap();
        text.lines().map(|line| line.split(',').take(12).collect::<Vec<_>>().join(",")).collect()
    };
    let [found, given] = ["found.csv", "given.csv"].map(places);
    assert!(found.len() > 2 && found == given, "{found:?} {given:?}");
}

#[test]
fn every_format_holds_the_same_frames() {
    let at = Workplace::new();
    at.frames();
    for name in ["frames.npy", "frames.npz"] {
        at.good(&format!("forward disk.toml --conductivity cells.csv -o {name}"));
        at.good(&format!("reconstruct disk.toml --frames {name} --baseline rest.csv -o {name}.csv"));
    }
    at.good("reconstruct disk.toml --frames frames.csv --baseline rest.csv -o csv.csv");
    let expected = std::fs::read(at.path("csv.csv")).unwrap();
    assert_eq!(std::fs::read(at.path("frames.npy.csv")).unwrap(), expected);
    assert_eq!(std::fs::read(at.path("frames.npz.csv")).unwrap(), expected);
}

#[test]
fn differences_are_used_unchanged() {
    let at = Workplace::new();
    at.frames();
    let rest = &read_csv(&at.path("rest.csv"))[0];
    let rows: Vec<String> = read_csv(&at.path("frames.csv"))
        .iter()
        .map(|frame| frame.iter().zip(rest).map(|(a, b)| format!("{:?}", a - b)).collect::<Vec<_>>().join(","))
        .collect();
    at.write("differences.csv", rows.join("\r\n"));
    at.good("reconstruct disk.toml --frames frames.csv --baseline rest.csv --alpha 0.1 -o a.csv");
    at.good("reconstruct disk.toml --frames differences.csv --difference --alpha 0.1 -o b.csv");
    assert_eq!(std::fs::read(at.path("a.csv")).unwrap(), std::fs::read(at.path("b.csv")).unwrap());
    let both = at.refused("reconstruct disk.toml --frames frames.csv --baseline rest.csv --difference -o c.csv");
    assert!(both.contains("cannot be used with"), "{both}");
    let neither = at.refused("reconstruct disk.toml --frames frames.csv -o c.csv");
    assert!(neither.contains("--baseline") && neither.contains("--difference"), "{neither}");
}

#[test]
fn alpha_is_a_number_or_a_rule() {
    let at = Workplace::new();
    at.frames();
    let run = |alpha: &str| format!("reconstruct disk.toml --frames frames.csv --baseline rest.csv {alpha} -o a.csv");
    for alpha in ["--alpha 0.1", "--alpha auto", "--alpha noise-figure:0.7", "--alpha noise-figure"] {
        at.good(&run(alpha));
    }
    // These two rules use the frames, which need some noise for an optimal alpha.
    let noisy: Vec<String> = read_csv(&at.path("frames.csv"))
        .iter()
        .map(|frame| {
            let noise = |channel: usize| 0.002 * ((channel * 7919) % 101) as f64 - 0.1;
            let row = frame.iter().enumerate().map(|(channel, value)| format!("{}", value + noise(channel)));
            row.collect::<Vec<_>>().join(",")
        })
        .collect();
    at.write("noisy.csv", noisy.join("\n"));
    for alpha in ["l-curve", "gcv"] {
        at.good(&format!("reconstruct disk.toml --frames noisy.csv --baseline rest.csv --alpha {alpha} -o b.csv"));
    }
    at.good(&run("--alpha-absolute 0.1"));
    let absolute = std::fs::read(at.path("a.csv")).unwrap();
    at.good(&run("--alpha 0.1 --alpha-absolute"));
    assert_eq!(std::fs::read(at.path("a.csv")).unwrap(), absolute);
    for wrong in ["--alpha -1", "--alpha 0", "--alpha nan", "--alpha much", "--alpha noise-figure:x"] {
        at.refused(&run(wrong));
    }
    assert!(at.refused(&run("--alpha-absolute")).contains("--alpha-absolute needs a number"));
    assert!(at.refused(&run("--alpha 1 --alpha-absolute 2")).contains("two values of alpha"));
}

#[test]
fn methods_are_distinguished() {
    let at = Workplace::new();
    at.frames();
    for method in ["noser", "tikhonov", "laplace"] {
        at.good(&format!(
            "reconstruct disk.toml --frames frames.csv --baseline rest.csv --method {method} --alpha 0.1 -o {method}.csv"
        ));
    }
    let image = |name: &str| std::fs::read(at.path(name)).unwrap();
    assert_ne!(image("noser.csv"), image("tikhonov.csv"));
    assert_ne!(image("noser.csv"), image("laplace.csv"));
    at.good(
        "reconstruct disk.toml --frames frames.csv --baseline rest.csv --method gauss-newton --alpha 0.1 -o gn.csv",
    );
    at.good("reconstruct disk.toml --frames frames.csv --baseline rest.csv --method tv --leave-out 0-2,7 -o tv.csv");
    at.good(
        "reconstruct disk.toml --frames frames.csv --baseline rest.csv --method greit --alpha noise-figure:1 -o g.csv",
    );
    assert_ne!(image("noser.csv"), image("gn.csv"));
    let wrong =
        at.refused("reconstruct disk.toml --frames frames.csv --baseline rest.csv --method greit --alpha 1 -o g.csv");
    assert!(wrong.contains("noise-figure"), "{wrong}");
    let wrong = at.refused("reconstruct disk.toml --frames frames.csv --baseline rest.csv --leave-out 40 -o a.csv");
    assert!(wrong.contains("cannot leave channel 40 out: the channels are 0 to 39"), "{wrong}");
    let wrong = at.refused("reconstruct disk.toml --frames frames.csv --baseline rest.csv --method noise -o a.csv");
    assert!(wrong.contains("noser"), "{wrong}");
}

#[test]
fn an_evaluation_is_a_table_or_json() {
    let at = Workplace::new();
    at.frames();
    at.write("truth.csv", "frame,x_m,y_m,force_n\n0,0.01,0.02,2\n1,-0.02,0,1\n");
    let input = "evaluate disk.toml --frames frames.csv --baseline rest.csv --truth truth.csv";
    assert!(at.good(input).contains("mm"));
    let json: serde_json::Value = serde_json::from_str(&at.good(&format!("{input} --json"))).unwrap();
    assert_eq!(json["presses"], 2);
    for key in ["misses", "false_positives", "localisation_m", "eq11_m", "sensitivity_spread", "method", "alpha"] {
        assert!(json.get(key).is_some(), "{key}");
    }
    for key in ["mean", "sd", "median", "p95"] {
        assert!(json["eq11_m"][key].is_number(), "{key}");
    }
    at.write("truth.csv", "frame,x_m,y_m\n0,0,0\n2,0,0\n");
    assert!(at.refused(input).contains("truth.csv, row 3, column 1: frame 2 does not exist: the frames are 0 to 1"));
    at.write("truth.csv", "frame,x_m,y_m\n0,10,20\n1,-20,0\n");
    let wrong = at.refused(input);
    assert!(wrong.contains("truth.csv, row 2:") && wrong.contains("it seems to be in millimetres"), "{wrong}");
    let wrong = at.refused("forward disk.toml --touches truth.csv -o frames.csv");
    assert!(wrong.contains("truth.csv, row 2:") && wrong.contains("it seems to be in millimetres"), "{wrong}");
    // An extra frame is reported.
    at.write("truth.csv", "frame,x_m,y_m\n0,0.01,0.02\n");
    let output = at.run(input);
    let said = String::from_utf8_lossy(&output.stderr);
    let named = "truth.csv has its last touch in frame 0, of 2 frames: those after it count as untouched";
    assert!(output.status.success() && said.contains(named), "{said}");
}

/// Touches on a Fermat spiral, in the coordinate frame of the skin and in that of a robot: rotated by 30 degrees,
/// mirrored, origin 0.4 m away. (The same model simulates and reconstructs: this tests the coordinate frames.)
#[test]
fn presses_in_a_robots_frame_are_aligned_first() {
    let at = Workplace::new();
    let (mut skin, mut robot) = (String::from("frame,x_m,y_m\n"), String::new());
    let (sin, cos) = 30f64.to_radians().sin_cos();
    for k in 0..40 {
        let (radius, angle) = (0.03 * (f64::from(k) / 40.0).sqrt(), 2.4 * f64::from(k));
        let (x, y) = (radius * angle.cos(), radius * angle.sin());
        skin += &format!("{k},{x},{y}\n");
        robot += &format!("{},{},0.02\n", 0.4 + cos * x + sin * y, 0.1 + sin * x - cos * y);
    }
    at.write("skin.csv", skin);
    at.write("robot.csv", robot);
    at.good("forward disk.toml --touches skin.csv -o frames.csv");
    at.good("forward disk.toml -o rest.csv");
    let input = "evaluate disk.toml --frames frames.csv --baseline rest.csv --truth robot.csv";
    let json: serde_json::Value = serde_json::from_str(&at.good(&format!("{input} --align 20 --json"))).unwrap();
    assert_eq!(json["presses"], 20);
    assert_eq!(json["aligned_by"], 20);
    assert_eq!(json["alignment"]["mirrored"], true);
    let near = |value: &serde_json::Value, wanted: f64, by: f64| (value.as_f64().unwrap() - wanted).abs() < by;
    assert!(near(&json["alignment"]["centre_m"][0], 0.4, 0.002) && near(&json["alignment"]["centre_m"][1], 0.1, 0.002));
    assert!(near(&json["alignment"]["rotation_rad"], 30f64.to_radians(), 0.1), "{json}");
    assert!(json["localisation_m"]["mean"].as_f64().unwrap() < 0.006, "{json}");
    assert!(at.good(&format!("{input} --align 20")).contains("seen mirrored"));

    assert!(at.refused(input).contains("align with --align N"));
    assert!(at.refused(&format!("{input} --align 40")).contains("40"));
    assert!(at.refused(&format!("{input} --align 20 --alpha 1")).contains("cannot be used with"));
    let own = input.replace("robot.csv", "skin.csv");
    assert!(at.refused(&format!("{own} --align 20")).contains("nothing to align"));
}

#[test]
fn a_new_design_is_read_and_meshed_as_it_is() {
    let at = Workplace::empty();
    for body in ["cylinder", "disk", "rectangle", "mesh"] {
        at.good(&format!("new {body}"));
        at.good(&format!("mesh {body}.toml -o {body}.vtu"));
    }
    assert!(at.refused("new disk").contains("exists already"));
    at.good("new disk --force");
    at.good("new disk -o other.toml");
    assert!(at.path("other.toml").is_file());
}

#[test]
fn the_schema_is_json() {
    let schema: serde_json::Value = serde_json::from_str(&Workplace::new().good("schema")).unwrap();
    assert!(schema["properties"]["electrodes"].is_object());
    let schema: serde_json::Value = serde_json::from_str(&Workplace::new().good("schema --twin")).unwrap();
    assert!(schema["properties"]["electronics"].is_object());
}

#[test]
fn a_wrong_design_is_shown_with_its_line() {
    let at = Workplace::new();
    let refused = |from: &str, to: &str| {
        at.write("bad.toml", DISK.replace(from, to));
        at.refused("mesh bad.toml -o m.vtu")
    };
    let message = refused("diameter_m", "diametre_m");
    assert!(message.contains("unknown field `diametre_m`") && message.contains("bad.toml:3:1"), "{message}");
    assert!(message.contains("help: did you mean `diameter_m`?"), "{message}");
    assert!(refused("diameter_m = 0.1", "diameter_mm = 100").contains("bad.toml:3:1"));
    assert!(refused("diameter_m = 0.1", "diameter_m = \"0.1 m\"").contains("invalid type: string"));
    assert!(refused("diameter_m = 0.1", "diameter_m = 100").contains("lengths are in metres"));
    assert!(refused("count = 8", "count = 3").contains("3 electrodes are too few"));
    assert!(refused("length_m = 0.005", "length_m = 0.05").contains("electrodes 0 and 1 overlap"));
    assert!(refused("touch = \"conductance_rises\"", "").contains("missing field `touch`"));
    assert!(!at.path("m.vtu").exists());
    let message = at.refused("mesh cylinder31 -o m.vtu");
    assert!(message.contains("did you mean `cylinder30`?"), "{message}");
    at.write("bad.toml", [0xff, 0xfe, 0x00]);
    assert!(at.refused("mesh bad.toml -o m.vtu").contains("bad.toml"));
}

#[test]
fn a_protocol_must_fit_the_electrodes_and_the_frames() {
    let at = Workplace::new();
    at.frames();
    let refused = |rows: &str| {
        at.write("channels.csv", format!("channel,drive_source,drive_sink,measure_plus,measure_minus\n{rows}"));
        at.write("bad.toml", DISK.replace("pattern = \"adjacent_undriven\"", "pattern.table = \"channels.csv\""));
        at.refused("reconstruct bad.toml --frames frames.csv --baseline rest.csv -o a.csv")
    };
    assert!(refused("0,0,1,2,8\n").contains("channels.csv, line 2: names electrode 8"));
    assert!(refused("0,3,3,1,2\n").contains("drives electrode 3 against itself"));
    assert!(refused("0,0,1,2,3\n").contains("too many values: 40, but frames of this protocol have 1"));
}

#[test]
fn results_go_to_standard_output_too() {
    let at = Workplace::new();
    at.frames();
    let frames = "--frames frames.csv --baseline rest.csv";
    for command in
        ["forward disk.toml", &format!("contacts disk.toml {frames}"), &format!("reconstruct disk.toml {frames}")]
    {
        let printed = at.good(&format!("{command} -o -"));
        at.good(&format!("{command} -o file.csv"));
        assert_eq!(printed, std::fs::read_to_string(at.path("file.csv")).unwrap(), "{command}");
        let lines = at.good(&format!("{command} --json"));
        let first: serde_json::Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
        assert_eq!(first["frame"], 0, "{command}");
        assert!(at.refused(command).contains("--output"), "{command} without a place for its result");
    }
    assert!(!at.path("-").exists());
    assert!(at.refused("forward disk.toml --json -o x.csv").contains("--json"));
}

#[test]
fn an_experiment_has_the_sets_and_the_presses_that_are_asked_for() {
    let at = Workplace::new();
    at.good("experiment disk.toml --twin ideal --seed 1 --presses 7 --sets grid,two -o out");
    let frames = |set: &str| std::fs::read_to_string(at.path(&format!("out/{set}/truth.csv"))).ok();
    let last = |text: String| text.lines().last().unwrap().split(',').next().unwrap().parse::<usize>().unwrap() + 1;
    assert!((4..=7).contains(&last(frames("grid").unwrap())), "{:?}", frames("grid"));
    assert!((1..=7).contains(&last(frames("two").unwrap())), "{:?}", frames("two"));
    assert!(frames("random").is_none() && frames("four").is_none());
    assert!(at.refused("experiment disk.toml --seed 1 --sets all -o x").contains("random"));
    at.good("experiment disk.toml --twin ideal --seed 1 --presses 3 --sets four --touches 3 --apart 0.02 -o three");
    let truth = std::fs::read_to_string(at.path("three/several/truth.csv")).unwrap();
    assert_eq!(truth.lines().count(), 1 + 3 * 3, "{truth}");
}

#[test]
fn a_new_disk_has_as_many_electrodes_as_asked_for() {
    let at = Workplace::empty();
    for count in [4, 12, 200] {
        at.good(&format!("new disk --electrodes {count} --force -o d.toml"));
        let skin: serde_json::Value = serde_json::from_str(&at.good("mesh d.toml --json")).unwrap();
        assert_eq!(skin["electrodes"].as_array().unwrap().len(), count, "{skin}");
    }
    assert!(at.refused("new cylinder --electrodes 12").contains("[electrodes.layout]"));
}

#[test]
fn experiments_that_cannot_be_are_refused_and_leave_nothing() {
    let at = Workplace::new();
    assert!(at.refused("experiment disk.toml --twin lap --seed 1 -o out").contains("did you mean `lab`?"));
    at.write("twin.toml", include_str!("../../dermis-sim/twins/lab.toml").replace("rms = 0.10 ", "rms = 10.0 "));
    let message = at.refused("experiment disk.toml --twin twin.toml --seed 1 -o out");
    assert!(message.contains("`coat.rms` is 10") && message.contains("twin.toml"), "{message}");
    std::fs::create_dir(at.path("full")).unwrap();
    at.write("full/notes.txt", "mine");
    assert!(at.refused("experiment disk.toml --twin ideal --seed 1 -o full").contains("not empty"));
    assert!(at.path("full/notes.txt").exists());
    // The twin is drawn only after the folder was created: no partial output remains.
    at.write(
        "far.toml",
        include_str!("../../dermis-sim/twins/ideal.toml").replace("torn_wires = []", "torn_wires = [99]"),
    );
    assert!(at.refused("experiment disk.toml --twin far.toml --seed 1 -o out").contains("electrode 99"));
    let left: Vec<_> = std::fs::read_dir(at.folder()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with("out")), "{left:?}");
}

#[test]
fn bad_frames_are_named_by_row_and_column() {
    let at = Workplace::new();
    at.frames();
    let good = vec!["1"; VALUES].join(",");
    let refused = |frames: String| {
        at.write("bad.csv", frames);
        at.refused("reconstruct disk.toml --frames bad.csv --difference -o a.csv")
    };
    assert!(refused(String::new()).contains("bad.csv: the file is empty"));
    assert!(refused(format!("{good}\n{good},1\n")).contains("bad.csv, row 2: too many values: 41"));
    assert!(refused("1,2\n".into()).contains("bad.csv, row 1: too few values: 2"));
    assert!(
        refused(format!("{good}\n{}\n", good.replacen('1', "nan", 1)))
            .contains("row 2: channel 0 is NaN: mend the frame, or leave")
    );
    assert!(refused(format!("{good}\n{}\n", good.replacen('1', "inf", 1))).contains("row 2: channel 0 is inf"));
    assert!(
        refused(format!("{good}\n{}\n", good.replacen('1', "open", 1)))
            .contains("row 2, column 1: `open` is not a number")
    );
    at.write("mark.csv", format!("\u{feff}{good}\r\n{good}\r\n"));
    at.good("reconstruct disk.toml --frames mark.csv --difference -o a.csv");
}

#[test]
fn bad_conductivities_are_named_by_their_cell() {
    let at = Workplace::new();
    let cells = at.cell_count();
    for (value, said) in [("0", "is 0"), ("-1", "is -1"), ("nan", "is NaN")] {
        let mut row = vec!["1e-3"; cells];
        row[7] = value;
        at.write("cells.csv", row.join(","));
        let message = at.refused("forward disk.toml --conductivity cells.csv -o f.csv");
        assert!(message.contains(&format!("the conductivity of cell 7 {said}")), "{message}");
    }
    at.write("cells.csv", "1,1\n1,1\n");
    assert!(at.refused("forward disk.toml --conductivity cells.csv -o f.csv").contains("too few values: 2"));
    assert!(!at.path("f.csv").exists());
}

#[test]
fn results_that_cannot_be_written_are_said() {
    let at = Workplace::new();
    let missing = at.refused("forward disk.toml -o no/such/folder.csv");
    assert!(missing.contains("no/such/folder.csv: there is no folder no/such"), "{missing}");
    assert!(at.refused("mesh disk.toml -o mesh.xyz").contains(".vtu, .msh or .stl"));
    // Before anything is computed.
    let map = at.refused("bound disk.toml --map nowhere/x.svg");
    assert!(map.contains("--map nowhere/x.svg: there is no folder nowhere"), "{map}");
    assert!(at.refused("bound disk.toml --force-map x.jpg").contains(".svg or .png"));
    assert!(at.refused("bound disk.toml --map x.svg -o .").contains("--output .: it is a folder"));
    at.write("taken", "");
    assert!(at.refused("experiment disk.toml --seed 1 -o taken").contains("--output taken: it is a file"));
    let same = at.refused("bound disk.toml --force-map x.svg -o disk.toml");
    assert!(same.contains("--output disk.toml: the command reads this file"), "{same}");
    if cfg!(target_os = "linux") {
        assert!(at.refused("forward disk.toml -o /dev/full").contains("/dev/full: No space left"));
    }
}

#[test]
fn touches_off_the_body_are_warned_of() {
    let at = Workplace::new();
    at.write("truth.csv", "frame,x_m,y_m\n0,0.0,0.0\n1,0.052,0.0\n2,0.058,0.0\n");
    let output = at.run("forward disk.toml --touches truth.csv -o f.npy");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && said.contains("touches of the frame 2 lie off the body, by up to 8 mm"),
        "{said}"
    );
}

#[test]
fn outputs_that_a_command_cannot_write_are_refused() {
    let at = Workplace::new();
    at.good("forward disk.toml -o rest.csv");
    for (command, said) in [
        ("forward disk.toml -o x.json", "frames are written as .csv, .npy or .npz"),
        ("jacobian disk.toml -o x.mat", "matrices are written as .csv, .npy or .npz"),
        ("fit disk.toml --frames rest.csv -o -", "not written to standard output"),
        ("mesh disk.toml -o -", "not written to standard output"),
        (
            "contacts disk.toml --frames rest.csv --baseline rest.csv --method ./none -o c.csv",
            "is not the folder of a network",
        ),
        ("experiment disk.toml --seed 1 --sets random --apart 0.05 -o e", "are those of the set `four`"),
    ] {
        let refused = at.refused(command);
        assert!(refused.contains(said), "{command}: {refused}");
    }
    assert!(!at.path("-").exists() && !at.path("x.json").exists());
}

#[test]
fn sets_of_presses_that_have_no_room_are_named() {
    let at = Workplace::new();
    let none = at.refused("experiment disk.toml --seed 1 --sets four --presses 3 --apart 0.2 -o none");
    assert!(none.contains("none of the presses fits") && !at.path("none").exists(), "{none}");
    let output = at.run("experiment disk.toml --seed 1 --sets random,four --presses 3 --apart 0.2 -o some");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("the set `four` has 0 of 3 frames"), "{said}");
}

#[test]
fn a_mesh_that_is_coarse_at_the_ends_of_arcs_is_named() {
    let at = Workplace::new();
    at.write("plain.toml", format!("{DISK}correct_arc_ends = false\n"));
    let output = at.run("mesh plain.toml");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("at its ends are long for its "), "{said}");
    let report = at.json("mesh disk.toml --json");
    let ends = &report["electrodes"][0]["ends"];
    let error = ends["voltage_error"].as_f64().unwrap();
    assert!(error > 0.001 && error < 0.01 && ends["edge_m"].as_f64().unwrap() > 0.0025, "{ends}");
}

/// Pictures of a design take no frames; a matrix is written to standard output as frames are.
#[test]
fn options_that_would_do_nothing_are_refused() {
    let at = Workplace::new();
    at.good("forward skin16 -o frames.csv");
    assert!(at.refused("plot skin16 --what mesh --frames frames.csv -o p.svg").contains("--what image"));
    let matrix = at.good("jacobian skin16 -o -");
    assert!(matrix.lines().count() > 50 && matrix.contains(',') && !at.path("-").exists());
}
