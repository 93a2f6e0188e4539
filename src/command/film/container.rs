//! Writes the boxes of an MP4 file (ISO/IEC 14496-12) with one track of AV1.

use std::io::{Error, ErrorKind, Result};

/// Sample of a track: one picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// Length in bytes.
    pub(super) bytes: u32,
    /// Whether a player may start here.
    pub(super) is_key: bool,
}

/// A track of pictures.
#[derive(Debug, Clone)]
pub(super) struct Track {
    /// Width and height in pixels.
    pub(super) size: [u16; 2],
    /// Pictures per second.
    pub(super) rate: u16,
    /// The pictures in the order of time, which is the order of the data.
    pub(super) samples: Vec<Sample>,
    /// The AV1 sequence header, an OBU with its length.
    pub(super) sequence: Vec<u8>,
}

/// Time units of a picture.
const TICKS: u32 = 1000;

/// Rotation, scale and position of the picture: none.
const IDENTITY: [u32; 9] = [0x1_0000, 0, 0, 0, 0x1_0000, 0, 0, 0, 0x4000_0000];

/// Returns a box: its length, its name, its contents.
fn of(name: &[u8; 4], contents: &[&[u8]]) -> Vec<u8> {
    let length: usize = contents.iter().map(|part| part.len()).sum();
    // Tables of 100,000 pictures have some 0.4 MB.
    let length = u32::try_from(length + 8).unwrap_or(u32::MAX);
    let mut bytes = length.to_be_bytes().to_vec();
    bytes.extend(name);
    contents.iter().for_each(|part| bytes.extend(*part));
    bytes
}

/// Returns numbers as bytes.
fn words(numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    numbers.into_iter().flat_map(u32::to_be_bytes).collect()
}

/// Returns a table: version 0, the number of entries, and these.
fn table(name: &[u8; 4], entries: usize, numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    let entries = u32::try_from(entries).unwrap_or(u32::MAX);
    of(name, &[&words([0, entries]), &words(numbers)])
}

