//! Compares the tiles' lists of the device with those of the CPU.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::frame::Frame;
use crate::common::gpu::gpu;
use crate::common::scene::{self, Particle, volume};
use bytemuck::Zeroable;
use ewa_splat::Filter;
use ewa_splat::Settings;
use ewa_splat::stages::constants::TILE_SIZE;
use ewa_splat::stages::cpu::{self, Bins};
use ewa_splat::stages::gpu::{ChunkBins, Gpu, MAX_BAND_TILES, bin};
use ewa_splat::stages::record::{
    ChunkUniform, ExactTerms, Footprint, FootprintTerms, PATH_AFFINE, PATH_EXACT, PATH_HALF_LINE,
    PATH_NEAR, PATH_PEAK, PATH_SURFEL, SurfelTerms, pack_range,
};
use ewa_splat::view::Projection;
use glam::{DVec2, DVec3};

/// Side of a tile.
const SIDE: u32 = TILE_SIZE as u32;

/// Footprints, their exact terms and the tiles that they are binned into.
struct Input {
    footprints: Vec<Footprint>,
    exact: Vec<ExactTerms>,
    /// Terms of surfels, in place of exact ones.
    surfels: Vec<SurfelTerms>,
    tiles: [usize; 2],
}

/// Returns the chunk of a whole frame.
fn whole(input: &Input) -> ChunkUniform {
    ChunkUniform {
        start: 0,
        capacity: input.footprints.len() as u32,
        band_first: [0, 0],
        band_size: input.tiles.map(|n| n as u32),
        is_last: 1,
        unused: 0,
    }
}

impl Input {
    /// Returns the terms of a run of its footprints.
    fn terms(&self, first: usize, end: usize) -> FootprintTerms<'_> {
        match self.surfels.get(first..end) {
            Some(terms) if !self.surfels.is_empty() => FootprintTerms::Surfel(terms),
            _ => FootprintTerms::Exact(self.exact.get(first..end).unwrap_or(&[])),
        }
    }

    fn order(&self) -> Vec<u64> {
        let mut order = Vec::new();
        cpu::sort(&self.footprints, &mut order);
        order
    }

    /// Returns the CPU's lists of a chunk's footprints, for the tiles of its band.
    fn expected(&self, chunk: ChunkUniform) -> Vec<Vec<u32>> {
        let order = self.order();
        let start = (chunk.start as usize).min(order.len());
        let end = (start + chunk.capacity as usize).min(order.len());
        let mut bins = Bins::default();
        let order = &order[start..end];
        cpu::bin(
            &self.footprints,
            self.terms(0, self.footprints.len()),
            order,
            self.tiles[0],
            0..self.tiles[0] * self.tiles[1],
            &mut bins,
        );
        let ([x, y], [columns, rows]) = (chunk.band_first, chunk.band_size);
        let tiles = (y..y + rows).flat_map(|ty| (x..x + columns).map(move |tx| (tx, ty)));
        tiles
            .map(|(tx, ty)| {
                let tile = ty as usize * self.tiles[0] + tx as usize;
                bins.tile(tile).collect()
            })
            .collect()
    }

    /// Returns the device's lists, with the footprints in parts that end at `ends`.
    fn binned(
        &self,
        gpu: &Gpu,
        chunks: &[ChunkUniform],
        ends: &[usize],
        capacity: u64,
    ) -> Vec<ChunkBins> {
        let mut parts = Vec::new();
        let mut first = 0;
        for &end in ends.iter().chain([&self.footprints.len()]) {
            parts.push((&self.footprints[first..end], self.terms(first, end)));
            first = end;
        }
        bin(gpu, &parts, &self.order(), chunks, capacity).unwrap()
    }

    /// Compares the lists, and returns the number of entries. On a software adapter, which rounds
    /// as the CPU does, all are equal. Hardware that fuses operations may decide a thousandth
    /// differently, where a corner of a tile lies on an outline.
    fn check(&self, gpu: &Gpu, chunks: &[ChunkUniform], ends: &[usize], what: &str) -> usize {
        let expected: Vec<_> = chunks.iter().map(|&c| self.expected(c)).collect();
        let entries = |lists: &Vec<Vec<u32>>| lists.iter().map(Vec::len).sum::<usize>();
        // The capacity is just enough.
        let mut capacity = expected.iter().map(entries).max().unwrap_or(0);
        if !gpu.is_software() {
            capacity += capacity / 100 + 10;
        }
        let got = self.binned(gpu, chunks, ends, capacity as u64);
        if !gpu.is_software() {
            for (got, expected) in got.iter().zip(&expected) {
                let differ: usize = got
                    .tiles
                    .iter()
                    .zip(expected)
                    .map(|(a, b)| a.len().abs_diff(b.len()))
                    .sum();
                println!("{what}: {differ} of {} entries differ", entries(expected));
                assert!(differ <= 1 + entries(expected) / 1000, "{what}");
            }
            return expected.iter().map(entries).sum();
        }
        for ((chunk, got), expected) in chunks.iter().zip(&got).zip(&expected) {
            assert_eq!(got.needed as usize, entries(expected), "{what}, {chunk:?}");
            for (t, (got, expected)) in got.tiles.iter().zip(expected).enumerate() {
                assert_eq!(got, expected, "{what}, {chunk:?}, tile {t}");
            }
            assert_eq!(got.tiles.len(), expected.len(), "{what}, {chunk:?}");
        }
        expected.iter().map(entries).sum()
    }
}

