//! Stage: projects particles to footprints.

use glam::Mat3;

use super::constants::{RULE_KERNEL, RULE_PEAK, RULE_SURFACE, RULE_TRANSLUCENT, THREADS};
use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::kinds::{Kinds, ParticleKind};
use super::packed::rotation_uniform;
use super::particles::{lattice_uniform, pack_blocks, pack_shapes};
use super::shader::{NORMAL, Shader, TANGENTS, shaders_of_particles};
use crate::blocks::{BlockedParticles, BlockedVolume, Rule};
use crate::error::Result;
use crate::record::{
    BlockView, ClassifiedParticle, ExactTerms, Footprint, NearTerms, PieceTerms, SurfelTerms,
    ViewUniform,
};
use crate::scene::SplatRule;
use crate::splat::Filter;

/// Shaders of the stage for each kind of particles, in the order of [`ParticleKind`].
pub(super) const SHADERS: [Shader; 4] = shaders_of_particles!(
    "project",
    include_str!("../../shaders/shared/footprint.wgsl"),
    include_str!("../../shaders/shared/defocus.wgsl"),
    include_str!("../../shaders/shared/sub_pixel.wgsl"),
    include_str!("../../shaders/shared/exact.wgsl"),
    include_str!("../../shaders/shared/bounds.wgsl"),
    include_str!("../../shaders/shared/filter.wgsl"),
    include_str!("../../shaders/shared/cutoff.wgsl"),
    include_str!("../../shaders/shared/peak.wgsl"),
    include_str!("../../shaders/shared/near.wgsl"),
    NORMAL,
    TANGENTS,
    include_str!("../../shaders/shared/surfel.wgsl"),
    include_str!("../../shaders/shared/edges.wgsl"),
    include_str!("../../shaders/project.wgsl"),
);

/// Variant of a projection's pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProjectSpec {
    pub(super) particles: ParticleKind,
    pub(super) filter: Filter,
    pub(super) is_orthographic: bool,
    pub(super) rule: Rule,
    /// True if opaque surfaces may cut kernels.
    pub(super) is_cut: bool,
    /// True if the boundary of their domain may cut any kernel of the pass.
    pub(super) has_edges: bool,
    /// Word of the counts with the number of classified particles.
    pub(super) count_index: u32,
    /// True if the particles are pieces, whose terms follow them at the offset in the first word of the
    /// counts.
    pub(super) has_pieces: bool,
}

impl ProjectSpec {
    /// Returns the variant for a part under a view.
    ///
    /// - `is_cut`: whether opaque surfaces may cut its kernels.
    /// - `count_index`: the part's word of the counts.
    /// - `has_edges`: whether the boundary of their domain may cut any kernel of the pass.
    pub(super) fn new(
        kinds: &Kinds,
        view: &ViewUniform,
        [is_cut, has_edges]: [bool; 2],
        count_index: u32,
    ) -> Self {
        Self {
            particles: kinds.particles,
            filter: Filter::ALL[view.filter_kind as usize],
            is_orthographic: view.orthographic != 0,
            rule: kinds.rule,
            is_cut,
            has_edges,
            count_index,
            has_pieces: false,
        }
    }

    /// Returns whether any of its footprints may have terms: on the exact path, of a surfel, or if cut.
    pub(super) fn has_terms(&self) -> bool {
        let may_be_exact =
            matches!(self.filter, Filter::Adaptive | Filter::Exact) && !self.is_orthographic;
        match self.rule {
            Rule::Surface { .. } => true,
            Rule::Peak { .. } => self.is_cut || self.has_edges,
            Rule::Kernel | Rule::Translucent { .. } => {
                self.is_cut || self.has_edges || may_be_exact
            }
        }
    }
}

/// The pipeline that projects the particles of one kind.
#[derive(Debug)]
pub(super) struct Project {
    kernel: Kernel,
}

