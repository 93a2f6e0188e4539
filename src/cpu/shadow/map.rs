//! Finds the opaque surface nearest to a light at each texel of a map.

use glam::Vec2;
use rayon::prelude::*;

use super::grid::{middles, strips};
use super::occluder::{Occluder, REACH};

/// Rows of texels of a strip.
const STRIP: usize = 16;

/// Coverage from which a surface hides the light. Surfels' weights fall across a surface's edge from 1 to 0,
/// and are one half at the edge.
const COVERED: f32 = 0.5;

/// Surfaces that are looked at behind one another, if the nearer do not cover a texel.
const LAYERS: usize = 4;

/// Squared reach of a surfel whose depth starts a surface, standard deviations. Farther out a surfel of a
/// curved surface leaves it.
const START: f32 = 4.0;

/// Squared reach within which a surfel has weight.
const END: f32 = 9.0;

/// The nearest surface of each texel.
pub(super) struct Map {
    /// Texels; `f32::MAX` for none.
    pub(super) depths: Vec<f32>,
}

/// A texel while its surface is looked for.
#[derive(Debug, Clone, Copy)]
struct Texel {
    /// Depth at which the surface before ended.
    passed: f32,
    /// Depth at which the surface begins.
    nearest: f32,
    /// Sums of weights, and of depths times weights.
    weight: f32,
    depth: f32,
    is_done: bool,
}

impl Map {
    pub(super) fn new(size: [u32; 2], surfels: &[Occluder]) -> Self {
        let [columns, rows] = size.map(|n| n as usize);
        let lists = strips(surfels, rows, STRIP);
        let mut depths = vec![f32::MAX; columns * rows];
        depths
            .par_chunks_mut(STRIP * columns)
            .zip(lists)
            .enumerate()
            .for_each(|(n, (out, list))| {
                let surfels = list.iter().map(|i| &surfels[*i as usize]);
                fill(n * STRIP, columns, surfels, out);
            });
        Self { depths }
    }
}

/// Fills a strip of texels.
fn fill<'a>(
    first_row: usize,
    columns: usize,
    surfels: impl Iterator<Item = &'a Occluder> + Clone,
    out: &mut [f32],
) {
    let blank = Texel {
        passed: f32::MIN,
        nearest: f32::MAX,
        weight: 0.0,
        depth: 0.0,
        is_done: false,
    };
    let mut texels = vec![blank; out.len()];
    for _ in 0..LAYERS {
        each(
            first_row,
            columns,
            surfels.clone(),
            START,
            &mut texels,
            |texel, z, gap, _| {
                if z > texel.passed + gap {
                    texel.nearest = texel.nearest.min(z);
                }
            },
        );
        each(
            first_row,
            columns,
            surfels.clone(),
            END,
            &mut texels,
            |texel, z, gap, weight| {
                if z > texel.passed + gap && z <= texel.nearest + gap {
                    texel.weight += weight;
                    texel.depth += weight * z;
                }
            },
        );
        let mut is_any = false;
        for (texel, out) in texels.iter_mut().zip(&mut *out) {
            if texel.is_done {
                continue;
            }
            let covers = texel.weight >= COVERED;
            if covers {
                *out = texel.depth / texel.weight;
            }
            texel.is_done = covers || texel.nearest == f32::MAX;
            is_any |= !texel.is_done;
            *texel = Texel {
                passed: texel.nearest,
                is_done: texel.is_done,
                ..blank
            };
        }
        if !is_any {
            break;
        }
    }
}

/// Calls `of` for each surfel at each texel that is not done, with the surfel's depth there, the distance
/// within which surfels are of the same surface, and its weight.
fn each<'a>(
    first_row: usize,
    columns: usize,
    surfels: impl Iterator<Item = &'a Occluder>,
    end: f32,
    texels: &mut [Texel],
    mut of: impl FnMut(&mut Texel, f32, f32, f32),
) {
    let rows = first_row..first_row + texels.len() / columns;
    for surfel in surfels {
        let [a, b, c] = surfel.form;
        let half = surfel.half * (end.sqrt() / REACH);
        let slope = surfel.slope;
        // Neighbours overlap at up to two deviations along a slope, and at a texel's difference across.
        let gap = 1.0 + 0.7 * (slope.x * half.x).hypot(slope.y * half.y);
        let down = middles(surfel.centre.y, half.y, rows.end);
        for y in down.start.max(rows.start)..down.end {
            for x in middles(surfel.centre.x, half.x, columns) {
                let texel = &mut texels[(y - rows.start) * columns + x];
                if texel.is_done {
                    continue;
                }
                let d = Vec2::new(x as f32, y as f32) + 0.5 - surfel.centre.truncate();
                let q = a * d.x * d.x + 2.0 * b * d.x * d.y + c * d.y * d.y;
                if q < end {
                    let z = surfel.centre.z + slope.dot(d);
                    of(texel, z, gap, surfel.peak * (-0.5 * q).exp());
                }
            }
        }
    }
}
