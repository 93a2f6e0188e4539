//! Measures the error of shadows against single scattering in f64, and their time.
//!
//!     cargo run --release -p ewa-splat-lab --example shadow_error [SIZE [SCENE|all [PIXELS [FOLDER]]]]
//!
//! Pictures of the renderer are compared with [`Integrator::lit_pixels`] at some pixels: with lights, and with lights
//! and shadows. What the second row of a scene has above the first is due to shadows. The reference of the first row
//! has no shadows either.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "inputs are narrowed on purpose, and counts are small"
)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use ewa_splat::io::{Geometry, OpenOptions, RawLayout, RawType, open, write_image};
use ewa_splat::math::normal_code;
use ewa_splat::reference::Integrator;
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::sample::{FunctionOptions, PurposeOptions, SampleOptions, TransferChoice, volume};
use ewa_splat::scene::{Light, LightFrame, Lighting, Particles, PointVolume, Shadows, Strength};
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Backend, Image, Renderer, Settings};
use glam::DVec3;

/// A scene, and the direction that is up.
type Scene = (&'static str, Vec<PointVolume>, DVec3);

fn main() -> ewa_splat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let size: usize = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(96);
    let wanted = arguments.next();
    let count: usize = arguments
        .next()
        .and_then(|a| a.parse().ok())
        .unwrap_or(2000);
    let out = arguments.next().map(PathBuf::from);
    println!("scene | light | RMSE | 99.9th percentile | greatest | frame ms | shadows ms");
    for (name, scene, up) in scenes()? {
        if wanted
            .as_deref()
            .is_some_and(|wanted| wanted != name && wanted != "all")
        {
            continue;
        }
        let mut renderer = Renderer::with_options(scene.clone(), Backend::Cpu)?;
        let viewpoint = Viewpoint {
            azimuth_deg: 30.0,
            elevation_deg: 25.0,
            zoom: 1.0,
            up,
        };
        let boxes = renderer.visible_boxes();
        let Some(camera) = viewpoint.camera(&boxes, Lens::FovDeg(30.0), [size; 2]) else {
            continue;
        };
        let integrator = Integrator::new(&scene)?;
        let place = |n: usize| spread::<2>(n).map(|share| (share * size as f64) as usize);
        let pixels: Vec<[usize; 2]> = (0..count).map(place).collect();
        let across = up.any_orthonormal_vector();
        for (label, shadows) in [
            ("none", None),
            ("sharp", Some(Shadows::SHARP)),
            ("soft", Some(Shadows { softness_deg: 4.0 })),
        ] {
            let lighting = Lighting {
                lights: vec![Light {
                    direction: up * 1.5 + across * 0.5 + up.cross(across) * 0.7,
                    frame: LightFrame::World,
                    colour: [1.0; 3],
                }],
                ambient: 0.1,
                diffuse: 0.9,
                specular: 0.0,
                shadows,
                ..Lighting::default()
            };
            let settings = Settings {
                lighting: Some(lighting.clone()),
                low_pass_variance_px2: renderer.suitable_low_pass_px2(),
                ..Settings::default()
            };
            let picture = renderer.render(&camera, &settings)?.clone();
            let times = renderer.times();
            let begun = Instant::now();
            renderer.render(&camera, &settings)?;
            let kept = begun.elapsed().as_secs_f64() * 1e3;
            let low_pass = settings.low_pass_variance_px2.into();
            let truth = integrator.lit_pixels(&camera, &lighting, low_pass, &pixels)?;
            let [rmse, most, greatest] = errors(&picture, &pixels, &truth);
            println!(
                "{name} | {label} | {rmse:.2e} | {most:.2e} | {greatest:.2e} | {kept:.1} | {:.1}",
                times.shadow
            );
            if let Some(out) = &out {
                let file = out.join(format!("{name}_{label}.png").replace(' ', "_"));
                write_image(&file, &picture.over([0.1; 3]))?;
            }
        }
    }
    Ok(())
}

/// Returns the root mean square, the 99.9th percentile and the greatest difference of pixels, over channels.
fn errors(picture: &Image, pixels: &[[usize; 2]], truth: &[[f64; 4]]) -> [f64; 3] {
    let difference = |(&[x, y], truth): (&[usize; 2], &[f64; 4])| {
        let own = picture.pixel(x, y);
        (0..3).fold(0.0_f64, |most, c| {
            most.max((f64::from(own[c]) - truth[c]).abs())
        })
    };
    let mut all: Vec<f64> = pixels.iter().zip(truth).map(difference).collect();
    all.sort_by(f64::total_cmp);
    let squares: f64 = all.iter().map(|e| e * e).sum();
    let count = all.len();
    [
        (squares / count as f64).sqrt(),
        all[(count * 999 / 1000).min(count - 1)],
        all[count - 1],
    ]
}

