//! Reads SPZ, versions 1 to 4: splats in some 20 to 65 bytes each, compressed by gzip or (version 4) in zstd
//! streams; little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 0..4 | `NGSP` |
//! | 4..8 | version |
//! | 8..12 | number of splats N |
//! | 12 | degree of the harmonics |
//! | 13 | fractional bits b of positions |
//! | 14 | flags: 1 made for an anti-aliasing filter, 2 extensions follow |
//! | 15 | version 4: number of streams; before, reserved |
//! | 9 N | positions: three signed 24-bit numbers in units of 2^-b (version 1: 6 N, half floats) |
//! | N | peak opacities, 0 to 255 |
//! | 3 N | coefficients of the constant harmonic: (byte / 255 - 1/2) / .15 |
//! | 3 N | scales: exp(byte / 16 - 10) |
//! | 4 N | version 3: quaternions without their largest component; see [`smallest_three`] |
//! | 3 N | versions 1 and 2: quaternions' x, y, z, each byte / 127.5 - 1; w is not negative |
//! | the rest | per splat and coefficient R, G, B, each (byte - 128) / 128 |
//!
//! Version 4 has 16 bytes more of header, the first of them the offset of its table of streams (u32), and each
//! array in a zstd stream of its own. The table has two numbers (u64) per stream, its packed and unpacked
//! length; the streams follow it. Versions 1 to 3 are read without gzip, too.
//!
//! Files have x right, y up, z back by convention, or the axes in an extension record
//! `SPZ_ADOBE_coordinate_system`. Records come before the table in version 4 and after the arrays in others, each a type and a length
//! (u32) and that many bytes. Others are kept for files that are written as SPZ again. Splats are rotated by half a turn about x, to the axes of PLY files: y and z of positions change
//! their sign, y and z of quaternions, and the harmonics that are odd under this rotation. `spz_write.rs`
//! writes versions 3 and 4; `splat_axes.rs` has the axes of all formats.

use std::array;
use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use glam::{DQuat, DVec3};
use ruzstd::decoding::StreamingDecoder;

use crate::data::dataset::Dataset;
use crate::data::splats::SplatCloud;
use crate::data::spz_records::{Change, SpzRecord, SpzRecords};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::half::half;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count};
use crate::scene::SplatRule;

pub(in crate::io) const MAGIC: &[u8; 4] = b"NGSP";
const HEADER: usize = 16;
/// The version in which the arrays are compressed and not the file, and the length of its header.
const STREAMED: u32 = 4;
pub(in crate::io) const STREAMED_HEADER: u32 = 32;
/// Bytes per stream in the table.
pub(in crate::io) const STREAM_ROW: usize = 16;

/// Deflate packs 258 bytes into two bits at best: no file unpacks to more than this many times its size. (In
/// zstd runs of equal bytes can; splats have none.)
const GREATEST_RATIO: u64 = 1032;

/// Type of the extension record with the axes: a number for [`Axes::of`].
const AXES_RECORD: u32 = 0xADBE_0003;
/// Flag of files with extension records.
pub(in crate::io) const HAS_RECORDS: u8 = 2;
/// Greatest length of extension records in any file, in bytes. They may also be as long as the splats.
const MOST_RECORD_BYTES: u64 = 1 << 20;
/// Greatest number of extension records that are kept.
const MOST_RECORDS: usize = 1 << 10;

/// The axes of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// PLY's: x right, y down, z forward.
    Training,
    /// SPZ's own: x right, y up, z back.
    Own,
}

/// The conversion from a file's axes to the wanted ones: signs of the coordinates, then a rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axes {
    /// The signs of the harmonics. Those of degree 1, in the order y, z and x, are the signs of the coordinates.
    signs: [f32; 16],
    turn: Option<DQuat>,
}

