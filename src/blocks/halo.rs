//! Loads the halo of a brick, and computes local models of a lattice from neighbouring cells on the fly.

use glam::Vec3;

use crate::blocks::brick::BrickGrid;
use crate::constants::{BLOCK_CAPACITY, BRICK};
use crate::scene::{LocalModel, Shared, ValuesIn};

/// Layers of cells around a brick: ranges of values cover five cells along each axis.
const RINGS: usize = 2;

/// Cells of a brick and its halo along each axis.
const WIDE: [usize; 3] = [
    BRICK[0] + 2 * RINGS,
    BRICK[1] + 2 * RINGS,
    BRICK[2] + 2 * RINGS,
];

/// Values of a brick's cells and of two layers around; NaN where there is no cell.
#[derive(Debug)]
pub(crate) struct Halo {
    values: [f32; WIDE[0] * WIDE[1] * WIDE[2]],
}

/// Least and greatest value around each cell of a brick, by the cell's number; reversed if there is none.
#[derive(Debug)]
pub(crate) struct Ranges {
    pub(crate) least: [f32; BLOCK_CAPACITY],
    pub(crate) greatest: [f32; BLOCK_CAPACITY],
}

impl Halo {
    /// Loads the halo of the brick of `cells` (first and one past the last along each axis).
    pub(crate) fn new(grid: &BrickGrid, values: &ValuesIn<Shared>, cells: [[usize; 2]; 3]) -> Self {
        let mut halo = Self {
            values: [f32::NAN; WIDE[0] * WIDE[1] * WIDE[2]],
        };
        match values {
            ValuesIn::U8(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::I16(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::U16(v) => halo.fill(grid, cells, |i| f32::from(v[i])),
            ValuesIn::F32(_) | ValuesIn::F64(_) => halo.fill(grid, cells, |i| {
                // An infinite neighbour gives no slope.
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

    /// Returns the index of cell (i, j, k) of the brick among the values.
    #[inline]
    fn place([i, j, k]: [usize; 3]) -> usize {
        i + RINGS + WIDE[0] * (j + RINGS + WIDE[1] * (k + RINGS))
    }

    /// The value of a cell of the brick.
    #[inline]
    pub(crate) fn value(&self, cell: [usize; 3]) -> f32 {
        self.values[Self::place(cell)]
    }

    /// Returns the model of a cell of the brick, without its range. The slope is a central difference, or a one-sided
    /// one if there is one neighbour, or 0 without neighbours. Second differences are used if there are neighbours on
    /// both sides.
    ///
    /// For a lattice, Lᵀ g is the kernel's width times half the difference of the neighbours, however far apart they
    /// lie. tr(H V)/2 is width²/2 times the sum of second differences over the axes. If the spacing is uneven, the
    /// slope times the change of the spacing is subtracted from each.
    ///
    /// - `bends`: change of the spacing at the cell along each axis,
    ///   [`AxisSample::bend`](super::brick::AxisSample::bend).
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

    /// Returns the ranges of the values around all cells.
    pub(crate) fn ranges(&self) -> Box<Ranges> {
        let mut least = self
            .values
            .map(|v| if v.is_nan() { f32::INFINITY } else { v });
        let mut greatest = self
            .values
            .map(|v| if v.is_nan() { f32::NEG_INFINITY } else { v });
        // Along one axis after the other; values that wrap around in the outer layers are never used.
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

/// Returns, for each value, the least or the greatest of it and two values to either side, `stride` apart. The first
/// and last two stay as they are.
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
