//! Parses the data set of a DICOM file. Its elements have a tag, a type (VR), a length and a value; the value may be a
//! sequence of data sets.
//!
//! | bytes, explicit | implicit | contents |
//! |---|---|---|
//! | 0..4 | 0..4 | the tag: a group and an element, 16 bits each |
//! | 4..6 | | the VR: two letters |
//! | 6..8, or 8..12 of the VRs in [`LONG`] | 4..8 | the length of the value; `ffffffff` if a delimiter ends it |
//!
//! Items of sequences and fragments of packed pixels have the tag (fffe,e000) and no VR. The delimiter (fffe,e00d) ends
//! an item, and (fffe,e0dd) ends a sequence. An element of type UN without a length is implicit and little-endian in
//! any file (PS3.5, 6.2.2).
//!
//! The parser keeps only the elements that the reader uses, and skips all others. Values are slices of the file's
//! bytes. If a tag repeats, its first element counts. So memory use is bounded by the length of the file.

use super::tags::{self, Kind, Tag};
use crate::io::bytes::scalars::{Encoding, ScalarType, double};

/// VRs with 32-bit lengths, behind two unused bytes.
const LONG: [&[u8; 2]; 13] = [
    b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV",
];

/// VRs with 16-bit lengths.
const SHORT: [&[u8; 2]; 21] = [
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN",
    b"SH", b"SL", b"SS", b"ST", b"TM", b"UI", b"UL", b"US",
];

/// Advice for most faults.
pub(super) const DAMAGED: &str = "the file is damaged: copy it or save it again";

const UNDEFINED: u32 = u32::MAX;

/// Greatest depth of nested sequences, more than in any standard file.
const DEEPEST: usize = 32;

/// Reason why a data set cannot be read, and its place in the bytes.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) expected: &'static str,
    pub(super) found: String,
}

/// Layout of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Coding {
    pub(super) explicit: bool,
    pub(super) big_endian: bool,
}

impl Coding {
    pub(super) const EXPLICIT: Self = Self {
        explicit: true,
        big_endian: false,
    };
    pub(super) const IMPLICIT: Self = Self {
        explicit: false,
        big_endian: false,
    };

    /// Corrects the layout by the first element, because some files state the wrong one of explicit and implicit.
    pub(super) fn as_found(self, start: &[u8]) -> Self {
        let vr = start.get(4..6).and_then(|vr| vr.try_into().ok());
        match vr {
            Some(vr) => Self {
                explicit: is_vr(vr),
                ..self
            },
            None => self,
        }
    }
}

/// Returns true if two bytes are a VR.
pub(super) fn is_vr(vr: &[u8; 2]) -> bool {
    LONG.contains(&vr) || SHORT.contains(&vr)
}

#[derive(Debug)]
pub(super) enum Value<'b> {
    Bytes(&'b [u8]),
    Items(Vec<DataSet<'b>>),
    /// Packed pixels: the table of offsets, then the fragments.
    Fragments(Vec<&'b [u8]>),
}

#[derive(Debug)]
pub(super) struct Element<'b> {
    tag: Tag,
    /// Zeros in implicit files.
    pub(super) vr: [u8; 2],
    pub(super) value: Value<'b>,
}

/// Elements with known tags, each once.
#[derive(Debug, Default)]
pub(super) struct DataSet<'b> {
    elements: Vec<Element<'b>>,
    big_endian: bool,
}

impl<'b> DataSet<'b> {
    pub(super) fn get(&self, tag: Tag) -> Option<&Element<'b>> {
        self.elements.iter().find(|element| element.tag == tag)
    }

    fn bytes(&self, tag: Tag) -> Option<&'b [u8]> {
        match self.get(tag)?.value {
            Value::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// Returns a text without leading and trailing spaces and zeros; `None` if nothing remains.
    pub(super) fn text(&self, tag: Tag) -> Option<&'b str> {
        let text = std::str::from_utf8(self.bytes(tag)?).ok()?;
        let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
        (!text.is_empty()).then_some(text)
    }

    /// Returns numbers in text, separated by backslashes; `None` if any cannot be parsed.
    pub(super) fn numbers(&self, tag: Tag) -> Option<Vec<f64>> {
        let text = self.text(tag)?;
        let number = |word: &str| {
            let word = word.trim_matches(|c: char| c == '\0' || c.is_whitespace());
            word.parse().ok().filter(|x: &f64| x.is_finite())
        };
        text.split('\\').map(number).collect()
    }

    /// Returns exactly `N` numbers in text.
    pub(super) fn numbers_of<const N: usize>(&self, tag: Tag) -> Option<[f64; N]> {
        self.numbers(tag)?.try_into().ok()
    }

    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.numbers(tag)?.first().copied()
    }

    /// Returns a binary 16-bit number.
    pub(super) fn short(&self, tag: Tag) -> Option<u16> {
        let bytes: [u8; 2] = self.bytes(tag)?.get(..2)?.try_into().ok()?;
        Some(match self.big_endian {
            true => u16::from_be_bytes(bytes),
            false => u16::from_le_bytes(bytes),
        })
    }

    /// Returns a binary number in single or double precision.
    pub(super) fn float(&self, tag: Tag, scalar: ScalarType) -> Option<f64> {
        let bytes = self.bytes(tag)?.get(..scalar.size())?;
        let big_endian = self.big_endian;
        Some(double(bytes, Encoding { scalar, big_endian }))
    }

    pub(super) fn items(&self, tag: Tag) -> &[DataSet<'b>] {
        match self.get(tag).map(|element| &element.value) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    /// Returns the first item of a sequence.
    pub(super) fn item(&self, tag: Tag) -> Option<&DataSet<'b>> {
        self.items(tag).first()
    }
}

