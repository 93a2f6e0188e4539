//! Tests each format: what a file keeps, and what it refuses.

use super::{
    FORMATS, Folder, cloud_of, norm, of_form, picture, rms, seen, some_cloud, unit, variance,
};
use crate::common::scene::difference;
use ewa_splat::io::{
    FLAT_SHARE, OpenOptions, PlyForm, SplatCloud, SplatFileOptions, WrittenSplats, open,
    write_splats,
};
use ewa_splat::sample::sound_splats;
use ewa_splat::scene::SplatRule;
use ewa_splat::view::Camera;
use glam::DVec3;

/// Returns the order of `b`'s splats in `a`, by nearest positions.
fn order(a: &SplatCloud, b: &SplatCloud) -> Vec<usize> {
    let nearest = |p: &DVec3| {
        let distance = |i: &usize| a.positions[*i].distance_squared(*p);
        (0..a.positions.len())
            .min_by(|i, j| distance(i).total_cmp(&distance(j)))
            .unwrap()
    };
    let order: Vec<usize> = b.positions.iter().map(nearest).collect();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..a.positions.len()).collect::<Vec<_>>());
    order
}

/// Largest errors of a format's numbers.
#[derive(Debug, Clone, Copy)]
struct Quantum {
    position: f64,
    /// Error of the logarithm.
    scale: f64,
    /// Error of a component of the unit quaternion.
    rotation: f64,
    opacity: f64,
    constant: f64,
    harmonic: f64,
}

/// Returns half a step of each format, and some f32 roundings.
fn quantum(extension: &str, written: &WrittenSplats) -> Quantum {
    let exact = Quantum {
        position: 0.0,
        scale: 0.0,
        rotation: 2e-7,
        opacity: 0.0,
        constant: 0.0,
        harmonic: 0.0,
    };
    match extension {
        // Logarithm and logit are computed in f64, rounded, and inverted in f32.
        "ply" | "csv" => Quantum {
            scale: 1e-6,
            opacity: 5e-7,
            ..exact
        },
        // Bytes: components in steps of 1/128, codes in steps of 1/255.
        "splat" => Quantum {
            rotation: 0.5 / 128.0 * 2.0,
            opacity: 0.5 / 255.0 + 1e-7,
            constant: 0.5 / 255.0 / 0.282 + 1e-6,
            harmonic: f64::INFINITY,
            ..exact
        },
        // The same codes; floats are kept.
        "ksplat" => Quantum {
            opacity: 0.5 / 255.0 + 1e-7,
            constant: 0.5 / 255.0 / 0.282 + 1e-6,
            ..exact
        },
        // Steps are 1/16 in the logarithm and 1/(511 sqrt 2) in a component. If three components
        // are off by half a step each, the fourth, which is the largest and at least 1/2, is off by
        // up to three halves.
        "spz" => Quantum {
            position: 0.5 * written.position_quantum * 1.0001,
            scale: 0.5 / 16.0 + 1e-5,
            rotation: 1.5 / (511.0 * std::f64::consts::SQRT_2),
            opacity: 0.5 / 255.0 + 1e-7,
            constant: 0.5 / 255.0 / 0.15 + 1e-6,
            harmonic: 0.5 / 128.0 + 1e-6,
        },
        _ => exact,
    }
}

/// Asserts that `after` is `before` within a format's quanta.
fn assert_kept(before: &SplatCloud, after: &SplatCloud, q: &Quantum, what: &str) {
    let near = |a: f64, b: f64, most: f64, name: &str| {
        assert!((a - b).abs() <= most, "{what}, {name}: {a} and {b}");
    };
    let (from, to) = (before.harmonics_stride(), after.harmonics_stride());
    for (j, i) in order(before, after).into_iter().enumerate() {
        let apart = (before.positions[i] - after.positions[j]).abs();
        near(apart.max_element(), 0.0, q.position, "position");
        for k in 0..3 {
            let [a, b] = [before.scales[i][k], after.scales[j][k]].map(f64::from);
            near(a.ln(), b.ln(), q.scale, "scale");
        }
        let (a, b) = (unit(before.rotations[i]), unit(after.rotations[j]));
        let b = if a.dot(b) < 0.0 { -b } else { b };
        for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
            near(a, b, q.rotation, "rotation");
        }
        let [a, b] = [before.opacities[i], after.opacities[j]].map(f64::from);
        near(a, b, q.opacity, "opacity");
        let (a, b) = (&before.harmonics[i * from..], &after.harmonics[j * to..]);
        for k in 0..from.min(to) {
            let most = if k < 3 { q.constant } else { q.harmonic };
            near(f64::from(a[k]), f64::from(b[k]), most, "harmonic");
        }
    }
}

