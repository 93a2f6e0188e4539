//! Reads ZIP archives, as far as NPZ, SOG, 3MF and USDZ files and archives of OpenFOAM's folders need them: members
//! stored or deflated, with sizes of 32 or 64 bits.
//!
//! Records, all numbers little-endian (PKWARE's APPNOTE, sections 4.3.7 to 4.3.16):
//!
//! | record | signature | what is read from it |
//! |---|---|---|
//! | end of the directory, last in the file but for a comment | `PK\5\6` | offset of the directory |
//! | its 64-bit form, and that form's locator | `PK\6\6`, `PK\6\7` | the same, if 32 bits are not enough |
//! | an entry of the directory | `PK\1\2` | name, method, checksum, sizes, offset |
//! | a member's own header | `PK\3\4` | offset of its bytes |
//!
//! Nothing is allocated that the archive's bytes cannot hold: entries borrow theirs.

use std::borrow::Cow;
use std::io::Read;

/// The first bytes of every archive that is not empty.
pub(in crate::io) const MAGIC: &[u8] = b"PK\x03\x04";

/// A member, still packed.
#[derive(Debug)]
pub(in crate::io) struct Entry<'a> {
    pub(in crate::io) name: String,
    pub(in crate::io) packed: &'a [u8],
    /// Stated size when unpacked, in bytes.
    pub(in crate::io) size: u64,
    method: u16,
    checksum: u32,
}

/// The value of a 32-bit field that refers to a 64-bit one.
const ELSEWHERE: u64 = 0xffff_ffff;

/// The number in 2, 4 or 8 bytes at an offset.
fn number(bytes: &[u8], at: usize, size: usize) -> Option<u64> {
    let digits = bytes.get(at..at.checked_add(size)?)?;
    Some(digits.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b)))
}

/// The number at an offset, as an offset or a length.
fn place(bytes: &[u8], at: usize, size: usize) -> Option<usize> {
    usize::try_from(number(bytes, at, size)?).ok()
}

/// The bytes after a record's signature; `None` if it is not there.
fn record<'a>(bytes: &'a [u8], at: usize, signature: &[u8; 4]) -> Option<&'a [u8]> {
    bytes.get(at..)?.strip_prefix(signature)
}

/// The members of an archive, in the order of its directory.
///
/// # Errors
/// A phrase with the fault.
pub(in crate::io) fn entries(bytes: &[u8]) -> Result<Vec<Entry<'_>>, String> {
    let (mut directory, count) = directory(bytes).ok_or("no directory of members at its end")?;
    let mut entries = Vec::new();
    for index in 0..count {
        let (entry, rest) = entry(bytes, directory)
            .ok_or_else(|| format!("a broken entry {index} of its directory of {count}"))?;
        entries.push(entry);
        directory = rest;
    }
    Ok(entries)
}

/// The directory's bytes and the number of its entries.
fn directory(bytes: &[u8]) -> Option<(&[u8], u64)> {
    const LEAST: usize = 22;
    let last = bytes.len().checked_sub(LEAST)?;
    // A comment follows, with its length in 16 bits.
    let is_end = |&at: &usize| {
        record(bytes, at, b"PK\x05\x06").is_some() && place(bytes, at + 20, 2) == Some(last - at)
    };
    let end = (last.saturating_sub(0xffff)..=last).rev().find(is_end)?;
    let mut count = number(bytes, end + 10, 2)?;
    let mut size = place(bytes, end + 12, 4)?;
    let mut start = place(bytes, end + 16, 4)?;
    let locator = end.checked_sub(20);
    if let Some(at) = locator.filter(|&at| record(bytes, at, b"PK\x06\x07").is_some()) {
        let at = place(bytes, at + 8, 8)?;
        record(bytes, at, b"PK\x06\x06")?;
        count = number(bytes, at.checked_add(32)?, 8)?;
        size = place(bytes, at.checked_add(40)?, 8)?;
        start = place(bytes, at.checked_add(48)?, 8)?;
    }
    Some((bytes.get(start..start.checked_add(size)?)?, count))
}

