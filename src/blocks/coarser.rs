//! Makes coarser lattices of lattices: levels of detail with half as many samples along each axis, which are lattices in
//! their own right and are drawn as such.
//!
//! A coarser sample is the mean over its cell, and the blur of that mean is undone. Kernels of a coarser lattice have
//! the width of *its* spacing, so they add up as evenly as those of the samples do. Merged kernels that keep the
//! moments of their members are too narrow for the distance between them, and their sum ripples by a tenth.
//!
//! Normals are averaged with the same weights. They need not be those of the values' gradients.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places on an axis are small numbers, and values are narrowed to f32 by design"
)]

use std::ops::Range;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::brick::Faces;
use super::volume::{BlockedParticles, BlockedVolume};
use crate::error::Result;
use crate::math::{normal_code, normal_of_code};
use crate::memory::no_room;
use crate::scene::{
    Boundary, ColourIn, Lattice, LatticeSpacing, Particles, PointVolume, Shared, Strength, Values,
    ValuesIn,
};
use crate::task::{Stage, Task};

/// Least number of samples along an axis that is coarsened.
const LEAST_ALONG_AXIS: usize = 8;

impl BlockedVolume {
    /// Returns the volume on a lattice of half as many samples along each axis. `None` for other volumes, for lattices
    /// that are small, that have samples without a value, or whose particles have masses or colours of their own.
    ///
    /// - `least`: least number of samples of a lattice that has coarser ones.
    ///
    /// # Errors
    /// The task is cancelled.
    pub(crate) fn coarser(&self, least: usize, task: Option<&Task>) -> Result<Option<PointVolume>> {
        let BlockedParticles::Lattice(grid) = &self.particles else {
            return Ok(None);
        };
        let Some(values) = &self.values else {
            return Ok(None);
        };
        if !self.has_values_alone() {
            return Ok(None);
        }
        let colour = match self.colour {
            ColourIn::Uniform(colour) => ColourIn::Uniform(colour),
            _ => ColourIn::Classified,
        };
        let ghosts = grid.faces().map(Faces::ghosts);
        let wide = grid.lattice();
        let axes = [0, 1, 2].map(|a| {
            let first = ghosts.map_or(0, |ghosts| ghosts[a]);
            Axis::new(first..wide.dims[a] - first, ghosts.is_some())
        });
        let dims = axes.each_ref().map(Axis::len);
        let count: usize = dims.iter().product();
        let columns = 1 + usize::from(self.normals.is_some());
        let bytes = (columns * count * size_of::<f32>()) as u64;
        if wide.len() < least || 2 * count > wide.len() || no_room(2 * bytes).is_some() {
            return Ok(None);
        }
        let lattice = coarser_lattice(wide, &axes);
        if lattice.validate().is_err() {
            return Ok(None);
        }
        let stage = Stage::new(task, "coarser lattice", columns * axes[2].len());
        let read = |range: Range<usize>, [line]: &mut [Vec<f32>; 1]| values.append_to(range, line);
        let values = means(read, |[value]| value, wide.dims, &axes, &stage)?;
        if !values.par_iter().all(|value| value.is_finite()) {
            return Ok(None);
        }
        let normals = match &self.normals {
            None => None,
            Some(codes) => {
                let read = |range: Range<usize>, lines: &mut [Vec<f32>; 3]| {
                    for code in &codes[range] {
                        let normal = normal_of_code(*code).to_array();
                        for (line, component) in lines.iter_mut().zip(normal) {
                            line.push(component);
                        }
                    }
                };
                let pack = |mean: [f32; 3]| normal_code(Vec3::from(mean).as_dvec3());
                Some(means(read, pack, wide.dims, &axes, &stage)?)
            }
        };
        Ok(Some(PointVolume {
            colour,
            values: Some(Values::F32(values)),
            normals,
            transfer_function: self.transfer_function.clone(),
            boundary: ghosts.map(|_| Boundary::Lattice),
            ..PointVolume::new(
                Particles::Lattice {
                    lattice,
                    kernel_width: grid.kernel_width(),
                },
                Strength::Classified {
                    volumes: Vec::new(),
                },
            )
        }))
    }
}

