//! Tests splats of radiance fields: the space of blending, and fitted cameras.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::Image;
use ewa_splat::image::{linear_from_srgb, srgb_from_linear};
use ewa_splat::io::{SplatCloud, SplatFileOptions, read_image, write_splats};
use glam::DVec3;

use crate::commands::{run, text};
use crate::common::scene::difference;

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
    let mesh = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n";
    std::fs::write(folder.join("wall.obj"), mesh).unwrap();
    for scene in [
        "codes.glb --background 0.1,0.2,0.4",
        "codes.glb --background none",
        "light.glb --blend encoded --background none",
        "codes.glb light.glb wall.obj --blend encoded --background 0.1,0.2,0.4",
    ] {
        let of = |backend: &str| {
            let line = format!(
                "render {scene} --eye 1,1,3 --target 0,0,0 --up 0,1,0 --size 80x60 --cutoff 7 --tolerance 1e-6 \
                 --backend {backend} --out {backend}.npy"
            );
            done(folder, &line);
            read_image(&folder.join(format!("{backend}.npy"))).unwrap()
        };
        let apart = difference(&of("gpu"), &of("cpu"));
        assert!(apart <= 2e-5, "{scene}: {apart}");
    }
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
