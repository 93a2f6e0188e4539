//! Reads Tecplot's text files ("Tecplot 360 Data Format Guide", ASCII data).
//!
//! ```text
//! TITLE = "any"
//! VARIABLES = "X" "Y" "Z" "p"
//! ZONE T="a", I=2, J=2, K=2, DATAPACKING=POINT           one node after another, i fastest
//! 0 0 0 1.5 ...
//! ZONE N=4, E=1, ZONETYPE=FETETRAHEDRON, DATAPACKING=BLOCK, VARLOCATION=([4]=CELLCENTERED), SOLUTIONTIME=0.5
//! ...                                                    one variable after another, then the nodes of each element
//! 1 2 3 4
//! ```
//!
//! Older headers have `F=FEPOINT, ET=BRICK`. A number may be repeated (`5*0.25`), and a zone may share
//! variables or elements with an earlier one (`VARSHARELIST`, `CONNECTIVITYSHAREZONE`). Zones of one
//! `SOLUTIONTIME` are a time step, together with those without a time.
//!
//! If all zones are ordered and have more than one node along each axis, they are curvilinear grids. Otherwise
//! they are cells: zones of one layer are quadrilaterals, and single lines of nodes are points. Bricks with
//! coinciding nodes are wedges, pyramids and tetrahedra, as in the guide. Text, geometry and named lists of
//! labels are left out.

mod scan;
mod zone;

use std::borrow::Cow;
use std::path::Path;

use glam::DVec3;

use self::scan::{Scanner, Token};
use self::zone::{File, Shape, Zone};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::io::particles::table::list;
use crate::io::time_steps::{TimeStep, chosen, of_file};
use crate::io::vtk;

const FORMAT: &str = "Tecplot text";

/// Number of numbers that zones may share beyond one for each byte of the file.
const LEAST_NUMBERS: usize = 1 << 20;

/// Whether text that begins with `head` is Tecplot's: its first record is one that no other format begins with.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut scanner = Scanner::new(Path::new(""), &text);
    match scanner.next() {
        Some(Token::Word(word)) if word.eq_ignore_ascii_case("ZONE") => scanner.is_key(),
        Some(Token::Word(word)) => zone::is_start(word) && scanner.peek() == Some(Token::Equals),
        _ => false,
    }
}

/// The time steps, or one without a time.
///
/// # Errors
/// A file that breaks the format's rules.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let bytes = input.read_all()?;
    let times = times(&zone::read(input.path, &text(&bytes))?);
    Ok(of_file(input.path, &times))
}

fn text(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(bytes)
}

fn times(file: &File) -> Vec<f64> {
    let mut times: Vec<f64> = file.zones.iter().filter_map(|zone| zone.time).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
}

