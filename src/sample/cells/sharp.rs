//! Makes sharp boundaries of unstructured grids, by mirror images.
//!
//! In one dimension, with nodes at 0, 1, 2, ... and the boundary at 0: kernels of the nodes add up to 1 inside,
//! but to 1/2 at 0, because nothing lies beyond. The node at 0 has half a dual cell; its mirror image adds the
//! other half, so that its kernel is whole. Node 1 gets a ghost at -1, node 2 one at -2. With the ghosts the
//! sum at 0 is 1, and every kernel is then cut at 0.
//!
//! Around each boundary node the faces form up to three tangent planes. The node's dual cell is half a cell;
//! its mirror images in the planes complete it. Nodes beside the boundary have mirror images beyond it, as
//! ghosts. Their values continue linearly: 2 v0 - v, with v0 the boundary's value where the line from the node
//! to its image meets it. Kernels are cut at the tangent planes of the nearest boundary nodes. Beside plane
//! walls kernels look like those inside the mesh; on curved walls planes are of second order in curvature times
//! spacing.
//!
//! The planes of one kernel bound a convex region. At a re-entrant edge, like that of an L, the domain is not
//! convex: nodes there keep their own dual cells and are not cut. The same holds for nodes at faces that others
//! cover in part. Faces that are covered entirely are no boundary ([`super::covered`]).
//!
//! Nodes at one position share a dual cell. Each has a kernel and images of its own share.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::covered::{OuterFace, Side, middle_of, sides};
use super::duals::Duals;
use super::incidence::{CellsAround, nodes_of};
use crate::constants::EDGE_REACH;
use crate::data::blanking::Blanking;
use crate::data::cells::CellMesh;
use crate::data::polyhedron::polyhedron_faces;
use crate::math::{factor_of_variance, lower_matrix};
use crate::parallel;
use crate::sample::kernels::Kernel;
use crate::sample::kernels::ghosts::SharpParticle;
use crate::sample::kernels::planes::edges;
use crate::sample::positions::index_u32;
use crate::scene::Values;

/// Faces around a node lie in one plane if the cosine between their normals is at least this.
pub(super) const SAME_PLANE: f64 = 0.8;

/// Tolerance for convexity: distance by which a face may lie outside the plane of another, as a share of the
/// face's distance. The faces of a curved wall do not lie in one plane.
pub(super) const CONCAVE: f64 = 0.25;

/// Greatest number of planes at a node.
const MOST_PLANES: usize = 3;

/// Greatest distance of a kernel from a plane, in standard deviations, at which its ghost reaches across.
const GHOST_REACH: f64 = 3.5;

/// Number of edges from the boundary within which nodes are beside it.
const RINGS: usize = 2;

/// A tangent plane of the boundary at one of its nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tangent {
    /// Normal into the domain.
    normal: DVec3,
    node: u32,
}

/// The cells of a mesh that are drawn and have a volume.
pub(in crate::sample) struct DrawnCells<'a> {
    pub(in crate::sample) mesh: &'a CellMesh,
    pub(in crate::sample) duals: &'a Duals,
    pub(in crate::sample) blanking: &'a Blanking,
}

/// The boundary of a mesh.
pub(in crate::sample) struct Surface {
    faces: Vec<OuterFace>,
    /// The nodes of the boundary, ascending.
    nodes: Vec<u32>,
    /// Index in `around` at which the faces at each node begin; one more entry at the end.
    starts: Vec<usize>,
    around: Vec<u32>,
    /// Nodes at which faces are covered in part, ascending.
    undecided: Vec<u32>,
}

/// Tangent planes of nodes.
struct Tangents {
    /// Index of each node's list; `NONE` if it has none.
    place_of: Vec<u32>,
    lists: Vec<Vec<Tangent>>,
}

impl Tangents {
    const NONE: u32 = u32::MAX;

    fn of(&self, node: u32) -> Option<&[Tangent]> {
        let place = self.place_of[node as usize];
        (place != Self::NONE).then(|| self.lists[place as usize].as_slice())
    }

    fn set(&mut self, node: u32, tangents: Vec<Tangent>) {
        let place = &mut self.place_of[node as usize];
        if *place == Self::NONE {
            *place = index_u32(self.lists.len());
            self.lists.push(tangents);
        } else {
            self.lists[*place as usize] = tangents;
        }
    }
}

