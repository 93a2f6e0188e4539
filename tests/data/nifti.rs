//! Tests NIfTI: both versions, in both byte orders and every type, give the original numbers and
//! what nibabel reads.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::scene::Values;
use glam::DVec3;

use crate::common::real_data;
use crate::support::images::{components, lattice, scalar};
use crate::support::nifti::Nifti;
use crate::support::{Folder, gzip};

/// Files of 2 x 3 x 4 that nibabel 5.4 wrote; n is the index in the file. One is NIfTI-2,
/// big-endian, with 3 n - 20 scaled to 1.5 n, placed by its sform. The other is NIfTI-1 with 3 n -
/// 20, placed by a quaternion and a mirror.
const SFORM: &str = "H4sIAAAAAAACA2NgYJLJ0zZi4OWS4mJgYRBggABmKM2ExmeB0owEaAxg/4EyGuocBfsHEJaDCsNQAIykarC/ORMEZu2/cwYMYOIHoP61v2wMBvaPwZQJTN7BBLt5B2DyYuR54P+b/+//f/r/9f+P/7///wP6h4WBnYGLgReYUoQZxBgkGWQY5BmUGFQZNBi0GfQYDAElrlYDUAIAAA==";
const QFORM: &str = "H4sIAAAAAAACA4thZCAKMDMwATELAyMUogIBBgUw3bAfSNgzMDgAMYMDkG+Pijc4Q+jBAZB9MfvFQjsGBoWDDAwLHIHudKDU7DxtQyhrAdDMDiBOAGIDIGYA2XEASB+AhgvQrgdArAC0NwCIG4B4BsgNQHwCiB8A8Q8g5nBiYBABYgUg1gFiCyB2cQIAiWgUi8ABAAA=";

#[test]
fn files_that_nibabel_wrote_have_its_positions_and_values() {
    let folder = Folder::new();
    for (text, factor, summand) in [(SFORM, 1.5, 0.0), (QFORM, 3.0, -20.0)] {
        let packed = STANDARD.decode(text).unwrap();
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(&packed[..])
            .read_to_end(&mut bytes)
            .unwrap();
        for (name, bytes) in [
            ("a.nii.gz", &packed),
            ("a.nii", &bytes),
            ("b", &packed),
            ("b", &bytes),
        ] {
            let data = folder.open(name, bytes);
            let expected = (0..24_u8).map(|n| factor * f32::from(n) + summand);
            assert_eq!(scalar(&data), Values::F32(expected.collect()));
            let lattice = lattice(&data);
            assert_eq!(lattice.dims, [2, 3, 4]);
            // Columns of nibabel's affine matrix; quaternions are stored in single precision.
            for (index, place) in [
                ([0, 0, 0], DVec3::new(-10.0, 20.0, 5.5)),
                ([1, 0, 0], DVec3::new(-9.6, 20.3, 5.5)),
                ([1, 2, 3], DVec3::new(-10.5, 21.5, -0.5)),
            ] {
                let found = lattice.position(index);
                assert!(found.distance(place) < 1e-6, "{found}");
            }
            assert!(data.notes.is_empty(), "{:?}", data.notes);
        }
    }
}

