//! Tests splats of radiance fields: three formats give the same splats, and the drawing rule.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::PathBuf;

use crate::common::scene::{Particle, camera, difference, render, volume};
use crate::support::gzip;
use crate::support::splats::{
    Ply, Splat, glb, packed_ply, some_splats, splat_ply, splat_records, spz, spz_streams,
    spz_unpacked, stored,
};
use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::{
    Dataset, FieldSource, Geometry, OpenOptions, ScaleMeaning, SplatCloud, open, read,
};
use ewa_splat::reference::Integrator;
use ewa_splat::render::Advanced;
use ewa_splat::sample::{KernelOptions, SampleOptions, Sampled, volume as sample};
use ewa_splat::scene::{Colour, Particles, PointVolume, Requirements, SplatRule, Strength, Values};
use ewa_splat::stages::splat::{ANTI_ALIASED_LOW_PASS_PX2, Filter, SPLAT_LOW_PASS_PX2};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{ColumnSettings, Image, Renderer, Settings};
use glam::{DMat3, DQuat, DVec2, DVec3};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn open(&self, name: &str, bytes: &[u8]) -> Dataset {
        open(&self.file(name, bytes), &OpenOptions::default()).unwrap()
    }

    fn refuse(&self, name: &str, bytes: &[u8]) -> String {
        let path = self.file(name, bytes);
        let answer = open(&path, &OpenOptions::default());
        answer.unwrap_err().to_string()
    }
}

