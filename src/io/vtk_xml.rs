//! What all VTK XML formats share: the file's frame and the decoding of `DataArray`s.
//!
//! ```text
//! <VTKFile type="ImageData" byte_order="LittleEndian" header_type="UInt64"
//!          compressor="vtkZLibDataCompressor">
//!   ... <DataArray type="Float32" Name="T" NumberOfComponents="1" format="appended" offset="0"/>
//!   <AppendedData encoding="raw">_...</AppendedData>
//! </VTKFile>
//! ```
//!
//! | `format` | where the numbers are |
//! |---|---|
//! | `ascii` | in the element, as text |
//! | `binary` | in the element, as base64 |
//! | `appended` | `offset` bytes after the `_` of `AppendedData`, raw or as base64 |
//!
//! A binary or appended array starts with words of `header_type` (UInt32 if it is not given):
//!
//! | uncompressed | compressed |
//! |---|---|
//! | byte count | block count, bytes per block, bytes of the last block (0: a full one), compressed bytes of each block |
//! | the bytes | the zlib streams of the blocks |
//!
//! In base64, header and data may be one stream or two; both are read. Raw appended data is
//! not XML: the file is cut at it before the rest is parsed.
//!
//! Nothing is allocated on a header's word alone: an array must have the size that the mesh
//! asks for, and its encoded bytes must be there (zlib: times [`DEFLATE_RATIO`]). All arrays
//! together may not use more encoded bytes than the file has, so that no bytes count twice.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::Read;
use std::path::Path;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use flate2::read::ZlibDecoder;
use roxmltree::{Document, Node, ParsingOptions};

use super::raw::DEFLATE_RATIO;
use super::scalars::{Encoding, ScalarType, Stride, values};
use crate::error::{Error, Result};
use crate::scene::Values;

/// Elements of one file; far more than any writer makes, far fewer than fill the memory.
const MOST_ELEMENTS: u32 = 1 << 20;

/// Whether a file that begins with `head` is a VTK XML file.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    find(head, b"<VTKFile").is_some()
        && head
            .strip_prefix(b"\xef\xbb\xbf")
            .unwrap_or(head)
            .trim_ascii_start()
            .starts_with(b"<")
}

fn find(haystack: &[u8], needle: &[u8]) -> Option<usize> {
    let first = *needle.first()?;
    let mut at = 0;
    loop {
        at += haystack.get(at..)?.iter().position(|&b| b == first)?;
        if haystack[at..].starts_with(needle) {
            return Some(at);
        }
        at += 1;
    }
}

fn find_last(haystack: &[u8], needle: &[u8]) -> Option<usize> {
    (0..haystack.len())
        .rev()
        .find(|&at| haystack[at..].starts_with(needle))
}

/// A file cut into its XML and its appended data.
#[derive(Debug)]
pub(crate) struct Frame<'a> {
    path: &'a Path,
    xml: Cow<'a, str>,
    /// What follows the `_`.
    appended: Option<&'a [u8]>,
    len: usize,
}

impl<'a> Frame<'a> {
    /// Cuts a file at its appended data.
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let not_text = |_| {
            Error::format(
                path,
                "XML",
                "UTF-8 text",
                "other bytes",
                "save the file again",
            )
        };
        let whole = |xml| Self {
            path,
            xml,
            appended: None,
            len: bytes.len(),
        };
        let all = || {
            std::str::from_utf8(bytes)
                .map(Cow::Borrowed)
                .map_err(not_text)
        };
        let Some(tag) = find(bytes, b"<AppendedData") else {
            return all().map(whole);
        };
        let cut = || {
            Error::format(
                path,
                "AppendedData",
                "`_` and the data",
                "none",
                "the file is cut off: copy or save it again",
            )
        };
        let tag_end = tag + find(&bytes[tag..], b">").ok_or_else(cut)? + 1;
        if bytes[..tag_end].ends_with(b"/>") {
            return all().map(whole);
        }
        let after = &bytes[tag_end..];
        let underscore = after.iter().position(|b| !b.is_ascii_whitespace());
        let start = underscore.filter(|&at| after[at] == b'_').ok_or_else(cut)? + 1;
        let data = &after[start..];
        let end = find_last(data, b"</AppendedData").unwrap_or(data.len());
        let mut xml = std::str::from_utf8(&bytes[..tag_end])
            .map_err(not_text)?
            .to_owned();
        xml.push_str("</AppendedData></VTKFile>");
        Ok(Self {
            path,
            xml: Cow::Owned(xml),
            appended: Some(&data[..end]),
            len: bytes.len(),
        })
    }

    /// Parses the XML.
    pub(crate) fn document(&self) -> Result<Document<'_>> {
        if u32::try_from(self.xml.len()).is_err() {
            return Err(Error::format(
                self.path,
                "XML",
                "less than 4 GiB of text",
                format!("{} bytes", self.xml.len()),
                "save the file with appended binary data",
            ));
        }
        let options = ParsingOptions {
            nodes_limit: MOST_ELEMENTS,
            ..ParsingOptions::default()
        };
        Document::parse_with_options(&self.xml, options).map_err(|e| {
            Error::format(
                self.path,
                "XML",
                "well-formed XML",
                e.to_string(),
                "save the file again",
            )
        })
    }
}

