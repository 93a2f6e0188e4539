//! Reads blocks of numbers: a line of text, then the numbers component by component, x fastest.
//!
//! ```text
//! FAB ((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))((0,0,0) (7,7,7) (0,0,0)) 2
//! ```
//!
//! The first list is the form of a number: its bits, those of the exponent and of the mantissa; the first bits
//! of sign, exponent and mantissa; whether the leading one of the mantissa is stored; the bias. The second is
//! the order of its bytes: rising is big-endian. Then follow the box, which may be wider than the intended one
//! by ghost cells, and the number of components.

use std::path::Path;

use super::fault;
use super::text::{Box3, Tokens};
use crate::error::{Error, Result};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Greatest length of the line in bytes.
const LONGEST_LINE: usize = 1024;

/// Supported forms of numbers: IEEE's.
const FORMS: [(&str, ScalarType); 2] = [
    ("(32 8 23 0 1 9 0 127)", ScalarType::F32),
    ("(64 11 52 0 1 12 0 1023)", ScalarType::F64),
];

/// A block in the bytes of its file.
pub(super) struct Block<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: &'a [u8],
    /// Offset of its line.
    pub(super) start: u64,
    pub(super) dimensions: usize,
}

impl Block<'_> {
    fn fault(&self, expected: &str, found: String) -> Error {
        let place = format!("block of numbers at byte {}", self.start);
        fault(self.path, &place, expected, found)
    }

    /// The numbers of the cells in a box, by components.
    ///
    /// - `left`: number of the file's bytes that no block has used yet.
    pub(super) fn read(&self, of: &Box3, count: usize, left: &mut usize) -> Result<Vec<Values>> {
        let start = usize::try_from(self.start).ok();
        let rest = start
            .and_then(|start| self.bytes.get(start..))
            .unwrap_or(&[]);
        let line = rest.iter().take(LONGEST_LINE).position(|&b| b == b'\n');
        let line = line.unwrap_or(0);
        let text = std::str::from_utf8(&rest[..line]).unwrap_or("");
        let (encoding, extent) = self.form(text)?;
        let mut tokens = Tokens::new(self.path, extent.as_bytes())?;
        let own = tokens.box3(self.dimensions)?;
        let component_count: usize = tokens.number("components of a block")?;
        let holds = (0..3).all(|a| own.first[a] <= of.first[a] && of.last[a] <= own.last[a]);
        if !holds || component_count < count {
            let expected = format!("{count} components of {:?} to {:?}", of.first, of.last);
            return Err(self.fault(&expected, format!("`{}`", clip(text))));
        }
        // Data of two dimensions are a layer of one cell.
        let [dims, inner] = [own, *of].map(|b| b.cells(self.dimensions).map(|n| n.max(1)));
        let size = encoding.scalar.size();
        let of_component = dims.iter().try_fold(size, |n, d| n.checked_mul(*d));
        let needed = of_component.and_then(|n| n.checked_mul(count));
        let numbers = &rest[(line + 1).min(rest.len())..];
        let (Some(of_component), Some(needed)) = (of_component, needed) else {
            return Err(self.fault("numbers that fit into memory", format!("{dims:?}")));
        };
        if needed > numbers.len() || needed > *left {
            let found = format!("{} bytes", numbers.len().min(*left));
            return Err(self.fault(&format!("{needed} bytes of numbers of its own"), found));
        }
        *left -= needed;
        let shift = [0, 1, 2].map(|a| usize::try_from(of.first[a] - own.first[a]).unwrap_or(0));
        let component = |c: usize| {
            let bytes = &numbers[c * of_component..(c + 1) * of_component];
            if dims == inner {
                return all(bytes, encoding);
            }
            let mut inside = Vec::with_capacity(inner.iter().product::<usize>() * size);
            for k in 0..inner[2] {
                for j in 0..inner[1] {
                    let row = (k + shift[2]) * dims[1] + j + shift[1];
                    let first = (row * dims[0] + shift[0]) * size;
                    inside.extend_from_slice(&bytes[first..first + inner[0] * size]);
                }
            }
            all(&inside, encoding)
        };
        let components: Option<Vec<Values>> = (0..count).map(component).collect();
        components.ok_or_else(|| self.fault("numbers", "fewer".into()))
    }

    /// The form of the numbers, and the text after it.
    fn form<'t>(&self, line: &'t str) -> Result<(Encoding, &'t str)> {
        let expected = "FAB, and IEEE numbers of 32 or 64 bits in one of the two orders of bytes";
        let wrong = || self.fault(expected, format!("`{}`", clip(line)));
        let rest = line.strip_prefix("FAB ((8, ").ok_or_else(wrong)?;
        let known = FORMS.iter().find(|(form, _)| rest.starts_with(form));
        let (form, scalar) = known.ok_or_else(wrong)?;
        let rest = rest[form.len()..].strip_prefix("),(").ok_or_else(wrong)?;
        let orders = [false, true].into_iter().find_map(|big_endian| {
            let size = scalar.size();
            let order = |i: usize| if big_endian { i + 1 } else { size - i };
            let order: Vec<String> = (0..size).map(|i| order(i).to_string()).collect();
            let text = format!("{size}, ({})))", order.join(" "));
            Some((big_endian, rest.strip_prefix(text.as_str())?))
        });
        let (big_endian, rest) = orders.ok_or_else(wrong)?;
        let scalar = *scalar;
        Ok((Encoding { scalar, big_endian }, rest))
    }
}

fn all(bytes: &[u8], encoding: Encoding) -> Option<Values> {
    let step = encoding.scalar.size();
    let count = bytes.len() / step;
    let stride = Stride {
        first: 0,
        step,
        count,
    };
    values(bytes, encoding, stride)
}
