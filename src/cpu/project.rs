//! Stage: from particles to footprints. Twin: `shaders/project.wgsl`.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid, Rule};
use crate::constants::{MAX_CUTOFF, MOST_EDGES, NEAR_MARGIN, TILE_SIZE};
use crate::math::Factor;
use crate::record::{
    BlockView, Carried, ClassifiedParticle, ExactTerms, Footprint, NearTerms, PATH_AFFINE,
    PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_NEAR_SURFEL, PATH_PEAK, PATH_SURFEL, PieceTerms,
    SurfelTerms, ViewUniform, pack_range,
};
use crate::scene::NO_EDGE;
use crate::splat::{
    CHOICE_COLOURS, Edges, Filter, ImageKernel, Kernel, ScreenFactor, SurfelFootprint,
    budget::CUTOFF_SHARE, choice_index, choose_exact, cutoff_radius, cutoff_share, depth_terms,
    edge_growth, exact_extent, half_line_terms, near_surfel, near_terms, peak_footprint,
    project_kernel, surfel_footprint,
};

/// What the projection of one frame writes besides footprints.
#[derive(Debug, Default)]
pub struct ProjectOutput {
    near: Mutex<Vec<NearTerms>>,
    /// How many of them are edges alone.
    cut_count: AtomicUsize,
    any_exact: AtomicBool,
}

impl ProjectOutput {
    /// Forgets the last frame.
    pub fn clear(&mut self) {
        self.near
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner)
            .clear();
        *self.cut_count.get_mut() = 0;
        *self.any_exact.get_mut() = false;
    }

    /// Terms of the kernels that cross the camera plane, few, and of those that the domain of their data
    /// cuts, in no particular order.
    pub fn near(&mut self) -> &[NearTerms] {
        self.near.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many kernels cross the camera plane.
    pub fn near_count(&mut self) -> usize {
        let cut = *self.cut_count.get_mut();
        self.near().len() - cut
    }

    /// Whether any footprint is on the exact path.
    pub fn any_exact(&self) -> bool {
        self.any_exact.load(Ordering::Relaxed)
    }
}

