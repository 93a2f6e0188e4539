//! Compares the back ends' pictures of opaque edges, whose tiles are drawn at four samples a pixel.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use ewa_splat::render::{Advanced, Classification, Composite};
use ewa_splat::stages::cpu::SimdLevel;
use ewa_splat::{Renderer, Settings};

use crate::common::gpu::{gpu, rounding};
use crate::extent::{camera, lattice, settings, steps};

/// Both back ends draw the same tiles again, and their pictures agree. A tile whose estimate is within
/// rounding of the bound could differ; none of these is.
#[test]
fn both_back_ends_draw_the_same_tiles_again() {
    let Some(gpu) = gpu() else { return };
    // Slabs take a software adapter minutes: one small picture.
    for (composite, sizes) in [
        (Composite::Over, &[90, 60, 60][..]),
        (Composite::SLABS, &[40]),
    ] {
        let settings = Settings {
            composite,
            depth: true,
            advanced: Advanced {
                simd: SimdLevel::Baseline,
                opaque_edges: true,
                ..Advanced::default()
            },
            ..settings(Classification::Extent)
        };
        let volume = lattice(24, &steps());
        let mut on_cpu = Renderer::new(vec![volume.clone()]).unwrap();
        let mut on_gpu = Renderer::new(vec![volume])
            .unwrap()
            .on(gpu.clone())
            .unwrap();
        // Twice: the second picture and its samples use the buffers of the first.
        for &size in sizes {
            let a = on_cpu.render(&camera(size), &settings).unwrap();
            let b = on_gpu.render(&camera(size), &settings).unwrap();
            let numbers = a.pixels.iter().zip(&b.pixels).map(|(a, b)| {
                let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
                differences.fold(0.0, f32::max)
            });
            let mut differences: Vec<f32> = numbers.collect();
            differences.sort_by(f32::total_cmp);
            let count = differences.len();
            let (most, worst) = (differences[count * 999 / 1000], differences[count - 1]);
            println!("{composite:?}, {size}: {most:e}, {worst:e}");
            // A kernel's cut-off may lie within rounding of a sample.
            assert!(most <= rounding() && worst <= settings.tolerance);
            let tiles = on_cpu.counts().supersampled_tiles;
            assert_eq!(on_gpu.counts().supersampled_tiles, tiles);
            assert!(tiles > 2, "{tiles}");
            assert_eq!(on_gpu.depth().map(|d| d.width), Some(size));
        }
    }
}
