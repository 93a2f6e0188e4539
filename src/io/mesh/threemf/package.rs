//! Opens the archive and the files in it.

use std::path::Path;

use roxmltree::{Document, ParsingOptions};

use crate::error::{Error, Result};
use crate::io::bytes::zip::{self, Entry};
use crate::io::vtk::xml::clip;

/// Advice for an archive that breaks the rules.
pub(super) const DAMAGED: &str =
    "the file is damaged or breaks the format's rules: save the mesh again";

/// Greatest ratio of unpacked bytes to the archive's bytes, and the number of bytes allowed for any archive:
/// text of numbers is compressed to a fifth or a tenth.
const MOST_RATIO: u64 = 32;
const ALWAYS: u64 = 4 << 20;

/// The archive's list of relations, and the default model.
const RELATIONS: &str = "_rels/.rels";
const MODEL: &str = "3D/3dmodel.model";

/// An archive.
pub(super) struct Package<'a> {
    pub(super) path: &'a Path,
    entries: Vec<Entry<'a>>,
    /// Number of bytes that may still be unpacked.
    left: u64,
}

impl<'a> Package<'a> {
    pub(super) fn of(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let entries = zip::entries(bytes).map_err(|found| {
            let expected = "a sound 3MF archive";
            Error::format(path, "ZIP archive", expected, found, DAMAGED)
        })?;
        let left = ALWAYS.saturating_add((bytes.len() as u64).saturating_mul(MOST_RATIO));
        Ok(Self {
            path,
            entries,
            left,
        })
    }

    pub(super) fn fault(&self, place: &str, expected: &str, found: String) -> Error {
        Error::format(self.path, clip(place), expected, found, DAMAGED)
    }

    /// The name of the main model: the one in the archive's list of relations, or else the default.
    pub(super) fn first_model(&mut self) -> Result<String> {
        if !self.entries.iter().any(|entry| entry.name == RELATIONS) {
            return Ok(MODEL.to_owned());
        }
        let text = self.text(RELATIONS)?;
        let document = self.document(RELATIONS, &text)?;
        let is_model = |kind: &str| kind.ends_with("/3dmodel");
        let mut relations = document.descendants();
        let found = relations.find(|node| node.attribute("Type").is_some_and(is_model));
        let target = found.and_then(|node| node.attribute("Target"));
        Ok(name_of(target.unwrap_or(MODEL)).to_owned())
    }

    /// The bytes of a file.
    pub(super) fn bytes(&mut self, name: &str) -> Result<Vec<u8>> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        let Some(entry) = entry else {
            let expected = "a file that the archive names";
            return Err(self.fault(name, expected, "none of this name".into()));
        };
        let Some(left) = self.left.checked_sub(entry.size) else {
            let expected = format!("{} bytes unpacked at most", self.left);
            return Err(self.fault(name, &expected, format!("{} bytes", entry.size)));
        };
        let bytes = entry.unpack();
        self.left = left;
        bytes.map_err(|found| self.fault(name, "a sound file", found))
    }

    pub(super) fn text(&mut self, name: &str) -> Result<String> {
        String::from_utf8(self.bytes(name)?)
            .map_err(|_| self.fault(name, "UTF-8 text", "other bytes".into()))
    }

    pub(super) fn document<'t>(&self, name: &str, text: &'t str) -> Result<Document<'t>> {
        let text = text.trim_start_matches('\u{feff}');
        // An element has at least some bytes; this bounds the memory for elements.
        let nodes_limit = u32::try_from(text.len() / 8 + 4096).unwrap_or(u32::MAX);
        let options = ParsingOptions {
            nodes_limit,
            ..ParsingOptions::default()
        };
        Document::parse_with_options(text, options)
            .map_err(|e| self.fault(name, "well-formed XML", e.to_string()))
    }
}

/// The name of an archive's file in its directory: names in models begin with a slash.
pub(super) fn name_of(stated: &str) -> &str {
    stated.trim_start_matches('/')
}
