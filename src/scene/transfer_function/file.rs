//! Reads and writes transfer functions: this library's own form in JSON, and (read only) ParaView's colour maps
//! in JSON and XML.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::{ControlPoint, TransferDefaults, TransferFunction, check_points, narrowed};
use crate::error::{Error, Place, Result};
use crate::scene::transfer_function::colour_maps::ColourSpace;
use crate::scene::transfer_function::value_scale::{ScaleName, ValueScale};

const OWN_KEYS: [&str; 6] = [
    "range",
    "scale",
    "linear_within",
    "unit_distance",
    "color_space",
    "points",
];
const POINT_KEYS: [&str; 3] = ["value", "color", "opacity"];

/// A document with the name of its file, for messages.
struct Document<'a> {
    path: &'a Path,
}

/// One of ParaView's opacity points.
struct OpacityPoint {
    value: f32,
    opacity: f32,
    midpoint: f32,
    sharpness: f32,
}

impl TransferFunction {
    /// Reads a transfer function from the text of a JSON file; `path` names it in messages.
    ///
    /// **Own form**: an object with
    /// - `points`: a list of {`value`, `color` \[r, g, b\], `opacity`}, values not decreasing,
    ///   colour and opacity each optional and interpolated linearly over the points that carry
    ///   it; two points at one value make a step;
    /// - `range` \[a, b\] (default: from the first point to the last): range of the table;
    /// - `unit_distance` (default: that of `defaults`): length over which opacities are stated;
    /// - `scale`: `linear` (default), `log` or `symlog`: the scale on which values between the points are
    ///   interpolated ([`ValueScale`]);
    /// - `linear_within`: for a `symlog` scale, the distance from 0 up to which it is about linear (default: a
    ///   thousandth of the range's greatest distance from 0);
    /// - `color_space`: `srgb` (default) or `linear`, for the colours and their interpolation.
    ///
    /// **ParaView's form**: an object, or a list whose first object is read, with
    /// - `RGBPoints`: x, r, g, b, ... (sRGB-encoded);
    /// - `Points` (default: a ramp from 0 to 1): x, opacity, midpoint, sharpness, ...,
    ///   interpolated by VTK's formula for `vtkPiecewiseFunction`;
    /// - `ColorSpace`: `RGB` (default), `HSV`, `Lab`, `LabCIEDE2000`, `Diverging` or `Step`; `Lab...` and `Diverging`
    ///   are drawn as `Lab` (see [`ColourSpace::Lab`]);
    /// - or, in place of `RGBPoints`, `IndexedColors`: r, g, b, ... of categories, with `Annotations` (value, label, ...)
    ///   or for the values 0, 1, 2, ...
    ///
    /// ParaView's other keys are ignored. A map with `Points`, or one of categories, keeps its values. A map
    /// without them is a preset, which is stretched over `defaults.range` as in ParaView; so is one whose
    /// points run from exactly 0 to exactly 1.
    ///
    /// **ParaView's XML**: the first `ColorMap`, with its `space` and its `Point`s (`x`, `r`, `g`, `b`), as a
    /// preset; opacities (`o`) are ignored, as in ParaView.
    ///
    /// # Errors
    /// Text that is neither JSON nor XML, unknown keys, wrong types, points that are empty, out of order or
    /// outside 0..1; each with its place.
    pub fn from_json(path: &Path, text: &str, defaults: &TransferDefaults) -> Result<Self> {
        Ok(Self::from_file(path, text, defaults)?.function)
    }

