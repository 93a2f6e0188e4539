//! Reads the geometry: parts that are structured blocks, or elements over their own nodes.
//!
//! ```text
//! two lines of text
//! node id off|given|assign|ignore           numbers of nodes follow where `given` or `ignore`
//! element id ...
//! extents  xmin xmax ymin ymax zmin zmax    perhaps
//! part  its number  a line of text
//! coordinates  n [numbers]  all x, all y, all z
//! hexa8  m [numbers]  nodes of each, from 1 ...
//! part ...
//! block [rectilinear|uniform] [iblanked]  i j k  coordinates  [iblank]
//! ```

use glam::DVec3;

use super::stream::Stream;
use crate::data::cells::CellKind;
use crate::error::Result;

/// One part of the geometry.
pub(super) struct Part {
    pub(super) number: i32,
    pub(super) shape: Shape,
}

/// Contents of a part.
pub(super) enum Shape {
    Elements {
        nodes: Vec<DVec3>,
        blocks: Vec<Elements>,
    },
    Block(Block),
}

/// Elements of one type.
pub(super) struct Elements {
    /// Name of the type in the file.
    pub(super) name: String,
    pub(super) count: usize,
    /// Cells of the elements; `None` if they copy those of another part or their type is not read.
    pub(super) cells: Option<Cells>,
}

/// Cells over the nodes of their part, counted from 0.
pub(super) struct Cells {
    pub(super) kind: CellKind,
    /// Nodes of one cell after another; for polyhedra the faces as in [`crate::io::CellMesh`].
    pub(super) connectivity: Vec<u32>,
    /// End of each cell in `connectivity`.
    pub(super) ends: Vec<usize>,
}

/// Structured block.
pub(super) struct Block {
    pub(super) dims: [usize; 3],
    pub(super) places: Places,
    /// Blanking of nodes; 0 means blanked.
    pub(super) iblank: Option<Vec<i32>>,
}

pub(super) enum Places {
    Nodes(Vec<DVec3>),
    Axes([Vec<f64>; 3]),
    Uniform { origin: DVec3, step: DVec3 },
}

impl Part {
    pub(super) fn node_count(&self) -> usize {
        match &self.shape {
            Shape::Elements { nodes, .. } => nodes.len(),
            Shape::Block(block) => block.dims.iter().product(),
        }
    }
}

impl Block {
    /// Returns the number of cells along i, j and k; an axis with one node has one layer of cells.
    pub(super) fn cell_dims(&self) -> [usize; 3] {
        self.dims.map(|n| n.saturating_sub(1).max(1))
    }

    /// Returns the positions of all nodes.
    pub(super) fn nodes(&self) -> Vec<DVec3> {
        let [x, y, z] = self.dims;
        let places = (0..x * y * z).map(|i| [i % x, i / x % y, i / (x * y)]);
        match &self.places {
            Places::Nodes(nodes) => nodes.clone(),
            Places::Axes([a, b, c]) => places
                .map(|[i, j, k]| DVec3::new(a[i], b[j], c[k]))
                .collect(),
            Places::Uniform { origin, step } => places
                .map(|at| *origin + *step * DVec3::from(at.map(|n| n as f64)))
                .collect(),
        }
    }
}

/// Returns the kind and node count of an element type; `None` if the type has no fixed count or is not known.
fn type_of(name: &str) -> Option<(CellKind, usize)> {
    let (kind, nodes) = match name {
        "point" => (1, 1),
        "bar2" => (3, 2),
        "bar3" => (21, 3),
        "tria3" => (5, 3),
        "tria6" => (22, 6),
        "quad4" => (9, 4),
        "quad8" => (23, 8),
        "tetra4" => (10, 4),
        "tetra10" => (24, 10),
        "pyramid5" => (14, 5),
        "pyramid13" => (27, 13),
        "penta6" => (13, 6),
        "penta15" => (26, 15),
        "hexa8" => (12, 8),
        "hexa20" => (25, 20),
        _ => return None,
    };
    Some((CellKind(kind), nodes))
}

