//! What is cut off: a box by its faces, and one plane of any direction.

use egui::{CollapsingHeader, DragValue, Slider, Ui};
use ewa_splat::view::{Bounds, ClipPlane};
use glam::DVec3;

use crate::app::App;
use crate::clip::Clip;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Clip").show(ui, |ui| {
        let Some(bounds) = app.loaded.as_ref().and_then(|loaded| loaded.bounds) else {
            ui.label("no data");
            return;
        };
        let before = Clip::of(&app.settings.clip);
        let mut clip = before.clone();
        faces(&mut clip, bounds, ui);
        let mut is_cut = clip.plane.is_some();
        let tip = "one plane of any direction; its square and the tip of its arrow are dragged in the picture";
        if ui.checkbox(&mut is_cut, "plane").on_hover_text(tip).changed() {
            let forward = app.orbit.as_ref().map(|orbit| orbit.target - orbit.eye);
            clip.plane = is_cut.then(|| through_middle(forward.unwrap_or(DVec3::X), bounds));
            app.handles.pivot = None;
        }
        if let Some(plane) = &mut clip.plane {
            numbers(plane, bounds, ui);
        }
        if clip != before {
            app.settings.clip = clip.planes();
        }
        if !app.settings.clip.is_empty() && ui.button("All").on_hover_text("nothing is cut off").clicked() {
            app.settings.clip.clear();
        }
    });
}

/// A switch of the box, and a slider for each of its faces.
fn faces(clip: &mut Clip, (centre, half): Bounds, ui: &mut Ui) {
    let (lower, upper) = (centre - half, centre + half);
    let mut is_boxed = clip.corners.is_some();
    let tip = "its faces are dragged by the squares in the picture, too";
    if ui
        .checkbox(&mut is_boxed, "box")
        .on_hover_text(tip)
        .changed()
    {
        clip.corners = is_boxed.then_some([lower, upper]);
    }
    let mut corners = clip.corners.unwrap_or([lower, upper]);
    let mut changed = false;
    for axis in 0..3 {
        let range = lower[axis]..=upper[axis];
        let [low, high] = &mut corners;
        let name = ["x", "y", "z"][axis];
        ui.horizontal(|ui| {
            ui.label(name);
            ui.spacing_mut().slider_width = 62.0;
            changed |= ui.add(Slider::new(&mut low[axis], range.clone())).changed();
        });
        ui.horizontal(|ui| {
            ui.label("  ");
            ui.spacing_mut().slider_width = 62.0;
            changed |= ui.add(Slider::new(&mut high[axis], range)).changed();
        });
        high[axis] = high[axis].max(low[axis]);
    }
    if changed {
        clip.corners = Some(corners);
    }
}

/// A plane through the middle that cuts off what is before it, across the axis nearest to the view.
fn through_middle(forward: DVec3, (centre, _): Bounds) -> ClipPlane {
    let forward = forward.normalize_or(DVec3::X);
    let axis = forward.abs().max_position();
    let normal = DVec3::AXES[axis] * forward[axis].signum();
    ClipPlane {
        normal,
        distance: -normal.dot(centre),
    }
}

/// The numbers of a plane, as `--clip` takes them.
fn numbers(plane: &mut ClipPlane, (_, half): Bounds, ui: &mut Ui) {
    let mut wanted = *plane;
    ui.horizontal(|ui| {
        ui.label("normal");
        for axis in 0..3 {
            let component = &mut wanted.normal[axis];
            ui.add(DragValue::new(component).speed(0.01).max_decimals(3));
        }
    });
    ui.horizontal(|ui| {
        ui.label("offset");
        let speed = half.max_element() / 200.0;
        ui.add(DragValue::new(&mut wanted.distance).speed(speed))
            .on_hover_text("kept is where normal . position + offset is positive");
        if ui
            .button("Flip")
            .on_hover_text("keep the other side")
            .clicked()
        {
            wanted = ClipPlane {
                normal: -wanted.normal,
                distance: -wanted.distance,
            };
        }
    });
    // A normal without length is on its way to another.
    if wanted.normalised().is_some() {
        *plane = wanted;
    }
}