/// Returns a number that f32 represents, as the footprints store it.
fn float(random: &mut Random, low: f64, high: f64) -> f32 {
    random.range(low, high) as f32
}

/// Returns a footprint's triangular form from its half axes (pixels, of one standard deviation) and
/// their direction: rows p and r with Q = (p . d)² + (r . d)².
fn form(axes: DVec2, angle: f64) -> [[f32; 2]; 2] {
    let (sin, cos) = angle.sin_cos();
    // A = RᵀD R; its triangular factor.
    let (u, v) = (axes.x.powi(-2), axes.y.powi(-2));
    let a = u * cos * cos + v * sin * sin;
    let b = (u - v) * sin * cos;
    let c = u * sin * sin + v * cos * cos;
    let root = a.sqrt();
    [
        [root as f32, (b / root) as f32],
        [0.0, (c - b * b / a).max(0.0).sqrt() as f32],
    ]
}

/// Returns ellipses from points to the whole image, round and needles, in boxes that cut some of
/// them.
fn random_input(seed: u64, count: usize, tiles: [usize; 2]) -> Input {
    let mut random = Random::new(seed);
    let size = tiles.map(|n| n as f64 * f64::from(SIDE) - 5.0);
    let mut exact = Vec::new();
    let footprints = (0..count)
        .map(|_| {
            let centre =
                DVec2::new(random.range(-0.2, 1.2), random.range(-0.2, 1.2)) * DVec2::from(size);
            let major = random.log_range(0.3, 0.2 * size[0]);
            let minor = major / random.log_range(1.0, 1e4_f64.min(major * 20.0 + 1.0));
            let angle = random.range(-1.6, 1.6);
            let [form_p, form_r] = form(DVec2::new(major, minor.max(0.01)), angle);
            let cutoff = random.range(1.0, 7.0);
            let path = [
                PATH_AFFINE,
                PATH_PEAK,
                PATH_EXACT,
                PATH_EXACT,
                PATH_NEAR | 12,
                PATH_HALF_LINE | 8,
            ][random.index(6)];
            // w = 1 + g . d + ...: it varies by a factor of a few over the ellipse.
            let gradient = [0; 2].map(|_| float(&mut random, -0.3, 0.3) / (cutoff * major) as f32);
            let hessian =
                [0; 3].map(|_| float(&mut random, -0.1, 0.1) / (cutoff * major).powi(2) as f32);
            exact.push(ExactTerms {
                gradient,
                hessian,
                ..ExactTerms::default()
            });
            let range = |centre: f64, size: f64| {
                let reach = cutoff * major * 1.2;
                let first = (centre - reach).clamp(0.0, size - 1.0) as u32;
                let end = ((centre + reach).clamp(0.0, size) as u32).max(first + 1);
                pack_range(first, end)
            };
            let hidden = random.index(10) == 0;
            Footprint {
                centre_px: centre.as_vec2().into(),
                form_p,
                form_r,
                cutoff_squared: (cutoff * cutoff) as f32,
                path,
                columns: range(centre.x, size[0]),
                rows: if hidden { 0 } else { range(centre.y, size[1]) },
                key: random.index(3000) as u32,
                ..Footprint::zeroed()
            }
        })
        .collect();
    Input {
        footprints,
        exact,
        surfels: Vec::new(),
        tiles,
    }
}

