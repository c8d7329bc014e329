//! `dermis robot`: several skins on one robot.

use crate::console::{StatusLine, interrupted, note, print, print_json, warn};
use crate::emulated::EmulatorArguments;
use crate::failure::{Failure, Outcome};
use crate::output::{json_line, to_standard_output};
use crate::range::number;
use crate::sinks::{Lines, RobotPublisher, Ros2Arguments, lines};
use crate::source::PageArguments;
use clap::{Args, Subcommand};
use dermis::pipeline::{Notice, Severity};
use dermis::text::{counted, printable};
use dermis_calibrate::Calibration;
use dermis_emulate::robot::{RobotDevices, SWING_EVERY};
use dermis_live::robot::{RobotLive, RobotOptions, RobotOutput, RobotReplay, RobotReport, check};
#[cfg(feature = "ros2")]
use dermis_live::sinks::ros2::dds::PublishError;
use dermis_live::sinks::viewer::{RobotRequest, RobotServer};
use dermis_live::sinks::{jsonl, jsonl::LineServer, watchdog};
use dermis_live::{LiveOptions, clock};
use dermis_robot::{Cause, EventKind, Kinematics, Robot, RuleEvent, Snapshot, Zone};
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The arguments of `dermis robot`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: RobotCommand,
}

#[derive(Debug, Subcommand)]
enum RobotCommand {
    /// Check the file of a robot: links, designs, methods, skins that meet or overlap, the load.
    Check(CheckArguments),
    /// Read the skins of a robot live: contacts in its frame, wrenches, rules.
    Run(Box<RunArguments>),
    /// Recompute the events and snapshots of a recording of a robot.
    Replay(ReplayArguments),
    /// List the links and joints of a robot description (URDF).
    Links(LinkArguments),
}

