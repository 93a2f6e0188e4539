//! Reads HDF5 snapshots of particle codes: Phantom's dumps, and those of Gadget and related codes (Gizmo, Arepo,
//! SWIFT). It also reads VTKHDF files.
//!
//! The crate `hdf5-reader` decodes HDF5. Of the pure-Rust readers, it is the one that accepts limits on the memory of a
//! read. A few hundred bytes of HDF5 can declare gigabytes.

pub(in crate::io) mod arrays;
mod cell_table;
pub(in crate::io) mod file;
pub(in crate::io) mod gadget;
mod gas;
mod layout;
mod phantom;
mod pieces;
mod vtkhdf;

use std::ops::Range;

use self::file::SnapshotFile;
use self::pieces::{Pieces, RowPieces};
use super::periodic::note_reach;
use super::types::{absent, choose};
use crate::data::dataset::Dataset;
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::options::OpenOptions;
use crate::io::refused;
use crate::io::time_steps::{self, TimeStep};

pub(crate) use cell_table::{CellRows, cell_rows};

/// First bytes of every HDF5 file.
pub(crate) const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Returns true if the first bytes contain the name of VTKHDF's group. The name may also stand farther behind; then the
/// reader finds it.
pub(in crate::io) fn names_vtk(head: &[u8]) -> bool {
    let name = vtkhdf::ROOT.as_bytes();
    head.windows(name.len()).any(|bytes| bytes == name)
}

/// Returns the time steps of a VTKHDF file.
///
/// # Errors
/// The file is damaged.
pub(in crate::io) fn vtk_steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let file = SnapshotFile::open(input)?;
    let times = match file.group(vtkhdf::ROOT)? {
        Some(root) => vtkhdf::times(&file, &root)?,
        None => None,
    };
    Ok(time_steps::of_file(input.path, &times.unwrap_or_default()))
}

/// Returns the single step of a snapshot. For a snapshot in several files, any file gives the same step, which names
/// the first file.
///
/// # Errors
/// The file is damaged.
pub(in crate::io) fn snapshot_steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let file = SnapshotFile::open(input)?;
    let pieces = Pieces::of(&file, |piece| input.has_beside(piece))?;
    let first = pieces.map(|pieces| pieces.path(0));
    let first = first.filter(|first| input.has_beside(first));
    Ok(time_steps::of_file(
        first.as_deref().unwrap_or(input.path),
        &[],
    ))
}

/// Reads a snapshot or a VTKHDF file.
///
/// # Errors
/// The file is damaged, or has no particles under the names of these codes or none of the requested type.
pub(crate) fn read(input: Input<'_>, options: &OpenOptions) -> Result<Dataset> {
    let path = input.path;
    let wanted = options.particle_type;
    let file = SnapshotFile::open(input)?;
    if let Some(root) = file.group(vtkhdf::ROOT)? {
        return vtkhdf::read(&file, root, options.read_as, options.time_step);
    }
    if let Some(particles) = file.group("particles")?
        && file.has(&particles, "xyz")?
    {
        return phantom::read(&file, &particles, wanted);
    }
    if let Some(pieces) = Pieces::of(&file, |piece| input.has_beside(piece))? {
        drop(file);
        return pieces::read(input, &pieces, wanted);
    }
    gadget::note_other_files(&file)?;
    if let Some(mut dataset) = gadget::read(&file, wanted)? {
        dataset.offer_temperature();
        note_reach(&mut dataset, &gadget::box_size(&file)?);
        return Ok(dataset);
    }
    Err(refused::hdf5(path, &file.members()?))
}

/// Returns the files of a Gadget snapshot with their numbers of particles of the type to read, and that type. The type
/// is `None` for a single file if the caller names none. Returns `None` for other files, and for files without
/// particles.
///
/// # Errors
/// A file is damaged or does not exist.
pub(crate) fn row_pieces(
    input: Input<'_>,
    wanted: Option<ParticleType>,
) -> Result<Option<RowPieces>> {
    let file = SnapshotFile::open(input)?;
    if file.group(vtkhdf::ROOT)?.is_some() || file.group("particles")?.is_some() {
        return Ok(None);
    }
    let pieces = Pieces::of(&file, |piece| input.has_beside(piece))?;
    let Some(pieces) = pieces else {
        let present = gadget::present(&file)?;
        let mut counts: Vec<ParticleCount> = present.iter().map(|(.., c)| c.clone()).collect();
        let numbers: Vec<usize> = present.iter().map(|(kind, ..)| *kind).collect();
        // If a count exceeds the file's size, the caller reads everything, which reports the error.
        let is_sound = |count: &ParticleCount| count.count <= file.budget.get();
        if counts.iter().all(|count| count.count == 0) || !counts.iter().all(is_sound) {
            return Ok(None);
        }
        let (at, _) = choose(input.path, &mut counts, &numbers, wanted)?;
        let own = (input.path.to_path_buf(), counts[at].count);
        return Ok(Some((wanted, vec![own])));
    };
    drop(file);
    pieces::counts(input, &pieces, wanted)
}

/// Reads some rows of one file of a Gadget snapshot.
///
/// # Errors
/// The file is damaged, or has no such particles.
pub(crate) fn read_rows_of(
    input: Input<'_>,
    wanted: Option<ParticleType>,
    count: usize,
    rows: Range<usize>,
) -> Result<Dataset> {
    let mut file = SnapshotFile::open(input)?;
    file.rows = Some((rows, count));
    match gadget::read(&file, wanted)? {
        Some(mut dataset) => {
            dataset.offer_temperature();
            Ok(dataset)
        }
        None => Err(absent(input.path, wanted.unwrap_or(ParticleType::Gas), &[])),
    }
}
