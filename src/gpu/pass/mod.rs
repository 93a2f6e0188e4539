//! One pass of a frame on a device, over the volumes that are drawn together: from blocks to the pixels
//! of a band.
//!
//! Everything that a frame needs memory for has a capacity that the host chose before it knew the
//! frame. The device counts on where a capacity ends and writes nothing beyond it; a frame that needed
//! more is drawn again with more.
//!
//! What a binding cannot hold is cut: a volume into parts, the sorted footprints into depth chunks,
//! the image into bands of rows of tiles. Each band draws the chunks front to back, its pixels
//! carried from one to the next.
//!
//! | file | subject |
//! |---|---|
//! | `kind.rs` | what makes two passes differ |
//! | `capacity.rs` | how much of what a frame has memory for |
//! | `bands.rs` | the image in bands, the footprints in chunks |
//! | `retained.rs` | what is kept from frame to frame: volumes and capacities |
//! | `bind.rs` | buffers and bindings of frames of one kind |
//! | `encode.rs` | commands |
//! | `report.rs` | what a pass found out, and its way back |

mod bands;
mod bind;
mod capacity;
mod encode;
mod kind;
mod report;
mod retained;

pub(super) use bands::Bands;
pub(super) use bind::PassFrame;
pub(super) use kind::PassKind;
pub(super) use report::{Seen, TileCounts};
pub(super) use retained::Pass;
