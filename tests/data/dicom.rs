//! Tests DICOM: series, frames and all compressions give what pydicom 3 and SimpleITK 2.5 read.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{Dataset, Geometry, OpenOptions, open, read};
use ewa_splat::scene::{LatticeSpacing, Values};
use glam::DVec3;

use crate::support::Folder;
use crate::support::dicom::{Coding, Dicom, EXPLICIT, Slice};
use crate::support::images::{components, lattice, scalar};

fn fixture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dicom");
    folder.join(name)
}

fn opened(path: &Path) -> Dataset {
    open(path, &OpenOptions::default()).unwrap()
}

fn check_places(data: &Dataset, places: &[([usize; 3], [f64; 3])]) {
    for (index, place) in places {
        let found = lattice(data).position(*index);
        let place = DVec3::from_array(*place);
        assert!(found.distance(place) < 1e-8, "{index:?}: {found}");
    }
}

/// Four oblique slices of 12 signed bits, whose names are not in the order of positions, and one of
/// another series.
#[test]
fn a_series_is_read_from_any_of_its_files_and_from_its_folder() {
    for name in ["oblique", "oblique/a.dcm", "oblique/c.dcm"] {
        let data = opened(&fixture(name));
        let expected = (0..4_u8).flat_map(|k| {
            let [k, slope] = [k, 2 + k].map(f32::from);
            let number = move |i| ((k + 1.0) * f32::from(i) - 20.0) * slope / 2.0 - 100.0 * k;
            (0..15_u8).map(number)
        });
        assert_eq!(scalar(&data), Values::F32(expected.collect()));
        assert_eq!(lattice(&data).dims, [5, 3, 4]);
        // Positions from SimpleITK's TransformIndexToPhysicalPoint; rows are 0.5 apart and columns
        // 0.8.
        check_places(
            &data,
            &[
                ([0, 0, 0], [-10.0, 20.0, 5.5]),
                (
                    [4, 0, 0],
                    [
                        -7.866_666_666_667_7,
                        22.133_333_333_334_4,
                        6.566_666_666_666_7,
                    ],
                ),
                (
                    [4, 2, 3],
                    [
                        -6.033_333_333_331_2,
                        17.466_666_666_668_1,
                        12.233_333_333_332_6,
                    ],
                ),
            ],
        );
        assert_eq!(data.unit("value"), Some("HU"));
        let [note] = &data.notes[..] else {
            panic!("{:?}", data.notes);
        };
        assert!(note.starts_with("1 files of 1 other series"), "{note}");
    }
    let other = opened(&fixture("oblique/other.dcm"));
    assert_eq!(scalar(&other), Values::U16(vec![1; 15]));
}

/// Values are 1000 and 5 more for every seventh pixel. The intercept makes them negative; they stay
/// integers.
#[test]
fn ways_of_packing_give_the_same_numbers() {
    for (name, intercept) in [("deflated", 0), ("big_endian", 0), ("rle", -1024)] {
        let data = opened(&fixture(&format!("{name}.dcm")));
        let numbers = (0..120_i16).map(|i| i / 7 * 5 + 1000 + intercept);
        let expected: Values = match intercept {
            0 => Values::U16(numbers.map(|n| n.try_into().unwrap()).collect()),
            _ => Values::I16(numbers.collect()),
        };
        assert_eq!(scalar(&data), expected, "{name}");
        assert_eq!(lattice(&data).dims, [12, 10, 1]);
        check_places(
            &data,
            &[(
                [11, 9, 0],
                [
                    -7.133_333_333_336_8,
                    27.366_666_666_667_6,
                    11.433_333_333_333_8,
                ],
            )],
        );
    }
    let data = opened(&fixture("lossless.dcm"));
    let expected = (0..120_i32).map(|i| (i * 37 % 4000 - 1000).try_into().unwrap());
    assert_eq!(scalar(&data), Values::I16(expected.collect()));
    // The compression is lossy; the fourth row is as libjpeg decodes it.
    let data = opened(&fixture("baseline.dcm"));
    let row: Vec<f32> = (48..64).map(|i| scalar(&data).get(i)).collect();
    let expected = BASELINE.map(f32::from);
    let is_near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1.0;
    assert!(row.iter().zip(&expected).all(is_near), "{row:?}");
}

const BASELINE: [u8; 16] = [
    18, 26, 36, 45, 54, 62, 72, 81, 90, 98, 108, 117, 126, 134, 144, 153,
];

#[test]
fn frames_of_one_file_lie_where_each_says_and_are_scaled_by_its_own_slope() {
    let data = opened(&fixture("enhanced.dcm"));
    let of_frame = |k: u8| {
        let slope = f32::from(1 + k);
        (0..8_u8).map(move |i| 3.0 * f32::from(8 * k + i) * slope - f32::from(k))
    };
    // The last frame is the lowest.
    let expected = [2, 1, 0].into_iter().flat_map(of_frame);
    assert_eq!(scalar(&data), Values::F32(expected.collect()));
    assert_eq!(lattice(&data).dims, [4, 2, 3]);
    check_places(
        &data,
        &[
            ([0, 0, 0], [-10.0, 20.0, 5.5]),
            ([0, 0, 2], [-8.333_333_333, 16.666_666_667, 8.833_333_333]),
        ],
    );
    // The other files beside it belong to other series.
    assert_eq!(data.notes.len(), 1, "{:?}", data.notes);
}

