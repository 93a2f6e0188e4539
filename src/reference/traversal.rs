//! Finds the boxes that a ray meets.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::Ray;

/// Greatest number of boxes for which a list is as fast as a tree.
const LIST_LENGTH: usize = 64;

/// A BVH over boxes around the reach of kernels or around cells.
#[derive(Clone)]
pub(super) struct Traversal {
    /// `None` if there are few enough boxes to try all.
    bvh: Option<Bvh2>,
    count: usize,
    /// Scale to a unit scene, because obvhs works in f32: nothing overflows or underflows.
    scale: f64,
}

impl Traversal {
    /// Makes a traversal that tries all of `count` boxes.
    pub(super) fn of_all(count: usize) -> Self {
        Self {
            bvh: None,
            count,
            scale: 1.0,
        }
    }

    /// Makes a traversal of `count` boxes, each given by its centre and half its size.
    pub(super) fn new(count: usize, bounds: impl Fn(usize) -> (DVec3, DVec3)) -> Self {
        let mut all = Self::of_all(count);
        if count <= LIST_LENGTH {
            return all;
        }
        let corner = |(centre, half): (DVec3, DVec3)| (centre.abs() + half).max_element();
        let widest = (0..count).map(|i| corner(bounds(i))).fold(0.0, f64::max);
        if !(widest > 0.0 && widest.is_finite()) {
            return all;
        }
        all.scale = 1.0 / widest;
        let boxes: Vec<Aabb> = (0..count)
            .map(|i| {
                let (centre, half) = bounds(i);
                let (centre, half) = (centre * all.scale, half * all.scale);
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

    /// Calls `meet` with every box that the ray meets, and with some that it does not meet.
    pub(super) fn each(&self, origin: DVec3, direction: DVec3, mut meet: impl FnMut(usize)) {
        let Some(bvh) = &self.bvh else {
            (0..self.count).for_each(meet);
            return;
        };
        let narrow = |v: DVec3| Vec3A::from(v.as_vec3());
        let ray = Ray::new_inf(narrow(origin * self.scale), narrow(direction));
        bvh.ray_traverse_anyhit(ray, |_, i| {
            meet(bvh.primitive_indices[i] as usize);
        });
    }
}

/// Enlargement of boxes, as a share of their distance.
const ROUNDING: f64 = 2e-6;