impl Axes {
    /// - `stated`: the number of the file's axes. 1 to 8: left or right (odd or even), down or up, back or
    ///   front. 9 to 16: left or right, then forward or back along y, down or up along z. 0 and others: x
    ///   right, y up, z back.
    fn of(stated: u32, wanted: Wanted) -> Self {
        const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;
        let sign = |is_kept: bool| if is_kept { 1.0_f32 } else { -1.0 };
        let stated = if (1..=16).contains(&stated) {
            stated
        } else {
            4
        };
        let n = (stated - 1) % 8;
        let (is_right, is_up, is_second) = (n & 1 != 0, n & 2 != 0, n & 4 != 0);
        let (signs, turn) = if stated <= 8 {
            // To x right, y up, z back.
            let [y, z] = match wanted {
                Wanted::Own => [is_up, !is_second],
                Wanted::Training => [!is_up, is_second],
            };
            ([is_right, y, z].map(sign), None)
        } else {
            // To x right, y forward, z up; and a quarter turn about x.
            let quarter = match wanted {
                Wanted::Own => -HALF,
                Wanted::Training => HALF,
            };
            let turn = DQuat::from_xyzw(quarter, 0.0, 0.0, HALF);
            ([is_right, !is_second, is_up].map(sign), Some(turn))
        };
        let [x, y, z] = signs;
        let signs = [
            1.0,
            y,
            z,
            x,
            x * y,
            y * z,
            1.0,
            x * z,
            1.0,
            y,
            x * y * z,
            y,
            z,
            x,
            z,
            x,
        ];
        Self { signs, turn }
    }
}

/// The extension records of a file.
#[derive(Debug, Default)]
struct Extensions {
    /// Number of the axes.
    axes: Option<u32>,
    /// The other records.
    others: Vec<SpzRecord>,
    /// Whether bytes are left that are no records, or a record of the axes without a number.
    has_rest: bool,
}

impl Extensions {
    fn parse(mut bytes: &[u8]) -> Self {
        let mut extensions = Self::default();
        while let Some((head, rest)) = bytes.split_first_chunk::<8>() {
            let number = |at: usize| u32::from_le_bytes(array::from_fn(|i| head[at + i]));
            let payload = usize::try_from(number(4)).ok();
            let Some((payload, rest)) = payload.and_then(|len| rest.split_at_checked(len)) else {
                break;
            };
            match (number(0), payload.first_chunk::<4>()) {
                (AXES_RECORD, Some(of)) => extensions.axes = Some(u32::from_le_bytes(*of)),
                (AXES_RECORD, None) => extensions.has_rest = true,
                _ if extensions.others.len() == MOST_RECORDS => break,
                (kind, _) => extensions.others.push(SpzRecord {
                    kind,
                    payload: payload.to_vec(),
                }),
            }
            bytes = rest;
        }
        extensions.has_rest |= !bytes.is_empty();
        extensions
    }
}

/// Signs of the harmonics under half a turn about x: (x, y, z) to (x, -y, -z).
pub(in crate::io) const TURNED: [f32; 16] = [
    1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
];

/// Whether a file's first bytes are those of an SPZ file, compressed or (version 4) not.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let mut magic = [0; MAGIC.len()];
    head.starts_with(MAGIC)
        || (head.starts_with(b"\x1f\x8b")
            && MultiGzDecoder::new(head).read_exact(&mut magic).is_ok()
            && &magic == MAGIC)
}

/// Reads splats.
///
/// # Errors
/// Another version, or fewer bytes than the header states.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let (file, len) = input.open()?;
    let (cloud, notes) = decode(path, file, len, Wanted::Training)?;
    let mut data = cloud.dataset(path, "SPZ splats", Vec::new())?;
    data.notes = notes;
    Ok(data)
}

/// Decodes the splats of a stream in its own axes, which glTF files with such streams use as theirs. Returns
/// notes, too.
///
/// # Errors
/// As [`read`].
pub(in crate::io) fn splats(path: &Path, bytes: &[u8]) -> Result<(SplatCloud, Vec<String>)> {
    decode(path, bytes, bytes.len() as u64, Wanted::Own)
}

