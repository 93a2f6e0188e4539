//! Handles keys, unless a text field has the focus.

use egui::{Context, Event, Key, Modifiers};
use glam::DVec3;

use super::camera;
use crate::app::App;
use crate::dialogs::Purpose;

/// Speed of flight, distances to the target per second.
const FLIGHT: f64 = 0.6;

pub(crate) fn answer(app: &mut App, context: &Context) {
    if context.text_edit_focused() {
        return;
    }
    let pressed = |key| context.input(|input| input.key_pressed(key));
    let with = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
    if with(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || with(Modifiers::COMMAND, Key::Y) {
        if let Some(history) = app.history() {
            history.redo();
        }
    } else if with(Modifiers::COMMAND, Key::Z)
        && let Some(history) = app.history()
    {
        history.undo();
    }
    if with(Modifiers::COMMAND, Key::O) {
        app.dialogs.ask(Purpose::Open, context);
    }
    let pasted = context.input(|input| {
        input.events.iter().find_map(|event| match event {
            Event::Paste(text) => Some(text.clone()),
            _ => None,
        })
    });
    if let Some(text) = pasted {
        camera::paste(app, &text);
    }
    if pressed(Key::C) {
        camera::copy(app, context);
    }
    if pressed(Key::H) {
        app.orbit.clone_from(&app.home);
    }
    if pressed(Key::O)
        && let Some(orbit) = &mut app.orbit
    {
        orbit.change_lens();
    }
    if pressed(Key::K) {
        super::path::add(app);
    }
    if pressed(Key::F) {
        app.flies = !app.flies;
    }
    if pressed(Key::Tab) {
        app.shows_panels = !app.shows_panels;
    }
    if pressed(Key::F5) {
        app.load();
    }
    if pressed(Key::Escape) {
        if app.shows_help {
            app.shows_help = false;
        } else if app.progress.is_some() {
            app.cancel();
        }
    }
    if pressed(Key::Questionmark) || pressed(Key::F1) {
        app.shows_help = !app.shows_help;
    }
    let numbers = [
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Num5,
        Key::Num6,
    ];
    for (key, (_, forward)) in numbers.into_iter().zip(camera::VIEWS) {
        if pressed(key) {
            app.look_along(forward);
        }
    }
    steer(app, context);
}

/// Turns the view with the arrow keys; in flight, moves with W, A, S, D, Q and E.
fn steer(app: &mut App, context: &Context) {
    let down = |key| context.input(|input| input.key_down(key));
    let axis = |less, more| f64::from(u8::from(down(more))) - f64::from(u8::from(down(less)));
    let seconds = f64::from(context.input(|input| input.stable_dt.min(0.1)));
    let turn = [
        axis(Key::ArrowRight, Key::ArrowLeft),
        axis(Key::ArrowDown, Key::ArrowUp),
    ];
    let step = match app.flies {
        true => DVec3::new(
            axis(Key::A, Key::D),
            axis(Key::Q, Key::E),
            axis(Key::S, Key::W),
        ),
        false => DVec3::ZERO,
    };
    let Some(orbit) = &mut app.orbit else {
        return;
    };
    if turn != [0.0; 2] {
        let [around, over] = turn.map(|t| t * seconds);
        match app.flies {
            true => orbit.look(around, over),
            false => orbit.turn(-around, over),
        }
        context.request_repaint();
    }
    if step != DVec3::ZERO {
        orbit.fly(step * FLIGHT * seconds);
        context.request_repaint();
    }
}
