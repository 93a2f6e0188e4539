//! Tests films: AV1 in MP4 files. `python/tests/test_films.py` decodes one, if PyAV is installed.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use crate::commands::{run, text};

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures");

/// Draws a turntable and returns the program's messages.
fn film(folder: &Path, options: &str) -> Result<String, String> {
    let cloud = format!("{FIXTURES}/particles.csv");
    let words: Vec<&str> = options.split_whitespace().collect();
    let always = ["render", &cloud, "--backend", "cpu"];
    let output = run(folder, &[&always[..], &words].concat());
    let said = text(&output.stderr);
    if output.status.success() {
        Ok(said)
    } else {
        Err(said)
    }
}

/// Returns the boxes in a box's contents: name, and contents.
fn boxes(mut bytes: &[u8]) -> Vec<(String, &[u8])> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let length = u32::from_be_bytes(bytes[..4].try_into().unwrap()) as usize;
        let (head, length) = match length {
            1 => (
                16,
                u64::from_be_bytes(bytes[8..16].try_into().unwrap()) as usize,
            ),
            _ => (8, length),
        };
        found.push((text(&bytes[4..8]), &bytes[head..length]));
        bytes = &bytes[length..];
    }
    found
}

/// Returns the contents of the box with this path of names.
fn inside<'b>(bytes: &'b [u8], path: &str) -> &'b [u8] {
    path.split('/').fold(bytes, |bytes, name| {
        let found = boxes(bytes).into_iter().find(|(own, _)| own == name);
        found.unwrap_or_else(|| panic!("{name} of {path}")).1
    })
}

fn numbers(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|word| u32::from_be_bytes(*word)).collect()
}

#[test]
fn a_film_is_one_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let options = "--turntable 5 --rate 2 --size 33x18 --out a.mp4";
    film(folder.path(), options).unwrap();
    // Nothing else is left in the folder.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let bytes = std::fs::read(folder.path().join("a.mp4")).unwrap();
    let names: Vec<String> = boxes(&bytes).into_iter().map(|(name, _)| name).collect();
    // The index is before the pictures, for players that read from the network.
    assert_eq!(names, ["ftyp", "moov", "mdat"]);
    let media = inside(&bytes, "moov/trak/mdia");
    let table = |name: &str| inside(media, &format!("minf/stbl/{name}"));
    // Five pictures of half a second.
    let time = numbers(inside(media, "mdhd"));
    assert_eq!(2 * time[4], 5 * time[3]);
    let [.., count, step] = numbers(table("stts"))[..] else {
        panic!("an empty table")
    };
    assert_eq!((count, 2 * step), (5, time[3]));
    // A player may start every two seconds, which are four pictures.
    assert_eq!(numbers(table("stss"))[1..], [2, 1, 5]);
    assert_eq!(numbers(table("stsc"))[1..], [1, 1, 5, 1]);
    let sizes = numbers(table("stsz"))[3..].to_vec();
    let data = inside(&bytes, "mdat");
    assert_eq!(sizes.len(), 5);
    assert_eq!(sizes.iter().sum::<u32>() as usize, data.len());
    let place = numbers(table("co64"));
    assert_eq!(place[3] as usize, bytes.len() - data.len());
    // Each sample is made of whole OBUs with lengths, the keys begin with a sequence header (type 1), and none is a temporal
    // delimiter (type 2).
    let mut rest = data;
    for (i, size) in sizes.iter().enumerate() {
        let (mut sample, after) = rest.split_at(*size as usize);
        rest = after;
        let mut kinds = Vec::new();
        while let Some(first) = sample.first() {
            assert_eq!(first & 0b0000_0110, 2, "no extension, a length");
            kinds.push(first >> 3);
            let digits = sample[1..]
                .iter()
                .position(|byte| byte & 0x80 == 0)
                .unwrap()
                + 1;
            let length = (0..digits).fold(0, |sum, k| {
                sum | usize::from(sample[1 + k] & 0x7F) << (7 * k)
            });
            sample = &sample[1 + digits + length..];
        }
        assert_eq!(kinds.contains(&1), i % 4 == 0, "{kinds:?}");
        assert!(!kinds.contains(&2), "{kinds:?}");
    }
    // The description: 33 x 18 pixels, 8 bits in 4:2:0 of level 4.0, colours of BT.709 with the curve of sRGB, limited.
    let coding = boxes(&table("stsd")[8..]).remove(0);
    assert_eq!(coding.0, "av01");
    assert_eq!(coding.1[24..28], [0, 33, 0, 18]);
    let parts = &coding.1[78..];
    assert_eq!(inside(parts, "av1C")[..4], [0x81, 8, 0x0D, 0]);
    assert_eq!(inside(parts, "colr"), b"nclx\0\x01\0\x0D\0\x01\0");
    // It is the same on every machine.
    film(folder.path(), options).unwrap();
    assert!(bytes == std::fs::read(folder.path().join("a.mp4")).unwrap());
}

#[test]
fn films_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let said = film(folder.path(), "--turntable 3 --size 32x15 --out a.mp4").unwrap_err();
    assert!(said.contains("sides of 16 to"), "{said}");
    let said = film(folder.path(), "--size 32x32 --out a.mp4").unwrap_err();
    assert!(said.contains("mp4"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let options = "--turntable 3 --size 32x32 --background none --out a.mp4";
    let said = film(folder.path(), options).unwrap();
    assert!(said.contains("over black"), "{said}");
}

/// A camera that moves for 1.5 seconds gives six pictures and the last, at four a second.
#[test]
fn cameras_of_gltf_move() {
    let folder = tempfile::tempdir().unwrap();
    let path = format!("--camera-path {FIXTURES}/cameras/moving.gltf --size 32x32");
    film(folder.path(), &format!("{path} --rate 4 --out a.mp4")).unwrap();
    let bytes = std::fs::read(folder.path().join("a.mp4")).unwrap();
    let sizes = numbers(inside(&bytes, "moov/trak/mdia/minf/stbl/stsz"));
    assert_eq!(sizes[2], 7);
    let one = format!("--camera {FIXTURES}/cameras/moving.gltf --camera-name still --size 32x32");
    film(folder.path(), &format!("{one} --out a.png")).unwrap();
}
