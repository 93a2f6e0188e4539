//! HDF5 snapshots of particles.
//!
//! The fixtures were written with h5py (HDF5 2.0) from the numbers that stand here: five
//! particles at (i, i²/4, -i/8), lengths (i + 1)/4, masses 2 (i + 1), densities 8 (i + 1).
//!
//! | fixture | layout |
//! |---|---|
//! | `gadget_old.h5` | superblock 0, symbol tables, contiguous, little-endian |
//! | `gadget_old_packed.h5` | ... chunks of 2 rows, indexed by a version 1 B-tree, shuffled, gzip |
//! | `gadget_big_endian.h5` | newest layout, big-endian, chunks shuffled, gzip, Fletcher 32; masses in `MassTable` |
//! | `swift.h5` | newest layout, chunks of extensible arrays, gzip |
//! | `dark_matter.h5` | newest layout, `PartType1` only, single precision |
//! | `phantom.h5` | h5py's default layout, shuffled, gzip, Fletcher 32; lengths .25, .5, 1, -.5, 2 |

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::{Path, PathBuf};

use ewa_splat::io::{
    Dataset, FieldSource, Geometry, LengthMeaning, OpenOptions, Smoothing, SphKernel, open,
};
use ewa_splat::sample::{SampleOptions, volume};
use glam::DVec3;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name)
}

fn read(name: &str) -> Dataset {
    open(&fixture(name), &OpenOptions::default()).unwrap()
}

fn positions(data: &Dataset) -> &[DVec3] {
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    positions
}

fn places() -> Vec<DVec3> {
    let at = |i: f64| DVec3::new(i, i * i / 4.0, -i / 8.0);
    (0..5).map(f64::from).map(at).collect()
}

fn numbers(data: &Dataset, field: &str) -> Vec<f32> {
    let (_, values) = data.scalar(field).unwrap();
    (0..values.len()).map(|i| values.get(i)).collect()
}

fn times(factor: f32) -> Vec<f32> {
    (1..=5).map(|i| i as f32 * factor).collect()
}

fn has_note(data: &Dataset, words: &str) -> bool {
    data.notes.iter().any(|note| note.contains(words))
}

#[test]
fn gadget_snapshots_in_every_layout() {
    for name in [
        "gadget_old.h5",
        "gadget_old_packed.h5",
        "gadget_big_endian.h5",
    ] {
        let data = read(name);
        let in_table = name == "gadget_big_endian.h5";
        assert_eq!(positions(&data), places(), "{name}");
        assert_eq!(numbers(&data, "SmoothingLength"), times(0.25), "{name}");
        assert_eq!(numbers(&data, "Density"), times(8.0));
        let masses = if in_table { vec![0.5; 5] } else { times(2.0) };
        assert_eq!(numbers(&data, "Masses"), masses);
        assert_eq!(
            numbers(&data, "Velocities:y"),
            [10.0, 11.0, 12.0, 13.0, 14.0]
        );
        assert_eq!(numbers(&data, "ParticleIDs")[4], 104.0);
        assert_eq!(
            data.smoothing,
            Some(Smoothing {
                length: Some("SmoothingLength".into()),
                meaning: LengthMeaning::Support,
                kernel: SphKernel::CubicSpline,
                mass: Some("Masses".into()),
                density: Some("Density".into()),
            })
        );
        assert!(has_note(
            &data,
            "Only PartType0 is shown; PartType1 left out"
        ));
        assert!(has_note(&data, "The unit of length is 3.085678e21 cm"));
        assert_eq!(has_note(&data, "2 files"), in_table);
        assert_eq!(has_note(&data, "MassTable"), in_table);
    }
}

/// h = 2 σ for each of SWIFT's kernels: σ is exact whichever kernel it is.
#[test]
fn swift_lengths_become_standard_deviations() {
    let data = read("swift.h5");
    assert_eq!(positions(&data), places());
    assert_eq!(numbers(&data, "SmoothingLengths"), times(0.25));
    assert_eq!(numbers(&data, "sigma"), times(0.125));
    assert_eq!(
        data.smoothing,
        Some(Smoothing {
            length: Some("sigma".into()),
            meaning: LengthMeaning::Sigma,
            kernel: SphKernel::QuarticSpline,
            mass: Some("Masses".into()),
            density: Some("Densities".into()),
        })
    );
    assert!(has_note(&data, "two standard deviations"));
    assert!(has_note(&data, "3.0857e24 cm"));
}