/// Means over a block of a coarser lattice.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct BlockError {
    /// Difference of the finer lattice's colours from those of the interpolated coarser values, in the channel of the
    /// greatest: extinction, or extinction times colour \[1/length\].
    pub(crate) error: f32,
    /// Extinction in blocks at an edge of the domain, 0 in others \[1/length\]. Kernels that are cut by two planes err by
    /// a part of it: each plane by itself is exact.
    pub(crate) at_edge: f32,
    /// Extinction \[1/length\].
    pub(crate) extinction: f32,
}

impl BlockedVolume {
    /// Estimates the error of each block of a coarser lattice under its transfer function, from a sixteenth of the finer
    /// samples. Empty for other volumes.
    ///
    /// - `finer`: the volume on the finer lattice, or any lattice before it.
    /// - `is_lit`: whether light falls on particles with normals. A normal that is off by an angle then counts as a
    ///   colour that is off by as many radians of itself.
    pub(crate) fn errors_against(&self, finer: &Self, is_lit: bool) -> Vec<BlockError> {
        let (BlockedParticles::Lattice(own), BlockedParticles::Lattice(fine)) =
            (&self.particles, &finer.particles)
        else {
            return Vec::new();
        };
        let (Some(values), Some(fine_values), Some(transfer)) =
            (&self.values, &finer.values, &self.transfer_function)
        else {
            return Vec::new();
        };
        if own.dims() == fine.dims() {
            return Vec::new();
        }
        let places = places_of(fine.lattice(), own.lattice());
        let dims = own.dims();
        let normals = match (&self.normals, &finer.normals) {
            (Some(own), Some(fine)) if is_lit => Some((own, fine)),
            _ => None,
        };
        let of_block = |brick: u32| {
            let cells = own.cells(brick);
            let ranges = [0, 1, 2].map(|a: usize| {
                let before = |end: usize| places[a].partition_point(|x| *x < end as f64 - 0.5);
                before(cells[a][0])..before(cells[a][1])
            });
            let [x, y, z] = ranges;
            let (mut error, mut extinction, mut count) = (0.0, 0.0, 0_u32);
            for k in z.step_by(2) {
                for j in y.clone().step_by(2) {
                    // Samples of neighbouring rows alternate.
                    for i in x.clone().skip(j / 2 % 2 + k % 4).step_by(4) {
                        let at = [places[0][i], places[1][j], places[2][k]];
                        let coarse = transfer.classify(interpolated(values, dims, at));
                        let sample = fine.index([i, j, k]);
                        let own = transfer.classify(fine_values.get(sample));
                        let differ = |c: usize| (own[c] * own[3] - coarse[c] * coarse[3]).abs();
                        let colour = differ(0).max(differ(1)).max(differ(2));
                        error += colour.max((own[3] - coarse[3]).abs());
                        if let (Some((codes, fine_codes)), true) = (normals, own[3] > 0.0) {
                            let brightest = own[0].max(own[1]).max(own[2]);
                            let coarse = normal_of_code(codes[nearest(dims, at)]);
                            let turned = turn(coarse, normal_of_code(fine_codes[sample]));
                            error += own[3] * brightest * turned;
                        }
                        extinction += own[3];
                        count += 1;
                    }
                }
            }
            let mean = |sum: f32| if count == 0 { 0.0 } else { sum / count as f32 };
            let (error, extinction) = (mean(error), mean(extinction));
            let is_at_face = |a: &usize| {
                let ghosts = own.faces().map_or(0, |faces| faces.ghosts()[*a]);
                ghosts > 0 && (cells[*a][0] <= ghosts || cells[*a][1] >= dims[*a] - ghosts)
            };
            let is_at_edge = (0..3).filter(is_at_face).count() >= 2;
            BlockError {
                error,
                at_edge: if is_at_edge { extinction } else { 0.0 },
                extinction,
            }
        };
        let blocks = self.blocks.par_iter();
        blocks.map(|block| of_block(block.first)).collect()
    }
}

