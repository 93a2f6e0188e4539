//! Defines deep images: colours and opacities along the ray of each pixel, in samples of depth.

use super::{DepthImage, Image};

/// A part of a pixel's ray: what it adds in front of what lies behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeepSample {
    /// Camera-space z at which it begins, world units.
    pub front: f32,
    /// Camera-space z at which it ends: that of the front for a surface.
    pub back: f32,
    /// Linear colour, premultiplied by the sample's own opacity, and that opacity.
    pub rgba: [f32; 4],
}

/// An image whose pixels state colours and opacities along their rays, rows from the top.
///
/// Within a sample the optical depth is spread evenly, and the colour with the opacity, as OpenEXR defines for volumes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DeepImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Index of each pixel's first sample, row by row, and the number of all samples.
    pub firsts: Vec<usize>,
    /// The samples of each pixel, front to back; they do not overlap.
    pub samples: Vec<DeepSample>,
}

/// Depths that a deep image states for each pixel. They are infinite where the pixel is transparent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthOf {
    /// Place where half of the light from behind is lost: infinite where less is.
    Half,
    /// Place of the first 256th of the pixel's opacity.
    Entry,
    /// Place where all but a 256th of the pixel's opacity is reached.
    Exit,
    /// Place where half of the pixel's own opacity is reached.
    Median,
    /// Mean of the depths, weighted by what each adds to the opacity.
    Mean,
}

/// Share of a pixel's opacity before [`DepthOf::Entry`] and behind [`DepthOf::Exit`].
const RIM: f32 = 1.0 / 256.0;

impl DeepSample {
    /// Returns the part of the sample in front of a depth.
    #[must_use]
    pub fn before(&self, depth: f32) -> [f32; 4] {
        if depth > self.back {
            return self.rgba;
        }
        // What a surface shows, it shows behind its own depth.
        if depth <= self.front {
            return [0.0; 4];
        }
        let share = (depth - self.front) / (self.back - self.front);
        let alpha = self.rgba[3];
        let part = part_of(alpha, share);
        let of_whole = if alpha == 0.0 { share } else { part / alpha };
        let [r, g, b, _] = self.rgba.map(|c| c * of_whole);
        [r, g, b, part]
    }

    /// Returns the depth at which a part of the sample's opacity is reached.
    fn depth_of(&self, opacity: f32) -> f32 {
        let alpha = self.rgba[3];
        let share = match alpha < 1.0 {
            true => (-opacity).ln_1p() / (-alpha).ln_1p(),
            // All of it is behind the front.
            false => 0.0,
        };
        let share = if share.is_nan() {
            0.0
        } else {
            share.clamp(0.0, 1.0)
        };
        self.front + share * (self.back - self.front)
    }
}

/// Returns the opacity of a share of a sample's optical depth.
fn part_of(alpha: f32, share: f32) -> f32 {
    match alpha < 1.0 {
        true => -(share * (-alpha).ln_1p()).exp_m1(),
        false => alpha,
    }
}

impl DeepImage {
    /// Returns the samples of a pixel, front to back.
    ///
    /// # Panics
    /// Panics if the pixel lies outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> &[DeepSample] {
        let i = y * self.width + x;
        &self.samples[self.firsts[i]..self.firsts[i + 1]]
    }

    /// Returns the image of all samples.
    pub fn flat(&self) -> Image {
        self.image(|_| f32::INFINITY)
    }

    /// Returns the image in front of depths, premultiplied and linear.
    ///
    /// # Errors
    /// `None` for depths of another size.
    pub fn before(&self, depth: &DepthImage) -> Option<Image> {
        let is_same = [depth.width, depth.height] == [self.width, self.height];
        (is_same && depth.depths.len() == self.width * self.height)
            .then(|| self.image(|i| depth.depths[i]))
    }

    fn image(&self, end: impl Fn(usize) -> f32) -> Image {
        let pixel = |i: usize| {
            let mut sum = [0.0_f32; 4];
            for sample in &self.samples[self.firsts[i]..self.firsts[i + 1]] {
                let through = 1.0 - sum[3];
                for (sum, part) in sum.iter_mut().zip(sample.before(end(i))) {
                    *sum += through * part;
                }
            }
            sum
        };
        Image {
            width: self.width,
            height: self.height,
            pixels: (0..self.width * self.height).map(pixel).collect(),
        }
    }

    /// Returns the share of the light from behind that reaches the eye from a depth, row by row.
    pub fn transmittance(&self, depth: f32) -> Vec<f32> {
        let image = self.image(|_| depth);
        image.pixels.iter().map(|pixel| 1.0 - pixel[3]).collect()
    }

    /// Returns a depth of each pixel.
    pub fn depth(&self, of: DepthOf) -> DepthImage {
        let at = |i: usize| {
            let samples = &self.samples[self.firsts[i]..self.firsts[i + 1]];
            let add = |alpha: f32, sample: &DeepSample| alpha + (1.0 - alpha) * sample.rgba[3];
            let whole = samples.iter().fold(0.0, add);
            if whole <= 0.0 {
                return f32::INFINITY;
            }
            let wanted = match of {
                DepthOf::Half => 0.5,
                DepthOf::Entry => RIM * whole,
                DepthOf::Exit => (1.0 - RIM) * whole,
                DepthOf::Median => 0.5 * whole,
                DepthOf::Mean => return mean(samples, whole),
            };
            let mut before = 0.0;
            for sample in samples {
                let after = add(before, sample);
                if after >= wanted {
                    return sample.depth_of((wanted - before) / (1.0 - before));
                }
                before = after;
            }
            f32::INFINITY
        };
        DepthImage {
            width: self.width,
            height: self.height,
            depths: (0..self.width * self.height).map(at).collect(),
        }
    }
}

/// Returns the mean depth of samples, weighted by what each adds to the opacity.
fn mean(samples: &[DeepSample], whole: f32) -> f32 {
    let (mut before, mut sum) = (0.0_f64, 0.0_f64);
    for sample in samples {
        let alpha = f64::from(sample.rgba[3]);
        // The mean of a depth under an exponential: 1/tau - (1 - alpha)/alpha of the way.
        let tau = -(-alpha).ln_1p();
        let share = match alpha {
            _ if alpha >= 1.0 => 0.0,
            _ if tau < 1e-3 => 0.5 - tau / 12.0,
            _ => 1.0 / tau - (1.0 - alpha) / alpha,
        };
        let [front, back] = [sample.front, sample.back].map(f64::from);
        let added = (1.0 - before) * alpha;
        sum += added * (front + share * (back - front));
        before += added;
    }
    crate::math::narrowed(sum / f64::from(whole))
}
