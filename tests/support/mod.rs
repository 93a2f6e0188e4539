//! Writes small files in every format for the tests of the readers.

#![allow(dead_code, reason = "each test program uses a part of it")]

pub(crate) mod amr;
pub(crate) mod damage;
pub(crate) mod dicom;
pub(crate) mod gadget;
pub(crate) mod images;
pub(crate) mod meshes;
pub(crate) mod nifti;
pub(crate) mod openfoam;
pub(crate) mod seeds;
pub(crate) mod sog;
pub(crate) mod splats;
pub(crate) mod tecplot;
pub(crate) mod threemf;
pub(crate) mod vtk_legacy;

use std::io::Write;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{CellMesh, Dataset, Geometry, OpenOptions, ParticleType, open};

/// Returns the numbers of a field.
pub(crate) fn numbers(data: &Dataset, selector: &str) -> Vec<f32> {
    let (_, values) = data.scalar(selector).unwrap();
    (0..values.len()).map(|i| values.get(i)).collect()
}

/// Returns the cells of a grid of cells.
pub(crate) fn cells(data: &Dataset) -> &CellMesh {
    match &data.geometry {
        Geometry::Cells(mesh) => mesh,
        other => panic!("cells expected, not {other:?}"),
    }
}

/// Opens a file at a time step.
pub(crate) fn at_step(path: &Path, time_step: Option<usize>) -> Dataset {
    let options = OpenOptions {
        time_step,
        ..OpenOptions::default()
    };
    open(path, &options).unwrap()
}

/// Returns options that read one type of a snapshot's particles.
pub(crate) fn of_type(wanted: ParticleType) -> OpenOptions {
    OpenOptions {
        particle_type: Some(wanted),
        ..OpenOptions::default()
    }
}

/// Folder for the files of one test.
pub(crate) struct Folder(pub(crate) tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub(crate) fn open(&self, name: &str, bytes: &[u8]) -> Dataset {
        open(&self.file(name, bytes), &OpenOptions::default()).unwrap()
    }

    /// Returns the text of the error that reading the file gives.
    pub(crate) fn refuse(&self, name: &str, bytes: &[u8]) -> String {
        let path = self.file(name, bytes);
        open(&path, &OpenOptions::default())
            .unwrap_err()
            .to_string()
    }
}

/// Storage of a VTK array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Text.
    Ascii,
    /// Base64 in the element.
    Binary,
    /// Base64 after the XML.
    AppendedBase64,
    /// Bytes after the XML.
    AppendedRaw,
}

/// Compression of a VTK file's arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Zlib,
    Lz4,
    Lzma,
}

/// Storage of a VTK file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VtkEncoding {
    pub(crate) format: Format,
    pub(crate) wide_header: bool,
    pub(crate) compression: Compression,
    pub(crate) big_endian: bool,
}

impl VtkEncoding {
    /// Returns every combination.
    pub(crate) fn all() -> Vec<Self> {
        use Format::{AppendedBase64, AppendedRaw, Ascii, Binary};
        let mut all = Vec::new();
        for format in [Ascii, Binary, AppendedBase64, AppendedRaw] {
            for compression in [
                Compression::None,
                Compression::Zlib,
                Compression::Lz4,
                Compression::Lzma,
            ] {
                for bits in 0..4 {
                    let [wide_header, big_endian] = [1, 2].map(|bit| bits & bit != 0);
                    all.push(Self {
                        format,
                        wide_header,
                        compression,
                        big_endian,
                    });
                }
            }
        }
        all
    }

    /// Raw bytes after the XML, not compressed.
    pub(crate) const RAW: Self = Self {
        format: Format::AppendedRaw,
        wide_header: false,
        compression: Compression::None,
        big_endian: false,
    };

    /// Text.
    pub(crate) const TEXT: Self = Self {
        format: Format::Ascii,
        ..Self::RAW
    };

