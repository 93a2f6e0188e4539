//! Tests splats of radiance fields: the space of blending, and fitted cameras.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::Image;
use ewa_splat::image::{linear_from_srgb, srgb_from_linear};
use ewa_splat::io::{SplatCloud, SplatFileOptions, read_image, write_splats};
use glam::DVec3;

use crate::commands::{run, text};

/// Runs the program, which must succeed, and returns its messages.
fn done(folder: &Path, line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    text(&output.stderr)
}

fn picture(folder: &Path, line: &str) -> Image {
    done(folder, &format!("render {line} --backend cpu --out p.npy"));
    read_image(&folder.join("p.npy")).unwrap()
}

/// Writes round splats: position, standard deviation, opacity and colour of each.
fn write(path: &Path, is_linear: bool, splats: &[(DVec3, f32, f32, [f32; 3])]) {
    let constant = |c: f32| (c - 0.5) / 0.282_094_8;
    let cloud = SplatCloud {
        positions: splats.iter().map(|s| s.0).collect(),
        scales: splats.iter().map(|s| [s.1; 3]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; splats.len()],
        opacities: splats.iter().map(|s| s.2).collect(),
        harmonics: splats.iter().flat_map(|s| s.3.map(constant)).collect(),
        is_linear,
        ..SplatCloud::default()
    };
    write_splats(path, &cloud, &SplatFileOptions::default()).unwrap();
}

/// Camera at (0, 0, 3) that looks along -z.
const FRONT: &str = "--eye 0,0,3 --target 0,0,0 --up 0,1,0 --size 65x65";

fn near(found: f32, expected: f32, most: f32) {
    assert!((found - expected).abs() <= most, "{found}, {expected}");
}

#[test]
fn splats_blend_in_the_space_that_they_state() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let white = [(DVec3::ZERO, 0.5, 0.5, [1.0; 3])];
    write(&folder.join("codes.glb"), false, &white);
    write(&folder.join("light.glb"), true, &white);
    write(&folder.join("codes.ply"), false, &white);
    let middle = |line: &str| picture(folder, &format!("{line} {FRONT}")).pixel(32, 32);
    for file in ["codes.glb", "codes.ply"] {
        // Half-opaque white over black gives the code one half, as in every viewer.
        let [r, g, b, a] = middle(&format!("{file} --background 0,0,0"));
        assert!(r == g && g == b && a == 1.0);
        near(srgb_from_linear(r), 0.5, 1e-3);
        // A lighter background gives the mean of the codes.
        let [r, ..] = middle(&format!("{file} --background 0.5,0.5,0.5"));
        let halfway = 0.5 + 0.5 * srgb_from_linear(0.5);
        near(srgb_from_linear(r), halfway, 1e-3);
        // Without a background, the result is white with opacity one half.
        let [r, _, _, a] = middle(&format!("{file} --background none"));
        near(a, 0.5, 1e-3);
        near(r / a, 1.0, 1e-5);
        let [r, ..] = middle(&format!("{file} --background 0,0,0 --blend linear"));
        near(r, 0.5, 1e-3);
    }
    let [r, ..] = middle("light.glb --background 0,0,0");
    near(r, 0.5, 1e-3);
    let [r, ..] = middle("light.glb --background 0,0,0 --blend encoded");
    near(srgb_from_linear(r), 0.5, 1e-3);

    // For colours behind one another, codes are mixed, and the result is decoded once.
    let two = [
        (DVec3::Z * 0.5, 0.5, 0.6, [0.9, 0.1, 0.4]),
        (DVec3::Z * -0.5, 0.5, 0.8, [0.2, 0.7, 0.3]),
    ];
    write(&folder.join("two.glb"), false, &two);
    let pixel = middle("two.glb --background 0.1,0.2,0.3");
    let behind = [0.1, 0.2, 0.3].map(srgb_from_linear);
    for c in 0..3 {
        let code = 0.6 * two[0].3[c] + 0.4 * (0.8 * two[1].3[c] + 0.2 * behind[c]);
        near(pixel[c], linear_from_srgb(code), 2e-3);
    }
    // An opaque grey is the same in both spaces.
    let grey = |c: f32| [(DVec3::ZERO, 0.5, 1.0, [c; 3])];
    write(&folder.join("grey.glb"), false, &grey(0.5));
    write(&folder.join("light-grey.glb"), true, &grey(0.5));
    near(srgb_from_linear(middle("grey.glb")[0]), 0.5, 1e-4);
    near(middle("light-grey.glb")[0], 0.5, 1e-4);
}

