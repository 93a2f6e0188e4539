//! Reads tipsy snapshots, of Gasoline, ChaNGa and PKDGRAV: the structures of `tipsydefs.h`.
//!
//! A file is a header, then the gas, the dark matter and the stars. Each particle is a structure of f32.
//!
//! | byte of the header | contents |
//! |---|---|
//! | 0 | time, f64 |
//! | 8 | number of all particles, then of dimensions: 3 |
//! | 16 | numbers of gas, of dark matter, and of stars |
//! | 28 | four bytes of padding, which some writers leave out |
//!
//! | particle | numbers |
//! |---|---|
//! | gas | mass, position, velocity, density, temperature, softening, metals, potential |
//! | dark matter | mass, position, velocity, softening, potential |
//! | stars | mass, position, velocity, metals, time of formation, softening, potential |
//!
//! Either byte order occurs ("standard" files are big-endian). Files have no magic number: counts that add up, and the length,
//! identify them. The definition calls the softening of gas `hsmooth`, but codes write their gravitational softening
//! there. So sizes come from mass over density.

use std::ops::Range;

use super::hdf5::gadget::NO_LENGTH_NOTE;
use super::table;
use super::types::choose;
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::data::particle_type::{ParticleCount, ParticleType};
use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::records::word;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, positions, values};

/// Bytes of the header without padding.
const HEADER: usize = 28;
/// Bytes of the padding.
const PADDING: usize = 4;
/// Bytes of a number.
const NUMBER: usize = 4;

/// A kind of particles.
struct Kind {
    name: &'static str,
    types: &'static [ParticleType],
    /// Fields after mass, position and velocity.
    others: &'static [&'static str],
}

/// The kinds of particles, in their order in files.
const KINDS: [Kind; 3] = [
    Kind {
        name: "gas",
        types: &[ParticleType::Gas],
        others: &["Density", "Temperature", "Softening", "Metals", "Potential"],
    },
    Kind {
        name: "dark-matter",
        types: &[ParticleType::DarkMatter],
        others: &["Softening", "Potential"],
    },
    Kind {
        name: "stars",
        types: &[ParticleType::Stars],
        others: &["Metals", "FormationTime", "Softening", "Potential"],
    },
];

impl Kind {
    /// Bytes of a particle.
    fn size(&self) -> usize {
        NUMBER * (7 + self.others.len())
    }
}

/// The header, and its byte order.
#[derive(Debug, Clone, Copy)]
struct Header {
    big_endian: bool,
    counts: [usize; 3],
}

impl Header {
    /// Returns the header whose counts add up, in either byte order.
    fn of(head: &[u8]) -> Option<Self> {
        [false, true].into_iter().find_map(|big_endian| {
            let word = |at: usize| usize::try_from(word(head, at, big_endian)?).ok();
            let counts = [word(16)?, word(20)?, word(24)?];
            let all = counts.iter().copied().fold(0, usize::saturating_add);
            let is_whole = word(8)? == all && all > 0 && word(12)? == 3;
            is_whole.then_some(Self { big_endian, counts })
        })
    }

    /// Returns the bytes of all particles.
    fn size(&self) -> usize {
        let sizes = self.counts.iter().zip(&KINDS);
        let sizes = sizes.map(|(count, kind)| count.saturating_mul(kind.size()));
        sizes.fold(0, usize::saturating_add)
    }

    /// Returns the bytes of each kind's particles in a file of a length; `None` if the length differs.
    ///
    /// - `head`: the first bytes. Zeros behind the header are padding: without any, the first mass would be 0. So a file with padding of zeros that
    ///   lacks its last four bytes is not taken for one without padding.
    fn ranges(&self, head: &[u8], len: usize) -> Option<[Range<usize>; 3]> {
        let mut at = len.checked_sub(self.size())?;
        let is_padded = head.get(HEADER..HEADER + PADDING) == Some(&[0; PADDING]);
        let is_whole = at == HEADER + PADDING || at == HEADER && !is_padded;
        is_whole.then(|| {
            [0, 1, 2].map(|kind| {
                let start = at;
                at += self.counts[kind] * KINDS[kind].size();
                start..at
            })
        })
    }
}

