//! Tests laws of light: reflection by particles, their normals, and data that light does not
//! affect.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::PI;
use std::path::Path;

use crate::common::{Random, grid_nodes, real_data, scalar};
use crate::support::meshes::tetrahedra_of_cube;
use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, Geometry, OpenOptions,
    RawLayout, RawType, open,
};
use ewa_splat::math::{NO_NORMAL, harmonics_count, normal_code, normal_of_code};
use ewa_splat::sample::{PurposeOptions, SampleOptions, volume as sample};
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Light, LightFrame, Lighting, Particles, PointVolume,
    SplatRule, Strength,
};
use ewa_splat::stages::cpu::{Sides, lit};
use ewa_splat::stages::record::LightingUniform;
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DMat3, DVec3, Vec3};

/// Error of the coding of normals: `math::normal_code`.
const CODE: f64 = 2.1e-3;

fn world(direction: DVec3, colour: [f32; 3]) -> Light {
    Light {
        direction,
        frame: LightFrame::World,
        colour,
    }
}

fn lighting(lights: &[Light]) -> Lighting {
    Lighting {
        lights: lights.to_vec(),
        ambient: 0.1,
        diffuse: 0.7,
        specular: 0.3,
        shininess: 20.0,
        shadows: None,
    }
}

fn settings(lighting: Option<Lighting>) -> Settings {
    Settings {
        lighting,
        ..Settings::default()
    }
}

fn draw(scene: &[PointVolume], camera: &Camera, settings: &Settings) -> Image {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer.render(camera, settings).unwrap();
    renderer.image().clone()
}

fn greatest_difference(a: &Image, b: &Image) -> f32 {
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.fold(0.0, |most, (x, y)| most.max((x - y).abs()))
}

/// Returns a cloud of white spheres around the origin, each with a normal.
fn cloud(normal: impl Fn(usize) -> u32) -> PointVolume {
    let mut random = Random::new(4);
    let count = 400;
    PointVolume {
        particles: Particles::Isotropic {
            positions: (0..count).map(|_| random.point(1.0)).collect(),
            sigmas: vec![0.1; count],
        },
        strength: Strength::Mass(vec![0.02; count]),
        colour: Colour::Uniform([0.8, 0.6, 0.4]),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: Some((0..count).map(normal).collect()),
        local_models: None,
    }
}

fn camera() -> Camera {
    let eye = DVec3::new(0.5, -4.0, 1.0);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, [48, 40])
}

// Reflection.

#[test]
fn reflection_is_lamberts_and_blinns() {
    let mut random = Random::new(1);
    let mut unit = || random.point(1.0).normalize();
    for case in 0..2_000 {
        let (normal, to_eye) = (unit(), unit());
        let lights = [
            Light {
                direction: unit() * 3.0,
                frame: LightFrame::Camera,
                colour: [1.0, 0.5, 0.25],
            },
            Light {
                direction: unit(),
                frame: LightFrame::Camera,
                colour: [0.2, 0.3, 0.4],
            },
        ];
        let lighting = lighting(&lights);
        let colour = [0.9, 0.5, 0.1];
        let uniform = LightingUniform::new(&lighting, &camera());
        for sides in [Sides::Both, Sides::Facing] {
            // The same, by angles.
            let mut expected = colour.map(|c| 0.1 * f64::from(c));
            let facing = if normal.dot(to_eye) < 0.0 {
                -normal
            } else {
                normal
            };
            for light in &lights {
                let l = light.direction.normalize();
                let angle = |v: DVec3| match sides {
                    Sides::Both => normal.angle_between(v).min(PI - normal.angle_between(v)),
                    Sides::Facing => facing.angle_between(v).min(PI / 2.0),
                };
                let incident = angle(l).cos();
                if sides == Sides::Facing && facing.angle_between(l) > PI / 2.0 {
                    continue;
                }
                let highlight = 0.3 * angle(l + to_eye).cos().powi(20);
                for c in 0..3 {
                    let own = 0.7 * incident * f64::from(colour[c]) + highlight;
                    expected[c] += f64::from(light.colour[c]) * own;
                }
            }
            let ours = lit(&uniform, sides, colour, normal.as_vec3(), to_eye.as_vec3());
            for (ours, expected) in ours.into_iter().zip(expected) {
                // Unit vectors in f32, 1e-7 each, times the exponent.
                assert!(
                    (f64::from(ours) - expected).abs() < 5e-6,
                    "{case}: {ours} {expected}"
                );
            }
        }
    }
}

