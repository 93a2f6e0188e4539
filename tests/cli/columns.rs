//! Tests pictures of column densities, and means along rays.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use crate::commands::{run, text};
use ewa_splat::io::read_image;

fn draw(folder: &Path, words: &[&str]) -> String {
    let all = [
        &[
            "render",
            "p.csv",
            "--column-density",
            "--size",
            "33x33",
            "--backend",
            "cpu",
        ],
        words,
    ]
    .concat();
    let output = run(folder, &all);
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stderr)
}

/// Reads the numbers of a one-channel `.npy` of 33 x 33.
fn numbers(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let body = &bytes[bytes.len() - 4 * 33 * 33..];
    body.chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

#[test]
fn a_mean_along_a_ray_is_weighed_by_mass() {
    let folder = tempfile::tempdir().unwrap();
    let write = |rows: &str| std::fs::write(folder.path().join("p.csv"), rows).unwrap();
    let middle = |words: &[&str]| {
        draw(
            folder.path(),
            &[
                words,
                &["--azimuth", "0", "--elevation", "0", "--out", "m.npy"],
            ]
            .concat(),
        );
        numbers(&folder.path().join("m.npy"))
    };
    // Two particles of equal shape, one behind the other: masses of 3 and 1, fields of 10 and 50.
    write("x,y,z,h,m,rho,t\n0,0,0,1,3,3,10\n0,4,0,1,1,1,50\n");
    let mean = middle(&["--column-mean", "t"]);
    assert!(
        (mean[16 * 33 + 16] - 20.0).abs() < 0.01,
        "{}",
        mean[16 * 33 + 16]
    );
    // The mean of a constant field is its value where any kernel is, and undefined elsewhere.
    write("x,y,z,h,m,rho,t\n0,0,0,1,3,3,7\n5,0,1,1,1,1,7\n");
    let mean = middle(&["--column-mean", "t", "--zoom", "0.3"]);
    let known: Vec<f32> = mean.iter().copied().filter(|v| !v.is_nan()).collect();
    assert!(!known.is_empty() && known.len() < mean.len());
    assert!(known.iter().all(|v| (v - 7.0).abs() < 1e-4), "{known:?}");
    let refused = run(
        folder.path(),
        &[
            "render",
            "p.csv",
            "--column-density",
            "--column-mean",
            "none",
            "--out",
            "m.npy",
        ],
    );
    assert_eq!(refused.status.code(), Some(1));
}

#[test]
fn means_are_weighed_by_masses_and_never_by_signed_fields() {
    let folder = tempfile::tempdir().unwrap();
    let write = |text: &str| std::fs::write(folder.path().join("p.csv"), text).unwrap();
    let words = ["--azimuth", "0", "--elevation", "0", "--out", "m.npy"];
    let middle = |more: &[&str]| {
        draw(folder.path(), &[more, &words[..]].concat());
        numbers(&folder.path().join("m.npy"))[16 * 33 + 16]
    };
    // Equal masses, and a temperature that would outweigh one of them.
    for header in ["x,y,z,h,m,rho,t,v", "x,y,z,h,m,density,t,v"] {
        write(&format!("{header}\n0,0,0,1,1,1,1,1\n0,0,0,1,1,1,1e6,-1\n"));
        let mean = middle(&["--column-mean", "v"]);
        assert!(mean.abs() < 1e-5, "{header}: {mean}");
        let mean = middle(&["--field", "t", "--column-mean", "v"]);
        assert!((mean + 1.0).abs() < 1e-3, "{header}: {mean}");
    }
    // Without masses, each particle counts once. Stated strengths are the weights.
    write("x,y,z,h,t,v\n0,0,0,1,1,1\n0,0,0,1,1e6,-1\n");
    let mean = middle(&["--column-mean", "v"]);
    assert!(mean.abs() < 1e-5, "{mean}");
    write("x,y,z,h,mass,v\n0,0,0,1,3,1\n0,0,0,1,1,-1\n");
    let mean = middle(&["--column-mean", "v"]);
    assert!((mean - 0.5).abs() < 1e-5, "{mean}");
    let command = "render p.csv --column-density --field v --column-mean mass --out m.npy";
    let refused = run(folder.path(), &command.split(' ').collect::<Vec<_>>());
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(
        said.contains("weights: expected values from 0 up"),
        "{said}"
    );
}

#[test]
fn means_are_round_about_lone_particles() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("p.csv"),
        "x,y,z,h,m,rho,t\n0,0,0,1,1,1,7\n",
    )
    .unwrap();
    let words = ["--column-mean", "t", "--zoom", "0.25", "--out", "m.npy"];
    draw(folder.path(), &words);
    let mean = numbers(&folder.path().join("m.npy"));
    let reach: Vec<f64> = (0..33 * 33)
        .filter(|i| !mean[*i].is_nan())
        .map(|i| (i % 33) as f64 - 16.0)
        .collect();
    let radius = reach.iter().copied().fold(0.0, f64::max);
    assert!(radius > 3.0 && radius < 16.0, "{radius}");
    for (i, mean) in mean.iter().enumerate() {
        let from = ((i % 33) as f64 - 16.0).hypot((i / 33) as f64 - 16.0);
        match mean.is_nan() {
            true => assert!(from > radius - 1.0, "{from} {radius}"),
            false => assert!(from < radius + 1.0, "{from} {radius}"),
        }
    }
}

#[test]
fn a_picture_of_columns_takes_a_map_a_range_and_a_scale() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("p.csv"),
        "x,y,z,h,m,rho\n0,0,0,1,3,3\n1,0,1,1,1,1\n",
    )
    .unwrap();
    let said = draw(folder.path(), &["--out", "a.png"]);
    assert!(said.contains("viridis over log10 of"), "{said}");
    let words = [
        "--transfer-function",
        "grayscale",
        "--range",
        "0,100",
        "--scale",
        "linear",
    ];
    let said = draw(folder.path(), &[&words[..], &["--out", "b.png"]].concat());
    assert!(
        said.contains("grayscale over the") && said.contains("from 0e0 to 1e2"),
        "{said}"
    );
    let picture = read_image(&folder.path().join("b.png")).unwrap();
    assert!(
        picture.pixels[0]
            .iter()
            .take(3)
            .all(|c| (c - picture.pixels[0][0]).abs() < 1e-6)
    );
}

#[test]
fn sums_beyond_single_precision_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(
        folder.join("p.csv"),
        "x,y,z,h,m\n0,0,0,1,2e39\n1,0,0,1,2e39\n",
    )
    .unwrap();
    let words = ["render", "p.csv", "--column-density", "--out", "m.png"];
    let output = run(folder, &words);
    assert!(!output.status.success());
    let said = text(&output.stderr);
    assert!(said.contains("single precision"), "{said}");
}