#[test]
fn random_lists_are_the_cpus() {
    let Some(gpu) = gpu() else { return };
    for (seed, count, tiles) in [
        (1, 0, [3, 2]),
        (2, 1, [1, 1]),
        (3, 255, [7, 5]),
        (4, 256, [40, 30]),
        (5, 257, [20, 9]),
        // Keys have eight and nine bits.
        (6, 600, [16, 16]),
        (7, 600, [257, 1]),
        (8, 5_000, [64, 36]),
    ] {
        let input = random_input(seed, count, tiles);
        let what = format!("{count} in {tiles:?}");
        let entries = input.check(gpu, &[whole(&input)], &[], &what);
        println!("{what}: {entries} entries, all as on the CPU");
        // The same input, with no exact terms.
        let input = Input {
            exact: Vec::new(),
            ..input
        };
        input.check(gpu, &[whole(&input)], &[count / 2], "no exact terms");
    }
}

/// Returns [`random_input`] as surfels whose planes lean towards the eye and away from it, up to
/// outlines that are branches of hyperbolas; some are affine.
fn surfel_input(seed: u64, count: usize, tiles: [usize; 2]) -> Input {
    let mut random = Random::new(seed);
    let mut input = random_input(seed, count, tiles);
    for footprint in &mut input.footprints {
        footprint.path = PATH_SURFEL;
        let inverse_depth = random.log_range(1e-3, 1e3);
        let reach = f64::from(1.0 / footprint.form_p[0].hypot(footprint.form_r[0]))
            * f64::from(footprint.cutoff_squared).sqrt();
        let slope = || inverse_depth / reach;
        let gradient = [slope(), slope()].map(|s| (s * random.range(-1.2, 1.2)) as f32);
        input.surfels.push(SurfelTerms {
            gradient,
            inverse_depth: inverse_depth as f32,
            homography: f32::from(u8::from(random.index(8) > 0)),
            ..SurfelTerms::default()
        });
    }
    input
}

#[test]
fn lists_of_large_surfels_are_the_cpus() {
    let Some(gpu) = gpu() else { return };
    for (seed, count, tiles) in [(21, 300, [40, 30]), (22, 3000, [64, 36])] {
        let input = surfel_input(seed, count, tiles);
        let affine = Input {
            footprints: input.footprints.clone(),
            exact: Vec::new(),
            surfels: Vec::new(),
            tiles,
        };
        let entries = input.check(gpu, &[whole(&input)], &[count / 2], "surfels");
        let of_ellipses = affine.check(gpu, &[whole(&affine)], &[], "their ellipses");
        println!("{entries} entries, all as on the CPU; of ellipses {of_ellipses}");
        assert_ne!(entries, of_ellipses);
    }
}

#[test]
fn lists_of_whole_frames_are_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(7);
    let mut paths = [0; 4];
    for (filter, projection, ratio) in [
        (Filter::Exact, Projection::Perspective, 10.0),
        (Filter::Adaptive, Projection::Perspective, 1e4),
        (Filter::Ewa, Projection::Orthographic, 1e4),
    ] {
        let particles: Vec<Particle> = (0..3000)
            .map(|i| {
                let size = random.log_range(3e-3, 0.5);
                let ratio = random.log_range(1.0, ratio);
                let near = i % 9 == 0;
                let forward = DVec3::Z * if near { 0.0 } else { 3.2 };
                Particle {
                    position: random.point(if near { 0.4 } else { 3.0 }) + forward,
                    factor: random.factor(size, ratio),
                    mass: (size * size / ratio * random.log_range(0.01, 20.0)) as f32,
                    colour: [1.0; 3],
                }
            })
            .collect();
        let camera = scene::camera(projection, [310.0, 240.0], [603, 421]);
        let settings = Settings {
            filter,
            ..Settings::default()
        };
        let frame = Frame::new(volume(&particles), &camera, &settings);
        for &word in &frame.order {
            paths[(frame.footprints[word as u32 as usize].path & 3) as usize] += 1;
        }
        let input = Input {
            footprints: frame.footprints,
            exact: frame.exact,
            surfels: Vec::new(),
            tiles: frame.tiles,
        };
        let entries = input.check(gpu, &[whole(&input)], &[1000], &format!("{filter:?}"));
        println!("{filter:?}, {projection:?}: {entries} entries, all as on the CPU");
    }
    println!("affine, exact, near, half line: {paths:?}");
    assert!(paths.iter().all(|&n| n > 20), "{paths:?}");
}

