//! Selects the files and the field to show.

use std::path::Path;

use egui::Ui;

use super::numbers::{grouped, short};
use super::row::{button, fact, list, row, section, switch};
use crate::app::App;
use crate::dialogs::Purpose;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "The files, the field that is shown, and how much there is of it";
    section(ui, "Data", true, tip, |ui| {
        let mut changed = files(app, ui);
        changed |= field(app, ui);
        facts(app, ui);
        ui.horizontal_wrapped(|ui| {
            if button(ui, "Open…", "Choose other files in place of these (ctrl+O)") {
                app.dialogs.ask(Purpose::Open, ui.ctx());
            }
            changed |= button(ui, "Reload", "Read the files again (F5)");
            if app.progress.is_some() && button(ui, "Cancel", "End what is being done (Escape)") {
                app.cancel();
            }
        });
        let tip =
            "Read the files again whenever one of them changes; camera and transfer function stay";
        switch(ui, "Auto-reload", tip, &mut app.follows);
        if changed {
            if app.chosen.contains(&true) {
                app.load();
            } else {
                app.fail(
                    "Data: expected a file to show, found none switched on; switch one on".into(),
                );
            }
        }
    });
}

/// Shows a switch for each file. Returns true if the selection changed.
fn files(app: &mut App, ui: &mut Ui) -> bool {
    let mut changed = false;
    for (input, chosen) in app.inputs.iter().zip(&mut app.chosen) {
        let name = Path::new(input).file_name();
        let name = name.map_or(input.clone(), |name| name.to_string_lossy().into_owned());
        let tip = format!("Show {input}\nINPUT: FILE, FILE@FIELD or FILE@FIELD@FUNCTION");
        changed |= ui.checkbox(chosen, name).on_hover_text(tip).changed();
    }
    changed
}

/// Shows the list of fields. Returns true if the selection changed.
fn field(app: &mut App, ui: &mut Ui) -> bool {
    const TIP: &str =
        "The field that is shown; a vector's magnitude, or NAME:x, a component of it\n--field NAME";
    let mut changed = false;
    let titles = app.loaded.iter().flat_map(|loaded| &loaded.volumes);
    let shown = titles.map(|volume| volume.title.clone()).next();
    let fields = app.loaded.as_ref().map(|loaded| loaded.fields.as_slice());
    let fields = fields.unwrap_or_default();
    if !fields.is_empty() {
        let shown = app.field.clone().or(shown).unwrap_or_default();
        row(ui, "Field", TIP, |ui| {
            list(ui, "Field", &shown, |ui| {
                for name in fields {
                    let value = Some(name.clone());
                    changed |= ui.selectable_value(&mut app.field, value, name).changed();
                }
            })
        });
    } else if let Some(shown) = shown {
        fact(ui, "Field", shown, TIP);
    }
    changed
}

/// Shows the number of particles and their bounds.
fn facts(app: &App, ui: &mut Ui) {
    let Some(loaded) = &app.loaded else {
        return;
    };
    let count = loaded.particle_count;
    let megabytes = count as f64 * loaded.bytes_per_particle / 1e6;
    let text = format!("{}, {megabytes:.1} MB", grouped(count));
    let tip = "Kernels that the data became, and what they take of memory";
    fact(ui, "Particles", text, tip);
    let Some((centre, half)) = loaded.bounds else {
        return;
    };
    let (lower, upper) = (centre - half, centre + half);
    for (axis, name) in ["Extent x", "Extent y", "Extent z"].into_iter().enumerate() {
        let text = format!("{} to {}", short(lower[axis]), short(upper[axis]));
        let tip =
            "Where the data lie, in their own units of length; Annotations, Outline draws this box";
        fact(ui, name, text, tip);
    }
}
