//! What lies in a box.

use std::ops::Range;
use std::path::Path;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::select::{Runs, Selection, reselect};
use crate::error::{Error, Result};
use crate::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, FieldSource, Geometry, Mesh,
    SplatCloud, leave_out_unused,
};
use crate::scene::{Lattice, LatticeSpacing, Values};

/// The value of `vtkGhostType` of a cell that is hidden.
const HIDDEN_CELL: u8 = 32;

/// The samples, nodes and cells that are kept, with how many there were.
struct Kept {
    nodes: Runs,
    node_count: usize,
    cells: Runs,
    cell_count: usize,
}

/// A box, its faces included.
#[derive(Clone, Copy)]
struct Area {
    lower: DVec3,
    upper: DVec3,
}

impl Area {
    /// NaN is outside.
    fn holds(self, point: DVec3) -> bool {
        point.cmpge(self.lower).all() && point.cmple(self.upper).all()
    }

    fn holds_on(self, axis: usize, coordinate: f64) -> bool {
        coordinate >= self.lower[axis] && coordinate <= self.upper[axis]
    }
}

/// What of a data set lies in a box, its faces included; fields, lengths and colours follow.
///
/// | data | what is kept |
/// |---|---|
/// | lattices | the smallest range of indices with all samples in the box; of cells those between kept samples |
/// | curvilinear grids | of each block the smallest range of cells with all whose centre (the mean of eight corners) is in the box; others in the range are hidden by a field `vtkGhostType` |
/// | unstructured grids | cells whose centre (the mean of their nodes) is in the box, and their nodes |
/// | particles, splats | those whose centre is |
/// | meshes | triangles whose centroid is; a part that loses some is seen from both sides from then on |
///
/// A lattice that stands at an angle to the axes keeps samples outside the box, as its range of indices has them.
/// What is up ([`Dataset::up`]) stays as it was of the whole. Fields that have another number of values than the data
/// have samples are left out, with a note.
///
/// - `lower`, `upper`: the box's corners, in the coordinates of the data.
///
/// # Errors
/// Those of [`Dataset::validate`]; corners that are not finite, or of which the upper one is not greater along each
/// axis; a box in which nothing lies, or of a lattice that had more along an axis a single sample: its cells
/// would have no width.
pub fn crop(mut dataset: Dataset, lower: DVec3, upper: DVec3) -> Result<Dataset> {
    if !(lower.is_finite() && upper.is_finite() && lower.cmplt(upper).all()) {
        return Err(Error::invalid(
            "crop",
            "box",
            "two finite corners, the upper one greater along each axis",
            format!("{} and {}", numbers(lower), numbers(upper)),
            "correct the box",
        ));
    }
    dataset.validate()?;
    let area = Area { lower, upper };
    let up = dataset.up();
    let bounds = dataset.bounds();
    dataset.format_up = Some((up.direction, up.reason));
    let nothing = Geometry::Points {
        positions: Vec::new(),
    };
    let geometry = std::mem::replace(&mut dataset.geometry, nothing);
    let mut hidden = None;
    let (geometry, kept, noun) = match geometry {
        Geometry::Lattice(lattice) => {
            let (lattice, kept) = of_lattice(lattice, area, &dataset.path)?;
            (Geometry::Lattice(lattice), kept, "sample")
        }
        Geometry::Curvilinear { blocks } => {
            let (blocks, kept, outside) = of_blocks(&blocks, area);
            hidden = outside;
            (Geometry::Curvilinear { blocks }, kept, "centre of a cell")
        }
        Geometry::Cells(mesh) => {
            let (mesh, kept) = of_cells(mesh, area);
            (Geometry::Cells(mesh), kept, "centre of a cell")
        }
        Geometry::Points { positions } => {
            let kept = of_centres(&positions, area);
            let positions = kept.nodes.pick(&positions);
            (Geometry::Points { positions }, kept, "particle")
        }
        Geometry::Splats(cloud) => {
            let (cloud, kept) = of_splats(cloud, area);
            (Geometry::Splats(cloud), kept, "splat")
        }
        Geometry::Mesh(mut mesh) => {
            let kept = of_mesh(&mut mesh, area);
            (Geometry::Mesh(mesh), kept, "triangle")
        }
    };
    if kept.nodes.len() == 0 {
        let data = match bounds {
            Some((lower, upper)) => {
                format!("which reach from {} to {}", numbers(lower), numbers(upper))
            }
            None => "which have no place".into(),
        };
        return Err(Error::format(
            &dataset.path,
            "crop",
            format!("a box with something of the data in it, {data}"),
            format!("no {noun} from {} to {}", numbers(lower), numbers(upper)),
            "give another box",
        ));
    }
    dataset.geometry = geometry;
    reselect(&mut dataset, |association| match association {
        Association::Nodes => (&kept.nodes, kept.node_count),
        Association::Cells => (&kept.cells, kept.cell_count),
    });
    if let Some(hidden) = hidden {
        dataset.fields.push(Field {
            name: "vtkGhostType".into(),
            association: Association::Cells,
            source: FieldSource::Scalar(Values::U8(hidden)),
        });
    }
    Ok(dataset)
}

