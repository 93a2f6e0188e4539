//! Compares the back ends on kernels classified over their own extents.

use ewa_splat::render::Classification;
use ewa_splat::scene::{
    Boundary, Lattice, LatticeSpacing, LocalModel, LocalModels, PointVolume, TransferFunction,
    Values,
};
use ewa_splat::stages::blocks::BlockedVolume;
use ewa_splat::stages::record::ClassifiedBy;
use ewa_splat::{Backend, Renderer};
use glam::{DMat3, DVec3};

use crate::common::Random;
use crate::common::gpu::{gpu, pictures};
use crate::common::some;
use crate::extent::{camera, field, lattice, pieces, settings, shells, steps};

/// Returns volumes of every kind that has pieces.
fn volumes() -> Vec<(&'static str, PointVolume)> {
    let transfer = shells();
    let uniform = lattice(24, &transfer);
    let bytes = PointVolume {
        values: Some(Values::U8(
            (0..24_usize.pow(3))
                .map(|i| (uniform.values.as_ref().unwrap().get(i) * 200.0) as u8)
                .collect(),
        )),
        transfer_function: Some(
            TransferFunction::from_curves(
                |v| [v / 255.0, 0.5, 1.0 - v / 255.0],
                |v| if (50.0..70.0).contains(&v) { 0.8 } else { 0.0 },
                [0.0, 255.0],
                0.1,
            )
            .unwrap(),
        ),
        ..uniform.clone()
    };
    // An uneven grid with holes.
    let axis: Vec<f64> = (0..19)
        .map(|i| 2.0 * (f64::from(i) / 18.0).powf(1.4) - 1.0)
        .collect();
    let values = |i: usize| {
        let at = [i % 19, i / 19 % 19, i / 361].map(|n| axis[n]);
        let value = field(DVec3::from(at)) as f32;
        if i % 97 == 5 { f32::NAN } else { value }
    };
    let rectilinear = PointVolume::lattice(
        Lattice {
            dims: [19; 3],
            spacing: LatticeSpacing::Rectilinear {
                coordinates: [axis.clone(), axis.clone(), axis.clone()],
            },
        },
        (0..19_usize.pow(3)).map(values).collect::<Vec<f32>>(),
        transfer.clone(),
    );
    let sheared = PointVolume::lattice(
        Lattice {
            dims: [17, 11, 9],
            spacing: LatticeSpacing::Uniform {
                origin: DVec3::splat(-0.8),
                step: DMat3::from_cols(
                    DVec3::new(0.1, 0.02, 0.0),
                    DVec3::new(0.0, 0.15, -0.04),
                    DVec3::new(0.03, 0.0, 0.2),
                ),
            },
        },
        (0..17 * 11 * 9)
            .map(|i| ((i % 17) as f32 * 0.03 + (i / 17 % 11) as f32 * 0.02).fract())
            .collect::<Vec<f32>>(),
        transfer.clone(),
    );
    let mut random = Random::new(5);
    let positions: Vec<DVec3> = (0..4_000)
        .map(|_| DVec3::from_array([0; 3].map(|_| random.range(-0.9, 0.9))))
        .collect();
    let values: Vec<f32> = positions.iter().map(|p| field(*p) as f32).collect();
    let models = |scale: f32| -> Vec<LocalModel> {
        let gradient = |p: &DVec3| {
            let slope = |axis: DVec3| (field(*p + axis * 1e-4) - field(*p - axis * 1e-4)) / 2e-4;
            DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))
        };
        let of = |p: &DVec3| LocalModel {
            slope: gradient(p).as_vec3() * scale,
            departure: 0.01 * p.x as f32,
            below: 0.2,
            above: 0.15,
        };
        positions.iter().map(of).collect()
    };
    let spheres = PointVolume {
        local_models: Some(LocalModels::new(&models(0.08))),
        ..PointVolume::spheres(positions.clone(), vec![0.08; 4_000])
            .with_values(values.clone(), transfer.clone())
    };
    let variances = vec![[0.006, 0.001, 0.0, 0.004, -0.001, 0.008]; 4_000];
    let ellipsoids = PointVolume {
        local_models: Some(LocalModels::new(&models(0.07))),
        ..PointVolume::ellipsoids(positions, &variances)
            .unwrap()
            .with_values(values, transfer)
    };
    let bounded = PointVolume {
        boundary: Some(Boundary::Lattice),
        ..uniform.clone()
    };
    vec![
        ("lattice", uniform),
        ("steps", lattice(24, &steps())),
        ("lattice with a sharp boundary", bounded),
        ("bytes", bytes),
        ("rectilinear", rectilinear),
        ("sheared", sheared),
        ("spheres", spheres),
        ("ellipsoids", ellipsoids),
    ]
}

