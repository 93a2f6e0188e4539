//! Reads a file as images: the attributes of each frame, and its numbers.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use flate2::read::DeflateDecoder;
use glam::DVec3;

use super::data_set::{Coding, DAMAGED, DataSet, Fault, is_vr, read_group, read_into};
use super::groups::Groups;
use super::pixels::{self, Layout};
use super::scale::Scale;
use super::syntax::{Syntax, UNPACK};
use super::tags;
use crate::error::{Error, Result};
use crate::scene::Values;

/// Length of the bytes before the first element, and the letters at their end.
const PREAMBLE: usize = 132;
const MAGIC: &[u8] = b"DICM";

/// Greatest size of an inflated data set: a constant, and a factor of the file's length.
const LEAST_INFLATED: u64 = 12 << 20;
const INFLATION: u64 = 3;

/// Greatest memory for the numbers of a series: a constant, and a factor of its files' lengths.
const LEAST_READ: usize = 32 << 20;
const READ_PER_BYTE: usize = 7;

const UNIT_CODES: [(&str, &str); 6] = [
    ("BQML", "Bq/ml"),
    ("CM2ML", "cm²/ml"),
    ("GML", "g/ml"),
    ("GY", "Gy"),
    ("PROPCPS", ""),
    ("CNTS", "counts"),
];

const CT: &str = "1.2.840.10008.5.1.4.1.1.2";
const WHOLE_SLIDE: &str = "1.2.840.10008.5.1.4.1.1.77.1.6";
const DIRECTORY: &str = "1.2.840.10008.1.3.10";

/// A frame.
#[derive(Debug)]
pub(super) struct Slice {
    pub(super) place: Place,
    /// Image number, index of its file, and index of the frame in the file; they sort frames.
    pub(super) order: (i64, usize, usize),
    pub(super) components: Vec<Values>,
}

/// Position of a frame, as far as it is stated.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// Centre of the first pixel.
    pub(super) position: Option<DVec3>,
    /// Directions along a row and along a column.
    pub(super) axes: Option<[DVec3; 2]>,
    /// Steps from one pixel to the next along each of these directions.
    pub(super) steps: [f64; 2],
    /// True if the steps have units of length.
    pub(super) has_steps: bool,
    /// Distance to the next frame.
    pub(super) distance: Option<f64>,
}

/// A file that has been read.
#[derive(Debug)]
pub(super) struct Image {
    pub(super) slices: Vec<Slice>,
    pub(super) unit: Option<String>,
    pub(super) notes: Vec<String>,
}

/// Bytes that the numbers of a series may still use.
#[derive(Debug)]
pub(super) struct Budget(usize);

impl Budget {
    pub(super) fn new() -> Self {
        Self(LEAST_READ)
    }
}

/// Returns true if a file begins as DICOM files do.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    head.get(PREAMBLE - MAGIC.len()..PREAMBLE) == Some(MAGIC)
}

/// Returns true if a file may begin with a bare data set: two elements of groups 2 or 8 in ascending order.
pub(in crate::io) fn looks_bare(head: &[u8]) -> bool {
    let element = |at: usize| {
        let tag: &[u8; 4] = head.get(at..)?.first_chunk()?;
        let rest: &[u8; 4] = head.get(at + 4..)?.first_chunk()?;
        let [low, high, more @ ..] = tag;
        let element = u16::from_le_bytes(*more);
        let len = match is_vr(&[rest[0], rest[1]]) {
            true => usize::from(u16::from_le_bytes([rest[2], rest[3]])),
            false => usize::try_from(u32::from_le_bytes(*rest)).ok()?,
        };
        let group = u16::from_le_bytes([*low, *high]);
        matches!(group, 2 | 8).then_some((group, element, at.checked_add(8)?.checked_add(len)?))
    };
    let Some((group, number, end)) = element(0) else {
        return false;
    };
    let next = element(end);
    next.is_some_and(|(next_group, next, _)| (group, number) < (next_group, next))
}

/// Reads the first group, which states the syntax, and returns the start of the bytes behind it.
fn start<'b>(bytes: &'b [u8], meta: &mut DataSet<'b>) -> std::result::Result<usize, Fault> {
    let at = if looks_like(bytes) { PREAMBLE } else { 0 };
    read_group(bytes, at, 2, meta)
}

