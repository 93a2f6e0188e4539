//! Draws the overlays of the picture: the box of the data, the directions of the axes, legends.

use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Rgba, Shape, Stroke, Ui, Vec2};
use ewa_splat::annotate::box_edges;
use ewa_splat::legend::ColourBar;
use ewa_splat::render::Show;
use ewa_splat::view::{Bounds, Camera};
use glam::DVec3;

use super::row::{section, switch_if};
use crate::app::App;
use crate::screen::{AXES, Screen};

/// Colour behind text.
const PLATE: Color32 = Color32::from_black_alpha(170);
/// Brightness of edges that the box itself hides.
const HIDDEN: f32 = 0.35;
const FONT_SIZE: f32 = 12.0;

/// Shows the switches.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "What is drawn over the picture, in the window and in files";
    section(ui, "Annotations", false, tip, |ui| {
        let loaded = app.loaded.as_ref();
        let has_bars = loaded.is_some_and(|l| l.volumes.iter().any(|volume| volume.bar.is_some()));
        let has_bounds = loaded.is_some_and(|loaded| loaded.bounds.is_some());
        let is_count = app.settings.show == Show::Count;
        let is_scene = app.settings.show == Show::Scene;
        let if_possible = |is_possible: bool, tip, why| match is_count {
            true => Err("numbers are shown, not a picture"),
            false if is_possible => Ok(tip),
            false => Err(why),
        };
        let tip = "A colour bar of the values for each transfer function, with its opacity over a checker\n--legend";
        let why = match is_scene {
            true => "nothing is coloured by a transfer function",
            false => "colours of filters are shown",
        };
        let tip = if_possible(has_bars && is_scene, tip, why);
        switch_if(ui, "Legend", &mut app.over.legend, tip);
        let tip = "The directions of x, y and z, in the lower left corner\n--axes";
        let tip = if_possible(true, tip, "");
        switch_if(ui, "Axes", &mut app.over.axes, tip);
        let tip = "The box of the data\n--outline";
        let tip = if_possible(has_bounds, tip, "no data");
        switch_if(ui, "Outline", &mut app.over.outline, tip);
    });
}

/// Draws the overlays that are switched on.
pub(crate) fn draw(app: &App, painter: &Painter, screen: &Screen) {
    let over = app.shown_over();
    let bounds = app.loaded.as_ref().and_then(|loaded| loaded.bounds);
    if let Some(bounds) = bounds.filter(|_| over.outline) {
        outline(painter, screen, bounds, Color32::from_gray(225));
    }
    if over.axes {
        triad(painter, &screen.camera, screen.rect);
    }
    if over.legend {
        legends(painter, screen.rect, &app.bars());
    }
}

/// Draws text around a point, on a plate.
pub(crate) fn plate(painter: &Painter, at: Pos2, text: &str) {
    let font = FontId::proportional(16.0);
    let galley = painter.layout_no_wrap(text.to_owned(), font, Color32::WHITE);
    let rect = Align2::CENTER_CENTER.anchor_size(at, galley.size());
    painter.rect_filled(rect.expand(8.0), 4.0, PLATE);
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// Draws the edges of a box. Edges that the box hides are dimmer.
pub(crate) fn outline(painter: &Painter, screen: &Screen, bounds: Bounds, colour: Color32) {
    let mut edges = box_edges(&screen.camera, bounds);
    edges.sort_by_key(|edge| !edge.is_hidden);
    for edge in edges {
        let strength = if edge.is_hidden { HIDDEN } else { 1.0 };
        if let Some(ends) = screen.line(edge.ends) {
            rimmed(painter, ends, 1.2, colour, strength);
        }
    }
}

/// Draws a line with a dark rim, visible on bright and dark pictures.
pub(crate) fn rimmed(
    painter: &Painter,
    ends: [Pos2; 2],
    width: f32,
    colour: Color32,
    strength: f32,
) {
    let rim = Color32::from_black_alpha(140).gamma_multiply(strength);
    painter.line_segment(ends, Stroke::new(width + 2.0, rim));
    painter.line_segment(ends, Stroke::new(width, colour.gamma_multiply(strength)));
}

/// Draws the directions of x, y and z, as the camera sees them, in the lower left corner.
fn triad(painter: &Painter, camera: &Camera, rect: Rect) {
    const LENGTH: f32 = 28.0;
    let origin = rect.left_bottom() + Vec2::new(46.0, -46.0);
    let mut axes: Vec<_> = AXES
        .iter()
        .zip(DVec3::AXES)
        .map(|(named, axis)| (named, camera.camera_from_world * axis))
        .collect();
    // Nearer axes are drawn over farther ones.
    axes.sort_by(|a, b| b.1.z.total_cmp(&a.1.z));
    for ((name, colour), seen) in axes {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "components of a unit vector"
        )]
        let tip = origin + Vec2::new(seen.x as f32, seen.y as f32) * LENGTH;
        rimmed(painter, [origin, tip], 2.0, *colour, 1.0);
        let at = origin + (tip - origin) * 1.35;
        painter.circle_filled(at, 7.0, PLATE);
        painter.text(
            at,
            Align2::CENTER_CENTER,
            name,
            FontId::proportional(FONT_SIZE),
            *colour,
        );
    }
}

