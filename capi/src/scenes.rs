//! Makes scenes of arrays and files.

use std::path::Path;

use ewa_splat::io::{Association, CellMesh, CurvilinearBlock, Geometry, Mesh};
use ewa_splat::sample::TransferChoice;
use ewa_splat::scene::{Lattice, LatticeSpacing, TransferDefaults, TransferFunction};
use ewa_splat::session::{Drawable, Said, Sampling, field, opening, sampling};
use glam::{DMat3, DVec3};

use super::arrays::Numbers;
use super::failure::{Failure, Result};

/// Values of a field with its name.
#[derive(Debug)]
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) numbers: Numbers,
}

/// Returns the sampling options for a scene of one field.
fn options(text: Option<&str>, name: &str) -> Result<Sampling> {
    let mut own = Said::all(text, sampling)?;
    match &own.options.field {
        Some(field) if !field.eq_ignore_ascii_case(name) => Err(Failure::invalid(format!(
            "field: expected {name}, found {field}"
        ))),
        _ => {
            own.options.field = Some(name.into());
            Ok(own)
        }
    }
}

/// Checks that there is a value for each place.
fn counted(name: &str, numbers: &Numbers, expected: usize) -> Result<()> {
    match numbers.count() {
        found if found == expected => Ok(()),
        found => Err(Failure::invalid(format!(
            "{name}: expected {expected} values, found {found}"
        ))),
    }
}

/// Returns the number of values of a grid.
fn of_grid(dims: [usize; 3], association: Association) -> Result<usize> {
    // A rank may hold nothing of a grid.
    if dims.contains(&0) {
        return Ok(0);
    }
    // A layer of nodes has one layer of cells.
    let mut counts = dims.iter().map(|&n| match association {
        Association::Cells => n.saturating_sub(1).max(1),
        _ => n,
    });
    let count = counts.try_fold(1_usize, usize::checked_mul);
    count.ok_or_else(|| {
        let [x, y, z] = dims;
        Failure::invalid(format!(
            "dims: expected counts that memory holds, found {x}, {y}, {z}"
        ))
    })
}

/// Makes a scene of one field on a geometry with so many places.
fn of_field(
    what: &'static str,
    geometry: Geometry,
    (values, association): (Named, Association),
    count: usize,
    text: Option<&str>,
) -> Result<Drawable> {
    counted(&values.name, &values.numbers, count)?;
    let own = options(text, &values.name)?;
    let numbers = values.numbers.values(&values.name)?;
    let fields = vec![field(&values.name, numbers, association)];
    Ok(Drawable::of(what, geometry, fields, own)?)
}

/// Makes a scene of particles with columns, named as in tables.
pub(crate) fn points(
    positions: Vec<DVec3>,
    columns: Vec<Named>,
    text: Option<&str>,
) -> Result<Drawable> {
    let own = Said::all(text, sampling)?;
    let mut fields: Vec<ewa_splat::io::Field> = Vec::new();
    for column in columns {
        let name = column.name;
        counted(&name, &column.numbers, positions.len())?;
        if fields
            .iter()
            .any(|own| own.name.eq_ignore_ascii_case(&name))
        {
            let text = format!("{name}: expected one column of this name, found two");
            return Err(Failure::invalid(text));
        }
        fields.push(field(
            &name,
            column.numbers.values(&name)?,
            Association::Nodes,
        ));
    }
    Ok(Drawable::of(
        "points",
        Geometry::Points { positions },
        fields,
        own,
    )?)
}

/// Makes a scene of a regular grid.
///
/// - `direction`: columns are the directions of the axes.
pub(crate) fn grid(
    dims: [usize; 3],
    origin: DVec3,
    spacing: DVec3,
    direction: DMat3,
    values: (Named, Association),
    text: Option<&str>,
) -> Result<Drawable> {
    let count = of_grid(dims, values.1)?;
    let lattice = Lattice {
        dims,
        spacing: LatticeSpacing::Uniform {
            origin,
            step: direction * DMat3::from_diagonal(spacing),
        },
    };
    of_field("grid", Geometry::Lattice(lattice), values, count, text)
}

/// Makes a scene of a rectilinear grid.
pub(crate) fn rectilinear(
    coordinates: [Numbers; 3],
    values: (Named, Association),
    text: Option<&str>,
) -> Result<Drawable> {
    let [x, y, z] = coordinates;
    let coordinates = [x.floats("x")?, y.floats("y")?, z.floats("z")?];
    let count = of_grid(coordinates.each_ref().map(Vec::len), values.1)?;
    let lattice = Lattice {
        dims: coordinates.each_ref().map(Vec::len),
        spacing: LatticeSpacing::Rectilinear { coordinates },
    };
    of_field("grid", Geometry::Lattice(lattice), values, count, text)
}

/// Makes a scene of a curvilinear grid.
pub(crate) fn structured(
    dims: [usize; 3],
    nodes: Vec<DVec3>,
    values: (Named, Association),
    text: Option<&str>,
) -> Result<Drawable> {
    let count = of_grid(dims, values.1)?;
    let blocks = vec![CurvilinearBlock { dims, nodes }];
    let geometry = Geometry::Curvilinear { blocks };
    of_field("structured grid", geometry, values, count, text)
}

