//! Tables as plain data, and as HTML, Markdown and CSV.

use super::text::{digits, escaped};
use crate::cells::field;

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its head, with the unit of its numbers.
    pub name: String,
    /// Whether its cells are numbers, which stand to the right.
    pub number: bool,
}

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// What is shown.
    pub text: String,
    /// What it is sorted by and written as in CSV, where it is a number.
    pub value: Option<f64>,
}

impl Cell {
    /// A text.
    pub fn text(text: impl Into<String>) -> Self {
        Self { text: text.into(), value: None }
    }

    /// A number, shown with `significant` digits.
    pub fn number(value: f64, significant: usize) -> Self {
        Self { text: digits(value, significant), value: Some(value) }
    }

    /// A count.
    pub fn count(value: usize) -> Self {
        Self { text: value.to_string(), value: Some(value as f64) }
    }

    /// A text that is sorted, and written in CSV, as a number.
    pub fn valued(text: impl Into<String>, value: f64) -> Self {
        Self { text: text.into(), value: Some(value) }
    }

    /// A dash, for what there is not.
    pub fn none() -> Self {
        Self { text: "-".into(), value: None }
    }
}

/// A table; rows have as many cells as there are columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Its name in addresses and files: lower-case letters, digits and hyphens.
    pub id: String,
    /// What it shows.
    pub title: String,
    /// How to read it, in a sentence or two.
    pub caption: String,
    /// Columns.
    pub columns: Vec<Column>,
    /// Rows.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// An empty table. Columns whose names begin with `#` hold numbers; the sign is not shown.
    pub fn new(id: impl Into<String>, title: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|name| Column {
            name: name.trim_start_matches('#').to_owned(),
            number: name.starts_with('#'),
        });
        Self { id: id.into(), title: title.into(), columns: columns.collect(), ..Self::default() }
    }

    /// The same table with this caption.
    pub fn captioned(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    /// Appends a row.
    pub fn push(&mut self, row: Vec<Cell>) {
        self.rows.push(row);
    }

    /// As an HTML table whose heads are buttons that sort, where there is more than one row.
    pub fn html(&self) -> String {
        let mut out = format!("<div class=\"scroll\"><table id=\"{}\">", escaped(&self.id));
        if !self.title.is_empty() || !self.caption.is_empty() {
            let (title, caption) = (escaped(&self.title), escaped(&self.caption));
            out.push_str(&format!("<caption><b>{title}</b> {caption}</caption>"));
        }
        out.push_str("<thead><tr>");
        for (j, column) in self.columns.iter().enumerate() {
            let (class, name) = (class(column), escaped(&column.name));
            out.push_str(&match self.rows.len() {
                0 | 1 => format!("<th scope=\"col\"{class}>{name}</th>"),
                _ => format!(
                    "<th scope=\"col\"{class}><button type=\"button\" data-column=\"{j}\">{name}</button></th>"
                ),
            });
        }
        out.push_str("</tr></thead><tbody>\n");
        for row in &self.rows {
            out.push_str("<tr>");
            for (cell, column) in row.iter().zip(&self.columns) {
                let value = cell.value.filter(|v| v.is_finite());
                let value = value.map_or(String::new(), |v| format!(" data-value=\"{v:e}\""));
                out.push_str(&format!("<td{}{value}>{}</td>", class(column), escaped(&cell.text)));
            }
            out.push_str("</tr>\n");
        }
        out.push_str("</tbody></table></div>\n");
        out
    }

    /// As a Markdown table, without title and caption.
    pub fn markdown(&self) -> String {
        let safe = |text: &str| text.replace('|', "\\|").replace(['\n', '\r'], " ");
        let line = |cells: &mut dyn Iterator<Item = String>| {
            format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
        };
        let mut out = line(&mut self.columns.iter().map(|column| safe(&column.name)));
        out.push_str(&line(
            &mut self.columns.iter().map(|c| if c.number { "---:".into() } else { "---".into() }),
        ));
        for row in &self.rows {
            out.push_str(&line(&mut row.iter().map(|cell| safe(&cell.text))));
        }
        out
    }

    /// As CSV with a line of heads; numbers in full.
    pub fn csv(&self) -> String {
        let mut out = String::new();
        let mut line = |cells: &mut dyn Iterator<Item = String>| {
            let cells: Vec<String> = cells.map(|text| field(&text)).collect();
            out.push_str(&cells.join(","));
            out.push('\n');
        };
        line(&mut self.columns.iter().map(|column| column.name.clone()));
        for row in &self.rows {
            line(
                &mut row
                    .iter()
                    .map(|cell| cell.value.map_or(cell.text.clone(), |value| format!("{value:?}"))),
            );
        }
        out
    }
}

fn class(column: &Column) -> &'static str {
    if column.number { " class=\"number\"" } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new("t", "A|B", &["name", "#error / mm"]).captioned("<how>");
        table.push(vec![Cell::text("a,\"b\""), Cell::number(0.1 + 0.2, 3)]);
        table.push(vec![Cell::text("x|y"), Cell::none()]);
        table
    }

    #[test]
    fn markdown_shows_what_people_read() {
        assert_eq!(
            table().markdown(),
            "| name | error / mm |\n| --- | ---: |\n| a,\"b\" | 0.300 |\n| x\\|y | - |\n"
        );
    }

    #[test]
    fn csv_keeps_every_digit() {
        let text = table().csv();
        assert_eq!(text, "name,error / mm\n\"a,\"\"b\"\"\",0.30000000000000004\nx|y,-\n");
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(&rows[0][0], "a,\"b\"");
        assert_eq!(rows[0][1].parse::<f64>().unwrap(), 0.1 + 0.2);
    }

    #[test]
    fn html_is_escaped_and_sorts_by_value() {
        let html = table().html();
        assert!(
            html.contains("&lt;how&gt;")
                && html.contains("<td class=\"number\" data-value=\"3.0000000000000004e-1\">")
        );
    }
}