#[test]
fn what_lies_among_splats_makes_light_blend() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let white = [(DVec3::ZERO, 0.5, 0.5, [1.0; 3])];
    write(&folder.join("codes.glb"), false, &white);
    write(&folder.join("light.glb"), true, &white);
    let mesh = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nf 1 2 3 4\n";
    std::fs::write(folder.join("wall.obj"), mesh).unwrap();
    let blend = |line: &str| {
        let said = done(
            folder,
            &format!("render {line} {FRONT} --stats s.json --out p.png"),
        );
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("s.json")).unwrap()).unwrap();
        let is_said = said.contains("--blend encoded");
        (stats["blend"].as_str().unwrap().to_owned(), is_said)
    };
    assert_eq!(blend("codes.glb"), ("encoded".into(), false));
    assert_eq!(blend("light.glb"), ("linear".into(), false));
    assert_eq!(blend("codes.glb light.glb"), ("linear".into(), true));
    assert_eq!(blend("codes.glb wall.obj"), ("linear".into(), true));
    assert_eq!(blend("wall.obj"), ("linear".into(), false));
    assert_eq!(blend("codes.glb --show choice"), ("linear".into(), false));
    assert_eq!(
        blend("codes.glb wall.obj --blend linear"),
        ("linear".into(), false)
    );
    // A wall of light .25 behind half-opaque white: their codes are mixed.
    assert_eq!(
        blend("codes.glb wall.obj --blend encoded"),
        ("encoded".into(), false)
    );
    let pixel = |line: &str| picture(folder, &format!("{line} {FRONT} --unlit")).pixel(32, 32);
    let wall = pixel("wall.obj")[0];
    let mixed = pixel("codes.glb wall.obj --blend encoded")[0];
    near(
        srgb_from_linear(mixed),
        0.5 + 0.5 * srgb_from_linear(wall),
        2e-3,
    );
    let output = run(
        folder,
        &["render", "wall.obj", "--blend", "encoded", "--out", "p.png"],
    );
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        message.contains("--blend") && message.contains("leave it out"),
        "{message}"
    );
}

#[cfg(feature = "gpu")]
#[test]
fn both_back_ends_blend_alike() {
    if crate::common::gpu::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let splats: Vec<_> = (0..300)
        .map(|i| {
            let at = |step: f64| (step * f64::from(i)).fract() - 0.5;
            let place = DVec3::new(at(0.754_878), at(0.569_840), at(0.618_034));
            let colour = [at(0.3), at(0.7), at(0.9)].map(|c| c as f32 + 0.5);
            (place, 0.06, 0.1 + 0.2 * (i % 5) as f32, colour)
        })
        .collect();
    write(&folder.join("codes.glb"), false, &splats);
    write(&folder.join("light.glb"), true, &splats);
    write(&folder.join("codes.ply"), false, &splats);
    // Opacities at the floor reach no pixel but their centre's.
    let mut at_floor = splats.clone();
    at_floor.iter_mut().for_each(|splat| splat.2 = 1.0 / 255.0);
    write(&folder.join("floor.splat"), false, &at_floor);
    for scene in [
        "codes.glb",
        "codes.ply",
        "codes.ply --splat-rule mip",
        "floor.splat",
    ] {
        let apart = apart(folder, scene);
        // A pixel at the end of a splat may be a rounding inside it.
        let flips = apart.iter().filter(|apart| **apart > 2e-5).count();
        assert!(
            flips <= 2 && apart.iter().all(|apart| *apart <= 0.012),
            "{scene}: {flips}"
        );
    }
    let mesh = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n";
    std::fs::write(folder.join("wall.obj"), mesh).unwrap();
    for scene in [
        "codes.glb --background 0.1,0.2,0.4",
        "codes.glb --background none",
        "light.glb --blend encoded --background none",
        "codes.glb light.glb wall.obj --blend encoded --background 0.1,0.2,0.4",
    ] {
        let apart = apart(folder, &format!("{scene} --splat-rule exact"));
        assert!(apart.iter().all(|apart| *apart <= 2e-5), "{scene}");
    }
}

