//! Runs `ewa-splat render`.
//!
//! | file | contents |
//! |---|---|
//! | `options.rs` | the options |
//! | `settings.rs` | options as settings |
//! | `check.rs` | refusals |
//! | `scene.rs` | the scene, loaded and sorted into blocks |
//! | `projection.rs` | panoramas |
//! | `exposure.rs`, `exposed.rs` | lens and shutter |
//! | `backdrop.rs` | what stands in the picture already |
//! | `shown.rs` | the scene of a picture, for other commands |
//! | `image.rs` | one picture |
//! | `sequence.rs` | sequences of pictures |
//! | `reference.rs` | the reference image |
//! | `column.rs`, `column_mean.rs` | column densities, means along rays |
//! | `count.rs` | counts of kernels in words |
//! | `ending.rs`, `written.rs` | pictures written with their records, or compared |
//! | `tiles.rs` | the tiles of two pictures compared |

mod backdrop;
mod check;
mod column;
mod column_mean;
mod count;
mod ending;
mod exposed;
mod exposure;
mod image;
mod options;
mod projection;
mod reference;
mod scene;
mod sequence;
mod settings;
mod shown;
mod tiles;
mod written;

use std::time::Instant;

use self::column::Columns;
pub(super) use self::ending::Ending;
use self::ending::{Facts, LastFacts};
use self::exposed::Sequence;
use self::image::{Picture, blend_of};
pub(super) use self::options::{Arguments, BackendName};
use self::scene::ReadyScene;
pub(super) use self::shown::Shown;
pub(super) use self::tiles::{Comparison, DEFAULT_TILES, Found};
use super::annotations::Overlays;
use super::progress::{note, spinner, task_of};
use super::ranks;
use super::statistics::Prepared;
use crate::opened;
use crate::view::Camera;
use crate::{Result, Settings};

pub(crate) fn run(arguments: &mut Arguments) -> Result<()> {
    let begun = Instant::now();
    opened::start();
    let mut ranks = arguments.mpi.then(ranks::start).transpose()?;
    let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
    let checked = arguments.check(is_first);
    match &mut ranks {
        Some(ranks) => ranks.agree(checked)?,
        None => checked?,
    }
    let arguments = &*arguments;
    // The spinner is hidden if standard error is no terminal.
    let progress = spinner();

    let task = task_of(&progress);

    let options = arguments.sample_options(task.clone());
    if arguments.sequence.is_series() {
        return arguments.draw_series(&options, &progress, ranks);
    }
    let made = arguments.made(&options, &progress, &mut ranks);
    let ReadyScene {
        renderer,
        cameras,
        legend,
        boxes,
        up,
        bounds,
        fields,
        smoothing,
        mean,
        truth,
        read_ms,
        refined,
        prepare_start,
    } = match &mut ranks {
        Some(ranks) => ranks.agree(made)?,
        None => made?,
    };
    if is_first {
        arguments.begin_record();
    }
    let is_column = arguments.method.column_density;
    let camera = cameras[0].clone();
    let is_sequence = arguments.sequence.is_asked_for();
    let mut renderer = match ranks.take_if(|_| !is_sequence) {
        Some(ranks) => renderer.over_ranks(ranks)?,
        // A rank draws on its CPU: one node may run several ranks but have one GPU.
        None if ranks.is_some() || renderer.rank().is_some() => renderer,
        None => {
            let backend = arguments.backend(&renderer, &camera);
            renderer.on(backend.open()?)?
        }
    };
    let prepare_ms = prepare_start.elapsed().as_secs_f64() * 1e3;
    let prepared = Prepared {
        begun,
        read_ms,
        prepare_ms,
        refined,
    };
    let annotations = arguments.annotations.at(&arguments.inputs);
    let overlays = Overlays::new(&annotations, legend.clone(), bounds, &camera)?;
    if is_column {
        let beside = |room_px| arguments.column_camera(&boxes, up, room_px);
        let over = |camera: &Camera| Overlays::new(&annotations, Vec::new(), bounds, camera);
        let columns = Columns {
            renderer: &mut renderer,
            fields: &fields,
            smoothing,
            mean,
            beside: &beside,
            overlays: &over,
        };
        return arguments.draw_column(columns, &camera, prepared, &progress);
    }
    let suitable = renderer.suitable_low_pass_px2();
    let low_pass = arguments.method.low_pass.unwrap_or(suitable);
    if let Some(truth) = truth {
        progress.finish_and_clear();
        return arguments.integrate(truth, &camera, low_pass, &overlays, prepared);
    }
    let settings = Settings {
        backdrop: arguments.backdrop.given.seen_by(&camera)?,
        ..arguments.settings(low_pass)
    };
    let blend = blend_of(&renderer, &settings)?;
    if let Some(note) = blend.note().filter(|_| is_first) {
        progress.suspend(|| note!("{note}"));
    }
    if is_sequence {
        let facts = LastFacts::default();
        let sequence = Sequence {
            cameras: &cameras,
            is_closed: arguments.sequence.is_closed(),
            boxes: &boxes,
        };
        let mut draw = |n: usize| {
            let camera = &cameras[n];
            let over = Overlays::new(&annotations, legend.clone(), bounds, camera)?;
            let image = arguments.exposed(&mut renderer, &sequence, n, &settings)?;
            let image = over.drawn(image)?.into_owned();
            *facts.borrow_mut() = Facts::of(&renderer, settings.tolerance);
            Ok(image)
        };
        return arguments.draw_all(&cameras, &mut draw, &facts, ranks);
    }
    let pictures = arguments.exposure.pictures(&renderer, false);
    let settings = Settings {
        aperture: arguments.aperture(&camera, &boxes, pictures)?,
        ..settings
    };
    let picture = Picture {
        renderer: &mut renderer,
        camera: &camera,
        settings,
        blend,
        overlays: &overlays,
        progress: &progress,
    };
    arguments.draw_image(picture, prepared, is_first, task)
}
