//! Tests the integrator of data's own fields against closed forms, a march in small steps, and
//! itself with other parameters.

use crate::common::{Random, scalar};
use crate::support::meshes::tetrahedra_of_cube;
use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, FieldSource, Geometry,
};
use ewa_splat::reference::{DataIntegrator, PixelFilter, RayIntegral, ReferenceSettings};
use ewa_splat::scene::{
    ColourSpace, ControlPoint, Lattice, LatticeSpacing, TransferFunction, Values,
};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{Error, Task};
use glam::{DMat3, DVec3};

/// Extinction of the value 1 under [`ramp`].
const RATE: f64 = 2.0;

/// Returns extinction [`RATE`] times the value; red is the value, green a quarter, blue 1. The unit
/// length is so short that opacities are small and their extinctions accurate to 1e-7 in spite of
/// f32.
fn ramp() -> TransferFunction {
    let opacity = |v: f32| -(-RATE * 1e-3 * f64::from(v)).exp_m1() as f32;
    TransferFunction::from_curves(|v| [v, 0.25, 1.0], opacity, [0.0, 1.0], 1e-3).unwrap()
}

/// Returns white of extinction 1 for all values.
fn fog() -> TransferFunction {
    let opacity = -(-1e-3_f64).exp_m1() as f32;
    TransferFunction::from_curves(|_| [1.0; 3], |_| opacity, [0.0, 1.0], 1e-3).unwrap()
}

/// Returns two hats and a step, whose corners are visible.
fn hats() -> TransferFunction {
    let point = |value: f32, opacity: f32| ControlPoint {
        value,
        colour: Some([value, 1.0 - value, 0.3]),
        opacity: Some(opacity),
    };
    let points = [
        point(0.0, 0.0),
        point(0.2, 0.0),
        point(0.25, 0.8),
        point(0.3, 0.0),
        point(0.5, 0.0),
        point(0.6, 0.5),
        point(0.7, 0.1),
        point(0.8, 0.1),
        point(0.8, 0.6),
        point(1.0, 0.6),
    ];
    TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 1.0], 0.5).unwrap()
}

/// Evaluates the table at a value, in f64: emission and extinction.
fn light(function: &TransferFunction, value: f64) -> [f64; 4] {
    let table = function.table();
    let [low, high] = function.range().map(f64::from);
    let last = (table.len() - 1) as f64;
    let x = ((value - low) / (high - low) * last).clamp(0.0, last);
    let i = (x.floor() as usize).min(table.len() - 2);
    let mix = |c: usize| {
        let [a, b] = [table[i][c], table[i + 1][c]].map(f64::from);
        a + (b - a) * (x - i as f64)
    };
    let extinction = mix(3);
    [
        mix(0) * extinction,
        mix(1) * extinction,
        mix(2) * extinction,
        extinction,
    ]
}

/// Integrates the light of a ray of a given length by the midpoint rule.
fn march(
    function: &TransferFunction,
    length: f64,
    steps: u32,
    field: impl Fn(f64) -> Option<f64>,
) -> [f64; 4] {
    let step = length / f64::from(steps);
    let mut sum = [0.0; 4];
    let mut depth = 0.0_f64;
    for i in 0..steps {
        let Some(value) = field((f64::from(i) + 0.5) * step) else {
            continue;
        };
        let light = light(function, value);
        let through = (-depth - 0.5 * light[3] * step).exp();
        for c in 0..3 {
            sum[c] += light[c] * step * through;
        }
        depth += light[3] * step;
    }
    sum[3] = 1.0 - (-depth).exp();
    sum
}

fn dataset(geometry: Geometry, association: Association, values: Vec<f32>) -> Dataset {
    let field = scalar("f", association, values);
    Dataset::new("made".as_ref(), "made", geometry, vec![field])
}

pub(super) fn at_nodes(geometry: Geometry, field: impl Fn(DVec3) -> f64) -> Dataset {
    let nodes: Vec<DVec3> = match &geometry {
        Geometry::Cells(mesh) => mesh.nodes.clone(),
        Geometry::Curvilinear { blocks } => blocks.iter().flat_map(|b| b.nodes.clone()).collect(),
        Geometry::Lattice(lattice) => {
            let [x, y, z] = lattice.dims;
            let index = |i: usize| [i % x, i / x % y, i / (x * y)];
            (0..x * y * z).map(|i| lattice.position(index(i))).collect()
        }
        _ => panic!("a grid"),
    };
    let values = nodes.into_iter().map(|p| field(p) as f32).collect();
    dataset(geometry, Association::Nodes, values)
}

fn integrator(data: Dataset, function: &TransferFunction) -> DataIntegrator {
    DataIntegrator::new(data, "f", function.clone()).unwrap()
}

/// Integrates the ray from a point in a direction.
fn along(data: &DataIntegrator, from: DVec3, direction: DVec3, error: f64) -> RayIntegral {
    let up = direction.any_orthogonal_vector();
    let camera = Camera::orthographic(from, from + direction, up, 1.0, [2, 2]);
    data.ray(&camera, camera.centre_px, error)
}

fn depth(ray: RayIntegral) -> f64 {
    -(-ray.rgba[3]).ln_1p()
}