#[test]
fn what_has_no_normal_keeps_its_colour() {
    let uniform = LightingUniform::new(&Lighting::default(), &camera());
    let colour = [0.3, 7.0, 0.0];
    assert_eq!(
        lit(&uniform, Sides::Both, colour, Vec3::ZERO, Vec3::X),
        colour
    );
    let (dark, unlit) = (cloud(|_| NO_NORMAL), settings(None));
    let lit = settings(Some(Lighting::default()));
    assert_eq!(
        draw(std::slice::from_ref(&dark), &camera(), &lit),
        draw(&[dark], &camera(), &unlit)
    );
}

#[test]
fn the_default_neither_dims_nor_blows_out() {
    let uniform = LightingUniform::new(&Lighting::default(), &camera());
    let white = [1.0; 3];
    // Facing the eye, on both kinds; a surface seen edge on still has its ambient part.
    let facing = lit(&uniform, Sides::Facing, white, -Vec3::Z, -Vec3::Z)[0];
    assert!((0.85..1.0).contains(&facing), "{facing}");
    let mut random = Random::new(3);
    let diffuse = Lighting {
        specular: 0.0,
        ..Lighting::default()
    };
    let diffuse = LightingUniform::new(&diffuse, &camera());
    for _ in 0..5_000 {
        let normal = random.point(1.0).normalize().as_vec3();
        for sides in [Sides::Both, Sides::Facing] {
            let [r, ..] = lit(&diffuse, sides, white, normal, -Vec3::Z);
            assert!((0.25..=1.0).contains(&r), "{normal}: {r}");
            let [highlight, ..] = lit(&uniform, sides, white, normal, -Vec3::Z);
            assert!(highlight - r <= 0.25 + 1e-6, "{normal}: {highlight}");
        }
    }
}

#[test]
fn a_picture_has_lamberts_cosine() {
    // The field increases in an oblique direction and has one colour: every particle has the same
    // normal.
    let slope = DVec3::new(0.6, 0.0, 0.8);
    let dims = [16, 16, 16];
    let lattice = Lattice::uniform(dims, DVec3::splat(-0.8), DVec3::splat(0.1));
    let values = values_on(&lattice, |x| slope.dot(x));
    let data = lattice_data(lattice, values);
    let mut volume = sampled(data);
    volume.colour = Colour::Uniform([0.5, 0.25, 1.0]);
    let camera = Camera::orthographic(DVec3::Z * 5.0, DVec3::ZERO, DVec3::Y, 1.0, [24, 24]);
    let plain = draw(std::slice::from_ref(&volume), &camera, &settings(None));
    for direction in [
        DVec3::X,
        DVec3::Z,
        -DVec3::Z,
        DVec3::new(-0.8, 0.0, 0.6),
        slope,
    ] {
        let lights = Lighting {
            specular: 0.0,
            ..lighting(&[world(direction, [1.0, 0.5, 0.0])])
        };
        let image = draw(
            std::slice::from_ref(&volume),
            &camera,
            &settings(Some(lights)),
        );
        let cosine = slope.dot(direction).abs();
        for (lit, plain) in image.pixels.iter().zip(&plain.pixels) {
            assert_eq!(lit[3], plain[3]);
            for (c, light) in [1.0, 0.5, 0.0].into_iter().enumerate() {
                let expected = f64::from(plain[c]) * (0.1 + 0.7 * light * cosine);
                // The code of the normal; the sum along a ray adds its f32 roundings.
                assert!((f64::from(lit[c]) - expected).abs() < 0.7 * CODE + 1e-5);
            }
        }
    }
}

