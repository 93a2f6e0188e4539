//! Reads legacy VTK files (`.vtk`), versions 1 to 5.
//!
//! ```text
//! # vtk DataFile Version 3.0
//! a title
//! ASCII                               or BINARY: big-endian
//! DATASET STRUCTURED_POINTS           or one of the table
//! DIMENSIONS 2 2 2                    its sections, in any order
//! ...
//! POINT_DATA 8                        see `attributes`
//! ...
//! CELL_DATA 1
//! ...
//! ```
//!
//! | data set | its sections | read as |
//! |---|---|---|
//! | `STRUCTURED_POINTS` | `DIMENSIONS`, `ORIGIN`, `SPACING` or `ASPECT_RATIO` | uniform lattice |
//! | `RECTILINEAR_GRID` | `DIMENSIONS`, `X_COORDINATES`, `Y_COORDINATES`, `Z_COORDINATES` | rectilinear lattice |
//! | `STRUCTURED_GRID` | `DIMENSIONS`, `POINTS` | curvilinear block |
//! | `UNSTRUCTURED_GRID` | `POINTS`, `CELLS`, `CELL_TYPES` | cells, a mesh, or particles |
//! | `POLYDATA` | `POINTS`, `VERTICES`, `LINES`, `POLYGONS`, `TRIANGLE_STRIPS` | a mesh, or particles |
//!
//! `EXTENT` (first and last node along each axis) may replace `DIMENSIONS`. Keywords are not case-sensitive. A
//! `FIELD` before the attributes belongs to the file as a whole and is left out, as is `METADATA` anywhere. In
//! binary files, the bytes of an array begin on the line after its heading; ids without a type have 32 bits.

mod attributes;
mod cells;
mod scan;

use std::path::Path;

use glam::DVec3;

