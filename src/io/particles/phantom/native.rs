//! Reads Phantom's native dumps ("The phantom native binary format" in its documentation), which sphNG shares.
//!
//! A file is a sequence of records: a mark of four bytes with the number of bytes that follow, these bytes, and the mark again.
//!
//! | record | contents |
//! |---|---|
//! | 1 | the integer 60769, the real 60878, and the integers 60878, version, 690706: so sizes and byte order are known |
//! | 2 | 100 characters; the second is `T` if names precede all numbers |
//! | header, for each of the eight types of numbers | a count, i32; if it is not 0, the names, 16 characters each, and the numbers |
//! | blocks | their number, i32 |
//! | each block | number of particles, i64, and of arrays of each type, i32 |
//! | each array of each block | the name; the numbers |
//!
//! The types are the default integer, integers of 1, 2, 4 and 8 bytes, the default real, and reals of 4 and 8 bytes. The second
//! block holds the sinks. `nblocks` of the header is the number of processes, each of which wrote all blocks, and all sinks.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use super::{Dump, Part, dataset, first_code};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::particle_type::ParticleType;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::records::{MARK, record, word};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, double, doubles, values};
use crate::io::particles::table::{list, scalar_field};
use crate::scene::Values;

/// Bytes of a name.
const NAME: usize = 16;
/// Number of types of numbers.
const TYPES: usize = 8;
/// The numbers of the first record.
const FIRST: [f64; 3] = [60769.0, 60878.0, 690_706.0];

const DAMAGED: &str = "the dump is damaged: copy it again";

/// Sizes of default numbers, and the byte order.
#[derive(Debug, Clone, Copy)]
struct Form {
    integer: ScalarType,
    real: ScalarType,
    big_endian: bool,
}

impl Form {
    /// Returns the form in which the first record has its numbers.
    fn of(head: &[u8]) -> Option<Self> {
        let integers = [ScalarType::I32, ScalarType::I64];
        let reals = [ScalarType::F64, ScalarType::F32];
        let sizes = integers.map(|integer| reals.map(|real| (integer, real)));
        let forms = sizes.as_flattened().iter().flat_map(|&(integer, real)| {
            [false, true].map(|big_endian| Self {
                integer,
                real,
                big_endian,
            })
        });
        forms.into_iter().find(|form| form.fits(head))
    }

    fn fits(self, head: &[u8]) -> bool {
        let (integer, real) = (self.integer.size(), self.real.size());
        let number = |at: usize, scalar: ScalarType| {
            let bytes = head.get(MARK + at..MARK + at + scalar.size())?;
            Some(double(bytes, self.encoding(scalar)))
        };
        let len = 4 * integer + real;
        word(head, 0, self.big_endian) == u32::try_from(len).ok()
            && number(0, self.integer) == Some(FIRST[0])
            && number(integer, self.real) == Some(FIRST[1])
            && number(integer + real, self.integer) == Some(FIRST[1])
            && number(3 * integer + real, self.integer) == Some(FIRST[2])
    }

    fn encoding(self, scalar: ScalarType) -> Encoding {
        Encoding {
            scalar,
            big_endian: self.big_endian,
        }
    }

    /// Returns the number of eight bytes.
    fn long(self, bytes: &[u8]) -> i64 {
        let bytes = bytes.first_chunk().copied().unwrap_or_default();
        match self.big_endian {
            true => i64::from_be_bytes(bytes),
            false => i64::from_le_bytes(bytes),
        }
    }

    fn types(self) -> [ScalarType; TYPES] {
        use ScalarType::{F32, F64, I8, I16, I32, I64};
        [self.integer, I8, I16, I32, I64, self.real, F32, F64]
    }
}

/// Returns true if a file that begins with `head` is a dump.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    Form::of(head).is_some()
}

/// The records of a file, one after another.
struct Records<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    form: Form,
    at: usize,
}