/// The first entry of a directory, and the rest of it.
fn entry<'a>(bytes: &'a [u8], directory: &'a [u8]) -> Option<(Entry<'a>, &'a [u8])> {
    const HEADER: usize = 46;
    record(directory, 0, b"PK\x01\x02")?;
    let flags = number(directory, 8, 2)?;
    let method = u16::try_from(number(directory, 10, 2)?).ok()?;
    let checksum = u32::try_from(number(directory, 16, 4)?).ok()?;
    let mut sizes = [number(directory, 24, 4)?, number(directory, 20, 4)?];
    let mut start = number(directory, 42, 4)?;
    let [name, extra, comment] = [28, 30, 32].map(|at| place(directory, at, 2));
    let (name, rest) = directory.get(HEADER..)?.split_at_checked(name?)?;
    let (mut extra, rest) = rest.split_at_checked(extra?)?;
    let rest = rest.get(comment?..)?;
    while let (Some(id), Some(length)) = (number(extra, 0, 2), place(extra, 2, 2)) {
        let (field, others) = extra.get(4..)?.split_at_checked(length)?;
        extra = others;
        if id == 1 {
            // 64-bit fields, in this order, for those that do not fit into 32 bits.
            let mut at = 0;
            for small in sizes.iter_mut().chain([&mut start]) {
                if *small == ELSEWHERE {
                    *small = number(field, at, 8)?;
                    at += 8;
                }
            }
        }
    }
    let [size, packed] = sizes;
    // Encrypted members cannot be unpacked.
    let is_plain = flags & 1 == 0;
    let own = usize::try_from(start).ok().filter(|_| is_plain)?;
    record(bytes, own, b"PK\x03\x04")?;
    let own_name = place(bytes, own.checked_add(26)?, 2)?;
    let own_extra = place(bytes, own.checked_add(28)?, 2)?;
    let first = own.checked_add(30 + own_name + own_extra)?;
    let packed = bytes.get(first..first.checked_add(usize::try_from(packed).ok()?)?)?;
    let name = match std::str::from_utf8(name) {
        Ok(name) => name.to_owned(),
        // In old code pages, the first half is ASCII.
        Err(_) => name.iter().map(|&b| char::from(b)).collect(),
    };
    let entry = Entry {
        name,
        packed,
        size,
        method,
        checksum,
    };
    Some((entry, rest))
}

impl<'a> Entry<'a> {
    /// Unpacks the member. At most [`size`](Self::size) bytes are allocated: check that before.
    ///
    /// # Errors
    /// A phrase with the fault.
    pub(in crate::io) fn unpack(&self) -> Result<Vec<u8>, String> {
        self.contents().map(Cow::into_owned)
    }

