//! Decodes the pixels of a file to numbers, frame by frame.

use std::borrow::Cow;

use super::data_set::{DAMAGED, DataSet, Element, Value};
use super::packed::{self, Reason, jpeg, runs};
use super::syntax::{Packing, Syntax};
use super::tags;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::scene::Values;

/// Reason why pixels are not read.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) expected: String,
    pub(super) found: String,
    pub(super) advice: &'static str,
}

impl From<(&str, String)> for Fault {
    fn from((expected, found): (&str, String)) -> Self {
        Self {
            expected: expected.to_owned(),
            found,
            advice: DAMAGED,
        }
    }
}

/// Meaning of a pixel's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Colours {
    /// One number.
    Grey,
    Rgb,
    /// Luma and two colour differences.
    Ybr,
    /// As `Ybr`, but two neighbouring pixels share one pair of differences.
    YbrHalved,
}

/// Layout of the pixels of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    /// Columns and rows.
    pub(super) size: [usize; 2],
    pub(super) frames: usize,
    /// Bits of a sample, including unused ones.
    allocated: u16,
    /// Lowest bit of a number in its sample, and number of bits.
    low: u16,
    stored: u16,
    signed: bool,
    is_float: bool,
    colours: Colours,
    /// True if the samples are stored as planes, one component after another.
    is_planar: bool,
    packing: Packing,
    /// True if words are big-endian.
    big_endian: bool,
}

/// Frames in order; each has a list of numbers for every component.
pub(super) type Frames = Vec<Vec<Values>>;

impl Layout {
    /// Reads the layout of the pixels from a data set.
    ///
    /// # Errors
    /// An element is missing, or states something that is not supported.
    pub(super) fn of(set: &DataSet<'_>, syntax: Syntax) -> Result<Self, Fault> {
        let required = |tag, name: &str| {
            let none = || ("this element", format!("no `{name}`"));
            set.short(tag).ok_or_else(|| Fault::from(none()))
        };
        let size = [
            usize::from(required(tags::COLUMNS, "Columns")?),
            usize::from(required(tags::ROWS, "Rows")?),
        ];
        let frames = match set.text(tags::FRAME_COUNT) {
            None => 1,
            // Some files with one frame state 0.
            Some(text) => {
                let fault = |_| ("a count as `NumberOfFrames`", format!("`{text}`"));
                text.parse::<usize>().map_err(fault)?.max(1)
            }
        };
        let is_float = set.get(tags::PIXEL_DATA).is_none();
        let allocated = match set.get(tags::DOUBLE_PIXEL_DATA) {
            Some(_) if is_float => 64,
            _ if is_float => 32,
            _ => required(tags::BITS_ALLOCATED, "BitsAllocated")?,
        };
        let stored = set.short(tags::BITS_STORED).unwrap_or(allocated);
        let high = set.short(tags::HIGH_BIT).filter(|_| !is_float);
        let stored = if is_float { allocated } else { stored };
        let above = |high: u16| high.checked_add(1)?.checked_sub(stored);
        let low = high.map_or(Some(0), above);
        let is_sound = size.iter().all(|n| *n > 0)
            && (is_float || matches!(allocated, 1 | 8 | 16 | 32))
            && (1..=allocated).contains(&stored);
        let low = low.filter(|low| is_sound && low + stored <= allocated);
        let Some(low) = low else {
            let expected = "pixels of 1, 8, 16 or 32 bits, of which some are a number";
            let [columns, rows] = size;
            let found = format!(
                "{columns} x {rows} pixels of {stored} bits in {allocated}, the highest {}",
                high.unwrap_or(0)
            );
            return Err((expected, found).into());
        };
        let samples = set.short(tags::SAMPLES_PER_PIXEL).unwrap_or(1);
        let photometric = set.text(tags::PHOTOMETRIC).unwrap_or("MONOCHROME2");
        let colours = match (photometric, samples) {
            ("MONOCHROME1" | "MONOCHROME2" | "PALETTE COLOR", 1) => Colours::Grey,
            ("RGB", 3) => Colours::Rgb,
            ("YBR_FULL", 3) => Colours::Ybr,
            ("YBR_FULL_422", 3) if syntax.packing == Packing::None => Colours::YbrHalved,
            ("YBR_FULL_422", 3) => Colours::Ybr,
            _ => {
                let expected = "grey pixels, RGB, YBR_FULL or YBR_FULL_422";
                let found = format!("{photometric} of {samples} samples");
                return Err((expected, found).into());
            }
        };
        let is_grey = colours == Colours::Grey;
        if !is_grey && (is_float || allocated < 8 || colours != Colours::Rgb && allocated != 8) {
            let expected = "colours of whole bytes";
            return Err((expected, format!("{allocated} bits")).into());
        }
        if allocated == 1 && syntax.packing != Packing::None {
            let expected = "bits that are not packed";
            return Err((expected, "packed ones".to_owned()).into());
        }
        Ok(Self {
            size,
            frames,
            allocated,
            low,
            stored,
            signed: set.short(tags::PIXEL_REPRESENTATION) == Some(1),
            is_float,
            colours,
            is_planar: set.short(tags::PLANAR) == Some(1) && !is_grey,
            packing: syntax.packing,
            big_endian: syntax.coding.big_endian,
        })
    }

