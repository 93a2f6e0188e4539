//! Measures the losses of a written file of splats: reads it back, and compares its splats with those that were
//! written.

use std::mem::{replace, take};
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::data::dataset::{Dataset, Geometry};
use crate::data::splats::SplatCloud;
use crate::image::{Image, srgb_from_linear};
use crate::io::{OpenOptions, WrittenSplats, open};
use crate::math::{HARMONIC_0, rotation_matrix};
use crate::render::{Backend, Renderer, RendererOptions, Settings};
use crate::sample::{SampleOptions, index_u32, scene};
use crate::view::{Camera, DEFAULT_FOV_DEG, Lens, Viewpoint};
use crate::{Error, Result};

/// Directions of the compared pictures: degrees around the axis that points up.
const AZIMUTHS_DEG: [f64; 2] = [30.0, 210.0];
const ELEVATION_DEG: f64 = 20.0;
/// Pixels along a side of these pictures.
const SIDE: usize = 256;
/// Greatest number of splats in these pictures: of more, a piece in the middle is drawn.
const MOST_PICTURED: usize = 100_000;
/// Number of splats whose differences a task sums.
const CHUNK: usize = 1 << 14;
/// Tolerance of these pictures: their own errors are far below those of any format.
const TOLERANCE: f32 = 1e-3;

/// Root mean square and greatest of some differences.
#[derive(Default)]
struct Differences {
    squares: f64,
    greatest: f64,
    count: usize,
}

impl Differences {
    /// Measures the splats of a file, one difference or several each.
    fn of<I: IntoIterator<Item = f64>>(count: usize, of: impl Fn(usize) -> I + Sync) -> Self {
        let add = |sum: Self, x: f64| Self {
            squares: sum.squares + x * x,
            greatest: sum.greatest.max(x.abs()),
            count: sum.count + 1,
        };
        let of_chunk = |chunk: usize| {
            let splats = chunk * CHUNK..count.min((chunk + 1) * CHUNK);
            splats.flat_map(&of).fold(Self::default(), add)
        };
        let chunks: Vec<Self> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(of_chunk)
            .collect();
        // In one order, so that the sum does not depend on threads.
        chunks.into_iter().fold(Self::default(), |a, b| Self {
            squares: a.squares + b.squares,
            greatest: a.greatest.max(b.greatest),
            count: a.count + b.count,
        })
    }

    fn summary(&self) -> Value {
        let rms = (self.squares / self.count.max(1) as f64).sqrt();
        json!({ "rms": rms, "greatest": self.greatest })
    }
}

/// Reads a file of splats and compares it with the splats that were written; null if the format is not read as splats.
///
/// | key | differences, `rms` and `greatest` |
/// |---|---|
/// | `position` | distances, world units |
/// | `shape` | of variances, as shares of the greatest variance of each splat |
/// | `opacity` | of peak opacities |
/// | `colour` | of colours seen from everywhere, 0 to 1: sRGB codes, or linear light if both have that |
/// | `harmonics` | of the other coefficients |
///
/// `pictures` has the number of `splats` in pictures from two sides, and their `psnr`: dB of displayed codes over black, null
/// if they are equal. It is null if nothing is seen, or if the pictures cannot be drawn, which is noted.
///
/// # Errors
/// The errors of reading; another number of splats than were written.
pub(super) fn certificate(
    path: &Path,
    mut given: SplatCloud,
    written: &WrittenSplats,
    notes: &mut Vec<String>,
) -> Result<Value> {
    let mut dataset = open(path, &OpenOptions::default())?;
    let Geometry::Splats(found) = &mut dataset.geometry else {
        return Ok(Value::Null);
    };
    let [before, after] = [&given, found].map(|cloud| cloud.positions.len());
    if before != after {
        let expected = format!("{before}, which were written");
        let advice = "write another format, and report this";
        return Err(Error::format(
            path,
            "splats",
            expected,
            after.to_string(),
            advice,
        ));
    }
    if written.turn != DQuat::IDENTITY {
        given.turn(written.turn);
    }
    // A viewer of the file draws by the rule of its format; only a mark can be lost.
    if !given.rule.is_anti_aliased() {
        given.rule = found.rule;
    }
    // What depends on the view is lost with the linear light.
    let linear = (given.is_linear && !found.is_linear).then(|| given.clone());
    if linear.is_some() {
        given.encode();
    }
    let mut summary = compared(&given, linear.as_ref(), found, &written.order);
    drop(linear);
    if given.positions.len() > MOST_PICTURED {
        let piece = piece(&found.positions);
        let given_of = |&i: &u32| written.order.get(i as usize).map_or(i, |&j| index_u32(j));
        given = given.gathered(&piece.iter().map(given_of).collect::<Vec<u32>>());
        *found = take(found).gathered(&piece);
    }
    summary["pictures"] = pictures(dataset, given).unwrap_or_else(|error| {
        notes.push(format!("no pictures are compared: {error}"));
        Value::Null
    });
    Ok(summary)
}

