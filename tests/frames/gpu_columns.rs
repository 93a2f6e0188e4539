//! Tests column densities on the GPU: against the CPU's, and the law of mass by itself.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use super::column_scenes::{classified, masses, mixed, orthographic, spheres};
use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::gpu::gpu;
use crate::common::scene::{Particle, camera, volume};
use ewa_splat::render::SimdLevel;
use ewa_splat::scene::{Colour, Lattice, LatticeSpacing, Particles, PointVolume, Values};
use ewa_splat::stages::gpu::{Gpu, RasterSpec, rasterise};
use ewa_splat::stages::record::ExactTerms;
use ewa_splat::stages::splat::{Accumulate, Axes, Filter, Interval};
use ewa_splat::stats::FrameCounts;
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{ColumnImage, ColumnSettings, Renderer, Settings};
use glam::{DMat3, DVec3};

/// Largest difference of the back ends, relative to the largest pixel. Each amplitude and its
/// footprint have four roundings. The sums have stated bounds of 4.8e-6 on the GPU and 4e-6 on the
/// CPU, and actual errors some ten times lower. The value is twice the largest seen. The promised
/// accuracy of mass is 1e-5.
const ALIKE: f64 = 2e-6;

fn settings() -> ColumnSettings {
    ColumnSettings {
        // The CPU uses no fused operations, as the device uses none.
        simd: SimdLevel::Baseline,
        ..ColumnSettings::default()
    }
}

type Drawn = (ColumnImage, FrameCounts, f64);

fn on_cpu(scene: &[PointVolume], camera: &Camera, settings: &ColumnSettings) -> Drawn {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    let image = renderer.column_density(camera, settings).unwrap().clone();
    (image, renderer.counts(), renderer.amplitudes().sum)
}

fn on_gpu(gpu: &Gpu, scene: &[PointVolume], camera: &Camera, settings: &ColumnSettings) -> Drawn {
    let mut renderer = Renderer::new(scene.to_vec()).unwrap();
    renderer = renderer.on(gpu.clone()).unwrap();
    let image = renderer.column_density(camera, settings).unwrap().clone();
    assert!(renderer.adapter().is_some() && renderer.fallback().is_none());
    (image, renderer.counts(), renderer.amplitudes().sum)
}

/// Draws on both back ends and compares the columns. Returns the GPU's and the sum of the
/// amplitudes.
fn assert_alike(
    name: &str,
    gpu: &Gpu,
    scene: &[PointVolume],
    camera: &Camera,
    settings: &ColumnSettings,
) -> (ColumnImage, f64) {
    let (a, c, _) = on_cpu(scene, camera, settings);
    let (b, d, sum) = on_gpu(gpu, scene, camera, settings);
    let largest = a.values.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let pairs = a.values.iter().zip(&b.values);
    let worst = pairs.fold(0.0_f64, |m, (a, b)| m.max(f64::from((a - b).abs())));
    println!(
        "{name}: {:.1e} of {largest:e}; {c:?} {d:?}",
        worst / f64::from(largest)
    );
    assert!(largest > 0.0, "{name}");
    // Beside the eye, a graphics card's fused operations round minors of needles otherwise.
    let is_near = c.footprints_near > 0 && !gpu.is_software();
    let alike = if is_near { 1e-4 } else { ALIKE };
    assert!(
        worst <= alike * f64::from(largest),
        "{name}: {worst:e} of {largest:e}"
    );
    assert_eq!(
        (a.width, a.height, a.pixel_area),
        (b.width, b.height, b.pixel_area)
    );
    assert_eq!(c.blocks, d.blocks, "{name}");
    assert_eq!(c.blocks_culled, d.blocks_culled, "{name}");
    // Both sides compute amplitudes in f64.
    assert_eq!(c.classified, d.classified, "{name}");
    assert!(
        c.footprints.abs_diff(d.footprints) <= 2 + c.footprints / 1000,
        "{name}"
    );
    (b, sum)
}

#[test]
fn mass_is_conserved_for_spheres_of_every_size() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(1);
    // The largest is wider than half the image; all of it stays inside.
    for (sigma, count, half, size) in [
        (1e-3, 3_000, 50.0, 128),
        (0.3, 3_000, 50.0, 128),
        (1.0, 3_000, 50.0, 128),
        (5.0, 1_000, 25.0, 128),
        (40.0, 20, 20.0, 512),
    ] {
        let positions: Vec<DVec3> = (0..count).map(|_| random.point(half)).collect();
        let weights: Vec<f32> = (0..count).map(|_| random.range(0.5, 2.0) as f32).collect();
        let scene = [masses(spheres(positions, vec![sigma; count]), weights)];
        let name = format!("{sigma} px");
        let (image, total) = assert_alike(&name, gpu, &scene, &orthographic(size), &settings());
        let error = image.sum_times_area().unwrap() / total - 1.0;
        println!("{name}: mass off by {error:.1e}");
        // The promised bound. The cut-off omits 2.7e-7, the exponential errs by 4e-7, an amplitude
        // by four roundings.
        assert!(error.abs() < 1e-5, "{name}: {error:e}");
        // The actual error is smaller; a drift would show here first.
        assert!(error.abs() < 1.5e-6, "{name}: {error:e}");
    }
}

