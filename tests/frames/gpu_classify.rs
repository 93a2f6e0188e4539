//! Compares classification and shading with their CPU twins.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::gpu::gpu;
use crate::common::{Random, some};
use ewa_splat::image::{linear_from_srgb, srgb_from_linear};
use ewa_splat::math::{ein, ein_share, harmonics, harmonics_count, harmonics_sum};
use ewa_splat::scene::{
    Colour, ColourIn, Lattice, LatticeSpacing, Particles, PointVolume, SplatRule, Strength,
    StrengthIn, TransferFunction, Values, ValuesIn,
};
use ewa_splat::stages::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid};
use ewa_splat::stages::cpu;
use ewa_splat::stages::gpu::{self, merged_numbers};
use ewa_splat::stages::record::{BlockView, ClassifiedBy, ClassifiedParticle};
use ewa_splat::stages::scene::{Slopes, Weighting};
use ewa_splat::view::Camera;
use glam::{DMat3, DVec3, Vec3};

const POISON: [f32; 14] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    1e-40,
    -1e-40,
    f32::MIN_POSITIVE,
    f32::MAX,
    f32::MIN,
    1e30,
    -1e30,
    1e-30,
    3.0,
];

/// Returns one view of every block.
fn views(volume: &BlockedVolume) -> Vec<BlockView> {
    (0..volume.blocks.len())
        .map(|block| BlockView {
            block: block as u32,
            // Earlier contents are overwritten.
            first: 77,
            count: 99,
            ..bytemuck::Zeroable::zeroed()
        })
        .collect()
}

/// Returns the CPU's classified particles.
fn expected(volume: &BlockedVolume, views: &mut [BlockView]) -> Vec<ClassifiedParticle> {
    let total = cpu::count_classified(volume, views);
    let mut out = vec![bytemuck::Zeroable::zeroed(); total];
    cpu::classify(volume, views, &mut out);
    out
}

/// Returns the index of a particle in the volume's arrays.
fn index(volume: &BlockedVolume, view: &BlockView, local: u32) -> usize {
    match &volume.particles {
        BlockedParticles::Lattice(grid) => {
            let corner = grid.cells(view.block).map(|[first, _]| first);
            grid.index(BrickGrid::cell(corner, local))
        }
        _ => (volume.blocks[view.block as usize].first + local) as usize,
    }
}

/// Returns true for the same bits; all NaNs are alike.
fn same(a: f32, b: f32) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

#[derive(Debug, Default)]
struct Tally {
    particles: usize,
    flips: usize,
    /// Number of results that differ from the twin's bits.
    rounded: usize,
}

