//! Tests HDF5 snapshots of particles.
//!
//! The fixtures were written with h5py (HDF5 2.0) from the numbers in these tests: five
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
//! | `gadget_types.h5` | the gas, 2 particles of `PartType1` 10 further on, 3 of `PartType4` 20 further on, none of `PartType5` |
//! | `phantom_sinks.h5` | types 1, 7, -1, 3, 9, dust from 7 and its boundary from 9; 3 sinks 1 further on, of radii .5, 0, .25 |
//! | `swift_units.h5` | masses in units of their own, densities and temperatures in cgs, pressures in comoving cgs |
//! | `swift_lossy.h5` | each of SWIFT's lossy filters, chunks of 4 rows, n-bit; half floats without it, integers of 40 bits, scale-offset |
//! | `split/snap_010.0.hdf5` to `.2.hdf5` | 2, 0 and 3 of the particles, dark matter from 10 on; `snap_010.hdf5`: virtual datasets of them |
//! | `swift_unnormalised.h5`, `swift_unnormalised_masses.h5` | temperatures, masses without an implied leading bit of the mantissa |

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::{Path, PathBuf};

use ewa_splat::io::{
    Dataset, FieldSource, Geometry, LengthMeaning, OpenOptions, ParticleType, Smoothing, SphKernel,
    format_of, has_particle_types, open,
};
use ewa_splat::sample::{SampleOptions, volume};
use glam::DVec3;

use crate::support::numbers;

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

fn times(factor: f32) -> Vec<f32> {
    (1..=5).map(|i| i as f32 * factor).collect()
}

fn has_note(data: &Dataset, words: &str) -> bool {
    data.notes.iter().any(|note| note.contains(words))
}

#[test]
fn kernels_beyond_the_faces_of_the_box_are_said() {
    // One of two equal particles lies at .01 of a box of 1.
    let data = read("cases/periodic_one.hdf5");
    assert!(
        has_note(
            &data,
            "50 % of the mass reach beyond the faces of the box (1 x 1 x 1)"
        ),
        "{:?}",
        data.notes
    );
    // The file states no box, or no particle reaches it.
    assert!(!has_note(&read("gadget_old.h5"), "the box"));
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

/// h = 2 σ for each of SWIFT's kernels: σ is exact for all of them.
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
    // A dead particle stays a row; the sampler counts it.
    let sampled = volume(data, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.report.particle_count, 4);
    assert_eq!(sampled.report.left_out_count(), 1);
}

fn read_type(name: &str, particles: ParticleType) -> Result<Dataset, String> {
    let options = OpenOptions {
        particle_type: Some(particles),
        ..OpenOptions::default()
    };
    open(&fixture(name), &options).map_err(|e| e.to_string())
}

/// Returns names and counts, and which types are read.
fn types(data: &Dataset) -> Vec<(String, usize, bool)> {
    let types = data.particle_types.iter();
    types.map(|t| (t.to_string(), t.count, t.is_read)).collect()
}

fn moved(count: usize, by: f64) -> Vec<DVec3> {
    places()[..count].iter().map(|p| *p + by).collect()
}

#[test]
fn a_type_of_a_gadget_snapshot_is_read_by_its_name_or_its_number() {
    let data = read("gadget_types.h5");
    assert_eq!(positions(&data), places());
    let listed = [
        ("PartType0 (gas)", 5, true),
        ("PartType1 (dark-matter)", 2, false),
        ("PartType4 (stars)", 3, false),
        ("PartType5 (black-holes or boundary)", 0, false),
    ];
    assert_eq!(types(&data), listed.map(|(n, c, r)| (n.to_owned(), c, r)));
    assert!(has_note(
        &data,
        "Only PartType0 is shown; PartType1, PartType4 left out."
    ));
    for stars in [ParticleType::Stars, ParticleType::Number(4)] {
        let data = read_type("gadget_types.h5", stars).unwrap();
        assert_eq!(positions(&data), moved(3, 20.0));
        assert_eq!(numbers(&data, "Masses"), [1.0, 2.0, 3.0]);
        assert_eq!(types(&data)[2], ("PartType4 (stars)".to_owned(), 3, true));
        assert!(!types(&data)[0].2 && !has_note(&data, "left out"));
    }
    let data = read_type("gadget_types.h5", ParticleType::DarkMatter).unwrap();
    assert_eq!(positions(&data), moved(2, 10.0));
    assert_eq!(numbers(&data, "Masses"), [2.5; 2]);
    // A group without particles does not count as an available type.
    for absent in [
        ParticleType::BlackHoles,
        ParticleType::Sinks,
        ParticleType::Number(9),
    ] {
        let error = read_type("gadget_types.h5", absent).unwrap_err();
        assert!(
            error.contains(
                "`PartType0 (gas)`, `PartType1 (dark-matter)`, `PartType4 (stars)`, found"
            ),
            "{error}"
        );
        assert!(error.contains(&format!("`{absent}`")), "{error}");
    }
}

