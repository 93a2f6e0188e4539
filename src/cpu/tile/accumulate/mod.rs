//! Axis *accumulate*: combines the kernels of a pixel.

pub(super) mod column;
pub(super) mod into_over;
pub(super) mod layers;
pub(super) mod maximum;
pub(super) mod opaque;
pub(super) mod over;
pub(super) mod ring;
pub(super) mod sheets;
pub(super) mod slabs;

use self::into_over::IntoOver;
use self::sheets::IntoSheet;
use self::slabs::IntoSlabs;
use super::evaluate::Evaluate;
use super::interval::domain::domain_of;
use super::pixels::Plane;
use crate::constants::TILE_SIZE;
use crate::simd::SimdWork;

/// Adds a kernel to a tile, row by row, for combinations that are not fused. All evaluations and all
/// receivers of rows share this body, so that their numbers of variants do not multiply.
pub(super) struct AddRows<'a> {
    pub(super) evaluate: &'a Evaluate<'a>,
    /// |D| of each pixel's ray.
    pub(super) rays: &'a Plane,
    pub(super) into: Into<'a>,
}

/// The receivers of rows.
pub(super) enum Into<'a> {
    Over(IntoOver<'a>),
    Sheet(IntoSheet<'a>),
    Slabs(IntoSlabs<'a>),
}

impl SimdWork for AddRows<'_> {
    /// Number of pixels within the cut-off.
    type Output = u32;

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> u32 {
        let Self {
            evaluate,
            rays,
            mut into,
        } = self;
        let mut count = 0;
        for y in evaluate.rows() {
            let Some(ray_length) = rays[y * TILE_SIZE..].first_chunk::<TILE_SIZE>() else {
                continue;
            };
            let mut row = evaluate.row::<FMA>(y, ray_length);
            count += row.count;
            if row.count == 0 {
                continue;
            }
            row.domain = domain_of::<FMA>(evaluate, &row);
            match &mut into {
                Into::Over(into) => into.take::<FMA>(evaluate, &row),
                Into::Sheet(into) => into.take::<FMA>(evaluate, &row),
                Into::Slabs(into) => into.take::<FMA>(evaluate, &row),
            }
        }
        count
    }
}
