//! Compares the GPU's projection with its twin, on the same input.
//!
//! Tolerances follow from the kernel: a rounding of the factor's rows, carried to the image,
//! relative to the footprint's smaller axis.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::gpu::{gpu, is_software};
use crate::common::{Random, lower_factor};
use ewa_splat::math::Factor;
use ewa_splat::scene::{
    Colour, ColourIn, Column, Lattice, LatticeSpacing, Particles, PointVolume, Shared, SplatRule,
    Strength, StrengthIn, Values,
};
use ewa_splat::stages::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid, NO_PARENT};
use ewa_splat::stages::constants::{MAX_CUTOFF, NEAR_MARGIN, SPLAT_FLOOR, TILE_SIZE};
use ewa_splat::stages::cpu::{self, ProjectOutput};
use ewa_splat::stages::gpu::{Projected, project};
use ewa_splat::stages::record::{
    BlockView, Carried, ClassifiedParticle, ExactTerms, Footprint, PATH_AFFINE, PATH_CAPPED,
    PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK, ViewUniform,
};
use ewa_splat::stages::splat::budget::AFFINE_SHARE;
use ewa_splat::stages::splat::{
    CHOICE_COLOURS, Filter, ImageKernel, Kernel, ScreenFactor, affine_error, choose_exact,
    cutoff_radius, edge_growth, evaluate_near, exact_extent, exact_terms, filtered_opacity,
    opacity_amplification, peak_footprint, peak_reach, project_kernel,
};
use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};

/// A rounding of f32, relative.
const EPS: f32 = f32::EPSILON / 2.0;

/// Input of the stage.
struct Input {
    volume: BlockedVolume,
    views: Vec<BlockView>,
    classified: Vec<ClassifiedParticle>,
    view: ViewUniform,
    rotation: Mat3,
}

impl Input {
    fn on_cpu(&self) -> Projected {
        let count = self.classified.len();
        let may_be_exact = self.view.orthographic == 0 && self.view.filter_kind < 2;
        let mut out = Projected {
            footprints: vec![bytemuck::Zeroable::zeroed(); count],
            exact: vec![ExactTerms::default(); if may_be_exact { count } else { 0 }],
            ..Projected::default()
        };
        let mut output = ProjectOutput::default();
        cpu::project(
            &cpu::ProjectInput {
                volume: &self.volume,
                views: &self.views,
                classified: &self.classified,
                pieces: &[],
                view: &self.view,
                rotation: self.rotation,
                is_cut: false,
                has_edges: false,
                level: cpu::SimdLevel::best(),
            },
            &mut out.footprints,
            &mut out.exact,
            &mut [],
            &output,
        );
        out.near = output.near().to_vec();
        out.near_count = out.near.len() as u32;
        out
    }

    /// Returns a classified particle's offset and kernel, as the CPU computes them.
    fn kernel(&self, i: usize) -> (Vec3, Kernel) {
        let particle = &self.classified[i];
        let view = &self.views[particle.view as usize];
        let index = (self.volume.blocks[view.block as usize].first + particle.local) as usize;
        let (offset, factor) = match &self.volume.particles {
            BlockedParticles::Lattice(grid) => {
                let cells = grid.cells(view.block);
                let cell = BrickGrid::cell(cells.map(|c| c[0]), particle.local);
                let factor = grid.shared_factor().map_or_else(
                    || grid.cell_factor(&(self.rotation * grid.basis()), cell),
                    |f| Factor::from_matrix(self.rotation * f),
                );
                (grid.offset(cells, cell), factor)
            }
            BlockedParticles::Isotropic { offsets, sigmas } => {
                (Vec3::from(offsets[index]), Factor::sphere(sigmas[index]))
            }
            BlockedParticles::Anisotropic { offsets, factors } => (
                Vec3::from(offsets[index]),
                Factor::rotated(&self.rotation, &factors[index]),
            ),
            BlockedParticles::Surfels {
                offsets, tangents, ..
            } => (
                Vec3::from(offsets[index]),
                Factor::of_tangents(&self.rotation, &tangents[index]),
            ),
        };
        let offset = self.rotation * offset;
        let kernel = Kernel {
            centre: Vec3::from(view.origin_camera) + offset,
            factor,
            mass: particle.mass,
        };
        (offset, kernel)
    }

    /// Returns the filter that draws a classified particle.
    fn filter(&self, i: usize) -> Filter {
        Filter::ALL[self.views[self.classified[i].view as usize].filter_kind as usize]
    }

    /// Returns the overlap count of a classified particle's block.
    fn crowding(&self, i: usize) -> f32 {
        let view = &self.views[self.classified[i].view as usize];
        self.volume.blocks[view.block as usize].crowding
    }

    /// Returns true if a classified particle has the opacity of a lone kernel.
    fn is_lone(&self, i: usize) -> bool {
        let view = &self.views[self.classified[i].view as usize];
        self.view.sub_pixel_opacity != 0 && view.level == 0 && self.splats().is_none()
    }

    fn splats(&self) -> Option<SplatRule> {
        match self.volume.strength {
            StrengthIn::PeakOpacity { rule, .. } => Some(rule),
            _ => None,
        }
    }
}

/// Results of a comparison: choices that differ, and the greatest errors relative to their bounds.
#[derive(Debug, Default)]
struct Seen {
    footprints: usize,
    visible: usize,
    bit_equal: usize,
    /// Counts by path: affine or peak, exact, near, half-line.
    paths: [usize; 4],
    path_flips: usize,
    range_flips: usize,
    form_flips: usize,
    near_range_flips: usize,
    key_off: usize,
    /// Number of kernels smaller than a pixel whose depth is less than nine tenths of the filtered
    /// one.
    lone: usize,
    /// Number too ill-conditioned for any bound, only checked to be in range.
    loose: usize,
    worst: std::collections::BTreeMap<&'static str, f32>,
}