#[test]
fn every_format_keeps_what_it_says() {
    let folder = Folder::new();
    for degree in 0..=3 {
        for rule in [SplatRule::Inria, SplatRule::Mip] {
            let is_anti_aliased = rule.is_anti_aliased();
            let cloud = SplatCloud {
                rule,
                ..some_cloud(60, degree, 7 + u64::from(degree))
            };
            for extension in FORMATS {
                let written = folder.write(extension, &cloud);
                let after = cloud_of(folder.read(&format!("a.{extension}")));
                let quantum = quantum(extension, &written);
                assert_kept(&cloud, &after, &quantum, extension);
                let (keeps_degree, keeps_mark) = match extension {
                    "splat" => (degree == 0, false),
                    "ksplat" => (degree < 3, false),
                    "glb" | "gltf" | "usda" | "usdc" | "usdz" | "csv" => (true, false),
                    _ => (true, true),
                };
                assert_eq!(
                    after.harmonics_degree == degree,
                    keeps_degree,
                    "{extension}"
                );
                let expected = match extension {
                    "glb" | "gltf" => SplatRule::Khr,
                    _ if is_anti_aliased && keeps_mark => SplatRule::Mip,
                    _ => SplatRule::Inria,
                };
                assert_eq!(after.rule, expected, "{extension}");
                let lost = usize::from(!keeps_degree) + usize::from(is_anti_aliased && !keeps_mark);
                assert_eq!(written.notes.len(), lost, "{:?}", written.notes);
                // Writing a second time loses nothing more.
                let twice = folder.again(extension, &after);
                let more = Quantum {
                    position: 0.0,
                    // The exponential, the logarithm and the division by 16 or 255 round.
                    scale: 2e-6,
                    rotation: if extension == "splat" { 0.008 } else { 2e-3 },
                    opacity: 5e-7,
                    constant: 1e-6,
                    harmonic: 1e-6,
                };
                assert_kept(&after, &twice, &more, extension);
            }
        }
    }
}

/// Positions have 24 bits, as many of them fractional as fit.
#[test]
fn spz_positions_are_as_fine_as_their_reach_allows() {
    let folder = Folder::new();
    for (reach, quantum) in [
        (0.4, 2.0_f64.powi(-24)),
        (0.9, 2.0_f64.powi(-23)),
        (100.0, 2.0_f64.powi(-16)),
        (8_388_600.0, 1.0),
    ] {
        let mut cloud = some_cloud(9, 0, 3);
        for p in &mut cloud.positions {
            *p *= reach / 2.0;
        }
        cloud.positions[0] = DVec3::new(reach, -reach, 0.0);
        let written = folder.write("spz", &cloud);
        assert_eq!(written.position_quantum, quantum, "{reach}");
        let after = cloud_of(folder.read("a.spz"));
        for (a, b) in cloud.positions.iter().zip(&after.positions) {
            assert!((*a - *b).abs().max_element() <= 0.5 * quantum, "{a} {b}");
        }
        // Steps that are visible beside splats of .03 to .3 are reported.
        assert_eq!(
            written.notes.len(),
            usize::from(quantum > 0.1),
            "{:?}",
            written.notes
        );
    }
    let mut cloud = some_cloud(2, 0, 3);
    cloud.positions[1].z = -8_388_700.0;
    let error = folder.refuse("spz", &cloud, PlyForm::Volumetric);
    assert!(
        error.contains("8388607") && error.contains("move the scene"),
        "{error}"
    );
}

