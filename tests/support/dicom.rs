//! Writes DICOM files, element by element.

/// Layout of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    Explicit,
    Implicit,
    BigEndian,
}

pub(crate) const EXPLICIT: &str = "1.2.840.10008.1.2.1";

/// Data set under construction.
#[derive(Debug, Clone)]
pub(crate) struct Dicom {
    pub(crate) coding: Coding,
    pub(crate) bytes: Vec<u8>,
}

impl Dicom {
    pub(crate) fn new(coding: Coding) -> Self {
        let bytes = Vec::new();
        Self { coding, bytes }
    }

    fn number<const N: usize>(&mut self, mut le: [u8; N]) {
        if self.coding == Coding::BigEndian {
            le.reverse();
        }
        self.bytes.extend(le);
    }

    fn tag(&mut self, tag: u32) {
        self.number(((tag >> 16) as u16).to_le_bytes());
        self.number((tag as u16).to_le_bytes());
    }

    fn header(&mut self, tag: u32, vr: &str, len: u32) {
        self.tag(tag);
        let is_item = tag >> 16 == 0xfffe;
        if self.coding == Coding::Implicit || is_item {
            self.number(len.to_le_bytes());
            return;
        }
        self.bytes.extend(vr.as_bytes());
        if matches!(vr, "OB" | "OW" | "SQ" | "UN") {
            self.bytes.extend([0; 2]);
            self.number(len.to_le_bytes());
        } else {
            self.number((len as u16).to_le_bytes());
        }
    }

    pub(crate) fn raw(mut self, tag: u32, vr: &str, value: &[u8]) -> Self {
        self.header(tag, vr, value.len() as u32);
        self.bytes.extend(value);
        self
    }

    pub(crate) fn text(self, tag: u32, vr: &str, text: &str) -> Self {
        let mut value = text.as_bytes().to_vec();
        if value.len() % 2 == 1 {
            value.push(if vr == "UI" { 0 } else { b' ' });
        }
        self.raw(tag, vr, &value)
    }

    pub(crate) fn short(mut self, tag: u32, number: u16) -> Self {
        self.header(tag, "US", 2);
        self.number(number.to_le_bytes());
        self
    }

    /// Adds a sequence of these items, with lengths or with delimiters.
    pub(crate) fn sequence(mut self, tag: u32, items: &[Self], has_lengths: bool) -> Self {
        if has_lengths {
            let len: usize = items.iter().map(|item| 8 + item.bytes.len()).sum();
            self.header(tag, "SQ", len as u32);
        } else {
            self.header(tag, "SQ", u32::MAX);
        }
        for item in items {
            let len = item.bytes.len() as u32;
            self.header(0xfffe_e000, "", if has_lengths { len } else { u32::MAX });
            self.bytes.extend(&item.bytes);
            if !has_lengths {
                self.header(0xfffe_e00d, "", 0);
            }
        }
        if !has_lengths {
            self.header(0xfffe_e0dd, "", 0);
        }
        self
    }

    /// Adds compressed pixels: an empty offset table, then the fragments.
    pub(crate) fn packed(mut self, fragments: &[&[u8]]) -> Self {
        self.header(0x7fe0_0010, "OB", u32::MAX);
        self.header(0xfffe_e000, "", 0);
        for fragment in fragments {
            self.header(0xfffe_e000, "", fragment.len() as u32);
            self.bytes.extend(*fragment);
        }
        self.header(0xfffe_e0dd, "", 0);
        self
    }

    /// Returns the file, with the preamble and the first group.
    pub(crate) fn file(&self, syntax: &str) -> Vec<u8> {
        let meta = Self::new(Coding::Explicit).text(0x0002_0010, "UI", syntax);
        [&[0; 128], &b"DICM"[..], &meta.bytes, &self.bytes].concat()
    }
}

/// Slice of two columns and two rows.
#[derive(Debug, Clone)]
pub(crate) struct Slice {
    pub(crate) coding: Coding,
    pub(crate) series: &'static str,
    pub(crate) number: usize,
    pub(crate) position: &'static str,
    pub(crate) axes: &'static str,
    pub(crate) bits: [u16; 3],
    pub(crate) signed: bool,
    /// Elements after those of the bits, before the pixels.
    pub(crate) more: Vec<(u32, &'static str, &'static str)>,
    pub(crate) padding: Option<u16>,
    pub(crate) words: [u16; 4],
}

impl Default for Slice {
    fn default() -> Self {
        Self {
            coding: Coding::Explicit,
            series: "1.2.3",
            number: 1,
            position: "0\\0\\0",
            axes: "1\\0\\0\\0\\1\\0",
            bits: [16, 16, 15],
            signed: false,
            more: Vec::new(),
            padding: None,
            words: [1, 2, 3, 4],
        }
    }
}

impl Slice {
    /// Returns all elements but the pixels.
    pub(crate) fn header(&self) -> Dicom {
        let [allocated, stored, high] = self.bits;
        let mut set = Dicom::new(self.coding)
            .text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.4")
            .text(0x0020_000e, "UI", self.series)
            .text(0x0020_0013, "IS", &self.number.to_string())
            .text(0x0020_0032, "DS", self.position)
            .text(0x0020_0037, "DS", self.axes)
            .short(0x0028_0002, 1)
            .text(0x0028_0004, "CS", "MONOCHROME2")
            .short(0x0028_0010, 2)
            .short(0x0028_0011, 2)
            .text(0x0028_0030, "DS", "0.5\\0.25")
            .short(0x0028_0100, allocated)
            .short(0x0028_0101, stored)
            .short(0x0028_0102, high)
            .short(0x0028_0103, self.signed.into());
        if let Some(padding) = self.padding {
            set = set.short(0x0028_0120, padding);
        }
        for (tag, vr, text) in &self.more {
            set = set.text(*tag, vr, text);
        }
        set
    }

    pub(crate) fn file(&self) -> Vec<u8> {
        let words = self.words.map(|word| match self.coding {
            Coding::BigEndian => word.to_be_bytes(),
            _ => word.to_le_bytes(),
        });
        let syntax = match self.coding {
            Coding::Explicit => EXPLICIT,
            Coding::Implicit => "1.2.840.10008.1.2",
            Coding::BigEndian => "1.2.840.10008.1.2.2",
        };
        let set = self.header().raw(0x7fe0_0010, "OW", &words.concat());
        set.file(syntax)
    }
}
