//! Converts numbers of files, in eleven scalar types and two byte orders, to [`Values`].

use glam::DVec3;

use super::half::half;
use crate::math::narrowed;
use crate::parallel;
use crate::scene::Values;

/// Number of numbers that a thread converts at a time.
const BATCH: usize = 1 << 16;

/// Number of positions or integers converted at a time: they stay in the first-level cache.
const POSITIONS: usize = 512;

/// The scalar types of binary files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    /// IEEE 754 half floats.
    F16,
    F32,
    F64,
}

impl ScalarType {
    /// Bytes per number.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

/// A scalar type in a byte order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Encoding {
    pub(crate) scalar: ScalarType,
    pub(crate) big_endian: bool,
}

/// The layout of one component's numbers in a block of bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stride {
    /// Offset of the first number.
    pub(crate) first: usize,
    /// Bytes from one number to the next.
    pub(crate) step: usize,
    /// Number of numbers.
    pub(crate) count: usize,
}

impl Stride {
    /// Whether all numbers, of `size` bytes each, lie within `len` bytes.
    fn fits(self, size: usize, len: usize) -> bool {
        self.count == 0
            || (self.count - 1)
                .checked_mul(self.step)
                .and_then(|n| n.checked_add(self.first))
                .and_then(|n| n.checked_add(size))
                .is_some_and(|end| end <= len)
    }
}

/// The numbers of one component, each made by `from_le` from its bytes; `None` if they do not lie within
/// `bytes`.
fn gather<const N: usize, T: Copy + Default + Send>(
    bytes: &[u8],
    stride: Stride,
    big_endian: bool,
    from_le: impl Fn([u8; N]) -> T + Sync,
) -> Option<Vec<T>> {
    if !stride.fits(N, bytes.len()) {
        return None;
    }
    let mut all = vec![T::default(); stride.count];
    if stride.count <= BATCH {
        fill(
            &mut all,
            bytes,
            stride.first,
            stride.step,
            big_endian,
            from_le,
        );
        return Some(all);
    }
    parallel::chunks(&mut all, BATCH, |i, batch| {
        let first = stride.first + i * BATCH * stride.step;
        fill(batch, bytes, first, stride.step, big_endian, &from_le);
    });
    Some(all)
}

/// Reads a number every `step` bytes, from byte `first` on. The caller has checked that they lie within
/// `bytes`; others would be left unchanged.
fn fill<const N: usize, T>(
    out: &mut [T],
    bytes: &[u8],
    first: usize,
    step: usize,
    big_endian: bool,
    from_le: impl Fn([u8; N]) -> T,
) {
    let from = |mut number: [u8; N]| {
        if big_endian {
            number.reverse();
        }
        from_le(number)
    };
    let bytes = bytes.get(first..).unwrap_or_default();
    // Adjacent numbers are a loop over arrays, which compilers vectorise.
    if step == N {
        let (numbers, _) = bytes.as_chunks::<N>();
        for (out, number) in out.iter_mut().zip(numbers) {
            *out = from(*number);
        }
        return;
    }
    for (i, out) in out.iter_mut().enumerate() {
        let number = bytes.get(i * step..).and_then(<[u8]>::first_chunk);
        if let Some(number) = number {
            *out = from(*number);
        }
    }
}

/// The numbers of one component. 8-bit and 16-bit integers stay integers (`i8` as `i16`). All other types
/// become `f32` if it can represent all numbers, else `f64`. `None` if the numbers do not lie within `bytes`.
pub(crate) fn values(bytes: &[u8], encoding: Encoding, stride: Stride) -> Option<Values> {
    use ScalarType as S;
    let big = encoding.big_endian;
    Some(match encoding.scalar {
        S::U8 => Values::U8(gather(bytes, stride, big, |[b]: [u8; 1]| b)?),
        S::I8 => Values::I16(gather(bytes, stride, big, |b| {
            i16::from(i8::from_le_bytes(b))
        })?),
        S::I16 => Values::I16(gather(bytes, stride, big, i16::from_le_bytes)?),
        S::U16 => Values::U16(gather(bytes, stride, big, u16::from_le_bytes)?),
        S::F16 => Values::F32(gather(bytes, stride, big, |b| {
            narrowed(half(u16::from_le_bytes(b)))
        })?),
        S::F32 => Values::F32(gather(bytes, stride, big, f32::from_le_bytes)?),
        S::I32 | S::U32 | S::I64 | S::U64 | S::F64 => doubles(bytes, encoding, stride)?.into(),
    })
}

