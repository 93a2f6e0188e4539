//! Reads binary snapshots of Gadget-1 and Gadget-2, formats 1 and 2 ("User guide for GADGET-2", section 6).
//!
//! A file is a sequence of records: a mark of four bytes with the number of bytes that follow, these bytes, and the
//! mark again. The first mark determines the byte order and the format. In format 2, an extra record precedes each
//! other record. Its eight bytes are a four-letter name and the number of bytes to the next such record.
//!
//! | record | name | contents |
//! |---|---|---|
//! | the header, 256 bytes | `HEAD` | see below |
//! | positions | `POS ` | three numbers for each particle, those of type 0 first |
//! | velocities | `VEL ` | the same |
//! | identifiers | `ID  ` | one each |
//! | masses | `MASS` | one for each particle of a type without a mass in the header; if no type lacks it, no record |
//! | internal energy, density | `U   `, `RHO ` | one for each gas particle |
//! | electron and hydrogen abundance, if the header states that gas cools | `NE  `, `NH  ` | the same |
//! | smoothing length | `HSML` | the same |
//!
//! | byte of the header | contents |
//! |---|---|
//! | 0 | number of particles of the types 0 to 5 in this file, u32 each |
//! | 24 | mass of each particle of a type, f64 each; 0 if each has its own |
//! | 120 | nonzero if gas cools, i32 |
//! | 124 | number of files of the snapshot, i32: `NAME.0`, `NAME.1`, ... |
//!
//! Numbers have 32 or 64 bits, which follows from a record's length. Types, lengths and names of fields are those of
//! the HDF5 reader ([`hdf5::gadget`]).

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::hdf5::gadget::{LENGTH_NOTE, NO_LENGTH_NOTE, TYPES};
use super::periodic::note_reach;
use super::table::{self, list};
use super::types::choose;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::gas::GasState;
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::records::{self, word};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, points, values};
use crate::io::time_steps::{TimeStep, of_file};
use crate::math::narrowed;
use crate::scene::Values;

const HEADER: usize = 256;

/// Number of bytes that identify a snapshot: the header's record, behind its name in format 2.
const BEGINNING: usize = 16 + 4 + HEADER + 4;

/// Number of particle types.
const TYPE_COUNT: usize = 6;

/// Greatest number of files of one snapshot, far more than any code writes.
const MOST_FILES: u32 = 1 << 16;

const DAMAGED: &str = "the snapshot is damaged: copy it again";

/// Names of records in format 2, and of their fields.
const NAMES: [(&str, &str); 12] = [
    ("POS", "Coordinates"),
    ("VEL", "Velocities"),
    ("ID", "ParticleIDs"),
    ("MASS", "Masses"),
    ("U", "InternalEnergy"),
    ("RHO", "Density"),
    ("NE", "ElectronAbundance"),
    ("NH", "NeutralHydrogenAbundance"),
    ("HSML", "SmoothingLength"),
    ("POT", "Potential"),
    ("ACCE", "Acceleration"),
    ("SFR", "StarFormationRate"),
];

/// Byte order and format, from the first bytes.
#[derive(Debug, Clone, Copy)]
struct Form {
    big_endian: bool,
    has_names: bool,
}

impl Form {
    fn of(head: &[u8]) -> Option<Self> {
        [false, true].into_iter().find_map(|big_endian| {
            let mark = |at: usize| word(head, at, big_endian);
            let is_header = |at: usize| {
                let size = u32::try_from(HEADER).ok();
                mark(at) == size && mark(at + 4 + HEADER) == size
            };
            let is_named = mark(0) == Some(8) && head.get(4..8) == Some(b"HEAD");
            let has_names = is_named && is_header(16);
            (has_names || is_header(0)).then_some(Self {
                big_endian,
                has_names,
            })
        })
    }
}

/// Values from the header.
#[derive(Debug, Clone)]
struct Header {
    form: Form,
    counts: [usize; TYPE_COUNT],
    masses: [f64; TYPE_COUNT],
    cools: bool,
    files: u32,
    /// Edge of the box; 0 if there is none.
    box_size: f64,
}