/// Returns the difference of each pixel between the two back ends.
#[cfg(feature = "gpu")]
fn apart(folder: &Path, scene: &str) -> Vec<f32> {
    let [a, b] = ["gpu", "cpu"].map(|backend| {
        let line = format!(
            "render {scene} --eye 1,1,3 --target 0,0,0 --up 0,1,0 --size 80x60 --cutoff 7 --tolerance 1e-6 \
             --backend {backend} --out {backend}.npy"
        );
        done(folder, &line);
        read_image(&folder.join(format!("{backend}.npy"))).unwrap()
    });
    let greatest = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..4).fold(0.0_f32, |most, c| most.max((a[c] - b[c]).abs()))
    };
    a.pixels.iter().zip(&b.pixels).map(greatest).collect()
}

/// The rule of a file decides what is left out and how opaque a splat is at most; `--splat-rule` chooses another.
#[test]
fn splats_are_drawn_by_the_rule_of_their_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let opaque = [(DVec3::ZERO, 0.1, 1.0, [1.0; 3])];
    write(&folder.join("a.glb"), false, &opaque);
    write(&folder.join("a.ply"), false, &opaque);
    write(
        &folder.join("faint.ply"),
        false,
        &[(DVec3::ZERO, 0.5, 0.0039, [1.0; 3])],
    );
    let drawn = |line: &str| {
        let image = picture(
            folder,
            &format!("{line} {FRONT} --background none --tolerance 1e-5"),
        );
        let alphas: Vec<f32> = image.pixels.iter().map(|p| p[3]).collect();
        let seen = alphas.iter().copied().filter(|alpha| *alpha > 0.0);
        let least = seen.fold(f32::INFINITY, f32::min);
        (alphas.into_iter().fold(0.0, f32::max), least)
    };
    // A file rounds opacities and scales.
    let same = |a: (f32, f32), b: (f32, f32)| {
        near(a.0, b.0, 1e-6);
        near(a.1, b.1, 1e-6);
    };
    let (most, least) = drawn("a.ply");
    assert!(
        most == 0.99 && (1.0 / 255.0..0.006).contains(&least),
        "{most} {least}"
    );
    same(drawn("a.glb --splat-rule inria"), (most, least));
    let (most, least) = drawn("a.glb");
    let edge = (-4.5_f32).exp();
    assert!(
        most > 0.999 && least >= edge && least < 1.5 * edge,
        "{most} {least}"
    );
    same(drawn("a.ply --splat-rule khr"), (most, least));
    let (most, least) = drawn("a.ply --splat-rule exact");
    assert!(most > 0.999 && least < 1e-4, "{most} {least}");
    assert!(drawn("a.ply --splat-rule mip").0 <= 0.99);
    assert_eq!(drawn("faint.ply").0, 0.0);
    assert!(drawn("faint.ply --splat-rule exact").0 > 0.0038);
    std::fs::write(
        folder.join("wall.obj"),
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n",
    )
    .unwrap();
    for line in [
        "render wall.obj --splat-rule mip --out p.png",
        "convert a.ply --splat-rule mip --out a.spz",
    ] {
        let output = run(folder, &line.split_whitespace().collect::<Vec<_>>());
        let message = text(&output.stderr);
        assert!(
            !output.status.success() && message.contains("--splat-rule"),
            "{message}"
        );
    }
    // A prepared scene keeps the rule.
    done(folder, "convert a.glb --splat-rule inria --out a.arrow");
    same(drawn("a.arrow"), drawn("a.ply"));
}

