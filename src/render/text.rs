//! Text and numbers as pages show them.

/// The text with the five characters that mean something in HTML and XML escaped, and without control characters.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// The value with `digits` significant digits; powers of ten outside 0.001 .. 100000, `-` where it is not finite.
pub fn digits(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let after = digits.max(1) - 1;
    let scientific = format!("{value:.after$e}");
    // The exponent after rounding: 9.9996 has one digit more than it seems.
    let exponent: i32 = scientific.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    if !(-3..5).contains(&exponent) {
        return scientific;
    }
    let decimals = usize::try_from(after as i32 - exponent).unwrap_or(0);
    format!("{value:.decimals$}")
}

/// `1 posture`, `2 postures`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// A power of ten as people write it, such as 10⁻³.
pub fn power_of_ten(exponent: i64) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        '0' => '⁰',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        _ => '⁹',
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}

/// The text in lower-case letters, digits and hyphens, as an address within a page.
pub fn slug(text: &str) -> String {
    let kept = text.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { ' ' });
    kept.collect::<String>().split_whitespace().collect::<Vec<_>>().join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_asked_for() {
        assert_eq!(digits(0.0, 3), "0");
        assert_eq!(digits(9.9996, 4), "10.00");
        assert_eq!(digits(-0.0123456, 3), "-0.0123");
        assert_eq!(digits(1.5e-7, 3), "1.50e-7");
        assert_eq!(digits(123456.0, 3), "1.23e5");
        assert_eq!(digits(f64::NAN, 3), "-");
    }

    #[test]
    fn text_cannot_break_out_of_a_page() {
        assert_eq!(escaped("<b a=\"1\">&'\u{0}"), "&lt;b a=&quot;1&quot;&gt;&amp;&#39;\u{fffd}");
        assert_eq!(slug("Cost & step"), "cost-step");
        assert_eq!(power_of_ten(-12), "10⁻¹²");
    }
}