/// Draws a colour bar for each transfer function, side by side in the upper right corner.
fn legends(painter: &Painter, rect: Rect, bars: &[ColourBar]) {
    const GAP: f32 = 8.0;
    let mut right = rect.right() - GAP;
    for bar in bars.iter().rev() {
        let left = legend(painter, rect, right, bar);
        right = left - GAP;
        if right < rect.left() {
            return;
        }
    }
}

/// Draws a bar whose plate ends at `right`. Returns the left end of the plate.
fn legend(painter: &Painter, rect: Rect, right: f32, bar: &ColourBar) -> f32 {
    const WIDTH: f32 = 22.0;
    const PAD: f32 = 7.0;
    const TITLE: f32 = 110.0;
    let font = FontId::proportional(FONT_SIZE);
    let length = (0.35 * rect.height()).clamp(80.0, 240.0);
    // The legends in written pictures have at most this many labels, too.
    let most = if length < 7.0 * 18.0 { 5 } else { 7 };
    let text = |text: String| painter.layout(text, font.clone(), Color32::WHITE, TITLE);
    let title = text(bar.title().to_owned());
    let labels: Vec<_> = bar
        .labels(most)
        .into_iter()
        .map(|(at, label)| (at, text(label)))
        .collect();
    let longest = labels
        .iter()
        .map(|(_, label)| label.size().x)
        .fold(0.0, f32::max);
    let inner = (WIDTH + 8.0 + longest).max(title.size().x);
    let size = Vec2::new(inner + 2.0 * PAD, title.size().y + length + 3.5 * PAD);
    let plate = Rect::from_min_size(Pos2::new(right - size.x, rect.top() + 8.0), size);
    painter.rect_filled(plate, 3.0, PLATE);
    let corner = plate.min + Vec2::splat(PAD);
    let strip = Rect::from_min_size(
        corner + Vec2::new(0.0, title.size().y + PAD),
        Vec2::new(WIDTH, length),
    );
    painter.galley(corner, title, Color32::WHITE);
    painter.rect_filled(strip.expand(1.0), 0.0, Color32::from_gray(110));
    painter.add(Shape::mesh(colours(strip, bar)));
    for (at, label) in labels {
        #[expect(clippy::cast_possible_truncation, reason = "a place on the screen")]
        let y = strip.bottom() - at as f32 * length;
        let ends = [
            Pos2::new(strip.right() + 1.0, y),
            Pos2::new(strip.right() + 5.0, y),
        ];
        painter.line_segment(ends, Stroke::new(1.0, Color32::WHITE));
        let at = Pos2::new(strip.right() + 8.0, y - label.size().y / 2.0);
        painter.galley(at, label, Color32::WHITE);
    }
    plate.left()
}

/// Draws the colours of a bar: opaque at the right, with their opacities over a checker at the
/// left.
fn colours(strip: Rect, bar: &ColourBar) -> Mesh {
    const ROWS: u16 = 140;
    /// Squares of the checker across half of the bar.
    const SQUARES: u16 = 2;
    const GROUND: [f32; 2] = [0.03, 0.2];
    let mut mesh = Mesh::default();
    let half = strip.width() / 2.0;
    let square = half / f32::from(SQUARES);
    let height = strip.height() / f32::from(ROWS);
    for row in 0..ROWS {
        let fraction = 1.0 - (f64::from(row) + 0.5) / f64::from(ROWS);
        let (colour, opacity) = bar.at(fraction);
        let colour = colour.map(|c| c.clamp(0.0, 1.0));
        let top = strip.top() + f32::from(row) * height;
        let mut fill = |left: f32, width: f32, [r, g, b]: [f32; 3]| {
            let area = Rect::from_min_size(Pos2::new(left, top), Vec2::new(width, height));
            mesh.add_colored_rect(area, Rgba::from_rgb(r, g, b).into());
        };
        let Some(opacity) = opacity else {
            fill(strip.left(), strip.width(), colour);
            continue;
        };
        for column in 0..SQUARES {
            let is_odd = ((top - strip.top()) / square + f32::from(column)).rem_euclid(2.0) >= 1.0;
            let ground = GROUND[usize::from(is_odd)];
            let seen = colour.map(|c| ground + (c - ground) * opacity);
            fill(strip.left() + f32::from(column) * square, square, seen);
        }
        fill(strip.left() + half, half, colour);
    }
    mesh
}
