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
    numbers_of(path, 33 * 33)
}

/// Reads the numbers of a one-channel `.npy`, row by row from the top.
fn numbers_of(path: &Path, count: usize) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let body = &bytes[bytes.len() - 4 * count..];
    let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    body.chunks_exact(4).map(number).collect()
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
    // The mean of the masses themselves is that of their column, not of a density.
    write("x,y,z,h,m,density,v\n0,0,0,1,3,1,1\n0,0,0,1,1,7,-1\n");
    let mean = middle(&["--column-mean", "m"]);
    assert!((mean - 2.5).abs() < 1e-5, "{mean}");
    write("x,y,z,h,mass,v\n0,0,0,1,3,1\n0,0,0,1,1,-1\n");
    let mean = middle(&["--column-mean", "mass"]);
    assert!((mean - 2.5).abs() < 1e-5, "{mean}");
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

#[test]
fn pictures_along_axes_are_histograms_of_their_windows() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Particles far below a pixel at the centres of cells of .1, each of another mass.
    let cells: Vec<[i32; 3]> = (0..60)
        .map(|n| [n * 7 % 20, n * 11 % 20, n * 13 % 20])
        .collect();
    let mut rows = String::from("x,y,z,sigma,mass\n");
    for (n, cell) in cells.iter().enumerate() {
        let [x, y, z] = cell.map(|i| -1.0 + 0.1 * (f64::from(i) + 0.5));
        rows += &format!("{x},{y},{z},1e-6,{}\n", n + 1);
    }
    std::fs::write(path("p.csv"), rows).unwrap();
    // Right and up in the picture, and the axis along which it is seen.
    for (name, [right, up, along]) in [
        ("x", [1, 2, 0]),
        ("y", [0, 2, 1]),
        ("z", [0, 1, 2]),
        ("-x", [1, 2, 0]),
        ("-y", [0, 2, 1]),
        ("-z", [0, 1, 2]),
    ] {
        for depth in [None, Some([-0.5, 0.3])] {
            let between = depth.map_or(String::new(), |[low, high]| format!(",{low},{high}"));
            let window = format!("--window=-1,1,-.5,.5{between}");
            let along_name = format!("--along={name}");
            let out = ["--size", "20x10", "--out", "c.npy", "--stats", "c.json"];
            let words = [
                &["render", "p.csv", "--column-density", &along_name, &window][..],
                &out,
            ]
            .concat();
            let output = run(folder.path(), &words);
            assert!(output.status.success(), "{}", text(&output.stderr));
            let mut expected = vec![0.0; 200];
            for (n, cell) in cells.iter().enumerate() {
                let is_between = depth.is_none() || (5..13).contains(&cell[along]);
                let row = 14 - cell[up];
                if is_between && (0..10).contains(&row) {
                    let column = match name.starts_with('-') {
                        true => 19 - cell[right],
                        false => cell[right],
                    };
                    expected[usize::try_from(row * 20 + column).unwrap()] += (n + 1) as f32 / 0.01;
                }
            }
            let found = numbers_of(&path("c.npy"), 200);
            for (found, expected) in found.iter().zip(&expected) {
                let off = (found - expected).abs();
                assert!(
                    off <= 1e-4 * expected,
                    "{name} {depth:?}: {found} {expected}"
                );
            }
            let stats = std::fs::read_to_string(path("c.json")).unwrap();
            let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
            let extent = stats["column_density"]["extent"].as_array().unwrap();
            let extent: Vec<f64> = extent.iter().map(|x| x.as_f64().unwrap()).collect();
            let (left, to) = if name.starts_with('-') {
                (1.0, -1.0)
            } else {
                (-1.0, 1.0)
            };
            for (found, expected) in extent.iter().zip([left, to, -0.5, 0.5]) {
                assert!((found - expected).abs() < 1e-12, "{name}: {extent:?}");
            }
        }
    }
}

