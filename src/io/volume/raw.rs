//! Reads raw volumes: numbers without a header, as in the Open SciVis data sets.
//!
//! | bytes | content |
//! |---|---|
//! | all | `dims[0] * dims[1] * dims[2]` numbers, x fastest, then y, then z |
//!
//! The file does not state its dimensions, type or byte order: the user does. The length must match exactly. A
//! gzip-compressed file (`.raw.gz`) is unpacked while it is read, never beyond the bytes of the dimensions.

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use glam::DVec3;

use super::plain_numbers::PlainNumbers;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Hint, Parameter, Result, SuggestedLayout};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::scene::{Lattice, Values};

/// Greatest number of bytes that one byte of a deflate stream can decode to: a match of 258 bytes coded in two
/// bits.
pub(crate) const DEFLATE_RATIO: u64 = 1032;

/// Scalar types of raw volumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawType {
    /// Unsigned bytes.
    U8,
    /// Signed 16-bit integers.
    I16,
    /// Unsigned 16-bit integers.
    U16,
    /// Single-precision floats.
    F32,
}

impl RawType {
    fn scalar(self) -> ScalarType {
        match self {
            Self::U8 => ScalarType::U8,
            Self::I16 => ScalarType::I16,
            Self::U16 => ScalarType::U16,
            Self::F32 => ScalarType::F32,
        }
    }
}

/// The parameters that a raw volume's file does not state.
#[derive(Debug, Clone, PartialEq)]
pub struct RawLayout {
    /// Number of samples along x, y and z.
    pub dims: [usize; 3],
    /// Distance from one sample to the next along each axis, world units.
    pub spacing: DVec3,
    /// Position of the first sample, world units.
    pub origin: DVec3,
    /// The type of the numbers.
    pub scalar: RawType,
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
}

impl RawLayout {
    /// A little-endian volume of unit spacing at the origin.
    pub fn new(dims: [usize; 3], scalar: RawType) -> Self {
        Self {
            dims,
            spacing: DVec3::ONE,
            origin: DVec3::ZERO,
            scalar,
            big_endian: false,
        }
    }

    fn encoding(&self) -> Encoding {
        Encoding {
            scalar: self.scalar.scalar(),
            big_endian: self.big_endian,
        }
    }
}

/// Reads a raw volume, gzip-compressed or not. Samples lie at origin + index x spacing; the
/// field is named `value`.
///
/// # Errors
/// An invalid layout, or a file of another length.
pub(crate) fn read(input: Input<'_>, layout: Option<&RawLayout>) -> Result<Dataset> {
    let path = input.path;
    let (layout, count, byte_count) = checked(path, layout)?;
    let [nx, ny, nz] = layout.dims;
    let size = layout.scalar.scalar().size();

    let (mut file, len) = input.open()?;
    let mut magic = [0; 2];
    let is_gzip = len != byte_count as u64
        && len > 18
        && file.read_exact(&mut magic).is_ok()
        && magic == [0x1f, 0x8b];
    let (mut file, len) = input.open()?;
    let wrong_size = |found: String| {
        Error::format(
            path,
            "size",
            format!("{byte_count} bytes ({nx} x {ny} x {nz} samples of {size} bytes)"),
            found,
            Hint::CorrectDimsOrType,
        )
    };
    let numbers = if is_gzip {
        if byte_count as u64 > len.saturating_mul(DEFLATE_RATIO) {
            return Err(wrong_size(format!(
                "{len} gzip bytes, too few to hold them"
            )));
        }
        read_values(
            path,
            &mut MultiGzDecoder::new(file),
            layout,
            count,
            &wrong_size,
        )?
    } else {
        if len != byte_count as u64 {
            return Err(wrong_size(format!("{len} bytes")));
        }
        read_values(path, &mut file, layout, count, &wrong_size)?
    };
    Ok(dataset(path, layout, numbers))
}

