//! The promise of the tolerance, kept by the picture as a whole: with everything approximated that
//! the default settings approximate, against the same scene with nothing approximated.
//!
//! `cargo test --test promise -- --nocapture` prints a table, one picture a line: the difference
//! that 99.9 % of a picture's channels stay below and the largest, in tolerances, and the
//! footprints of both pictures.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

mod common;

use std::path::{Path, PathBuf};

use common::scene::{Particle, overlapping, volume};
use common::{Random, real_data};
use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::sample::{SampleOptions, TransferChoice, volume as sample};
use ewa_splat::scene::{
    Colour, Lattice, Particles, PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::splat::Filter;
use ewa_splat::splat::budget::WORST_PIXEL;
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DVec2, DVec3};

const TOLERANCES: [(&str, f32); 4] = [
    ("1/16", 1.0 / 16.0),
    ("1/64", 1.0 / 64.0),
    ("1/255", 1.0 / 255.0),
    ("1/1000", 1e-3),
];

/// One tolerance in place of four for what takes seconds: the default.
const DEFAULT_ONLY: [(&str, f32); 1] = [TOLERANCES[2]];

/// Width and height of a fitted picture in pixels.
const SIZE: usize = 192;

/// The field of view of a fitted camera, as on the command line.
const LENS: Lens = Lens::FovDeg(35.0);

/// Nothing left out: the true line integral of every particle, to 7 standard deviations (exp(-49/2)
/// is 2e-11), no early end that could be seen at the finest tolerance.
fn exact() -> Settings {
    Settings {
        filter: Filter::Exact,
        tolerance: 1e-6,
        cutoff: Some(7.0),
        level_of_detail: false,
        ..Settings::default()
    }
}

fn at(tolerance: f32) -> Settings {
    Settings {
        tolerance,
        ..Settings::default()
    }
}

/// A camera, and what it is called.
struct View {
    name: &'static str,
    camera: Camera,
}

/// The eye brought nearer to `middle` by a factor, or further away: `middle` stays where it is in
/// the picture, and the lens what it is.
fn nearer(camera: &Camera, middle: DVec3, factor: f64) -> Camera {
    Camera {
        eye: middle + (camera.eye - middle) / factor,
        ..camera.clone()
    }
}

/// The picture cut to `size` pixels around `middle`. What is far away is given no empty
/// surroundings, which would take up the share of pixels that may be off by more.
fn cut(camera: &Camera, middle: DVec3, size: usize) -> Camera {
    let at = camera.project(middle).unwrap();
    Camera {
        centre_px: camera.centre_px + DVec2::splat(size as f64 / 2.0) - at,
        width: size,
        height: size,
        ..camera.clone()
    }
}

/// The fitted camera and the middle of what is visible; `None` where nothing is.
fn fitted(renderer: &Renderer, size: usize) -> Option<(Camera, DVec3)> {
    let boxes = renderer.visible_boxes();
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    let camera = viewpoint.camera(&boxes, LENS, [size; 2])?;
    let all = boxes
        .iter()
        .map(|&(middle, half)| [middle - half, middle + half]);
    let [low, high] = all.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
    Some((camera, (low + high) / 2.0))
}

/// Fitted; an eighth as large; among the data, a quarter of the distance away.
fn views(camera: Camera, middle: DVec3) -> [View; 3] {
    // A quarter more than an eighth of the picture: footprints reach beyond the data.
    let far = nearer(&camera, middle, 0.125);
    let far = cut(&far, middle, camera.width * 5 / 32);
    let near = nearer(&camera, middle, 4.0);
    [("fitted", camera), ("far", far), ("among", near)].map(|(name, camera)| View { name, camera })
}

/// The difference that 99.9 % of all channels of all pixels stay below, and the largest; NaN is
/// the largest of all.
fn differences(a: &Image, b: &Image) -> [f32; 2] {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let channels = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    let mut all: Vec<f32> = channels.map(|(a, b)| (a - b).abs()).collect();
    all.sort_unstable_by(f32::total_cmp);
    let rank = (all.len() * 999).div_ceil(1000);
    [all[rank - 1], all[all.len() - 1]]
}

/// What was measured, a line at once; [`Table::finish`] fails after all were.
#[derive(Default)]
struct Table {
    pictures: usize,
    broken: Vec<String>,
}