/// Compares pictures of splats that were found and of those that were given.
fn pictures(mut found: Dataset, given: SplatCloud) -> Result<Value> {
    let splats = given.positions.len();
    let geometry = replace(&mut found.geometry, Geometry::Splats(given));
    let given = found.clone();
    found.geometry = geometry;
    let up = found.up().direction;
    let mut renderer = renderer_of(given)?;
    let cameras = cameras(&renderer, up, &AZIMUTHS_DEG);
    if cameras.is_empty() {
        return Ok(Value::Null);
    }
    let of_given = drawn(&mut renderer, &cameras, &settings())?;
    renderer = renderer_of(found)?;
    let of_found = drawn(&mut renderer, &cameras, &settings())?;
    Ok(json!({ "splats": splats, "psnr": psnr(&of_given, &of_found) }))
}

/// Returns the splats around one in the middle, as many as pictures show.
fn piece(positions: &[DVec3]) -> Vec<u32> {
    let mut all: Vec<u32> = (0..).take(positions.len()).collect();
    let middle = [0, 1, 2].map(|axis| {
        let along = |&a: &u32, &b: &u32| {
            positions[a as usize][axis].total_cmp(&positions[b as usize][axis])
        };
        let half = all.len() / 2;
        let (_, &mut median, _) = all.select_nth_unstable_by(half, along);
        positions[median as usize][axis]
    });
    let distance = |from: DVec3, i: u32| from.distance_squared(positions[i as usize]);
    // Between the walls of a room nothing may lie.
    let nearest = all.iter().copied().min_by(|&a, &b| {
        let middle = DVec3::from(middle);
        distance(middle, a).total_cmp(&distance(middle, b))
    });
    let from = nearest.map_or(DVec3::ZERO, |i| positions[i as usize]);
    all.select_nth_unstable_by(MOST_PICTURED, |&a, &b| {
        distance(from, a).total_cmp(&distance(from, b))
    });
    all.truncate(MOST_PICTURED);
    all.sort_unstable();
    all
}

/// Compares splats one by one.
///
/// - `linear`: the given splats in linear light, if colours were encoded.
/// - `order`: index among the given splats of each that was found; empty if the order is kept.
fn compared(
    given: &SplatCloud,
    linear: Option<&SplatCloud>,
    found: &SplatCloud,
    order: &[usize],
) -> Value {
    let count = found.positions.len();
    let given_of = |i: usize| order.get(i).copied().unwrap_or(i);
    let position = |i: usize| [given.positions[given_of(i)].distance(found.positions[i])];
    let shape = |i: usize| {
        let [a, b] = [(given, given_of(i)), (found, i)].map(|(cloud, i)| {
            let scales = cloud.scales[i].map(f64::from);
            variance(cloud, i, scales.into())
        });
        let greatest = given.scales[given_of(i)].into_iter().fold(0.0, f32::max);
        let off = [
            a.x_axis - b.x_axis,
            a.y_axis - b.y_axis,
            a.z_axis - b.z_axis,
        ];
        let off: f64 = off.into_iter().map(|column| column.length_squared()).sum();
        [off.sqrt() / f64::from(greatest).powi(2)]
    };
    let opacity = |i: usize| [f64::from(given.opacities[given_of(i)] - found.opacities[i])];
    // A file without harmonics has lost all.
    let coefficient = |cloud: &SplatCloud, i: usize, k: usize| {
        let stride = cloud.harmonics_stride();
        let own = &cloud.harmonics[i * stride..][..stride];
        f64::from(own.get(k).copied().unwrap_or(0.0))
    };
    let off = |given: &SplatCloud, i: usize, k: usize| {
        coefficient(given, given_of(i), k) - coefficient(found, i, k)
    };
    let colour = |i: usize| [0, 1, 2].map(|k| f64::from(HARMONIC_0) * off(given, i, k));
    let with_others = linear.unwrap_or(given);
    let most = with_others.harmonics_stride().max(found.harmonics_stride());
    let off = &off;
    let harmonics = |i: usize| (3..most).map(move |k| off(with_others, i, k));
    json!({
        "position": Differences::of(count, position).summary(),
        "shape": Differences::of(count, shape).summary(),
        "opacity": Differences::of(count, opacity).summary(),
        "colour": Differences::of(count, colour).summary(),
        "harmonics": Differences::of(count, harmonics).summary(),
    })
}

