//! Parses the text of a layer (`.usda`), as far as splats need it.
//!
//! All other values are skipped, whatever they contain: a value is a word, a string, an asset between `@`, a path
//! between `<` and `>`, or a group in brackets.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::stage::{Attribute, Kind, Prim, Stage, Value, kind_of};
use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// The first bytes of every layer in text.
pub(super) const MAGIC: &[u8] = b"#usda";

/// Bytes of numbers that a thread parses at a time.
const PIECE: usize = 1 << 20;

/// Parses a layer.
///
/// # Errors
/// Text that breaks the format's rules, with its line.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Stage> {
    let mut parser = Parser { path, bytes, at: 0 };
    parser.layer()
}

/// A statement up to its value: `prepend references =`.
struct Statement<'a> {
    first: &'a [u8],
    last: &'a [u8],
    has_value: bool,
}

struct Parser<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Parser<'a> {
    fn layer(&mut self) -> Result<Stage> {
        let mut stage = Stage::new(self.bytes.len());
        self.skip_space();
        if self.takes(b'(') {
            self.metadata(|key, _, value| match key {
                b"upAxis" => stage.up_axis = words(value).pop(),
                b"subLayers" => stage.has_sublayers = !is_nothing(value),
                _ => {}
            })?;
        }
        let mut open: Vec<usize> = Vec::new();
        loop {
            self.skip_space();
            match self.peek() {
                None if open.is_empty() => return Ok(stage),
                None => return Err(self.fault("`}`", "the end of the file")),
                Some(b'}') if open.pop().is_some() => self.at += 1,
                Some(_) => self.statement(&mut stage, &mut open)?,
            }
        }
    }

    /// Parses a prim up to its contents, or a property.
    fn statement(&mut self, stage: &mut Stage, open: &mut Vec<usize>) -> Result<()> {
        let start = self.at;
        let parent = open.last().copied();
        match self.word()? {
            specifier @ (b"def" | b"over" | b"class") => {
                let prim = self.prim(specifier == b"def")?;
                let index = stage.add(parent, prim);
                open.push(index.ok_or_else(|| self.fault("prims in prims", "too many of them"))?);
            }
            b"variantSet" => {
                self.skip_space();
                self.value()?;
                self.skip_space();
                self.expect(b'=')?;
                self.skip_space();
                self.value()?;
                if let Some(parent) = parent {
                    stage.prims[parent].has_arcs = true;
                }
            }
            _ => {
                self.at = start;
                self.property(parent.map(|parent| &mut stage.prims[parent]))?;
            }
        }
        Ok(())
    }

    /// Parses a prim after its specifier, up to its opening brace.
    fn prim(&mut self, is_defined: bool) -> Result<Prim> {
        let mut prim = Prim {
            is_defined,
            ..Prim::default()
        };
        self.skip_space();
        if !matches!(self.peek(), Some(b'"' | b'\'')) {
            prim.kind = text(self.word()?);
            self.skip_space();
        }
        prim.name = text(self.string()?);
        self.skip_space();
        if self.takes(b'(') {
            self.metadata(|key, edit, value| match key {
                b"active" => prim.is_inactive = matches!(value, b"false" | b"0"),
                b"apiSchemas" if edit != b"delete" => prim.schemas.extend(words(value)),
                b"references" | b"payload" | b"inherits" | b"specializes" | b"variantSets"
                    if edit != b"delete" =>
                {
                    prim.has_arcs |= !is_nothing(value);
                }
                _ => {}
            })?;
            self.skip_space();
        }
        self.expect(b'{')?;
        Ok(prim)
    }

    /// Parses a property, and keeps its value if splats need it.
    fn property(&mut self, prim: Option<&mut Prim>) -> Result<()> {
        let statement = self.words_before_value()?;
        let name = text(statement.last);
        let (base, is_sampled) = match name.strip_suffix(".timeSamples") {
            Some(base) => (base, true),
            None => (name.as_str(), false),
        };
        let mut span = None;
        if statement.has_value {
            let value = self.value()?;
            let is_edit = matches!(statement.first, b"delete" | b"reorder");
            let is_field = prim.as_ref().is_some_and(|prim| prim.is_field());
            let is_needed = |kind: &Kind| !is_edit && (is_field || *kind != Kind::Floats);
            span = match (kind_of(base).filter(is_needed), is_sampled) {
                (None, _) => None,
                (Some(kind), false) => Some((kind, value)),
                (Some(kind), true) => self.first_sample(value)?.map(|value| (kind, value)),
            };
        }
        let span = span.filter(|(_, value)| &self.bytes[value.clone()] != b"None");
        let value = match span {
            Some((kind, value)) => Some(self.decoded(kind, value)?),
            None => None,
        };
        let mut colour_space = None;
        self.skip_space();
        if self.takes(b'(') {
            self.metadata(|key, _, value| {
                if key == b"colorSpace" {
                    colour_space = words(value).pop();
                }
            })?;
        }
        if let (Some(value), Some(prim)) = (value, prim) {
            let attribute = Attribute {
                value,
                is_sampled,
                colour_space,
            };
            prim.keep(base, attribute);
        }
        Ok(())
    }

    /// The value of the first sample in `{ time: value, ... }`.
    fn first_sample(&self, samples: Range<usize>) -> Result<Option<Range<usize>>> {
        let mut inner = Parser {
            path: self.path,
            bytes: &self.bytes[..samples.end],
            at: samples.start,
        };
        if !inner.takes(b'{') {
            return Ok(None);
        }
        inner.skip_space();
        if inner.takes(b'}') {
            return Ok(None);
        }
        let time = inner.word()?;
        inner.skip_space();
        if time.last() != Some(&b':') {
            inner.expect(b':')?;
            inner.skip_space();
        }
        inner.value().map(Some)
    }

    /// Parses metadata after the opening parenthesis, with its closing one.
    ///
    /// - `keep`: called with each key, the first word of its statement and its value.
    fn metadata(&mut self, mut keep: impl FnMut(&[u8], &[u8], &[u8])) -> Result<()> {
        loop {
            self.skip_space();
            match self.peek() {
                Some(b')') => {
                    self.at += 1;
                    return Ok(());
                }
                // A description.
                Some(b'"' | b'\'') => {
                    self.string()?;
                }
                Some(_) => {
                    let statement = self.words_before_value()?;
                    if !statement.has_value {
                        return Err(self.fault("`=`", self.found()));
                    }
                    let value = self.value()?;
                    keep(statement.last, statement.first, &self.bytes[value]);
                    // An asset has a path and an offset behind it.
                    loop {
                        self.skip_space();
                        match self.peek() {
                            Some(b'<' | b'(') => self.value()?,
                            _ => break,
                        };
                    }
                }
                None => return Err(self.fault("`)`", "the end of the file")),
            }
        }
    }

    /// Parses words up to `=`, or to the end of a statement without a value.
    fn words_before_value(&mut self) -> Result<Statement<'a>> {
        let first = self.word()?;
        let mut last = first;
        loop {
            while matches!(self.peek(), Some(b' ' | b'\t')) {
                self.at += 1;
            }
            let has_value = self.takes(b'=');
            if has_value {
                self.skip_space();
            }
            match self.peek() {
                Some(byte) if !has_value && is_of_word(byte) => last = self.word()?,
                None | Some(b'\n' | b'\r' | b';' | b'}' | b'(' | b')' | b'#' | b'/')
                    if !has_value =>
                {
                    return Ok(Statement {
                        first,
                        last,
                        has_value,
                    });
                }
                _ if has_value => {
                    return Ok(Statement {
                        first,
                        last,
                        has_value,
                    });
                }
                _ => return Err(self.fault("`=` and a value", self.found())),
            }
        }
    }

    /// Skips a value.
    fn value(&mut self) -> Result<Range<usize>> {
        let start = self.at;
        match self.peek() {
            Some(b'"' | b'\'') => {
                self.string()?;
            }
            Some(b'@') => self.asset()?,
            Some(b'<') => self.beyond(b">")?,
            Some(b'(' | b'[' | b'{') => self.group()?,
            _ => {
                self.word()?;
            }
        }
        Ok(start..self.at)
    }

    /// Skips a group in brackets.
    fn group(&mut self) -> Result<()> {
        let start = self.at;
        let mut depth = 0_usize;
        while let Some(byte) = self.peek() {
            match byte {
                b'(' | b'[' | b'{' => depth += 1,
                b')' | b']' | b'}' => {
                    depth -= 1;
                    if depth == 0 {
                        self.at += 1;
                        return Ok(());
                    }
                }
                b'"' | b'\'' => {
                    self.string()?;
                    continue;
                }
                b'@' => {
                    self.asset()?;
                    continue;
                }
                b'<' => {
                    self.beyond(b">")?;
                    continue;
                }
                b'#' | b'/' => {
                    let before = self.at;
                    self.skip_space();
                    if self.at > before {
                        continue;
                    }
                }
                _ => {}
            }
            self.at += 1;
        }
        self.at = start;
        Err(self.fault("a closing bracket", "none in the rest of the file"))
    }

    /// Skips a string and returns its contents, escapes as they are.
    fn string(&mut self) -> Result<&'a [u8]> {
        let start = self.at;
        let quote = match self.peek() {
            Some(quote @ (b'"' | b'\'')) => quote,
            _ => return Err(self.fault("a string", self.found())),
        };
        let rest = &self.bytes[start..];
        let is_long = rest.starts_with(&[quote; 3]);
        let width = if is_long { 3 } else { 1 };
        let mut at = width;
        while let Some(&byte) = rest.get(at) {
            if byte == b'\\' {
                at += 2;
            } else if byte == quote && (!is_long || rest[at..].starts_with(&[quote; 3])) {
                self.at = start + at + width;
                return Ok(&rest[width..at]);
            } else if byte == b'\n' && !is_long {
                break;
            } else {
                at += 1;
            }
        }
        Err(self.fault("a closing quote", "none behind the opening one"))
    }

    /// Skips an asset between single or triple `@`.
    fn asset(&mut self) -> Result<()> {
        let mark: &[u8] = match self.bytes[self.at..].starts_with(b"@@@") {
            true => b"@@@",
            false => b"@",
        };
        self.at += mark.len() - 1;
        self.beyond(mark)
    }

    /// Skips a byte and all bytes up to a mark, with the mark.
    fn beyond(&mut self, mark: &[u8]) -> Result<()> {
        let rest = &self.bytes[self.at + 1..];
        let found = rest.windows(mark.len()).position(|w| w == mark);
        let Some(found) = found else {
            let expected = format!("a closing `{}`", text(mark));
            return Err(self.fault(&expected, "none in the rest of the file"));
        };
        self.at += 1 + found + mark.len();
        Ok(())
    }

    /// Takes a word: a name, a type, a number.
    fn word(&mut self) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().take_while(|byte| is_of_word(**byte)).count();
        if length == 0 {
            return Err(self.fault("a word or a value", self.found()));
        }
        self.at += length;
        Ok(&rest[..length])
    }

    fn expect(&mut self, byte: u8) -> Result<()> {
        match self.takes(byte) {
            true => Ok(()),
            false => Err(self.fault(&format!("`{}`", char::from(byte)), self.found())),
        }
    }

    /// Skips a byte if it is the next one.
    fn takes(&mut self, byte: u8) -> bool {
        let is_next = self.peek() == Some(byte);
        self.at += usize::from(is_next);
        is_next
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    /// Skips spaces, ends of lines, semicolons and comments.
    fn skip_space(&mut self) {
        while let Some(byte) = self.peek() {
            let rest = &self.bytes[self.at..];
            let end_of = |mark: &[u8]| rest.windows(mark.len()).position(|w| w == mark);
            match byte {
                b' ' | b'\t' | b'\n' | b'\r' | b';' => self.at += 1,
                b'/' if rest.starts_with(b"/*") => {
                    self.at += end_of(b"*/").map_or(rest.len(), |end| end + 2);
                }
                b'/' if !rest.starts_with(b"//") => return,
                b'#' | b'/' => self.at += end_of(b"\n").unwrap_or(rest.len()),
                _ => return,
            }
        }
    }

    /// Decodes a value.
    fn decoded(&self, kind: Kind, span: Range<usize>) -> Result<Value> {
        let bytes = &self.bytes[span.clone()];
        let refuse = |at: usize| {
            let place = Parser {
                path: self.path,
                bytes: self.bytes,
                at: span.start + at,
            };
            place.fault("numbers", place.found())
        };
        match kind {
            Kind::Words => Ok(Value::Words(words(bytes))),
            Kind::Numbers => {
                let mut numbers = Vec::new();
                for token in tokens(bytes) {
                    let number = std::str::from_utf8(&bytes[token.clone()]);
                    let number = number.ok().and_then(|text| text.parse().ok());
                    numbers.push(number.ok_or_else(|| refuse(token.start))?);
                }
                Ok(Value::Numbers(numbers))
            }
            Kind::Floats => floats(bytes).map(Value::Floats).map_err(refuse),
        }
    }

    /// The line of the parser's place.
    fn line(&self) -> usize {
        let before = &self.bytes[..self.at.min(self.bytes.len())];
        1 + before.iter().filter(|byte| **byte == b'\n').count()
    }

    /// The next bytes, for messages.
    fn found(&self) -> String {
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let line = rest.split(|byte| *byte == b'\n').next().unwrap_or_default();
        match text(&line[..line.len().min(30)]) {
            found if found.is_empty() => "the end of the line".into(),
            found => format!("`{}`", clip(&found)),
        }
    }

    fn fault(&self, expected: &str, found: impl Into<String>) -> Error {
        Error::format(
            self.path,
            format!("line {}", self.line()),
            expected,
            found,
            "the file is cut off or damaged: get it again, or rewrite it with `usdcat`",
        )
    }
}