fn cloud(data: &Dataset) -> &SplatCloud {
    match &data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

fn values(data: &Dataset, field: &str) -> Values {
    data.scalar(field).unwrap().1
}

// Readers.

#[test]
fn ply_tables_of_every_type_and_encoding() {
    let folder = Folder::new();
    let types = [
        ("char", "int8", -5.0),
        ("uchar", "uint8", 250.0),
        ("short", "int16", -300.0),
        ("ushort", "uint16", 65_000.0),
        ("int", "int32", -70_000.0),
        ("uint", "uint32", 4_000_000_000.0),
        ("float", "float32", 0.375),
        ("double", "float64", -1.5e30),
    ];
    for encoding in Ply::ALL {
        for new_names in [false, true] {
            let columns: Vec<String> = types
                .iter()
                .map(|(old, new, _)| format!("{} {old}_", if new_names { new } else { old }))
                .collect();
            // Lists come before, between and after; positions come last, out of order, in three
            // types.
            let mut properties = vec!["list uchar int before"];
            properties.extend(columns.iter().map(String::as_str));
            properties.extend([
                "double z",
                "list ushort float between",
                "short x",
                "float y",
            ]);
            properties.push("list int double after");
            let row = |i: usize| {
                let t = i as f64;
                let mut row = vec![t, 1.0, 2.0][..=i].to_vec();
                row.extend(types.iter().map(|(_, _, v)| *v));
                row.extend([1e9 + t / 8.0, 1.0, 9.5, -t, 0.5 + t, 0.0]);
                row
            };
            let rows = [row(0), row(1), row(2)];
            let other = [vec![3.0, 1.0, 2.0, 3.0], vec![0.0]];
            let file = encoding.file(
                "comment made by hand\nobj_info none\n",
                &[
                    ("nothing", &[], &[]),
                    ("range_grid", &["list uchar int indices"], &other),
                    ("vertex", &properties, &rows),
                    ("edge", &["int a", "int b"], &[vec![1.0, 2.0]]),
                ],
            );
            for crlf in [false, true] {
                // The header's lines may end in \r\n, and so may those of a text file.
                let file = if crlf && encoding == Ply::Ascii {
                    String::from_utf8(file.clone())
                        .unwrap()
                        .replace('\n', "\r\n")
                        .into()
                } else if crlf {
                    let end = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
                    let head = String::from_utf8(file[..end].to_vec()).unwrap();
                    [head.replace('\n', "\r\n").as_bytes(), &file[end..]].concat()
                } else {
                    file.clone()
                };
                let data = folder.open("a.ply", &file);
                let Geometry::Points { positions } = &data.geometry else {
                    panic!()
                };
                for (i, p) in positions.iter().enumerate() {
                    let t = i as f64;
                    let expected = DVec3::new(-t, 0.5 + t, 1e9 + t / 8.0);
                    assert_eq!(*p, expected, "{encoding:?}, {crlf}");
                }
                assert_eq!(data.field_names().len(), types.len());
                for (old, _, expected) in types {
                    let column = values(&data, &format!("{old}_"));
                    assert_eq!(column.len(), 3);
                    assert_eq!(column.get(2), expected as f32, "{old}, {encoding:?}");
                }
                assert_eq!(values(&data, "uchar_").type_name(), "u8");
                assert_eq!(values(&data, "ushort_").type_name(), "u16");
                assert!(data.notes.is_empty(), "{:?}", data.notes);
            }
        }
    }
}

#[test]
fn ply_bodies_of_another_length_are_told() {
    let folder = Folder::new();
    let rows = [
        vec![0.0, 0.0, 0.0],
        vec![1.0, 0.0, 0.0],
        vec![0.0, 1.0, 0.5],
    ];
    for encoding in Ply::ALL {
        let file = encoding.file(
            "",
            &[
                ("vertex", &["float x", "float y", "float z"], &rows),
                (
                    "face",
                    &["list uchar uint vertex_indices"],
                    &[vec![3.0, 0.0, 1.0, 2.0]],
                ),
            ],
        );
        // More data than the header states are read, with a note. Fewer are refused, wherever they
        // end.
        let longer = folder.open("a.ply", &[&file[..], b"7 7\n\n"].concat());
        assert!(longer.notes[0].contains("after the last element"));
        let words = folder.refuse("a.ply", &file[..file.len() - 3]);
        assert!(words.contains("element `face`"), "{words}");
    }
}

#[test]
fn broken_ply_headers_are_named() {
    let folder = Folder::new();
    let head = "ply\nformat ascii 1.0\n";
    for (text, words) in [
        ("ply\n".to_owned(), "end_header"),
        (format!("{head}element vertex 1\n"), "end_header"),
        ("ply\nformat utf8 1.0\nend_header\n".into(), "line 2"),
        (
            "ply\nelement vertex 1\nend_header\n".into(),
            "a line `format`",
        ),
        (format!("{head}element vertex -1\nend_header\n"), "line 3"),
        (format!("{head}property float x\nend_header\n"), "line 3"),
        (
            format!("{head}element vertex 1\nproperty half x\nend_header\n"),
            "line 4",
        ),
        (
            format!("{head}element vertex 1\nproperty list float int x\nend_header\n"),
            "line 4",
        ),
        (format!("{head}element face 0\nend_header\n"), "`face`"),
        (
            format!("{head}element vertex 1\nproperty float x\nend_header\n1\n"),
            "one column each",
        ),
        (
            format!("{head}element vertex 1\nproperty float packed_position\nend_header\n1\n"),
            "an element `chunk`",
        ),
        (format!("{head}magic\nend_header\n"), "`magic`"),
    ] {
        let error = folder.refuse("a.ply", text.as_bytes());
        assert!(error.contains(words), "{text}: {error}");
    }
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    for (kind, row, words) in [
        ("float", "1 2 3", "end of the line"),
        ("float", "1 2 3 4 5", "one more, `5`"),
        ("float", "1 2 three 4", "found `three`"),
        ("uchar", "1 2 3 256", "integer"),
        ("uchar", "1 2 3 1.5", "integer"),
    ] {
        let text = format!("{head}element vertex 1\n{xyz}property {kind} w\nend_header\n{row}\n");
        let error = folder.refuse("a.ply", text.as_bytes());
        assert!(
            error.contains(words) && error.contains("row 0 of 1"),
            "{error}"
        );
    }
}

/// Asserts that two numbers differ by at most `most`.
fn assert_near(a: impl Into<f64>, b: impl Into<f64>, most: f64, what: &str) {
    let (a, b) = (a.into(), b.into());
    assert!((a - b).abs() <= most, "{what}: {a} and {b}");
}

/// Largest errors of a format's numbers.
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

fn assert_holds(cloud: &SplatCloud, splats: &[Splat], degree: usize, q: &Quantum) {
    assert_eq!(cloud.positions.len(), splats.len());
    assert_eq!(usize::from(cloud.harmonics_degree), degree);
    assert_eq!(
        cloud.harmonics.len(),
        splats.len() * cloud.harmonics_stride()
    );
    for (i, s) in splats.iter().enumerate() {
        for axis in 0..3 {
            assert_near(
                cloud.positions[i][axis],
                s.position[axis],
                q.position,
                "position",
            );
            match s.scales.get(axis) {
                Some(scale) => {
                    let log = f64::from(cloud.scales[i][axis]).ln();
                    assert_near(log, scale.ln(), q.scale, "scale");
                }
                None => assert_eq!(cloud.scales[i][axis], 0.0),
            }
        }
        let unit = |r: [f64; 4]| DQuat::from_xyzw(r[1], r[2], r[3], r[0]).normalize();
        let (a, b) = (unit(cloud.rotations[i].map(f64::from)), unit(s.rotation));
        let b = if a.dot(b) < 0.0 { -b } else { b };
        let apart = (a - b)
            .to_array()
            .into_iter()
            .fold(0.0, |m: f64, c| m.max(c.abs()));
        assert_near(apart, 0.0, q.rotation, "rotation");
        assert_near(cloud.opacities[i], s.opacity, q.opacity, "opacity");
        let set = &cloud.harmonics[i * cloud.harmonics_stride()..][..cloud.harmonics_stride()];
        for (k, rgb) in set.chunks_exact(3).enumerate() {
            let most = if k == 0 { q.constant } else { q.harmonic };
            for (found, expected) in rgb.iter().zip(s.harmonics[k]) {
                assert_near(*found, expected, most, &format!("harmonic {k}"));
            }
        }
    }
}

/// f32 roundings, and those of a logarithm and a logit taken in f64 and inverted in f32.
const FLOATS: Quantum = Quantum {
    position: 0.0,
    scale: 1e-6,
    rotation: 1e-6,
    opacity: 1e-6,
    constant: 1e-7,
    harmonic: 1e-7,
};

#[test]
fn splats_from_ply_in_every_encoding_degree_and_layout() {
    let folder = Folder::new();
    for encoding in Ply::ALL {
        for degree in 0..=3 {
            let mut splats = some_splats(5, degree);
            let file = splat_ply(encoding, "comment x\n", &splats, &[]);
            let data = folder.open("a.ply", &file);
            assert_holds(cloud(&data), &splats, degree, &FLOATS);
            assert!(cloud(&data).rule == SplatRule::Inria && data.fields.is_empty());
            // If there are several marks, the last one applies.
            for (comments, is_marked) in [
                ("comment antialiased 1\n", true),
                ("comment splatrendermode:MIP\n", true),
                (
                    "comment antialiased 1\ncomment SplatRenderMode: default\n",
                    false,
                ),
                ("comment antialiased 0\n", false),
            ] {
                let data = folder.open("a.ply", &splat_ply(encoding, comments, &splats, &[]));
                let found = cloud(&data).rule.is_anti_aliased();
                assert_eq!(found, is_marked, "{comments}");
            }
            // Trailing properties of any kind, flat splats, a mark.
            for splat in &mut splats {
                splat.scales.pop();
            }
            let comments = "comment SplatRenderMode: mip\n";
            let extra = ["uchar flag", "double transform"];
            let file = splat_ply(encoding, comments, &splats, &extra);
            let data = folder.open("a.ply", &file);
            assert_holds(cloud(&data), &splats, degree, &FLOATS);
            assert_eq!(cloud(&data).rule, SplatRule::Mip);
            assert_eq!(data.field_names(), ["flag", "transform"]);
            assert_eq!(values(&data, "flag"), Values::U8(vec![7; 5]));
            assert!(data.notes[0].contains("flat"));
        }
        // Higher degrees are truncated, incomplete ones refused.
        let splats = some_splats(3, 4);
        let data = folder.open("a.ply", &splat_ply(encoding, "", &splats, &[]));
        assert_holds(cloud(&data), &splats, 3, &FLOATS);
        assert!(data.notes[0].contains("degree 4"));
        let mut splats = some_splats(3, 1);
        splats.iter_mut().for_each(|s| s.harmonics.truncate(3));
        let error = folder.refuse("a.ply", &splat_ply(encoding, "", &splats, &[]));
        assert!(error.contains("found 6"), "{error}");
    }
    let file = splat_ply(Ply::Ascii, "", &some_splats(2, 0), &[]);
    let text = String::from_utf8(file).unwrap().replace("rot_2", "rut_2");
    let error = folder.refuse("a.ply", text.as_bytes());
    assert!(error.contains("no property `rot_2`"), "{error}");
}

#[test]
fn splats_from_records() {
    let folder = Folder::new();
    let splats = some_splats(6, 0);
    let file = splat_records(&splats);
    let quantum = Quantum {
        rotation: 0.01,
        opacity: 0.5 / 255.0 + 1e-6,
        constant: 0.5 / 255.0 / 0.282 + 1e-6,
        ..FLOATS
    };
    let data = folder.open("a.splat", &file);
    assert_holds(cloud(&data), &splats, 0, &quantum);
    // The bytes themselves: c/255 is 1/2 + Y0 times the coefficient.
    let code = 0.5 + 0.282_094_8 * cloud(&data).harmonics[0];
    assert_near(code, f64::from(file[24]) / 255.0, 1e-6, "code");
    let error = folder.refuse("a.splat", &file[..file.len() - 1]);
    assert!(error.contains("multiple of 32"), "{error}");
}

#[test]
fn splats_from_spz() {
    let folder = Folder::new();
    for degree in 0..=3 {
        let splats = some_splats(6, degree);
        let quantum = |rotation| Quantum {
            position: 0.5 / 4096.0,
            scale: 0.5 / 16.0 + 1e-5,
            rotation,
            opacity: 0.5 / 255.0 + 1e-6,
            constant: 0.5 / 255.0 / 0.15 + 1e-6,
            harmonic: 0.5 / 128.0 + 1e-6,
        };
        // Bytes of x, y, z: half of 1/127.5, and more for the component computed from them; ten
        // bits: half of 1/(511 sqrt 2), and likewise more.
        for (version, flags, rotation) in [(2, 0, 0.02), (3, 1, 0.003)] {
            let data = folder.open("a.spz", &spz(version, flags, &splats));
            assert_holds(cloud(&data), &splats, degree, &quantum(rotation));
            assert_eq!(cloud(&data).rule.is_anti_aliased(), flags == 1);
            assert!(data.notes.is_empty());
        }
    }
    // The format is also recognised by content.
    let file = spz(3, 0, &some_splats(2, 1));
    assert_eq!(cloud(&folder.open("splats.gz", &file)).positions.len(), 2);
    // Degree 4 is truncated, and extensions are skipped.
    let splats = some_splats(3, 4);
    let file = gzip(&[spz_unpacked(3, 2, &splats), vec![1; 20]].concat());
    let data = folder.open("a.spz", &file);
    assert_eq!((cloud(&data).harmonics_degree, data.notes.len()), (3, 2));
    let third = f64::from(cloud(&data).harmonics[48 + 45]);
    assert_near(
        third,
        splats[1].harmonics[15][0],
        0.005,
        "the last of degree 3",
    );

    // Version 1: half floats.
    let one = some_splats(1, 0);
    let later = spz_unpacked(2, 0, &one);
    let halves = [0x3800_u16, 0x0000, 0xc000].map(u16::to_le_bytes).concat();
    let mut first = [&later[..16], &halves, &later[25..]].concat();
    first[4] = 1;
    let data = folder.open("a.spz", &gzip(&first));
    assert_eq!(cloud(&data).positions, [DVec3::new(0.5, 0.0, 2.0)]);
    assert_near(cloud(&data).opacities[0], one[0].opacity, 0.002, "opacity");
}

#[test]
fn spz_claims_are_checked_against_the_bytes() {
    let folder = Folder::new();
    let unpacked = spz_unpacked(3, 0, &some_splats(4, 1));
    let with = |at: usize, bytes: &[u8]| {
        let mut file = unpacked.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        gzip(&file)
    };
    for (file, words) in [
        (with(0, b"PGSN"), "NGSP"),
        (with(4, &[4]), "version 4"),
        (with(4, &[0]), "version 0"),
        (
            [b"NGSP\x04".to_vec(), vec![0; 40]].concat(),
            "a table of 5 streams",
        ),
        (with(8, &[5]), "5 splats"),
        // 4e9 splats in a hundred bytes.
        (with(8, &[255; 4]), "4294967295 splats"),
        (with(12, &[5]), "degree 5"),
        (with(12, &[3]), "degree 3"),
        (with(13, &[25]), "25 bits"),
        (with(8, &[0]), "at least one"),
        (b"\x1f\x8b\x08".to_vec(), "unpacking"),
        (gzip(b"NGSP"), "unpacking"),
    ] {
        let error = folder.refuse("a.spz", &file);
        assert!(error.contains(words), "{words}: {error}");
    }
    // Eight million zero splats are claimed by a compressed file of a few kilobytes that holds
    // fewer.
    let mut bomb = unpacked[..16].to_vec();
    bomb[8..12].copy_from_slice(&8_000_000_u32.to_le_bytes());
    bomb.extend(vec![0; 1 << 22]);
    let packed = gzip(&bomb);
    assert!(packed.len() < 1 << 14);
    assert!(folder.refuse("a.spz", &packed).contains("8000000 splats"));
}

/// Undrawable splats are left out and counted; the others are drawn.
#[test]
fn splats_that_cannot_be_drawn_are_counted() {
    let folder = Folder::new();
    let data = folder.open(
        "a.ply",
        &splat_ply(Ply::Little, "", &some_splats(9, 1), &[]),
    );
    let mut cloud = cloud(&data).clone();
    cloud.positions[0].y = f64::NAN;
    cloud.scales[1] = [1.0, -1.0, 1.0];
    cloud.scales[2] = [0.0; 3];
    cloud.rotations[3] = [0.0; 4];
    cloud.opacities[4] = -0.1;
    cloud.opacities[5] = f32::NAN;
    cloud.harmonics[6 * 12 + 11] = f32::INFINITY;
    cloud.scales[7] = [1.0, f32::INFINITY, 1.0];
    let with = |cloud| Dataset {
        geometry: Geometry::Splats(cloud),
        ..data.clone()
    };
    let options = SampleOptions::default();
    let Sampled { volume, report } = sample(with(cloud.clone()), &options).unwrap();
    assert_eq!((report.particle_count, report.left_out_count()), (1, 8));
    let counts: Vec<_> = report.findings.iter().map(|f| f.count).collect();
    assert_eq!(counts, [1, 3, 1, 2, 1]);
    let Particles::Anisotropic { positions, .. } = &volume.particles else {
        panic!()
    };
    assert_eq!(positions[0], data_position(&data, 8));
    let Colour::Harmonics {
        degree: 1,
        coefficients,
        is_linear: false,
    } = &volume.colour
    else {
        panic!()
    };
    assert_eq!(coefficients[..], cloud.harmonics[8 * 12..]);
    volume.validate().unwrap();
    cloud.opacities[8] = f32::NAN;
    assert!(sample(with(cloud), &options).is_err());
}

fn data_position(data: &Dataset, i: usize) -> DVec3 {
    cloud(data).positions[i]
}

#[test]
fn what_splats_store_follows_what_they_need() {
    let folder = Folder::new();
    let options = SampleOptions::default();
    for (degree, floats) in [(0, 3), (1, 12), (2, 27), (3, 48)] {
        let file = splat_ply(Ply::Little, "", &some_splats(300, degree), &["float w"]);
        let sampled = sample(folder.open("a.ply", &file), &options).unwrap();
        let needs = Requirements::of(&sampled.volume);
        assert_eq!(needs.colour_floats, floats);
        assert_eq!(usize::from(needs.harmonics_degree), degree);
        assert!(needs.peak_opacity && !needs.classification);
        let bytes = Renderer::new(vec![sampled.volume])
            .unwrap()
            .bytes_per_particle();
        // Offset, factor, opacity, colour; blocks of 300 splats.
        let stored = (4 * (3 + 6 + 1 + floats)) as f64;
        assert!(
            (stored..stored + 2.0).contains(&bytes),
            "{bytes} for {stored}"
        );
    }
    // A kernel width applies only to shapes that follow a spacing.
    let file = splat_ply(Ply::Little, "", &some_splats(5, 2), &["float w"]);
    let at = |kernel_width, field: Option<&str>| {
        let options = SampleOptions {
            kernels: KernelOptions {
                width: kernel_width,
                ..KernelOptions::default()
            },
            field: field.map(str::to_owned),
            ..SampleOptions::default()
        };
        sample(folder.open("a.ply", &file), &options)
            .unwrap()
            .volume
    };
    assert_eq!(at(0.6, None), at(3.0, None));
    let named = at(0.6, Some("w"));
    assert_eq!(named.colour, Colour::Classified);
    assert!(matches!(named.strength, Strength::PeakOpacity { .. }));
    Renderer::new(vec![named]).unwrap();
}

// Drawing.

/// Returns splats as a scene stores them.
fn splats(particles: &[Particle], rule: SplatRule) -> PointVolume {
    let volume = volume(particles);
    let Strength::Mass(opacities) = volume.strength else {
        panic!()
    };
    PointVolume {
        strength: Strength::PeakOpacity {
            opacities,
            rule,
            by_distance: false,
        },
        ..volume
    }
}

/// Returns the splat's variance on the image without low-pass filter, by J W V Wᵀ Jᵀ in f64.
fn image_variance(camera: &Camera, particle: &Particle) -> [f64; 3] {
    let u = camera.camera_point(particle.position);
    let f = camera.camera_from_world * particle.factor;
    let rows = match camera.projection {
        Projection::Perspective => [
            (f.row(0) / u.z - f.row(2) * (u.x / (u.z * u.z))) * camera.focal_px.x,
            (f.row(1) / u.z - f.row(2) * (u.y / (u.z * u.z))) * camera.focal_px.y,
        ],
        Projection::Orthographic => [f.row(0) * camera.focal_px.x, f.row(1) * camera.focal_px.y],
    };
    [
        rows[0].length_squared(),
        rows[0].dot(rows[1]),
        rows[1].length_squared(),
    ]
}

fn determinant([a, b, c]: [f64; 3], h2: f64) -> f64 {
    (a + h2) * (c + h2) - b * b
}

/// Moves the image so that the particle's centre is that of a pixel.
fn centred(mut camera: Camera, position: DVec3) -> (Camera, [usize; 2]) {
    let u = camera.camera_point(position);
    let slope = match camera.projection {
        Projection::Perspective => u.truncate() / u.z,
        Projection::Orthographic => u.truncate(),
    };
    let pixel = [camera.width / 2, camera.height / 2];
    let at = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5;
    camera.centre_px = at - camera.focal_px * slope;
    (camera, pixel)
}

/// The pixel at the centre has the file's opacity, from any side and distance, whatever the frame's
/// filter. The opacity of anti-aliased splats decreases with the filter's share.
#[test]
fn a_peak_is_the_stated_opacity_from_everywhere() {
    let mut random = crate::common::Random::new(41);
    let mut least: f64 = 1.0;
    for round in 0..60 {
        let size = random.log_range(0.01, 0.3);
        let mut factor = random.factor(size, 30.0);
        if round % 3 == 0 {
            // This splat is flat.
            factor.x_axis = DVec3::ZERO;
        }
        let particle = Particle {
            position: random.point(1.0),
            factor,
            mass: random.range(0.02, 0.99) as f32,
            colour: [0.8, 0.4, 0.2],
        };
        let side = random.point(1.0).normalize();
        for (distance, sign) in [(3.0, 1.0), (3.0, -1.0), (40.0, 1.0), (400.0, -1.0)] {
            let eye = particle.position + side * distance * sign;
            let target = particle.position + random.point(0.1);
            let looks = [
                Camera::perspective(eye, target, DVec3::Z, 40.0, [64, 48]),
                Camera::orthographic(eye, target, DVec3::Z, 2.0, [64, 48]),
            ];
            for (look, filter) in looks.into_iter().zip([Filter::Adaptive, Filter::Isotropic]) {
                let (camera, [x, y]) = centred(look, particle.position);
                let settings = Settings {
                    filter,
                    low_pass_variance_px2: 5.0,
                    ..Settings::default()
                };
                let plain = render(
                    vec![splats(&[particle], SplatRule::Exact)],
                    &camera,
                    &settings,
                );
                let [r, .., a] = plain.pixel(x, y);
                let opacity = f64::from(particle.mass);
                // The pixel's centre is the splat's to about 1e-6 px; f32 roundings.
                assert_near(a, opacity, 1e-5, "alpha");
                assert_near(r, 0.8 * opacity, 1e-5, "red");

                let image = render(
                    vec![splats(&[particle], SplatRule::Mip)],
                    &camera,
                    &settings,
                );
                let variance = image_variance(&camera, &particle);
                let h2 = f64::from(ANTI_ALIASED_LOW_PASS_PX2);
                let share = (determinant(variance, 0.0) / determinant(variance, h2)).sqrt();
                let peak = opacity * share;
                let seen = if peak < 1.0 / 255.0 { 0.0 } else { peak };
                assert_near(image.pixel(x, y)[3], seen, 1e-5, "compensated");
                least = least.min(share);
            }
        }
    }
    assert!(least < 0.01, "no compensation to speak of: {least}");
}

/// alpha = peak exp(-d² / 2 V) at all pixels within the cut-off, V with the filter's variance.
#[test]
fn a_splat_has_the_gaussian_profile_of_its_rule() {
    let particle = Particle {
        position: DVec3::new(0.0, 0.0, 5.0),
        factor: DMat3::from_diagonal(DVec3::new(0.3, 0.05, 0.1)),
        mass: 0.9,
        colour: [1.0; 3],
    };
    let camera = camera(Projection::Perspective, [40.0, 60.0], [33, 21]);
    for rule in [
        SplatRule::Exact,
        SplatRule::Khr,
        SplatRule::Inria,
        SplatRule::Mip,
    ] {
        let mut opaque = particle;
        opaque.mass = 1.0;
        for particle in [particle, opaque] {
            let h2 = f64::from(match rule {
                SplatRule::Mip => ANTI_ALIASED_LOW_PASS_PX2,
                _ => SPLAT_LOW_PASS_PX2,
            });
            let settings = Settings {
                cutoff: Some(7.0),
                ..Settings::default()
            };
            let image = render(vec![splats(&[particle], rule)], &camera, &settings);
            let [a, b, c] = image_variance(&camera, &particle);
            let share = (determinant([a, b, c], 0.0) / determinant([a, b, c], h2)).sqrt();
            let is_marked = rule == SplatRule::Mip;
            let peak = f64::from(particle.mass) * if is_marked { share } else { 1.0 };
            let (limit, floor, ceiling) = match rule {
                SplatRule::Exact => (49.0, 0.0, 1.0),
                SplatRule::Khr => (9.0, 0.0, 1.0),
                SplatRule::Inria | SplatRule::Mip => (49.0, 1.0 / 255.0, 0.99),
            };
            for y in 0..21 {
                for x in 0..33 {
                    let d = DVec2::new(x as f64 - 16.0, y as f64 - 10.0);
                    let q = d.x * d.x / (a + h2) + d.y * d.y / (c + h2);
                    let alpha = (peak * (-0.5 * q).exp()).min(ceiling);
                    let is_drawn = q < limit && alpha >= floor;
                    let expected = if is_drawn { alpha } else { 0.0 };
                    // The f32 exponential and a few roundings.
                    let place = format!("{rule:?} {x}, {y}");
                    assert_near(image.pixel(x, y)[3], expected, 2e-6, &place);
                }
            }
            // The default cut-off omits no more than the tolerance.
            let settings = Settings::default();
            let cut = render(vec![splats(&[particle], rule)], &camera, &settings);
            assert!(difference(&cut, &image) <= settings.tolerance * 1.001);
            assert_eq!(difference(&cut, &image) > 0.0, rule == SplatRule::Exact);
        }
    }
    // Fainter splats than the floor are not there.
    let faint = Particle::sphere(DVec3::new(0.0, 0.0, 5.0), 0.3, 0.0039);
    for (rule, is_there) in [(SplatRule::Khr, true), (SplatRule::Inria, false)] {
        let image = render(vec![splats(&[faint], rule)], &camera, &Settings::default());
        assert_eq!(image.pixels.iter().any(|p| p[3] > 0.0), is_there);
    }
}

#[test]
fn splats_behind_and_around_the_eye_are_left_out() {
    let camera = camera(Projection::Perspective, [40.0; 2], [32, 32]);
    let at = |z: f64, sigma: f64| Particle::sphere(DVec3::new(0.0, 0.0, z), sigma, 0.5);
    let brightest = |p: Particle| {
        let image = render(
            vec![splats(&[p], SplatRule::Exact)],
            &camera,
            &Settings::default(),
        );
        image.pixels.iter().map(|p| p[3]).fold(0.0, f32::max)
    };
    assert_eq!(brightest(at(-1.0, 0.1)), 0.0);
    assert_eq!(brightest(at(-0.1, 0.5)), 0.0);
    assert_eq!(brightest(at(0.49, 0.5)), 0.0);
    // The pixels next to the centre.
    assert!(brightest(at(0.51, 0.5)) > 0.49);
}

/// Far outside the image, the affine footprint uses the Jacobian at the margin.
#[test]
fn the_jacobian_stops_beyond_the_image() {
    let camera = camera(Projection::Perspective, [16.0; 2], [32, 32]);
    // The slope is 5; the image ends at 1, and the Jacobian is clamped at 1.3. The splat is so deep
    // along z that an unclamped Jacobian would smear it across the image.
    let beside = Particle {
        position: DVec3::new(5.0, 0.0, 1.0),
        factor: DMat3::from_diagonal(DVec3::new(0.01, 0.3, 0.9)),
        mass: 0.9,
        colour: [1.0; 3],
    };
    let settings = Settings {
        cutoff: Some(7.0),
        ..Settings::default()
    };
    let image = render(
        vec![splats(&[beside], SplatRule::Exact)],
        &camera,
        &settings,
    );
    // Its centre is at x = 16 + 16 x 5.
    let variance = [0.01_f64.powi(2) + (0.9_f64 * 1.3).powi(2), 0.3_f64.powi(2)];
    let [a, c] = variance.map(|v| 256.0 * v + f64::from(SPLAT_LOW_PASS_PX2));
    for x in [8, 20, 31] {
        let dx = x as f64 + 0.5 - 96.0;
        let expected = 0.9 * (-0.5 * (dx * dx / a + 0.25 / c)).exp();
        assert_near(image.pixel(x, 15)[3], expected, 1e-6, &format!("{x}"));
    }
    assert!(image.pixel(31, 15)[3] > 1e-3);
}

/// A volume and splats in one frame each follow their own rule, in depth order.
#[test]
fn volumes_and_splats_composite_in_the_order_of_depth() {
    let camera = camera(Projection::Perspective, [32.0; 2], [33, 33]);
    let ball = |z: f64| {
        // tau = g / (2 pi sigma²) in the middle; the kernel is wide enough to be flat there.
        let tau = 0.8;
        Particle::sphere(
            DVec3::new(0.0, 0.0, z),
            0.5,
            std::f64::consts::TAU * 0.25 * tau,
        )
        .coloured([1.0, 0.0, 0.0])
    };
    let splat = Particle::sphere(DVec3::new(0.0, 0.0, 10.0), 0.6, 0.7).coloured([0.0, 1.0, 0.0]);
    let settings = Settings {
        cutoff: Some(7.0),
        filter: Filter::Exact,
        low_pass_variance_px2: 0.0,
        depth: true,
        ..Settings::default()
    };
    let ball_alpha = 1.0 - (-0.8_f64).exp();
    for (z, order) in [
        (5.0, [ball_alpha, 0.7 * (1.0 - ball_alpha)]),
        (15.0, [0.3 * ball_alpha, 0.7]),
    ] {
        for swapped in [false, true] {
            let mut scene = vec![volume(&[ball(z)]), splats(&[splat], SplatRule::Exact)];
            if swapped {
                scene.reverse();
            }
            let mut renderer = Renderer::new(scene).unwrap();
            let pixel = renderer.render(&camera, &settings).unwrap().pixel(16, 16);
            assert_near(pixel[0], order[0], 2e-5, "volume");
            assert_near(pixel[1], order[1], 2e-5, "splat");
            assert_near(pixel[3], order[0] + order[1], 2e-5, "alpha");
            let first = z.min(10.0);
            assert_near(
                renderer.depth().unwrap().depths[16 * 33 + 16],
                first,
                1e-5,
                "depth",
            );
        }
    }
    // With linear opacity, the splat stays as it is.
    let linear = Settings {
        advanced: Advanced {
            linear_opacity: true,
            ..settings.advanced
        },
        ..settings
    };
    let image = render(
        vec![volume(&[ball(5.0)]), splats(&[splat], SplatRule::Exact)],
        &camera,
        &linear,
    );
    assert_near(image.pixel(16, 16)[1], 0.7 * 0.2, 2e-5, "behind tau .8");
}

/// Splats render alike on every instruction set, and in any order of the input.
#[test]
fn splats_do_not_depend_on_order_or_instruction_set() {
    let mut random = crate::common::Random::new(42);
    let particles: Vec<Particle> = (0..700)
        .map(|_| Particle {
            position: random.point(1.0),
            factor: {
                let size = random.log_range(0.01, 0.2);
                random.factor(size, 20.0)
            },
            mass: random.range(0.0, 1.0) as f32,
            colour: [0.2, 0.5, 0.9],
        })
        .collect();
    let eye = DVec3::new(2.0, -2.5, 1.0);
    let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 50.0, [70, 50]);
    let image = |particles: &[Particle], simd| -> Image {
        let settings = Settings {
            advanced: Advanced {
                simd,
                ..Advanced::default()
            },
            cutoff: Some(7.0),
            ..Settings::default()
        };
        render(vec![splats(particles, SplatRule::Mip)], &camera, &settings)
    };
    let best = image(&particles, ewa_splat::render::SimdLevel::best());
    let reversed: Vec<Particle> = particles.iter().rev().copied().collect();
    let levels = ewa_splat::render::SimdLevel::available();
    for level in levels {
        assert!(difference(&image(&particles, level), &best) < 1e-5);
    }
    assert!(
        difference(
            &image(&reversed, ewa_splat::render::SimdLevel::best()),
            &best
        ) < 1e-5
    );
    assert!(best.pixels.iter().any(|p| p[3] > 0.9));
}

