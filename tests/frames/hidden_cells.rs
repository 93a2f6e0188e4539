//! Tests grids with hidden nodes or cells, and overlapping grids. A uniform field has the optical
//! depth of the visible cells. The reference is the integral of the data's own field.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::f64::consts::TAU;
use std::path::Path;

use ewa_splat::Renderer;
use ewa_splat::io::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use ewa_splat::reference::DataIntegrator;
use ewa_splat::sample::{self, BoundaryChoice, KernelOptions, SampleOptions, Sampled};
use ewa_splat::scene::{Lattice, LatticeSpacing, PointVolume, TransferFunction, Values};
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};

use crate::boundary::settings;

const EXTINCTION: f64 = 0.4;

fn transfer() -> TransferFunction {
    let opacity = (1.0 - (-EXTINCTION).exp()) as f32;
    TransferFunction::from_curves(|v| [v, 0.5, 1.0 - v], move |_| opacity, [0.0, 1.0], 1.0).unwrap()
}

fn field(name: &str, association: Association, values: Values) -> Field {
    Field {
        name: name.into(),
        association,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}

/// Makes data with a uniform field and a field of hidden marks.
fn data(geometry: Geometry, association: Association, count: usize, hidden: Field) -> Dataset {
    let value = field("value", association, Values::F32(vec![0.5; count]));
    Dataset::new(Path::new("test"), "test", geometry, vec![value, hidden])
}

fn sampled(data: &Dataset, boundary: BoundaryChoice) -> Sampled {
    let options = SampleOptions {
        kernels: KernelOptions {
            boundary,
            ..KernelOptions::default()
        },
        field: Some("value".into()),
        ..SampleOptions::default()
    };
    let sampled = sample::volume(data.clone(), &options).unwrap();
    Sampled {
        volume: PointVolume {
            transfer_function: Some(transfer()),
            ..sampled.volume
        },
        ..sampled
    }
}

/// Returns the depth at the centre of a view along an axis through a position: of the kernels, and
/// of the data.
fn depths(data: &Dataset, boundary: BoundaryChoice, through: DVec3, along: DVec3) -> [f64; 2] {
    let up = along.any_orthonormal_vector();
    let camera = Camera::orthographic(through - along * 20.0, through, up, 0.5, [33, 33]);
    let volume = sampled(data, boundary).volume;
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let image = renderer.render(&camera, &settings()).unwrap();
    let alpha = f64::from(image.pixels[16 * 33 + 16][3]);
    let truth = DataIntegrator::new(data.clone(), "value", transfer()).unwrap();
    let true_alpha = truth.ray(&camera, DVec2::splat(16.5), 1e-7).rgba[3];
    [alpha, true_alpha].map(|alpha| -(1.0 - alpha).ln() / EXTINCTION)
}

/// Checks depths along some rays (through, along, the length inside), of the data and of kernels,
/// sharp and soft.
fn check(name: &str, data: &Dataset, rays: &[(DVec3, DVec3, f64)], most: f64) {
    for &(through, along, length) in rays {
        for boundary in [BoundaryChoice::Sharp, BoundaryChoice::Soft] {
            let [found, truth] = depths(data, boundary, through, along);
            println!("{name} {through} {along} {boundary:?}: {found:.4}, {truth:.4} of {length}");
            assert!((truth - length).abs() < 1e-5, "{name}: {truth} of {length}");
            assert!((found - length).abs() < most, "{name}: {found} of {length}");
        }
    }
}

const fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn lattices(dims: [usize; 3], step: f64) -> [Lattice; 2] {
    let line = |n: usize| (0..n).map(|i| i as f64 * step).collect::<Vec<_>>();
    let coordinates = dims.map(line);
    [
        Lattice::uniform(dims, DVec3::ZERO, DVec3::splat(step)),
        Lattice {
            dims,
            spacing: LatticeSpacing::Rectilinear { coordinates },
        },
    ]
}

/// Returns marks of nodes or cells by their indices.
fn marks(dims: [usize; 3], hides: u8, is_hidden: impl Fn([usize; 3]) -> bool) -> Values {
    let [x, y, _] = dims;
    let at = |n: usize| [n % x, n / x % y, n / (x * y)];
    let count = dims.iter().product();
    let mark = |n| if is_hidden(at(n)) { hides } else { 0 };
    Values::U8((0..count).map(mark).collect())
}

#[test]
fn hidden_cells_and_nodes_of_lattices_are_not_drawn() {
    // A box of 3 x 2 x 2. Everything beyond x = 1.5 is hidden, by cells or by the nodes from 1.75
    // on.
    let dims = [13, 9, 9];
    let of_cells = dims.map(|n| n - 1);
    let counts = [dims, of_cells].map(|dims| dims.iter().product::<usize>());
    let rays = [
        (v(0.75, 1.0, 1.0), DVec3::Y, 2.0),
        (v(2.4, 1.0, 1.0), DVec3::Y, 0.0),
        (v(1.5, 1.0, 1.0), DVec3::X, 1.5),
        (v(1.0, 0.8, 1.0), DVec3::Z, 2.0),
    ];
    for lattice in lattices(dims, 0.25) {
        for (hides, on_nodes) in [(32, false), (1, false), (2, true)] {
            let (association, hidden) = if on_nodes {
                (Association::Nodes, marks(dims, hides, |[i, ..]| i > 6))
            } else {
                (Association::Cells, marks(of_cells, hides, |[i, ..]| i >= 6))
            };
            let hidden = field("vtkGhostType", association, hidden);
            for (of, count) in [Association::Nodes, Association::Cells]
                .into_iter()
                .zip(counts)
            {
                let geometry = Geometry::Lattice(lattice.clone());
                let data = data(geometry, of, count, hidden.clone());
                check(&format!("{of:?} {hides}"), &data, &rays, 0.03);
            }
        }
    }
    // Two cells in the middle are hidden: the ray through them has a correspondingly lower depth.
    let hidden = marks(of_cells, 32, |[i, j, k]| {
        (5..7).contains(&i) && (3..5).contains(&j) && (3..5).contains(&k)
    });
    let hidden = field("vtkGhostType", Association::Cells, hidden);
    let geometry = Geometry::Lattice(lattices(dims, 0.25)[0].clone());
    let data = data(geometry, Association::Nodes, counts[0], hidden);
    check("hole", &data, &[(v(1.5, 1.0, 1.0), DVec3::X, 2.5)], 0.15);
}

/// Returns the nodes of a box.
fn block(low: DVec3, high: DVec3, dims: [usize; 3]) -> CurvilinearBlock {
    let [x, y, _] = dims;
    let at = |n: usize| {
        let at = [n % x, n / x % y, n / (x * y)];
        let share = [0, 1, 2].map(|d| at[d] as f64 / (dims[d] - 1) as f64);
        low + (high - low) * DVec3::from(share)
    };
    CurvilinearBlock {
        dims,
        nodes: (0..dims.iter().product()).map(at).collect(),
    }
}

fn grids(blocks: Vec<CurvilinearBlock>, is_blanked: impl Fn(usize, DVec3) -> bool) -> Dataset {
    let mut iblank = Vec::new();
    for (n, block) in blocks.iter().enumerate() {
        iblank.extend(block.nodes.iter().map(|p| u8::from(!is_blanked(n, *p))));
    }
    let count = iblank.len();
    let hidden = field("iblank", Association::Nodes, Values::U8(iblank));
    data(
        Geometry::Curvilinear { blocks },
        Association::Nodes,
        count,
        hidden,
    )
}

#[test]
fn blanked_nodes_take_their_cells_with_them() {
    // They overlap from 1 to 1.25, where one of them is hidden: the domain is 2 x 1 x 1.
    let blocks = vec![
        block(v(0.0, 0.0, 0.0), v(1.25, 1.0, 1.0), [11, 9, 9]),
        block(v(1.0, 0.0, 0.0), v(2.0, 1.0, 1.0), [9, 9, 9]),
    ];
    let data = grids(blocks, |n, p| n == 0 && p.x > 1.01);
    let rays = [
        (v(1.0, 0.5, 0.5), DVec3::X, 2.0),
        (v(1.0, 0.5, 0.5), DVec3::Y, 1.0),
        (v(0.9, 0.5, 0.5), DVec3::Y, 1.0),
        (v(1.1, 0.5, 0.5), DVec3::Z, 1.0),
    ];
    // Within a spacing of the joint, kernels of half cells and whole ones add up unevenly: 1.09 at most.
    check("abutting", &data, &rays, 0.1);
    let Sampled { report, .. } = sampled(&data, BoundaryChoice::Sharp);
    let overlap = |f: &&sample::Finding| f.reason.contains("more than once");
    assert_eq!(report.findings.iter().find(overlap), None);
}

#[test]
fn overlaps_that_count_double_are_noted() {
    let noted = |blocks: Vec<CurvilinearBlock>| {
        let data = grids(blocks, |_, _| false);
        let report = sampled(&data, BoundaryChoice::Soft).report;
        let mut found = report.findings.into_iter();
        found.find(|f| f.reason.contains("more than once"))
    };
    // .5 of 2 + 1.5 - .5 = 3 units is covered twice: .5 / 3.
    let found = noted(vec![
        block(v(0.0, 0.0, 0.0), v(2.0, 1.0, 1.0), [41, 11, 11]),
        block(v(1.5, 0.0, 0.0), v(3.0, 1.0, 1.0), [37, 13, 12]),
    ]);
    let reason = found.expect("an overlap").reason;
    let share = reason.split(": ").nth(1).and_then(|s| s.split(' ').next());
    let share: f64 = share.unwrap().parse().unwrap();
    println!("{reason}");
    assert!((share - 100.0 / 6.0).abs() < 2.0, "{share}");
    // Adjacent grids with other nodes; boxes overlap, and grids do not.
    let turned = |block: CurvilinearBlock, angle: f64| CurvilinearBlock {
        nodes: block
            .nodes
            .iter()
            .map(|&p| glam::DMat3::from_rotation_z(angle) * p)
            .collect(),
        ..block
    };
    for angle in [0.0, 0.6] {
        let found = noted(vec![
            turned(
                block(v(0.0, 0.0, 0.0), v(2.0, 1.0, 1.0), [21, 11, 11]),
                angle,
            ),
            turned(
                block(v(2.0, 0.0, 0.0), v(3.0, 1.0, 1.0), [14, 8, 17]),
                angle,
            ),
        ]);
        assert_eq!(found, None, "{angle}");
    }
    // An O-grid around another, with nodes at other angles of one cylinder.
    let ring = |radii: [f64; 2], count: usize, slid: f64| {
        let flat = block(v(radii[0], 0.0, 0.0), v(radii[1], TAU, 1.0), [6, count, 5]);
        CurvilinearBlock {
            nodes: flat
                .nodes
                .iter()
                .map(|p| v(p.x * (p.y + slid).cos(), p.x * (p.y + slid).sin(), p.z))
                .collect(),
            ..flat
        }
    };
    let found = noted(vec![ring([1.0, 2.0], 31, 0.0), ring([2.0, 3.0], 47, 0.05)]);
    assert_eq!(found, None);
    assert_eq!(noted(vec![ring([1.0, 2.0], 31, 0.0)]), None);
    assert!(noted(vec![ring([1.0, 2.0], 31, 0.0), ring([1.7, 3.0], 47, 0.05)]).is_some());
}
