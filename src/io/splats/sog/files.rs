//! Opens the images of a scene: beside `meta.json`, or in the archive that contains it.

use std::borrow::Cow;

use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::zip::{self, Entry};
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::volume::voxels::beside;
use crate::io::vtk::xml::clip;

/// The file that names the images.
pub(in crate::io) const META: &str = "meta.json";

/// Whether a member of an archive is the `meta.json` of a scene.
pub(super) fn is_meta(name: &str) -> bool {
    name.rsplit('/').next() == Some(META)
}

/// Location of a scene's files.
pub(super) enum Files<'a> {
    Beside {
        input: Input<'a>,
        meta: &'a [u8],
    },
    Archive {
        input: Input<'a>,
        entries: Vec<Entry<'a>>,
        /// Prefix of the names of this scene's members.
        folder: String,
    },
}

impl<'a> Files<'a> {
    /// - `bytes`: the bytes of `input`.
    pub(super) fn of(input: Input<'a>, bytes: &'a [u8]) -> Result<Self> {
        if !bytes.starts_with(zip::MAGIC) {
            return Ok(Self::Beside { input, meta: bytes });
        }
        let entries = zip::entries(bytes).map_err(|found| broken(input, found))?;
        let names = entries.iter().map(|entry| entry.name.as_str());
        let first = names.filter(|name| is_meta(name)).min_by_key(|n| n.len());
        let Some(name) = first else {
            return Err(broken(input, format!("no `{META}`")));
        };
        let folder = name[..name.len() - META.len()].to_owned();
        Ok(Self::Archive {
            input,
            entries,
            folder,
        })
    }

    pub(super) fn meta(&self) -> Result<Cow<'a, [u8]>> {
        match self {
            Self::Beside { meta, .. } => Ok(Cow::Borrowed(meta)),
            Self::Archive { .. } => self.bytes(META).map(Cow::Owned),
        }
    }

    /// The bytes of a file that `meta.json` names.
    pub(super) fn bytes(&self, name: &str) -> Result<Vec<u8>> {
        let (input, entries, folder) = match self {
            Self::Beside { input, .. } => return input.read_beside(&beside(input.path, name)?),
            Self::Archive {
                input,
                entries,
                folder,
            } => (*input, entries, folder),
        };
        let full = format!("{folder}{name}");
        let entry = entries.iter().find(|entry| entry.name == full);
        let entry = entry.ok_or_else(|| broken(input, format!("no `{}`", clip(&full))))?;
        let packed = entry.packed.len() as u64;
        if entry.size > packed.saturating_mul(DEFLATE_RATIO) {
            let found = format!("{} bytes packed into {packed}", entry.size);
            return Err(broken(input, format!("`{}` with {found}", clip(name))));
        }
        let fault = |found| broken(input, format!("`{}`: {found}", clip(name)));
        entry.unpack().map_err(fault)
    }
}

fn broken(input: Input<'_>, found: String) -> Error {
    let expected = "a sound archive of `meta.json` and its images";
    let advice = "the file is cut off or damaged: get it again";
    Error::format(input.path, "SOG archive", expected, found, advice)
}
