//! Writes ZIP archives with stored (not compressed) members, for data that are compressed already. `zip.rs`
//! reads the same records.

use flate2::Crc;

/// The format version that a reader must support: 2.0.
const VERSION: [u8; 2] = [20, 0];

/// Flag: names are UTF-8.
const FLAGS: [u8; 2] = [0, 8];

/// Method 0 (stored), and the earliest time and day, so that equal contents give equal archives.
const STORED_AT_THE_START: [u8; 6] = [0, 0, 0, 0, 0x21, 0];

/// Length of a member's own header without its name.
const HEADER: usize = 30;

/// Number of the extra field that pads headers, as in USDZ archives.
const PADDING: [u8; 2] = [0x86, 0x19];

/// An archive of members, with their names; `None` if counts or sizes exceed the format's fields.
pub(in crate::io) fn stored(members: &[(&str, &[u8])]) -> Option<Vec<u8>> {
    aligned(members, 1)
}

/// An archive whose members' bytes begin at multiples of `alignment`; `None` as from [`stored`].
pub(in crate::io) fn aligned(members: &[(&str, &[u8])], alignment: usize) -> Option<Vec<u8>> {
    let mut archive = Vec::new();
    let mut directory = Vec::new();
    for (name, bytes) in members {
        let start = u32::try_from(archive.len()).ok()?.to_le_bytes();
        let size = u32::try_from(bytes.len()).ok()?.to_le_bytes();
        let name_length = u16::try_from(name.len()).ok()?.to_le_bytes();
        let mut checksum = Crc::new();
        checksum.update(bytes);
        let mut common = [VERSION, FLAGS].concat();
        common.extend(STORED_AT_THE_START);
        common.extend(checksum.sum().to_le_bytes());
        common.extend([size, size].concat());
        common.extend(name_length);
        let extra = padding(archive.len() + HEADER + name.len(), alignment)?;
        let extra_length = u16::try_from(extra.len()).ok()?.to_le_bytes();

        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(extra_length);
        archive.extend(name.as_bytes());
        archive.extend(extra);
        archive.extend(*bytes);

        directory.extend(b"PK\x01\x02");
        directory.extend(VERSION);
        directory.extend(&common);
        // No extra field, no comment, on the first disk, no attributes.
        directory.extend([0; 12]);
        directory.extend(start);
        directory.extend(name.as_bytes());
    }
    let count = u16::try_from(members.len()).ok()?.to_le_bytes();
    let start = u32::try_from(archive.len()).ok()?.to_le_bytes();
    let size = u32::try_from(directory.len()).ok()?.to_le_bytes();
    archive.append(&mut directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend([count, count].concat());
    archive.extend([size, start].concat());
    archive.extend([0; 2]);
    Some(archive)
}

/// The extra field with which bytes at `start` move to a multiple of `alignment`; empty if they lie there.
fn padding(start: usize, alignment: usize) -> Option<Vec<u8>> {
    if start.is_multiple_of(alignment) {
        return Some(Vec::new());
    }
    // A field has a number and a length, two bytes each.
    let length = (start + 4).next_multiple_of(alignment) - start;
    let mut field = PADDING.to_vec();
    field.extend(u16::try_from(length - 4).ok()?.to_le_bytes());
    field.resize(length, 0);
    Some(field)
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// Read by another library, and by this one.
    #[test]
    fn archives_are_read_by_others() {
        let members: [(&str, &[u8]); 3] = [("a.json", b"{}"), ("ü", b""), ("c", &[7; 300])];
        for alignment in [1, 64] {
            let bytes = aligned(&members, alignment).unwrap();
            let mut archive = ::zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
            assert_eq!(archive.len(), 3);
            for (name, expected) in members {
                let mut found = Vec::new();
                let mut member = archive.by_name(name).unwrap();
                member.read_to_end(&mut found).unwrap();
                assert_eq!(found, expected);
                let start = usize::try_from(member.data_start().unwrap()).unwrap();
                assert!(start.is_multiple_of(alignment), "{name}: {start}");
            }
            let entries = super::super::zip::entries(&bytes).unwrap();
            let found = entries
                .iter()
                .map(|e| (e.name.as_str(), e.unpack().unwrap()));
            let expected = members.map(|(name, bytes)| (name, bytes.to_vec()));
            assert_eq!(found.collect::<Vec<_>>(), expected);
        }
    }
}
