//! Selects the overlays of the window and of files.

use ewa_splat::annotate::Annotations;
use ewa_splat::command::Over;
use ewa_splat::legend::ColourBar;
use ewa_splat::render::Show;

use crate::app::App;
use crate::curve::History;
use crate::overlay::Overlay;

impl App {
    /// Returns the colour bars of the current transfer functions. Volumes with the same field and
    /// function share a bar.
    pub(crate) fn bars(&self) -> Vec<ColourBar> {
        let mut bars = Vec::new();
        let volumes = self.loaded.iter().flat_map(|loaded| &loaded.volumes);
        for (i, volume) in volumes.enumerate() {
            let history = self.histories.get(i).and_then(Option::as_ref);
            let function = history.map(History::function);
            let bar = volume.bar.as_ref().map(|bar| match function {
                Some(function) => bar.with_transfer_function(function),
                None => bar.clone(),
            });
            if let Some(bar) = bar
                && !bars.contains(&bar)
            {
                bars.push(bar);
            }
        }
        bars
    }

    /// Returns the overlays that are switched on and apply. A legend applies to pictures of the
    /// scene; axes and outline apply to everything but kernel counts.
    pub(crate) fn shown_over(&self) -> Over {
        let has_legend = self.loaded.iter().flat_map(|loaded| &loaded.volumes);
        let has_legend = has_legend.into_iter().any(|volume| volume.bar.is_some());
        let bounds = self.loaded.as_ref().and_then(|loaded| loaded.bounds);
        let (is_scene, is_count) = match self.settings.show {
            Show::Scene => (true, false),
            Show::Choice => (false, false),
            Show::Count => (false, true),
        };
        Over {
            legend: self.over.legend && has_legend && is_scene,
            axes: self.over.axes && !is_count,
            outline: self.over.outline && bounds.is_some() && !is_count,
        }
    }

    /// Returns the overlay of a picture that is written.
    pub(crate) fn overlay(&self) -> Overlay {
        let over = self.shown_over();
        let bounds = self.loaded.as_ref().and_then(|loaded| loaded.bounds);
        Overlay {
            annotations: Annotations {
                axes: over.axes,
                outline: bounds.filter(|_| over.outline),
                ..Annotations::default()
            },
            bars: match over.legend {
                true => self.bars(),
                false => Vec::new(),
            },
        }
    }
}