/// Decodes the arrays of one file.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    path: &'a Path,
    big_endian: bool,
    /// Bytes per header word: 4 or 8.
    word_size: usize,
    compressed: bool,
    appended: Option<(&'a [u8], bool)>,
    /// Encoded bytes that arrays may still use.
    budget: Cell<usize>,
}

/// A decoded array, one [`Values`] per component.
#[derive(Debug, Clone)]
pub(crate) struct Array {
    pub(crate) name: String,
    pub(crate) components: Vec<Values>,
}

/// Why an array cannot be decoded: what was expected, found, and what to do.
struct Fault(String, String, &'static str);

impl Fault {
    const SAVE_AGAIN: &'static str = "the file is damaged: copy or save it again";

    fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self(expected.into(), found.into(), Self::SAVE_AGAIN)
    }
}

impl<'a> Decoder<'a> {
    /// Reads the root's attributes; `kind` is the `type` that is wanted.
    pub(crate) fn new(frame: &Frame<'a>, document: &Document<'_>, kind: &str) -> Result<Self> {
        let path = frame.path;
        let root = document.root_element();
        let error = |place: &str, expected: &str, found: &str, advice: &str| {
            Err(Error::format(
                path,
                place,
                expected,
                format!("`{}`", clip(found)),
                advice,
            ))
        };
        let found = root.attribute("type").unwrap_or("");
        if root.tag_name().name() != "VTKFile" || found != kind {
            let advice = "this VTK type is not read yet: resample it to ImageData (.vti)";
            return error("VTKFile, `type`", kind, found, advice);
        }
        let big_endian = match root.attribute("byte_order") {
            Some("LittleEndian") | None => false,
            Some("BigEndian") => true,
            Some(other) => {
                let advice = "correct the attribute";
                return error(
                    "VTKFile, `byte_order`",
                    "LittleEndian or BigEndian",
                    other,
                    advice,
                );
            }
        };
        let word_size = match root.attribute("header_type") {
            Some("UInt32") | None => 4,
            Some("UInt64") => 8,
            Some(other) => {
                let advice = "correct the attribute";
                return error("VTKFile, `header_type`", "UInt32 or UInt64", other, advice);
            }
        };
        let compressed = match root.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let advice = "save the file with ZLib compression, or without any";
                return error(
                    "VTKFile, `compressor`",
                    "vtkZLibDataCompressor",
                    other,
                    advice,
                );
            }
        };
        let encoding = child(root, "AppendedData")
            .and_then(|node| node.attribute("encoding"))
            .unwrap_or("base64");
        let appended = match (frame.appended, encoding) {
            (None, _) => None,
            (Some(data), "raw") => Some((data, false)),
            (Some(data), "base64") => Some((data, true)),
            (Some(_), other) => {
                let advice = "correct the attribute";
                return error("AppendedData, `encoding`", "raw or base64", other, advice);
            }
        };
        Ok(Self {
            path,
            big_endian,
            word_size,
            compressed,
            appended,
            budget: Cell::new(frame.len),
        })
    }

    /// Decodes all numeric arrays of a `PointData` or `CellData` element, each of `count`
    /// tuples. Arrays of text or bits are left out.
    pub(crate) fn arrays(&self, element: Node<'_, '_>, count: usize) -> Result<Vec<Array>> {
        let mut arrays = Vec::new();
        for node in element.children().filter(|n| n.has_tag_name("DataArray")) {
            let Some(scalar) = node.attribute("type").and_then(scalar_type) else {
                continue;
            };
            let name = match node.attribute("Name") {
                Some(name) => name.to_owned(),
                None => format!("array {}", arrays.len() + 1),
            };
            let components =
                self.array(node, scalar, count)
                    .map_err(|Fault(expected, found, advice)| {
                        Error::format(
                            self.path,
                            format!("DataArray `{}`", clip(&name)),
                            expected,
                            found,
                            advice,
                        )
                    })?;
            arrays.push(Array { name, components });
        }
        Ok(arrays)
    }

    fn array(
        &self,
        node: Node<'_, '_>,
        scalar: ScalarType,
        count: usize,
    ) -> Result<Vec<Values>, Fault> {
        let component_count = match node.attribute("NumberOfComponents") {
            None => 1,
            Some(text) => text
                .trim()
                .parse()
                .ok()
                .filter(|&n: &usize| n > 0)
                .ok_or_else(|| {
                    Fault::new(
                        "`NumberOfComponents` of at least 1",
                        format!("`{}`", clip(text)),
                    )
                })?,
        };
        let numbers = count.checked_mul(component_count);
        let size = numbers
            .and_then(|n| n.checked_mul(scalar.size()))
            .ok_or_else(|| {
                Fault::new(
                    "an array that fits into memory",
                    format!("{count} x {component_count}"),
                )
            })?;
        let text = || -> Cow<'_, str> {
            let mut texts = node
                .children()
                .filter(Node::is_text)
                .filter_map(|n| n.text());
            let first = texts.next().unwrap_or("");
            texts.fold(Cow::Borrowed(first), |all, more| {
                Cow::Owned(all.into_owned() + more)
            })
        };
        let mut encoding = Encoding {
            scalar,
            big_endian: self.big_endian,
        };
        let bytes = match node.attribute("format") {
            Some("ascii") | None => {
                encoding.big_endian = false;
                Cow::Owned(ascii(&text(), scalar, size / scalar.size())?)
            }
            Some("binary") => {
                let text = text();
                let bytes = self.binary(Source::base64(text.as_bytes()), size)?;
                Cow::Owned(bytes.into_owned())
            }
            Some("appended") => {
                let (data, is_base64) = self
                    .appended
                    .ok_or_else(|| Fault::new("an AppendedData element", "none"))?;
                let offset = node.attribute("offset").unwrap_or("");
                let data = offset
                    .trim()
                    .parse()
                    .ok()
                    .and_then(|at: usize| data.get(at..))
                    .ok_or_else(|| {
                        Fault::new(
                            format!("an `offset` within {} bytes of appended data", data.len()),
                            format!("`{}`", clip(offset)),
                        )
                    })?;
                self.binary(
                    if is_base64 {
                        Source::base64(data)
                    } else {
                        Source::Raw(data)
                    },
                    size,
                )?
            }
            Some(other) => {
                return Err(Fault::new(
                    "`format` ascii, binary or appended",
                    format!("`{}`", clip(other)),
                ));
            }
        };
        let size = scalar.size();
        (0..component_count)
            .map(|c| {
                let stride = Stride {
                    first: c * size,
                    step: component_count * size,
                    count,
                };
                values(&bytes, encoding, stride)
                    .ok_or_else(|| Fault::new(format!("{count} values"), "fewer"))
            })
            .collect()
    }

    /// Decodes a binary array that must have `size` bytes.
    fn binary<'d>(&self, mut source: Source<'d>, size: usize) -> Result<Cow<'d, [u8]>, Fault> {
        let before = source.remaining();
        let bytes = if self.compressed {
            self.compressed(&mut source, size)?
        } else {
            let found = self.words(&mut source, 1)?[0];
            if found != size as u64 {
                return Err(Fault::new(
                    format!("{size} bytes, as the extent and the type ask for"),
                    format!("{found} bytes"),
                ));
            }
            source.take(size)?
        };
        let used = before - source.remaining();
        let budget = self.budget.get().checked_sub(used).ok_or_else(|| {
            Fault::new(
                "arrays that do not overlap",
                "more encoded bytes than the file has",
            )
        })?;
        self.budget.set(budget);
        Ok(bytes)
    }

    fn compressed<'d>(&self, source: &mut Source<'d>, size: usize) -> Result<Cow<'d, [u8]>, Fault> {
        let block_count = self.words(source, 1)?[0];
        if block_count == 0 {
            return if size == 0 {
                Ok(Cow::Borrowed(&[]))
            } else {
                Err(Fault::new(format!("{size} bytes"), "no compressed block"))
            };
        }
        let [block_size, last_size] = self.words(source, 2)?[..] else {
            return Err(Fault::new("a block size", "none"));
        };
        let last_size = if last_size == 0 {
            block_size
        } else {
            last_size
        };
        let claimed = (block_count - 1)
            .checked_mul(block_size)
            .and_then(|n| n.checked_add(last_size));
        if claimed != Some(size as u64) {
            return Err(Fault::new(
                format!("{size} bytes, as the extent and the type ask for"),
                format!("{block_count} blocks of {block_size} bytes, the last of {last_size}"),
            ));
        }
        let block_count = usize::try_from(block_count)
            .map_err(|_| Fault::new("blocks that fit into memory", format!("{block_count}")))?;
        let compressed_sizes = self.words(source, block_count)?;
        let compressed_sum = compressed_sizes
            .iter()
            .try_fold(0_u64, |sum, &n| sum.checked_add(n));
        let present = compressed_sum.filter(|&n| n <= source.remaining() as u64);
        if present.is_none_or(|n| size as u64 > n.saturating_mul(DEFLATE_RATIO)) {
            return Err(Fault::new(
                format!("zlib data for {size} bytes"),
                format!(
                    "{} bytes",
                    compressed_sum.map_or("too many".to_owned(), |n| n.to_string())
                ),
            ));
        }
        let mut bytes = Vec::new();
        for (i, &compressed_size) in compressed_sizes.iter().enumerate() {
            let wanted = if i + 1 == block_count {
                last_size
            } else {
                block_size
            };
            let compressed_size = usize::try_from(compressed_size).unwrap_or(usize::MAX);
            let block = source.take(compressed_size)?;
            let start = bytes.len() as u64;
            ZlibDecoder::new(&block[..])
                .take(wanted.saturating_add(1))
                .read_to_end(&mut bytes)
                .map_err(|e| Fault::new(format!("zlib data in block {i}"), e.to_string()))?;
            let found = bytes.len() as u64 - start;
            if found != wanted {
                return Err(Fault::new(
                    format!("{wanted} bytes in block {i}"),
                    if found < wanted {
                        format!("{found}")
                    } else {
                        "more".to_owned()
                    },
                ));
            }
        }
        Ok(Cow::Owned(bytes))
    }

    /// Header words.
    fn words(&self, source: &mut Source<'_>, count: usize) -> Result<Vec<u64>, Fault> {
        let size = count
            .checked_mul(self.word_size)
            .ok_or_else(|| Fault::new("a header within the file", format!("{count} words")))?;
        let bytes = source.take(size)?;
        let word = |chunk: &[u8]| {
            let fold = |n: u64, &b: &u8| n << 8 | u64::from(b);
            if self.big_endian {
                chunk.iter().fold(0, fold)
            } else {
                chunk.iter().rev().fold(0, fold)
            }
        };
        Ok(bytes.chunks_exact(self.word_size).map(word).collect())
    }
}