#[test]
fn phantoms_types_are_told_apart_by_itype() {
    let all = read("phantom_sinks.h5");
    assert_eq!(positions(&all), places());
    assert_eq!(numbers(&all, "m"), [0.5, 0.125, 0.5, 0.25, 0.0625]);
    assert!(has_note(&all, "4 types") && has_note(&all, "Sink particles are left out"));
    let listed = [
        ("itype 1 (gas)", 2, true),
        ("itype 3 (boundary)", 1, true),
        ("itype 7 (dust)", 1, true),
        ("itype 9 (boundary)", 1, true),
        ("sinks", 3, false),
    ];
    assert_eq!(types(&all), listed.map(|(n, c, r)| (n.to_owned(), c, r)));
    for (wanted, rows) in [
        (ParticleType::Gas, &[0, 2][..]),
        (ParticleType::Number(1), &[0, 2]),
        (ParticleType::Dust, &[1]),
        (ParticleType::Boundary, &[3, 4]),
        (ParticleType::Number(3), &[3]),
    ] {
        let data = read_type("phantom_sinks.h5", wanted).unwrap();
        let of_rows: Vec<DVec3> = rows.iter().map(|&i| places()[i]).collect();
        assert_eq!(positions(&data), of_rows, "{wanted}");
        for field in ["h", "m", "rho", "itype", "vxyz:y", "vxyz"] {
            let whole = numbers(&all, field);
            let of_rows: Vec<f32> = rows.iter().map(|&i| whole[i]).collect();
            assert_eq!(numbers(&data, field), of_rows, "{wanted}, {field}");
        }
        assert!(data.smoothing.is_some() && !has_note(&data, "left out"));
    }
    let error = read_type("phantom_sinks.h5", ParticleType::Stars).unwrap_err();
    assert!(
        error.contains("`itype 1 (gas)`") && error.contains("`sinks`, found `stars`"),
        "{error}"
    );
    let error = read_type("phantom.h5", ParticleType::Sinks).unwrap_err();
    assert!(
        error.contains("one of `itype 1 (gas)`, `itype 2`, found `sinks`"),
        "{error}"
    );
}

/// A ball of radius R has the variance R²/5 along each axis. A particle without a radius gets a
/// hundredth of the box, which is 4 wide.
#[test]
fn sinks_are_opaque_spheres_of_their_accretion_radii() {
    let data = read_type("phantom_sinks.h5", ParticleType::Sinks).unwrap();
    assert_eq!(positions(&data), moved(3, 1.0));
    assert_eq!(numbers(&data, "m"), [3.0, 2.0, 1.0]);
    assert_eq!(numbers(&data, "accretion_radius"), [0.5, 0.0, 0.25]);
    let sigma = [0.5_f32, 0.04, 0.25].map(|r| r / 5.0_f32.sqrt());
    for (found, expected) in numbers(&data, "sigma").into_iter().zip(sigma) {
        assert!((found - expected).abs() < 1e-7, "{found} {expected}");
    }
    assert!(has_note(&data, "1 sinks state no accretion radius"));
    let sampled = volume(data, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.report.particle_count, 3);
    // The greatest optical depth of each corresponds to its opacity: strength over 2 pi sigma².
    let ewa_splat::scene::Strength::Mass(strengths) = &sampled.volume.strength else {
        panic!("strengths of their own expected");
    };
    for (strength, sigma) in strengths.iter().zip(sigma) {
        let depth = strength / (std::f32::consts::TAU * sigma * sigma);
        assert!((1.0 - (-depth).exp() - 0.999).abs() < 1e-5, "{depth}");
    }
}

