//! Files and hands of users: each case is a folder whose README says what is right. Data without a stated licence lie beside the
//! project or in `DERMIS_DATA`; without them the tests print that they were skipped.

use crate::workplace::Workplace;

/// The exit code and what a command says on both outputs, in one line.
fn said(at: &Workplace, arguments: &str) -> (Option<i32>, String) {
    let output = at.run(arguments);
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    let plain: Vec<&str> = text.split_whitespace().filter(|word| !["│", "×"].contains(word)).collect();
    (output.status.code(), plain.join(" "))
}

fn refused(at: &Workplace, arguments: &str, words: &[&str]) {
    let (code, text) = said(at, arguments);
    assert!(code == Some(2) && words.iter().all(|word| text.contains(word)), "{arguments}: {code:?}: {text}");
    let (code, text) = said(at, &format!("{arguments} --force"));
    assert!(code == Some(0) && text.contains("warning"), "{arguments} --force: {code:?}: {text}");
}

/// The number of contacts that a command reports.
fn contacts(at: &Workplace, arguments: &str) -> usize {
    let (code, text) = said(at, arguments);
    assert_eq!(code, Some(0), "{arguments}: {text}");
    let number = text.split(": ").find_map(|part| part.split(' ').next()?.parse().ok());
    number.unwrap_or_else(|| panic!("{arguments}: {text}"))
}

#[test]
fn one_untouched_row_gives_no_contacts_out_of_nothing() {
    let Some(at) = Workplace::of_field_case("01-single-baseline-false-contacts") else { return };
    for baseline in ["u1.csv", "u20.csv"] {
        assert_eq!(contacts(&at, &format!("contacts disk.toml --frames v10.csv --baseline {baseline} -o c.csv")), 0);
    }
}

#[test]
fn a_frame_of_a_million_touches_is_refused() {
    let rows = |count: usize| "0,0.01,0.01\n".repeat(count);
    let at = Workplace::empty();
    at.write("most.csv", format!("frame,x_m,y_m\n{}", rows(1_000)));
    at.write("t.csv", format!("frame,x_m,y_m\n{}", rows(1_000_000)));
    at.good("forward tank16 --touches most.csv -o o.npy");
    let text = at.refused("forward tank16 --touches t.csv -o o.npy");
    assert!(text.contains("t.csv, row 1002") && text.contains("frame 0 has more than 1000 touches"), "{text}");
}

#[test]
fn a_surface_that_lacks_triangles_is_named() {
    let Some(at) = Workplace::of_field_case("live-10-stl-half") else { return };
    let (code, text) = said(&at, "mesh d.toml -o x.vtu");
    assert!(code == Some(0) && text.contains("b.stl: the surface has") && text.contains("open edges"), "{text}");
}

#[test]
fn amplitudes_in_a_signed_design_are_refused() {
    let Some(at) = Workplace::of_field_case("02-sign-wrong-silent") else { return };
    refused(
        &at,
        "contacts disk.toml --frames absf.csv --baseline absb.csv -o c.csv",
        &["signs turned", "amplitude_only"],
    );
}

#[test]
fn opposite_drives_and_measurements_are_said_to_be_ambiguous() {
    let Some(at) = Workplace::of_field_case("06-mirror-ambiguous-protocol") else { return };
    for design in ["opps.toml", "oppa.toml"] {
        let commands = [
            format!("forward {design} -o b.csv"),
            format!("forward {design} --touches touch2.csv -o f.csv"),
            format!("contacts {design} --frames f.csv --baseline b.csv -o c.csv"),
            format!("check-frames {design} --frames f.csv --baseline b.csv"),
        ];
        for command in commands {
            let (_, text) = said(&at, &command);
            assert!(text.contains("warning") && text.contains("cannot tell most places"), "{command}: {text}");
        }
    }
}

#[test]
fn frames_of_another_size_than_their_baseline_are_refused() {
    let Some(at) = Workplace::of_field_case("07-frames-baseline-scale-mismatch") else { return };
    refused(&at, "contacts disk.toml --frames x10.csv --baseline base.csv -o c.csv", &["x10.csv", "0.109 times"]);
    refused(&at, "contacts u16.toml --frames ex_diff.csv --baseline ex_ref.csv --both-signs -o c.csv", &["ex_ref.csv"]);
}

#[test]
fn a_finger_that_slides_is_not_late() {
    let Some(at) = Workplace::of_field_case("03-sliding-touch-late-false-alarm") else { return };
    for (frames, baseline) in [("circle_f.csv", "base.csv"), ("circle_50.csv", "base_50.csv")] {
        let (code, text) = said(&at, &format!("check-frames disk.toml --frames {frames} --baseline {baseline}"));
        assert!(code == Some(0) && !text.contains("late, channel"), "{frames}: {text}");
    }
}