fn shaded(harmonics: &[[f32; 3]], degree: u8, camera: &Camera) -> [f32; 3] {
    let volume = PointVolume {
        colour: Colour::Harmonics {
            degree,
            coefficients: harmonics.concat(),
            is_linear: false,
        },
        ..splats(&[Particle::sphere(DVec3::ZERO, 0.5, 0.5)], SplatRule::Exact)
    };
    let (camera, [x, y]) = centred(camera.clone(), DVec3::ZERO);
    let [r, g, b, a] = render(vec![volume], &camera, &Settings::default()).pixel(x, y);
    [r / a, g / a, b / a]
}

/// Checks degree 1 by hand: 1/2 + .2820948 c0 - .4886025 y c1 + .4886025 z c2 - .4886025 x c3.
#[test]
fn colours_follow_the_side_they_are_seen_from() {
    let set = [
        [0.5, 0.0, -0.5],
        [0.3, 0.0, 0.0],
        [0.0, 0.4, 0.0],
        [0.1, 0.2, -0.3_f32],
    ];
    for (direction, up, codes) in [
        // The camera looks along +x: the splat lies in direction (1, 0, 0) from the eye.
        (DVec3::X, DVec3::Z, [0.592_187_2, 0.402_279_5, 0.505_533_3]),
        (DVec3::Y, DVec3::Z, [0.494_466_6, 0.5, 0.358_952_6]),
        (
            DVec3::NEG_Z,
            DVec3::X,
            [0.641_047_4, 0.304_559, 0.358_952_6],
        ),
    ] {
        let eye = -direction * 6.0;
        for camera in [
            Camera::perspective(eye, DVec3::ZERO, up, 30.0, [16, 16]),
            Camera::orthographic(eye, DVec3::ZERO, up, 4.0, [16, 16]),
        ] {
            let found = shaded(&set, 1, &camera);
            for (c, code) in found.into_iter().zip(codes) {
                // Quotient of two f32 sums, and the slope of the sRGB curve.
                assert_near(c, linear_from_srgb(code), 3e-6, &format!("{direction}"));
            }
        }
    }
    // Negative sums are black; sums above 1 are kept.
    let camera = Camera::perspective(DVec3::Y * -6.0, DVec3::ZERO, DVec3::Z, 30.0, [16, 16]);
    let found = shaded(
        &[[-3.0, 3.0, 0.0], [0.0; 3], [0.0; 3], [0.0; 3]],
        1,
        &camera,
    );
    assert_eq!(found[0], 0.0);
    assert_near(
        found[1],
        linear_from_srgb(0.5 + 3.0 * 0.282_094_8),
        3e-6,
        "above 1",
    );
}