/// The buffers of a part's projection.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectBuffers<'a> {
    /// [`DeviceBlock`](crate::record::DeviceBlock)s; for a lattice its
    /// [`LatticeUniform`](crate::record::LatticeUniform).
    pub(super) blocks: &'a wgpu::Buffer,
    /// Output of [`pack_shapes`]; at least 12 bytes.
    pub(super) shapes: &'a wgpu::Buffer,
    /// A uniform [`ViewUniform`].
    pub(super) view: &'a wgpu::Buffer,
    /// A uniform of [`rotation_uniform`].
    pub(super) rotation: &'a wgpu::Buffer,
    /// A buffer of counts, including that of the classified particles.
    pub(super) counts: &'a wgpu::Buffer,
    pub(super) views: &'a wgpu::Buffer,
    pub(super) classified: &'a wgpu::Buffer,
    pub(super) footprints: &'a wgpu::Buffer,
    /// As many as footprints; a single one suffices if no footprint has terms.
    pub(super) exact: &'a wgpu::Buffer,
    /// Two counters, zero at the beginning of a frame, and space for [`NearTerms`], at least one.
    pub(super) near: &'a wgpu::Buffer,
}

impl Project {
    pub(super) fn new(gpu: &Gpu, spec: &ProjectSpec) -> Self {
        let shader = &SHADERS[spec.particles as usize];
        let flag = |is: bool| f64::from(u8::from(is));
        let exact = SplatRule::Exact;
        let (rule, splat_rule, is_one_sided) = match spec.rule {
            Rule::Kernel => (RULE_KERNEL, exact, false),
            Rule::Peak(splat_rule) => (RULE_PEAK, splat_rule, false),
            Rule::Surface { is_one_sided } => (RULE_SURFACE, exact, is_one_sided),
            Rule::Translucent { is_one_sided } => (RULE_TRANSLUCENT, exact, is_one_sided),
        };
        let kernel = gpu.kernel(
            shader,
            "project",
            &[
                Access::Read,
                Access::Read,
                Access::Uniform,
                Access::Uniform,
                Access::Read,
                Access::Read,
                Access::Read,
                Access::Write,
                Access::Write,
                Access::Write,
            ],
            &[
                ("COUNT_INDEX", f64::from(spec.count_index)),
                ("FILTER", f64::from(spec.filter as u32)),
                ("IS_ORTHOGRAPHIC", flag(spec.is_orthographic)),
                ("RULE", f64::from(rule)),
                ("SPLAT_RULE", f64::from(splat_rule as u32)),
                ("IS_ONE_SIDED", flag(is_one_sided)),
                ("IS_CUT", flag(spec.is_cut)),
                ("HAS_PIECES", flag(spec.has_pieces)),
                ("HAS_EDGES", flag(spec.has_edges)),
            ],
        );
        Self { kernel }
    }

    /// Binds the pipeline, to be dispatched with one workgroup per [`THREADS`] classified particles.
    pub(super) fn bind(&self, gpu: &Gpu, buffers: &ProjectBuffers<'_>) -> BoundKernel {
        self.kernel.bind(
            gpu,
            &[
                buffers.blocks,
                buffers.shapes,
                buffers.view,
                buffers.rotation,
                buffers.counts,
                buffers.views,
                buffers.classified,
                buffers.footprints,
                buffers.exact,
                buffers.near,
            ],
        )
    }
}

/// Returns the bytes of a list of near kernels of this capacity: two counters and the terms.
pub(super) fn near_bytes(capacity: usize) -> u64 {
    (8 + capacity * size_of::<NearTerms>()) as u64
}

