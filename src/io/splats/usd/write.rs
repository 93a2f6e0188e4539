//! Writes splats as a layer in text or in binary form, or as an archive of the latter.

use std::io::Write;
use std::path::Path;

use super::super::encoded_splats::{Encoded, note_mark_lost, offset, single_precision_quantum};
use super::binary_write;
use super::layer::{Array, Layer, METRES_PER_UNIT, PRIM, UP_AXIS, Value, documentation};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::bytes::zip_write;
use crate::parallel;

/// Boundary of an archive's members, bytes.
const ALIGNMENT: usize = 64;

/// Elements of an array that a thread writes at a time, and such pieces that are held at a time.
const PIECE: usize = 1 << 13;
const PIECES: usize = 64;

/// Containers of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Container {
    /// `.usda`: the layer in text.
    Text,
    /// `.usdc`: the layer in binary form.
    Binary,
    /// `.usdz`: an archive with the layer in binary form.
    Archive,
}

/// Returns a file with one prim, its numbers in f32. Splats that are all flat become surflets.
pub(in crate::io) fn encode(
    path: &Path,
    cloud: &SplatCloud,
    container: Container,
) -> Result<Encoded> {
    let offset = offset(&cloud.positions);
    let layer = Layer::of(cloud, offset);
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    Ok(Encoded {
        beside: Vec::new(),
        position_quantum: single_precision_quantum(cloud.positions.iter().map(|p| *p - offset)),
        order: Vec::new(),
        notes,
        bytes: match container {
            Container::Text => text(&layer),
            Container::Binary => binary_write::layer(&layer),
            Container::Archive => {
                let binary = binary_write::layer(&layer);
                let members = [("splats.usdc", binary.as_slice())];
                let too_long = || {
                    let expected = "fewer than 2^32 bytes in an archive";
                    let found = binary.len().to_string();
                    let advice = "split the scene, or write .usdc";
                    Error::format(path, "size", expected, found, advice)
                };
                zip_write::aligned(&members, ALIGNMENT).ok_or_else(too_long)?
            }
        },
    })
}

/// Returns a layer in text.
fn text(layer: &Layer<'_>) -> Vec<u8> {
    let schemas = layer.schemas.iter().map(|name| format!("\"{name}\""));
    let schemas = schemas.collect::<Vec<_>>().join(", ");
    let mut out = Out(Vec::new());
    out.text(&format!(
        "#usda 1.0\n(\n    defaultPrim = \"{PRIM}\"\n    doc = \"{}\"\n    metersPerUnit = {METRES_PER_UNIT}\n    \
         upAxis = \"{UP_AXIS}\"\n)\n\ndef {} \"{PRIM}\" (\n    prepend apiSchemas = [{schemas}]\n)\n{{\n",
        documentation(),
        layer.kind,
    ));
    for attribute in &layer.attributes {
        let uniform = if attribute.is_uniform { "uniform " } else { "" };
        out.text(&format!(
            "    {uniform}{} {} = ",
            attribute.kind, attribute.name
        ));
        match &attribute.value {
            Value::Token(token) => out.text(&format!("\"{token}\"")),
            Value::Tokens(tokens) => out.text(&format!("{tokens:?}")),
            Value::Int(number) => out.text(&number.to_string()),
            Value::Vector([x, y, z]) => out.text(&format!("({x:e}, {y:e}, {z:e})")),
            Value::Array(array) => out.array(array),
        }
        out.text("\n");
    }
    out.text("}\n");
    out.0
}

/// Text of a layer.
struct Out(Vec<u8>);

impl Out {
    fn text(&mut self, text: &str) {
        self.0.extend(text.as_bytes());
    }

    fn array(&mut self, array: &Array<'_>) {
        self.text("[");
        let (count, width) = (array.count, array.shape.width());
        let all = count.div_ceil(PIECE);
        for first in (0..all).step_by(PIECES) {
            let pieces = parallel::map(PIECES.min(all - first), |piece| {
                let start = (first + piece) * PIECE;
                let mut text = Vec::new();
                for i in start..(start + PIECE).min(count) {
                    if i > 0 {
                        text.extend(b", ");
                    }
                    element(&mut text, &(array.of)(i)[..width]);
                }
                text
            });
            for piece in pieces {
                self.0.extend(piece);
            }
        }
        self.text("]");
    }
}

/// Appends a number, or several in parentheses, with the fewest digits that are read as the same numbers.
fn element(text: &mut Vec<u8>, numbers: &[f32]) {
    if numbers.len() > 1 {
        text.push(b'(');
    }
    for (i, number) in numbers.iter().enumerate() {
        if i > 0 {
            text.extend(b", ");
        }
        let size = number.abs();
        let is_plain = *number == 0.0 || (1e-4..1e9).contains(&size);
        let written = match is_plain {
            true => write!(text, "{number}"),
            false => write!(text, "{number:e}"),
        };
        debug_assert!(written.is_ok(), "vectors take any text");
    }
    if numbers.len() > 1 {
        text.push(b')');
    }
}
