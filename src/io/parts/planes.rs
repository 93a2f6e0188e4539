//! Reads values on a lattice, some planes at a time, from formats in which planes can be located without
//! reading the others.
//!
//! | format | what is read by planes |
//! |---|---|
//! | raw volumes | all but gzip |
//! | NRRD, MetaImage, NIfTI | one number for each sample, not packed, in one file |
//! | `.pvti` | scalars of nodes, of the pieces that meet the planes |
//! | `.vti` | scalars of nodes, appended raw and not compressed, in one piece |
//!
//! However the planes are divided into runs, their joined values are those that [`open`](crate::io::open) reads.

use std::ops::Range;
use std::path::Path;

use super::plane_source::Source;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{Dataset, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::folder::of_folder;
use crate::io::formats::recognise;
use crate::io::options::OpenOptions;
use crate::memory::check_room;
use crate::scene::{Lattice, Values};

/// Values on a lattice, read some planes of constant k (the slowest index) at a time.
#[derive(Debug)]
pub(crate) struct Planes {
    /// The file's metadata, with one field and none of its values.
    head: Dataset,
    lattice: Lattice,
    name: String,
    empty: Values,
    unit: Option<String>,
    source: Source,
}

impl Planes {
    /// Opens a file and reads its header; `None` if values cannot be read by planes. [`open`](crate::io::open)
    /// reads such a file whole, and reports what is wrong with it.
    ///
    /// - `field`: selects a field as [`Dataset::scalar`] does, but no vector and no component of one. Without
    ///   it, the file must have one field.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open) for headers and missing files.
    pub(crate) fn open(
        path: &Path,
        options: &OpenOptions,
        field: Option<&str>,
    ) -> Result<Option<Self>> {
        // These options exclude a lattice.
        let is_refused = options.read_as.is_some()
            || options.scales.is_some()
            || options.particle_type.is_some();
        let path = of_folder(path);
        let input = Input::of_file(&path);
        let Some(find) = recognise(input, options)?.planes.filter(|_| !is_refused) else {
            return Ok(None);
        };
        let Some((mut head, source)) = find(input, options)? else {
            return Ok(None);
        };
        head.name_units();
        let is_blanked = head.fields.iter().any(|f| Blanking::is_told_by(&f.name));
        let chosen = match (field, head.fields.as_slice()) {
            (Some(selector), _) => head.selected(selector),
            (None, [only]) => Some((only, None)),
            (None, _) => None,
        };
        let Some((field, None)) = chosen.filter(|_| !is_blanked) else {
            return Ok(None);
        };
        let field = field.clone();
        let (FieldSource::Scalar(empty), Association::Nodes, Geometry::Lattice(lattice)) =
            (&field.source, field.association, &head.geometry)
        else {
            return Ok(None);
        };
        if let Source::Pieces(pieces) = &source
            && !pieces.can_read(&field.name)
        {
            return Ok(None);
        }
        let (lattice, empty) = (lattice.clone(), empty.clone());
        let (name, unit) = (field.name.clone(), field.unit.clone());
        head.fields = vec![field];
        Ok(Some(Self {
            head,
            lattice,
            name,
            empty,
            unit,
            source,
        }))
    }

    /// The lattice of all planes.
    pub(crate) fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The name of the field.
    pub(crate) fn field(&self) -> &str {
        &self.name
    }

    /// The unit of the field.
    pub(crate) fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// No values, of the type that [`Self::read`] returns.
    pub(crate) fn empty_values(&self) -> Values {
        self.empty.clone()
    }

    /// The file's [`Dataset::notes`].
    pub(crate) fn notes(&self) -> &[String] {
        &self.head.notes
    }

    /// The file's [`Dataset::format`].
    pub(crate) fn format(&self) -> &str {
        self.head.format
    }

    /// The data set that [`open`](crate::io::open) returns, without the values and the other fields: for its path,
    /// bounds and up direction.
    pub(crate) fn head(&self) -> &Dataset {
        &self.head
    }

    /// Reads the values of some runs of planes, x fastest, run after run.
    ///
    /// # Errors
    /// Planes that do not exist; too little memory; a file that cannot be read, is damaged or has changed since
    /// it was opened; a missing piece, or one that differs from its index.
    pub(crate) fn read_runs(&self, runs: &[Range<usize>]) -> Result<Values> {
        let [nx, ny, nz] = self.lattice.dims;
        let is_there = |run: &&Range<usize>| run.start <= run.end && run.end <= nz;
        if let Some(run) = runs.iter().find(|run| !is_there(run)) {
            return Err(Error::format(
                &self.head.path,
                "planes",
                format!("a run within 0 to {nz}"),
                format!("{} to {}", run.start, run.end),
                "read planes that there are",
            ));
        }
        // The lattice was checked: its samples can be counted.
        let plane = nx * ny;
        let planes: u64 = runs.iter().map(|run| run.len() as u64).sum();
        let bytes = planes.saturating_mul(plane as u64);
        let bytes = bytes.saturating_mul(self.empty.bytes_per_value() as u64);
        check_room(&self.head.path, "planes", bytes)?;
        let mut all = self.empty_values();
        match &self.source {
            Source::Numbers(numbers) => {
                for run in runs {
                    all.append(numbers.read(run.start * plane..run.end * plane)?);
                }
                Ok(all)
            }
            Source::Pieces(pieces) => pieces.read(&self.name, &self.empty, runs),
        }
    }
}

#[cfg(test)]
impl Planes {
    /// Reads one run of planes.
    pub(in crate::io) fn read(&self, planes: Range<usize>) -> Result<Values> {
        self.read_runs(&std::iter::once(planes).collect::<Vec<_>>())
    }
}

#[cfg(test)]
pub(in crate::io) mod tests {
    use std::fs;
    use std::path::PathBuf;

    use glam::DVec3;

    use super::*;
    use crate::io::open;
    use crate::io::volume::raw::{RawLayout, RawType};

    /// Type and bits of the values. Planes in single precision may be narrower than the whole: both
    /// floating-point types count as one.
    pub(in crate::io) fn bits(values: &Values) -> (&'static str, Vec<u64>) {
        let number = |i| match values.wide(i) {
            nan if nan.is_nan() => f64::NAN.to_bits(),
            number => number.to_bits(),
        };
        (values.kind_name(), (0..values.len()).map(number).collect())
    }

    /// All planes, read in runs of `run` planes.
    pub(in crate::io) fn joined(planes: &Planes, run: usize) -> Result<Values> {
        let count = planes.lattice().dims[2];
        let mut all = planes.empty_values();
        for start in (0..count).step_by(run) {
            let more = planes.read(start..count.min(start + run))?;
            assert_eq!(all.kind_name(), more.kind_name());
            all.append(more);
        }
        Ok(all)
    }

    pub(in crate::io) fn whole(path: &Path, options: &OpenOptions, field: &str) -> Values {
        open(path, options).unwrap().scalar(field).unwrap().1
    }

    /// The law: planes in any runs equal the whole.
    pub(in crate::io) fn check(
        path: &Path,
        options: &OpenOptions,
        field: Option<&str>,
    ) -> Option<Planes> {
        let planes = Planes::open(path, options, field).unwrap()?;
        let data = open(path, options).unwrap();
        let selector = field.unwrap_or(planes.field());
        let (association, values) = data.scalar(selector).unwrap();
        assert_eq!(association, Association::Nodes);
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!("no lattice")
        };
        assert_eq!(planes.lattice(), lattice);
        assert_eq!(planes.unit(), data.unit(selector));
        assert_eq!(planes.notes(), data.notes);
        assert_eq!(planes.format(), data.format);
        assert!(data.field_names().contains(&planes.field()));
        let head = planes.head();
        assert_eq!(head.path, data.path);
        assert_eq!((head.up(), head.bounds()), (data.up(), data.bounds()));
        assert!(planes.empty_values().is_empty());
        let [nx, ny, nz] = lattice.dims;
        for start in 0..=nz {
            for end in start..=nz {
                let expected = values.part(start * nx * ny..end * nx * ny);
                let read = planes.read(start..end).unwrap();
                assert_eq!(bits(&read), bits(&expected), "{start} to {end}");
            }
        }
        assert_eq!(bits(&joined(&planes, 2).unwrap()), bits(&values));
        assert!(planes.read(0..nz + 1).is_err() && planes.read(nz..nz + 1).is_err());
        #[allow(clippy::reversed_empty_ranges, reason = "what is to be refused")]
        let backwards = planes.read(1..0);
        assert!(backwards.is_err());
        Some(planes)
    }

    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Self(tempfile::tempdir().unwrap())
        }

        fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
            let path = self.0.path().join(name);
            fs::write(&path, bytes).unwrap();
            path
        }
    }

    /// Bytes that give every kind of number, NaN included.
    fn bytes(count: usize) -> Vec<u8> {
        (0..count)
            .map(|i| i.wrapping_mul(2_654_435_761).to_le_bytes()[2])
            .collect()
    }

    fn plain(path: &Path) -> Option<Planes> {
        check(path, &OpenOptions::default(), None)
    }

    #[test]
    fn raw_volumes() {
        let folder = Folder::new();
        for scalar in [RawType::U8, RawType::I16, RawType::U16, RawType::F32] {
            for big_endian in [false, true] {
                let size = match scalar {
                    RawType::U8 => 1,
                    RawType::F32 => 4,
                    _ => 2,
                };
                let raw = RawLayout {
                    spacing: DVec3::new(1.0, -2.0, 3.0),
                    origin: DVec3::new(0.5, 0.0, -7.0),
                    big_endian,
                    ..RawLayout::new([5, 3, 7], scalar)
                };
                let options = OpenOptions {
                    raw: Some(raw),
                    ..OpenOptions::default()
                };
                let path = folder.file("a.raw", &bytes(5 * 3 * 7 * size));
                assert!(check(&path, &options, None).is_some());
                assert!(check(&path, &options, Some("VALUE")).is_some());
                assert!(Planes::open(&path, &options, Some("b")).unwrap().is_none());
                let path = folder.file("b.raw", &bytes(5 * 3 * 7 * size + 1));
                assert!(Planes::open(&path, &options, None).unwrap().is_none());
                let gzip = {
                    use std::io::Write;
                    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), Default::default());
                    gzip.write_all(&bytes(5 * 3 * 7 * size)).unwrap();
                    gzip.finish().unwrap()
                };
                let path = folder.file("c.raw.gz", &gzip);
                assert!(open(&path, &options).is_ok());
                assert!(Planes::open(&path, &options, None).unwrap().is_none());
            }
        }
    }

    #[test]
    fn a_file_that_becomes_shorter_is_named() {
        let folder = Folder::new();
        let path = folder.file("a.raw", &bytes(60));
        let options = OpenOptions {
            raw: Some(RawLayout::new([5, 3, 4], RawType::U8)),
            ..OpenOptions::default()
        };
        let planes = Planes::open(&path, &options, None).unwrap().unwrap();
        folder.file("a.raw", &bytes(40));
        assert!(planes.read(0..2).is_ok());
        let error = planes.read(2..3).unwrap_err().to_string();
        assert!(error.contains("a.raw"), "{error}");
    }

    #[test]
    fn runs_longer_than_a_chunk_join_without_a_seam() {
        let folder = Folder::new();
        let path = folder.file("a.raw", &bytes(4 * 1000 * 500 * 3));
        let options = OpenOptions {
            raw: Some(RawLayout::new([1000, 500, 3], RawType::F32)),
            ..OpenOptions::default()
        };
        assert!(check(&path, &options, None).is_some());
    }

    const SIZES: &str = "dimension: 3\nsizes: 4 3 5\n";

    fn nrrd(folder: &Folder, fields: &str, behind: usize) -> PathBuf {
        let mut file = format!("NRRD0004\n{fields}\n").into_bytes();
        file.extend(bytes(behind));
        folder.file("a.nrrd", &file)
    }

    #[test]
    fn nrrd_images() {
        let folder = Folder::new();
        for (kind, size) in [
            ("int8", 1),
            ("uchar", 1),
            ("short", 2),
            ("ushort", 2),
            ("int", 4),
            ("uint", 4),
            ("int64", 8),
            ("uint64", 8),
            ("float", 4),
            ("double", 8),
        ] {
            for endian in ["little", "big"] {
                let fields = format!(
                    "type: {kind}\n{SIZES}endian: {endian}\nencoding: raw\nsample units: \"mm\"\n\
                     space directions: (0,1,0) (2,0,0) (0,0.5,3)\nspace origin: (1,2,3)\n"
                );
                let planes = plain(&nrrd(&folder, &fields, 60 * size)).unwrap();
                assert_eq!(planes.unit(), Some("mm"));
                assert!(planes.notes().is_empty());
                // Extra bytes behind the values are noted; too few are refused.
                let planes = plain(&nrrd(&folder, &fields, 60 * size + 1)).unwrap();
                assert_eq!(planes.notes().len(), 1);
                assert!(plain(&nrrd(&folder, &fields, 60 * size - 1)).is_none());
            }
        }
        let start = format!("type: short\nendian: big\n{SIZES}");
        for (fields, behind, is_some) in [
            ("encoding: raw\nbyte skip: 7\n", 127, true),
            ("encoding: raw\nbyte skip: -1\n", 150, true),
            ("encoding: raw\nline skip: 1\n", 500, false),
            ("encoding: raw\ndata file: a.bin\n", 0, true),
            ("encoding: raw\nbyte skip: 5\ndata file: a.bin\n", 0, true),
            ("encoding: raw\nbyte skip: -1\ndata file: a.bin\n", 0, true),
            ("encoding: raw\nbyte skip: 99\ndata file: a.bin\n", 0, false),
            ("encoding: raw\ndata file: none.bin\n", 0, false),
            ("encoding: raw\ndata file: LIST\na.bin\nb.bin\n", 0, false),
            ("encoding: hex\n", 120, false),
        ] {
            folder.file("a.bin", &bytes(130));
            folder.file("b.bin", &bytes(130));
            let planes = plain(&nrrd(&folder, &format!("{start}{fields}"), behind));
            assert_eq!(planes.is_some(), is_some, "{fields}");
        }
        // The first of several volumes; a layer; vectors.
        for (fields, behind, is_some) in [
            (
                "dimension: 4\nsizes: 4 3 5 2\nkinds: space space space time\n",
                240,
                true,
            ),
            ("dimension: 2\nsizes: 4 3\n", 24, true),
            (
                "dimension: 4\nsizes: 3 4 3 5\nkinds: vector space space space\n",
                360,
                false,
            ),
        ] {
            let fields = format!("type: short\nendian: big\nencoding: raw\n{fields}");
            let planes = plain(&nrrd(&folder, &fields, behind));
            assert_eq!(planes.is_some(), is_some, "{fields}");
        }
    }

    #[test]
    fn meta_images() {
        let folder = Folder::new();
        let start = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 5\nElementSpacing = 1 2 3\n\
                     Offset = 3 2 1\nTransformMatrix = 0 1 0 1 0 0 0 0 -1\n";
        folder.file("a.bin", &bytes(250));
        for (fields, behind, is_some) in [
            (
                "ElementType = MET_SHORT\nElementDataFile = LOCAL\n",
                120,
                true,
            ),
            (
                "ElementType = MET_FLOAT\nElementByteOrderMSB = True\nElementDataFile = LOCAL\n",
                250,
                true,
            ),
            (
                "ElementType = MET_CHAR\nHeaderSize = -1\nElementDataFile = a.bin\n",
                0,
                true,
            ),
            (
                "ElementType = MET_LONG\nHeaderSize = 9\nElementDataFile = a.bin\n",
                0,
                true,
            ),
            (
                "ElementType = MET_DOUBLE\nElementDataFile = a.bin\n",
                0,
                false,
            ),
            (
                "ElementType = MET_CHAR\nElementNumberOfChannels = 2\nElementDataFile = LOCAL\n",
                120,
                false,
            ),
            (
                "ElementType = MET_CHAR\nCompressedData = True\nElementDataFile = a.bin\n",
                0,
                false,
            ),
        ] {
            let mut file = format!("{start}{fields}").into_bytes();
            file.extend(bytes(behind));
            let planes = plain(&folder.file("a.mha", &file));
            assert_eq!(planes.is_some(), is_some, "{fields}");
        }
    }

    /// A header of version 1, for an image of 4 x 3 x 5 samples.
    fn nifti(magic: &[u8; 4], datatype: i16, times: i16, scale: [f32; 2]) -> Vec<u8> {
        let mut header = vec![0; 352];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &348_i32.to_le_bytes());
        for (i, n) in [if times > 1 { 4 } else { 3 }, 4, 3, 5, times]
            .into_iter()
            .enumerate()
        {
            put(40 + 2 * i, &i16::to_le_bytes(n));
        }
        put(70, &datatype.to_le_bytes());
        for (i, spacing) in [1.0_f32, 0.5, 2.0, 3.0].into_iter().enumerate() {
            put(76 + 4 * i, &spacing.to_le_bytes());
        }
        put(
            108,
            &if magic[1] == b'+' { 352.0_f32 } else { 0.0 }.to_le_bytes(),
        );
        put(112, &scale[0].to_le_bytes());
        put(116, &scale[1].to_le_bytes());
        put(344, magic);
        header
    }

    #[test]
    fn nifti_images() {
        let folder = Folder::new();
        for (datatype, size) in [
            (2, 1),
            (4, 2),
            (8, 4),
            (16, 4),
            (64, 8),
            (256, 1),
            (512, 2),
            (1280, 8),
        ] {
            for scale in [[0.0; 2], [0.1, -7.0]] {
                for times in [1, 3] {
                    let mut file = nifti(b"n+1\0", datatype, times, scale);
                    file.extend(bytes(60 * size * times as usize));
                    let planes = plain(&folder.file("a.nii", &file)).unwrap();
                    assert_eq!(planes.notes().len(), usize::from(times > 1));
                    assert!(plain(&folder.file("a.nii", &file[..file.len() - 1])).is_none());
                    // Extra bytes behind the values are noted, but not behind volumes that are left out.
                    file.push(0);
                    assert!(plain(&folder.file("a.nii", &file)).is_some());
                }
            }
        }
        let mut rgb = nifti(b"n+1\0", 128, 1, [0.0; 2]);
        rgb.extend(bytes(180));
        assert!(plain(&folder.file("a.nii", &rgb)).is_none());
        // A header and values in two files; either can be opened.
        let header = folder.file("b.hdr", &nifti(b"ni1\0", 4, 1, [0.0; 2]));
        let image = folder.file("b.img", &bytes(125));
        for path in [header, image] {
            assert_eq!(plain(&path).unwrap().notes().len(), 1);
        }
    }

    #[test]
    fn what_cannot_be_read_apart_is_none() {
        let folder = Folder::new();
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/stack_bzip2.nrrd");
        assert!(open(&fixture, &OpenOptions::default()).is_ok());
        assert!(plain(&fixture).is_none());
        assert!(plain(&folder.file("a.csv", b"x,y,z\n0,0,0\n1,1,1\n")).is_none());
        let path = nrrd(&folder, &format!("type: uchar\n{SIZES}encoding: raw\n"), 60);
        assert!(plain(&path).is_some());
        let options = OpenOptions {
            read_as: Some(crate::io::ReadAs::Points),
            ..OpenOptions::default()
        };
        assert!(Planes::open(&path, &options, None).unwrap().is_none());
        assert!(Planes::open(&folder.0.path().join("none"), &options, None).is_err());
    }
}
