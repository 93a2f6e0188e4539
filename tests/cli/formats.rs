//! Compares the lists of formats in the documentation with the table in the code.
//!
//! `EWA_UPDATE_DOCS=1` rewrites the lists.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::{Family, Format, formats};

use crate::commands::{run, text};

const BEGIN: &str = "<!-- formats: made from the table in src/io/formats.rs -->\n";
const END: &str = "<!-- end of formats -->\n";

fn endings(format: &Format) -> String {
    let shown: Vec<String> = format.endings.iter().map(|e| format!("`.{e}`")).collect();
    shown.join(", ")
}

/// Formats a name, and after it the extensions unless the name is one.
fn named(format: &Format) -> String {
    match format.endings {
        [] => format.name.into(),
        [one] if format.name == format!(".{one}") => format!("`{}`", format.name),
        _ => format!("{} ({})", format.name, endings(format)),
    }
}

fn of(family: Family) -> impl Iterator<Item = &'static Format> {
    formats().iter().filter(move |f| f.family == family)
}

/// Returns one row for each family.
fn short() -> String {
    let row = |family: &Family| {
        let names: Vec<String> = of(*family).map(named).collect();
        format!("| {} | {} |\n", family.name(), names.join(", "))
    };
    let rows: String = Family::ALL.iter().map(row).collect();
    format!("| reads | |\n|---|---|\n{rows}")
}

/// Returns one row for each format.
fn long() -> String {
    let row = |format: &Format| format!("| {} | {} |\n", named(format), format.reads);
    let rows: String = Family::ALL.iter().flat_map(|f| of(*f)).map(row).collect();
    format!("| format | what is read |\n|---|---|\n{rows}")
}

fn check(file: &str, table: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (_, after) = rest.split_once(END).unwrap();
    let expected = format!("{before}{BEGIN}{table}{END}{after}");
    if std::env::var_os("EWA_UPDATE_DOCS").is_some() {
        std::fs::write(&path, &expected).unwrap();
        return;
    }
    let hint = "EWA_UPDATE_DOCS=1 cargo test --test cli formats";
    assert!(text == expected, "the formats in {file} are old: {hint}");
}

#[test]
fn lists_of_formats_are_those_of_the_table() {
    check("README.md", &short());
    check("docs/formats.md", &long());
}

#[test]
fn help_lists_all_formats() {
    let help = text(&run(Path::new("."), &["--help"]).stdout);
    for format in formats() {
        for ending in format.endings {
            assert!(help.contains(&format!(".{ending}")), "{ending}: {help}");
        }
    }
}

#[test]
fn each_line_of_the_table_is_whole() {
    for format in formats() {
        assert!(!format.name.is_empty() && !format.reads.is_empty());
        let is_known = |ending: &&str| {
            ending
                .chars()
                .all(|c| c.is_ascii_lowercase() || "0123456789.".contains(c))
        };
        assert!(format.endings.iter().all(is_known), "{format:?}");
    }
    let mut all: Vec<&str> = formats().iter().flat_map(|f| f.endings).copied().collect();
    let count = all.len();
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), count, "an ending of two formats");
}
