//! Shows the camera's panel.

use egui::{DragValue, Ui};
use glam::DVec3;

use super::row::{Choice, button, choose, group, row, section, switch};
use crate::app::App;
use crate::orbit::Lens;

/// Standard views: their names and directions.
pub(crate) const VIEWS: [(&str, DVec3); 6] = [
    ("+x", DVec3::X),
    ("-x", DVec3::NEG_X),
    ("+y", DVec3::Y),
    ("-y", DVec3::NEG_Y),
    ("+z", DVec3::Z),
    ("-z", DVec3::NEG_Z),
];

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip =
        "Where the data are seen from; drags and the wheel move it in the picture (? lists them)";
    section(ui, "Camera", true, tip, |ui| {
        views(app, ui);
        lens(app, ui);
        let tip = "Fly through the data: W, A, S, D, Q and E move, drags look around (F)";
        switch(ui, "Fly", tip, &mut app.flies);
        ui.horizontal_wrapped(|ui| {
            let tip = "Back to the first view, which shows all of the data (H)";
            if button(ui, "Reset view", tip) {
                app.orbit.clone_from(&app.home);
            }
            let tip = "Put the camera on the clipboard, as JSON; ctrl+V takes one from there (C)\n--camera FILE";
            if button(ui, "Copy", tip) {
                copy(app, ui.ctx());
            }
            let tip = "Keep this view in a list below; it is remembered with these data";
            if button(ui, "Save view", tip) {
                app.saved.extend(app.orbit.clone());
            }
        });
        saved(app, ui);
    });
}

/// Shows buttons that look along an axis.
fn views(app: &mut App, ui: &mut Ui) {
    let tip = "Look along an axis, parallel to it (1 to 6)\n--eye, --target, --up";
    group(ui, "Look along", tip, |ui, row| {
        // All six buttons fit side by side in a narrow panel.
        ui.spacing_mut().item_spacing.x = 1.0;
        ui.spacing_mut().button_padding.x = 2.0;
        for (name, forward) in VIEWS {
            if row.tells(ui.small_button(name)).clicked() {
                app.look_along(forward);
            }
        }
    });
}

fn lens(app: &mut App, ui: &mut Ui) {
    const LENSES: [Choice<'_, bool>; 2] = [
        (
            "perspective",
            false,
            "What is farther away is smaller\n--fov DEG",
        ),
        (
            "orthographic",
            true,
            "What is farther away is as large\n--ortho HEIGHT",
        ),
    ];
    let Some(orbit) = &mut app.orbit else {
        return;
    };
    let before = matches!(orbit.lens, Lens::Orthographic(_));
    let mut is_flat = before;
    let tip = "Perspective or orthographic (O)\n--fov, --ortho";
    choose(ui, "Projection", tip, &mut is_flat, &LENSES);
    if is_flat != before {
        orbit.change_lens();
    }
    match &mut orbit.lens {
        Lens::Perspective(fov) => {
            let tip = "Vertical field of view in degrees\n--fov DEG";
            row(ui, "Field of view", tip, |ui| {
                let field = DragValue::new(fov).range(1.0..=179.0).speed(0.2);
                ui.add(field.max_decimals(2).suffix("°"))
            });
        }
        Lens::Orthographic(height) => {
            let tip = "Height of the picture, in the data's units of length\n--ortho HEIGHT";
            row(ui, "Height", tip, |ui| {
                let speed = (*height / 200.0).max(f64::MIN_POSITIVE);
                let most = f64::MAX;
                let field = DragValue::new(height).range(f64::MIN_POSITIVE..=most);
                ui.add(field.speed(speed))
            });
        }
    }
}

/// Lists the saved views, each of which can be shown or removed.
fn saved(app: &mut App, ui: &mut Ui) {
    let mut left = None;
    let mut taken = None;
    for (i, orbit) in app.saved.iter().enumerate() {
        ui.horizontal(|ui| {
            if button(ui, &format!("View {}", i + 1), "Go to this view") {
                taken = Some(orbit.clone());
            }
            if button(ui, "×", "Forget this view") {
                left = Some(i);
            }
        });
    }
    if taken.is_some() {
        app.orbit = taken;
    }
    if let Some(i) = left {
        app.saved.remove(i);
    }
}

/// Copies the camera's JSON to the clipboard.
pub(crate) fn copy(app: &mut App, context: &egui::Context) {
    if let Some(orbit) = &app.orbit {
        context.copy_text(orbit.to_json());
        app.say("the camera is on the clipboard".into());
    }
}

/// Takes a camera from pasted text, if it is one.
pub(crate) fn paste(app: &mut App, text: &str) {
    let Some(orbit) = &app.orbit else {
        return;
    };
    match orbit.as_in_json(text) {
        Ok(orbit) => app.orbit = Some(orbit),
        Err(why) => app.fail(why),
    }
}
