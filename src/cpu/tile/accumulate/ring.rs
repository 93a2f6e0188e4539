//! Keeps the open layers while kernels are summed.

use crate::constants::TILE_PIXELS;
use crate::cpu::tile::classify::slab::Slopes;
use crate::cpu::tile::pixels::{Plane, RowOf, add_scaled};
use crate::record::{Footprint, ViewUniform};

/// Sums over the kernels of a layer, for each pixel.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct Layer {
    pub(super) tau: Plane,
    /// Optical depth times linear colour. If kernels carry values: optical depth times value, in `red`.
    pub(super) red: Plane,
    pub(super) green: Plane,
    pub(super) blue: Plane,
    /// Optical depth times depth; for sheets, if depths are written.
    pub(super) depth: Plane,
    /// Derivatives of the sums, if lighting needs them.
    pub(super) slopes: Option<Box<Slopes>>,
    /// True if anything was added since the last clear.
    pub(super) is_used: bool,
}

/// Quantities that are summed besides optical depths and values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wants {
    /// Three colours; otherwise only the first channel.
    pub(super) colour: bool,
    /// Depths.
    pub(super) depth: bool,
}

impl Default for Layer {
    fn default() -> Self {
        Self {
            tau: [0.0; TILE_PIXELS],
            red: [0.0; TILE_PIXELS],
            green: [0.0; TILE_PIXELS],
            blue: [0.0; TILE_PIXELS],
            depth: [0.0; TILE_PIXELS],
            slopes: None,
            is_used: false,
        }
    }
}

impl Layer {
    pub(super) fn clear(&mut self) {
        if self.is_used {
            let mut slopes = self.slopes.take();
            if let Some(slopes) = &mut slopes {
                **slopes = Slopes::default();
            }
            *self = Self {
                slopes,
                ..Self::default()
            };
        }
    }

    /// Clears pixel `i`.
    pub(super) fn clear_pixel(&mut self, i: usize) {
        for plane in [
            &mut self.tau,
            &mut self.red,
            &mut self.green,
            &mut self.blue,
            &mut self.depth,
        ] {
            plane[i] = 0.0;
        }
        if let Some(slopes) = &mut self.slopes {
            slopes.clear_pixel(i);
        }
    }

    /// Adds optical depths to the pixels from `first` on.
    ///
    /// - `wants`: the quantities to sum.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        first: usize,
        taus: &RowOf<f32>,
        footprint: &Footprint,
        wants: Wants,
    ) {
        let [red, green, blue] = footprint.carried.colour();
        add_scaled(&mut self.tau, first, taus, 1.0);
        add_scaled(&mut self.red, first, taus, red);
        if wants.colour {
            add_scaled(&mut self.green, first, taus, green);
            add_scaled(&mut self.blue, first, taus, blue);
        }
        if wants.depth {
            add_scaled(&mut self.depth, first, taus, footprint.depth);
        }
    }
}

/// The open layers of a tile.
#[derive(Debug)]
pub(in crate::cpu::tile) struct Ring {
    /// Layer n is stored at n modulo the number of layers, a power of two.
    pub(super) layers: Vec<Layer>,
    /// The nearest open layer.
    pub(super) first: u32,
    /// The part behind the surface, in the layer that the surface divides.
    pub(super) divided: Layer,
}

impl Default for Ring {
    fn default() -> Self {
        Self {
            layers: vec![Layer::default()],
            first: 0,
            divided: Layer::default(),
        }
    }
}

/// Returns the depth z at which a layer of slabs begins.
pub(super) fn layer_start(view: &ViewUniform, layer: u32) -> f32 {
    // Whole multiples of the thickness, which are exact in f32 wherever depths are: a sum of lengths
    // would accumulate roundings.
    view.layer_first.saturating_add_unsigned(layer) as f32 * view.layer_thickness
}

/// Returns the depth at which a layer ends for a kernel whose `last` layer extends to infinity.
pub(super) fn layer_end(view: &ViewUniform, layer: u32, last: u32) -> f32 {
    if layer < last {
        layer_start(view, layer + 1)
    } else {
        f32::INFINITY
    }
}

/// Returns the layer that contains a depth, or `first` for depths in front of it.
pub(super) fn layer_at(view: &ViewUniform, depth: f32, first: u32) -> u32 {
    // A cast saturates, and NaN gives 0.
    let number = (depth / view.layer_thickness).floor() as i32;
    let ahead = i64::from(number) - i64::from(view.layer_first);
    u32::try_from(ahead).unwrap_or(0).max(first)
}

impl Ring {
    /// Clears the ring for a new tile.
    pub(in crate::cpu::tile) fn clear(&mut self) {
        self.layers.iter_mut().for_each(Layer::clear);
        self.divided.clear();
        self.first = 0;
    }

    /// Enlarges the ring to hold the layers up to `last`.
    pub(super) fn grow(&mut self, last: u32) {
        let wanted = (last - self.first + 1) as usize;
        if wanted <= self.layers.len() {
            return;
        }
        let old = std::mem::take(&mut self.layers);
        self.layers
            .resize_with(wanted.next_power_of_two(), Layer::default);
        let n = old.len();
        for (i, layer) in old.into_iter().enumerate() {
            // Offset from `first` of the layer that was stored at i.
            let ahead = (i + n - self.first as usize % n) % n;
            let at = (self.first as usize + ahead) % self.layers.len();
            self.layers[at] = layer;
        }
    }

    pub(super) fn place(&self, layer: u32) -> usize {
        layer as usize & (self.layers.len() - 1)
    }

    /// Returns an open layer.
    #[inline(always)]
    pub(super) fn layer(&mut self, layer: u32) -> &mut Layer {
        let place = self.place(layer);
        &mut self.layers[place]
    }
}