/// Encoded bytes and how far they have been read.
enum Source<'d> {
    Raw(&'d [u8]),
    Base64 {
        text: &'d [u8],
        /// Decoded bytes that have not been taken yet: fewer than three.
        carry: Vec<u8>,
    },
}

impl<'d> Source<'d> {
    fn base64(text: &'d [u8]) -> Self {
        Self::Base64 {
            text,
            carry: Vec::new(),
        }
    }

    /// Encoded bytes that are left.
    fn remaining(&self) -> usize {
        match self {
            Self::Raw(data) => data.len(),
            Self::Base64 { text, .. } => text.len(),
        }
    }

    /// The next `count` decoded bytes.
    fn take(&mut self, count: usize) -> Result<Cow<'d, [u8]>, Fault> {
        let cut = |found: usize| Fault::new(format!("{count} more bytes"), format!("only {found}"));
        match self {
            Self::Raw(data) => {
                let (taken, rest) = data
                    .split_at_checked(count)
                    .ok_or_else(|| cut(data.len()))?;
                *data = rest;
                Ok(Cow::Borrowed(taken))
            }
            Self::Base64 { text, carry } => {
                let present = carry.len() + text.len() / 4 * 3 + 3;
                if count > present {
                    return Err(cut(present));
                }
                let mut decoded = std::mem::take(carry);
                while decoded.len() < count {
                    let before = decoded.len();
                    decode_base64(text, count - before, &mut decoded)?;
                    if decoded.len() == before {
                        return Err(cut(before));
                    }
                }
                *carry = decoded.split_off(count);
                Ok(Cow::Owned(decoded))
            }
        }
    }
}

