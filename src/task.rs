//! Progress of long work, and its end before its time.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};

/// A handle on work that can take seconds: whoever holds a clone of it may cancel the work, from any
/// thread, and its observer is told how far the work is.
///
/// The options of long work take one: [`SampleOptions::task`](crate::sample::SampleOptions::task),
/// [`SceneOptions::task`](crate::SceneOptions::task), [`Settings::task`](crate::Settings::task) and others.
/// Cancelled work ends with [`Error::Cancelled`] after what it has in hand, a tile of a frame or some thousand
/// particles, and leaves everything as it was but the pictures of a renderer. A task that has been
/// cancelled stays so: later work takes a new one.
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

#[derive(Default)]
struct Shared {
    is_cancelled: AtomicBool,
    observer: Option<Box<Observer>>,
}

/// How far work is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Progress {
    /// What is being done, in words: "finding neighbours". One piece of work has several stages, one after the
    /// other.
    pub stage: &'static str,
    /// How much of this stage is done, 0 to 1. Threads that finish at the same time may tell it in
    /// another order.
    pub done: f64,
}

impl Task {
    /// A task that nobody watches.
    pub fn new() -> Self {
        Self::default()
    }

    /// A task whose observer is told of each stage's start and of every thousandth of it, from any thread. The
    /// work waits for it.
    pub fn observed(observer: impl Fn(Progress) + Send + Sync + 'static) -> Self {
        Self(Arc::new(Shared {
            is_cancelled: AtomicBool::new(false),
            observer: Some(Box::new(observer)),
        }))
    }

    /// Lets the work end as soon as it can.
    pub fn cancel(&self) {
        self.0.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether it has been cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.0.is_cancelled.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Task")
            .field("is_cancelled", &self.is_cancelled())
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

/// [`Error::Cancelled`] where the task is.
pub(crate) fn check(task: Option<&Task>) -> Result<()> {
    match task {
        Some(task) if task.is_cancelled() => Err(Error::Cancelled),
        _ => Ok(()),
    }
}

/// A part of the work, of so many equal steps.
#[derive(Debug)]
pub(crate) struct Stage<'a> {
    task: Option<&'a Task>,
    name: &'static str,
    steps: usize,
    done: AtomicUsize,
}

impl<'a> Stage<'a> {
    /// Items that are counted at a time: few enough for a counter that all threads share.
    pub(crate) const GRAIN: usize = 1024;

    /// Tells that it begins.
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

    /// Whether there is still something to do.
    pub(crate) fn goes_on(&self) -> bool {
        self.task.is_none_or(|task| !task.is_cancelled())
    }

    /// Counts steps that are done.
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

    /// Counts item `i` of as many items as there are steps, each counted once by any thread, and says whether it
    /// is still to be done.
    #[inline]
    pub(crate) fn counts(&self, i: usize) -> bool {
        let Some(task) = self.task else {
            return true;
        };
        if i.is_multiple_of(Self::GRAIN) {
            self.advance(Self::GRAIN.min(self.steps - i.min(self.steps)));
        }
        !task.is_cancelled()
    }

    /// Tells how much of it is done, 0 to 1, where steps cannot be counted; it has a thousand steps then. Never
    /// goes back.
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

    /// What it ends with.
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

/// What `of` makes of 0, 1, ... `count` - 1, in parallel: a stage of as many steps.
///
/// # Errors
/// Cancelled.
pub(crate) fn collect<T: Send>(
    task: Option<&Task>,
    name: &'static str,
    count: usize,
    of: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>> {
    /// Steps between questions at least: fewer do not repay waiting for the last thread.
    const BATCH: usize = 4096;
    if task.is_none() {
        return Ok((0..count).into_par_iter().map(&of).collect());
    }
    let stage = Stage::new(task, name, count);
    let batch = BATCH.max(count / 100);
    let mut all = Vec::with_capacity(count);
    for first in (0..count).step_by(batch) {
        stage.check()?;
        let end = count.min(first + batch);
        all.par_extend((first..end).into_par_iter().map(&of));
        stage.advance(end - first);
    }
    stage.check()?;
    Ok(all)
}

/// Fills an array in parallel: `fill` is given pieces of it, and the place of the first entry of each. A stage of as
/// many steps as there are entries.
///
/// # Errors
/// Cancelled.
pub(crate) fn fill<T: Send>(
    task: Option<&Task>,
    name: &'static str,
    entries: &mut [T],
    fill: impl Fn(usize, &mut [T]) + Sync,
) -> Result<()> {
    let stage = Stage::new(task, name, entries.len());
    let pieces = entries.par_chunks_mut(Stage::GRAIN).enumerate();
    pieces.for_each(|(n, piece)| {
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
        let told = Arc::new(Mutex::new(Vec::new()));
        let listener = Arc::clone(&told);
        let task = Task::observed(move |progress| listener.lock().unwrap().push(progress));
        let squares = collect(Some(&task), "squares", 10_000, |i| i * i).unwrap();
        assert_eq!(squares, (0..10_000).map(|i| i * i).collect::<Vec<_>>());
        let told: Vec<f64> = told.lock().unwrap().iter().map(|p| p.done).collect();
        assert_eq!(told, [0.0, 0.4096, 0.8192, 1.0]);
        // Of many small steps not all are told.
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
        // The batch in hand was the second.
        assert_eq!(asked.load(Ordering::Relaxed), 8192);
        assert_eq!(task, task.clone());
        assert_ne!(task, Task::new());
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