/// Classifies some views on the device and compares.
///
/// Interpolation a + (b - a) s may be one rounding instead of two on the CPU, and denormals may be
/// zeros. So masses differ by 2^-22 of the greater of the two entries' extinctions, times the
/// volume, and by the least normal number; colours likewise. Other results are copied, and equal to
/// the bit.
fn check(volume: &BlockedVolume, views: &[BlockView], part_bytes: u64, tally: &mut Tally) {
    const ROUNDING: f32 = 0.5 * f32::EPSILON * 4.0;
    let (mut on_cpu, mut on_device) = (views.to_vec(), views.to_vec());
    let particles = expected(volume, &mut on_cpu);
    let gpu = gpu().unwrap();
    let capacity = if part_bytes == u64::MAX {
        particles.len() as u32 + 10
    } else {
        (part_bytes / 64).max(256) as u32
    };
    let out = gpu::classify(
        gpu,
        volume,
        &mut on_device,
        capacity,
        part_bytes,
        ClassifiedBy::Value,
    )
    .unwrap();
    let mut first = 0;
    for (state, groups) in out.states.iter().zip(&out.groups) {
        let count = state.needed.div_ceil(256);
        assert_eq!(*groups, [count, u32::from(count > 0), 1]);
        assert_eq!((state.first, state.needed), (first, state.classified_count));
        first += state.needed;
    }
    assert_eq!(first as usize, out.particles.len());
    for (v, (view, twin)) in on_device.iter().zip(&on_cpu).enumerate() {
        let of = |view: &BlockView, all: &[ClassifiedParticle]| {
            all[view.first as usize..][..view.count as usize].to_vec()
        };
        let (ours, twins) = (of(view, &out.particles), of(twin, &particles));
        assert!(ours.iter().all(|p| p.view == v as u32));
        assert!(ours.windows(2).all(|w| w[0].local < w[1].local), "{ours:?}");
        tally.particles += twins.len();
        let (mut ours, mut twins) = (ours.iter().peekable(), twins.iter().peekable());
        let mut flip = |particle: &ClassifiedParticle| {
            // The mass is denormal, or of an extinction that interpolation rounds to zero.
            assert!(particle.mass <= 1e-7, "flipped: {particle:?}");
            tally.flips += 1;
        };
        loop {
            let (a, b) = match (ours.peek(), twins.peek()) {
                (None, None) => break,
                (Some(a), Some(b)) if a.local == b.local => (**a, **b),
                (Some(a), b) if b.is_none_or(|b| a.local < b.local) => {
                    flip(a);
                    ours.next();
                    continue;
                }
                (_, Some(b)) => {
                    flip(b);
                    twins.next();
                    continue;
                }
                _ => unreachable!(),
            };
            ours.next();
            twins.next();
            let is_equal = same(a.mass, b.mass)
                && a.carried
                    .colour()
                    .iter()
                    .zip(b.carried.colour())
                    .all(|(&x, y)| same(x, y));
            if is_equal {
                continue;
            }
            tally.rounded += 1;
            let i = index(volume, twin, a.local);
            let value = volume.values.as_ref().map_or(0.0, |v| v.get(i));
            let transfer = volume.transfer_function.as_ref().unwrap();
            let class = transfer.classify(value);
            let context = || format!("{i}: {value:e}, {class:?}: {a:?}, {b:?}");
            if matches!(volume.strength, StrengthIn::Classified { .. }) {
                let cell = b.mass / class[3];
                let bound = transfer.max_extinction(value, value) * cell * ROUNDING;
                let difference = (a.mass - b.mass).abs();
                assert!(difference <= bound + f32::MIN_POSITIVE, "{}", context());
            } else {
                assert!(same(a.mass, b.mass), "{}", context());
            }
            for (x, y) in a.carried.colour().iter().zip(b.carried.colour()) {
                let is_close = volume.colour == ColourIn::Classified && (x - y).abs() <= ROUNDING;
                assert!(same(*x, y) || is_close, "{}", context());
            }
        }
    }
}

/// Returns steps, ramps and gaps over -100 to 150.
fn transfer() -> TransferFunction {
    let opacity = |v: f32| match v {
        v if v < -50.0 => 0.0,
        v if v < 0.0 => (v + 50.0) / 100.0,
        v if v < 60.0 => 0.0,
        v if v < 70.0 => 0.9,
        v if v < 140.0 => 0.0,
        _ => 0.2,
    };
    let colour = |v: f32| [(v * 0.1).sin().abs(), (v * 0.03).cos().abs(), 0.25];
    TransferFunction::from_curves(colour, opacity, [-100.0, 150.0], 2.0).unwrap()
}

/// Returns values of a type: random, on either side of the range, on entries and the range's ends,
/// poison.
fn values(kind: usize, count: usize, random: &mut Random) -> Option<Values> {
    Some(match kind {
        0 => return None,
        1 => Values::U8((0..count).map(|_| random.bits() as u8).collect()),
        2 => Values::U16((0..count).map(|_| random.index(200) as u16).collect()),
        3 => Values::I16(
            (0..count)
                .map(|i| match i % 50 {
                    0 => i16::MIN,
                    1 => i16::MAX,
                    _ => random.range(-120.0, 170.0) as i16,
                })
                .collect(),
        ),
        _ => Values::F32(
            (0..count)
                .map(|i| match i % 7 {
                    0 => POISON[random.index(POISON.len())],
                    1 | 2 => (-100.0 + 250.0 * random.index(4096) as f64 / 4095.0) as f32,
                    3 => [-100.0, 150.0, -100.000_01, 150.000_02][random.index(4)],
                    _ => random.range(-130.0, 180.0) as f32,
                })
                .collect(),
        ),
    })
}

