//! Pages of text, tables and pictures; each page is one self-contained HTML file.
//!
//! ```
//! use dermis_plot::report::{Report, Table};
//!
//! let mut table = Table::new(&["method", "mean (mm)"]);
//! table.row(["NOSER".into(), "2.5".into()]);
//! let mut report = Report::new("Localisation", "Two methods on one skin.");
//! report.table(&table);
//! assert!(report.to_html().contains(">2.5</td>"));
//! assert!(table.to_text().ends_with("NOSER          2.5\n"));
//! ```

mod table;

pub use table::Table;

use crate::Picture;
use dermis::finding::Finding;
use dermis::frame::{TableError, write_whole};
use dermis::text::{counted, escaped};
use std::fmt::Write as _;
use std::path::Path;

const STYLE: &str = include_str!("style.css");

/// A page under construction, from top to bottom.
#[derive(Debug, Clone)]
pub struct Report {
    title: String,
    lead: String,
    body: String,
    sections: Vec<String>,
}

/// Pages with at least as many sections begin with a list of them.
const CONTENTS: usize = 3;

impl Report {
    /// A page with a title and an introductory sentence.
    pub fn new(title: &str, lead: &str) -> Self {
        Report { title: title.to_string(), lead: lead.to_string(), body: String::new(), sections: Vec::new() }
    }

    /// Begins a section.
    pub fn heading(&mut self, text: &str) {
        self.sections.push(text.to_string());
        let _ = writeln!(self.body, "<h2 id=\"s{}\">{}</h2>", self.sections.len(), marked(text));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", marked(text));
    }

    /// Adds commands or code.
    pub fn code(&mut self, text: &str) {
        let _ = writeln!(self.body, "<pre>{}</pre>", escaped(text));
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        self.body += &table.to_html();
    }

    /// Adds the findings of a check, under their heading.
    pub fn findings(&mut self, findings: &[Finding]) {
        self.heading("Findings");
        match findings.is_empty() {
            true => self.paragraph("No findings."),
            false => self.table(&findings_table(findings)),
        }
    }

    /// Adds pictures with captions, side by side if there is room.
    pub fn pictures(&mut self, pictures: &[(Picture, String)]) {
        self.body += "<div class=\"pictures\">\n";
        for (picture, caption) in pictures {
            self.body += &figure(&picture.to_svg(), caption);
        }
        self.body += "</div>\n";
    }

    /// Writes the page as HTML, completely or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), TableError> {
        write_whole(path, |out| out.write_all(self.to_html().as_bytes()))
    }

    /// The page as HTML.
    pub fn to_html(&self) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let (title, lead) = (marked(&self.title), marked(&self.lead));
        let head = format!("<h1>{title}</h1>\n<p class=\"lead\">{lead}</p>\n{}", self.contents());
        let body = format!("<main>\n{head}{}<footer>Made by dermis {version}.</footer>\n</main>\n", self.body);
        document(&self.title, STYLE, &body)
    }

    /// Links to the sections.
    fn contents(&self) -> String {
        if self.sections.len() < CONTENTS {
            return String::new();
        }
        let link =
            |(index, section): (usize, &String)| format!("<a href=\"#s{}\">{}</a>\n", index + 1, marked(section));
        let links: String = self.sections.iter().enumerate().map(link).collect();
        format!("<nav aria-label=\"Contents\">\n{links}</nav>\n")
    }
}

/// A page of HTML that needs no other file, with a title (text), a style sheet and a body (markup).
pub fn document(title: &str, style: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>\n{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escaped(title)
    )
}

/// A picture (SVG) with its caption (text).
pub fn figure(svg: &str, caption: &str) -> String {
    format!("<figure>\n{svg}<figcaption>{}</figcaption>\n</figure>\n", marked(caption))
}

/// A text as markup: what stands between backticks is code.
pub fn marked(text: &str) -> String {
    let escaped = escaped(text);
    let parts: Vec<&str> = escaped.split('`').collect();
    // Without its partner a backtick is a character.
    let closed = parts.len() - (parts.len() + 1) % 2;
    let part = |(index, part): (usize, &&str)| match index {
        index if index >= closed => format!("`{part}"),
        index if index % 2 == 1 => format!("<code>{part}</code>"),
        _ => (*part).to_string(),
    };
    parts.iter().enumerate().map(part).collect()
}

/// A row for each finding.
fn findings_table(findings: &[Finding]) -> Table {
    let mut table = Table::with_remarks(&["finding", "severity", "value", "evidence and fix"]);
    for finding in findings {
        let remark = format!("{}. Fix: {}", finding.evidence, finding.fix);
        table.row([finding.title(), finding.severity.to_string(), finding.value_text(), remark]);
    }
    table
}

/// The numbers of faults and notes, their table, and the evidence and the fix of each; `none` where there are none.
pub fn findings_text(findings: &[Finding], none: &str) -> String {
    if findings.is_empty() {
        return format!("{none}\n");
    }
    let faults = findings.iter().filter(|finding| finding.is_fault()).count();
    let (faults, notes) = (counted(faults, "fault"), counted(findings.len() - faults, "note"));
    let mut text = format!("{faults}, {notes}\n\n{}\n", findings_table(findings).to_text());
    for finding in findings {
        let _ = writeln!(text, "\n{}\n  evidence: {}\n  fix: {}", finding.title(), finding.evidence, finding.fix);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Histogram;

    #[test]
    fn a_page_needs_nothing_from_elsewhere() {
        let mut report = Report::new("A <page>", "lead");
        let picture = Histogram { title: "", label: "", values: &[1.0], counted: "frames", step: 1.0, marks: vec![] };
        report.pictures(&[(picture.draw(), "caption & more".into())]);
        let html = report.to_html();
        assert!(html.contains("A &lt;page&gt;") && html.contains("caption &amp; more"));
        for foreign in ["src=", "href=", "url(", "@import", "<script"] {
            assert!(!html.contains(foreign), "{foreign}");
        }
    }

    #[test]
    fn a_page_of_sections_lists_them() {
        let mut report = Report::new("Page", "lead");
        ["One", "`two` & three", "Four"].into_iter().for_each(|section| report.heading(section));
        let html = report.to_html();
        assert!(html.contains("<a href=\"#s2\"><code>two</code> &amp; three</a>"), "{html}");
        assert!(html.contains("<h2 id=\"s2\"><code>two</code> &amp; three</h2>"), "{html}");
    }

    #[test]
    fn backticks_mark_code() {
        assert_eq!(marked("a `b<` c `d` e"), "a <code>b&lt;</code> c <code>d</code> e");
        assert_eq!(marked("a `b` c ` d"), "a <code>b</code> c ` d");
        assert_eq!((marked("a"), marked("`"), marked("")), ("a".into(), "`".into(), String::new()));
    }
}
