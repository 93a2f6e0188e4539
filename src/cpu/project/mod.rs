//! Stage: projects particles to footprints. Twin: `shaders/project.wgsl`.
//!
//! | file | subject |
//! |---|---|
//! | `shapes.rs` | particles in camera space |
//! | `lanes.rs` | footprints of sixteen kernels at once |
//! | `footprint.rs` | the footprint of one particle of any kind |
//! | `output.rs` | further results |

mod footprint;
mod lanes;
mod output;
mod shapes;

use std::ops::Range;
use std::sync::atomic::Ordering;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::blocks::{BlockedVolume, Rule};
use crate::record::{
    BlockView, Carried, ClassifiedParticle, ExactTerms, Footprint, PATH_EXACT, PieceTerms,
    SurfelTerms, ViewUniform,
};
use crate::simd::{SimdLevel, SimdWork, run_at};
use crate::splat::{CHOICE_COLOURS, Edges, Filter, Kernel, choice_index, defocus};
use footprint::{cut_by_edges, depth_key, facing, slab_key, splat_footprint, surfel};
use lanes::{Batch, LANES, Shared};
pub use output::ProjectOutput;
use shapes::BlockShapes;
pub(super) use shapes::Shapes;

/// Input of the projection of a volume.
#[derive(Debug, Clone, Copy)]
pub struct ProjectInput<'a> {
    /// The volume.
    pub volume: &'a BlockedVolume,
    /// Its blocks in view.
    pub views: &'a [BlockView],
    /// Their visible particles, block after block.
    pub classified: &'a [ClassifiedParticle],
    /// The pieces of the particles, if kernels are classified over their extents; empty otherwise.
    pub pieces: &'a [PieceTerms],
    /// The camera.
    pub view: &'a ViewUniform,
    /// Rotation from the world into camera space.
    pub rotation: Mat3,
    /// True if kernels may be cut by surfaces, clip planes or slabs. If so, all have terms that describe
    /// their depth.
    pub is_cut: bool,
    /// True if the boundary of their domain may cut any kernel of the pass. If so, all have terms, which
    /// state whether it does.
    pub has_edges: bool,
    /// Instruction set of the loops over kernels. Footprints are the same at every level.
    pub level: SimdLevel,
}

/// Projects every particle of `input.classified`.
///
/// - `footprints`: as many as particles.
/// - `surfels`: as many as particles for surfels of opaque surfaces, empty otherwise.
/// - `exact`: as many as particles for all other volumes; empty if no filter of the frame is exact and
///   nothing is cut.
pub fn project(
    input: &ProjectInput<'_>,
    footprints: &mut [Footprint],
    exact: &mut [ExactTerms],
    surfels: &mut [SurfelTerms],
    output: &ProjectOutput,
) {
    /// Particles per parallel task: a few blocks.
    const GRAIN: usize = 2048;
    let projection = Projection::new(input, output);
    let task = |n: usize, footprints, exact, surfels| {
        let task = Task {
            projection: &projection,
            first: n * GRAIN,
            footprints,
            exact,
            surfels,
        };
        run_at(input.level, task);
    };
    let tasks = footprints.par_chunks_mut(GRAIN).enumerate();
    if matches!(projection.rule, Rule::Surface { .. }) {
        tasks
            .zip(surfels.par_chunks_mut(GRAIN))
            .for_each(|((n, out), surfels)| task(n, out, &mut [], surfels));
    } else if exact.is_empty() {
        tasks.for_each(|(n, out)| task(n, out, &mut [], &mut []));
    } else {
        tasks
            .zip(exact.par_chunks_mut(GRAIN))
            .for_each(|((n, out), exact)| task(n, out, exact, &mut []));
    }
}

/// Data that all tasks of a projection share.
struct Projection<'a> {
    input: &'a ProjectInput<'a>,
    output: &'a ProjectOutput,
    shapes: Shapes<'a>,
    rule: Rule,
    /// True if a cut exposes the inside of a closed surface.
    is_opened: bool,
    cuts_kernels: bool,
}

impl<'a> Projection<'a> {
    fn new(input: &'a ProjectInput<'a>, output: &'a ProjectOutput) -> Self {
        Self {
            input,
            output,
            shapes: Shapes::new(input.volume, input.rotation),
            rule: Rule::of(input.volume),
            is_opened: input.view.clip_count > 0,
            cuts_kernels: input.has_edges && input.volume.has_boundary(),
        }
    }
}

