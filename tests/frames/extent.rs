//! Tests kernels classified over their own extents: pieces against moments in closed form, and
//! pictures against the field's own integrals.

use ewa_splat::reference::lobe::{moments, window_moments};
use ewa_splat::reference::{Integrator, PixelFilter, ReferenceSettings};
use ewa_splat::render::Classification;
use ewa_splat::scene::{ColourSpace, ControlPoint, Lattice, PointVolume, TransferFunction};
use ewa_splat::stages::blocks::{BlockedParticles, BlockedVolume, BrickGrid, Frustum, cull};
use ewa_splat::stages::cpu;
use ewa_splat::stages::record::{
    BlockView, ChoiceUniform, ClassifiedBy, ClassifiedParticle, PieceTerms,
};
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Settings};
use glam::{DVec3, Vec3};

use crate::analytic::truth;
use crate::common::one_sample;

/// Evaluates a sum of Gaussian blobs over \[-1, 1\]³, 0 to about 1.
pub(super) fn field(x: DVec3) -> f64 {
    [
        (DVec3::new(-0.3, -0.25, -0.2), 0.35, 0.95),
        (DVec3::new(0.35, 0.2, 0.15), 0.3, 0.85),
        (DVec3::new(0.1, -0.3, 0.45), 0.22, 0.7),
    ]
    .iter()
    .map(|(centre, sigma, height)| {
        height * (-0.5 * x.distance_squared(*centre) / (sigma * sigma)).exp()
    })
    .sum()
}

fn points(points: &[(f32, f32)], unit_distance: f64) -> TransferFunction {
    let points: Vec<ControlPoint> = points
        .iter()
        .map(|&(value, opacity)| ControlPoint {
            value,
            colour: Some([1.0 - 0.5 * value, 0.3, 0.4 + 0.5 * value]),
            opacity: Some(opacity),
        })
        .collect();
    TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 1.2], unit_distance).unwrap()
}

/// Returns two thin shells.
pub(super) fn shells() -> TransferFunction {
    let knots = [
        (0.27, 0.0),
        (0.30, 0.9),
        (0.33, 0.0),
        (0.57, 0.0),
        (0.60, 0.98),
        (0.63, 0.0),
    ];
    points(&knots, 0.1)
}

