//! Tests damaged files: every reader returns a data set or an error, and never panics.
//!
//! The tests cut, flip and splice small files of every format. `EWA_BAD_INPUT_SCALE` multiplies the
//! number of cases.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::sync::OnceLock;

use crate::common::some;
use crate::support::VtkEncoding;
use crate::support::damage::{apply, damage};
use crate::support::gzip;
use crate::support::meshes::{RICH_MTL, RICH_OBJ, jpeg, png, rich_gltf};
use crate::support::seeds::{legacy_vtk, seeds, vtk_grids};
use crate::support::splats::{Ply, some_splats, splat_ply, splat_records, spz_unpacked};
use ewa_splat::Error;
use ewa_splat::image::Image;
use ewa_splat::io::{OpenOptions, RawLayout, RawType, format_of, open, read_image, write_image};
use proptest::prelude::*;

/// Returns names and contents of sound images.
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

/// Checks that an error names what was found and what to do; a panic fails the test by itself.
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
        if name == "a.q" || name == "a.f" {
            // A sound grid lies beside the damaged solution or functions.
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
                ..OpenOptions::default()
            },
        );
        // The grids of solutions and functions, and the files of a series, are absent.
        let needs_others = matches!(name.as_str(), "a.q" | "a.f" | "a.vtk.series");
        assert_eq!(answer.is_err(), needs_others, "{name}: {answer:?}");
        std::fs::remove_file(&path).unwrap();
    }
}

/// Splat files are cut at every byte, packed and unpacked, and headers claim too much.
#[test]
fn splat_files_of_every_length_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let answer = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let answer = open(&path, &OpenOptions::default());
        let is_read = answer.is_ok();
        check(answer.map(drop));
        is_read
    };
    let splats = some_splats(2, 1);
    for encoding in Ply::ALL {
        let file = splat_ply(encoding, "", &splats, &[]);
        // The last byte of a text file is the end of its line.
        let whole = file.len() - usize::from(encoding == Ply::Ascii);
        let read: Vec<usize> = (0..file.len())
            .filter(|&n| answer("a.ply", &file[..n]))
            .collect();
        // A text file cut within its last number is still valid.
        assert!(
            read.iter()
                .all(|&n| encoding == Ply::Ascii && n + 24 > whole),
            "{read:?}"
        );
        let text = String::from_utf8_lossy(&file).into_owned();
        for count in [
            "3",
            "99999999999",
            "18446744073709551615",
            "18446744073709551616",
            "0",
        ] {
            let head = text.replacen("vertex 2", &format!("vertex {count}"), 1);
            let end = head.find("end_header\n").unwrap() + 11;
            let body = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            let claims = [&head.as_bytes()[..end], &file[body..]].concat();
            assert!(!answer("a.ply", &claims), "{count}");
        }
    }
    // One list claims 2^31 items, and an element of no size claims 2^64 rows.
    let head =
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint double l\n";
    let claims = [head.as_bytes(), b"end_header\n\xff\xff\xff\x7f"].concat();
    assert!(!answer("a.ply", &claims));
    let nothing = "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nelement vertex 1\n\
                   property float x\nproperty float y\nproperty float z\nend_header\n1 2 3       ";
    assert!(answer("a.ply", nothing.as_bytes()));
    assert!(answer(
        "a.ply",
        nothing.replace("ascii", "binary_big_endian").as_bytes()
    ));

    let records = splat_records(&splats);
    for n in 0..=records.len() {
        assert_eq!(answer("a.splat", &records[..n]), n > 0 && n % 32 == 0);
    }
    for version in [1, 2, 3] {
        let unpacked = spz_unpacked(version, 0, &splats);
        for n in 0..unpacked.len() {
            // Version 1 has shorter positions, so this writer's files hold more bytes than needed.
            let is_read = answer("a.spz", &gzip(&unpacked[..n]));
            assert_eq!(
                is_read,
                version == 1 && n + 6 >= unpacked.len(),
                "{version}, {n}"
            );
        }
        let packed = gzip(&unpacked);
        for n in 0..packed.len() {
            let is_read = answer("a.spz", &packed[..n]);
            // A version 1 file holds more bytes than needed, so it may be shorter.
            assert!(
                !is_read || version == 1 || n + 8 >= packed.len(),
                "{n} of {}",
                packed.len()
            );
        }
    }
}

/// Opening a pipe would wait for a writer forever.
#[cfg(unix)]
#[test]
fn devices_are_refused_before_they_are_opened() {
    for device in ["/dev/zero", "/dev/null"] {
        let path = std::path::Path::new(device);
        assert!(open(path, &OpenOptions::default()).is_err());
    }
    assert!(read_image(std::path::Path::new("/dev/zero")).is_err());
}

/// Reads a sound index of damaged pieces, and a damaged index of sound ones.
#[test]
fn damaged_indices_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let (_, piece) = &vtk_grids(VtkEncoding::RAW)[2];
    let index = "<VTKFile type=\"PUnstructuredGrid\"><PUnstructuredGrid><Piece Source=\"a.vtu\"/>\
                 <Piece Source=\"b.vtu\"/></PUnstructuredGrid></VTKFile>";
    let answer = |index: &str, piece: &[u8]| {
        std::fs::write(folder.path().join("a.vtu"), piece).unwrap();
        std::fs::write(folder.path().join("b.vtu"), piece).unwrap();
        let path = folder.path().join("a.pvtu");
        std::fs::write(&path, index).unwrap();
        open(&path, &OpenOptions::default()).map(drop)
    };
    answer(index, piece).unwrap();
    for cut in (0..index.len()).step_by(3) {
        check(answer(&index[..cut.max(1)], piece));
        check(answer(
            &(index[..cut].to_owned() + &index[cut + 1..]),
            piece,
        ));
    }
    for cut in (1..piece.len()).step_by(31) {
        check(answer(index, &piece[..cut]));
        check(answer(index, &[&piece[..cut], &piece[cut + 1..]].concat()));
    }
}

