//! Tests the promise of the tolerance for whole pictures: with all approximations of the default
//! settings, against the same scene without any.
//!
//! `cargo test --test promise -- --nocapture` prints a table, one picture a line: the difference
//! that 99.9 % of a picture's channels stay below and the largest, in tolerances, and the
//! footprints of both pictures.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::path::{Path, PathBuf};

use crate::boundary::{ring, uniform_options};
use crate::common::scene::{Particle, overlapping, volume};
use crate::common::{Random, real_data, some};
use ewa_splat::Filter;
use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, SampleOptions, TransferChoice, grid,
    volume as sample,
};
use ewa_splat::scene::{
    AutomaticOptions, Boundary, Colour, Lattice, Particles, PointVolume, Strength,
    TransferFunction, ValueSample, Values,
};
use ewa_splat::stages::splat::budget::WORST_PIXEL;
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Image, Renderer, Settings};
use glam::{DVec2, DVec3};

const TOLERANCES: [(&str, f32); 4] = [
    ("1/16", 1.0 / 16.0),
    ("1/64", 1.0 / 64.0),
    ("1/255", 1.0 / 255.0),
    ("1/1000", 1e-3),
];

/// The default tolerance, in place of four, for slow scenes.
const DEFAULT_ONLY: [(&str, f32); 1] = [TOLERANCES[2]];

/// Width and height of a fitted picture in pixels.
const SIZE: usize = 192;

/// Field of view of a fitted camera, as on the command line.
const LENS: Lens = Lens::FovDeg(35.0);

/// Returns settings that omit nothing: the true line integral of every particle, to 7 standard
/// deviations (exp(-49/2) is 2e-11), and no early termination that would be visible at the finest
/// tolerance.
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

/// Camera, with its name.
struct View {
    name: &'static str,
    camera: Camera,
}

/// Moves the eye towards `middle` by a factor, or away. The position of `middle` in the picture and
/// the lens do not change.
fn nearer(camera: &Camera, middle: DVec3, factor: f64) -> Camera {
    Camera {
        eye: middle + (camera.eye - middle) / factor,
        ..camera.clone()
    }
}

/// Crops the picture to `size` pixels around `middle`. This excludes empty surroundings of distant
/// data, which would use up the fraction of pixels that may be off by more.
fn cut(camera: &Camera, middle: DVec3, size: usize) -> Camera {
    let at = camera.project(middle).unwrap();
    Camera {
        centre_px: camera.centre_px + DVec2::splat(size as f64 / 2.0) - at,
        width: size,
        height: size,
        ..camera.clone()
    }
}

/// Returns the fitted camera and the centre of what is visible; `None` if nothing is.
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

/// Returns three views: fitted, an eighth as large, and inside the data at a quarter of the
/// distance.
fn views(camera: Camera, middle: DVec3) -> [View; 3] {
    // A quarter more than an eighth of the picture: footprints extend beyond the data.
    let far = nearer(&camera, middle, 0.125);
    let far = cut(&far, middle, camera.width * 5 / 32);
    let near = nearer(&camera, middle, 4.0);
    [("fitted", camera), ("far", far), ("among", near)].map(|(name, camera)| View { name, camera })
}

/// Returns the difference that 99.9 % of all channels of all pixels stay below, and the largest;
/// NaN counts as the largest.
pub(crate) fn differences(a: &Image, b: &Image) -> [f32; 2] {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let channels = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    let mut all: Vec<f32> = channels.map(|(a, b)| (a - b).abs()).collect();
    all.sort_unstable_by(f32::total_cmp);
    let rank = (all.len() * 999).div_ceil(1000);
    [all[rank - 1], all[all.len() - 1]]
}

/// Measurements, one per line; [`Table::finish`] fails after all were made.
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
        // The comparison fails for NaN.
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

/// Draws a scene at several tolerances from several views, once exactly for each view.
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

/// File, and its reading options.
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
            function: FunctionOptions {
                transfer: self.transfer.clone(),
                ..FunctionOptions::default()
            },
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

