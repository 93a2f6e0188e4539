//! Reference images of meshes: rays that meet the triangles themselves.

use std::fmt;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::sight::Sight;
use super::traversal::Traversal;
use crate::data::mesh::{AlphaMode, Material, Mesh, MeshPart, Texture, TextureUse, Wrap};
use crate::image::{Image, linear_from_srgb, srgb_from_linear};
use crate::view::Camera;

/// A mesh whose reference image can be computed: its triangles in the colours of their materials, without light. Lines and points
/// are not shown.
///
/// Textures are interpolated bilinearly in linear light. Rays sample a pixel's filter, so they need no pyramids.
pub struct MeshTracer<'a> {
    mesh: &'a Mesh,
    /// Part and index of each triangle.
    triangles: Vec<[usize; 2]>,
    traversal: Traversal,
    /// Middle of the mesh, for coordinates far from the origin.
    origin: DVec3,
    /// Linear light of each sRGB code.
    linear: Vec<f64>,
}

impl fmt::Debug for MeshTracer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.triangles.len();
        f.debug_struct("MeshTracer")
            .field("triangles", &count)
            .finish_non_exhaustive()
    }
}

/// Settings of a mesh's reference image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshTracerSettings {
    /// Variance of the pixel's filter, a round Gaussian, squared pixels.
    pub variance_px2: f64,
    /// Rays of each pixel, at least 1. The error of a pixel on an outline is some 1 / rays.
    pub rays: usize,
    /// Whether pixels are means of sRGB codes, as viewers of splats blend colours, and converted to linear light then.
    pub blends_codes: bool,
}

impl Default for MeshTracerSettings {
    /// Returns this program's filter, with 64 rays.
    fn default() -> Self {
        Self {
            variance_px2: 1.0,
            rays: 64,
            blends_codes: false,
        }
    }
}

/// Intersection of a ray with a triangle.
struct Hit {
    distance: f64,
    triangle: usize,
    /// Barycentric coordinates along the two edges from the first corner.
    along: [f64; 2],
    is_front: bool,
}

impl<'a> MeshTracer<'a> {
    /// Prepares a mesh. Triangles without a material, or whose corners are missing or not finite, are left out.
    pub fn new(mesh: &'a Mesh) -> Self {
        let of_part = |(p, part): (usize, &'a MeshPart)| {
            let is_known = part.material < mesh.materials.len();
            let sound = move |t: &usize| {
                let corner = |c: u32| part.positions.get(c as usize);
                let is_sound = |c| corner(c).is_some_and(|x: &DVec3| x.is_finite());
                is_known && part.triangles[*t].into_iter().all(is_sound)
            };
            (0..part.triangles.len()).filter(sound).map(move |t| [p, t])
        };
        let triangles: Vec<[usize; 2]> = mesh.parts.iter().enumerate().flat_map(of_part).collect();
        let all = || {
            triangles
                .iter()
                .flat_map(|&[p, t]| corners(&mesh.parts[p], t))
        };
        let low = all().fold(DVec3::INFINITY, DVec3::min);
        let high = all().fold(DVec3::NEG_INFINITY, DVec3::max);
        let origin = if triangles.is_empty() {
            DVec3::ZERO
        } else {
            0.5 * low + 0.5 * high
        };
        let traversal = Traversal::new(triangles.len(), |i| {
            let [p, t] = triangles[i];
            let corners = corners(&mesh.parts[p], t).map(|x| x - origin);
            let low = corners.into_iter().fold(DVec3::INFINITY, DVec3::min);
            let high = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
            (0.5 * (low + high), 0.5 * (high - low))
        });
        let linear = (0..=255_u8).map(|c| linear_from_srgb(f32::from(c) / 255.0).into());
        Self {
            mesh,
            triangles,
            traversal,
            origin,
            linear: linear.collect(),
        }
    }

