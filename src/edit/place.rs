//! Resizes, rotates and translates data sets.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::columns::{self, even, is_of_axes};
use super::select::{Turned, reselect};
use crate::data::association::Association;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::data::mesh::Mesh;
use crate::data::splats::SplatCloud;
use crate::data::spz_records::Change;
use crate::error::{Error, Result};
use crate::math::{narrowed, rotation_matrix, scales_and_rotation};
use crate::scene::{Lattice, LatticeSpacing, Values};

/// Placement of data: scaling about the origin, then rotation, then translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Factors of lengths along x, y and z; above 0.
    pub size: DVec3,
    /// Rotation, right-handed; a quaternion of any length but zero.
    pub rotation: DQuat,
    /// Translation, world units.
    pub translation: DVec3,
}

impl Default for Placement {
    /// Returns the identity.
    fn default() -> Self {
        Self {
            size: DVec3::ONE,
            rotation: DQuat::IDENTITY,
            translation: DVec3::ZERO,
        }
    }
}

impl Placement {
    /// Returns the position of a point after the placement.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.matrix() * (self.size * point) + self.translation
    }

    /// Returns the rotation matrix, exact if it maps axes to axes.
    fn matrix(&self) -> DMat3 {
        rotation_matrix(self.rotation)
    }

    fn validate(&self) -> Result<()> {
        let length = self.rotation.length();
        let is_sound = self.size.min_element() > 0.0
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
            "sizes above 0, a rotation that is not zero, all finite",
            format!("{} {} {}", self.size, self.rotation, self.translation),
            "correct them",
        ))
    }
}

/// Resizes, rotates and translates a data set.
///
/// - **Lattices** stay lattices. One with uneven coordinates becomes a curvilinear grid, unless the rotation consists
///   of quarter turns about axes. An axis with a single uneven sample keeps a width of one world unit.
/// - **Grids, unstructured cells and meshes**: nodes and corners, and the normals of meshes, are transformed.
/// - **Splats**: scales, rotations and harmonics of colours are transformed exactly. Only the rotation affects colours.
/// - **Particles**: lengths (smoothing lengths, standard deviations, variances, scales and rotations) are transformed.
///   So are quantities that the sampler multiplies by lengths: `volume` by size³, `mass` (extinction times volume) by
///   size², `extinction` by 1 / size. A picture then looks the same from a camera that is placed likewise. Physical
///   masses (`m`) stay. Densities keep their values, because pictures show them. Volumes are masses over densities
///   times [`Dataset::volume_scale`]. Variances become `scale_0..2` and `rot_0..3`, unless the rotation consists of
///   quarter turns. If the three sizes differ, these factors use their geometric mean, and lengths are refused, because
///   their kernels would no longer be round.
/// - **Fields** keep their values, except vectors of three components, which are rotated. Colours, bytes, tensors, and
///   scalars that together form a vector (`vx`, `vy`, `vz` of a table) are not rotated.
/// - **The upward direction** stays ([`Dataset::up`]), so a picture shows the rotation.
///
/// Lengths in other settings (such as a transfer function's unit distance) are world units after the placement.
///
/// # Errors
/// The errors of [`Dataset::validate`], before and after; a size that is not positive; numbers that are not finite;
/// particles with lengths and sizes that differ. An uneven lattice with a single sample along an axis can be rotated by
/// quarter turns only.
pub fn place(mut dataset: Dataset, placement: &Placement) -> Result<Dataset> {
    placement.validate()?;
    dataset.validate()?;
    let rotation = placement.matrix();
    // The upward direction belongs to the world: a user who rotates an object wants to see it rotated.
    let up = dataset.up();
    dataset.format_up = Some((up.direction, up.reason));
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
            columns::place(&mut dataset, placement.size, rotation)?;
        }
        Geometry::Splats(cloud) => {
            if *placement != Placement::default() {
                cloud.records.change(Change::Places);
            }
            resize_splats(cloud, placement);
            cloud.turn(placement.rotation.normalize());
            for position in &mut cloud.positions {
                *position += placement.translation;
            }
        }
        Geometry::Mesh(mesh) => {
            mesh.parts.iter_mut().for_each(|p| to(&mut p.positions));
            turn_normals(mesh, rotation, placement.size);
        }
    }
    dataset.validate()?;
    Ok(dataset)
}

