//! Stage: colours that depend on the view, per visible particle, once.

use rayon::prelude::*;

use crate::blocks::BlockedVolume;
use crate::image::linear_from_srgb;
use crate::math::{harmonics, harmonics_count, harmonics_sum};
use crate::record::{BlockView, Carried, ClassifiedParticle};
use crate::scene::ColourIn;
use crate::view::{Camera, Projection};

/// Fills the colours of `classified` where they are harmonics of the direction from the eye to
/// the particle (an orthographic camera's: its axis); does nothing elsewhere.
///
/// Sums are clamped at 0, not at 1, and decoded from sRGB: compositing is linear.
pub fn shade(
    volume: &BlockedVolume,
    views: &[BlockView],
    camera: &Camera,
    classified: &mut [ClassifiedParticle],
) {
    /// Particles per parallel task at least.
    const GRAIN: usize = 1024;
    let ColourIn::Harmonics {
        degree,
        coefficients,
    } = &volume.colour
    else {
        return;
    };
    let stride = 3 * harmonics_count(*degree);
    let axis = match camera.projection {
        Projection::Perspective => None,
        Projection::Orthographic => Some(camera.camera_from_world.row(2).as_vec3()),
    };
    let shade_one = |particle: &mut ClassifiedParticle| {
        let index = views[particle.view as usize].block;
        let block = &volume.blocks[index as usize];
        let (i, offset) = volume.place(index, particle.local);
        let direction = axis.unwrap_or_else(|| {
            ((block.origin - camera.eye).as_vec3() + offset).normalize_or_zero()
        });
        let codes = harmonics_sum(&coefficients[i * stride..][..stride], &harmonics(direction));
        // `max` takes the other argument when one is NaN.
        particle.carried = Carried::of_colour(codes.map(|c| linear_from_srgb(c.max(0.0))));
    };
    classified
        .par_iter_mut()
        .with_min_len(GRAIN)
        .for_each(shade_one);
}