#[test]
fn volumes_are_lit_from_either_side_and_surfels_towards_the_eye() {
    let mut random = Random::new(8);
    let directions: Vec<DVec3> = (0..400).map(|_| random.point(1.0)).collect();
    let lights = lighting(&[world(DVec3::new(1.0, -1.0, 2.0), [1.0; 3])]);
    let settings = settings(Some(lights));
    let there = draw(
        &[cloud(|i| normal_code(directions[i]))],
        &camera(),
        &settings,
    );
    let back = draw(
        &[cloud(|i| normal_code(-directions[i]))],
        &camera(),
        &settings,
    );
    // Opposite directions have different codes.
    assert!(greatest_difference(&there, &back) < 2.0 * CODE as f32);
    let tangents = |order: [usize; 2]| {
        let of = |n: &DVec3| {
            let both = [
                n.any_orthonormal_vector(),
                n.cross(n.any_orthonormal_vector()),
            ];
            let [a, b] = order.map(|i| (both[i].normalize() * 0.1).as_vec3());
            [a.x, a.y, a.z, b.x, b.y, b.z]
        };
        directions.iter().map(|n| of(&n.normalize())).collect()
    };
    let surfels = |order| {
        let mut volume = cloud(|_| NO_NORMAL);
        let Particles::Isotropic { positions, .. } = volume.particles else {
            panic!("spheres expected")
        };
        volume.particles = Particles::Surfels {
            positions,
            tangents: tangents(order),
            is_one_sided: false,
        };
        volume.normals = None;
        volume
    };
    let front = draw(&[surfels([0, 1])], &camera(), &settings);
    assert!(greatest_difference(&front, &draw(&[surfels([1, 0])], &camera(), &settings)) < 1e-5);
    let plain = draw(&[surfels([0, 1])], &camera(), &self::settings(None));
    assert!(greatest_difference(&front, &plain) > 0.1);
}

/// Returns a grey wall across y, whose front faces -y (x cross z), of surfels that reflect by one
/// stored normal or by their planes'.
fn wall(code: Option<u32>) -> PointVolume {
    let cells = (-8..=8).flat_map(|i| (-8..=8).map(move |j| (i, j)));
    let positions: Vec<DVec3> = cells
        .map(|(i, j)| DVec3::new(0.1 * f64::from(i), 0.0, 0.1 * f64::from(j)))
        .collect();
    let count = positions.len();
    PointVolume {
        strength: Strength::Surface(vec![0.01; count]),
        particles: Particles::Surfels {
            tangents: vec![[0.06, 0.0, 0.0, 0.0, 0.0, 0.06]; count],
            positions,
            is_one_sided: false,
        },
        colour: Colour::Uniform([0.5; 3]),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: code.map(|code| vec![code; count]),
        local_models: None,
    }
}

#[test]
fn a_surface_lit_from_behind_has_its_ambient_share() {
    let lights = |direction| {
        let lights = lighting(&[world(direction, [1.0; 3])]);
        settings(Some(lights))
    };
    let camera = Camera::orthographic(DVec3::Y * -3.0, DVec3::ZERO, DVec3::Z, 0.8, [16, 16]);
    let at = |direction| draw(&[wall(None)], &camera, &lights(direction)).pixels[8 * 16 + 8];
    // Towards the eye: .1 + .7 of the colour, and the full highlight.
    assert!(
        (at(-DVec3::Y)[0] - (0.5 * 0.8 + 0.3)).abs() < 1e-5,
        "{:?}",
        at(-DVec3::Y)
    );
    assert!((at(DVec3::Y)[0] - 0.05).abs() < 1e-6, "{:?}", at(DVec3::Y));
}

#[test]
fn surfels_reflect_by_the_normals_that_are_stored() {
    // A wall that faces the eye, with stored normals that are tilted.
    let drawn = |normal: DVec3, behind: bool, code: Option<u32>| {
        let side = if behind { DVec3::Y } else { -DVec3::Y };
        let lights = Lighting {
            specular: 0.0,
            ..lighting(&[world(side, [1.0; 3])])
        };
        let camera = Camera::orthographic(3.0 * side, DVec3::ZERO, DVec3::Z, 0.8, [16, 16]);
        let code = code.unwrap_or(normal_code(normal));
        draw(&[wall(Some(code))], &camera, &settings(Some(lights))).pixels[8 * 16 + 8][0]
    };
    for degrees in [0.0_f64, 20.0, 60.0] {
        let angle = degrees.to_radians();
        let normal = DVec3::new(angle.sin(), -angle.cos(), 0.0);
        let expected = 0.5 * (0.1 + 0.7 * angle.cos());
        for behind in [false, true] {
            let found = f64::from(drawn(normal, behind, None));
            assert!(
                (found - expected).abs() < 0.5 * 0.7 * CODE,
                "{degrees} {behind}: {found}"
            );
        }
    }
    // If the eye sees the front, a normal that faces away counts as just turned to the eye.
    let away = f64::from(drawn(DVec3::new(1.0, 0.3, 0.0), false, None));
    assert!(
        (away - 0.5 * (0.1 + 0.7 * 0.01)).abs() < 0.5 * 0.7 * CODE,
        "{away}"
    );
    // Without a direction, nothing is lit.
    assert!((drawn(DVec3::Y, false, Some(NO_NORMAL)) - 0.5).abs() < 1e-6);
}

