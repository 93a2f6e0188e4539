//! Tests the picture of each real file without any options.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use crate::commands::{fixture, run, text};
use crate::common::real_data;
use ewa_splat::io::{OpenOptions, RawLayout, RawType, read_image};
use ewa_splat::sample::{FunctionOptions, SampleOptions};
use ewa_splat::scene::Strength;

/// Extensions of files that belong to other files, or whose formats are not read (yet).
const PASSED_OVER: &[&str] = &[
    "md", "txt", "mtl", "bin", "png", "jpg", "webp", "ktx2", "gz", "zip", "geo", "sos", "json",
];

/// Files that are refused for their contents, each with a part of the reason.
const REFUSED: &[(&str, &str)] = &[("beach.ascii.nhdr", "no file")];

/// Files of a few points so far apart that each is far smaller than the picture.
const SCATTERED: &[&str] = &["test-splat.3-points", "concave_polygon"];

const SIZE: usize = 160;

fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, found);
        } else {
            found.push(path);
        }
    }
}

fn is_tried(path: &Path) -> bool {
    let name = path.file_name().unwrap().to_str().unwrap();
    let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
    // Steps of one series and pieces of one grid give similar pictures.
    let is_again = name.contains("T000") && !name.contains("T0000")
        || name.contains("chombo3d_") && name.len() > 14;
    // EnSight variables have no extensions of their own; the samples of a head belong to its
    // header.
    let is_of_ensight = path.components().any(|c| c.as_os_str() == "ensight");
    let is_part = is_of_ensight && ending != "case" || name == "HeadMRVolume.raw";
    // Each of these stands for the images beside it.
    let is_named = ["bluntfinxyz.bin", "meta.json", "OpenFOAM.zip"].contains(&name);
    is_named || !(PASSED_OVER.contains(&ending) || is_again || is_part)
}

#[test]
fn default_pictures_of_all_real_files_show_them() {
    let Some(manifest) = real_data("MANIFEST.md") else {
        return;
    };
    let mut found = Vec::new();
    walk(manifest.parent().unwrap(), &mut found);
    let folder = tempfile::tempdir().unwrap();
    let mut drawn = 0;
    for path in found.iter().filter(|path| is_tried(path)) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let input = path.to_str().unwrap();
        let size = format!("{SIZE}x{SIZE}");
        let mut words = vec![
            "render",
            input,
            "--out",
            "a.npy",
            "--size",
            &size,
            "--backend",
            "cpu",
        ];
        // A raw volume has no metadata.
        words.extend(match name {
            "engine_256x256x128_uint8.raw" => &["--dims", "256,256,128"][..],
            "nucleon_41x41x41_uint8.raw" => &["--dims", "41,41,41"],
            _ => &[],
        });
        let output = run(folder.path(), &words);
        let said = text(&output.stderr);
        if let Some((_, reason)) = REFUSED.iter().find(|(refused, _)| *refused == name) {
            assert!(
                output.status.code() == Some(1) && said.contains(reason),
                "{name}: {said}"
            );
            continue;
        }
        assert!(output.status.success(), "{name}: {said}");
        let image = read_image(&folder.path().join("a.npy")).unwrap();
        let alphas: Vec<f32> = image.pixels.iter().map(|p| p[3]).collect();
        let shown: Vec<usize> = (0..alphas.len()).filter(|&i| alphas[i] > 0.02).collect();
        assert!(!shown.is_empty(), "{name}: nothing to be seen");
        let extent = |of: fn(usize) -> usize| {
            let places = shown.iter().map(|&i| of(i));
            let (first, last) = (places.clone().min().unwrap(), places.max().unwrap());
            (last - first + 1) as f32 / SIZE as f32
        };
        let filled = extent(|i| i % SIZE).max(extent(|i| i / SIZE));
        if SCATTERED
            .iter()
            .all(|scattered| !name.starts_with(scattered))
        {
            // Kernels end softly beyond the boxes that the camera is fitted to.
            assert!((0.33..=1.0).contains(&filled), "{name}: fills {filled}");
        }
        // Something is clearly visible, and half of a picture of a field is transparent: .968 in that of the crushed
        // can's own field (`--reference data`), and .972 here.
        let mut seen: Vec<f32> = shown.iter().map(|&i| alphas[i]).collect();
        seen.sort_by(f32::total_cmp);
        let (middle, most) = (seen[seen.len() / 2], seen[seen.len() - 1]);
        assert!(most > 0.3, "{name}: no more than {most}");
        let is_surface = [
            "gltf",
            "glb",
            "obj",
            "ply",
            "splat",
            "spz",
            "vtp",
            "stl",
            "pvd",
            "json",
            "3mf",
            "beach.nrrd",
            "blow1_bin.case",
            "sampleCurveGrid4.nc",
        ]
        .iter()
        .any(|ending| name.ends_with(ending));
        assert!(
            is_surface || middle < 0.98,
            "{name}: half of it hides all ({middle})"
        );
        drawn += 1;
    }
    assert!(drawn > 30, "{drawn} files");
}

