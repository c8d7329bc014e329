//! `dermis live`: processing of a live skin.

use crate::build_watch::check_first_frames;
use crate::channels::LeaveOutElectrodes;
use crate::console::{interrupted, note, say};
use crate::failure::{Failure, Outcome};
use crate::latency;
use crate::method::METHOD_HELP;
use crate::range::{Part, number, part, size};
use crate::sinks::{Lines, Ros2Arguments, lines};
use crate::source::{PageArguments, SourceArguments};
use clap::Args;
use dermis::design::SkinDesign;
use dermis::files::read_text_at_most;
use dermis::frame::write_whole;
use dermis::method::MethodSet;
use dermis::pipeline::{Command, Settings, Severity, State, Zone};
use dermis::skin::Skin;
use dermis::text::{counted, printable};
use dermis_calibrate::Calibration;
use dermis_emulate::emulator::Emulator;
use dermis_live::device::{Address, DeviceOptions};
use dermis_live::recording::{Player, RecordingLimits, RecordingStatus};
use dermis_live::sinks::viewer::Server;
use dermis_live::sinks::{jsonl, watchdog};
use dermis_live::{Control, Event, Live, LiveOptions, LiveStatistics, Popped};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The arguments of `dermis live`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    source: SourceArguments,
    /// Rows of values (csv:...) are differences from the untouched skin.
    #[arg(long)]
    difference: bool,
    #[arg(long, value_name = "NAME|FOLDER", help = METHOD_HELP)]
    method: Option<String>,
    /// Detection threshold, as a multiple of the method's own [default: 1]
    #[arg(long, value_name = "TIMES", value_parser = number(1e-6..=1e6))]
    threshold: Option<f64>,
    /// Named zone with its own threshold, NAME=X,Y,Z,RADIUS,TIMES: a ball (m) and a multiple of --threshold. May be
    /// given more than once.
    #[arg(long, value_name = "ZONE", value_parser = parse_zone)]
    zone: Vec<Zone>,
    /// Detect contacts that raise and contacts that lower the conductance; each contact says which it does. Linear
    /// methods only.
    #[arg(long)]
    both_signs: bool,
    #[command(flatten)]
    leave_out: LeaveOutElectrodes,
    /// Tare with frames that are unlike the model of the design, or that are all the same, as those of a simulation without
    /// noise.
    #[arg(long)]
    force: bool,
    /// Record to a new file (MCAP).
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Begin another file of a recording after this size or time, as in 1GiB or 10min: FILE_1, FILE_2, ... Each is a
    /// complete recording. May be given twice, for a size and a time.
    #[arg(long, value_name = "SIZE|TIME", value_parser = part)]
    record_split: Vec<Part>,
    /// Delete the oldest files of a recording before all of them together exceed this size, as in 20GiB.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    record_keep: Option<u64>,
    #[command(flatten)]
    ros2: Ros2Arguments,
    /// Name of the frame of the ROS 2 messages, as in left_cylinder30 [default: the design's name, as in its URDF]
    #[arg(long, value_name = "NAME", requires = "ros2", value_parser = frame_id)]
    frame_id: Option<String>,
    /// Compare the first frames, of the untouched skin, with the design, as dermis check-build does: findings are notices.
    #[arg(long, conflicts_with = "difference")]
    check_build: bool,
    /// Take the times of frames from the device's clock alone, for a device in a simulator that is slower than real time.
    #[arg(long)]
    device_time: bool,
    /// Write a line of JSON per frame: `-` to standard output, tcp:127.0.0.1:PORT to every program on this machine that
    /// connects.
    #[arg(long, value_name = "WHERE", value_parser = lines)]
    jsonl: Option<Lines>,
    /// Send a UDP datagram to HOST:PORT for each frame that is ok or degraded, for a watchdog that stops a robot when
    /// none arrives.
    #[arg(long, value_name = "HOST:PORT")]
    watchdog: Option<String>,
    #[command(flatten)]
    page: PageArguments,
    /// State file: the baseline and settings are restored from it, if it exists, instead of a tare, and saved to it. Electrodes
    /// that were left out stay so.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Run for this many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = number(0.0..=1e9))]
    for_s: Option<f64>,
    /// Draw a histogram of the latency from the last byte of a frame to its contacts (SVG).
    #[arg(long, value_name = "FILE")]
    latency: Option<PathBuf>,
    /// Print the statistics of the run as JSON (not with --jsonl).
    #[arg(long, conflicts_with = "jsonl")]
    json: bool,
}

