//! How it is drawn: tolerance, filter, compositing, what is shown.

use std::sync::Arc;

use egui::{CollapsingHeader, ComboBox, Slider, Ui};
use ewa_splat::Filter;
use ewa_splat::render::{Classification, ClassifyAt, Composite, Show};
use ewa_splat::sample::BoundaryChoice;

use crate::app::App;
use crate::instead::Instead;

const SHOWN: [(&str, (Show, Option<Instead>)); 6] = [
    ("picture", (Show::Scene, None)),
    ("choice of filters", (Show::Choice, None)),
    ("kernels per pixel", (Show::Count, None)),
    ("error at rest", (Show::Scene, Some(Instead::Error))),
    ("depth", (Show::Scene, Some(Instead::Depth))),
    ("normals", (Show::Scene, Some(Instead::Normals))),
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
pub(super) fn choose<T: PartialEq + Copy>(
    ui: &mut Ui,
    label: &str,
    value: &mut T,
    all: &[(&str, T)],
) {
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
            choose(
                ui,
                "filter",
                &mut settings.filter,
                &Filter::ALL.map(|filter| (filter.name(), filter)),
            );
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
            boundary(app, ui);
            let settings = &mut app.settings;
            let mut shown = (settings.show, app.instead);
            choose(ui, "show", &mut shown, &SHOWN);
            (settings.show, app.instead) = shown;
            if app.instead == Some(Instead::Error) {
                ui.label(
                    "black: a hundredth of the tolerance, yellow: the tolerance, red: ten times it",
                );
            }
            let settings = &mut app.settings;
            if let Some(background) = &mut settings.background {
                ui.horizontal(|ui| {
                    ui.color_edit_button_rgb(background);
                    ui.label("background");
                });
            }
            let tip =
                "the integral of the kernels along every ray, which takes its time; Escape cancels";
            if ui.button("Truth").on_hover_text(tip).clicked() {
                app.ask_truth();
            }
        });
}

/// How data end, which they do where they are read.
fn boundary(app: &mut App, ui: &mut Ui) {
    const CHOICES: [(&str, BoundaryChoice); 3] = [
        ("automatic", BoundaryChoice::Automatic),
        ("sharp", BoundaryChoice::Sharp),
        ("soft", BoundaryChoice::Soft),
    ];
    let has_boundary = app
        .loaded
        .as_ref()
        .is_some_and(|loaded| loaded.has_boundary);
    let before = app.asked.boundary();
    let mut after = before;
    let row = ui.add_enabled_ui(has_boundary, |ui| {
        choose(ui, "boundary", &mut after, &CHOICES)
    });
    row.response
        .on_disabled_hover_text("only grids end sharply, but not as a surface nor with --shepard");
    if after != before {
        app.asked = Arc::new(app.asked.with_boundary(after));
        app.load();
    }
}
