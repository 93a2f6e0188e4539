//! Tests that unsupported formats are refused by name, with advice.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{OpenOptions, read};

use crate::support::npz;

#[test]
fn formats_that_are_not_read_have_names_and_ways_out() {
    let adf = b"\0\0\0\0ADF Database Version";
    for (name, bytes, what, way) in [
        ("a.fbx", &b"Kaydara FBX Binary  \0"[..], "FBX", "glTF"),
        ("a", b"; FBX 7.3.0 project file", "FBX", "glTF"),
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

/// Files that begin as their programs write them.
#[test]
fn what_others_write_is_named_by_content_whatever_its_name() {
    let mut mrc = vec![0; 1024];
    mrc[208..212].copy_from_slice(b"MAP ");
    let mut xtc = [1995_i32, 3, 0, 0].map(i32::to_be_bytes).concat();
    xtc.resize(52, 0);
    xtc.extend(3_i32.to_be_bytes());
    let pdb = b"ATOM      1  N   ALA A   1      11.104   6.134  -6.504  1.00  0.00           N\n";
    let cube = b"density\nmade by hand\n 1 0.0 0.0 0.0\n 2 1 0 0\n 2 0 1 0\n 2 0 0 1\n 1 0.0 0.0 0.0 0.0\n 1.0\n";
    let files: &[(&str, &[u8], &str, &str)] = &[
        (
            "Gmsh",
            b"$NOD\n1\n1 0 0 0\n",
            "a Gmsh file of version 1",
            "msh41",
        ),
        (
            "Fluent",
            b"(0 \"Mesh\")\n(2 3)\n",
            "a Fluent file",
            "EnSight",
        ),
        (
            "Fluent, by meshio",
            b"(1 \"meshio 5.3.5\")\n(2 3)\n(3010 (\0\xff",
            "a Fluent file",
            "EnSight",
        ),
        (
            "SU2",
            b"% a comment\nNDIME= 3\nNELEM= 1\n",
            "an SU2 file",
            "PARAVIEW",
        ),
        (
            "Abaqus",
            b"** made by hand\n*Heading\nbox\n*NODE\n1, 0., 0., 0.\n",
            "Abaqus",
            "meshio",
        ),
        (
            "CalculiX",
            b"    1C\n    1UUSER\n",
            "CalculiX result",
            "ccx2paraview",
        ),
        (
            "Nastran",
            b"$ made by hand\nBEGIN BULK\nGRID,1,,0.,0.,0.\n",
            "a Nastran file",
            "meshio",
        ),
        (
            "Nastran, fixed",
            b"GRID           1              0.      0.      0.\n",
            "a Nastran file",
            "meshio",
        ),
        (
            "Nek5000, old",
            b"#v001 4  8  8  8     512     512  0.0E+00 ",
            "an old file of Nek5000",
            ".nek5000",
        ),
        (
            "EnSight's geometry",
            b"EnSight Model Geometry File\nEnSight 7.1.0\n",
            "EnSight",
            ".case",
        ),
        (
            "AFNI",
            b"\ntype  = string-attribute\nname = TYPESTRING\n",
            "an AFNI header",
            "3dAFNItoNIFTI",
        ),
        (
            "PAR",
            b"# === DATA DESCRIPTION FILE ======\n#\n",
            "PAR/REC",
            "parrec2nii",
        ),
        ("cube", cube, "a Gaussian cube file", "NRRD"),
        (
            "LUT",
            b"TITLE \"warm\"\nLUT_3D_SIZE 2\n0 0 0\n",
            "a colour table",
            "films",
        ),
        ("MRC", &mrc, "an MRC map", "mrcfile"),
        (
            "FITS",
            b"SIMPLE  =                    T",
            "a FITS file",
            "astropy",
        ),
        ("GRIB", b"GRIB\0\0\0\x02", "a GRIB file", "cdo"),
        ("HDF4", b"\x0e\x03\x13\x01\0\0", "an HDF4 file", "h4toh5"),
        (
            "LAMMPS",
            b"\xf6\xff\xff\xff\xff\xff\xff\xffDUMPCUSTOM\x01\0\0\0",
            "a binary LAMMPS dump",
            "binary2txt",
        ),
        (
            "LAMMPS data",
            b"made by hand\n\n3 atoms\n1 atom types\n\n0 1 xlo xhi\n",
            "a LAMMPS data file",
            "OVITO",
        ),
        ("xtc", &xtc, "a GROMACS file", "MDAnalysis"),
        (
            "DCD",
            b"\x54\0\0\0CORD\x01",
            "a DCD trajectory",
            "MDAnalysis",
        ),
        ("PDB", pdb, "a file of atoms (PDB)", "ASE"),
        (
            "molecule",
            b"@<TRIPOS>MOLECULE\nwater\n",
            "a file of atoms",
            "ASE",
        ),
        ("Houdini", b"\x7fNSJb\0", "a Houdini geometry", "PLY"),
        ("OFF", b"# made by hand\nOFF\n4 4 6\n", "an OFF mesh", "PLY"),
        (
            "COLLADA",
            b"<?xml version=\"1.0\"?>\n<COLLADA version=\"1.4.1\">",
            "a COLLADA file",
            ".glb",
        ),
        (
            "MTL",
            b"# Blender MTL File\n\nnewmtl white\nKd 1 1 1\n",
            "MTL",
            "OBJ",
        ),
        ("Blender", b"BLENDER-v300", "a Blender file", ".glb"),
        ("STEP", b"ISO-10303-21;\nHEADER;\n", "a CAD file", "STL"),
        (
            "MATLAB",
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64",
            "a MATLAB file",
            "CSV",
        ),
        (
            "LFS",
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
            "Git LFS",
            "git lfs pull",
        ),
        ("page", b"<!DOCTYPE html>\n<html>", "a web page", "download"),
        (
            "Zarr",
            b"{\n  \"zarr_format\": 3,\n",
            "a Zarr array",
            "xarray",
        ),
    ];
    for (of, bytes, what, way) in files {
        for name in ["a", "a.dat", "a.txt", "a.xyz", "a.obj"] {
            let error = read(name, bytes, &OpenOptions::default()).unwrap_err();
            let error = error.to_string();
            let is_named = error.contains(what) && error.contains("which is not read");
            assert!(is_named && error.contains(way), "{of} as {name}: {error}");
        }
    }
}

#[test]
fn names_say_what_contents_do_not() {
    for (name, what) in [
        ("a.cas", "Fluent"),
        ("a.b8.ugrid", "UGRID"),
        ("a0.f00001", "Nek5000"),
        ("a+orig.BRIK", "AFNI"),
        ("a+orig.BRIK.gz", "AFNI"),
        ("a.rec", "PAR/REC"),
        ("a.ptc", "partio"),
        ("a.pdb", "PDB"),
        ("a.geo", "EnSight, Gmsh or Houdini"),
        ("a.bgeo.sc", "Houdini"),
        ("a.trr", "GROMACS"),
        ("a.zarr", "Zarr"),
        ("a.bdf", "Nastran"),
    ] {
        let error = read(name, &[1, 255, 0, 3, 9], &OpenOptions::default()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(what) && error.contains("not read"),
            "{name}: {error}"
        );
    }
}

/// Other text is no table, and bytes are no PLOT3D grid. A table stays one, whatever its name.
#[test]
fn last_guesses_need_content_that_agrees() {
    for (name, bytes) in [
        (
            "README.md",
            &b"# A title\n\nSome words, and more of them.\n"[..],
        ),
        ("notes.txt", b"first line\nsecond line\n"),
        ("a.json", b"{ \"a\": [1, 2, 3] }"),
        (
            "run.log",
            b"step 1, residual 0.5\nstep 2, residual 0.25 and falling\n",
        ),
    ] {
        let error = read(name, bytes, &OpenOptions::default()).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("text of none of these"), "{name}: {error}");
    }
    let error = read("a.bin", &[7; 900], &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("found none of these"), "{error}");
    // A table without positions is refused for that reason.
    let error = read("a.dat", b"a,b\n1,2\n3,4\n", &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("no column `x`"), "{error}");
    // Tables and clouds may have any of these extensions.
    for name in ["a.pos", "a.par", "a.map", "a.std", "a.xyz"] {
        let cloud = b"1.5 2 3\n4 5.25 6\n";
        assert!(read(name, cloud, &OpenOptions::default()).is_ok(), "{name}");
        let table = b"x,y,z,m\n1,2,3,4\n";
        if name != "a.xyz" {
            assert!(read(name, table, &OpenOptions::default()).is_ok(), "{name}");
        }
    }
}

/// A truncated ZIP archive does not show its contents. Its name determines the format, or else the
/// message lists the formats that are ZIP archives.
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
    // A complete archive of none of these formats.
    let other = npz(&[("other.txt", vec![b' '; 300])], false);
    let error = read("a.zip", &other, &OpenOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("NPZ, SOG, 3MF, OpenFOAM"),
        "{error}"
    );
}
