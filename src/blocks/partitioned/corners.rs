//! Bounds positions of points.

use glam::DVec3;

/// Least and greatest position of points; reversed infinities if there are none.
pub(super) type Corners = [DVec3; 2];

pub(super) const NO_CORNERS: Corners = [DVec3::INFINITY, DVec3::NEG_INFINITY];

/// Extends bounds to others.
pub(super) fn extend(corners: &mut Corners, others: &Corners) {
    corners[0] = corners[0].min(others[0]);
    corners[1] = corners[1].max(others[1]);
}
