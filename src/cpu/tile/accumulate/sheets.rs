//! Sums whole kernels in the layer that contains their centre.
//!
//! Twin: `shaders/tile/accumulate/sheets.wgsl`.

use super::ring::{Ring, Wants};
use crate::cpu::tile::evaluate::{Evaluate, Row};
use crate::cpu::tile::interval::cut::Cut;
use crate::cpu::tile::interval::{between, shares_at, whole};
use crate::cpu::tile::pixels::{Tile, count_row};

/// Receives rows and adds them to a layer.
pub(in crate::cpu::tile) struct IntoSheet<'a> {
    pub(super) ring: &'a mut Ring,
    /// Data of the cut, if the kernel may be cut.
    pub(super) cut: Option<Cut<'a>>,
    pub(super) layer: u32,
    pub(super) has_depth: bool,
    /// The tile in which kernels are counted, for a picture of counts.
    pub(super) count: Option<&'a mut Tile>,
}

impl IntoSheet<'_> {
    #[inline(always)]
    pub(super) fn take<const FMA: bool>(&mut self, evaluate: &Evaluate<'_>, row: &Row) {
        let first = row.first();
        let wants = Wants {
            colour: true,
            depth: self.has_depth,
        };
        if let Some(tile) = &mut self.count {
            count_row(tile, first, &row.inside);
        }
        let footprint = evaluate.footprint();
        let layer = self.ring.layer(self.layer);
        let Some(Cut { spans, meets }) = self.cut else {
            layer.add(first, &whole(row), footprint, wants);
            return;
        };
        let near = shares_at::<FMA>(evaluate, row, &spans.near, meets.near, 0.0);
        let middle = shares_at::<FMA>(evaluate, row, &spans.middle, meets.middle, 1.0);
        let far = shares_at::<FMA>(evaluate, row, &spans.far, meets.far, 1.0);
        let in_front = between(row, &near, &middle);
        layer.add(first, &in_front, footprint, wants);
        let behind = between(row, &middle, &far);
        self.ring.divided.add(first, &behind, footprint, wants);
    }
}
