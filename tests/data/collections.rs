//! Tests ParaView's collections of time steps.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{Geometry, OpenOptions, Part, TimeStep, format_of, open, read_with};

use crate::common::real_data;

fn file_of(entries: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n\
         <Collection>{entries}</Collection></VTKFile>"
    )
}

fn entry(time: &str, part: &str, file: &str) -> String {
    format!("<DataSet timestep=\"{time}\" group=\"\" part=\"{part}\" file=\"{file}\"/>\n")
}

/// Returns the steps of a file of any format.
fn steps_of(path: &Path) -> ewa_splat::Result<Vec<TimeStep>> {
    format_of(path, &OpenOptions::default())?.time_steps(path)
}

/// Writes a collection and reads it: returns times, and files relative to its folder.
fn answer(entries: &str) -> Result<Vec<(f64, Vec<PathBuf>)>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pvd");
    std::fs::write(&path, file_of(entries)).unwrap();
    let steps = steps_of(&path).map_err(|e| e.to_string())?;
    let from = |part: &Part| part.path.strip_prefix(folder.path()).unwrap().to_owned();
    let files = |step: &TimeStep| step.parts.iter().map(from).collect();
    let relative = steps.iter().map(|step| (step.time.unwrap(), files(step)));
    Ok(relative.collect())
}

#[test]
fn steps_are_in_the_order_of_time_and_parts_in_theirs() {
    let entries = [
        entry("1e1", "0", "d.vtu"),
        entry("-0.5", "1", "b.vtu"),
        entry("2", "0", "in/c.vtu"),
        entry("-0.5", "0", "a.vtu"),
        // A missing time is 0, and a missing part is the first.
        "<DataSet file=\"e.vtu\"/>".to_owned(),
        entry("-0", "1", "f.vtu"),
        "<Other timestep=\"9\" file=\"x.vtu\"/>".to_owned(),
    ];
    let step = |time: f64, files: &[&str]| (time, files.iter().map(PathBuf::from).collect());
    assert_eq!(
        answer(&entries.concat()).unwrap(),
        [
            step(-0.5, &["a.vtu", "b.vtu"]),
            step(0.0, &["e.vtu", "f.vtu"]),
            step(2.0, &["in/c.vtu"]),
            step(10.0, &["d.vtu"]),
        ]
    );
}

#[test]
fn damaged_and_nested_collections_are_refused() {
    let twice = [entry("1", "0", "a.vtu"), entry("1", "1", "a.vtu")].concat();
    for (entries, place, found) in [
        (
            "",
            "Collection: expected at least one `DataSet`",
            "found none",
        ),
        (
            &entry("soon", "0", "a.vtu"),
            "DataSet 0, `timestep`",
            "`soon`",
        ),
        (
            &entry("inf", "0", "a.vtu"),
            "DataSet 0, `timestep`",
            "`inf`",
        ),
        (&entry("1", "x", "a.vtu"), "DataSet 0, `part`", "`x`"),
        (&entry("1", "0", " "), "DataSet 0, `file`", "``"),
        (
            &entry("1", "0", "b.PVD"),
            "DataSet 0, `file`",
            "another collection",
        ),
        (&twice, "files of time 1", "again"),
        ("<DataSet", "XML", "well-formed"),
    ] {
        let error = answer(entries).unwrap_err();
        assert!(error.contains(place) && error.contains(found), "{error}");
        assert!(!error.contains('\n') || place == "XML", "{error}");
    }
    // The format is recognised by content under another name.
    let inner = file_of(&entry("0", "0", "c.csv"));
    let outer = file_of(&entry("0", "0", "b.vtu"));
    let beside = |_: &Path| Some(inner.clone().into_bytes());
    let error = read_with("a.pvd", outer.as_bytes(), &OpenOptions::default(), &beside);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("another collection, `b.vtu`"), "{error}");
    // This is not a collection.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(&path, "x,y,z\n0,0,0\n").unwrap();
    let alone = steps_of(&path).unwrap();
    assert_eq!((alone.len(), alone[0].time), (1, None));
    assert_eq!(alone[0].parts[0].path, path);
}

