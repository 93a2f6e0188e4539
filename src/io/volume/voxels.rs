//! Reads the numbers of images with a header (NRRD, MetaImage, NIfTI): locates them, unpacks them, and converts
//! them to fields and a lattice.
//!
//! Numbers are read from start to end in chunks, so that there is no second copy of a file in memory. Before
//! memory is allocated, the header's sizes are compared with the bytes in the file: raw numbers byte by byte,
//! packed ones by the greatest ratio of the compression, text by a character for each number.

use std::collections::{HashSet, VecDeque};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

use bzip2::read::MultiBzDecoder;
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use glam::{DMat3, DVec3};

use super::plain_numbers::PlainNumbers;
use super::raw::DEFLATE_RATIO;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, Stride, scaled};
use crate::io::vtk::array::parsed_text;
use crate::io::vtk::xml::clip;
use crate::memory::check_room;
use crate::scene::{Lattice, LatticeSpacing, Values};

/// Greatest number of bytes that bzip2 makes from one byte. Blocks have 900,000 bytes; the first step makes 255
/// bytes from five, and a block takes some forty bytes.
const BZIP2_RATIO: u64 = 1 << 21;

/// The first bytes of every gzip file.
pub(in crate::io) const GZIP: &[u8] = b"\x1f\x8b";

const DAMAGED: &str = "the file is damaged, or its header is wrong: copy it or save it again";

/// Packing of a file's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Packing {
    /// No packing.
    Raw,
    /// Numbers as text, between white space.
    Text,
    /// Two hexadecimal digits per byte; white space anywhere.
    Hex,
    /// A gzip file, or several one after the other.
    Gzip,
    /// A zlib stream, or a gzip file.
    Zlib,
    /// A bzip2 file, or several one after the other.
    Bzip2,
}

/// The part to skip at the start of each file of numbers.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::io) struct Skip {
    /// Number of lines to skip first, before anything is unpacked.
    pub(in crate::io) lines: u64,
    /// Number of unpacked bytes to skip then.
    pub(in crate::io) bytes: u64,
    /// In place of both: skips all but the numbers, which are the last bytes of the file.
    pub(in crate::io) to_the_end: bool,
}

/// Location of the numbers.
pub(in crate::io) enum Source {
    /// In the header's file, from this byte on.
    Attached(u64),
    /// In other files, each with an equal share of the numbers.
    Beside(Vec<PathBuf>),
}

/// Type, shape and scaling of the numbers.
#[derive(Debug, Clone)]
pub(in crate::io) struct Numbers {
    pub(in crate::io) encoding: Encoding,
    pub(in crate::io) dims: [usize; 3],
    /// Number of interleaved components of a sample.
    pub(in crate::io) beside: usize,
    /// Number of whole volumes, one after the other.
    pub(in crate::io) volumes: usize,
    /// Step between the volumes that are read, the first among them: 1 reads all; the number of volumes reads
    /// the first alone.
    pub(in crate::io) volume_step: usize,
    /// Factor and offset of every number.
    pub(in crate::io) scale: Option<[f64; 2]>,
}

impl Numbers {
    /// The number of samples of one volume, and of bytes of all volumes.
    ///
    /// # Errors
    /// No samples, or more than can be counted.
    pub(in crate::io) fn check(&self, path: &Path) -> Result<(usize, u64)> {
        let [x, y, z] = self.dims;
        let count = x.checked_mul(y).and_then(|n| n.checked_mul(z));
        let size = self.encoding.scalar.size();
        let all = [self.beside, self.volumes, size]
            .into_iter()
            .try_fold(count.unwrap_or(0), usize::checked_mul);
        match (count, all) {
            (Some(count), Some(all)) if all > 0 => Ok((count, all as u64)),
            _ => Err(Error::format(
                path,
                "header, the sizes",
                "counts of at least 1 whose product fits into memory",
                format!(
                    "{x} x {y} x {z} samples of {} x {} numbers",
                    self.beside, self.volumes
                ),
                DAMAGED,
            )),
        }
    }
}

/// Everything that an image's header states.
pub(in crate::io) struct Image {
    /// The format's name, for people.
    pub(in crate::io) format: &'static str,
    pub(in crate::io) lattice: Lattice,
    pub(in crate::io) numbers: Numbers,
    pub(in crate::io) source: Source,
    pub(in crate::io) packing: Packing,
    pub(in crate::io) skip: Skip,
    /// Name of the field.
    pub(in crate::io) field: &'static str,
    pub(in crate::io) unit: Option<String>,
    pub(in crate::io) notes: Vec<String>,
}

