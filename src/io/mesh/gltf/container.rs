//! Finds the bytes of a glTF file: its JSON, its binary chunk, and the buffers and files that it names.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell, RefCell};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::document::{BROKEN, Document};
use super::meshopt;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::mesh::texture::spelled_otherwise;
use crate::io::vtk::xml::clip;

/// First bytes of a binary file.
const MAGIC: &[u8] = b"glTF";

/// Kind of the chunk that is the first buffer.
const BIN: &[u8; 4] = b"BIN\0";

/// Returns true if the first bytes are those of a binary file, or JSON with an asset.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    if head.starts_with(MAGIC) {
        return true;
    }
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with('{')
        && ["\"asset\"", "\"accessors\""]
            .iter()
            .any(|w| text.contains(w))
}

/// Parts of a file.
#[derive(Debug)]
pub(in crate::io) struct Chunks<'f> {
    pub(in crate::io) json: &'f [u8],
    /// Binary chunk.
    pub(in crate::io) bin: Option<&'f [u8]>,
    pub(in crate::io) note: Option<&'static str>,
}

/// Splits a file into its JSON and, for a binary file, the binary chunk after it.
///
/// # Errors
/// A binary file has another version, or a chunk is longer than the file.
pub(in crate::io) fn split<'f>(path: &Path, bytes: &'f [u8]) -> Result<Chunks<'f>> {
    if !bytes.starts_with(MAGIC) {
        return Ok(Chunks {
            json: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes),
            bin: None,
            note: None,
        });
    }
    let advice = "the file is damaged or cut off: get it again";
    let word = |at: usize| {
        let four = bytes.get(at..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*four))
    };
    let version = word(4).unwrap_or(0);
    if version != 2 {
        let advice = "save it as glTF 2.0";
        let found = format!("version {version}");
        return Err(Error::format(path, "header", "version 2", found, advice));
    }
    // Some writers state a wrong length in the header, so it is read only if a chunk does not fit.
    let stated = word(8).and_then(|len| usize::try_from(len).ok());
    let (mut at, mut json, mut bin, mut note) = (12, None, None, None);
    while let (Some(len), Some(kind)) = (word(at), word(at + 4)) {
        let start = at + 8;
        let rest = bytes.get(start..).unwrap_or(&[]);
        let chunk = usize::try_from(len).ok().and_then(|len| rest.get(..len));
        let Some(chunk) = chunk else {
            if json.is_some() && stated.is_some_and(|end| end <= at) {
                note = Some("there are bytes after the end that its header states: not read");
                break;
            }
            let place = format!("chunk at byte {at}");
            let found = rest.len().to_string();
            return Err(Error::format(
                path,
                place,
                format!("{len} bytes"),
                found,
                advice,
            ));
        };
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            BIN if bin.is_none() => bin = Some(chunk),
            // Chunks of other kinds are skipped, as the format asks.
            _ => {}
        }
        let end = start + chunk.len();
        at = end.next_multiple_of(4);
        if at != end {
            note = Some(
                "chunks are not filled up to a multiple of four bytes, as the format asks: read all the same",
            );
            // Returns true if a chunk that fits into the file, and whose kind is letters, starts at this byte.
            let follows = |at: usize| {
                let fits = word(at).is_some_and(|len| len as usize <= bytes.len() - at - 4);
                let kind = bytes.get(at + 4..at + 8).unwrap_or(&[]);
                fits && kind.len() == 4 && kind.iter().all(|b| b.is_ascii_graphic() || *b == 0)
            };
            if follows(end) && !follows(at) {
                at = end;
            }
        }
    }
    let json =
        json.ok_or_else(|| Error::format(path, "chunks", "one of kind `JSON`", "none", advice))?;
    Ok(Chunks { json, bin, note })
}

/// Target of a URI of a buffer or an image.
pub(super) enum Source<'f> {
    /// Bytes of a `data:` URI.
    Bytes(Vec<u8>),
    /// File, its path, and a note if its name is spelled otherwise.
    File(Input<'f>, PathBuf, Option<String>),
}