    /// Returns the number of pixels of a frame.
    fn pixels(&self) -> usize {
        self.size[0].saturating_mul(self.size[1])
    }

    pub(super) fn components(&self) -> usize {
        if self.colours == Colours::Grey { 1 } else { 3 }
    }

    pub(super) fn is_float(&self) -> bool {
        self.is_float
    }

    /// Interprets a 16-bit padding value with the sign of the pixels.
    pub(super) fn padding_of(&self, word: u16) -> f64 {
        match self.signed {
            true => f64::from(word.cast_signed()),
            false => f64::from(word),
        }
    }

    /// Returns the size in bytes of all numbers in memory.
    pub(super) fn bytes_read(&self, is_scaled: bool) -> usize {
        let each = match self.allocated {
            _ if is_scaled => 4,
            0..=8 if self.signed => 2,
            0..=8 => 1,
            9..=16 => 2,
            _ => 4,
        };
        let all = [self.components(), self.frames, each];
        let product = |n: usize, m: usize| n.saturating_mul(m);
        all.into_iter().fold(self.pixels(), product)
    }

    /// Returns the number of bits of a frame that is not packed.
    fn frame_bits(&self) -> usize {
        let samples = match self.colours {
            Colours::YbrHalved => 2,
            _ => self.components(),
        };
        let bits = samples * usize::from(self.allocated);
        self.pixels().saturating_mul(bits)
    }

    /// Reads the numbers of all frames.
    ///
    /// # Errors
    /// There are fewer bytes than the pixels need, or packed ones cannot be unpacked.
    pub(super) fn read(&self, element: &Element<'_>) -> Result<Frames, Fault> {
        match &element.value {
            Value::Bytes(bytes) => self.read_plain(bytes, element.vr == *b"OW"),
            Value::Fragments(fragments) => self.read_packed(fragments),
            Value::Items(_) => Err(("pixels", "a sequence".to_owned()).into()),
        }
    }

    fn read_plain(&self, bytes: &[u8], is_words: bool) -> Result<Frames, Fault> {
        let bits = self.frame_bits().saturating_mul(self.frames);
        if self.packing != Packing::None || bytes.len() < bits.div_ceil(8) {
            let expected = match self.packing {
                Packing::None => format!("{} bytes of pixels", bits.div_ceil(8)),
                _ => "packed pixels in parts".to_owned(),
            };
            let found = format!("{} bytes", bytes.len());
            return Err((expected.as_str(), found).into());
        }
        // In big-endian files, pairs of bytes stored as words are swapped.
        let bytes = match self.big_endian && self.allocated <= 8 && is_words {
            true => Cow::Owned(swapped(bytes)),
            false => Cow::Borrowed(bytes),
        };
        if self.allocated == 1 {
            return Ok(self.of_bits(&bytes));
        }
        let frames = bytes.chunks(self.frame_bits() / 8).take(self.frames);
        let frames: Option<Frames> = frames.map(|frame| self.frame(frame)).collect();
        let found = || format!("{} bytes", bytes.len());
        frames.ok_or_else(|| ("an even number of columns", found()).into())
    }

    /// Reads one bit for each pixel, the lowest bit of a byte first, without gaps between frames.
    fn of_bits(&self, bytes: &[u8]) -> Frames {
        let frame = |n: usize| {
            let places = n * self.pixels()..(n + 1) * self.pixels();
            let bits = places.map(|i| bytes[i / 8] >> (i % 8) & 1);
            vec![Values::U8(bits.collect())]
        };
        (0..self.frames).map(frame).collect()
    }

