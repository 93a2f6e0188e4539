//! Refines kernels of unstructured grids with values at nodes.
//!
//! A node's dual cell falls into the pieces of its cells ([`super::pieces`]), and these into 2^(L - 1) parts along each
//! of their parameters, L the level ([`super::levels`]). Parts take the place of the node's kernel and of its ghosts
//! ([`super::parts`]), and are evened out with the kernels beside them ([`super::even`]). Nodes stay whole if a cell
//! around them has a corner without a position or a value.

use std::cell::OnceCell;

use rayon::prelude::*;

use super::beside::WholeKernels;
use super::bodies::{Bodies, grade};
use super::levels::Body;
use super::parts::{NearSurface, PartKernel, kernels};
use super::sharp::{DrawnCells, Surface};
use crate::error::Result;
use crate::math::principal_sigmas;
use crate::sample::options::SampleOptions;
use crate::sample::positions::index_u32;
use crate::sample::refine::rule::{Rule, ShownValues};
use crate::sample::refine::{Refined, apply, within_budget};
use crate::sample::sampled::Sampled;
use crate::scene::{Boundary, Particles, Strength};

/// Greatest number of cells of a mesh that is refined. Ranks read larger meshes in parts, and a part knows neither
/// its neighbours' levels nor the surface of the whole.
pub(crate) const MOST_CELLS: usize = 1 << 21;

/// A mesh whose volume is to be refined.
pub(super) struct RefinedMesh<'a> {
    pub(super) cells: &'a DrawnCells<'a>,
    /// The boundary: set before if it cuts kernels, found if any body is split otherwise.
    pub(super) surface: OnceCell<Surface>,
    /// Particle of each ghost; ghosts are the last particles.
    pub(super) ghosts: &'a [usize],
    /// Particles without ghosts beside a boundary, ascending.
    pub(super) partial: &'a [usize],
}

impl RefinedMesh<'_> {
    /// Refines a volume where its options ask for it, and counts the parts in the report.
    ///
    /// - `bodies`: what the kernels stand for.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn refine(
        &self,
        bodies: &impl Bodies,
        sampled: &mut Sampled,
        options: &SampleOptions,
    ) -> Result<()> {
        let Sampled { volume, report } = sampled;
        let (Some(refinement), Some(shown), Some(values)) = (
            &options.refinement,
            ShownValues::new(volume, options.flatten),
            &volume.values,
        ) else {
            return Ok(());
        };
        let (Particles::Anisotropic { positions, factors }, Strength::Classified { volumes }) =
            (&volume.particles, &volume.strength)
        else {
            return Ok(());
        };
        let planes = match &volume.boundary {
            Some(Boundary::Planes(planes)) => Some(planes),
            _ => None,
        };
        let cutting = self.surface.get().filter(|_| planes.is_some());
        let all = bodies.all();
        let level = |body: u32, rule: &Rule| {
            let factor = factors[bodies.particle(body)?];
            let sigma = principal_sigmas(factor.map(f64::from))[0];
            let px = |own: &Body| refinement.px(own.origin, own.radius);
            bodies.level(body, rule, px, sigma, cutting)
        };
        let levels = |rule: &Rule| {
            let found: Vec<Option<u8>> = all.par_iter().map(|&n| level(n, rule)).collect();
            let mut levels = vec![0; bodies.count()];
            let mut may_split = vec![false; levels.len()];
            for (&body, level) in all.iter().zip(found) {
                levels[body as usize] = level.unwrap_or(0);
                may_split[body as usize] = level.is_some();
            }
            grade(bodies, &mut levels, &may_split);
            let is_split = |body: &&u32| levels[**body as usize] > 0;
            let count = |body: &u32| {
                let of_piece = 1_u64 << (3 * (levels[*body as usize] - 1));
                bodies.piece_count(*body) * of_piece
            };
            let count = all.iter().filter(is_split).map(count).sum();
            Ok((levels, count))
        };
        let width = options.kernels.width;
        let scale = (&shown, refinement, width);
        let Some((rule, levels)) = within_budget(scale, bodies.most_parts(), levels)? else {
            return Ok(());
        };
        if levels.iter().all(|level| *level == 0) {
            return Ok(());
        }
        let surface = self.surface.get_or_init(|| Surface::new(self.cells));
        let parts_of = |body: &u32| {
            let mut parts = Vec::new();
            if let Some(own) = bodies.body(*body) {
                let near = surface_near(self.cells, surface, bodies.cells(body), planes.is_some());
                let count = 1 << (levels[*body as usize] - 1);
                let place = |n: u32| self.cells.mesh.nodes[n as usize];
                kernels(&own, (&rule, count), &near, place, &mut parts);
            }
            parts
        };
        let split: Vec<u32> = all
            .iter()
            .copied()
            .filter(|&body| levels[body as usize] > 0)
            .collect();
        let parts: Vec<PartKernel> = split.par_iter().flat_map_iter(parts_of).collect();

        let is_drawn = parts
            .par_iter()
            .map(|part| part.shown(&rule, part.volume).is_some());
        let is_drawn: Vec<bool> = is_drawn.collect();
        let count = positions.len();
        let sample_count = count - self.ghosts.len();
        let body = |i: usize| {
            let sample = i.checked_sub(sample_count);
            bodies.of_particle(sample.map_or(i, |ghost| self.ghosts[ghost]))
        };
        let (split, whole): (Vec<usize>, Vec<usize>) =
            (0..count).partition(|&i| levels[body(i) as usize] > 0);
        let may_change = |i: usize| {
            let is_open = planes.is_none() && bodies.is_outermost(body(i), surface);
            let model = volume.local_models.as_ref().map(|models| models.get(i));
            let is_shown = model.is_none_or(|model| {
                let value = values.get(i);
                let reached = model.reached(value, [value - model.below, value + model.above]);
                rule.shows(reached.map(f64::from))
            });
            is_shown && !is_open && self.partial.binary_search(&i).is_err()
        };
        let kernels = WholeKernels {
            particles: &whole,
            positions,
            factors,
            volumes,
            sample_count,
            ghosts: self.ghosts,
        };
        let edges = |i: usize| planes.and_then(|planes| planes.of(i));
        let task = options.task.as_ref();
        let even = kernels.evened(&parts, &is_drawn, may_change, edges, task)?;
        let drawn = parts.par_iter().zip(&even.parts);
        let drawn = drawn.filter_map(|(part, volume)| part.shown(&rule, *volume));
        let refined = Refined {
            level: levels.iter().copied().max().unwrap_or(0),
            gone: split,
            evened: even.particles,
            parts: drawn.collect(),
        };
        if !even.is_even {
            let what = "of refined cells: their kernels are long, and not evened out";
            report.note(refined.parts.len(), "parts", what);
        }
        report.refined_level = refined.level;
        let wanted: Vec<u32> = (0..count).map(index_u32).collect();
        let stays = apply(volume, vec![refined], &wanted, &mut Ok)?;
        report.refined_count = volume.particles.len() - stays.len();
        report.particle_count = volume.particles.len();
        report.ghost_count = stays
            .iter()
            .filter(|&&i| i as usize >= sample_count)
            .count();
        Ok(())
    }
}

