//! Refines kernels: splits the dual cells of nodes where the transfer function and the field ask for it.
//!
//! A kernel stands for the field by one linear model. Where the interpolant between nodes departs from it (kinks,
//! curved surfaces in large cells, faces that bend), parts of the cell are nearer. An index a of a cell is split
//! into m = 2^L parts, each index by itself; [`rule`] chooses the levels L, for a picture's pixels. A part's kernel
//! has the position, the value and the Jacobian of the cell's interpolant at its centre, the factor's columns
//! divided by m, and the volume |det F| / prod m. Its local model has the interpolant's gradient; the prefilter is
//! taken along indices that are not split. Levels are graded ([`levels`]) and the kernels evened out ([`even`]).
//!
//! Parts and samples that the function does not show are left out: refined volumes belong to one function and one
//! view.

mod even;
pub(super) mod face;
mod levels;
mod neighbourhood;
mod outline;
pub(super) mod rule;

use glam::{DMat3, DVec3, Vec4Swizzles as _};
use rayon::prelude::*;

pub(super) use self::even::PASSES;
use self::even::{Volumes, offset, part, part_count};
use self::face::FaceNodes;
use self::levels::Extent;
use self::neighbourhood::Neighbourhood;
use self::outline::{Outline, each_outline, planes_of_slab};
use self::rule::{Rule, ShownValues};
use super::field::gradient::Samples;
use super::field::local_models::quadratic::Quadratic;
use super::field::local_models::{Range, local_model};
use super::kernels::Kernel;
use super::kernels::planes::edges;
use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::math::{lower_factor, lower_matrix, narrowed, normal_code};
use crate::sample::positions::index_u32;
use crate::scene::{Boundary, LocalModel, Particles, PointVolume, Strength, Values};
use crate::view::{Camera, Projection};

/// Number of planes beside a rank's own on which its parts depend: neighbours, grading, and the evening out.
pub(super) const PLANES: usize = 1 + rule::MOST_LEVEL as usize + 2 * (PASSES + 1);

/// Least displacement that kernels are refined for. Their own width hides smaller ones.
const LEAST_THRESHOLD_PX: f64 = 0.25;

/// Greatest number of parts of a volume: they take about a gigabyte while they are made.
pub(super) const MOST_PARTS: usize = 1 << 22;

/// Greatest number of times that a threshold is doubled.
const MOST_DOUBLINGS: usize = 12;

/// Reach of a part's kernel beyond which it takes no values, in standard deviations.
pub(super) const VALUE_REACH: f64 = 2.5;

/// Pictures for which kernels are refined.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Cameras of the pictures. Without any, nothing is refined.
    pub cameras: Vec<Camera>,
    /// Greatest displacement of a surface of equal value in a picture \[px\].
    pub threshold_px: f64,
}

impl Refinement {
    /// Returns the refinement that a tolerance of pictures asks for, without cameras yet: one pixel at 1/255, and a
    /// quarter of a pixel at least.
    pub fn for_tolerance(tolerance: f32) -> Self {
        Self {
            cameras: Vec::new(),
            threshold_px: (f64::from(tolerance) * 255.0).max(LEAST_THRESHOLD_PX),
        }
    }

    /// Returns the pixels per world unit at a point: the most of all pictures that show it.
    pub(super) fn px(&self, point: DVec3, margin: f64) -> f64 {
        let of = |camera: &Camera| {
            let p = camera.camera_point(point);
            let focal = camera.focal_px.max_element();
            let scale = match camera.projection {
                Projection::Orthographic => focal,
                // Kernels around the eye are as large as a picture.
                Projection::Perspective => focal / p.z.max(margin),
            };
            let at = camera.centre_px + p.truncate() * scale;
            let beyond = margin * scale;
            let is_seen = p.z > -margin
                && at.x > -beyond
                && at.y > -beyond
                && at.x < camera.width as f64 + beyond
                && at.y < camera.height as f64 + beyond;
            if is_seen { scale } else { 0.0 }
        };
        self.cameras.iter().map(of).fold(0.0, f64::max)
    }
}

