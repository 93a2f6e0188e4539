//! The field around the cells of a brick: local models of a lattice, from neighbours on the fly.

use glam::Vec3;

use super::BrickGrid;
use crate::constants::{BLOCK_CAPACITY, BRICK};
use crate::scene::{LocalModel, Shared, ValuesIn};

/// Rings of cells around a brick: ranges of values are those of five cells along each axis.
const RINGS: usize = 2;

/// Cells of a brick and its rings along each axis.
const WIDE: [usize; 3] = [
    BRICK[0] + 2 * RINGS,
    BRICK[1] + 2 * RINGS,
    BRICK[2] + 2 * RINGS,
];

/// The values of a brick's cells and of two rings around; NaN where there is none.
#[derive(Debug)]
pub(crate) struct Halo {
    values: [f32; WIDE[0] * WIDE[1] * WIDE[2]],
}

/// The least and the greatest value around each cell of a brick, by its number; reversed where there is
/// none.
#[derive(Debug)]
pub(crate) struct Ranges {
    pub(crate) least: [f32; BLOCK_CAPACITY],
    pub(crate) greatest: [f32; BLOCK_CAPACITY],
}

impl Halo {
    /// Of the brick of `cells`, first and one past the last along each axis.
    pub(crate) fn new(grid: &BrickGrid, values: &ValuesIn<Shared>, cells: [[usize; 2]; 3]) -> Self {
        let mut halo = Self {
            values: [f32::NAN; WIDE[0] * WIDE[1] * WIDE[2]],
        };
        match values {
            ValuesIn::U8(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::I16(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::U16(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::F32(_) | ValuesIn::F64(_) => halo.fill(grid, cells, |i| {
                // An infinite neighbour says nothing of a slope.
                let value = values.get(i);
                if value.is_finite() { value } else { f32::NAN }
            }),
        }
        halo
    }

    fn fill(&mut self, grid: &BrickGrid, cells: [[usize; 2]; 3], value: impl Fn(usize) -> f32) {
        let dims = grid.dims();
        let [x, y, z] = [0, 1, 2].map(|a| {
            let [first, end] = cells[a];
            first.saturating_sub(RINGS)..(end + RINGS).min(dims[a])
        });
        for k in z {
            for j in y.clone() {
                let row = grid.index([x.start, j, k]);
                let first = [x.start, j, k];
                let [wide_i, wide_j, wide_k] = [0, 1, 2].map(|a| first[a] + RINGS - cells[a][0]);
                let place = wide_i + WIDE[0] * (wide_j + WIDE[1] * wide_k);
                let own = &mut self.values[place..][..x.len()];
                for (n, out) in own.iter_mut().enumerate() {
                    *out = value(row + n);
                }
            }
        }
    }

    /// Where cell (i, j, k) of the brick lies among the values.
    #[inline]
    fn place([i, j, k]: [usize; 3]) -> usize {
        i + RINGS + WIDE[0] * (j + RINGS + WIDE[1] * (k + RINGS))
    }

    /// The value of a cell of the brick.
    #[inline]
    pub(crate) fn value(&self, cell: [usize; 3]) -> f32 {
        self.values[Self::place(cell)]
    }

    /// The model of a cell of the brick, without its range: central differences, second differences
    /// where there are neighbours on both sides, a one-sided slope where there is one, none without.
    ///
    /// Lᵀ g of a lattice is the kernel's width times half the difference of the neighbours, however
    /// far apart they lie; tr(H V)/2 is width²/2 times the sum of second differences over the axes,
    /// of uneven ones less the slope's share of how the spacing changes.
    ///
    /// - `bends`: of the cell along each axis, [`AxisSample::bend`](super::brick::AxisSample::bend).
    #[inline]
    pub(crate) fn model(&self, cell: [usize; 3], kernel_width: f32, bends: Vec3) -> LocalModel {
        const STRIDES: [usize; 3] = [1, WIDE[0], WIDE[0] * WIDE[1]];
        let place = Self::place(cell);
        let own = self.values[place];
        let mut slope = [0.0; 3];
        let mut second = 0.0;
        for a in 0..3 {
            let below = own - self.values[place - STRIDES[a]];
            let above = self.values[place + STRIDES[a]] - own;
            let (is_below, is_above) = (!below.is_nan(), !above.is_nan());
            if is_below && is_above {
                let change = below + above;
                slope[a] = 0.5 * change;
                second += (above - below) - change * bends[a];
            } else if is_below {
                slope[a] = below;
            } else if is_above {
                slope[a] = above;
            }
        }
        LocalModel {
            slope: Vec3::from(slope) * kernel_width,
            departure: 0.5 * kernel_width * kernel_width * second,
            below: 0.0,
            above: 0.0,
        }
    }

    /// The ranges of the values around all cells.
    pub(crate) fn ranges(&self) -> Box<Ranges> {
        let mut least = self
            .values
            .map(|v| if v.is_nan() { f32::INFINITY } else { v });
        let mut greatest = self
            .values
            .map(|v| if v.is_nan() { f32::NEG_INFINITY } else { v });
        // Along one axis after the other; what wraps around at the rings is never asked for.
        for stride in [1, WIDE[0], WIDE[0] * WIDE[1]] {
            least = around(&least, stride, f32::min);
            greatest = around(&greatest, stride, f32::max);
        }
        let mut ranges = Box::new(Ranges {
            least: [f32::INFINITY; BLOCK_CAPACITY],
            greatest: [f32::NEG_INFINITY; BLOCK_CAPACITY],
        });
        for n in 0..BLOCK_CAPACITY {
            let place = Self::place([
                n % BRICK[0],
                n / BRICK[0] % BRICK[1],
                n / (BRICK[0] * BRICK[1]),
            ]);
            ranges.least[n] = least[place];
            ranges.greatest[n] = greatest[place];
        }
        ranges
    }
}

/// Of each value and two to either side, `stride` apart, the least or the greatest; the first and last two
/// stay as they are.
fn around<const N: usize>(
    values: &[f32; N],
    stride: usize,
    of: impl Fn(f32, f32) -> f32,
) -> [f32; N] {
    let mut out = *values;
    let reach = 2 * stride;
    for i in reach..N - reach {
        let near = of(values[i - stride], values[i + stride]);
        let far = of(values[i - reach], values[i + reach]);
        out[i] = of(values[i], of(near, far));
    }
    out
}
