//! Prints the table of `ewa-splat info`.

use crate::legend::title_of;
use serde_json::Value;

/// Largest number of blocks whose dimensions the table lists.
const MOST_BLOCKS: usize = 8;

/// Largest number of materials that the table lists.
const MOST_MATERIALS: usize = 16;

/// Largest number of particle types that the table lists.
const MOST_TYPES: usize = 16;

/// Largest number of time steps of a collection that the table lists.
const MOST_STEPS: usize = 32;

/// Largest number of files of a time step that the table lists.
const MOST_PARTS: usize = 4;

/// Names of the percentiles in a row.
const AT: &str = "least, 5 %, median, 95 %, greatest";

/// Formats `[2, 3, 4]` as `2 x 3 x 4`.
fn times(dims: &Value) -> String {
    let dims = dims.as_array().into_iter().flatten();
    dims.map(Value::to_string).collect::<Vec<_>>().join(" x ")
}

/// Formats a number to six significant digits without trailing zeros. Very large and very small
/// numbers get an exponent.
pub(crate) fn significant(x: f64) -> String {
    let in_powers = format!("{x:.5e}");
    let Some((digits, exponent)) = in_powers.split_once('e') else {
        return in_powers;
    };
    if x == 0.0 {
        return "0".into();
    }
    let trimmed = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    match exponent.parse::<usize>() {
        // Uses the decimals that six digits leave; a whole number may have a seventh digit.
        Ok(exponent @ 0..=6) => trimmed(&format!("{x:.*}", 5_usize.saturating_sub(exponent))),
        Err(_) if x.abs() >= 1e-4 => {
            let leading = exponent.trim_start_matches('-').parse().unwrap_or(0);
            trimmed(&format!("{x:.*}", 5 + leading))
        }
        _ => format!("{}e{exponent}", trimmed(digits)),
    }
}

/// Formats a material: `5856 triangles, "spot", opaque, one-sided, texture 1024 x 1024`.
fn material_line(material: &Value) -> String {
    let cutoff = &material["cutoff"];
    let alpha = material["alpha"].as_str().unwrap_or("");
    let mut line = format!(
        "{} triangles, {}, {alpha}{}, {}",
        material["triangles"],
        material["name"],
        cutoff
            .as_f64()
            .map_or(String::new(), |at| format!(" at {}", significant(at))),
        if material["double_sided"] == true {
            "two-sided"
        } else {
            "one-sided"
        },
    );
    for (name, kind) in [
        ("base_texture", "texture"),
        ("emissive_texture", "emission"),
    ] {
        if material[name].is_array() {
            line.push_str(&format!(", {kind} {}", times(&material[name])));
        }
    }
    line
}

/// Formats the particles of a type: `PartType3 (bulge or dust or sinks): 12, not read`.
fn type_line(particles: &Value) -> String {
    let name = text(&particles["name"]);
    let types = particles["types"]
        .as_array()
        .into_iter()
        .flatten()
        .map(text);
    let types: Vec<String> = types.filter(|own| *own != name).collect();
    let types = match &types[..] {
        [] => String::new(),
        types => format!(" ({})", types.join(" or ")),
    };
    let read = match particles["is_read"] == true {
        true => "",
        false => ", not read",
    };
    format!("{name}{types}: {}{read}", particles["count"])
}

