//! Defines the table of formats that are read. Recognition, the program's help, the lists in the documentation and the
//! tests of damaged files are made from it.
//!
//! The first bytes of a file decide its format if they identify it ([`Format::begins`]), or else its name, or else its
//! text or size ([`Format::resembles`]). Within each of these steps, the first matching entry of the table decides.

use std::path::Path;

use super::bytes::file::{HEAD, Input};
use super::bytes::probe::Probe;
use super::bytes::{packed, zip};
#[cfg(feature = "e57")]
use super::cloud::e57;
use super::cloud::{las, pcd, xyz};
use super::folder::of_folder;
use super::format::{Family, Format};
#[cfg(feature = "netcdf")]
use super::grid::netcdf;
use super::grid::{cgns, ensight, gmsh, nek, openfoam, plot3d, plotfile, tecplot, xdmf};
use super::mesh::{gltf, obj, stl, threemf};
use super::options::OpenOptions;
use super::particles::atoms::{gro, lammps, xyz as atoms};
use super::particles::{arrow, csv, gadget, hdf5, npy, npz, phantom, tipsy};
use super::parts::plane_source;
use super::splats::{gltf_splats, ksplat, sog, splat, spz, usd};
#[cfg(feature = "dicom")]
use super::volume::dicom;
use super::volume::{image_series, meta_image, nifti, nrrd, raw, tiff};
use super::vtk::{collection, file_series, pvd};
use super::{ply, refused, vtk};
use crate::error::{Error, Hint, Result};

/// Defaults for the entries of the table: a format that recognises no file, and has no time steps and no planes.
const PLAIN: Format = Format {
    name: "",
    family: Family::Grids,
    endings: &[],
    reads: "",
    begins: |_| false,
    is_pattern: |_| false,
    is_named: |_| false,
    is_bare: false,
    resembles: |_| false,
    read: |input, _| npy::read(input),
    steps: None,
    planes: None,
};

/// Returns the formats that are read, in the order in which they are tried.
pub fn formats() -> &'static [Format] {
    FORMATS
}

/// Recognises the format of a file.
///
/// # Errors
/// The file cannot be read, or has none of the [`formats`].
pub fn format_of(path: &Path, options: &OpenOptions) -> Result<&'static Format> {
    recognise(Input::of_file(&of_folder(path)), options)
}

