//! Finds the frames of a file, and reads one of them.

use glam::DVec3;

use super::cell::Cell;
use super::lines::{DAMAGED, Lines};
use crate::data::dataset::{Dataset, Field};
use crate::error::{Advice, Error, Result};
use crate::io::bytes::file::Input;
use crate::io::particles::table::{dataset, halved_diameters};
use crate::io::time_steps::{TimeStep, chosen_of, of_frames};

/// A frame.
pub(super) struct Frame {
    pub(super) time: Option<f64>,
    /// `None` if its rows were not parsed.
    pub(super) rows: Option<Rows>,
}

/// Contents of a frame.
pub(super) struct Rows {
    pub(super) positions: Vec<DVec3>,
    pub(super) fields: Vec<Field>,
    pub(super) notes: Vec<String>,
    pub(super) cell: Option<Cell>,
}

/// Reads the next frame; returns `None` at the end of the file. The rows are parsed only if the argument is true.
pub(super) type ReadFrame<'f> = &'f mut dyn FnMut(&mut Lines<'_>, bool) -> Result<Option<Frame>>;

/// Frames of a file.
struct Frames {
    times: Vec<Option<f64>>,
    /// Contents of the wanted frame.
    rows: Option<Rows>,
    /// True if the file ends within a frame, behind whole ones.
    is_cut: bool,
}

/// Frames that are looked at.
#[derive(Clone, Copy, PartialEq)]
enum Which {
    /// All; no rows are parsed.
    All,
    /// All; the rows of the first are parsed.
    AllWithFirst,
    /// The frames up to this one, whose rows are parsed.
    UpTo(usize),
}

fn frames(input: Input<'_>, which: Which, read: ReadFrame<'_>) -> Result<Frames> {
    let wanted = match which {
        Which::All => None,
        Which::AllWithFirst => Some(0),
        Which::UpTo(wanted) => Some(wanted),
    };
    let mut lines = Lines::open(input)?;
    let mut frames = Frames {
        times: Vec::new(),
        rows: None,
        is_cut: false,
    };
    loop {
        let is_wanted = wanted == Some(frames.times.len());
        match read(&mut lines, is_wanted) {
            Ok(Some(frame)) => {
                frames.times.push(frame.time);
                frames.rows = frames.rows.or(frame.rows);
                if is_wanted && which != Which::AllWithFirst {
                    break;
                }
            }
            Ok(None) => break,
            // A simulation that still runs, or that was stopped, leaves a part of a frame.
            Err(_) if lines.has_ended && !is_wanted && !frames.times.is_empty() => {
                frames.is_cut = true;
                break;
            }
            Err(error) => return Err(error),
        }
    }
    match frames.times.is_empty() {
        true => Err(Error::format(
            input.path,
            "frames",
            "at least one",
            "none",
            Advice::no_data(DAMAGED),
        )),
        false => Ok(frames),
    }
}

/// Returns the frames as time steps. One that is cut off is none.
pub(super) fn steps(input: Input<'_>, read: ReadFrame<'_>) -> Result<Vec<TimeStep>> {
    Ok(of_frames(
        input.path,
        &frames(input, Which::All, read)?.times,
    ))
}

/// Reads one frame.
pub(super) fn read(
    input: Input<'_>,
    format: &'static str,
    time_step: Option<usize>,
    read: ReadFrame<'_>,
) -> Result<Dataset> {
    let path = input.path;
    let which = time_step.map_or(Which::AllWithFirst, Which::UpTo);
    let frames = frames(input, which, read)?;
    let first = frames.times.first().copied().flatten();
    let (_, note) = chosen_of(path, frames.times.len(), first, time_step)?;
    let mut rows = frames.rows.ok_or_else(|| {
        let expected = "the frame that was chosen";
        Error::format(path, "frames", expected, "none", DAMAGED)
    })?;
    rows.notes.extend(halved_diameters(&mut rows.fields));
    let mut data = dataset(path, format, rows.positions, rows.fields)?;
    data.notes = rows.notes;
    data.notes.extend(rows.cell.and_then(|cell| cell.note()));
    data.notes.extend(note);
    if frames.is_cut {
        let count = frames.times.len();
        data.notes.push(format!(
            "The file ends within a frame, which is left out: {count} are whole."
        ));
    }
    Ok(data)
}
