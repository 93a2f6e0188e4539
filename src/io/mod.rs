//! Files in and out, one file of code per format.
//!
//! [`open`] recognises a data file by its content, then by its name; [`write_image`],
//! [`write_depth`] and [`read_image`] go by extension. Every reader checks what a header
//! claims against the bytes that are there before it allocates, and every writer writes to a
//! temporary file that is renamed when complete.

mod atomic;
mod blanking;
mod cells;
mod closed;
mod column_file;
mod count_file;
mod csv;
mod dataset;
mod encoded_splats;
mod file;
mod gltf;
mod gltf_splats;
mod handedness;
mod hdf5;
mod image_file;
mod image_header;
#[cfg(feature = "ktx2")]
mod ktx2;
mod log_scales;
mod mesh;
mod mesh_part;
mod meta_image;
mod nifti;
mod npy;
mod npz;
mod nrrd;
mod obj;
mod particle_type;
mod plot3d;
mod ply;
mod ply_body;
mod ply_header;
mod ply_mesh;
mod ply_packed;
mod ply_splats;
mod ply_table;
mod polygons;
mod polyhedron;
mod pvd;
mod raw;
mod samples;
mod scalars;
mod shape_columns;
mod smoothing;
mod sog;
mod splat;
mod splats;
mod spz;
mod spz_write;
mod stl;
mod table;
mod texture;
mod threemf;
mod unit;
mod up;
mod voxels;
mod vti;
mod vtk_array;
mod vtk_codec;
mod vtk_extent;
mod vtk_grid;
mod vtk_legacy;
mod vtk_meshes;
mod vtk_pieces;
mod vtk_surface;
mod vtk_xml;
mod vtp;
mod vtr;
mod vts;
mod vtu;
mod write_splats;
mod zip;

use std::path::{Path, PathBuf};

pub use atomic::write_bytes_atomically;
pub(crate) use blanking::Blanking;
pub use cells::{CellKind, CellMesh};
pub use column_file::{column_colours, column_picture, write_column};
pub use count_file::write_count;
pub use dataset::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
pub use encoded_splats::PlyForm;
pub(crate) use handedness::Handedness;
#[cfg(feature = "report")]
pub(crate) use image_file::png_bytes;
pub use image_file::{
    check_depth_path, check_folder, check_image_path, read_image, write_depth, write_image,
    write_normals,
};
pub use log_scales::ScaleMeaning;
pub use mesh::{AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap};
pub(crate) use mesh_part::leave_out_unused;
pub use particle_type::{ParticleCount, ParticleType};
pub(crate) use polyhedron::polyhedron_faces;
pub use pvd::{TimeStep, collection, is_collection};
pub use raw::{RawLayout, RawType};
pub(crate) use shape_columns::{LENGTHS, SCALES, VARIANCE};
pub use smoothing::{LengthMeaning, Smoothing, SphKernel};
pub use sog::scene_in as sog_scene;
pub use splats::SplatCloud;
pub(crate) use splats::constant_of_colour;
#[cfg(feature = "legend")]
pub(crate) use unit::divided as name_and_unit;
pub use up::Up;
pub(crate) use vtk_grid::check as check_cells;
pub use write_splats::{FLAT_SHARE, WrittenSplats, check_splats_path, write_splats};

use file::{HEAD, Input};

use crate::error::{Advice, Error, Hint, Parameter, Result};

/// What files do not say about themselves.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// How raw volumes are laid out; other formats ignore it.
    pub raw: Option<RawLayout>,
    /// The solution of a PLOT3D grid; without it, one beside the grid is taken. Other formats
    /// ignore it.
    pub solution: Option<PathBuf>,
    /// An image for the parts of an OBJ or PLY mesh that have texture coordinates and no texture. Other
    /// formats ignore it.
    pub texture: Option<PathBuf>,
    /// What to make of a file that may be one or the other; without it a file with faces is a mesh. A
    /// file that cannot be read as this is refused.
    pub read_as: Option<ReadAs>,
    /// The type of the particles to read of a snapshot that holds several; without it, gas or the first type there is,
    /// and of Phantom all but its sinks. A file without particles of this type is refused, and so is one of another
    /// format.
    pub particle_type: Option<ParticleType>,
    /// What the scales of splats in glTF files and the columns `scale_0..2` of tables are; without it, logarithms where any
    /// is negative, and otherwise standard deviations. Data without such scales are refused.
    pub scales: Option<ScaleMeaning>,
}

/// What to make of points with faces: of PLY files, and of VTK files whose cells are flat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadAs {
    /// Particles, with all that is known of the points as fields.
    Points,
    /// A mesh.
    Mesh,
}

