//! Computes dual cells of unstructured grids: the parts of solid cells that belong to their corners.
//!
//! Every solid cell is cut at the centres of its edges, its faces and itself (the barycentric dual). The parts
//! are sums of tetrahedra, whose volume and moments are exact; the parts of a tetrahedron have closed forms.
//! The parts around a node make up its dual cell, with a volume, a centroid and a covariance.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::handedness::Handedness;
use crate::data::polyhedron::polyhedron_faces;
use crate::error::Result;
use crate::sample::left_out::LeftOut;
use crate::sample::points::neighbours::square;
use crate::sample::positions::index_u32;
use crate::sample::positions::{is_same, sort_by_position};
use crate::sample::report::SampleReport;
use crate::task::{Stage, Task};

/// A cell is degenerate if its volume is below this share of its longest extent cubed. A cell that is a
/// millionth as thick and as narrow as it is long passes.
const DEGENERATE_VOLUME: f64 = 1e-12;

/// Number of cells whose parts one task computes at a time.
const CHUNK: usize = 1024;

/// Number of chunks whose parts are held in memory at a time: enough for many threads, little memory.
const CHUNKS_AT_ONCE: usize = 16;

/// Volume and moments of a region, relative to a point.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::sample) struct Moments {
    pub(in crate::sample) volume: f64,
    /// ∫ x dV.
    pub(in crate::sample) first: DVec3,
    /// ∫ x xᵀ dV: xx, xy, xz, yy, yz, zz.
    second: [f64; 6],
}

impl Moments {
    /// Moments of the tetrahedron 0, u, v, w, with the sign of its determinant.
    fn tetrahedron(u: DVec3, v: DVec3, w: DVec3) -> Self {
        let volume = DMat3::from_cols(u, v, w).determinant() / 6.0;
        let sum = u + v + w;
        let squares = [square(u), square(v), square(w), square(sum)];
        Self {
            volume,
            first: sum * (volume / 4.0),
            second: std::array::from_fn(|i| {
                squares.iter().map(|s| s[i]).sum::<f64>() * volume / 20.0
            }),
        }
    }

    fn add(&mut self, other: &Self) {
        self.volume += other.volume;
        self.first += other.first;
        for (a, b) in self.second.iter_mut().zip(other.second) {
            *a += b;
        }
    }

    fn scale(&mut self, factor: f64) {
        self.volume *= factor;
        self.first *= factor;
        self.second = self.second.map(|s| s * factor);
    }

    fn covariance(&self) -> [f64; 6] {
        let centroid = square(self.first / self.volume);
        std::array::from_fn(|i| self.second[i] / self.volume - centroid[i])
    }
}

/// Moments of the barycentric coordinates over the quarter of a tetrahedron that belongs to corner 0, where l0
/// is the greatest: E\[li\], E\[li²\] and E\[li lj\] for i, j > 0.
const QUARTER_FIRST: f64 = 23.0 / 144.0;
const QUARTER_SQUARE: f64 = 161.0 / 4320.0;
const QUARTER_PRODUCT: f64 = 97.0 / 4320.0;

