//! Tests files of atoms: dumps of LAMMPS, XYZ and `.gro`.
//!
//! `fixtures/atoms` has dumps that LAMMPS (22 July 2025) wrote, XYZ of ASE 3.29 and MDAnalysis 2.11, and `.gro` of
//! MDAnalysis. `truth.json` has the numbers that ASE and MDAnalysis read from them.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::PathBuf;

use ewa_splat::io::{Dataset, FieldSource, Geometry, OpenOptions, format_of, open, read};
use ewa_splat::sample::{SampleOptions, volume};
use glam::DVec3;
use serde_json::Value;

use crate::support::{gzip, numbers};

fn path(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/atoms");
    folder.join(name)
}

fn text(name: &str) -> String {
    std::fs::read_to_string(path(name)).unwrap()
}

fn at_step(step: usize) -> OpenOptions {
    OpenOptions {
        time_step: Some(step),
        ..OpenOptions::default()
    }
}

fn read_text(name: &str, text: &str) -> Dataset {
    read(name, text.as_bytes(), &OpenOptions::default()).unwrap()
}

fn refuse(name: &str, text: &str) -> String {
    let error = read(name, text.as_bytes(), &OpenOptions::default());
    error.unwrap_err().to_string()
}

fn positions(data: &Dataset) -> &[DVec3] {
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    positions
}

/// Returns the values of a field, row by row.
fn rows(data: &Dataset, name: &str) -> Vec<Vec<f64>> {
    let field = data.fields.iter().find(|field| field.name == name);
    let components = match &field.unwrap().source {
        FieldSource::Scalar(values) => std::slice::from_ref(values),
        FieldSource::Vector(components) => components,
        FieldSource::Derived(_) => panic!("{name} is derived"),
    };
    let row = |i: usize| components.iter().map(|c| c.wide(i)).collect();
    (0..components[0].len()).map(row).collect()
}

fn notes(data: &Dataset) -> String {
    data.notes.join("\n")
}

