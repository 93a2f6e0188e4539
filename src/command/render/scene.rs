//! Loads the scene of a picture, sorts it into blocks and places the cameras.

use std::time::Instant;

use super::column_mean::ColumnMean;
use super::options::Arguments;
use crate::collective::{Alone, Collective};
use crate::command::legend::bars;
use crate::command::progress::{note, observer_of};
use crate::command::truth::{ReferenceName, Truth};
use crate::command::viewpoint::{Canvas, DEFAULT_LENS};
use crate::data::smoothing::SphKernel;
use crate::data::up::Up;
use crate::io::write_bytes_atomically;
use crate::legend::{ColourBar, legend_width};
use crate::load::{Loaded, Request, load};
use crate::ranks::renderer::shared;
use crate::sample::SampleOptions;
use crate::scene::{PointVolume, TransferFunction};
use crate::view::{Bounds, Camera, Lens, left_of};
use crate::{Error, Renderer, Result};
use indicatif::ProgressBar;

/// Scene ready to be drawn, with its cameras and overlays.
pub(super) struct ReadyScene {
    pub(super) renderer: Renderer,
    pub(super) cameras: Vec<Camera>,
    pub(super) legend: Vec<ColourBar>,
    /// Boxes around what a fitted camera shows.
    pub(super) boxes: Vec<Bounds>,
    pub(super) up: Up,
    pub(super) bounds: Option<Bounds>,
    pub(super) fields: Vec<Option<String>>,
    /// SPH kernel that columns draw.
    pub(super) smoothing: Option<SphKernel>,
    pub(super) mean: Option<ColumnMean>,
    pub(super) truth: Option<Truth>,
    pub(super) read_ms: f64,
    /// Number of kernels that are parts of refined cells, and their greatest level.
    pub(super) refined: (usize, u8),
    pub(super) prepare_start: Instant,
}

impl Arguments {
    /// Reads the inputs, sorts them into blocks and places the cameras.
    ///
    /// - `ranks`: the ranks, if there are any. It is taken if the ranks share the scene and draw it
    ///   together.
    pub(super) fn made(
        &self,
        options: &SampleOptions,
        progress: &ProgressBar,
        ranks: &mut Option<Box<dyn Collective>>,
    ) -> Result<ReadyScene> {
        let read_start = Instant::now();
        let planes = self.clip_planes();
        let cameras = |boxes: &[Bounds], up, canvas: &Canvas| {
            let sequence = &self.sequence;
            sequence.cameras(&self.camera, boxes, up, canvas)
        };
        let whole = self.canvas();
        let of_boxes =
            |boxes: &[Bounds], up| cameras(&left_of(boxes.to_vec(), &planes), up, &whole);
        let then = |scene| self.checked(scene);
        let checks = self.data.checks(&self.inputs, options).and(&then);
        let (open, observer) = (self.data.open_options(), observer_of(progress));
        let request = Request {
            // Cut faces need whole volumes.
            takes_parts: !self.cut.cut_faces,
            ..self.data.request(&checks, &open, &of_boxes, &observer)
        };
        // Ranks share a picture; the pictures of a sequence are drawn in turn.
        let mut alone = Alone::default();
        let is_shared = ranks.is_some() && !self.sequence.is_asked_for();
        let sharing = ranks.as_mut().filter(|_| is_shared);
        let mut scene = match sharing {
            None => load(&request, &mut alone)?,
            Some(ranks) => load(&request, &mut **ranks)?,
        };
        let is_column = self.method.column_density;
        let legend = self.bars(&scene)?;
        let of_box = self.periodic_box();
        let of_box = of_box.map(|periodic| (periodic.centre, periodic.size / 2.0));
        let bounds = of_box.or(scene.bounds());
        // Other ranks learn of a failure here when they next wait for this rank.
        let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
        if is_first {
            self.write_function(&scene.volumes)?;
        }
        let mean = match &self.method.column_mean {
            None => None,
            Some(field) => {
                let is_slice = self.method.slice.is_some();
                let of = (scene.volumes.as_slice(), field.as_str(), is_slice);
                let (data, inputs) = (&self.data, &self.inputs);
                Some(ColumnMean::new(data, inputs, of, options, progress)?)
            }
        };
        let read_ms = read_start.elapsed().as_secs_f64() * 1e3;
        let reports = scene.inputs.iter().map(|input| &input.report);
        let refined = reports.fold((0, 0), |(count, level), report| {
            (
                count + report.refined_count,
                report.refined_level.max(level),
            )
        });

        progress.set_message("sorting into blocks");
        let prepare_start = Instant::now();
        let truth = match self.method.reference {
            None => None,
            Some(ReferenceName::Kernels) => Some(Truth::of_kernels(
                &scene.volumes,
                self.method.classification(),
            )?),
            Some(ReferenceName::Data) => {
                let (data, inputs) = (&self.data, &self.inputs);
                Some(Truth::of_data(data, inputs, &scene.volumes, &scene.fields)?)
            }
        };
        let truth = truth.map(|truth| truth.clipped(&self.clip_planes()));
        let scene_options = self.scene_options(options);
        let sharing = ranks.as_ref().filter(|_| is_shared);
        let smoothing = scene.smoothing();
        let mut reports = scene.inputs.iter().map(|input| &input.report);
        let is_mixed = smoothing.is_none() && reports.any(|report| report.smoothing.is_some());
        if is_column && is_first && is_mixed {
            let text = "columns are of Gaussians: not all inputs are particles of one SPH kernel";
            progress.suspend(|| note!("{text}"));
        }
        let share = sharing.and_then(|ranks| scene.take_share(ranks.size()));
        let is_shared = share.is_some();
        let renderer = match (share, ranks.take_if(|_| is_shared)) {
            (Some(share), Some(ranks)) => shared(share, &scene_options, ranks)?,
            _ => scene.renderer(&scene_options)?,
        };
        let (all, canvas) = if is_column {
            (renderer.boxes(), self.column_canvas())
        } else {
            let room_px = legend_width(&legend, whole.size());
            let boxes = self.camera.boxes(&renderer);
            if is_first && let Some(note) = self.camera.strays(&renderer, &boxes) {
                progress.suspend(|| note!("{note}"));
            }
            (boxes, Canvas { room_px, ..whole })
        };
        let mut boxes = left_of(all, &self.clip_planes());
        // The camera shows the whole outline, even if the data inside it are clipped.
        boxes.extend(bounds.filter(|_| self.annotations.has_outline()));
        let cameras = cameras(&boxes, scene.up, &canvas)?;
        Ok(ReadyScene {
            renderer,
            cameras,
            legend,
            boxes,
            up: scene.up,
            bounds,
            fields: scene.fields,
            smoothing,
            mean,
            truth,
            read_ms,
            refined,
            prepare_start,
        })
    }
}

