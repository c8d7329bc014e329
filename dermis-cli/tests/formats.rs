//! Frames in other units, as complex values, with columns in any order, and with missing values: as `docs/field.md` lists them.

use crate::workplace::Workplace;
use std::fmt::Write;

/// Presses of the recording.
const PRESSES: usize = 24;

/// A folder with `disk.toml`, `rest.csv`, `touches.csv` and `ohm.csv`, a touch in each row.
fn recorded() -> Workplace {
    let at = Workplace::new();
    let mut touches = String::from("frame,x_m,y_m,force_n\n");
    for press in 0..PRESSES {
        let (radius_m, angle) = (0.005 + 0.0015 * press as f64, 2.4 * press as f64);
        let _ = writeln!(touches, "{press},{:.5},{:.5},3", radius_m * angle.cos(), radius_m * angle.sin());
    }
    at.write("touches.csv", touches);
    at.good("forward disk.toml -o rest.csv");
    at.good("forward disk.toml --touches touches.csv -o ohm.csv");
    at
}

fn text(at: &Workplace, name: &str) -> String {
    std::fs::read_to_string(at.path(name)).unwrap()
}

fn numbers(at: &Workplace, name: &str) -> Vec<Vec<f64>> {
    text(at, name).lines().map(|line| line.split(',').map(|value| value.parse().unwrap()).collect()).collect()
}

/// Writes both files of a recording anew, each value by its channel: `PREFIXohm.csv` and `PREFIXrest.csv`.
fn rewrite(at: &Workplace, prefix: &str, value: impl Fn(usize, f64) -> String) {
    for name in ["ohm.csv", "rest.csv"] {
        let cells = |row: &Vec<f64>| row.iter().enumerate().map(|(k, v)| value(k, *v)).collect::<Vec<_>>().join(",");
        let rows: Vec<String> = numbers(at, name).iter().map(cells).collect();
        at.write(&format!("{prefix}{name}"), rows.join("\n"));
    }
}

/// The images of a recording: the values of each.
fn images(at: &Workplace, prefix: &str, options: &str) -> Vec<f64> {
    let files = format!("--frames {prefix}ohm.csv --baseline {prefix}rest.csv");
    at.good(&format!("reconstruct disk.toml --method noser {files} {options} -o images.csv"));
    numbers(at, "images.csv").concat()
}

fn assert_same(expected: &[f64], found: &[f64], what: &str) {
    assert_eq!(expected.len(), found.len(), "{what}");
    let largest = expected.iter().filter(|value| value.is_finite()).fold(0.0_f64, |most, value| most.max(value.abs()));
    let off = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-9 * largest;
    assert!(largest > 0.0 && !expected.iter().zip(found).any(off), "{what}");
}

#[test]
fn units_and_currents_give_ohms() {
    let at = recorded();
    let expected = images(&at, "", "");
    rewrite(&at, "k_", |_, ohm| (ohm * 1e-3).to_string());
    assert_same(&expected, &images(&at, "k_", "--unit kohm"), "kilohm");
    // Of 1 mA, ohms are millivolts.
    assert_same(&expected, &images(&at, "", "--unit mV --current-a 0.001"), "millivolts");
    assert_same(&expected, &images(&at, "k_", "--current-a 0.001"), "volts");
    at.write("currents.csv", ["0.001"; 8].join(","));
    assert_same(&expected, &images(&at, "", "--unit mV --currents currents.csv"), "millivolts and measured currents");
    let run = |options: &str| {
        at.refused(&format!("contacts disk.toml --frames ohm.csv --baseline rest.csv {options} -o c.csv"))
    };
    assert!(run("--unit mV").contains("--current-a 0.001"));
    assert!(run("--unit ohm --current-a 0.001").contains("divided by the currents already"));
    assert!(run("--current-a 0.001 --currents currents.csv").contains("cannot be used with"));
    // A wrong unit is still found.
    let checked = at.good("check-frames disk.toml --frames ohm.csv --baseline rest.csv --unit kohm");
    assert!(checked.contains("magnitude") && checked.contains("1000.000"), "{checked}");
    let fitted = |options: &str| {
        at.json(&format!("fit disk.toml --json -o f.toml {options}"))["quantities"][0]["value"].as_f64().unwrap()
    };
    let (ohm, volt) = (fitted("--frames rest.csv"), fitted("--frames k_rest.csv --current-a 0.001"));
    assert!((ohm / volt - 1.0).abs() < 1e-9, "{ohm} {volt}");
}