/// Returns positive numbers, zeros, negative ones and poison.
fn strengths(count: usize, random: &mut Random) -> Vec<f32> {
    (0..count)
        .map(|i| match i % 5 {
            0 => POISON[random.index(POISON.len())],
            1 => -1.0,
            _ => random.log_range(1e-3, 10.0) as f32,
        })
        .collect()
}

fn axis(n: usize, random: &mut Random) -> Vec<f64> {
    let mut at = 0.0;
    (0..n)
        .map(|_| {
            at += random.range(0.01, 0.3);
            at
        })
        .collect()
}

/// Returns particles of a kind: lattices whose sides are no multiples of a brick's, spheres,
/// ellipsoids.
fn particles(kind: usize, random: &mut Random) -> Particles {
    let dims = [[11, 1, 9], [8, 8, 4], [17, 9, 5], [1, 30, 1]][random.index(4)];
    match kind {
        0 => Particles::Lattice {
            lattice: Lattice {
                dims,
                spacing: LatticeSpacing::Uniform {
                    origin: DVec3::ONE,
                    step: DMat3::from_diagonal(DVec3::new(0.3, 0.4, 0.5)),
                },
            },
            kernel_width: 0.7,
        },
        1 => Particles::Lattice {
            lattice: Lattice {
                dims,
                spacing: LatticeSpacing::Rectilinear {
                    coordinates: dims.map(|n| axis(n, random)),
                },
            },
            kernel_width: 0.7,
        },
        _ => {
            let count = [1, 255, 256, 257, 2_000][random.index(5)];
            let positions = (0..count).map(|_| random.point(1.0)).collect();
            if kind == 2 {
                Particles::Isotropic {
                    positions,
                    sigmas: vec![0.1; count],
                }
            } else {
                let factors = vec![[0.1, 0.0, 0.1, 0.0, 0.0, 0.1]; count];
                Particles::Anisotropic { positions, factors }
            }
        }
    }
}

fn colours(kind: usize, count: usize, random: &mut Random) -> Colour {
    let mut rgb = || [0, 1, 2].map(|_| random.range(-0.1, 2.0) as f32);
    match kind {
        0 => Colour::Classified,
        1 => Colour::PerParticle((0..count).map(|_| rgb()).collect()),
        2 => Colour::Uniform(rgb()),
        _ => Colour::Harmonics {
            degree: 1,
            coefficients: vec![0.3; count * 12],
            is_linear: false,
        },
    }
}

#[test]
fn every_kind_of_data_is_classified_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(5);
    let mut tally = Tally::default();
    let mut cases = 0;
    // Every fifth case has every kind of particle, strength and colour.
    for case in some(0..48, 0, 5) {
        let particles = particles(case % 4, &mut random);
        let count = particles.len();
        let is_lattice = case % 4 < 2;
        let strength = match case / 4 % 3 {
            0 if is_lattice => Strength::Classified {
                volumes: Vec::new(),
            },
            0 => Strength::Classified {
                volumes: strengths(count, &mut random),
            },
            1 => Strength::Mass(strengths(count, &mut random)),
            _ => Strength::PeakOpacity {
                opacities: strengths(count, &mut random),
                rule: SplatRule::Exact,
                by_distance: false,
            },
        };
        let colour = colours(case / 12 % 4, count, &mut random);
        if is_lattice && matches!(colour, Colour::Harmonics { .. }) {
            continue;
        }
        let is_classified =
            matches!(strength, Strength::Classified { .. }) || colour == Colour::Classified;
        // Unused values have no effect.
        let kind = if is_classified {
            1 + random.index(4)
        } else {
            random.index(5)
        };
        let volume = BlockedVolume::new(PointVolume {
            particles,
            strength,
            colour,
            values: values(kind, count, &mut random),
            transfer_function: Some(transfer()),
            boundary: None,
            normals: None,
            local_models: None,
        });
        let mut views = views(&volume);
        // Some blocks are out of view.
        views.retain(|v| v.block % 5 != 3);
        check(&volume, &views, u64::MAX, &mut tally);
        cases += 1;
    }
    println!("{cases} cases: {tally:?}");
    // More than 5,000 of all 42.
    assert!(tally.particles >= 120 * cases, "{tally:?}");
}