#[test]
fn many_alike_in_one_pixel_are_not_lost() {
    let Some(gpu) = gpu() else { return };
    // A single f32 sum of so many equal numbers is off by 1.3e-3.
    let count = 150_000;
    let particles = spheres(vec![DVec3::new(0.2, 0.1, 0.0); count], vec![0.7; count]);
    let scene = [masses(particles, vec![0.1; count])];
    let (image, total) = assert_alike("alike", gpu, &scene, &orthographic(16), &settings());
    let error = image.sum_times_area().unwrap() / total - 1.0;
    println!("mass off by {error:.1e}");
    // The promised bound; the sums' own bound is half of it.
    assert!(error.abs() < 1e-5, "{error:e}");
}

/// Returns a lattice of signed values of a type, stretched and sheared.
fn lattice(values: Values, is_rectilinear: bool) -> PointVolume {
    let spacing = if is_rectilinear {
        let axis = |scale: f64| {
            (0..11)
                .map(|i| scale * (f64::from(i) - 5.0).powi(3))
                .collect()
        };
        LatticeSpacing::Rectilinear {
            coordinates: [axis(0.3), axis(0.2), axis(0.1)],
        }
    } else {
        LatticeSpacing::Uniform {
            origin: DVec3::splat(-20.0),
            step: DMat3::from_cols(
                DVec3::new(4.0, 0.5, 0.0),
                DVec3::new(0.0, 3.5, 1.0),
                DVec3::new(0.0, 0.0, 5.0),
            ),
        }
    };
    let particles = Particles::Lattice {
        lattice: Lattice {
            dims: [11; 3],
            spacing,
        },
        kernel_width: 0.6,
    };
    classified(particles, Vec::new(), values)
}

#[test]
fn values_of_every_type_and_either_sign_add() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(2);
    let count = 11 * 11 * 11;
    let cases = [
        (
            "u8",
            Values::U8((0..count).map(|_| random.index(256) as u8).collect()),
        ),
        (
            "u16",
            Values::U16((0..count).map(|_| random.index(65_536) as u16).collect()),
        ),
        (
            "i16",
            Values::I16(
                (0..count)
                    .map(|_| (random.index(65_536) as i32 - 20_000) as i16)
                    .collect(),
            ),
        ),
        (
            "f32",
            Values::F32((0..count).map(|_| random.range(-0.2, 1.0) as f32).collect()),
        ),
    ];
    for (name, values) in cases {
        for is_rectilinear in [false, true] {
            let scene = [lattice(values.clone(), is_rectilinear)];
            let (image, total) = assert_alike(name, gpu, &scene, &orthographic(128), &settings());
            if !is_rectilinear {
                let sum = image.sum_times_area().unwrap();
                // The values' signs cancel a part of the sum, not of the errors.
                assert!(
                    (sum / total - 1.0).abs() < 4e-6,
                    "{name}: {sum:e} {total:e}"
                );
            }
        }
    }
    // Positive here, negative there, and zero where a value is not finite.
    let values = Values::F32(vec![1.0, -2.0, 0.0, f32::NAN, f32::INFINITY, 0.5]);
    let positions = (0..6)
        .map(|i| DVec3::X * (20.0 * f64::from(i) - 50.0))
        .collect();
    let scene = [classified(
        spheres(positions, vec![2.0; 6]),
        vec![3.0; 6],
        values,
    )];
    let (image, _) = assert_alike("signs", gpu, &scene, &orthographic(128), &settings());
    let at = |x: usize| image.values[64 * 128 + x];
    assert!(at(14) > 0.0 && at(34) < 0.0 && at(114) > 0.0);
    assert!([54, 74, 94].iter().all(|x| at(*x).to_bits() == 0));
}

