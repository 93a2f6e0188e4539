//! Writes SPZ, versions 3 and 4, in the layout of `spz.rs`.

use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

use super::encoded_splats::{
    Encoded, SpzVersion, byte, median_size, note_cut, note_faint, opacity_byte,
};
use super::spz::{HAS_RECORDS, MAGIC, STREAM_ROW, STREAMED_HEADER, TURNED};
use crate::data::splats::SplatCloud;
use crate::data::spz_records::SpzRecord;
use crate::error::{Error, Result};
use crate::math::Core;

/// Greatest number of steps in a position, with a sign.
const MOST_STEPS: f64 = ((1 << 23) - 1) as f64;

/// Greatest number of fractional bits that readers accept.
const MOST_FRACTION_BITS: u8 = 24;

/// Greatest length of extension records in bytes.
const MOST_RECORD_BYTES: usize = 1 << 31;

/// Step of positions that is invisible, as a share of the median size of splats.
const LEAST_STEP: f64 = 0.02;

/// The greatest coordinate among the splats in the densest part.
fn greatest_of_core(cloud: &SplatCloud) -> Option<f64> {
    let weight = |i: usize| {
        let [a, b, c] = cloud.scales[i].map(f64::from);
        f64::from(cloud.opacities[i]) * (a * b).max(b * c).max(c * a)
    };
    let points = cloud.positions.iter().enumerate();
    let core = Core::of(&points.map(|(i, p)| (*p, weight(i))).collect::<Vec<_>>())?;
    let kept = cloud.positions.iter().filter(|p| core.holds(**p));
    Some(kept.fold(0.0, |most, p| most.max(p.abs().max_element())))
}

/// Encodes a compressed file of splats.
pub(in crate::io) fn encode(
    path: &Path,
    cloud: &SplatCloud,
    version: SpzVersion,
) -> Result<Encoded> {
    let count = cloud.positions.len();
    let Ok(count_u32) = u32::try_from(count) else {
        return Err(Error::format(
            path,
            "splats",
            "fewer than 2^32",
            count.to_string(),
            "split the scene",
        ));
    };
    let greatest = cloud
        .positions
        .iter()
        .fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
    let most_bits = |greatest: f64| {
        let fits = |bits: &u8| (greatest * f64::from(*bits).exp2()).round() <= MOST_STEPS;
        (0..=MOST_FRACTION_BITS).rev().find(fits)
    };
    let of_all = most_bits(greatest);
    // As fine as the splats need, if the many allow it; splats far from them may then be moved.
    let fine = (1.0 / (LEAST_STEP * median_size(cloud))).log2().ceil();
    let of_many = || {
        let many = greatest_of_core(cloud)?;
        let bits = most_bits(many)?;
        let is_finer = |bits: &u8| of_all.is_none_or(|all| f64::from(all) < fine && *bits > all);
        let enough = (0..=bits).find(|bits| f64::from(*bits) >= fine);
        Some(enough.unwrap_or(bits)).filter(is_finer)
    };
    let Some(fraction_bits) = of_many().or(of_all) else {
        return Err(Error::format(
            path,
            "positions",
            "coordinates up to 8388607",
            greatest.to_string(),
            "move the scene to the origin, scale it, or write another format",
        ));
    };
    let per_unit = f64::from(fraction_bits).exp2();

    let [mut scales, mut colours, mut coefficients, mut faint] = [0; 4];
    let mut positions = Vec::with_capacity(9 * count);
    let mut outliers = Vec::new();
    for (i, p) in cloud.positions.iter().enumerate() {
        if (p.abs().max_element() * per_unit).round() > MOST_STEPS {
            outliers.push(i);
        }
        for x in [p.x, -p.y, -p.z] {
            #[expect(clippy::cast_possible_truncation, reason = "clamped to 24 bits")]
            let steps = (x * per_unit).round().clamp(-MOST_STEPS, MOST_STEPS) as i32;
            positions.extend(&steps.to_le_bytes()[..3]);
        }
    }
    let mut opacities = Vec::with_capacity(count);
    opacities.extend((0..count).map(|i| opacity_byte(cloud, i, &mut faint)));
    let mut constants = Vec::with_capacity(3 * count);
    for i in 0..count {
        let constant = &cloud.coefficients(i)[..3];
        let code = |c: &f32| byte(255.0 * (0.5 + 0.15 * f64::from(*c)), &mut colours);
        constants.extend(constant.iter().map(code));
    }
    let mut sizes = Vec::with_capacity(3 * count);
    for i in 0..count {
        let code = |s: f32| byte(16.0 * (f64::from(s).ln() + 10.0), &mut scales);
        sizes.extend(cloud.thick_scales(i).map(code));
    }
    let mut rotations = Vec::with_capacity(4 * count);
    for i in 0..count {
        let [w, x, y, z] = cloud.unit_rotation(i);
        rotations.extend(smallest_three([x, -y, -z, w]).to_le_bytes());
    }
    let mut rest = Vec::new();
    for i in 0..count {
        let others = cloud.coefficients(i)[3..].chunks_exact(3);
        for (rgb, sign) in others.zip(&TURNED[1..]) {
            let code = |c: &f32| byte(128.0 + 128.0 * f64::from(sign * c), &mut coefficients);
            rest.extend(rgb.iter().map(code));
        }
    }
    let mut header = Vec::with_capacity(STREAMED_HEADER as usize);
    header.extend(MAGIC);
    let number: u32 = match version {
        SpzVersion::Three => 3,
        SpzVersion::Four => 4,
    };
    header.extend(number.to_le_bytes());
    header.extend(count_u32.to_le_bytes());
    let records = records(path, cloud.records.kept())?;
    let has_records = !records.is_empty();
    let flags = u8::from(cloud.rule.is_anti_aliased()) | (u8::from(has_records) * HAS_RECORDS);
    header.extend([cloud.harmonics_degree, fraction_bits, flags]);
    let arrays = [positions, opacities, constants, sizes, rotations, rest];
    let bytes = match version {
        SpzVersion::Three => {
            header.push(0);
            let bytes = in_one_stream(&header, &arrays, &records);
            bytes.map_err(|e| Error::io(path, "packing", e, "free some memory"))?
        }
        SpzVersion::Four => in_streams(header, &arrays, &records),
    };

    let mut notes = Vec::new();
    if let Some(first) = outliers.first() {
        let p = cloud.positions[*first];
        let others = match outliers.len() - 1 {
            0 => String::new(),
            others => format!(" and {others} others"),
        };
        notes.push(format!(
            "splat {first} at {:e}, {:e}, {:e}{others} lie far from all others and are moved to {:.6} from the origin, as far as \
             positions in steps of {:.2e} reach, which the others ask for: --crop leaves them out",
            p.x,
            p.y,
            p.z,
            MOST_STEPS / per_unit,
            1.0 / per_unit
        ));
    }
    note_cut(&mut notes, scales, "scales outside 4.5e-5 to 380 are cut");
    note_cut(
        &mut notes,
        colours,
        "constant colour coefficients outside -3.3 to 3.3 are cut",
    );
    note_cut(
        &mut notes,
        coefficients,
        "colour coefficients outside -1 to 1 are cut",
    );
    note_faint(&mut notes, faint);
    Ok(Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum: 1.0 / per_unit,
        order: Vec::new(),
        notes,
    })
}

