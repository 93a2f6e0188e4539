//! Reads VTK image data (`.vti`, `.pvti`): a uniform lattice with named arrays.
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
//! Node (i, j, k), with indices from the extents, lies at Origin + Direction (Spacing * (i, j, k)). The lattice
//! starts at the first node of `WholeExtent`. Several pieces are put together, see [`super::extent`].

use std::path::Path;

use glam::{DMat3, DVec3};
use roxmltree::Node;

use super::extent::{Extent, Part, join};
use super::pieces;
use super::xml::numbers;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::scene::{Lattice, LatticeSpacing};

/// The format's name, for people.
pub(in crate::io) const FORMAT: &str = "VTK image data";

/// Reads an image.
///
/// # Errors
/// A file of another type; damaged arrays; pieces that do not make up the whole.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let ((whole, lattice), parts) =
        pieces::read(input, "ImageData", shape, |(whole, _), piece| {
            Part::read(whole, piece)
        })?;
    let (fields, notes) = join(path, &whole, parts)?;
    let geometry = Geometry::Lattice(lattice);
    Ok(Dataset {
        notes,
        ..Dataset::new(path, FORMAT, geometry, fields)
    })
}

/// The extent of an image, and its lattice.
pub(in crate::io) fn shape(path: &Path, image: Node<'_, '_>) -> Result<(Extent, Lattice)> {
    let whole = Extent::whole(path, image)?;
    let lattice = Placement::of(path, image)?.lattice(path, &whole)?;
    Ok((whole, lattice))
}

/// The attributes of an image that place its nodes.
pub(in crate::io) struct Placement {
    pub(in crate::io) origin: DVec3,
    pub(in crate::io) spacing: DVec3,
    /// The directions of the indices, as a matrix in row order.
    pub(in crate::io) by_rows: [f64; 9],
}

impl Placement {
    fn of(path: &Path, image: Node<'_, '_>) -> Result<Self> {
        let identity = DMat3::IDENTITY.to_cols_array();
        Ok(Self {
            origin: DVec3::from_array(numbers(path, image, "Origin", Some([0.0; 3]))?),
            spacing: DVec3::from_array(numbers(path, image, "Spacing", Some([1.0; 3]))?),
            by_rows: numbers(path, image, "Direction", Some(identity))?,
        })
    }

    /// The lattice of an extent, which starts at the extent's first node.
    pub(in crate::io) fn lattice(&self, path: &Path, whole: &Extent) -> Result<Lattice> {
        let Self {
            origin,
            spacing,
            by_rows,
        } = *self;
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
        let first = DVec3::from_array(whole.first.map(|n| n as f64));
        Ok(Lattice {
            dims: whole.dims(Association::Nodes),
            spacing: LatticeSpacing::Uniform {
                origin: origin + step * first,
                step,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Values;

    fn read_text(text: &str) -> Result<Dataset> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(Input::of_file(file.path()))
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