#[test]
fn a_collection_opens_as_its_first_step() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    for (name, z) in [("a", 1), ("b", 2), ("c", 3)] {
        let path = folder.path().join("in").join(name).with_extension("csv");
        std::fs::write(path, format!("x,y,z,m\n0,0,{z},1\n")).unwrap();
    }
    let entries = [
        entry("3", "0", "in/c.csv"),
        entry("0.25", "1", "in/b.csv"),
        entry("0.25", "0", "in/a.csv"),
    ];
    let path = folder.path().join("any.xml");
    std::fs::write(&path, file_of(&entries.concat())).unwrap();
    let format = format_of(&path, &OpenOptions::default()).unwrap();
    assert_eq!(format.endings, ["pvd"]);
    let data = open(&path, &OpenOptions::default()).unwrap();
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    assert_eq!(positions[0].z, 1.0);
    assert_eq!(
        data.notes,
        [
            "The first of 2 time steps, of time 0.25.",
            "The first of 2 parts of the time step."
        ]
    );
    std::fs::remove_file(folder.path().join("in/a.csv")).unwrap();
    let error = open(&path, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a.csv"), "{error}");
}

#[test]
fn a_collection_of_paraviews_is_read() {
    let Some(path) = real_data("formats/collections/pvd/singleSphereAnimation.pvd") else {
        return;
    };
    let steps = steps_of(&path).unwrap();
    let times: Vec<f64> = steps.iter().filter_map(|step| step.time).collect();
    assert_eq!(times, (0..11).map(f64::from).collect::<Vec<_>>());
    assert!(
        steps
            .iter()
            .all(|step| step.parts.len() == 1 && step.parts[0].path.is_file())
    );
    let first = open(&steps[0].parts[0].path, &OpenOptions::default()).unwrap();
    let whole = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(whole.field_names(), first.field_names());
    assert_eq!(whole.bounds(), first.bounds());
    assert!(
        whole
            .notes
            .contains(&"The first of 11 time steps, of time 0.".to_owned())
    );
}

fn blocks(kind: &str, entries: &str) -> Vec<u8> {
    format!("<VTKFile type=\"{kind}\"><{kind}>{entries}</{kind}></VTKFile>").into_bytes()
}

/// Returns the files of a collection in a folder with others, relative to the folder.
fn files_of(name: &str, files: &[(&str, Vec<u8>)]) -> Result<Vec<Vec<PathBuf>>, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let steps = steps_of(&folder.path().join(name)).map_err(|e| e.to_string())?;
    let from = |part: &Part| part.path.strip_prefix(folder.path()).unwrap().to_owned();
    let of_step = |step: &TimeStep| step.parts.iter().map(from).collect();
    Ok(steps.iter().map(of_step).collect())
}

#[test]
fn blocks_are_the_parts_of_one_step() {
    let multi = blocks(
        "vtkMultiBlockDataSet",
        "<Block index=\"0\"><Block index=\"0\"><DataSet index=\"0\" file=\"a/a.vti\"/></Block></Block>\
         <Piece index=\"1\"><DataSet index=\"0\" file=\"a/b.vtp\"/><DataSet index=\"1\"/></Piece>\
         <DataSet index=\"2\" file=\"a/c.vtpc\"/>",
    );
    let collection = blocks(
        "vtkPartitionedDataSetCollection",
        "<Partitions index=\"0\"><DataSet index=\"0\" file=\"d.vtu\"/></Partitions>\
         <Partitions index=\"1\"><DataSet index=\"0\" file=\"e.vtm\"/></Partitions>",
    );
    // Levels of refinement stored as blocks are data.
    let levels = blocks("vtkHierarchicalBoxDataSet", "");
    let times = [entry("1", "0", "a.vtm"), entry("2", "0", "f.vtu")].concat();
    let files = [
        ("a.vtm", multi),
        ("a/c.vtpc", collection),
        ("a/e.vtm", levels),
        ("t.pvd", file_of(&times).into_bytes()),
    ];
    let all = ["a/a.vti", "a/b.vtp", "a/d.vtu", "a/e.vtm"].map(PathBuf::from);
    assert_eq!(files_of("a.vtm", &files).unwrap(), [all.to_vec()]);
    let steps = [all.to_vec(), vec!["f.vtu".into()]];
    assert_eq!(files_of("t.pvd", &files).unwrap(), steps);
}

#[test]
fn circles_and_paths_out_of_the_folder_are_refused() {
    let naming = |file: &str| {
        let entries = format!("<DataSet index=\"0\" file=\"{file}\"/>");
        blocks("vtkMultiBlockDataSet", &entries)
    };
    for (first, second, found) in [
        ("a.vtm", "", "again"),
        ("b.vtm", "a.vtm", "again"),
        ("b.vtm", "./b.vtm", "again"),
        ("../a.vtu", "", "`../a.vtu`"),
        ("/a.vtu", "", "`/a.vtu`"),
        ("b.vtm", "in/../../a.vtu", "a.vtu`"),
        ("c.vtm", "", "c.vtm"),
        ("", "", "at least one"),
    ] {
        let files = [("a.vtm", naming(first)), ("b.vtm", naming(second))];
        let error = files_of("a.vtm", &files).unwrap_err();
        assert!(error.contains(found), "{error}");
    }
    // The collection has another name.
    let outer = naming("b.xml");
    let inner = naming("a.vtm");
    let beside = |_: &Path| Some(inner.clone());
    let error = read_with("a.vtm", &outer, &OpenOptions::default(), &beside);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("another collection, `b.xml`"), "{error}");
}

