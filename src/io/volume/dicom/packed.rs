//! Unpacks pixels frame by frame: run lengths and JPEG.
//!
//! Run lengths (PS3.5, annex G) begin with 64 bytes: a count and 15 offsets. As many segments follow, one for each byte
//! of each sample of a pixel, the highest byte first. In a segment, a byte n below 128 precedes n + 1 literal bytes. A
//! byte n above 128 precedes a byte that is repeated 257 - n times.
//!
//! The JPEG decoder allocates memory for the sizes in a stream's header and leaves some of them unchecked. So
//! [`check_jpeg`] reads the header first.

use std::io::Cursor;

use jpeg_decoder::{ColorTransform, Decoder, PixelFormat};

use super::data_set::DAMAGED;
use super::syntax::UNPACK;

/// Greatest number of bytes that one byte of run lengths represents.
pub(super) const RUN_RATIO: usize = 64;

/// Greatest number of samples per byte of JPEG: one bit for each block of 64, or for each sample if lossless.
const JPEG_RATIO: usize = 8 * 64;
const LOSSLESS_RATIO: usize = 8;

/// Length in bytes of the header of run lengths.
const RUN_HEADER: usize = 64;

/// Reason why a frame is not unpacked.
#[derive(Debug)]
pub(super) struct Reason {
    /// End of a sentence about the frame.
    pub(super) text: String,
    pub(super) advice: &'static str,
}

impl Reason {
    pub(super) fn damaged(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            advice: DAMAGED,
        }
    }

    fn unread(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            advice: UNPACK,
        }
    }
}

/// Unpacks run lengths to planes of `size` bytes each, one for every byte of a pixel, in the order of the file.
///
/// # Errors
/// The reason why the frame cannot be unpacked.
pub(super) fn runs(packed: &[u8], plane_count: usize, size: usize) -> Result<Vec<Vec<u8>>, Reason> {
    let word = |i: usize| {
        let bytes = packed.get(4 * i..4 * i + 4)?.try_into().ok()?;
        usize::try_from(u32::from_le_bytes(bytes)).ok()
    };
    if packed.len() < RUN_HEADER || word(0) != Some(plane_count) {
        let found = word(0).unwrap_or(0);
        let text = format!("has {found} segments, not {plane_count}");
        return Err(Reason::damaged(text));
    }
    if size > packed.len().saturating_mul(RUN_RATIO) {
        return Err(Reason::damaged(
            "is shorter than run lengths of so many pixels",
        ));
    }
    let segment = |i: usize| {
        let start = word(1 + i)?;
        let end = if i + 1 < plane_count {
            word(2 + i)?
        } else {
            packed.len()
        };
        unpack_runs(packed.get(start..end)?, size)
    };
    let too_short = |i| Reason::damaged(format!("has a segment {} that is too short", i + 1));
    (0..plane_count)
        .map(|i| segment(i).ok_or_else(|| too_short(i)))
        .collect()
}

fn unpack_runs(mut packed: &[u8], size: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(size);
    while out.len() < size {
        let (&code, rest) = packed.split_first()?;
        let left = size - out.len();
        let code = usize::from(code);
        packed = match code {
            128 => rest,
            0..128 => {
                let (bytes, rest) = rest.split_at_checked(code + 1)?;
                out.extend_from_slice(&bytes[..bytes.len().min(left)]);
                rest
            }
            _ => {
                let (&byte, rest) = rest.split_first()?;
                out.resize(out.len() + (257 - code).min(left), byte);
                rest
            }
        };
    }
    Some(out)
}

/// Result of unpacking a JPEG frame.
pub(super) struct Unpacked {
    /// Samples, interleaved by pixel. Samples of 16 bits are in the byte order of this machine.
    pub(super) bytes: Vec<u8>,
    /// 8 or 16.
    pub(super) bits: u16,
}

