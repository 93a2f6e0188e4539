//! Defines the editable form of a transfer function: opacity points and colour stops over a range
//! of values.
//!
//! The picture uses the JSON of the curve, which `--transfer-function` reads. So a window and a
//! command with the same file show the same picture.

use std::path::Path;

use ewa_splat::Result;
use ewa_splat::image::srgb_from_linear;
use ewa_splat::scene::{ScaleName, TransferDefaults, TransferFunction, ValueScale};
use serde_json::{Value, json};

/// Largest error of opacity and colour when points of a file are left out.
const SIMPLER: f32 = 0.01;

/// Editable transfer function.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Curve {
    /// Range of values that the table covers.
    pub(crate) range: [f64; 2],
    scale: ValueScale,
    unit_distance: f64,
    /// Values, not decreasing, with opacities from 0 to 1.
    pub(crate) opacities: Vec<(f64, f32)>,
    /// Values, not decreasing, with display-encoded (sRGB) colours.
    pub(crate) colours: Vec<(f64, [f32; 3])>,
}

impl Curve {
    /// Extracts the points of a function's file, without those that interpolation reproduces.
    pub(crate) fn of(function: &TransferFunction) -> Option<Self> {
        let file: Value = serde_json::from_str(&function.to_json()).ok()?;
        let number = |value: &Value| value.as_f64().map(narrowed);
        let range = file.get("range")?.as_array()?;
        let range = [range.first()?.as_f64()?, range.get(1)?.as_f64()?];
        let scale = function.value_scale();
        let is_linear = file.get("color_space").and_then(Value::as_str) == Some("linear");
        let (mut opacities, mut colours) = (Vec::new(), Vec::new());
        for point in file.get("points")?.as_array()? {
            let value = point.get("value")?.as_f64()?;
            if let Some(opacity) = point.get("opacity").and_then(number) {
                opacities.push((value, opacity));
            }
            if let Some(colour) = point.get("color").and_then(Value::as_array) {
                let mut channels = colour.iter().filter_map(number);
                let colour = [channels.next()?, channels.next()?, channels.next()?];
                // The editor interpolates in display-encoded colours, in which colour maps need few
                // points.
                let encode = |c| if is_linear { srgb_from_linear(c) } else { c };
                colours.push((value, colour.map(encode)));
            }
        }
        let place = |value: f64| scale.position(value);
        let opacities = simplified(
            &opacities,
            place,
            |a, b, t| a + (b - a) * t,
            |a, b| (a - b).abs(),
        );
        let colours = simplified(
            &colours,
            place,
            |a, b, t| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t),
            |a: [f32; 3], b| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max),
        );
        Some(Self {
            range,
            scale,
            unit_distance: function.unit_distance(),
            opacities,
            colours,
        })
    }

    /// Returns the file that `--transfer-function` reads.
    pub(crate) fn to_json(&self) -> String {
        let opacities = self
            .opacities
            .iter()
            .map(|&(value, opacity)| (value, json!({ "value": value, "opacity": opacity })));
        let colours = self
            .colours
            .iter()
            .map(|&(value, colour)| (value, json!({ "value": value, "color": colour })));
        let mut points: Vec<(f64, Value)> = opacities.chain(colours).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let points: Vec<Value> = points.into_iter().map(|(_, point)| point).collect();
        let mut file = json!({
            "range": self.range,
            "unit_distance": self.unit_distance,
            "color_space": "srgb",
            "points": points,
        });
        match self.scale {
            ValueScale::Linear | ValueScale::Shifted { .. } => {}
            ValueScale::Log => file["scale"] = json!("log"),
            ValueScale::Symlog { linear } => {
                file["scale"] = json!("symlog");
                file["linear_within"] = json!(linear);
            }
        }
        format!("{file:#}\n")
    }

    /// Builds the function as a command would from the file.
    ///
    /// # Errors
    /// Points that form no function.
    pub(crate) fn function(&self) -> Result<TransferFunction> {
        let defaults = TransferDefaults {
            range: self.range.map(narrowed),
            unit_distance: self.unit_distance,
        };
        let path = Path::new("the edited function");
        let function = TransferFunction::from_json(path, &self.to_json(), &defaults)?;
        // The data's values were stored on the first function's scale.
        Ok(function.moved_to(self.scale).unwrap_or(function))
    }

    /// Returns the name of the scale.
    pub(crate) fn scale_name(&self) -> ScaleName {
        match self.scale {
            ValueScale::Linear | ValueScale::Shifted { .. } => ScaleName::Linear,
            ValueScale::Log => ScaleName::Log,
            ValueScale::Symlog { .. } => ScaleName::Symlog,
        }
    }

    /// Sets the range and moves all points with it. A range outside the scale's domain changes
    /// nothing.
    pub(crate) fn set_range(&mut self, range: [f64; 2]) {
        let places = range.map(|end| self.scale.position(end));
        if !(places[0] < places[1] && (places[1] - places[0]).is_finite()) {
            return;
        }
        let old = self.clone();
        self.range = range;
        for i in 0..old.opacities.len() {
            self.opacities[i].0 = self.value(old.share(old.opacities[i].0));
        }
        for i in 0..old.colours.len() {
            self.colours[i].0 = self.value(old.share(old.colours[i].0));
        }
    }

    /// Returns the relative position of a value in the range, 0 to 1.
    pub(crate) fn share(&self, value: f64) -> f32 {
        let [lo, hi] = self.range.map(|end| self.scale.position(end));
        (self.scale.position(value) - lo) / (hi - lo)
    }

    /// Returns the value at a relative position in the range.
    pub(crate) fn value(&self, share: f32) -> f64 {
        let [lo, hi] = self.range.map(|end| self.scale.position(end));
        let value = self.scale.value(lo + (hi - lo) * share.clamp(0.0, 1.0));
        value.clamp(self.range[0], self.range[1])
    }

    /// Moves an opacity point, between its neighbours.
    pub(crate) fn move_opacity(&mut self, i: usize, share: f32, opacity: f32) {
        let value = self.between(&self.opacities, i, self.value(share));
        self.opacities[i] = (value, opacity.clamp(0.0, 1.0));
    }

    /// Moves a colour stop, between its neighbours.
    pub(crate) fn move_colour(&mut self, i: usize, share: f32) {
        let value = self.between(&self.colours, i, self.value(share));
        self.colours[i].0 = value;
    }

    fn between<T>(&self, points: &[(f64, T)], i: usize, value: f64) -> f64 {
        let before = i.checked_sub(1).map_or(self.range[0], |i| points[i].0);
        let after = points.get(i + 1).map_or(self.range[1], |point| point.0);
        value.clamp(before, after.max(before))
    }

    /// Inserts an opacity point.
    pub(crate) fn add_opacity(&mut self, share: f32, opacity: f32) {
        let value = self.value(share);
        let at = self.opacities.partition_point(|point| point.0 <= value);
        self.opacities.insert(at, (value, opacity.clamp(0.0, 1.0)));
    }

    /// Inserts a colour stop of the interpolated colour.
    pub(crate) fn add_colour(&mut self, share: f32) {
        let value = self.value(share);
        let at = self.colours.partition_point(|stop| stop.0 <= value);
        let colour = match (
            at.checked_sub(1).map(|i| self.colours[i]),
            self.colours.get(at),
        ) {
            (Some((a, below)), Some(&(b, above))) => {
                let [a, b, t] = [a, b, value].map(|v| self.share(v));
                let t = if b > a { (t - a) / (b - a) } else { 0.0 };
                std::array::from_fn(|i| below[i] + (above[i] - below[i]) * t)
            }
            (Some((_, only)), None) => only,
            (None, Some(&(_, only))) => only,
            (None, None) => [1.0; 3],
        };
        self.colours.insert(at, (value, colour));
    }
}