/// Reads the zones of a step.
///
/// # Errors
/// As [`steps`]; a step that does not exist.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let mut file = zone::read(path, &text(&bytes))?;
    let mut notes = Vec::new();
    if file.has_others {
        notes.push("Text and geometry are left out.".to_owned());
    }
    let times = times(&file);
    if !times.is_empty() {
        let (step, note) = chosen(path, &times, time_step)?;
        notes.extend(note);
        let time = times[step];
        file.zones
            .retain(|zone| zone.time.is_none_or(|t| t == time));
    }
    let axes = axes(&file, &mut notes);
    for (i, zone) in file.zones.iter().enumerate() {
        let missing = axes.iter().flatten().find(|&&axis| !zone.is_at_nodes(axis));
        if let Some(&axis) = missing {
            return Err(Error::format(
                path,
                format!("zone {}", i + 1),
                "coordinates at its nodes",
                format!("none of `{}`", file.variables[axis]),
                "give each zone its coordinates",
            ));
        }
    }
    let numbers = |zone: &Zone| {
        let count = |values: &Option<std::rc::Rc<Vec<f64>>>| values.as_ref().map_or(0, |v| v.len());
        zone.values.iter().map(count).sum::<usize>() + zone.elements.len()
    };
    let total: usize = file.zones.iter().map(numbers).sum();
    if total > LEAST_NUMBERS + bytes.len() {
        return Err(Error::format(
            path,
            "zones",
            "about as many numbers as the file has bytes",
            format!("{total}, of which zones share most"),
            "save the zones in several files",
        ));
    }
    let is_block =
        |zone: &Zone| matches!(zone.shape, Shape::Ordered(dims) if dims.iter().all(|&n| n > 1));
    let fields = fields(&file, &axes, &mut notes);
    let mut data = if file.zones.iter().all(is_block) {
        let block = |zone: &Zone| CurvilinearBlock {
            dims: match zone.shape {
                Shape::Ordered(dims) => dims,
                Shape::Elements { .. } => [0; 3],
            },
            nodes: zone.nodes(&axes),
        };
        let blocks = file.zones.iter().map(block).collect();
        Dataset::new(path, FORMAT, Geometry::Curvilinear { blocks }, fields)
    } else {
        let mut mesh = CellMesh {
            offsets: vec![0],
            ..CellMesh::default()
        };
        for zone in &file.zones {
            zone.append_to(&axes, &mut mesh);
        }
        if u32::try_from(mesh.connectivity.len().max(mesh.nodes.len())).is_err() {
            let expected = format!("at most {} entries of cells", u32::MAX);
            let advice = "save the zones in several files";
            return Err(Error::format(path, "zones", expected, "more", advice));
        }
        vtk::grid::dataset(path, FORMAT, mesh, fields, read_as)?
    };
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// The variables that are x, y and z; there may be no z.
fn axes(file: &File, notes: &mut Vec<String>) -> [Option<usize>; 3] {
    let named = |axis: &str| {
        let is_it = |name: &String| {
            let bare = crate::data::unit::divided(name).map_or(name.as_str(), |(bare, _)| bare);
            let bare = bare.split_once('(').map_or(bare, |(bare, _)| bare).trim();
            let long = format!("Coordinate{axis}");
            bare.eq_ignore_ascii_case(axis) || bare.eq_ignore_ascii_case(&long)
        };
        file.variables.iter().position(is_it)
    };
    let found = ["x", "y", "z"].map(named);
    if found[0].is_some() && found[1].is_some() {
        return found;
    }
    // Tecplot's own default.
    let needs_z = file.zones.iter().any(|zone| match zone.shape {
        Shape::Ordered(dims) => dims[2] > 1,
        Shape::Elements { kind, .. } => kind.is_solid(),
    });
    let wanted = if needs_z { 3 } else { 2 };
    let first = |axis: usize| (axis < wanted && axis < file.variables.len()).then_some(axis);
    let taken = [0, 1, 2].map(first);
    let names = list(taken.iter().flatten().map(|&v| file.variables[v].as_str()));
    notes.push(format!(
        "No variables are named x and y: {names} are taken as the coordinates."
    ));
    taken
}

/// The variables that all zones have, at nodes or at cells.
fn fields(file: &File, axes: &[Option<usize>; 3], notes: &mut Vec<String>) -> Vec<Field> {
    let (mut fields, mut left_out) = (Vec::new(), Vec::new());
    for (variable, name) in file.variables.iter().enumerate() {
        if axes.contains(&Some(variable)) {
            continue;
        }
        let at_cells = file
            .zones
            .first()
            .is_some_and(|zone| zone.at_cells[variable]);
        let mut all: Vec<f64> = Vec::new();
        let is_whole = file.zones.iter().all(|zone| {
            let values = zone.values[variable].as_ref();
            // A line of nodes is read as points, which have no cells.
            let has_place = zone.at_cells[variable] == at_cells && !(at_cells && zone.is_line());
            let values = values.filter(|_| has_place);
            all.extend(values.into_iter().flat_map(|v| v.iter().copied()));
            values.is_some()
        });
        if !is_whole {
            left_out.push(name.as_str());
            continue;
        }
        fields.push(Field {
            name: name.clone(),
            association: match at_cells {
                true => Association::Cells,
                false => Association::Nodes,
            },
            source: FieldSource::Scalar(all.into()),
            unit: None,
        });
    }
    if !left_out.is_empty() {
        let names = list(left_out.into_iter());
        notes.push(format!(
            "Left out, because not all zones have them at the same places: {names}."
        ));
    }
    fields
}