#[test]
fn every_type_gives_the_numbers() {
    let folder = Folder::new();
    macro_rules! check {
        ($t:ty, $code:literal, $expected:expr) => {
            let numbers = [1, 2, 3, 100].map(|n: u8| <$t>::try_from(n).unwrap());
            for version in [1, 2] {
                for big_endian in [false, true] {
                    let body = match big_endian {
                        false => numbers.map(|n| n.to_le_bytes()).concat(),
                        true => numbers.map(|n| n.to_be_bytes()).concat(),
                    };
                    let header = Nifti {
                        version,
                        big_endian,
                        ..Nifti::new($code, &[2, 2, 1])
                    };
                    let data = folder.open("a.nii", &header.file(&body));
                    assert_eq!(scalar(&data), $expected, "{header:?}");
                }
            }
        };
    }
    let floats = || Values::F32(vec![1.0, 2.0, 3.0, 100.0]);
    check!(u8, 2, Values::U8(vec![1, 2, 3, 100]));
    check!(i16, 4, Values::I16(vec![1, 2, 3, 100]));
    check!(i32, 8, floats());
    check!(f32, 16, floats());
    check!(f64, 64, floats());
    check!(i8, 256, Values::I16(vec![1, 2, 3, 100]));
    check!(u16, 512, Values::U16(vec![1, 2, 3, 100]));
    check!(u32, 768, floats());
    check!(i64, 1024, floats());
    check!(u64, 1280, floats());
    for (code, name, count) in [(128, "rgb", 3), (2304, "rgba", 4)] {
        let bytes: Vec<u8> = (0..4 * count).collect();
        // Colours are not scaled.
        let header = Nifti {
            slope: [2.0, 1.0],
            ..Nifti::new(code, &[2, 2, 1])
        };
        let data = folder.open("a.nii", &header.file(&bytes));
        assert_eq!(data.field_names(), [name]);
        let of = |c: u8| Values::U8((0..4).map(|i| count * i + c).collect());
        assert_eq!(components(&data), (0..count).map(of).collect::<Vec<_>>());
    }
    for (code, said) in [
        (32, "complex"),
        (1792, "complex"),
        (1536, "128"),
        (1, "bits"),
        (0, "found 0"),
        (-7, "found -7"),
    ] {
        let error = folder.refuse("a.nii", &Nifti::new(code, &[2, 2, 1]).file(&[0; 99]));
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn scales_positions_and_offsets_follow_the_header() {
    let folder = Folder::new();
    let bytes: Vec<u8> = (0..12).collect();
    let sound = Nifti::new(2, &[2, 3, 2]);
    let values = |header: &Nifti| scalar(&folder.open("a.nii", &header.file(&bytes)));
    for slope in [[0.0, 7.0], [f32::NAN, f32::NAN], [1.0, 0.0]] {
        assert_eq!(
            values(&Nifti {
                slope,
                ..sound.clone()
            }),
            Values::U8(bytes.clone())
        );
    }
    let scaled = values(&Nifti {
        slope: [0.5, -1.0],
        ..sound.clone()
    });
    assert_eq!(
        scaled,
        Values::F32((0..12_u8).map(|i| 0.5 * f32::from(i) - 1.0).collect())
    );
    let mut padded = sound.clone();
    padded.offset = 360.0;
    let data = folder.open("a.nii", &padded.file(&[&[9; 8], &bytes[..]].concat()));
    assert_eq!(scalar(&data), Values::U8(bytes.clone()));

    let place = |header: &Nifti| {
        let data = folder.open("a.nii", &header.file(&bytes));
        let lattice = lattice(&data);
        let first = lattice.position([0; 3]);
        (first, lattice.position([1; 3]) - first, data.notes.clone())
    };
    let v = DVec3::new;
    let spaced = Nifti {
        pixdim: [-1.0, 2.0, 3.0, -4.0],
        ..sound.clone()
    };
    assert_eq!(place(&spaced), (DVec3::ZERO, v(2.0, 3.0, 4.0), vec![]));
    // A half turn around z, whose quaternion has no real part, and a mirror.
    let pixdim = [-1.0, 2.0, 3.0, 4.0];
    let turned = Nifti {
        pixdim,
        qform: Some([0.0, 0.0, 1.0, 5.0, 6.0, 7.0]),
        ..sound.clone()
    };
    assert_eq!(
        place(&turned),
        (v(5.0, 6.0, 7.0), v(-2.0, -3.0, -4.0), vec![])
    );
    let rows = [2.0, 0.0, 0.0, 1.0, 0.0, 3.0, 0.0, 2.0, 0.0, 0.0, 4.0, 3.0];
    let both = Nifti {
        sform: Some(rows),
        ..turned.clone()
    };
    assert_eq!(place(&both), (v(1.0, 2.0, 3.0), v(2.0, 3.0, 4.0), vec![]));
    let (origin, step, notes) = place(&Nifti {
        sform: Some([0.0; 12]),
        ..turned
    });
    assert_eq!((origin, step), (v(5.0, 6.0, 7.0), v(-2.0, -3.0, -4.0)));
    assert!(notes[0].contains("sform"), "{notes:?}");

    for (header, said) in [
        (
            Nifti {
                slope: [1.0, f32::NAN],
                ..sound.clone()
            },
            "scl_inter",
        ),
        (
            Nifti {
                offset: 12.0,
                ..sound.clone()
            },
            "vox_offset",
        ),
        (
            Nifti {
                offset: f32::NAN,
                ..sound.clone()
            },
            "vox_offset",
        ),
        (
            Nifti {
                offset: 1e15,
                ..sound.clone()
            },
            "12 bytes",
        ),
        (
            Nifti {
                pixdim: [f32::NAN; 4],
                ..sound.clone()
            },
            "finite",
        ),
        (Nifti::new(2, &[2, 3, 3]), "18 bytes"),
        (Nifti::new(2, &[2, 3, -3]), "dim[3]"),
        (Nifti::new(2, &[32767; 7]), "memory"),
        (Nifti::new(2, &[32767; 3]), "35181150961663 bytes"),
        (Nifti::new(2, &[1; 8]), "dim[0]"),
        (Nifti::new(2, &[7]), "dim[0]"),
        (
            Nifti {
                attached: false,
                ..sound.clone()
            },
            "no file",
        ),
    ] {
        let error = folder.refuse("a.nii", &header.file(&bytes));
        assert!(error.contains(said), "{said}: {error}");
        let error = folder.refuse("a.nii.gz", &gzip(&header.file(&bytes)));
        let said = if said == "no file" || said.starts_with("12 b") {
            "found"
        } else {
            said
        };
        assert!(error.contains(said), "{said}: {error}");
    }
    for (name, bytes) in [
        ("a.nii", &[0; 600][..]),
        ("a.nii.gz", &gzip(&[0; 600])),
        ("a.nii", b"n"),
    ] {
        let error = folder.refuse(name, bytes);
        assert!(error.contains("a NIfTI header"), "{error}");
    }
    let mut turned_around = sound.file(&bytes);
    turned_around[0] = 1;
    assert!(
        folder
            .refuse("a.nii", &turned_around)
            .contains("sizeof_hdr")
    );
}

#[test]
fn times_and_vectors_are_told_apart() {
    let folder = Folder::new();
    let open = |sizes: &[i16]| {
        let count = sizes.iter().product::<i16>();
        let bytes: Vec<u8> = (0..count).map(|i| u8::try_from(i).unwrap()).collect();
        folder.open("a.nii", &Nifti::new(2, sizes).file(&bytes))
    };
    let run = |from: u8| Values::U8((from..from + 8).collect());
    let data = open(&[2, 2, 2, 3]);
    assert_eq!(
        (scalar(&data), data.notes),
        (run(0), vec!["The first of 3 volumes.".into()])
    );
    let data = open(&[2, 2, 2, 1, 3]);
    assert_eq!(
        (components(&data), data.notes.len()),
        (&[run(0), run(8), run(16)][..], 0)
    );
    let data = open(&[2, 2, 2, 2, 3]);
    assert_eq!(components(&data), [run(0), run(16), run(32)]);
    assert_eq!(data.notes, ["The first of 2 times."]);
    let data = open(&[4, 2]);
    assert_eq!((scalar(&data), lattice(&data).dims), (run(0), [4, 2, 1]));
}

#[test]
fn header_and_image_may_be_two_files() {
    let bytes: Vec<u8> = (0..12).collect();
    for version in [1, 2] {
        for (name, packed) in [("a.img", false), ("a.img.gz", true)] {
            let folder = Folder::new();
            let header = Nifti {
                version,
                attached: false,
                ..Nifti::new(2, &[2, 3, 2])
            };
            folder.file(name, &if packed { gzip(&bytes) } else { bytes.clone() });
            let data = folder.open("a.hdr", &header.file(&[]));
            assert_eq!(scalar(&data), Values::U8(bytes.clone()));
            let data = folder.open("a.hdr.gz", &gzip(&header.file(&[])));
            assert_eq!(scalar(&data), Values::U8(bytes.clone()));
            if !packed {
                let data = open(&folder.path().join(name), &OpenOptions::default()).unwrap();
                assert_eq!(scalar(&data), Values::U8(bytes.clone()));
            }
        }
    }
    // Files that Analyze wrote have no magic number.
    let folder = Folder::new();
    let mut header = Nifti::new(2, &[2, 3, 2]).file(&[]);
    header.truncate(348);
    header[344..].fill(0);
    header[38] = b'r';
    for name in ["a.hdr", "a.img"] {
        folder.file("a.hdr", &header);
        let error = folder.refuse(name, if name == "a.hdr" { &header } else { &bytes });
        assert!(error.contains("Analyze"), "{error}");
    }
}

#[test]
fn a_packed_file_is_what_nibabel_reads() {
    let Some(path) = real_data("formats/volumes/minimal.nii.gz") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    let lattice = lattice(&data);
    assert_eq!(lattice.dims, [64, 64, 10]);
    // Nibabel centres and mirrors files without a position; the format defines pixdim times the
    // index.
    assert_eq!(lattice.position([1; 3]), DVec3::splat(3.0));
    let Values::U8(values) = scalar(&data) else {
        panic!("another type");
    };
    assert_eq!(values.iter().map(|v| u64::from(*v)).sum::<u64>(), 1_290_240);
    let at = |x: usize, y: usize, z: usize| values[x + 64 * (y + 64 * z)];
    assert_eq!(
        [at(24, 30, 5), at(63, 1, 9), at(0, 63, 0), at(40, 0, 0)],
        [30, 1, 63, 0]
    );
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}
