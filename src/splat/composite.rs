//! How footprints become a picture.

/// How footprints that lie behind one another become a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Composite {
    /// Each kernel by itself, in the order of the distances of their centres ("splat every sample").
    /// Kernels that overlap in depth do not mix: where their order changes, the picture jumps by at
    /// most alpha1 alpha2 |c1 - c2|.
    #[default]
    Over = 0,
    /// Kernels are summed in sheets parallel to the image, whole, each in the sheet of its centre, and
    /// the sheets composited ("sheet buffer", Mueller and Crawfis 1998; section 2 of Zwicker et al.
    /// 2001).
    Sheets = 1,
    /// The same in sheets across the axis of the volume that is nearest to the direction of view (Westover
    /// 1990; section 4 of Chen et al. 2004): the picture jumps where that changes.
    AxisSheets = 2,
    /// Kernels are cut into slabs parallel to the image, of each slab the part of a kernel's optical
    /// depth that lies in it, a difference of two error functions. What lies in a slab mixes. The
    /// picture converges to the true integral with the square of the thickness, and nothing jumps.
    Slabs = 3,
}

impl Composite {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Over, Self::Sheets, Self::AxisSheets, Self::Slabs];

    /// The name that the command line knows it by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Over => "over",
            Self::Sheets => "sheets",
            Self::AxisSheets => "axis-sheets",
            Self::Slabs => "slabs",
        }
    }
}
