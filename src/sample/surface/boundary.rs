//! Turns the boundary of a grid into a mesh with the grid's fields.
//!
//! A face is on the boundary if it belongs to one cell alone. Hidden cells count as absent, so the faces between
//! them and others are on the boundary. Faces that other cells cover are inside: of neighbouring blocks, at the
//! seam of a grid that closes on itself, of cells with nodes of their own, at hanging nodes
//! ([`covered`](crate::sample::cells::covered), which has the tolerances). Surface cells belong to the boundary.
//!
//! Cells of higher order have the faces between their corners. Values of nodes are linear over the triangles of a
//! face. A value of a cell holds for all its faces.

use glam::DVec3;

use super::flat_grid;
use super::hull::{Face, each_face, outer_faces};
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::CellMesh;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::error::{Advice, Error, Hint, Parameter, Result};
use crate::io::{leave_out_unused, triangles_with};
use crate::sample::cells::covered::{OuterFace, Side, middle_of, sides};
use crate::sample::options::SampleOptions;
use crate::sample::positions::{index_u32, is_same};
use crate::sample::report::SampleReport;
use crate::sample::scalar::{check_count, nothing_left};

/// Turns a grid of any kind into the mesh of its boundary, with the same fields. A mesh is returned unchanged.
///
/// # Errors
/// Data without cells; an opacity that is no share, column densities;
/// no face; the errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub(in crate::sample) fn as_mesh(
    mut dataset: Dataset,
    opacity: f64,
    options: &SampleOptions,
) -> Result<Dataset> {
    check(&dataset, opacity, options)?;
    dataset.validate()?;
    if matches!(dataset.geometry, Geometry::Mesh(_)) || flat_grid::is_flat(&dataset) {
        return flat_grid::as_surface(dataset);
    }
    let blanking = Blanking::of(&dataset)?;
    let faces = match &dataset.geometry {
        Geometry::Lattice(lattice) => {
            check_count(&dataset, lattice.len())?;
            let [x, y, _] = lattice.dims;
            let place = |n: u32| {
                let n = n as usize;
                lattice.position([n % x, n / x % y, n / (x * y)])
            };
            let blanking = blanking.of_lattice(lattice.dims);
            let mut faces = Faces::default();
            let grid = Structured {
                dims: lattice.dims,
                first_node: 0,
                first_cell: 0,
            };
            let hides = blanking.hides_any();
            let is_hidden = |cell: usize| hides && blanking.cell(cell);
            faces.add_grid(&grid, hides, is_hidden, place);
            faces.end(place)
        }
        Geometry::Curvilinear { blocks } => of_blocks(&dataset, blocks, &blanking)?,
        Geometry::Cells(cells) => of_cells(cells, blanking),
        _ => return Ok(dataset),
    };
    if faces.part.triangles.is_empty() {
        return Err(nothing_left(&dataset.path, &SampleReport::default()));
    }
    let counts = counts(&dataset);
    for field in &mut dataset.fields {
        let (indices, count) = match field.association {
            Association::Nodes => (&faces.nodes, counts[0]),
            Association::Cells => (&faces.cells, counts[1]),
        };
        let arrays = field.arrays_mut().iter_mut();
        let whole = arrays.filter(|values| values.len() == count);
        whole.for_each(|values| *values = values.gather(indices));
    }
    dataset.fields.retain(|f| !Blanking::is_told_by(&f.name));
    dataset.geometry = Geometry::Mesh(Mesh {
        parts: vec![faces.part],
        materials: vec![Material::default()],
        textures: Vec::new(),
    });
    Ok(dataset)
}

