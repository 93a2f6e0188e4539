//! Tests OpenFOAM cases.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::Error;
use ewa_splat::io::{CellKind, CellMesh, Dataset, OpenOptions, format_of, open, read};
use glam::DVec3;

use crate::common::real_data;
use crate::support;
use crate::support::openfoam::{Form, zoo};
use crate::support::{cells, numbers};

fn write(folder: &Path, files: &[(String, Vec<u8>)]) {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

fn at_step(path: &Path, step: usize) -> ewa_splat::Result<Dataset> {
    let options = OpenOptions {
        time_step: Some(step),
        ..OpenOptions::default()
    };
    open(path, &options)
}

/// Returns the volume that a cell's faces enclose, by the divergence theorem: positive if they face
/// outwards.
fn volume(mesh: &CellMesh, cell: usize) -> f64 {
    let entries = mesh.cell(cell);
    let faces: Vec<Vec<u32>> = match mesh.kinds[cell].faces() {
        Some(faces) => faces
            .iter()
            .map(|face| face.iter().map(|&c| entries[usize::from(c)]).collect())
            .collect(),
        None => {
            let mut rest = &entries[1..];
            (0..entries[0])
                .map(|_| {
                    let (face, tail) = rest[1..].split_at(rest[0] as usize);
                    rest = tail;
                    face.to_vec()
                })
                .collect()
        }
    };
    let node = |n: u32| mesh.nodes[n as usize];
    let of_triangle = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c)) / 6.0;
    let of_face = |face: &Vec<u32>| -> f64 {
        let fan = face[1..].windows(2);
        fan.map(|w| of_triangle(node(face[0]), node(w[0]), node(w[1])))
            .sum()
    };
    faces.iter().map(of_face).sum()
}

#[test]
fn cells_of_all_shapes_are_read_in_every_form() {
    for form in Form::all() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &form.case());
        let data = at_step(folder.path(), 1).unwrap();
        let mesh = cells(&data);
        let kinds = [
            CellKind::HEXAHEDRON,
            CellKind::PYRAMID,
            CellKind::TETRA,
            CellKind::WEDGE,
            CellKind::POLYHEDRON,
        ];
        assert_eq!(mesh.kinds, kinds, "{form:?}");
        let nodes: Vec<DVec3> = zoo().nodes.into_iter().map(DVec3::from).collect();
        assert_eq!(mesh.nodes, nodes);
        // Computed by hand from the nodes; a pentagon of 1.25 + 0.375 is extruded by 1.
        let volumes = [1.0, 1.0 / 3.0, 1.25 / 6.0, 0.5, 1.625];
        for (cell, expected) in volumes.iter().enumerate() {
            let found = volume(mesh, cell);
            assert!(
                (found - expected).abs() < 1e-12,
                "{form:?}: {cell}: {found}"
            );
        }
        assert_eq!(numbers(&data, "p"), [0.0, 0.25, 0.5, 0.75, 1.0]);
        assert_eq!(numbers(&data, "U:z"), [0.5, 1.25, 2.0, 2.75, 3.5]);
        assert_eq!(numbers(&data, "R_yz")[4], 7.0);
        assert_eq!(numbers(&data, "D:y")[17], 13.0);
        assert_eq!(data.unit("p"), Some("m/s"));
        let notes = data.notes.join("\n");
        assert!(notes.contains("`phi (surfaceScalarField)`"), "{notes}");
        assert!(notes.contains("`calculated`"), "{notes}");

        let first = open(folder.path(), &OpenOptions::default()).unwrap();
        assert_eq!(numbers(&first, "p"), [2.5; 5]);
        assert_eq!(numbers(&first, "U:y"), [2.0; 5]);
        assert_eq!(first.unit("p"), Some("Pa"));
        assert_eq!(first.notes, ["The first of 2 time steps, of time 0."]);
    }
}

/// Opens a case by its folder, its `controlDict`, an empty marker file, and an archive.
#[test]
fn a_case_opens_by_what_stands_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let files = Form::default().case();
    write(folder.path(), &files);
    for marker in ["a.foam", "b.OpenFOAM"] {
        std::fs::write(folder.path().join(marker), "").unwrap();
    }
    let named: Vec<(String, Vec<u8>)> = files
        .iter()
        .map(|(name, bytes)| (format!("in/case/{name}"), bytes.clone()))
        .collect();
    let members: Vec<(&str, Vec<u8>)> = named
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.clone()))
        .collect();
    let archive = support::npz(&members, true);
    std::fs::write(folder.path().join("c.zip"), &archive).unwrap();
    for name in ["", "system/controlDict", "a.foam", "b.OpenFOAM", "c.zip"] {
        let path = folder.path().join(name);
        let steps = format_of(&path, &OpenOptions::default())
            .unwrap()
            .time_steps(&path)
            .unwrap();
        let times: Vec<Option<f64>> = steps.iter().map(|step| step.time).collect();
        assert_eq!(times, [Some(0.0), Some(0.5)], "{name}");
        assert!(steps.iter().all(|step| step.parts[0].path == path));
        let data = at_step(&path, 1).unwrap();
        assert_eq!(numbers(&data, "p").len() + cells(&data).nodes.len(), 23);
    }
    let options = OpenOptions::default();
    let data = read("c.zip", &archive, &options).unwrap();
    assert_eq!(cells(&data).cell_count(), 5);
    let error = read("system/controlDict", &files[0].1, &options).unwrap_err();
    assert!(error.to_string().contains("ZIP archive"), "{error}");
    let error = open(&folder.path().join("0/p"), &options).unwrap_err();
    assert!(error.to_string().contains("the case's folder"), "{error}");
}

