//! Edits the transfer function: opacity points over a histogram, colour stops, maps, undo.

use egui::{Color32, DragValue, Pos2, Rect, Response, Sense, Shape, Stroke, Ui, Vec2};
use ewa_splat::image::srgb_from_linear;
use ewa_splat::scene::{
    AutomaticOptions, COLOUR_MAP_NAMES, ScaleName, TransferFunction, ValueSample,
};

use super::row::{Choice, button, button_if, choose, group, list, row, section, switch};
use crate::app::App;
use crate::curve::Curve;

const HEIGHT: f32 = 140.0;
const STRIP: f32 = 18.0;
const RADIUS: f32 = 5.0;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "Colour and opacity of each value: drag points and stops, double click adds one, right click takes one out\n\
               --transfer-function FILE|NAME";
    section(ui, "Transfer function", true, tip, |ui| {
        volumes(app, ui);
        let Some(history) = app.histories.get(app.edited).and_then(Option::as_ref) else {
            ui.label("These data have colours of their own");
            return;
        };
        let mut curve = history.curve().clone();
        let goes_on = opacities(app, &mut curve, ui);
        let goes_on = colours(app, &mut curve, ui) || goes_on;
        let goes_on = range(&mut curve, ui) || goes_on;
        map(app, &mut curve, ui);
        buttons(app, &mut curve, ui);
        automatic(app, &curve, ui);
        // An undo is not an edit.
        if let Some(history) = app.history()
            && *history.curve() != curve
            && let Err(error) = history.edit(curve, goes_on)
        {
            app.fail(ewa_splat::command::line(&error));
        }
    });
}

/// Selects the volume whose function is edited, if several have one.
fn volumes(app: &mut App, ui: &mut Ui) {
    let Some(loaded) = &app.loaded else {
        return;
    };
    let with: Vec<usize> = (0..app.histories.len())
        .filter(|&i| app.histories[i].is_some())
        .collect();
    if with.len() < 2 {
        return;
    }
    let name = |i: usize| format!("{}: {}", i + 1, loaded.volumes[i].title);
    let tip = "The volume whose transfer function is edited";
    let chosen = name(app.edited);
    row(ui, "Volume", tip, |ui| {
        list(ui, "Volume", &chosen, |ui| {
            for i in with {
                ui.selectable_value(&mut app.edited, i, name(i));
            }
        })
    });
}

/// Shows the curve of opacities over the histogram. Returns true while a drag goes on.
fn opacities(app: &App, curve: &mut Curve, ui: &mut Ui) -> bool {
    let size = Vec2::new(ui.available_width(), HEIGHT);
    let (response, painter) = ui.allocate_painter(size, Sense::click());
    let rect = response.rect.shrink(RADIUS);
    painter.rect_filled(response.rect, 3.0, Color32::from_gray(20));
    let volume = app
        .loaded
        .as_ref()
        .and_then(|loaded| loaded.volumes.get(app.edited));
    if let Some(histogram) = volume.and_then(|volume| volume.histogram.as_ref()) {
        let heights = histogram.heights(app.logarithmic_counts);
        let width = rect.width() / heights.len() as f32;
        for (i, height) in heights.iter().enumerate() {
            let left = rect.left() + i as f32 * width;
            let top = rect.bottom() - height * rect.height();
            let bar =
                Rect::from_min_max(Pos2::new(left, top), Pos2::new(left + width, rect.bottom()));
            painter.rect_filled(bar, 0.0, Color32::from_gray(60));
        }
    }
    let place = |value: f64, opacity: f32, curve: &Curve| {
        Pos2::new(
            rect.left() + curve.share(value) * rect.width(),
            rect.bottom() - opacity * rect.height(),
        )
    };
    let at = |pos: Pos2| {
        [
            (pos.x - rect.left()) / rect.width(),
            (rect.bottom() - pos.y) / rect.height(),
        ]
    };
    let mut line: Vec<Pos2> = curve
        .opacities
        .iter()
        .map(|&(v, o)| place(v, o, curve))
        .collect();
    if let (Some(first), Some(last)) = (line.first().copied(), line.last().copied()) {
        line.insert(0, Pos2::new(rect.left(), first.y));
        line.push(Pos2::new(rect.right(), last.y));
    }
    painter.add(Shape::line(line, Stroke::new(1.5, Color32::WHITE)));
    let mut goes_on = false;
    let mut left_out = None;
    for i in 0..curve.opacities.len() {
        let (value, opacity) = curve.opacities[i];
        let point = handle(ui, &response, ("opacity", i), place(value, opacity, curve));
        let label = format!("opacity {opacity:.3} at {value:.4}");
        point.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, &label));
        if point.dragged()
            && let Some(pos) = point.interact_pointer_pos()
        {
            let [share, opacity] = at(pos);
            curve.move_opacity(i, share, opacity);
            goes_on = !point.drag_started();
        }
        if point.secondary_clicked() && curve.opacities.len() > 2 {
            left_out = Some(i);
        }
        painter.circle_filled(
            place(curve.opacities[i].0, curve.opacities[i].1, curve),
            RADIUS,
            Color32::WHITE,
        );
        point.on_hover_text(label + "\ndrag moves it, right click takes it out");
    }
    if let Some(i) = left_out {
        curve.opacities.remove(i);
    }
    if response.double_clicked()
        && let Some(pos) = response.interact_pointer_pos()
    {
        let [share, opacity] = at(pos);
        curve.add_opacity(share, opacity);
    }
    let tip = "Opacity, from 0 at the bottom to 1 at the top, over the values; behind it how many samples have each value\n\
               --transfer-function FILE";
    response.on_hover_text(tip);
    goes_on
}