    fn read_packed(&self, fragments: &[&[u8]]) -> Result<Frames, Fault> {
        let frames = self.packed_frames(fragments)?;
        let numbered = frames.iter().enumerate();
        numbered
            .map(|(i, frame)| {
                self.unpacked(frame).map_err(|reason| Fault {
                    expected: "packed pixels of so many rows and columns".to_owned(),
                    found: format!("frame {}, which {}", i + 1, reason.text),
                    advice: reason.advice,
                })
            })
            .collect()
    }

    /// Returns the packed bytes of each frame: one fragment, all of them, or those from one offset to the next.
    fn packed_frames<'f>(&self, fragments: &[&'f [u8]]) -> Result<Vec<Cow<'f, [u8]>>, Fault> {
        let (offsets, fragments) = match fragments {
            [offsets, fragments @ ..] => (*offsets, fragments),
            [] => (&[][..], fragments),
        };
        if fragments.len() == self.frames {
            return Ok(fragments.iter().map(|part| Cow::Borrowed(*part)).collect());
        }
        if self.frames == 1 && !fragments.is_empty() {
            return Ok(vec![Cow::Owned(fragments.concat())]);
        }
        // Offsets include the eight bytes before each fragment.
        let offsets = offsets.chunks_exact(4).map(|word| {
            let word = word.try_into().unwrap_or_default();
            u32::from_le_bytes(word) as usize
        });
        let offsets: Vec<usize> = offsets.collect();
        let mut frames: Vec<Vec<u8>> = Vec::new();
        let mut at = 0;
        for fragment in fragments {
            if offsets.get(frames.len()) == Some(&at) {
                frames.push(Vec::new());
            }
            if let Some(frame) = frames.last_mut() {
                frame.extend_from_slice(fragment);
            }
            at += 8 + fragment.len();
        }
        if frames.len() != self.frames || offsets.len() != self.frames {
            let expected = format!("packed pixels of {} frames", self.frames);
            let found = format!("{} parts", fragments.len());
            return Err((expected.as_str(), found).into());
        }
        Ok(frames.into_iter().map(Cow::Owned).collect())
    }

    fn unpacked(&self, frame: &[u8]) -> Result<Vec<Values>, Reason> {
        let [width, height] = self.size;
        let samples = self.components();
        let short = || Reason::damaged("is too short");
        match self.packing {
            Packing::None => {
                let whole = frame.get(..self.frame_bits() / 8);
                whole.and_then(|frame| self.frame(frame)).ok_or_else(short)
            }
            Packing::Runs => {
                let bytes = usize::from(self.allocated / 8);
                let planes = runs(frame, samples * bytes, self.pixels())?;
                let plain = Self {
                    is_planar: true,
                    big_endian: false,
                    ..*self
                };
                plain.frame(&of_planes(&planes, bytes)).ok_or_else(short)
            }
            Packing::Jpeg => {
                let is_rgb = self.colours == Colours::Rgb;
                let packed::Unpacked { bytes, bits } =
                    jpeg(frame, [width, height], samples, is_rgb)?;
                let colours = if samples == 3 {
                    Colours::Rgb
                } else {
                    self.colours
                };
                if self.low + self.stored > bits && self.stored > bits {
                    let text = format!("is JPEG of {bits} bits, not of {}", self.stored);
                    return Err(Reason::damaged(text));
                }
                let plain = Self {
                    allocated: bits,
                    low: if self.low + self.stored > bits {
                        0
                    } else {
                        self.low
                    },
                    is_planar: false,
                    big_endian: cfg!(target_endian = "big") && bits > 8,
                    colours,
                    ..*self
                };
                plain.frame(&bytes).ok_or_else(short)
            }
        }
    }

    /// Reads the numbers of an unpacked frame of whole bytes; returns `None` if there are too few bytes.
    fn frame(&self, bytes: &[u8]) -> Option<Vec<Values>> {
        let halved;
        let bytes = if self.colours == Colours::YbrHalved {
            halved = doubled(bytes);
            &halved[..]
        } else {
            bytes
        };
        let samples = self.components();
        let size = usize::from(self.allocated / 8);
        let count = self.pixels();
        let component = |i: usize| {
            let stride = match self.is_planar && self.colours != Colours::YbrHalved {
                true => Stride {
                    first: i * count * size,
                    step: size,
                    count,
                },
                false => Stride {
                    first: i * size,
                    step: samples * size,
                    count,
                },
            };
            let whole = values(bytes, self.encoding(), stride)?;
            let is_whole = self.is_float || self.stored == self.allocated;
            Some(match (is_whole, self.allocated) {
                (true, _) => whole,
                (false, 32) => self.of_wide(bytes, stride),
                _ => self.of_bits_stored(whole),
            })
        };
        let components = (0..samples)
            .map(component)
            .collect::<Option<Vec<Values>>>()?;
        Some(match self.colours {
            Colours::Ybr | Colours::YbrHalved => to_rgb(components),
            _ => components,
        })
    }

    fn encoding(&self) -> Encoding {
        use ScalarType as S;
        // Unused bits must be removed before the sign is read, so such words are read as unsigned.
        let signed = self.signed && self.stored == self.allocated;
        let scalar = match (self.allocated, self.is_float, signed) {
            (32, true, _) => S::F32,
            (_, true, _) => S::F64,
            (8, _, false) => S::U8,
            (8, _, true) => S::I8,
            (16, _, false) => S::U16,
            (16, _, true) => S::I16,
            (_, _, false) => S::U32,
            (_, _, true) => S::I32,
        };
        Encoding {
            scalar,
            big_endian: self.big_endian,
        }
    }

    /// Extracts numbers as [`Layout::of_bits_stored`] does, from 32-bit words within `bytes`.
    fn of_wide(&self, bytes: &[u8], stride: Stride) -> Values {
        let unused = 32 - self.stored;
        let number = |at: usize| {
            let word = <[u8; 4]>::try_from(&bytes[at..at + 4]).unwrap_or_default();
            let word = match self.big_endian {
                true => u32::from_be_bytes(word),
                false => u32::from_le_bytes(word),
            };
            // The number is shifted to the top, so that the shift back down extends its sign.
            let bits = word >> self.low << unused;
            match self.signed {
                true => (bits.cast_signed() >> unused) as f32,
                false => (bits >> unused) as f32,
            }
        };
        let places = (0..stride.count).map(|i| stride.first + i * stride.step);
        Values::F32(places.map(number).collect())
    }

    /// Extracts the used bits of each number, with their sign.
    fn of_bits_stored(&self, words: Values) -> Values {
        let ones = u16::MAX >> 16_u16.saturating_sub(self.stored);
        let sign = 1 << (self.stored.min(16) - 1);
        let number = |word: u16| {
            let bits = word >> self.low & ones;
            match self.signed && bits & sign != 0 {
                true => bits | !ones,
                false => bits,
            }
        };
        match words {
            Values::U8(words) if self.signed => {
                let numbers = words.into_iter().map(|w| number(w.into()).cast_signed());
                Values::I16(numbers.collect())
            }
            Values::U8(words) => Values::U8(
                words
                    .into_iter()
                    .map(|w| u8::try_from(number(w.into())).unwrap_or(u8::MAX))
                    .collect(),
            ),
            Values::U16(words) if self.signed => {
                Values::I16(words.into_iter().map(|w| number(w).cast_signed()).collect())
            }
            Values::U16(words) => Values::U16(words.into_iter().map(number).collect()),
            other => other,
        }
    }
}