fn scenes() -> ewa_splat::Result<Vec<Scene>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let with_normals = SampleOptions {
        purpose: PurposeOptions {
            normals: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let function = FunctionOptions {
        transfer: TransferChoice::File(root.join("fixtures/wake_transfer.json")),
        ..FunctionOptions::default()
    };
    let of_wake = SampleOptions {
        function,
        ..with_normals.clone()
    };
    let wake = open(&root.join("fixtures/wake.xyz"), &OpenOptions::default())?;
    let wake = volume(wake, &of_wake)?.volume;
    let Geometry::Mesh(mesh) =
        open(&root.join("fixtures/vase.glb"), &OpenOptions::default())?.geometry
    else {
        return Ok(Vec::new());
    };
    let options = MeshOptions {
        spread: Spread::Count(20_000),
        ..MeshOptions::default()
    };
    let vase = surfels(&mesh, &options)?.volumes;
    let mut both = vase.clone();
    both.push(smoke(&mesh_box(&vase)));
    let mut scenes = vec![
        ("cloud", vec![cloud()], DVec3::Z),
        ("wake", vec![wake], DVec3::Z),
        ("vase", vase, DVec3::Y),
        ("vase in smoke", both, DVec3::Y),
    ];
    let nucleon = root.join("../shared/data/volumes/nucleon_41x41x41_uint8.raw");
    if nucleon.exists() {
        let options = OpenOptions {
            raw: Some(RawLayout::new([41; 3], RawType::U8)),
            ..OpenOptions::default()
        };
        let own = volume(open(&nucleon, &options)?, &with_normals)?.volume;
        scenes.push(("nucleon", vec![own], DVec3::Z));
    }
    Ok(scenes)
}

/// Returns the middle and half the size of the box around surfels.
fn mesh_box(volumes: &[PointVolume]) -> [DVec3; 2] {
    let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for volume in volumes {
        if let Particles::Surfels { positions, .. } = &volume.particles {
            for p in positions {
                (lower, upper) = (lower.min(*p), upper.max(*p));
            }
        }
    }
    [(lower + upper) / 2.0, (upper - lower) / 2.0]
}

/// Returns numbers from 0 to 1, evenly spread in as many dimensions.
fn spread<const N: usize>(n: usize) -> [f64; N] {
    let root = [1.618_034, 1.324_718, 1.220_744, 1.167_304, 1.134_724][N - 1];
    std::array::from_fn(|k| (0.5 + (n + 1) as f64 * f64::powi(root, -(k as i32) - 1)).fract())
}

/// Returns spheres of a few sizes, some opaque, with normals away from the middle.
fn cloud() -> PointVolume {
    let count = 3_000;
    let position = |n: usize| DVec3::from(spread::<3>(n)) * 2.0 - 1.0;
    let sigma = |n: usize| 0.03 + 0.07 * spread::<5>(n)[3];
    let depth = |n: usize| 1.5 * spread::<5>(n)[4];
    let positions: Vec<DVec3> = (0..count).map(position).collect();
    let mass = |n: usize| (depth(n) * std::f64::consts::TAU * sigma(n) * sigma(n)) as f32;
    PointVolume {
        normals: Some(positions.iter().map(|p| normal_code(*p)).collect()),
        ..PointVolume::spheres(
            positions,
            (0..count).map(|n| sigma(n) as f32).collect::<Vec<f32>>(),
        )
        .with_masses((0..count).map(mass).collect::<Vec<f32>>())
    }
}

/// Returns faint smoke in a box, which is not lit.
fn smoke([middle, half]: &[DVec3; 2]) -> PointVolume {
    let count = 4_000;
    let sigma = 0.08 * half.max_element();
    let position = |n: usize| *middle + (DVec3::from(spread::<3>(n)) * 2.0 - 1.0) * 1.3 * *half;
    let positions: Vec<DVec3> = (0..count).map(position).collect();
    let depth = 0.05;
    let mass = (depth * std::f64::consts::TAU * sigma * sigma) as f32;
    let normals = positions
        .iter()
        .map(|p| normal_code(*p - *middle))
        .collect();
    let particles = Particles::Isotropic {
        positions,
        sigmas: vec![sigma as f32; count],
    };
    PointVolume {
        normals: Some(normals),
        ..PointVolume::new(particles, Strength::Mass(vec![mass; count]))
    }
}
