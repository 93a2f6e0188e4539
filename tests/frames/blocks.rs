//! Tests grids of several blocks: where blocks meet, nothing is lost or counted twice.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "a test may panic, and its numbers are small"
)]

use std::f64::consts::PI;

use crate::common::grid_nodes;
use crate::support::{Plot3dBlock, Plot3dEncoding};
use ewa_splat::io::{OpenOptions, open};
use ewa_splat::sample::{SampleOptions, Sampled, volume};
use ewa_splat::scene::{Strength, Values};
use glam::DVec3;

/// Makes a block whose nodes lie at `at` of their index fractions, each 0..1.
fn block(dims: [i32; 3], at: impl Fn(DVec3) -> DVec3) -> Plot3dBlock {
    // The numbers are small and not negative.
    let nodes = grid_nodes(dims.map(|n| n as usize), at);
    let axis = |f: fn(&DVec3) -> f64| nodes.iter().map(f).collect::<Vec<_>>();
    Plot3dBlock {
        dims,
        numbers: [axis(|p| p.x), axis(|p| p.y), axis(|p| p.z)].concat(),
        iblank: vec![],
    }
}

/// Makes a part of an annulus of radii 1 and 3 and height 2, between the angles `from` and `to`, in
/// turns, and the heights `bottom` and `top`, in fractions of the height.
fn annulus(dims: [i32; 3], [from, to]: [f64; 2], [bottom, top]: [f64; 2]) -> Plot3dBlock {
    block(dims, |s| {
        let (sin, cos) = (2.0 * PI * (from + (to - from) * s.y)).sin_cos();
        let radius = 1.0 + 2.0 * s.x;
        let z = 2.0 * (bottom + (top - bottom) * s.z);
        DVec3::new(radius * cos, radius * sin, z)
    })
}

/// Returns the volume of that annulus if each circle is a polygon of `sides` sides.
fn annulus_volume(sides: i32) -> f64 {
    let sides = f64::from(sides);
    2.0 * 0.5 * sides * (2.0 * PI / sides).sin() * (9.0 - 1.0)
}

