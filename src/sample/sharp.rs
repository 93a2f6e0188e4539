//! Sharp boundaries of curvilinear grids: whole cells around boundary nodes, one layer of ghosts beyond
//! them, and the planes that cut the kernels there.
//!
//! The grid is continued linearly, node by node (2 X0 - X1, and once more for the shapes of the ghosts),
//! so that boundary nodes have kernels as nodes inside have. Each kernel within some cells of a face is
//! cut by the tangent plane at the nearest boundary node: exact on plane faces, of second order in
//! curvature times spacing on others. A face that has collapsed to a line or a point, a pole, is none.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::even::CutKernels;
use super::even_grid::GridNodes;
use super::kernels::Kernel;
use super::local_models::matrix_of;
use super::structured::Grid;
use super::{SampleOptions, SampleReport, index_u32, narrowed};
use crate::constants::{EDGE_REACH, MOST_EDGES};
use crate::error::Result;
use crate::io::Blanking;
use crate::math::lower_factor;
use crate::scene::{
    Boundary, BoundaryPlanes, LocalModel, LocalModels, NO_EDGE, Particles, PointVolume, Strength,
};

/// Layers of nodes that the grid is continued by: one of ghosts, and one beyond for their shapes.
const LAYERS: usize = 2;

/// How many cells away a face may cut a kernel: in a boundary layer kernels grow almost as fast as
/// their distance.
const FARTHEST: usize = 6;

/// Two tangents whose angle has a lesser sine span no face.
const LEAST_SINE: f64 = 1e-6;

/// What a node beside the boundary, or a ghost, becomes.
struct SharpNode {
    /// Which node of the grid, continued by [`LAYERS`], it is.
    place: usize,
    /// The node itself, or the one nearest to the ghost; then the one as far behind that.
    sources: [usize; 2],
    is_ghost: bool,
    /// Of a ghost, and of a node on the boundary.
    kernel: Option<Kernel>,
    edges: Option<[[f32; 4]; MOST_EDGES]>,
}

