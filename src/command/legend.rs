//! Makes the colour bars of `ewa-splat render --legend`.

use crate::legend::{ColourBar, name_without_unit};
use crate::{Error, Result};
use clap::Args;

use crate::load::Loaded;

/// Title of a field without a name.
const UNNAMED: &str = "value";

#[derive(Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct LegendOptions {
    /// Draw a colour bar with the field's name, values and opacity into the picture
    #[arg(long)]
    pub(crate) legend: bool,
}

/// Returns a colour bar for each transfer function that gives colours. Volumes with the same field
/// and function share a bar.
pub(crate) fn bars(scene: &Loaded) -> Result<Vec<ColourBar>> {
    let mut bars = Vec::new();
    let titles = scene.volumes.iter().zip(&scene.titles);
    for (volume, title) in titles {
        let title = title.as_deref().unwrap_or(UNNAMED);
        if let Some(bar) = ColourBar::of_volume(title, volume)
            && !bars.contains(&bar)
        {
            bars.push(bar);
        }
    }
    if bars.is_empty() {
        return Err(Error::invalid(
            "--legend",
            "data",
            "a field with a transfer function",
            "splats, meshes or particles with colours of their own",
            "leave --legend out, or name a field with --field",
        ));
    }
    Ok(bars)
}

/// Returns the title of a column density, or of a slice.
pub(crate) fn column_title(fields: &[Option<String>], is_slice: bool) -> String {
    match fields {
        [Some(field), rest @ ..] if is_slice && rest.iter().all(|f| f.as_ref() == Some(field)) => {
            field.clone()
        }
        _ if is_slice => "density".into(),
        [Some(field), rest @ ..] if rest.iter().all(|f| f.as_ref() == Some(field)) => {
            // The unit of a column is the field's unit times a length, so the title omits the
            // field's unit.
            format!("column of {}", name_without_unit(field))
        }
        _ => "column density".into(),
    }
}