impl Arguments {
    /// Returns the canvas of a picture without a legend.
    pub(super) fn canvas(&self) -> Canvas {
        Canvas {
            along: self
                .default_axis()
                .filter(|_| !self.projection.is_perspective()),
            filled_by: self.periodic_box().map(|periodic| periodic.corners()),
            lens: match self.projection.is_ortho() {
                true => Lens::OrthoHeight(None),
                false => DEFAULT_LENS,
            },
            within: self.horizon(),
            ..Canvas::of(self.wanted_size())
        }
    }

    /// Returns the size of the picture, if an option or its projection says it.
    pub(super) fn wanted_size(&self) -> Option<[usize; 2]> {
        self.size.or_else(|| self.projection.default_size())
    }

    /// Returns the canvas of a column density.
    fn column_canvas(&self) -> Canvas {
        let lens = match self.projection.is_perspective() {
            true => DEFAULT_LENS,
            false => Lens::OrthoHeight(None),
        };
        Canvas {
            lens,
            ..self.canvas()
        }
    }

    /// Returns the camera of a column density that leaves a number of columns free at the right.
    pub(super) fn column_camera(&self, boxes: &[Bounds], up: Up, room_px: usize) -> Result<Camera> {
        let canvas = Canvas {
            room_px,
            ..self.column_canvas()
        };
        self.camera.camera(boxes, up, &canvas)
    }

    /// Returns the colour bars of the legend, if one is drawn into a picture.
    pub(super) fn bars(&self, scene: &Loaded) -> Result<Vec<ColourBar>> {
        match self.legend.legend && !self.method.column_density {
            true => bars(scene),
            false => Ok(Vec::new()),
        }
    }

    /// Writes the transfer function of a scene, if this was asked for.
    pub(super) fn write_function(&self, volumes: &[PointVolume]) -> Result<()> {
        match self.beside(self.output.write_transfer_function.as_ref()) {
            None => Ok(()),
            Some(path) => {
                let function = written_function(volumes)?;
                write_bytes_atomically(path, function.to_json().as_bytes())
            }
        }
    }
}

/// Returns the transfer function to write. All volumes must share it.
fn written_function(scene: &[PointVolume]) -> Result<&TransferFunction> {
    let fault = |found: String| {
        let expected = "one transfer function for all inputs";
        let advice = "leave --write-transfer-function out, or name one input";
        Error::invalid("--write-transfer-function", "data", expected, found, advice)
    };
    let mut functions = scene.iter().filter_map(|v| v.transfer_function.as_ref());
    let first = functions.next();
    let first =
        first.ok_or_else(|| fault("none: colours or optical depths of their own".into()))?;
    match functions.filter(|other| *other != first).count() {
        0 => Ok(first),
        others => Err(fault(format!("{} different ones", others + 1))),
    }
}