/// A structured grid, and the particles of its nodes.
pub(super) trait RefinedGrid: Sync {
    /// Returns position and value of a node, if it has both. Nodes may include ghosts.
    fn node(&self, node: [usize; 3]) -> Option<(DVec3, f64)>;

    /// Returns the number of nodes along each index, and the periods of indices that close.
    fn extent(&self) -> ([usize; 3], [Option<usize>; 3]);

    /// Returns the particle of a node, if it has one.
    fn particle(&self, node: [usize; 3]) -> Option<usize>;

    /// Returns the volume of a particle's kernel, by which kernels of uneven cells are even.
    fn volume(&self, particle: usize) -> f64;

    /// Returns true for each index along which a face of the grid lies beside a node.
    fn beside(&self, node: [usize; 3]) -> [bool; 3];

    /// Returns the faces that may cut kernels of a node's dual cell.
    fn faces(&self, node: [usize; 3]) -> Vec<FaceNodes>;
}

/// Kernel of a part of a cell.
pub(super) struct Part {
    pub(super) kernel: Kernel,
    pub(super) value: f64,
    pub(super) model: LocalModel,
    pub(super) normal: u32,
    pub(super) edges: Option<[[f32; 4]; MOST_EDGES]>,
}

impl Part {
    /// Returns a part that no face cuts; `None` if the function does not show it, or if single precision does not hold
    /// it.
    ///
    /// - `position`, `lower`, `volume`: of its kernel, with the lower-triangular factor of the variance.
    /// - `value`, `range`: value of the field at its centre, and the values that the kernel may take.
    /// - `field`: derivatives of the field at its centre.
    pub(super) fn shown(
        rule: &Rule,
        (position, lower, volume): (DVec3, [f64; 6], f64),
        (value, range): (f64, [f64; 2]),
        field: &Quadratic,
    ) -> Option<Self> {
        let kernel = Kernel::new(position, lower, volume).ok()?;
        let [least, greatest] = range.map(narrowed);
        let own = narrowed(value);
        let matrix = lower_matrix(lower);
        let range = Range { least, greatest };
        let model = local_model(field, matrix, DVec3::ZERO, own, range, 1.0);
        let reached = model.reached(own, [least, greatest]);
        rule.shows(reached.map(f64::from)).then(|| Self {
            kernel,
            value,
            model,
            normal: normal_code(field.gradient),
            edges: None,
        })
    }
}

/// Standing of a node's dual cell.
#[derive(Clone, Copy, PartialEq)]
enum Asked {
    /// A node around is unknown: the cell is not split.
    Unknown,
    /// The function shows no value of the nodes around.
    Unshown,
    Shown,
}

/// Kernels of a refined grid.
pub(super) struct Refined {
    /// Greatest level of an index; 0 if no cell is split.
    pub(super) level: u8,
    /// Particles that parts replace, and those that the function does not show.
    pub(super) gone: Vec<usize>,
    /// Particles whose volumes change, and the factors.
    pub(super) evened: Vec<(usize, f64)>,
    pub(super) parts: Vec<Part>,
}

/// Returns true if any cell of a grid whose faces are flat asks to be split.
pub(super) fn asks<F: Fn([usize; 3]) -> Option<(DVec3, f64)> + Sync>(
    samples: &Samples<F>,
    shown: &ShownValues,
    refinement: &Refinement,
    kernel_width: f64,
) -> bool {
    let rule = Rule::new(shown, refinement.threshold_px, kernel_width);
    let (dims, periods) = (samples.dims, samples.periods);
    let extent = Extent { dims, periods };
    let asks = |n: usize, outline: Option<Outline>| {
        let px = |position, radius| refinement.px(position, radius);
        let is_whole = |own: Outline| rule.keeps_whole(&own, px(own.position, own.radius));
        if outline.is_some_and(is_whole) {
            return false;
        }
        let cell = Neighbourhood::new(samples, extent.node(n));
        let cell = cell.filter(|cell| rule.shows(cell.range));
        cell.is_some_and(|cell| {
            let px = px(cell.position(), cell.radius());
            rule.levels(&cell, px, [false; 3]) != [0; 3]
        })
    };
    let of_slab = planes_of_slab(&extent);
    let any_of_slab = |first: usize| {
        let mut any = false;
        each_outline(
            samples,
            first..dims[2].min(first + of_slab),
            |n, outline| {
                any = asks(n, outline);
                !any
            },
        );
        any
    };
    let slabs = (0..dims[2]).into_par_iter().step_by(of_slab);
    slabs.any(any_of_slab)
}

