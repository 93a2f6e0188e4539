//! The compressors of VTK XML files.
//!
//! | `compressor` | each block is |
//! |---|---|
//! | `vtkZLibDataCompressor` | a zlib stream |
//! | `vtkLZ4DataCompressor` | an LZ4 block, without a frame |
//! | `vtkLZMADataCompressor` | an .xz stream |

use std::io::Read;

use flate2::read::ZlibDecoder;
use lzma_rust2::XzReader;

use super::raw::DEFLATE_RATIO;

/// The most bytes that one byte of an LZ4 block can stand for: a byte that lengthens a match.
const LZ4_RATIO: u64 = 255;

/// More bytes than one byte of any of these can stand for.
pub(super) const MOST_RATIO: u64 = XZ_RATIO;

/// More bytes than one byte of an .xz stream can stand for. Its shortest code for 273 bytes, the
/// longest match, is 14 bits of probability 2017/2048 each, the extreme that an adaptive bit
/// reaches: 0.31 bits, that is 7090 bytes to a byte.
const XZ_RATIO: u64 = 8192;

/// How the blocks of a file are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    Zlib,
    Lz4,
    Xz,
}

impl Codec {
    /// The names that a file may give.
    pub(super) const NAMES: &str =
        "vtkZLibDataCompressor, vtkLZ4DataCompressor or vtkLZMADataCompressor";

    pub(super) fn from_name(name: &str) -> Option<Self> {
        match name {
            "vtkZLibDataCompressor" => Some(Self::Zlib),
            "vtkLZ4DataCompressor" => Some(Self::Lz4),
            "vtkLZMADataCompressor" => Some(Self::Xz),
            _ => None,
        }
    }

    /// The name, for people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Zlib => "zlib",
            Self::Lz4 => "LZ4",
            Self::Xz => "LZMA",
        }
    }

    /// How many bytes one compressed byte can stand for at most.
    pub(super) fn ratio(self) -> u64 {
        match self {
            Self::Zlib => DEFLATE_RATIO,
            Self::Lz4 => LZ4_RATIO,
            Self::Xz => XZ_RATIO,
        }
    }

    /// Appends the bytes of one block, never more than one beyond `wanted`.
    ///
    /// # Errors
    /// What the decoder says.
    pub(super) fn decode(
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
