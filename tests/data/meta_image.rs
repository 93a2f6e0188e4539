//! Tests MetaImage: all storage forms give the original numbers and what other programs read.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{FieldSource, OpenOptions, open};
use ewa_splat::scene::Values;
use glam::DVec3;

use crate::common::real_data;
use crate::support::images::{check_volume_of_itk, lattice, scalar};
use crate::support::{Folder, gzip, zlib};

/// Returns a header of 2 x 3 x 2 bytes, with the data after it.
fn file(fields: &str, place: &str, body: &[u8]) -> Vec<u8> {
    let head = format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 2 3 2\nElementType = MET_UCHAR\n{fields}\n\
         ElementDataFile = {place}\n"
    );
    [head.as_bytes(), body].concat()
}

#[test]
fn a_file_that_itk_wrote_has_its_positions_and_values() {
    let text = "T2JqZWN0VHlwZSA9IEltYWdlCk5EaW1zID0gMwpCaW5hcnlEYXRhID0gVHJ1ZQpCaW5hcnlEYXRhQnl0ZU9yZGVyTVNCID0gRmFsc2UKQ29tcHJlc3NlZERhdGEgPSBUcnVlCkNvbXByZXNzZWREYXRhU2l6ZSA9IDU5ClRyYW5zZm9ybU1hdHJpeCA9IDAuODAwMDAwMDAwMDAwMDAwMDQgMC41OTk5OTk5OTk5OTk5OTk5OCAwIC0wLjU5OTk5OTk5OTk5OTk5OTk4IDAuODAwMDAwMDAwMDAwMDAwMDQgMCAwIDAgMQpPZmZzZXQgPSAtMTAgMjAgNS41CkNlbnRlck9mUm90YXRpb24gPSAwIDAgMApBbmF0b21pY2FsT3JpZW50YXRpb24gPSBSQUkKRWxlbWVudFNwYWNpbmcgPSAwLjUgMC43NSAyCkRpbVNpemUgPSAzIDQgMgpFbGVtZW50VHlwZSA9IE1FVF9TSE9SVApFbGVtZW50RGF0YUZpbGUgPSBMT0NBTAp4XgEwAM//zv/V/9z/4//q//H/+P///wYADQAUABsAIgApADAANwA+AEUATABTAFoAYQBoAG8Aj6YS1Q==";
    let data = Folder::new().open("a.mha", &STANDARD.decode(text).unwrap());
    check_volume_of_itk(&data);
}

#[test]
fn numbers_lie_behind_the_header_or_in_other_files() {
    let folder = Folder::new();
    let bytes: Vec<u8> = (0..12).collect();
    let padded = [b"123", &bytes[..]].concat();
    let text: Vec<String> = bytes.iter().map(u8::to_string).collect();
    folder.file("all.raw", &bytes);
    folder.file("all packed.zraw", &zlib(&bytes));
    folder.file("padded.raw", &padded);
    for (i, half) in bytes.chunks(6).enumerate() {
        folder.file(&format!("s{}.raw", 3 + i), half);
    }
    for (fields, place, body) in [
        ("", "LOCAL", bytes.clone()),
        ("BinaryDataByteOrderMSB = True", "local", bytes.clone()),
        ("HeaderSize = 3", "LOCAL", padded.clone()),
        ("HeaderSize = -1", "LOCAL", padded),
        ("CompressedData = True", "LOCAL", zlib(&bytes)),
        ("CompressedData = True", "LOCAL", gzip(&bytes)),
        ("BinaryData = False", "LOCAL", text.join(" ").into_bytes()),
        ("", "all.raw", vec![]),
        ("CompressedData = T", "all packed.zraw", vec![]),
        ("HeaderSize = -1", "padded.raw", vec![]),
        ("", "s%d.raw 3 4 1", vec![]),
        ("", "LIST\ns3.raw\ns4.raw", vec![]),
        ("", "LIST 2\ns3.raw\n\ns4.raw", vec![]),
    ] {
        for name in ["a.mha", "a.mhd", "named.otherwise"] {
            let data = folder.open(name, &file(fields, place, &body));
            assert_eq!(
                scalar(&data),
                Values::U8(bytes.clone()),
                "{fields}, {place}"
            );
            assert!(data.notes.is_empty(), "{fields}, {place}: {:?}", data.notes);
        }
    }
    for (fields, place, body, said) in [
        ("", "LOCAL", 11, "12 bytes"),
        ("", "../all.raw", 0, "beside this file"),
        ("", "/all.raw", 0, "beside this file"),
        ("", "C:\\all.raw", 0, "beside this file"),
        ("", "", 0, "beside this file"),
        ("", "none.raw", 0, "no file"),
        ("", "s%d.raw 3 5 1", 0, "no file"),
        ("", "s%d.raw 3 4 0", 0, "3 to 4 by 0"),
        ("", "LIST\ns3.raw\ns3.raw", 0, "again"),
        ("", "LIST", 0, "0 files"),
        ("CompressedData = True", "LOCAL", 12, "unpacked"),
        ("CompressedData = maybe", "LOCAL", 12, "True or False"),
        ("HeaderSize = -1\nCompressedData = True", "LOCAL", 12, "-1"),
        ("HeaderSize = -2", "LOCAL", 12, "at least -1"),
        ("ElementSpacing = 1 0 1", "LOCAL", 12, "volume"),
        ("ElementSpacing = 1 1", "LOCAL", 12, "3 numbers"),
        ("Offset = 1 nan 1", "LOCAL", 12, "finite"),
        ("ElementNumberOfChannels = 0", "LOCAL", 12, "at least 1"),
        (
            "ElementNumberOfChannels = 18446744073709551615",
            "LOCAL",
            12,
            "fits into memory",
        ),
        ("nothing", "LOCAL", 12, "line 5"),
    ] {
        let error = folder.refuse("a.mhd", &file(fields, place, &vec![b'z'; body]));
        assert!(error.contains(said), "{fields}, {place}: {error}");
    }
    for (text, said) in [
        ("ObjectType = Tube\nElementDataFile = LOCAL\n", "Image"),
        ("NDims = 99\nElementDataFile = LOCAL\n", "2 to 10"),
        ("NDims = 3\nElementDataFile = LOCAL\n", "DimSize"),
        (
            "NDims = 2\nDimSize = 1 1\nElementType = MET_STRING\nElementDataFile = LOCAL\n",
            "MET_STRING",
        ),
        (
            "NDims = 2\nDimSize = 0 1\nElementType = MET_CHAR\nElementDataFile = LOCAL\n",
            "sizes",
        ),
        ("NDims = 3\n", "the last of the header"),
    ] {
        let error = folder.refuse("a.mha", text.as_bytes());
        assert!(error.contains(said), "{text}: {error}");
    }
}

