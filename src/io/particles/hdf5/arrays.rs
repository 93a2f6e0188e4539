//! Reads arrays of any shape from HDF5 files that other formats name or use as their container.

use hdf5_reader::group::Group;
use hdf5_reader::{SliceInfo, SliceInfoElem};

use super::file::{SnapshotFile, broken, selected_bytes};
use super::layout::{Layout, NotRead};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, Stride, doubles, values};
use crate::io::vtk::xml::clip;
use crate::memory::check_room;
use crate::scene::Values;

/// Greatest total size of the arrays that are read, as a multiple of the file's length.
const MOST_INFLATION: &str = "arrays of at most 32 times the file's bytes in all";

/// Numbers with their dimensions, the slowest first.
#[derive(Debug, Clone)]
pub(in crate::io) struct ShapedArray {
    pub(in crate::io) dims: Vec<usize>,
    pub(in crate::io) encoding: Encoding,
    pub(in crate::io) bytes: Vec<u8>,
}

impl ShapedArray {
    fn stride(&self, component: usize, of: usize) -> Stride {
        let size = self.encoding.scalar.size();
        Stride {
            first: component * size,
            step: of * size,
            count: self.bytes.len() / size / of.max(1),
        }
    }

    /// Returns one component of `of` in double precision.
    pub(in crate::io) fn numbers(&self, component: usize, of: usize) -> Vec<f64> {
        doubles(&self.bytes, self.encoding, self.stride(component, of)).unwrap_or_default()
    }

    /// Returns one component of `of` as values of a field.
    pub(in crate::io) fn values(&self, component: usize, of: usize) -> Values {
        let own = values(&self.bytes, self.encoding, self.stride(component, of));
        own.unwrap_or(Values::U8(Vec::new()))
    }
}

/// A part of a dimension: every `step`-th of its entries from `start` on, `count` of them.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Selected {
    pub(in crate::io) start: usize,
    pub(in crate::io) step: usize,
    pub(in crate::io) count: usize,
}

impl Selected {
    /// Returns whether there is a part of each dimension, and within it.
    pub(in crate::io) fn fit(part: &[Self], dims: &[usize]) -> bool {
        let fits = |(own, all): (&Self, &usize)| {
            let last = own.count.saturating_sub(1).checked_mul(own.step);
            let last = last.and_then(|last| last.checked_add(own.start));
            own.count == 0 || own.step > 0 && last.is_some_and(|last| last < *all)
        };
        part.len() == dims.len() && part.iter().zip(dims).all(fits)
    }
}

/// An open HDF5 file, of which arrays are read by name.
pub(in crate::io) struct ArrayFile<'a> {
    file: SnapshotFile<'a>,
}

impl<'a> ArrayFile<'a> {
    /// Opens a file.
    ///
    /// # Errors
    /// The file cannot be read, or is damaged.
    pub(in crate::io) fn open(input: Input<'a>) -> Result<Self> {
        let file = SnapshotFile::open(input)?;
        Ok(Self { file })
    }

    /// Returns the root group.
    pub(in crate::io) fn root(&self) -> Result<Group> {
        let root = self.file.file.root_group();
        root.map_err(|e| broken(self.file.path, "root group", &e))
    }

    /// Returns the names of the groups in a group, and those of its datasets.
    pub(in crate::io) fn names(&self, group: &Group) -> Result<(Vec<String>, Vec<String>)> {
        let names = group.member_names();
        names.map_err(|e| broken(self.file.path, group.name(), &e))
    }

    /// Returns the group of this name in another.
    pub(in crate::io) fn child(&self, group: &Group, name: &str) -> Result<Group> {
        let child = group.group(name);
        child.map_err(|e| broken(self.file.path, name, &e))
    }

    /// Returns the text of an attribute of a group, without padding.
    pub(in crate::io) fn text(&self, group: &Group, name: &str) -> Option<String> {
        let attributes = group.raw_attributes().ok()?;
        let found = attributes.iter().find(|a| a.name() == name)?;
        let bytes = &found.message().raw_data;
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        let text = String::from_utf8_lossy(&bytes[..end]);
        Some(text.trim().to_owned())
    }

