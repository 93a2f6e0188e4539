//! Parses the frame that all VTK XML formats share: the file's XML and its appended bytes.
//!
//! ```text
//! <VTKFile type="ImageData" byte_order="LittleEndian" header_type="UInt64"
//!          compressor="vtkZLibDataCompressor">
//!   ... <DataArray type="Float32" Name="T" NumberOfComponents="1" format="appended" offset="0"/>
//!   <AppendedData encoding="raw">_...</AppendedData>
//! </VTKFile>
//! ```
//!
//! Raw appended data are not XML: the file is cut there before the rest is parsed. [`super::array`] decodes
//! the arrays.

use std::borrow::Cow;
use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result};

/// Most elements of a file: far more than any writer makes, far fewer than fill the memory.
const MOST_ELEMENTS: u32 = 1 << 20;

/// Whether a file that begins with `head` is a VTK XML file.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    find(head, b"<VTKFile").is_some()
        && head
            .strip_prefix(b"\xef\xbb\xbf")
            .unwrap_or(head)
            .trim_ascii_start()
            .starts_with(b"<")
}

/// The `type` of the file that begins with `head`, if its first tag has one.
pub(crate) fn file_type(head: &[u8]) -> Option<&str> {
    let tag = &head[find(head, b"<VTKFile")?..];
    let tag = std::str::from_utf8(&tag[..find(tag, b">")?]).ok()?;
    let is_own = |at: &usize| tag[..*at].ends_with(|c: char| c.is_ascii_whitespace());
    let at = tag.match_indices("type").map(|(at, _)| at).find(is_own)?;
    let quoted = tag[at + 4..].trim_start().strip_prefix('=')?.trim_start();
    let quote = quoted.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    Some(quoted[1..].split_once(quote)?.0)
}

/// The first place of `needle` in `haystack`.
pub(in crate::io) fn find(haystack: &[u8], needle: &[u8]) -> Option<usize> {
    let first = *needle.first()?;
    let mut at = 0;
    loop {
        at += haystack.get(at..)?.iter().position(|&b| b == first)?;
        if haystack[at..].starts_with(needle) {
            return Some(at);
        }
        at += 1;
    }
}

fn find_last(haystack: &[u8], needle: &[u8]) -> Option<usize> {
    (0..haystack.len())
        .rev()
        .find(|&at| haystack[at..].starts_with(needle))
}

/// A file cut into its XML and its appended data.
#[derive(Debug)]
pub(crate) struct Frame<'a> {
    pub(in crate::io) path: &'a Path,
    xml: Cow<'a, str>,
    /// The bytes after the `_`.
    pub(in crate::io) appended: Option<&'a [u8]>,
    /// Offset of the appended bytes in the file; 0 if there are none.
    pub(in crate::io) start: usize,
    /// Length of the file in bytes.
    pub(in crate::io) len: usize,
}

impl<'a> Frame<'a> {
    /// Cuts a file at its appended data.
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let not_text = |_| {
            Error::format(
                path,
                "XML",
                "UTF-8 text",
                "other bytes",
                "save the file again",
            )
        };
        let whole = |xml| Self {
            path,
            xml,
            appended: None,
            start: 0,
            len: bytes.len(),
        };
        let all = || {
            std::str::from_utf8(bytes)
                .map(Cow::Borrowed)
                .map_err(not_text)
        };
        let Some(tag) = find(bytes, b"<AppendedData") else {
            return all().map(whole);
        };
        let cut = || {
            Error::format(
                path,
                "AppendedData",
                "`_` and the data",
                "none",
                "the file is cut off: copy or save it again",
            )
        };
        let tag_end = tag + find(&bytes[tag..], b">").ok_or_else(cut)? + 1;
        if bytes[..tag_end].ends_with(b"/>") {
            return all().map(whole);
        }
        let after = &bytes[tag_end..];
        let underscore = after.iter().position(|b| !b.is_ascii_whitespace());
        let start = underscore.filter(|&at| after[at] == b'_').ok_or_else(cut)? + 1;
        let data = &after[start..];
        let end = find_last(data, b"</AppendedData").unwrap_or(data.len());
        let mut xml = std::str::from_utf8(&bytes[..tag_end])
            .map_err(not_text)?
            .to_owned();
        xml.push_str("</AppendedData></VTKFile>");
        Ok(Self {
            path,
            xml: Cow::Owned(xml),
            appended: Some(&data[..end]),
            start: tag_end + start,
            len: bytes.len(),
        })
    }

    /// Cuts the first bytes of a file, without the appended data; `None` if these do not begin in `head`.
    pub(in crate::io) fn of_head(path: &'a Path, head: &'a [u8]) -> Option<Self> {
        let frame = Self::new(path, head).ok();
        frame.filter(|frame| frame.appended.is_some())
    }

    /// Parses the XML.
    pub(crate) fn document(&self) -> Result<Document<'_>> {
        if u32::try_from(self.xml.len()).is_err() {
            return Err(Error::format(
                self.path,
                "XML",
                "less than 4 GiB of text",
                format!("{} bytes", self.xml.len()),
                "save the file with appended binary data",
            ));
        }
        let options = ParsingOptions {
            nodes_limit: MOST_ELEMENTS,
            ..ParsingOptions::default()
        };
        Document::parse_with_options(&self.xml, options).map_err(|e| {
            Error::format(
                self.path,
                "XML",
                "well-formed XML",
                e.to_string(),
                "save the file again",
            )
        })
    }
}

/// The first child element with a name.
pub(crate) fn child<'d, 'i>(node: Node<'d, 'i>, name: &str) -> Option<Node<'d, 'i>> {
    node.children().find(|n| n.has_tag_name(name))
}

/// The first child that has one of these names.
pub(in crate::io) fn child_among<'d, 'i>(
    node: Node<'d, 'i>,
    names: &[&str],
) -> Option<Node<'d, 'i>> {
    let is_among = |n: &Node<'_, '_>| names.iter().any(|name| n.has_tag_name(*name));
    node.children().find(is_among)
}

/// The `N` numbers of an attribute; `default` if it is missing.
pub(crate) fn numbers<const N: usize, T: std::str::FromStr + Copy>(
    path: &Path,
    node: Node<'_, '_>,
    name: &str,
    default: Option<[T; N]>,
) -> Result<[T; N]> {
    let text = node.attribute(name);
    if let (None, Some(default)) = (text, default) {
        return Ok(default);
    }
    let text = text.unwrap_or("");
    let parsed: Option<Vec<T>> = text
        .split_ascii_whitespace()
        .map(|w| w.parse().ok())
        .collect();
    parsed.and_then(|n| n.try_into().ok()).ok_or_else(|| {
        Error::format(
            path,
            format!("{}, `{name}`", node.tag_name().name()),
            format!("{N} numbers"),
            format!("`{}`", clip(text)),
            "correct the attribute",
        )
    })
}

/// A text short enough for a message.
pub(crate) fn clip(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_type_is_found_in_the_first_tag() {
        for (head, kind) in [
            (
                "<VTKFile type=\"PolyData\" version=\"1.0\">",
                Some("PolyData"),
            ),
            (
                "<?xml version=\"1.0\"?>\n<VTKFile byte_order='a' type = 'Table'>",
                Some("Table"),
            ),
            ("<VTKFile version=\"1.0\"><a type=\"b\"/>", None),
            (
                "<VTKFile header_type=\"UInt64\" type=\"Table\">",
                Some("Table"),
            ),
            ("<VTKFile type=\"Table", None),
            ("<VTKFile type=>", None),
        ] {
            assert_eq!(file_type(head.as_bytes()), kind, "{head}");
        }
    }
}
