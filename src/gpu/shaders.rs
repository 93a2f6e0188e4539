//! Shaders: each is the prelude, files of `shaders/shared/` and a stage's own file, one after the
//! other.

use std::fmt::Write as _;

use super::scene::{ColourKind, PARTICLE_ARGUMENTS, StrengthKind, VIEW_ARGUMENTS, ValueKind};
use crate::blocks::DEPTH_KEY_SPAN;
use crate::constants::{
    BLOCK_CAPACITY, BRICK, DEPTH_KEY_BITS, MAX_CUTOFF, TERMINATION_SHARE, TILE_SIZE,
};
use crate::layout::{PATH_AFFINE, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK};
use crate::math::{HARMONIC_0, HARMONIC_1, HARMONICS_2, HARMONICS_3};
use crate::scene::CLASSIFICATION_TABLE_LEN;

/// A shader's name and the files it is composed of.
#[derive(Debug, Clone, Copy)]
pub struct Shader {
    /// The stage.
    pub name: &'static str,
    parts: &'static [&'static str],
}

impl Shader {
    /// The WGSL text: the prelude and the parts.
    pub fn source(&self) -> String {
        let mut source = prelude();
        for part in self.parts {
            source.push('\n');
            source.push_str(part);
        }
        source
    }

    /// Every shader of the back end.
    pub const ALL: &'static [Self] = &[LAYOUT, SCAN, F64, CULL, CLASSIFY, SHADE];
}

const DISPATCH: &str = include_str!("../../shaders/shared/dispatch.wgsl");

const STRUCTS: &str = include_str!("../../shaders/shared/layout.wgsl");

/// The structs of [`crate::layout`] alone.
const LAYOUT: Shader = Shader {
    name: "layout",
    parts: &[STRUCTS],
};

const F64_ARITHMETIC: &str = include_str!("../../shaders/shared/f64.wgsl");

const TRANSFER: &str = include_str!("../../shaders/shared/transfer.wgsl");

const SCAN_THREADS: &str = include_str!("../../shaders/shared/scan_threads.wgsl");

/// Prefix sums.
pub(super) const SCAN: Shader = Shader {
    name: "scan",
    parts: &[
        DISPATCH,
        SCAN_THREADS,
        include_str!("../../shaders/scan.wgsl"),
    ],
};

/// Double precision in integers, for its test.
pub(super) const F64: Shader = Shader {
    name: "f64",
    parts: &[
        DISPATCH,
        F64_ARITHMETIC,
        include_str!("../../shaders/f64.wgsl"),
    ],
};

/// Which blocks a frame sees.
pub(super) const CULL: Shader = Shader {
    name: "cull",
    parts: &[
        DISPATCH,
        SCAN_THREADS,
        STRUCTS,
        F64_ARITHMETIC,
        TRANSFER,
        include_str!("../../shaders/cull.wgsl"),
    ],
};

/// From values to masses and colours.
pub(super) const CLASSIFY: Shader = Shader {
    name: "classify",
    parts: &[
        DISPATCH,
        SCAN_THREADS,
        STRUCTS,
        TRANSFER,
        include_str!("../../shaders/classify.wgsl"),
    ],
};

/// Colours that depend on the view.
pub(super) const SHADE: Shader = Shader {
    name: "shade",
    parts: &[
        DISPATCH,
        STRUCTS,
        F64_ARITHMETIC,
        include_str!("../../shaders/shade.wgsl"),
    ],
};

/// The numbers that both back ends share, as WGSL constants.
pub fn prelude() -> String {
    let mut text = String::new();
    let integers = [
        ("TILE_SIZE", TILE_SIZE as u32),
        ("BLOCK_CAPACITY", BLOCK_CAPACITY as u32),
        ("BRICK_X", BRICK[0] as u32),
        ("BRICK_Y", BRICK[1] as u32),
        ("BRICK_Z", BRICK[2] as u32),
        ("DEPTH_KEY_BITS", DEPTH_KEY_BITS),
        ("CLASSIFICATION_TABLE_LEN", CLASSIFICATION_TABLE_LEN as u32),
        ("VALUES_NONE", ValueKind::None as u32),
        ("VALUES_U8", ValueKind::U8 as u32),
        ("VALUES_U16", ValueKind::U16 as u32),
        ("VALUES_I16", ValueKind::I16 as u32),
        ("STRENGTH_CELL", StrengthKind::Cell as u32),
        ("STRENGTH_WIDTHS", StrengthKind::Widths as u32),
        ("STRENGTH_GIVEN", StrengthKind::Given as u32),
        ("COLOUR_CLASSIFIED", ColourKind::Classified as u32),
        ("COLOUR_PER_PARTICLE", ColourKind::PerParticle as u32),
        ("COLOUR_UNIFORM", ColourKind::Uniform as u32),
        ("VIEW_ARGUMENTS", VIEW_ARGUMENTS),
        ("PARTICLE_ARGUMENTS", PARTICLE_ARGUMENTS),
        ("PATH_AFFINE", PATH_AFFINE),
        ("PATH_PEAK", PATH_PEAK),
        ("PATH_EXACT", PATH_EXACT),
        ("PATH_NEAR", PATH_NEAR),
        ("PATH_HALF_LINE", PATH_HALF_LINE),
    ];
    for (name, value) in integers {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    let floats = [
        ("MAX_CUTOFF", MAX_CUTOFF),
        ("TERMINATION_SHARE", TERMINATION_SHARE),
        ("HARMONIC_0", HARMONIC_0),
        ("HARMONIC_1", HARMONIC_1),
    ];
    for (name, value) in floats {
        let _ = writeln!(text, "const {name}: f32 = {value:?};");
    }
    let lists = [
        ("HARMONICS_2", HARMONICS_2.as_slice()),
        ("HARMONICS_3", HARMONICS_3.as_slice()),
    ];
    for (name, values) in lists {
        let (count, values) = (values.len(), format!("{values:?}"));
        let values = values.trim_matches(['[', ']']);
        let kind = format!("array<f32, {count}>");
        let _ = writeln!(text, "const {name}: {kind} = {kind}({values});");
    }
    let doubles = [
        ("DEPTH_KEY_SPAN", DEPTH_KEY_SPAN),
        ("GREATEST_F32", f64::from(f32::MAX)),
    ];
    for (name, value) in doubles {
        let [low, high] = words(value);
        let _ = writeln!(
            text,
            "const {name}: vec2<u32> = vec2<u32>({low}u, {high}u);"
        );
    }
    text
}

/// The words of a number of f64, the low one first.
pub(super) fn words(x: f64) -> [u32; 2] {
    let bits = x.to_bits();
    [bits as u32, (bits >> 32) as u32]
}
