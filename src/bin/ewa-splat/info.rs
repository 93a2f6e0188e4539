//! `ewa-splat info`

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use ewa_splat::Result;
use ewa_splat::io::{AlphaMode, Association, CellKind, Dataset, Geometry, Mesh, TextureUse};
use ewa_splat::sample::{PERCENTILES, ShapeStatistics};
use ewa_splat::scene::{LatticeSpacing, Requirements};
use ewa_splat::stages::blocks::BlockedVolume;
use glam::DVec3;
use serde_json::{Value, json};

use crate::input::DataOptions;

#[derive(Args)]
pub(crate) struct Arguments {
    /// File to describe
    input: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    data: DataOptions,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let dataset = arguments.data.open(&arguments.input)?;
    let mut description = describe(&dataset)?;
    // A mesh has no field, and what is made of it depends on the picture.
    if matches!(dataset.geometry, Geometry::Mesh(_)) {
        print(&description, arguments.json);
        return Ok(());
    }
    // A grid alone (PLOT3D without its solution) has nothing to show and much to tell.
    if dataset.fields.is_empty()
        && !matches!(
            dataset.geometry,
            Geometry::Points { .. } | Geometry::Splats(_)
        )
    {
        if let Some(notes) = description["notes"].as_array_mut() {
            notes.push(json!(
                "no field to show: for a PLOT3D grid name its solution with --solution"
            ));
        }
        print(&description, arguments.json);
        return Ok(());
    }
    // What rendering makes of it.
    let sampled = arguments.data.sample(dataset)?;
    let report = &sampled.report;
    description["shown"] = json!(report.field);
    description["lengths"] = json!(report.lengths);
    description["left_out"] = json!(report.warnings());
    if let Some(shapes) = ShapeStatistics::of(&sampled.volume.particles) {
        description["kernels"] = json!({
            "percentiles": PERCENTILES,
            "size": shapes.size,
            "anisotropy": shapes.anisotropy.map(|ratio| ratio.is_finite().then_some(ratio)),
        });
    }
    description["requirements"] = json!(Requirements::of(&sampled.volume));
    description["particles"] = json!(sampled.volume.particles.len());
    let family = BlockedVolume::with_detail(sampled.volume);
    description["bytes_per_particle"] = json!(BlockedVolume::bytes_per_particle(&family));
    print(&description, arguments.json);
    Ok(())
}

fn print(description: &Value, as_json: bool) {
    if as_json {
        crate::say!("{description:#}");
    } else {
        print_table(description);
    }
}

fn describe(dataset: &Dataset) -> Result<Value> {
    let (geometry, lower, upper) = match &dataset.geometry {
        Geometry::Lattice(lattice) => {
            let last = lattice.dims.map(|n| n.saturating_sub(1));
            let kind = match &lattice.spacing {
                LatticeSpacing::Uniform { step, .. } => json!({
                    "kind": "regular lattice", "dims": lattice.dims,
                    "spacing": [step.x_axis.length(), step.y_axis.length(), step.z_axis.length()],
                }),
                LatticeSpacing::Rectilinear { .. } => {
                    json!({ "kind": "rectilinear lattice", "dims": lattice.dims })
                }
            };
            let corners = (0..8).map(|i| {
                lattice.position([0, 1, 2].map(|a| if i >> a & 1 == 0 { 0 } else { last[a] }))
            });
            let (lower, upper) = bounds(corners);
            (kind, lower, upper)
        }
        Geometry::Curvilinear { blocks } => {
            let nodes = || blocks.iter().flat_map(|b| b.nodes.iter().copied());
            let (lower, upper) = bounds(nodes());
            let dims: Vec<_> = blocks.iter().map(|b| b.dims).collect();
            (
                json!({ "kind": "curvilinear grid", "dims": dims, "nodes": nodes().count() }),
                lower,
                upper,
            )
        }
        Geometry::Cells(mesh) => {
            let (lower, upper) = bounds(mesh.nodes.iter().copied());
            let mut kinds: BTreeMap<CellKind, usize> = BTreeMap::new();
            for kind in &mesh.kinds {
                *kinds.entry(*kind).or_default() += 1;
            }
            let kinds: Vec<_> = kinds
                .into_iter()
                .map(|(kind, count)| json!({ "kind": kind.name(), "count": count }))
                .collect();
            let (nodes, cells) = (mesh.nodes.len(), mesh.cell_count());
            (
                json!({ "kind": "unstructured grid", "nodes": nodes, "cells": cells, "cell_kinds": kinds }),
                lower,
                upper,
            )
        }
        Geometry::Splats(cloud) => {
            let (lower, upper) = bounds(cloud.positions.iter().copied());
            let count = cloud.positions.len();
            let kind = json!({
                "kind": "splats", "count": count, "degree": cloud.harmonics_degree,
                "anti_aliased": cloud.is_anti_aliased,
            });
            (kind, lower, upper)
        }
        Geometry::Mesh(mesh) => {
            let corners = mesh.parts.iter().flat_map(|p| p.positions.iter().copied());
            let (lower, upper) = bounds(corners);
            (describe_mesh(mesh), lower, upper)
        }
        Geometry::Points { positions } => {
            let (lower, upper) = bounds(positions.iter().copied());
            (
                json!({ "kind": "points", "count": positions.len() }),
                lower,
                upper,
            )
        }
    };
    let up = dataset.up();
    let mut fields = Vec::new();
    for field in &dataset.fields {
        let values = dataset.field_scalar(field)?;
        fields.push(json!({
            "name": field.name,
            "of": match field.association {
                Association::Nodes => "nodes",
                Association::Cells => "cells",
            },
            "type": values.type_name(),
            "range": values.finite_range(),
            "non_finite": values.non_finite_count(),
        }));
    }
    Ok(json!({
        "file": dataset.path.display().to_string(),
        "format": dataset.format,
        "geometry": geometry,
        "up": { "direction": up.direction.to_array(), "reason": up.reason },
        "bounds": [lower.to_array(), upper.to_array()],
        "fields": fields,
        "notes": dataset.notes,
    }))
}

