//! Writes splats to files, completely or not at all.

use std::borrow::Cow;
use std::path::Path;

use glam::DQuat;

use super::encoded_splats::{PlyForm, SplatFileOptions, median_size};
use super::gltf_splats::Container;
use super::sog::files::META;
use super::splat_axes::SplatAxes;
use super::{csv_write, gltf_splats, ksplat_write, sog, splat, spz_write, usd};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::bytes::atomic::write_bytes_atomically;
use crate::io::bytes::file::extension;
use crate::io::picture::image_file::check_folder;
use crate::io::ply;
use crate::io::vtk::vtu_write;

/// Third scale of a flat splat, as a share of the next larger one, in a format whose viewers expect volume.
///
/// Logarithms have no zero, and viewers that compute the variance in f32 keep ratios up to some 1:4000. Seen
/// edge-on, such a splat is a hundredth as wide as seen face-on: below a pixel's low-pass filter, .5 px, unless
/// its face is 50 px across.
pub const FLAT_SHARE: f32 = 0.01;

/// The result of writing a file.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenSplats {
    /// Size of the file and of those beside it.
    pub bytes: usize,
    /// The greatest distance along an axis between neighbouring positions that the file can represent, world
    /// units.
    pub position_quantum: f64,
    /// Rotation from the given splats to those read back from the file: see [`SplatFileOptions::up`].
    pub turn: DQuat,
    /// Index among the given splats of each splat of the file; empty if the format keeps the order.
    pub order: Vec<usize>,
    /// Notes on what was lost, one sentence each, for people.
    pub notes: Vec<String>,
}

/// A format for writing splats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Ply,
    PackedPly,
    Splat,
    Ksplat,
    Spz,
    Sog,
    SogFolder,
    Glb,
    Gltf,
    Usda,
    Usdc,
    Usdz,
    Csv,
    Vtu,
}

impl Format {
    /// The format by the extension; `None` if it is not known.
    fn of(path: &Path) -> Option<Self> {
        match extension(path).as_str() {
            "ply"
                if path
                    .file_stem()
                    .is_some_and(|s| extension(Path::new(s)) == "compressed") =>
            {
                Some(Self::PackedPly)
            }
            "ply" => Some(Self::Ply),
            "splat" => Some(Self::Splat),
            "spz" => Some(Self::Spz),
            "ksplat" => Some(Self::Ksplat),
            "sog" => Some(Self::Sog),
            "json" if path.file_name().is_some_and(|name| name == META) => Some(Self::SogFolder),
            "glb" => Some(Self::Glb),
            "gltf" => Some(Self::Gltf),
            "usda" => Some(Self::Usda),
            "usdc" => Some(Self::Usdc),
            "usdz" => Some(Self::Usdz),
            "csv" => Some(Self::Csv),
            "vtu" => Some(Self::Vtu),
            _ => None,
        }
    }

    /// The axes of the writer's input. SPZ's writer converts them to the file's axes. VTK's grids have no fixed
    /// axes.
    fn axes(self) -> Option<SplatAxes> {
        match self {
            Self::Ply
            | Self::PackedPly
            | Self::Splat
            | Self::Ksplat
            | Self::Spz
            | Self::Sog
            | Self::SogFolder
            | Self::Csv => Some(SplatAxes::RightDownForward),
            Self::Glb | Self::Gltf | Self::Usda | Self::Usdc | Self::Usdz => {
                Some(SplatAxes::LeftUpForward)
            }
            Self::Vtu => None,
        }
    }
}

/// Checks whether [`write_splats`] could write to `path`, before splats are made.
///
/// # Errors
/// An extension other than `ply`, `splat`, `ksplat`, `spz`, `sog`, `glb`, `gltf`, `usda`, `usdc`, `usdz`, `csv` and `vtu`, and a name
/// other than `meta.json`; a missing folder.
pub fn check_splats_path(path: &Path) -> Result<()> {
    format_of(path).map(|_| ())
}

fn format_of(path: &Path) -> Result<Format> {
    if let Some(format) = Format::of(path) {
        check_folder(path)?;
        return Ok(format);
    }
    let extension = extension(path);
    Err(Error::format(
        path,
        "output",
        "a name that ends in .ply, .splat, .ksplat, .spz, .sog, .glb, .gltf, .usda, .usdc, .usdz, .csv or .vtu, or meta.json",
        if extension.is_empty() {
            "no extension".into()
        } else {
            format!("`.{extension}`")
        },
        "choose one of these",
    ))
}