/// Formats that are recognised in order to be refused by name: the bytes they start with, and
/// what to do.
const NOT_READ: &[(&[u8], &str, &str)] = &[
    (
        b"CDF\x01",
        "a netCDF or Exodus file",
        "save it as VTK XML (.vtu), or export CSV",
    ),
    (
        b"CDF\x02",
        "a netCDF or Exodus file",
        "save it as VTK XML (.vtu), or export CSV",
    ),
    (
        b"\x89PNG",
        "a PNG image",
        "an image holds no volume: give a data file",
    ),
    (
        b"PF\n",
        "a PFM image",
        "an image holds no volume: give a data file",
    ),
    (
        b"\x76\x2f\x31\x01",
        "an EXR image",
        "an image holds no volume: give a data file",
    ),
];

/// What is read, in messages about what is not.
const KNOWN: &str = "VTK XML (.vti, .vtr, .vts, .vtu, .vtp), legacy VTK, NRRD, \
     MetaImage, NIfTI, PLOT3D, HDF5 particles, CSV, NPY, NPZ, PLY, .splat, SPZ, SOG, OBJ, STL, 3MF, glTF or a raw volume";

/// Types of VTK XML files that are not read: how they begin, and what to do.
const VTK_NOT_READ: &[(&str, &str)] = &[
    ("vtkMultiBlock", "give one of the files that it names"),
    ("vtkPartitioned", "give one of the files that it names"),
    ("vtkMultiPiece", "give one of the files that it names"),
    (
        "vtkHierarchical",
        "give one of the files that it names, or resample it to ImageData (.vti)",
    ),
    (
        "vtkOverlapping",
        "give one of the files that it names, or resample it to ImageData (.vti)",
    ),
    (
        "vtkNonOverlapping",
        "give one of the files that it names, or resample it to ImageData (.vti)",
    ),
    ("HyperTreeGrid", "resample it to ImageData (.vti)"),
    ("PHyperTreeGrid", "resample it to ImageData (.vti)"),
    ("Table", "export it as CSV with columns x, y and z"),
    ("PTable", "export it as CSV with columns x, y and z"),
];

/// Reads a data file.
///
/// | recognised by | format |
/// |---|---|
/// | `\x93NUMPY` | [NPY](https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html) particle table |
/// | `PK\x03\x04` | NPZ archive of such arrays |
/// | `<VTKFile type="ImageData"` | VTK image data |
/// | `<VTKFile type="RectilinearGrid"` | VTK rectilinear grid |
/// | `<VTKFile type="StructuredGrid"` | VTK structured grid |
/// | `<VTKFile type="UnstructuredGrid"` | VTK unstructured grid; a mesh where all cells are flat |
/// | `<VTKFile type="PolyData"` | VTK polygonal data: a mesh, or particles |
/// | `<VTKFile type="Collection"` | ParaView's collection: the first file of its first time step; [`collection`] has the others |
/// | the same with a `P` before the type | an index, with the files of pieces that it names |
/// | `# vtk DataFile` | legacy VTK file: image data, grids of all kinds, polygonal data |
/// | `NRRD` | [NRRD](https://teem.sourceforge.net/nrrd/format.html) image, with the files of numbers that it names |
/// | `ObjectType =` or `NDims =`, or `.mha`, `.mhd` | [MetaImage](https://itk.org/Wiki/ITK/MetaIO/Documentation), with the files of numbers that it names |
/// | `n+1`, `n+2`, `ni1` or `ni2` in its header, also packed with gzip; `.nii`; `.img` with its `.hdr` | [NIfTI](https://nifti.nimh.nih.gov/) image |
/// | `ply` and the end of a line | PLY particle table, a mesh where it has faces, splats in INRIA's layout or compressed ones |
/// | `NGSP`, packed with gzip or not, or `.spz` | SPZ splats |
/// | `.splat` | splats, 32 bytes each |
/// | `{` with `means`, `scales` and `quats`; ZIP with a `meta.json`; a folder that holds one | SOG splats (PlayCanvas), with their images |
/// | `glTF` or `.gltf`, with `KHR_gaussian_splatting` | splats of a glTF file |
/// | `\x89HDF` | HDF5 snapshot of particles: Phantom, Gadget, Gizmo, Arepo, SWIFT |
/// | `glTF`, or JSON with an `asset`, or `.gltf` | [glTF 2.0](https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html) mesh, with textures |
/// | `.obj`, or text of its statements | Wavefront OBJ mesh, with materials and textures |
/// | ZIP with a `.model`, or `.3mf` | [3MF](https://3mf.io/spec/) mesh |
/// | `.stl`, or text that begins with `solid`, or the size of so many triangles | STL mesh |
/// | [`OpenOptions::raw`] | raw volume, also gzip-compressed |
/// | text whose first line names x, y and z, or `.csv` | CSV particle table |
/// | size and first words, or `.xyz`, `.x`, `.g`, `.p3d` | PLOT3D grids, with their solution |
///
/// # Errors
/// The file cannot be read, is of no known format, or breaks its format's rules.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    let scene = match path.is_dir() {
        true => sog::scene_in(path),
        false => None,
    };
    read_input(Input::of_file(scene.as_deref().unwrap_or(path)), options)
}