/// Reads elements as long as they belong to `group`, and returns the start of the next element.
pub(super) fn read_group<'b>(
    bytes: &'b [u8],
    start: usize,
    group: u32,
    into: &mut DataSet<'b>,
) -> Result<usize, Fault> {
    let mut parser = Parser {
        bytes,
        at: start,
        coding: Coding::EXPLICIT,
    };
    while parser.peek_group() == Some(group) {
        let header = parser.header()?;
        parser.element(&header, bytes.len(), into, 0)?;
    }
    Ok(parser.at)
}

/// Reads elements up to the pixels, and the pixels. On a fault, the elements before it are kept.
pub(super) fn read_into<'b>(
    bytes: &'b [u8],
    start: usize,
    coding: Coding,
    into: &mut DataSet<'b>,
) -> Result<(), Fault> {
    into.big_endian = coding.big_endian;
    let mut parser = Parser {
        bytes,
        at: start,
        coding,
    };
    while parser.at < bytes.len() {
        let header = parser.header()?;
        if header.tag == tags::PIXEL_DATA && header.len.is_none() {
            let value = Value::Fragments(parser.fragments()?);
            into.keep(&header, value);
            return Ok(());
        }
        parser.element(&header, bytes.len(), into, 0)?;
        if tags::PIXELS.contains(&header.tag) {
            return Ok(());
        }
    }
    Ok(())
}

impl<'b> DataSet<'b> {
    fn keep(&mut self, header: &Header, value: Value<'b>) {
        if self.get(header.tag).is_none() {
            // Exact reservation saves memory: there are many items with few elements.
            self.elements.reserve_exact(1);
            self.elements.push(Element {
                tag: header.tag,
                vr: header.vr,
                value,
            });
        }
    }
}

struct Header {
    tag: Tag,
    vr: [u8; 2],
    len: Option<usize>,
}

struct Parser<'b> {
    bytes: &'b [u8],
    at: usize,
    coding: Coding,
}