/// The numbers of one component in double precision, for positions.
pub(crate) fn doubles(bytes: &[u8], encoding: Encoding, stride: Stride) -> Option<Vec<f64>> {
    if !stride.fits(encoding.scalar.size(), bytes.len()) {
        return None;
    }
    let mut all = vec![0.0; stride.count];
    parallel::chunks(&mut all, BATCH, |i, batch| {
        let first = stride.first + i * BATCH * stride.step;
        fill_doubles(batch, bytes, encoding, first, stride.step);
    });
    Some(all)
}

/// As [`fill`], in double precision.
fn fill_doubles(out: &mut [f64], bytes: &[u8], encoding: Encoding, first: usize, step: usize) {
    use ScalarType as S;
    let big = encoding.big_endian;
    macro_rules! each {
        ($from:expr) => {
            fill(out, bytes, first, step, big, $from)
        };
    }
    match encoding.scalar {
        S::U8 => each!(|[b]: [u8; 1]| f64::from(b)),
        S::I8 => each!(|b| f64::from(i8::from_le_bytes(b))),
        S::I16 => each!(|b| f64::from(i16::from_le_bytes(b))),
        S::U16 => each!(|b| f64::from(u16::from_le_bytes(b))),
        S::I32 => each!(|b| f64::from(i32::from_le_bytes(b))),
        S::U32 => each!(|b| f64::from(u32::from_le_bytes(b))),
        S::I64 => each!(|b| i64::from_le_bytes(b) as f64),
        S::U64 => each!(|b| u64::from_le_bytes(b) as f64),
        S::F16 => each!(|b| half(u16::from_le_bytes(b))),
        S::F32 => each!(|b| f64::from(f32::from_le_bytes(b))),
        S::F64 => each!(f64::from_le_bytes),
    }
}

/// One number in double precision, from as many bytes as its type has. It is for lists of a few numbers; the
/// readers of columns are made for long ones.
pub(crate) fn double(bytes: &[u8], encoding: Encoding) -> f64 {
    use ScalarType as S;
    let mut word = [0; 8];
    for (i, byte) in bytes.iter().enumerate().take(8) {
        let place = if encoding.big_endian {
            bytes.len().min(8) - 1 - i
        } else {
            i
        };
        word[place] = *byte;
    }
    let [a, b, c, d, ..] = word;
    match encoding.scalar {
        S::U8 => f64::from(a),
        S::I8 => f64::from(i8::from_le_bytes([a])),
        S::I16 => f64::from(i16::from_le_bytes([a, b])),
        S::U16 => f64::from(u16::from_le_bytes([a, b])),
        S::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        S::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        S::I64 => i64::from_le_bytes(word) as f64,
        S::U64 => u64::from_le_bytes(word) as f64,
        S::F16 => half(u16::from_le_bytes([a, b])),
        S::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        S::F64 => f64::from_le_bytes(word),
    }
}

/// Integers as node numbers, sizes or kinds of cells: exact, and never negative. The error is the index of the
/// first number that is negative, too large or no integer.
pub(crate) fn node_ids(bytes: &[u8], encoding: Encoding) -> Result<Vec<u32>, usize> {
    integers(bytes, encoding, |n| u32::try_from(n).ok()).map_err(|fault| match fault {
        NotIntegers::Fractions => 0,
        NotIntegers::Refused(place, _) => place,
    })
}

/// `count` positions, stored x, y, z, one after another. `None` if they do not lie within `bytes`.
pub(crate) fn points(bytes: &[u8], encoding: Encoding, count: usize) -> Option<Vec<DVec3>> {
    let size = encoding.scalar.size();
    let axis = |i: usize| {
        let stride = Stride {
            first: i * size,
            step: 3 * size,
            count,
        };
        (encoding, stride)
    };
    positions(bytes, [axis(0), axis(1), axis(2)])
}

