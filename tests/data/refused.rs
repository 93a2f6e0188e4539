//! Formats that are not read are refused by name, with a way out.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{OpenOptions, read};

use crate::support::npz;

#[test]
fn formats_that_are_not_read_have_names_and_ways_out() {
    let adf = b"\0\0\0\0ADF Database Version";
    for (name, bytes, what, way) in [
        ("a.fbx", &b"Kaydara FBX Binary  \0"[..], "FBX", "glTF"),
        ("a", b"; FBX 7.3.0 project file", "FBX", "glTF"),
        ("a.usda", b"#usda 1.0\n", "USD", "glTF"),
        ("a.usdc", b"PXR-USDC\0\0", "USD", "glTF"),
        ("a.usdz", b"PK\x03\x05\0", "USD", "glTF"),
        ("a.plt", b"#!TDV112\0", "binary Tecplot", "VTK"),
        ("a.cgns", adf, "ADF", "adf2hdf"),
        ("a.vdb", b" BDV\0\0\0\0", "OpenVDB", "NRRD"),
        ("a.rad", b"RAD0\0\0", ".rad", "SPZ"),
        ("a.lcc", b"\x01\x02\x03", "LCC", "SPZ"),
        (
            "a.webp",
            b"RIFF\0\0\0\0WEBPVP8 ",
            "WebP",
            "image holds no volume",
        ),
        (
            "a.bin",
            b"\x89PNG\r\n\x1a\n",
            "PNG",
            "image holds no volume",
        ),
        ("a.gz", b"\x1f\x8b\x08\0\0\0\0\0", "gzip", "unpack"),
        (
            "lod-meta.json",
            b"{\"version\":1,\"asset\":{\"generator\":\"x\"},\"lodLevels\":2,\"filenames\":[\"0_0/meta.json\"]}",
            "an index of levels of detail",
            "`meta.json`",
        ),
        (
            "lod-meta.json",
            b"{\"version\":1,\"lodLevels\":2,\"filenames\":[\"0_0/meta.json\"]}",
            "an index of levels of detail",
            "`meta.json`",
        ),
        (
            "tileset.json",
            b"{\"asset\":{\"version\":\"1.1\"},\"geometricError\":2,\"root\":{}}",
            "a tileset of 3D Tiles",
            ".glb",
        ),
    ] {
        let error = read(name, bytes, &OpenOptions::default()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(what) && error.contains("which is not read"),
            "{name}: {error}"
        );
        assert!(error.contains(way), "{name}: {error}");
    }
}

/// A ZIP archive that is cut short shows nothing of what it holds: its name says what it is to be, or else the message says which
/// formats are ZIP archives.
#[test]
fn cut_archives_are_not_taken_for_arrays() {
    let whole = npz(&[("meta.json", vec![b' '; 300])], false);
    let cut = &whole[..whole.len() / 2];
    for (name, expected, way) in [
        ("a.npz", "a sound NPZ archive", "numpy.savez"),
        ("a.sog", "SOG archive", "get it again"),
        ("a.3mf", "a sound 3MF archive", "again"),
        ("a.foam.zip", "an OpenFOAM case", "pack the case's folder"),
        ("a.zip", "NPZ, SOG, 3MF, OpenFOAM", "the file is whole"),
        ("a", "NPZ, SOG, 3MF, OpenFOAM", ".foam.zip"),
    ] {
        let error = read(name, cut, &OpenOptions::default()).unwrap_err();
        let error = error.to_string();
        let is_said = error.contains(expected) && error.contains("no directory of members");
        assert!(is_said && error.contains(way), "{name}: {error}");
        let is_numpy = error.contains("numpy");
        assert_eq!(is_numpy, name == "a.npz", "{name}: {error}");
    }
    // Whole, and of none of these formats.
    let other = npz(&[("other.txt", vec![b' '; 300])], false);
    let error = read("a.zip", &other, &OpenOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("NPZ, SOG, 3MF, OpenFOAM"),
        "{error}"
    );
}
