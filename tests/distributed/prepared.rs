//! Tests prepared scenes that all ranks have mapped.

use ewa_splat::prepared::{About, PreparedScene};
use ewa_splat::scene::PointVolume;
use ewa_splat::view::Camera;
use ewa_splat::{ColumnSettings, SceneOptions, Settings, distributed};
use glam::DVec3;

use crate::ranks::{SIZES, alone, drawn, each};
use crate::scenes::{ball, ellipsoids, lattice, spheres};

#[test]
fn ranks_map_one_file_and_draw_what_one_machine_draws() {
    let scene: Vec<PointVolume> = vec![spheres(4000), ellipsoids(900), lattice(9), ball(500, 0.5)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.arrow");
    let prepared = PreparedScene::new(scene.clone(), &SceneOptions::default()).unwrap();
    prepared.write(&path, &About::default()).unwrap();
    let camera = |z: f64| Camera::perspective(DVec3::Z * z, DVec3::ZERO, DVec3::Y, 40.0, [90, 70]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    let frames = [-4.0, 60.0].map(|z| (camera(z), settings.clone()));
    let expected = alone(&scene, &frames);
    assert!(expected[0].shown() > 500);
    let mut bytes_of_one = 0;
    for size in SIZES {
        let open = |rank| {
            let mapped = PreparedScene::open(&path).unwrap().0;
            distributed::Renderer::of_prepared(rank, vec![mapped]).unwrap()
        };
        let mut all = each(size, |rank| drawn(open(rank), &frames));
        let (found, stats) = all.swap_remove(0);
        assert!(found == expected, "{size} ranks");
        let bytes: u64 = stats.iter().map(|s| s.bytes).sum();
        let particles: u64 = stats.iter().map(|s| s.particles).sum();
        assert_eq!(particles as usize, prepared.particle_count());
        if size == 1 {
            bytes_of_one = bytes;
        }
        // Each rank has all blocks and the lattice, which take less than half of this scene's
        // memory.
        assert!(
            bytes <= bytes_of_one * (1 + size as u64 / 2),
            "{size} ranks: {bytes}"
        );
    }
}

#[test]
fn columns_of_mapped_particles_are_those_of_one_machine() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.arrow");
    let scene = vec![spheres(3000)];
    let prepared = PreparedScene::new(scene.clone(), &SceneOptions::default()).unwrap();
    prepared.write(&path, &About::default()).unwrap();
    let camera = Camera::orthographic(DVec3::NEG_Z * 4.0, DVec3::ZERO, DVec3::Y, 3.0, [60, 60]);
    let settings = ColumnSettings::default();
    let mut renderer = ewa_splat::Renderer::new(scene).unwrap();
    let expected = renderer.column_density(&camera, &settings).unwrap().clone();
    let amplitudes = renderer.amplitudes();
    for size in SIZES {
        let all = each(size, |rank| {
            let mapped = PreparedScene::open(&path).unwrap().0;
            let mut renderer = distributed::Renderer::of_prepared(rank, vec![mapped]).unwrap();
            // The file stores these counts; no rank counts again.
            assert_eq!(renderer.amplitudes(), amplitudes);
            renderer
                .column_density(&camera, &settings)
                .unwrap()
                .cloned()
        });
        assert_eq!(all[0].as_ref(), Some(&expected), "{size} ranks");
    }
}