/// Whether a file may hold particles of several types, of which [`OpenOptions::particle_type`] names one: whether it is
/// HDF5.
///
/// # Errors
/// The file cannot be read.
pub fn has_particle_types(path: &Path) -> Result<bool> {
    let (head, _) = Input::of_file(path).head(hdf5::MAGIC.len())?;
    Ok(head == hdf5::MAGIC)
}

/// Reads a data file from its bytes, as [`open`] does from the disk.
///
/// - `name`: what the file is called; its extension says what the contents leave open, and errors
///   have it.
///
/// Files that name others (VTK indices, OBJ with materials, glTF with buffers beside it, headers of images) need
/// [`read_with`]; nothing is looked for on the disk.
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
/// As [`open`], and a file that is named and not given.
pub fn read(name: &str, bytes: &[u8], options: &OpenOptions) -> Result<Dataset> {
    read_with(name, bytes, options, &|_| None)
}

/// As [`read`], and `beside` gives the bytes of other files.
///
/// It is asked by paths relative to the folder of `name`, as the file spells them, more than once for
/// some; [`OpenOptions::solution`] and [`OpenOptions::texture`] are asked for as they are.
///
/// # Errors
/// As [`read`].
pub fn read_with(
    name: &str,
    bytes: &[u8],
    options: &OpenOptions,
    beside: &dyn Fn(&Path) -> Option<Vec<u8>>,
) -> Result<Dataset> {
    read_input(Input::of_bytes(Path::new(name), bytes, beside), options)
}