impl Records<'_> {
    fn fault(&self, at: usize, expected: String, found: String) -> Error {
        Error::format(self.path, format!("byte {at}"), expected, found, DAMAGED)
    }

    /// Returns the place of the next record's bytes.
    fn next(&mut self) -> Result<Range<usize>> {
        let range = record(self.bytes, self.at, self.form.big_endian).map_err(|mark| {
            let expected = "a record, between two marks with its length".to_owned();
            let found = match mark {
                None => "the end".to_owned(),
                // The marks of parts are negative.
                Some(mark) if i32::try_from(mark).is_err() => {
                    let place = format!("byte {}", self.at);
                    let found = "a part of a record of more than 2 GiB";
                    let advice = "convert the dump to HDF5 (phantom2hdf5)";
                    return Error::format(self.path, place, "whole records", found, advice);
                }
                Some(mark) => format!("a mark of {mark} alone"),
            };
            self.fault(self.at, expected, found)
        })?;
        self.at = range.end + MARK;
        Ok(range)
    }

    /// Returns the place of the next record's bytes, of which there must be `len`.
    fn next_of(&mut self, len: Option<usize>, what: &str) -> Result<Range<usize>> {
        let range = self.next()?;
        if Some(range.len()) != len {
            let expected = match len {
                Some(len) => format!("{len} bytes of {what}"),
                None => format!("{what} that fit in memory"),
            };
            let found = format!("{} bytes", range.len());
            return Err(self.fault(range.start, expected, found));
        }
        Ok(range)
    }

    /// Returns a count, which is a record of its own.
    fn next_count(&mut self, what: &str) -> Result<usize> {
        let range = self.next_of(Some(MARK), what)?;
        self.count(range.start, what)
    }

    /// Returns the count at a byte.
    fn count(&self, at: usize, what: &str) -> Result<usize> {
        let count = word(self.bytes, at, self.form.big_endian).unwrap_or_default();
        let count = count.cast_signed();
        usize::try_from(count)
            .map_err(|_| self.fault(at, format!("a count of {what}"), count.to_string()))
    }

    fn name(&self, range: Range<usize>) -> String {
        let text = String::from_utf8_lossy(&self.bytes[range]).into_owned();
        text.trim_matches([' ', '\0']).to_owned()
    }
}

/// The pieces of a column that processes wrote.
#[derive(Debug, Default)]
struct Column {
    /// The bytes of each piece, with their type and number.
    pieces: Vec<(Range<usize>, ScalarType, usize)>,
}

impl Column {
    fn len(&self) -> usize {
        self.pieces.iter().map(|(.., count)| count).sum()
    }
}

/// The columns of a part, in the order of the file.
#[derive(Debug, Default)]
struct Columns {
    count: usize,
    names: Vec<String>,
    columns: BTreeMap<String, Column>,
}

impl Columns {
    /// Adds the next column of a process.
    ///
    /// - `seen`: how often the process had each name. Phantom repeats names, for each size of grain: the next ones are `NAME_2`, `NAME_3`.
    fn add(
        &mut self,
        seen: &mut BTreeMap<String, usize>,
        name: String,
        piece: (Range<usize>, ScalarType, usize),
    ) {
        let times = seen.entry(name.clone()).or_default();
        *times += 1;
        let name = match *times {
            1 => name,
            times => format!("{name}_{times}"),
        };
        if !self.columns.contains_key(&name) {
            self.names.push(name.clone());
        }
        self.columns.entry(name).or_default().pieces.push(piece);
    }

    /// Returns a column with a number for each particle.
    fn whole(&self, name: &str) -> Option<&Column> {
        let column = self.columns.get(name)?;
        (column.len() == self.count).then_some(column)
    }
}

/// A file whose records are known.
struct Native<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    form: Form,
    header: BTreeMap<String, Vec<f64>>,
    particles: Columns,
    sinks: Columns,
    notes: RefCell<Vec<String>>,
}

/// Reads the particles of a type, or all but the sinks.
///
/// # Errors
/// Records are damaged, lengths or masses do not exist, or there are no particles of the type.
pub(in crate::io) fn read(input: Input<'_>, wanted: Option<ParticleType>) -> Result<Dataset> {
    let bytes = input.read_all()?;
    dataset(&Native::new(input.path, &bytes)?, wanted)
}

