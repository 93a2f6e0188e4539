//! Unpacks files of other formats from gzip in memory, and reads them with their own readers.
//!
//! NIfTI, SPZ, raw volumes and OpenFOAM use gzip by rules of their own; their readers unpack them.

use std::borrow::Cow;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use super::file::{HEAD, Input, extension, read_all};
use super::probe::Probe;
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::format::{Format, Recognise};
use crate::io::options::OpenOptions;
use crate::io::time_steps::TimeStep;
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::volume::voxels::GZIP;
use crate::memory::left;

/// Number of bytes unpacked between two checks of the available memory.
const STEP: u64 = 1 << 26;

/// Extensions of compressed files whose readers do not unpack them.
pub(in crate::io) const ENDINGS: &[&str] = &[
    "vtk.gz",
    "vti.gz",
    "vtr.gz",
    "vts.gz",
    "vtu.gz",
    "vtp.gz",
    "tec.gz",
    "dat.gz",
    "csv.gz",
    "ply.gz",
    "lammpstrj.gz",
    "dump.gz",
    "extxyz.gz",
    "gro.gz",
];

/// Whether a file is compressed though its name lacks `.gz`.
pub(in crate::io) fn is_under_plain_name(probe: &Probe<'_>, recognise: Recognise) -> bool {
    let ending = extension(probe.input.path);
    let is_one = |packed: &str| packed.strip_suffix(".gz") == Some(ending.as_str());
    ENDINGS.iter().any(|packed| is_one(packed)) && looks_like(probe, recognise)
}

/// Whether a file is compressed and, once unpacked, begins as a format that is read.
pub(in crate::io) fn looks_like(probe: &Probe<'_>, recognise: Recognise) -> bool {
    if !probe.head.starts_with(GZIP) {
        return false;
    }
    let mut head = Vec::new();
    // The first compressed bytes are an incomplete stream: the bytes before its error are used.
    let stream = MultiGzDecoder::new(probe.head).take(HEAD as u64);
    let _cut = { stream }.read_to_end(&mut head);
    let name = unpacked_name(probe.input.path);
    let nothing = |_: &Path| None;
    let inner = Input::of_bytes(&name, &head, &nothing);
    // Nested streams could be endless.
    let is_nested = head.starts_with(GZIP);
    !is_nested && !head.is_empty() && recognise(inner, probe.options).is_ok()
}

/// The name without the extension of gzip.
fn unpacked_name(path: &Path) -> PathBuf {
    match extension(path) == "gz" {
        true => path.with_extension(""),
        false => path.to_path_buf(),
    }
}

/// Applies `look` to the unpacked bytes, under the file's own name.
fn with_unpacked<T>(
    input: Input<'_>,
    options: &OpenOptions,
    recognise: Recognise,
    look: impl FnOnce(Input<'_>, &'static Format) -> Result<T>,
) -> Result<T> {
    let bytes = unpacked(input)?;
    let name = unpacked_name(input.path);
    let on_disk = |path: &Path| read_all(path).ok();
    let in_memory = |path: &Path| input.read_beside(path).ok();
    let beside: &dyn Fn(&Path) -> Option<Vec<u8>> = match input.is_on_disk() {
        true => &on_disk,
        false => &in_memory,
    };
    let format = recognise(Input::of_bytes(&name, &bytes, beside), options)?;
    look(Input::of_bytes(input.path, &bytes, beside), format)
}

/// Reads a file in its format once unpacked.
///
/// # Errors
/// A damaged stream; one that does not fit into memory; errors of its format.
pub(in crate::io) fn read(
    input: Input<'_>,
    options: &OpenOptions,
    recognise: Recognise,
) -> Result<Dataset> {
    with_unpacked(input, options, recognise, |input, format| {
        (format.read)(input, options)
    })
}

/// The time steps in the file.
///
/// # Errors
/// As [`read`].
pub(in crate::io) fn steps(input: Input<'_>, recognise: Recognise) -> Result<Vec<TimeStep>> {
    let options = OpenOptions::default();
    with_unpacked(input, &options, recognise, |input, format| {
        match format.steps {
            Some(steps) => steps(input),
            None => Ok(crate::io::time_steps::of_file(input.path, &[])),
        }
    })
}

/// All bytes of a compressed file, within the greatest ratio of deflate and the available memory.
fn unpacked(input: Input<'_>) -> Result<Vec<u8>> {
    let path = input.path;
    let packed: Cow<'_, [u8]> = input.read_all()?;
    let fault = |expected: &str, found: String| {
        let advice = "copy the file again, or unpack it with gunzip";
        Error::format(path, "gzip stream", expected, found, advice)
    };
    let most = (packed.len() as u64).saturating_mul(DEFLATE_RATIO);
    let mut stream = MultiGzDecoder::new(&*packed).take(most);
    let mut bytes = Vec::new();
    loop {
        let has_room = bytes.is_empty() || left().is_none_or(|(left, _)| left > 2 * STEP);
        if !has_room {
            let found = format!("more than {} bytes", bytes.len());
            return Err(fault("what fits into memory once it is unpacked", found));
        }
        let read = (&mut stream).take(STEP).read_to_end(&mut bytes);
        match read.map_err(|e| fault("a sound stream", e.to_string()))? {
            0 => break,
            _ => continue,
        }
    }
    match bytes.starts_with(GZIP) {
        true => Err(fault(
            "a file packed once",
            "another gzip stream in it".to_owned(),
        )),
        false => Ok(bytes),
    }
}
