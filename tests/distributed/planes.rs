//! Tests lattices of which each rank has some planes: the picture equals that of one process.

use ewa_splat::distributed::{Collective, RankStats, Renderer, Share};
use ewa_splat::render::{Classification, Composite};
use ewa_splat::scene::{Particles, PointVolume, TransferFunction, Values};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{ColumnSettings, SceneOptions, Settings};
use glam::DVec3;

use crate::ranks::{alone, drawn, each};
use crate::scenes::{ball, box_of, spheres};

/// More than 262,144 cells for each of three ranks, of 64 planes each.
const DIMS: [usize; 3] = [64, 66, 200];

/// Returns a rank's planes: runs of 13, assigned in turn.
fn share(whole: &PointVolume, rank: usize, size: usize) -> Share {
    let Particles::Lattice { lattice, .. } = &whole.particles else {
        panic!("a lattice");
    };
    let [x, y, z] = lattice.dims;
    let runs = (13 * rank..z).step_by(13 * size);
    let runs: Vec<_> = runs.map(|first| first..(first + 13).min(z)).collect();
    let cells = runs
        .iter()
        .flat_map(|run| run.start * x * y..run.end * x * y);
    let Some(Values::U8(values)) = &whole.values else {
        panic!("bytes");
    };
    let part = PointVolume {
        values: Some(Values::U8(cells.map(|cell| values[cell]).collect())),
        ..whole.clone()
    };
    Share {
        volumes: vec![part],
        numbers: None,
        planes: Some(vec![runs]),
    }
}

fn frames() -> Vec<(Camera, Settings)> {
    let camera = |eye: DVec3| Camera::perspective(eye, DVec3::ZERO, DVec3::Y, 40.0, [90, 70]);
    let near = camera(DVec3::new(1.0, 1.5, -3.0));
    let depths = Settings {
        depth: true,
        ..Settings::default()
    };
    let clip = vec![ClipPlane {
        normal: DVec3::new(0.3, 0.2, 1.0),
        distance: 0.1,
    }];
    let thickness = Some(0.2);
    let in_slabs = Settings {
        composite: Composite::Slabs { thickness },
        classify: Classification::Slab,
        ..Settings::default()
    };
    let clipped = Settings {
        clip,
        ..depths.clone()
    };
    vec![
        (near.clone(), depths.clone()),
        (near.clone(), clipped),
        (near, in_slabs),
        // The camera is inside.
        (camera(DVec3::new(0.1, 0.2, 0.7)), depths),
    ]
}

/// Checks that every rank has about its share of the values, and all blocks.
fn assert_even(stats: &[RankStats], count: usize) {
    let own: Vec<usize> = stats.iter().map(|s| s.particles as usize).collect();
    assert_eq!(own.iter().sum::<usize>(), count);
    let most = own.iter().max().copied().unwrap_or(0);
    // Ranks may differ by a run of 32 planes of 202.
    assert!(most <= count / own.len() + count / 5, "{own:?}");
}

#[test]
fn planes_wherever_they_are_make_the_picture_of_all() {
    let whole = box_of(DIMS);
    let expected = alone(std::slice::from_ref(&whole), &frames());
    assert!(expected[0].counts.pieces > 0 && expected[0].shown() > 1000);
    assert!(expected[1].shown() > 500 && expected[2].shown() > 1000);
    // Shells are hardly merged; a haze is.
    let haze = TransferFunction::from_curves(|_| [0.9, 0.5, 0.3], |_| 0.01, [0.0, 255.0], 0.1);
    let hazy = PointVolume {
        transfer_function: Some(haze.unwrap()),
        ..whole.clone()
    };
    let far = [-30.0, 300.0].map(|z| {
        let camera = Camera::perspective(DVec3::Z * z, DVec3::ZERO, DVec3::Y, 40.0, [90, 70]);
        (camera, Settings::default())
    });
    let expected_far = alone(std::slice::from_ref(&hazy), &far);
    assert!(expected_far.iter().all(|frame| frame.shown() > 0));
    assert!(expected_far[1].counts.blocks_merged > 0);
    let mut one = ewa_splat::Renderer::new(vec![whole.clone()]).unwrap();
    let count = one.particle_count();
    let camera = Camera::orthographic(DVec3::Z * -4.0, DVec3::ZERO, DVec3::Y, 3.0, [80, 60]);
    let column_settings = ColumnSettings::default();
    let column = one.column_density(&camera, &column_settings).unwrap();
    let mut bytes = Vec::new();
    for size in [1, 2, 3] {
        let found = each(size, |rank| {
            let share = share(&whole, rank.rank(), size);
            let mut renderer = Renderer::new(rank, share, &SceneOptions::default()).unwrap();
            let own = renderer.column_density(&camera, &column_settings);
            let own = own.unwrap().cloned();
            (own, drawn(renderer, &frames()))
        });
        let (own, (pictures, stats)) = &found[0];
        assert!(own.as_ref() == Some(column), "{size} ranks");
        for (n, (found, expected)) in pictures.iter().zip(&expected).enumerate() {
            assert_eq!(found.counts, expected.counts, "frame {n} of {size} ranks");
            assert!(found == expected, "frame {n} of {size} ranks");
        }
        assert_eq!(pictures.len(), expected.len());
        let found_far = each(size, |rank| {
            let share = share(&hazy, rank.rank(), size);
            let renderer = Renderer::new(rank, share, &SceneOptions::default());
            drawn(renderer.unwrap(), &far).0
        });
        assert!(found_far[0] == expected_far, "{size} ranks");
        assert_even(stats, count);
        bytes.push(stats.iter().map(|s| s.bytes).max().unwrap());
    }
    // Bytes of cells are shared; every rank has the blocks' bounds and the coarser grids.
    let saved = (bytes[0] - bytes[2]) as usize;
    assert!(saved > count / 2 && saved < count, "{bytes:?} of {count}");
}

/// The lattice is drawn beside other volumes, or is so small that every rank has all of it.
#[test]
fn planes_lie_beside_points_and_small_lattices_go_to_all() {
    for dims in [DIMS, [9, 8, 40]] {
        let scene = [ball(500, 0.5), box_of(dims), spheres(800)];
        let frames = [frames().swap_remove(0)];
        let expected = alone(&scene, &frames);
        let found = each(2, |rank| {
            let (own, size) = (rank.rank(), rank.size());
            let mut share = share(&scene[1], own, size);
            let planes = share.planes.take().unwrap().swap_remove(0);
            let nobody = vec![0; 0];
            let points = |volume: &PointVolume| match own {
                0 => volume.clone(),
                _ => crate::shares::taken(volume, &nobody),
            };
            share.volumes.insert(0, points(&scene[0]));
            share.volumes.push(points(&scene[2]));
            share.planes = Some(vec![Vec::new(), planes, Vec::new()]);
            let renderer = Renderer::new(rank, share, &SceneOptions::default());
            drawn(renderer.unwrap(), &frames).0
        });
        assert!(found[0] == expected, "{dims:?}");
    }
}