/// Reads all parts.
///
/// # Errors
/// A keyword is not known, or the file ends before its numbers.
pub(super) fn read(stream: &mut Stream<'_>) -> Result<Vec<Part>> {
    let first = stream.line()?.to_ascii_lowercase();
    if first.starts_with("c binary") || first.starts_with("fortran binary") {
        stream.line()?;
    }
    stream.line()?;
    let [has_node_numbers, has_element_numbers] = [has_numbers(stream)?, has_numbers(stream)?];
    if stream
        .peek()
        .is_some_and(|line| line.starts_with("extents"))
    {
        stream.line()?;
        stream.reals(6)?;
    }
    let mut parts = Vec::new();
    while let Some(keyword) = stream.keyword() {
        if !keyword.starts_with("part") {
            return Err(unknown(stream, "`part`", &keyword));
        }
        let number = stream.integer()?;
        stream.line()?;
        let Some(keyword) = stream.keyword() else {
            break;
        };
        let shape = if keyword.starts_with("coordinates") {
            elements(stream, has_node_numbers, has_element_numbers)?
        } else if keyword.starts_with("block") {
            Shape::Block(block(
                stream,
                &keyword,
                has_node_numbers,
                has_element_numbers,
            )?)
        } else {
            return Err(unknown(stream, "`coordinates` or `block`", &keyword));
        };
        parts.push(Part { number, shape });
    }
    Ok(parts)
}

fn unknown(stream: &Stream<'_>, expected: &str, found: &str) -> crate::Error {
    let found: String = found.chars().take(40).collect();
    stream.fault(expected, format!("`{found}`"))
}

/// Returns true if `node id` or `element id` states that numbers follow.
fn has_numbers(stream: &mut Stream<'_>) -> Result<bool> {
    let line = stream.keyword().unwrap_or_default().to_ascii_lowercase();
    match line.split_ascii_whitespace().last() {
        Some("given" | "ignore") => Ok(true),
        Some("off" | "assign") => Ok(false),
        _ => Err(unknown(
            stream,
            "`node id` and `element id`: off, given, assign or ignore",
            &line,
        )),
    }
}

fn positions(stream: &mut Stream<'_>, count: usize) -> Result<Vec<DVec3>> {
    let x = stream.reals(count)?;
    let y = stream.reals(count)?;
    let z = stream.reals(count)?;
    let axes = x.iter().zip(&y).zip(&z);
    Ok(axes
        .map(|((&x, &y), &z)| DVec3::new(f64::from(x), f64::from(y), f64::from(z)))
        .collect())
}

fn elements(stream: &mut Stream<'_>, node_numbers: bool, element_numbers: bool) -> Result<Shape> {
    let count = stream.count()?;
    if node_numbers {
        stream.integers(count)?;
    }
    let nodes = positions(stream, count)?;
    let mut blocks = Vec::new();
    while let Some(line) = stream.peek().filter(|line| !line.starts_with("part")) {
        stream.keyword();
        let is_ghost = line.starts_with("g_");
        let name = line.split_ascii_whitespace().next().unwrap_or_default();
        let count = stream.count()?;
        if element_numbers {
            stream.integers(count)?;
        }
        let bare = name.trim_start_matches("g_");
        let cells = match bare {
            "nsided" => polygons(stream, count, nodes.len())?,
            "nfaced" => polyhedra(stream, count, nodes.len())?,
            _ => {
                let Some((kind, size)) = type_of(bare) else {
                    return Err(unknown(stream, "a type of elements of EnSight Gold", &line));
                };
                let total = count.saturating_mul(size);
                let connectivity = node_numbers_of(stream, total, nodes.len())?;
                Cells {
                    kind,
                    connectivity,
                    ends: (1..=count).map(|i| i * size).collect(),
                }
            }
        };
        blocks.push(Elements {
            name: name.to_owned(),
            count,
            cells: (!is_ghost).then_some(cells),
        });
    }
    Ok(Shape::Elements { nodes, blocks })
}

/// Reads node numbers and returns them counted from 0.
fn node_numbers_of(stream: &mut Stream<'_>, count: usize, node_count: usize) -> Result<Vec<u32>> {
    let numbers = stream.integers(count)?;
    let node = |&number: &i32| {
        let node = u32::try_from(number).ok().and_then(|n| n.checked_sub(1));
        node.filter(|n| (*n as usize) < node_count).ok_or_else(|| {
            stream.fault(format!("nodes from 1 to {node_count}"), number.to_string())
        })
    };
    numbers.iter().map(node).collect()
}

/// Reads the number of nodes or faces of each cell, and returns them with their sum.
fn counts(stream: &mut Stream<'_>, count: usize) -> Result<(Vec<usize>, usize)> {
    let mut counts = Vec::new();
    for number in stream.integers(count)? {
        let count = usize::try_from(number);
        counts.push(count.map_err(|_| stream.fault("a count", number.to_string()))?);
    }
    let sum = counts
        .iter()
        .try_fold(0_usize, |sum, n| sum.checked_add(*n));
    Ok((counts, sum.unwrap_or(usize::MAX)))
}

