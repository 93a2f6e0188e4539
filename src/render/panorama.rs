//! Draws panoramas: faces of a cube around the eye are drawn as pictures in perspective, and the rays of the panorama's pixels look
//! up their samples there.
//!
//! Each kernel is thus drawn by the exact footprints of perspective, on either back end. A face has two pixels for each pixel of
//! the panorama, which is the mean of four samples.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::renderer::Renderer;
use crate::error::{Error, Result};
use crate::frame::backend::FrameReport;
use crate::frame::check::check_size;
use crate::frame::settings::{ColumnSettings, Settings, Show};
use crate::image::{ColumnImage, DepthImage, Image, NormalImage};
use crate::math::narrowed;
use crate::scene::LightFrame;
use crate::stats::Stopwatch;
use crate::view::{Camera, Face, Mapping, Panorama, Projection};

/// Samples along each side of a pixel, and pixels of a face along a pixel of the panorama.
const SAMPLES: usize = 2;

/// Pixels by which a part of a face is larger than the places that are looked up: cubic interpolation reads two beyond them.
const MARGIN: f64 = 3.0;

/// Greatest width and height of a part of a face in pixels.
const MOST_SIDE: f64 = 4096.0;

/// Least cosine of the angle between opposite samples of a small pixel: .05 radians.
const FINE: f64 = 0.998_75;

/// Greatest number of pixels of all faces for each pixel of the panorama. Square pixels have about five.
const MOST_RATIO: f64 = 64.0;

/// Pixels that the faces of any panorama may have.
const LEAST_PIXELS: f64 = 1e6;

/// Part of a face that a panorama's samples lie in.
#[derive(Debug)]
struct Part {
    face: Face,
    /// Slopes at its first and past its last sample, right and down.
    slopes: [DVec2; 2],
    camera: Camera,
}

impl Part {
    /// Returns the coordinate, in pixels, at which a direction meets the part; `None` beside it.
    fn place(&self, direction: DVec3) -> Option<DVec2> {
        if Face::of(direction) != self.face {
            return None;
        }
        let slope = self.face.slope(direction);
        let [low, high] = self.slopes;
        let is_inside = slope.cmpge(low).all() && slope.cmplt(high).all();
        is_inside.then(|| slope * self.camera.focal_px + self.camera.centre_px)
    }
}

impl Renderer {
    /// Draws a panorama. [`Renderer::image`] and the other getters return its results until the next frame; depths are distances
    /// from the eye, and counts are sums over the faces.
    ///
    /// A pixel is that of a perspective camera along the same ray to 2e-4 if deviations of kernels are 10 pixels or more. Sheets and slabs lie across
    /// the faces, so seams between faces show what these composites err by.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`] and of [`Panorama::validate`]; a backdrop, counts, ranks.
    pub fn render_panorama(&mut self, panorama: &Panorama, settings: &Settings) -> Result<&Image> {
        let mut whole = Stopwatch::start();
        self.check_panorama(panorama)?;
        let refuse = |expected: &str, found: &str| {
            let advice = "leave it out";
            Err(Error::invalid(
                "settings", "panorama", expected, found, advice,
            ))
        };
        if settings.backdrop.is_some() {
            return refuse("nothing in the picture yet", "a backdrop");
        }
        settings.refuse_aperture("panorama")?;
        if settings.show == Show::Count {
            return refuse("the scene", "counts");
        }
        let (width, height) = (panorama.width, panorama.height);
        let mut sums = vec![[0.0_f32; 5]; width * height];
        let mut depths = settings.depth.then(|| vec![f32::INFINITY; width * height]);
        let mut normals = settings.normals.then(|| vec![[0.0_f32; 3]; width * height]);
        let mut report = FrameReport::default();
        let of_faces = of_faces(panorama, settings);
        for part in parts(panorama)? {
            self.render(&part.camera, &of_faces)?;
            report.add_part(&self.report);
            let image = &self.images.image;
            let pixel = |x: usize, y: usize| image.pixels[y * image.width + x];
            add(panorama, &part, &mut sums, |place| {
                let [r, g, b, a] = cubic(place, pixel);
                [r, g, b, a, 1.0]
            });
            if let (Some(into), Some(depth)) = (&mut depths, &self.images.depth) {
                look_up(panorama, &part, into, |at, stretch| {
                    depth.depths[at] * stretch
                });
            }
            if let (Some(into), Some(of)) = (&mut normals, &self.images.normals) {
                look_up(panorama, &part, into, |at, _| of.normals[at]);
            }
        }
        let background = settings.shown_background();
        let behind = background.map_or([0.0; 4], |[r, g, b]| [r, g, b, 1.0]);
        let of_sums = |&[r, g, b, a, share]: &[f32; 5]| {
            let rest = 1.0 - share;
            let mut pixel = [r, g, b, a];
            for (channel, behind) in pixel.iter_mut().zip(behind) {
                *channel = (*channel + rest * behind).max(0.0);
            }
            pixel[3] = pixel[3].min(1.0);
            pixel
        };
        let pixels = sums.par_iter().map(of_sums).collect();
        self.images.image = Image {
            width,
            height,
            pixels,
        };
        self.images.depth = depths.map(|depths| DepthImage {
            width,
            height,
            depths,
        });
        self.images.normals = normals.map(|normals| NormalImage {
            width,
            height,
            normals,
        });
        report.times.frame = whole.lap();
        self.report = report;
        Ok(&self.images.image)
    }