/// Appends the corners of one solid cell, each with the moments of its part relative to it. Returns the cell's
/// signed volume and its centroid.
pub(in crate::sample) fn cut(
    mesh: &CellMesh,
    cell: usize,
    parts: &mut Vec<(u32, Moments)>,
) -> (f64, DVec3) {
    let kind = mesh.kinds[cell];
    let entries = mesh.cell(cell);
    let node = |i: u32| mesh.nodes[i as usize];
    if kind == CellKind::TETRA {
        let origin = node(entries[0]);
        let corners = [0, 1, 2, 3].map(|i| node(entries[i]) - origin);
        let [_, u, v, w] = corners;
        let volume = DMat3::from_cols(u, v, w).determinant() / 6.0;
        for (corner, &n) in corners.iter().zip(entries) {
            let sides = corners.map(|c| c - corner);
            let sum = sides[0] + sides[1] + sides[2] + sides[3];
            let squares = sides.map(square);
            let product = square(sum);
            let quarter = volume / 4.0;
            let second = |i: usize| {
                let own: f64 = squares.iter().map(|s| s[i]).sum();
                quarter * ((QUARTER_SQUARE - QUARTER_PRODUCT) * own + QUARTER_PRODUCT * product[i])
            };
            let part = Moments {
                volume: quarter,
                first: sum * (quarter * QUARTER_FIRST),
                second: std::array::from_fn(second),
            };
            parts.push((n, part));
        }
        return (volume, origin + (u + v + w) / 4.0);
    }

    let first_part = parts.len();
    let corner = |n: u32| (n, Moments::default());
    match kind.faces() {
        Some(faces) => {
            let places = faces.iter().flat_map(|f| f.iter());
            parts.extend(places.map(|&i| corner(entries[usize::from(i)])));
        }
        None => parts.extend(polyhedron_faces(entries).flatten().map(|&n| corner(n))),
    }
    parts[first_part..].sort_unstable_by_key(|(n, _)| *n);
    let mut last = None;
    let mut unique = first_part;
    for i in first_part..parts.len() {
        if last != Some(parts[i].0) {
            last = Some(parts[i].0);
            parts[unique] = parts[i];
            unique += 1;
        }
    }
    parts.truncate(unique);
    let parts = &mut parts[first_part..];
    let Some((first, _)) = parts.first() else {
        return (0.0, DVec3::ZERO);
    };
    // Relative to a corner, so that a distant origin costs no digits.
    let origin = node(*first);
    let centre = parts.iter().map(|(n, _)| node(*n) - origin).sum::<DVec3>() / parts.len() as f64;
    let mut face_nodes: Vec<u32> = Vec::with_capacity(8);
    let mut add_face = |face_nodes: &[u32], sign: f64| {
        let corner = |i: usize| node(face_nodes[i % face_nodes.len()]) - origin;
        let count = face_nodes.len();
        let middle = (0..count).map(corner).sum::<DVec3>() / count as f64;
        for (i, n) in face_nodes.iter().enumerate() {
            let a = corner(i);
            let (next, previous) = (corner(i + 1), corner(i + count - 1));
            let (face, cell) = (middle - a, centre - a);
            let mut part = Moments::tetrahedron((next - a) * 0.5, face, cell);
            part.add(&Moments::tetrahedron(face, (previous - a) * 0.5, cell));
            // For faces that are anticlockwise seen from outside, these tetrahedra have negative determinants.
            part.scale(-sign);
            if let Ok(place) = parts.binary_search_by_key(n, |(m, _)| *m) {
                parts[place].1.add(&part);
            }
        }
    };
    match kind.faces() {
        Some(faces) => {
            for face in faces {
                face_nodes.clear();
                face_nodes.extend(face.iter().map(|&i| entries[usize::from(i)]));
                add_face(&face_nodes, 1.0);
            }
        }
        None => {
            let is_closed = faces_are_of_one_sense(entries);
            for face in polyhedron_faces(entries) {
                let corner = |i: usize| node(face[i % face.len()]) - origin;
                let normal: DVec3 = (0..face.len())
                    .map(|i| corner(i).cross(corner(i + 1)))
                    .sum();
                let inward = !is_closed && normal.dot(corner(0) - centre) < 0.0;
                add_face(face, if inward { -1.0 } else { 1.0 });
            }
        }
    }
    // A polyhedron may list all its faces as seen from inside.
    let inside_out =
        kind == CellKind::POLYHEDRON && parts.iter().map(|(_, m)| m.volume).sum::<f64>() < 0.0;
    if inside_out {
        parts.iter_mut().for_each(|(_, m)| m.scale(-1.0));
    }
    let mut volume = 0.0;
    let mut moment = DVec3::ZERO;
    for (n, part) in parts.iter() {
        volume += part.volume;
        moment += part.first + (node(*n) - origin) * part.volume;
    }
    // At a corner that bends inwards the share may be negative. That corner then gets none, and the others give
    // up as much.
    let positive: f64 = parts.iter().map(|(_, m)| m.volume.max(0.0)).sum();
    if volume > 0.0 && positive > volume * (1.0 + f64::EPSILON * 64.0) {
        for (_, part) in parts.iter_mut() {
            let share = if part.volume > 0.0 {
                volume / positive
            } else {
                0.0
            };
            part.scale(share);
        }
    }
    (volume, origin + moment / volume)
}