fn assert_near(found: [f64; 4], expected: [f64; 4], bound: f64, what: &str) {
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= bound, "{what}: {found:?} {expected:?}");
    }
}

fn mesh_of(nodes: Vec<DVec3>, cells: &[(CellKind, Vec<u32>)]) -> CellMesh {
    let mut mesh = CellMesh {
        nodes,
        offsets: vec![0],
        ..CellMesh::default()
    };
    for (kind, corners) in cells {
        mesh.kinds.push(*kind);
        mesh.connectivity.extend(corners);
        mesh.offsets.push(mesh.connectivity.len() as u32);
    }
    mesh
}

/// Returns the part of a ray within planes: outward normals, and a point of each plane.
fn within(planes: &[(DVec3, DVec3)], from: DVec3, direction: DVec3) -> Option<[f64; 2]> {
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for (normal, point) in planes {
        let (rate, start) = (normal.dot(direction), normal.dot(from - *point));
        if rate < 0.0 {
            near = near.max(-start / rate);
        } else if rate > 0.0 {
            far = far.min(-start / rate);
        } else if start > 0.0 {
            return None;
        }
    }
    (near < far).then_some([near, far])
}

/// Returns a cell of each kind, convex, of unit size, with its nodes and corners in VTK's order.
fn one_of_each() -> Vec<(CellKind, Vec<DVec3>, Vec<u32>)> {
    let p = DVec3::new;
    let square = [
        p(0.0, 0.0, 0.0),
        p(1.0, 0.0, 0.0),
        p(1.0, 1.0, 0.0),
        p(0.0, 1.0, 0.0),
    ];
    let lifted = |base: &[DVec3]| {
        let top = base.iter().map(|n| *n + DVec3::Z);
        base.iter().copied().chain(top).collect::<Vec<_>>()
    };
    let cube = lifted(&square);
    let gon = |n: u32| {
        let corner = |i| {
            let turn = std::f64::consts::TAU * f64::from(i) / f64::from(n);
            p(0.5 + 0.5 * turn.cos(), 0.5 + 0.5 * turn.sin(), 0.0)
        };
        (0..n).map(corner).collect::<Vec<_>>()
    };
    let triangle = [p(0.0, 0.0, 0.0), p(0.0, 1.0, 0.0), p(1.0, 0.0, 0.0)];
    let voxel = [0, 1, 3, 2, 4, 5, 7, 6].map(|i: usize| cube[i]).to_vec();
    let count = |n: usize| (0..n as u32).collect::<Vec<_>>();
    let mut tetra = square[..3].to_vec();
    tetra.push(p(0.3, 0.4, 1.0));
    let mut pyramid = square.to_vec();
    pyramid.push(p(0.4, 0.6, 1.0));
    let faces = CellKind::HEXAHEDRON.faces().unwrap();
    let mut polyhedron = vec![faces.len() as u32];
    for face in faces {
        polyhedron.push(face.len() as u32);
        polyhedron.extend(face.iter().map(|c| u32::from(*c)));
    }
    let quadratic: Vec<DVec3> = {
        let edges = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
        let middle = |[a, b]: [usize; 2]| (tetra[a] + tetra[b]) / 2.0;
        tetra.iter().copied().chain(edges.map(middle)).collect()
    };
    vec![
        (CellKind::TETRA, tetra, count(4)),
        (CellKind::VOXEL, voxel, count(8)),
        (CellKind::HEXAHEDRON, cube.clone(), count(8)),
        (CellKind::WEDGE, lifted(&triangle), count(6)),
        (CellKind::PYRAMID, pyramid, count(5)),
        (CellKind(15), lifted(&gon(5)), count(10)),
        (CellKind(16), lifted(&gon(6)), count(12)),
        (CellKind::POLYHEDRON, cube, polyhedron),
        (CellKind(24), quadratic, count(10)),
    ]
}

/// Returns the planes of a convex cell's faces.
fn planes_of(kind: CellKind, nodes: &[DVec3]) -> Vec<(DVec3, DVec3)> {
    let kind = if kind == CellKind::POLYHEDRON {
        CellKind::HEXAHEDRON
    } else {
        kind
    };
    let faces = kind.faces().unwrap();
    let corners = faces.iter().flat_map(|f| f.iter().map(|c| usize::from(*c)));
    let count = corners.clone().count() as f64;
    let middle = corners.map(|c| nodes[c]).sum::<DVec3>() / count;
    let plane = |face: &&[u8]| {
        let [a, b, c] = [0, 1, 2].map(|i| nodes[usize::from(face[i])]);
        let normal = (b - a).cross(c - a);
        (normal * normal.dot(a - middle).signum(), a)
    };
    faces.iter().map(plane).collect()
}

/// Returns a shear and stretch that keeps orientation.
fn bend() -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.2, 0.1, -0.2),
        DVec3::new(-0.3, 0.9, 0.2),
        DVec3::new(0.1, 0.25, 1.1),
    )
}