#[test]
fn pieces_of_processors_are_put_together() {
    for form in Form::all() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &form.decomposed());
        let data = open(folder.path(), &OpenOptions::default()).unwrap();
        let mesh = cells(&data);
        assert_eq!((mesh.cell_count(), mesh.nodes.len()), (5, 36));
        assert!((volume(mesh, 4) - 1.625).abs() < 1e-12);
        assert_eq!(numbers(&data, "p"), [0.0, 10.0, 11.0, 12.0, 13.0]);
        assert_eq!(data.field_names(), ["p"]);
        let notes = data.notes.join("\n");
        assert!(notes.contains("2 processors"), "{notes}");
        assert!(notes.contains("`q`"), "{notes}");
    }
}

/// A moving mesh has its own nodes at a time.
#[test]
fn the_mesh_is_that_of_the_time() {
    let folder = tempfile::tempdir().unwrap();
    let form = Form::default();
    write(folder.path(), &form.case());
    let mut moved = zoo();
    moved.nodes.iter_mut().for_each(|node| node[0] += 10.0);
    let points = &form.mesh("0.5", &moved)[..1];
    write(folder.path(), points);
    let x = |step: usize| at_step(folder.path(), step).unwrap().bounds().unwrap().0.x;
    assert_eq!((x(0), x(1)), (-0.25, 9.75));
}

#[test]
fn damage_is_said_by_file_and_place() {
    let form = Form::default();
    let broken = |name: &str, from: &str, to: &str| {
        let folder = tempfile::tempdir().unwrap();
        let mut files = form.case();
        let (_, bytes) = files.iter_mut().find(|(n, _)| n == name).unwrap();
        let text = String::from_utf8(bytes.clone()).unwrap();
        assert!(text.contains(from), "{text}");
        *bytes = text.replacen(from, to, 1).into_bytes();
        write(folder.path(), &files);
        let error = at_step(folder.path(), 1).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{error}");
        error.to_string()
    };
    for (name, from, to, expected) in [
        ("constant/polyMesh/owner", "(0 ", "(99 ", "cells that"),
        ("constant/polyMesh/faces", "(4 ", "(18 ", "nodes below 18"),
        ("constant/polyMesh/faces", "4\n(4 5", "2\n(4 5", "`)`"),
        ("constant/polyMesh/points", "18\n(", "19\n(", "`(`"),
        ("constant/polyMesh/neighbour", "FoamFile", "Foam", "header"),
        ("0.5/p", "5\n(", "4\n(", "a list of 5 values, not 4"),
        ("0.5/U", "(0.75 1 1.25)", "(0.75 1)", "a number"),
        ("0.5/p", "nonuniform", "none", "`uniform` or `nonuniform`"),
    ] {
        let error = broken(name, from, to);
        assert!(error.contains(expected), "{name}: {error}");
    }
}

/// The numbers are those of VTK's reader.
#[test]
fn openfoams_cavity_is_read() {
    let Some(path) = real_data("formats/openfoam/OpenFOAM.zip") else {
        return;
    };
    let data = at_step(&path, 1).unwrap();
    let mesh = cells(&data);
    assert_eq!((mesh.cell_count(), mesh.nodes.len()), (400, 882));
    assert!(mesh.kinds.iter().all(|&kind| kind == CellKind::HEXAHEDRON));
    let (low, high) = data.bounds().unwrap();
    assert!(low == DVec3::ZERO && (high - DVec3::new(0.1, 0.1, 0.01)).length() < 1e-12);
    for cell in 0..400 {
        assert!((volume(mesh, cell) - 2.5e-7).abs() < 1e-12);
    }
    let p = numbers(&data, "p");
    assert_eq!(p[..3], [5.88597e-6, -0.0058199, -0.0129574]);
    assert_eq!(p[137], 0.0794519);
    let range = data.scalar("p").unwrap().1.finite_range().unwrap();
    assert_eq!(range, [-4.36666, 4.84854]);
    assert_eq!(numbers(&data, "U:x")[137], -0.0295457);
    assert_eq!(numbers(&data, "U:y")[137], -0.0672796);
    assert_eq!(data.unit("p"), Some("m^2/s^2"));
    let notes = data.notes.join("\n");
    assert!(notes.contains("`OpenFOAM/64BitFloats`"), "{notes}");
}
