//! Tests TIFF stacks that tifffile wrote, and NRRD compressed by bzip2. Sample (i, j, k) is
//! `1000 k + 100 j + i`.

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, open};
use ewa_splat::scene::{Lattice, Values};
use glam::DVec3;

use crate::support::Folder;

fn bytes(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    std::fs::read(path.join(name)).unwrap()
}

fn fixture(name: &str) -> Dataset {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    open(&path.join(name), &OpenOptions::default()).unwrap()
}

fn lattice(data: &Dataset) -> &Lattice {
    match &data.geometry {
        Geometry::Lattice(lattice) => lattice,
        _ => panic!("no lattice"),
    }
}

fn check(values: &Values, [x, y, z]: [usize; 3], number: impl Fn([usize; 3]) -> f32) {
    assert_eq!(values.len(), x * y * z);
    for i in 0..values.len() {
        let at = [i % x, i / x % y, i / (x * y)];
        assert_eq!(values.get(i), number(at), "{at:?}");
    }
}

fn sample([i, j, k]: [usize; 3]) -> f32 {
    (1000 * k + 100 * j + i) as f32
}

#[test]
fn stacks_are_what_tifffile_wrote() {
    let dims = [6, 5, 4];
    for name in ["stack_lzw.tif", "stack_bzip2.nrrd"] {
        let data = fixture(name);
        assert_eq!(lattice(&data).dims, dims, "{name}");
        let (_, values) = data.scalar("value").unwrap();
        assert!(matches!(values, Values::U16(_)), "{name}");
        check(&values, dims, sample);
    }
    let (_, values) = fixture("stack_deflate.tif").scalar("value").unwrap();
    check(&values, dims, |at| sample(at) / 8.0);
    // Tiles of 32-bit integers in BigTIFF, with each sample repeated four times along x and y.
    let data = fixture("stack_tiled.tif");
    let (_, values) = data.scalar("value").unwrap();
    check(&values, [24, 20, 4], |[i, j, k]| {
        sample([i / 4, j / 4, k]) - 1500.0
    });
    let data = fixture("picture.tif");
    assert_eq!(lattice(&data).dims, [6, 5, 1]);
    let (_, green) = data.scalar("value:1").unwrap();
    check(&green, [6, 5, 1], |[_, j, _]| 50.0 * j as f32);
}

#[test]
fn image_j_says_channels_and_spacing() {
    let data = fixture("stack_imagej.tif");
    let lattice = lattice(&data);
    assert_eq!(lattice.dims, [6, 5, 4]);
    assert_eq!(lattice.position([1, 1, 1]), DVec3::new(0.25, 0.5, 1.5));
    assert_eq!(data.field_names(), ["channel 1", "channel 2"]);
    let (_, second) = data.scalar("channel 2").unwrap();
    check(&second, [6, 5, 4], |at| sample(at) + 5.0);
}

#[test]
fn damaged_stacks_are_refused() {
    let folder = Folder::new();
    let sound = bytes("stack_lzw.tif");
    let said = folder.refuse("a.tif", &sound[..sound.len() / 2]);
    assert!(said.contains("pages"), "{said}");
    let packed = bytes("stack_bzip2.nrrd");
    let said = folder.refuse("a.nrrd", &packed[..packed.len() - 60]);
    assert!(said.contains("numbers"), "{said}");
}