impl Seen {
    fn within(&mut self, what: &'static str, error: f32, bound: f32, context: &dyn Fn() -> String) {
        if error == 0.0 {
            return;
        }
        let share = error / bound;
        assert!(
            share <= 1.0,
            "{what}: {error:e} of {bound:e}; {}",
            context()
        );
        let worst = self.worst.entry(what).or_default();
        *worst = worst.max(share);
    }

    fn report(&self, name: &str) {
        println!("{name}: {self:?}");
    }
}

/// Largest effects of the roundings of a kernel's projection.
struct Roundings {
    /// Error of the centre, px.
    centre_px: f32,
    /// Relative error of the footprint's smaller axis.
    axis: f32,
    /// The footprint's smaller variance, px².
    smallest: f32,
}

fn roundings(
    input: &Input,
    i: usize,
    offset: Vec3,
    kernel: &Kernel,
    screen: &ScreenFactor,
    image: &ImageKernel,
) -> Roundings {
    let view = &input.view;
    let origin = Vec3::from(input.views[input.classified[i].view as usize].origin_camera);
    let focal = view.focal_px[0].max(view.focal_px[1]);
    let f = &kernel.factor;
    let norm = (f.x.length_squared() + f.y.length_squared() + f.z.length_squared()).sqrt();
    // A matrix product: five roundings or, with fused sums, fewer.
    let position = 4.0 * EPS * (origin.length() + offset.length());
    let is_flat = view.orthographic != 0;
    let (per_depth, slope) = if is_flat {
        (1.0, 0.0)
    } else {
        (1.0 / kernel.centre.z, screen.slope.length())
    };
    let depth = if is_flat { 0.0 } else { position * per_depth };
    let row = focal * norm * per_depth * (1.0 + slope) * (8.0 * EPS + 2.0 * depth);
    // The filters that use the footprint's own smaller axis.
    let bare = screen.filtered(Filter::Reconstruction, 0.0);
    let is_bare = input.filter(i) == Filter::UniformScaling
        || input.splats() == Some(SplatRule::Mip)
        || input.is_lone(i);
    let of = if is_bare { &bare } else { image };
    let smallest = of.determinant / (of.a + of.c);
    Roundings {
        centre_px: focal * per_depth * position
            + focal * slope * (depth + 4.0 * EPS)
            + 4.0 * EPS * (screen.centre_px.length() + Vec2::from(view.centre_px).length()),
        axis: 4.0 * row / smallest.sqrt() + 16.0 * EPS + 4.0 * depth,
        smallest,
    }
}

/// Returns the relative error that roundings of a lone kernel's opacity cause in its depth: some
/// sixty of a sum, relative to the transmitted light, down to exp(-7), where the depth follows from
/// the extent.
fn lone_error(input: &Input, i: usize, screen: &ScreenFactor) -> f32 {
    if !input.is_lone(i) {
        return 0.0;
    }
    let width = screen.row_x.cross(screen.row_y).length();
    let area = width / input.view.low_pass_variance_px2;
    let through = 1.0 - filtered_opacity(area, screen.weight / (std::f32::consts::TAU * width));
    64.0 * EPS / through.max(1e-3)
}

/// Returns the cut-off radius as the stage computes it.
fn radius(
    view: &ViewUniform,
    filter: Filter,
    screen: &ScreenFactor,
    image: &ImageKernel,
    crowding: f32,
    rule: Option<SplatRule>,
) -> f32 {
    let tau = image.tau * image.enlargement * crowding;
    let r = cutoff_radius(tau, 1.0, view.tolerance, view.cutoff);
    if let Some(rule) = rule {
        return peak_reach(rule, image.tau, r).unwrap_or(-1.0);
    }
    choose_exact(view, filter, screen, image, crowding).map_or(r, |terms| {
        let growth = edge_growth(view, screen, image, &terms, 1.1 * r);
        r.max(cutoff_radius(tau, growth, view.tolerance, view.cutoff))
    })
}

/// Returns the path that evaluates a footprint, without the index of its terms.
fn path(f: &Footprint) -> u32 {
    match f.path & 3 {
        PATH_NEAR => PATH_NEAR,
        PATH_HALF_LINE => PATH_HALF_LINE,
        _ => f.path,
    }
}

fn words(f: &Footprint) -> [u32; 16] {
    bytemuck::cast(*f)
}

fn compare(input: &Input, name: &str, seen: &mut Seen) {
    let Some(gpu) = gpu() else { return };
    let expected = input.on_cpu();
    let found = project(
        gpu,
        &input.volume,
        &input.views,
        &input.classified,
        &[],
        &input.view,
        input.rotation,
        false,
        input.classified.len(),
    )
    .unwrap();
    assert_eq!(found.footprints.len(), expected.footprints.len());
    assert_eq!(found.near.len(), found.near_count as usize);
    for i in 0..expected.footprints.len() {
        compare_one(input, i, &expected, &found, name, seen);
    }
}