    /// Reads a file as [`TransferFunction::from_json`] does, and returns the range of a stretched preset as
    /// well.
    ///
    /// # Errors
    /// As [`TransferFunction::from_json`].
    pub(crate) fn from_file(
        path: &Path,
        text: &str,
        defaults: &TransferDefaults,
    ) -> Result<FileFunction> {
        let document = Document { path };
        if text
            .trim_start_matches('\u{feff}')
            .trim_start()
            .starts_with('<')
        {
            let object = document.of_xml(text)?;
            return document.paraview(&object, defaults);
        }
        let value: Value = serde_json::from_str(text).map_err(|e| {
            document.fault(
                format!("line {}, column {}", e.line(), e.column()),
                "JSON",
                e.to_string(),
            )
        })?;
        let object = match &value {
            Value::Object(object) => object,
            Value::Array(list) => match list.first() {
                Some(Value::Object(object)) => object,
                other => {
                    return Err(document.fault(
                        "[0]",
                        "an object with RGBPoints",
                        other.map_or("an empty list".into(), describe),
                    ));
                }
            },
            other => return Err(document.fault("the document", "an object", describe(other))),
        };
        let is_paraviews = ["RGBPoints", "IndexedColors"].map(|key| object.contains_key(key));
        if is_paraviews.contains(&true) {
            document.paraview(object, defaults)
        } else if value.is_array() {
            Err(document.fault("[0].RGBPoints", "a list of x, r, g, b", "no such key"))
        } else {
            let function = document.own(object, defaults)?;
            Ok(FileFunction {
                function,
                stretched: None,
            })
        }
    }
}

/// A transfer function of a file.
pub(crate) struct FileFunction {
    pub(crate) function: TransferFunction,
    /// The range that a preset has in its file, if it was stretched over the data's.
    pub(crate) stretched: Option<[f32; 2]>,
}

/// Greatest error of a written file's opacities and colours, relative to the table.
const WRITTEN_ERROR: f32 = 5e-4;

impl TransferFunction {
    /// The text of a JSON file in [`TransferFunction::from_json`]'s own form. It has as few of the table's
    /// entries as keep opacities and linear colours to 5e-4.
    pub fn to_json(&self) -> String {
        let unit = self.unit_distance();
        let scale = self.value_scale();
        let [lo, hi] = self.range();
        let last = (self.table().len() - 1).max(1) as f64;
        let entries: Vec<[f32; 4]> = self
            .table()
            .iter()
            .map(|&[red, green, blue, extinction]| {
                [
                    red,
                    green,
                    blue,
                    narrowed(-(-f64::from(extinction) * unit).exp_m1()),
                ]
            })
            .collect();
        let points: Vec<Value> = kept(&entries)
            .into_iter()
            .map(|i| {
                let [red, green, blue, opacity] = entries[i];
                let value = f64::from(lo) + (f64::from(hi) - f64::from(lo)) * (i as f64 / last);
                let value = written(scale, narrowed(value));
                json!({"value": value, "color": [red, green, blue], "opacity": opacity})
            })
            .collect();
        let mut text = json!({
            "range": [written(scale, lo), written(scale, hi)], "unit_distance": unit,
            "color_space": "linear", "points": points,
        });
        match scale {
            ValueScale::Linear | ValueScale::Shifted { .. } => {}
            ValueScale::Log => text["scale"] = json!("log"),
            ValueScale::Symlog { linear } => {
                text["scale"] = json!("symlog");
                text["linear_within"] = json!(linear);
            }
        }
        format!("{text:#}\n")
    }
}

/// The value at a position, in as many digits as its precision has.
fn written(scale: ValueScale, position: f32) -> Value {
    let value = scale.value(position);
    match scale {
        ValueScale::Shifted { .. } => json!(value),
        _ => json!(narrowed(value)),
    }
}

/// Indices of the table's entries to keep: the ends, and, repeatedly, the entry farthest from the line between
/// its kept neighbours, until none is far (Ramer, Douglas and Peucker).
fn kept(entries: &[[f32; 4]]) -> Vec<usize> {
    let last = entries.len() - 1;
    let mut keeps = vec![false; entries.len()];
    (keeps[0], keeps[last]) = (true, true);
    let mut spans = vec![[0, last]];
    while let Some([first, end]) = spans.pop() {
        let distance = |i: usize| {
            let s = (i - first) as f32 / (end - first) as f32;
            (0..4).fold(0.0, |most: f32, n| {
                let line = entries[first][n] + (entries[end][n] - entries[first][n]) * s;
                most.max((entries[i][n] - line).abs())
            })
        };
        let between = (first + 1..end).map(|i| (i, distance(i)));
        let farthest = between.fold(
            (0, 0.0),
            |best, own| if own.1 > best.1 { own } else { best },
        );
        if farthest.1 > WRITTEN_ERROR {
            keeps[farthest.0] = true;
            spans.extend([[first, farthest.0], [farthest.0, end]]);
        }
    }
    (0..entries.len()).filter(|&i| keeps[i]).collect()
}

