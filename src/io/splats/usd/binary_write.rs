//! Writes a layer in binary form, version 0.8, in the layout of `binary.rs`.
//!
//! Arrays are as long as their numbers: the format packs integers alone, and floats that are integers or of which there are few.

use std::collections::HashMap;

use super::binary::{
    ATTRIBUTE, DOUBLE, FLOAT_ARRAYS, INT, MAGIC, NONE, PRIM, ROOT, SPECIFIER, STRING, TOKEN,
    TOKEN_LIST, TOKEN_VECTOR, VARIABILITY, VECTOR_3D,
};
use super::layer::{
    Array, Layer, METRES_PER_UNIT, PRIM as PRIM_NAME, Shape, UP_AXIS, Value, documentation,
};
use crate::parallel;

/// The version, which OpenUSD writes, too. Counts of arrays have 64 bits from 0.7 on.
const VERSION: [u8; 8] = [0, 8, 0, 0, 0, 0, 0, 0];

/// Length of the header, of which some is reserved.
const HEADER: usize = 88;

/// Boundary of arrays in bytes.
const ALIGNMENT: usize = 16;

/// Elements of an array that a thread writes at a time, and such pieces that are held at a time.
const PIECE: usize = 1 << 14;
const PIECES: usize = 64;

/// Flags of values: arrays, and values in place of the offset.
const IS_ARRAY: u64 = 1 << 63;
const IS_INLINED: u64 = 1 << 62;

/// Code of a definition among specifiers, and of an attribute that does not change in time.
const DEFINES: u32 = 0;
const UNIFORM: u32 = 1;

/// Code of a list that is prepended to those of other layers.
const PREPENDED: u8 = 32;

/// A first token that no field uses. Tokens of properties are negative, which 0 cannot be.
const NO_TOKEN: &str = ";-)";

/// A layer while it is written.
struct Out {
    bytes: Vec<u8>,
    tokens: Vec<String>,
    token_of: HashMap<String, u32>,
    strings: Vec<u32>,
    /// Names and values.
    fields: Vec<(u32, u64)>,
    /// Indices of fields, in lists that end in [`NONE`].
    sets: Vec<u32>,
    /// Place of the first field, and kind, of each path in order.
    specs: Vec<(u32, u32)>,
}

/// Returns a layer in binary form.
pub(super) fn layer(layer: &Layer<'_>) -> Vec<u8> {
    let mut out = Out {
        bytes: vec![0; HEADER],
        tokens: Vec::new(),
        token_of: HashMap::new(),
        strings: Vec::new(),
        fields: Vec::new(),
        sets: Vec::new(),
        specs: Vec::new(),
    };
    out.token(NO_TOKEN);
    let prim = out.token(PRIM_NAME);
    let names: Vec<u32> = layer.attributes.iter().map(|a| out.token(a.name)).collect();

    let documentation = out.string(&documentation());
    let up_axis = out.token(UP_AXIS);
    let children = out.tokens(TOKEN_VECTOR, &[], &[prim]);
    out.spec(
        ROOT,
        &[
            ("defaultPrim", inlined(TOKEN, prim)),
            ("documentation", documentation),
            (
                "metersPerUnit",
                inlined(DOUBLE, f32::from(METRES_PER_UNIT).to_bits()),
            ),
            ("upAxis", inlined(TOKEN, up_axis)),
            ("primChildren", children),
        ],
    );

    let kind = out.token(layer.kind);
    let schemas: Vec<u32> = layer.schemas.iter().map(|name| out.token(name)).collect();
    let schemas = out.tokens(TOKEN_LIST, &[PREPENDED], &schemas);
    let properties = out.tokens(TOKEN_VECTOR, &[], &names);
    out.spec(
        PRIM,
        &[
            ("specifier", inlined(SPECIFIER, DEFINES)),
            ("typeName", inlined(TOKEN, kind)),
            ("apiSchemas", schemas),
            ("properties", properties),
        ],
    );

    for attribute in &layer.attributes {
        let kind = out.token(attribute.kind);
        let mut fields = vec![("typeName", inlined(TOKEN, kind))];
        if attribute.is_uniform {
            fields.push(("variability", inlined(VARIABILITY, UNIFORM)));
        }
        fields.push(("default", out.value(&attribute.value)));
        out.spec(ATTRIBUTE, &fields);
    }
    out.finish(prim, &names)
}

/// Returns a value in place of its offset.
fn inlined(kind: u64, word: u32) -> u64 {
    IS_INLINED | kind << 48 | u64::from(word)
}