/// A constant colour is the same as harmonics of degree 0 and 3 with it.
#[test]
fn degrees_agree_where_they_can() {
    let folder = Folder::new();
    let mut low = some_splats(8, 0);
    for (i, splat) in low.iter_mut().enumerate() {
        splat.position = [i as f64 * 0.3 - 1.0, 0.2, -0.1 * i as f64];
    }
    let mut high = low.clone();
    for splat in &mut high {
        splat.harmonics.resize(16, [0.0; 3]);
    }
    let camera = Camera::perspective(
        DVec3::new(1.0, -6.0, 2.0),
        DVec3::ZERO,
        DVec3::Z,
        40.0,
        [40, 30],
    );
    let image = |splats: &[Splat]| {
        let data = folder.open("a.ply", &splat_ply(Ply::Little, "", splats, &[]));
        let sampled = sample(data, &SampleOptions::default()).unwrap();
        render(vec![sampled.volume], &camera, &Settings::default())
    };
    let (low, high) = (image(&low), image(&high));
    assert!(difference(&low, &high) < 1e-6);
    assert!(low.pixels.iter().any(|p| p[0] > 0.05));
}

#[test]
fn column_densities_refuse_splats() {
    let particle = Particle::sphere(DVec3::Z * 5.0, 1.0, 0.5);
    let mut renderer = Renderer::new(vec![splats(&[particle], SplatRule::Exact)]).unwrap();
    let camera = camera(Projection::Orthographic, [4.0; 2], [8, 8]);
    let error = renderer
        .column_density(&camera, &ColumnSettings::default())
        .unwrap_err();
    assert!(error.to_string().contains("state an opacity"), "{error}");
}

