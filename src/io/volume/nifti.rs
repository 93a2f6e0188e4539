//! Reads NIfTI-1 and NIfTI-2 (`.nii`, `.nii.gz`, and `.hdr` with its numbers in `.img`).
//!
//! | bytes of NIfTI-1 | of NIfTI-2 | content |
//! |---|---|---|
//! | 0..4: 348 | 0..4: 540 | the header's length, in the byte order of the file |
//! | 344..348 | 4..12 | `n+1`, `n+2`, or `ni1`, `ni2` with the numbers in another file |
//! | 40..56: i16 | 16..80: i64 | `dim`: number of axes, then their sizes |
//! | 70..72 | 12..14 | `datatype` |
//! | 76..108: f32 | 104..168: f64 | `pixdim`: a sign, then the spacings |
//! | 108..112: f32 | 168..176: i64 | `vox_offset`: offset of the numbers |
//! | 112..120: f32 | 176..192: f64 | `scl_slope` and `scl_inter` |
//! | 252..256: i16 | 344..352: i32 | `qform_code` and `sform_code` |
//! | 256..280: f32 | 352..400: f64 | `quatern_b`, `c`, `d`, `qoffset_x`, `y`, `z` |
//! | 280..328: f32 | 400..496: f64 | `srow_x`, `y`, `z` |
//!
//! World axes are the format's: +x right, +y to the front, +z up. Sample (i, j, k) lies at the position from
//! `srow` if `sform_code` is above 0; else from the quaternion if `qform_code` is; else at `pixdim` times (i,
//! j, k). A `scl_slope` of 0 or none leaves the numbers unscaled.
//!
//! <https://nifti.nimh.nih.gov/nifti-1>, <https://nifti.nimh.nih.gov/pub/dist/doc/nifti2.h>

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use glam::{DMat3, DQuat, DVec3};

use super::voxels::{self, GZIP, Image, Numbers, Packing, Skip, Source};
use crate::data::dataset::Dataset;
use crate::error::{Error, Hint, Result};
use crate::io::bytes::file::extension;
use crate::io::bytes::file::{HEAD, Input};
use crate::io::bytes::scalars::{Encoding, ScalarType, double};

/// Lengths of the headers.
const FIRST: usize = 348;
const SECOND: usize = 540;

const DAMAGED: &str = "the file is damaged: copy it or save it again";

/// Version of a header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Version {
    One,
    Two,
}

impl Version {
    /// The version by the length and the magic number, and whether the numbers are in the same file; `None` for
    /// other files.
    fn of(head: &[u8]) -> Option<(Self, bool)> {
        match (head.get(344..348), head.get(4..8)) {
            (Some(b"n+1\0"), _) => Some((Self::One, true)),
            (Some(b"ni1\0"), _) => Some((Self::One, false)),
            (_, Some(b"n+2\0")) => Some((Self::Two, true)),
            (_, Some(b"ni2\0")) => Some((Self::Two, false)),
            _ => None,
        }
    }

    fn header_len(self) -> usize {
        match self {
            Self::One => FIRST,
            Self::Two => SECOND,
        }
    }
}

/// The first bytes, unpacked if they are gzip: as many as a header has, or all there are.
fn start(head: &[u8]) -> Vec<u8> {
    let mut start = Vec::new();
    if head.starts_with(GZIP) {
        // A cut or damaged stream gives fewer bytes.
        let mut unpacked = MultiGzDecoder::new(head).take(SECOND as u64);
        unpacked.read_to_end(&mut start).ok();
    } else {
        start.extend_from_slice(&head[..head.len().min(SECOND)]);
    }
    start
}

/// Whether a file begins with a header.
///
/// - `head`: some hundred bytes more than a header.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    Version::of(&start(head)).is_some()
}

/// Whether a file begins with the header of an Analyze 7.5 image. NIfTI descends from this format, which does
/// not state the orientation of the axes.
pub(in crate::io) fn looks_like_analyze(head: &[u8]) -> bool {
    let len = head.get(..4).and_then(|b| <[u8; 4]>::try_from(b).ok());
    let is_len = len.is_some_and(|b| [i32::from_le_bytes(b), i32::from_be_bytes(b)].contains(&348));
    is_len && head.get(38) == Some(&b'r')
}

/// The header beside an image (`.img`), by the image's name; `None` if there is none.
pub(in crate::io) fn header_beside(input: Input<'_>) -> Option<std::path::PathBuf> {
    let header = input.path.with_extension("hdr");
    let is_image = extension(input.path) == "img";
    (is_image && input.has_beside(&header)).then_some(header)
}