    /// Reads the dataset at a path from the root.
    ///
    /// - `part`: a part of each dimension; `None` reads all.
    ///
    /// # Errors
    /// There is no such dataset, it holds no numbers, or the part lies outside.
    pub(in crate::io) fn array(
        &self,
        path: &str,
        part: Option<&[Selected]>,
    ) -> Result<ShapedArray> {
        let dataset = self.file.file.dataset(path);
        let dataset =
            dataset.map_err(|e| broken(self.file.path, &format!("dataset `{path}`"), &e))?;
        self.numbers(&dataset, path, part)
    }

    /// Reads a dataset of a group whole.
    pub(in crate::io) fn array_in(&self, group: &Group, name: &str) -> Result<ShapedArray> {
        let place = format!("{}/{name}", group.name());
        let dataset = group.dataset(name);
        let dataset = dataset.map_err(|e| broken(self.file.path, &place, &e))?;
        self.numbers(&dataset, &place, None)
    }

    fn numbers(
        &self,
        dataset: &hdf5_reader::Dataset,
        name: &str,
        part: Option<&[Selected]>,
    ) -> Result<ShapedArray> {
        let path = self.file.path;
        let place = || format!("dataset `{}`", clip(name));
        let failed = |e| broken(path, &place(), &e);
        let fault = |expected: &str, found: String| {
            let advice = "the file is damaged, or not the one meant: write it again";
            Error::format(path, place(), expected, found, advice)
        };
        let layout = match Layout::of(&dataset.raw_datatype().map_err(failed)?) {
            Ok(layout) => layout,
            Err(NotRead::NoNumbers) => return Err(fault("numbers", "another type".to_owned())),
            Err(NotRead::Layout(layout)) => return Err(fault("IEEE numbers", layout)),
        };
        let encoding = layout.encoding();
        let size = |&n: &u64| usize::try_from(n).ok();
        let shape: Option<Vec<usize>> = dataset.shape().iter().map(size).collect();
        let shape = shape.ok_or_else(|| fault("dimensions", format!("{:?}", dataset.shape())))?;
        let dims: Vec<usize> = match part {
            None => shape.clone(),
            Some(part) => {
                if !Selected::fit(part, &shape) {
                    let expected = format!("a part of {shape:?}");
                    let found: Vec<[usize; 3]> =
                        part.iter().map(|s| [s.start, s.step, s.count]).collect();
                    return Err(fault(
                        &expected,
                        format!("{found:?} (start, stride, count)"),
                    ));
                }
                part.iter().map(|own| own.count).collect()
            }
        };
        let count = dims.iter().try_fold(1_usize, |n, &m| n.checked_mul(m));
        // Stored and widened numbers are in memory together, so the larger size counts.
        let of_number = encoding.scalar.size().max(layout.stored_size());
        let wanted = count.and_then(|n| n.checked_mul(of_number));
        let left = wanted.and_then(|wanted| self.file.budget.get().checked_sub(wanted));
        let (Some(left), Some(wanted)) = (left, wanted) else {
            return Err(fault(MOST_INFLATION, format!("{dims:?} numbers")));
        };
        self.file.budget.set(left);
        check_room(path, place(), wanted as u64)?;
        let is_whole = dims == shape;
        if wanted == 0 || is_whole {
            let bytes = match wanted {
                0 => Vec::new(),
                _ => layout.widened(dataset.read_raw_bytes().map_err(failed)?),
            };
            return Ok(ShapedArray {
                dims,
                encoding,
                bytes,
            });
        }
        let Layout::Native(encoding) = layout else {
            return Err(fault(
                "IEEE numbers of which a part is read",
                "others".to_owned(),
            ));
        };
        let mut selection = SliceInfo::all(shape.len());
        for (selected, own) in selection
            .selections
            .iter_mut()
            .zip(part.unwrap_or_default())
        {
            *selected = SliceInfoElem::Slice {
                start: own.start as u64,
                end: (own.start + (own.count - 1) * own.step + 1) as u64,
                step: own.step as u64,
            };
        }
        let bytes = selected_bytes(dataset, encoding.scalar, &selection).map_err(failed)?;
        // They are written as little-endian.
        let encoding = Encoding {
            big_endian: false,
            ..encoding
        };
        Ok(ShapedArray {
            dims,
            encoding,
            bytes,
        })
    }
}