pub(super) fn lattice(n: usize, transfer: &TransferFunction) -> PointVolume {
    let spacing = 2.0 / (n - 1) as f64;
    let grid = Lattice::uniform([n; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
    let value = |i: usize| {
        let at = [i % n, i / n % n, i / (n * n)].map(|n| n as f64);
        field(DVec3::from(at) * spacing - 1.0) as f32
    };
    let values: Vec<f32> = (0..n.pow(3)).map(value).collect();
    PointVolume::lattice(grid, values, transfer.clone())
}

pub(super) fn camera(size: usize) -> Camera {
    let eye = DVec3::new(2.3, -4.2, 1.9);
    Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 35.0, [size, size])
}

/// Returns the pieces of a volume that are visible from anywhere.
pub(super) fn pieces(
    volume: &BlockedVolume,
) -> (Vec<BlockView>, Vec<ClassifiedParticle>, Vec<PieceTerms>) {
    let choice = ChoiceUniform {
        classified_by: ClassifiedBy::Extent as u32,
        ..bytemuck::Zeroable::zeroed()
    };
    let mut views = Vec::new();
    cull(volume, &camera(64), None::<&Frustum>, &choice, &mut views);
    let mut found = cpu::Pieces::default();
    let count = found.find(volume, &mut views);
    let mut particles = vec![bytemuck::Zeroable::zeroed(); count];
    let mut terms = vec![PieceTerms::WHOLE; count];
    found.place(&mut particles, &mut terms);
    (views, particles, terms)
}

/// Checks pieces of a lattice against their definition in f64 (section 9.1 of the mathematics): the
/// neighbours of a node, moments in closed form of each run of entries above 0, the values within
/// two nodes.
#[test]
fn pieces_of_a_lattice_are_those_of_the_definition() {
    let (n, width) = (21, 0.6);
    let transfer = shells();
    let volume = lattice(n, &transfer);
    let values = volume.values.clone().unwrap();
    let volume = BlockedVolume::new(volume);
    let (views, particles, terms) = pieces(&volume);
    let value = |at: [i64; 3]| {
        let inside = at.iter().all(|&i| (0..n as i64).contains(&i));
        let index = at[0] + n as i64 * (at[1] + n as i64 * at[2]);
        inside.then(|| f64::from(values.get(index as usize)))
    };
    let last = 4095.0 / 1.2;
    let knots = |lo: f64, hi: f64| -> Vec<[f64; 2]> {
        let entries = transfer.table().iter().enumerate();
        let knots = entries.map(|(i, e)| [i as f64 / last, f64::from(e[3])]);
        knots
            .filter(|k| k[0] > lo - 1.5 / last && k[0] < hi + 1.5 / last)
            .collect()
    };
    let lobes = [(0.27, 0.33), (0.57, 0.63)].map(|(lo, hi)| (lo, hi, knots(lo, hi)));
    let cell = (2.0 / (n - 1) as f64).powi(3);
    let peak = 40.0;
    let mut seen = std::collections::HashMap::new();
    for (particle, terms) in particles.iter().zip(&terms) {
        let view = &views[particle.view as usize];
        let brick = view.block as usize;
        let bricks = [n.div_ceil(8), n.div_ceil(8)];
        let corner = [
            brick % bricks[0] * 8,
            brick / bricks[0] % bricks[1] * 8,
            brick / (bricks[0] * bricks[1]) * 4,
        ];
        let l = particle.local as usize;
        let at = [corner[0] + l % 8, corner[1] + l / 8 % 8, corner[2] + l / 64];
        seen.entry(at)
            .or_insert_with(Vec::new)
            .push((particle, terms));
    }
    let (mut drawn, mut shifted) = (0, 0);
    for i in 0..n.pow(3) {
        let at = [i % n, i / n % n, i / (n * n)];
        let signed = at.map(|n| n as i64);
        let own = value(signed).unwrap();
        let (mut slope, mut second) = (DVec3::ZERO, 0.0);
        for a in 0..3 {
            let side = |step: i64| {
                let mut other = signed;
                other[a] += step;
                value(other)
            };
            match (side(-1), side(1)) {
                (Some(below), Some(above)) => {
                    slope[a] = (above - below) / 2.0;
                    second += above - 2.0 * own + below;
                }
                (Some(below), None) => slope[a] = own - below,
                (None, Some(above)) => slope[a] = above - own,
                (None, None) => {}
            }
        }
        let slope = slope * width;
        let spread = slope.length();
        let middle = own + 0.5 * width * width * second;
        let near =
            (-2..=2).flat_map(|k| (-2..=2).flat_map(move |j| (-2..=2).map(move |i| [i, j, k])));
        let around = near.filter_map(|d: [i64; 3]| value([0, 1, 2].map(|a| signed[a] + d[a])));
        let (lo, hi) = around.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
            (lo.min(v), hi.max(v))
        });
        let mut expected = Vec::new();
        for (first, end, knots) in &lobes {
            let Some([mass, mean, variance]) = moments(knots, middle, spread.max(1e-9)) else {
                continue;
            };
            let distance = (middle - middle.clamp(*first, *end)).abs();
            // A piece at the edge of its reach may be present or absent.
            let is_sure = distance < 3.99 * spread && lo < end - 1e-3 && hi > first + 1e-3;
            expected.push((is_sure, mass, mean, variance.sqrt()));
        }
        let found = seen.remove(&at).unwrap_or_default();
        for (particle, terms) in &found {
            let extinction = f64::from(particle.mass) / cell;
            let close = |e: &&(bool, f64, f64, f64)| {
                let shift = f64::from(terms.shift) - e.2;
                let width = f64::from(terms.width) - e.3;
                (extinction / e.1 - 1.0).abs() < 0.1 && shift.abs() < 0.02 && width.abs() < 0.02
            };
            // If little is left, the share may err by a tenth (`Lobes::piece`).
            assert!(
                expected.iter().any(|e| close(&e)) || extinction < 2e-4 * peak,
                "{at:?}: {particle:?} {terms:?}, {expected:?}"
            );
            let along = Vec3::from(terms.axis).as_dvec3();
            assert!((along - slope / spread).length() < 1e-4, "{at:?}");
            shifted += usize::from(terms.shift.abs() > 0.1);
        }
        drawn += found.len();
        let sure = expected.iter().filter(|e| e.0).count();
        assert!(found.len() >= sure, "{at:?}: {found:?}, {expected:?}");
    }
    assert!(seen.is_empty());
    assert!(drawn > 1_000 && shifted > 500, "{drawn} {shifted}");
}

/// Returns a function with steps of every kind: at the beginning and end of a lobe, within it, and
/// without any.
pub(super) fn steps() -> TransferFunction {
    let knots = [
        (0.2, 0.0),
        (0.2, 0.9),
        (0.3, 0.6),
        (0.3, 0.0),
        (0.45, 0.0),
        (0.5, 0.5),
        (0.6, 0.5),
        (0.6, 0.98),
        (1.2, 0.98),
    ];
    points(&knots, 0.1)
}

