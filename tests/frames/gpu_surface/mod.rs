//! Compares opaque surfels on the GPU with the CPU's: their projection, their rasteriser, kernels
//! that surfaces cut, and whole pictures.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

mod cuts;
mod pixels;
mod projection;
mod scenes;

use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::scene::{Particle, volume};
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::stages::constants::TILE_SIZE;
use ewa_splat::stages::cpu::{self, Bins, NormalTile, RasteriseSettings, SimdLevel, Tile};
use ewa_splat::stages::gpu::{
    Gpu, Projected, SurfacePixels, SurfaceSpec, project, rasterise_surface,
};
use ewa_splat::stages::record::{Footprint, PATH_NEAR_SURFEL};
use ewa_splat::stages::splat::Axes;
use ewa_splat::view::Camera;
use glam::DVec3;

/// Surfel in world space.
#[derive(Debug, Clone, Copy)]
struct Surfel {
    position: DVec3,
    tangents: [DVec3; 2],
    area: f32,
    colour: [f32; 3],
}

fn surfels(surfels: &[Surfel], is_one_sided: bool) -> PointVolume {
    let tangents = |s: &Surfel| {
        let [a, b] = s.tangents.map(|t| t.as_vec3().to_array());
        [a[0], a[1], a[2], b[0], b[1], b[2]]
    };
    PointVolume {
        colour: Colour::PerParticle(surfels.iter().map(|s| s.colour).collect()),
        ..PointVolume::new(
            Particles::Surfels {
                positions: surfels.iter().map(|s| s.position).collect(),
                tangents: surfels.iter().map(tangents).collect(),
                is_one_sided,
            },
            Strength::Surface(surfels.iter().map(|s| s.area).collect()),
        )
    }
}

/// Returns surfels on a Fibonacci lattice over a sphere, facing outwards.
fn sphere(centre: DVec3, radius: f64, count: usize, colour: [f32; 3]) -> Vec<Surfel> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let area = 4.0 * std::f64::consts::PI * radius * radius / count as f64;
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let ring = (1.0 - z * z).sqrt();
            let (sin, cos) = (golden * i as f64).sin_cos();
            let normal = DVec3::new(ring * cos, ring * sin, z);
            let along = normal.any_orthonormal_vector();
            let sigma = 0.7 * area.sqrt();
            Surfel {
                position: centre + normal * radius,
                tangents: [along * sigma, normal.cross(along) * sigma],
                area: area as f32,
                colour: [0, 1, 2].map(|c| colour[c] * (0.75 + 0.25 * normal[c] as f32)),
            }
        })
        .collect()
}

/// Returns `count`² surfels of a checked parallelogram.
fn plane(corner: DVec3, edges: [DVec3; 2], count: usize) -> Vec<Surfel> {
    let step = edges.map(|e| e / count as f64);
    let at = |i: usize, j: usize| Surfel {
        position: corner + step[0] * (i as f64 + 0.5) + step[1] * (j as f64 + 0.5),
        tangents: step.map(|s| s * 0.7),
        area: step[0].cross(step[1]).length() as f32,
        colour: if (i / 4 + j / 4).is_multiple_of(2) {
            [0.8, 0.8, 0.7]
        } else {
            [0.2, 0.25, 0.3]
        },
    };
    (0..count * count)
        .map(|n| at(n % count, n / count))
        .collect()
}

