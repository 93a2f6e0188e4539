//! Which way round cells are numbered: files disagree, and some with themselves.

/// Which way the cells of a kind are numbered.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Handedness {
    /// All but a few as VTK has it, or all but a few the other way: a mirrored mesh is none the
    /// worse, and the few are inverted.
    One(f64),
    /// Both ways: whoever made the cells (a Delaunay program, a cutter) did not care, and none is
    /// inverted.
    Any,
}

impl Handedness {
    /// Of so many cells numbered one way and the other.
    pub(crate) fn of([positive, negative]: [usize; 2]) -> Self {
        /// Fewer than one in twenty are mistakes.
        const MISTAKES: usize = 20;
        let turned = positive.min(negative);
        // Of a few cells, one may be a mistake all the same.
        if turned > 1 && MISTAKES * turned >= positive + negative {
            return Self::Any;
        }
        Self::One(if negative > positive { -1.0 } else { 1.0 })
    }

    /// What makes a sound volume positive.
    pub(crate) fn sign(self, volume: f64) -> f64 {
        match self {
            Self::One(sign) => sign,
            Self::Any => volume.signum(),
        }
    }
}
