//! Filters images separably, a few rows at a time: memory stays small whatever the image's height, and bands
//! run in parallel.

use rayon::prelude::*;

use crate::image::Image;

/// Number of rows of a band's result. With the 20 rows that windows reach beyond it, a sixth is computed twice.
const BAND_ROWS: usize = 128;

/// One channel of consecutive rows.
pub(super) struct Band {
    width: usize,
    pub(super) values: Vec<f64>,
}

impl Band {
    pub(super) fn new(width: usize, values: Vec<f64>) -> Self {
        Self { width, values }
    }

    /// Convolves the band along rows (pixels beyond the sides repeat the outermost) and along columns. Columns
    /// are filtered only where the whole filter fits: the result has `vertical.len() - 1` rows fewer. Filters
    /// have odd lengths and are applied as written, not mirrored.
    pub(super) fn filtered(&self, horizontal: &[f64], vertical: &[f64]) -> Self {
        let radius = horizontal.len() / 2;
        let mut padded = vec![0.0; self.width + 2 * radius];
        let mut along_rows = vec![0.0; self.values.len()];
        for (row, out) in self
            .values
            .chunks_exact(self.width)
            .zip(along_rows.chunks_exact_mut(self.width))
        {
            padded[..radius].fill(row[0]);
            padded[radius..radius + self.width].copy_from_slice(row);
            padded[radius + self.width..].fill(row[self.width - 1]);
            for (tap, &weight) in horizontal.iter().enumerate() {
                add_scaled(out, weight, &padded[tap..tap + self.width]);
            }
        }
        let rows = (self.values.len() / self.width + 1).saturating_sub(vertical.len());
        let mut values = vec![0.0; rows * self.width];
        for (y, out) in values.chunks_exact_mut(self.width).enumerate() {
            for (tap, &weight) in vertical.iter().enumerate() {
                let start = (y + tap) * self.width;
                add_scaled(out, weight, &along_rows[start..start + self.width]);
            }
        }
        Self::new(self.width, values)
    }
}

fn add_scaled(out: &mut [f64], weight: f64, values: &[f64]) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += weight * value;
    }
}

/// Sums `of` over bands of `rows`; `of` receives the rows of a band.
pub(super) fn sum_over_bands(
    rows: std::ops::Range<usize>,
    of: impl Fn(std::ops::Range<usize>) -> f64 + Sync,
) -> f64 {
    let starts: Vec<usize> = rows.clone().step_by(BAND_ROWS).collect();
    let sums: Vec<f64> = starts
        .into_par_iter()
        .map(|start| of(start..(start + BAND_ROWS).min(rows.end)))
        .collect();
    // In order, so that the sum does not depend on threads.
    sums.iter().sum()
}

/// Returns the pixels of `rows` and of `radius` rows above and below, over black, clamped to 0..1, linear. Rows
/// beyond the image repeat the outermost.
pub(super) fn displayed_rows(
    image: &Image,
    rows: &std::ops::Range<usize>,
    radius: usize,
) -> impl Iterator<Item = [f64; 3]> {
    (rows.start..rows.end + 2 * radius).flat_map(move |y| {
        let y = y.saturating_sub(radius).min(image.height - 1);
        image.pixels[y * image.width..(y + 1) * image.width]
            .iter()
            // Premultiplied colour over black is the colour itself.
            .map(|p| [p[0], p[1], p[2]].map(|c| f64::from(c.clamp(0.0, 1.0))))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_is_applied_as_written() {
        let band = Band::new(3, vec![1.0, 2.0, 4.0, 0.0, 0.0, 8.0, 1.0, 1.0, 1.0]);
        let right = band.filtered(&[0.0, 0.0, 1.0], &[1.0]);
        assert_eq!(right.values, [2.0, 4.0, 4.0, 0.0, 8.0, 8.0, 1.0, 1.0, 1.0]);
        let below = band.filtered(&[1.0], &[0.0, 0.0, 1.0]);
        assert_eq!(below.values, [1.0, 1.0, 1.0]);
        assert!(band.filtered(&[1.0], &[0.2; 5]).values.is_empty());
    }

    #[test]
    fn bands_cover_all_rows_once() {
        for height in [0, 1, BAND_ROWS, BAND_ROWS + 1, 1000] {
            let sum = sum_over_bands(0..height, |rows| rows.map(|y| y as f64).sum());
            assert_eq!(sum, (0..height).map(|y| y as f64).sum::<f64>());
        }
    }
}
