//! Samples one field on lattices, on a warped grid and on tetrahedra, all of which fill [-1, 1]³.

use std::path::Path;

use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, FieldSource, Geometry,
};
use ewa_splat::scene::{Lattice, Values};
use glam::{DMat3, DVec3};

/// Centre, standard deviation and height of each blob.
const BLOBS: [([f64; 3], f64, f64); 6] = [
    ([-0.35, -0.30, -0.20], 0.34, 0.95),
    ([0.40, -0.25, 0.15], 0.28, 0.85),
    ([0.05, 0.45, -0.30], 0.30, 0.80),
    ([-0.30, 0.25, 0.45], 0.24, 0.70),
    ([0.35, 0.40, 0.40], 0.22, 0.75),
    ([0.05, -0.50, -0.50], 0.20, 0.60),
];

/// Evaluates a sum of Gaussian blobs, 0 to about 1.
pub(crate) fn field(x: DVec3) -> f64 {
    BLOBS
        .iter()
        .map(|(centre, sigma, height)| {
            let away = x.distance_squared(DVec3::from(*centre));
            height * (-0.5 * away / (sigma * sigma)).exp()
        })
        .sum()
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Lattice,
    Warp,
    Tetrahedra,
}

pub(crate) const GRIDS: [(&str, Kind, usize); 6] = [
    ("lattice-33", Kind::Lattice, 33),
    ("lattice-65", Kind::Lattice, 65),
    ("lattice-129", Kind::Lattice, 129),
    ("warp-33", Kind::Warp, 33),
    ("warp-65", Kind::Warp, 65),
    ("tetrahedra-33", Kind::Tetrahedra, 33),
];

/// Samples the field on `n` nodes along each axis.
pub(crate) fn dataset(kind: Kind, n: usize) -> Dataset {
    let spacing = 2.0 / (n - 1) as f64;
    let nodes: Vec<DVec3> = (0..n.pow(3))
        .map(|i| DVec3::from(index(i, n).map(|n| n as f64)) * spacing - 1.0)
        .collect();
    let lattice = Lattice::uniform([n; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
    let (nodes, geometry) = match kind {
        Kind::Lattice => (nodes, Geometry::Lattice(lattice)),
        Kind::Warp => {
            let nodes: Vec<DVec3> = nodes.into_iter().map(warp).collect();
            let block = CurvilinearBlock {
                dims: [n; 3],
                nodes: nodes.clone(),
            };
            let blocks = vec![block];
            (nodes, Geometry::Curvilinear { blocks })
        }
        Kind::Tetrahedra => {
            let mesh = jittered(nodes, n, 0.35 * spacing);
            (mesh.nodes.clone(), Geometry::Cells(mesh))
        }
    };
    let values = nodes.into_iter().map(|p| field(p) as f32).collect();
    let field = Field {
        name: "field".into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(Values::F32(values)),
        unit: None,
    };
    Dataset::new(Path::new("truth"), "truth", geometry, vec![field])
}

fn index(i: usize, n: usize) -> [usize; 3] {
    [i % n, i / n % n, i / (n * n)]
}

/// Maps the box onto itself: each face stays in its plane.
fn warp(x: DVec3) -> DVec3 {
    let along = DVec3::new(
        (2.0 * x.y + x.z).sin(),
        (2.0 * x.z - x.x + 0.5).sin(),
        (2.0 * x.x + x.y).cos(),
    );
    x + 0.25 * (1.0 - x * x) * along
}

/// Makes six tetrahedra of each cube of a lattice, and moves the inner nodes by up to `most` along each axis. Nodes
/// move less if a tetrahedron would have less than a tenth of its volume.
fn jittered(at_rest: Vec<DVec3>, n: usize, most: f64) -> CellMesh {
    let mut state = 1_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    };
    let mut moves: Vec<DVec3> = (0..at_rest.len())
        .map(|i| {
            let inner = index(i, n).iter().all(|&i| i > 0 && i < n - 1);
            let move_ = DVec3::new(random(), random(), random()) * most;
            if inner { move_ } else { DVec3::ZERO }
        })
        .collect();
    let strides = [1, n, n * n];
    let orders = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ];
    let mut cells: Vec<[usize; 4]> = Vec::new();
    for low in (0..at_rest.len()).filter(|&i| index(i, n).iter().all(|&i| i < n - 1)) {
        for (which, order) in orders.into_iter().enumerate() {
            let mut corners = [low; 4];
            for (n, axis) in order.into_iter().enumerate() {
                corners[n + 1] = corners[n] + strides[axis];
            }
            // The last three orders are odd.
            if which > 2 {
                corners.swap(2, 3);
            }
            cells.push(corners);
        }
    }
    let volume = |corners: &[usize; 4], moves: &[DVec3]| {
        let [a, b, c, d] = corners.map(|i| at_rest[i] + moves[i]);
        DMat3::from_cols(b - a, c - a, d - a).determinant()
    };
    let still = vec![DVec3::ZERO; at_rest.len()];
    loop {
        let flat: Vec<usize> = cells
            .iter()
            .filter(|corners| volume(corners, &moves) < 0.1 * volume(corners, &still))
            .flatten()
            .copied()
            .collect();
        if flat.is_empty() {
            break;
        }
        for i in flat {
            moves[i] *= 0.8;
        }
    }
    CellMesh {
        nodes: at_rest.iter().zip(&moves).map(|(x, m)| x + m).collect(),
        kinds: vec![CellKind::TETRA; cells.len()],
        offsets: (0..=cells.len() as u32).map(|i| 4 * i).collect(),
        connectivity: cells.iter().flatten().map(|&i| i as u32).collect(),
    }
}