/// Projects every particle of `classified`: `footprints` has its length, and so has `surfels` of surfels
/// of opaque surfaces, `exact` of all else (empty where no filter of the frame asks for it and nothing
/// is cut).
///
/// - `pieces`: where kernels are classified over their extents, what each particle's has become; empty
///   elsewhere.
/// - `is_cut`: whether kernels may be cut, by surfaces, clip surfels or slabs, so that all have terms of
///   their depth.
/// - `has_edges`: whether the domain of its data may cut any kernel of the pass: then all have terms,
///   which say whether it does.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn project(
    volume: &BlockedVolume,
    views: &[BlockView],
    classified: &[ClassifiedParticle],
    pieces: &[PieceTerms],
    view: &ViewUniform,
    rotation: Mat3,
    is_cut: bool,
    has_edges: bool,
    footprints: &mut [Footprint],
    exact: &mut [ExactTerms],
    surfels: &mut [SurfelTerms],
    output: &ProjectOutput,
) {
    /// Particles per parallel task: a few blocks.
    const GRAIN: usize = 2048;
    let shapes = Shapes::new(volume, rotation);
    let rule = Rule::of(volume);
    // A cut shows the inside of what was closed.
    let is_opened = view.clip_count > 0;
    let is_opaque = matches!(rule, Rule::Surface { .. });
    let cuts_kernels = has_edges && volume.has_boundary();
    let task = |first: usize,
                particles: &[ClassifiedParticle],
                out: &mut [Footprint],
                exact: &mut [ExactTerms],
                surfels: &mut [SurfelTerms]| {
        let mut any_exact = false;
        let mut run = None;
        for (i, particle) in particles.iter().enumerate() {
            let block = &views[particle.view as usize];
            // Particles of a block follow one another: what they share is found once.
            let shapes = match &run {
                Some((view, shapes)) if *view == particle.view => shapes,
                _ => &run.insert((particle.view, shapes.of_block(block.block))).1,
            };
            let (mut offset, mut factor) = shapes.get(particle.local);
            let piece = pieces
                .get(first + i)
                .filter(|piece| piece.width != 1.0 || piece.shift != 0.0);
            let mut shift = Vec3::ZERO;
            if let Some(piece) = piece {
                (shift, factor) = piece.applied(shapes.axis(piece), factor);
                offset += shift;
            }
            let crowding = shapes.block.crowding;
            let origin = Vec3::from(block.origin_camera);
            let mut kernel = Kernel {
                centre: origin + offset,
                factor,
                mass: particle.mass,
            };
            let key = depth_key(view, block, origin, offset);
            let filter = Filter::ALL[block.filter_kind as usize];
            // Merged particles know of their members' opacity; pieces make up sheets.
            let is_lone = view.sub_pixel_opacity != 0 && block.level == 0 && piece.is_none();
            let carried = particle.carried;
            let (mut terms, mut plane) = (None, None);
            let near = &output.near;
            let edges = if cuts_kernels {
                Edges::of(
                    view,
                    &kernel,
                    &rotation,
                    shift,
                    &shapes.edges(particle.local),
                )
            } else {
                Edges::default()
            };
            let is_cut = is_cut || !edges.is_empty();
            out[i] = match rule {
                Rule::Peak { is_anti_aliased } => {
                    // Without a depth of its own: where its centre lies.
                    terms = is_cut.then(ExactTerms::default);
                    splat_footprint(view, &kernel, crowding, is_anti_aliased, carried, key)
                }
                Rule::Surface { is_one_sided } => {
                    let is_one_sided = is_one_sided && !is_opened;
                    surfel(view, &kernel, is_one_sided, carried, key, &mut plane, near)
                }
                Rule::Translucent { is_one_sided } => {
                    kernel.mass *= facing(view, &kernel, is_one_sided && !is_opened);
                    footprint(
                        view, filter, is_lone, &kernel, crowding, carried, key, is_cut, &mut terms,
                        near,
                    )
                }
                Rule::Kernel => footprint(
                    view, filter, is_lone, &kernel, crowding, carried, key, is_cut, &mut terms,
                    near,
                ),
            };
            if edges.is_outside() {
                (out[i].columns, out[i].rows) = (0, 0);
            } else if !edges.is_empty() && out[i].is_visible() {
                cut_by_edges(view, &kernel, &edges, &out[i], &mut terms, output);
            }
            if has_edges {
                terms.get_or_insert_default();
            }
            if view.keys_begin != 0 && !is_opaque {
                out[i].key = slab_key(view, block, origin, &kernel, &out[i]);
            }
            if view.show_choice != 0 {
                let shown = choice_index(block.level, out[i].path, filter);
                out[i].carried = Carried::of_colour(CHOICE_COLOURS[shown]);
            }
            if let Some(terms) = terms.filter(|_| !is_opaque) {
                exact[i] = terms;
                any_exact |= out[i].path == PATH_EXACT;
            }
            if let Some(plane) = plane {
                surfels[i] = plane;
            }
        }
        if any_exact {
            output.any_exact.store(true, Ordering::Relaxed);
        }
    };
    let tasks = footprints
        .par_chunks_mut(GRAIN)
        .zip(classified.par_chunks(GRAIN))
        .enumerate()
        .map(|(n, (out, particles))| (n * GRAIN, particles, out));
    if is_opaque {
        tasks
            .zip(surfels.par_chunks_mut(GRAIN))
            .for_each(|((first, particles, out), surfels)| {
                task(first, particles, out, &mut [], surfels);
            });
    } else if exact.is_empty() {
        tasks.for_each(|(first, particles, out)| task(first, particles, out, &mut [], &mut []));
    } else {
        tasks
            .zip(exact.par_chunks_mut(GRAIN))
            .for_each(|((first, particles, out), exact)| {
                task(first, particles, out, exact, &mut []);
            });
    }
}