impl Image {
    /// Reads the numbers.
    ///
    /// # Errors
    /// Files that are missing or named twice; numbers that are not of the type; fewer numbers than the header
    /// states.
    pub(in crate::io) fn read(mut self, input: Input<'_>) -> Result<Dataset> {
        let (components, more) = read(input, &self.source, self.packing, self.skip, &self.numbers)?;
        self.notes.extend(more);
        Ok(self.into_dataset(input.path, components))
    }

    fn into_dataset(self, path: &Path, components: Vec<Values>) -> Dataset {
        let field = field(self.field, components, self.unit);
        let geometry = Geometry::Lattice(self.lattice);
        Dataset {
            notes: self.notes,
            ..Dataset::new(path, self.format, geometry, vec![field])
        }
    }

    /// Locates plain numbers; the data set is that of [`Self::read`] without values. `None` if the numbers are
    /// packed, are several per sample, lie in several files, or are fewer than the header states.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub(in crate::io) fn plain(
        mut self,
        input: Input<'_>,
    ) -> Result<Option<(Dataset, PlainNumbers)>> {
        let numbers = &self.numbers;
        let (_, wanted) = numbers.check(input.path)?;
        let volumes = numbers.volumes.div_ceil(numbers.volume_step.max(1));
        if self.packing != Packing::Raw || self.skip.lines > 0 || numbers.beside * volumes != 1 {
            return Ok(None);
        }
        let (path, start, len) = match &self.source {
            Source::Attached(start) => (input.path, *start, input.open()?.1),
            Source::Beside(files) => match files.as_slice() {
                [file] => match input.len_beside(file) {
                    Some(len) => (file.as_path(), 0, len),
                    None => return Ok(None),
                },
                _ => return Ok(None),
            },
        };
        let start = match self.skip.to_the_end {
            true => len.checked_sub(wanted).filter(|first| *first >= start),
            false => start.checked_add(self.skip.bytes),
        };
        let end = start.and_then(|start| start.checked_add(wanted));
        let (Some(start), Some(end)) = (start, end.filter(|end| *end <= len)) else {
            return Ok(None);
        };
        let plain = PlainNumbers {
            path: path.to_path_buf(),
            start,
            encoding: numbers.encoding,
            scale: numbers.scale,
        };
        // The bytes after volumes that are left out are not checked.
        if end < len && numbers.volume_step <= 1 {
            self.notes.push(excess(path));
        }
        let values = plain.no_values();
        Ok(Some((self.into_dataset(input.path, vec![values]), plain)))
    }
}

/// Reads all numbers: one [`Values`] for each component, and notes.
fn read(
    input: Input<'_>,
    source: &Source,
    packing: Packing,
    skip: Skip,
    numbers: &Numbers,
) -> Result<(Vec<Values>, Vec<String>)> {
    let (_, wanted) = numbers.check(input.path)?;
    let mut numbers = numbers.clone();
    // Numbers in text are parsed to little-endian bytes, whatever the header states.
    numbers.encoding.big_endian &= packing != Packing::Text;
    let numbers = &numbers;
    let mut notes = Vec::new();
    let components = match source {
        Source::Attached(start) => {
            let mut part = Part::open(input, *start, packing, skip, numbers, wanted)?;
            let components = gather(input.path, &mut part.bytes, numbers)?;
            notes.extend(part.excess_note(input.path, numbers));
            components
        }
        Source::Beside(files) => {
            let each = wanted / files.len().max(1) as u64;
            if each == 0 || each * files.len() as u64 != wanted {
                return Err(Error::format(
                    input.path,
                    "header, the files of numbers",
                    format!("as many files as share {wanted} bytes evenly"),
                    format!("{} files", files.len()),
                    DAMAGED,
                ));
            }
            check_files(input, files, each, packing)?;
            let mut parts = Parts {
                input,
                files: files.iter().cloned().collect(),
                packing,
                skip,
                numbers,
                each,
                current: None,
                notes: Vec::new(),
                error: None,
            };
            let components = gather(input.path, &mut parts, numbers);
            if let Some(error) = parts.error.take() {
                return Err(error);
            }
            let components = components?;
            // An overlong file is noted when its end is looked for.
            parts.close();
            notes.append(&mut parts.notes);
            components
        }
    };
    Ok((components, notes))
}