#[allow(clippy::too_many_lines, reason = "one footprint, word by word")]
fn compare_one(
    input: &Input,
    i: usize,
    expected: &Projected,
    found: &Projected,
    name: &str,
    seen: &mut Seen,
) {
    let view = &input.view;
    let (e, f) = (&expected.footprints[i], &found.footprints[i]);
    let (offset, kernel) = input.kernel(i);
    let context = || format!("{name} {i}: {kernel:?}\n{e:?}\n{f:?}");
    seen.footprints += 1;
    seen.visible += usize::from(e.is_visible());
    seen.paths[(e.path & 3) as usize] += usize::from(e.is_visible());
    let near_paths = [PATH_NEAR, PATH_HALF_LINE];
    let mut same = words(e);
    if near_paths.contains(&(e.path & 3)) && path(e) == path(f) {
        // The index of its terms may differ.
        same[12] = f.path;
    }
    let is_same = same == words(f);
    seen.bit_equal += usize::from(is_same);

    // In every case, the ranges lie in the image.
    let ((c0, c1), (r0, r1)) = (f.column_range(), f.row_range());
    if f.is_visible() {
        assert!(
            c0 < c1 && r0 < r1 && c1 <= view.size[0] && r1 <= view.size[1],
            "{}",
            context()
        );
        assert!(f.tau >= 0.0, "{}", context());
    }
    assert_eq!(e.carried, f.carried, "{}", context());

    let screen;
    let image;
    if let Some(rule) = input.splats() {
        match peak_footprint(view, &kernel, rule) {
            Some(peak) => (screen, image) = peak,
            None => {
                assert!(!f.is_visible(), "{}", context());
                return;
            }
        }
    } else {
        screen = project_kernel(view, &kernel);
        let h2 = view.low_pass_variance_px2;
        let filtered = screen.filtered(input.filter(i), h2);
        if input.is_lone(i) {
            image = screen.as_lone(input.filter(i), h2, filtered);
            seen.lone += usize::from(image.tau < 0.9 * filtered.tau);
        } else {
            image = filtered;
        }
    }
    let lone = lone_error(input, i, &screen);
    let round = roundings(input, i, offset, &kernel, &screen, &image);

    let origin = Vec3::from(input.views[input.classified[i].view as usize].origin_camera);
    let position = 8.0 * EPS * (origin.length() + offset.length());
    seen.within("depth", (e.depth - f.depth).abs(), position, &context);
    let keys = e.key.abs_diff(f.key);
    seen.key_off += usize::from(keys > 0);
    seen.within(
        "key",
        keys as f32,
        1.0 + position * view.key_scale,
        &context,
    );

    // z over the depth at which the kernel is integrated directly.
    let reach = kernel.factor.z.length();
    let r = radius(
        view,
        input.filter(i),
        &screen,
        &image,
        input.crowding(i),
        input.splats(),
    );
    if input.splats().is_some() && r < 0.05 {
        // Fainter than what a splat's rule draws, up to a rounding.
        let is_seen = e.is_visible() || f.is_visible();
        assert!(!is_seen || image.tau > 0.999 * SPLAT_FLOOR, "{}", context());
        return;
    }
    if path(e) != path(f) || e.is_visible() != f.is_visible() {
        let at_near = (kernel.centre.z / (NEAR_MARGIN * r * reach) - 1.0).abs();
        let behind = (kernel.centre.z / (MAX_CUTOFF * reach) + 1.0).abs();
        let terms = exact_terms(&screen, view.low_pass_variance_px2, image.determinant);
        let error = affine_error(view, &screen, &image, &terms)
            * opacity_amplification(image.tau * input.crowding(i)).max(1.0)
            / (view.tolerance * AFFINE_SHARE);
        let is_marginal = at_near < 4.0 * round.axis + 1e-5
            || behind < 1e-6
            || (error - 1.0).abs() < 16.0 * round.axis + 1e-5
            || !(round.axis < 0.02);
        if path(e) != path(f) && is_marginal {
            seen.path_flips += 1;
            return;
        }
        assert_eq!(path(e), path(f), "{}", context());
    }

    if e.path & 3 == PATH_NEAR {
        compare_near(input, i, expected, found, seen, &context);
        return;
    }
    if image.tau <= 0.0 || !image.tau.is_finite() || is_same {
        assert!(is_same || e.is_visible() == f.is_visible(), "{}", context());
    }
    if !(round.axis < 0.02) {
        seen.loose += 1;
        return;
    }

    // Bounds may be off by one if an edge lies within its roundings of a whole number.
    let r_error = (8.0 * round.axis + 1e-5 + 2.0 * lone) / (2.0 * r);
    let (middle, half) = if e.path & 3 == PATH_EXACT {
        let (middle, half) = exact_extent(&screen, view.low_pass_variance_px2, r).unwrap();
        (screen.centre_px + middle, half)
    } else {
        (
            screen.centre_px,
            Vec2::new(image.a.sqrt(), image.c.sqrt()) * r,
        )
    };
    let edge_error = 2.0 * round.centre_px
        + 4.0 * half.max_element() * (round.axis + r_error / r)
        + 4.0 * EPS * middle.length();
    let is_marginal = |edge: f32| (edge - edge.round()).abs() <= edge_error;
    let edges = [middle - half - 0.5, middle + half - 0.5];
    if (e.columns, e.rows) != (f.columns, f.rows) {
        seen.range_flips += 1;
        if e.is_visible() && f.is_visible() {
            let pairs = [
                (e.column_range().0, c0, edges[0].x),
                (e.column_range().1, c1, edges[1].x),
                (e.row_range().0, r0, edges[0].y),
                (e.row_range().1, r1, edges[1].y),
            ];
            for (expected, found, edge) in pairs {
                let is_close = expected == found
                    || (is_marginal(edge) || !is_software())
                        && expected.abs_diff(found) <= 1 + edge_error as u32;
                assert!(is_close, "edge {edge} ± {edge_error:e}: {}", context());
            }
        } else {
            let any = edges
                .iter()
                .any(|edge| is_marginal(edge.x) || is_marginal(edge.y));
            assert!(any, "{edges:?} ± {edge_error:e}: {}", context());
        }
    }
    if !e.is_visible() || !f.is_visible() {
        return;
    }

    let centre = Vec2::from(e.centre_px) - Vec2::from(f.centre_px);
    seen.within("centre", centre.length(), 2.0 * round.centre_px, &context);
    let [ep, er, fp, fr] = [e.form_p, e.form_r, f.form_p, f.form_r].map(Vec2::from);
    if (ep.x == 0.0) == (fp.x == 0.0) {
        seen.within(
            "form p",
            (ep - fp).length(),
            2.0 * round.axis * ep.length(),
            &context,
        );
        seen.within(
            "form r",
            (er - fr).length(),
            2.0 * round.axis * er.length(),
            &context,
        );
    } else {
        // It is round to within rounding, so the other axis was eliminated.
        seen.form_flips += 1;
        assert!(
            (image.a / image.c - 1.0).abs() < 4.0 * round.axis,
            "{}",
            context()
        );
    }
    seen.within(
        "tau",
        (e.tau - f.tau).abs(),
        2.0 * (round.axis + r_error + lone) * e.tau,
        &context,
    );
    let cutoff = (e.cutoff_squared - f.cutoff_squared).abs();
    seen.within("cutoff", cutoff, 2.0 * r * r_error, &context);

    if e.path & 3 == PATH_EXACT {
        let s = screen.relative_depth.length() / round.smallest.sqrt();
        let (a, b) = (&expected.exact[i], &found.exact[i]);
        for (a, b) in a.gradient.iter().zip(b.gradient) {
            seen.within("gradient", (a - b).abs(), 4.0 * round.axis * s, &context);
        }
        for (a, b) in a.hessian.iter().zip(b.hessian) {
            seen.within("hessian", (a - b).abs(), 4.0 * round.axis * s * s, &context);
        }
    }
    if e.path & 3 == PATH_HALF_LINE {
        let a = &expected.near[(e.path >> 2) as usize];
        let b = &found.near[(f.path >> 2) as usize];
        let slope = reach / round.smallest.sqrt();
        for k in 0..2 {
            let error = (a.half_line[k] - b.half_line[k]).abs();
            seen.within("half line", error, 4.0 * round.axis * slope, &context);
        }
        assert_eq!(b.half_line[2].to_bits(), f.depth.to_bits(), "{}", context());
        let variance = (a.sigma * a.sigma - b.sigma * b.sigma).abs();
        seen.within(
            "sigma",
            variance,
            8.0 * round.axis * reach * reach,
            &context,
        );
    }
}

