//! Tests scenes of so many particles that no rank makes the blocks of all of them.

use std::path::Path;

use ewa_splat::distributed::{Collective, RankStats, Renderer, Share};
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::prepared::PointFile;
use ewa_splat::sample::{PurposeOptions, SampleOptions, scene};
use ewa_splat::view::{Camera, sphere_around};
use ewa_splat::{ColumnSettings, SceneOptions, Settings};
use glam::DVec3;

use crate::common::Random;
use crate::ranks::{alone, drawn, each};
use crate::scenes::{ball, lattice, spheres};
use crate::shares::taken;

/// More than 262,144 for each of two ranks.
const MANY: usize = 600_000;

fn frames() -> Vec<(Camera, Settings)> {
    let camera = |z: f64| Camera::perspective(DVec3::Z * z, DVec3::ZERO, DVec3::Y, 30.0, [100, 80]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    [-4.0, 2000.0].map(|z| (camera(z), settings.clone())).into()
}

/// Checks that no rank of two has much more than half of the particles.
fn assert_even(stats: &[RankStats], count: usize) {
    let own: Vec<usize> = stats.iter().map(|s| s.particles as usize).collect();
    assert_eq!(own.iter().sum::<usize>(), count);
    let most = own.iter().max().copied().unwrap_or(0);
    assert!(most <= count / own.len() + (1 << 16), "{own:?}");
}

#[test]
fn many_particles_wherever_they_are() {
    let many = spheres(MANY);
    // Beside them are a few particles, whose blocks each rank makes, and a lattice, which every
    // rank has whole.
    let whole = [ball(500, 0.5), many, lattice(6)];
    let expected = alone(&whole, &frames());
    assert!(expected[0].shown() > 500 && expected[1].counts.blocks_merged > 0);
    let alone = ewa_splat::Renderer::new(whole.to_vec()).unwrap();
    let count = alone.particle_count();
    for size in [1, 2] {
        let found = each(size, |rank| {
            let mut random = Random::new(3);
            let mut orders: [Vec<u32>; 3] = Default::default();
            for (volume, order) in whole.iter().zip(&mut orders) {
                let all = 0..volume.particles.len() as u32;
                order.extend(all.filter(|_| random.index(size) == rank.rank()));
                order.reverse();
            }
            let volumes = whole.iter().zip(&orders).map(|(v, own)| taken(v, own));
            let share = Share {
                volumes: volumes.collect(),
                numbers: Some(
                    orders
                        .map(|own| own.into_iter().map(u64::from).collect())
                        .into(),
                ),
                planes: None,
            };
            drawn(
                Renderer::new(rank, share, &SceneOptions::default()).unwrap(),
                &frames(),
            )
        });
        let (pictures, stats) = &found[0];
        assert!(*pictures == expected, "{size} ranks");
        assert_even(stats, count);
    }
}

/// Writes a table of x, y, z, sigma and mass; some rows are not valid particles.
fn write_table(path: &Path, rows: usize) {
    let mut random = Random::new(11);
    let columns = ["x", "y", "z", "sigma", "mass"].map(|name| format!("('{name}', '<f4')"));
    let header = format!(
        "{{'descr': [{}], 'fortran_order': False, 'shape': ({rows},), }}",
        columns.join(", ")
    );
    let mut bytes = b"\x93NUMPY\x01\x00\xf6\x00".to_vec();
    bytes.extend(format!("{header:<245}\n").bytes());
    for row in 0..rows {
        let p = random.point(1.0).as_vec3();
        let sigma = random.range(0.001, 0.01) as f32;
        let numbers = match row % 10_007 {
            3 => [f32::NAN, p.y, p.z, sigma, 1e-5],
            4 => [p.x, p.y, p.z, -1.0, 1e-5],
            _ => [p.x, p.y, p.z, sigma, 1e-5 * (1.0 + p.x.abs())],
        };
        bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn ranks_read_their_rows_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.npy");
    write_table(&path, MANY);
    let options = SampleOptions::default();
    let data = open(&path, &OpenOptions::default()).unwrap();
    let (up, bounds) = (data.up(), data.bounds());
    let whole = scene(data, &options).unwrap();
    assert!(whole.report.left_out_count() > 100);
    let expected = alone(&whole.volumes, &frames());
    assert!(expected[0].shown() > 500);
    let count = whole.volumes[0].particles.len();
    for size in [1, 2, 3] {
        let found = each(size, |rank| {
            let mut file = PointFile::open(&path, None, &options).unwrap().unwrap();
            let made = Renderer::of_file(rank, &mut file, &SceneOptions::default());
            // The report is about all particles of the file, on every rank.
            let report = file.report().unwrap();
            assert_eq!(report.particle_count, whole.report.particle_count);
            assert_eq!(report.sample_count, whole.report.sample_count);
            assert_eq!((file.up(), file.bounds()), (up, bounds));
            drawn(made.unwrap(), &frames())
        });
        let (pictures, stats) = &found[0];
        assert!(*pictures == expected, "{size} ranks");
        assert_even(stats, count);
    }
}

/// For few particles, each rank makes the blocks of all: in one file and in several, with sums of
/// values.
#[test]
fn ranks_read_their_rows_of_snapshots() {
    let options = SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            local_models: false,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for name in ["gadget_old.h5", "split/snap_010.1.hdf5"] {
        let path = fixtures.join(name);
        let whole = scene(open(&path, &OpenOptions::default()).unwrap(), &options).unwrap();
        let mut renderer = ewa_splat::Renderer::new(whole.volumes).unwrap();
        let boxes = renderer.boxes();
        let (middle, radius) = sphere_around(&boxes).unwrap();
        let eye = middle + DVec3::Z * (2.0 * radius);
        let camera = Camera::orthographic(eye, middle, DVec3::Y, 2.0 * radius, [40, 40]);
        let settings = ColumnSettings::default();
        let expected = renderer.column_density(&camera, &settings).unwrap().clone();
        assert!(expected.values.iter().any(|v| *v > 0.0));
        // Some files have fewer rows than there are ranks.
        for size in [1, 2, 7] {
            let found = each(size, |rank| {
                let mut file = PointFile::open(&path, None, &options).unwrap().unwrap();
                let made = Renderer::of_file(rank, &mut file, &SceneOptions::default());
                let mut renderer = made.unwrap();
                renderer
                    .column_density(&camera, &settings)
                    .unwrap()
                    .cloned()
            });
            assert_eq!(found[0].as_ref(), Some(&expected), "{name}, {size} ranks");
        }
    }
}

#[test]
fn a_file_that_is_cut_while_ranks_read_it_is_refused_by_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.npy");
    write_table(&path, 1000);
    let found = each(3, |rank| {
        let options = SampleOptions::default();
        let mut file = PointFile::open(&path, None, &options).unwrap().unwrap();
        let mut ranks = rank;
        // All ranks have opened the file by now.
        ranks.gather(&[]).unwrap();
        if ranks.rank() == 0 {
            let cut = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            cut.set_len(12_000).unwrap();
        }
        ranks.gather(&[]).unwrap();
        Renderer::of_file(ranks, &mut file, &SceneOptions::default()).map(|_| ())
    });
    for result in found {
        let said = result.unwrap_err().to_string();
        assert!(said.contains("points.npy"), "{said}");
    }
}