impl Table {
    fn add(&mut self, what: &str, tolerance: (&str, f32), [a, b]: [&Image; 2], counts: [usize; 2]) {
        let [p999, max] = differences(a, b).map(|d| d / tolerance.1);
        let line = format!(
            "{what:<48} {:>6}  p99.9 {p999:>8.4}  max {max:>8.4}  footprints {:>8} of {:>8}",
            tolerance.0, counts[0], counts[1]
        );
        println!("{line}");
        self.pictures += 1;
        // Phrased so that NaN fails.
        if !(p999 < 1.0 && max < WORST_PIXEL) {
            self.broken.push(line);
        }
    }

    fn finish(self) {
        assert!(
            self.broken.is_empty(),
            "{} of {} pictures are off by more than they promise:\n{}",
            self.broken.len(),
            self.pictures,
            self.broken.join("\n")
        );
    }
}

/// Draws a scene at tolerances from several views, once exactly for each.
fn hold(
    table: &mut Table,
    name: &str,
    renderer: &mut Renderer,
    views: &[View],
    tolerances: &[(&str, f32)],
) {
    for View { name: view, camera } in views {
        let truth = renderer.render(camera, &exact()).unwrap().clone();
        let all = renderer.counts().footprints;
        for &tolerance in tolerances {
            let image = renderer.render(camera, &at(tolerance.1)).unwrap().clone();
            let counts = [renderer.counts().footprints, all];
            table.add(
                &format!("{name}, {view}"),
                tolerance,
                [&truth, &image],
                counts,
            );
        }
    }
}

/// A file, and how it is read.
struct File {
    path: PathBuf,
    raw: Option<[usize; 3]>,
    transfer: TransferChoice,
}

impl File {
    fn volume(&self) -> PointVolume {
        let options = OpenOptions {
            raw: self.raw.map(|dims| RawLayout::new(dims, RawType::U8)),
            ..OpenOptions::default()
        };
        let options_of_sample = SampleOptions {
            transfer: self.transfer.clone(),
            ..SampleOptions::default()
        };
        sample(open(&self.path, &options).unwrap(), &options_of_sample)
            .unwrap()
            .volume
    }

    fn name(&self) -> String {
        self.path
            .file_name()
            .unwrap()
            .to_string_lossy()
            .into_owned()
    }
}

/// Every fixture that is a volume.
fn fixture_files() -> Vec<File> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let file = |name: &str| File {
        path: folder.join(name),
        raw: None,
        transfer: if name == "wake.xyz" {
            TransferChoice::File(folder.join("wake_transfer.json"))
        } else {
            TransferChoice::Automatic
        },
    };
    [
        "wake.xyz",
        "particles.csv",
        "phantom.h5",
        "swift.h5",
        "gadget_old.h5",
        "gadget_old_packed.h5",
        "gadget_big_endian.h5",
        "dark_matter.h5",
    ]
    .map(file)
    .into()
}

/// The millions of voxels of which each picture takes a second.
const ENGINE: &str = "volumes/engine_256x256x128_uint8.raw";

/// Every real file that is a volume or splats, where present.
fn real_files() -> Vec<File> {
    [
        (ENGINE, Some([256, 256, 128])),
        ("volumes/nucleon_41x41x41_uint8.raw", Some([41; 3])),
        ("curvilinear/bluntfin/bluntfinxyz.bin", None),
        ("curvilinear/multicomb_0.vts", None),
        ("rectilinear/RectGrid2.vtk", None),
        ("unstructured/CylinderLinear.vtk", None),
        ("unstructured/can.vtu", None),
        ("unstructured/disk_out_ref.vtu", None),
        ("particles/phantom_mhd_00000.csv", None),
        ("particles/phantom_mhd_00000.h5", None),
        ("particles/halo_low_res.npy", None),
        ("particles/bunny_frame_14_7705_particles.vtk", None),
        ("splats/fruit_drops_minimal.ply", None),
        ("splats/test-splat.3-points-from-train.ply", None),
        ("splats/test-splat.3-points-from-train.splat", None),
        ("splats/test-splat.3-points-from-train.spz", None),
    ]
    .into_iter()
    .filter_map(|(name, raw)| {
        Some(File {
            path: real_data(name)?,
            raw,
            transfer: TransferChoice::Automatic,
        })
    })
    .collect()
}

/// All views of all files.
fn hold_files(files: &[File]) {
    let mut table = Table::default();
    for file in files {
        let mut renderer = Renderer::new(vec![file.volume()]).unwrap();
        let Some((camera, middle)) = fitted(&renderer, SIZE) else {
            panic!("nothing of {} is visible", file.name());
        };
        let tolerances = if file.path.ends_with(ENGINE) {
            &DEFAULT_ONLY[..]
        } else {
            &TOLERANCES[..]
        };
        let views = views(camera, middle);
        hold(&mut table, &file.name(), &mut renderer, &views, tolerances);
    }
    table.finish();
}