/// Compares kernels that cross the camera plane: their ranges are whole tiles, and their terms are
/// compared by the values that they give.
fn compare_near(
    input: &Input,
    i: usize,
    expected: &Projected,
    found: &Projected,
    seen: &mut Seen,
    context: &dyn Fn() -> String,
) {
    let view = &input.view;
    let (e, f) = (&expected.footprints[i], &found.footprints[i]);
    if (e.columns, e.rows) != (f.columns, f.rows) {
        seen.near_range_flips += 1;
        let tile = TILE_SIZE as u32;
        let ends = |f: &Footprint| [f.column_range(), f.row_range()];
        for (a, b) in ends(e).into_iter().zip(ends(f)) {
            let is_close = a.0.abs_diff(b.0) <= tile && a.1.abs_diff(b.1) <= tile;
            assert!(
                !e.is_visible() || !f.is_visible() || is_close,
                "{}",
                context()
            );
        }
    }
    if !e.is_visible() || !f.is_visible() {
        return;
    }
    let a = &expected.near[(e.path >> 2) as usize];
    let b = &found.near[(f.path >> 2) as usize];
    // sigma is a root of a determinant: its error grows with the axis ratio.
    let r_error = (e.cutoff_squared - f.cutoff_squared).abs();
    seen.within("near cutoff", r_error, 1e-3, context);
    seen.within("near tau", (e.tau - f.tau).abs(), 1e-3 * e.tau, context);
    let ((c0, c1), (r0, r1)) = (e.column_range(), e.row_range());
    let mut values = Vec::new();
    for (x, y) in [(0.1, 0.2), (0.5, 0.5), (0.9, 0.3), (0.3, 0.8), (0.6, 0.45)] {
        let pixel = Vec2::new(
            c0 as f32 + x * (c1 - c0) as f32,
            r0 as f32 + y * (r1 - r0) as f32,
        );
        let slope = (pixel - Vec2::from(view.centre_px)) / Vec2::from(view.focal_px);
        let ray = slope.extend(1.0);
        values.push([(a, e.tau), (b, f.tau)].map(|(t, w)| evaluate_near(t, w, ray, 1e3)));
    }
    let most = values.iter().map(|v| v[0]).fold(0.0, f32::max);
    for [a, b] in values {
        // Fused operations of a graphics card round minors of needles otherwise.
        let of_most = if is_software() { 1e-4 } else { 3e-4 };
        seen.within(
            "near value",
            (a - b).abs(),
            of_most * most + f32::MIN_POSITIVE,
            context,
        );
    }
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    Spheres,
    Ellipsoids,
    Splats(SplatRule),
}

/// Parameters of a scene.
#[derive(Debug, Clone, Copy)]
struct Scene {
    kind: Kind,
    filter: Filter,
    is_orthographic: bool,
    /// World units per unit of the scene.
    scale: f64,
    /// Share of the blocks near the camera plane.
    near: f64,
    /// Largest axis ratio of kernels.
    ratio: f64,
    h2: f32,
    cutoff: f32,
}

impl Scene {
    fn new(kind: Kind, filter: Filter, is_orthographic: bool) -> Self {
        Self {
            kind,
            filter,
            is_orthographic,
            scale: 1.0,
            near: 0.3,
            ratio: 30.0,
            h2: 1.0,
            cutoff: 0.0,
        }
    }

