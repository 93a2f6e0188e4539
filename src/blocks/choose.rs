//! Chooses how to draw a block in a frame: the filter that its particles share, and whether merged particles replace
//! others. The choice is conservative for every particle of the block, and cheap: it reads no particle.
//!
//! Only sums, products, quotients and square roots are used, so that the device makes the same choice. Twin:
//! `shaders/shared/choose.wgsl`.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::blocks::block::Block;
use crate::blocks::merged::MergeBounds;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::record::{BlockView, ChoiceUniform};
use crate::scene::{ColourIn, MAX_PIECE_WIDTH, StrengthIn};
use crate::splat::Filter;
use crate::splat::budget::{
    AFFINE_SHARE, CONTRAST_SHARE, FILTER_SHARE, MANY_SHARE, MERGE_FOURTH, MERGE_SHARE, MERGE_THIRD,
    MISREAD_SHARE, MIXED_SHARE, TREND,
};
use crate::view::Camera;

/// Bounds on how a block's kernels appear on the image, wherever they lie in the block.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Appearance {
    /// Least distance of a kernel's centre, world units; infinite for an orthographic camera, whose projection is
    /// affine.
    distance: f32,
    /// Greatest tangent of an angle off the camera's axis.
    slope: f32,
    /// 1 + slope².
    stretch: f32,
    /// Least and greatest pixels per world unit at the centres, before the stretch off the axis.
    scale_px: [f32; 2],
}

impl Appearance {
    /// Returns `None` if the block may reach the plane of the eye.
    ///
    /// - `centre`: centre of the block, camera space.
    fn new(
        choice: &ChoiceUniform,
        rotation: &Mat3,
        centre: Vec3,
        half_extent: Vec3,
    ) -> Option<Self> {
        let [least, greatest] = choice.focal_px;
        if choice.orthographic != 0 {
            return Some(Self {
                distance: f32::INFINITY,
                slope: 0.0,
                stretch: 1.0,
                scale_px: [least, greatest],
            });
        }
        let axis = rotation.row(2).abs();
        let half_depth = axis.x * half_extent.x + axis.y * half_extent.y + axis.z * half_extent.z;
        let near = centre.z - half_depth;
        // Phrased so that NaN takes the safe side.
        if !(near > 0.0) {
            return None;
        }
        let radius = half_extent.length();
        let beside = (centre.x * centre.x + centre.y * centre.y).sqrt() + radius;
        let slope = beside / near;
        Some(Self {
            distance: near.max(centre.length() - radius),
            slope,
            stretch: 1.0 + slope * slope,
            scale_px: [least / (centre.z + half_depth), greatest / near],
        })
    }
}

/// Bounds on a block's particles, apart from their positions.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Kernels {
    /// Least and greatest standard deviation.
    sigmas: [f32; 2],
    /// Whether all are spheres.
    are_round: bool,
    /// The greatest mass.
    mass: f32,
    /// Greatest overlap count, as [`Block::crowding`].
    crowding: f32,
    /// Greatest change of the colour, or of the extinction relative to its greatest, per unit of value.
    slope: f32,
}

impl Kernels {
    /// Finds the bounds of a block.
    ///
    /// - `is_spread`: whether the kernels are classified over their extents, and may be flattened.
    fn new(volume: &BlockedVolume, block: &Block, is_spread: bool) -> Self {
        let [low, high] = block.classified_range(is_spread);
        let merged = volume.merged.as_ref().and_then(|m| m.transfer.as_ref());
        let change = merged.map_or(0.0, |m| m.slopes.max_slope(low, high));
        let (extinction, slope) = match (&volume.strength, &volume.transfer_function) {
            (StrengthIn::Classified { .. }, Some(transfer)) => {
                let greatest = transfer.max_extinction(low, high);
                (greatest, change / greatest)
            }
            (_, Some(_)) if volume.colour == ColourIn::Classified => (1.0, change),
            _ => (1.0, 0.0),
        };
        let are_round = matches!(volume.particles, BlockedParticles::Isotropic { .. });
        Self {
            sigmas: if is_spread {
                [0.0, block.max_sigma * MAX_PIECE_WIDTH]
            } else {
                [block.min_sigma, block.max_sigma]
            },
            are_round: are_round && !is_spread,
            mass: block.max_strength * extinction,
            crowding: block.crowding,
            slope,
        }
    }

