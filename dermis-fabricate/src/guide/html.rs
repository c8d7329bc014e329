//! Parts of a page.

use dermis::text::{decimal, escaped};
use dermis_plot::report::Table;

/// A table. The cells are text, not markup.
pub(super) fn table<const N: usize>(columns: [&str; N], rows: impl Iterator<Item = [String; N]>) -> Table {
    let mut table = Table::new(&columns);
    rows.for_each(|row| table.row(row));
    table
}

/// A table in two halves side by side, for narrow rows.
pub(super) fn in_halves(table: &Table) -> String {
    let half = table.rows.len().div_ceil(2).max(1);
    let halves = table.rows.chunks(half).map(|rows| {
        let mut part = table.clone();
        part.rows = rows.to_vec();
        part.to_html()
    });
    format!("<div class=\"columns\">\n{}</div>\n", halves.collect::<String>())
}

/// Things to do, in order; each is markup.
pub(super) fn list(items: &[String]) -> String {
    let items: String = items.iter().map(|item| format!("<li>{item}</li>\n")).collect();
    format!("<ol>\n{items}</ol>\n")
}

/// A section of the page.
pub(super) struct Section {
    /// Its heading.
    pub(super) heading: String,
    /// Its content, as markup.
    pub(super) body: String,
    /// Whether it begins a page of paper.
    pub(super) own_page: bool,
}

/// A section with its heading; `own_page` begins a page.
pub(super) fn section(heading: &str, body: String, own_page: bool) -> Section {
    Section { heading: heading.into(), body, own_page }
}

/// The list of contents, and the sections.
pub(super) fn sections(all: &[Section]) -> String {
    let entry = |(number, one): (usize, &Section)| {
        format!("<li><a href=\"#section-{number}\">{}</a></li>\n", escaped(&one.heading))
    };
    let section = |(number, one): (usize, &Section)| {
        let class = if one.own_page { " class=\"page\"" } else { "" };
        format!(
            "<section id=\"section-{number}\"{class}>\n<h2>{}</h2>\n{}</section>\n",
            escaped(&one.heading),
            one.body
        )
    };
    let entries: String = all.iter().enumerate().map(entry).collect();
    let sections: String = all.iter().enumerate().map(section).collect();
    format!("<nav aria-label=\"Contents\">\n<ul>\n{entries}</ul>\n</nav>\n{sections}")
}

/// A text of code.
pub(super) fn code(text: &str) -> String {
    format!("<code>{}</code>", escaped(text))
}

/// A text in which code is between grave accents.
pub(super) fn marked(text: &str) -> String {
    let part = |(number, part): (usize, &str)| if number % 2 == 1 { code(part) } else { escaped(part) };
    text.split('`').enumerate().map(part).collect()
}

/// A number with some decimals, and no sign before zero.
pub(super) fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|letter| "0.".contains(letter)) => rest.into(),
        _ => text,
    }
}

/// A length in mm with at most three decimals.
pub(super) fn mm(length_m: f64) -> String {
    decimal(1e3 * length_m, 3)
}