#[test]
fn the_world_may_turn_with_its_lights() {
    let mut random = Random::new(5);
    let turn = random.rotation();
    let moved = DVec3::new(40.0, -9.0, 3.0);
    let normals: Vec<DVec3> = (0..400).map(|_| random.point(1.0).normalize()).collect();
    let eye = DVec3::new(0.5, -4.0, 1.0);
    let picture = |turn: DMat3, moved: DVec3, frame: LightFrame| {
        let mut scene = cloud(|i| normal_code(turn * normals[i]));
        if let Particles::Isotropic { positions, .. } = &mut scene.particles {
            positions.iter_mut().for_each(|p| *p = turn * *p + moved);
        }
        let camera = Camera::perspective(turn * eye + moved, moved, turn * DVec3::Z, 40.0, [40; 2]);
        let direction = DVec3::new(1.0, -0.5, 0.3);
        let light = match frame {
            LightFrame::World => world(turn * direction, [1.0; 3]),
            LightFrame::Camera => Light {
                direction,
                frame,
                colour: [1.0; 3],
            },
        };
        draw(&[scene], &camera, &settings(Some(lighting(&[light]))))
    };
    for frame in [LightFrame::World, LightFrame::Camera] {
        let (here, there) = (
            picture(DMat3::IDENTITY, DVec3::ZERO, frame),
            picture(turn, moved, frame),
        );
        // Two codes of each normal. A highlight of exponent 20 changes by sqrt(20) of an angle,
        // times .3, on top of the diffuse part.
        let most = 2.0 * CODE as f32 * (0.7 + 0.3 * 20_f32.sqrt());
        assert!(greatest_difference(&here, &there) < most);
    }
    let fixed = picture(DMat3::IDENTITY, DVec3::ZERO, LightFrame::Camera);
    let world = picture(DMat3::IDENTITY, DVec3::ZERO, LightFrame::World);
    assert!(greatest_difference(&fixed, &world) > 0.05);
}

// Data that light does not affect.

#[test]
fn radiance_fields_and_bare_particles_stay_as_they_are() {
    let lit = settings(Some(Lighting::default()));
    let mut random = Random::new(6);
    let mut splats = cloud(|_| normal_code(DVec3::X));
    splats.strength = Strength::PeakOpacity {
        opacities: vec![0.5; 400],
        rule: SplatRule::Exact,
        by_distance: false,
    };
    splats.colour = Colour::Harmonics {
        degree: 1,
        coefficients: (0..400 * 3 * harmonics_count(1))
            .map(|_| random.range(-0.5, 0.5) as f32)
            .collect(),
        is_linear: false,
    };
    let mut bare = cloud(|_| NO_NORMAL);
    bare.normals = None;
    for scene in [splats.clone(), bare] {
        let plain = draw(std::slice::from_ref(&scene), &camera(), &settings(None));
        assert_eq!(draw(&[scene], &camera(), &lit), plain);
    }
    // Harmonics of absorbing particles are lit.
    splats.strength = Strength::Mass(vec![0.02; 400]);
    let plain = draw(std::slice::from_ref(&splats), &camera(), &settings(None));
    assert!(greatest_difference(&draw(&[splats], &camera(), &lit), &plain) > 0.02);
}

#[test]
fn normals_alone_change_nothing_and_cost_four_bytes() {
    let with = cloud(|i| normal_code(DVec3::new(1.0, i as f64, 0.0)));
    let without = PointVolume {
        boundary: None,
        normals: None,
        ..with.clone()
    };
    let plain = Settings {
        level_of_detail: false,
        ..settings(None)
    };
    let image = draw(std::slice::from_ref(&with), &camera(), &plain);
    assert_eq!(
        image,
        draw(std::slice::from_ref(&without), &camera(), &plain)
    );
    let renderers = [with, without].map(|scene| Renderer::new(vec![scene]).unwrap());
    let [with, without] = &renderers;
    assert!(with.requirements()[0].normals && !without.requirements()[0].normals);
    let own = |r: &Renderer| r.volumes()[0].bytes();
    assert_eq!(own(with) - own(without), 4 * 400);
}

