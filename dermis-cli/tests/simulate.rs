//! Datasets as several processes make them: side by side, killed at any moment, gone on with.

mod workplace;

use std::path::Path;
use std::process::{Child, Command};
use std::time::Duration;
use workplace::{DISK, Workplace};

/// Five files, the last one short.
const SAMPLES: u64 = 4 * 8192 + 100;

/// Begins to make the dataset in a folder.
fn begin(at: &Workplace, folder: &str) -> Child {
    at.command(&simulate(folder)).spawn().unwrap()
}

fn simulate(folder: &str) -> String {
    format!("simulate disk.toml --samples {SAMPLES} --seed 3 -o {folder}")
}

/// Names and contents of all files in a folder.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}

/// Asserts that two folders hold the same bytes, without printing megabytes where they do not.
fn assert_same(left: &Path, right: &Path) {
    let (left, right) = (contents(left), contents(right));
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|file| file.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&left), names(&right));
    for ((name, left), (_, right)) in left.iter().zip(&right) {
        let differing = left.iter().zip(right).filter(|(left, right)| left != right).count();
        assert!(left.len() == right.len() && differing == 0, "{name}: {differing} bytes differ");
    }
}

/// Kills runs at random moments until so many have been killed; each dataset is gone on with until it is whole, and then
/// compared with one that nobody disturbed.
fn kill(count: usize) {
    let workplace = Workplace::new();
    let begun = std::time::Instant::now();
    workplace.good(&simulate("whole"));
    let undisturbed = begun.elapsed();
    workplace.good("simulate --finish whole");
    let (mut killed, mut datasets, mut random) = (0, 0, 12345u64);
    while killed < count {
        let folder = format!("killed-{datasets}");
        loop {
            let mut process = begin(&workplace, &folder);
            // Knuth's multiplier (MMIX).
            random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let share = (random >> 33) as f64 / f64::from(1u32 << 31);
            std::thread::sleep(undisturbed.mul_f64(0.6 * share) + Duration::from_millis(1));
            if killed == count || process.try_wait().unwrap().is_some() {
                assert!(process.wait().unwrap().success());
                break;
            }
            process.kill().unwrap();
            process.wait().unwrap();
            killed += 1;
        }
        workplace.good(&format!("simulate --finish {folder}"));
        assert_same(&workplace.path("whole"), &workplace.path(&folder));
        std::fs::remove_dir_all(workplace.path(&folder)).unwrap();
        datasets += 1;
    }
    println!("{killed} runs killed while making {datasets} datasets: 0 bytes differ");
}

#[test]
fn runs_that_are_killed_are_gone_on_with() {
    kill(6);
}

#[test]
#[ignore = "slow: a hundred runs are killed"]
fn a_hundred_random_kills_leave_no_byte_different() {
    kill(100);
}

