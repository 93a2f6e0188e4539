//! The bytes of a glTF file: its JSON, its binary chunk, and the buffers and files it names.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf_json::{self as json, Index, Root};

use super::meshopt;
use crate::error::{Error, Result};
use crate::io::file::Input;
use crate::io::vtk_xml::clip;

/// The first bytes of a binary file.
const MAGIC: &[u8] = b"glTF";

/// Whether a file's first bytes are those of a binary file, or JSON that holds an asset.
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

/// The JSON of a file and, for a binary file, the chunk after it.
///
/// # Errors
/// A binary file of another version, or one whose chunks are longer than it.
pub(crate) fn split<'f>(path: &Path, bytes: &'f [u8]) -> Result<(&'f [u8], Option<&'f [u8]>)> {
    if !bytes.starts_with(MAGIC) {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
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
    // The length in the header is not needed: some writers leave it wrong.
    let (mut at, mut json, mut bin) = (12, None, None);
    while let (Some(len), Some(kind)) = (word(at), word(at + 4)) {
        let start = at + 8;
        let rest = bytes.get(start..).unwrap_or(&[]);
        let chunk = usize::try_from(len).ok().and_then(|len| rest.get(..len));
        let chunk = chunk.ok_or_else(|| {
            Error::format(
                path,
                format!("chunk at byte {at}"),
                format!("{len} bytes"),
                format!("{}", rest.len()),
                advice,
            )
        })?;
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if bin.is_none() => bin = Some(chunk),
            // Chunks of other kinds are for others.
            _ => {}
        }
        at = start + chunk.len().next_multiple_of(4);
    }
    let json =
        json.ok_or_else(|| Error::format(path, "chunks", "one of kind `JSON`", "none", advice))?;
    Ok((json, bin))
}

/// What a URI of a buffer or an image stands for.
pub(super) enum Source<'f> {
    /// The bytes of a `data:` URI.
    Bytes(Vec<u8>),
    /// A file, and its name as the URI states it.
    File(Input<'f>, PathBuf),
}

impl<'f> Source<'f> {
    /// Resolves a URI against the folder of the file that states it.
    ///
    /// # Errors
    /// Why not, as the end of a sentence that begins with what was found.
    pub(super) fn of(input: Input<'f>, uri: &str) -> Result<Self, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            let (kind, text) = data.split_once(',').unwrap_or((data, ""));
            if !kind.ends_with(";base64") {
                return Err("a `data:` URI that is not base64".into());
            }
            // Padding is often left out.
            let config = GeneralPurposeConfig::new()
                .with_decode_padding_mode(DecodePaddingMode::Indifferent);
            return GeneralPurpose::new(&base64::alphabet::STANDARD, config)
                .decode(text)
                .map(Self::Bytes)
                .map_err(|e| format!("damaged base64 ({e})"));
        }
        let name = percent_decoded(uri);
        // `http:`, `file:`, `C:`.
        let has_scheme = name
            .split_once(':')
            .is_some_and(|(scheme, _)| scheme.chars().all(|c| c.is_ascii_alphanumeric()));
        if name.is_empty() || has_scheme || Path::new(&name).has_root() {
            return Err(format!("`{}`, which is no relative path", clip(uri)));
        }
        let file = input.path.parent().unwrap_or(Path::new("")).join(&name);
        if !input.has_beside(&file) {
            return Err(format!("no file `{}`", clip(&name)));
        }
        Ok(Self::File(input, file))
    }

    /// The bytes.
    pub(super) fn read(self) -> Result<Vec<u8>> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            Self::File(input, file) => input.read_beside(&file),
        }
    }
}

/// `%20` as a space, and so on; what is no such code stays.
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

/// The buffers of a file, each read when it is first needed.
pub(super) struct Buffers<'f> {
    pub(super) input: Input<'f>,
    /// Of the file.
    pub(super) path: &'f Path,
    pub(super) root: &'f Root,
    bin: Option<&'f [u8]>,
    loaded: Vec<OnceCell<Cow<'f, [u8]>>>,
    /// Views that are packed, each unpacked when it is first needed.
    unpacked: Vec<OnceCell<Vec<u8>>>,
    /// For views, the meshes that they pack, each unpacked when it is first needed.
    #[cfg(feature = "draco")]
    meshes: Vec<OnceCell<draco_core::Mesh>>,
    /// Bytes of the file and of all buffers read so far.
    bytes: Cell<usize>,
    /// Bytes that were unpacked so far.
    unpacked_bytes: Cell<usize>,
}