#[test]
fn linear_fields_are_exact_in_cells_of_every_kind() {
    let mut random = Random::new(11);
    let function = ramp();
    let field = |p: DVec3| 0.4 + p.dot(DVec3::new(0.11, -0.09, 0.13));
    for (kind, nodes, corners) in one_of_each() {
        let nodes: Vec<DVec3> = nodes.into_iter().map(|n| bend() * n).collect();
        let planes = planes_of(kind, &nodes);
        let mesh = mesh_of(nodes, &[(kind, corners)]);
        let centre = bend() * DVec3::splat(0.4);
        let data = integrator(at_nodes(Geometry::Cells(mesh), field), &function);
        assert_eq!(data.left_out(), 0);
        let mut met = 0;
        for _ in 0..60 {
            let direction = (random.rotation() * DVec3::X).normalize();
            let from = centre + random.point(0.5) - 3.0 * direction;
            let ray = along(&data, from, direction, 1e-10);
            let Some([near, far]) = within(&planes, from, direction) else {
                assert_eq!(ray.rgba, [0.0; 4], "{}", kind.name());
                continue;
            };
            met += 1;
            // Extinction is linear along the ray: a trapezium.
            let (a, b) = (
                field(from + direction * near),
                field(from + direction * far),
            );
            let truth = RATE * 0.5 * (a + b) * (far - near);
            // Values are f32: 6e-8 of a depth of 1.
            let miss = (depth(ray) - truth).abs();
            assert!(miss < 3e-7, "{}: {miss:.1e} of {truth}", kind.name());
            let start = from + direction * near;
            let along = |t: f64| Some(field(start + direction * t));
            let marched = march(&function, far - near, 2000, along);
            // The march errs by the square of its steps, some 1e-7.
            assert_near(ray.rgba, marched, 1e-6, kind.name());
            let [_, green, blue, opacity] = ray.rgba;
            assert!((green - 0.25 * opacity).abs() < 1e-9 && (blue - opacity).abs() < 1e-9);
        }
        assert!(met > 20, "{met} rays meet a {}", kind.name());
    }
}

/// Evaluates the trilinear interpolant of a lattice directly: planes and samples along each axis.
fn interpolated(
    planes: &[Vec<f64>; 3],
    value: impl Fn([usize; 3]) -> f64,
    p: DVec3,
) -> Option<f64> {
    let mut cell = [0; 3];
    let mut share = [0.0; 3];
    for d in 0..3 {
        let line = &planes[d];
        if !(p[d] >= line[0] && p[d] <= line[line.len() - 1]) {
            return None;
        }
        cell[d] = (1..line.len() - 1).filter(|&i| line[i] <= p[d]).count();
        share[d] = (p[d] - line[cell[d]]) / (line[cell[d] + 1] - line[cell[d]]);
    }
    let corner = |c: usize| {
        let bits = [c & 1, c >> 1 & 1, c >> 2];
        let weight: f64 = (0..3)
            .map(|d| {
                if bits[d] == 1 {
                    share[d]
                } else {
                    1.0 - share[d]
                }
            })
            .product();
        weight * value([0, 1, 2].map(|d| cell[d] + bits[d]))
    };
    Some((0..8).map(corner).sum())
}

/// A lattice, the planes between which it is trilinear, the sample on each, and the matrix from the
/// world to the planes.
type Case = (
    Lattice,
    Association,
    [Vec<f64>; 3],
    [Vec<usize>; 3],
    DVec3,
    DMat3,
);

fn lattices() -> Vec<Case> {
    let dims = [5, 4, 6];
    let count = |n: usize| (0..n).map(|i| i as f64).collect::<Vec<_>>();
    let all = |n: usize| (0..n).collect::<Vec<_>>();
    let step = bend() * 0.3;
    let origin = DVec3::new(7.0, -2.0, 1.0);
    let uniform = Lattice {
        dims,
        spacing: LatticeSpacing::Uniform { origin, step },
    };
    let lines = [
        vec![0.0, 0.2, 0.7, 0.8, 1.5],
        vec![-1.0, -0.5, 0.4, 0.5],
        vec![2.0, 2.1, 2.5, 3.0, 3.2, 3.3],
    ];
    let rectilinear = Lattice {
        dims,
        spacing: LatticeSpacing::Rectilinear {
            coordinates: lines.clone(),
        },
    };
    let cells = |line: &Vec<f64>| {
        let n = line.len();
        let mut planes = vec![line[0]];
        planes.extend(line.windows(2).map(|w| 0.5 * (w[0] + w[1])));
        planes.push(line[n - 1]);
        let mut samples = vec![0];
        samples.extend(0..n - 1);
        samples.push(n - 2);
        (planes, samples)
    };
    let centred = lines.each_ref().map(cells);
    let inverse = step.inverse();
    vec![
        (
            uniform,
            Association::Nodes,
            dims.map(count),
            dims.map(all),
            origin,
            inverse,
        ),
        (
            rectilinear.clone(),
            Association::Nodes,
            lines,
            dims.map(all),
            DVec3::ZERO,
            DMat3::IDENTITY,
        ),
        (
            rectilinear,
            Association::Cells,
            centred.each_ref().map(|c| c.0.clone()),
            centred.each_ref().map(|c| c.1.clone()),
            DVec3::ZERO,
            DMat3::IDENTITY,
        ),
    ]
}