/// Positions and factors of a volume's particles, rotated into camera space.
struct Shapes<'a> {
    volume: &'a BlockedVolume,
    rotation: Mat3,
    /// Of a lattice: the units of its axes in camera space.
    turned_basis: Mat3,
    shared: Option<Factor>,
}

impl<'a> Shapes<'a> {
    fn new(volume: &'a BlockedVolume, rotation: Mat3) -> Self {
        let (turned_basis, shared) = match &volume.particles {
            BlockedParticles::Lattice(grid) => (
                rotation * grid.basis(),
                grid.shared_factor()
                    .map(|f| Factor::from_matrix(rotation * f)),
            ),
            _ => (rotation, None),
        };
        Self {
            volume,
            rotation,
            turned_basis,
            shared,
        }
    }

    fn of_block(&self, block: u32) -> BlockShapes<'_> {
        let cells = match &self.volume.particles {
            BlockedParticles::Lattice(grid) => grid.cells(block),
            _ => [[0; 2]; 3],
        };
        BlockShapes {
            shapes: self,
            block: &self.volume.blocks[block as usize],
            cells,
        }
    }
}

/// The shapes of one block's particles.
struct BlockShapes<'a> {
    shapes: &'a Shapes<'a>,
    block: &'a Block,
    /// A brick's cells.
    cells: [[usize; 2]; 3],
}

impl BlockShapes<'_> {
    /// The axis of a piece in the frame of the factor's columns in camera space. That of a sphere has the
    /// camera's axes, all others' turn with the kernel.
    #[inline]
    fn axis(&self, piece: &PieceTerms) -> Vec3 {
        let axis = Vec3::from(piece.axis);
        match &self.shapes.volume.particles {
            BlockedParticles::Isotropic { .. } => self.shapes.rotation * axis,
            _ => axis,
        }
    }

    /// The planes that may cut a particle's kernel, world: an infinite distance where there is none.
    fn edges(&self, local: u32) -> [[f32; 4]; MOST_EDGES] {
        let volume = self.shapes.volume;
        match &volume.particles {
            BlockedParticles::Lattice(grid) => {
                grid.edges(BrickGrid::cell(self.cells.map(|[first, _]| first), local))
            }
            _ => {
                let planes = volume.boundary.as_ref();
                let own = planes.and_then(|p| p.of((self.block.first + local) as usize));
                own.copied().unwrap_or([NO_EDGE; MOST_EDGES])
            }
        }
    }

    /// Offset from the block's origin and factor, camera space.
    #[inline]
    fn get(&self, local: u32) -> (Vec3, Factor) {
        let Shapes {
            volume,
            rotation,
            turned_basis,
            shared,
        } = self.shapes;
        let i = (self.block.first + local) as usize;
        match &volume.particles {
            BlockedParticles::Lattice(grid) => {
                let cell = BrickGrid::cell(self.cells.map(|[first, _]| first), local);
                let factor = shared.unwrap_or_else(|| grid.cell_factor(turned_basis, cell));
                (*rotation * grid.offset(self.cells, cell), factor)
            }
            BlockedParticles::Isotropic { offsets, sigmas } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::sphere(sigmas[i]),
            ),
            BlockedParticles::Anisotropic { offsets, factors } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::rotated(rotation, &factors[i]),
            ),
            BlockedParticles::Surfels {
                offsets, tangents, ..
            } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::of_tangents(rotation, &tangents[i]),
            ),
        }
    }
}

