//! Tests tipsy snapshots. `fixtures/snapshot.tipsy` was written by pynbody 2.8: four of gas, three of dark matter, two stars.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{
    Geometry, OpenOptions, ParticleType, format_of, has_particle_types, open, read,
};

use crate::support::{numbers, of_type};

const FILE: &[u8] = include_bytes!("../../fixtures/snapshot.tipsy");
const HEADER: usize = 32;

/// Returns the file in the other byte order, with or without padding.
fn little_endian(has_padding: bool) -> Vec<u8> {
    let mut bytes = FILE[..8].iter().rev().copied().collect::<Vec<u8>>();
    let words = FILE[8..].chunks_exact(4);
    bytes.extend(words.flat_map(|word| word.iter().rev().copied()));
    if !has_padding {
        bytes.drain(HEADER - 4..HEADER);
    }
    bytes
}

/// The numbers that pynbody was given.
#[test]
fn particles_of_each_kind_are_those_that_pynbody_wrote() {
    for bytes in [FILE.to_vec(), little_endian(true), little_endian(false)] {
        let gas = read("any", &bytes, &OpenOptions::default()).unwrap();
        assert_eq!(numbers(&gas, "Density"), [8.423, 5.419, 2.444, 8.072]);
        assert_eq!(
            numbers(&gas, "Temperature"),
            [67741.0, 61272.0, 43866.0, 46986.0]
        );
        assert_eq!(numbers(&gas, "Softening"), [0.666, 0.563, 0.547, 0.323]);
        assert_eq!(numbers(&gas, "Metals"), [0.01, 0.02, 0.03, 0.04]);
        assert_eq!(numbers(&gas, "Potential"), [-0.111, -0.273, -0.723, -0.281]);
        assert_eq!(
            gas.notes[0],
            "Only gas is shown; dark-matter, stars left out."
        );
        let smoothing = gas.smoothing.as_ref().unwrap();
        assert_eq!(smoothing.length, None);
        assert_eq!(smoothing.mass.as_deref(), Some("Masses"));
        assert_eq!(smoothing.density.as_deref(), Some("Density"));

        let dark = read("any", &bytes, &of_type(ParticleType::DarkMatter)).unwrap();
        let Geometry::Points { positions } = &dark.geometry else {
            panic!("particles expected");
        };
        assert_eq!(positions[2].as_vec3().to_array(), [0.064, -1.225, 0.076]);
        assert_eq!(numbers(&dark, "Softening"), [0.442, 0.981, 0.631]);
        let names = ["Masses", "Velocities", "Softening", "Potential"];
        assert_eq!(dark.field_names(), names);

        let stars = read("any", &bytes, &of_type(ParticleType::Number(2))).unwrap();
        assert_eq!(numbers(&stars, "Masses"), [0.861, 0.95]);
        assert_eq!(numbers(&stars, "FormationTime"), [3.0, 4.0]);
        let error = read("any", &bytes, &of_type(ParticleType::Disk)).unwrap_err();
        assert!(error.to_string().contains("stars"), "{error}");
    }
}

#[test]
fn files_are_known_by_their_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cosmo.00128");
    std::fs::write(&path, FILE).unwrap();
    let options = OpenOptions::default();
    assert_eq!(format_of(&path, &options).unwrap().name, "tipsy snapshots");
    assert!(has_particle_types(&path).unwrap());
    assert_eq!(numbers(&open(&path, &options).unwrap(), "Masses").len(), 4);
    for len in 1..FILE.len() {
        let error = read("a.tipsy", &FILE[..len], &options).unwrap_err();
        assert!(
            error.to_string().contains("copy it again"),
            "{len}: {error}"
        );
    }
    // Counts that add up to more than the file has are no reason to allocate.
    let mut large = FILE.to_vec();
    large[8..12].copy_from_slice(&(u32::MAX - 4).to_be_bytes());
    large[16..20].copy_from_slice(&(u32::MAX - 9).to_be_bytes());
    let error = read("a.tipsy", &large, &options).unwrap_err();
    assert!(
        error.to_string().contains("4294967286 gas particles"),
        "{error}"
    );
}
