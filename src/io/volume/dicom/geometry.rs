//! Arranges frames in space: chooses the frames of one volume, sorts them and computes the positions of its samples.
//!
//! Pixel (i, j) of a frame lies at `ImagePositionPatient` plus i steps along the first three numbers of
//! `ImageOrientationPatient` and j along the last three (PS3.3, C.7.6.2.1.1). Frames follow one another along the cross
//! product of these two directions.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::image::Slice;
use crate::data::dataset::{CurvilinearBlock, Geometry};
use crate::error::{Error, Result};
use crate::io::volume::voxels;
use crate::scene::{Lattice, LatticeSpacing};

/// Greatest distance of frames that count as being at one place, in pixels.
const SAME: f64 = 0.01;

/// Greatest offset of a frame from its place on a lattice, in steps. Files store positions as decimal numbers with few
/// digits.
const EVEN: f64 = 0.01;

/// Greatest difference between directions, and relative difference between steps, in one volume.
const ALIKE: f64 = 1e-3;

/// Greatest deviation of rows and columns from x and y for a lattice with planes at uneven coordinates.
const UPRIGHT: f64 = 1e-9;

/// Greatest number of bytes of nodes: this much for each byte of numbers, and a constant.
const NODES_PER_BYTE: usize = 12;
const LEAST_NODES: usize = 16 << 20;

/// Frames of one volume in order, and the positions of its samples.
pub(super) struct Placed {
    pub(super) slices: Vec<Slice>,
    pub(super) geometry: Geometry,
    pub(super) notes: Vec<String>,
}

/// Returns true if two frames can be layers of one volume.
fn are_alike(a: &Slice, b: &Slice) -> bool {
    let near = |a: DVec3, b: DVec3| a.distance(b) < ALIKE;
    let (one, other) = (&a.place, &b.place);
    let axes = match (one.axes, other.axes) {
        (Some(one), Some(other)) => near(one[0], other[0]) && near(one[1], other[1]),
        (None, None) => true,
        _ => false,
    };
    let is_step = |i: usize| (one.steps[i] - other.steps[i]).abs() <= ALIKE * one.steps[i];
    axes && one.size == other.size
        && one.position.is_some() == other.position.is_some()
        && a.components.len() == b.components.len()
        && is_step(0)
        && is_step(1)
}

/// Returns the largest set of frames that are alike, and the number of other frames.
fn largest(slices: Vec<Slice>) -> (Vec<Slice>, usize) {
    /// Greatest number of kinds of frames; a scout and some orientations need fewer. Each frame is compared with the
    /// first of each kind.
    const MOST_KINDS: usize = 64;
    let total = slices.len();
    let mut kinds: Vec<Vec<Slice>> = Vec::new();
    for slice in slices {
        match kinds.iter().position(|kind| are_alike(&kind[0], &slice)) {
            Some(i) => kinds[i].push(slice),
            None if kinds.len() < MOST_KINDS => kinds.push(vec![slice]),
            None => {}
        }
    }
    // The sort is stable, so the first of equally large sets is taken.
    kinds.sort_by_key(|kind| std::cmp::Reverse(kind.len()));
    let largest = kinds.into_iter().next().unwrap_or_default();
    let others = total - largest.len();
    (largest, others)
}

