//! Checks output paths and prints notes on outputs.

use std::path::PathBuf;

use crate::load::Input;
use crate::reference::ReferenceFrame;
use crate::{Error, Result};

/// Returns the paths of the inputs.
pub(crate) fn paths(inputs: &[Input]) -> impl Iterator<Item = &PathBuf> {
    inputs.iter().map(|input| &input.path)
}

/// Refuses an output that would overwrite an input or another output.
pub(crate) fn check_collisions<'a>(
    inputs: impl Iterator<Item = &'a PathBuf>,
    outputs: impl Iterator<Item = &'a PathBuf>,
) -> Result<()> {
    let real = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    let mut taken: Vec<PathBuf> = inputs.map(real).collect();
    for path in outputs {
        let path = real(path);
        if taken.contains(&path) {
            return Err(Error::format(
                path,
                "outputs",
                "a file of its own for each output",
                "one that is an input or another output",
                "choose another name",
            ));
        }
        taken.push(path);
    }
    Ok(())
}

/// Prints how many pixels of a reference image stayed above the wanted error.
pub(crate) fn warn_unconverged(frame: &ReferenceFrame, wanted: f64) {
    if frame.unconverged > 0 {
        super::progress::note!(
            "{} pixels of the true image may err by more than {wanted}: by {:.1e} at most",
            frame.unconverged,
            frame.error
        );
    }
}
