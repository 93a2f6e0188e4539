//! Tests temperatures that are derived from internal energies.
//!
//! `fixtures/gas` was written by h5py. The temperatures are those of pynbody 2.8: its `temp` for a mass fraction of hydrogen of .755,
//! scaled by its `mu` for .76, and with its threshold of 10^4 K for SWIFT. Its constants are those of CODATA 2018, too.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::PathBuf;

use ewa_splat::io::{Dataset, FieldSource, OpenOptions, ParticleType, RowFile, open, read};

use crate::support::gadget::{Form, SOME};
use crate::support::numbers;

/// Temperatures with X = .755.
const TEMPERATURES: [f64; 6] = [
    1_399_633.625,
    22_145_420.0,
    8_799.285_156,
    20_219_020.0,
    18_650_958.0,
    908.002_868,
];

/// Temperatures with X = .76.
const PRIMORDIAL: [f64; 6] = [
    1_392_020.039,
    22_044_089.871,
    8_752.847_851,
    20_113_598.516,
    18_558_957.278,
    903.378_971,
];

/// Temperatures of neutral gas below 10^4 K, and of ionised gas above. The third would be above as neutral and below as ionised gas:
/// pynbody takes either by turns, and SWIFT the temperature of the transition.
const OF_TRANSITION: [f64; 6] = [
    1_186_537.813,
    10_686_031.688,
    10_000.0,
    14_309_193.184,
    10_948_415.892,
    1_224.577_155,
];

fn path(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/gas");
    folder.join(name)
}

fn of(name: &str) -> Dataset {
    open(&path(name), &OpenOptions::default()).unwrap()
}

/// Energies, abundances and results have single precision, so that some four roundings of 6e-8 are allowed.
fn agree(data: &Dataset, expected: &[f64]) {
    let found = numbers(data, "temperature");
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let error = f64::from(*found) / expected - 1.0;
        assert!(error.abs() < 2.5e-7, "{found}, not {expected}");
    }
}

#[test]
fn temperatures_are_those_of_pynbody() {
    for (name, expected, note) in [
        (
            "arepo.hdf5",
            TEMPERATURES,
            "first component of `GFM_Metals`",
        ),
        ("gadget4.hdf5", PRIMORDIAL, "X = 0.76"),
        ("halves.0.hdf5", PRIMORDIAL, "gamma 5/3 (not stated)"),
        ("halves.1.hdf5", PRIMORDIAL, "e of `ElectronAbundance`"),
        (
            "swift.hdf5",
            OF_TRANSITION,
            "gamma 1.6667, mu = 1.225, above 10000 K 0.590",
        ),
    ] {
        let data = of(name);
        agree(&data, &expected);
        assert_eq!(data.unit("temperature"), Some("K"));
        let noted: Vec<&String> = data
            .notes
            .iter()
            .filter(|n| n.contains("`temperature`"))
            .collect();
        assert!(
            noted.len() == 1 && noted[0].contains(note),
            "{name}: {noted:?}"
        );
        let field = data.fields.last().unwrap();
        assert_eq!(field.name, "temperature");
        assert!(matches!(field.source, FieldSource::Derived(_)), "{name}");
    }
}

#[test]
fn runs_of_rows_have_temperatures() {
    for name in ["gadget4.hdf5", "halves.1.hdf5"] {
        let mut file = RowFile::open(&path(name), None).unwrap().unwrap();
        let runs = file.runs(2);
        assert!(!runs.is_empty());
        for run in runs {
            let data = file.read(run.clone()).unwrap();
            agree(&data, &PRIMORDIAL[run]);
        }
    }
}

#[test]
fn what_a_file_lacks_is_named() {
    let error = |data: &Dataset| data.scalar("Temperature").unwrap_err().to_string();
    for (name, says) in [
        (
            "no_unit.hdf5",
            "does not state the unit of internal energies or velocities",
        ),
        ("no_electrons.hdf5", "does not state an electron abundance"),
    ] {
        let data = of(name);
        assert!(!data.field_names().contains(&"temperature"));
        assert!(error(&data).contains(says), "{}", error(&data));
    }
    // Binary snapshots state no units.
    let form = Form::all()[0];
    let bytes = form.snapshot(1, &SOME);
    let data = read("a", &bytes, &OpenOptions::default()).unwrap();
    assert!(
        error(&data).contains("the unit of internal energies"),
        "{}",
        error(&data)
    );
    let dark = OpenOptions {
        particle_type: Some(ParticleType::DarkMatter),
        ..OpenOptions::default()
    };
    let data = read("a", &bytes, &dark).unwrap();
    assert!(!error(&data).contains("derived"), "{}", error(&data));
}

/// A stored temperature is not replaced.
#[test]
fn stored_temperatures_stay() {
    let mut data = of("arepo.hdf5");
    let energy = data
        .fields
        .iter()
        .position(|f| f.name == "InternalEnergy")
        .unwrap();
    let unit = data.gas.as_mut().unwrap();
    unit.erg_per_gram = None;
    assert!(
        data.scalar("temperature")
            .unwrap_err()
            .to_string()
            .contains("the unit")
    );
    data.fields.remove(energy);
    data.gas = None;
    assert!(data.scalar("temperature").is_err());
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let stored = open(&folder.join("gadget_types.h5"), &OpenOptions::default()).unwrap();
    assert!(!stored.field_names().contains(&"temperature"));
    assert!(!numbers(&stored, "temperature").is_empty());
}