/// Arranges frames as one volume.
///
/// # Errors
/// The positions or steps span no volume, or frames at uneven distances would need too much memory.
pub(super) fn place(path: &Path, slices: Vec<Slice>, bytes_read: usize) -> Result<Placed> {
    let (mut slices, others) = largest(slices);
    let mut notes = Vec::new();
    if others > 0 {
        notes.push(format!(
            "{others} images of another size or orientation are left out."
        ));
    }
    let place = match slices.first() {
        Some(slice) => slice.place.clone(),
        None => {
            let advice = "give an image of the series";
            return Err(Error::format(path, "pixels", "an image", "none", advice));
        }
    };
    if !place.has_steps {
        notes.push("No distance between pixels is stated: it is taken for 1.".to_owned());
    }
    let [x, y] = place.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let normal = x.cross(y).normalize_or_zero();
    let steps = [x * place.steps[0], y * place.steps[1]];
    let is_placed = place.position.is_some() && place.axes.is_some();
    if is_placed {
        let along = |slice: &Slice| slice.place.position.unwrap_or_default().dot(normal);
        slices.sort_by(|a, b| along(a).total_cmp(&along(b)).then(a.order.cmp(&b.order)));
        let near = SAME * place.steps[0].min(place.steps[1]);
        let left_out = keep_first(&mut slices, |a, b| along(b) - along(a) <= near);
        if left_out > 0 {
            notes.push(format!(
                "{left_out} images at the places of others (other times, echoes or parts) are left out."
            ));
        }
    } else {
        slices.sort_by_key(|slice| slice.order);
    }
    let [width, height] = place.size;
    let dims = [width, height, slices.len()];
    let positions: Vec<DVec3> = slices.iter().filter_map(|s| s.place.position).collect();
    let lattice = |step: Option<DVec3>, origin: DVec3| {
        let steps: Vec<DVec3> = steps.into_iter().chain(step).collect();
        let place = "ImageOrientationPatient, PixelSpacing and positions";
        voxels::lattice(path, place, dims, origin, &steps).map(Geometry::Lattice)
    };
    let stated = place.distance.map(|distance| normal * distance.abs());
    let geometry = match (&positions[..], is_placed) {
        ([first, .., last], true) => {
            let step = (*last - *first) / (positions.len() - 1) as f64;
            let far = |(i, p): (usize, &DVec3)| p.distance(*first + step * i as f64);
            let is_even = |deviation: f64| deviation <= EVEN * step.length();
            if positions.iter().enumerate().map(far).all(is_even) {
                lattice(Some(step), *first)?
            } else {
                notes.push(uneven(&positions, normal));
                uneven_planes(path, dims, &positions, steps, bytes_read)?
            }
        }
        ([first, ..], _) if slices.len() == 1 => lattice(stated, *first)?,
        _ => {
            let step = stated.unwrap_or(normal * place.steps[0].min(place.steps[1]));
            if slices.len() > 1 {
                notes.push(format!(
                    "{} layers whose places are not stated, taken to lie {} apart in their order.",
                    slices.len(),
                    step.length()
                ));
            }
            lattice(Some(step), positions.first().copied().unwrap_or_default())?
        }
    };
    Ok(Placed {
        slices,
        geometry,
        notes,
    })
}

/// Keeps, of neighbouring frames at one place, the first in the order of images; returns the number of frames left out.
fn keep_first(slices: &mut Vec<Slice>, is_same: impl Fn(&Slice, &Slice) -> bool) -> usize {
    let before = slices.len();
    let mut kept: Vec<Slice> = Vec::new();
    for slice in slices.drain(..) {
        match kept.last_mut() {
            Some(last) if is_same(last, &slice) => {
                if slice.order < last.order {
                    *last = slice;
                }
            }
            _ => kept.push(slice),
        }
    }
    *slices = kept;
    before - slices.len()
}

fn uneven(positions: &[DVec3], normal: DVec3) -> String {
    let distances = positions.windows(2).map(|p| (p[1] - p[0]).dot(normal));
    let [least, most] = distances.fold([f64::INFINITY, 0.0_f64], |[least, most], distance| {
        [least.min(distance), most.max(distance)]
    });
    format!("Layers lie {least:.4} to {most:.4} apart, as the file states.")
}

/// Returns a lattice with planes at coordinates if rows and columns run along x and y, and nodes otherwise.
fn uneven_planes(
    path: &Path,
    dims: [usize; 3],
    positions: &[DVec3],
    [x, y]: [DVec3; 2],
    bytes_read: usize,
) -> Result<Geometry> {
    let [width, height, _] = dims;
    let first = positions.first().copied().unwrap_or_default();
    let is_along = |step: DVec3, axis: DVec3| step.distance(axis * step.length()) < UPRIGHT;
    let is_above = |p: &DVec3| (*p - first).truncate().length() <= EVEN * x.length();
    if is_along(x, DVec3::X) && is_along(y, DVec3::Y) && positions.iter().all(is_above) {
        let line = |start: f64, step: f64, count: usize| {
            (0..count).map(|i| start + step * i as f64).collect()
        };
        let coordinates = [
            line(first.x, x.x, width),
            line(first.y, y.y, height),
            positions.iter().map(|p| p.z).collect(),
        ];
        let spacing = LatticeSpacing::Rectilinear { coordinates };
        return Ok(Geometry::Lattice(Lattice { dims, spacing }));
    }
    let count = dims.into_iter().fold(1, usize::saturating_mul);
    let needed = count.saturating_mul(size_of::<DVec3>());
    let most = bytes_read.saturating_mul(NODES_PER_BYTE) + LEAST_NODES;
    if needed > most || !DMat3::from_cols(x, y, first).is_finite() {
        let expected = "layers at even distances, or along z";
        let found = format!("uneven ones, whose nodes take {needed} bytes");
        let advice = "resample the series, or take out the images that do not belong to it";
        return Err(Error::format(
            path,
            "ImagePositionPatient",
            expected,
            found,
            advice,
        ));
    }
    let mut nodes = Vec::with_capacity(count);
    for position in positions {
        for j in 0..height {
            let row = *position + y * j as f64;
            nodes.extend((0..width).map(|i| row + x * i as f64));
        }
    }
    let blocks = vec![CurvilinearBlock { dims, nodes }];
    Ok(Geometry::Curvilinear { blocks })
}
