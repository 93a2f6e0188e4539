//! Defines the handles of the clip box and the clip plane, and the one that the user holds.

use glam::{DVec2, DVec3};

use crate::screen::AXES;

/// Handle that is held, and the place of the plane's handles.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Handles {
    pub(crate) grip: Option<Grip>,
    /// Point whose projection onto the plane carries the plane's handles; initially the centre of
    /// the data.
    pub(crate) pivot: Option<DVec3>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Part {
    /// Face of the box: its axis, and whether it is the upper one.
    Face(usize, bool),
    /// Position of the plane.
    Move,
    /// Direction of the plane.
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

impl Part {
    /// Text of its tooltip.
    pub(crate) fn tip(self) -> &'static str {
        match self {
            Self::Face(..) => "Drag to move this face of the box\n--clip x0,y0,z0,x1,y1,z1",
            Self::Move => "Drag to move the plane\n--clip nx,ny,nz,d",
            Self::Turn => "Drag to turn the plane\n--clip nx,ny,nz,d",
        }
    }
}

/// Handle that is held.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grip {
    pub(crate) part: Part,
    /// Position of the handle when it was grabbed.
    pub(crate) from: DVec3,
    /// Offset from the pointer to the handle, pixels.
    pub(crate) offset: DVec2,
}
