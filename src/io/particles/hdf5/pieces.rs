//! Reads Gadget snapshots in several files: `snap_010.0.hdf5`, `snap_010.1.hdf5`, .... The attribute
//! `NumFilesPerSnapshot` of `Header` states their number.
//!
//! Any one of the files selects all, which are read as one data set. A SWIFT file of virtual datasets (attribute
//! `Virtual`) selects the pieces beside it: `snap.hdf5` selects `snap.0.hdf5`, ... or `snap/snap.0.hdf5`, ....

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use hdf5_reader::group::Group;

use super::super::periodic::note_reach;
use super::super::table::list;
use super::super::types::absent;
use super::file::{SnapshotFile, whole};
use super::gadget;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, Geometry};
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::vtk::array::Array;
use crate::io::vtk::meshes::append_arrays;
use crate::io::vtk::pieces::{keep_common, to_fields};

/// Requested type of particles, and the files with their numbers of such particles.
pub(crate) type RowPieces = (Option<ParticleType>, Vec<(PathBuf, usize)>);

/// Greatest number of pieces, far more than any code writes.
const MOST_PIECES: usize = 1 << 16;

/// Pieces of a snapshot.
pub(super) struct Pieces {
    stem: String,
    ending: String,
    folder: PathBuf,
    pub(super) count: usize,
}

impl Pieces {
    /// Returns the pieces that a file selects. Returns `None` if it is a complete snapshot, or its name has no piece
    /// number.
    ///
    /// - `has`: returns true if there is a file with this path.
    pub(super) fn of(file: &SnapshotFile<'_>, has: impl Fn(&Path) -> bool) -> Result<Option<Self>> {
        let Some(header) = file.group("Header")? else {
            return Ok(None);
        };
        let number = |name: &str| {
            let numbers = file.attribute(&header, name)?;
            numbers.first().copied().and_then(whole)
        };
        let folder = file.path.parent().unwrap_or(Path::new(""));
        let name = file.path.file_name().unwrap_or_default().to_string_lossy();
        let Some((name, ending)) = name.rsplit_once('.') else {
            return Ok(None);
        };
        let pieces = |stem: &str, folder: PathBuf, count| Self {
            stem: stem.to_owned(),
            ending: ending.to_owned(),
            folder,
            count,
        };
        if number("Virtual") == Some(1) {
            for folder in [folder.to_path_buf(), folder.join(name)] {
                let mut found = pieces(name, folder, 0);
                while found.count < MOST_PIECES && has(&found.path(found.count)) {
                    found.count += 1;
                }
                if found.count > 0 {
                    return Ok(Some(found));
                }
            }
            let expected = format!("`{name}.0.{ending}`, or the same in a folder `{name}`");
            let advice = "give the files that it puts together";
            let found = "neither, beside a file of virtual datasets";
            return Err(Error::format(
                file.path,
                "Header, `Virtual`",
                expected,
                found,
                advice,
            ));
        }
        let count = number("NumFilesPerSnapshot").filter(|n| (2..=MOST_PIECES).contains(n));
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        let stem = name
            .rsplit_once('.')
            .filter(|(_, number)| is_number(number));
        Ok(match (count, stem) {
            (Some(count), Some((stem, _))) => Some(pieces(stem, folder.to_path_buf(), count)),
            _ => None,
        })
    }

    pub(super) fn path(&self, i: usize) -> PathBuf {
        self.folder
            .join(format!("{}.{i}.{}", self.stem, self.ending))
    }

    /// Refuses a snapshot with a missing piece.
    fn check(&self, path: &Path, has: impl Fn(&Path) -> bool) -> Result<()> {
        let missing: Vec<usize> = (0..self.count).filter(|&i| !has(&self.path(i))).collect();
        if missing.is_empty() {
            return Ok(());
        }
        const MOST_NAMES: usize = 8;
        let names = missing.iter().take(MOST_NAMES).map(|&i| {
            let path = self.path(i);
            path.file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        });
        let names: Vec<String> = names.collect();
        let more = match missing.len().saturating_sub(MOST_NAMES) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        Err(Error::format(
            path,
            "Header, `NumFilesPerSnapshot`",
            format!("the {} files of the snapshot in one folder", self.count),
            format!("no {}{more}", list(names.iter().map(String::as_str))),
            "put them there",
        ))
    }
}

/// Reads all pieces as one data set.
///
/// # Errors
/// A piece does not exist or is damaged, or no piece has particles of the type.
pub(super) fn read(
    input: Input<'_>,
    pieces: &Pieces,
    wanted: Option<ParticleType>,
) -> Result<Dataset> {
    let path = input.path;
    pieces.check(path, |piece| input.has_beside(piece))?;
    let mut all = All {
        path,
        wanted,
        counts: Vec::new(),
        data: None,
        arrays: Vec::new(),
        units: HashMap::new(),
        box_size: Vec::new(),
    };
    for i in 0..pieces.count {
        input.with_beside(&pieces.path(i), |piece| {
            all.add(&SnapshotFile::open(piece)?)
        })?;
    }
    let mut data = all.finish()?;
    data.notes.insert(
        0,
        format!("Files of the snapshot put together: {}.", pieces.count),
    );
    Ok(data)
}

