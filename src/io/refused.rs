//! Refuses known formats that are not read, by name and with advice, from one table.
//!
//! The content takes precedence over the name: signatures, words of text, members of HDF5 files.

use std::path::Path;

use super::bytes::zip;
use super::volume::voxels::GZIP;
use crate::error::{Error, Hint};

/// A format that is not read.
struct Refused {
    /// The format's name with an article, for messages.
    name: &'static str,
    /// Extensions of its files, in lower case, without the leading dot.
    endings: &'static [&'static str],
    /// Signatures: an offset, and the bytes there; any of these.
    magic: &'static [(usize, &'static [u8])],
    /// Whether text is of this format; for binary bytes see [`Refused::is_binary`].
    is_text: fn(&str) -> bool,
    /// Whether bytes, from a file of the given length, are of this format although it has no signature.
    is_binary: fn(&[u8], u64) -> bool,
    /// Members of the root of HDF5 files, any of these.
    members: &'static [&'static str],
    /// Advice for the user.
    advice: &'static str,
}

/// Least length of a signature that takes precedence over a file's name.
const STRONG: usize = 4;

/// JSON files that index other files: their keys, their kind, and the advice.
const INDICES: &[(&[&str], &str, &str)] = &[
    (
        &["lodLevels", "filenames"],
        "an index of levels of detail that a viewer of splats streams, not splats",
        "give the SOG (`meta.json`) of one of the folders that it names, or save the scene as PLY, SPZ or SOG",
    ),
    (
        &["geometricError", "root"],
        "a tileset of 3D Tiles, which names its tiles",
        "give one of the tiles (.glb)",
    ),
];

/// The kind of a JSON file that indexes other files, and the advice; `has` returns whether it has a key.
pub(super) fn index(has: impl Fn(&str) -> bool) -> Option<(&'static str, &'static str)> {
    let mut known = INDICES.iter();
    let (_, name, advice) = known.find(|(keys, ..)| keys.iter().all(|key| has(key)))?;
    Some((*name, *advice))
}

const MESH: &str = "save it as glTF (.glb)";
const GRID: &str =
    "save it as VTK XML (.vtu, .vts) with ParaView, or `meshio convert FILE out.vtu`";
const OF_HDF5: &str =
    "save it as VTK XML (.vtu, .vti) or VTKHDF with ParaView, particles as CSV or NPY";
const ATOMS: &str = "save the atoms as extended XYZ, or as a table with columns x,y,z (CSV, NPY): OVITO, ASE and MDAnalysis read it";
const PARTICLES: &str = "save the particles as a table with columns x,y,z (CSV, NPY) or as PLY";
const IMAGE: &str = "an image holds no volume: give a data file";
const SPLATS: &str = "save them as SPZ or PLY with the program that wrote them";
const TABLE: &str = "save it as CSV or NPY with columns x,y,z";

/// The defaults of a row of the table.
const PLAIN: Refused = Refused {
    name: "",
    endings: &[],
    magic: &[],
    is_text: |_| false,
    is_binary: |_, _| false,
    members: &[],
    advice: "",
};