/// Locates the numbers; the data set is that of [`read`] without values. `None` if the file's length differs
/// from the layout, as that of a gzip file does.
///
/// # Errors
/// An invalid layout; a file that cannot be opened.
pub(in crate::io) fn plain(
    input: Input<'_>,
    layout: Option<&RawLayout>,
) -> Result<Option<(Dataset, PlainNumbers)>> {
    let path = input.path;
    let (layout, _, byte_count) = checked(path, layout)?;
    let (_, len) = input.open()?;
    if len != byte_count as u64 {
        return Ok(None);
    }
    let plain = PlainNumbers {
        path: path.to_path_buf(),
        start: 0,
        encoding: layout.encoding(),
        scale: None,
    };
    let head = dataset(path, layout, plain.no_values());
    Ok(Some((head, plain)))
}

fn dataset(path: &Path, layout: &RawLayout, numbers: Values) -> Dataset {
    let lattice = Lattice::uniform(layout.dims, layout.origin, layout.spacing);
    let field = Field {
        name: "value".to_owned(),
        association: Association::Nodes,
        source: FieldSource::Scalar(numbers),
        unit: None,
    };
    let geometry = Geometry::Lattice(lattice);
    Dataset::new(path, "raw volume", geometry, vec![field])
}

/// A checked layout, its number of numbers, and their bytes.
fn checked<'l>(
    path: &Path,
    layout: Option<&'l RawLayout>,
) -> Result<(&'l RawLayout, usize, usize)> {
    let layout = layout.ok_or_else(|| Error::NoLayout {
        path: path.to_path_buf(),
        suggested: layout_from_name(path),
    })?;
    let [nx, ny, nz] = layout.dims;
    let size = layout.scalar.scalar().size();
    let count = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz));
    let byte_count = count.and_then(|n| n.checked_mul(size));
    let (Some(count), Some(byte_count)) = (count.filter(|&n| n > 0), byte_count) else {
        return Err(Error::format(
            path,
            Parameter::RawDims,
            "three counts of at least 1 whose product fits into memory",
            format!("{nx},{ny},{nz}"),
            Hint::CorrectDims,
        ));
    };
    let spacing_is_usable = layout.spacing.is_finite() && layout.spacing.cmpne(DVec3::ZERO).all();
    if !spacing_is_usable || !layout.origin.is_finite() {
        return Err(Error::format(
            path,
            Parameter::RawGeometry,
            "finite numbers, and no spacing of zero",
            format!("spacing {}, origin {}", layout.spacing, layout.origin),
            "correct the option",
        ));
    }
    Ok((layout, count, byte_count))
}

/// Reads exactly `count` numbers, in chunks, so that there is no second copy of the file in memory.
fn read_values(
    path: &Path,
    mut source: &mut dyn Read,
    layout: &RawLayout,
    count: usize,
    wrong_size: &dyn Fn(String) -> Error,
) -> Result<Values> {
    /// A multiple of every scalar's size.
    const CHUNK: usize = 1 << 18;
    let encoding = layout.encoding();
    let size = encoding.scalar.size();
    let failed = |e| Error::io(path, "reading the values", e, "check the file and the disk");
    let mut all = match layout.scalar {
        RawType::U8 => Values::U8(Vec::new()),
        RawType::I16 => Values::I16(Vec::new()),
        RawType::U16 => Values::U16(Vec::new()),
        RawType::F32 => Values::F32(Vec::new()),
    };
    let mut chunk = Vec::with_capacity(CHUNK);
    while all.len() < count {
        let want = ((count - all.len()) * size).min(CHUNK);
        chunk.clear();
        Read::by_ref(&mut source)
            .take(want as u64)
            .read_to_end(&mut chunk)
            .map_err(failed)?;
        if chunk.len() < want {
            return Err(wrong_size(format!(
                "only {} bytes",
                all.len() * size + chunk.len()
            )));
        }
        let stride = Stride {
            first: 0,
            step: size,
            count: want / size,
        };
        match (&mut all, values(&chunk, encoding, stride)) {
            (Values::U8(all), Some(Values::U8(more))) => all.extend(more),
            (Values::I16(all), Some(Values::I16(more))) => all.extend(more),
            (Values::U16(all), Some(Values::U16(more))) => all.extend(more),
            (Values::F32(all), Some(Values::F32(more))) => all.extend(more),
            _ => return Err(wrong_size("another type".to_owned())),
        }
    }
    let mut beyond = [0];
    if source.read(&mut beyond).map_err(failed)? > 0 {
        return Err(wrong_size("more bytes than that".to_owned()));
    }
    Ok(all)
}