pub(crate) fn narrowed(x: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "files hold what f32 does")]
    {
        x as f32
    }
}

/// Removes points that lie within [`SIMPLER`] of the polyline through the others (Douglas and
/// Peucker 1973).
fn simplified<T: Copy>(
    points: &[(f64, T)],
    place: impl Fn(f64) -> f32,
    mix: impl Fn(T, T, f32) -> T,
    distance: impl Fn(T, T) -> f32,
) -> Vec<(f64, T)> {
    let mut kept = vec![false; points.len()];
    let mut left = Vec::new();
    if let Some(last) = points.len().checked_sub(1) {
        kept[0] = true;
        kept[last] = true;
        left.push((0, last));
    }
    while let Some((first, last)) = left.pop() {
        let [a, b] = [first, last].map(|i| place(points[i].0));
        let error = |i: usize| {
            let t = if b > a {
                (place(points[i].0) - a) / (b - a)
            } else {
                0.0
            };
            distance(points[i].1, mix(points[first].1, points[last].1, t))
        };
        let worst = (first + 1..last).map(|i| (error(i), i));
        let worst = worst.max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((error, i)) = worst
            && error > SIMPLER
        {
            kept[i] = true;
            left.push((first, i));
            left.push((i, last));
        }
    }
    let all = points.iter().zip(kept);
    all.filter_map(|(point, is_kept)| is_kept.then_some(*point))
        .collect()
}

