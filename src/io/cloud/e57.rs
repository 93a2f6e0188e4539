//! Reads scans in E57 (`.e57`, ASTM E2807), an XML index and packed columns of points in pages with checksums. The
//! crate `e57` decodes them.
//!
//! A file contains one or more scans. Each has a pose that transforms its points to the coordinates of the file; all
//! scans are merged. Points without a valid position are left out. Colours are scaled by their stated range.
//! Intensities stay as stored.

use std::io::Cursor;

use e57::{CartesianCoordinate, E57Reader, PointCloud};
use glam::DVec3;

use super::{DAMAGED, colour_fields};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::particles::table::{dataset, scalar_field};
use crate::scene::Values;

/// Least number of bytes per point in a file; a position alone needs more.
const LEAST_POINT: u64 = 2;

/// Encoded grey for points without a colour in a file whose other points have one.
const NO_COLOUR: f32 = 0.5;

/// Points of all scans.
#[derive(Default)]
struct Points {
    positions: Vec<DVec3>,
    intensities: Vec<f32>,
    colours: [Vec<f32>; 3],
    scans: Vec<u16>,
    invalid: usize,
    colourless: usize,
}

/// Reads all scans.
///
/// # Errors
/// The errors of the crate; the file states more points than it can contain.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let fault = |e: e57::Error| {
        let expected = "an E57 file whose pages and index are sound";
        Error::format(path, "contents", expected, e.to_string(), DAMAGED)
    };
    let mut reader = E57Reader::new(Cursor::new(&*bytes)).map_err(fault)?;
    let clouds = reader.pointclouds();
    let stated = clouds
        .iter()
        .fold(0, |n: u64, cloud| n.saturating_add(cloud.records));
    if stated > bytes.len() as u64 / LEAST_POINT {
        let expected = format!("points of at least {LEAST_POINT} bytes");
        let found = format!("{stated} points in {} bytes", bytes.len());
        return Err(Error::format(path, "index", expected, found, DAMAGED));
    }
    let has_colours = clouds.iter().any(PointCloud::has_color);
    let has_intensities = clouds.iter().any(PointCloud::has_intensity);
    let mut points = Points::default();
    for (number, cloud) in clouds.iter().enumerate() {
        let mut simple = reader.pointcloud_simple(cloud).map_err(fault)?;
        simple.intensity_to_color(false);
        simple.normalize_intensity(false);
        for point in simple {
            let point = point.map_err(fault)?;
            let CartesianCoordinate::Valid { x, y, z } = point.cartesian else {
                points.invalid += 1;
                continue;
            };
            points.positions.push(DVec3::new(x, y, z));
            points.scans.push(u16::try_from(number).unwrap_or(u16::MAX));
            if has_intensities {
                points.intensities.push(point.intensity.unwrap_or(0.0));
            }
            if has_colours {
                let colour = point.color.map(|c| [c.red, c.green, c.blue]);
                points.colourless += usize::from(colour.is_none());
                let colour = colour.unwrap_or([NO_COLOUR; 3]);
                for (channel, x) in points.colours.iter_mut().zip(colour) {
                    channel.push(x);
                }
            }
        }
    }

    let mut fields = Vec::new();
    let mut notes = Vec::new();
    if has_intensities {
        fields.push(scalar_field("intensity", Values::F32(points.intensities)));
    }
    if has_colours {
        fields.extend(colour_fields(points.colours));
    }
    if clouds.len() > 1 {
        fields.push(scalar_field("scan", Values::U16(points.scans)));
        notes.push(format!("{} scans are put together.", clouds.len()));
    }
    if points.invalid > 0 {
        let count = points.invalid;
        notes.push(format!(
            "{count} points without a valid position are left out."
        ));
    }
    if points.colourless > 0 {
        let count = points.colourless;
        notes.push(format!("{count} points without a colour are grey."));
    }
    Ok(Dataset {
        notes,
        ..dataset(path, "E57 point cloud", points.positions, fields)?
    })
}
