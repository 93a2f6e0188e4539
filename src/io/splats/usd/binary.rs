//! Parses layers in binary form (`.usdc`), as far as splats need them; all numbers little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 0..8 | `PXR-USDC` |
//! | 8..16 | version: major 0, minor, patch |
//! | 16..24 | offset of the table of sections |
//!
//! The table has a count (u64) and for each section its name (16 bytes), offset and length (i64):
//!
//! | section | content |
//! |---|---|
//! | `TOKENS` | count, unpacked length, packed length; texts that end in zeros, packed |
//! | `STRINGS` | count; indices of tokens (u32) |
//! | `FIELDS` | count; indices of tokens, packed integers; packed length; values (u64), packed |
//! | `FIELDSETS` | count; indices of fields, packed integers: lists that end in -1 |
//! | `PATHS` | slots, count; three lists of packed integers: slot, token (negative: a property), jump |
//! | `SPECS` | count; three lists of packed integers: path, first place among the field sets, kind |
//!
//! Paths are a tree in depth-first order. A jump of -2 marks a leaf without a next sibling, -1 a child alone, 0 a
//! sibling alone; others are the distance to the sibling behind the children.
//!
//! A value has its type in bits 48 to 55; bit 63 marks arrays, bit 62 values in place of the offset, bit 61 packed
//! arrays. The other 48 bits are the offset. Bytes are packed by LZ4. Packed integers are differences of neighbours: the
//! most frequent one, two bits for each, and others in 1, 2 or 4 bytes.
//!
//! Files before version 0.4 are not packed, and are not read. Packing is no bound of a count, so that tables, texts and
//! arrays have their own bounds, from the length of the file.

use std::array;
use std::cell::Cell;
use std::path::Path;

use super::stage::{Attribute, Kind, Prim, Stage, Value, kind_of};
use crate::error::{Error, Result};
use crate::io::bytes::half::half;
use crate::io::vtk::xml::clip;
use crate::math::narrowed;

/// The first bytes of every layer in binary form.
pub(super) const MAGIC: &[u8; 8] = b"PXR-USDC";

/// Entries that a table may have in any file. Larger files may have one for every four bytes.
const MOST_ENTRIES: usize = 1 << 18;

/// Numbers that arrays may have in any file. Larger files may have two for each byte: arrays in half floats, and some
/// that several prims share.
const MOST_NUMBERS: usize = 1 << 20;

/// Bytes of tokens that any file may have. Larger files may have four for each byte.
const MOST_TOKENS: usize = 1 << 20;

/// Bytes of words and names that attributes may have in any file. Larger files may have eight for each byte.
const MOST_WORDS: usize = 1 << 20;

/// Greatest length of names in bytes.
const MOST_NAME: usize = 256;

/// Greatest number of fields of a prim or a property.
const MOST_FIELDS: usize = 64;

/// Length of arrays from which they are packed.
const LEAST_PACKED: usize = 16;

/// Greatest ratio of LZ4.
const LZ4_RATIO: usize = 255;

/// Kinds of specs that are read.
pub(super) const ATTRIBUTE: u32 = 1;
pub(super) const PRIM: u32 = 6;
pub(super) const ROOT: u32 = 7;

/// Mark of what is not there: a parent, a spec, the end of a set of fields.
pub(super) const NONE: u32 = u32::MAX;

