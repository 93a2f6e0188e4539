//! Tests inputs that ranks load by the call that loads them in one process.

use std::path::Path;

use ewa_splat::distributed::{Alone, Renderer};
use ewa_splat::io::OpenOptions;
use ewa_splat::load::{Input, Request, load};
use ewa_splat::prepared::{About, PreparedScene};
use ewa_splat::sample::SampleOptions;
use ewa_splat::sample::mesh::Spread;
use ewa_splat::view::{Camera, sphere_around};
use ewa_splat::{SceneOptions, Settings};
use glam::DVec3;

use crate::ranks::{drawn, drawn_alone, each};

/// Loads inputs in one process and on three ranks, and asserts that the frames are the same. Returns the number of
/// particles in one process, and the number that each rank has loaded.
fn assert_same(inputs: &[Input]) -> (usize, Vec<usize>) {
    assert_same_by(inputs, &SampleOptions::default(), 3)
}

/// Does the same on `size` ranks, with sampling options.
fn assert_same_by(inputs: &[Input], sample: &SampleOptions, size: usize) -> (usize, Vec<usize>) {
    let open = OpenOptions::default();
    let request = || Request::new(inputs, &open, sample);
    let count = |scene: &ewa_splat::load::Loaded| {
        let volumes = scene.volumes.iter();
        volumes.map(|volume| volume.particles.len()).sum()
    };
    let mut whole = load(&request(), &mut Alone::default()).unwrap();
    let (particles, bounds, fields) = (count(&whole), whole.bounds(), whole.fields.clone());
    let alone = whole.renderer(&SceneOptions::default()).unwrap();
    let (middle, radius) = sphere_around(&alone.boxes()).unwrap();
    let eye = middle + DVec3::new(0.6, -2.4, 1.0) * radius;
    let camera = Camera::perspective(eye, middle, DVec3::Z, 40.0, [80, 60]);
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    let frames = [(camera, settings)];
    let expected = drawn_alone(alone, &frames);
    assert!(expected[0].shown() > 500);
    let all = each(size, |mut rank| {
        let scene = load(&request(), &mut rank).unwrap();
        assert_eq!((scene.bounds(), &scene.fields), (bounds, &fields));
        let own = count(&scene);
        let renderer = Renderer::of_loaded(rank, scene, &SceneOptions::default()).unwrap();
        (own, drawn(renderer, &frames).0)
    });
    assert!(all[0].1 == expected, "{inputs:?}");
    (particles, all.into_iter().map(|(own, _)| own).collect())
}

fn fixture(name: &str) -> Input {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    Input::file(fixtures.join(name))
}

/// Returns an input that shows a field of cells.
fn field(name: &str) -> Input {
    Input {
        field: Some("load".into()),
        ..fixture(name)
    }
}

#[test]
fn each_rank_reads_a_part_of_a_grid_in_pieces() {
    for input in [field("pieces/duct.pvtu"), fixture("pieces/horn.pvts")] {
        let (whole, own) = assert_same(std::slice::from_ref(&input));
        assert_eq!(own.iter().sum::<usize>(), whole, "{input}");
        assert!(own.iter().all(|own| (1..whole).contains(own)), "{input}");
    }
}

#[test]
fn ranks_load_several_inputs_and_inputs_that_one_rank_reads() {
    assert_same(&[field("pieces/duct_0.vtu"), fixture("particles.csv")]);
    // The boundary of a field of nodes is cut, for which one rank reads all pieces.
    assert_same(&[fixture("pieces/duct.pvtu")]);
    assert_same(&[fixture("wake.xyz")]);
}

#[test]
fn boundaries_alone_and_around_volumes_are_the_same_on_ranks() {
    // Few surfels: ranks on a software adapter are slow.
    let mut options = SampleOptions::default();
    options.kernels.spread = Spread::Count(3000);
    let alone = SampleOptions {
        surface: Some(1.0),
        ..options.clone()
    };
    for size in 1..=3 {
        for name in ["pieces/duct.pvtu", "pieces/horn.pvts", "wake.xyz"] {
            assert_same_by(&[fixture(name)], &alone, size);
        }
        let around = [fixture("wake.xyz"), fixture("wake.xyz").of_surface(0.4)];
        assert_same_by(&around, &options, size);
    }
}

#[test]
fn every_rank_maps_a_prepared_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wake.arrow");
    let inputs = [fixture("wake.xyz")];
    let (open, sample) = (OpenOptions::default(), SampleOptions::default());
    let request = Request::new(&inputs, &open, &sample);
    let scene = load(&request, &mut Alone::default()).unwrap();
    let fields = (scene.fields, scene.titles);
    let prepared = PreparedScene::new(scene.volumes, &SceneOptions::default()).unwrap();
    let about = About {
        fields: fields.0,
        titles: fields.1,
        up: DVec3::Z.to_array(),
        ..About::default()
    };
    prepared.write(&path, &about).unwrap();
    assert_same(&[Input::file(path)]);
}