/// - `len`: length of the file in bytes.
fn decode(
    path: &Path,
    mut file: impl Read,
    len: u64,
    wanted: Wanted,
) -> Result<(SplatCloud, Vec<String>)> {
    let io = |e| Error::io(path, "reading", e, "check the disk");
    let mut start = [0; HEADER];
    let mut started = 0;
    // A file that is too short is reported below.
    while started < HEADER {
        match file.read(&mut start[started..]).map_err(io)? {
            0 => break,
            n => started += n,
        }
    }
    let packed = start[..started].chain(file.take(len.saturating_sub(HEADER as u64)));
    let is_bare = start.starts_with(MAGIC);
    if is_bare && word(&start, 4) == STREAMED {
        let mut packed = packed;
        let mut bytes = Vec::new();
        packed.read_to_end(&mut bytes).map_err(io)?;
        return read_streams(path, &bytes, wanted);
    }
    let mut unpacked: Box<dyn Read + '_> = if is_bare {
        Box::new(packed)
    } else {
        Box::new(MultiGzDecoder::new(packed))
    };
    let damaged = |e: std::io::Error| {
        let advice = "the file is damaged or is no SPZ file: get it again";
        Error::io(path, "unpacking", e, advice)
    };
    let mut header = [0; HEADER];
    unpacked.read_exact(&mut header).map_err(damaged)?;
    if !header.starts_with(MAGIC) {
        return Err(Error::format(
            path,
            "header",
            "`NGSP`",
            format!("bytes {:02x?}", &header[..4]),
            "give an SPZ file",
        ));
    }
    let version = word(&header, 4);
    if !(1..=3).contains(&version) {
        return Err(unknown_version(path, version));
    }
    let header = Header::of(path, &header, len)?;
    let size = header.size;
    let mut body = Vec::new();
    (&mut unpacked)
        .take(size)
        .read_to_end(&mut body)
        .map_err(damaged)?;
    if body.len() as u64 != size {
        return Err(header.too_short(path, format!("{} bytes", body.len())));
    }
    let mut records = Vec::new();
    (&mut unpacked)
        .take(MOST_RECORD_BYTES.max(size))
        .read_to_end(&mut records)
        .map_err(damaged)?;
    Ok(header.splats(&body, &records, wanted))
}

/// Reads version 4.
///
/// # Errors
/// A table or streams outside the file, or with sizes other than the header's.
fn read_streams(
    path: &Path,
    bytes: &[u8],
    wanted_axes: Wanted,
) -> Result<(SplatCloud, Vec<String>)> {
    let fault = |place: String, expected: String, found: String| {
        let advice = "the file is cut off or damaged: get it again";
        Error::format(path, place, expected, found, advice)
    };
    let table_at = bytes.get(HEADER..HEADER + 4);
    let (Some(start), Some(table_at)) = (bytes.first_chunk::<HEADER>(), table_at) else {
        return Err(fault(
            "header".into(),
            format!("{STREAMED_HEADER} bytes"),
            format!("{} bytes", bytes.len()),
        ));
    };
    let header = Header::of(path, start, bytes.len() as u64)?;
    let arrays = header.layout.arrays();
    let wanted = arrays.iter().filter(|a| **a > 0).count();
    let stream_count = usize::from(start[15]);
    let table_at = u32::from_le_bytes(array::from_fn(|i| table_at[i]));
    let table = bytes
        .get(table_at as usize..)
        .and_then(|rest| rest.split_at_checked(stream_count * STREAM_ROW))
        .filter(|_| table_at >= STREAMED_HEADER && stream_count >= wanted);
    let Some((table, mut rest)) = table else {
        return Err(fault(
            "header".into(),
            format!("a table of {wanted} streams or more within the file"),
            format!("{stream_count} at byte {table_at} of {}", bytes.len()),
        ));
    };
    let mut body = Vec::new();
    for (i, (row, array)) in table.chunks_exact(STREAM_ROW).zip(arrays).enumerate() {
        let place = || format!("stream {i}");
        let number = |at: usize| u64::from_le_bytes(array::from_fn(|k| row[at + k]));
        let (packed_size, size) = (number(0), number(8));
        let expected = u64::from(header.count) * array as u64;
        if size != expected {
            return Err(fault(
                place(),
                format!("{expected} bytes for {} splats", header.count),
                size.to_string(),
            ));
        }
        let packed = usize::try_from(packed_size).ok();
        let split = packed.and_then(|size| rest.split_at_checked(size));
        let Some((packed, others)) = split else {
            return Err(fault(
                place(),
                format!("{packed_size} bytes"),
                format!("{} left in the file", rest.len()),
            ));
        };
        rest = others;
        if array == 0 {
            continue;
        }
        let damaged = |found: String| fault(place(), "a sound zstd stream".into(), found);
        let stream = StreamingDecoder::new(packed).map_err(|e| damaged(e.to_string()))?;
        let before = body.len() as u64;
        let mut stream = stream.take(size);
        stream
            .read_to_end(&mut body)
            .map_err(|e| damaged(e.to_string()))?;
        let found = body.len() as u64 - before;
        if found != size {
            return Err(fault(
                place(),
                format!("{size} bytes"),
                format!("{found} bytes"),
            ));
        }
    }
    let records = bytes.get(STREAMED_HEADER as usize..table_at as usize);
    Ok(header.splats(&body, records.unwrap_or_default(), wanted_axes))
}