#[test]
fn a_type_of_particles_is_refused_of_what_has_none() {
    let error = read_type("particles.csv", ParticleType::Gas).unwrap_err();
    assert!(error.contains("expected a snapshot"), "{error}");
    assert!(error.contains("leave the type of particles out"), "{error}");
    assert!(!has_particle_types(&fixture("particles.csv")).unwrap());
    assert!(has_particle_types(&fixture("phantom.h5")).unwrap());
}

/// Units are strings of fixed or variable length, under three names. Text that is no unit is
/// ignored.
#[test]
fn units_that_attributes_state_are_kept() {
    let data = read("gadget_types.h5");
    for (field, unit) in [
        ("Density", Some("g/cm^3")),
        ("Masses", Some("Msun")),
        ("SmoothingLength", None),
        ("Temperature", None),
        ("Metallicity", None),
    ] {
        assert_eq!(data.unit(field), unit, "{field}");
    }
    let stars = read_type("gadget_types.h5", ParticleType::Stars).unwrap();
    assert_eq!(stars.unit("age"), Some("Gyr"));
    let options = SampleOptions {
        field: Some("age".into()),
        ..SampleOptions::default()
    };
    let sampled = volume(stars, &options).unwrap();
    assert_eq!(sampled.report.unit.as_deref(), Some("Gyr"));
    let sampled = volume(data, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.report.field.as_deref(), Some("Density"));
    assert_eq!(sampled.report.unit.as_deref(), Some("g/cm^3"));
}

/// SWIFT states the unit after a conversion. It applies to the numbers only if the conversion is
/// trivial.
#[test]
fn swifts_units_are_those_of_the_numbers_or_none() {
    let data = read("swift_units.h5");
    for (field, unit) in [
        ("Masses", None),
        ("Densities", Some("g cm^-3")),
        ("Pressures", None),
        ("Temperatures", Some("K")),
        ("SmoothingLengths", None),
        ("sigma", None),
        ("MetalMassFractions", None),
    ] {
        assert_eq!(data.unit(field), unit, "{field}");
    }
}

#[test]
fn hdf5_without_particles_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let bytes = std::fs::read(fixture("dark_matter.h5")).unwrap();
    // Names in the newest layout are protected by a checksum, so the old layout is renamed.
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

/// A few hundred bytes can declare gigabytes: an array without chunks consists of fill values.
#[test]
fn declared_sizes_beyond_reason_are_refused() {
    let mut bytes = std::fs::read(fixture("gadget_old_packed.h5")).unwrap();
    // The dataspace of `Coordinates` is 5 x 3, at most 5 x 3.
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

/// Values that libhdf5 2.0 reads from each file (through h5py, as doubles), among them a subnormal
/// number, the greatest one and infinities.
#[test]
fn swifts_lossy_floats_have_the_values_that_libhdf5_reads() {
    let data = read("swift_lossy.h5");
    assert_eq!(positions(&data), places());
    assert_eq!(numbers(&data, "SmoothingLengths"), times(0.25));
    assert_eq!(numbers(&data, "Masses"), times(2.0));
    assert_eq!(numbers(&data, "Densities"), times(8.0));
    let infinite = f64::INFINITY;
    let nine = [
        0.33349609375,
        -2.341805152028776e-39,
        3.0007322004844476e+38,
        0.0,
        -2.5,
    ];
    let half = [
        0.333251953125,
        -5.960464477539063e-08,
        65504.0,
        infinite,
        -2.5,
    ];
    for (field, values) in [
        ("FMantissa9", nine),
        ("BigEndian9", nine),
        (
            "FMantissa13",
            [
                0.333343505859375,
                -2.3403702224013073e-39,
                2.999901432987082e+38,
                0.0,
                -2.5,
            ],
        ),
        (
            "BFloat16",
            [
                0.333984375,
                -2.2958874039497803e-39,
                3.00405527047391e+38,
                0.0,
                -2.5,
            ],
        ),
        ("HalfFloat", half),
        ("Float16", half),
        (
            "DMantissa9",
            [
                0.33349609375,
                -9.999428271258529e-31,
                1.0002555517425873e+30,
                -infinite,
                -2.5,
            ],
        ),
        (
            "DMantissa13",
            [
                0.333343505859375,
                -1.0000391236230722e-30,
                1.0000234379852213e+30,
                -infinite,
                -2.5,
            ],
        ),
        (
            "DMantissa21",
            [
                0.3333333730697632,
                -1.0000000031710769e-30,
                9.999998639317388e+29,
                -infinite,
                -2.5,
            ],
        ),
        ("Nbit40", [1.0, -2.0, 3221225472.0, -549755813888.0, 0.0]),
        ("DScale2", [1.25, -3.5, 0.0, 100.01, 7.0]),
    ] {
        assert_eq!(numbers(&data, field), values.map(|x| x as f32), "{field}");
    }
}

#[test]
fn numbers_of_an_unknown_layout_are_never_shown() {
    let data = read("swift_unnormalised.h5");
    assert!(data.scalar("Temperatures").is_err());
    assert!(has_note(&data, "`Temperatures`, floats of 4 bytes") && has_note(&data, "swiftsimio"));
    // The same filter on masses is an error: without masses, the picture would mean something else.
    let masses = fixture("swift_unnormalised_masses.h5");
    let error = open(&masses, &OpenOptions::default()).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("dataset `PartType0/Masses`") && error.contains("leading bit"),
        "{error}"
    );
    assert!(error.contains("write it as 32-bit floats"), "{error}");
}

