//! Defines a small data set of each kind, for tests.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::data::mesh::Mesh;
use crate::data::splats::SplatCloud;
use crate::scene::{Lattice, LatticeSpacing, SplatRule, Values};

/// Returns a field with the index of each sample, and a vector field.
fn fields(association: Association, count: usize) -> Vec<Field> {
    let numbers = |first: usize| Values::F32((first..first + count).map(|i| i as f32).collect());
    let name = |name: &str| match association {
        Association::Nodes => format!("{name} of nodes"),
        Association::Cells => format!("{name} of cells"),
    };
    vec![
        Field {
            name: name("number"),
            association,
            unit: None,
            source: FieldSource::Scalar(numbers(0)),
        },
        Field {
            name: name("vector"),
            association,
            unit: None,
            source: FieldSource::Vector([1, 2, 3].map(numbers).into()),
        },
    ]
}

fn dataset(geometry: Geometry, nodes: usize, cells: usize) -> Dataset {
    let mut all = fields(Association::Nodes, nodes);
    if cells > 0 {
        all.extend(fields(Association::Cells, cells));
    }
    Dataset::new(Path::new("made"), "made", geometry, all)
}

pub(super) fn uniform(step: DMat3) -> Dataset {
    let spacing = LatticeSpacing::Uniform {
        origin: DVec3::new(-1.0, 0.0, 0.5),
        step,
    };
    let dims = [5, 4, 3];
    dataset(Geometry::Lattice(Lattice { dims, spacing }), 60, 24)
}

pub(super) fn rectilinear() -> Dataset {
    let spacing = LatticeSpacing::Rectilinear {
        coordinates: [
            vec![-1.0, 0.0, 0.5, 2.0, 3.0],
            vec![0.0, 1.0, 3.0, 3.5],
            vec![-2.0, 0.0, 1.0],
        ],
    };
    let dims = [5, 4, 3];
    dataset(Geometry::Lattice(Lattice { dims, spacing }), 60, 24)
}

/// Returns a bent block of 4 x 4 x 3 nodes and a straight one of 3 x 3 x 2 beside it.
pub(super) fn curvilinear() -> Dataset {
    let block = |dims: [usize; 3], place: fn(f64, f64, f64) -> DVec3| {
        let [x, y, z] = dims;
        let node = |i: usize| place((i % x) as f64, (i / x % y) as f64, (i / x / y) as f64);
        CurvilinearBlock {
            dims,
            nodes: (0..x * y * z).map(node).collect(),
        }
    };
    let bent = block([4, 4, 3], |i, j, k| {
        let (radius, angle) = (1.0 + 0.5 * i, 0.4 * j);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.7 * k)
    });
    let straight = block([3, 3, 2], |i, j, k| DVec3::new(i - 3.0, 0.5 * j, k));
    let blocks = vec![bent, straight];
    dataset(Geometry::Curvilinear { blocks }, 48 + 18, 18 + 4)
}

/// Returns a cube as a polyhedron, a tetrahedron on top of it, a triangle beside it, and a node without a cell.
pub(super) fn cells() -> Dataset {
    let corner = |i: u32| DVec3::from([0, 1, 2].map(|d| f64::from(i >> d & 1)));
    let mut nodes = vec![DVec3::splat(9.0)];
    nodes.extend((0..8).map(corner));
    nodes.extend([DVec3::new(0.0, 0.0, 2.0), DVec3::new(-2.0, 0.0, 0.0)]);
    let faces = [
        [1, 3, 4, 2],
        [5, 6, 8, 7],
        [1, 2, 6, 5],
        [3, 7, 8, 4],
        [1, 5, 7, 3],
        [2, 4, 8, 6],
    ];
    let mut connectivity = vec![6];
    for face in faces {
        connectivity.push(4);
        connectivity.extend(face);
    }
    let mut offsets = vec![0, 31];
    connectivity.extend([5, 6, 7, 9, 1, 3, 10]);
    offsets.extend([35, 38]);
    let mesh = CellMesh {
        nodes,
        kinds: vec![CellKind::POLYHEDRON, CellKind::TETRA, CellKind::TRIANGLE],
        offsets,
        connectivity,
    };
    dataset(Geometry::Cells(mesh), 11, 3)
}

pub(super) fn spiral(count: usize) -> Vec<DVec3> {
    let place = |i: usize| {
        let turn = 0.7 * i as f64;
        DVec3::new(turn.cos(), turn.sin(), 0.1 * turn)
    };
    (0..count).map(place).collect()
}

pub(super) fn points() -> Dataset {
    let positions = spiral(40);
    dataset(Geometry::Points { positions }, 40, 0)
}

pub(super) fn splats() -> Dataset {
    let count = 12;
    let cloud = SplatCloud {
        positions: spiral(count),
        scales: vec![[0.3, 0.2, 0.1]; count],
        rotations: vec![[0.5, -0.1, 0.3, 0.9]; count],
        opacities: vec![0.5; count],
        harmonics_degree: 2,
        harmonics: (0..27 * count).map(|i| (i % 7) as f32 / 7.0).collect(),
        rule: SplatRule::Inria,
        is_linear: false,
        ..SplatCloud::default()
    };
    dataset(Geometry::Splats(cloud), count, 0)
}

/// Returns two triangles that share an edge, visible from one side.
pub(super) fn mesh() -> Dataset {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 1.0)];
    let mut mesh = Mesh::of_triangles(corners, [[0, 1, 2], [1, 3, 2]]);
    mesh.parts[0].normals = vec![glam::Vec3::Z; 4];
    mesh.materials[0].is_double_sided = false;
    Dataset::new(Path::new("made"), "made", Geometry::Mesh(mesh), Vec::new())
}

pub(super) fn all() -> Vec<Dataset> {
    let skew = DMat3::from_quat(DQuat::from_rotation_z(0.4)) * DMat3::from_diagonal(DVec3::ONE);
    vec![
        uniform(DMat3::from_diagonal(DVec3::new(1.0, 0.5, 2.0))),
        uniform(DMat3::from_diagonal(DVec3::new(-1.0, 0.5, 2.0))),
        uniform(skew),
        rectilinear(),
        curvilinear(),
        cells(),
        points(),
        splats(),
        mesh(),
    ]
}