use self::attributes::Samples;
use self::cells::CellList;
use self::scan::{Block, Scanner, quote};
use super::grid;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::error::{Advice, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::scene::{Lattice, LatticeSpacing};

/// The first bytes of every legacy VTK file.
pub(crate) const MAGIC: &[u8] = b"# vtk DataFile";

/// Reads a file of any kind.
///
/// # Errors
/// A kind of data without geometry; a section that is missing or cut short; counts that do not agree.
pub(crate) fn read(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    parse(path, &bytes, read_as)
}

fn parse(path: &Path, bytes: &[u8], read_as: Option<ReadAs>) -> Result<Dataset> {
    let scan = &mut Scanner::new(path, bytes);
    header(scan)?;
    scan.section = "DATASET".to_owned();
    // A file of fields alone has no DATASET.
    sections(scan, "DATASET", |_, keyword| {
        Ok(if keyword == "DATASET" {
            Section::Last
        } else {
            Section::Unknown
        })
    })?;
    let word = scan.word().ok_or_else(|| no_geometry(scan, "nothing"))?;
    match quote(word).to_ascii_uppercase().as_str() {
        "STRUCTURED_POINTS" => structured_points(scan),
        "RECTILINEAR_GRID" => rectilinear_grid(scan),
        "STRUCTURED_GRID" => structured_grid(scan),
        "UNSTRUCTURED_GRID" => unstructured_grid(scan, read_as),
        "POLYDATA" => polydata(scan, read_as),
        "FIELD" => Err(no_geometry(scan, "fields without a geometry")),
        _ => Err(no_geometry(scan, &format!("`{}`", quote(word)))),
    }
}

fn no_geometry(scan: &Scanner<'_>, found: &str) -> crate::Error {
    let expected = "DATASET and STRUCTURED_POINTS, RECTILINEAR_GRID, STRUCTURED_GRID, \
                    UNSTRUCTURED_GRID or POLYDATA";
    scan.error(expected, found, "save the grid or the points themselves")
}

/// Reads the first three lines.
fn header(scan: &mut Scanner<'_>) -> Result<()> {
    const NEWEST: u32 = 5;
    let line = String::from_utf8_lossy(scan.line()).into_owned();
    let version = line.split_ascii_whitespace().nth(4);
    let major = version.and_then(|v| v.split('.').next()?.parse::<u32>().ok());
    if major.is_none_or(|n| n > NEWEST) {
        return Err(scan.error(
            format!("`# vtk DataFile Version` and a version up to {NEWEST}"),
            format!("`{}`", quote(line.as_bytes())),
            "save the file in version 4.2, or as VTK XML",
        ));
    }
    let _title = scan.line();
    let encoding = scan.expect("ASCII or BINARY")?;
    scan.is_binary = match quote(encoding).to_ascii_uppercase().as_str() {
        "ASCII" => false,
        "BINARY" => true,
        other => return Err(scan.fault("ASCII or BINARY", format!("`{other}`"))),
    };
    Ok(())
}

/// Outcome of reading a section.
enum Section {
    Read,
    /// No more sections are to be read.
    Last,
    Unknown,
}

/// Passes the sections' keywords, in upper case, to `read` until attributes begin or the file ends.
fn sections(
    scan: &mut Scanner<'_>,
    known: &str,
    mut read: impl FnMut(&mut Scanner<'_>, &str) -> Result<Section>,
) -> Result<()> {
    loop {
        if scan.skip_metadata() {
            continue;
        }
        let Some(keyword) = scan.peek() else {
            return Ok(());
        };
        if matches!(keyword.as_str(), "POINT_DATA" | "CELL_DATA") {
            return Ok(());
        }
        scan.word();
        let before = std::mem::replace(&mut scan.section, keyword.clone());
        if keyword == "FIELD" {
            attributes::skip_field(scan)?;
            continue;
        }
        match read(scan, &keyword)? {
            Section::Read => {}
            Section::Last => return Ok(()),
            Section::Unknown => {
                scan.section = before;
                return Err(scan.fault(format!("{known} or FIELD"), format!("`{keyword}`")));
            }
        }
    }
}

/// The content of a section, or an error if it is missing.
fn require<T>(scan: &mut Scanner<'_>, section: Option<T>, name: &str) -> Result<T> {
    section.ok_or_else(|| {
        scan.section = "DATASET".to_owned();
        let found = scan.peek().map(|word| format!("`{word}`"));
        scan.word();
        let found = found.unwrap_or("the end of the file".to_owned());
        scan.cut_short(format!("a section {name}"), found)
    })
}

/// Number of nodes along each axis, and the indices of the first ones.
#[derive(Debug, Clone, Copy)]
struct Extent {
    first: [i64; 3],
    dims: [usize; 3],
}

impl Extent {
    /// Reads `DIMENSIONS` or `EXTENT`; `None` for other keywords.
    fn read(scan: &mut Scanner<'_>, keyword: &str) -> Result<Option<Self>> {
        let extent = match keyword {
            "DIMENSIONS" => Self {
                first: [0; 3],
                dims: scan.parse3("a number of nodes")?,
            },
            "EXTENT" => {
                const WHAT: &str = "the number of a node";
                let [a, b, c]: [i64; 3] = scan.parse3(WHAT)?;
                let [d, e, f]: [i64; 3] = scan.parse3(WHAT)?;
                let dims = [(a, b), (c, d), (e, f)].map(|(first, last)| {
                    let steps = last.checked_sub(first)?;
                    usize::try_from(steps.checked_add(1)?).ok()
                });
                Self {
                    first: [a, c, e],
                    // Overflow is refused as 0 is.
                    dims: dims.map(Option::unwrap_or_default),
                }
            }
            _ => return Ok(None),
        };
        if extent.node_count().is_none() {
            let expected = "at least one node along each axis, and a number that fits into memory";
            return Err(scan.fault(expected, format!("{:?}", extent.dims)));
        }
        Ok(Some(extent))
    }

    fn node_count(&self) -> Option<usize> {
        let [x, y, z] = self.dims;
        let count = x.checked_mul(y)?.checked_mul(z)?;
        Some(count).filter(|&n| n > 0)
    }

    fn samples(&self) -> Samples {
        Samples {
            nodes: self.node_count().unwrap_or(0),
            // VTK counts the cells of a flat grid as if it had a thickness.
            cells: self.dims.map(|n| (n - 1).max(1)).iter().product(),
            keeps_cells: self.dims.iter().all(|&n| n > 1),
        }
    }
}

/// The data set, with the attributes that follow.
fn with_attributes(
    scan: &mut Scanner<'_>,
    format: &'static str,
    geometry: Geometry,
    samples: Samples,
) -> Result<Dataset> {
    let (fields, notes) = attributes::read(scan, samples)?;
    if fields.is_empty() && matches!(geometry, Geometry::Lattice(_)) {
        return Err(scan.error(
            "at least one array of numbers",
            format!("none, for {} nodes", samples.nodes),
            Advice::no_data("save the grid with its data (a grid one node thick has no cells)"),
        ));
    }
    Ok(Dataset {
        notes,
        ..Dataset::new(scan.path(), format, geometry, fields)
    })
}

fn structured_points(scan: &mut Scanner<'_>) -> Result<Dataset> {
    let mut extent = None;
    let mut origin = DVec3::ZERO;
    let mut spacing = DVec3::ONE;
    sections(scan, "DIMENSIONS, ORIGIN, SPACING", |scan, keyword| {
        if let Some(found) = Extent::read(scan, keyword)? {
            extent = Some(found);
            return Ok(Section::Read);
        }
        match keyword {
            "ORIGIN" => origin = DVec3::from_array(scan.parse3("a coordinate")?),
            "SPACING" | "ASPECT_RATIO" => {
                spacing = DVec3::from_array(scan.parse3("a distance")?);
            }
            _ => return Ok(Section::Unknown),
        }
        Ok(Section::Read)
    })?;
    let extent: Extent = require(scan, extent, "DIMENSIONS")?;
    for axis in 0..3 {
        // There is no other node at this distance.
        if extent.dims[axis] == 1 && spacing[axis] == 0.0 {
            spacing[axis] = 1.0;
        }
    }
    origin += spacing * DVec3::from_array(extent.first.map(|n| n as f64));
    let volume = spacing.element_product();
    if !origin.is_finite() || !volume.is_finite() || volume == 0.0 {
        scan.section = "ORIGIN and SPACING".to_owned();
        return Err(scan.fault(
            "finite numbers whose cells have a volume",
            format!("origin {origin}, spacing {spacing}"),
        ));
    }
    let lattice = Lattice::uniform(extent.dims, origin, spacing);
    let geometry = Geometry::Lattice(lattice);
    with_attributes(
        scan,
        "legacy VTK structured points",
        geometry,
        extent.samples(),
    )
}

fn rectilinear_grid(scan: &mut Scanner<'_>) -> Result<Dataset> {
    const AXES: [&str; 3] = ["X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"];
    let mut extent = None;
    let mut coordinates = [const { None }; 3];
    let known = "DIMENSIONS, X_COORDINATES, Y_COORDINATES, Z_COORDINATES";
    sections(scan, known, |scan, keyword| {
        if let Some(found) = Extent::read(scan, keyword)? {
            extent = Some(found);
        } else if let Some(axis) = AXES.iter().position(|&name| name == keyword) {
            coordinates[axis] = Some(axis_coordinates(scan)?);
        } else {
            return Ok(Section::Unknown);
        }
        Ok(Section::Read)
    })?;
    let extent: Extent = require(scan, extent, "DIMENSIONS")?;
    let [x, y, z] = coordinates;
    let coordinates = [
        require(scan, x, AXES[0])?,
        require(scan, y, AXES[1])?,
        require(scan, z, AXES[2])?,
    ];
    let counts = coordinates.each_ref().map(Vec::len);
    if counts != extent.dims {
        scan.section = "DIMENSIONS".to_owned();
        return Err(scan.fault(
            format!("{counts:?}, as there are coordinates"),
            format!("{:?}", extent.dims),
        ));
    }
    let lattice = Lattice {
        dims: extent.dims,
        spacing: LatticeSpacing::Rectilinear { coordinates },
    };
    let geometry = Geometry::Lattice(lattice);
    with_attributes(
        scan,
        "legacy VTK rectilinear grid",
        geometry,
        extent.samples(),
    )
}

/// Reads coordinates along one axis, from the word after the keyword on.
fn axis_coordinates(scan: &mut Scanner<'_>) -> Result<Vec<f64>> {
    let count = scan.count("a number of coordinates")?;
    let block = numbers(scan, count)?;
    let coordinates = block.doubles().unwrap_or_default();
    let finite = coordinates.iter().all(|x| x.is_finite());
    if !finite || !coordinates.windows(2).all(|w| w[0] < w[1]) {
        let wrong = coordinates.windows(2).find(|w| !(w[0] < w[1]));
        let found = wrong.map_or("others".to_owned(), |w| format!("{} after {}", w[1], w[0]));
        return Err(scan.error(
            "coordinates that are finite and rise",
            found,
            "turn the axis round, and its data with it",
        ));
    }
    Ok(coordinates)
}

/// Reads a type and `count` numbers of that type.
fn numbers<'a>(scan: &mut Scanner<'a>, count: usize) -> Result<Block<'a>> {
    let data_type = scan.data_type()?;
    scan.array(data_type, count)
}