impl Zone {
    fn is_line(&self) -> bool {
        matches!(self.shape, Shape::Ordered(dims) if dims.iter().filter(|&&n| n > 1).count() < 2)
    }

    fn is_at_nodes(&self, variable: usize) -> bool {
        self.values[variable].is_some() && !self.at_cells[variable]
    }

    fn nodes(&self, axes: &[Option<usize>; 3]) -> Vec<DVec3> {
        let values = axes.map(|axis| self.values[axis?].as_deref());
        let count = values[0].map_or(0, Vec::len);
        let node = |i: usize| DVec3::from(values.map(|v| v.map_or(0.0, |v| v[i])));
        (0..count).map(node).collect()
    }

    /// Appends nodes and cells to those of other zones.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the caller checks the number of all nodes"
    )]
    fn append_to(&self, axes: &[Option<usize>; 3], mesh: &mut CellMesh) {
        let first = mesh.nodes.len() as u32;
        mesh.nodes.extend(self.nodes(axes));
        let mut add = |kind: CellKind, nodes: &[u32]| {
            mesh.kinds.push(kind);
            mesh.connectivity.extend(nodes.iter().map(|n| first + n));
            mesh.offsets.push(mesh.connectivity.len() as u32);
        };
        let dims = match self.shape {
            Shape::Elements { kind, corners, .. } => {
                for element in self.elements.chunks_exact(corners) {
                    let (kind, nodes) = reduced(kind, element);
                    add(kind, &nodes);
                }
                return;
            }
            Shape::Ordered(dims) => dims,
        };
        let steps = [1, dims[0], dims[0] * dims[1]].map(|n| n as u32);
        let axes: Vec<usize> = (0..3).filter(|&axis| dims[axis] > 1).collect();
        let cells = dims.map(|n| n.saturating_sub(1).max(1) as u32);
        if self.is_line() {
            let count = dims.iter().product::<usize>() as u32;
            (0..count).for_each(|node| add(CellKind::VERTEX, &[node]));
            return;
        }
        let (a, b) = (steps[axes[0]], steps[axes[1]]);
        for k in 0..cells[2] {
            for j in 0..cells[1] {
                for i in 0..cells[0] {
                    let at = i + j * steps[1] + k * steps[2];
                    let quad = [at, at + a, at + a + b, at + b];
                    match axes.get(2) {
                        None => add(CellKind::QUAD, &quad),
                        Some(_) => {
                            let above = quad.map(|n| n + steps[2]);
                            add(CellKind::HEXAHEDRON, &[quad, above].concat());
                        }
                    }
                }
            }
        }
    }
}

/// Converts an element with coinciding nodes to the kind with fewer corners, in VTK's order.
fn reduced(kind: CellKind, nodes: &[u32]) -> (CellKind, Cow<'_, [u32]>) {
    let of = |kind: CellKind, corners: &[usize]| {
        let nodes: Vec<u32> = corners.iter().map(|&c| nodes[c]).collect();
        (kind, Cow::Owned(nodes))
    };
    match (kind, nodes) {
        (CellKind::QUAD, [_, _, c, d]) if c == d => of(CellKind::TRIANGLE, &[0, 1, 2]),
        (CellKind::HEXAHEDRON, [_, _, c, d, e, f, g, h]) => {
            let (is_triangle, is_point) = (c == d, e == f && f == g && g == h);
            match (is_triangle, is_point) {
                (true, true) => of(CellKind::TETRA, &[0, 1, 2, 4]),
                (false, true) => of(CellKind::PYRAMID, &[0, 1, 2, 3, 4]),
                // VTK orders the first triangle of a wedge the other way round.
                (true, false) if g == h => of(CellKind::WEDGE, &[0, 2, 1, 4, 6, 5]),
                _ => (kind, Cow::Borrowed(nodes)),
            }
        }
        _ => (kind, Cow::Borrowed(nodes)),
    }
}