#[test]
fn every_value_is_classified_alike() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(6);
    let mut tally = Tally::default();
    for kind in 1..5 {
        let count = 60_000;
        for strength in [
            Strength::Classified {
                volumes: (0..count)
                    .map(|_| random.log_range(1e-30, 1e30) as f32)
                    .collect(),
            },
            Strength::Mass(vec![0.5; count]),
        ] {
            let volume = BlockedVolume::new(PointVolume {
                particles: Particles::Isotropic {
                    positions: (0..count).map(|_| random.point(1.0)).collect(),
                    sigmas: vec![0.1; count],
                },
                strength,
                colour: Colour::Classified,
                values: values(kind, count, &mut random),
                transfer_function: Some(transfer()),
                boundary: None,
                normals: None,
                local_models: None,
            });
            check(&volume, &views(&volume), u64::MAX, &mut tally);
            // Parts hold a few blocks.
            check(&volume, &views(&volume), 64 * 20_000, &mut tally);
        }
    }
    println!("{tally:?}");
}

/// Compares averages, slopes and Ein at positions, widths and depths of all sizes.
///
/// - Averages: a device that fuses operations moves a position by half a rounding, 2^-13 entries.
///   For each end of the interval, the average changes by as much times the steepest slope nearby.
///   Divisions of up to 2.5 ulp and some six roundings add 16 EPSILON of the greatest extinction
///   nearby, over the extinction for a colour that is weighted with it.
/// - Slopes are read, not computed.
/// - Ein: logarithms and exponentials of 3 ulp, and six roundings: 1e-6.
#[test]
fn numbers_of_merged_particles_are_the_twins() {
    let Some(gpu) = gpu() else { return };
    let transfer = transfer();
    let mut random = Random::new(9);
    let mut pairs: Vec<[f32; 2]> = POISON
        .iter()
        .flat_map(|&a| POISON.iter().map(move |&b| [a, b]))
        .collect();
    for i in 0..40_000 {
        let entry = -100.0 + 250.0 * random.index(4096) as f64 / 4095.0;
        let value = [entry, random.range(-130.0, 180.0)][i % 2];
        pairs.push([value as f32, random.log_range(1e-8, 1e4) as f32]);
    }
    let mut worst = [0.0_f32; 2];
    let step = 250.0 / 4095.0;
    let [weighted, even] = [Weighting::Extinction, Weighting::Even].map(|w| transfer.slopes(w));
    for (weighting, slopes) in [(Weighting::Extinction, &weighted), (Weighting::Even, &even)] {
        let results = merged_numbers(gpu, &transfer, weighting, &pairs).unwrap();
        let averages = transfer.averages(weighting);
        for (&[value, spread], found) in pairs.iter().zip(&results) {
            let twin = averages.classify_spread(value, spread);
            let context = || format!("{value:e} +- {spread:e}: {found:?}, {twin:?}");
            let reach = spread.abs() + 2.0 * step;
            let (lo, hi) = (value - reach, value + reach);
            let moved = |slopes: &Slopes| 2.0 * 2_f32.powi(-13) * slopes.max_slope(lo, hi) * step;
            // A graphics card's quotients are fused with the products before them.
            let roundings = if gpu.is_software() { 16.0 } else { 128.0 };
            let rounding = roundings * f32::EPSILON;
            let greatest = transfer.max_extinction(lo, hi);
            let of_extinction = moved(&weighted) + rounding * greatest;
            let error = (found.average[3] - twin[3]).abs();
            assert!(error <= of_extinction, "{}", context());
            worst[0] = worst[0].max(error);
            for c in 0..3 {
                let error = (found.average[c] - twin[c]).abs();
                let bound = match weighting {
                    Weighting::Even => moved(&even) + rounding,
                    // Error of the product, and of its divisor.
                    Weighting::Extinction => {
                        (1.0 + twin[c]) * of_extinction / twin[3].max(f32::MIN_POSITIVE)
                    }
                };
                assert!(error <= bound, "{}", context());
                worst[1] = worst[1].max(error);
            }
            let size = spread.abs();
            if value.is_finite() && (value + size).is_finite() {
                let slope = slopes.max_slope(value, value + size);
                assert_eq!(found.slope, slope, "{}", context());
            }
            // Quotients are accurate up to 2^126, as WGSL says, and NaN may become anything.
            if !(size <= 2_f32.powi(126)) && !gpu.is_software() {
                continue;
            }
            // Denormals are zeros on the device.
            let size = if size < f32::MIN_POSITIVE { 0.0 } else { size };
            for (found, twin) in [(found.ein, ein(size)), (found.ein_share, ein_share(size))] {
                let is_close = (found - twin).abs() <= 1e-6 * twin;
                assert!(is_close || twin < f32::MIN_POSITIVE, "{}", context());
            }
        }
    }
    println!(
        "extinctions differ by {:e}, colours by {:e}",
        worst[0], worst[1]
    );
}

