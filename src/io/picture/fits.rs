//! Writes all-sky maps in FITS: a binary table in HEALPix's ring order, big-endian f32.
//!
//! Source: FITS standard 4.0, sections 3, 4.4.1 and 7.3; keywords of "The HEALPix Primer", "Unformatted files".

use std::path::Path;

use crate::error::Result;
use crate::image::{ColumnImage, Image};
use crate::io::bytes::atomic::write_bytes_atomically;
use crate::io::bytes::file::extension;

/// Length of a line of a header.
const CARD: usize = 80;

/// Length of which headers and data are multiples.
const BLOCK: usize = 2880;

/// Returns true if a path names a FITS file.
pub(crate) fn is_fits(path: &Path) -> bool {
    matches!(extension(path).as_str(), "fits" | "fit")
}

/// Writes a picture of all directions: red, green and blue, linear and times the opacity, and the opacity.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn write_sky(path: &Path, image: &Image) -> Result<()> {
    let names = ["RED", "GREEN", "BLUE", "ALPHA"];
    let values = image.pixels.iter().flatten();
    write(path, &names, image.pixels.len(), values)
}

/// Writes a column density of all directions.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn write_sky_column(path: &Path, column: &ColumnImage) -> Result<()> {
    let values = column.values.iter();
    write(path, &["COLUMN"], column.values.len(), values)
}

/// - `rows`: 12 n² pixels.
/// - `values`: row by row.
fn write<'a>(
    path: &Path,
    names: &[&str],
    rows: usize,
    values: impl Iterator<Item = &'a f32>,
) -> Result<()> {
    let mut bytes = Vec::new();
    let mut header = Header::default();
    header.value("SIMPLE", "T");
    header.value("BITPIX", "8");
    header.value("NAXIS", "0");
    header.value("EXTEND", "T");
    header.end(&mut bytes);

    let mut header = Header::default();
    header.text("XTENSION", "BINTABLE");
    header.value("BITPIX", "8");
    header.value("NAXIS", "2");
    header.value("NAXIS1", &(4 * names.len()).to_string());
    header.value("NAXIS2", &rows.to_string());
    header.value("PCOUNT", "0");
    header.value("GCOUNT", "1");
    header.value("TFIELDS", &names.len().to_string());
    for (i, name) in names.iter().enumerate() {
        header.text(&format!("TTYPE{}", i + 1), name);
        header.text(&format!("TFORM{}", i + 1), "1E");
    }
    header.text("PIXTYPE", "HEALPIX");
    header.text("ORDERING", "RING");
    header.value("NSIDE", &(rows / 12).isqrt().to_string());
    header.value("FIRSTPIX", "0");
    header.value("LASTPIX", &rows.saturating_sub(1).to_string());
    header.text("INDXSCHM", "IMPLICIT");
    header.text("OBJECT", "FULLSKY");
    header.end(&mut bytes);
    for value in values {
        bytes.extend(value.to_be_bytes());
    }
    fill(&mut bytes, 0);
    write_bytes_atomically(path, &bytes)
}

/// Fills the last block.
fn fill(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(BLOCK), with);
}

/// Lines of a header.
#[derive(Default)]
struct Header(String);

impl Header {
    fn card(&mut self, text: &str) {
        self.0 += &format!("{text:<CARD$}");
    }

    /// Adds a number or a truth value.
    fn value(&mut self, key: &str, value: &str) {
        self.card(&format!("{key:<8}= {value:>20}"));
    }

    fn text(&mut self, key: &str, text: &str) {
        self.card(&format!("{key:<8}= '{text:<8}'"));
    }

    fn end(mut self, bytes: &mut Vec<u8>) {
        self.card("END");
        bytes.extend(self.0.into_bytes());
        fill(bytes, b' ');
    }
}