/// Returns the layout of elements, from the syntax or from the first element.
fn coding(stated: Option<Syntax>, body: &[u8]) -> Coding {
    let plain = Coding {
        // The first groups are below 256, so a first byte of 0 means big-endian.
        big_endian: body.first() == Some(&0) && body.get(1) != Some(&0),
        ..Coding::EXPLICIT
    };
    stated.map_or(plain, |syntax| syntax.coding).as_found(body)
}

/// Returns the series of a file from its first bytes; `None` if they do not contain it.
pub(super) fn series_of(head: &[u8]) -> Option<String> {
    let mut meta = DataSet::default();
    let at = start(head, &mut meta).ok()?;
    let uid = meta.text(tags::TRANSFER_SYNTAX);
    let syntax = uid.map_or(Some(Syntax::PLAIN), |uid| Syntax::of(uid).ok());
    let syntax = syntax.unwrap_or(Syntax::PLAIN);
    let mut inflated = Vec::new();
    let body = if syntax.is_deflated {
        let most = head.len() as u64 * INFLATION + LEAST_INFLATED;
        let unpacked = DeflateDecoder::new(&head[at..]).take(most);
        // Truncated input gives fewer bytes.
        std::io::BufReader::new(unpacked)
            .read_to_end(&mut inflated)
            .ok();
        &inflated[..]
    } else {
        &head[at..]
    };
    let mut set = DataSet::default();
    let coding = coding(uid.map(|_| syntax), body);
    // A fault at the end of the bytes is ignored.
    read_into(body, 0, coding, &mut set).ok();
    set.text(tags::SERIES).map(str::to_owned)
}

/// Reads all frames of a file; returns `None` if it is no image.
///
/// - `number`: index of the file in its series.
///
/// # Errors
/// The data set is damaged, or has a feature that is not supported.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    number: usize,
    budget: &mut Budget,
) -> Result<Option<Image>> {
    let at_fault = |fault: Fault| {
        let place = format!("data set, byte {}", fault.at);
        Error::format(path, place, fault.expected, fault.found, DAMAGED)
    };
    let mut meta = DataSet::default();
    let at = start(bytes, &mut meta).map_err(at_fault)?;
    let uid = meta.text(tags::TRANSFER_SYNTAX);
    let syntax = uid.map_or(Ok(Syntax::PLAIN), Syntax::of);
    let syntax = syntax.map_err(|refused| {
        let expected = "uncompressed or deflated elements; pixels uncompressed, in run lengths, or in JPEG \
                        (baseline, extended or lossless)";
        let found = format!("{}, transfer syntax {}", refused.name, uid.unwrap_or(""));
        Error::format(path, "transfer syntax", expected, found, refused.advice)
    })?;
    let body = match syntax.is_deflated {
        true => Cow::Owned(inflated(path, bytes, at)?),
        false => Cow::Borrowed(&bytes[at..]),
    };
    let mut set = DataSet::default();
    let coding = coding(uid.map(|_| syntax), &body);
    read_into(&body, 0, coding, &mut set).map_err(at_fault)?;
    budget.0 = budget
        .0
        .saturating_add(bytes.len().saturating_mul(READ_PER_BYTE));
    let syntax = Syntax { coding, ..syntax };
    images(path, &set, syntax, number, budget)
}

/// Inflates the bytes behind the first group.
fn inflated(path: &Path, bytes: &[u8], at: usize) -> Result<Vec<u8>> {
    let most = (bytes.len() as u64).saturating_mul(INFLATION) + LEAST_INFLATED;
    let mut out = Vec::new();
    let mut unpacked = DeflateDecoder::new(&bytes[at..]).take(most + 1);
    let result = unpacked.read_to_end(&mut out);
    let found = match result {
        Err(e) => e.to_string(),
        Ok(_) if out.len() as u64 > most => format!("more than {most} bytes"),
        Ok(_) => return Ok(out),
    };
    let place = "deflated data set";
    let expected = "what can be unpacked to some times its bytes";
    let advice = "unpack it: `dcmconv +te IN OUT`";
    Err(Error::format(path, place, expected, found, advice))
}