/// The path of a file of numbers that a header names, relative to the header.
///
/// # Errors
/// The errors of [`beside_as`].
pub(in crate::io) fn beside(path: &Path, name: &str) -> Result<PathBuf> {
    beside_as(path, "header, the files of numbers", name)
}

/// The path of a file that another file names, relative to that file.
///
/// - `place`: place of the name, for errors.
///
/// # Errors
/// A path that leads outside the folder: absolute, with a scheme, or through a parent folder.
pub(in crate::io) fn beside_as(
    path: &Path,
    place: impl std::fmt::Display,
    name: &str,
) -> Result<PathBuf> {
    // The path may use Windows separators.
    let name = name.trim().replace('\\', "/");
    let is_inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    let is_relative = Path::new(&name).components().all(is_inside);
    // `http:`, `C:`.
    if name.is_empty() || name.contains('\0') || name.contains(':') || !is_relative {
        return Err(Error::format(
            path,
            place.to_string(),
            "a relative path, beside this file or in a folder below",
            format!("`{}`", clip(&name)),
            "put the file there, and name it so",
        ));
    }
    Ok(path.parent().unwrap_or(Path::new("")).join(name))
}

/// The files of a pattern such as `slice%03d.raw 1 60 1`. Each must exist, so that a header cannot name more
/// files than there are.
///
/// # Errors
/// A pattern without exactly one conversion; numbers that do not lead from the first to the last; a missing
/// file.
pub(in crate::io) fn by_pattern(
    input: Input<'_>,
    pattern: &str,
    [first, last, step]: [i64; 3],
) -> Result<Vec<PathBuf>> {
    let path = input.path;
    let fault = |found: String| {
        Error::format(
            path,
            "header, the pattern of files",
            "a name with one number such as `%03d`, and the first, the last and the step that leads from one to \
             the other",
            found,
            DAMAGED,
        )
    };
    let mut files = Vec::new();
    let mut number = first;
    while (step > 0 && number <= last) || (step < 0 && number >= last) {
        let name =
            formatted(pattern, number).ok_or_else(|| fault(format!("`{}`", clip(pattern))))?;
        let file = beside(path, &name)?;
        if !input.has_beside(&file) {
            return Err(missing(path, &file));
        }
        files.push(file);
        let Some(next) = number.checked_add(step) else {
            break;
        };
        number = next;
    }
    if files.is_empty() {
        return Err(fault(format!("{first} to {last} by {step}")));
    }
    Ok(files)
}

/// C's `printf` of one integer: `None` if the pattern has another number of conversions, or another kind.
fn formatted(pattern: &str, number: i64) -> Option<String> {
    /// Wider than any integer.
    const MOST_WIDTH: usize = 32;
    let mut text = String::new();
    let mut rest = pattern;
    let mut places = 0;
    while let Some((before, after)) = rest.split_once('%') {
        text.push_str(before);
        if let Some(after) = after.strip_prefix('%') {
            text.push('%');
            rest = after;
            continue;
        }
        let digits = after.bytes().take_while(u8::is_ascii_digit).count();
        let (width, after) = after.split_at(digits);
        let zeros = width.starts_with('0');
        let width = if width.is_empty() {
            0
        } else {
            width.parse().ok().filter(|w| *w <= MOST_WIDTH)?
        };
        text.push_str(&match zeros {
            true => format!("{number:0width$}"),
            false => format!("{number:width$}"),
        });
        rest = after.strip_prefix(['d', 'i', 'u'])?;
        places += 1;
    }
    text.push_str(rest);
    (places == 1).then_some(text)
}

fn missing(path: &Path, file: &Path) -> Error {
    Error::format(
        path,
        "header, the files of numbers",
        "a file beside this one",
        format!("no file `{}`", clip(&file.display().to_string())),
        "put it there, or save header and numbers as one file",
    )
}

/// Checks that all files exist and that none is named twice: such a file would be read repeatedly.
fn check_files(input: Input<'_>, files: &[PathBuf], each: u64, packing: Packing) -> Result<()> {
    let mut named = HashSet::new();
    for file in files {
        let Some(resolved) = input.resolved_beside(file) else {
            return Err(missing(input.path, file));
        };
        if !named.insert(resolved) {
            let found = format!("`{}` again", clip(&file.display().to_string()));
            let place = "header, the files of numbers";
            return Err(Error::format(
                input.path,
                place,
                "each file once",
                found,
                DAMAGED,
            ));
        }
        // A folder has no length.
        let Some(len) = input.len_beside(file) else {
            return Err(missing(input.path, file));
        };
        if !could_hold(packing, len, each) {
            return Err(too_short(file, each, len));
        }
    }
    Ok(())
}