#[test]
fn lattices_are_their_trilinear_interpolants_marched_in_small_steps() {
    let mut random = Random::new(5);
    let function = hats();
    for (lattice, association, planes, samples, origin, inverse) in lattices() {
        let dims = match association {
            Association::Nodes => lattice.dims,
            Association::Cells => lattice.dims.map(|n| n - 1),
        };
        let count = dims.iter().product::<usize>();
        let values: Vec<f32> = (0..count).map(|_| random.range(0.0, 1.0) as f32).collect();
        let value = |ijk: [usize; 3]| {
            let [i, j, k] = [0, 1, 2].map(|d| samples[d][ijk[d]]);
            f64::from(values[i + dims[0] * (j + dims[1] * k)])
        };
        let low = DVec3::from(planes.each_ref().map(|l| l[0]));
        let high = DVec3::from(planes.each_ref().map(|l| l[l.len() - 1]));
        let middle = origin + inverse.inverse() * ((low + high) / 2.0);
        let data = dataset(Geometry::Lattice(lattice), association, values.clone());
        let data = integrator(data, &function);
        for _ in 0..12 {
            let direction = (random.rotation() * DVec3::X).normalize();
            let from = middle + random.point(0.4) - 5.0 * direction;
            // The box in the planes' coordinates, so that the march begins and ends at its faces.
            let (o, d) = (inverse * (from - origin), inverse * direction);
            let faces = DMat3::IDENTITY;
            let sides: Vec<_> = (0..3)
                .flat_map(|i| [(faces.col(i), high), (-faces.col(i), low)])
                .collect();
            let Some([near, far]) = within(&sides, o, d) else {
                continue;
            };
            let field = |t: f64| interpolated(&planes, value, o + d * (near + t));
            let truth = march(&function, far - near, 40_000, field);
            let exact = along(&data, from, direction, 1e-10);
            // The step of the function is a ramp over 2.4e-4 of the values, some three steps long:
            // the march errs there by some 1e-6 of its light.
            assert_near(exact.rgba, truth, 2e-6, "marched");
            assert!(exact.error <= 1e-9, "{:.1e}", exact.error);
            for error in [1e-2, 1e-3, 1e-5] {
                let ray = along(&data, from, direction, error);
                assert!(ray.error <= 2.0 * error, "{:.1e} of {error}", ray.error);
                assert_near(ray.rgba, exact.rgba, error, "as far as is said");
            }
        }
    }
}

/// Returns a closed ring of cells around z, from radius 1 to 2, `n` around and two across.
fn ring(n: usize) -> CurvilinearBlock {
    let dims = [3, n + 1, 4];
    let node = |i: usize| {
        let turn = std::f64::consts::TAU * (i / 3 % (n + 1)) as f64 / n as f64;
        let radius = 1.0 + 0.5 * (i % 3) as f64;
        DVec3::new(
            radius * turn.cos(),
            radius * turn.sin(),
            (i / (3 * (n + 1))) as f64 / 3.0,
        )
    };
    CurvilinearBlock {
        dims,
        nodes: (0..dims.iter().product()).map(node).collect(),
    }
}

/// Returns the sides of a regular prism around z.
fn prism(n: usize, radius: f64) -> Vec<(DVec3, DVec3)> {
    let side = |i: usize| {
        let turn = std::f64::consts::TAU * (i as f64 + 0.5) / n as f64;
        let normal = DVec3::new(turn.cos(), turn.sin(), 0.0);
        (
            normal,
            normal * radius * (std::f64::consts::PI / n as f64).cos(),
        )
    };
    (0..n)
        .map(side)
        .chain([(DVec3::Z, DVec3::Z), (DVec3::NEG_Z, DVec3::ZERO)])
        .collect()
}

#[test]
fn a_curvilinear_ring_with_its_seam_is_a_prism_with_a_hole() {
    let mut random = Random::new(3);
    let field = |p: DVec3| 0.5 + 0.1 * p.x - 0.07 * p.y + 0.2 * p.z;
    let blocks = vec![ring(12)];
    let data = at_nodes(Geometry::Curvilinear { blocks }, field);
    let data = integrator(data, &ramp());
    let (outer, inner) = (prism(12, 2.0), prism(12, 1.0));
    for _ in 0..100 {
        let direction = (random.rotation() * DVec3::X).normalize();
        let from = DVec3::Z * 0.5 + random.point(0.9) - 6.0 * direction;
        let part = |sides: &[(DVec3, DVec3)]| {
            let Some([near, far]) = within(sides, from, direction) else {
                return 0.0;
            };
            let value = |t: f64| field(from + direction * t);
            RATE * 0.5 * (value(near) + value(far)) * (far - near)
        };
        let truth = part(&outer) - part(&inner);
        let found = depth(along(&data, from, direction, 1e-9));
        // Values and the function are f32.
        assert!(
            (found - truth).abs() < 1e-6 * (1.0 + truth),
            "{found} {truth}"
        );
    }
}

