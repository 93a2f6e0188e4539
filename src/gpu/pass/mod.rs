//! Draws one pass of a frame on a device, over the volumes that are drawn together: from blocks to the
//! pixels of a band.
//!
//! All memory of a frame has a capacity that the host chose before it knew the frame. If a capacity is
//! exceeded, the device continues counting but writes nothing beyond it. The frame is then drawn again
//! with more memory.
//!
//! Data larger than a binding are divided: a volume into parts, the sorted footprints into depth chunks,
//! the image into bands of rows of tiles. Each band draws the chunks front to back, and its pixels are
//! carried from one chunk to the next.
//!
//! | file | subject |
//! |---|---|
//! | `kind.rs` | properties by which passes differ |
//! | `capacity.rs` | amounts for which a frame has memory |
//! | `bands.rs` | the image in bands, the footprints in chunks |
//! | `retained.rs` | data kept from frame to frame: volumes and capacities |
//! | `bind.rs` | buffers and bindings of frames of one kind |
//! | `encode.rs` | commands |
//! | `report.rs` | counts of a pass, and reading them back |

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