/// Whether `len` bytes of a file can unpack to `wanted` bytes of numbers.
fn could_hold(packing: Packing, len: u64, wanted: u64) -> bool {
    match packing {
        Packing::Raw => wanted <= len,
        Packing::Gzip | Packing::Zlib => wanted <= len.saturating_mul(DEFLATE_RATIO),
        Packing::Bzip2 => wanted <= len.saturating_mul(BZIP2_RATIO),
        Packing::Hex => wanted <= len / 2,
        // A number of eight bytes takes a character and a separator.
        Packing::Text => wanted / 8 <= len / 2 + 1,
    }
}

fn too_short(path: &Path, wanted: u64, found: u64) -> Error {
    Error::format(
        path,
        "numbers",
        format!("{wanted} bytes, as the header's sizes and type ask for"),
        format!("{found} bytes that could hold them"),
        DAMAGED,
    )
}

/// The numbers of one file, as bytes.
struct Part<'a> {
    bytes: Box<dyn Read + 'a>,
}

impl<'a> Part<'a> {
    /// Opens a file from byte `start` on, and skips what is to be skipped.
    fn open(
        input: Input<'a>,
        start: u64,
        packing: Packing,
        skip: Skip,
        numbers: &Numbers,
        wanted: u64,
    ) -> Result<Self> {
        let path = input.path;
        let (file, len) = input.open()?;
        Self::of(path, file, len, start, packing, skip, numbers, wanted)
    }

    #[expect(
        clippy::too_many_arguments,
        reason = "a file, what is skipped of it, and what is wanted"
    )]
    fn of(
        path: &Path,
        mut file: Box<dyn Read + 'a>,
        len: u64,
        start: u64,
        packing: Packing,
        skip: Skip,
        numbers: &Numbers,
        wanted: u64,
    ) -> Result<Self> {
        let failed = |e| {
            Error::io(
                path,
                "reading the numbers",
                e,
                "check the file and the disk",
            )
        };
        let mut len = len.saturating_sub(start);
        pass(&mut file, start).map_err(failed)?;
        if skip.to_the_end {
            if packing != Packing::Raw {
                let expected = "a number of bytes: what is packed has no end that is known";
                let place = "header, the bytes to skip";
                return Err(Error::format(path, place, expected, "-1", DAMAGED));
            }
            let before = len
                .checked_sub(wanted)
                .ok_or_else(|| too_short(path, wanted, len))?;
            pass(&mut file, before).map_err(failed)?;
            return Ok(Self { bytes: file });
        }
        let mut file = io::BufReader::new(file);
        for _ in 0..skip.lines {
            let passed = pass_line(&mut file).map_err(failed)?;
            if passed == 0 {
                return Err(too_short(path, wanted, 0));
            }
            len = len.saturating_sub(passed);
        }
        if !could_hold(packing, len, wanted.saturating_add(skip.bytes)) && packing != Packing::Text
        {
            return Err(too_short(path, wanted, len));
        }
        let mut bytes: Box<dyn Read + 'a> = match packing {
            Packing::Raw => Box::new(file),
            Packing::Gzip => Box::new(MultiGzDecoder::new(file)),
            Packing::Bzip2 => Box::new(MultiBzDecoder::new(file)),
            Packing::Zlib => {
                let start = io::BufRead::fill_buf(&mut file).map_err(failed)?;
                match start.starts_with(GZIP) {
                    true => Box::new(MultiGzDecoder::new(file)),
                    false => Box::new(ZlibDecoder::new(file)),
                }
            }
            Packing::Hex => Box::new(HexDecoder { digits: file }),
            Packing::Text => {
                pass(&mut file, skip.bytes).map_err(failed)?;
                let mut text = Vec::new();
                file.read_to_end(&mut text).map_err(failed)?;
                let count =
                    usize::try_from(wanted).unwrap_or(usize::MAX) / numbers.encoding.scalar.size();
                let bytes = parsed_text(&text, numbers.encoding.scalar, count).map_err(
                    |[expected, found]| Error::format(path, "numbers", expected, found, DAMAGED),
                )?;
                return Ok(Self {
                    bytes: Box::new(io::Cursor::new(bytes)),
                });
            }
        };
        pass(&mut bytes, skip.bytes).map_err(failed)?;
        Ok(Self { bytes })
    }

    /// A note if there is more than the header states: some writers pad files, or the header belongs to another
    /// file.
    fn excess_note(&mut self, path: &Path, numbers: &Numbers) -> Option<String> {
        // Volumes that are left out are not read.
        if numbers.volume_step > 1 {
            return None;
        }
        let mut beyond = [0];
        let is_longer = matches!(self.bytes.read(&mut beyond), Ok(n) if n > 0);
        is_longer.then(|| excess(path))
    }
}

