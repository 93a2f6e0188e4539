//! Tests scenes that the first rank alone has.

use ewa_splat::distributed::{Collective, Renderer, Share};
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::sample::{BoundaryChoice, KernelOptions, SampleOptions, scene};
use ewa_splat::scene::{
    Colour, Lighting, Particles, PointVolume, SplatRule, Strength, TransferFunction, ValueScale,
    Values,
};
use ewa_splat::view::Camera;
use ewa_splat::{ColumnSettings, Error, SceneOptions, Settings};
use glam::DVec3;

use crate::common::Random;
use crate::ranks::{SIZES, alone, drawn, each};
use crate::scenes::{ball, box_of, ellipsoids, lattice, plain, spheres};

fn assert_same(whole: &[PointVolume], frames: &[(Camera, Settings)], sizes: &[usize]) {
    let expected = alone(whole, frames);
    assert!(whole.is_empty() || expected.iter().all(|frame| frame.shown() > 100));
    for &size in sizes {
        let found = each(size, |rank| {
            let own = (rank.rank() == 0).then(|| whole.to_vec());
            let renderer = Renderer::of_first(rank, own, &SceneOptions::default());
            drawn(renderer.unwrap(), frames)
        });
        let (pictures, stats) = &found[0];
        assert!(*pictures == expected, "{size} ranks");
        let count = ewa_splat::Renderer::new(whole.to_vec()).unwrap();
        let sum: u64 = stats.iter().map(|rank| rank.particles).sum();
        assert_eq!(sum as usize, count.particle_count());
        if size > 1 && count.particle_count() > 10_000 {
            assert!(stats.iter().all(|rank| rank.particles > 0), "{size} ranks");
        }
    }
}

fn frames() -> Vec<(Camera, Settings)> {
    let camera = |eye: DVec3, fov| Camera::perspective(eye, DVec3::ZERO, DVec3::Y, fov, [90, 70]);
    let lit = Settings {
        lighting: Some(Lighting::default()),
        depth: true,
        normals: true,
        ..Settings::default()
    };
    vec![
        (camera(DVec3::new(0.5, 1.0, -4.0), 40.0), lit),
        (camera(DVec3::X * 120.0, 2.0), Settings::default()),
    ]
}

/// Returns splats of a radiance field, with colours that depend on the direction.
fn splats(count: usize) -> PointVolume {
    let mut random = Random::new(5);
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let factors = (0..count).map(|_| crate::common::lower_factor(&random.factor(0.05, 3.0)));
    let factors: Vec<[f32; 6]> = factors.collect();
    let mut some = |count: usize, low, high| -> Vec<f32> {
        (0..count).map(|_| random.range(low, high) as f32).collect()
    };
    let (coefficients, opacities) = (some(12 * count, -0.4, 0.8), some(count, 0.1, 0.9));
    plain(
        Particles::Anisotropic { positions, factors },
        Strength::PeakOpacity {
            opacities,
            rule: SplatRule::Mip,
            by_distance: false,
        },
        Colour::Harmonics {
            degree: 1,
            coefficients,
            is_linear: false,
        },
    )
}

#[test]
fn whatever_one_rank_has_all_draw() {
    // Lattices that carry more than values are sent whole to every rank.
    let mut lit = lattice(12);
    let directions = (0..12 * 12 * 12).map(|i| DVec3::new(1.0, f64::from(i), 0.5));
    lit.normals = Some(directions.map(ewa_splat::math::normal_code).collect());
    let mut weighed = box_of([9, 8, 7]);
    weighed.strength = Strength::Mass((0..9 * 8 * 7).map(|i| 1e-4 * i as f32).collect());
    weighed.colour = Colour::PerParticle(vec![[0.2, 0.9, 0.4]; 9 * 8 * 7]);
    let mut uneven = lattice(12);
    let volumes = (0..12 * 12 * 12).map(|i| 1e-3 + 1e-6 * i as f32).collect();
    uneven.strength = Strength::Classified { volumes };
    let scene = [
        uneven.clone(),
        spheres(4000),
        ellipsoids(1500),
        ball(900, 0.6),
        lattice(12),
        lit,
        weighed,
        splats(300),
    ];
    assert_same(&scene, &frames(), &SIZES);
    assert_same(&[], &frames()[..0], &[3]);
    // Such lattices cannot be split into planes: a rank without planes cannot detect this, and gets
    // the error.
    let found = each(2, |rank| {
        let is_first = rank.rank() == 0;
        let mut own = uneven.clone();
        if !is_first {
            own = lattice(12);
            own.values = own.values.map(|values| values.gather(&[]));
        }
        let planes = if is_first { 0..12 } else { 12..12 };
        let share = Share {
            planes: Some(vec![vec![planes]]),
            ..Share::from(vec![own])
        };
        Renderer::new(rank, share, &SceneOptions::default()).map(|_| ())
    });
    assert!(found.iter().all(Result::is_err), "{found:?}");
}

