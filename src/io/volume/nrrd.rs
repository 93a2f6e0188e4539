//! Reads NRRD, "nearly raw raster data" (`.nrrd`, and `.nhdr` with the numbers in other files).
//!
//! ```text
//! NRRD0004
//! # comment
//! type: short
//! dimension: 3
//! sizes: 256 256 60
//! space directions: (0.9,0,0) (0,0.9,0) (0,0,2)
//! space origin: (-120,-120,0)
//! endian: little
//! encoding: gzip
//! key:=value
//!
//! numbers, the first axis fastest
//! ```
//!
//! Sample (i, j, k) lies at `space origin` + i d0 + j d1 + k d2, d being the `space directions`. World axes are
//! those of the file's `space`; nothing is rotated. Without directions, `spacings`, `axis mins` and `axis maxs`
//! give the positions along x, y and z, as in Teem: half a step after the minimum, unless `centers` is `node`.
//!
//! An axis that is not of space (`none` for a direction, or a kind such as `vector` or `RGB-color`) is that of
//! a vector's components. Of an axis of `time` or of a `list` after the others, the first entry is read.
//!
//! <https://teem.sourceforge.net/nrrd/format.html>

use std::path::Path;

use glam::DVec3;

use super::image_header::{DAMAGED, Header};
use super::voxels::{self, Image, Numbers, Packing, Skip, Source};
use crate::data::unit::cleaned;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType};
use crate::io::vtk::xml::clip;

/// The first bytes; a version of four digits follows.
pub(in crate::io) const MAGIC: &[u8] = b"NRRD";

/// Greatest length of a header: more than any has, even with lists of some ten thousand files.
const MOST_HEADER: usize = 1 << 22;

/// The format's limit.
const MOST_AXES: usize = 16;

/// Expectation for a field of numbers, after their count.
const PER_AXIS: &str = "numbers, one for each axis";

/// Reads the header of a volume, or of an image as a layer.
///
/// # Errors
/// A header that breaks the format's rules.
pub(in crate::io) fn image(input: Input<'_>) -> Result<Image> {
    let path = input.path;
    let (head, _) = input.head(MOST_HEADER)?;
    let header = parse(path, &head)?;
    let axes = Axes::of(&header)?;
    let shape = Shape::of(&header, &axes)?;

    let scalar = scalar_type(&header)?;
    let packing = packing(&header)?;
    let big_endian = match header.word("endian").as_deref() {
        Some("big") => true,
        Some("little") => false,
        None if scalar.size() == 1 || packing == Packing::Text => false,
        found => {
            let found = found.unwrap_or("none");
            return Err(header.fault("endian", "`little` or `big`", found));
        }
    };
    let numbers = Numbers {
        encoding: Encoding { scalar, big_endian },
        dims: shape.dims,
        beside: shape.beside,
        volumes: shape.volumes,
        volume_step: shape.volume_step,
        scale: None,
    };
    numbers.check(path)?;
    let source = source(input, &header)?;
    let skip = skip(&header)?;

    let place = "header, the positions of the axes";
    let lattice = voxels::lattice(path, place, shape.dims, shape.origin, &shape.steps)?;
    let unit = header.get(&["sampleunits"]).and_then(|text| {
        let text = text.trim().trim_matches('"');
        cleaned(text)
    });
    Ok(Image {
        format: "NRRD image",
        lattice,
        numbers,
        source,
        packing,
        skip,
        field: "value",
        unit,
        notes: shape.notes,
    })
}

/// The fields of a header, with names in lower case and without blanks, as `data file` is `datafile` too.
fn parse<'h>(path: &'h Path, head: &[u8]) -> Result<Header<'h>> {
    let mut header = Header::new(path);
    let mut at = 0;
    let mut is_list = false;
    for (number, line) in head.split_inclusive(|&b| b == b'\n').enumerate() {
        at += line.len();
        let line = line.trim_ascii_end();
        if number == 0 {
            continue;
        }
        if line.is_empty() && !is_list {
            header.end = Some(at);
            break;
        }
        let text = String::from_utf8_lossy(line);
        if is_list {
            header
                .list
                .extend((!line.is_empty()).then(|| text.trim().to_owned()));
            continue;
        }
        if text.starts_with('#') {
            continue;
        }
        let Some((name, value)) = text.split_once(':') else {
            let place = format!("header, line {}", number + 1);
            let expected = "`field: value`, `key:=value`, a comment or an empty line";
            let found = format!("`{}`", clip(&text));
            return Err(Error::format(path, place, expected, found, DAMAGED));
        };
        // A user's key.
        if value.starts_with('=') {
            continue;
        }
        let name = name.replace(' ', "").to_ascii_lowercase();
        let value = value.trim().to_owned();
        is_list = name == "datafile" && value.split(' ').next() == Some("LIST");
        header.fields.push((name, value));
    }
    Ok(header)
}