impl<'a> Native<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let form = Form::of(bytes).ok_or_else(|| {
            let expected = "the numbers 60769, 60878, 60878 and 690706";
            Error::format(path, "first record", expected, "other numbers", DAMAGED)
        })?;
        let mut records = Records {
            path,
            bytes,
            form,
            at: 0,
        };
        records.next()?;
        let identity = records.next_of(Some(100), "identity")?;
        if bytes[identity.clone()].get(1) != Some(&b'T') {
            let expected = "a dump that names its arrays (`FT...` or `ST...`)";
            let found = format!("`{}`", records.name(identity));
            let advice = "read and write it with a Phantom of 2014 or later";
            return Err(Error::format(path, "identity", expected, found, advice));
        }
        let mut own = Self {
            path,
            bytes,
            form,
            header: read_header(&mut records)?,
            particles: Columns::default(),
            sinks: Columns::default(),
            notes: RefCell::default(),
        };
        let processes = own.header.get("nblocks").cloned();
        let processes = processes.map_or(1, first_code).max(1);
        let at = records.at;
        let all = records.next_count("blocks")?;
        let blocks = all / processes as usize;
        if blocks == 0 || blocks * processes as usize != all {
            let expected = format!("as many blocks for each of {processes} processes");
            return Err(records.fault(at, expected, format!("{all} blocks")));
        }
        for _ in 0..processes {
            own.read_blocks(&mut records, blocks)?;
        }
        Ok(own)
    }

    /// Reads the blocks of a process.
    fn read_blocks(&mut self, records: &mut Records<'_>, count: usize) -> Result<()> {
        let mut blocks = Vec::new();
        for _ in 0..count {
            let range = records.next_of(Some(8 + 4 * TYPES), "a block's counts")?;
            let particles = self.form.long(&self.bytes[range.clone()]);
            let particles = usize::try_from(particles).map_err(|_| {
                let expected = "a number of particles".to_owned();
                records.fault(range.start, expected, particles.to_string())
            })?;
            let mut arrays = [0; TYPES];
            for (i, arrays) in arrays.iter_mut().enumerate() {
                *arrays = records.count(range.start + 8 + 4 * i, "arrays")?;
            }
            blocks.push((particles, arrays));
        }
        let first = blocks.first().map_or(0, |(particles, _)| *particles);
        let is_again = self.sinks.count > 0;
        let mut seen = [BTreeMap::new(), BTreeMap::new()];
        self.particles.count = self.particles.count.saturating_add(first);
        for (block, (particles, arrays)) in blocks.into_iter().enumerate() {
            if block == 1 && !is_again {
                self.sinks.count = particles;
            }
            for (scalar, arrays) in self.form.types().into_iter().zip(arrays) {
                for _ in 0..arrays {
                    let name = records.next_of(Some(NAME), "a name")?;
                    let name = records.name(name);
                    let len = particles.checked_mul(scalar.size());
                    let range = records.next_of(len, &format!("`{name}`"))?;
                    let piece = (range, scalar, particles);
                    match block {
                        // Each process writes all sinks.
                        1 if is_again => {}
                        1 => self.sinks.add(&mut seen[1], name, piece),
                        _ => self.particles.add(&mut seen[0], name, piece),
                    }
                }
            }
        }
        Ok(())
    }

    fn part(&self, part: Part) -> &Columns {
        match part {
            Part::Particles => &self.particles,
            Part::Sinks => &self.sinks,
        }
    }

    fn doubles_of(&self, column: &Column) -> Vec<f64> {
        let mut all = Vec::new();
        for (range, scalar, count) in &column.pieces {
            let stride = Stride {
                first: 0,
                step: scalar.size(),
                count: *count,
            };
            let bytes = &self.bytes[range.clone()];
            all.extend(doubles(bytes, self.form.encoding(*scalar), stride).unwrap_or_default());
        }
        all
    }

    fn values_of(&self, column: &Column) -> Values {
        if let [(range, scalar, count)] = &column.pieces[..] {
            let stride = Stride {
                first: 0,
                step: scalar.size(),
                count: *count,
            };
            let bytes = &self.bytes[range.clone()];
            let own = values(bytes, self.form.encoding(*scalar), stride);
            return own.unwrap_or_else(|| Values::F32(Vec::new()));
        }
        self.doubles_of(column).into()
    }
}

