//! Tests that a file read from memory gives the same data as from disk.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::HashMap;
use std::path::Path;

use crate::common::real_data;
use crate::support::Folder;
use crate::support::meshes::png;
use crate::support::seeds::seeds;
use ewa_splat::io::{
    Association, Dataset, OpenOptions, Ranges, RawLayout, RawType, open, read, read_with,
};

/// Formats a data set as text, so that NaN equals NaN.
fn text(data: &Dataset) -> String {
    format!("{data:?}")
}

/// Reads a file both ways, under its own path, and compares the results.
fn check(path: &Path, options: &OpenOptions) {
    let bytes = std::fs::read(path).unwrap();
    let name = path.to_str().unwrap();
    let beside = |path: &Path| std::fs::read(path).ok();
    match (
        open(path, options),
        read_with(name, &bytes, options, &beside),
    ) {
        (Ok(file), Ok(memory)) => assert!(text(&file) == text(&memory), "{name}"),
        (Err(file), Err(memory)) => assert_eq!(file.to_string(), memory.to_string()),
        (file, memory) => panic!("{name}: {:?} and {:?}", file.err(), memory.err()),
    }
}

#[test]
fn seeds_of_every_format_are_the_same() {
    let folder = Folder::new();
    // The message about a series' missing files differs for files in memory.
    for (name, bytes) in seeds()
        .iter()
        .filter(|(name, _)| !name.ends_with(".series"))
    {
        let path = folder.file(name, bytes);
        check(&path, &OpenOptions::default());
        // A truncated file gives the same error.
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        check(&path, &OpenOptions::default());
        std::fs::remove_file(path).unwrap();
    }
    let path = folder.file("a_2x2x1_int16.raw", &[1, 0, 2, 0, 3, 0, 255, 255]);
    check(&path, &OpenOptions::default());
    for dims in [[2, 2, 1], [2, 2, 2]] {
        let options = OpenOptions {
            raw: Some(RawLayout::new(dims, RawType::I16)),
            ..OpenOptions::default()
        };
        check(&path, &options);
    }
}

#[test]
fn fixtures_are_the_same() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            check(&path, &OpenOptions::default());
            count += 1;
        }
    }
    assert!(count >= 16, "{count}");
}

