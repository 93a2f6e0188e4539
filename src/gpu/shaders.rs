//! Shaders: each is the prelude, files of `shaders/shared/` and a stage's own file, one after the
//! other.

use std::fmt::Write as _;

use super::kernel::{MAX_GROUPS, THREADS};
use super::project::{RULE_KERNEL, RULE_PANE, RULE_PEAK, RULE_SURFACE};
use super::radix;
use super::scan::SCAN_RUN;
use super::scene::{ColourKind, PARTICLE_ARGUMENTS, StrengthKind, VIEW_ARGUMENTS, ValueKind};
use super::tile::{NO_DEPTH, NO_LAYER};
use crate::blocks::DEPTH_KEY_SPAN;
use crate::constants::{
    BRICK, CLIP_SOFTNESS, COVERAGE_FULL, DEPTH_KEY_BITS, EXP2_SERIES, FAINT, FRAC_1_SQRT_2PI,
    LEAST_SLOPE, MAX_CLIP_PLANES, MAX_CUTOFF, MAX_LIGHTS, MAX_PLANES, NEAR_MARGIN, SURFACE_LAYERS,
    TERMINATION_INTERVAL, TERMINATION_SHARE, TILE_SIZE,
};
use crate::layout::{
    MERGED_FITS, MERGED_OPEN, MERGED_UNSEEN, PATH_AFFINE, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR,
    PATH_NEAR_SURFEL, PATH_PEAK, PATH_SURFEL,
};
use crate::math::{
    E1_DENOMINATOR, E1_NUMERATOR, EIN_SERIES, EIN_SPLIT, ERFC_SERIES, EULER, HARMONIC_0,
    HARMONIC_1, HARMONICS_2, HARMONICS_3, NORMAL_STEPS,
};
use crate::scene::{CLASSIFICATION_TABLE_LEN, FAR_ENTRIES, MAXIMUM_ROUNDING};
use crate::splat::budget::{
    AFFINE_SHARE, CONTRAST_SHARE, CUTOFF_SHARE, FILTER_SHARE, GREATEST_PILE, MANY_SHARE,
    MERGE_FOURTH, MERGE_SHARE, MERGE_THIRD, MIXED_SHARE, OVERLAP, TREND,
};
use crate::splat::{
    ANTI_ALIASED_LOW_PASS_PX2, CHOICE_COLOURS, Composite, Filter, GRAZING, JACOBIAN_MARGIN,
    PERSPECTIVE_FROM, SLACK_PIXELS, SLACK_SIGMAS, SLACK_SLOPE, SPLAT_LOW_PASS_PX2, SUB_PIXEL_FAINT,
    SUB_PIXEL_LARGE, SUB_PIXEL_LOGS, SUB_PIXEL_NODES, SUB_PIXEL_OPAQUE, SUB_PIXEL_REACH,
    SUB_PIXEL_SPLIT, SUB_PIXEL_WEIGHTS,
};

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
    pub const ALL: &'static [Self] = &[
        LAYOUT,
        F64,
        MERGED,
        SCAN,
        CULL,
        CLASSIFY,
        SHADE,
        LIGHT_LATTICE,
        LIGHT_ISOTROPIC,
        LIGHT_ANISOTROPIC,
        LIGHT_SURFELS,
        PROJECT_LATTICE,
        PROJECT_ISOTROPIC,
        PROJECT_ANISOTROPIC,
        PROJECT_SURFELS,
        RADIX,
        SORT,
        GATHER,
        BIN,
        RASTERISE[0].1,
        RASTERISE[1].1,
        RASTERISE[2].1,
        RASTERISE[3].1,
        RASTERISE[4].1,
        RASTERISE_CLASSIFIED[0],
        RASTERISE_CLASSIFIED[1],
        RASTERISE_CLASSIFIED[2],
        RASTERISE_CLASSIFIED[3],
        COMPOSE,
        SURFACE,
        RESOLVE,
    ];
}

const STRUCTS: &str = include_str!("../../shaders/shared/layout.wgsl");
const DISPATCH: &str = include_str!("../../shaders/shared/dispatch.wgsl");

/// Unit vectors in a word.
const NORMAL: &str = include_str!("../../shaders/shared/normal.wgsl");
/// The plane of two tangents.
const TANGENTS: &str = include_str!("../../shaders/shared/tangents.wgsl");
/// A tile's pixels and its progress.
const TILE: &str = include_str!("../../shaders/shared/tile.wgsl");

