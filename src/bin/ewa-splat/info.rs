//! `ewa-splat info`

use std::path::PathBuf;

use clap::Args;
use ewa_splat::Result;
use ewa_splat::blocks::BlockedVolume;
use ewa_splat::io::{Association, Dataset, Geometry};
use ewa_splat::scene::{LatticeSpacing, Requirements};
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
    let notes = dataset.notes.clone();
    // What rendering makes of it.
    let sampled = arguments.data.sample(dataset)?;
    description["left_out"] = json!([notes, sampled.report.warnings()].concat());
    description["requirements"] = json!(Requirements::of(&sampled.volume));
    let blocked = BlockedVolume::new(sampled.volume);
    description["particles"] = json!(blocked.particle_count());
    description["bytes_per_particle"] = json!(blocked.bytes_per_particle());
    if arguments.json {
        crate::say!("{description:#}");
    } else {
        print_table(&description);
    }
    Ok(())
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
            let count = mesh.cell_count();
            (
                json!({ "kind": "unstructured grid", "cells": count }),
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
        Geometry::Points { positions } => {
            let (lower, upper) = bounds(positions.iter().copied());
            (
                json!({ "kind": "points", "count": positions.len() }),
                lower,
                upper,
            )
        }
    };
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
        "bounds": [lower.to_array(), upper.to_array()],
        "fields": fields,
    }))
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points
        .filter(|p| p.is_finite())
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| {
            (a.min(p), b.max(p))
        })
}

fn print_table(description: &Value) {
    let text = |v: &Value| v.as_str().map_or_else(|| v.to_string(), str::to_string);
    let row = |name: &str, value: String| crate::say!("{name:<18} {value}");
    row("file", text(&description["file"]));
    row("format", text(&description["format"]));
    if let Some(geometry) = description["geometry"].as_object() {
        for (name, value) in geometry {
            row(name, text(value));
        }
    }
    row("lower bound", text(&description["bounds"][0]));
    row("upper bound", text(&description["bounds"][1]));
    row("particles", text(&description["particles"]));
    let bytes = description["bytes_per_particle"].as_f64().unwrap_or(0.0);
    row("bytes per particle", format!("{bytes:.2}"));
    for line in description["left_out"].as_array().into_iter().flatten() {
        row("note", text(line));
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
        let number = |v: &Value| v.as_f64().map_or_else(|| "-".into(), |x| format!("{x:.6}"));
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
