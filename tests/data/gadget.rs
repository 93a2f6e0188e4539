//! Tests binary Gadget snapshots.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{
    Dataset, Geometry, LengthMeaning, OpenOptions, ParticleType, format_of, open, read,
};

use crate::support::gadget::{DARK, Form, HALVES, SOME, value};
use crate::support::of_type;

fn numbers(data: &Dataset, selector: &str) -> Vec<f64> {
    let (_, values) = data.scalar(selector).unwrap();
    (0..values.len())
        .map(|i| f64::from(values.get(i)))
        .collect()
}

fn expected(particles: std::ops::Range<usize>, field: usize) -> Vec<f64> {
    particles.map(|p| value(p, field)).collect()
}

fn check_gas(data: &Dataset) {
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    for (p, position) in positions.iter().enumerate() {
        assert_eq!(position.to_array(), [0, 1, 2].map(|axis| value(p, axis)));
    }
    let fields = [
        ("Velocities:x", 3),
        ("Velocities:z", 5),
        ("ParticleIDs", 0),
        ("Masses", 6),
        ("InternalEnergy", 7),
        ("Density", 8),
        ("SmoothingLength", 9),
    ];
    for (name, field) in fields {
        assert_eq!(numbers(data, name), expected(0..4, field), "{name}");
    }
    let smoothing = data.smoothing.as_ref().unwrap();
    assert_eq!(smoothing.length.as_deref(), Some("SmoothingLength"));
    assert_eq!(smoothing.meaning, LengthMeaning::Support);
    assert_eq!(smoothing.mass.as_deref(), Some("Masses"));
    assert_eq!(smoothing.density.as_deref(), Some("Density"));
    let types: Vec<String> = data.particle_types.iter().map(|t| t.name.clone()).collect();
    assert_eq!(types, ["PartType0", "PartType1", "PartType4"]);
    let counts: Vec<usize> = data.particle_types.iter().map(|t| t.count).collect();
    assert_eq!(counts, [4, 3, 2]);
}

#[test]
fn particles_of_each_type_are_read_in_every_form() {
    for form in Form::all() {
        let bytes = form.snapshot(1, &SOME);
        let gas = read("any", &bytes, &OpenOptions::default()).unwrap();
        check_gas(&gas);
        assert_eq!(
            gas.notes[0],
            "Only PartType0 is shown; PartType1, PartType4 left out."
        );

        let dark = read("any", &bytes, &of_type(ParticleType::DarkMatter)).unwrap();
        assert_eq!(numbers(&dark, "ParticleIDs"), expected(100..103, 0));
        assert_eq!(numbers(&dark, "Velocities:y"), expected(100..103, 4));
        assert_eq!(numbers(&dark, "Masses"), [DARK; 3]);
        assert_eq!(dark.field_names(), ["Velocities", "ParticleIDs", "Masses"]);

        let stars = read("any", &bytes, &of_type(ParticleType::Stars)).unwrap();
        assert_eq!(numbers(&stars, "Masses"), expected(200..202, 6), "{form:?}");
        let error = read("any", &bytes, &of_type(ParticleType::Disk)).unwrap_err();
        assert!(error.to_string().contains("`PartType4 (stars)`"), "{error}");
    }
}

#[test]
fn files_of_one_snapshot_are_read_together() {
    for form in Form::all() {
        let folder = tempfile::tempdir().unwrap();
        let path = |i: usize| folder.path().join(format!("snap_010.{i}"));
        for (i, counts) in HALVES.iter().enumerate() {
            std::fs::write(path(i), form.snapshot(2, counts)).unwrap();
        }
        for i in 0..2 {
            check_gas(&open(&path(i), &OpenOptions::default()).unwrap());
            // The first file has no dark matter.
            let dark = open(&path(i), &of_type(ParticleType::DarkMatter)).unwrap();
            assert_eq!(numbers(&dark, "ParticleIDs"), expected(100..103, 0));
            let format = format_of(&path(i), &OpenOptions::default()).unwrap();
            let steps = format.time_steps(&path(i)).unwrap();
            assert_eq!((steps.len(), &steps[0].parts[0].path), (1, &path(0)));
        }
        std::fs::remove_file(path(0)).unwrap();
        let error = open(&path(1), &OpenOptions::default()).unwrap_err();
        assert!(error.to_string().contains("no `snap_010.0`"), "{error}");
        std::fs::rename(path(1), folder.path().join("alone")).unwrap();
        let alone = open(&folder.path().join("alone"), &OpenOptions::default()).unwrap();
        assert_eq!(numbers(&alone, "ParticleIDs"), [3.0]);
        assert!(alone.notes[0].contains("2 files; only this one"));
    }
}

#[test]
fn damage_is_said_by_place() {
    let form = Form::all()[0];
    let sound = form.snapshot(1, &SOME);
    let error = |bytes: &[u8]| {
        let error = read("any", bytes, &OpenOptions::default()).unwrap_err();
        error.to_string()
    };
    assert!(error(&sound[..sound.len() - 1]).contains("between two marks"));
    // The header states one more gas particle than there are positions.
    let mut more = sound.clone();
    more[4] += 1;
    assert!(error(&more).contains("record `POS`"), "{}", error(&more));
    assert!(error(&sound[..264]).contains("a record of positions"));
    let mut none = sound;
    none[4..28].fill(0);
    assert!(error(&none).contains("particles"));
}
