//! Stage: from values to masses and colours, per particle, once.
//!
//! Counting and emitting share one loop body ([`visit`]), so that they cannot disagree. Colours
//! that depend on the view are left to [`shade`](super::shade).

use rayon::prelude::*;

use crate::blocks::{BlockedParticles, BlockedVolume, BrickGrid};
use crate::layout::{BlockView, ClassifiedParticle};
use crate::scene::{Colour, Strength, Values};

/// Views per leaf of the parallel recursion.
const GRAIN: usize = 16;

/// Counts the visible particles of each view and lays out their places: sets `count` and `first`,
/// returns the total.
pub fn count_classified(volume: &BlockedVolume, views: &mut [BlockView]) -> usize {
    let table = byte_table(volume);
    views.par_iter_mut().with_min_len(GRAIN).for_each(|view| {
        let mut count = 0;
        visit(volume, &table, view.block, |_, _, _| count += 1);
        view.count = count;
    });
    let mut first = 0;
    for view in views {
        view.first = first;
        first += view.count;
    }
    first as usize
}

/// Fills the visible particles of all views; `out` has the length that [`count_classified`]
/// returned.
pub fn classify(volume: &BlockedVolume, views: &[BlockView], out: &mut [ClassifiedParticle]) {
    fill(volume, &byte_table(volume), 0, views, out);
}

fn fill(
    volume: &BlockedVolume,
    table: &[[f32; 4]],
    first_view: u32,
    views: &[BlockView],
    out: &mut [ClassifiedParticle],
) {
    if views.len() > GRAIN {
        let middle = views.len() / 2;
        let (left, right) = views.split_at(middle);
        let (out_left, out_right) = out.split_at_mut((right[0].first - left[0].first) as usize);
        rayon::join(
            || fill(volume, table, first_view, left, out_left),
            || fill(volume, table, first_view + middle as u32, right, out_right),
        );
        return;
    }
    let mut out = out.iter_mut();
    for (v, view) in (first_view..).zip(views) {
        visit(volume, table, view.block, |local, mass, colour| {
            if let Some(particle) = out.next() {
                *particle = ClassifiedParticle {
                    view: v,
                    local,
                    mass,
                    colour,
                };
            }
        });
    }
}

/// The transfer function at every byte, where values are bytes.
fn byte_table(volume: &BlockedVolume) -> Vec<[f32; 4]> {
    match (&volume.values, &volume.transfer_function) {
        (Some(Values::U8(_)), Some(transfer)) => (0..=u8::MAX)
            .map(|v| transfer.classify(f32::from(v)))
            .collect(),
        _ => Vec::new(),
    }
}

/// Calls `emit(local, mass, colour)` for each visible particle of a block, in order.
#[inline]
fn visit(
    volume: &BlockedVolume,
    table: &[[f32; 4]],
    block: u32,
    emit: impl FnMut(u32, f32, [f32; 3]),
) {
    let transfer = volume.transfer_function.as_ref();
    let of = |value: f32| transfer.map_or([0.0; 4], |t| t.classify(value));
    match &volume.values {
        None => visit_with(volume, block, |_| [0.0; 4], emit),
        Some(Values::U8(v)) if !table.is_empty() => {
            visit_with(volume, block, |i| table[v[i] as usize], emit);
        }
        Some(Values::U8(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(Values::I16(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(Values::U16(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(Values::F32(v)) => visit_with(volume, block, |i| of(v[i]), emit),
    }
}

#[inline]
fn visit_with(
    volume: &BlockedVolume,
    block: u32,
    class_of: impl Fn(usize) -> [f32; 4],
    mut emit: impl FnMut(u32, f32, [f32; 3]),
) {
    let colour_of = |i: usize, class: [f32; 4]| match &volume.colour {
        Colour::Classified => [class[0], class[1], class[2]],
        Colour::PerParticle(colours) => colours[i],
        Colour::Uniform(colour) => *colour,
        // `shade` fills these in.
        Colour::Harmonics { .. } => [0.0; 3],
    };
    match &volume.particles {
        BlockedParticles::Lattice(grid) => {
            let cells = grid.cells(block);
            let corner = [cells[0][0], cells[1][0], cells[2][0]];
            let uniform = grid.uniform_volume();
            for k in cells[2][0]..cells[2][1] {
                for j in cells[1][0]..cells[1][1] {
                    let row = grid.index([cells[0][0], j, k]);
                    for x in 0..cells[0][1] - cells[0][0] {
                        let i = row + x;
                        let class = class_of(i);
                        let mass = match &volume.strength {
                            Strength::Classified { .. } => {
                                // Most cells of most volumes end here.
                                if !(class[3] > 0.0) {
                                    continue;
                                }
                                let cell = [corner[0] + x, j, k];
                                class[3] * uniform.unwrap_or_else(|| grid.cell_volume(cell))
                            }
                            Strength::Mass(masses) => masses[i],
                            Strength::PeakOpacity { opacities, .. } => opacities[i],
                        };
                        if mass > 0.0 {
                            let local = BrickGrid::local(corner, [corner[0] + x, j, k]);
                            emit(local, mass, colour_of(i, class));
                        }
                    }
                }
            }
        }
        BlockedParticles::Isotropic { .. } | BlockedParticles::Anisotropic { .. } => {
            let b = &volume.blocks[block as usize];
            for local in 0..b.count {
                let i = (b.first + local) as usize;
                let class = class_of(i);
                let mass = match &volume.strength {
                    Strength::Classified { volumes } => class[3] * volumes[i],
                    Strength::Mass(masses) => masses[i],
                    Strength::PeakOpacity { opacities, .. } => opacities[i],
                };
                if mass > 0.0 {
                    emit(local, mass, colour_of(i, class));
                }
            }
        }
    }
}