/// Largest file of a state, bytes: the baselines of a million channels.
const LARGEST_STATE: u64 = 128 << 20;

/// Capacity of the queue of events.
const WAITING: usize = 1 << 16;

impl Arguments {
    /// Reads the skin until interrupted.
    pub fn run(self) -> Outcome {
        if let Some(path) = &self.record {
            self.limits().check_new(path).map_err(dermis_live::LiveError::from)?;
        }
        let design = SkinDesign::load(&self.design)?;
        let left_out = self.leave_out.of(&design.protocol)?;
        let state = self.kept_state(&left_out)?;
        let (live, emulator) = match self.source.recording() {
            Some(recording) => (self.play(&self.methods()?, recording)?, None),
            None => {
                // The emulated device is made meanwhile.
                let (methods, source) = std::thread::scope(|scope| {
                    let source = scope.spawn(|| self.source.address(&design));
                    let methods = self.methods();
                    (methods, source.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                });
                let (address, emulator) = source?;
                (Live::start(methods?, self.options(address, state, left_out))?, emulator)
            }
        };
        let control = Arc::new(self.source.control(&live, emulator.clone(), self.limits())?);
        let sinks = self.open(&control)?;
        let Watched { statistics, uncounted, is_connected } = self.watch(&live, emulator.as_deref())?;
        let failure = self.close(live, emulator, &control, sinks)?;
        if !is_connected && failure.is_none() {
            let fix = "switch the device on, or give its address with --source";
            return Err(Failure::given("no device came, and nothing was read", Some(fix)));
        }
        latency::show(&statistics, uncounted, self.latency.as_deref(), self.json)?;
        failure.map_or(Ok(()), Err)
    }

    /// The skin with its methods.
    fn methods(&self) -> Outcome<Arc<MethodSet>> {
        let _waiting = crate::console::Progress::waiting("preparing");
        let skin = Skin::load(&self.design)?;
        Ok(Arc::new(MethodSet::new(&dermis_learn::methods(), skin, self.method.as_deref())?))
    }

    /// Plays a recording. Options given here override the recorded settings.
    fn play(&self, methods: &Arc<MethodSet>, recording: &Path) -> Outcome<Live> {
        if self.check_build {
            let fix = "check its untouched frames with dermis check-build DESIGN --frames FILE";
            return Err(Failure::given("a recording takes no --check-build", Some(fix)));
        }
        let is_set = self.both_signs || self.device_time || self.leave_out.are_given();
        if self.state.is_some() || self.source.rate.is_some() || is_set {
            let fix = "leave them out: a recording has its own";
            let what = "a recording takes no --state, --rate, --both-signs, --device-time and --leave-out-electrode";
            return Err(Failure::given(what, Some(fix)));
        }
        let zones = self.zone.clone();
        let player = Player::open(recording, methods, self.source.emulator.speed())?;
        let recorded_with = player.state().settings.method.clone();
        let live = Live::play(Arc::clone(methods), player)?;
        let mut commands = Vec::new();
        if let Some(method) = self.method.as_ref().filter(|method| **method != recorded_with) {
            methods.method(method)?;
            commands.push(Command::Method { name: method.clone() });
        }
        commands.extend(self.threshold.map(|value| Command::Threshold { value }));
        commands.extend((!zones.is_empty()).then_some(Command::Zones { zones }));
        commands.into_iter().for_each(|command| live.shared().command(command));
        Ok(live)
    }

    fn options(&self, address: Address, state: Option<State>, left_out_electrodes: Vec<usize>) -> LiveOptions {
        let zones = self.zone.clone();
        let method = self.method.clone().unwrap_or_default();
        let threshold = self.threshold.unwrap_or(1.0);
        // A calibration knows the skin as it is; differences from the untouched skin are noise in a tare.
        let force_tare = self.force || self.difference || Calibration::is_named(&method) || self.source.is_noise_free();
        let both_signs = self.both_signs;
        let settings =
            Settings { method, threshold, zones, both_signs, left_out_electrodes, force_tare, ..Settings::default() };
        let (rate_hz, difference, device_time) = (self.source.rate, self.difference, self.device_time);
        let device = DeviceOptions { rate_hz, difference, device_time };
        LiveOptions { address, device, settings, state, waits: true }
    }

    /// The limits of recordings, of those that the page begins too.
    fn limits(&self) -> RecordingLimits {
        let bytes = |part: &Part| if let Part::Bytes(bytes) = part { Some(*bytes) } else { None };
        let seconds = |part: &Part| if let Part::Seconds(seconds) = part { Some(*seconds) } else { None };
        RecordingLimits {
            part_bytes: self.record_split.iter().filter_map(bytes).min(),
            part_s: self.record_split.iter().filter_map(seconds).min_by(f64::total_cmp),
            total_bytes: self.record_keep,
        }
    }

    fn kept_state(&self, left_out: &[usize]) -> Outcome<Option<State>> {
        let Some(path) = self.state.as_ref().filter(|path| path.exists()) else { return Ok(None) };
        let wrong = |why: String| {
            let message = format!("the kept state {} cannot be read: {why}", path.display());
            Failure::given(message, Some("delete it and tare anew"))
        };
        let text = read_text_at_most(path, LARGEST_STATE).map_err(|error| wrong(error.to_string()))?;
        let mut state: State = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        state.settings.both_signs |= self.both_signs;
        state.settings.force_tare |= self.force;
        state.settings.left_out_electrodes.extend(left_out);
        state.settings.left_out_electrodes.sort_unstable();
        state.settings.left_out_electrodes.dedup();
        Ok(Some(state))
    }

    /// Starts the outputs.
    fn open(&self, control: &Arc<Control>) -> Outcome<Sinks> {
        let shared = control.shared();
        let mut sinks = Sinks::default();
        if self.check_build {
            check_first_frames(shared);
        }
        if self.ros2.ros2 {
            sinks.threads.push(publish(control, &self.ros2, self.frame_id.clone())?);
        }
        sinks.server = self.page.serve(control)?;
        if let Some(path) = &self.record {
            control.record(path)?;
        }
        if let Some(address) = &self.watchdog {
            sinks.threads.push(watchdog::send(shared, address)?);
        }
        match &self.jsonl {
            None => {}
            Some(Lines::Standard) => {
                let (shared, lines) = (Arc::clone(shared), jsonl::lines(shared));
                sinks.lines = Some(std::thread::spawn(move || {
                    if let Err(error) = jsonl::write_lines(&shared, &lines, &mut std::io::stdout()) {
                        say(format_args!("lines of JSON have ended: {error}"));
                    }
                }));
            }
            Some(Lines::Tcp(address)) => {
                let (bound, thread) = jsonl::serve_lines(shared, address)?;
                note(&format!("lines of JSON are at tcp:{bound}"));
                sinks.threads.push(thread);
            }
        }
        Ok(sinks)
    }

    /// Shows notices and statistics until the end.
    fn watch(&self, live: &Live, emulator: Option<&Emulator>) -> Outcome<Watched> {
        let ended = interrupted()?;
        let mailbox = live.shared().subscribe(WAITING);
        live.begin();
        let mut statistics = LiveStatistics::new(Arc::clone(live.shared()));
        let (begun, mut shown) = (Instant::now(), Instant::now());
        let line = crate::console::StatusLine::new();
        let mut is_connected = false;
        while !ended.load(Ordering::Relaxed) {
            match mailbox.take(Duration::from_millis(100)) {
                Popped::Item(Event::Frame(frame)) => statistics.add(&frame),
                Popped::Item(Event::Stale(frame)) => statistics.show_state(&frame),
                Popped::Item(Event::Notice(notice)) => line.notice(notice.level, &notice.text),
                Popped::Item(Event::Lost(why)) => line.notice(Severity::Error, &why),
                Popped::Item(Event::Connected(_)) => is_connected = true,
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => break,
            }
            if shown.elapsed() > Duration::from_millis(200) {
                shown = Instant::now();
                line.show(&statistics.line());
            }
            let is_over = self.for_s.is_some_and(|for_s| begun.elapsed().as_secs_f64() >= for_s);
            if is_over || emulator.is_some_and(Emulator::has_failed) {
                break;
            }
        }
        Ok(Watched { statistics, uncounted: mailbox.dropped(), is_connected })
    }

    /// Stops everything in order, so that no recorded frame is lost. Returns why the input ended early, if it did.
    fn close(
        &self,
        live: Live,
        emulator: Option<Arc<Emulator>>,
        control: &Control,
        sinks: Sinks,
    ) -> Outcome<Option<Failure>> {
        let failure = match emulator.as_deref().is_some_and(Emulator::has_failed) {
            true => Some(Failure::Ours("the emulated device has failed (see above)".into())),
            false => live.take_failure().map(Failure::from),
        };
        // What the skin has published until then is recorded.
        let state = live.stop();
        let taped = control.end_recording();
        if let Some(emulator) = emulator {
            emulator.stop();
        }
        sinks.threads.into_iter().for_each(|thread| drop(thread.join()));
        if let Some(server) = sinks.server {
            server.stop();
        }
        if let Some(path) = &self.state {
            let text = serde_json::to_string(&state).map_err(|error| Failure::Ours(error.to_string()))?;
            write_whole(path, |out| out.write_all(text.as_bytes()))?;
        }
        sinks.lines.into_iter().for_each(|lines| wait_a_moment(&lines));
        let Some((path, ended)) = taped else { return Ok(failure) };
        if let Some(problem) = ended.problem {
            return Err(Failure::given(format!("the recording ended early: {problem}"), None));
        }
        note(&summary(&path, &ended));
        Ok(failure)
    }
}

/// What was seen of a live skin.
struct Watched {
    statistics: LiveStatistics,
    /// Events that were not counted.
    uncounted: u64,
    /// Whether there was a device at any time.
    is_connected: bool,
}

/// What was recorded.
fn summary(path: &Path, RecordingStatus { written, parts, deleted, .. }: &RecordingStatus) -> String {
    let file = path.display().to_string();
    let mut text = format!("{}: {}, {:.1} s", printable(&file), counted(written.frames, "frame"), written.seconds);
    if *parts > 1 {
        text += &format!(", in {parts} files");
    }
    if *deleted > 0 {
        text += &format!(", of which the oldest {deleted} were deleted");
    }
    text
}

/// The outputs of frames.
#[derive(Default)]
struct Sinks {
    server: Option<Server>,
    threads: Vec<JoinHandle<()>>,
    /// Lines of JSON to standard output, whose reader may have stopped reading.
    lines: Option<JoinHandle<()>>,
}

/// Waits a short time for a thread to end.
fn wait_a_moment(thread: &JoinHandle<()>) {
    let begun = Instant::now();
    while !thread.is_finished() && begun.elapsed() < Duration::from_millis(500) {
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[cfg(feature = "ros2")]
fn publish(control: &Control, ros2: &Ros2Arguments, frame_id: Option<String>) -> Outcome<JoinHandle<()>> {
    Ok(dermis_live::sinks::ros2::dds::publish(control.shared(), &ros2.options(frame_id))?)
}

#[cfg(not(feature = "ros2"))]
fn publish(_: &Control, _: &Ros2Arguments, _: Option<String>) -> Outcome<JoinHandle<()>> {
    Err(crate::sinks::without_ros2())
}

/// The name of a frame: tf2 refuses empty names and a slash at the beginning.
fn frame_id(text: &str) -> Result<String, String> {
    match text.is_empty() || text.starts_with('/') || text.contains(char::is_whitespace) {
        true => Err("the name of a frame is not empty, has no spaces, and does not begin with a slash".into()),
        false => Ok(text.into()),
    }
}

/// A zone from `NAME=X,Y,Z,RADIUS,TIMES`.
fn parse_zone(text: &str) -> Result<Zone, String> {
    let parse = || {
        let (name, numbers) = text.split_once('=')?;
        let numbers = numbers.split(',').map(|number| number.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
        let [x, y, z, radius_m, threshold] = numbers[..] else { return None };
        Some(Zone { name: name.into(), centre_m: [x, y, z], radius_m, threshold })
    };
    parse().ok_or_else(|| {
        format!("`{text}` is no zone: write NAME=X,Y,Z,RADIUS,TIMES in metres, as in palm=0,0.05,0.1,0.04,2")
    })
}