/// Returns true if a file that begins with `head` is a snapshot.
pub(in crate::io) fn looks_like(head: &[u8], len: u64) -> bool {
    let ranges = |header: Header| header.ranges(head, usize::try_from(len).ok()?);
    Header::of(head).and_then(ranges).is_some()
}

/// Reads the particles of a kind; if none is given, of the first in the snapshot.
///
/// # Errors
/// The counts of the header do not add up, or the file has another length; there are no particles of the kind.
pub(in crate::io) fn read(input: Input<'_>, wanted: Option<ParticleType>) -> Result<Dataset> {
    let path = input.path;
    let damaged = "the snapshot is damaged, or no tipsy file: copy it again";
    let (head, len) = input.head(HEADER + PADDING)?;
    let header = Header::of(&head).ok_or_else(|| {
        let expected = "numbers of gas, dark matter and stars that add up, and 3 dimensions";
        Error::format(path, "header", expected, "other numbers", damaged)
    })?;
    let ranges = usize::try_from(len).ok();
    let ranges = ranges.and_then(|len| header.ranges(&head, len));
    let ranges = ranges.ok_or_else(|| {
        let [gas, dark, stars] = header.counts;
        let size = header.size().saturating_add(HEADER + PADDING);
        let expected = format!(
            "{size} bytes for {gas} gas particles, {dark} of dark matter and {stars} stars"
        );
        Error::format(path, "length", expected, format!("{len} bytes"), damaged)
    })?;
    let present: Vec<usize> = (0..3).filter(|kind| header.counts[*kind] > 0).collect();
    let count = |kind: &usize| ParticleCount {
        name: KINDS[*kind].name.to_owned(),
        types: KINDS[*kind].types.to_vec(),
        count: header.counts[*kind],
        is_read: false,
    };
    let mut counts: Vec<ParticleCount> = present.iter().map(count).collect();
    let (at, note) = choose(path, &mut counts, &present, wanted)?;
    let kind = present[at];
    let (count, step) = (header.counts[kind], KINDS[kind].size());

    let bytes = input.read_all()?;
    let bytes = bytes.get(ranges[kind].clone()).unwrap_or_default();
    let encoding = Encoding {
        scalar: ScalarType::F32,
        big_endian: header.big_endian,
    };
    let stride = |number: usize| Stride {
        first: NUMBER * number,
        step,
        count,
    };
    let short = || Error::format(path, "particles", "all bytes", "fewer bytes", damaged);
    let number = |number: usize| values(bytes, encoding, stride(number)).ok_or_else(short);
    let places = [1, 2, 3].map(|number| (encoding, stride(number)));
    let places = positions(bytes, places).ok_or_else(short)?;
    let velocities = [number(4)?, number(5)?, number(6)?];
    let field = |name: &str, source: FieldSource| Field {
        name: name.to_owned(),
        association: Association::Nodes,
        source,
        unit: None,
    };
    let mut fields = vec![
        field("Masses", FieldSource::Scalar(number(0)?)),
        field("Velocities", FieldSource::Vector(velocities.into())),
    ];
    for (i, name) in KINDS[kind].others.iter().enumerate() {
        fields.push(field(name, FieldSource::Scalar(number(7 + i)?)));
    }
    let density = fields.iter().find(|field| field.name == "Density");
    let smoothing = Smoothing {
        length: None,
        meaning: LengthMeaning::Support,
        kernel: SphKernel::CubicSpline,
        mass: Some("Masses".to_owned()),
        density: density.map(|field| field.name.clone()),
    };
    let mut data = table::dataset(path, "tipsy snapshot", places, fields)?;
    data.smoothing = Some(smoothing);
    data.particle_types = counts;
    data.notes.extend(note);
    data.notes.push(NO_LENGTH_NOTE.to_owned());
    Ok(data)
}
