//! Notes kernels that reach beyond the faces of a periodic box, which is wrapped only if that is asked for.

use crate::data::dataset::{Dataset, FieldSource, Geometry};
use crate::data::smoothing::LengthMeaning;
use crate::scene::Values;

/// Support of a cubic spline, in standard deviations.
const SPLINE_END: f64 = 3.651_484;

/// Notes the share of the mass whose kernels reach beyond the faces of a box that begins at the origin. Nothing
/// is noted if particles lie outside the box, which then is not periodic, or if their sizes are unknown.
///
/// - `size`: the edges of the box; one number for a cube.
pub(in crate::io) fn note_reach(dataset: &mut Dataset, size: &[f64]) {
    let size = match *size {
        [edge] => [edge; 3],
        [x, y, z] => [x, y, z],
        _ => return,
    };
    let (Geometry::Points { positions }, Some(smoothing)) = (&dataset.geometry, &dataset.smoothing)
    else {
        return;
    };
    let column = |name: &Option<String>| -> Option<&Values> {
        let name = name.as_deref()?;
        let field = dataset.fields.iter().find(|f| f.name == name)?;
        match &field.source {
            FieldSource::Scalar(values) if values.len() == positions.len() => Some(values),
            _ => None,
        }
    };
    let reach = match smoothing.meaning {
        LengthMeaning::Support => 1.0,
        LengthMeaning::SmoothingLength => 2.0,
        LengthMeaning::Sigma => SPLINE_END,
        LengthMeaning::Fwhm => return,
    };
    let Some(lengths) = column(&smoothing.length).filter(|_| size.iter().all(|n| *n > 0.0)) else {
        return;
    };
    let masses = column(&smoothing.mass);
    let (mut all, mut beyond) = (0.0, 0.0);
    for (i, position) in positions.iter().enumerate() {
        if !position.is_finite() {
            continue;
        }
        let pairs = position.to_array().into_iter().zip(size);
        let nearest = pairs
            .map(|(x, end)| x.min(end - x))
            .fold(f64::INFINITY, f64::min);
        if nearest < 0.0 {
            return;
        }
        let mass = masses.map_or(1.0, |masses| f64::from(masses.get(i)));
        let length = reach * f64::from(lengths.get(i));
        if !(mass >= 0.0 && mass.is_finite() && length.is_finite()) {
            continue;
        }
        all += mass;
        if length > nearest {
            beyond += mass;
        }
    }
    if beyond > 0.0 {
        let percent = 100.0 * beyond / all;
        let percent = match percent {
            p if p < 0.1 => "less than 0.1".to_owned(),
            p if p < 10.0 => format!("{p:.1}"),
            p => format!("{p:.0}"),
        };
        let [x, y, z] = size;
        dataset.notes.push(format!(
            "Particles with {percent} % of the mass reach beyond the faces of the box ({x} x {y} x {z}): what lies beyond is \
             drawn, or lost, outside, unless the box is wrapped (--periodic {x},{y},{z})."
        ));
    }
}