/// Number of nodes whose changes make a piece.
const PIECE: usize = 1 << 10;

/// The changes that a sharp boundary makes.
pub(in crate::sample) struct SharpCells {
    /// In pieces, which are freed one after the other.
    pub(in crate::sample) changes: Vec<Vec<SharpParticle>>,
    /// Particles on re-entrant edges, which are not cut, ascending.
    pub(in crate::sample) reentrant: Vec<usize>,
    /// Particles at faces that are covered in part, which are not cut, ascending.
    pub(in crate::sample) undecided: Vec<usize>,
}

/// The particles of nodes, including nodes that share a position.
pub(in crate::sample) struct NodeParticles<'a> {
    /// The node of each particle, ascending.
    kept: &'a [u32],
    /// [`Duals::copies`].
    copies: Vec<(u32, u32)>,
}

impl<'a> NodeParticles<'a> {
    /// - `kept`: node of each particle, ascending.
    pub(in crate::sample) fn new(duals: &Duals, kept: &'a [u32]) -> Self {
        let copies = duals.copies();
        Self { kept, copies }
    }

    /// Returns the nodes at a position, given the first of them, and their particles. Nodes without a particle
    /// are left out.
    pub(in crate::sample) fn at(&self, first: u32) -> impl Iterator<Item = (u32, usize)> {
        let start = self.copies.partition_point(|&(own, _)| own < first);
        let copies = self.copies[start..].iter();
        let copies = copies.take_while(move |&&(own, _)| own == first);
        let alone = self.copies.is_empty().then_some(first);
        let nodes = alone.into_iter().chain(copies.map(|&(_, node)| node));
        nodes.filter_map(|node| Some((node, self.kept.binary_search(&node).ok()?)))
    }

    /// Returns the node of a particle.
    pub(super) fn node(&self, particle: usize) -> u32 {
        self.kept[particle]
    }

    /// Returns the first particle at a position.
    pub(super) fn first(&self, first: u32) -> Option<usize> {
        self.at(first).next().map(|(_, particle)| particle)
    }
}

/// Returns the changes that a sharp boundary makes to the particles of a mesh.
///
/// - `around`: the cells at each node.
/// - `values`: values of the particles.
pub(in crate::sample) fn sharp_cells(
    cells: &DrawnCells<'_>,
    surface: &Surface,
    around: &CellsAround,
    particles: &NodeParticles<'_>,
    values: &Values,
    kernel_width: f64,
) -> SharpCells {
    let mesh = cells.mesh;
    let of_surface = |n: usize| surface.planes(mesh, n);
    let planes: Vec<Option<Vec<Tangent>>> = parallel::map(surface.nodes.len(), of_surface);
    let (mut reentrant, mut undecided) = (Vec::new(), Vec::new());
    let mut own = Tangents {
        place_of: vec![Tangents::NONE; mesh.nodes.len()],
        lists: Vec::with_capacity(planes.len()),
    };
    for (&node, planes) in surface.nodes.iter().zip(planes) {
        if planes.is_none() {
            let list = match surface.is_undecided(node) {
                true => &mut undecided,
                false => &mut reentrant,
            };
            list.extend(particles.at(node).map(|(_, particle)| particle));
        }
        own.set(node, planes.unwrap_or_default());
    }
    reentrant.sort_unstable();
    undecided.sort_unstable();
    let beside = beside(cells, around, &own, &surface.nodes);
    let change = |&(node, ref near): &(u32, Vec<Tangent>)| {
        let mut changes = Vec::new();
        let incident = own.of(node);
        // Particles on a re-entrant edge are not cut.
        if incident != Some(&[]) {
            for (copy, index) in particles.at(node) {
                let change = Change {
                    mesh,
                    surface,
                    particles,
                    values,
                    kernel_width,
                    index,
                };
                let incident = incident.unwrap_or(&[]);
                change.of_node(cells.duals, copy, incident, near, &mut changes);
            }
        }
        changes
    };
    let pieces = beside.par_chunks(PIECE);
    let of_piece = |nodes: &[(u32, Vec<Tangent>)]| {
        let mut changes: Vec<SharpParticle> = nodes.iter().flat_map(change).collect();
        changes.shrink_to_fit();
        changes
    };
    SharpCells {
        changes: pieces.map(of_piece).collect(),
        reentrant,
        undecided,
    }
}