/// A wide red splat straight ahead, at z = 3, and a blue one aside, at z = 2.9 but farther from the eye: by depth blue
/// hides red, by distance red hides blue. Both back ends sort alike.
#[test]
fn splats_are_sorted_by_depth_or_distance() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let two = [
        (DVec3::new(0.0, 0.0, 3.0), 1.0, 1.0, [1.0, 0.0, 0.0]),
        (DVec3::new(1.5, 0.0, 2.9), 1.0, 1.0, [0.0, 0.0, 1.0]),
    ];
    write(&folder.join("two.ply"), false, &two);
    let view = "--eye 0,0,0 --target 0,0,1 --up 0,-1,0 --fov 90 --size 64x64 --background 0,0,0";
    let pixel = |more: &str, backend: &str| {
        done(
            folder,
            &format!("render two.ply {view} --keep-axes {more} --backend {backend} --out p.npy"),
        );
        // Between the two, where each has an opacity of some .75.
        let image = read_image(&folder.join("p.npy")).unwrap();
        let places = [40, 23].map(|x| image.pixel(x, 32));
        places[usize::from(places[1][2] > places[0][2])]
    };
    for backend in ["cpu", "gpu"] {
        let [red, _, blue, _] = pixel("", backend);
        assert!(blue > red, "{backend}: {red} {blue}");
        assert_eq!(pixel("--order depth", backend), pixel("", backend));
        let [red, _, blue, _] = pixel("--order distance", backend);
        assert!(red > blue, "{backend}: {red} {blue}");
    }
    let line = format!("render two.ply {view} --order depth --composite slabs --out p.npy");
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(!output.status.success());
    assert!(text(&output.stderr).contains("order of kernels"));
}

fn ball(count: u32) -> Vec<(DVec3, f32, f32, [f32; 3])> {
    let at = |i: u32, step: f64| (step * f64::from(i)).fract() - 0.5;
    let place = |i: u32| DVec3::new(at(i, 0.754_878), at(i, 0.569_840), at(i, 0.618_034));
    let splat = |i: u32| (place(i), 0.03, 0.8, [0.9, 0.6, 0.3]);
    (0..count).map(splat).collect()
}

#[test]
fn stray_splats_do_not_make_the_others_small() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let draw = |name: &str, splats: &[(DVec3, f32, f32, [f32; 3])], options: &str| {
        write(&folder.join(name), false, splats);
        let said = done(
            folder,
            &format!(
                "render {name} --size 64x64 --background none --backend cpu --out p.npy {options}"
            ),
        );
        (read_image(&folder.join("p.npy")).unwrap(), said)
    };
    let covered = |image: &Image| image.pixels.iter().filter(|p| p[3] > 0.1).count();
    for count in [300, 3000] {
        let alone = ball(count);
        let mut with = alone.clone();
        with.push((DVec3::new(1e6, 2.0, -3.0), 0.03, 0.8, [1.0; 3]));
        let (clean, said) = draw("clean.ply", &alone, "");
        assert!(!said.contains("--fit all"), "{said}");
        let (robust, said) = draw("with.ply", &with, "");
        assert!(said.contains("--fit all"), "{said}");
        // A stray splat changes the blocks, to whose boxes the camera is fitted.
        let (a, b) = (covered(&clean) as f64, covered(&robust) as f64);
        assert!((a / b - 1.0).abs() < 0.05, "{a} {b}");
        let (all, said) = draw("with.ply", &with, "--fit all");
        assert!(!said.contains("--fit all") && covered(&all) < covered(&clean) / 100);
    }
    // If there are few splats, all are shown, however far apart. So is a group of one in fifty.
    let far = [0.0, 10.0, 500.0].map(|x| (DVec3::X * x, 20.0, 0.9, [1.0; 3]));
    let (few, said) = draw("few.ply", &far, "--elevation 0");
    assert!(!said.contains("--fit all"), "{said}");
    let columns = (0..64).filter(|x| (0..64).any(|y| few.pixel(*x, y)[3] > 0.1));
    assert!(columns.clone().max().unwrap() - columns.min().unwrap() > 40);
    let mut two = ball(1000);
    two.extend(
        ball(20)
            .into_iter()
            .map(|s| (s.0 + DVec3::X * 9.0, s.1, s.2, s.3)),
    );
    let (_, said) = draw("two.ply", &two, "");
    assert!(!said.contains("--fit all"), "{said}");
}