/// What may be unpacked of any file, in bytes.
const UNPACKED: usize = 16 << 20;

/// What may be unpacked of each byte of a file beyond that.
const UNPACKED_PER_BYTE: usize = 12;

impl<'f> Buffers<'f> {
    pub(super) fn new(
        input: Input<'f>,
        root: &'f Root,
        bin: Option<&'f [u8]>,
        file_len: usize,
    ) -> Self {
        Self {
            input,
            path: input.path,
            root,
            bin,
            loaded: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            unpacked: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
            #[cfg(feature = "draco")]
            meshes: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
            bytes: Cell::new(file_len),
            unpacked_bytes: Cell::new(0),
        }
    }

    /// How many bytes there are: no sound accessor has more elements than this.
    pub(super) fn byte_count(&self) -> usize {
        self.bytes.get()
    }

    /// How many bytes may be unpacked from now on: as many as the bytes that there are may stand for.
    pub(super) fn room_to_unpack(&self) -> usize {
        let most = UNPACKED.saturating_add(self.bytes.get().saturating_mul(UNPACKED_PER_BYTE));
        most.saturating_sub(self.unpacked_bytes.get())
    }

    /// Counts what was unpacked.
    pub(super) fn count_unpacked(&self, bytes: usize) {
        let before = self.unpacked_bytes.get();
        self.unpacked_bytes.set(before.saturating_add(bytes));
    }

    /// An error at a place of this file.
    pub(super) fn refuse(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Error {
        let advice = "the file is damaged or breaks the format's rules: export it again";
        let place: String = place.into();
        Error::format(self.path, place, expected, found, advice)
    }

    /// A view's bytes and stride.
    pub(super) fn view(
        &self,
        index: Index<json::buffer::View>,
        place: &str,
    ) -> Result<(&[u8], Option<usize>)> {
        let view = self.root.get(index).ok_or_else(|| {
            let count = self.root.buffer_views.len();
            let found = format!("buffer view {}", index.value());
            self.refuse(place, format!("one of {count} buffer views"), found)
        })?;
        let place = format!("buffer view {}", index.value());
        let stride = view.byte_stride.map(|s| s.0).filter(|s| *s > 0);
        let bytes = match (meshopt::packed(view), self.unpacked.get(index.value())) {
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
                let offset = view.byte_offset.map_or(0, |o| o.0);
                let range = [offset, view.byte_length.0];
                return Ok((self.part(view.buffer.value(), range, &place)?, stride));
            }
        };
        let stated = usize::try_from(view.byte_length.0).ok();
        let bytes = stated.and_then(|len| bytes.get(..len)).ok_or_else(|| {
            let expected = format!("{} bytes", view.byte_length.0);
            self.refuse(place, expected, format!("{} when unpacked", bytes.len()))
        })?;
        Ok((bytes, stride))
    }

    /// The mesh that a view packs; `unpack` makes it of the view's bytes.
    ///
    /// # Errors
    /// Bytes that are not there, and those of `unpack`.
    #[cfg(feature = "draco")]
    pub(super) fn packed_mesh(
        &self,
        index: Index<json::buffer::View>,
        unpack: impl FnOnce(&[u8]) -> Result<draco_core::Mesh>,
    ) -> Result<&draco_core::Mesh> {
        let (bytes, _) = self.view(index, "")?;
        // The view is there.
        let cell = &self.meshes[index.value()];
        match cell.get() {
            Some(mesh) => Ok(mesh),
            None => {
                let mesh = unpack(bytes)?;
                Ok(cell.get_or_init(|| mesh))
            }
        }
    }

    /// A part of a buffer: from this byte on, so many bytes.
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
        let (Some(buffer), Some(cell)) = (self.root.buffers.get(index), self.loaded.get(index))
        else {
            let expected = format!("one of {} buffers", self.root.buffers.len());
            return Err(self.refuse(place, expected, format!("buffer {index}")));
        };
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let place = format!("buffer {index}");
        let bytes = match (&buffer.uri, self.bin) {
            (Some(uri), _) => {
                let source = Source::of(self.input, uri).map_err(|found| {
                    let advice = "put the file there, or export as one .glb";
                    let expected = "a file beside this one, or base64 data";
                    Error::format(self.path, place.clone(), expected, found, advice)
                })?;
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
        if (bytes.len() as u64) < buffer.byte_length.0 {
            let expected = format!("{} bytes", buffer.byte_length.0);
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