    /// Draws the column density along the rays of a panorama: [`Renderer::column_density`] of cameras around the eye. In
    /// an all-sky map, the sum of the pixels times their solid angle is that of each mass divided by the square of its distance. Beside
    /// kernels narrower than a pixel, interpolation goes below zero.
    ///
    /// # Errors
    /// The errors of [`Renderer::column_density`] and of [`Panorama::validate`]; a slice, ranks.
    pub fn column_panorama(
        &mut self,
        panorama: &Panorama,
        settings: &ColumnSettings,
    ) -> Result<&ColumnImage> {
        let mut whole = Stopwatch::start();
        self.check_panorama(panorama)?;
        let (width, height) = (panorama.width, panorama.height);
        let mut sums = vec![[0.0_f32; 1]; width * height];
        let mut report = FrameReport::default();
        for part in parts(panorama)? {
            self.column_density(&part.camera, settings)?;
            report.add_part(&self.report);
            let column = &self.images.column;
            let pixel = |x: usize, y: usize| [column.values[y * column.width + x]];
            add(panorama, &part, &mut sums, |place| cubic(place, pixel));
        }
        self.images.column = ColumnImage {
            width,
            height,
            values: sums.into_iter().map(|[value]| value).collect(),
            pixel_area: None,
        };
        report.times.frame = whole.lap();
        self.report = report;
        Ok(&self.images.column)
    }

    fn check_panorama(&self, panorama: &Panorama) -> Result<()> {
        panorama.validate()?;
        // Maps of the sphere are one long row.
        if panorama.mapping != Mapping::Healpix {
            check_size([panorama.width, panorama.height])?;
        }
        if self.rank().is_some() {
            return Err(Error::invalid(
                "panorama",
                "processes",
                "one",
                "several",
                "draw it without ranks",
            ));
        }
        Ok(())
    }
}

/// Returns the settings of all faces. Lights that are fixed to the panorama's camera stay where they are in the world.
fn of_faces(panorama: &Panorama, settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    let world_from_camera = panorama.camera_from_world.transpose();
    let lights = settings.lighting.iter_mut().flat_map(|l| &mut l.lights);
    for light in lights.filter(|light| light.frame == LightFrame::Camera) {
        light.direction = world_from_camera * light.direction;
        light.frame = LightFrame::World;
    }
    settings
}