fn images(
    path: &Path,
    set: &DataSet<'_>,
    syntax: Syntax,
    number: usize,
    budget: &mut Budget,
) -> Result<Option<Image>> {
    let class = set.text(tags::SOP_CLASS).unwrap_or("");
    let element = tags::PIXELS.iter().find_map(|tag| set.get(*tag));
    let (Some(element), Some(_)) = (element, set.short(tags::ROWS)) else {
        return Ok(None);
    };
    if class == WHOLE_SLIDE {
        let expected = "images of a volume, or one image";
        let found = "tiles of a whole slide";
        let advice = "save it as TIFF";
        return Err(Error::format(path, "SOP class", expected, found, advice));
    }
    let at_fault = |fault: pixels::Fault| {
        Error::format(path, "pixels", fault.expected, fault.found, fault.advice)
    };
    let layout = Layout::of(set, syntax).map_err(at_fault)?;
    let scales: Vec<Scale> = {
        let count = set
            .items(tags::PER_FRAME_GROUPS)
            .len()
            .clamp(1, layout.frames);
        let frames = (0..count).map(|i| Groups::of(set, i));
        frames.map(|groups| Scale::of(&groups, &layout)).collect()
    };
    let is_scaled = scales.iter().any(Scale::makes_floats);
    let needed = layout.bytes_read(is_scaled);
    let Some(left) = budget.0.checked_sub(needed) else {
        let expected = format!(
            "at most {} bytes of numbers from files of this size",
            budget.0
        );
        let found = format!("{needed} bytes in {} frames", layout.frames);
        let advice = UNPACK;
        return Err(Error::format(path, "pixels", expected, found, advice));
    };
    budget.0 = left;
    let frames = layout.read(element).map_err(at_fault)?;

    let order = set.number(tags::INSTANCE_NUMBER).unwrap_or(0.0);
    #[allow(clippy::cast_possible_truncation, reason = "casts saturate")]
    let order = order as i64;
    let places = places(set, &layout);
    let slices = frames.into_iter().zip(places).enumerate();
    let slices = slices.map(|(i, (components, place))| {
        let scale = scales.get(i).or(scales.first());
        Slice {
            place,
            order: (order, number, i),
            components: match scale {
                Some(scale) if components.len() == 1 => scale.apply(components),
                _ => components,
            },
        }
    });
    let slices = slices.collect();
    Ok(Some(Image {
        slices,
        unit: unit(set, class),
        notes: notes(set),
    }))
}

/// Notes the attributes of a file's numbers that are not applied.
fn notes(set: &DataSet<'_>) -> Vec<String> {
    let mut notes = Vec::new();
    if set.get(tags::MODALITY_LUT).is_some() {
        notes.push("Numbers are as stored: the table of the modality is not applied.".to_owned());
    }
    match set.text(tags::PHOTOMETRIC) {
        Some("PALETTE COLOR") => {
            notes.push("Numbers are places in the palette, whose colours are left out.".to_owned())
        }
        Some("MONOCHROME1") => {
            notes
                .push("The file asks for low numbers to be shown bright (MONOCHROME1).".to_owned());
        }
        _ => {}
    }
    notes
}

/// Returns the unit of the numbers.
fn unit(set: &DataSet<'_>, class: &str) -> Option<String> {
    let groups = Groups::of(set, 0);
    let rescale = groups.text(tags::PIXEL_VALUE_TRANSFORMATION, tags::RESCALE_TYPE);
    let stated = rescale.or_else(|| set.text(tags::UNITS));
    let stated = stated.or_else(|| set.text(tags::DOSE_UNITS));
    // Scaled CT numbers are in HU, unless the file states another unit.
    let is_scaled = set.get(tags::RESCALE_SLOPE).is_some();
    let stated = stated.or((class == CT && is_scaled).then_some("HU"))?;
    let known = UNIT_CODES.iter().find(|(code, _)| *code == stated);
    let unit = known.map_or(stated, |(_, unit)| unit);
    let is_unit = !matches!(unit, "" | "US" | "NONE" | "RELATIVE");
    is_unit.then(|| unit.to_owned())
}