const EXPONENTIAL: &str = include_str!("../../shaders/shared/exponential.wgsl");

/// The structs of [`crate::layout`] alone.
const LAYOUT: Shader = Shader {
    name: "layout",
    parts: &[STRUCTS],
};

macro_rules! rasterise {
    ($name:expr, $slots:literal, $slope_slots:literal, $classify:expr) => {
        Shader {
            name: $name,
            parts: &[
                concat!("const LAYER_SLOTS: u32 = ", $slots, "u;\n"),
                concat!("const SLOPE_SLOTS: u32 = ", $slope_slots, "u;\n"),
                DISPATCH,
                STRUCTS,
                EXPONENTIAL,
                TRANSFER,
                TILE,
                FLOATS,
                NORMAL,
                $classify,
                include_str!("../../shaders/shared/clip.wgsl"),
                include_str!("../../shaders/rasterise.wgsl"),
            ],
        }
    };
    ($name:expr, $slots:literal) => {
        rasterise!(
            $name,
            $slots,
            1,
            include_str!("../../shaders/shared/unclassified.wgsl")
        )
    };
}

/// Tiles of pixels: by how many layers a pixel keeps open at most.
pub(super) const RASTERISE: [(u32, Shader); 5] = [
    (1, rasterise!("rasterise", 1)),
    (16, rasterise!("rasterise in 16 layers", 16)),
    (32, rasterise!("rasterise in 32 layers", 32)),
    (64, rasterise!("rasterise in 64 layers", 64)),
    (256, rasterise!("rasterise in 256 layers", 256)),
];

macro_rules! rasterise_classified {
    ($slots:literal) => {
        rasterise!(
            concat!("rasterise in ", $slots, " classified layers"),
            $slots,
            $slots,
            concat!(
                include_str!("../../shaders/shared/lit.wgsl"),
                include_str!("../../shaders/shared/classified.wgsl")
            )
        )
    };
}

/// The same of layers that are classified, from 16 on.
pub(super) const RASTERISE_CLASSIFIED: [Shader; 4] = [
    rasterise_classified!(16),
    rasterise_classified!(32),
    rasterise_classified!(64),
    rasterise_classified!(256),
];

/// Surfaces behind what lies in front of them.
pub(super) const COMPOSE: Shader = Shader {
    name: "compose",
    parts: &[DISPATCH, include_str!("../../shaders/compose.wgsl")],
};

/// Tiles of opaque surfaces.
pub(super) const SURFACE: Shader = Shader {
    name: "surface",
    parts: &[
        DISPATCH,
        STRUCTS,
        EXPONENTIAL,
        TILE,
        include_str!("../../shaders/shared/clip.wgsl"),
        NORMAL,
        include_str!("../../shaders/surface.wgsl"),
    ],
};

/// The background.
pub(super) const RESOLVE: Shader = Shader {
    name: "resolve",
    parts: &[DISPATCH, include_str!("../../shaders/resolve.wgsl")],
};

const F64_ARITHMETIC: &str = include_str!("../../shaders/shared/f64.wgsl");

const TRANSFER: &str = include_str!("../../shaders/shared/transfer.wgsl");
const AVERAGES: &str = include_str!("../../shaders/shared/averages.wgsl");
const MAXIMA: &str = include_str!("../../shaders/shared/maxima.wgsl");
const EIN: &str = include_str!("../../shaders/shared/ein.wgsl");

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

/// The sort of pairs that sort and bin need.
pub(super) const RADIX: Shader = Shader {
    name: "radix",
    parts: &[
        DISPATCH,
        SCAN_THREADS,
        include_str!("../../shaders/radix.wgsl"),
    ],
};

/// Keys of footprints.
pub(super) const SORT: Shader = Shader {
    name: "sort",
    parts: &[STRUCTS, DISPATCH, include_str!("../../shaders/sort.wgsl")],
};

/// Footprints in depth order.
pub(super) const GATHER: Shader = Shader {
    name: "gather",
    parts: &[STRUCTS, DISPATCH, include_str!("../../shaders/gather.wgsl")],
};

/// Tiles that footprints touch.
pub(super) const BIN: Shader = Shader {
    name: "bin",
    parts: &[STRUCTS, DISPATCH, include_str!("../../shaders/bin.wgsl")],
};
const FLOATS: &str = include_str!("../../shaders/shared/floats.wgsl");
const FACTOR: &str = include_str!("../../shaders/shared/factor.wgsl");

