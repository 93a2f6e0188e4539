//! Runs `ewa-splat convert`.

use std::mem::take;
use std::path::{Path, PathBuf};

use crate::data::dataset::{Dataset, Geometry};
use crate::data::splats::SplatCloud;
use crate::data::spz_records::{Change, SpzRecords};
use crate::data::up::Up;
use crate::io::write_splats;
use crate::io::{
    PlyForm, SplatFileOptions, SpzVersion, WrittenSplats, check_folder, check_splats_path,
};
use crate::load::note::axis;
use crate::load::{Input, SurfelDemand, prefer};
use crate::render::{bake_light, nothing_lit};
use crate::sample::mesh::{MeshReport, Spread};
use crate::sample::{
    ConversionReport, Finding, SampleOptions, as_surface, field_choices, is_surface, scene,
    sound_splats, splat_cloud,
};
use crate::scene::Lighting;
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use glam::{DQuat, DVec3};
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::certificate::{certificate, line};
use super::fewer::{FewerOptions, line as fewer_line};
use super::fewest::fewest;
use super::input::DataOptions;
use super::lit::FileLightOptions;
use super::outputs::check_collisions;
use super::parse;
use super::prepare::{PrepareOptions, is_scene};
use super::progress;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Files to convert into one
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// File of splats to write: ply, compressed.ply, splat, ksplat, spz, sog, meta.json (a SOG's, with its images beside it), glb, gltf,
    /// usda, usdc, usdz, csv or vtu; or arrow: a prepared scene, blocks and levels
    /// of detail that `render`, `view`, `info` and `measure` take without reading what no picture asks for
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// PLY without a third scale, as 2-D Gaussian splatting stores surfels; all splats must be flat
    #[arg(long)]
    surfels: bool,
    /// Version of an SPZ file; without this 3, which more viewers read
    #[arg(long, value_name = "3|4")]
    spz_version: Option<Version>,
    /// Keep coordinates as they are read; without this, what is up in pictures of the inputs is turned to where the format has it: -y
    /// of ply, splat and sog, +y of spz, glb and usda
    #[arg(long)]
    keep_axes: bool,
    /// Width of splats: standard deviation over spacing. Wide splats blur colours and outlines of surfaces, narrow ones let the
    /// background through [default: 0.55 of surfaces, otherwise that of --kernel-width]
    #[arg(long, value_name = "W", value_parser = parse::positive, conflicts_with = "kernel_width")]
    width: Option<f64>,
    #[command(flatten)]
    fewer: FewerOptions,
    #[command(flatten)]
    light: FileLightOptions,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    prepare: PrepareOptions,
    #[command(flatten)]
    data: DataOptions,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Version {
    #[value(name = "3")]
    Three,
    #[value(name = "4")]
    Four,
}

/// Splats of all inputs so far.
#[derive(Default)]
pub(super) struct Converted {
    pub(super) cloud: SplatCloud,
    report: ConversionReport,
    /// True if light is in the colours of some splats.
    is_lit: bool,
    /// Summary of each mesh's conversion.
    meshes: Vec<Value>,
    pub(super) notes: Vec<String>,
    /// Direction up of each input.
    pub(super) ups: Vec<(PathBuf, Up)>,
    /// Losses of fewer splats than there were, or null.
    fewer: Value,
    /// True if what sampling warns of was said before.
    is_quiet: bool,
}