/// Returns the variance of a splat with these standard deviations along its axes.
pub(super) fn variance(cloud: &SplatCloud, i: usize, scales: DVec3) -> DMat3 {
    let [w, x, y, z] = cloud.rotations[i].map(f64::from);
    let factor = rotation_matrix(DQuat::from_xyzw(x, y, z, w)) * DMat3::from_diagonal(scales);
    factor * factor.transpose()
}

/// Returns a renderer of a data set, on the CPU.
pub(super) fn renderer_of(dataset: Dataset) -> Result<Renderer> {
    let sampled = scene(dataset, &SampleOptions::default())?;
    let options = RendererOptions {
        backend: Backend::Cpu,
        ..RendererOptions::default()
    };
    Renderer::with_options(sampled.volumes, options)
}

/// Returns cameras on several sides; none if nothing is seen.
pub(super) fn cameras(renderer: &Renderer, up: DVec3, azimuths_deg: &[f64]) -> Vec<Camera> {
    let boxes = renderer.fitted_boxes();
    let camera = |azimuth_deg: f64| {
        let viewpoint = Viewpoint {
            azimuth_deg,
            elevation_deg: ELEVATION_DEG,
            zoom: 1.0,
            up,
        };
        viewpoint.camera(&boxes, Lens::FovDeg(DEFAULT_FOV_DEG), [SIDE; 2])
    };
    azimuths_deg.iter().copied().filter_map(camera).collect()
}

/// Returns the settings of the pictures of files of splats.
pub(super) fn settings() -> Settings {
    Settings {
        tolerance: TOLERANCE,
        ..Settings::default()
    }
}

/// Draws a picture by each camera.
pub(super) fn drawn(
    renderer: &mut Renderer,
    cameras: &[Camera],
    settings: &Settings,
) -> Result<Vec<Image>> {
    let pictures = cameras
        .iter()
        .map(|camera| renderer.render(camera, settings).cloned());
    pictures.collect()
}

/// Returns the sRGB codes of a picture over black, opaque.
pub(super) fn codes(image: &Image) -> Image {
    let code = |c: f32| srgb_from_linear(c.clamp(0.0, 1.0));
    let codes = |[r, g, b, _]: &[f32; 4]| [code(*r), code(*g), code(*b), 1.0];
    Image {
        pixels: image.pixels.iter().map(codes).collect(),
        ..*image
    }
}

/// Returns the peak signal-to-noise ratio of pictures over black in sRGB codes, dB; `None` if they are equal.
pub(super) fn psnr(given: &[Image], found: &[Image]) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0);
    for (a, b) in given.iter().map(codes).zip(found.iter().map(codes)) {
        for (a, b) in a.pixels.iter().zip(&b.pixels) {
            for (a, b) in a[..3].iter().zip(b) {
                squares += f64::from(a - b).powi(2);
                count += 1;
            }
        }
    }
    (squares > 0.0).then(|| -10.0 * (squares / f64::from(count)).log10())
}

/// Returns the line that people read; `None` without a certificate.
pub(super) fn line(certificate: &Value) -> Option<String> {
    let rms = |key: &str| certificate[key]["rms"].as_f64();
    let [position, shape, opacity, colour, harmonics] =
        ["position", "shape", "opacity", "colour", "harmonics"].map(rms);
    let pictures = &certificate["pictures"];
    let pictures = match (&pictures["splats"], pictures["psnr"].as_f64()) {
        (Value::Null, _) => String::new(),
        (splats, Some(psnr)) => {
            format!("PSNR of pictures of {splats} splats {psnr:.1} dB (sRGB codes); ")
        }
        (splats, None) => format!("pictures of {splats} splats are equal; "),
    };
    Some(format!(
        "{pictures}rms differences: positions {:.1e}, shapes {:.2} %, opacities {:.4}, colours {:.2} of 255, other \
         coefficients {:.4}",
        position?,
        100.0 * shape?,
        opacity?,
        255.0 * colour?,
        harmonics?
    ))
}