/// Returns extension records as files store them.
///
/// # Errors
/// More bytes than the place of version 4's table can state.
fn records(path: &Path, records: &[SpzRecord]) -> Result<Vec<u8>> {
    let total: usize = records.iter().map(|record| 8 + record.payload.len()).sum();
    if total > MOST_RECORD_BYTES {
        let (expected, found) = ("fewer than 2^31 bytes", total.to_string());
        let place = "extension records";
        return Err(Error::format(
            path,
            place,
            expected,
            found,
            "leave some out",
        ));
    }
    let mut bytes = Vec::with_capacity(total);
    for record in records {
        bytes.extend(record.kind.to_le_bytes());
        bytes.extend(length(&record.payload).to_le_bytes());
        bytes.extend(&record.payload);
    }
    Ok(bytes)
}

/// Length of at most [`MOST_RECORD_BYTES`].
fn length(bytes: &[u8]) -> u32 {
    u32::try_from(bytes.len()).unwrap_or(u32::MAX)
}

/// Writes version 3: header, arrays and extension records in one gzip stream.
fn in_one_stream(header: &[u8], arrays: &[Vec<u8>], records: &[u8]) -> io::Result<Vec<u8>> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(header)?;
    for array in arrays {
        packed.write_all(array)?;
    }
    packed.write_all(records)?;
    packed.finish()
}

/// Writes version 4: the header, extension records, a table, and a zstd stream for each array; none for harmonics of
/// degree 0.
///
/// - `header`: the first fifteen bytes.
fn in_streams(mut header: Vec<u8>, arrays: &[Vec<u8>], records: &[u8]) -> Vec<u8> {
    let arrays: Vec<&Vec<u8>> = arrays.iter().filter(|array| !array.is_empty()).collect();
    // At most six.
    header.push(u8::try_from(arrays.len()).unwrap_or(u8::MAX));
    let table_at = STREAMED_HEADER + length(records);
    header.extend(table_at.to_le_bytes());
    header.resize(STREAMED_HEADER as usize, 0);
    header.extend(records);
    let mut streams = Vec::new();
    header.reserve(STREAM_ROW * arrays.len());
    for array in arrays {
        let packed = compress_to_vec(array.as_slice(), CompressionLevel::Fastest);
        header.extend((packed.len() as u64).to_le_bytes());
        header.extend((array.len() as u64).to_le_bytes());
        streams.extend(packed);
    }
    header.extend(streams);
    header
}

/// A unit quaternion x, y, z, w as 32 bits: the index of its largest component, then the others, each a sign
/// and a magnitude in units of 1 / (511 sqrt 2).
fn smallest_three(q: [f64; 4]) -> u32 {
    let largest = (1..4).fold(0, |m, i| if q[i].abs() > q[m].abs() { i } else { m });
    // q and -q are one rotation: the component left out is made positive.
    let sign = q[largest].signum();
    let mut packed = u32::try_from(largest).unwrap_or(0);
    for (_, c) in q.iter().enumerate().filter(|(i, _)| *i != largest) {
        let c = c * sign;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most 511"
        )]
        let magnitude = (511.0 * std::f64::consts::SQRT_2 * c.abs())
            .round()
            .min(511.0) as u32;
        packed = packed << 10 | u32::from(c < 0.0) << 9 | magnitude;
    }
    packed
}