/// The layout in a name such as `engine_256x256x128_uint8.raw`.
pub(crate) fn layout_from_name(path: &Path) -> Option<SuggestedLayout> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    let words: Vec<&str> = name.split(|c: char| !c.is_ascii_alphanumeric()).collect();
    let dims = words.iter().find_map(|word| {
        let counts: Option<Vec<usize>> = word.split('x').map(|n| n.parse().ok()).collect();
        counts.and_then(|c| c.try_into().ok())
    })?;
    let scalar = words.iter().find_map(|&word| match word {
        "uint8" | "u8" | "uchar" | "byte" => Some("u8"),
        "int16" | "i16" | "short" => Some("i16"),
        "uint16" | "u16" | "ushort" => Some("u16"),
        "float32" | "f32" | "float" => Some("f32"),
        _ => None,
    })?;
    Some(SuggestedLayout { dims, scalar })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        gz.write_all(bytes).unwrap();
        gz.finish().unwrap()
    }

    #[test]
    fn numbers_come_in_their_type_and_byte_order() {
        let bytes = [1, 2, 3, 4, 5, 6, 7, 8];
        let mut layout = RawLayout::new([2, 2, 1], RawType::U16);
        layout.big_endian = true;
        for bytes in [bytes.to_vec(), gzip(&bytes)] {
            let data = read(Input::of_file(file(&bytes).path()), Some(&layout)).unwrap();
            let (_, values) = data.scalar("value").unwrap();
            assert_eq!(values, Values::U16(vec![0x0102, 0x0304, 0x0506, 0x0708]));
        }
    }

    #[test]
    fn chunks_join_without_a_seam() {
        let bytes: Vec<u8> = (0..300_000_u32)
            .flat_map(|i| (i as f32).to_le_bytes())
            .collect();
        let layout = RawLayout::new([300, 100, 10], RawType::F32);
        let data = read(Input::of_file(file(&bytes).path()), Some(&layout)).unwrap();
        let (_, values) = data.scalar("value").unwrap();
        assert!((0..300_000).all(|i| values.get(i) == i as f32));
    }

    #[test]
    fn sizes_must_match() {
        for (bytes, dims) in [
            (vec![0; 7], [2, 2, 2]),
            (vec![0; 9], [2, 2, 2]),
            (gzip(&[0; 70]), [71, 1, 1]),
            (gzip(&[0; 71]), [70, 1, 1]),
            (gzip(&[0; 70]), [usize::MAX, 1, 1]),
            (vec![0; 8], [usize::MAX, 3, 3]),
            (vec![0; 8], [0, 3, 3]),
        ] {
            let err = read(
                Input::of_file(file(&bytes).path()),
                Some(&RawLayout::new(dims, RawType::U8)),
            )
            .unwrap_err();
            assert!(matches!(err, Error::Format { .. }), "{err}");
        }
    }

    #[test]
    fn the_name_suggests_a_layout() {
        let suggest = |name: &str| layout_from_name(Path::new(name)).map(|l| (l.dims, l.scalar));
        assert_eq!(
            suggest("a/engine_256x256x128_uint8.raw"),
            Some(([256, 256, 128], "u8"))
        );
        assert_eq!(suggest("foot_8x8x8_int16.raw.gz"), Some(([8, 8, 8], "i16")));
        assert_eq!(suggest("engine.raw"), None);
        assert_eq!(suggest("a_8x8_uint8.raw"), None);
    }
}
