//! Decodes numbers whose bits in an HDF5 file differ from those in memory.
//!
//! A datatype message states the layout (HDF5 File Format Specification, IV.A.2.d). The HDF5 decoder uses only its size
//! and byte order. SWIFT's lossy compression shortens mantissas, and its n-bit filter then drops the unused bits:
//!
//! | SWIFT's name | exponent | mantissa | bytes after the filter |
//! |---|---|---|---|
//! | `FMantissa9`, `FMantissa13` | 8, bias 127 | 9, 13 | 4 |
//! | `HalfFloat` | 5, bias 15 | 10 | 4 |
//! | `BFloat16` | 8, bias 127 | 7 | 4 |
//! | `DMantissa9`, `DMantissa13`, `DMantissa21` | 11, bias 1023 | 9, 13, 21 | 8 |
//! | `Nbit36` ... `Nbit56` | integers of so many bits | | 8 |
//!
//! Such numbers are widened to the smallest IEEE type that represents each of them exactly.

use crate::io::bytes::scalars::{Encoding, ScalarType};
use crate::parallel;

/// Least number of values per thread.
const BATCH: usize = 4096;

/// Layout of the bits of a number, counted from the least significant one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// As in memory.
    Native(Encoding),
    /// Integer in some of the bits.
    Integer {
        size: usize,
        big_endian: bool,
        is_signed: bool,
        first: u32,
        count: u32,
    },
    /// Floating-point number with an implicit leading 1 in its mantissa.
    Float {
        size: usize,
        big_endian: bool,
        sign: u32,
        exponent: Bits,
        mantissa: Bits,
        bias: i32,
    },
}

/// Run of bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bits {
    first: u32,
    count: u32,
}

/// Reason why numbers are not read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NotRead {
    /// The type is no number, or has a size that numbers never have.
    NoNumbers,
    /// The layout is not supported; the text describes it.
    Layout(String),
}

impl Layout {
    /// Reads the layout from a datatype message.
    pub(super) fn of(message: &[u8]) -> Result<Self, NotRead> {
        let byte = |at: usize| message.get(at).copied().map(u32::from);
        let word = |at: usize| Some(byte(at)? | byte(at + 1)? << 8);
        let long = |at: usize| Some(word(at)? | word(at + 2)? << 16);
        let header = || Some((byte(0)? & 15, byte(1)?, byte(2)?, long(4)?));
        let (class, flags, sign, size) = header().ok_or(NotRead::NoNumbers)?;
        let Some(size @ (1 | 2 | 4 | 8)) = usize::try_from(size).ok() else {
            return Err(NotRead::NoNumbers);
        };
        match class {
            0 => {
                let bits = || Some((word(8)?, word(10)?));
                let (first, count) = bits().ok_or(NotRead::NoNumbers)?;
                Self::integer(size, flags, first, count)
            }
            1 => {
                let fields = || {
                    let exponent = Bits {
                        first: byte(12)?,
                        count: byte(13)?,
                    };
                    let mantissa = Bits {
                        first: byte(14)?,
                        count: byte(15)?,
                    };
                    Some((exponent, mantissa, long(16)?))
                };
                let (exponent, mantissa, bias) = fields().ok_or(NotRead::NoNumbers)?;
                Self::float(size, flags, sign, exponent, mantissa, bias)
            }
            _ => Err(NotRead::NoNumbers),
        }
    }

    fn integer(size: usize, flags: u32, first: u32, count: u32) -> Result<Self, NotRead> {
        let is_signed = flags & 8 != 0;
        let big_endian = flags & 1 != 0;
        if count == 0 || first + count > width(size) {
            return Err(NotRead::Layout(format!(
                "integers of bits {first} to {} in {size} bytes",
                first + count
            )));
        }
        if count < width(size) {
            return Ok(Self::Integer {
                size,
                big_endian,
                is_signed,
                first,
                count,
            });
        }
        let scalar = integers(size, is_signed);
        Ok(Self::Native(Encoding { scalar, big_endian }))
    }