impl Header {
    fn of(head: &[u8]) -> Option<Self> {
        let form = Form::of(head)?;
        let start = if form.has_names { 20 } else { 4 };
        let header = head.get(start..start + HEADER)?;
        let word = |at: usize| word(header, at, form.big_endian);
        let double = |at: usize| {
            let bytes = header.get(at..at + 8)?.try_into().ok()?;
            Some(match form.big_endian {
                true => f64::from_be_bytes(bytes),
                false => f64::from_le_bytes(bytes),
            })
        };
        let mut counts = [0; TYPE_COUNT];
        let mut masses = [0.0; TYPE_COUNT];
        for (i, (count, mass)) in counts.iter_mut().zip(&mut masses).enumerate() {
            *count = usize::try_from(word(4 * i)?).ok()?;
            *mass = double(24 + 8 * i)?;
        }
        Some(Self {
            form,
            counts,
            masses,
            cools: word(120)? != 0,
            files: word(124)?,
            box_size: double(128)?,
        })
    }

    fn read(input: Input<'_>) -> Result<Self> {
        let (head, _) = input.head(BEGINNING)?;
        Self::of(&head).ok_or_else(|| {
            let expected = "a header of 256 bytes between two record marks";
            let found = "something else";
            Error::format(input.path, "header", expected, found, DAMAGED)
        })
    }

    /// Returns true if the particles of a type have individual masses.
    fn has_own_mass(&self, kind: usize) -> bool {
        self.counts[kind] > 0 && self.masses[kind] == 0.0
    }

    /// Returns the types whose particles a record covers, by its name and length.
    fn types_of(&self, name: &str, len: usize) -> Option<Vec<usize>> {
        let with = |is_so: &dyn Fn(usize) -> bool| (0..TYPE_COUNT).filter(|&t| is_so(t)).collect();
        match name {
            "POS" | "VEL" | "ID" => return Some(with(&|_| true)),
            "MASS" => return Some(with(&|kind| self.has_own_mass(kind))),
            "U" | "RHO" | "NE" | "NH" | "HSML" | "SFR" => return Some(vec![0]),
            _ => {}
        }
        // For other records the length decides.
        let fits = |types: &Vec<usize>| {
            let count = self.count_of(types);
            count.checked_mul(4) == Some(len) || count.checked_mul(12) == Some(len)
        };
        [with(&|_| true), vec![0]].into_iter().find(fits)
    }

    fn count_of(&self, types: &[usize]) -> usize {
        let counts = types.iter().map(|&t| self.counts[t]);
        counts.fold(0, usize::saturating_add)
    }
}

/// Returns true if a file that begins with `head` is a snapshot.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    Form::of(head).is_some()
}

/// Returns all files of the snapshot of a file, or the file alone if its name has no index.
fn files(input: Input<'_>, header: &Header) -> Result<Vec<PathBuf>> {
    let path = input.path;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let stem = name.rsplit_once('.').filter(|(_, end)| is_number(end));
    let several = (2..=MOST_FILES).contains(&header.files);
    let Some((stem, _)) = stem.filter(|_| several) else {
        return Ok(vec![path.to_path_buf()]);
    };
    let file = |i: u32| path.with_file_name(format!("{stem}.{i}"));
    let files: Vec<PathBuf> = (0..header.files).map(file).collect();
    match files.iter().find(|file| !input.has_beside(file)) {
        Some(missing) => {
            let name = missing.file_name().unwrap_or_default().to_string_lossy();
            Err(Error::format(
                path,
                "header, number of files",
                format!("the {} files of the snapshot in one folder", header.files),
                format!("no `{name}`"),
                "put them there",
            ))
        }
        None => Ok(files),
    }
}

/// Returns one time step: the snapshot, represented by its first file.
///
/// # Errors
/// A file is missing or is no snapshot.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let files = files(input, &Header::read(input)?)?;
    Ok(of_file(&files[0], &[]))
}