/// The table, in the order in which rows are tried: signatures and words before names alone.
static REFUSED: &[Refused] = &[
    // Results of simulation codes, and their grids.
    Refused {
        name: "a CGNS file in the old ADF container",
        magic: &[(4, b"ADF Database")],
        advice: "turn it into HDF5: `adf2hdf FILE out.cgns`",
        ..PLAIN
    },
    Refused {
        name: "a CGNS file under another name",
        members: &["CGNSLibraryVersion", " hdf5version"],
        advice: "give it a name that ends in .cgns",
        ..PLAIN
    },
    Refused {
        name: "a Gmsh file of version 1, or with results alone",
        endings: &["pos"],
        magic: &[(0, b"$NOD"), (0, b"$PostFormat")],
        advice: "save it as version 4.1: `gmsh FILE -save -format msh41 -o out.msh`",
        ..PLAIN
    },
    Refused {
        name: "a Fluent file",
        endings: &["cas", "cas.gz", "cas.h5", "dat.h5", "msh.h5"],
        magic: &[
            (0, b"(0 \""),
            (0, b"(0\""),
            (0, b"(1 \""),
            (0, b"(1\""),
            (0, b"(2 2)"),
            (0, b"(2 3)"),
        ],
        members: &["meshes"],
        advice: "export it as EnSight Gold or save it as VTK XML (.vtu) with ParaView",
        ..PLAIN
    },
    Refused {
        name: "a Medit mesh",
        endings: &["mesh", "meshb"],
        is_text: |text| first_word(text, '#') == "MeshVersionFormatted",
        advice: GRID,
        ..PLAIN
    },
    Refused {
        name: "an SU2 file",
        endings: &["su2"],
        is_text: |text| {
            has_line(text, |line| {
                line.starts_with("NDIME=") || line.starts_with("NDIME ")
            })
        },
        advice: "let SU2 write VTK XML (OUTPUT_FILES= PARAVIEW), or `meshio convert FILE out.vtu`",
        ..PLAIN
    },
    Refused {
        name: "an Abaqus or CalculiX file",
        endings: &["inp"],
        is_text: is_abaqus,
        advice: GRID,
        ..PLAIN
    },
    Refused {
        name: "a CalculiX result",
        endings: &["frd"],
        is_text: |text| text.starts_with("    1C"),
        advice: "turn it into VTK XML with ccx2paraview",
        ..PLAIN
    },
    Refused {
        name: "a Nastran file",
        endings: &["bdf", "nas", "op2", "fem"],
        is_text: is_nastran,
        advice: GRID,
        ..PLAIN
    },
    Refused {
        name: "a UGRID file",
        endings: &["ugrid"],
        advice: GRID,
        ..PLAIN
    },
    Refused {
        name: "a MED file",
        endings: &["med", "rmed", "mmed"],
        members: &["ENS_MAA", "INFOS_GENERALES"],
        advice: GRID,
        ..PLAIN
    },
    Refused {
        name: "a mesh or an old file of Nek5000",
        endings: &["re2", "rea"],
        magic: &[(0, b"#v001"), (0, b"#v002"), (0, b"#v003")],
        advice: "give the field files of the run (NAME0.f00001, `#std`), or the .nek5000 file",
        ..PLAIN
    },
    Refused {
        name: "a geometry or variable of EnSight",
        is_text: |text| text.starts_with("EnSight "),
        magic: &[(0, b"C Binary"), (4, b"Fortran Binary")],
        advice: "give the .case file that names it",
        ..PLAIN
    },
    Refused {
        name: "a binary Tecplot file",
        endings: &["szplt"],
        magic: &[(0, b"#!TDV"), (0, b"#!SZPLT")],
        advice: "save it as text (.dat), or as VTK XML",
        ..PLAIN
    },
    Refused {
        name: "a state of ParaView",
        endings: &["pvsm"],
        is_text: |text| is_xml(text, &["<ParaView>", "<ServerManagerState"]),
        advice: "give the data files that it names",
        ..PLAIN
    },
    Refused {
        name: "a Silo file",
        endings: &["silo"],
        magic: &[(0, b"!<<PDB:II>>!")],
        members: &["_silolibinfo", ".silo"],
        advice: "save it as VTK XML with VisIt",
        ..PLAIN
    },
    Refused {
        name: "a FLASH file",
        members: &["sim info", "integer scalars", "refine level"],
        advice: "save its grid as VTK XML, or resample it with yt",
        ..PLAIN
    },
    Refused {
        name: "a Chombo file",
        members: &["Chombo_global"],
        advice: "save its grid as VTK XML with VisIt, or resample it with yt",
        ..PLAIN
    },
    Refused {
        name: "an Athena++ file",
        endings: &["athdf"],
        members: &["x1f", "MeshBlockLogicalLocations"],
        advice: "let Athena++ write VTK (file_type = vtk), or resample it with yt",
        ..PLAIN
    },
    Refused {
        name: "an HDF4 file",
        magic: &[(0, b"\x0e\x03\x13\x01")],
        advice: "turn it into netCDF or HDF5 with h4toh5 or ncdump",
        ..PLAIN
    },
    Refused {
        name: "a GRIB file",
        endings: &["grib", "grb", "grib2", "grb2"],
        magic: &[(0, b"GRIB")],
        advice: "turn it into netCDF: `cdo -f nc copy FILE out.nc`",
        ..PLAIN
    },
    #[cfg(not(feature = "netcdf"))]
    Refused {
        name: "a netCDF or Exodus file",
        magic: &[(0, b"CDF\x01"), (0, b"CDF\x02"), (0, b"CDF\x05")],
        advice: "build with the feature `netcdf`, or save it as VTK XML (.vtu)",
        ..PLAIN
    },
    // Images of scanners, and volumes.
    #[cfg(not(feature = "dicom"))]
    Refused {
        name: "a DICOM file",
        magic: &[(128, b"DICM")],
        advice: "build with the feature `dicom`, or save the series as NIfTI or NRRD",
        ..PLAIN
    },
    Refused {
        name: "a MINC file",
        endings: &["mnc", "mnc2"],
        members: &["minc-2.0"],
        advice: "save it as NIfTI: `mnc2nii FILE out.nii`",
        ..PLAIN
    },
    Refused {
        name: "an AFNI header",
        endings: &["head"],
        is_text: |text| has_line(text, is_afni),
        advice: "save it as NIfTI: `3dAFNItoNIFTI FILE`",
        ..PLAIN
    },
    Refused {
        name: "an AFNI data set",
        endings: &["brik", "brik.gz", "brik.bz2"],
        advice: "save it as NIfTI: `3dAFNItoNIFTI FILE`",
        ..PLAIN
    },
    Refused {
        name: "a PAR/REC file of Philips",
        endings: &["par", "rec"],
        is_text: |text| text.contains("DATA DESCRIPTION FILE") && text.contains("# "),
        advice: "save it as NIfTI: `parrec2nii FILE`, or dcm2niix",
        ..PLAIN
    },
    Refused {
        name: "an MGH file of FreeSurfer",
        endings: &["mgh", "mgz"],
        advice: "save it as NIfTI: `mri_convert FILE out.nii`",
        ..PLAIN
    },
    Refused {
        name: "a colour table (.cube)",
        is_text: |text| {
            has_line(text, |line| {
                line.starts_with("LUT_3D_SIZE") || line.starts_with("LUT_1D_SIZE")
            })
        },
        advice: "it holds colours for films, no data: give a data file",
        ..PLAIN
    },
    Refused {
        name: "a Gaussian cube file",
        endings: &["cube", "cub"],
        is_text: is_cube,
        advice: "save its grid as NRRD or VTK XML (.vti): ASE and PyVista read it",
        ..PLAIN
    },
    Refused {
        name: "an MRC map",
        endings: &["mrc", "ccp4", "map"],
        magic: &[(208, b"MAP ")],
        advice: "save it as NRRD or TIFF: mrcfile (Python) and IMOD's mrc2tif read it",
        ..PLAIN
    },
    Refused {
        name: "a FITS file",
        endings: &["fits", "fit", "fts"],
        magic: &[(0, b"SIMPLE  =")],
        advice: "save its cube as NRRD or TIFF, its table as CSV or NPY: astropy reads it",
        ..PLAIN
    },
    Refused {
        name: "an Imaris file",
        endings: &["ims"],
        members: &["DataSetInfo"],
        advice: "save it as TIFF or NRRD: Fiji reads it",
        ..PLAIN
    },
    Refused {
        name: "an OpenVDB or NanoVDB file",
        endings: &["vdb", "nvdb"],
        magic: &[(0, b" BDV"), (0, b"NanoVDB")],
        advice: "save its grids as NRRD or VTK XML (.vti), and its points as PLY",
        ..PLAIN
    },
    Refused {
        name: "a Zarr array or group",
        endings: &["zarr", "zarr.zip", "zarray", "zgroup", "zattrs", "n5"],
        is_text: |text| text.trim_start().starts_with('{') && text.contains("\"zarr_"),
        advice: "save it as NRRD, NPY or netCDF: zarr and xarray (Python) read it",
        ..PLAIN
    },
    // Particles.
    Refused {
        name: "a binary LAMMPS dump",
        magic: &[(8, b"DUMPATOM"), (8, b"DUMPCUSTOM")],
        advice: "turn it into text with LAMMPS's binary2txt, or let LAMMPS write text (a name without .bin)",
        ..PLAIN
    },
    Refused {
        name: "a LAMMPS data file",
        endings: &["lmp", "lammps"],
        is_text: is_lammps,
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "a GROMACS file",
        endings: &["xtc", "trr", "tng", "tpr"],
        magic: &[(12, b"GMX_trn_file")],
        is_binary: |head, _| {
            let word = |at: usize| head.get(at..at + 4);
            word(0) == Some(&1995_u32.to_be_bytes()) && word(4).is_some() && word(4) == word(52)
        },
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "a DCD trajectory",
        endings: &["dcd"],
        magic: &[(4, b"CORD")],
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "an H5MD trajectory",
        endings: &["h5md"],
        members: &["h5md"],
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "a file of atoms (PDB)",
        endings: &["ent"],
        is_text: is_protein,
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "a file of atoms",
        endings: &["cif", "mmcif", "mol", "mol2", "sdf", "poscar", "contcar"],
        is_text: |text| text.starts_with("@<TRIPOS>") || text.contains("\n_atom_site"),
        advice: ATOMS,
        ..PLAIN
    },
    Refused {
        name: "a Houdini geometry",
        endings: &["bgeo", "bgeo.gz", "bgeo.sc", "geo.gz"],
        magic: &[
            (0, b"Bgeo"),
            (0, b"\x7fNSJb"),
            (0, b"PGEOMETRY"),
            (0, b"scf1"),
        ],
        is_text: |text| text.trim_start().starts_with('[') && text.contains("\"fileversion\""),
        advice: PARTICLES,
        ..PLAIN
    },
    Refused {
        name: "a geometry of EnSight, Gmsh or Houdini",
        endings: &["geo"],
        advice: "give EnSight's .case file; save others as PLY or VTK XML",
        ..PLAIN
    },
    Refused {
        name: "a particle cache (PDB) or a file of atoms (PDB)",
        endings: &["pdb"],
        advice: PARTICLES,
        ..PLAIN
    },
    Refused {
        name: "particles of partio (PTC, PDA, PDC, MC)",
        endings: &["ptc", "pda", "pdc", "prt", "rib"],
        advice: PARTICLES,
        ..PLAIN
    },
    Refused {
        name: "an Alembic file",
        endings: &["abc"],
        magic: &[(0, b"Ogawa")],
        members: &["ABC"],
        advice: PARTICLES,
        ..PLAIN
    },
    #[cfg(not(feature = "e57"))]
    Refused {
        name: "an E57 file",
        magic: &[(0, b"ASTM-E57")],
        advice: "build with the feature e57, or save it as LAS or PLY",
        ..PLAIN
    },
    // Meshes and scenes.
    Refused {
        name: "an OFF mesh",
        endings: &["off"],
        magic: &[(0, b"OFF BINARY")],
        is_text: |text| {
            let word = first_word(text, '#');
            [
                "OFF", "COFF", "NOFF", "CNOFF", "STOFF", "STCOFF", "4OFF", "nOFF",
            ]
            .contains(&word)
        },
        advice: "save it as PLY, or as glTF (.glb)",
        ..PLAIN
    },
    Refused {
        name: "a COLLADA file",
        endings: &["dae"],
        is_text: |text| is_xml(text, &["<COLLADA"]),
        advice: MESH,
        ..PLAIN
    },
    Refused {
        name: "a library of materials (MTL)",
        endings: &["mtl"],
        is_text: |text| first_word(text, '#') == "newmtl",
        advice: "give the OBJ file that names it",
        ..PLAIN
    },
    Refused {
        name: "an FBX file",
        endings: &["fbx"],
        magic: &[(0, b"Kaydara FBX"), (0, b"; FBX ")],
        advice: MESH,
        ..PLAIN
    },
    Refused {
        name: "a Blender file",
        endings: &["blend", "blend1"],
        magic: &[(0, b"BLENDER")],
        advice: MESH,
        ..PLAIN
    },
    Refused {
        name: "a scene in VRML or X3D",
        endings: &["wrl", "vrml", "x3d", "x3dv"],
        is_text: |text| {
            text.starts_with("#VRML") || text.starts_with("#X3D") || is_xml(text, &["<X3D"])
        },
        advice: MESH,
        ..PLAIN
    },
    Refused {
        name: "a CAD file",
        endings: &[
            "step", "stp", "iges", "igs", "dxf", "dwg", "brep", "3dm", "sldprt",
        ],
        is_text: |text| text.starts_with("ISO-10303-21"),
        advice: "tessellate it: save it as STL, PLY or glTF (.glb)",
        ..PLAIN
    },
    Refused {
        name: "a 3DS, LightWave, Maya or Cinema 4D file",
        endings: &["3ds", "max", "lwo", "ma", "mb", "c4d"],
        advice: MESH,
        ..PLAIN
    },
    // Splats.
    Refused {
        name: "splats in .rad",
        endings: &["rad"],
        magic: &[(0, b"RAD0")],
        advice: SPLATS,
        ..PLAIN
    },
    Refused {
        name: "splats in LCC",
        endings: &["lcc"],
        advice: SPLATS,
        ..PLAIN
    },
    // Tables and archives of other programs.
    Refused {
        name: "a MATLAB file",
        endings: &["mat"],
        magic: &[(0, b"MATLAB ")],
        advice: "save particles as CSV (writetable), volumes as NRRD or raw numbers",
        ..PLAIN
    },
    Refused {
        name: "a Parquet file",
        endings: &["parquet"],
        magic: &[(0, b"PAR1")],
        advice: TABLE,
        ..PLAIN
    },
    Refused {
        name: "a spreadsheet",
        endings: &["xlsx", "xls", "ods"],
        advice: TABLE,
        ..PLAIN
    },
    Refused {
        name: "a ROOT file",
        endings: &["root"],
        magic: &[(0, b"root\0\0")],
        advice: TABLE,
        ..PLAIN
    },
    Refused {
        name: "pickled Python objects",
        endings: &["pkl", "pickle"],
        advice: "save the arrays with numpy.save or numpy.savez",
        ..PLAIN
    },
    // Pictures and papers.
    Refused {
        name: "a PNG image",
        magic: &[(0, b"\x89PNG")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a JPEG image",
        magic: &[(0, b"\xff\xd8\xff")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a WebP image",
        magic: &[(8, b"WEBP")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a KTX image",
        magic: &[(0, b"\xabKTX")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a PFM image",
        magic: &[(0, b"PF\n"), (0, b"Pf\n")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "an EXR image",
        magic: &[(0, b"\x76\x2f\x31\x01")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a GIF image",
        magic: &[(0, b"GIF87a"), (0, b"GIF89a")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a BMP image",
        endings: &["bmp"],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "an SVG image",
        endings: &["svg"],
        is_text: |text| is_xml(text, &["<svg"]),
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a PDF document",
        magic: &[(0, b"%PDF")],
        advice: IMAGE,
        ..PLAIN
    },
    Refused {
        name: "a web page",
        endings: &["html", "htm"],
        is_text: |text| {
            let start: String = text.trim_start().chars().take(15).collect();
            let start = start.to_ascii_lowercase();
            start.starts_with("<!doctype html") || start.starts_with("<html")
        },
        advice: "the data were not what was downloaded: get the file itself",
        ..PLAIN
    },
    Refused {
        name: "a pointer of Git LFS",
        is_text: |text| text.starts_with("version https://git-lfs"),
        advice: "get the file itself: `git lfs pull`",
        ..PLAIN
    },
    Refused {
        name: "a Zstandard, xz, bzip2 or LZ4 archive",
        endings: &["zst", "xz", "bz2", "lz4"],
        magic: &[
            (0, b"\x28\xb5\x2f\xfd"),
            (0, b"\xfd7zXZ"),
            (0, b"BZh9"),
            (0, b"\x04\x22\x4d\x18"),
        ],
        advice: "unpack it (zstd -d, unxz, bunzip2, lz4 -d)",
        ..PLAIN
    },
    Refused {
        name: "a tar, 7-Zip or RAR archive",
        endings: &["tar", "tgz", "tar.gz", "7z", "rar"],
        magic: &[(257, b"ustar"), (0, b"7z\xbc\xaf"), (0, b"Rar!")],
        advice: "unpack it and give the data file in it",
        ..PLAIN
    },
];

/// The error for a file whose content identifies a refused format, whatever its name is.
///
/// - `is_bare`: whether its name is that of a format whose files may begin with any bytes.
pub(super) fn by_content(path: &Path, head: &[u8], len: u64, is_bare: bool) -> Option<Error> {
    let text = text_of(head);
    let is_it = |row: &&Refused| {
        let is_signed = !is_bare && row.is_signed(head, STRONG);
        is_signed || text.is_some_and(row.is_text) || text.is_none() && (row.is_binary)(head, len)
    };
    let by_row = || REFUSED.iter().find(is_it).map(|row| row.refuse(path));
    let json = text.filter(|text| text.trim_start().starts_with('{'));
    let by_keys = json.and_then(|text| index(|key| text.contains(&format!("\"{key}\""))));
    let of_index = by_keys.map(|(name, advice)| refuse(path, name, advice));
    of_index.or_else(by_row)
}

/// The error for a file whose first bytes or name identify a refused format.
pub(super) fn by_name(path: &Path, head: &[u8]) -> Option<Error> {
    let signed = REFUSED.iter().find(|row| row.is_signed(head, 1));
    if let Some(row) = signed.or_else(|| named(path)) {
        return Some(row.refuse(path));
    }
    let is_packed = head.starts_with(GZIP);
    is_packed.then(|| refuse(path, "a gzip archive", Hint::UnpackOrGiveLayout))
}

/// Whether a name is that of a format that is not read.
pub(super) fn is_named(path: &Path) -> bool {
    named(path).is_some()
}

/// The error for a ZIP archive whose name identifies a refused format.
pub(super) fn archive(path: &Path, head: &[u8]) -> Option<Error> {
    let is_archive = head.starts_with(zip::MAGIC);
    let row = named(path).filter(|_| is_archive);
    row.map(|row| row.refuse(path))
}

/// The error for a folder whose content identifies a refused format.
pub(crate) fn folder(path: &Path) -> Option<Error> {
    let holds = |name: &&str| path.join(name).is_file();
    let row = REFUSED.iter().find(|row| row.endings.contains(&"zarr"))?;
    let is_named = || named(path).is_some_and(|named| std::ptr::eq(named, row));
    let mut marks = ["zarr.json", ".zarray", ".zgroup"].iter();
    let is_zarr = path.is_dir() && (marks.any(holds) || is_named());
    is_zarr.then(|| row.refuse(path))
}

/// The error for an HDF5 file that is not read.
///
/// - `members`: names of the members of its root.
pub(super) fn hdf5(path: &Path, members: &[String]) -> Error {
    let has = |name: &&str| members.iter().any(|member| member == name);
    let by_members = REFUSED.iter().find(|row| row.members.iter().any(has));
    if let Some(row) = by_members.or_else(|| named(path)) {
        return row.refuse(path);
    }
    let list = super::particles::table::list(members.iter().map(String::as_str));
    let index = ["xdmf", "xmf"].map(|ending| path.with_extension(ending));
    let of_index = index.iter().find(|index| index.is_file());
    if let Some(index) = of_index.and_then(|index| index.file_name()) {
        let index = index.to_string_lossy();
        let found = format!("the numbers of `{index}`");
        let advice = format!("give `{index}`");
        return Error::format(
            path,
            "format",
            "a file that says what its numbers are",
            found,
            advice,
        );
    }
    let found = format!("an HDF5 file of no format that is read, whose root holds {list}");
    let expected = "VTKHDF, netCDF-4, or particles in `PartType0/Coordinates` (Gadget, SWIFT) or `particles/xyz` (Phantom)";
    Error::format(path, "format", expected, found, OF_HDF5)
}

/// The error for a netCDF file if its variables have the names of MINC's.
#[cfg(feature = "netcdf")]
pub(super) fn minc<'a>(path: &Path, mut variables: impl Iterator<Item = &'a str>) -> Option<Error> {
    let is_minc = variables.any(|name| ["rootvariable", "image-max"].contains(&name));
    let row = || REFUSED.iter().find(|row| row.endings.contains(&"mnc"));
    is_minc.then(row).flatten().map(|row| row.refuse(path))
}

impl Refused {
    /// Whether a file begins with one of the row's signatures of at least `least` bytes.
    fn is_signed(&self, head: &[u8], least: usize) -> bool {
        let mut magic = self.magic.iter().filter(|(_, bytes)| bytes.len() >= least);
        magic.any(|(at, bytes)| head.get(*at..).is_some_and(|rest| rest.starts_with(bytes)))
    }

    fn refuse(&self, path: &Path) -> Error {
        refuse(path, self.name, self.advice)
    }
}

fn refuse(path: &Path, name: &str, advice: impl Into<crate::error::Advice>) -> Error {
    let found = format!("{name}, which is not read");
    Error::format(path, "format", "a format that is read", found, advice)
}

/// The row for a file name.
fn named(path: &Path) -> Option<&'static Refused> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let ends = |ending: &&str| {
        let rest = name.strip_suffix(*ending);
        rest.is_some_and(|rest| rest.ends_with('.'))
    };
    // Nek5000 numbers its files: channel0.f00001.
    let is_numbered = name
        .rsplit_once(".f")
        .is_some_and(|(_, digits)| digits.len() == 5 && digits.bytes().all(|b| b.is_ascii_digit()));
    let of_nek = || REFUSED.iter().find(|row| row.endings.contains(&"re2"));
    let of_ending = || REFUSED.iter().find(|row| row.endings.iter().any(ends));
    if is_numbered { of_nek() } else { of_ending() }
}

/// The first bytes as text, without a byte order mark or a cut character; `None` if they are binary.
fn text_of(head: &[u8]) -> Option<&str> {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let is_control = |b: &u8| *b < 0x20 && !b.is_ascii_whitespace();
    if head.iter().any(is_control) {
        return None;
    }
    match str::from_utf8(head) {
        Ok(text) => Some(text),
        Err(error) => str::from_utf8(&head[..error.valid_up_to()]).ok(),
    }
}

/// The first word of a text outside comments, which extend from `mark` to the end of a line.
fn first_word(text: &str, mark: char) -> &str {
    let lines = text.lines().map(str::trim);
    let mut lines = lines.filter(|line| !line.is_empty() && !line.starts_with(mark));
    let first = lines.next().unwrap_or_default();
    first.split_whitespace().next().unwrap_or_default()
}

/// Whether a text is XML with one of these in its first bytes.
fn is_xml(text: &str, marks: &[&str]) -> bool {
    text.trim_start().starts_with('<') && marks.iter().any(|mark| text.contains(mark))
}

fn has_line(text: &str, is_it: impl Fn(&str) -> bool) -> bool {
    text.lines().any(|line| is_it(line.trim_start()))
}

/// `*NODE`, `*Heading`: a keyword in the first line that is no comment (`**`).
fn is_abaqus(text: &str) -> bool {
    const KEYWORDS: [&str; 12] = [
        "heading",
        "node",
        "element",
        "part",
        "include",
        "preprint",
        "assembly",
        "parameter",
        "nset",
        "elset",
        "material",
        "system",
    ];
    let mut lines = text.lines().map(str::trim);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with("**"));
    let keyword = first
        .and_then(|line| line.strip_prefix('*'))
        .unwrap_or_default();
    let keyword = keyword.split([',', ' ']).next().unwrap_or_default();
    KEYWORDS
        .iter()
        .any(|known| keyword.eq_ignore_ascii_case(known))
}

/// Lines of a bulk data deck: fields of eight characters, or separated by commas.
fn is_nastran(text: &str) -> bool {
    let is_card = |line: &str| {
        let line = line.trim_end();
        let starts = |card: &str| {
            line.get(..card.len())
                .is_some_and(|start| start.eq_ignore_ascii_case(card))
        };
        let of_deck = ["BEGIN BULK", "ENDDATA"].iter().any(|card| starts(card)) || line == "CEND";
        let mut cards = ["GRID", "CQUAD4", "CTRIA3", "CTETRA", "CHEXA"].iter();
        let has_fields = |card: &str| {
            let rest = line.get(card.len()..).unwrap_or_default();
            let is_apart = rest.starts_with(['*', ',']) || rest.starts_with("  ");
            starts(card) && is_apart && rest.contains(|c: char| c.is_ascii_digit())
        };
        of_deck || cards.any(|card| has_fields(card))
    };
    text.lines().any(is_card)
}

/// `type = string-attribute`, as AFNI writes before each attribute.
fn is_afni(line: &str) -> bool {
    let value = line.strip_prefix("type").map(str::trim_start);
    let value = value.and_then(|rest| rest.strip_prefix('=')).map(str::trim);
    value.is_some_and(|value| {
        ["string-attribute", "integer-attribute", "float-attribute"].contains(&value)
    })
}

fn numbers(line: &str) -> Option<Vec<f64>> {
    let words = line.split_whitespace();
    words.map(|word| word.parse().ok()).collect()
}

/// Two lines of comment, then a count of atoms with the origin, and three of counts with steps.
fn is_cube(text: &str) -> bool {
    let rows: Vec<Option<Vec<f64>>> = text.lines().skip(2).take(4).map(numbers).collect();
    let is_row = |row: &Option<Vec<f64>>| {
        row.as_ref()
            .is_some_and(|row| matches!(row.len(), 4 | 5) && row[0].fract() == 0.0)
    };
    let is_words =
        |line: Option<&str>| line.is_some_and(|line| numbers(line).is_none_or(|n| n.is_empty()));
    let is_axis = |row: &Option<Vec<f64>>| {
        row.as_ref()
            .is_some_and(|row| row.len() == 4 && row[0] != 0.0)
    };
    let mut lines = text.lines();
    (is_words(lines.next()) || is_words(lines.next()))
        && rows.len() == 4
        && rows.iter().all(is_row)
        && rows[1..].iter().all(is_axis)
}

/// A line of comment, then counts: `27 atoms`, `1 atom types`, `0 1 xlo xhi`.
fn is_lammps(text: &str) -> bool {
    let is_count = |line: &str| {
        let mut words = line.split_whitespace();
        words.next().is_some_and(|word| word.parse::<u64>().is_ok())
            && words.next() == Some("atoms")
            && words.next().is_none_or(|word| word.starts_with('#'))
    };
    let is_other = |line: &str| line.contains("atom types") || line.contains("xlo xhi");
    has_line(text, is_count) && has_line(text, is_other)
}

/// Records of the Protein Data Bank.
fn is_protein(text: &str) -> bool {
    const RECORDS: [&str; 8] = [
        "HEADER ", "TITLE  ", "REMARK ", "CRYST1 ", "COMPND ", "MODEL  ", "ATOM  ", "HETATM",
    ];
    let is_record = |line: &&str| RECORDS.iter().any(|record| line.starts_with(record));
    let is_atom = |line: &str| {
        let is_one = line.starts_with("ATOM  ") || line.starts_with("HETATM");
        is_one
            && line
                .get(30..54)
                .and_then(numbers)
                .is_some_and(|places| places.len() == 3)
    };
    let first = text.lines().next();
    first.is_some_and(|line| is_record(&line))
        && (text.lines().any(is_atom) || first.is_some_and(|l| l.starts_with("HEADER ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_of_the_table_is_whole() {
        let mut endings: Vec<&str> = REFUSED
            .iter()
            .flat_map(|row| row.endings)
            .copied()
            .collect();
        let count = endings.len();
        endings.sort_unstable();
        endings.dedup();
        assert_eq!(endings.len(), count, "an ending of two rows");
        for row in REFUSED {
            assert!(
                !row.name.is_empty() && !row.advice.is_empty(),
                "{}",
                row.name
            );
            assert!(
                row.endings.iter().all(|e| *e == e.to_ascii_lowercase()),
                "{}",
                row.name
            );
        }
    }
}