/// Both back ends draw the same picture, within the usual 2e-5, and classify the same pieces, also
/// for volumes in parts.
#[test]
fn both_back_ends_classify_alike() {
    let Some(gpu) = gpu() else { return };
    for (name, volume) in volumes() {
        let blocked = BlockedVolume::new(volume.clone());
        assert!(blocked.lobes.is_some(), "{name}");
        let (views, particles, terms) = pieces(&blocked);
        assert!(terms.iter().any(|t| t.width < 0.5), "{name}");
        for part_bytes in some([u64::MAX, 1 << 16], 1, 2) {
            let mut seen = views.clone();
            let capacity = 16 * blocked.particle_count() as u32;
            let found = ewa_splat::stages::gpu::classify(
                gpu,
                &blocked,
                &mut seen,
                capacity,
                part_bytes,
                ClassifiedBy::Extent,
            )
            .unwrap();
            let flips = particles.len().abs_diff(found.particles.len());
            // A piece at the edge of its reach, or with nearly no mass, may be present or absent.
            assert!(
                flips <= 2,
                "{name}: {} {}",
                particles.len(),
                found.particles.len()
            );
            if flips > 0 {
                continue;
            }
            for (i, (a, b)) in found.particles.iter().zip(&particles).enumerate() {
                let (s, t) = (found.terms[i], terms[i]);
                assert_eq!((a.view, a.local), (b.view, b.local), "{name} {i}");
                // Logarithms and powers of two on the device err by 3e-6 of a look-up.
                let near = |x: f32, y: f32, scale: f32| (x - y).abs() <= 1e-5 * scale;
                let is_near = near(a.mass, b.mass, 2.0 * b.mass)
                    && near(s.shift, t.shift, 4.0)
                    && near(s.width, t.width, 1.0)
                    && (0..3).all(|c| near(s.axis[c], t.axis[c], 1.0))
                    && (0..3).all(|c| near(a.carried.colour()[c], b.carried.colour()[c], 1.0));
                assert!(is_near, "{name} {i}: {a:?} {b:?} {s:?} {t:?}");
            }
        }
        // Whole pictures of a software adapter: of one volume, unless all are asked for.
        if name != "lattice with a sharp boundary" && pictures().is_none() {
            continue;
        }
        let camera = camera(96);
        let settings = settings(Classification::Extent);
        let mut on_cpu = Renderer::new(vec![volume.clone()]).unwrap();
        let image = on_cpu.render(&camera, &settings).unwrap();
        let mut on_device = Renderer::with_options(vec![volume], Backend::Gpu).unwrap();
        let twin = on_device.render(&camera, &settings).unwrap();
        let difference = crate::common::scene::difference(image, twin);
        println!(
            "{name}: {} pieces, pictures differ by {difference:e}",
            particles.len()
        );
        // Pieces of one kernel may have depths within rounding, which a graphics card orders otherwise.
        let bound = if gpu.is_software() { 2e-5 } else { 1e-4 };
        assert!(difference <= bound, "{name}: {difference}");
    }
}