/// Positions from equally many numbers of each axis, without a second copy of all of them. `None` if they do
/// not lie within `bytes`.
pub(crate) fn positions(bytes: &[u8], axes: [(Encoding, Stride); 3]) -> Option<Vec<DVec3>> {
    let count = axes[0].1.count;
    let fits = |(encoding, stride): &(Encoding, Stride)| {
        stride.count == count && stride.fits(encoding.scalar.size(), bytes.len())
    };
    if !axes.iter().all(fits) {
        return None;
    }
    let mut positions = vec![DVec3::ZERO; count];
    parallel::chunks(&mut positions, BATCH, |i, batch| {
        for (j, run) in batch.chunks_mut(POSITIONS).enumerate() {
            let before = i * BATCH + j * POSITIONS;
            let mut numbers = [[0.0; POSITIONS]; 3];
            for (numbers, (encoding, stride)) in numbers.iter_mut().zip(axes) {
                let first = stride.first + before * stride.step;
                let numbers = &mut numbers[..run.len()];
                fill_doubles(numbers, bytes, encoding, first, stride.step);
            }
            let [x, y, z] = numbers;
            for (((p, x), y), z) in run.iter_mut().zip(x).zip(y).zip(z) {
                *p = DVec3::new(x, y, z);
            }
        }
    });
    Some(positions)
}

/// The reason why numbers are not the wanted integers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NotIntegers {
    /// They are floating-point numbers.
    Fractions,
    /// An index, and the number there, which is not allowed.
    Refused(usize, i128),
}

/// All of `bytes` as integers, each exactly, if `convert` allows it; the error is the first that it does not.
pub(crate) fn integers<T: Copy + Default + Send>(
    bytes: &[u8],
    encoding: Encoding,
    convert: impl Fn(i128) -> Option<T> + Sync,
) -> Result<Vec<T>, NotIntegers> {
    use ScalarType as S;
    if matches!(encoding.scalar, S::F16 | S::F32 | S::F64) {
        return Err(NotIntegers::Fractions);
    }
    let size = encoding.scalar.size();
    let mut all = vec![T::default(); bytes.len() / size];
    parallel::try_chunks(&mut all, BATCH, |i, batch| {
        for (j, run) in batch.chunks_mut(POSITIONS).enumerate() {
            let before = i * BATCH + j * POSITIONS;
            let mut numbers = [0; POSITIONS];
            let numbers = &mut numbers[..run.len()];
            fill_integers(numbers, bytes, encoding, before * size);
            for ((out, at), number) in run.iter_mut().zip(before..).zip(numbers) {
                let refused = || NotIntegers::Refused(at, *number);
                *out = convert(*number).ok_or_else(refused)?;
            }
        }
        Ok(())
    })?;
    Ok(all)
}

/// As [`fill`], with integers that are adjacent in `bytes`.
fn fill_integers(out: &mut [i128], bytes: &[u8], encoding: Encoding, first: usize) {
    use ScalarType as S;
    let (big, step) = (encoding.big_endian, encoding.scalar.size());
    macro_rules! each {
        ($t:ty) => {
            fill(out, bytes, first, step, big, |b| {
                i128::from(<$t>::from_le_bytes(b))
            })
        };
    }
    match encoding.scalar {
        S::I8 => each!(i8),
        S::U8 => each!(u8),
        S::I16 => each!(i16),
        S::U16 => each!(u16),
        S::I32 => each!(i32),
        S::U32 => each!(u32),
        S::I64 => each!(i64),
        S::U64 => each!(u64),
        S::F16 | S::F32 | S::F64 => {}
    }
}