/// Finds levels that make no more parts than there is room for: the threshold is doubled until they do.
///
/// - `levels`: returns the levels under a rule, and the number of their parts.
///
/// # Errors
/// The errors of `levels`.
pub(super) fn within_budget<T>(
    (shown, refinement, kernel_width): (&ShownValues, &Refinement, f64),
    most: usize,
    mut levels: impl FnMut(&Rule) -> Result<(T, u64)>,
) -> Result<Option<(Rule, T)>> {
    let mut threshold_px = refinement.threshold_px;
    for _ in 0..MOST_DOUBLINGS {
        let rule = Rule::new(shown, threshold_px, kernel_width);
        let (found, count) = levels(&rule)?;
        if count <= most as u64 {
            return Ok(Some((rule, found)));
        }
        threshold_px *= 2.0;
    }
    Ok(None)
}

/// Splits the cells of a grid. Returns `None` if the parts would be too many whatever the threshold.
///
/// - `shown`: the values that pictures show.
/// - `reach`: number of nodes that kernels reach along an index.
/// - `is_wanted`: returns true for the particles whose parts are wanted.
/// - `most`: greatest number of parts.
/// - `total`: returns the sum of a number and those of all partitions.
///
/// # Errors
/// The errors of `total`.
pub(super) fn refine(
    grid: &impl RefinedGrid,
    (shown, refinement): (&ShownValues, &Refinement),
    (kernel_width, reach): (f64, isize),
    is_wanted: impl Fn(usize) -> bool + Sync,
    (most, total): (usize, &mut dyn FnMut(u64) -> Result<u64>),
) -> Result<Option<Refined>> {
    let (dims, periods) = grid.extent();
    let extent = Extent { dims, periods };
    let samples = Samples {
        dims,
        periods,
        at: |node| grid.node(node),
    };
    let neighbourhood = |n: usize| Neighbourhood::new(&samples, extent.node(n));
    let level = |n: usize, outline: Option<Outline>, rule: &Rule| {
        if let Some(own) = outline {
            if !rule.shows(own.range) {
                return ([0; 3], Asked::Unshown);
            }
            let px = refinement.px(own.position, own.radius);
            let is_beside = || grid.beside(extent.node(n)) != [false; 3];
            if rule.keeps_whole(&own, px) && !is_beside() {
                return ([0; 3], Asked::Shown);
            }
        }
        let Some(cell) = neighbourhood(n) else {
            return ([0; 3], Asked::Unknown);
        };
        if !rule.shows(cell.range) {
            return ([0; 3], Asked::Unshown);
        }
        let px = refinement.px(cell.position(), cell.radius());
        let levels = rule.levels(&cell, px, grid.beside(extent.node(n)));
        (levels, Asked::Shown)
    };
    let particle = |n: usize| grid.particle(extent.node(n)).filter(|&p| is_wanted(p));
    let levels = |rule: &Rule| {
        let mut found = vec![([0; 3], Asked::Unknown); extent.len()];
        let (of_plane, of_slab) = (dims[0] * dims[1], planes_of_slab(&extent));
        let slabs = found
            .par_chunks_mut((of_plane * of_slab).max(1))
            .enumerate();
        slabs.for_each(|(slab, found)| {
            let first = slab * of_slab;
            each_outline(
                &samples,
                first..dims[2].min(first + of_slab),
                |n, outline| {
                    found[n - first * of_plane] = level(n, outline, rule);
                    true
                },
            );
        });
        let (mut levels, asked): (Vec<[u8; 3]>, Vec<Asked>) = found.into_par_iter().unzip();
        if levels.par_iter().any(|level| *level != [0; 3]) {
            let may_split: Vec<bool> = asked.iter().map(|of| *of != Asked::Unknown).collect();
            extent.grade(&mut levels, &may_split);
        }
        let is_split = |n: &usize| levels[*n] != [0; 3] && particle(*n).is_some();
        let split = (0..extent.len()).into_par_iter().filter(is_split);
        let own: usize = split.map(|n| part_count(levels[n])).sum();
        Ok(((levels, asked), total(own as u64)?))
    };
    let found = within_budget((shown, refinement, kernel_width), most, levels)?;
    let Some((rule, (levels, asked))) = found else {
        return Ok(None);
    };
    let is_split = |n: usize| levels[n] != [0; 3];
    // Kernels reach values two nodes away.
    let mut unshown: Vec<bool> = asked.iter().map(|of| *of == Asked::Unshown).collect();
    if unshown.contains(&true) {
        unshown = extent.all_around(unshown);
    }
    let gone = (0..extent.len()).filter(|&n| is_split(n) || unshown[n]);
    let gone = gone.filter_map(particle).collect();
    if levels.iter().all(|level| *level == [0; 3]) {
        return Ok(Some(Refined {
            level: 0,
            gone,
            evened: Vec::new(),
            parts: Vec::new(),
        }));
    }
    let volumes = Volumes::new(&extent, &levels, kernel_width, reach);
    let whole = (0..extent.len()).filter(|&n| !is_split(n));
    let evened = whole.map(|n| (n, volumes.of(n, [0; 3], 0)));
    let evened = evened.filter(|(_, factor)| *factor != 1.0);
    let evened = evened
        .filter_map(|(n, factor)| Some((particle(n)?, factor)))
        .collect();
    let parts_of = |(n, particle): (usize, usize)| {
        let level = levels[n];
        let cell = neighbourhood(n);
        let (count, faces) = match cell {
            Some(_) => (part_count(level), grid.faces(extent.node(n))),
            None => (0, Vec::new()),
        };
        let own = cell.as_ref();
        let evening = own.map_or(1.0, |cell| evening(cell, level, grid.volume(particle)));
        let (rule, volumes) = (&rule, &volumes);
        (0..count).filter_map(move |p| {
            let of = volumes.of(n, level, p) * evening;
            part_of(rule, cell.as_ref()?, &faces, (level, p), of)
        })
    };
    let split = (0..extent.len()).into_par_iter().filter(|&n| is_split(n));
    let split = split.filter_map(|n| Some((n, particle(n)?)));
    let parts = split.flat_map_iter(parts_of).collect();
    let level = levels.iter().flatten().copied().max().unwrap_or(0);
    Ok(Some(Refined {
        level,
        gone,
        evened,
        parts,
    }))
}