#[derive(Debug, Args)]
struct CheckArguments {
    /// File of the robot (TOML).
    robot: PathBuf,
    /// Frames per second for which the load is computed.
    #[arg(long, value_name = "HZ", default_value_t = 120.0, value_parser = number(0.001..=1e6))]
    rate: f64,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct ReplayArguments {
    /// Folder of the recording.
    recording: PathBuf,
    /// Print a summary instead of a line of JSON for each event and snapshot.
    #[arg(long)]
    summary: bool,
    /// Print JSON, which the lines are always: the summary too.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct LinkArguments {
    /// Robot description (URDF).
    description: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct RunArguments {
    /// File of the robot (TOML).
    robot: PathBuf,
    /// Simulate all devices, and joints that move slowly unless the file names a source of joint states.
    #[arg(long)]
    emulate: bool,
    #[command(flatten)]
    emulator: EmulatorArguments,
    /// Snapshots per second.
    #[arg(long, value_name = "HZ", default_value_t = 50.0, value_parser = number(0.1..=1000.0))]
    rate: f64,
    /// Write a line of JSON for each snapshot, and one for each event at once: `-` to standard output, tcp:127.0.0.1:PORT to
    /// every program on this machine that connects.
    #[arg(long, value_name = "WHERE", value_parser = lines)]
    jsonl: Option<Lines>,
    #[command(flatten)]
    ros2: Ros2Arguments,
    /// Record the skins, joint states and events in this new folder, for `dermis robot replay`.
    #[arg(long, value_name = "FOLDER")]
    record: Option<PathBuf>,
    /// Share the skins at HOST:PORT of this machine with the program of the whole robot, whose file has the source
    /// robot:HOST:PORT.
    #[arg(long, value_name = "HOST:PORT")]
    share: Option<String>,
    #[command(flatten)]
    page: PageArguments,
    /// Send a UDP datagram to HOST:PORT for each snapshot in which every required skin is known.
    #[arg(long, value_name = "HOST:PORT")]
    watchdog: Option<String>,
    /// Run for this many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = number(0.0..=1e9))]
    for_s: Option<f64>,
}

impl Arguments {
    /// Runs the command.
    pub fn run(self) -> Outcome {
        match self.command {
            RobotCommand::Check(arguments) => arguments.run(),
            RobotCommand::Run(arguments) => arguments.run(),
            RobotCommand::Replay(arguments) => arguments.run(),
            RobotCommand::Links(arguments) => arguments.run(),
        }
    }
}

/// Fewest snapshots per second for ROS 2: two in a deadline.
#[cfg(feature = "ros2")]
const LEAST_ROS2_HZ: f64 = 8.0;
/// A crash loses less than this: files are written twice a second.
const LOST_IN_A_CRASH_S: f64 = 1.0;

/// What a replay counts.
#[derive(Debug, Default, Serialize)]
struct ReplayCounts {
    snapshots: u64,
    touched_snapshots: u64,
    events: u64,
    missing_frames: u64,
}

impl ReplayArguments {
    fn run(self) -> Outcome {
        let mut replay = RobotReplay::open(&self.recording, &dermis_learn::methods())?;
        let waiting = crate::console::Progress::waiting("replaying");
        let (mut counts, mut failure) = (ReplayCounts::default(), Ok(()));
        // A reader that has enough ends it before.
        let mut is_read = false;
        to_standard_output(|out| {
            loop {
                let output = match replay.step() {
                    Ok(Some(output)) => output,
                    Ok(None) => break,
                    Err(error) => {
                        failure = Err(error);
                        return Ok(());
                    }
                };
                match &output {
                    RobotOutput::Event(_) => counts.events += 1,
                    RobotOutput::Snapshot(snapshot) => {
                        counts.snapshots += 1;
                        counts.touched_snapshots += u64::from(snapshot.touched == Some(true));
                    }
                    RobotOutput::Notice { .. } | RobotOutput::Frame(..) => continue,
                }
                if !self.summary {
                    json_line(out, &output)?;
                }
            }
            is_read = true;
            Ok(())
        })?;
        drop(waiting);
        failure?;
        counts.missing_frames = replay.missing_frames();
        match (self.summary, self.json) {
            (true, true) => print_json(&counts)?,
            (true, false) => {
                let snapshots = counted(counts.snapshots, "snapshot");
                let events = counted(counts.events, "event");
                print(&format!("{snapshots}, {} of them touched, {events}\n", counts.touched_snapshots))?;
            }
            _ => {}
        }
        if counts.missing_frames == 0 {
            if !replay.is_whole() && is_read {
                warn(&format!(
                    "{} has no end: it was cut off, so that what came later is missing, or it is of an earlier version",
                    self.recording.display()
                ));
            }
            return Ok(());
        }
        let frames = counted(counts.missing_frames, "frame");
        if let Some(cut_off_s) = replay.cut_off_s().filter(|cut_off_s| *cut_off_s < LOST_IN_A_CRASH_S) {
            note(&format!(
                "the recording was cut off: {frames} of its last {cut_off_s:.2} s were not written yet, so what it says of them is not \
                 what was said"
            ));
            return Ok(());
        }
        Err(Failure::given(
            format!("the recordings of the skins lack {frames} that the robot took: they were cut off or damaged"),
            None,
        ))
    }
}

impl LinkArguments {
    fn run(self) -> Outcome {
        let kinematics = Kinematics::load(&self.description)?;
        if self.json {
            let joints: Vec<&str> = kinematics.joint_names().collect();
            return print_json(&serde_json::json!({ "links": kinematics.links(), "joints": joints }));
        }
        let rows = kinematics.tree().into_iter().map(|(depth, link, joint)| {
            let joint = joint.map(|joint| format!("  ({joint})")).unwrap_or_default();
            // Chains of thousands of links stay readable.
            format!("{}{link}{joint}\n", "  ".repeat(depth.min(40)))
        });
        print(&rows.collect::<String>())
    }
}

impl CheckArguments {
    fn run(self) -> Outcome {
        let robot = Robot::load(&self.robot)?;
        let waiting = crate::console::Progress::waiting("preparing the skins");
        let report = check(&robot, &dermis_learn::methods(), self.rate)?;
        drop(waiting);
        if self.json {
            print_json(&report)?;
        } else {
            print(&table(&report))?;
        }
        report.warnings.iter().for_each(|text| warn(text));
        let overlapping = report.neighbours.iter().find(|pair| pair.overlap > 0.0);
        overlapping.map_or(Ok(()), |pair| {
            let [a, b] = &pair.skins;
            let message = format!("the skins `{a}` and `{b}` overlap: {:.0} % of `{a}`", 100.0 * pair.overlap);
            Err(Failure::given(message, Some("mend the `origin` of one of them")))
        })
    }
}

/// The report for people.
fn table(report: &RobotReport) -> String {
    let base = report.base.as_deref().unwrap_or("none: without a robot description");
    let joints = if report.joints.is_empty() { "none".into() } else { report.joints.join(", ") };
    let mut text = format!("{}: base {base}, joints {joints}\n\n", report.robot);
    text += "| skin | link | design | method | forces | electrodes | cells | ms a frame | source |\n|---|---|---|---|---|--:|--:|--:|---|\n";
    for skin in &report.skins {
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} | {:.2} | {} |\n",
            skin.skin,
            skin.link,
            skin.design,
            skin.method,
            match skin.forces {
                Some(true) => "yes",
                Some(false) => "no",
                None => "unknown",
            },
            skin.electrodes,
            skin.cells,
            1e3 * skin.frame_s,
            skin.source
        );
    }
    for pair in &report.neighbours {
        let [a, b] = &pair.skins;
        text += &format!("\n`{a}` and `{b}` are {:.1} mm apart", 1e3 * pair.distance_m);
    }
    text + &format!("\nall pipelines at {} Hz: {:.2} cores\n", report.rate_hz, report.cores)
}

