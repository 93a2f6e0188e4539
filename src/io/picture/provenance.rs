//! Keeps the record of how a picture was made in the picture's file.
//!
//! | extension | place of the record |
//! |---|---|
//! | `.png` | an iTXt chunk with the keyword `ewa-splat`, not compressed |
//! | `.exr` | a string attribute named `ewa-splat` |
//!
//! The record is one line of JSON in ASCII. Other formats have no place for it.

use ::exr::prelude::{AttributeValue, Text};

/// Keyword of the record in PNG files, and name of the attribute in EXR files.
pub(super) const KEYWORD: &str = "ewa-splat";

/// Returns the attribute of an EXR file that holds a record.
pub(super) fn exr_attribute(record: Option<&str>) -> Option<(Text, AttributeValue)> {
    let text = Text::new_or_none(record?)?;
    Some((Text::from(KEYWORD), AttributeValue::Text(text)))
}