    /// Renders the picture: linear, premultiplied.
    pub fn render(&self, camera: &Camera, settings: &MeshTracerSettings) -> Image {
        let mut image = Image::new(camera.width, camera.height);
        let offsets = gaussian_offsets(settings.rays.max(1), settings.variance_px2);
        let sight = Sight::new(camera, &[]);
        let rows = image.pixels.par_chunks_mut(camera.width.max(1)).enumerate();
        rows.for_each(|(row, pixels)| {
            let mut hits = Vec::new();
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let centre = DVec2::new(column as f64, row as f64) + 0.5;
                let mut sum = [0.0; 4];
                for offset in &offsets {
                    let sample = self.sample(&sight, centre + *offset, settings, &mut hits);
                    for (sum, s) in sum.iter_mut().zip(sample) {
                        *sum += s;
                    }
                }
                let mut mean = sum.map(|s| (s / offsets.len() as f64) as f32);
                if settings.blends_codes {
                    for c in &mut mean[..3] {
                        *c = linear_from_srgb(*c);
                    }
                }
                *pixel = mean;
            }
        });
        image
    }

    /// Returns the distances along the rays through pixels' centres to what they show first; infinite where they show nothing.
    pub fn distances(&self, camera: &Camera) -> Vec<f64> {
        let sight = Sight::new(camera, &[]);
        let mut found = vec![f64::INFINITY; camera.width * camera.height];
        let rows = found.par_chunks_mut(camera.width.max(1)).enumerate();
        rows.for_each(|(row, pixels)| {
            let mut hits = Vec::new();
            for (column, pixel) in pixels.iter_mut().enumerate() {
                self.meet(
                    &sight,
                    DVec2::new(column as f64, row as f64) + 0.5,
                    &mut hits,
                );
                let shown = hits.iter().find(|hit| self.shade(hit).is_some());
                *pixel = shown.map_or(f64::INFINITY, |hit| hit.distance);
            }
        });
        found
    }

    /// Finds the triangles that the ray through a place of the image meets, in order.
    fn meet(&self, sight: &Sight<'_>, px: DVec2, hits: &mut Vec<Hit>) {
        let camera = sight.camera;
        let world_from_camera = camera.camera_from_world.transpose();
        let (from, along) = sight.ray(px);
        let from = camera.eye - self.origin + world_from_camera * from;
        let along = world_from_camera * along;
        hits.clear();
        self.traversal.each(from, along, |triangle| {
            hits.extend(self.intersect(triangle, from, along));
        });
        hits.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance));
    }

    /// Returns the premultiplied colour, in light or codes, and the opacity that a ray meets.
    fn sample(
        &self,
        sight: &Sight<'_>,
        px: DVec2,
        settings: &MeshTracerSettings,
        hits: &mut Vec<Hit>,
    ) -> [f64; 4] {
        self.meet(sight, px, hits);
        let mut shown = [0.0; 4];
        for hit in &*hits {
            let Some([r, g, b, alpha]) = self.shade(hit) else {
                continue;
            };
            let colour = match settings.blends_codes {
                true => [r, g, b].map(|c| f64::from(srgb_from_linear(c.clamp(0.0, 1.0) as f32))),
                false => [r, g, b],
            };
            let seen = (1.0 - shown[3]) * alpha;
            let [r, g, b] = colour;
            for (shown, c) in shown.iter_mut().zip([r, g, b, 1.0]) {
                *shown += seen * c;
            }
            if shown[3] >= 1.0 {
                break;
            }
        }
        shown
    }

    /// Intersects a ray with a triangle (Möller and Trumbore 1997).
    fn intersect(&self, triangle: usize, from: DVec3, along: DVec3) -> Option<Hit> {
        let [p, t] = self.triangles[triangle];
        let corners = corners(&self.mesh.parts[p], t).map(|x| x - self.origin);
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let across = along.cross(e2);
        let determinant = e1.dot(across);
        let offset = from - corners[0];
        let turned = offset.cross(e1);
        // A determinant of zero gives numbers that meet no condition.
        let b1 = offset.dot(across) / determinant;
        let b2 = along.dot(turned) / determinant;
        let distance = e2.dot(turned) / determinant;
        let is_met = b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 && distance > 0.0;
        is_met.then_some(Hit {
            distance,
            triangle,
            along: [b1, b2],
            is_front: determinant > 0.0,
        })
    }

    /// Returns linear RGB and opacity; `None` where nothing is seen.
    fn shade(&self, hit: &Hit) -> Option<[f64; 4]> {
        let [p, t] = self.triangles[hit.triangle];
        let part = &self.mesh.parts[p];
        let material: &Material = &self.mesh.materials[part.material];
        if !hit.is_front && !material.is_double_sided {
            return None;
        }
        let corners = part.triangles[t].map(|c| c as usize);
        let [b1, b2] = hit.along;
        let shares = [1.0 - b1 - b2, b1, b2];
        let lookup = |used: &Option<TextureUse>| -> [f64; 4] {
            let found = used.as_ref().and_then(|used| {
                let set = part.texture_coordinates.get(used.coordinates)?;
                let texture = self.mesh.textures.get(used.texture)?;
                let mut uv = DVec2::ZERO;
                for (share, corner) in shares.into_iter().zip(corners) {
                    let at = used.transform.transform_point2(*set.get(corner)?);
                    uv += share * at.as_dvec2();
                }
                Some(self.texel(texture, uv))
            });
            found.unwrap_or([1.0; 4])
        };
        let mut colour = lookup(&material.base_texture);
        for (i, c) in colour.iter_mut().enumerate() {
            *c *= f64::from(material.base_colour[i]);
            if !part.colours.is_empty() {
                let of = |(share, corner): (f64, usize)| {
                    let of_corner = part.colours.get(corner);
                    share * of_corner.map_or(1.0, |rgba| f64::from(rgba[i]))
                };
                *c *= shares.into_iter().zip(corners).map(of).sum::<f64>();
            }
        }
        let glow = lookup(&material.emissive_texture);
        for i in 0..3 {
            colour[i] += f64::from(material.emissive[i]) * glow[i];
        }
        colour[3] = match material.alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) if colour[3] < f64::from(cutoff) => return None,
            AlphaMode::Mask(_) => 1.0,
            AlphaMode::Blend => colour[3].clamp(0.0, 1.0),
        };
        Some(colour)
    }

    /// Returns the texture's linear RGB and opacity, bilinear between the middles of its pixels.
    fn texel(&self, texture: &Texture, uv: DVec2) -> [f64; 4] {
        let image = &texture.image;
        let size = [image.width as i64, image.height as i64];
        let at = [uv.x * size[0] as f64 - 0.5, uv.y * size[1] as f64 - 0.5];
        let cell = at.map(f64::floor);
        let mut sum = [0.0; 4];
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let share = |axis: usize, step: i64| {
                let beyond = at[axis] - cell[axis];
                if step == 1 { beyond } else { 1.0 - beyond }
            };
            let index = |axis: usize, step: i64| {
                let (k, n) = ((cell[axis] as i64).saturating_add(step), size[axis]);
                match texture.wrap[axis] {
                    Wrap::Repeat => k.rem_euclid(n),
                    Wrap::ClampToEdge => k.clamp(0, n - 1),
                    Wrap::MirroredRepeat => {
                        let there = k.rem_euclid(2 * n);
                        if there < n { there } else { 2 * n - 1 - there }
                    }
                }
            };
            let place = index(1, j) * size[0] + index(0, i);
            let pixel = usize::try_from(place)
                .ok()
                .and_then(|place| image.pixels.get(place));
            let [r, g, b, a] = pixel.copied().unwrap_or_default();
            let [r, g, b] = [r, g, b].map(|c| self.linear[usize::from(c)]);
            let weight = share(0, i) * share(1, j);
            for (sum, c) in sum.iter_mut().zip([r, g, b, f64::from(a) / 255.0]) {
                *sum += weight * c;
            }
        }
        sum
    }
}