/// Returns true if all faces of a polyhedron have one orientation: each edge is used once in each direction.
/// Files disagree about the orientation of faces. If the faces of one cell disagree, too, the cell's centre
/// decides, which is right for all cells that are star-shaped about it.
fn faces_are_of_one_sense(entries: &[u32]) -> bool {
    let ends = |face: &[u32], i: usize| (face[i], face[(i + 1) % face.len()]);
    let mut edges: Vec<(u32, u32)> = polyhedron_faces(entries)
        .flat_map(|face| (0..face.len()).map(move |i| ends(face, i)))
        .collect();
    edges.sort_unstable();
    let once = edges.windows(2).all(|pair| pair[0] != pair[1]);
    once && edges
        .iter()
        .all(|&(a, b)| edges.binary_search(&(b, a)).is_ok())
}

/// The dual cells of all nodes.
///
/// Nodes at one position share one dual cell; they occur at the seams of a parallel file's pieces, and in
/// meshes that share no nodes. Each such node keeps its own share of the volume: their kernels have the same
/// shape and place.
pub(in crate::sample) struct Duals {
    /// Moments of the whole dual cell, stored at the first node of each position; empty once they are dropped.
    moments: Vec<Moments>,
    /// First node at the position of each node; empty if no two nodes coincide.
    pub(in crate::sample) first: Vec<u32>,
    /// Volume of each node's own share; empty if `first` is.
    shares: Vec<f64>,
    /// Solid cells that are left out for a fault, ascending.
    left_out: Vec<u32>,
    /// Orientation of the cells of each kind.
    pub(in crate::sample) handedness: [Handedness; 256],
}

/// Six times the signed volume of a cell of fixed shape, with its faces cut into triangles: enough to find the
/// orientation of most cells of a kind. Returns 0 for all other cells.
fn rough_volume(mesh: &CellMesh, cell: usize) -> f64 {
    let Some(faces) = mesh.kinds[cell].faces() else {
        return 0.0;
    };
    let entries = mesh.cell(cell);
    let origin = mesh.nodes[entries[0] as usize];
    let corner = |i: u8| mesh.nodes[entries[usize::from(i)] as usize] - origin;
    let fans = faces.iter().flat_map(|face| {
        face.windows(2)
            .skip(1)
            .map(move |pair| (face[0], pair[0], pair[1]))
    });
    fans.map(|(a, b, c)| corner(a).dot(corner(b).cross(corner(c))))
        .sum()
}

/// Returns the longest extent of a cell's bounding box.
fn extent(mesh: &CellMesh, parts: &[(u32, Moments)]) -> f64 {
    let nodes = || parts.iter().map(|(n, _)| mesh.nodes[*n as usize]);
    let low = nodes().fold(DVec3::INFINITY, DVec3::min);
    let high = nodes().fold(DVec3::NEG_INFINITY, DVec3::max);
    (high - low).max_element()
}

/// Returns a cell's volume if it has the right sign.
pub(in crate::sample) fn sound_volume(
    mesh: &CellMesh,
    kind: CellKind,
    parts: &[(u32, Moments)],
    volume: f64,
    handedness: &[Handedness; 256],
) -> Result<f64, LeftOut> {
    if parts
        .iter()
        .any(|(n, _)| !mesh.nodes[*n as usize].is_finite())
    {
        return Err(LeftOut::Position);
    }
    let volume = volume * handedness[usize::from(kind.0)].sign(volume);
    let least = DEGENERATE_VOLUME * extent(mesh, parts).powi(3);
    if volume > 0.0 && volume > least && volume.is_finite() {
        Ok(volume)
    } else {
        Err(LeftOut::Degenerate)
    }
}

