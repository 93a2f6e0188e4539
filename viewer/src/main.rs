//! Opens a window on data, with the options of `ewa-splat render`, in which the user turns,
//! classifies and measures them.
//!
//! [`worker`] reads and draws on a thread of its own. [`app`] holds the window's state and sends
//! requests to the worker. [`window`] lays out `panel/`, which has one file per part of the window.

mod app;
mod canvas;
mod clip;
mod controller;
mod curve;
mod dialogs;
mod handles;
mod headless;
mod histogram;
mod instead;
mod orbit;
mod output;
mod over;
mod overlay;
mod panel;
mod path;
mod probe;
mod refinable;
mod remembered;
mod replay;
mod screen;
mod screenshot;
#[cfg(test)]
mod tests;
mod time;
mod wanted;
mod watch;
mod window;
mod words;
mod worker;

use std::process::ExitCode;

use app::App;
use canvas::Canvas;
use ewa_splat::command::{ViewArguments, line};
use window::Window;

fn main() -> ExitCode {
    ewa_splat::command::quiet_drivers();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("error: {text}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let arguments = ViewArguments::parse(std::env::args_os());
    let arguments = arguments.map_err(|error| line(&error))?;
    if let Some(path) = &arguments.screenshot {
        return screenshot::write(arguments.request, path);
    }
    if let Some(count) = arguments.replay {
        print!("{}", replay::play(arguments.request, count)?);
        return Ok(());
    }
    let asked_size = arguments.request.size();
    let size = asked_size.unwrap_or([1280, 800]);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("ewa-splat")
            .with_inner_size([size[0] as f32, size[1] as f32])
            .with_drag_and_drop(true),
        // A size given on the command line is not remembered.
        persist_window: asked_size.is_none(),
        wgpu_options: canvas::options(),
        ..eframe::NativeOptions::default()
    };
    eframe::run_native(
        "ewa-splat",
        options,
        Box::new(|context| {
            // Pictures and overlays are designed for a dark background.
            context.egui_ctx.set_theme(egui::Theme::Dark);
            let canvas = Canvas::new(context.wgpu_render_state.clone());
            let mut app = App::new(arguments.request, &context.egui_ctx, canvas);
            app.recall_from(context.storage);
            app.watch.start(context.egui_ctx.clone());
            Ok(Box::new(Window(app)))
        }),
    )
    .map_err(|error| format!("opening a window: {error}; --screenshot needs no display"))
}