#[test]
fn parts_of_complex_values_are_read() {
    let at = recorded();
    let expected = images(&at, "", "");
    rewrite(&at, "c_", |channel, ohm| format!("({ohm:?}{:+}j)", 0.01 * channel as f64 - 0.1));
    assert_same(&expected, &images(&at, "c_", "--part real"), "complex numbers");
    rewrite(&at, "p_", |channel, ohm| format!("{ohm:?},{:?}", 0.01 * channel as f64));
    assert_same(&expected, &images(&at, "p_", "--part real"), "pairs of columns");
    rewrite(&at, "i_", |channel, ohm| format!("{channel}.5,{ohm:?}"));
    assert_same(&expected, &images(&at, "i_", "--part imaginary"), "second columns");
    let run = |prefix: &str, options: &str| {
        let files = format!("--frames {prefix}ohm.csv --baseline {prefix}rest.csv");
        at.refused(&format!("contacts disk.toml {files} {options} -o c.csv"))
    };
    let without = run("c_", "");
    assert!(without.contains("960 complex values") && without.contains("--part real"), "{without}");
    assert!(run("", "--part real").contains("leave --part out"));
    assert!(run("p_", "").contains("--part"));
    assert!(run("p_", "--part magnitude").contains("amplitude_only = true"));
    // Amplitudes of a design without signs.
    let design = text(&at, "disk.toml");
    at.write("disk.toml", design.replace("pattern =", "amplitude_only = true\npattern ="));
    let expected = {
        rewrite(&at, "a_", |_, ohm| ohm.abs().to_string());
        images(&at, "a_", "")
    };
    rewrite(&at, "m_", |_, ohm| format!("{:?}-{:?}i", 0.6 * ohm, 0.8 * ohm.abs()));
    assert_same(&expected, &images(&at, "m_", "--part magnitude"), "magnitudes");
}

/// `ohm.csv` with a value of a row missing, as `name`.
fn without_value(at: &Workplace, name: &str, source: &str, rows: &[usize], channel: usize) {
    let lines = text(at, source);
    let line = |(row, line): (usize, &str)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if rows.contains(&row) {
            cells[channel] = "NaN";
        }
        cells.join(",")
    };
    at.write(name, lines.lines().enumerate().map(line).collect::<Vec<_>>().join("\n"));
}

/// What a command that succeeds prints and warns of.
fn said(at: &Workplace, arguments: &str) -> (String, String) {
    let output = at.run(arguments);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success(), "{arguments}: {err}");
    (out, err)
}

#[test]
fn single_frames_with_missing_values_are_not_used() {
    let at = recorded();
    without_value(&at, "gap.csv", "ohm.csv", &[4], 7);
    let contacts = "contacts disk.toml --method noser --baseline rest.csv --json --frames";
    let (whole, (rest, warning)) =
        (said(&at, &format!("{contacts} ohm.csv")).0, said(&at, &format!("{contacts} gap.csv")));
    assert!(warning.contains("gap.csv: 1 of 24 frames") && warning.contains("are not used: 4\n"), "{warning}");
    let expected: Vec<&str> = whole.lines().filter(|line| !line.contains("\"frame\":4,")).collect();
    assert_eq!(
        (expected.len(), rest.lines().collect::<Vec<_>>()),
        (PRESSES - 1, expected),
        "frames keep their numbers"
    );
    // The truth is left out with its frame: a press by press table as without the row.
    let evaluate = "evaluate disk.toml --method noser --baseline rest.csv --truth touches.csv";
    let score = |frames: &str, rows: &str| {
        let (out, _) = said(&at, &format!("{evaluate} --frames {frames} {rows} --json"));
        serde_json::from_str::<serde_json::Value>(&out).unwrap()
    };
    assert_eq!(score("gap.csv", ""), score("ohm.csv", "--rows 0..4,5..24"));
    assert_eq!(score("gap.csv", "--rows 3..8"), score("ohm.csv", "--rows 3,5..8"));
    assert!(at.refused(&format!("{evaluate} --frames gap.csv --rows 4")).contains("chooses no frame"));
    // Untouched frames of the same rows.
    let rest = text(&at, "rest.csv").repeat(PRESSES);
    at.write("rests.csv", rest);
    without_value(&at, "rests_gap.csv", "rests.csv", &[2], 3);
    let paired = "contacts disk.toml --method noser --frames gap.csv --baseline rests_gap.csv --paired --json";
    let (paired, _) = said(&at, paired);
    let numbered = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap()["frame"].as_u64().unwrap();
    assert_eq!(
        paired.lines().map(numbered).collect::<Vec<_>>(),
        (0..24).filter(|row| ![2, 4].contains(row)).collect::<Vec<_>>()
    );
    // A calibration has the labels of the other rows.
    let calibrate = "calibrate disk.toml --baseline rest.csv --truth touches.csv --method noser --force -o own --json";
    let (learnt, _) = said(&at, &format!("{calibrate} --frames gap.csv"));
    let learnt: serde_json::Value = serde_json::from_str(&learnt).unwrap();
    assert!(learnt["quality"]["labels"] == 23, "{learnt}");
}