fn handle(ui: &Ui, of: &Response, name: (&str, usize), at: Pos2) -> Response {
    let rect = Rect::from_center_size(at, Vec2::splat(2.0 * RADIUS + 2.0));
    ui.interact(rect, of.id.with(name), Sense::click_and_drag())
}

/// Shows the strip of colours with its stops. Returns true while a drag goes on.
fn colours(app: &mut App, curve: &mut Curve, ui: &mut Ui) -> bool {
    let size = Vec2::new(ui.available_width(), STRIP + 2.0 * RADIUS);
    let (response, painter) = ui.allocate_painter(size, Sense::click());
    let rect = response.rect.shrink2(Vec2::new(RADIUS, 0.0));
    let strip = Rect::from_min_size(rect.min, Vec2::new(rect.width(), STRIP));
    if let Some(history) = app.histories.get(app.edited).and_then(Option::as_ref) {
        const PARTS: u16 = 128;
        let width = strip.width() / f32::from(PARTS);
        for i in 0..PARTS {
            let value = curve.value((f32::from(i) + 0.5) / f32::from(PARTS));
            let position = history.function().value_scale().position(value);
            let [r, g, b, _] = history.function().classify(position);
            let [r, g, b] = [r, g, b].map(|c| byte(srgb_from_linear(c)));
            let left = strip.left() + f32::from(i) * width;
            let part =
                Rect::from_min_size(Pos2::new(left, strip.top()), Vec2::new(width + 0.5, STRIP));
            painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
        }
    }
    let mut goes_on = false;
    let mut left_out = None;
    for i in 0..curve.colours.len() {
        let at = |curve: &Curve| {
            let x = strip.left() + curve.share(curve.colours[i].0) * strip.width();
            Pos2::new(x, strip.bottom() + RADIUS)
        };
        let stop = handle(ui, &response, ("stop", i), at(curve));
        let label = format!("colour at {:.4}", curve.colours[i].0);
        stop.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, &label));
        if stop.dragged()
            && let Some(pos) = stop.interact_pointer_pos()
        {
            curve.move_colour(i, (pos.x - strip.left()) / strip.width());
            goes_on = !stop.drag_started();
        }
        if stop.clicked() {
            app.stop = Some(i);
        }
        if stop.secondary_clicked() && curve.colours.len() > 1 {
            left_out = Some(i);
        }
        let is_chosen = app.stop == Some(i);
        let edge = if is_chosen {
            Color32::YELLOW
        } else {
            Color32::WHITE
        };
        painter.circle_stroke(at(curve), RADIUS - 1.0, Stroke::new(2.0, edge));
        stop.on_hover_text(
            label + "\ndrag moves it, click edits its colour, right click takes it out",
        );
    }
    if let Some(i) = left_out {
        curve.colours.remove(i);
        app.stop = None;
    }
    if response.double_clicked()
        && let Some(pos) = response.interact_pointer_pos()
    {
        curve.add_colour((pos.x - strip.left()) / strip.width());
    }
    let tip = "Colour of each value, from the lower end of the range to the upper one\n--transfer-function FILE|NAME";
    response.on_hover_text(tip);
    if let Some(i) = app.stop
        && let Some((value, colour)) = curve.colours.get_mut(i)
    {
        let tip = "The colour of the stop that was clicked, sRGB, and its value";
        group(ui, "Stop", tip, |ui, row| {
            let [r, g, b] = colour.map(byte);
            let mut bytes = [r, g, b];
            if row.of(ui.color_edit_button_srgb(&mut bytes)).changed() {
                *colour = bytes.map(|c| f32::from(c) / 255.0);
            }
            row.tells(ui.label(format!("at {value:.5}")));
        });
    }
    goes_on
}

