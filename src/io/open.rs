//! Opens data files of any format.

use std::path::Path;

use super::bytes::file::{HEAD, Input};
use super::folder::of_folder;
use super::formats::recognise;
use super::options::OpenOptions;
use super::particles::{gadget, hdf5, phantom, tipsy};
use crate::data::dataset::Dataset;
use crate::error::Result;

/// Reads a data file.
///
/// [`formats`](fn@super::formats) lists the formats that are read. The first bytes of the file decide its format, or
/// else its name, or else its text or size. If [`OpenOptions::raw`] is given, the file is read as a raw volume before
/// its text or size is examined.
///
/// A folder may be a SOG scene with its `meta.json`, an AMReX plotfile, an OpenFOAM case, or DICOM series (the largest
/// is read).
///
/// # Errors
/// The file cannot be read, has no known format, or breaks its format's rules.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    let path = of_folder(path);
    read_input(Input::of_file(&path), options)
}

/// Returns true if a file may hold particles of several types: if it is HDF5, a binary Gadget snapshot, a native dump of Phantom or a tipsy snapshot.
/// [`OpenOptions::particle_type`] chooses one of the types.
///
/// # Errors
/// The file cannot be read.
pub fn has_particle_types(path: &Path) -> Result<bool> {
    may_have_types(Input::of_file(path))
}

/// Returns true if an input may hold particles of several types: see [`has_particle_types`].
///
/// # Errors
/// The input cannot be read.
pub(crate) fn may_have_types(input: Input<'_>) -> Result<bool> {
    let (head, len) = input.head(HEAD)?;
    Ok(head.starts_with(hdf5::MAGIC)
        || gadget::looks_like(&head)
        || phantom::native::looks_like(&head)
        || tipsy::looks_like(&head, len))
}

/// Reads a data file from its bytes, as [`open`] does from the disk.
///
/// - `name`: name of the file. Its extension decides the format if the content does not. Error messages contain it.
///
/// Files that name others (VTK indices, OBJ with materials, glTF with separate buffers, image headers) need
/// [`read_with`]. This function reads nothing from the disk.
///
/// ```
/// use ewa_splat::io::{OpenOptions, read};
///
/// # fn main() -> ewa_splat::Result<()> {
/// let table = b"x,y,z,sigma,mass\n0,0,0,0.5,1\n1,0,0,0.5,2\n";
/// let data = read("stars.csv", table, &OpenOptions::default())?;
/// assert_eq!(data.field_names(), ["sigma", "mass"]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// The errors of [`open`]; the file names another file.
pub fn read(name: &str, bytes: &[u8], options: &OpenOptions) -> Result<Dataset> {
    read_with(name, bytes, options, &|_| None)
}

/// Reads a data file as [`read`] does; `beside` returns the bytes of other files that it names.
///
/// The argument of `beside` is a path relative to the folder of `name`, as the file spells it. The reader may ask for
/// the same path more than once. [`OpenOptions::solution`] and [`OpenOptions::texture`] are passed unchanged.
///
/// # Errors
/// The errors of [`read`]; `beside` returns `None` for a file that is needed.
pub fn read_with(
    name: &str,
    bytes: &[u8],
    options: &OpenOptions,
    beside: &dyn Fn(&Path) -> Option<Vec<u8>>,
) -> Result<Dataset> {
    read_input(Input::of_bytes(Path::new(name), bytes, beside), options)
}

/// Reads a data file from the disk or from memory: see [`open`].
///
/// # Errors
/// The errors of [`open`].
pub(crate) fn read_input(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    recognise(input, options)?.open(input, options)
}
