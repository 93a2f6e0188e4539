//! Tests `--depth-in` and `--background-image`: files of another renderer that the picture stands in.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::{read_depth, read_image, write_depth, write_image};
use ewa_splat::{DepthImage, Image};

use crate::commands::{run, text};

const SIZE: [usize; 2] = [64, 48];
const VIEW: &str = "render cloud.csv --eye 0,-8,0 --target 0,0,0 --up 0,0,1 --unlit";

/// Writes overlapping spheres about the origin.
fn folder() -> tempfile::TempDir {
    let row = |i: u32| {
        let at =
            |prime: u32, count: u32| f64::from(i * prime % count) / f64::from(count) * 2.0 - 1.0;
        format!("{},{},{},0.2,0.05\n", at(37, 101), at(71, 103), at(53, 107))
    };
    let rows: String = (0..200).map(row).collect();
    let folder = tempfile::tempdir().unwrap();
    let table = format!("x,y,z,radius,mass\n{rows}");
    std::fs::write(folder.path().join("cloud.csv"), table).unwrap();
    folder
}

fn picture(folder: &Path, options: &str) -> Image {
    let lens = if options.contains("--ortho") {
        ""
    } else {
        "--fov 30"
    };
    let backend = if options.contains("--reference") {
        ""
    } else {
        "--backend cpu"
    };
    let line = format!("{VIEW} {lens} {backend} {options} --out picture.npy");
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    read_image(&folder.join("picture.npy")).unwrap()
}

fn refusal(folder: &Path, options: &str) -> String {
    let line = format!("{VIEW} {options} --out refused.npy");
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(!output.status.success(), "{line}");
    assert!(!folder.join("refused.npy").exists());
    text(&output.stderr)
}

/// Returns a plane across the view: it stands 7.9 to 8.4 in front of the eye, in the right half of the picture.
fn depths() -> DepthImage {
    let [width, height] = SIZE;
    let at = |i: usize| match i % width {
        x if x < width / 2 => f32::INFINITY,
        x => 7.9 + 0.5 * (x as f32 / width as f32),
    };
    DepthImage {
        width,
        height,
        depths: (0..width * height).map(at).collect(),
    }
}

