//! Measures popping: the largest change of a pixel between successive frames while the view rotates slowly, for each
//! way to composite, beside the change in the reference images.
//!
//! It also tests whether sorting by each kernel's depth along each pixel's own ray, rather than by the depth of its
//! centre, would help. A plain f64 loop sorts all kernels anew for every pixel: no window of sorted fragments could do
//! better.
//!
//! `cargo run --release -p ewa-splat-lab --example popping`

#![allow(
    clippy::cast_possible_truncation,
    reason = "colours and masses are f32"
)]

use ewa_splat::Composite;
use ewa_splat::reference::{Integrator, ReferenceSettings};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

/// Pixels along each side of the image.
const SIZE: usize = 48;
/// Frames of the orbit, and degrees between them.
const FRAMES: usize = 120;
const STEP_DEG: f64 = 0.5;
/// Height of the image in world units.
const HEIGHT: f64 = 6.0;

struct Kernel {
    position: DVec3,
    factor: DMat3,
    mass: f64,
    colour: [f32; 3],
}

/// Returns overlapping ellipsoids of axis ratios up to five and random colours, some three optical depths in all.
fn kernels() -> Vec<Kernel> {
    let mut state = 7_u64;
    let mut random = move || {
        // SplitMix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 / 2_f64.powi(64)
    };
    (0..400)
        .map(|_| {
            let mut point = || DVec3::new(random(), random(), random()) * 2.0 - 1.0;
            let (position, axis) = (point() * 2.0, point().normalize());
            let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, random() * 6.0));
            let [a, b] = [0.1 + 0.4 * random(), 0.1 + 0.2 * random()];
            Kernel {
                position,
                factor: turn * DMat3::from_diagonal(DVec3::new(a, b, 0.1)),
                mass: 0.1 + 0.2 * random(),
                colour: [random() as f32, random() as f32, random() as f32],
            }
        })
        .collect()
}

