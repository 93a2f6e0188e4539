//! Opens the files of a case: in a folder, or in a ZIP archive.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::text::CaseFile;
use crate::error::{Error, Result};
use crate::io::bytes::zip::{self, Entry};
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::volume::voxels::GZIP;

/// The file that every case has; the parent of its folder is the case.
pub(super) const CONTROL: &str = "system/controlDict";

/// A case.
pub(super) enum Case<'a> {
    Folder(PathBuf),
    Archive {
        path: &'a Path,
        entries: Vec<Entry<'a>>,
        /// Prefix of the names of the case's members.
        root: String,
    },
}

/// The folders of the cases in an archive: empty, or with a `/` at the end.
pub(super) fn roots<'e>(entries: &'e [Entry<'_>]) -> impl Iterator<Item = &'e str> {
    entries.iter().filter_map(|entry| {
        let root = entry.name.strip_suffix(CONTROL)?;
        (root.is_empty() || root.ends_with('/')).then_some(root)
    })
}

impl<'a> Case<'a> {
    /// The first case of an archive, and the folders of the others.
    ///
    /// # Errors
    /// A broken archive, one that claims more than its bytes can hold, or one without a case.
    pub(super) fn of_archive(path: &'a Path, bytes: &'a [u8]) -> Result<(Self, Vec<String>)> {
        let broken = |found: String| {
            let advice = "pack the case's folder again";
            Error::format(path, "ZIP archive", "an OpenFOAM case", found, advice)
        };
        let entries = zip::entries(bytes).map_err(broken)?;
        let mut packed_total: u64 = 0;
        for entry in &entries {
            // Members that share their bytes would multiply them.
            let packed = entry.packed.len() as u64;
            packed_total = packed_total.saturating_add(packed);
            let most = packed.saturating_mul(DEFLATE_RATIO);
            if packed_total > bytes.len() as u64 || entry.size > most {
                let shown: String = entry.name.chars().take(40).collect();
                let size = entry.size;
                return Err(broken(format!(
                    "`{shown}` with {size} bytes packed into {packed}"
                )));
            }
        }
        let mut roots = roots(&entries).map(str::to_owned);
        let root = roots.next();
        let others = roots.collect();
        let root = root.ok_or_else(|| broken(format!("no `{CONTROL}`")))?;
        Ok((
            Self::Archive {
                path,
                entries,
                root,
            },
            others,
        ))
    }

    /// The names in a folder of the case (`` is the case itself), sorted, without the `.gz` of compressed
    /// files; empty if there is no such folder.
    pub(super) fn list(&self, folder: &str) -> Vec<String> {
        let mut names = BTreeSet::new();
        let mut add = |name: &str| {
            names.insert(name.strip_suffix(".gz").unwrap_or(name).to_owned());
        };
        match self {
            Self::Folder(root) => {
                let entries = std::fs::read_dir(root.join(folder)).into_iter().flatten();
                let named = entries.flatten().map(|entry| entry.file_name());
                named
                    .filter_map(|name| name.into_string().ok())
                    .for_each(|name| add(&name));
            }
            Self::Archive { entries, root, .. } => {
                let begin = match folder {
                    "" => root.clone(),
                    _ => format!("{root}{folder}/"),
                };
                let below = entries.iter().filter_map(|e| e.name.strip_prefix(&begin));
                let first = below.filter_map(|rest| rest.split('/').next());
                first.filter(|name| !name.is_empty()).for_each(&mut add);
            }
        }
        names.into_iter().collect()
    }

    /// The path that errors report.
    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        match self {
            Self::Folder(root) => root.join(name),
            Self::Archive { path, .. } => path.to_path_buf(),
        }
    }

    /// Whether there is a file of this name, compressed or not.
    pub(super) fn has(&self, name: &str) -> bool {
        self.found(name).is_some()
    }

    /// The name itself, or with `.gz`.
    fn found(&self, name: &str) -> Option<String> {
        let is_there = |name: &String| match self {
            Self::Folder(root) => root.join(name).is_file(),
            Self::Archive { entries, root, .. } => entries
                .iter()
                .any(|e| e.name.strip_prefix(root.as_str()) == Some(name)),
        };
        [name.to_owned(), format!("{name}.gz")]
            .into_iter()
            .find(is_there)
    }

    /// A file of the case, unpacked; `None` if there is none of this name.
    ///
    /// # Errors
    /// Errors of the system or of the archive.
    pub(super) fn read(&self, name: &str) -> Result<Option<CaseFile>> {
        let Some(found) = self.found(name) else {
            return Ok(None);
        };
        let path = self.path_of(&found);
        let bytes = match self {
            Self::Folder(_) => crate::io::bytes::file::read_all(&path)?,
            Self::Archive { entries, root, .. } => {
                let is_it = |e: &&Entry<'_>| e.name.strip_prefix(root.as_str()) == Some(&found);
                let entry = entries.iter().find(is_it);
                let unpacked = entry.map_or(Ok(Vec::new()), Entry::unpack);
                unpacked.map_err(|fault| broken(&path, &found, fault))?
            }
        };
        let bytes = match bytes.starts_with(GZIP) {
            true => unpack(&bytes).map_err(|fault| broken(&path, &found, fault))?,
            false => bytes,
        };
        Ok(Some(CaseFile {
            path,
            name: name.to_owned(),
            bytes,
        }))
    }
}

fn broken(path: &Path, name: &str, fault: String) -> Error {
    let advice = "copy the case again";
    Error::format(path, name, "a sound packed file", fault, advice)
}

fn unpack(packed: &[u8]) -> Result<Vec<u8>, String> {
    let most = (packed.len() as u64).saturating_mul(DEFLATE_RATIO);
    let mut bytes = Vec::new();
    let stream = flate2::read::MultiGzDecoder::new(packed);
    let read = stream.take(most).read_to_end(&mut bytes);
    read.map_err(|e| e.to_string())?;
    Ok(bytes)
}
