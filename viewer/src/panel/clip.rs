//! Shows the clip panel: a box by its faces, and one plane of any direction.

use egui::{DragValue, Slider, Ui};
use ewa_splat::view::{Bounds, ClipPlane};
use glam::DVec3;

use super::row::{button, button_if, group, row, section, slide, switch};
use crate::app::App;
use crate::clip::Clip;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "What is cut off: all beyond a box, and one side of a plane\n--clip";
    section(ui, "Clip", false, tip, |ui| {
        let Some(bounds) = app.loaded.as_ref().and_then(|loaded| loaded.bounds) else {
            ui.label("no data");
            return;
        };
        let before = Clip::of(&app.settings.clip);
        let mut clip = before.clone();
        faces(&mut clip, bounds, ui);
        let mut is_cut = clip.plane.is_some();
        let tip = "Cut off one side of a plane; its square and the tip of its arrow are dragged in the picture, too\n\
                   --clip nx,ny,nz,d";
        if switch(ui, "Plane", tip, &mut is_cut).changed() {
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
        let is_clipped = !app.settings.clip.is_empty();
        if button_if(
            ui,
            is_clipped,
            "Clip nothing",
            "Take the box and all planes away",
        ) {
            app.settings.clip.clear();
        }
    });
}

/// Shows a switch for the box, and a slider for each of its faces.
fn faces(clip: &mut Clip, (centre, half): Bounds, ui: &mut Ui) {
    const FACES: [[&str; 2]; 3] = [["x from", "x to"], ["y from", "y to"], ["z from", "z to"]];
    let (lower, upper) = (centre - half, centre + half);
    let mut is_boxed = clip.corners.is_some();
    let tip = "Show what lies in a box alone; its faces are dragged by the squares in the picture, too\n\
               --clip x0,y0,z0,x1,y1,z1";
    if switch(ui, "Box", tip, &mut is_boxed).changed() {
        clip.corners = is_boxed.then_some([lower, upper]);
    }
    let Some(corners) = &mut clip.corners else {
        return;
    };
    for (axis, names) in FACES.into_iter().enumerate() {
        let range = lower[axis]..=upper[axis];
        for (corner, name) in corners.iter_mut().zip(names) {
            let tip = "A face of the box\n--clip x0,y0,z0,x1,y1,z1";
            row(ui, name, tip, |ui| {
                slide(ui, Slider::new(&mut corner[axis], range.clone()))
            });
        }
        corners[1][axis] = corners[1][axis].max(corners[0][axis]);
    }
}

/// Returns a plane through the centre, across the axis nearest to the view, that clips the near
/// half.
fn through_middle(forward: DVec3, (centre, _): Bounds) -> ClipPlane {
    let forward = forward.normalize_or(DVec3::X);
    let axis = forward.abs().max_position();
    let normal = DVec3::AXES[axis] * forward[axis].signum();
    ClipPlane {
        normal,
        distance: -normal.dot(centre),
    }
}

/// Shows the numbers of a plane, as `--clip` takes them.
fn numbers(plane: &mut ClipPlane, (_, half): Bounds, ui: &mut Ui) {
    let mut wanted = *plane;
    let tip = "The direction across the plane, towards what is kept: x, y and z\n--clip nx,ny,nz,d";
    group(ui, "Normal", tip, |ui, row| {
        let normal: &mut [f64; 3] = wanted.normal.as_mut();
        for component in normal {
            let field = DragValue::new(component).speed(0.01).max_decimals(2);
            row.of(ui.add(field));
        }
    });
    let tip = "Kept is where normal . position + offset is positive\n--clip nx,ny,nz,d";
    group(ui, "Offset", tip, |ui, row| {
        let speed = half.max_element() / 200.0;
        row.of(ui.add(DragValue::new(&mut wanted.distance).speed(speed)));
        if button(ui, "Flip", "Keep the other side") {
            wanted = ClipPlane {
                normal: -wanted.normal,
                distance: -wanted.distance,
            };
        }
    });
    // A zero normal occurs while the user types; the plane is kept until the normal is valid.
    if wanted.normalised().is_some() {
        *plane = wanted;
    }
}
