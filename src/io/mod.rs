//! Reads and writes data files and images; each format has its own module.
//!
//! [`open`] recognises a data file by its content, then by its name. [`write_image`], [`write_depth`] and
//! [`read_image`] choose the format by the file's extension.
//!
//! Every reader compares the sizes in a header with the length of the file before it allocates. Every writer writes a
//! temporary file and renames it when it is complete.

pub(crate) mod bytes;
mod cloud;
mod formats;
mod grid;
mod mesh;
mod particles;
mod parts;
mod picture;
mod ply;
pub(crate) mod refused;
pub(crate) mod splats;
mod time_steps;
mod volume;
mod vtk;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

#[cfg(feature = "prepared")]
pub(crate) use self::bytes::atomic::write_atomically;
pub use self::bytes::atomic::write_bytes_atomically;
pub(crate) use self::mesh::mesh_part::leave_out_unused;
pub(crate) use self::particles::hdf5::{CellRows, cell_rows};
pub(crate) use self::parts::planes::Planes;
pub(crate) use self::parts::rows::ROWS;
pub use self::parts::rows::RowFile;
pub use self::picture::column_file::{column_colours, column_picture, write_column};
pub use self::picture::count_file::write_count;
pub use self::picture::image_file::{
    check_depth_path, check_folder, check_image_path, png_bytes, read_image, write_depth,
    write_image, write_normals,
};
pub use self::splats::encoded_splats::{PlyForm, SplatFileOptions, SpzVersion};
pub use self::splats::log_scales::ScaleMeaning;
pub use self::splats::splat_axes::SplatAxes;
pub use self::splats::write_splats::{FLAT_SHARE, WrittenSplats, check_splats_path, write_splats};
pub use self::volume::raw::{RawLayout, RawType};
pub(crate) use self::vtk::grid::check as check_cells;
pub(crate) use self::vtk::pieces::{ArrayKey, ArraysSeen};
pub(crate) use self::vtk::vts_pieces::{BlockPlanes, VtsPieces};
pub(crate) use self::vtk::vtu_pieces::VtuPieces;
pub use crate::data::association::Association;
pub use crate::data::cells::{CellKind, CellMesh};
pub use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
pub use crate::data::mesh::{
    AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap,
};
pub use crate::data::particle_type::{ParticleCount, ParticleType};
pub use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
pub use crate::data::splats::SplatCloud;
#[cfg(feature = "legend")]
pub use crate::data::up::Up;
pub use formats::{Family, Format, format_of, formats};
pub use time_steps::{Part, StepChoice, TimeStep};

use self::bytes::file::{HEAD, Input};
use formats::recognise;

use crate::error::{Error, Hint, Parameter, Result};

/// Settings for [`open`]: properties of the data that the file does not state, and choices among its contents.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Layout of a raw volume; other formats ignore it.
    pub raw: Option<RawLayout>,
    /// Solution of a PLOT3D grid, or its function file. If absent, the reader looks for it beside the grid. Other
    /// formats ignore it.
    pub solution: Option<PathBuf>,
    /// Texture image for the parts of an OBJ or PLY mesh that have texture coordinates but no texture. Other formats
    /// ignore it.
    pub texture: Option<PathBuf>,
    /// Geometry to read from a file that may hold points or a mesh. If absent, a file with faces is read as a mesh. A
    /// file that cannot be read this way is refused.
    pub read_as: Option<ReadAs>,
    /// Type of the particles to read from a snapshot with several types. If absent, gas is read, or else the first type
    /// in the file; from Phantom files, everything but the sinks. A file without particles of this type is refused, and
    /// so is a file of another format.
    pub particle_type: Option<ParticleType>,
    /// Meaning of the scales of splats in glTF files and of the columns `scale_0..2` of tables. If absent, they are
    /// logarithms if any is negative, and standard deviations otherwise. Data without such scales are refused.
    pub scales: Option<ScaleMeaning>,
    /// Time step to read from a file with several, counted from 0 ([`Format::time_steps`]). If absent, the first is
    /// read and a note states this. Other formats ignore it.
    pub time_step: Option<usize>,
}

/// Geometry to read from points with faces: from PLY files, and from VTK files with flat cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadAs {
    /// Particles, with all attributes of the points as fields.
    Points,
    /// A mesh.
    Mesh,
}

/// Reads a data file.
///
/// [`formats`] lists the formats that are read. The first bytes of the file decide its format, or else its name, or
/// else its text or size. If [`OpenOptions::raw`] is given, the file is read as a raw volume before its text or size is
/// examined.
///
/// A folder may be a SOG scene with its `meta.json`, an AMReX plotfile, an OpenFOAM case, or DICOM series (the largest
/// is read).
///
/// # Errors
/// The file cannot be read, has no known format, or breaks its format's rules.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    let path = of_folder(path);
    read_input(Input::of_file(&path), options)
}