    /// Unpacks the member as [`unpack`](Self::unpack) does, or borrows what is stored.
    ///
    /// # Errors
    /// A phrase with the fault.
    pub(in crate::io) fn contents(&self) -> Result<Cow<'a, [u8]>, String> {
        let bytes = match self.method {
            0 => Cow::Borrowed(self.packed),
            8 => {
                let mut bytes = Vec::new();
                let mut stream = flate2::read::DeflateDecoder::new(self.packed)
                    .take(self.size.saturating_add(1));
                stream.read_to_end(&mut bytes).map_err(|e| e.to_string())?;
                Cow::Owned(bytes)
            }
            other => return Err(format!("packed by method {other}, not stored or deflated")),
        };
        if bytes.len() as u64 != self.size {
            return Err(format!("not the {} bytes that it states", self.size));
        }
        let mut checksum = flate2::Crc::new();
        checksum.update(&bytes);
        if checksum.sum() != self.checksum {
            return Err("a wrong checksum".into());
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use ::zip::write::SimpleFileOptions;
    use ::zip::{CompressionMethod, ZipWriter};

    use super::*;

    /// An archive from another writer, with a comment at its end.
    fn archive(method: CompressionMethod, large: bool) -> Vec<u8> {
        let mut writer = ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default()
            .compression_method(method)
            .large_file(large);
        for (name, bytes) in members() {
            writer.start_file(name, options).unwrap();
            writer.write_all(&bytes).unwrap();
        }
        writer.set_comment("PK\x05\x06 in a comment").unwrap();
        writer.finish().unwrap().into_inner()
    }

    fn members() -> [(&'static str, Vec<u8>); 3] {
        [
            ("a.npy", b"first ".repeat(100)),
            ("b/ü.npy", vec![]),
            ("c", vec![7]),
        ]
    }

    fn unpacked(bytes: &[u8]) -> Result<Vec<(String, Vec<u8>)>, String> {
        let unpack = |entry: &Entry<'_>| Ok((entry.name.clone(), entry.unpack()?));
        entries(bytes)?.iter().map(unpack).collect()
    }

    #[test]
    fn archives_of_an_outside_writer_are_read() {
        let expected = members().map(|(name, bytes)| (name.to_owned(), bytes));
        for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
            for large in [false, true] {
                let found = unpacked(&archive(method, large)).unwrap();
                assert_eq!(found, expected, "{method:?}, {large}");
            }
        }
    }

    /// 64-bit sizes and offsets, to which the 32-bit fields refer, as in archives beyond 4 GiB.
    #[test]
    fn numbers_of_64_bits_are_read() {
        let mut bytes = b"PK\x03\x04".to_vec();
        bytes.resize(26, 0);
        bytes.extend([1, 0, 3, 0]);
        bytes.extend(b"xABCdata");
        let start = bytes.len() as u64;
        let mut checksum = flate2::Crc::new();
        checksum.update(b"data");
        bytes.extend(b"PK\x01\x02");
        bytes.resize(bytes.len() + 12, 0);
        bytes.extend(checksum.sum().to_le_bytes());
        bytes.extend([0xff; 8]);
        bytes.extend([1, 0, 34, 0]);
        bytes.resize(bytes.len() + 10, 0);
        bytes.extend([0xff; 4]);
        bytes.push(b'x');
        // Another field, then both sizes and the offset.
        bytes.extend([9, 9, 2, 0, 1, 2, 1, 0, 24, 0]);
        bytes.extend([4_u64, 4, 0].map(u64::to_le_bytes).concat());
        let size = bytes.len() as u64 - start;
        let end = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.resize(bytes.len() + 28, 0);
        bytes.extend([1_u64, size, start].map(u64::to_le_bytes).concat());
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(end.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(b"PK\x05\x06\0\0\0\0");
        bytes.extend([0xff; 12]);
        bytes.extend([0, 0]);
        let expected = [("x".to_owned(), b"data".to_vec())];
        assert_eq!(unpacked(&bytes).unwrap(), expected);
    }

    #[test]
    fn damage_is_told_of() {
        let whole = archive(CompressionMethod::Deflated, false);
        for length in 0..whole.len() {
            assert!(unpacked(&whole[..length]).is_err(), "{length}");
        }
        let expected = unpacked(&whole).unwrap();
        for at in 0..whole.len() {
            for mask in [1, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[at] ^= mask;
                // Names, dates and comments have no checksum: contents do.
                for ((_, found), (_, expected)) in unpacked(&bytes).iter().flatten().zip(&expected)
                {
                    assert_eq!(found, expected, "{at}");
                }
            }
        }
        let encrypted = whole.windows(4).position(|w| w == b"PK\x01\x02").unwrap() + 8;
        let mut bytes = whole.clone();
        bytes[encrypted] |= 1;
        assert!(entries(&bytes).unwrap_err().contains("entry 0"));
        let mut bytes = whole.clone();
        bytes[encrypted + 2] = 12;
        assert!(unpacked(&bytes).unwrap_err().contains("method 12"));
    }
}