/// Extreme numbers: files hold finite ones, and the numbers read are near the originals.
#[test]
fn extremes_are_written_finite() {
    let folder = Folder::new();
    let mut cloud = some_cloud(8, 1, 5);
    cloud.opacities[0] = 0.0;
    cloud.opacities[1] = 1.0;
    cloud.scales[2] = [1e30, 1e-30, 1.0];
    cloud.scales[3] = [0.5, 0.25, 0.0];
    cloud.scales[4] = [0.0, 0.5, 0.0];
    cloud.scales[5] = [f32::MIN_POSITIVE, 0.0, 0.0];
    cloud.rotations[6] = [1e-30, 0.0, 0.0, -1e-30];
    cloud.harmonics[7 * 12] = 1e9;
    for extension in FORMATS {
        let written = folder.write(extension, &cloud);
        let after = cloud_of(folder.read(&format!("a.{extension}")));
        let at = |p: usize| order(&cloud, &after).iter().position(|&i| i == p).unwrap();
        for i in 0..8 {
            let numbers = after.scales[i].iter().chain(&after.rotations[i]);
            assert!(numbers.chain(&after.harmonics).all(|x| x.is_finite()));
            assert!((0.0..=1.0).contains(&after.opacities[i]), "{extension}");
            assert!(after.scales[i].iter().all(|s| *s >= 0.0));
        }
        // A logit of 15, inverted in f32, or nothing at all.
        let [none, all] = [after.opacities[at(0)], after.opacities[at(1)]];
        assert!(
            none <= 3.1e-7 && all >= 1.0 - 4e-7,
            "{extension}: {none}, {all}"
        );
        // SPZ's logarithms range from -10 to 5.9375, in steps of 1/16.
        let near = |a: f32, b: f32| (f64::from(a) / f64::from(b)).ln().abs() < 0.04;
        let flat = after.scales[at(3)];
        assert!(near(flat[2], FLAT_SHARE * 0.25), "{extension}: {flat:?}");
        let needle = after.scales[at(4)];
        let thin = FLAT_SHARE * 0.5;
        assert!(near(needle[0].max(needle[2]), thin), "{needle:?}");
        if extension == "spz" {
            assert!(near(after.scales[at(2)][0], 5.9375_f32.exp()));
        } else {
            assert!(near(after.scales[at(2)][0], 1e30) && near(after.scales[at(2)][1], 1e-30));
        }
        let turned = unit(after.rotations[at(6)]);
        let expected = unit([1.0, 0.0, 0.0, -1.0]);
        assert!(turned.dot(expected).abs() > 0.999, "{turned}");
        let is_cut = written.notes.iter().any(|n| n.contains("cut"));
        assert_eq!(
            is_cut,
            matches!(extension, "splat" | "ksplat" | "spz"),
            "{:?}",
            written.notes
        );
    }
}

#[test]
fn what_no_file_should_hold_is_refused() {
    let folder = Folder::new();
    let sound = some_cloud(3, 1, 2);
    let with = |change: &dyn Fn(&mut SplatCloud)| {
        let mut cloud = sound.clone();
        change(&mut cloud);
        cloud
    };
    let cases = [
        (SplatCloud::default(), "at least one"),
        (with(&|c| c.positions[1].y = f64::NAN), "splat 1"),
        (with(&|c| c.positions[1].y = 1e39), "splat 1"),
        (with(&|c| c.scales[2][0] = f32::INFINITY), "splat 2"),
        (with(&|c| c.scales[2][0] = -1.0), "splat 2"),
        (with(&|c| c.scales[2] = [0.0; 3]), "splat 2"),
        (with(&|c| c.rotations[0] = [0.0; 4]), "quaternion"),
        (with(&|c| c.rotations[0][3] = f32::NAN), "quaternion"),
        (with(&|c| c.opacities[0] = 1.5), "opacity"),
        (with(&|c| c.opacities[0] = f32::NAN), "opacity"),
        (with(&|c| c.harmonics[20] = f32::NAN), "splat 1"),
        (with(&|c| c.opacities.truncate(2)), "for each of 3"),
        (with(&|c| c.harmonics.truncate(35)), "for each of 3"),
    ];
    for extension in FORMATS.into_iter().chain(["sog"]) {
        for (cloud, words) in &cases {
            let error = folder.refuse(extension, cloud, PlyForm::Volumetric);
            assert!(error.contains(words), "{words}: {error}");
        }
    }
    for name in ["a.obj", "a", "none/a.ply"] {
        let path = folder.path(name);
        let error = write_splats(&path, &sound, &SplatFileOptions::default()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(".glb") || error.contains("folder"),
            "{error}"
        );
    }
    // Splats that cannot be drawn are left out before writing, and counted.
    let mut poisoned = sound.clone();
    poisoned.positions[0].x = f64::INFINITY;
    poisoned.opacities[1] = 7.0;
    let (kept, report) = sound_splats(poisoned).unwrap();
    assert_eq!((report.particle_count, report.splat_count), (3, 2));
    assert_eq!((report.findings.len(), report.findings[0].count), (1, 1));
    assert_eq!(kept.opacities, [1.0, sound.opacities[2]]);
    assert_eq!(kept.harmonics, sound.harmonics[12..]);
    for extension in FORMATS.into_iter().chain(["sog"]) {
        folder.write(extension, &kept);
    }
    let (all, report) = sound_splats(sound.clone()).unwrap();
    assert_eq!((all, report.findings.len()), (sound, 0));
}

