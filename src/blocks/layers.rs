//! Defines the layers of a frame: the sheets and slabs in which kernels are summed, and their depth keys.

use glam::DVec3;

use crate::blocks::block::Block;
use crate::blocks::cull::DepthRange;
use crate::blocks::extent::THICKEST_SLAB;
use crate::blocks::scene::BlockedScene;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::constants::{DEPTH_KEY_BITS, MAX_CUTOFF};
use crate::error::{Error, Result};
use crate::scene::StrengthIn;
use crate::view::Camera;

/// Layers of a frame: from `near` on along an axis, all of the same thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layers {
    /// A unit vector in camera space, away from the eye.
    pub axis: DVec3,
    /// Beginning of the first layer, world units along the axis from the eye.
    pub near: f64,
    /// Thickness of a layer, world units.
    pub thickness: f64,
    /// Shift from keys to layers: a key belongs to the layer `key >> shift`.
    pub shift: u32,
    /// Greatest error of slabs of this thickness, approximately, at the densest kernels. 0 for sheets, which promise no
    /// bound.
    pub error: f64,
}

/// Error of a slab of thickness D: about .01 kappa D²/sigma, with extinction kappa and standard deviation sigma of the
/// kernels. Worst of 40 random arrangements of 120 kernels of random colours, optical depths 2 to 40, D/sigma 2 to 1/4
/// (`tests/frames/composite.rs`).
const SLAB_ERROR: f64 = 0.01;
/// Bound on the error of a slab however thin the kernels: kappa D / 8. If the front half of a slab of depth t = kappa D
/// has one colour and the back half another, it is off by t²/8 of their difference. Of the slabs behind it, about 1/t
/// show through, each as far off.
const MIXED_ERROR: f64 = 0.125;
/// Share of the tolerance for the slabs.
const SLAB_SHARE: f64 = 0.5;
/// Most slabs that a kernel reaches: a tile keeps their sums, 5 KiB each, 11 KiB if they are lit.
pub(crate) const MOST_SLABS: u32 = 4096;
/// Least thickness of slabs, relative to the thickest kernels, unless the thickness is given: a kernel then reaches 200
/// slabs, which a GPU can keep.
const THINNEST: f64 = 1.0 / 16.0;

/// Kinds of layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerKind {
    /// Sheets parallel to the image.
    Sheets,
    /// Sheets across the axis of the data that is nearest to the direction of view.
    AxisSheets,
    /// Slabs parallel to the image, into which kernels are cut.
    Slabs,
}

/// Least thickness of slabs, relative to the greatest depth: 16 roundings of f32, so that the beginning of a slab is
/// accurate to a sixteenth of its thickness.
const LEAST_STEP: f64 = 16.0 / (1 << 24) as f64;