#[test]
fn the_reference_refuses_splats() {
    let particle = Particle::sphere(DVec3::ZERO, 1.0, 0.5);
    let error = Integrator::new(&[splats(&[particle], SplatRule::Exact)]).unwrap_err();
    assert!(
        error.to_string().contains("without the reference"),
        "{error}"
    );
    let coloured = PointVolume {
        colour: Colour::Harmonics {
            degree: 1,
            coefficients: vec![0.0; 12],
            is_linear: false,
        },
        ..volume(&[particle])
    };
    assert!(Integrator::new(std::slice::from_ref(&coloured)).is_err());
    // Arrays of wrong lengths are reported before anything is drawn.
    for (degree, count) in [(1, 11), (1, 24), (2, 12), (4, 75)] {
        let colour = Colour::Harmonics {
            degree,
            coefficients: vec![0.0; count],
            is_linear: false,
        };
        let wrong = PointVolume {
            colour,
            ..coloured.clone()
        };
        assert!(Renderer::new(vec![wrong]).is_err(), "{degree}, {count}");
    }
}

#[test]
fn fields_of_splats_are_those_that_nothing_else_uses() {
    let folder = Folder::new();
    let file = splat_ply(Ply::Big, "", &some_splats(2, 1), &["short id"]);
    let data = folder.open("a.ply", &file);
    assert!(
        matches!(&data.fields[0].source, FieldSource::Scalar(Values::I16(ids)) if *ids == [7, 7])
    );
}

