//! Checks the generated files of `fixtures/`: `examples/make_fixtures.rs` generates the same bytes,
//! and they have the stated properties.

use std::path::Path;

use ewa_splat::io::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use ewa_splat::sample::{FunctionOptions, SampleOptions, TransferChoice, volume};
use ewa_splat::scene::Values;
use glam::DVec3;

#[test]
fn committed_files_are_the_generated_ones() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for (name, bytes) in crate::examples::all() {
        let committed = std::fs::read(folder.join(name)).unwrap_or_default();
        assert!(
            committed == bytes,
            "fixtures/{name} differs; run `cargo run --example make_fixtures`"
        );
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect()
}

/// The wake's nodes and its five conserved variables.
fn wake() -> ([usize; 3], Vec<DVec3>, Vec<Vec<f32>>) {
    let files = crate::examples::all();
    let (grid, solution) = (&files[0].1, &files[1].1);
    let dims = [0, 4, 8].map(|at| i32::from_le_bytes([0, 1, 2, 3].map(|b| grid[at + b])) as usize);
    let n = dims.iter().product::<usize>();
    let (xyz, q) = (floats(&grid[12..]), floats(&solution[28..]));
    assert_eq!((xyz.len(), q.len()), (3 * n, 5 * n));
    let at = |i: usize| DVec3::new(xyz[i].into(), xyz[n + i].into(), xyz[2 * n + i].into());
    (
        dims,
        (0..n).map(at).collect(),
        q.chunks(n).map(<[f32]>::to_vec).collect(),
    )
}

#[test]
fn the_wake_is_an_o_grid_with_a_sound_flow() {
    let (dims, nodes, q) = wake();
    let mach_free = 0.5f64;
    let state = |i: usize| [0, 1, 2, 3, 4].map(|v| f64::from(q[v][i]));
    for [rho, mu, mv, mw, e] in (0..nodes.len()).map(state) {
        let kinetic = 0.5 * (mu * mu + mv * mv + mw * mw) / rho;
        let pressure = 0.4 * (e - kinetic);
        assert!(rho > 0.3 && rho < 1.2 && pressure > 0.0, "{rho} {pressure}");
        // Isentropic with the free stream: p = rho^1.4 / 1.4. 1e-4 allows for f32 and cancellation.
        assert!((pressure * 1.4 / rho.powf(1.4) - 1.0).abs() < 1e-4);
        let mach = (2.0 * kinetic / rho / (1.4 * pressure / rho)).sqrt();
        assert!(mach < 8.0 * mach_free);
    }
    let transfer = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/wake_transfer.json");
    let dataset = Dataset::new(
        Path::new("wake.xyz"),
        "PLOT3D grid",
        Geometry::Curvilinear {
            blocks: vec![CurvilinearBlock { dims, nodes }],
        },
        vec![Field {
            name: "density".into(),
            association: Association::Nodes,
            source: FieldSource::Scalar(Values::F32(q[0].clone())),
            unit: None,
        }],
    );
    let options = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::File(transfer),
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    let sampled = volume(dataset, &options).unwrap();
    // Only the seam is left out.
    assert_eq!(sampled.report.left_out_count(), dims[1] * dims[2]);
    // At the nose, the planes around meet in a line.
    let warnings = sampled.report.warnings();
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(warnings[0].starts_with(&format!("{} cells: degenerate", dims[0] - 1)));
    // The free stream is transparent, and the cores are bright.
    let t = sampled.volume.transfer_function.unwrap();
    assert!(t.classify(1.0)[3] <= 0.0 && t.classify(0.55)[3] > 1.0);
    let visible = q[0].iter().filter(|&&rho| t.classify(rho)[3] > 0.1).count();
    let share = visible as f64 / q[0].len() as f64;
    // The share is about half, because the grid is denser at the vortices.
    assert!(share > 0.3 && share < 0.7, "{share}");
}

#[test]
fn the_particle_table_has_a_thousand_definite_kernels() {
    let files = crate::examples::all();
    let text = String::from_utf8(files[3].1.clone()).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f32>> = lines
        .map(|l| l.split(',').map(|x| x.parse().unwrap()).collect())
        .collect();
    let column = |c: usize| rows.iter().map(|r| r[c]).collect::<Vec<f32>>();
    let position = |r: &Vec<f32>| DVec3::new(r[0].into(), r[1].into(), r[2].into());
    let dataset = Dataset::new(
        Path::new("particles.csv"),
        "CSV",
        Geometry::Points {
            positions: rows.iter().map(position).collect(),
        },
        (3..names.len())
            .map(|c| Field {
                name: names[c].into(),
                association: Association::Nodes,
                source: FieldSource::Scalar(Values::F32(column(c))),
                unit: None,
            })
            .collect(),
    );
    let sampled = volume(dataset, &SampleOptions::default()).unwrap();
    assert_eq!(sampled.volume.particles.len(), 1000);
    assert!(sampled.report.warnings().is_empty());
}
