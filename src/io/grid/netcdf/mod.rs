//! Reads netCDF files: unstructured grids by the rules of Exodus II ([`exodus`]), and grids of the earth by
//! those of CF ([`grid`]).
//!
//! | container | its first bytes |
//! |---|---|
//! | classic | `CDF\x01` |
//! | 64-bit offset | `CDF\x02` |
//! | CDF-5 | `CDF\x05` |
//! | netCDF-4 | `\x89HDF`: an HDF5 file |
//!
//! The `netcdf-reader` crate decodes the containers and checks counts against the file's bytes. For HDF5 it
//! uses the same crate as the readers of snapshots, with the same limits. A file of HDF5 is taken for netCDF-4
//! by its name, or by the attribute `_NCProperties` that the netCDF library writes into the first bytes.

mod axis;
mod elements;
mod exodus;
mod grid;
mod place;

use std::cell::Cell;
use std::path::Path;

use netcdf_reader::{
    NcAttribute, NcFile, NcOpenOptions, NcSliceInfo, NcSliceInfoElem, NcType, NcVariable,
};

use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::io::particles::hdf5;
use crate::io::particles::hdf5::file::storage;
use crate::io::refused;
use crate::io::time_steps::{self, TimeStep};
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Extensions of netCDF files, including those of Exodus.
pub(in crate::io) const ENDINGS: &[&str] = &["nc", "nc4", "cdf", "ex2", "exo", "exii", "e"];

/// Greatest ratio of all arrays together to the file's bytes, which netCDF-4 may compress.
const MOST_INFLATION: usize = 32;

/// Number of bytes allowed in addition, for small files, of which the ratio is not meaningful.
const SMALL: usize = 16 << 20;

/// Fill values of the netCDF library for numbers never written, in single and in double precision.
const NEVER_WRITTEN: f32 = 9.969_21e36;
const NEVER_WRITTEN_DOUBLE: f64 = 9.969_209_968_386_869e36;

/// Advice for a file that breaks the rules.
const DAMAGED: &str = "the file is damaged: copy it or save it again";

/// Whether a file is netCDF.
///
/// - `has_its_name`: whether it has one of the extensions [`ENDINGS`].
pub(in crate::io) fn looks_like(head: &[u8], has_its_name: bool) -> bool {
    const MARK: &[u8] = b"_NCProperties";
    let is_classic = head.starts_with(b"CDF") && matches!(head.get(3), Some(1 | 2 | 5));
    let is_marked = || head.windows(MARK.len()).any(|w| w == MARK);
    is_classic || head.starts_with(hdf5::MAGIC) && (has_its_name || is_marked())
}

/// Reads a grid.
///
/// # Errors
/// A damaged file, or one without a grid.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let file = NetcdfFile::open(input)?;
    let names = file.variables()?.iter().map(|v| v.name.as_str());
    if let Some(refusal) = refused::minc(input.path, names) {
        return Err(refusal);
    }
    match exodus::is_exodus(&file)? {
        true => exodus::read(&file, time_step, read_as),
        false => grid::read(&file, time_step),
    }
}

/// The time steps in the file.
///
/// # Errors
/// As [`read`].
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let file = NetcdfFile::open(input)?;
    let times = match exodus::is_exodus(&file)? {
        true => exodus::times(&file)?,
        false => grid::times(&file)?,
    };
    Ok(time_steps::of_file(input.path, &times))
}

/// An open file.
struct NetcdfFile<'a> {
    path: &'a Path,
    file: NcFile,
    /// Number of bytes that may still be read into memory.
    budget: Cell<usize>,
}

impl<'a> NetcdfFile<'a> {
    fn open(input: Input<'a>) -> Result<Self> {
        let path = input.path;
        let (storage, len) = storage(input)?;
        let budget = len.saturating_mul(MOST_INFLATION).saturating_add(SMALL);
        let options = NcOpenOptions {
            // Every array is read once.
            chunk_cache_bytes: 0,
            max_chunk_bytes: budget,
            max_read_bytes: budget,
            max_object_header_bytes: len.saturating_add(SMALL / 16),
            ..NcOpenOptions::default()
        };
        let file = NcFile::from_storage_with_options(storage, options);
        let file = file.map_err(|e| broken(path, "file", &e))?;
        Ok(Self {
            path,
            file,
            budget: Cell::new(budget),
        })
    }

    /// All variables of the root group.
    fn variables(&self) -> Result<&[NcVariable]> {
        self.file
            .variables()
            .map_err(|e| broken(self.path, "variables", &e))
    }

    /// The variable with this name, if there is one.
    fn variable(&self, name: &str) -> Result<Option<&NcVariable>> {
        Ok(self.variables()?.iter().find(|v| v.name == name))
    }

    /// The length of the dimension with this name, if there is one.
    fn dimension(&self, name: &str) -> Result<Option<u64>> {
        let dimensions = self.file.dimensions();
        let dimensions = dimensions.map_err(|e| broken(self.path, "dimensions", &e))?;
        let found = dimensions.iter().find(|d| d.name == name);
        Ok(found.map(|d| d.size))
    }

