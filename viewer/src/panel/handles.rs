//! Draws and moves the handles in the picture: the faces of the clip box, and the clip plane's
//! position and direction.

use egui::{
    Color32, CursorIcon, Painter, Pos2, Rect, Response, Sense, Stroke, StrokeKind, Ui, Vec2,
};
use ewa_splat::view::{Bounds, ClipPlane};
use glam::{DVec2, DVec3};

use super::over::{outline, rimmed};
use crate::app::App;
use crate::clip::{self, Clip};
use crate::handles::{Grip, Part};
use crate::screen::{AXES, Screen};

/// Side of a handle's square, points.
const SIDE: f32 = 11.0;
const BOX: Color32 = Color32::from_rgb(240, 200, 90);
const PLANE: Color32 = Color32::from_rgb(120, 220, 230);

/// Returns the colour of a handle.
fn colour(part: Part) -> Color32 {
    match part {
        Part::Face(axis, _) => AXES[axis].1,
        Part::Move | Part::Turn => PLANE,
    }
}

/// Plane, the position of its handles, and the length of its arrow, world units.
#[derive(Clone, Copy)]
struct Arrow {
    plane: ClipPlane,
    foot: DVec3,
    /// Unit normal.
    normal: DVec3,
    length: f64,
}

impl Arrow {
    fn tip(&self) -> DVec3 {
        self.foot + self.normal * self.length
    }
}

/// Draws the clip box and plane with their handles over the picture, and moves them as the user
/// drags.
pub(crate) fn show(app: &mut App, ui: &Ui, painter: &Painter, screen: &Screen) {
    let Some(bounds) = app.loaded.as_ref().and_then(|loaded| loaded.bounds) else {
        return;
    };
    let mut clip = Clip::of(&app.settings.clip);
    let mut parts = Vec::new();
    if let Some(corners) = clip.corners {
        outline(painter, screen, clip::bounds_of(corners), BOX);
        for axis in 0..3 {
            for is_upper in [false, true] {
                let centre = clip::face_centre(corners, axis, is_upper);
                parts.push((Part::Face(axis, is_upper), centre));
            }
        }
    }
    let pivot = app.handles.pivot.unwrap_or(bounds.0);
    let arrow = clip.plane.and_then(|plane| {
        Some(Arrow {
            plane,
            foot: clip::foot(plane, pivot),
            normal: plane.normalised()?.normal,
            length: 0.35 * bounds.1.length(),
        })
    });
    if let Some(arrow) = arrow {
        draw_plane(painter, screen, &arrow, bounds);
        parts.extend([(Part::Move, arrow.foot), (Part::Turn, arrow.tip())]);
    }
    // The nearest handle is drawn last, on top of the others, and gets the pointer first.
    let depth = |place: DVec3| screen.camera.camera_point(place).z;
    parts.sort_by(|a, b| depth(b.1).total_cmp(&depth(a.1)));
    for (part, place) in parts {
        let Some(at) = screen.place(place) else {
            continue;
        };
        let response = handle(ui, painter, at, part);
        if response.drag_started() {
            let pressed = ui.input(|input| input.pointer.press_origin());
            let offset = pressed
                .and_then(|pressed| Some(screen.camera.project(place)? - screen.pixel(pressed)));
            app.handles.grip = offset.map(|offset| Grip {
                part,
                from: place,
                offset,
            });
            if let Some(arrow) = arrow {
                app.handles.pivot = Some(arrow.foot);
            }
        }
        let grip = app.handles.grip.filter(|grip| grip.part == part);
        if response.dragged()
            && let (Some(grip), Some(pointer)) = (grip, response.interact_pointer_pos())
        {
            let pixel = screen.pixel(pointer) + grip.offset;
            drag(&mut clip, screen, (grip, pixel), arrow, bounds);
            app.settings.clip = clip.planes();
        }
        if response.drag_stopped() {
            app.handles.grip = None;
        }
    }
}

/// Moves the held handle to a pixel.
fn drag(
    clip: &mut Clip,
    screen: &Screen,
    (grip, pixel): (Grip, DVec2),
    arrow: Option<Arrow>,
    bounds: Bounds,
) {
    let camera = &screen.camera;
    match (grip.part, &mut clip.corners, arrow) {
        (Part::Face(axis, is_upper), Some(corners), _) => {
            if let Some(step) = clip::along(camera, grip.from, DVec3::AXES[axis], pixel) {
                let place = grip.from[axis] + step;
                clip::move_face(corners, (axis, is_upper), place, bounds);
            }
        }
        (Part::Move, _, Some(arrow)) => {
            if let Some(step) = clip::along(camera, grip.from, arrow.normal, pixel) {
                let to = grip.from + arrow.normal * step;
                clip.plane = Some(clip::through(arrow.plane, to, bounds));
            }
        }
        (Part::Turn, _, Some(arrow)) => {
            let towards = (arrow.normal, arrow.length);
            if let Some(normal) = clip::turned(camera, arrow.foot, towards, pixel) {
                clip.plane = Some(ClipPlane {
                    normal,
                    distance: -normal.dot(arrow.foot),
                });
            }
        }
        _ => {}
    }
}

/// Draws the polygon in which the plane cuts the data's box, and the normal, towards the kept side.
fn draw_plane(painter: &Painter, screen: &Screen, arrow: &Arrow, bounds: Bounds) {
    let corners = clip::section(arrow.plane, bounds);
    let next = corners.iter().cycle().skip(1);
    for (from, to) in corners.iter().zip(next) {
        if let Some(ends) = screen.segment([*from, *to]) {
            rimmed(painter, ends, 1.2, PLANE, 1.0);
        }
    }
    if let Some(ends) = screen.segment([arrow.foot, arrow.tip()]) {
        rimmed(painter, ends, 2.0, PLANE, 1.0);
    }
}

/// Draws a handle: a square, or the tip of an arrow.
fn handle(ui: &Ui, painter: &Painter, at: Pos2, part: Part) -> Response {
    let rect = Rect::from_center_size(at, Vec2::splat(SIDE));
    let id = ui.scope_id().with(("handle", part.name()));
    // The handle takes clicks, too, so that they do not pick in the picture behind.
    let response = ui.interact(rect.expand(2.0), id, Sense::click_and_drag());
    let name = part.name();
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, &name));
    let is_held = response.hovered() || response.dragged();
    let colour = if is_held {
        Color32::WHITE
    } else {
        colour(part)
    };
    let rim = Stroke::new(1.5, Color32::from_black_alpha(200));
    match part {
        Part::Turn => {
            painter.circle(at, SIDE / 2.0, colour, rim);
        }
        Part::Face(..) | Part::Move => {
            painter.rect(rect, 1.0, colour, rim, StrokeKind::Outside);
        }
    }
    response
        .on_hover_cursor(CursorIcon::Grab)
        .on_hover_text(part.tip())
}
