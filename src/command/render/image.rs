//! Draws and writes one picture.

use super::count::describe;
use super::ending::Facts;
use super::options::{Arguments, ShowName};
use super::tiles::Drawn;
use crate::command::annotations::Overlays;
use crate::command::progress::note;
use crate::command::statistics::{Prepared, stats, write_stats};
use crate::io::{write_deep, write_depth, write_normals};
use crate::measure::{ErrorSample, SampledError};
use crate::render::{Blend, Composite, Layers};
use crate::stages::blocks::BlockedVolume;
use crate::view::Camera;
use crate::{Error, Image, Renderer, Result, Settings, Show, Task};
use indicatif::ProgressBar;
use serde_json::json;

/// Picture to draw.
pub(super) struct Picture<'a> {
    pub(super) renderer: &'a mut Renderer,
    pub(super) camera: &'a Camera,
    pub(super) settings: Settings,
    pub(super) blend: BlendOf,
    pub(super) overlays: &'a Overlays,
    pub(super) progress: &'a ProgressBar,
}

impl Arguments {
    /// Draws a picture and writes it, with its depths, normals and statistics.
    ///
    /// - `is_first`: whether this is the rank that writes.
    pub(super) fn draw_image(
        &self,
        picture: Picture<'_>,
        prepared: Prepared,
        is_first: bool,
        task: Option<Task>,
    ) -> Result<()> {
        let Picture {
            renderer,
            camera,
            mut settings,
            blend,
            overlays,
            progress,
        } = picture;
        let asked = settings.tolerance;
        let mut sample = None;
        if self.method.calibrate {
            progress.set_message("calibrating");
            if settings.composite != Composite::Over {
                renderer.render(camera, &settings)?;
                settings.composite = with_layers_of(renderer, settings.composite);
            }
            let own = ErrorSample::draw(renderer, camera, &settings)?;
            (settings.tolerance, _) = own.calibrated(renderer)?;
            sample = Some(own);
        }
        progress.set_message("rendering");
        let shown = Settings {
            task,
            ..settings.clone()
        };
        self.drawn(renderer, camera, &shown)?;
        let mut times = vec![renderer.times()];
        if let Some(frames) = self.output.frames {
            let shadow = times[0].shadow;
            times.clear();
            progress.set_length(u64::from(frames));
            for _ in 0..frames {
                self.drawn(renderer, camera, &settings)?;
                times.push(renderer.times());
                progress.inc(1);
            }
            // The frame before these has made the shadows.
            times[0].shadow += shadow;
        }
        if !is_first {
            return Ok(());
        }
        progress.set_message("writing");
        let shows_count = settings.show == Show::Count;
        let mut facts = Facts::of(renderer, settings.tolerance);
        if !self.ending.writes() {
            return self.end_image(renderer.image(), overlays, &facts);
        }
        let of_deep = self.output.depth_of.of_deep();
        if let (Some(path), Some(depth), None) = (&self.output.depth, renderer.depth(), of_deep) {
            write_depth(path, depth)?;
        }
        if let (Some(path), Some(normals)) = (&self.output.normals, renderer.normals()) {
            write_normals(path, normals)?;
        }
        let mut stats = stats(renderer, &times, prepared);
        stats["tolerance"] = json!(settings.tolerance);
        stats["blend"] = json!(blend.name());
        let footprints = renderer.counts().footprints;
        let layers = renderer.layers().cloned();
        if self.method.measure_error || self.method.calibrate {
            progress.set_message("measuring the error");
            // Measuring draws over it.
            let image = renderer.image().clone();
            let sample = match sample {
                Some(sample) => sample,
                None => {
                    settings.composite = with_layers_of(renderer, settings.composite);
                    ErrorSample::draw(renderer, camera, &settings)?
                }
            };
            let error = sample.error_of(&image);
            stats["tolerance_asked"] = json!(asked);
            stats["measured_error"] = json!(error);
            facts.measured_error = json!(error);
            self.end_image(&image, overlays, &facts)?;
            if self.output.stats.is_none() {
                progress.suspend(|| note!("{}", in_words(&error, asked, settings.tolerance)));
            }
        } else {
            self.end_image(renderer.image(), overlays, &facts)?;
        }
        if self.output.deep.is_some() || of_deep.is_some() {
            progress.set_message("drawing depths");
            let deep = renderer.render_deep(camera, &settings)?;
            if let (Some(path), Some(of)) = (&self.output.depth, of_deep) {
                write_depth(path, &deep.depth(of))?;
            }
            if let Some(path) = &self.output.deep {
                write_deep(path, &deep)?;
                stats["deep_samples"] = json!(deep.samples.len());
            }
        }
        if let Some(path) = &self.output.stats {
            write_stats(path, &stats)?;
        }
        progress.finish_and_clear();
        if footprints == 0 {
            note!("nothing visible: no particle reaches the image with an opacity above zero");
        } else if shows_count {
            note!("{}", describe(renderer.image(), self.is_png()));
        }
        if let (Some(layers), None) = (layers, self.method.slab_thickness) {
            note_thick_layers(&layers, settings.tolerance.into());
        }
        Ok(())
    }