/// Parses a layer.
///
/// # Errors
/// Another version; sections or values outside the file, or with counts that it cannot hold.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Stage> {
    let advice = "the file is cut off or damaged: get it again, or rewrite it with `usdcat`";
    let [major, minor] = array::from_fn(|i| bytes.get(8 + i).copied().unwrap_or_default());
    if major != 0 || minor < 4 {
        return Err(Error::format(
            path,
            "header",
            "version 0.4 or later",
            format!("version {major}.{minor}, which is not read"),
            "write it as text: `usdcat FILE --out new.usda`",
        ));
    }
    let fault = |place: String| {
        Error::format(
            path,
            place,
            "counts and offsets within the file",
            "counts or offsets beyond it",
            advice,
        )
    };
    let section = |name: &str| fault(format!("section {name}"));
    let sections = sections(bytes).ok_or_else(|| fault("table of sections".into()))?;
    let open = |name: &str| {
        let found = sections.iter().find(|(n, _)| n == name);
        found.map_or(Cursor(&[]), |(_, bytes)| Cursor(bytes))
    };
    let len = bytes.len();
    let most = MOST_ENTRIES.max(len / 4);
    let most_text = MOST_TOKENS.max(4 * len);
    let tokens = Tokens::parse(open("TOKENS"), most, most_text);
    let tokens = tokens.ok_or_else(|| section("TOKENS"))?;
    let strings = strings(open("STRINGS")).ok_or_else(|| section("STRINGS"))?;
    let fields = fields(open("FIELDS"), most).ok_or_else(|| section("FIELDS"))?;
    let sets = counted(open("FIELDSETS"), most).ok_or_else(|| section("FIELDSETS"))?;
    let paths = Paths::parse(open("PATHS"), most).ok_or_else(|| section("PATHS"))?;
    let specs = specs(open("SPECS"), most).ok_or_else(|| section("SPECS"))?;
    let layer = Layer {
        bytes,
        minor,
        tokens,
        strings,
        fields,
        sets,
        numbers_left: Cell::new(MOST_NUMBERS.max(2 * len)),
        words_left: Cell::new(MOST_WORDS.max(8 * len)),
    };
    layer.stage(&paths, &specs).map_err(fault)
}

/// Bytes that are taken from the front.
#[derive(Clone, Copy)]
struct Cursor<'a>(&'a [u8]);

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A count or an offset.
    fn size(&mut self) -> Option<usize> {
        usize::try_from(self.u64()?).ok()
    }

    /// A count of at most `most`.
    fn count(&mut self, most: usize) -> Option<usize> {
        self.size().filter(|count| *count <= most)
    }
}

/// The sections of a file by name.
fn sections(bytes: &[u8]) -> Option<Vec<(String, &[u8])>> {
    let mut table = Cursor(bytes.get(16..)?);
    let start = table.size()?;
    let mut table = Cursor(bytes.get(start..)?);
    let count = table.count(bytes.len() / 32)?;
    let mut sections = Vec::with_capacity(count);
    for _ in 0..count {
        let name = table.take(16)?.split(|byte| *byte == 0).next()?;
        let (start, size) = (table.size()?, table.size()?);
        let content = bytes.get(start..)?.get(..size)?;
        sections.push((String::from_utf8_lossy(name).into_owned(), content));
    }
    Some(sections)
}

/// Unpacks bytes to at most `most`.
fn unpack(packed: &[u8], most: usize) -> Option<Vec<u8>> {
    if most == 0 {
        return Some(Vec::new());
    }
    let (pieces, mut rest) = packed.split_first().map(|(n, rest)| (*n, Cursor(rest)))?;
    let most = most.min(packed.len().saturating_mul(LZ4_RATIO));
    let mut bytes = vec![0; most];
    let mut length = 0;
    for _ in 0..pieces.max(1) {
        let piece = match pieces {
            0 => rest.0,
            _ => {
                let size = usize::try_from(rest.u32()?).ok()?;
                rest.take(size)?
            }
        };
        let into = bytes.get_mut(length..)?;
        length += lz4_flex::block::decompress_into(piece, into).ok()?;
    }
    bytes.truncate(length);
    Some(bytes)
}

/// Unpacks integers, with the length of their packed bytes before them.
fn integers(from: &mut Cursor<'_>, count: usize) -> Option<Vec<u32>> {
    let packed = from.size()?;
    let packed = from.take(packed)?;
    if count == 0 {
        return Some(Vec::new());
    }
    let codes = count.div_ceil(4);
    let bytes = unpack(packed, 4 + codes + 4 * count)?;
    let mut rest = Cursor(&bytes);
    let common = rest.u32()?;
    let codes = rest.take(codes)?;
    let mut last = 0_u32;
    let mut integers = Vec::with_capacity(count);
    for i in 0..count {
        let difference = match codes[i / 4] >> (2 * (i % 4)) & 3 {
            0 => common,
            1 => i32::from(rest.array().map(i8::from_le_bytes)?).cast_unsigned(),
            2 => i32::from(rest.array().map(i16::from_le_bytes)?).cast_unsigned(),
            _ => rest.u32()?,
        };
        last = last.wrapping_add(difference);
        integers.push(last);
    }
    Some(integers)
}

