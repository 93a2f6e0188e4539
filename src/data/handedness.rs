//! Determines the orientation in which cells are numbered. Files differ in it, and some mix both.

/// Orientation in which the cells of a kind are numbered.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Handedness {
    /// Nearly all cells have this orientation: 1 is VTK's, -1 the opposite one of a mirrored mesh. The few others are
    /// inverted.
    One(f64),
    /// Both orientations are common, because the program that made the cells (a Delaunay program, a cutter) ignored it.
    /// No cell is inverted.
    Any,
}

impl Handedness {
    /// Determines the orientation from the numbers of cells with positive and negative volume.
    pub(crate) fn of([positive, negative]: [usize; 2]) -> Self {
        /// Reciprocal of the fraction below which the rarer orientation counts as a mistake.
        const MISTAKES: usize = 20;
        let turned = positive.min(negative);
        // Among few cells, a single one may still be a mistake.
        if turned > 1 && MISTAKES * turned >= positive + negative {
            return Self::Any;
        }
        Self::One(if negative > positive { -1.0 } else { 1.0 })
    }

    /// Returns the sign that makes the volume of a sound cell positive.
    pub(crate) fn sign(self, volume: f64) -> f64 {
        match self {
            Self::One(sign) => sign,
            Self::Any => volume.signum(),
        }
    }
}
