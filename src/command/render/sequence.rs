//! Draws sequences of pictures: a turn, a path of cameras, time steps.

use super::ending::{Facts, LastFacts};
use super::exposed::Sequence;
use super::image::blend_of;
use super::options::Arguments;
use super::tiles::Drawn;
use crate::collective::Collective;
use crate::command::animation::Animation;
use crate::command::annotations::Overlays;
use crate::command::progress::{bar, note};
use crate::command::viewpoint::Canvas;
use crate::command::{ranks, words};
use crate::legend::legend_width;
use crate::load::{Input, Loaded};
use crate::sample::SampleOptions;
use crate::view::{Bounds, Camera, left_of};
use crate::{Error, Image, Result, Settings};
use indicatif::ProgressBar;

impl Arguments {
    /// Draws a picture for each camera and writes them; or draws one and compares it. If there are ranks, they draw in turn.
    pub(super) fn draw_all(
        &self,
        cameras: &[Camera],
        draw: &mut dyn FnMut(usize) -> Result<Image>,
        facts: &LastFacts,
        ranks: Option<Box<dyn Collective>>,
    ) -> Result<()> {
        let count = cameras.len();
        if let Some(comparison) = self.ending.comparison() {
            let frame = comparison.frame.filter(|frame| *frame < count);
            let frame = frame.ok_or_else(|| {
                let expected = format!("the number of a picture among {count}");
                let advice = "the record is damaged";
                Error::invalid("record", "frame", expected, "none", advice)
            })?;
            let image = draw(frame)?;
            return self.end(&Drawn::Picture(&image), &facts.borrow());
        }
        let mut pushed = 0;
        let mut push = |animation: &mut Animation, image: &Image| {
            let record = self.record(&facts.borrow(), Some(pushed));
            pushed += 1;
            animation.push_with(image, record.as_deref())
        };
        let Some(mut ranks) = ranks else {
            let mut animation = self.animation(cameras)?;
            let bar = bar(count as u64).with_message("rendering");
            for n in 0..count {
                push(&mut animation, &draw(n)?)?;
                bar.inc(1);
            }
            bar.finish_and_clear();
            return animation.finish();
        };
        let is_first = ranks.rank() == 0;
        let animation = is_first.then(|| self.animation(cameras)).transpose();
        let mut animation = ranks.agree(animation)?;
        let bar = bar(count as u64).with_message("rendering");
        ranks::in_turn(&mut *ranks, count, draw, |image| {
            bar.inc(1);
            animation.as_mut().map_or(Ok(()), |own| push(own, image))
        })?;
        bar.finish_and_clear();
        ranks.agree(animation.map_or(Ok(()), Animation::finish))
    }

    /// Draws a picture of each time step, with one camera and one transfer function.
    pub(in crate::command) fn draw_series(
        &self,
        options: &SampleOptions,
        progress: &ProgressBar,
        mut ranks: Option<Box<dyn Collective>>,
    ) -> Result<()> {
        let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
        let planes = self.clip_planes();
        let whole = self.canvas();
        let steps: Vec<&[Input]> = self.inputs.chunk_by(|a, b| a.step == b.step).collect();
        let series = self.data.series(&self.inputs, options, progress);
        let series = match &mut ranks {
            Some(ranks) => ranks.agree(series)?,
            None => series?,
        };
        let options = series.of_step(options);
        let boxes = left_of(series.boxes, &planes);
        let place = |up, canvas: &Canvas| self.camera.camera(&boxes, up, canvas);
        let read = |step: &[Input]| {
            let cameras = |_: &[Bounds], up| Ok(vec![place(up, &whole)?]);
            let scene = match self.data.scene(step, &options, &cameras, progress) {
                // A time step that holds nothing gives an empty picture.
                Err(error) if error.holds_nothing() => {
                    progress.suspend(|| note!("{}; an empty picture", words::line(&error)));
                    Loaded::of_nothing()
                }
                scene => self.checked(scene?)?,
            };
            let bounds = scene.bounds();
            let legend = self.bars(&scene)?;
            Ok((scene, bounds, legend))
        };
        let shown = |step: &(Loaded, _, _)| !step.0.volumes.is_empty();
        let first = || {
            // The first step that shows something sets the width of the legend, and its transfer
            // function is written: all steps share it.
            let first = read(steps[0])?;
            let mut said = None;
            let mut rest = steps.iter().skip(1);
            let mut own = &first;
            while !shown(own)
                && let Some(step) = rest.next()
            {
                own = said.insert(read(step)?);
            }
            let (scene, _, legend) = own;
            if is_first {
                self.write_function(&scene.volumes)?;
            }
            let room_px = legend_width(legend, whole.size());
            let camera = place(series.up, &Canvas { room_px, ..whole })?;
            Ok((first, camera))
        };
        let first = first();
        let (first, camera) = match &mut ranks {
            Some(ranks) => ranks.agree(first)?,
            None => first?,
        };
        let mut first = Some(first);
        let is_alone = ranks.is_none();
        let scene_options = self.scene_options(&options);
        let facts = LastFacts::default();
        let mut draw = |n: usize| {
            let (mut scene, bounds, legend) = match first.take_if(|_| n == 0) {
                Some(first) => first,
                None => read(steps[n])?,
            };
            let mut renderer = scene.renderer(&scene_options)?;
            if is_alone {
                let backend = self.backend(&renderer, &camera);
                renderer = renderer.on(backend.open()?)?;
            }
            let suitable = renderer.suitable_low_pass_px2();
            let settings = Settings {
                task: options.task.clone(),
                ..self.settings(self.method.low_pass.unwrap_or(suitable))
            };
            let blend = blend_of(&renderer, &settings)?;
            if let Some(note) = blend.note().filter(|_| n == 0) {
                progress.suspend(|| note!("{note}"));
            }
            let sequence = Sequence {
                cameras: std::slice::from_ref(&camera),
                is_closed: false,
                boxes: &boxes,
            };
            let image = self
                .exposed(&mut renderer, &sequence, 0, &settings)?
                .clone();
            *facts.borrow_mut() = Facts::of(&renderer, settings.tolerance);
            let annotations = self.annotations.at(steps[n]);
            let over = Overlays::new(&annotations, legend, bounds, &camera)?;
            Ok(over.drawn(&image)?.into_owned())
        };
        let cameras = vec![camera.clone(); steps.len()];
        self.draw_all(&cameras, &mut draw, &facts, ranks)
    }

    /// Opens the output for the pictures of the cameras.
    pub(in crate::command) fn animation(&self, cameras: &[Camera]) -> Result<Animation> {
        let size = self.whole_size(&cameras[0]);
        Animation::new(&self.out, size, cameras.len(), self.sequence.rate())
    }
}
