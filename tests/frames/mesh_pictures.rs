//! Compares pictures of meshes as surfels with a ray tracer of the triangles.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;
use std::sync::OnceLock;

use crate::common::{real_data, some};
use crate::support::Folder;
use ewa_splat::image::srgb_from_linear;
use ewa_splat::io::{Geometry, Mesh, OpenOptions, open, write_image};
use ewa_splat::reference::{MeshTracer, MeshTracerSettings};
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::view::Camera;
use ewa_splat::{Backend, Image, Renderer, Settings};
use glam::DVec3;

/// Picture sizes. The helmet has layers of leather a few pixels apart, which would merge to one
/// surface in a smaller picture.
const SIZES: [usize; 4] = [224, 224, 224, 448];

/// Rays per pixel.
const RAYS: usize = 144;

fn read(name: &str) -> Option<Mesh> {
    let path = real_data(name)?;
    read_file(&path)
}

/// Reads the cow with its texture, which its file does not name.
fn read_spot() -> Option<Mesh> {
    let shape = real_data("meshes/obj/spot/spot_triangulated.obj")?;
    let texture = real_data("meshes/obj/spot/spot_texture.png")?;
    let text = std::fs::read_to_string(shape).unwrap();
    let folder = Folder::new();
    folder.file("spot.png", &std::fs::read(texture).unwrap());
    folder.file("spot.mtl", b"newmtl spot\nmap_Kd spot.png\n");
    let text = format!("mtllib spot.mtl\nusemtl spot\n{text}");
    read_file(&folder.file("spot.obj", text.as_bytes()))
}

fn read_file(path: &Path) -> Option<Mesh> {
    match open(path, &OpenOptions::default()).unwrap().geometry {
        Geometry::Mesh(mesh) => Some(mesh),
        _ => panic!("{}: no mesh", path.display()),
    }
}

/// Returns a camera that sees all of the mesh from `side`, and the pixels per unit length in its
/// centre.
fn camera(mesh: &Mesh, side: DVec3, size: usize) -> (Camera, f64) {
    let all = || mesh.parts.iter().flat_map(|part| &part.positions);
    let low = all().copied().reduce(DVec3::min).unwrap();
    let high = all().copied().reduce(DVec3::max).unwrap();
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    let distance = 3.2 * radius;
    let eye = middle + distance * side.normalize();
    let camera = Camera::perspective(eye, middle, DVec3::Y, 38.0, [size, size]);
    let per_length = camera.focal_px.x / distance;
    (camera, per_length)
}

/// Returns the PSNR over mid grey in decibels, sRGB-encoded, full scale 1.
fn psnr(a: &Image, b: &Image) -> f64 {
    let shown = |p: [f32; 4], c: usize| {
        let over = p[c] + (1.0 - p[3]) * 0.214_041_14;
        f64::from(srgb_from_linear(over.clamp(0.0, 1.0)))
    };
    let mut sum = 0.0;
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        for c in 0..3 {
            sum += (shown(*a, c) - shown(*b, c)).powi(2);
        }
    }
    -10.0 * (sum / (3.0 * a.pixels.len() as f64)).log10()
}

/// Returns the least and the mean coverage at pixels around which the ray-traced picture is opaque
/// for three pixels.
fn coverage(image: &Image, truth: &Image) -> (f64, f64) {
    let (mut least, mut sum, mut count) = (1.0_f64, 0.0, 0.0);
    let is_opaque = |x: usize, y: usize| truth.pixel(x, y)[3] > 0.9999;
    for y in 3..image.height - 3 {
        for x in 3..image.width - 3 {
            if (y - 3..=y + 3).all(|y| (x - 3..=x + 3).all(|x| is_opaque(x, y))) {
                let alpha = f64::from(image.pixel(x, y)[3]);
                least = least.min(alpha);
                sum += alpha;
                count += 1.0;
            }
        }
    }
    (least, sum / f64::max(count, 1.0))
}

/// Writes pictures for inspection, into the folder that the environment variable names.
fn keep(name: &str, image: &Image) {
    static FOLDER: OnceLock<Option<String>> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| std::env::var("EWA_PICTURES").ok());
    if let Some(folder) = folder {
        write_image(format!("{folder}/{name}.png").as_ref(), image).unwrap();
    }
}

#[test]
fn surfels_show_what_rays_show() {
    println!(
        "{:14} side per px  surfels   PSNR  least coverage    mean",
        "mesh"
    );
    let meshes = [
        ("duck", "meshes/gltf/Duck.glb"),
        ("box", "meshes/gltf/BoxTextured/BoxTextured.gltf"),
        ("spot", ""),
        ("helmet", "meshes/gltf/FlightHelmet/FlightHelmet.gltf"),
    ];
    let mut faults = Vec::new();
    for ((name, file), size) in meshes.into_iter().zip(SIZES) {
        let read = if name == "spot" {
            read_spot()
        } else {
            read(file)
        };
        let Some(mesh) = read else { return };
        let tracer = MeshTracer::new(&mesh);
        let sides = [DVec3::new(0.7, 0.4, 1.0), DVec3::new(-0.8, 0.1, -0.9)];
        for (number, side) in some(sides.into_iter().enumerate(), name.len(), 2) {
            let (camera, per_length) = camera(&mesh, side, size);
            let settings = MeshTracerSettings {
                rays: RAYS,
                ..MeshTracerSettings::default()
            };
            let truth = tracer.render(&camera, &settings);
            keep(&format!("{name}-{number}-rays"), &truth);
            for per_px in some([1.0, 4.0], name.len(), 2) {
                let options = MeshOptions {
                    spread: Spread::Density(per_px * per_length * per_length),
                    ..MeshOptions::default()
                };
                let sampled = surfels(&mesh, &options).unwrap();
                let count = sampled.report.surfel_count;
                let mut renderer = Renderer::with_options(sampled.volumes, Backend::Cpu).unwrap();
                renderer.render(&camera, &Settings::default()).unwrap();
                let image = renderer.image();
                keep(&format!("{name}-{number}-{per_px}"), image);
                let psnr = psnr(image, &truth);
                let (least, mean) = coverage(image, &truth);
                println!(
                    "{name:14} {number:4} {per_px:6} {count:8} {psnr:6.2} {least:15.5} {mean:7.5}"
                );
                // The renderer keeps a few of the helmet's many layers per pixel, and some pixels
                // lack the last.
                let least_wanted = if name == "helmet" { 0.0 } else { 0.999 };
                if !(psnr >= 32.0 && mean >= 0.999 && least >= least_wanted) {
                    faults.push(format!(
                        "{name} {number} {per_px}: {psnr} dB, coverage {mean}"
                    ));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
