//! Which files are shown, and which of their fields.

use std::path::Path;

use egui::{CollapsingHeader, ComboBox, Ui};

use crate::app::App;
use crate::dialogs::Purpose;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Data")
        .default_open(true)
        .show(ui, |ui| {
            let mut changed = false;
            for (input, chosen) in app.inputs.iter().zip(&mut app.chosen) {
                let name = Path::new(input).file_name();
                let name = name.map_or(input.clone(), |name| name.to_string_lossy().into_owned());
                changed |= ui.checkbox(chosen, name).on_hover_text(input).changed();
            }
            let titles = app.loaded.iter().flat_map(|loaded| &loaded.volumes);
            let shown = titles.map(|volume| volume.title.clone()).next();
            let fields = app.loaded.as_ref().map(|loaded| loaded.fields.as_slice());
            let fields = fields.unwrap_or_default();
            if !fields.is_empty() {
                let shown = app.field.clone().or(shown).unwrap_or_default();
                ComboBox::from_label("field")
                    .selected_text(shown)
                    .show_ui(ui, |ui| {
                        for name in fields {
                            let value = Some(name.clone());
                            changed |= ui.selectable_value(&mut app.field, value, name).changed();
                        }
                    });
            } else if let Some(shown) = shown {
                ui.label(format!("field: {shown}"));
            }
            if let Some(loaded) = &app.loaded {
                let count = loaded.particle_count;
                let megabytes = count as f64 * loaded.bytes_per_particle / 1e6;
                ui.label(format!("{count} particles, {megabytes:.1} MB"));
            }
            ui.horizontal(|ui| {
                let tip = "other files in place of these (ctrl+O)";
                if ui.button("Open ...").on_hover_text(tip).clicked() {
                    app.dialogs.ask(Purpose::Open, ui.ctx());
                }
                if ui
                    .button("Reload")
                    .on_hover_text("read the files again (F5)")
                    .clicked()
                {
                    changed = true;
                }
                if app.progress.is_some() && ui.button("Cancel").clicked() {
                    app.cancel();
                }
            });
            let tip = "read the files again once one of them has changed";
            ui.checkbox(&mut app.follows, "follow changes")
                .on_hover_text(tip);
            if changed {
                if app.chosen.contains(&true) {
                    app.load();
                } else {
                    app.fail("nothing is chosen".into());
                }
            }
        });
}