fn read_input(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let mut data = recognised(input, options)?;
    let has_scales =
        data.format == gltf_splats::FORMAT || log_scales::settle_table(&mut data, options.scales);
    if options.scales.is_some() && !has_scales {
        return Err(Error::format(
            input.path,
            Parameter::Scales,
            "splats of a glTF file, or a table with scale_0..2 and rot_0..3",
            data.format,
            Hint::LeaveOut(Parameter::Scales),
        ));
    }
    for field in &mut data.fields {
        let stated = field.unit.take();
        let in_name = || unit::divided(&field.name).map(|(_, unit)| unit.to_owned());
        field.unit = stated.or_else(in_name);
    }
    if options.particle_type.is_some() && data.particle_types.is_empty() {
        return Err(Error::format(
            input.path,
            Parameter::ParticleType,
            "an HDF5 snapshot of particles of several types",
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

/// Reads a file as what its content, or else its name, says that it is.
fn recognised(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let path = input.path;
    let (head, len) = input.head(HEAD)?;
    let extension = extension(path);
    let extension = extension.as_str();

    if head.starts_with(npy::MAGIC) {
        return npy::read(input);
    }
    if head.starts_with(nrrd::MAGIC) {
        return nrrd::read(input);
    }
    if meta_image::looks_like(&head) {
        return meta_image::read(input);
    }
    if nifti::looks_like(&head) {
        return nifti::read(input);
    }
    if vtk_xml::looks_like(&head) {
        return match vtk_xml::file_type(&head).unwrap_or("") {
            "ImageData" | "PImageData" => vti::read(input),
            "RectilinearGrid" | "PRectilinearGrid" => vtr::read(input),
            "StructuredGrid" | "PStructuredGrid" => vts::read(input),
            "UnstructuredGrid" | "PUnstructuredGrid" => vtu::read(input, options.read_as),
            "PolyData" | "PPolyData" => vtp::read(input, options.read_as),
            pvd::TYPE => read_first(input, options),
            other => Err(refuse_vtk_type(path, other)),
        };
    }
    if head.starts_with(vtk_legacy::MAGIC) {
        return vtk_legacy::read(input, options.read_as);
    }
    if ply::looks_like(&head) {
        return ply::read(input, options);
    }
    if extension == "spz" || spz::looks_like(&head) {
        return spz::read(input);
    }
    if extension == "splat" {
        return splat::read(input);
    }
    // Before glTF, with which it shares an `asset`.
    if sog::looks_like(path, &head) {
        return sog::read(input);
    }
    // Before the meshes of glTF files, which may hold both.
    if gltf_splats::looks_like(input, &head) {
        return gltf_splats::read(input, options.scales);
    }
    if head.starts_with(zip::MAGIC) {
        return archived(input);
    }
    if head.starts_with(hdf5::MAGIC) {
        return hdf5::read(input, options.particle_type);
    }
    if extension == "gltf" || gltf::looks_like(&head) {
        return gltf::read(input);
    }
    let texture = options.texture.as_deref();
    if extension == "obj" {
        return obj::read(input, texture);
    }
    // The size says less where a layout is given.
    if extension == "stl" || (options.raw.is_none() && stl::looks_like(&head, len)) {
        return stl::read(input);
    }
    if matches!(extension, "mha" | "mhd") {
        return meta_image::read(input);
    }
    let is_nifti = extension == "nii" || (extension == "gz" && stem_extension(path) == "nii");
    if is_nifti {
        return nifti::read(input);
    }
    if extension == "hdr" && nifti::looks_like_analyze(&head) {
        return Err(nifti::refuse_analyze(path));
    }
    if extension == "img"
        && let Some(header) = nifti::header_beside(input)
    {
        return input.with_beside(&header, |header| {
            match nifti::looks_like(&header.head(HEAD)?.0) {
                true => nifti::read(header),
                false => Err(nifti::refuse_analyze(header.path)),
            }
        });
    }
    let is_table = matches!(extension, "csv" | "tsv");
    if let (Some(layout), false) = (&options.raw, is_table) {
        return raw::read(input, layout);
    }
    if extension == "raw" || (extension == "gz" && stem_extension(path) == "raw") {
        return Err(Error::NoLayout {
            path: path.to_path_buf(),
            suggested: raw::layout_from_name(path),
        });
    }
    let refuse = |name: &str, advice: Advice| {
        Error::format(
            path,
            "format",
            KNOWN,
            format!("{name}, which is not read yet"),
            advice,
        )
    };
    if let Some((_, name, advice)) = NOT_READ.iter().find(|(magic, ..)| head.starts_with(magic)) {
        return Err(refuse(name, (*advice).into()));
    }
    if head.starts_with(b"\x1f\x8b") {
        return Err(refuse("a gzip archive", Hint::UnpackOrGiveLayout.into()));
    }
    if is_table {
        return csv::read(input);
    }
    if obj::looks_like(&head) {
        return obj::read(input, texture);
    }
    let is_plot3d = matches!(extension, "xyz" | "x" | "g" | "p3d" | "p3dx" | "q");
    let is_text = !head.iter().any(|&b| b < 0x20 && !b.is_ascii_whitespace());
    if is_text && (!is_plot3d || csv::names_positions(&head)) {
        return csv::read(input);
    }
    if is_plot3d || extension == "bin" || plot3d::looks_like_grid(&head, len) {
        return plot3d::read(input, options.solution.as_deref());
    }
    Err(Error::format(
        path,
        "format",
        KNOWN,
        "none of these",
        Hint::ConvertOrGiveLayout,
    ))
}

/// Reads a ZIP archive as what its members say that it is.
fn archived(input: Input<'_>) -> Result<Dataset> {
    let bytes = input.read_all()?;
    // What is no archive is told of by the reader of arrays.
    let entries = zip::entries(&bytes).unwrap_or_default();
    if extension(input.path) == "sog" || sog::is_archive(&entries) {
        return sog::read(input);
    }
    if extension(input.path) == "3mf" || threemf::is_archive(&entries) {
        return threemf::read(input);
    }
    npz::read(input)
}

/// The first part of the first time step of a collection, with notes of what else there is.
fn read_first(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let (file, notes) = pvd::first(input)?;
    let mut data = input.with_beside(&file, |part| {
        // What a collection names could name the collection.
        pvd::check_part(input.path, &file, &part.head(HEAD)?.0)?;
        read_input(part, options)
    })?;
    data.notes.extend(notes);
    Ok(data)
}

/// A VTK XML file of a type that is not read.
fn refuse_vtk_type(path: &Path, kind: &str) -> Error {
    let advice = VTK_NOT_READ
        .iter()
        .find(|(start, _)| kind.starts_with(start));
    let advice = advice.map_or("save it as one of these", |(_, advice)| advice);
    Error::format(
        path,
        "VTKFile, `type`",
        "ImageData, RectilinearGrid, StructuredGrid, UnstructuredGrid or PolyData",
        format!("`{}`, which is not read yet", vtk_xml::clip(kind)),
        advice,
    )
}

/// The extension in lower case, or nothing.
fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}

/// The extension before the last one, as in `volume.raw.gz`.
fn stem_extension(path: &Path) -> String {
    path.file_stem()
        .map(|stem| extension(Path::new(stem)))
        .unwrap_or_default()
}
