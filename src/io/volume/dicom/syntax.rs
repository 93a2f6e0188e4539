//! Defines the transfer syntaxes: the layout of elements and the packing of pixels (PS3.5, annex A).

use super::data_set::Coding;

/// Packing of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    None,
    Runs,
    Jpeg,
}

/// Transfer syntax that is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Syntax {
    pub(super) coding: Coding,
    pub(super) packing: Packing,
    /// True if everything behind the first group is deflated.
    pub(super) is_deflated: bool,
}

/// Packing that is not read, with the program that unpacks it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Refused {
    pub(super) name: &'static str,
    pub(super) advice: &'static str,
}

/// Advice that fits most packings.
pub(super) const UNPACK: &str = "unpack it: `gdcmconv --raw IN OUT`";
const VIDEO: &str = "take its pictures out with a program for video";
const UNKNOWN: &str = "save it uncompressed with the program that wrote it";

impl Syntax {
    /// Syntax of files that state none.
    pub(super) const PLAIN: Self = Self {
        coding: Coding::EXPLICIT,
        packing: Packing::None,
        is_deflated: false,
    };

    /// Returns the syntax with this identifier.
    ///
    /// # Errors
    /// The syntax is not read; the error names it.
    pub(super) fn of(uid: &str) -> Result<Self, Refused> {
        let refused = |name, advice| Err(Refused { name, advice });
        let packed = |packing| {
            Ok(Self {
                packing,
                ..Self::PLAIN
            })
        };
        let Some(behind) = uid.strip_prefix("1.2.840.10008.1.2") else {
            return refused("a private one", UNKNOWN);
        };
        let coded = |coding| {
            Ok(Self {
                coding,
                ..Self::PLAIN
            })
        };
        match behind {
            "" => coded(Coding::IMPLICIT),
            // The second one has whole frames as fragments.
            ".1" | ".1.98" => Ok(Self::PLAIN),
            ".1.99" => Ok(Self {
                is_deflated: true,
                ..Self::PLAIN
            }),
            ".2" => coded(Coding {
                big_endian: true,
                ..Coding::EXPLICIT
            }),
            ".5" => packed(Packing::Runs),
            ".4.50" | ".4.51" | ".4.57" | ".4.70" => packed(Packing::Jpeg),
            ".4.80" | ".4.81" => refused("JPEG-LS", UNPACK),
            ".4.90" | ".4.91" | ".4.92" | ".4.93" => refused("JPEG 2000", UNPACK),
            ".4.94" | ".4.95" | ".4.204" | ".4.205" => {
                refused("JPIP, whose pixels are elsewhere", UNKNOWN)
            }
            ".4.201" | ".4.202" | ".4.203" => {
                refused("HTJ2K (JPEG 2000 of high throughput)", UNKNOWN)
            }
            ".4.110" | ".4.111" | ".4.112" => refused("JPEG XL", UNKNOWN),
            ".4.100" | ".4.100.1" | ".4.101" | ".4.101.1" => refused("MPEG-2 video", VIDEO),
            ".4.102" | ".4.102.1" | ".4.103" | ".4.103.1" | ".4.104" | ".4.104.1" | ".4.105"
            | ".4.105.1" | ".4.106" | ".4.106.1" => refused("MPEG-4 video", VIDEO),
            ".4.107" | ".4.108" => refused("HEVC video", VIDEO),
            _ => refused("one that is not known", UNKNOWN),
        }
    }
}