/// Returns the places of a finer lattice's samples along each axis, in indices of a coarser one of the same axes.
fn places_of(fine: &Lattice, coarse: &Lattice) -> [Vec<f64>; 3] {
    match (&fine.spacing, &coarse.spacing) {
        (
            LatticeSpacing::Uniform { origin, step },
            LatticeSpacing::Uniform {
                origin: first,
                step: steps,
            },
        ) => {
            let inverse = steps.inverse();
            let begin = inverse * (*origin - *first);
            let each = inverse * *step;
            [0, 1, 2].map(|a| {
                let place = |i: usize| begin[a] + each.col(a)[a] * i as f64;
                (0..fine.dims[a]).map(place).collect()
            })
        }
        (
            LatticeSpacing::Rectilinear { coordinates },
            LatticeSpacing::Rectilinear {
                coordinates: others,
            },
        ) => [0, 1, 2].map(|a| {
            let line = &others[a];
            let place = |x: &f64| {
                let above = line.partition_point(|own| own <= x);
                let i = above.clamp(1, line.len().max(2) - 1);
                match line.get(i) {
                    Some(end) => (i - 1) as f64 + (x - line[i - 1]) / (end - line[i - 1]),
                    None => 0.0,
                }
            };
            coordinates[a].iter().map(place).collect()
        }),
        _ => Default::default(),
    }
}

/// Returns the index of the sample nearest to a place.
fn nearest(dims: [usize; 3], at: [f64; 3]) -> usize {
    let [i, j, k] = [0, 1, 2].map(|a| (at[a].max(0.0).round() as usize).min(dims[a] - 1));
    i + dims[0] * (j + dims[1] * k)
}

/// Returns the distance between two unit normals, whose signs do not matter to light; 1 if just one is zero.
fn turn(a: Vec3, b: Vec3) -> f32 {
    a.distance(b).min(a.distance(-b))
}

/// Returns the trilinear interpolant of a lattice's values; beyond the outermost samples, that at the nearest place.
fn interpolated(values: &ValuesIn<Shared>, dims: [usize; 3], at: [f64; 3]) -> f32 {
    let axis = |a: usize| {
        let last = dims[a] - 1;
        let at = at[a].clamp(0.0, last as f64);
        let first = (at as usize).min(last.saturating_sub(1));
        (first, (first + 1).min(last), (at - first as f64) as f32)
    };
    let [x, y, z] = [0, 1, 2].map(axis);
    let value = |i: usize, j: usize, k: usize| values.get(i + dims[0] * (j + dims[1] * k));
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |j: usize, k: usize| mix(value(x.0, j, k), value(x.1, j, k), x.2);
    let plane = |k: usize| mix(row(y.0, k), row(y.1, k), y.2);
    mix(plane(z.0), plane(z.1), z.2)
}

/// An axis of a coarser lattice.
#[derive(Debug)]
struct Axis {
    /// Place of the first sample and distance between samples, in indices of the finer lattice.
    first: f64,
    step: f64,
    /// Weights of finer samples for each sample.
    means: Vec<Mean>,
}

/// Weights of a run of samples, which add up to 1.
#[derive(Debug, Clone, PartialEq)]
struct Mean {
    first: usize,
    weights: Vec<f32>,
}

impl Axis {
    /// Divides the domain of some samples of an axis evenly among half as many, or keeps the samples if they are few.
    ///
    /// - `own`: the samples, without ghosts.
    /// - `has_faces`: whether the domain ends at the outermost samples. Otherwise it ends half a cell beyond.
    fn new(own: Range<usize>, has_faces: bool) -> Self {
        let count = own.len();
        if count < LEAST_ALONG_AXIS {
            let one = |first| Mean {
                first,
                weights: vec![1.0],
            };
            return Self {
                first: own.start as f64,
                step: 1.0,
                means: own.map(one).collect(),
            };
        }
        let (coarse, step, first) = if has_faces {
            let cells = (count - 1).div_ceil(2);
            (cells + 1, (count - 1) as f64 / cells as f64, 0.0)
        } else {
            let cells = count.div_ceil(2);
            let step = count as f64 / cells as f64;
            (cells, step, 0.5 * step - 0.5)
        };
        let boxes: Vec<Vec<(usize, f64)>> = (0..coarse)
            .map(|j| box_mean(first + step * j as f64, step, count))
            .collect();
        let mean = |j: usize| {
            let at = first + step * j as f64;
            let offset = |i: usize| i as f64 - at;
            let variance: f64 = boxes[j].iter().map(|(i, w)| w * offset(*i).powi(2)).sum();
            let undone = match j {
                0 => 0.0,
                _ if j + 1 == coarse => 0.0,
                _ => variance / (2.0 * step * step),
            };
            let beside = match undone {
                0.0 => j..=j,
                _ => j - 1..=j + 1,
            };
            let terms = beside.flat_map(|of| {
                let factor = match of == j {
                    true => 1.0 + 2.0 * undone,
                    false => -undone,
                };
                boxes[of].iter().map(move |(i, w)| (*i, factor * w))
            });
            let terms: Vec<(usize, f64)> = terms.collect();
            let begin = terms.iter().map(|(i, _)| *i).min().unwrap_or(0);
            let end = terms.iter().map(|(i, _)| i + 1).max().unwrap_or(1);
            let mut weights = vec![0.0; end - begin];
            for (i, weight) in terms {
                weights[i - begin] += weight;
            }
            Mean {
                first: own.start + begin,
                weights: weights.into_iter().map(|weight| weight as f32).collect(),
            }
        };
        Self {
            first: own.start as f64 + first,
            step,
            means: (0..coarse).map(mean).collect(),
        }
    }