/// Reads `POINTS`, from the word after it on.
fn points(scan: &mut Scanner<'_>) -> Result<Vec<DVec3>> {
    let count = scan.count("a number of points")?;
    let coordinate_count = count.checked_mul(3);
    let coordinate_count = coordinate_count
        .ok_or_else(|| scan.cut_short("points that fit into memory", format!("{count}")))?;
    let block = numbers(scan, coordinate_count)?;
    Ok(block.positions().unwrap_or_default())
}

fn structured_grid(scan: &mut Scanner<'_>) -> Result<Dataset> {
    let mut extent = None;
    let mut nodes = None;
    sections(scan, "DIMENSIONS, POINTS", |scan, keyword| {
        if let Some(found) = Extent::read(scan, keyword)? {
            extent = Some(found);
            return Ok(Section::Read);
        }
        match keyword {
            "POINTS" => nodes = Some(points(scan)?),
            // The hidden nodes: ignored, as in VTK.
            "BLANKING" => {
                let count = scan.count("a number of points")?;
                numbers(scan, count)?;
            }
            _ => return Ok(Section::Unknown),
        }
        Ok(Section::Read)
    })?;
    let extent: Extent = require(scan, extent, "DIMENSIONS")?;
    let nodes = require(scan, nodes, "POINTS")?;
    if extent.node_count() != Some(nodes.len()) {
        scan.section = "DIMENSIONS".to_owned();
        return Err(scan.fault(
            format!("a product of {}, as there are points", nodes.len()),
            format!("{:?}", extent.dims),
        ));
    }
    let block = CurvilinearBlock {
        dims: extent.dims,
        nodes,
    };
    let geometry = Geometry::Curvilinear {
        blocks: vec![block],
    };
    with_attributes(
        scan,
        "legacy VTK structured grid",
        geometry,
        extent.samples(),
    )
}