/// Unpacks JPEG: lossy with 8 bits, lossless with up to 16.
///
/// - `is_rgb`: true if colours are stored as red, green and blue.
///
/// # Errors
/// The errors of [`runs`].
pub(super) fn jpeg(
    packed: &[u8],
    [width, height]: [usize; 2],
    samples: usize,
    is_rgb: bool,
) -> Result<Unpacked, Reason> {
    check_jpeg(packed, [width, height], samples)?;
    let mut decoder = Decoder::new(Cursor::new(packed));
    if samples == 3 {
        decoder.set_color_transform(match is_rgb {
            true => ColorTransform::RGB,
            false => ColorTransform::YCbCr,
        });
    }
    decoder.set_max_decoding_buffer_size(width * height * samples * 2);
    let bytes = decoder.decode().map_err(|e| match e {
        jpeg_decoder::Error::Unsupported(feature) => {
            Reason::unread(format!("is JPEG of a kind that is not read ({feature:?})"))
        }
        other => Reason::damaged(format!("is JPEG that cannot be unpacked ({other})")),
    })?;
    let bits = match decoder.info().map(|info| info.pixel_format) {
        Some(PixelFormat::L16) => 16,
        _ => 8,
    };
    if bytes.len() != width * height * samples * usize::from(bits / 8) {
        return Err(Reason::damaged("is JPEG of another size than the image"));
    }
    Ok(Unpacked { bytes, bits })
}

/// Compares the header of a JPEG stream with the size of the image and with the length of the stream.
fn check_jpeg(packed: &[u8], [width, height]: [usize; 2], samples: usize) -> Result<(), Reason> {
    let damaged = || Reason::damaged("is no sound JPEG stream");
    let be = |at: usize| -> Option<usize> {
        let bytes = packed.get(at..at + 2)?.try_into().ok()?;
        Some(usize::from(u16::from_be_bytes(bytes)))
    };
    if !packed.starts_with(b"\xff\xd8") {
        return Err(damaged());
    }
    let mut at = 2;
    let mut lossless_precision = None;
    let mut has_frame = false;
    // The search goes on behind the first scan, because headers of other scans may stand between them.
    while let Some(next) = packed.get(at..).and_then(|rest| {
        let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff | 0xd0..=0xd7);
        rest.windows(2).position(is_marker)
    }) {
        at += next;
        let marker = packed[at + 1];
        if marker == 0xd9 {
            break;
        }
        let len = be(at + 2).filter(|len| *len >= 2).ok_or_else(damaged)?;
        let segment = packed.get(at + 4..at + 2 + len).ok_or_else(damaged)?;
        match marker {
            // Frames with Huffman codes and no differential coding.
            0xc0..=0xc3 => {
                let size = [be(at + 7), be(at + 5)];
                let found = segment.get(5).copied().map(usize::from);
                if has_frame || size != [Some(width), Some(height)] || found != Some(samples) {
                    return Err(Reason::damaged("is JPEG of another size than the image"));
                }
                has_frame = true;
                let ratio = if marker == 0xc3 {
                    // Every component has one block at each place.
                    let factors = segment.get(6..).unwrap_or_default().chunks_exact(3);
                    let is_plain = factors.len() == samples
                        && factors.clone().all(|component| component[1] == 0x11);
                    lossless_precision = Some(segment[0]).filter(|bits| (2..=16).contains(bits));
                    if lossless_precision.is_none() || !is_plain {
                        return Err(Reason::unread(
                            "is lossless JPEG of a kind that is not read",
                        ));
                    }
                    LOSSLESS_RATIO
                } else {
                    JPEG_RATIO
                };
                if width * height * samples > packed.len().saturating_mul(ratio) {
                    return Err(Reason::damaged("is shorter than JPEG of so many pixels"));
                }
            }
            0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                return Err(Reason::unread("is JPEG of a kind that is not read"));
            }
            // A scan ends with its predictor, then the number of bits left out.
            0xda => {
                let last = segment.len().checked_sub(3).map(|at| &segment[at..]);
                let is_sound = match (lossless_precision, last) {
                    (None, last) => last.is_some(),
                    (Some(bits), Some(&[predictor, _, shift])) => {
                        segment[0] as usize == samples
                            && (1..=7).contains(&predictor)
                            && shift & 0xf < bits
                    }
                    (Some(_), _) => false,
                };
                if !has_frame || !is_sound {
                    return Err(damaged());
                }
            }
            _ => {}
        }
        at += 2 + len;
    }
    has_frame.then_some(()).ok_or_else(damaged)
}