/// Compares merged particles of points and of lattices, with colours and masses from all sources.
///
/// The test above checks averages; this one checks their arguments. Six roundings of a fused device
/// may move a position by 2^-12 entries, which the transfer function's steepest ramp makes 2^-12 of
/// its greatest extinction. Clumps add the 1e-6 of their logarithm. On lavapipe, only those occur.
#[test]
fn merged_particles_are_classified_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(12);
    let tolerance = if gpu.is_software() { 2e-6 } else { 1e-3 };
    let (mut seen, mut differ, mut lone) = (0, 0, 0);
    for case in 0..16 {
        let is_lattice = case % 4 < 2;
        let count = 9_000;
        let particles = match case % 4 {
            0 | 1 => Particles::Lattice {
                lattice: Lattice {
                    dims: [30, 25, 19],
                    spacing: if case % 4 == 0 {
                        LatticeSpacing::Uniform {
                            origin: DVec3::ONE,
                            step: DMat3::from_diagonal(DVec3::new(0.3, 0.4, 0.5)),
                        }
                    } else {
                        LatticeSpacing::Rectilinear {
                            coordinates: [30, 25, 19].map(|n| axis(n, &mut random)),
                        }
                    },
                },
                kernel_width: 0.7,
            },
            2 => Particles::Isotropic {
                positions: (0..count).map(|_| random.point(1.0)).collect(),
                sigmas: vec![1e-3; count],
            },
            _ => Particles::Anisotropic {
                positions: (0..count).map(|_| random.point(1.0)).collect(),
                factors: vec![[0.1, 0.0, 0.1, 0.0, 0.0, 0.1]; count],
            },
        };
        let count = particles.len();
        let strengths = |random: &mut Random| -> Vec<f32> {
            let each = (0..count).map(|_| random.log_range(1e-7, 1e-3) as f32);
            each.collect()
        };
        let strength = match case / 4 % 2 {
            _ if is_lattice => Strength::Classified {
                volumes: Vec::new(),
            },
            0 => Strength::Classified {
                volumes: strengths(&mut random),
            },
            _ => Strength::Mass(strengths(&mut random)),
        };
        let colour = if is_lattice {
            colours([0, 2][case / 4 % 2], count, &mut random)
        } else {
            colours([0, 1, 2, 0][case / 4], count, &mut random)
        };
        // Values are smooth along the curve, and in noisy steps.
        let values = (0..count)
            .map(|i| (i as f64 / count as f64 * 250.0 - 100.0 + random.range(-20.0, 20.0)) as f32)
            .collect();
        let family = BlockedVolume::with_detail(PointVolume {
            particles,
            strength,
            colour,
            values: Some(Values::F32(values)),
            transfer_function: Some(transfer()),
            boundary: None,
            normals: None,
            local_models: None,
        });
        assert!(family.len() > 1, "case {case} has no levels");
        for volume in &family[1..] {
            let (mut on_cpu, mut on_device) = (views(volume), views(volume));
            let particles = expected(volume, &mut on_cpu);
            let part_bytes = [u64::MAX, 64 * 256 * 3][case / 8];
            let capacity = volume.particle_count() as u32;
            let out = gpu::classify(
                gpu,
                volume,
                &mut on_device,
                capacity,
                part_bytes,
                ClassifiedBy::Value,
            )
            .unwrap();
            assert_eq!(out.particles.len(), particles.len(), "case {case}");
            for (a, b) in out.particles.iter().zip(&particles) {
                let context = || format!("case {case}: {a:?}, {b:?}");
                assert_eq!((a.view, a.local), (b.view, b.local), "{}", context());
                let is_close = |x: f32, y: f32| (x - y).abs() <= tolerance * y.abs().max(1e-30);
                assert!(is_close(a.mass, b.mass), "{}", context());
                let colours = a.carried.colour().into_iter().zip(b.carried.colour());
                assert!(
                    colours.clone().all(|(x, y)| is_close(x, y)),
                    "{}",
                    context()
                );
                seen += 1;
                differ += usize::from(!same(a.mass, b.mass));
            }
            lone += particles.len() * usize::from(!is_lattice);
        }
    }
    println!("{seen} merged particles, {differ} differ; {lone} of points");
    assert!(seen > 5_000 && lone > 2_000);
}

