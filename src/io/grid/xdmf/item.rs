//! Reads the numbers of `DataItem` elements.
//!
//! | `Format` | content of the element |
//! |---|---|
//! | `XML` | the numbers |
//! | `HDF` | `FILE:/PATH`: a dataset of a file beside this one; behind `|` a part of it |
//! | `Binary` | the name of a file beside this one; `Seek` bytes, then numbers in the order of `Endian` |
//!
//! | `ItemType` | value |
//! |---|---|
//! | `Uniform` | the numbers |
//! | `HyperSlab` | of the second item the part that the first states: starts, strides and counts |
//! | `Function` | `JOIN($0, $1, ...)`: the numbers of several items in turn |

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::PathBuf;

use roxmltree::Node;

use super::document::{Xml, attribute, is, text};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, NotIntegers, ScalarType, integers};
use crate::io::grid::budget::Budget;
use crate::io::particles::hdf5::arrays::{ArrayFile, Selected, ShapedArray};
use crate::io::volume::voxels::beside_as;

/// Most items within one another.
const MOST_DEPTH: usize = 8;

/// Factor of the memory of arrays for the bytes of the XML itself: a number in text takes two bytes, and up to 32 in arrays
/// on its way.
const TEXT_INFLATION: usize = 4;

/// Most dimensions.
const MOST_DIMS: usize = 8;

/// Reader of the numbers of a file.
pub(super) struct Items<'a> {
    pub(super) xml: &'a Xml<'a>,
    input: Input<'a>,
    pub(super) budget: Budget<'a>,
    /// Files of binary numbers that have been read.
    files: RefCell<HashMap<PathBuf, std::rc::Rc<Vec<u8>>>>,
    /// Lengths of HDF5 files that have been opened.
    opened: RefCell<HashMap<PathBuf, u64>>,
}

impl<'a> Items<'a> {
    pub(super) fn new(xml: &'a Xml<'a>, input: Input<'a>, len: usize) -> Self {
        Self {
            xml,
            input,
            budget: Budget::new(input.path, len.saturating_mul(TEXT_INFLATION)),
            files: RefCell::default(),
            opened: RefCell::default(),
        }
    }

    /// Returns the items in an element.
    pub(super) fn of<'s>(&self, node: Node<'s, 'a>) -> Result<Vec<Node<'s, 'a>>>
    where
        'a: 's,
    {
        let children = self.xml.children(node)?;
        let items = children.into_iter().filter(|child| is(*child, "DataItem"));
        Ok(items.collect())
    }

    /// Reads the only item in an element.
    pub(super) fn only(&self, node: Node<'a, 'a>) -> Result<ShapedArray> {
        let items = self.of(node)?;
        let first = items.first();
        let first = first.ok_or_else(|| self.xml.fault(node, "a `DataItem` in it", "none"))?;
        self.read(*first, 0)
    }

    pub(super) fn read(&self, node: Node<'a, 'a>, depth: usize) -> Result<ShapedArray> {
        if depth > MOST_DEPTH {
            return Err(self.xml.fault(node, "items at most 8 deep", "more"));
        }
        let kind = attribute(node, &["ItemType", "Type"]).unwrap_or("Uniform");
        match kind.to_ascii_lowercase().as_str() {
            "uniform" => self.uniform(node, None),
            "hyperslab" => self.slab(node, depth),
            "function" => self.function(node, depth),
            _ => Err(self.xml.fault(
                node,
                "an item of the type Uniform, HyperSlab or Function",
                kind,
            )),
        }
    }

    fn uniform(&self, node: Node<'a, 'a>, part: Option<&[Selected]>) -> Result<ShapedArray> {
        let format = node.attribute("Format").unwrap_or("XML");
        let whole = match format.to_ascii_lowercase().as_str() {
            "xml" => self.in_text(node)?,
            "hdf" | "h5" | "hdf5" => return self.in_hdf5(node, part),
            "binary" => self.in_file(node)?,
            _ => {
                return Err(self
                    .xml
                    .fault(node, "the format XML, HDF or Binary", format));
            }
        };
        match part {
            Some(part) => self.cut(node, &whole, part),
            None => Ok(whole),
        }
    }

    /// Returns the dimensions that an item states.
    pub(super) fn dims(&self, node: Node<'a, 'a>) -> Result<Option<Vec<usize>>> {
        let Some(stated) = attribute(node, &["Dimensions"]) else {
            return Ok(None);
        };
        let dims: Option<Vec<usize>> = stated
            .split([' ', ',', '\t', '\n'])
            .filter(|word| !word.is_empty())
            .map(|word| word.parse().ok())
            .collect();
        let dims = dims.filter(|dims| (1..=MOST_DIMS).contains(&dims.len()));
        match dims {
            Some(dims) => Ok(Some(dims)),
            None => Err(self.xml.fault(node, "`Dimensions`: 1 to 8 counts", stated)),
        }
    }