fn converted(folder: &Path, line: &str) -> serde_json::Value {
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Splats that look alike are merged to a number, or as many as a stated error allows.
#[test]
fn splats_are_merged_to_fewer() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A sheet of two colours, one splat that nobody sees.
    let mut splats: Vec<_> = (0..400)
        .map(|i| {
            let [x, y] = [i % 20, i / 20].map(|k| 0.1 * f64::from(k));
            let colour = if x < 1.0 {
                [0.9, 0.2, 0.1]
            } else {
                [0.1, 0.3, 0.9]
            };
            (DVec3::new(x, y, 0.0), 0.08, 0.7, colour)
        })
        .collect();
    splats.push((DVec3::new(1.0, 1.0, 0.5), 0.1, 0.003, [1.0; 3]));
    write(&folder.join("all.ply"), false, &splats);
    let said = converted(folder, "convert all.ply --count 60 --out few.ply --json");
    assert_eq!(said["splats"], 60);
    assert_eq!(said["fewer"]["given"], 401);
    assert!(said["fewer"]["psnr"].as_f64().unwrap() > 25.0, "{said}");
    let summary = done(folder, "convert all.ply --count 60 --out few.ply");
    assert!(!summary.contains("error"), "{summary}");
    // The faint splat is dropped first, unless it is to be kept.
    let said = converted(folder, "convert all.ply --count 401 --out same.ply --json");
    assert_eq!(said["splats"], 400);
    let said = converted(
        folder,
        "convert all.ply --count 401 --keep-all --out same.ply --json",
    );
    assert_eq!(said["splats"], 401);
    // Looser errors leave fewer splats, and both are kept.
    let left = [0.02, 0.1].map(|error| {
        let said = converted(
            folder,
            &format!("convert all.ply --error {error} --out e.spz --json"),
        );
        assert!(said["fewer"]["p999"].as_f64().unwrap() <= error, "{said}");
        said["splats"].as_u64().unwrap()
    });
    assert!(left[1] < left[0] && left[1] < 300, "{left:?}");
    std::fs::write(
        folder.join("wall.obj"),
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n",
    )
    .unwrap();
    // A mesh has the fewest surfels that are as near to the mesh itself as is asked for.
    let all = converted(folder, "convert wall.obj --spacing 0.02 --out a.ply --json");
    let of_mesh = |error: f64| {
        let line = format!("convert wall.obj --spacing 0.02 --error {error} --out a.ply --json");
        let said = converted(folder, &line);
        let [of_all, left] = ["given", "splats"].map(|key| said["fewer"]["mesh"][key].as_f64());
        (said, of_all.unwrap(), left.unwrap())
    };
    let (few, of_all, left) = of_mesh(0.4);
    assert!(of_all < left && left <= 0.4, "{few}");
    assert_eq!(few["fewer"]["given"], all["splats"]);
    assert!(few["splats"].as_u64() < all["splats"].as_u64(), "{few}");
    let (same, again, left) = of_mesh(0.01);
    assert_eq!((again, left), (of_all, of_all));
    assert_eq!(same["splats"], all["splats"]);
    let notes = same["notes"].to_string();
    assert!(notes.contains("farther from the mesh"), "{notes}");
    // Splats of particles merge, too.
    let table: String = (0..64)
        .map(|i| format!("{},{},{},0.4,{i}\n", i % 4, i / 4 % 4, i / 16))
        .collect();
    std::fs::write(folder.join("p.csv"), format!("x,y,z,radius,value\n{table}")).unwrap();
    let few = converted(folder, "convert p.csv --count 20 --out a.ply --json");
    assert_eq!(few["splats"], 20);
    for (line, option) in [
        ("convert wall.obj all.ply --count 50 --out a.ply", "--count"),
        ("convert all.ply --keep-all --out a.ply", "--keep-all"),
        (
            "convert wall.obj --count 50 --keep-all --out a.ply",
            "--keep-all",
        ),
        (
            "convert wall.obj --error 0.5 --keep-all --out a.ply",
            "--keep-all",
        ),
        ("convert all.ply --error 0.1 --out a.arrow", "--error"),
    ] {
        let output = run(folder, &line.split_whitespace().collect::<Vec<_>>());
        let message = text(&output.stderr);
        assert!(
            !output.status.success() && message.contains(option),
            "{line}: {message}"
        );
    }
}