#[test]
fn lattices_tiny_and_huge_are_classified_alike_in_parts() {
    if gpu().is_none() {
        return;
    }
    let mut random = Random::new(7);
    let mut tally = Tally::default();
    for size in [1e-12, 1.0, 1e12] {
        for is_rectilinear in [false, true] {
            let dims = [35, 20, 11];
            let spacing = if is_rectilinear {
                LatticeSpacing::Rectilinear {
                    coordinates: dims
                        .map(|n| axis(n, &mut random).iter().map(|x| x * size).collect()),
                }
            } else {
                LatticeSpacing::Uniform {
                    origin: DVec3::splat(size * 1e7),
                    step: DMat3::from_diagonal(DVec3::splat(size)),
                }
            };
            let volume = BlockedVolume::new(PointVolume {
                particles: Particles::Lattice {
                    lattice: Lattice { dims, spacing },
                    kernel_width: 0.7,
                },
                strength: Strength::Classified {
                    volumes: Vec::new(),
                },
                colour: Colour::Classified,
                values: values(1 + random.index(4), 35 * 20 * 11, &mut random),
                transfer_function: Some(transfer().with_unit_distance(size).unwrap()),
                boundary: None,
                normals: None,
                local_models: None,
            });
            check(&volume, &views(&volume), u64::MAX, &mut tally);
            check(&volume, &views(&volume), 64 * 256 * 4, &mut tally);
            check(&volume, &[], u64::MAX, &mut tally);
        }
    }
    println!("{tally:?}");
    assert!(tally.particles > 30_000);
}