    fn count(&self, node: Node<'a, 'a>, dims: &[usize]) -> Result<usize> {
        let count = dims.iter().try_fold(1_usize, |n, &m| n.checked_mul(m));
        count.ok_or_else(|| {
            self.xml.fault(
                node,
                "`Dimensions` of numbers that there are",
                format!("{dims:?}"),
            )
        })
    }

    fn in_text(&self, node: Node<'a, 'a>) -> Result<ShapedArray> {
        let text = text(node);
        let is_whole = self.scalar(node)?.is_some_and(|scalar| !is_float(scalar));
        self.budget
            .spend("`DataItem` as text", text.len() / 2 + 1, 8)?;
        let mut bytes = Vec::new();
        let mut count = 0;
        for word in text
            .split([' ', ',', ';', '\t', '\n', '\r'])
            .filter(|word| !word.is_empty())
        {
            let fault = || self.xml.fault(node, "numbers", word);
            if is_whole {
                let number: i64 = word.parse().map_err(|_| fault())?;
                bytes.extend(number.to_le_bytes());
            } else {
                let number: f64 = word.parse().map_err(|_| fault())?;
                bytes.extend(number.to_le_bytes());
            }
            count += 1;
        }
        let dims = self.dims(node)?.unwrap_or_else(|| vec![count]);
        if self.count(node, &dims)? != count {
            let expected = format!("as many numbers as `Dimensions` says, {dims:?}");
            return Err(self.xml.fault(node, expected, count.to_string()));
        }
        let scalar = if is_whole {
            ScalarType::I64
        } else {
            ScalarType::F64
        };
        Ok(ShapedArray {
            dims,
            encoding: Encoding {
                scalar,
                big_endian: false,
            },
            bytes,
        })
    }

    /// Returns the type of an item's numbers, if it states one.
    fn scalar(&self, node: Node<'a, 'a>) -> Result<Option<ScalarType>> {
        let Some(kind) = attribute(node, &["NumberType", "DataType"]) else {
            return Ok(None);
        };
        let precision = attribute(node, &["Precision"]);
        let bytes = precision.unwrap_or("4");
        let kind = kind.to_ascii_lowercase();
        Ok(Some(match (kind.as_str(), bytes) {
            ("float", "4") => ScalarType::F32,
            ("float", "8") => ScalarType::F64,
            ("float", "2") => ScalarType::F16,
            ("int", "4") => ScalarType::I32,
            ("int", "8") => ScalarType::I64,
            ("int" | "short", "2") => ScalarType::I16,
            ("uint", "4") => ScalarType::U32,
            ("uint", "8") => ScalarType::U64,
            ("uint" | "ushort", "2") => ScalarType::U16,
            ("short", _) => ScalarType::I16,
            ("ushort", _) => ScalarType::U16,
            ("char", _) | ("int", "1") => ScalarType::I8,
            ("uchar", _) | ("uint", "1") => ScalarType::U8,
            _ => {
                let expected = "a type and bytes of numbers: Float, Int, UInt, Char or UChar";
                return Err(self.xml.fault(node, expected, format!("{kind} {bytes}")));
            }
        }))
    }

    fn in_hdf5(&self, node: Node<'a, 'a>, part: Option<&[Selected]>) -> Result<ShapedArray> {
        let text = text(node);
        let (named, behind) = match text.split_once('|') {
            Some((named, behind)) => (named, Some(behind)),
            None => (text.as_str(), None),
        };
        let Some((file, dataset)) = named.trim().split_once(':') else {
            return Err(self.xml.fault(node, "`FILE:/PATH`", named.trim()));
        };
        let own = match behind {
            None => None,
            Some(_) if part.is_some() => {
                return Err(self
                    .xml
                    .fault(node, "one part of a dataset", "a part of a part"));
            }
            Some(behind) => Some(self.behind(node, behind)?),
        };
        let part = own.as_deref().or(part);
        let file = beside_as(self.input.path, Xml::place(node), file)?;
        if !self.opened.borrow().contains_key(&file) {
            let len = self.input.len_beside(&file).unwrap_or(0);
            // Arrays in HDF5 may be packed.
            let len_bytes = usize::try_from(len).unwrap_or(usize::MAX);
            self.budget.add(len_bytes.saturating_mul(4));
            self.opened.borrow_mut().insert(file.clone(), len);
        }
        let array = self.input.with_beside(&file, |input| {
            ArrayFile::open(input)?.array(dataset.trim(), part)
        })?;
        self.budget.spend(Xml::place(node), array.bytes.len(), 1)?;
        match (part, self.dims(node)?) {
            (None, Some(dims)) => {
                let has = array.dims.iter().product::<usize>();
                if self.count(node, &dims)? != has {
                    let expected = format!("a dataset of {dims:?} numbers");
                    return Err(self.xml.fault(node, expected, format!("{:?}", array.dims)));
                }
                Ok(ShapedArray { dims, ..array })
            }
            _ => Ok(array),
        }
    }

