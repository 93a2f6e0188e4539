//! Reads STL (`.stl`): triangles without connections, as text or binary.
//!
//! | bytes | content |
//! |---|---|
//! | 0..80 | a comment, which may begin with `solid`, as text does: the size tells them apart |
//! | 80..84 | n, u32, little-endian |
//! | 84.. | n records of 50 bytes: normal and three corners, twelve f32, and a word of attributes, u16 |
//!
//! Normals are not read: the order of corners gives the same, and many writers leave them 0. Corners at one
//! position are merged, so that surfaces are smooth where triangles meet at a small angle.
//!
//! The attributes may hold colours of five bits each, sRGB-encoded, in one of two conventions. VisCAM and
//! SolidView: the highest bit marks a colour, and blue has the lowest bits. Materialise, if the comment has
//! `COLOR=` and four bytes: the highest bit means that the comment's colour applies, and red has the lowest
//! bits.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use super::closed::are_closed;
use super::mesh_part::{LeftOut, check_not_empty, finish, plain};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{AlphaMode, Mesh, MeshPart};
use crate::error::{Error, Result};
use crate::image::linear_from_srgb;
use crate::io::bytes::file::Input;
use crate::io::vtk::xml::clip;

/// Length of the comment and the count.
const HEADER: usize = 84;
const RECORD: usize = 50;

const DAMAGED: &str = "the file is damaged: copy it or save it again";

/// The stated number of triangles of a binary file.
fn count(head: &[u8]) -> Option<u64> {
    let word = head.get(80..HEADER)?.try_into().ok()?;
    Some(u64::from(u32::from_le_bytes(word)))
}

/// Whether the length is that of a binary file with its stated number of triangles.
fn is_binary(head: &[u8], len: u64) -> bool {
    count(head).is_some_and(|n| n > 0 && len == HEADER as u64 + RECORD as u64 * n)
}

fn is_text(head: &[u8]) -> bool {
    let text = head.trim_ascii_start();
    let begins = |word: &[u8]| {
        let start = text.get(..word.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(word))
    };
    let has = |word: &[u8]| {
        let mut windows = text.windows(word.len());
        windows.any(|window| window.eq_ignore_ascii_case(word))
    };
    begins(b"solid") && (has(b"facet") || has(b"endsolid"))
}

/// Whether a file is text of triangles, or has the length of a binary file.
pub(in crate::io) fn looks_like(head: &[u8], len: u64) -> bool {
    is_binary(head, len) || is_text(head)
}

/// Reads a mesh.
///
/// # Errors
/// Fewer triangles than stated; text that breaks the format's rules; no triangle with an area.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let mut notes = Vec::new();
    let mut part = match !is_binary(&bytes, bytes.len() as u64) && is_text(&bytes) {
        true => text(path, &bytes)?,
        false => binary(path, &bytes, &mut notes)?,
    };
    let mut material = plain(!part.colours.is_empty());
    if part.colours.iter().any(|c| c[3] < 1.0) {
        material.alpha = AlphaMode::Blend;
    }
    let is_closed = are_closed(std::slice::from_ref(&part)) == [true];
    material.is_double_sided = !is_closed;
    let mut left_out = LeftOut::default();
    finish(&mut part, &mut left_out);
    notes.extend(left_out.notes());
    let mesh = Mesh {
        parts: vec![part],
        materials: vec![material],
        textures: Vec::new(),
    };
    check_not_empty(path, &mesh)?;
    Ok(Dataset {
        notes,
        ..Dataset::new(path, "STL mesh", Geometry::Mesh(mesh), Vec::new())
    })
}

/// Triangles with merged corners: those at one position and of one colour.
#[derive(Default)]
struct Corners {
    numbers: HashMap<([u64; 3], Option<u16>), u32>,
    positions: Vec<DVec3>,
    /// The attributes with each corner's colour, if it has one.
    attributes: Vec<Option<u16>>,
    triangles: Vec<[u32; 3]>,
}

impl Corners {
    fn add(&mut self, corners: [DVec3; 3], attributes: Option<u16>) {
        let triangle = corners.map(|position| {
            // 0 and -0 are one position.
            let key = (position + DVec3::ZERO).to_array().map(f64::to_bits);
            *self.numbers.entry((key, attributes)).or_insert_with(|| {
                self.positions.push(position);
                self.attributes.push(attributes);
                u32::try_from(self.positions.len() - 1).unwrap_or(u32::MAX)
            })
        });
        self.triangles.push(triangle);
    }

    fn part(self, colours: Vec<[f32; 4]>) -> MeshPart {
        MeshPart {
            positions: self.positions,
            triangles: self.triangles,
            normals: Vec::new(),
            is_flat: false,
            texture_coordinates: Vec::new(),
            colours,
            material: 0,
            ..MeshPart::default()
        }
    }
}

