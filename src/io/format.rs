//! Defines a format: how its files are recognised and read.

use std::path::Path;

use super::bytes::file::Input;
use super::bytes::probe::Probe;
use super::folder::of_folder;
use super::options::{OpenOptions, ReadAs};
use super::parts::plane_source::Find;
use super::splats::{gltf_splats, log_scales, splat_table};
use super::time_steps::{self, TimeStep};
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Hint, Parameter, Result};

/// A format that is read.
#[derive(Debug)]
pub struct Format {
    /// Name in lists.
    pub name: &'static str,
    /// Family of the format.
    pub family: Family,
    /// Extensions of its files, in lower case, without the leading dot: `vti`, `nii.gz`. Files with other names are
    /// recognised if their content identifies them.
    pub endings: &'static [&'static str],
    /// Features that are read, for people: Markdown.
    pub reads: &'static str,
    /// Returns true if the first bytes are those of this format and of no other.
    pub(super) begins: fn(&Probe<'_>) -> bool,
    /// Returns true if a path is no file but a pattern for several files of this format.
    pub(super) is_pattern: fn(&Path) -> bool,
    /// Returns true if the name is that of this format.
    pub(super) is_named: fn(&Probe<'_>) -> bool,
    /// True if files may begin with any bytes. Signatures of other formats are then ignored.
    pub(super) is_bare: bool,
    /// Returns true if the first bytes or the size may be those of this format.
    pub(super) resembles: fn(&Probe<'_>) -> bool,
    pub(super) read: fn(Input<'_>, &OpenOptions) -> Result<Dataset>,
    /// Reads the time steps of a file, and the files or places in the file that hold each.
    pub(super) steps: Option<Steps>,
    /// Finds the values of a file that can be read a few planes at a time.
    pub(super) planes: Option<Find>,
}

/// Reads the time steps of a file.
type Steps = fn(Input<'_>) -> Result<Vec<TimeStep>>;

impl Format {
    /// Returns the time steps of a file of this format in order, at least one: those of a collection, those in the
    /// file, or the file itself. Files that it names are not opened.
    ///
    /// # Errors
    /// The file cannot be read or breaks its format's rules.
    pub fn time_steps(&self, path: &Path) -> Result<Vec<TimeStep>> {
        let file = of_folder(path);
        let mut steps = self.steps_of(Input::of_file(&file))?;
        let parts = steps.iter_mut().flat_map(|step| &mut step.parts);
        // The steps name the path that the caller gave, not the file found in a folder.
        for part in parts.filter(|part| part.path == file) {
            part.path = path.to_path_buf();
        }
        Ok(steps)
    }

    /// Returns the time steps of a file on the disk or in memory: see [`Format::time_steps`].
    ///
    /// # Errors
    /// The errors of [`Format::time_steps`].
    pub(crate) fn steps_of(&self, input: Input<'_>) -> Result<Vec<TimeStep>> {
        match self.steps {
            Some(steps) => steps(input),
            None => Ok(time_steps::of_file(input.path, &[])),
        }
    }

    /// Reads a file of this format, with its scales and units settled.
    ///
    /// # Errors
    /// The errors of the reader; options that do not apply to the contents of the file.
    pub(super) fn open(&self, input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
        let mut data = (self.read)(input, options)?;
        let has_scales = data.format == gltf_splats::FORMAT
            || (options.read_as != Some(ReadAs::Points)
                && splat_table::settle(&mut data, options.scales)?)
            || log_scales::settle_table(&mut data, options.scales);
        if options.scales.is_some() && !has_scales {
            return Err(Error::format(
                input.path,
                Parameter::Scales,
                "splats of a glTF file, or a table with scale_0..2 and rot_0..3",
                data.format,
                Hint::LeaveOut(Parameter::Scales),
            ));
        }
        data.name_units();
        if options.particle_type.is_some() && data.particle_types.is_empty() {
            return Err(Error::format(
                input.path,
                Parameter::ParticleType,
                "a snapshot of particles of several types",
                data.format,
                Hint::LeaveOut(Parameter::ParticleType),
            ));
        }
        let (wanted, is_so) = match options.read_as {
            None => return Ok(data),
            Some(ReadAs::Points) => ("points", matches!(data.geometry, Geometry::Points { .. })),
            Some(ReadAs::Mesh) => ("a mesh", matches!(data.geometry, Geometry::Mesh(_))),
        };
        if is_so {
            return Ok(data);
        }
        let found = match data.geometry {
            Geometry::Lattice(_) | Geometry::Curvilinear { .. } => "a grid",
            Geometry::Cells(_) => "an unstructured grid",
            Geometry::Points { .. } => "points without faces",
            Geometry::Splats(_) => "splats",
            Geometry::Mesh(_) => "a mesh of a format that is read as nothing else",
        };
        Err(Error::format(
            input.path,
            "geometry",
            format!("what can be read as {wanted}"),
            found,
            Hint::LeaveOut(Parameter::ReadAs),
        ))
    }
}

/// Recognises the format of a file. Readers of files that name or hold others take it as an argument.
pub(super) type Recognise = fn(Input<'_>, &OpenOptions) -> Result<&'static Format>;

/// Kind of data that the files of a format hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Family {
    /// Grids of scientific data.
    Grids,
    /// Images from scanners and simulations: samples on a lattice.
    Volumes,
    /// Results of simulation codes.
    Simulations,
    /// Particles and tables of points.
    Particles,
    /// Point clouds from scanners.
    Clouds,
    /// Meshes.
    Meshes,
    /// Splats of radiance fields.
    Splats,
    /// Files that name others.
    Collections,
    /// Prepared scenes, which are drawn without conversion.
    Scenes,
}

impl Family {
    /// All families, in the order of lists.
    pub const ALL: [Self; 9] = [
        Self::Grids,
        Self::Volumes,
        Self::Simulations,
        Self::Particles,
        Self::Clouds,
        Self::Meshes,
        Self::Splats,
        Self::Collections,
        Self::Scenes,
    ];

    /// Returns the name, for headings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grids => "grids",
            Self::Volumes => "volumes",
            Self::Simulations => "simulations",
            Self::Particles => "particles",
            Self::Clouds => "point clouds",
            Self::Meshes => "meshes",
            Self::Splats => "splats",
            Self::Collections => "collections",
            Self::Scenes => "scenes",
        }
    }
}