impl RunArguments {
    fn run(self) -> Outcome {
        let robot = Arc::new(Robot::load(&self.robot)?);
        let ended = interrupted()?;
        let heartbeat = self.watchdog.as_deref().map(watchdog::socket).transpose()?;
        self.check_emulation(&robot)?;
        // An address that is in use is known before the skins are prepared.
        let mut page = self.page.serve_robot(&robot)?;
        let server = match &self.jsonl {
            Some(Lines::Tcp(address)) => Some(LineServer::start(address)?),
            _ => None,
        };
        let mut devices = RobotDevices::new(self.emulate);
        let waiting = crate::console::Progress::waiting("preparing the skins");
        let (record, share) = (self.record.clone(), self.share.clone());
        let how = RobotOptions { rate_hz: self.rate, record, frames: self.ros2.ros2, share };
        let started =
            RobotLive::start(&robot, &dermis_learn::methods(), &how, |skin| self.options(&robot, skin, &mut devices));
        drop(waiting);
        let mut live = started?;
        let mut ros2 = self.publisher(&robot, &live)?;
        server.iter().for_each(|server| note(&format!("lines of JSON are at tcp:{}", server.address())));
        live.share_address().iter().for_each(|address| note(&format!("the skins are shared at robot:{address}")));
        let (begun, mut shown) = (Instant::now(), Instant::now());
        let line = StatusLine::new();
        let mut counts = (0_u64, 0_u64);
        let has_time = || self.for_s.is_none_or(|for_s| begun.elapsed().as_secs_f64() < for_s);
        while !ended.load(Ordering::Relaxed) && has_time() {
            devices.swing(&mut live);
            for RobotRequest::Tare { skin } in page.iter().flat_map(RobotServer::requests) {
                live.tare(skin.as_deref());
            }
            let Some(output) = live.next(SWING_EVERY) else { continue };
            // Without a reader there is no line to make.
            let is_read = self.jsonl.is_some() && server.as_ref().is_none_or(|server| server.readers() > 0);
            if is_read && matches!(output, RobotOutput::Event(_) | RobotOutput::Snapshot(_)) {
                let line = jsonl::line(&output).map_err(|error| Failure::Ours(error.to_string()))?;
                match &server {
                    Some(server) => {
                        server.send(&line);
                    }
                    None if !write_line(&line)? => break,
                    None => {}
                }
            }
            if let Some(error) = ros2.as_mut().and_then(|ros2| publish(ros2, &robot, &output)) {
                ros2 = None;
                line.notice(Severity::Error, &format!("publishing has ended: {error}"));
            }
            match output {
                RobotOutput::Frame(..) => {}
                RobotOutput::Event(event) => {
                    counts.1 += 1;
                    let text = event_text(&event);
                    line.print(&text);
                    if let Some(page) = &page {
                        page.say(Notice { level: Severity::Info, text, at: event.at });
                    }
                }
                RobotOutput::Notice { skin, notice } => {
                    let whose = skin.map(|skin| format!("{skin}: ")).unwrap_or_default();
                    let text = format!("{whose}{}", notice.text);
                    line.notice(notice.level, &text);
                    if let Some(page) = &page {
                        page.say(Notice { text, ..notice });
                    }
                }
                RobotOutput::Snapshot(snapshot) => {
                    counts.0 += 1;
                    if let Some(page) = &mut page {
                        page.show(&robot, &snapshot, live.state().poses(snapshot.at).as_deref());
                    }
                    if let Some(socket) = heartbeat.as_ref().filter(|_| snapshot.complete) {
                        let alive = serde_json::json!({ "at": snapshot.at, "touched": snapshot.touched });
                        // Without a datagram the watchdog stops the robot, as it should.
                        let _ = socket.send(alive.to_string().as_bytes());
                    }
                    if shown.elapsed() > Duration::from_millis(200) {
                        shown = Instant::now();
                        line.show(&status(&snapshot));
                    }
                }
            }
        }
        drop(line);
        let last = live.state().snapshot(clock::now());
        let incomplete = live.stop();
        page.into_iter().for_each(RobotServer::stop);
        drop(devices);
        note(&format!("{}, {}; {}", counted(counts.0, "snapshot"), counted(counts.1, "event"), status(&last)));
        incomplete.map_or(Ok(()), |why| Err(Failure::given(format!("the recording is not complete: {why}"), None)))
    }