/// The corners of a triangle, which exist.
fn corners(part: &MeshPart, triangle: usize) -> [DVec3; 3] {
    part.triangles[triangle].map(|c| part.positions[c as usize])
}

/// Returns one offset in each of equally likely parts of a Gaussian. The parts are polar: radii by Box and Muller, angles
/// turned by the golden ratio each.
fn gaussian_offsets(count: usize, variance: f64) -> Vec<DVec2> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let offset = |i: usize| {
        let share = (i as f64 + 0.5) / count as f64;
        let radius = (-2.0 * variance * (-share).ln_1p()).sqrt();
        DVec2::from_angle(std::f64::consts::TAU * (i as f64 * GOLDEN).fract()) * radius
    };
    (0..count).map(offset).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::mesh::TextureImage;

    /// A square from -1 to 1 in x and y at z = 0, seen from z = 5 in 16 x 16 pixels of 1/8 each.
    fn square() -> (Mesh, Camera) {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
        let mesh = Mesh::of_triangles(corners, [[0, 1, 2], [0, 2, 3]]);
        let camera = Camera::orthographic(5.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, 4.0, [32, 32]);
        (mesh, camera)
    }

    #[test]
    fn edges_are_integrals_of_the_filter() {
        let (mesh, camera) = square();
        let settings = MeshTracerSettings {
            rays: 400,
            ..MeshTracerSettings::default()
        };
        let image = MeshTracer::new(&mesh).render(&camera, &settings);
        // Edges lie between columns 7 and 8, and 23 and 24.
        for (column, from_edge) in [
            (4, -3.5),
            (6, -1.5),
            (7, -0.5),
            (8, 0.5),
            (9, 1.5),
            (12, 4.5),
        ] {
            let expected = 0.5 * (1.0 + libm::erf(from_edge / 2.0_f64.sqrt()));
            let [r, _, _, a] = image.pixels[16 * 32 + column].map(f64::from);
            // Parts of the Gaussian that the edge cuts: some square root of 400 of 400, half of each.
            assert!((a - expected).abs() < 0.02, "{column}: {a}, not {expected}");
            assert_eq!(r.to_bits(), a.to_bits());
        }
        // A mean of codes is that of coverage, displayed.
        let coded = MeshTracerSettings {
            blends_codes: true,
            ..settings
        };
        let coded = MeshTracer::new(&mesh).render(&camera, &coded);
        for (a, b) in image.pixels.iter().zip(&coded.pixels) {
            assert!((a[0] - srgb_from_linear(b[0])).abs() < 1e-5 && a[3] == b[3]);
        }
    }

    #[test]
    fn textures_sides_and_panes_are_those_of_materials() {
        let (mesh, camera) = square();
        let image = TextureImage {
            width: 2,
            height: 1,
            pixels: vec![[255, 0, 0, 255], [0, 0, 255, 255]],
        };
        let set = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
        let mut mesh = mesh.with_texture(set.map(|[u, v]| glam::Vec2::new(u, v)), image);
        let settings = MeshTracerSettings {
            rays: 1,
            variance_px2: 0.0,
            ..MeshTracerSettings::default()
        };
        let row = |mesh: &Mesh| {
            MeshTracer::new(mesh).render(&camera, &settings).pixels[16 * 32..17 * 32].to_vec()
        };
        let pixels = row(&mesh);
        // Middles of texels lie at a quarter and three quarters of the square; 12 is at .28125 of it.
        let share = 0.03125_f32 / 0.5;
        let expected = [1.0 - share, 0.0, share, 1.0];
        for (found, expected) in pixels[12].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{:?}", pixels[12]);
        }
        assert_eq!(pixels[7], [0.0; 4]);
        let distances = MeshTracer::new(&mesh).distances(&camera);
        assert_eq!(
            [distances[16 * 32 + 7], distances[16 * 32 + 8]],
            [f64::INFINITY, 5.0]
        );
        mesh.materials[0].alpha = AlphaMode::Blend;
        mesh.materials[0].base_colour[3] = 0.25;
        assert!((row(&mesh)[12][3] - 0.25).abs() < 1e-6);
        mesh.materials[0].is_double_sided = false;
        for triangle in &mut mesh.parts[0].triangles {
            triangle.reverse();
        }
        assert_eq!(row(&mesh)[12], [0.0; 4]);
        // What does not exist is left out.
        mesh.materials.clear();
        assert!(row(&mesh).iter().all(|rgba| *rgba == [0.0; 4]));
    }
}