#[test]
fn noise_has_no_order() {
    let Some(at) = Workplace::of_field_case("04-order-from-noise") else { return };
    for input in ["noise.csv --difference", "rand_3.csv --difference --truth rand_true.csv"] {
        let (_, text) = said(&at, &format!("check-frames disk.toml --frames {input}"));
        assert!(!text.contains("order, channel"), "{input}: {text}");
    }
}

#[test]
fn labels_of_other_frames_give_no_calibration() {
    let Some(at) = Workplace::of_field_case("08-calibrate-useless-no-warning") else { return };
    let command = "calibrate taros32.toml --frames diff.csv --difference --truth xy.csv --labels 0..60 -o cal";
    let (code, text) = said(&at, command);
    assert!(code == Some(2) && text.contains("always guessing the same place"), "{code:?}: {text}");
    assert!(!at.path("cal").exists());
    let (code, text) = said(&at, &format!("{command} --force"));
    assert!(code == Some(0) && text.contains("warning"), "{code:?}: {text}");
}

#[test]
fn positions_in_millimetres_are_not_aligned() {
    let Some(at) = Workplace::of_field_case("09-evaluate-align-mm") else { return };
    let input = "--frames rand_f.csv --baseline base.csv --truth rand_mm_nohdr.csv --align 50";
    let (code, text) = said(&at, &format!("evaluate disk.toml {input}"));
    assert!(code == Some(2) && text.contains("give x, y and z in metres"), "{code:?}: {text}");
}

#[test]
fn channels_at_driven_electrodes_are_no_faults() {
    let Some(at) = Workplace::of_field_case("11-driven-pair-channels-order") else { return };
    let (_, text) = said(&at, "check-frames iirc256.toml --frames iirc_rot_real.csv --baseline iirc_ref_real.csv");
    assert!(
        !["order, channel", "late, channel", "sign_turned", "dead"].iter().any(|kind| text.contains(kind)),
        "{text}"
    );
}

#[test]
fn a_disconnected_electrode_is_named() {
    let Some(at) = Workplace::of_field_case("15-dead-electrode-not-named") else { return };
    let (_, text) = said(&at, "check-frames disk.toml --frames dead_f.csv --baseline dead_b.csv");
    assert!(text.contains("open_electrode, electrode 5") && !text.contains("sign_turned"), "{text}");
}

/// A tank with water: no fault of its wires is known.
#[test]
fn amplitudes_of_a_tank_are_checked() {
    let Some(at) = Workplace::of_field_case("18-amplitude-only-check-build") else { return };
    let json = at.json("check-build tank30.toml --frames planeA_vvRef.csv --json");
    assert_eq!(json["faults"].as_array().map(Vec::len), Some(0), "{json}");
}

#[test]
fn one_damaged_bit_costs_one_chunk() {
    let Some(at) = Workplace::of_field_case("live-07-recover-one-bit") else { return };
    let (code, text) = said(&at, "recover one-bit.mcap -o r.mcap");
    let frames: u64 = text.split(' ').nth(1).and_then(|number| number.parse().ok()).expect("a number of frames");
    assert!(code == Some(2) && frames >= 765 && text.contains("1 damaged part lost"), "{code:?}: {text}");
    let (code, text) = said(&at, "replay one-bit.mcap --summary");
    assert!(code == Some(2) && text.contains(&format!("{frames} frames")), "{code:?}: {text}");
    let (code, text) = said(&at, "convert one-bit.mcap -o tables");
    assert!(code == Some(2) && text.contains("1 damaged part lost"), "{code:?}: {text}");
}

#[test]
fn normalised_differences_are_free_of_gains_and_units() {
    let Some(at) = Workplace::of_field_case("16-normalised-not-normalised") else { return };
    let score = "evaluate disk.toml --frames gain_f.csv --baseline gain_b.csv --truth rand50.csv --method noser --json";
    let mean_m = |options: &str| {
        let score = at.json(&format!("{score} {options}"));
        assert_eq!(score["misses"].as_u64(), Some(0));
        score["localisation_m"]["mean"].as_f64().unwrap()
    };
    // The gains are 10 % off; divided by hand the error is 0.41 mm.
    let (plain_m, normalised_m) = (mean_m(""), mean_m("--weighting normalised"));
    assert!(normalised_m < 6e-4 && plain_m > 1e-3, "{plain_m} m, {normalised_m} m");
    // Kilo-ohm: the same image.
    at.good("reconstruct disk.toml --frames k_f.csv --baseline k_b.csv --weighting normalised -o k.csv");
    let most = std::fs::read_to_string(at.path("k.csv")).unwrap();
    let most = most.split([',', '\n']).filter_map(|value| value.parse().ok()).filter(|value: &f64| value.is_finite());
    let most = most.fold(0.0, |most: f64, value| most.max(value.abs()));
    assert!((0.05..5.0).contains(&most), "{most}");
}