    /// Number of samples.
    fn len(&self) -> usize {
        self.means.len()
    }
}

/// Returns the weights of samples 0 to `count` for the mean of their linear interpolant over an interval. Beyond the
/// outermost samples the interpolant is the odd continuation about them, so that means of linear values are exact.
fn box_mean(middle: f64, width: f64, count: usize) -> Vec<(usize, f64)> {
    // Integral of the hat of sample 0 up to x.
    let below = |x: f64| {
        let x = x.clamp(-1.0, 1.0);
        if x < 0.0 {
            0.5 * (1.0 + x).powi(2)
        } else {
            1.0 - 0.5 * (1.0 - x).powi(2)
        }
    };
    let (from, to) = (middle - 0.5 * width, middle + 0.5 * width);
    let last = count as isize - 1;
    let mut weights = Vec::new();
    for i in from.floor() as isize..=to.ceil() as isize {
        let weight = (below(to - i as f64) - below(from - i as f64)) / width;
        if weight == 0.0 {
            continue;
        }
        let face = i.clamp(0, last);
        if face == i {
            weights.push((i as usize, weight));
        } else {
            weights.push((face as usize, 2.0 * weight));
            weights.push(((2 * face - i) as usize, -weight));
        }
    }
    weights
}

/// Returns the positions of a coarser lattice's samples.
fn coarser_lattice(fine: &Lattice, axes: &[Axis; 3]) -> Lattice {
    let spacing = match &fine.spacing {
        LatticeSpacing::Uniform { origin, step } => {
            let first = axes.each_ref().map(|axis| axis.first);
            let steps = axes.each_ref().map(|axis| axis.step);
            LatticeSpacing::Uniform {
                origin: *origin + *step * DVec3::from(first),
                step: *step * DMat3::from_diagonal(steps.into()),
            }
        }
        LatticeSpacing::Rectilinear { coordinates } => {
            let of_axis = |a: usize| {
                let mean = |mean: &Mean| {
                    let line = &coordinates[a][mean.first..];
                    // Relative to the first, so that nothing cancels.
                    let terms = line.iter().zip(&mean.weights);
                    line[0]
                        + terms
                            .map(|(x, w)| (x - line[0]) * f64::from(*w))
                            .sum::<f64>()
                };
                axes[a].means.iter().map(mean).collect()
            };
            LatticeSpacing::Rectilinear {
                coordinates: [0, 1, 2].map(of_axis),
            }
        }
    };
    Lattice {
        dims: axes.each_ref().map(Axis::len),
        spacing,
    }
}