/// Returns the root mean square error of a picture, levels of 255.
fn error(volume: PointVolume, camera: &Camera, settings: &Settings, truth: &[[f64; 4]]) -> f64 {
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let image = renderer.render(camera, settings).unwrap();
    let squares = image.pixels.iter().zip(truth).map(|(pixel, truth)| {
        let differences = [0, 1, 2].map(|c| f64::from(pixel[c]) - truth[c]);
        differences.iter().map(|d| d * d).sum::<f64>() / 3.0
    });
    255.0 * (squares.sum::<f64>() / truth.len() as f64).sqrt()
}

pub(super) fn settings(classify: Classification) -> Settings {
    Settings {
        classify,
        low_pass_variance_px2: 0.15,
        ..Settings::default()
    }
}

/// Compares pictures of a field on a lattice with its own integrals: each rule of section 9 of the
/// mathematics has an effect. Bounds are the measured figures plus a tenth. Without the shift,
/// variance or prefilter, or with its sign reversed, the errors are several times larger.
#[test]
fn pictures_are_near_those_of_the_field() {
    let camera = camera(128);
    for (name, transfer, alone, most) in [
        ("shells", shells(), 10.0, 3.2),
        ("smooth", points(&[(0.15, 0.0), (1.0, 0.7)], 0.1), 0.8, 0.22),
        (
            "step",
            points(&[(0.3, 0.0), (0.3, 0.95), (1.2, 0.95)], 0.1),
            10.0,
            7.7,
        ),
    ] {
        let truth = truth(&camera, &transfer, field, 3, 600);
        let volume = lattice(41, &transfer);
        let particle = settings(Classification::Particle);
        let extent = settings(Classification::Extent);
        let by_value = error(volume.clone(), &camera, &particle, &truth);
        let by_extent = error(volume, &camera, &extent, &truth);
        println!("{name}: {by_value:.2} by values, {by_extent:.2} by extents");
        assert!(by_value > alone, "{name}: {by_value}");
        assert!(by_extent < most, "{name}: {by_extent}");
    }
}

/// Next to a jump, the linear model overshoots the data. A lobe of values that only one sample has
/// leaves pieces of the kernels within two samples of that one, and of no others along the jump.
#[test]
fn lobes_are_drawn_where_samples_around_have_their_values() {
    let nodes = 25;
    let spacing = 2.0 / (nodes - 1) as f64;
    let grid = Lattice::uniform([nodes; 3], DVec3::NEG_ONE, DVec3::splat(spacing));
    let cell_of = |n: usize| [n % nodes, n / nodes % nodes, n / (nodes * nodes)];
    // The jump is between 11 and 12 along x.
    let peak = [12, 12, 12];
    let value = |n: usize| {
        let cell = cell_of(n);
        if cell == peak {
            0.9_f32
        } else if cell[0] >= 12 {
            0.8
        } else {
            0.1
        }
    };
    let values: Vec<f32> = (0..nodes.pow(3)).map(value).collect();
    let transfer = points(&[(0.85, 0.0), (0.9, 0.9), (0.95, 0.0)], 0.1);
    let volume = BlockedVolume::new(PointVolume::lattice(grid, values, transfer));
    let BlockedParticles::Lattice(bricks) = &volume.particles else {
        panic!("a lattice stays one");
    };
    let (views, particles, _) = pieces(&volume);
    assert!(!particles.is_empty());
    for particle in &particles {
        let cells = bricks.cells(views[particle.view as usize].block);
        let cell = BrickGrid::cell(cells.map(|[first, _]| first), particle.local);
        let is_near = (0..3).all(|a| cell[a].abs_diff(peak[a]) <= 2);
        assert!(is_near, "{cell:?}");
    }
}

/// A function without features narrower than a kernel needs no pieces. The picture is the same to
/// the bit, and no lobes are stored.
#[test]
fn what_no_kernel_straddles_is_classified_as_before() {
    let transfer = points(&[(0.0, 0.0), (1.2, 1e-3)], 1.0);
    let volume = lattice(33, &transfer);
    assert!(BlockedVolume::new(volume.clone()).lobes.is_none());
    let camera = camera(64);
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let by_extent = renderer
        .render(&camera, &settings(Classification::Extent))
        .unwrap()
        .clone();
    let by_value = renderer
        .render(&camera, &settings(Classification::Particle))
        .unwrap();
    assert_eq!(&by_extent, by_value);
}

