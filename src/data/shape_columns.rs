//! Names the columns of tables that contain a length, for the code that samples them and the code that
//! transforms them.

/// Lengths; a table has one at most.
pub(crate) const LENGTHS: [&str; 3] = ["sigma", "h", "radius"];

/// A variance matrix \[length²\].
pub(crate) const VARIANCE: [&str; 6] = ["vxx", "vxy", "vxz", "vyy", "vyz", "vzz"];

/// Standard deviations along a kernel's own axes \[length\], and the quaternion w, x, y, z of their rotation.
pub(crate) const SCALES: [&str; 7] = [
    "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];
