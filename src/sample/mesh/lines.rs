//! Makes kernels of a mesh's lines and points: a row of small round kernels per line, one kernel per point.
//!
//! Lines and points have no area, so no surfel represents them. Their kernels are splats of a radiance field,
//! whose opacity in the picture is the same from every side ([`Strength::PeakOpacity`]). Their size is a length
//! in the world, chosen for the pixels of the picture for which the mesh is sampled ([`Spread::NoDenser`]);
//! from nearby they look wider.

use glam::DVec3;

use super::Spread;
use crate::data::mesh::{AlphaMode, Mesh, MeshPart};
use crate::scene::{MAX_OPACITY, Particles, PointVolume, SplatRule, Strength};

/// Standard deviation of the kernels of a line, in pixels. With the pixel's own filter, a row of them is at
/// least half opaque over a width of 2.3 pixels.
const OF_LINE: f64 = 0.3;

/// Standard deviation of the kernel of a point, which is alone: 2.3 pixels, too.
const OF_POINT: f64 = 0.8;

/// Step between the kernels of a line over their standard deviation: midway between two of them the line is 94
/// % opaque, however near the eye is.
const STEP: f64 = 1.5;

/// Size of a pixel over the diagonal of the bounding box, if no picture is known.
const PIXEL: f64 = 1.0 / 1000.0;

/// Greatest number of kernels for all lines, not counting one at each end. Longer lines have larger steps.
const MOST: f64 = 4e6;

/// Returns the kernels of a mesh's lines and points, if it has any finite ones.
pub(super) fn kernels(mesh: &Mesh, spread: Spread) -> Option<PointVolume> {
    let positions = || mesh.parts.iter().flat_map(|part| &part.positions);
    let finite = || positions().filter(|p| p.is_finite()).copied();
    let diagonal = (finite().reduce(DVec3::max)? - finite().reduce(DVec3::min)?).length();
    let pixel = match spread {
        Spread::NoDenser(density) | Spread::Within { density, .. } => 1.0 / density.sqrt(),
        // A single point has no extent: any size will do.
        _ if diagonal > 0.0 => diagonal * PIXEL,
        _ => 1.0,
    };
    let length: f64 = mesh.parts.iter().map(length).sum();
    let step = (STEP * OF_LINE * pixel).max(length / MOST);
    let mut kernels = Kernels::default();
    for part in &mesh.parts {
        let Some(material) = mesh.materials.get(part.material) else {
            continue;
        };
        let [r, g, b, a] = material.base_colour;
        let colour_of = |[cr, cg, cb, ca]: [f64; 4]| {
            let of = |base: f32, c: f64, emitted: f32| f64::from(base) * c + f64::from(emitted);
            let [er, eg, eb] = material.emissive;
            let opacity = match material.alpha {
                AlphaMode::Blend => f64::from(a) * ca,
                AlphaMode::Opaque => 1.0,
                AlphaMode::Mask(least) => {
                    f64::from(u8::from(f64::from(a) * ca >= f64::from(least)))
                }
            };
            ([of(r, cr, er), of(g, cg, eg), of(b, cb, eb)], opacity)
        };
        for chain in chains(part) {
            let ends: Vec<End> = chain.iter().filter_map(|i| end(part, *i)).collect();
            if ends.len() == chain.len() {
                along(&ends, step, |at, colour| {
                    kernels.push(at, colour_of(colour), OF_LINE * pixel);
                });
            }
        }
        for (at, colour) in part.points.iter().filter_map(|i| end(part, *i)) {
            kernels.push(at, colour_of(colour), OF_POINT * pixel);
        }
    }
    kernels.volume()
}

/// Position and linear RGBA of a line's end or of a point.
type End = (DVec3, [f64; 4]);

fn end(part: &MeshPart, index: u32) -> Option<End> {
    let index = index as usize;
    let position = part.positions.get(index).filter(|p| p.is_finite())?;
    let colour = part
        .colours
        .get(index)
        .map_or([1.0; 4], |c| c.map(f64::from));
    Some((*position, colour))
}

/// Returns the length of all finite lines.
fn length(part: &MeshPart) -> f64 {
    let ends = part.lines.iter().map(|line| line.map(|i| end(part, i)));
    let lengths = ends.map(|ends| match ends {
        [Some((a, _)), Some((b, _))] => a.distance(b),
        _ => 0.0,
    });
    lengths.sum()
}

/// Joins lines that follow one another into chains of corners.
fn chains(part: &MeshPart) -> Vec<Vec<u32>> {
    let mut chains: Vec<Vec<u32>> = Vec::new();
    for &[a, b] in &part.lines {
        match chains.last_mut() {
            Some(chain) if chain.last() == Some(&a) => chain.push(b),
            _ => chains.push(vec![a, b]),
        }
    }
    chains
}

/// Calls `place` at even steps along a chain of lines, from its first end to its last. No step is longer than
/// `step`.
fn along(ends: &[End], step: f64, mut place: impl FnMut(DVec3, [f64; 4])) {
    let lengths = ends.windows(2).map(|pair| pair[0].0.distance(pair[1].0));
    let whole: f64 = lengths.sum();
    let step = whole / (whole / step).ceil().max(1.0);
    // Distance left to the next place.
    let mut left = 0.0;
    for pair in ends.windows(2) {
        let [(a, from), (b, to)] = [pair[0], pair[1]];
        let length = a.distance(b);
        while left < length {
            let share = left / length;
            let colour = std::array::from_fn(|c| from[c] + share * (to[c] - from[c]));
            place(a.lerp(b, share), colour);
            left += step;
        }
        left -= length;
    }
    if let Some(&(last, colour)) = ends.last()
        && left < 0.5 * step
    {
        place(last, colour);
    }
}

/// Arrays of kernels.
#[derive(Default)]
struct Kernels {
    positions: Vec<DVec3>,
    sigmas: Vec<f32>,
    opacities: Vec<f32>,
    colours: Vec<[f32; 3]>,
}

impl Kernels {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "what is beyond single precision is left out"
    )]
    fn push(&mut self, at: DVec3, (colour, opacity): ([f64; 3], f64), sigma: f64) {
        let (sigma, colour) = (sigma as f32, colour.map(|c| c as f32));
        let is_sound = sigma >= f32::MIN_POSITIVE && sigma.is_finite();
        if is_sound && opacity > 0.0 && colour.iter().all(|c| c.is_finite()) {
            self.positions.push(at);
            self.sigmas.push(sigma);
            self.opacities.push(opacity.min(MAX_OPACITY) as f32);
            self.colours.push(colour);
        }
    }

    fn volume(self) -> Option<PointVolume> {
        if self.positions.is_empty() {
            return None;
        }
        Some(
            PointVolume::new(
                Particles::Isotropic {
                    positions: self.positions,
                    sigmas: self.sigmas,
                },
                Strength::PeakOpacity {
                    opacities: self.opacities,
                    rule: SplatRule::Exact,
                    by_distance: true,
                },
            )
            .with_colours(self.colours),
        )
    }
}