#[test]
fn more_views_than_a_dispatch_has_columns_are_classified_alike() {
    if gpu().is_none() {
        return;
    }
    // 65,538 blocks of two particles: the dispatch is split into two rows.
    let count = 2 * 65_538;
    let mut random = Random::new(10);
    let block = |i: u32| Block {
        origin: DVec3::ZERO,
        half_extent: Vec3::ONE,
        max_sigma: 1.0,
        min_sigma: 1.0,
        max_strength: 0.5,
        first: 2 * i,
        count: 2,
        value_range: [0.0, 255.0],
        values_around: [f32::INFINITY, f32::NEG_INFINITY],
        greatest_spread: 0.0,
        parent: ewa_splat::stages::blocks::NO_PARENT,
        level: 0,
        crowding: 1.0,
    };
    let volume = BlockedVolume {
        blocks: (0..count / 2).map(block).collect(),
        particles: BlockedParticles::Isotropic {
            offsets: vec![[0.0; 3]; count as usize].into(),
            sigmas: vec![1.0; count as usize].into(),
        },
        strength: StrengthIn::Classified {
            volumes: vec![0.5; count as usize].into(),
        },
        colour: ColourIn::Classified,
        values: Some(ValuesIn::U8(
            (0..count).map(|_| random.bits() as u8).collect(),
        )),
        transfer_function: Some(transfer()),
        boundary: None,
        normals: None,
        indices: None,
        local_models: None,
        lobes: None,
        merged: None,
    };
    let mut tally = Tally::default();
    check(&volume, &views(&volume), u64::MAX, &mut tally);
    println!("{tally:?}");
}

#[test]
fn particles_without_room_are_counted_and_left_out() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(8);
    let count = 1_000;
    let volume = BlockedVolume::new(
        PointVolume::new(
            Particles::Isotropic {
                positions: (0..count).map(|_| random.point(1.0)).collect(),
                sigmas: vec![0.1; count],
            },
            Strength::Mass(vec![1.0; count]),
        )
        .with_colour([0.5; 3]),
    );
    let mut seen = views(&volume);
    let out = gpu::classify(gpu, &volume, &mut seen, 999, u64::MAX, ClassifiedBy::Value).unwrap();
    assert!(out.particles.is_empty());
    let state = out.states[0];
    assert_eq!((state.needed, state.classified_count), (1_000, 0));
    let out = gpu::classify(
        gpu,
        &volume,
        &mut seen,
        1_000,
        u64::MAX,
        ClassifiedBy::Value,
    )
    .unwrap();
    assert_eq!(out.particles.len(), 1_000);
    // Parts that are large enough keep their particles, one after another.
    let counts: Vec<u32> = volume.blocks.iter().map(|b| b.count).collect();
    let [least, greatest] = [*counts.iter().min().unwrap(), *counts.iter().max().unwrap()];
    assert!(least < greatest, "{counts:?}");
    let out = gpu::classify(
        gpu,
        &volume,
        &mut seen,
        greatest - 1,
        1,
        ClassifiedBy::Value,
    )
    .unwrap();
    let mut first = 0;
    for (state, &needed) in out.states.iter().zip(&counts) {
        let classified = if needed < greatest { needed } else { 0 };
        assert_eq!(
            (state.needed, state.classified_count, state.first),
            (needed, classified, first)
        );
        first += classified;
    }
}

