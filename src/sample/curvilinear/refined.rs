//! Refines kernels of curvilinear grids with values at nodes.

use glam::DVec3;

use super::even_grid::{GridNodes, reach};
use super::sharp::FARTHEST;
use super::structured::Grid;
use crate::collective::Collective;
use crate::error::Result;
use crate::sample::options::SampleOptions;
use crate::sample::positions::index_u32;
use crate::sample::refine::face::FaceNodes;
use crate::sample::refine::rule::ShownValues;
use crate::sample::refine::{MOST_PARTS, Refined, RefinedGrid, apply, refine};
use crate::sample::report::SampleReport;
use crate::scene::{PointVolume, Strength, Values};

/// A grid extended by its ghosts, with the values of a volume's particles.
struct Extended<'a, 'b> {
    grid: &'a Grid<'b>,
    nodes: &'a GridNodes<'a, 'b>,
    values: &'a Values,
    volumes: &'a [f32],
}

/// Refines a volume of the nodes of curvilinear grids where the options ask for it, and counts its samples, ghosts
/// and parts, in this order, in the report. Returns false if nothing is refined, and leaves the volume as it is.
///
/// - `all_nodes`: nodes of each grid, with those of its ghosts if the volume has a boundary.
/// - `wanted`: the particles to keep, ascending; those from `sample_count` on are ghosts.
///
/// # Errors
/// Errors of the reductions over `ranks`.
pub(in crate::sample) fn refine_grids(
    volume: &mut PointVolume,
    all_nodes: &[GridNodes<'_, '_>],
    report: &mut SampleReport,
    (wanted, sample_count): (&[u32], usize),
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<bool> {
    let (Some(refinement), Some(values), Some(shown), Strength::Classified { volumes }) = (
        &options.refinement,
        &volume.values,
        ShownValues::new(volume, options.flatten),
        &volume.strength,
    ) else {
        return Ok(false);
    };
    let width = options.kernels.width;
    // Grids share the room for parts.
    let most = MOST_PARTS / all_nodes.len().max(1);
    let mut refined = |nodes: &GridNodes<'_, '_>| {
        let grid = Extended {
            grid: nodes.grid(),
            nodes,
            values,
            volumes,
        };
        let is_wanted = |particle: usize| {
            let number = index_u32(particle);
            // Where all particles before are wanted, a number is its own place.
            wanted.get(particle) == Some(&number) || wanted.binary_search(&number).is_ok()
        };
        let mut total = |own| ranks.sum(Ok(own));
        let of = (width, reach(width));
        refine(
            &grid,
            (&shown, refinement),
            of,
            is_wanted,
            (most, &mut total),
        )
    };
    let all = all_nodes
        .iter()
        .filter_map(|nodes| refined(nodes).transpose());
    let all: Vec<Refined> = all.collect::<Result<_>>()?;
    let levels = all.iter().map(|refined| refined.level);
    let level = levels.max().unwrap_or(0);
    if !ranks.any(level > 0)? {
        return Ok(false);
    }
    let stays = apply(volume, all, wanted, &mut |scales| ranks.max(scales))?;
    report.refined_count = volume.particles.len() - stays.len();
    report.refined_level = level;
    report.particle_count = volume.particles.len();
    let ghosts = stays.iter().filter(|&&i| i as usize >= sample_count);
    report.ghost_count = ghosts.count();
    Ok(true)
}

impl Extended<'_, '_> {
    /// Returns the indices relative to the grid's own first node.
    fn relative(&self, node: [usize; 3]) -> [isize; 3] {
        let layers = self.nodes.layers();
        [0, 1, 2].map(|a| node[a] as isize - layers[a] as isize)
    }

    /// Returns the value of a node of the grid or of its linear extension.
    fn value(&self, at: [isize; 3]) -> Option<f64> {
        let mut sum = 0.0;
        for ([i, j, k], weight) in self.grid.continuation(at) {
            let layers = self.nodes.layers();
            let place = [i + layers[0], j + layers[1], k + layers[2]];
            sum += self.values.wide(self.nodes.particle_at(place)?) * weight;
        }
        Some(sum)
    }

    /// Returns the nodes of a face around the node of it that is nearest to a place.
    ///
    /// - `at`: a node of the grid or of its linear extension.
    fn face_around(&self, at: [isize; 3], axis: usize, is_upper: bool) -> FaceNodes {
        let last = self.grid.dims[axis] as isize - 1;
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let plane = |of_axis: isize| {
            std::array::from_fn(|n| {
                let mut to = at;
                to[axis] = of_axis;
                to[b] += (n % 3) as isize - 1;
                to[c] += (n / 3) as isize - 1;
                for a in (0..3).filter(|&a| self.grid.periodic[a]) {
                    to[a] = to[a].rem_euclid(self.grid.dims[a] as isize - 1);
                }
                self.grid.continued(to)
            })
        };
        let [below, above] = self.grid.face_distances(axis, at[axis]);
        FaceNodes {
            axis,
            is_upper,
            distance: if is_upper { above } else { below },
            nodes: match is_upper {
                true => [plane(last), plane(last - 1)],
                false => [plane(0), plane(1)],
            },
        }
    }
}

impl RefinedGrid for Extended<'_, '_> {
    fn node(&self, node: [usize; 3]) -> Option<(DVec3, f64)> {
        let at = self.relative(node);
        let is_own = |a: usize| at[a] >= 0 && at[a].unsigned_abs() < self.grid.dims[a];
        let (position, value) = match (0..3).all(is_own) {
            true => {
                let own = self.grid.node_index(at.map(isize::unsigned_abs));
                let particle = self.nodes.particle_at(node)?;
                (self.grid.nodes[own], self.values.wide(particle))
            }
            false => (self.grid.continued(at), self.value(at)?),
        };
        (position.is_finite() && value.is_finite()).then_some((position, value))
    }

    fn extent(&self) -> ([usize; 3], [Option<usize>; 3]) {
        let dims = self.nodes.dims();
        // On a closed index the last plane of nodes repeats the first.
        let periods = [0, 1, 2].map(|a| self.grid.periodic[a].then(|| dims[a] - 1));
        (dims, periods)
    }

    fn particle(&self, node: [usize; 3]) -> Option<usize> {
        self.nodes.particle_at(node)
    }

    fn volume(&self, particle: usize) -> f64 {
        self.volumes[particle].into()
    }

    fn beside(&self, node: [usize; 3]) -> [bool; 3] {
        let at = self.relative(node);
        [0, 1, 2].map(|a| {
            let [below, above] = self.grid.face_distances(a, at[a]);
            self.nodes.layers()[a] > 0 && below.min(above) <= 1
        })
    }

    fn faces(&self, node: [usize; 3]) -> Vec<FaceNodes> {
        let at = self.relative(node);
        let mut faces = Vec::new();
        for axis in (0..3).filter(|&a| self.nodes.layers()[a] > 0) {
            let distances = self.grid.face_distances(axis, at[axis]);
            for (is_upper, distance) in [false, true].into_iter().zip(distances) {
                if distance <= FARTHEST as isize {
                    faces.push(self.face_around(at, axis, is_upper));
                }
            }
        }
        faces
    }
}
