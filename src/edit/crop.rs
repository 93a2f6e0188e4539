//! Crops a data set to a box.

use std::ops::Range;
use std::path::Path;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::select::{Runs, Selection, reselect};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::data::mesh::Mesh;
use crate::data::splats::SplatCloud;
use crate::data::spz_records::Change;
use crate::data::up::Up;
use crate::error::{Error, Result};
use crate::io::leave_out_unused;
use crate::parallel;
use crate::scene::{Lattice, LatticeSpacing, Values};

/// Value of `vtkGhostType` for a hidden cell.
const HIDDEN_CELL: u8 = 32;

/// Samples, nodes and cells that are kept, with the numbers before.
struct Kept {
    nodes: Runs,
    node_count: usize,
    cells: Runs,
    cell_count: usize,
}

/// Box, including its faces.
#[derive(Clone, Copy)]
struct Area {
    lower: DVec3,
    upper: DVec3,
}

impl Area {
    /// Returns true if a point is in the box; NaN is outside.
    fn holds(self, point: DVec3) -> bool {
        point.cmpge(self.lower).all() && point.cmple(self.upper).all()
    }

    fn holds_on(self, axis: usize, coordinate: f64) -> bool {
        coordinate >= self.lower[axis] && coordinate <= self.upper[axis]
    }
}

/// Keeps the part of a data set in a box, including the box's faces, with its fields, lengths and colours.
///
/// | data | part that is kept |
/// |---|---|
/// | lattices | the smallest range of indices with all samples in the box, and the cells between kept samples |
/// | curvilinear grids | for each block, the smallest range of cells with all whose centre (the mean of eight corners) is in the box; others in the range are hidden by a field `vtkGhostType` |
/// | unstructured grids | cells whose centre (the mean of their nodes) is in the box, and their nodes |
/// | particles, splats | those whose centre is in the box |
/// | meshes | triangles whose centroid is in the box; a part that loses any becomes visible from both sides |
///
/// A lattice at an angle to the axes also keeps samples outside the box, because it keeps a range of indices. The
/// upward direction ([`Dataset::up`]) remains that of the whole. Fields whose number of values does not match the
/// samples are left out, with a note.
///
/// - `lower`, `upper`: the box's corners, in the coordinates of the data.
///
/// # Errors
/// The errors of [`Dataset::validate`]; corners that are not finite; an upper corner that is not greater along each
/// axis; an empty result. A lattice with several samples along an axis must keep more than one, or its cells would have
/// no width.
pub fn crop(dataset: Dataset, lower: DVec3, upper: DVec3) -> Result<Dataset> {
    crop_of(dataset, lower, upper, None)
}

/// Properties of a whole data set of which only a part was read.
pub(super) struct Whole {
    pub(super) up: Up,
    /// Least and greatest coordinates.
    pub(super) bounds: Option<(DVec3, DVec3)>,
}

/// Crops as [`crop`] does; `whole` describes the whole if `dataset` is a part.
pub(super) fn crop_of(
    mut dataset: Dataset,
    lower: DVec3,
    upper: DVec3,
    whole: Option<Whole>,
) -> Result<Dataset> {
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
    let Whole { up, bounds } = whole.unwrap_or_else(|| Whole {
        up: dataset.up(),
        bounds: dataset.bounds(),
    });
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
            unit: None,
            source: FieldSource::Scalar(Values::U8(hidden)),
        });
    }
    Ok(dataset)
}

/// Formats three numbers as options take them.
fn numbers(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}

/// Returns the range from the first to the last held index of an axis.
fn extent(count: usize, is_held: impl Fn(usize) -> bool) -> Range<usize> {
    match (0..count).find(|&i| is_held(i)) {
        None => 0..0,
        Some(first) => {
            let last = (first..count).rev().find(|&i| is_held(i));
            first..last.unwrap_or(first) + 1
        }
    }
}

