//! Formats numbers in panels.

/// Formats a number with five digits at most, without trailing zeros.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.4e}");
    }
    // Counts the digits before the point; the rest of the five follow it.
    let before = (1..6).take_while(|&n| size >= 10_f64.powi(n)).count();
    let text = format!("{value:.*}", if size < 0.1 { 6 } else { 4 - before.min(4) });
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').into(),
        false => text,
    }
}

/// Formats a count with spaces between its thousands.
pub(super) fn grouped(count: usize) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let counts = [0, 999, 1000, 25_236, 1_234_567].map(grouped);
        assert_eq!(counts, ["0", "999", "1 000", "25 236", "1 234 567"]);
        let numbers = [
            0.0,
            -0.0,
            0.5,
            -0.25,
            0.003_921_57,
            12.345_67,
            123_456.789,
            1e6,
            1e-9,
        ]
        .map(short);
        let wanted = [
            "0",
            "0",
            "0.5",
            "-0.25",
            "0.003922",
            "12.346",
            "123457",
            "1.0000e6",
            "1.0000e-9",
        ];
        assert_eq!(numbers, wanted);
    }
}
