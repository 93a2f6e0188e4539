//! Reads tables of splats: CSV, NPY, NPZ and PLY tables with scales, rotations and opacities.
//!
//! | columns | content |
//! |---|---|
//! | `scale_0`, `scale_1`, `scale_2` | standard deviations, or their natural logarithms; beside `f_dc_0..2` the third may be missing: flat splats |
//! | `rot_0..3` | quaternion w, x, y, z of any length |
//! | `opacity` | peak opacity, or its logit |
//! | `f_dc_0..2`, `f_rest_0..` | coefficients of harmonics, as in PLY splats |
//! | `red`, `green`, `blue` or `r`, `g`, `b` | colours if there are no such coefficients: bytes are sRGB codes, `r`, `g`, `b` in other types linear light |
//! | `filter_3D` | the 3-D filter of Yu et al. 2024, *Mip-Splatting* ([`SplatCloud::widen`]) |
//!
//! Programs export such columns as training stores them: scales as logarithms, opacities as logits. They are
//! read as such if `f_dc_0` is there, a scale is negative, or an opacity is outside 0 to 1. Tables with a
//! `mass` or an `extinction` are particles.

use super::log_scales::{self, ScaleMeaning};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::data::splats::{SplatCloud, constant_of_colour, sigmoid};
use crate::error::{Error, Result};
use crate::image::srgb_from_linear;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count};
use crate::scene::{SplatRule, Values};

/// The name in [`Dataset::format`].
pub(in crate::io) const FORMAT: &str = "table of splats";
/// Columns `f_rest_` of degree 10: more than any program writes.
const MOST_REST: usize = 360;

/// Converts a table with the columns of splats to splats; leaves others alone. Returns whether it converted the
/// table.
///
/// - `meaning`: meaning of the scales, if it was given.
///
/// # Errors
/// A number of columns `f_rest_` that no degree has.
pub(in crate::io) fn settle(data: &mut Dataset, meaning: Option<ScaleMeaning>) -> Result<bool> {
    let Geometry::Points { positions } = &data.geometry else {
        return Ok(false);
    };
    // VTK's grids of vertices have shapes as tensors and colours as vectors, for ParaView: particles.
    if data.format.starts_with("VTK") {
        return Ok(false);
    }
    let columns = Columns {
        fields: &data.fields,
        count: positions.len(),
    };
    let all = |names: &[&str]| -> Option<Vec<usize>> {
        names.iter().map(|name| columns.place(name)).collect()
    };
    let constant = all(&["f_dc_0", "f_dc_1", "f_dc_2"]);
    let mut scales = all(&["scale_0", "scale_1"]);
    match (columns.place("scale_2"), &constant, &mut scales) {
        (Some(third), _, Some(scales)) => scales.push(third),
        (None, None, _) => return Ok(false),
        _ => {}
    }
    let rotations = all(&["rot_0", "rot_1", "rot_2", "rot_3"]);
    let opacity = columns.place("opacity");
    let is_of_particles = ["mass", "extinction"]
        .iter()
        .any(|name| columns.place(name).is_some());
    let (Some(scales), Some(rotations), Some(opacity), false) =
        (scales, rotations, opacity, is_of_particles)
    else {
        return Ok(false);
    };

    let is_negative = scales.iter().any(|&s| columns.any(s, |x| x < 0.0));
    let is_beyond = columns.any(opacity, |x| x.is_finite() && !(0.0..=1.0).contains(&x));
    let is_raw = constant.is_some() || is_negative || is_beyond;
    let are_logarithms = match meaning {
        Some(meaning) => meaning == ScaleMeaning::Logarithms,
        None => is_raw,
    };
    let are_logits = is_beyond || constant.is_some();

    let rest: Vec<usize> = (0..MOST_REST)
        .map_while(|i| columns.place(&format!("f_rest_{i}")))
        .collect();
    let rest = if constant.is_some() { rest } else { Vec::new() };
    let per_channel = rest.len() / 3;
    let degree = (0..=10_u8).find(|&d| 3 * (harmonics_count(d) - 1) == rest.len());
    let Some(stated_degree) = degree else {
        return Err(Error::format(
            &data.path,
            "header",
            "0, 9, 24 or 45 columns f_rest_0, f_rest_1, ...",
            rest.len().to_string(),
            "write the harmonics of a whole degree, red, green and blue",
        ));
    };
    let degree = stated_degree.min(MAX_HARMONICS_DEGREE);
    let colours = columns.colours();
    let count = positions.len();
    let stride = 3 * harmonics_count(degree);
    let mut harmonics = vec![0.0; count * stride];
    let mut fill = |slot: usize, of: &dyn Fn(usize) -> f32| {
        for (i, set) in harmonics.chunks_exact_mut(stride).enumerate() {
            set[slot] = of(i);
        }
    };
    for channel in 0..3 {
        match (&constant, &colours) {
            (Some(places), _) => fill(channel, &|i| columns.get(places[channel], i)),
            (None, Some((places, code))) => fill(channel, &|i| {
                constant_of_colour(code(columns.values(places[channel]), i))
            }),
            // White.
            (None, None) => fill(channel, &|_| constant_of_colour(1.0)),
        }
        for k in 1..harmonics_count(degree) {
            let place = rest[channel * per_channel + k - 1];
            fill(3 * k + channel, &|i| columns.get(place, i));
        }
    }
    let length = |x: f32| if are_logarithms { x.exp() } else { x };
    let scale = |axis: usize, i: usize| {
        scales
            .get(axis)
            .map_or(0.0, |&place| length(columns.get(place, i)))
    };
    let share = |x: f32| if are_logits { sigmoid(x) } else { x };
    // Only Mip-Splatting writes a filter.
    let filter = columns.place("filter_3D");
    let mut cloud = SplatCloud {
        positions: positions.clone(),
        scales: (0..count)
            .map(|i| [0, 1, 2].map(|axis| scale(axis, i)))
            .collect(),
        rotations: (0..count)
            .map(|i| [0, 1, 2, 3].map(|k| columns.get(rotations[k], i)))
            .collect(),
        opacities: (0..count).map(|i| share(columns.get(opacity, i))).collect(),
        harmonics_degree: degree,
        harmonics,
        rule: SplatRule::of_mark(filter.is_some()),
        by_distance: false,
        ..SplatCloud::default()
    };
    if let Some(place) = filter {
        let of: Vec<f32> = (0..count).map(|i| columns.get(place, i)).collect();
        cloud.widen(&of);
    }

    let mut notes = Vec::new();
    if are_logarithms && constant.is_none() {
        notes.push(match (meaning, is_negative) {
            (None, false) => format!(
                "The scales of {count} splats are taken as logarithms, because opacities are logits."
            ),
            _ => log_scales::note(count, "splats", meaning),
        });
    }
    if scales.len() == 2 {
        notes.push("no column `scale_2`: the splats are flat".into());
    }
    if are_logits && constant.is_none() {
        notes.push(format!(
            "The opacities of {count} splats are taken as logits, because some are outside 0 to 1."
        ));
    }
    if constant.is_none() && colours.is_none() {
        notes.push("no colours, f_dc_0..2 or red, green, blue: the splats are white".into());
    }
    if stated_degree > degree {
        notes.push(format!(
            "harmonics of degree {stated_degree}: those above {MAX_HARMONICS_DEGREE} are not used"
        ));
    }
    notes.extend(filter.map(|_| FILTER_NOTE.to_owned()));

    let mut used: Vec<usize> = [scales, rotations, rest].concat();
    used.push(opacity);
    used.extend(filter);
    used.extend(constant.into_iter().flatten());
    used.extend(colours.map(|(places, _)| places).into_iter().flatten());
    let fields = std::mem::take(&mut data.fields).into_iter().enumerate();
    data.fields = fields
        .filter(|(place, _)| !used.contains(place))
        .map(|(_, field)| field)
        .collect();
    data.format = match data.format {
        crate::io::ply::FORMAT => crate::io::ply::splats::SPLAT_FORMAT,
        _ => FORMAT,
    };
    data.geometry = Geometry::Splats(cloud);
    data.notes.extend(notes);
    Ok(true)
}