/// Returns surfels of any size and shape, around and in front of the eye.
fn scattered(random: &mut Random, count: usize, spread: f64) -> Vec<Surfel> {
    (0..count)
        .map(|_| {
            let size = random.log_range(2e-3, 0.3);
            let turn = random.rotation();
            let second = size / random.log_range(1.0, 30.0);
            let lean = random.range(-0.8, 0.8);
            Surfel {
                position: random.point(spread) + DVec3::Z * (0.8 * spread),
                tangents: [
                    turn.x_axis * size,
                    (turn.y_axis + turn.x_axis * lean) * second,
                ],
                area: (size * second * random.log_range(0.1, 10.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect()
}

fn kind(f: &Footprint) -> u32 {
    if f.path & 15 == PATH_NEAR_SURFEL {
        PATH_NEAR_SURFEL
    } else {
        f.path
    }
}

/// Projects the frame's particles again on the device.
fn on_device(gpu: &Gpu, frame: &Frame, is_cut: bool) -> Projected {
    project(
        gpu,
        &frame.volume,
        &frame.views,
        &frame.classified,
        &frame.pieces,
        &frame.uniform,
        frame.camera.camera_from_world.as_mat3(),
        is_cut,
        frame.classified.len(),
    )
    .unwrap()
}

/// A rounding of f32, relative.
const EPS: f32 = f32::EPSILON / 2.0;

fn perspective(size: [usize; 2]) -> Camera {
    Camera::perspective(DVec3::ZERO, DVec3::Z, -DVec3::Y, 60.0, size)
}

fn orthographic(size: [usize; 2]) -> Camera {
    Camera::orthographic(DVec3::Z * 0.5, DVec3::Z * 2.0, -DVec3::Y, 3.0, size)
}

fn spec_of(frame: &Frame) -> SurfaceSpec {
    SurfaceSpec {
        clip: false,
        ends: false,
        near: !frame.near.is_empty(),
        normals: false,
        count: false,
        is_picture: false,
    }
}

fn lists(frame: &Frame, bins: &Bins) -> Vec<Vec<u32>> {
    (0..frame.tiles[0] * frame.tiles[1])
        .map(|t| bins.tile(t).collect())
        .collect()
}

fn on_gpu(
    gpu: &Gpu,
    frame: &Frame,
    bins: &Bins,
    spec: SurfaceSpec,
    chunks: usize,
) -> SurfacePixels {
    let lists = lists(frame, bins);
    rasterise_surface(
        gpu,
        &frame.uniform,
        spec,
        &frame.footprints,
        &frame.surfels,
        &frame.near,
        &lists,
        chunks,
    )
    .unwrap()
}

/// Returns the tiles of a frame's surfels on the CPU, without fused operations, and their picture.
fn on_cpu(frame: &Frame, bins: &Bins, spec: SurfaceSpec) -> (Vec<Tile>, SurfacePixels) {
    let count = frame.tiles[0] * frame.tiles[1];
    let mut tiles = vec![Tile::default(); count];
    let mut normal_tiles = vec![NormalTile::new(); if spec.normals { count } else { 0 }];
    let splat_pixels = cpu::rasterise_surface(
        &frame.uniform,
        RasteriseSettings {
            axes: Axes {
                count: spec.count,
                ..Axes::default()
            },
            level: SimdLevel::Baseline,
            ends: None,
            task: None,
        },
        &frame.footprints,
        &frame.surfels,
        &frame.near,
        bins,
        frame.tiles[0],
        &mut tiles,
        &mut normal_tiles,
    );
    let (width, height) = (frame.camera.width, frame.camera.height);
    let place = |i: usize| {
        let (x, y) = (i % width, i / width);
        (
            y / TILE_SIZE * frame.tiles[0] + x / TILE_SIZE,
            y % TILE_SIZE * TILE_SIZE + x % TILE_SIZE,
        )
    };
    let mut image = Image::new(width, height);
    cpu::resolve(&tiles, None, false, &mut image);
    let each = |i: usize| place(i);
    let depths = (0..width * height).map(each);
    let depths = depths.map(|(t, at)| tiles[t].depth[at]).collect();
    let normals = (0..width * height).map(each).filter(|_| spec.normals);
    let normals = normals.map(|(t, at)| normal_tiles[t][at]).collect();
    let drawn = SurfacePixels {
        image,
        depth: DepthImage {
            width,
            height,
            depths,
        },
        normals,
        splat_pixels,
    };
    (tiles, drawn)
}

/// Largest difference from roundings: sums of some hundred weights near 1, each rounded by 2^-24,
/// and quotients of them.
const ROUNDING: f32 = 1e-5;

/// Returns a sphere on a checked plane, and another behind it.
fn spheres_on_a_plane() -> PointVolume {
    let mut list = sphere(DVec3::new(0.0, 0.0, 0.5), 0.5, 4_000, [0.9, 0.4, 0.2]);
    list.extend(sphere(
        DVec3::new(-0.3, 0.9, 0.5),
        0.5,
        4_000,
        [0.1, 0.5, 0.9],
    ));
    let edges = [DVec3::X * 4.0, DVec3::Y * 4.0];
    list.extend(plane(DVec3::new(-2.0, -2.0, 0.0), edges, 80));
    surfels(&list, false)
}

/// Returns cameras on that scene: perspective, orthographic, and so near that surfels cross the
/// camera plane.
fn cameras(size: [usize; 2]) -> [(&'static str, Camera); 3] {
    let target = DVec3::new(0.0, 0.2, 0.4);
    let eye = DVec3::new(0.6, -2.6, 1.4);
    let low = DVec3::new(0.3, -1.2, 0.02);
    [
        (
            "perspective",
            Camera::perspective(eye, target, DVec3::Z, 45.0, size),
        ),
        (
            "orthographic",
            Camera::orthographic(eye, target, DVec3::Z, 2.5, size),
        ),
        (
            "near",
            Camera::perspective(low, target, DVec3::Z, 70.0, size),
        ),
    ]
}

/// Returns ellipsoids about the scene, some cut by it, some behind it, some around a near eye.
fn gas(count: usize) -> PointVolume {
    let mut random = Random::new(45);
    let particles: Vec<Particle> = (0..count)
        .map(|_| {
            let size = random.log_range(0.01, 0.25);
            Particle {
                position: random.point(1.5) + DVec3::Z * 0.5,
                factor: random.factor(size, 5.0),
                mass: (size * size * random.log_range(0.02, 2.0)) as f32,
                colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
            }
        })
        .collect();
    volume(&particles)
}
