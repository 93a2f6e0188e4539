//! Cuts cells of higher order so finely that cells of first order represent one field.

use super::element::{Subdivision, steps};
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::scene::Values;

/// Returns true if there are solid cells of higher order.
pub(crate) fn is_of_higher_order(mesh: &CellMesh) -> bool {
    let mut kinds = mesh.kinds.iter();
    kinds.any(|kind| kind.is_of_higher_order() && kind.is_solid())
}

/// Cuts the cells of higher order of a data set and returns it with the number of cells cut. Of its fields, it keeps
/// the selected one and those that mark hidden cells. Returns the data set unchanged if no cell is of higher order or
/// the corners alone are accurate enough.
///
/// - `selector`: the field, as [`Dataset::scalar`] takes it.
/// - `slack`: greatest difference between the drawn linear cells and the elements, as a fraction of the field's range
///   and of a cell's size. It holds at 999 of 1000 positions.
///
/// # Errors
/// The field does not exist, or its number of values differs from the number of samples.
pub(crate) fn to_first_order(
    mut dataset: Dataset,
    selector: &str,
    slack: f64,
) -> Result<(Dataset, usize)> {
    let Geometry::Cells(mesh) = &dataset.geometry else {
        return Ok((dataset, 0));
    };
    let (association, values) = dataset.scalar(selector)?;
    let expected = mesh.count_of(association);
    if values.len() != expected {
        return Err(Error::format(
            &dataset.path,
            format!("field `{selector}`"),
            format!("{expected} values"),
            format!("{} values", values.len()),
            "the file is damaged",
        ));
    }
    let of_nodes = (association == Association::Nodes).then_some(&values);
    let steps = steps(mesh, of_nodes, slack, true);
    let Some(cut) = steps.and_then(|steps| Subdivision::new(mesh, steps)) else {
        return Ok((dataset, 0));
    };
    let unit = dataset.unit(selector).map(str::to_owned);
    let mut fields = Vec::new();
    for field in dataset
        .fields
        .iter()
        .filter(|f| Blanking::is_told_by(&f.name))
    {
        if let FieldSource::Scalar(stated) = &field.source
            && stated.len() == mesh.count_of(field.association)
        {
            let source = FieldSource::Scalar(cut.values(field.association, stated));
            fields.push(Field {
                source,
                ..field.clone()
            });
        }
    }
    let source = FieldSource::Scalar(cut.values(association, &values));
    fields.push(Field {
        name: selector.to_owned(),
        association,
        source,
        unit,
    });
    let count = cut.cut;
    dataset.fields = fields;
    dataset.geometry = Geometry::Cells(cut.mesh);
    Ok((dataset, count))
}

/// Greatest distance of a surface from its elements, as a fraction of their size.
const SURFACE_SLACK: f64 = 0.01;

