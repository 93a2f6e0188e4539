//! Handles of the clip box and the clip plane: the one that the user holds, and where it was taken.

use glam::{DVec2, DVec3};

use crate::screen::AXES;

/// The handle that is held, and the place of the plane's handles.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Handles {
    pub(crate) grip: Option<Grip>,
    /// The point whose foot on the plane carries the plane's handles; at first the middle of the data.
    pub(crate) pivot: Option<DVec3>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Part {
    /// A face of the box: its axis, and whether it is the upper one.
    Face(usize, bool),
    /// The position of the plane.
    Move,
    /// The direction of the plane.
    Turn,
}

impl Part {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Face(axis, is_upper) => {
                let end = if is_upper { "upper" } else { "lower" };
                format!("{end} {} face", AXES[axis].0)
            }
            Self::Move => "clip plane".into(),
            Self::Turn => "normal of the clip plane".into(),
        }
    }
}

/// A handle that is held.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grip {
    pub(crate) part: Part,
    /// The position of the handle when it was taken.
    pub(crate) from: DVec3,
    /// The offset from the pointer to the handle, pixels.
    pub(crate) offset: DVec2,
}