/// The parsed header.
struct Header {
    layout: Layout,
    count: u32,
    fraction_bits: u8,
    flags: u8,
    /// Length of all arrays in bytes.
    size: u64,
}

impl Header {
    /// - `len`: length of the file in bytes.
    fn of(path: &Path, header: &[u8; HEADER], len: u64) -> Result<Self> {
        let [degree, fraction_bits, flags] = [header[12], header[13], header[14]];
        // Degree 4 is the format's greatest.
        if degree > 4 || fraction_bits > 24 {
            return Err(Error::format(
                path,
                "header",
                "harmonics of degree 0 to 4 and up to 24 fractional bits",
                format!("degree {degree} and {fraction_bits} bits"),
                "the file is damaged: get it again",
            ));
        }
        let layout = Layout::new(word(header, 4), degree);
        let count = word(header, 8);
        let size = u64::from(count).saturating_mul(layout.bytes_per_splat() as u64);
        let header = Self {
            layout,
            count,
            fraction_bits,
            flags,
            size,
        };
        if size > len.saturating_mul(GREATEST_RATIO) {
            return Err(header.too_short(path, format!("a file of {len} bytes")));
        }
        Ok(header)
    }

    fn too_short(&self, path: &Path, found: String) -> Error {
        Error::format(
            path,
            "size",
            format!(
                "{} bytes for {} splats of degree {}",
                self.size, self.count, self.layout.degree
            ),
            found,
            "the file is cut off or its header is wrong: get it again",
        )
    }

    /// - `records`: the file's extension records.
    fn splats(&self, body: &[u8], records: &[u8], wanted: Wanted) -> (SplatCloud, Vec<String>) {
        let degree = self.layout.degree;
        let mut notes = Vec::new();
        let has_records = self.flags & HAS_RECORDS != 0;
        let parsed = Extensions::parse(if has_records { records } else { &[] });
        let stated = parsed.axes;
        if parsed.has_rest || has_records == records.is_empty() {
            notes.push("what follows the splats (extensions) is not read".into());
        }
        match stated {
            None | Some(0 | 4) => {}
            Some(axes @ 1..=16) => notes.push(format!(
                "the file states its axes, which are turned from there (SPZ_ADOBE_coordinate_system {axes})"
            )),
            Some(axes) => notes.push(format!(
                "the file states unknown axes (SPZ_ADOBE_coordinate_system {axes}): taken for x right, y up, z back"
            )),
        }
        let Axes { signs, turn } = Axes::of(stated.unwrap_or_default(), wanted);
        if degree > MAX_HARMONICS_DEGREE {
            notes.push(format!(
                "harmonics of degree {degree}: those above {MAX_HARMONICS_DEGREE} are not used"
            ));
        }
        let scale = 0.5_f64.powi(i32::from(self.fraction_bits));
        let mut cloud = self.layout.splats(body, scale, self.flags & 1 != 0, &signs);
        if let Some(turn) = turn {
            cloud.turn(turn);
        }
        let mut records = SpzRecords::new(parsed.others);
        // Streams in other files keep none, as their splats may be transformed there and joined.
        let is_kept = wanted == Wanted::Training;
        notes.extend(records.note(is_kept));
        if is_kept {
            if Axes::of(stated.unwrap_or_default(), wanted) != Axes::of(0, wanted) {
                records.change(Change::Axes);
            }
            cloud.records = records;
        }
        (cloud, notes)
    }
}