#[test]
fn dark_matter_has_masses_and_no_lengths() {
    let data = read("dark_matter.h5");
    assert_eq!(positions(&data), places());
    assert_eq!(numbers(&data, "Masses"), [2.5; 5]);
    let smoothing = data.smoothing.as_ref().unwrap();
    assert_eq!(smoothing.length, None);
    assert_eq!(smoothing.mass.as_deref(), Some("Masses"));
    assert!(has_note(&data, "No smoothing lengths"));
}

#[test]
fn phantom_densities_follow_from_lengths_and_types() {
    let data = read("phantom.h5");
    assert_eq!(positions(&data), places());
    assert_eq!(numbers(&data, "m"), [0.5, 0.5, 0.25, 0.5, 0.5]);
    let lengths = [0.25_f64, 0.5, 1.0, 0.5, 2.0];
    let masses = [0.5, 0.5, 0.25, 0.5, 0.5];
    for i in 0..5 {
        let rho = masses[i] * (1.2 / lengths[i]).powi(3);
        assert_eq!(numbers(&data, "rho")[i], rho as f32);
    }
    let velocities = data.fields.iter().find(|f| f.name == "vxyz").unwrap();
    assert!(matches!(&velocities.source, FieldSource::Vector(v) if v.len() == 3));
    let smoothing = data.smoothing.as_ref().unwrap();
    assert_eq!(smoothing.length.as_deref(), Some("h"));
    assert_eq!(smoothing.meaning, LengthMeaning::SmoothingLength);
    assert!(has_note(&data, "1 particles are dead"));
    assert!(has_note(&data, "2 types"));
    assert!(has_note(&data, "Left out") && has_note(&data, "`label`"));
    // The dead particle stays a row; the sampler counts it.
    let sampled = volume(data, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.report.particle_count, 4);
    assert_eq!(sampled.report.left_out_count(), 1);
}

#[test]
fn hdf5_without_particles_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let bytes = std::fs::read(fixture("dark_matter.h5")).unwrap();
    // Names in the newest layout are under a checksum, so rename in the old one.
    let mut old = std::fs::read(fixture("gadget_old.h5")).unwrap();
    for at in 0..old.len() - 8 {
        if &old[at..at + 8] == b"PartType" {
            old[at..at + 8].copy_from_slice(b"CellType");
        }
    }
    let refuse = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        open(&path, &OpenOptions::default())
            .unwrap_err()
            .to_string()
    };
    let error = refuse(&old);
    assert!(error.contains("`PartType0/Coordinates`"), "{error}");
    let error = refuse(&bytes[..bytes.len() - 40]);
    assert!(error.contains("expected sound HDF5"), "{error}");
    let error = refuse(&bytes[..8]);
    assert!(error.contains("expected sound HDF5"), "{error}");
}

/// A few hundred bytes can declare gigabytes: an array without chunks reads as fill values.
#[test]
fn declared_sizes_beyond_reason_are_refused() {
    let mut bytes = std::fs::read(fixture("gadget_old_packed.h5")).unwrap();
    // The dataspace of `Coordinates`: 5 x 3, at most 5 x 3.
    let extent: Vec<u8> = [5_u64, 3].iter().flat_map(|n| n.to_le_bytes()).collect();
    let at: Vec<usize> = (0..bytes.len() - 16)
        .filter(|&at| bytes[at..at + 16] == extent[..])
        .collect();
    assert!(!at.is_empty());
    for at in at {
        bytes[at..at + 8].copy_from_slice(&(1_u64 << 33).to_le_bytes());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    std::fs::write(&path, bytes).unwrap();
    let error = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("32 times the file's bytes"), "{error}");
}