    fn view(&self) -> ViewUniform {
        let focal = if self.is_orthographic {
            (40.0 / self.scale) as f32
        } else {
            500.0
        };
        ViewUniform {
            focal_px: [focal, 1.1 * focal],
            centre_px: [321.5, 240.0],
            size: [640, 480],
            orthographic: u32::from(self.is_orthographic),
            // Distances of perspective views, depths of others.
            key_kind: u32::from(self.is_orthographic),
            filter_kind: self.filter as u32,
            low_pass_variance_px2: self.h2,
            tolerance: 1.0 / 255.0,
            cutoff: self.cutoff,
            key_scale: (1e7 / self.scale) as f32,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Returns a block's origin in camera space, units of the scene.
    fn origin(&self, random: &mut Random) -> DVec3 {
        let is_near = random.range(0.0, 1.0) < self.near;
        if self.is_orthographic {
            let z = if is_near {
                random.range(-1.0, 1.0)
            } else {
                random.log_range(1.0, 100.0)
            };
            return DVec3::new(random.range(-9.0, 9.0), random.range(-7.0, 7.0), z);
        }
        if is_near {
            return random.point(1.5);
        }
        let z = random.log_range(0.5, 100.0);
        let slope = [random.range(-0.8, 0.8), random.range(-0.6, 0.6)];
        DVec3::new(z * slope[0], z * slope[1], z)
    }

    fn input(&self, random: &mut Random, block_sizes: &[usize]) -> Input {
        let view = self.view();
        let rotation = random.rotation().as_mat3();
        let (mut offsets, mut factors, mut sigmas) = (Vec::new(), Vec::new(), Vec::new());
        let (mut blocks, mut views, mut classified) = (Vec::new(), Vec::new(), Vec::new());
        for &size in block_sizes {
            let origin = self.origin(random);
            let distance = origin.length();
            let first = offsets.len() as u32;
            for local in 0..size {
                offsets.push(
                    (random.point(0.2 * distance) * self.scale)
                        .as_vec3()
                        .to_array(),
                );
                let sigma = distance * random.log_range(3e-4, 0.3);
                sigmas.push((sigma * self.scale) as f32);
                let ratio = random.log_range(1.0, self.ratio);
                factors.push(lower_factor(&random.factor(sigma * self.scale, ratio)));
                // Optical depths of some 1e-3 to 1e3.
                let mass = sigma * sigma * self.scale * self.scale * random.log_range(1e-3, 1e3);
                let is_opacity = matches!(self.kind, Kind::Splats(_));
                if random.index(8) > 0 {
                    classified.push(ClassifiedParticle {
                        view: views.len() as u32,
                        local: local as u32,
                        mass: if is_opacity {
                            random.range(1e-3, 1.0) as f32
                        } else {
                            mass as f32
                        },
                        carried: Carried::of_colour([0.25, 0.5, random.range(0.0, 1.0) as f32]),
                    });
                }
            }
            views.push(BlockView {
                origin_camera: (origin * self.scale).as_vec3().into(),
                block: blocks.len() as u32,
                first: 0,
                count: 0,
                key: (random.bits() >> 33) as u32,
                filter_kind: self.filter as u32,
                level: 0,
                classified_by: 0,
            });
            blocks.push(block(first, size));
        }
        let particles = match self.kind {
            Kind::Spheres => BlockedParticles::Isotropic {
                offsets: offsets.into(),
                sigmas: sigmas.into(),
            },
            _ => BlockedParticles::Anisotropic {
                offsets: offsets.into(),
                factors: factors.into(),
            },
        };
        let strength = match self.kind {
            Kind::Splats(rule) => StrengthIn::PeakOpacity {
                opacities: Column::default(),
                rule,
                by_distance: false,
            },
            _ => StrengthIn::Mass(Column::default()),
        };
        Input {
            volume: volume(blocks, particles, strength),
            views,
            classified,
            view,
            rotation,
        }
    }
}

fn block(first: u32, size: usize) -> Block {
    Block {
        origin: DVec3::ZERO,
        half_extent: Vec3::ONE,
        max_sigma: 1.0,
        min_sigma: 1.0,
        max_strength: 1.0,
        first,
        count: size as u32,
        value_range: [0.0; 2],
        values_around: [f32::INFINITY, f32::NEG_INFINITY],
        greatest_spread: 0.0,
        parent: NO_PARENT,
        level: 0,
        // Every third block has an overlap count of one, as evenly placed kernels have.
        crowding: 1.0 + (first / 7 % 3) as f32 * 20.0,
    }
}

fn volume(
    blocks: Vec<Block>,
    particles: BlockedParticles,
    strength: StrengthIn<Shared>,
) -> BlockedVolume {
    BlockedVolume {
        blocks,
        particles,
        strength,
        colour: ColourIn::PerParticle(Column::default()),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        indices: None,
        local_models: None,
        lobes: None,
        merged: None,
    }
}

const SIZES: [usize; 12] = [1, 255, 256, 2, 256, 100, 256, 7, 256, 256, 31, 256];

#[test]
fn kernels_of_all_filters_and_cameras() {
    let mut random = Random::new(11);
    for kind in [Kind::Spheres, Kind::Ellipsoids] {
        for filter in Filter::ALL {
            for is_orthographic in [false, true] {
                let mut seen = Seen::default();
                let scene = Scene::new(kind, filter, is_orthographic);
                compare(&scene.input(&mut random, &SIZES), "random", &mut seen);
                seen.report(&format!(
                    "{kind:?} {filter:?} orthographic {is_orthographic}"
                ));
            }
        }
    }
}

#[test]
fn splats_of_all_rules() {
    let mut random = Random::new(12);
    let rules = [
        SplatRule::Exact,
        SplatRule::Khr,
        SplatRule::Inria,
        SplatRule::Mip,
    ];
    for kind in rules.map(Kind::Splats) {
        for is_orthographic in [false, true] {
            let mut seen = Seen::default();
            let scene = Scene::new(kind, Filter::Adaptive, is_orthographic);
            compare(&scene.input(&mut random, &SIZES), "splats", &mut seen);
            seen.report(&format!("{kind:?} orthographic {is_orthographic}"));
            assert!(seen.visible > 300);
        }
    }
}

#[test]
fn settings_at_their_ends() {
    let mut random = Random::new(13);
    for (filter, h2, cutoff) in [
        (Filter::Adaptive, 0.0, 0.0),
        (Filter::Adaptive, 1.0, 2.5),
        (Filter::Adaptive, 1e-6, 0.0),
        (Filter::Exact, 0.0, 0.0),
        (Filter::Exact, 4.0, 100.0),
        (Filter::Ewa, 0.0, 0.0),
        (Filter::Ewa, 1.0, 0.01),
        (Filter::UniformScaling, 0.0, 0.0),
        (Filter::UniformScaling, 1e-6, 2.5),
    ] {
        let mut seen = Seen::default();
        let scene = Scene {
            h2,
            cutoff,
            ..Scene::new(Kind::Ellipsoids, filter, false)
        };
        compare(&scene.input(&mut random, &SIZES), "settings", &mut seen);
        seen.report(&format!("{filter:?} h2 {h2} cut-off {cutoff}"));
    }
}

#[test]
fn needles_and_scales() {
    let mut random = Random::new(14);
    for is_orthographic in [false, true] {
        let scene = Scene::new(Kind::Ellipsoids, Filter::Adaptive, is_orthographic);
        let needles = Scene {
            ratio: 1e4,
            near: 0.0,
            ..scene
        };
        let scales = [1e-12, 1e-6, 1e6, 1e12].map(|scale| Scene { scale, ..scene });
        for scene in [needles].into_iter().chain(scales) {
            let mut seen = Seen::default();
            compare(&scene.input(&mut random, &SIZES), "needles", &mut seen);
            seen.report(&format!("{scene:?}"));
            assert!(seen.visible > 200 && seen.loose * 20 < seen.footprints);
        }
    }
}

/// Returns a lattice's own cells and those of its levels of detail, if it has any.
fn grids(lattice: Lattice) -> Vec<BlockedVolume> {
    let count = lattice.len();
    BlockedVolume::with_detail(PointVolume {
        colour: Colour::Classified,
        values: Some(Values::U8(vec![0; count])),
        ..PointVolume::new(
            Particles::Lattice {
                lattice,
                kernel_width: 0.7,
            },
            Strength::Classified {
                volumes: Vec::new(),
            },
        )
    })
}

/// Returns every cell of a lattice, with the centre of its first brick in front of the camera.
fn lattice_input(random: &mut Random, grid: BlockedVolume, filter: Filter) -> Input {
    let rotation = random.rotation();
    let eye = grid.blocks[0].origin - rotation.transpose() * DVec3::new(-2.0, 1.0, 30.0);
    let (mut views, mut classified) = (Vec::new(), Vec::new());
    let BlockedParticles::Lattice(bricks) = &grid.particles else {
        panic!("a lattice");
    };
    for (b, block) in grid.blocks.iter().enumerate() {
        let [x, y, z] = bricks.cells(b as u32);
        for k in z[0]..z[1] {
            for j in y[0]..y[1] {
                for i in x[0]..x[1] {
                    classified.push(ClassifiedParticle {
                        view: views.len() as u32,
                        local: BrickGrid::local([x[0], y[0], z[0]], [i, j, k]),
                        mass: random.log_range(1e-3, 10.0) as f32,
                        carried: Carried::of_colour([1.0; 3]),
                    });
                }
            }
        }
        views.push(BlockView {
            origin_camera: (rotation * (block.origin - eye)).as_vec3().into(),
            block: b as u32,
            first: 0,
            count: 0,
            key: 1 << 30,
            filter_kind: filter as u32,
            level: block.level,
            classified_by: 0,
        });
    }
    let view = Scene::new(Kind::Spheres, filter, false).view();
    Input {
        volume: grid,
        views,
        classified,
        view,
        rotation: rotation.as_mat3(),
    }
}

#[test]
fn lattices() {
    let mut random = Random::new(15);
    let sheared = Lattice {
        dims: [19, 9, 6],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::new(1e7, -3.0, 20.0),
            step: DMat3::from_cols_array(&[0.7, 0.1, 0.0, -0.2, 0.5, 0.3, 0.1, -0.1, 1.3]),
        },
    };
    let axis = |random: &mut Random, n: usize| {
        let mut at = random.range(-10.0, 10.0);
        let mut step = || {
            at += random.log_range(0.05, 2.0);
            at
        };
        (0..n).map(|_| step()).collect::<Vec<f64>>()
    };
    let dims = [17, 16, 1];
    let rectilinear = Lattice {
        dims,
        spacing: LatticeSpacing::Rectilinear {
            coordinates: dims.map(|n| axis(&mut random, n)),
        },
    };
    for lattice in [sheared, rectilinear] {
        let grids = grids(lattice);
        assert!(grids.len() > 2, "cubes of cells");
        for grid in grids {
            for filter in [Filter::Adaptive, Filter::Ewa, Filter::Exact] {
                let mut seen = Seen::default();
                let count = grid.particle_count();
                let input = lattice_input(&mut random, grid.clone(), filter);
                compare(&input, "lattice", &mut seen);
                seen.report(&format!("lattice of {count} {filter:?}"));
                assert!(seen.visible > count.min(200) / 2);
            }
        }
    }
}

/// In an adaptive frame, the block determines which filter draws its particles, and the debug
/// output shows it.
#[test]
fn blocks_of_every_filter_and_level() {
    let mut random = Random::new(19);
    for kind in [Kind::Ellipsoids, Kind::Splats(SplatRule::Exact)] {
        for is_orthographic in [false, true] {
            for show_choice in [0, 1] {
                let scene = Scene::new(kind, Filter::Adaptive, is_orthographic);
                let mut input = scene.input(&mut random, &[256; 56]);
                input.view.show_choice = show_choice;
                for (i, view) in input.views.iter_mut().enumerate() {
                    view.filter_kind = (i % 7) as u32;
                    view.level = (i / 7 % 2 * (1 + i % 5)) as u32;
                }
                let mut seen = Seen::default();
                compare(&input, "blocks", &mut seen);
                seen.report(&format!(
                    "blocks of {kind:?} orthographic {is_orthographic}"
                ));
                assert!(seen.visible > 1_000);
                let expected = input.on_cpu();
                let shown = CHOICE_COLOURS.map(|colour| {
                    let is_shown = |f: &&Footprint| f.is_visible() && f.carried.colour() == colour;
                    expected.footprints.iter().filter(is_shown).count()
                });
                if show_choice == 1 && matches!(kind, Kind::Ellipsoids) {
                    println!("{shown:?}");
                    let is_whole = |&n: &usize| n > 0;
                    // Without perspective, no kernel is exact.
                    assert!(shown[usize::from(is_orthographic)..].iter().all(is_whole));
                }
            }
        }
    }
}

#[test]
fn lone_kernels_of_every_filter_and_level() {
    let mut random = Random::new(23);
    for kind in [
        Kind::Spheres,
        Kind::Ellipsoids,
        Kind::Splats(SplatRule::Exact),
    ] {
        for is_orthographic in [false, true] {
            let scene = Scene::new(kind, Filter::Adaptive, is_orthographic);
            let mut input = scene.input(&mut random, &[256; 28]);
            input.view.sub_pixel_opacity = 1;
            for (i, view) in input.views.iter_mut().enumerate() {
                view.filter_kind = (i % 7) as u32;
                view.level = u32::from(i % 4 == 3);
            }
            let mut seen = Seen::default();
            compare(&input, "lone kernels", &mut seen);
            seen.report(&format!("lone {kind:?} orthographic {is_orthographic}"));
            assert!(matches!(kind, Kind::Splats(_)) || seen.lone > 100);
        }
    }
}

#[test]
fn counts_around_a_workgroup() {
    let mut random = Random::new(16);
    for count in [0, 1, 255, 256, 257] {
        let scene = Scene::new(Kind::Spheres, Filter::Adaptive, false);
        let mut input = scene.input(&mut random, &[256, 256]);
        input.classified.truncate(count);
        compare(&input, "count", &mut Seen::default());
    }
}

#[test]
fn edges_on_pixel_borders_and_depths_on_thresholds_fall_alike() {
    let Some(gpu) = gpu() else { return };
    // Every number is a short binary fraction: sigma 1.5, cut-off 2, no low-pass filter, a pixel
    // per unit.
    let sigma = 1.5_f32;
    let mut positions = Vec::new();
    for x in -32..=32 {
        for y in [-20.0, 0.0, 7.25, 7.5, 20.0] {
            positions.push(Vec3::new(x as f32 * 0.25, y, 50.0));
        }
    }
    let threshold = NEAR_MARGIN * 2.0 * sigma;
    let behind = -MAX_CUTOFF * sigma;
    for z in [threshold, behind, 0.0, -0.0, 2.0 * sigma] {
        for z in [z, z.next_up(), z.next_down()] {
            positions.push(Vec3::new(0.5, 0.5, z));
        }
    }
    let count = positions.len();
    let filters = [
        Filter::Adaptive,
        Filter::Exact,
        Filter::Ewa,
        Filter::UniformScaling,
    ];
    for (orthographic, focal) in [(1, 1.0), (0, 32.0)] {
        for filter in filters {
            let input = Input {
                volume: volume(
                    (0..count).map(|i| block(i as u32, 1)).collect(),
                    BlockedParticles::Isotropic {
                        offsets: vec![[0.0; 3]; count].into(),
                        sigmas: vec![sigma; count].into(),
                    },
                    StrengthIn::Mass(Column::default()),
                ),
                views: (0..count)
                    .map(|i| BlockView {
                        origin_camera: positions[i].into(),
                        block: i as u32,
                        first: 0,
                        count: 0,
                        key: 7,
                        filter_kind: filter as u32,
                        level: 0,
                        classified_by: 0,
                    })
                    .collect(),
                classified: (0..count)
                    .map(|i| ClassifiedParticle {
                        view: i as u32,
                        local: 0,
                        mass: 1.0,
                        carried: Carried::of_colour([1.0; 3]),
                    })
                    .collect(),
                view: ViewUniform {
                    focal_px: [focal; 2],
                    centre_px: [16.0; 2],
                    size: [32, 32],
                    orthographic,
                    filter_kind: filter as u32,
                    low_pass_variance_px2: 0.0,
                    tolerance: 1.0 / 256.0,
                    cutoff: 2.0,
                    key_scale: 1.0,
                    ..bytemuck::Zeroable::zeroed()
                },
                rotation: Mat3::IDENTITY,
            };
            let expected = input.on_cpu();
            let found = project(
                gpu,
                &input.volume,
                &input.views,
                &input.classified,
                &[],
                &input.view,
                input.rotation,
                false,
                count,
            )
            .unwrap();
            for (i, (e, f)) in expected
                .footprints
                .iter()
                .zip(&found.footprints)
                .enumerate()
            {
                // With perspective, 1/50 is no short fraction, so only thresholds are checked.
                // A graphics card takes denormals for zeros.
                let is_denormal = positions[i].abs().min_element() < f32::MIN_POSITIVE
                    && positions[i].z != 0.0
                    && !is_software();
                if !is_denormal && (orthographic == 1 || i >= 65 * 5) {
                    assert_eq!(
                        (e.columns, e.rows, path(e)),
                        (f.columns, f.rows, path(f)),
                        "{filter:?} orthographic {orthographic} {}:\n{e:?}\n{f:?}",
                        positions[i]
                    );
                }
            }
        }
    }
}

#[test]
fn near_kernels_beyond_the_room_are_counted_and_draw_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(17);
    for is_orthographic in [false, true] {
        let scene = Scene {
            near: 1.0,
            ..Scene::new(Kind::Ellipsoids, Filter::Adaptive, is_orthographic)
        };
        let input = scene.input(&mut random, &SIZES);
        let expected = input.on_cpu();
        let found = project(
            gpu,
            &input.volume,
            &input.views,
            &input.classified,
            &[],
            &input.view,
            input.rotation,
            false,
            10,
        )
        .unwrap();
        assert!(expected.near_count > 20);
        assert_eq!(
            (found.near_count, found.near.len()),
            (expected.near_count, 10)
        );
        let is_near = |f: &&Footprint| f.is_visible() && f.path & 2 != 0;
        let mut places: Vec<u32> = (found.footprints.iter().filter(is_near))
            .map(|f| f.path >> 2)
            .collect();
        places.sort_unstable();
        assert_eq!(places, (0..10).collect::<Vec<_>>());
    }
}