    /// Reads the part of a dataset that is stated behind its name: starts, strides and counts, separated by `:`.
    fn behind(&self, node: Node<'a, 'a>, text: &str) -> Result<Vec<Selected>> {
        let rows: Option<Vec<Vec<usize>>> = text
            .split([':', '|'])
            .take(3)
            .map(|row| row.split_whitespace().map(|n| n.parse().ok()).collect())
            .collect();
        let rows = rows.unwrap_or_default();
        match rows.as_slice() {
            [starts, strides, counts]
                if starts.len() == strides.len() && starts.len() == counts.len() =>
            {
                let part = starts.iter().zip(strides).zip(counts);
                Ok(part
                    .map(|((&start, &step), &count)| Selected { start, step, count })
                    .collect())
            }
            _ => Err(self.xml.fault(node, "starts, strides and counts", text)),
        }
    }

    fn in_file(&self, node: Node<'a, 'a>) -> Result<ShapedArray> {
        let compression = attribute(node, &["Compression"]).unwrap_or("Raw");
        if !compression.eq_ignore_ascii_case("raw") {
            return Err(self
                .xml
                .fault(node, "numbers without compression (Raw)", compression));
        }
        let scalar = self.scalar(node)?.unwrap_or(ScalarType::F32);
        let dims = self.dims(node)?;
        let dims = dims.ok_or_else(|| self.xml.fault(node, "`Dimensions`", "none"))?;
        let seek = attribute(node, &["Seek"]).unwrap_or("0");
        let seek: usize = seek
            .parse()
            .map_err(|_| self.xml.fault(node, "`Seek` in bytes", seek))?;
        let endian = attribute(node, &["Endian"]).unwrap_or("Native");
        let big_endian = match endian.to_ascii_lowercase().as_str() {
            "big" => true,
            // Machines that write such files today are little-endian.
            "little" | "native" => false,
            _ => {
                return Err(self
                    .xml
                    .fault(node, "`Endian` Little, Big or Native", endian));
            }
        };
        let file = beside_as(self.input.path, Xml::place(node), &text(node))?;
        let known = self.files.borrow().get(&file).cloned();
        let bytes = match known {
            Some(bytes) => bytes,
            None => {
                let bytes = std::rc::Rc::new(self.input.read_beside(&file)?);
                self.budget.add(bytes.len());
                self.files.borrow_mut().insert(file, bytes.clone());
                bytes
            }
        };
        let wanted = self.count(node, &dims)?.checked_mul(scalar.size());
        let end = wanted.and_then(|wanted| wanted.checked_add(seek));
        let own = end.and_then(|end| bytes.get(seek..end));
        let own = own.ok_or_else(|| {
            let expected = format!(
                "{dims:?} numbers of {} bytes from byte {seek} on",
                scalar.size()
            );
            self.xml
                .fault(node, expected, format!("a file of {} bytes", bytes.len()))
        })?;
        self.budget.spend(Xml::place(node), own.len(), 1)?;
        Ok(ShapedArray {
            dims,
            encoding: Encoding { scalar, big_endian },
            bytes: own.to_vec(),
        })
    }

    fn slab(&self, node: Node<'a, 'a>, depth: usize) -> Result<ShapedArray> {
        let items = self.of(node)?;
        let [stated, source] = items[..] else {
            let expected = "two items: starts, strides and counts, and the numbers";
            return Err(self.xml.fault(node, expected, items.len().to_string()));
        };
        let rows = self.whole(stated, &self.read(stated, depth + 1)?)?;
        let rank = rows.len() / 3;
        if rank == 0 || rows.len() != 3 * rank || rank > MOST_DIMS {
            let expected = "starts, strides and counts of each dimension";
            return Err(self
                .xml
                .fault(stated, expected, format!("{} numbers", rows.len())));
        }
        let part: Vec<Selected> = (0..rank)
            .map(|i| Selected {
                start: rows[i],
                step: rows[rank + i],
                count: rows[2 * rank + i],
            })
            .collect();
        let kind = attribute(source, &["ItemType", "Type"]).unwrap_or("Uniform");
        let mut array = match kind.eq_ignore_ascii_case("uniform") {
            true => self.uniform(source, Some(&part))?,
            false => self.cut(source, &self.read(source, depth + 1)?, &part)?,
        };
        if let Some(dims) = self.dims(node)? {
            let has = array.dims.iter().product::<usize>();
            if self.count(node, &dims)? != has {
                let expected = format!("a part of {dims:?} numbers");
                return Err(self.xml.fault(node, expected, format!("{:?}", array.dims)));
            }
            array.dims = dims;
        }
        Ok(array)
    }