#[test]
fn colours_by_planes_are_a_field_rgb() {
    let data = opened(&fixture("rgb.dcm"));
    assert_eq!(data.field_names(), ["rgb"]);
    let of = |c: u8| Values::U8((0..6).map(|i| 10 * (6 * c + i)).collect());
    assert_eq!(components(&data), [of(0), of(1), of(2)]);
}

#[test]
fn every_coding_is_read_from_bytes_with_and_without_a_preamble() {
    for coding in [Coding::Explicit, Coding::Implicit, Coding::BigEndian] {
        let slice = Slice {
            coding,
            // The numbers occupy twelve bits from the fourth on; the other bits hold something
            // else.
            bits: [16, 12, 15],
            signed: true,
            words: [0x7ff5, 0x8003, 0xfff0, 0x0010],
            ..Slice::default()
        };
        let bytes = slice.file();
        let data = read("a", &bytes, &OpenOptions::default()).unwrap();
        assert_eq!(
            scalar(&data),
            Values::I16(vec![2047, -2048, -1, 1]),
            "{coding:?}"
        );
        // After the first group: one element with the name of the syntax.
        let bare = &bytes[132 + 8 + usize::from(bytes[138])..];
        let bare = read("a.dcm", bare, &OpenOptions::default());
        let bare = bare.unwrap_or_else(|e| panic!("{coding:?}: {e}"));
        assert_eq!(scalar(&bare), scalar(&data), "{coding:?}");
        if coding != Coding::BigEndian {
            let bare = read("a", &bytes[132..], &OpenOptions::default()).unwrap();
            assert_eq!(scalar(&bare), scalar(&data));
        }
    }
}

#[test]
fn padding_is_no_value_and_the_rest_is_scaled() {
    let slice = Slice {
        signed: true,
        padding: Some(0x8000),
        more: vec![
            (0x0028_1052, "DS", "-1.5"),
            (0x0028_1053, "DS", "2"),
            (0x0028_1054, "LO", "HU"),
        ],
        words: [0x8000, 0xffff, 0, 7],
        ..Slice::default()
    };
    let data = read("a.dcm", &slice.file(), &OpenOptions::default()).unwrap();
    let Values::F32(values) = scalar(&data) else {
        panic!("no floats");
    };
    assert!(values[0].is_nan());
    assert_eq!(values[1..], [-3.5, -1.5, 12.5]);
    assert_eq!(data.unit("value"), Some("HU"));
}

/// Returns a folder of slices, opened by the first.
fn series(slices: &[Slice]) -> (Folder, Dataset) {
    let folder = Folder::new();
    for (i, slice) in slices.iter().enumerate() {
        folder.file(&format!("{i}"), &slice.file());
    }
    let data = opened(&folder.path().join("0"));
    (folder, data)
}

fn at(position: &'static str, number: usize) -> Slice {
    let word = u16::try_from(number).unwrap();
    Slice {
        position,
        number,
        words: [word; 4],
        ..Slice::default()
    }
}

fn firsts(data: &Dataset) -> Vec<f32> {
    let values = scalar(data);
    (0..values.len())
        .step_by(4)
        .map(|i| values.get(i))
        .collect()
}

#[test]
fn slices_at_one_place_and_of_another_orientation_are_left_out() {
    let mut slices = [
        at("0\\0\\3", 4),
        at("0\\0\\0", 9),
        at("0\\0\\0", 2),
        at("0\\0\\3.0001", 8),
        at("0\\0\\-3", 7),
        at("0\\0\\1", 1),
    ];
    slices[5].axes = "0\\1\\0\\0\\0\\-1";
    let (_folder, data) = series(&slices);
    assert_eq!(firsts(&data), [7.0, 2.0, 4.0]);
    check_places(&data, &[([1, 1, 2], [0.25, 0.5, 3.0])]);
    let is_noted = |start: &str| data.notes.iter().any(|note| note.starts_with(start));
    assert!(
        is_noted("2 images at the places of others"),
        "{:?}",
        data.notes
    );
    assert!(
        is_noted("1 images of another size or orientation"),
        "{:?}",
        data.notes
    );
}

