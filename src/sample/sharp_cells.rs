//! Sharp boundaries of unstructured grids, by mirrors.
//!
//! Around each node of the boundary its faces make up to three tangent planes. The half of a dual cell
//! that a boundary node has is made whole by its mirror images in them, and nodes beside the boundary have
//! mirror images beyond it, as ghosts; their values go on linearly, 2 v0 - v with v0 that of the boundary
//! where the node's image meets it. Kernels are cut at the tangent planes of the nearest boundary nodes.
//! Plane walls come out as the mesh is inside; on curved ones planes are of second order in curvature
//! times spacing.
//!
//! The planes of one kernel bound a convex piece. At an edge that goes in, as that of an L, the domain is
//! none: nodes there keep their own dual cells and are cut by nothing.

use std::collections::HashMap;

use glam::{DMat3, DVec3};

use super::duals::Duals;
use super::index_u32;
use super::kernels::Kernel;
use super::sharp::{SharpParticle, edges};
use crate::constants::EDGE_REACH;
use crate::io::{CellMesh, polyhedron_faces};
use crate::math::{factor_of_variance, lower_matrix};
use crate::scene::Values;

/// Faces around a node whose normals have at least this cosine are of one plane.
const SAME_PLANE: f64 = 0.8;

/// How far a face may lie outside the plane of another, in shares of its distance, for the two to bound
/// a convex piece: faces of a curved wall are no planes.
const CONCAVE: f64 = 0.25;

/// Planes of a node at most.
const MOST_PLANES: usize = 3;

/// The ghosts of kernels farther from a plane than so many of their deviations reach nothing.
const GHOST_REACH: f64 = 3.5;

/// Nodes so many edges from the boundary are beside it.
const RINGS: usize = 2;

/// A tangent plane of the boundary at one of its nodes.
#[derive(Debug, Clone, Copy)]
struct Tangent {
    /// Into the domain.
    normal: DVec3,
    node: u32,
}

/// A face of the boundary: its nodes, its normal into the domain as long as its area, its middle.
struct Face {
    nodes: Vec<u32>,
    normal: DVec3,
    middle: DVec3,
}

/// The boundary of a mesh.
struct Surface {
    faces: Vec<Face>,
    /// The faces around each boundary node.
    around: HashMap<u32, Vec<u32>>,
}

/// What changes at the boundary, and which particles lie on edges that go in, ascending.
///
/// - `is_drawn`: whether a cell is.
/// - `particle`: which particle a node is, if it is any.
pub(super) fn sharp_cells(
    mesh: &CellMesh,
    duals: &Duals,
    is_drawn: impl Fn(usize) -> bool,
    particle: impl Fn(u32) -> Option<usize>,
    values: &Values,
    kernel_width: f64,
) -> (Vec<SharpParticle>, Vec<usize>) {
    let surface = Surface::new(mesh, duals, &is_drawn);
    let mut reentrant = Vec::new();
    let mut own: HashMap<u32, Vec<Tangent>> = HashMap::with_capacity(surface.around.len());
    for &node in surface.around.keys() {
        let planes = surface.planes(mesh, node);
        if planes.is_none() {
            reentrant.extend(particle(node));
        }
        own.insert(node, planes.unwrap_or_default());
    }
    reentrant.sort_unstable();
    let beside = beside(mesh, duals, &is_drawn, &own);
    let mut nodes: Vec<u32> = beside.keys().copied().collect();
    nodes.sort_unstable();
    let mut changes = Vec::new();
    for node in nodes {
        let Some(index) = particle(node) else {
            continue;
        };
        let near = &beside[&node];
        let incident = own.get(&node).map_or(&[][..], Vec::as_slice);
        if own.contains_key(&node) && incident.is_empty() {
            // On an edge that goes in.
            continue;
        }
        let change = Change {
            mesh,
            surface: &surface,
            values,
            kernel_width,
            index,
        };
        change.of_node(duals, node, incident, near, &particle, &mut changes);
    }
    (changes, reentrant)
}

/// A node beside the boundary.
struct Change<'a> {
    mesh: &'a CellMesh,
    surface: &'a Surface,
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
        particle: &impl Fn(u32) -> Option<usize>,
        changes: &mut Vec<SharpParticle>,
    ) {
        let origin = self.mesh.nodes[node as usize];
        let Some((mut volume, mut first, mut second)) = duals.cell(node as usize) else {
            return;
        };
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
            let kernel = Kernel::new(centre, lower, volume).ok()?;
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
        // An image in each plane, and in each two or three at once.
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
                    particle(n).map(|i| f64::from(self.values.get(i)))
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

/// The reflection in a plane through the origin.
fn mirror(n: DVec3) -> DMat3 {
    DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z) * 2.0
}

/// Calls `each` for the nodes of every face of a cell, the first of those at one position.
fn each_face(mesh: &CellMesh, duals: &Duals, cell: usize, mut each: impl FnMut(&[u32])) {
    let entries = mesh.cell(cell);
    let mut nodes = Vec::with_capacity(8);
    if let Some(faces) = mesh.kinds[cell].faces() {
        for face in faces {
            nodes.clear();
            nodes.extend(
                face.iter()
                    .map(|&i| duals.first_of(entries[usize::from(i)])),
            );
            each(&nodes);
        }
    } else {
        for face in polyhedron_faces(entries) {
            nodes.clear();
            nodes.extend(face.iter().map(|&n| duals.first_of(n)));
            each(&nodes);
        }
    }
}