/// The key of the distance |B + o| = |B| + o.(2B + o)/(|B + o| + |B|): the block's own key, exact,
/// plus a difference that f32 holds to some 22 bits of the block's size: together within 1.5 keys
/// and four roundings of that size (`tests/frames/bounds.rs`).
#[inline]
fn depth_key(view: &ViewUniform, block: &BlockView, origin: Vec3, offset: Vec3) -> u32 {
    let delta = if view.directional_keys != 0 {
        offset.dot(Vec3::from(view.key_axis))
    } else if view.orthographic != 0 {
        offset.z
    } else {
        let sum = (origin + offset).length() + origin.length();
        if sum > 0.0 {
            offset.dot(origin * 2.0 + offset) / sum
        } else {
            0.0
        }
    };
    let keys = (delta * view.key_scale).round_ties_even() as i32;
    block.key.saturating_add_signed(keys)
}

/// The key of the depth at which a kernel begins: what lies behind the eye begins with it.
#[inline]
fn slab_key(
    view: &ViewUniform,
    block: &BlockView,
    origin: Vec3,
    kernel: &Kernel,
    footprint: &Footprint,
) -> u32 {
    let reach = footprint.cutoff_squared.sqrt() * kernel.factor.z.length();
    let begin = (kernel.centre.z - reach).max(0.0);
    let keys = ((begin - origin.z) * view.key_scale).round_ties_even() as i32;
    block.key.saturating_add_signed(keys)
}

/// A footprint that reaches no pixel yet.
#[inline]
fn invisible(kernel: &Kernel, carried: Carried, key: u32) -> Footprint {
    Footprint {
        centre_px: [0.0; 2],
        form_p: [0.0; 2],
        form_r: [0.0; 2],
        tau: 0.0,
        cutoff_squared: 0.0,
        carried,
        depth: kernel.centre.z,
        path: PATH_AFFINE,
        columns: 0,
        rows: 0,
        key,
    }
}

/// The footprint of a splat whose opacity is stated: what the cut-off leaves out is not given
/// back, the peak stays.
#[inline]
fn splat_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    crowding: f32,
    is_anti_aliased: bool,
    carried: Carried,
    key: u32,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    let Some((screen, image)) = peak_footprint(view, kernel, is_anti_aliased) else {
        return out;
    };
    let depth = image.tau * image.enlargement * crowding;
    let r = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    affine_part(&mut out, &screen, &image, r);
    out.tau = image.tau;
    out.path = PATH_PEAK;
    let half = Vec2::new(image.a.sqrt(), image.c.sqrt()) * r;
    set_bounds(view, &mut out, screen.centre_px, half);
    out
}

/// The footprint of a surfel of an opaque surface.
#[inline]
fn surfel(
    view: &ViewUniform,
    kernel: &Kernel,
    is_one_sided: bool,
    carried: Carried,
    key: u32,
    plane: &mut Option<SurfelTerms>,
    near: &Mutex<Vec<NearTerms>>,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    // Weights are averaged: where a kernel ends counts as a share of it.
    let r = cutoff_radius(0.0, 1.0, view.tolerance / CUTOFF_SHARE, view.cutoff);
    let reach = r * kernel.factor.z.length();
    if kernel.centre.z < -reach {
        return out;
    }
    if kernel.centre.z <= NEAR_MARGIN * reach && view.orthographic == 0 {
        let Some((terms, weight)) = near_surfel(kernel, is_one_sided) else {
            return out;
        };
        let columns = near_range(kernel, Vec3::X, kernel.factor.x, view, 0, r, 0.0);
        let rows = near_range(kernel, Vec3::Y, kernel.factor.y, view, 1, r, 0.0);
        if let (Some(columns), Some(rows)) = (columns, rows) {
            out.columns = columns;
            out.rows = rows;
            out.tau = weight / cutoff_share(r);
            out.cutoff_squared = r * r;
            out.path = push_at(near, terms) << 4 | PATH_NEAR_SURFEL;
            out.depth = f32::INFINITY;
        }
        return out;
    }
    let Some(surfel) = surfel_footprint(view, kernel, is_one_sided, r) else {
        return out;
    };
    let SurfelFootprint {
        screen,
        image,
        terms,
    } = surfel;
    affine_part(&mut out, &screen, &image, r);
    out.path = PATH_SURFEL;
    let mut middle = Vec2::ZERO;
    let mut half = Vec2::new(image.a.sqrt(), image.c.sqrt()) * r;
    if terms.homography > 0.0 {
        let h2 = view.low_pass_variance_px2;
        let Some(extent) = exact_extent(&screen, h2, r) else {
            return out;
        };
        (middle, half) = extent;
    }
    set_bounds(view, &mut out, screen.centre_px + middle, half);
    // The inverse depth within the box: no fragment of it is nearer.
    let gradient = Vec2::from(terms.gradient);
    let nearest = terms.inverse_depth + gradient.dot(middle) + gradient.abs().dot(half);
    out.depth = nearest + terms.slack;
    *plane = Some(terms);
    out
}

