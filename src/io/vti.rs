//! VTK image data (`.vti`): a uniform lattice with named arrays.
//!
//! ```text
//! <ImageData WholeExtent="i0 i1 j0 j1 k0 k1" Origin="x y z" Spacing="x y z"
//!            Direction="3 x 3, row by row">
//!   <Piece Extent="i0 i1 j0 j1 k0 k1">
//!     <PointData> <DataArray .../> ... </PointData>
//!     <CellData> <DataArray .../> ... </CellData>
//!   </Piece> ...
//! </ImageData>
//! ```
//!
//! Node (i, j, k), counted as the extents count, lies at Origin + Direction (Spacing * (i, j,
//! k)); the lattice starts at the first node of `WholeExtent`. Cells lie between nodes. Several
//! pieces are put together; they must carry the same arrays and cover the whole extent.

use std::path::Path;

use glam::{DMat3, DVec3};
use roxmltree::Node;

use super::dataset::{Association, Dataset, Field, FieldSource, Geometry};
use super::file::read_all;
use super::vtk_xml::{Array, Decoder, Frame, child, numbers};
use crate::error::{Error, Result};
use crate::scene::{Lattice, LatticeSpacing, Values};

/// First and last node along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Extent {
    first: [i64; 3],
    last: [i64; 3],
}

impl Extent {
    fn from_numbers([i0, i1, j0, j1, k0, k1]: [i32; 6]) -> Self {
        Self {
            first: [i0, j0, k0].map(i64::from),
            last: [i1, j1, k1].map(i64::from),
        }
    }

    fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.last[axis] < self.first[axis])
    }

    /// Nodes, or cells, along each axis.
    fn dims(&self, association: Association) -> [usize; 3] {
        [0, 1, 2].map(|axis| {
            let steps = usize::try_from(self.last[axis] - self.first[axis]).unwrap_or(0);
            match association {
                Association::Nodes => steps + 1,
                Association::Cells => steps,
            }
        })
    }

    fn count(&self, association: Association) -> Option<usize> {
        let [x, y, z] = self.dims(association);
        x.checked_mul(y)?.checked_mul(z)
    }
}

/// One piece of the image with its arrays decoded.
struct Piece {
    extent: Extent,
    node_arrays: Vec<Array>,
    cell_arrays: Vec<Array>,
}

/// Reads an image.
///
/// # Errors
/// Not an image, damaged arrays, or pieces that do not make up the whole.
pub(crate) fn read(path: &Path) -> Result<Dataset> {
    let bytes = read_all(path)?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let decoder = Decoder::new(&frame, &document, "ImageData")?;
    let missing = |name: &str| {
        Error::format(
            path,
            name,
            "this element",
            "none",
            "the file is damaged: save it again",
        )
    };
    let image = child(document.root_element(), "ImageData").ok_or_else(|| missing("ImageData"))?;

    let whole = Extent::from_numbers(numbers(path, image, "WholeExtent", None)?);
    let whole_count = whole.count(Association::Nodes);
    let Some(whole_count) = whole_count.filter(|_| !whole.is_empty()) else {
        return Err(Error::format(
            path,
            "ImageData, `WholeExtent`",
            "last nodes that are not before the first ones, and a count that fits into memory",
            format!("{:?} to {:?}", whole.first, whole.last),
            "correct the attribute",
        ));
    };
    let (origin, step) = placement(path, image)?;

    let mut pieces = Vec::new();
    for node in image.children().filter(|n| n.has_tag_name("Piece")) {
        let default = (whole.first, whole.last);
        let extent = match node.attribute("Extent") {
            None => Extent {
                first: default.0,
                last: default.1,
            },
            Some(_) => Extent::from_numbers(numbers(path, node, "Extent", None)?),
        };
        if extent.is_empty() {
            continue;
        }
        let inside = (0..3).all(|axis| {
            extent.first[axis] >= whole.first[axis] && extent.last[axis] <= whole.last[axis]
        });
        if !inside {
            return Err(Error::format(
                path,
                "Piece, `Extent`",
                format!("an extent within {:?} to {:?}", whole.first, whole.last),
                format!("{:?} to {:?}", extent.first, extent.last),
                "correct the attribute",
            ));
        }
        let arrays = |name: &str, association: Association| {
            // An image without thickness has no cells of any volume.
            let count = extent.count(association).unwrap_or(usize::MAX);
            match child(node, name) {
                Some(element) if count > 0 => decoder.arrays(element, count),
                _ => Ok(Vec::new()),
            }
        };
        pieces.push(Piece {
            extent,
            node_arrays: arrays("PointData", Association::Nodes)?,
            cell_arrays: arrays("CellData", Association::Cells)?,
        });
    }

    let mut fields = assemble(path, &whole, &mut pieces, Association::Nodes)?;
    fields.extend(assemble(path, &whole, &mut pieces, Association::Cells)?);
    if fields.is_empty() {
        return Err(Error::format(
            path,
            "PointData and CellData",
            "at least one array of numbers",
            format!("none, for {whole_count} nodes"),
            "save the image with its data (an image one node thick has no cells)",
        ));
    }
    let first = DVec3::from_array(whole.first.map(|n| n as f64));
    let lattice = Lattice {
        dims: whole.dims(Association::Nodes),
        spacing: LatticeSpacing::Uniform {
            origin: origin + step * first,
            step,
        },
    };
    let geometry = Geometry::Lattice(lattice);
    Ok(Dataset::new(path, "VTK image data", geometry, fields))
}

