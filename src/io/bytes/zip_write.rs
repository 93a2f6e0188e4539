//! Writes ZIP archives with stored (not compressed) members, for data that are compressed already. `zip.rs`
//! reads the same records.

use flate2::Crc;

/// The format version that a reader must support: 2.0.
const VERSION: [u8; 2] = [20, 0];

/// Flag: names are UTF-8.
const FLAGS: [u8; 2] = [0, 8];

/// Method 0 (stored), and the earliest time and day, so that equal contents give equal archives.
const STORED_AT_THE_START: [u8; 6] = [0, 0, 0, 0, 0x21, 0];

/// An archive of members, with their names; `None` if counts or sizes exceed the format's fields.
pub(in crate::io) fn stored(members: &[(&str, &[u8])]) -> Option<Vec<u8>> {
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
        // No extra field.
        common.extend([0; 2]);

        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(name.as_bytes());
        archive.extend(*bytes);

        directory.extend(b"PK\x01\x02");
        directory.extend(VERSION);
        directory.extend(&common);
        // No comment, on the first disk, no attributes.
        directory.extend([0; 10]);
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

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// Read by another library, and by this one.
    #[test]
    fn archives_are_read_by_others() {
        let members: [(&str, &[u8]); 3] = [("a.json", b"{}"), ("ü", b""), ("c", &[7; 300])];
        let bytes = stored(&members).unwrap();
        let mut archive = ::zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
        assert_eq!(archive.len(), 3);
        for (name, expected) in members {
            let mut found = Vec::new();
            let mut member = archive.by_name(name).unwrap();
            member.read_to_end(&mut found).unwrap();
            assert_eq!(found, expected);
        }
        let entries = super::super::zip::entries(&bytes).unwrap();
        let found = entries
            .iter()
            .map(|e| (e.name.as_str(), e.unpack().unwrap()));
        let expected = members.map(|(name, bytes)| (name, bytes.to_vec()));
        assert_eq!(found.collect::<Vec<_>>(), expected);
    }
}