impl Header<'_> {
    /// A value of one word, in lower case.
    fn word(&self, name: &str) -> Option<String> {
        self.get(&[name]).map(str::to_ascii_lowercase)
    }

    /// One word for each axis; quotes around it are left out.
    fn words(&self, name: &str, count: usize) -> Result<Vec<String>> {
        let Some(text) = self.get(&[name]) else {
            return Ok(vec![String::new(); count]);
        };
        let words: Vec<String> = text
            .split_whitespace()
            .map(|w| w.trim_matches('"').to_ascii_lowercase())
            .collect();
        if words.len() == count {
            return Ok(words);
        }
        Err(self.fault(name, format!("{count} words, one for each axis"), text))
    }

    /// Vectors in parentheses; `None` for `none`.
    fn vectors(&self, name: &str, count: usize) -> Result<Option<Vec<Option<Vector>>>> {
        let Some(text) = self.get(&[name]) else {
            return Ok(None);
        };
        let fault = || {
            let expected = format!("{count} of `(x,y,z)` or `none`, with finite numbers");
            self.fault(name, expected, text)
        };
        let mut vectors = Vec::new();
        let mut rest = text.trim();
        while !rest.is_empty() {
            if let Some(inner) = rest.strip_prefix('(') {
                let (inner, after) = inner.split_once(')').ok_or_else(fault)?;
                let numbers: Option<Vec<f64>> = inner
                    .split(',')
                    .map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite()))
                    .collect();
                let vector = numbers.and_then(|numbers| Vector::of(&numbers));
                // Some writers store four NaN in place of `none`.
                let is_none = inner
                    .split(',')
                    .all(|n| n.trim().eq_ignore_ascii_case("nan"));
                vectors.push(match is_none {
                    true => None,
                    false => Some(vector.ok_or_else(fault)?),
                });
                rest = after.trim_start();
            } else {
                let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                if !word.eq_ignore_ascii_case("none") {
                    return Err(fault());
                }
                vectors.push(None);
                rest = after.trim_start();
            }
        }
        match vectors.len() == count {
            true => Ok(Some(vectors)),
            false => Err(fault()),
        }
    }
}

/// A vector of the file's space: two, three or (with time) four numbers.
#[derive(Debug, Clone, Copy)]
struct Vector {
    space: DVec3,
    time: f64,
}

impl Vector {
    fn of(numbers: &[f64]) -> Option<Self> {
        let (space, time) = match *numbers {
            [x, y] => (DVec3::new(x, y, 0.0), 0.0),
            [x, y, z] => (DVec3::new(x, y, z), 0.0),
            [x, y, z, time] => (DVec3::new(x, y, z), time),
            _ => return None,
        };
        Some(Self { space, time })
    }
}

/// Meaning of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Space,
    Components,
    /// Entries that are separate volumes: times, a list.
    Entries,
    /// Not stated in the header.
    Unknown,
}

/// The header's description of the axes.
struct Axes {
    sizes: Vec<usize>,
    roles: Vec<Role>,
    directions: Option<Vec<Option<Vector>>>,
    spacings: Option<Vec<f64>>,
    notes: Vec<String>,
}

impl Axes {
    fn of(header: &Header<'_>) -> Result<Self> {
        let text = header.required("dimension")?;
        let dimension = text
            .parse()
            .ok()
            .filter(|n| (1..=MOST_AXES).contains(n))
            .ok_or_else(|| header.fault("dimension", format!("1 to {MOST_AXES}"), text))?;
        let none = || header.fault("sizes", "this field", "");
        let sizes = header
            .numbers(&["sizes"], dimension, PER_AXIS)?
            .ok_or_else(none)?;
        let kinds = header.words("kinds", dimension)?;
        let directions = header.vectors("spacedirections", dimension)?;
        let spacings: Option<Vec<f64>> = header.numbers(&["spacings"], dimension, PER_AXIS)?;
        let is_spaced = |n: &f64| n.is_finite();
        let some_spaced = spacings.iter().flatten().any(is_spaced);
        let role = |axis: usize| {
            let kind = match kinds[axis].as_str() {
                "domain" | "space" => Role::Space,
                "time" | "list" => Role::Entries,
                "" | "???" | "none" | "unknown" => Role::Unknown,
                _ => Role::Components,
            };
            if let Some(directions) = &directions {
                return match (directions[axis], kind) {
                    (None, Role::Entries) => Role::Entries,
                    (None, _) => Role::Components,
                    (Some(v), _) if v.space == DVec3::ZERO && v.time != 0.0 => Role::Entries,
                    (Some(_), _) => Role::Space,
                };
            }
            let is_unspaced = spacings.as_ref().is_some_and(|s| !is_spaced(&s[axis]));
            match kind {
                Role::Unknown if some_spaced && is_unspaced => Role::Components,
                kind => kind,
            }
        };
        let roles = (0..dimension).map(role).collect();
        let mut axes = Self {
            sizes,
            roles,
            directions,
            spacings,
            notes: Vec::new(),
        };
        axes.guess();
        Ok(axes)
    }