#[test]
fn a_twisted_cell_is_the_inverse_of_its_map() {
    let mut random = Random::new(29);
    let function = hats();
    for _ in 0..6 {
        let nodes: [DVec3; 8] = std::array::from_fn(|c| {
            DVec3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64) + random.point(0.15)
        });
        let values: [f32; 8] = std::array::from_fn(|_| random.range(0.0, 1.0) as f32);
        let weight = |c: usize, s: DVec3| {
            let axis = |bit: usize, s: f64| if bit == 1 { s } else { 1.0 - s };
            axis(c & 1, s.x) * axis(c >> 1 & 1, s.y) * axis(c >> 2, s.z)
        };
        let place = |s: DVec3| (0..8).map(|c| nodes[c] * weight(c, s)).sum::<DVec3>();
        // Newton's method with finite differences.
        let invert = |p: DVec3| {
            let mut s = DVec3::splat(0.5);
            for _ in 0..30 {
                if (p - place(s)).length() < 1e-14 {
                    break;
                }
                let h = 1e-6;
                let column = |d: DVec3| (place(s + d * h) - place(s - d * h)) / (2.0 * h);
                let slopes = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
                s += slopes.inverse() * (p - place(s));
            }
            s
        };
        let block = CurvilinearBlock {
            dims: [2; 3],
            nodes: nodes.to_vec(),
        };
        let geometry = Geometry::Curvilinear {
            blocks: vec![block],
        };
        let data = dataset(geometry, Association::Nodes, values.to_vec());
        let data = integrator(data, &function);
        for _ in 0..4 {
            let direction = (random.rotation() * DVec3::X).normalize();
            let middle = place(DVec3::splat(0.5) + random.point(0.3));
            let is_inside =
                |t: f64| (invert(middle + direction * t) - 0.5).abs().max_element() <= 0.5;
            let end = |mut outside: f64| {
                let mut inside = 0.0;
                for _ in 0..50 {
                    let t = 0.5 * (inside + outside);
                    if is_inside(t) {
                        inside = t;
                    } else {
                        outside = t;
                    }
                }
                inside
            };
            let (near, far) = (end(-1.6), end(1.6));
            let field = |t: f64| {
                let s = invert(middle + direction * (near + t));
                Some((0..8).map(|c| f64::from(values[c]) * weight(c, s)).sum())
            };
            let truth = march(&function, far - near, 40_000, field);
            let ray = along(&data, middle - 3.0 * direction, direction, 1e-9);
            // The bound is that of lattices.
            assert_near(ray.rgba, truth, 2e-6, "twisted");
        }
    }
}

/// Returns six tetrahedra of each cube of a lattice of `n`³ cubes, in VTK's order.
fn tetrahedra(n: usize) -> CellMesh {
    let at = |[i, j, k]: [usize; 3]| (i + (n + 1) * (j + (n + 1) * k)) as u32;
    let count = (n + 1).pow(3);
    let node = |i: usize| {
        let m = n + 1;
        DVec3::new((i % m) as f64, (i / m % m) as f64, (i / (m * m)) as f64)
    };
    let nodes: Vec<DVec3> = (0..count).map(node).collect();
    let mut cells = Vec::new();
    for cube in 0..n.pow(3) {
        let low = [cube % n, cube / n % n, cube / (n * n)];
        for mut path in tetrahedra_of_cube(low, at) {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| nodes[path[i] as usize]);
            if (b - a).cross(c - a).dot(d - a) < 0.0 {
                path.swap(2, 3);
            }
            cells.push((CellKind::TETRA, path.to_vec()));
        }
    }
    mesh_of(nodes, &cells)
}

/// Returns grids of 4³ cubes of side 1, of three kinds.
fn cubes() -> Vec<(&'static str, Geometry)> {
    let lattice = Lattice::uniform([5; 3], DVec3::ZERO, DVec3::ONE);
    let node = |i: usize| lattice.position([i % 5, i / 5 % 5, i / 25]);
    let nodes: Vec<DVec3> = (0..125).map(node).collect();
    let corner = |cell: usize, c: usize| {
        let [i, j, k] = [cell % 4, cell / 4 % 4, cell / 16];
        let [a, b, c] = [c & 1, c >> 1 & 1, c >> 2];
        (i + a + 5 * (j + b + 5 * (k + c))) as u32
    };
    let hexahedra: Vec<_> = (0..64)
        .map(|cell| {
            let corners = [0, 1, 3, 2, 4, 5, 7, 6].map(|c| corner(cell, c)).to_vec();
            (CellKind::HEXAHEDRON, corners)
        })
        .collect();
    let block = CurvilinearBlock {
        dims: [5; 3],
        nodes: nodes.clone(),
    };
    vec![
        ("tetrahedra", Geometry::Cells(tetrahedra(4))),
        ("hexahedra", Geometry::Cells(mesh_of(nodes, &hexahedra))),
        (
            "curvilinear",
            Geometry::Curvilinear {
                blocks: vec![block],
            },
        ),
        ("lattice", Geometry::Lattice(lattice)),
    ]
}

