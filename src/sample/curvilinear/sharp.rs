//! Makes sharp boundaries of curvilinear grids: whole cells around boundary nodes, one layer of ghosts beyond
//! them, and planes that cut the kernels there.
//!
//! The grid is extended linearly, node by node: 2 X0 - X1, and once more for the shapes of the ghosts. Boundary
//! nodes thus get the same kernels as nodes inside. Each kernel within some cells of a face is cut by the
//! tangent plane at the nearest boundary node. That is exact on plane faces, and of second order in curvature
//! times spacing on others. A face that has collapsed to a line or a point, a pole, does not count as a face.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::even_grid::GridNodes;
use super::structured::{Grid, Part};
use super::window::Window;
use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::math::lower_factor;
use crate::sample::kernels::Kernel;
use crate::sample::kernels::ghosts::{SharpParticle, apply, even_out};
use crate::sample::kernels::planes::{edges, plane_of};
use crate::sample::options::SampleOptions;
use crate::sample::own::Own;
use crate::sample::positions::index_u32;
use crate::sample::report::SampleReport;
use crate::scene::PointVolume;

/// Layers of nodes by which the grid is extended: one of ghosts, and one beyond for their shapes.
const LAYERS: usize = 2;

/// Greatest distance in cells at which a face may cut a kernel: in a boundary layer, kernels grow almost as
/// fast as their distance.
pub(in crate::sample) const FARTHEST: usize = 6;

/// The nodes on a face of a grid and their ghosts beyond it. The array holds these two layers between two outer
/// ones.
struct Face {
    axis: usize,
    /// Indices of the first node.
    first: [isize; 3],
    dims: [usize; 3],
    parts: Vec<Option<Part>>,
}

impl Face {
    /// Returns the part of a node of the two middle layers, if it has one.
    fn part(&self, ijk: [isize; 3]) -> Option<Part> {
        let [i, j, k] = [0, 1, 2].map(|a| usize::try_from(ijk[a] - self.first[a]).ok());
        let at = [i?, j?, k?];
        let is_of_face = at[self.axis] == 1 || at[self.axis] == 2;
        let [i, j, k] = at;
        is_of_face.then(|| self.parts[i + self.dims[0] * (j + self.dims[1] * k)])?
    }
}

