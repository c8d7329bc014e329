//! Runs of the program with limited memory and time.

use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Most memory, KiB.
const MAX_KIB: u64 = 1 << 20;
/// Threads of the program.
const THREADS: u64 = 2;

/// How a run ended.
pub struct Ended {
    pub status: ExitStatus,
    pub stderr: String,
}

/// Runs a command in a folder, where its output is left in files. An error says which limit it exceeded.
///
/// Memory is limited twice: what is resident, seen in short intervals, and what is allocated. Matrix products (the crate
/// `private-gemm-x86`) allocate two buffers of the size of the last-level cache per thread and use little of them: the
/// second limit is larger by these.
pub fn run(folder: &Path, arguments: &str, most_time: Duration) -> Result<Ended, String> {
    let file = |name: &str| std::fs::File::create(folder.join(name)).unwrap();
    let most_allocated_kib = MAX_KIB + 2 * (THREADS + 2) * last_level_cache_kib();
    let run = format!("ulimit -c 0; ulimit -d {most_allocated_kib}; exec {} {arguments}", env!("CARGO_BIN_EXE_dermis"));
    let mut shell = Command::new("sh");
    shell.args(["-c", &run]).current_dir(folder).env("NO_COLOR", "1").env("RAYON_NUM_THREADS", THREADS.to_string());
    let mut child = shell.stdin(Stdio::null()).stdout(file("stdout")).stderr(file("stderr")).spawn().unwrap();
    let status = within(&mut child, most_time)?;
    let stderr = String::from_utf8_lossy(&std::fs::read(folder.join("stderr")).unwrap()).into_owned();
    Ok(Ended { status, stderr })
}

/// Waits for a child; ends it when it exceeds a limit.
fn within(child: &mut Child, most_time: Duration) -> Result<ExitStatus, String> {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return Ok(status);
        }
        let exceeded = match resident_kib(child.id()) {
            Some(kib) if kib > MAX_KIB => Some(format!("it takes {kib} KiB of memory")),
            _ if begun.elapsed() > most_time => Some(format!("it takes more than {most_time:?}")),
            _ => None,
        };
        if let Some(message) = exceeded {
            child.kill().unwrap();
            child.wait().unwrap();
            return Err(message);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The largest resident memory of a process so far.
fn resident_kib(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// The size of the last-level cache, times the number of processors that do not share it.
fn last_level_cache_kib() -> u64 {
    let read = |name: &str| std::fs::read_to_string(format!("/sys/devices/system/cpu/cpu0/cache/index3/{name}")).ok();
    let size = read("size").and_then(|size| size.trim().strip_suffix('K')?.parse().ok()).unwrap_or(0);
    let is_shared = read("shared_cpu_list").is_some_and(|list| list.contains(['-', ',']));
    let processors = std::thread::available_parallelism().map_or(1, |count| count.get() as u64);
    if is_shared { size } else { size * processors }
}
