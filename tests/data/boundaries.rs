//! Tests boundaries of grids as surfaces: `SampleOptions::surface`.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, Geometry, Mesh, open,
};
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{KernelOptions, PurposeOptions, SampleOptions, as_surface, scene};
use ewa_splat::scene::{Lattice, LatticeSpacing, Strength};
use glam::{DMat3, DVec3};

use crate::common::{real_data, scalar};

fn opaque() -> SampleOptions {
    SampleOptions {
        surface: Some(1.0),
        ..SampleOptions::default()
    }
}

fn dataset(geometry: Geometry, fields: Vec<Field>) -> Dataset {
    Dataset::new(Path::new("a"), "test", geometry, fields)
}

/// The boundary of a data set, and the values of its field `f`.
struct Found {
    mesh: Mesh,
    values: Vec<f32>,
}

impl Found {
    fn of(dataset: Dataset) -> Self {
        let surface = as_surface(dataset, &opaque()).unwrap();
        let values = surface.scalar("f").map(|(_, values)| values);
        let values = values.map(|values| (0..values.len()).map(|i| values.get(i)).collect());
        let Geometry::Mesh(mesh) = surface.geometry else {
            panic!("a mesh expected");
        };
        let values = values.unwrap_or_default();
        Self { mesh, values }
    }

    fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let part = &self.mesh.parts[0];
        let of = |t: &[u32; 3]| t.map(|i| part.positions[i as usize]);
        part.triangles.iter().map(of)
    }

    fn area(&self) -> f64 {
        let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
        self.triangles().map(area).sum()
    }

    /// Returns the volume inside, by the divergence theorem: it is right only if every triangle faces outwards.
    fn volume(&self) -> f64 {
        let volume = |[a, b, c]: [DVec3; 3]| a.dot(b.cross(c)) / 6.0;
        self.triangles().map(volume).sum()
    }

    fn count(&self) -> usize {
        self.mesh.triangle_count()
    }
}

fn near(a: f64, b: f64) -> bool {
    // Sums of some hundred terms in double precision.
    (a - b).abs() <= 1e-12 * b.abs().max(1.0)
}

const DIMS: [usize; 3] = [4, 3, 5];

fn lattice() -> Lattice {
    Lattice::uniform(DIMS, DVec3::new(1.0, -2.0, 0.5), DVec3::new(1.0, 0.5, 2.0))
}

fn places(dims: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = dims;
    (0..x * y * z).map(move |n| [n % x, n / x % y, n / (x * y)])
}

/// Returns a linear field of positions.
fn at(p: DVec3) -> f32 {
    (p.x + 10.0 * p.y - 3.0 * p.z) as f32
}

#[test]
fn a_box_has_its_six_sides() {
    let values = places(DIMS).map(|ijk| at(lattice().position(ijk)));
    let of_nodes = scalar("f", Association::Nodes, values.collect());
    let found = Found::of(dataset(Geometry::Lattice(lattice()), vec![of_nodes]));
    // 3 x 2 x 4 cells of 1 x .5 x 2.
    assert_eq!(found.count(), 2 * 2 * (3 * 2 + 2 * 4 + 3 * 4));
    assert!(near(
        found.area(),
        2.0 * (3.0 * 1.0 + 1.0 * 8.0 + 3.0 * 8.0)
    ));
    assert!(near(found.volume(), 3.0 * 1.0 * 8.0));
    let part = &found.mesh.parts[0];
    // All nodes but the 2 x 1 x 3 inside.
    assert_eq!(part.positions.len(), 60 - 6);
    for (position, value) in part.positions.iter().zip(&found.values) {
        assert!((at(*position) - value).abs() < 1e-6);
    }
}