/// Returns the file to open for a folder that is a data set; returns any other path unchanged.
pub(crate) fn of_folder(path: &Path) -> Cow<'_, Path> {
    if let Some(case) = self::grid::openfoam::case_in(path) {
        return Cow::Owned(case);
    }
    let stands_in = |name: &str, is_so: &dyn Fn(&Path, &[u8]) -> bool| {
        let file = path.join(name);
        let head = Input::of_file(&file).head(HEAD);
        let is_so = head.is_ok_and(|(head, _)| is_so(&file, &head));
        is_so.then_some(file)
    };
    let file = path.is_dir().then(|| {
        let plotfile = || {
            stands_in(self::grid::plotfile::HEADER, &|_, head| {
                self::grid::plotfile::looks_like(head)
            })
        };
        let scene = || {
            stands_in(
                self::splats::sog::files::META,
                &self::splats::sog::looks_like,
            )
        };
        #[cfg(feature = "dicom")]
        let series = || self::volume::dicom::series_in(path);
        #[cfg(not(feature = "dicom"))]
        let series = || None;
        plotfile().or_else(scene).or_else(series)
    });
    file.flatten().map_or(Cow::Borrowed(path), Cow::Owned)
}

/// Returns true if a file may hold particles of several types: if it is HDF5 or a binary Gadget snapshot.
/// [`OpenOptions::particle_type`] chooses one of the types.
///
/// # Errors
/// The file cannot be read.
pub fn has_particle_types(path: &Path) -> Result<bool> {
    let (head, _) = Input::of_file(path).head(HEAD)?;
    Ok(
        head.starts_with(self::particles::hdf5::MAGIC)
            || self::particles::gadget::looks_like(&head),
    )
}

/// Reads a data file from its bytes, as [`open`] does from the disk.
///
/// - `name`: name of the file. Its extension decides the format if the content does not. Error messages contain it.
///
/// Files that name others (VTK indices, OBJ with materials, glTF with separate buffers, image headers) need
/// [`read_with`]. This function reads nothing from the disk.
///
/// ```
/// use ewa_splat::io::{OpenOptions, read};
///
/// # fn main() -> ewa_splat::Result<()> {
/// let table = b"x,y,z,sigma,mass\n0,0,0,0.5,1\n1,0,0,0.5,2\n";
/// let data = read("stars.csv", table, &OpenOptions::default())?;
/// assert_eq!(data.field_names(), ["sigma", "mass"]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// The errors of [`open`]; the file names another file.
pub fn read(name: &str, bytes: &[u8], options: &OpenOptions) -> Result<Dataset> {
    read_with(name, bytes, options, &|_| None)
}

/// Reads a data file as [`read`] does; `beside` returns the bytes of other files that it names.
///
/// The argument of `beside` is a path relative to the folder of `name`, as the file spells it. The reader may ask for
/// the same path more than once. [`OpenOptions::solution`] and [`OpenOptions::texture`] are passed unchanged.
///
/// # Errors
/// The errors of [`read`]; `beside` returns `None` for a file that is needed.
pub fn read_with(
    name: &str,
    bytes: &[u8],
    options: &OpenOptions,
    beside: &dyn Fn(&Path) -> Option<Vec<u8>>,
) -> Result<Dataset> {
    read_input(Input::of_bytes(Path::new(name), bytes, beside), options)
}

fn read_input(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let mut data = (recognise(input, options)?.read)(input, options)?;
    let has_scales = data.format == self::splats::gltf_splats::FORMAT
        || (options.read_as != Some(ReadAs::Points)
            && self::splats::splat_table::settle(&mut data, options.scales)?)
        || self::splats::log_scales::settle_table(&mut data, options.scales);
    if options.scales.is_some() && !has_scales {
        return Err(Error::format(
            input.path,
            Parameter::Scales,
            "splats of a glTF file, or a table with scale_0..2 and rot_0..3",
            data.format,
            Hint::LeaveOut(Parameter::Scales),
        ));
    }
    name_units(&mut data);
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

/// Takes units from the names of fields whose unit is not stated otherwise.
fn name_units(data: &mut Dataset) {
    for field in &mut data.fields {
        let stated = field.unit.take();
        let in_name = || crate::data::unit::divided(&field.name).map(|(_, unit)| unit.to_owned());
        field.unit = stated.or_else(in_name);
    }
}

/// Returns the extension in lower case, or an empty string.
fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}