/// Returns the position of each frame.
fn places(set: &DataSet<'_>, layout: &Layout) -> Vec<Place> {
    let offsets = set.numbers(tags::FRAME_OFFSETS);
    let offsets = offsets.filter(|offsets| offsets.len() == layout.frames);
    let first_offset = offsets.as_ref().and_then(|o| o.first().copied());
    let detector = set.item(tags::DETECTORS);
    let of_detector = |tag| detector?.numbers(tag);
    let has_groups = !set.items(tags::PER_FRAME_GROUPS).is_empty();
    let place = |i: usize| {
        let groups = Groups::of(set, i);
        let position = groups.numbers_of(tags::PLANE_POSITION, tags::IMAGE_POSITION);
        let position = position.or_else(|| of_detector(tags::IMAGE_POSITION)?.try_into().ok());
        let axes = groups.numbers_of(tags::PLANE_ORIENTATION, tags::IMAGE_ORIENTATION);
        let axes = axes.or_else(|| of_detector(tags::IMAGE_ORIENTATION)?.try_into().ok());
        let axes =
            axes.map(|[a, b, c, d, e, f]: [f64; 6]| [DVec3::new(a, b, c), DVec3::new(d, e, f)]);
        // In standard files the axes have length 1, up to their number of digits.
        let axes = axes.filter(|axes| axes[0].cross(axes[1]).length() > 0.5);
        // The first number is the step from one row to the next.
        let spacing = groups
            .numbers_of(tags::PIXEL_MEASURES, tags::PIXEL_SPACING)
            .or_else(|| set.numbers_of(tags::IMAGER_PIXEL_SPACING));
        let is_step = |steps: &[f64; 2]| steps.iter().all(|step| *step > 0.0);
        let spacing = spacing.filter(is_step);
        let aspect = || set.numbers_of(tags::PIXEL_ASPECT).filter(is_step);
        let [down, across] = spacing.or_else(aspect).unwrap_or([1.0, 1.0]);
        let distance = groups
            .number(tags::PIXEL_MEASURES, tags::SPACING_BETWEEN_SLICES)
            .filter(|x| *x != 0.0);
        let thickness = groups.number(tags::PIXEL_MEASURES, tags::SLICE_THICKNESS);
        let distance = distance.or(thickness.filter(|x| *x > 0.0));
        let mut place = Place {
            size: layout.size,
            position: position.map(DVec3::from_array),
            axes,
            steps: [across, down],
            has_steps: spacing.is_some(),
            distance,
        };
        // If many frames share one position, they follow along the normal.
        if let (Some([x, y]), Some(first), false) = (axes, place.position, has_groups) {
            let normal = x.cross(y);
            let along = match (&offsets, first_offset) {
                (Some(offsets), Some(0.0)) => Some(offsets[i]),
                // The offsets are positions along the patient's axis.
                (Some(offsets), Some(start)) => Some((offsets[i] - start) * normal.z.signum()),
                _ => distance.map(|distance| distance * i as f64),
            };
            place.position = along.map(|along| first + normal * along);
            if layout.frames == 1 {
                place.position = Some(first);
            }
        }
        place
    };
    (0..layout.frames).map(place).collect()
}

/// Returns the error for a file without pixels, with the reason.
pub(super) fn no_image(path: &Path, bytes: &[u8]) -> Error {
    let mut meta = DataSet::default();
    let mut set = DataSet::default();
    if let Ok(at) = start(bytes, &mut meta) {
        let uid = meta.text(tags::TRANSFER_SYNTAX);
        let syntax = uid.and_then(|uid| Syntax::of(uid).ok());
        let body = &bytes[at..];
        read_into(body, 0, coding(syntax, body), &mut set).ok();
    }
    let expected = "an image";
    let is_directory = set.text(tags::SOP_CLASS).is_none()
        && meta.text(tags::MEDIA_STORAGE_CLASS) == Some(DIRECTORY);
    let (found, advice) = match (is_directory, set.text(tags::MODALITY)) {
        (true, _) => (
            "a directory of other files (DICOMDIR)".to_owned(),
            "give one of the images, or their folder",
        ),
        (_, Some(modality)) => (
            format!("a file without pixels, of the modality {modality}"),
            "give an image of the series",
        ),
        _ => (
            "a file without pixels".to_owned(),
            "give an image of the series",
        ),
    };
    Error::format(path, "pixels", expected, found, advice)
}