/// The cosine between a surfel's normal and the ray through its centre: what makes the optical depth
/// of a sheet the same from every side; 0 for one that is seen from behind and has one side.
#[inline]
fn facing(view: &ViewUniform, kernel: &Kernel, is_one_sided: bool) -> f32 {
    let [a, b, _] = kernel.factor.columns();
    let unit = |v: Vec3| v / v.abs().max_element();
    let normal = unit(a).cross(unit(b));
    let ray = if view.orthographic != 0 {
        Vec3::Z
    } else {
        unit(kernel.centre)
    };
    let across = normal.dot(ray);
    let lengths = normal.length() * ray.length();
    // Phrased so that NaN draws nothing.
    if !(lengths > 0.0) || (is_one_sided && across > 0.0) {
        return 0.0;
    }
    across.abs() / lengths
}

/// The footprint of one kernel; invisible where it reaches no pixel.
#[allow(
    clippy::too_many_arguments,
    reason = "what one kernel's footprint depends on, and where its terms go"
)]
#[inline]
pub(crate) fn footprint(
    view: &ViewUniform,
    filter: Filter,
    is_lone: bool,
    kernel: &Kernel,
    crowding: f32,
    carried: Carried,
    key: u32,
    is_cut: bool,
    exact: &mut Option<ExactTerms>,
    near: &Mutex<Vec<NearTerms>>,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    let h2 = view.low_pass_variance_px2;
    let z = kernel.factor.z;
    let mut reach = z.length();
    if reach == f32::INFINITY {
        // Lengths beyond 1e19, whose squares f32 does not hold.
        reach = z.x.hypot(z.y).hypot(z.z);
    }
    if kernel.centre.z < -MAX_CUTOFF * reach {
        return out;
    }
    let orthographic = view.orthographic != 0;
    if kernel.centre.z <= 0.0 && !orthographic {
        near_footprint(view, kernel, crowding, near, &mut out);
        return out;
    }
    let screen = project_kernel(view, kernel);
    let mut image = screen.filtered(filter, h2);
    if is_lone {
        image = screen.as_lone(filter, h2, image);
    }
    let is_shape = screen.row_x.is_finite() && screen.row_y.is_finite();
    if !(is_shape && image.tau > 0.0 && image.tau.is_finite()) {
        // A singular footprint (no low-pass filter), or numbers beyond f32.
        return out;
    }
    // Of what ends together.
    let depth = image.tau * image.enlargement * crowding;
    let mut r = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    let mut terms = choose_exact(view, filter, &screen, &image, crowding);
    if let Some(terms) = &terms {
        // Away from the camera's axis one side of the edge stands out: the kernel ends where that
        // side has met the tolerance. A tenth more, because the wider edge stands out more.
        let growth = edge_growth(view, &screen, &image, terms, 1.1 * r);
        let wider = cutoff_radius(depth, growth, view.tolerance, view.cutoff);
        // `max` takes the other argument when one is NaN.
        r = r.max(wider);
    }
    if kernel.centre.z <= NEAR_MARGIN * r * reach {
        if orthographic {
            half_line_footprint(view, kernel, near, &mut out, &screen, &image, r);
        } else {
            near_footprint(view, kernel, crowding, near, &mut out);
        }
        return out;
    }
    if terms.is_some() {
        let Some((middle, half)) = exact_extent(&screen, h2, r) else {
            return out;
        };
        if let (true, Some(terms)) = (is_cut, &mut terms) {
            (_, terms.depth_sigma) =
                depth_terms(view, &screen, h2, image.determinant, kernel.centre.z);
        }
        *exact = terms;
        affine_part(&mut out, &screen, &image, r);
        out.path = PATH_EXACT;
        // |D| is evaluated per pixel; |D0| goes here.
        out.tau /= screen.ray_length;
        set_bounds(view, &mut out, screen.centre_px + middle, half);
    } else {
        if is_cut {
            let determinant = screen.filtered(Filter::Ewa, h2).determinant;
            let (slope, depth_sigma) = depth_terms(view, &screen, h2, determinant, kernel.centre.z);
            *exact = Some(ExactTerms {
                gradient: slope.into(),
                depth_sigma,
                ..ExactTerms::default()
            });
        }
        affine_part(&mut out, &screen, &image, r);
        let half = Vec2::new(image.a.sqrt(), image.c.sqrt()) * r;
        set_bounds(view, &mut out, screen.centre_px, half);
    }
    out
}