/// Returns a damaged stream's error.
fn damaged(what: &'static str) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}

/// Reads a number of AV1's variable length, low bits first: the number and its bytes.
fn leb128(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut number = 0;
    for (i, byte) in bytes.iter().take(4).enumerate() {
        number |= usize::from(byte & 0x7F) << (7 * i);
        if byte & 0x80 == 0 {
            return Some((number, i + 1));
        }
    }
    None
}

/// Kinds of OBUs.
const SEQUENCE_HEADER: u8 = 1;
const TEMPORAL_DELIMITER: u8 = 2;

/// Returns the sample of an encoder's packet and the sequence header in it. An MP4 holds no temporal delimiters.
pub(super) fn sample_of(packet: &[u8]) -> Result<(Vec<u8>, Option<&[u8]>)> {
    let (mut sample, mut sequence) = (Vec::with_capacity(packet.len()), None);
    let mut rest = packet;
    while let Some(first) = rest.first() {
        let kind = first >> 3 & 15;
        let (has_extension, has_length) = (first & 4 != 0, first & 2 != 0);
        let start = 1 + usize::from(has_extension);
        let (length, digits) = { rest.get(start..).filter(|_| has_length) }
            .and_then(leb128)
            .ok_or_else(|| damaged("an OBU without a length"))?;
        let whole = start + digits + length;
        let obu = rest.get(..whole).ok_or_else(|| damaged("a cut OBU"))?;
        match kind {
            TEMPORAL_DELIMITER => {}
            SEQUENCE_HEADER => {
                sequence = sequence.or(Some(obu));
                sample.extend(obu);
            }
            _ => sample.extend(obu),
        }
        rest = &rest[whole..];
    }
    Ok((sample, sequence))
}

impl Track {
    /// Returns what precedes the samples in the file: all boxes, and the head of the box with the samples.
    pub(super) fn head(&self) -> Result<Vec<u8>> {
        let brands = of(b"ftyp", &[b"isom", &[0, 0, 2, 0], b"isomiso2av01mp41"]);
        let data: u64 = self.samples.iter().map(|own| u64::from(own.bytes)).sum();
        // A length of 64 bits stands after the name.
        const HEAD: u64 = 16;
        let start = |index: usize| brands.len() as u64 + index as u64 + HEAD;
        // The length of the boxes does not depend on the position in them.
        let length = self.index(0)?.len();
        let mut bytes = self.index(start(length))?;
        bytes.splice(..0, brands.iter().copied());
        bytes.extend(1_u32.to_be_bytes());
        bytes.extend(b"mdat");
        bytes.extend((data + HEAD).to_be_bytes());
        Ok(bytes)
    }

    /// Returns the box of the track's tables.
    ///
    /// - `start`: position of the first sample in the file.
    fn index(&self, start: u64) -> Result<Vec<u8>> {
        let count = self.samples.len();
        let pictures = u32::try_from(count).ok();
        let ticks = pictures.and_then(|n| n.checked_mul(TICKS));
        let (pictures, ticks) = pictures
            .zip(ticks)
            .ok_or_else(|| damaged("too many pictures"))?;
        let scale = u32::from(self.rate) * TICKS;
        let [width, height] = self.size.map(u32::from);
        // Creation, change, units a second, duration, speed 1, volume 1.
        let movie = words([0, 0, 0, scale, ticks, 0x1_0000, 0x0100_0000, 0, 0]);
        let last = words([0, 0, 0, 0, 0, 0, 2]);
        let movie = of(b"mvhd", &[&movie, &words(IDENTITY), &last]);
        // Flags: enabled, and in the movie. Track 1.
        let track = words([3, 0, 0, 1, 0, ticks, 0, 0, 0, 0]);
        let shown = words([width << 16, height << 16]);
        let track = of(b"tkhd", &[&track, &words(IDENTITY), &shown]);
        // The language is undetermined.
        let media = of(b"mdhd", &[&words([0, 0, 0, scale, ticks, 0x55C4_0000])]);
        let handler = of(b"hdlr", &[&words([0, 0]), b"vide", &[0; 12], b"film\0"]);
        let kind = of(b"vmhd", &[&words([1, 0, 0])]);
        // The data are in this file.
        let own = of(b"url ", &[&words([1])]);
        let place = of(b"dinf", &[&of(b"dref", &[&words([0, 1]), &own])]);
        let keys = (1_u32..).zip(&self.samples);
        let keys: Vec<u32> = keys.filter(|(_, own)| own.is_key).map(|(i, _)| i).collect();
        let tables = [
            of(b"stsd", &[&words([0, 1]), &self.description()?]),
            table(b"stts", 1, [pictures, TICKS]),
            table(b"stss", keys.len(), keys.iter().copied()),
            // One chunk holds all samples.
            table(b"stsc", 1, [1, pictures, 1]),
            of(
                b"stsz",
                &[
                    &words([0, 0, pictures]),
                    &words(self.samples.iter().map(|own| own.bytes)),
                ],
            ),
            of(b"co64", &[&words([0, 1]), &start.to_be_bytes()]),
        ];
        let tables = tables.each_ref().map(Vec::as_slice);
        let inner = of(b"minf", &[&kind, &place, &of(b"stbl", &tables)]);
        let media = of(b"mdia", &[&media, &handler, &inner]);
        Ok(of(b"moov", &[&movie, &of(b"trak", &[&track, &media])]))
    }

    /// Returns the description of the samples: size, coding, colours.
    fn description(&self) -> Result<Vec<u8>> {
        let [width, height] = self.size.map(u16::to_be_bytes);
        // Six reserved bytes, the first data reference; 16 more; the size; 72 dots an inch.
        let head = [
            &[0, 0, 0, 0, 0, 0, 0, 1][..],
            &[0; 16],
            &width,
            &height,
            &words([0x48_0000, 0x48_0000, 0]),
            // One picture a sample; no name of a program; 24 bits; no table of colours.
            &[0, 1],
            &[0; 32],
            &[0, 24, 0xFF, 0xFF],
        ];
        let coding = of(b"av1C", &[&self.configuration()?, &self.sequence]);
        // Primaries of BT.709, the curve of sRGB, the matrix of BT.709, limited range.
        let colours = of(b"colr", &[b"nclx", &[0, 1, 0, 13, 0, 1, 0]]);
        let square = of(b"pasp", &[&words([1, 1])]);
        let mut parts = head.to_vec();
        parts.extend([&coding[..], &colours, &square]);
        Ok(of(b"av01", &parts))
    }

    /// Returns the four bytes of AV1's configuration, as the sequence header has them: version 1, the profile, the level,
    /// the tier, 8 bits in 4:2:0 with chroma at even columns.
    fn configuration(&self) -> Result<[u8; 4]> {
        let wrong = || damaged("a sequence header of another kind");
        let (_, digits) = self.sequence.get(1..).and_then(leb128).ok_or_else(wrong)?;
        let head = self
            .sequence
            .get(1 + digits..)
            .and_then(|bytes| bytes.first_chunk::<4>());
        let bits = u32::from_be_bytes(*head.ok_or_else(wrong)?);
        // From the left: 3 bits of the profile, a still picture, a reduced header, timing, a delay of display, 5 of the
        // number of operating points, 12 of the first of these, 5 of its level, 1 of its tier.
        let profile = bits >> 29;
        if bits >> 20 & 0x1FF != 0 || profile != 0 {
            return Err(wrong());
        }
        let level = bits >> 3 & 31;
        // Low levels have one tier, and no bit for it.
        let tier = if level > 7 { bits >> 2 & 1 } else { 0 };
        let [level, tier] = [level, tier].map(|n| u8::try_from(n).unwrap_or(0));
        Ok([0x81, level, tier << 7 | 0b0000_1101, 0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sequence header of AV1 as its standard has it: profile 0, no timing, one operating point of level 4.0, the low tier.
    const SEQUENCE: [u8; 6] = [0x0A, 4, 0, 0, 0x00, 0x40];

    #[test]
    fn samples_have_no_temporal_delimiters() {
        let frame = [0x32, 2, 7, 7];
        let packet = [&[0x12, 0][..], &SEQUENCE, &frame].concat();
        let (sample, sequence) = sample_of(&packet).unwrap();
        assert_eq!(sample, [&SEQUENCE[..], &frame].concat());
        assert_eq!(sequence, Some(&SEQUENCE[..]));
        for cut in 1..packet.len() {
            let is_whole = [2, 8].contains(&cut);
            assert_eq!(sample_of(&packet[..cut]).is_ok(), is_whole, "{cut}");
        }
        assert!(sample_of(&[0x30, 7]).is_err());
    }

    #[test]
    fn the_first_sample_is_where_the_index_says() {
        let sample = |bytes, is_key| Sample { bytes, is_key };
        let track = Track {
            size: [33, 17],
            rate: 25,
            samples: vec![sample(10, true), sample(4, false), sample(6, true)],
            sequence: SEQUENCE.to_vec(),
        };
        let head = track.head().unwrap();
        let after = |name: &[u8]| {
            let at = head.windows(4).position(|own| own == name).unwrap() + 4;
            &head[at..]
        };
        let start = after(b"co64")[8..16].try_into().unwrap();
        assert_eq!(u64::from_be_bytes(start), head.len() as u64);
        assert_eq!(after(b"mdat")[..8], 36_u64.to_be_bytes());
        assert_eq!(after(b"av1C")[..4], [0x81, 8, 0x0D, 0]);
        assert_eq!(after(b"stss")[..16], words([0, 2, 1, 3]));
        let longer = |rate| Track {
            rate,
            samples: vec![sample(1, true); 5_000_000],
            ..track.clone()
        };
        assert!(longer(25).head().is_err());
    }
}
