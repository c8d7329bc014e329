//! Numbers of commands are checked when arguments are read: before any work, with the option, the value and the range.

use crate::workplace::{Workplace, all_commands};
use std::time::{Duration, Instant};

/// Reading arguments takes milliseconds; the rest is for a busy machine.
const SOON: Duration = Duration::from_secs(1);

/// Each command with an option, and values outside its range.
const WRONG: &[(&str, &str, &[&str])] = &[
    ("live disk.toml --serve off", "--speed", &["1e-300", "0", "-1", "nan", "inf", "1e300"]),
    ("live disk.toml --serve off", "--for", &["nan", "inf", "-1", "1e300"]),
    ("live disk.toml --serve off", "--prerender", &["100000000000", "1e11", "-1"]),
    ("live disk.toml --serve off", "--rate", &["0", "nan", "1e-9", "1e300"]),
    ("live disk.toml --serve off", "--threshold", &["0", "-1", "nan", "1e300"]),
    (
        "live disk.toml --serve off",
        "--record-split",
        &["0", "5", "1KiB", "0.1s", "-1GiB", "nanMB", "1e300h", "1e300GiB"],
    ),
    ("live disk.toml --serve off", "--record-keep", &["0", "10min", "1KiB", "-1GiB", "infMB", "1e300GiB"]),
    ("live disk.toml --serve off", "--seed", &["-1", "18446744073709551615"]),
    ("live disk.toml --serve off", "--fault", &["noise:1e300@0+1", "unplug@1e300+1", "bytes:0.1@nan+1"]),
    ("emulate disk.toml", "--speed", &["1e-300", "nan"]),
    ("emulate disk.toml", "--prerender", &["1e11"]),
    ("check-build disk.toml --source emulate", "--take", &["0", "18446744073709551615"]),
    ("check-device disk.toml --source tcp:127.0.0.1:9", "--frames", &["1", "60001"]),
    ("check-device disk.toml --source tcp:127.0.0.1:9", "--rate", &["0", "nan", "1e300"]),
    ("check-device disk.toml --source tcp:127.0.0.1:9", "--patience", &["0", "nan", "61"]),
    ("calibrate disk.toml --live -o own", "--presses", &["0", "1e9"]),
    ("calibrate disk.toml --frames x.csv --difference --truth y.csv -o own", "--suggest", &["0", "1001"]),
    ("contacts disk.toml --frames x.csv --difference -o y.csv", "--leave-out-electrode", &["-1", "1024"]),
    ("bound disk.toml", "--noise", &["nan", "-21", "1e300"]),
    ("bound disk.toml", "--force", &["0", "-1", "nan", "1e300"]),
    ("bound disk.toml", "--tip-radius", &["0", "nan", "1"]),
    ("bound disk.toml --contact-drift 0", "--coat-drift", &["-1", "nan", "1e300"]),
    ("bound disk.toml --coat-drift 0", "--contact-drift", &["-1", "nan", "1e300"]),
    ("bound disk.toml", "--without-electrode", &["-1", "1024"]),
    ("bound disk.toml", "--separation-step", &["-1", "18446744073709551615"]),
    ("optimise disk.toml -o x.toml", "--electrodes", &["3", "1025", "1e300"]),
    ("optimise disk.toml -o x.toml", "--counts", &["3", "1025", "-1"]),
    ("optimise disk.toml -o x.toml", "--slots", &["0", "18446744073709551615"]),
    ("optimise disk.toml -o x.toml", "--least-distance", &["-1", "nan", "1e300"]),
    ("optimise disk.toml -o x.toml", "--edge", &["-1", "nan", "1e300"]),
    ("optimise disk.toml -o x.toml", "--noise", &["nan", "-21", "1e300"]),
    ("optimise disk.toml -o x.toml", "--force", &["0", "-1", "nan", "1e300"]),
    ("optimise disk.toml -o x.toml", "--tip-radius", &["0", "nan", "1"]),
    ("optimise disk.toml -o x.toml", "--starts", &["0", "100001"]),
    ("optimise disk.toml -o x.toml", "--moves", &["0", "1e300"]),
    ("optimise disk.toml -o x.toml", "--rounds", &["-1", "1001"]),
    ("optimise disk.toml -o x.toml", "--seed", &["-1", "18446744073709551615"]),
    ("benchmark disk.toml", "--noise", &["nan", "-21", "1e300"]),
    ("benchmark disk.toml", "--twins", &["0", "1000000000"]),
    ("benchmark disk.toml", "--seed", &["18446744073709551615"]),
    ("benchmark disk.toml", "--dead", &["1025", "-1"]),
    ("benchmark disk.toml", "--alpha", &["0", "nan", "1e300", "1e-300"]),
    ("benchmark disk.toml", "--alpha-absolute", &["0", "nan", "-1"]),
    ("benchmark disk.toml", "--noser-exponent", &["nan", "-1", "1e300"]),
    ("fault-campaign disk.toml", "--noise", &["nan", "-21", "1e300"]),
    ("fault-campaign disk.toml", "--faults", &["0", "1000001"]),
    ("fault-campaign disk.toml", "--seed", &["-1", "18446744073709551615"]),
    ("characterise disk.toml", "--samples", &["0", "18446744073709551615"]),
    ("characterise disk.toml", "--peak-fraction", &["1", "-0.1", "nan"]),
    ("demo", "--seed", &["-1"]),
    ("experiment disk.toml -o out", "--seed", &["18446744073709551615"]),
    ("experiment disk.toml --seed 1 -o out", "--noise", &["nan", "-21", "1e300"]),
    ("experiment disk.toml --seed 1 -o out", "--touches", &["1", "17", "nan"]),
    ("experiment disk.toml --seed 1 -o out", "--apart", &["0", "nan", "2"]),
    ("experiment disk.toml --seed 1 -o out", "--presses", &["0", "1000001"]),
    ("new disk -o x.toml", "--electrodes", &["3", "257"]),
    ("evaluate disk.toml --frames x.csv --difference --truth y.csv", "--align", &["0", "1e300"]),
    ("evaluate disk.toml --frames x.csv --difference --truth y.csv --align 9", "--draws", &["0", "100001"]),
    ("forward disk.toml --touches x.csv -o y.csv", "--touch-width-m", &["1e-30", "0", "nan", "1e300"]),
    ("forward disk.toml --touches x.csv -o y.csv", "--touch-amplitude", &["0", "nan", "1e300"]),
    ("plot disk.toml -o x.svg", "--frame", &["-1", "18446744073709551615"]),
    ("train disk.toml --data x -o y", "--epochs", &["0", "1e300"]),
    ("train disk.toml --data x -o y", "--epoch-samples", &["0", "18446744073709551615"]),
    ("train disk.toml --data x -o y", "--rate", &["0", "nan", "2"]),
    ("train disk.toml --data x -o y", "--seed", &["18446744073709551615"]),
    ("simulate disk.toml --seed 1 -o out", "--samples", &["0", "18446744073709551615"]),
    ("simulate disk.toml --samples 9 -o out", "--seed", &["18446744073709551615"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out", "--most-touches", &["0", "17"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out", "--width-m", &["1e-30", "nan"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out", "--amplitude", &["0", "nan"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out --touch patch", "--force-n", &["0", "1e300"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out --touch patch", "--tip-radius-m", &["0", "1e9"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out --skins random", "--coat-rms", &["-1", "nan", "1e300"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out --skins random", "--electrode-displacement-m", &["-1", "1e300"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out --skins random", "--contact-impedance-rms", &["-1", "nan"]),
    ("simulate disk.toml --seed 1 --samples 9 -o out", "--threads", &["0", "1000000"]),
];

#[test]
fn numbers_outside_their_range_are_refused_at_once() {
    let at = Workplace::new();
    for (command, option, values) in WRONG {
        for value in *values {
            let begun = Instant::now();
            let is_pair = ["--width-m", "--amplitude", "--force-n", "--tip-radius-m"].contains(option);
            let given = if is_pair { format!("{option} {value} 1") } else { format!("{option}={value}") };
            let said = at.refused(&format!("{command} {given}"));
            assert!(begun.elapsed() < SOON, "{command} {option}={value}: {:?}", begun.elapsed());
            for word in [*option, *value, "from "] {
                assert!(said.contains(word), "{command} {option}={value}: no `{word}` in: {said}");
            }
        }
    }
}

/// Every option of every command that takes a bare number stands in the table.
#[test]
fn no_option_with_a_number_is_forgotten() {
    let at = Workplace::empty();
    let commands = all_commands(|words| at.good(words));
    assert!(commands.len() > 30, "{commands:?}");
    for name in commands {
        let help = at.good(&format!("{name} -h"));
        for line in help.lines().map(str::trim_start).filter(|line| line.starts_with('-')) {
            let takes = |unit: &str| line.contains(&format!("<{unit}>")) || line.contains(&format!("<{unit}> <TO>"));
            let is_number = [
                "SIZE",
                "SIZE|TIME",
                "N",
                "S",
                "K",
                "M",
                "NUMBER",
                "TIMES",
                "SECONDS",
                "HZ",
                "FRAMES",
                "SHARE",
                "ALPHA",
                "SEED",
                "FRAME",
            ]
            .into_iter()
            .any(takes);
            let Some(option) = line.split([' ', ',']).find(|word| word.starts_with("--")).filter(|_| is_number) else {
                continue;
            };
            assert!(WRONG.iter().any(|(_, known, _)| *known == option), "{name} {option} is not checked");
        }
    }
}

/// Too many frames in advance for the memory are refused before any is computed.
#[test]
fn frames_in_advance_have_a_limit_of_memory() {
    let at = Workplace::new();
    let said = at.refused("emulate skin16 --prerender 1000000");
    assert!(said.contains("1000000 frames in advance") && said.contains("MiB"), "{said}");
}
