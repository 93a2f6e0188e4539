//! Reports the progress of long work, and cancels it.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};
use crate::parallel;

/// A handle on work that can take seconds. The holder of a clone may cancel the work from any thread; an
/// observer receives its progress.
///
/// The options of long work have a field for it: [`SampleOptions::task`](crate::sample::SampleOptions::task),
/// [`SceneOptions::task`](crate::SceneOptions::task), [`Settings::task`](crate::Settings::task) and others.
/// Cancelled work finishes its current step, a tile of a frame or some thousand particles, then returns
/// [`Error::Cancelled`]. It leaves everything unchanged except a renderer's pictures. A cancelled task stays
/// cancelled: later work needs a new one.
///
/// ```
/// use ewa_splat::sample::{SampleOptions, points};
/// use ewa_splat::{Error, Task};
/// use glam::DVec3;
///
/// let task = Task::observed(|progress| println!("{progress}"));
/// let options = SampleOptions { task: Some(task.clone()), ..SampleOptions::default() };
/// let work = std::thread::spawn(move || {
///     let positions: Vec<DVec3> = (0..10_000).map(|i| DVec3::X * f64::from(i)).collect();
///     points(positions, vec![1.0_f32; 10_000], &options)
/// });
/// task.cancel();
/// assert!(matches!(work.join().unwrap(), Ok(_) | Err(Error::Cancelled)));
/// ```
#[derive(Clone, Default)]
pub struct Task(Arc<Shared>);

type Observer = dyn Fn(Progress) + Send + Sync;
type Asked = dyn Fn() -> bool + Send + Sync;

#[derive(Default)]
struct Shared {
    is_cancelled: AtomicBool,
    observer: Option<Box<Observer>>,
    asked: Option<Box<Asked>>,
}

/// Progress of work.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Progress {
    /// Current stage, in words: "finding neighbours". Work may have several stages, one after the other.
    pub stage: &'static str,
    /// Finished share of this stage, 0 to 1. Threads that finish at the same time may report in a different
    /// order.
    pub done: f64,
}

impl Task {
    /// Makes a task without an observer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes a task whose observer is called at each stage's start and at every thousandth of it, from any
    /// thread. The work waits for the observer.
    pub fn observed(observer: impl Fn(Progress) + Send + Sync + 'static) -> Self {
        Self(Arc::new(Shared {
            observer: Some(Box::new(observer)),
            ..Shared::default()
        }))
    }

    /// Makes a task that asks whether it is cancelled: for work whose thread receives nothing until the work ends.
    ///
    /// - `asked`: returns true once the work is to end. Called from any thread, often: for each tile of a frame, or for
    ///   some thousand particles.
    pub fn asking(asked: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(Shared {
            asked: Some(Box::new(asked)),
            ..Shared::default()
        }))
    }

    /// Asks the work to end as soon as it can.
    pub fn cancel(&self) {
        self.0.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Returns a task that reports to the same observer and that nothing cancels.
    #[cfg(feature = "prepared")]
    pub(crate) fn without_cancel(&self) -> Self {
        let own = self.clone();
        match own.0.observer {
            None => Self::new(),
            Some(_) => Self::observed(move |progress| {
                if let Some(observer) = &own.0.observer {
                    observer(progress);
                }
            }),
        }
    }

    /// Returns true if the task has been cancelled.
    pub fn is_cancelled(&self) -> bool {
        let is_cancelled =
            self.was_cancelled() || self.0.asked.as_ref().is_some_and(|asked| asked());
        if is_cancelled {
            self.cancel();
        }
        is_cancelled
    }

    /// Returns true if the task was cancelled, without asking.
    #[inline]
    fn was_cancelled(&self) -> bool {
        self.0.is_cancelled.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Task")
            .field("is_cancelled", &self.was_cancelled())
            .finish_non_exhaustive()
    }
}

/// Tasks are equal if they are the same: cancelling one cancels the other.
impl PartialEq for Task {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {:.0} %", self.stage, 100.0 * self.done)
    }
}

/// Returns [`Error::Cancelled`] if the task is cancelled.
pub(crate) fn check(task: Option<&Task>) -> Result<()> {
    match task {
        Some(task) if task.is_cancelled() => Err(Error::Cancelled),
        _ => Ok(()),
    }
}

/// A stage of the work, with a number of equal steps.
#[derive(Debug)]
pub(crate) struct Stage<'a> {
    task: Option<&'a Task>,
    name: &'static str,
    steps: usize,
    done: AtomicUsize,
}

impl<'a> Stage<'a> {
    /// Number of items that are counted at a time: large enough for a counter that all threads share.
    pub(crate) const GRAIN: usize = 1024;

    /// Begins a stage, and reports that.
    pub(crate) fn new(task: Option<&'a Task>, name: &'static str, steps: usize) -> Self {
        let stage = Self {
            task,
            name,
            steps: steps.max(1),
            done: AtomicUsize::new(0),
        };
        stage.tell(0);
        stage
    }

    /// Returns true until the task is cancelled.
    pub(crate) fn goes_on(&self) -> bool {
        self.task.is_none_or(|task| !task.is_cancelled())
    }

    /// Counts finished steps.
    pub(crate) fn advance(&self, steps: usize) {
        if self.task.is_none() {
            return;
        }
        let before = self.done.fetch_add(steps, Ordering::Relaxed);
        let thousandths = |done: usize| done as u128 * 1000 / self.steps as u128;
        if thousandths(before) != thousandths(before + steps) {
            self.tell(before + steps);
        }
    }