impl Document<'_> {
    fn fault(
        &self,
        place: impl Into<Place>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Error {
        Error::format(
            self.path,
            place,
            expected,
            found,
            "correct the transfer function",
        )
    }

    /// Adds this file's name to an error from the sampler.
    fn renamed(&self, error: Error) -> Error {
        match error {
            Error::Invalid {
                place,
                expected,
                found,
                ..
            } => self.fault(place, expected, found),
            other => other,
        }
    }

    fn known_keys(&self, object: &Map<String, Value>, place: &str, keys: &[&str]) -> Result<()> {
        match object.keys().find(|k| !keys.contains(&k.as_str())) {
            None => Ok(()),
            Some(key) => Err(self.fault(
                format!("{place}{key}"),
                format!("one of {}", keys.join(", ")),
                "an unknown key",
            )),
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "rounding to f32 is meant; overflow is refused"
    )]
    fn number(&self, value: &Value, place: &str) -> Result<f32> {
        let number = value
            .as_f64()
            .ok_or_else(|| self.fault(place, "a number", describe(value)))?
            as f32;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(self.fault(place, "a number within f32", describe(value)))
        }
    }

    /// A number among the values, which may exceed single precision.
    fn wide(&self, value: &Value, place: &str) -> Result<f64> {
        let number = value.as_f64().filter(|number| number.is_finite());
        number.ok_or_else(|| self.fault(place, "a number", describe(value)))
    }

    fn numbers(&self, value: &Value, place: &str) -> Result<Vec<f32>> {
        let list = value
            .as_array()
            .ok_or_else(|| self.fault(place, "a list of numbers", describe(value)))?;
        list.iter()
            .enumerate()
            .map(|(i, v)| self.number(v, &format!("{place}[{i}]")))
            .collect()
    }

    /// Exactly `N` numbers.
    fn tuple<const N: usize>(&self, value: &Value, place: &str) -> Result<[f32; N]> {
        self.numbers(value, place)?
            .try_into()
            .map_err(|v: Vec<f32>| {
                self.fault(
                    place,
                    format!("{N} numbers"),
                    format!("{} numbers", v.len()),
                )
            })
    }

    /// One or more rows of `N` numbers, with rising first numbers.
    fn rows<const N: usize>(&self, value: &Value, place: &str) -> Result<Vec<[f32; N]>> {
        let flat = self.numbers(value, place)?;
        if flat.is_empty() || !flat.len().is_multiple_of(N) {
            return Err(self.fault(
                place,
                format!("a positive multiple of {N} numbers"),
                format!("{} numbers", flat.len()),
            ));
        }
        let (rows, _) = flat.as_chunks::<N>();
        if let Some(i) = (1..rows.len()).find(|&i| rows[i][0] < rows[i - 1][0]) {
            return Err(self.fault(
                format!("{place}[{}]", i * N),
                "values in rising order",
                format!("{} after {}", rows[i][0], rows[i - 1][0]),
            ));
        }
        Ok(rows.to_vec())
    }

    fn own(
        &self,
        object: &Map<String, Value>,
        defaults: &TransferDefaults,
    ) -> Result<TransferFunction> {
        self.known_keys(object, "", &OWN_KEYS)?;
        let list = object
            .get("points")
            .ok_or_else(|| self.fault("points", "a list of points", "no such key"))?;
        let list = list
            .as_array()
            .ok_or_else(|| self.fault("points", "a list of points", describe(list)))?;
        let mut points = Vec::with_capacity(list.len());
        // Double precision: single precision may lose the differences.
        let mut values = Vec::with_capacity(list.len());
        for (i, value) in list.iter().enumerate() {
            let place = format!("points[{i}].");
            let point = value
                .as_object()
                .ok_or_else(|| self.fault(format!("points[{i}]"), "an object", describe(value)))?;
            self.known_keys(point, &place, &POINT_KEYS)?;
            let at = |key: &str| format!("{place}{key}");
            let value = point
                .get("value")
                .ok_or_else(|| self.fault(at("value"), "a number", "no such key"))?;
            let wide = self.wide(value, &at("value"))?;
            values.push(wide);
            points.push(ControlPoint {
                value: narrowed(wide).clamp(f32::MIN, f32::MAX),
                colour: point
                    .get("color")
                    .map(|c| self.tuple(c, &at("color")))
                    .transpose()?,
                opacity: point
                    .get("opacity")
                    .map(|o| self.number(o, &at("opacity")))
                    .transpose()?,
            });
        }
        check_points(&points)
            .map_err(|(place, expected, found)| self.fault(place, expected, found))?;
        let range = match object.get("range") {
            Some(range) => {
                let Some([lo, hi]) = range.as_array().map(Vec::as_slice) else {
                    return Err(self.fault("range", "2 numbers", describe(range)));
                };
                let lo = self.wide(lo, "range[0]")?;
                let hi = self.wide(hi, "range[1]")?;
                if lo >= hi {
                    return Err(self.fault(
                        "range",
                        "a first number below the second",
                        format!("[{lo}, {hi}]"),
                    ));
                }
                [lo, hi]
            }
            None => [values[0], values[values.len() - 1]],
        };
        let unit_distance = match object.get("unit_distance") {
            Some(value) => {
                let length = f64::from(self.number(value, "unit_distance")?);
                if length <= 0.0 {
                    return Err(self.fault(
                        "unit_distance",
                        "a positive length",
                        length.to_string(),
                    ));
                }
                length
            }
            None => defaults.unit_distance,
        };
        let space = match object.get("color_space") {
            None => ColourSpace::Srgb,
            Some(Value::String(s)) if s == "srgb" => ColourSpace::Srgb,
            Some(Value::String(s)) if s == "linear" => ColourSpace::Linear,
            Some(other) => {
                return Err(self.fault("color_space", "\"srgb\" or \"linear\"", describe(other)));
            }
        };
        let scale = self.scale(object, range)?;
        for (i, (point, value)) in points.iter_mut().zip(values).enumerate() {
            point.value = self.position(scale, value, &format!("points[{i}].value"))?;
        }
        let [lo, hi] = range;
        let range = [
            self.position(scale, lo, "range[0]")?,
            self.position(scale, hi, "range[1]")?,
        ];
        TransferFunction::from_points(&points, space, range, unit_distance)
            .map(|function| function.on_scale(scale))
            .map_err(|e| self.renamed(e))
    }

    fn scale(&self, object: &Map<String, Value>, range: [f64; 2]) -> Result<ValueScale> {
        let name = match object.get("scale") {
            None => ScaleName::Linear,
            Some(Value::String(s)) if s == "linear" => ScaleName::Linear,
            Some(Value::String(s)) if s == "log" => ScaleName::Log,
            Some(Value::String(s)) if s == "symlog" => ScaleName::Symlog,
            Some(other) => {
                let expected = "\"linear\", \"log\" or \"symlog\"";
                return Err(self.fault("scale", expected, describe(other)));
            }
        };
        let Some(linear) = object.get("linear_within") else {
            return Ok(match name {
                ScaleName::Linear => ValueScale::linear_over(range),
                name => ScaleName::over(range, name),
            });
        };
        let linear = self.number(linear, "linear_within")?;
        if name != ScaleName::Symlog || linear < f32::MIN_POSITIVE {
            return Err(self.fault(
                "linear_within",
                "a positive number beside a symlog scale",
                linear.to_string(),
            ));
        }
        Ok(ValueScale::Symlog { linear })
    }

    /// The position of a value on a scale; an error if it has none.
    fn position(&self, scale: ValueScale, value: f64, place: &str) -> Result<f32> {
        let position = scale.position(value);
        match position.is_finite() {
            true => Ok(position),
            false => Err(self.fault(
                place,
                "a value above 0 for a logarithmic scale",
                value.to_string(),
            )),
        }
    }

    /// The first colour map in ParaView's XML, as the keys of its JSON form.
    fn of_xml(&self, text: &str) -> Result<Map<String, Value>> {
        let text = text.trim_start_matches('\u{feff}');
        let document = roxmltree::Document::parse(text)
            .map_err(|e| self.fault("the document", "XML, or JSON", e.to_string()))?;
        let map = document.descendants().find(|n| n.has_tag_name("ColorMap"));
        let map = map.ok_or_else(|| self.fault("the document", "a `ColorMap`", "none"))?;
        let mut points = Vec::new();
        let nodes = map.children().filter(|n| n.has_tag_name("Point"));
        for (i, node) in nodes.enumerate() {
            for key in ["x", "r", "g", "b"] {
                let stated = node.attribute(key).unwrap_or("");
                let number: Option<f64> = stated.trim().parse().ok();
                points.push(number.map(Value::from).ok_or_else(|| {
                    let found = format!("`{}`", stated.chars().take(40).collect::<String>());
                    self.fault(format!("Point {i}, `{key}`"), "a number", found)
                })?);
            }
        }
        let mut object = Map::new();
        object.insert("RGBPoints".to_owned(), Value::Array(points));
        if let Some(space) = map.attribute("space") {
            object.insert("ColorSpace".to_owned(), Value::from(space));
        }
        Ok(object)
    }

    /// ParaView's categories as steps of colour, half way between neighbouring values.
    fn of_categories(&self, object: &Map<String, Value>) -> Result<Vec<[f32; 4]>> {
        let flat = self.numbers(&object["IndexedColors"], "IndexedColors")?;
        if flat.is_empty() || !flat.len().is_multiple_of(3) {
            let found = format!("{} numbers", flat.len());
            return Err(self.fault("IndexedColors", "a positive multiple of 3 numbers", found));
        }
        let (colours, _) = flat.as_chunks::<3>();
        let stated = object.get("Annotations").and_then(Value::as_array);
        let stated = stated.filter(|list| !list.is_empty());
        let mut values: Vec<f32> = match stated {
            None => (0..colours.len()).map(|i| i as f32).collect(),
            Some(list) => {
                let value = |(i, value): (usize, &Value)| {
                    let text = value.as_str().and_then(|text| text.trim().parse().ok());
                    let number: Option<f64> = value.as_f64().or(text);
                    let number = number.map(narrowed).filter(|x| x.is_finite());
                    let place = format!("Annotations[{}]", 2 * i);
                    number.ok_or_else(|| self.fault(place, "a number", describe(value)))
                };
                let values = list.iter().step_by(2).enumerate();
                values.map(value).collect::<Result<_>>()?
            }
        };
        // ParaView repeats the colours when they run out.
        let mut of_value: Vec<(f32, [f32; 3])> = values
            .drain(..)
            .enumerate()
            .map(|(i, value)| (value, colours[i % colours.len()]))
            .collect();
        of_value.sort_by(|a, b| a.0.total_cmp(&b.0));
        let last = of_value.len() - 1;
        let gap = |i: usize| 0.5 * (of_value[i + 1].0 - of_value[i].0);
        let ends = match last {
            0 => [0.5, 0.5],
            _ => [gap(0), gap(last - 1)],
        };
        // Each colour ends at its own point, as steps do.
        let mut rows = vec![[of_value[0].0 - ends[0], 0.0, 0.0, 0.0]];
        for (i, (value, [r, g, b])) in of_value.iter().enumerate() {
            let half = if i < last { gap(i) } else { ends[1] };
            rows.push([value + half, *r, *g, *b]);
        }
        let [_, r, g, b] = rows[1];
        rows[0] = [rows[0][0], r, g, b];
        Ok(rows)
    }

    fn paraview(
        &self,
        object: &Map<String, Value>,
        defaults: &TransferDefaults,
    ) -> Result<FileFunction> {
        let is_of_categories = !object.contains_key("RGBPoints");
        let mut is_stepped = is_of_categories;
        let space = match object.get("ColorSpace") {
            None => ColourSpace::Srgb,
            Some(Value::String(s)) => match s.as_str() {
                "RGB" => ColourSpace::Srgb,
                "HSV" => ColourSpace::Hsv,
                "Lab" | "LabCIEDE2000" | "Diverging" => ColourSpace::Lab,
                "Step" => {
                    is_stepped = true;
                    ColourSpace::Srgb
                }
                _ => {
                    return Err(self.fault(
                        "ColorSpace",
                        "RGB, HSV, Lab, LabCIEDE2000, Diverging or Step",
                        format!("\"{s}\""),
                    ));
                }
            },
            Some(other) => return Err(self.fault("ColorSpace", "a name", describe(other))),
        };
        let colours: Vec<[f32; 4]> = match is_of_categories {
            true => self.of_categories(object)?,
            false => self.rows(&object["RGBPoints"], "RGBPoints")?,
        };
        let unit = |x: &f32| (0.0..=1.0).contains(x);
        if let Some(i) = colours.iter().position(|c| !c[1..].iter().all(unit)) {
            return Err(self.fault(
                format!("RGBPoints[{}]", 4 * i),
                "a colour in 0..1",
                format!("{:?}", &colours[i][1..]),
            ));
        }
        let first = colours[0][0];
        let last = colours[colours.len() - 1][0];
        let stated = object.get("Points").filter(|p| !p.is_null());
        let is_preset = stated.is_none() && !is_of_categories;
        let opacities: Vec<OpacityPoint> = match stated {
            None => [(first, 0.0), (last, 1.0)]
                .map(|(value, opacity)| OpacityPoint {
                    value,
                    opacity,
                    midpoint: 0.5,
                    sharpness: 0.0,
                })
                .into(),
            Some(points) => self
                .rows(points, "Points")?
                .into_iter()
                .map(|[value, opacity, midpoint, sharpness]| OpacityPoint {
                    value,
                    opacity,
                    midpoint,
                    sharpness,
                })
                .collect(),
        };
        for (i, p) in opacities.iter().enumerate() {
            if ![p.opacity, p.midpoint, p.sharpness].iter().all(unit) {
                return Err(self.fault(
                    format!("Points[{}]", 4 * i),
                    "opacity, midpoint and sharpness in 0..1",
                    format!("{}, {}, {}", p.opacity, p.midpoint, p.sharpness),
                ));
            }
        }
        let from = [
            first.min(opacities[0].value),
            last.max(opacities[opacities.len() - 1].value),
        ];
        #[expect(
            clippy::float_cmp,
            reason = "a map counts as normalised only if it says exactly so"
        )]
        let is_normalised = !is_of_categories && from == [0.0, 1.0];
        let is_stretched = is_preset || is_normalised;
        let range = if is_stretched { defaults.range } else { from };
        let share = super::colour_maps::over_range(defaults.range);
        let own = |value: f32| match is_stretched {
            true => from[0] + (from[1] - from[0]) * share(value),
            false => value,
        };
        let function = TransferFunction::from_curves(
            |value| match super::segment(&colours, |c| c[0], own(value)) {
                Some((a, b, s)) => {
                    let rgb = |c: [f32; 4]| [c[1], c[2], c[3]];
                    // VTK's steps have the colour of the point at their end.
                    let s = if is_stepped && s > 0.0 { 1.0 } else { s };
                    space.mix_to_linear(rgb(colours[a]), rgb(colours[b]), s)
                }
                None => [1.0; 3],
            },
            |value| match super::segment(&opacities, |p| p.value, own(value)) {
                Some((a, b, s)) => opacities[a].toward(&opacities[b], s),
                None => 0.0,
            },
            range,
            defaults.unit_distance,
        );
        Ok(FileFunction {
            function: function.map_err(|e| self.renamed(e))?,
            stretched: is_stretched.then_some(from),
        })
    }
}

