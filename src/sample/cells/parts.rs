//! Makes the kernels of the parts of a body.
//!
//! A part's kernel has the centroid and the volume of its body, the variance 12 kernel_width² times its covariance,
//! and the value and the gradient of the cell's interpolant there. Parts beside a wall have mirror images beyond it,
//! on which the field goes on linearly, and are cut there like these.

use glam::{DMat3, DVec3, Vec4Swizzles as _};

use super::covered::OuterFace;
use super::levels::Body;
use super::pieces::{Piece, PieceShape};
use super::walls::{Walls, walls};
use crate::constants::MOST_EDGES;
use crate::math::{factor_of_variance, lower_factor, lower_matrix};
use crate::sample::field::local_models::quadratic::Quadratic;
use crate::sample::kernels::planes::edges;
use crate::sample::refine::rule::Rule;
use crate::sample::refine::{Part, VALUE_REACH};

/// Kernel of a part, or of its mirror image.
#[derive(Debug, Clone)]
pub(super) struct PartKernel {
    pub(super) position: DVec3,
    /// Lower-triangular factor of its variance.
    pub(super) factor: [f64; 6],
    pub(super) volume: f64,
    pub(super) edges: Option<[[f32; 4]; MOST_EDGES]>,
    /// True for mirror images, which follow the part that they mirror.
    pub(super) is_image: bool,
    /// True if a wall beside the kernel does not cut it: outside kernels are missing.
    pub(super) is_partial: bool,
    value: f64,
    gradient: DVec3,
    /// Values that the kernel may take.
    range: [f64; 2],
}

/// The surface near a body.
pub(super) struct NearSurface<'a> {
    pub(super) faces: Vec<&'a OuterFace>,
    /// True if parts are cut at these faces, and have images beyond them.
    pub(super) is_sharp: bool,
    /// True if some faces are covered in part: nothing is cut there.
    pub(super) is_undecided: bool,
}

/// Appends the kernels of the parts of a body; images follow their parts.
///
/// - `count`: number of parts of a piece along each of its parameters.
/// - `node`: returns the position of a node.
pub(super) fn kernels(
    body: &Body,
    (rule, count): (&Rule, usize),
    near: &NearSurface<'_>,
    node: impl Fn(u32) -> DVec3,
    kernels: &mut Vec<PartKernel>,
) {
    let reach = VALUE_REACH * rule.kernel_width / count as f64;
    for (piece, of_cell) in &body.pieces {
        for n in 0..count * count * count {
            let Some(shape) = piece.part(count, n) else {
                continue;
            };
            // Parts whose kernels stay within the cell take its values.
            let is_within = Piece::middle(count, n).iter().all(|t| *t > reach);
            let range = if is_within { *of_cell } else { body.range };
            let Some(mut kernel) = PartKernel::new(&shape, body.origin, range, rule) else {
                continue;
            };
            let factor = lower_matrix(kernel.factor);
            let faces = near.faces.iter().copied();
            let beside = walls(faces, &node, kernel.position, factor);
            let is_open = !near.is_sharp && !beside.planes.is_empty();
            kernel.is_partial = beside.is_partial || near.is_undecided || is_open;
            if !near.is_sharp {
                kernels.push(kernel);
                continue;
            }
            kernel.edges = edges(&beside.planes, kernel.position, &factor);
            let images = images(&kernel, &beside);
            kernels.push(kernel);
            kernels.extend(images);
        }
    }
}

/// Returns the mirror images of a kernel.
fn images(kernel: &PartKernel, beside: &Walls) -> Vec<PartKernel> {
    let factor = lower_matrix(kernel.factor);
    let image = |(position, mirror): (DVec3, DMat3)| {
        let factor = mirror * factor;
        let value = kernel.value + kernel.gradient.dot(position - kernel.position);
        PartKernel {
            position,
            factor: lower_factor(factor),
            edges: edges(&beside.planes, position, &factor),
            is_image: true,
            value,
            range: [kernel.range[0].min(value), kernel.range[1].max(value)],
            ..kernel.clone()
        }
    };
    let all = beside.images(kernel.position, factor).into_iter();
    all.map(image).collect()
}

impl PartKernel {
    fn new(shape: &PieceShape, origin: DVec3, range: [f64; 2], rule: &Rule) -> Option<Self> {
        let scale = 12.0 * rule.kernel_width * rule.kernel_width;
        let factor = factor_of_variance(shape.covariance.map(|c| c * scale))?;
        Some(Self {
            position: origin + shape.place.xyz(),
            factor,
            volume: shape.volume,
            edges: None,
            is_image: false,
            is_partial: false,
            value: shape.place.w,
            gradient: shape.gradient,
            range,
        })
    }

    /// Returns the kernel for the scene; `None` if the function does not show it, or if single precision does not
    /// hold it.
    ///
    /// - `volume`: its volume after the evening out.
    pub(super) fn shown(&self, rule: &Rule, volume: f64) -> Option<Part> {
        if !rule.shows(self.range) {
            return None;
        }
        // Within a cell the interpolant has no second differences to sharpen.
        let field = Quadratic {
            gradient: self.gradient,
            hessian: DMat3::ZERO,
        };
        let kernel = (self.position, self.factor, volume);
        let part = Part::shown(rule, kernel, (self.value, self.range), &field)?;
        Some(Part {
            edges: self.edges,
            ..part
        })
    }
}