/// Three numbers as options take them.
fn numbers(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}

/// Those of so many along an axis that are held, from the first to the last.
fn extent(count: usize, is_held: impl Fn(usize) -> bool) -> Range<usize> {
    match (0..count).find(|&i| is_held(i)) {
        None => 0..0,
        Some(first) => {
            let last = (first..count).rev().find(|&i| is_held(i));
            first..last.unwrap_or(first) + 1
        }
    }
}

/// The smallest box of indices that holds two; one that is empty holds nothing.
fn joined(a: [Range<usize>; 3], b: [Range<usize>; 3]) -> [Range<usize>; 3] {
    if a.iter().any(Range::is_empty) {
        return b;
    }
    if b.iter().any(Range::is_empty) {
        return a;
    }
    [0, 1, 2].map(|d| a[d].start.min(b[d].start)..a[d].end.max(b[d].end))
}

/// The smallest box of indices with all that are held, x fastest.
fn index_box(
    [x, y, z]: [usize; 3],
    is_held: impl Fn([usize; 3]) -> bool + Sync,
) -> [Range<usize>; 3] {
    const NONE: [Range<usize>; 3] = [0..0, 0..0, 0..0];
    let of_row = |row: usize| {
        let (j, k) = (row % y, row / y);
        [extent(x, |i| is_held([i, j, k])), j..j + 1, k..k + 1]
    };
    (0..y * z)
        .into_par_iter()
        .map(of_row)
        .reduce(|| NONE, joined)
}

fn of_lattice(lattice: Lattice, area: Area, path: &Path) -> Result<(Lattice, Kept)> {
    let dims = lattice.dims;
    let along = |axis: usize, i: usize| {
        let mut index = [0; 3];
        index[axis] = i;
        area.holds_on(axis, lattice.position(index)[axis])
    };
    let is_straight = match &lattice.spacing {
        LatticeSpacing::Rectilinear { .. } => true,
        LatticeSpacing::Uniform { step, .. } => {
            *step == DMat3::from_diagonal(DVec3::new(step.x_axis.x, step.y_axis.y, step.z_axis.z))
        }
    };
    let part = if is_straight {
        [0, 1, 2].map(|axis| extent(dims[axis], |i| along(axis, i)))
    } else {
        index_box(dims, |index| area.holds(lattice.position(index)))
    };
    let is_empty = part.iter().any(Range::is_empty);
    let thin = (0..3).find(|&d| part[d].len() == 1 && dims[d] > 1);
    if let (Some(axis), false) = (thin, is_empty) {
        let axis = ["first", "second", "third"][axis];
        return Err(Error::format(
            path,
            "crop",
            "a box with two samples at least along each index of the grid",
            format!("one along the {axis}"),
            "give a greater box",
        ));
    }
    // One layer of cells at the samples of an axis that has one.
    let cell_dims = dims.map(|n| n.max(2) - 1);
    let cells = [0, 1, 2].map(|d| match dims[d] {
        1 => part[d].clone(),
        _ => part[d].start..part[d].end.max(1) - 1,
    });
    let mut kept = Kept {
        nodes: Runs::default(),
        node_count: lattice.len(),
        cells: Runs::default(),
        cell_count: cell_dims.iter().product(),
    };
    if is_empty {
        return Ok((lattice, kept));
    }
    kept.nodes.push_box(0, dims, &part);
    kept.cells.push_box(0, cell_dims, &cells);
    let first = lattice.position(part.each_ref().map(|run| run.start));
    let spacing = match lattice.spacing {
        LatticeSpacing::Uniform { step, .. } => LatticeSpacing::Uniform {
            origin: first,
            step,
        },
        LatticeSpacing::Rectilinear { coordinates } => LatticeSpacing::Rectilinear {
            coordinates: [0, 1, 2].map(|d| coordinates[d][part[d].clone()].to_vec()),
        },
    };
    let dims = part.map(|run| run.len());
    Ok((Lattice { dims, spacing }, kept))
}