    fn word(self, n: usize) -> Vec<u8> {
        let mut bytes = (n as u64).to_le_bytes()[..if self.wide_header { 8 } else { 4 }].to_vec();
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    /// Returns the header and data of one array, as VTK's writers lay them out.
    fn parts(self, bytes: &[u8]) -> Vec<Vec<u8>> {
        /// Block size, small so that arrays have several blocks.
        const BLOCK: usize = 24;
        if self.compression == Compression::None {
            return vec![[self.word(bytes.len()), bytes.to_vec()].concat()];
        }
        let compress = match self.compression {
            Compression::Lz4 => lz4_flex::block::compress,
            Compression::Lzma => xz,
            _ => zlib,
        };
        let blocks: Vec<Vec<u8>> = bytes.chunks(BLOCK).map(compress).collect();
        let mut header = self.word(blocks.len());
        header.extend(self.word(BLOCK));
        header.extend(self.word(bytes.len() % BLOCK));
        for block in &blocks {
            header.extend(self.word(block.len()));
        }
        vec![header, blocks.concat()]
    }

    fn base64(self, bytes: &[u8]) -> String {
        self.parts(bytes)
            .iter()
            .map(|part| STANDARD.encode(part))
            .collect()
    }
}

pub(crate) fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Compresses bytes by gzip.
pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Compresses bytes to an .xz stream, with the check that VTK's writer uses.
pub(crate) fn xz(bytes: &[u8]) -> Vec<u8> {
    let mut options = lzma_rust2::XzOptions::with_preset(0);
    options.lzma_options.dict_size = 4096;
    options.set_check_sum_type(lzma_rust2::CheckType::Crc32);
    let mut encoder = lzma_rust2::XzWriter::new(Vec::new(), options).unwrap();
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Array of a VTK file: its numbers as little-endian bytes and as text.
#[derive(Debug, Clone)]
pub(crate) struct VtkArray {
    pub(crate) kind: &'static str,
    pub(crate) name: &'static str,
    pub(crate) components: usize,
    pub(crate) size: usize,
    pub(crate) bytes: Vec<u8>,
    pub(crate) text: String,
}

macro_rules! vtk_array {
    ($function:ident, $t:ty, $kind:literal) => {
        /// Makes an array of this type.
        pub(crate) fn $function(name: &'static str, components: usize, numbers: &[$t]) -> VtkArray {
            VtkArray {
                kind: $kind,
                name,
                components,
                size: size_of::<$t>(),
                bytes: numbers.iter().flat_map(|n| n.to_le_bytes()).collect(),
                text: numbers.iter().map(|n| format!("{n} ")).collect(),
            }
        }
    };
}
vtk_array!(int8, i8, "Int8");
vtk_array!(uint8, u8, "UInt8");
vtk_array!(int16, i16, "Int16");
vtk_array!(uint16, u16, "UInt16");
vtk_array!(int32, i32, "Int32");
vtk_array!(uint32, u32, "UInt32");
vtk_array!(int64, i64, "Int64");
vtk_array!(uint64, u64, "UInt64");
vtk_array!(float32, f32, "Float32");
vtk_array!(float64, f64, "Float64");

/// Piece of a VTK image.
#[derive(Debug, Clone)]
pub(crate) struct VtkPiece {
    pub(crate) extent: &'static str,
    pub(crate) point_data: Vec<VtkArray>,
    pub(crate) cell_data: Vec<VtkArray>,
}

/// Writes a VTK image file. `attributes` are those of the `ImageData` element.
pub(crate) fn vti(encoding: VtkEncoding, attributes: &str, pieces: &[VtkPiece]) -> Vec<u8> {
    let piece = |piece: &VtkPiece| XmlPiece {
        attributes: format!("Extent=\"{}\"", piece.extent),
        elements: vec![
            ("PointData", piece.point_data.clone()),
            ("CellData", piece.cell_data.clone()),
        ],
    };
    let pieces: Vec<_> = pieces.iter().map(piece).collect();
    vtk_xml(encoding, "ImageData", attributes, &pieces)
}

/// Piece of any VTK XML file: its attributes, and its elements with their arrays.
#[derive(Debug, Clone)]
pub(crate) struct XmlPiece {
    pub(crate) attributes: String,
    pub(crate) elements: Vec<(&'static str, Vec<VtkArray>)>,
}

/// Writes a VTK XML file of type `kind`. `attributes` are those of the element of that name.
pub(crate) fn vtk_xml(
    encoding: VtkEncoding,
    kind: &str,
    attributes: &str,
    pieces: &[XmlPiece],
) -> Vec<u8> {
    let mut appended = Vec::new();
    let mut element = |array: &VtkArray| {
        let mut bytes = array.bytes.clone();
        if encoding.big_endian {
            bytes.chunks_mut(array.size).for_each(<[u8]>::reverse);
        }
        let VtkArray {
            kind,
            name,
            components,
            ..
        } = array;
        let head = format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\""
        );
        let offset = appended.len();
        match encoding.format {
            Format::Ascii => format!("{head} format=\"ascii\">\n{}</DataArray>\n", array.text),
            Format::Binary => {
                let text = encoding.base64(&bytes);
                format!("{head} format=\"binary\">\n  {text}\n</DataArray>\n")
            }
            Format::AppendedBase64 => {
                appended.extend(encoding.base64(&bytes).into_bytes());
                format!("{head} format=\"appended\" offset=\"{offset}\"/>\n")
            }
            Format::AppendedRaw => {
                appended.extend(encoding.parts(&bytes).concat());
                format!("{head} format=\"appended\" offset=\"{offset}\"/>\n")
            }
        }
    };
    let mut body = String::new();
    for piece in pieces {
        body += &format!("<Piece {}>", piece.attributes);
        for (name, arrays) in &piece.elements {
            let arrays: String = arrays.iter().map(&mut element).collect();
            body += &format!("<{name}>{arrays}</{name}>");
        }
        body += "</Piece>\n";
    }
    let order = if encoding.big_endian {
        "BigEndian"
    } else {
        "LittleEndian"
    };
    let header = if encoding.wide_header {
        " header_type=\"UInt64\""
    } else {
        ""
    };
    let compressor = match encoding.compression {
        Compression::None => "",
        Compression::Zlib => " compressor=\"vtkZLibDataCompressor\"",
        Compression::Lz4 => " compressor=\"vtkLZ4DataCompressor\"",
        Compression::Lzma => " compressor=\"vtkLZMADataCompressor\"",
    };
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"{kind}\" version=\"1.0\" \
         byte_order=\"{order}\"{header}{compressor}>\n<{kind} {attributes}>\n{body}</{kind}>\n"
    )
    .into_bytes();
    let appended_kind = match encoding.format {
        Format::AppendedBase64 => Some("base64"),
        Format::AppendedRaw => Some("raw"),
        _ => None,
    };
    if let Some(kind) = appended_kind {
        file.extend(format!("<AppendedData encoding=\"{kind}\">\n  _").into_bytes());
        file.extend(appended);
        file.extend(b"\n</AppendedData>\n");
    }
    file.extend(b"</VTKFile>\n");
    file
}

/// Storage of a PLOT3D file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plot3dEncoding {
    /// True for text; the next three fields are unused then.
    pub(crate) text: bool,
    pub(crate) double: bool,
    pub(crate) big_endian: bool,
    pub(crate) records: bool,
    pub(crate) grid_count: bool,
}