#[inline]
fn affine_part(out: &mut Footprint, screen: &ScreenFactor, image: &ImageKernel, r: f32) {
    let [p, q] = image.triangular_form();
    out.centre_px = screen.centre_px.into();
    out.form_p = p;
    out.form_r = q;
    out.tau = image.tau / cutoff_share(r);
    out.cutoff_squared = r * r;
}

/// Pixels whose centres lie within `half` of `centre`.
#[inline]
fn set_bounds(view: &ViewUniform, out: &mut Footprint, centre: Vec2, half: Vec2) {
    let range = |centre: f32, half: f32, size: u32| {
        // Casts saturate, and NaN gives 0: an empty range.
        let first = (centre - half - 0.5).ceil().max(0.0) as u32;
        let end = ((centre + half - 0.5).floor() + 1.0).max(0.0) as u32;
        (first < end.min(size)).then(|| pack_range(first, end.min(size)))
    };
    if let (Some(columns), Some(rows)) = (
        range(centre.x, half.x, view.size[0]),
        range(centre.y, half.y, view.size[1]),
    ) {
        out.columns = columns;
        out.rows = rows;
    }
}

fn push(near: &Mutex<Vec<NearTerms>>, terms: NearTerms, path: u32) -> u32 {
    push_at(near, terms) << 2 | path
}

/// The place of terms among those of near kernels.
fn push_at(near: &Mutex<Vec<NearTerms>>, terms: NearTerms) -> u32 {
    let mut near = near.lock().unwrap_or_else(PoisonError::into_inner);
    near.push(terms);
    (near.len() - 1) as u32
}

/// Gives a footprint the planes at which the domain of its data cuts it.
fn cut_by_edges(
    view: &ViewUniform,
    kernel: &Kernel,
    edges: &Edges,
    out: &Footprint,
    terms: &mut Option<ExactTerms>,
    output: &ProjectOutput,
) {
    let near = &output.near;
    if matches!(out.path & 3, PATH_NEAR | PATH_HALF_LINE) {
        let mut near = near.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = near.get_mut((out.path >> 2) as usize) {
            edges.write(view, kernel, out.path, own);
        }
        return;
    }
    let mut own = NearTerms::default();
    edges.write(view, kernel, out.path, &mut own);
    output.cut_count.fetch_add(1, Ordering::Relaxed);
    terms.get_or_insert_default().edges = push_at(near, own) + 1;
}