#[test]
fn a_series_of_files_is_its_steps() {
    let folder = tempfile::tempdir().unwrap();
    for (name, z) in [("a", 1), ("b", 2), ("c", 3)] {
        let path = folder.path().join(name).with_extension("csv");
        std::fs::write(path, format!("x,y,z,m\n0,0,{z},1\n")).unwrap();
    }
    let path = folder.path().join("a.csv.series");
    let write = |files: &str| {
        let text = format!("{{\n\"file-series-version\" : \"1.0\",\n\"files\" : [{files}]\n}}");
        std::fs::write(&path, text).unwrap();
    };
    let file =
        |name: &str, time: &str| format!("{{ \"name\" : \"{name}.csv\", \"time\" : {time} }}");
    write(&[file("c", "2.5"), file("a", "-1"), file("b", "0")].join(","));
    let steps = steps_of(&path).unwrap();
    let times: Vec<_> = steps.iter().map(|step| step.time).collect();
    assert_eq!(times, [Some(-1.0), Some(0.0), Some(2.5)]);
    assert_eq!(steps[2].parts[0].path, folder.path().join("c.csv"));
    let data = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(data.bounds().unwrap().0.z, 1.0);
    assert!(
        data.notes[0].contains("The first of 3 time steps"),
        "{:?}",
        data.notes
    );
    // Without times, the positions in the list are the times.
    write("{ \"name\": \"b.csv\" }, { \"name\": \"a.csv\" }");
    let times: Vec<_> = steps_of(&path).unwrap().iter().map(|s| s.time).collect();
    assert_eq!(times, [Some(0.0), Some(1.0)]);
    for (files, says) in [
        ("", "one file at least"),
        (&*file("a", "\"soon\""), "line"),
        ("{ \"time\": 1 }", "missing field `name`"),
        ("{ \"name\": \" \" }", "files[0].name"),
        ("{ \"name\": \"b.vtk.series\" }", "files[0].name"),
        (&[file("a", "1"), file("a", "1")].join(","), "again"),
    ] {
        write(files);
        let error = steps_of(&path).unwrap_err().to_string();
        assert!(error.contains(says), "{files}: {error}");
    }
}

/// A compressed file of any readable format is read, too.
#[test]
fn packed_files_are_what_they_are_once_unpacked() {
    use crate::support::gzip;

    let vtk = b"# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n\
        ORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 8\nSCALARS a float\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n";
    let tecplot = crate::support::tecplot::BRICKS.as_bytes();
    let table = b"x,y,z,m\n1,2,3,4\n";
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, bytes, format) in [
        ("a.vtk.gz", &vtk[..], "legacy VTK"),
        ("a.vtk", &vtk[..], "legacy VTK"),
        ("a.dat.gz", tecplot, "Tecplot text"),
        ("a.csv.gz", &table[..], "CSV particle table"),
        ("a.gz", &table[..], "CSV particle table"),
    ] {
        let packed = gzip(bytes);
        let path = folder.join(name);
        std::fs::write(&path, &packed).unwrap();
        let whole = ewa_splat::io::read("a", bytes, &OpenOptions::default()).unwrap();
        let data = open(&path, &OpenOptions::default()).unwrap();
        assert!(
            data.format.contains(format) && data.format == whole.format,
            "{}",
            data.format
        );
        assert_eq!(
            (data.path.as_path(), data.bounds()),
            (path.as_path(), whole.bounds())
        );
        let steps = steps_of(&path).unwrap();
        assert!(
            steps.iter().all(|step| step.parts[0].path == path),
            "{steps:?}"
        );
        // The file is truncated.
        std::fs::write(&path, &packed[..packed.len() - 9]).unwrap();
        let error = open(&path, &OpenOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("gzip"), "{name}: {error}");
    }
    let twice = gzip(&gzip(vtk));
    let error = ewa_splat::io::read("a.vtk.gz", &twice, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("packed once"), "{error}");
    let unknown = gzip(b"no format begins like this, and so on");
    let error = ewa_splat::io::read("a.gz", &unknown, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a gzip archive"), "{error}");
}