/// Formats a string without quotation marks, null as a dash, and other values as JSON.
fn text(value: &Value) -> String {
    match value {
        Value::Null => "-".into(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Prints the full description of one file.
pub(crate) fn print_table(description: &Value) {
    let row = |name: &str, value: String| super::say!("{name:<18} {value}");
    row("file", text(&description["file"]));
    let lines = |v: &Value| v.as_array().cloned().unwrap_or_default();
    let steps = lines(&description["time_steps"]);
    for step in steps.iter().take(MOST_STEPS) {
        let files = lines(&step["files"]);
        let files: Vec<String> = files.iter().take(MOST_PARTS).map(text).collect();
        let more = match lines(&step["files"]).len().saturating_sub(MOST_PARTS) {
            0 => String::new(),
            count => format!(" and {count} more"),
        };
        let time = step["time"].as_f64().map(significant);
        let files = format!("{}{more}", files.join(", "));
        match (time, files.is_empty()) {
            (Some(time), true) => row("  at time", time),
            (Some(time), false) => row("  at time", format!("{time}: {files}")),
            (None, _) => row("  of", files),
        }
    }
    if steps.len() > MOST_STEPS {
        row("", format!("... {} time steps in all", steps.len()));
    }
    row("format", text(&description["format"]));
    let vector = |v: &Value| {
        let numbers = v.as_array().into_iter().flatten().map(number);
        numbers.collect::<Vec<String>>().join(", ")
    };
    let geometry = &description["geometry"];
    row("kind", text(&geometry["kind"]));
    match &geometry["dims"] {
        Value::Array(blocks) if blocks.first().is_some_and(Value::is_array) => {
            let shown = blocks.iter().take(MOST_BLOCKS).map(times);
            let mut shown: Vec<String> = shown.collect();
            if blocks.len() > MOST_BLOCKS {
                shown.push(format!("... {} blocks in all", blocks.len()));
            }
            row("nodes along i, j, k", shown.join(", "));
        }
        Value::Array(_) => row("samples", times(&geometry["dims"])),
        _ => {}
    }
    for name in [
        "nodes",
        "cells",
        "count",
        "triangles",
        "lines",
        "points",
        "parts",
        "textures",
    ] {
        if let Some(count) = geometry[name].as_u64() {
            row(name, count.to_string());
        }
    }
    for kind in lines(&geometry["cell_kinds"]) {
        row(
            "  of kind",
            format!("{} {}", text(&kind["count"]), text(&kind["kind"])),
        );
    }
    let types = lines(&description["particle_types"]);
    for particles in types.iter().take(MOST_TYPES) {
        row("  of type", type_line(particles));
    }
    if types.len() > MOST_TYPES {
        row("", format!("... {} types in all", types.len()));
    }
    let materials = lines(&geometry["materials"]);
    for material in materials.iter().take(MOST_MATERIALS) {
        row("  of material", material_line(material));
    }
    if materials.len() > MOST_MATERIALS {
        row("", format!("... {} materials in all", materials.len()));
    }
    if geometry["spacing"].is_array() {
        row("spacing", vector(&geometry["spacing"]));
    }
    if description["axes"].is_object() {
        let [file, read] = ["file", "read"].map(|of| text(&description["axes"][of]));
        let turned = match file == read {
            true => String::new(),
            false => format!("; turned as it is read: {read}"),
        };
        row("axes", format!("{file}{turned}"));
    }
    row(
        "up",
        format!(
            "{} ({})",
            vector(&description["up"]["direction"]),
            text(&description["up"]["reason"])
        ),
    );
    if description["front"].is_array() {
        let front = vector(&description["front"]);
        let why = match &description["is_plane"] {
            Value::Bool(true) => "straight on",
            _ => "a piece of a scene, from its origin",
        };
        row("seen along", format!("{front} ({why})"));
    }
    row("lower bound", vector(&description["bounds"][0]));
    row("upper bound", vector(&description["bounds"][1]));
    if description["particles"].is_u64() {
        let ghosts = match description["ghosts"].as_u64() {
            None | Some(0) => String::new(),
            Some(count) => format!(", {count} of them ghosts beyond the boundary"),
        };
        let count = text(&description["particles"]);
        row("particles", format!("{count}{ghosts}"));
    }
    if description["shown"].is_string() {
        row("shown field", text(&description["shown"]));
    }
    if description["lengths"].is_string() {
        row("lengths", text(&description["lengths"]));
    }
    let kernels = &description["kernels"];
    if kernels.is_object() {
        row(
            "kernel sigma",
            format!("{} ({})", vector(&kernels["size"]), AT),
        );
        row(
            "anisotropy",
            format!("{} ({})", vector(&kernels["anisotropy"]), AT),
        );
    }
    if let Some(bytes) = description["bytes_per_particle"].as_f64() {
        let requirements = &description["requirements"];
        let stored = [
            (
                "positions",
                requirements["positions"].as_bool() == Some(true),
            ),
            ("shapes", requirements["shape_floats"] != 0),
            ("values", requirements["values"] != "none"),
            ("strengths", requirements["strength_floats"] != 0),
            ("colours", requirements["colour_floats"] != 0),
        ];
        let stored = stored.iter().filter(|(_, is)| *is).map(|(name, _)| *name);
        let stored: Vec<&str> = stored.collect();
        row(
            "bytes per particle",
            format!("{bytes:.2}: {}", stored.join(", ")),
        );
    }
    for note in lines(&description["notes"]) {
        row("note", text(&note));
    }
    for line in lines(&description["left_out"]) {
        row("note", text(&line));
    }
    for line in lines(&description["doubts"]) {
        row("will err", text(&line));
    }
    if description["problem"].is_string() {
        row("problem", text(&description["problem"]));
    }
    let fields = description["fields"]
        .as_array()
        .map_or(&[][..], Vec::as_slice);
    if !fields.is_empty() {
        super::say!(
            "\n{:<24} {:<6} {:<4} {:>14} {:>14} {:>8}",
            "field",
            "of",
            "type",
            "least",
            "greatest",
            "NaN/inf"
        );
    }
    for field in fields {
        let [least, greatest] = ends(&field["range"]);
        super::say!(
            "{:<24} {:<6} {:<4} {:>14} {:>14} {:>8}",
            title_of(&text(&field["name"]), field["unit"].as_str()),
            text(&field["of"]),
            text(&field["type"]),
            least,
            greatest,
            text(&field["non_finite"]),
        );
        if field["problem"].is_string() {
            super::say!("  problem: {}", text(&field["problem"]));
        }
    }
}

/// Formats a number, and its absence.
fn number(value: &Value) -> String {
    value.as_f64().map_or_else(|| "-".into(), significant)
}

/// Formats the ends of a range. Ends that agree in three digits have as many decimals as tell a thousandth of the range.
fn ends(range: &Value) -> [String; 2] {
    let plain = [number(&range[0]), number(&range[1])];
    let (Some(least), Some(greatest)) = (range[0].as_f64(), range[1].as_f64()) else {
        return plain;
    };
    let (width, magnitude) = (greatest - least, greatest.abs().max(least.abs()));
    let is_close = width > 0.0 && width < 1e-3 * magnitude;
    if !is_close || !(1e-12..1e12).contains(&magnitude) {
        return plain;
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to 17"
    )]
    let decimals = (3.0 - width.log10().floor()).clamp(0.0, 17.0) as usize;
    [least, greatest].map(|end| format!("{end:.decimals$}"))
}

/// Formats the number and kind of samples in a file.
fn count_of(geometry: &Value) -> String {
    let dims = geometry["dims"].as_array().into_iter().flatten();
    let samples: Option<u64> = dims.map(Value::as_u64).product();
    for (key, noun) in [
        ("cells", "cells"),
        ("nodes", "nodes"),
        ("triangles", "triangles"),
        ("count", ""),
    ] {
        if let Some(count) = geometry[key].as_u64() {
            return format!("{count} {noun}").trim_end().to_owned();
        }
    }
    samples.map_or_else(|| "-".into(), |n| format!("{n} samples"))
}

/// Prints a row for each of several files, then the problems of any.
pub(crate) fn print_rows(descriptions: &[Value]) {
    let row = |d: &Value| {
        let geometry = &d["geometry"];
        [
            text(&d["file"]),
            text(&d["format"]),
            text(&geometry["kind"]),
            count_of(geometry),
            text(&d["shown"]),
        ]
    };
    let heads = ["file", "format", "kind", "count", "shown field"].map(str::to_owned);
    let rows: Vec<[String; 5]> = std::iter::once(heads)
        .chain(descriptions.iter().map(row))
        .collect();
    let width = |i: usize| {
        let widths = rows.iter().map(|row| row[i].chars().count());
        widths.max().unwrap_or(0)
    };
    let widths = [0, 1, 2, 3].map(width);
    for [file, format, kind, count, field] in &rows {
        let [a, b, c, d] = widths;
        super::say!("{file:<a$}  {format:<b$}  {kind:<c$}  {count:>d$}  {field}");
    }
    let with_problem = descriptions.iter().filter(|d| d["problem"].is_string());
    for (i, description) in with_problem.enumerate() {
        if i == 0 {
            super::say!("");
        }
        super::say!("{}", problem_line(description, "problem"));
    }
}

/// Formats `FILE: what is wrong` in one line.
pub(crate) fn problem_line(description: &Value, key: &str) -> String {
    format!(
        "{}: {}",
        text(&description["file"]),
        text(&description[key])
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_that_lie_close_differ() {
        let of = |least: f64, greatest: f64| ends(&serde_json::json!([least, greatest]));
        assert_eq!(of(-0.25, 1.5), ["-0.25", "1.5"]);
        assert_eq!(
            of(101_324.99, 101_325.012),
            ["101324.99000", "101325.01200"]
        );
        assert_eq!(
            of(1_699_999_995.0, 1_700_000_005.0),
            ["1699999995.00", "1700000005.00"]
        );
        assert_eq!(of(7.0, 7.0), ["7", "7"]);
    }

    #[test]
    fn numbers_have_six_digits_that_say_something() {
        for (x, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (0.010_000_000_1, "0.01"),
            (f64::from(0.1_f32), "0.1"),
            (-1.5, "-1.5"),
            (100.0, "100"),
            (123_456.789, "123457"),
            (1_234_567.0, "1234567"),
            (9_999_999.6, "1e7"),
            (12_345_678.0, "1.23457e7"),
            (0.000_123_456_789, "0.000123457"),
            (0.000_099, "9.9e-5"),
            (1e-300, "1e-300"),
            (2.999_999_9, "3"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(significant(x), text);
        }
    }
}
