//! Checks the data that readers of images return.

use ewa_splat::io::{Dataset, FieldSource, Geometry};
use ewa_splat::scene::{Lattice, Values};
use glam::DVec3;

pub(crate) fn lattice(data: &Dataset) -> &Lattice {
    match &data.geometry {
        Geometry::Lattice(lattice) => lattice,
        _ => panic!("no lattice"),
    }
}

pub(crate) fn scalar(data: &Dataset) -> Values {
    data.scalar("value").unwrap().1
}

/// Returns the components of the first field.
pub(crate) fn components(data: &Dataset) -> &[Values] {
    match &data.fields[0].source {
        FieldSource::Vector(components) => components,
        _ => panic!("no vector"),
    }
}

/// Checks the values and positions of a volume of 3 x 4 x 2 that SimpleITK wrote, rotated about z.
pub(crate) fn check_volume_of_itk(data: &Dataset) {
    let expected: Vec<i16> = (0..24).map(|i| 7 * i - 50).collect();
    assert_eq!(scalar(data), Values::I16(expected));
    let lattice = lattice(data);
    assert_eq!(lattice.dims, [3, 4, 2]);
    // Positions from SimpleITK's TransformIndexToPhysicalPoint, to the rounding of its decimal
    // numbers.
    for (index, place) in [
        ([0, 0, 0], DVec3::new(-10.0, 20.0, 5.5)),
        ([1, 0, 0], DVec3::new(-9.6, 20.3, 5.5)),
        ([2, 3, 1], DVec3::new(-10.55, 22.4, 7.5)),
    ] {
        assert!(lattice.position(index).distance(place) < 1e-13);
    }
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}
