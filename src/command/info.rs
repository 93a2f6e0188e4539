//! Runs `ewa-splat info`.

use crate::data::association::Association;
use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::data::cells::CellKind;
use crate::data::dataset::{Dataset, Field, Geometry};
use crate::data::mesh::{AlphaMode, Mesh, TextureUse};
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::error::{Advice, Hint};
use crate::io::{SplatAxes, TimeStep, format_of};
use crate::sample::accuracy_warnings;
use crate::sample::{PERCENTILES, ShapeStatistics};
use crate::scene::{LatticeSpacing, Requirements, Values};
use crate::stages::blocks::BlockedVolume;
use crate::{Error, Result};
use clap::Args;
use glam::DVec2;
use serde_json::{Value, json};

use super::files::Files;
use super::info_table::{print_rows, print_table, problem_line};
use super::input::DataOptions;
use super::progress::bar;
use super::words::problem;
use crate::load::Input;
use crate::load::is_prepared;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Files to describe; folders, for all files in them that are recognised, and patterns with * and ? are
    /// taken, too
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Print JSON: of one file an object, else a list of them
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    data: DataOptions,
}

/// Prints descriptions of the inputs.
///
/// # Errors
/// A single file that cannot be read; several files, none of which can be read; a named field that
/// is absent.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let files = Files::of(&arguments.inputs)?;
    let mut inputs: Vec<_> = files.paths.iter().cloned().map(Input::file).collect();
    arguments.data.note_edits(&mut inputs)?;
    let inputs = arguments.data.resolved(inputs, false)?;
    if let ([path], false) = (&inputs[..], files.is_list) {
        let description = arguments.description(path, true)?;
        super::report(&description, arguments.json, print_table);
        return Ok(());
    }
    let progress = bar(inputs.len() as u64);
    let (mut known, mut unknown) = (Vec::new(), Vec::new());
    for input in &inputs {
        let path = &input.path;
        progress.set_message(format!("reading {}", path.display()));
        match arguments.description(input, arguments.json || inputs.len() == 1) {
            Ok(description) => known.push(description),
            Err(error) => {
                let file = path.display().to_string();
                unknown.push(json!({ "file": file, "error": why_unread(&error) }));
            }
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    let known_count = known.len();
    if arguments.json {
        known.append(&mut unknown.clone());
        super::say!("{:#}", Value::Array(known));
    } else {
        match &known[..] {
            [] => {}
            [alone] if inputs.len() == 1 => print_table(alone),
            several => print_rows(several),
        }
        if !(known.is_empty() || unknown.is_empty()) {
            super::say!("");
        }
        for line in unread_lines(&unknown) {
            super::say!("{line}");
        }
    }
    if known_count == 0 {
        return Err(Error::invalid(
            "info",
            "inputs",
            "one file at least that can be read",
            format!("none among {}", inputs.len()),
            "name other files or folders",
        ));
    }
    Ok(())
}

/// Largest number of files that a line names.
const MOST_NAMES: usize = 3;

const NOT_RECOGNISED: &str = "not recognised";

/// Returns the lines about unread files: one line for all files with the same reason.
fn unread_lines(unread: &[Value]) -> Vec<String> {
    let mut by_reason: Vec<(&Value, Vec<&Value>)> = Vec::new();
    for file in unread {
        match by_reason
            .iter_mut()
            .find(|(reason, _)| **reason == file["error"])
        {
            Some((_, files)) => files.push(file),
            None => by_reason.push((&file["error"], vec![file])),
        }
    }
    let line = |(reason, files): (&Value, Vec<&Value>)| {
        if let [file] = files.as_slice() {
            return problem_line(file, "error");
        }
        let names = files.iter().filter_map(|file| file["file"].as_str());
        let names: Vec<&str> = names.take(MOST_NAMES).collect();
        let more = match files.len().saturating_sub(MOST_NAMES) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let reason = reason.as_str().unwrap_or_default();
        format!(
            "{} files: {reason}: {}{more}",
            files.len(),
            names.join(", ")
        )
    };
    by_reason.into_iter().map(line).collect()
}

/// Returns why one of several files was not read. The reason is short for an unknown format,
/// because the list of known formats is long.
fn why_unread(error: &Error) -> String {
    match error {
        Error::Format {
            advice: Advice::Hint(Hint::ConvertOrGiveLayout),
            ..
        } => NOT_RECOGNISED.into(),
        Error::Format { place, found, .. }
            if place.to_string() == "format" && found.ends_with("none of these") =>
        {
            NOT_RECOGNISED.into()
        }
        Error::Format { place, found, .. } if place.to_string() == "format" => found.clone(),
        _ => problem(error),
    }
}

impl Arguments {
    /// Describes a file completely. A file that cannot be drawn still gets its geometry and fields;
    /// the entry `problem` gives the error.
    ///
    /// - `with_blocks`: whether to report the memory needed, for which the particles are sorted
    ///   into blocks.
    ///
    /// # Errors
    /// A file that cannot be read; a named field that is absent.
    fn description(&self, input: &Input, with_blocks: bool) -> Result<Value> {
        if is_prepared(&input.path) {
            return describe_prepared(input);
        }
        let options = self.data.open_options();
        let mut own = input.clone();
        let mut time_steps = None;
        if let Some(choice) = self.data.step_choice() {
            let steps = format_of(&input.path, &options)?.time_steps(&input.path)?;
            let part = &steps[choice.of(&input.path, &steps)?].parts[0];
            (own.path, own.time_step) = (part.path.clone(), part.time_step);
            time_steps = Some(steps);
        }
        let dataset = self.data.open(&own)?;
        let mut description = describe(&dataset);
        let steps = match time_steps {
            Some(steps) => steps,
            None => format_of(&input.path, &options)?.time_steps(&input.path)?,
        };
        let is_alone = steps.iter().all(|step| step.time.is_none()) && steps[0].parts.len() == 1;
        if !is_alone {
            let of_step = |step: &TimeStep| {
                let mut files: Vec<String> = Vec::new();
                for part in &step.parts {
                    let file = part.path.display().to_string();
                    if part.path != input.path && !files.contains(&file) {
                        files.push(file);
                    }
                }
                json!({ "time": step.time, "files": files })
            };
            description["file"] = json!(input.path.display().to_string());
            description["time_steps"] = steps.iter().map(of_step).collect();
        }
        let mut note = |text: String| {
            if let Some(notes) = description["notes"].as_array_mut() {
                notes.push(json!(text));
            }
        };
        // `--radius` replaces the file's lengths, so the note applies only without it.
        if self.data.radius.is_none()
            && let Some(text) = logarithms(&dataset)
        {
            note(text);
        }
        // The surfels of a surface depend on the picture.
        if crate::sample::is_surface(&dataset) {
            if let (Some(field), false) = (&self.data.field, dataset.fields.is_empty()) {
                dataset.scalar(field)?;
            }
            return Ok(description);
        }
        // A bare grid (PLOT3D without its solution) has nothing to show but much to describe.
        if dataset.fields.is_empty()
            && !matches!(
                dataset.geometry,
                Geometry::Points { .. } | Geometry::Splats(_)
            )
        {
            note("no field to show: for a PLOT3D grid name its solution with --solution".into());
            return Ok(description);
        }
        if let Some(field) = &self.data.field {
            dataset.scalar(field)?;
        }
        // Sampling gives the particles that rendering would use.
        let sampled = match self.data.sample(dataset) {
            Ok(sampled) => sampled,
            Err(error) => {
                description["problem"] = json!(problem(&error));
                return Ok(description);
            }
        };
        let report = &sampled.report;
        description["shown"] = json!(report.field);
        description["lengths"] = json!(report.lengths);
        description["left_out"] = json!(report.warnings());
        description["particles"] = json!(sampled.volume.particles.len());
        description["ghosts"] = json!(report.ghost_count);
        if !with_blocks {
            return Ok(description);
        }
        if let Some(shapes) = ShapeStatistics::of(&sampled.volume.particles) {
            description["kernels"] = json!({
                "percentiles": PERCENTILES,
                "size": shapes.size,
                "anisotropy": shapes.anisotropy.map(|ratio| ratio.is_finite().then_some(ratio)),
            });
        }
        description["doubts"] = json!(accuracy_warnings(&sampled.volume.particles));
        description["requirements"] = json!(Requirements::of(&sampled.volume));
        let family = BlockedVolume::with_detail(sampled.volume);
        description["bytes_per_particle"] = json!(BlockedVolume::bytes_per_particle(&family));
        Ok(description)
    }
}

/// Describes a prepared scene from its metadata; its particles are not read.
fn describe_prepared(input: &Input) -> Result<Value> {
    let (scene, about) = crate::load::prepared::open_any(input)?;
    let volumes = scene.volumes().iter();
    let own = volumes.clone().filter(|v| v.merged.is_none());
    let per_volume: Vec<Value> = own
        .zip(scene.requirements())
        .zip(scene.transfer_functions())
        .enumerate()
        .map(|(i, ((volume, requirements), function))| {
            json!({
                "field": about.fields.get(i),
                "particles": volume.particle_count(),
                "blocks": volume.blocks.len(),
                "function_range": function.map(|function| function.range()),
                "requirements": requirements,
            })
        })
        .collect();
    let corners = about.corners.iter().copied().reduce(|[a, b], [c, d]| {
        [
            std::array::from_fn(|i| a[i].min(c[i])),
            std::array::from_fn(|i| b[i].max(d[i])),
        ]
    });
    let blocks: usize = volumes.map(|v| v.blocks.len()).sum();
    Ok(json!({
        "file": input.path.display().to_string(),
        "format": "prepared scene",
        "geometry": { "kind": "particles in blocks", "count": scene.particle_count(), "blocks": blocks },
        "up": { "direction": about.up, "reason": "as the scene was prepared" },
        "is_plane": about.is_plane,
        "front": about.front,
        "bounds": corners,
        "fields": [],
        "particle_types": [],
        "notes": [format!("made of {}", about.inputs.join(", "))],
        "volumes": per_volume,
        "particles": scene.particle_count(),
        "requirements": scene.requirements(),
        "bytes_per_particle": scene.bytes_per_particle(),
    }))
}

/// Returns a note on negative scales that are read as standard deviations: they look like
/// logarithms.
fn logarithms(dataset: &Dataset) -> Option<String> {
    let count = match &dataset.geometry {
        Geometry::Splats(cloud) => {
            let is_below = |scales: &&[f32; 3]| scales.iter().any(|s| *s < 0.0);
            cloud.scales.iter().filter(is_below).count()
        }
        Geometry::Points { positions } => {
            let columns = ["scale_0", "scale_1", "scale_2"].map(|name| dataset.scalar(name).ok());
            let is_below = |i: usize| {
                let mut values = columns.iter().flatten().map(|(_, values)| values);
                values.any(|values| i < values.len() && values.get(i) < 0.0)
            };
            (0..positions.len()).filter(|i| is_below(*i)).count()
        }
        _ => 0,
    };
    let (of, advice) = match &dataset.geometry {
        // Without `--scales linear`, these scales would be read as logarithms.
        Geometry::Points { .. } => ("particles", "leave --scales linear out"),
        _ if dataset.format == "glTF splats" => ("splats", "leave --scales linear out"),
        _ => (
            "splats",
            "convert the file by a program that writes standard deviations",
        ),
    };
    (count > 0).then(|| {
        format!(
            "{count} of the {of} have scales below 0: they look like logarithms where standard deviations belong; {advice}"
        )
    })
}

/// Describes the geometry and fields of a file, drawable or not.
fn describe(dataset: &Dataset) -> Value {
    let geometry = match &dataset.geometry {
        Geometry::Lattice(lattice) => match &lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => json!({
                "kind": "regular lattice", "dims": lattice.dims,
                "spacing": [step.x_axis.length(), step.y_axis.length(), step.z_axis.length()],
            }),
            LatticeSpacing::Rectilinear { .. } => {
                json!({ "kind": "rectilinear lattice", "dims": lattice.dims })
            }
        },
        Geometry::Curvilinear { blocks } => {
            let nodes: usize = blocks.iter().map(|b| b.nodes.len()).sum();
            let dims: Vec<_> = blocks.iter().map(|b| b.dims).collect();
            json!({ "kind": "curvilinear grid", "dims": dims, "nodes": nodes })
        }
        Geometry::Cells(mesh) => {
            let mut kinds: BTreeMap<CellKind, usize> = BTreeMap::new();
            for kind in &mesh.kinds {
                *kinds.entry(*kind).or_default() += 1;
            }
            let kinds: Vec<_> = kinds
                .into_iter()
                .map(|(kind, count)| json!({ "kind": kind.name(), "count": count }))
                .collect();
            let (nodes, cells) = (mesh.nodes.len(), mesh.cell_count());
            json!({ "kind": "unstructured grid", "nodes": nodes, "cells": cells, "cell_kinds": kinds })
        }
        Geometry::Splats(cloud) => json!({
            "kind": "splats", "count": cloud.positions.len(), "degree": cloud.harmonics_degree,
            "anti_aliased": cloud.rule.is_anti_aliased(),
            "rule": cloud.rule,
        }),
        Geometry::Mesh(mesh) => describe_mesh(mesh),
        Geometry::Points { positions } => json!({ "kind": "points", "count": positions.len() }),
    };
    let up = dataset.up();
    let axes = SplatAxes::of_format(dataset.format)
        .map(|(file, read)| json!({ "file": file.to_string(), "read": read.to_string() }));
    let bounds = dataset.bounds();
    let fields: Vec<Value> = dataset
        .fields
        .iter()
        .map(|f| describe_field(dataset, f))
        .collect();
    let types: Vec<Value> = dataset.particle_types.iter().map(describe_type).collect();
    json!({
        "file": dataset.path.display().to_string(),
        "format": dataset.format,
        "geometry": geometry,
        "axes": axes,
        "up": { "direction": up.direction.to_array(), "reason": up.reason },
        "is_plane": up.is_plane,
        "front": up.front.map(|front| front.to_array()),
        "bounds": bounds.map(|(lower, upper)| [lower.to_array(), upper.to_array()]),
        "fields": fields,
        "particle_types": types,
        "notes": dataset.notes,
    })
}