#[test]
fn volumes_with_normals_are_never_merged() {
    let mut scene = cloud(|_| normal_code(DVec3::X));
    let levels = |scene: &PointVolume| {
        let renderer = Renderer::new(vec![scene.clone()]).unwrap();
        renderer.volumes().len()
    };
    assert_eq!(levels(&scene), 1);
    scene.normals = None;
    assert!(levels(&scene) > 1);
    let lattice = Lattice::uniform([40; 3], DVec3::ZERO, DVec3::ONE);
    let values = values_on(&lattice, |x| x.x);
    let scene = sampled(lattice_data(lattice, values));
    assert_eq!(levels(&scene), 1);
}

#[test]
fn lights_out_of_range_are_refused() {
    let mut renderer = Renderer::new(vec![cloud(|_| NO_NORMAL)]).unwrap();
    let default = Lighting::default();
    let one = default.lights[0];
    let bad = [
        Lighting {
            lights: vec![one; 9],
            ..default.clone()
        },
        Lighting {
            lights: vec![world(DVec3::ZERO, [1.0; 3])],
            ..default.clone()
        },
        Lighting {
            lights: vec![world(DVec3::X, [f32::NAN; 3])],
            ..default.clone()
        },
        Lighting {
            lights: vec![world(DVec3::X, [1.0, -1.0, 1.0])],
            ..default.clone()
        },
        Lighting {
            ambient: -0.1,
            ..default.clone()
        },
        Lighting {
            specular: f32::INFINITY,
            ..default.clone()
        },
        Lighting {
            shininess: 0.5,
            ..default.clone()
        },
    ];
    for lighting in bad {
        let settings = settings(Some(lighting));
        assert!(
            renderer.render(&camera(), &settings).is_err(),
            "{settings:?}"
        );
    }
    let eight = Lighting {
        lights: vec![one; 8],
        ..default
    };
    assert!(renderer.render(&camera(), &settings(Some(eight))).is_ok());
    let surfels = PointVolume {
        normals: Some(vec![1, 2]),
        ..PointVolume::new(
            Particles::Surfels {
                positions: vec![DVec3::ZERO],
                tangents: vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]],
                is_one_sided: false,
            },
            Strength::Mass(vec![1.0]),
        )
    };
    assert!(surfels.validate().is_err());
    let mut short = cloud(|_| NO_NORMAL);
    short.normals = Some(vec![0; 399]);
    assert!(short.validate().is_err());
}

// Normals of samples.

fn field(association: Association, values: Vec<f32>) -> Vec<Field> {
    vec![scalar("value", association, values)]
}

fn dataset(geometry: Geometry, association: Association, values: Vec<f32>) -> Dataset {
    Dataset::new(
        Path::new("test"),
        "test",
        geometry,
        field(association, values),
    )
}

fn values_on(lattice: &Lattice, of: impl Fn(DVec3) -> f64) -> Vec<f32> {
    let [nx, ny, _] = lattice.dims;
    let cell = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    (0..lattice.len())
        .map(|i| of(lattice.position(cell(i))) as f32)
        .collect()
}

fn lattice_data(lattice: Lattice, values: Vec<f32>) -> Dataset {
    dataset(Geometry::Lattice(lattice), Association::Nodes, values)
}

/// Returns a volume with normals, with the field that the data choose.
fn sampled(data: Dataset) -> PointVolume {
    sampled_by(data, None)
}