    /// Counts item `i` of as many items as there are steps; any thread may count each item once. Returns false
    /// if the task is cancelled.
    #[inline]
    pub(crate) fn counts(&self, i: usize) -> bool {
        let Some(task) = self.task else {
            return true;
        };
        if i.is_multiple_of(Self::GRAIN) {
            self.advance(Self::GRAIN.min(self.steps - i.min(self.steps)));
            return !task.is_cancelled();
        }
        !task.was_cancelled()
    }

    /// Reports the finished share, 0 to 1, of a stage whose steps cannot be counted; it has a thousand steps.
    /// The reported progress never decreases.
    pub(crate) fn reach(&self, share: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of the steps"
        )]
        let steps = (share.clamp(0.0, 1.0) * self.steps as f64) as usize;
        if self.done.fetch_max(steps, Ordering::Relaxed) < steps {
            self.tell(steps);
        }
    }

    /// Returns an error if the task is cancelled.
    pub(crate) fn check(&self) -> Result<()> {
        check(self.task)
    }

    fn tell(&self, done: usize) {
        if let Some(observer) = self.task.and_then(|task| task.0.observer.as_ref()) {
            observer(Progress {
                stage: self.name,
                done: (done as f64 / self.steps as f64).min(1.0),
            });
        }
    }
}

/// Collects `of(0)`, `of(1)`, ... `of(count - 1)` in parallel, as a stage with that many steps.
///
/// # Errors
/// Work that was cancelled.
pub(crate) fn collect<T: Send>(
    task: Option<&Task>,
    name: &'static str,
    count: usize,
    of: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>> {
    /// Least number of steps between checks for cancellation: smaller batches wait too often for their last
    /// thread.
    const BATCH: usize = 4096;
    if task.is_none() {
        return Ok(parallel::map(count, of));
    }
    let stage = Stage::new(task, name, count);
    let batch = BATCH.max(count / 100);
    let mut all = Vec::with_capacity(count);
    for first in (0..count).step_by(batch) {
        stage.check()?;
        let own = batch.min(count - first);
        all.append(&mut parallel::map(own, |i| of(first + i)));
        stage.advance(own);
    }
    stage.check()?;
    Ok(all)
}

/// Fills an array in parallel, as a stage with one step per entry. `fill` receives the index of a piece's first
/// entry, and the piece.
///
/// # Errors
/// Work that was cancelled.
pub(crate) fn fill<T: Send>(
    task: Option<&Task>,
    name: &'static str,
    entries: &mut [T],
    fill: impl Fn(usize, &mut [T]) + Sync,
) -> Result<()> {
    let stage = Stage::new(task, name, entries.len());
    parallel::chunks(entries, Stage::GRAIN, |n, piece| {
        let first = n * Stage::GRAIN;
        if stage.counts(first) {
            fill(first, piece);
        }
    });
    stage.check()
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn stages_tell_how_far_they_are() {
        let reported = Arc::new(Mutex::new(Vec::new()));
        let listener = Arc::clone(&reported);
        let task = Task::observed(move |progress| listener.lock().unwrap().push(progress));
        let squares = collect(Some(&task), "squares", 10_000, |i| i * i).unwrap();
        assert_eq!(squares, (0..10_000).map(|i| i * i).collect::<Vec<_>>());
        let reported: Vec<f64> = reported.lock().unwrap().iter().map(|p| p.done).collect();
        assert_eq!(reported, [0.0, 0.4096, 0.8192, 1.0]);
        // With many small steps, not every step is reported.
        let count = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&count);
        let task = Task::observed(move |_| {
            counter.fetch_add(1, Ordering::Relaxed);
        });
        let stage = Stage::new(Some(&task), "steps", 1_000_000);
        (0..1_000_000).for_each(|_| stage.advance(1));
        assert_eq!(count.load(Ordering::Relaxed), 1001);
    }

    #[test]
    fn cancelled_work_ends() {
        let task = Task::new();
        let asked = AtomicUsize::new(0);
        let result = collect(Some(&task.clone()), "numbers", 100_000, |i| {
            asked.fetch_add(1, Ordering::Relaxed);
            if i == 5000 {
                task.cancel();
            }
            i
        });
        assert!(matches!(result, Err(Error::Cancelled)));
        // Work ended with the second batch, which was running.
        assert_eq!(asked.load(Ordering::Relaxed), 8192);
        assert_eq!(task, task.clone());
        assert_ne!(task, Task::new());
    }

    #[test]
    fn work_that_asks_ends_once_the_answer_is_yes() {
        let count = Arc::new(AtomicUsize::new(0));
        let questions = Arc::clone(&count);
        let task = Task::asking(move || questions.fetch_add(1, Ordering::Relaxed) >= 2);
        let result = collect(Some(&task), "numbers", 100_000, |i| i);
        assert!(matches!(result, Err(Error::Cancelled)));
        // It is not asked again.
        assert!(task.is_cancelled() && task.was_cancelled());
        assert_eq!(count.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn arrays_are_filled_in_pieces() {
        let mut entries = vec![0; 5000];
        let task = Task::new();
        let number = |first: usize, piece: &mut [usize]| {
            for (i, entry) in piece.iter_mut().enumerate() {
                *entry = first + i;
            }
        };
        fill(Some(&task), "numbers", &mut entries, number).unwrap();
        assert_eq!(entries, (0..5000).collect::<Vec<_>>());
        task.cancel();
        let nothing = |_: usize, _: &mut [usize]| panic!("it was cancelled");
        let result = fill(Some(&task), "numbers", &mut entries, nothing);
        assert!(matches!(result, Err(Error::Cancelled)));
    }
}