    /// Writes or compares a picture, or counts of kernels.
    fn end_image(&self, image: &Image, overlays: &Overlays, facts: &Facts) -> Result<()> {
        match self.output.show {
            ShowName::Count => self.end(&Drawn::Count(image), facts),
            ShowName::Scene | ShowName::Choice => {
                self.end(&Drawn::Picture(&*overlays.drawn(image)?), facts)
            }
        }
    }
}

/// Space that a picture is composited in, and the note on it.
pub(super) struct BlendOf {
    is_encoded: bool,
    /// True if splats with encoded colours are composited in linear light because of other volumes
    /// in the scene.
    gives_way: bool,
}

impl BlendOf {
    fn name(&self) -> &'static str {
        match self.is_encoded {
            true => "encoded",
            false => "linear",
        }
    }

    pub(super) fn note(&self) -> Option<&'static str> {
        self.gives_way.then_some(
            "splats are composited in linear light, because not all that is shown are splats of sRGB codes; viewers composite the codes, and so does --blend encoded",
        )
    }
}

/// Chooses the space of compositing.
///
/// # Errors
/// A space asked for in a scene without splats of radiance fields.
pub(super) fn blend_of(renderer: &Renderer, settings: &Settings) -> Result<BlendOf> {
    let has_encoded = renderer.volumes().iter().any(BlockedVolume::is_encoded);
    let has_splats = renderer.volumes().iter().any(BlockedVolume::is_of_splats);
    if settings.blend != Blend::Auto && !has_splats {
        return Err(Error::invalid(
            "--blend",
            "inputs",
            "splats of radiance fields",
            "none",
            "leave it out",
        ));
    }
    let is_encoded = renderer.blends_encoded(settings);
    let is_auto = settings.blend == Blend::Auto && settings.show == Show::Scene;
    Ok(BlendOf {
        is_encoded,
        gives_way: has_encoded && !is_encoded && is_auto,
    })
}

/// Returns `composite` with the layer thickness of the last frame, so that parts of the picture are
/// cut into the same layers.
fn with_layers_of(renderer: &Renderer, composite: Composite) -> Composite {
    match renderer.layers() {
        Some(layers) => composite.with_thickness(Some(layers.thickness)),
        None => composite,
    }
}

/// Describes the measured error of a picture in words.
fn in_words(error: &SampledError, asked: f32, drawn: f32) -> String {
    let mut words = format!(
        "99.9 % of the picture err by less than {:.1e}, the worst pixel by {:.1e} (tolerance {asked:.1e}; measured in \
         {} tiles, {} pixels)",
        error.percentile_999, error.greatest, error.tiles, error.pixels
    );
    if drawn != asked {
        words += &format!("; drawn at a tolerance of {drawn:.1e}");
    }
    words
}

/// Prints a note on layers that are thicker than the tolerance allows.
fn note_thick_layers(layers: &Layers, tolerance: f64) {
    if layers.error > tolerance {
        note!(
            "slabs {:.1e} thick are thicker than the tolerance of {tolerance:.1e} asks of the \
             thinnest kernels: they err by {:.1e} at most, as a rule far less; --slab-thickness \
             makes them thinner",
            layers.thickness,
            layers.error
        );
    }
}