fn sampled_by(data: Dataset, field: Option<&str>) -> PointVolume {
    let options = SampleOptions {
        field: field.map(Into::into),
        purpose: PurposeOptions {
            normals: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let volume = sample(data, &options).unwrap().volume;
    volume.validate().unwrap();
    volume
}

fn normals(volume: &PointVolume) -> Vec<DVec3> {
    let codes = volume.normals.as_ref().unwrap();
    codes
        .iter()
        .map(|&c| normal_of_code(c).as_dvec3())
        .collect()
}

fn bend(x: DVec3) -> DVec3 {
    let (r, a) = (1.0 + x.x, 1.0 + 1.2 * x.y);
    DVec3::new(r * a.cos(), r * a.sin(), x.z * x.z + 2.0 * x.z)
}

/// Returns a cube divided into boxes of six tetrahedra each.
fn tetrahedra(n: usize, at: impl Fn(DVec3) -> DVec3) -> CellMesh {
    let mut mesh = CellMesh {
        nodes: grid_nodes([n + 1; 3], at),
        offsets: vec![0],
        ..CellMesh::default()
    };
    let node = |[i, j, k]: [usize; 3]| (i + (n + 1) * (j + (n + 1) * k)) as u32;
    for cell in 0..n * n * n {
        let [i, j, k] = [cell % n, cell / n % n, cell / (n * n)];
        for entries in tetrahedra_of_cube([i, j, k], node) {
            mesh.kinds.push(CellKind::TETRA);
            mesh.connectivity.extend(entries);
            mesh.offsets.push(mesh.connectivity.len() as u32);
        }
    }
    mesh
}

#[test]
fn linear_fields_point_along_their_slope_on_any_data() {
    let slope = DVec3::new(0.3, -0.7, 0.9);
    let linear = |x: DVec3| (slope.dot(x) + 0.5) as f32;
    let n = 7;
    let uniform = Lattice {
        dims: [n; 3],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::splat(-3.0),
            step: DMat3::from_cols(
                DVec3::new(0.5, 0.1, 0.0),
                DVec3::new(-0.2, 0.4, 0.1),
                DVec3::new(0.0, 0.3, 0.6),
            ),
        },
    };
    let axis = |ratio: f64| (0..n).map(|i| ratio.powi(i as i32)).collect::<Vec<_>>();
    let rectilinear = Lattice {
        dims: [n; 3],
        spacing: LatticeSpacing::Rectilinear {
            coordinates: [axis(1.3), axis(1.1), axis(1.2)],
        },
    };
    let nodes = grid_nodes([n; 3], bend);
    let centres = |nodes: &[DVec3]| -> Vec<DVec3> {
        let cells = (0..6 * 6 * 6).map(|c| [c % 6, c / 6 % 6, c / 36]);
        let corner = |[i, j, k]: [usize; 3], c: usize| {
            nodes[i + (c & 1) + n * (j + (c >> 1 & 1) + n * (k + (c >> 2)))]
        };
        cells
            .map(|cell| (0..8).map(|c| corner(cell, c)).sum::<DVec3>() / 8.0)
            .collect()
    };
    let curvilinear = || Geometry::Curvilinear {
        blocks: vec![CurvilinearBlock {
            dims: [n; 3],
            nodes: nodes.clone(),
        }],
    };
    let mesh = tetrahedra(6, bend);
    let of = |points: &[DVec3]| points.iter().map(|x| linear(*x)).collect::<Vec<_>>();
    let cell_centres: Vec<DVec3> = (0..mesh.cell_count())
        .map(|c| {
            let corners = mesh.cell(c).iter().map(|&i| mesh.nodes[i as usize]);
            corners.sum::<DVec3>() / 4.0
        })
        .collect();
    // Cells share positions but no nodes.
    let mut apart = mesh.clone();
    apart.nodes = mesh
        .connectivity
        .iter()
        .map(|&i| mesh.nodes[i as usize])
        .collect();
    apart.connectivity = (0..mesh.connectivity.len() as u32).collect();
    let of_apart = of(&cell_centres);
    // A boundary layer, a hundred times as wide as thick.
    let thin = tetrahedra(6, |x| DVec3::new(0.01 * x.x, x.y, x.z));
    let of_thin = of(&thin.nodes);
    // Layers of points, in which a point's nearest neighbours are all in its own.
    let layers: Vec<DVec3> = (0..9 * 9 * 5)
        .map(|n| DVec3::new((n % 9) as f64, (n / 9 % 9) as f64, 4.0 * (n / 81) as f64) * 0.1)
        .collect();
    let mut random = Random::new(2);
    let scattered: Vec<DVec3> = (0..500).map(|_| random.point(1.0)).collect();
    let points = Geometry::Points {
        positions: scattered.clone(),
    };
    let of_lattice = |lattice: &Lattice| values_on(lattice, |x| f64::from(linear(x)));
    let (of_uniform, of_rectilinear) = (of_lattice(&uniform), of_lattice(&rectilinear));
    let data = [
        ("uniform", lattice_data(uniform, of_uniform)),
        ("rectilinear", lattice_data(rectilinear, of_rectilinear)),
        (
            "nodes",
            dataset(curvilinear(), Association::Nodes, of(&nodes)),
        ),
        (
            "cells",
            dataset(curvilinear(), Association::Cells, of(&centres(&nodes))),
        ),
        (
            "mesh nodes",
            dataset(
                Geometry::Cells(mesh.clone()),
                Association::Nodes,
                of(&mesh.nodes),
            ),
        ),
        (
            "mesh cells",
            dataset(Geometry::Cells(mesh), Association::Cells, of(&cell_centres)),
        ),
        (
            "points",
            dataset(points, Association::Nodes, of(&scattered)),
        ),
        (
            "cells apart",
            dataset(Geometry::Cells(apart), Association::Cells, of_apart),
        ),
        (
            "thin mesh",
            dataset(Geometry::Cells(thin), Association::Nodes, of_thin),
        ),
        (
            "layers",
            dataset(
                Geometry::Points {
                    positions: layers.clone(),
                },
                Association::Nodes,
                of(&layers),
            ),
        ),
    ];
    for (name, data) in data {
        let volume = sampled_by(data, Some("value"));
        assert_eq!(normals(&volume).len(), volume.particles.len());
        for normal in normals(&volume) {
            // The code, and f32 values: 6e-8 of them over steps of .05 and more.
            let error = (normal - slope.normalize()).length();
            assert!(error < CODE + 1e-4, "{name}: {normal} {error}");
        }
    }
}

#[test]
fn normals_are_stored_only_if_asked_for() {
    let lattice = Lattice::uniform([4; 3], DVec3::ZERO, DVec3::ONE);
    let values = values_on(&lattice, |x| x.x);
    let plain = sample(lattice_data(lattice, values), &SampleOptions::default()).unwrap();
    assert!(plain.volume.normals.is_none());
}

#[test]
fn constant_and_missing_values_have_no_normal() {
    let lattice = Lattice::uniform([6; 3], DVec3::ZERO, DVec3::ONE);
    let values = values_on(&lattice, |x| match x.x {
        x if x < 2.5 => 7.0,
        x if x > 4.5 => f64::NAN,
        x => x,
    });
    let volume = sampled(lattice_data(lattice, values));
    for (i, normal) in normals(&volume).into_iter().enumerate() {
        let expected = match i % 6 {
            0 | 1 | 5 => DVec3::ZERO,
            // At 2, the constant part ends: 7, 7, 3.
            2 => DVec3::NEG_X,
            // 7 to 4 around 3; one-sided towards 3 at 4.
            3 => DVec3::NEG_X,
            _ => DVec3::X,
        };
        assert!((normal - expected).length() < CODE, "{i}: {normal}");
    }
}

// Real data.

#[test]
fn real_volumes_are_lit() {
    let raw = |dims| {
        let raw = Some(RawLayout::new(dims, RawType::U8));
        OpenOptions {
            raw,
            ..OpenOptions::default()
        }
    };
    // Fractions of samples with a normal: nearly all in the simulated data. The nucleon's
    // surroundings are 0, and the particle cloud has constant density inside another.
    for (name, options, share) in [
        ("volumes/nucleon_41x41x41_uint8.raw", raw([41; 3]), 0.5),
        (
            "curvilinear/bluntfin/bluntfinxyz.bin",
            OpenOptions::default(),
            0.99,
        ),
        ("curvilinear/multicomb_0.vts", OpenOptions::default(), 0.99),
        (
            "unstructured/CylinderLinear.vtk",
            OpenOptions::default(),
            0.99,
        ),
        (
            "particles/phantom_mhd_00000.csv",
            OpenOptions::default(),
            0.6,
        ),
    ] {
        let Some(path) = real_data(name) else {
            continue;
        };
        let volume = sampled(open(&path, &options).unwrap());
        let codes = volume.normals.as_ref().unwrap();
        let with = codes.iter().filter(|&&c| c != NO_NORMAL).count();
        assert!(
            with as f64 >= share * codes.len() as f64,
            "{name}: {with} of {}",
            codes.len()
        );
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        let front = Viewpoint {
            azimuth_deg: 30.0,
            elevation_deg: 30.0,
            zoom: 1.0,
            up: DVec3::Z,
        };
        let camera = front.camera(&renderer.visible_boxes(), Lens::FovDeg(30.0), [64; 2]);
        let camera = camera.unwrap();
        let plain = renderer.render(&camera, &settings(None)).unwrap().clone();
        let lit = settings(Some(Lighting::default()));
        let image = renderer.render(&camera, &lit).unwrap();
        assert!(greatest_difference(image, &plain) > 0.02, "{name}");
        let alphas = image.pixels.iter().zip(&plain.pixels);
        assert!(alphas.clone().all(|(a, b)| a[3] == b[3]), "{name}");
    }
}
