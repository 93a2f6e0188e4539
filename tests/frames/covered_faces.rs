//! Tests meshes whose faces do not match one to one. A ray through a uniform field has the optical
//! depth of its length inside, across interfaces and along them. The reference is the integral of
//! the data's own field.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::f64::consts::TAU;
use std::path::Path;

use ewa_splat::Renderer;
use ewa_splat::io::{Association, CellMesh, Dataset, Field, FieldSource, Geometry};
use ewa_splat::reference::DataIntegrator;
use ewa_splat::sample::{self, BoundaryChoice, KernelOptions, SampleOptions, Sampled};
use ewa_splat::scene::{Boundary, PointVolume, TransferFunction, Values};
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};

use crate::boundary::settings;
use crate::support::meshes::tetrahedra_of_cube;

/// Extinction of the field, per unit of length.
const EXTINCTION: f64 = 0.4;

fn transfer() -> TransferFunction {
    let opacity = (1.0 - (-EXTINCTION).exp()) as f32;
    TransferFunction::from_curves(|v| [v, 0.5, 1.0 - v], move |_| opacity, [0.0, 1.0], 1.0).unwrap()
}

/// Cells under construction. Within a part, cells share the nodes at one position.
#[derive(Default, Clone)]
struct Parts {
    nodes: Vec<DVec3>,
    kinds: Vec<u8>,
    cells: Vec<i64>,
    /// The first node of the current part.
    first: usize,
}

impl Parts {
    /// Begins a part, whose nodes are not shared with earlier parts.
    fn part(&mut self) {
        self.first = self.nodes.len();
    }

    fn node(&mut self, at: DVec3) -> i64 {
        let known = self.nodes[self.first..].iter();
        let place = known.clone().position(|p| p.distance(at) < 1e-9);
        let number = place.map_or(self.nodes.len(), |place| self.first + place);
        if place.is_none() {
            self.nodes.push(at);
        }
        number as i64
    }

    fn add(&mut self, kind: u8, corners: &[DVec3]) {
        self.kinds.push(kind);
        self.cells.push(corners.len() as i64);
        for &corner in corners {
            let node = self.node(corner);
            self.cells.push(node);
        }
    }

    /// Adds a hexahedron by its corners, x fastest.
    fn hexahedron(&mut self, c: [DVec3; 8]) {
        self.add(12, &[0, 1, 3, 2, 4, 5, 7, 6].map(|i| c[i]));
    }

    /// Adds a box divided into `counts` cells, with positions mapped by `map`.
    fn block(&mut self, low: DVec3, high: DVec3, counts: [usize; 3], map: impl Fn(DVec3) -> DVec3) {
        self.each_cube(counts, |parts, at| {
            let corner = |c: usize| {
                let share = [0, 1, 2].map(|d| (at[d] + (c >> d & 1)) as f64 / counts[d] as f64);
                map(low + (high - low) * DVec3::from(share))
            };
            parts.hexahedron(std::array::from_fn(corner));
        });
    }

    /// Adds such a box of tetrahedra, with opposite diagonals if it is mirrored.
    fn tetrahedra(&mut self, low: DVec3, high: DVec3, counts: [usize; 3], is_mirrored: bool) {
        self.each_cube(counts, |parts, at| {
            let place = |at: [usize; 3]| {
                let mut share = [0, 1, 2].map(|d| at[d] as f64 / counts[d] as f64);
                if is_mirrored {
                    share[1] = 1.0 - share[1];
                }
                low + (high - low) * DVec3::from(share)
            };
            // Corner numbers in a table of this cube.
            let mut corners = Vec::new();
            for c in 0..8_usize {
                corners.push(place([0, 1, 2].map(|d| at[d] + (c >> d & 1))));
            }
            let number =
                |to: [usize; 3]| (0..3).map(|d| (to[d] - at[d]) << d).sum::<usize>() as u32;
            for tetrahedron in tetrahedra_of_cube(at, number) {
                parts.add(10, &tetrahedron.map(|c| corners[c as usize]));
            }
        });
    }

