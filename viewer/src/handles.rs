//! Handles that hold on to what clips: which one a hand has, and from where.

use glam::{DVec2, DVec3};

use crate::screen::AXES;

/// What hands hold.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Handles {
    pub(crate) grip: Option<Grip>,
    /// The point whose foot on the plane has the plane's handles; the middle of the data at first.
    pub(crate) pivot: Option<DVec3>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Part {
    /// Of the box: across an axis, the upper one or the lower one.
    Face(usize, bool),
    /// The plane's place.
    Move,
    /// The plane's direction.
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
    /// Where the handle was.
    pub(crate) from: DVec3,
    /// From the pointer to the handle, pixels.
    pub(crate) offset: DVec2,
}