impl Grid<'_> {
    /// The nodes on the faces of indices that do not close, those on edges more than once.
    fn face_nodes(&self) -> impl Iterator<Item = usize> + use<> {
        let (dims, periodic) = (self.dims, self.periodic);
        let axes = (0..3).filter(move |&a| !periodic[a]);
        axes.flat_map(move |a| face_nodes(dims, a))
    }

    /// How far the grid is continued along each index.
    fn layers(&self) -> [usize; 3] {
        self.periodic
            .map(|is_periodic| if is_periodic { 0 } else { LAYERS })
    }

    /// The position of a node of the grid or of its linear continuation.
    fn continued(&self, at: [isize; 3]) -> DVec3 {
        let along = [0, 1, 2].map(|a| {
            let last = self.dims[a] as isize - 1;
            let (i, base) = (at[a], at[a].clamp(0, last));
            let inner = if base == 0 { 1.min(last) } else { base - 1 };
            let beyond = (i - base).unsigned_abs() as f64;
            [(base as usize, 1.0 + beyond), (inner as usize, -beyond)]
        });
        let mut sum = DVec3::ZERO;
        for (i, x) in along[0] {
            for (j, y) in along[1] {
                for (k, z) in along[2] {
                    let weight = x * y * z;
                    if weight != 0.0 {
                        sum += self.nodes[self.node_index([i, j, k])] * weight;
                    }
                }
            }
        }
        sum
    }

    /// The tangent plane at the boundary node nearest to a place along index `a`: its normal into the
    /// grid, and the node. `None` where the face has collapsed.
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
        let [u, v] = [tangent((a + 1) % 3), tangent((a + 2) % 3)];
        let across = u.cross(v);
        // Phrased so that NaN is no plane.
        if !(across.length() > LEAST_SINE * u.length() * v.length()) {
            return None;
        }
        let normal = across.normalize();
        let height = normal.dot(inward);
        (height.abs() > LEAST_SINE * inward.length()).then(|| [normal * height.signum(), origin])
    }

    /// Whether nothing around a node is blanked.
    fn is_clear(&self, ijk: [usize; 3]) -> bool {
        let cells = (0..8usize).filter_map(|side| {
            let mut cell = [0; 3];
            for d in 0..3 {
                let i = (ijk[d] + (side >> d & 1)).checked_sub(1)?;
                cell[d] = (i + 1 < self.dims[d]).then_some(i)?;
            }
            Some(self.first_cell + self.cell_index(cell))
        });
        !self.blanking.node(self.first_node + self.node_index(ijk))
            && cells.into_iter().all(|cell| !self.blanking.cell(cell))
    }

    /// Nodes beside the boundary, and ghosts.
    fn sharp_nodes(&self, kernel_width: f64) -> Vec<SharpNode> {
        let layers = self.layers();
        let dims = [0, 1, 2].map(|a| self.dims[a] + 2 * layers[a]);
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
        let own = |ijk: [usize; 3]| [0, 1, 2].map(|a| ijk[a] as isize - layers[a] as isize);
        let nodes: Vec<DVec3> = (0..dims.iter().product())
            .into_par_iter()
            .map(|n| self.continued(own(at(n))))
            .collect();
        let nothing = Blanking::default();
        let wide = Grid {
            dims,
            nodes: &nodes,
            periodic: self.periodic,
            handedness: self.handedness,
            blanking: &nothing,
            first_node: 0,
            first_cell: 0,
        };
        (0..nodes.len())
            .into_par_iter()
            .filter_map(|n| self.sharp_node(&wide, n, own(at(n)), kernel_width))
            .collect()
    }

    /// - `wide`: the grid continued; `n`: a node of it; `ijk`: the same, counted from the grid's own.
    fn sharp_node(
        &self,
        wide: &Grid<'_>,
        n: usize,
        ijk: [isize; 3],
        kernel_width: f64,
    ) -> Option<SharpNode> {
        let last = self.dims.map(|n| n as isize - 1);
        let nearest = [0, 1, 2].map(|a| ijk[a].clamp(0, last[a]));
        let beyond = [0, 1, 2].map(|a| ijk[a] - nearest[a]);
        if beyond.iter().any(|d| d.abs() > 1)
            || (0..3).any(|a| self.periodic[a] && ijk[a] == last[a])
        {
            return None;
        }
        let to_index = |v: [isize; 3]| v.map(|i| i.unsigned_abs());
        let node = to_index(nearest);
        if !self.is_clear(node) {
            return None;
        }
        let is_ghost = beyond != [0; 3];
        let mut planes = Vec::with_capacity(MOST_EDGES);
        let mut is_on_boundary = false;
        let mut is_whole = true;
        for a in (0..3).filter(|&a| !self.periodic[a]) {
            for (is_upper, distance) in [(false, ijk[a]), (true, last[a] - ijk[a])] {
                if distance > FARTHEST as isize {
                    continue;
                }
                let plane = self.tangent_plane(node, a, is_upper);
                is_on_boundary |= distance <= 0;
                // A pole goes on nowhere.
                is_whole &= plane.is_some() || distance > 0;
                planes.extend(plane);
            }
        }
        if planes.is_empty() || (is_ghost && !is_whole) {
            return None;
        }
        let part = if is_whole && (is_ghost || is_on_boundary) {
            wide.node_part(n).ok()?
        } else {
            self.node_part(self.node_index(node)).ok()?
        };
        let factor = part.jacobian * kernel_width;
        let edges = edges(&planes, part.centroid, &factor);
        let kernel = if is_whole && (is_ghost || is_on_boundary) {
            Some(Kernel::new(part.centroid, lower_factor(factor), part.volume).ok()?)
        } else {
            None
        };
        // Of no consequence.
        if kernel.is_none() && edges.is_none() {
            return None;
        }
        let behind = to_index([0, 1, 2].map(|a| (nearest[a] - beyond[a]).clamp(0, last[a])));
        Some(SharpNode {
            place: n,
            sources: [self.node_index(node), self.node_index(behind)],
            is_ghost,
            kernel,
            edges,
        })
    }
}

/// The nodes of both faces of a grid along index `a`, by their numbers.
pub(super) fn face_nodes(dims: [usize; 3], a: usize) -> impl Iterator<Item = usize> {
    let strides = [1, dims[0], dims[0] * dims[1]];
    let (b, c) = ((a + 1) % 3, (a + 2) % 3);
    [0, dims[a] - 1].into_iter().flat_map(move |at| {
        let across = (0..dims[b]).flat_map(move |i| (0..dims[c]).map(move |j| (i, j)));
        across.map(move |(i, j)| at * strides[a] + i * strides[b] + j * strides[c])
    })
}

