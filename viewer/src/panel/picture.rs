//! Shows the picture and handles the mouse in it.

use egui::{CentralPanel, Color32, Frame, PointerButton, Pos2, Rect, Sense, Ui};
use glam::DVec2;

use super::{handles, over};
use crate::app::App;
use crate::screen::Screen;

/// Rotation in radians for a movement by the picture's height.
const TURN: f64 = 3.0;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
        let (response, painter) = ui.allocate_painter(ui.available_size(), Sense::click_and_drag());
        let rect = response.rect;
        let scale = ui.ctx().pixels_per_point();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "no larger than a screen"
        )]
        let pixels = |length: f32| (length * scale).round().max(1.0) as usize;
        app.size = [pixels(rect.width()), pixels(rect.height())];
        if let Some(texture) = app.canvas.texture() {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(texture, rect, whole, Color32::WHITE);
        }
        if let Some(orbit) = &app.orbit {
            let camera = orbit.camera(app.size);
            let screen = Screen { camera, rect };
            over::draw(app, &painter, &screen);
            handles::show(app, ui, &painter, &screen);
        }
        if let Some(text) = &app.progress {
            over::plate(&painter, rect.center(), text);
        }
        answer(app, ui, &response);
    });
}

fn answer(app: &mut App, ui: &Ui, response: &egui::Response) {
    let height = f64::from(response.rect.height());
    let drag = response.drag_delta();
    let drag = DVec2::new(drag.x.into(), drag.y.into());
    let modifiers = ui.input(|input| input.modifiers);
    let scale = ui.ctx().pixels_per_point();
    if response.double_clicked()
        && let Some(at) = response.interact_pointer_pos()
    {
        app.pick(pixel(at, response.rect, scale, app.size), true);
    } else if response.clicked()
        && let Some(at) = response.interact_pointer_pos()
    {
        app.pick(pixel(at, response.rect, scale, app.size), false);
    }
    let scroll = response
        .hovered()
        .then(|| ui.input(|input| input.smooth_scroll_delta().y));
    let pinch = ui.input(egui::InputState::zoom_delta);
    let flies = app.flies;
    let Some(orbit) = &mut app.orbit else {
        return;
    };
    if drag != DVec2::ZERO {
        let angle = drag * (TURN / height);
        let is_pan = response.dragged_by(PointerButton::Middle)
            || (response.dragged_by(PointerButton::Primary) && modifiers.shift);
        if is_pan {
            orbit.pan(drag, height);
        } else if response.dragged_by(PointerButton::Secondary) {
            orbit.dolly((drag.y * 4.0 / height).exp());
        } else if modifiers.alt {
            orbit.roll(angle.x);
        } else if flies {
            orbit.look(-angle.x, -angle.y);
        } else {
            orbit.turn(-angle.x, -angle.y);
        }
    }
    if let Some(scroll) = scroll
        && scroll != 0.0
    {
        orbit.dolly((-f64::from(scroll) * 0.002).exp());
    }
    if response.hovered() && pinch != 1.0 {
        orbit.dolly(1.0 / f64::from(pinch));
    }
}

/// Returns the pixel of the picture under a point of the window.
fn pixel(at: Pos2, rect: Rect, scale: f32, size: [usize; 2]) -> [usize; 2] {
    let from = at - rect.min;
    let place = |length: f32, most: usize| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the picture"
        )]
        let pixel = (length * scale).max(0.0) as usize;
        pixel.min(most.saturating_sub(1))
    };
    [place(from.x, size[0]), place(from.y, size[1])]
}