/// Results of the projection of one frame.
#[derive(Debug, Clone, Default)]
pub struct Projected {
    /// One per classified particle.
    pub footprints: Vec<Footprint>,
    /// As many, if any kernel may have terms; valid for footprints that are on the exact path or may be
    /// cut.
    pub exact: Vec<ExactTerms>,
    /// As many, for surfels of opaque surfaces.
    pub surfels: Vec<SurfelTerms>,
    /// Terms of the kernels that cross the camera plane, in no particular order.
    pub near: Vec<NearTerms>,
    /// Number of these terms; more than the length of `near` if its capacity was exceeded.
    pub near_count: u32,
}

/// Projects every particle of `classified`, as [`cpu::project`](crate::cpu::project) does. At most
/// `near_capacity` kernels (at least one) may cross the camera plane; further ones draw nothing.
///
/// - `pieces`: the terms of all particles, or nothing.
/// - `is_cut`: whether opaque surfaces may cut kernels.
///
/// # Errors
/// No memory, or a lost device.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn project(
    gpu: &Gpu,
    volume: &BlockedVolume,
    views: &[BlockView],
    classified: &[ClassifiedParticle],
    pieces: &[PieceTerms],
    view: &ViewUniform,
    rotation: Mat3,
    is_cut: bool,
    near_capacity: usize,
) -> Result<Projected> {
    if classified.is_empty() {
        return Ok(Projected::default());
    }
    let near_capacity = near_capacity.max(1);
    let all = 0..volume.blocks.len();
    let blocks = match &volume.particles {
        BlockedParticles::Lattice(grid) => gpu.upload("lattice", &[lattice_uniform(grid, 0)])?,
        _ => gpu.upload("blocks", &pack_blocks(volume, all.clone(), None))?,
    };
    let mut shapes = pack_shapes(volume, all);
    let has_edges = volume.has_boundary();
    let mut spec = ProjectSpec::new(&Kinds::of(volume), view, [is_cut, has_edges], 0);
    spec.has_pieces = !pieces.is_empty();
    let with_terms = [
        bytemuck::cast_slice::<_, u32>(classified),
        bytemuck::cast_slice(pieces),
    ];
    // A binding needs at least one element.
    shapes.resize(
        shapes.len().max(spec.particles.words_per_particle().max(4)),
        0.0,
    );
    let shapes = gpu.upload("shapes", &shapes)?;
    let count = classified.len();
    let is_opaque = volume.is_surface();
    let exact_count = if spec.has_terms() { count } else { 0 };
    let bytes = |count: usize, each: usize| (count.max(1) * each) as u64;
    let footprints = gpu.buffer("footprints", bytes(count, size_of::<Footprint>()))?;
    let exact = gpu.buffer("exact terms", bytes(exact_count, size_of::<ExactTerms>()))?;
    let near = gpu.buffer("near kernels", near_bytes(near_capacity))?;
    let bound = Project::new(gpu, &spec).bind(
        gpu,
        &ProjectBuffers {
            blocks: &blocks,
            shapes: &shapes,
            view: &gpu.uniform("view", view)?,
            rotation: &gpu.uniform("rotation", &rotation_uniform(rotation.to_cols_array_2d()))?,
            counts: &gpu.upload("counts", &[count as u32])?,
            views: &gpu.upload("block views", views)?,
            classified: &gpu.upload("classified particles", &with_terms.concat())?,
            footprints: &footprints,
            exact: &exact,
            near: &near,
        },
    );
    gpu.run(|pass| bound.dispatch(pass, (count as u32).div_ceil(THREADS)));
    let words: Vec<u32> = gpu.read(&near, near_bytes(near_capacity) as usize / 4)?;
    let near_count = words[0];
    let kept = (near_count as usize).min(near_capacity);
    Ok(Projected {
        footprints: gpu.read(&footprints, count)?,
        exact: gpu.read(&exact, if is_opaque { 0 } else { exact_count })?,
        surfels: gpu.read(&exact, if is_opaque { exact_count } else { 0 })?,
        near: bytemuck::pod_collect_to_vec(&words[2..][..kept * size_of::<NearTerms>() / 4]),
        near_count,
    })
}