#[test]
fn rays_along_faces_edges_and_nodes_find_no_gap_and_count_nothing_twice() {
    let function = fog();
    let box_planes: Vec<_> = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .flat_map(|n| [(n, DVec3::splat(4.0)), (-n, DVec3::ZERO)])
        .collect();
    let mut random = Random::new(17);
    let p = DVec3::new;
    let mut rays = vec![
        // Along faces, edges, and through nodes of all cells.
        (p(2.0, -1.0, 1.3), DVec3::Y),
        (p(2.0, -1.0, 3.0), DVec3::Y),
        (p(2.3, 1.0, -1.0), DVec3::Z),
        (p(-1.0, 1.0, 1.0), DVec3::X),
        (p(-1.0, -1.0, -1.0), p(1.0, 1.0, 1.0)),
        (p(-1.0, -1.0, 1.0), p(1.0, 1.0, 0.0)),
        (p(-1.0, -1.0, 1.5), p(1.0, 1.0, 0.0)),
        (p(-2.0, 0.0, -1.0), p(1.0, 0.5, 0.5)),
        (p(1.0, 6.0, 2.0), p(0.0, -1.0, 0.0)),
        (p(-1.0, 1.0, 5.0), p(1.0, 0.0, -1.0)),
        // Nearly along them.
        (p(2.0 + 1e-12, -1.0, 1.3), p(1e-13, 1.0, 0.0)),
        (p(2.0, -1.0, 3.0 - 1e-10), p(1e-9, 1.0, 1e-11)),
        (p(-1.0, 1.0, 1.0), p(1.0, 1e-7, -1e-8)),
    ];
    for _ in 0..200 {
        // From node to node.
        let node = |random: &mut Random| {
            let mut index = || random.index(5) as f64;
            p(index(), index(), index())
        };
        let (a, b) = (node(&mut random), node(&mut random));
        if a != b {
            rays.push((a + (a - b).normalize() * 9.0, b - a));
        }
    }
    for (name, geometry) in cubes() {
        let data = integrator(at_nodes(geometry, |_| 0.5), &function);
        for (from, direction) in &rays {
            let (from, direction) = (*from, direction.normalize());
            let Some([near, far]) = within(&box_planes, from, direction) else {
                continue;
            };
            // A ray within an outer face may count as inside or outside.
            let grazes = box_planes
                .iter()
                .any(|(n, at)| n.dot(direction).abs() < 1e-9 && n.dot(from - *at).abs() < 1e-9);
            if grazes {
                continue;
            }
            let found = depth(along(&data, from, direction, 1e-9));
            // The fog's extinction is 1 to 3e-8, f32.
            let miss = (found - (far - near)).abs();
            assert!(miss < 1e-6, "{name}: {from} {direction}: {miss:.1e}");
        }
    }
}

#[test]
fn depths_of_a_uniform_field_are_lengths_in_a_cylinder_of_tetrahedra() {
    // Wedges of a 24-sided cylinder of three layers, each cut into three tetrahedra.
    let n = 24;
    let mut nodes = Vec::new();
    for layer in 0..4 {
        nodes.push(DVec3::Z * f64::from(layer) / 3.0);
        for i in 0..n {
            let turn = std::f64::consts::TAU * f64::from(i) / f64::from(n);
            nodes.push(DVec3::new(turn.cos(), turn.sin(), f64::from(layer) / 3.0));
        }
    }
    let mut cells = Vec::new();
    for layer in 0..3 {
        for i in 0..n {
            let at = |layer: u32, i: Option<u32>| layer * (n + 1) + i.map_or(0, |i| i % n + 1);
            // Cut along the diagonals to the higher number, so that neighbours agree.
            let mut corners = [None, Some(i), Some(i + 1)];
            corners.sort_by_key(|c| at(layer, *c));
            let [a, b, c] = corners.map(|i| at(layer, i));
            let [d, e, f] = corners.map(|i| at(layer + 1, i));
            for tet in [[a, b, c, f], [a, b, e, f], [a, d, e, f]] {
                cells.push((CellKind::TETRA, tet.to_vec()));
            }
        }
    }
    let mesh = mesh_of(nodes, &cells);
    let data = integrator(at_nodes(Geometry::Cells(mesh), |_| 0.5), &fog());
    assert_eq!(data.left_out(), 0);
    let sides = prism(24, 1.0);
    let mut random = Random::new(23);
    for _ in 0..200 {
        let direction = (random.rotation() * DVec3::X).normalize();
        let from = DVec3::Z * 0.5 + random.point(0.6) - 4.0 * direction;
        let length = within(&sides, from, direction).map_or(0.0, |[near, far]| far - near);
        let found = depth(along(&data, from, direction, 1e-9));
        assert!((found - length).abs() < 1e-6, "{found} {length}");
    }
}