impl Surface {
    /// The faces that one drawn cell has.
    fn new(mesh: &CellMesh, duals: &Duals, is_drawn: impl Fn(usize) -> bool) -> Self {
        let drawn = || (0..mesh.cell_count()).filter(|&c| mesh.kinds[c].is_solid() && is_drawn(c));
        let mut keys: Vec<([u32; 3], u32)> = Vec::new();
        for cell in drawn() {
            each_face(mesh, duals, cell, |face| {
                let mut sorted = face.to_vec();
                sorted.sort_unstable();
                sorted.dedup();
                if let [a, b, c, ..] = *sorted {
                    keys.push(([a, b, c], index_u32(cell)));
                }
            });
        }
        keys.sort_unstable();
        let once = |key: [u32; 3]| {
            let at = keys.partition_point(|(k, _)| *k < key);
            keys.get(at + 1).is_none_or(|(k, _)| *k != key)
        };
        let mut cells: Vec<u32> = keys
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|same| same.len() == 1)
            .map(|same| same[0].1)
            .collect();
        cells.sort_unstable();
        cells.dedup();
        let mut surface = Self {
            faces: Vec::new(),
            around: HashMap::new(),
        };
        for cell in cells {
            let mut all: Vec<Vec<u32>> = Vec::new();
            each_face(mesh, duals, cell as usize, |face| all.push(face.to_vec()));
            let node = |n: u32| mesh.nodes[n as usize];
            let corners: Vec<u32> = all.iter().flatten().copied().collect();
            let middle_of = |nodes: &[u32]| {
                nodes.iter().map(|&n| node(n)).sum::<DVec3>() / nodes.len().max(1) as f64
            };
            let inner = middle_of(&corners);
            for nodes in all {
                let mut sorted = nodes.clone();
                sorted.sort_unstable();
                sorted.dedup();
                let [a, b, c, ..] = *sorted else {
                    continue;
                };
                if !once([a, b, c]) {
                    continue;
                }
                let middle = middle_of(&nodes);
                let turned = (0..nodes.len()).map(|i| {
                    let (p, q) = (node(nodes[i]), node(nodes[(i + 1) % nodes.len()]));
                    (p - middle).cross(q - middle)
                });
                let area = turned.sum::<DVec3>() * 0.5;
                let normal = area * area.dot(inner - middle).signum();
                if !(normal.is_finite() && normal.length() > 0.0) {
                    continue;
                }
                let place = index_u32(surface.faces.len());
                for &n in &nodes {
                    surface.around.entry(n).or_default().push(place);
                }
                surface.faces.push(Face {
                    nodes,
                    normal,
                    middle,
                });
            }
        }
        surface
    }

    /// The tangent planes at a boundary node; `None` where they bound no convex piece.
    fn planes(&self, mesh: &CellMesh, node: u32) -> Option<Vec<Tangent>> {
        let origin = mesh.nodes[node as usize];
        // Sums of normals and of the faces' middles, both weighted by area.
        let mut groups: Vec<(DVec3, DVec3)> = Vec::new();
        let mut faces: Vec<&Face> = self
            .around
            .get(&node)?
            .iter()
            .map(|&f| &self.faces[f as usize])
            .collect();
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

    /// The value where the boundary around a node is met: linear over the triangles of its faces.
    fn value(
        &self,
        mesh: &CellMesh,
        node: u32,
        met: DVec3,
        value: impl Fn(u32) -> Option<f64>,
    ) -> Option<f64> {
        let at = |n: u32| mesh.nodes[n as usize];
        let mut best: Option<(f64, [(u32, f64); 3])> = None;
        for &face in self.around.get(&node)? {
            let nodes = &self.faces[face as usize].nodes;
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
                // How far outside the triangle, at worst.
                let least = weights.into_iter().fold(f64::INFINITY, f64::min);
                if best.is_none_or(|(score, _)| least > score) {
                    let weighted = [0, 1, 2].map(|k| (corners[k], weights[k]));
                    best = Some((least, weighted));
                }
            }
        }
        // Held to the triangle: far outside it, a linear value is any.
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

/// The tangent planes beside each node that is few edges from the boundary, those of the nearest nodes
/// first.
fn beside(
    mesh: &CellMesh,
    duals: &Duals,
    is_drawn: impl Fn(usize) -> bool,
    own: &HashMap<u32, Vec<Tangent>>,
) -> HashMap<u32, Vec<Tangent>> {
    let mut found = own.clone();
    for _ in 0..RINGS {
        let mut next: HashMap<u32, Vec<Tangent>> = HashMap::new();
        for cell in (0..mesh.cell_count()).filter(|&c| mesh.kinds[c].is_solid() && is_drawn(c)) {
            let mut corners = Vec::with_capacity(8);
            each_face(mesh, duals, cell, |face| corners.extend_from_slice(face));
            corners.sort_unstable();
            corners.dedup();
            let known: Vec<Tangent> = corners
                .iter()
                .filter_map(|n| found.get(n))
                .flatten()
                .copied()
                .collect();
            if known.is_empty() {
                continue;
            }
            for corner in corners {
                next.entry(corner).or_default().extend_from_slice(&known);
            }
        }
        for (node, mut tangents) in next {
            let at = mesh.nodes[node as usize];
            let distance = |t: &Tangent| mesh.nodes[t.node as usize].distance_squared(at);
            tangents.sort_by(|a, b| {
                distance(a)
                    .total_cmp(&distance(b))
                    .then(a.node.cmp(&b.node))
            });
            let mut kept: Vec<Tangent> = Vec::new();
            for tangent in tangents {
                // The nearest node's of each plane.
                if !kept
                    .iter()
                    .any(|t| t.normal.dot(tangent.normal) > SAME_PLANE)
                {
                    kept.push(tangent);
                }
            }
            found.insert(node, kept);
        }
    }
    found
}