/// Refuses data that have no boundary, and options that do not apply to it.
fn check(dataset: &Dataset, opacity: f64, options: &SampleOptions) -> Result<()> {
    let option = match opacity < 1.0 {
        true => Parameter::SurfaceOpacity,
        false => Parameter::Surface,
    };
    let fault = |place: &str, expected: &str, found: &str, advice: Advice| {
        let found = match place {
            "data" => format!("{found} in {}", dataset.path.display()),
            _ => found.to_owned(),
        };
        Err(Error::invalid(option, place, expected, found, advice))
    };
    let refuse = |place: &str, expected: &str, found: &str| {
        let advice = Hint::LeaveOut(option).into();
        fault(place, expected, found, advice)
    };
    // Phrased so that NaN is refused.
    if !(opacity > 0.0 && opacity <= 1.0) {
        let found = opacity.to_string();
        return refuse("opacity", "above 0 and at most 1", &found);
    }
    if options.flatten.is_some() {
        return refuse("use", "one surface", "an iso-surface, too");
    }
    if options.purpose.for_columns {
        return refuse(
            "use",
            "a picture",
            "column densities, which have no surface",
        );
    }
    match &dataset.geometry {
        Geometry::Points { .. } => {
            let advice = "leave it out, or draw an iso-surface of their field";
            fault("data", "cells", "particles without cells", advice.into())
        }
        Geometry::Splats(_) => refuse("data", "cells", "splats"),
        _ => Ok(()),
    }
}

/// Refuses a translucent boundary of a surface that shows no field: it has opacities of its own.
pub(in crate::sample) fn check_colours(dataset: &Dataset, options: &SampleOptions) -> Result<()> {
    match options.surface {
        Some(opacity) if opacity < 1.0 => {
            let (option, expected) = (Parameter::SurfaceOpacity, "a field to show");
            let found = format!("none in {}", dataset.path.display());
            let advice = Hint::LeaveOut(option);
            Err(Error::invalid(option, "data", expected, found, advice))
        }
        _ => Ok(()),
    }
}

/// Returns the numbers of nodes and of cells.
fn counts(dataset: &Dataset) -> [usize; 2] {
    let of_grid = |dims: [usize; 3]| [dims.iter().product(), cell_dims(dims).iter().product()];
    match &dataset.geometry {
        Geometry::Lattice(lattice) => of_grid(lattice.dims),
        Geometry::Curvilinear { blocks } => {
            let each = blocks.iter().map(|block| of_grid(block.dims));
            each.fold([0; 2], |[a, b], [c, d]| [a + c, b + d])
        }
        Geometry::Cells(mesh) => [mesh.nodes.len(), mesh.cell_count()],
        _ => [0; 2],
    }
}

/// Returns the number of cells along each axis. An axis of one node has one layer of cells.
fn cell_dims(dims: [usize; 3]) -> [usize; 3] {
    match dims.contains(&0) {
        true => [0; 3],
        false => dims.map(|n| n.max(2) - 1),
    }
}

/// A block of a structured grid.
struct Structured {
    dims: [usize; 3],
    first_node: usize,
    first_cell: usize,
}

impl Structured {
    fn node(&self, [i, j, k]: [usize; 3]) -> u32 {
        index_u32(self.first_node + i + self.dims[0] * (j + self.dims[1] * k))
    }

    fn cell(&self, [i, j, k]: [usize; 3]) -> usize {
        let [x, y, _] = cell_dims(self.dims);
        self.first_cell + i + x * (j + y * k)
    }

    /// Returns the corners of the face of a cell across an axis at its lower side.
    fn face(&self, a: usize, at: [usize; 3]) -> [u32; 4] {
        let [b, c] = [(a + 1) % 3, (a + 2) % 3];
        [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[p, q]| {
            let mut corner = at;
            corner[b] += p;
            corner[c] += q;
            self.node(corner)
        })
    }

    /// Returns the corners of a cell.
    fn corners(&self, at: [usize; 3]) -> [u32; 8] {
        [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|c: usize| self.node([0, 1, 2].map(|axis| at[axis] + (c >> axis & 1))))
    }
}

/// Faces of a boundary.
#[derive(Default)]
struct Faces {
    /// Faces of solid cells.
    solid: Vec<OuterFace>,
    /// Faces of surface cells, each with its cell.
    flat: Vec<(u32, Vec<u32>)>,
}

/// Triangles of a boundary, and where their values are.
struct BoundaryMesh {
    part: MeshPart,
    /// Node of each corner.
    nodes: Vec<u32>,
    /// Cell of each triangle.
    cells: Vec<u32>,
}

