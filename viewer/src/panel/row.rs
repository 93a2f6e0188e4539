//! Lays out rows of panels: a name and the widget beside it, with one tooltip for both.

use egui::{
    Align, Checkbox, CollapsingHeader, ComboBox, Label, Layout, Response, Sense, Slider, TextEdit,
    Ui, Vec2,
};

use super::numbers::short;

/// Width of names, points.
const NAME: f32 = 84.0;
/// Width of the number beside a slider, points.
const NUMBER: f32 = 78.0;

/// Choice among values: its name, the value, and a description.
pub(super) type Choice<'a, T> = (&'a str, T, &'a str);

/// Shows a part of the window that can be collapsed.
pub(super) fn section(
    ui: &mut Ui,
    name: &str,
    is_open: bool,
    tip: &str,
    add: impl FnOnce(&mut Ui),
) {
    let header = CollapsingHeader::new(name).default_open(is_open);
    header.show(ui, add).header_response.on_hover_text(tip);
}

/// Name of a row.
pub(super) struct Name<'a> {
    label: Response,
    tip: &'a str,
}

impl Name<'_> {
    /// Gives a widget of the row the row's name and tooltip.
    pub(super) fn of(&self, widget: Response) -> Response {
        self.tells(widget.labelled_by(self.label.id))
    }

    /// Gives a widget of the row the row's tooltip; the widget has a name of its own.
    pub(super) fn tells(&self, widget: Response) -> Response {
        widget
            .on_hover_text(self.tip)
            .on_disabled_hover_text(self.tip)
    }
}

/// Shows widgets beside a name.
pub(super) fn group<R>(
    ui: &mut Ui,
    name: &str,
    tip: &str,
    add: impl FnOnce(&mut Ui, &Name<'_>) -> R,
) -> R {
    ui.horizontal(|ui| {
        let name = Name {
            label: named(ui, name, tip, Sense::hover()),
            tip,
        };
        add(ui, &name)
    })
    .inner
}

/// Shows a widget beside its name.
pub(super) fn row(
    ui: &mut Ui,
    name: &str,
    tip: &str,
    add: impl FnOnce(&mut Ui) -> Response,
) -> Response {
    group(ui, name, tip, |ui, name| name.of(add(ui)))
}

fn named(ui: &mut Ui, name: &str, tip: &str, sense: Sense) -> Response {
    let size = Vec2::new(NAME, ui.spacing().interact_size.y);
    let layout = Layout::left_to_right(Align::Center);
    // The text has the same colour whether or not it can be clicked.
    let text = egui::RichText::new(name).color(ui.visuals().text_color());
    let label = Label::new(text).sense(sense).truncate();
    let label = ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(NAME);
        ui.add(label)
    });
    label.inner.on_hover_text(tip)
}

/// Shows a text that cannot be changed.
pub(super) fn fact(ui: &mut Ui, name: &str, text: impl Into<String>, tip: &str) {
    let text = Label::new(text.into()).truncate();
    group(ui, name, tip, |ui, name| name.tells(ui.add(text)));
}

/// Shows a switch; a click on its name counts, too.
pub(super) fn switch(ui: &mut Ui, name: &str, tip: &str, is_on: &mut bool) -> Response {
    switch_if(ui, name, is_on, Ok(tip))
}

/// Shows a switch that may be disabled.
///
/// - `tip`: the tooltip; an error disables the switch and gives the reason.
pub(super) fn switch_if(
    ui: &mut Ui,
    name: &str,
    is_on: &mut bool,
    tip: Result<&str, &str>,
) -> Response {
    let (Ok(text) | Err(text)) = tip;
    ui.horizontal(|ui| {
        let label = named(ui, name, text, Sense::click());
        let widget = ui.add_enabled(tip.is_ok(), Checkbox::without_text(is_on));
        let mut widget = widget.labelled_by(label.id);
        if label.clicked() && tip.is_ok() {
            *is_on = !*is_on;
            widget.mark_changed();
        }
        widget.on_hover_text(text).on_disabled_hover_text(text)
    })
    .inner
}

/// Shows a list of named values to choose from.
pub(super) fn choose<T: PartialEq + Copy>(
    ui: &mut Ui,
    name: &str,
    tip: &str,
    value: &mut T,
    all: &[Choice<'_, T>],
) -> Response {
    let chosen = all.iter().find(|(_, one, _)| one == value);
    let chosen = chosen.map_or("as asked", |(name, ..)| *name);
    row(ui, name, tip, |ui| {
        list(ui, name, chosen, |ui| {
            for (name, one, tip) in all {
                ui.selectable_value(value, *one, *name).on_hover_text(*tip);
            }
        })
    })
}

/// Shows a drop-down list that fills the available width.
pub(super) fn list(ui: &mut Ui, name: &str, chosen: &str, add: impl FnOnce(&mut Ui)) -> Response {
    let list = ComboBox::from_id_salt(name)
        .selected_text(chosen)
        .truncate();
    list.width(ui.available_width() - 1.0)
        .show_ui(ui, add)
        .response
}

/// Shows a slider with its number that fills the available width.
pub(super) fn slide(ui: &mut Ui, slider: Slider<'_>) -> Response {
    let room = ui.available_width() - NUMBER - ui.spacing().item_spacing.x;
    ui.spacing_mut().slider_width = room.max(20.0);
    ui.add(slider.custom_formatter(|value, _| short(value)))
}

/// Shows a text field that fills the available width.
pub(super) fn text(ui: &mut Ui, text: &mut String) -> Response {
    ui.add(TextEdit::singleline(text).desired_width(f32::INFINITY))
}

/// Shows a button.
pub(super) fn button(ui: &mut Ui, name: &str, tip: &str) -> bool {
    ui.button(name).on_hover_text(tip).clicked()
}

/// Shows a button that may be disabled.
pub(super) fn button_if(ui: &mut Ui, is_possible: bool, name: &str, tip: &str) -> bool {
    let button = ui.add_enabled(is_possible, egui::Button::new(name));
    button
        .on_hover_text(tip)
        .on_disabled_hover_text(tip)
        .clicked()
}
