//! Tests extension records of SPZ files: they are kept for files that are written as SPZ again, as
//! long as they hold.
//!
//! Layout of a record: type and length (u32), payload. Version 4 has the records behind its header
//! of 32 bytes, up to the table whose place is the u32 at byte 16; version 3 behind the arrays.

use std::io::Read;

use ewa_splat::edit::{Placement, place};
use ewa_splat::io::{
    Dataset, Geometry, SplatCloud, SplatFileOptions, SpzRecord, SpzRecords, SpzVersion,
    write_splats,
};
use flate2::read::GzDecoder;
use glam::{DQuat, DVec3};

use crate::support::splats::{glb_packed, some_splats, spz_streams, spz_unpacked, stored};
use crate::support::{Folder, gzip};

const AXES: u32 = 0xADBE_0003;
const ORBIT: u32 = 0xADBE_0002;
const UNKNOWN: u32 = 0x1234_0001;

fn record(kind: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap();
    [&kind.to_le_bytes(), &length.to_le_bytes(), payload].concat()
}

/// A camera's limits, an unknown record, and an empty one of the same type.
fn some_records() -> Vec<u8> {
    let limits: Vec<u8> = [-0.5_f32, 0.75, 2.0]
        .into_iter()
        .flat_map(f32::to_le_bytes)
        .collect();
    [
        record(ORBIT, &limits),
        record(UNKNOWN, b"of splat 2"),
        record(UNKNOWN, b""),
    ]
    .concat()
}

/// Inserts records in a file of version 4.
fn in_streams(records: &[u8]) -> Vec<u8> {
    let mut file = spz_streams(2, &some_splats(5, 1), &stored);
    let at = 32 + u32::try_from(records.len()).unwrap();
    file[16..20].copy_from_slice(&at.to_le_bytes());
    file.splice(32..32, records.iter().copied());
    file
}

fn in_one_stream(records: &[u8]) -> Vec<u8> {
    gzip(&[&spz_unpacked(3, 2, &some_splats(5, 1)), records].concat())
}