impl Out {
    fn token(&mut self, token: &str) -> u32 {
        if let Some(index) = self.token_of.get(token) {
            return *index;
        }
        let index = number(self.tokens.len());
        self.tokens.push(token.to_owned());
        self.token_of.insert(token.to_owned(), index);
        index
    }

    fn string(&mut self, text: &str) -> u64 {
        let token = self.token(text);
        let index = number(self.strings.len());
        self.strings.push(token);
        inlined(STRING, index)
    }

    /// Appends a path's fields.
    fn spec(&mut self, kind: u32, fields: &[(&str, u64)]) {
        self.specs.push((number(self.sets.len()), kind));
        for (name, value) in fields {
            let field = (self.token(name), *value);
            let known = self.fields.iter().position(|f| *f == field);
            let index = known.unwrap_or_else(|| {
                self.fields.push(field);
                self.fields.len() - 1
            });
            self.sets.push(number(index));
        }
        self.sets.push(NONE);
    }

    /// Aligns the next value, and returns its place.
    fn place(&mut self) -> u64 {
        let length = self.bytes.len().next_multiple_of(ALIGNMENT);
        self.bytes.resize(length, 0);
        length as u64
    }

    fn word(&mut self, word: u64) {
        self.bytes.extend(word.to_le_bytes());
    }

    /// Appends tokens.
    ///
    /// - `before`: bytes before their count.
    fn tokens(&mut self, kind: u64, before: &[u8], tokens: &[u32]) -> u64 {
        let place = self.place();
        self.bytes.extend(before);
        self.word(tokens.len() as u64);
        self.words(tokens);
        kind << 48 | place
    }

    fn words(&mut self, words: &[u32]) {
        self.bytes
            .extend(words.iter().flat_map(|word| word.to_le_bytes()));
    }

    fn value(&mut self, value: &Value<'_>) -> u64 {
        match value {
            Value::Token(token) => inlined(TOKEN, self.token(token)),
            Value::Tokens(tokens) => {
                let tokens: Vec<u32> = tokens.iter().map(|token| self.token(token)).collect();
                IS_ARRAY | self.tokens(TOKEN, &[], &tokens)
            }
            Value::Int(number) => inlined(INT, number.cast_unsigned()),
            Value::Vector(numbers) => {
                let place = self.place();
                self.bytes
                    .extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
                VECTOR_3D << 48 | place
            }
            Value::Array(array) => self.array(array),
        }
    }

    fn array(&mut self, array: &Array<'_>) -> u64 {
        let place = self.place();
        let (count, width) = (array.count, array.shape.width());
        self.word(count as u64);
        self.bytes.reserve(4 * width * count);
        let all = count.div_ceil(PIECE);
        for first in (0..all).step_by(PIECES) {
            let pieces = parallel::map(PIECES.min(all - first), |piece| {
                let start = (first + piece) * PIECE;
                let mut bytes = Vec::with_capacity(4 * width * PIECE);
                for i in start..(start + PIECE).min(count) {
                    let mut numbers = (array.of)(i);
                    if array.shape == Shape::Quaternion {
                        // To x, y, z, w.
                        numbers.rotate_left(1);
                    }
                    bytes.extend(numbers[..width].iter().flat_map(|x| x.to_le_bytes()));
                }
                bytes
            });
            for piece in pieces {
                self.bytes.extend(piece);
            }
        }
        let [number, vector, quaternion] = FLOAT_ARRAYS;
        let kind = match array.shape {
            Shape::Number => number,
            Shape::Vector => vector,
            Shape::Quaternion => quaternion,
        };
        IS_ARRAY | kind << 48 | place
    }