/// Converts the inputs and writes the output.
///
/// # Errors
/// The errors of reading, sampling, converting and writing; an output that is also an input.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let is_scene = is_scene(&arguments.out);
    match is_scene {
        true => arguments.check_scene()?,
        false => {
            check_splats_path(&arguments.out)?;
            arguments.prepare.check_unused()?;
            arguments.check_rule()?;
        }
    }
    check_collisions(arguments.inputs.iter(), std::iter::once(&arguments.out))?;
    let named = arguments.inputs.iter().cloned().map(Input::file);
    let inputs = arguments.data.inputs(named.collect(), false)?;
    let lighting = arguments.light.lighting();
    if is_scene {
        let (out, data) = (&arguments.out, &arguments.data);
        return arguments
            .prepare
            .run(&inputs, out, data, lighting.is_some(), arguments.json);
    }
    let bar = progress::bar(inputs.len() as u64 + 1);
    let conversion = Conversion {
        data: &arguments.data,
        width: arguments.width,
        light: lighting,
        of_surfaces: None,
        light_option: match arguments.light.has_lights() {
            true => "--light",
            false => "--lit",
        },
        is_quiet: false,
        fewer: Some(&arguments.fewer),
    };
    let mut converted = conversion.converted(&inputs, &bar)?;
    bar.set_message("writing");
    let Converted {
        cloud,
        report,
        meshes,
        notes,
        ups,
        fewer,
        ..
    } = &mut converted;
    let form = if arguments.surfels {
        PlyForm::Surfels
    } else {
        PlyForm::Volumetric
    };
    let up = Up::of_scene(ups.iter().map(|(_, up)| *up));
    let options = SplatFileOptions {
        form,
        spz_version: arguments.spz_version.map(Into::into),
        up: (!arguments.keep_axes).then_some(up.direction),
    };
    let count = arguments.data.count;
    let merges = arguments.fewer.merges(count, [meshes.len(), ups.len()])?;
    if merges && fewer.is_null() {
        bar.set_message("merging splats");
        let merged = arguments
            .fewer
            .merged(take(cloud), count, up.direction, notes);
        (*cloud, *fewer) = merged?;
        report.splat_count = cloud.positions.len();
        bar.set_message("writing");
    }
    let written = write_splats(&arguments.out, cloud, &options)?;
    let (degree, is_anti_aliased) = (cloud.harmonics_degree, cloud.rule.is_anti_aliased());
    bar.set_message("comparing");
    let given = take(cloud);
    let certificate = certificate(&arguments.out, given, &written, notes).unwrap_or_else(|error| {
        notes.push(format!("not compared with what was written: {error}"));
        Value::Null
    });
    bar.finish_and_clear();
    if !arguments.keep_axes {
        say_turns(&arguments.out, &up, ups, &written);
    }
    notes.extend(written.notes.iter().cloned());
    let findings = |left_out: bool| {
        let of = report
            .findings
            .iter()
            .filter(move |f| f.left_out == left_out);
        of.map(finding).collect::<Vec<_>>()
    };
    let summary = json!({
        "out": arguments.out.display().to_string(),
        "particles": report.particle_count,
        "splats": report.splat_count,
        "left_out": findings(true),
        "findings": findings(false),
        "meshes": meshes,
        "degree": degree,
        "anti_aliased": is_anti_aliased,
        "bytes": written.bytes,
        "position_quantum": written.position_quantum,
        "turn": written.turn.to_array(),
        "fewer": fewer,
        "certificate": certificate,
        "notes": notes,
    });
    super::report(&summary, arguments.json, print);
    Ok(())
}

/// Conversion of data to splats, by the options of a command.
pub(super) struct Conversion<'a> {
    pub(super) data: &'a DataOptions,
    /// Width of splats, if it is given.
    pub(super) width: Option<f64>,
    /// Light that is baked into the colours of surfaces and fields.
    pub(super) light: Option<Lighting>,
    /// Light that is baked into the colours of surfaces if `light` is none.
    pub(super) of_surfaces: Option<Lighting>,
    /// Option that asks for `light`.
    pub(super) light_option: &'static str,
    /// True if what sampling warns of was said before.
    pub(super) is_quiet: bool,
    /// Options of a mesh alone that becomes the fewest splats with a stated error.
    pub(super) fewer: Option<&'a FewerOptions>,
}