/// Accepts bits set beyond the last byte, as some writers leave them.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Decodes whole quads from the front of `text`: enough for `count` bytes, at most a buffer
/// full, and not beyond a padded quad, where one stream ends and the next may begin.
fn decode_base64(text: &mut &[u8], count: usize, decoded: &mut Vec<u8>) -> Result<(), Fault> {
    const MOST_QUADS: usize = 1 << 14;
    let wanted = 4 * count.div_ceil(3).min(MOST_QUADS);
    let mut quads = Vec::with_capacity(wanted);
    let mut used = 0;
    for &b in *text {
        if quads.len() == wanted || (quads.len() % 4 == 0 && quads.last() == Some(&b'=')) {
            break;
        }
        used += 1;
        if !b.is_ascii_whitespace() {
            quads.push(b);
        }
    }
    *text = &text[used..];
    BASE64
        .decode_vec(&quads, decoded)
        .map_err(|e| Fault::new("base64", e.to_string()))
}

/// Parses numbers in text into little-endian bytes.
fn ascii(text: &str, scalar: ScalarType, count: usize) -> Result<Vec<u8>, Fault> {
    // Each number takes a character and, but for the last, a separator.
    if count > text.len() / 2 + 1 {
        return Err(Fault::new(
            format!("{count} numbers"),
            format!("{} characters", text.len()),
        ));
    }
    let mut bytes = Vec::with_capacity(count * scalar.size());
    let mut found = 0;
    for word in text.split_ascii_whitespace() {
        found += 1;
        if found > count {
            return Err(Fault::new(format!("{count} numbers"), "more"));
        }
        macro_rules! push {
            ($t:ty) => {
                word.parse::<$t>()
                    .ok()
                    .map(|x| bytes.extend(x.to_le_bytes()))
            };
        }
        let parsed = match scalar {
            ScalarType::I8 => push!(i8),
            ScalarType::U8 => push!(u8),
            ScalarType::I16 => push!(i16),
            ScalarType::U16 => push!(u16),
            ScalarType::I32 => push!(i32),
            ScalarType::U32 => push!(u32),
            ScalarType::I64 => push!(i64),
            ScalarType::U64 => push!(u64),
            ScalarType::F32 => push!(f32),
            ScalarType::F64 => push!(f64),
        };
        if parsed.is_none() {
            return Err(Fault(
                format!("a number of the array's type as number {found}"),
                format!("`{}`", clip(word)),
                "correct it",
            ));
        }
    }
    if found < count {
        return Err(Fault::new(format!("{count} numbers"), format!("{found}")));
    }
    Ok(bytes)
}