#[test]
fn a_face_has_the_value_of_its_cell() {
    let of_cell = |[i, j, k]: [usize; 3]| {
        let low = lattice().position([i, j, k]);
        let high = lattice().position([i + 1, j + 1, k + 1]);
        at(0.5 * (low + high))
    };
    let values = places([3, 2, 4]).map(of_cell);
    let of_cells = scalar("f", Association::Cells, values.collect());
    let found = Found::of(dataset(Geometry::Lattice(lattice()), vec![of_cells]));
    assert_eq!(found.values.len(), found.count());
    for (corners, value) in found.triangles().zip(&found.values) {
        // The triangle lies on a side of one cell only.
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let size = DVec3::new(1.0, 0.5, 2.0);
        let origin = lattice().position([0; 3]);
        let cell = ((middle - origin) / size).floor();
        let cell = cell.clamp(DVec3::ZERO, DVec3::new(2.0, 1.0, 3.0));
        let centre = origin + (cell + 0.5) * size;
        assert!((at(centre) - value).abs() < 1e-5, "{middle}: {value}");
    }
}

#[test]
fn sheared_mirrored_and_rectilinear_lattices_face_outwards() {
    let step = DMat3::from_cols(
        DVec3::new(-1.0, 0.0, 0.0),
        DVec3::new(0.5, 2.0, 0.0),
        DVec3::new(0.0, 0.25, 1.0),
    );
    let sheared = Lattice {
        dims: DIMS,
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::ZERO,
            step,
        },
    };
    let found = Found::of(dataset(Geometry::Lattice(sheared), Vec::new()));
    assert!(near(found.volume(), 24.0 * step.determinant().abs()));
    let rectilinear = Lattice {
        dims: [3, 2, 4],
        spacing: LatticeSpacing::Rectilinear {
            coordinates: [
                vec![0.0, 1.0, 4.0],
                vec![0.0, 2.0],
                vec![0.0, 0.5, 1.0, 3.0],
            ],
        },
    };
    let found = Found::of(dataset(Geometry::Lattice(rectilinear), Vec::new()));
    assert_eq!(found.count(), 2 * 2 * (2 + 3 + 6));
    assert!(near(found.area(), 2.0 * (8.0 + 6.0 + 12.0)));
    assert!(near(found.volume(), 24.0));
}

#[test]
fn faces_beside_hidden_cells_and_nodes_are_boundary() {
    let cube = || Lattice::uniform([4; 3], DVec3::ZERO, DVec3::ONE);
    let block = || CurvilinearBlock {
        dims: [4; 3],
        nodes: places([4; 3]).map(|ijk| cube().position(ijk)).collect(),
    };
    let hidden = |association, count: usize, at: usize, bit: f32| {
        let mut values = vec![0.0; count];
        values[at] = bit;
        scalar("vtkGhostType", association, values)
    };
    let both = |ghosts: &dyn Fn() -> Field, area: f64, volume: f64| {
        for geometry in [
            Geometry::Lattice(cube()),
            Geometry::Curvilinear {
                blocks: vec![block()],
            },
        ] {
            let found = Found::of(dataset(geometry, vec![ghosts()]));
            assert!(near(found.area(), area), "{}", found.area());
            assert!(near(found.volume(), volume), "{}", found.volume());
        }
    };
    // The cell in the middle: six faces inside. A cell at a corner: as many faces as before.
    both(&|| hidden(Association::Cells, 27, 13, 32.0), 60.0, 26.0);
    both(&|| hidden(Association::Cells, 27, 0, 32.0), 54.0, 26.0);
    // A node hides the cells around it: eight inside, one at a corner.
    both(&|| hidden(Association::Nodes, 64, 21, 2.0), 54.0, 19.0);
    both(&|| hidden(Association::Nodes, 64, 63, 2.0), 54.0, 26.0);
}

/// Returns a block over a box of cells of size one.
fn block(low: DVec3, cells: [usize; 3]) -> CurvilinearBlock {
    let dims = cells.map(|n| n + 1);
    let place = |[i, j, k]: [usize; 3]| low + DVec3::new(i as f64, j as f64, k as f64);
    CurvilinearBlock {
        dims,
        nodes: places(dims).map(place).collect(),
    }
}