fn difference(a: &Image, b: &Image) -> f32 {
    assert_eq!([a.width, a.height], [b.width, b.height]);
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn depths_of_every_format_and_kind_end_rays_at_the_same_places() {
    let folder = folder();
    let folder = folder.path();
    let own = depths();
    let [width, height] = SIZE;
    for name in ["z.npy", "z.exr", "z.pfm"] {
        write_depth(&folder.join(name), &own).unwrap();
        assert_eq!(read_depth(&folder.join(name)).unwrap(), own);
    }
    // The picture has the size of the depths.
    let ended = picture(folder, "--depth-in z.npy");
    assert_eq!([ended.width, ended.height], SIZE);
    for name in ["z.exr", "z.pfm"] {
        assert_eq!(picture(folder, &format!("--depth-in {name}")), ended);
    }
    let whole = picture(folder, "--size 64x48");
    for i in 0..width * height {
        match own.depths[i] < f32::INFINITY {
            true => assert!(ended.pixels[i][3] <= whole.pixels[i][3] + 1e-3),
            false => assert!((ended.pixels[i][3] - whole.pixels[i][3]).abs() < 1e-6),
        }
    }
    assert!(difference(&ended, &whole) > 0.1);

    let slope = |i: usize, n: usize| {
        (i as f32 + 0.5 - n as f32 / 2.0) / (height as f32 / 2.0) * 15.0_f32.to_radians().tan()
    };
    let along_rays = |i: usize| {
        let (x, y) = (slope(i % width, width), slope(i / width, height));
        own.depths[i] * (1.0 + x * x + y * y).sqrt()
    };
    let (near, far) = (0.5_f64, 40.0_f64);
    let buffer = |i: usize| match f64::from(own.depths[i]) {
        f64::INFINITY => 1.0,
        z => ((far - near * far / z) / (far - near)) as f32,
    };
    for (name, depths) in [
        ("distance", (0..width * height).map(along_rays).collect()),
        (
            "opengl",
            (0..width * height).map(buffer).collect::<Vec<f32>>(),
        ),
    ] {
        let depth = DepthImage {
            width,
            height,
            depths,
        };
        write_depth(&folder.join("other.npy"), &depth).unwrap();
        let range = if name == "opengl" {
            "--depth-in-range 0.5,40"
        } else {
            ""
        };
        let other = picture(
            folder,
            &format!("--depth-in other.npy --depth-in-is {name} {range}"),
        );
        // A depth of OpenGL has six digits of what is left to the far plane: 2e-5 of the depth here.
        let most = difference(&other, &ended);
        assert!(most < 1e-4, "{name}: {most}");
    }
    // Orthographic depths of OpenGL are linear.
    let ortho = "--ortho 4";
    let ended = picture(folder, &format!("{ortho} --depth-in z.npy"));
    let linear = |z: &f32| match *z {
        f32::INFINITY => 1.0,
        z => ((f64::from(z) - near) / (far - near)) as f32,
    };
    let depth = DepthImage {
        width,
        height,
        depths: own.depths.iter().map(linear).collect(),
    };
    write_depth(&folder.join("other.npy"), &depth).unwrap();
    let other = picture(
        folder,
        &format!("{ortho} --depth-in other.npy --depth-in-is opengl --depth-in-range 0.5,40"),
    );
    assert!(difference(&other, &ended) < 1e-4);
    write_depth(&folder.join("other.npy"), &own).unwrap();
    let other = picture(
        folder,
        &format!("{ortho} --depth-in other.npy --depth-in-is distance"),
    );
    assert_eq!(other, ended);
}

#[test]
fn a_picture_stands_behind_the_scene() {
    let folder = folder();
    let folder = folder.path();
    let [width, height] = SIZE;
    let colour = |i: usize| match i % width < width / 2 {
        true => [0.0; 4],
        false => [0.1, 0.4, 0.8, 1.0],
    };
    let wall = Image {
        width,
        height,
        pixels: (0..width * height).map(colour).collect(),
    };
    write_image(&folder.join("wall.exr"), &wall).unwrap();
    write_depth(&folder.join("z.npy"), &depths()).unwrap();
    for depth in ["", "--depth-in z.npy"] {
        let size = "--size 64x48";
        let bare = picture(folder, &format!("{depth} {size}"));
        let over = picture(folder, &format!("{depth} --background-image wall.exr"));
        let on_green = picture(
            folder,
            &format!("{depth} --background-image wall.exr --background 0,1,0"),
        );
        for i in 0..width * height {
            let mix = |behind: [f32; 4]| {
                let p = bare.pixels[i];
                [0, 1, 2, 3].map(|c: usize| p[c] + (1.0 - p[3]) * behind[c])
            };
            let green = match wall.pixels[i][3] > 0.5 {
                true => wall.pixels[i],
                false => [0.0, 1.0, 0.0, 1.0],
            };
            for (found, expected) in [
                (over.pixels[i], mix(wall.pixels[i])),
                (on_green.pixels[i], mix(green)),
            ] {
                for c in 0..4 {
                    assert!(
                        (found[c] - expected[c]).abs() < 2e-6,
                        "{found:?}, {expected:?}"
                    );
                }
            }
        }
    }
    // The reference image stands in the same picture: one ray through each pixel's centre.
    let options = "--depth-in z.npy --background-image wall.exr --low-pass 0 --tolerance 0.001";
    let drawn = picture(folder, &format!("{options} --composite slabs"));
    let reference = picture(folder, &format!("{options} --reference=kernels"));
    // The error of slabs without a backdrop is 3e-3.
    let most = difference(&drawn, &reference);
    assert!(most < 0.01, "{most}");
}

#[test]
fn a_picture_in_another_renderers_scene_can_be_checked() {
    let folder = folder();
    let folder = folder.path();
    write_depth(&folder.join("z.npy"), &depths()).unwrap();
    write_image(&folder.join("wall.exr"), &Image::new(SIZE[0], SIZE[1])).unwrap();
    let line = format!(
        "{VIEW} --fov 30 --depth-in z.npy --background-image wall.exr --deep deep.exr --depth mean.npy --depth-of mean \
         --out made.png"
    );
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(!output.status.success());
    assert!(
        text(&output.stderr).contains("--deep"),
        "deep images have no backdrop"
    );
    let words: Vec<&str> = words
        .into_iter()
        .filter(|w| !["--deep", "deep.exr"].contains(w))
        .collect();
    let words = &words[..words.len() - 6];
    let words = [words, &["--out", "made.png"]].concat();
    let output = run(folder, &words);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let verified = |word: &str| {
        let output = run(folder, &["verify", "made.png"]);
        let said = text(&output.stdout) + &text(&output.stderr);
        assert!(said.contains(word), "{said}");
    };
    verified("equal");
    let mut other = depths();
    other.depths[3] = 2.0;
    write_depth(&folder.join("z.npy"), &other).unwrap();
    verified("z.npy");
}

#[test]
fn deep_images_and_their_depths_are_written_beside_the_picture() {
    let folder = folder();
    let folder = folder.path();
    let drawn = |options: &str| {
        picture(
            folder,
            &format!("--size 64x48 --opaque-edges off {options}"),
        )
    };
    let whole = drawn("--deep deep.exr --depth entry.npy --depth-of entry");
    let entry = read_depth(&folder.join("entry.npy")).unwrap();
    assert_eq!(drawn("--depth exit.npy --depth-of exit"), whole);
    let exit = read_depth(&folder.join("exit.npy")).unwrap();
    assert_eq!(drawn("--depth kernel.npy"), whole);
    let kernel = read_depth(&folder.join("kernel.npy")).unwrap();
    let mut inside = 0;
    for i in 0..entry.depths.len() {
        let (entry, kernel, exit) = (entry.depths[i], kernel.depths[i], exit.depths[i]);
        assert_eq!(entry < f32::INFINITY, exit < f32::INFINITY);
        if kernel < f32::INFINITY {
            // The kernel's own depth is that of its centre.
            assert!(entry <= exit && entry < kernel + 0.3 && kernel < exit + 0.6);
            inside += 1;
        }
    }
    assert!(inside > 100, "{inside}");
    let bytes = std::fs::read(folder.join("deep.exr")).unwrap();
    assert_eq!(bytes[..8], [0x76, 0x2f, 0x31, 0x01, 2, 8, 0, 0]);
    for options in [
        "--deep deep.png",
        "--depth-of mean",
        "--deep deep.exr --turntable 3",
        "--depth k.npy --depth-of mean --depth-in entry.npy",
    ] {
        refusal(folder, options);
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = folder();
    let folder = folder.path();
    write_depth(&folder.join("z.npy"), &depths()).unwrap();
    let mut nan = depths();
    nan.depths[5] = f32::NAN;
    write_depth(&folder.join("nan.npy"), &nan).unwrap();
    write_image(&folder.join("small.exr"), &Image::new(8, 8)).unwrap();
    std::fs::write(
        folder.join("cut.exr"),
        &std::fs::read(folder.join("small.exr")).unwrap()[..60],
    )
    .unwrap();
    for (options, word) in [
        ("--depth-in z.npy --size 32x32", "32 x 32"),
        ("--depth-in nan.npy", "NaN in 1"),
        ("--depth-in none.npy", "none.npy"),
        ("--depth-in cloud.csv", "exr, pfm or npy"),
        ("--depth-in cut.exr", "cut.exr"),
        ("--depth-in small.exr", "channel Z"),
        ("--depth-in z.npy --background-image small.exr", "8 x 8"),
        ("--depth-in z.npy --depth-in-is opengl", "--depth-in-range"),
        ("--depth-in z.npy --depth-in-range 1,2", "--depth-in-range"),
        (
            "--depth-in z.npy --depth-in-is opengl --depth-in-range 1,2",
            "0 to 1",
        ),
        (
            "--depth-in z.npy --depth-in-is opengl --depth-in-range 2,1",
            "the second greater",
        ),
        ("--depth-in-is distance", "--depth-in"),
        ("--depth-in z.npy --column-density", "--column-density"),
        ("--depth-in z.npy --turntable 4", "--turntable"),
    ] {
        let error = refusal(folder, options);
        assert!(error.contains(word), "{options}: {error}");
    }
}