/// Reads the first volume of a series, or an image as a layer; the header may be in a file beside it.
///
/// # Errors
/// An Analyze 7.5 header; one that breaks the format's rules; a type that is not read; fewer numbers than the
/// header states.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    with_header(input, |input| image(input)?.read(input))
}

/// Applies `work` to the file that begins with the header: this one, or the one beside it.
pub(in crate::io) fn with_header<T>(
    input: Input<'_>,
    work: impl FnOnce(Input<'_>) -> Result<T>,
) -> Result<T> {
    let (head, _) = input.head(HEAD)?;
    match header_beside(input).filter(|_| !looks_like(&head)) {
        Some(header) => input.with_beside(&header, work),
        None => work(input),
    }
}

/// Reads the header at the start of a file.
///
/// # Errors
/// The errors of [`read`], except for numbers.
pub(in crate::io) fn image(input: Input<'_>) -> Result<Image> {
    let path = input.path;
    let (head, _) = input.head(HEAD)?;
    if !looks_like(&head) && looks_like_analyze(&head) {
        return Err(refuse_analyze(path));
    }
    let is_gzip = head.starts_with(GZIP);
    let start = start(&head);
    let fault = |place: &str, expected: &str, found: String| {
        Error::format(path, format!("header, {place}"), expected, found, DAMAGED)
    };
    let whole = Version::of(&start).filter(|(version, _)| start.len() >= version.header_len());
    let Some((version, is_attached)) = whole else {
        let found = format!("{} bytes without it", start.len());
        return Err(fault(
            "`magic`",
            "a NIfTI header of 348 or 540 bytes",
            found,
        ));
    };
    let header = Header::of(&start, version).ok_or_else(|| {
        let expected = "the header's length in either byte order";
        fault("`sizeof_hdr`", expected, format!("{:?}", &start[..4]))
    })?;

    let mut notes = Vec::new();
    let sizes = header.sizes(path)?;
    let (scalar, beside) = header.data_type(path)?;
    let product = |sizes: &[usize]| sizes.iter().try_fold(1, |n: usize, m| n.checked_mul(*m));
    let too_many = || {
        fault(
            "`dim`",
            "counts whose product fits into memory",
            "more".into(),
        )
    };
    let times = product(&sizes[3..4]).ok_or_else(too_many)?;
    let behind = product(&sizes[4..]).ok_or_else(too_many)?;
    let volumes = times.checked_mul(behind).ok_or_else(too_many)?;
    // The fifth axis is that of vectors.
    let vector = sizes[4] == behind && behind > 1;
    if volumes > 1 && !(vector && times == 1) {
        notes.push(match vector {
            true => format!("The first of {times} times."),
            false => format!("The first of {volumes} volumes."),
        });
    }
    let numbers = Numbers {
        encoding: Encoding {
            scalar,
            big_endian: header.big_endian,
        },
        dims: [sizes[0], sizes[1], sizes[2]],
        beside,
        volumes,
        volume_step: match vector {
            true => times,
            false => volumes,
        }
        .max(1),
        scale: match beside {
            1 => header.scale(path)?,
            _ => None,
        },
    };
    numbers.check(path)?;
    let lattice = {
        let (origin, steps, passed_over) = header.placement(header.axis_count().min(3));
        notes.extend(passed_over);
        let place = "header, `sform`, `qform` and `pixdim`";
        voxels::lattice(path, place, numbers.dims, origin, &steps)?
    };

    let offset = header.offset(path)?;
    let (source, packing, bytes) = if is_attached {
        let least = version.header_len() as u64;
        if offset != 0 && offset < least {
            let expected = format!("0 or at least {least}");
            return Err(fault("`vox_offset`", &expected, offset.to_string()));
        }
        // Some writers store 0 for the first offset after the header and its four bytes of flags.
        let offset = if offset == 0 { least + 4 } else { offset };
        (Source::Attached(0), packing(is_gzip), offset)
    } else {
        let (file, is_gzip) = image_beside(input)?;
        (Source::Beside(vec![file]), packing(is_gzip), offset)
    };
    let skip = Skip {
        bytes,
        ..Skip::default()
    };
    let name = match beside {
        3 => "rgb",
        4 => "rgba",
        _ => "value",
    };
    Ok(Image {
        format: "NIfTI image",
        lattice,
        numbers,
        source,
        packing,
        skip,
        field: name,
        unit: None,
        notes,
    })
}

fn packing(is_gzip: bool) -> Packing {
    match is_gzip {
        true => Packing::Gzip,
        false => Packing::Raw,
    }
}

/// The file of a header's numbers, and whether it is compressed.
fn image_beside(input: Input<'_>) -> Result<(std::path::PathBuf, bool)> {
    let path = input.path;
    // `a.hdr` and `a.hdr.gz` have `a.img` or `a.img.gz`.
    let is_gz = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let bare = if is_gz {
        path.with_extension("")
    } else {
        path.to_path_buf()
    };
    let image = bare.with_extension("img");
    let packed = bare.with_extension("img.gz");
    if input.has_beside(&image) {
        return Ok((image, false));
    }
    if input.has_beside(&packed) {
        return Ok((packed, true));
    }
    let place = "header, `magic`";
    let found = format!("no file `{}`", image.display());
    let advice = "put it there, or save the image as one file (.nii)";
    Err(Error::format(
        path,
        place,
        "the numbers beside this file",
        found,
        advice,
    ))
}

/// Types of the format that are not single numbers.
fn refused_type(code: i64) -> Option<&'static str> {
    Some(match code {
        1 => "bits",
        32 | 1792 | 2048 => "complex numbers",
        1536 => "floats of 128 bits",
        _ => return None,
    })
}