#[test]
fn faces_that_blocks_share_are_no_boundary() {
    let blocks = vec![
        block(DVec3::ZERO, [3, 2, 2]),
        block(DVec3::new(3.0, 0.0, 0.0), [2, 2, 2]),
    ];
    let nodes = blocks.iter().flat_map(|block| &block.nodes);
    let of_nodes = scalar("f", Association::Nodes, nodes.map(|p| at(*p)).collect());
    let found = Found::of(dataset(Geometry::Curvilinear { blocks }, vec![of_nodes]));
    assert!(near(found.area(), 2.0 * (4.0 + 10.0 + 10.0)));
    assert_eq!(found.count(), 2 * 48);
    let part = &found.mesh.parts[0];
    for (position, value) in part.positions.iter().zip(&found.values) {
        assert!((at(*position) - value).abs() < 1e-6);
    }
    // A finer block on the same plane covers the coarser one, too.
    let fine = |ijk: [usize; 3]| {
        DVec3::new(3.0, 0.0, 0.0) + 0.5 * DVec3::new(ijk[0] as f64, ijk[1] as f64, ijk[2] as f64)
    };
    let fine = CurvilinearBlock {
        dims: [3, 5, 5],
        nodes: places([3, 5, 5]).map(fine).collect(),
    };
    let blocks = vec![block(DVec3::ZERO, [3, 2, 2]), fine];
    let found = Found::of(dataset(Geometry::Curvilinear { blocks }, Vec::new()));
    assert!(near(found.area(), 2.0 * (4.0 + 8.0 + 8.0)));
}

#[test]
fn a_seam_and_a_pole_are_no_boundary() {
    let (around, across, along) = (24, 3, 4);
    let ring = |inner: f64| {
        let place = |[i, j, k]: [usize; 3]| {
            // The angle of the last plane is 2 pi, whose sine is not quite 0.
            let angle = std::f64::consts::TAU * i as f64 / around as f64;
            let radius = inner + j as f64 / across as f64;
            DVec3::new(radius * angle.cos(), radius * angle.sin(), k as f64)
        };
        let dims = [around + 1, across + 1, along + 1];
        CurvilinearBlock {
            dims,
            nodes: places(dims).map(place).collect(),
        }
    };
    let chord = 2.0 * (std::f64::consts::PI / around as f64).sin();
    let sector = 0.5 * (std::f64::consts::TAU / around as f64).sin() * around as f64;
    let side = |radius: f64| around as f64 * chord * radius * along as f64;
    let blocks = vec![ring(1.0)];
    let found = Found::of(dataset(Geometry::Curvilinear { blocks }, Vec::new()));
    let caps = 2.0 * sector * (4.0 - 1.0);
    assert!(near(found.area(), side(1.0) + side(2.0) + caps));
    assert_eq!(found.count(), 4 * around * (along + across));
    // The inner side collapses to the axis: it has no area, and the caps close.
    let blocks = vec![ring(0.0)];
    let found = Found::of(dataset(Geometry::Curvilinear { blocks }, Vec::new()));
    assert!(near(found.area(), side(1.0) + 2.0 * sector));
}

/// Returns a mesh of one cell of each kind, side by side along x.
fn cell(kind: u8, nodes: Vec<DVec3>, entries: &[i64]) -> CellMesh {
    let list: Vec<i64> = std::iter::once(entries.len() as i64)
        .chain(entries.iter().copied())
        .collect();
    CellMesh::of_lists(nodes, &[kind], &list).unwrap()
}

fn cube_nodes() -> Vec<DVec3> {
    let bits = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]];
    let low = bits.map(|[x, y, z]| DVec3::new(f64::from(x), f64::from(y), f64::from(z)));
    low.into_iter()
        .chain(low.map(|p| p + DVec3::Z))
        .collect::<Vec<_>>()
}