impl Layers {
    /// Defines the layers of a kind in which the kernels that a camera sees are summed.
    ///
    /// - `thickness`: world units. `None` derives it from the data: for sheets the spacing of the samples (along the
    ///   axis of a lattice), for slabs the tolerance.
    ///
    /// # Errors
    /// A thickness so small that the layers cannot be told apart, or that a kernel reaches thousands of them.
    pub fn new(
        scene: &BlockedScene,
        camera: &Camera,
        kind: LayerKind,
        thickness: Option<f64>,
        tolerance: f64,
    ) -> Result<Self> {
        let (volumes, rotation) = (scene.volumes(), camera.camera_from_world);
        // Sheets take whole kernels: their thickness does not depend on the kernels.
        let mut kernels = SlabKernels::default();
        let (axis, phase, spacing) = match kind {
            LayerKind::Slabs => {
                kernels = SlabKernels::of(scene, camera);
                (DVec3::Z, 0.0, kernels.thickness(tolerance))
            }
            LayerKind::Sheets => (DVec3::Z, 0.0, sample_spacing(volumes)),
            LayerKind::AxisSheets => {
                let (axis, place, spacing) = nearest_axis(volumes, rotation.row(2));
                // Layers begin half-way between samples.
                let at = (place - camera.eye).dot(axis) - 0.5 * thickness.unwrap_or(spacing);
                ((rotation * axis).normalize(), at, spacing)
            }
        };
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for block in volumes.iter().flat_map(|v| &v.blocks) {
            let centre = axis.dot(camera.camera_point(block.origin));
            let reach = f64::from(block.max_sigma) * f64::from(MAX_CUTOFF)
                + block.half_extent.as_dvec3().length();
            first = first.min(centre - reach);
            last = last.max(centre + reach);
        }
        if first > last {
            (first, last) = (0.0, 0.0);
        }
        // Slabs begin at depths in f32: thinner than some roundings of the farthest depth, they would coincide.
        let resolved = kernels.farthest * LEAST_STEP;
        let thickness = thickness.unwrap_or(spacing.max(resolved));
        // Whole layers from the phase on; two to spare for roundings.
        let number = ((first - phase) / thickness).floor() - 2.0;
        let count = ((last - phase) / thickness).ceil() + 2.0 - number;
        let bits = count.log2().ceil();
        let least_of_keys = (last - first) / f64::from(DEPTH_KEY_BITS).exp2();
        let reach = 2.0 * f64::from(MAX_CUTOFF) * kernels.thickest();
        let least = least_of_keys
            .max(reach / f64::from(MOST_SLABS))
            .max(resolved);
        // Phrased so that NaN is refused.
        if !(bits <= f64::from(DEPTH_KEY_BITS) && thickness > 0.0 && thickness >= least) {
            return Err(Error::invalid(
                "settings",
                "thickness of layers",
                format!("at least {:.1e} for this scene", 1.1 * least),
                thickness.to_string(),
                "make it larger",
            ));
        }
        Ok(Self {
            axis,
            near: phase + number * thickness,
            thickness,
            shift: DEPTH_KEY_BITS - bits.max(1.0) as u32,
            error: kernels.error(thickness),
        })
    }

    /// Returns depth keys along the axis; a layer has a power of two of them.
    pub fn depth_range(&self) -> DepthRange {
        let keys_per_unit = self.keys_per_unit();
        DepthRange::given(self.near_of_keys(), keys_per_unit)
    }

    /// Keys per unit of distance.
    pub fn keys_per_unit(&self) -> f64 {
        (f64::from(self.shift).exp2() / self.thickness).min(f64::from(f32::MAX))
    }

    /// Returns the distance at which keys begin: [`DepthRange::key`] adds four, and the first layer begins with key 0.
    pub fn near_of_keys(&self) -> f64 {
        self.near + 4.0 / self.keys_per_unit()
    }
}

/// Kernels that determine the thickness of slabs. For each visible block: the greatest extinction of a kernel at its
/// densest, and the least and the greatest standard deviation.
#[derive(Default)]
struct SlabKernels {
    kernels: Vec<[f64; 3]>,
    /// Greatest distance of a block's centres from the plane of the eye.
    farthest: f64,
}

impl SlabKernels {
    fn of(scene: &BlockedScene, camera: &Camera) -> Self {
        let mut all = Self::default();
        for (volume, densities) in scene.volumes().iter().zip(scene.densities()) {
            if volume.merged.is_some() || volume.is_surface() {
                continue;
            }
            for (block, density) in volume.blocks.iter().zip(densities) {
                let kappa = greatest_extinction(volume, block) * density;
                let [thin, thick] = [block.min_sigma, block.max_sigma].map(f64::from);
                // Phrased so that NaN is left out.
                if kappa > 0.0 && thin > 0.0 {
                    all.kernels.push([kappa, thin, thick]);
                    let reach = block.half_extent.as_dvec3().length();
                    let depth = camera.camera_point(block.origin).z.abs() + reach;
                    all.farthest = all.farthest.max(depth);
                }
            }
        }
        all
    }

    fn thickest(&self) -> f64 {
        self.kernels
            .iter()
            .fold(0.0, |most, [_, _, sigma]| sigma.max(most))
    }

