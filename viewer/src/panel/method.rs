//! How it is drawn: tolerance, filter, compositing, light, clipping, what is shown.

use egui::{CollapsingHeader, ComboBox, Slider, Ui};
use ewa_splat::Filter;
use ewa_splat::render::{Classification, ClassifyAt, Composite, Show};
use ewa_splat::view::ClipPlane;
use glam::DVec3;

use crate::app::App;

const SHOWN: [(&str, Show); 3] = [
    ("picture", Show::Scene),
    ("choice of filters", Show::Choice),
    ("kernels per pixel", Show::Count),
];

fn composites() -> [(&'static str, Composite); 6] {
    let thickness = None;
    let slabs = |classify| Composite::Slabs {
        thickness,
        classify,
    };
    [
        ("over", Composite::Over),
        ("slabs", slabs(ClassifyAt::Particle)),
        ("slabs, classified", slabs(ClassifyAt::Slab)),
        ("maximum", Composite::Maximum { thickness }),
        ("sheets", Composite::Sheets { thickness }),
        ("axis sheets", Composite::AxisSheets { thickness }),
    ]
}

/// A box to choose one of some named values.
fn choose<T: PartialEq + Copy>(ui: &mut Ui, label: &str, value: &mut T, all: &[(&str, T)]) {
    let name = all.iter().find(|(_, one)| one == value);
    ComboBox::from_label(label)
        .selected_text(name.map_or("as asked", |(name, _)| *name))
        .show_ui(ui, |ui| {
            for (name, one) in all {
                ui.selectable_value(value, *one, *name);
            }
        });
}

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Method")
        .default_open(true)
        .show(ui, |ui| {
            let settings = &mut app.settings;
            ui.add(
                Slider::new(&mut settings.tolerance, 1e-4..=0.1)
                    .logarithmic(true)
                    .text("tolerance"),
            )
            .on_hover_text("error in linear colour that 99.9 % of the pixels may have");
            choose(ui, "filter", &mut settings.filter, &Filter::ALL.map(|filter| (filter.name(), filter)));
            choose(ui, "composite", &mut settings.composite, &composites());
            let mut by_extent = settings.classify == Classification::Extent;
            let whole = "classify over extents";
            if ui.checkbox(&mut by_extent, whole).changed() {
                settings.classify = match by_extent {
                    true => Classification::Extent,
                    false => Classification::Particle,
                };
            }
            ui.checkbox(&mut settings.level_of_detail, "level of detail");
            choose(ui, "show", &mut settings.show, &SHOWN);
            ui.checkbox(&mut app.shows_error, "error at rest").on_hover_text(
                "black: a hundredth of the tolerance; yellow: the tolerance; red: ten times as much",
            );
            if let Some(background) = &mut settings.background {
                ui.horizontal(|ui| {
                    ui.color_edit_button_rgb(background);
                    ui.label("background");
                });
            }
        });
    CollapsingHeader::new("Clip").show(ui, |ui| clip(app, ui));
}

/// A box that clips: its faces as shares of the data's.
fn clip(app: &mut App, ui: &mut Ui) {
    let Some((centre, half)) = app.loaded.as_ref().and_then(|loaded| loaded.bounds) else {
        ui.label("no data");
        return;
    };
    let (lower, upper) = (centre - half, centre + half);
    let mut faces = faces(&app.settings.clip).unwrap_or([lower, upper]);
    let mut changed = false;
    for axis in 0..3 {
        let range = lower[axis]..=upper[axis];
        let [low, high] = &mut faces;
        let name = ["x", "y", "z"][axis];
        ui.horizontal(|ui| {
            ui.label(name);
            ui.spacing_mut().slider_width = 62.0;
            changed |= ui.add(Slider::new(&mut low[axis], range.clone())).changed();
        });
        ui.horizontal(|ui| {
            ui.label("  ");
            ui.spacing_mut().slider_width = 62.0;
            changed |= ui.add(Slider::new(&mut high[axis], range)).changed();
        });
        high[axis] = high[axis].max(low[axis]);
    }
    if changed {
        app.settings.clip = ClipPlane::of_box(faces[0], faces[1]).to_vec();
    }
    if !app.settings.clip.is_empty() && ui.button("All").clicked() {
        app.settings.clip.clear();
    }
}

/// The corners of a box whose faces clip; `None` where other planes do.
fn faces(planes: &[ClipPlane]) -> Option<[DVec3; 2]> {
    if planes.len() != 6 {
        return None;
    }
    let mut corners = [DVec3::NAN; 2];
    for plane in planes {
        let axis = (0..3).find(|&axis| plane.normal[axis].abs() == 1.0)?;
        // What is kept of n x + d >= 0: from -d on, or to d.
        let (corner, place) = match plane.normal[axis] > 0.0 {
            true => (0, -plane.distance),
            false => (1, plane.distance),
        };
        corners[corner][axis] = place;
    }
    corners
        .iter()
        .all(|corner| corner.is_finite())
        .then_some(corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_of_planes_is_found_again() {
        let corners = [DVec3::new(-1.0, 2.0, -3.0), DVec3::new(4.0, 5.0, 6.0)];
        let planes = ClipPlane::of_box(corners[0], corners[1]);
        assert_eq!(faces(&planes), Some(corners));
        assert_eq!(faces(&planes[..5]), None);
    }
}