fn scalar_type(name: &str) -> Option<ScalarType> {
    Some(match name {
        "Int8" => ScalarType::I8,
        "UInt8" => ScalarType::U8,
        "Int16" => ScalarType::I16,
        "UInt16" => ScalarType::U16,
        "Int32" => ScalarType::I32,
        "UInt32" => ScalarType::U32,
        "Int64" => ScalarType::I64,
        "UInt64" => ScalarType::U64,
        "Float32" => ScalarType::F32,
        "Float64" => ScalarType::F64,
        _ => return None,
    })
}

/// The first child element of a name.
pub(crate) fn child<'d, 'i>(node: Node<'d, 'i>, name: &str) -> Option<Node<'d, 'i>> {
    node.children().find(|n| n.has_tag_name(name))
}

/// The `N` numbers of an attribute, or `default` where there is none.
pub(crate) fn numbers<const N: usize, T: std::str::FromStr + Copy>(
    path: &Path,
    node: Node<'_, '_>,
    name: &str,
    default: Option<[T; N]>,
) -> Result<[T; N]> {
    let text = node.attribute(name);
    if let (None, Some(default)) = (text, default) {
        return Ok(default);
    }
    let text = text.unwrap_or("");
    let parsed: Option<Vec<T>> = text
        .split_ascii_whitespace()
        .map(|w| w.parse().ok())
        .collect();
    parsed.and_then(|n| n.try_into().ok()).ok_or_else(|| {
        Error::format(
            path,
            format!("{}, `{name}`", node.tag_name().name()),
            format!("{N} numbers"),
            format!("`{}`", clip(text)),
            "correct the attribute",
        )
    })
}

/// A text short enough for a message.
pub(crate) fn clip(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_streams_may_be_joined_or_apart() {
        for text in [
            "AQIDBAUG",
            "AQ==AgMEBQY=",
            "AQI=\n AwQF Bg==\n",
            "AQIDBA==BQY=",
        ] {
            for step in 1..=6 {
                let mut source = Source::base64(text.as_bytes());
                let mut all = Vec::new();
                while all.len() < 6 {
                    let taken = source.take(step.min(6 - all.len())).ok().unwrap();
                    all.extend_from_slice(&taken);
                }
                assert_eq!(all, [1, 2, 3, 4, 5, 6]);
                assert!(source.take(1).is_err());
            }
        }
    }

    #[test]
    fn a_claim_beyond_the_text_is_refused_before_it_is_allocated() {
        assert!(Source::base64(b"AQID").take(usize::MAX).is_err());
        assert!(Source::Raw(&[1, 2]).take(3).is_err());
        assert!(ascii("1 2 3", ScalarType::F64, usize::MAX).is_err());
    }
}
