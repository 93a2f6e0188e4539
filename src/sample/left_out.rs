//! Lists the reasons why a sample gives no particle.

use crate::sample::report::SampleReport;

/// Reason why a sample gives no particle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LeftOut {
    Position,
    Value,
    Blanked,
    Degenerate,
    LowerDimension,
    Unused,
    Seam,
    Size,
    Indefinite,
    Rotation,
    Strength,
    Opacity,
    Colour,
    BeyondSinglePrecision,
}

impl LeftOut {
    /// Number of reasons.
    pub(super) const COUNT: usize = 14;

    pub(super) const ALL: [Self; Self::COUNT] = [
        Self::Position,
        Self::Value,
        Self::Blanked,
        Self::Degenerate,
        Self::LowerDimension,
        Self::Unused,
        Self::Seam,
        Self::Size,
        Self::Indefinite,
        Self::Rotation,
        Self::Strength,
        Self::Opacity,
        Self::Colour,
        Self::BeyondSinglePrecision,
    ];

    /// Returns the reason in words.
    pub(super) fn reason(self) -> &'static str {
        match self {
            Self::Position => "position not finite",
            Self::Value => "value not finite",
            Self::Blanked => "blanked (iblank 0, or hidden by vtkGhostType)",
            Self::Degenerate => "no volume, or inverted",
            Self::LowerDimension => {
                "points, lines, surfaces and kinds that are not read have no volume"
            }
            Self::Unused => {
                "corner of no cell with a volume (between corners, or of cells left out)"
            }
            Self::Seam => "on a periodic seam, the same as the first plane",
            Self::Size => "size zero, negative or not finite",
            Self::Indefinite => "variance indefinite or not finite",
            Self::Rotation => "quaternion zero or not finite",
            Self::Opacity => "opacity negative or not a number",
            Self::Strength => {
                "strength or volume negative, not finite or beyond single precision (3.4e38)"
            }
            Self::Colour => "colour not finite",
            Self::BeyondSinglePrecision => "shape, volume or mass beyond single precision; rescale",
        }
    }

    /// Counts `faults` by reason into the report.
    pub(super) fn report(
        report: &mut SampleReport,
        noun: &'static str,
        faults: impl Iterator<Item = Self>,
    ) {
        let mut counts = [0; Self::ALL.len()];
        for fault in faults {
            counts[fault as usize] += 1;
        }
        for (fault, count) in Self::ALL.into_iter().zip(counts) {
            report.leave_out(count, noun, fault.reason());
        }
    }
}
