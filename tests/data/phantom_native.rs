//! Tests Phantom's native dumps. Those in `fixtures/phantom` hold the same particles, and sarracen 1.4 reads all of them alike:
//!
//! | file | contents |
//! |---|---|
//! | `sarracen` | as `sarracen.write_phantom` writes it |
//! | `two_processes` | big-endian, reals of 4 bytes, in blocks of two processes |
//! | `long_integers` | integers of 8 bytes |
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{
    Dataset, Geometry, LengthMeaning, OpenOptions, ParticleType, format_of, has_particle_types,
    open, read,
};

use crate::support::{numbers, of_type};

const FILES: [&str; 3] = ["sarracen", "two_processes", "long_integers"];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/phantom")
        .join(name)
}

fn positions(data: &Dataset) -> Vec<[f32; 3]> {
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    let positions = positions.iter();
    positions.map(|p| p.as_vec3().to_array()).collect()
}

/// The numbers that sarracen was given.
#[test]
fn particles_are_those_that_sarracen_reads() {
    for file in FILES {
        let path = fixture(file);
        let options = OpenOptions::default();
        assert_eq!(
            format_of(&path, &options).unwrap().name,
            "Phantom's native dumps"
        );
        assert!(has_particle_types(&path).unwrap());
        let data = open(&path, &options).unwrap();
        assert_eq!(positions(&data)[1], [-2.556, -0.232, -0.668], "{file}");
        assert_eq!(positions(&data)[5], [-0.216, -0.353, -0.239], "{file}");
        assert_eq!(numbers(&data, "h"), [0.5, 0.25, 0.75, 0.125, -0.5, 1.0]);
        assert_eq!(numbers(&data, "m"), [0.5, 0.5, 0.5, 0.25, 0.5, 0.25]);
        assert_eq!(numbers(&data, "itype"), [1.0, 1.0, 1.0, 7.0, 1.0, 7.0]);
        let us = [1.742, 1.722, 1.219, 1.83, 1.658, 1.683];
        assert_eq!(numbers(&data, "u"), us);
        let velocities = [-0.183, 0.541, 1.935, -0.27, -0.244, 1.002];
        assert_eq!(numbers(&data, "vxyz:y"), velocities, "{file}");
        if file == "two_processes" {
            let grains = ["dustfrac", "dustfrac_2"].map(|name| numbers(&data, name)[4]);
            assert_eq!(grains, [0.5, 0.05]);
        }
        // m (hfact / h)³
        let density = f64::from(numbers(&data, "rho")[0]);
        assert!((density - 0.5 * 2.4_f64.powi(3)).abs() < 1e-5, "{density}");
        let smoothing = data.smoothing.as_ref().unwrap();
        assert_eq!(smoothing.length.as_deref(), Some("h"));
        assert_eq!(smoothing.meaning, LengthMeaning::SmoothingLength);
        let notes = data.notes.join(" ");
        for part in [
            "1 particles are dead",
            "2 types",
            "Sink particles",
            "1e13 cm",
        ] {
            assert!(notes.contains(part), "{file}: {notes}");
        }

        let dust = open(&path, &of_type(ParticleType::Dust)).unwrap();
        assert_eq!(numbers(&dust, "h"), [0.125, 1.0], "{file}");
        let sinks = open(&path, &of_type(ParticleType::Sinks)).unwrap();
        assert_eq!(positions(&sinks), [[1.0, 0.0, 0.25], [2.0, 0.5, 0.75]]);
        assert_eq!(numbers(&sinks, "accretion_radius"), [0.1, 0.2], "{file}");
        assert_eq!(numbers(&sinks, "m"), [3.0, 4.0], "{file}");
        let error = open(&path, &of_type(ParticleType::Stars)).unwrap_err();
        assert!(error.to_string().contains("itype 7"), "{error}");
    }
}

#[test]
fn damaged_dumps_are_errors() {
    let sound = std::fs::read(fixture("two_processes")).unwrap();
    let options = OpenOptions::default();
    for len in 1..sound.len() {
        assert!(read("dump", &sound[..len], &options).is_err(), "{len}");
    }
    let refused = |damage: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = sound.clone();
        damage(&mut bytes);
        read("dump", &bytes, &options).unwrap_err().to_string()
    };
    // Behind the first record of 20 bytes comes the identity, whose second letter is the `T`.
    let untagged = refused(&|bytes| bytes[28 + 4 + 1] = b':');
    assert!(untagged.contains("names its arrays"), "{untagged}");
    // The first count of the header, as large as it can be, and negative.
    let first = 28 + 108 + 4;
    let large = refused(&|bytes| bytes[first..first + 4].copy_from_slice(&[0x7f, 255, 255, 255]));
    assert!(large.contains("names"), "{large}");
    let negative = refused(&|bytes| bytes[first] = 255);
    assert!(negative.contains("a count of numbers"), "{negative}");
    // A record of more than 2 GiB is written in parts, whose marks are negative.
    let part = refused(&|bytes| bytes[28] = 255);
    assert!(part.contains("2 GiB"), "{part}");
}
