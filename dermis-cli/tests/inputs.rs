//! Measured currents and noise of the channels, as instruments give them.

use crate::workplace::Workplace;
use dermis_sim::random::{sample_rng, standard_normal};

/// A folder with `disk.toml`, `rest.csv`, and `ohm.csv` with two touched frames.
fn recorded() -> Workplace {
    let at = Workplace::new();
    at.write("touches.csv", "frame,x_m,y_m,force_n\n0,0.02,0.01,2\n1,-0.01,0.02,3\n");
    at.good("forward disk.toml -o rest.csv");
    at.good("forward disk.toml --touches touches.csv -o ohm.csv");
    at
}

fn numbers(at: &Workplace, name: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(at.path(name)).unwrap();
    let row = |line: &str| line.split(',').map(|value| value.parse().unwrap_or(f64::NAN)).collect();
    text.lines().map(row).collect()
}

/// An instrument that records volts, and the amperes of each drive, gives the contacts of one that records ohms.
#[test]
fn voltages_are_divided_by_the_measured_currents() {
    let at = recorded();
    let amperes: Vec<f64> = (1..=8).map(|drive| 1e-3 * f64::from(drive)).collect();
    for (ohm, volt) in [("ohm.csv", "volt.csv"), ("rest.csv", "rest_volt.csv")] {
        let volts = |(channel, ohm): (usize, &f64)| (ohm * amperes[channel / 5]).to_string();
        let rows = numbers(&at, ohm);
        let rows = rows.iter().map(|row| row.iter().enumerate().map(volts).collect::<Vec<_>>().join(","));
        at.write(volt, rows.collect::<Vec<_>>().join("\n"));
    }
    at.write("currents.csv", amperes.iter().map(f64::to_string).collect::<Vec<_>>().join(","));
    at.good("contacts disk.toml --method noser --frames ohm.csv --baseline rest.csv -o a.csv");
    let run = "contacts disk.toml --method noser --frames volt.csv --baseline rest_volt.csv -o b.csv --currents";
    at.good(&format!("{run} currents.csv"));
    let (ohm, volt) = (numbers(&at, "a.csv").concat(), numbers(&at, "b.csv").concat());
    assert!(ohm.len() > 20 && ohm.len() == volt.len());
    let off = ohm.iter().zip(&volt).filter(|(a, b)| (*a - *b).abs() > 1e-6 * a.abs().max(1.0)).count();
    assert_eq!(off, 0, "{ohm:?} {volt:?}");
    let plot = "plot disk.toml --what image --method noser";
    at.good(&format!("{plot} --frames ohm.csv --baseline rest.csv -o ohm.svg"));
    at.good(&format!("{plot} --frames volt.csv --baseline rest_volt.csv --currents currents.csv -o volt.svg"));
    assert_eq!(std::fs::read(at.path("ohm.svg")).unwrap(), std::fs::read(at.path("volt.svg")).unwrap());
    at.write("images.csv", "1,2");
    assert!(
        at.refused("plot disk.toml --what image --images images.csv --currents currents.csv -o x.svg")
            .contains("--currents")
    );
    let resistance = |arguments: &str| -> f64 {
        let fitted = at.good(&format!("fit disk.toml --json -o fitted.toml {arguments}"));
        let fitted: serde_json::Value = serde_json::from_str(&fitted).unwrap();
        fitted["quantities"][0]["value"].as_f64().unwrap()
    };
    let of_volts = resistance("--frames rest_volt.csv --currents currents.csv");
    assert!((of_volts / resistance("--frames rest.csv") - 1.0).abs() < 1e-6, "{of_volts}");
    at.write("seven.csv", "1,1,1,1,1,1,1");
    assert!(at.refused(&format!("{run} seven.csv")).contains("seven.csv"));
}

/// What a command reads is not overwritten by its result.
#[test]
fn an_output_that_is_an_input_is_refused() {
    let at = recorded();
    let before = std::fs::read(at.path("ohm.csv")).unwrap();
    for command in [
        "forward disk.toml -o disk.toml",
        "forward disk.toml -o ./disk.toml",
        "contacts disk.toml --frames ohm.csv --baseline rest.csv --output=ohm.csv",
        "reconstruct disk.toml --frames ohm.csv --baseline rest.csv -o rest.csv",
    ] {
        let error = at.refused(command);
        assert!(error.contains("it would be lost") && error.contains("Choose another name"), "{error}");
    }
    assert_eq!(std::fs::read(at.path("ohm.csv")).unwrap(), before);
    at.good("forward disk.toml -o rest.csv");
}