    fn count(&self, role: Role) -> usize {
        self.roles.iter().filter(|r| **r == role).count()
    }

    /// Guesses roles that the header leaves open, as writers use them: components come first, times last.
    fn guess(&mut self) {
        /// Number of components of a tensor of three dimensions.
        const MOST_COMPONENTS: usize = 9;
        /// Greatest number of colour channels.
        const MOST_CHANNELS: usize = 4;
        /// Least extent of an image with channels; a thinner array may be a volume with few samples along x.
        const LEAST_IMAGE: usize = 9;
        let unknown = self.count(Role::Unknown);
        let open = unknown + self.count(Role::Space);
        let first_is_open = self.roles[0] == Role::Unknown;
        let size = self.sizes[0];
        let is_picture = unknown == 3
            && open == 3
            && (2..=MOST_CHANNELS).contains(&size)
            && self.sizes[1..].iter().all(|n| *n >= LEAST_IMAGE);
        if first_is_open && (is_picture || (open > 3 && size <= MOST_COMPONENTS)) {
            self.roles[0] = Role::Components;
            self.notes.push(format!(
                "The first axis, of {size}, is taken for the components of a vector: the header gives it no kind."
            ));
        }
        for role in &mut self.roles {
            if *role == Role::Unknown {
                *role = Role::Space;
            }
        }
        // A fourth axis of "domain", or of unknown meaning.
        let last = self.roles.len() - 1;
        if self.count(Role::Space) == 4 && self.roles[last] == Role::Space {
            self.roles[last] = Role::Entries;
        }
    }
}

/// The lattice's layout of the numbers.
struct Shape {
    dims: [usize; 3],
    beside: usize,
    volumes: usize,
    volume_step: usize,
    origin: DVec3,
    steps: Vec<DVec3>,
    notes: Vec<String>,
}

impl Shape {
    fn of(header: &Header<'_>, axes: &Axes) -> Result<Self> {
        let of_space: Vec<usize> = (0..axes.roles.len())
            .filter(|&axis| axes.roles[axis] == Role::Space)
            .collect();
        let (Some(&first), Some(&last), 2..=3) =
            (of_space.first(), of_space.last(), of_space.len())
        else {
            let found = format!("{} of them", of_space.len());
            let expected = "two or three axes of space";
            return Err(header.fault("dimension", expected, &found));
        };
        if last - first + 1 != of_space.len() {
            let expected = "axes of space one after the other";
            let place = "header, the order of the axes";
            let advice = "move the others to the front: `unu permute`";
            let found = "others between them";
            return Err(Error::format(header.path, place, expected, found, advice));
        }
        let product = |sizes: &[usize]| sizes.iter().try_fold(1, |n: usize, m| n.checked_mul(*m));
        let too_many = || header.fault("sizes", "counts whose product fits into memory", "more");
        let beside = product(&axes.sizes[..first]).ok_or_else(too_many)?;
        let volumes = product(&axes.sizes[last + 1..]).ok_or_else(too_many)?;
        let mut notes = axes.notes.clone();
        let has_entries = axes.roles[last + 1..].contains(&Role::Entries);
        if has_entries && volumes > 1 {
            notes.push(format!("The first of {volumes} volumes."));
        }
        let mut dims = [1; 3];
        for (dim, &axis) in dims.iter_mut().zip(&of_space) {
            *dim = axes.sizes[axis];
        }
        let (origin, steps) = placement(header, axes, &of_space)?;
        Ok(Self {
            dims,
            beside,
            volumes,
            volume_step: if has_entries { volumes.max(1) } else { 1 },
            origin,
            steps,
            notes,
        })
    }
}

