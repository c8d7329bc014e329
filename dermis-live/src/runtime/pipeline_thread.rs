//! The thread that runs the pipeline.

use crate::clock;
use crate::device::IncomingFrame;
use crate::runtime::watch::Watch;
use crate::runtime::{Event, Input, LiveFrame, LiveHandle, POLL, Popped, WorkItem};
use dermis::pipeline::{Command, DriftFit, Notice, Pipeline, PipelineError, RebuiltMethod, Severity, State};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Minimum interval between two reports of dropped events.
const REPORT_DROPPED: Duration = Duration::from_secs(1);
/// Contacts that are older than this when they are known are stale, s.
const LATE_S: f64 = 0.05;
/// A frame that has waited for longer than this is skipped if a newer one waits, s.
const SKIPPED_S: f64 = 0.025;
/// Interval at which the state is saved for [`LiveHandle::state`].
const SAVE: Duration = Duration::from_secs(5);

/// Runs the pipeline on the frames of the device, and its jobs on threads of their own.
pub(super) struct PipelineThread {
    shared: Arc<LiveHandle>,
    pipeline: Pipeline,
    /// Whether the method is prepared again when the masked channels change; during playback, the recording contains
    /// these changes.
    rebuilds: bool,
    /// Whether late frames are of no use.
    is_live: bool,
    /// Whether frames wait for a method that is prepared again: their contacts do not depend on the speed of the computer.
    waits: bool,
    rebuilding: Option<JoinHandle<Result<RebuiltMethod, PipelineError>>>,
    fitting: Option<JoinHandle<Result<DriftFit, PipelineError>>>,
    /// The masked channels of the last attempt to prepare the method again, and whether it was adapted to a tare: it is not
    /// repeated.
    tried_without: Option<(Vec<usize>, bool)>,
    saved_at: Instant,
    watch: Arc<Watch>,
    /// The dropped events that were reported, and when.
    reported_dropped: (BTreeMap<&'static str, u64>, Instant),
}

impl PipelineThread {
    pub(super) fn new(shared: Arc<LiveHandle>, pipeline: Pipeline, input: Input, watch: Arc<Watch>) -> Self {
        PipelineThread {
            shared,
            pipeline,
            rebuilds: input != Input::Recording,
            is_live: input == Input::Device,
            waits: input == Input::Stream,
            rebuilding: None,
            fitting: None,
            tried_without: None,
            saved_at: Instant::now(),
            watch,
            reported_dropped: (BTreeMap::new(), Instant::now()),
        }
    }

    /// Runs until no more frames come.
    pub(super) fn run(mut self) {
        loop {
            self.run_commands();
            self.report_dropped();
            self.shared.report_omitted(false);
            self.watch.set_busy(false);
            let next = self.shared.take_work(POLL);
            self.watch.set_busy(matches!(next, Popped::Item(_)));
            match next {
                Popped::Item(WorkItem::Frame(incoming)) => {
                    // What was requested while the thread waited comes before this frame.
                    self.run_commands();
                    let newest = self.newest(*incoming);
                    self.process(newest);
                }
                Popped::Item(WorkItem::Command(command)) => self.carry_out(command),
                Popped::Item(WorkItem::Restart(state)) => self.restart(*state),
                Popped::TimedOut => {}
                Popped::Closed => break,
            }
        }
        self.watch.end();
        self.report_missing_tare();
        self.shared.report_omitted(true);
        self.shared.set_state(&self.pipeline);
        self.shared.close_mailboxes();
    }

    /// The newest frame that waits, if the given one is late already: a skin that cannot keep up skips frames.
    fn newest(&mut self, mut frame: IncomingFrame) -> IncomingFrame {
        let mut skipped = 0;
        while self.is_live && clock::now().seconds_since(frame.received_at) > SKIPPED_S {
            match self.shared.take_work(Duration::ZERO) {
                Popped::Item(WorkItem::Frame(newer)) => (frame, skipped) = (*newer, skipped + 1),
                Popped::Item(WorkItem::Command(command)) => self.carry_out(command),
                Popped::Item(WorkItem::Restart(state)) => self.restart(*state),
                Popped::TimedOut | Popped::Closed => break,
            }
        }
        self.shared.add_late(skipped);
        frame
    }

    fn process(&mut self, incoming: IncomingFrame) {
        self.install_drift_fit();
        match process(&mut self.pipeline, incoming) {
            Ok(mut frame) => {
                let age_s = frame.output_at.seconds_since(frame.received_at);
                if self.is_live && age_s > LATE_S && frame.result.validity.is_usable() {
                    frame = LiveFrame { message: std::mem::take(&mut frame.message), ..frame.stale(age_s) };
                }
                self.watch.publish(frame);
            }
            Err(error) => self.shared.notice(Severity::Error, error.to_string()),
        }
        for notice in self.pipeline.take_notices() {
            self.shared.publish(&Event::Notice(notice));
        }
        self.start_drift_fit();
        self.rebuild();
        if self.saved_at.elapsed() > SAVE {
            self.saved_at = Instant::now();
            self.shared.set_state(&self.pipeline);
        }
    }