#[test]
fn uneven_distances_are_kept() {
    let (_folder, data) = series(&[at("0\\0\\4", 3), at("0\\0\\0", 1), at("0\\0\\1", 2)]);
    assert_eq!(firsts(&data), [1.0, 2.0, 3.0]);
    let LatticeSpacing::Rectilinear { coordinates } = &lattice(&data).spacing else {
        panic!("even");
    };
    assert_eq!(coordinates[1], [0.0, 0.5]);
    assert_eq!(coordinates[2], [0.0, 1.0, 4.0]);
    assert!(data.notes[0].contains("1.0000 to 3.0000 apart"));
    // Oblique slices become nodes.
    let oblique = |position, number| Slice {
        axes: "0\\1\\0\\0\\0\\1",
        ..at(position, number)
    };
    let (_folder, data) = series(&[
        oblique("4\\0\\0", 3),
        oblique("0\\0\\0", 1),
        oblique("1\\0\\0", 2),
    ]);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("no nodes");
    };
    assert_eq!(blocks[0].dims, [2, 2, 3]);
    assert_eq!(blocks[0].nodes[11], DVec3::new(4.0, 0.25, 0.5));
}

/// The gantry is tilted: layers do not follow each other along their normal.
#[test]
fn layers_that_are_shifted_against_each_other_stay_so() {
    let (_folder, data) = series(&[at("0\\2\\4", 3), at("0\\0\\0", 1), at("0\\1\\2", 2)]);
    check_places(
        &data,
        &[([0, 0, 2], [0.0, 2.0, 4.0]), ([1, 0, 1], [0.25, 1.0, 2.0])],
    );
}

#[test]
fn what_is_not_read_is_refused_by_name() {
    let folder = Folder::new();
    for (syntax, name) in [
        ("1.2.840.10008.1.2.4.90", "JPEG 2000"),
        ("1.2.840.10008.1.2.4.81", "JPEG-LS"),
        ("1.2.840.10008.1.2.4.202", "HTJ2K"),
        ("1.2.840.10008.1.2.4.103", "MPEG-4"),
        ("1.2.840.113619.5.2", "private"),
    ] {
        let file = Slice::default().header().packed(&[b"1234"]).file(syntax);
        let said = folder.refuse("a.dcm", &file);
        assert!(said.contains(name) && said.contains(syntax), "{said}");
    }
    let directory = Dicom::new(Coding::Explicit).text(0x0008_0060, "CS", "RTSTRUCT");
    let said = folder.refuse("a.dcm", &directory.file(EXPLICIT));
    assert!(
        said.contains("without pixels, of the modality RTSTRUCT"),
        "{said}"
    );
}

#[test]
fn claims_that_the_bytes_do_not_back_are_refused() {
    let folder = Folder::new();
    let frames = Slice {
        more: vec![(0x0028_0008, "IS", "99999999")],
        ..Slice::default()
    };
    let said = folder.refuse("a.dcm", &frames.file());
    assert!(
        said.contains("bytes of numbers from files of this size"),
        "{said}"
    );
    let frames = Slice {
        more: vec![(0x0028_0008, "IS", "2")],
        ..Slice::default()
    };
    let said = folder.refuse("a.dcm", &frames.file());
    assert!(
        said.contains("expected 16 bytes of pixels, found 8 bytes"),
        "{said}"
    );
    let runs = Slice::default().header().packed(&[&[0; 64]]);
    let said = folder.refuse("a.dcm", &runs.file("1.2.840.10008.1.2.5"));
    assert!(said.contains("0 segments, not 2"), "{said}");
    // A decompression bomb: a data set of zeros.
    let mut zeros = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
    std::io::Write::write_all(&mut zeros, &vec![0; 100 << 20]).unwrap();
    let bomb = Dicom {
        coding: Coding::Explicit,
        bytes: zeros.finish().unwrap(),
    };
    let said = folder.refuse("a.dcm", &bomb.file("1.2.840.10008.1.2.1.99"));
    assert!(said.contains("deflated data set"), "{said}");
    // Sequences are nested deeper than a stack allows.
    let mut deep = Dicom::new(Coding::Explicit);
    for _ in 0..200_000 {
        deep.bytes
            .extend(b"\x09\x00\x01\x10SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff");
    }
    let said = folder.refuse("a.dcm", &deep.file(EXPLICIT));
    assert!(said.contains("sequences in each other"), "{said}");
}

/// Only the first frame's position and the frames' offsets or distance are stated.
#[test]
fn frames_follow_along_the_normal() {
    for (tag, vr, text, last) in [
        (0x3004_000c, "DS", "0\\1\\3", 3.0),
        (0x0018_0088, "DS", "2", 4.0),
    ] {
        let mut slice = Slice {
            position: "1\\2\\3",
            more: vec![(0x0028_0008, "IS", "3")],
            ..Slice::default()
        };
        slice.more.push((tag, vr, text));
        let set = slice.header().raw(0x7fe0_0010, "OW", &[1; 24]);
        let data = read("a.dcm", &set.file(EXPLICIT), &OpenOptions::default()).unwrap();
        let found = lattice(&data).position([0, 0, 2]);
        assert_eq!(found, DVec3::new(1.0, 2.0, 3.0 + last));
    }
}
