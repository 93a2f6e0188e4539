//! Damaged files: every reader answers, with a data set or with an error, and never panics.
//!
//! Small files of every format are cut, flipped and spliced. `EWA_BAD_INPUT_SCALE` multiplies
//! the number of cases.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

mod support;

use std::sync::OnceLock;

use ewa_splat::Error;
use ewa_splat::image::Image;
use ewa_splat::io::{OpenOptions, RawLayout, RawType, open, read_image, write_image};
use proptest::prelude::*;
use support::damage::{apply, damage};
use support::{Plot3dBlock, Plot3dEncoding, VtkEncoding, VtkPiece};

/// Names and contents of sound files.
fn seeds() -> &'static [(String, Vec<u8>)] {
    static SEEDS: OnceLock<Vec<(String, Vec<u8>)>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let mut seeds = Vec::new();
        for encoding in VtkEncoding::all() {
            let whole = VtkPiece {
                extent: "0 2 0 2 0 1",
                point_data: vec![
                    support::float32("a", 1, &[0.5; 18]),
                    support::int16("b", 3, &[7; 54]),
                ],
                cell_data: vec![support::uint8("c", 1, &[1, 2, 3, 4])],
            };
            let attributes = "WholeExtent=\"0 2 0 2 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"";
            seeds.push(("a.vti".into(), support::vti(encoding, attributes, &[whole])));
            let half = |extent| VtkPiece {
                extent,
                point_data: vec![support::uint16("a", 1, &[1, 2, 3, 4])],
                cell_data: vec![],
            };
            let halves = [half("0 1 0 1 0 0"), half("1 2 0 1 0 0")];
            let attributes = "WholeExtent=\"0 2 0 1 0 0\"";
            seeds.push(("b.vti".into(), support::vti(encoding, attributes, &halves)));
        }
        for encoding in Plot3dEncoding::all() {
            let coordinates: Vec<f64> = (0..24).map(f64::from).collect();
            seeds.push(("a.xyz".into(), encoding.grid([2, 2, 2], &coordinates, None)));
            seeds.push((
                "a.xyz".into(),
                encoding.grid([2, 2, 2], &coordinates, Some(&[1; 8])),
            ));
            seeds.push(("a.q".into(), encoding.solution([2, 2, 2], &[1.0; 40])));
            if encoding.grid_count {
                let block = |dims: [i32; 3]| Plot3dBlock {
                    dims,
                    numbers: (0..3 * dims.iter().product::<i32>())
                        .map(f64::from)
                        .collect(),
                    iblank: vec![],
                };
                let two = [block([2, 3, 2]), block([3, 2, 2])];
                seeds.push(("b.xyz".into(), encoding.grids(&two)));
            }
        }
        for name in ["gadget_old", "gadget_old_packed", "swift", "phantom"] {
            let name = format!("{name}.h5");
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
            let bytes = std::fs::read(path.join(&name)).unwrap();
            for _ in 0..8 {
                seeds.push((name.clone(), bytes.clone()));
            }
        }
        for _ in 0..16 {
            let plain = "{'descr': '>f8', 'fortran_order': True, 'shape': (3, 4), }    \n";
            seeds.push(("a.npy".into(), support::npy(1, plain, &[1; 96])));
            let named = "{'descr': [('x', '<f4'), ('y', '<f4'), ('z', '<f8'), ('v', '<i2', (2,)), \
                         ('', '|V4')], 'fortran_order': False, 'shape': (3,), }\n";
            seeds.push(("b.npy".into(), support::npy(2, named, &[2; 72])));
            let at = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3), }    \n";
            let mass = "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }     \n";
            let arrays = [
                ("pos.npy", support::npy(1, at, &[1; 72])),
                ("mass.npy", support::npy(1, mass, &[1; 12])),
            ];
            seeds.push(("a.npz".into(), support::npz(&arrays, true)));
            seeds.push(("b.npz".into(), support::npz(&arrays, false)));
            let text = b"# made\nx,y,z,h,name\n1,2,3,0.5,a\n4,5,6,nan,\"b\"\n7,8,9,,c\n";
            seeds.push(("a.csv".into(), text.to_vec()));
            seeds.push(("volume_4x4x4_uint8.raw".into(), vec![3; 64]));
        }
        seeds
    })
}