/// Whether a byte belongs to a word: names with namespaces, types of arrays, numbers.
fn is_of_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte >= 0x80 || b"_:.[]!|+-".contains(&byte)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Whether a value is `None` or an empty list.
fn is_nothing(value: &[u8]) -> bool {
    let inner = value.strip_prefix(b"[").and_then(|v| v.strip_suffix(b"]"));
    value == b"None" || inner.is_some_and(|inner| inner.trim_ascii().is_empty())
}

/// The strings of a value, or its only word.
fn words(value: &[u8]) -> Vec<String> {
    let mut parser = Parser {
        path: Path::new(""),
        bytes: value,
        at: 0,
    };
    let mut found = Vec::new();
    while let Some(byte) = parser.peek() {
        match byte {
            b'"' | b'\'' => match parser.string() {
                Ok(string) => found.push(text(string)),
                Err(_) => break,
            },
            _ => parser.at += 1,
        }
    }
    if found.is_empty()
        && value
            .iter()
            .all(|byte| is_of_word(*byte) && !b"[]".contains(byte))
    {
        found.push(text(value));
    }
    found
}

/// Places of the numbers of a value.
fn tokens(bytes: &[u8]) -> impl Iterator<Item = Range<usize>> {
    let is_between = |byte: &u8| {
        matches!(
            byte,
            b' ' | b'\t' | b'\r' | b'\n' | b',' | b'(' | b')' | b'[' | b']'
        )
    };
    let mut at = 0;
    std::iter::from_fn(move || {
        let start = at + bytes[at..].iter().position(|byte| !is_between(byte))?;
        let length = bytes[start..].iter().position(is_between);
        at = length.map_or(bytes.len(), |length| start + length);
        Some(start..at)
    })
}