    fn float(
        size: usize,
        flags: u32,
        sign: u32,
        exponent: Bits,
        mantissa: Bits,
        bias: u32,
    ) -> Result<Self, NotRead> {
        let not_read = |why: &str| {
            Err(NotRead::Layout(format!(
                "floats of {size} bytes with an exponent of {} and a mantissa of {} bits{why}",
                exponent.count, mantissa.count
            )))
        };
        if flags & 0x40 != 0 {
            return not_read(", in the byte order of a VAX");
        }
        if flags >> 4 & 3 != 2 {
            return not_read(", whose leading bit is not left out");
        }
        let end = |bits: Bits| bits.first + bits.count;
        let apart = end(exponent) <= mantissa.first || end(mantissa) <= exponent.first;
        let holds = |bits: Bits| (bits.first..end(bits)).contains(&sign);
        let is_whole = end(exponent) <= width(size)
            && end(mantissa) <= width(size)
            && sign < width(size)
            && exponent.count >= 2
            && mantissa.count >= 1;
        if !is_whole || !apart || holds(exponent) || holds(mantissa) {
            return not_read(", which overlap or do not fit");
        }
        let big_endian = flags & 1 != 0;
        let Some(bias) = i32::try_from(bias).ok().filter(|b| *b < 1 << 20) else {
            return not_read(&format!(", and a bias of {bias}"));
        };
        let ieee = |scalar, size: usize, exponent_count: u32, mantissa_count: u32| {
            let mantissa_bits = Bits {
                first: 0,
                count: mantissa_count,
            };
            let exponent_bits = Bits {
                first: mantissa_count,
                count: exponent_count,
            };
            let layout = Self::Float {
                size,
                big_endian,
                sign: width(size) - 1,
                exponent: exponent_bits,
                mantissa: mantissa_bits,
                bias: (1 << (exponent_count - 1)) - 1,
            };
            (layout, Self::Native(Encoding { scalar, big_endian }))
        };
        let layout = Self::Float {
            size,
            big_endian,
            sign,
            exponent,
            mantissa,
            bias,
        };
        for (stated, native) in [
            ieee(ScalarType::F32, 4, 8, 23),
            ieee(ScalarType::F64, 8, 11, 52),
        ] {
            if layout == stated {
                return Ok(native);
            }
        }
        if !fits(exponent, mantissa, bias, ScalarType::F64) {
            return not_read(&format!(" and a bias of {bias}, beyond double precision"));
        }
        Ok(layout)
    }

    /// Returns the type in which [`Self::widened`] returns numbers.
    pub(super) fn encoding(self) -> Encoding {
        let scalar = match self {
            Self::Native(encoding) => return encoding,
            Self::Integer {
                size, is_signed, ..
            } => integers(size, is_signed),
            Self::Float {
                exponent,
                mantissa,
                bias,
                ..
            } => {
                if fits(exponent, mantissa, bias, ScalarType::F32) {
                    ScalarType::F32
                } else {
                    ScalarType::F64
                }
            }
        };
        Encoding {
            scalar,
            big_endian: false,
        }
    }

    /// Returns the size in bytes of a number in the file, after filters are undone.
    pub(super) fn stored_size(self) -> usize {
        match self {
            Self::Native(encoding) => encoding.scalar.size(),
            Self::Integer { size, .. } | Self::Float { size, .. } => size,
        }
    }

    /// Converts numbers of this layout to their [encoding](Self::encoding).
    pub(super) fn widened(self, bytes: Vec<u8>) -> Vec<u8> {
        if let Self::Native(_) = self {
            return bytes;
        }
        match self.encoding().scalar.size() {
            1 => self.rewritten::<1>(&bytes),
            2 => self.rewritten::<2>(&bytes),
            4 => self.rewritten::<4>(&bytes),
            _ => self.rewritten::<8>(&bytes),
        }
    }

    fn rewritten<const N: usize>(self, bytes: &[u8]) -> Vec<u8> {
        let size = self.stored_size();
        let mut rewritten = vec![[0; N]; bytes.len() / size];
        parallel::chunks(&mut rewritten, BATCH, |i, batch| {
            let numbers = bytes[i * BATCH * size..].chunks_exact(size);
            for (low, number) in batch.iter_mut().zip(numbers) {
                low.copy_from_slice(&self.number(number).to_le_bytes()[..N]);
            }
        });
        rewritten.into_flattened()
    }