/// Windows add up to the lobe that they divide: their masses to its mass in closed form, and their
/// weighted means to its mean, to 2.5 %, twice the error of the tables.
#[test]
fn windows_add_up_to_their_lobe() {
    let transfer = steps();
    let lobes = transfer.lobes(0.05);
    let last = 4095.0 / 1.2;
    let mut most = 0;
    for lobe in lobes.lobes() {
        let [lo, hi] = lobe.interval.map(f64::from);
        let entries = transfer.table().iter().enumerate();
        let mut knots: Vec<[f64; 2]> = entries
            .map(|(i, e)| [i as f64 / last, f64::from(e[3])])
            .filter(|k| k[0] > lo - 0.5 / last && k[0] < hi + 0.5 / last)
            .collect();
        if lobe.beyond[1] > 0.0 {
            knots.push([hi + 10.0, lobe.beyond[1].into()]);
        }
        most = most.max(lobes.windows(lobe).len());
        // From the narrowest row of the tables on.
        for times in [1.0, 4.0, 16.0, 64.0] {
            let spread = times * (lobe.interval[1] - lobe.interval[0]) / 60.0;
            for n in -30..=30 {
                let value = lobe.interval[0] + n as f32 * 0.1 * spread;
                let whole = moments(&knots, value.into(), spread.into()).unwrap();
                if whole[0]
                    < 0.01 * f64::from(transfer.max_extinction(lobe.interval[0], lobe.interval[1]))
                {
                    // Faint windows have a weaker bound in the tables.
                    continue;
                }
                let windows = lobes.windows(lobe).iter();
                let pieces = windows.filter_map(|w| lobes.piece(lobe, w, value, spread));
                let (mut mass, mut first) = (0.0, 0.0);
                for piece in pieces {
                    mass += f64::from(piece.extinction);
                    first += f64::from(piece.extinction * piece.shift);
                }
                assert!(
                    (mass / whole[0] - 1.0).abs() < 0.025,
                    "{value} {spread}: {mass} {whole:?}"
                );
                let mean = first / mass;
                assert!(
                    (mean - whole[1]).abs() < 0.05,
                    "{value} {spread}: {mean} {whole:?}"
                );
                let truth = window_moments(&lobes, lobe, &knots, value.into(), spread.into());
                let sum: f64 = truth.iter().flatten().map(|t| t[0]).sum();
                assert!(
                    (sum / whole[0] - 1.0).abs() < 1e-5,
                    "{value} {spread}: {sum} {whole:?}"
                );
            }
        }
    }
    assert!(most >= 5, "{most}");
}

/// Far from a step, in standard deviations of a kernel, only the rest of its lobe is drawn.
#[test]
fn far_from_a_step_a_kernel_is_one_piece() {
    let transfer = points(&[(0.3, 0.0), (0.3, 0.95), (1.2, 0.95)], 0.1);
    let lobes = transfer.lobes(0.05);
    let lobe = &lobes.lobes()[0];
    let count = |value: f32| {
        let windows = lobes.windows(lobe).iter();
        windows
            .filter(|w| lobes.piece(lobe, w, value, 0.02).is_some())
            .count()
    };
    assert_eq!(lobes.windows(lobe).len(), 3);
    assert_eq!(count(0.3), 3);
    assert_eq!(count(0.3 + 6.0 * 0.02), 1);
    assert_eq!(count(0.9), 1);
    assert_eq!(count(0.3 - 5.0 * 0.02), 0);
    // A function without steps has no windows.
    let shells = shells().lobes(0.05);
    assert!(
        shells
            .lobes()
            .iter()
            .all(|lobe| shells.windows(lobe).len() == 1)
    );
}

/// The reference finds the same windows by quadrature. The pictures agree to the tables' error,
/// half a grey level.
#[test]
fn the_reference_has_windows_of_its_own() {
    let camera = camera(24);
    let volume = lattice(13, &steps());
    let one = |classify| Settings {
        advanced: one_sample(),
        ..settings(classify)
    };
    let extent = one(Classification::Extent);
    let integrator =
        Integrator::classified(std::slice::from_ref(&volume), Classification::Extent).unwrap();
    let reference = integrator
        .render(
            &camera,
            &ReferenceSettings {
                low_pass_variance_px2: 0.15,
                pixel_filter: PixelFilter::Kernels,
                ..ReferenceSettings::default()
            },
        )
        .unwrap();
    let truth: Vec<[f64; 4]> = reference.pixels.clone();
    let near = error(volume.clone(), &camera, &extent, &truth);
    let particle = one(Classification::Particle);
    let far = error(volume, &camera, &particle, &truth);
    println!("{near:.3} by extents, {far:.2} by values");
    assert!(near < 0.5 && far > 5.0, "{near} {far}");
}