#[test]
fn fixtures_are_within_the_tolerance_of_exact_pictures() {
    hold_files(&fixture_files());
}

#[test]
fn real_data_are_within_the_tolerance_of_exact_pictures() {
    hold_files(&real_files());
}

/// The opaque checkerboard of Chen et al. 2004 (`examples/paper_2004/checkerboard.rs`), smaller: edges of
/// full contrast everywhere, a rim against nothing, and from afar tens of layers in a pixel. Not all
/// of it is within the promise: opaque kernels that overlap act as one of their depth together.
#[test]
fn an_opaque_checkerboard_is_within_few_tolerances_of_exact_pictures() {
    const VOXELS: usize = 128;
    let value = |i: usize| {
        if (i % VOXELS / 8 + i / VOXELS % VOXELS / 8).is_multiple_of(2) {
            0
        } else {
            255
        }
    };
    let transfer =
        TransferFunction::from_curves(|v| [v / 255.0; 3], |_| 0.99, [0.0, 255.0], 1.0).unwrap();
    let half = DVec3::new(0.5, 0.5, 0.0) * (VOXELS as f64 - 1.0);
    let slab = PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform([VOXELS, VOXELS, 3], -half, DVec3::ONE),
            kernel_width: 0.6,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8((0..VOXELS * VOXELS * 3).map(value).collect())),
        transfer_function: Some(transfer),
        normals: None,
    };
    let side = VOXELS as f64;
    let view = |name, distance: f64, height: f64, turn: f64| {
        let eye = DVec3::new(0.0, -(0.5 + distance) * side, height * side);
        let target = eye + DVec3::new(0.0, 1.0, -turn);
        let camera = Camera::perspective(eye, target, DVec3::Z, 45.0, [SIZE; 2]);
        View { name, camera }
    };
    let views = [
        (view("far", 2.0, 0.4, 0.16), 1.0),
        // The edge of an opaque kernel moves with an error of its depth, and many move alike.
        (view("near", 0.1, 0.25, 0.6), 2.0),
        // Along the slab a hundred kernels lie behind one another, and the pixels above its
        // horizon see a tail of each.
        (view("horizon", 0.02, 0.03, 0.1), 3.0),
    ];
    let mut renderer = Renderer::new(vec![slab]).unwrap();
    for (View { name, camera }, limit) in views {
        let truth = renderer.render(&camera, &exact()).unwrap().clone();
        for (_, tolerance) in TOLERANCES {
            let image = renderer.render(&camera, &at(tolerance)).unwrap();
            let [p999, max] = differences(&truth, image).map(|d| d / tolerance);
            println!("checkerboard, {name}, {tolerance}: p99.9 {p999:.2}, max {max:.2}");
            assert!(
                p999 < limit && max < WORST_PIXEL,
                "{name}, {tolerance}: {p999}, {max}"
            );
        }
    }
}

/// Hundreds of kernels that overlap, and their middle.
fn random_scene(random: &mut Random) -> (Renderer, Camera, DVec3) {
    let (particles, camera) = overlapping(random);
    let sum: DVec3 = particles.iter().map(|p| p.position).sum();
    let middle = sum / particles.len() as f64;
    (
        Renderer::new(vec![volume(&particles)]).unwrap(),
        camera,
        middle,
    )
}

#[test]
fn random_kernels_are_within_the_tolerance_of_exact_pictures() {
    let mut random = Random::new(21);
    let mut table = Table::default();
    for n in 0..8 {
        let (mut renderer, camera, middle) = random_scene(&mut random);
        let views = views(camera, middle);
        let name = format!("random kernels {n}");
        hold(&mut table, &name, &mut renderer, &views, &TOLERANCES);
    }
    table.finish();
}

