//! Shows the panel of the drawing method: tolerance, filter, compositing, kind of picture.

use std::sync::Arc;

use egui::{Slider, Ui};
use ewa_splat::Filter;
use ewa_splat::render::{Classification, Composite, Show};
use ewa_splat::sample::BoundaryChoice;

use super::row::{Choice, button, choose, row, section, slide, switch};
use crate::app::App;
use crate::instead::Instead;

/// Kinds of picture, with descriptions of their colours.
const SHOWN: [Choice<'_, (Show, Option<Instead>)>; 6] = [
    ("picture", (Show::Scene, None), "The picture\n--show scene"),
    (
        "filter choice",
        (Show::Choice, None),
        "Each kernel in the colour of what draws it: exact red, affine green, reconstruction kernel alone blue, low-pass \
         filter alone yellow, round cyan; merged kernels in shades of magenta\n--show choice",
    ),
    (
        "kernel count",
        (Show::Count, None),
        "How many kernels each pixel takes: from none, dark blue, to the most, yellow\n--show count",
    ),
    (
        "error",
        (Show::Scene, Some(Instead::Error)),
        "How far each pixel is off at rest: black at a hundredth of the tolerance or less, blue and green up to yellow at the \
         tolerance, red at ten times the tolerance or more\n--measure-error states its size",
    ),
    (
        "depth",
        (Show::Scene, Some(Instead::Depth)),
        "Where half of the light is gone: near is bright, far is dark, black shows nothing\n--depth FILE",
    ),
    (
        "normals",
        (Show::Scene, Some(Instead::Normals)),
        "Normals of opaque surfaces: red, green and blue are x, y and z, from -1 to 1; black shows none\n--normals FILE",
    ),
];

/// Returns the composites, and whether slabs are classified by their mean values.
fn composites() -> [Choice<'static, (Composite, bool)>; 6] {
    [
        (
            "over",
            (Composite::Over, false),
            "Each kernel by itself, in the order of their centres\n--composite over",
        ),
        (
            "slabs",
            (Composite::SLABS, false),
            "Kernels sliced into slabs parallel to the image: converges to the true integral\n--composite slabs",
        ),
        (
            "slabs, post-classified",
            (Composite::SLABS, true),
            "Slabs whose mean value is classified at each pixel\n--composite slabs --post-classification",
        ),
        (
            "maximum",
            (Composite::MAXIMUM, false),
            "Maximum-intensity projection: the colour of the greatest mean value along each ray\n--composite maximum",
        ),
        (
            "sheets",
            (Composite::SHEETS, false),
            "Whole kernels summed in sheets parallel to the image\n--composite sheets",
        ),
        (
            "axis-sheets",
            (Composite::AXIS_SHEETS, false),
            "Whole kernels summed in sheets across the volume's axis nearest to the view\n--composite axis-sheets",
        ),
    ]
}

const CLASSIFICATIONS: [Choice<'_, Classification>; 2] = [
    (
        "extent",
        Classification::Extent,
        "Over each kernel's extent, with the field's slope\n--classify extent",
    ),
    (
        "particle",
        Classification::Particle,
        "At each sample's value alone\n--classify particle",
    ),
];