/// Makes a scene of an unstructured grid.
///
/// - `offsets`: start of each cell in `connectivity`, and the end of the last.
pub(crate) fn cells(
    nodes: Vec<DVec3>,
    kinds: Numbers,
    offsets: Numbers,
    connectivity: Numbers,
    values: (Named, Association),
    text: Option<&str>,
) -> Result<Drawable> {
    let kinds = kinds.bytes("types")?;
    let offsets = offsets.indices("offsets")?;
    let connectivity = connectivity.indices("connectivity")?;
    let count = connectivity.len();
    if offsets.len() != kinds.len() + 1 {
        let (expected, found) = (kinds.len() + 1, offsets.len());
        let text = format!("offsets: expected {expected}, one more than cells, found {found}");
        return Err(Failure::invalid(text));
    }
    let whole = offsets.first() == Some(&0) && offsets.last().copied() == i64::try_from(count).ok();
    if !whole || !offsets.is_sorted() {
        let text = format!("offsets: expected numbers that rise from 0 to {count}, found others");
        return Err(Failure::invalid(text));
    }
    let mut lists = Vec::with_capacity(count + kinds.len());
    let mut rest = connectivity.as_slice();
    for pair in offsets.windows(2) {
        let length = usize::try_from(pair[1] - pair[0]).unwrap_or_default();
        let (cell, after) = rest.split_at(length);
        lists.push(pair[1] - pair[0]);
        lists.extend_from_slice(cell);
        rest = after;
    }
    let places = match values.1 {
        Association::Nodes => nodes.len(),
        Association::Cells => kinds.len(),
    };
    let mesh = CellMesh::of_lists(nodes, &kinds, &lists)?;
    of_field("cells", Geometry::Cells(mesh), values, places, text)
}

/// Makes a scene of triangles, with colours, values or neither.
pub(crate) fn mesh(
    vertices: Vec<DVec3>,
    triangles: Numbers,
    colours: Option<Numbers>,
    values: Option<(Named, Association)>,
    text: Option<&str>,
) -> Result<Drawable> {
    let indices = triangles.indices("triangles")?;
    let (faces, []) = indices.as_chunks::<3>() else {
        let found = indices.len();
        let text = format!("triangles: expected three indices for each, found {found} in all");
        return Err(Failure::invalid(text));
    };
    let face = |face: &[i64; 3]| -> Result<[u32; 3]> {
        let mut own = [0; 3];
        for (own, &index) in own.iter_mut().zip(face) {
            *own = u32::try_from(index).map_err(|_| {
                let text = format!("triangles: expected indices from 0 up, found {index}");
                Failure::invalid(text)
            })?;
        }
        Ok(own)
    };
    let faces = faces.iter().map(face).collect::<Result<Vec<_>>>()?;
    let (count, face_count) = (vertices.len(), faces.len());
    let mut mesh = Mesh::of_triangles(vertices, faces);
    if let Some(colours) = colours {
        let numbers = colours.floats("colours")?;
        let (rows, []) = numbers.as_chunks::<4>() else {
            return Err(of_colours(count, numbers.len()));
        };
        if rows.len() != count {
            return Err(of_colours(count, numbers.len()));
        }
        #[expect(clippy::cast_possible_truncation, reason = "colours are of f32")]
        let rows = rows.iter().map(|row| row.map(|x| x as f32));
        mesh = mesh.with_colours(rows.collect::<Vec<_>>());
    }
    let geometry = Geometry::Mesh(mesh);
    match values {
        Some(values) => {
            let places = match values.1 {
                Association::Nodes => count,
                Association::Cells => face_count,
            };
            of_field("mesh", geometry, values, places, text)
        }
        None => {
            let own = Said::all(text, sampling)?;
            Ok(Drawable::of("mesh", geometry, Vec::new(), own)?)
        }
    }
}

fn of_colours(count: usize, found: usize) -> Failure {
    let expected = 4 * count;
    Failure::invalid(format!(
        "colours: expected {expected} numbers, four for each vertex, found {found}"
    ))
}

/// Opens a file as a scene.
pub(crate) fn file(path: &Path, text: Option<&str>) -> Result<Drawable> {
    let (how, own) = Said::all(text, |said| {
        let own = sampling(said)?;
        Ok((opening(said)?, own))
    })?;
    Ok(Drawable::open(path, &how, &own)?)
}

/// Returns a transfer function from JSON text.
pub(crate) fn transfer(text: &str) -> Result<TransferChoice> {
    let defaults = TransferDefaults {
        range: [0.0, 1.0],
        unit_distance: 1.0,
    };
    TransferFunction::from_json("transfer function".as_ref(), text, &defaults)?;
    Ok(TransferChoice::Text(text.into()))
}

/// Returns a colour map over a range as a transfer function.
///
/// - `unit_distance`: 0 for that of the data.
pub(crate) fn colour_map(
    name: &str,
    range: [f64; 2],
    unit_distance: f64,
) -> Result<TransferChoice> {
    let [low, high] = range;
    if !(low < high && low.is_finite() && high.is_finite()) {
        let text =
            format!("range: expected two finite numbers, the lower one first, found {low}, {high}");
        return Err(Failure::invalid(text));
    }
    if !(unit_distance >= 0.0 && unit_distance.is_finite()) {
        let text = format!("unit_distance: expected a number from 0 up, found {unit_distance}");
        return Err(Failure::invalid(text));
    }
    let has_unit = unit_distance > 0.0;
    #[expect(clippy::cast_possible_truncation, reason = "ranges are of f32")]
    let defaults = TransferDefaults {
        range: range.map(|x| x as f32),
        unit_distance: if has_unit { unit_distance } else { 1.0 },
    };
    let text = TransferFunction::named(name, &defaults)?.to_json();
    if has_unit {
        return Ok(TransferChoice::Text(text));
    }
    let mut document: serde_json::Value = serde_json::from_str(&text)
        .map_err(|error| Failure::invalid(format!("colour map: expected JSON, found {error}")))?;
    if let Some(object) = document.as_object_mut() {
        object.remove("unit_distance");
    }
    Ok(TransferChoice::Text(document.to_string()))
}