    /// Returns a bound on the optical depth at a kernel's centre, after the low-pass filter.
    fn peak(&self, appearance: &Appearance, h2: f32) -> f32 {
        let [least_px, greatest_px] = appearance.scale_px;
        let narrowest = self.sigmas[0] * least_px;
        self.mass * greatest_px * greatest_px * appearance.stretch.sqrt()
            / (std::f32::consts::TAU * (h2 + narrowest * narrowest))
    }
}

/// Sets the filter of each view.
pub fn choose(
    volume: &BlockedVolume,
    camera: &Camera,
    choice: &ChoiceUniform,
    views: &mut [BlockView],
) {
    let rotation = camera.camera_from_world.as_mat3();
    views.par_iter_mut().with_min_len(64).for_each(|view| {
        let block = &volume.blocks[view.block as usize];
        let centre = Vec3::from(view.origin_camera);
        let is_spread = view.is_spread();
        let filter = filter_of(volume, choice, &rotation, block, is_spread, centre);
        view.filter_kind = filter as u32;
    });
}

fn filter_of(
    volume: &BlockedVolume,
    choice: &ChoiceUniform,
    rotation: &Mat3,
    block: &Block,
    is_spread: bool,
    centre: Vec3,
) -> Filter {
    let asked = Filter::ALL[choice.filter_kind as usize];
    if asked != Filter::Adaptive {
        return asked;
    }
    let appearance = Appearance::new(choice, rotation, centre, block.half_extent);
    let kernels = Kernels::new(volume, block, is_spread);
    match appearance {
        None if choice.by_hand != 0 => Filter::Ewa,
        None => Filter::Adaptive,
        Some(appearance) if choice.by_hand != 0 => by_hand(choice, &appearance, &kernels),
        Some(appearance) => by_tolerance(choice, &appearance, &kernels),
    }
}

/// Evaluates eq. 7 of Chen et al. 2004 for all of a block: r_k is the kernels' standard deviation and r_h that of the
/// low-pass filter, one unit in front of the eye.
fn by_hand(choice: &ChoiceUniform, appearance: &Appearance, kernels: &Kernels) -> Filter {
    let h = choice.low_pass_variance_px2.sqrt();
    let [c_min, c_max] = choice.thresholds;
    let [least_px, greatest_px] = appearance.scale_px;
    if kernels.sigmas[0] * least_px * c_min > h {
        Filter::Reconstruction
    } else if kernels.sigmas[1] * greatest_px * c_max < h {
        Filter::LowPass
    } else {
        Filter::Ewa
    }
}

/// Returns the cheapest filter whose bound fits the tolerance for every kernel, or [`Filter::Adaptive`] if each kernel
/// must choose.
fn by_tolerance(choice: &ChoiceUniform, appearance: &Appearance, kernels: &Kernels) -> Filter {
    let h2 = choice.low_pass_variance_px2;
    let [least_px, greatest_px] = appearance.scale_px;
    let [least, greatest] = kernels.sigmas;
    let amplification = amplification(kernels.peak(appearance, h2) * kernels.crowding);
    // Section 2 of the mathematics: the low-pass filter, as a width at the kernel, counts with the widest kernel. Its
    // width is bounded by that at the far side.
    if choice.orthographic == 0 {
        let filter = h2 / (least_px * least_px);
        let widest = (greatest * greatest + filter).sqrt() / appearance.distance;
        let narrowest = least / appearance.distance;
        let error = 0.82 * (widest - narrowest)
            + 1.16 * appearance.slope * widest
            + 1.1 * appearance.stretch * widest * widest;
        if !(error * amplification <= choice.tolerance * AFFINE_SHARE) {
            return Filter::Adaptive;
        }
    }
    let allowed = choice.tolerance * FILTER_SHARE / amplification;
    let widest_px2 = greatest * greatest * greatest_px * greatest_px;
    let narrowest_px2 = least * least * least_px * least_px;
    if widest_px2 * appearance.stretch <= allowed * h2 {
        return Filter::LowPass;
    }
    // Greatest difference of the variances along a footprint's axes, relative to their mean.
    let unequal = choice.focal_px[0] / choice.focal_px[1];
    let beside = appearance.slope * appearance.slope + (1.0 - unequal * unequal);
    let own = if kernels.are_round {
        0.0
    } else {
        (greatest * greatest - least * least) * greatest_px * greatest_px * appearance.stretch
            / (h2 + narrowest_px2)
    };
    let difference = 0.5 * (own + beside * widest_px2 / (h2 + widest_px2));
    let square = difference * difference;
    if 0.368 * difference + 0.64 * square * square <= allowed {
        return Filter::Isotropic;
    }
    if narrowest_px2 * allowed >= h2 {
        return Filter::Reconstruction;
    }
    Filter::Ewa
}

