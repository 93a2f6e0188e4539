//! Tests real files, if they are present in `EWA_DATA_DIR`, or `../shared/data` beside the crate.
//!
//! A missing file skips its test, unless `EWA_REQUIRE_DATA=1`.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use crate::common::real_data;

use ewa_splat::Error;
use ewa_splat::io::{
    Association, CellKind, CurvilinearBlock, Dataset, Geometry, OpenOptions, RawLayout, RawType,
    SplatCloud, open,
};
use ewa_splat::sample::{SampleOptions, volume as sample};
use ewa_splat::scene::{SplatRule, Values};
use glam::DVec3;

fn read(path: &Path) -> Dataset {
    open(path, &OpenOptions::default()).unwrap()
}

fn read_raw(path: &Path, dims: [usize; 3]) -> Values {
    let raw = Some(RawLayout::new(dims, RawType::U8));
    let data = open(
        path,
        &OpenOptions {
            raw,
            ..OpenOptions::default()
        },
    )
    .unwrap();
    data.scalar("value").unwrap().1
}

#[test]
fn engine_raw_and_compressed_are_the_same() {
    let Some(path) = real_data("volumes/engine_256x256x128_uint8.raw") else {
        return;
    };
    let values = read_raw(&path, [256, 256, 128]);
    assert_eq!(values.finite_range(), Some([0.0, 255.0]));
    let mean = (0..values.len())
        .map(|i| f64::from(values.get(i)))
        .sum::<f64>()
        / 8_388_608.0;
    assert!((mean - 22.35).abs() < 0.005, "{mean}");
    let Some(path) = real_data("volumes/engine_256x256x128_uint8.raw.gz") else {
        return;
    };
    assert_eq!(read_raw(&path, [256, 256, 128]), values);
}

#[test]
fn nucleon_has_its_range() {
    let Some(path) = real_data("volumes/nucleon_41x41x41_uint8.raw") else {
        return;
    };
    assert_eq!(read_raw(&path, [41; 3]).finite_range(), Some([0.0, 249.0]));
    match open(&path, &OpenOptions::default()) {
        Err(Error::NoLayout {
            suggested: Some(layout),
            ..
        }) => assert_eq!((layout.dims, layout.scalar), ([41; 3], "u8")),
        other => panic!("{other:?}"),
    }
}

#[test]
fn blunt_fin_finds_its_solution() {
    let Some(path) = real_data("curvilinear/bluntfin/bluntfinxyz.bin") else {
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
    // The free stream has Mach 2.95; flow over a fin is not much faster.
    let [low, high] = data.scalar("mach").unwrap().1.finite_range().unwrap();
    assert!(low >= 0.0 && (2.9..4.0).contains(&high), "{low} {high}");
    assert_eq!(data.scalar("pressure").unwrap().1.non_finite_count(), 0);
}

#[test]
fn phantom_particles_have_their_columns() {
    let Some(path) = real_data("particles/phantom_mhd_00000.csv") else {
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
        real_data("particles/phantom_mhd_00000.h5"),
        real_data("particles/phantom_mhd_00000.csv"),
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
    // Half a unit in the ninth digit; 2^-24 more if both are narrowed.
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
    let Some(path) = real_data("particles/halo_low_res.npy") else {
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

/// Checks a range that the manifest prints with a few decimals.
fn assert_range(data: &Dataset, field: &str, range: [f64; 2], tolerance: f64) {
    let found = data.scalar(field).unwrap().1.finite_range().unwrap();
    let close = |i: usize| (found[i] - range[i]).abs() <= tolerance;
    assert!(close(0) && close(1), "{field}: {found:?} for {range:?}");
}

fn bounds(positions: &[DVec3]) -> [DVec3; 2] {
    positions
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], &p| {
            [a.min(p), b.max(p)]
        })
}

#[test]
fn the_rectilinear_grid_has_its_bounds() {
    let Some(path) = real_data("rectilinear/RectGrid2.vtk") else {
        return;
    };
    let data = read(&path);
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!()
    };
    assert_eq!(lattice.dims, [47, 33, 11]);
    let corners = [
        lattice.position([0; 3]),
        lattice.position(lattice.dims.map(|n| n - 1)),
    ];
    let expected = [DVec3::new(-1.224, -1.25, 0.0), DVec3::new(1.172, 1.25, 0.9)];
    for (corner, expected) in corners.iter().zip(expected) {
        assert!(corner.abs_diff_eq(expected, 5e-4), "{corner}");
    }
    assert_eq!(data.field_names(), ["scalars", "vectors"]);
    assert_range(&data, "scalars", [0.0, 10.396], 5e-4);
    assert_eq!(data.scalar("vectors:z").unwrap().1.len(), 47 * 33 * 11);
}

#[test]
fn the_cylinder_is_of_tetrahedra() {
    let Some(path) = real_data("unstructured/CylinderLinear.vtk") else {
        return;
    };
    let data = read(&path);
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!()
    };
    assert_eq!((mesh.nodes.len(), mesh.cell_count()), (465, 1522));
    assert!(mesh.kinds.iter().all(|&kind| kind == CellKind::TETRA));
    assert_eq!(mesh.connectivity.len(), 4 * 1522);
    let [low, high] = bounds(&mesh.nodes);
    assert!(
        low.abs_diff_eq(DVec3::new(-0.01, -0.01, 0.0), 1e-6),
        "{low}"
    );
    assert!(
        high.abs_diff_eq(DVec3::new(0.01, 0.01, 0.1), 1e-6),
        "{high}"
    );
    assert_range(&data, "vel_norm", [0.0, 1.0044], 5e-5);
    // The file also stores the norm of the velocity, in double precision.
    let (norm, computed) = (
        data.scalar("vel_norm").unwrap().1,
        data.scalar("velocity").unwrap().1,
    );
    for i in 0..465 {
        assert!((norm.get(i) - computed.get(i)).abs() < 1e-6, "{i}");
    }
}