/// Those of some planes (a normal into the domain and a point each) that reach a kernel.
pub(super) fn edges(
    planes: &[[DVec3; 2]],
    centre: DVec3,
    factor: &DMat3,
) -> Option<[[f32; 4]; MOST_EDGES]> {
    let mut out = [NO_EDGE; MOST_EDGES];
    let mut count = 0;
    for &[normal, point] in planes {
        let inside = normal.dot(centre - point);
        let reach = f64::from(EDGE_REACH) * (factor.transpose() * normal).length();
        if inside < reach && count < MOST_EDGES {
            out[count] = normal.extend(inside).to_array().map(narrowed);
            count += 1;
        }
    }
    (count > 0).then_some(out)
}

/// A particle that is changed or added at the boundary.
pub(super) struct SharpParticle {
    /// Which particle it is, or of a ghost the nearest one; then the one as far behind that.
    pub(super) sources: [usize; 2],
    pub(super) is_ghost: bool,
    /// Its kernel, where that is another one.
    pub(super) kernel: Option<Kernel>,
    /// Of a ghost its value, where that is not extrapolated from its sources.
    pub(super) value: Option<f64>,
    pub(super) edges: Option<[[f32; 4]; MOST_EDGES]>,
}

/// Gives a volume of nodes of curvilinear grids, as it was sampled, a sharp boundary.
///
/// - `grids`: with the number of each one's first node.
/// - `kept`: which node each particle is, ascending.
pub(super) fn sharpen_grids(
    volume: &mut PointVolume,
    report: &mut SampleReport,
    grids: &[(usize, Grid<'_>)],
    kept: &[u32],
    options: &SampleOptions,
) -> Result<()> {
    let particle = |node: usize| kept.binary_search(&index_u32(node)).ok();
    // Before the grids are continued: most of what is transparent there needs no more than this.
    let on_faces = grids
        .iter()
        .flat_map(|(first, grid)| grid.face_nodes().map(move |node| first + node));
    if !options.cuts(volume, on_faces.filter_map(particle)) {
        return Ok(());
    }
    let mut changes = Vec::new();
    let mut all_nodes = Vec::with_capacity(grids.len());
    let mut ghost = kept.len();
    for (first, grid) in grids {
        let mut nodes = GridNodes::new(grid, grid.layers());
        let members = kept.partition_point(|&node| (node as usize) < *first)
            ..kept.partition_point(|&node| (node as usize) < first + grid.nodes.len());
        for i in members {
            nodes.set(nodes.place_of(kept[i] as usize - first), index_u32(i));
        }
        for node in grid.sharp_nodes(options.kernel_width) {
            let Some(nearest) = particle(first + node.sources[0]) else {
                continue;
            };
            if node.is_ghost {
                nodes.set(node.place, index_u32(ghost));
                ghost += 1;
            }
            changes.push(SharpParticle {
                sources: [
                    nearest,
                    particle(first + node.sources[1]).unwrap_or(nearest),
                ],
                is_ghost: node.is_ghost,
                kernel: node.kernel,
                value: None,
                edges: node.edges,
            });
        }
        all_nodes.push(nodes);
    }
    let Some(ghosts) = apply(volume, report, changes, options) else {
        return Ok(());
    };
    even_out(volume, &ghosts, |kernels, volumes| {
        let mut inverses = None;
        let of_grid = |nodes: &GridNodes<'_, '_>| {
            nodes.sums(kernels, volumes, &mut inverses, options.kernel_width)
        };
        let found: Vec<(usize, f64)> = all_nodes.iter().flat_map(of_grid).collect();
        if found.is_empty() {
            return Ok(None);
        }
        let mut sums = vec![f64::NAN; kernels.own_count()];
        for (i, sum) in found {
            sums[i] = sum;
        }
        Ok(Some(sums))
    })
}

/// Evens out the volumes of a volume with a boundary.
///
/// - `sums`: of all kernels at the samples, where they are to be evened out; `None` for none.
pub(super) fn even_out(
    volume: &mut PointVolume,
    ghosts: &Ghosts,
    sums: impl FnOnce(&CutKernels<'_>, &[f32]) -> Result<Option<Vec<f64>>>,
) -> Result<()> {
    let (
        Particles::Anisotropic { positions, factors },
        Strength::Classified { volumes },
        Some(Boundary::Planes(boundary)),
    ) = (&volume.particles, &mut volume.strength, &volume.boundary)
    else {
        return Ok(());
    };
    let kernels = CutKernels {
        positions,
        factors,
        boundary,
        sources: &ghosts.sources,
    };
    if let Some(sums) = sums(&kernels, volumes)? {
        kernels.even_out(volumes, &sums, ghosts.inside);
    }
    Ok(())
}

/// What a sharp boundary has added.
pub(super) struct Ghosts {
    /// The samples that they belong to; they are the last particles.
    pub(super) sources: Vec<usize>,
    /// The volume of the data.
    inside: f64,
}

/// Changes and adds the particles of a boundary, where the options want it sharp.
pub(super) fn apply(
    volume: &mut PointVolume,
    report: &mut SampleReport,
    changes: Vec<SharpParticle>,
    options: &SampleOptions,
) -> Option<Ghosts> {
    let on_boundary = changes.iter().filter(|c| c.kernel.is_some() && !c.is_ghost);
    if !options.cuts(volume, on_boundary.map(|c| c.sources[0])) {
        return None;
    }
    let (Particles::Anisotropic { positions, factors }, Strength::Classified { volumes }) =
        (&mut volume.particles, &mut volume.strength)
    else {
        return None;
    };
    let inside = volumes.iter().copied().map(f64::from).sum();
    // The gradient stays, over another kernel; what the samples' centroids did to values goes with them.
    let models = volume.local_models.take();
    let of_sources = factors.clone();
    let over = |source: usize, factor: &[f32; 6]| {
        let model = models.as_ref()?.get(source);
        let gradient = matrix_of(of_sources[source]).transpose().inverse() * model.slope.as_dvec3();
        let slope = (matrix_of(*factor).transpose() * gradient).as_vec3();
        Some(LocalModel {
            slope: if slope.is_finite() { slope } else { Vec3::ZERO },
            departure: 0.0,
            ..model
        })
    };
    let mut changed = Vec::new();
    let mut boundary = BoundaryPlanes {
        of_particle: vec![0; positions.len()],
        edges: Vec::new(),
    };
    let mut sources = Vec::new();
    for change in changes {
        let mut word = 0;
        if let Some(edges) = change.edges {
            boundary.edges.push(edges);
            word = index_u32(boundary.edges.len());
        }
        let [own, _] = change.sources;
        match change.kernel {
            Some(kernel) if change.is_ghost => {
                changed.push((positions.len(), over(own, &kernel.factor)));
                positions.push(kernel.position);
                factors.push(kernel.factor);
                volumes.push(kernel.volume);
                boundary.of_particle.push(word);
                sources.push((change.sources, change.value));
                continue;
            }
            Some(kernel) => {
                changed.push((own, over(own, &kernel.factor)));
                positions[own] = kernel.position;
                factors[own] = kernel.factor;
                volumes[own] = kernel.volume;
            }
            None => {}
        }
        boundary.of_particle[own] = word;
    }
    if let Some(values) = &mut volume.values {
        values.extrapolate(&sources);
    }
    if let Some(normals) = &mut volume.normals {
        for ([nearest, _], _) in &sources {
            normals.push(normals[*nearest]);
        }
    }
    report.particle_count = positions.len();
    if let Some(models) = models {
        let mut all: Vec<LocalModel> = (0..models.len()).map(|i| models.get(i)).collect();
        for (i, model) in changed {
            let model = model.unwrap_or(NO_MODEL);
            match all.get_mut(i) {
                Some(own) => *own = model,
                // Ghosts come in the order of their places.
                None => all.push(model),
            }
        }
        volume.local_models = Some(LocalModels::new(&all));
    }
    volume.boundary = Some(Boundary::Planes(boundary));
    Some(Ghosts {
        sources: sources.iter().map(|([nearest, _], _)| *nearest).collect(),
        inside,
    })
}

/// Of a field that is the same everywhere.
const NO_MODEL: LocalModel = LocalModel {
    slope: Vec3::ZERO,
    departure: 0.0,
    below: 0.0,
    above: 0.0,
};
