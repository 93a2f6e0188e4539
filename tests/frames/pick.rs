//! Tests which particles a pixel shows: their shares reproduce the pixel from the caller's own
//! colours.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Particles, PointVolume, Strength, TransferFunction,
};
use ewa_splat::view::{Camera, ClipPlane, Projection};
use ewa_splat::{Composite, Renderer, SceneOptions, Settings};
use glam::{DMat3, DVec3};

use crate::common::Random;
use crate::common::scene::{Particle, camera, volume};

const KEEP: SceneOptions = SceneOptions {
    level_of_detail: true,
    keep_shapes: false,
    keep_indices: true,
    task: None,
};

fn transfer() -> TransferFunction {
    let colours = |v: f32| [v, 0.5, 1.0 - v];
    TransferFunction::from_curves(colours, |v| 0.5 * v, [0.0, 1.0], 0.3).unwrap()
}

/// Returns more particles than a block holds, each of a different colour.
fn cloud(random: &mut Random) -> PointVolume {
    let particles: Vec<_> = (0..1_500)
        .map(|_| Particle {
            position: random.point(1.0) + DVec3::Z * 5.0,
            factor: random.factor(0.12, 4.0),
            mass: random.range(0.001, 0.01) as f32,
            colour: [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    volume(&particles)
}

fn lattice(random: &mut Random) -> PointVolume {
    let lattice = Lattice {
        dims: [10, 11, 12],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::new(-0.2, -1.0, 4.2),
            step: DMat3::from_diagonal(DVec3::splat(0.15)),
        },
    };
    let values = (0..lattice.len()).map(|_| random.range(0.0, 1.0) as f32);
    PointVolume::lattice(lattice, values.collect::<Vec<f32>>(), transfer())
}

/// Returns a tilted wall across the left half of the picture.
fn wall(random: &mut Random) -> PointVolume {
    let cells: Vec<_> = (-12..=2)
        .flat_map(|i| (-12..=12).map(move |j| (i, j)))
        .collect();
    let at = |(i, j): &(i32, i32)| {
        let (x, y) = (f64::from(*i) * 0.1, f64::from(*j) * 0.1);
        DVec3::new(x, y, 5.0 + 0.3 * x)
    };
    let tangents = [0.06, 0.0, 0.018, 0.0, 0.06, 0.0];
    PointVolume {
        particles: Particles::Surfels {
            positions: cells.iter().map(at).collect(),
            tangents: vec![tangents; cells.len()],
            is_one_sided: false,
        },
        strength: Strength::Surface(vec![0.0104; cells.len()]),
        colour: Colour::PerParticle(
            cells
                .iter()
                .map(|_| [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32))
                .collect(),
        ),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

/// Returns the colour of a volume's particle from the caller's data.
fn colour_of(volume: &PointVolume, particle: usize) -> [f32; 3] {
    match (&volume.colour, &volume.values) {
        (Colour::PerParticle(colours), _) => colours[particle],
        (_, Some(values)) => {
            let [r, g, b, _] = transfer().classify(values.get(particle));
            [r, g, b]
        }
        _ => panic!("colours or values"),
    }
}

fn place_of(volume: &PointVolume, particle: usize) -> DVec3 {
    match &volume.particles {
        Particles::Anisotropic { positions, .. } | Particles::Surfels { positions, .. } => {
            positions[particle]
        }
        Particles::Lattice { .. } => {
            let cell = [particle % 10, particle / 10 % 11, particle / 110];
            let [x, y, z] = cell.map(|n| n as f64);
            DVec3::new(-0.2, -1.0, 4.2) + DVec3::new(x, y, z) * 0.15
        }
        Particles::Isotropic { .. } => panic!("none here"),
    }
}

#[test]
fn shares_of_a_pixel_make_it_again() {
    let mut random = Random::new(11);
    let scenes = [
        vec![cloud(&mut random), lattice(&mut random)],
        vec![lattice(&mut random), wall(&mut random), cloud(&mut random)],
        vec![wall(&mut random)],
    ];
    let clip = vec![ClipPlane {
        normal: DVec3::new(0.3, 0.2, 0.9),
        distance: -4.6,
    }];
    for (number, scene) in scenes.iter().enumerate() {
        let mut renderer = Renderer::with_options(scene.clone(), &KEEP).unwrap();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let focal = match projection {
                Projection::Perspective => 80.0,
                Projection::Orthographic => 16.0,
            };
            let camera = camera(projection, [focal; 2], [33, 29]);
            for composite in Composite::ALL {
                for clip in [vec![], clip.clone()] {
                    let settings = Settings {
                        composite,
                        clip,
                        level_of_detail: false,
                        ..Settings::default()
                    };
                    renderer.render(&camera, &settings).unwrap();
                    let image = renderer.image().clone();
                    let mut seen = 0;
                    for pixel in [[12, 9], [21, 20]] {
                        let picked = renderer.pick(&camera, &settings, pixel).unwrap();
                        let mut sum = [0.0_f64; 4];
                        for p in &picked {
                            let colour = colour_of(&scene[p.volume], p.particle);
                            for (sum, c) in sum.iter_mut().zip(colour.iter().chain(&[1.0])) {
                                *sum += f64::from(p.share * c);
                            }
                            let place = place_of(&scene[p.volume], p.particle);
                            assert!(p.position.distance(place) < 1e-6, "{p:?} {place}");
                            assert!((p.depth - place.z).abs() < 1e-6);
                        }
                        assert!(picked.is_sorted_by(|a, b| a.depth <= b.depth));
                        seen += picked.len();
                        let shown = image.pixel(pixel[0], pixel[1]);
                        for (sum, shown) in sum.iter().zip(shown) {
                            // The sums are in another order. A tile ends where all of its pixels
                            // are opaque within a share of the tolerance, a pixel where it is
                            // opaque itself.
                            let off = (sum - f64::from(shown)).abs();
                            assert!(
                                off < 2e-4,
                                "scene {number}, {projection:?}, {composite:?}, {pixel:?}: {sum} for {shown}"
                            );
                        }
                    }
                    assert!(seen > 5, "scene {number}, {composite:?}: {seen}");
                }
            }
        }
    }
}

#[test]
fn two_spheres_have_the_shares_of_the_formula() {
    let spheres = [
        Particle::sphere(DVec3::new(0.0, 0.0, 7.0), 0.5, 1.0),
        Particle::sphere(DVec3::new(0.0, 0.0, 4.0), 0.5, 0.4),
        Particle::sphere(DVec3::new(3.0, 0.0, 4.0), 0.1, 1.0),
    ];
    let camera = camera(Projection::Orthographic, [20.0; 2], [201, 201]);
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        tolerance: 1e-6,
        ..Settings::default()
    };
    let mut renderer = Renderer::with_options(vec![volume(&spheres)], &KEEP).unwrap();
    let picked = renderer.pick(&camera, &settings, [100, 100]).unwrap();
    let named: Vec<_> = picked.iter().map(|p| (p.particle, p.depth)).collect();
    assert_eq!(named, [(1, 4.0), (0, 7.0)]);
    // The ray passes through both centres: mass / (2 pi sigma^2).
    let alpha = |mass: f64| 1.0 - (-mass / (std::f64::consts::TAU * 0.25)).exp();
    let expected = [alpha(0.4), (1.0 - alpha(0.4)) * alpha(1.0)];
    for (p, expected) in picked.iter().zip(expected) {
        assert!(
            (f64::from(p.share) - expected).abs() < 1e-5,
            "{p:?} {expected}"
        );
    }
    assert!(
        renderer
            .pick(&camera, &settings, [0, 0])
            .unwrap()
            .is_empty()
    );
}

#[test]
fn what_has_no_shares_is_refused_in_words() {
    let mut random = Random::new(2);
    let camera = |size| -> Camera { camera(Projection::Perspective, [40.0; 2], size) };
    let settings = Settings::default();
    let error = |renderer: &mut Renderer, settings: &Settings, pixel| {
        let result = renderer.pick(&camera([20, 10]), settings, pixel);
        result.unwrap_err().to_string()
    };
    let points = vec![cloud(&mut random)];
    let mut unnumbered = Renderer::new(points.clone()).unwrap();
    assert!(error(&mut unnumbered, &settings, [3, 3]).contains("indices: true"));
    let mut numbered = Renderer::with_options(points, &KEEP).unwrap();
    assert!(error(&mut numbered, &settings, [20, 3]).contains("one of 20 x 10"));
    assert!(error(&mut numbered, &settings, [3, 10]).contains("one of 20 x 10"));
    // Lattices always have particle numbers. After slabs of values, particles have colours again.
    let mut cells = Renderer::new(vec![lattice(&mut random)]).unwrap();
    let slabs = Settings {
        composite: Composite::SLABS,
        classify: ewa_splat::Classification::Slab,
        ..settings.clone()
    };
    assert!(error(&mut cells, &slabs, [10, 5]).contains("classified"));
    cells.render(&camera([20, 10]), &slabs).unwrap();
    assert!(
        !cells
            .pick(&camera([20, 10]), &settings, [10, 5])
            .unwrap()
            .is_empty()
    );
}