/// Parses the numbers of an array on all threads.
///
/// # Errors
/// The place of what is no number.
fn floats(bytes: &[u8]) -> std::result::Result<Vec<f32>, usize> {
    let mut pieces = Vec::new();
    let mut start = 0;
    while start < bytes.len() {
        // Pieces end behind commas.
        let least = (start + PIECE).min(bytes.len());
        let comma = bytes[least..].iter().position(|byte| *byte == b',');
        let end = comma.map_or(bytes.len(), |comma| least + comma + 1);
        pieces.push((start, &bytes[start..end]));
        start = end;
    }
    let counts = pieces.par_iter().map(|(_, piece)| tokens(piece).count());
    let counts: Vec<usize> = counts.collect();
    let mut numbers = vec![0.0_f32; counts.iter().sum()];
    let mut rest = numbers.as_mut_slice();
    let mut parts = Vec::new();
    for ((start, piece), count) in pieces.into_iter().zip(counts) {
        let (part, others) = rest.split_at_mut(count);
        parts.push((start, piece, part));
        rest = others;
    }
    parts.into_par_iter().try_for_each(|(start, piece, part)| {
        for (token, number) in tokens(piece).zip(part) {
            let text = std::str::from_utf8(&piece[token.clone()]);
            let parsed = text.ok().and_then(|text| text.parse().ok());
            *number = parsed.ok_or(start + token.start)?;
        }
        Ok::<(), usize>(())
    })?;
    Ok(numbers)
}