#[test]
fn perspective_kernels_near_the_eye_and_every_filter_agree() {
    let Some(gpu) = gpu() else { return };
    let (scene, perspective) = mixed(1_000, 100);
    for filter in [
        Filter::Adaptive,
        Filter::Exact,
        Filter::Ewa,
        Filter::UniformScaling,
    ] {
        let settings = ColumnSettings {
            filter,
            ..settings()
        };
        assert_alike(filter.name(), gpu, &scene, &perspective, &settings);
    }
    // Parallel rays, with the eye among the kernels: kernels behind it do not count.
    let parallel = camera(Projection::Orthographic, [40.0; 2], [150, 100]);
    assert_alike("half line", gpu, &scene, &parallel, &settings());
    assert!(on_cpu(&scene, &parallel, &settings()).1.footprints_near > 5);
}

#[test]
fn amplitudes_beyond_single_precision_give_columns_within_it() {
    let Some(gpu) = gpu() else { return };
    // 1e43 in value x volume, over lengths of 1e21.
    let mut random = Random::new(7);
    let positions = (0..500).map(|_| random.point(50.0) * 2e21).collect();
    let particles = spheres(positions, vec![6e21; 500]);
    let scene = [classified(
        particles,
        vec![1e33; 500],
        Values::F32(vec![1e10; 500]),
    )];
    let camera = Camera {
        eye: DVec3::Z * -2e26,
        focal_px: glam::DVec2::splat(1.0 / 2e21),
        ..orthographic(128)
    };
    let (image, total) = assert_alike("1e43", gpu, &scene, &camera, &settings());
    assert!((image.sum_times_area().unwrap() / total - 1.0).abs() < 2e-6);
}

#[test]
fn cut_in_parts_chunks_and_bands_it_is_the_same_to_the_bit() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = mixed(1_000, 100);
    let (whole, counts, _) = on_gpu(gpu, &scene, &camera, &settings());
    for bytes in [181_000, 60_000] {
        let limited = gpu.clone().with_binding_limit(bytes);
        let (cut, of_cut, _) = on_gpu(&limited, &scene, &camera, &settings());
        assert_eq!(whole, cut, "{bytes}");
        assert_eq!(counts, of_cut, "{bytes}");
    }
}

#[test]
fn pictures_and_columns_take_turns() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = mixed(1_000, 100);
    let mut renderer = Renderer::new(scene.clone())
        .unwrap()
        .on(gpu.clone())
        .unwrap();
    let picture = renderer
        .render(&camera, &Settings::default())
        .unwrap()
        .clone();
    let column = renderer
        .column_density(&camera, &settings())
        .unwrap()
        .clone();
    assert_eq!(
        renderer.render(&camera, &Settings::default()).unwrap(),
        &picture
    );
    assert_eq!(
        renderer.column_density(&camera, &settings()).unwrap(),
        &column
    );
    assert_eq!(on_gpu(gpu, &scene, &camera, &settings()).0, column);
}

#[test]
fn colours_that_depend_on_the_view_do_not_matter() {
    let Some(gpu) = gpu() else { return };
    let positions = vec![DVec3::ZERO, DVec3::X * 12.0];
    let plain = masses(spheres(positions, vec![2.0; 2]), vec![1.0, 3.0]);
    let mut coloured = plain.clone();
    coloured.colour = Colour::Harmonics {
        degree: 1,
        coefficients: vec![-0.7; 24],
        is_linear: false,
    };
    let camera = orthographic(64);
    let (expected, _, _) = on_gpu(gpu, &[plain], &camera, &settings());
    assert_eq!(on_gpu(gpu, &[coloured], &camera, &settings()).0, expected);
}

#[test]
fn clipped_frames_are_alike_and_their_parts_make_the_whole() {
    let Some(gpu) = gpu() else { return };
    let (scene, perspective) = mixed(1_000, 100);
    let ahead = DVec3::new(0.3, -0.2, 2.5);
    let plane = ClipPlane {
        normal: DVec3::new(0.6, 0.0, 0.8),
        distance: -ahead.dot(DVec3::new(0.6, 0.0, 0.8)),
    };
    let back = ClipPlane {
        normal: -plane.normal,
        distance: -plane.distance,
    };
    let beside = orthographic(64);
    let mut random = Random::new(9);
    let positions: Vec<DVec3> = (0..400).map(|_| random.point(20.0)).collect();
    let balls = [masses(spheres(positions, vec![2.0; 400]), vec![1.0; 400])];
    for (name, scene, camera) in [
        ("perspective", &scene[..], &perspective),
        ("orthographic", &balls, &beside),
    ] {
        let with = |clip: Vec<ClipPlane>| ColumnSettings { clip, ..settings() };
        let (whole, _) = assert_alike(name, gpu, scene, camera, &with(Vec::new()));
        let (front, _) = assert_alike(name, gpu, scene, camera, &with(vec![plane]));
        let (behind, _) = assert_alike(name, gpu, scene, camera, &with(vec![back]));
        let largest = whole.values.iter().copied().fold(0.0, f32::max);
        for ((front, behind), whole) in front.values.iter().zip(&behind.values).zip(&whole.values) {
            let miss = (front + behind - whole).abs();
            assert!(
                miss <= 1e-5 * largest,
                "{name}: {front} + {behind}, {whole}"
            );
        }
        // Neither part is everything.
        let sum = |values: &[f32]| values.iter().copied().map(f64::from).sum::<f64>();
        let share = sum(&front.values) / sum(&whole.values);
        assert!((0.1..0.9).contains(&share), "{name}: {share}");
    }
}

