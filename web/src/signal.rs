//! Cancels work: a worker receives no message while it computes, so the work asks.

use std::cell::RefCell;

use ewa_splat::Task;
use js_sys::{Date, Function};
use wasm_bindgen::prelude::*;

/// Time between two questions, ms.
const INTERVAL_MS: f64 = 15.0;

/// Work that a function of the caller may cancel.
#[derive(Debug, Clone)]
struct Asked {
    /// Returns true if the work is to end. Its argument is true while a picture is drawn, and false while data are sampled.
    function: Function,
    is_drawing: bool,
    /// Time of the last question.
    at: f64,
}

thread_local! {
    static ASKED: RefCell<Option<Asked>> = const { RefCell::new(None) };
}

/// Returns the task of a call, which asks a function now and then whether it is cancelled.
///
/// - `is_drawing`: whether the scene is ready.
pub(crate) fn task(function: Option<&Function>, is_drawing: bool) -> Task {
    let asked = function.map(|function| Asked {
        function: function.clone(),
        is_drawing,
        at: Date::now(),
    });
    ASKED.set(asked);
    match function {
        None => Task::new(),
        Some(_) => Task::asking(is_cancelled),
    }
}

/// Asks, if it is time.
fn is_cancelled() -> bool {
    let now = Date::now();
    let due = |asked: &mut Asked| {
        // A clock may be set back.
        let is_due = !(0.0..INTERVAL_MS).contains(&(now - asked.at));
        if is_due {
            asked.at = now;
        }
        is_due.then(|| (asked.function.clone(), asked.is_drawing))
    };
    let due = ASKED.with_borrow_mut(|asked| asked.as_mut().and_then(due));
    due.is_some_and(|(function, is_drawing)| {
        let answer = function.call1(&JsValue::NULL, &is_drawing.into());
        answer.is_ok_and(|answer| answer.is_truthy())
    })
}