    fn each_cube(&mut self, counts: [usize; 3], mut cube: impl FnMut(&mut Self, [usize; 3])) {
        for k in 0..counts[2] {
            for j in 0..counts[1] {
                for i in 0..counts[0] {
                    cube(self, [i, j, k]);
                }
            }
        }
    }

    fn mesh(&self) -> CellMesh {
        CellMesh::of_lists(self.nodes.clone(), &self.kinds, &self.cells).unwrap()
    }
}

fn dataset(mesh: CellMesh, extra: Vec<Field>) -> Dataset {
    let mut fields = vec![Field {
        name: "value".into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(Values::F32(vec![0.5; mesh.nodes.len()])),
        unit: None,
    }];
    fields.extend(extra);
    Dataset::new(Path::new("test"), "test", Geometry::Cells(mesh), fields)
}

fn sampled(data: Dataset, boundary: BoundaryChoice) -> Sampled {
    let options = SampleOptions {
        kernels: KernelOptions {
            boundary,
            ..KernelOptions::default()
        },
        field: Some("value".into()),
        ..SampleOptions::default()
    };
    let sampled = sample::volume(data, &options).unwrap();
    Sampled {
        volume: PointVolume {
            transfer_function: Some(transfer()),
            ..sampled.volume
        },
        ..sampled
    }
}

/// Returns depths relative to those of the data's own field, at the pixels of a view where the
/// reference also holds at neighbouring pixels.
fn ratios(data: &Dataset, volume: PointVolume, camera: &Camera) -> Vec<f64> {
    let truth = DataIntegrator::new(data.clone(), "value", transfer()).unwrap();
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let image = renderer.render(camera, &settings()).unwrap().clone();
    let depth = |alpha: f64| -(1.0 - alpha).ln() / EXTINCTION;
    let at = |x: f64, y: f64| depth(truth.ray(camera, DVec2::new(x, y), 1e-6).rgba[3]);
    let mut ratios = Vec::new();
    for y in (3..image.height - 3).step_by(2) {
        for x in (3..image.width - 3).step_by(2) {
            let (u, v) = (x as f64 + 0.5, y as f64 + 0.5);
            let own = at(u, v);
            let around = [[-2.5, 0.0], [2.5, 0.0], [0.0, -2.5], [0.0, 2.5]];
            let is_even = |[dx, dy]: &[f64; 2]| (at(u + dx, v + dy) - own).abs() < 0.05 * own;
            if own > 0.2 && around.iter().all(is_even) {
                let found = depth(f64::from(image.pixels[y * image.width + x][3]));
                ratios.push(found / own);
            }
        }
    }
    ratios
}

/// Returns views across, along and oblique to an interface at the centre of an object of this
/// radius.
fn cameras(middle: DVec3, radius: f64) -> [Camera; 3] {
    let view = |from: DVec3| {
        Camera::orthographic(
            middle + from.normalize() * 4.0 * radius,
            middle,
            DVec3::new(0.1, 0.0, 1.0),
            2.2 * radius,
            [96, 96],
        )
    };
    [
        view(DVec3::X),
        view(DVec3::NEG_Y),
        view(DVec3::new(0.7, -1.0, 0.4)),
    ]
}