#[test]
fn numberings_of_tetrahedra_do_not_change_the_picture() {
    let mut random = Random::new(41);
    let field = |p: DVec3| 0.5 + 0.5 * (1.3 * p.x + 0.4 * p.y * p.z).sin();
    let mesh = tetrahedra(3);
    let count = mesh.nodes.len();
    let shuffled = |random: &mut Random, n: usize| {
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            order.swap(i, random.index(i + 1));
        }
        order
    };
    let numbers = shuffled(&mut random, count);
    let mut nodes = vec![DVec3::ZERO; count];
    for (i, &number) in numbers.iter().enumerate() {
        nodes[number] = mesh.nodes[i];
    }
    let order = shuffled(&mut random, mesh.cell_count());
    // An even permutation of the corners keeps the orientation.
    let turns = [[0, 1, 2, 3], [1, 2, 0, 3], [3, 2, 1, 0], [2, 3, 0, 1]];
    let cells: Vec<_> = order
        .iter()
        .map(|&cell| {
            let corners = mesh.cell(cell);
            let turn = turns[random.index(4)];
            let corners = turn.map(|i: usize| numbers[corners[i] as usize] as u32);
            (CellKind::TETRA, corners.to_vec())
        })
        .collect();
    let again = mesh_of(nodes, &cells);
    let [a, b] = [mesh, again].map(|mesh| {
        let data = integrator(at_nodes(Geometry::Cells(mesh), field), &hats());
        assert_eq!(data.left_out(), 0);
        let eye = DVec3::new(-5.0, -7.0, 5.0);
        let camera = Camera::perspective(eye, DVec3::splat(1.5), DVec3::Z, 35.0, [24, 24]);
        let settings = ReferenceSettings {
            error: 1e-3,
            ..ReferenceSettings::default()
        };
        data.render(&camera, &settings).unwrap()
    });
    assert!(a.error <= 1e-3 && a.unconverged == 0);
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        // Faces round differently: 1e-11 of a cell. Rules may be refined at another position.
        assert_near(*a, *b, 1e-5, "renumbered");
    }
    let seen = a.pixels.iter().map(|p| p[3]).fold(0.0, f64::max);
    assert!(seen > 0.5, "{seen}");
}

#[test]
fn pictures_are_filtered_and_cut_as_those_of_kernels() {
    let lattice = Lattice::uniform([2; 3], DVec3::ZERO, DVec3::ONE);
    let data = at_nodes(Geometry::Lattice(lattice), |_| 0.5);
    let data = integrator(data, &fog());
    // Ten pixels per unit; the cube's left edge passes through the centres of a column.
    let eye = DVec3::new(0.05, -5.0, 0.5);
    let camera = Camera::orthographic(eye, eye + DVec3::Y, DVec3::Z, 2.0, [20, 20]);
    // At a sharp edge, the filter's error halves with each doubling of the samples.
    let settings = ReferenceSettings {
        error: 2e-3,
        max_rays_per_pixel: 4096,
        ..ReferenceSettings::default()
    };
    let frame = data.render(&camera, &settings).unwrap();
    assert!(frame.error <= 2e-3, "{:.1e}", frame.error);
    let opacity = 1.0 - (-1.0_f64).exp();
    let at = |x: usize, y: usize| frame.pixels[y * 20 + x][3];
    assert!((at(14, 10) - opacity).abs() < 2e-3);
    // x = 0 lies 0.5 px left of the image's middle, at the centre of pixel 9: half of a Gaussian.
    assert!((at(9, 10) - 0.5 * opacity).abs() < 2e-3, "{}", at(9, 10));
    assert!(at(2, 10).abs() < 2e-3);

    let plane = ClipPlane {
        normal: DVec3::Y,
        distance: -0.25,
    };
    let cut = data.clone().clipped(&[plane]);
    let ray = along(&cut, DVec3::new(0.5, -3.0, 0.5), DVec3::Y, 1e-9);
    assert!((depth(ray) - 0.75).abs() < 1e-6);
    // From inside, only the part in front of the eye counts.
    let ray = along(&data, DVec3::new(0.5, 0.3, 0.5), DVec3::Y, 1e-9);
    assert!((depth(ray) - 0.7).abs() < 1e-6);

    let kernels = ReferenceSettings {
        pixel_filter: PixelFilter::Kernels,
        ..ReferenceSettings::default()
    };
    assert!(data.render(&camera, &kernels).is_err());
    let task = Task::new();
    task.cancel();
    let cancelled = ReferenceSettings {
        task: Some(task),
        ..settings
    };
    assert!(matches!(
        data.render(&camera, &cancelled),
        Err(Error::Cancelled)
    ));
}

#[test]
fn overlapping_blocks_are_one_medium_and_the_first_wins() {
    let block = |low: f64| {
        let lattice = Lattice::uniform([3; 3], DVec3::X * low, DVec3::splat(0.5));
        CurvilinearBlock {
            dims: [3; 3],
            nodes: (0..27)
                .map(|i| lattice.position([i % 3, i / 3 % 3, i / 9]))
                .collect(),
        }
    };
    let blocks = vec![block(0.0), block(0.5)];
    let values = [[0.5_f32; 27], [1.0; 27]].concat();
    let geometry = Geometry::Curvilinear { blocks };
    let data = integrator(dataset(geometry, Association::Nodes, values), &ramp());
    let ray = along(&data, DVec3::new(-1.0, 0.3, 0.4), DVec3::X, 1e-9);
    // One unit of 0.5, then half a unit of 1.
    let truth = RATE * (0.5 + 0.5);
    assert!((depth(ray) - truth).abs() < 1e-6, "{}", depth(ray));
}