/// Drawables of front ends: collections, snapshots of several types, errors.
#[test]
fn drawables_are_the_same() {
    use ewa_splat::session::{Data, Drawable, Opening, Said, Sampling, opening, sampling};

    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let shown = |drawable: &Drawable| {
        let sets = drawable.sources.iter().map(|source| match &source.data {
            Data::Set(set) => text(set),
            Data::Surfels(_) => panic!("no data set"),
        });
        sets.collect::<Vec<_>>()
    };
    let cases = [
        ("pieces/duct.vtm", "{}", 1),
        ("pieces/horn.pvts", "{}", 1),
        (
            "gadget_types.h5",
            r#"{"particle_types": ["gas", "stars"]}"#,
            2,
        ),
        ("image_in_time.vtkhdf", r#"{"time_step": -1}"#, 1),
        ("wake.q", "{}", 0),
    ];
    for (name, settings, count) in cases {
        let path = folder.join(name);
        let (how, own): (Opening, Sampling) =
            Said::all(Some(settings), |said| Ok((opening(said)?, sampling(said)?))).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let beside =
            |path: &Path| -> Option<Box<dyn Ranges>> { Some(Box::new(std::fs::read(path).ok()?)) };
        let file = Drawable::open(&path, &how, &own);
        let memory = Drawable::open_with(path.to_str().unwrap(), &bytes, &beside, &how, &own);
        match (file, memory) {
            (Ok(file), Ok(memory)) => {
                assert!(shown(&file) == shown(&memory), "{name}");
                assert!(count > 0 && file.sources.len() >= count, "{name}");
                // Other options, the same data.
                let again = memory.sampled_by(&own).unwrap();
                assert!(shown(&again) == shown(&memory), "{name}");
            }
            (Err(file), Err(memory)) => {
                assert_eq!((file.to_string(), count), (memory.to_string(), 0));
            }
            (file, memory) => panic!("{name}: {:?} and {:?}", file.err(), memory.err()),
        }
    }
}

#[test]
fn real_data_are_the_same() {
    for name in [
        "particles/phantom_mhd_00000.h5",
        "formats/collections/pvd/singleSphereAnimation.pvd",
        "particles/halo_low_res.npy",
        "particles/bunny_frame_14_7705_particles.vtk",
        "meshes/obj/cornell_box/cornell_box.obj",
        "meshes/obj/spot/spot_triangulated.obj",
        "meshes/gltf/BoxTextured/BoxTextured.gltf",
        "meshes/gltf/VertexColorTest.glb",
        "curvilinear/bluntfin/bluntfinxyz.bin",
        "curvilinear/multicomb_0.vts",
        "formats/volumes/beach.nrrd",
        "formats/volumes/beach.ascii.nhdr",
        "formats/volumes/HeadMRVolume.mhd",
    ] {
        if let Some(path) = real_data(name) {
            check(&path, &OpenOptions::default());
        }
    }
}

#[test]
fn files_beside_are_asked_for_by_their_paths() {
    let obj = b"mtllib m/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n\
                usemtl one\nf 1/1 2/2 3/3\n";
    let mtl = b"newmtl one\nKd 1 0 0\nmap_Kd a.png\n";
    let files: HashMap<&str, Vec<u8>> = [
        ("in/m/a.mtl", mtl.to_vec()),
        ("in/a.png", png(1, &[[9; 4]])),
    ]
    .into();
    let beside = |path: &Path| files.get(path.to_str()?).cloned();
    let options = OpenOptions::default();
    let with = read_with("in/a.obj", obj, &options, &beside).unwrap();
    assert!(with.notes.is_empty(), "{:?}", with.notes);
    let ewa_splat::io::Geometry::Mesh(mesh) = &with.geometry else {
        panic!()
    };
    assert_eq!(mesh.textures.len(), 1);
    // Without these files, the mesh is the same as on a disk without them.
    let without = read("in/a.obj", obj, &options).unwrap();
    assert!(without.notes[0].contains("m/a.mtl"), "{:?}", without.notes);

    // An index names its pieces, each once, however it is spelt.
    let piece = seeds().iter().find(|(name, _)| name == "a.vti").unwrap();
    let index = |sources: &[&str]| {
        let pieces: String = { sources.iter() }
            .map(|s| format!("<Piece Extent=\"0 2 0 2 0 1\" Source=\"{s}\"/>"))
            .collect();
        format!(
            "<?xml version=\"1.0\"?><VTKFile type=\"PImageData\"><PImageData \
             WholeExtent=\"0 2 0 2 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\">{pieces}\
             </PImageData></VTKFile>"
        )
    };
    let beside = |path: &Path| (path == Path::new("a.vti")).then(|| piece.1.clone());
    let of = |text: String| read_with("b.pvti", text.as_bytes(), &options, &beside);
    let data = of(index(&["a.vti"])).unwrap();
    assert_eq!(data.scalar("a").unwrap().0, Association::Nodes);
    let missing = of(index(&["c.vti"])).unwrap_err().to_string();
    assert!(
        missing.starts_with("b.pvti: ") && missing.contains("`c.vti`"),
        "{missing}"
    );
    let twice = of(index(&["a.vti", "a.vti"])).unwrap_err().to_string();
    assert!(twice.contains("each file once"), "{twice}");

    // A named solution is absent; another lies beside the grid by its name.
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let grid = std::fs::read(fixtures.join("wake.xyz")).unwrap();
    let named = OpenOptions {
        solution: Some("other.q".into()),
        ..OpenOptions::default()
    };
    let error = read("wake.xyz", &grid, &named).unwrap_err().to_string();
    assert!(
        error.starts_with("wake.xyz: ") && error.contains("other.q"),
        "{error}"
    );
    assert!(read("wake.xyz", &grid, &options).unwrap().fields.is_empty());
    let solution = std::fs::read(fixtures.join("wake.q")).unwrap();
    let beside = |path: &Path| (path == Path::new("wake.q")).then(|| solution.clone());
    let whole = read_with("wake.xyz", &grid, &options, &beside).unwrap();
    assert_eq!(whole.field_names()[0], "density");
}

#[test]
fn errors_have_the_name_that_was_given() {
    for (name, bytes) in [
        ("nothing.vti", &b""[..]),
        ("table.csv", b"x,y,z\n1,2\n"),
        ("what.foo", b"\x00\x01\x02"),
        ("volume.raw", b"\x00\x01\x02"),
    ] {
        let error = read(name, bytes, &OpenOptions::default()).unwrap_err();
        assert_eq!(error.file(), Some(Path::new(name)), "{error}");
        assert!(error.to_string().starts_with(name), "{error}");
    }
}