/// The numbers of one component, scaled; they lie within `bytes`.
pub(in crate::io) fn scaled(
    bytes: &[u8],
    encoding: Encoding,
    stride: Stride,
    scale: Option<[f64; 2]>,
) -> Values {
    let values = match scale {
        None => values(bytes, encoding, stride),
        Some([factor, summand]) => doubles(bytes, encoding, stride).map(|mut x| {
            x.iter_mut().for_each(|x| *x = factor * *x + summand);
            x.into()
        }),
    };
    values.unwrap_or(Values::U8(Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_integers_keep_their_type_and_wide_ones_their_digits() {
        let at = |scalar, big_endian, count| {
            let bytes = [0xff, 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07];
            let step = ScalarType::size(scalar);
            values(
                &bytes,
                Encoding { scalar, big_endian },
                Stride {
                    first: 0,
                    step,
                    count,
                },
            )
        };
        assert_eq!(at(ScalarType::I8, false, 2), Some(Values::I16(vec![-1, 1])));
        assert_eq!(at(ScalarType::U8, true, 2), Some(Values::U8(vec![255, 1])));
        assert_eq!(
            at(ScalarType::U16, true, 2),
            Some(Values::U16(vec![0xff01, 0x0203]))
        );
        assert_eq!(
            at(ScalarType::I16, false, 1),
            Some(Values::I16(vec![0x01ff]))
        );
        assert_eq!(
            at(ScalarType::U32, false, 1),
            Some(Values::F64(vec![50_463_231.0]))
        );
        assert_eq!(at(ScalarType::F64, false, 2), None);
    }

    #[test]
    fn node_ids_are_exact_and_never_negative() {
        let encoding = |scalar, big_endian| Encoding { scalar, big_endian };
        let large = 16_777_217_i64.to_be_bytes();
        let big_i64 = encoding(ScalarType::I64, true);
        assert_eq!(node_ids(&large, big_i64), Ok(vec![16_777_217]));
        let beyond = [7_i64, 1 << 32].map(i64::to_be_bytes).concat();
        assert_eq!(node_ids(&beyond, big_i64), Err(1));
        let negative = [1_i32, 2, -1].map(i32::to_le_bytes).concat();
        assert_eq!(
            node_ids(&negative, encoding(ScalarType::I32, false)),
            Err(2)
        );
        assert_eq!(
            node_ids(&[1, 255], encoding(ScalarType::U8, false)),
            Ok(vec![1, 255])
        );
        assert_eq!(node_ids(&[0; 4], encoding(ScalarType::F32, false)), Err(0));
    }

    #[test]
    fn a_stride_past_the_end_or_past_usize_is_refused() {
        let u8s = Encoding {
            scalar: ScalarType::U8,
            big_endian: false,
        };
        for (first, step, count) in [(0, 1, 5), (4, 1, 1), (0, usize::MAX, 3), (usize::MAX, 1, 1)] {
            assert_eq!(values(&[0; 4], u8s, Stride { first, step, count }), None);
        }
        assert_eq!(
            values(
                &[7, 8, 9, 10],
                u8s,
                Stride {
                    first: 1,
                    step: 2,
                    count: 2
                }
            ),
            Some(Values::U8(vec![8, 10]))
        );
    }

    #[test]
    fn positions_keep_every_bit_in_any_batch() {
        let numbers: Vec<f64> = (0..3 * 5000).map(|i| f64::from(i) / 3.0).collect();
        for big_endian in [false, true] {
            let bytes: Vec<u8> = numbers
                .iter()
                .flat_map(|x| {
                    if big_endian {
                        x.to_be_bytes()
                    } else {
                        x.to_le_bytes()
                    }
                })
                .collect();
            let encoding = Encoding {
                scalar: ScalarType::F64,
                big_endian,
            };
            let read = points(&bytes, encoding, 5000).unwrap();
            assert_eq!(
                read.iter().flat_map(|p| p.to_array()).collect::<Vec<_>>(),
                numbers
            );
            assert_eq!(points(&bytes, encoding, 5001), None);
            assert_eq!(points(&bytes, encoding, usize::MAX), None);
        }
    }

    /// 2^24 + 1 is the first integer that single precision cannot represent.
    #[test]
    fn integers_are_exact_and_none_is_wrapped() {
        let index = |n: i128| u32::try_from(n).ok();
        let read = |scalar, big_endian, bytes: &[u8]| {
            integers(bytes, Encoding { scalar, big_endian }, index)
        };
        let exact = (1_u32 << 24) + 1;
        assert_eq!(
            read(ScalarType::I32, true, &exact.to_be_bytes()),
            Ok(vec![exact])
        );
        assert_eq!(
            read(ScalarType::U64, false, &u64::from(u32::MAX).to_le_bytes()),
            Ok(vec![u32::MAX])
        );
        assert_eq!(read(ScalarType::U8, false, &[7, 255]), Ok(vec![7, 255]));
        assert_eq!(
            read(ScalarType::I8, false, &[7, 255]),
            Err(NotIntegers::Refused(1, -1))
        );
        assert_eq!(
            read(ScalarType::I64, false, &(1_i64 << 32).to_le_bytes()),
            Err(NotIntegers::Refused(0, 1 << 32))
        );
        assert_eq!(
            read(ScalarType::F32, false, &[0; 4]),
            Err(NotIntegers::Fractions)
        );
    }
}
