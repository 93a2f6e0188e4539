//! Provides the facts by which formats are recognised.

use std::borrow::Cow;
use std::cell::OnceCell;

use super::file::Input;
use super::zip;
use crate::io::options::OpenOptions;

/// A file before it is read: its name, length, first bytes and options.
pub(in crate::io) struct Probe<'a> {
    pub(in crate::io) input: Input<'a>,
    /// Its first bytes.
    pub(in crate::io) head: &'a [u8],
    /// Its length in bytes.
    pub(in crate::io) len: u64,
    pub(in crate::io) options: &'a OpenOptions,
    /// All its bytes, once a format has needed them; empty if they cannot be read.
    bytes: OnceCell<Cow<'a, [u8]>>,
}

impl<'a> Probe<'a> {
    pub(in crate::io) fn new(
        input: Input<'a>,
        head: &'a [u8],
        len: u64,
        options: &'a OpenOptions,
    ) -> Self {
        Self {
            input,
            head,
            len,
            options,
            bytes: OnceCell::new(),
        }
    }

    /// Whether the name ends in a dot and one of these, in upper or lower case.
    pub(in crate::io) fn ends_in(&self, endings: &[&str]) -> bool {
        let name = self.input.path.file_name().unwrap_or_default();
        let name = name.to_string_lossy().to_ascii_lowercase();
        endings.iter().any(|ending| {
            let rest = name.strip_suffix(ending);
            rest.is_some_and(|rest| rest.ends_with('.'))
        })
    }

    /// Whether the file is a ZIP archive with the format's extension or content.
    pub(in crate::io) fn is_archive(
        &self,
        ending: &str,
        holds: fn(&[zip::Entry<'_>]) -> bool,
    ) -> bool {
        let looked_at = || {
            let bytes = || self.input.read_all().unwrap_or_default();
            zip::entries(self.bytes.get_or_init(bytes)).is_ok_and(|entries| holds(&entries))
        };
        // Archives of arrays may be large, and are recognised by name.
        let is_archive = self.head.starts_with(zip::MAGIC) && !self.ends_in(&["npz"]);
        is_archive && (self.ends_in(&[ending]) || looked_at())
    }

    /// Whether the first bytes are text.
    pub(in crate::io) fn is_text(&self) -> bool {
        let is_control = |b: &u8| *b < 0x20 && !b.is_ascii_whitespace();
        !self.head.iter().any(is_control)
    }
}