impl OpacityPoint {
    /// The opacity at fraction `s` of the way to the next point, by `vtkPiecewiseFunction`'s formula. `s` is
    /// warped so that the midpoint lies at half the way. From there, sharpness 0 is linear, 1 a step, and
    /// values between give a Hermite curve.
    fn toward(&self, next: &Self, s: f32) -> f32 {
        let (a, b) = (self.opacity, next.opacity);
        // VTK keeps the midpoint off the ends.
        let midpoint = self.midpoint.clamp(1e-5, 1.0 - 1e-5);
        let s = if s < midpoint {
            0.5 * s / midpoint
        } else {
            0.5 + 0.5 * (s - midpoint) / (1.0 - midpoint)
        };
        if self.sharpness < 0.01 {
            return a + (b - a) * s;
        }
        if self.sharpness > 0.99 {
            return if s < 0.5 { a } else { b };
        }
        let power = 1.0 + 10.0 * self.sharpness;
        let s = if s < 0.5 {
            0.5 * (2.0 * s).powf(power)
        } else {
            1.0 - 0.5 * (2.0 * (1.0 - s)).powf(power)
        };
        let (s2, s3) = (s * s, s * s * s);
        let slope = (1.0 - self.sharpness) * (b - a);
        let value = (2.0 * s3 - 3.0 * s2 + 1.0) * a
            + (3.0 * s2 - 2.0 * s3) * b
            + (2.0 * s3 - 3.0 * s2 + s) * slope;
        value.clamp(a.min(b), a.max(b))
    }
}