/// Reads the opacities of a transfer function's file.
fn opacities(file: &Path) -> Vec<f64> {
    numbers_of(file, "opacity")
}

/// Reads a number of each point of a transfer function's file.
fn numbers_of(file: &Path, key: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(file).unwrap();
    let function: serde_json::Value = serde_json::from_str(&text).unwrap();
    let points = function["points"].as_array().unwrap();
    points.iter().map(|p| p[key].as_f64().unwrap()).collect()
}

#[test]
fn nothing_of_meshes_and_particles_is_invisible() {
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "unstructured/can.vtu",
        "unstructured/disk_out_ref.vtu",
        "unstructured/CylinderLinear.vtk",
        "particles/phantom_mhd_00000.csv",
        "particles/bunny_frame_14_7705_particles.vtk",
        "particles/halo_low_res.npy",
    ] {
        let Some(path) = real_data(name) else {
            continue;
        };
        let words = [
            "render",
            path.to_str().unwrap(),
            "--out",
            "a.png",
            "--size",
            "32x32",
            "--backend",
            "cpu",
            "--write-transfer-function",
            "f.json",
        ];
        let output = run(folder.path(), &words);
        assert!(output.status.success(), "{name}: {}", text(&output.stderr));
        let found = opacities(&folder.path().join("f.json"));
        assert!(found.iter().all(|o| *o > 0.0), "{name}: {found:?}");
    }
}

/// In lattices and grids, only the background is invisible: a run of values around the mode or at
/// the low end. In other data, at most a twentieth is invisible.
#[test]
fn of_grids_nothing_but_the_background_is_invisible() {
    const BINS: usize = 256;
    let raw = |dims| RawLayout {
        dims,
        spacing: glam::DVec3::ONE,
        origin: glam::DVec3::ZERO,
        scalar: RawType::U8,
        big_endian: false,
    };
    let mut looked_at = 0;
    for (name, layout) in [
        (
            "volumes/engine_256x256x128_uint8.raw",
            Some(raw([256, 256, 128])),
        ),
        ("volumes/nucleon_41x41x41_uint8.raw", Some(raw([41; 3]))),
        ("rectilinear/RectGrid2.vtk", None),
        ("curvilinear/bluntfin/bluntfinxyz.bin", None),
        ("curvilinear/multicomb_0.vts", None),
        ("formats/collections/chombo3d/chombo3d_0.vti", None),
    ] {
        let Some(path) = real_data(name) else {
            continue;
        };
        let options = OpenOptions {
            raw: layout,
            ..OpenOptions::default()
        };
        let dataset = ewa_splat::io::open(&path, &options).unwrap();
        let options = SampleOptions {
            function: FunctionOptions {
                scale: None,
                ..FunctionOptions::default()
            },
            ..SampleOptions::default()
        };
        let volume = ewa_splat::sample::volume(dataset, &options).unwrap().volume;
        let function = volume.transfer_function.unwrap();
        let (values, Strength::Classified { volumes }) = (volume.values.unwrap(), volume.strength)
        else {
            panic!("{name}: not classified");
        };
        let [lo, hi] = function.range();
        let (mut held, mut unseen) = ([0.0; BINS], [0.0; BINS]);
        for i in 0..values.len() {
            let value = values.get(i).clamp(lo, hi);
            if value.is_nan() {
                continue;
            }
            let own = f64::from(volumes.get(i).copied().unwrap_or(1.0));
            let bin = ((value - lo) / (hi - lo) * BINS as f32) as usize;
            let bin = bin.min(BINS - 1);
            held[bin] += own;
            if function.classify(value)[3] <= 0.0 {
                unseen[bin] += own;
            }
        }
        let fullest = (0..BINS)
            .max_by(|a, b| held[*a].total_cmp(&held[*b]))
            .unwrap();
        let is_dark = |bin: usize| held[bin] > 0.0 && unseen[bin] >= 0.5 * held[bin];
        let start = if is_dark(fullest) { fullest } else { 0 };
        // Empty bins do not end a run.
        let run_end = |mut bins: Box<dyn Iterator<Item = usize>>| {
            bins.find(|b| held[*b] > 0.0 && !is_dark(*b))
        };
        let first = run_end(Box::new((0..start).rev())).map_or(0, |b| b + 1);
        let last = run_end(Box::new(start..BINS)).unwrap_or(BINS);
        let whole: f64 = held.iter().sum();
        let beyond = unseen[..first].iter().chain(&unseen[last..]).sum::<f64>() / whole;
        let background = unseen[first..last].iter().sum::<f64>() / whole;
        println!("{name}: background {background:.3}, unseen beyond it {beyond:.4}");
        assert!(beyond < 0.05, "{name}: {beyond} of the volume is not seen");
        assert!(background < 0.95, "{name}: {background} is background");
        looked_at += 1;
    }
    assert!(looked_at == 6 || real_data("MANIFEST.md").is_none());
}