impl Grid<'_> {
    /// Returns the nodes on the grid's faces, without seams; nodes on edges occur more than once.
    fn face_nodes(&self) -> impl Iterator<Item = usize> {
        let axes = (0..3).filter(|&a| !self.periodic[a]);
        axes.flat_map(move |a| {
            let sides = [0, self.dims[a] - 1].into_iter().enumerate();
            let faces = sides.filter(move |(side, _)| self.is_face(a, *side == 1));
            faces.flat_map(move |(_, at)| plane_nodes(self.dims, a, at))
        })
    }

    /// Returns true if the first or last local plane along an index without a seam is a face of the grid. Along
    /// k it may be a cut between ranks instead.
    fn is_face(&self, a: usize, is_upper: bool) -> bool {
        let Window { first, count, .. } = self.window;
        a < 2
            || (if is_upper {
                first + self.dims[2] == count
            } else {
                first == 0
            })
    }

    /// Returns the number of nodes from a place to the first and to the last plane of the whole grid along an
    /// index.
    pub(in crate::sample) fn face_distances(&self, a: usize, i: isize) -> [isize; 2] {
        let Window { first, count, .. } = self.window;
        let [before, count] = match a {
            2 => [first, count],
            _ => [0, self.dims[a]],
        };
        let i = i + before as isize;
        [i, count as isize - 1 - i]
    }

    /// Returns the number of layers by which the grid is extended along each index.
    fn layers(&self) -> [usize; 3] {
        self.periodic
            .map(|is_periodic| if is_periodic { 0 } else { LAYERS })
    }

    /// Returns the position of a node of the grid or of its linear extension.
    pub(in crate::sample) fn continued(&self, at: [isize; 3]) -> DVec3 {
        let terms = self.continuation(at);
        terms.fold(DVec3::ZERO, |sum, (node, weight)| {
            sum + self.nodes[self.node_index(node)] * weight
        })
    }

    /// Returns the nodes from which a node of the grid or of its linear extension follows, with their weights.
    pub(in crate::sample) fn continuation(
        &self,
        at: [isize; 3],
    ) -> impl Iterator<Item = ([usize; 3], f64)> {
        let along = [0, 1, 2].map(|a| {
            let last = self.dims[a] as isize - 1;
            let (i, base) = (at[a], at[a].clamp(0, last));
            let inner = if base == 0 { 1.min(last) } else { base - 1 };
            let beyond = (i - base).unsigned_abs() as f64;
            [(base as usize, 1.0 + beyond), (inner as usize, -beyond)]
        });
        (0..8_usize).filter_map(move |n| {
            let [(i, x), (j, y), (k, z)] = [0, 1, 2].map(|a| along[a][n >> (2 - a) & 1]);
            let weight = x * y * z;
            (weight != 0.0).then_some(([i, j, k], weight))
        })
    }

    /// Returns the tangent plane at the boundary node nearest to a place along index `a`: its normal into the
    /// grid, and the node. Returns `None` if the face has collapsed.
    fn tangent_plane(&self, mut ijk: [usize; 3], a: usize, is_upper: bool) -> Option<[DVec3; 2]> {
        let last = self.dims.map(|n| n - 1);
        ijk[a] = if is_upper { last[a] } else { 0 };
        let node = |ijk: [usize; 3]| self.nodes[self.node_index(ijk)];
        let tangent = |b: usize| {
            let neighbour = |step: isize| {
                let mut to = ijk;
                let period = if self.periodic[b] { last[b] } else { 0 };
                to[b] = match (ijk[b].checked_add_signed(step), period) {
                    (None, 0) => 0,
                    (None, period) => period - 1,
                    (Some(i), 0) => i.min(last[b]),
                    (Some(i), period) => i % period,
                };
                node(to)
            };
            neighbour(1) - neighbour(-1)
        };
        let mut inner = ijk;
        inner[a] = if is_upper { last[a] - 1 } else { 1 };
        let origin = node(ijk);
        let inward = node(inner) - origin;
        plane_of(origin, inward, tangent((a + 1) % 3), tangent((a + 2) % 3))
    }

    /// Returns true if nothing around a node is blanked.
    fn is_clear(&self, ijk: [usize; 3]) -> bool {
        !self.blanking.node(self.first_node + self.node_index(ijk)) && !self.is_beside_blanked(ijk)
    }

    /// Returns the changed particles beside the boundary and the ghosts, row by row. The first list of each row
    /// gives their nodes in the grid extended by [`LAYERS`].
    ///
    /// - `particle`: returns the particle of a node, if it has one.
    /// - `kernel`: returns the centre and the factor of a particle.
    fn sharp_nodes(
        &self,
        kernel_width: f64,
        particle: impl Fn(usize) -> Option<usize> + Sync,
        kernel: impl Fn(usize) -> (DVec3, DMat3) + Sync,
    ) -> Vec<(Vec<usize>, Vec<SharpParticle>)> {
        let layers = self.layers();
        let dims = [0, 1, 2].map(|a| self.dims[a] + 2 * layers[a]);
        let faces: Vec<Face> = (0..3)
            .filter(|&a| !self.periodic[a])
            .flat_map(|a| [false, true].map(|is_upper| (a, is_upper)))
            .filter(|&(a, is_upper)| self.is_face(a, is_upper))
            .map(|(a, is_upper)| self.face(a, is_upper, dims))
            .collect();
        let is_near = |ijk: [isize; 3], a: usize| {
            let [below, above] = self.face_distances(a, ijk[a]);
            !self.periodic[a] && below.min(above) <= FARTHEST as isize
        };
        let of_row = |row: usize| {
            let [j, k] = [row % dims[1], row / dims[1]];
            let of_row = [0, j, k];
            let ijk = [0, 1, 2].map(|a| of_row[a] as isize - layers[a] as isize);
            let is_beside = is_near(ijk, 1) || is_near(ijk, 2);
            let change = |i: usize| {
                let ijk = [i as isize - layers[0] as isize, ijk[1], ijk[2]];
                let is_beside = is_beside || is_near(ijk, 0);
                let change = || self.sharp_node(&faces, ijk, kernel_width, &particle, &kernel);
                Some((row * dims[0] + i, is_beside.then(change)??))
            };
            let changes = (0..dims[0]).filter_map(change);
            let (mut places, mut changes): (Vec<usize>, Vec<SharpParticle>) = changes.unzip();
            places.shrink_to_fit();
            changes.shrink_to_fit();
            (places, changes)
        };
        (0..dims[1] * dims[2]).into_par_iter().map(of_row).collect()
    }

    /// Returns the nodes on a face and the ghosts beyond it.
    ///
    /// - `dims`: dimensions of the extended grid.
    fn face(&self, a: usize, is_upper: bool, dims: [usize; 3]) -> Face {
        let layers = self.layers();
        let mut first = layers.map(|n| -(n as isize));
        if is_upper {
            first[a] = self.dims[a] as isize - 2;
        }
        let mut dims = dims;
        dims[a] = 2 * LAYERS;
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
        let nodes: Vec<DVec3> = (0..dims.iter().product())
            .into_par_iter()
            .map(|n| {
                let at = at(n);
                self.continued([0, 1, 2].map(|a| first[a] + at[a] as isize))
            })
            .collect();
        let grid = Grid::like(self, dims, &nodes);
        let mut parts = vec![None; nodes.len()];
        parts
            .par_chunks_mut(dims[0])
            .enumerate()
            .for_each(|(row, parts)| {
                let start = row * dims[0];
                grid.node_parts(start..start + dims[0], |n, part| {
                    parts[n - start] = part.ok();
                });
            });
        Face {
            axis: a,
            first,
            dims,
            parts,
        }
    }

    /// - `ijk`: a node of the extended grid; indices are relative to the grid's own first node.
    fn sharp_node(
        &self,
        faces: &[Face],
        ijk: [isize; 3],
        kernel_width: f64,
        particle: impl Fn(usize) -> Option<usize>,
        kernel: impl Fn(usize) -> (DVec3, DMat3),
    ) -> Option<SharpParticle> {
        let last = self.dims.map(|n| n as isize - 1);
        let nearest = [0, 1, 2].map(|a| ijk[a].clamp(0, last[a]));
        let beyond = [0, 1, 2].map(|a| ijk[a] - nearest[a]);
        if beyond.iter().any(|d| d.abs() > 1)
            || (beyond[2] != 0 && !self.is_face(2, beyond[2] > 0))
            || (0..3).any(|a| self.periodic[a] && ijk[a] == last[a])
        {
            return None;
        }
        let to_index = |v: [isize; 3]| v.map(|i| i.unsigned_abs());
        let node = to_index(nearest);
        if !self.is_clear(node) {
            return None;
        }
        let own = particle(self.node_index(node))?;
        let is_ghost = beyond != [0; 3];
        let mut planes = Vec::with_capacity(MOST_EDGES);
        let mut is_on_boundary = false;
        let mut is_whole = true;
        for a in (0..3).filter(|&a| !self.periodic[a]) {
            for (is_upper, distance) in [false, true]
                .into_iter()
                .zip(self.face_distances(a, ijk[a]))
            {
                if distance > FARTHEST as isize {
                    continue;
                }
                let plane = self.tangent_plane(node, a, is_upper);
                is_on_boundary |= distance <= 0;
                // At a pole the grid cannot be extended.
                is_whole &= plane.is_some() || distance > 0;
                planes.extend(plane);
            }
        }
        if planes.is_empty() || (is_ghost && !is_whole) {
            return None;
        }
        let (centre, factor, changed) = if is_whole && (is_ghost || is_on_boundary) {
            let part = faces.iter().find_map(|face| face.part(ijk))?;
            let factor = part.jacobian * kernel_width;
            let kernel = Kernel::new(part.centroid, lower_factor(factor), part.volume).ok()?;
            (part.centroid, factor, Some(kernel))
        } else {
            let (centre, factor) = kernel(own);
            (centre, factor, None)
        };
        let edges = edges(&planes, centre, &factor);
        // Neither a new kernel nor a cut.
        if changed.is_none() && edges.is_none() {
            return None;
        }
        let behind = to_index([0, 1, 2].map(|a| (nearest[a] - beyond[a]).clamp(0, last[a])));
        let behind = particle(self.node_index(behind)).unwrap_or(own);
        Some(SharpParticle {
            sources: [own, behind],
            is_ghost,
            kernel: changed,
            value: None,
            edges,
        })
    }
}