/// Context for changing the particle of a node beside the boundary.
struct Change<'a> {
    mesh: &'a CellMesh,
    surface: &'a Surface,
    particles: &'a NodeParticles<'a>,
    values: &'a Values,
    kernel_width: f64,
    index: usize,
}

impl Change<'_> {
    fn of_node(
        &self,
        duals: &Duals,
        node: u32,
        incident: &[Tangent],
        near: &[Tangent],
        changes: &mut Vec<SharpParticle>,
    ) {
        let origin = self.mesh.nodes[node as usize];
        let Some((mut volume, mut first, mut second)) = duals.cell(node as usize) else {
            return;
        };
        // Each of several nodes at one position has its own share.
        let share = duals.share(node as usize) / volume;
        for tangent in incident {
            let mirror = mirror(tangent.normal);
            volume *= 2.0;
            first += mirror * first;
            second += mirror * second * mirror;
        }
        let centre = origin + first / volume;
        let offset = first / volume;
        let covariance = second * (1.0 / volume)
            - DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
        let variance = covariance * (12.0 * self.kernel_width * self.kernel_width);
        let deviation = |n: DVec3| n.dot(variance * n).max(0.0).sqrt();
        let inside = |t: &Tangent, at: DVec3| t.normal.dot(at - self.mesh.nodes[t.node as usize]);
        let mut planes: Vec<Tangent> = incident.to_vec();
        let mut mirrors = Vec::new();
        for tangent in near {
            let is_known = |t: &Tangent| t.normal.dot(tangent.normal) > SAME_PLANE;
            let distance = inside(tangent, centre);
            if planes.iter().any(is_known)
                || distance <= 0.0
                || distance > f64::from(EDGE_REACH) * deviation(tangent.normal)
                || planes.len() == MOST_PLANES
            {
                continue;
            }
            planes.push(*tangent);
            if distance < GHOST_REACH * deviation(tangent.normal) {
                mirrors.push(*tangent);
            }
        }
        let planes: Vec<[DVec3; 2]> = planes
            .iter()
            .map(|t| [t.normal, self.mesh.nodes[t.node as usize]])
            .collect();
        let shaped = |centre: DVec3, variance: DMat3| {
            let [x, y, z] = [variance.x_axis, variance.y_axis, variance.z_axis];
            let lower = factor_of_variance([x.x, x.y, x.z, y.y, y.z, z.z])?;
            let kernel = Kernel::new(centre, lower, volume * share).ok()?;
            Some((kernel, edges(&planes, centre, &lower_matrix(lower))))
        };
        let Some((kernel, own_edges)) = shaped(centre, variance) else {
            return;
        };
        if own_edges.is_none() {
            return;
        }
        changes.push(SharpParticle {
            sources: [self.index; 2],
            is_ghost: false,
            kernel: (!incident.is_empty()).then_some(kernel),
            value: None,
            edges: own_edges,
        });
        // One image in each plane, and in each pair and triple of planes.
        for images in 1..1_usize << mirrors.len() {
            let (mut at, mut shape) = (centre, variance);
            let mut value = f64::from(self.values.get(self.index));
            for (_, tangent) in mirrors
                .iter()
                .enumerate()
                .filter(|(i, _)| images >> i & 1 == 1)
            {
                let distance = inside(tangent, at);
                let met = at - tangent.normal * distance;
                let at_wall = self.surface.value(self.mesh, tangent.node, met, |n| {
                    let particle = self.particles.first(n)?;
                    Some(f64::from(self.values.get(particle)))
                });
                let own = f64::from(self.values.get(self.index));
                value += at_wall.map_or(0.0, |v| 2.0 * (v - own));
                at -= tangent.normal * (2.0 * distance);
                let mirror = mirror(tangent.normal);
                shape = mirror * shape * mirror;
            }
            if let Some((kernel, edges)) = shaped(at, shape) {
                changes.push(SharpParticle {
                    sources: [self.index; 2],
                    is_ghost: true,
                    kernel: Some(kernel),
                    value: Some(value),
                    edges,
                });
            }
        }
    }
}

/// Returns the reflection in a plane through the origin.
pub(super) fn mirror(n: DVec3) -> DMat3 {
    DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z) * 2.0
}