// Compressed PLY.

/// Two chunks with different boxes check the meaning of every bit, with harmonics, and with colours
/// in boxes and without.
#[test]
fn packed_splats_have_the_values_that_their_bits_say() {
    for encoding in Ply::ALL {
        for degree in [0, 1, 3] {
            let data = read(
                "a.ply",
                &packed_ply(encoding, degree, true),
                &OpenOptions::default(),
            );
            let data = data.unwrap();
            let cloud = cloud(&data);
            assert!(data.notes.is_empty() && data.field_names().is_empty());
            assert_eq!(cloud.positions.len(), 258);
            assert_eq!(usize::from(cloud.harmonics_degree), degree);
            // The first chunk has boxes from -1 to 1, 0 to 2 and 5 to 5: x is at 2046/2047, y at
            // 1/1023, z at 1 of them.
            let close = |a: f64, b: f64| (a - b).abs() <= 2e-7 * b.abs().max(1.0);
            let expected = [-1.0 + 2.0 * 2046.0 / 2047.0, 2.0 / 1023.0, 5.0];
            for (found, expected) in cloud.positions[3].to_array().into_iter().zip(expected) {
                assert!(close(found, expected), "{found} {expected}");
            }
            // The second chunk has the same bits, from 10 to 20 along each axis.
            let expected = [10.0 + 10.0 * 2046.0 / 2047.0, 10.0 + 10.0 / 1023.0, 20.0];
            for (found, expected) in cloud.positions[257].to_array().into_iter().zip(expected) {
                assert!(close(found, expected), "{found} {expected}");
            }
            // Logarithms from -4 to 0.
            let shares = [0.0, 1.0, 1023.0 / 2047.0];
            for (found, share) in cloud.scales[3].into_iter().zip(shares) {
                assert!(
                    close(found.into(), (-4.0_f64 + 4.0 * share).exp()),
                    "{found}"
                );
            }
            // Each component is the largest once; the others are -√½, 0 by 511.5 of 1023, and √½ /
            // 1023.
            let low = -0.5_f64.sqrt();
            let others = [
                low,
                0.5_f64.sqrt() / 1023.0,
                low + 2.0_f64.sqrt() * 256.0 / 1023.0,
            ];
            let largest = (1.0 - others.iter().map(|c| c * c).sum::<f64>())
                .max(0.0)
                .sqrt();
            for i in 0..4 {
                let mut expected = others.to_vec();
                expected.insert(i, largest);
                for (found, expected) in cloud.rotations[i].into_iter().zip(expected) {
                    assert!(close(found.into(), expected), "{i}: {found} {expected}");
                }
            }
            assert!(close(cloud.opacities[3].into(), 51.0 / 255.0));
            let stride = cloud.harmonics_stride();
            let set = &cloud.harmonics[3 * stride..][..stride];
            // Colours from .5 to 1.5 in the first chunk.
            for (found, share) in set.iter().zip([0.0, 1.0, 102.0 / 255.0]) {
                let constant = share / 0.282_094_791_773_878_14;
                assert!(close((*found).into(), constant), "{found} {constant}");
            }
            // Bytes 0, 255, 1, 2, 3, ...: first all of red, then green, then blue.
            for k in 1..stride / 3 {
                for channel in 0..3 {
                    let place = channel * (stride / 3 - 1) + k - 1;
                    let expected = match place {
                        0 => -4.0,
                        1 => 4.0,
                        n => (n as f64 - 1.0 + 0.5) / 32.0 - 4.0,
                    };
                    assert!(close(set[3 * k + channel].into(), expected), "{place}");
                }
            }
            // Without boxes of colours, the fractions are the colours.
            let plain = packed_ply(encoding, degree, false);
            let plain = read("a.ply", &plain, &OpenOptions::default()).unwrap();
            let Geometry::Splats(plain) = &plain.geometry else {
                panic!()
            };
            let constant = (102.0 / 255.0 - 0.5) / 0.282_094_791_773_878_14;
            assert!(close(plain.harmonics[3 * stride + 2].into(), constant));
        }
    }
}

