//! Fitted designs, frames with gaps, frames without a baseline, and contacts of both signs.

use crate::workplace::{DISK, Workplace};

/// Number of channels of the small skin with all pairs but the driven one.
const VALUES: usize = 8 * 7;

/// A skin whose channels read voltages at driven electrodes too, and untouched frames of the same skin with other
/// values.
fn skin() -> Workplace {
    let at = Workplace::empty();
    let design = DISK.replace("adjacent_undriven", "adjacent").replace("ohm = 1000", "ohm = 1000   # guessed");
    at.write("skin.toml", &design);
    at.write("real.toml", design.replace("1000 ", "1250 ").replace("_ohm_m = 0.01", "_ohm_m = 0.03"));
    at.good("forward real.toml -o rest.csv");
    at
}

/// Replaces a value in each row of a file.
fn with_value(at: &Workplace, from: &str, to: &str, channel: usize, value: &str) {
    let text = std::fs::read_to_string(at.path(from)).unwrap();
    let row = |line: &str| {
        let mut fields: Vec<&str> = line.split(',').collect();
        fields[channel] = value;
        fields.join(",")
    };
    at.write(to, text.lines().map(row).collect::<Vec<_>>().join("\n"));
}

#[test]
fn a_fitted_design_is_the_given_file_with_other_values() {
    let at = skin();
    let shown = at.good("fit skin.toml --frames rest.csv --offsets offsets.csv -o fitted.toml");
    for part in ["skin, untouched frames: 1, channels: 56", "sheet resistance, ohm", "1250", "at driven electrodes"] {
        assert!(shown.contains(part), "{part} in\n{shown}");
    }
    let text = std::fs::read_to_string(at.path("fitted.toml")).unwrap();
    let expected = std::fs::read_to_string(at.path("real.toml")).unwrap();
    assert_eq!(text, expected.replace("= 1250 ", "= 1250.0 "));
    assert_eq!(std::fs::read_to_string(at.path("offsets.csv")).unwrap().lines().count(), 1 + VALUES);
    // Used like any design: its untouched frame is the measured one.
    at.good("forward fitted.toml -o again.csv");
    let numbers = |name: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(at.path(name)).unwrap();
        text.trim().split(',').map(|field| field.parse().unwrap()).collect()
    };
    for (a, b) in numbers("again.csv").iter().zip(numbers("rest.csv")) {
        assert!((a - b).abs() < 1e-5 * b.abs().max(1.0), "{a} for {b}");
    }
    let each = expected.replace("_ohm_m = 0.03", "_ohm_m = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08]");
    at.write("uneven.toml", &each);
    at.good("forward uneven.toml -o uneven.csv");
    let json = at.json("fit skin.toml --frames uneven.csv --contacts each -o each.toml --json");
    assert_eq!(json["quantities"].as_array().unwrap().len(), 9);
    assert_eq!(json["quantities"][8]["quantity"]["contact"], 7);
    assert!((json["quantities"][8]["value"].as_f64().unwrap() / 0.08 - 1.0).abs() < 1e-5, "{json}");
    assert_eq!(std::fs::read_to_string(at.path("each.toml")).unwrap(), each.replace("= 1250 ", "= 1250.0 "));
}

#[test]
fn frames_that_no_design_fits_are_refused() {
    let at = skin();
    let fit = |arguments: &str| at.refused(&format!("fit skin.toml {arguments} -o fitted.toml"));
    with_value(&at, "rest.csv", "gap.csv", 3, "");
    assert!(fit("--frames gap.csv").contains("gap.csv: no value in any of 1 frame in channel 3"));
    at.good("fit skin.toml --frames gap.csv --leave-out 3 -o fitted.toml");
    assert!(fit("--frames rest.csv --leave-out 56").contains("cannot leave channel 56 out: the channels are 0 to 55"));
    assert!(fit("--frames rest.csv --leave-out 0-55").contains("0 channels are too few"));
    assert!(fit("--frames none.csv").contains("none.csv"));
    at.write(
        "backwards.toml",
        std::fs::read_to_string(at.path("skin.toml"))
            .unwrap()
            .replace("[protocol]", "[protocol]\nmeasures_reversed = true"),
    );
    let wrong = at.refused("fit backwards.toml --frames rest.csv -o wrong.toml");
    assert!(
        wrong.contains("agree with the untouched frame of the design by -") && wrong.contains("measures_reversed"),
        "{wrong}"
    );
    assert!(!at.path("wrong.toml").exists());
    // A fitted design carries the channel table that the design names.
    let pairs =
        (0..8).flat_map(|drive| (0..8).filter(move |&measure| measure != drive).map(move |measure| (drive, measure)));
    let rows = pairs.enumerate().map(|(channel, (drive, measure))| {
        format!("{channel},{drive},{},{measure},{}\n", (drive + 1) % 8, (measure + 1) % 8)
    });
    let header = "channel,drive_source,drive_sink,measure_plus,measure_minus\n".to_string();
    at.write("channels.csv", header + &rows.collect::<String>());
    let table = DISK.replace("pattern = \"adjacent_undriven\"", "pattern.table = \"channels.csv\"");
    at.write("table.toml", table);
    std::fs::create_dir(at.path("elsewhere")).unwrap();
    at.good("fit table.toml --frames rest.csv -o elsewhere/fitted.toml");
    let frame = |design: &str| {
        at.good(&format!("forward {design} -o untouched.csv"));
        std::fs::read(at.path("untouched.csv")).unwrap()
    };
    at.good("fit table.toml --frames rest.csv -o beside.toml");
    let beside = frame("beside.toml");
    std::fs::remove_file(at.path("channels.csv")).unwrap();
    assert_eq!(frame("elsewhere/fitted.toml"), beside);
    let damaged = std::fs::read_to_string(at.path("beside.toml"))
        .unwrap()
        .replace("\n\"channels.csv\" = \"", "\n\"channels.csv\" = \"x");
    at.write("damaged.toml", damaged);
    assert!(at.refused("forward damaged.toml -o f.csv").contains("is not a file that the design carries"));
}

