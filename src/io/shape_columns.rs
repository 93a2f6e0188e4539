//! Columns of tables that have a length in them, by name: one home for what samples them and what moves them.

/// Lengths: of which a table has one at most.
pub(crate) const LENGTHS: [&str; 3] = ["sigma", "h", "radius"];

/// A variance matrix \[length²\].
pub(crate) const VARIANCE: [&str; 6] = ["vxx", "vxy", "vxz", "vyy", "vyz", "vzz"];

/// Standard deviations along a kernel's own axes \[length\], and the quaternion w, x, y, z that turns these.
pub(crate) const SCALES: [&str; 7] = [
    "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];