#[test]
fn pieces_of_one_field_share_one_function() {
    let folder = tempfile::tempdir().unwrap();
    let pieces: Option<Vec<PathBuf>> = (0..16)
        .map(|i| real_data(&format!("formats/collections/chombo3d/chombo3d_{i}.vti")))
        .collect();
    let Some(pieces) = pieces else { return };
    let mut words = vec![
        "render",
        "--out",
        "a.png",
        "--size",
        "200x200",
        "--backend",
        "cpu",
        "--legend",
        "--write-transfer-function",
        "f.json",
    ];
    words.extend(pieces.iter().map(|p| p.to_str().unwrap()));
    // Different transfer functions would be refused.
    let output = run(folder.path(), &words);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(opacities(&folder.path().join("f.json")).len() > 2);
}

/// Writes a PLOT3D cube as text, with functions beside it. `first` are its values in the middle of
/// an x from `at` on.
fn plot3d_cube(folder: &Path, name: &str, at: usize, first: f64) {
    let nodes = || (0..729).map(|i| [i % 9, i / 9 % 9, i / 81]);
    let axis = |d: usize| {
        let numbers = nodes().map(|p| p[d] + if d == 0 { at } else { 0 });
        numbers.map(|x| format!("{x} ")).collect::<String>()
    };
    let grid = format!("1\n9 9 9\n{}\n{}\n{}\n", axis(0), axis(1), axis(2));
    let value = |p: [usize; 3]| {
        let squares: f64 = p.iter().map(|&x| (x as f64 - 4.0).powi(2)).sum();
        format!("{} ", first + 10.0 * (-squares / 8.0).exp())
    };
    let functions: String = nodes().map(value).collect();
    std::fs::write(folder.join(format!("{name}.xyz")), grid).unwrap();
    let file = format!("1\n9 9 9 1\n{functions}\n");
    std::fs::write(folder.join(format!("{name}.f")), file).unwrap();
    std::fs::write(folder.join(format!("{name}.nam")), "heat\n").unwrap();
}