/// Calls `each` with the direction of every sample of a pixel that has one.
fn each_sample(panorama: &Panorama, pixel: usize, mut each: impl FnMut(DVec3)) {
    let pixel = [pixel % panorama.width, pixel / panorama.width];
    for sample in 0..SAMPLES * SAMPLES {
        let at = DVec2::new((sample % SAMPLES) as f64, (sample / SAMPLES) as f64);
        if let Some(direction) = panorama.direction(pixel, (at + 0.5) / SAMPLES as f64) {
            each(direction);
        }
    }
}

/// Returns the parts of faces that a panorama's samples lie in.
///
/// # Errors
/// Pixels that are so much wider than high, or higher than wide, that faces would have far more.
fn parts(panorama: &Panorama) -> Result<Vec<Part>> {
    type Bounds = [[DVec2; 2]; 6];
    let nothing: Bounds = [[DVec2::INFINITY, DVec2::NEG_INFINITY]; 6];
    let join = |a: Bounds, b: Bounds| {
        std::array::from_fn(|i| [a[i][0].min(b[i][0]), a[i][1].max(b[i][1])])
    };
    let add = |mut bounds: Bounds, pixel: usize| {
        let mut include = |direction: DVec3| {
            let face = Face::of(direction);
            let slope = face.slope(direction);
            let own = &mut bounds[face as usize];
            *own = [own[0].min(slope), own[1].max(slope)];
        };
        each_sample(panorama, pixel, &mut include);
        // Depths and normals are looked up there.
        middle(panorama, pixel).map(include);
        bounds
    };
    let count = panorama.width * panorama.height;
    let bounds = (0..count)
        .into_par_iter()
        .fold(|| nothing, add)
        .reduce(|| nothing, join);
    let focal = SAMPLES as f64 / panorama.spacing();
    let is_met = |(_, bounds): &(Face, [DVec2; 2])| bounds[0].x <= bounds[1].x;
    let of_face = |(face, [low, high]): (Face, [DVec2; 2])| {
        let size = high - low;
        let [columns, rows] =
            [size.x, size.y].map(|n| whole((n * focal / MOST_SIDE).ceil()).max(1));
        let counts = DVec2::new(columns as f64, rows as f64);
        let part = move |number: usize| {
            let [x, y] = [number % columns, number / columns];
            let at = DVec2::new(x as f64, y as f64);
            let [first, mut last] = [at, at + 1.0].map(|at| low + size * (at / counts));
            let pixels = (last - first) * focal + 2.0 * MARGIN;
            // The last sample belongs to the last part.
            if x + 1 == columns {
                last.x = f64::INFINITY;
            }
            if y + 1 == rows {
                last.y = f64::INFINITY;
            }
            Part {
                face,
                slopes: [first, last],
                camera: camera(panorama, face, focal, first, pixels),
            }
        };
        (0..columns * rows).map(part)
    };
    let met = Face::ALL.into_iter().zip(bounds).filter(is_met);
    let pixels = |(_, [low, high]): (Face, [DVec2; 2])| ((high - low) * focal).element_product();
    if met.clone().map(pixels).sum::<f64>() > MOST_RATIO * count as f64 + LEAST_PIXELS {
        return Err(Error::invalid(
            "panorama",
            "size",
            "pixels that are nearly as wide as high",
            format!("{} x {}", panorama.width, panorama.height),
            "change it",
        ));
    }
    Ok(met.flat_map(of_face).collect())
}

/// Returns the camera of a part of a face.
///
/// - `focal`: pixels per unit of slope.
/// - `first`: slopes of its first sample.
/// - `size`: pixels.
fn camera(panorama: &Panorama, face: Face, focal: f64, first: DVec2, size: DVec2) -> Camera {
    let world_from_camera = panorama.camera_from_world.transpose();
    let axes = face.axes().map(|axis| world_from_camera * axis);
    Camera {
        projection: Projection::Perspective,
        eye: panorama.eye,
        camera_from_world: DMat3::from_cols(axes[0], axes[1], axes[2]).transpose(),
        focal_px: DVec2::splat(focal),
        centre_px: MARGIN - first * focal,
        width: whole(size.x.ceil()) + 1,
        height: whole(size.y.ceil()) + 1,
    }
}