/// The note on a file with more bytes than its header states.
fn excess(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    format!("bytes of {name} beyond those that the header names are left out")
}

/// Reads and discards `count` bytes, or all there are.
fn pass(source: &mut dyn Read, count: u64) -> io::Result<()> {
    io::copy(&mut source.take(count), &mut io::sink()).map(drop)
}

/// Reads and discards a line. Returns its length, 0 at the end of the file.
fn pass_line(source: &mut dyn io::BufRead) -> io::Result<u64> {
    let mut passed = 0;
    loop {
        let buffer = source.fill_buf()?;
        let end = buffer.iter().position(|&b| b == b'\n');
        let len = end.map_or(buffer.len(), |end| end + 1);
        source.consume(len);
        passed += len as u64;
        if end.is_some() || len == 0 {
            return Ok(passed);
        }
    }
}

/// Decodes hexadecimal digits to bytes.
struct HexDecoder<R> {
    digits: R,
}

impl<R: Read> HexDecoder<R> {
    fn digit(&mut self) -> io::Result<Option<u8>> {
        let mut byte = [0];
        loop {
            if self.digits.read(&mut byte)? == 0 {
                return Ok(None);
            }
            if byte[0].is_ascii_whitespace() {
                continue;
            }
            let digit = char::from(byte[0]).to_digit(16);
            return match digit.and_then(|digit| u8::try_from(digit).ok()) {
                Some(digit) => Ok(Some(digit)),
                None => Err(io::Error::other("what is no hexadecimal digit")),
            };
        }
    }
}

impl<R: Read> Read for HexDecoder<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        for (i, byte) in out.iter_mut().enumerate() {
            let Some(high) = self.digit()? else {
                return Ok(i);
            };
            let Some(low) = self.digit()? else {
                return Ok(i);
            };
            *byte = high << 4 | low;
        }
        Ok(out.len())
    }
}

/// The numbers of several files, one after the other.
struct Parts<'a> {
    input: Input<'a>,
    files: VecDeque<PathBuf>,
    packing: Packing,
    skip: Skip,
    numbers: &'a Numbers,
    each: u64,
    /// The file being read, and its remaining number of bytes.
    current: Option<(PathBuf, Part<'a>, u64)>,
    notes: Vec<String>,
    error: Option<Error>,
}

impl Parts<'_> {
    fn close(&mut self) {
        if let Some((file, mut part, 0)) = self.current.take() {
            self.notes.extend(part.excess_note(&file, self.numbers));
        }
    }
}

impl Read for Parts<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if matches!(&self.current, Some((.., 0))) {
            self.close();
        }
        if self.current.is_none() {
            let Some(file) = self.files.pop_front() else {
                return Ok(0);
            };
            let part = self.input.open_beside(&file).and_then(|(bytes, len)| {
                let (packing, skip) = (self.packing, self.skip);
                Part::of(&file, bytes, len, 0, packing, skip, self.numbers, self.each)
            });
            match part {
                Ok(part) => self.current = Some((file, part, self.each)),
                Err(error) => {
                    self.error = Some(error);
                    return Err(io::Error::other("a file of numbers"));
                }
            }
        }
        let Some((file, part, left)) = &mut self.current else {
            return Ok(0);
        };
        let most = usize::try_from(*left).unwrap_or(out.len()).min(out.len());
        let count = part.bytes.read(&mut out[..most])?;
        if count == 0 && most > 0 {
            // The next file's numbers must not complete this one's.
            self.error = Some(too_short(file, self.each, self.each - *left));
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        *left -= count as u64;
        Ok(count)
    }
}