/// Positions and shapes of a lattice's cells.
pub(super) const PARTICLES_LATTICE: &str =
    include_str!("../../shaders/shared/particles_lattice.wgsl");
/// Positions and shapes of spheres.
pub(super) const PARTICLES_ISOTROPIC: &str =
    include_str!("../../shaders/shared/particles_isotropic.wgsl");
/// Positions and shapes of ellipsoids.
pub(super) const PARTICLES_ANISOTROPIC: &str =
    include_str!("../../shaders/shared/particles_anisotropic.wgsl");
/// Positions and tangents of surfels.
pub(super) const PARTICLES_SURFELS: &str =
    include_str!("../../shaders/shared/particles_surfels.wgsl");

/// The projection of one kind of particle.
const fn project(name: &'static str, parts: &'static [&'static str]) -> Shader {
    Shader { name, parts }
}

macro_rules! project_parts {
    ($particles:ident) => {
        &[
            DISPATCH,
            STRUCTS,
            FLOATS,
            FACTOR,
            $particles,
            include_str!("../../shaders/shared/footprint.wgsl"),
            include_str!("../../shaders/shared/sub_pixel.wgsl"),
            include_str!("../../shaders/shared/exact.wgsl"),
            include_str!("../../shaders/shared/bounds.wgsl"),
            include_str!("../../shaders/shared/filter.wgsl"),
            include_str!("../../shaders/shared/cutoff.wgsl"),
            include_str!("../../shaders/shared/peak.wgsl"),
            include_str!("../../shaders/shared/near.wgsl"),
            NORMAL,
            TANGENTS,
            include_str!("../../shaders/shared/surfel.wgsl"),
            include_str!("../../shaders/project.wgsl"),
        ]
    };
}

/// Footprints of a lattice's cells.
pub(super) const PROJECT_LATTICE: Shader =
    project("project of a lattice", project_parts!(PARTICLES_LATTICE));
/// Footprints of spheres.
pub(super) const PROJECT_ISOTROPIC: Shader =
    project("project of spheres", project_parts!(PARTICLES_ISOTROPIC));
/// Footprints of ellipsoids.
pub(super) const PROJECT_ANISOTROPIC: Shader = project(
    "project of ellipsoids",
    project_parts!(PARTICLES_ANISOTROPIC),
);
/// Footprints of surfels.
pub(super) const PROJECT_SURFELS: Shader =
    project("project of surfels", project_parts!(PARTICLES_SURFELS));
/// Double precision in integers, for its test.
pub(super) const F64: Shader = Shader {
    name: "f64",
    parts: &[
        DISPATCH,
        F64_ARITHMETIC,
        include_str!("../../shaders/f64.wgsl"),
    ],
};

/// Functions of numbers that merged particles need, for their test.
pub(super) const MERGED: Shader = Shader {
    name: "merged",
    parts: &[
        DISPATCH,
        STRUCTS,
        EXPONENTIAL,
        TRANSFER,
        AVERAGES,
        MAXIMA,
        EIN,
        include_str!("../../shaders/merged.wgsl"),
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
        FLOATS,
        TRANSFER,
        MAXIMA,
        include_str!("../../shaders/shared/choose.wgsl"),
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
        EXPONENTIAL,
        TRANSFER,
        AVERAGES,
        EIN,
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

macro_rules! light_parts {
    ($particles:ident) => {
        &[
            DISPATCH,
            STRUCTS,
            FLOATS,
            FACTOR,
            $particles,
            NORMAL,
            TANGENTS,
            include_str!("../../shaders/shared/lit.wgsl"),
            include_str!("../../shaders/light.wgsl"),
        ]
    };
}

/// Light on particles of one kind.
const fn light(name: &'static str, parts: &'static [&'static str]) -> Shader {
    Shader { name, parts }
}

/// Light on a lattice's cells.
pub(super) const LIGHT_LATTICE: Shader =
    light("light on a lattice", light_parts!(PARTICLES_LATTICE));
/// Light on spheres.
pub(super) const LIGHT_ISOTROPIC: Shader =
    light("light on spheres", light_parts!(PARTICLES_ISOTROPIC));
/// Light on ellipsoids.
pub(super) const LIGHT_ANISOTROPIC: Shader =
    light("light on ellipsoids", light_parts!(PARTICLES_ANISOTROPIC));
/// Light on surfels.
pub(super) const LIGHT_SURFELS: Shader = light("light on surfels", light_parts!(PARTICLES_SURFELS));

/// The numbers that both back ends share, as WGSL constants.
pub fn prelude() -> String {
    let mut text = String::new();
    let integers = [
        ("MAX_GROUPS", MAX_GROUPS),
        ("THREADS", THREADS),
        ("SCAN_RUN", SCAN_RUN),
        ("TILE_SIZE", TILE_SIZE as u32),
        ("MAX_LIGHTS", MAX_LIGHTS as u32),
        ("BRICK_X", BRICK[0] as u32),
        ("BRICK_Y", BRICK[1] as u32),
        ("BRICK_Z", BRICK[2] as u32),
        ("DEPTH_KEY_BITS", DEPTH_KEY_BITS),
        ("TERMINATION_INTERVAL", TERMINATION_INTERVAL as u32),
        ("RADIX_BITS", radix::BITS),
        ("RADIX_GROUP", radix::GROUP as u32),
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
        ("PATH_EXACT", PATH_EXACT),
        ("PATH_NEAR", PATH_NEAR),
        ("PATH_HALF_LINE", PATH_HALF_LINE),
        ("PATH_SURFEL", PATH_SURFEL),
        ("PATH_NEAR_SURFEL", PATH_NEAR_SURFEL),
        ("RULE_KERNEL", RULE_KERNEL),
        ("RULE_PEAK", RULE_PEAK),
        ("RULE_SURFACE", RULE_SURFACE),
        ("RULE_PANE", RULE_PANE),
        ("SURFACE_LAYERS", SURFACE_LAYERS as u32),
        ("MAX_CLIP_PLANES", MAX_CLIP_PLANES as u32),
        ("MAX_PLANES", MAX_PLANES as u32),
        ("COMPOSITE_OVER", Composite::Over as u32),
        ("COMPOSITE_SLABS", Composite::Slabs as u32),
        ("NO_LAYER", NO_LAYER),
        ("MERGED_OPEN", MERGED_OPEN),
        ("MERGED_UNSEEN", MERGED_UNSEEN),
        ("MERGED_FITS", MERGED_FITS),
        ("FILTER_COUNT", Filter::ALL.len() as u32),
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
        ("TERMINATION_SHARE", TERMINATION_SHARE),
        ("FAINT", FAINT),
        ("COVERAGE_FULL", COVERAGE_FULL),
        ("CLIP_SOFTNESS", CLIP_SOFTNESS),
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
        ("JACOBIAN_MARGIN", JACOBIAN_MARGIN),
        ("FAR_ENTRIES", FAR_ENTRIES),
        ("MAXIMUM_ROUNDING", MAXIMUM_ROUNDING),
        ("CUTOFF_SHARE", CUTOFF_SHARE),
        ("OVERLAP", OVERLAP),
        ("GREATEST_PILE", GREATEST_PILE),
        ("AFFINE_SHARE", AFFINE_SHARE),
        ("FILTER_SHARE", FILTER_SHARE),
        ("MERGE_SHARE", MERGE_SHARE),
        ("MERGE_THIRD", MERGE_THIRD),
        ("MERGE_FOURTH", MERGE_FOURTH),
        ("CONTRAST_SHARE", CONTRAST_SHARE),
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
    ];
    for (name, value) in floats {
        let _ = writeln!(text, "const {name}: f32 = {value:?};");
    }
    let lists = [
        ("EXP2_SERIES", EXP2_SERIES.as_slice()),
        ("ERFC_SERIES", ERFC_SERIES.as_slice()),
        ("EIN_SERIES", EIN_SERIES.as_slice()),
        ("E1_NUMERATOR", E1_NUMERATOR.as_slice()),
        ("E1_DENOMINATOR", E1_DENOMINATOR.as_slice()),
        ("SUB_PIXEL_NODES", SUB_PIXEL_NODES.as_slice()),
        ("SUB_PIXEL_LOGS", SUB_PIXEL_LOGS.as_slice()),
        ("SUB_PIXEL_WEIGHTS", SUB_PIXEL_WEIGHTS.as_slice()),
        ("SUB_PIXEL_OPAQUE", SUB_PIXEL_OPAQUE.as_slice()),
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

/// The words of a number of f64, the low one first.
pub(super) fn words(x: f64) -> [u32; 2] {
    let bits = x.to_bits();
    [bits as u32, (bits >> 32) as u32]
}