/// Returns ellipses whose outline meets pixel centres at corners and edges of tiles exactly, and
/// boxes that begin and end there.
fn borders() -> Input {
    let mut footprints = Vec::new();
    let tiles = [8, 8];
    // Powers of two make every value exact: those on the outline equal the cut-off.
    for scale in [0.25, 0.125] {
        for cutoff in [1.0, 2.0, 4.0_f32] {
            let reach = cutoff / scale;
            for shift in [-1.0, -0.5, 0.0, 0.5, 1.0] {
                for [x, y] in [[48.0, 48.0], [63.5, 64.5], [64.0, 40.5], [40.5, 64.0]] {
                    let centre = [x + shift, y + shift];
                    let box_of = |c: f32, grow: u32| {
                        let first = (c - reach).max(0.0) as u32;
                        let end = ((c + reach) as u32 + grow).min(8 * SIDE);
                        pack_range(first, end)
                    };
                    for grow in [0, 1] {
                        footprints.push(Footprint {
                            centre_px: centre,
                            form_p: [scale, 0.0],
                            form_r: [0.0, scale],
                            cutoff_squared: cutoff * cutoff,
                            columns: box_of(centre[0], grow),
                            rows: box_of(centre[1], grow),
                            key: footprints.len() as u32 / 3,
                            ..Footprint::zeroed()
                        });
                    }
                }
            }
        }
    }
    // Boxes alone: tile edges, one tile, one pixel, a row, a column, everything.
    for (x, y) in [
        ((16, 32), (16, 32)),
        ((15, 33), (15, 33)),
        ((0, 16), (0, 128)),
        ((0, 128), (127, 128)),
        ((31, 32), (32, 33)),
        ((0, 128), (0, 128)),
        ((16, 17), (0, 128)),
    ] {
        for path in [PATH_AFFINE, PATH_EXACT, PATH_NEAR] {
            footprints.push(Footprint {
                centre_px: [24.0, 24.0],
                form_p: [0.25, 0.0],
                form_r: [0.0, 0.25],
                cutoff_squared: 4.0,
                path,
                columns: pack_range(x.0, x.1),
                rows: pack_range(y.0, y.1),
                key: 9,
                ..Footprint::zeroed()
            });
        }
    }
    Input {
        exact: vec![ExactTerms::default(); footprints.len()],
        footprints,
        surfels: Vec::new(),
        tiles,
    }
}

#[test]
fn borders_of_tiles_and_outlines_are_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let input = borders();
    let entries = input.check(gpu, &[whole(&input)], &[], "borders");
    println!(
        "{} footprints: {entries} entries, all as on the CPU",
        input.footprints.len()
    );
}

#[test]
fn poison_is_binned_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(9);
    let poison = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -f32::MAX,
        0.0,
        -0.0,
        1e-42,
        f32::MIN_POSITIVE,
        1e30,
        -1e20,
    ];
    for mut input in [
        random_input(10, 4000, [12, 9]),
        surfel_input(13, 4000, [12, 9]),
    ] {
        poison_numbers(&mut input, &mut random, &poison);
        hold_poisoned(gpu, &input);
    }
}

/// Replaces one or two numbers of each footprint.
fn poison_numbers(input: &mut Input, random: &mut Random, poison: &[f32]) {
    for (f, e) in input.footprints.iter_mut().zip(&mut input.exact) {
        let mut numbers: Vec<&mut f32> = (f.centre_px.iter_mut())
            .chain(&mut f.form_p)
            .chain(&mut f.form_r)
            .chain([&mut f.cutoff_squared])
            .chain(&mut e.gradient)
            .chain(&mut e.hessian)
            .collect();
        for _ in 0..=random.index(2) {
            *numbers[random.index(12)] = poison[random.index(poison.len())];
        }
    }
}

fn hold_poisoned(gpu: &Gpu, input: &Input) {
    let expected = input.expected(whole(input));
    let entries: usize = expected.iter().map(Vec::len).sum();
    let got = input
        .binned(gpu, &[whole(input)], &[], 2 * entries as u64)
        .remove(0);
    let mut flips = Vec::new();
    for (t, (got, expected)) in got.tiles.iter().zip(&expected).enumerate() {
        let differ = |a: &[u32], b: &[u32]| -> Vec<u32> {
            a.iter().copied().filter(|i| !b.contains(i)).collect()
        };
        flips.extend(differ(got, expected).into_iter().map(|i| (t, i, "more")));
        flips.extend(differ(expected, got).into_iter().map(|i| (t, i, "missing")));
    }
    println!("{entries} entries, {} flips", flips.len());
    for &(t, i, what) in flips.iter().take(10) {
        let i = i as usize;
        println!(
            "tile {t}: {what} {:?} {:?}",
            input.footprints[i], input.exact[i]
        );
    }
    assert!(flips.is_empty() || !gpu.is_software());
}