/// Writes splats in the format of the file's extension.
///
/// | | `.ply` | `.compressed.ply` | `.splat` | `.spz` (version 3 or 4) | `.glb` (`KHR_gaussian_splatting`) | `.sog` (version 2) |
/// |---|---|---|---|---|---|---|
/// | position | f32 | 10 or 11 bits of the box of 256 splats, the step reported | f32 | 24 bits, the step reported | f32, and a node's f64 offset far from the origin | 16 bits of the range of logarithms, the step reported |
/// | scales | f32 logarithm | 10 or 11 bits of the box of logarithms | f32 | 8 bits: 3 % | f32 | one of 256 numbers, the error reported |
/// | rotation | f32 | 10 bits: .001 | 8 bits: .004 | 10 bits: .001 | f32 | 8 bits: .008 |
/// | opacity | f32 logit | 8 bits | 8 bits | 8 bits | f32 | 8 bits |
/// | constant colour | f32 | 8 bits of the box of 256 splats | 8 bits, 0 to 1 | 8 bits: .007, -1.2 to 2.2 in code | f32 | one of 256 numbers, the error reported |
/// | harmonics | f32 | 8 bits: .016, -4 to 4 | lost | 8 bits: .004, -1 to 1 | f32 | one of up to 65,536 sets, of 256 numbers, the error reported |
/// | anti-aliasing mark | kept | lost | lost | kept | lost | kept |
/// | order | kept | along a Morton curve | by size times opacity | kept | kept | along a Morton curve |
///
/// `.ksplat` (mode 0) has f32 for all but colours and opacities, which are those of `.splat`, and harmonics up to degree 2; it keeps
/// the order and loses the mark. `meta.json` is a SOG that is no archive: its images are written into the same folder.
///
/// `.gltf` is as `.glb`, with its numbers in text (base64). `.usda` (in text), `.usdc` and `.usdz` (in binary form) keep what `.glb` keeps, and flat splats
/// without thickness: if all splats are flat, they are surflets. `.csv` is a table with the columns and the numbers of `.ply`, positions
/// in f64, and without the mark.
///
/// `.vtu` is for ParaView and other readers of VTK: vertices at positions in f64, with shapes as tensors,
/// scales, rotations and opacities in f32 and the constant colour in bytes. Harmonics and the mark are lost,
/// and nothing is rotated.
///
/// Errors are the greatest ones: of rotations in a component of the unit quaternion, of colours in a
/// coefficient. Numbers outside a range are clamped and counted in the notes. In all formats but the flat form
/// of PLY and USD's surflets an axis of length 0 becomes [`FLAT_SHARE`] of the next larger. In PLY an opacity keeps 3.1e-7 from 0
/// and 1, because a logit is finite.
///
/// SPZ's [extension records](SplatCloud::records) are written to `.spz`, as far as they still hold.
///
/// [`SplatFileOptions::up`] is the up direction, from which the splats are rotated to the format's axes
/// ([`SplatAxes`]). Without it, reading the file returns the same coordinates; for SPZ, writing converts to the
/// format's axes and reading converts back.
///
/// # Errors
/// Another extension; no splats; a number that no file should hold (not finite, an opacity outside 0 to 1, a
/// negative scale or three zeros, a quaternion of zeros); splats with volume in the flat form; positions or
/// counts beyond the format; an option of another format; a missing folder.
pub fn write_splats(
    path: &Path,
    cloud: &SplatCloud,
    options: &SplatFileOptions,
) -> Result<WrittenSplats> {
    let format = format_of(path)?;
    cloud.check(path)?;
    let of_another = |place: &str, expected: &str, advice: &str| {
        let found = format!("`.{}`", extension(path));
        Err(Error::format(path, place, expected, found, advice))
    };
    if options.form == PlyForm::Surfels && format != Format::Ply {
        return of_another(
            "form",
            "a .ply file for surfels without thickness",
            "write a .ply file, or splats with a thin third axis",
        );
    }
    if options.spz_version.is_some() && format != Format::Spz {
        let expected = "a .spz file for a version of SPZ";
        return of_another("version", expected, "write a .spz file, or name no version");
    }
    let turn = options.up.zip(format.axes());
    let turn = turn.map_or(DQuat::IDENTITY, |(up, axes)| axes.turn_from(up));
    let mut cloud = Cow::Borrowed(cloud);
    if turn != DQuat::IDENTITY {
        cloud.to_mut().turn(turn);
    }
    let keeps_light = matches!(
        format,
        Format::Glb | Format::Gltf | Format::Usda | Format::Usdc | Format::Usdz
    );
    let loses_view = cloud.is_linear && !keeps_light && cloud.to_mut().encode();
    let cloud = cloud.as_ref();
    let mut encoded = match format {
        Format::Ply => ply::splats::encode(path, cloud, options.form)?,
        Format::PackedPly => ply::packed_write::encode(path, cloud)?,
        Format::Splat => splat::encode(cloud),
        Format::Spz => spz_write::encode(path, cloud, options.spz_version.unwrap_or_default())?,
        Format::Ksplat => ksplat_write::encode(path, cloud)?,
        Format::Sog => sog::encode(path, cloud, true)?,
        Format::SogFolder => sog::encode(path, cloud, false)?,
        Format::Glb => gltf_splats::encode(path, cloud, Container::Binary)?,
        Format::Gltf => gltf_splats::encode(path, cloud, Container::Text)?,
        Format::Usda => usd::encode(path, cloud, usd::Container::Text)?,
        Format::Usdc => usd::encode(path, cloud, usd::Container::Binary)?,
        Format::Usdz => usd::encode(path, cloud, usd::Container::Archive)?,
        Format::Csv => csv_write::encode(cloud),
        Format::Vtu => vtu_write::encode(cloud),
    };
    if loses_view {
        let note = "colours in linear light that depend on the view are lost: the format has sRGB codes alone";
        encoded.notes.push(note.into());
    }
    encoded
        .notes
        .extend(cloud.records.notes(format == Format::Spz));
    // A tenth of a splat is visible.
    let size = median_size(cloud);
    if encoded.position_quantum > 0.1 * size {
        encoded.notes.push(format!(
            "positions are rounded to steps of {:.2e}, half of all splats are smaller than {size:.2e}: \
             move the scene to the origin, or scale it",
            encoded.position_quantum
        ));
    }
    // The file that names others goes first and comes last, so that whoever finds it finds its own.
    if !encoded.beside.is_empty() && path.is_file() {
        let failed = |e| Error::io(path, "replacing", e, "check its permissions");
        std::fs::remove_file(path).map_err(failed)?;
    }
    let mut bytes = encoded.bytes.len();
    for (name, other) in &encoded.beside {
        write_bytes_atomically(&path.with_file_name(name), other)?;
        bytes += other.len();
    }
    write_bytes_atomically(path, &encoded.bytes)?;
    Ok(WrittenSplats {
        bytes,
        position_quantum: encoded.position_quantum,
        turn,
        order: encoded.order,
        notes: encoded.notes,
    })
}

