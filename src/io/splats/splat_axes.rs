//! Defines the axes of each format of splats, and the rotations between them.
//!
//! Files of splats do not state their axes; these are the conventions:
//!
//! | format | x | y | z | up |
//! |---|---|---|---|---|
//! | PLY, compressed PLY, `.splat`, `.ksplat`, SOG | right | down | forward | -y |
//! | SPZ | right | up | back | +y |
//! | glTF, USD | left | up | forward | +y |
//!
//! The first row is the convention of the training scenes (COLMAP's). SPZ's axes are rotated to it by half a
//! turn about x, glTF's by half a turn about z, as in PlayCanvas's `splat-transform` 2.7: numbers of that
//! program are in `tests/data/splat_axes.rs`. Its version 3.7 rotates glTF's the same way, but reads and writes
//! SPZ without a rotation; such files have no mark of it.
//!
//! USD files state whether y or z is up, and are read in their coordinates; the table has those that are written.
//!
//! Readers return the coordinates of the file, except for SPZ, which is rotated to the axes of PLY. glTF splats
//! are not rotated, so that they stay in place beside meshes of glTF files. Writers of splats get the up
//! direction of their input, and rotate it to the format's ([`write_splats`](super::write_splats)). Meshes of
//! glTF and OBJ files, y up, are rotated as glTF splats are. z up, of grids and tables, becomes y down by a
//! quarter turn about x, (x, y, z) to (x, -z, y).

use std::fmt;

use glam::{DQuat, DVec3};

use crate::math::turn_between;

/// The axes of a format of splats, as seen by the camera for which the format is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SplatAxes {
    /// x right, y down, z forward: PLY and formats derived from it.
    RightDownForward,
    /// x right, y up, z back: SPZ.
    RightUpBack,
    /// x left, y up, z forward: glTF and USD.
    LeftUpForward,
}

/// Formats of splats by name ([`Dataset::format`](crate::io::Dataset::format)): the axes of the file, and of the
/// data that are read.
const OF_FORMATS: [(&str, SplatAxes, SplatAxes); 8] = {
    use SplatAxes::{LeftUpForward, RightDownForward, RightUpBack};
    [
        ("PLY splats", RightDownForward, RightDownForward),
        (
            super::splat_table::FORMAT,
            RightDownForward,
            RightDownForward,
        ),
        ("compressed PLY splats", RightDownForward, RightDownForward),
        ("splat records", RightDownForward, RightDownForward),
        ("KSPLAT splats", RightDownForward, RightDownForward),
        ("SOG splats", RightDownForward, RightDownForward),
        ("SPZ splats", RightUpBack, RightDownForward),
        (super::gltf_splats::FORMAT, LeftUpForward, LeftUpForward),
    ]
};

impl SplatAxes {
    /// The axes of a file and of the data read from it, by the format's name; `None` for a format without
    /// splats.
    pub fn of_format(format: &str) -> Option<(Self, Self)> {
        let of = OF_FORMATS.iter().find(|(name, ..)| *name == format);
        of.map(|&(_, file, read)| (file, read))
    }

    /// The up direction.
    pub fn up(self) -> DVec3 {
        match self {
            Self::RightDownForward => DVec3::NEG_Y,
            Self::RightUpBack | Self::LeftUpForward => DVec3::Y,
        }
    }

    /// The rotation from coordinates with up direction `up`, a unit vector, to these axes; the identity if they
    /// agree.
    ///
    /// Axes with y up are taken for glTF's. Rotations are exact if `up` is an axis.
    pub(in crate::io) fn turn_from(self, up: DVec3) -> DQuat {
        let of_training = match self {
            Self::RightDownForward => DQuat::IDENTITY,
            Self::RightUpBack => HALF_ABOUT_X,
            Self::LeftUpForward => HALF_ABOUT_Z,
        };
        of_training * turn_between(up.normalize_or(DVec3::NEG_Y), DVec3::NEG_Y)
    }
}

const HALF_ABOUT_X: DQuat = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
const HALF_ABOUT_Z: DQuat = DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0);

impl fmt::Display for SplatAxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::RightDownForward => "x right, y down, z forward",
            Self::RightUpBack => "x right, y up, z back",
            Self::LeftUpForward => "x left, y up, z forward",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotation_matrix;

    const ALL: [SplatAxes; 3] = [
        SplatAxes::RightDownForward,
        SplatAxes::RightUpBack,
        SplatAxes::LeftUpForward,
    ];

    #[test]
    fn what_is_up_stays_up() {
        let oblique = DVec3::new(0.6, 0.0, -0.8);
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
        for up in axes.flat_map(|a| [a, -a]).chain([oblique]) {
            for to in ALL {
                let turned = rotation_matrix(to.turn_from(up)) * up;
                // Exact but for the arc.
                let most = if up == oblique { 1e-15 } else { 0.0 };
                assert!((turned - to.up()).length() <= most, "{up}");
            }
        }
    }

    #[test]
    fn points_go_where_the_table_says() {
        use SplatAxes::{LeftUpForward, RightDownForward, RightUpBack};
        let p = DVec3::new(1.0, 2.0, 3.0);
        for (up, to, expected) in [
            (DVec3::NEG_Y, RightDownForward, [1.0, 2.0, 3.0]),
            (DVec3::NEG_Y, LeftUpForward, [-1.0, -2.0, 3.0]),
            (DVec3::NEG_Y, RightUpBack, [1.0, -2.0, -3.0]),
            (DVec3::Y, RightDownForward, [-1.0, -2.0, 3.0]),
            (DVec3::Y, LeftUpForward, [1.0, 2.0, 3.0]),
            (DVec3::Z, RightDownForward, [1.0, -3.0, 2.0]),
            (DVec3::Z, LeftUpForward, [-1.0, 3.0, 2.0]),
            (DVec3::X, RightDownForward, [2.0, -1.0, 3.0]),
        ] {
            let turned = rotation_matrix(to.turn_from(up)) * p;
            assert_eq!(turned.to_array(), expected, "{up} to {to}");
        }
        // The identical quaternion comes back.
        let there_and_back =
            RightDownForward.turn_from(DVec3::Y) * LeftUpForward.turn_from(DVec3::NEG_Y);
        assert_eq!(there_and_back, DQuat::IDENTITY);
    }
}