#[test]
fn channels_that_are_left_out_need_no_values() {
    let at = skin();
    at.write("dead.csv", "channel\n3\n10-12\n");
    with_value(&at, "rest.csv", "a.csv", 3, "");
    with_value(&at, "a.csv", "gaps.csv", 11, "NaN");
    let run =
        |leave_out: &str| format!("reconstruct skin.toml --frames gaps.csv --baseline gaps.csv {leave_out} -o i.csv");
    assert!(
        at.refused(&run("")).contains("gaps.csv, row 1: channel 3 is NaN: mend the frame, or leave the channel out")
    );
    assert!(at.refused(&run("--leave-out 3")).contains("channel 11 is NaN"));
    at.good(&run("--leave-out 3,10-12"));
    at.good(&run("--leave-out dead.csv"));
    assert!(at.refused(&run("--leave-out none.csv")).contains("neither a list of channels"));
    at.write("bad.csv", "3\n11x\n");
    assert!(at.refused(&run("--leave-out bad.csv")).contains("bad.csv, line 2: `11x` is not the number of a channel"));
}

#[test]
fn contacts_are_found_without_a_baseline_and_with_their_sign() {
    let at = Workplace::empty();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-study/tank/metal1_plastic5_plastic9_metal13_55uA");
    let signs = |arguments: &str| -> Vec<(f64, String)> {
        at.good(&format!("contacts tank16 --frames {data}_objects.csv {arguments} --both-signs -o c.csv"));
        let text = std::fs::read_to_string(at.path("c.csv")).unwrap();
        assert!(text.lines().next().unwrap().ends_with(",theta_rad,conductance"), "{text}");
        let contact = |line: &str| {
            let fields: Vec<&str> = line.split(',').collect();
            let [x, y]: [f64; 2] = [fields[2].parse().unwrap(), fields[3].parse().unwrap()];
            (y.atan2(x).to_degrees().rem_euclid(360.0), fields.last().unwrap().to_string())
        };
        text.lines().skip(1).map(contact).collect()
    };
    let found = signs(&format!("--baseline {data}_empty.csv --method noser"));
    println!("{found:?}");
    // Metal at the electrodes 0 and 12, plastic at 4 and 8.
    for (angle, sign) in [(0.0, "rises"), (90.0, "falls"), (180.0, "falls"), (270.0, "rises")] {
        let near =
            |(at, of): &(f64, String)| ((at - angle + 180.0).rem_euclid(360.0) - 180.0).abs() < 15.0 && of == sign;
        assert!(found.iter().any(near), "{sign} at {angle} degrees in {found:?}");
    }
    // Without --both-signs the files are as before, and the option is named.
    let output = at.run(&format!("contacts tank16 --frames {data}_objects.csv --baseline {data}_empty.csv -o c.jsonl"));
    assert!(output.status.success() && String::from_utf8_lossy(&output.stderr).contains("--both-signs"), "{output:?}");
    assert!(!std::fs::read_to_string(at.path("c.jsonl")).unwrap().contains("conductance"));
    println!("{:?}", signs("--baseline model --method noser"));
    let network = at.refused(&format!(
        "contacts skin16 --method shapes --frames {data}_objects.csv --difference --both-signs -o c.csv"
    ));
    assert!(network.contains("contacts of both signs") || network.contains("too many values"), "{network}");
    at.write("turned.csv", std::fs::read_to_string(format!("{data}_objects.csv")).unwrap().replace('-', ""));
    let wrong = at.refused("contacts tank16 --frames turned.csv --baseline model -o c.csv");
    assert!(wrong.contains("check the order of the channels"), "{wrong}");
}