/// Describes the particles of one type in a snapshot.
fn describe_type(particles: &ParticleCount) -> Value {
    let types: Vec<String> = particles
        .types
        .iter()
        .map(ParticleType::to_string)
        .collect();
    json!({
        "name": particles.name,
        "types": types,
        "count": particles.count,
        "is_read": particles.is_read,
    })
}

/// Describes a field's values, or its error.
fn describe_field(dataset: &Dataset, field: &Field) -> Value {
    let mut description = json!({
        "name": field.name,
        "unit": field.unit,
        "of": match field.association {
            Association::Nodes => "nodes",
            Association::Cells => "cells",
        },
    });
    match dataset.field_scalar(field) {
        Ok(values) => {
            description["type"] = json!(values.type_name());
            description["range"] = json!(shown_range(&values));
            description["non_finite"] = json!(values.non_finite_count());
        }
        Err(error) => description["problem"] = json!(problem(&error)),
    }
    description
}

/// Returns the range of values, with the precision of their type.
fn shown_range(values: &Values) -> Option<Value> {
    let range = values.finite_range()?;
    Some(match values {
        Values::F64(_) => json!(range),
        _ => json!(DVec2::from(range).as_vec2().to_array()),
    })
}

/// Describes a mesh, with the number of triangles of each material.
fn describe_mesh(mesh: &Mesh) -> Value {
    let mut counts = vec![0; mesh.materials.len()];
    for part in &mesh.parts {
        counts[part.material] += part.triangles.len();
    }
    let size = |texture: &Option<TextureUse>| {
        let image = &mesh.textures[texture.as_ref()?.texture].image;
        Some([image.width, image.height])
    };
    let materials: Vec<Value> = mesh
        .materials
        .iter()
        .zip(counts)
        .filter(|(_, triangles)| *triangles > 0)
        .map(|(material, triangles)| {
            let (alpha, cutoff) = match material.alpha {
                AlphaMode::Opaque => ("opaque", None),
                AlphaMode::Mask(cutoff) => ("mask", Some(cutoff)),
                AlphaMode::Blend => ("blend", None),
            };
            json!({
                "name": material.name,
                "triangles": triangles,
                "alpha": alpha,
                "cutoff": cutoff,
                "double_sided": material.is_double_sided,
                "base_colour": material.base_colour,
                "base_texture": size(&material.base_texture),
                "emissive": material.emissive,
                "emissive_texture": size(&material.emissive_texture),
            })
        })
        .collect();
    json!({
        "kind": "mesh", "triangles": mesh.triangle_count(), "lines": mesh.line_count(),
        "points": mesh.point_count(), "parts": mesh.parts.len(),
        "textures": mesh.textures.len(), "materials": materials,
    })
}
