//! Reads Gmsh's meshes (`.msh`) of versions 2, 4.0 and 4.1, text and binary in either byte order, with results.
//!
//! | section | module |
//! |---|---|
//! | `$MeshFormat`: version, form, bytes of a count; in binary files the integer 1 | here |
//! | `$PhysicalNames`, `$Entities`, `$PartitionedEntities`, `$Nodes`, `$ParametricNodes`, `$Elements` | [`mesh`] |
//! | `$NodeData`, `$ElementData`, `$ElementNodeData` | [`data`] |
//! | words and numbers | [`stream`] |
//! | types of elements | [`elements`] |
//!
//! Other sections are passed over. Elements on the boundary of others are left out with a note. Results at nodes of
//! elements become means at the nodes that elements share.
//!
//! Source: the chapter on file formats in Gmsh's reference manual.

mod data;
mod elements;
mod mesh;
mod stream;

use std::collections::{BTreeMap, HashMap, HashSet};

use self::data::{Place, Results, Section};
use self::mesh::{Mesh, Version};
use self::stream::{DAMAGED, Stream};
use super::budget::Budget;
use super::highest::keep_highest;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::io::particles::table::list;
use crate::io::time_steps::{self, TimeStep, chosen};
use crate::io::vtk;

/// Whether a file that begins with `head` is a mesh of Gmsh of a version that is read.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    // Some writers put comments, or the names of groups, before the format.
    let starts: [&[u8]; 3] = [b"$MeshFormat", b"$Comments", b"$PhysicalNames"];
    let head = head.trim_ascii_start();
    starts.iter().any(|start| head.starts_with(start))
}

/// Reads the mesh with the results of one time.
///
/// # Errors
/// Another version; a file that is damaged or ends too soon; nodes that do not exist.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    const FORMAT: &str = "Gmsh mesh";
    let path = input.path;
    let bytes = input.read_all()?;
    let mut mesh = Mesh::new();
    let (stream, sections) = walk(Stream::new(path, &bytes), Some(&mut mesh))?;
    let steps = steps_of(&sections);
    let times: Vec<f64> = steps.values().copied().collect();
    let (step, note) = chosen(path, &times, time_step)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let step = steps.keys().nth(step).copied();

    let budget = Budget::new(path, bytes.len());
    // A result of a single step is one of all times.
    let mut only_steps: HashMap<_, Option<i64>> = HashMap::new();
    for section in &sections {
        let only = only_steps.entry(section.result());
        let only = only.or_insert(Some(section.step));
        *only = only.filter(|step| *step == section.step);
    }
    let is_lasting = |section: &Section| only_steps[&section.result()].is_some();
    let (now, others): (Vec<&Section>, Vec<&Section>) = sections
        .iter()
        .partition(|section| Some(section.step) == step || is_lasting(section));
    let mut results = Results::new(&mesh, &budget, &now);
    for section in &now {
        results.read(stream.clone(), section)?;
    }
    if results.strays > 0 {
        notes.push(format!(
            "Left out: {} results of nodes or elements that are not in the file.",
            results.strays
        ));
    }
    let (mut fields, means) = results.finish();
    if !means.is_empty() {
        notes.push(format!(
            "At nodes that elements share, these are means of the elements' values: {}.",
            list(means.iter().map(String::as_str))
        ));
    }
    let shown: HashSet<_> = now.iter().map(|section| section.result()).collect();
    let is_absent = |section: &&&Section| !shown.contains(&section.result());
    let mut absent: Vec<&str> = others
        .iter()
        .filter(is_absent)
        .map(|s| s.name.as_str())
        .collect();
    absent.sort_unstable();
    absent.dedup();
    if !absent.is_empty() {
        let names = list(absent.into_iter());
        notes.push(format!(
            "Left out, because they have no values at this time: {names}."
        ));
    }
    notes.extend(mesh_notes(&mesh));
    let groups = [
        ("gmsh:physical", std::mem::take(&mut mesh.physical)),
        ("gmsh:geometrical", std::mem::take(&mut mesh.entities)),
        ("gmsh:partition", std::mem::take(&mut mesh.partitions)),
    ];
    for (name, tags) in groups {
        // Zero stands for no group.
        if tags.iter().any(|&tag| tag != 0) {
            let values: Vec<f64> = tags.into_iter().map(f64::from).collect();
            fields.push(Field {
                name: name.to_owned(),
                association: Association::Cells,
                source: FieldSource::Scalar(values.into()),
                unit: None,
            });
        }
    }
    let mut cells = mesh.cells;
    notes.extend(keep_highest(&mut cells, &mut fields));
    let mut data = vtk::grid::dataset(path, FORMAT, cells, fields, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// Reads the time steps of the results.
///
/// # Errors
/// As [`read`], for the sections' first lines.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let bytes = input.read_all()?;
    let (_, sections) = walk(Stream::new(input.path, &bytes), None)?;
    let times: Vec<f64> = steps_of(&sections).into_values().collect();
    Ok(time_steps::of_file(input.path, &times))
}

/// The times of the steps, by their numbers.
fn steps_of(sections: &[Section]) -> BTreeMap<i64, f64> {
    let mut steps = BTreeMap::new();
    for section in sections {
        steps.entry(section.step).or_insert(section.time);
    }
    steps
}