impl<'f> Source<'f> {
    /// Resolves a URI against the folder of the file that states it.
    ///
    /// # Errors
    /// The reason, as the end of a sentence that begins with what was found.
    pub(super) fn of(input: Input<'f>, uri: &str) -> Result<Self, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            let (kind, text) = data.split_once(',').unwrap_or((data, ""));
            if !kind.ends_with(";base64") {
                return Err("a `data:` URI that is not base64".into());
            }
            // Padding is often absent.
            let config = GeneralPurposeConfig::new()
                .with_decode_padding_mode(DecodePaddingMode::Indifferent);
            return GeneralPurpose::new(&base64::alphabet::STANDARD, config)
                .decode(text)
                .map(Self::Bytes)
                .map_err(|e| format!("damaged base64 ({e})"));
        }
        let name = percent_decoded(uri);
        // Schemes such as `http:`, `file:`, `C:`.
        let has_scheme = name
            .split_once(':')
            .is_some_and(|(scheme, _)| scheme.chars().all(|c| c.is_ascii_alphanumeric()));
        if name.is_empty() || has_scheme || Path::new(&name).has_root() {
            return Err(format!("`{}`, which is no relative path", clip(uri)));
        }
        let file = input.path.parent().unwrap_or(Path::new("")).join(&name);
        if input.has_beside(&file) {
            return Ok(Self::File(input, file, None));
        }
        match input.in_another_case(&file) {
            Some(file) => {
                let note = spelled_otherwise(&name, &file);
                Ok(Self::File(input, file, Some(note)))
            }
            None => Err(format!("no file `{}`", clip(&name))),
        }
    }

    /// Returns the note on the file, if its name is spelled otherwise.
    pub(super) fn note(&self) -> Option<&str> {
        match self {
            Self::Bytes(_) => None,
            Self::File(_, _, note) => note.as_deref(),
        }
    }

    /// Reads the bytes.
    pub(super) fn read(self) -> Result<Vec<u8>> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            Self::File(input, file, _) => input.read_beside(&file),
        }
    }
}

/// Decodes percent codes (`%20` is a space). Invalid codes stay.
pub(in crate::io) fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, others @ ..] = rest {
        let code = match rest {
            [b'%', high, low, ..] => [*high, *low]
                .map(|c| char::from(c).to_digit(16))
                .into_iter()
                .try_fold(0, |code, digit| Some(16 * code + digit?))
                .and_then(|code| u8::try_from(code).ok()),
            _ => None,
        };
        bytes.push(code.unwrap_or(*first));
        rest = if code.is_some() { &rest[3..] } else { others };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Buffers of a file; each is read on first use.
pub(in crate::io) struct Buffers<'f> {
    pub(super) input: Input<'f>,
    /// Path of the file.
    pub(in crate::io) path: &'f Path,
    pub(in crate::io) document: &'f Document<'f>,
    bin: Option<&'f [u8]>,
    loaded: Vec<OnceCell<Cow<'f, [u8]>>>,
    /// Unpacked bytes of packed views; each is unpacked on first use.
    unpacked: Vec<OnceCell<Vec<u8>>>,
    /// Unpacked meshes by view; each is unpacked on first use.
    #[cfg(feature = "draco")]
    meshes: Vec<OnceCell<draco_core::Mesh>>,
    /// Total bytes of the file and of all buffers read so far.
    bytes: Cell<usize>,
    /// Total bytes unpacked so far.
    unpacked_bytes: Cell<usize>,
    /// Notes on the files that were read.
    notes: RefCell<Vec<String>>,
}

/// Number of bytes that may be unpacked from any file.
const UNPACKED: usize = 16 << 20;

/// Number of additional bytes that may be unpacked for each byte of a file.
const UNPACKED_PER_BYTE: usize = 12;

impl<'f> Buffers<'f> {
    pub(in crate::io) fn new(
        input: Input<'f>,
        document: &'f Document<'f>,
        bin: Option<&'f [u8]>,
        file_len: usize,
    ) -> Self {
        let cells = |list: &str| 0..document.count(list);
        Self {
            input,
            path: input.path,
            document,
            bin,
            loaded: cells("buffers").map(|_| OnceCell::new()).collect(),
            unpacked: cells("bufferViews").map(|_| OnceCell::new()).collect(),
            #[cfg(feature = "draco")]
            meshes: cells("bufferViews").map(|_| OnceCell::new()).collect(),
            bytes: Cell::new(file_len),
            unpacked_bytes: Cell::new(0),
            notes: RefCell::default(),
        }
    }

    /// Takes the notes on the files read so far.
    pub(in crate::io) fn take_notes(&self) -> Vec<String> {
        self.notes.take()
    }

    /// Returns the number of bytes read; no sound accessor has more elements than this.
    pub(super) fn byte_count(&self) -> usize {
        self.bytes.get()
    }

    /// Returns the number of bytes that may still be unpacked. The limit is in proportion to the bytes read.
    pub(super) fn room_to_unpack(&self) -> usize {
        let most = UNPACKED.saturating_add(self.bytes.get().saturating_mul(UNPACKED_PER_BYTE));
        most.saturating_sub(self.unpacked_bytes.get())
    }

    /// Adds to the number of unpacked bytes.
    pub(super) fn count_unpacked(&self, bytes: usize) {
        let before = self.unpacked_bytes.get();
        self.unpacked_bytes.set(before.saturating_add(bytes));
    }