#[test]
fn plot3d_grids_with_files_beside_them_are_one_scene() {
    let folder = tempfile::tempdir().unwrap();
    plot3d_cube(folder.path(), "a", 0, 0.0);
    plot3d_cube(folder.path(), "b", 10, 5.0);
    let draw = |words: &[&str]| {
        let common = ["--size", "60x60", "--backend", "cpu", "--quiet"];
        let all = [&["render"][..], words, &common].concat();
        let output = run(folder.path(), &all);
        assert!(output.status.success(), "{}", text(&output.stderr));
    };
    let together = ["a.xyz", "b.xyz", "--out", "ab.npy"];
    draw(&[&together[..], &["--write-transfer-function", "f.json"]].concat());
    let values = numbers_of(&folder.path().join("f.json"), "value");
    let range = [values[0], *values.last().unwrap()];
    // The range runs from the least value of the first cube to the greatest of the second.
    assert!(range[0] < 0.5 && range[1] > 13.0, "{range:?}");
    // The written function draws each as they are drawn together.
    draw(&[
        "a.xyz",
        "b.xyz",
        "--out",
        "again.npy",
        "--transfer-function",
        "f.json",
    ]);
    let [first, again] =
        ["ab.npy", "again.npy"].map(|n| read_image(&folder.path().join(n)).unwrap());
    let apart = first.pixels.iter().zip(&again.pixels).flat_map(|(a, b)| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .collect::<Vec<_>>()
    });
    let apart = apart.fold(0.0_f32, f32::max);
    assert!(apart < 1e-3, "{apart}");
}

#[test]
fn a_turn_and_a_series_are_files_of_one_camera_and_one_function() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |words: &[&str]| {
        let all = [
            &["render"][..],
            words,
            &["--size", "40x40", "--backend", "cpu", "--quiet"],
        ]
        .concat();
        let output = run(folder.path(), &all);
        assert!(
            output.status.success() && output.stderr.is_empty(),
            "{}",
            text(&output.stderr)
        );
    };
    let read = |name: &str| read_image(&folder.path().join(name)).unwrap();
    // Two time steps of a cube of one value on one lattice: the second value is twice the first.
    for (name, value) in [("a.raw", 60_u8), ("b.raw", 120)] {
        let cell = |i: usize| {
            let at = [i % 12, i / 12 % 12, i / 144];
            if at.iter().all(|x| (4..8).contains(x)) {
                value
            } else {
                0
            }
        };
        let bytes: Vec<u8> = (0..1728).map(cell).collect();
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let steps = ["a.raw", "b.raw", "--dims", "12,12,12", "--series"];
    draw(
        &[
            &steps[..],
            &["--out", "s%d.npy", "--write-transfer-function", "f.json"],
        ]
        .concat(),
    );
    let (first, second) = (read("s0.npy"), read("s1.npy"));
    let depth = |image: &ewa_splat::Image| -> f32 { image.pixels.iter().map(|p| p[3]).sum() };
    assert!(depth(&first) > 1.0 && depth(&second) > 1.05 * depth(&first));
    // One camera serves both steps: a step alone has a camera fitted to it, but here objects keep
    // their positions.
    let shown = |image: &ewa_splat::Image| -> Vec<bool> {
        image.pixels.iter().map(|p| p[3] > 0.05).collect()
    };
    let (a, b) = (shown(&first), shown(&second));
    let common = a.iter().zip(&b).filter(|(a, b)| **a && **b).count();
    assert!(common * 10 > a.iter().filter(|a| **a).count() * 9);
    // One function serves both steps: the written one draws the same pictures.
    draw(&[
        "a.raw",
        "--dims",
        "12,12,12",
        "--transfer-function",
        "f.json",
        "--fit",
        "all",
        "--out",
        "own.npy",
    ]);
    // A cube looks the same after a quarter turn, but not after an eighth.
    std::fs::write(folder.path().join("c.raw"), [9_u8; 1728]).unwrap();
    let cube = [
        "c.raw",
        "--dims",
        "12,12,12",
        "--elevation",
        "0",
        "--azimuth",
        "0",
    ];
    draw(&[&cube[..], &["--turntable", "8", "--out", "t%02d.npy"]].concat());
    let difference = |a: &str, b: &str| {
        let (a, b) = (read(a), read(b));
        let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
        pairs.fold(0.0, |most: f32, (x, y)| most.max((x - y).abs()))
    };
    let same = [
        difference("t00.npy", "t02.npy"),
        difference("t00.npy", "t04.npy"),
    ];
    assert!(
        same.iter().all(|d| *d < 0.02),
        "{same:?} {}",
        difference("t00.npy", "t01.npy")
    );
    assert!(difference("t00.npy", "t01.npy") > 0.1);
    assert!(folder.path().join("t07.npy").is_file() && !folder.path().join("t08.npy").exists());
    // Animations hold all pictures: the frame count in APNG's control chunk, frames in GIF.
    draw(&[&cube[..], &["--turntable", "3", "--out", "t.apng"]].concat());
    let bytes = std::fs::read(folder.path().join("t.apng")).unwrap();
    let control = bytes.windows(4).position(|w| w == b"acTL").unwrap();
    assert_eq!(bytes[control + 4..control + 8], [0, 0, 0, 3]);
    draw(
        &[
            &cube[..],
            &["--turntable", "3", "--rate", "10", "--out", "t.gif"],
        ]
        .concat(),
    );
    let bytes = std::fs::read(folder.path().join("t.gif")).unwrap();
    // There is a graphics control extension before each frame, with a delay of ten hundredths.
    let controls = bytes
        .windows(6)
        .filter(|w| w[..3] == [0x21, 0xF9, 4] && w[4..] == [10, 0]);
    assert_eq!(controls.count(), 3);
}

