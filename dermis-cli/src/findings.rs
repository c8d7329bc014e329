//! The findings of a check as text: `dermis check-frames`, `dermis check-build`.

use dermis::text::counted;
use dermis_calibrate::checks::Severity;
use dermis_study::report::Table;
use std::fmt::Write;

/// A finding in words.
pub struct FindingText<'a> {
    /// What is wrong, and where.
    pub title: String,
    /// Whether it is to be mended.
    pub severity: Severity,
    /// What was seen.
    pub evidence: &'a str,
    /// What to do.
    pub fix: &'a str,
}

/// The numbers of faults and notes, their table, and the evidence and the fix of each; `none` where there are none.
pub fn findings_text(findings: &[FindingText<'_>], table: &Table, none: &str) -> String {
    if findings.is_empty() {
        return format!("{none}\n");
    }
    let faults = findings.iter().filter(|finding| finding.severity == Severity::Fault).count();
    let notes = findings.len() - faults;
    let mut text = format!("{}, {}\n\n{}\n", counted(faults, "fault"), counted(notes, "note"), table.to_text());
    for FindingText { title, evidence, fix, .. } in findings {
        let _ = writeln!(text, "\n{title}\n  evidence: {evidence}\n  fix: {fix}");
    }
    text
}
