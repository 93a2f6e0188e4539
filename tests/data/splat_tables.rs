//! Tests splats in tables, the 3-D filter, and SPZ files with other axes and distant splats.

use std::mem::take;

use ewa_splat::io::{
    Geometry, OpenOptions, ReadAs, ScaleMeaning, SplatCloud, SplatFileOptions, SpzVersion, open,
    read, write_splats,
};
use ewa_splat::scene::SplatRule;
use glam::{DQuat, DVec3};

use crate::common::Random;
use crate::support::Folder;
use crate::support::splats::{Ply, some_splats, splat_ply, spz, spz_streams, stored};

fn cloud(name: &str, bytes: &[u8], options: &OpenOptions) -> (SplatCloud, Vec<String>) {
    let data = read(name, bytes, options).unwrap();
    match data.geometry {
        Geometry::Splats(cloud) => (cloud, data.notes),
        other => panic!("{other:?}"),
    }
}

/// Returns rows: position, logarithms of scales, rotation, logit.
fn rows(count: usize) -> Vec<[f64; 11]> {
    let mut random = Random::new(5);
    (0..count)
        .map(|_| {
            let mut row = [0.0; 11];
            row.iter_mut().for_each(|x| *x = random.range(-1.0, 1.0));
            row[3..6].iter_mut().for_each(|s| *s -= 3.0);
            row[10] *= 4.0;
            row
        })
        .collect()
}

const COLUMNS: &str = "x,y,z,scale_0,scale_1,scale_2,rot_0,rot_1,rot_2,rot_3,opacity";

fn csv(more: &str, rows: &[[f64; 11]], extra: impl Fn(usize) -> String) -> String {
    let mut table = format!("{COLUMNS}{more}\n");
    for (i, row) in rows.iter().enumerate() {
        let numbers: Vec<String> = row.iter().map(f64::to_string).collect();
        table += &format!("{}{}\n", numbers.join(","), extra(i));
    }
    table
}

fn near(a: f32, b: f64, what: &str) {
    assert!(
        (f64::from(a) - b).abs() <= 1e-6 * (1.0 + b.abs()),
        "{what}: {a}, {b}"
    );
}

fn assert_rows(cloud: &SplatCloud, rows: &[[f64; 11]]) {
    assert_eq!(cloud.positions.len(), rows.len());
    for (i, row) in rows.iter().enumerate() {
        assert_eq!(cloud.positions[i].to_array(), row[..3]);
        for axis in 0..3 {
            near(cloud.scales[i][axis], row[3 + axis].exp(), "scale");
        }
        for k in 0..4 {
            near(cloud.rotations[i][k], row[6 + k], "rotation");
        }
        near(
            cloud.opacities[i],
            1.0 / (1.0 + (-row[10]).exp()),
            "opacity",
        );
    }
}

#[test]
fn tables_with_the_columns_of_splats_are_splats() {
    let rows = rows(40);
    let options = OpenOptions::default();
    // The coefficients form a full degree.
    let rest: String = (0..9).map(|k| format!(",f_rest_{k}")).collect();
    let more = format!(",f_dc_0,f_dc_1,f_dc_2{rest}");
    let of = |i: usize| {
        (0..12)
            .map(|k| format!(",{}", (i + k) as f64 / 64.0))
            .collect()
    };
    let (found, notes) = cloud("a.csv", csv(&more, &rows, of).as_bytes(), &options);
    assert!(notes.is_empty(), "{notes:?}");
    assert_rows(&found, &rows);
    assert_eq!(found.harmonics_degree, 1);
    for i in 0..rows.len() {
        let set = &found.harmonics[12 * i..][..12];
        // Each channel has its own three coefficients, one after another.
        let place = |k: usize, channel: usize| match k {
            0 => channel,
            _ => 3 + 3 * channel + k - 1,
        };
        for (n, c) in set.iter().enumerate() {
            assert_eq!(*c, (i + place(n / 3, n % 3)) as f32 / 64.0);
        }
    }
    // Colours as bytes, as codes, and linear.
    for (names, of, code) in [
        (",red,green,blue", ",255,0,51", [1.0, 0.0, 0.2]),
        (",red,green,blue", ",1,0,.2", [1.0, 0.0, 0.2]),
        (",r,g,b", ",1,0,.0331047666", [1.0, 0.0, 0.2]),
        ("", "", [1.0; 3]),
    ] {
        let table = csv(names, &rows, |_| of.to_owned());
        let (found, notes) = cloud("a.csv", table.as_bytes(), &options);
        assert_rows(&found, &rows);
        for (c, code) in found.harmonics.iter().zip(code.into_iter().cycle()) {
            near(0.5 + 0.282_094_8 * c, code, "code");
        }
        assert!(notes.iter().any(|n| n.contains("logarithms")), "{notes:?}");
        assert!(notes.iter().any(|n| n.contains("logits")), "{notes:?}");
        assert_eq!(notes.iter().any(|n| n.contains("white")), names.is_empty());
    }
    // Numbers stay unchanged if none is negative and none is beyond 0 to 1.
    let plain = format!(
        "{COLUMNS},r,g,b\n0,0,0,.5,.25,.1,1,0,0,0,.75,1,1,1\n1,0,0,.5,.25,.1,1,0,0,0,0,1,1,1\n"
    );
    let (found, notes) = cloud("a.csv", plain.as_bytes(), &options);
    assert_eq!(
        (found.scales[0], found.opacities[0]),
        ([0.5, 0.25, 0.1], 0.75)
    );
    assert!(notes.is_empty(), "{notes:?}");
    // An option takes precedence.
    let logarithms = OpenOptions {
        scales: Some(ScaleMeaning::Logarithms),
        ..OpenOptions::default()
    };
    let (found, _) = cloud("a.csv", plain.as_bytes(), &logarithms);
    near(found.scales[0][0], 0.5_f64.exp(), "stated");
    // Particles have masses; points must be asked for.
    let massive = plain.replace("r,g,b", "mass,g,b");
    let data = read("a.csv", massive.as_bytes(), &options).unwrap();
    assert!(matches!(data.geometry, Geometry::Points { .. }));
    let points = OpenOptions {
        read_as: Some(ReadAs::Points),
        ..OpenOptions::default()
    };
    let data = read("a.csv", plain.as_bytes(), &points).unwrap();
    assert!(matches!(data.geometry, Geometry::Points { .. }));
}