/// Transfer function, its editable form, and the file from which a command reads it.
#[derive(Debug, Clone, PartialEq)]
struct State {
    function: TransferFunction,
    curve: Curve,
    /// Text of the file; `None` for the function that the data were read with.
    file: Option<String>,
}

/// Transfer function with its earlier and later states.
#[derive(Debug, Clone)]
pub(crate) struct History {
    states: Vec<State>,
    now: usize,
}

impl History {
    /// Largest number of states kept for undo.
    const MOST: usize = 200;

    pub(crate) fn new(function: TransferFunction) -> Option<Self> {
        let curve = Curve::of(&function)?;
        Some(Self {
            states: vec![State {
                function,
                curve,
                file: None,
            }],
            now: 0,
        })
    }

    pub(crate) fn function(&self) -> &TransferFunction {
        &self.states[self.now].function
    }

    pub(crate) fn curve(&self) -> &Curve {
        &self.states[self.now].curve
    }

    /// Returns the table's range in the function that the data were read with.
    pub(crate) fn first_range(&self) -> [f64; 2] {
        self.states[0].curve.range
    }

    /// Returns the text that `--transfer-function` reads.
    pub(crate) fn file(&self) -> String {
        let state = &self.states[self.now];
        let file = state.file.clone();
        file.unwrap_or_else(|| state.function.to_json())
    }

    /// Adds an edited function and discards later states. If the edit `goes_on`, as a drag does, it
    /// replaces the last state.
    ///
    /// # Errors
    /// Points that form no function.
    pub(crate) fn edit(&mut self, curve: Curve, goes_on: bool) -> Result<()> {
        let state = State {
            function: curve.function()?,
            file: Some(curve.to_json()),
            curve,
        };
        self.push(state, goes_on);
        Ok(())
    }

    /// Adds a function read from a file's text, and discards later states.
    pub(crate) fn load(&mut self, function: TransferFunction, text: String) {
        if let Some(curve) = Curve::of(&function) {
            let file = Some(text);
            let state = State {
                function,
                curve,
                file,
            };
            self.push(state, false);
        }
    }

    fn push(&mut self, state: State, goes_on: bool) {
        self.states.truncate(self.now + 1);
        if goes_on && self.now > 0 {
            self.states.pop();
        }
        self.states.push(state);
        if self.states.len() > Self::MOST {
            self.states.remove(1);
        }
        self.now = self.states.len() - 1;
    }

    pub(crate) fn can_undo(&self) -> bool {
        self.now > 0
    }

    pub(crate) fn can_redo(&self) -> bool {
        self.now + 1 < self.states.len()
    }

    pub(crate) fn undo(&mut self) {
        self.now = self.now.saturating_sub(1);
    }

    pub(crate) fn redo(&mut self) {
        self.now = (self.now + 1).min(self.states.len() - 1);
    }
}

#[cfg(test)]
mod tests {
    use ewa_splat::scene::{AutomaticOptions, ValueSample, Values};

    use super::*;