#[test]
fn the_fluid_is_of_particles() {
    let Some(path) = real_data("particles/bunny_frame_14_7705_particles.vtk") else {
        return;
    };
    let data = read(&path);
    let Geometry::Points { positions } = &data.geometry else {
        panic!()
    };
    assert_eq!(positions.len(), 7706);
    assert!(positions.iter().all(|p| p.is_finite()));
    assert_eq!(data.field_names(), ["id", "velocity"]);
    let ids = data.scalar("id").unwrap().1;
    let mut ids: Vec<f32> = (0..ids.len()).map(|i| ids.get(i)).collect();
    ids.sort_by(f32::total_cmp);
    ids.dedup();
    assert_eq!(ids.len(), 7706, "an id for each");
    assert_eq!(data.scalar("velocity").unwrap().1.non_finite_count(), 0);
}

fn splats(data: &Dataset) -> &SplatCloud {
    match &data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

#[test]
fn fruit_drops_are_splats_of_degree_3() {
    let Some(path) = real_data("splats/fruit_drops_minimal.ply") else {
        return;
    };
    let data = read(&path);
    let cloud = splats(&data);
    assert_eq!((cloud.positions.len(), cloud.harmonics_degree), (4721, 3));
    assert!(cloud.rule == SplatRule::Inria && data.notes.is_empty());
    // Normals, and one property that the layout does not define.
    assert_eq!(data.field_names(), ["nx", "ny", "nz", "transform"]);
    let length = |q: &[f32; 4]| q.iter().map(|c| c * c).sum::<f32>().sqrt();
    let lengths = cloud.rotations.iter().map(length);
    let [least, most] = lengths.fold([f32::MAX, 0.0], |[a, b], l| [a.min(l), b.max(l)]);
    // The manifest prints three decimals.
    assert!(
        (least - 0.598).abs() < 5e-4 && (most - 1.928).abs() < 5e-4,
        "{least} {most}"
    );
    assert!(cloud.scales.iter().flatten().all(|s| *s > 0.0 && *s < 1.0));
    let sampled = sample(data, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.report.left_out_count(), 0);
}

/// Three splats of one scene as PLY, .splat and SPZ have the same position, shape and colour.
#[test]
fn one_scene_in_three_formats_is_one_scene() {
    let names = ["ply", "splat", "spz"];
    let paths = names.map(|e| real_data(&format!("splats/test-splat.3-points-from-train.{e}")));
    let [Some(ply), Some(records), Some(spz)] = paths else {
        return;
    };
    let (ply, records, spz) = (read(&ply), read(&records), read(&spz));
    let of = |data: &Dataset| splats(data).clone();
    let (ply, records, spz) = (of(&ply), of(&records), of(&spz));
    assert_eq!((ply.harmonics_degree, spz.harmonics_degree), (3, 3));
    let unit = |q: [f32; 4]| {
        let length = q.iter().map(|c| c * c).sum::<f32>().sqrt();
        q.map(|c| c / length * q[0].signum())
    };
    let near = |a: f32, b: f32, most: f32, what: &str| {
        assert!((a - b).abs() <= most, "{what}: {a} {b}");
    };
    // A quantum is the value of one step of the format's integers. Rounding errs by at most half of
    // it, truncation by a whole one (the .splat file was truncated).
    for (other, position, scale, rotation, opacity, constant) in [
        (
            &records,
            0.0,
            1e-6,
            1.0 / 64.0,
            1.0 / 255.0,
            1.0 / 255.0 / 0.282,
        ),
        // Steps: 1/4096; of logarithms 1/16; of ten bits 1/(511 sqrt 2).
        (
            &spz,
            0.5 / 4096.0,
            0.5 / 16.0 + 1e-5,
            0.002,
            0.5 / 255.0 + 1e-6,
            0.5 / 255.0 / 0.15 + 1e-6,
        ),
    ] {
        assert_eq!(other.positions.len(), 3);
        for i in 0..3 {
            let apart = (ply.positions[i] - other.positions[i]).abs().max_element();
            assert!(apart <= position, "{apart}");
            let (p, q) = (unit(ply.rotations[i]), unit(other.rotations[i]));
            for k in 0..4 {
                near(p[k], q[k], rotation, "rotation");
            }
            for k in 0..3 {
                near(
                    ply.scales[i][k].ln(),
                    other.scales[i][k].ln(),
                    scale,
                    "scale",
                );
                let (a, b) = (
                    ply.harmonics[i * ply.harmonics_stride() + k],
                    other.harmonics[i * other.harmonics_stride() + k],
                );
                near(a, b, constant, "constant");
            }
            near(ply.opacities[i], other.opacities[i], opacity, "opacity");
        }
    }
    // Five bits for degree 1, four for the others, in -1..1: half a step of 1/8.
    for (a, b) in ply.harmonics.iter().zip(&spz.harmonics) {
        near(*a, *b, 1.0 / 16.0 + 1.0 / 128.0, "harmonic");
    }
    // The signs of coefficients that are large enough to keep one.
    let large = |(a, b): &(&f32, &f32)| a.abs() > 0.07 && b.abs() > 0.03;
    let pairs = || ply.harmonics.iter().zip(&spz.harmonics).filter(large);
    assert!(pairs().count() >= 12);
    assert!(pairs().all(|(a, b)| a * b > 0.0));
}

#[test]
fn a_piece_of_the_combustor_is_read() {
    let Some(path) = real_data("curvilinear/multicomb_0.vts") else {
        return;
    };
    let data = read(&path);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!()
    };
    assert_eq!(blocks[0].dims, [6, 12, 9]);
    assert_eq!(blocks[0].nodes.len(), 6 * 12 * 9);
    assert_range(&data, "Density", [0.203, 0.710], 5e-4);
    assert!(data.scalar("Momentum:z").is_ok());
}

