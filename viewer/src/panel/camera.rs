//! Where it is seen from.

use egui::{CollapsingHeader, Ui};
use glam::DVec3;

use crate::app::App;
use crate::orbit::Lens;

/// Standard views: their names, and what they look along.
pub(crate) const VIEWS: [(&str, DVec3); 6] = [
    ("+x", DVec3::X),
    ("-x", DVec3::NEG_X),
    ("+y", DVec3::Y),
    ("-y", DVec3::NEG_Y),
    ("+z", DVec3::Z),
    ("-z", DVec3::NEG_Z),
];

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Camera")
        .default_open(true)
        .show(ui, |ui| {
            ui.horizontal(|ui| {
                ui.label("along");
                for (name, forward) in VIEWS {
                    if ui.small_button(name).clicked() {
                        app.look_along(forward);
                    }
                }
            });
            ui.horizontal(|ui| {
                if ui
                    .button("Home")
                    .on_hover_text("the first view (H)")
                    .clicked()
                {
                    app.orbit.clone_from(&app.home);
                }
                let is_flat = matches!(
                    app.orbit.as_ref().map(|orbit| orbit.lens),
                    Some(Lens::Orthographic(_))
                );
                let other = if is_flat {
                    "Perspective"
                } else {
                    "Orthographic"
                };
                if ui
                    .button(other)
                    .on_hover_text("the other lens (O)")
                    .clicked()
                    && let Some(orbit) = &mut app.orbit
                {
                    orbit.change_lens();
                }
                ui.checkbox(&mut app.flies, "fly")
                    .on_hover_text("W, A, S, D, Q, E; drag to look (F)");
            });
            ui.horizontal(|ui| {
                if ui
                    .button("Copy")
                    .on_hover_text("as JSON that --camera reads (C)")
                    .clicked()
                {
                    copy(app, ui.ctx());
                }
                if ui.button("Save view").clicked() {
                    app.saved.extend(app.orbit.clone());
                }
            });
            let mut left = None;
            let mut taken = None;
            for (i, orbit) in app.saved.iter().enumerate() {
                ui.horizontal(|ui| {
                    if ui.button(format!("View {}", i + 1)).clicked() {
                        taken = Some(orbit.clone());
                    }
                    if ui.small_button("x").clicked() {
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
        });
}

/// Puts the camera's JSON on the clipboard.
pub(crate) fn copy(app: &mut App, context: &egui::Context) {
    if let Some(orbit) = &app.orbit {
        context.copy_text(orbit.to_json());
        app.say("the camera is on the clipboard".into());
    }
}

/// Takes a camera from a text, where it is one.
pub(crate) fn paste(app: &mut App, text: &str) {
    let Some(orbit) = &app.orbit else {
        return;
    };
    match orbit.as_in_json(text) {
        Ok(orbit) => app.orbit = Some(orbit),
        Err(why) => app.fail(why),
    }
}