/// The position of the first sample, and the steps along the axes of space.
fn placement(header: &Header<'_>, axes: &Axes, of_space: &[usize]) -> Result<(DVec3, Vec<DVec3>)> {
    let stated = header.vectors("spaceorigin", 1)?;
    let stated = stated.and_then(|vectors| vectors[0]).map(|v| v.space);
    if let Some(directions) = &axes.directions {
        let steps = of_space.iter().filter_map(|&axis| directions[axis]);
        let steps = steps.map(|v| v.space).collect();
        return Ok((stated.unwrap_or(DVec3::ZERO), steps));
    }
    let count = axes.sizes.len();
    let mins: Option<Vec<f64>> = header.numbers(&["axismins"], count, PER_AXIS)?;
    let maxs: Option<Vec<f64>> = header.numbers(&["axismaxs"], count, PER_AXIS)?;
    let centres = match header.get(&["centers"]).is_some() {
        true => header.words("centers", count)?,
        false => header.words("centerings", count)?,
    };
    let at = |numbers: &Option<Vec<f64>>, axis: usize| {
        let number = numbers.as_ref().map(|n| n[axis]);
        number.filter(|n| n.is_finite())
    };
    let mut origin = DVec3::ZERO;
    let mut steps = Vec::new();
    for (i, &axis) in of_space.iter().enumerate() {
        let is_node = centres[axis] == "node";
        let (min, max) = (at(&mins, axis), at(&maxs, axis));
        let intervals = axes.sizes[axis].saturating_sub(usize::from(is_node)).max(1);
        let from_ends = min.zip(max).map(|(a, b)| (b - a) / intervals as f64);
        let spacing = at(&axes.spacings, axis).or(from_ends).unwrap_or(1.0);
        let behind = if is_node { 0.0 } else { 0.5 * spacing };
        origin[i] = min.map_or(0.0, |min| min + behind);
        steps.push(DVec3::AXES[i] * spacing);
    }
    Ok((stated.unwrap_or(origin), steps))
}

fn scalar_type(header: &Header<'_>) -> Result<ScalarType> {
    let text = header.required("type")?;
    // `unsigned short int` is `unsigned short`, and `uint16_t` is `uint16`.
    let lower = text.to_ascii_lowercase();
    let name = lower.strip_suffix("_t").unwrap_or(&lower);
    let bare = name.strip_suffix(" int").filter(|n| {
        let last = n.rsplit(' ').next();
        matches!(last, Some("short" | "long"))
    });
    let name = bare.unwrap_or(name);
    let name = name.strip_prefix("signed ").unwrap_or(name);
    Ok(match name {
        "char" | "int8" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" => ScalarType::U8,
        "short" | "int16" => ScalarType::I16,
        "ushort" | "unsigned short" | "uint16" => ScalarType::U16,
        "int" | "int32" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" => ScalarType::U32,
        "longlong" | "long long" | "int64" => ScalarType::I64,
        "ulonglong" | "unsigned long long" | "uint64" => ScalarType::U64,
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        _ => {
            let expected = "a type of numbers, from `signed char` to `double`";
            return Err(header.fault("type", expected, text));
        }
    })
}

fn packing(header: &Header<'_>) -> Result<Packing> {
    let text = header.required("encoding")?;
    Ok(match text.to_ascii_lowercase().as_str() {
        "raw" => Packing::Raw,
        "txt" | "text" | "ascii" => Packing::Text,
        "hex" => Packing::Hex,
        "gz" | "gzip" => Packing::Gzip,
        "bz2" | "bzip2" => Packing::Bzip2,
        _ => {
            let place = "header, `encoding`";
            let expected = "raw, ascii, hex, gzip or bzip2";
            let found = format!("`{}`, which is not read", clip(text));
            let advice = "save it with the encoding gzip: `unu save -f nrrd -e gzip`";
            return Err(Error::format(header.path, place, expected, found, advice));
        }
    })
}

fn skip(header: &Header<'_>) -> Result<Skip> {
    let (lines, bytes) = (header.skipped("lineskip")?, header.skipped("byteskip")?);
    Ok(Skip {
        lines: u64::try_from(lines).unwrap_or(0),
        bytes: u64::try_from(bytes).unwrap_or(0),
        to_the_end: bytes < 0,
    })
}

fn source(input: Input<'_>, header: &Header<'_>) -> Result<Source> {
    let path = input.path;
    let Some(text) = header.get(&["datafile"]) else {
        let none = || {
            let place = "header";
            let expected =
                "an empty line before the numbers, or `data file` with the name of theirs";
            Error::format(path, place, expected, "neither", DAMAGED)
        };
        return Ok(Source::Attached(header.end.ok_or_else(none)? as u64));
    };
    let words: Vec<&str> = text.split_whitespace().collect();
    if words.first() == Some(&"LIST") {
        return Ok(Source::Beside(header.listed()?));
    }
    let is_number = |w: &&str| w.parse::<i64>().is_ok();
    // The number of axes per file may follow; the sizes give it as well.
    let numbers = words.iter().rev().take_while(|w| is_number(w)).count();
    if text.contains('%') && matches!(numbers, 3 | 4) && words.len() > numbers {
        let first = words.len() - numbers;
        let range = [0, 1, 2].map(|i| words[first + i].parse().unwrap_or(0));
        let pattern = words[..first].join(" ");
        return Ok(Source::Beside(voxels::by_pattern(input, &pattern, range)?));
    }
    Ok(Source::Beside(vec![voxels::beside(path, text)?]))
}