/// `count` particles in clusters as gas has them: equal masses, smoothing lengths that follow the
/// density, colours by cluster. Where clusters of other colours lie in one another, what is in front
/// cannot be merged with what is behind: the colours are of one family.
fn clustered(count: usize) -> PointVolume {
    let mut random = Random::new(22);
    let clusters: Vec<(DVec3, f64, [f32; 3])> = (0..12)
        .map(|_| {
            let colour = [0, 1, 2].map(|_| random.range(0.5, 0.7) as f32);
            (random.point(0.7), random.log_range(0.05, 0.3), colour)
        })
        .collect();
    // Sums of three uniform numbers: bell-shaped, and nothing far outside.
    let bell = |random: &mut Random| random.point(1.0) + random.point(1.0) + random.point(1.0);
    let (mut positions, mut sigmas, mut colours) = (Vec::new(), Vec::new(), Vec::new());
    for n in 0..count {
        let (centre, width, colour) = clusters[n % clusters.len()];
        let position = centre + width * bell(&mut random);
        // Three uniform numbers of variance 1/3 make 1.
        let each = count as f64 / clusters.len() as f64;
        let density: f64 = clusters
            .iter()
            .map(|(c, w, _)| {
                let q = (position - *c).length_squared() / (w * w);
                each * (-0.5 * q).exp() / (std::f64::consts::TAU.sqrt() * w).powi(3)
            })
            .sum();
        // 1.2 mean distances; the bell's own tails are cut, those of the formula are not.
        let h = (1.2 / density.cbrt()).min(0.3);
        positions.push(position);
        sigmas.push((0.3_f64.sqrt() * h) as f32);
        colours.push(colour);
    }
    // A depth of .15 on average over the face of a cube of side 2, of 3 through the densest cluster.
    let masses = vec![(0.15 * 4.0 / count as f64) as f32; count];
    PointVolume {
        particles: Particles::Isotropic { positions, sigmas },
        strength: Strength::Mass(masses),
        colour: Colour::PerParticle(colours),
        values: None,
        transfer_function: None,
        normals: None,
    }
}

/// A lattice of `n`³ samples of waves, all of it visible, in colours that change with the value.
fn lattice(n: usize) -> PointVolume {
    let step = 2.0 / n as f64;
    let wave = |i: usize, waves: f64| (waves * std::f64::consts::TAU * i as f64 / n as f64).sin();
    let values = (0..n * n * n)
        .map(|c| wave(c % n, 3.0) + wave(c / n % n, 2.0) + wave(c / n / n, 1.0))
        .map(|v| (127.5 + 42.0 * v) as u8)
        .collect();
    let shade = |v: f32| v / 255.0;
    let transfer = TransferFunction::from_curves(
        |v| [0.4 + 0.2 * shade(v), 0.5, 0.6 - 0.2 * shade(v)],
        // A depth of .4 to .7 in all: ln(1 - opacity) per unit over two units.
        |v| 0.2 + 0.1 * shade(v),
        [0.0, 255.0],
        1.0,
    );
    PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform([n; 3], DVec3::splat(-1.0 + step / 2.0), DVec3::splat(step)),
            kernel_width: 0.6,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8(values)),
        transfer_function: Some(transfer.unwrap()),
        normals: None,
    }
}

/// From the fitted distance to where the data are 2 pixels wide, in 60 equal ratios: each picture
/// is within the tolerance of the exact one of all particles, so that neither the first merged
/// particle nor a change of level pops; and the fewer pixels, the fewer footprints.
fn hold_zoom(name: &str, volume: PointVolume) {
    const STEPS: i32 = 60;
    /// Width of the first picture, px.
    const START_PX: f64 = 96.0;
    const END_PX: f64 = 2.0;
    /// As wide as the footprints of the smallest data reach, px.
    const LEAST_SIZE: f64 = 12.0;
    // Of 200,000 kernels the rest beyond 5 standard deviations, 4e-6 of each, is not seen; half
    // the pixels are saved.
    let exact = Settings {
        cutoff: Some(5.0),
        ..exact()
    };
    let default = Settings::default();
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let (camera, middle) = fitted(&renderer, START_PX as usize).unwrap();
    let mut table = Table::default();
    let mut footprints: Vec<usize> = Vec::new();
    for step in 0..STEPS {
        let shrunk = (END_PX / START_PX).powf(f64::from(step) / f64::from(STEPS - 1));
        let far = nearer(&camera, middle, shrunk);
        // The picture shrinks with the data.
        let size = (1.25 * shrunk * START_PX).clamp(LEAST_SIZE, START_PX);
        let far = cut(&far, middle, size as usize);
        let image = renderer.render(&far, &default).unwrap().clone();
        let count = renderer.counts().footprints;
        // The exact pictures take most of the time, and levels last for many steps.
        if step % 2 == 0 {
            let truth = renderer.render(&far, &exact).unwrap().clone();
            let what = format!("{name}, {:.1} px", shrunk * START_PX);
            let images = [&truth, &image];
            table.add(
                &what,
                DEFAULT_ONLY[0],
                images,
                [count, renderer.counts().footprints],
            );
        }
        footprints.push(count);
    }
    table.finish();
    for (step, pair) in footprints.windows(2).enumerate() {
        // Blocks are merged or not each by itself, and what the tolerance leaves out comes back
        // when merged: a tenth.
        assert!(
            pair[1] as f64 <= 1.1 * pair[0] as f64,
            "{name}: {} footprints, then {} at step {step}",
            pair[0],
            pair[1]
        );
    }
    let last = footprints[footprints.len() - 1];
    assert!(
        last <= footprints[0] / 12,
        "{name}: {last} footprints for {END_PX} pixels"
    );
}