/// What is kept of the blocks, and the marks of hidden cells if there are any.
fn of_blocks(
    blocks: &[CurvilinearBlock],
    area: Area,
) -> (Vec<CurvilinearBlock>, Kept, Option<Vec<u8>>) {
    let mut kept = Kept {
        nodes: Runs::default(),
        node_count: 0,
        cells: Runs::default(),
        cell_count: 0,
    };
    let mut left = Vec::new();
    let mut marks = Vec::new();
    for block in blocks {
        let [x, y, _] = block.dims;
        let cell_dims = block.dims_of(Association::Cells);
        let centre = |[i, j, k]: [usize; 3]| {
            let first = i + x * (j + y * k);
            let corners = [0, 1, x, x + 1].into_iter();
            let corners = corners.flat_map(|n| [first + n, first + n + x * y]);
            corners.map(|n| block.nodes[n]).sum::<DVec3>() / 8.0
        };
        let cells = index_box(cell_dims, |index| area.holds(centre(index)));
        if !cells.iter().any(Range::is_empty) {
            let nodes = cells.clone().map(|run| run.start..run.end + 1);
            kept.cells.push_box(kept.cell_count, cell_dims, &cells);
            let mut own = Runs::default();
            own.push_box(0, block.dims, &nodes);
            left.push(CurvilinearBlock {
                dims: nodes.each_ref().map(Range::len),
                nodes: own.pick(&block.nodes),
            });
            kept.nodes.push_box(kept.node_count, block.dims, &nodes);
            let [i, j, k] = cells;
            for k in k {
                for j in j.clone() {
                    let mark = |i| match area.holds(centre([i, j, k])) {
                        true => 0,
                        false => HIDDEN_CELL,
                    };
                    marks.extend(i.clone().map(mark));
                }
            }
        }
        kept.node_count += block.nodes.len();
        kept.cell_count += cell_dims.iter().product::<usize>();
    }
    let hidden = marks.contains(&HIDDEN_CELL).then_some(marks);
    (left, kept, hidden)
}

/// Calls `each` with the entries of a cell that are nodes: all, but for the counts that polyhedra have between them.
fn each_node(kind: CellKind, entries: &mut [u32], mut each: impl FnMut(&mut u32)) {
    if kind != CellKind::POLYHEDRON {
        entries.iter_mut().for_each(each);
        return;
    }
    let mut rest = entries.get_mut(1..).unwrap_or_default();
    while let Some((&mut count, tail)) = rest.split_first_mut() {
        let (face, beyond) = tail.split_at_mut((count as usize).min(tail.len()));
        face.iter_mut().for_each(&mut each);
        rest = beyond;
    }
}