#[test]
fn column_densities_are_seen_along_z_unless_told_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "x,y,z,sigma,mass\n0,0,0,.1,1\n2,1,5,.2,2\n-1,1,2,.1,1\n";
    std::fs::write(folder.path().join("p.csv"), rows).unwrap();
    let picture = |words: &[&str]| {
        draw(folder.path(), &[words, &["--out", "c.npy"]].concat());
        numbers(&folder.path().join("c.npy"))
    };
    let own = picture(&[]);
    assert!(own == picture(&["--along", "z"]));
    assert!(own != picture(&["--elevation", "25"]));
    assert!(picture(&["--along", "x", "--ortho", "4", "--target", "0,1,2"]) != own);
    // Along -z the axis to the right runs to the left.
    let behind = picture(&["--along", "-z"]);
    for (row, mirrored) in own.chunks(33).zip(behind.chunks(33)) {
        for (a, b) in row.iter().zip(mirrored.iter().rev()) {
            assert!((a - b).abs() <= 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn windows_have_a_shape_and_an_axis() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "x,y,z,sigma,mass\n0,0,0,.1,1\n2,1,5,.2,2\n";
    std::fs::write(folder.path().join("p.csv"), rows).unwrap();
    let said = |words: &[&str]| {
        let all = [&["render", "p.csv", "--out", "c.png"], words].concat();
        let output = run(folder.path(), &all);
        assert!(!output.status.success(), "{words:?}");
        text(&output.stderr)
    };
    let column = "--column-density";
    let other = said(&[column, "--window", "0,2,0,1", "--size", "30x30"]);
    assert!(other.contains("60x30 pixels, found 30x30"), "{other}");
    assert!(said(&["--window", "0,2,0,1"]).contains("add --along"));
    for faulty in [
        "2,0,0,1",
        "0,1,0",
        "0,1,0,nan",
        "0,0,0,1",
        "0,1,0,1,2,1",
        "-1e308,1e308,0,1",
    ] {
        let window = format!("--window={faulty}");
        assert!(
            said(&[column, &window]).contains("greatest coordinate"),
            "{faulty}"
        );
    }
    assert!(said(&["--along", "w"]).contains("an axis: x, y, z"));
    for more in ["--eye=1,2,3", "--azimuth=3", "--turntable=4", "--fov=30"] {
        assert!(
            said(&["--along", "x", more]).contains("cannot be used with"),
            "{more}"
        );
    }
    // Without a size, the longer side has the default number of pixels.
    let words = [
        "render", "p.csv", column, "--window", "0,4,0,1", "--out", "c.png",
    ];
    assert!(run(folder.path(), &words).status.success());
    let image = read_image(&folder.path().join("c.png")).unwrap();
    assert_eq!((image.width, image.height), (1024, 256));
}

#[test]
fn columns_of_periodic_boxes_keep_the_mass_and_turn_with_the_centre() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = String::from("x,y,z,sigma,mass\n");
    let mut mass = 0.0;
    for n in 0..80 {
        let share = |step: f64| (f64::from(n) * step).fract();
        let [x, y, z] = [0.819, 0.671, 0.549].map(share);
        // Some lie outside, by whole edges.
        let (x, y) = (2.0 * x - 4.0 * f64::from(n % 2), y + f64::from(n % 3));
        rows += &format!("{x},{y},{z},{},{}\n", 0.01 + 0.15 * share(0.39), n + 1);
        mass += f64::from(n + 1);
    }
    std::fs::write(folder.path().join("p.csv"), rows).unwrap();
    let picture = |words: &[&str]| {
        let out = ["--out", "c.npy", "--stats", "c.json", "--size", "40x20"];
        let start = ["render", "p.csv", "--column-density", "--periodic", "2,1,1"];
        let output = run(folder.path(), &[&start[..], &out, words].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let stats = std::fs::read_to_string(folder.path().join("c.json")).unwrap();
        let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
        let stats = &stats["column_density"];
        let sum = stats["sum_times_area"].as_f64().unwrap();
        (
            numbers_of(&folder.path().join("c.npy"), 800),
            sum,
            stats["extent"].clone(),
        )
    };
    let (own, sum, extent) = picture(&[]);
    assert!((sum / mass - 1.0).abs() < 2e-5, "{sum} {mass}");
    let expected = serde_json::json!([0.0, 2.0, 0.0, 1.0]);
    assert_eq!(extent, expected);
    // A quarter of the box to the right and half of it up: ten columns, ten rows.
    let (moved, sum, _) = picture(&["--centre", "1.5,1,0.3"]);
    assert!((sum / mass - 1.0).abs() < 2e-5, "{sum} {mass}");
    let greatest = own.iter().copied().fold(0.0, f32::max);
    for (n, value) in moved.iter().enumerate() {
        let (row, column) = (n / 40, n % 40);
        let there = own[(row + 10) % 20 * 40 + (column + 10) % 40];
        assert!((value - there).abs() < 1e-4 * greatest, "{value} {there}");
    }
    let refused = |words: &[&str]| {
        let out = ["--out", "c.npy"];
        let output = run(folder.path(), &[&["render"], words, &out].concat());
        assert!(!output.status.success());
        text(&output.stderr)
    };
    assert!(refused(&["p.csv", "--periodic", "0.1"]).contains("less than an edge"));
    assert!(refused(&["p.csv", "--periodic", "1,0,1"]).contains("edges above 0"));
    assert!(refused(&["p.csv", "--centre", "1,0,1"]).contains("--periodic"));
    std::fs::write(
        folder.path().join("q.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    )
    .unwrap();
    assert!(refused(&["q.obj", "--periodic", "1"]).contains("expected particles"));
}

#[test]
fn the_field_of_columns_and_the_weight_of_means_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(
        at.join("p.csv"),
        "x,y,z,h,m,rho,t\n0,0,0,1,3,3,10\n1,0,2,1,1,1,50\n",
    )
    .unwrap();
    let of = |words: &[&str]| {
        draw(at, &[words, &["--out", "m.npy"]].concat());
        numbers(&at.join("m.npy"))
    };
    assert_eq!(of(&["--column-of", "t"]), of(&["--field", "t"]));
    let weighed = of(&["--column-mean", "rho", "--weight", "t"]);
    let same = of(&["--column-mean", "rho", "--field", "t"]);
    assert!(
        weighed
            .iter()
            .zip(&same)
            .all(|(a, b)| a.to_bits() == b.to_bits())
    );
    for (words, name) in [
        ("--column-of t", "--column-density"),
        ("--weight t --column-density", "--column-mean"),
        ("--column-of t --field rho --column-density", "--field"),
    ] {
        let line = format!("render p.csv --out m.npy {words}");
        let output = run(at, &line.split_whitespace().collect::<Vec<_>>());
        let message = text(&output.stderr);
        assert!(
            !output.status.success() && message.contains(name),
            "{words}: {message}"
        );
    }
}

/// Columns end where the kernel of the lengths ends, and those of Gaussians do not.
#[test]
fn columns_of_smoothing_lengths_are_those_of_their_kernel() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("p.csv"), "x,y,z,h,m\n0,0,0,1,3\n5,5,0,1,1\n").unwrap();
    let of = |words: &[&str]| {
        let own = ["--window=-3,3,-3,3", "--out", "m.npy"];
        draw(at, &[words, &own].concat());
        numbers(&at.join("m.npy"))
    };
    let [default, cubic, gaussian] = [
        of(&[]),
        of(&["--kernel", "cubic"]),
        of(&["--kernel", "gaussian"]),
    ];
    assert_eq!(default, cubic);
    let row = |image: &[f32], x: usize| image[16 * 33 + x];
    // The support is 2 h: 11 of 33 pixels on either side of the middle.
    assert!(row(&default, 16) > 0.0 && row(&default, 4) == 0.0);
    assert!(row(&gaussian, 4) > 1e-5);
    // The Gaussian's column through the centre is a tenth higher.
    let ratio = row(&gaussian, 16) / row(&default, 16);
    assert!((1.06..1.13).contains(&ratio), "{ratio}");
    let sums = [&default, &gaussian].map(|image| image.iter().sum::<f32>());
    assert!((sums[0] / sums[1] - 1.0).abs() < 1e-3, "{sums:?}");
    // Different kernels in one picture are drawn as Gaussians.
    std::fs::write(at.join("q.csv"), "x,y,z,sigma,m\n0,0,0,1,3\n").unwrap();
    let line = "render p.csv q.csv --column-density --window=-3,3,-3,3 --size 33x33 --out m.npy --backend cpu";
    let output = run(at, &line.split_whitespace().collect::<Vec<_>>());
    let message = text(&output.stderr);
    assert!(
        output.status.success() && message.contains("columns are of Gaussians"),
        "{message}"
    );
    assert!(row(&numbers(&at.join("m.npy")), 4) > 1e-5);
}

#[test]
fn slices_are_densities_on_a_plane() {
    let folder = tempfile::tempdir().unwrap();
    let table = "x,y,z,h,m,t\n0,0,0,1,2,7\n";
    std::fs::write(folder.path().join("p.csv"), table).unwrap();
    let middle = |more: &[&str]| {
        draw(folder.path(), &[more, &["--out", "s.npy"]].concat());
        numbers(&folder.path().join("s.npy"))[16 * 33 + 16]
    };
    // The cubic spline is 1/pi in its middle, and 1/(4 pi) at h.
    let pi = std::f32::consts::PI;
    for (plane, expected) in [("z=0", 2.0 / pi), ("x=1", 0.5 / pi), ("y=-2.1", 0.0)] {
        let found = middle(&["--slice", plane]);
        assert!((found - expected).abs() < 1e-5, "{plane}: {found}");
    }
    let gaussian = middle(&["--slice", "z=0", "--kernel", "gaussian"]);
    // The spline's variance is .3 h².
    assert!(
        (gaussian - 2.0 / (0.6 * pi).powf(1.5)).abs() < 1e-4,
        "{gaussian}"
    );
    let mean = middle(&["--slice", "z=0.5", "--column-mean", "t"]);
    assert!((mean - 7.0).abs() < 1e-5, "{mean}");
    assert!(middle(&["--slice", "z=3", "--column-mean", "t"]).is_nan());
    // A periodic box ends at its faces, and lets kernels in at the opposite ones.
    let boxed = ["--periodic", "5", "--window=-1,6,-1,6", "--slice"];
    let near = middle(&[&boxed[..], &["z=4.5"]].concat());
    assert!(near == 0.0, "far from the particle: {near}");
    let image = numbers(&folder.path().join("s.npy"));
    let at = |x: f32, y: f32| {
        image[(((6.0 - y) / 7.0 * 33.0) as usize) * 33 + ((x + 1.0) / 7.0 * 33.0) as usize]
    };
    assert!(at(4.6, 0.4) > 0.0 && at(0.4, 0.4) > 0.0);
    assert!(at(-0.4, 0.4) == 0.0 && at(5.4, 0.4) == 0.0);
    for plane in ["w=1", "z=nan", "z", "-z=1"] {
        let all = [
            "render",
            "p.csv",
            "--column-density",
            "--slice",
            plane,
            "--out",
            "s.npy",
        ];
        let refused = run(folder.path(), &all);
        assert!(text(&refused.stderr).contains("such as z=0.5"), "{plane}");
    }
    for more in [["--along", "x"], ["--low-pass", "1"], ["--backend", "gpu"]] {
        let all = [
            "render",
            "p.csv",
            "--column-density",
            "--slice",
            "z=0",
            "--out",
            "s.npy",
        ];
        let refused = run(folder.path(), &[&all[..], &more].concat());
        assert!(!refused.status.success(), "{more:?}");
        assert!(text(&refused.stderr).contains(more[0]), "{more:?}");
    }
}
