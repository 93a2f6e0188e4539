//! Reads inputs into a scene, in one process or on many ranks.

use super::alone::load_alone;
use super::loaded::Loaded;
use super::partitioned;
use super::request::Request;
use crate::collective::Collective;
use crate::error::Result;

/// Reads and samples all inputs as one scene. Inputs of data show one field if they have one in
/// common, by one transfer function.
///
/// - `ranks`: the ranks that share the scene; [`Alone`](crate::distributed::Alone) for one process.
///
/// # Errors
/// The errors of [opening](crate::io::open) and of [sampling](crate::sample::scene); a field that
/// no input has; nothing to draw in any input; a prepared scene beside edits or for another purpose.
pub fn load(request: &Request<'_>, ranks: &mut dyn Collective) -> Result<Loaded> {
    let checked = request.checks.choices();
    ranks.agree(checked)?;
    match ranks.size() {
        1 => load_alone(request),
        _ => partitioned::load(request, ranks),
    }
}