#[test]
fn zooming_out_of_particles_pops_by_less_than_the_tolerance() {
    hold_zoom("particles", clustered(60_000));
}

#[test]
fn zooming_out_of_a_lattice_pops_by_less_than_the_tolerance() {
    hold_zoom("lattice", lattice(64));
}

/// The GPU's pictures, held to the CPU's exact ones: all data, small, at the default tolerance.
#[cfg(feature = "gpu")]
#[test]
fn pictures_of_the_gpu_are_within_the_tolerance_of_exact_ones() {
    /// A software adapter draws these.
    const GPU_SIZE: usize = 64;
    let Some(gpu) = common::gpu::gpu() else {
        return;
    };
    let mut table = Table::default();
    let mut compare =
        |name: &str, mut renderer: Renderer, views: &[View], tolerances: &[(&str, f32)]| {
            let drawn: Vec<(Image, usize)> = views
                .iter()
                .map(|v| {
                    let image = renderer.render(&v.camera, &exact()).unwrap().clone();
                    (image, renderer.counts().footprints)
                })
                .collect();
            let mut renderer = renderer.on(gpu.clone()).unwrap();
            for (View { name: view, camera }, (truth, all)) in views.iter().zip(&drawn) {
                for &tolerance in tolerances {
                    let image = renderer.render(camera, &at(tolerance.1)).unwrap().clone();
                    let counts = [renderer.counts().footprints, *all];
                    let name = format!("GPU: {name}, {view}");
                    table.add(&name, tolerance, [truth, &image], counts);
                }
            }
        };
    for file in fixture_files().iter().chain(&real_files()) {
        let renderer = Renderer::new(vec![file.volume()]).unwrap();
        let (camera, middle) = fitted(&renderer, GPU_SIZE).unwrap();
        let views = views(camera, middle);
        // A software adapter takes half a minute for a million and a half voxels: of the engine the
        // view that merges most.
        let views = if file.path.ends_with(ENGINE) {
            &views[1..2]
        } else {
            &views[..]
        };
        compare(&file.name(), renderer, views, &DEFAULT_ONLY);
    }
    let mut random = Random::new(23);
    for n in 0..3 {
        let (renderer, camera, middle) = random_scene(&mut random);
        let views = views(camera, middle);
        let name = format!("random kernels {n}");
        compare(&name, renderer, &views, &[TOLERANCES[0], TOLERANCES[2]]);
    }
    table.finish();
}

#[test]
fn views_are_what_they_are_called() {
    // Towards the eye and low: the fitted picture's centre is not the data's middle.
    let corners = [
        DVec3::new(-1.0, 0.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.5, -1.0, -1.0),
    ];
    let spheres = corners.map(|c| Particle::sphere(c, 1e-3, 1e-3));
    let mut renderer = Renderer::new(vec![volume(&spheres)]).unwrap();
    let (camera, middle) = fitted(&renderer, SIZE).unwrap();
    let apart = camera.project(middle).unwrap() - DVec2::splat(SIZE as f64 / 2.0);
    assert!(apart.length() > 5.0, "{apart}");
    let [_, far, near] = views(camera.clone(), middle);
    let width = |c: &Camera| {
        let [a, b] = [0, 1].map(|i| c.project(corners[i]).unwrap());
        (a - b).length()
    };
    // But for the perspective's share.
    let share = width(&far.camera) / width(&camera);
    assert!((share - 0.125).abs() < 0.01, "{share}");
    let distance = |c: &Camera| (c.eye - middle).length();
    assert!((distance(&near.camera) * 4.0 - distance(&camera)).abs() < 1e-9);
    // What is drawn lies in the smaller picture, footprints and all.
    renderer.render(&far.camera, &exact()).unwrap();
    assert_eq!(renderer.counts().footprints, corners.len());
    let image = renderer.image();
    let edge = |i: &usize| [0, image.width - 1].contains(&(i % image.width));
    let seen = |i: usize| image.pixels[i][3];
    let most = (0..image.pixels.len()).map(seen).fold(0.0, f32::max);
    let outside = (0..image.pixels.len())
        .filter(edge)
        .map(seen)
        .fold(0.0, f32::max);
    assert!(most > 0.0 && outside < 0.05 * most, "{outside} {most}");
}