/// Unpacks integers, with their count before them.
fn counted(mut from: Cursor<'_>, most: usize) -> Option<Vec<u32>> {
    let count = from.count(most)?;
    integers(&mut from, count)
}

/// Texts that others refer to by index.
struct Tokens {
    text: Vec<u8>,
    /// Place of each token's end.
    ends: Vec<usize>,
}

impl Tokens {
    fn parse(mut from: Cursor<'_>, most: usize, most_text: usize) -> Option<Self> {
        let count = from.count(most)?;
        let size = from.count(most_text)?;
        let packed = from.size()?;
        let text = unpack(from.take(packed)?, size)?;
        let zeros = text.iter().enumerate().filter(|(_, byte)| **byte == 0);
        let ends: Vec<usize> = zeros.map(|(at, _)| at).take(count).collect();
        (ends.len() == count).then_some(Self { text, ends })
    }

    fn bytes(&self, index: u32) -> Option<&[u8]> {
        let index = usize::try_from(index).ok()?;
        let end = *self.ends.get(index)?;
        let start = match index.checked_sub(1) {
            Some(before) => self.ends[before] + 1,
            None => 0,
        };
        self.text.get(start..end)
    }

    /// A token; `None` if it is too long for a name.
    fn get(&self, index: u32) -> Option<&str> {
        let name = self.bytes(index)?;
        let name = (name.len() <= MOST_NAME).then_some(name)?;
        std::str::from_utf8(name).ok()
    }
}

fn strings(mut from: Cursor<'_>) -> Option<Vec<u32>> {
    let count = from.count(from.0.len() / 4)?;
    (0..count).map(|_| from.u32()).collect()
}

/// Names, as indices of tokens, and values.
fn fields(mut from: Cursor<'_>, most: usize) -> Option<Vec<(u32, Rep)>> {
    let count = from.count(most)?;
    let names = integers(&mut from, count)?;
    let packed = from.size()?;
    let values = unpack(from.take(packed)?, 8 * count)?;
    let mut values = Cursor(&values);
    let field = |name| Some((name, Rep(values.u64()?)));
    names.into_iter().map(field).collect()
}

/// A prim, a property, or the root.
struct Spec {
    path: u32,
    fields: u32,
    kind: u32,
}

fn specs(mut from: Cursor<'_>, most: usize) -> Option<Vec<Spec>> {
    let count = from.count(most)?;
    let paths = integers(&mut from, count)?;
    let fields = integers(&mut from, count)?;
    let kinds = integers(&mut from, count)?;
    let each = paths.into_iter().zip(fields).zip(kinds);
    let each = each.map(|((path, fields), kind)| Spec { path, fields, kind });
    Some(each.collect())
}

/// The tree of paths.
struct Paths {
    /// Number of slots.
    slots: usize,
    /// Paths, each after its parent.
    steps: Vec<Step>,
}

struct Step {
    slot: u32,
    /// Slot of the parent, or [`NONE`].
    parent: u32,
    /// Name.
    token: u32,
}