fn volume(kernels: &[Kernel]) -> PointVolume {
    let lower = |k: &Kernel| {
        let m = k.factor;
        let v = m * m.transpose();
        let a = v.x_axis.x.sqrt();
        let (b, d) = (v.x_axis.y / a, v.x_axis.z / a);
        let c = (v.y_axis.y - b * b).sqrt();
        let e = (v.y_axis.z - b * d) / c;
        let f = (v.z_axis.z - d * d - e * e).max(0.0).sqrt();
        [a, b, c, d, e, f].map(|x| x as f32)
    };
    PointVolume {
        particles: Particles::Anisotropic {
            positions: kernels.iter().map(|k| k.position).collect(),
            factors: kernels.iter().map(lower).collect(),
        },
        strength: Strength::Mass(kernels.iter().map(|k| k.mass as f32).collect()),
        colour: Colour::PerParticle(kernels.iter().map(|k| k.colour).collect()),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

fn camera(frame: usize) -> Camera {
    let (sin, cos) = (frame as f64 * STEP_DEG).to_radians().sin_cos();
    let eye = DVec3::new(10.0 * cos, 10.0 * sin, 3.0);
    Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, HEIGHT, [SIZE, SIZE])
}

/// Composites kernels one by one, in the order of their depths along each pixel's own ray.
fn sorted_by_pixel(kernels: &[Kernel], camera: &Camera) -> Image {
    struct Flat {
        centre: DVec2,
        inverse: DMat2,
        tau: f64,
        depth: f64,
        slope: DVec2,
        colour: [f32; 3],
    }
    let flat: Vec<Flat> = kernels
        .iter()
        .map(|k| {
            let u = camera.camera_point(k.position);
            let turned = camera.camera_from_world * k.factor;
            let v = turned * turned.transpose();
            let f = camera.focal_px;
            // Low-pass filter of variance one square pixel.
            let s = DMat2::from_cols(
                DVec2::new(v.x_axis.x * f.x * f.x + 1.0, v.x_axis.y * f.x * f.y),
                DVec2::new(v.x_axis.y * f.x * f.y, v.y_axis.y * f.y * f.y + 1.0),
            );
            let inverse = s.inverse();
            let peak = f.x * f.y / (std::f64::consts::TAU * s.determinant().sqrt());
            Flat {
                centre: u.truncate() * f + camera.centre_px,
                inverse,
                tau: k.mass * peak,
                depth: u.z,
                slope: inverse * (DVec2::new(v.z_axis.x, v.z_axis.y) * f),
                colour: k.colour,
            }
        })
        .collect();
    let mut image = Image::new(SIZE, SIZE);
    let mut list = Vec::new();
    for (i, pixel) in image.pixels.iter_mut().enumerate() {
        let at = DVec2::new((i % SIZE) as f64, (i / SIZE) as f64) + 0.5;
        list.clear();
        for k in &flat {
            let d = at - k.centre;
            let q = d.dot(k.inverse * d);
            if q < 16.0 {
                list.push((k.depth + k.slope.dot(d), k.tau * (-0.5 * q).exp(), k.colour));
            }
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, tau, colour) in &list {
            let weight = (1.0 - pixel[3]) * -(-*tau as f32).exp_m1();
            for (sum, c) in pixel.iter_mut().zip([colour[0], colour[1], colour[2], 1.0]) {
                *sum += weight * c;
            }
        }
    }
    image
}

/// Returns the largest change of a pixel between frames, and the largest root mean square over an image; linear colour.
fn jumps(images: &[Image]) -> [f64; 2] {
    let mut most = [0.0_f64; 2];
    for pair in images.windows(2) {
        let pixels = pair[0].pixels.iter().zip(&pair[1].pixels);
        let changes = pixels.flat_map(|(a, b)| [0, 1, 2].map(|c| f64::from(a[c] - b[c])));
        let (mut largest, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
        for change in changes {
            largest = largest.max(change.abs());
            sum += change * change;
            count += 1.0;
        }
        most[0] = most[0].max(largest);
        most[1] = most[1].max((sum / count).sqrt());
    }
    most
}

fn error(images: &[Image], truth: &[Image]) -> f64 {
    let pairs = images.iter().zip(truth);
    let pixels = pairs.flat_map(|(a, b)| a.pixels.iter().zip(&b.pixels));
    pixels
        .flat_map(|(a, b)| [0, 1, 2].map(|c| f64::from((a[c] - b[c]).abs())))
        .fold(0.0, f64::max)
}

fn main() -> Result<()> {
    let kernels = kernels();
    let scene = volume(&kernels);
    let integrator = Integrator::new(std::slice::from_ref(&scene))?;
    let settings = ReferenceSettings {
        error: 1e-5,
        pixel_filter: ewa_splat::reference::PixelFilter::Kernels,
        ..ReferenceSettings::default()
    };
    let truth = (0..FRAMES)
        .map(|n| Ok(integrator.render(&camera(n), &settings)?.image))
        .collect::<Result<Vec<_>>>()?;
    let show = |name: &str, images: &[Image]| {
        let [largest, rms] = jumps(images);
        let error = error(images, &truth);
        println!("{name:<34} {largest:>10.4} {rms:>10.5} {error:>10.4}");
    };
    println!(
        "{} kernels, {FRAMES} frames {STEP_DEG} degrees apart, {SIZE}x{SIZE}",
        kernels.len()
    );
    println!("{:<34} {:>10} {:>10} {:>10}", "", "largest", "rms", "error");
    show("true", &truth);
    let mut renderer = Renderer::new(vec![scene])?;
    for composite in Composite::ALL {
        let thicknesses: &[Option<f64>] = match composite {
            Composite::Slabs { .. } => &[None, Some(0.4), Some(0.2), Some(0.1)],
            Composite::Sheets { .. } | Composite::AxisSheets { .. } => {
                &[Some(0.4), Some(0.2), Some(0.1)]
            }
            // No layers.
            _ => &[None],
        };
        for &thickness in thicknesses {
            let settings = Settings {
                composite: composite.with_thickness(thickness),
                tolerance: 1e-3,
                ..Settings::default()
            };
            let images = (0..FRAMES)
                .map(|n| Ok(renderer.render(&camera(n), &settings)?.clone()))
                .collect::<Result<Vec<_>>>()?;
            let thickness = thickness.map_or(String::new(), |d| format!(", {d} thick"));
            show(&format!("{}{thickness}", composite.name()), &images);
        }
    }
    let images: Vec<_> = (0..FRAMES)
        .map(|n| sorted_by_pixel(&kernels, &camera(n)))
        .collect();
    show("over, sorted along each ray", &images);
    Ok(())
}
