//! Writes sequences of pictures: numbered files, APNG, GIF or MP4.

use std::cell::RefCell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::film::Film;
use super::progress::note;
use crate::io::{check_folder, check_image_path, write_bytes_atomically, write_image_with};
use crate::{Error, Image, Result};

/// Writer of a sequence: numbered files, an APNG, a GIF or an MP4.
pub struct Animation {
    path: PathBuf,
    kind: Kind,
    rate: u16,
    written: usize,
}

impl std::fmt::Debug for Animation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Animation")
            .field("path", &self.path)
            .field("written", &self.written)
            .finish_non_exhaustive()
    }
}

enum Kind {
    /// One file per picture: the name before the number, the number's digits, and the name after
    /// it.
    Files {
        before: String,
        digits: usize,
        after: String,
    },
    Apng {
        writer: Option<png::Writer<Shared>>,
        bytes: Shared,
    },
    Gif(Option<gif::Encoder<Vec<u8>>>),
    Mp4(Box<Film>),
}

/// Buffer that outlives its writer.
#[derive(Clone, Default)]
struct Shared(Rc<RefCell<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Splits a file's name at its number: `a_%04d.png` or `a_%d.png`.
fn number_in(name: &str) -> Option<(&str, usize, &str)> {
    let (before, rest) = name.split_once('%')?;
    let (digits, after) = rest.split_once('d')?;
    let digits = match digits {
        "" => 1,
        _ => digits.parse().ok().filter(|d| (1..=9).contains(d))?,
    };
    Some((before, digits, after))
}

fn refused(path: &Path, found: &str, advice: String) -> Error {
    let expected = "NAME_%04d.png (exr, pfm, npy), an .mp4, an .apng or a .gif for a sequence";
    Error::format(path, "output", expected, found, advice)
}

/// Returns true if one file of this format holds many pictures.
pub(crate) fn is_animated(path: &Path) -> bool {
    matches!(extension(path).as_str(), "apng" | "gif" | "mp4")
}

fn extension(path: &Path) -> String {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.unwrap_or_default().to_ascii_lowercase()
}

impl Animation {
    /// Checks that a path can hold a sequence, before the pictures are drawn.
    ///
    /// # Errors
    /// A name without a number that is no APNG, GIF or MP4, another video format, an absent folder.
    pub fn check_path(path: &Path) -> Result<()> {
        let name = path.file_name().and_then(|name| name.to_str());
        match extension(path).as_str() {
            "apng" | "gif" | "mp4" => check_folder(path),
            "mov" | "mkv" | "webm" | "avi" => Err(refused(
                path,
                "a film of another format",
                format!("write --out {}", path.with_extension("mp4").display()),
            )),
            _ if name.and_then(number_in).is_some() => check_image_path(path),
            _ => Err(refused(
                path,
                "a name for one picture",
                "put a number into it, such as turn_%04d.png".into(),
            )),
        }
    }

    /// Opens the output for a sequence of pictures.
    ///
    /// - `size`: width and height in pixels.
    /// - `count`: number of pictures; exactly this many must follow.
    /// - `rate`: pictures per second, 1 to 100.
    ///
    /// # Errors
    /// The errors of [`Self::check_path`]; sizes that the format cannot store.
    pub fn new(path: &Path, size: [usize; 2], count: usize, rate: u16) -> Result<Self> {
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let kind = match extension(path).as_str() {
            "apng" => {
                let bytes = Shared::default();
                let (width, height) = (side(size[0]), side(size[1]));
                let mut encoder = png::Encoder::new(bytes.clone(), width, height);
                encoder.set_color(png::ColorType::Rgba);
                encoder.set_depth(png::BitDepth::Eight);
                let begun = encoder
                    .set_animated(side(count), 0)
                    .and_then(|()| encoder.set_frame_delay(1, rate))
                    .and_then(|()| encoder.write_header());
                Kind::Apng {
                    writer: Some(begun.map_err(|e| fault(path, &e))?),
                    bytes,
                }
            }
            "gif" => {
                let sides = size.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
                let begun = gif::Encoder::new(Vec::new(), sides[0], sides[1], &[]);
                let mut encoder = begun.map_err(|e| fault(path, &e))?;
                let repeats = encoder.set_repeat(gif::Repeat::Infinite);
                repeats.map_err(|e| fault(path, &e))?;
                Kind::Gif(Some(encoder))
            }
            "mp4" => Kind::Mp4(Box::new(Film::new(path, size, rate.max(1))?)),
            _ => {
                let name = path.file_name().and_then(|name| name.to_str());
                let (before, digits, after) = name
                    .and_then(number_in)
                    .ok_or_else(|| refused(path, "no number in it", "put %04d into it".into()))?;
                Kind::Files {
                    before: before.into(),
                    digits,
                    after: after.into(),
                }
            }
        };
        Ok(Self {
            path: path.into(),
            kind,
            rate: rate.max(1),
            written: 0,
        })
    }

    /// Path of the next picture; for an APNG, GIF or MP4, that of the one file.
    fn file(&self) -> PathBuf {
        match &self.kind {
            Kind::Files {
                before,
                digits,
                after,
            } => {
                let number = self.written;
                self.path
                    .with_file_name(format!("{before}{number:0digits$}{after}"))
            }
            Kind::Apng { .. } | Kind::Gif(_) | Kind::Mp4(_) => self.path.clone(),
        }
    }

    /// Adds a picture.
    ///
    /// # Errors
    /// A file that cannot be written; a size other than that of the first picture.
    pub fn push(&mut self, image: &Image) -> Result<()> {
        self.push_with(image, None)
    }

    /// Adds a picture as [`Self::push`] does, with a record of how it was made if it is a file of its own with a place
    /// for one.
    pub(crate) fn push_with(&mut self, image: &Image, record: Option<&str>) -> Result<()> {
        let rate = self.rate;
        let file = self.file();
        match &mut self.kind {
            Kind::Files { .. } => write_image_with(&file, image, record)?,
            Kind::Apng { writer, .. } => {
                let bytes = image.to_srgb8();
                let pushed = writer.as_mut().map(|w| w.write_image_data(&bytes));
                pushed.transpose().map_err(|e| fault(&file, &e))?;
            }
            Kind::Gif(encoder) => {
                let sides = [image.width, image.height];
                let sides = sides.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
                /// Speed of the GIF encoder: from 1, the slowest and best, to 30.
                const SPEED: i32 = 10;
                let mut bytes = image.to_srgb8();
                let mut frame = gif::Frame::from_rgba_speed(sides[0], sides[1], &mut bytes, SPEED);
                // The delay is in hundredths of a second.
                frame.delay = (100 + rate / 2) / rate;
                let pushed = encoder.as_mut().map(|e| e.write_frame(&frame));
                pushed.transpose().map_err(|e| fault(&file, &e))?;
            }
            Kind::Mp4(film) => film.push(image)?,
        }
        self.written += 1;
        Ok(())
    }

    /// Writes an APNG, GIF or MP4 as one complete file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self) -> Result<()> {
        let path = self.path;
        let bytes = match self.kind {
            Kind::Files { .. } => return Ok(()),
            Kind::Mp4(film) => {
                if film.finish()? {
                    note!("a film has no transparency: its pictures are over black");
                }
                return Ok(());
            }
            Kind::Apng { mut writer, bytes } => {
                let whole = writer.take().map(png::Writer::finish).transpose();
                whole.map_err(|e| fault(&path, &e))?;
                bytes.0.take()
            }
            Kind::Gif(mut encoder) => {
                let whole = encoder.take().map(gif::Encoder::into_inner).transpose();
                whole.map_err(|e| fault(&path, &e))?.unwrap_or_default()
            }
        };
        write_bytes_atomically(&path, &bytes)
    }
}

fn fault(path: &Path, error: &dyn std::fmt::Display) -> Error {
    let expected = "pictures that the format holds";
    let advice = "choose another size or format";
    Error::format(path, "encoding", expected, error.to_string(), advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_in_names() {
        assert_eq!(number_in("a_%04d.png"), Some(("a_", 4, ".png")));
        assert_eq!(number_in("%d.exr"), Some(("", 1, ".exr")));
        for none in ["a.png", "50%.png", "a%xd.png", "a%0d.png"] {
            assert_eq!(number_in(none), None, "{none}");
        }
    }
}