    /// Returns the bits of a number in its encoding, from the stored bytes.
    fn number(self, bytes: &[u8]) -> u64 {
        let word = |big_endian: bool| {
            let mut word = [0; 8];
            word[..bytes.len()].copy_from_slice(bytes);
            if big_endian {
                word[..bytes.len()].reverse();
            }
            u64::from_le_bytes(word)
        };
        match self {
            Self::Native(encoding) => word(encoding.big_endian),
            Self::Integer {
                big_endian,
                is_signed,
                first,
                count,
                ..
            } => {
                let bits = Bits { first, count }.of(word(big_endian));
                if is_signed && bits >> (count - 1) & 1 == 1 && count < u64::BITS {
                    bits | u64::MAX << count
                } else {
                    bits
                }
            }
            Self::Float {
                big_endian,
                sign,
                exponent,
                mantissa,
                bias,
                ..
            } => {
                let word = word(big_endian);
                let is_negative = word >> sign & 1 == 1;
                let (e, m) = (exponent.of(word), mantissa.of(word));
                let most = (1 << exponent.count) - 1;
                let magnitude = if e == most {
                    if m == 0 { f64::INFINITY } else { f64::NAN }
                } else {
                    // Subnormal numbers have no implicit leading 1.
                    let (m, e) = match e {
                        0 => (m, 1),
                        _ => (m | 1 << mantissa.count, e),
                    };
                    // `fits` ensures that both factors and their product are exact.
                    let e = i32::try_from(e).unwrap_or(i32::MAX);
                    let last_bit = e - bias - i32::try_from(mantissa.count).unwrap_or(0);
                    m as f64 * power_of_two(last_bit)
                };
                let value = if is_negative { -magnitude } else { magnitude };
                if self.encoding().scalar == ScalarType::F32 {
                    u64::from(crate::math::narrowed(value).to_bits())
                } else {
                    value.to_bits()
                }
            }
        }
    }
}

impl Bits {
    fn of(self, word: u64) -> u64 {
        let mask = u64::MAX >> (u64::BITS - self.count.clamp(1, u64::BITS));
        word >> self.first & mask
    }
}

/// Returns the number of bits in `size` bytes.
fn width(size: usize) -> u32 {
    8 * u32::try_from(size).unwrap_or(0)
}

fn integers(size: usize, is_signed: bool) -> ScalarType {
    use ScalarType as S;
    match (size, is_signed) {
        (1, true) => S::I8,
        (1, false) => S::U8,
        (2, true) => S::I16,
        (2, false) => S::U16,
        (4, true) => S::I32,
        (4, false) => S::U32,
        (_, true) => S::I64,
        (_, false) => S::U64,
    }
}

/// Returns true if an IEEE type represents every number of a layout exactly.
fn fits(exponent: Bits, mantissa: Bits, bias: i32, scalar: ScalarType) -> bool {
    let (least, greatest, digits) = match scalar {
        ScalarType::F32 => (-126, 127, 23),
        _ => (-1022, 1023, 52),
    };
    exponent.count <= 11
        && mantissa.count <= digits
        && 1 - bias >= least
        && (1 << exponent.count) - 2 - bias <= greatest
}

