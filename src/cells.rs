//! Cells of CSV that no program takes for anything but text.
//!
//! A spreadsheet runs a cell that begins with `=`, `+`, `-` or `@` as a formula, whatever quotes stand around it
//! (OWASP, *CSV Injection*). Names that begin so get an apostrophe in front; reading takes it off again.

use std::borrow::Cow;

/// Whether a spreadsheet may take the text for a formula. Numbers are none.
fn runs(text: &str) -> bool {
    text.starts_with(['=', '+', '-', '@', '\t', '\r']) && text != "-" && text.parse::<f64>().is_err()
}

/// The text with an apostrophe in front where a spreadsheet would run it.
pub fn inert(text: &str) -> Cow<'_, str> {
    if runs(text) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
}

/// The text that [`inert`] was given.
pub fn original(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| runs(text)).unwrap_or(cell)
}

/// A field of a row: inert, and quoted as RFC 4180 has it.
pub fn field(text: &str) -> String {
    let text = inert(text);
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_become_text_and_come_back() {
        for text in ["=HYPERLINK(\"http://x\").a", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1"] {
            assert_eq!(inert(text), format!("'{text}"));
            assert_eq!(original(&inert(text)), text);
        }
        for text in ["limb1.leg", "-", "-1.5e-3", "+4", "a=b", "'tis", "", "limb-1"] {
            assert_eq!(inert(text), text);
            assert_eq!(original(text), text);
        }
        assert_eq!(field("=a,\"b\""), "\"'=a,\"\"b\"\"\"");
    }
}
