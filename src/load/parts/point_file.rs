//! Reads a file of points on all ranks, a run of rows on each.

use super::found::found_on_all;
use crate::collective::Collective;
use crate::error::Result;
use crate::prepared::PointFile;
use crate::ranks::Share;
use crate::sample::summed_function;

/// Reads this rank's rows; returns their particles. The file's metadata then describe the particles of all ranks.
///
/// # Errors
/// The errors of reading, on any rank; nothing that can be drawn; a rank that is gone.
pub(crate) fn read_together(file: &mut PointFile, ranks: &mut dyn Collective) -> Result<Share> {
    let own = file.read_part(ranks.rank(), ranks.size());
    let (mut volume, own) = ranks.agree(own)?;
    file.keep(found_on_all(&own, ranks)?)?;
    if file.field().is_some() {
        let report = file.report().cloned().unwrap_or_default();
        let function = summed_function(report.value_range, report.unit_distance)?;
        volume.transfer_function = Some(function);
    }
    Ok(Share::from(vec![volume]))
}