#[test]
fn solids_of_each_kind_have_their_faces() {
    let cube = cube_nodes();
    let tetra: Vec<DVec3> = [0, 1, 3, 4].map(|i| cube[i]).to_vec();
    let middles = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
    let middles = middles.map(|[a, b]: [usize; 2]| 0.5 * (tetra[a] + tetra[b]));
    let quadratic: Vec<DVec3> = tetra.iter().copied().chain(middles).collect();
    let wedge: Vec<DVec3> = [0, 3, 1, 4, 7, 5].map(|i| cube[i]).to_vec();
    let pyramid: Vec<DVec3> = [0, 1, 2, 3, 4].map(|i| cube[i]).to_vec();
    let (two, three) = (2.0_f64.sqrt(), 3.0_f64.sqrt());
    let polyhedron = [
        6, 4, 0, 3, 2, 1, 4, 4, 5, 6, 7, 4, 0, 1, 5, 4, 4, 1, 2, 6, 5, 4, 2, 3, 7, 6, 4, 3, 0, 4, 7,
    ];
    let first: Vec<i64> = (0..10).collect();
    for (kind, nodes, entries, triangles, area, volume) in [
        (10, tetra, &first[..4], 4, 1.5 + 0.5 * three, 1.0 / 6.0),
        (24, quadratic, &first[..10], 4, 1.5 + 0.5 * three, 1.0 / 6.0),
        (12, cube.clone(), &first[..8], 12, 6.0, 1.0),
        (13, wedge, &first[..6], 8, 3.0 + two, 0.5),
        (14, pyramid, &first[..5], 6, 2.0 + two, 1.0 / 3.0),
        (42, cube.clone(), &polyhedron[..], 12, 6.0, 1.0),
    ] {
        let mesh = cell(kind, nodes, entries);
        let found = Found::of(dataset(Geometry::Cells(mesh), Vec::new()));
        let name = CellKind(kind).name();
        assert_eq!(found.count(), triangles, "{name}");
        assert!(near(found.area(), area), "{name}: {}", found.area());
        assert!(near(found.volume(), volume), "{name}: {}", found.volume());
    }
}

/// Returns two cubes side by side along x, the second with nodes of its own if `is_repeated`.
fn two_cubes(is_repeated: bool) -> CellMesh {
    let cube = cube_nodes();
    let mut nodes = cube.clone();
    let second: Vec<i64> = match is_repeated {
        true => {
            nodes.extend(cube.iter().map(|p| *p + DVec3::X));
            (8..16).collect()
        }
        false => {
            nodes.extend([1, 2, 5, 6].map(|i| cube[i] + DVec3::X));
            vec![1, 8, 9, 2, 5, 10, 11, 6]
        }
    };
    let list: Vec<i64> = [8, 0, 1, 2, 3, 4, 5, 6, 7, 8]
        .into_iter()
        .chain(second)
        .collect();
    CellMesh::of_lists(nodes, &[12, 12], &list).unwrap()
}

#[test]
fn faces_that_cells_share_are_no_boundary() {
    for is_repeated in [false, true] {
        let of_cells = scalar("f", Association::Cells, vec![3.0, 5.0]);
        let found = Found::of(dataset(
            Geometry::Cells(two_cubes(is_repeated)),
            vec![of_cells],
        ));
        assert!(near(found.area(), 10.0), "{is_repeated}: {}", found.area());
        for (corners, value) in found.triangles().zip(&found.values) {
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let expected = if middle.x < 1.0 { 3.0 } else { 5.0 };
            assert!((value - expected).abs() < 1e-6, "{middle}: {value}");
        }
    }
}

#[test]
fn a_cell_whose_nodes_run_the_other_way_faces_outwards() {
    let mesh = cell(12, cube_nodes(), &[4, 5, 6, 7, 0, 1, 2, 3]);
    let found = Found::of(dataset(Geometry::Cells(mesh), Vec::new()));
    assert!(near(found.volume(), 1.0), "{}", found.volume());
}

#[test]
fn hidden_cells_of_a_mesh_uncover_their_neighbours() {
    let ghosts = scalar("vtkGhostType", Association::Cells, vec![0.0, 32.0]);
    let found = Found::of(dataset(Geometry::Cells(two_cubes(false)), vec![ghosts]));
    assert!(near(found.area(), 6.0));
}

