//! Describes a face of a grid beside the cell of a node, so that parts of the cell are cut there.

use glam::DVec3;

use super::neighbourhood::weights;
use crate::constants::EDGE_REACH;
use crate::sample::kernels::planes::plane_of;

/// Factor by which a kernel reaches farther than its deviation along the index says: on curved faces and in sheared
/// cells.
const SLACK: f64 = 1.5;

/// Distance in cells by which a face may bend towards a part.
const BEND: f64 = 0.5;

/// The nodes of a face around the node nearest to a cell, and those of the next plane inside.
pub(in crate::sample) struct FaceNodes {
    /// Index along which the face ends the grid.
    pub(in crate::sample) axis: usize,
    pub(in crate::sample) is_upper: bool,
    /// Number of cells from the face to the node; below 0 outside the grid.
    pub(in crate::sample) distance: isize,
    /// Positions of 3 x 3 nodes on the face and inside it, the index after `axis` fastest.
    pub(in crate::sample) nodes: [[DVec3; 9]; 2],
}

impl FaceNodes {
    /// Returns true if the face may cut the kernel of a part.
    ///
    /// - `offset`: distance of the part from the node along the face's axis; `sigma`: the kernel's deviation, in
    ///   cells.
    pub(super) fn is_near(&self, offset: f64, sigma: f64) -> bool {
        let inwards = if self.is_upper { -offset } else { offset };
        let inside = self.distance as f64 + inwards;
        inside < SLACK * f64::from(EDGE_REACH) * sigma + BEND
    }

    /// Returns the tangent plane at the place of a part: its normal into the grid, and a point. The face is
    /// bilinear between nodes. Returns `None` if it has collapsed.
    pub(super) fn plane(&self, offsets: [Option<f64>; 3]) -> Option<[DVec3; 2]> {
        let [b, c] = [1, 2].map(|by| offsets[(self.axis + by) % 3]);
        let (wb, wc) = (weights(b), weights(c));
        let sum = |nodes: &[DVec3; 9], wb: [f64; 3], wc: [f64; 3]| {
            // From differences, so that a distant origin costs no digits.
            let own = nodes[4];
            let terms = nodes.iter().enumerate();
            terms.fold(DVec3::ZERO, |sum, (n, node)| {
                sum + (*node - own) * (wb[n % 3] * wc[n / 3])
            })
        };
        let [face, inner] = &self.nodes;
        let origin = face[4] + sum(face, wb[0], wc[0]);
        let inward = inner[4] + sum(inner, wb[0], wc[0]) - origin;
        let (u, v) = (sum(face, wb[1], wc[0]), sum(face, wb[0], wc[1]));
        plane_of(origin, inward, u, v)
    }
}
