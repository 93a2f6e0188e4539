//! Reads plotfiles of BoxLib and AMReX: a folder of levels of refinement, by AMReX's documentation ("IO:
//! Plotfile") and the sources that write them.
//!
//! | file | content |
//! |---|---|
//! | `Header` | text: the version, names of fields, dimensions, time, the domain, and for each level its spacing and the path of its boxes |
//! | `Level_0/Cell_H` | text: the boxes of the level in indices, and the file and the offset of the numbers of each |
//! | `Level_0/Cell_D_00000` | for each box a line with the form of its numbers, and the numbers |
//!
//! The folder or its `Header` is opened. Numbers are those of cells. Cells covered by finer ones, and a box's
//! ghost cells, are left out (see [`super::amr`]).

mod fab;
mod text;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use self::text::{Box3, Tokens};
use super::amr::{self, Level, Patch};
use crate::data::dataset::Dataset;
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::grid::plotfile::text::fault;
use crate::io::volume::voxels;
use crate::io::vtk;

/// The name of the file that describes the folder.
pub(in crate::io) const HEADER: &str = "Header";

/// First bytes of headers.
const VERSIONS: [&[u8]; 3] = [b"HyperCLaw-V", b"NavierStokes-V", b"CartGrid-V"];

/// Greatest numbers of levels and fields; far more than anything writes.
const MOST_LEVELS: usize = 64;
const MOST_FIELDS: usize = 1 << 16;

/// Whether a file that begins with `head` is the header of a plotfile.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    VERSIONS.iter().any(|version| head.starts_with(version))
}

/// The parsed `Header`.
struct Header {
    names: Vec<String>,
    time: f64,
    /// 2 or 3.
    dimensions: usize,
    levels: Vec<HeaderLevel>,
}

struct HeaderLevel {
    lattice: Level,
    /// Prefix of its files' names, relative to the folder.
    prefix: String,
}

/// Reads a plotfile by its header.
///
/// # Errors
/// A damaged header; files that are missing or too short; numbers in unsupported forms.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let header = header(path, &bytes)?;
    let (mut levels, mut patches) = (Vec::new(), Vec::new());
    for (level, of_level) in header.levels.iter().enumerate() {
        levels.push(of_level.lattice);
        read_level(input, &header, level, &mut patches)?;
    }
    let mut data = amr::dataset(path, "AMReX plotfile", levels, patches)?;
    data.notes.push(format!("Time: {}.", header.time));
    Ok(data)
}

fn header(path: &Path, bytes: &[u8]) -> Result<Header> {
    let mut tokens = Tokens::new(path, bytes)?;
    tokens.line();
    let name_count: usize = tokens.number("the number of fields")?;
    if name_count == 0 || name_count > MOST_FIELDS {
        let expected = format!("1 to {MOST_FIELDS} fields");
        return Err(tokens.fault("fields", &expected, name_count.to_string()));
    }
    tokens.line();
    let names = (0..name_count).map(|_| tokens.line().trim().to_owned());
    let names: Vec<String> = names.collect();
    let dimensions: usize = tokens.number("dimensions")?;
    if !matches!(dimensions, 2 | 3) {
        let found = dimensions.to_string();
        return Err(tokens.fault("dimensions", "2 or 3", found));
    }
    let time = tokens.number("time")?;
    let finest: usize = tokens.number("the finest level")?;
    if finest >= MOST_LEVELS {
        let expected = format!("a level below {MOST_LEVELS}");
        return Err(tokens.fault("the finest level", &expected, finest.to_string()));
    }
    let lower = vector(&mut tokens, dimensions, "the lower end of the domain")?;
    vector(&mut tokens, dimensions, "the upper end of the domain")?;
    // Ratios of refinement, of any number: the spacings give the same.
    tokens.line();
    tokens.line();
    let domains: Result<Vec<Box3>> = (0..=finest).map(|_| tokens.box3(dimensions)).collect();
    let domains = domains?;
    // Steps of each level.
    tokens.line();
    tokens.line();
    let mut spacings = Vec::new();
    for _ in 0..=finest {
        spacings.push(vector(&mut tokens, dimensions, "a spacing")?);
    }
    let coordinates: i64 = tokens.number("the kind of coordinates")?;
    if coordinates != 0 {
        let expected = "Cartesian coordinates (0)";
        return Err(tokens.fault("the kind of coordinates", expected, coordinates.to_string()));
    }
    tokens.number::<i64>("the width of the boundary")?;
    let mut levels = Vec::new();
    for (domain, spacing) in domains.iter().zip(spacings) {
        tokens.number::<usize>("the level")?;
        let box_count: usize = tokens.number("the number of boxes")?;
        tokens.number::<f64>("the time of the level")?;
        tokens.number::<i64>("the steps of the level")?;
        for _ in 0..box_count {
            for _ in 0..2 * dimensions {
                tokens.number::<f64>("where a box is")?;
            }
        }
        let prefix = tokens.word("the names of the level's files")?.to_owned();
        let first = DVec3::from(domain.first.map(|n| n as f64));
        let origin = lower - spacing * first;
        let lattice = Level { origin, spacing };
        levels.push(HeaderLevel { lattice, prefix });
    }
    Ok(Header {
        names,
        time,
        dimensions,
        levels,
    })
}