/// Returns the smallest box of indices that contains both; an empty box contains nothing.
fn joined(a: [Range<usize>; 3], b: [Range<usize>; 3]) -> [Range<usize>; 3] {
    if a.iter().any(Range::is_empty) {
        return b;
    }
    if b.iter().any(Range::is_empty) {
        return a;
    }
    [0, 1, 2].map(|d| a[d].start.min(b[d].start)..a[d].end.max(b[d].end))
}

/// Returns the smallest box of indices with all that are held, x fastest.
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
    // An axis with one sample has one layer of cells.
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

/// Returns the kept blocks, the selection, and the marks of hidden cells if there are any.
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

/// Calls `each` with the entries of a cell that are nodes. It skips the counts in a polyhedron.
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
        // The faces of a polyhedron share corners.
        corners.sort_unstable();
        corners.dedup();
        let sum: DVec3 = corners.iter().map(|&n| nodes[n as usize]).sum();
        // A cell without nodes gives NaN, which is outside.
        area.holds(sum / corners.len() as f64)
    };
    let inside: Vec<bool> = parallel::map(mesh.cell_count(), is_inside);
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
        // The number is no greater than before, so it fits.
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
    let mut left = SplatCloud {
        positions: kept.nodes.pick(&cloud.positions),
        scales: kept.nodes.pick(&cloud.scales),
        rotations: kept.nodes.pick(&cloud.rotations),
        opacities: kept.nodes.pick(&cloud.opacities),
        harmonics: coefficients.pick(&cloud.harmonics),
        ..cloud
    };
    if left.positions.len() < kept.node_count {
        left.records.change(Change::Splats);
    }
    (left, kept)
}

