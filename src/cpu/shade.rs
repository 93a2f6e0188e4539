//! Stage: evaluates the colours of radiance fields, and converts colours to the space in which the
//! picture blends, once per visible particle.

use rayon::prelude::*;

use crate::blocks::BlockedVolume;
use crate::image::{linear_from_srgb, srgb_from_linear};
use crate::math::{harmonics, harmonics_count, harmonics_sum};
use crate::record::{BlockView, Carried, ClassifiedParticle};
use crate::scene::ColourIn;
use crate::view::{Camera, Projection};

/// Least number of particles per parallel task.
const GRAIN: usize = 1024;

/// Evaluates the colours of `classified` if they are harmonics of the direction from the eye to the
/// particle (for an orthographic camera: of its axis). Does nothing for other colours.
///
/// Sums are clamped at 0, not at 1, and converted to the space of blending.
///
/// - `is_encoded`: whether blending uses sRGB codes instead of linear light.
pub fn shade(
    volume: &BlockedVolume,
    views: &[BlockView],
    camera: &Camera,
    is_encoded: bool,
    classified: &mut [ClassifiedParticle],
) {
    let ColourIn::Harmonics {
        degree,
        coefficients,
        is_linear,
    } = &volume.colour
    else {
        return;
    };
    let stride = 3 * harmonics_count(*degree);
    let axis = match camera.projection {
        Projection::Perspective => None,
        Projection::Orthographic => Some(camera.camera_from_world.row(2).as_vec3()),
    };
    let into_space: fn(f32) -> f32 = match (*is_linear, is_encoded) {
        (false, true) | (true, false) => |sum| sum,
        (false, false) => linear_from_srgb,
        (true, true) => srgb_from_linear,
    };
    let shade_one = |particle: &mut ClassifiedParticle| {
        let index = views[particle.view as usize].block;
        let block = &volume.blocks[index as usize];
        let (i, offset) = volume.place(index, particle.local);
        let direction = axis.unwrap_or_else(|| {
            ((block.origin - camera.eye).as_vec3() + offset).normalize_or_zero()
        });
        let sums = harmonics_sum(&coefficients[i * stride..][..stride], &harmonics(direction));
        // `max` takes the other argument when one is NaN.
        particle.carried = Carried::of_colour(sums.map(|c| into_space(c.max(0.0))));
    };
    classified
        .par_iter_mut()
        .with_min_len(GRAIN)
        .for_each(shade_one);
}

/// Encodes the linear colours of `classified` as sRGB codes. Does nothing for colours that [`shade`]
/// evaluates.
pub fn encode(volume: &BlockedVolume, classified: &mut [ClassifiedParticle]) {
    if matches!(volume.colour, ColourIn::Harmonics { .. }) {
        return;
    }
    let encode_one = |particle: &mut ClassifiedParticle| {
        let colour = particle.carried.colour();
        particle.carried = Carried::of_colour(colour.map(srgb_from_linear));
    };
    classified
        .par_iter_mut()
        .with_min_len(GRAIN)
        .for_each(encode_one);
}
