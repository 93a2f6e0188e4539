//! Tests `--projection`: panoramas, all-sky maps, pictures of lenses.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::read_image;

use crate::commands::{run, text};

/// Writes a large sphere and the camera's files.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // One kernel beside the axis: at (.5, -.4, 1) for a camera that looks along z with y down.
    write("one.csv", "x,y,z,radius,mass\n5,-4,10,0.06,0.3\n");
    write("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n");
    write(
        "cameras.txt",
        "1 OPENCV 640 480 500 510 320 240 -.28 .09 .001 -.002\n",
    );
    folder
}

/// Runs `render` in a folder and returns whether it succeeded, and its messages.
fn render(folder: &Path, line: &str) -> (bool, String) {
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(
        folder,
        &[&["render"], words.as_slice(), &["--backend", "cpu"]].concat(),
    );
    (output.status.success(), text(&output.stderr))
}

/// Returns the middle of the opacity of a picture, pixels.
fn middle(path: &Path) -> [f64; 2] {
    let image = read_image(path).unwrap();
    let mut sums = [0.0; 3];
    for (i, pixel) in image.pixels.iter().enumerate() {
        let [x, y] = [i % image.width, i / image.width].map(|n| n as f64 + 0.5);
        let alpha = f64::from(pixel[3]);
        sums = [sums[0] + alpha * x, sums[1] + alpha * y, sums[2] + alpha];
    }
    [sums[0] / sums[2], sums[1] / sums[2]]
}

#[test]
fn pictures_are_those_of_lenses() {
    let folder = folder();
    let draw = |options: &str| {
        let line = format!("one.csv --camera . {options} --out a.npy");
        let (is_done, said) = render(folder.path(), &line);
        assert!(is_done, "{said}");
        (middle(&folder.path().join("a.npy")), said)
    };
    // The pixel at which pycolmap 4.2 sees the direction.
    let ([x, y], said) = draw("--projection lens");
    assert!(
        (x - 543.972).abs() < 0.2 && (y - 57.113).abs() < 0.2,
        "{x} {y}"
    );
    assert!(!said.contains("lens"), "{said}");
    let ([x, y], said) = draw("");
    assert!((x - 570.0).abs() < 0.2 && (y - 36.0).abs() < 0.2, "{x} {y}");
    assert!(said.contains("--projection lens"), "{said}");
    let fisheye = "1 OPENCV_FISHEYE 640 480 300 310 320 240 .05 -.01 .002 -.0001\n";
    std::fs::write(folder.path().join("cameras.txt"), fisheye).unwrap();
    let ([x, y], _) = draw("");
    assert!(
        (x - 455.452).abs() < 0.2 && (y - 128.026).abs() < 0.2,
        "{x} {y}"
    );
}

#[test]
fn panoramas_are_taken_from_the_eye() {
    let folder = folder();
    let draw = |options: &str| {
        let line = format!("one.csv --eye 0,0,0 --up 0,-1,0 {options} --out a.npy");
        let (is_done, said) = render(folder.path(), &line);
        assert!(is_done, "{said}");
        middle(&folder.path().join("a.npy"))
    };
    // Longitude and latitude of (.5, -.4, 1), y being down.
    let (longitude, latitude) = (0.5_f64.atan(), 0.4_f64.atan2(1.25_f64.sqrt()));
    let at = |turn: f64, share: f64| turn * share / std::f64::consts::PI;
    let [x, y] = draw("--target 0,0,1 --projection equirect --size 400x200");
    assert!((x - 200.0 - at(longitude, 200.0)).abs() < 0.1, "{x}");
    assert!((y - 100.0 + at(latitude, 200.0)).abs() < 0.1, "{y}");
    // The horizon is level.
    let tilted = draw("--target 0,-1,2 --projection equirect --size 400x200");
    assert!((tilted[1] - y).abs() < 1e-3, "{tilted:?}");
    let [x, y] = draw("--target 0,0,1 --projection dome --size 200x200");
    let (from, across) = (0.5_f64 / 0.4, 1.0_f64 / 0.4);
    let angle = from.hypot(across).atan();
    let radius = at(angle, 200.0);
    let length = from.hypot(across);
    assert!((x - 100.0 - radius * from / length).abs() < 0.2, "{x}");
    assert!((y - 100.0 - radius * across / length).abs() < 0.2, "{y}");
    let [x, y] = draw("--target 0,0,1 --projection cube --size 600x100");
    assert!(
        (x - 400.0 - 75.0).abs() < 0.1 && (y - 30.0).abs() < 0.1,
        "{x} {y}"
    );
}

#[test]
fn all_sky_maps_are_tables_of_pixels() {
    let folder = folder();
    let line = "one.csv --eye 0,0,0 --projection healpix --nside 8 --column-density --out a.fits";
    let (is_done, said) = render(folder.path(), line);
    assert!(is_done, "{said}");
    let bytes = std::fs::read(folder.path().join("a.fits")).unwrap();
    assert_eq!(bytes.len() % 2880, 0);
    let header = String::from_utf8_lossy(&bytes[2880..5760]).into_owned();
    for card in [
        "ORDERING= 'RING    '",
        "NSIDE   =                    8",
        "TTYPE1  = 'COLUMN  '",
    ] {
        assert!(header.contains(card), "{card}: {header}");
    }
    let value = |i: usize| f32::from_be_bytes(bytes[5760 + 4 * i..][..4].try_into().unwrap());
    let greatest = (0..768)
        .max_by(|a, b| value(*a).total_cmp(&value(*b)))
        .unwrap();
    // healpy 1.20: vec2pix(8, 5, -4, 10).
    assert_eq!(greatest, 81);
}

#[test]
fn what_a_projection_does_not_do_is_refused() {
    let folder = folder();
    for (options, expected) in [
        ("--projection equirect --fov 40", "--fov"),
        ("--projection cube --along x", "--along"),
        ("--projection cube --size 100x100", "six squares"),
        ("--projection equirect --axes", "--axes"),
        ("--projection equirect --measure-error", "--measure-error"),
        ("--projection equirect --show count", "--show count"),
        ("--projection equirect --nside 4", "--nside"),
        ("--projection dome --fisheye equisolid", "--fisheye"),
        ("--projection cube --fisheye-fov 90", "--fisheye-fov"),
        ("--projection fisheye --fisheye-fov 0", "degrees above 0"),
        ("--projection healpix --nside 3", "a power of two"),
        ("--projection healpix", "fits or npy"),
        ("--projection healpix --target 0,0,1", "--target"),
        ("--projection healpix --size 9x9", "--size"),
        ("--projection lens", "--camera"),
        ("--projection ortho --fov 40", "--fov"),
        ("--fisheye-fov 90", "--projection"),
        ("--stereo 1 --projection cube", "--stereo"),
        ("--stereo 1 --legend", "--stereo"),
    ] {
        let (is_done, said) = render(folder.path(), &format!("one.csv --out a.png {options}"));
        assert!(!is_done && said.contains(expected), "{options}: {said}");
        assert!(!folder.path().join("a.png").exists());
    }
    let (is_done, said) = render(
        folder.path(),
        "one.csv --stereo .5 --size 40x30 --out b.npy",
    );
    assert!(is_done, "{said}");
    let both = read_image(&folder.path().join("b.npy")).unwrap();
    assert_eq!([both.width, both.height], [40, 60]);
    let (is_done, said) = render(
        folder.path(),
        "one.csv --projection ortho --size 40x40 --out a.png",
    );
    assert!(is_done, "{said}");
}
