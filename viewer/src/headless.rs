//! Runs the interface without a display, one pass after another.

use std::time::{Duration, Instant};

use egui::{Context, Event, FullOutput, RawInput, Rect};
use ewa_splat::command::ViewRequest;

use crate::app::App;
use crate::canvas::Canvas;
use crate::window;

/// Longest wait: no scene takes longer to be read and refined on a slow machine.
const LONGEST: Duration = Duration::from_secs(600);

/// Window without a display.
pub(crate) struct Headless {
    pub(crate) app: App,
    pub(crate) context: Context,
    size: [usize; 2],
    /// Pause between two passes.
    pause: Duration,
    begun: Instant,
}

impl Headless {
    pub(crate) fn new(request: ViewRequest, size: [usize; 2], pause: Duration) -> Self {
        let context = Context::default();
        Self {
            app: App::new(request, &context, Canvas::default()),
            context,
            size,
            pause,
            begun: Instant::now(),
        }
    }

    /// Runs one pass. The caller takes or clears the textures in its output.
    pub(crate) fn pass(&mut self) -> FullOutput {
        let [width, height] = self.size.map(|n| n as f32);
        let input = RawInput {
            screen_rect: Some(Rect::from_min_size(
                egui::Pos2::ZERO,
                egui::vec2(width, height),
            )),
            time: Some(self.begun.elapsed().as_secs_f64()),
            events: vec![Event::PointerGone],
            ..RawInput::default()
        };
        let app = &mut self.app;
        self.context.run_ui(input, |ui| window::show(app, ui))
    }

    /// Runs passes until a condition holds, and gives the output of each to `take`. Returns the
    /// time that this took.
    ///
    /// # Errors
    /// The error that the window shows; a condition that does not hold within ten minutes.
    pub(crate) fn until(
        &mut self,
        holds: impl Fn(&App) -> bool,
        mut take: impl FnMut(FullOutput),
    ) -> Result<Duration, String> {
        let begun = Instant::now();
        loop {
            take(self.pass());
            let message = self.app.message.as_ref();
            if let Some(message) = message.filter(|message| message.is_error) {
                return Err(message.text.clone());
            }
            if holds(&self.app) {
                return Ok(begun.elapsed());
            }
            if begun.elapsed() > LONGEST {
                return Err("the picture is not finished after ten minutes".into());
            }
            std::thread::sleep(self.pause);
        }
    }
}