/// Returns the factor by which parts of a cell are larger than their share of it, so that kernels of uneven cells are
/// even. The cell's own kernel has it for all indices. Cells that grow along an index by a factor exp(g) ask for it in
/// proportion to g², and parts have a fraction of the growth.
///
/// - `volume`: volume of the cell's own kernel.
fn evening(cell: &Neighbourhood, level: [u8; 3], volume: f64) -> f64 {
    /// Greatest factor of a volume: kernels of other shapes than their cells may have any.
    const MOST: f64 = 1.5;
    let jacobian = cell.place([None; 3]).jacobian;
    let whole = volume / jacobian.determinant().abs();
    let growth = |a: usize| {
        let along = jacobian.col(a);
        (cell.second(a).xyz().dot(along) / along.length_squared()).powi(2)
    };
    let [mut all, mut left] = [0.0; 2];
    for (a, level) in level.into_iter().enumerate() {
        all += growth(a);
        left += growth(a) / f64::from(1 << (2 * level));
    }
    let factor = whole.powf(left / all);
    // Phrased so that NaN and an even grid have none.
    match (1.0 / MOST..=MOST).contains(&factor) {
        true => factor,
        false => 1.0,
    }
}

/// Returns the kernel of a part; `None` if the function does not show it, or if it has no volume.
///
/// - `volume`: volume of the part in index space.
fn part_of(
    rule: &Rule,
    cell: &Neighbourhood,
    faces: &[FaceNodes],
    (level, n): ([u8; 3], usize),
    volume: f64,
) -> Option<Part> {
    let places = part(level, n);
    let offsets = [0, 1, 2].map(|a| (level[a] > 0).then(|| offset(level[a], places[a])));
    let widths = DVec3::from(level.map(|l| rule.kernel_width / f64::from(1 << l)));
    let around = cell.range_near(offsets, widths * VALUE_REACH);
    if !rule.shows(around) {
        return None;
    }
    let place = cell.place(offsets);
    let (gradient, hessian) = place.derivatives()?;
    let factor = place.jacobian * DMat3::from_diagonal(widths);
    let lower = lower_factor(factor);
    let volume = place.jacobian.determinant().abs() * volume;
    let field = Quadratic { gradient, hessian };
    let kernel = (place.position, lower, volume);
    let part = Part::shown(rule, kernel, (place.value, around), &field)?;
    let near = |face: &&FaceNodes| {
        let offset = offsets[face.axis].unwrap_or(0.0);
        face.is_near(offset, widths[face.axis])
    };
    let planes: Vec<[DVec3; 2]> = faces
        .iter()
        .filter(near)
        .filter_map(|face| face.plane(offsets))
        .collect();
    Some(Part {
        edges: edges(&planes, place.position, &factor),
        ..part
    })
}