impl Conversion<'_> {
    /// Converts the inputs, one after another.
    ///
    /// # Errors
    /// The errors of reading, sampling and converting; light that lights nothing; inputs that all hold nothing to draw.
    pub(super) fn converted(&self, inputs: &[Input], bar: &ProgressBar) -> Result<Converted> {
        let mut converted = Converted {
            is_quiet: self.is_quiet,
            ..Converted::default()
        };
        let mut nothing = None;
        for (input, options) in inputs.iter().zip(self.options(inputs)?) {
            let path = &input.path;
            bar.set_message(format!("converting {}", path.display()));
            match self.add(&mut converted, (input, &options), inputs.len() == 1, bar) {
                Err(error) if inputs.len() > 1 && error.holds_nothing() => {
                    let note = format!("{}: holds nothing to draw: left out", path.display());
                    converted.notes.push(note);
                    nothing.get_or_insert(error);
                }
                added => added?,
            }
            bar.inc(1);
        }
        if let Some(error) = nothing.filter(|_| converted.ups.is_empty()) {
            return Err(error);
        }
        if self.light.is_some() && !converted.is_lit {
            return Err(nothing_lit(self.light_option));
        }
        Ok(converted)
    }

    /// Converts an input.
    ///
    /// - `is_only`: whether there is no other.
    fn add(
        &self,
        converted: &mut Converted,
        (input, options): (&Input, &SampleOptions),
        is_only: bool,
        bar: &ProgressBar,
    ) -> Result<()> {
        let path = &input.path;
        let dataset = self.data.open(input)?;
        for note in &dataset.notes {
            converted.notes.push(format!("{}: {note}", path.display()));
        }
        let up = dataset.up();
        let dataset = as_surface(dataset, options)?;
        let is_shown_surface = is_surface(&dataset) || options.flatten.is_some();
        let of_surfaces = self.of_surfaces.as_ref().filter(|_| is_shown_surface);
        let light = self.light.as_ref().or(of_surfaces);
        let light = light.map(|light| (light, up.direction));
        let most = self.fewer.map(|fewer| fewer.of_mesh(&dataset, options));
        let most = most.transpose()?.flatten();
        let most = most.filter(|_| is_only && light.is_none());
        match most {
            Some(most) => converted.add_fewest(dataset, options, (most, up.direction), bar)?,
            None => converted.add(dataset, options, light, bar)?,
        }
        converted.ups.push((path.clone(), up));
        Ok(())
    }

    /// Returns the sampling options of each input. Meshes share the surfel count that one mesh
    /// would get. Data without a named field show a field that they have in common.
    fn options(&self, inputs: &[Input]) -> Result<Vec<SampleOptions>> {
        let width = self.width.or(self.data.kernel_width);
        let is_lit = self.light.is_some() || self.of_surfaces.is_some();
        let options = self.data.sample_options().for_splats(width, is_lit);
        let all = inputs.iter().map(|input| input.sample_options(&options));
        let mut all: Vec<SampleOptions> = all.collect();
        if inputs.len() < 2 {
            return Ok(all);
        }
        let (mut demands, mut choices) = (Vec::new(), Vec::new());
        for (input, options) in inputs.iter().zip(&all) {
            let dataset = match self.data.open(input) {
                Err(error) if error.holds_nothing() => {
                    demands.push(None);
                    choices.push(Vec::new());
                    continue;
                }
                dataset => as_surface(dataset?, options)?,
            };
            demands.push(match &dataset.geometry {
                Geometry::Mesh(mesh) => Some(SurfelDemand::of(mesh, &[])),
                _ => None,
            });
            choices.push(field_choices(&dataset));
        }
        prefer(&mut all, choices);
        for (own, shared) in all.iter_mut().zip(SurfelDemand::share(&demands)) {
            if let (Some((spread, _)), Spread::Automatic) = (shared, own.kernels.spread) {
                own.kernels.spread = spread;
            }
        }
        Ok(all)
    }
}

impl Arguments {
    /// Refuses a rule of drawing: files of splats state none but a mark, which stays as it is.
    fn check_rule(&self) -> Result<()> {
        if self.data.splat_rule.is_none() {
            return Ok(());
        }
        let (expected, found) = ("a picture or a prepared scene", "a file of splats");
        let advice = "leave it out";
        Err(Error::invalid(
            "--splat-rule",
            "--out",
            expected,
            found,
            advice,
        ))
    }

