//! Finds the files that a page needs to show data.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};

use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};

use crate::io::{Ranges, of_folder};
use crate::session::{Drawable, Said, opening, sampling};
use crate::{Error, Result};

/// Greatest number of bytes of the data of a page: a browser gives it 4 GiB, in which they are read and sampled.
const MOST_BYTES: u64 = 1 << 31;

/// A file within a page, packed.
pub(super) struct Embedded {
    /// Name relative to the folder of the file that is shown.
    pub(super) name: String,
    /// Bytes of the file.
    pub(super) bytes: u64,
    /// The file packed by gzip, in base64.
    packed: File,
    /// Characters of it.
    pub(super) characters: u64,
}

impl Embedded {
    /// Packs a file.
    ///
    /// # Errors
    /// The errors of reading and of writing temporary files.
    pub(super) fn of_file(name: String, path: &Path) -> Result<Self> {
        let failed = |e| {
            Error::io(
                path,
                "packing",
                e,
                "check the file and the folder for temporary files",
            )
        };
        let pack = || -> io::Result<Self> { Self::packed(name, &mut File::open(path)?) };
        pack().map_err(failed)
    }

    fn packed(name: String, from: &mut impl Read) -> io::Result<Self> {
        let encoder = EncoderWriter::new(tempfile::tempfile()?, &STANDARD);
        let mut encoder = GzEncoder::new(encoder, Compression::best());
        let bytes = io::copy(from, &mut encoder)?;
        let mut packed = encoder.finish()?.finish()?;
        let characters = packed.stream_position()?;
        Ok(Self {
            name,
            bytes,
            packed,
            characters,
        })
    }

    /// Writes its text.
    pub(super) fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let mut packed = &self.packed;
        packed.seek(SeekFrom::Start(0))?;
        io::copy(&mut packed, out).map(drop)
    }

    /// Describes the file.
    pub(super) fn summary(&self) -> Value {
        json!({ "name": self.name, "bytes": self.bytes, "packed": self.characters })
    }
}

/// A file on the disk, which the page will have in memory.
struct OnDisk {
    file: File,
    len: u64,
}

impl OnDisk {
    fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        Ok(Self { file, len })
    }
}

impl Ranges for OnDisk {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&self, from: u64, into: &mut [u8]) -> io::Result<()> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(from))?;
        file.read_exact(into)
    }
}

/// Packs a file and those that it names, and opens them from memory alone, as the page does.
///
/// - `opened`: files that were opened when the data were read from the disk.
/// - `step`: number of the time step, or null.
///
/// # Errors
/// Data that need files which the page cannot open, such as those of a folder that is listed; more data than a page holds;
/// the errors of reading.
pub(super) fn needed(path: &Path, opened: &[PathBuf], step: &Value) -> Result<Vec<Embedded>> {
    let main = of_folder(path);
    if main.is_dir() {
        let (expected, found) = (
            "a file, with those that it names",
            "a folder whose files are listed",
        );
        let advice =
            "name a file in it, or add --size or --error, which make kernels of what is drawn";
        return Err(Error::format(path, "page", expected, found, advice));
    }
    let folder = main.parent().unwrap_or(Path::new(""));
    let all = opened
        .iter()
        .filter_map(|own| Some((relative(own, folder)?, own.clone())));
    let all: BTreeMap<String, PathBuf> = all.collect();
    let size: u64 = all
        .values()
        .filter_map(|own| own.metadata().ok())
        .map(|meta| meta.len())
        .sum();
    if size > MOST_BYTES {
        let (expected, found) = (
            format!("at most {MOST_BYTES} bytes of data"),
            format!("{size}"),
        );
        let advice = "add --size or --error, which make kernels of what is drawn";
        return Err(Error::format(path, "page", expected, found, advice));
    }
    let name = main
        .file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default();
    let asked = RefCell::new(vec![name.clone()]);
    let beside = |wanted: &Path| {
        let wanted = relative(wanted, Path::new(""))?;
        let file = OnDisk::open(all.get(&wanted)?).ok()?;
        if !asked.borrow().contains(&wanted) {
            asked.borrow_mut().push(wanted);
        }
        Some(Box::new(file) as Box<dyn Ranges>)
    };
    let file =
        OnDisk::open(&main).map_err(|e| Error::io(&main, "reading", e, "check its permissions"))?;
    let settings = match step {
        Value::Null => "{}".to_owned(),
        step => json!({ "time_step": step }).to_string(),
    };
    let both = Said::all(Some(&settings), |said| {
        Ok((opening(said)?, sampling(said)?))
    });
    let (how, sampling) = both.map_err(|e| {
        Error::invalid(
            "page",
            "settings",
            "a time step",
            e.to_string(),
            "report this",
        )
    })?;
    let drawable = Drawable::open_with(&name, &file, &beside, &how, &sampling);
    drawable.map_err(|error| {
        let advice =
            "name another file, or add --size or --error, which make kernels of what is drawn";
        Error::format(
            path,
            "opening as the page does",
            "files that it names, read from memory",
            error.to_string(),
            advice,
        )
    })?;
    let path_of = |name: &String| {
        if *name == asked.borrow()[0] {
            Some(main.to_path_buf())
        } else {
            all.get(name).cloned()
        }
    };
    let names = asked.borrow().clone();
    let named = names
        .iter()
        .filter_map(|name| Some((name.clone(), path_of(name)?)));
    named
        .map(|(name, path)| Embedded::of_file(name, &path))
        .collect()
}

/// Returns a path relative to a folder, with `/` between its parts, as the page spells it; `None` without a common root.
fn relative(path: &Path, folder: &Path) -> Option<String> {
    let plain = |path: &Path| -> Option<Vec<String>> {
        let mut parts: Vec<String> = Vec::new();
        for part in path.components() {
            match part {
                Component::CurDir => {}
                Component::ParentDir if parts.last().is_some_and(|last| last != "..") => {
                    drop(parts.pop())
                }
                other => parts.push(other.as_os_str().to_str()?.to_owned()),
            }
        }
        Some(parts)
    };
    let (path, folder) = match path.is_absolute() == folder.is_absolute() {
        true => (plain(path)?, plain(folder)?),
        false => (
            plain(&std::path::absolute(path).ok()?)?,
            plain(&std::path::absolute(folder).ok()?)?,
        ),
    };
    let common = path.iter().zip(&folder).take_while(|(a, b)| a == b).count();
    let up = folder[common..].iter().map(|_| "..");
    let down = path[common..].iter().map(String::as_str);
    Some(up.chain(down).collect::<Vec<_>>().join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_to_a_folder() {
        let of = |path: &str, folder: &str| relative(path.as_ref(), folder.as_ref()).unwrap();
        assert_eq!(of("data/wake.q", "data"), "wake.q");
        assert_eq!(of("data/./parts/../wake.q", "data"), "wake.q");
        assert_eq!(of("data/maps/a.png", "data/run"), "../maps/a.png");
        assert_eq!(of("wake.q", ""), "wake.q");
        assert_eq!(of("/data/wake.q", "/data"), "wake.q");
    }
}