/// Returns a key that identifies a face whatever the order of its nodes: the lowest node, and a hash of all
/// distinct nodes. Returns `None` for fewer than three nodes.
pub(in crate::sample) fn key(face: &[u32]) -> Option<(u32, [u32; 2])> {
    let (mut lowest, mut count, mut hash) = (u32::MAX, 0_u64, 0_u64);
    for (i, &node) in face.iter().enumerate() {
        if face[..i].contains(&node) {
            continue;
        }
        lowest = lowest.min(node);
        count += 1;
        hash = hash.wrapping_add(mixed(u64::from(node) + 1));
    }
    let hash = mixed(hash.wrapping_add(count));
    #[expect(clippy::cast_possible_truncation, reason = "the halves of a hash")]
    let halves = [(hash >> 32) as u32, hash as u32];
    (count > 2).then_some((lowest, halves))
}

/// Mixes bits: each bit of the input flips half of the output on average (splitmix64).
fn mixed(x: u64) -> u64 {
    let x = x.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl DrawnCells<'_> {
    pub(super) fn is_drawn(&self, cell: usize) -> bool {
        self.mesh.kinds[cell].is_solid()
            && !self.blanking.cell(cell)
            && !self.duals.is_left_out(cell)
    }

    /// Calls `each` for the nodes of every face of a cell; each node is replaced by the first at its position.
    /// `nodes` is scratch space.
    fn each_face(&self, cell: usize, nodes: &mut Vec<u32>, mut each: impl FnMut(&[u32])) {
        let entries = self.mesh.cell(cell);
        let mut visit = |face: &mut dyn Iterator<Item = u32>| {
            nodes.clear();
            nodes.extend(face.map(|n| self.duals.first_of(n)));
            each(nodes);
        };
        match self.mesh.kinds[cell].faces() {
            Some(faces) => {
                for face in faces {
                    visit(&mut face.iter().map(|&i| entries[usize::from(i)]));
                }
            }
            None => {
                for face in polyhedron_faces(entries) {
                    visit(&mut face.iter().copied());
                }
            }
        }
    }

    /// Collects the corners of a cell, ascending; each node is replaced by the first at its position.
    pub(super) fn corners(&self, cell: usize, corners: &mut Vec<u32>) {
        self.own_corners(cell, corners);
        for corner in corners.iter_mut() {
            *corner = self.duals.first_of(*corner);
        }
        corners.sort_unstable();
        corners.dedup();
    }

    /// Collects the corners of a cell; nodes may repeat.
    pub(super) fn own_corners(&self, cell: usize, corners: &mut Vec<u32>) {
        let entries = self.mesh.cell(cell);
        corners.clear();
        match self.mesh.kinds[cell].faces() {
            Some(faces) => {
                // Corners precede the other nodes of a cell of higher order.
                let places = faces.iter().flat_map(|face| face.iter());
                let count = places.max().map_or(0, |&last| usize::from(last) + 1);
                corners.extend(&entries[..count]);
            }
            None => corners.extend(polyhedron_faces(entries).flatten()),
        }
    }

    /// Returns true if two cells that share a face are the same cell, stated twice.
    fn are_one(&self, a: usize, b: usize) -> bool {
        let sum = |cell: usize| {
            let corners = nodes_of(self.mesh, cell).map(|n| u64::from(self.duals.first_of(n)));
            corners.fold(0, u64::wrapping_add)
        };
        if self.mesh.kinds[a] != self.mesh.kinds[b] || sum(a) != sum(b) {
            return false;
        }
        let (mut of_a, mut of_b) = (Vec::new(), Vec::new());
        self.corners(a, &mut of_a);
        self.corners(b, &mut of_b);
        of_a == of_b
    }

    /// Returns the nodes of all faces that belong to one cell alone, ascending, covered or not.
    pub(in crate::sample) fn outer_nodes(&self) -> Vec<u32> {
        let (mut found, mut nodes) = (Vec::new(), Vec::new());
        for of_cell in self.outer_faces().chunk_by(|x, y| x.0 == y.0) {
            self.each_face(of_cell[0].0 as usize, &mut nodes, |face| {
                let key = key(face).map(|(_, key)| key);
                if of_cell.iter().any(|(_, outer)| Some(*outer) == key) {
                    found.extend_from_slice(face);
                }
            });
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Returns the keys of the faces that belong to one cell alone, each with that cell, ascending by cell.
    fn outer_faces(&self) -> Vec<(u32, [u32; 2])> {
        let mesh = self.mesh;
        let each_key = |visit: &mut dyn FnMut((u32, [u32; 2]), usize)| {
            let mut nodes = Vec::new();
            for cell in (0..mesh.cell_count()).filter(|&cell| self.is_drawn(cell)) {
                self.each_face(cell, &mut nodes, |face| {
                    if let Some(key) = key(face) {
                        visit(key, cell);
                    }
                });
            }
        };
        // Sort by the lowest node first: the remaining lists are short.
        let mut starts = vec![0; mesh.nodes.len() + 1];
        each_key(&mut |(lowest, _), _| starts[lowest as usize + 1] += 1);
        for node in 0..mesh.nodes.len() {
            starts[node + 1] += starts[node];
        }
        let mut next = starts.clone();
        let mut faces = vec![[0; 3]; starts[mesh.nodes.len()]];
        each_key(&mut |(lowest, [a, b]), cell| {
            let next = &mut next[lowest as usize];
            faces[*next] = [a, b, index_u32(cell)];
            *next += 1;
        });
        drop(next);
        let mut rest = faces.as_mut_slice();
        let mut of_nodes = Vec::with_capacity(mesh.nodes.len());
        for node in 0..mesh.nodes.len() {
            let (own, others) = rest.split_at_mut(starts[node + 1] - starts[node]);
            of_nodes.push(own);
            rest = others;
        }
        let is_alone = |same: &&[[u32; 3]]| {
            let first = same[0][2] as usize;
            let mut others = same[1..].iter();
            others.all(|other| self.are_one(first, other[2] as usize))
        };
        let alone = |faces: &mut [[u32; 3]]| {
            faces.sort_unstable();
            let same = faces.chunk_by(|x, y| x[..2] == y[..2]);
            let alone = same
                .filter(is_alone)
                .map(|same| (same[0][2], [same[0][0], same[0][1]]));
            alone.collect::<Vec<_>>()
        };
        let mut outer: Vec<(u32, [u32; 2])> =
            of_nodes.into_par_iter().flat_map_iter(alone).collect();
        outer.par_sort_unstable();
        outer
    }
}

impl Surface {
    /// Collects the faces that belong to one drawn cell and that no others cover.
    pub(in crate::sample) fn new(cells: &DrawnCells<'_>) -> Self {
        let node = |n: u32| cells.mesh.nodes[n as usize];
        let (mut nodes, mut corners) = (Vec::new(), Vec::new());
        let mut faces: Vec<OuterFace> = Vec::new();
        for of_cell in cells.outer_faces().chunk_by(|x, y| x.0 == y.0) {
            let cell = of_cell[0].0;
            corners.clear();
            cells.each_face(cell as usize, &mut nodes, |face| {
                corners.extend_from_slice(face);
            });
            let inner = middle_of(&corners, node);
            cells.each_face(cell as usize, &mut nodes, |face| {
                let is_outer = |key: [u32; 2]| of_cell.iter().any(|(_, outer)| *outer == key);
                if !key(face).is_some_and(|(_, key)| is_outer(key)) {
                    return;
                }
                faces.extend(OuterFace::new(cell, face, node, inner));
            });
        }
        let sides = sides(&cells.mesh.nodes, &faces);
        // The nodes of each face, and the state of its far side there.
        let mut all: Vec<(u32, u32, Side)> = Vec::new();
        for (place, (face, sides)) in faces.iter().zip(&sides).enumerate() {
            for (i, &node) in face.nodes.iter().enumerate() {
                let side = sides.as_ref().map_or(Side::Open, |sides| sides[i]);
                all.push((node, index_u32(place), side));
            }
        }
        all.par_sort_unstable_by_key(|&(node, place, _)| (node, place));
        let mut surface = Self {
            faces,
            nodes: Vec::new(),
            starts: Vec::new(),
            around: Vec::with_capacity(all.len()),
            undecided: Vec::new(),
        };
        for of_node in all.chunk_by(|x, y| x.0 == y.0) {
            let has = |side: Side| of_node.iter().any(|own| own.2 == side);
            let is_undecided = has(Side::Partly) || (has(Side::Rim) && has(Side::Open));
            if !is_undecided && !has(Side::Open) {
                continue;
            }
            let node = of_node[0].0;
            if is_undecided {
                surface.undecided.push(node);
            }
            surface.nodes.push(node);
            surface.starts.push(surface.around.len());
            let open = of_node.iter().filter(|own| own.2 == Side::Open);
            surface.around.extend(open.map(|own| own.1));
        }
        surface.starts.push(surface.around.len());
        surface
    }

    pub(super) fn is_undecided(&self, node: u32) -> bool {
        self.undecided.binary_search(&node).is_ok()
    }

    /// Returns the nodes of the boundary, ascending.
    pub(in crate::sample) fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Returns a face.
    pub(super) fn face(&self, face: u32) -> &OuterFace {
        &self.faces[face as usize]
    }

    /// Returns the open faces at a node, which must be the first at its position; `None` if it is not on the
    /// boundary, or if faces there are covered in part.
    pub(super) fn faces_at(&self, node: u32) -> Option<&[u32]> {
        let n = self.nodes.binary_search(&node).ok()?;
        let is_known = !self.is_undecided(node);
        is_known.then(|| &self.around[self.starts[n]..self.starts[n + 1]])
    }

    /// Returns the faces around the `n`-th node.
    fn faces_around(&self, n: usize) -> impl Iterator<Item = &OuterFace> {
        let around = &self.around[self.starts[n]..self.starts[n + 1]];
        around.iter().map(|&face| &self.faces[face as usize])
    }

    /// Returns the tangent planes at the `n`-th boundary node; `None` if they bound no convex region.
    fn planes(&self, mesh: &CellMesh, n: usize) -> Option<Vec<Tangent>> {
        let node = self.nodes[n];
        if self.is_undecided(node) {
            return None;
        }
        let origin = mesh.nodes[node as usize];
        // Sums of normals and of the faces' middles, both weighted by area.
        let mut groups: Vec<(DVec3, DVec3)> = Vec::new();
        let mut faces: Vec<&OuterFace> = self.faces_around(n).collect();
        faces.sort_by(|a, b| b.normal.length().total_cmp(&a.normal.length()));
        for face in faces {
            let unit = face.normal.normalize_or_zero();
            let aside = (face.middle - origin) * face.normal.length();
            let same = groups
                .iter_mut()
                .find(|(normal, _)| normal.normalize_or_zero().dot(unit) > SAME_PLANE);
            match same {
                Some((normal, middle)) => {
                    *normal += face.normal;
                    *middle += aside;
                }
                None => groups.push((face.normal, aside)),
            }
        }
        if groups.len() > MOST_PLANES {
            return None;
        }
        for (i, (normal, _)) in groups.iter().enumerate() {
            for (j, (other, middle)) in groups.iter().enumerate() {
                let aside = *middle / other.length();
                let height = normal.normalize_or_zero().dot(aside);
                if i != j && height < -CONCAVE * aside.length() {
                    return None;
                }
            }
        }
        let tangent = |(normal, _): &(DVec3, DVec3)| Tangent {
            normal: normal.normalize_or_zero(),
            node,
        };
        Some(groups.iter().map(tangent).collect())
    }

    /// Returns the value at a point of the boundary near a node, linear over the triangles of the node's faces.
    fn value(
        &self,
        mesh: &CellMesh,
        node: u32,
        met: DVec3,
        value: impl Fn(u32) -> Option<f64>,
    ) -> Option<f64> {
        let at = |n: u32| mesh.nodes[n as usize];
        let mut best: Option<(f64, [(u32, f64); 3])> = None;
        for face in self.faces_around(self.nodes.binary_search(&node).ok()?) {
            let nodes = &face.nodes;
            for i in 1..nodes.len().saturating_sub(1) {
                let corners = [nodes[0], nodes[i], nodes[i + 1]];
                let [a, b, c] = corners.map(at);
                let (u, v, w) = (b - a, c - a, met - a);
                let across = u.cross(v);
                let area = across.length_squared();
                if !(area > 0.0) {
                    continue;
                }
                let p = w.cross(v).dot(across) / area;
                let q = u.cross(w).dot(across) / area;
                let weights = [1.0 - p - q, p, q];
                // The least weight states how far outside the triangle the point lies.
                let least = weights.into_iter().fold(f64::INFINITY, f64::min);
                if best.is_none_or(|(score, _)| least > score) {
                    let weighted = [0, 1, 2].map(|k| (corners[k], weights[k]));
                    best = Some((least, weighted));
                }
            }
        }
        // Clamped to the triangle: far outside it, a linear extrapolation is meaningless.
        let (_, weighted) = best?;
        let held = weighted.map(|(n, w)| (n, w.max(0.0)));
        let total: f64 = held.iter().map(|(_, w)| w).sum();
        let mut sum = 0.0;
        for (n, weight) in held {
            sum += value(n)? * weight / total;
        }
        Some(sum)
    }
}

/// Returns the nodes within a few edges of the boundary, ascending, with the tangent planes near each. Planes
/// of the nearest boundary nodes come first.
///
/// - `own`: the planes of the nodes in `on_boundary`.
fn beside(
    cells: &DrawnCells<'_>,
    around: &CellsAround,
    own: &Tangents,
    on_boundary: &[u32],
) -> Vec<(u32, Vec<Tangent>)> {
    let mesh = cells.mesh;
    let drawn = |node: u32| {
        let cells_of = around.of(node).iter().map(|&cell| cell as usize);
        cells_of.filter(|&cell| cells.is_drawn(cell))
    };
    let mut found = Tangents {
        place_of: own.place_of.clone(),
        lists: own.lists.clone(),
    };
    let mut reached = on_boundary.to_vec();
    for _ in 0..RINGS {
        let mut is_reached = vec![false; mesh.nodes.len()];
        let mut corners = Vec::new();
        // Nodes without a plane add none.
        let with_planes = |node: &&u32| found.of(**node).is_some_and(|planes| !planes.is_empty());
        for cell in reached
            .iter()
            .filter(with_planes)
            .flat_map(|&node| drawn(node))
        {
            cells.corners(cell, &mut corners);
            for &corner in &corners {
                is_reached[corner as usize] = true;
            }
        }
        let next: Vec<u32> = (0..mesh.nodes.len())
            .filter(|&node| is_reached[node])
            .map(index_u32)
            .collect();
        let tangents = |&node: &u32| {
            let mut corners = Vec::new();
            let mut sources = Vec::new();
            for cell in drawn(node) {
                cells.corners(cell, &mut corners);
                if corners.binary_search(&node).is_ok() {
                    sources.extend_from_slice(&corners);
                }
            }
            nearest(mesh, node, &once_each(sources), &found)
        };
        let lists: Vec<Vec<Tangent>> = parallel::map(next.len(), |i| tangents(&next[i]));
        for (&node, list) in next.iter().zip(lists) {
            found.set(node, list);
        }
        reached.extend(next);
        reached.sort_unstable();
        reached.dedup();
    }
    let taken = |node: u32| (node, found.of(node).unwrap_or(&[]).to_vec());
    reached.into_iter().map(taken).collect()
}

/// Removes repetitions; keeps the order of first occurrence.
fn once_each(nodes: Vec<u32>) -> Vec<u32> {
    let mut places: Vec<(u32, u32)> = nodes.into_iter().zip(0..).collect();
    places.sort_unstable();
    places.dedup_by_key(|(node, _)| *node);
    places.sort_unstable_by_key(|(_, place)| *place);
    places.into_iter().map(|(node, _)| node).collect()
}

/// Returns the tangent planes that `found` has for some nodes, from near to far. Of nearly equal planes the
/// nearest node's is kept.
fn nearest(mesh: &CellMesh, node: u32, sources: &[u32], found: &Tangents) -> Vec<Tangent> {
    let at = mesh.nodes[node as usize];
    let planes = sources.iter().filter_map(|&source| found.of(source));
    let mut tangents: Vec<(f64, Tangent)> = planes
        .flatten()
        .map(|t| (mesh.nodes[t.node as usize].distance_squared(at), *t))
        .collect();
    tangents.sort_by(|(a, t), (b, u)| a.total_cmp(b).then(t.node.cmp(&u.node)));
    let mut kept: Vec<Tangent> = Vec::new();
    for (_, tangent) in tangents {
        if !kept
            .iter()
            .any(|t| t.normal.dot(tangent.normal) > SAME_PLANE)
        {
            kept.push(tangent);
        }
    }
    kept
}