/// Names and contents of sound images.
fn image_seeds() -> &'static [(String, Vec<u8>)] {
    static SEEDS: OnceLock<Vec<(String, Vec<u8>)>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut image = Image::new(7, 5);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [0.01 * i as f32, 0.5, 0.0, 1.0];
        }
        ["a.png", "a.exr", "a.pfm", "a.npy"]
            .map(|name| {
                let path = folder.path().join(name);
                write_image(&path, &image).unwrap();
                (name.to_owned(), std::fs::read(&path).unwrap())
            })
            .into()
    })
}

/// An error must name what it found and what to do; a panic fails the test by itself.
fn check(result: Result<(), Error>) {
    if let Err(error) = result {
        let text = error.to_string();
        assert!(text.contains("; "), "no advice: {text}");
        assert!(text.len() < 4000, "too long: {text}");
    }
}

fn scaled(cases: u32) -> ProptestConfig {
    let scale = std::env::var("EWA_BAD_INPUT_SCALE")
        .ok()
        .and_then(|s| s.parse().ok());
    ProptestConfig {
        cases: cases * scale.unwrap_or(1),
        // The seeds are in the test itself.
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(scaled(1600))]

    #[test]
    fn damaged_data_files_are_answered(
        seed in any::<prop::sample::Index>(),
        damages in prop::collection::vec(damage(), 1..4),
        with_layout in prop::bool::weighted(0.1),
    ) {
        let (name, bytes) = seed.get(seeds());
        let mut bytes = bytes.clone();
        damages.iter().for_each(|d| apply(&mut bytes, d));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let mut options = OpenOptions::default();
        if with_layout || name.ends_with(".raw") {
            options.raw = Some(RawLayout::new([4, 4, 4], RawType::U8));
        }
        if name == "a.q" {
            // A sound grid beside the damaged solution.
            let (_, grid) = seeds().iter().find(|(n, _)| n == "a.xyz").unwrap();
            let grid_path = folder.path().join("a.xyz");
            std::fs::write(&grid_path, grid).unwrap();
            check(open(&grid_path, &options).map(drop));
        }
        let answer = open(&path, &options);
        if let Ok(data) = &answer {
            for name in data.field_names() {
                prop_assert!(data.scalar(name).is_ok());
            }
        }
        check(answer.map(drop));
    }
}

proptest! {
    #![proptest_config(scaled(400))]

    #[test]
    fn damaged_images_are_answered(
        seed in any::<prop::sample::Index>(),
        damages in prop::collection::vec(damage(), 1..4),
    ) {
        let (name, bytes) = seed.get(image_seeds());
        let mut bytes = bytes.clone();
        damages.iter().for_each(|d| apply(&mut bytes, d));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        check(read_image(&path).map(drop));
    }
}

#[test]
fn the_sound_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in seeds() {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let raw = Some(RawLayout::new([4, 4, 4], RawType::U8)).filter(|_| name.ends_with(".raw"));
        let answer = open(
            &path,
            &OpenOptions {
                raw,
                solution: None,
            },
        );
        assert_eq!(answer.is_err(), name == "a.q", "{name}: {answer:?}");
        std::fs::remove_file(&path).unwrap();
    }
}

/// Opening a pipe would wait for a writer for ever.
#[cfg(unix)]
#[test]
fn devices_are_refused_before_they_are_opened() {
    for device in ["/dev/zero", "/dev/null"] {
        let path = std::path::Path::new(device);
        assert!(open(path, &OpenOptions::default()).is_err());
    }
    assert!(read_image(std::path::Path::new("/dev/zero")).is_err());
}

/// Deep nesting must not exhaust the stack.
#[test]
fn deeply_nested_xml_is_answered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.vti");
    let deep = "<a>".repeat(200_000) + &"</a>".repeat(200_000);
    let text = format!("<VTKFile type=\"ImageData\">{deep}</VTKFile>");
    std::fs::write(&path, text).unwrap();
    check(open(&path, &OpenOptions::default()).map(drop));
}
