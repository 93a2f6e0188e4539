//! Ray-traces meshes, for comparison with pictures of their surfels.
//!
//! A pixel is the mean over rays that are distributed as its low-pass filter, a Gaussian of one
//! squared pixel, which EWA evaluates in closed form. Textures are interpolated bilinearly in
//! linear light, without a pyramid: the number of rays does the filtering.

use ewa_splat::Image;
use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::{AlphaMode, Mesh, Texture, TextureUse, Wrap};
use ewa_splat::view::{Camera, Projection};
use glam::{DVec2, DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::Ray;
use rayon::prelude::*;

/// Mesh prepared for ray tracing.
pub(crate) struct Tracer<'a> {
    mesh: &'a Mesh,
    /// Part and index of each triangle.
    triangles: Vec<[usize; 2]>,
    bvh: Bvh2,
    origin: DVec3,
    scale: f64,
    linear: Vec<f32>,
}

/// Intersection of a ray with a triangle.
struct Hit {
    distance: f64,
    triangle: usize,
    b1: f64,
    b2: f64,
    is_front: bool,
}

impl<'a> Tracer<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let all = || mesh.parts.iter().flat_map(|part| &part.positions);
        let low = all().copied().reduce(DVec3::min).unwrap();
        let high = all().copied().reduce(DVec3::max).unwrap();
        let origin = 0.5 * (low + high);
        // The tree works in f32, so the scene is scaled to unit size.
        let scale = 1.0 / (high - low).max_element();
        let triangles: Vec<[usize; 2]> = (0..mesh.parts.len())
            .flat_map(|p| (0..mesh.parts[p].triangles.len()).map(move |t| [p, t]))
            .collect();
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|&[p, t]| {
                let part = &mesh.parts[p];
                let mut found = Aabb::empty();
                for corner in part.triangles[t] {
                    let at = (part.positions[corner as usize] - origin) * scale;
                    found.extend(Vec3A::from((at - 1e-5).as_vec3()));
                    found.extend(Vec3A::from((at + 1e-5).as_vec3()));
                }
                found
            })
            .collect();
        let indices = (0..boxes.len() as u32).collect();
        let bvh = PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Minimum,
            &boxes,
            indices,
            SortPrecision::U64,
            0,
        );
        let linear = (0..=255_u8).map(|c| linear_from_srgb(f32::from(c) / 255.0));
        Self {
            mesh,
            triangles,
            bvh,
            origin,
            scale,
            linear: linear.collect(),
        }
    }

    /// Renders the picture, premultiplied, with `side`² rays per pixel.
    pub(crate) fn render(&self, camera: &Camera, side: usize) -> Image {
        let mut image = Image::new(camera.width, camera.height);
        let offsets = gaussian_offsets(side);
        image
            .pixels
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, pixel)| {
                let centre = DVec2::new((i % camera.width) as f64, (i / camera.width) as f64) + 0.5;
                let mut sum = [0.0; 4];
                for offset in &offsets {
                    let sample = self.sample(camera, centre + *offset);
                    for (sum, s) in sum.iter_mut().zip(sample) {
                        *sum += s;
                    }
                }
                *pixel = sum.map(|s| (s / offsets.len() as f64) as f32);
            });
        image
    }

    /// Returns the premultiplied colour and opacity seen at a point of the image.
    fn sample(&self, camera: &Camera, px: DVec2) -> [f64; 4] {
        let slope = (px - camera.centre_px) / camera.focal_px;
        let world_from_camera = camera.camera_from_world.transpose();
        let (from, along) = match camera.projection {
            Projection::Perspective => (camera.eye, slope.extend(1.0)),
            Projection::Orthographic => {
                (camera.eye + world_from_camera * slope.extend(0.0), DVec3::Z)
            }
        };
        let along = (world_from_camera * along).normalize();
        let mut hits = self.hits((from - self.origin) * self.scale, along);
        hits.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let mut shown = [0.0; 4];
        for hit in &hits {
            let Some([r, g, b, alpha]) = self.shade(hit) else {
                continue;
            };
            let seen = (1.0 - shown[3]) * alpha;
            for (shown, c) in shown.iter_mut().zip([r, g, b, 1.0]) {
                *shown += seen * c;
            }
            if shown[3] >= 1.0 {
                break;
            }
        }
        shown
    }

    fn hits(&self, from: DVec3, along: DVec3) -> Vec<Hit> {
        let mut hits = Vec::new();
        let ray = Ray::new_inf(Vec3A::from(from.as_vec3()), Vec3A::from(along.as_vec3()));
        self.bvh.ray_traverse_anyhit(ray, |_, id| {
            let triangle = self.bvh.primitive_indices[id] as usize;
            hits.extend(self.intersect(triangle, from, along));
        });
        hits
    }

    /// Intersects a ray with a triangle (Möller and Trumbore 1997), in f64.
    fn intersect(&self, triangle: usize, from: DVec3, along: DVec3) -> Option<Hit> {
        let [p, t] = self.triangles[triangle];
        let part = &self.mesh.parts[p];
        let corner =
            part.triangles[t].map(|c| (part.positions[c as usize] - self.origin) * self.scale);
        let (e1, e2) = (corner[1] - corner[0], corner[2] - corner[0]);
        let across = along.cross(e2);
        let determinant = e1.dot(across);
        if determinant == 0.0 {
            return None;
        }
        let offset = from - corner[0];
        let b1 = offset.dot(across) / determinant;
        let turned = offset.cross(e1);
        let b2 = along.dot(turned) / determinant;
        let distance = e2.dot(turned) / determinant;
        let is_inside = b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 && distance > 0.0;
        is_inside.then_some(Hit {
            distance,
            triangle,
            b1,
            b2,
            is_front: determinant > 0.0,
        })
    }

    /// Returns linear RGB and opacity; `None` where nothing is.
    fn shade(&self, hit: &Hit) -> Option<[f64; 4]> {
        let [p, t] = self.triangles[hit.triangle];
        let part = &self.mesh.parts[p];
        let material = &self.mesh.materials[part.material];
        if !hit.is_front && !material.is_double_sided {
            return None;
        }
        let corners = part.triangles[t].map(|c| c as usize);
        let shares = [1.0 - hit.b1 - hit.b2, hit.b1, hit.b2];
        let lookup = |used: &Option<TextureUse>| -> [f64; 4] {
            let Some(used) = used else { return [1.0; 4] };
            let set = &part.texture_coordinates[used.coordinates];
            let uv = (0..3).map(|i| {
                let at = used.transform.transform_point2(set[corners[i]]);
                shares[i] * at.as_dvec2()
            });
            self.texel(&self.mesh.textures[used.texture], uv.sum())
        };
        let mut colour = lookup(&material.base_texture);
        for (i, c) in colour.iter_mut().enumerate() {
            let at_corner = |k: usize| shares[k] * f64::from(part.colours[corners[k]][i]);
            *c *= f64::from(material.base_colour[i]);
            if !part.colours.is_empty() {
                *c *= (0..3).map(at_corner).sum::<f64>();
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
            AlphaMode::Blend => colour[3],
        };
        Some(colour)
    }

    fn texel(&self, texture: &Texture, uv: DVec2) -> [f64; 4] {
        let image = &texture.image;
        let size = [image.width as i64, image.height as i64];
        let at = [uv.x * size[0] as f64 - 0.5, uv.y * size[1] as f64 - 0.5];
        let mut sum = [0.0; 4];
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let cell = [at[0].floor(), at[1].floor()];
            let share = |axis: usize, step: i64| {
                let beyond = at[axis] - cell[axis];
                if step == 1 { beyond } else { 1.0 - beyond }
            };
            let index = |axis: usize, step: i64| {
                let (k, n) = (cell[axis] as i64 + step, size[axis]);
                match texture.wrap[axis] {
                    Wrap::Repeat => k.rem_euclid(n),
                    Wrap::ClampToEdge => k.clamp(0, n - 1),
                    Wrap::MirroredRepeat => {
                        let there = k.rem_euclid(2 * n);
                        if there < n { there } else { 2 * n - 1 - there }
                    }
                }
            };
            let weight = share(0, i) * share(1, j);
            let pixel = image.pixels[(index(1, j) * size[0] + index(0, i)) as usize];
            for (c, sum) in sum.iter_mut().enumerate() {
                *sum += weight
                    * if c < 3 {
                        f64::from(self.linear[usize::from(pixel[c])])
                    } else {
                        f64::from(pixel[3]) / 255.0
                    };
            }
        }
        sum
    }
}

/// Returns one offset in each of `side`² equally likely parts of a Gaussian of one squared pixel.
/// The parts are polar: radii by Box and Muller, angles stratified, each ring rotated by the golden
/// ratio.
fn gaussian_offsets(side: usize) -> Vec<DVec2> {
    let count = side * side;
    let golden = 0.618_033_988_749_894_9;
    (0..count)
        .map(|i| {
            let share = (i as f64 + 0.5) / count as f64;
            let radius = (-2.0 * (-share).ln_1p()).sqrt();
            DVec2::from_angle(std::f64::consts::TAU * (i as f64 * golden).fract()) * radius
        })
        .collect()
}
