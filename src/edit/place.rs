//! Data sets resized, turned and moved.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::columns::{self, narrowed};
use super::select::{Turned, reselect};
use crate::error::{Error, Result};
use crate::io::{
    Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry, Mesh, SplatCloud,
};
use crate::math::HarmonicsTransform;
use crate::scene::{Lattice, LatticeSpacing, Values};

/// How far an element of a rotation matrix may be from 0 or 1 to be that: quarter turns by quaternions of f64 are off
/// by some 4e-16.
const SNAP: f64 = 1e-14;

/// Where data go: about the origin resized, then turned, then moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// What lengths are multiplied by; above 0.
    pub size: f64,
    /// The turn, right-handed; of any length but zero.
    pub rotation: DQuat,
    /// What is added in the end, world units.
    pub translation: DVec3,
}

impl Default for Placement {
    /// Where the data are.
    fn default() -> Self {
        Self {
            size: 1.0,
            rotation: DQuat::IDENTITY,
            translation: DVec3::ZERO,
        }
    }
}

impl Placement {
    /// Where a point goes.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.matrix() * (self.size * point) + self.translation
    }

    /// The rotation; exact where it takes axes to axes.
    fn matrix(&self) -> DMat3 {
        let matrix = DMat3::from_quat(self.rotation.normalize());
        let near = |x: f64| (x - x.round()).abs() <= SNAP;
        if matrix.to_cols_array().into_iter().all(near) {
            // Zeros without a sign.
            DMat3::from_cols_array(&matrix.to_cols_array().map(|x| x.round() + 0.0))
        } else {
            matrix
        }
    }

    fn validate(&self) -> Result<()> {
        let length = self.rotation.length();
        let is_sound = self.size > 0.0
            && self.size.is_finite()
            && length > 0.0
            && length.is_finite()
            && self.translation.is_finite();
        if is_sound {
            return Ok(());
        }
        Err(Error::invalid(
            "placement",
            "numbers",
            "a size above 0, a rotation that is not zero, all finite",
            format!("{} {} {}", self.size, self.rotation, self.translation),
            "correct them",
        ))
    }
}

/// Whether a rotation of [`Placement::matrix`] takes axes to axes.
pub(super) fn is_of_axes(rotation: DMat3) -> bool {
    let is_whole = |x: f64| (x - x.round()).abs() <= 0.0;
    rotation.to_cols_array().into_iter().all(is_whole)
}

/// A data set resized, turned and moved.
///
/// - **Lattices** stay lattices. One with uneven coordinates becomes a curvilinear grid where it is turned by other
///   than quarter turns about axes. An axis with a single uneven sample is still one world unit wide.
/// - **Grids, unstructured cells and meshes**: their nodes and corners, and the normals of meshes.
/// - **Splats**: scales, rotations, and the harmonics of their colours, exactly.
/// - **Particles**: lengths (smoothing lengths, standard deviations, variances, scales and rotations) and
///   what the sampler multiplies by lengths: `volume` by size³, `mass` (extinction times volume) by size², `extinction`
///   by 1 / size, so that a picture stays the same as seen by an eye that is placed likewise. Physical masses (`m`)
///   stay, and densities, which are shown, keep their values: volumes are masses over densities times
///   [`Dataset::volume_scale`]. Variances that are turned by other than quarter turns become `scale_0..2` and
///   `rot_0..3`.
/// - **Fields** keep their values, but vectors of three components, which turn. Colours do not, nor do bytes,
///   tensors, and scalars of which a vector is made up (`vx`, `vy`, `vz` of a table).
/// - **What is up** turns ([`Dataset::up`]).
///
/// Lengths that are stated elsewhere (a transfer function's unit distance) are world units after the move.
///
/// # Errors
/// Those of [`Dataset::validate`], before and after; a size that is not positive, numbers that are not finite; an uneven
/// lattice with a single sample along an axis, turned by other than quarter turns.
pub fn place(mut dataset: Dataset, placement: &Placement) -> Result<Dataset> {
    placement.validate()?;
    dataset.validate()?;
    let rotation = placement.matrix();
    let up = dataset.up();
    dataset.format_up = Some((rotation * up.direction, up.reason));
    let turns = rotation != DMat3::IDENTITY;
    if turns {
        turn_vectors(&mut dataset.fields, rotation);
    }
    let to = |positions: &mut Vec<DVec3>| {
        let apply = |p: &mut DVec3| *p = rotation * (placement.size * *p) + placement.translation;
        positions.par_iter_mut().for_each(apply);
    };
    match &mut dataset.geometry {
        Geometry::Lattice(lattice) => {
            let lattice = lattice.clone();
            place_lattice(&mut dataset, lattice, placement, rotation)?;
        }
        Geometry::Curvilinear { blocks } => blocks.iter_mut().for_each(|b| to(&mut b.nodes)),
        Geometry::Cells(mesh) => to(&mut mesh.nodes),
        Geometry::Points { positions } => {
            to(positions);
            columns::place(&mut dataset, placement.size, rotation);
        }
        Geometry::Splats(cloud) => {
            to(&mut cloud.positions);
            place_splats(cloud, placement.size, rotation);
        }
        Geometry::Mesh(mesh) => {
            mesh.parts.iter_mut().for_each(|p| to(&mut p.positions));
            turn_normals(mesh, rotation);
        }
    }
    dataset.validate()?;
    Ok(dataset)
}

