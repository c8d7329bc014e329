//! The check of a built skin while it is read: its findings as notices, for `dermis live --check-build`.

use dermis::finding::{Finding, Severity};
use dermis_calibrate::CalibrateError;
use dermis_calibrate::build::{BuildCheck, BuildChecker};
use dermis_live::LiveHandle;
use std::sync::Arc;
use std::time::Duration;

/// Untouched frames that are enough for a check.
pub const FRAMES: usize = 32;
/// Events that can wait.
const WAITING: usize = 256;

/// Checks the first frames, which must be untouched, in a thread of its own. The frames meanwhile are processed.
pub fn check_first_frames(shared: &Arc<LiveHandle>) {
    let (shared, mailbox) = (Arc::clone(shared), shared.subscribe(WAITING));
    std::thread::spawn(move || {
        let frames = mailbox.frames(FRAMES, Duration::MAX, |_| ());
        drop(mailbox);
        if frames.len() < FRAMES {
            return;
        }
        match BuildChecker::new(shared.skin()).and_then(|checker| checker.check(&frames)) {
            Ok(check) => notices(&check).into_iter().for_each(|(level, text)| shared.notice(level, text)),
            Err(error) => shared.notice(Severity::Warning, not_checked(&error)),
        }
    });
}

fn not_checked(error: &CalibrateError) -> String {
    format!("the skin is not compared with its design: {error}")
}

/// The findings, or that there are none.
fn notices(check: &BuildCheck) -> Vec<(Severity, String)> {
    if check.findings.is_empty() {
        let text = format!(
            "the skin is as designed: its resistances are {:.2} times the design's, its coat is uneven by {:.0} %",
            check.resistance_factor,
            100.0 * check.unevenness
        );
        return vec![(Severity::Info, text)];
    }
    let notice = |finding: &Finding| {
        (finding.severity, format!("{}: {}. Fix: {}", finding.title(), finding.evidence, finding.fix))
    };
    check.findings.iter().map(notice).collect()
}