/// The projection of the particles of a few blocks.
struct Task<'a> {
    projection: &'a Projection<'a>,
    /// Index of its first particle among those classified.
    first: usize,
    footprints: &'a mut [Footprint],
    exact: &'a mut [ExactTerms],
    surfels: &'a mut [SurfelTerms],
}

impl SimdWork for Task<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FMA: bool, const WIDTH: usize>(mut self) {
        let ProjectInput {
            views, classified, ..
        } = *self.projection.input;
        let particles = &classified[self.first..][..self.footprints.len()];
        let mut batch = Batch::new();
        let mut placed = [Placed::default(); LANES];
        let mut start = 0;
        // Particles of a block are consecutive: their shared data is computed once.
        while let Some(particle) = particles.get(start) {
            let rest = &particles[start..];
            let count = rest.iter().take_while(|p| p.view == particle.view).count();
            let run = Run::new(self.projection, &views[particle.view as usize]);
            for first in (start..start + count).step_by(LANES) {
                let range = first..(first + LANES).min(start + count);
                self.few(
                    &run,
                    &mut batch,
                    &mut placed,
                    &particles[range.clone()],
                    range,
                );
            }
            start += count;
        }
        let (mut exact, mut tiles) = (0, 0);
        for footprint in self.footprints.iter().filter(|f| f.is_visible()) {
            exact += usize::from(footprint.path == PATH_EXACT);
            tiles += footprint.tile_count();
        }
        let output = self.projection.output;
        output.exact_count.fetch_add(exact, Ordering::Relaxed);
        output.tile_count.fetch_add(tiles, Ordering::Relaxed);
    }
}

/// A run of particles of one block.
struct Run<'a> {
    view: &'a BlockView,
    shapes: BlockShapes<'a>,
    origin: Vec3,
    filter: Filter,
    /// True if its kernels are projected in lanes, unless a kernel needs special treatment.
    is_in_lanes: bool,
    /// True if each particle's opacity is that of a lone kernel.
    is_lone: bool,
}

impl<'a> Run<'a> {
    fn new(projection: &'a Projection<'a>, block: &'a BlockView) -> Self {
        let filter = Filter::ALL[block.filter_kind as usize];
        // Merged particles already account for their members' opacity.
        let is_lone = projection.input.view.sub_pixel_opacity != 0 && block.level == 0;
        let is_kernel = matches!(projection.rule, Rule::Kernel | Rule::Translucent { .. });
        Self {
            view: block,
            shapes: projection.shapes.of_block(block.block),
            origin: Vec3::from(block.origin_camera),
            filter,
            is_in_lanes: is_kernel && !is_lone && Batch::takes(filter),
            is_lone,
        }
    }
}

/// A particle in camera space.
#[derive(Clone, Copy, Default)]
struct Placed {
    kernel: Kernel,
    /// Offset from the block's origin.
    offset: Vec3,
    /// For a piece: offset of its centre from the particle's.
    shift: Option<Vec3>,
}

impl Task<'_> {
    /// Projects at most [`LANES`] particles of a run.
    #[inline(always)]
    fn few(
        &mut self,
        run: &Run<'_>,
        batch: &mut Batch,
        placed: &mut [Placed; LANES],
        particles: &[ClassifiedParticle],
        range: Range<usize>,
    ) {
        let projection = self.projection;
        let ProjectInput {
            view,
            is_cut,
            has_edges,
            ..
        } = *projection.input;
        for (lane, (particle, placed)) in particles.iter().zip(placed.iter_mut()).enumerate() {
            *placed = projection.placed(run, particle, self.first + range.start + lane);
            if run.is_in_lanes {
                batch.set(lane, &placed.kernel);
            }
        }
        if run.is_in_lanes {
            batch.project(Shared {
                view,
                filter: run.filter,
                crowding: run.shapes.block.crowding,
                is_cut,
            });
        }
        let is_opaque = matches!(projection.rule, Rule::Surface { .. });
        for (lane, (particle, i)) in particles.iter().zip(range).enumerate() {
            let Placed {
                kernel,
                offset,
                shift,
            } = placed[lane];
            let edges = if projection.cuts_kernels {
                let planes = run.shapes.edges(particle.local);
                let moved = shift.unwrap_or_default();
                Edges::of(view, &kernel, &projection.input.rotation, moved, &planes)
            } else {
                Edges::default()
            };
            let key = depth_key(view, run.view, run.origin, offset);
            let carried = particle.carried;
            let is_uncut = edges.is_empty() && !edges.is_outside();
            let (mut terms, mut plane) = (None, None);
            let mut out;
            if run.is_in_lanes && is_uncut && batch.is_plain(lane) {
                out = batch.footprint(lane, carried, key);
                terms = batch.terms(lane, is_cut);
            } else {
                let own = Own {
                    kernel: &kernel,
                    edges: &edges,
                    // Pieces form sheets, so they are not lone.
                    is_lone: run.is_lone && shift.is_none(),
                    carried,
                    key,
                };
                out = projection.by_itself(run, &own, &mut terms, &mut plane);
            }
            if has_edges {
                terms.get_or_insert_default();
            }
            if view.keys_begin != 0 && !is_opaque {
                out.key = slab_key(view, run.view, run.origin, &kernel, &out);
            }
            if view.show_choice != 0 {
                let shown = choice_index(run.view.level, out.path, run.filter);
                out.carried = Carried::of_colour(CHOICE_COLOURS[shown]);
            }
            self.footprints[i] = out;
            if let (Some(terms), Some(own)) = (terms, self.exact.get_mut(i)) {
                *own = terms;
            }
            if let (Some(plane), Some(own)) = (plane, self.surfels.get_mut(i)) {
                *own = plane;
            }
        }
    }
}