/// Returns a bound on [`opacity_amplification`](crate::splat::opacity_amplification), at least 1. It needs no
/// logarithms: ln tau <= 4 (tau^(1/4) - 1).
fn amplification(tau: f32) -> f32 {
    if tau <= 1.0 {
        return 1.0;
    }
    let r2 = 8.0 * (tau.sqrt().sqrt() - 1.0);
    let r = r2.sqrt();
    1.0 + 0.43 * r * r2 * (0.42 * r).max(1.0)
}

/// Whether the merged particles of a block may be drawn instead of their members.
pub(super) fn merge_fits(
    volume: &BlockedVolume,
    choice: &ChoiceUniform,
    rotation: &Mat3,
    block: &Block,
    bounds: &MergeBounds,
    centre: Vec3,
) -> bool {
    let kernels = Kernels::new(volume, block, false);
    let Some(appearance) = Appearance::new(choice, rotation, centre, block.half_extent) else {
        return false;
    };
    merge_error(choice.low_pass_variance_px2, &appearance, &kernels, bounds)
        <= choice.merge_tolerance * MERGE_SHARE
}

/// Returns a bound on the change of a pixel by merging, for any arrangement of clusters.
fn merge_error(h2: f32, appearance: &Appearance, kernels: &Kernels, bounds: &MergeBounds) -> f32 {
    let [least_px, greatest_px] = appearance.scale_px;
    let narrowest = kernels.sigmas[0] * least_px;
    // Lengths in units of the blur that all members have.
    let unit = greatest_px * appearance.stretch.sqrt() / (h2 + narrowest * narrowest).sqrt();
    let tau = kernels.peak(appearance, h2);
    let shape = |third: f32| {
        let third = third * unit;
        let fourth = bounds.fourth * unit;
        let square = fourth * fourth;
        MERGE_THIRD * (third * third * third) + MERGE_FOURTH * (square * square)
    };
    // A single cluster; and many clusters behind one another, whose errors have either sign.
    let alone = if tau < 1.0 { tau } else { tau.sqrt().sqrt() };
    let many = MANY_SHARE * tau.min(1.0).sqrt();
    let [varied, unlike] = if kernels.slope == 0.0 {
        // The spread of a cluster's values does not matter here, and may be infinite.
        [0.0; 2]
    } else {
        [bounds.spread, bounds.uneven].map(|values| kernels.slope * values)
    };
    let contrast = (bounds.colour + varied).min(1.0);
    let blurred = CONTRAST_SHARE * bounds.second * unit * many;
    // Values are classified as if they were spread evenly; all clusters along a ray may be alike.
    let misread = MISREAD_SHARE * unlike.min(1.0);
    // Clusters side by side are a layer of this optical depth, in which front and back become one colour. The visible
    // layers all err to the same side.
    let layer = kernels.mass / (4.0 * bounds.second * bounds.second);
    let trend = contrast.min(TREND * layer.sqrt());
    let mixed = (MIXED_SHARE * layer).min(1.0) * trend;
    (alone * shape(bounds.third)).max(many * shape(bounds.third_mean))
        + contrast * blurred
        + mixed
        + misread
}
