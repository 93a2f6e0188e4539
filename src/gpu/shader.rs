//! Composes shaders as text. Each is the concatenation of the prelude, files of `shaders/shared/` and a
//! stage's own files; the stages choose the files.

use std::borrow::Cow;
use std::fmt::Write as _;

use super::constants::{
    MAX_GROUPS, NO_DEPTH, NO_LAYER, PARTICLE_ARGUMENTS, RADIX_BITS, RADIX_GROUPS, RADIX_SCANNED,
    RADIX_TILE, RULE_KERNEL, RULE_PEAK, RULE_SURFACE, RULE_TRANSLUCENT, SCAN_RUN, THREADS,
    VIEW_ARGUMENTS,
};
use super::kinds::{ColourKind, StrengthKind, ValueKind};
use super::packed::words;
use crate::blocks::{DEPTH_KEY_SPAN, PIECE_REACH, THICKEST_SLAB};
use crate::constants::{
    BRICK, CLASSIFICATION_TABLE_LEN, CLIP_SOFTNESS, COVERAGE_FULL, DEPTH_KEY_BITS, EDGE_REACH,
    EXP2_SERIES, FAINT, FRAC_1_SQRT_2PI, LEAST_SLOPE, LEAST_SPREAD, MAX_CLIP_PLANES, MAX_CUTOFF,
    MAX_LIGHTS, MAX_PLANES, MOST_EDGES, NEAR_MARGIN, SPLAT_CEILING, SPLAT_CUTOFF, SPLAT_FLOOR,
    SRGB_GAMMA, SRGB_LINEAR_END, SRGB_OFFSET, SRGB_SCALE, SRGB_SLOPE, SURFACE_LAYERS,
    TERMINATION_INTERVAL, TERMINATION_SHARE, TILE_SIZE,
};
use crate::cpu::{GREATEST_LEAN, SHADOW_DIRECTIONS, SHADOW_TAPS, STEEPEST_SHADOW};
use crate::math::lane::{CDF_REACH, CDF_SERIES};
use crate::math::{
    E1_DENOMINATOR, E1_NUMERATOR, EIN_SERIES, EIN_SPLIT, ERFC_SERIES, EULER, HARMONIC_0,
    HARMONIC_1, HARMONICS_2, HARMONICS_3, NORMAL_STEPS,
};
use crate::record::{
    ClassifiedBy, KeyKind, MERGED_FITS, MERGED_OPEN, MERGED_UNSEEN, PATH_AFFINE, PATH_CAPPED,
    PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_NEAR_SURFEL, PATH_PEAK, PATH_SURFEL, RAY_EDGES,
};
use crate::scene::{
    DEPARTURE_BITS, DEPARTURE_STEPS_PER_OCTAVE, DIRECTION_BITS, DIRECTION_STEPS, FAR_ENTRIES,
    LOBE_CELLS_PER_DEVIATION, LOBE_REACH, LOBE_ROWS_PER_OCTAVE, MAX_LOBE_ROWS, MAX_LOBES,
    MAX_PIECE_WIDTH, MAX_WINDOWS, MAXIMUM_ROUNDING, RANGE_BITS, RANGE_STEPS, SLOPE_BITS,
    SLOPE_STEPS_PER_OCTAVE, SplatRule,
};
use crate::splat::budget::{
    AFFINE_SHARE, CONTRAST_SHARE, CUTOFF_SHARE, FILTER_SHARE, GREATEST_ENLARGEMENT, MANY_SHARE,
    MEETING, MERGE_FOURTH, MERGE_SHARE, MERGE_THIRD, MISREAD_SHARE, MIXED_SHARE, OVERLAP, TREND,
};
use crate::splat::{
    ANTI_ALIASED_LOW_PASS_PX2, BAND_NODES, BAND_REACH, CDF_WHOLE, CHOICE_COLOURS, Filter, GRAZING,
    JACOBIAN_MARGIN, LEAST_DRAWN_PX, LEAST_MEAN_SIGMA_PX, MOST_ROWS, PERSPECTIVE_FROM,
    PIXEL_VARIANCE_PX2, PROFILE_CELLS, REACHES, ROWS_PER_SHEAR, SAMPLED_FROM_PX2, SHORT_SIDE,
    SIDE_PLACE, SLACK_PIXELS, SLACK_SIGMAS, SLACK_SLOPE, SPLAT_LOW_PASS_PX2, SUB_PIXEL_FAINT,
    SUB_PIXEL_LARGE, SUB_PIXEL_LOGS, SUB_PIXEL_NODES, SUB_PIXEL_OPAQUE, SUB_PIXEL_REACH,
    SUB_PIXEL_SPLIT, SUB_PIXEL_WEIGHTS,
};

