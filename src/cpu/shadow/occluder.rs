//! Makes the footprints of particles in the plane across a light.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::blocks::{BlockedVolume, Rule};
use crate::cpu::classify::{classify, count_classified};
use crate::cpu::extent::Pieces;
use crate::cpu::project::Shapes;
use crate::math::{Factor, normal_cdf};
use crate::record::{BlockView, ClassifiedParticle, PieceTerms};
use crate::view::{Camera, ClipPlane};

/// Distance from its centre at which a kernel ends, standard deviations: .6 % of it lies beyond, and the rest
/// is increased by that much.
pub(super) const REACH: f32 = 3.2;

/// Least standard deviation of a footprint, cells: the samples of a Gaussian of .6 cells have the sum of its
/// integral within exp(-2 pi² .36) = .08 %.
const LEAST_VARIANCE: f32 = 0.36;

/// Variance that linear interpolation between cells adds along each axis, on average over places: that of a triangle
/// two cells wide. Kernels are narrowed by it where they are wide enough.
const INTERPOLATED: f32 = 1.0 / 6.0;

/// Coordinates of cells, relative to the light's eye.
pub(super) struct Axes {
    pub(super) corner: Vec3,
    /// Cells per world unit.
    pub(super) per_unit: f32,
}

/// A particle in the plane across a light.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Occluder {
    /// Cells.
    pub(super) centre: Vec3,
    /// Q = a x² + 2 b x y + c y² at the distance (x, y), in squared standard deviations.
    pub(super) form: [f32; 3],
    /// Half the size of the box around its reach, cells.
    pub(super) half: Vec2,
    /// Optical depth at the centre; for splats the opacity; for opaque surfels the weight.
    pub(super) peak: f32,
    /// True if the peak is an opacity.
    pub(super) is_opacity: bool,
    /// Change of the mean depth along x and y.
    pub(super) slope: Vec2,
    /// Standard deviation in depth at one place, cells.
    pub(super) sigma: f32,
}

/// The visible particles of a run of blocks.
pub(super) struct Run<'a> {
    volume: &'a BlockedVolume,
    rule: Rule,
    views: Vec<BlockView>,
    classified: Vec<ClassifiedParticle>,
    /// One for each particle, or none.
    pieces: Vec<PieceTerms>,
    camera: &'a Camera,
    clip: &'a [ClipPlane],
}

impl<'a> Run<'a> {
    /// Classifies the particles of some blocks.
    pub(super) fn new(
        volume: &'a BlockedVolume,
        rule: Rule,
        views: &[BlockView],
        camera: &'a Camera,
        clip: &'a [ClipPlane],
    ) -> Self {
        let mut views = views.to_vec();
        let mut classified = Vec::new();
        let mut terms = Vec::new();
        let has_pieces = volume.lobes.is_some() && views.iter().any(BlockView::is_spread);
        if has_pieces {
            let mut pieces = Pieces::default();
            let count = pieces.find(volume, &mut views);
            classified.resize(count, bytemuck::Zeroable::zeroed());
            terms.resize(count, PieceTerms::WHOLE);
            pieces.place(&mut classified, &mut terms);
        } else {
            let count = count_classified(volume, &mut views);
            classified.resize(count, bytemuck::Zeroable::zeroed());
            classify(volume, &views, &mut classified);
        }
        Self {
            volume,
            rule,
            views,
            classified,
            pieces: terms,
            camera,
            clip,
        }
    }

    /// Returns the particles that absorb light, in their order.
    pub(super) fn kernels(&self, axes: &Axes) -> Vec<Occluder> {
        let shapes = Shapes::new(self.volume, self.camera.camera_from_world.as_mat3());
        let planes: Vec<(Vec3, f32)> = self
            .clip
            .iter()
            .filter_map(ClipPlane::normalised)
            .map(|plane| {
                let normal = self.camera.camera_from_world * plane.normal;
                (normal.as_vec3(), plane.inside(self.camera.eye) as f32)
            })
            .collect();
        let has_edges = self.volume.has_boundary();
        let of_view = |v: usize| {
            let view = &self.views[v];
            let of_block = shapes.of_block(view.block);
            let origin = Vec3::from(view.origin_camera);
            let range = view.first as usize..(view.first + view.count) as usize;
            let one = |i: usize| {
                let particle = &self.classified[i];
                let (mut offset, mut factor) = of_block.get(particle.local);
                let mut moved = Vec3::ZERO;
                if let Some(piece) = self.pieces.get(i)
                    && (piece.width != 1.0 || piece.shift != 0.0)
                {
                    (moved, factor) = piece.applied(of_block.axis(piece), factor);
                    offset += moved;
                }
                let centre = origin + offset;
                let mut share = 1.0;
                if has_edges {
                    for [x, y, z, distance] in of_block.edges(particle.local) {
                        if distance < f32::INFINITY {
                            let normal = shapes.turned(Vec3::new(x, y, z));
                            share *= kept(&factor, normal, distance + normal.dot(moved));
                        }
                    }
                }
                for (normal, distance) in &planes {
                    share *= kept(&factor, *normal, distance + normal.dot(centre));
                }
                occluder(axes, self.rule, centre, &factor, particle.mass * share)
            };
            range.filter_map(one).collect::<Vec<_>>()
        };
        let views: Range<usize> = 0..self.views.len();
        let lists: Vec<Vec<Occluder>> = views.into_par_iter().map(of_view).collect();
        lists.concat()
    }
}

