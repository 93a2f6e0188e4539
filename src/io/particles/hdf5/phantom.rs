//! Reads Phantom's dumps in HDF5.
//!
//! | quantity | place |
//! |---|---|
//! | particles: positions, (N, 3), and fields | `particles/xyz`, `particles/...` |
//! | sinks: positions, and fields | `sinks/xyz`, `sinks/...` |
//! | header | `header/...` |

use std::path::Path;

use glam::DVec3;
use hdf5_reader::group::Group;

use super::super::phantom::{Dump, Part, dataset};
use super::file::SnapshotFile;
use crate::data::dataset::{Dataset, Field};
use crate::data::particle_type::ParticleType;
use crate::error::Result;

/// Name of the positions.
const POSITIONS: &str = "xyz";

/// The groups of a dump.
struct Groups<'a> {
    file: &'a SnapshotFile<'a>,
    header: Option<Group>,
    particles: &'a Group,
    sinks: Option<Group>,
}

/// Reads the particles of a type, or all but the sinks.
///
/// # Errors
/// Lengths or masses do not exist, or there are no particles of the type.
pub(super) fn read(
    file: &SnapshotFile<'_>,
    particles: &Group,
    wanted: Option<ParticleType>,
) -> Result<Dataset> {
    let sinks = match file.group("sinks")? {
        Some(group) if file.has(&group, POSITIONS)? => Some(group),
        _ => None,
    };
    let groups = Groups {
        file,
        header: file.group("header")?,
        particles,
        sinks,
    };
    dataset(&groups, wanted)
}

impl Groups<'_> {
    fn group(&self, part: Part) -> Option<&Group> {
        match part {
            Part::Particles => Some(self.particles),
            Part::Sinks => self.sinks.as_ref(),
        }
    }
}

impl Dump for Groups<'_> {
    fn path(&self) -> &Path {
        self.file.path
    }

    fn header(&self, name: &str) -> Result<Option<Vec<f64>>> {
        let Some(header) = &self.header else {
            return Ok(None);
        };
        let array = self.file.array(header, name)?;
        Ok(array.and_then(|array| array.doubles(0)))
    }

    fn count(&self, part: Part) -> Result<usize> {
        self.group(part)
            .map_or(Ok(0), |group| self.file.row_count(group, POSITIONS))
    }

    fn positions(&self, part: Part) -> Result<Vec<DVec3>> {
        self.group(part).map_or(Ok(Vec::new()), |group| {
            self.file.positions(group, POSITIONS)
        })
    }

    fn column(&self, part: Part, name: &str) -> Result<Option<Vec<f64>>> {
        let (Some(group), count) = (self.group(part), self.count(part)?) else {
            return Ok(None);
        };
        let array = self.file.array(group, name)?;
        let array = array.filter(|a| a.count == count && a.components == 1);
        Ok(array.and_then(|array| array.doubles(0)))
    }

    fn fields(&self, part: Part, except: &[&str]) -> Result<Vec<Field>> {
        let count = self.count(part)?;
        self.group(part).map_or(Ok(Vec::new()), |group| {
            self.file.fields(group, count, except)
        })
    }

    fn note(&self, note: String) {
        self.file.note(note);
    }

    fn notes(&self) -> Vec<String> {
        self.file.notes.take()
    }
}