    /// Refuses options that do not apply to a prepared scene.
    fn check_scene(&self) -> Result<()> {
        check_folder(&self.out)?;
        let [error, keep_all] = self.fewer.asked();
        let given = [
            error,
            keep_all,
            ("--surfels", self.surfels),
            ("--spz-version", self.spz_version.is_some()),
            ("--keep-axes", self.keep_axes),
            ("--width", self.width.is_some()),
            ("--light", self.light.has_lights()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((option, _)) => {
                let (expected, found) = ("a file of splats", "a prepared scene");
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
}

/// Prints how coordinates were rotated. Names the inputs whose direction up differs from the one
/// that the rotation assumes.
fn say_turns(out: &Path, up: &Up, ups: &[(PathBuf, Up)], written: &WrittenSplats) {
    for (path, other) in ups.iter().filter(|(_, of)| of.direction != up.direction) {
        super::progress::note!(
            "{}: {} is up ({}), {} in what is written: all inputs are turned as one; --rotate turns one alone",
            path.display(),
            axis(other.direction),
            other.reason,
            axis(up.direction)
        );
    }
    if written.turn == DQuat::IDENTITY {
        return;
    }
    let corner = |v: DVec3| axis((written.turn * v).round());
    super::progress::note!(
        "{}: turned, {} is up ({}): x, y, z of the inputs lie along {}, {}, {}; --keep-axes leaves them",
        out.display(),
        axis(up.direction),
        up.reason,
        corner(DVec3::X),
        corner(DVec3::Y),
        corner(DVec3::Z)
    );
}

impl From<Version> for SpzVersion {
    fn from(version: Version) -> Self {
        match version {
            Version::Three => Self::Three,
            Version::Four => Self::Four,
        }
    }
}

fn finding(finding: &Finding) -> Value {
    json!({ "count": finding.count, "noun": finding.noun, "reason": finding.reason })
}

/// Summarises the conversion of a mesh.
fn mesh_summary(path: &Path, report: &MeshReport) -> Value {
    json!({
        "file": path.display().to_string(),
        "triangles": report.triangle_count,
        "surfels": report.surfel_count,
        "of_lines_and_points": report.mark_count,
        "area": report.area,
        "spacing": report.spacing,
        // Weights of merged surfels do not sum to 1, and need not.
        "ripple": report.composited.is_none().then_some(report.ripple),
        "greatest_ripple": report.composited.is_none().then_some(report.greatest_ripple),
        "opacity": report.composited.map(|c| c.opacity),
        "error": report.composited.map(|c| c.error),
        "left_out": report.findings.iter().map(finding).collect::<Vec<_>>(),
    })
}

impl Converted {
    /// Returns true if any input was a mesh.
    pub(super) fn has_meshes(&self) -> bool {
        !self.meshes.is_empty()
    }

    /// Converts a data set and adds its splats.
    ///
    /// - `light`: lighting of surfaces and fields, and the direction up of its cameras.
    fn add(
        &mut self,
        dataset: Dataset,
        options: &SampleOptions,
        light: Option<(&Lighting, DVec3)>,
        bar: &ProgressBar,
    ) -> Result<()> {
        let path = dataset.path.clone();
        let (cloud, report) = match dataset.geometry {
            // Keeps the file's splats. A named field replaces their colours, so it takes the other
            // branch.
            Geometry::Splats(cloud) if options.field.is_none() => sound_splats(cloud)?,
            geometry => {
                let mut records = match &geometry {
                    Geometry::Splats(cloud) => cloud.records.clone(),
                    _ => SpzRecords::default(),
                };
                records.change(Change::Splats);
                let dataset = Dataset {
                    geometry,
                    ..dataset
                };
                let mut sampled = scene(dataset, options)?;
                if let Some((light, up)) = light {
                    let is_lit = bake_light(&mut sampled.volumes, light, up);
                    self.is_lit |= is_lit.map_err(|e| e.in_file(&path))?;
                }
                match sampled.report.mesh {
                    Some(mesh) => self.meshes.push(mesh_summary(&path, &mesh)),
                    None => {
                        let warnings = (!self.is_quiet).then(|| sampled.report.warnings());
                        for line in warnings.into_iter().flatten() {
                            bar.suspend(|| super::progress::note!("{}: {line}", path.display()));
                        }
                    }
                }
                let (mut cloud, report) =
                    splat_cloud(&sampled.volumes).map_err(|e| e.in_file(&path))?;
                cloud.records = records;
                (cloud, report)
            }
        };
        if !self.cloud.positions.is_empty()
            && self.cloud.rule.is_anti_aliased() != cloud.rule.is_anti_aliased()
        {
            self.notes.push(format!(
                "{}: splats made for another low-pass filter than those before are marked as those",
                path.display()
            ));
        }
        self.cloud.append(cloud);
        self.report.append(report);
        Ok(())
    }

    /// Converts a mesh to the fewest splats with a stated error, and adds them.
    fn add_fewest(
        &mut self,
        dataset: Dataset,
        options: &SampleOptions,
        (most, up): (f64, DVec3),
        bar: &ProgressBar,
    ) -> Result<()> {
        let Geometry::Mesh(mesh) = &dataset.geometry else {
            return self.add(dataset, options, None, bar);
        };
        let made = |spread: Spread| {
            let mut options = options.clone();
            options.kernels.spread = spread;
            let mut made = Self::default();
            made.add(dataset.clone(), &options, None, bar)?;
            Ok(made)
        };
        let all = made(options.kernels.spread)?;
        let some = |count| made(Spread::Count(count));
        let (best, fewer) = fewest(mesh, all, |made| &made.cloud, (most, up), some)?;
        if fewer["mesh"]["given"].as_f64() > Some(most) {
            self.notes.push(format!(
                "--error {most}: all splats are farther from the mesh and are kept; --count or --spacing makes more"
            ));
        }
        self.fewer = fewer;
        self.meshes.extend(best.meshes);
        self.cloud.append(best.cloud);
        self.report.append(best.report);
        Ok(())
    }
}

fn print(summary: &Value) {
    let row = |name: &str, value: String| super::say!("{name:<18} {value}");
    let text = |value: &Value| {
        value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned)
    };
    row("file", text(&summary["out"]));
    row("particles", text(&summary["particles"]));
    row("splats", text(&summary["splats"]));
    for (key, name) in [("left_out", "left out"), ("findings", "note")] {
        for f in summary[key].as_array().into_iter().flatten() {
            let line = format!(
                "{} {}: {}",
                f["count"],
                text(&f["noun"]),
                text(&f["reason"])
            );
            row(name, line);
        }
    }
    for mesh in summary["meshes"].as_array().into_iter().flatten() {
        let expected = match (mesh["opacity"].as_f64(), mesh["error"].as_f64()) {
            (Some(opacity), Some(error)) => format!(
                "seen face on, they cover {:.1} % of what is behind, and colours err by {:.1} of 255 (rms)",
                100.0 * opacity,
                255.0 * error
            ),
            _ => format!(
                "weights sum to 1 within {} (rms; {} at most)",
                mesh["ripple"], mesh["greatest_ripple"]
            ),
        };
        row(
            "mesh",
            format!(
                "{}: {} triangles of area {} to {} surfels, spacing {}; {expected}; {} splats of lines and points",
                text(&mesh["file"]),
                mesh["triangles"],
                mesh["area"],
                mesh["surfels"],
                mesh["spacing"],
                mesh["of_lines_and_points"],
            ),
        );
        for f in mesh["left_out"].as_array().into_iter().flatten() {
            let line = format!(
                "{} {}: {}",
                f["count"],
                text(&f["noun"]),
                text(&f["reason"])
            );
            row("left out", line);
        }
    }
    row("harmonics", format!("degree {}", summary["degree"]));
    row("bytes", text(&summary["bytes"]));
    row("position quantum", text(&summary["position_quantum"]));
    for note in summary["notes"].as_array().into_iter().flatten() {
        row("note", text(note));
    }
    if let Some(line) = fewer_line(&summary["fewer"]) {
        row("merged", line);
    }
    if let Some(line) = line(&summary["certificate"]) {
        row("read back", line);
    }
}