impl<'b> Parser<'b> {
    fn fault(&self, expected: &'static str, found: impl Into<String>) -> Fault {
        Fault {
            at: self.at,
            expected,
            found: found.into(),
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(taken) = rest.first_chunk::<N>() else {
            let expected = "a whole element";
            return Err(self.fault(expected, format!("{} bytes", rest.len())));
        };
        self.at += N;
        Ok(*taken)
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        let bytes = self.take()?;
        Ok(match self.coding.big_endian {
            true => u16::from_be_bytes(bytes),
            false => u16::from_le_bytes(bytes),
        })
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        let bytes = self.take()?;
        Ok(match self.coding.big_endian {
            true => u32::from_be_bytes(bytes),
            false => u32::from_le_bytes(bytes),
        })
    }

    fn peek_group(&self) -> Option<u32> {
        let word = self.bytes.get(self.at..self.at + 2)?.try_into().ok()?;
        Some(u32::from(u16::from_le_bytes(word)))
    }

    fn header(&mut self) -> Result<Header, Fault> {
        let start = self.at;
        let tag = u32::from(self.u16()?) << 16 | u32::from(self.u16()?);
        let mut vr = [0; 2];
        let is_item = tag >> 16 == tags::ITEM >> 16;
        let len = if self.coding.explicit && !is_item {
            vr = self.take()?;
            if !vr.iter().all(u8::is_ascii_alphabetic) {
                self.at = start;
                let found = format!("bytes {:02x} {:02x}", vr[0], vr[1]);
                return Err(self.fault("an element with two letters of its type", found));
            }
            if LONG.contains(&&vr) {
                self.take::<2>()?;
                self.u32()?
            } else {
                u32::from(self.u16()?)
            }
        } else {
            self.u32()?
        };
        let len = (len != UNDEFINED).then(|| usize::try_from(len).unwrap_or(usize::MAX));
        Ok(Header { tag, vr, len })
    }

    /// Returns the end of a value of this length.
    fn end_of(&self, len: usize, end: usize) -> Result<usize, Fault> {
        let ends = self.at.checked_add(len).filter(|ends| *ends <= end);
        ends.ok_or_else(|| {
            let left = end.saturating_sub(self.at);
            let expected = "as many bytes as the element says";
            self.fault(expected, format!("{left} of {len}"))
        })
    }

    /// Reads the value of an element, and keeps it if its tag is known.
    fn element(
        &mut self,
        header: &Header,
        end: usize,
        into: &mut DataSet<'b>,
        depth: usize,
    ) -> Result<(), Fault> {
        let kind = tags::kind(header.tag);
        let is_sequence = kind == Some(Kind::Sequence);
        let Some(len) = header.len else {
            let items = self.sequence(header, end, false, is_sequence, depth)?;
            if is_sequence {
                into.keep(header, Value::Items(items));
            }
            return Ok(());
        };
        let ends = self.end_of(len, end)?;
        if is_sequence {
            let items = self.sequence(header, ends, true, true, depth)?;
            into.keep(header, Value::Items(items));
        } else if kind.is_some() {
            into.keep(header, Value::Bytes(&self.bytes[self.at..ends]));
        }
        self.at = ends;
        Ok(())
    }

    /// Returns the items of a sequence, or none if they are not kept.
    ///
    /// - `has_end`: true if the sequence ends where its bytes do, and not at a delimiter.
    fn sequence(
        &mut self,
        header: &Header,
        end: usize,
        has_end: bool,
        is_kept: bool,
        depth: usize,
    ) -> Result<Vec<DataSet<'b>>, Fault> {
        if depth == DEEPEST {
            let found = format!("more than {DEEPEST}");
            return Err(self.fault("some sequences in each other", found));
        }
        let outer = self.coding;
        if &header.vr == b"UN" {
            self.coding = Coding::IMPLICIT;
        }
        let mut items = Vec::new();
        loop {
            if has_end && self.at >= end {
                break;
            }
            let item = self.header()?;
            if item.tag == tags::SEQUENCE_END {
                break;
            }
            if item.tag != tags::ITEM {
                let found = format!("the tag ({})", tags::shown(item.tag));
                return Err(self.fault("an item, or the end of the sequence", found));
            }
            let ends = match item.len {
                Some(len) => Some(self.end_of(len, end)?),
                None => None,
            };
            if let (Some(ends), false) = (ends, is_kept) {
                self.at = ends;
                continue;
            }
            let mut kept = DataSet {
                elements: Vec::new(),
                big_endian: self.coding.big_endian,
            };
            let mut passed_over = DataSet::default();
            let into = if is_kept { &mut kept } else { &mut passed_over };
            self.item(ends, end, into, depth)?;
            if is_kept {
                items.push(kept);
            }
        }
        self.coding = outer;
        Ok(items)
    }

    /// Reads the elements of an item, up to its end or to a delimiter.
    fn item(
        &mut self,
        ends: Option<usize>,
        end: usize,
        into: &mut DataSet<'b>,
        depth: usize,
    ) -> Result<(), Fault> {
        while ends.is_none_or(|ends| self.at < ends) {
            let header = self.header()?;
            if header.tag == tags::ITEM_END {
                break;
            }
            self.element(&header, ends.unwrap_or(end), into, depth + 1)?;
        }
        Ok(())
    }

    /// Returns the table of offsets and the fragments of packed pixels.
    fn fragments(&mut self) -> Result<Vec<&'b [u8]>, Fault> {
        let mut fragments = Vec::new();
        // The delimiter of the last sequence may be missing.
        while self.at < self.bytes.len() {
            let item = self.header()?;
            match (item.tag, item.len) {
                (tags::SEQUENCE_END, _) => break,
                (tags::ITEM, Some(len)) => {
                    let ends = self.end_of(len, self.bytes.len())?;
                    fragments.push(&self.bytes[self.at..ends]);
                    self.at = ends;
                }
                (tag, _) => {
                    let found = format!("the tag ({})", tags::shown(tag));
                    return Err(self.fault("a part of the packed pixels", found));
                }
            }
        }
        Ok(fragments)
    }
}