#[test]
fn the_flat_form_of_ply_has_two_scales() {
    let folder = Folder::new();
    let mut cloud = some_cloud(5, 1, 8);
    let words = folder.refuse("ply", &cloud, PlyForm::Surfels);
    assert!(
        words.contains("splat 0") && words.contains("three scales"),
        "{words}"
    );
    for scales in &mut cloud.scales {
        scales[2] = 0.0;
    }
    for rule in [SplatRule::Inria, SplatRule::Mip] {
        cloud.rule = rule;
        let path = folder.path("flat.ply");
        write_splats(&path, &cloud, &of_form(PlyForm::Surfels)).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("SplatRenderMode: 2dgs") && !text.contains("scale_2"));
        let after = cloud_of(folder.read("flat.ply"));
        assert_eq!(after.rule, rule);
        for i in 0..5 {
            assert_eq!(after.scales[i][2], 0.0);
            let apart = norm(variance(&cloud, i) - variance(&after, i));
            assert!(apart < 3e-6 * norm(variance(&cloud, i)));
        }
    }
    for extension in ["splat", "spz", "glb", "gltf", "csv"] {
        let words = folder.refuse(extension, &cloud, PlyForm::Surfels);
        assert!(words.contains("a .ply file"), "{words}");
    }
}

/// Readers that use the layout's offsets instead of its names find the numbers, too.
#[test]
fn ply_has_inrias_properties_in_their_order() {
    let folder = Folder::new();
    let cloud = some_cloud(2, 3, 1);
    folder.write("ply", &cloud);
    let bytes = std::fs::read(folder.path("a.ply")).unwrap();
    let end = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let names: Vec<&str> = header
        .lines()
        .filter_map(|l| l.strip_prefix("property float "))
        .collect();
    assert_eq!(names.len(), 62);
    assert_eq!(
        names[..9],
        [
            "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"
        ]
    );
    assert_eq!((names[9], names[53]), ("f_rest_0", "f_rest_44"));
    let rest = [
        "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ];
    assert_eq!(names[54..], rest);
    assert_eq!(bytes.len() - end, 2 * 62 * 4);
    let number = |i: usize| f32::from_le_bytes(bytes[end + 4 * i..][..4].try_into().unwrap());
    // All of red precedes green: coefficient 1 of red, then that of green fifteen later.
    assert_eq!(
        [number(9), number(9 + 15)],
        [cloud.harmonics[3], cloud.harmonics[4]]
    );
    let length: f32 = (58..62).map(|i| number(i).powi(2)).sum();
    assert!((length - 1.0).abs() < 1e-6);
}

#[test]
fn records_come_by_size_times_opacity() {
    let folder = Folder::new();
    let after = folder.again("splat", &some_cloud(40, 0, 4));
    let weight = |i: usize| after.scales[i].iter().product::<f32>() * after.opacities[i];
    // Opacities are rounded to 1/255 of at least .02: a tenth.
    assert!((1..40).all(|i| weight(i) < 1.11 * weight(i - 1)));
    assert!(weight(0) > 10.0 * weight(39));
}

// Pictures.

fn looks() -> [Camera; 2] {
    let eye = DVec3::new(1.0, -6.0, 2.0);
    [
        Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 45.0, [96, 80]),
        Camera::perspective(-eye, DVec3::ZERO, DVec3::Z, 45.0, [96, 80]),
    ]
}

