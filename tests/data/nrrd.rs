//! Tests NRRD: every encoding and every way to name files give the original numbers and what other
//! programs read.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::scene::Values;
use glam::DVec3;

use crate::common::real_data;
use crate::support::images::{check_volume_of_itk, components, lattice, scalar};
use crate::support::{Folder, gzip};

/// Returns a header, an empty line and the data after it.
fn file(header: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("NRRD0004\n# made\n{header}\nkey:=value: of its own\n\n");
    [head.as_bytes(), body].concat()
}

const CUBE: &str = "dimension: 3\nsizes: 2 3 2\n";

#[test]
fn a_file_that_itk_wrote_has_its_positions_and_values() {
    let text = "TlJSRDAwMDQKIyBDb21wbGV0ZSBOUlJEIGZpbGUgZm9ybWF0IHNwZWNpZmljYXRpb24gYXQ6CiMgaHR0cDovL3RlZW0uc291cmNlZm9yZ2UubmV0L25ycmQvZm9ybWF0Lmh0bWwKdHlwZTogc2hvcnQKZGltZW5zaW9uOiAzCnNwYWNlOiBsZWZ0LXBvc3Rlcmlvci1zdXBlcmlvcgpzaXplczogMyA0IDIKc3BhY2UgZGlyZWN0aW9uczogKDAuNDAwMDAwMDAwMDAwMDAwMDIsMC4yOTk5OTk5OTk5OTk5OTk5OSwwKSAoLTAuNDQ5OTk5OTk5OTk5OTk5OTYsMC42MDAwMDAwMDAwMDAwMDAwOSwwKSAoMCwwLDIpCmtpbmRzOiBkb21haW4gZG9tYWluIGRvbWFpbgplbmRpYW46IGxpdHRsZQplbmNvZGluZzogZ3ppcApzcGFjZSBvcmlnaW46ICgtMTAsMjAsNS41KQoKH4sIAAAAAAAAAwEwAM//zv/V/9z/4//q//H/+P///wYADQAUABsAIgApADAANwA+AEUATABTAFoAYQBoAG8AoqYLWzAAAAA=";
    let data = Folder::new().open("a.nrrd", &STANDARD.decode(text).unwrap());
    check_volume_of_itk(&data);
}

#[test]
fn every_encoding_and_type_gives_the_numbers() {
    let folder = Folder::new();
    let bytes: Vec<u8> = (0..12).collect();
    let hex: String = bytes.iter().map(|b| format!("{b:02X}\n")).collect();
    let text: Vec<String> = bytes.iter().map(u8::to_string).collect();
    let padded = [b"two\nlines\n123".as_slice(), &bytes].concat();
    let gz_padded = [
        b"a line\n".as_slice(),
        &gzip(&[&[9; 5], &bytes[..]].concat()),
    ]
    .concat();
    for (fields, body) in [
        ("encoding: raw", bytes.clone()),
        ("encoding: hex", hex.into_bytes()),
        ("encoding: text", text.join(" ").into_bytes()),
        ("encoding: gz", gzip(&bytes)),
        ("encoding: raw\nline skip: 2\nbyteskip: 3", padded.clone()),
        ("encoding: raw\nbyte skip: -1", padded),
        ("encoding: gzip\nline skip: 1\nbyte skip: 5", gz_padded),
    ] {
        let header = format!("{CUBE}type: unsigned char\n{fields}");
        let data = folder.open("a.nrrd", &file(&header, &body));
        assert_eq!(scalar(&data), Values::U8(bytes.clone()), "{fields}");
        assert!(data.notes.is_empty(), "{fields}: {:?}", data.notes);
    }

    // Text has no byte order, whatever the header states.
    let header = format!("{CUBE}type: short\nendian: big\nencoding: ascii");
    let data = folder.open("a.nrrd", &file(&header, &b"-300\t7\r\n".repeat(6)));
    assert_eq!(scalar(&data), Values::I16([-300, 7].repeat(6)));

    let of_type = |name: &str, endian: &str, body: &[u8]| {
        let header = format!("{CUBE}type: {name}\nencoding: raw\nendian: {endian}");
        scalar(&folder.open("a.nrrd", &file(&header, body)))
    };
    macro_rules! check {
        ($t:ty, $expected:expr, $($name:literal),+) => {
            for name in [$($name),+] {
                let numbers: Vec<$t> = (0..12_u8).map(|i| <$t>::from(i % 120) as $t).collect();
                let little: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
                let big: Vec<u8> = numbers.iter().flat_map(|n| n.to_be_bytes()).collect();
                assert_eq!(of_type(name, "little", &little), $expected, "{name}");
                assert_eq!(of_type(name, "big", &big), $expected, "{name}");
            }
        };
    }
    let floats = Values::F32((0..12_u8).map(f32::from).collect());
    let shorts = Values::I16((0..12).collect());
    check!(u8, Values::U8(bytes.clone()), "uchar", "uint8_t");
    check!(i16, shorts, "short", "signed short int", "int16");
    check!(
        u16,
        Values::U16((0..12).collect()),
        "unsigned short",
        "unsigned short int",
        "uint16_t"
    );
    check!(i32, floats, "int", "signed int", "int32_t");
    check!(u32, floats, "uint", "unsigned int");
    check!(i64, floats, "longlong", "signed long long int", "long long");
    check!(u64, floats, "unsigned long long int", "uint64");
    check!(f32, floats, "float");
    check!(f64, floats, "double");
    assert_eq!(
        of_type("signed char", "little", &[255; 12]),
        Values::I16(vec![-1; 12])
    );
}