fn of_cells(mut mesh: CellMesh, area: Area) -> (CellMesh, Kept) {
    let nodes = &mesh.nodes;
    let is_inside = |i: usize| {
        let mut corners = Vec::with_capacity(8);
        each_node(mesh.kinds[i], &mut mesh.cell(i).to_vec(), |n| {
            corners.push(*n)
        });
        // The faces of a polyhedron share theirs.
        corners.sort_unstable();
        corners.dedup();
        let sum: DVec3 = corners.iter().map(|&n| nodes[n as usize]).sum();
        // Of nothing: NaN, which is outside.
        area.holds(sum / corners.len() as f64)
    };
    let inside: Vec<bool> = (0..mesh.cell_count())
        .into_par_iter()
        .map(is_inside)
        .collect();
    let cells = Runs::of(inside.len(), |i| inside[i]);
    let mut is_used = vec![false; nodes.len()];
    let mut left = CellMesh {
        kinds: cells.pick(&mesh.kinds),
        offsets: vec![0],
        ..CellMesh::default()
    };
    for i in cells.indices() {
        let run = mesh.offsets[i] as usize..mesh.offsets[i + 1] as usize;
        let entries = &mut mesh.connectivity[run];
        each_node(mesh.kinds[i], entries, |n| is_used[*n as usize] = true);
        left.connectivity.extend_from_slice(entries);
        // No more than there were.
        left.offsets
            .push(u32::try_from(left.connectivity.len()).unwrap_or(u32::MAX));
    }
    let mut next = 0;
    let numbers: Vec<u32> = is_used
        .iter()
        .map(|&is| {
            let number = next;
            next += u32::from(is);
            number
        })
        .collect();
    for (kind, run) in left.kinds.iter().zip(left.offsets.windows(2)) {
        let entries = &mut left.connectivity[run[0] as usize..run[1] as usize];
        each_node(*kind, entries, |n| *n = numbers[*n as usize]);
    }
    let runs = Runs::of(is_used.len(), |i| is_used[i]);
    left.nodes = runs.pick(&mesh.nodes);
    let kept = Kept {
        nodes: runs,
        node_count: is_used.len(),
        cells,
        cell_count: inside.len(),
    };
    (left, kept)
}

fn of_centres(positions: &[DVec3], area: Area) -> Kept {
    Kept {
        nodes: Runs::of(positions.len(), |i| area.holds(positions[i])),
        node_count: positions.len(),
        cells: Runs::default(),
        cell_count: 0,
    }
}

fn of_splats(cloud: SplatCloud, area: Area) -> (SplatCloud, Kept) {
    let kept = of_centres(&cloud.positions, area);
    let coefficients = kept.nodes.strided(cloud.harmonics_stride());
    let left = SplatCloud {
        positions: kept.nodes.pick(&cloud.positions),
        scales: kept.nodes.pick(&cloud.scales),
        rotations: kept.nodes.pick(&cloud.rotations),
        opacities: kept.nodes.pick(&cloud.opacities),
        harmonics: coefficients.pick(&cloud.harmonics),
        ..cloud
    };
    (left, kept)
}

/// The triangles that are kept stand for nodes: a mesh has no fields.
fn of_mesh(mesh: &mut Mesh, area: Area) -> Kept {
    let node_count = mesh.triangle_count();
    for part in &mut mesh.parts {
        let before = part.triangles.len();
        let positions = &part.positions;
        part.triangles.retain(|triangle| {
            let corner = |i: &u32| positions.get(*i as usize).copied().unwrap_or(DVec3::NAN);
            area.holds(triangle.iter().map(corner).sum::<DVec3>() / 3.0)
        });
        let after = part.triangles.len();
        if after == 0 || after == before {
            continue;
        }
        leave_out_unused(part);
        // Opened, it may show its inside.
        if let Some(material) = mesh.materials.get(part.material)
            && !material.is_double_sided
        {
            let mut open = material.clone();
            open.is_double_sided = true;
            part.material = mesh.materials.len();
            mesh.materials.push(open);
        }
    }
    mesh.parts.retain(|part| !part.triangles.is_empty());
    Kept {
        nodes: Runs::of(mesh.triangle_count(), |_| true),
        node_count,
        cells: Runs::default(),
        cell_count: 0,
    }
}