impl Faces {
    /// Adds the faces of a block.
    ///
    /// - `hides`: whether some cells are hidden; only planes at its ends are visited otherwise.
    fn add_grid(
        &mut self,
        grid: &Structured,
        hides: bool,
        is_hidden: impl Fn(usize) -> bool,
        place: impl Fn(u32) -> DVec3,
    ) {
        let dims = cell_dims(grid.dims);
        for a in 0..3 {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            let step = if hides { 1 } else { dims[a] };
            for plane in (0..=dims[a]).step_by(step) {
                for place_of in 0..dims[b] * dims[c] {
                    let mut at = [0; 3];
                    (at[a], at[b], at[c]) = (plane, place_of % dims[b], place_of / dims[b]);
                    let mut below = at;
                    below[a] = plane.wrapping_sub(1);
                    let has_below = plane > 0 && !is_hidden(grid.cell(below));
                    let has_above = plane < dims[a] && !is_hidden(grid.cell(at));
                    if has_below == has_above {
                        continue;
                    }
                    let own = if has_below { below } else { at };
                    let inner = middle_of(&grid.corners(own), &place);
                    let cell = index_u32(grid.cell(own));
                    self.solid
                        .extend(OuterFace::new(cell, &grid.face(a, at), &place, inner));
                }
            }
        }
    }

    /// Adds the faces of a block of one layer, which is a surface.
    fn add_layer(&mut self, grid: &Structured, is_hidden: impl Fn(usize) -> bool) {
        let Some(a) = grid.dims.iter().position(|&n| n == 1) else {
            return;
        };
        if grid.dims.iter().filter(|&&n| n == 1).count() > 1 {
            return;
        }
        let [x, y, z] = cell_dims(grid.dims);
        for n in 0..x * y * z {
            let at = [n % x, n / x % y, n / (x * y)];
            let cell = grid.cell(at);
            if !is_hidden(cell) {
                let corners = grid.face(a, at).to_vec();
                self.flat.push((index_u32(cell), corners));
            }
        }
    }

    /// Leaves out the faces that others cover.
    fn uncover(&mut self, place: impl Fn(u32) -> DVec3) {
        let nodes = self.nodes();
        let positions: Vec<DVec3> = nodes.iter().map(|&n| place(n)).collect();
        for face in &mut self.solid {
            renumber(&mut face.nodes, &nodes);
        }
        let is_covered = |side: &Side| matches!(side, Side::Covered | Side::Rim);
        let sides = sides(&positions, &self.solid);
        let mut sides = sides.iter().map(Option::as_ref);
        self.solid.retain(|_| {
            let sides = sides.next().flatten();
            !sides.is_some_and(|sides| sides.iter().all(is_covered))
        });
        let numbers = self.solid.iter_mut().flat_map(|face| &mut face.nodes);
        numbers.for_each(|n| *n = nodes[*n as usize]);
    }