fn binary(path: &Path, bytes: &[u8], notes: &mut Vec<String>) -> Result<MeshPart> {
    let records = bytes.get(HEADER..).unwrap_or(&[]).chunks_exact(RECORD);
    let stated = count(bytes).unwrap_or(0);
    if stated == 0 || (records.len() as u64) < stated {
        let expected = match stated {
            0 => "`solid`, or a comment of 80 bytes and a count of triangles".to_owned(),
            _ => format!("{stated} triangles of {RECORD} bytes, as the header says"),
        };
        let found = format!("{} bytes", bytes.len());
        return Err(Error::format(path, "triangles", expected, found, DAMAGED));
    }
    if bytes.len() as u64 > HEADER as u64 + RECORD as u64 * stated {
        notes.push("bytes beyond those that the header names are left out".to_owned());
    }
    let records = records.take(usize::try_from(stated).unwrap_or(usize::MAX));
    let attributes = |record: &[u8]| u16::from_le_bytes([record[48], record[49]]);
    /// In VisCAM's attributes this bit marks a colour; in Materialise's it marks that there is none.
    const HIGHEST: u16 = 1 << 15;
    let marker = b"COLOR=";
    let whole = bytes[..80]
        .windows(marker.len() + 4)
        .find(|w| w.starts_with(marker))
        .map(|w| [0, 1, 2, 3].map(|c| w[marker.len() + c]));
    let has_colours = whole.is_some() || records.clone().any(|r| attributes(r) & HIGHEST != 0);

    let mut corners = Corners::default();
    for record in records {
        let number = |i: usize| {
            let at = 12 + 4 * i;
            f64::from(f32::from_le_bytes([
                record[at],
                record[at + 1],
                record[at + 2],
                record[at + 3],
            ]))
        };
        let corner = |i: usize| DVec3::new(number(3 * i), number(3 * i + 1), number(3 * i + 2));
        let own = has_colours.then(|| attributes(record));
        corners.add([0, 1, 2].map(corner), own);
    }
    if !has_colours {
        return Ok(corners.part(Vec::new()));
    }
    let five =
        |attributes: u16, shift: u16| linear_from_srgb(f32::from(attributes >> shift & 31) / 31.0);
    let colour = |attributes: u16| match whole {
        Some([r, g, b, a]) if attributes & HIGHEST != 0 => {
            let [r, g, b, a] = [r, g, b, a].map(|byte| f32::from(byte) / 255.0);
            let [r, g, b] = [r, g, b].map(linear_from_srgb);
            [r, g, b, a]
        }
        Some(_) => opaque([0, 5, 10].map(|shift| five(attributes, shift))),
        None if attributes & HIGHEST != 0 => {
            opaque([10, 5, 0].map(|shift| five(attributes, shift)))
        }
        None => plain(false).base_colour,
    };
    let colours = corners.attributes.iter();
    let colours = colours.map(|a| colour(a.unwrap_or(0))).collect();
    Ok(corners.part(colours))
}

/// An opaque colour.
fn opaque([r, g, b]: [f32; 3]) -> [f32; 4] {
    [r, g, b, 1.0]
}

fn text(path: &Path, bytes: &[u8]) -> Result<MeshPart> {
    let mut corners = Corners::default();
    let mut open: Vec<DVec3> = Vec::new();
    let mut last = 0;
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        last = number + 1;
        let line = line.trim_ascii();
        let fault = |expected: &str| {
            let found = format!("`{}`", clip(&String::from_utf8_lossy(line)));
            Error::format(path, format!("line {last}"), expected, found, DAMAGED)
        };
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        let word = words.next().unwrap_or(b"").to_ascii_lowercase();
        match word.as_slice() {
            b"" | b"solid" | b"endsolid" | b"facet" | b"outer" | b"endfacet" => {
                if !open.is_empty() && !word.is_empty() {
                    return Err(fault("three corners and `endloop`"));
                }
            }
            b"vertex" => {
                let number = |word: &[u8]| std::str::from_utf8(word).ok()?.parse::<f64>().ok();
                let numbers: Option<Vec<f64>> = words.map(number).collect();
                match numbers.as_deref() {
                    Some([x, y, z]) if open.len() < 3 => open.push(DVec3::new(*x, *y, *z)),
                    Some([_, _, _]) => return Err(fault("three corners and `endloop`")),
                    _ => return Err(fault("`vertex` and three numbers")),
                }
            }
            b"endloop" => match open.as_slice() {
                [a, b, c] => {
                    corners.add([*a, *b, *c], None);
                    open.clear();
                }
                _ => return Err(fault("three corners and `endloop`")),
            },
            _ => return Err(fault("a statement of STL, such as `facet` or `vertex`")),
        }
    }
    if !open.is_empty() {
        let expected = "`endloop` behind three corners";
        let place = format!("line {last}");
        return Err(Error::format(
            path,
            place,
            expected,
            "the end of the file",
            DAMAGED,
        ));
    }
    Ok(corners.part(Vec::new()))
}