/// Returns the numbers of the nodes of both faces of a grid along index `a`.
pub(in crate::sample) fn face_nodes(dims: [usize; 3], a: usize) -> impl Iterator<Item = usize> {
    let faces = [0, dims[a] - 1].into_iter();
    faces.flat_map(move |at| plane_nodes(dims, a, at))
}

/// Returns the nodes of a plane along index `a`.
fn plane_nodes(dims: [usize; 3], a: usize, at: usize) -> impl Iterator<Item = usize> {
    let strides = [1, dims[0], dims[0] * dims[1]];
    let (b, c) = ((a + 1) % 3, (a + 2) % 3);
    let across = (0..dims[b]).flat_map(move |i| (0..dims[c]).map(move |j| (i, j)));
    across.map(move |(i, j)| at * strides[a] + i * strides[b] + j * strides[c])
}

/// Gives a sampled volume of nodes of curvilinear grids a sharp boundary.
///
/// - `grids`: each grid with the number of its first node.
/// - `kept`: node of each particle, ascending.
///
/// Returns the sample of each ghost, and the nodes of each grid with those of its ghosts; `None` if nothing is cut.
pub(in crate::sample) fn sharpen_grids<'a, 'b>(
    volume: &mut PointVolume,
    report: &mut SampleReport,
    grids: &'a [(usize, Grid<'b>)],
    kept: &[u32],
    options: &SampleOptions,
    own: &mut Own<'_>,
) -> Result<Option<(Vec<usize>, Vec<GridNodes<'a, 'b>>)>> {
    let node_count: usize = grids.iter().map(|(_, grid)| grid.nodes.len()).sum();
    let particle = |node: usize| {
        if kept.len() == node_count {
            Some(node)
        } else {
            kept.binary_search(&index_u32(node)).ok()
        }
    };
    // Before the grids are extended: most volumes that are transparent on the boundary need no more than this
    // test.
    let on_faces = grids
        .iter()
        .flat_map(|(first, grid)| grid.face_nodes().map(move |node| first + node));
    let on_faces = on_faces.filter_map(particle);
    let on_faces = on_faces.filter(|i| own.range.contains(i));
    let is_cut = options.cuts(volume, on_faces);
    if !own.ranks.any(is_cut)? {
        return Ok(None);
    }
    let mut changes = Vec::new();
    let mut all_nodes = Vec::with_capacity(grids.len());
    let mut ghost = kept.len();
    for (first, grid) in grids {
        let mut nodes = nodes_of(*first, grid, grid.layers(), kept);
        let of_grid = |node: usize| particle(first + node);
        let kernel = |particle: usize| {
            let (centre, factor, _) = volume.particles.shape(particle);
            (centre, factor)
        };
        for (places, of_row) in grid.sharp_nodes(options.kernels.width, of_grid, kernel) {
            for (place, _) in places.into_iter().zip(&of_row).filter(|(_, c)| c.is_ghost) {
                nodes.set(place, index_u32(ghost));
                ghost += 1;
            }
            changes.push(of_row);
        }
        all_nodes.push(nodes);
    }
    let Some(ghosts) = apply(volume, report, changes, options, own)? else {
        return Ok(None);
    };
    even_out(volume, &ghosts, own, |kernels, volumes| {
        let of_grid =
            |nodes: &GridNodes<'_, '_>| nodes.sums(kernels, volumes, options.kernels.width);
        let found: Vec<(usize, f64)> = all_nodes.iter().flat_map(of_grid).collect();
        if found.is_empty() {
            return Ok(None);
        }
        let mut sums = vec![f64::NAN; kernels.own_count()];
        for (i, sum) in found {
            sums[i] = sum;
        }
        Ok(Some(sums))
    })?;
    Ok(Some((ghosts.sources, all_nodes)))
}

/// Returns the nodes of a grid with their particles.
///
/// - `first`: number of the grid's first node; `kept`: node of each particle, ascending.
pub(in crate::sample) fn nodes_of<'a, 'b>(
    first: usize,
    grid: &'a Grid<'b>,
    layers: [usize; 3],
    kept: &[u32],
) -> GridNodes<'a, 'b> {
    let members = kept.partition_point(|&node| (node as usize) < first)
        ..kept.partition_point(|&node| (node as usize) < first + grid.nodes.len());
    let members = members.map(|i| (kept[i] as usize - first, index_u32(i)));
    GridNodes::new(grid, layers, members)
}