struct Header<'h> {
    bytes: &'h [u8],
    version: Version,
    big_endian: bool,
}

impl<'h> Header<'h> {
    /// `None` if the first word is not the length of the header in either byte order.
    fn of(bytes: &'h [u8], version: Version) -> Option<Self> {
        let word: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
        let len = u32::try_from(version.header_len()).ok()?;
        let big_endian = match word {
            word if u32::from_le_bytes(word) == len => false,
            word if u32::from_be_bytes(word) == len => true,
            _ => return None,
        };
        Some(Self {
            bytes,
            version,
            big_endian,
        })
    }

    /// The number at each version's offset, of its type there.
    fn number(&self, one: (usize, ScalarType), two: (usize, ScalarType)) -> f64 {
        let (at, scalar) = match self.version {
            Version::One => one,
            Version::Two => two,
        };
        let big_endian = self.big_endian;
        let bytes = self.bytes.get(at..at + scalar.size()).unwrap_or(&[0; 8]);
        double(bytes, Encoding { scalar, big_endian })
    }

    /// The `i`-th real of an array, by its offsets in both versions; f32 in the first, f64 in the second.
    fn real(&self, one: usize, two: usize, i: usize) -> f64 {
        self.number(
            (one + 4 * i, ScalarType::F32),
            (two + 8 * i, ScalarType::F64),
        )
    }

    /// `dim[i]`.
    fn dim(&self, i: usize) -> f64 {
        self.number((40 + 2 * i, ScalarType::I16), (16 + 8 * i, ScalarType::I64))
    }

    fn axis_count(&self) -> usize {
        (1..=7)
            .find(|n| self.dim(0) == f64::from(*n))
            .map_or(0, |n| n as usize)
    }