/// Reads the particles of a type; if none is given, of the first type in the snapshot.
///
/// # Errors
/// Records are damaged, files are missing, or there are no particles of the type.
pub(in crate::io) fn read(input: Input<'_>, wanted: Option<ParticleType>) -> Result<Dataset> {
    let path = input.path;
    let own = Header::read(input)?;
    let files = files(input, &own)?;
    let mut notes = Vec::new();
    if files.len() == 1 && own.files > 1 {
        let count = own.files;
        notes.push(format!(
            "The snapshot consists of {count} files; only this one is read."
        ));
    }
    let with = |file: &Path, work: &mut dyn FnMut(Input<'_>) -> Result<()>| match file == path {
        true => work(input),
        false => input.with_beside(file, work),
    };
    let mut headers = Vec::new();
    for file in &files {
        with(file, &mut |input| {
            headers.push(Header::read(input)?);
            Ok(())
        })?;
    }
    let total = |kind: usize| headers.iter().map(|h| h.counts[kind]).sum();
    let mut kinds: Vec<usize> = (0..TYPE_COUNT).collect();
    kinds.retain(|&kind| total(kind) > 0);
    let count = |&kind: &usize| ParticleCount {
        name: TYPES[kind].0.to_owned(),
        types: TYPES[kind].1.to_vec(),
        count: total(kind),
        is_read: false,
    };
    let mut counts: Vec<ParticleCount> = kinds.iter().map(count).collect();
    if counts.is_empty() {
        let expected = "particles";
        return Err(Error::format(path, "header", expected, "none", DAMAGED));
    }
    let (at, note) = choose(path, &mut counts, &kinds, wanted)?;
    notes.extend(note);

    let mut gathered = Gathered::default();
    for (file, header) in files.iter().zip(&headers) {
        if header.counts[kinds[at]] > 0 {
            with(file, &mut |input| gathered.add(input, header, kinds[at]))?;
        }
    }
    notes.extend(gathered.notes());
    let fields = gathered.fields.into_iter().map(|(name, components)| {
        let mut components: Vec<Values> = components.into_iter().map(Values::from).collect();
        let source = match components.len() {
            1 => FieldSource::Scalar(components.swap_remove(0)),
            _ => FieldSource::Vector(components),
        };
        Field {
            name,
            association: Association::Nodes,
            source,
            unit: None,
        }
    });
    let fields: Vec<Field> = fields.collect();
    let named = |name: &str| {
        let field = fields.iter().find(|f| f.name == name);
        field.map(|f| f.name.clone())
    };
    let (length, mass, density) = (named("SmoothingLength"), named("Masses"), named("Density"));
    let note = match length {
        Some(_) => LENGTH_NOTE,
        None => NO_LENGTH_NOTE,
    };
    notes.push(note.to_owned());
    let mut data = table::dataset(path, "Gadget snapshot", gathered.positions, fields)?;
    let has_energy = data.fields.iter().any(|f| f.name == "InternalEnergy");
    // The header states no units, so that temperatures do not follow.
    data.gas = has_energy.then(|| GasState {
        energy: "InternalEnergy".to_owned(),
        erg_per_gram: None,
        gamma: None,
        weight: None,
    });
    data.smoothing = Some(Smoothing {
        length,
        meaning: LengthMeaning::Support,
        kernel: SphKernel::CubicSpline,
        mass,
        density,
    });
    data.particle_types = counts;
    data.notes = notes;
    note_reach(&mut data, &[own.box_size]);
    Ok(data)
}

/// Particles of one type from all files.
#[derive(Debug, Default)]
struct Gathered {
    positions: Vec<DVec3>,
    fields: Vec<(String, Vec<Vec<f64>>)>,
    left_out: Vec<String>,
    has_table_mass: bool,
}

impl Gathered {
    fn notes(&mut self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.has_table_mass {
            notes.push("All masses are that of the header.".to_owned());
        }
        // Fields that some files lack are dropped.
        let count = self.positions.len();
        let left_out = &mut self.left_out;
        self.fields.retain(|(name, components)| {
            let is_whole = components.iter().all(|c| c.len() == count);
            if !is_whole {
                left_out.push(name.clone());
            }
            is_whole
        });
        self.left_out.sort();
        self.left_out.dedup();
        if !self.left_out.is_empty() {
            let names = list(self.left_out.iter().map(String::as_str));
            notes.push(format!(
                "Left out, because it is not known what they are of: {names}."
            ));
        }
        notes
    }

