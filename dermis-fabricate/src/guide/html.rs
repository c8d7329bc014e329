//! Parts of a page.

use crate::sheet::escaped;

/// A column of a table: its title, and whether it holds numbers.
pub(super) type Column = (&'static str, bool);

/// A table. The cells are text, not markup.
pub(super) fn table(columns: &[Column], rows: &[Vec<String>]) -> String {
    let class = |number: bool| if number { " class=\"number\"" } else { "" };
    let head: String =
        columns.iter().map(|(title, number)| format!("<th{}>{}</th>", class(*number), escaped(title))).collect();
    let row = |cells: &Vec<String>| {
        let cells: String = cells
            .iter()
            .zip(columns)
            .map(|(cell, (_, number))| format!("<td{}>{}</td>", class(*number), escaped(cell)))
            .collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = rows.iter().map(row).collect();
    format!("<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n")
}

/// A table in two halves side by side, for narrow rows.
pub(super) fn table_in_halves(columns: &[Column], rows: &[Vec<String>]) -> String {
    let half = rows.len().div_ceil(2).max(1);
    let halves: String = rows.chunks(half).map(|rows| table(columns, rows)).collect();
    format!("<div class=\"columns\">\n{halves}</div>\n")
}

/// A picture (markup) with its caption (text).
pub(super) fn figure(picture: &str, caption: &str) -> String {
    format!("<figure>\n{picture}\n<figcaption>{}</figcaption>\n</figure>\n", escaped(caption))
}

/// Things to do, in order; each is markup.
pub(super) fn list(items: &[String]) -> String {
    let items: String = items.iter().map(|item| format!("<li>{item}</li>\n")).collect();
    format!("<ol>\n{items}</ol>\n")
}

/// A section with its heading; `own_page` begins a page.
pub(super) fn section(heading: &str, body: &str, own_page: bool) -> String {
    let class = if own_page { " class=\"page\"" } else { "" };
    format!("<section{class}>\n<h2>{}</h2>\n{body}</section>\n", escaped(heading))
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
    let text = format!("{:.3}", 1e3 * length_m);
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}