fn described(filter: Filter) -> &'static str {
    match filter {
        Filter::Adaptive => {
            "For each kernel the cheapest filter that fits the tolerance\n--filter adaptive"
        }
        Filter::Exact => "The exact line integral of each kernel under perspective\n--filter exact",
        Filter::Ewa => {
            "Affine projection with a low-pass filter (Zwicker et al. 2001)\n--filter ewa"
        }
        Filter::Reconstruction => {
            "The projected kernel alone: aliases below a pixel\n--filter reconstruction"
        }
        Filter::LowPass => {
            "The low-pass filter alone: dots where kernels exceed a pixel\n--filter low-pass"
        }
        Filter::Isotropic => "Round footprints\n--filter isotropic",
        Filter::UniformScaling => {
            "Each kernel enlarged until it covers the low-pass filter (Swan)\n--filter uniform-scaling"
        }
    }
}

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "How the data become a picture, and which picture of them is shown";
    section(ui, "Method", true, tip, |ui| {
        let settings = &mut app.settings;
        let mut shown = (settings.show, app.instead);
        choose(
            ui,
            "Show",
            "What the picture shows\n--show WHAT",
            &mut shown,
            &SHOWN,
        );
        (settings.show, app.instead) = shown;
        explain(app, ui);
        let settings = &mut app.settings;
        let tip = "Error in linear colour that 99.9 % of the pixels may have: smaller is slower\n--tolerance T";
        row(ui, "Tolerance", tip, |ui| {
            slide(
                ui,
                Slider::new(&mut settings.tolerance, 1e-4..=0.1).logarithmic(true),
            )
        });
        let filters = Filter::ALL.map(|filter| (filter.name(), filter, described(filter)));
        let tip = "Which footprint draws a kernel\n--filter FILTER";
        choose(ui, "Filter", tip, &mut settings.filter, &filters);
        let tip = "How kernels behind one another become a picture\n--composite COMPOSITE";
        let mut of_kernels = settings.classify;
        let was_of_slabs = of_kernels == Classification::Slab;
        if was_of_slabs {
            of_kernels = Classification::default();
        }
        let mut chosen = (settings.composite, was_of_slabs);
        choose(ui, "Compositing", tip, &mut chosen, &composites());
        let of_slabs;
        (settings.composite, of_slabs) = chosen;
        let tip = "Where the transfer function is evaluated\n--classify WHERE";
        choose(ui, "Classification", tip, &mut of_kernels, &CLASSIFICATIONS);
        settings.classify = match of_slabs {
            true => Classification::Slab,
            false => of_kernels,
        };
        let tip = "Merge kernels far below a pixel, as far as the tolerance allows\n--level-of-detail auto|off";
        switch(ui, "Detail levels", tip, &mut settings.level_of_detail);
        boundary(app, ui);
        background(app, ui);
        let tip = "Integrate the kernels along every ray, without light, and measure how far the picture is off. Takes \
                   seconds to hours; Escape cancels\n--reference";
        if button(ui, "Reference image", tip) {
            app.ask_truth();
        }
    });
}

/// Explains the image shown in place of the picture.
fn explain(app: &App, ui: &mut Ui) {
    let shown = (app.settings.show, app.instead);
    let tip = SHOWN.iter().skip(1).find(|(_, one, _)| *one == shown);
    if let Some((_, _, tip)) = tip {
        let text = tip.split('\n').next().unwrap_or_default();
        ui.add(egui::Label::new(egui::RichText::new(text).small()).wrap());
    }
}

fn background(app: &mut App, ui: &mut Ui) {
    if let Some(background) = &mut app.settings.background {
        let tip = "The colour behind everything, linear\n--background r,g,b|NAME";
        row(ui, "Background", tip, |ui| {
            ui.color_edit_button_rgb(background)
        });
    }
}

/// Shows the choice of how data end at their boundary. It takes effect when the data are read.
fn boundary(app: &mut App, ui: &mut Ui) {
    const CHOICES: [Choice<'_, BoundaryChoice>; 3] = [
        (
            "automatic",
            BoundaryChoice::Automatic,
            "Sharp where the transfer function shows any of the boundary",
        ),
        (
            "sharp",
            BoundaryChoice::Sharp,
            "Kernels are cut at the boundary\n--boundary sharp",
        ),
        (
            "soft",
            BoundaryChoice::Soft,
            "Kernels run out beyond the boundary\n--boundary soft",
        ),
    ];
    let has_boundary = app
        .loaded
        .as_ref()
        .is_some_and(|loaded| loaded.has_boundary);
    let before = app.request.boundary();
    let mut after = before;
    let tip = match has_boundary {
        true => "How grids end; reads the files again\n--boundary HOW",
        false => {
            "How grids end: these data are none, an isosurface, or of --shepard\n--boundary HOW"
        }
    };
    ui.add_enabled_ui(has_boundary, |ui| {
        choose(ui, "Boundary", tip, &mut after, &CHOICES)
    });
    if after != before {
        app.request = Arc::new(app.request.with_boundary(after));
        app.load();
    }
}