/// Counts the cells of each kind in either orientation.
pub(crate) fn turned(mesh: &CellMesh) -> Vec<[usize; 2]> {
    (0..mesh.cell_count())
        .into_par_iter()
        .with_min_len(CHUNK)
        .fold(
            || vec![[0_usize; 2]; 256],
            |mut counts, cell| {
                let volume = rough_volume(mesh, cell);
                if volume > 0.0 {
                    counts[usize::from(mesh.kinds[cell].0)][0] += 1;
                } else if volume < 0.0 {
                    counts[usize::from(mesh.kinds[cell].0)][1] += 1;
                }
                counts
            },
        )
        .reduce(
            || vec![[0; 2]; 256],
            |mut a, b| {
                for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
                    *a += b;
                }
                a
            },
        )
}

impl Duals {
    /// - `turned`: for each kind of cell, the number of cells in either orientation.
    /// - `own`: the cells whose faults go into the report.
    pub(in crate::sample) fn new(
        mesh: &CellMesh,
        blanking: &Blanking,
        turned: &[[usize; 2]],
        own: &Range<usize>,
        report: &mut SampleReport,
        task: Option<&Task>,
    ) -> Result<Self> {
        let of_kind = |kind: usize| turned.get(kind).copied().unwrap_or_default();
        let handedness = std::array::from_fn(|kind| Handedness::of(of_kind(kind)));
        let mut duals = Self {
            moments: vec![Moments::default(); mesh.nodes.len()],
            first: Vec::new(),
            shares: Vec::new(),
            left_out: Vec::new(),
            handedness,
        };
        let mut faults = Vec::new();
        let count = mesh.cell_count();
        let stage = Stage::new(task, "cutting cells", count);
        for first in (0..count).step_by(CHUNK * CHUNKS_AT_ONCE) {
            stage.check()?;
            let chunks: Vec<_> = (first..count.min(first + CHUNK * CHUNKS_AT_ONCE))
                .into_par_iter()
                .with_min_len(CHUNK)
                .fold(
                    || (Vec::new(), Vec::new()),
                    |(mut parts, mut faults), cell| {
                        let kind = mesh.kinds[cell];
                        if !kind.is_solid() || blanking.cell(cell) {
                            return (parts, faults);
                        }
                        let first_part = parts.len();
                        let (volume, _) = cut(mesh, cell, &mut parts);
                        let of_cell = &parts[first_part..];
                        match sound_volume(mesh, kind, of_cell, volume, &handedness) {
                            Ok(_) => {
                                let sign = handedness[usize::from(kind.0)].sign(volume);
                                let of_cell = &mut parts[first_part..];
                                of_cell.iter_mut().for_each(|(_, m)| m.scale(sign));
                            }
                            Err(fault) => {
                                parts.truncate(first_part);
                                faults.push((index_u32(cell), fault));
                            }
                        }
                        (parts, faults)
                    },
                )
                .collect();
            // In the order of the cells, so that sums do not depend on the number of threads.
            for (parts, mut found) in chunks {
                for (node, part) in &parts {
                    duals.moments[*node as usize].add(part);
                }
                faults.append(&mut found);
            }
            stage.advance(CHUNK * CHUNKS_AT_ONCE);
        }
        duals.weld(mesh);
        duals.left_out = faults.iter().map(|(cell, _)| *cell).collect();
        duals.left_out.sort_unstable();
        faults.retain(|(cell, _)| own.contains(&(*cell as usize)));
        let of = |fault: LeftOut| faults.iter().filter(|(_, f)| *f == fault).count();
        report.note(
            of(LeftOut::Degenerate),
            "cells",
            "without volume, or inverted against the others of their kind: left out of their nodes' volumes",
        );
        report.note(
            of(LeftOut::Position),
            "cells",
            "with a corner that is not finite: left out of their nodes' volumes",
        );
        Ok(duals)
    }

