//! Tests levels of refinement: AMReX's plotfiles, VTK's XML, and how evenly they are drawn.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, open, read_with};
use ewa_splat::sample::{SampleOptions, volume};
use ewa_splat::scene::{Particles, PointVolume, Strength};
use glam::DVec3;

use crate::common::real_data;
use crate::support::amr::{Files, Level, nested, plotfile, vthb};
use crate::support::numbers;

fn read(files: &Files) -> Result<Dataset, String> {
    let beside = |path: &Path| {
        let found = files.iter().find(|(name, _)| Path::new(name) == path);
        found.map(|(_, bytes)| bytes.clone())
    };
    let (name, bytes) = &files[0];
    read_with(name, bytes, &OpenOptions::default(), &beside).map_err(|e| e.to_string())
}

/// Returns the kernels: positions, standard deviations, volumes.
fn kernels(volume: &PointVolume) -> Vec<(DVec3, f64, f64)> {
    let Strength::Classified { volumes } = &volume.strength else {
        panic!("classified volumes expected")
    };
    let Particles::Anisotropic { positions, factors } = &volume.particles else {
        panic!("ellipsoids expected")
    };
    let shapes = positions.iter().zip(factors).zip(volumes);
    shapes
        .map(|((p, f), v)| (*p, f64::from(f[0]), f64::from(*v)))
        .collect()
}

fn sampled(data: Dataset) -> Vec<(DVec3, f64, f64)> {
    kernels(&volume(data, &SampleOptions::default()).unwrap().volume)
}

/// Returns a cell's value, which encodes its position and level.
fn by_place([x, y, z]: [f64; 3], level: usize) -> f64 {
    x + 10.0 * y + 100.0 * z + 10_000.0 * level as f64
}

#[test]
fn each_place_has_the_finest_cell() {
    let of_file = |files: &Files| read(files).unwrap();
    let levels = nested();
    for data in [
        of_file(&plotfile(&levels, false, 0, &by_place)),
        of_file(&plotfile(&levels, true, 2, &by_place)),
        of_file(&vthb(&levels, false, &by_place)),
        of_file(&vthb(&levels, true, &by_place)),
    ] {
        let Geometry::Curvilinear { blocks } = &data.geometry else {
            panic!("grids expected");
        };
        assert_eq!(blocks.len(), 4);
        assert_eq!(blocks[3].nodes[0], DVec3::new(4.0, 2.0, 2.0));
        let note =
            "Levels of refinement: 2; boxes: 4; cells that lie under finer ones, left out: 64.";
        assert_eq!(data.notes[0], note);
        let rho = numbers(&data, "rho");
        let ghosts = numbers(&data, "vtkGhostType");
        assert_eq!(ghosts.iter().filter(|g| **g == 8.0).count(), 64);
        // A coarse cell that counts has its centre in no fine box.
        let kept = rho.iter().zip(&ghosts).filter(|(_, ghost)| **ghost == 0.0);
        let kept: Vec<f32> = kept.map(|(rho, _)| *rho).collect();
        assert_eq!(kept.len(), 512 - 64 + 512);
        let kernels = sampled(data);
        assert_eq!(kernels.len(), kept.len());
        for ((place, sigma, _), rho) in kernels.iter().zip(kept) {
            let is_fine = (*place - 4.0).abs().max_element() < 2.0;
            let (level, spacing) = if is_fine { (1, 0.5) } else { (0, 1.0) };
            let expected = by_place(place.to_array(), level);
            assert!((f64::from(rho) - expected).abs() < 2e-3, "{place} {rho}");
            assert!(sigma / spacing > 0.599 && *sigma < 0.601, "{place} {sigma}");
        }
        let total: f64 = kernels.iter().map(|(.., v)| v).sum();
        // Volumes are smoothed next to the finer level.
        assert!((total / 512.0 - 1.0).abs() < 0.01, "{total}");
    }
}

#[test]
fn boxes_that_overlap_are_drawn_once() {
    let levels = [Level {
        spacing: 1.0,
        boxes: vec![
            [[0; 3], [4, 7, 7]],
            [[3, 0, 0], [7; 3]],
            [[3, 1, 1], [4, 5, 5]],
        ],
    }];
    let data = read(&plotfile(&levels, false, 0, &by_place)).unwrap();
    assert_eq!(
        data.notes[1],
        "Cells in several boxes of one level, drawn once: 178."
    );
    let total: f64 = sampled(data).iter().map(|(.., v)| v).sum();
    assert!((total / 512.0 - 1.0).abs() < 1e-6, "{total}");
}

#[test]
fn a_plotfile_of_our_own_is_what_vtk_and_yt_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/plt00010");
    let whole = open(&folder, &OpenOptions::default()).unwrap();
    let header = open(&folder.join("Header"), &OpenOptions::default()).unwrap();
    assert_eq!(numbers(&whole, "density"), numbers(&header, "density"));
    let density = numbers(&whole, "density");
    assert_eq!(density[..4], [56.5, 57.5, 66.5, 67.5]);
    // Floats in big-endian order.
    assert_eq!(density[16..20], [29.75, 30.25, 34.75, 35.25]);
    let ghosts = numbers(&whole, "vtkGhostType");
    assert_eq!(ghosts[..8], [0., 8., 0., 8., 0., 0., 0., 0.]);
    assert_eq!(ghosts[8..16], [8., 0., 8., 0., 0., 0., 0., 0.]);
    let seen = density.iter().zip(&ghosts).filter(|(_, g)| **g == 0.0);
    let (count, sum) = seen.fold((0, 0.0), |(n, sum), (x, _)| (n + 1, sum + x));
    assert_eq!((count, sum), (44, 3572.0));
    assert!(whole.notes.contains(&"Time: 0.75.".to_owned()));
}

