//! Stage: computes the mass and the colour of each particle from its value, once.
//!
//! In a block of points, only the run of particles with visible values is visited; the twin has a thread
//! for every particle anyway. Counting and emitting share one loop body ([`Visit`]), so that they cannot
//! disagree. [`shade`](super::shade) computes colours that depend on the view.

use std::ops::Range;

use rayon::prelude::*;

use crate::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid, Neighbours};
use crate::math::ein_share;
use crate::record::{BlockView, Carried, ClassifiedBy, ClassifiedParticle};
use crate::scene::{ColourIn, StrengthIn, ValuesIn};

/// Views per leaf of the parallel recursion.
const GRAIN: usize = 16;

/// Counts the visible particles of each view and assigns their positions: sets `count` and `first`,
/// returns the total.
pub fn count_classified(volume: &BlockedVolume, views: &mut [BlockView]) -> usize {
    count(&Classes::new(volume), views)
}

/// Fills the visible particles of all views; `out` has the length that [`count_classified`]
/// returned.
pub fn classify(volume: &BlockedVolume, views: &[BlockView], out: &mut [ClassifiedParticle]) {
    fill(&Classes::new(volume), 0, views, out);
}

/// Visits the visible particles of a block: the shared loop body of counting and emitting.
pub(super) trait Visit: Sync {
    /// Calls `emit(local, mass, carried)` for each visible particle of a block, in order.
    fn visit(&self, view: &BlockView, emit: impl FnMut(u32, f32, Carried));
}

/// Particles classified by the transfer function.
pub(super) struct Classes<'a> {
    volume: &'a BlockedVolume,
    table: Vec<[f32; 4]>,
}

impl<'a> Classes<'a> {
    pub(super) fn new(volume: &'a BlockedVolume) -> Self {
        Self {
            volume,
            table: byte_table(volume),
        }
    }
}

impl Visit for Classes<'_> {
    #[inline]
    fn visit(&self, view: &BlockView, mut emit: impl FnMut(u32, f32, Carried)) {
        let (volume, block) = (self.volume, view.block);
        if view.classified_by != ClassifiedBy::Neighbours as u32 {
            visit(volume, &self.table, block, emit);
            return;
        }
        let neighbours = Neighbours::new(volume, block);
        visit(volume, &self.table, block, |local, mass, carried| {
            if neighbours.show(local) {
                emit(local, mass, carried);
            }
        });
    }
}

/// As [`count_classified`], for any visit.
pub(super) fn count(particles: &impl Visit, views: &mut [BlockView]) -> usize {
    views.par_iter_mut().with_min_len(GRAIN).for_each(|view| {
        let mut count = 0;
        particles.visit(view, |_, _, _| count += 1);
        view.count = count;
    });
    let mut first = 0;
    for view in views {
        view.first = first;
        first += view.count;
    }
    first as usize
}

/// As [`classify`], for any visit; `first_view` is the number of the first of `views`.
pub(super) fn fill(
    particles: &impl Visit,
    first_view: u32,
    views: &[BlockView],
    out: &mut [ClassifiedParticle],
) {
    if views.len() > GRAIN {
        let middle = views.len() / 2;
        let (left, right) = views.split_at(middle);
        let (out_left, out_right) = out.split_at_mut((right[0].first - left[0].first) as usize);
        rayon::join(
            || fill(particles, first_view, left, out_left),
            || fill(particles, first_view + middle as u32, right, out_right),
        );
        return;
    }
    let mut out = out.iter_mut();
    for (v, view) in (first_view..).zip(views) {
        particles.visit(view, |local, mass, carried| {
            if let Some(particle) = out.next() {
                *particle = ClassifiedParticle {
                    view: v,
                    local,
                    mass,
                    carried,
                };
            }
        });
    }
}

/// Returns the transfer function at every byte, if values are bytes.
fn byte_table(volume: &BlockedVolume) -> Vec<[f32; 4]> {
    match (&volume.values, &volume.transfer_function) {
        (Some(ValuesIn::U8(_)), Some(transfer)) => (0..=u8::MAX)
            .map(|v| transfer.classify(f32::from(v)))
            .collect(),
        _ => Vec::new(),
    }
}