fn word(header: &[u8; HEADER], at: usize) -> u32 {
    u32::from_le_bytes(array::from_fn(|i| header[at + i]))
}

fn unknown_version(path: &Path, version: u32) -> Error {
    Error::format(
        path,
        "header",
        "version 1 to 3, or 4 without gzip",
        format!("version {version}, which is not read"),
        "save it as version 3, or as PLY",
    )
}

/// Bytes per splat in each array.
struct Layout {
    position: usize,
    rotation: usize,
    /// Coefficients beyond the constant one.
    coefficients: usize,
    degree: u8,
}

impl Layout {
    fn new(version: u32, degree: u8) -> Self {
        Self {
            position: if version == 1 { 6 } else { 9 },
            rotation: if version < 3 { 3 } else { 4 },
            coefficients: harmonics_count(degree) - 1,
            degree,
        }
    }

    /// Bytes per splat of each array, in order.
    fn arrays(&self) -> [usize; 6] {
        [self.position, 1, 3, 3, self.rotation, 3 * self.coefficients]
    }

    fn bytes_per_splat(&self) -> usize {
        self.arrays().iter().sum()
    }

    /// Decodes the arrays; `body` contains them completely.
    fn splats(
        &self,
        body: &[u8],
        scale: f64,
        is_anti_aliased: bool,
        signs: &[f32; 16],
    ) -> SplatCloud {
        let count = body.len() / self.bytes_per_splat();
        let mut rest = body;
        let mut array = |bytes: usize| {
            let (array, others) = rest.split_at(count * bytes);
            rest = others;
            array
        };
        let positions = array(self.position);
        let opacities = array(1);
        let constants = array(3);
        let scales = array(3);
        let rotations = array(self.rotation);
        let others = array(3 * self.coefficients);

        let degree = self.degree.min(MAX_HARMONICS_DEGREE);
        let kept = harmonics_count(degree) - 1;
        let mut harmonics = Vec::with_capacity(count * 3 * (kept + 1));
        for (i, constant) in constants.chunks_exact(3).enumerate() {
            let of_byte = |&b: &u8| (f32::from(b) / 255.0 - 0.5) / 0.15;
            harmonics.extend(constant.iter().map(of_byte));
            let set = &others[i * 3 * self.coefficients..][..3 * kept];
            for (rgb, sign) in set.chunks_exact(3).zip(&signs[1..]) {
                harmonics.extend(rgb.iter().map(|&b| sign * (f32::from(b) - 128.0) / 128.0));
            }
        }
        let [of_y, of_z, of_x] = [1, 2, 3].map(|k| f64::from(signs[k]));
        let position = |p: &[u8]| {
            let [x, y, z] = array::from_fn(|i| {
                if self.position == 6 {
                    half(u16::from_le_bytes([p[2 * i], p[2 * i + 1]]))
                } else {
                    // The sign lies in the third byte: shifted up, then down again.
                    let n = i32::from_le_bytes([0, p[3 * i], p[3 * i + 1], p[3 * i + 2]]) >> 8;
                    f64::from(n) * scale
                }
            });
            DVec3::new(x * of_x, y * of_y, z * of_z)
        };
        let rotation = |q: &[u8]| {
            let [x, y, z, w] = if self.rotation == 4 {
                smallest_three(u32::from_le_bytes(array::from_fn(|i| q[i])))
            } else {
                let [x, y, z] = array::from_fn(|i| f32::from(q[i]) / 127.5 - 1.0);
                [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
            };
            // Signs of a rotation's axes: those of yz, xz and xy.
            [w, x * signs[5], y * signs[7], z * signs[4]]
        };
        let scale_of = |s: &[u8]| array::from_fn(|i| (f32::from(s[i]) / 16.0 - 10.0).exp());
        SplatCloud {
            positions: positions
                .chunks_exact(self.position)
                .map(position)
                .collect(),
            scales: scales.chunks_exact(3).map(scale_of).collect(),
            rotations: rotations
                .chunks_exact(self.rotation)
                .map(rotation)
                .collect(),
            opacities: opacities.iter().map(|&a| f32::from(a) / 255.0).collect(),
            harmonics_degree: degree,
            harmonics,
            rule: SplatRule::of_mark(is_anti_aliased),
            by_distance: false,
            ..SplatCloud::default()
        }
    }
}

/// A unit quaternion x, y, z, w from its three smaller components. The upper two bits are the index of the one
/// left out (not negative). Ten bits for each of the others follow, a sign and a magnitude in units of 1 / (511
/// sqrt 2), the last component in the lowest bits.
fn smallest_three(packed: u32) -> [f32; 4] {
    const UNIT: f32 = std::f32::consts::FRAC_1_SQRT_2 / 511.0;
    let largest = (packed >> 30) as usize;
    let mut q = [0.0_f32; 4];
    let mut bits = packed;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = UNIT * (bits & 511) as f32;
        q[i] = if bits & 512 == 0 {
            magnitude
        } else {
            -magnitude
        };
        bits >>= 10;
    }
    q[largest] = (1.0 - q.iter().map(|c| c * c).sum::<f32>()).max(0.0).sqrt();
    q
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::harmonics;
    use glam::Vec3;