/// A JSON value for a message: short ones in full, long ones by kind.
fn describe(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Object(_) => "an object".into(),
        Value::Null => "null".into(),
        other => {
            let text = other.to_string();
            if text.chars().count() > 40 {
                format!("{}...", text.chars().take(40).collect::<String>())
            } else {
                text
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let bumps = |value: f32| {
            0.3 * (-(value - 3.0).powi(2)).exp() + 0.9 * (-(value - 7.0).powi(4)).exp()
        };
        let own = TransferFunction::from_curves(
            |value| [value / 10.0, 0.5, 1.0 - value / 10.0],
            bumps,
            [0.0, 10.0],
            0.25,
        )
        .unwrap();
        let text = own.to_json();
        let read = TransferFunction::from_json(Path::new("a.json"), &text, &DEFAULTS).unwrap();
        assert_eq!(
            (read.range(), read.unit_distance()),
            (own.range(), own.unit_distance())
        );
        for i in 0..=1000 {
            let value = i as f32 / 100.0;
            let [a, b] = [&own, &read].map(|t| t.classify(value));
            for n in 0..3 {
                assert!((a[n] - b[n]).abs() < 1e-3, "{value}: {a:?} {b:?}");
            }
            let opacity = |extinction: f32| 1.0 - (-extinction * 0.25).exp();
            assert!(
                (opacity(a[3]) - opacity(b[3])).abs() < 2e-3,
                "{value}: {a:?} {b:?}"
            );
        }
        // A few dozen points, not thousands.
        assert!(text.matches("value").count() < 150, "{text}");
    }

    const DEFAULTS: TransferDefaults = TransferDefaults {
        range: [100.0, 300.0],
        unit_distance: 2.0,
    };

    fn read(text: &str) -> Result<TransferFunction> {
        TransferFunction::from_json(Path::new("map.json"), text, &DEFAULTS)
    }

    /// Opacity per unit distance, from the extinction.
    fn opacity(t: &TransferFunction, value: f32) -> f64 {
        -(-f64::from(t.classify(value)[3]) * t.unit_distance()).exp_m1()
    }

    #[test]
    fn own_form() {
        let t = read(
            r#"{"range": [0, 4], "unit_distance": 0.5, "color_space": "linear", "points": [
                {"value": 0, "color": [0, 0, 0], "opacity": 0},
                {"value": 2, "opacity": 0.5},
                {"value": 4, "color": [1, 0.5, 0]}]}"#,
        )
        .unwrap();
        let e = t.classify(2.0);
        assert!((e[0] - 0.5).abs() < 1e-6 && (e[1] - 0.25).abs() < 1e-6);
        assert!((e[3] - 2f32.ln() / 0.5).abs() < 1e-3);
        assert!((opacity(&t, 4.0) - 0.5).abs() < 1e-6);
        let t = read(r#"{"points": [{"value": 1, "opacity": 0}, {"value": 3, "opacity": 1}]}"#);
        let t = t.unwrap();
        assert_eq!(t.range(), [1.0, 3.0]);
        assert!((t.unit_distance() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn faults_name_their_place() {
        for (text, place) in [
            ("{", "line 1, column 1"),
            ("3", "the document"),
            ("[]", "[0]"),
            ("[{}]", "[0].RGBPoints"),
            ("{}", "points"),
            (r#"{"points": [], "colour": 1}"#, "colour"),
            (r#"{"points": []}"#, "points"),
            (r#"{"points": [{"value": "a"}]}"#, "points[0].value"),
            (r#"{"points": [{"opacity": 1}]}"#, "points[0].value"),
            (
                r#"{"points": [{"value": 1, "colour": [1]}]}"#,
                "points[0].colour",
            ),
            (
                r#"{"points": [{"value": 1, "color": [1, 0]}]}"#,
                "points[0].color",
            ),
            (
                r#"{"points": [{"value": 1, "color": [1, 0, "x"]}]}"#,
                "points[0].color[2]",
            ),
            (
                r#"{"points": [{"value": 1, "opacity": 0}, {"value": 0}]}"#,
                "points[1].value",
            ),
            (
                r#"{"range": [1, 1], "points": [{"value": 1, "opacity": 0}]}"#,
                "range",
            ),
            (
                r#"{"unit_distance": 0, "points": [{"value": 1, "opacity": 0}]}"#,
                "unit_distance",
            ),
            (
                r#"{"color_space": "lab", "points": [{"value": 1, "opacity": 0}]}"#,
                "color_space",
            ),
            (r#"{"RGBPoints": [0, 1, 1]}"#, "RGBPoints"),
            (r#"{"RGBPoints": [1, 1, 1, 1, 0, 1, 1, 1]}"#, "RGBPoints[4]"),
            (r#"{"RGBPoints": [1, 1, 2, 1]}"#, "RGBPoints[0]"),
            (
                r#"{"RGBPoints": [0, 1, 1, 1], "Points": [0, 2, 0.5, 0]}"#,
                "Points[0]",
            ),
            (
                r#"{"RGBPoints": [0, 1, 1, 1], "ColorSpace": "Oklab"}"#,
                "ColorSpace",
            ),
            (r#"{"IndexedColors": [1, 1]}"#, "IndexedColors"),
            (
                r#"{"IndexedColors": [1, 1, 1], "Annotations": ["bone", "bone"]}"#,
                "Annotations[0]",
            ),
            ("<ColorMaps/>", "the document"),
            ("<ColorMap><Point x='a'/></ColorMap>", "Point 0, `x`"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("map.json: {place}: expected")),
                "{text}: {message}"
            );
        }
    }

    #[test]
    fn paraview_maps_are_absolute_unless_normalised() {
        let t = read(
            r#"[{"Name": "x", "NanColor": [1, 0, 0], "ColorSpace": "RGB",
                 "RGBPoints": [-10, 0, 0, 0, 10, 1, 1, 1],
                 "Points": [-10, 0, 0.5, 0, 10, 0.8, 0.5, 0]}]"#,
        )
        .unwrap();
        assert_eq!(t.range(), [-10.0, 10.0]);
        assert!((opacity(&t, 0.0) - 0.4).abs() < 1e-3);
        let t = read(r#"{"RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1], "ColorSpace": "Lab"}"#).unwrap();
        assert_eq!(t.range(), DEFAULTS.range);
        assert!((opacity(&t, 200.0) - 0.5).abs() < 1e-3);
        // L* = 50 is a linear luminance of .1842.
        assert!((t.classify(200.0)[1] - 0.1842).abs() < 1e-3);
    }

    #[test]
    fn paraview_midpoints_and_sharpness() {
        let t = |midpoint: f32, sharpness: f32| {
            read(&format!(
                r#"{{"RGBPoints": [0, 0, 0, 0, 4, 1, 1, 1],
                     "Points": [0, 0, {midpoint}, {sharpness}, 4, 0.8, 0.5, 0]}}"#
            ))
            .unwrap()
        };
        assert!((opacity(&t(0.25, 0.0), 1.0) - 0.4).abs() < 1e-3);
        assert!((opacity(&t(0.25, 0.0), 2.5) - 0.6).abs() < 1e-3);
        assert!(opacity(&t(0.5, 1.0), 1.99) < 1e-3);
        assert!((opacity(&t(0.5, 1.0), 2.01) - 0.8).abs() < 1e-3);
        assert!(opacity(&t(0.5, 0.5), 1.0) < 0.15);
    }
}