    /// Takes a part of each dimension.
    fn cut(
        &self,
        node: Node<'a, 'a>,
        whole: &ShapedArray,
        part: &[Selected],
    ) -> Result<ShapedArray> {
        if !Selected::fit(part, &whole.dims) {
            let found: Vec<[usize; 3]> = part.iter().map(|s| [s.start, s.step, s.count]).collect();
            let expected = format!("a part of {:?}", whole.dims);
            return Err(self.xml.fault(node, expected, format!("{found:?}")));
        }
        let dims: Vec<usize> = part.iter().map(|own| own.count).collect();
        // No more numbers than the whole has.
        let count: usize = dims.iter().product();
        let size = whole.encoding.scalar.size();
        let mut bytes = Vec::with_capacity(count * size);
        for i in 0..count {
            let (mut rest, mut from, mut stride) = (i, 0, 1);
            for (own, all) in part.iter().zip(&whole.dims).rev() {
                from += stride * (own.start + own.step * (rest % own.count));
                rest /= own.count;
                stride *= all;
            }
            bytes.extend_from_slice(&whole.bytes[from * size..(from + 1) * size]);
        }
        Ok(ShapedArray {
            dims,
            encoding: whole.encoding,
            bytes,
        })
    }

    fn function(&self, node: Node<'a, 'a>, depth: usize) -> Result<ShapedArray> {
        let stated = attribute(node, &["Function"]).unwrap_or_default();
        let plain: String = stated.chars().filter(|c| !c.is_whitespace()).collect();
        let items = self.of(node)?;
        let names: Vec<String> = (0..items.len()).map(|i| format!("${i}")).collect();
        let joined = format!("JOIN({})", names.join(",")).to_ascii_uppercase();
        if items.is_empty() || !plain.eq_ignore_ascii_case(&joined) {
            let expected =
                "the function `JOIN($0, $1, ...)` of all items, the only one that is read";
            return Err(self.xml.fault(node, expected, stated));
        }
        let mut arrays = Vec::new();
        for item in items {
            arrays.push(self.read(item, depth + 1)?);
        }
        let (first, others) = arrays.split_at(1);
        let (first, dims) = (&first[0], &first[0].dims);
        if others
            .iter()
            .any(|other| other.encoding != first.encoding || other.dims != *dims)
        {
            let expected = "items of one type and the same dimensions";
            return Err(self.xml.fault(node, expected, "others"));
        }
        let size = first.encoding.scalar.size();
        self.budget
            .spend(Xml::place(node), arrays.len() * first.bytes.len(), 1)?;
        let mut bytes = Vec::with_capacity(arrays.len() * first.bytes.len());
        for i in 0..first.bytes.len() / size {
            for array in &arrays {
                bytes.extend_from_slice(&array.bytes[i * size..(i + 1) * size]);
            }
        }
        let mut dims = dims.clone();
        dims.push(arrays.len());
        Ok(ShapedArray {
            dims,
            encoding: first.encoding,
            bytes,
        })
    }

    /// Returns counts or indices.
    pub(super) fn whole(&self, node: Node<'a, 'a>, array: &ShapedArray) -> Result<Vec<usize>> {
        let numbers = self.integers(node, array)?;
        let size = |&n: &i64| usize::try_from(n);
        let all: std::result::Result<Vec<usize>, _> = numbers.iter().map(size).collect();
        all.map_err(|_| {
            self.xml
                .fault(node, "whole numbers from 0 up", "a negative one")
        })
    }

    /// Returns integers, which may be stored as floating-point numbers.
    pub(super) fn integers(&self, node: Node<'a, 'a>, array: &ShapedArray) -> Result<Vec<i64>> {
        let fault = |found: String| self.xml.fault(node, "whole numbers", found);
        self.budget.spend(
            Xml::place(node),
            array.bytes.len() / array.encoding.scalar.size(),
            8,
        )?;
        match integers(&array.bytes, array.encoding, |n| i64::try_from(n).ok()) {
            Ok(numbers) => return Ok(numbers),
            Err(NotIntegers::Refused(_, number)) => return Err(fault(number.to_string())),
            Err(NotIntegers::Fractions) => {}
        }
        let numbers = array.numbers(0, 1);
        let integer = |x: &f64| {
            let is_whole = x.fract() == 0.0 && x.abs() < 1e15;
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a whole number below 10^15"
            )]
            is_whole
                .then_some(*x as i64)
                .ok_or_else(|| fault(x.to_string()))
        };
        numbers.iter().map(integer).collect()
    }
}

fn is_float(scalar: ScalarType) -> bool {
    matches!(scalar, ScalarType::F16 | ScalarType::F32 | ScalarType::F64)
}
