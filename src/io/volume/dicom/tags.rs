//! Lists the elements that are read, by tag (PS3.6).

/// Group and element number.
pub(super) type Tag = u32;

/// Kind of a value. Implicit files do not state it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Text, or bytes whose tag defines their meaning.
    Plain,
    /// Data sets.
    Sequence,
}

pub(super) const ITEM: Tag = 0xfffe_e000;
pub(super) const ITEM_END: Tag = 0xfffe_e00d;
pub(super) const SEQUENCE_END: Tag = 0xfffe_e0dd;

pub(super) const FLOAT_PIXEL_DATA: Tag = 0x7fe0_0008;
pub(super) const DOUBLE_PIXEL_DATA: Tag = 0x7fe0_0009;
pub(super) const PIXEL_DATA: Tag = 0x7fe0_0010;
/// Tags of the pixels; a file has one of them.
pub(super) const PIXELS: [Tag; 3] = [PIXEL_DATA, FLOAT_PIXEL_DATA, DOUBLE_PIXEL_DATA];

macro_rules! tags {
    ($($name:ident = $tag:literal $kind:ident;)*) => {
        $(pub(super) const $name: Tag = $tag;)*

        /// Returns the kind of an element that is read; `None` for all others.
        pub(super) fn kind(tag: Tag) -> Option<Kind> {
            match tag {
                $($name => Some(Kind::$kind),)*
                FLOAT_PIXEL_DATA | DOUBLE_PIXEL_DATA | PIXEL_DATA => Some(Kind::Plain),
                _ => None,
            }
        }
    };
}

tags! {
    MEDIA_STORAGE_CLASS = 0x0002_0002 Plain;
    TRANSFER_SYNTAX = 0x0002_0010 Plain;
    SOP_CLASS = 0x0008_0016 Plain;
    MODALITY = 0x0008_0060 Plain;
    SLICE_THICKNESS = 0x0018_0050 Plain;
    SPACING_BETWEEN_SLICES = 0x0018_0088 Plain;
    IMAGER_PIXEL_SPACING = 0x0018_1164 Plain;
    SERIES = 0x0020_000e Plain;
    INSTANCE_NUMBER = 0x0020_0013 Plain;
    IMAGE_POSITION = 0x0020_0032 Plain;
    IMAGE_ORIENTATION = 0x0020_0037 Plain;
    PLANE_POSITION = 0x0020_9113 Sequence;
    PLANE_ORIENTATION = 0x0020_9116 Sequence;
    SAMPLES_PER_PIXEL = 0x0028_0002 Plain;
    PHOTOMETRIC = 0x0028_0004 Plain;
    PLANAR = 0x0028_0006 Plain;
    FRAME_COUNT = 0x0028_0008 Plain;
    ROWS = 0x0028_0010 Plain;
    COLUMNS = 0x0028_0011 Plain;
    PIXEL_SPACING = 0x0028_0030 Plain;
    PIXEL_ASPECT = 0x0028_0034 Plain;
    BITS_ALLOCATED = 0x0028_0100 Plain;
    BITS_STORED = 0x0028_0101 Plain;
    HIGH_BIT = 0x0028_0102 Plain;
    PIXEL_REPRESENTATION = 0x0028_0103 Plain;
    PADDING = 0x0028_0120 Plain;
    PADDING_LIMIT = 0x0028_0121 Plain;
    FLOAT_PADDING = 0x0028_0122 Plain;
    DOUBLE_PADDING = 0x0028_0123 Plain;
    RESCALE_INTERCEPT = 0x0028_1052 Plain;
    RESCALE_SLOPE = 0x0028_1053 Plain;
    RESCALE_TYPE = 0x0028_1054 Plain;
    MODALITY_LUT = 0x0028_3000 Sequence;
    PIXEL_MEASURES = 0x0028_9110 Sequence;
    PIXEL_VALUE_TRANSFORMATION = 0x0028_9145 Sequence;
    DETECTORS = 0x0054_0022 Sequence;
    UNITS = 0x0054_1001 Plain;
    DOSE_UNITS = 0x3004_0002 Plain;
    FRAME_OFFSETS = 0x3004_000c Plain;
    DOSE_SCALING = 0x3004_000e Plain;
    SHARED_GROUPS = 0x5200_9229 Sequence;
    PER_FRAME_GROUPS = 0x5200_9230 Sequence;
}

/// Returns a tag as the standard writes it.
pub(super) fn shown(tag: Tag) -> String {
    format!("{:04x},{:04x}", tag >> 16, tag & 0xffff)
}