    /// Returns an error at a place of this file.
    pub(in crate::io) fn refuse(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Error {
        let place: String = place.into();
        Error::format(self.path, place, expected, found, BROKEN)
    }

    /// Returns the bytes and the stride of a view.
    pub(in crate::io) fn view(&self, index: usize, place: &str) -> Result<(&[u8], Option<usize>)> {
        let view = self.document.get("bufferViews", index, place)?;
        let place = format!("buffer view {index}");
        let stride = view.index("byteStride")?.filter(|s| *s > 0);
        let len = view.size("byteLength")?;
        let bytes = match (meshopt::packed(view), self.unpacked.get(index)) {
            (Some(packed), Some(cell)) => match cell.get() {
                Some(bytes) => bytes,
                None => {
                    let source = meshopt::Source {
                        path: self.path,
                        part: &|buffer, range, place| self.part(buffer, range, place),
                        room: self.room_to_unpack(),
                    };
                    let bytes = meshopt::unpack(&source, packed, &place)?;
                    self.count_unpacked(bytes.len());
                    cell.get_or_init(|| bytes)
                }
            },
            _ => {
                let range = [view.integer("byteOffset")?.unwrap_or(0), len];
                let buffer = view.size("buffer")?;
                let buffer = usize::try_from(buffer).unwrap_or(usize::MAX);
                return Ok((self.part(buffer, range, &place)?, stride));
            }
        };
        let stated = usize::try_from(len).ok();
        let bytes = stated.and_then(|len| bytes.get(..len)).ok_or_else(|| {
            let expected = format!("{len} bytes");
            self.refuse(place, expected, format!("{} when unpacked", bytes.len()))
        })?;
        Ok((bytes, stride))
    }

    /// Returns the mesh that a view packs; `unpack` decodes it from the view's bytes.
    ///
    /// # Errors
    /// The bytes do not exist, or `unpack` fails.
    #[cfg(feature = "draco")]
    pub(super) fn packed_mesh(
        &self,
        index: usize,
        unpack: impl FnOnce(&[u8]) -> Result<draco_core::Mesh>,
    ) -> Result<&draco_core::Mesh> {
        let (bytes, _) = self.view(index, "")?;
        // `view` has checked that the view exists.
        let cell = &self.meshes[index];
        match cell.get() {
            Some(mesh) => Ok(mesh),
            None => {
                let mesh = unpack(bytes)?;
                Ok(cell.get_or_init(|| mesh))
            }
        }
    }

    /// Returns part of a buffer; `range` is its first byte and its length.
    pub(super) fn part(&self, index: usize, range: [u64; 2], place: &str) -> Result<&[u8]> {
        let [offset, len] = range;
        let buffer = self.buffer(index, place)?;
        let end = offset.checked_add(len);
        let range = end.and_then(|end| {
            let range = usize::try_from(offset).ok()?..usize::try_from(end).ok()?;
            buffer.get(range)
        });
        range.ok_or_else(|| {
            let found = format!("{len} bytes from byte {offset}");
            let expected = format!("a part of buffer {index}'s {}", buffer.len());
            self.refuse(place, expected, found)
        })
    }

    fn buffer(&self, index: usize, place: &str) -> Result<&[u8]> {
        let buffer = self.document.get("buffers", index, place)?;
        // `get` has checked the index, and `loaded` is as long as the list.
        let cell = &self.loaded[index];
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let place = format!("buffer {index}");
        let bytes = match (buffer.word("uri")?, self.bin) {
            (Some(uri), _) => {
                let source = Source::of(self.input, uri).map_err(|found| {
                    let advice = "put the file there, or export as one .glb";
                    let expected = "a file beside this one, or base64 data";
                    Error::format(self.path, place.clone(), expected, found, advice)
                })?;
                self.notes
                    .borrow_mut()
                    .extend(source.note().map(str::to_owned));
                let bytes = source.read()?;
                self.bytes.set(self.bytes.get().saturating_add(bytes.len()));
                Cow::Owned(bytes)
            }
            (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
            (None, _) => {
                let expected = "a URI, or the binary chunk of a .glb";
                return Err(self.refuse(place, expected, "neither"));
            }
        };
        let stated = buffer.integer("byteLength")?.unwrap_or(0);
        if (bytes.len() as u64) < stated {
            let expected = format!("{stated} bytes");
            return Err(self.refuse(place, expected, bytes.len().to_string()));
        }
        Ok(cell.get_or_init(|| bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_in_names_are_decoded() {
        for (uri, name) in [
            ("a%20b.png", "a b.png"),
            ("%C3%A4.bin", "ä.bin"),
            ("100%.bin", "100%.bin"),
            ("%zz%4", "%zz%4"),
            ("%", "%"),
        ] {
            assert_eq!(percent_decoded(uri), name);
        }
    }
}