/// Adds the samples of a part to the pixels, each by its share of its pixel.
///
/// - `sample`: value at a coordinate of the part's picture, pixels.
fn add<const N: usize>(
    panorama: &Panorama,
    part: &Part,
    sums: &mut [[f32; N]],
    sample: impl Fn(DVec2) -> [f32; N] + Sync,
) {
    const SHARE: f32 = 1.0 / (SAMPLES * SAMPLES) as f32;
    sums.par_iter_mut().enumerate().for_each(|(pixel, sum)| {
        if is_beside(panorama, part, pixel) {
            return;
        }
        each_sample(panorama, pixel, |direction| {
            if let Some(place) = part.place(direction) {
                for (sum, value) in sum.iter_mut().zip(sample(place)) {
                    *sum += SHARE * value;
                }
            }
        });
    });
}

/// Returns the direction of a pixel's middle.
fn middle(panorama: &Panorama, pixel: usize) -> Option<DVec3> {
    let pixel = [pixel % panorama.width, pixel / panorama.width];
    panorama.direction(pixel, DVec2::splat(0.5))
}

/// Returns true if a pixel is so small and so far from a part's face that none of its samples meets it.
fn is_beside(panorama: &Panorama, part: &Part, pixel: usize) -> bool {
    /// Least cosine to the axis of a face, less what small pixels reach beyond a corner.
    const LEAST: f64 = 0.57 - 0.1;
    let pixel = [pixel % panorama.width, pixel / panorama.width];
    // Two opposite samples: corners may meet on the other side of the sphere.
    let sample = |at| panorama.direction(pixel, DVec2::splat(at));
    let half = 0.5 / SAMPLES as f64;
    let (Some(first), Some(last)) = (sample(half), sample(1.0 - half)) else {
        return false;
    };
    let is_far = |sample: DVec3| sample.dot(part.face.axes()[2]) < LEAST;
    first.dot(last) > FINE && is_far(first) && is_far(last)
}

/// Stores the values of a part's nearest pixels at the middles of the panorama's.
///
/// - `value`: value of a pixel of the part, given its index and the length of its ray to depth 1.
fn look_up<T: Send>(
    panorama: &Panorama,
    part: &Part,
    into: &mut [T],
    value: impl Fn(usize, f32) -> T + Sync,
) {
    into.par_iter_mut().enumerate().for_each(|(pixel, into)| {
        let Some(direction) = middle(panorama, pixel) else {
            return;
        };
        if let Some(place) = part.place(direction) {
            let [x, y] = [place.x, place.y].map(|at| whole(at.floor()));
            let stretch = part.face.slope(direction).extend(1.0).length();
            *into = value(y * part.camera.width + x, narrowed(stretch));
        }
    });
}

/// Returns a whole number from 0 up as an index or a count.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "coordinates within pictures, and their sizes"
)]
fn whole(at: f64) -> usize {
    at as usize
}

/// Interpolates pixels by the cubic of Catmull and Rom, which is exact for parabolas.
///
/// - `place`: coordinate in pixels, at least two from the picture's edges.
#[inline]
fn cubic<const N: usize>(place: DVec2, pixel: impl Fn(usize, usize) -> [f32; N]) -> [f32; N] {
    let from_middle = place - 0.5;
    let first = from_middle.floor();
    let weights = [0, 1].map(|i| {
        let t = narrowed(from_middle[i] - first[i]);
        [
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        ]
    });
    let [x, y] = [first.x, first.y].map(whole);
    let mut sum = [0.0; N];
    for (j, down) in weights[1].into_iter().enumerate() {
        for (i, across) in weights[0].into_iter().enumerate() {
            let value = pixel(x + i - 1, y + j - 1);
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += down * across * value;
            }
        }
    }
    sum
}