/// The fields of a PLY file decide, not its kind: bytes beside logits.
#[test]
fn tables_in_ply_with_colours_are_splats() {
    let rows = rows(20);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        rows.len()
    );
    for name in COLUMNS.split(',') {
        bytes += &format!("property double {name}\n");
    }
    for name in ["red", "green", "blue"] {
        bytes += &format!("property uchar {name}\n");
    }
    let mut bytes = (bytes + "end_header\n").into_bytes();
    for row in &rows {
        row.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([255, 0, 51]);
    }
    let data = read("a.ply", &bytes, &OpenOptions::default()).unwrap();
    assert_eq!(data.format, "PLY splats");
    let Geometry::Splats(found) = data.geometry else {
        panic!()
    };
    assert_rows(&found, &rows);
    for (c, code) in found
        .harmonics
        .iter()
        .zip([1.0, 0.0, 0.2].into_iter().cycle())
    {
        near(0.5 + 0.282_094_8 * c, code, "code");
    }
}

/// The filter multiplies opacity by the root of det(S²) / det(S² + f²); scales become sqrt(s² +
/// f²).
#[test]
fn the_filter_in_space_is_applied() {
    let splats = some_splats(9, 1);
    let plain = splat_ply(Ply::Little, "", &splats, &[]);
    let (plain, _) = cloud("a.ply", &plain, &OpenOptions::default());
    // The extra property of the fixture's writer is 7.
    let filtered = splat_ply(Ply::Little, "", &splats, &["float filter_3D"]);
    let (filtered, notes) = cloud("a.ply", &filtered, &OpenOptions::default());
    assert!(notes.iter().any(|n| n.contains("filter_3D")), "{notes:?}");
    assert_eq!(
        [plain.rule, filtered.rule],
        [SplatRule::Inria, SplatRule::Mip]
    );
    for i in 0..splats.len() {
        let before = plain.scales[i].map(f64::from);
        let mut share = 1.0;
        for (axis, own) in before.into_iter().enumerate() {
            let after = own.hypot(7.0);
            share *= own / after;
            near(filtered.scales[i][axis], after, "scale");
        }
        near(
            filtered.opacities[i],
            f64::from(plain.opacities[i]) * share,
            "opacity",
        );
    }
}

/// Returns a file of version 4 with an extension record before its table.
fn with_record(file: &[u8], kind: u32, payload: &[u8]) -> Vec<u8> {
    let table_at = u32::from_le_bytes(file[16..20].try_into().unwrap());
    assert_eq!(table_at, 32);
    let mut record = kind.to_le_bytes().to_vec();
    record.extend((payload.len() as u32).to_le_bytes());
    record.extend(payload);
    let mut bytes = file[..32].to_vec();
    bytes[14] |= 2;
    bytes[16..20].copy_from_slice(&(table_at + record.len() as u32).to_le_bytes());
    bytes.extend(record);
    bytes.extend(&file[32..]);
    bytes
}