impl SplatCloud {
    /// Checks that every number can be stored in a file.
    fn check(&self, path: &Path) -> Result<()> {
        let count = self.positions.len();
        let fault = |place: String, expected: &str, found: String| {
            Err(Error::format(
                path,
                place,
                expected,
                found,
                "leave such splats out before writing",
            ))
        };
        if count == 0 {
            return fault("splats".into(), "at least one", "none".into());
        }
        self.validate().map_err(|error| error.in_file(path))?;
        for i in 0..count {
            let place = || format!("splat {i}");
            let p = self.positions[i];
            if !(p.is_finite() && p.as_vec3().is_finite()) {
                return fault(place(), "a position in single precision", p.to_string());
            }
            let s = self.scales[i];
            let is_size = s.iter().all(|&s| s >= 0.0 && s.is_finite());
            if !(is_size && s.iter().any(|&s| s > 0.0)) {
                return fault(place(), "scales from 0 up, one above 0", format!("{s:?}"));
            }
            let q = self.rotations[i];
            if !(q.iter().all(|q| q.is_finite()) && q.iter().any(|&q| q != 0.0)) {
                return fault(place(), "a quaternion", format!("{q:?}"));
            }
            let a = self.opacities[i];
            if !(0.0..=1.0).contains(&a) {
                return fault(place(), "an opacity from 0 to 1", a.to_string());
            }
            if !self.coefficients(i).iter().all(|c| c.is_finite()) {
                return fault(place(), "a finite colour", "another".into());
            }
        }
        Ok(())
    }

    /// The coefficients of splat `i`.
    pub(in crate::io) fn coefficients(&self, i: usize) -> &[f32] {
        let stride = self.harmonics_stride();
        &self.harmonics[i * stride..][..stride]
    }

    /// The scales of splat `i`, none of them 0: see [`FLAT_SHARE`].
    pub(in crate::io) fn thick_scales(&self, i: usize) -> [f32; 3] {
        let mut scales = self.scales[i];
        let positive = scales.into_iter().filter(|s| *s > 0.0);
        let mut least = positive.fold(f32::MAX, f32::min);
        // The first zero axis gets the larger thickness: the middle axis of a needle; the next gets the smaller
        // one.
        for scale in &mut scales {
            if !(*scale > 0.0) {
                least = (least * FLAT_SHARE).max(f32::MIN_POSITIVE);
                *scale = least;
            }
        }
        scales
    }

    /// The quaternion w, x, y, z of splat `i`, of length 1.
    pub(in crate::io) fn unit_rotation(&self, i: usize) -> [f64; 4] {
        let q = self.rotations[i].map(f64::from);
        let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        q.map(|c| c / length)
    }
}
