//! Writes prepared scenes: `ewa-splat convert INPUT --out FILE.arrow`.

use std::path::{Path, PathBuf};

use crate::load::partitioned::open_stream;
use crate::load::{Checks, Input, Loaded};
use crate::prepared::PreparedScene;
use crate::sample::{PurposeOptions, SampleOptions, SampleReport};
use crate::{Error, Result, SceneOptions};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::input::DataOptions;
use super::progress::{self, note};
use super::usage::refuse_beside;

/// Options of a prepared scene.
#[derive(Args)]
#[command(next_help_heading = "Prepared scenes (--out FILE.arrow)")]
pub(crate) struct PrepareOptions {
    /// Prepare the scene for column densities, not for pictures
    #[arg(long, conflicts_with = "lit")]
    column_density: bool,
    /// Whether levels of detail are kept, by which distant particles are drawn together
    #[arg(long, value_enum, default_value = "auto", value_name = "auto|off")]
    level_of_detail: Detail,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Detail {
    Auto,
    Off,
}

/// Returns true if the path names a prepared scene.
pub(crate) fn is_scene(out: &Path) -> bool {
    out.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("arrow"))
}

/// Returns the folder for temporary files: that of the output, whose disk has space for the scene.
fn folder_of(out: &Path) -> &Path {
    match out.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

impl PrepareOptions {
    /// Refuses options that do not apply to a file of splats.
    pub(crate) fn check_unused(&self) -> Result<()> {
        let given = [
            ("--column-density", self.column_density),
            ("--level-of-detail", self.level_of_detail == Detail::Off),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((option, _)) => {
                let (expected, found) = ("a prepared scene, FILE.arrow", "a file of splats");
                Err(Error::invalid(
                    *option,
                    "--out",
                    expected,
                    found,
                    "leave it out",
                ))
            }
        }
    }

    /// Prepares a scene of all inputs and writes it.
    ///
    /// - `is_lit`: true to keep normals.
    ///
    /// # Errors
    /// The errors of reading, sampling and writing; an input that is a prepared scene.
    pub(crate) fn run(
        &self,
        inputs: &[Input],
        out: &Path,
        data: &DataOptions,
        is_lit: bool,
        prints_json: bool,
    ) -> Result<()> {
        let bar = progress::spinner();
        let task = progress::task_of(&bar);
        let options = SampleOptions {
            purpose: PurposeOptions {
                for_columns: self.column_density,
                normals: is_lit,
                local_models: !self.column_density,
                ..PurposeOptions::default()
            },
            task: task.clone(),
            ..data.sample_options()
        };
        let scene_options = SceneOptions {
            level_of_detail: self.level_of_detail == Detail::Auto && !self.column_density,
            task,
            ..SceneOptions::default()
        };
        let streamed = match inputs {
            [input] => {
                let (open, checks) = (data.open_options(), data.checks(inputs, &options));
                checks.choices()?;
                let request = data.request(&checks, &open, &|_, _| Ok(Vec::new()), &|_| {});
                open_stream(&request, input)?
            }
            _ => None,
        };
        let (prepared, about) = match streamed {
            Some(mut file) => {
                for note in file.notes() {
                    bar.suspend(|| note!("{}: {note}", inputs[0].path.display()));
                }
                bar.set_message("sorting on the disk");
                let prepared = PreparedScene::of_stream(&mut file, &scene_options, folder_of(out))?;
                for line in file.report().map_or(Vec::new(), SampleReport::warnings) {
                    bar.suspend(|| note!("{}: {line}", inputs[0].path.display()));
                }
                let about = Loaded::of_stream(&file).about(inputs, self.column_density);
                (prepared, about)
            }
            None => {
                let scene = data.scene(inputs, &options, &|_, _| Ok(Vec::new()), &bar)?;
                refuse_beside(&scene.prepared, &[("convert", true)])?;
                let about = scene.about(inputs, self.column_density);
                bar.set_message("sorting into blocks");
                (PreparedScene::new(scene.volumes, &scene_options)?, about)
            }
        };
        bar.set_message("writing");
        let bytes = prepared.write(out, &about)?;
        bar.finish_and_clear();
        let blocks: usize = prepared.volumes().iter().map(|v| v.blocks.len()).sum();
        let levels = prepared.volumes().len() - about.fields.len();
        let out: PathBuf = out.into();
        let summary = json!({
            "out": out.display().to_string(),
            "particles": prepared.particle_count(),
            "volumes": about.fields.len(),
            "levels_of_detail": levels,
            "blocks": blocks,
            "bytes": bytes,
            "bytes_per_particle": bytes as f64 / prepared.particle_count().max(1) as f64,
            "fields": about.fields,
        });
        super::report(&summary, prints_json, print);
        Ok(())
    }
}

/// Prints the summary of a prepared scene in words.
fn print(summary: &Value) {
    let row = |name: &str, value: String| super::say!("{name:<18} {value}");
    row("file", summary["out"].as_str().unwrap_or_default().into());
    row("particles", summary["particles"].to_string());
    row("blocks", summary["blocks"].to_string());
    let per_particle = summary["bytes_per_particle"].as_f64().unwrap_or(0.0);
    row(
        "bytes",
        format!("{}, {per_particle:.1} per particle", summary["bytes"]),
    );
}