#[test]
fn noise_in_place_of_frames_is_refused() {
    let Some(at) = Workplace::of_field_case("live-09-check-frames-nonsense") else { return };
    at.good("forward cylinder30 -o baseline.csv");
    let words = ["agrees with its baseline by", "same skin"];
    refused(&at, "contacts cylinder30 --frames noise.csv --baseline baseline.csv --method noser -o c.csv", &words);
}

#[test]
fn positions_one_row_off_are_named_in_noise() {
    let Some(at) = Workplace::of_field_case("14-truth-one-row-late-missed") else { return };
    let command = "check-frames lor.toml --frames lor_diff.csv --difference --truth lor_rob.csv";
    let (_, text) = said(&at, command);
    assert!(text.contains("1 row before it in the truth"), "{text}");
    // With the positions in their rows nothing is found.
    let truth = std::fs::read_to_string(at.path("lor_rob.csv")).unwrap();
    let rows: Vec<&str> = truth.lines().collect();
    let moved = [&rows[..1], &rows[..rows.len() - 1]].concat().join("\n");
    std::fs::write(at.path("lor_rob.csv"), moved).unwrap();
    let (_, text) = said(&at, command);
    assert!(!text.contains("in the truth"), "{text}");
}

#[test]
fn files_as_boards_write_them_are_read() {
    let Some(at) = Workplace::of_field_case("12-csv-messages") else { return };
    for frames in ["oe2.txt", "f_hdr.csv", "f_blank.csv"] {
        let (code, text) =
            said(&at, &format!("contacts disk.toml --frames {frames} --baseline base.csv -o a.csv --force"));
        assert_eq!(code, Some(0), "{frames}: {text}");
    }
    let (code, text) = said(&at, "reconstruct disk.toml --frames iirc_ref_complex.csv --difference -o x.npy");
    assert!(code == Some(2) && text.contains("256 complex values") && text.contains("--part real"), "{text}");
    // Driven electrodes are measured at too.
    let (code, text) =
        said(&at, "reconstruct disk.toml --frames iirc_ref_complex.csv --difference --part real -o x.npy");
    assert!(code == Some(2) && text.contains("too many values: 256"), "{text}");
}

#[test]
#[ignore = "slow: a calibration of 300 presses, half a minute"]
fn a_skin_that_drifts_is_calibrated_row_by_row() {
    let Some(at) = Workplace::of_field_case("../hydrogel") else { return };
    let files = "--frames ohmc16_down.csv --baseline ohmc16_up.csv --paired --truth ohmc16_pos.csv";
    // The commands warn: the design is only roughly that of the skin.
    let run = |arguments: String| {
        let output = at.run(&arguments);
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    run(format!("calibrate hyd16.toml {files} --labels 0..300 -o learnt"));
    let score = run(format!("evaluate hyd16.toml {files} --rows 300..500 --method ./learnt --json"));
    let score: serde_json::Value = serde_json::from_slice(&score).unwrap();
    let [mean_m, covered] = [&score["localisation_m"]["mean"], &score["covered"]].map(|value| value.as_f64().unwrap());
    println!("300 labels, 200 others: {:.2} mm, {:.1} % in the 95 % regions", 1e3 * mean_m, 100.0 * covered);
    assert!(mean_m < 3.1e-3 && (0.93..=0.97).contains(&covered), "{score}");
}

#[test]
fn what_a_workshop_cannot_make_stops_its_files_alone() {
    let Some(at) = Workplace::of_field_case("13-fabrication-blocks-forward") else { return };
    at.good("forward n64.toml -o x.csv");
    let (code, text) = said(&at, "fabricate n64.toml -o out");
    let is_said = text.contains("nearly meet: 0.68 mm are left between them") && text.contains("n64.toml:30:");
    assert!(code == Some(2) && is_said && !at.path("out").exists(), "{code:?}: {text}");
}

#[test]
fn electrodes_of_an_edge_may_be_rounded() {
    let Some(at) = Workplace::of_field_case("10-rim-position-rounding") else { return };
    at.good("forward belt5.toml -o x.csv");
}

#[test]
fn a_flat_body_from_a_file_is_drawn_from_above() {
    let Some(at) = Workplace::of_field_case("17-planar-mesh-view") else { return };
    for (view, name) in [("", "usual.svg"), ("--view unrolled", "unrolled.svg")] {
        at.good(&format!("plot chest_d.toml {view} -o {name}"));
    }
    let read = |name: &str| std::fs::read_to_string(at.path(name)).unwrap();
    assert_eq!(read("usual.svg"), read("unrolled.svg"));
    let is_flat = [">x (mm)</text>", ">y (mm)</text>", ">31</text>"].map(|text| read("usual.svg").contains(text));
    assert_eq!(is_flat, [true; 3]);
}