/// Returns all pieces with particles of a type, their numbers of particles, and the type.
///
/// # Errors
/// A piece does not exist or is damaged.
pub(super) fn counts(
    input: Input<'_>,
    pieces: &Pieces,
    mut wanted: Option<ParticleType>,
) -> Result<Option<RowPieces>> {
    pieces.check(input.path, |piece| input.has_beside(piece))?;
    let mut counts = Vec::new();
    for i in 0..pieces.count {
        let path = pieces.path(i);
        let count = input.with_beside(&path, |piece| {
            let file = SnapshotFile::open(piece)?;
            let present = gadget::present(&file)?;
            if wanted.is_none() {
                wanted = first_type(&file, &present)?;
            }
            let is_wanted = |kind: usize, count: &ParticleCount| {
                let number = u32::try_from(kind).ok();
                wanted.is_some_and(|wanted| count.is(number, wanted))
            };
            let is_sound = |count: &ParticleCount| count.count <= file.budget.get();
            if !present.iter().all(|(.., count)| is_sound(count)) {
                return Ok(None);
            }
            let own = present
                .iter()
                .find(|(kind, _, count)| is_wanted(*kind, count));
            Ok(Some(own.map_or(0, |(.., count)| count.count)))
        })?;
        match count {
            // If a count exceeds the file's size, the caller reads everything, which reports the error.
            None => return Ok(None),
            Some(0) => {}
            Some(count) => counts.push((path, count)),
        }
    }
    Ok((!counts.is_empty()).then_some((wanted, counts)))
}

/// Returns the type to read from all pieces: the one that the header determines, or the first of this piece that has
/// particles.
fn first_type(
    file: &SnapshotFile<'_>,
    present: &[(usize, Group, ParticleCount)],
) -> Result<Option<ParticleType>> {
    let first = present.iter().find(|(_, _, count)| count.count > 0);
    let kind = gadget::first_of_all(file)?.or(first.map(|(kind, ..)| *kind));
    let number = kind.map(|kind| u32::try_from(kind).unwrap_or(u32::MAX));
    Ok(number.map(ParticleType::Number))
}

/// Contents of the pieces, one after another.
struct All<'a> {
    path: &'a Path,
    wanted: Option<ParticleType>,
    counts: Vec<ParticleCount>,
    /// Data set of the first piece with particles of the type, extended by the positions of all.
    data: Option<Dataset>,
    /// Arrays of each piece.
    arrays: Vec<Vec<Array>>,
    /// Units of the fields that state them.
    units: HashMap<String, String>,
    /// Edges of the box.
    box_size: Vec<f64>,
}

impl All<'_> {
    fn add(&mut self, file: &SnapshotFile<'_>) -> Result<()> {
        let present = gadget::present(file)?;
        // The first piece with particles, or the header, decides the type for all.
        let wanted = match self.wanted {
            Some(wanted) => wanted,
            None => match first_type(file, &present)? {
                Some(wanted) => *self.wanted.insert(wanted),
                None => return Ok(()),
            },
        };
        let mut has = false;
        for (kind, _, count) in present {
            let is = count.count > 0 && count.is(u32::try_from(kind).ok(), wanted);
            has |= is;
            match self.counts.iter_mut().find(|c| c.name == count.name) {
                Some(sum) => {
                    sum.count += count.count;
                    sum.is_read |= is;
                }
                None => self.counts.push(ParticleCount {
                    is_read: is,
                    ..count
                }),
            }
        }
        if !has {
            return Ok(());
        }
        let Some(mut data) = gadget::read(file, Some(wanted))? else {
            return Ok(());
        };
        let fields = std::mem::take(&mut data.fields).into_iter();
        self.arrays.push(
            fields
                .filter_map(|field| array(field, &mut self.units))
                .collect(),
        );
        match &mut self.data {
            None => {
                self.box_size = gadget::box_size(file)?;
                self.data = Some(data);
            }
            Some(all) => {
                if let (Geometry::Points { positions: all }, Geometry::Points { mut positions }) =
                    (&mut all.geometry, data.geometry)
                {
                    all.append(&mut positions);
                }
            }
        }
        Ok(())
    }

    fn finish(mut self) -> Result<Dataset> {
        let Some(mut data) = self.data else {
            let wanted = self.wanted.unwrap_or(ParticleType::Gas);
            return Err(absent(self.path, wanted, &self.counts));
        };
        keep_common(&mut self.arrays, "particles", &mut data.notes);
        let arrays = self.arrays.into_iter().reduce(append_arrays);
        data.fields = to_fields(arrays.unwrap_or_default(), Association::Nodes);
        for field in &mut data.fields {
            field.unit = self.units.remove(&field.name);
        }
        data.path = self.path.to_path_buf();
        data.particle_types = self.counts;
        data.offer_temperature();
        note_reach(&mut data, &self.box_size);
        Ok(data)
    }
}

fn array(mut field: Field, units: &mut HashMap<String, String>) -> Option<Array> {
    if let Some(unit) = field.unit.take() {
        units.insert(field.name.clone(), unit);
    }
    Array::of_field(field)
}