/// A ninth of a real scene's splats.
#[test]
fn a_real_scene_keeps_its_look_with_a_ninth_of_its_splats() {
    let Some(path) = crate::common::real_data("splats/fruit_drops_minimal.ply") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let line = format!(
        "convert {} --count 500 --out few.ply --json",
        path.display()
    );
    let said = converted(folder.path(), &line);
    assert_eq!(said["splats"], 500);
    let (psnr, flip) = (
        said["fewer"]["psnr"].as_f64(),
        said["fewer"]["flip"].as_f64(),
    );
    println!("{psnr:?} {flip:?}");
    assert!(psnr.unwrap() > 36.0 && flip.unwrap() < 0.03, "{said}");
}

/// Writes a ball of radius 1 with smooth normals, by longitude and latitude.
fn write_ball(path: &Path) {
    let (columns, rows) = (48, 24);
    let mut mesh = String::new();
    for row in 0..=rows {
        for column in 0..columns {
            let azimuth = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let (height, radius) =
                (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
            let (x, y, z) = (height * azimuth.cos(), radius, height * azimuth.sin());
            mesh += &format!("v {x} {y} {z}\nvn {x} {y} {z}\n");
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let at = |row: u32, column: u32| 1 + row * columns + column % columns;
            let corners = [
                at(row, column),
                at(row, column + 1),
                at(row + 1, column + 1),
                at(row + 1, column),
            ];
            let [a, b, c, d] = corners;
            mesh += &format!("f {a}//{a} {b}//{b} {c}//{c} {d}//{d}\n");
        }
    }
    std::fs::write(path, mesh).unwrap();
}

/// Splats with baked light look like the lit mesh, from any side.
#[test]
fn light_is_baked_into_the_colours_of_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_ball(&folder.join("ball.obj"));
    for (light, most) in [("--lit", 0.06), ("--light 1,2,1", 0.06)] {
        let line = format!("convert ball.obj --count 4000 {light} --out b.ply --json");
        let said = converted(folder, &line);
        assert_eq!(said["degree"], 2);
        for azimuth in [20, 110, 260] {
            let (sin, cos) = f64::from(azimuth).to_radians().sin_cos();
            let (x, z) = (4.0 * cos, 4.0 * sin);
            // y is up in the mesh, and down in the splats.
            let [up, down] = [1.0, -1.0].map(|sign| {
                format!(
                    "--eye {},{sign},{z} --target 0,0,0 --up 0,{sign},0 --fov 40",
                    sign * x
                )
            });
            let view = "--size 64x64 --background none";
            let lit = format!("ball.obj {light} {up}");
            let [mesh, splats] = [lit, format!("b.ply {down}")].map(|input| {
                done(folder, &format!("render {input} {view} --out p.npy"));
                read_image(&folder.join("p.npy")).unwrap()
            });
            let (mut squares, mut count) = (0.0, 0);
            for (a, b) in mesh.pixels.iter().zip(&splats.pixels) {
                if a[3] > 0.999 && b[3] > 0.95 {
                    let code = |p: &[f32; 4]| srgb_from_linear((p[0] / p[3]).min(1.0));
                    squares += (code(a) - code(b)).powi(2);
                    count += 1;
                }
            }
            assert!(count > 500, "{count}");
            let rms = (squares / count as f32).sqrt();
            println!("{light} {azimuth}: {rms} of {count}");
            assert!(rms < most, "{light} {azimuth}: {rms}");
        }
    }
    write(&folder.join("all.ply"), false, &ball(50));
    for line in [
        "convert all.ply --lit --out a.ply",
        "convert ball.obj --light 1,0,0 --out a.arrow",
    ] {
        let output = run(folder, &line.split_whitespace().collect::<Vec<_>>());
        let message = text(&output.stderr);
        assert!(
            !output.status.success() && message.contains("--li"),
            "{line}: {message}"
        );
    }
}