/// Converts a number from 0 to 1 to a byte.
fn byte(share: f32) -> u8 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "held to what a byte holds"
    )]
    {
        (share.clamp(0.0, 1.0) * 255.0).round() as u8
    }
}

/// Shows the ends of the range. Returns true while a drag goes on.
fn range(curve: &mut Curve, ui: &mut Ui) -> bool {
    let mut ends = curve.range;
    let speed = (ends[1] - ends[0]) / 300.0;
    let mut goes_on = false;
    let tip = "The values at the ends, with points and stops between them, and how values lie there\n--range LO,HI";
    group(ui, "Range", tip, |ui, row| {
        for end in &mut ends {
            let field = ui.add(DragValue::new(end).speed(speed).max_decimals(9));
            let field = row.of(field);
            goes_on |= field.dragged() && !field.drag_started();
        }
        row.tells(ui.label(curve.scale_name().name()));
    });
    if ends != curve.range {
        curve.set_range(ends);
    }
    goes_on
}

/// Shows the buttons of undo and of the clipboard.
fn buttons(app: &mut App, curve: &mut Curve, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let (can_undo, can_redo) = app
            .history()
            .map_or((false, false), |h| (h.can_undo(), h.can_redo()));
        if button_if(ui, can_undo, "Undo", "Take the last edit back (ctrl+Z)")
            && let Some(history) = app.history()
        {
            history.undo();
            *curve = history.curve().clone();
        }
        if button_if(ui, can_redo, "Redo", "Make it again (ctrl+Y)")
            && let Some(history) = app.history()
        {
            history.redo();
            *curve = history.curve().clone();
        }
        let tip = "Put the transfer function on the clipboard, as JSON\n--transfer-function FILE";
        if button(ui, "Copy JSON", tip) {
            ui.ctx().copy_text(curve.to_json());
            app.say("the transfer function is on the clipboard".into());
        }
    });
    let tip = "Show the histogram's counts by their logarithm";
    switch(ui, "Log histogram", tip, &mut app.logarithmic_counts);
}

/// Replaces the colours by those of a named map.
fn map(app: &mut App, curve: &mut Curve, ui: &mut Ui) {
    let mut chosen = None;
    let tip =
        "A colour map in place of the colours above; opacities stay\n--transfer-function NAME";
    let shown = app.automatic.map.as_deref().unwrap_or("automatic");
    row(ui, "Colour map", tip, |ui| {
        list(ui, "Colour map", shown, |ui| {
            for name in COLOUR_MAP_NAMES {
                if ui.selectable_label(false, name).clicked() {
                    chosen = Some(name);
                }
            }
        })
    });
    if let Some(name) = chosen
        && let Some(function) = of_map(name, curve)
        && let Some(mapped) = Curve::of(&function)
    {
        curve.colours = mapped.colours;
        app.automatic.map = Some(name.to_owned());
        app.stop = None;
    }
}

/// Shows the choice of a transfer function from the values: a scale, a changed range, a chosen map.
fn automatic(app: &mut App, curve: &Curve, ui: &mut Ui) {
    const SCALES: [Choice<'_, Option<ScaleName>>; 4] = [
        (
            "automatic",
            None,
            "Logarithmic where positive values lie over decades, otherwise linear",
        ),
        ("linear", Some(ScaleName::Linear), "Evenly\n--scale linear"),
        (
            "log",
            Some(ScaleName::Log),
            "By their logarithm: positive values alone\n--scale log",
        ),
        (
            "symlog",
            Some(ScaleName::Symlog),
            "By their logarithm, on either side of 0\n--scale symlog",
        ),
    ];
    ui.separator();
    let tip =
        "How values lie between the ends of the range, once Automatic is pressed\n--scale SCALE";
    choose(ui, "Scale", tip, &mut app.automatic.scale, &SCALES);
    let tip = "Find opacities and colours from the values, by this scale, the colour map and a range that was edited; in \
               place of all edits. Reads the files again\n--transfer-function NAME, --range, --scale";
    if button(ui, "Automatic", tip) {
        if let Some(history) = app.history()
            && history.first_range() != curve.range
        {
            app.automatic.range = Some(curve.range);
        }
        app.find_functions();
    }
}

/// Returns the colours of a map over the range of a curve.
fn of_map(name: &str, curve: &Curve) -> Option<TransferFunction> {
    let ends = ewa_splat::scene::Values::from(curve.range.to_vec());
    let places = [glam::DVec3::ZERO, glam::DVec3::X];
    let sample = ValueSample::of_body(&ends, &[1.0; 2], &places);
    let options = AutomaticOptions {
        colour_map: Some(name),
        range: Some(curve.range),
        scale: Some(curve.scale_name()),
        ..AutomaticOptions::default()
    };
    TransferFunction::automatic(&sample, &options).ok()
}