#[test]
fn two_processes_with_a_shard_each_make_what_one_makes() {
    let workplace = Workplace::new();
    workplace.good(&format!("{} --threads 1", simulate("one")));
    let shard = |index: usize| workplace.command(&format!("{} --shard {index}/2", simulate("two"))).spawn().unwrap();
    let processes = [shard(0), shard(1)];
    for process in processes {
        let output = process.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    workplace.good("simulate --finish one");
    workplace.good("simulate --finish two --threads 2");
    assert_same(&workplace.path("one"), &workplace.path("two"));
    let told = workplace.good("simulate disk.toml --verify two");
    assert!(told.contains("5 of 5 files, all intact; finished"), "{told}");
}

#[test]
fn random_skins_do_not_depend_on_threads_either() {
    let workplace = Workplace::new();
    for kind in ["gaussian", "patch"] {
        let simulate = |threads: usize| {
            let folder = format!("{kind}-{threads}");
            let options = "--samples 100 --seed 4 --skins random --electrode-displacement-m 0.0003";
            workplace.good(&format!("simulate disk.toml {options} --touch {kind} --threads {threads} -o {folder}"));
            workplace.good(&format!("simulate --finish {folder}"));
            workplace.path(&folder)
        };
        assert_same(&simulate(1), &simulate(3));
    }
}

#[test]
fn two_processes_on_the_same_files_do_not_disturb_each_other() {
    let workplace = Workplace::new();
    let processes = [begin(&workplace, "same"), begin(&workplace, "same")];
    for process in processes {
        let output = process.wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        let left = output.status.code() == Some(2) && stderr.contains("another process");
        assert!(output.status.success() || left, "{stderr}");
    }
    workplace.good(&simulate("same"));
    workplace.good(&simulate("alone"));
    for folder in ["same", "alone"] {
        workplace.good(&format!("simulate --finish {folder}"));
    }
    assert_same(&workplace.path("same"), &workplace.path("alone"));
}

#[test]
fn what_cannot_be_simulated_is_refused_with_a_reason() {
    let workplace = Workplace::new();
    let refused = |arguments: &str| workplace.refused(&format!("simulate disk.toml --seed 1 -o out {arguments}"));
    assert!(refused("--samples 0").contains("the number of samples is 0: it must be at least 1"));
    assert!(refused("--samples 9 --shard 4/4").contains("with 4 shards their numbers are 0 to 3"));
    assert!(refused("--samples 9 --shard 1").contains("write 0/4 for the first of four"));
    assert!(refused("--samples 9 --threads 0").contains("--threads is 0"));
    assert!(refused("--samples 9 --width-m 0.01 0.005").contains("at least 0.01"));
    assert!(refused("--samples 9 --force-n 1 2").contains("belong to --touch patch"));
    assert!(refused("--samples 9 --coat-rms 0.1").contains("write --skins random"));
    assert!(refused("--samples 9 --touch patch --tip-radius-m 0.001 0.002").contains("sinks"));
    assert!(refused("--samples 9 --skins random --electrode-displacement-m 0.01").contains("would fold"));
    assert!(refused("--samples 1000000000000000").contains("are needed: make room"));
    assert!(!workplace.path("out").exists(), "a refusal leaves nothing behind");
    std::fs::write(workplace.path("file"), "").unwrap();
    assert!(workplace.refused("simulate disk.toml --seed 1 --samples 9 -o file").contains("file"));
    assert!(workplace.refused("simulate --finish nowhere").contains("run.json is not there"));
    workplace.good("simulate disk.toml --seed 1 --samples 9 -o out");
    assert!(refused("--samples 10").contains("`recipe.samples` is 9, not 10"));
    std::fs::write(workplace.path("other.toml"), DISK.replace("1000", "2000")).unwrap();
    assert!(workplace.refused("simulate other.toml --seed 1 --samples 9 -o out").contains("`design."));
    assert!(workplace.refused("simulate other.toml --finish out").contains("`design.sha256` is"));
    workplace.good("simulate disk.toml --finish out");
    let told = workplace.good("simulate --verify out --json");
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["good_files"], &told["finished"]), (&1.into(), &true.into()));
}

#[cfg(unix)]
#[test]
fn a_folder_that_cannot_be_written_is_named() {
    use std::os::unix::fs::PermissionsExt;
    let workplace = Workplace::new();
    let closed = workplace.path("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, PermissionsExt::from_mode(0o555)).unwrap();
    if std::fs::write(closed.join("probe"), "").is_ok() {
        println!("skipped: this user may write anywhere; /proc stands in");
        assert!(workplace.refused("simulate disk.toml --seed 1 --samples 9 -o /proc/dataset").contains("/proc"));
        return;
    }
    assert!(workplace.refused("simulate disk.toml --seed 1 --samples 9 -o closed").contains("closed"));
}

#[test]
#[ignore = "slow: needs python3 (or DERMIS_PYTHON) with NumPy; safetensors and PyTorch are tried where installed"]
fn the_example_reads_a_dataset_without_our_code() {
    let workplace = Workplace::new();
    workplace.good(&simulate("data"));
    workplace.good("simulate --finish data");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/read_dataset.py");
    let python = std::env::var("DERMIS_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = Command::new(python).arg(script).arg(workplace.path("data")).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}{}", String::from_utf8_lossy(&output.stderr));
    print!("{told}");
    assert!(told.starts_with(&format!("{SAMPLES} samples")), "{told}");
}