    /// Returns the thickness at which slabs keep their share of the tolerance, within the least and the greatest
    /// thickness.
    fn thickness(&self, tolerance: f64) -> f64 {
        let share = SLAB_SHARE * tolerance;
        let mut wanted = f64::INFINITY;
        for [kappa, sigma, _] in &self.kernels {
            let by_kernels = (share * sigma / (SLAB_ERROR * kappa)).sqrt();
            wanted = wanted
                .min(by_kernels.max(share / (MIXED_ERROR * kappa)))
                .min(f64::from(THICKEST_SLAB) * sigma);
        }
        let least = THINNEST * self.thickest();
        if self.kernels.is_empty() {
            1.0
        } else {
            wanted.max(least)
        }
    }

    /// Returns the error of slabs of a thickness.
    fn error(&self, thickness: f64) -> f64 {
        let of_block = |[kappa, sigma, _]: &[f64; 3]| {
            (SLAB_ERROR * kappa * thickness * thickness / sigma)
                .min(MIXED_ERROR * kappa * thickness)
        };
        self.kernels
            .iter()
            .map(of_block)
            .fold(0.0, f64::max)
            .min(1.0)
    }
}

/// Returns the greatest extinction of a block's values, or 1 if masses are given.
fn greatest_extinction(volume: &BlockedVolume, block: &Block) -> f64 {
    let [lo, hi] = block.value_range;
    match (&volume.strength, &volume.transfer_function) {
        (StrengthIn::Classified { .. }, Some(transfer)) if lo <= hi => {
            f64::from(transfer.max_extinction(lo, hi))
        }
        (StrengthIn::Classified { .. }, _) => 0.0,
        _ => 1.0,
    }
}

/// Returns the distance between samples: for lattices the mean of their cells' edges, otherwise the spacing that
/// kernels of the default width represent.
fn sample_spacing(volumes: &[BlockedVolume]) -> f64 {
    let of = |volume: &BlockedVolume| match &volume.particles {
        BlockedParticles::Lattice(grid) => grid.lattice().mean_step().determinant().abs().cbrt(),
        _ => {
            let mut sigmas: Vec<f32> = volume.blocks.iter().map(|b| b.max_sigma).collect();
            let middle = sigmas.len() / 2;
            if sigmas.is_empty() {
                return f64::INFINITY;
            }
            let (_, median, _) = sigmas.select_nth_unstable_by(middle, f32::total_cmp);
            f64::from(*median) / 0.6
        }
    };
    let base = volumes
        .iter()
        .filter(|v| v.merged.is_none() && !v.is_surface());
    let spacing = base.map(of).fold(f64::INFINITY, f64::min);
    if spacing.is_finite() && spacing > 0.0 {
        spacing
    } else {
        1.0
    }
}

/// Returns the axis that is nearest to a direction, of the first lattice or else of the world: a unit vector along it,
/// the position of a sample, and the distance between samples.
fn nearest_axis(volumes: &[BlockedVolume], forward: DVec3) -> (DVec3, DVec3, f64) {
    let lattice = volumes.iter().find_map(|volume| match &volume.particles {
        BlockedParticles::Lattice(grid) if volume.merged.is_none() => Some(grid.lattice()),
        _ => None,
    });
    let lattice = lattice.map(|lattice| (lattice.mean_step(), lattice.position([0; 3])));
    let (step, place) = lattice.unwrap_or_else(|| {
        let spacing = sample_spacing(volumes);
        (
            glam::DMat3::from_diagonal(DVec3::splat(spacing)),
            DVec3::ZERO,
        )
    });
    // Slices along an axis lie across the other two: use their normal.
    let normals = step.inverse().transpose();
    let along =
        [normals.x_axis, normals.y_axis, normals.z_axis].map(|n| (n.normalize(), 1.0 / n.length()));
    let mut best = (along[0].0, along[0].1);
    for (n, spacing) in along {
        if n.dot(forward).abs() > best.0.dot(forward).abs() {
            best = (n, spacing);
        }
    }
    let (normal, spacing) = best;
    (
        normal * 1.0_f64.copysign(normal.dot(forward)),
        place,
        spacing,
    )
}