    /// Refuses options of simulated devices where none is.
    fn check_emulation(&self, robot: &Robot) -> Outcome {
        let is_emulated = self.emulate || robot.skins().iter().any(|worn| worn.source == "emulate");
        match self.emulator.changed() {
            Some(option) if !is_emulated => {
                let message = format!("{option} is of simulated devices, and no skin has one");
                Err(Failure::given(message, Some("give --emulate too, or write source = \"emulate\"")))
            }
            _ => Ok(()),
        }
    }

    /// What publishes the robot.
    #[cfg(feature = "ros2")]
    fn publisher(&self, robot: &Robot, live: &RobotLive) -> Outcome<Option<RobotPublisher>> {
        // Contacts and zones have a deadline of a quarter of a second.
        if self.ros2.ros2 && self.rate < LEAST_ROS2_HZ {
            let message = format!("--ros2 at {} snapshots a second: subscribers take it for a failure", self.rate);
            return Err(Failure::given(message, Some("give --rate 8 or more")));
        }
        let given = |error: PublishError| Failure::given(error.to_string(), None);
        let publisher = || RobotPublisher::new(robot, &live.skins(), &self.ros2.options(None)).map_err(given);
        self.ros2.ros2.then(publisher).transpose()
    }

    #[cfg(not(feature = "ros2"))]
    fn publisher(&self, _: &Robot, _: &RobotLive) -> Outcome<Option<RobotPublisher>> {
        if self.ros2.ros2 { Err(crate::sinks::without_ros2()) } else { Ok(None) }
    }

    /// How a skin is read.
    fn options(&self, robot: &Robot, skin: usize, devices: &mut RobotDevices) -> Outcome<Option<LiveOptions>> {
        let method = robot.skins()[skin].method.as_deref().unwrap_or_default();
        // A calibration knows the skin as it is; a twin without noise has equal frames.
        let force_tare = Calibration::is_named(method) || self.emulate && self.emulator.is_noise_free();
        devices.options(robot, skin, force_tare, |design, serial| {
            self.emulator.with_seed(u64::from(serial)).emulator(design)
        })
    }
}

/// Publishes what a robot says; returns an error that ends publishing.
#[cfg(feature = "ros2")]
fn publish(ros2: &mut RobotPublisher, robot: &Robot, output: &RobotOutput) -> Option<String> {
    let sent = match output {
        RobotOutput::Event(event) => ros2.event(event),
        RobotOutput::Snapshot(snapshot) => ros2.snapshot(robot, snapshot),
        RobotOutput::Frame(skin, frame) => ros2.frame(*skin, frame),
        RobotOutput::Notice { .. } => Ok(()),
    };
    sent.err().map(|error| error.to_string())
}

#[cfg(not(feature = "ros2"))]
fn publish(ros2: &mut RobotPublisher, _: &Robot, _: &RobotOutput) -> Option<String> {
    match *ros2 {}
}

/// Writes a line; returns whether anyone still reads.
fn write_line(line: &[u8]) -> Outcome<bool> {
    let mut out = std::io::stdout().lock();
    match out.write_all(line).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(Failure::given(format!("standard output cannot be written: {error}"), None)),
    }
}

fn event_text(event: &RuleEvent) -> String {
    if event.event == EventKind::Ends {
        return format!("{} ends", event.rule);
    }
    let cause = match &event.cause {
        Cause::Touched { skin } => format!("{skin} is touched"),
        Cause::Unknown { skin, reason } => {
            format!("{skin} is unknown: {}", reason.map_or("its force is not known", |reason| reason.text()))
        }
    };
    let verb = if event.event == EventKind::Changes { "goes on" } else { "begins" };
    printable(&format!("{} {verb} ({cause})", event.rule)).into_owned()
}

/// A line about all skins.
fn status(snapshot: &Snapshot) -> String {
    let of_skin = |skin: &dermis_robot::SkinSnapshot| {
        let zone = match skin.zone {
            Zone::Clear => "clear".into(),
            Zone::Touched => "touched".into(),
            Zone::Unknown { reason } => format!("unknown, {}", reason.text()),
        };
        format!("{} {zone}", skin.skin)
    };
    let skins: Vec<String> = snapshot.skins.iter().map(of_skin).collect();
    printable(&format!("{}; {}", skins.join("; "), counted(snapshot.contacts.len(), "contact"))).into_owned()
}