/// As many numbers as there are dimensions; 0 for the others.
fn vector(tokens: &mut Tokens<'_>, dimensions: usize, place: &str) -> Result<DVec3> {
    let mut vector = [0.0; 3];
    for x in &mut vector[..dimensions] {
        *x = tokens.number(place)?;
    }
    Ok(DVec3::from(vector))
}

/// Reads the boxes of a level.
fn read_level(
    input: Input<'_>,
    header: &Header,
    level: usize,
    patches: &mut Vec<Patch>,
) -> Result<()> {
    let prefix = &header.levels[level].prefix;
    let list = voxels::beside_as(
        input.path,
        "the names of a level's files",
        &format!("{prefix}_H"),
    )?;
    let bytes = input.read_beside(&list)?;
    let mut tokens = Tokens::new(&list, &bytes)?;
    tokens.number::<i64>("version")?;
    tokens.number::<i64>("how the numbers are distributed")?;
    let component_count: usize = tokens.number("components")?;
    if component_count < header.names.len() {
        let expected = format!("{} components", header.names.len());
        return Err(tokens.fault("components", &expected, component_count.to_string()));
    }
    // One number, or one for each dimension.
    tokens.skip_ghosts();
    let boxes = tokens.boxes(header.dimensions)?;
    let count: usize = tokens.number("the number of blocks of numbers")?;
    if count != boxes.len() {
        let expected = format!("one for each of {} boxes", boxes.len());
        return Err(tokens.fault("blocks of numbers", &expected, count.to_string()));
    }
    let mut named: Vec<(String, u64)> = Vec::new();
    for _ in 0..count {
        tokens.expect("FabOnDisk:")?;
        let name = tokens.word("the file of a block of numbers")?.to_owned();
        named.push((name, tokens.number("where a block of numbers begins")?));
    }
    // The numbers of a file are read once, however many boxes it has.
    let mut of_file: HashMap<&str, Vec<usize>> = HashMap::new();
    for (i, (name, _)) in named.iter().enumerate() {
        of_file.entry(name).or_default().push(i);
    }
    let mut names: Vec<&str> = of_file.keys().copied().collect();
    names.sort_unstable();
    let mut found: Vec<Option<Patch>> = boxes.iter().map(|_| None).collect();
    for name in names {
        let file: PathBuf = voxels::beside_as(&list, "FabOnDisk", name)?;
        let bytes = input.read_beside(&file)?;
        // Overlapping blocks would multiply a file's bytes.
        let mut left = bytes.len();
        for &i in &of_file[name] {
            let block = fab::Block {
                path: &file,
                bytes: &bytes,
                start: named[i].1,
                dimensions: header.dimensions,
            };
            let components = block.read(&boxes[i], header.names.len(), &mut left)?;
            let arrays = header.names.iter().zip(components);
            let cell_arrays = arrays.map(|(name, values)| vtk::array::Array {
                name: name.clone(),
                components: vec![values],
            });
            found[i] = Some(Patch {
                level,
                first: boxes[i].first,
                cells: boxes[i].cells(header.dimensions),
                node_arrays: Vec::new(),
                cell_arrays: cell_arrays.collect(),
            });
        }
    }
    patches.extend(found.into_iter().flatten());
    Ok(())
}
