//! Measures sharpness, converts sheets of faint kernels, puts images side by side, and intersects rays with a plane.

use ewa_splat::Image;
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};

/// Returns the variation of an image between neighbouring pixels, relative to the reference image's. Below 1 the image
/// is blurred; above 1 it has spurious detail.
pub(crate) fn contrast(image: &Image, truth: &Image) -> f64 {
    let variation = |image: &Image| {
        let at = |x: usize, y: usize| f64::from(image.pixel(x, y)[1]);
        let mut sum = 0.0;
        for y in 1..image.height {
            for x in 1..image.width {
                // Only where the object covers all three pixels.
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

/// Returns the point at which the ray through a point of the image meets the plane z = 0; `None` above the horizon.
pub(crate) fn hit(camera: &Camera, pixel: DVec2) -> Option<DVec2> {
    let slope = (pixel - camera.centre_px) / camera.focal_px;
    let ray = camera.camera_from_world.transpose() * slope.extend(1.0);
    (ray.z < 0.0).then(|| (camera.eye - ray * (camera.eye.z / ray.z)).truncate())
}

/// Returns a camera above the plane z = 0 that looks straight down at one of its points, y up in the image.
pub(crate) fn from_above(place: DVec2, height: f64, fov_deg: f64, size: [usize; 2]) -> Camera {
    let eye = place.extend(height);
    Camera::perspective(eye, place.extend(0.0), DVec3::Y, fov_deg, size)
}

/// Divides the colours of a sheet by its opacity, which gives the contents of a sheet buffer. The sheet must be so
/// faint that nothing in it hides anything. `coverage` returns the alpha of a pixel's number.
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

/// Puts images into rows and columns with a white line between them; smaller ones are at the upper left.
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

/// Doubles an image: each pixel becomes four.
pub(crate) fn doubled(image: &Image) -> Image {
    let (width, height) = (2 * image.width, 2 * image.height);
    let pixels = (0..width * height).map(|i| image.pixel(i % width / 2, i / width / 2));
    Image {
        width,
        height,
        pixels: pixels.collect(),
    }
}

/// Returns a part of an image, or as much of it as there is.
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
