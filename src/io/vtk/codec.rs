//! Decompresses the blocks of VTK XML files.
//!
//! | `compressor` | each block is |
//! |---|---|
//! | `vtkZLibDataCompressor` | a zlib stream |
//! | `vtkLZ4DataCompressor` | an LZ4 block, without a frame |
//! | `vtkLZMADataCompressor` | an .xz stream |

use std::io::Read;

use flate2::read::ZlibDecoder;
use lzma_rust2::XzReader;

use crate::io::volume::raw::DEFLATE_RATIO;

/// Greatest number of bytes that one byte of an LZ4 block can decode to: a byte that lengthens a match.
const LZ4_RATIO: u64 = 255;

/// A bound on the number of bytes that one byte of any of these can decode to.
pub(in crate::io) const MOST_RATIO: u64 = XZ_RATIO;

/// A bound on the number of bytes that one byte of an .xz stream can decode to. Its shortest code for 273
/// bytes, the longest match, is 14 bits of probability 2017/2048 each, the extreme that an adaptive bit
/// reaches: 0.31 bits, that is 7090 bytes per byte.
const XZ_RATIO: u64 = 8192;

/// Compression of a file's blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Codec {
    Zlib,
    Lz4,
    Xz,
}

impl Codec {
    /// The names that a file may have.
    pub(in crate::io) const NAMES: &str =
        "vtkZLibDataCompressor, vtkLZ4DataCompressor or vtkLZMADataCompressor";

    pub(in crate::io) fn from_name(name: &str) -> Option<Self> {
        match name {
            "vtkZLibDataCompressor" => Some(Self::Zlib),
            "vtkLZ4DataCompressor" => Some(Self::Lz4),
            "vtkLZMADataCompressor" => Some(Self::Xz),
            _ => None,
        }
    }

    /// The name, for people.
    pub(in crate::io) fn name(self) -> &'static str {
        match self {
            Self::Zlib => "zlib",
            Self::Lz4 => "LZ4",
            Self::Xz => "LZMA",
        }
    }

    /// Greatest number of bytes that one compressed byte can decode to.
    pub(in crate::io) fn ratio(self) -> u64 {
        match self {
            Self::Zlib => DEFLATE_RATIO,
            Self::Lz4 => LZ4_RATIO,
            Self::Xz => XZ_RATIO,
        }
    }

    /// Appends the bytes of one block, never more than one beyond `wanted`.
    ///
    /// # Errors
    /// The decoder's message.
    pub(in crate::io) fn decode(
        self,
        block: &[u8],
        wanted: usize,
        bytes: &mut Vec<u8>,
    ) -> Result<(), String> {
        let limit = (wanted as u64).saturating_add(1);
        let read = |reader: &mut dyn Read, bytes: &mut Vec<u8>| {
            let result = reader.take(limit).read_to_end(bytes);
            result.map(drop).map_err(|e| e.to_string())
        };
        match self {
            Self::Zlib => read(&mut ZlibDecoder::new(block), bytes),
            Self::Xz => read(&mut XzReader::new(block, false), bytes),
            Self::Lz4 => {
                let start = bytes.len();
                bytes.resize(start + wanted, 0);
                let found = lz4_flex::block::decompress_into(block, &mut bytes[start..])
                    .map_err(|e| e.to_string())?;
                bytes.truncate(start + found);
                Ok(())
            }
        }
    }
}
