//! Lists the formats that can be read, for `--help` and `ewa-splat formats`.

use clap::Args;
use serde_json::{Value, json};

use crate::io::{Family, Format, formats};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Print JSON: a list of objects
    #[arg(long)]
    json: bool,
}

/// Prints the formats.
pub(crate) fn run(arguments: &Arguments) {
    let entry = |format: &Format| {
        json!({
            "name": format.name,
            "family": format.family.name(),
            "endings": format.endings,
            "reads": format.reads,
        })
    };
    let all: Value = formats().iter().map(entry).collect();
    super::report(&all, arguments.json, |_| super::say!("{}", list()));
}

/// Returns a line for each family, with the file extensions of each format.
pub(crate) fn list() -> String {
    let of = |family: Family| formats().iter().filter(move |f| f.family == family);
    let line = |family: &Family| {
        let names: Vec<String> = of(*family).map(shown).collect();
        format!("  {:<12} {}", family.name(), names.join(", "))
    };
    let lines: Vec<String> = Family::ALL.iter().map(line).collect();
    format!(
        "Reads, by content and by name:\n{}\nWrites splats (convert), pictures and animations (render --out).",
        lines.join("\n")
    )
}

fn shown(format: &Format) -> String {
    match format.endings {
        [] => format.name.into(),
        endings => format!("{} (.{})", format.name, endings.join(" .")),
    }
}