/// Returns the means of a lattice's columns for each sample of a coarser lattice.
///
/// - `read`: appends a range of samples to lines, one for each component.
/// - `pack`: makes a sample of the means of its components.
/// - `dims`: samples of the finer lattice along each axis, with ghosts.
///
/// # Errors
/// The task is cancelled.
fn means<const N: usize, T: Clone + Default + Send>(
    read: impl Fn(Range<usize>, &mut [Vec<f32>; N]) + Sync,
    pack: impl Fn([f32; N]) -> T + Sync,
    dims: [usize; 3],
    [x, y, z]: &[Axis; 3],
    stage: &Stage<'_>,
) -> Result<Vec<T>> {
    let [columns, rows, _] = dims;
    let plane = x.len() * y.len();
    let mut all = vec![T::default(); plane * z.len()];
    let planes = all.par_chunks_exact_mut(plane.max(1)).zip(&z.means);
    let lines = || [(); N].map(|()| Vec::<f32>::new());
    planes.for_each_init(
        || [lines(), lines(), lines()],
        |[read_lines, summed, halved], (out, mean)| {
            if !stage.goes_on() {
                return;
            }
            for line in summed.iter_mut() {
                line.clear();
                line.resize(columns * rows, 0.0);
            }
            for (k, weight) in (mean.first..).zip(&mean.weights) {
                let first = columns * rows * k;
                read_lines.iter_mut().for_each(Vec::clear);
                read(first..first + columns * rows, read_lines);
                for (line, sums) in read_lines.iter().zip(summed.iter_mut()) {
                    add_scaled(line, *weight, sums);
                }
            }
            for (summed, halved) in summed.iter().zip(halved.iter_mut()) {
                halved.clear();
                halved.resize(columns * y.len(), 0.0);
                for (mean, out) in y.means.iter().zip(halved.chunks_exact_mut(columns)) {
                    for (j, weight) in (mean.first..).zip(&mean.weights) {
                        add_scaled(&summed[j * columns..][..columns], *weight, out);
                    }
                }
            }
            for (row, out) in out.chunks_exact_mut(x.len()).enumerate() {
                for (mean, out) in x.means.iter().zip(out) {
                    let of_line = |line: &Vec<f32>| {
                        let terms = mean.weights.iter().zip(&line[row * columns + mean.first..]);
                        terms.map(|(weight, value)| weight * value).sum()
                    };
                    *out = pack(halved.each_ref().map(of_line));
                }
            }
            stage.advance(1);
        },
    );
    stage.check()?;
    Ok(all)
}