/// Reads numbers by chunks into one [`Values`] for each component.
pub(in crate::io) fn gather(
    path: &Path,
    source: &mut dyn Read,
    numbers: &Numbers,
) -> Result<Vec<Values>> {
    /// Approximate number of bytes read at a time: they are unpacked in the second-level cache.
    const CHUNK: usize = 1 << 17;
    let (count, wanted) = numbers.check(path)?;
    let Numbers {
        encoding,
        beside,
        scale,
        ..
    } = *numbers;
    // One volume at least, in four bytes per number at most.
    let kept = count as u64 * beside as u64 * encoding.scalar.size().min(4) as u64;
    check_room(path, "header, the sizes", kept)?;
    let sample = encoding.scalar.size() * beside;
    let mut found = 0;
    let mut chunk = Vec::new();
    let mut components = Vec::new();
    for volume in (0..numbers.volumes).step_by(numbers.volume_step.max(1)) {
        let skipped = (numbers.volume_step.max(1) - 1) as u64 * (count * sample) as u64;
        if volume > 0 {
            pass(source, skipped).map_err(|e| unpacking(path, &e))?;
            found += skipped;
        }
        let mut all: Vec<Option<Values>> = vec![None; beside];
        let mut left = count;
        while left > 0 {
            let samples = left.min((CHUNK / sample).max(1));
            chunk.resize(samples * sample, 0);
            let read = read_into(source, &mut chunk).map_err(|e| unpacking(path, &e))?;
            found += read as u64;
            if read < chunk.len() {
                return Err(too_short(path, wanted, found));
            }
            for (component, all) in all.iter_mut().enumerate() {
                let stride = Stride {
                    first: component * encoding.scalar.size(),
                    step: sample,
                    count: samples,
                };
                append(all, scaled(&chunk, encoding, stride, scale));
            }
            left -= samples;
        }
        components.extend(all.into_iter().flatten());
    }
    Ok(components)
}

/// Reads until `out` is full or the source ends. Returns the number of bytes.
fn read_into(source: &mut dyn Read, out: &mut [u8]) -> io::Result<usize> {
    let mut read = 0;
    while read < out.len() {
        match source.read(&mut out[read..]) {
            Ok(0) => break,
            Ok(n) => read += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(read)
}

fn unpacking(path: &Path, error: &io::Error) -> Error {
    let expected = "what can be unpacked";
    Error::format(path, "numbers", expected, error.to_string(), DAMAGED)
}

pub(in crate::io) fn append(all: &mut Option<Values>, more: Values) {
    // Chunks of one file have one type.
    match all {
        Some(all) if all.kind_name() == more.kind_name() => all.append(more),
        all => *all = Some(more),
    }
}

/// One field of the nodes.
pub(in crate::io) fn field(name: &str, mut components: Vec<Values>, unit: Option<String>) -> Field {
    let source = match components.len() {
        1 => FieldSource::Scalar(components.remove(0)),
        _ => FieldSource::Vector(components),
    };
    Field {
        name: name.to_owned(),
        association: Association::Nodes,
        source,
        unit,
    }
}

/// The lattice of an image. An image of two dimensions is a layer. Its third step is perpendicular to the two
/// given ones, and as long as the shorter of these.
///
/// - `place`: place in the header, for messages.
///
/// # Errors
/// Numbers that are not finite, or cells without a volume.
pub(in crate::io) fn lattice(
    path: &Path,
    place: &str,
    dims: [usize; 3],
    origin: DVec3,
    steps: &[DVec3],
) -> Result<Lattice> {
    let step = step(steps).filter(|_| origin.is_finite());
    let step = step.ok_or_else(|| {
        let given: Vec<String> = steps.iter().map(ToString::to_string).collect();
        Error::format(
            path,
            place,
            "finite numbers whose cells have a volume",
            format!("origin {origin}, steps {}", given.join(" ")),
            "correct the header",
        )
    })?;
    let spacing = LatticeSpacing::Uniform { origin, step };
    Ok(Lattice { dims, spacing })
}

/// The steps along three indices as columns, from two or three given ones; `None` if cells have no volume.
pub(in crate::io) fn step(steps: &[DVec3]) -> Option<DMat3> {
    let step = match *steps {
        [x, y] => {
            let upright = x.cross(y).normalize_or_zero();
            DMat3::from_cols(x, y, upright * x.length().min(y.length()))
        }
        [x, y, z] => DMat3::from_cols(x, y, z),
        _ => return None,
    };
    let volume = step.determinant();
    (volume.is_finite() && volume != 0.0).then_some(step)
}