    /// Subtracts `count` numbers of `size` bytes each from the budget.
    fn spend(
        &self,
        place: impl FnOnce() -> String,
        count: Option<usize>,
        size: usize,
    ) -> Result<()> {
        let left = count
            .and_then(|n| n.checked_mul(size))
            .and_then(|byte_count| self.budget.get().checked_sub(byte_count));
        let left = left.ok_or_else(|| {
            Error::format(
                self.path,
                place(),
                format!("arrays of at most {MOST_INFLATION} times the file's bytes in all"),
                "more",
                "the file is damaged, or compressed beyond reason: write it uncompressed",
            )
        })?;
        self.budget.set(left);
        Ok(())
    }

    /// The slice of a variable at the given indices along its first dimensions, whole along the others.
    fn part(&self, variable: &NcVariable, at: &[usize], size: usize) -> Result<NcSliceInfo> {
        let mut selection = NcSliceInfo::all(variable.ndim());
        for (selected, &i) in selection.selections.iter_mut().zip(at) {
            *selected = NcSliceInfoElem::Index(i as u64);
        }
        let mut rest = variable.shape().into_iter().skip(at.len());
        let count = rest.try_fold(1_usize, |n, m| n.checked_mul(usize::try_from(m).ok()?));
        self.spend(|| place(variable), count, size)?;
        Ok(selection)
    }

    /// Numbers of a variable in double precision, at the given indices along its first dimensions.
    fn doubles(&self, variable: &NcVariable, at: &[usize]) -> Result<Vec<f64>> {
        let part = self.part(variable, at, size_of::<f64>())?;
        self.file
            .read_variable_slice_as_f64(variable.name(), &part)
            .map(|array| array.into_raw_vec_and_offset().0)
            .map_err(|e| broken(self.path, &place(variable), &e))
    }

    /// As [`NetcdfFile::doubles`], in the type of a field.
    fn values(&self, variable: &NcVariable, at: &[usize]) -> Result<Values> {
        if *variable.dtype() != NcType::Float {
            return Ok(self.doubles(variable, at)?.into());
        }
        let part = self.part(variable, at, size_of::<f32>())?;
        self.file
            .read_variable_slice(variable.name(), &part)
            .map(|array| Values::F32(array.into_raw_vec_and_offset().0))
            .map_err(|e| broken(self.path, &place(variable), &e))
    }

    /// As [`NetcdfFile::doubles`], scaled and with NaN for missing numbers, by the attributes.
    fn unpacked_doubles(&self, variable: &NcVariable, at: &[usize]) -> Result<Vec<f64>> {
        let part = self.part(variable, at, size_of::<f64>())?;
        let array = self
            .file
            .read_variable_slice_unpacked_masked(variable.name(), &part)
            .map_err(|e| broken(self.path, &place(variable), &e))?;
        let mut numbers = array.into_raw_vec_and_offset().0;
        let fill = match variable.dtype() {
            NcType::Float => f64::from(NEVER_WRITTEN),
            _ => NEVER_WRITTEN_DOUBLE,
        };
        for number in numbers.iter_mut().filter(|x| **x == fill) {
            *number = f64::NAN;
        }
        Ok(numbers)
    }

    /// As [`NetcdfFile::unpacked_doubles`], in the type of a field.
    fn unpacked(&self, variable: &NcVariable, at: &[usize]) -> Result<Values> {
        Ok(self.unpacked_doubles(variable, at)?.into())
    }

    /// The texts of a variable of characters, without padding.
    fn texts(&self, variable: &NcVariable) -> Result<Vec<String>> {
        let count = variable.num_elements().ok();
        self.spend(
            || place(variable),
            count.and_then(|n| usize::try_from(n).ok()),
            size_of::<String>(),
        )?;
        let texts = self.file.read_variable_as_strings(variable.name());
        let texts = texts.map_err(|e| broken(self.path, &place(variable), &e))?;
        let clean = |text: String| text.split('\0').next().unwrap_or("").trim().to_owned();
        Ok(texts.into_iter().map(clean).collect())
    }

    fn fault(&self, variable: &NcVariable, expected: impl Into<String>, found: String) -> Error {
        Error::format(self.path, place(variable), expected, found, DAMAGED)
    }
}

/// The text of an attribute.
fn text(attributes: &[NcAttribute], name: &str) -> Option<String> {
    let found = attributes.iter().find(|a| a.name == name)?;
    let text = found.value.as_string()?;
    Some(text.trim_matches(['\0', ' ']).to_owned())
}

fn place(variable: &NcVariable) -> String {
    format!("variable `{}`", clip(variable.name()))
}

/// Converts the decoder's error to one of this library.
fn broken(path: &Path, place: &str, error: &netcdf_reader::Error) -> Error {
    Error::format(
        path,
        place,
        "sound netCDF",
        error.to_string().chars().take(300).collect::<String>(),
        "copy the file again, or rewrite it (nccopy) without unusual filters",
    )
}