#[test]
fn the_can_has_its_cells_and_their_values() {
    let Some(path) = real_data("unstructured/can.vtu") else {
        return;
    };
    let data = read(&path);
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!()
    };
    assert_eq!((mesh.nodes.len(), mesh.cell_count()), (6724, 4800));
    assert!(mesh.kinds.iter().all(|&kind| kind == CellKind::HEXAHEDRON));
    assert_range(&data, "EQPS", [0.0216, 2.894], 5e-4);
    assert_eq!(data.scalar("EQPS").unwrap().0, Association::Cells);
    assert_eq!(data.scalar("VEL:x").unwrap().1.len(), 6724);
}

#[test]
fn the_reactor_has_its_temperature() {
    let Some(path) = real_data("unstructured/disk_out_ref.vtu") else {
        return;
    };
    let data = read(&path);
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!()
    };
    assert_eq!((mesh.nodes.len(), mesh.cell_count()), (8499, 7472));
    assert!(mesh.kinds.iter().all(|&kind| kind == CellKind::HEXAHEDRON));
    let z = mesh.nodes.iter().map(|n| n.z);
    let z = z.fold([f64::MAX, f64::MIN], |[a, b], z| [a.min(z), b.max(z)]);
    assert!(
        (z[0] + 10.0).abs() < 5e-3 && (z[1] - 10.16).abs() < 5e-3,
        "{z:?}"
    );
    assert_range(&data, "Temp", [293.15, 913.15], 5e-3);
}

#[test]
fn a_solution_is_no_grid() {
    let Some(path) = real_data("curvilinear/bluntfin/bluntfinq.bin") else {
        return;
    };
    let error = open(&path, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("as its solution"), "{error}");
}