#[test]
fn what_is_damaged_is_left_out_and_the_rest_is_sound() {
    let function = fog();
    for (name, geometry) in cubes() {
        let sound = at_nodes(geometry, |_| 0.5);
        let through = |data: &Dataset, x: f64| {
            let data = integrator(data.clone(), &function);
            let ray = along(&data, DVec3::new(x, -1.0, 0.1), DVec3::Y, 1e-9);
            (depth(ray), data.left_out())
        };
        // A bad value at node (2, 2, 0) removes the cells around it, two of a ray.
        for value in [f32::NAN, f32::INFINITY] {
            let mut data = sound.clone();
            let FieldSource::Scalar(Values::F32(values)) = &mut data.fields[0].source else {
                panic!("scalars")
            };
            values[12] = value;
            let (depth, left_out) = through(&data, 1.3);
            assert!(
                depth < 4.0 - 1.1 && depth > 1.9 && left_out > 0,
                "{name} {depth}"
            );
            assert!((through(&data, 0.3).0 - 4.0).abs() < 1e-6, "{name}");
        }
        for place in [DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e300)] {
            let mut data = sound.clone();
            match &mut data.geometry {
                Geometry::Cells(mesh) => mesh.nodes[12] = place,
                Geometry::Curvilinear { blocks } => blocks[0].nodes[12] = place,
                _ => continue,
            }
            let data = integrator(data, &function);
            let ray = along(&data, DVec3::new(0.3, -1.0, 0.45), DVec3::Y, 1e-9);
            assert!(ray.rgba.iter().all(|c| c.is_finite()), "{name}");
            if !place.is_finite() {
                assert!(
                    (depth(ray) - 4.0).abs() < 1e-6 && data.left_out() > 0,
                    "{name}"
                );
            }
        }
    }
    // Inverted, flat and pointlike cells lie beside sound ones.
    let mut mesh = tetrahedra(2);
    let cell = |mesh: &CellMesh, i: usize| mesh.cell(i).to_vec();
    let [mut inverted, mut flat] = [cell(&mesh, 3), cell(&mesh, 3)];
    inverted.swap(0, 1);
    flat[3] = flat[0];
    let point = vec![flat[0]; 4];
    for corners in [inverted, flat, point] {
        mesh.kinds.push(CellKind::TETRA);
        mesh.connectivity.extend(corners);
        mesh.offsets.push(mesh.connectivity.len() as u32);
    }
    let data = integrator(at_nodes(Geometry::Cells(mesh), |_| 0.5), &function);
    assert_eq!(data.left_out(), 3);
    let ray = along(&data, DVec3::new(0.3, -1.0, 0.4), DVec3::Y, 1e-9);
    assert!((depth(ray) - 2.0).abs() < 1e-6);
    // Empty data are an error, and so are data without their own field.
    let lattice = Lattice::uniform([4, 4, 1], DVec3::ZERO, DVec3::ONE);
    let sheet = at_nodes(Geometry::Lattice(lattice), |_| 0.5);
    assert!(DataIntegrator::new(sheet, "f", fog()).is_err());
    let positions = vec![DVec3::ZERO; 4];
    let points = dataset(
        Geometry::Points { positions },
        Association::Nodes,
        vec![0.5; 4],
    );
    let refused = DataIntegrator::new(points, "f", fog()).unwrap_err();
    assert!(refused.to_string().contains("particles"), "{refused}");
    let mut short = at_nodes(Geometry::Cells(tetrahedra(1)), |_| 0.5);
    short.fields[0].source = FieldSource::Scalar(Values::F32(vec![0.5; 3]));
    assert!(DataIntegrator::new(short, "f", fog()).is_err());
}

#[test]
fn values_of_cells_are_constant_in_them_and_blanked_ones_are_gone() {
    for (name, geometry) in cubes().into_iter().skip(1).take(2) {
        let values: Vec<f32> = (0..64).map(|i| (i % 4) as f32 / 4.0).collect();
        let mut data = dataset(geometry, Association::Cells, values);
        let through = |data: Dataset| {
            let data = integrator(data, &ramp());
            depth(along(&data, DVec3::new(-1.0, 1.3, 0.4), DVec3::X, 1e-9))
        };
        let truth = RATE * 1.5;
        assert!((through(data.clone()) - truth).abs() < 1e-6, "{name}");
        let ghosts: Vec<u8> = (0..64).map(|i| u8::from(i == 7)).collect();
        data.fields.push(Field {
            name: "vtkGhostType".into(),
            association: Association::Cells,
            source: FieldSource::Scalar(Values::U8(ghosts)),
            unit: None,
        });
        // Cell 7 is (3, 1, 0): the last one of the ray, 0.75.
        let without = through(data);
        assert!((without - RATE * 0.75).abs() < 1e-6, "{name}: {without}");
    }
}

#[test]
fn a_data_set_far_below_a_pixel_is_found() {
    let lattice = Lattice::uniform([2; 3], DVec3::splat(-0.5), DVec3::ONE);
    let data = integrator(at_nodes(Geometry::Lattice(lattice), |_| 0.5), &fog());
    // A fifth of a pixel wide, between the pixels' centres.
    let camera = Camera::orthographic(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [8, 8]);
    let settings = ReferenceSettings {
        error: 2e-4,
        max_rays_per_pixel: 4096,
        ..ReferenceSettings::default()
    };
    let frame = data.render(&camera, &settings).unwrap();
    let sum: f64 = frame.pixels.iter().map(|p| p[3]).sum();
    // The filter preserves the sum: opacity times area.
    let truth = (1.0 - (-1.0_f64).exp()) * 0.04;
    assert!((sum / truth - 1.0).abs() < 0.1, "{sum} {truth}");
}