/// Turns the fields that are vectors in space.
fn turn_vectors(fields: &mut [Field], rotation: DMat3) {
    for field in fields.iter_mut().filter(|field| !field.is_colour()) {
        let FieldSource::Vector(components) = &mut field.source else {
            continue;
        };
        let [x, y, z] = components.as_slice() else {
            continue;
        };
        if [x, y, z].iter().any(|v| matches!(v, Values::U8(_))) {
            continue;
        }
        let mut turned = [(); 3].map(|()| Vec::with_capacity(x.len()));
        for i in 0..x.len() {
            let v = DVec3::from([x, y, z].map(|v| f64::from(v.get(i))));
            for (column, x) in turned.iter_mut().zip((rotation * v).to_array()) {
                column.push(narrowed(x));
            }
        }
        *components = turned.map(Values::F32).into();
    }
}

fn place_lattice(
    dataset: &mut Dataset,
    lattice: Lattice,
    placement: &Placement,
    rotation: DMat3,
) -> Result<()> {
    let Lattice { dims, spacing } = &lattice;
    let coordinates = match spacing {
        LatticeSpacing::Uniform { origin, step } => {
            dataset.geometry = Geometry::Lattice(Lattice {
                dims: *dims,
                spacing: LatticeSpacing::Uniform {
                    origin: placement.apply(*origin),
                    step: rotation * *step * placement.size,
                },
            });
            return Ok(());
        }
        LatticeSpacing::Rectilinear { coordinates } => coordinates,
    };
    if is_of_axes(rotation) {
        let turned = turned_axes(rotation, *dims);
        let moved = [0, 1, 2].map(|new| {
            let line = &coordinates[turned.axes[new]];
            let sign = if turned.is_reversed[new] { -1.0 } else { 1.0 };
            let moved = |x: &f64| sign * (placement.size * x) + placement.translation[new];
            let mut line: Vec<f64> = line.iter().map(moved).collect();
            if turned.is_reversed[new] {
                line.reverse();
            }
            line
        });
        dataset.geometry = Geometry::Lattice(Lattice {
            dims: turned.dims,
            spacing: LatticeSpacing::Rectilinear { coordinates: moved },
        });
        if rotation != DMat3::IDENTITY {
            let of_cells = Turned {
                dims: turned.dims.map(|n| n.max(2) - 1),
                ..turned
            };
            reselect(dataset, |association| {
                let turned = match association {
                    Association::Nodes => &turned,
                    Association::Cells => &of_cells,
                };
                (turned, turned.dims.iter().product())
            });
        }
        return Ok(());
    }
    if dims.contains(&1) {
        return Err(Error::format(
            &dataset.path,
            "rotation",
            "quarter turns about axes, for a rectilinear grid with one sample along an axis",
            "another angle",
            "turn the camera instead: --azimuth, --elevation, --up",
        ));
    }
    let [x, y, z] = *dims;
    let node = |i: usize| {
        let index = [i % x, i / x % y, i / x / y];
        placement.apply(lattice.position(index))
    };
    let nodes = (0..x * y * z).into_par_iter().map(node).collect();
    let blocks = vec![CurvilinearBlock { dims: *dims, nodes }];
    dataset.geometry = Geometry::Curvilinear { blocks };
    Ok(())
}

/// How the indices of an array go with its axes.
fn turned_axes(rotation: DMat3, dims: [usize; 3]) -> Turned {
    let (mut axes, mut is_reversed) = ([0; 3], [false; 3]);
    for new in 0..3 {
        let row = rotation.row(new);
        for old in (0..3).filter(|&old| row[old].abs() > 0.5) {
            (axes[new], is_reversed[new]) = (old, row[old] < 0.0);
        }
    }
    Turned {
        dims: axes.map(|old| dims[old]),
        axes,
        is_reversed,
    }
}

fn place_splats(cloud: &mut SplatCloud, size: f64, rotation: DMat3) {
    for scale in cloud.scales.as_flattened_mut() {
        *scale = narrowed(f64::from(*scale) * size);
    }
    if rotation == DMat3::IDENTITY {
        return;
    }
    let by = DQuat::from_mat3(&rotation);
    for quaternion in &mut cloud.rotations {
        let [w, x, y, z] = quaternion.map(f64::from);
        let q = by * DQuat::from_xyzw(x, y, z, w);
        *quaternion = [q.w, q.x, q.y, q.z].map(narrowed);
    }
    if cloud.harmonics_degree > 0 {
        let transform = HarmonicsTransform::new(rotation.transpose());
        let stride = cloud.harmonics_stride();
        cloud
            .harmonics
            .par_chunks_mut(stride)
            .for_each(|coefficients| transform.apply(coefficients));
    }
}

fn turn_normals(mesh: &mut Mesh, rotation: DMat3) {
    for normal in mesh.parts.iter_mut().flat_map(|part| &mut part.normals) {
        *normal = (rotation * normal.as_dvec3()).as_vec3();
    }
}
