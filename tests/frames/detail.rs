//! Tests levels of detail: the sums that clusters preserve, and the cost of merging.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use crate::common::{Random, lower_factor};
use ewa_splat::render::Advanced;
use ewa_splat::scene::{
    Colour, ColourIn, Lattice, Particles, PointVolume, Strength, StrengthIn, TransferFunction,
    Values,
};
use ewa_splat::stages::blocks::{BlockedParticles, BlockedVolume, NO_PARENT};
use ewa_splat::stages::splat::budget::{MERGE_FOURTH, MERGE_THIRD};
use ewa_splat::view::Camera;
use ewa_splat::{ColumnSettings, Renderer, SceneOptions, Settings};
use glam::DVec3;

/// Returns spheres with masses and colours, in clumps.
fn spheres(count: usize) -> PointVolume {
    let mut random = Random::new(31);
    let mut positions = Vec::new();
    for n in 0..count {
        let clump = DVec3::new((n % 7) as f64, (n % 5) as f64, (n % 3) as f64);
        positions.push(1e4 + clump + random.point(0.6));
    }
    let numbers = |random: &mut Random| (0..count).map(|_| random.range(0.1, 1.0) as f32).collect();
    let colours = (0..count).map(|_| [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32));
    PointVolume {
        colour: Colour::PerParticle(colours.collect()),
        particles: Particles::Isotropic {
            positions,
            sigmas: numbers(&mut random),
        },
        strength: Strength::Mass(numbers(&mut random)),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

fn classified(particles: Particles, values: Values, is_lattice: bool) -> PointVolume {
    let count = particles.len();
    let transfer = TransferFunction::from_curves(|v| [v; 3], |v| v, [0.0, 1.0], 1.0).unwrap();
    PointVolume::new(
        particles,
        Strength::Classified {
            volumes: if is_lattice {
                Vec::new()
            } else {
                vec![1.0; count]
            },
        },
    )
    .classified(values, transfer)
}

/// Sums over some particles of mass, mass times position, mass times the trace of the second
/// moments about the origin, and mass times colour.
#[derive(Debug, Default)]
struct Sums {
    mass: f64,
    first: DVec3,
    second: f64,
    colour: DVec3,
}

impl Sums {
    fn add(&mut self, mass: f32, position: DVec3, trace: f64, colour: [f32; 3]) {
        let mass = f64::from(mass);
        self.mass += mass;
        self.first += position * mass;
        self.second += mass * (position.length_squared() + trace);
        self.colour += DVec3::from(colour.map(f64::from)) * mass;
    }
}

/// Returns the sums of a volume's particles of one level, with positions relative to `middle`.
fn sums(volume: &BlockedVolume, level: u32, middle: DVec3) -> Sums {
    let mut sums = Sums::default();
    let (StrengthIn::Mass(masses), ColourIn::PerParticle(colours)) =
        (&volume.strength, &volume.colour)
    else {
        panic!("masses and colours stay what they are");
    };
    for block in volume.blocks.iter().filter(|b| b.level == level) {
        for i in block.first as usize..(block.first + block.count) as usize {
            let (offset, trace) = match &volume.particles {
                BlockedParticles::Isotropic { offsets, sigmas } => {
                    (offsets[i], 3.0 * f64::from(sigmas[i]).powi(2))
                }
                BlockedParticles::Anisotropic { offsets, factors } => {
                    let squares = factors[i].iter().map(|l| f64::from(*l).powi(2));
                    (offsets[i], squares.sum())
                }
                BlockedParticles::Lattice(_) | BlockedParticles::Surfels { .. } => {
                    panic!("points stay points")
                }
            };
            let position = block.origin + DVec3::from(offset.map(f64::from)) - middle;
            sums.add(masses[i], position, trace, colours[i]);
        }
    }
    sums
}

#[test]
fn every_level_has_the_mass_centre_variance_and_colour_of_all() {
    let family = BlockedVolume::with_detail(spheres(20_000));
    let [base, levels] = &family[..] else {
        panic!("points have their levels in one volume");
    };
    let middle = DVec3::splat(1e4 + 2.0);
    let all = sums(base, 0, middle);
    let top = levels.blocks[0].level;
    assert!(top >= 3, "{top} levels of 20,000 particles");
    for level in 1..=top {
        let merged = sums(levels, level, middle);
        // 20,000 numbers are rounded to f32 each. Their roundings average out to 1e-9; all of one
        // sign would make 6e-8.
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-7 * b.abs().max(all.mass);
        assert!(close(merged.mass, all.mass), "{level}: {merged:?}, {all:?}");
        // Offsets are rounded to 6e-8 of a block of some 10.
        let first = (merged.first - all.first).length() / all.mass;
        assert!(first < 2e-6, "{level}: centre off by {first}");
        let second = (merged.second - all.second).abs() / all.second;
        assert!(second < 2e-6, "{level}: variance off by {second}");
        let colour = (merged.colour - all.colour).length() / all.mass;
        assert!(colour < 1e-7, "{level}: colour off by {colour}");
    }
}

#[test]
fn merged_blocks_hold_what_they_stand_for() {
    let mut random = Random::new(32);
    let count = 30_000;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(3.0)).collect();
    let factors = (0..count)
        .map(|_| lower_factor(&random.factor(0.02, 20.0)))
        .collect();
    let values = (0..count).map(|_| random.range(0.0, 1.0) as f32).collect();
    let points = classified(
        Particles::Anisotropic { positions, factors },
        Values::F32(values),
        false,
    );
    let dims = [45, 31, 22];
    let bytes = (0..dims.iter().product()).map(|_| random.range(0.0, 255.0) as u8);
    let lattice = classified(
        Particles::Lattice {
            lattice: Lattice::uniform(dims, DVec3::splat(-4.0), DVec3::new(0.2, 0.1, 0.3)),
            kernel_width: 0.6,
        },
        Values::U8(bytes.collect()),
        true,
    );
    for volume in [points, lattice] {
        let family = BlockedVolume::with_detail(volume);
        let merged: Vec<_> = family[1..].iter().flat_map(|v| &v.blocks).collect();
        let mut children = vec![0; merged.len()];
        for block in family.iter().flat_map(|v| &v.blocks) {
            if block.parent == NO_PARENT {
                continue;
            }
            children[block.parent as usize] += 1;
            let parent = merged[block.parent as usize];
            assert!(parent.level == block.level + 1);
            assert!(parent.min_sigma <= block.min_sigma && parent.max_sigma >= block.max_sigma);
            let ([low, high], [a, b]) = (parent.value_range, block.value_range);
            assert!(low <= a && high >= b, "{parent:?} of {block:?}");
            let apart = (parent.origin - block.origin).abs() + block.half_extent.as_dvec3();
            // The boxes are rounded to f32 each.
            let room = parent.half_extent.as_dvec3() * (1.0 + 1e-6) + 1e-6;
            assert!(apart.cmple(room).all(), "{parent:?} of {block:?}");
        }
        // All but the last have parents, and every merged block has children.
        assert!(children.iter().all(|&n| n > 0));
        let roots = merged.iter().filter(|b| b.parent == NO_PARENT).count();
        assert_eq!(roots, 1);
        assert!(family[0].blocks.iter().all(|b| b.parent != NO_PARENT));
    }
}

/// Low-passed columns of merged points differ from those of their members within the bound that
/// selects levels. Random sets of every shape are tested; some come close to the bound.
#[test]
fn columns_of_clusters_are_within_their_bound() {
    let mut random = Random::new(34);
    let mut worst = 0.0_f64;
    for round in 0..60 {
        // Pixels per unit: clusters from a tenth of a pixel to two.
        let scale = random.log_range(0.1, 6.0);
        let count = 300;
        let lopsided = round % 3 == 0;
        let positions: Vec<DVec3> = (0..count)
            .map(|_| {
                let p = random.point(0.5);
                if lopsided { p * p.length() * 2.0 } else { p }
            })
            .collect();
        let masses: Vec<f32> = (0..count).map(|_| random.range(0.1, 1.0) as f32).collect();
        let points = PointVolume::new(
            Particles::Isotropic {
                positions: positions.clone(),
                sigmas: vec![0.0; count],
            },
            Strength::Mass(masses.clone()),
        );
        let family = BlockedVolume::with_detail(points);
        let levels = &family[1];
        let (BlockedParticles::Anisotropic { offsets, factors }, StrengthIn::Mass(merged)) =
            (&levels.particles, &levels.strength)
        else {
            panic!("points are merged to ellipsoids");
        };
        let bounds = &levels.merged.as_ref().unwrap().bounds;
        let total: f64 = masses.iter().map(|m| f64::from(*m)).sum();
        for (block, bounds) in levels.blocks.iter().zip(bounds) {
            let third = f64::from(bounds.third) * scale;
            let fourth = f64::from(bounds.fourth) * scale;
            let bound =
                f64::from(MERGE_THIRD) * third.powi(3) + f64::from(MERGE_FOURTH) * fourth.powi(4);
            // Beyond this, series of moments are useless, and nothing is merged.
            if bound > 0.2 {
                continue;
            }
            // Columns along z, px², with the low-pass filter of 1 px².
            let column = |x: f64, y: f64| {
                let members = positions.iter().zip(&masses).map(|(p, m)| {
                    let d = [p.x * scale - x, p.y * scale - y];
                    f64::from(*m) * (-0.5 * (d[0] * d[0] + d[1] * d[1])).exp()
                });
                let clusters =
                    (block.first as usize..(block.first + block.count) as usize).map(|i| {
                        let p = block.origin + DVec3::from(offsets[i].map(f64::from));
                        let [l00, l10, l11, ..] = factors[i].map(|l| f64::from(l) * scale);
                        let (a, b, c) = (l00 * l00 + 1.0, l00 * l10, l10 * l10 + l11 * l11 + 1.0);
                        let determinant = a * c - b * b;
                        let (u, v) = (p.x * scale - x, p.y * scale - y);
                        let q = (c * u * u - 2.0 * b * u * v + a * v * v) / determinant;
                        f64::from(merged[i]) * (-0.5 * q).exp() / determinant.sqrt()
                    });
                clusters.sum::<f64>() - members.sum::<f64>()
            };
            let reach = 0.5 * scale + 3.0;
            for i in 0..=24 {
                for j in 0..=24 {
                    let at = |n: i32| reach * (f64::from(n) / 12.0 - 1.0);
                    worst = worst.max(column(at(i), at(j)).abs() / total / bound);
                }
            }
        }
    }
    println!("worst error over its bound: {worst:.3}");
    assert!(worst <= 1.0, "{worst}");
    // Clusters of many directions partly cancel; the bound is that of one cluster.
    assert!(worst > 0.2, "{worst}");
}

/// One particle without a finite shape or colour lies among many far below a pixel. Its cluster is
/// never merged, although NaN would pass every unguarded comparison.
#[test]
fn scenes_without_levels_draw_all_and_sum_the_same_columns() {
    // The particles are faint, because opaque ones of many colours are not merged.
    let scene = || {
        let mut volume = spheres(6_000);
        volume.strength = Strength::Mass(vec![1e-6; 6_000]);
        vec![volume]
    };
    let options = SceneOptions {
        level_of_detail: false,
        ..SceneOptions::default()
    };
    let mut plain = Renderer::with_options(scene(), &options).unwrap();
    let mut with_levels = Renderer::new(scene()).unwrap();
    let merged = |renderer: &Renderer| renderer.volumes().iter().any(|v| v.merged.is_some());
    assert!(merged(&with_levels) && !merged(&plain));
    assert!(plain.bytes_per_particle() < with_levels.bytes_per_particle());
    // The camera is so far away that everything is merged.
    let middle = DVec3::splat(1e4 + 2.0);
    let eye = middle - DVec3::Y * 4e3;
    let camera = Camera::perspective(eye, middle, DVec3::Z, 20.0, [48, 48]);
    let settings = Settings::default();
    let all = plain.render(&camera, &settings).unwrap().clone();
    assert_eq!(plain.counts().classified, 6_000);
    let exactly = Settings {
        level_of_detail: false,
        ..settings.clone()
    };
    assert!(settings.draws_merged() && !exactly.draws_merged());
    assert_eq!(&all, with_levels.render(&camera, &exactly).unwrap());
    with_levels.render(&camera, &settings).unwrap();
    assert!(with_levels.counts().blocks_merged > 0);
    let columns = ColumnSettings::default();
    let sums = plain.column_density(&camera, &columns).unwrap().clone();
    assert_eq!(
        &sums,
        with_levels.column_density(&camera, &columns).unwrap()
    );
}

#[test]
fn what_is_no_number_is_not_merged() {
    let camera = Camera::orthographic(
        DVec3::new(0.0, -1e5, 0.0),
        DVec3::ZERO,
        DVec3::Z,
        2e4,
        [64; 2],
    );
    for broken in [f32::NAN, f32::INFINITY] {
        for what in 0..2 {
            let mut volume = spheres(5_000);
            if let Particles::Isotropic { positions, sigmas } = &mut volume.particles {
                for p in positions {
                    *p -= 1e4;
                }
                sigmas[77] = if what == 0 { broken } else { sigmas[77] };
            }
            if let Colour::PerParticle(colours) = &mut volume.colour {
                colours.fill([0.5; 3]);
                colours[77][0] = if what == 1 { broken } else { 0.5 };
            }
            if let Strength::Mass(masses) = &mut volume.strength {
                masses.fill(1.0);
            }
            let family = BlockedVolume::with_detail(volume.clone());
            let levels = &family[1];
            let merged = levels.merged.as_ref().unwrap();
            for (block, bounds) in levels.blocks.iter().zip(&merged.bounds) {
                let all = [bounds.third, bounds.fourth, bounds.second, bounds.colour];
                assert!(all.iter().all(|b| !b.is_nan()), "{block:?}");
            }
            // The root also stands for the broken one.
            let root = &merged.bounds[0];
            assert_eq!(root.third, f32::INFINITY);
            let mut renderer = Renderer::new(vec![volume]).unwrap();
            renderer.render(&camera, &Settings::default()).unwrap();
            let merged = renderer.counts();
            assert!(
                merged.blocks_merged > 0 && merged.footprints > 100,
                "{merged:?}"
            );
        }
    }
}

/// Memory is as the README states. Random points fill two thirds of their blocks, as real ones do.
#[test]
fn bytes_per_particle_are_as_stated() {
    let mut random = Random::new(33);
    let count = 100_000;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let values = || Values::F32((0..count).map(|n| n as f32).collect());
    let of = |volume| BlockedVolume::bytes_per_particle(&BlockedVolume::with_detail(volume));
    let spheres = Particles::Isotropic {
        positions: positions.clone(),
        sigmas: vec![0.01; count],
    };
    let isotropic = of(classified(spheres, values(), false));
    assert!(isotropic <= 28.0, "{isotropic}");
    let ellipsoids = Particles::Anisotropic {
        positions,
        factors: vec![[0.02, 0.0, 0.01, 0.0, 0.0, 0.03]; count],
    };
    let anisotropic = of(classified(ellipsoids, values(), false));
    assert!(anisotropic <= 52.0, "{anisotropic}");
    let lattice = Particles::Lattice {
        lattice: Lattice::uniform([128, 128, 64], DVec3::ZERO, DVec3::ONE),
        kernel_width: 0.6,
    };
    let bytes = Values::U8(vec![7; 128 * 128 * 64]);
    let lattice = of(classified(lattice, bytes, true));
    assert!(lattice <= 1.5, "{lattice}");
    println!("{isotropic:.2}, {anisotropic:.2}, {lattice:.3} bytes per particle");
}

/// A larger allowed error of merging gives fewer kernels but the same light. From afar, the
/// opacities of a faint scene sum to its masses, merged or not.
#[test]
fn slack_merges_more_and_keeps_masses() {
    let mut volume = spheres(6_000);
    volume.strength = Strength::Mass(vec![1e-5; 6_000]);
    let mut renderer = Renderer::new(vec![volume]).unwrap();
    let middle = DVec3::splat(1e4) + DVec3::new(3.0, 2.0, 1.0);
    let camera = Camera::perspective(middle - DVec3::Y * 40.0, middle, DVec3::Z, 20.0, [96, 96]);
    let draw = |merge_slack, renderer: &mut Renderer| {
        let settings = Settings {
            tolerance: 1e-3,
            advanced: Advanced {
                merge_slack,
                ..Advanced::default()
            },
            ..Settings::default()
        };
        let image = renderer.render(&camera, &settings).unwrap();
        let sum: f64 = image.pixels.iter().map(|p| f64::from(p[3])).sum();
        (renderer.counts().classified, sum)
    };
    let (all, exact) = draw(1.0, &mut renderer);
    let (fewer, merged) = draw(1e6, &mut renderer);
    assert!(fewer * 10 < all, "{fewer} of {all}");
    // Opacities equal depths up to tau/2, 2e-3 here. Kernels lose the part outside the picture, and
    // members use their cluster's distance.
    assert!((merged / exact - 1.0).abs() < 5e-3, "{merged} {exact}");
}