#[test]
fn many_particles_and_cells_are_dealt_out() {
    assert_same(&[spheres(600_000), box_of([64, 66, 200])], &frames(), &[2]);
}

/// Results of grids: ellipsoids with local models, planes of their boundary and ghosts; functions
/// on any scale.
#[test]
fn grids_and_functions_travel_to_the_last_bit() {
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let options = SampleOptions {
        kernels: KernelOptions {
            boundary: BoundaryChoice::Sharp,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let data = open(&fixtures.join("wake.xyz"), &OpenOptions::default()).unwrap();
    let wake = scene(data, &options).unwrap().volumes;
    assert!(wake[0].boundary.is_some() && wake[0].local_models.is_some());
    let boxes = ewa_splat::Renderer::new(wake.clone()).unwrap().boxes();
    let (middle, radius) = ewa_splat::view::sphere_around(&boxes).unwrap();
    let eye = middle + DVec3::new(0.3, 0.5, 2.5) * radius;
    let camera = Camera::perspective(eye, middle, DVec3::Z, 40.0, [80, 60]);
    assert_same(&wake, &[(camera, Settings::default())], &[1, 4]);
    // A function's table survives on any scale, even with numbers that have no finite decimal form.
    for scale in [ValueScale::Log, ValueScale::Symlog { linear: 1.0 / 3.0 }] {
        let mut volume = ellipsoids(1000);
        let function = TransferFunction::from_curves(
            |v| [v, 1.0 / 3.0, 0.1],
            |v| 0.7 * v,
            [0.1, 1.0],
            0.1 / 3.0,
        );
        volume.transfer_function = Some(function.unwrap().on_scale(scale));
        volume.local_models = None;
        assert_same(&[volume], &frames()[..1], &[2]);
    }
}

/// Values in double precision: of points, of a lattice that is partitioned by planes, and of one that every rank has.
#[test]
fn values_in_double_precision_travel_as_such() {
    let wide = |volume: PointVolume| {
        let thirds = (0..volume.particles.len()).map(|i| (i % 700) as f64 / 3.0);
        PointVolume {
            values: Some(Values::F64(thirds.collect())),
            ..volume
        }
    };
    let mut weighed = box_of([9, 8, 7]);
    weighed.strength = Strength::Mass((0..9 * 8 * 7).map(|i| 1e-4 * i as f32).collect());
    let scene = [spheres(4000), ellipsoids(1500), lattice(12), weighed].map(wide);
    assert!(scene[0].transfer_function.is_none() && scene[2].transfer_function.is_some());
    assert_same(&scene, &frames()[..1], &[1, 3]);
    let camera = Camera::orthographic(DVec3::Z * 4.0, DVec3::ZERO, DVec3::Y, 3.0, [50, 50]);
    let settings = ColumnSettings::default();
    let mut whole = ewa_splat::Renderer::new(scene.to_vec()).unwrap();
    let expected = whole.column_density(&camera, &settings).unwrap();
    let found = each(3, |rank| {
        let own = (rank.rank() == 0).then(|| scene.to_vec());
        let renderer = Renderer::of_first(rank, own, &SceneOptions::default());
        let mut renderer = renderer.unwrap();
        let column = renderer.column_density(&camera, &settings).unwrap();
        column.cloned()
    });
    assert!(found[0].as_ref() == Some(expected));
}

#[test]
fn the_first_rank_must_have_a_scene() {
    let found = each(3, |rank| {
        // Volumes given on other ranks are ignored.
        let own = (rank.rank() > 0).then(|| vec![spheres(10)]);
        Renderer::of_first(rank, own, &SceneOptions::default()).map(|_| ())
    });
    for result in found {
        match result {
            Err(error @ (Error::Invalid { .. } | Error::OfRank { .. })) => {
                let said = error.to_string();
                assert!(said.contains("volumes on the first rank"), "{said}");
            }
            other => panic!("{other:?}"),
        }
    }
}
