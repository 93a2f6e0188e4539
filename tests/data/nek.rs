//! Tests field files of Nek5000, which VTK's reader reads to the same numbers.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{Dataset, Geometry, OpenOptions, format_of, open, read, read_with};

use crate::support::numbers;

fn path(name: &str) -> PathBuf {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    fixtures.join("nek").join(name)
}

fn fixture(name: &str) -> Dataset {
    open(&path(name), &OpenOptions::default()).unwrap()
}

/// The numbers that the file of this step was given, from where its nodes were before they were moved.
#[test]
fn fields_are_those_that_were_written() {
    let first = fixture("chan0.f00001");
    let Geometry::Cells(mesh) = &first.geometry else {
        panic!("no cells")
    };
    // Two elements of 4 x 4 x 4 nodes, 27 cells each.
    assert_eq!((mesh.nodes.len(), mesh.cell_count()), (128, 54));
    assert_eq!(mesh.cell(30), [68, 69, 73, 72, 84, 85, 89, 88]);
    assert_eq!(
        first.field_names(),
        ["Velocity", "Pressure", "Temperature", "S01", "S02"]
    );
    // As VTK reads nodes 0, 1 and 70.
    let near = |name: &str, expected: [f32; 3]| {
        let all = numbers(&first, name);
        for (i, expected) in [0, 1, 70].into_iter().zip(expected) {
            assert!((all[i] - expected).abs() < 1e-6, "{name}: {}", all[i]);
        }
    };
    near("Velocity:x", [0.1, 0.652_786_43, 3.491_935]);
    near("Velocity:y", [-12.0, -10.894_427, -3.577_708_7]);
    near("Pressure", [-2.1, -1.436_656_4, 2.134_164]);
    near("Temperature", [1.08, 0.378_269_3, -0.891_541_8]);
    near("S02", [1.1, 1.02, 1.02]);
    assert!((mesh.nodes[127].x - 3.1).abs() < 1e-12 && (mesh.nodes[0].y + 1.2).abs() < 1e-12);

    // The second file is big-endian, in single precision, has its elements in another order, and no positions.
    let second = fixture("chan0.f00002");
    let Geometry::Cells(mesh) = &second.geometry else {
        panic!("no cells")
    };
    let (velocity, pressure) = (numbers(&second, "Velocity:x"), numbers(&second, "Pressure"));
    for (node, (u, p)) in mesh.nodes.iter().zip(velocity.iter().zip(&pressure)) {
        assert!((f64::from(*u) - (2.0 + node.x)).abs() < 1e-6, "{u}");
        assert!(
            (f64::from(*p) - (node.x + 2.0 * node.y)).abs() < 1e-6,
            "{p}"
        );
    }
    let notes = second.notes.join(" ");
    assert!(
        notes.contains("positions are those of `chan0.f00001`"),
        "{notes}"
    );
}

#[test]
fn a_file_names_those_of_all_times() {
    let index = path("chan.nek5000");
    let format = format_of(&index, &OpenOptions::default()).unwrap();
    let steps = format.time_steps(&index).unwrap();
    let times: Vec<_> = steps.iter().map(|step| step.time).collect();
    assert_eq!(times, [Some(0.25), Some(0.5)]);
    assert_eq!(steps[1].parts[0].path, path("chan0.f00002"));
    assert_eq!(fixture("chan.nek5000").field_names().len(), 5);
    let text = |text: &str| {
        let sound = |file: &Path| std::fs::read(path(file.to_str().unwrap())).ok();
        let data = read_with(
            "a.nek5000",
            text.as_bytes(),
            &OpenOptions::default(),
            &sound,
        );
        data.map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(
        text("filetemplate: chan%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 1\n"),
        Ok(())
    );
    for (index, says) in [
        (
            "filetemplate: chan%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 3\n",
            "no file `chan0.f00003`",
        ),
        (
            "filetemplate: chan\nfirsttimestep: 1\nnumtimesteps: 3\n",
            "`%05d`",
        ),
        (
            "filetemplate: ../chan%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 3\n",
            "beside this file",
        ),
        (
            "filetemplate: chan%01d.f%05d\nfirsttimestep: 1\n",
            "`numtimesteps:`",
        ),
        (
            "filetemplate: chan%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 0\n",
            "one time or more",
        ),
        // The file names itself.
        (
            "filetemplate: chan.nek%d000\nfirsttimestep: 5\nnumtimesteps: 1\n",
            "header",
        ),
    ] {
        let error = text(index).unwrap_err();
        assert!(error.contains(says), "{index}: {error}");
    }
}

#[test]
fn elements_of_two_dimensions_are_a_surface() {
    let data = fixture("flat0.f00000");
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("no mesh")
    };
    assert_eq!(mesh.parts[0].triangles.len(), 2 * 9 * 2);
    let temperature = numbers(&data, "Temperature");
    for (node, t) in mesh.parts[0].positions.iter().zip(&temperature) {
        assert!((f64::from(*t) - 3.0 * node.x).abs() < 1e-5, "{t}");
    }
}

#[test]
fn files_may_end_anywhere() {
    let whole = std::fs::read(path("chan0.f00001")).unwrap();
    // Behind the fields lie least and greatest values, which are not needed.
    let end = 132 + 4 + 8 + 8 * 128 * 10;
    for len in (1..whole.len()).step_by(3) {
        match read("chan0.f00001", &whole[..len], &OpenOptions::default()) {
            Ok(_) => assert!(len >= end, "{len}"),
            Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
    }
    let second = std::fs::read(path("chan0.f00002")).unwrap();
    let error = read("chan0.f00002", &second, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("positions (`X`)"), "{error}");
}

#[test]
fn numbers_of_steps_are_bounded_by_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nek5000");
    let text = "filetemplate: a%01d.f%05d\nfirsttimestep: 4294967290\nnumtimesteps: 100\n";
    std::fs::write(&path, text).unwrap();
    let error = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("no file"), "{error}");
}
