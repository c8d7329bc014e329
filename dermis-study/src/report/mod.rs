//! Pages of text, tables and pictures; each page is one self-contained HTML file.
//!
//! ```
//! use dermis_study::report::{Report, Table};
//!
//! let mut table = Table::new(&["method", "mean (mm)"]);
//! table.row(["NOSER".into(), "2.5".into()]);
//! let mut report = Report::new("Localisation", "Two methods on one skin.");
//! report.table(&table);
//! assert!(report.to_html().contains("<td>2.5</td>"));
//! assert!(table.to_text().ends_with("NOSER          2.5\n"));
//! ```

mod table;

pub use table::Table;

use dermis_plot::Picture;
use dermis_plot::escape;
use std::fmt::Write as _;

/// A value as JSON, with a trailing newline.
pub(crate) fn to_json(value: &impl serde::Serialize) -> crate::Result<String> {
    let text = serde_json::to_string_pretty(value).map_err(|error| crate::Error::Internal(error.to_string()))?;
    Ok(format!("{text}\n"))
}

const STYLE: &str = include_str!("style.css");

/// A page under construction, from top to bottom.
#[derive(Debug, Clone)]
pub struct Report {
    title: String,
    body: String,
}

impl Report {
    /// A page with a title and an introductory sentence.
    pub fn new(title: &str, lead: &str) -> Self {
        let body = format!("<h1>{}</h1>\n<p class=\"lead\">{}</p>\n", escape(title), escape(lead));
        Report { title: title.to_string(), body }
    }

    /// Begins a section.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape(text));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escape(text));
    }

    /// Adds commands or code.
    pub fn code(&mut self, text: &str) {
        let _ = writeln!(self.body, "<pre>{}</pre>", escape(text));
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        self.body += &table.to_html();
    }

    /// Adds pictures with captions, side by side if there is room.
    pub fn pictures(&mut self, pictures: &[(Picture, String)]) {
        self.body += "<div class=\"pictures\">\n";
        for (picture, caption) in pictures {
            let caption = escape(caption);
            let svg = picture.to_svg();
            let _ = writeln!(self.body, "<figure>\n{svg}<figcaption>{caption}</figcaption>\n</figure>");
        }
        self.body += "</div>\n";
    }

    /// The page as HTML.
    pub fn to_html(&self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{}\
             <footer>Made by dermis {}.</footer>\n</main>\n</body>\n</html>\n",
            escape(&self.title),
            self.body,
            env!("CARGO_PKG_VERSION"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_plot::chart::Histogram;

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
}