/// What a mesh consists of; materials with the triangles that they cover.
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
        "kind": "mesh", "triangles": mesh.triangle_count(), "parts": mesh.parts.len(),
        "textures": mesh.textures.len(), "materials": materials,
    })
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points
        .filter(|p| p.is_finite())
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| {
            (a.min(p), b.max(p))
        })
}

/// Blocks whose dimensions the table lists.
const MOST_BLOCKS: usize = 8;

/// Materials that the table lists.
const MOST_MATERIALS: usize = 16;

/// The percentiles of a row, in words.
const AT: &str = "least, 5 %, median, 95 %, greatest";

/// `[2, 3, 4]` as `2 x 3 x 4`.
fn times(dims: &Value) -> String {
    let dims = dims.as_array().into_iter().flatten();
    dims.map(Value::to_string).collect::<Vec<_>>().join(" x ")
}

/// Six significant digits, in powers of ten where they would not be seen otherwise.
fn significant(x: f64) -> String {
    let size = x.abs();
    if size > 0.0 && !(1e-4..1e7).contains(&size) {
        return format!("{x:.5e}");
    }
    let text = format!("{x:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

/// A material in a line: `5856 triangles, "spot", opaque, one-sided, texture 1024 x 1024`.
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

fn print_table(description: &Value) {
    let text = |v: &Value| v.as_str().map_or_else(|| v.to_string(), str::to_string);
    let row = |name: &str, value: String| crate::say!("{name:<18} {value}");
    row("file", text(&description["file"]));
    row("format", text(&description["format"]));
    let number = |v: &Value| v.as_f64().map_or_else(|| "-".into(), significant);
    let vector = |v: &Value| {
        let numbers = v.as_array().into_iter().flatten().map(number);
        numbers.collect::<Vec<String>>().join(", ")
    };
    let lines = |v: &Value| v.as_array().cloned().unwrap_or_default();
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
    for name in ["nodes", "cells", "count", "triangles", "parts", "textures"] {
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
    row(
        "up",
        format!(
            "{} ({})",
            vector(&description["up"]["direction"]),
            text(&description["up"]["reason"])
        ),
    );
    row("lower bound", vector(&description["bounds"][0]));
    row("upper bound", vector(&description["bounds"][1]));
    if description["particles"].is_u64() {
        row("particles", text(&description["particles"]));
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
    let fields = description["fields"]
        .as_array()
        .map_or(&[][..], Vec::as_slice);
    if !fields.is_empty() {
        crate::say!(
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
        crate::say!(
            "{:<24} {:<6} {:<4} {:>14} {:>14} {:>8}",
            text(&field["name"]),
            text(&field["of"]),
            text(&field["type"]),
            number(&field["range"][0]),
            number(&field["range"][1]),
            text(&field["non_finite"]),
        );
    }
}
