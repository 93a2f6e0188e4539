//! Runs `ewa-splat render --column-density`.

use crate::data::smoothing::SphKernel;
use crate::io::{column_colours, column_picture, write_bytes_atomically, write_column};
use crate::legend::ColourBar;
use crate::scene::{TransferFunction, ValueScale};
use crate::view::{Along, Camera};
use crate::{ColumnImage, ColumnSettings, Error, Renderer, Result, SceneOptions};
use indicatif::ProgressBar;
use serde_json::json;

use super::column_mean::{ColumnMean, REACH, quotient, shown};
use super::options::{Arguments, ColumnLook};
use crate::command::annotations::Overlays;
use crate::command::legend::column_title;
use crate::command::progress::note;
use crate::command::statistics::{Prepared, stats};

impl Arguments {
    /// Draws and writes the column density.
    pub(in crate::command) fn draw_column(
        &self,
        renderer: &mut Renderer,
        camera: &Camera,
        (fields, smoothing, mean): (&[Option<String>], Option<SphKernel>, Option<ColumnMean>),
        overlays: Overlays,
        prepared: Prepared,
        progress: &ProgressBar,
    ) -> Result<()> {
        let mut settings = ColumnSettings {
            smoothing,
            ..self.column_settings()
        };
        if mean.is_some() && settings.slice.is_some() {
            // A mean is given where kernels count.
            settings.cutoff = REACH;
        }
        progress.set_message("summing");
        renderer.column_density(camera, &settings)?;
        let mut times = vec![renderer.times()];
        if let Some(frames) = self.output.frames {
            times.clear();
            progress.set_length(u64::from(frames));
            for _ in 0..frames {
                renderer.column_density(camera, &settings)?;
                times.push(renderer.times());
                progress.inc(1);
            }
        }
        if renderer.rank().is_some_and(|rank| rank != 0) {
            return Ok(());
        }
        progress.set_message("writing");
        let amplitudes = renderer.amplitudes();
        let counts = renderer.counts();
        let title = match &mean {
            Some(mean) => format!("mean {}", mean.title),
            None => column_title(fields, self.method.slice.is_some()),
        };
        let is_mean = mean.is_some();
        let own = match mean {
            None => None,
            Some(mean) => {
                let options = SceneOptions {
                    level_of_detail: false,
                    ..SceneOptions::default()
                };
                let sums = Renderer::with_options(mean.weighed, &options)?;
                let backend = self.backend(&sums, camera);
                let mut sums = sums.on(backend.open()?)?;
                let sums = sums.column_density(camera, &settings)?.clone();
                let shown = match settings.slice {
                    Some(_) => None,
                    None => {
                        let on = |renderer: &Renderer| self.backend(renderer, camera);
                        Some(shown(mean.places, on, camera, &settings)?)
                    }
                };
                Some(quotient(&sums, renderer.column(), shown.as_ref()))
            }
        };
        let column = own.as_ref().unwrap_or_else(|| renderer.column());
        if column.values.iter().any(|value| value.is_infinite()) {
            return Err(Error::invalid(
                "column density",
                "sums",
                "numbers within single precision (3.4e38)",
                "greater ones",
                "give masses in a larger unit",
            ));
        }
        let look = self.column_look();
        let colours = column_colours(column, look.map, look.range, look.scale)?;
        let bar = colours.as_ref().filter(|_| self.legend.legend);
        let bar = bar.map(|colours| ColourBar::of_column(&title, colours));
        let overlays = overlays.with_bars(bar.into_iter().collect());
        match &colours {
            Some(colours) if self.is_png() => {
                overlays.write(&self.out, &column_picture(column, colours))?;
            }
            _ => write_column(&self.out, column)?,
        }
        if let Some(path) = &self.output.stats {
            let mut stats = stats(renderer, &times, prepared);
            stats["column_density"] = json!({
                "sum_times_area": column.sum_times_area(),
                "extent": Along::extent(camera),
                "range": column.range(),
                "positive_range": column.positive_range(),
                "shown_range": column.shown_range(),
                "amplitude_sum": amplitudes.sum,
                "not_finite": amplitudes.not_finite,
            });
            write_bytes_atomically(path, format!("{stats:#}\n").as_bytes())?;
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
            note!("{}", in_words(what, &look, column, colours.as_ref()));
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
    let (of, own) = match colours.value_scale() {
        ValueScale::Linear | ValueScale::Shifted { .. } => ("", column.range()),
        ValueScale::Log => ("log10 of ", column.shown_range()),
        ValueScale::Symlog { .. } => ("a symmetric logarithm of ", column.range()),
    };
    let [least, greatest] = look.range.or(own).unwrap_or(colours.range());
    let map = look.map.unwrap_or("viridis");
    format!("colours: {map} over {of}{what}, from {least:e} to {greatest:e}")
}