impl Paths {
    fn parse(mut from: Cursor<'_>, most: usize) -> Option<Self> {
        let slots = from.count(most)?;
        let count = from.count(most)?;
        let own = integers(&mut from, count)?;
        let tokens = integers(&mut from, count)?;
        let jumps = integers(&mut from, count)?;
        let mut steps = Vec::new();
        let mut pending = Vec::new();
        if count > 0 {
            pending.push((0, NONE));
        }
        while let Some((mut at, mut parent)) = pending.pop() {
            loop {
                let slot = *own.get(at)?;
                let is_sound = steps.len() < count && usize::try_from(slot).ok()? < slots;
                steps.push(Step {
                    slot: Some(slot).filter(|_| is_sound)?,
                    parent,
                    token: tokens[at].cast_signed().unsigned_abs(),
                });
                let jump = jumps[at].cast_signed();
                let has_child = jump > 0 || jump == -1;
                let has_sibling = jump >= 0;
                if has_child {
                    if has_sibling {
                        pending.push((at + usize::try_from(jump).ok()?, parent));
                    }
                    parent = slot;
                } else if !has_sibling {
                    break;
                }
                at += 1;
            }
        }
        Some(Self { slots, steps })
    }
}

/// A value: its type, and its offset or itself.
#[derive(Clone, Copy)]
struct Rep(u64);

impl Rep {
    fn kind(self) -> u64 {
        self.0 >> 48 & 0xff
    }

    fn is_array(self) -> bool {
        self.0 >> 63 & 1 != 0
    }

    fn is_inlined(self) -> bool {
        self.0 >> 62 & 1 != 0
    }

    fn is_packed(self) -> bool {
        self.0 >> 61 & 1 != 0
    }

    fn offset(self) -> Option<usize> {
        usize::try_from(self.0 & 0xffff_ffff_ffff).ok()
    }

    /// The value in place of the offset.
    fn inlined(self) -> Option<[u8; 4]> {
        let bytes = self.0.to_le_bytes();
        self.is_inlined().then(|| array::from_fn(|i| bytes[i]))
    }

    fn word(self) -> Option<u32> {
        self.inlined().map(u32::from_le_bytes)
    }
}

// Types of values. Further numbers are those of [`shape`].
pub(super) const INT: u64 = 3;
pub(super) const DOUBLE: u64 = 9;
pub(super) const STRING: u64 = 10;
pub(super) const TOKEN: u64 = 11;
pub(super) const VECTOR_3D: u64 = 23;
pub(super) const TOKEN_LIST: u64 = 32;
pub(super) const TOKEN_VECTOR: u64 = 41;
pub(super) const SPECIFIER: u64 = 42;
pub(super) const VARIABILITY: u64 = 44;
const SAMPLES: u64 = 46;

/// Types of numbers, vectors and quaternions in f32.
pub(super) const FLOAT_ARRAYS: [u64; 3] = [8, 24, 17];

/// Types of single numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I32,
    U32,
    I64,
    Half,
    F32,
    F64,
}

impl Scalar {
    fn size(self) -> usize {
        match self {
            Self::Half => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::F64 => 8,
        }
    }

    #[expect(
        clippy::cast_precision_loss,
        reason = "no number that splats need is an integer beyond 2^53"
    )]
    fn take(self, from: &mut Cursor<'_>) -> Option<f64> {
        match self {
            Self::I32 => from.array().map(i32::from_le_bytes).map(f64::from),
            Self::U32 => from.u32().map(f64::from),
            Self::I64 => from.array().map(|bytes| i64::from_le_bytes(bytes) as f64),
            Self::Half => from.array().map(u16::from_le_bytes).map(half),
            Self::F32 => from.array().map(f32::from_le_bytes).map(f64::from),
            Self::F64 => from.array().map(f64::from_le_bytes),
        }
    }
}

/// The numbers of a type, and their count. Those of quaternions are x, y, z, w.
fn shape(kind: u64) -> Option<(Scalar, usize)> {
    use Scalar::{F32, F64, Half, I32, I64, U32};
    Some(match kind {
        3 => (I32, 1),
        4 => (U32, 1),
        5 => (I64, 1),
        7 => (Half, 1),
        8 => (F32, 1),
        9 => (F64, 1),
        15 => (F64, 16),
        16 => (F64, 4),
        17 => (F32, 4),
        18 => (Half, 4),
        23 => (F64, 3),
        24 => (F32, 3),
        25 => (Half, 3),
        26 => (I32, 3),
        27 => (F64, 4),
        28 => (F32, 4),
        29 => (Half, 4),
        _ => return None,
    })
}