#[test]
fn any_file_of_a_snapshot_in_several_stands_for_all() {
    for name in ["snap_010.0", "snap_010.1", "snap_010.2", "snap_010"] {
        let path = fixture(&format!("split/{name}.hdf5"));
        let data = open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(positions(&data), places(), "{name}");
        assert_eq!(numbers(&data, "Masses"), times(2.0));
        assert_eq!(numbers(&data, "SmoothingLength"), times(0.25));
        assert_eq!(data.path, path);
        let counts: Vec<_> = data
            .particle_types
            .iter()
            .map(|t| (t.count, t.is_read))
            .collect();
        assert_eq!(counts, [(5, true), (5, false)]);
        assert_eq!(data.notes[0], "Files of the snapshot put together: 3.");
        assert!(
            has_note(&data, "not all pieces have them alike: `Odd`"),
            "{:?}",
            data.notes
        );
        assert!(!has_note(&data, "only this one"));
        let options = OpenOptions {
            particle_type: Some(ParticleType::DarkMatter),
            ..OpenOptions::default()
        };
        let dark = open(&path, &options).unwrap();
        let x: Vec<f64> = positions(&dark).iter().map(|p| p.x).collect();
        assert_eq!(x, [10., 11., 12., 13., 14.]);
        let options = OpenOptions {
            particle_type: Some(ParticleType::Stars),
            ..OpenOptions::default()
        };
        let error = open(&path, &options).unwrap_err().to_string();
        assert!(
            error.contains("PartType1") && error.contains("stars"),
            "{error}"
        );
        // All files form one input.
        let format = format_of(&path, &OpenOptions::default()).unwrap();
        let steps = format.time_steps(&path).unwrap();
        assert_eq!(steps.len(), 1);
        assert_eq!(steps[0].parts[0].path, fixture("split/snap_010.0.hdf5"));
    }
}

#[test]
fn missing_files_of_a_snapshot_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let last = folder.path().join("snap_010.2.hdf5");
    std::fs::copy(fixture("split/snap_010.2.hdf5"), &last).unwrap();
    let error = open(&last, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("snap_010.0.hdf5") && error.contains("snap_010.1.hdf5"),
        "{error}"
    );
    assert!(error.contains("3 files"), "{error}");
    // Under a name without a number, the file stands alone.
    let alone = folder.path().join("last.hdf5");
    std::fs::rename(&last, &alone).unwrap();
    let data = open(&alone, &OpenOptions::default()).unwrap();
    assert_eq!(positions(&data), &places()[2..]);
    assert!(has_note(
        &data,
        "consists of 3 files; only this one is read"
    ));
    // A virtual file needs the files that it names; pieces may be in a folder of its name.
    let whole = folder.path().join("snap_010.hdf5");
    std::fs::copy(fixture("split/snap_010.hdf5"), &whole).unwrap();
    let error = open(&whole, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("`snap_010.0.hdf5`"), "{error}");
    let below = folder.path().join("snap_010");
    std::fs::create_dir(&below).unwrap();
    for i in 0..3 {
        let name = format!("snap_010.{i}.hdf5");
        std::fs::copy(fixture(&format!("split/{name}")), below.join(&name)).unwrap();
    }
    let data = open(&whole, &OpenOptions::default()).unwrap();
    assert_eq!(positions(&data), places());
}
