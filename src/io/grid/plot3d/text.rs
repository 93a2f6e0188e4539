//! Parses PLOT3D as text: numbers separated by white space or commas, as Fortran writes them.

use std::path::Path;

use crate::error::{Error, Result};

/// Whether these first bytes can be such text.
pub(super) fn looks_like_text(bytes: &[u8]) -> bool {
    bytes
        .iter()
        .take(256)
        .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace())
}

/// Whether the first word of such text is a number.
pub(super) fn begins_with_number(bytes: &[u8]) -> bool {
    let mut words = bytes.split(|&b| b == b',' || b.is_ascii_whitespace());
    let first = words.find(|word| !word.is_empty()).unwrap_or_default();
    let first = String::from_utf8_lossy(first);
    real(first.split_once('*').map_or(&first, |(_, value)| value)).is_some()
}

/// All numbers of a text, at most `most`: `r*v` means `r` times `v`, so that a short text can claim any count
/// of them.
///
/// # Errors
/// A word that is no number, with its line; or more than `most` numbers.
pub(super) fn numbers(path: &Path, bytes: &[u8], most: usize) -> Result<Vec<f64>> {
    let mut numbers = Vec::new();
    for (line_index, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let words = line
            .split(|&b| b == b',' || b.is_ascii_whitespace())
            .filter(|word| !word.is_empty());
        for word in words {
            let place = || format!("line {}", line_index + 1);
            let word = String::from_utf8_lossy(word);
            let parsed = match word.split_once('*') {
                Some((repeat, value)) => repeat.parse().ok().zip(real(value)),
                None => real(&word).map(|value| (1, value)),
            };
            let Some((repeat, value)) = parsed else {
                return Err(Error::format(
                    path,
                    place(),
                    "numbers (PLOT3D as text holds nothing else)",
                    format!("`{}`", word.chars().take(40).collect::<String>()),
                    "a particle table needs a first line that names x, y and z",
                ));
            };
            if repeat > most - numbers.len() {
                return Err(Error::format(
                    path,
                    place(),
                    format!("at most {most} numbers in all"),
                    format!("more, with `{}`", word.chars().take(40).collect::<String>()),
                    "write the numbers without repeat counts",
                ));
            }
            numbers.extend(std::iter::repeat_n(value, repeat));
        }
    }
    Ok(numbers)
}

/// A Fortran real: the exponent may be marked by D, or by its sign alone.
fn real(word: &str) -> Option<f64> {
    if let Ok(value) = word.parse() {
        return Some(value);
    }
    if !word.is_ascii() {
        return None;
    }
    let marked = word.replace(['d', 'D'], "e");
    if let Ok(value) = marked.parse() {
        return Some(value);
    }
    let sign = word.rfind(['+', '-']).filter(|&at| at > 0)?;
    format!("{}e{}", &word[..sign], &word[sign..]).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fortran_numbers_are_read() {
        let text = b" 2*1.5, -1.0D+02\r\n\t3 .5 1.25-103 1E3,4.d0\n";
        let read = numbers(Path::new("a"), text, 9).unwrap();
        assert_eq!(read, [1.5, 1.5, -100.0, 3.0, 0.5, 1.25e-103, 1000.0, 4.0]);
    }

    #[test]
    fn words_and_repeats_without_end_are_refused() {
        for (text, words) in [
            ("1 2\n3 carbon", "line 2: expected numbers"),
            ("99999999999*0.0", "at most 9"),
            ("8*0 1 2", "at most 9"),
            ("3*", "`3*`"),
            ("1.0\u{e9}-5", "expected numbers"),
            ("999999999999999999999999*1", "expected numbers"),
        ] {
            let error = numbers(Path::new("a"), text.as_bytes(), 9).unwrap_err();
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