/// Reads collections of a sound file, cut and with bytes removed.
#[test]
fn damaged_collections_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), "x,y,z\n0,0,0\n").unwrap();
    let path = folder.path().join("a.pvd");
    let text = "<VTKFile type=\"Collection\"><Collection><DataSet timestep=\"0.5\" part=\"0\" \
                file=\"a.csv\"/><DataSet timestep=\"1\" file=\"a.csv\"/></Collection></VTKFile>";
    let answer = |text: &[u8]| {
        std::fs::write(&path, text).unwrap();
        check(open(&path, &OpenOptions::default()).map(drop));
        check(
            format_of(&path, &OpenOptions::default())
                .and_then(|f| f.time_steps(&path))
                .map(drop),
        );
    };
    for cut in 0..text.len() {
        answer(&text.as_bytes()[..cut]);
        let mut bytes = text.as_bytes().to_vec();
        bytes[cut] ^= 1;
        answer(&bytes);
        bytes.remove(cut);
        answer(&bytes);
    }
    std::fs::write(&path, text).unwrap();
    open(&path, &OpenOptions::default()).unwrap();
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

/// A file cut anywhere gives an error or, after a whole section, the data up to there.
#[test]
fn legacy_files_cut_at_every_byte_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.vtk");
    for bytes in legacy_vtk() {
        let mut errors = 0;
        let lengths = some(1..bytes.len(), bytes.len(), 4);
        let answered = lengths.len();
        for len in lengths {
            std::fs::write(&path, &bytes[..len]).unwrap();
            let answer = open(&path, &OpenOptions::default());
            errors += usize::from(answer.is_err());
            check(answer.map(drop));
        }
        // There are few whole sections, but each may be followed by a name or a blank.
        assert!(errors > answered / 2, "{errors} of {answered}");
    }
}

/// A count that the file cannot hold is refused before the reader allocates, or waits for, that
/// many items.
#[test]
fn legacy_files_with_wrong_counts_are_answered_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("counts.vtk");
    for bytes in legacy_vtk() {
        let text: Vec<u8> = bytes.clone();
        let mut at = 0;
        while let Some(start) = text[at..].iter().position(u8::is_ascii_digit) {
            let start = at + start;
            let len = text[start..]
                .iter()
                .take_while(|b| b.is_ascii_digit())
                .count();
            at = start + len;
            let counts = [
                "0",
                "3",
                "4294967295",
                "9223372036854775807",
                "18446744073709551615",
            ];
            for count in some(counts, start, 2) {
                let damaged = [&text[..start], count.as_bytes(), &text[at..]].concat();
                std::fs::write(&path, damaged).unwrap();
                check(open(&path, &OpenOptions::default()).map(drop));
            }
        }
    }
}

/// Meshes, materials and images are cut at every byte and changed at every byte; in long files, at
/// one byte in sixteen.
#[test]
fn mesh_files_of_every_length_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let image = png(2, &[[255, 0, 0, 255], [0, 255, 0, 128]].repeat(2));
    let file = rich_gltf();
    write("a.mtl", RICH_MTL.as_bytes());
    write("a.png", &image);
    write("b.obj", RICH_OBJ.as_bytes());
    write(
        "c.mtl",
        b"newmtl red paint\nKd .5 .5 .5\nmap_Kd c.jpg\nmap_d a.png\n",
    );
    write("c.obj", RICH_OBJ.replace("a.mtl", "c.mtl").as_bytes());
    for (damaged, opened, bytes) in [
        ("a.obj", "a.obj", RICH_OBJ.as_bytes()),
        ("a.mtl", "b.obj", RICH_MTL.as_bytes()),
        ("a.png", "b.obj", &image),
        ("c.jpg", "c.obj", &jpeg(9, [1, 200, 99])),
        ("a.glb", "a.glb", &file.glb()),
        ("a.gltf", "a.gltf", &file.text()),
    ] {
        let answer = |bytes: &[u8]| {
            write(damaged, bytes);
            let answer = open(&folder.path().join(opened), &OpenOptions::default());
            let is_read = answer.is_ok();
            check(answer.map(drop));
            is_read
        };
        assert!(answer(bytes), "{damaged}");
        let step = if bytes.len() > 300 { 16 } else { 1 };
        let places = (0..bytes.len()).step_by(step);
        let cut = places.clone().filter(|&n| answer(&bytes[..n])).count();
        let mut changed = bytes.to_vec();
        let mut read = 0;
        for i in places.clone() {
            for byte in [0xff, bytes[i] ^ 1, b'9'] {
                changed[i] = byte;
                read += usize::from(answer(&changed));
            }
            changed[i] = bytes[i];
        }
        let count = places.len();
        println!("{damaged}: {cut} of {count} cut and {read} changed ones are read");
        write(damaged, bytes);
        // Materials and images may be missing; meshes may not.
        let is_mesh = damaged == opened;
        assert!(is_mesh || cut == count, "{damaged}: {cut}");
        assert!(is_mesh || read == 3 * count, "{damaged}: {read}");
    }
}