#[test]
fn packed_splats_that_lack_something_are_refused() {
    let open = |text: &str| read("a.ply", text.as_bytes(), &OpenOptions::default());
    let good = String::from_utf8(packed_ply(Ply::Ascii, 1, true)).unwrap();
    assert!(open(&good).is_ok());
    for (from, to, words) in [
        (
            "float min_scale_y",
            "float least",
            "chunks with `min_scale_y`",
        ),
        (
            "packed_rotation",
            "rotation",
            "splats with `packed_rotation`",
        ),
        ("uchar f_rest_0", "float f_rest_0", "bytes (uchar)"),
        ("f_rest_8", "f_best_8", "0, 9, 24 or 45"),
        ("element sh 258", "element sh 257", "of 257"),
        ("element chunk 2", "element chunk 1", "row 0 of 258"),
        (
            "uint packed_color",
            "float packed_color\nproperty float x",
            "row 0 of 258",
        ),
    ] {
        let error = open(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(words), "{from}: {error}");
    }
    // The second chunk's row is missing.
    let (head, rows) = good.split_once("end_header\n").unwrap();
    let mut rows: Vec<&str> = rows.lines().collect();
    rows.remove(1);
    let head = head.replacen("element chunk 2", "element chunk 1", 1);
    let error = open(&format!("{head}end_header\n{}\n", rows.join("\n"))).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("expected 2 chunks for 258 splats, found 1"),
        "{error}"
    );
}

// Scales that are logarithms, and splats of glTF in other numbers and under other names.

/// Makes a .glb of two splats from attributes: names in the extension, component type, bytes.
fn glb_of(attributes: &[(&str, &str, u32, Vec<u8>)]) -> Vec<u8> {
    let mut binary = Vec::new();
    let (mut accessors, mut views) = (Vec::new(), Vec::new());
    let mut names = serde_json::Map::new();
    for (i, (name, kind, code, bytes)) in attributes.iter().enumerate() {
        names.insert((*name).to_owned(), i.into());
        accessors.push(
            serde_json::json!({ "bufferView": i, "componentType": code, "count": 2,
                                           "type": kind, "normalized": *code != 5126 }),
        );
        views.push(serde_json::json!({ "buffer": 0, "byteOffset": binary.len(),
                                       "byteLength": bytes.len() }));
        binary.extend(bytes);
    }
    let json = serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "scale": [2.0, 2.0, 2.0] }],
        "meshes": [{ "primitives": [{ "mode": 0, "attributes": names,
            "extensions": { "KHR_gaussian_splatting": {} } }] }],
        "accessors": accessors, "bufferViews": views, "buffers": [{ "byteLength": binary.len() }],
    });
    glb(&json, &binary)
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

const IDENTITIES: [f32; 8] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

