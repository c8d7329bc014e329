//! The study, as users run it.

use std::path::Path;
use std::process::{Command, Output};

fn study(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_paper-study")).args(arguments).current_dir(folder).output().expect("it runs")
}

fn refused(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(2), "a mistake of the user's ends with code 2");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The smallest scale on the twin without patches, in some seconds.
const GLANCE: [&str; 5] = ["--scale", "glance", "--twin", "ideal", "--json"];

#[test]
fn a_glance_makes_the_page_and_the_same_numbers_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let output = study(folder.path(), &GLANCE);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let file = std::fs::read(folder.path().join("report/report.json")).unwrap();
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&file).unwrap(), told, "the file holds what was printed");

    assert_eq!((&told["simulated"], &told["design"]), (&true.into(), &"cylinder30".into()));
    let methods = told["methods"].as_array().unwrap();
    assert!(methods.len() >= 2);
    for method in methods {
        let mean_m = method["twins"][0]["figures"]["grid_localisation_mean_m"].as_f64().unwrap();
        assert!(mean_m > 1e-4 && mean_m < 0.01, "{}: {mean_m} m", method["name"]);
        // Every design and control, with every linear method.
        let of = |one: &&serde_json::Value| one["method"] == method["key"];
        let designs = told["structures"].as_array().unwrap().iter().filter(of).count();
        assert!(designs == 4 || method["alpha"].is_null(), "{designs} designs by {}", method["name"]);
    }
    for row in told["results"].as_array().unwrap() {
        assert_eq!(row["ours"].as_array().unwrap().len(), methods.len(), "{row}");
    }

    let page = std::fs::read_to_string(folder.path().join("report/index.html")).unwrap();
    for figure in ["Fig. 1c", "Fig. 2", "Fig. 3", "Fig. 7", "Fig. 8", "Fig. 9", "5.2 \u{b1} 3.3", "cut open"] {
        assert!(page.contains(figure), "{figure} is missing");
    }
    assert!(page.contains("glance") && page.contains("simulated") && page.contains("measured"));
    let page = page.replace("href=\"#", "");
    for foreign in ["src=", "href=", "url(", "<script"] {
        assert!(!page.contains(foreign), "{foreign}");
    }

    // Finished parts are not repeated, and the results are the same.
    let kept = folder.path().join("report/work/benchmark-noser-1001.json");
    let before = std::fs::metadata(&kept).unwrap().modified().unwrap();
    let again = study(folder.path(), &GLANCE);
    let told_again: serde_json::Value = serde_json::from_slice(&again.stdout).expect("JSON");
    assert_eq!(std::fs::metadata(&kept).unwrap().modified().unwrap(), before);
    assert_eq!(told_again["methods"], told["methods"]);
    assert_eq!(told_again["structures"], told["structures"]);
}

#[test]
fn an_invalid_design_or_folder_is_rejected_immediately() {
    let folder = tempfile::tempdir().unwrap();
    let message = refused(&study(folder.path(), &["cylinder31"]));
    assert!(message.contains("cylinder31"), "{message}");
    assert!(!folder.path().join("report").exists(), "nothing is made for a mistake");
    let message = refused(&study(folder.path(), &["--twin", "lob"]));
    assert!(message.contains("lob"), "{message}");
    std::fs::write(folder.path().join("taken"), "a file").unwrap();
    let message = refused(&study(folder.path(), &["-o", "taken"]));
    assert!(message.contains("taken") && message.contains("-o"), "{message}");
    let message = refused(&study(folder.path(), &["--method", "nowhere"]));
    assert!(message.contains("nowhere") && !folder.path().join("report/index.html").exists(), "{message}");
    let message = refused(&study(folder.path(), &["--scale", "huge"]));
    assert!(message.contains("huge") && message.contains("quick"), "{message}");
}
