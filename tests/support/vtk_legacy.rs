//! Writes legacy VTK files for the tests of their reader.

use super::{VtkArray, int32, int64};

/// Legacy VTK file under construction.
#[derive(Debug, Clone)]
pub(crate) struct LegacyVtk {
    pub(crate) version: &'static str,
    pub(crate) binary: bool,
    crlf: bool,
    pub(crate) file: Vec<u8>,
}

impl LegacyVtk {
    /// Returns the first lines of a file in every version, encoding and kind of line end.
    pub(crate) fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for version in ["1.0", "2.0", "3.0", "4.2", "5.1"] {
            for (binary, crlf) in [(false, false), (false, true), (true, false), (true, true)] {
                all.push(Self::new(version, binary, crlf));
            }
        }
        all
    }

    pub(crate) fn new(version: &'static str, binary: bool, crlf: bool) -> Self {
        let mut this = Self {
            version,
            binary,
            crlf,
            file: Vec::new(),
        };
        this.line(&format!("# vtk DataFile Version {version}"));
        this.line("a title, BINARY or not");
        this.line(if binary { "BINARY" } else { "ASCII" });
        this
    }

    pub(crate) fn line(&mut self, text: &str) {
        self.file.extend(text.as_bytes());
        self.file
            .extend(if self.crlf { &b"\r\n"[..] } else { b"\n" });
    }

    /// Adds lines of the text, whose line ends are LF.
    pub(crate) fn lines(&mut self, text: &str) {
        for line in text.lines() {
            self.line(line);
        }
    }

    /// Adds the numbers of an array, from the next line on.
    pub(crate) fn numbers(&mut self, array: &VtkArray) {
        if self.binary {
            let mut bytes = array.bytes.clone();
            bytes.chunks_mut(array.size).for_each(<[u8]>::reverse);
            self.file.extend(bytes);
        } else {
            // The lines hold seven numbers, unlike any array's rows.
            let words: Vec<&str> = array.text.split_ascii_whitespace().collect();
            for line in words.chunks(7) {
                self.line(&line.join(" "));
            }
        }
        self.line("");
    }

    /// Adds a heading with the array's type after it, and its numbers.
    pub(crate) fn array(&mut self, heading: &str, array: &VtkArray) {
        self.line(&format!("{heading} {}", type_name(array)));
        self.numbers(array);
    }

    /// Adds a `FIELD` of arrays.
    pub(crate) fn field(&mut self, arrays: &[VtkArray]) {
        self.line(&format!("FIELD FieldData {}", arrays.len()));
        for array in arrays {
            let tuples = array.bytes.len() / array.size / array.components;
            let heading = format!("{} {} {tuples}", array.name, array.components);
            self.array(&heading, array);
        }
    }

    /// Adds a list of cells, in the style of the version.
    pub(crate) fn cells(&mut self, keyword: &str, cells: &[&[i32]]) {
        let nodes = cells.concat();
        let count = cells.len();
        if self.version.starts_with('5') {
            let mut offsets = vec![0];
            for cell in cells {
                offsets.push(offsets[offsets.len() - 1] + cell.len() as i64);
            }
            self.line(&format!("{keyword} {} {}", count + 1, nodes.len()));
            self.line("OFFSETS vtktypeint64");
            self.numbers(&int64("", 1, &offsets));
            self.line("CONNECTIVITY vtktypeint64");
            let nodes: Vec<i64> = nodes.iter().map(|&n| i64::from(n)).collect();
            self.numbers(&int64("", 1, &nodes));
        } else {
            let stream: Vec<i32> = cells
                .iter()
                .flat_map(|cell| [&[cell.len() as i32], *cell].concat())
                .collect();
            self.line(&format!("{keyword} {count} {}", stream.len()));
            self.numbers(&int32("", 1, &stream));
        }
    }

    /// Adds the texts of an array of strings, from the next line on.
    pub(crate) fn texts(&mut self, texts: &[&str]) {
        for text in texts {
            if self.binary {
                self.file.push(0xc0 | text.len() as u8);
                self.file.extend(text.as_bytes());
            } else {
                self.line(&text.replace(' ', "%20").replace('\n', "%0A"));
            }
        }
        self.line("");
    }
}

/// Returns the name of an array's type in legacy files.
pub(crate) fn type_name(array: &VtkArray) -> &'static str {
    match array.kind {
        "Int8" => "char",
        "UInt8" => "unsigned_char",
        "Int16" => "short",
        "UInt16" => "unsigned_short",
        "Int32" => "int",
        "UInt32" => "unsigned_int",
        "Int64" => "vtktypeint64",
        "UInt64" => "vtktypeuint64",
        "Float32" => "float",
        _ => "double",
    }
}