/// Checks a mesh from all sides: nine in ten rays within `most`, and all within three times that,
/// or no worse than with soft boundaries. Along a jump of sizes, kernels add up unevenly.
fn check(name: &str, data: &Dataset, most: f64) {
    let (low, high) = data.bounds().unwrap();
    let middle = (low + high) / 2.0;
    let radius = (high - low).length() / 2.0;
    let Sampled { volume, report } = sampled(data.clone(), BoundaryChoice::Sharp);
    for (i, camera) in cameras(middle, radius).iter().enumerate() {
        let of = |volume| {
            let mut errors: Vec<f64> = ratios(data, volume, camera)
                .into_iter()
                .map(|r| (r - 1.0).abs())
                .collect();
            errors.sort_by(f64::total_cmp);
            errors
        };
        let soft = of(sampled(data.clone(), BoundaryChoice::Soft).volume);
        let errors = of(volume.clone());
        // Athwart, few rays or none have the depth of those beside.
        if errors.len() < 20 && i == 2 {
            continue;
        }
        let at = |errors: &[f64], share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
        println!(
            "{name} {i}: {} rays, half {:.4}, nine in ten {:.4}, worst {:.4}; soft {:.4} {:.4} {:.4}; {:?}",
            errors.len(),
            at(&errors, 0.5),
            at(&errors, 0.9),
            at(&errors, 1.0),
            at(&soft, 0.5),
            at(&soft, 0.9),
            at(&soft, 1.0),
            report.warnings(),
        );
        assert!(errors.len() >= 20, "{name} {i}");
        assert!(at(&errors, 0.9) < most.max(at(&soft, 0.9)), "{name} {i}");
        let worst = (3.0 * most).max(at(&soft, 1.0));
        assert!(at(&errors, 1.0) < worst, "{name} {i}");
    }
}

fn same(p: DVec3) -> DVec3 {
    p
}

const fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

#[test]
fn hanging_nodes_are_inside() {
    // Cubes of one size lie beside those of half, a quarter, an eighth of it, with shared nodes.
    for finer in [2, 4, 8] {
        let coarse = if finer == 8 { 2 } else { 4 };
        let mut parts = Parts::default();
        let size = coarse as f64;
        parts.block(v(0.0, 0.0, 0.0), v(size, size, size), [coarse; 3], same);
        let fine = [2 * finer, coarse * finer, coarse * finer];
        parts.block(v(size, 0.0, 0.0), v(size + 2.0, size, size), fine, same);
        check(&format!("1:{finer}"), &dataset(parts.mesh(), vec![]), 0.04);
    }
    // One corner is refined, as in octrees: hanging nodes lie on three sides.
    let mut parts = Parts::default();
    for at in 0..64_usize {
        let low = v((at % 4) as f64, (at / 4 % 4) as f64, (at / 16) as f64);
        let is_fine = low.max_element() < 2.0;
        let counts = if is_fine { [2; 3] } else { [1; 3] };
        parts.block(low, low + 1.0, counts, same);
    }
    check("octree", &dataset(parts.mesh(), vec![]), 0.04);
}

#[test]
fn cells_of_other_kinds_cover_each_other() {
    let (low, high) = (v(0.0, 0.0, 0.0), v(4.0, 4.0, 4.0));
    let (next, last) = (v(4.0, 0.0, 0.0), v(8.0, 4.0, 4.0));
    // Quadrilaterals against two triangles each.
    let mut parts = Parts::default();
    parts.block(low, high, [4; 3], same);
    parts.tetrahedra(next, last, [4; 3], false);
    check(
        "hexahedra and tetrahedra",
        &dataset(parts.mesh(), vec![]),
        0.04,
    );
    // Diagonals do not meet.
    let mut parts = Parts::default();
    parts.tetrahedra(low, high, [4; 3], true);
    parts.tetrahedra(next, last, [4; 3], false);
    check("diagonals", &dataset(parts.mesh(), vec![]), 0.04);
}

