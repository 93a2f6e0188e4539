//! Makes pictures that the tests of figures share.

use crate::image::{Image, linear_from_srgb};

pub(super) fn constant(width: usize, height: usize, [r, g, b]: [f32; 3]) -> Image {
    let mut image = Image::new(width, height);
    image.pixels.fill([r, g, b, 1.0]);
    image
}

/// Makes an opaque image of sRGB bytes.
pub(super) fn codes(width: u32, height: u32, code: &dyn Fn(u32, u32) -> [u8; 3]) -> Image {
    let mut image = Image::new(width as usize, height as usize);
    for (pixel, i) in image.pixels.iter_mut().zip(0..) {
        let [r, g, b] = code(i % width, i / width).map(|c| linear_from_srgb(f32::from(c) / 255.0));
        *pixel = [r, g, b, 1.0];
    }
    image
}

/// Returns pseudo-random bytes from 28 to 228.
pub(super) fn noise_code(seed: u32, x: u32, y: u32) -> [u8; 3] {
    std::array::from_fn(|c| {
        let channel = seed * 3 + u32::try_from(c).unwrap();
        u8::try_from(28 + hash(x, y, channel) % 201).unwrap()
    })
}

pub(super) fn noise(width: u32, height: u32, seed: u32) -> Image {
    codes(width, height, &|x, y| noise_code(seed, x, y))
}

/// Returns the image with grey noise of an amplitude added: the same noise for every amplitude.
pub(super) fn noisy(image: &Image, amplitude: f32) -> Image {
    let mut noisy = image.clone();
    for (pixel, i) in noisy.pixels.iter_mut().zip(0..) {
        let unit = (hash(i, 7, 11) % 2001) as f32 / 1000.0 - 1.0;
        for c in &mut pixel[..3] {
            *c += amplitude * unit;
        }
    }
    noisy
}

fn hash(x: u32, y: u32, seed: u32) -> u32 {
    let mut h =
        x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}
