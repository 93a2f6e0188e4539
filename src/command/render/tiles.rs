//! Compares the tiles of a picture with those of a file.

use std::sync::{Mutex, PoisonError};

use crate::constants::TILE_SIZE;
use crate::image::{ColumnImage, linear_from_srgb};
use crate::io::{Stored, StoredPicture, shown_count};
use crate::{Error, Image, Result};

/// Number of tiles of which one differs, with a probability of 99 %, if 5 % of all do: ln 0.01 / ln 0.95, rounded up.
/// Drawn without replacement, one is found the sooner.
pub(in crate::command) const DEFAULT_TILES: usize = 90;

/// A drawn picture.
pub(super) enum Drawn<'a> {
    Picture(&'a Image),
    Count(&'a Image),
    Column(&'a ColumnImage),
}

/// A picture that was written, and what a drawing of it again has shown.
pub(in crate::command) struct Comparison {
    name: String,
    picture: StoredPicture,
    /// Tiles that are drawn again; `None` for all.
    chosen: Option<Vec<bool>>,
    /// Number of the picture in its sequence.
    pub(in crate::command) frame: Option<usize>,
    found: Mutex<Option<Found>>,
}

/// Differences of the tiles that were drawn again.
#[derive(Debug, Clone, Default)]
pub(in crate::command) struct Found {
    /// Number of tiles that were compared, and of all.
    pub(in crate::command) compared: usize,
    pub(in crate::command) all: usize,
    /// Number of compared tiles with any difference.
    pub(in crate::command) unequal: usize,
    /// Greatest difference. Its unit is that of the tolerance.
    pub(in crate::command) greatest: f64,
    pub(in crate::command) tolerance: f64,
    /// Tiles beyond the tolerance: column and row of the first pixel, and the greatest difference.
    pub(in crate::command) different: Vec<([usize; 2], f64)>,
}

/// Difference of two pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Difference {
    is_equal: bool,
    /// True if rounding to codes alone may be the cause.
    is_rounding: bool,
    size: f64,
}

impl Comparison {
    /// Makes a comparison with a file.
    ///
    /// - `count`: number of tiles that are drawn again; `None` for all.
    /// - `seed`: chooses the tiles.
    pub(in crate::command) fn new(
        name: String,
        picture: StoredPicture,
        frame: Option<usize>,
        count: Option<usize>,
        seed: u64,
    ) -> Self {
        let [columns, rows] = grid(&picture);
        let chosen = count
            .filter(|count| *count < columns * rows)
            .map(|count| chosen(columns * rows, count, seed));
        Self {
            name,
            picture,
            chosen,
            frame,
            found: Mutex::new(None),
        }
    }

    /// Returns whether each tile is drawn; `None` if all are.
    pub(super) fn tiles(&self) -> Option<&[bool]> {
        self.chosen.as_deref()
    }

    /// Takes the result of the drawing.
    pub(in crate::command) fn found(&self) -> Option<Found> {
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        found.take()
    }

    /// Checks that a drawing has the picture's size, before it is drawn.
    pub(super) fn check_size(&self, [width, height]: [usize; 2]) -> Result<()> {
        let own = [self.picture.width, self.picture.height];
        match own == [width, height] {
            true => Ok(()),
            false => Err(Error::format(
                &self.name,
                "size",
                format!("{width} x {height} pixels, by its record"),
                format!("{} x {}", own[0], own[1]),
                "the picture is another one than its record tells of",
            )),
        }
    }

    /// Compares a drawing, and keeps what is found.
    ///
    /// # Errors
    /// Another size or kind of numbers than the picture's.
    pub(super) fn compare(&self, drawn: &Drawn<'_>, tolerance: f64) -> Result<()> {
        let found = match drawn {
            Drawn::Picture(image) => self.of_image(image, tolerance),
            // Counts are no colours: none may differ.
            Drawn::Count(count) => {
                let shown = shown_count(std::path::Path::new(&self.name), count);
                self.of_image(&shown, 0.0)
            }
            Drawn::Column(column) => {
                self.check_size([column.width, column.height])?;
                match &self.picture.stored {
                    Stored::Values(values) => {
                        let greatest = values.iter().map(|v| v.abs()).fold(0.0, f32::max);
                        let of = |i: usize| of_floats(&[values[i]], &[column.values[i]]);
                        Ok(self.found_of(of, tolerance * f64::from(greatest)))
                    }
                    _ => Err(self.other_kind("a column density")),
                }
            }
        };
        let mut kept = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = Some(found?);
        Ok(())
    }

    fn of_image(&self, image: &Image, tolerance: f64) -> Result<Found> {
        self.check_size([image.width, image.height])?;
        match &self.picture.stored {
            Stored::Codes(codes) => {
                let drawn = image.to_srgb8();
                let of = |i: usize| of_codes(codes[i], &drawn[4 * i..]);
                Ok(self.found_of(of, tolerance))
            }
            Stored::Colours(colours) => {
                let of = |i: usize| of_floats(&colours[i], &image.pixels[i]);
                Ok(self.found_of(of, tolerance))
            }
            Stored::Values(_) => Err(self.other_kind("colours")),
        }
    }

    fn other_kind(&self, expected: &str) -> Error {
        Error::format(
            &self.name,
            "channels",
            format!("{expected}, by its record"),
            "others",
            "the picture is another one than its record tells of",
        )
    }

    /// Sums up the differences of pixels by tiles.
    fn found_of(&self, of: impl Fn(usize) -> Difference, tolerance: f64) -> Found {
        let (width, height) = (self.picture.width, self.picture.height);
        let [columns, rows] = grid(&self.picture);
        let mut found = Found {
            all: columns * rows,
            tolerance,
            ..Found::default()
        };
        for tile in 0..columns * rows {
            if self.chosen.as_ref().is_some_and(|chosen| !chosen[tile]) {
                continue;
            }
            found.compared += 1;
            let first = [tile % columns, tile / columns].map(|i| i * TILE_SIZE);
            let (mut is_equal, mut is_beyond, mut greatest) = (true, false, 0.0_f64);
            for y in first[1]..height.min(first[1] + TILE_SIZE) {
                for x in first[0]..width.min(first[0] + TILE_SIZE) {
                    let difference = of(y * width + x);
                    is_equal &= difference.is_equal;
                    is_beyond |= !difference.is_rounding && difference.size > tolerance;
                    greatest = greatest.max(difference.size);
                }
            }
            found.unequal += usize::from(!is_equal);
            found.greatest = found.greatest.max(greatest);
            if is_beyond {
                found.different.push((first, greatest));
            }
        }
        found
    }
}

/// Returns the columns and rows of a picture's tiles.
fn grid(picture: &StoredPicture) -> [usize; 2] {
    [picture.width, picture.height].map(|n| n.div_ceil(TILE_SIZE))
}

/// Chooses some of all tiles, each set of that number with the same probability.
fn chosen(all: usize, count: usize, seed: u64) -> Vec<bool> {
    let mut state = seed;
    // SplitMix64 (Steele et al. 2014).
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let mut left = count;
    (0..all)
        .map(|tile| {
            // Selection sampling: Knuth, volume 2, algorithm S.
            let is_chosen = next() % ((all - tile) as u64) < left as u64;
            left -= usize::from(is_chosen);
            is_chosen
        })
        .collect()
}

/// Compares pixels of sRGB codes with straight alpha, in linear, premultiplied colour.
fn of_codes(a: [u8; 4], b: &[u8]) -> Difference {
    let linear = |p: &[u8]| {
        let alpha = f32::from(p[3]) / 255.0;
        let colour = |c: u8| linear_from_srgb(f32::from(c) / 255.0) * alpha;
        [colour(p[0]), colour(p[1]), colour(p[2]), alpha]
    };
    let off = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
    Difference {
        is_equal: off == Some(0),
        is_rounding: off.is_none_or(|off| off <= 1),
        ..of_floats(&linear(&a), &linear(b))
    }
}

/// Compares channels. What is no number equals itself alone.
fn of_floats(a: &[f32], b: &[f32]) -> Difference {
    let of = |(a, b): (&f32, &f32)| match a == b || (a.is_nan() && b.is_nan()) {
        true => 0.0,
        false => f64::from(*a - *b).abs(),
    };
    let sizes = a.iter().zip(b).map(of);
    let size = sizes.fold(0.0, |most: f64, size| {
        if size.is_nan() {
            f64::INFINITY
        } else {
            most.max(size)
        }
    });
    Difference {
        is_equal: size <= 0.0,
        is_rounding: false,
        size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn comparison(codes: Vec<[u8; 4]>, count: Option<usize>) -> Comparison {
        let picture = StoredPicture {
            width: 40,
            height: 20,
            stored: Stored::Codes(codes),
            record: None,
        };
        Comparison::new("a.png".into(), picture, None, count, 7)
    }

    #[test]
    fn tiles_beyond_the_tolerance_are_named() {
        let image = Image {
            width: 40,
            height: 20,
            pixels: vec![[0.5, 0.25, 0.125, 1.0]; 800],
        };
        let sound = {
            let codes = image.to_srgb8();
            let codes = codes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]);
            codes.collect::<Vec<_>>()
        };
        let found = |codes: Vec<[u8; 4]>| {
            let of = comparison(codes, None);
            of.compare(&Drawn::Picture(&image), 1.0 / 255.0).unwrap();
            of.found().unwrap()
        };
        let equal = found(sound.clone());
        assert_eq!((equal.compared, equal.all, equal.unequal), (6, 6, 0));
        // One code of 255 is rounding, even where it is more than the tolerance.
        let mut near = sound.clone();
        near[17][0] += 1;
        let near = found(near);
        assert_eq!((near.unequal, near.different.len()), (1, 0));
        assert!(near.greatest > 1.0 / 255.0, "{}", near.greatest);
        let mut off = sound;
        off[19 * 40 + 39][2] += 9;
        let off = found(off);
        assert_eq!((off.unequal, off.different.len()), (1, 1));
        assert_eq!(off.different[0].0, [32, 16]);
    }

    #[test]
    fn tiles_are_chosen_evenly() {
        let mut times = vec![0; 50];
        for seed in 0..4000 {
            let chosen = chosen(50, 20, seed);
            assert_eq!(chosen.iter().filter(|is| **is).count(), 20);
            for (times, is) in times.iter_mut().zip(chosen) {
                *times += i32::from(is);
            }
        }
        // 1600 each, with a standard deviation of 31.
        assert!(times.iter().all(|n| (n - 1600).abs() < 155), "{times:?}");
        assert_eq!(comparison(vec![[0; 4]; 800], Some(6)).tiles(), None);
        let some = comparison(vec![[0; 4]; 800], Some(4));
        assert_eq!(some.tiles().unwrap().iter().filter(|is| **is).count(), 4);
    }

    #[test]
    fn numbers_that_are_none_equal_themselves_alone() {
        let of = |a: f32, b: f32| of_floats(&[0.0, a], &[0.0, b]);
        assert!(of(f32::NAN, f32::NAN).is_equal);
        assert!(of(f32::INFINITY, f32::INFINITY).is_equal);
        for (a, b) in [(f32::NAN, 1.0), (1.0, f32::INFINITY)] {
            assert_eq!(of(a, b).size, f64::INFINITY);
        }
    }
}
