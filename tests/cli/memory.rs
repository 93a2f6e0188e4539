//! Tests files that are large compared with the available memory.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use ewa_splat::SceneOptions;
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::prepared::PreparedScene;
use ewa_splat::sample::{SampleOptions, scene};

use crate::commands::{fixture, run, text};
use crate::common::Random;

/// Writes spheres with masses to an NPY file.
fn write_spheres(path: &Path, count: usize) {
    let columns = ["x", "y", "z", "sigma", "mass"].map(|name| format!("('{name}', '<f4')"));
    let mut header = format!(
        "{{'descr': [{}], 'fortran_order': False, 'shape': ({count},), }}",
        columns.join(", ")
    );
    while !(10 + header.len()).is_multiple_of(64) {
        header.push(' ');
    }
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
    bytes.extend(header.bytes());
    let mut random = Random::new(9);
    for _ in 0..count {
        let mut number = || random.range(0.0, 1.0) as f32;
        let sphere = [
            number(),
            number(),
            number(),
            0.001 + 0.001 * number(),
            number(),
        ];
        bytes.extend(sphere.iter().flat_map(|x| x.to_le_bytes()));
    }
    fs::write(path, bytes).unwrap();
}

/// More than four million points are prepared on disk, with the same file as in memory.
#[test]
fn many_points_are_prepared_on_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("many.npy");
    write_spheres(&path, (1 << 22) + 1000);
    let output = run(
        folder.path(),
        &[
            "convert",
            "many.npy",
            "--out",
            "many.arrow",
            "--level-of-detail",
            "off",
        ],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("4195304"));
    let (_, about) = PreparedScene::open(&folder.path().join("many.arrow")).unwrap();
    assert_eq!(about.inputs, ["many.npy"]);
    assert_eq!(
        (about.fields.as_slice(), about.up),
        (&[None][..], [0.0, 0.0, 1.0])
    );
    let whole = open(&path, &OpenOptions::default()).unwrap();
    let (low, high) = whole.bounds().unwrap();
    assert_eq!(about.corners, [[low.to_array(), high.to_array()]]);
    let whole = scene(whole, &SampleOptions::default()).unwrap();
    let options = SceneOptions {
        level_of_detail: false,
        ..SceneOptions::default()
    };
    let whole = PreparedScene::new(whole.volumes, &options).unwrap();
    whole
        .write(&folder.path().join("whole.arrow"), &about)
        .unwrap();
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("many.arrow") == bytes("whole.arrow"));
    // No other file is left: temporary files have no names.
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    // Options that do not apply to such points are refused as for few points.
    let refused = run(
        folder.path(),
        &[
            "convert",
            "many.npy",
            "--transfer-function",
            "viridis",
            "--out",
            "a.arrow",
        ],
    );
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("--transfer-function"));
}

/// Runs the program with a limited address space, in kilobytes.
fn run_within(folder: &Path, kilobytes: usize, arguments: &[&str]) -> Output {
    Command::new("sh")
        .current_dir(folder)
        .args([
            "-c",
            &format!("ulimit -v {kilobytes} && exec \"$0\" \"$@\""),
        ])
        .arg(env!("CARGO_BIN_EXE_ewa-splat"))
        .args(arguments)
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .unwrap()
}

/// Writes an image of 512 x 512 x 1280 zeros, compressed by zlib.
fn write_packed(path: &Path) {
    use std::io::Write;

    const BLOCK: usize = 1 << 25;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(&vec![0; BLOCK]).unwrap();
    let block = encoder.finish().unwrap();
    let mut bytes = b"<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" \
        header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"><ImageData \
        WholeExtent=\"0 511 0 511 0 1279\"><Piece Extent=\"0 511 0 511 0 1279\"><PointData>\
        <DataArray type=\"UInt8\" Name=\"v\" format=\"appended\" offset=\"0\"/></PointData></Piece>\
        </ImageData><AppendedData encoding=\"raw\">_"
        .to_vec();
    let mut words = vec![10, BLOCK as u64, 0];
    words.extend([block.len() as u64; 10]);
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    (0..10).for_each(|_| bytes.extend(&block));
    bytes.extend(b"</AppendedData></VTKFile>");
    fs::write(path, bytes).unwrap();
}

/// Small files that expand beyond the memory are detected by their counts before they are expanded.
#[test]
fn packed_arrays_and_surfels_without_room_are_refused_before_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    write_packed(&folder.path().join("packed.vti"));
    let vase = fixture("vase.glb");
    let cases: [(&[&str], [&str; 2]); 2] = [
        (
            &["render", "packed.vti", "--backend", "cpu", "--out", "a.png"],
            ["numbers that fit into", "found 0.34 GB"],
        ),
        (
            &["convert", &vase, "--count", "20000000", "--out", "a.ply"],
            ["numbers that fit into", "found 4.00 GB for 20000000"],
        ),
    ];
    for (arguments, words) in cases {
        let output = run_within(folder.path(), 300 << 10, arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?} {error}");
        for word in words {
            assert!(error.contains(word), "{error}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn memory_that_there_is_not_ends_in_one_line_and_in_no_file() {
    let folder = tempfile::tempdir().unwrap();
    write_spheres(&folder.path().join("spheres.npy"), 3_000_000);
    fs::write(folder.path().join("cube.raw"), vec![7; 1 << 27]).unwrap();
    let commands: [&[&str]; 3] = [
        &[
            "render",
            "spheres.npy",
            "--backend",
            "cpu",
            "--size",
            "32x32",
            "--out",
            "a.png",
        ],
        &["convert", "spheres.npy", "--out", "a.arrow"],
        &[
            "render",
            "cube.raw",
            "--dims",
            "512,512,512",
            "--backend",
            "cpu",
            "--out",
            "a.png",
        ],
    ];
    for arguments in commands {
        let mut said = Vec::new();
        for megabytes in [200, 240, 320] {
            let output = run_within(folder.path(), megabytes << 10, arguments);
            let error = text(&output.stderr);
            if output.status.success() {
                continue;
            }
            assert_eq!(output.status.code(), Some(1), "{arguments:?} {error}");
            let is_line = error.starts_with("error: ") && error.trim_end().lines().count() == 1;
            assert!(is_line, "{error}");
            assert!(
                !folder.path().join("a.png").exists() && !folder.path().join("a.arrow").exists()
            );
            said.push(error);
        }
        assert!(!said.is_empty(), "{arguments:?} took no memory");
    }
}

/// Folders that are data sets are not taken for files of rows.
#[test]
fn folders_are_prepared_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["plt00010", "dicom/oblique"] {
        let input = fixture(name);
        let output = run(folder.path(), &["convert", &input, "--out", "a.arrow"]);
        assert!(output.status.success(), "{name}: {}", text(&output.stderr));
        assert!(PreparedScene::open(&folder.path().join("a.arrow")).is_ok());
    }
}