fn cloud(data: Dataset) -> SplatCloud {
    match data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

/// The records of a written file, found by its header alone, and its flags.
fn records_of(file: &[u8], version: SpzVersion) -> (Vec<u8>, u8) {
    match version {
        SpzVersion::Four => {
            let at = u32::from_le_bytes(file[16..20].try_into().unwrap()) as usize;
            (file[32..at].to_vec(), file[14])
        }
        SpzVersion::Three => {
            let mut bytes = Vec::new();
            GzDecoder::new(file).read_to_end(&mut bytes).unwrap();
            // Five splats of degree 1: 9 + 1 + 3 + 3 + 4 + 9 bytes each.
            (bytes.split_off(16 + 5 * 29), bytes[14])
        }
    }
}

#[test]
fn records_are_kept_as_they_are() {
    let folder = Folder::new();
    for file in [in_one_stream(&some_records()), in_streams(&some_records())] {
        let data = folder.open("a.spz", &file);
        let note = "SPZ's extension records are not used, but kept for SPZ files: \
            0xadbe0002 (12 bytes), 0x12340001 (10 bytes), 0x12340001 (0 bytes)";
        assert_eq!(data.notes, [note]);
        let cloud = cloud(data);
        for version in [SpzVersion::Three, SpzVersion::Four] {
            let path = folder.path().join("b.spz");
            let options = SplatFileOptions {
                spz_version: Some(version),
                up: Some(DVec3::NEG_Y),
                ..SplatFileOptions::default()
            };
            let written = write_splats(&path, &cloud, &options).unwrap();
            assert!(written.notes.is_empty(), "{:?}", written.notes);
            let (records, flags) = records_of(&std::fs::read(&path).unwrap(), version);
            assert_eq!((records, flags), (some_records(), 2));
            let bytes = std::fs::read(&path).unwrap();
            let Geometry::Splats(again) = folder.open("b.spz", &bytes).geometry else {
                panic!()
            };
            assert_eq!(again.records, cloud.records);
            assert_eq!(again.positions, cloud.positions);
        }
        // Other formats have none, and say so.
        let path = folder.path().join("b.ply");
        let written = write_splats(&path, &cloud, &SplatFileOptions::default()).unwrap();
        let [note] = written.notes.try_into().unwrap();
        assert!(
            note.contains("0xadbe0002") && note.contains("the format has none"),
            "{note}"
        );
    }
    // A file without records has no flag.
    let Geometry::Splats(plain) = folder.open("a.spz", &in_streams(&[])).geometry else {
        panic!()
    };
    write_splats(
        &folder.path().join("c.spz"),
        &plain,
        &SplatFileOptions::default(),
    )
    .unwrap();
    let file = std::fs::read(folder.path().join("c.spz")).unwrap();
    assert_eq!(records_of(&file, SpzVersion::Three), (Vec::new(), 0));
}

#[test]
fn records_that_may_not_hold_are_left_out() {
    let folder = Folder::new();
    let read = |records: &[u8]| folder.open("a.spz", &in_streams(records));
    let kept = |cloud: &SplatCloud| -> Vec<u32> {
        let path = folder.path().join("b.spz");
        let written = write_splats(&path, cloud, &SplatFileOptions::default()).unwrap();
        assert_eq!(written.notes.len(), 1, "{:?}", written.notes);
        assert!(
            written.notes[0].contains("0x12340001, 0x12340001"),
            "{:?}",
            written.notes
        );
        let data = folder.open("b.spz", &std::fs::read(path).unwrap());
        let records = self::cloud(data).records;
        records.kept().iter().map(|record| record.kind).collect()
    };
    // The axes of PLY: coordinates are converted, and the record of the axes is not needed.
    let with_axes = |axes: u32| [record(AXES, &axes.to_le_bytes()), some_records()].concat();
    let turned = cloud(read(&with_axes(6)));
    let unturned = cloud(read(&with_axes(4)));
    assert_eq!(unturned.records, cloud(read(&some_records())).records);
    for (a, b) in turned.positions.iter().zip(&unturned.positions) {
        assert_eq!(*a * DVec3::new(1.0, -1.0, -1.0), *b);
    }
    assert_eq!(kept(&turned), [ORBIT]);
    // Moved by nothing, and by something.
    let place = |placement: &Placement| cloud(place(read(&some_records()), placement).unwrap());
    let same = place(&Placement::default());
    assert_eq!(same.records, unturned.records);
    let moved = place(&Placement {
        rotation: DQuat::from_rotation_y(0.5),
        ..Placement::default()
    });
    assert_eq!(kept(&moved), [0_u32; 0]);
    // Two files.
    let mut both = unturned.clone();
    both.append(turned.clone());
    assert_eq!(both.records.kept(), []);
    // Streams within glTF files.
    let stream = in_one_stream(&some_records());
    let data = folder.open("a.glb", &glb_packed(&stream));
    assert!(
        data.notes
            .iter()
            .any(|note| note.contains("records are not used: 0xadbe0002"))
    );
    assert_eq!(cloud(data).records, SpzRecords::default());
}

#[test]
fn many_and_long_records_are_bounded() {
    let folder = Folder::new();
    let many = record(UNKNOWN, b"x").repeat(2000);
    let data = folder.open("a.spz", &in_streams(&many));
    assert!(
        data.notes.iter().any(|note| note.contains("is not read")),
        "{:?}",
        data.notes
    );
    let count = cloud(data).records.kept().len();
    assert!((1000..2000).contains(&count), "{count}");
    // A length beyond the file.
    let mut beyond = some_records();
    beyond.extend(record(UNKNOWN, b"")[..4].iter().chain(&[255; 4]));
    let data = folder.open("a.spz", &in_streams(&beyond));
    assert!(data.notes.iter().any(|note| note.contains("is not read")));
    assert_eq!(cloud(data).records.kept().len(), 3);
    // Records of a program's own.
    let mut own = cloud(folder.open("a.spz", &in_streams(&[])));
    own.records = SpzRecords::new(vec![SpzRecord {
        kind: 7,
        payload: vec![1; 100_000],
    }]);
    let path = folder.path().join("b.spz");
    write_splats(&path, &own, &SplatFileOptions::default()).unwrap();
    let again = cloud(folder.open("b.spz", &std::fs::read(path).unwrap()));
    assert_eq!(again.records, own.records);
}