#[test]
fn tied_interfaces_are_inside() {
    // Both sides have other numbers of faces and their own nodes, all rotated, far from the origin.
    let turned = |p: DVec3| {
        glam::DMat3::from_rotation_z(0.4) * glam::DMat3::from_rotation_x(0.3) * p
            + v(300.0, -200.0, 100.0)
    };
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(3.0, 4.0, 4.0), [3, 4, 4], turned);
    parts.part();
    parts.block(v(3.0, 0.0, 0.0), v(6.0, 4.0, 4.0), [4, 5, 7], turned);
    check("tied", &dataset(parts.mesh(), vec![]), 0.05);
    // The same on a cylinder: chords of one side do not meet those of the other.
    let ring = |p: DVec3| {
        let angle = TAU * p.y;
        v(p.x * angle.cos(), p.x * angle.sin(), p.z)
    };
    let mut parts = Parts::default();
    parts.block(v(1.0, 0.0, 0.0), v(2.0, 1.0, 3.0), [3, 24, 6], ring);
    parts.part();
    let slid = |p: DVec3| ring(p + v(0.0, 0.013, 0.0));
    parts.block(v(2.0, 0.0, 0.0), v(3.0, 1.0, 3.0), [3, 40, 8], slid);
    check("sliding", &dataset(parts.mesh(), vec![]), 0.07);
}

/// Returns a block in pieces along x, each with its own nodes, moved by `shift` of the piece.
fn pieces(count: usize, shift: impl Fn(usize) -> f64) -> CellMesh {
    let mut parts = Parts::default();
    let width = 8 / count;
    for n in 0..count {
        parts.part();
        let low = v((n * width) as f64, 0.0, 0.0);
        let moved = |p: DVec3| p + DVec3::splat(shift(n));
        parts.block(low, low + v(width as f64, 5.0, 5.0), [width, 5, 5], moved);
    }
    parts.mesh()
}

#[test]
fn a_mesh_in_pieces_draws_as_in_one() {
    let camera = cameras(v(4.0, 2.5, 2.5), 5.4)[2].clone();
    let image = |mesh: CellMesh| {
        let volume = sampled(dataset(mesh, vec![]), BoundaryChoice::Sharp).volume;
        assert!(volume.boundary.is_some());
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        renderer.render(&camera, &settings()).unwrap().clone()
    };
    let whole = image(pieces(1, |_| 0.0));
    let difference = |other: &ewa_splat::Image| {
        let pairs = whole.pixels.iter().zip(&other.pixels);
        let each = pairs.map(|(a, b)| (a[3] - b[3]).abs());
        each.fold(0.0, f32::max)
    };
    // Nodes coincide to the last bit: the same kernels, divided.
    let apart = difference(&image(pieces(4, |_| 0.0)));
    assert!(apart < 1e-4, "{apart}");
    // Rounded: kernels of half cells beside each other, which are half as thick as those of the whole.
    let rounded = difference(&image(pieces(4, |n| 1e-6 * n as f64)));
    println!("in pieces {apart:.1e}, rounded {rounded:.1e}");
    assert!(rounded < 0.05, "{rounded}");
    check(
        "rounded",
        &dataset(pieces(4, |n| 1e-6 * n as f64), vec![]),
        0.04,
    );
}

#[test]
fn a_gap_is_no_interface() {
    // Cells of size 1 and a gap of .4: along the gap there is nothing, beside it everything.
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(3.0, 4.0, 4.0), [3, 4, 4], same);
    parts.block(v(3.4, 0.0, 0.0), v(6.4, 4.0, 4.0), [3, 4, 4], same);
    let data = dataset(parts.mesh(), vec![]);
    // Beside a gap that is narrower than a cell, kernels of both sides add up unevenly.
    check("gap", &data, 0.09);
    let camera = Camera::orthographic(v(3.2, -9.0, 2.0), v(3.2, 0.0, 2.0), DVec3::Z, 1.0, [64, 64]);
    let volume = sampled(data.clone(), BoundaryChoice::Sharp).volume;
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let image = renderer.render(&camera, &settings()).unwrap();
    let within = image.pixels[32 * 64 + 32][3];
    // The filter of pictures reaches over the edges.
    assert!(within < 4e-3, "{within}");
    // Thin cells lie as far apart as they are thick.
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(4.0, 4.0, 0.04), [4, 4, 1], same);
    parts.block(v(0.0, 0.0, 0.08), v(4.0, 4.0, 0.12), [4, 4, 1], same);
    let volume = sampled(dataset(parts.mesh(), vec![]), BoundaryChoice::Sharp).volume;
    let Some(Boundary::Planes(planes)) = &volume.boundary else {
        panic!("not cut");
    };
    let cut_both_sides = planes.edges.iter().filter(|edges| {
        let across = edges
            .iter()
            .filter(|e| e[3].is_finite() && e[2].abs() > 0.99);
        across.count() > 1
    });
    assert!(cut_both_sides.count() >= 100, "{}", planes.edges.len());
}