/// Returns 2ⁿ for n from -1074, the least exponent of double precision, to 1023.
fn power_of_two(n: i32) -> f64 {
    let bits = |shift: i32| u64::from(shift.unsigned_abs());
    f64::from_bits(if n >= -1022 {
        bits(n + 1023) << 52
    } else {
        1 << bits(n + 1074).min(51)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the message of a float: sign, exponent and mantissa, from the top bit down to bit `first`.
    fn message(size: u8, first: u8, exponent: u8, mantissa: u8, bias: u32) -> Vec<u8> {
        let sign = first + exponent + mantissa;
        let mut message = vec![0x11, 0x20, sign, 0, size, 0, 0, 0];
        message.extend([first, 0, 1 + exponent + mantissa, 0]);
        message.extend([first + mantissa, exponent, first, mantissa]);
        message.extend(bias.to_le_bytes());
        message
    }

    fn decoded(message: &[u8], bytes: &[u8]) -> f64 {
        let layout = Layout::of(message).unwrap();
        crate::io::bytes::scalars::double(&layout.widened(bytes.to_vec()), layout.encoding())
    }

    /// Compares every half with the formula of IEEE 754, and the published table of corner cases.
    #[test]
    fn halves_are_exact_and_so_are_shortened_doubles() {
        let half = message(2, 0, 5, 10, 15);
        for (bits, value) in [
            (0x0001_u16, 2.0_f64.powi(-24)),
            (0x03ff, 2.0_f64.powi(-14) * (1023.0 / 1024.0)),
            (0x0400, 2.0_f64.powi(-14)),
            (0x3555, 0.333_251_953_125),
            (0x7bff, 65504.0),
            (0xc000, -2.0),
            (0x7c00, f64::INFINITY),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            assert_eq!(decoded(&half, &bits.to_le_bytes()), value, "{bits:x}");
        }
        assert!(decoded(&half, &0x7c01_u16.to_le_bytes()).is_nan());
        assert!(decoded(&half, &0x8000_u16.to_le_bytes()).is_sign_negative());
        // The same for the upper bits of doubles, including subnormal ones.
        for mantissa in [9_u8, 13, 21, 48] {
            let shortened = message(8, 3, 11, mantissa, 1023);
            for x in [1.5, -2.0_f64.powi(-1030), 1e300, f64::MIN_POSITIVE, 0.1] {
                let kept = x.to_bits() >> (52 - mantissa);
                let value = f64::from_bits(kept << (52 - mantissa));
                // Bits outside the layout are ignored: here the lowest three.
                let stored = (kept << 3 | 5).to_le_bytes();
                assert_eq!(decoded(&shortened, &stored), value, "{x} {mantissa}");
            }
        }
        // The same for shortened floats, which are read as floats.
        let shortened = message(4, 0, 8, 9, 127);
        for kept in 0..1_u32 << 18 {
            let value = f32::from_bits(kept << 14);
            let layout = Layout::of(&shortened).unwrap();
            let bytes = layout.widened(kept.to_le_bytes().to_vec());
            let read = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            assert!(read.to_bits() == value.to_bits() || (read.is_nan() && value.is_nan()));
        }
    }

    #[test]
    fn what_is_ieee_already_is_left_as_it_is() {
        for (message, scalar) in [
            (message(4, 0, 8, 23, 127), ScalarType::F32),
            (message(8, 0, 11, 52, 1023), ScalarType::F64),
        ] {
            let encoding = Encoding {
                scalar,
                big_endian: false,
            };
            assert_eq!(Layout::of(&message), Ok(Layout::Native(encoding)));
        }
    }

    #[test]
    fn layouts_that_are_not_understood_are_refused() {
        let good = message(4, 0, 8, 9, 127);
        let with = |at: usize, byte: u8| {
            let mut bad = good.clone();
            bad[at] = byte;
            Layout::of(&bad)
        };
        let is_refused = |layout| matches!(layout, Err(NotRead::Layout(_)));
        assert!(is_refused(with(1, 0x61)), "a VAX");
        assert!(is_refused(with(1, 0x00)), "no implied bit");
        assert!(is_refused(with(2, 32)), "a sign outside");
        assert!(is_refused(with(2, 4)), "a sign in the mantissa");
        assert!(is_refused(with(12, 8)), "fields that overlap");
        assert!(is_refused(with(13, 24)), "an exponent beyond the bytes");
        assert!(is_refused(with(15, 0)), "no mantissa");
        assert!(is_refused(with(17, 9)), "a bias beyond double precision");
        assert_eq!(with(4, 3), Err(NotRead::NoNumbers));
        for len in 0..good.len() {
            assert_eq!(Layout::of(&good[..len]), Err(NotRead::NoNumbers));
        }
    }

    #[test]
    fn integers_of_odd_widths_keep_their_sign() {
        let message = |flags: u8, first: u8, count: u8| {
            vec![0x10, flags, 0, 0, 8, 0, 0, 0, first, 0, count, 0]
        };
        let stored = (0xff_u64 << 48 | (1 << 43) | 7 << 4).to_le_bytes();
        assert_eq!(
            decoded(&message(8, 4, 40), &stored),
            f64::from(7) - 2.0_f64.powi(39)
        );
        assert_eq!(
            decoded(&message(0, 4, 40), &stored),
            f64::from(7) + 2.0_f64.powi(39)
        );
        assert!(matches!(
            Layout::of(&message(8, 30, 40)),
            Err(NotRead::Layout(_))
        ));
        assert!(matches!(
            Layout::of(&message(8, 0, 0)),
            Err(NotRead::Layout(_))
        ));
    }
}
