//! Runs `ewa-splat render --column-density`.

use crate::data::smoothing::SphKernel;
use crate::io::{column_colours, column_look, column_picture};
use crate::legend::{ColourBar, legend_width};
use crate::math::narrowed;
use crate::render::ColumnMeans;
use crate::scene::{TransferFunction, ValueScale};
use crate::view::{Along, Camera};
use crate::{ColumnImage, ColumnSettings, Error, Image, Renderer, Result};
use indicatif::ProgressBar;
use serde_json::json;

use super::column_mean::ColumnMean;
use super::ending::Facts;
use super::options::{Arguments, ColumnLook};
use super::tiles::Drawn;
use crate::command::annotations::Overlays;
use crate::command::legend::column_title;
use crate::command::progress::note;
use crate::command::statistics::{Prepared, stats, write_stats};

/// The scene of columns, and what goes with it.
pub(in crate::command) struct Columns<'a> {
    pub(in crate::command) renderer: &'a mut Renderer,
    /// Names of the shown fields, one for each input.
    pub(in crate::command) fields: &'a [Option<String>],
    /// SPH kernel of the particles.
    pub(in crate::command) smoothing: Option<SphKernel>,
    pub(in crate::command) mean: Option<ColumnMean>,
    /// Returns the camera that leaves a number of columns free at the right of its picture.
    pub(in crate::command) beside: &'a dyn Fn(usize) -> Result<Camera>,
    /// Returns what is drawn over the picture of a camera, besides colour bars.
    pub(in crate::command) overlays: &'a dyn Fn(&Camera) -> Result<Overlays>,
}

impl Arguments {
    /// Draws and writes the column density.
    pub(in crate::command) fn draw_column(
        &self,
        columns: Columns<'_>,
        camera: &Camera,
        prepared: Prepared,
        progress: &ProgressBar,
    ) -> Result<()> {
        let Columns {
            renderer,
            fields,
            smoothing,
            mean,
            beside,
            overlays,
        } = columns;
        let mut camera = camera.clone();
        let mut settings = ColumnSettings {
            smoothing,
            ..self.column_settings()
        };
        if mean.is_some() {
            settings = ColumnMeans::settings(&settings);
        }
        progress.set_message("summing");
        self.summed(renderer, &camera, &settings)?;
        let mut times = vec![renderer.times()];
        if let Some(frames) = self.output.frames {
            times.clear();
            progress.set_length(u64::from(frames));
            for _ in 0..frames {
                self.summed(renderer, &camera, &settings)?;
                times.push(renderer.times());
                progress.inc(1);
            }
        }
        if renderer.rank().is_some_and(|rank| rank != 0) {
            return Ok(());
        }
        let title = match &mean {
            Some(mean) => format!("mean {}", mean.title),
            None => column_title(fields, settings.slice.is_some()),
        };
        let is_mean = mean.is_some();
        let on = |renderer: &Renderer| self.backend(renderer, &camera);
        let mut means = mean.map(|mean| mean.means.on(on)).transpose()?;
        let mut shown = |weights: &ColumnImage, camera: &Camera| match &mut means {
            None => Ok(weights.clone()),
            Some(means) => means.draw(weights, camera, &settings),
        };
        let mut column = shown(renderer.column(), &camera)?;
        let look = self.column_look();
        let mut colours = column_colours(&column, look.map, look.range, look.scale)?;
        let bar = |colours: &Option<TransferFunction>| -> Vec<ColourBar> {
            let colours = colours.iter().filter(|_| self.legend.legend);
            colours.map(|c| ColourBar::of_column(&title, c)).collect()
        };
        // The bar's width depends on the values, and then the picture on the bar. Other ranks draw but once.
        let room_px = match renderer.rank() {
            None => legend_width(&bar(&colours), [camera.width, camera.height]),
            Some(_) => 0,
        };
        // A window whose shape the rest of the picture does not have stays under the bar.
        let beside = (room_px > 0).then(|| beside(room_px)).and_then(Result::ok);
        // A camera that was given leaves no room.
        if let Some(beside) = beside.filter(|beside| *beside != camera) {
            camera = beside;
            self.summed(renderer, &camera, &settings)?;
            column = shown(renderer.column(), &camera)?;
            colours = column_colours(&column, look.map, look.range, look.scale)?;
        }
        progress.set_message("writing");
        let facts = Facts::of(renderer, settings.tolerance);
        if column.values.iter().any(|value| value.is_infinite()) {
            return Err(Error::invalid(
                "column density",
                "sums",
                "numbers within single precision (3.4e38)",
                "greater ones",
                "give masses in a larger unit",
            ));
        }
        match &colours {
            Some(colours) if self.is_png() => {
                let overlays = overlays(&camera)?.with_bars(bar(&Some(colours.clone())));
                let picture = column_picture(&column, colours);
                self.end(&Drawn::Picture(&*overlays.drawn(&picture)?), &facts)?;
            }
            None if self.is_png() => {
                let nothing = Image::new(column.width, column.height);
                self.end(&Drawn::Picture(&nothing), &facts)?;
            }
            _ => self.end(&Drawn::Column(&column), &facts)?,
        }
        let amplitudes = renderer.amplitudes();
        let counts = renderer.counts();
        if let Some(path) = self.beside(self.output.stats.as_ref()) {
            let mut stats = stats(renderer, &times, prepared);
            stats["column_density"] = json!({
                "sum_times_area": column.sum_times_area(),
                "extent": Along::extent(&camera),
                "range": column.range(),
                "positive_range": column.positive_range(),
                "shown_range": column.shown_range(),
                "amplitude_sum": amplitudes.sum,
                "not_finite": amplitudes.not_finite,
            });
            write_stats(path, &stats)?;
        }
        progress.finish_and_clear();
        if amplitudes.not_finite > 0 {
            note!(
                "{} values are not finite and add nothing",
                amplitudes.not_finite
            );
        }
        if counts.narrow > 0 {
            note!(
                "{} of {} kernels on the slice are narrower than a pixel: those between pixels' centres do not show",
                counts.narrow,
                counts.footprints
            );
        }
        if counts.footprints == 0 {
            note!("nothing visible: no particle with a value but zero reaches the image");
        } else if self.is_png() {
            let what = match (settings.slice, is_mean) {
                (Some(_), _) => title.as_str(),
                (None, true) => "the mean",
                (None, false) => "the column density",
            };
            note!("{}", in_words(what, &look, &column, colours.as_ref()));
        }
        Ok(())
    }
}

/// Describes in words what the colours of a column density, a mean or a slice stand for.
fn in_words(
    what: &str,
    look: &ColumnLook<'_>,
    column: &ColumnImage,
    colours: Option<&TransferFunction>,
) -> String {
    let Some(colours) = colours else {
        return format!(
            "no {} above zero: an empty picture",
            what.trim_start_matches("the ")
        );
    };
    let scale = colours.value_scale();
    // Logarithms would round the ends.
    let (of, own) = match scale {
        ValueScale::Linear | ValueScale::Shifted { .. } => ("", None),
        ValueScale::Log => ("log10 of ", column.shown_range()),
        ValueScale::Symlog { .. } => ("a symmetric logarithm of ", None),
    };
    let ends = || colours.range().map(|end| narrowed(scale.value(end)));
    let [least, greatest] = look.range.or(own).unwrap_or_else(ends);
    let map = look.map.unwrap_or(column_look(column, look.scale).1);
    format!("colours: {map} over {of}{what}, from {least:e} to {greatest:e}")
}