    #[test]
    fn harmonics_turn_with_their_signs() {
        let d = Vec3::new(0.48, -0.6, 0.64);
        for (stated, wanted, turned) in [
            (0, Wanted::Own, d),
            (6, Wanted::Training, d),
            (1, Wanted::Own, Vec3::new(-d.x, -d.y, d.z)),
            (8, Wanted::Training, Vec3::new(d.x, -d.y, d.z)),
        ] {
            let signs = Axes::of(stated, wanted).signs;
            let turned = harmonics(turned);
            for (i, (a, b)) in harmonics(d).into_iter().zip(turned).enumerate() {
                assert!((signs[i] * a - b).abs() < 1e-6, "{stated}, {i}: {a}, {b}");
            }
        }
        assert_eq!(Axes::of(4, Wanted::Training).signs, TURNED);
        let turned = harmonics(Vec3::new(d.x, -d.y, -d.z));
        for (i, (a, b)) in harmonics(d).into_iter().zip(turned).enumerate() {
            assert!((TURNED[i] * a - b).abs() < 1e-6, "{i}: {a}, {b}");
            assert!(a.abs() > 1e-3, "{i} tells nothing");
        }
    }

    #[test]
    fn quaternions_come_back_within_their_quantum() {
        // The largest is z (index 2): x = .1, y = -.2, w = .3.
        let bits = |c: f32| {
            let magnitude = c.abs() * 511.0 * std::f32::consts::SQRT_2;
            let nearest = (0..512).find(|&n| n as f32 + 0.5 >= magnitude);
            u32::from(c < 0.0) << 9 | nearest.unwrap()
        };
        let packed = 2 << 30 | bits(0.1) << 20 | bits(-0.2) << 10 | bits(0.3);
        let expected = [0.1, -0.2, 0.86_f32.sqrt(), 0.3];
        for (a, b) in smallest_three(packed).into_iter().zip(expected) {
            // Half a unit of 1 / (511 sqrt 2), and its effect on the largest component.
            assert!((a - b).abs() < 1.0e-3, "{a}, {b}");
        }
    }
}