/// Crops a mesh. Kept elements count as nodes, because a mesh has no fields.
fn of_mesh(mesh: &mut Mesh, area: Area) -> Kept {
    let count = |mesh: &Mesh| mesh.triangle_count() + mesh.line_count() + mesh.point_count();
    let node_count = count(mesh);
    for part in &mut mesh.parts {
        let before = part.triangles.len();
        let marks = part.lines.len() + part.points.len();
        let positions = &part.positions;
        part.triangles.retain(|triangle| {
            let corner = |i: &u32| positions.get(*i as usize).copied().unwrap_or(DVec3::NAN);
            area.holds(triangle.iter().map(corner).sum::<DVec3>() / 3.0)
        });
        let corner = |i: u32| positions.get(i as usize).copied().unwrap_or(DVec3::NAN);
        part.lines
            .retain(|line| area.holds(line.iter().map(|i| corner(*i)).sum::<DVec3>() / 2.0));
        part.points.retain(|i| area.holds(corner(*i)));
        let after = part.triangles.len();
        let is_same = after == before && marks == part.lines.len() + part.points.len();
        if is_same || part.is_empty() {
            continue;
        }
        leave_out_unused(part);
        if after == before {
            continue;
        }
        // An opened surface may show its inside.
        if let Some(material) = mesh.materials.get(part.material)
            && !material.is_double_sided
        {
            let mut open = material.clone();
            open.is_double_sided = true;
            part.material = mesh.materials.len();
            mesh.materials.push(open);
        }
    }
    mesh.parts.retain(|part| !part.is_empty());
    Kept {
        nodes: Runs::of(count(mesh), |_| true),
        node_count,
        cells: Runs::default(),
        cell_count: 0,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::fixtures;
    use super::*;

    fn numbers_of(dataset: &Dataset, name: &str) -> Vec<f32> {
        let (_, values) = dataset.scalar(name).unwrap();
        (0..values.len()).map(|i| values.get(i)).collect()
    }

    /// Returns the numbers of samples and cells that fields may have values for.
    fn counts(dataset: &Dataset) -> [usize; 2] {
        match &dataset.geometry {
            Geometry::Lattice(lattice) => [
                lattice.len(),
                lattice.dims.map(|n| n.max(2) - 1).iter().product(),
            ],
            Geometry::Curvilinear { blocks } => [Association::Nodes, Association::Cells].map(|a| {
                let count = |block: &CurvilinearBlock| block.dims_of(a).iter().product::<usize>();
                blocks.iter().map(count).sum()
            }),
            Geometry::Cells(mesh) => [mesh.nodes.len(), mesh.cell_count()],
            Geometry::Points { positions } => [positions.len(), 0],
            Geometry::Splats(cloud) => [cloud.positions.len(), 0],
            Geometry::Mesh(mesh) => [mesh.triangle_count(), 0],
        }
    }

    proptest! {
        #[test]
        fn any_box_leaves_sound_data_or_says_why_not(
            corner in prop::array::uniform3(-3.0f64..3.0),
            extent in prop::array::uniform3(0.01f64..5.0),
        ) {
            let lower = DVec3::from(corner);
            let upper = lower + DVec3::from(extent);
            for dataset in fixtures::all() {
                let field_count = dataset.fields.len();
                let up = dataset.up().direction;
                match crop(dataset, lower, upper) {
                    Ok(cropped) => {
                        prop_assert!(cropped.validate().is_ok());
                        prop_assert!(cropped.notes.is_empty());
                        prop_assert_eq!(cropped.up().direction, up);
                        // A field with the marks of hidden cells may be new.
                        prop_assert!(cropped.fields.len() - field_count <= 1);
                        let [nodes, cells] = counts(&cropped);
                        prop_assert!(nodes > 0);
                        for field in &cropped.fields {
                            let expected = match field.association {
                                Association::Nodes => nodes,
                                Association::Cells => cells,
                            };
                            let len = cropped.field_scalar(field).unwrap().len();
                            prop_assert_eq!(len, expected, "{}", &field.name);
                        }
                    }
                    Err(error) => {
                        let said = error.to_string();
                        let is_clear = said.contains("something of the data in it")
                            || said.contains("two samples at least");
                        prop_assert!(is_clear, "{}", said);
                    }
                }
            }
        }
    }

    #[test]
    fn lattices_keep_the_samples_in_the_box_and_the_cells_between() {
        let diagonal = |x| DMat3::from_diagonal(DVec3::new(x, 0.5, 2.0));
        // x is -1, 0, 1, 2, 3 or falls from -1; y is 0, .5, 1, 1.5; z is .5, 2.5, 4.5.
        let (lower, upper) = (DVec3::new(0.0, 0.4, 0.0), DVec3::new(2.5, 1.1, 2.0));
        assert!(crop(fixtures::uniform(diagonal(1.0)), lower, upper).is_err());
        let upper = upper + 3.0 * DVec3::Z;
        let cropped = crop(fixtures::uniform(diagonal(1.0)), lower, upper).unwrap();
        let first = DVec3::new(0.0, 0.5, 0.5);
        assert_eq!(cropped.bounds(), Some((first, DVec3::new(2.0, 1.0, 4.5))));
        assert_eq!(
            numbers_of(&cropped, "number of nodes")[..7],
            [6.0, 7.0, 8.0, 11.0, 12.0, 13.0, 26.0]
        );
        assert_eq!(
            numbers_of(&cropped, "number of cells"),
            [5.0, 6.0, 17.0, 18.0]
        );
        assert_eq!(
            numbers_of(&cropped, "vector of cells:z"),
            [8.0, 9.0, 20.0, 21.0]
        );
        let lower = DVec3::new(-3.2, 0.4, 0.0);
        let falling = crop(fixtures::uniform(diagonal(-1.0)), lower, upper).unwrap();
        assert_eq!(falling.bounds().unwrap().0, DVec3::new(-3.0, 0.5, 0.5));
        assert_eq!(numbers_of(&falling, "number of nodes")[..2], [5.0, 6.0]);

        let (lower, upper) = (DVec3::new(-0.5, 0.5, -3.0), DVec3::new(2.0, 3.0, 3.0));
        let uneven = crop(fixtures::rectilinear(), lower, upper).unwrap();
        let Geometry::Lattice(lattice) = &uneven.geometry else {
            panic!("a lattice stays one");
        };
        let LatticeSpacing::Rectilinear { coordinates } = &lattice.spacing else {
            panic!("uneven coordinates stay");
        };
        assert_eq!(
            *coordinates,
            [vec![0.0, 0.5, 2.0], vec![1.0, 3.0], vec![-2.0, 0.0, 1.0]]
        );
        assert_eq!(numbers_of(&uneven, "number of nodes")[..2], [6.0, 7.0]);
        assert_eq!(
            numbers_of(&uneven, "number of cells"),
            [5.0, 6.0, 17.0, 18.0]
        );
    }

    #[test]
    fn a_lattice_at_an_angle_keeps_its_range_of_indices() {
        let step = DMat3::from_rotation_z(0.5);
        let dataset = fixtures::uniform(step);
        let Geometry::Lattice(whole) = dataset.geometry.clone() else {
            panic!("a lattice");
        };
        let area = Area {
            lower: DVec3::new(-0.3, 0.2, 0.0),
            upper: DVec3::new(1.4, 2.9, 9.0),
        };
        let cropped = crop(dataset, area.lower, area.upper).unwrap();
        let numbers = numbers_of(&cropped, "number of nodes");
        let all = (0..60).map(|n| [n % 5, n / 5 % 4, n / 20]);
        let inside: Vec<[usize; 3]> = all.filter(|&n| area.holds(whole.position(n))).collect();
        assert!(!inside.is_empty());
        for [i, j, k] in &inside {
            assert!(numbers.contains(&((i + 5 * (j + 4 * k)) as f32)));
        }
        let extent = |d: usize| {
            let along = || inside.iter().map(|n| n[d]);
            along().max().unwrap() + 1 - along().min().unwrap()
        };
        assert_eq!(numbers.len(), extent(0) * extent(1) * extent(2));
    }

    #[test]
    fn cells_of_curvilinear_grids_outside_the_box_are_hidden() {
        // The bent block's outermost cells reach beyond the box at one end.
        let (lower, upper) = (DVec3::new(0.9, 0.0, 0.0), DVec3::new(2.5, 1.0, 0.5));
        let cropped = crop(fixtures::curvilinear(), lower, upper).unwrap();
        let Geometry::Curvilinear { blocks } = &cropped.geometry else {
            panic!("a grid stays one");
        };
        assert_eq!(blocks.len(), 1);
        let marks = numbers_of(&cropped, "vtkGhostType");
        let hidden = marks.iter().filter(|m| **m == 32.0).count();
        assert_eq!((hidden, marks.len()), (1, 6));
        let numbers = numbers_of(&cropped, "number of cells");
        let centre = |n: usize| {
            let (i, j, k) = (n % 3, n / 3 % 3, n / 9);
            let corners = (0..8).map(|c| {
                let [i, j, k] = [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)].map(|n| n as f64);
                let (radius, angle) = (1.0 + 0.5 * i, 0.4 * j);
                DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.7 * k)
            });
            corners.sum::<DVec3>() / 8.0
        };
        let area = Area { lower, upper };
        for n in 0..18 {
            let at = numbers.iter().position(|&number| number == n as f32);
            let is_shown = at.is_some_and(|at| marks[at] == 0.0);
            assert_eq!(is_shown, area.holds(centre(n)), "cell {n}");
        }
        // The other block is kept alone and whole, so nothing is hidden.
        let (lower, upper) = (DVec3::splat(-4.0), DVec3::new(0.0, 4.0, 4.0));
        let other = crop(fixtures::curvilinear(), lower, upper).unwrap();
        assert_eq!(
            numbers_of(&other, "number of cells"),
            [18.0, 19.0, 20.0, 21.0]
        );
        assert_eq!(numbers_of(&other, "number of nodes").len(), 18);
        assert!(other.scalar("vtkGhostType").is_err());
    }

    #[test]
    fn unstructured_cells_go_with_their_nodes() {
        let corners = |lower: [f64; 3], upper: [f64; 3]| {
            let cropped = crop(fixtures::cells(), lower.into(), upper.into()).unwrap();
            let nodes = numbers_of(&cropped, "number of nodes");
            let cells = numbers_of(&cropped, "number of cells");
            let Geometry::Cells(mesh) = cropped.geometry else {
                panic!("cells stay");
            };
            (mesh, nodes, cells)
        };
        let (mesh, nodes, cells) = corners([0.4; 3], [0.6; 3]);
        assert_eq!(nodes, (1..9).map(|n| n as f32).collect::<Vec<_>>());
        assert_eq!(cells, [0.0]);
        // The faces have their own counts, and nodes are counted from 0.
        assert_eq!(mesh.connectivity[..6], [6, 4, 0, 2, 3, 1]);
        assert_eq!(mesh.offsets, [0, 31]);
        let (mesh, nodes, cells) = corners([-1.0, 0.0, 0.0], [0.5, 0.5, 2.0]);
        assert_eq!(nodes, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]);
        assert_eq!(cells, [0.0, 1.0, 2.0]);
        assert_eq!(mesh.connectivity[31..], [4, 5, 6, 8, 0, 2, 9]);
    }

    #[test]
    fn a_mesh_that_is_opened_is_seen_from_both_sides() {
        let half = crop(fixtures::mesh(), DVec3::NEG_ONE, DVec3::splat(0.34)).unwrap();
        let Geometry::Mesh(mesh) = half.geometry else {
            panic!("a mesh stays one");
        };
        assert_eq!(mesh.parts[0].triangles, [[0, 1, 2]]);
        assert_eq!(mesh.parts[0].positions.len(), 3);
        assert_eq!(mesh.parts[0].normals.len(), 3);
        assert!(mesh.materials[mesh.parts[0].material].is_double_sided);
        let whole = crop(fixtures::mesh(), DVec3::NEG_ONE, DVec3::ONE).unwrap();
        let Geometry::Mesh(mesh) = whole.geometry else {
            panic!("a mesh stays one");
        };
        assert_eq!(mesh.triangle_count(), 2);
        assert!(!mesh.materials[mesh.parts[0].material].is_double_sided);
    }

    #[test]
    fn what_is_derived_follows_and_what_does_not_fit_is_left_out() {
        let mut dataset = fixtures::points();
        let field = |name: &str, source| Field {
            name: name.into(),
            association: Association::Nodes,
            unit: None,
            source,
        };
        let twice = |dataset: &Dataset| {
            let (_, values) = dataset.scalar("number of nodes")?;
            let twice = (0..values.len()).map(|i| 2.0 * values.get(i));
            Ok(Values::F32(twice.collect()))
        };
        dataset
            .fields
            .push(field("twice", FieldSource::Derived(twice)));
        let stray = FieldSource::Scalar(Values::U8(vec![1; 7]));
        dataset.fields.push(field("stray", stray));
        let cropped = crop(dataset, DVec3::ZERO, DVec3::splat(2.0)).unwrap();
        let single = numbers_of(&cropped, "number of nodes");
        let double = numbers_of(&cropped, "twice");
        assert!(single.iter().zip(&double).all(|(a, b)| 2.0 * a == *b));
        assert!(cropped.scalar("stray").is_err());
        assert!(cropped.notes[0].contains("7 values for 40 samples"));
    }

    #[test]
    fn boxes_without_data_name_where_the_data_are() {
        let far = DVec3::splat(100.0);
        for dataset in fixtures::all() {
            let said = crop(dataset, far, far + 1.0).unwrap_err().to_string();
            assert!(said.contains("reach from"), "{said}");
        }
        for upper in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(crop(fixtures::points(), DVec3::ZERO, upper).is_err());
        }
    }
}