#[test]
fn missing_channels_and_files_are_refused() {
    let at = recorded();
    let run = |frames: &str, more: &str| {
        let run = format!("--method noser --frames {frames} --baseline rest.csv {more} -o x.csv");
        (at.refused(&format!("contacts disk.toml {run}")), run)
    };
    let all: Vec<usize> = (0..PRESSES).collect();
    without_value(&at, "channel.csv", "ohm.csv", &all, 7);
    let (said, with) = run("channel.csv", "");
    assert!(said.contains("no value in any of 24 frames in channel 7") && said.contains("--leave-out 7"), "{said}");
    at.good(&format!("contacts disk.toml {with} --leave-out 7"));
    without_value(&at, "most.csv", "ohm.csv", &all[..13], 7);
    let (said, _) = run("most.csv", "");
    assert!(said.contains("13 of 24 frames have values that are missing") && said.contains("channel 7"), "{said}");
    // Images have a row for each frame.
    without_value(&at, "one.csv", "ohm.csv", &[4], 7);
    let said = at.refused("reconstruct disk.toml --frames one.csv --baseline rest.csv -o x.csv");
    assert!(said.contains("row 5: channel 7 is NaN"), "{said}");
}

/// Columns in reverse order, named by their electrodes, numbered from 1, with a column that is no channel.
#[test]
fn columns_are_found_by_their_names() {
    let at = recorded();
    let expected = images(&at, "", "");
    let channels: Vec<String> = (0..8_usize)
        .flat_map(|drive| (0..8_usize).map(move |measure| [drive, (drive + 1) % 8, measure, (measure + 1) % 8]))
        .filter(|[source, sink, plus, minus]| [plus, minus].iter().all(|m| *m != source && *m != sink))
        .map(|electrodes| electrodes.map(|electrode| (electrode + 1).to_string()).join("_"))
        .collect();
    let in_reverse = |prefix: &str, name: &dyn Fn(usize) -> String| {
        for file in ["ohm.csv", "rest.csv"] {
            let rows = text(&at, file);
            let cells = |line: &str| line.split(',').rev().collect::<Vec<_>>().join(",");
            let rows: Vec<String> = rows.lines().map(|line| format!("21.5,{}", cells(line))).collect();
            let header: Vec<String> = (0..channels.len()).rev().map(name).collect();
            at.write(&format!("{prefix}{file}"), format!("bath,{}\n{}\n", header.join(","), rows.join("\n")));
        }
    };
    in_reverse("e_", &|channel| format!("V_{}", channels[channel]));
    assert_same(&expected, &images(&at, "e_", ""), "electrodes");
    in_reverse("n_", &|channel| format!("ch{channel}"));
    assert_same(&expected, &images(&at, "n_", ""), "numbers");
    let wrong = text(&at, "e_ohm.csv").replacen("V_1_2_3_4", "V_1_2_4_3", 1);
    at.write("e_ohm.csv", wrong);
    let said = at.refused("contacts disk.toml --frames e_ohm.csv --baseline rest.csv -o x.csv");
    assert!(said.contains("no column is named by the electrodes [1, 2, 3, 4] of channel 0"), "{said}");
}