#[test]
fn planes_keep_their_share_of_each_kernel() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(8);
    // White makes the first word of footprints 1, the sign of a positive amplitude.
    let particles: Vec<Particle> = (0..300)
        .map(|_| Particle {
            position: random.point(8.0) + DVec3::Z * 40.0,
            factor: DMat3::from_diagonal(DVec3::splat(random.log_range(0.5, 3.0))),
            mass: random.range(0.5, 2.0) as f32,
            colour: [1.0; 3],
        })
        .collect();
    let camera = camera(Projection::Orthographic, [1.5; 2], [40, 36]);
    let of_frame = Settings {
        filter: Filter::Ewa,
        cutoff: Some(5.5),
        ..Settings::default()
    };
    let mut frame = Frame::new(volume(&particles), &camera, &of_frame);
    assert!(frame.near.is_empty());
    // The kept part lies between two depths: of spheres, whose depth does not change over the
    // image.
    let kept = [37.0, 44.0];
    frame.uniform.clip_count = 2;
    frame.uniform.clip_planes[0] = [0.0, 0.0, 1.0, -kept[0]];
    frame.uniform.clip_planes[1] = [0.0, 0.0, -1.0, kept[1]];
    let sigma_of = |depth: f32| {
        let nearest = |p: &&Particle| (p.position.z - f64::from(depth)).abs();
        let order = |a: &&Particle, b: &&Particle| nearest(a).total_cmp(&nearest(b));
        particles.iter().min_by(order).unwrap().factor.x_axis.x as f32
    };
    frame.exact = frame
        .footprints
        .iter()
        .map(|footprint| ExactTerms {
            depth_sigma: sigma_of(footprint.depth),
            ..ExactTerms::default()
        })
        .collect();
    let bins = frame.bins();
    let lists: Vec<Vec<u32>> = (0..frame.tiles[0] * frame.tiles[1])
        .map(|t| bins.tile(t).collect())
        .collect();
    let draw = |chunks| {
        let spec = RasterSpec {
            axes: Axes {
                interval: Interval::Planes,
                accumulate: Accumulate::Column,
                ..Axes::default()
            },
            ..RasterSpec::default()
        };
        let (uniform, footprints, exact) = (&frame.uniform, &frame.footprints, &frame.exact);
        let drawn = rasterise(
            gpu,
            uniform,
            spec,
            footprints,
            exact,
            &[],
            &lists,
            chunks,
            None,
            None,
        );
        drawn.unwrap().0
    };
    let sums = draw(1);
    assert_eq!(sums.pixels, draw(3).pixels);
    let cdf = |x: f64| 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for (i, sums) in sums.pixels.iter().enumerate() {
        let pixel = glam::DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
        let mut truth = 0.0;
        for p in &particles {
            let sigma = p.factor.x_axis.x;
            // In pixels, with the filter added.
            let variance = (1.5 * sigma).powi(2) + 1.0;
            let d = pixel - (p.position.truncate() * 1.5 + camera.centre_px);
            let whole = f64::from(p.mass) * 1.5 * 1.5 / (std::f64::consts::TAU * variance)
                * (-0.5 * d.length_squared() / variance).exp();
            let [near, far] = kept.map(|z| cdf((f64::from(z) - p.position.z) / sigma));
            truth += whole * (far - near);
        }
        let sum: f64 = sums.iter().map(|&sum| f64::from(sum)).sum();
        worst = worst.max((sum - truth).abs());
        largest = largest.max(truth);
    }
    println!("off by {:.1e} of {largest:e}", worst / largest);
    // Centres in pixels, depths and their fractions are rounded to f32: a few units of 6e-8 each,
    // at slopes of up to one over a standard deviation of .5. The promised accuracy of mass is
    // 1e-5.
    assert!(worst <= 5e-6 * largest, "{worst:e} of {largest:e}");
}