/// Adds `weight` times some values to sums.
fn add_scaled(values: &[f32], weight: f32, sums: &mut [f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TransferFunction;

    const DIMS: [usize; 3] = [66, 71, 64];

    fn slanted() -> Lattice {
        let columns = [[0.1, 0.0, 0.02], [0.01, 0.2, 0.0], [0.0, 0.03, 0.15]].map(DVec3::from);
        Lattice {
            dims: DIMS,
            spacing: LatticeSpacing::Uniform {
                origin: DVec3::new(3.0, -2.0, 7.0),
                step: DMat3::from_cols_array_2d(&columns.map(Into::into)),
            },
        }
    }

    fn uneven() -> Lattice {
        let line = |n: usize| (0..n).map(|i| (i as f64).powf(1.1)).collect();
        Lattice {
            dims: DIMS,
            spacing: LatticeSpacing::Rectilinear {
                coordinates: DIMS.map(line),
            },
        }
    }

    fn cells(lattice: &Lattice) -> impl Iterator<Item = DVec3> + '_ {
        let [x, y, z] = lattice.dims;
        let cell = move |n: usize| lattice.position([n % x, n / x % y, n / (x * y)]);
        (0..x * y * z).map(cell)
    }

    fn coarser(lattice: Lattice, values: Values, is_sharp: bool) -> Option<PointVolume> {
        let grey = TransferFunction::from_curves(|v| [v; 3], |v| v, [-50.0, 50.0], 1.0).unwrap();
        let volume = PointVolume {
            boundary: is_sharp.then_some(Boundary::Lattice),
            ..PointVolume::lattice(lattice, values, grey)
        };
        BlockedVolume::new(volume).coarser(1 << 18, None).unwrap()
    }

    #[test]
    fn linear_fields_stay_and_domains_stay() {
        let field = |p: DVec3| (1.0 + 0.5 * p.x - 0.3 * p.y + 0.2 * p.z) as f32;
        for lattice in [slanted(), uneven()] {
            for is_sharp in [false, true] {
                let values: Vec<f32> = cells(&lattice).map(field).collect();
                let found = coarser(lattice.clone(), Values::F32(values), is_sharp).unwrap();
                let Particles::Lattice {
                    lattice: found_lattice,
                    ..
                } = &found.particles
                else {
                    panic!("a lattice stays a lattice");
                };
                let expected_dims = match is_sharp {
                    true => [34, 36, 33],
                    false => [33, 36, 32],
                };
                assert_eq!(found_lattice.dims, expected_dims);
                let values = found.values.as_ref().unwrap();
                for (i, place) in cells(found_lattice).enumerate() {
                    let error = (values.get(i) - field(place)).abs();
                    assert!(error < 2e-4, "{place}: {error}");
                }
                let last = |lattice: &Lattice| lattice.position(lattice.dims.map(|n| n - 1));
                if is_sharp {
                    let ends = |lattice: &Lattice| [lattice.position([0; 3]), last(lattice)];
                    for (a, b) in ends(found_lattice).into_iter().zip(ends(&lattice)) {
                        assert!(a.distance(b) < 1e-9, "{a} {b}");
                    }
                } else if let LatticeSpacing::Uniform { .. } = &lattice.spacing {
                    let corner = |lattice: &Lattice| {
                        lattice.position([0; 3]) - 0.5 * lattice.step([0; 3]) * DVec3::ONE
                    };
                    assert!(corner(found_lattice).distance(corner(&lattice)) < 1e-9);
                    let volume = |lattice: &Lattice| {
                        lattice.step([0; 3]).determinant() * lattice.len() as f64
                    };
                    let ratio = volume(found_lattice) / volume(&lattice);
                    assert!((ratio - 1.0).abs() < 1e-9, "{ratio}");
                }
            }
        }
    }

    /// The blur of means is undone: a parabola's second difference of two times the step squared would add .5 or .25
    /// per axis.
    #[test]
    fn parabolas_stay_but_for_the_ends() {
        let lattice = Lattice::uniform([64; 3], DVec3::ZERO, DVec3::ONE);
        let field = |p: DVec3| (p.x * p.x) as f32;
        let values: Vec<f32> = cells(&lattice).map(field).collect();
        for is_sharp in [false, true] {
            let values = Values::F32(values.clone());
            let found = coarser(lattice.clone(), values, is_sharp).unwrap();
            let Particles::Lattice { lattice, .. } = &found.particles else {
                panic!("a lattice stays a lattice");
            };
            let values = found.values.as_ref().unwrap();
            for (i, place) in cells(lattice).enumerate() {
                let from_ends = place.x.min(63.0 - place.x);
                if from_ends > 4.0 {
                    assert!((values.get(i) - field(place)).abs() < 0.05, "{place}");
                }
            }
        }
    }

    /// Coarser normals are those of the field at the coarser samples: here of spheres about a point beyond the box.
    #[test]
    fn normals_are_averaged() {
        let lattice = Lattice::uniform([64, 66, 65], DVec3::ZERO, DVec3::ONE);
        let middle = DVec3::new(-40.0, 20.0, 100.0);
        let values = cells(&lattice).map(|p| p.distance(middle) as f32).collect();
        let normals = cells(&lattice).map(|p| normal_code(p - middle)).collect();
        let grey = TransferFunction::from_curves(|v| [v; 3], |v| v, [0.0, 200.0], 1.0).unwrap();
        for boundary in [None, Some(Boundary::Lattice)] {
            let volume = PointVolume {
                boundary,
                normals: Some(Vec::clone(&normals)),
                ..PointVolume::lattice(
                    lattice.clone(),
                    Values::F32(Vec::clone(&values)),
                    grey.clone(),
                )
            };
            let found = BlockedVolume::new(volume)
                .coarser(1 << 18, None)
                .unwrap()
                .unwrap();
            let Particles::Lattice { lattice, .. } = &found.particles else {
                panic!("a lattice stays a lattice");
            };
            for (place, code) in cells(lattice).zip(found.normals.unwrap()) {
                let expected = (place - middle).normalize();
                // Two roundings of codes, of .12 degrees each.
                let error = normal_of_code(code).as_dvec3().distance(expected);
                assert!(error < 0.005, "{place}: {error}");
            }
        }
    }

    #[test]
    fn lattices_that_are_small_or_have_holes_have_no_coarser_ones() {
        let lattice = Lattice::uniform([63; 3], DVec3::ZERO, DVec3::ONE);
        let values = vec![1.0; lattice.len()];
        assert_eq!(coarser(lattice, Values::F32(values), false), None);
        let lattice = Lattice::uniform([64; 3], DVec3::ZERO, DVec3::ONE);
        let mut values = vec![1.0; lattice.len()];
        assert!(coarser(lattice.clone(), Values::F32(values.clone()), false).is_some());
        values[70_000] = f32::NAN;
        assert_eq!(coarser(lattice, Values::F32(values), false), None);
        // Few samples along one axis stay.
        let flat = Lattice::uniform([600, 500, 3], DVec3::ZERO, DVec3::ONE);
        let values = vec![2u8; flat.len()];
        let found = coarser(flat, Values::U8(values), true).unwrap();
        let Particles::Lattice { lattice, .. } = &found.particles else {
            panic!("a lattice stays a lattice");
        };
        assert_eq!(lattice.dims, [301, 251, 3]);
        assert!((found.values.unwrap().get(9) - 2.0).abs() < 1e-5);
    }
}