#[test]
fn poison_stays_where_it_is() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(18);
    const POISON: [f32; 16] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        1e-45,
        -1e-40,
        0.0,
        -0.0,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e30,
        -1e30,
        1e-30,
        1e20,
        -1e20,
        1e-20,
    ];
    use Filter::{Adaptive, Ewa, Exact, UniformScaling};
    // Splats do not depend on the filter.
    let cases: [(Kind, &[Filter]); 4] = [
        (Kind::Spheres, &[Adaptive]),
        (Kind::Ellipsoids, &[Adaptive, Exact, Ewa, UniformScaling]),
        (Kind::Splats(SplatRule::Exact), &[Ewa]),
        (Kind::Splats(SplatRule::Mip), &[Ewa]),
    ];
    for (kind, filters) in cases {
        for &filter in filters {
            for is_orthographic in [false, true] {
                let scene = Scene::new(kind, filter, is_orthographic);
                let mut input = scene.input(&mut random, &SIZES[..8]);
                let mut pick = || (POISON[random.index(POISON.len())], random.index(9));
                let mut poisoned = vec![false; 2000];
                match &mut input.volume.particles {
                    BlockedParticles::Isotropic { offsets, sigmas } => {
                        let (offsets, sigmas) = (offsets.to_mut(), sigmas.to_mut());
                        for i in (0..offsets.len()).step_by(3) {
                            let (poison, place) = pick();
                            *offsets[i].get_mut(place).unwrap_or(&mut sigmas[i]) = poison;
                            poisoned[i] = true;
                        }
                    }
                    BlockedParticles::Anisotropic { offsets, factors }
                    | BlockedParticles::Surfels {
                        offsets,
                        tangents: factors,
                        ..
                    } => {
                        let (offsets, factors) = (offsets.to_mut(), factors.to_mut());
                        for i in (0..offsets.len()).step_by(3) {
                            let (poison, place) = pick();
                            if place < 3 {
                                offsets[i][place] = poison;
                            } else {
                                factors[i][place - 3] = poison;
                            }
                            poisoned[i] = true;
                        }
                    }
                    BlockedParticles::Lattice(_) => unreachable!(),
                }
                for (i, particle) in input.classified.iter_mut().enumerate() {
                    let block = &input.volume.blocks[particle.view as usize];
                    let index = (block.first + particle.local) as usize;
                    let (poison, _) = pick();
                    // Masses that are not above zero are never classified.
                    if i % 7 == 0 && poison > 0.0 {
                        particle.mass = poison;
                        poisoned[index] = true;
                    }
                }
                let expected = input.on_cpu();
                let found = project(
                    gpu,
                    &input.volume,
                    &input.views,
                    &input.classified,
                    &[],
                    &input.view,
                    input.rotation,
                    false,
                    2000,
                )
                .unwrap();
                let mut seen = Seen::default();
                let (mut count, mut other) = (0, 0);
                for i in 0..input.classified.len() {
                    let particle = &input.classified[i];
                    let block = &input.volume.blocks[particle.view as usize];
                    if !poisoned[(block.first + particle.local) as usize] {
                        compare_one(&input, i, &expected, &found, "beside poison", &mut seen);
                        continue;
                    }
                    count += 1;
                    let (e, f) = (&expected.footprints[i], &found.footprints[i]);
                    let context = format!("{:?}\n{e:?}\n{f:?}", input.kernel(i).1);
                    if f.is_visible() {
                        let (c, r) = (f.column_range(), f.row_range());
                        let [width, height] = input.view.size;
                        assert!(c.0 < c.1 && c.1 <= width && r.0 < r.1 && r.1 <= height);
                        assert!(!f.tau.is_nan() && f.cutoff_squared <= 49.1, "{context}");
                        let path = path(f);
                        assert!(
                            [PATH_AFFINE, PATH_PEAK, PATH_CAPPED, PATH_EXACT].contains(&path)
                                || (f.path >> 2) < found.near_count,
                            "{context}"
                        );
                        let numbers = [f.centre_px, f.form_p, f.form_r];
                        assert!(
                            !numbers.as_flattened().iter().any(|x| x.is_nan()),
                            "{context}"
                        );
                    }
                    if e.is_visible() != f.is_visible() {
                        other += 1;
                        println!("visible otherwise: {context}");
                    }
                }
                // For numbers beyond f32's range, a device may round to zero or infinity earlier.
                println!("{kind:?} {filter:?} {is_orthographic}: {other} of {count} otherwise");
                assert!(other * if is_software() { 100 } else { 20 } <= count);
            }
        }
    }
}
