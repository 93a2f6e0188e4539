//! Which kernels a ray meets.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::Ray;

use super::kernel::Kernel;

/// Below this many kernels a list is as fast as a tree.
const LIST_LENGTH: usize = 64;

/// A BVH over the boxes of the kernels' reach, camera space.
pub(super) struct Traversal {
    /// `None`: few enough to try all.
    bvh: Option<Bvh2>,
    /// obvhs works in f32: a unit scene, so that nothing overflows or vanishes.
    scale: f64,
}

impl Traversal {
    pub(super) fn new(kernels: &[Kernel]) -> Self {
        let mut all = Self {
            bvh: None,
            scale: 1.0,
        };
        if kernels.len() <= LIST_LENGTH {
            return all;
        }
        let corner = |k: &Kernel| (k.centre.abs() + k.half_extent()).max_element();
        let widest = kernels.iter().map(corner).fold(0.0, f64::max);
        if !(widest > 0.0 && widest.is_finite()) {
            return all;
        }
        all.scale = 1.0 / widest;
        let boxes: Vec<Aabb> = kernels
            .iter()
            .map(|k| {
                let (centre, half) = (k.centre * all.scale, k.half_extent() * all.scale);
                // f32 rounds corners and directions by 1e-7 of the distance.
                let half = half + (centre.abs() + half).max_element() * ROUNDING;
                let corner = |v: DVec3| Vec3A::from(v.as_vec3());
                Aabb::new(corner(centre - half), corner(centre + half))
            })
            .collect();
        let indices = (0..u32::try_from(boxes.len()).unwrap_or(u32::MAX)).collect();
        all.bvh = Some(PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Minimum,
            &boxes,
            indices,
            SortPrecision::U64,
            0,
        ));
        all
    }

    /// Calls `meet` with every kernel whose box the ray meets, and with some whose it does not.
    pub(super) fn each<'k>(
        &self,
        kernels: &'k [Kernel],
        origin: DVec3,
        direction: DVec3,
        mut meet: impl FnMut(&'k Kernel),
    ) {
        let Some(bvh) = &self.bvh else {
            kernels.iter().for_each(meet);
            return;
        };
        let narrow = |v: DVec3| Vec3A::from(v.as_vec3());
        let ray = Ray::new_inf(narrow(origin * self.scale), narrow(direction));
        bvh.ray_traverse_anyhit(ray, |_, i| {
            meet(&kernels[bvh.primitive_indices[i] as usize]);
        });
    }
}

/// By which share of their distance boxes are enlarged.
const ROUNDING: f64 = 2e-6;