/// Replaces particles of a volume by the parts of their cells, and leaves out those that the function does not show.
/// Returns the particles that stay, which come before the parts.
///
/// - `wanted`: the particles to keep, unless they are gone.
/// - `greatest`: returns the greatest of given scales and of those of all partitions.
///
/// # Errors
/// The errors of `greatest`.
pub(super) fn apply(
    volume: &mut PointVolume,
    all: Vec<Refined>,
    wanted: &[u32],
    greatest: &mut dyn FnMut([f32; 2]) -> Result<[f32; 2]>,
) -> Result<Vec<u32>> {
    let mut is_gone = vec![false; volume.particles.len()];
    for particle in all.iter().flat_map(|refined| &refined.gone) {
        is_gone[*particle] = true;
    }
    let stays = wanted.iter().copied().filter(|&i| !is_gone[i as usize]);
    let stays: Vec<u32> = stays.collect();
    if let Strength::Classified { volumes } = &mut volume.strength {
        for (particle, factor) in all.iter().flat_map(|refined| &refined.evened) {
            volumes[*particle] = narrowed(f64::from(volumes[*particle]) * factor);
        }
    }
    volume.gather(&stays);
    let parts: Vec<Part> = all.into_iter().flat_map(|refined| refined.parts).collect();
    let (Particles::Anisotropic { positions, factors }, Strength::Classified { volumes }) =
        (&mut volume.particles, &mut volume.strength)
    else {
        return Ok(stays);
    };
    positions.extend(parts.iter().map(|p| p.kernel.position));
    factors.extend(parts.iter().map(|p| p.kernel.factor));
    volumes.extend(parts.iter().map(|p| p.kernel.volume));
    // Values between those of nodes are no whole numbers.
    volume.values = volume.values.take().map(|values| match values {
        Values::F64(mut own) => {
            own.extend(parts.iter().map(|p| p.value));
            Values::F64(own)
        }
        own => {
            let kept = (0..own.len()).map(|i| own.get(i));
            let more = parts.iter().map(|p| narrowed(p.value));
            Values::F32(kept.chain(more).collect())
        }
    });
    if let Some(normals) = &mut volume.normals {
        normals.extend(parts.iter().map(|p| p.normal));
    }
    if let Some(models) = volume.local_models.take() {
        let more: Vec<_> = parts.iter().map(|p| (None, p.model)).collect();
        volume.local_models = Some(models.changed(&more, greatest)?);
    }
    if let Some(Boundary::Planes(planes)) = &mut volume.boundary {
        for part in &parts {
            let word = part.edges.map_or(0, |edges| {
                planes.edges.push(edges);
                index_u32(planes.edges.len())
            });
            planes.of_particle.push(word);
        }
    }
    Ok(stays)
}
