//! Reads and writes data files and images; each format has its own module.
//!
//! [`open`] recognises a data file by its content, then by its name. [`write_image`], [`write_depth`] and
//! [`read_image`] choose the format by the file's extension.
//!
//! Every reader compares the sizes in a header with the length of the file before it allocates. Every writer writes a
//! temporary file and renames it when it is complete.

mod amr;
mod arrow;
mod atomic;
mod blanking;
mod cells;
mod closed;
mod cloud;
mod colour_columns;
mod column_file;
mod count_file;
mod csv;
mod dataset;
#[cfg(feature = "dicom")]
mod dicom;
#[cfg(feature = "e57")]
mod e57;
mod element;
mod encoded_splats;
mod ensight;
mod file;
mod file_series;
mod first_order;
mod formats;
mod gadget;
mod gltf;
mod gltf_splats;
mod half;
mod handedness;
mod hdf5;
mod image_file;
mod image_header;
mod image_series;
mod ksplat;
#[cfg(feature = "ktx2")]
mod ktx2;
mod las;
mod log_scales;
mod mesh;
mod mesh_part;
mod meta_image;
mod morton;
#[cfg(feature = "netcdf")]
mod netcdf;
mod nifti;
mod npy;
mod npz;
mod nrrd;
mod obj;
mod openfoam;
mod packed;
mod particle_type;
mod pcd;
mod periodic;
mod plain_numbers;
mod plane_source;
mod planes;
mod plot3d;
mod plotfile;
mod ply;
mod ply_body;
mod ply_header;
mod ply_mesh;
mod ply_packed;
mod ply_packed_write;
mod ply_splats;
mod ply_table;
mod polygons;
mod polyhedron;
mod probe;
mod pvd;
mod raw;
mod refused;
mod rows;
mod samples;
mod scalars;
mod shape_columns;
mod smoothing;
mod sog;
mod splat;
mod splat_axes;
mod splat_table;
mod splats;
mod spz;
mod spz_write;
mod stl;
mod table;
mod tecplot;
mod texture;
mod threemf;
mod tiff;
mod time_steps;
mod unit;
mod up;
mod voxels;
mod vti;
mod vti_planes;
mod vtk_amr;
mod vtk_array;
mod vtk_codec;
mod vtk_collection;
mod vtk_extent;
mod vtk_grid;
mod vtk_legacy;
mod vtk_meshes;
mod vtk_pieces;
mod vtk_surface;
mod vtk_xml;
mod vtk_xml_kinds;
mod vtp;
mod vtr;
mod vts;
#[cfg(feature = "cli")]
mod vts_pieces;
mod vtu;
#[cfg(feature = "cli")]
mod vtu_pieces;
mod vtu_write;
mod write_splats;
mod xyz;
mod zip;
mod zip_write;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

#[cfg(feature = "prepared")]
pub(crate) use atomic::write_atomically;
pub use atomic::write_bytes_atomically;
pub(crate) use blanking::Blanking;
#[cfg(feature = "cli")]
pub(crate) use cells::renumber;
pub use cells::{CellKind, CellMesh};
pub(crate) use colour_columns::{COLOUR_SETS, ColourNumbers, ColourScale, ColourSet, colour_sets};
pub use column_file::{column_colours, column_picture, write_column};
pub use count_file::write_count;
pub use dataset::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
pub use encoded_splats::{PlyForm, SplatFileOptions, SpzVersion};
pub(crate) use first_order::{is_of_higher_order, to_first_order};
pub use formats::{Family, Format, format_of, formats};
pub(crate) use handedness::Handedness;
pub(crate) use hdf5::{CellRows, cell_rows};
pub use image_file::{
    check_depth_path, check_folder, check_image_path, png_bytes, read_image, write_depth,
    write_image, write_normals,
};
pub use log_scales::ScaleMeaning;
pub use mesh::{AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap};
pub(crate) use mesh_part::leave_out_unused;
pub use particle_type::{ParticleCount, ParticleType};
#[cfg(feature = "cli")]
pub(crate) use planes::Planes;
pub(crate) use polyhedron::polyhedron_faces;
pub use raw::{RawLayout, RawType};
pub use rows::RowFile;
pub(crate) use shape_columns::{LENGTHS, SCALES, VARIANCE};
pub use smoothing::{LengthMeaning, Smoothing, SphKernel};
pub use splat_axes::SplatAxes;
pub use splats::SplatCloud;
pub(crate) use splats::constant_of_colour;
pub use time_steps::{Part, StepChoice, TimeStep};
#[cfg(feature = "legend")]
pub(crate) use unit::divided as name_and_unit;
pub use up::Up;
#[cfg(feature = "cli")]
pub(crate) use up::in_end_planes;
pub(crate) use vtk_grid::check as check_cells;
#[cfg(feature = "cli")]
pub(crate) use vtk_pieces::{ArrayKey, ArraysSeen};
#[cfg(feature = "cli")]
pub(crate) use vts_pieces::{BlockPlanes, VtsPieces};
#[cfg(feature = "cli")]
pub(crate) use vtu_pieces::VtuPieces;
pub use write_splats::{FLAT_SHARE, WrittenSplats, check_splats_path, write_splats};

use file::{HEAD, Input};
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
    if let Some(case) = openfoam::case_in(path) {
        return Cow::Owned(case);
    }
    let stands_in = |name: &str, is_so: &dyn Fn(&Path, &[u8]) -> bool| {
        let file = path.join(name);
        let head = Input::of_file(&file).head(HEAD);
        let is_so = head.is_ok_and(|(head, _)| is_so(&file, &head));
        is_so.then_some(file)
    };
    let file = path.is_dir().then(|| {
        let plotfile = || stands_in(plotfile::HEADER, &|_, head| plotfile::looks_like(head));
        let scene = || stands_in(sog::META, &sog::looks_like);
        #[cfg(feature = "dicom")]
        let series = || dicom::series_in(path);
        #[cfg(not(feature = "dicom"))]
        let series = || None;
        plotfile().or_else(scene).or_else(series)
    });
    file.flatten().map_or(Cow::Borrowed(path), Cow::Owned)
}

/// Returns true if a folder is a data set of a format that is not read.
#[cfg(feature = "cli")]
pub(crate) fn is_foreign_folder(path: &Path) -> bool {
    refused::folder(path).is_some()
}

/// Returns true if a file may hold particles of several types: if it is HDF5 or a binary Gadget snapshot.
/// [`OpenOptions::particle_type`] chooses one of the types.
///
/// # Errors
/// The file cannot be read.
pub fn has_particle_types(path: &Path) -> Result<bool> {
    let (head, _) = Input::of_file(path).head(HEAD)?;
    Ok(head.starts_with(hdf5::MAGIC) || gadget::looks_like(&head))
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
        let in_name = || unit::divided(&field.name).map(|(_, unit)| unit.to_owned());
        field.unit = stated.or_else(in_name);
    }
}

/// Returns the extension in lower case, or an empty string.
fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}