/// Writes the blocks as a PLOT3D file with a solution whose density numbers the nodes from 1, and
/// samples the file.
fn sampled(blocks: &[Plot3dBlock], double: bool) -> Sampled {
    let encoding = Plot3dEncoding {
        text: false,
        double,
        big_endian: false,
        records: true,
        grid_count: true,
    };
    let mut next = 1.0;
    let solutions: Vec<Plot3dBlock> = blocks
        .iter()
        .map(|block| {
            let count = block.numbers.len() / 3;
            let mut numbers = vec![1.0; 5 * count];
            for n in &mut numbers[..count] {
                *n = next;
                next += 1.0;
            }
            Plot3dBlock {
                dims: block.dims,
                numbers,
                iblank: vec![],
            }
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("blocks.xyz");
    std::fs::write(&path, encoding.grids(blocks)).unwrap();
    std::fs::write(
        folder.path().join("blocks.q"),
        encoding.solutions(&solutions),
    )
    .unwrap();
    let data = open(&path, &OpenOptions::default()).unwrap();
    volume(data, &SampleOptions::default()).unwrap()
}

fn volumes(sampled: &Sampled) -> &[f32] {
    let Strength::Classified { volumes } = &sampled.volume.strength else {
        panic!("classified volumes expected");
    };
    volumes
}

fn total(sampled: &Sampled) -> f64 {
    volumes(sampled).iter().map(|&v| f64::from(v)).sum()
}

/// Returns the numbers of the nodes that became particles.
fn numbers(sampled: &Sampled) -> Vec<usize> {
    let values: &Values = sampled.volume.values.as_ref().unwrap();
    (0..values.len()).map(|i| values.get(i) as usize).collect()
}

fn assert_total(sampled: &Sampled, expected: f64, tolerance: f64) {
    let total = total(sampled);
    assert!(
        (total / expected - 1.0).abs() < tolerance,
        "{total} for {expected}"
    );
}

/// f32 volumes: 2^-24 each; sums of a few hundred stay within 1e-6.
const SUM: f64 = 1e-6;
/// Nodes near 1 in single precision move by 6e-8, over a spacing of about 0.3.
const SINGLE: f64 = 2e-6;

#[test]
fn blocks_that_share_a_plane_fill_their_union_once() {
    let cut = |from: f64, to: f64, n: i32| {
        block([n, 4, 3], move |s| {
            DVec3::new(from + (to - from) * s.x, 2.0 * s.y, 0.5 * s.z)
        })
    };
    // The two sides of the shared plane x = 1 have different spacings.
    let both = sampled(&[cut(0.0, 1.0, 5), cut(1.0, 4.0, 6)], true);
    assert_total(&both, 4.0, SUM);
    assert_eq!(volumes(&both).len(), (5 + 6) * 4 * 3);
    // The nodes of the shared plane occur twice, each for its own side: half a cell of the first
    // block, half a cell of the second.
    let at = |i: usize, dims: [usize; 3]| 1 + i + dims[0] * (1 + dims[1]);
    let of = |number: usize| {
        let found = numbers(&both).iter().position(|&n| n == number).unwrap();
        f64::from(volumes(&both)[found])
    };
    let face = 2.0 / 3.0 * 0.25;
    let first = of(at(4, [5, 4, 3]));
    let second = of(5 * 4 * 3 + at(0, [6, 4, 3]));
    assert!((first - 0.125 * face).abs() < 1e-7, "{first}");
    assert!((second - 0.3 * face).abs() < 1e-7, "{second}");
}

#[test]
fn an_o_grid_in_two_halves_has_no_seam_and_its_polygon_s_volume() {
    let halves = [
        annulus([3, 11, 3], [0.0, 0.5], [0.0, 1.0]),
        annulus([3, 9, 3], [0.5, 1.0], [0.0, 1.0]),
    ];
    for (double, tolerance) in [(true, SUM), (false, SINGLE)] {
        let both = sampled(&halves, double);
        let expected = 0.5 * (annulus_volume(20) + annulus_volume(16));
        assert_total(&both, expected, tolerance);
        assert_eq!(both.report.sample_count, both.report.particle_count);
    }
}

#[test]
fn each_block_of_stacked_o_grids_has_its_own_seam() {
    let rings = [
        annulus([3, 13, 3], [0.0, 1.0], [0.0, 0.25]),
        annulus([4, 13, 2], [0.0, 1.0], [0.25, 1.0]),
    ];
    for (double, tolerance) in [(true, SUM), (false, SINGLE)] {
        let both = sampled(&rings, double);
        assert_total(&both, annulus_volume(12), tolerance);
        // The last plane of j of each block coincides with its first.
        assert_eq!(both.report.particle_count, 3 * 12 * 3 + 4 * 12 * 2);
        assert_eq!(both.report.left_out_count(), 3 * 3 + 4 * 2);
    }
    // One ring is closed, the other open: only the first has a seam.
    let mixed = [
        annulus([3, 13, 3], [0.0, 1.0], [0.0, 0.5]),
        annulus([3, 10, 3], [0.0, 0.75], [0.5, 1.0]),
    ];
    let both = sampled(&mixed, true);
    assert_total(&both, annulus_volume(12) * (0.5 + 0.5 * 0.75), SUM);
    assert_eq!(both.report.particle_count, 3 * 12 * 3 + 3 * 10 * 3);
}

#[test]
fn blanked_nodes_of_either_block_are_left_out() {
    let cube = |x: f64| block([3, 3, 3], move |s| s + DVec3::X * x);
    let mut blocks = [cube(0.0), cube(1.0)];
    blocks[0].iblank = vec![1; 27];
    blocks[0].iblank[4] = 0;
    // Walls and nodes interpolated from other blocks are drawn.
    blocks[1].iblank = vec![2; 27];
    blocks[1].iblank[5] = -3;
    for blank in [0, 26] {
        blocks[1].iblank[blank] = 0;
    }
    let both = sampled(&blocks, true);
    // A blanked node takes its cells with it: that in the middle of a face all that has nodes of k = 0, two corners one
    // cell each.
    let blanked = |i: &usize| *i < 9 || [27, 27 + 26].contains(i);
    let kept: Vec<usize> = (0..54).filter(|i| !blanked(i)).collect();
    let drawn: Vec<usize> = numbers(&both).iter().map(|n| n - 1).collect();
    assert_eq!(drawn, kept);
    assert_total(&both, 2.0 - 0.5 - 2.0 / 8.0, SUM);
}