#[test]
fn pictures_stay_within_the_formats_quanta() {
    let folder = Folder::new();
    for (degree, seed) in [(0, 21), (3, 22)] {
        let mut cloud = some_cloud(300, degree, seed);
        // Colours stay within 0 to 1 from all directions, because clamping would be visible.
        for (k, c) in cloud.harmonics.iter_mut().enumerate() {
            *c *= if k % (3 * 16) < 3 || degree == 0 {
                0.6
            } else {
                0.1
            };
        }
        for extension in FORMATS {
            let after = folder.again(extension, &cloud);
            for camera in looks() {
                let (a, b) = (picture(&cloud, &camera), picture(&after, &camera));
                let (most, mean) = (f64::from(difference(&a, &b)), rms(&a, &b));
                println!("{extension}, degree {degree}: at most {most:.1e}, rms {mean:.1e}");
                // Floats: roundings of a 40-fold overlap. SPZ: sizes are off by 3 %, opacities and
                // colours by 1/510, averaged over a dozen visible layers. Records: the same with
                // exact sizes, quaternions off by 1/256; without harmonics of up to .03.
                let (greatest, root) = match (extension, degree) {
                    ("ply" | "glb" | "gltf" | "csv", _) => (2e-6, 2e-7),
                    ("splat" | "ksplat", 0) => (0.02, 2e-3),
                    ("splat" | "ksplat", _) => (0.1, 0.01),
                    _ => (0.05, 5e-3),
                };
                assert!(
                    most <= greatest && mean <= root,
                    "{extension}: {most}, {mean}"
                );
            }
        }
    }
}

/// A scene's splats form one cloud of the highest degree among them.
#[test]
fn clouds_of_different_degrees_are_put_together() {
    let [flat, round] = [some_cloud(2, 0, 1), some_cloud(3, 2, 2)];
    let mut both = flat.clone();
    both.append(round.clone());
    assert_eq!((both.positions.len(), both.harmonics_degree), (5, 2));
    let d = DVec3::new(0.1, 0.7, -0.4);
    for i in 0..5 {
        let expected = if i < 2 {
            seen(&flat, i, d)
        } else {
            seen(&round, i - 2, d)
        };
        assert_eq!(seen(&both, i, d), expected);
    }
    let mut empty = SplatCloud::default();
    empty.append(round.clone());
    assert_eq!(empty, round);
}

// Real files.

#[test]
fn three_splats_of_one_scene_convert_into_each_other() {
    let folder = Folder::new();
    for from in ["ply", "splat", "spz"] {
        let name = format!("splats/test-splat.3-points-from-train.{from}");
        let Some(path) = crate::common::real_data(&name) else {
            return;
        };
        let cloud = cloud_of(open(&path, &OpenOptions::default()).unwrap());
        for to in FORMATS {
            let written = folder.write(to, &cloud);
            let after = cloud_of(folder.read(&format!("a.{to}")));
            let mut quantum = quantum(to, &written);
            if matches!(to, "splat" | "ksplat" | "spz") {
                // Colours beyond the range of bytes are clamped.
                quantum.constant = 0.9;
                quantum.harmonic = f64::INFINITY;
            }
            assert_kept(&cloud, &after, &quantum, &format!("{from} to {to}"));
        }
    }
}

#[test]
fn a_real_scene_survives_a_tour_of_the_formats() {
    let folder = Folder::new();
    let Some(path) = crate::common::real_data("splats/fruit_drops_minimal.ply") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    let cloud = cloud_of(data);
    let middle = cloud.positions.iter().sum::<DVec3>() / cloud.positions.len() as f64;
    let eye = middle + DVec3::new(0.6, -0.4, -1.6);
    let camera = Camera::perspective(eye, middle, -DVec3::Y, 45.0, [160, 120]);
    let before = picture(&cloud, &camera);
    assert!(
        before.pixels.iter().filter(|p| p[3] > 0.5).count() > 1000,
        "an empty picture"
    );
    for tour in [
        &["ply"][..],
        &["glb"],
        &["glb", "ply", "csv", "gltf"],
        &["spz"],
        &["spz", "ply", "spz", "glb"],
        &["splat"],
    ] {
        let mut after = cloud.clone();
        for to in tour {
            after = folder.again(to, &after);
        }
        let image = picture(&after, &camera);
        let (most, mean) = (f64::from(difference(&before, &image)), rms(&before, &image));
        println!("{tour:?}: at most {most:.1e}, rms {mean:.1e}");
        // Floats, SPZ's bytes, records without harmonics.
        let (greatest, root) = match tour[0] {
            "ply" | "glb" => (5e-6, 1e-7),
            "spz" => (0.04, 5e-3),
            _ => (0.2, 0.02),
        };
        assert!(most <= greatest && mean <= root, "{tour:?}: {most}, {mean}");
    }
}
