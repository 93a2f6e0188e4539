//! Reads MetaImage (`.mha`, or `.mhd` with the numbers in other files).
//!
//! ```text
//! ObjectType = Image
//! NDims = 3
//! DimSize = 256 256 60
//! ElementSpacing = 0.9 0.9 2
//! TransformMatrix = 1 0 0 0 1 0 0 0 1
//! Offset = -120 -120 0
//! ElementType = MET_SHORT
//! ElementByteOrderMSB = False
//! ElementDataFile = LOCAL
//! numbers, the first axis fastest, the channels of a sample beside each other
//! ```
//!
//! `ElementDataFile` is the last line. Its value is `LOCAL`, the name of a file, a pattern with its first number, last
//! number and step, or `LIST`. Behind `LIST`, each line names a file. Row n of `TransformMatrix` is the direction of
//! axis n. Sample (i, j, k) lies at `Offset` plus i, j and k times the rows, each times its `ElementSpacing`. World
//! axes are those of the file, without any rotation.
//!
//! <https://itk.org/Wiki/ITK/MetaIO/Documentation>

use std::path::Path;

use glam::DVec3;

use super::image_header::{DAMAGED, Header};
use super::voxels::{self, Image, Numbers, Packing, Skip, Source};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType};
use crate::io::vtk::xml::clip;

/// Greatest length of a header; a list of ten thousand files is shorter.
const MOST_HEADER: usize = 1 << 22;

/// Greatest number of axes, the same as in MetaIO.
const MOST_AXES: usize = 10;

/// Returns true if a file begins as a MetaImage header does.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = head.trim_ascii_start();
    ["ObjectType", "NDims", "Comment"].iter().any(|key| {
        let value = text.strip_prefix(key.as_bytes());
        value.is_some_and(|rest| rest.trim_ascii_start().starts_with(b"="))
    })
}

/// Reads the header of a volume, or of an image as a single layer.
///
/// # Errors
/// The header breaks the format's rules.
pub(in crate::io) fn image(input: Input<'_>) -> Result<Image> {
    let path = input.path;
    let (head, _) = input.head(MOST_HEADER)?;
    let header = parse(path, &head)?;
    if let Some(kind) = header.get(&["ObjectType"])
        && !kind.eq_ignore_ascii_case("image")
    {
        let fault = header.fault("ObjectType", "Image", kind);
        return Err(fault);
    }
    let text = header.required("NDims")?;
    let axis_count: usize = text
        .parse()
        .ok()
        .filter(|n| (2..=MOST_AXES).contains(n))
        .ok_or_else(|| header.fault("NDims", format!("2 to {MOST_AXES}"), text))?;
    let none = || header.fault("DimSize", "this field", "");
    let sizes: Vec<usize> = header
        .numbers(&["DimSize"], axis_count, "numbers")?
        .ok_or_else(none)?;
    let of_space = axis_count.min(3);
    let mut dims = [1; 3];
    dims[..of_space].copy_from_slice(&sizes[..of_space]);
    let volumes = sizes[of_space..]
        .iter()
        .try_fold(1, |n: usize, m| n.checked_mul(*m));
    let volumes = volumes.ok_or_else(|| {
        let expected = "counts whose product fits into memory";
        header.fault("DimSize", expected, "more")
    })?;
    let mut notes = Vec::new();
    if volumes > 1 {
        notes.push(format!("The first of {volumes} volumes."));
    }
    let channels = match header.get(&["ElementNumberOfChannels"]) {
        None => 1,
        Some(text) => {
            let channels = text.parse().ok().filter(|n: &usize| *n > 0);
            let fault = || header.fault("ElementNumberOfChannels", "at least 1", text);
            channels.ok_or_else(fault)?
        }
    };
    let is_text = !header.flag(&["BinaryData"], true)?;
    let is_packed = header.flag(&["CompressedData"], false)?;
    let numbers = Numbers {
        encoding: Encoding {
            scalar: scalar_type(&header)?,
            big_endian: header.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"], false)?,
        },
        dims,
        beside: channels,
        volumes,
        volume_step: volumes.max(1),
        scale: None,
    };
    numbers.check(path)?;
    let source = source(input, &header)?;
    let packing = match (is_text, is_packed) {
        (true, _) => Packing::Text,
        (_, true) => Packing::Zlib,
        _ => Packing::Raw,
    };
    let skip = skip(&header)?;

    let (origin, steps) = placement(&header, axis_count)?;
    let place = "header, `ElementSpacing`, `TransformMatrix` and `Offset`";
    let lattice = voxels::lattice(path, place, dims, origin, &steps)?;
    Ok(Image {
        format: "MetaImage",
        lattice,
        numbers,
        source,
        packing,
        skip,
        field: "value",
        unit: None,
        notes,
    })
}