#[test]
fn negative_scales_of_gltf_splats_are_logarithms() {
    let (half, quarter) = (0.5_f32.ln(), 0.25_f32.ln());
    let file = |scales: [f32; 6]| {
        let name = |n: &str| format!("KHR_gaussian_splatting:{n}");
        glb_of(&[
            (
                "POSITION",
                "VEC3",
                5126,
                floats(&[0.0, 0.0, 0.0, 1.0, 2.0, 3.0]),
            ),
            (&name("SCALE"), "VEC3", 5126, floats(&scales)),
            (&name("ROTATION"), "VEC4", 5126, floats(&IDENTITIES)),
            (&name("OPACITY"), "SCALAR", 5126, floats(&[0.25, 0.75])),
            (&name("SH_DEGREE_0_COEF_0"), "VEC3", 5126, floats(&[0.5; 6])),
        ])
    };
    let logarithms = file([half, 0.0, quarter, half, half, half]);
    let scales = |bytes: &[u8], meaning: Option<ScaleMeaning>| {
        let options = OpenOptions {
            scales: meaning,
            ..OpenOptions::default()
        };
        let data = read("a.glb", bytes, &options).unwrap();
        (cloud(&data).scales.clone(), data.notes.clone())
    };
    // The node doubles the size, after the exponential.
    let close = |found: [f32; 3], expected: [f32; 3]| {
        (0..3).all(|i| (found[i] - expected[i]).abs() <= 4.0 * f32::EPSILON * expected[i].abs())
    };
    let (found, notes) = scales(&logarithms, None);
    assert!(
        close(found[0], [1.0, 2.0, 0.5]) && close(found[1], [1.0; 3]),
        "{found:?}"
    );
    assert!(
        notes[0].contains("2 splats are taken as logarithms, because"),
        "{notes:?}"
    );
    let (found, notes) = scales(&logarithms, Some(ScaleMeaning::Linear));
    assert!(close(found[0], [2.0 * half, 0.0, 2.0 * quarter]) && notes.is_empty());
    // Scales that are all above 0 stay standard deviations, unless an option makes them logarithms.
    let linear = file([0.5, 1.0, 0.25, 0.5, 0.5, 0.5]);
    let (found, notes) = scales(&linear, None);
    assert!(close(found[0], [1.0, 2.0, 0.5]) && notes.is_empty());
    let (found, notes) = scales(&linear, Some(ScaleMeaning::Logarithms));
    assert!(close(found[0], [0.5, 1.0, 0.25].map(|s: f32| 2.0 * s.exp())) && notes.len() == 1);
}

#[test]
fn splats_of_gltf_open_under_their_first_names_and_in_shorts() {
    let shorts = |numbers: &[i32]| -> Vec<u8> {
        let low = |n: &i32| n.to_le_bytes()[..2].to_vec();
        numbers.iter().flat_map(low).collect()
    };
    let file = glb_of(&[
        (
            "POSITION",
            "VEC3",
            5122,
            shorts(&[0, 0, 0, 32767, -32767, -32768]),
        ),
        (
            "_SCALE",
            "VEC3",
            5123,
            shorts(&[65535, 13107, 0, 65535, 65535, 65535]),
        ),
        ("_ROTATION", "VEC4", 5120, vec![0, 0, 0, 127, 129, 0, 0, 0]),
        ("COLOR_0", "VEC4", 5121, vec![255, 0, 51, 102, 0, 0, 0, 255]),
    ]);
    let data = read("a.glb", &file, &OpenOptions::default()).unwrap();
    let cloud = cloud(&data);
    assert_eq!(cloud.positions, [DVec3::ZERO, DVec3::new(2.0, -2.0, -2.0)]);
    assert_eq!(cloud.scales[0][0], 2.0);
    assert!((cloud.scales[0][1] - 0.4).abs() < 1e-7 && cloud.scales[0][2] == 0.0);
    assert_eq!(
        cloud.rotations,
        [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]
    );
    assert_eq!(cloud.opacities, [0.4, 1.0]);
    for (found, code) in cloud
        .harmonics
        .iter()
        .zip([1.0_f32, 0.0, 0.2, 0.0, 0.0, 0.0])
    {
        assert!((0.5 + 0.282_094_8 * found - code).abs() < 1e-6, "{found}");
    }
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}

#[test]
fn negative_columns_of_scales_are_logarithms() {
    let table = b"x,y,z,scale_0,scale_1,scale_2,rot_0,rot_1,rot_2,rot_3,mass\n\
        0,0,0,-3,0,-2,1,0,0,0,.5\n0,0,1,1,1,1,1,0,0,0,.5\n";
    let column = |meaning: Option<ScaleMeaning>| {
        let options = OpenOptions {
            scales: meaning,
            ..OpenOptions::default()
        };
        let data = read("a.csv", table, &options).unwrap();
        let values = values(&data, "scale_0");
        ([values.get(0), values.get(1)], data.notes.len())
    };
    let exponentials = ([(-3.0_f32).exp(), 1.0_f32.exp()], 1);
    assert_eq!(column(None), exponentials);
    assert_eq!(column(Some(ScaleMeaning::Logarithms)), exponentials);
    assert_eq!(column(Some(ScaleMeaning::Linear)), ([-3.0, 1.0], 0));
    // Data without such scales refuse the option.
    let options = OpenOptions {
        scales: Some(ScaleMeaning::Linear),
        ..OpenOptions::default()
    };
    let error = read("a.csv", b"x,y,z,sigma\n0,0,0,1\n1,0,0,1\n", &options).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("leave the meaning of scales out"),
        "{error}"
    );
}

// SPZ version 4.

/// The same splats compressed as one stream and as several, by storing and by a compressor.
#[test]
fn spz_in_streams_holds_what_it_holds_in_one() {
    type Pack = fn(&[u8]) -> Vec<u8>;
    let compressed = |bytes: &[u8]| {
        ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
    };
    let packers: [Pack; 2] = [stored, compressed];
    let options = OpenOptions::default();
    for degree in 0..4 {
        let splats = some_splats(40, degree);
        let one = read("a.spz", &spz(3, 1, &splats), &options).unwrap();
        let bare = read("a.spz", &spz_unpacked(3, 1, &splats), &options).unwrap();
        assert_eq!(cloud(&bare), cloud(&one), "without gzip");
        for pack in packers {
            let streams = read("a.spz", &spz_streams(1, &splats, &pack), &options).unwrap();
            assert_eq!(cloud(&streams), cloud(&one), "degree {degree}");
            assert!(streams.notes.is_empty());
        }
    }
    // Splats of degree 4 are cut to the first three degrees.
    let four = read(
        "a.spz",
        &spz_streams(0, &some_splats(3, 4), &stored),
        &options,
    )
    .unwrap();
    assert_eq!(cloud(&four).harmonics_degree, 3);
    assert!(four.notes[0].contains("harmonics of degree 4"));
}

#[test]
fn spz_streams_are_checked_against_the_header() {
    let good = spz_streams(0, &some_splats(4, 1), &stored);
    let refused = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut file = good.clone();
        change(&mut file);
        let answer = read("a.spz", &file, &OpenOptions::default());
        answer.unwrap_err().to_string()
    };
    for (at, byte, words) in [
        (8, 5, "stream 0: expected 45 bytes for 5 splats, found 36"),
        (15, 5, "a table of 6 streams or more"),
        (16, 31, "a table of 6 streams or more"),
        (19, 1, "a table of 6 streams or more"),
        (11, 255, "a file of"),
        (39, 1, "left in the file"),
        (40, 37, "stream 0: expected 36 bytes for 4 splats, found 37"),
        (128, 0, "a sound zstd stream"),
    ] {
        let words_found = refused(&|file| file[at] = byte);
        assert!(words_found.contains(words), "{at}: {words_found}");
    }
    for len in [20, 40, 130, good.len() - 1] {
        refused(&|file| file.truncate(len));
    }
}