/// Properties of one particle that its footprint depends on, besides its block.
struct Own<'a> {
    kernel: &'a Kernel,
    edges: &'a Edges,
    is_lone: bool,
    carried: Carried,
    key: u32,
}

impl Projection<'_> {
    /// Returns a particle's kernel at its position, modified by its piece and its normal.
    ///
    /// - `index`: index among all classified particles.
    #[inline(always)]
    fn placed(&self, run: &Run<'_>, particle: &ClassifiedParticle, index: usize) -> Placed {
        let ProjectInput { pieces, view, .. } = *self.input;
        let (mut offset, mut factor) = run.shapes.get(particle.local);
        let piece = pieces
            .get(index)
            .filter(|piece| piece.width != 1.0 || piece.shift != 0.0);
        let mut shift = None;
        if let Some(piece) = piece {
            let moved;
            (moved, factor) = piece.applied(run.shapes.axis(piece), factor);
            offset += moved;
            shift = Some(moved);
        }
        let mut kernel = Kernel {
            centre: run.origin + offset,
            factor,
            mass: particle.mass,
        };
        if let Rule::Translucent { is_one_sided } = self.rule {
            kernel.mass *= facing(view, &kernel, is_one_sided && !self.is_opened);
        }
        Placed {
            kernel,
            offset,
            shift,
        }
    }

    /// Returns the footprint of one particle that lanes do not handle.
    #[inline(never)]
    fn by_itself(
        &self,
        run: &Run<'_>,
        own: &Own<'_>,
        terms: &mut Option<ExactTerms>,
        plane: &mut Option<SurfelTerms>,
    ) -> Footprint {
        let Own {
            kernel,
            edges,
            is_lone,
            carried,
            key,
        } = *own;
        let near = &self.output.near;
        let blurred;
        let view = match self.rule {
            Rule::Kernel | Rule::Translucent { .. } if self.input.view.aperture > 0.0 => {
                blurred = ViewUniform {
                    low_pass_variance_px2: self.input.view.low_pass_variance_px2
                        + defocus(self.input.view, kernel),
                    ..*self.input.view
                };
                &blurred
            }
            _ => self.input.view,
        };
        let crowding = run.shapes.block.crowding;
        let is_cut = self.input.is_cut || !edges.is_empty();
        if edges.is_outside() {
            return footprint::invisible(kernel, carried, key);
        }
        let out = match self.rule {
            Rule::Peak(rule) => {
                // Splats have no depth of their own: that of the centre is used.
                *terms = is_cut.then(ExactTerms::default);
                splat_footprint(view, kernel, crowding, rule, carried, key)
            }
            Rule::Surface { is_one_sided } => {
                let is_one_sided = is_one_sided && !self.is_opened;
                surfel(view, kernel, is_one_sided, carried, key, plane, near)
            }
            Rule::Translucent { .. } | Rule::Kernel => footprint::footprint(
                view, run.filter, is_lone, kernel, crowding, carried, key, is_cut, terms, near,
            ),
        };
        if !edges.is_empty() && out.is_visible() {
            cut_by_edges(view, kernel, edges, &out, terms, self.output);
        }
        out
    }
}