#[test]
fn faces_that_are_covered_in_part_stay_soft_there() {
    // One column stands on a corner of a slab of large cells, and another across its faces.
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(8.0, 8.0, 2.0), [4, 4, 1], same);
    parts.block(v(1.0, 1.0, 2.0), v(3.0, 3.0, 6.0), [4, 4, 8], same);
    let data = dataset(parts.mesh(), vec![]);
    let Sampled { volume, report } = sampled(data.clone(), BoundaryChoice::Sharp);
    let noted = report
        .findings
        .iter()
        .find(|f| f.reason.contains("in part"));
    assert!(
        noted.is_some_and(|f| f.count >= 4),
        "{:?}",
        report.warnings()
    );
    // Seen down through the column and the slab: nothing is cut between them.
    let camera = Camera::orthographic(v(2.0, 2.0, 20.0), v(2.0, 2.0, 0.0), DVec3::Y, 1.0, [64, 64]);
    let found = ratios(&data, volume.clone(), &camera);
    let worst = found.iter().map(|r| (r - 1.0).abs()).fold(0.0, f64::max);
    println!("through the column {worst:.4}");
    // The joint of cells of 2 and of .5 is soft.
    assert!(found.len() > 50 && worst < 0.1, "{worst}");
    // Far from the column, the slab of one layer of cells ends sharply.
    let far = Camera::orthographic(v(7.0, 7.0, 20.0), v(7.0, 7.0, 0.0), DVec3::Y, 1.0, [64, 64]);
    let found = ratios(&data, volume, &far);
    let worst = found.iter().map(|r| (r - 1.0).abs()).fold(0.0, f64::max);
    println!("far from the column {worst:.4}");
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn cells_that_are_left_out_leave_a_boundary() {
    // A node in the middle of one face of a block has no position: the cells around it are gone.
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(6.0, 6.0, 6.0), [6; 3], same);
    let at = parts.node(v(0.0, 3.0, 3.0)) as usize;
    let mut mesh = parts.mesh();
    mesh.nodes[at] = DVec3::NAN;
    check("without a node", &dataset(mesh, vec![]), 0.06);
    // Hidden nodes hide their cells.
    let mesh = parts.mesh();
    let hidden = |i: usize| u8::from(mesh.nodes[i].x > 4.5) * 2;
    let marks = (0..mesh.nodes.len()).map(hidden).collect();
    let ghosts = Field {
        name: "vtkGhostType".into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(Values::U8(marks)),
        unit: None,
    };
    check("hidden nodes", &dataset(mesh, vec![ghosts]), 0.02);
    // A cell that is stated twice still has a boundary.
    let mut parts = Parts::default();
    parts.block(v(0.0, 0.0, 0.0), v(4.0, 4.0, 4.0), [4; 3], same);
    let once = sampled(dataset(parts.mesh(), vec![]), BoundaryChoice::Sharp).volume;
    parts.block(v(0.0, 0.0, 0.0), v(1.0, 1.0, 1.0), [1; 3], same);
    let twice = sampled(dataset(parts.mesh(), vec![]), BoundaryChoice::Sharp).volume;
    let cut = |volume: &PointVolume| match &volume.boundary {
        Some(Boundary::Planes(planes)) => planes.edges.len(),
        _ => 0,
    };
    assert_eq!(cut(&once), cut(&twice));
}