/// Calls `emit(local, mass, carried)` for each visible particle of a block, in order.
#[inline]
fn visit(
    volume: &BlockedVolume,
    table: &[[f32; 4]],
    block: u32,
    emit: impl FnMut(u32, f32, Carried),
) {
    let transfer = volume.transfer_function.as_ref();
    let of = |value: f32| transfer.map_or([0.0; 4], |t| t.classify(value));
    if let Some(merged) = &volume.merged {
        let values = volume.values.as_ref();
        visit_with(volume, block, |i| merged.classify(values, i), emit);
        return;
    }
    match &volume.values {
        None => visit_with(volume, block, |_| [0.0; 4], emit),
        Some(ValuesIn::U8(v)) if !table.is_empty() => {
            visit_with(volume, block, |i| table[v[i] as usize], emit);
        }
        Some(ValuesIn::U8(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(ValuesIn::I16(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(ValuesIn::U16(v)) => visit_with(volume, block, |i| of(f32::from(v[i])), emit),
        Some(ValuesIn::F32(v)) => visit_with(volume, block, |i| of(v[i]), emit),
        Some(values @ ValuesIn::F64(_)) => {
            visit_with(volume, block, |i| of(values.get(i)), emit);
        }
    }
}

#[inline]
fn visit_with(
    volume: &BlockedVolume,
    block: u32,
    class_of: impl Fn(usize) -> [f32; 4],
    mut emit: impl FnMut(u32, f32, Carried),
) {
    let uniform = match &volume.particles {
        BlockedParticles::Lattice(grid) => grid.uniform_volume(),
        _ => None,
    };
    let mut each = |local, i, cell: Option<(&BrickGrid, [usize; 3])>| {
        let class = class_of(i);
        let mass = match &volume.strength {
            StrengthIn::Classified { volumes } => {
                // Most cells of most volumes are rejected here.
                if !(class[3] > 0.0) {
                    return;
                }
                class[3]
                    * match cell {
                        Some((grid, cell)) => uniform.unwrap_or_else(|| grid.cell_volume(cell)),
                        None => volumes[i],
                    }
            }
            given => given.stored()[i],
        };
        // If members do not overlap, each is less opaque than their mean depth implies.
        let mass = match &volume.merged {
            Some(merged) if !merged.member_depths.is_empty() => {
                mass * ein_share(mass * merged.member_depths[i])
            }
            _ => mass,
        };
        if mass > 0.0 {
            // If slabs are classified, the function returns the value in the place of the colour.
            let [r, g, b, _] = class;
            emit(
                local,
                mass,
                Carried::of_colour(colour_of(volume, i, [r, g, b])),
            );
        }
    };
    match seen_run(volume, block) {
        Some((first, run)) => run.for_each(|local| each(local, (first + local) as usize, None)),
        None => volume.for_each_particle(block, each),
    }
}

/// Returns the colour of particle `i`; the colour of its class if colours are classified.
#[inline]
pub(super) fn colour_of(volume: &BlockedVolume, i: usize, class: [f32; 3]) -> [f32; 3] {
    match &volume.colour {
        ColourIn::Classified => class,
        ColourIn::PerParticle(colours) => colours[i],
        ColourIn::Uniform(colour) => *colour,
        // `shade` computes these.
        ColourIn::Harmonics { .. } => [0.0; 3],
    }
}

/// Returns the first particle of a block of points, and the range of particles that the transfer function
/// may leave visible. The block's values are sorted.
fn seen_run(volume: &BlockedVolume, block: u32) -> Option<(u32, Range<u32>)> {
    let (StrengthIn::Classified { .. }, Some(transfer), Some(values)) =
        (&volume.strength, &volume.transfer_function, &volume.values)
    else {
        return None;
    };
    // Each merged particle has a range of values.
    if matches!(volume.particles, BlockedParticles::Lattice(_)) || volume.merged.is_some() {
        return None;
    }
    let Block { first, count, .. } = volume.blocks[block as usize];
    let value = |i: usize| values.get(first as usize + i);
    let run = transfer.seen_run(count as usize, value);
    Some((first, run.start as u32..run.end as u32))
}
