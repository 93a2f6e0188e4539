//! Reads PLY: particle tables, meshes, and splats in the layout of Kerbl et al. 2023 (INRIA's).
//!
//! A text header names elements and the properties of each. The body has the elements one after another, as
//! text or as binary numbers in either byte order. Properties may have any order and any type; lists and other
//! elements are skipped, and bytes after the last element are ignored.
//!
//! | properties of `vertex` | content |
//! |---|---|
//! | `x`, `y`, `z` | position |
//! | `f_dc_0..2` | coefficients of the constant harmonic, R, G, B |
//! | `f_rest_0..` | the other coefficients: all of red, all of green, all of blue; 0, 9, 24 or 45 |
//! | `opacity` | logit of the peak opacity |
//! | `scale_0`, `scale_1`, `scale_2` | natural logarithms of the standard deviations; without `scale_2` splats are flat |
//! | `rot_0..3` | quaternion w, x, y, z of any length |
//! | `filter_3D` | the 3-D filter of Yu et al. 2024, *Mip-Splatting*, which is applied |
//! | all others | fields |
//!
//! A file with `packed_position` has packed splats (see [`self::packed`]), one with `f_dc_0` the splat
//! layout. Tables of scales, rotations and opacities with other colours are splats, too (see
//! [`super::splats::splat_table`]). Of the others, one with faces is a mesh (see [`self::mesh`]) unless `options`
//! ask for its points, and any other is a table. A comment `SplatRenderMode: mip` (Brush) or `antialiased 1`
//! (Postshot) marks splats made for the low-pass filter of Yu et al. 2024, *Mip-Splatting*, that keeps opacity
//! times area.
//!
//! The parser is our own. `ply-rs-bw` 4.0 reads into a map of names per vertex (some kilobytes for the 62
//! numbers of a splat), and `serde-ply` 0.2 into structs whose fields are known at compile time. This parser
//! reads columns in place.

pub(super) mod body;
pub(super) mod header;
pub(super) mod mesh;
pub(super) mod packed;
pub(super) mod packed_write;
pub(super) mod splats;
pub(super) mod table;

use self::body::rows;
use self::header::Header;
use self::mesh::Faces;
use self::splats::splats;
use self::table::Table;
use super::bytes::file::Input;
use super::options::{OpenOptions, ReadAs};
use super::particles::table::dataset;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};

pub(super) const FORMAT: &str = "PLY particle table";

/// Whether a file starts as PLY files do.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
}

/// Reads particles, a mesh or splats.
///
/// # Errors
/// A broken header; a body shorter than it states; no positions; half a splat layout; a face with vertices that
/// do not exist; an image named by `options` that cannot be read.
pub(crate) fn read(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let header = Header::parse(path, &bytes)?;
    let Some(vertex) = header.elements.iter().position(|e| e.name == "vertex") else {
        let names = header.elements.iter().map(|e| e.name.as_str());
        return Err(Error::format(
            path,
            "header",
            "an element `vertex`",
            format!("elements {}", super::particles::table::list(names)),
            "give a file with vertices",
        ));
    };
    if packed::is_packed(&header) {
        return packed::read(path, &bytes, &header);
    }
    let mut notes = Vec::new();
    let has = |name: &str| {
        header.elements[vertex]
            .properties
            .iter()
            .any(|p| p.name == name)
    };
    let is_splats = has("f_dc_0");
    let is_mesh = !is_splats && options.read_as != Some(ReadAs::Points);
    let mut faces = Faces::of(&header.elements, header.elements[vertex].count);
    let read = faces.as_mut().filter(|_| is_mesh);
    let rows = rows(&header, path, &bytes, vertex, read, &mut notes)?;
    let table = Table { path, rows: &rows };
    if let (true, Some(faces)) = (is_mesh, faces) {
        let texture = options.texture.as_deref();
        return mesh::dataset(input, &table, faces, &header.comments, texture, notes);
    }
    let mut data = if is_splats {
        splats(&table, &header.comments, &mut notes)?
    } else {
        let (positions, used) = table.positions()?;
        dataset(path, FORMAT, positions, table.fields(&used)?)?
    };
    let is_faces = |name: &str| matches!(name, "face" | "tristrips");
    let faces = header.elements.iter().find(|e| is_faces(&e.name));
    if let (Geometry::Points { .. }, Some(faces)) = (&data.geometry, faces)
        && faces.count > 0
    {
        notes.push(format!(
            "a mesh: its {} {} are not used, its vertices are particles",
            faces.count,
            if faces.name == "face" {
                "faces"
            } else {
                "strips"
            }
        ));
    }
    data.notes = notes;
    Ok(data)
}