/// Returns the surface at the corners of cells.
///
/// - `members`: numbers of these cells.
fn surface_near<'a>(
    cells: &DrawnCells<'_>,
    surface: &'a Surface,
    members: &[u32],
    is_sharp: bool,
) -> NearSurface<'a> {
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    let mut is_undecided = false;
    for &cell in members {
        cells.corners(cell as usize, &mut corners);
        let of_corners = corners.iter().filter_map(|&n| surface.faces_at(n));
        faces.extend(of_corners.flatten());
        is_undecided |= corners.iter().any(|&n| surface.is_undecided(n));
    }
    faces.sort_unstable();
    faces.dedup();
    let of = |face| surface.face(face);
    NearSurface {
        faces: faces.into_iter().map(of).collect(),
        is_sharp,
        is_undecided,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DVec3;

    use super::*;
    use crate::data::association::Association;
    use crate::data::cells::CellMesh;
    use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
    use crate::sample::options::{BoundaryChoice, FunctionOptions, KernelOptions, TransferChoice};
    use crate::sample::refine::Refinement;
    use crate::scene::{PointVolume, TransferFunction, Values};
    use crate::view::Camera;

    /// Returns a block of 6³ hexahedra, whose inner nodes are moved, from -3 to 3.
    fn block() -> CellMesh {
        let number = |i: usize, j: usize, k: usize| i + 7 * (j + 7 * k);
        let place = |n: usize| {
            let at = [n % 7, n / 7 % 7, n / 49];
            let is_inner = at.iter().all(|i| (1..6).contains(i));
            let shift = if is_inner { 0.2 } else { 0.0 };
            let moved = |a: usize| at[a] as f64 - 3.0 + shift * ((n * (a + 3)) as f64 * 1.7).sin();
            DVec3::new(moved(0), moved(1), moved(2))
        };
        let nodes: Vec<DVec3> = (0..343).map(place).collect();
        let mut cells = Vec::new();
        for n in 0..216 {
            let [i, j, k] = [n % 6, n / 6 % 6, n / 36];
            let corner = |c: usize| number(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)) as i64;
            cells.push(8);
            cells.extend((0..8).map(corner));
        }
        CellMesh::of_lists(nodes, &[11; 216], &cells).unwrap()
    }

    fn of(mesh: CellMesh, values: Vec<f64>, boundary: BoundaryChoice, wide: f32) -> Sampled {
        let fields = vec![Field {
            name: "f".into(),
            association: Association::Nodes,
            source: FieldSource::Scalar(Values::F64(values)),
            unit: None,
        }];
        let data = Dataset::new(Path::new("test"), "test", Geometry::Cells(mesh), fields);
        let hat = move |v: f32| (1.0 - (v - 2.0).abs() / wide).max(0.0) * 0.9;
        let function = TransferFunction::from_curves(|_| [1.0; 3], hat, [0.0, 6.0], 1.0).unwrap();
        let eye = DVec3::new(10.0, -20.0, 15.0);
        let options = SampleOptions {
            function: FunctionOptions {
                transfer: TransferChoice::Given(function),
                ..FunctionOptions::default()
            },
            kernels: KernelOptions {
                boundary,
                ..KernelOptions::default()
            },
            refinement: Some(Refinement {
                cameras: vec![Camera::orthographic(
                    eye,
                    DVec3::ZERO,
                    DVec3::Z,
                    8.0,
                    [400; 2],
                )],
                ..Refinement::for_tolerance(1.0 / 255.0)
            }),
            ..SampleOptions::default()
        };
        super::super::volume(data, &options).unwrap()
    }

    /// Distance from the middle, whose surfaces of equal value bend.
    fn radii(mesh: &CellMesh) -> Vec<f64> {
        mesh.nodes.iter().map(|x| x.length()).collect()
    }

    fn volume_of(volume: &PointVolume) -> f64 {
        match &volume.strength {
            Strength::Classified { volumes } => volumes.iter().copied().map(f64::from).sum(),
            _ => 0.0,
        }
    }

    #[test]
    fn parts_take_the_place_of_their_nodes_and_keep_the_volume() {
        // The function shows everything, so that every part is kept; its features are wide, so that few are split.
        let values = radii(&block());
        let refined = of(block(), values, BoundaryChoice::Soft, 9.0);
        let report = &refined.report;
        assert!(
            report.refined_count > 100 && report.refined_level > 0,
            "{report:?}"
        );
        let count = refined.volume.particles.len();
        assert_eq!(report.particle_count, count);
        assert!(count - report.refined_count < 343);
        let volume = volume_of(&refined.volume);
        // Beside the soft surface evening out adds what kernels outside would bring: a seventh of so small a block.
        assert!((0.98..1.2).contains(&(volume / 216.0)), "{volume}");
        let columns = refined.volume.values.as_ref().map(Values::len);
        let models = refined
            .volume
            .local_models
            .as_ref()
            .map(|m| m.codes().len());
        assert_eq!((columns, models), (Some(count), Some(count)));
    }

    #[test]
    fn parts_that_are_not_shown_are_left_out() {
        let shell = of(block(), radii(&block()), BoundaryChoice::Soft, 0.2);
        assert!(shell.report.refined_count > 100, "{:?}", shell.report);
        let volume = volume_of(&shell.volume);
        assert!(volume < 0.9 * 216.0, "{volume}");
        let linear: Vec<f64> = block().nodes.iter().map(|x| x.x + 2.0).collect();
        let none = of(block(), linear, BoundaryChoice::Soft, 0.2).report;
        assert_eq!(none.refined_count, 0);
    }

    #[test]
    fn threads_change_no_bit() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let made = || of(block(), radii(&block()), BoundaryChoice::Sharp, 9.0);
            pool.build().unwrap().install(made).volume
        };
        let one = run(1);
        assert!(matches!(one.boundary, Some(Boundary::Planes(_))));
        assert!(one == run(3));
    }

    #[test]
    fn faulty_meshes_are_refined_without_a_panic() {
        let mut mesh = block();
        let mut values = radii(&mesh);
        // A missing position, a missing value, a flat cell, an inverted one, a repeated node.
        mesh.nodes[60] = DVec3::NAN;
        values[200] = f64::NAN;
        let entries = &mut mesh.connectivity;
        for c in 0..8 {
            entries[8 * 100 + c] = entries[8 * 100 + (c & 3)];
        }
        entries[8 * 150..8 * 151].reverse();
        entries[8 * 20 + 1] = entries[8 * 20];
        for boundary in [BoundaryChoice::Soft, BoundaryChoice::Sharp] {
            let found = of(mesh.clone(), values.clone(), boundary, 9.0);
            assert!(found.report.refined_count > 100);
            let volume = volume_of(&found.volume);
            assert!(volume.is_finite());
        }
    }
}