/// Reads all sections, of results only what precedes their entries.
///
/// - `mesh`: receives nodes and elements; `None` passes over them.
fn walk<'a>(
    mut stream: Stream<'a>,
    mut mesh: Option<&mut Mesh>,
) -> Result<(Stream<'a>, Vec<Section>)> {
    let mut version = None;
    let mut sections = Vec::new();
    let mut has_elements = false;
    while let Some(name) = stream.next_section() {
        if name == "MeshFormat" {
            version = Some(format(&mut stream)?);
            stream.end_section(&name)?;
            continue;
        }
        if let Some(place) = Place::of(&name) {
            needs_version(&stream, version)?;
            sections.push(Section::read(&mut stream, place)?);
            stream.skip_section(&name)?;
            continue;
        }
        let Some(mesh) = &mut mesh else {
            stream.skip_section(&name)?;
            continue;
        };
        match name.as_str() {
            "PhysicalNames" => mesh.read_names(&mut stream)?,
            "Nodes" | "ParametricNodes" => {
                let version = needs_version(&stream, version)?;
                mesh.read_nodes(&mut stream, version, name != "Nodes")?;
            }
            "Entities" | "PartitionedEntities" => {
                let version = needs_version(&stream, version)?;
                mesh.read_entities(&mut stream, version, name != "Entities")?;
            }
            "Elements" => {
                let version = needs_version(&stream, version)?;
                mesh.read_elements(&mut stream, version)?;
                has_elements = true;
            }
            _ => {
                stream.skip_section(&name)?;
                continue;
            }
        }
        stream.end_section(&name)?;
    }
    let path = stream.path;
    if version.is_none() {
        let expected = "`$MeshFormat`, as a mesh of Gmsh begins";
        let advice = "save a mesh of Fluent as VTK XML (.vtu) with ParaView";
        return Err(Error::format(path, "sections", expected, "none", advice));
    }
    if mesh.is_some() && !has_elements {
        let expected = "a section `$Elements`";
        return Err(Error::format(path, "sections", expected, "none", DAMAGED));
    }
    Ok((stream, sections))
}

fn needs_version(stream: &Stream<'_>, version: Option<Version>) -> Result<Version> {
    version.ok_or_else(|| {
        let expected = "a section `$MeshFormat` before it";
        Error::format(
            stream.path,
            stream.section.clone(),
            expected,
            "none",
            DAMAGED,
        )
    })
}

/// Reads the version and the form of the numbers.
fn format(stream: &mut Stream<'_>) -> Result<Version> {
    let expected = "a version, a type of file (0 or 1) and the bytes of a count";
    let line = stream.header(expected)?;
    let words: Vec<&str> = line.split_whitespace().collect();
    let &[version, form, size] = words.as_slice() else {
        return Err(stream.fault(expected, &line));
    };
    let version = match version {
        "2" | "2.0" | "2.1" | "2.2" => Version::Two,
        "4" | "4.0" => Version::Four,
        "4.1" => Version::FourOne,
        other => {
            let found: String = other.chars().take(20).collect();
            let advice = "save it as version 4.1: `gmsh FILE -save -format msh41 -o out.msh`";
            let place = stream.section.clone();
            let expected = "version 2, 4.0 or 4.1";
            return Err(Error::format(stream.path, place, expected, found, advice));
        }
    };
    stream.size_bytes = match (size, version) {
        // Counts have eight bytes there whatever the header says.
        (_, Version::Four) => 8,
        ("4", _) => 4,
        ("8", _) => 8,
        _ => return Err(stream.fault("4 or 8 bytes of a count", size)),
    };
    match form {
        "0" => return Ok(version),
        "1" => {}
        _ => return Err(stream.fault("0 for text or 1 for binary numbers", form)),
    }
    let one = stream
        .rest()
        .first_chunk::<4>()
        .copied()
        .unwrap_or_default();
    stream.big_endian = match one {
        [1, 0, 0, 0] => false,
        [0, 0, 0, 1] => true,
        _ => return Err(stream.fault("the integer 1 in four bytes", &format!("{one:?}"))),
    };
    stream.at += 4;
    stream.is_text = false;
    Ok(version)
}

/// Notes on parts that are left out or reduced, and the names of groups.
fn mesh_notes(mesh: &Mesh) -> Vec<String> {
    let mut notes = Vec::new();
    if mesh.left_out > 0 {
        notes.push(format!(
            "Left out: {} elements of types that are not read (polygons, polyhedra and the like).",
            mesh.left_out
        ));
    }
    if mesh.cut > 0 {
        notes.push(format!(
            "Of {} elements of third order or above only the corners are taken.",
            mesh.cut
        ));
    }
    if mesh.again > 0 {
        notes.push(format!(
            "Left out: {} elements that are listed for a further physical group.",
            mesh.again
        ));
    }
    let most = mesh.names.iter().map(|(dimension, ..)| *dimension).max();
    let named = mesh
        .names
        .iter()
        .filter(|(dimension, ..)| Some(*dimension) == most);
    let named: Vec<String> = named
        .take(16)
        .map(|(_, number, name)| format!("{number} `{name}`"))
        .collect();
    if !named.is_empty() {
        notes.push(format!(
            "Physical groups in `gmsh:physical`: {}.",
            named.join(", ")
        ));
    }
    notes
}