/// Reads the header: numbers of each type. Names that occur several times have a list.
fn read_header(records: &mut Records<'_>) -> Result<BTreeMap<String, Vec<f64>>> {
    let mut header: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for scalar in records.form.types() {
        let count = records.next_count("numbers")?;
        if count == 0 {
            continue;
        }
        let names = records.next_of(count.checked_mul(NAME), "names")?;
        let numbers = records.next_of(count.checked_mul(scalar.size()), "numbers")?;
        let numbers = records.bytes[numbers].chunks_exact(scalar.size());
        for (number, at) in numbers.zip(names.step_by(NAME)) {
            let number = double(number, records.form.encoding(scalar));
            let name = records.name(at..at + NAME);
            header.entry(name).or_default().push(number);
        }
    }
    Ok(header)
}

impl Dump for Native<'_> {
    fn path(&self) -> &Path {
        self.path
    }

    fn header(&self, name: &str) -> Result<Option<Vec<f64>>> {
        Ok(self.header.get(name).cloned())
    }

    fn count(&self, part: Part) -> Result<usize> {
        Ok(self.part(part).count)
    }

    fn positions(&self, part: Part) -> Result<Vec<DVec3>> {
        let columns = self.part(part);
        let axis = |name: &str| {
            let column = columns.whole(name).ok_or_else(|| {
                let expected = format!("positions `{name}`, one for each particle");
                Error::format(self.path, "arrays", expected, "none", DAMAGED)
            })?;
            Ok(self.doubles_of(column))
        };
        let [x, y, z] = [axis("x")?, axis("y")?, axis("z")?];
        let axes = x.into_iter().zip(y).zip(z);
        Ok(axes.map(|((x, y), z)| DVec3::new(x, y, z)).collect())
    }

    fn column(&self, part: Part, name: &str) -> Result<Option<Vec<f64>>> {
        let column = self.part(part).whole(name);
        Ok(column.map(|column| self.doubles_of(column)))
    }

    /// Columns that end in x, y and z are the vectors of the HDF5 files: `vx`, `vy` and `vz` are `vxyz`.
    fn fields(&self, part: Part, except: &[&str]) -> Result<Vec<Field>> {
        let columns = self.part(part);
        let mut fields = Vec::new();
        let mut left_out = Vec::new();
        let vector = |name: &str| -> Option<(String, [&Column; 3])> {
            let stem = name.strip_suffix(['x', 'y', 'z'])?;
            let axis = |axis: &str| columns.whole(&format!("{stem}{axis}"));
            Some((format!("{stem}xyz"), [axis("x")?, axis("y")?, axis("z")?]))
        };
        for name in &columns.names {
            let Some(column) = columns.whole(name) else {
                left_out.push(name.as_str());
                continue;
            };
            let vector = vector(name);
            let own = vector.as_ref().map_or(name.as_str(), |(name, _)| name);
            if except.contains(&own) {
                continue;
            }
            fields.push(match vector {
                Some(_) if !name.ends_with('x') => continue,
                Some((name, axes)) => Field {
                    name,
                    association: Association::Nodes,
                    source: FieldSource::Vector(axes.map(|axis| self.values_of(axis)).into()),
                    unit: None,
                },
                None => scalar_field(name.as_str(), self.values_of(column)),
            });
        }
        if !left_out.is_empty() {
            let names = list(left_out.into_iter());
            self.note(format!(
                "Left out, because they do not hold numbers for each particle: {names}."
            ));
        }
        Ok(fields)
    }

    fn note(&self, note: String) {
        self.notes.borrow_mut().push(note);
    }

    fn notes(&self) -> Vec<String> {
        self.notes.take()
    }
}