/// Grid of a PLOT3D file, its solution or its functions.
#[derive(Debug, Clone)]
pub(crate) struct Plot3dBlock {
    pub(crate) dims: [i32; 3],
    /// All x, all y, all z; the five variables; or its functions.
    pub(crate) numbers: Vec<f64>,
    pub(crate) iblank: Vec<i32>,
}

impl Plot3dEncoding {
    /// Returns every combination.
    pub(crate) fn all() -> Vec<Self> {
        let of_bits = |bits: u32| {
            let [double, big_endian, records, grid_count, text] =
                [1, 2, 4, 8, 16].map(|bit| bits & bit != 0);
            Self {
                text,
                double,
                big_endian,
                records,
                grid_count,
            }
        };
        (0..16).chain([16, 24]).map(of_bits).collect()
    }

    pub(crate) fn word(self, n: i32) -> Vec<u8> {
        match (self.text, self.big_endian) {
            (true, _) => format!("  {n}\n").into_bytes(),
            (_, true) => n.to_be_bytes().to_vec(),
            (_, false) => n.to_le_bytes().to_vec(),
        }
    }

    pub(crate) fn words(self, words: &[i32]) -> Vec<u8> {
        words.iter().flat_map(|&n| self.word(n)).collect()
    }

    pub(crate) fn reals(self, reals: &[f64]) -> Vec<u8> {
        let one = |&x: &f64| match (self.text, self.double, self.big_endian) {
            (true, ..) => format!(" {x:.9e}").into_bytes(),
            (_, true, true) => x.to_be_bytes().to_vec(),
            (_, true, false) => x.to_le_bytes().to_vec(),
            (_, false, true) => (x as f32).to_be_bytes().to_vec(),
            (_, false, false) => (x as f32).to_le_bytes().to_vec(),
        };
        reals.iter().flat_map(one).collect()
    }

