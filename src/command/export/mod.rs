//! Runs `ewa-splat export`: writes one file that shows data in a browser, without a server.
//!
//! | file | contents |
//! |---|---|
//! | `options.rs` | the options: those of `render` that the page has, and its own |
//! | `view.rs` | options as the view of the page |
//! | `files.rs` | the files that the page needs, opened as the page opens them |
//! | `fewer.rs` | data as kernels or splats, merged to a stated size and error |
//! | `page.rs` | the page, its program and the data in one file |

mod fewer;
mod files;
mod options;
mod page;
mod view;

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use serde_json::{Value, json};

use self::fewer::{Limits, fewer};
use self::files::{Embedded, needed};
pub(super) use self::options::Arguments;
use self::page::Page;
use super::outputs::check_collisions;
use super::progress::{note, spinner};
use super::render::Shown;
use super::report;
use crate::io::check_folder;
use crate::load::Input;
use crate::opened;
use crate::{Error, Result};

/// Contents of a page.
struct Contents {
    files: Vec<Embedded>,
    view: Value,
    /// Differences from the data after merging; null for data as they are.
    merged: Value,
}

/// Writes the page.
///
/// # Errors
/// A page that is not built; options that the page has not; the errors of reading, sampling and writing.
pub(crate) fn run(arguments: &mut Arguments) -> Result<()> {
    let out = arguments.render.out.clone();
    check_out(&out)?;
    let (size, error) = (arguments.own.bytes, arguments.own.error);
    let as_they_are = match (size, error) {
        (None, None) => arguments.as_they_are().map(|()| true)?,
        // Data that are small enough stay as they are.
        (Some(_), None) => arguments.as_they_are().is_ok(),
        (_, Some(_)) => false,
    };
    if !as_they_are {
        arguments.as_splats()?;
    }
    let page = Page::open(arguments.own.page.as_deref())?;
    let named: Vec<PathBuf> = arguments
        .render
        .inputs
        .iter()
        .map(|input| input.path.clone())
        .collect();
    check_collisions(named.iter(), std::iter::once(&out))?;

    opened::start();
    let bar = spinner();
    let first = arguments.render.inputs[0].clone();
    let shown = arguments.render.shown(&bar)?;
    if let Some(text) = view::note(&shown.camera) {
        bar.suspend(|| note!("{text}"));
    }
    bar.set_message("packing");
    let whole = match as_they_are {
        true => whole(arguments, &shown, &first),
        false => Ok(None),
    };
    let whole = match size {
        None => whole?,
        Some(most) => whole
            .ok()
            .flatten()
            .filter(|own| page.length(&own.files, &own.view) <= most),
    };
    let contents = match whole {
        Some(contents) => contents,
        None => {
            arguments.as_splats()?;
            let most = size.map(|most| page.room(most)).transpose()?;
            splats(arguments, shown, most, &bar)?
        }
    };
    bar.set_message("writing");
    let bytes = page.write(&out, &contents.files, &contents.view)?;
    bar.finish_and_clear();
    let summary = json!({
        "out": out.display().to_string(),
        "bytes": bytes,
        "files": contents.files.iter().map(Embedded::summary).collect::<Vec<_>>(),
        "merged": contents.merged,
    });
    report(&summary, arguments.own.json, print);
    Ok(())
}

/// Packs the data as they are.
fn whole(arguments: &Arguments, shown: &Shown, first: &Input) -> Result<Option<Contents>> {
    let view = view::of_data(arguments, shown, first)?;
    let files = needed(&first.path, &opened::files(), &view["settings"]["step"])?;
    Ok(Some(Contents {
        files,
        view,
        merged: Value::Null,
    }))
}

/// Makes kernels or splats of the data, at most `most` characters of them.
fn splats(
    arguments: &Arguments,
    mut shown: Shown,
    most: Option<u64>,
    bar: &ProgressBar,
) -> Result<Contents> {
    let limits = Limits {
        characters: most,
        error: arguments.own.error,
    };
    let merged = fewer(&arguments.render, &mut shown, &limits, bar)?;
    let view = view::of_splats(&arguments.render, &shown, merged.turn)?;
    Ok(Contents {
        files: vec![merged.file],
        view,
        merged: merged.summary,
    })
}

/// Checks the name of the page.
fn check_out(out: &Path) -> Result<()> {
    let is_page = out.extension().is_some_and(|e| {
        ["html", "htm"]
            .iter()
            .any(|own| e.eq_ignore_ascii_case(own))
    });
    if !is_page {
        let (expected, advice) = ("a name that ends in .html", "name the page so");
        return Err(Error::invalid(
            "--out",
            "name",
            expected,
            out.display().to_string(),
            advice,
        ));
    }
    check_folder(out)
}

/// Prints the summary in words.
fn print(summary: &Value) {
    let row = |name: &str, value: String| say!("{name:<18} {value}");
    let text = |value: &Value| {
        value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned)
    };
    row("file", text(&summary["out"]));
    row("bytes", text(&summary["bytes"]));
    for file in summary["files"].as_array().into_iter().flatten() {
        row(
            "within",
            format!(
                "{}: {} bytes, {} packed",
                text(&file["name"]),
                file["bytes"],
                file["packed"]
            ),
        );
    }
    let merged = &summary["merged"];
    if merged.is_null() {
        return;
    }
    let psnr = merged["psnr"].as_f64().map_or_else(
        || "no difference".into(),
        |psnr| format!("PSNR {psnr:.1} dB"),
    );
    let number = |key: &str| merged[key].as_f64().unwrap_or(f64::NAN);
    row(
        &text(&merged["kind"]),
        format!(
            "{} of {}: beside the data, in {} pictures, {psnr} (sRGB codes), 99.9 % of pixels within {:.3}, FLIP {:.4}; all of them within {:.3}",
            merged["count"],
            merged["given"],
            merged["pictures"],
            number("p999"),
            number("flip"),
            number("of_all"),
        ),
    );
    for note in merged["notes"].as_array().into_iter().flatten() {
        row("note", text(note));
    }
}
