//! Pictures: how sharp they are, sheets of faint kernels, several side by side; and where a plane
//! lies in them.

use ewa_splat::Image;
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};

/// How much a picture varies from pixel to pixel, as a share of what the truth does: below 1 it is
/// blurred, above 1 it has what is not there.
pub(crate) fn contrast(image: &Image, truth: &Image) -> f64 {
    let variation = |image: &Image| {
        let at = |x: usize, y: usize| f64::from(image.pixel(x, y)[1]);
        let mut sum = 0.0;
        for y in 1..image.height {
            for x in 1..image.width {
                // Where all three belong to what is shown.
                if [(x, y), (x - 1, y), (x, y - 1)].map(|(x, y)| image.pixel(x, y)[3] > 0.0)
                    == [true; 3]
                {
                    sum += (at(x, y) - at(x - 1, y)).powi(2) + (at(x, y) - at(x, y - 1)).powi(2);
                }
            }
        }
        sum
    };
    (variation(image) / variation(truth)).sqrt()
}

/// Where the ray through a point of the image meets the plane z = 0; `None` above the horizon.
pub(crate) fn hit(camera: &Camera, pixel: DVec2) -> Option<DVec2> {
    let slope = (pixel - camera.centre_px) / camera.focal_px;
    let ray = camera.camera_from_world.transpose() * slope.extend(1.0);
    (ray.z < 0.0).then(|| (camera.eye - ray * (camera.eye.z / ray.z)).truncate())
}

/// A camera above the plane z = 0 that looks straight down at a place of it, y up in the picture.
pub(crate) fn from_above(place: DVec2, height: f64, fov_deg: f64, size: [usize; 2]) -> Camera {
    let eye = place.extend(height);
    Camera::perspective(eye, place.extend(0.0), DVec3::Y, fov_deg, size)
}

/// The colours of a sheet so faint that nothing in it hides anything, divided by its opacity: what a
/// sheet buffer adds up. `coverage` of a pixel's number is its alpha.
pub(crate) fn as_sheet(faint: &Image, coverage: impl Fn(usize) -> f32) -> Image {
    let pixels = faint.pixels.iter().enumerate();
    let pixels = pixels.map(|(i, &[r, g, b, a])| {
        let alpha = coverage(i);
        let scale = if a > 0.0 { alpha / a } else { 0.0 };
        [r * scale, g * scale, b * scale, alpha]
    });
    Image {
        pixels: pixels.collect(),
        ..*faint
    }
}

/// Pictures in rows and columns, a white line between them; smaller ones in the upper left.
pub(crate) fn table_of(rows: &[Vec<&Image>]) -> Image {
    const GAP: usize = 4;
    let width = |row: &Vec<&Image>| row.iter().map(|i| i.width + GAP).sum::<usize>();
    let height = |row: &Vec<&Image>| row.iter().map(|i| i.height).max().unwrap_or(0) + GAP;
    let wide = rows.iter().map(width).max().unwrap_or(GAP) - GAP;
    let mut out = Image::new(wide, rows.iter().map(height).sum::<usize>() - GAP);
    out.pixels.fill([1.0; 4]);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for image in row {
            for y in 0..image.height {
                let to = (top + y) * wide + left;
                let from = &image.pixels[y * image.width..][..image.width];
                out.pixels[to..to + image.width].copy_from_slice(from);
            }
            left += image.width + GAP;
        }
        top += height(row);
    }
    out
}

/// Each pixel as four.
pub(crate) fn doubled(image: &Image) -> Image {
    let (width, height) = (2 * image.width, 2 * image.height);
    let pixels = (0..width * height).map(|i| image.pixel(i % width / 2, i / width / 2));
    Image {
        width,
        height,
        pixels: pixels.collect(),
    }
}

/// A part of a picture, or as much of it as there is.
pub(crate) fn part(image: &Image, [x, y]: [usize; 2], [width, height]: [usize; 2]) -> Image {
    let (x, y) = (x.min(image.width - 1), y.min(image.height - 1));
    let (width, height) = (width.min(image.width - x), height.min(image.height - y));
    let rows = (y..y + height).flat_map(|y| image.pixels[y * image.width + x..][..width].to_vec());
    Image {
        width,
        height,
        pixels: rows.collect(),
    }
}