/// An orthographic kernel that reaches behind the eye's plane.
fn half_line_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    near: &Mutex<Vec<NearTerms>>,
    out: &mut Footprint,
    screen: &ScreenFactor,
    image: &ImageKernel,
    r: f32,
) {
    affine_part(out, screen, image, r);
    let half = Vec2::new(image.a.sqrt(), image.c.sqrt()) * r;
    set_bounds(view, out, screen.centre_px, half);
    if out.is_visible() {
        let h2 = view.low_pass_variance_px2;
        let determinant = screen.filtered(Filter::Ewa, h2).determinant;
        let (slope, sigma) = depth_terms(view, screen, h2, determinant, kernel.centre.z);
        out.path = push(near, half_line_terms(kernel, slope, sigma), PATH_HALF_LINE);
    }
}

/// A perspective kernel that reaches the camera plane.
fn near_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    crowding: f32,
    near: &Mutex<Vec<NearTerms>>,
    out: &mut Footprint,
) {
    let Some((terms, weight)) = near_terms(view, kernel) else {
        return;
    };
    // A bound of the optical depth in any direction: |D|/sqrt(DᵀKD) <= sqrt(trace V / det V), V
    // with the low-pass filter of `near_terms`.
    let h = view.low_pass_variance_px2.sqrt();
    let low_pass = h * kernel.centre.z.abs().max(kernel.factor.z.length());
    let trace = kernel
        .factor
        .columns()
        .into_iter()
        .chain(view.focal_px.map(|f| Vec3::X * (low_pass / f)))
        .map(|c| c.length_squared())
        .sum::<f32>();
    let unit2 = kernel.mass / (std::f32::consts::TAU * weight);
    let mut highest = weight * (trace / unit2).sqrt() / terms.sigma;
    if !highest.is_finite() {
        // A flat kernel's bound is infinite, and NaN must not shrink anything.
        highest = f32::MAX;
    }
    let r = cutoff_radius(highest * crowding, 1.0, view.tolerance, view.cutoff);
    let columns = near_range(kernel, Vec3::X, kernel.factor.x, view, 0, r, h);
    let rows = near_range(kernel, Vec3::Y, kernel.factor.y, view, 1, r, h);
    if let (Some(columns), Some(rows)) = (columns, rows) {
        out.columns = columns;
        out.rows = rows;
        out.tau = weight / cutoff_share(r);
        out.cutoff_squared = r * r;
        let terms = NearTerms {
            reach: r * kernel.factor.z.length(),
            ..terms
        };
        out.path = push(near, terms, PATH_NEAR);
    }
}

/// The pixels along one axis that the cut-off ellipsoid may reach, in whole tiles: all between
/// the first and the last slab that neither bounding plane separates from it.
fn near_range(
    kernel: &Kernel,
    axis: Vec3,
    row: Vec3,
    view: &ViewUniform,
    i: usize,
    r: f32,
    h: f32,
) -> Option<u32> {
    let size = view.size[i];
    let tile = TILE_SIZE as u32;
    let slope_at = |px: f32| (px - view.centre_px[i]) / view.focal_px[i];
    // The low-pass filter of `near_terms`, as a width in the plane of the image.
    let reach_z = kernel.factor.z.length();
    let low_pass = h * kernel.centre.z.abs().max(reach_z) / view.focal_px[i];
    // Support of the ellipsoid beyond the plane x = X z, on either side of it.
    let side = |slope: f32| {
        let centre = kernel.centre.dot(axis) - slope * kernel.centre.z;
        let reach = r * (row - kernel.factor.z * slope).length().hypot(low_pass);
        (centre - reach, centre + reach)
    };
    let reaches = |t: u32| {
        let (_, highest) = side(slope_at((t * tile) as f32));
        let (lowest, _) = side(slope_at(((t + 1) * tile) as f32));
        highest >= 0.0 && lowest <= 0.0
    };
    let tiles = size.div_ceil(tile);
    let first = (0..tiles).find(|&t| reaches(t))?;
    let last = (first..tiles).rev().find(|&t| reaches(t))?;
    Some(pack_range(first * tile, ((last + 1) * tile).min(size)))
}