/// The note of a filter that was applied.
pub(in crate::io) const FILTER_NOTE: &str =
    "`filter_3D`: scales and opacities are those with this 3-D filter (Mip-Splatting)";

/// Conversion of a colour channel to an sRGB code.
type Code = fn(&Values, usize) -> f32;

/// The scalar columns of a table.
struct Columns<'a> {
    fields: &'a [Field],
    count: usize,
}

impl Columns<'_> {
    fn place(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|f| {
            f.association == Association::Nodes
                && f.name.eq_ignore_ascii_case(name)
                && matches!(&f.source, FieldSource::Scalar(v) if v.len() == self.count)
        })
    }

    fn values(&self, place: usize) -> &Values {
        let FieldSource::Scalar(values) = &self.fields[place].source else {
            unreachable!("`place` finds scalars alone")
        };
        values
    }

    fn get(&self, place: usize, i: usize) -> f32 {
        self.values(place).get(i)
    }

    fn any(&self, place: usize, is: impl Fn(f32) -> bool) -> bool {
        let values = self.values(place);
        (0..values.len()).any(|i| is(values.get(i)))
    }

    /// The indices of the colour columns, and the conversion of their numbers to sRGB codes.
    fn colours(&self) -> Option<([usize; 3], Code)> {
        let of = |[r, g, b]: [&str; 3]| Some([self.place(r)?, self.place(g)?, self.place(b)?]);
        let byte: Code = |values, i| values.get(i) / 255.0;
        let same: Code = |values, i| values.get(i);
        let encoded: Code = |values, i| srgb_from_linear(values.get(i));
        let is_bytes = |places: &[usize; 3]| {
            let is_u8 = |&place: &usize| matches!(self.values(place), Values::U8(_));
            places.iter().all(is_u8)
        };
        if let Some(places) = of(["red", "green", "blue"]) {
            let is_of_bytes = places.iter().any(|&place| self.any(place, |x| x > 1.0));
            let is_of_bytes = is_of_bytes || is_bytes(&places);
            return Some((places, if is_of_bytes { byte } else { same }));
        }
        let places = of(["r", "g", "b"])?;
        Some((places, if is_bytes(&places) { byte } else { encoded }))
    }
}