#[test]
fn bands_and_chunks_hold_their_share_of_the_lists() {
    let Some(gpu) = gpu() else { return };
    let input = random_input(11, 3000, [23, 17]);
    let visible = input.order().len() as u32;
    let all = whole(&input);
    let bands = [
        ([0, 0], [23, 17]),
        ([0, 0], [23, 1]),
        ([0, 16], [23, 1]),
        ([22, 3], [1, 9]),
        ([5, 4], [11, 8]),
        ([0, 8], [23, 9]),
    ]
    .map(|(band_first, band_size)| ChunkUniform {
        band_first,
        band_size,
        ..all
    });
    let entries = input.check(gpu, &bands, &[], "bands");
    println!("bands: {entries} entries, all as on the CPU");
    // Chunks run one after the other, the last ones short and empty; together they are the whole.
    let chunks: Vec<_> = (0..visible + 1200)
        .step_by(600)
        .map(|start| ChunkUniform {
            start,
            capacity: 600,
            ..all
        })
        .collect();
    let ends = [10, 10, 1999];
    let entries = input.check(gpu, &chunks, &ends, "chunks");
    let mut together = vec![Vec::new(); 23 * 17];
    for chunk in input.binned(gpu, &chunks, &ends, 1 << 20) {
        for (list, tile) in together.iter_mut().zip(chunk.tiles) {
            list.extend(tile);
        }
    }
    assert_eq!(together, input.expected(all));
    assert_eq!(entries, together.iter().map(Vec::len).sum::<usize>());
    // Whole workgroups, and remainders, after other chunks have used the buffers.
    let chunks = [
        (0, 1000),
        (5, 256),
        (7, 512),
        (100, 255),
        (100, 257),
        (visible - 1, 1),
        (visible, 1),
        (visible - 1, 7),
        (u32::MAX, 7),
        (7, 1),
        (7, 0),
    ]
    .map(|(start, capacity)| ChunkUniform {
        start,
        capacity,
        ..all
    });
    input.check(gpu, &chunks, &[], "chunks of all sizes");
}

#[test]
fn lists_that_find_no_room_are_empty_and_say_what_they_need() {
    let Some(gpu) = gpu() else { return };
    let input = random_input(12, 1000, [31, 29]);
    let chunk = whole(&input);
    let entries: usize = input.expected(chunk).iter().map(Vec::len).sum();
    for capacity in [0, 1, entries as u64 - 1] {
        let got = input.binned(gpu, &[chunk], &[], capacity).remove(0);
        assert_eq!(got.needed as usize, entries);
        assert!(got.tiles.iter().all(Vec::is_empty), "{capacity}");
    }
    // The counts exceed 32 bits.
    let everywhere = Footprint {
        path: PATH_NEAR,
        columns: pack_range(0, 16_384),
        rows: pack_range(0, 16_384),
        ..Footprint::zeroed()
    };
    let input = Input {
        footprints: vec![everywhere; 4097],
        exact: Vec::new(),
        surfels: Vec::new(),
        tiles: [1024, 1024],
    };
    let got = input.binned(gpu, &[whole(&input)], &[], 1000).remove(0);
    assert_eq!(got.needed, u32::MAX);
    assert!(got.tiles.iter().all(Vec::is_empty));
}

#[test]
fn the_largest_band_is_walked_to_its_end() {
    let Some(gpu) = gpu() else { return };
    // A workgroup of footprints covers the whole band and is tested tile by tile.
    let tiles = [254, 256];
    let count = 256;
    let everywhere = Footprint {
        centre_px: [1000.0, 1000.0],
        form_p: [1e-4, 0.0],
        form_r: [0.0, 1e-4],
        cutoff_squared: 9.0,
        path: PATH_AFFINE,
        columns: pack_range(0, 254 * SIDE),
        rows: pack_range(0, 256 * SIDE),
        ..Footprint::zeroed()
    };
    let input = Input {
        footprints: vec![everywhere; count as usize],
        exact: Vec::new(),
        surfels: Vec::new(),
        tiles,
    };
    let got = input.binned(gpu, &[whole(&input)], &[], 0).remove(0);
    assert_eq!(got.needed, count * MAX_BAND_TILES);
}