#[test]
fn every_type_gives_the_numbers() {
    let folder = Folder::new();
    macro_rules! check {
        ($t:ty, $name:literal, $expected:expr) => {
            let numbers = [1, 2, 3, 100].map(|n: u8| <$t>::try_from(n).unwrap());
            for (order, body) in [
                ("False", numbers.map(|n| n.to_le_bytes()).concat()),
                ("True", numbers.map(|n| n.to_be_bytes()).concat()),
            ] {
                let head = format!(
                    "NDims = 2\nDimSize = 2 2\nElementByteOrderMSB = {order}\nElementType = {}\nElementDataFile = LOCAL\n",
                    $name
                );
                let data = folder.open("a.mha", &[head.as_bytes(), &body].concat());
                assert_eq!(scalar(&data), $expected, "{}", $name);
                assert_eq!(lattice(&data).dims, [2, 2, 1]);
            }
        };
    }
    let floats = || Values::F32(vec![1.0, 2.0, 3.0, 100.0]);
    check!(i8, "MET_CHAR", Values::I16(vec![1, 2, 3, 100]));
    check!(u8, "MET_UCHAR", Values::U8(vec![1, 2, 3, 100]));
    check!(i16, "MET_SHORT", Values::I16(vec![1, 2, 3, 100]));
    check!(u16, "MET_USHORT", Values::U16(vec![1, 2, 3, 100]));
    check!(i32, "MET_INT", floats());
    check!(i32, "MET_LONG", floats());
    check!(u32, "MET_UINT", floats());
    check!(u32, "MET_ULONG", floats());
    check!(i64, "MET_LONG_LONG", floats());
    check!(u64, "MET_ULONG_LONG", floats());
    check!(f32, "MET_FLOAT", floats());
    check!(f64, "MET_DOUBLE", floats());
}

#[test]
fn channels_are_components_and_a_fourth_axis_is_time() {
    let folder = Folder::new();
    let data = folder.open(
        "a.mha",
        &file(
            "ElementNumberOfChannels = 2",
            "LOCAL",
            &(0..24).collect::<Vec<u8>>(),
        ),
    );
    let FieldSource::Vector(components) = &data.fields[0].source else {
        panic!("no vector");
    };
    let of = |first: u8| Values::U8((0..12).map(|i| 2 * i + first).collect());
    assert_eq!(components, &[of(0), of(1)]);
    let head = "NDims = 4\nDimSize = 1 2 3 2\nElementSize = 2 3 4 9\nPosition = 5 6 7 8\n\
                ElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let data = folder.open(
        "a.mha",
        &[head.as_bytes(), &(0..12).collect::<Vec<u8>>()].concat(),
    );
    assert_eq!(scalar(&data), Values::U8((0..6).collect()));
    assert_eq!(data.notes, ["The first of 2 volumes."]);
    assert_eq!(lattice(&data).position([1; 3]), DVec3::new(7.0, 9.0, 11.0));
}

#[test]
fn a_head_is_what_itk_reads() {
    let Some(path) = real_data("formats/volumes/HeadMRVolume.mhd") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    let lattice = lattice(&data);
    assert_eq!(lattice.dims, [48, 62, 42]);
    assert_eq!(lattice.position([1; 3]), DVec3::splat(4.0));
    // Sum and samples are those of SimpleITK 2.5.
    let Values::U8(values) = scalar(&data) else {
        panic!("another type");
    };
    assert_eq!(values.iter().map(|v| u64::from(*v)).sum::<u64>(), 3_058_332);
    let at = |x: usize, y: usize, z: usize| values[x + 48 * (y + 62 * z)];
    assert_eq!(
        [at(24, 30, 20), at(47, 61, 41), at(12, 40, 10)],
        [139, 1, 71]
    );
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}
