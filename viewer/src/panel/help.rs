//! Shows a window over the picture that lists the actions of keys and mouse.

use egui::{Align2, Context, Grid, Vec2, Window};

use crate::app::App;

/// Title, and pairs of an input and its action.
type List = (&'static str, &'static [(&'static str, &'static str)]);

/// All lists; the manual has the same.
pub(crate) const LISTS: [List; 3] = [
    (
        "Mouse in the picture",
        &[
            ("drag", "turn around the target"),
            ("shift + drag, middle drag", "move along the picture"),
            ("wheel, pinch, right drag", "nearer and farther"),
            ("alt + drag", "roll"),
            ("click", "read what is there: value, position, particle"),
            ("double click", "the same, and look at it from now on"),
            ("drop a file", "show it instead"),
            (
                "drag a square of the clip box",
                "move that face along its axis",
            ),
            (
                "drag the square of the clip plane",
                "move the plane along its normal",
            ),
            ("drag the tip of its arrow", "turn the plane"),
        ],
    ),
    (
        "Mouse in the transfer function",
        &[
            ("drag a point or a stop", "move it, between its neighbours"),
            ("double click", "add a point, or a colour stop on the strip"),
            ("right click", "take a point or a stop out"),
            ("click on a stop", "edit its colour below"),
        ],
    ),
    (
        "Keys",
        &[
            ("?", "show or hide these lists"),
            ("arrows", "turn; in flight, look"),
            ("H", "the first view"),
            ("1 to 6", "look along +x, -x, +y, -y, +z, -z"),
            ("O", "perspective or orthographic"),
            ("F", "fly: W, A, S, D, Q and E move, drags look"),
            ("C, ctrl+V", "copy the camera, paste one (JSON of --camera)"),
            ("K", "add the view to the camera path"),
            ("Tab", "hide or show the panels"),
            ("ctrl+O", "open other files"),
            ("F5", "read the files again"),
            (
                "ctrl+Z, ctrl+shift+Z, ctrl+Y",
                "undo and redo of the transfer function",
            ),
            ("Escape", "close these lists; cancel what is being done"),
        ],
    ),
];

/// Shows the window, if it is switched on.
pub(crate) fn show(app: &mut App, context: &Context) {
    let window = Window::new("Keys and mouse")
        .open(&mut app.shows_help)
        .collapsible(false)
        .resizable(false)
        .vscroll(true)
        .anchor(Align2::CENTER_CENTER, Vec2::ZERO);
    window.show(context, |ui| {
        for (name, rows) in LISTS {
            ui.strong(name);
            Grid::new(name).striped(true).show(ui, |ui| {
                for (done, effect) in rows {
                    ui.label(*done);
                    ui.label(*effect);
                    ui.end_row();
                }
            });
            ui.add_space(6.0);
        }
        ui.label("Whatever the pointer rests on says what it does, and which option of the command line does the same.");
    });
}