/// Each number that another program reads, in all frames. Both parse the same decimal text; MDAnalysis keeps single precision, so that
/// its numbers below 30 are right to 2e-6.
#[test]
fn numbers_are_those_that_ase_and_mdanalysis_read() {
    let truth: Value = serde_json::from_str(&text("truth.json")).unwrap();
    let mut compared = 0;
    for (name, frames) in truth.as_object().unwrap() {
        let frames = frames.as_array().unwrap();
        for (step, frame) in frames.iter().enumerate() {
            let data = open(&path(name), &at_step(step)).unwrap();
            for (field, expected) in frame.as_object().unwrap() {
                if field == "time" {
                    continue;
                }
                let found = match field.as_str() {
                    "positions" => positions(&data)
                        .iter()
                        .map(|p| p.to_array().into())
                        .collect(),
                    field => rows(&data, field),
                };
                let expected = expected.as_array().unwrap();
                assert_eq!(found.len(), expected.len(), "{name} {step} {field}");
                for (found, expected) in found.iter().zip(expected) {
                    let expected = match expected {
                        Value::Array(row) => row.iter().map(|x| x.as_f64().unwrap()).collect(),
                        number => vec![number.as_f64().unwrap()],
                    };
                    assert_eq!(found.len(), expected.len(), "{name} {step} {field}");
                    for (found, expected) in found.iter().zip(expected) {
                        assert!(
                            (found - expected).abs() < 2e-6,
                            "{name} {step} {field}: {found}, not {expected}"
                        );
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 300, "{compared}");
}

/// Frames are time steps, by whatever the format states of times.
#[test]
fn frames_are_time_steps() {
    let options = OpenOptions::default();
    for (name, format, times) in [
        (
            "spheres.lammpstrj",
            "LAMMPS dumps",
            vec![Some(0.0), Some(0.1), Some(0.2)],
        ),
        (
            "atom.dump",
            "LAMMPS dumps",
            vec![Some(0.0), Some(10.0), Some(20.0)],
        ),
        (
            "frames.extxyz",
            "XYZ of atoms",
            vec![Some(0.0), Some(0.5), Some(1.0)],
        ),
        ("frames.xyz", "XYZ of atoms", vec![None, None]),
        ("plain.xyz", "XYZ of atoms", vec![None]),
        ("velocities.gro", "GROMACS structures", vec![None]),
    ] {
        let found = format_of(&path(name), &options).unwrap();
        assert_eq!(found.name, format);
        let steps = found.time_steps(&path(name)).unwrap();
        let stated: Vec<Option<f64>> = steps.iter().map(|step| step.time).collect();
        assert_eq!(stated, times, "{name}");
        let noted = notes(&open(&path(name), &options).unwrap());
        let expected = format!("The first of {} time steps", times.len());
        assert_eq!(noted.contains(&expected), times.len() > 1, "{noted}");
        let error = open(&path(name), &at_step(times.len()))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(&times.len().to_string()) || times.len() == 1,
            "{error}"
        );
    }
    let two = text("velocities.gro");
    let first = two.replace("MDAnalysis", "me t=  1.5 step= 3");
    let two = format!("{first}{two}\n\n\n");
    let data = read("a", two.as_bytes(), &at_step(1)).unwrap();
    assert_eq!(positions(&data).len(), 5);
    assert!(notes(&read_text("a", &two)).contains("of time 1.5"));
}

/// LAMMPS wrote the same positions as coordinates and as shares of the edges, each with six digits.
#[test]
fn shares_of_edges_are_the_positions_that_lammps_wrote() {
    // An edge of 12 is the longest, so that half of the last digit of a share is 6e-6.
    let agree = |a: &Dataset, b: &Dataset| {
        assert_eq!(positions(a).len(), positions(b).len());
        for (a, b) in positions(a).iter().zip(positions(b)) {
            assert!((*a - *b).abs().max_element() < 2e-5, "{a} {b}");
        }
    };
    for step in 0..3 {
        let options = at_step(step);
        let shares = open(&path("atom.dump"), &options).unwrap();
        agree(
            &shares,
            &open(&path("spheres.lammpstrj"), &options).unwrap(),
        );
    }
    let of = |name: &str| open(&path(name), &OpenOptions::default()).unwrap();
    agree(&of("sheared.dump"), &of("sheared_x.dump"));
    let both = text("general.dump");
    let scaled = both.replace("id xs ys zs x y z", "id xs ys zs a b c");
    let unwrapped = both.replace("id xs ys zs x y z", "id xsu ysu zsu a b c");
    agree(&read_text("a", &both), &read_text("a", &scaled));
    agree(&read_text("a", &both), &read_text("a", &unwrapped));
}

#[test]
fn columns_of_dumps_become_fields() {
    let data = open(&path("spheres.lammpstrj"), &at_step(0)).unwrap();
    assert_eq!(
        data.field_names(),
        [
            "id", "type", "element", "v", "radius", "diameter", "mass", "xu", "yu", "zu", "c_s[1]",
            "c_s[2]", "c_s[3]", "c_s[4]", "c_s[5]", "c_s[6]", "c_d[1]", "c_d[2]", "c_d[3]",
            "c_d[4]"
        ]
    );
    assert_eq!(rows(&data, "v")[6], [-0.850323, 0.985421, 0.889301]);
    assert_eq!(
        numbers(&data, "radius"),
        [0.25, 0.25, 0.25, 0.25, 0.4, 0.4, 0.4]
    );
    assert_eq!(
        numbers(&data, "element"),
        [8.0, 8.0, 8.0, 8.0, 26.0, 26.0, 26.0]
    );
    assert_eq!(rows(&data, "c_s[6]")[2], [-3.34752]);
    assert_eq!(data.format, "LAMMPS dump");
    let noted = notes(&data);
    assert!(noted.contains("units `lj`"), "{noted}");
    assert!(
        noted.contains("--periodic 4,4,4 --centre 1,0,2.5"),
        "{noted}"
    );
    assert!(noted.contains("atomic numbers: `element`"), "{noted}");

    let dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n\
                ITEM: ATOMS z diameter f_a[1] f_a[2] f_a[3] name mux muy muz mu y x\n\
                1 2 3 4 5 C1 0 0 1 1 6 7\n8 9 10 11 12 C2 0 1 0 1 13 14\n";
    let data = read_text("a", dump);
    assert_eq!(
        positions(&data),
        [DVec3::new(7., 6., 1.), DVec3::new(14., 13., 8.)]
    );
    // `mu` is another column, so the three before it stay scalars.
    assert_eq!(
        data.field_names(),
        ["radius", "f_a", "mux", "muy", "muz", "mu"]
    );
    assert_eq!(numbers(&data, "radius"), [1.0, 4.5]);
    assert_eq!(rows(&data, "f_a")[1], [10., 11., 12.]);
    let noted = notes(&data);
    assert!(
        noted.contains("hold words: `name`") && noted.contains("half of `diameter`"),
        "{noted}"
    );
    assert!(!noted.contains("periodic"), "{noted}");

    let unwrapped = read_text(
        "a",
        &dump
            .replace(" y x", " yu xu")
            .replace("ATOMS z", "ATOMS zu"),
    );
    assert_eq!(positions(&unwrapped), positions(&data));
    let flat = read_text("a", &dump.replace("ATOMS z", "ATOMS q"));
    assert_eq!(positions(&flat)[1], DVec3::new(14., 13., 0.));
    assert!(notes(&flat).contains("z = 0"));
}

#[test]
fn boxes_are_noted() {
    let of = |name: &str, step: usize| notes(&open(&path(name), &at_step(step)).unwrap());
    for (name, step, says) in [
        ("atom.dump", 0, "--periodic 4,4,4 --centre 1,0,2.5"),
        ("sheared.dump", 0, "sheared"),
        ("general.dump", 0, "sheared"),
        ("frames.extxyz", 0, "(--periodic 6,7,8)"),
        ("frames.extxyz", 1, "along x and y alone"),
        ("frames.extxyz", 2, "sheared"),
        ("velocities.gro", 0, "(--periodic 2,2.1,2.2)"),
        ("dodecahedron.gro", 0, "sheared"),
    ] {
        assert!(of(name, step).contains(says), "{name}: {}", of(name, step));
    }
    assert!(!of("plain.xyz", 0).contains("periodic"));
}

#[test]
fn xyz_has_the_columns_that_it_lists_or_those_of_its_first_row() {
    let data = open(&path("frames.extxyz"), &at_step(1)).unwrap();
    let names = ["species", "momenta", "radius", "frozen", "forces"];
    assert_eq!(data.field_names(), names);
    assert!(notes(&data).contains("hold words: `label`"));
    let plain = "2\nmade by hand\nC 0 1 2 0.5 a\nCl 3 4 5 0.25 b\n";
    let data = read_text("a.xyz", plain);
    assert_eq!(data.field_names(), ["species", "column 5"]);
    assert_eq!(numbers(&data, "species"), [6.0, 17.0]);
    assert_eq!(numbers(&data, "column 5"), [0.5, 0.25]);
    let by_number = read_text("a.xyz", "2\nmade by hand\n6 0 1 2\n17 3 4 5\n");
    assert_eq!(numbers(&by_number, "species"), [6.0, 17.0]);
    assert_eq!(positions(&by_number)[1], DVec3::new(3., 4., 5.));
    let moved = "1\nLattice=\"2 0 0 0 2 0 0 0 2\" Origin=\"-1 -1 -1\" Properties=pos:R:3:d:R:2\n0 0 0 1 2\n";
    let data = read_text("a.xyz", moved);
    assert_eq!(rows(&data, "d"), [[1.0, 2.0]]);
    assert!(notes(&data).contains("--periodic 2,2,2 --centre 0,0,0"));
}

#[test]
fn columns_of_gro_have_any_precision() {
    let data = open(&path("velocities.gro"), &OpenOptions::default()).unwrap();
    assert_eq!(data.field_names(), ["id", "residue", "velocity"]);
    assert_eq!(data.unit("velocity"), Some("nm/ps"));
    // Names that fill their columns, and numbers that leave no blank between them.
    let fine = "fine\n    1\n99999LONGRLONGA99999-100.12345 100.67890   1.00000\n 1 1 1\n";
    let data = read_text("a", fine);
    assert_eq!(positions(&data), [DVec3::new(-100.12345, 100.6789, 1.0)]);
    assert_eq!(data.field_names(), ["id", "residue"]);
    let no_box = fine.replace(" 1 1 1", " 0 0 0");
    assert!(!notes(&read_text("a", &no_box)).contains("periodic"));
}

#[test]
fn packed_files_are_read() {
    for name in [
        "spheres.lammpstrj",
        "frames.extxyz",
        "frames.xyz",
        "velocities.gro",
    ] {
        let packed = gzip(text(name).as_bytes());
        let plain = open(&path(name), &at_step(0)).unwrap();
        let data = read(&format!("{name}.gz"), &packed, &at_step(0)).unwrap();
        assert_eq!(positions(&data), positions(&plain), "{name}");
    }
    let packed = gzip(text("frames.extxyz").as_bytes());
    assert_eq!(
        positions(&read("a.gz", &packed, &at_step(2)).unwrap()).len(),
        6
    );
}

/// Whole frames of a file that a simulation still writes are read; the frame that is cut is left out with a note, or an error if it is
/// asked for.
#[test]
fn files_may_end_anywhere() {
    for name in [
        "spheres.lammpstrj",
        "frames.extxyz",
        "frames.xyz",
        "velocities.gro",
        "general.dump",
    ] {
        let whole = std::fs::read(path(name)).unwrap();
        let mut cut_count = 0;
        for len in 1..whole.len() {
            match read("a", &whole[..len], &OpenOptions::default()) {
                Ok(data) => {
                    let reference = open(&path(name), &at_step(0)).unwrap();
                    assert_eq!(positions(&data).len(), positions(&reference).len());
                    cut_count += usize::from(notes(&data).contains("ends within a frame"));
                }
                Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
            }
        }
        let has_several = !["velocities.gro", "general.dump"].contains(&name);
        assert_eq!(cut_count > 0, has_several, "{name}");
    }
    let dump = text("spheres.lammpstrj");
    let row = dump.trim_end().rfind('\n').unwrap();
    let cut = &dump[..=row];
    assert!(notes(&read_text("a", cut)).contains("2 are whole"));
    let data = read("a", cut.as_bytes(), &at_step(1)).unwrap();
    assert_eq!(positions(&data).len(), 7);
    let error = read("a", cut.as_bytes(), &at_step(2))
        .unwrap_err()
        .to_string();
    assert!(error.contains("7 rows, of which 6"), "{error}");
}

#[test]
fn mistakes_are_named_by_line() {
    let dump = text("sheared_x.dump");
    let xyz = text("frames.extxyz");
    let gro = text("velocities.gro");
    for (text, says) in [
        (dump.replace("1.2117", "oops"), "line 10, column `y`"),
        (dump.replace(" 5.02303", ""), "line 10"),
        (dump.replace("id x y z", "id x y y"), "`y` twice"),
        (dump.replace("id x y z", "id a b c"), "xsu ysu zsu"),
        (
            dump.replace("ITEM: ATOMS", "ITEM: ENTRIES"),
            "style atom or custom",
        ),
        (
            dump.replace("ITEM: NUMBER OF ATOMS\n5\n", ""),
            "NUMBER OF ATOMS",
        ),
        (
            dump.replace("ATOMS\n5\n", "ATOMS\n18446744073709551615\n"),
            "of which 5",
        ),
        (dump.replace("ATOMS\n5\n", "ATOMS\n-5\n"), "line 4"),
        (dump.replace("ATOMS\n5\n", "ATOMS\n0\n"), "line 10"),
        (dump.replace("xy xz yz pp", "pp"), "2 numbers of the box"),
        (
            dump.replace("xy xz yz", "").replace("x y z", "xs ys zs"),
            "2 numbers of the box",
        ),
        (xyz.replacen("pos:R:3", "pos:R:4", 1), "pos:R:3"),
        (
            xyz.replacen("radius:R:1", "radius:R:99999999999", 1),
            "radius:R:99999999999",
        ),
        (xyz.replacen("radius:R:1", "radius:R", 1), "Properties="),
        (xyz.replacen("radius:R:1", "radius:Q:1", 1), "radius:Q:1"),
        (xyz.replacen("radius:R:1", "pos:R:1", 1), "Properties="),
        (xyz.replacen("6.0 0.0 0.0", "6.0 0.0", 1), "nine numbers"),
        (xyz.replacen("T T T", "T 2 T", 1), "pbc="),
        (xyz.replacen("  F a ", "  5x a ", 1), "column `frozen`"),
        (gro.replacen("   1.256", "   1,256", 1), "bytes 29 to 36"),
        (gro.replacen("2.10000", "", 1), "3 or 9 numbers"),
    ] {
        assert!(![&dump, &xyz, &gro].contains(&&text), "{says}");
        let error = refuse("a", &text);
        assert!(error.contains(says), "{says}: {error}");
    }
    let long = format!("ITEM: TIMESTEP\n{}", "1".repeat(3 << 20));
    assert!(refuse("a", &long).contains("less than 1048576 bytes"));
    let binary = std::fs::read(path("binary.bin")).unwrap();
    let error = read("a.bin", &binary, &OpenOptions::default()).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("binary LAMMPS dump") && error.contains("binary2txt"),
        "{error}"
    );
}

/// Three atoms without radii or fields that vary.
#[test]
fn atoms_are_drawn() {
    let dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\n\
                ITEM: ATOMS id type x y z\n1 1 .1 .2 .3\n2 1 .5 .5 .5\n3 1 .9 .8 .7\n";
    let molecule = "3\nwater\nO 0 0 .1\nH 0 .7 -.5\nH 0 -.7 -.5\n";
    let gro = "water\n    2\n    1SOL     OW    1   0.126   1.624   1.679\n    \
               1SOL    HW1    2   0.190   1.661   1.747\n   1.8 1.8 1.8\n";
    for (text, count) in [(dump, 3), (molecule, 3), (gro, 2)] {
        for name in ["a", "a.xyz", "a.dump", "a.txt", "a.obj"] {
            let sampled = volume(read_text(name, text), &SampleOptions::default()).unwrap();
            assert_eq!(sampled.report.particle_count, count, "{name}");
        }
    }
}