#[test]
fn spz_states_its_axes() {
    let file = spz_streams(0, &some_splats(12, 3), &stored);
    let options = OpenOptions::default();
    let (plain, _) = cloud("a.spz", &file, &options);
    // The file's axes are x right, y up, z back.
    let own = |p: DVec3| DVec3::new(p.x, -p.y, -p.z);
    // Maps from PLY's axes to those of the file: left or right, down or up, back or front; then y
    // forward.
    type Map = fn(DVec3) -> DVec3;
    let maps: [(u32, Map); 8] = [
        (1, |p| DVec3::new(-p.x, p.y, -p.z)),
        (3, |p| DVec3::new(-p.x, -p.y, -p.z)),
        (4, |p| DVec3::new(p.x, -p.y, -p.z)),
        (6, |p| p),
        (7, |p| DVec3::new(-p.x, -p.y, p.z)),
        (12, |p| DVec3::new(p.x, -p.z, p.y)),
        (9, |p| DVec3::new(-p.x, p.z, p.y)),
        (16, |p| DVec3::new(p.x, -p.z, -p.y)),
    ];
    for (axes, map) in maps {
        let (found, notes) = cloud(
            "a.spz",
            &with_record(&file, 0xADBE_0003, &axes.to_le_bytes()),
            &options,
        );
        assert_eq!(notes.len(), usize::from(axes != 4), "{notes:?}");
        for i in 0..plain.positions.len() {
            let expected = map(own(plain.positions[i]));
            assert!((found.positions[i] - expected).length() < 1e-12, "{axes}");
            // A kernel extends as far in each direction as in its file.
            let reach = |cloud: &SplatCloud, d: DVec3| {
                let [w, x, y, z] = cloud.rotations[i].map(f64::from);
                let q = DQuat::from_xyzw(x, y, z, w).normalize();
                let local = q.inverse() * d;
                (local * DVec3::from(cloud.scales[i].map(f64::from))).length()
            };
            for d in [DVec3::X, DVec3::ONE, DVec3::new(0.3, -0.8, 0.5)] {
                let (a, b) = (reach(&plain, d), reach(&found, map(own(d))));
                assert!((a - b).abs() < 1e-6 * a, "{axes}: {a}, {b}");
            }
            // It also has the same colours in each direction.
            let colour = |cloud: &SplatCloud, d: DVec3| {
                let basis = ewa_splat::math::harmonics(d.normalize().as_vec3());
                ewa_splat::math::harmonics_sum(&cloud.harmonics[48 * i..][..48], &basis)
            };
            let d = DVec3::new(0.48, -0.6, 0.64);
            let (a, b) = (colour(&plain, d), colour(&found, map(own(d))));
            for c in 0..3 {
                assert!((a[c] - b[c]).abs() < 2e-5, "{axes}: {a:?}, {b:?}");
            }
        }
    }
    // Unknown axes and records are reported; truncated ones are harmless.
    for (kind, payload, word) in [
        (0xADBE_0003_u32, &99_u32.to_le_bytes()[..], "unknown"),
        (0xADBE_0003, &[1, 2], "not read"),
        (0xADBE_0002, &[0; 12], "kept for SPZ"),
    ] {
        let (mut found, notes) = cloud("a.spz", &with_record(&file, kind, payload), &options);
        let kept = take(&mut found.records).kept().len();
        assert_eq!(kept, usize::from(kind == 0xADBE_0002));
        assert_eq!(found, plain);
        assert!(notes.len() == 1 && notes[0].contains(word), "{notes:?}");
    }
    let mut long = with_record(&file, 0xADBE_0003, &6_u32.to_le_bytes());
    long[36..40].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(cloud("a.spz", &long, &options).0, plain);
    assert!(!spz(3, 0, &some_splats(2, 0)).is_empty());
}

#[test]
fn far_splats_do_not_coarsen_the_others() {
    let folder = Folder::new();
    let mut random = Random::new(3);
    let count = 500;
    let mut splats = SplatCloud {
        positions: (0..count).map(|_| random.point(1.0)).collect(),
        scales: vec![[0.02; 3]; count],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacities: vec![0.7; count],
        harmonics: vec![0.2; 3 * count],
        ..SplatCloud::default()
    };
    let path = folder.path().join("a.spz");
    for version in [None, Some(SpzVersion::Four)] {
        let options = SplatFileOptions {
            spz_version: version,
            ..SplatFileOptions::default()
        };
        let step = |splats: &SplatCloud| {
            let written = write_splats(&path, splats, &options).unwrap();
            (written.position_quantum, written.notes.join("\n"))
        };
        splats.positions[7] = DVec3::ZERO;
        let (fine, notes) = step(&splats);
        assert!(fine < 1e-6 && notes.is_empty(), "{fine}: {notes}");
        splats.positions[7] = DVec3::new(1e6, 0.0, 0.0);
        let (fine, notes) = step(&splats);
        assert!(fine <= 0.02 * 0.02, "{fine}");
        assert!(
            notes.contains("splat 7 ") && notes.contains("--crop"),
            "{notes}"
        );
        let data = open(&path, &OpenOptions::default()).unwrap();
        let Geometry::Splats(read) = data.geometry else {
            panic!()
        };
        for (i, (a, b)) in splats.positions.iter().zip(&read.positions).enumerate() {
            let apart = (*a - *b).abs().max_element();
            assert!(i == 7 || apart <= 0.5001 * fine, "{i}: {apart}");
        }
        // The splat lies as far away as the steps allow.
        assert!(read.positions[7].x > 1e3 && read.positions[7].y == 0.0);
    }
}