/// Swaps the bytes of each pair.
fn swapped(bytes: &[u8]) -> Vec<u8> {
    let mut swapped = bytes.to_vec();
    swapped.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    swapped
}

/// Interleaves planes of bytes, the highest byte of each sample first, into little-endian samples.
fn of_planes(planes: &[Vec<u8>], bytes: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(planes.iter().map(Vec::len).sum());
    for sample in planes.chunks(bytes.max(1)) {
        let count = sample.first().map_or(0, Vec::len);
        for i in 0..count {
            out.extend(sample.iter().rev().map(|plane| plane[i]));
        }
    }
    out
}

/// Expands two luma samples with shared colour differences to two pixels of three samples.
fn doubled(bytes: &[u8]) -> Vec<u8> {
    let pixels = bytes.chunks_exact(4);
    pixels
        .flat_map(|four| [four[0], four[2], four[3], four[1], four[2], four[3]])
        .collect()
}

/// Converts luma and colour differences to RGB (PS3.3, C.7.6.3.1.2).
fn to_rgb(components: Vec<Values>) -> Vec<Values> {
    let [Values::U8(y), Values::U8(b), Values::U8(r)] = &components[..] else {
        return components;
    };
    let colour = |of: [f32; 2]| {
        let numbers = y.iter().zip(b).zip(r).map(|((y, b), r)| {
            let [b, r] = [b, r].map(|x| f32::from(*x) - 128.0);
            let sum = f32::from(*y) + of[0] * b + of[1] * r;
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "casts saturate"
            )]
            {
                sum.round() as u8
            }
        });
        Values::U8(numbers.collect())
    };
    let factors = [[0.0, 1.402], [-0.344_136, -0.714_136], [1.772, 0.0]];
    factors.into_iter().map(colour).collect()
}