#[test]
fn numbers_may_lie_in_other_files() {
    let folder = Folder::new();
    let bytes: Vec<u8> = (0..12).collect();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    folder.file("all.raw", &bytes);
    folder.file("in/one file.gz", &gzip(&bytes));
    for (i, half) in bytes.chunks(6).enumerate() {
        folder.file(&format!("s{:03}.raw", 7 - 2 * i), half);
        folder.file(&format!("in/{i}.raw"), &[&[99], half].concat());
    }
    for fields in [
        "encoding: raw\ndata file: all.raw",
        "encoding: raw\ndatafile: ./all.raw",
        "encoding: gzip\ndata file: in/one file.gz",
        "encoding: raw\ndata file: s%03d.raw 7 5 -2",
        "encoding: raw\ndata file: s%03d.raw 7 5 -2 2",
        "encoding: raw\nbyte skip: 1\ndata file: LIST\nin/0.raw\nin\\1.raw",
        "encoding: raw\nbyte skip: -1\ndata file: LIST 2\nin/0.raw\nin/1.raw\n",
    ] {
        let header = format!("NRRD0004\n{CUBE}type: uchar\n{fields}");
        let data = folder.open("a.nhdr", header.as_bytes());
        assert_eq!(scalar(&data), Values::U8(bytes.clone()), "{fields}");
        assert!(data.notes.is_empty(), "{fields}");
    }
    folder.file("long.raw", &[1; 14]);
    let header = format!("NRRD0004\n{CUBE}type: uchar\nencoding: raw\ndata file: long.raw");
    let data = folder.open("a.nhdr", header.as_bytes());
    assert!(data.notes[0].contains("long.raw"), "{:?}", data.notes);

    for (fields, said) in [
        ("../all.raw", "beside this file"),
        ("/all.raw", "beside this file"),
        ("in/../all.raw", "beside this file"),
        ("http://all.raw", "beside this file"),
        ("none.raw", "no file"),
        ("LIST\nin/0.raw\nin/0.raw", "again"),
        ("LIST\nin/0.raw\n./in/0.raw", "again"),
        (
            "LIST\nin/0.raw\nin/1.raw\nall.raw\nlong.raw\ns007.raw",
            "evenly",
        ),
        ("LIST", "0 files"),
        ("s%03d.raw 7 5 2", "7 to 5 by 2"),
        ("s%03d.raw 5 9 2", "no file"),
        ("s%s.raw 5 7 2", "one number"),
        ("s%d%d.raw 5 7 2", "one number"),
        ("s%99d.raw 5 7 2", "one number"),
        ("a%%.raw 1 1000000000000 1", "one number"),
        (
            "s%03d.raw 9223372036854775807 -9223372036854775808 -1",
            "no file",
        ),
        ("in", "no file"),
    ] {
        let header = format!("NRRD0004\n{CUBE}type: uchar\nencoding: raw\ndata file: {fields}");
        let error = folder.refuse("a.nhdr", header.as_bytes());
        assert!(error.contains(said), "{fields}: {error}");
    }
}