    /// Appends the sections and fills the header.
    ///
    /// - `prim`, `properties`: tokens of the paths below the root.
    fn finish(mut self, prim: u32, properties: &[u32]) -> Vec<u8> {
        let root = self.token("");
        let mut sections: Vec<(&str, Vec<u8>)> = Vec::new();
        let counted = |count: usize| (count as u64).to_le_bytes().to_vec();

        let mut text = Vec::new();
        for token in &self.tokens {
            text.extend(token.as_bytes());
            text.push(0);
        }
        let packed = pack(&text);
        let mut tokens = counted(self.tokens.len());
        tokens.extend((text.len() as u64).to_le_bytes());
        tokens.extend((packed.len() as u64).to_le_bytes());
        tokens.extend(packed);
        sections.push(("TOKENS", tokens));

        let mut strings = counted(self.strings.len());
        strings.extend(self.strings.iter().flat_map(|index| index.to_le_bytes()));
        sections.push(("STRINGS", strings));

        let mut fields = counted(self.fields.len());
        fields.extend(integers(self.fields.iter().map(|(name, _)| *name)));
        let values: Vec<u8> = self
            .fields
            .iter()
            .flat_map(|(_, value)| value.to_le_bytes())
            .collect();
        let packed = pack(&values);
        fields.extend((packed.len() as u64).to_le_bytes());
        fields.extend(packed);
        sections.push(("FIELDS", fields));

        let mut sets = counted(self.sets.len());
        sets.extend(integers(self.sets.iter().copied()));
        sections.push(("FIELDSETS", sets));

        // The root with one child, the prim with children, and those, of which the last has no sibling.
        let count = self.specs.len();
        let slots = || (0..count).map(number);
        let of_property = |token: &u32| token.wrapping_neg();
        let names = [root, prim]
            .into_iter()
            .chain(properties.iter().map(of_property));
        let jumps = (0..count).map(|i| match i {
            0 | 1 => JUMP_TO_CHILD,
            _ if i + 1 == count => JUMP_NOWHERE,
            _ => JUMP_TO_SIBLING,
        });
        let mut paths = [counted(count), counted(count)].concat();
        paths.extend(integers(slots()));
        paths.extend(integers(names));
        paths.extend(integers(jumps));
        sections.push(("PATHS", paths));

        let mut specs = counted(count);
        specs.extend(integers(slots()));
        specs.extend(integers(self.specs.iter().map(|(set, _)| *set)));
        specs.extend(integers(self.specs.iter().map(|(_, kind)| *kind)));
        sections.push(("SPECS", specs));

        let mut table = counted(sections.len());
        for (name, content) in sections {
            let mut padded = [0; 16];
            padded[..name.len()].copy_from_slice(name.as_bytes());
            table.extend(padded);
            table.extend((self.bytes.len() as u64).to_le_bytes());
            table.extend((content.len() as u64).to_le_bytes());
            self.bytes.extend(content);
        }
        let table_at = self.bytes.len() as u64;
        self.bytes.extend(table);
        self.bytes[..8].copy_from_slice(MAGIC);
        self.bytes[8..16].copy_from_slice(&VERSION);
        self.bytes[16..24].copy_from_slice(&table_at.to_le_bytes());
        self.bytes
    }
}

/// Jumps of paths: to a child alone, to the next sibling alone, to neither.
const JUMP_TO_CHILD: u32 = (-1_i32).cast_unsigned();
const JUMP_TO_SIBLING: u32 = 0;
const JUMP_NOWHERE: u32 = (-2_i32).cast_unsigned();

/// An index of a table. Tables have some dozens of entries.
fn number(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(NONE)
}

/// Packs bytes in one piece, of which its number 0 is the mark.
fn pack(bytes: &[u8]) -> Vec<u8> {
    let mut packed = vec![0];
    packed.extend(lz4_flex::block::compress(bytes));
    packed
}

/// Packs integers, with the length of their bytes before them.
fn integers(of: impl Iterator<Item = u32>) -> Vec<u8> {
    let mut last = 0_u32;
    let differences = of.map(|x| {
        let difference = x.wrapping_sub(last);
        last = x;
        difference.cast_signed()
    });
    let differences: Vec<i32> = differences.collect();
    let mut counts: HashMap<i32, usize> = HashMap::new();
    for difference in &differences {
        *counts.entry(*difference).or_default() += 1;
    }
    // The smaller of equally frequent ones, so that files do not depend on the order of a map.
    let most = counts
        .into_iter()
        .max_by_key(|(x, count)| (*count, -i64::from(*x)));
    let common = most.map_or(0, |(x, _)| x);
    let mut codes = vec![0_u8; differences.len().div_ceil(4)];
    let mut others = Vec::new();
    for (i, difference) in differences.into_iter().enumerate() {
        let code = if difference == common {
            0
        } else if let Ok(x) = i8::try_from(difference) {
            others.extend(x.to_le_bytes());
            1
        } else if let Ok(x) = i16::try_from(difference) {
            others.extend(x.to_le_bytes());
            2
        } else {
            others.extend(difference.to_le_bytes());
            3
        };
        codes[i / 4] |= code << (2 * (i % 4));
    }
    let packed = pack(&[&common.to_le_bytes()[..], &codes, &others].concat());
    [&(packed.len() as u64).to_le_bytes()[..], &packed].concat()
}