    fn automatic(values: Vec<f32>) -> TransferFunction {
        let positions: Vec<glam::DVec3> = (0..values.len())
            .map(|i| glam::DVec3::X * i as f64)
            .collect();
        let volumes = vec![1.0; values.len()];
        let sample = ValueSample::of_body(&Values::F32(values), &volumes, &positions);
        TransferFunction::automatic(&sample, &AutomaticOptions::default()).unwrap()
    }

    #[test]
    fn curves_are_near_their_functions() {
        for values in [
            (0..500).map(|i| i as f32).collect::<Vec<_>>(),
            (0..500).map(|i| (i as f32 / 40.0).exp()).collect(),
            (0..500).map(|i| (i as f32 - 250.0).powi(3)).collect(),
        ] {
            let function = automatic(values);
            let curve = Curve::of(&function).unwrap();
            let again = curve.function().unwrap();
            assert_eq!(again.value_scale(), function.value_scale());
            let greatest = function.table().iter().map(|e| e[3]).fold(0.0, f32::max);
            for (a, b) in function.table().iter().zip(again.table()) {
                assert!((0..3).all(|i| (a[i] - b[i]).abs() < 0.02), "{a:?} {b:?}");
                assert!(
                    (a[3] - b[3]).abs() < 0.05 * greatest.max(0.05),
                    "{a:?} {b:?}"
                );
            }
            assert!(curve.opacities.len() < 40, "{}", curve.opacities.len());
        }
    }

    #[test]
    fn points_stay_between_their_neighbours() {
        let mut curve = Curve {
            range: [1.0, 100.0],
            scale: ValueScale::Log,
            unit_distance: 1.0,
            opacities: vec![(1.0, 0.0), (10.0, 0.5), (100.0, 1.0)],
            colours: vec![(1.0, [0.0; 3]), (100.0, [1.0; 3])],
        };
        curve.move_opacity(1, 0.25, 2.0);
        assert!((curve.opacities[1].0 - 10_f64.sqrt()).abs() < 1e-4);
        assert_eq!(curve.opacities[1].1, 1.0);
        curve.move_opacity(0, 0.9, 0.1);
        assert_eq!(curve.opacities[0].0, curve.opacities[1].0);
        curve.add_colour(0.5);
        assert!((curve.colours[1].1[0] - 0.5).abs() < 1e-4);
        assert!(curve.function().is_ok());
    }

    /// Points keep their relative positions when the range moves. An invalid range changes nothing.
    #[test]
    fn ranges_move_with_their_points() {
        let curve = Curve {
            range: [1.0, 100.0],
            scale: ValueScale::Log,
            unit_distance: 1.0,
            opacities: vec![(1.0, 0.0), (10.0, 0.5), (100.0, 1.0)],
            colours: vec![(10.0, [0.0; 3])],
        };
        let mut moved = curve.clone();
        moved.set_range([10.0, 1e5]);
        assert_eq!(moved.range, [10.0, 1e5]);
        for (value, wanted) in [(moved.opacities[1].0, 1e3), (moved.colours[0].0, 1e3)] {
            assert!((value / wanted - 1.0).abs() < 1e-4, "{value}");
        }
        for none in [
            [-1.0, 5.0],
            [5.0, 5.0],
            [7.0, 5.0],
            [1.0, f64::INFINITY],
            [f64::NAN, 1.0],
        ] {
            let mut same = curve.clone();
            same.set_range(none);
            assert_eq!(same, curve, "{none:?}");
        }
    }

    #[test]
    fn undo_restores_the_exact_function() {
        let first = automatic((0..500).map(|i| i as f32).collect());
        let mut history = History::new(first.clone()).unwrap();
        let mut curve = history.curve().clone();
        curve.add_opacity(0.3, 0.9);
        history.edit(curve.clone(), false).unwrap();
        curve.add_opacity(0.4, 0.1);
        history.edit(curve.clone(), true).unwrap();
        assert_ne!(*history.function(), first);
        history.undo();
        assert_eq!(*history.function(), first);
        assert!(!history.can_undo() && history.can_redo());
        history.redo();
        assert_eq!(*history.curve(), curve);
    }
}