fn is_quaternion(kind: u64) -> bool {
    (16..=18).contains(&kind)
}

struct Layer<'a> {
    bytes: &'a [u8],
    minor: u8,
    tokens: Tokens,
    strings: Vec<u32>,
    fields: Vec<(u32, Rep)>,
    sets: Vec<u32>,
    numbers_left: Cell<usize>,
    words_left: Cell<usize>,
}

impl Layer<'_> {
    /// # Errors
    /// The place of a fault.
    fn stage(&self, paths: &Paths, specs: &[Spec]) -> std::result::Result<Stage, String> {
        let mut spec_of = vec![NONE; paths.slots];
        for (spec, index) in specs.iter().zip(0..) {
            if let Some(slot) = spec_of.get_mut(spec.path as usize) {
                *slot = index;
            }
        }
        let mut prim_of = vec![NONE; paths.slots];
        let mut stage = Stage::new(self.bytes.len());
        for step in &paths.steps {
            let Some(spec) = specs.get(spec_of[step.slot as usize] as usize) else {
                continue;
            };
            let parent = prim_of.get(step.parent as usize).copied();
            let parent = parent.filter(|parent| *parent != NONE);
            let parent = parent.map(|parent| parent as usize);
            // Parents of the first prims are the root, those of variants no prims.
            let is_first = step.parent == paths.steps[0].slot;
            match (spec.kind, parent) {
                (ROOT, _) => {
                    stage.up_axis = self.value(spec, "upAxis").and_then(|rep| self.word(rep));
                    stage.has_sublayers = self.value(spec, "subLayers").is_some();
                }
                (PRIM, parent) if parent.is_some() || is_first => {
                    let prim = self.prim(spec, step.token).ok_or("names of prims")?;
                    let index = stage.add(parent, prim).ok_or("depth or number of prims")?;
                    let index = u32::try_from(index).map_err(|_| "number of prims")?;
                    prim_of[step.slot as usize] = index;
                }
                (ATTRIBUTE, Some(parent)) => {
                    let name = self.tokens.get(step.token).unwrap_or_default();
                    let is_field = stage.prims[parent].is_field();
                    let is_needed = |kind: &Kind| is_field || *kind != Kind::Floats;
                    let Some(kind) = kind_of(name).filter(is_needed) else {
                        continue;
                    };
                    let place = || format!("prim `{}`, attribute `{name}`", stage.path(parent));
                    if let Some(attribute) = self.attribute(spec, kind).map_err(|()| place())? {
                        self.spend_word(name).ok_or_else(place)?;
                        stage.prims[parent].keep(name, attribute);
                    }
                }
                _ => {}
            }
        }
        Ok(stage)
    }

    /// The value of a field.
    fn value(&self, spec: &Spec, name: &str) -> Option<Rep> {
        let set = self.sets.get(spec.fields as usize..)?;
        let set = set.iter().take(MOST_FIELDS).take_while(|f| **f != NONE);
        let mut fields = set.filter_map(|field| self.fields.get(*field as usize));
        let name = Some(name.as_bytes());
        let found = fields.find(|(token, _)| self.tokens.bytes(*token) == name);
        found.map(|(_, rep)| *rep)
    }

    fn prim(&self, spec: &Spec, name: u32) -> Option<Prim> {
        let value = |name: &str| self.value(spec, name);
        let arcs = [
            "references",
            "payload",
            "inheritPaths",
            "specializes",
            "variantSetNames",
        ];
        let kind = value("typeName").and_then(|rep| self.word(rep));
        let mut prim = Prim {
            name: clip(self.tokens.get(name)?),
            kind: clip(&kind.unwrap_or_default()),
            // Code 0 defines, 1 overrides, 2 declares a class.
            is_defined: value("specifier").is_none_or(|rep| rep.word() == Some(0)),
            is_inactive: value("active").is_some_and(|rep| rep.word() == Some(0)),
            has_arcs: arcs.iter().any(|name| value(name).is_some()),
            ..Prim::default()
        };
        if prim.is_field()
            && let Some(schemas) = value("apiSchemas")
        {
            prim.schemas = self.words(schemas)?;
        }
        Some(prim)
    }

    /// # Errors
    /// A value outside the file, of another type, or with more numbers than files may have.
    fn attribute(&self, spec: &Spec, kind: Kind) -> std::result::Result<Option<Attribute>, ()> {
        const BLOCK: u64 = 51;
        let sampled = self.value(spec, "timeSamples");
        let sample = match sampled {
            Some(samples) => self.first_sample(samples).ok_or(())?,
            None => None,
        };
        let is_sampled = sample.is_some();
        let rep = sample.or_else(|| self.value(spec, "default"));
        let Some(rep) = rep.filter(|rep| rep.kind() != BLOCK) else {
            return Ok(None);
        };
        let value = match kind {
            Kind::Floats => self.floats(rep).map(Value::Floats),
            Kind::Numbers => self.numbers(rep).map(Value::Numbers),
            Kind::Words => self.words(rep).map(Value::Words),
        };
        let space = self.value(spec, "colorSpace");
        Ok(Some(Attribute {
            value: value.ok_or(())?,
            is_sampled,
            colour_space: space.and_then(|rep| self.word(rep)),
        }))
    }

    /// The bytes from an offset on.
    fn at(&self, offset: usize) -> Option<Cursor<'_>> {
        self.bytes.get(offset..).map(Cursor)
    }

    /// The first of a list of samples: an offset to their times, and behind those an offset to the values.
    #[expect(
        clippy::option_option,
        reason = "none in a sound file differs from a fault"
    )]
    fn first_sample(&self, rep: Rep) -> Option<Option<Rep>> {
        if rep.kind() != SAMPLES {
            return None;
        }
        let start = rep.offset()?;
        let times = start.checked_add(self.at(start)?.size()?)?.checked_add(8)?;
        let values = times.checked_add(self.at(times)?.size()?)?;
        let mut values = self.at(values)?;
        match values.size()? {
            0 => Some(None),
            _ => Some(Some(Rep(values.u64()?))),
        }
    }

    /// A token or a string.
    fn word(&self, rep: Rep) -> Option<String> {
        let index = rep.word()?;
        let token = match rep.kind() {
            STRING => *self.strings.get(index as usize)?,
            TOKEN => index,
            _ => return None,
        };
        self.tokens.get(token).map(str::to_owned)
    }

    /// Tokens, one or a list of them.
    fn words(&self, rep: Rep) -> Option<Vec<String>> {
        if rep.is_inlined() {
            return self.word(rep).map(|word| vec![word]);
        }
        let mut from = self.at(rep.offset()?)?;
        let mut words = Vec::new();
        let mut take = |count: usize, from: &mut Cursor<'_>, is_kept: bool| {
            for _ in 0..count.min(from.0.len()) {
                let word = self.tokens.get(from.u32()?)?;
                self.spend_word(word)?;
                if is_kept {
                    words.push(word.to_owned());
                }
            }
            Some(())
        };
        match rep.kind() {
            TOKEN if rep.is_array() => {
                let (mut from, count) = self.array(rep)?;
                take(count, &mut from, true)?;
            }
            TOKEN_VECTOR => {
                let count = from.size()?;
                take(count, &mut from, true)?;
            }
            TOKEN_LIST => {
                let [lists] = from.array()?;
                // Explicit, added, prepended, appended; deleted and ordered ones do not count.
                for (bit, is_kept) in [
                    (2, true),
                    (4, true),
                    (32, true),
                    (64, true),
                    (8, false),
                    (16, false),
                ] {
                    if lists & bit != 0 {
                        let count = from.size()?;
                        take(count, &mut from, is_kept)?;
                    }
                }
            }
            _ => return None,
        }
        Some(words)
    }

    /// The bytes and the count of an array's elements.
    fn array(&self, rep: Rep) -> Option<(Cursor<'_>, usize)> {
        let offset = rep.offset()?;
        // The bytes of the header cannot be those of an array.
        if offset == 0 {
            return Some((Cursor(&[]), 0));
        }
        let mut from = self.at(offset)?;
        if self.minor < 5 {
            // The number of dimensions.
            from.u32()?;
        }
        let count = match self.minor {
            ..7 => usize::try_from(from.u32()?).ok()?,
            _ => from.size()?,
        };
        Some((from, count))
    }

    /// Counts a word against those that the file may have.
    fn spend_word(&self, word: &str) -> Option<()> {
        let left = self.words_left.get().checked_sub(word.len() + 1)?;
        self.words_left.set(left);
        Some(())
    }

    /// Counts numbers against those that the file may have.
    fn spend(&self, numbers: usize) -> Option<()> {
        let left = self.numbers_left.get().checked_sub(numbers)?;
        self.numbers_left.set(left);
        Some(())
    }

    /// The numbers of an array.
    fn floats(&self, rep: Rep) -> Option<Vec<f32>> {
        let (scalar, width) = shape(rep.kind()).filter(|_| rep.is_array())?;
        let (mut from, count) = self.array(rep)?;
        let total = count.checked_mul(width)?;
        self.spend(total)?;
        if rep.is_packed() && width == 1 && count >= LEAST_PACKED {
            let [code] = from.array()?;
            return match code {
                b'i' => {
                    let values = integers(&mut from, count)?.into_iter();
                    let float = |x: u32| narrowed(f64::from(x.cast_signed()));
                    Some(values.map(float).collect())
                }
                b't' => {
                    let size = usize::try_from(from.u32()?).ok()?;
                    self.spend(size)?;
                    let mut table = Cursor(from.take(size.checked_mul(scalar.size())?)?);
                    let places = integers(&mut from, count)?.into_iter();
                    let values = (0..size).map(|_| scalar.take(&mut table).map(narrowed));
                    let values: Vec<f32> = values.collect::<Option<_>>()?;
                    let float = |place: u32| values.get(place as usize).copied();
                    places.map(float).collect()
                }
                _ => None,
            };
        }
        let bytes = from.take(total.checked_mul(scalar.size())?)?;
        let mut numbers: Vec<f32> = match scalar {
            Scalar::F32 => {
                let words = bytes.chunks_exact(4);
                let float = |b: &[u8]| f32::from_le_bytes(array::from_fn(|i| b[i]));
                words.map(float).collect()
            }
            _ => {
                let mut from = Cursor(bytes);
                let values = (0..total).map(|_| scalar.take(&mut from).map(narrowed));
                values.collect::<Option<_>>()?
            }
        };
        if is_quaternion(rep.kind()) {
            for quaternion in numbers.chunks_exact_mut(4) {
                quaternion.rotate_right(1);
            }
        }
        Some(numbers)
    }

    /// A number, a vector, a quaternion or a matrix.
    fn numbers(&self, rep: Rep) -> Option<Vec<f64>> {
        let kind = rep.kind();
        let (scalar, width) = shape(kind).filter(|_| !rep.is_array())?;
        self.spend(width)?;
        if let Some(bytes) = rep.inlined() {
            let small = |i: usize| f64::from(i8::from_le_bytes([bytes[i]]));
            return match (scalar, width) {
                (Scalar::F64, 1) => Some(vec![f64::from(f32::from_le_bytes(bytes))]),
                (Scalar::I64, 1) => Some(vec![f64::from(i32::from_le_bytes(bytes))]),
                (_, 1) => Some(vec![scalar.take(&mut Cursor(&bytes))?]),
                // The diagonal of a matrix.
                (_, 16) => {
                    let on = |n: usize| n.is_multiple_of(5).then(|| small(n / 5));
                    Some((0..16).map(|n| on(n).unwrap_or_default()).collect())
                }
                (_, width) => Some((0..width).map(small).collect()),
            };
        }
        let mut from = self.at(rep.offset()?)?;
        let values = (0..width).map(|_| scalar.take(&mut from));
        let mut numbers: Vec<f64> = values.collect::<Option<_>>()?;
        if is_quaternion(kind) {
            numbers.rotate_right(1);
        }
        Some(numbers)
    }
}