#[test]
fn surface_cells_belong_to_the_boundary_once() {
    let mut nodes = cube_nodes();
    nodes.extend([DVec3::new(3.0, 0.0, 0.0), DVec3::new(3.0, 1.0, 0.0)]);
    // A cube; a square on its top, which is one of its faces; the same again; one that stands free, twice.
    let list = [
        8, 0, 1, 2, 3, 4, 5, 6, 7, 4, 4, 5, 6, 7, 4, 7, 6, 5, 4, 4, 1, 8, 9, 2, 4, 1, 8, 9, 2,
    ];
    let mesh = CellMesh::of_lists(nodes, &[12, 9, 9, 9, 9], &list).unwrap();
    let of_cells = scalar("f", Association::Cells, vec![1.0, 2.0, 3.0, 4.0, 5.0]);
    let found = Found::of(dataset(Geometry::Cells(mesh), vec![of_cells]));
    assert!(near(found.area(), 6.0 + 2.0), "{}", found.area());
    let count = |value: f32| found.values.iter().filter(|v| **v == value).count();
    assert_eq!([1.0, 2.0, 3.0, 4.0, 5.0].map(count), [12, 0, 0, 2, 0]);
}

#[test]
fn a_translucent_boundary_has_its_opacity_head_on() {
    let values = places(DIMS).map(|ijk| at(lattice().position(ijk)));
    let of_nodes = scalar("f", Association::Nodes, values.collect());
    let data = dataset(Geometry::Lattice(lattice()), vec![of_nodes]);
    let options = |opacity: f64| SampleOptions {
        surface: Some(opacity),
        kernels: KernelOptions {
            spread: Spread::Count(2000),
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let sampled = scene(data.clone(), &options(0.3)).unwrap();
    let [volume] = sampled.volumes.as_slice() else {
        panic!("one volume expected");
    };
    let Strength::Translucent(strengths) = &volume.strength else {
        panic!("translucent surfels expected");
    };
    let depth: f64 = strengths.iter().map(|&s| f64::from(s)).sum();
    // Sums of f32.
    let expected = -(0.7_f64.ln()) * 70.0;
    assert!((depth / expected - 1.0).abs() < 1e-5, "{depth} {expected}");
    let sampled = scene(data, &options(1.0)).unwrap();
    assert!(matches!(sampled.volumes[0].strength, Strength::Surface(_)));
}

#[test]
fn data_without_a_boundary_are_refused() {
    let refused = |dataset: Dataset, options: &SampleOptions| {
        as_surface(dataset, options).unwrap_err().to_string()
    };
    let points = || {
        let positions = vec![DVec3::ZERO, DVec3::X];
        dataset(Geometry::Points { positions }, Vec::new())
    };
    let message = refused(points(), &opaque());
    assert!(
        message.contains("expected cells, found particles"),
        "{message}"
    );
    let grid = || dataset(Geometry::Lattice(lattice()), Vec::new());
    let columns = SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..PurposeOptions::default()
        },
        ..opaque()
    };
    assert!(refused(grid(), &columns).contains("column densities"));
    for opacity in [0.0, -1.0, 1.5, f64::NAN] {
        let options = SampleOptions {
            surface: Some(opacity),
            ..SampleOptions::default()
        };
        assert!(refused(grid(), &options).contains("above 0"));
    }
    let two = SampleOptions {
        flatten: Some(0.5),
        ..opaque()
    };
    assert!(refused(grid(), &two).contains("one surface"));
    let clear = SampleOptions {
        surface: Some(0.5),
        ..SampleOptions::default()
    };
    let cells = dataset(Geometry::Cells(two_cubes(false)), Vec::new());
    let message = scene(cells, &clear).unwrap_err().to_string();
    assert!(message.contains("expected a field to show"), "{message}");
}

#[test]
fn areas_of_public_meshes_are_those_of_vtk() {
    // Areas of vtkDataSetSurfaceFilter's triangles (VTK 9), and sums of f64. The grid has warped quadrilaterals, whose
    // area depends on the diagonal.
    for (name, area, tolerance) in [
        ("unstructured/disk_out_ref.vtu", 1_173.193_109_463_634, 1e-9),
        (
            "unstructured/CylinderLinear.vtk",
            0.006_846_283_617_493,
            1e-9,
        ),
        ("curvilinear/multicomb_0.vts", 274.448_780_428_614, 1e-5),
    ] {
        let Some(path) = real_data(name) else {
            continue;
        };
        let found = Found::of(open(&path, &ewa_splat::io::OpenOptions::default()).unwrap());
        let share = found.area() / area;
        println!("{name}: {} triangles, {share} of VTK's area", found.count());
        assert!((share - 1.0).abs() < tolerance, "{name}: {share}");
    }
}