/// Returns the share of a kernel inside a plane.
///
/// - `inside`: distance of its centre inside.
fn kept(factor: &Factor, normal: Vec3, inside: f32) -> f32 {
    let reach = factor.x * normal.x + factor.y * normal.y + factor.z * normal.z;
    let sigma = reach.length();
    if inside >= REACH * sigma {
        return 1.0;
    }
    // Flat kernels lie on one side.
    if !(sigma > 0.0) {
        return if inside >= 0.0 { 1.0 } else { 0.0 };
    }
    normal_cdf(inside / sigma)
}

/// Returns a particle's footprint, or `None` if it absorbs nothing.
fn occluder(axes: &Axes, rule: Rule, centre: Vec3, factor: &Factor, mass: f32) -> Option<Occluder> {
    let [x, y, z] = [factor.x, factor.y, factor.z].map(|row| row * axes.per_unit);
    let (xx, xy, yy) = (x.length_squared(), x.dot(y), y.length_squared());
    let own = x.cross(y).length_squared();
    // Lesser eigenvalue, without a difference of great numbers.
    let half = 0.5 * (xx + yy);
    let greater = half + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
    let lesser = if greater > 0.0 { own / greater } else { 0.0 };
    let lacking = LEAST_VARIANCE - lesser;
    // Maps are not interpolated.
    let narrowed = match rule {
        Rule::Surface { .. } => 0.0,
        _ => -INTERPOLATED,
    };
    let filtered = |filter: f32| {
        let determinant = own + filter * (xx + yy) + filter * filter;
        let inverse = 1.0 / determinant;
        let form = [
            (yy + filter) * inverse,
            -xy * inverse,
            (xx + filter) * inverse,
        ];
        (form, determinant)
    };
    let filter = lacking.max(narrowed);
    let (a, c) = (xx + filter, yy + filter);
    let (form, determinant) = filtered(filter);
    let (xz, yz) = (x.dot(z), y.dot(z));
    // Mean depths are those of the kernel itself.
    let ([p, q, r], _) = filtered(lacking.max(0.0));
    let slope = Vec2::new(p * xz + q * yz, q * xz + r * yz);
    let variance = z.length_squared() - (slope.x * xz + slope.y * yz);
    let root = determinant.sqrt();
    let within = 1.0 - (-0.5 * REACH * REACH).exp();
    let area = axes.per_unit * axes.per_unit;
    let columns = factor.columns();
    let plane = columns[0].cross(columns[1]).length();
    let (peak, is_opacity) = match rule {
        Rule::Kernel => (mass * area / (std::f32::consts::TAU * root * within), false),
        Rule::Translucent { .. } => {
            // The cosine between the light and the normal of the sheet.
            let facing = own.sqrt() / (plane * area);
            (
                mass * facing * area / (std::f32::consts::TAU * root * within),
                false,
            )
        }
        Rule::Peak(_) => ((mass * (own / determinant).sqrt()).min(0.999), true),
        Rule::Surface { .. } => {
            let share = (own / determinant).sqrt();
            (mass / (std::f32::consts::TAU * plane) * share, false)
        }
    };
    let centre = (centre - axes.corner) * axes.per_unit;
    let is_finite = centre.is_finite() && slope.is_finite() && peak.is_finite();
    (is_finite && peak > 0.0).then_some(Occluder {
        centre,
        form,
        half: Vec2::new(a.sqrt(), c.sqrt()) * REACH,
        peak,
        is_opacity,
        slope,
        sigma: (variance - INTERPOLATED).max(0.0).sqrt(),
    })
}