    /// The sizes of seven axes; 1 for axes that do not exist.
    fn sizes(&self, path: &Path) -> Result<[usize; 7]> {
        let fault = |i: usize, expected: &str| {
            let place = format!("header, `dim[{i}]`");
            Error::format(path, place, expected, self.dim(i).to_string(), DAMAGED)
        };
        let count = self.axis_count();
        if count < 2 {
            return Err(fault(0, "2 to 7 axes"));
        }
        let mut sizes = [1; 7];
        for (axis, size) in sizes.iter_mut().enumerate().take(count) {
            /// Exact in double precision, and more than fits into memory.
            const MOST: f64 = 9e15;
            let stated = self.dim(axis + 1);
            // Unused axes are 0 in some files.
            let stated = if axis > 2 { stated.max(1.0) } else { stated };
            if !(1.0..=MOST).contains(&stated) {
                return Err(fault(axis + 1, "a count of at least 1"));
            }
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a whole number within the range above"
            )]
            {
                *size = stated as usize;
            }
        }
        Ok(sizes)
    }

    /// The type of a number, and the number of them in a sample.
    fn data_type(&self, path: &Path) -> Result<(ScalarType, usize)> {
        let code = self.number((70, ScalarType::I16), (12, ScalarType::I16));
        #[allow(clippy::cast_possible_truncation, reason = "it was an i16")]
        let code = code as i64;
        Ok(match code {
            2 => (ScalarType::U8, 1),
            4 => (ScalarType::I16, 1),
            8 => (ScalarType::I32, 1),
            16 => (ScalarType::F32, 1),
            64 => (ScalarType::F64, 1),
            128 => (ScalarType::U8, 3),
            256 => (ScalarType::I8, 1),
            512 => (ScalarType::U16, 1),
            768 => (ScalarType::U32, 1),
            1024 => (ScalarType::I64, 1),
            1280 => (ScalarType::U64, 1),
            2304 => (ScalarType::U8, 4),
            _ => {
                let place = "header, `datatype`";
                let expected = "integers, floats of 32 or 64 bits, or RGB";
                let found = match refused_type(code) {
                    Some(name) => format!("{code}: {name}, which are not read"),
                    None => format!("{code}"),
                };
                let advice = "save the image with another type of numbers";
                return Err(Error::format(path, place, expected, found, advice));
            }
        })
    }

    fn scale(&self, path: &Path) -> Result<Option<[f64; 2]>> {
        let [slope, inter] = [0, 1].map(|i| self.real(112, 176, i));
        if slope == 0.0 || !slope.is_finite() || (slope == 1.0 && inter == 0.0) {
            return Ok(None);
        }
        if !inter.is_finite() {
            let place = "header, `scl_inter`";
            let found = inter.to_string();
            return Err(Error::format(
                path,
                place,
                "a finite number",
                found,
                DAMAGED,
            ));
        }
        Ok(Some([slope, inter]))
    }

    fn offset(&self, path: &Path) -> Result<u64> {
        let offset = self.number((108, ScalarType::F32), (168, ScalarType::I64));
        /// More than the length of any file.
        const MOST: f64 = 9e15;
        if !(0.0..=MOST).contains(&offset) {
            let place = "header, `vox_offset`";
            let expected = "a number of bytes";
            let found = offset.to_string();
            return Err(Error::format(path, place, expected, found, DAMAGED));
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the range above"
        )]
        Ok(offset as u64)
    }

    /// The position of the first sample and the steps along `of_space` axes, from the first of the three ways
    /// that can be used, and a note on those that cannot.
    fn placement(&self, of_space: usize) -> (DVec3, Vec<DVec3>, Option<String>) {
        let code = |i: usize| {
            self.number(
                (252 + 2 * i, ScalarType::I16),
                (344 + 4 * i, ScalarType::I32),
            )
        };
        let mut passed_over = Vec::new();
        for (name, is_stated, (origin, step)) in [
            ("sform", code(1) > 0.0, self.sform()),
            ("qform", code(0) > 0.0, self.qform()),
        ] {
            if !is_stated {
                continue;
            }
            let steps = [step.x_axis, step.y_axis, step.z_axis][..of_space].to_vec();
            if origin.is_finite() && voxels::step(&steps).is_some() {
                return (origin, steps, Self::note(&passed_over));
            }
            passed_over.push(name);
        }
        let steps = (0..of_space).map(|axis| {
            let spacing = self.real(76, 104, axis + 1).abs();
            // Headers that were never filled in have 0.
            DVec3::AXES[axis] * if spacing == 0.0 { 1.0 } else { spacing }
        });
        (DVec3::ZERO, steps.collect(), Self::note(&passed_over))
    }

    fn note(passed_over: &[&str]) -> Option<String> {
        let names = passed_over.join(" and ");
        let note = format!("The header's {names} cannot be used: its cells have no volume.");
        (!passed_over.is_empty()).then_some(note)
    }

    /// Origin and steps from the rows.
    fn sform(&self) -> (DVec3, DMat3) {
        let row = |axis: usize, i: usize| self.real(280, 400, 4 * axis + i);
        let column = |i: usize| DVec3::new(row(0, i), row(1, i), row(2, i));
        (column(3), DMat3::from_cols(column(0), column(1), column(2)))
    }

    /// Origin and steps from the quaternion, whose first number follows from its length of 1.
    fn qform(&self) -> (DVec3, DMat3) {
        let [b, c, d, x, y, z] = [0, 1, 2, 3, 4, 5].map(|i| self.real(256, 352, i));
        let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
        let turn = DQuat::from_xyzw(b, c, d, a);
        let turn = DMat3::from_quat(turn.normalize());
        let [sign, dx, dy, dz] = [0, 1, 2, 3].map(|i| self.real(76, 104, i));
        let sign = if sign < 0.0 { -1.0 } else { 1.0 };
        let spacing = DVec3::new(dx, dy, sign * dz);
        (DVec3::new(x, y, z), turn * DMat3::from_diagonal(spacing))
    }
}

/// The error for an Analyze 7.5 image.
fn refuse_analyze(path: &Path) -> Error {
    let found = "an Analyze 7.5 header, which does not say which way round the image is";
    let expected = "a NIfTI header (`n+1`, `ni1`, `n+2` or `ni2`)";
    Error::format(path, "format", expected, found, Hint::GiveRawData)
}