/// Returns every fixture that is a volume.
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

/// File of millions of voxels, of which each picture takes a second.
const ENGINE: &str = "volumes/engine_256x256x128_uint8.raw";

/// Returns every real file that is a volume or splats, if present.
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

/// Checks all views of all files.
fn hold_files(files: &[File]) {
    let mut table = Table::default();
    for file in files {
        let mut renderer = Renderer::new(vec![file.volume()]).unwrap();
        let Some((camera, middle)) = fitted(&renderer, SIZE) else {
            panic!("nothing of {} is visible", file.name());
        };
        let tolerances = if file.path.ends_with(ENGINE) {
            DEFAULT_ONLY.into()
        } else {
            some(TOLERANCES, 0, 2)
        };
        let views = some(views(camera, middle), file.name().len(), 3);
        hold(&mut table, &file.name(), &mut renderer, &views, &tolerances);
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

/// Curvilinear grids from CFD are cut at their faces, fitted and nearer, from three sides.
#[test]
fn grids_cut_at_their_faces_are_within_the_tolerance_of_exact_pictures() {
    const CUT_SIZE: usize = 96;
    let mut table = Table::default();
    let files = real_files().into_iter();
    for file in files.filter(|file| file.path.to_string_lossy().contains("curvilinear")) {
        let options = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Sharp,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        let data = open(&file.path, &OpenOptions::default()).unwrap();
        let mut renderer = Renderer::new(vec![sample(data, &options).unwrap().volume]).unwrap();
        let boxes = renderer.visible_boxes();
        let mut all = Vec::new();
        for (name, azimuth) in [("at 40", 40.0), ("at 130", 130.0), ("at 220", 220.0)] {
            let viewpoint = Viewpoint {
                azimuth_deg: azimuth,
                elevation_deg: 25.0,
                zoom: 1.0,
                up: DVec3::Z,
            };
            let camera = viewpoint.camera(&boxes, LENS, [CUT_SIZE; 2]).unwrap();
            all.push(View { name, camera });
        }
        hold(
            &mut table,
            &file.name(),
            &mut renderer,
            &all,
            &TOLERANCES[2..],
        );
    }
    table.finish();
}

/// The opaque checkerboard of Chen et al. 2004 (`lab/examples/paper_2004/checkerboard.rs`),
/// smaller. It has edges of full contrast everywhere, a rim against nothing, and from afar tens of
/// layers in a pixel. Not all of it is within the promise: opaque kernels that overlap act as one
/// of their total depth.
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
    let slab = PointVolume::new(
        Particles::Lattice {
            lattice: Lattice::uniform([VOXELS, VOXELS, 3], -half, DVec3::ONE),
            kernel_width: 0.6,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(
        Values::U8((0..VOXELS * VOXELS * 3).map(value).collect()),
        transfer,
    );
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
        // Along the slab, a hundred kernels lie behind one another, and the pixels above its
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

/// Returns hundreds of kernels that overlap, and their centre.
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

/// Returns kernels at one position and around it: the cluster, then kernels that fill a cube of
/// side 2 evenly.
///
/// - `others`: number of the latter.
/// - `depth`: total depth of a cluster's kernels at their centre, seen as wide as they are.
fn crowd(
    others: usize,
    depth: f64,
    random: &mut Random,
    members: impl IntoIterator<Item = (DVec3, f64)>,
) -> PointVolume {
    let members: Vec<(DVec3, f64)> = members.into_iter().collect();
    let (mut positions, mut sigmas, mut masses) = (Vec::new(), Vec::new(), Vec::new());
    for &(position, sigma) in &members {
        positions.push(position);
        sigmas.push(sigma as f32);
        let own = depth / members.len() as f64;
        masses.push((own * std::f64::consts::TAU * sigma * sigma) as f32);
    }
    for _ in 0..others {
        positions.push(random.point(1.0));
        // Two thirds of their mean distance; a depth of 1 over the cube.
        sigmas.push((1.3 / (others as f64).cbrt()) as f32);
        masses.push((4.0 / others as f64) as f32);
    }
    let colour = |_| [0, 1, 2].map(|_| random.range(0.6, 0.9) as f32);
    PointVolume {
        colour: Colour::PerParticle((0..positions.len()).map(colour).collect()),
        ..PointVolume::new(
            Particles::Isotropic { positions, sigmas },
            Strength::Mass(masses),
        )
    }
}

/// Particles at the floor of their smoothing lengths, as where a snapshot resolves no more:
/// thousands at one position, whose edges coincide.
#[test]
fn crowds_are_within_the_tolerance_of_exact_pictures() {
    const SIGMA: f64 = 0.05;
    /// Picture size: kernels are large on it, and thousands overlap.
    const CROWD_SIZE: usize = 96;
    let mut random = Random::new(23);
    let centre = DVec3::new(0.2, -0.1, 0.3);
    let mut volumes: Vec<(String, PointVolume)> = Vec::new();
    // Each kernel is faint, and together they are as deep as a halo's centre.
    for (count, depth) in [(200, 60.0), (2_000, 30.0), (2_000, 400.0), (6_000, 2_000.0)] {
        for others in [50, 1_500] {
            let members = vec![(centre, SIGMA); count];
            let volume = crowd(others, depth, &mut random, members);
            volumes.push((format!("{count} in one place, {others} others"), volume));
        }
    }
    // The members are spread by a fraction of their width.
    for share in [0.1, 0.3, 0.5, 0.8] {
        let members: Vec<_> = (0..3_000)
            .map(|_| {
                let bell = random.point(1.0) + random.point(1.0) + random.point(1.0);
                (centre + share * SIGMA * bell, SIGMA)
            })
            .collect();
        let volume = crowd(500, 300.0, &mut random, members);
        volumes.push((format!("spread by {share}"), volume));
    }
    // Clusters lie behind one another.
    let members = (0..4_000).map(|n| {
        let at = 0.9 * (f64::from(n / 400) / 4.5 - 1.0);
        (DVec3::new(at, 0.4 * at, 0.7 * at), SIGMA)
    });
    let chain = crowd(500, 1_000.0, &mut random, members);
    volumes.push(("a chain of ten".into(), chain));
    // Along a curve and over a sheet, where more kernels meet in a pixel than lie at one position.
    let turns: Vec<f64> = (0..3_000).map(|_| random.log_range(1.0, 540.0)).collect();
    let on_ring = turns.iter().map(|turn| {
        let (sin, cos) = (turn.ln()).sin_cos();
        (DVec3::new(4.0 * SIGMA * cos, 4.0 * SIGMA * sin, 0.3), SIGMA)
    });
    let volume = crowd(50, 80.0, &mut random, on_ring);
    volumes.push(("on a ring".into(), volume));
    let on_sheet: Vec<_> = (0..4_000)
        .map(|_| {
            let at = 4.0 * SIGMA * random.point(1.0);
            (DVec3::new(at.x, at.y, 0.3), SIGMA)
        })
        .collect();
    let volume = crowd(50, 120.0, &mut random, on_sheet);
    volumes.push(("over a sheet".into(), volume));
    // Widths of all sizes, at one position and with one side in common.
    let widths: Vec<f64> = (0..2_000).map(|_| random.log_range(0.02, 0.2)).collect();
    let members = widths.iter().map(|&sigma| (centre, sigma));
    let volume = crowd(500, 400.0, &mut random, members);
    volumes.push(("of all widths".into(), volume));
    let members = widths
        .iter()
        .map(|&sigma| (centre + DVec3::Z * 3.9 * sigma, sigma));
    let volume = crowd(500, 400.0, &mut random, members);
    volumes.push(("on one side".into(), volume));
    let mut table = Table::default();
    for (name, volume) in some(volumes, 0, 2) {
        let is_chain = name.contains("chain");
        let mut renderer = Renderer::new(vec![volume]).unwrap();
        let (camera, middle) = fitted(&renderer, CROWD_SIZE).unwrap();
        let mut views = Vec::from(views(camera.clone(), middle));
        let near = nearer(&camera, centre, 3.0);
        views.push(View {
            name: "at the crowd",
            camera: near,
        });
        if is_chain {
            // The camera is so far away that the edges nearly meet.
            let eye = middle + 8.0 * DVec3::new(1.0, 0.4, 0.7);
            let camera = Camera::perspective(eye, middle, DVec3::Z, 8.0, [CROWD_SIZE; 2]);
            let name = "along it";
            views.push(View { name, camera });
        }
        hold(&mut table, &name, &mut renderer, &views, &DEFAULT_ONLY);
    }
    table.finish();
}

/// Returns `count` particles in clusters, as in gas: equal masses, smoothing lengths that follow
/// the density, colours by cluster. Colours are similar, because if clusters of different colours
/// interpenetrate, the front cannot be merged with the back.
fn clustered(count: usize) -> PointVolume {
    let mut random = Random::new(22);
    let clusters: Vec<(DVec3, f64, [f32; 3])> = (0..12)
        .map(|_| {
            let colour = [0, 1, 2].map(|_| random.range(0.5, 0.7) as f32);
            (random.point(0.7), random.log_range(0.05, 0.3), colour)
        })
        .collect();
    // Sums of three uniform numbers: bell-shaped, without outliers.
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
        // 1.2 mean distances; the sampled bell has no tails, unlike the formula.
        let h = (1.2 / density.cbrt()).min(0.3);
        positions.push(position);
        sigmas.push((0.3_f64.sqrt() * h) as f32);
        colours.push(colour);
    }
    // The average depth is .15 over the face of a cube of side 2, and 3 through the densest
    // cluster.
    let masses = vec![(0.15 * 4.0 / count as f64) as f32; count];
    PointVolume::new(
        Particles::Isotropic { positions, sigmas },
        Strength::Mass(masses),
    )
    .with_colours(colours)
}

/// Returns a lattice of `n`³ samples of waves, all visible, in colours that change with the value.
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
        // The total depth is .4 to .7: ln(1 - opacity) per unit over two units.
        |v| 0.2 + 0.1 * shade(v),
        [0.0, 255.0],
        1.0,
    );
    PointVolume::new(
        Particles::Lattice {
            lattice: Lattice::uniform([n; 3], DVec3::splat(-1.0 + step / 2.0), DVec3::splat(step)),
            kernel_width: 0.6,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(Values::U8(values), transfer.unwrap())
}

/// Content of a scan: bodies in air, with sharp faces or none, of one value or of two.
#[derive(Debug, Clone, Copy)]
enum Scan {
    /// A ball of one value.
    Ball,
    /// A box of one value, its faces along the lattice's.
    Box,
    /// Columns of two values, some cells wide.
    Columns,
    /// Thin plates.
    Plates,
    /// A ball with a shell, both with noise.
    Noisy,
    /// A ball that fades into air over tens of cells.
    Soft,
}

impl Scan {
    const ALL: [Self; 6] = [
        Self::Ball,
        Self::Box,
        Self::Columns,
        Self::Plates,
        Self::Noisy,
        Self::Soft,
    ];

    /// Returns the value at a cell and at its position, -1 to 1.
    fn value(self, cell: [usize; 3], at: DVec3, noise: f64) -> f64 {
        let r = at.length();
        let inside = |is_inside: bool, value: f64| if is_inside { value } else { 0.0 };
        match self {
            Self::Ball => inside(r < 0.8, 100.0),
            Self::Box => inside(at.abs().max_element() < 0.77, 100.0),
            Self::Columns => inside((cell[0] / 5 + cell[1] / 7) % 2 == 1, 30.0),
            Self::Plates => inside(cell[0] % 8 < 2, 60.0),
            Self::Noisy => {
                inside(r < 0.8, 100.0) - inside(r < 0.6, 50.0)
                    + noise * (4.0 + 0.2 * (1.0 - r) * 100.0)
            }
            Self::Soft => 180.0 / (1.0 + (12.0 * (r - 0.6)).exp()) + 2.0 * noise,
        }
    }

    fn volume(
        self,
        dims: [usize; 3],
        transfer: impl Fn(&Values) -> TransferFunction,
    ) -> PointVolume {
        let mut random = Random::new(24);
        let [x, y, z] = dims;
        let values = (0..x * y * z).map(|n| {
            let cell = [n % x, n / x % y, n / (x * y)];
            let of_axis = |a: usize| 2.0 * (cell[a] as f64 + 0.5) / dims[a] as f64 - 1.0;
            let at = DVec3::new(of_axis(0), of_axis(1), of_axis(2));
            let noise = random.range(-1.0, 1.0) + random.range(-1.0, 1.0);
            self.value(cell, at, noise).clamp(0.0, 255.0) as u8
        });
        let values = Values::U8(values.collect());
        let transfer = transfer(&values);
        PointVolume::new(
            Particles::Lattice {
                lattice: Lattice::uniform(dims, DVec3::ZERO, DVec3::ONE),
                kernel_width: 0.6,
            },
            Strength::Classified {
                volumes: Vec::new(),
            },
        )
        .classified(values, transfer)
    }
}

/// Scans far below a pixel test the values and positions of clusters.
#[test]
fn merged_scans_are_within_the_tolerance_of_exact_pictures() {
    const DIMS: [usize; 3] = [91, 97, 40];
    let automatic = |values: &Values| {
        let sample = ValueSample::of_grid(values, &[], 1.0);
        TransferFunction::automatic(&sample, &AutomaticOptions::default()).unwrap()
    };
    let shade = |v: f32| [v / 255.0, 0.5, 1.0 - v / 255.0];
    // The total depth is 1 to 3.
    let even = |_: &Values| {
        TransferFunction::from_curves(shade, |v| 1.0 - (-1e-3 * v / 4.0).exp(), [0.0, 255.0], 1.0)
            .unwrap()
    };
    let faint =
        |_: &Values| TransferFunction::from_curves(shade, |v| 2e-5 * v, [0.0, 255.0], 1.0).unwrap();
    let mut table = Table::default();
    for (number, scan) in Scan::ALL.into_iter().enumerate() {
        let volumes = [
            ("automatic", scan.volume(DIMS, automatic)),
            ("even", scan.volume(DIMS, even)),
            ("faint", scan.volume(DIMS, faint)),
        ];
        for (step, (function, volume)) in some(volumes.into_iter().enumerate(), number, 2) {
            let mut renderer = Renderer::new(vec![volume]).unwrap();
            let (camera, middle) = fitted(&renderer, SIZE).unwrap();
            let widths = some([64.0, 24.0, 10.0], number + step, 3).into_iter();
            let views: Vec<View> = widths
                .map(|width| {
                    let far = nearer(&camera, middle, width / SIZE as f64);
                    let name = match width as usize {
                        64 => "64 px",
                        24 => "24 px",
                        _ => "10 px",
                    };
                    let camera = cut(&far, middle, (1.25 * width) as usize + 8);
                    View { name, camera }
                })
                .collect();
            let name = format!("{scan:?}, {function}");
            hold(&mut table, &name, &mut renderer, &views, &DEFAULT_ONLY);
        }
    }
    table.finish();
}

/// Checks a zoom from the fitted distance to where the data are 2 pixels wide, in 60 equal ratios.
/// Each picture is within the tolerance of the exact one of all particles, so neither the first
/// merging nor a change of level is visible. Fewer pixels need fewer footprints.
fn hold_zoom(name: &str, volume: PointVolume) {
    const STEPS: i32 = 60;
    /// Width of the first picture, px.
    const START_PX: f64 = 96.0;
    const END_PX: f64 = 2.0;
    /// Width of the smallest picture, which the footprints of the smallest data reach, px.
    const LEAST_SIZE: f64 = 12.0;
    // The part of 200,000 kernels beyond 5 standard deviations, 4e-6 of each, is invisible; this
    // saves half of the pixels.
    let exact = Settings {
        cutoff: Some(5.0),
        ..exact()
    };
    let default = Settings::default();
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let (camera, middle) = fitted(&renderer, START_PX as usize).unwrap();
    let mut table = Table::default();
    let mut footprints: Vec<usize> = Vec::new();
    let exact_steps = some((0..STEPS).step_by(2), 0, 5);
    for step in 0..STEPS {
        let shrunk = (END_PX / START_PX).powf(f64::from(step) / f64::from(STEPS - 1));
        let far = nearer(&camera, middle, shrunk);
        // The picture shrinks with the data.
        let size = (1.25 * shrunk * START_PX).clamp(LEAST_SIZE, START_PX);
        let far = cut(&far, middle, size as usize);
        let image = renderer.render(&far, &default).unwrap().clone();
        let count = renderer.counts().footprints;
        // The exact pictures take most of the time, and levels last for many steps.
        if exact_steps.contains(&step) {
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
        // Blocks are merged individually, and what the tolerance omits reappears when merged: a
        // tenth.
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

/// Merged particles of data cut by faces consist of the parts inside.
#[test]
fn zooming_out_of_a_lattice_cut_at_its_faces_pops_by_less_than_the_tolerance() {
    let cut = PointVolume {
        boundary: Some(Boundary::Lattice),
        ..lattice(49)
    };
    hold_zoom("cut lattice", cut);
}

/// The same holds for tangent planes.
#[test]
fn zooming_out_of_a_cut_ring_pops_by_less_than_the_tolerance() {
    let dims = [20, 60, 30];
    let nodes = ring(dims, 4.0);
    let values: Vec<f32> = nodes.iter().map(|p| (127.5 + 40.0 * p.z) as f32).collect();
    let sampled = grid(dims, nodes, values, &uniform_options(BoundaryChoice::Sharp)).unwrap();
    let volume = PointVolume {
        transfer_function: lattice(2).transfer_function,
        ..sampled.volume
    };
    assert!(volume.boundary.is_some());
    hold_zoom("cut ring", volume);
}

/// The GPU's pictures are compared with the CPU's exact ones: all data, small, at the default
/// tolerance.
#[cfg(feature = "gpu")]
#[test]
fn pictures_of_the_gpu_are_within_the_tolerance_of_exact_ones() {
    /// Picture size, for a software adapter.
    const GPU_SIZE: usize = 64;
    let Some(gpu) = crate::common::gpu::pictures() else {
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
        // A software adapter takes half a minute for a million and a half voxels. Of the engine,
        // only the view that merges most is drawn, and the one in which everything is tried.
        let views = if file.path.ends_with(ENGINE) {
            some(views.into_iter().skip(1).take(1), 1, 2)
        } else {
            some(views, file.name().len(), 3)
        };
        compare(&file.name(), renderer, &views, &DEFAULT_ONLY);
    }
    let mut random = Random::new(23);
    for n in 0..3 {
        let (renderer, camera, middle) = random_scene(&mut random);
        let views = views(camera, middle);
        let name = format!("random kernels {n}");
        compare(&name, renderer, &views, &[TOLERANCES[0], TOLERANCES[2]]);
    }
    // As in `crowds_are_within_the_tolerance_of_exact_pictures`, but fewer.
    let members = vec![(DVec3::ZERO, 0.05); 400];
    let renderer = Renderer::new(vec![crowd(50, 400.0, &mut random, members)]).unwrap();
    let (camera, middle) = fitted(&renderer, GPU_SIZE).unwrap();
    let views = views(camera, middle);
    compare("400 in one place", renderer, &views, &DEFAULT_ONLY);
    table.finish();
}

#[test]
fn views_are_what_they_are_called() {
    // Seen from low near the eye, the fitted picture's centre is not the data's centre.
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
    // The sizes agree except for perspective.
    let share = width(&far.camera) / width(&camera);
    assert!((share - 0.125).abs() < 0.01, "{share}");
    let distance = |c: &Camera| (c.eye - middle).length();
    assert!((distance(&near.camera) * 4.0 - distance(&camera)).abs() < 1e-9);
    // All footprints lie in the smaller picture.
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