/// Defaults (light on surfaces, a background, room for a legend) cause no refusal of options that
/// are given.
#[test]
fn defaults_stand_beside_every_option() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, vase) = (fixture("wake.xyz"), fixture("vase.obj"));
    for words in [
        &["--composite", "maximum"][..],
        &["--composite", "slabs"],
        &["--composite", "slabs", "--post-classification"],
        &["--composite", "sheets"],
        &["--composite", "axis-sheets"],
        &["--show", "choice"],
        &["--show", "count"],
        &["--opacity", "linear"],
        &["--classify", "particle"],
        &["--sub-pixel-opacity"],
        &["--filter", "exact"],
        &["--flatten", "0.9"],
        &["--clip", "0,0,-1,0", "--cut-faces"],
        &["--unlit"],
        &["--lit"],
    ] {
        for inputs in [&[wake.as_str()][..], &[&wake, &vase, "--count", "2000"]] {
            let size = [
                "--size",
                "24x24",
                "--backend",
                "cpu",
                "--quiet",
                "--out",
                "a.png",
            ];
            // A maximum allows one volume only.
            if inputs.len() > 1 && words.contains(&"maximum") {
                continue;
            }
            let output = run(folder.path(), &[&["render"], inputs, &size, words].concat());
            assert!(
                output.status.success(),
                "{words:?}: {}",
                text(&output.stderr)
            );
        }
    }
}