#[test]
fn harmonics_are_shaded_alike() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(9);
    let mut worst = 0.0_f32;
    let mut shaded = 0;
    for case in some(0..16, 0, 3) {
        // Sums are in codes or linear light, and so is blending.
        let (is_encoded, is_linear) = (case / 8 == 1, [0, 3, 5, 6, 9, 10, 12, 15].contains(&case));
        let case = case % 8;
        let into_space: fn(f32) -> f32 = match (is_linear, is_encoded) {
            (false, false) => linear_from_srgb,
            (true, true) => srgb_from_linear,
            _ => |sum| sum,
        };
        let degree = [1, 2, 3, 0][case % 4];
        let far = [0.0, 1e7, 0.0, 1e9][case / 2];
        let middle = DVec3::new(far, -far, far * 0.5);
        let count = 3_000;
        let stride = 3 * harmonics_count(degree);
        let positions: Vec<_> = (0..count).map(|_| random.point(1.0) + middle).collect();
        let coefficients = (0..count * stride)
            .map(|i| match i {
                i if i % 997 == 0 => POISON[random.index(POISON.len())],
                _ => random.range(-0.6, 0.6) as f32,
            })
            .collect();
        let volume = BlockedVolume::new(PointVolume {
            particles: if case < 4 {
                Particles::Anisotropic {
                    positions,
                    factors: vec![[0.1, 0.0, 0.1, 0.0, 0.0, 0.1]; count],
                }
            } else {
                Particles::Isotropic {
                    positions,
                    sigmas: vec![0.1; count],
                }
            },
            strength: Strength::PeakOpacity {
                opacities: (0..count).map(|i| (i % 3) as f32).collect(),
                rule: SplatRule::Exact,
                by_distance: false,
            },
            colour: Colour::Harmonics {
                degree,
                coefficients,
                is_linear,
            },
            values: None,
            transfer_function: None,
            boundary: None,
            normals: None,
            local_models: None,
        });
        let mut views = views(&volume);
        let particles = expected(&volume, &mut views);
        // Seen from the centre of a block: a direction of zero length.
        let eye = if case == 6 {
            volume.blocks[0].origin
        } else {
            middle + random.point(1.0)
        };
        let aim = eye + random.point(1.0);
        let size = [64, 64];
        let camera = if case % 3 == 2 {
            Camera::orthographic(eye, aim, DVec3::Z, 1.0, size)
        } else {
            Camera::perspective(eye, aim, DVec3::Z, 60.0, size)
        };
        let mut on_cpu = particles.clone();
        cpu::shade(&volume, &views, &camera, is_encoded, &mut on_cpu);
        let mut on_device = particles.clone();
        let part_bytes = [u64::MAX, 100_000][case % 2];
        gpu::shade(
            gpu,
            &volume,
            &views,
            &camera,
            is_encoded,
            &mut on_device,
            part_bytes,
        )
        .unwrap();
        let ColourIn::Harmonics { coefficients, .. } = &volume.colour else {
            panic!("harmonics stay harmonics");
        };
        let (BlockedParticles::Isotropic { offsets, .. }
        | BlockedParticles::Anisotropic { offsets, .. }) = &volume.particles
        else {
            panic!("points stay points");
        };
        for (device, twin) in on_device.iter().zip(&on_cpu) {
            let view = views[twin.view as usize];
            let i = index(&volume, &view, twin.local);
            let block = &volume.blocks[view.block as usize];
            let direction = if case % 3 == 2 {
                camera.camera_from_world.row(2).as_vec3()
            } else {
                ((block.origin - camera.eye).as_vec3() + Vec3::from(offsets[i])).normalize_or_zero()
            };
            let own = &coefficients[i * stride..][..stride];
            let codes = harmonics_sum(own, &harmonics(direction));
            for (c, code) in codes.into_iter().enumerate() {
                let (ours, theirs) = (device.carried.colour()[c], twin.carried.colour()[c]);
                if same(ours, theirs) {
                    continue;
                }
                // The direction is good to some roundings (f32 division and root are good to 2.5
                // units in the last place in WGSL), then come sums of products of it, and a power.
                let sum: f32 = own.iter().skip(c).step_by(3).map(|k| k.abs()).sum();
                let slack = 2e-6 * (0.5 + sum);
                let [low, high] =
                    [code - slack, code + slack].map(|code| into_space(code.max(0.0)));
                assert!(
                    ours >= low * (1.0 - 1e-5) && ours <= high * (1.0 + 1e-5),
                    "case {case}, {i}: {ours} {theirs}, code {code}"
                );
                worst = worst.max((ours - theirs).abs() / theirs.max(1e-3));
                shaded += 1;
            }
        }
    }
    println!("{shaded} colours differ, by a share of {worst} at most");
}