/// Rotates the fields that are vectors in space.
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
            let v = DVec3::from([x, y, z].map(|v| v.wide(i)));
            for (column, x) in turned.iter_mut().zip((rotation * v).to_array()) {
                column.push(x);
            }
        }
        *components = turned.map(Values::from).into();
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
                    step: rotation * (DMat3::from_diagonal(placement.size) * *step),
                },
            });
            return Ok(());
        }
        LatticeSpacing::Rectilinear { coordinates } => coordinates,
    };
    if is_of_axes(rotation) {
        let turned = turned_axes(rotation, *dims);
        let moved = [0, 1, 2].map(|new| {
            let old = turned.axes[new];
            let line = &coordinates[old];
            let sign = if turned.is_reversed[new] { -1.0 } else { 1.0 };
            let moved = |x: &f64| sign * (placement.size[old] * x) + placement.translation[new];
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

/// Returns the permutation and reversal of an array's indices for a rotation by quarter turns.
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

fn resize_splats(cloud: &mut SplatCloud, placement: &Placement) {
    for position in &mut cloud.positions {
        *position *= placement.size;
    }
    if let Some(size) = even(placement.size) {
        for scale in cloud.scales.as_flattened_mut() {
            *scale = narrowed(f64::from(*scale) * size);
        }
        return;
    }
    let size = DMat3::from_diagonal(placement.size);
    for (scales, rotation) in cloud.scales.iter_mut().zip(&mut cloud.rotations) {
        let [w, x, y, z] = rotation.map(f64::from);
        let turned = DQuat::from_xyzw(x, y, z, w);
        let own = DMat3::from_diagonal(DVec3::from(scales.map(f64::from)));
        let factor = size * DMat3::from_quat(turned.normalize()) * own;
        // The sampler leaves out and counts shapes that are not finite.
        if !factor.is_finite() {
            continue;
        }
        let (sigmas, q) = scales_and_rotation(factor);
        *scales = sigmas.map(narrowed);
        *rotation = [q.w, q.x, q.y, q.z].map(narrowed);
    }
}

/// Transforms normals so that they stay perpendicular to stretched surfaces.
fn turn_normals(mesh: &mut Mesh, rotation: DMat3, size: DVec3) {
    for normal in mesh.parts.iter_mut().flat_map(|part| &mut part.normals) {
        let own = normal.as_dvec3();
        let stretched = match even(size).is_some() {
            true => own,
            false => (own / size).normalize_or_zero() * own.length(),
        };
        *normal = (rotation * stretched).as_vec3();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::fixtures;
    use super::*;

    fn oblique() -> Placement {
        Placement {
            size: DVec3::splat(2.5),
            rotation: DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.9),
            translation: DVec3::new(3.0, -2.0, 1.0),
        }
    }

    /// Returns the positions of all samples, in the order of the fields' values.
    fn positions(dataset: &Dataset) -> Vec<DVec3> {
        match &dataset.geometry {
            Geometry::Lattice(lattice) => {
                let [x, y, _] = lattice.dims;
                let place = |n: usize| lattice.position([n % x, n / x % y, n / x / y]);
                (0..lattice.len()).map(place).collect()
            }
            Geometry::Curvilinear { blocks } => {
                blocks.iter().flat_map(|b| b.nodes.clone()).collect()
            }
            Geometry::Cells(mesh) => mesh.nodes.clone(),
            Geometry::Points { positions } => positions.clone(),
            Geometry::Splats(cloud) => cloud.positions.clone(),
            Geometry::Mesh(mesh) => mesh.parts[0].positions.clone(),
        }
    }

    /// Returns the positions, numbers and vectors of the samples.
    fn samples(dataset: &Dataset) -> Vec<(DVec3, f32, DVec3)> {
        let value = |name: &str, i| match dataset.scalar(name) {
            Ok((_, values)) => values.get(i),
            // A mesh has no fields.
            Err(_) => 0.0,
        };
        let vector = |i| {
            let parts = ["x", "y", "z"].map(|c| format!("vector of nodes:{c}"));
            DVec3::from(parts.map(|name| f64::from(value(&name, i))))
        };
        let sample = |(i, p)| (p, value("number of nodes", i), vector(i));
        let all = positions(dataset).into_iter().enumerate();
        all.map(sample).collect()
    }

    fn turn(axis: DVec3, degrees: f64) -> Placement {
        Placement {
            rotation: DQuat::from_axis_angle(axis.normalize(), degrees.to_radians()),
            ..oblique()
        }
    }

    #[test]
    fn samples_go_with_their_values_and_vectors_turn() {
        let quarter_turns = [
            turn(DVec3::Z, 90.0),
            turn(DVec3::X, -90.0),
            turn(DVec3::Y, 180.0),
            turn(DVec3::ONE, 120.0),
            turn(DVec3::new(1.0, 1.0, 0.0), 180.0),
        ];
        for placement in quarter_turns.into_iter().chain([oblique()]) {
            for dataset in fixtures::all() {
                let rotation = placement.matrix();
                let up = dataset.up().direction;
                let before = samples(&dataset);
                let placed = place(dataset, &placement).unwrap();
                assert_eq!(placed.up().direction, up);
                let after = samples(&placed);
                assert_eq!(before.len(), after.len());
                for (position, number, vector) in before {
                    let goal = placement.apply(position);
                    let found = after.iter().find(|(p, n, _)| {
                        // The tolerance allows for some f64 roundings of coordinates below 20.
                        (*p - goal).length() < 1e-13 && *n == number
                    });
                    let (_, _, turned) = found.unwrap();
                    // The vectors are f32, with components below 100.
                    assert!((rotation * vector - *turned).length() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn quarter_turns_keep_uneven_lattices_and_their_cells() {
        let whole = fixtures::rectilinear();
        let placement = turn(DVec3::ONE, 120.0);
        let placed = place(whole.clone(), &placement).unwrap();
        let Geometry::Lattice(lattice) = &placed.geometry else {
            panic!("quarter turns keep a lattice");
        };
        // The rotation maps x to y, y to z, z to x.
        assert_eq!(lattice.dims, [3, 5, 4]);
        let (_, cells) = placed.scalar("number of cells").unwrap();
        // Old cells are 4 x 3 x 2, new ones 2 x 4 x 3. The first row holds two layers of z.
        assert_eq!([0, 1, 2].map(|i| cells.get(i)), [0.0, 12.0, 1.0]);
        let placed = place(whole, &oblique()).unwrap();
        assert!(matches!(placed.geometry, Geometry::Curvilinear { .. }));
        let mut flat = fixtures::rectilinear();
        if let Geometry::Lattice(lattice) = &mut flat.geometry {
            lattice.dims[2] = 1;
            if let LatticeSpacing::Rectilinear { coordinates } = &mut lattice.spacing {
                coordinates[2].truncate(1);
            }
        }
        flat.fields.clear();
        assert!(place(flat.clone(), &turn(DVec3::Z, 270.0)).is_ok());
        let said = place(flat, &oblique()).unwrap_err().to_string();
        assert!(said.contains("quarter turns"), "{said}");
    }

    proptest! {
        /// Composed with its inverse, a placement changes nothing up to rounding.
        #[test]
        fn there_and_back(
            axis in prop::array::uniform3(-1.0f64..1.0),
            angle in -4.0f64..4.0,
            size in 0.1f64..10.0,
            translation in prop::array::uniform3(-9.0f64..9.0),
        ) {
            let axis = DVec3::from(axis);
            prop_assume!(axis.length() > 0.1);
            let there = Placement {
                size: DVec3::splat(size),
                rotation: DQuat::from_axis_angle(axis.normalize(), angle),
                translation: translation.into(),
            };
            let rotation = there.rotation.inverse();
            let back = Placement {
                size: DVec3::splat(1.0 / size),
                rotation,
                translation: rotation * -DVec3::from(translation) / size,
            };
            for dataset in fixtures::all() {
                let before = samples(&dataset);
                let returned = place(place(dataset, &there).unwrap(), &back).unwrap();
                for (a, b) in before.iter().zip(samples(&returned)) {
                    // Intermediate positions are f64 up to 1000 / size; vectors are f32 up to 100.
                    prop_assert!((a.0 - b.0).length() < 1e-10, "{} and {}", a.0, b.0);
                    prop_assert_eq!(a.1, b.1);
                    prop_assert!((a.2 - b.2).length() < 1e-4);
                }
            }
        }
    }

    fn table(columns: &[(&str, f32)]) -> Dataset {
        let mut dataset = fixtures::points();
        dataset.fields = columns
            .iter()
            .map(|(name, value)| Field {
                name: (*name).into(),
                association: Association::Nodes,
                unit: None,
                source: FieldSource::Scalar(Values::F32(vec![*value; 40])),
            })
            .collect();
        dataset
    }

    fn first(dataset: &Dataset, name: &str) -> f32 {
        dataset.scalar(name).unwrap().1.get(0)
    }

    #[test]
    fn what_has_lengths_in_it_scales_and_densities_stay() {
        let dataset = table(&[
            ("SIGMA", 1.0),
            ("volume", 1.0),
            ("mass", 1.0),
            ("extinction", 1.0),
            ("rho", 1.0),
            ("m", 1.0),
            ("opacity", 1.0),
        ]);
        let placed = place(dataset, &turn(DVec3::Z, 90.0)).unwrap();
        for (name, expected) in [
            ("sigma", 2.5),
            ("volume", 15.625),
            ("mass", 6.25),
            ("extinction", 0.4),
            ("rho", 1.0),
            ("m", 1.0),
            ("opacity", 1.0),
        ] {
            assert_eq!(first(&placed, name), expected, "{name}");
        }
        assert_eq!(placed.volume_scale, 15.625);
    }

    /// Returns V of the first particle, from its columns of either kind.
    fn variance(dataset: &Dataset) -> DMat3 {
        let number = |name: &str| f64::from(first(dataset, name));
        if dataset.scalar("vxx").is_ok() {
            let [xx, xy, xz, yy, yz, zz] = crate::data::shape_columns::VARIANCE.map(number);
            return DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        }
        let [sx, sy, sz, w, x, y, z] = crate::data::shape_columns::SCALES.map(number);
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let squares = DVec3::new(sx, sy, sz) * DVec3::new(sx, sy, sz);
        axes * DMat3::from_diagonal(squares) * axes.transpose()
    }

    #[test]
    fn shapes_of_particles_turn() {
        // At an angle to the axes, a variance in single precision would lose the thickness of this disc.
        let disc = [
            ("vxx", 1.0),
            ("vxy", 0.0),
            ("vxz", 0.0),
            ("vyy", 1.0),
            ("vyz", 0.0),
            ("vzz", 1e-10),
        ];
        let ellipsoid = [
            ("scale_0", 0.5),
            ("scale_1", 0.2),
            ("scale_2", 0.1),
            ("rot_0", 1.0),
            ("rot_1", 0.4),
            ("rot_2", -0.2),
            ("rot_3", 0.7),
        ];
        for columns in [&disc[..], &ellipsoid[..]] {
            for placement in [oblique(), turn(DVec3::ONE, 120.0)] {
                let dataset = table(columns);
                let turn = placement.matrix();
                let expected = turn * variance(&dataset) * turn.transpose() * 6.25;
                let placed = place(dataset, &placement).unwrap();
                let gap = variance(&placed) - expected;
                // The tolerance allows for some f32 roundings of elements up to 6.25.
                assert!(gap.to_cols_array().iter().all(|x| x.abs() < 4e-6), "{gap}");
            }
        }
        let placed = place(table(&disc), &oblique()).unwrap();
        assert!((first(&placed, "scale_2") / 2.5e-5 - 1.0).abs() < 1e-6);
    }

    /// Three sizes stretch kernels as they stretch space.
    #[test]
    fn uneven_sizes_stretch_shapes() {
        let ellipsoid = [
            ("scale_0", 0.5),
            ("scale_1", 0.2),
            ("scale_2", 0.1),
            ("rot_0", 1.0),
            ("rot_1", 0.4),
            ("rot_2", -0.2),
            ("rot_3", 0.7),
        ];
        let matrix = [
            ("vxx", 1.0),
            ("vxy", 0.25),
            ("vxz", 0.0),
            ("vyy", 1.0),
            ("vyz", -0.5),
            ("vzz", 2.0),
        ];
        let size = DVec3::new(1.0, 2.0, 0.5);
        for columns in [&matrix[..], &ellipsoid[..]] {
            for placement in [oblique(), turn(DVec3::ONE, 120.0)] {
                let placement = Placement { size, ..placement };
                let dataset = table(columns);
                let by = placement.matrix() * DMat3::from_diagonal(size);
                let expected = by * variance(&dataset) * by.transpose();
                let placed = place(dataset, &placement).unwrap();
                let gap = variance(&placed) - expected;
                // The tolerance allows for some f32 roundings of elements up to 4.
                assert!(gap.to_cols_array().iter().all(|x| x.abs() < 4e-6), "{gap}");
            }
        }
        let placement = Placement {
            size,
            ..Placement::default()
        };
        let round = place(table(&[("h", 1.0)]), &placement).unwrap_err();
        assert!(round.to_string().contains("one factor"), "{round}");
        let placed = place(table(&[("volume", 1.0), ("rho", 1.0)]), &placement).unwrap();
        assert_eq!(first(&placed, "volume"), 1.0);
        assert_eq!(placed.volume_scale, 1.0);
    }

    #[test]
    fn colours_and_bytes_do_not_turn() {
        let mut dataset = fixtures::points();
        let vector = |name: &str, values: Values| Field {
            name: name.into(),
            association: Association::Nodes,
            unit: None,
            source: FieldSource::Vector(vec![values; 3]),
        };
        dataset.fields = vec![
            vector("colour", Values::F32(vec![0.5; 40])),
            vector("bytes", Values::U8(vec![9; 40])),
            vector("short", Values::I16(vec![9; 40])),
        ];
        let placed = place(dataset, &turn(DVec3::Z, 180.0)).unwrap();
        assert_eq!(first(&placed, "colour:x"), 0.5);
        assert_eq!(first(&placed, "bytes:x"), 9.0);
        assert_eq!(first(&placed, "short:x"), -9.0);
    }

    #[test]
    fn wrong_placements_are_refused() {
        for placement in [
            Placement {
                size: DVec3::new(1.0, 0.0, 1.0),
                ..oblique()
            },
            Placement {
                size: DVec3::NAN,
                ..oblique()
            },
            Placement {
                rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
                ..oblique()
            },
            Placement {
                translation: DVec3::INFINITY,
                ..oblique()
            },
        ] {
            assert!(place(fixtures::points(), &placement).is_err());
        }
        // At this distance, neighbouring coordinates become equal.
        let far = Placement {
            translation: DVec3::splat(1e20),
            ..Placement::default()
        };
        let said = place(fixtures::rectilinear(), &far)
            .unwrap_err()
            .to_string();
        assert!(said.contains("numbers that rise"), "{said}");
    }
}