#[test]
fn axes_that_are_not_of_space_are_components_or_entries() {
    let folder = Folder::new();
    let open = |fields: &str| {
        let body: Vec<u8> = (0..48).collect();
        let header = format!("type: uchar\nencoding: raw\n{fields}");
        folder.open("a.nrrd", &file(&header, &body))
    };
    // The vector's axis comes first. It is recognised by its kind, direction or spacing, or because
    // it is the fourth.
    for fields in [
        "dimension: 4\nsizes: 2 2 3 4\nkinds: vector domain domain domain",
        "dimension: 4\nsizes: 2 2 3 4\nspace: RAS\nspace directions: none (1,0,0) (0,1,0) (0, 0, 1)",
        "dimension: 4\nsizes: 2 2 3 4\nspace dimension: 3\nspace directions: (nan,nan,nan) (1,0,0) (0,1,0) (0,0,1)",
        "dimension: 4\nsizes: 2 2 3 4\nspacings: nan 1 1 1",
        "dimension: 4\nsizes: 2 2 3 4",
    ] {
        let data = open(fields);
        assert_eq!(lattice(&data).dims, [2, 3, 4], "{fields}");
        let of = |first: u8| Values::U8((0..24).map(|i| 2 * i + first).collect());
        assert_eq!(components(&data), [of(0), of(1)], "{fields}");
    }
    // The vector's axis comes last.
    let data = open("dimension: 4\nsizes: 2 3 4 2\nkinds: space space space vector");
    assert_eq!(
        components(&data),
        [
            Values::U8((0..24).collect()),
            Values::U8((24..48).collect())
        ]
    );
    for fields in [
        "dimension: 4\nsizes: 2 3 4 2\nkinds: space space space time",
        "dimension: 4\nsizes: 2 3 4 2\nkinds: domain domain domain list",
        "dimension: 4\nsizes: 2 3 4 2\nkinds: domain domain domain domain",
        "dimension: 4\nsizes: 2 3 4 2\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,5)",
    ] {
        let data = open(fields);
        assert_eq!(scalar(&data), Values::U8((0..24).collect()), "{fields}");
        assert_eq!(data.notes, ["The first of 2 volumes."], "{fields}");
    }
    // An image is a single layer.
    let data =
        open("dimension: 2\nsizes: 6 8\nspacings: 2 3\nunits: \"mm\" \"mm\"\nsample units: \"HU\"");
    assert_eq!(lattice(&data).dims, [6, 8, 1]);
    assert_eq!(
        lattice(&data).step([0; 3]).col(2),
        DVec3::new(0.0, 0.0, 2.0)
    );
    assert_eq!(data.unit("value"), Some("HU"));
    let data =
        open("dimension: 2\nsizes: 6 8\nspace dimension: 3\nspace directions: (0,2,0) (0,0,3)");
    assert_eq!(
        lattice(&data).step([0; 3]).col(2),
        DVec3::new(2.0, 0.0, 0.0)
    );
}

