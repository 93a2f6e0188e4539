//! Formats that are recognised in order to be refused by name, each with a way out.

use std::path::Path;

use super::extension;
use super::voxels::GZIP;
use crate::error::{Advice, Error, Hint};

/// What files begin with, at which byte; what they are; and what to do.
const BEGINNINGS: &[(usize, &[u8], &str, &str)] = &[
    #[cfg(not(feature = "dicom"))]
    (128, b"DICM", "a DICOM file", NO_DICOM),
    #[cfg(not(feature = "e57"))]
    E57,
    (0, b"\x89PNG", "a PNG image", IMAGE),
    (0, b"\xff\xd8\xff", "a JPEG image", IMAGE),
    (8, b"WEBP", "a WebP image", IMAGE),
    (0, b"\xabKTX", "a KTX image", IMAGE),
    (0, b"PF\n", "a PFM image", IMAGE),
    (0, b"\x76\x2f\x31\x01", "an EXR image", IMAGE),
    (0, b"Kaydara FBX", "an FBX file", MESH),
    (0, b"; FBX ", "an FBX file", MESH),
    (0, b"PXR-USDC", "a USD file", MESH),
    (0, b"#usda", "a USD file", MESH),
    (
        0,
        b"#!TDV",
        "a binary Tecplot file",
        "save it as text (.dat), or as VTK XML",
    ),
    (
        4,
        b"ADF Database",
        "a CGNS file in the old ADF container",
        "turn it into HDF5 with adf2hdf, then into VTK XML",
    ),
    #[cfg(not(feature = "netcdf"))]
    (0, b"CDF", "a netCDF or Exodus file", NO_NETCDF),
    (
        0,
        b" BDV",
        "an OpenVDB file",
        "save its grids as NRRD or VTK XML (.vti), and its points as PLY",
    ),
    (
        0,
        b"RAD0",
        "splats in .rad",
        "save them as SPZ or PLY with the program that wrote them",
    ),
];

/// What is refused by a build that lacks what reads it.
#[cfg(not(feature = "e57"))]
const E57: (usize, &[u8], &str, &str) = (
    0,
    b"ASTM-E57",
    "an E57 file",
    "build with the feature e57, or save it as LAS or PLY",
);

/// Endings of files that say nothing in their first bytes.
const ENDINGS: &[(&str, &str, &str)] = &[
    (
        "lcc",
        "splats in LCC",
        "save them as SPZ or PLY with the program that wrote them",
    ),
    ("fbx", "an FBX file", MESH),
    ("usd", "a USD file", MESH),
    ("usda", "a USD file", MESH),
    ("usdc", "a USD file", MESH),
    ("usdz", "a USD file", MESH),
];

/// Indices in JSON that name files of others: keys that they have, what they are, and what to do.
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

/// What a text in JSON is that is an index of files, and what to do; `has` tells which keys it has.
pub(super) fn index(has: impl Fn(&str) -> bool) -> Option<(&'static str, &'static str)> {
    let mut known = INDICES.iter();
    let (_, name, advice) = known.find(|(keys, ..)| keys.iter().all(|key| has(key)))?;
    Some((*name, *advice))
}

const IMAGE: &str = "an image holds no volume: give a data file";
#[cfg(not(feature = "dicom"))]
const NO_DICOM: &str = "build with the feature `dicom`, or save the series as NIfTI or NRRD";
#[cfg(not(feature = "netcdf"))]
const NO_NETCDF: &str = "build with the feature `netcdf`, or save it as VTK XML (.vtu)";
const MESH: &str = "save it as glTF (.glb)";

/// Why a file that begins with `head` is not read, where it is known what it is.
///
/// - `names`: what is read.
pub(super) fn by_name(path: &Path, head: &[u8], names: fn() -> String) -> Option<Error> {
    let begins = |(at, start, ..): &&(usize, &[u8], &str, &str)| {
        head.get(*at..).is_some_and(|rest| rest.starts_with(start))
    };
    let refuse = |name: &str, advice: Advice| {
        let found = format!("{name}, which is not read");
        Some(Error::format(path, "format", names(), found, advice))
    };
    if let Some((_, _, name, advice)) = BEGINNINGS.iter().find(begins) {
        return refuse(name, (*advice).into());
    }
    let ending = extension(path);
    if let Some((_, name, advice)) = ENDINGS.iter().find(|(known, ..)| *known == ending) {
        return refuse(name, (*advice).into());
    }
    if head.trim_ascii_start().starts_with(b"{") {
        let text = String::from_utf8_lossy(head);
        if let Some((name, advice)) = index(|key| text.contains(&format!("\"{key}\""))) {
            return refuse(name, advice.into());
        }
    }
    match head.starts_with(GZIP) {
        true => refuse("a gzip archive", Hint::UnpackOrGiveLayout.into()),
        false => None,
    }
}