/// 29 of 870 channels have a spike of 20 times the noise in each frame.
#[test]
fn spikes_of_single_channels_are_no_certain_contacts() {
    let at = Workplace::empty();
    at.good("forward cylinder30 -o rest.csv");
    let rest = numbers(&at, "rest.csv").remove(0);
    let sd = 1e-3 * (rest.iter().map(|value| value * value).sum::<f64>() / rest.len() as f64).sqrt();
    let frame = |number: u64, spikes: usize| {
        let mut rng = sample_rng(29, number);
        let mut frame: Vec<f64> = rest.iter().map(|value| value + sd * standard_normal(&mut rng)).collect();
        for spike in 0..spikes {
            // Drive below 15, measurement from 15 on: reciprocal channels are none of these. Each drive has 29 values.
            let (drive, measure) =
                ((7 * spike + number as usize) % 15, 15 + (4 * spike + spike / 15 + number as usize) % 15);
            frame[29 * drive + measure - 1] +=
                if (number as usize + spike).is_multiple_of(2) { 20.0 * sd } else { -20.0 * sd };
        }
        frame.iter().map(f64::to_string).collect::<Vec<String>>().join(",") + "\n"
    };
    at.write("untouched.csv", (0..50).map(|number| frame(number, 0)).collect::<String>());
    at.write("frames.csv", (50..70).map(|number| frame(number, 29)).collect::<String>());
    for method in ["noser", "refined"] {
        let command =
            format!("contacts cylinder30 --frames frames.csv --baseline untouched.csv --method {method} -o c.jsonl");
        let output = at.run(&command);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(at.path("c.jsonl")).unwrap();
        let confidences = text.lines().flat_map(|line| {
            let frame: serde_json::Value = serde_json::from_str(line).unwrap();
            let contacts = frame["contacts"].as_array().unwrap().clone();
            contacts.into_iter().map(|contact| contact["confidence"].as_f64().unwrap())
        });
        let sure = confidences.filter(|confidence| *confidence > 0.5).count();
        // 40 and 150 without a look at reciprocal channels.
        assert!(sure <= 1, "{method}: {sure} contacts that are probable");
    }
}

#[test]
fn channels_are_weighted_by_their_noise() {
    let at = recorded();
    let sd = |first: &str| [first].into_iter().chain(std::iter::repeat_n("0.1", 39)).collect::<Vec<_>>().join(",");
    at.write("sd.csv", sd("0.3"));
    at.write("zero.csv", sd("0"));
    let run = "reconstruct disk.toml --method laplace --frames ohm.csv --baseline rest.csv";
    at.good(&format!("{run} --channel-noise sd.csv -o weighted.csv"));
    at.good(&format!("{run} -o equal.csv"));
    assert_ne!(std::fs::read(at.path("weighted.csv")).unwrap(), std::fs::read(at.path("equal.csv")).unwrap());
    assert!(at.refused(&format!("{run} --channel-noise zero.csv -o x.csv")).contains("channel 0 is 0"));
    // One untouched frame has the noise of its reciprocal channels.
    at.good(&format!("{run} --channel-noise measured -o measured.csv"));
    let without = run.replace("--baseline rest.csv", "--difference --force");
    let measured = at.refused(&format!("{without} --channel-noise measured -o x.csv"));
    assert!(measured.contains("needs untouched frames"), "{measured}");
    let greit = at.refused(&format!("{} --channel-noise sd.csv -o x.csv", run.replace("laplace", "greit")));
    assert!(greit.contains("greit") && greit.contains("noise"), "{greit}");
}

/// A program that does not read messages any more does not change what a command does.
#[test]
fn messages_that_nobody_reads_end_nothing() {
    let at = Workplace::empty();
    let mut child = at.command("robot check nowhere.toml").stderr(std::process::Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(2));
}

/// Untouched frames of which some are of something else are named, wherever they are read.
#[test]
fn untouched_frames_that_are_not_alike_are_named() {
    let at = Workplace::empty();
    let row = at.good("forward skin16 -o -");
    let row = row.lines().last().unwrap();
    let zeros = vec!["0"; row.split(',').count()].join(",");
    at.write("mixed.csv", vec![format!("{row}\n"); 12].concat() + &format!("{zeros}\n").repeat(8));
    at.write("alike.csv", format!("{row}\n").repeat(20));
    let commands = [
        "check-build skin16 --frames",
        "fit skin16 -o out.toml --frames",
        "contacts skin16 --frames alike.csv -o - --baseline",
    ];
    for command in commands {
        for (file, is_said) in [("mixed.csv", true), ("alike.csv", false)] {
            let said = at.run(&format!("{command} {file}"));
            let said = String::from_utf8_lossy(&said.stderr).into_owned();
            assert_eq!(
                said.contains("those of the rows 12-19 are unlike the others"),
                is_said,
                "{command} {file}: {said}"
            );
        }
    }
}