pub(crate) fn recognise(input: Input<'_>, options: &OpenOptions) -> Result<&'static Format> {
    if let Some(format) = FORMATS.iter().find(|f| (f.is_pattern)(input.path)) {
        return Ok(format);
    }
    if input.is_on_disk()
        && input.path.is_dir()
        && let Some(refusal) = refused::folder(input.path)
    {
        return Err(refusal);
    }
    let (head, len) = input.head(HEAD)?;
    let probe = Probe::new(input, &head, len, options);
    if let Some(refusal) = refused::archive(input.path, &head) {
        return Err(refusal);
    }
    if let Some(known) = FORMATS.iter().find(|f| (f.begins)(&probe)) {
        return Ok(known);
    }
    let is_named = |f: &&Format| probe.ends_in(f.endings) || (f.is_named)(&probe);
    let named = FORMATS.iter().find(is_named);
    // A raw layout accepts any content, so signatures of other formats are ignored.
    if options.raw.is_none()
        && let is_bare = named.is_some_and(|f| f.is_bare)
        && let Some(refusal) = refused::by_content(input.path, &head, len, is_bare)
    {
        return Err(refusal);
    }
    if let Some(named) = named {
        return Ok(named);
    }
    if let Some(similar) = FORMATS.iter().find(|f| (f.resembles)(&probe)) {
        return Ok(similar);
    }
    if let Some(refusal) = refused::by_name(input.path, &head) {
        return Err(refusal);
    }
    Err(match probe.is_text() {
        true => Error::format(
            input.path,
            "format",
            names(),
            "text of none of these",
            "convert it to one of them; of a table, name the columns x,y,z in its first line",
        ),
        false => {
            let advice = Hint::ConvertOrGiveLayout;
            Error::format(input.path, "format", names(), "none of these", advice)
        }
    })
}

/// Returns the names of all formats, for messages about files that are not read.
pub(super) fn names() -> String {
    let names: Vec<&str> = FORMATS.iter().map(|format| format.name).collect();
    names.join(", ")
}

static FORMATS: &[Format] = &[
    Format {
        name: "NPY",
        family: Family::Particles,
        endings: &["npy"],
        reads: "columns of particles, of one array or named: see [tables](#tables)",
        begins: |p| p.head.starts_with(npy::MAGIC),
        read: |input, _| npy::read(input),
        ..PLAIN
    },
    Format {
        name: "NRRD",
        family: Family::Volumes,
        endings: &["nrrd", "nhdr"],
        reads: "all types of numbers in either byte order; raw, text, hex, gzip, bzip2; numbers in other files, a list or a \
                pattern of them. See [Images with headers](#images-with-headers)",
        begins: |p| p.head.starts_with(nrrd::MAGIC),
        read: |input, _| nrrd::image(input)?.read(input),
        planes: Some(|input, _| plane_source::of_image(input, nrrd::image)),
        ..PLAIN
    },
    Format {
        name: "prepared scenes",
        family: Family::Scenes,
        endings: &["arrow"],
        reads: "what `ewa-splat convert` wrote as such, mapped into memory: drawn, described and measured as it is, and no data \
                to be sampled or converted anew. See [Prepared scenes](#prepared-scenes)",
        begins: |p| arrow::looks_like(p.head),
        read: |input, _| arrow::read(input),
        ..PLAIN
    },
    Format {
        name: "MetaImage",
        family: Family::Volumes,
        endings: &["mha", "mhd"],
        reads: "all types of numbers in either byte order, compressed or not, with channels; numbers in other files, a \
                list or a pattern of them",
        begins: |p| meta_image::looks_like(p.head),
        read: |input, _| meta_image::image(input)?.read(input),
        planes: Some(|input, _| plane_source::of_image(input, meta_image::image)),
        ..PLAIN
    },
    // Before TIFF: the preamble of a DICOM file may begin as a TIFF file, so that either kind of program can show the
    // image.
    #[cfg(feature = "dicom")]
    Format {
        name: "DICOM",
        family: Family::Volumes,
        endings: &["dcm", "dicom"],
        reads: "series of slices, given as any of their files or the folder, and files of many frames (enhanced or not, RT \
                dose): explicit, implicit, deflated and big-endian; uncompressed, RLE, JPEG (baseline, extended of 8 bits, \
                lossless); grey of 1 to 32 bits and floats, rescaled, RGB and YBR. JPEG 2000, JPEG-LS and the like are refused by \
                name. See [Images with headers](#images-with-headers)",
        begins: |p| dicom::looks_like(p.head),
        resembles: |p| dicom::looks_bare(p.head),
        read: |input, _| dicom::read(input),
        ..PLAIN
    },
    Format {
        name: "TIFF stacks",
        family: Family::Volumes,
        endings: &["tif", "tiff"],
        reads: "pages of one size as layers: integers and floats of 8 to 64 bits, grey or colours, raw, LZW, deflate, \
                BigTIFF; ImageJ's spacing, channels (a field each) and times (the first). Rows go along y",
        begins: |p| tiff::looks_like(p.head),
        read: |input, _| tiff::read(input),
        ..PLAIN
    },
    Format {
        name: "NIfTI",
        family: Family::Volumes,
        endings: &["nii", "nii.gz"],
        reads: "versions 1 and 2 in either byte order, alone or as `.hdr` with `.img`; integers, floats and RGB, scaled \
                by `scl_slope` and `scl_inter`; no complex numbers",
        begins: |p| nifti::looks_like(p.head),
        is_named: |p| {
            let is_analyze = p.ends_in(&["hdr"]) && nifti::looks_like_analyze(p.head);
            is_analyze || p.ends_in(&["img"]) && nifti::header_beside(p.input).is_some()
        },
        read: |input, _| nifti::read(input),
        planes: Some(|input, _| {
            nifti::with_header(input, |input| plane_source::of_image(input, nifti::image))
        }),
        ..PLAIN
    },
    Format {
        name: "ParaView's collections",
        family: Family::Collections,
        endings: &["pvd"],
        reads: "the first time step, another (`--step`, `--time`), or with `--series` all in the order of time; the parts of \
                one time are drawn together (`info` and `io::open` take the first). Paths are relative to the collection; another \
                collection in it is refused",
        begins: |p| pvd::looks_like(p.head),
        read: |input, options| {
            collection::read_first(input, &pvd::steps(input)?, options, recognise)
        },
        steps: Some(pvd::steps),
        ..PLAIN
    },
    Format {
        name: "ParaView's file series",
        family: Family::Collections,
        endings: &["series"],
        reads: "JSON lists of files with their times (`a.vtu.series`), as ParaView's collections are read. Names are \
                relative to the series",
        begins: |p| file_series::looks_like(p.head),
        read: |input, options| {
            collection::read_first(input, &file_series::steps(input)?, options, recognise)
        },
        steps: Some(file_series::steps),
        ..PLAIN
    },
    Format {
        name: "VTK's collections",
        family: Family::Collections,
        endings: &collection::ENDINGS,
        reads: "multi-block and multi-piece data sets, partitioned data sets and collections of them, nested ones too: all \
                their files are drawn together (`info` and `io::open` take the first). Files lie beside the collection or \
                in folders below",
        begins: |p| collection::looks_like(p.head),
        read: |input, options| {
            collection::read_first(input, &collection::steps(input)?, options, recognise)
        },
        steps: Some(collection::steps),
        ..PLAIN
    },
    Format {
        name: "VTK XML",
        family: Family::Grids,
        endings: &[
            "vti", "vtr", "vts", "vtu", "vtp", "vthb", "vth", "pvti", "pvtr", "pvts", "pvtu",
            "pvtp",
        ],
        reads: "image data with Direction, rectilinear and structured grids, unstructured grids with polyhedra, \
                polygonal data, flat cells as [surfaces](#surfaces); ascii, base64, appended base64 and raw, zlib, LZ4 \
                and LZMA, 32- and 64-bit headers, both byte orders, point and cell data, several pieces put together; \
                levels of refinement (`vtkOverlappingAMR`, `vtkHierarchicalBoxDataSet`), of which the finest counts in \
                each place",
        begins: |p| vtk::xml::looks_like(p.head),
        read: |input, options| vtk::xml_kinds::read(input, options.read_as),
        planes: Some(|input, _| plane_source::of_vti(input)),
        ..PLAIN
    },
    Format {
        name: "legacy VTK",
        family: Family::Grids,
        endings: &["vtk"],
        reads: "versions 1 to 5, ascii and binary; structured points, rectilinear, structured and unstructured grids \
                (polyhedra too), polygonal data, flat cells as [surfaces](#surfaces); all attributes that are numbers. \
                Vertices and bare points become particles",
        begins: |p| p.head.starts_with(vtk::legacy::MAGIC),
        read: |input, options| vtk::legacy::read(input, options.read_as),
        ..PLAIN
    },
    Format {
        name: "PLY",
        family: Family::Meshes,
        endings: &["ply"],
        reads: "text and binary in either byte order: meshes with faces or strips, colours and texture coordinates; \
                splats in INRIA's layout, and PlayCanvas' compressed ones; points with columns: see \
                [tables](#tables)",
        begins: |p| ply::looks_like(p.head),
        read: ply::read,
        ..PLAIN
    },
    Format {
        name: "SPZ",
        family: Family::Splats,
        endings: &["spz"],
        reads: "versions 1 to 4, packed with gzip or not",
        begins: |p| spz::looks_like(p.head),
        read: |input, _| spz::read(input),
        ..PLAIN
    },
    Format {
        name: ".splat",
        family: Family::Splats,
        endings: &["splat"],
        reads: "records of 32 bytes",
        is_bare: true,
        read: |input, _| splat::read(input),
        ..PLAIN
    },
    // Before glTF, because both have an `asset`, and before the other archives.
    Format {
        name: "SOG",
        family: Family::Splats,
        endings: &["sog"],
        reads: "PlayCanvas' splats in lossless WebP images, versions 1 and 2: as the `meta.json` that names them, as the \
                folder that holds it, or bundled in a ZIP archive",
        begins: |p| sog::looks_like(p.input.path, p.head) || p.is_archive("sog", sog::is_archive),
        read: |input, _| sog::read(input),
        ..PLAIN
    },
    Format {
        name: "3MF",
        family: Family::Meshes,
        endings: &["3mf"],
        reads: "what is to be built, of objects and their components in their places, those of other models in the archive \
                too; colours of base materials and colour groups, textures; no composite materials, slices or beams. \
                Coordinates stay in the file's unit",
        begins: |p| p.is_archive("3mf", threemf::is_archive),
        read: |input, _| threemf::read(input),
        ..PLAIN
    },
    // Before the meshes of glTF files, because a glTF file may hold splats and meshes.
    Format {
        name: "KSPLAT",
        family: Family::Splats,
        endings: &["ksplat"],
        reads: "version 0.1, its compression modes 0 to 2, harmonics of degrees 0 to 2",
        read: |input, _| ksplat::read(input),
        ..PLAIN
    },
    // Before the other archives.
    Format {
        name: "USD splats",
        family: Family::Splats,
        endings: &["usda", "usdc", "usdz", "usd"],
        reads: "prims `ParticleField3DGaussianSplat`, and `ParticleField` with surflets, of one layer as text, in binary form \
                (from version 0.4) or in an archive; in floats and halves, with the transforms of their ancestors; the first \
                of samples in time. Other layers, variants and instances are not composed, and prims of other kinds are not \
                read",
        begins: |p| usd::looks_like(p.head) || p.is_archive("usdz", usd::is_archive),
        read: |input, _| usd::read(input),
        ..PLAIN
    },
    Format {
        name: "glTF splats",
        family: Family::Splats,
        endings: &[],
        reads: "`.glb` and `.gltf` with `KHR_gaussian_splatting`, its drafts' names too, in floats, bytes and shorts; packed as \
                SPZ by `KHR_gaussian_splatting_compression_spz_2`",
        begins: |p| gltf_splats::looks_like(p.input, p.head),
        read: |input, options| gltf_splats::read(input, options.scales),
        ..PLAIN
    },
    Format {
        name: "glTF",
        family: Family::Meshes,
        endings: &["glb", "gltf"],
        reads: "version 2 with transforms, sparse and interleaved accessors, strips and fans, vertex colours, base colour \
                and emissive textures (PNG, JPEG, WebP, KTX 2 in ETC1S and UASTC) with `KHR_texture_transform`, alpha \
                modes, morph targets and skins at rest; packed by `KHR_draco_mesh_compression`, `EXT_meshopt_compression` \
                or `KHR_meshopt_compression`, quantised or not; lines and points",
        begins: |p| gltf::looks_like(p.head),
        read: |input, _| gltf::read(input),
        ..PLAIN
    },
    // Before the other archives.
    Format {
        name: "OpenFOAM",
        family: Family::Simulations,
        endings: &["foam", "openfoam", "foam.zip"],
        reads: "cases, given as their folder, its `system/controlDict`, a `.foam` file in it or a ZIP archive of it: cells of \
                any shape with fields of cells and nodes, text and binary with labels and numbers of 32 and 64 bits, \
                packed with gzip or not, moving meshes, decomposed cases; the first of several regions; no patches, \
                values at faces or particles",
        begins: |p| openfoam::looks_like(p.head) || p.is_archive("foam.zip", openfoam::is_archive),
        read: |input, options| openfoam::read(input, options.time_step),
        steps: Some(openfoam::steps),
        ..PLAIN
    },
    Format {
        name: "NPZ",
        family: Family::Particles,
        endings: &["npz"],
        reads: "archives of NPY columns: see [tables](#tables)",
        begins: |p| p.head.starts_with(zip::MAGIC),
        read: |input, _| npz::read(input),
        ..PLAIN
    },
    // Before the other formats in HDF5 files.
    Format {
        name: "CGNS",
        family: Family::Grids,
        endings: &["cgns"],
        reads: "in HDF5: bases of structured and unstructured zones, drawn together; sections of first and second order, MIXED, NGON_n \
                and NFACE_n or ParentElements; solutions at nodes and cells without their rind, steps of time. Elements on the boundary \
                of others are left out with a note. No cylindrical coordinates, solutions of parts of a zone or links to \
                other files; ADF files are refused by name (adf2hdf turns them into HDF5)",
        begins: |p| {
            p.head.starts_with(hdf5::MAGIC) && (p.ends_in(&["cgns"]) || cgns::is_named(p.head))
        },
        read: |input, options| cgns::read(input, options.time_step, options.read_as),
        steps: Some(cgns::steps),
        ..PLAIN
    },
    // Before the particles of HDF5 files, because netCDF-4 files are HDF5 files.
    #[cfg(feature = "netcdf")]
    Format {
        name: "netCDF",
        family: Family::Grids,
        endings: netcdf::ENDINGS,
        reads: "classic, 64-bit, CDF-5 and netCDF-4 files. Exodus II: blocks of elements, nodal and element variables, \
                those whose names end in X, Y and Z as vectors. Grids by CF, ROMS and NEMO: see \
                [grids of the earth](#grids-of-the-earth)",
        begins: |p| netcdf::looks_like(p.head, p.ends_in(netcdf::ENDINGS)),
        read: |input, options| netcdf::read(input, options.time_step, options.read_as),
        steps: Some(netcdf::steps),
        ..PLAIN
    },
    Format {
        name: "VTKHDF",
        family: Family::Grids,
        endings: &["vtkhdf", "hdf"],
        reads: "image data with Direction, unstructured grids with polyhedra, polygonal data, in parts; overlapping AMR, of \
                which the finest level counts in each place; multi-block data sets and partitioned collections, whose \
                blocks are put together; steps of time",
        begins: |p| p.head.starts_with(hdf5::MAGIC) && hdf5::names_vtk(p.head),
        read: |input, options| hdf5::read(input, options),
        steps: Some(hdf5::vtk_steps),
        ..PLAIN
    },
    Format {
        name: "HDF5 particles",
        family: Family::Particles,
        endings: &["h5", "hdf5"],
        reads: "Phantom dumps; snapshots of Gadget, Gizmo, Arepo and SWIFT, whose lossy compression included \
                (`FMantissa9` ... `DMantissa21`, `HalfFloat`, `BFloat16`, `DScale`, integers of odd widths); fields in \
                other floating-point layouts are left out with a note. Any file of a snapshot in several files stands for \
                all of them. Which of their particles: \
                [below](#types-of-particles)",
        begins: |p| p.head.starts_with(hdf5::MAGIC),
        read: |input, options| hdf5::read(input, options),
        steps: Some(hdf5::snapshot_steps),
        ..PLAIN
    },
    Format {
        name: "Gadget's binary snapshots",
        family: Family::Particles,
        endings: &[],
        reads: "of Gadget-1 and Gadget-2 in formats 1 and 2 and either byte order, with numbers of 32 and 64 bits; any file of \
                a snapshot in several files (`NAME.0`, `NAME.1`, ...) stands for all of them. Which of their particles: \
                [below](#types-of-particles)",
        begins: |p| gadget::looks_like(p.head),
        read: |input, options| gadget::read(input, options.particle_type),
        steps: Some(gadget::steps),
        ..PLAIN
    },
    Format {
        name: "Phantom's native dumps",
        family: Family::Particles,
        endings: &[],
        reads: "full and small ones, in either byte order and precision, of one process or several; those that name their arrays \
                (since 2014). Which of their particles: [below](#types-of-particles)",
        begins: |p| phantom::native::looks_like(p.head),
        read: |input, options| phantom::native::read(input, options.particle_type),
        ..PLAIN
    },
    Format {
        name: "tipsy snapshots",
        family: Family::Particles,
        endings: &["tipsy", "tip"],
        reads: "of Gasoline, ChaNGa and PKDGRAV, in either byte order, whatever their name; softenings are not used as \
                lengths. Which of their particles: [below](#types-of-particles)",
        begins: |p| tipsy::looks_like(p.head, p.len),
        read: |input, options| tipsy::read(input, options.particle_type),
        ..PLAIN
    },
    Format {
        name: "AMReX plotfiles",
        family: Family::Simulations,
        endings: &[],
        reads: "of BoxLib and AMReX, given as a folder or its `Header`: all levels, of which the finest counts in each place; \
                IEEE numbers of 32 and 64 bits in either byte order; two and three dimensions, Cartesian",
        begins: |p| plotfile::looks_like(p.head),
        read: |input, _| plotfile::read(input),
        ..PLAIN
    },
    Format {
        name: "LAS",
        family: Family::Clouds,
        endings: &["las"],
        reads: "versions 1.0 to 1.4, formats of points 0 to 10, extra bytes; colours of bytes and words. Points that are \
                flagged as withheld are left out. LAZ is refused by name, with the commands that unpack it",
        begins: |p| p.head.starts_with(las::MAGIC),
        is_named: |p| p.ends_in(&["laz"]),
        read: |input, _| las::read(input),
        ..PLAIN
    },
    Format {
        name: "PCD",
        family: Family::Clouds,
        endings: &["pcd"],
        reads: "ascii, binary, binary_compressed; `rgb` and `rgba`; the viewpoint is left out with a note",
        begins: |p| pcd::looks_like(p.head),
        read: |input, _| pcd::read(input),
        ..PLAIN
    },
    #[cfg(feature = "e57")]
    Format {
        name: "E57",
        family: Family::Clouds,
        endings: &["e57"],
        reads: "all scans of a file in its coordinates (Cartesian or spherical), colours, intensities as they are stored",
        begins: |p| p.head.starts_with(b"ASTM-E57"),
        read: |input, _| e57::read(input),
        ..PLAIN
    },
    Format {
        name: "text point clouds",
        family: Family::Clouds,
        endings: &["pts"],
        reads: "lines of 3 to 10 numbers without names, also as `.xyz`, `.txt`, `.asc`: x, y, z, then by their numbers a \
                normal, a colour, an intensity; a count in the first line",
        begins: |p| p.ends_in(&["asc", "pts", "txt", "xyz"]) && p.is_text() && xyz::looks_like(p),
        resembles: |p| !p.ends_in(&["csv", "tsv"]) && p.is_text() && xyz::looks_like(p),
        read: |input, _| xyz::read(input),
        ..PLAIN
    },
    Format {
        name: "EnSight Gold",
        family: Family::Grids,
        endings: &["case"],
        reads: "the case file with its geometry and variables: text, C and Fortran binary in either byte order; elements of \
                all types, polygons and polyhedra, blocks (uniform, rectilinear, curvilinear, with iblank); scalars, vectors, \
                tensors by components and complex numbers of nodes and elements; time and file sets, several steps in \
                one file. EnSight 6 is refused by name",
        begins: |p| ensight::looks_like(p.head),
        read: |input, options| ensight::read(input, options.time_step, options.read_as),
        steps: Some(ensight::steps),
        ..PLAIN
    },
    Format {
        name: "Gmsh meshes",
        family: Family::Grids,
        endings: &["msh", "gmsh"],
        reads: "versions 2, 4.0 and 4.1, text and binary in either byte order: elements of first and second order \
                (of higher orders the corners), nodes with parameters, partitions; physical groups and entities as fields of cells; \
                results at nodes, in elements and at the nodes of elements (means at shared nodes), steps of time. Elements on \
                the boundary of others are left out with a note. No polygons, polyhedra, `.geo` or `.pos`",
        begins: |p| gmsh::looks_like(p.head),
        read: |input, options| gmsh::read(input, options.time_step, options.read_as),
        steps: Some(gmsh::steps),
        ..PLAIN
    },
    Format {
        name: "XDMF",
        family: Family::Grids,
        endings: &["xdmf", "xmf", "xdmf2", "xdmf3"],
        reads: "versions 2 and 3: uniform grids, and collections in space and time (steps); elements of first and second order, mixed \
                lists, polyhedra, points; uniform, rectilinear and curvilinear grids; attributes at nodes and cells; numbers in the file, in \
                HDF5 or binary files beside it, parts of them (HyperSlab) and `JOIN`; references and `xi:include` within the file. \
                Attributes of other places, functions of finite elements and other functions are not read",
        begins: |p| xdmf::looks_like(p.head),
        read: |input, options| xdmf::read(input, options.time_step, options.read_as),
        steps: Some(xdmf::steps),
        ..PLAIN
    },
    Format {
        name: "Nek5000",
        family: Family::Simulations,
        endings: &["nek5000", "nek"],
        reads: "field files of Nek5000 and NekRS (`NAME0.f00001`) of 32 and 64 bits in either byte order, and the files that name those of \
                each time: elements of two and three dimensions as linear cells between their nodes, velocity, pressure, temperature and \
                scalars; positions that only an earlier file beside it has; several files of one time are drawn together. No `.re2`, \
                `.rea` or files from before `#std`",
        begins: |p| nek::looks_like(p.head),
        read: |input, options| nek::read(input, options, recognise),
        steps: Some(nek::steps),
        ..PLAIN
    },
    Format {
        name: "OBJ",
        family: Family::Meshes,
        endings: &["obj"],
        reads: "polygons of any shape, lines and points, MTL, `--texture FILE` where it names none; normals and texture coordinates that are \
                not there are left out with a note",
        resembles: |p| obj::looks_like(p.head),
        read: |input, options| obj::read(input, options.texture.as_deref()),
        ..PLAIN
    },
    Format {
        name: "STL",
        family: Family::Meshes,
        endings: &["stl"],
        reads: "text and binary, with the colours of VisCAM, SolidView and Materialise",
        is_bare: true,
        resembles: |p| stl::looks_like(p.head, p.len),
        read: |input, _| stl::read(input),
        ..PLAIN
    },
    // Before tables, because Tecplot files may have the names of tables.
    Format {
        name: "Tecplot",
        family: Family::Simulations,
        endings: &["tec"],
        reads: "text (`.dat`, `.plt`, too, where the content says so): ordered zones and those of lines, triangles, \
                quadrilaterals, tetrahedra and bricks, by points and by blocks, variables at nodes and cells, repeated \
                numbers, shared variables, steps of time; zones of one layer as [surfaces](#surfaces); no polygons, \
                polyhedra or binary files",
        begins: |p| p.is_text() && tecplot::looks_like(p.head),
        read: |input, options| tecplot::read(input, options.time_step, options.read_as),
        steps: Some(tecplot::steps),
        ..PLAIN
    },
    Format {
        name: "CSV",
        family: Family::Particles,
        endings: &["csv", "tsv"],
        reads: "columns of particles with a line of names: see [tables](#tables)",
        begins: |p| p.is_text() && csv::names_positions(p.head),
        // Tables without x, y and z are accepted here: the reader reports the missing columns.
        resembles: |p| {
            p.is_text() && !refused::is_named(p.input.path) && csv::looks_like_table(p.head)
        },
        read: |input, _| csv::read(input),
        ..PLAIN
    },
    Format {
        name: "LAMMPS dumps",
        family: Family::Particles,
        endings: &["lammpstrj", "dump"],
        reads: "text of the styles atom and custom, whatever its name: positions of any kind, orthogonal, sheared and general boxes, all \
                columns; steps of time. Binary dumps are refused by name. See [atoms](#atoms)",
        begins: |p| lammps::looks_like(p.head),
        read: |input, options| lammps::read(input, options.time_step),
        steps: Some(lammps::steps),
        ..PLAIN
    },
    Format {
        name: "XYZ of atoms",
        family: Family::Particles,
        endings: &["extxyz"],
        reads: "extended XYZ (`Properties`, `Lattice`, `pbc`, `Origin`) and plain XYZ of molecules, also as `.xyz`; several \
                frames as steps of time. See [atoms](#atoms)",
        begins: |p| p.is_text() && atoms::looks_like(p.head),
        read: |input, options| atoms::read(input, options.time_step),
        steps: Some(atoms::steps),
        ..PLAIN
    },
    Format {
        name: "GROMACS structures",
        family: Family::Particles,
        endings: &["gro"],
        reads: "columns of any precision, with velocities or without; several frames as steps of time. See [atoms](#atoms)",
        begins: |p| p.is_text() && gro::looks_like(p.head),
        read: |input, options| gro::read(input, options.time_step),
        steps: Some(gro::steps),
        ..PLAIN
    },
    Format {
        name: "series of images",
        family: Family::Volumes,
        endings: &[],
        reads: "numbered PNG, JPEG, WebP and TIFF files as layers of one volume, by a pattern: `slice_%03d.png`; a number that is \
                missing is an error. Layers lie a step of the pixels apart: `--resize 1,1,2` moves them",
        is_pattern: image_series::is_pattern,
        read: |input, _| image_series::read(input),
        ..PLAIN
    },
    Format {
        name: "raw volumes",
        family: Family::Volumes,
        endings: &["raw", "raw.gz"],
        reads: "`--dims X,Y,Z --type u8,i16,u16,f32 --endian little,big --spacing --origin`; x fastest",
        is_named: |p| p.options.raw.is_some(),
        read: |input, options| raw::read(input, options.raw.as_ref()),
        planes: Some(|input, options| plane_source::of_raw(input, options.raw.as_ref())),
        ..PLAIN
    },
    Format {
        name: "packed files",
        family: Family::Collections,
        endings: packed::ENDINGS,
        reads: "files of the other formats that gzip has packed, unpacked in memory: VTK, Tecplot, tables, atoms and whatever \
                begins as what it is",
        begins: |p| packed::is_under_plain_name(p, recognise),
        resembles: |p| packed::looks_like(p, recognise),
        read: |input, options| packed::read(input, options, recognise),
        steps: Some(|input| packed::steps(input, recognise)),
        ..PLAIN
    },
    Format {
        name: "PLOT3D",
        family: Family::Grids,
        endings: &["xyz", "x", "g", "p3d", "p3dx", "q", "f", "fun"],
        reads: "one or several grids of three dimensions or two, binary (f32 or f64, either byte order, with or without record marks) or text, with \
                or without iblank, all detected, also as `.bin`; its solution (`.q`) and its functions (`.f`, `.fun`) \
                beside it, or one of them by `--solution`. Fields: density, momentum, energy, and derived velocity \
                magnitude, pressure, Mach; functions by their names in a `.nam` beside them, or `f1`, `f2`, ...",
        resembles: |p| plot3d::looks_like(p.head, p.len, p.ends_in(&["bin"])),
        read: |input, options| plot3d::read(input, options.solution.as_deref()),
        ..PLAIN
    },
];