/// Position of node (0, 0, 0) and the steps along the indices.
fn placement(path: &Path, image: Node<'_, '_>) -> Result<(DVec3, DMat3)> {
    let origin = DVec3::from_array(numbers(path, image, "Origin", Some([0.0; 3]))?);
    let spacing = DVec3::from_array(numbers(path, image, "Spacing", Some([1.0; 3]))?);
    let identity = DMat3::IDENTITY.to_cols_array();
    let by_rows = numbers(path, image, "Direction", Some(identity))?;
    let direction = DMat3::from_cols_array(&by_rows).transpose();
    let step = direction * DMat3::from_diagonal(spacing);
    let volume = step.determinant();
    if !origin.is_finite() || !volume.is_finite() || volume == 0.0 {
        return Err(Error::format(
            path,
            "ImageData, `Origin`, `Spacing` and `Direction`",
            "finite numbers whose cells have a volume",
            format!("origin {origin}, spacing {spacing}, direction by rows {by_rows:?}"),
            "correct the attribute",
        ));
    }
    Ok((origin, step))
}

/// Puts the arrays of all pieces together, of nodes or of cells.
fn assemble(
    path: &Path,
    whole: &Extent,
    pieces: &mut [Piece],
    association: Association,
) -> Result<Vec<Field>> {
    let arrays_of = |piece: &Piece| match association {
        Association::Nodes => piece.node_arrays.len(),
        Association::Cells => piece.cell_arrays.len(),
    };
    let element = match association {
        Association::Nodes => "PointData",
        Association::Cells => "CellData",
    };
    if pieces.iter().all(|piece| arrays_of(piece) == 0) {
        return Ok(Vec::new());
    }
    let mut parts: Vec<(Extent, Vec<Array>)> = pieces
        .iter_mut()
        .map(|piece| {
            let arrays = match association {
                Association::Nodes => &mut piece.node_arrays,
                Association::Cells => &mut piece.cell_arrays,
            };
            (piece.extent, std::mem::take(arrays))
        })
        // A piece one node thick adds no cells.
        .filter(|(extent, _)| extent.count(association) != Some(0))
        .collect();

    let arrays = match parts.as_mut_slice() {
        [(extent, arrays)] if extent == whole => std::mem::take(arrays),
        _ => join(path, whole, &parts, association, element)?,
    };
    Ok(arrays
        .into_iter()
        .map(
            |Array {
                 name,
                 mut components,
             }| Field {
                name,
                association,
                source: if components.len() == 1 {
                    FieldSource::Scalar(components.remove(0))
                } else {
                    FieldSource::Vector(components)
                },
            },
        )
        .collect())
}