fn polygons(stream: &mut Stream<'_>, count: usize, node_count: usize) -> Result<Cells> {
    let (sizes, total) = counts(stream, count)?;
    let connectivity = node_numbers_of(stream, total, node_count)?;
    let mut end = 0;
    let ends = sizes.iter().map(|size| {
        end += size;
        end
    });
    Ok(Cells {
        kind: CellKind::POLYGON,
        ends: ends.collect(),
        connectivity,
    })
}

fn polyhedra(stream: &mut Stream<'_>, count: usize, node_count: usize) -> Result<Cells> {
    let (face_counts, face_count) = counts(stream, count)?;
    let (sizes, total) = counts(stream, face_count)?;
    let nodes = node_numbers_of(stream, total, node_count)?;
    let mut rest = nodes.as_slice();
    let mut sizes = sizes.into_iter();
    let mut cells = Cells {
        kind: CellKind::POLYHEDRON,
        connectivity: Vec::new(),
        ends: Vec::new(),
    };
    // The counts were read from 32-bit numbers.
    let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    for faces in face_counts {
        cells.connectivity.push(small(faces));
        for size in sizes.by_ref().take(faces) {
            let (face, others) = rest.split_at_checked(size).unwrap_or((rest, &[]));
            cells.connectivity.push(small(face.len()));
            cells.connectivity.extend(face);
            rest = others;
        }
        cells.ends.push(cells.connectivity.len());
    }
    Ok(cells)
}

fn block(
    stream: &mut Stream<'_>,
    keyword: &str,
    node_numbers: bool,
    element_numbers: bool,
) -> Result<Block> {
    let words: Vec<&str> = keyword.split_ascii_whitespace().collect();
    let has = |word: &str| words.contains(&word);
    let sizes = stream.integers(3)?;
    let mut dims = [0; 3];
    for (n, &size) in dims.iter_mut().zip(&sizes) {
        *n = usize::try_from(size).unwrap_or(0);
    }
    if has("range") {
        let range = stream.integers(6)?;
        for (n, ends) in dims.iter_mut().zip(range.chunks_exact(2)) {
            let steps = i64::from(ends[1]) - i64::from(ends[0]);
            *n = usize::try_from(steps + 1).unwrap_or(0);
        }
    }
    let count = dims.iter().try_fold(1_usize, |n, m| n.checked_mul(*m));
    let Some(count) = count.filter(|n| (1..=u32::MAX as usize).contains(n)) else {
        let expected = "three counts of nodes whose product fits into 32 bits";
        return Err(stream.fault(expected, format!("{sizes:?}")));
    };
    let doubles = |numbers: Vec<f32>| numbers.into_iter().map(f64::from).collect::<Vec<f64>>();
    let places = if has("uniform") {
        let origin = doubles(stream.reals(3)?);
        let step = doubles(stream.reals(3)?);
        Places::Uniform {
            origin: DVec3::from_slice(&origin),
            step: DVec3::from_slice(&step),
        }
    } else if has("rectilinear") {
        let [x, y, z] = dims;
        Places::Axes([
            doubles(stream.reals(x)?),
            doubles(stream.reals(y)?),
            doubles(stream.reals(z)?),
        ])
    } else {
        Places::Nodes(positions(stream, count)?)
    };
    let iblank = has("iblanked")
        .then(|| stream.integers(count))
        .transpose()?;
    let mut block = Block {
        dims,
        places,
        iblank,
    };
    let cell_count = block.cell_dims().iter().product();
    if has("with_ghost")
        && stream
            .peek()
            .is_some_and(|line| line.starts_with("ghost_flags"))
    {
        stream.line()?;
        stream.integers(cell_count)?;
    }
    for (is_given, name, count) in [
        (node_numbers, "node_ids", count),
        (element_numbers, "element_ids", cell_count),
    ] {
        if is_given && stream.peek().is_some_and(|line| line.starts_with(name)) {
            stream.line()?;
            stream.integers(count)?;
        }
    }
    // If no node is blanked, the mask is dropped.
    if block
        .iblank
        .as_ref()
        .is_some_and(|iblank| iblank.iter().all(|n| *n != 0))
    {
        block.iblank = None;
    }
    Ok(block)
}