#[test]
fn a_file_of_chombos_is_read() {
    let Some(path) = real_data("formats/collections/chombo3d/chombo3d.vtm") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    // The coarsest box lies under another one.
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("grids expected");
    };
    assert_eq!(blocks.len(), 15);
    assert_eq!(data.bounds(), Some((DVec3::ZERO, DVec3::splat(8.0))));
    let kernels = sampled(data);
    // 696 of the 4096 cells of the middle level lie under finer ones.
    assert_eq!(kernels.len(), 3400 + 8 * 696);
    let total: f64 = kernels.iter().map(|(.., v)| v).sum();
    assert!((total / 512.0 - 1.0).abs() < 0.01, "{total}");
}

#[test]
fn damaged_plotfiles_are_refused() {
    let sound = || plotfile(&nested(), false, 0, &by_place);
    let with = |file: usize, from: &str, to: &str| {
        let mut files = sound();
        let bytes = &mut files[file].1;
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes());
        let at = at.unwrap();
        bytes.splice(at..at + from.len(), to.bytes());
        read(&files).unwrap_err()
    };
    for (error, place, found) in [
        (with(0, "\nrho\n3\n", "\nrho\n4\n"), "dimensions", "found 4"),
        (with(0, "0\n0\n0 2", "1\n0\n0 2"), "coordinates", "found 1"),
        (
            with(0, "Level_0/Cell", "../0/Cell"),
            "level's files",
            "../0/Cell_H",
        ),
        (with(0, "0.5 0.5 0.5", "0.5 -1 0.5"), "level 1", "-1"),
        (with(1, "(2 0", "(3 0"), "a box", "found"),
        (
            with(1, "D_00000 0", "D_00001 0"),
            "Cell_D_00001",
            "no such file",
        ),
        (with(1, "D_00000 0", "D_00000 9"), "byte 9", "FAB"),
        (with(2, "(64 11 52", "(64 15 48"), "byte 0", "64 15 48"),
        (with(2, "(3,7,7)", "(3,7,6)"), "[3, 7, 7]", "FAB"),
        (with(2, "(3,7,7)", "(3,7,7777777)"), "byte 0", "bytes"),
    ] {
        assert!(error.contains(place) && error.contains(found), "{error}");
    }
}

/// Returns the sum of kernels at a position.
fn density(kernels: &[(DVec3, f64, f64)], at: DVec3) -> f64 {
    let normal = std::f64::consts::TAU.powf(1.5);
    let of = |(p, s, v): &(DVec3, f64, f64)| {
        v * (-0.5 * (at - *p).length_squared() / (s * s)).exp() / (normal * s.powi(3))
    };
    kernels.iter().map(of).sum()
}

#[test]
fn uniform_fields_stay_so_between_boxes_and_levels() {
    // Half of the cube is fine, in boxes of several sizes.
    let levels = || {
        vec![
            Level {
                spacing: 1.0,
                boxes: vec![[[0; 3], [2, 7, 7]], [[3, 0, 0], [7; 3]]],
            },
            Level {
                spacing: 0.5,
                boxes: vec![
                    [[8, 0, 0], [11, 15, 15]],
                    [[12, 0, 0], [15, 7, 15]],
                    [[12, 8, 0], [15; 3]],
                ],
            },
        ]
    };
    let uniform =
        |levels: &[Level]| sampled(read(&plotfile(levels, false, 0, &|_, _| 1.0)).unwrap());
    let kernels = uniform(&levels());
    assert_eq!(kernels.len(), 256 + 2048);
    let total: f64 = kernels.iter().map(|(.., v)| v).sum();
    assert!((total / 512.0 - 1.0).abs() < 0.01, "{total}");
    let off = |kernels: &[(DVec3, f64, f64)], x: [f64; 2]| {
        let mut all = Vec::new();
        for i in 0..40 {
            for [y, z] in [[4.0, 4.0], [4.2, 3.9], [3.6, 4.4]] {
                let x = x[0] + (x[1] - x[0]) * f64::from(i) / 39.0;
                all.push((density(kernels, DVec3::new(x, y, z)) - 1.0).abs());
            }
        }
        let rms = (all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64).sqrt();
        (rms, all.iter().fold(0.0, |a: f64, b| a.max(*b)))
    };
    // The spacing halves at x = 4; boxes end at x = 3 and 6.
    let (rms, greatest) = off(&kernels, [2.0, 6.0]);
    println!("levels {rms:.4} {greatest:.4}");
    assert!(rms < 0.016 && greatest < 0.03, "{rms} {greatest}");
    let boxes = Level {
        spacing: 1.0,
        boxes: vec![
            [[0; 3], [3, 7, 7]],
            [[4, 0, 0], [7, 3, 7]],
            [[4, 4, 0], [7; 3]],
        ],
    };
    let (rms, greatest) = off(&uniform(&[boxes]), [3.0, 5.0]);
    println!("boxes {rms:.4} {greatest:.4}");
    assert!(rms < 0.006 && greatest < 0.01, "{rms} {greatest}");
}