/// Copies the parts into whole arrays. What is allocated is bounded: the parts' values are
/// in memory already, and the whole may not have more of them.
fn join(
    path: &Path,
    whole: &Extent,
    parts: &[(Extent, Vec<Array>)],
    association: Association,
    element: &str,
) -> Result<Vec<Array>> {
    let error = |expected: String, found: String| {
        Err(Error::format(
            path,
            element,
            expected,
            found,
            "save the image as one piece",
        ))
    };
    let Some((_, first)) = parts.first() else {
        return Ok(Vec::new());
    };
    for (extent, arrays) in parts {
        let agree = arrays.len() == first.len()
            && arrays.iter().zip(first).all(|(a, b)| {
                a.name == b.name
                    && a.components.len() == b.components.len()
                    && a.components
                        .iter()
                        .zip(&b.components)
                        .all(|(a, b)| a.type_name() == b.type_name())
            });
        if !agree {
            return error(
                "the same arrays in every piece".to_owned(),
                format!(
                    "others in the piece from {:?} to {:?}",
                    extent.first, extent.last
                ),
            );
        }
    }
    let count = whole.count(association).unwrap_or(usize::MAX);
    let present = parts.iter().fold(0_usize, |sum, (extent, _)| {
        sum.saturating_add(extent.count(association).unwrap_or(0))
    });
    if count > present {
        return error(
            format!("pieces that cover the whole extent of {count} samples"),
            format!("{present} samples"),
        );
    }

    let [whole_x, whole_y, _] = whole.dims(association);
    // Where each row of a part goes: (start in the part, start in the whole, length).
    let rows = |extent: &Extent| {
        let [nx, ny, nz] = extent.dims(association);
        let [dx, dy, dz] = [0, 1, 2]
            .map(|axis| usize::try_from(extent.first[axis] - whole.first[axis]).unwrap_or(0));
        (0..nz).flat_map(move |k| {
            (0..ny).map(move |j| {
                let to = ((k + dz) * whole_y + j + dy) * whole_x + dx;
                ((k * ny + j) * nx, to, nx)
            })
        })
    };
    let mut covered = vec![false; count];
    for (extent, _) in parts {
        for (_, to, n) in rows(extent) {
            covered[to..to + n].fill(true);
        }
    }
    if let Some(hole) = covered.iter().position(|&c| !c) {
        return error(
            "pieces that cover the whole extent".to_owned(),
            format!("sample {hole} in none of them"),
        );
    }

    let mut whole_arrays = Vec::new();
    for (index, array) in first.iter().enumerate() {
        let mut components = Vec::new();
        for (c, like) in array.components.iter().enumerate() {
            macro_rules! copy {
                ($kind:ident) => {{
                    let mut all = vec![Default::default(); count];
                    for (extent, arrays) in parts {
                        if let Values::$kind(part) = &arrays[index].components[c] {
                            for (from, to, n) in rows(extent) {
                                all[to..to + n].copy_from_slice(&part[from..from + n]);
                            }
                        }
                    }
                    Values::$kind(all)
                }};
            }
            components.push(match like {
                Values::U8(_) => copy!(U8),
                Values::I16(_) => copy!(I16),
                Values::U16(_) => copy!(U16),
                Values::F32(_) => copy!(F32),
            });
        }
        whole_arrays.push(Array {
            name: array.name.clone(),
            components,
        });
    }
    Ok(whole_arrays)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Dataset> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    fn piece(extent: &str, values: &str) -> String {
        format!(
            "<Piece Extent=\"{extent}\"><PointData><DataArray type=\"Int16\" Name=\"v\" \
             format=\"ascii\">{values}</DataArray></PointData></Piece>"
        )
    }

    fn image(attributes: &str, pieces: &str) -> String {
        format!(
            "<?xml version=\"1.0\"?><VTKFile type=\"ImageData\"><ImageData {attributes}>{pieces}\
             </ImageData></VTKFile>"
        )
    }

    #[test]
    fn extents_directions_and_origins_place_the_nodes() {
        let text = image(
            "WholeExtent=\"1 2 0 1 -1 0\" Origin=\"10 20 30\" Spacing=\"1 2 3\" \
             Direction=\"0 -1 0 1 0 0 0 0 1\"",
            &piece("1 2 0 1 -1 0", "0 1 2 3 4 5 6 7"),
        );
        let data = read_text(&text).unwrap();
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!()
        };
        assert_eq!(lattice.dims, [2, 2, 2]);
        // VTK's node (1, 0, -1) and its neighbours along i, j, k.
        assert_eq!(lattice.position([0, 0, 0]), DVec3::new(10., 21., 27.));
        assert_eq!(lattice.position([1, 0, 0]), DVec3::new(10., 22., 27.));
        assert_eq!(lattice.position([0, 1, 0]), DVec3::new(8., 21., 27.));
        assert_eq!(lattice.position([0, 0, 1]), DVec3::new(10., 21., 30.));
    }

    #[test]
    fn pieces_are_put_together() {
        let whole = "WholeExtent=\"0 2 0 1 0 0\"";
        let left = piece("0 1 0 1 0 0", "0 1 10 11");
        let right = piece("1 2 0 1 0 0", "1 2 11 12");
        let data = read_text(&image(whole, &(left.clone() + &right))).unwrap();
        assert_eq!(
            data.scalar("v").unwrap().1,
            Values::I16(vec![0, 1, 2, 10, 11, 12])
        );
        assert!(read_text(&image(whole, &left)).is_err());
        assert!(read_text(&image(whole, &(left.clone() + &left))).is_err());
        let other = right.replace("\"v\"", "\"w\"");
        assert!(read_text(&image(whole, &(left + &other))).is_err());
    }

    #[test]
    fn claims_beyond_the_file_are_refused() {
        for (whole, extent, values) in [
            ("0 2147483647 0 2147483647 0 0", "0 1 0 1 0 0", "0 1 2 3"),
            ("0 2000000000 0 2000000000 0 2000000000", "0 0 0 0 0 0", "0"),
            ("0 99 0 99 0 99", "0 99 0 99 0 99", "0 1 2 3"),
            ("0 1 0 0 0 0", "0 2 0 0 0 0", "0 1 2"),
            ("0 1 0 0 0 -1", "0 1 0 0 0 0", "0 1"),
            ("0 1 0 0", "0 1 0 0 0 0", "0 1"),
            ("0 1 0 0 0 0", "0 1 0 0 0 0", "0 1 2"),
            ("0 1 0 0 0 0", "0 1 0 0 0 0", "0 99999"),
        ] {
            let text = image(&format!("WholeExtent=\"{whole}\""), &piece(extent, values));
            let err = read_text(&text).unwrap_err();
            assert!(matches!(err, Error::Format { .. }), "{err}");
        }
    }
}
