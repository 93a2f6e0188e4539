//! Refuses options that apply to none of the inputs: a wrong picture without an error would be
//! worse.

use crate::load::{Kind, Loaded, Members};
use crate::sample::{SampleOptions, TransferChoice};
use crate::scene::{PointVolume, Strength};
use crate::{Error, Result};

use super::input::{BoundaryName, DataOptions, Shape};

/// Returns the name of the first option that is given.
pub(crate) fn first_given<const N: usize>(
    options: [(&'static str, bool); N],
) -> Option<&'static str> {
    let mut options = options.into_iter();
    options.find_map(|(name, is_given)| is_given.then_some(name))
}

/// Properties of the inputs that determine which options apply.
pub(crate) struct Uses {
    pub(crate) kinds: Vec<Kind>,
    /// True if a transfer function shows any input.
    pub(crate) is_classified: bool,
    /// True if a transfer function gives the opacity of any input.
    pub(crate) has_opacity: bool,
    /// True if a transfer function comes from a file.
    pub(crate) has_file_function: bool,
    /// True if column densities were asked for.
    pub(crate) for_columns: bool,
    /// For prepared scenes alone: whether a transfer function shows any of them.
    pub(crate) of_prepared: Option<bool>,
}

impl Uses {
    /// Collects the properties of the inputs of a scene.
    ///
    /// - `options`: options by which the scene was sampled.
    pub(crate) fn of(scene: &Loaded, options: &SampleOptions) -> Self {
        let inputs = || scene.inputs.iter().filter(|input| !input.is_nothing);
        let is_prepared = scene.inputs.is_empty() && !scene.prepared.is_empty();
        Self {
            kinds: inputs().map(|input| input.kind).collect(),
            is_classified: inputs().any(|input| input.is_classified),
            has_opacity: inputs().any(|input| input.has_opacity),
            has_file_function: inputs().any(|input| input.has_given_function()),
            for_columns: options.purpose.for_columns,
            of_prepared: is_prepared.then(|| {
                let scenes = scene.prepared.iter();
                scenes
                    .flat_map(|(_, scene)| scene.requirements())
                    .any(|r| r.classification)
            }),
        }
    }
}

/// Option, whether it is given, whether anything uses it, and what would use it.
pub(crate) type Row = (&'static str, bool, bool, &'static str);

/// Refuses options that are given but not used.
///
/// # Errors
/// The first such option.
pub(crate) fn refuse_unused(options: &[Row]) -> Result<()> {
    let unused = |row: &&Row| row.1 && !row.2;
    match options.iter().find(unused) {
        None => Ok(()),
        Some((option, _, _, expected)) => Err(Error::invalid(
            *option,
            "inputs",
            *expected,
            "none",
            "leave it out",
        )),
    }
}

/// Data that options of transfer functions apply to.
pub(crate) const CLASSIFIED: &str = "data that a transfer function shows";

impl DataOptions {
    /// Refuses options that apply to none of the inputs.
    ///
    /// # Errors
    /// The first such option.
    pub(crate) fn check_use(&self, uses: &Uses) -> Result<()> {
        let any = |is: fn(Kind) -> bool| uses.kinds.iter().any(|kind| is(*kind));
        let (grids, points) = (any(Kind::is_grid), any(|k| k == Kind::Points));
        let (raw, meshes) = (any(|k| k == Kind::Raw), any(|k| k == Kind::Mesh));
        let splats = any(|k| k == Kind::Splats);
        let plot3d = any(|k| k == Kind::Plot3d);
        let has_fields = any(|k| k != Kind::Mesh) || uses.is_classified;
        let columns = uses.for_columns;
        let (is_iso, is_boundary) = (self.flatten.is_some(), self.is_boundary_alone());
        let is_surface = is_iso || is_boundary;
        let is_around = self.surface_opacity.is_some();
        let has_surfels = meshes || is_boundary || is_around;
        let is_classified = uses.is_classified || is_iso;
        // For column densities, these options colour the picture.
        let is_coloured = is_classified || columns;
        let is_sharp = matches!(self.boundary, Some(BoundaryName::Sharp));
        let has_boundary = !(is_sharp && (is_surface || self.shepard > 0 || columns));
        let is_scaled = (self.opacity_scale - 1.0).abs() > 0.0;
        let is_shaped = !matches!(self.shape, Shape::Auto);
        // Automatic functions have the optical depth that they are chosen for, whatever the unit
        // length.
        let has_unit = !columns && (uses.has_file_function || (points && !is_classified));
        let mesh_or_raw = "a mesh or a raw volume";
        let function = self.transfer_function.is_some();
        let is_file = matches!(
            self.sample_options().function.transfer,
            TransferChoice::File(_)
        );
        let is_data = uses.of_prepared.is_none();
        let data = "data that are no prepared scene, which has its kernels";
        let volume = "a volume (--surface alone draws its boundary, opaque)";
        refuse_unused(&[
            ("--kernel-width", self.kernel_width.is_some(), is_data, data),
            ("--as", self.read_as.is_some(), is_data, data),
            ("--scales", self.scales.is_some(), is_data, data),
            ("--splat-rule", self.splat_rule.is_some(), is_data, data),
            ("--isosurface", is_iso, is_data, data),
            ("--surface", self.surface, grids, "a grid"),
            ("--surface-opacity", is_around, grids, "a grid"),
            ("--type", self.has_types(), is_data, data),
            (
                "--field",
                self.field.is_some(),
                has_fields,
                "data with fields",
            ),
            ("--dims", self.dims.is_some(), raw, "a raw volume"),
            (
                "--solution",
                self.solution.is_some(),
                plot3d,
                "a PLOT3D grid",
            ),
            ("--texture", self.texture.is_some(), meshes, "a mesh"),
            ("--density", self.density.is_some(), has_surfels, "a mesh"),
            ("--count", self.count.is_some(), has_surfels, "a mesh"),
            (
                "--spacing",
                self.spacing.is_some(),
                has_surfels || raw,
                mesh_or_raw,
            ),
            (
                "--transfer-function",
                function,
                is_coloured || (uses.of_prepared == Some(true) && is_file),
                CLASSIFIED,
            ),
            ("--range", self.range.is_some(), is_coloured, CLASSIFIED),
            ("--scale", self.scale.is_some(), is_coloured, CLASSIFIED),
            (
                "--opacity-scale",
                is_scaled,
                uses.has_opacity && !is_surface,
                "data whose opacity a transfer function gives",
            ),
            (
                "--unit-distance",
                self.unit_distance.is_some(),
                has_unit,
                "a transfer function's file, or particles without one (--opacity-scale is for automatic ones)",
            ),
            ("--boundary", self.boundary.is_some(), grids, "a grid"),
            ("--boundary", self.boundary.is_some(), !is_boundary, volume),
            (
                "--boundary sharp",
                is_sharp,
                has_boundary,
                "neither a surface nor columns nor --shepard, which end softly",
            ),
            (
                "--shepard",
                self.shepard > 0,
                grids || points,
                "a grid or particles",
            ),
            ("--shepard", self.shepard > 0, !is_boundary, volume),
            (
                "--unit-distance",
                self.unit_distance.is_some(),
                !is_boundary,
                volume,
            ),
            (
                "--splat-rule",
                self.splat_rule.is_some(),
                splats,
                "splats of a radiance field",
            ),
            ("--shape", is_shaped, points, "particles"),
            ("--length", self.length.is_some(), points, "particles"),
            ("--kernel", self.kernel.is_some(), points, "particles"),
            ("--radius", self.radius.is_some(), points, "particles"),
        ])
    }
}

/// Returns true if filters and rules of opacity apply to a volume: its kernels absorb light.
pub(crate) fn is_filtered(volume: &PointVolume) -> bool {
    matches!(
        volume.strength,
        Strength::Classified { .. } | Strength::Mass(_)
    )
}

/// Returns true if a volume is an opaque surface, which has its own drawing order.
pub(crate) fn is_surface(volume: &PointVolume) -> bool {
    matches!(volume.strength, Strength::Surface(_))
}

/// Refuses options that need the original data.
pub(crate) fn refuse_beside(prepared: &Members, asked: &[(&'static str, bool)]) -> Result<()> {
    if prepared.is_empty() {
        return Ok(());
    }
    match asked.iter().find(|(_, is_asked)| *is_asked) {
        None => Ok(()),
        Some((option, _)) => Err(Error::invalid(
            *option,
            "inputs",
            "the data themselves",
            "a prepared scene, which keeps its particles alone",
            "name the data, or leave it out",
        )),
    }
}