/// Cuts flat cells of higher order, and interpolates all stored fields. Cells are cut at least as finely as their nodes
/// lie, so that no value is lost.
pub(crate) fn surface_of_first_order(mesh: CellMesh, fields: Vec<Field>) -> (CellMesh, Vec<Field>) {
    let steps = steps(&mesh, None, SURFACE_SLACK, false);
    let Some(cut) = steps.and_then(|steps| Subdivision::new(&mesh, steps)) else {
        return (mesh, fields);
    };
    let of_cut = |mut field: Field| {
        let expected = mesh.count_of(field.association);
        if matches!(field.source, FieldSource::Derived(_)) {
            return None;
        }
        let association = field.association;
        let arrays = field.arrays_mut();
        if arrays.iter().any(|values| values.len() != expected) {
            return None;
        }
        for values in arrays {
            let is_bytes = matches!(values, Values::U8(_));
            *values = cut.values(association, values);
            // Bytes must stay bytes: three or four components are colours only in this type.
            if is_bytes && !matches!(values, Values::U8(_)) {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "casts saturate"
                )]
                let byte = |i: usize| values.get(i).round() as u8;
                *values = Values::U8((0..values.len()).map(byte).collect());
            }
        }
        Some(field)
    };
    let fields = fields.into_iter().filter_map(of_cut).collect();
    (cut.mesh, fields)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DVec3;

    use super::*;
    use crate::data::cells::CellKind;

    /// Returns two adjacent quadratic hexahedra of 20 nodes. The edges of the second at x = 2 are bent outwards by
    /// `bulge`.
    fn two_hexahedra(bulge: f64) -> CellMesh {
        let corner = [
            [0, 0, 0],
            [2, 0, 0],
            [2, 2, 0],
            [0, 2, 0],
            [0, 0, 2],
            [2, 0, 2],
            [2, 2, 2],
            [0, 2, 2],
        ];
        let edges = [
            [0, 1],
            [1, 2],
            [2, 3],
            [3, 0],
            [4, 5],
            [5, 6],
            [6, 7],
            [7, 4],
            [0, 4],
            [1, 5],
            [2, 6],
            [3, 7],
        ];
        let middle =
            |[a, b]: [usize; 2]| [0, 1, 2].map(|axis| (corner[a][axis] + corner[b][axis]) / 2);
        let places: Vec<[i32; 3]> = corner.into_iter().chain(edges.map(middle)).collect();
        let mut mesh = CellMesh {
            offsets: vec![0],
            ..CellMesh::default()
        };
        let mut known: Vec<[i32; 3]> = Vec::new();
        for x in [0, 2] {
            mesh.kinds.push(CellKind(25));
            for place in &places {
                let place = [place[0] + x, place[1], place[2]];
                let number = known.iter().position(|p| *p == place).unwrap_or_else(|| {
                    known.push(place);
                    let mut at = DVec3::from(place.map(|i| 0.5 * f64::from(i)));
                    if place[0] == 4 && (place[1] == 1 || place[2] == 1) {
                        at.x += bulge;
                    }
                    mesh.nodes.push(at);
                    known.len() - 1
                });
                mesh.connectivity.push(u32::try_from(number).unwrap());
            }
            mesh.offsets
                .push(u32::try_from(mesh.connectivity.len()).unwrap());
        }
        mesh
    }

    fn dataset(mesh: CellMesh, of: impl Fn(DVec3) -> f64) -> Dataset {
        #[expect(clippy::cast_possible_truncation, reason = "fields are in f32")]
        let values = mesh.nodes.iter().map(|p| of(*p) as f32).collect();
        let field = Field {
            name: "f".into(),
            association: Association::Nodes,
            source: FieldSource::Scalar(Values::F32(values)),
            unit: Some("K".into()),
        };
        Dataset::new(Path::new("a"), "test", Geometry::Cells(mesh), vec![field])
    }

    fn cells(data: &Dataset) -> &CellMesh {
        let Geometry::Cells(mesh) = &data.geometry else {
            panic!("cells expected");
        };
        mesh
    }

    #[test]
    fn what_corners_say_as_well_is_not_cut() {
        let linear = |p: DVec3| 3.0 + p.x - 2.0 * p.y + 0.5 * p.z;
        let (data, count) = to_first_order(dataset(two_hexahedra(0.0), linear), "f", 0.01).unwrap();
        assert_eq!((count, cells(&data).cell_count()), (0, 2));
        // On bent edges the same nodal values give another field inside.
        let (data, count) = to_first_order(dataset(two_hexahedra(0.3), linear), "f", 0.01).unwrap();
        assert_eq!(count, 2);
        assert!(cells(&data).cell_count() >= 2 * 8);
    }

    #[test]
    fn quadratic_fields_are_met_at_every_node() {
        let quadratic = |p: DVec3| p.x * p.x - p.x * p.y + 2.0 * p.z * p.z + p.y;
        let (data, count) =
            to_first_order(dataset(two_hexahedra(0.0), quadratic), "F", 0.01).unwrap();
        let mesh = cells(&data);
        assert_eq!(count, 2);
        assert_eq!(data.unit("F"), Some("K"));
        let (_, values) = data.scalar("F").unwrap();
        for (i, node) in mesh.nodes.iter().enumerate() {
            // The values are in single precision.
            assert!(
                (f64::from(values.get(i)) - quadratic(*node)).abs() < 1e-5,
                "{node}"
            );
        }
        // With n steps along each edge, there are 2n + 1 by n + 1 by n + 1 positions; all original nodes are among
        // them.
        let of_cell = mesh.cell_count() / 2;
        let n = [4_usize, 8]
            .into_iter()
            .find(|n| n.pow(3) == of_cell)
            .unwrap();
        assert_eq!(mesh.nodes.len(), (2 * n + 1) * (n + 1) * (n + 1));
    }

    #[test]
    fn values_of_cells_go_to_their_parts_and_hidden_ones_stay_hidden() {
        let mut data = dataset(two_hexahedra(0.4), |_| 0.0);
        let of_cells = |name: &str, values| Field {
            name: name.into(),
            association: Association::Cells,
            source: FieldSource::Scalar(values),
            unit: None,
        };
        data.fields = vec![
            of_cells("c", Values::F32(vec![5.0, 7.0])),
            of_cells("vtkGhostType", Values::U8(vec![0, 32])),
        ];
        let (data, _) = to_first_order(data, "c", 0.01).unwrap();
        let half = cells(&data).cell_count() / 2;
        for (name, first, second) in [("c", 5.0, 7.0), ("vtkGhostType", 0.0, 32.0)] {
            let (_, values) = data.scalar(name).unwrap();
            assert_eq!(values.len(), 2 * half);
            let is_of = |i: usize| values.get(i) == if i < half { first } else { second };
            assert!((0..2 * half).all(is_of), "{name}");
        }
    }
}