    /// Returns the nodes in use, ascending.
    fn nodes(&self) -> Vec<u32> {
        let of_solid = self.solid.iter().flat_map(|face| &face.nodes);
        let of_flat = self.flat.iter().flat_map(|(_, nodes)| nodes);
        let mut nodes: Vec<u32> = of_solid.chain(of_flat).copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Turns the faces into triangles that face outwards.
    fn end(mut self, place: impl Fn(u32) -> DVec3) -> BoundaryMesh {
        for face in &mut self.solid {
            face.turn_outwards(&place);
        }
        let mut nodes = self.nodes();
        let of_solid = self.solid.into_iter().map(|face| (face.cell, face.nodes));
        let (mut corners, mut ends, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        for (cell, mut face) in of_solid.chain(self.flat) {
            renumber(&mut face, &nodes);
            corners.append(&mut face);
            ends.push(corners.len());
            owners.push(cell);
        }
        let positions: Vec<DVec3> = nodes.iter().map(|&n| place(n)).collect();
        let mut cells = Vec::new();
        let mut owners = owners.into_iter();
        let all = triangles_with(&corners, &ends, &positions, &mut 0, |count| {
            let owner = owners.next();
            cells.extend(
                owner
                    .into_iter()
                    .flat_map(|own| std::iter::repeat_n(own, count)),
            );
        });
        let at = |n: u32| positions[n as usize];
        // Faces that have collapsed to a triangle leave triangles without an area.
        let has_area = |[a, b, c]: [u32; 3]| {
            !(is_same(at(a), at(b)) || is_same(at(b), at(c)) || is_same(at(c), at(a)))
        };
        let kept = all.into_iter().zip(cells).filter(|(t, _)| has_area(*t));
        let (triangles, cells) = kept.unzip();
        let mut part = MeshPart {
            positions,
            triangles,
            ..MeshPart::default()
        };
        let used = leave_out_unused(&mut part);
        if !used.is_empty() {
            nodes = used.iter().map(|&n| nodes[n as usize]).collect();
        }
        BoundaryMesh { part, nodes, cells }
    }
}

/// Replaces nodes by their places in an ascending list.
fn renumber(face: &mut [u32], nodes: &[u32]) {
    for node in face {
        *node = index_u32(nodes.partition_point(|other| other < node));
    }
}

/// Finds the boundary of curvilinear blocks.
fn of_blocks(
    dataset: &Dataset,
    blocks: &[CurvilinearBlock],
    blanking: &Blanking,
) -> Result<BoundaryMesh> {
    let mut firsts = vec![0];
    for block in blocks {
        firsts.push(firsts[firsts.len() - 1] + block.nodes.len());
    }
    check_count(dataset, firsts[blocks.len()])?;
    let place = |n: u32| {
        let n = n as usize;
        let block = firsts.partition_point(|&first| first <= n) - 1;
        blocks[block].nodes[n - firsts[block]]
    };
    let is_absent = |n: u32| blanking.node(n as usize) || !place(n).is_finite();
    let hides_any = blanking.hides_any();
    let mut faces = Faces::default();
    let mut first_cell = 0;
    for (block, &first_node) in blocks.iter().zip(&firsts) {
        let grid = Structured {
            dims: block.dims,
            first_node,
            first_cell,
        };
        let dims = cell_dims(block.dims);
        let step = block.dims.map(|n| usize::from(n > 1));
        let is_hidden = |cell: usize| {
            let n = cell - first_cell;
            let at = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            let has_absent = (0..8_usize).any(|c| {
                let corner = [0, 1, 2].map(|axis| at[axis] + (c >> axis & 1) * step[axis]);
                is_absent(grid.node(corner))
            });
            blanking.cell(cell) || has_absent
        };
        let hides = hides_any || block.nodes.iter().any(|p| !p.is_finite());
        match block.dims.iter().any(|&n| n < 2) {
            true => faces.add_layer(&grid, is_hidden),
            false => faces.add_grid(&grid, hides, |cell| hides && is_hidden(cell), place),
        }
        first_cell += dims.iter().product::<usize>();
    }
    faces.uncover(place);
    Ok(faces.end(place))
}

/// Finds the boundary of a mesh of cells.
fn of_cells(cells: &CellMesh, blanking: Blanking) -> BoundaryMesh {
    let blanking = blanking.of_mesh(cells);
    let place = |n: u32| cells.nodes[n as usize];
    let is_finite = cells.nodes.iter().all(|p| p.is_finite());
    let is_hidden = |cell: usize| {
        let mut is_hidden = blanking.cell(cell);
        if !is_finite {
            each_face(cells, cell, |face| {
                is_hidden |= !face.iter().all(|&n| place(n).is_finite());
            });
        }
        is_hidden
    };
    let mut faces = Faces::default();
    let mut corners = Vec::new();
    for Face {
        cell,
        nodes,
        is_of_solid,
    } in outer_faces(cells, is_hidden)
    {
        let number = index_u32(cell);
        if !is_of_solid {
            faces.flat.push((number, nodes));
            continue;
        }
        corners.clear();
        each_face(cells, cell, |face| corners.extend_from_slice(face));
        let inner = middle_of(&corners, place);
        faces
            .solid
            .extend(OuterFace::new(number, &nodes, place, inner));
    }
    faces.uncover(place);
    faces.end(place)
}