    pub(crate) fn file(self, records: &[Vec<u8>]) -> Vec<u8> {
        let marked = self.records && !self.text;
        let mut file = Vec::new();
        for record in records {
            let mark = self.word(i32::try_from(record.len()).unwrap());
            if marked {
                file.extend(&mark);
            }
            file.extend(record);
            if marked {
                file.extend(&mark);
            }
        }
        file
    }

    fn header(self, blocks: &[Plot3dBlock]) -> Vec<Vec<u8>> {
        assert!(self.grid_count || blocks.len() == 1);
        let dims: Vec<i32> = blocks.iter().flat_map(|b| b.dims).collect();
        let count = self.word(i32::try_from(blocks.len()).unwrap());
        let mut records = vec![count, self.words(&dims)];
        if !self.grid_count {
            records.remove(0);
        }
        records
    }

    /// Writes a grid file.
    pub(crate) fn grids(self, blocks: &[Plot3dBlock]) -> Vec<u8> {
        let mut records = self.header(blocks);
        for block in blocks {
            records.push([self.reals(&block.numbers), self.words(&block.iblank)].concat());
        }
        self.file(&records)
    }

    /// Writes a solution file.
    pub(crate) fn solutions(self, blocks: &[Plot3dBlock]) -> Vec<u8> {
        let mut records = self.header(blocks);
        for block in blocks {
            records.push(self.reals(&[2.95, 0.0, 2.1e6, 1.39]));
            records.push(self.reals(&block.numbers));
        }
        self.file(&records)
    }

    /// Writes a file of `count` functions of each grid.
    pub(crate) fn functions(self, blocks: &[Plot3dBlock], count: i32) -> Vec<u8> {
        let mut records = self.header(blocks);
        let of_grids = blocks
            .iter()
            .flat_map(|b| b.dims.into_iter().chain([count]));
        let counts: Vec<i32> = of_grids.collect();
        if let Some(last) = records.last_mut() {
            *last = self.words(&counts);
        }
        records.extend(blocks.iter().map(|block| self.reals(&block.numbers)));
        self.file(&records)
    }

    /// Writes a grid file of one grid: all x, all y, all z, and optionally iblank.
    pub(crate) fn grid(
        self,
        dims: [i32; 3],
        coordinates: &[f64],
        iblank: Option<&[i32]>,
    ) -> Vec<u8> {
        self.grids(&[Plot3dBlock {
            dims,
            numbers: coordinates.to_vec(),
            iblank: iblank.unwrap_or_default().to_vec(),
        }])
    }

    /// Writes a solution file of one grid: the five variables one after the other.
    pub(crate) fn solution(self, dims: [i32; 3], variables: &[f64]) -> Vec<u8> {
        self.solutions(&[Plot3dBlock {
            dims,
            numbers: variables.to_vec(),
            iblank: vec![],
        }])
    }
}

/// Writes an NPY file, version 1 or 2, from its header dictionary and its body.
pub(crate) fn npy(version: u8, header: &str, body: &[u8]) -> Vec<u8> {
    let mut file = b"\x93NUMPY".to_vec();
    file.extend([version, 0]);
    let len = u32::try_from(header.len()).unwrap().to_le_bytes();
    file.extend(&len[..if version == 1 { 2 } else { 4 }]);
    file.extend(header.as_bytes());
    file.extend(body);
    file
}

/// Writes an NPZ file from its members' names and bytes.
pub(crate) fn npz(members: &[(&str, Vec<u8>)], packed: bool) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let method = if packed {
        zip::CompressionMethod::Deflated
    } else {
        zip::CompressionMethod::Stored
    };
    let options = zip::write::SimpleFileOptions::default().compression_method(method);
    for (name, bytes) in members {
        archive.start_file(*name, options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}