/// Parses the fields of a header, and the lines behind `ElementDataFile = LIST`.
fn parse<'h>(path: &'h Path, head: &[u8]) -> Result<Header<'h>> {
    let mut header = Header::new(path);
    let mut end = 0;
    let mut lines = head.split_inclusive(|&b| b == b'\n').enumerate();
    for (number, line) in lines.by_ref() {
        end += line.len();
        let text = String::from_utf8_lossy(line.trim_ascii());
        if text.is_empty() {
            continue;
        }
        let Some((name, value)) = text.split_once('=') else {
            let place = format!("header, line {}", number + 1);
            let expected = "`Name = value`";
            let found = format!("`{}`", clip(&text));
            return Err(Error::format(path, place, expected, found, DAMAGED));
        };
        let (name, value) = (name.trim().to_owned(), value.trim().to_owned());
        let is_last = name == "ElementDataFile";
        let is_list = is_last && value.split_whitespace().next() == Some("LIST");
        header.fields.push((name, value));
        if is_list {
            let names = lines.map(|(_, line)| String::from_utf8_lossy(line.trim_ascii()));
            let names = names.filter(|name| !name.is_empty());
            header.list = names.map(|name| name.into_owned()).collect();
            return Ok(header);
        }
        if is_last {
            header.end = Some(end);
            return Ok(header);
        }
    }
    Err(header.fault("ElementDataFile", "this field, the last of the header", ""))
}

impl Header<'_> {
    fn flag(&self, names: &[&str], default: bool) -> Result<bool> {
        let Some(text) = self.get(names) else {
            return Ok(default);
        };
        match text.to_ascii_lowercase().as_str() {
            "true" | "t" | "1" => Ok(true),
            "false" | "f" | "0" => Ok(false),
            _ => Err(self.fault(names[0], "True or False", text)),
        }
    }
}

/// Returns the position of the first sample, and the steps along the axes of space.
fn placement(header: &Header<'_>, axis_count: usize) -> Result<(DVec3, Vec<DVec3>)> {
    let of_space = axis_count.min(3);
    let vector = |numbers: &[f64]| {
        let mut vector = [0.0; 3];
        vector[..of_space].copy_from_slice(&numbers[..of_space]);
        DVec3::from_array(vector)
    };
    let spacing = match header.numbers(&["ElementSpacing"], axis_count, "numbers")? {
        Some(spacing) => spacing,
        None => header
            .numbers(&["ElementSize"], axis_count, "numbers")?
            .unwrap_or_else(|| vec![1.0; axis_count]),
    };
    let origin = header.numbers(&["Offset", "Position", "Origin"], axis_count, "numbers")?;
    let origin: Vec<f64> = origin.unwrap_or_else(|| vec![0.0; axis_count]);
    let names = ["TransformMatrix", "Rotation", "Orientation"];
    let rows: Option<Vec<f64>> = header.numbers(&names, axis_count * axis_count, "numbers")?;
    let steps = (0..of_space).map(|axis| {
        let direction = match &rows {
            Some(rows) => vector(&rows[axis * axis_count..]),
            None => DVec3::AXES[axis],
        };
        direction * spacing[axis]
    });
    Ok((vector(&origin), steps.collect()))
}

fn scalar_type(header: &Header<'_>) -> Result<ScalarType> {
    let text = header.required("ElementType")?;
    let name = text.strip_suffix("_ARRAY").unwrap_or(text);
    Ok(match name {
        "MET_CHAR" | "MET_ASCII_CHAR" => ScalarType::I8,
        "MET_UCHAR" => ScalarType::U8,
        "MET_SHORT" => ScalarType::I16,
        "MET_USHORT" => ScalarType::U16,
        // MetaIO's long has 32 bits in files on every machine.
        "MET_INT" | "MET_LONG" => ScalarType::I32,
        "MET_UINT" | "MET_ULONG" => ScalarType::U32,
        "MET_LONG_LONG" => ScalarType::I64,
        "MET_ULONG_LONG" => ScalarType::U64,
        "MET_FLOAT" => ScalarType::F32,
        "MET_DOUBLE" => ScalarType::F64,
        _ => {
            let expected = "a type of numbers, from MET_CHAR to MET_DOUBLE";
            return Err(header.fault("ElementType", expected, text));
        }
    })
}

fn skip(header: &Header<'_>) -> Result<Skip> {
    let size = header.skipped("HeaderSize")?;
    Ok(Skip {
        lines: 0,
        bytes: u64::try_from(size).unwrap_or(0),
        to_the_end: size < 0,
    })
}

fn source(input: Input<'_>, header: &Header<'_>) -> Result<Source> {
    let path = input.path;
    let text = header.required("ElementDataFile")?;
    if text.eq_ignore_ascii_case("local") {
        return Ok(Source::Attached(header.end.unwrap_or(0) as u64));
    }
    let words: Vec<&str> = text.split_whitespace().collect();
    if words.first() == Some(&"LIST") {
        return Ok(Source::Beside(header.listed()?));
    }
    let numbers = words.iter().skip(1).filter_map(|w| w.parse().ok());
    let numbers: Vec<i64> = numbers.collect();
    if text.contains('%') && words.len() == 4 && numbers.len() == 3 {
        let range = [numbers[0], numbers[1], numbers[2]];
        return Ok(Source::Beside(voxels::by_pattern(input, words[0], range)?));
    }
    Ok(Source::Beside(vec![voxels::beside(path, text)?]))
}