    /// Gives nodes at one position their common dual cell.
    fn weld(&mut self, mesh: &CellMesh) {
        let Some(first) = first_at_position(&mesh.nodes) else {
            return;
        };
        self.shares = self.moments.iter().map(|m| m.volume).collect();
        for (node, &first) in first.iter().enumerate() {
            if first as usize != node {
                let share = self.moments[node];
                self.moments[first as usize].add(&share);
            }
        }
        self.first = first;
    }

    /// Drops volumes and moments, 80 bytes a node. Afterwards only positions and cells may be asked for.
    pub(super) fn drop_moments(&mut self) {
        (self.moments, self.shares) = (Vec::new(), Vec::new());
    }

    /// Returns true if a solid cell is left out for a fault.
    pub(in crate::sample) fn is_left_out(&self, cell: usize) -> bool {
        self.left_out.binary_search(&index_u32(cell)).is_ok()
    }

    /// Returns all nodes with the first at their position, ordered by it; empty if no two coincide.
    pub(in crate::sample) fn copies(&self) -> Vec<(u32, u32)> {
        let mut copies: Vec<(u32, u32)> = self.first.iter().copied().zip(0..).collect();
        copies.par_sort_unstable();
        copies
    }

    /// Returns the dual cell in which a node has a share.
    pub(in crate::sample) fn moments(&self, node: usize) -> &Moments {
        &self.moments[self.first.get(node).map_or(node, |&first| first as usize)]
    }

    /// Returns the first node at a node's position.
    pub(in crate::sample) fn first_of(&self, node: u32) -> u32 {
        self.first.get(node as usize).copied().unwrap_or(node)
    }

    /// Returns the dual cell in which a node has a share: volume, and first and second moments about the node.
    pub(in crate::sample) fn cell(&self, node: usize) -> Option<(f64, DVec3, DMat3)> {
        let moments = self.moments(node);
        let [xx, xy, xz, yy, yz, zz] = moments.second;
        let second = DMat3::from_cols(
            DVec3::new(xx, xy, xz),
            DVec3::new(xy, yy, yz),
            DVec3::new(xz, yz, zz),
        );
        (moments.volume > 0.0).then_some((moments.volume, moments.first, second))
    }

    /// Returns the volume of a node's share.
    pub(in crate::sample) fn share(&self, node: usize) -> f64 {
        let own = self.shares.get(node).copied();
        own.unwrap_or(self.moments[node].volume)
    }

    /// Returns 12 times the covariance of a node's dual cell; `None` for a node without volume.
    pub(in crate::sample) fn shape(&self, node: usize) -> Option<[f64; 6]> {
        let moments = self.moments(node);
        let is_there = self.share(node) > 0.0 && moments.volume > 0.0;
        is_there.then(|| moments.covariance().map(|c| 12.0 * c))
    }
}

/// Returns the first node at the position of each node; `None` if all positions differ.
fn first_at_position(nodes: &[DVec3]) -> Option<Vec<u32>> {
    let mut order: Vec<u32> = (0..nodes.len()).map(index_u32).collect();
    sort_by_position(nodes, &mut order);
    let same = |pair: &[u32]| {
        let [a, b] = [pair[0], pair[1]].map(|i| nodes[i as usize]);
        is_same(a, b) && a.is_finite()
    };
    if !order.windows(2).any(same) {
        return None;
    }
    let mut first = vec![0; nodes.len()];
    for group in order.chunk_by(|&a, &b| same(&[a, b])) {
        for &i in group {
            first[i as usize] = group[0];
        }
    }
    Some(first)
}
