//! A small table, for terminals and pages.

use super::marked;
use std::fmt::Write as _;

/// A table of text cells; the first column names the row.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Names of the columns.
    pub header: Vec<String>,
    /// The rows, each as long as the header.
    pub rows: Vec<Vec<String>>,
    /// Whether the last column contains remarks as text.
    remarks: bool,
}

impl Table {
    /// A table without rows.
    pub fn new(header: &[&str]) -> Self {
        Table { header: header.iter().map(|name| name.to_string()).collect(), rows: Vec::new(), remarks: false }
    }

    /// A table without rows whose last column contains remarks as text: it wraps on a page, and is omitted in a
    /// terminal.
    pub fn with_remarks(header: &[&str]) -> Self {
        Table { remarks: true, ..Table::new(header) }
    }

    /// Adds a row with one cell per column.
    ///
    /// # Panics
    /// If the number of cells differs from the number of columns.
    pub fn push(&mut self, cells: Vec<String>) {
        assert_eq!(cells.len(), self.header.len(), "a cell for each column");
        self.rows.push(cells);
    }

    /// Adds a row.
    pub fn row<const N: usize>(&mut self, cells: [String; N]) {
        self.rows.push(cells.into());
    }

    /// Adds a row of a name and a value.
    pub fn pair(&mut self, name: &str, value: impl std::fmt::Display) {
        self.row([name.into(), value.to_string()]);
    }

    /// The table with aligned columns: the first to the left, the others to the right.
    pub fn to_text(&self) -> String {
        let columns = self.header.len() - usize::from(self.remarks);
        let widths: Vec<usize> = (0..columns)
            .map(|column| self.lines().map(|line| line[column].chars().count()).max().unwrap_or(0))
            .collect();
        let mut text = String::new();
        for (index, line) in self.lines().enumerate() {
            let cells = line.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
                if column == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
            });
            let cells: Vec<String> = cells.collect();
            let _ = writeln!(text, "{}", cells.join("   ").trim_end());
            if index == 0 {
                let rule: Vec<String> = widths.iter().map(|&width| "-".repeat(width)).collect();
                let _ = writeln!(text, "{}", rule.join("   "));
            }
        }
        text
    }

    /// The table as HTML; columns of numbers have the class `number`.
    pub fn to_html(&self) -> String {
        let class = |column: usize| {
            let is_number = |row: &Vec<String>| row[column].parse::<f64>().is_ok();
            if self.rows.iter().all(is_number) { " class=\"number\"" } else { "" }
        };
        let classes: Vec<&str> = (0..self.header.len()).map(class).collect();
        let line = |cells: &[String], tag: &str| {
            let cell = |(cell, class): (&String, &&str)| format!("<{tag}{class}>{}</{tag}>", marked(cell));
            format!("<tr>{}</tr>\n", cells.iter().zip(&classes).map(cell).collect::<String>())
        };
        let rows: String = self.rows.iter().map(|row| line(row, "td")).collect();
        format!(
            "<div class=\"scroll\"><table{}>\n<thead>{}</thead>\n<tbody>{rows}</tbody>\n</table></div>\n",
            if self.remarks { " class=\"remarks\"" } else { "" },
            line(&self.header, "th")
        )
    }

    fn lines(&self) -> impl Iterator<Item = &Vec<String>> {
        std::iter::once(&self.header).chain(&self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(&["", "mean"]);
        table.row(["paper".into(), "5.5".into()]);
        table.row(["a<b".into(), "12 \u{b1} 3".into()]);
        table
    }

    #[test]
    fn columns_line_up_whatever_they_hold() {
        let text = table().to_text();
        assert_eq!(text, "          mean\n-----   ------\npaper      5.5\na<b     12 \u{b1} 3\n");
    }

    #[test]
    fn remarks_are_for_pages() {
        let mut table = Table::with_remarks(&["", "mean", "remark"]);
        table.push(vec!["paper".into(), "5.5".into(), "measured, in many words".into()]);
        assert_eq!(table.to_text(), "        mean\n-----   ----\npaper    5.5\n");
        assert!(table.to_html().contains("class=\"remarks\"") && table.to_html().contains("in many words"));
    }

    #[test]
    fn what_stands_in_a_cell_is_text_on_a_page() {
        assert!(table().to_html().contains("<td>a&lt;b</td>"));
    }
}
