//! Times pictures in motion without a window: one turn around the data, and an edit of the transfer
//! function.

use std::time::Duration;

use ewa_splat::command::ViewRequest;

use crate::app::App;
use crate::controller::Coarseness;
use crate::headless::Headless;

/// Default width and height of the window: the panels leave about 1024 x 640 of it.
const SIZE: [usize; 2] = [1620, 660];

/// Pause between two checks for a picture: a small part of a picture's time.
const PAUSE: Duration = Duration::from_micros(500);

/// Runs passes until a condition holds, and returns the time that this took.
fn until(window: &mut Headless, holds: impl Fn(&App) -> bool) -> Result<Duration, String> {
    // The interface itself is not drawn.
    window.until(holds, |mut output| output.textures_delta.clear())
}

/// Plays the turn and the edit, each of `count` pictures, and reports their times.
///
/// # Errors
/// The error that the window shows.
pub(crate) fn play(request: ViewRequest, count: u32) -> Result<String, String> {
    let size = request.size().unwrap_or(SIZE);
    let mut window = Headless::new(request, size, PAUSE);
    let first = until(&mut window, App::has_drawn)?;
    let mut rests = [Duration::ZERO; 2];
    settle(&mut window, &mut rests)?;
    let [width, height] = window.app.size;
    let mut text = format!("{width} x {height} pixels\nread and first drawn in {first:.2?}\n");
    let turn = std::f64::consts::TAU / f64::from(count);
    let mut turned = Vec::new();
    for _ in 0..count {
        if let Some(orbit) = &mut window.app.orbit {
            orbit.turn(turn, 0.0);
        }
        turned.push(until(&mut window, App::has_drawn)?);
    }
    text += &said("turn", &mut turned, &window.app);
    settle(&mut window, &mut rests)?;
    if window.app.history().is_some() {
        let mut edited = Vec::new();
        for i in 0..count {
            if let Some(history) = window.app.history() {
                let mut curve = history.curve().clone();
                let middle = curve.opacities.len() / 2;
                let (value, opacity) = curve.opacities[middle];
                let share = curve.share(value);
                let step = if i % 2 == 0 { 0.05 } else { -0.05 };
                curve.move_opacity(middle, share, opacity + step);
                let edited = history.edit(curve, true);
                edited.map_err(|error| error.to_string())?;
            }
            edited.push(until(&mut window, App::has_drawn)?);
        }
        text += &said("edit", &mut edited, &window.app);
        settle(&mut window, &mut rests)?;
    }
    let [whole, measured] = rests;
    text +=
        &format!("rest: whole after {whole:.2?}, its error after {measured:.2?}, at the longest\n");
    Ok(text)
}

/// Waits for the full picture and for its error, and keeps the longest times since the last change.
fn settle(window: &mut Headless, longest: &mut [Duration; 2]) -> Result<(), String> {
    let whole = until(window, App::is_whole)?;
    let measured = whole + until(window, App::is_at_rest)?;
    *longest = [longest[0].max(whole), longest[1].max(measured)];
    Ok(())
}

/// Reports the distribution of times, and the coarseness of the last picture.
fn said(what: &str, times: &mut [Duration], app: &App) -> String {
    times.sort();
    let at = |share: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a place among them"
        )]
        let i = (share * (times.len() - 1) as f64).round() as usize;
        times[i]
    };
    let sum: Duration = times.iter().sum();
    let rate = times.len() as f64 / sum.as_secs_f64();
    let coarse = app.drawn.as_ref().map(|drawn| drawn.coarseness);
    let coarse = coarse.unwrap_or(Coarseness::none(0.0));
    let tolerance = coarse.tolerance;
    format!(
        "{what}: {rate:.1} pictures a second; least {:.1?}, half {:.1?}, 95 % {:.1?}, greatest {:.1?}; \
         {:.0} % of the pixels at a tolerance of {tolerance:.1e}, {:.1e} for what is merged\n",
        times[0],
        at(0.5),
        at(0.95),
        at(1.0),
        100.0 * coarse.share,
        tolerance * coarse.merge_slack,
    )
}
