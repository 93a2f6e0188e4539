//! Reads pictures number by number, with the record of how they were made.

use std::io::Cursor;
use std::path::Path;

use ::exr::block;
use ::exr::prelude as exr;
use exr::{AttributeValue, ReadChannels, ReadLayers, ReadSpecificChannel, Text};

use super::image_file::{check_claim, damaged, read_exr, unknown_extension};
use super::provenance::KEYWORD;
use super::samples::{Encoded, Refusal, png_limits};
use crate::error::Result;
use crate::io::bytes::file::{extension, read_all};

/// Greatest length of a record that is read, bytes.
const MOST_BYTES: usize = 16 << 20;

/// Returns whether files with the extension of a path have a place for a record.
pub(crate) fn carries_record(path: &Path) -> bool {
    matches!(extension(path).as_str(), "png" | "exr")
}

/// Numbers of a picture as its file stores them, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Stored {
    /// sRGB codes with straight alpha: PNG.
    Codes(Vec<[u8; 4]>),
    /// Linear, premultiplied colours: EXR with R, G and B.
    Colours(Vec<[f32; 4]>),
    /// Values of a column density: EXR with Y.
    Values(Vec<f32>),
}

/// A picture's file: its numbers, and the record of how it was made if it has one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StoredPicture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) stored: Stored,
    pub(crate) record: Option<String>,
}

/// Reads a picture's file with its record.
///
/// # Errors
/// Another extension than `png` and `exr`, a damaged file.
pub(crate) fn read_stored(path: &Path) -> Result<StoredPicture> {
    let extension = extension(path);
    if !carries_record(path) {
        return Err(unknown_extension(path, "png or exr"));
    }
    let bytes = read_all(path)?;
    match extension.as_str() {
        "png" => read_png(path, &bytes),
        _ => read_exr_file(path, &bytes),
    }
}

fn read_png(path: &Path, bytes: &[u8]) -> Result<StoredPicture> {
    let broken = |found: Refusal| damaged(path, "a PNG image", format!("a file that {found}"));
    let record = png_record(bytes).map_err(|e| damaged(path, "a PNG image", e.to_string()))?;
    let encoded = Encoded::png(bytes).map_err(broken)?;
    let [width, height] = encoded.size();
    let samples = encoded.decode().map_err(broken)?;
    Ok(StoredPicture {
        width,
        height,
        stored: Stored::Codes(samples.rgba8()),
        record,
    })
}

/// Returns the text of the record's chunk, which stands before the pixels.
fn png_record(bytes: &[u8]) -> std::result::Result<Option<String>, png::DecodingError> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png_limits(bytes));
    decoder.set_ignore_iccp_chunk(true);
    let reader = decoder.read_info()?;
    let chunks = &reader.info().utf8_text;
    let Some(chunk) = chunks.iter().find(|chunk| chunk.keyword == KEYWORD) else {
        return Ok(None);
    };
    let mut chunk = chunk.clone();
    chunk.decompress_text_with_limit(MOST_BYTES)?;
    chunk.get_text().map(Some)
}

fn read_exr_file(path: &Path, bytes: &[u8]) -> Result<StoredPicture> {
    let broken = |e: exr::Error| damaged(path, "an EXR image", e.to_string());
    let reader = block::read(Cursor::new(bytes), false).map_err(broken)?;
    let name = Text::from(KEYWORD);
    let record = reader.headers().iter().find_map(|header| {
        let places = [
            &header.shared_attributes.other,
            &header.own_attributes.other,
        ];
        places
            .into_iter()
            .find_map(|other| match other.get(&name)? {
                AttributeValue::Text(text) => Some(text.to_string()),
                _ => None,
            })
    });
    let has = |header: &::exr::meta::header::Header, name: &str| {
        let name = Text::from(name);
        header.channels.find_index_of_channel(&name).is_some()
    };
    let grey = reader.headers().first();
    let Some(header) = grey.filter(|header| has(header, "Y") && !has(header, "R")) else {
        let image = read_exr(path, bytes)?;
        return Ok(StoredPicture {
            width: image.width,
            height: image.height,
            stored: Stored::Colours(image.pixels),
            record,
        });
    };
    let size = header.layer_size;
    let (width, height) = (size.width(), size.height());
    check_claim(path, bytes.len(), [width, height])?;
    let read = exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("Y")
        .collect_pixels(
            move |_, _| vec![0.0_f32; width * height],
            move |values: &mut Vec<f32>, at, (value,): (f32,)| {
                if let Some(own) = values.get_mut(at.y() * width + at.x()) {
                    *own = value;
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_chunks(reader)
        .map_err(broken)?;
    Ok(StoredPicture {
        width,
        height,
        stored: Stored::Values(read.layer_data.channel_data.pixels),
        record,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ColumnImage, Image};
    use crate::io::picture::column_file::write_column_with;
    use crate::io::picture::image_file::write_image_with;
    use crate::io::{read_image, write_image};

    const RECORD: &str = r#"{"program":"ewa-splat","title":"\u00e4 \"b\""}"#;

    fn image() -> Image {
        Image {
            width: 2,
            height: 1,
            pixels: vec![[0.25, 0.5, 0.125, 0.5], [1.0; 4]],
        }
    }

    #[test]
    fn a_record_is_read_back_and_changes_no_pixel() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr"] {
            let path = folder.path().join(name);
            write_image(&path, &image()).unwrap();
            let (bare, plain) = (read_stored(&path).unwrap(), read_image(&path).unwrap());
            assert_eq!(bare.record, None);
            write_image_with(&path, &image(), Some(RECORD)).unwrap();
            let with = read_stored(&path).unwrap();
            assert_eq!(with.record.as_deref(), Some(RECORD));
            assert_eq!((with.width, with.height), (2, 1));
            assert_eq!(with.stored, bare.stored);
            assert_eq!(read_image(&path).unwrap(), plain);
        }
        // Formats without a place for the record are written as before.
        let path = folder.path().join("a.npy");
        write_image(&path, &image()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        write_image_with(&path, &image(), Some(RECORD)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
        assert!(read_stored(&path).is_err());
    }

    #[test]
    fn columns_are_read_as_values() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let column = ColumnImage {
            width: 3,
            height: 2,
            values: vec![0.0, 1.0, -2.5, f32::NAN, 1e30, 7.0],
            pixel_area: None,
        };
        write_column_with(&path, &column, Some(RECORD)).unwrap();
        let read = read_stored(&path).unwrap();
        assert_eq!(read.record.as_deref(), Some(RECORD));
        let Stored::Values(values) = read.stored else {
            panic!("values")
        };
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&values), bits(&column.values));
    }

    #[test]
    fn damaged_files_end_in_an_error_or_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr"] {
            let path = folder.path().join(name);
            write_image_with(&path, &image(), Some(RECORD)).unwrap();
            let sound = std::fs::read(&path).unwrap();
            for at in 0..sound.len() {
                for damaged in [sound[..at].to_vec(), {
                    let mut bytes = sound.clone();
                    bytes[at] ^= 0x55;
                    bytes
                }] {
                    std::fs::write(&path, damaged).unwrap();
                    let _ = read_stored(&path);
                }
            }
        }
    }
}
