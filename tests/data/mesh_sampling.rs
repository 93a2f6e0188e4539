//! Tests surfels of meshes: areas, numbers, evenness, colours, sides, and omissions.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

use crate::common::{Random, some};
use ewa_splat::io::{
    AlphaMode, Dataset, Geometry, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap,
};
use ewa_splat::math::normal_of_code;
use ewa_splat::sample::mesh::{
    MeshOptions, MeshReport, SampledMesh, Spread, pixels_per_area, surfels,
};
use ewa_splat::sample::{KernelOptions, SampleOptions, scene, volume};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use glam::{Affine2, DMat3, DVec2, DVec3, Vec2};

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        parts: vec![MeshPart {
            positions,
            triangles,
            ..MeshPart::default()
        }],
        materials: vec![Material::default()],
        textures: vec![],
    }
}

/// Returns a patch of `across` x `along` quadrilaterals over the unit square.
fn patch(across: u32, along: u32, at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let share = |i: u32, n: u32| f64::from(i) / f64::from(n);
    let positions = (0..=along)
        .flat_map(|j| (0..=across).map(move |i| (i, j)))
        .map(|(i, j)| at(share(i, across), share(j, along)))
        .collect();
    let index = |i: u32, j: u32| j * (across + 1) + i;
    let quad = |i: u32, j: u32| {
        let [a, b] = [index(i, j), index(i + 1, j)];
        let [c, d] = [index(i + 1, j + 1), index(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..along).flat_map(|j| (0..across).flat_map(move |i| quad(i, j)));
    mesh(positions, triangles.collect())
}

fn plane() -> Mesh {
    patch(1, 1, |x, y| DVec3::new(x, y, 0.0))
}

fn sphere(rows: u32) -> Mesh {
    patch(2 * rows, rows, |u, v| {
        // The seam's corners are equal to the last bit.
        let (u, v) = (if u == 1.0 { 0.0 } else { u } * TAU, PI * (1.0 - v));
        DVec3::new(v.sin() * u.cos(), v.sin() * u.sin(), v.cos())
    })
}

/// Returns a cylinder without its ends.
fn cylinder() -> Mesh {
    patch(96, 1, |u, v| {
        let u = if u == 1.0 { 0.0 } else { u } * TAU;
        DVec3::new(u.cos(), u.sin(), 4.0 * v)
    })
}

fn joined(meshes: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut all = Mesh::default();
    for mut mesh in meshes {
        for part in &mut mesh.parts {
            part.material += all.materials.len();
        }
        all.parts.append(&mut mesh.parts);
        all.materials.append(&mut mesh.materials);
    }
    all
}

fn coloured(mut mesh: Mesh, colour: [f32; 3]) -> Mesh {
    let [r, g, b] = colour;
    mesh.materials[0].base_colour = [r, g, b, 1.0];
    mesh
}

/// Returns a unit cube whose sides have different colours.
fn cube() -> Mesh {
    let side = |axis: usize, end: f64| {
        let square = patch(1, 1, |u, v| {
            let (u, v) = if end > 0.0 { (u, v) } else { (v, u) };
            let mut at = [0.0; 3];
            at[axis] = 0.5 * end;
            at[(axis + 1) % 3] = u - 0.5;
            at[(axis + 2) % 3] = v - 0.5;
            DVec3::from(at)
        });
        let mut colour = [0.0; 3];
        colour[axis] = if end > 0.0 { 1.0 } else { 0.5 };
        coloured(square, colour)
    };
    joined(
        [
            (0, 1.0),
            (0, -1.0),
            (1, 1.0),
            (1, -1.0),
            (2, 1.0),
            (2, -1.0),
        ]
        .map(|(a, e)| side(a, e)),
    )
}

fn options(count: usize) -> MeshOptions {
    MeshOptions {
        spread: Spread::Count(count),
        ..MeshOptions::default()
    }
}

fn sampled(mesh: &Mesh, count: usize) -> SampledMesh {
    let sampled = surfels(mesh, &options(count)).unwrap();
    for volume in &sampled.volumes {
        volume.validate().unwrap();
    }
    sampled
}

/// Surfel in f64.
#[derive(Clone, Copy)]
struct Surfel {
    at: DVec3,
    t1: DVec3,
    t2: DVec3,
    strength: f64,
    colour: [f32; 3],
}

impl Surfel {
    fn normal(&self) -> DVec3 {
        self.t1.cross(self.t2).normalize()
    }
}

fn list(volume: &PointVolume) -> Vec<Surfel> {
    let Particles::Surfels {
        positions,
        tangents,
        ..
    } = &volume.particles
    else {
        panic!("no surfels")
    };
    let (Strength::Surface(strengths) | Strength::Translucent(strengths)) = &volume.strength else {
        panic!("no surface")
    };
    let Colour::PerParticle(colours) = &volume.colour else {
        panic!("no colours")
    };
    let tangent = |t: [f32; 6], i: usize| DVec3::new(t[i].into(), t[i + 1].into(), t[i + 2].into());
    (0..positions.len())
        .map(|i| Surfel {
            at: positions[i],
            t1: tangent(tangents[i], 0),
            t2: tangent(tangents[i], 3),
            strength: strengths[i].into(),
            colour: colours[i],
        })
        .collect()
}

fn all(sampled: &SampledMesh) -> Vec<Surfel> {
    sampled.volumes.iter().flat_map(list).collect()
}

fn total(surfels: &[Surfel]) -> f64 {
    surfels.iter().map(|s| s.strength).sum()
}

/// Returns the sum of weights at a point of a surface with this normal: kernels of surfels that
/// face the same way, convolved with a low-pass filter in the tangent plane.
fn sum_of_weights(surfels: &[Surfel], at: DVec3, normal: DVec3, low_pass: f64) -> f64 {
    let (x, y) = normal.any_orthonormal_pair();
    let weight = |s: &Surfel| {
        let flat = |v: DVec3| DVec2::new(v.dot(x), v.dot(y));
        let (a, b, d) = (flat(s.t1), flat(s.t2), flat(at - s.at));
        let xx = a.x * a.x + b.x * b.x + low_pass;
        let xy = a.x * a.y + b.x * b.y;
        let yy = a.y * a.y + b.y * b.y + low_pass;
        let det = xx * yy - xy * xy;
        let q = (yy * d.x * d.x - 2.0 * xy * d.x * d.y + xx * d.y * d.y) / det;
        let facing = s.normal().dot(normal);
        if facing < 0.3 || (at - s.at).dot(normal).abs() > 0.3 {
            return 0.0;
        }
        s.strength * facing * (-0.5 * q).exp() / (TAU * det.sqrt())
    };
    surfels.iter().map(weight).sum()
}

/// Returns the root mean square and the greatest deviation from 1 of sums of weights at the points.
fn ripple(surfels: &[Surfel], points: &[(DVec3, DVec3)], low_pass: f64) -> [f64; 2] {
    let off = |&(at, normal): &(DVec3, DVec3)| sum_of_weights(surfels, at, normal, low_pass) - 1.0;
    let off: Vec<f64> = points.iter().map(off).collect();
    let squares: f64 = off.iter().map(|e| e * e).sum();
    [
        (squares / off.len() as f64).sqrt(),
        off.iter().fold(0.0, |most, e| e.abs().max(most)),
    ]
}

fn times(count: usize, mut make: impl FnMut() -> (DVec3, DVec3)) -> Vec<(DVec3, DVec3)> {
    (0..count).map(|_| make()).collect()
}

#[test]
fn areas_add_up_and_numbers_are_those_asked_for() {
    let slivers = patch(4000, 1, |x, y| DVec3::new(x, y, 0.0));
    let fan = patch(1, 500, |x, y| DVec3::new(x * y, x, 0.0));
    let graded = patch(60, 60, |x, y| DVec3::new(x.powi(4), y.powi(3), 0.0));
    let bent = patch(50, 50, |x, y| DVec3::new(x, y, 0.1 * (9.0 * x).sin()));
    let shapes = [
        ("plane", plane(), 1.0),
        ("sphere", sphere(40), f64::NAN),
        ("cube", cube(), 6.0),
        ("cylinder", cylinder(), f64::NAN),
        ("slivers", slivers, 1.0),
        ("fan", fan, 0.5),
        ("graded", graded, 1.0),
        ("bent", bent, f64::NAN),
    ];
    for (name, mesh, area) in shapes {
        for count in some([1, 7, 500, 8_000], name.len(), 2) {
            let sampled = sampled(&mesh, count);
            let SampledMesh { report, .. } = &sampled;
            let sum = total(&all(&sampled));
            // Each area is rounded to f32.
            assert!(
                (sum / report.area - 1.0).abs() < 1e-6,
                "{name} {count}: {sum}"
            );
            assert!(
                area.is_nan() || (report.area / area - 1.0).abs() < 1e-12,
                "{name}"
            );
            let found = report.surfel_count as f64;
            // A site may end up without pieces.
            assert!(
                (found / count as f64 - 1.0).abs() <= 0.02,
                "{name} {count}: {found}"
            );
        }
    }
    let tiny = MeshOptions {
        spread: Spread::Spacing(0.01),
        ..MeshOptions::default()
    };
    assert_eq!(
        surfels(&plane(), &tiny).unwrap().report.surfel_count,
        10_000
    );
    let dense = MeshOptions {
        spread: Spread::Density(500.0),
        ..MeshOptions::default()
    };
    assert_eq!(surfels(&cube(), &dense).unwrap().report.surfel_count, 3000);
}

/// Without blur, surfels have their cells' variance. Cells that tile a triangle have its moments,
/// with squares inside it or without.
#[test]
fn surfels_have_the_moments_of_their_triangle() {
    let square = |d: DVec3| DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    let size = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut random = Random::new(12);
    // Right, equilateral, obtuse, long; and too narrow for squares.
    let shapes = [
        [3.0, 0.0, 4.0],
        [2.0, 1.0, 1.7],
        [1.0, -2.0, 1.0],
        [9.0, 7.0, 1.0],
        [9.0, 1.0, 0.002],
    ];
    for (seed, [base, foot, height]) in (0..).zip(shapes) {
        let (turn, shift) = (random.rotation(), random.point(3.0));
        let corners = [[0.0, 0.0], [base, 0.0], [foot, height]]
            .map(|[x, y]| shift + turn * DVec3::new(x, y, 0.0));
        let mut one = mesh(corners.to_vec(), vec![[0, 1, 2]]);
        one.parts[0].colours = vec![
            [0.9, 0.1, 0.2, 1.0],
            [0.3, 0.8, 0.5, 1.0],
            [0.1, 0.4, 0.6, 1.0],
        ];
        let options = MeshOptions {
            kernel_width: (1.0_f64 / 12.0).sqrt(),
            seed,
            ..options(4000)
        };
        let sampled = surfels(&one, &options).unwrap();
        let found = all(&sampled);
        let (spacing, area) = (sampled.report.spacing, 0.5 * base * height);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        // Areas, tangents and colours are rounded to f32.
        assert!((total(&found) / area - 1.0).abs() < 1e-6);
        let mean = |of: &dyn Fn(&Surfel) -> DVec3| {
            found.iter().map(|s| s.strength * of(s)).sum::<DVec3>() / area
        };
        let off = (mean(&|s| s.at) - middle).length();
        assert!(off < 1e-6 * base, "{base} {foot} {height}: centroid {off}");
        let off = mean(&|s| s.colour.map(f64::from).into()) - DVec3::new(1.3, 1.3, 1.3) / 3.0;
        assert!(off.length() < 1e-6, "{base} {foot} {height}: colour {off}");
        let of_surfel = |s: &Surfel| {
            (square(s.at - middle) + square(s.t1) + square(s.t2)) * (s.strength / area)
        };
        let variance = found.iter().map(of_surfel).sum::<DMat3>();
        let truth = corners
            .map(|c| square(c - middle))
            .into_iter()
            .sum::<DMat3>()
            * (1.0 / 12.0);
        let off = size(variance - truth) / size(truth);
        assert!(off < 1e-6, "{base} {foot} {height}: variance {off}");
        let is_square = |s: &&Surfel| {
            let off = |t: DVec3| (t.length() / (options.kernel_width * spacing) - 1.0).abs();
            off(s.t1) < 1e-3 && off(s.t2) < 1e-3
        };
        let share = found.iter().filter(is_square).count() as f64 / found.len() as f64;
        println!("{base} {foot} {height}: {share:.3} of the surfels are squares");
        assert!(if height < 0.01 {
            share < 0.01
        } else {
            share > 0.5
        });
    }
}

#[test]
fn pixels_per_area_are_those_of_half_of_the_pixels() {
    let mut random = Random::new(5);
    let eye = DVec3::new(0.3, -0.2, 0.1);
    let size = DVec2::new(300.0, 200.0);
    for round in 0..40 {
        let target = eye + random.point(1.0);
        let camera = if round % 2 == 0 {
            Camera::perspective(eye, target, DVec3::Z, 60.0, [300, 200])
        } else {
            Camera::orthographic(eye, target, DVec3::Z, 3.0, [300, 200])
        };
        let ahead = |p: DVec3| eye + 4.0 * camera.forward() + p;
        let corners = [(); 3].map(|()| ahead(random.point(2.0)));
        let one = mesh(corners.to_vec(), vec![[0, 1, 2]]);
        let found = pixels_per_area(&one, &camera);
        // Tiny triangles everywhere in it, as the camera projects them: their area in pixels if
        // they are visible.
        let [a, e1, e2] = [corners[0], corners[1] - corners[0], corners[2] - corners[0]];
        let (n, h) = (300, 1e-4);
        let mut densities = Vec::new();
        for i in 0..n {
            for j in 0..n - i {
                let (s, t) = (f64::from(i) + 1.0 / 3.0, f64::from(j) + 1.0 / 3.0);
                let at = a + (e1 * s + e2 * t) / f64::from(n);
                let pixel = |p: DVec3| camera.project(p).unwrap();
                let at_pixel = pixel(at);
                if at_pixel.cmplt(DVec2::ZERO).any() || at_pixel.cmpgt(size).any() {
                    continue;
                }
                let (x, y) = (pixel(at + h * e1) - at_pixel, pixel(at + h * e2) - at_pixel);
                densities.push(x.perp_dot(y).abs() / (h * h * e1.cross(e2).length()));
            }
        }
        densities.sort_by(f64::total_cmp);
        // Each surfel covers as many pixels as its density implies.
        let denser_than = |density: f64| -> f64 {
            let denser = densities.iter().filter(|d| **d > density);
            denser.sum::<f64>() / densities.iter().sum::<f64>()
        };
        let Some(found) = found else {
            assert!(densities.is_empty(), "{round}");
            continue;
        };
        if densities.is_empty() {
            continue; // a corner's triangle touches the picture's
        }
        // One density applies to depths up to 1.1 apart, and to pieces across the edge of the
        // picture.
        let (more, less) = (denser_than(found * 1.16), denser_than(found / 1.16));
        println!("{round}: {found:.3} {more:.3} {less:.3}");
        assert!(more < 0.5 && less > 0.5, "{round}: {found} {more} {less}");
        // Meshes behind the eye have no bound.
        let behind = mesh(corners.map(|p| 2.0 * eye - p).to_vec(), vec![[0, 1, 2]]);
        assert_eq!(pixels_per_area(&behind, &camera), None);
    }
    assert_eq!(
        pixels_per_area(
            &Mesh::default(),
            &Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 1.0, [9, 9])
        ),
        None
    );
}

#[test]
fn surfels_keep_their_distance() {
    for (name, mesh) in [
        ("plane", plane()),
        ("sphere", sphere(60)),
        ("cylinder", cylinder()),
    ] {
        let sampled = sampled(&mesh, 3000);
        let surfels = all(&sampled);
        let spacing = sampled.report.spacing;
        let nearest: Vec<f64> = (0..surfels.len())
            .map(|i| {
                let others = (0..surfels.len()).filter(|j| *j != i);
                let far = |j: usize| surfels[i].at.distance(surfels[j].at);
                others.map(far).fold(f64::INFINITY, f64::min) / spacing
            })
            .collect();
        let mean = nearest.iter().sum::<f64>() / nearest.len() as f64;
        let least = nearest.iter().copied().fold(f64::INFINITY, f64::min);
        let squares: f64 = nearest.iter().map(|d| (d - mean).powi(2)).sum();
        let spread = (squares / nearest.len() as f64).sqrt();
        println!(
            "{name}: nearest neighbours at {mean:.3} +- {spread:.3} spacings, {least:.3} least"
        );
        // Random points would give .5 +- .26, a square lattice 1, a hexagonal one 1.07.
        assert!(mean > 0.72 && spread < 0.16 && least > 0.2, "{name}");
    }
}

#[test]
fn weights_add_up_to_one() {
    let mut random = Random::new(4);
    let mut share = || random.range(0.2, 0.8);
    let on_plane = times(400, || (DVec3::new(share(), share(), 0.0), DVec3::Z));
    let on_cube = times(400, || {
        (DVec3::new(share() - 0.5, 0.5, share() - 0.5), DVec3::Y)
    });
    let round = |s: DVec3| (s, s);
    let on_sphere = times(400, || {
        let (u, z) = (TAU * share(), 1.2 * share() - 0.6);
        round(DVec2::from_angle(u).extend(0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z)
    });
    let on_cylinder = times(400, || {
        let out = DVec2::from_angle(TAU * share()).extend(0.0);
        (out + 4.0 * share() * DVec3::Z, out)
    });
    let split = patch(37, 23, |x, y| {
        DVec3::new(
            x + 0.01 * (40.0 * y).sin() * x * (1.0 - x),
            y * y * 0.5 + y * 0.5,
            0.0,
        )
    });
    let slivers = patch(2000, 1, |x, y| DVec3::new(x, y, 0.0));
    println!("rms (greatest) deviation of sums of weights from 1 in %, 6,000 surfels");
    println!("            none           1/2 spacing    1 spacing      low-pass sigma");
    for (name, mesh, points) in [
        ("plane", plane(), &on_plane),
        ("split", split, &on_plane),
        ("slivers", slivers, &on_plane),
        ("cube", cube(), &on_cube),
        ("sphere", sphere(60), &on_sphere),
        ("cylinder", cylinder(), &on_cylinder),
    ] {
        let sampled = sampled(&mesh, 6000);
        let surfels = all(&sampled);
        let h = sampled.report.spacing;
        let found = [0.0, 0.5, 1.0].map(|low| ripple(&surfels, points, (low * h).powi(2)));
        let shown = found.map(|[rms, most]| format!("{:.3} ({:.3})", 100.0 * rms, 100.0 * most));
        println!(
            "{name:9} {:>14} {:>14} {:>14}",
            shown[0], shown[1], shown[2]
        );
        // A square lattice at rho .6 ripples by .33 %; kernels with 12 rho² times their cells'
        // variance by 5 %. Under the widest filter, the sphere's curvature shows: flat kernels of
        // 1.17 spacings on a radius of 22 are off by its square, .28 %.
        let limits = [0.02, 0.008, 0.004];
        for ([rms, _], limit) in found.iter().zip(limits) {
            assert!(*rms < limit, "{name}: {rms}");
        }
        let MeshReport { ripple, .. } = sampled.report;
        assert!(ripple > 0.0 && ripple < 0.15, "{name}: {ripple}");
    }
}

#[test]
fn no_triangle_vanishes() {
    // 100,000 triangles, every hundredth of them red, get 200 surfels.
    let mut mesh = patch(250, 200, |x, y| DVec3::new(x, y, 0.1 * (x * y).sin()));
    let part = &mut mesh.parts[0];
    let apart: Vec<DVec3> = part
        .triangles
        .iter()
        .flatten()
        .map(|&c| part.positions[c as usize])
        .collect();
    let is_red = |t: usize| (t * 7919).is_multiple_of(100);
    let count = part.triangles.len();
    part.triangles = (0..count as u32)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    part.colours = (0..3 * count)
        .map(|c| {
            if is_red(c / 3) {
                [1.0, 0.0, 0.0, 1.0]
            } else {
                [0.0, 0.0, 0.5, 1.0]
            }
        })
        .collect();
    part.positions = apart;
    let area = |t: usize| {
        let [a, b, c] = [0, 1, 2].map(|i| part.positions[3 * t + i]);
        0.5 * (b - a).cross(c - a).length()
    };
    let red: f64 = (0..count).filter(|t| is_red(*t)).map(area).sum();
    let whole: f64 = (0..count).map(area).sum();
    for wanted in [1, 200, 3000] {
        let surfels = all(&sampled(&mesh, wanted));
        let mean = |c: usize| {
            let sum = surfels.iter().map(|s| s.strength * f64::from(s.colour[c]));
            sum.sum::<f64>() / total(&surfels)
        };
        // Areas and colours are rounded to f32.
        assert!(
            (mean(0) - red / whole).abs() < 1e-7,
            "{} {}",
            mean(0),
            red / whole
        );
        assert!((mean(2) - 0.5 * (1.0 - red / whole)).abs() < 1e-7);
    }
}

#[test]
fn scattered_bits_are_gathered() {
    // A thousand triangles, far apart, get ten surfels.
    let mut random = Random::new(8);
    let mut bits = Vec::new();
    for i in 0..1000 {
        let (at, turn) = (random.point(1.0), random.rotation());
        let bit = patch(1, 1, |x, y| at + 1e-6 * (turn * DVec3::new(x, y, 0.0)));
        bits.push(coloured(
            bit,
            [if i % 10 == 0 { 1.0 } else { 0.0 }, 0.2, 0.0],
        ));
    }
    let sampled = sampled(&joined(bits), 10);
    let surfels = all(&sampled);
    assert!((1..=10).contains(&surfels.len()));
    assert!((total(&surfels) / 1e-9 - 1.0).abs() < 1e-6);
    let red: f64 = surfels
        .iter()
        .map(|s| s.strength * f64::from(s.colour[0]))
        .sum();
    assert!((red / total(&surfels) - 0.1).abs() < 1e-6);
}

#[test]
fn surfels_face_the_front() {
    let sphere = sampled(&sphere(30), 800);
    for s in all(&sphere) {
        assert!(s.normal().dot(s.at) > 0.98 * s.at.length());
        // Surfels lie on the surface: chords of thirty rows lie up to .3 % below.
        assert!((s.at.length() - 1.0).abs() < 0.004, "{}", s.at.length());
    }
}

#[test]
fn sharp_edges_sides_and_layers_stay_apart() {
    let surfels_of = |mesh: &Mesh| all(&sampled(mesh, 4000));
    let is_pure = |s: &Surfel, all: &[[f32; 3]]| all.contains(&s.colour);
    let sides = [
        [1.0, 0.0, 0.0],
        [0.5, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.5, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, 0.5],
    ];
    let cubes = surfels_of(&cube());
    assert!(cubes.iter().all(|s| is_pure(s, &sides)));
    assert!(
        cubes
            .iter()
            .all(|s| s.normal().abs().max_element() > 1.0 - 1e-6)
    );

    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let front = coloured(patch(9, 9, |x, y| DVec3::new(x, y, 1e-5)), red);
    let back = coloured(patch(7, 8, |x, y| DVec3::new(y, x, 0.0)), blue);
    for s in surfels_of(&joined([front, back])) {
        let facing = if s.normal().z > 0.0 { red } else { blue };
        assert_eq!(s.colour, facing);
    }
    // Two layers face the same way, far nearer than the spacing.
    let above = coloured(patch(9, 9, |x, y| DVec3::new(x, y, 1e-3)), red);
    let below = coloured(patch(7, 8, |x, y| DVec3::new(x, y, 0.0)), blue);
    for s in surfels_of(&joined([above, below])) {
        assert_eq!(s.colour, if s.at.z > 5e-4 { red } else { blue });
    }
}

#[test]
fn the_same_seed_gives_the_same_surfels_on_any_number_of_threads() {
    let mesh = joined([sphere(30), cube(), plane()]);
    let on = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let options = MeshOptions {
            seed,
            ..options(5000)
        };
        pool.unwrap().install(|| surfels(&mesh, &options).unwrap())
    };
    let [one, three, other] = [on(1, 7), on(3, 7), on(3, 8)];
    assert_eq!(one.volumes, three.volumes);
    assert_eq!(one.report, three.report);
    assert_ne!(one.volumes, other.volumes);
    assert!((one.report.ripple / other.report.ripple - 1.0).abs() < 0.2);
}

#[test]
fn where_and_how_large_a_mesh_is_does_not_matter() {
    let reference = all(&sampled(&sphere(24), 600));
    for (scale, shift) in [(1e-15, 0.0), (1e15, 0.0), (1.0, 1e6)] {
        let mut mesh = sphere(24);
        for p in &mut mesh.parts[0].positions {
            *p = *p * scale + shift;
        }
        let surfels = all(&sampled(&mesh, 600));
        for s in &surfels {
            let radius = ((s.at - shift) / scale).length();
            assert!((radius - 1.0).abs() < 0.006, "{scale} {shift}: {radius}");
        }
        let area = total(&surfels) / (scale * scale);
        assert!(
            (area / total(&reference) - 1.0).abs() < 1e-5,
            "{scale} {shift}"
        );
        let mean =
            |all: &[Surfel]| all.iter().map(|s| s.t1.length()).sum::<f64>() / all.len() as f64;
        let (here, there) = (mean(&surfels) / scale, mean(&reference));
        assert!(
            (here / there - 1.0).abs() < 0.02,
            "{scale} {shift}: {here} {there}"
        );
    }
}

/// Returns a plane whose texture coordinates are its own, v down.
fn textured(material: Material, size: [usize; 2], pixel: impl Fn(usize, usize) -> [u8; 4]) -> Mesh {
    let mut mesh = plane();
    let uv = |p: &DVec3| Vec2::new(p.x as f32, p.y as f32);
    mesh.parts[0].texture_coordinates = vec![mesh.parts[0].positions.iter().map(uv).collect()];
    let pixels = (0..size[0] * size[1]).map(|i| pixel(i % size[0], i / size[0]));
    mesh.textures = vec![Texture {
        image: Arc::new(TextureImage {
            width: size[0],
            height: size[1],
            pixels: pixels.collect(),
        }),
        wrap: [Wrap::Repeat; 2],
    }];
    mesh.materials = vec![material];
    mesh
}

fn whole_texture() -> Option<TextureUse> {
    Some(TextureUse {
        texture: 0,
        coordinates: 0,
        transform: Affine2::IDENTITY,
    })
}

fn material(alpha: AlphaMode) -> Material {
    Material {
        base_texture: whole_texture(),
        alpha,
        ..Material::default()
    }
}

#[test]
fn textures_are_filtered_over_the_cells() {
    let checker = |x: usize, y: usize| {
        if (x + y).is_multiple_of(2) {
            [255; 4]
        } else {
            [0, 0, 0, 255]
        }
    };
    let fine = textured(material(AlphaMode::Opaque), [512, 512], checker);
    for s in all(&sampled(&fine, 400)) {
        // There are 655 texels per surfel: their contrast averages to far below a grey level.
        assert!((s.colour[0] - 0.5).abs() < 2e-3, "{:?}", s.colour);
    }
    // The halves are white at y < 1/2 and black above.
    let halves = |_: usize, y: usize| if y < 32 { [255; 4] } else { [0, 0, 0, 255] };
    let mut mesh = textured(material(AlphaMode::Opaque), [64, 64], halves);
    mesh.textures[0].wrap = [Wrap::ClampToEdge; 2];
    for s in all(&sampled(&mesh, 2000)) {
        // Half a cell and half a texel from the edge, only one of them contributes.
        let expected = if s.at.y < 0.5 { 1.0 } else { 0.0 };
        if (s.at.y - 0.5).abs() > 0.045 {
            assert!(
                (s.colour[0] - expected).abs() < 1e-6,
                "{} {:?}",
                s.at,
                s.colour
            );
        }
    }
}

#[test]
fn factors_corners_and_glow_make_the_colour() {
    let half = |_: usize, _: usize| [188, 188, 188, 255];
    let mut mesh = textured(
        Material {
            base_colour: [0.5, 1.0, 0.25, 0.1],
            emissive: [0.0, 0.125, 0.5],
            emissive_texture: whole_texture(),
            ..material(AlphaMode::Opaque)
        },
        [4, 4],
        half,
    );
    // sRGB code 188 is .5029 linear.
    let linear = f64::from(ewa_splat::image::linear_from_srgb(188.0 / 255.0));
    mesh.parts[0].colours = mesh.parts[0]
        .positions
        .iter()
        .map(|p| [p.x as f32, 1.0, 1.0, 0.0])
        .collect();
    for s in all(&sampled(&mesh, 300)) {
        let expected = [0.5 * s.at.x, 1.0 + 0.125, 0.25 + 0.5].map(|c| c * linear);
        for (c, e) in s.colour.iter().zip(expected) {
            // Corners' colours are f32; the surfel's is the mean over a cell about its centroid.
            assert!(
                (f64::from(*c) - e).abs() < 1e-6,
                "{:?} {expected:?}",
                s.colour
            );
        }
    }
}

/// Returns the normals by which surfels reflect: stored ones, else those of their planes.
fn reflecting(sampled: &SampledMesh) -> Vec<DVec3> {
    let of_volume = |volume: &PointVolume| match &volume.normals {
        Some(codes) => codes
            .iter()
            .map(|c| normal_of_code(*c).as_dvec3())
            .collect(),
        None => list(volume).iter().map(Surfel::normal).collect::<Vec<_>>(),
    };
    sampled.volumes.iter().flat_map(of_volume).collect()
}

#[test]
fn coarse_meshes_reflect_as_the_smooth_ones_that_they_stand_for() {
    // Facets of a sphere of 12 rows are tilted by up to 7.5 degrees along the meridians and the
    // equator.
    let mut mesh = sphere(12);
    // The corners at a pole coincide, up to the sine of π.
    for position in &mut mesh.parts[0].positions {
        *position = (*position * 1e12).round() / 1e12;
    }
    let greatest = |mesh: &Mesh| {
        let sampled = sampled(mesh, 4000);
        let surfels = all(&sampled);
        let normals = reflecting(&sampled);
        let off = surfels.iter().zip(normals).map(|(s, n)| {
            let outwards = s.at.normalize();
            n.dot(outwards).clamp(-1.0, 1.0).acos().to_degrees()
        });
        off.fold(0.0, f64::max)
    };
    // Smoothed: triangles meet at 15 degrees. A corner's normal is the mean of its triangles'.
    let smooth = greatest(&mesh);
    assert!(smooth < 3.0, "{smooth}");
    // Normals are those of the file.
    let normal = |p: &DVec3| p.normalize().as_vec3();
    mesh.parts[0].normals = mesh.parts[0].positions.iter().map(normal).collect();
    let stated = greatest(&mesh);
    assert!(stated < 1.0, "{stated}");
    // Reversed normals mean the same side of the surface.
    for normal in &mut mesh.parts[0].normals {
        *normal = -*normal;
    }
    assert!((greatest(&mesh) - stated).abs() < 1e-6);
    // Flat shading, as glTF defines it: no normals are stored.
    mesh.parts[0].normals.clear();
    mesh.parts[0].is_flat = true;
    assert!(greatest(&mesh) > 5.0);
    let cube = sampled(&cube(), 600);
    assert!(cube.volumes.iter().all(|v| v.normals.is_none()));
}

#[test]
fn textures_of_normals_tilt_what_reflects() {
    // The normal is tilted by 30 degrees to the right of the texture, and by as much to its top.
    let (sine, cosine) = (0.5_f64, 0.75_f64.sqrt());
    let code = |x: f64| (255.0 * (0.5 + 0.5 * x)).round() as u8;
    let tilted = |x: f64, y: f64| {
        let pixel = [code(sine * x), code(sine * y), code(cosine), 255];
        let unused = Material {
            normal_texture: whole_texture(),
            ..material(AlphaMode::Opaque)
        };
        let unused = Material {
            base_texture: None,
            ..unused
        };
        textured(unused, [4, 4], move |_, _| pixel)
    };
    let check = |mesh: &Mesh, expected: DVec3| {
        for normal in reflecting(&sampled(mesh, 300)) {
            // Eight-bit codes: half a level of each component is .2 degrees.
            let degrees = normal
                .dot(expected.normalize())
                .clamp(-1.0, 1.0)
                .acos()
                .to_degrees();
            assert!(degrees < 0.5, "{normal} {expected}");
        }
    };
    // u runs along x. v, which points down in the texture, runs along y.
    check(&tilted(1.0, 0.0), DVec3::new(sine, 0.0, cosine));
    check(&tilted(0.0, 1.0), DVec3::new(0.0, -sine, cosine));
    // Mirrored on the surface, the right of the texture is on the left.
    let mut mirrored = tilted(1.0, 0.0);
    for uv in &mut mirrored.parts[0].texture_coordinates[0] {
        uv.x = -uv.x;
    }
    check(&mirrored, DVec3::new(-sine, 0.0, cosine));
    let mut half = tilted(1.0, 0.0);
    half.materials[0].normal_scale = 0.5;
    check(&half, DVec3::new(0.5 * sine, 0.0, cosine));
}

#[test]
fn what_light_does_not_change_has_no_normal() {
    let mut mesh = plane();
    mesh.materials[0].is_unlit = true;
    let sampled = sampled(&mesh, 100);
    for volume in &sampled.volumes {
        let codes = volume.normals.as_ref().unwrap();
        assert!(codes.len() == volume.particles.len() && codes.iter().all(|c| *c == 0));
    }
}

#[test]
fn alpha_is_absence_or_opacity_or_nothing() {
    let half = |x: usize, _: usize| [255, 0, 0, if x < 32 { 128 } else { 64 }];
    let opaque = sampled(&textured(material(AlphaMode::Opaque), [64, 4], half), 1000);
    assert!((total(&all(&opaque)) - 1.0).abs() < 1e-6);
    let mask = sampled(
        &textured(material(AlphaMode::Mask(0.4)), [64, 4], half),
        1000,
    );
    // The interpolated alpha passes .4 at .09 texels from the centre, and again at the seam. Both
    // lie within texels that each piece sees at its centre only.
    assert!(
        (total(&all(&mask)) - 0.5).abs() < 0.005,
        "{}",
        total(&all(&mask))
    );
    assert!(all(&mask).iter().all(|s| s.at.x < 0.52 || s.at.x > 0.98));
    assert!(all(&mask).iter().all(|s| s.colour == [1.0, 0.0, 0.0]));

    let uniform = |alpha: f32| {
        let mut mesh = plane();
        mesh.materials[0].alpha = AlphaMode::Blend;
        mesh.materials[0].base_colour = [0.2, 0.4, 0.6, alpha];
        mesh
    };
    for alpha in [0.01_f32, 0.5, 0.9, 0.999, 1.0, 7.0] {
        let pane = sampled(&uniform(alpha), 100);
        assert!(matches!(pane.volumes[0].strength, Strength::Translucent(_)));
        let opacity = -(-total(&all(&pane))).exp_m1();
        let expected = f64::from(alpha).min(ewa_splat::scene::MAX_OPACITY);
        assert!((opacity - expected).abs() < 1e-6, "{alpha}: {opacity}");
        for s in all(&pane) {
            for (c, e) in s.colour.iter().zip([0.2_f32, 0.4, 0.6]) {
                assert!((c - e).abs() < 1e-6);
            }
        }
    }
    assert!(surfels(&uniform(0.003), &options(100)).is_err());
    // Opacity is averaged, and colour weighted by opacity.
    let red_or_clear = |x: usize, y: usize| {
        if (x + y).is_multiple_of(2) {
            [255, 0, 0, 255]
        } else {
            [0, 255, 0, 0]
        }
    };
    let fine = textured(material(AlphaMode::Blend), [512, 512], red_or_clear);
    let pane = all(&sampled(&fine, 300));
    assert!((total(&pane) - std::f64::consts::LN_2).abs() < 0.01);
    assert!(
        pane.iter()
            .all(|s| s.colour[0] > 0.999 && s.colour[1] < 0.001)
    );
}

#[test]
fn each_kind_of_surface_has_its_volume() {
    let of = |alpha, is_double_sided, z: f64| {
        let mut mesh = patch(2, 2, |x, y| DVec3::new(x, y, z));
        mesh.materials[0] = Material {
            base_colour: [1.0, 1.0, 1.0, 0.5],
            alpha,
            is_double_sided,
            ..Material::default()
        };
        mesh
    };
    let mesh = joined([
        of(AlphaMode::Opaque, true, 0.0),
        of(AlphaMode::Mask(0.2), true, 1.0),
        of(AlphaMode::Opaque, false, 2.0),
        of(AlphaMode::Blend, true, 3.0),
        of(AlphaMode::Blend, false, 4.0),
    ]);
    let found: Vec<(bool, bool, usize)> = sampled(&mesh, 1000)
        .volumes
        .iter()
        .map(|v| {
            let Particles::Surfels { is_one_sided, .. } = v.particles else {
                panic!("no surfels")
            };
            let is_translucent = matches!(v.strength, Strength::Translucent(_));
            (is_translucent, is_one_sided, v.particles.len())
        })
        .collect();
    let expected = [
        (false, true, 200),
        (false, false, 400),
        (true, true, 200),
        (true, false, 200),
    ];
    assert_eq!(found, expected);
}

#[test]
fn the_number_follows_the_finest_texture() {
    // A ribbon: area .01, 400 x 100 texels, diagonal 1.
    let mut ribbon = textured(material(AlphaMode::Opaque), [400, 100], |_, _| [9; 4]);
    for p in &mut ribbon.parts[0].positions {
        p.y *= 0.01;
    }
    let automatic = |mesh: &Mesh| surfels(mesh, &MeshOptions::default()).unwrap().report;
    assert_eq!(automatic(&ribbon).surfel_count, 40_000);
    ribbon.materials[0].base_texture = None;
    let found = automatic(&ribbon).surfel_count;
    // The root of 1.0001 is the diagonal.
    assert!((9_990..=10_000).contains(&found), "{found}");
    // A bound on the density applies below that number, and only there.
    let bounded = |density: f64| {
        let options = MeshOptions {
            spread: Spread::NoDenser(density),
            ..MeshOptions::default()
        };
        surfels(&ribbon, &options).unwrap().report.surfel_count
    };
    assert_eq!([bounded(3e5), bounded(1e7)], [3000, found]);
}

#[test]
fn what_cannot_be_drawn_is_counted() {
    let mut mesh = textured(material(AlphaMode::Opaque), [4, 4], |_, _| [200; 4]);
    let part = &mut mesh.parts[0];
    let first = part.positions.len() as u32;
    part.positions.extend([
        DVec3::new(f64::NAN, 0.0, 0.0),
        DVec3::new(0.0, f64::INFINITY, 0.0),
        DVec3::new(5.0, 5.0, 0.0),
        DVec3::new(6.0, 5.0, 0.0),
        DVec3::new(5.0, 6.0, 0.0),
    ]);
    part.texture_coordinates[0].extend([Vec2::ZERO; 2]);
    part.texture_coordinates[0].extend([Vec2::NAN; 3]);
    part.triangles.extend([
        [0, 1, first],
        [0, first + 1, 2],
        [0, 1, 1],
        [0, 1, 9999],
        [first + 2, first + 3, first + 4],
    ]);
    let mut stray = plane();
    stray.parts[0].material = 77;
    mesh.parts.append(&mut stray.parts);
    let sampled = sampled(&mesh, 300);
    let found: Vec<(usize, &str)> = sampled
        .report
        .findings
        .iter()
        .map(|f| (f.count, &*f.reason))
        .collect();
    assert_eq!(found[0], (3, "a corner or the material does not exist"));
    assert_eq!(found[1], (2, "a corner is not finite"));
    assert_eq!(found[2], (1, "without area"));
    assert_eq!(found[3].1, "colour not finite");
    assert!((90..=110).contains(&found[3].0), "{found:?}");
    assert!((total(&all(&sampled)) - 1.0).abs() < 1e-6);
    assert!(
        all(&sampled)
            .iter()
            .all(|s| s.at.is_finite() && s.t2.length() > 0.0)
    );
}

#[test]
fn what_cannot_be_done_is_said() {
    let said = |mesh: &Mesh, spread: Spread| {
        let options = MeshOptions {
            spread,
            ..MeshOptions::default()
        };
        surfels(mesh, &options).unwrap_err().to_string()
    };
    for poison in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(said(&plane(), Spread::Density(poison)).contains("density of surfels"));
        assert!(said(&plane(), Spread::Spacing(poison)).contains("spacing of surfels"));
    }
    for spread in [
        Spread::Density(1e30),
        Spread::Spacing(1e-200),
        Spread::Count(300_000_000),
    ] {
        assert!(said(&plane(), spread).contains("at most 200000000"));
    }
    let flat = patch(3, 3, |x, _| DVec3::new(x, x, x));
    assert!(said(&flat, Spread::Automatic).contains("18 without"));
    assert!(said(&Mesh::default(), Spread::Automatic).contains("0 without"));

    let dataset = |mesh: Mesh| {
        Dataset::new(
            Path::new("some.obj"),
            "a mesh",
            Geometry::Mesh(mesh),
            vec![],
        )
    };
    let options = SampleOptions {
        kernels: KernelOptions {
            spread: Spread::Count(50),
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let found = scene(dataset(plane()), &options).unwrap();
    assert_eq!(found.volumes[0].particles.len(), 50);
    assert_eq!(found.report.sample_count, 2);
    assert_eq!(found.report.mesh.unwrap().surfel_count, 50);
    assert!(volume(dataset(plane()), &options).is_err());
    let error = scene(dataset(Mesh::default()), &options).unwrap_err();
    assert!(error.to_string().starts_with("some.obj: "), "{error}");
}