    /// Begins again with the state of a recording.
    fn restart(&mut self, state: State) {
        match Pipeline::resume(Arc::clone(self.shared.methods()), state) {
            Ok(pipeline) => {
                (self.pipeline, self.rebuilds, self.rebuilding, self.fitting) = (pipeline, false, None, None);
                self.shared.set_state(&self.pipeline);
                self.watch.rest();
            }
            Err(error) => self.shared.notice(Severity::Error, error.to_string()),
        }
    }

    /// Reports that the input has ended without a baseline.
    fn report_missing_tare(&self) {
        if !self.shared.is_stopped() && self.pipeline.state().baseline_ohm().is_none() {
            let needed = self.pipeline.state().settings.tare_frames;
            let text = format!(
                "the frames ended before the tare did, so that no contact could be found: it needs {needed} frames of the untouched \
                 skin"
            );
            self.shared.notice(Severity::Warning, text);
        }
    }

    /// Reports the events that sinks have dropped since the last report.
    fn report_dropped(&mut self) {
        let (reported, reported_at) = &mut self.reported_dropped;
        if reported_at.elapsed() < REPORT_DROPPED {
            return;
        }
        for (sink, count) in self.shared.dropped() {
            let more = count.saturating_sub(reported.get(sink).copied().unwrap_or(0));
            if more > 0 {
                let text = format!("{sink}: too slow; frames or messages dropped: {more}");
                self.shared.notice(Severity::Warning, text);
            }
        }
        // The notices below can be dropped themselves; these drops are not reported.
        (*reported, *reported_at) = (self.shared.dropped(), Instant::now());
    }

    fn run_commands(&mut self) {
        if self.shared.take_state_request() {
            self.shared.publish(&Event::State(Arc::new(self.pipeline.state().clone())));
        }
        while let Some(command) = self.shared.take_command() {
            // From here on the playback differs from the recording.
            self.rebuilds = true;
            self.carry_out(command);
        }
    }

    fn carry_out(&mut self, command: Command) {
        match self.pipeline.command(&command) {
            Ok(()) => {
                // Another method may work without channels that this one needs.
                self.tried_without = None;
                self.shared.set_state(&self.pipeline);
                self.shared.publish(&Event::Done(command));
                // The pipeline has no clock: these are of now.
                for notice in self.pipeline.take_notices() {
                    self.shared.publish(&Event::Notice(Notice { at: clock::now(), ..notice }));
                }
            }
            Err(error) => self.shared.notice(Severity::Error, error.to_string()),
        }
    }

    /// Prepares the method again on a separate thread where needed, and installs the result.
    fn rebuild(&mut self) {
        if let Some(thread) = self.rebuilding.take_if(|thread| self.waits || thread.is_finished()) {
            // A thread that panicked has printed its message already.
            match thread.join().map(|made| made.map(|rebuilt| self.pipeline.install_method(rebuilt))) {
                Ok(Ok(true)) => self.shared.publish(&Event::Done(Command::Rebuild)),
                Ok(Ok(false)) | Err(_) => {}
                Ok(Err(error)) => self.shared.notice(Severity::Error, error.to_string()),
            }
        }
        if self.rebuilding.is_some() || !self.rebuilds || !self.pipeline.wants_rebuild() {
            return;
        }
        let rebuilding = self.pipeline.rebuild_job();
        let tried = (self.pipeline.masked_channels(), rebuilding.is_adapted());
        if self.tried_without.as_ref() == Some(&tried) {
            return;
        }
        self.tried_without = Some(tried);
        let thread = std::thread::Builder::new().name("dermis-rebuild".into());
        self.rebuilding = thread.spawn(move || rebuilding.run()).ok();
        if self.waits && self.rebuilding.is_some() {
            self.rebuild();
        }
    }

    /// Computes a drift fit on a separate thread, if the pipeline requests one.
    fn start_drift_fit(&mut self) {
        if let Some(job) = self.pipeline.drift_fit_job() {
            let thread = std::thread::Builder::new().name("dermis-drift".into());
            // Without a thread the pipeline computes it when it is needed.
            self.fitting = thread.spawn(move || job.run()).ok();
        }
    }

    fn install_drift_fit(&mut self) {
        if let Some(Ok(Ok(fit))) = self.fitting.take_if(|thread| thread.is_finished()).map(JoinHandle::join) {
            self.pipeline.install_drift_fit(fit);
        }
    }
}

/// Processes a frame as it was received.
pub(crate) fn process(pipeline: &mut Pipeline, incoming: IncomingFrame) -> Result<LiveFrame, PipelineError> {
    let IncomingFrame { input, received_at, message } = incoming;
    let result = pipeline.process(input)?;
    Ok(LiveFrame { result, received_at, output_at: clock::now(), message })
}
