//! Gives the blocks of a volume another transfer function.

use std::sync::Arc;

use super::extent::{required_lobes, shown_lobes};
use super::merged::{MergedTransfer, weighting};
use super::volume::BlockedVolume;
use crate::scene::TransferFunction;

/// Gives a volume and its levels of detail another transfer function; no particle changes.
///
/// - `shown`: transfer function that classifies slabs, if particles carry their values under `transfer`.
pub(crate) fn set_transfer_function(
    family: &mut [BlockedVolume],
    transfer: &TransferFunction,
    shown: Option<&TransferFunction>,
) {
    let lobes = match shown {
        Some(shown) => shown_lobes(&family[0], shown),
        None => required_lobes(&family[0], transfer),
    };
    let lobes = lobes.map(Arc::new);
    let merged = family.get(1).map(|level| {
        let merged = MergedTransfer::new(transfer, weighting(&level.strength));
        Arc::new(merged)
    });
    for volume in family {
        volume.transfer_function = Some(transfer.clone());
        volume.lobes.clone_from(&lobes);
        if let Some(own) = &mut volume.merged {
            own.transfer.clone_from(&merged);
        }
    }
}