/// A shader's name and the files it is composed of.
#[derive(Debug, Clone)]
pub struct Shader {
    /// Name of the stage, and of the variant.
    pub name: Cow<'static, str>,
    /// Constants of this shader alone.
    constants: Vec<(&'static str, u32)>,
    parts: Cow<'static, [&'static str]>,
}

impl Shader {
    /// Makes a shader of certain files.
    pub(super) const fn new(name: &'static str, parts: &'static [&'static str]) -> Self {
        Self {
            name: Cow::Borrowed(name),
            constants: Vec::new(),
            parts: Cow::Borrowed(parts),
        }
    }

    /// Makes a shader of chosen files, with constants of its own before them.
    pub(super) fn composed(
        name: String,
        constants: Vec<(&'static str, u32)>,
        parts: Vec<&'static str>,
    ) -> Self {
        Self {
            name: Cow::Owned(name),
            constants,
            parts: Cow::Owned(parts),
        }
    }

    /// Returns the WGSL text: the prelude and the parts.
    pub fn source(&self) -> String {
        let mut source = prelude();
        for (name, value) in &self.constants {
            let _ = writeln!(source, "const {name}: u32 = {value}u;");
        }
        for part in &*self.parts {
            source.push('\n');
            source.push_str(part);
        }
        source
    }
}

/// The structs of [`crate::record`].
pub(super) const STRUCTS: &str = include_str!("../../shaders/shared/layout.wgsl");
/// Index of a thread's workgroup.
pub(super) const DISPATCH: &str = include_str!("../../shaders/shared/dispatch.wgsl");
/// Unit vectors in a word.
pub(super) const NORMAL: &str = include_str!("../../shaders/shared/normal.wgsl");
/// The plane of two tangents.
pub(super) const TANGENTS: &str = include_str!("../../shaders/shared/tangents.wgsl");
/// Exponentials with a known error.
pub(super) const EXPONENTIAL: &str = include_str!("../../shaders/shared/exponential.wgsl");
/// Double precision in integers.
pub(super) const F64_ARITHMETIC: &str = include_str!("../../shaders/shared/f64.wgsl");
/// Positions in a transfer function's table.
pub(super) const TRANSFER: &str = include_str!("../../shaders/shared/transfer.wgsl");
/// Averages over intervals of values.
pub(super) const AVERAGES: &str = include_str!("../../shaders/shared/averages.wgsl");
/// Classification of kernels over their extents.
pub(super) const LOBES: &str = include_str!("../../shaders/shared/lobes.wgsl");
/// Maxima over intervals of values.
pub(super) const MAXIMA: &str = include_str!("../../shaders/shared/maxima.wgsl");
/// The exponential integral.
pub(super) const EIN: &str = include_str!("../../shaders/shared/ein.wgsl");
/// Prefix sums over the threads of a workgroup.
pub(super) const SCAN_THREADS: &str = include_str!("../../shaders/shared/scan_threads.wgsl");
/// Behaviour of f32 beyond the guarantees of WGSL.
pub(super) const FLOATS: &str = include_str!("../../shaders/shared/floats.wgsl");
/// Kernels' factors.
pub(super) const FACTOR: &str = include_str!("../../shaders/shared/factor.wgsl");
/// Conversion between linear light and sRGB codes.
pub(super) const SRGB: &str = include_str!("../../shaders/shared/srgb.wgsl");
/// Transmittance to a light.
pub(super) const SHADOW: &str = include_str!("../../shaders/shared/shadow.wgsl");
/// Lighting of a colour.
pub(super) const LIT: &str = include_str!("../../shaders/shared/lit.wgsl");

/// Positions and shapes of each kind of particles, in the order of [`ParticleKind`](super::kinds::ParticleKind).
pub(super) const PARTICLES: [&str; 4] = [
    include_str!("../../shaders/shared/particles_lattice.wgsl"),
    include_str!("../../shaders/shared/particles_isotropic.wgsl"),
    include_str!("../../shaders/shared/particles_anisotropic.wgsl"),
    include_str!("../../shaders/shared/particles_surfels.wgsl"),
];

/// Shaders of a stage over particles, one for each `ParticleKind` in its order. Each consists of the
/// common files, that kind's positions and shapes, and the stage's own files.
macro_rules! shaders_of_particles {
    ($stage:literal, $($file:expr),+ $(,)?) => {{
        use $crate::gpu::shader::{DISPATCH, FACTOR, FLOATS, PARTICLES, STRUCTS, Shader};
        [
            Shader::new(
                concat!($stage, " of lattices"),
                &[DISPATCH, STRUCTS, FLOATS, FACTOR, PARTICLES[0], $($file),+],
            ),
            Shader::new(
                concat!($stage, " of spheres"),
                &[DISPATCH, STRUCTS, FLOATS, FACTOR, PARTICLES[1], $($file),+],
            ),
            Shader::new(
                concat!($stage, " of ellipsoids"),
                &[DISPATCH, STRUCTS, FLOATS, FACTOR, PARTICLES[2], $($file),+],
            ),
            Shader::new(
                concat!($stage, " of surfels"),
                &[DISPATCH, STRUCTS, FLOATS, FACTOR, PARTICLES[3], $($file),+],
            ),
        ]
    }};
}
pub(super) use shaders_of_particles;

/// Returns the numbers that both back ends share, as WGSL constants.
pub fn prelude() -> String {
    let mut text = String::new();
    let integers = [
        ("MAX_GROUPS", MAX_GROUPS),
        ("THREADS", THREADS),
        ("SCAN_RUN", SCAN_RUN),
        ("TILE_SIZE", TILE_SIZE as u32),
        ("MAX_LIGHTS", MAX_LIGHTS as u32),
        ("SHADOW_DIRECTIONS", SHADOW_DIRECTIONS as u32),
        ("BRICK_X", BRICK[0] as u32),
        ("BRICK_Y", BRICK[1] as u32),
        ("BRICK_Z", BRICK[2] as u32),
        ("DEPTH_KEY_BITS", DEPTH_KEY_BITS),
        ("TERMINATION_INTERVAL", TERMINATION_INTERVAL as u32),
        ("RADIX_BITS", RADIX_BITS),
        ("RADIX_TILE", RADIX_TILE as u32),
        ("RADIX_SCANNED", RADIX_SCANNED),
        ("RADIX_GROUPS", RADIX_GROUPS as u32),
        ("CLASSIFICATION_TABLE_LEN", CLASSIFICATION_TABLE_LEN as u32),
        ("TABLE_LEVELS", CLASSIFICATION_TABLE_LEN.ilog2() + 1),
        ("VALUES_NONE", ValueKind::None as u32),
        ("VALUES_U8", ValueKind::U8 as u32),
        ("VALUES_U16", ValueKind::U16 as u32),
        ("VALUES_I16", ValueKind::I16 as u32),
        ("VALUES_SPREAD", ValueKind::Spread as u32),
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
        ("PATH_CAPPED", PATH_CAPPED),
        ("PATH_EXACT", PATH_EXACT),
        ("PATH_NEAR", PATH_NEAR),
        ("PATH_HALF_LINE", PATH_HALF_LINE),
        ("PATH_SURFEL", PATH_SURFEL),
        ("RAY_EDGES", RAY_EDGES),
        ("PATH_NEAR_SURFEL", PATH_NEAR_SURFEL),
        ("KEYS_OF_DISTANCE", KeyKind::Distance as u32),
        ("KEYS_OF_DEPTH", KeyKind::Depth as u32),
        ("KEYS_OF_LAYERS", KeyKind::Layers as u32),
        ("RULE_KERNEL", RULE_KERNEL),
        ("RULE_PEAK", RULE_PEAK),
        ("SPLAT_EXACT", SplatRule::Exact as u32),
        ("SPLAT_KHR", SplatRule::Khr as u32),
        ("SPLAT_INRIA", SplatRule::Inria as u32),
        ("SPLAT_MIP", SplatRule::Mip as u32),
        ("RULE_SURFACE", RULE_SURFACE),
        ("RULE_TRANSLUCENT", RULE_TRANSLUCENT),
        ("SURFACE_LAYERS", SURFACE_LAYERS as u32),
        ("MAX_CLIP_PLANES", MAX_CLIP_PLANES as u32),
        ("MOST_EDGES", MOST_EDGES as u32),
        ("INFINITE_WORD", f32::INFINITY.to_bits()),
        ("MAX_PLANES", MAX_PLANES as u32),
        ("NO_LAYER", NO_LAYER),
        ("MERGED_OPEN", MERGED_OPEN),
        ("MERGED_UNSEEN", MERGED_UNSEEN),
        ("MERGED_FITS", MERGED_FITS),
        ("BY_VALUE", ClassifiedBy::Value as u32),
        ("BY_EXTENT", ClassifiedBy::Extent as u32),
        ("BY_NEIGHBOURS", ClassifiedBy::Neighbours as u32),
        ("FILTER_COUNT", Filter::ALL.len() as u32),
        ("MAX_LOBES", MAX_LOBES as u32),
        ("MAX_WINDOWS", MAX_WINDOWS as u32),
        ("MAX_LOBE_ROWS", MAX_LOBE_ROWS as u32),
        ("DIRECTION_BITS", DIRECTION_BITS),
        ("DIRECTION_STEPS", DIRECTION_STEPS),
        ("SLOPE_BITS", SLOPE_BITS),
        ("SLOPE_STEPS_PER_OCTAVE", SLOPE_STEPS_PER_OCTAVE),
        ("DEPARTURE_BITS", DEPARTURE_BITS),
        ("DEPARTURE_STEPS_PER_OCTAVE", DEPARTURE_STEPS_PER_OCTAVE),
        ("RANGE_BITS", RANGE_BITS),
        ("PROFILE_CELLS", PROFILE_CELLS as u32),
    ];
    for (name, value) in integers {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    for filter in Filter::ALL {
        let name = filter.name().to_uppercase().replace('-', "_");
        let _ = writeln!(text, "const FILTER_{name}: u32 = {}u;", filter as u32);
    }
    let floats = [
        ("MAX_CUTOFF", MAX_CUTOFF),
        ("NEAR_MARGIN", NEAR_MARGIN),
        ("PIECE_REACH", PIECE_REACH),
        ("THICKEST_SLAB", THICKEST_SLAB),
        ("LOBE_REACH", LOBE_REACH),
        ("MAX_PIECE_WIDTH", MAX_PIECE_WIDTH),
        ("LOBE_ROWS_PER_OCTAVE", LOBE_ROWS_PER_OCTAVE),
        ("LOBE_CELLS_PER_DEVIATION", LOBE_CELLS_PER_DEVIATION),
        ("RANGE_STEPS", RANGE_STEPS),
        ("TERMINATION_SHARE", TERMINATION_SHARE),
        ("FAINT", FAINT),
        ("COVERAGE_FULL", COVERAGE_FULL),
        ("CDF_REACH", CDF_REACH),
        ("CDF_WHOLE", CDF_WHOLE),
        ("BAND_REACH", BAND_REACH),
        ("PIXEL_VARIANCE_PX2", PIXEL_VARIANCE_PX2),
        ("SAMPLED_FROM_PX2", SAMPLED_FROM_PX2),
        ("LEAST_MEAN_SIGMA_PX", LEAST_MEAN_SIGMA_PX),
        ("CLIP_SOFTNESS", CLIP_SOFTNESS),
        ("EDGE_REACH", EDGE_REACH),
        ("LEAST_SPREAD", LEAST_SPREAD),
        ("SLACK_SIGMAS", SLACK_SIGMAS),
        ("SLACK_PIXELS", SLACK_PIXELS),
        ("SLACK_SLOPE", SLACK_SLOPE),
        ("GRAZING", GRAZING),
        ("PERSPECTIVE_FROM", PERSPECTIVE_FROM),
        ("NORMAL_STEPS", NORMAL_STEPS),
        ("NO_DEPTH", NO_DEPTH),
        ("SMALLEST", f32::MIN_POSITIVE),
        ("LARGEST", f32::MAX),
        ("LN_2", std::f32::consts::LN_2),
        ("LOG2_E", std::f32::consts::LOG2_E),
        ("FRAC_1_SQRT_2", std::f32::consts::FRAC_1_SQRT_2),
        ("FRAC_1_SQRT_2PI", FRAC_1_SQRT_2PI),
        ("LEAST_SLOPE", LEAST_SLOPE),
        ("SPLAT_LOW_PASS_PX2", SPLAT_LOW_PASS_PX2),
        ("ANTI_ALIASED_LOW_PASS_PX2", ANTI_ALIASED_LOW_PASS_PX2),
        ("SPLAT_FLOOR", SPLAT_FLOOR),
        ("SPLAT_CEILING", SPLAT_CEILING),
        ("SPLAT_CUTOFF", SPLAT_CUTOFF),
        ("JACOBIAN_MARGIN", JACOBIAN_MARGIN),
        ("FAR_ENTRIES", FAR_ENTRIES),
        ("MAXIMUM_ROUNDING", MAXIMUM_ROUNDING),
        ("CUTOFF_SHARE", CUTOFF_SHARE),
        ("OVERLAP", OVERLAP),
        ("MEETING", MEETING),
        ("GREATEST_ENLARGEMENT", GREATEST_ENLARGEMENT),
        ("AFFINE_SHARE", AFFINE_SHARE),
        ("FILTER_SHARE", FILTER_SHARE),
        ("MERGE_SHARE", MERGE_SHARE),
        ("MERGE_THIRD", MERGE_THIRD),
        ("MERGE_FOURTH", MERGE_FOURTH),
        ("CONTRAST_SHARE", CONTRAST_SHARE),
        ("MISREAD_SHARE", MISREAD_SHARE),
        ("MIXED_SHARE", MIXED_SHARE),
        ("MANY_SHARE", MANY_SHARE),
        ("TREND", TREND),
        ("SUB_PIXEL_SPLIT", SUB_PIXEL_SPLIT),
        ("SUB_PIXEL_REACH", SUB_PIXEL_REACH),
        ("SUB_PIXEL_FAINT", SUB_PIXEL_FAINT),
        ("SUB_PIXEL_LARGE", SUB_PIXEL_LARGE),
        ("EIN_SPLIT", EIN_SPLIT),
        ("EULER", EULER),
        ("TAU", std::f32::consts::TAU),
        ("HARMONIC_0", HARMONIC_0),
        ("HARMONIC_1", HARMONIC_1),
        ("SRGB_LINEAR_END", SRGB_LINEAR_END),
        ("LEAST_DRAWN_PX", LEAST_DRAWN_PX),
        ("SHORT_SIDE", SHORT_SIDE),
        ("MOST_ROWS", MOST_ROWS as f32),
        ("SIDE_PLACE", SIDE_PLACE),
        ("ROWS_PER_SHEAR", ROWS_PER_SHEAR),
        ("STEEPEST_SHADOW", STEEPEST_SHADOW),
        ("GREATEST_LEAN", GREATEST_LEAN),
        ("SRGB_SLOPE", SRGB_SLOPE),
        ("SRGB_SCALE", SRGB_SCALE),
        ("SRGB_OFFSET", SRGB_OFFSET),
        ("SRGB_GAMMA", SRGB_GAMMA),
    ];
    for (name, value) in floats {
        // All digits: the shortest decimal that rounds to the greatest f32 lies beyond it, which WGSL refuses.
        let value = f64::from(value);
        let _ = writeln!(text, "const {name}: f32 = {value:?};");
    }
    let lists = [
        ("EXP2_SERIES", EXP2_SERIES.as_slice()),
        ("CDF_SERIES", CDF_SERIES.as_slice()),
        ("BAND_NODES", BAND_NODES.as_flattened()),
        ("REACHES", REACHES.as_slice()),
        ("ERFC_SERIES", ERFC_SERIES.as_slice()),
        ("EIN_SERIES", EIN_SERIES.as_slice()),
        ("E1_NUMERATOR", E1_NUMERATOR.as_slice()),
        ("E1_DENOMINATOR", E1_DENOMINATOR.as_slice()),
        ("SUB_PIXEL_NODES", SUB_PIXEL_NODES.as_slice()),
        ("SUB_PIXEL_LOGS", SUB_PIXEL_LOGS.as_slice()),
        ("SUB_PIXEL_WEIGHTS", SUB_PIXEL_WEIGHTS.as_slice()),
        ("SUB_PIXEL_OPAQUE", SUB_PIXEL_OPAQUE.as_slice()),
        ("SHADOW_TAPS", SHADOW_TAPS.as_flattened()),
        ("HARMONICS_2", HARMONICS_2.as_slice()),
        ("HARMONICS_3", HARMONICS_3.as_slice()),
    ];
    for (name, values) in lists {
        let (count, values) = (values.len(), format!("{values:?}"));
        let values = values.trim_matches(['[', ']']);
        let kind = format!("array<f32, {count}>");
        let _ = writeln!(text, "const {name}: {kind} = {kind}({values});");
    }
    let colours = CHOICE_COLOURS.map(|[r, g, b]| format!("array<f32, 3>({r:?}, {g:?}, {b:?})"));
    let kind = format!("array<array<f32, 3>, {}>", colours.len());
    let colours = colours.join(", ");
    let _ = writeln!(text, "const CHOICE_COLOURS: {kind} = {kind}({colours});");
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
