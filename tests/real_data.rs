//! Real files, where they are present: `EWA_DATA_DIR`, or `../shared/data` beside the crate.
//!
//! A missing file is a skipped test, unless `EWA_REQUIRE_DATA=1`.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::{Path, PathBuf};

use ewa_splat::io::{CurvilinearBlock, Dataset, Geometry, OpenOptions, RawLayout, RawType, open};
use ewa_splat::scene::Values;

/// The path of a real file, or `None` (with a word about it) where it is absent.
fn real(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("EWA_DATA_DIR").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    if path.is_file() {
        return Some(path);
    }
    let required = std::env::var_os("EWA_REQUIRE_DATA").is_some_and(|v| v == "1");
    assert!(!required, "{} is required and absent", path.display());
    println!("skipped: no {}", path.display());
    None
}

fn read(path: &Path) -> Dataset {
    open(path, &OpenOptions::default()).unwrap()
}

fn read_raw(path: &Path, dims: [usize; 3]) -> Values {
    let raw = Some(RawLayout::new(dims, RawType::U8));
    let data = open(
        path,
        &OpenOptions {
            raw,
            solution: None,
        },
    )
    .unwrap();
    data.scalar("value").unwrap().1
}

#[test]
fn engine_raw_and_compressed_are_the_same() {
    let Some(path) = real("volumes/engine_256x256x128_uint8.raw") else {
        return;
    };
    let values = read_raw(&path, [256, 256, 128]);
    assert_eq!(values.finite_range(), Some([0.0, 255.0]));
    let mean = (0..values.len())
        .map(|i| f64::from(values.get(i)))
        .sum::<f64>()
        / 8_388_608.0;
    assert!((mean - 22.35).abs() < 0.005, "{mean}");
    let Some(path) = real("volumes/engine_256x256x128_uint8.raw.gz") else {
        return;
    };
    assert_eq!(read_raw(&path, [256, 256, 128]), values);
}

#[test]
fn nucleon_has_its_range() {
    let Some(path) = real("volumes/nucleon_41x41x41_uint8.raw") else {
        return;
    };
    assert_eq!(read_raw(&path, [41; 3]).finite_range(), Some([0.0, 249.0]));
    let err = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(err.contains("--dims 41,41,41 --type u8"), "{err}");
}

#[test]
fn blunt_fin_finds_its_solution() {
    let Some(path) = real("curvilinear/bluntfin/bluntfinxyz.bin") else {
        return;
    };
    let data = read(&path);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!()
    };
    let CurvilinearBlock { dims, nodes } = &blocks[0];
    assert_eq!(dims, &[40, 32, 32]);
    let x = nodes
        .iter()
        .map(|n| n.x)
        .fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(x), b.max(x)]);
    // The manifest prints four decimals.
    assert!(
        (x[0] + 7.8157).abs() < 5e-5 && (x[1] - 14.3622).abs() < 5e-5,
        "{x:?}"
    );
    let [low, high] = data.scalar("density").unwrap().1.finite_range().unwrap();
    assert!(
        (low - 0.1926).abs() < 5e-5 && (high - 4.9775).abs() < 5e-5,
        "{low} {high}"
    );
    // The free stream has Mach 2.95; no flow over a fin is much faster.
    let [low, high] = data.scalar("mach").unwrap().1.finite_range().unwrap();
    assert!(low >= 0.0 && (2.9..4.0).contains(&high), "{low} {high}");
    assert_eq!(data.scalar("pressure").unwrap().1.non_finite_count(), 0);
}

#[test]
fn phantom_particles_have_their_columns() {
    let Some(path) = real("particles/phantom_mhd_00000.csv") else {
        return;
    };
    let data = read(&path);
    let Geometry::Points { positions } = &data.geometry else {
        panic!()
    };
    assert_eq!(positions.len(), 4843);
    assert_eq!(data.field_names(), ["h", "m", "rho", "vx", "vy", "vz"]);
    let [low, high] = data.scalar("h").unwrap().1.finite_range().unwrap();
    assert!(
        (low - 0.5154).abs() < 5e-5 && (high - 1.648).abs() < 5e-4,
        "{low} {high}"
    );
}

/// The table was derived from the dump with h5py and printed to nine digits.
#[test]
fn a_phantom_dump_says_what_its_table_says() {
    let (Some(dump), Some(table)) = (
        real("particles/phantom_mhd_00000.h5"),
        real("particles/phantom_mhd_00000.csv"),
    ) else {
        return;
    };
    let (dump, table) = (read(&dump), read(&table));
    let (Geometry::Points { positions: a }, Geometry::Points { positions: b }) =
        (&dump.geometry, &table.geometry)
    else {
        panic!()
    };
    assert_eq!(a.len(), b.len());
    // Half a unit in the ninth digit; 2^-24 more where both are narrowed.
    let printed = |a: f64, b: f64, narrowed: f64| (a - b).abs() <= (5e-9 + narrowed) * b.abs();
    for (a, b) in a.iter().zip(b) {
        assert!((0..3).all(|d| printed(a[d], b[d], 0.0)), "{a} {b}");
    }
    for (ours, theirs) in [
        ("h", "h"),
        ("m", "m"),
        ("rho", "rho"),
        ("vxyz:x", "vx"),
        ("vxyz:y", "vy"),
        ("vxyz:z", "vz"),
    ] {
        let (_, a) = dump.scalar(ours).unwrap();
        let (_, b) = table.scalar(theirs).unwrap();
        assert_eq!(a.len(), b.len());
        for i in 0..a.len() {
            let (a, b) = (f64::from(a.get(i)), f64::from(b.get(i)));
            assert!(printed(a, b, 1.2e-7), "{ours} {i}: {a} {b}");
        }
    }
}

#[test]
fn halo_particles_lie_in_their_box() {
    let Some(path) = real("particles/halo_low_res.npy") else {
        return;
    };
    let data = read(&path);
    let Geometry::Points { positions } = &data.geometry else {
        panic!()
    };
    assert_eq!(positions.len(), 32314);
    assert!(
        positions
            .iter()
            .all(|p| (74.5..78.93).contains(&p.x) && (16.15..22.76).contains(&p.y))
    );
    assert!(data.fields.is_empty());
}

#[test]
fn formats_to_come_are_refused_by_name() {
    for (name, words) in [
        ("curvilinear/multicomb_0.vts", "StructuredGrid"),
        ("unstructured/can.vtu", "UnstructuredGrid"),
        ("unstructured/CylinderLinear.vtk", "legacy VTK"),
        ("unstructured/disk_out_ref.ex2", "Exodus"),
        ("splats/fruit_drops_minimal.ply", "PLY"),
        ("meshes/gltf/Duck.glb", "glTF"),
        ("curvilinear/bluntfin/bluntfinq.bin", "--solution"),
    ] {
        let Some(path) = real(name) else { continue };
        let err = open(&path, &OpenOptions::default())
            .unwrap_err()
            .to_string();
        assert!(err.contains(words), "{err}");
    }
}