#[test]
fn spacings_minima_and_maxima_place_the_samples() {
    let folder = Folder::new();
    let place = |fields: &str| {
        let header = format!("type: uchar\nencoding: raw\ndimension: 3\nsizes: 2 3 4\n{fields}");
        let data = folder.open("a.nrrd", &file(&header, &[7; 24]));
        let lattice = lattice(&data);
        let first = lattice.position([0; 3]);
        (first, lattice.position([1; 3]) - first)
    };
    let v = DVec3::new;
    assert_eq!(place("spacings: 1 -2 3"), (DVec3::ZERO, v(1.0, -2.0, 3.0)));
    // Origins are ITK's for the same headers.
    let fields = "axis mins: -1 0 10\naxis maxs: 1 3 30\ncenters: cell node ???";
    assert_eq!(place(fields), (v(-0.5, 0.0, 12.5), v(1.0, 1.5, 5.0)));
    let fields = "spacings: 1 2 3\naxismins: -1 0 10";
    assert_eq!(place(fields), (v(-0.5, 1.0, 11.5), v(1.0, 2.0, 3.0)));
    assert_eq!(
        place("spacings: 1 2 3\nspace origin: (4,5,6)").0,
        v(4.0, 5.0, 6.0)
    );
}

#[test]
fn what_breaks_the_rules_is_refused() {
    let folder = Folder::new();
    for (header, body, said) in [
        (
            "type: block\ndimension: 3\nsizes: 2 2 2\nencoding: raw",
            8,
            "`type`",
        ),
        ("dimension: 3\nsizes: 2 2 2\nencoding: raw", 8, "`type`"),
        (
            "type: short\ndimension: 3\nsizes: 2 2 2\nencoding: raw",
            16,
            "`endian`",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: lzma",
            8,
            "-e gzip",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw",
            7,
            "8 bytes",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: gzip",
            8,
            "unpacked",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2000000\nencoding: gzip",
            8,
            "8000000 bytes",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: hex",
            16,
            "hexadecimal",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: text",
            16,
            "number",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 9999999999 9999999999 9\nencoding: raw",
            8,
            "sizes",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 0 2\nencoding: raw",
            8,
            "sizes",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2\nencoding: raw",
            8,
            "3 numbers",
        ),
        (
            "type: uchar\ndimension: 1\nsizes: 8\nencoding: raw",
            8,
            "two or three axes",
        ),
        (
            "type: uchar\ndimension: 99\nsizes: 8\nencoding: raw",
            8,
            "1 to 16",
        ),
        (
            "type: uchar\ndimension: 5\nsizes: 1 2 2 2 1\nkinds: domain domain domain domain domain\nencoding: raw",
            8,
            "two or three",
        ),
        (
            "type: uchar\ndimension: 4\nsizes: 2 2 2 1\nkinds: domain vector domain domain\nencoding: raw",
            8,
            "unu permute",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nspacings: 1 0 1\nencoding: raw",
            8,
            "volume",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nspace directions: (1,0,0) (0,1,0\nencoding: raw",
            8,
            "space",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nspace directions: (1,0,0) (0,inf,0) (0,0,1)\nencoding: raw",
            8,
            "space",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nbyte skip: -2",
            8,
            "byteskip",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: gzip\nbyte skip: -1",
            8,
            "-1",
        ),
        (
            "type: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nline skip: 9",
            8,
            "8 bytes",
        ),
        ("type: uchar\nnothing", 8, "line 4"),
    ] {
        let error = folder.refuse("a.nrrd", &file(header, &vec![b'z'; body]));
        assert!(error.contains(said), "{header}: {error}");
    }
    let error = folder.refuse(
        "a.nrrd",
        b"NRRD0004\ntype: uchar\ndimension: 2\nsizes: 1 1\nencoding: raw",
    );
    assert!(error.contains("an empty line"), "{error}");
}

#[test]
fn a_photograph_is_what_pynrrd_reads() {
    let Some(path) = real_data("formats/volumes/beach.nrrd") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(lattice(&data).dims, [100, 100, 1]);
    // Sums of each channel, and of three pixels, by pynrrd 1.1.
    for (channel, sum, pixels) in [
        (0, 2_121_815, [254_u8, 255, 255]),
        (1, 1_916_235, [123, 255, 255]),
        (2, 1_774_863, [0, 255, 255]),
    ] {
        let Values::U8(values) = &components(&data)[channel] else {
            panic!("another type");
        };
        assert_eq!(values.iter().map(|v| u64::from(*v)).sum::<u64>(), sum);
        assert_eq!([17 + 4200, 99, 9900].map(|i| values[i]), pixels);
    }
}