    /// Appends the particles of a file.
    fn add(&mut self, input: Input<'_>, header: &Header, kind: usize) -> Result<()> {
        let path = input.path;
        let bytes = input.read_all()?;
        let count = header.counts[kind];
        let mut has_positions = false;
        for record in records(path, &bytes, header)? {
            let data = &bytes[record.bytes.clone()];
            let name = record.name.as_str();
            let Some(types) = header.types_of(name, data.len()) else {
                self.left_out.push(name.to_owned());
                continue;
            };
            if !types.contains(&kind) {
                continue;
            }
            let total = header.count_of(&types);
            let before = header.count_of(&types[..types.iter().take_while(|t| **t < kind).count()]);
            let fault = |expected: String| {
                let found = format!("{} bytes", data.len());
                Error::format(path, format!("record `{name}`"), expected, found, DAMAGED)
            };
            let components = match name {
                "POS" | "VEL" | "ACCE" => 3,
                // For unknown records, the length determined the types and determines the components.
                _ if !is_known(name) && total.checked_mul(12) == Some(data.len()) => 3,
                _ => 1,
            };
            let number_count = total.checked_mul(components);
            let of_size =
                |size: usize| number_count.and_then(|n| n.checked_mul(size)) == Some(data.len());
            let scalar = match (of_size(4), of_size(8), name) {
                (true, _, "ID") => ScalarType::U32,
                (_, true, "ID") => ScalarType::U64,
                (true, ..) => ScalarType::F32,
                (_, true, _) => ScalarType::F64,
                _ => {
                    let expected = format!(
                        "{components} numbers of 4 or 8 bytes for each of {total} particles"
                    );
                    return Err(fault(expected));
                }
            };
            let encoding = Encoding {
                scalar,
                big_endian: header.form.big_endian,
            };
            let size = scalar.size();
            let own = &data[before * components * size..(before + count) * components * size];
            if name == "POS" {
                let positions = points(own, encoding, count);
                self.positions.extend(positions.unwrap_or_default());
                has_positions = true;
                continue;
            }
            let known = NAMES.iter().find(|(short, _)| *short == name);
            let field = known.map_or(name, |(_, long)| long);
            let of_component = |i: usize| {
                let stride = Stride {
                    first: i * size,
                    step: components * size,
                    count,
                };
                values(own, encoding, stride)
            };
            let read: Option<Vec<Values>> = (0..components).map(of_component).collect();
            self.append(field, &read.unwrap_or_default());
        }
        if !has_positions {
            let expected = "a record of positions";
            return Err(Error::format(path, "records", expected, "none", DAMAGED));
        }
        let mass = header.masses[kind];
        if mass != 0.0 {
            self.has_table_mass = true;
            self.append("Masses", &[Values::F32(vec![narrowed(mass); count])]);
        }
        Ok(())
    }

    fn append(&mut self, name: &str, components: &[Values]) {
        let at = self.fields.iter().position(|(other, _)| other == name);
        let at = at.unwrap_or_else(|| {
            let empty = vec![Vec::new(); components.len()];
            self.fields.push((name.to_owned(), empty));
            self.fields.len() - 1
        });
        for (all, more) in self.fields[at].1.iter_mut().zip(components) {
            all.extend((0..more.len()).map(|i| more.wide(i)));
        }
    }
}

fn is_known(name: &str) -> bool {
    NAMES.iter().any(|(known, _)| *known == name)
}

/// Record behind the header.
struct Record {
    name: String,
    bytes: Range<usize>,
}

/// Returns the records behind the header, with their names from format 2 or in the order of format 1.
fn records(path: &Path, bytes: &[u8], header: &Header) -> Result<Vec<Record>> {
    let fault = |at: usize, expected: String, found: String| {
        Error::format(path, format!("byte {at}"), expected, found, DAMAGED)
    };
    let record = |at: usize| {
        records::record(bytes, at, header.form.big_endian).map_err(|len| {
            let expected = "a record, between two marks that say its length".to_owned();
            let found = len.map_or("the end".to_owned(), |len| format!("a mark of {len} alone"));
            fault(at, expected, found)
        })
    };
    let mut at = BEGINNING - if header.form.has_names { 0 } else { 16 };
    let mut unnamed = unnamed(header).into_iter();
    let mut records = Vec::new();
    while at < bytes.len() {
        let name = if header.form.has_names {
            let name = record(at)?;
            if name.len() != 8 {
                let found = format!("{} bytes", name.len());
                return Err(fault(
                    at,
                    "a record of 8 bytes with a name".to_owned(),
                    found,
                ));
            }
            let letters = &bytes[name.start..name.start + 4];
            at = name.end + 4;
            let letters = letters.iter().map(|&b| char::from(b)).collect::<String>();
            letters.trim().to_owned()
        } else {
            match unnamed.next() {
                Some(name) => name.to_owned(),
                None => format!("record {}", records.len() + 1),
            }
        };
        let range = record(at)?;
        at = range.end + 4;
        let is_again = records.iter().any(|other: &Record| other.name == name);
        if is_again {
            let expected = "each name once".to_owned();
            return Err(fault(range.start, expected, format!("`{name}` again")));
        }
        records.push(Record { name, bytes: range });
    }
    Ok(records)
}

/// Returns the names of the records of format 1, in order.
fn unnamed(header: &Header) -> Vec<&'static str> {
    let mut names = vec!["POS", "VEL", "ID"];
    if (0..TYPE_COUNT).any(|kind| header.has_own_mass(kind)) {
        names.push("MASS");
    }
    if header.counts[0] > 0 {
        names.extend(["U", "RHO"]);
        if header.cools {
            names.extend(["NE", "NH"]);
        }
        names.push("HSML");
    }
    names
}
