//! Which files are shown, and which of their fields.

use std::path::Path;

use egui::{CollapsingHeader, ComboBox, Ui};
use ewa_splat::io::{FieldSource, OpenOptions, open};

use crate::app::App;

/// The fields of the first input, if it is quickly read.
pub(crate) fn fields_of(inputs: &[String]) -> Vec<String> {
    /// Files that are read in a moment.
    const SMALL: u64 = 64 << 20;
    let Some(path) = inputs.first().map(Path::new) else {
        return Vec::new();
    };
    let is_small = std::fs::metadata(path).is_ok_and(|meta| meta.len() <= SMALL);
    if !is_small {
        return Vec::new();
    }
    // What cannot be read here says so where it is read to be drawn.
    let data = open(path, &OpenOptions::default());
    let fields = data.map(|data| data.fields).unwrap_or_default();
    let mut names = Vec::new();
    for field in fields {
        names.push(field.name.clone());
        if let FieldSource::Vector(components) = &field.source {
            let axes = ["x", "y", "z"].iter().take(components.len());
            names.extend(axes.map(|axis| format!("{}:{axis}", field.name)));
        }
    }
    names
}

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
            if !app.fields.is_empty() {
                let shown = app.field.clone().or(shown).unwrap_or_default();
                ComboBox::from_label("field")
                    .selected_text(shown)
                    .show_ui(ui, |ui| {
                        for name in &app.fields {
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
            if changed {
                if app.chosen.contains(&true) {
                    app.load();
                } else {
                    app.fail("nothing is chosen".into());
                }
            }
        });
}