/// The steps of a collection equal those of the same files, in the order of time. Parts of one time
/// form one picture.
#[test]
fn a_collection_is_a_series_with_times() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |words: &[&str]| {
        let camera = ["--eye", "0,-3,0", "--fov", "35", "--target", "0,0,0"];
        let rest = ["--size", "60x60", "--backend", "cpu"];
        let output = run(
            folder.path(),
            &[&["render"], words, &rest, &camera].concat(),
        );
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let read = |name: &str| read_image(&folder.path().join(name)).unwrap();
    for (name, x) in [("late", 0.3), ("left", -0.3), ("right", 0.3)] {
        let rows = (0..27).map(|i| {
            let at = [i % 3, i / 3 % 3, i / 9].map(|n| 0.1 * f64::from(n) - 0.1);
            format!("{},{},{},.05,{i}\n", at[0] + x, at[1], at[2])
        });
        let table = format!("x,y,z,sigma,f\n{}", rows.collect::<String>());
        std::fs::write(folder.path().join(format!("{name}.csv")), table).unwrap();
    }
    let entries = "<DataSet timestep=\"2.50\" file=\"late.csv\"/>\
                   <DataSet timestep=\"1\" part=\"1\" file=\"right.csv\"/>\
                   <DataSet timestep=\"1\" part=\"0\" file=\"left.csv\"/>";
    let whole =
        format!("<VTKFile type=\"Collection\"><Collection>{entries}</Collection></VTKFile>");
    std::fs::write(folder.path().join("a.pvd"), whole).unwrap();

    draw(&[
        "a.pvd",
        "--series",
        "--out",
        "w%d.npy",
        "--write-transfer-function",
        "f.json",
    ]);
    let series = ["a.pvd", "--series", "--transfer-function", "f.json"];
    draw(&[&series[..], &["--out", "s%d.npy"]].concat());
    // The reference is drawn by hand: both parts, then the other, with the same camera.
    let by_hand = ["--transfer-function", "f.json"];
    draw(
        &[
            &["left.csv", "right.csv", "--out", "both.npy"][..],
            &by_hand,
        ]
        .concat(),
    );
    let [both, first, second] = ["both.npy", "s0.npy", "s1.npy"].map(read);
    assert!(both == first);
    let half = |image: &ewa_splat::Image, left: bool| -> f32 {
        let of_half = |(i, p): (usize, &[f32; 4])| if (i % 60 < 30) == left { p[3] } else { 0.0 };
        image.pixels.iter().enumerate().map(of_half).sum()
    };
    assert!(half(&first, true) > 1.0 && half(&first, false) > 1.0);
    let (left, right) = (half(&second, true), half(&second, false));
    assert!(left.min(right) < 0.01 * left.max(right), "{left} {right}");

    // Without --series, the first step is drawn, and a note says so.
    let said = draw(&["a.pvd", "--out", "own.npy", "--transfer-function", "f.json"]);
    assert!(
        said.contains("the first of 2 time steps, of time 1; --step N")
            && said.contains("--series"),
        "{said}"
    );
    assert!(read("own.npy") == first);

    // A step chosen by its number or time gives the picture of its file.
    let alone = ["--transfer-function", "f.json"];
    draw(&[&["late.csv", "--out", "late.npy"][..], &alone].concat());
    for choice in [
        &["--step", "last"][..],
        &["--step", "1"],
        &["--time", "2.5"],
        &["--time", "1.8"],
    ] {
        let said = draw(&[&["a.pvd", "--out", "chosen.npy"][..], &alone, choice].concat());
        assert!(read("chosen.npy") == read("late.npy"), "{choice:?}");
        assert_eq!(
            said.contains("step 1 of 2, of time 2.5"),
            choice[0] == "--time",
            "{said}"
        );
        assert!(!said.contains("the first of"), "{said}");
    }
    let info = run(
        folder.path(),
        &["info", "a.pvd", "--json", "--step", "last"],
    );
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert!(
        (info["bounds"][0][0].as_f64().unwrap() - 0.2).abs() < 1e-6,
        "{info}"
    );
    for (line, says) in [
        ("a.pvd --step 2", "one of 2 steps, 0 to 1, found 2"),
        (
            "a.pvd --time 2.6",
            "a time from 1 to 2.5, of 2 steps, found 2.6",
        ),
        ("a.pvd --time 0.9", "from 1 to 2.5"),
        ("late.csv --step 0", "a file with steps of time"),
        ("late.csv --time 0", "a file with steps of time"),
        ("a.pvd --step 0 --series", "leave --step and --time out"),
        ("a.pvd --step first", "or last"),
        ("a.pvd --step 0 --time 1", "cannot be used with"),
    ] {
        let words = line
            .split(' ')
            .chain(["--out", "no%d.npy", "--backend", "cpu"]);
        let words: Vec<&str> = ["render"].into_iter().chain(words).collect();
        let output = run(folder.path(), &words);
        let said = text(&output.stderr);
        assert!(
            !output.status.success() && said.contains(says),
            "{line}: {said}"
        );
    }

    // The stamp equals a title written by hand for each time.
    draw(
        &[
            &series[..],
            &["--time-stamp", "t = {time} s", "--out", "t%d.npy"],
        ]
        .concat(),
    );
    for (i, time) in ["1", "2.5"].into_iter().enumerate() {
        let (out, stamp) = (format!("h%d_{i}.npy"), format!("t = {time} s"));
        draw(&[&series[..], &["--time-stamp", &stamp, "--out", &out]].concat());
        assert!(
            read(&format!("t{i}.npy")) == read(&format!("h{i}_{i}.npy")),
            "{time}"
        );
    }
    assert!(read("t0.npy") != read("s0.npy"));

    let output = run(folder.path(), &["info", "a.pvd", "--json"]);
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told["file"], "a.pvd");
    let steps = serde_json::json!([
        { "time": 1.0, "files": ["left.csv", "right.csv"] },
        { "time": 2.5, "files": ["late.csv"] },
    ]);
    assert_eq!(told["time_steps"], steps);
    let output = run(folder.path(), &["info", "a.pvd"]);
    let told = text(&output.stdout);
    assert!(
        told.contains("2.5: late.csv") && told.contains("sigma"),
        "{told}"
    );
}