fn unstructured_grid(scan: &mut Scanner<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let mut nodes = None;
    let mut list = None;
    let mut kinds = None;
    sections(scan, "POINTS, CELLS, CELL_TYPES", |scan, keyword| {
        match keyword {
            "POINTS" => nodes = Some(points(scan)?),
            "CELLS" => list = Some(CellList::read(scan)?),
            "CELL_TYPES" => kinds = Some(cells::kinds(scan)?),
            _ => return Ok(Section::Unknown),
        }
        Ok(Section::Read)
    })?;
    let nodes = require(scan, nodes, "POINTS")?;
    let (list, kinds) = match (list, kinds) {
        // VTK writes neither if there are no cells.
        (None, None) => (CellList::default(), Vec::new()),
        (list, kinds) => (
            require(scan, list, "CELLS")?,
            require(scan, kinds, "CELL_TYPES")?,
        ),
    };
    if list.len() != kinds.len() {
        scan.section = "CELL_TYPES".to_owned();
        return Err(scan.fault(
            format!("{} kinds, one for each cell", list.len()),
            format!("{}", kinds.len()),
        ));
    }
    let mesh = CellMesh {
        nodes,
        kinds,
        offsets: list.offsets,
        connectivity: list.connectivity,
    };
    cell_dataset(scan, "legacy VTK unstructured grid", mesh, read_as)
}

fn polydata(scan: &mut Scanner<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    /// In the order in which cell data are numbered, wherever the lists are.
    const LISTS: [&str; 4] = ["VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"];
    let mut nodes = None;
    let mut lists = [const { None }; 4];
    let known = "POINTS, VERTICES, LINES, POLYGONS, TRIANGLE_STRIPS";
    sections(scan, known, |scan, keyword| {
        if keyword == "POINTS" {
            nodes = Some(points(scan)?);
        } else if let Some(i) = LISTS.iter().position(|&name| name == keyword) {
            lists[i] = Some(CellList::read(scan)?);
        } else {
            return Ok(Section::Unknown);
        }
        Ok(Section::Read)
    })?;
    let nodes = require(scan, nodes, "POINTS")?;
    let mut all = CellList::default();
    let mut kinds = Vec::new();
    for (name, list) in LISTS.iter().zip(lists) {
        let Some(list) = list else { continue };
        kinds.extend(list.sizes().map(|size| match (*name, size) {
            ("VERTICES", 1) => CellKind::VERTEX,
            ("VERTICES", _) => CellKind::POLY_VERTEX,
            ("LINES", 2) => CellKind::LINE,
            ("LINES", _) => CellKind::POLY_LINE,
            ("POLYGONS", 3) => CellKind::TRIANGLE,
            ("POLYGONS", 4) => CellKind::QUAD,
            ("POLYGONS", _) => CellKind::POLYGON,
            _ => CellKind::TRIANGLE_STRIP,
        }));
        if all.len() == 0 {
            all = list;
        } else {
            all.append(&list, scan)?;
        }
    }
    let mesh = CellMesh {
        nodes,
        kinds,
        offsets: all.offsets,
        connectivity: all.connectivity,
    };
    cell_dataset(scan, "legacy VTK polygonal data", mesh, read_as)
}

/// Cells, a mesh or particles, with the attributes that follow.
fn cell_dataset(
    scan: &mut Scanner<'_>,
    format: &'static str,
    mesh: CellMesh,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let samples = Samples {
        nodes: mesh.nodes.len(),
        cells: mesh.cell_count(),
        keeps_cells: true,
    };
    let (fields, notes) = attributes::read(scan, samples)?;
    let mut data = grid::dataset(scan.path(), format, mesh, fields, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}
