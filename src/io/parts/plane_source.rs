//! Locates the values of lattices that are read by planes, by format.

use crate::data::dataset::Dataset;
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::options::OpenOptions;
use crate::io::volume::plain_numbers::PlainNumbers;
use crate::io::volume::raw::{self, RawLayout};
use crate::io::volume::voxels::Image;
use crate::io::vtk::vti_planes::{self, Pieces};

/// Location of the values.
#[derive(Debug)]
pub(in crate::io) enum Source {
    Numbers(PlainNumbers),
    Pieces(Pieces),
}

/// Locates the values of a file. Returns the rest of its data set, in which fields of scalars have no values.
/// `None` if values cannot be read by planes.
pub(in crate::io) type Find = fn(Input<'_>, &OpenOptions) -> Result<Option<(Dataset, Source)>>;

/// Locates the values of an image by its header.
pub(in crate::io) fn of_image(
    input: Input<'_>,
    header: fn(Input<'_>) -> Result<Image>,
) -> Result<Option<(Dataset, Source)>> {
    let found = header(input)?.plain(input)?;
    Ok(found.map(|(head, numbers)| (head, Source::Numbers(numbers))))
}

/// Locates the values of a raw volume.
pub(in crate::io) fn of_raw(
    input: Input<'_>,
    layout: Option<&RawLayout>,
) -> Result<Option<(Dataset, Source)>> {
    let found = raw::plain(input, layout)?;
    Ok(found.map(|(head, numbers)| (head, Source::Numbers(numbers))))
}

/// Locates the values of VTK image data.
pub(in crate::io) fn of_vti(input: Input<'_>) -> Result<Option<(Dataset, Source)>> {
    let found = vti_planes::find(input)?;
    Ok(found.map(|(head, pieces)| (head, Source::Pieces(pieces))))
}
