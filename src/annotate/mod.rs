//! Draws annotations over pictures: the directions of the axes, the bounding box of the data, a scale bar, a
//! title and a time stamp.
//!
//! Annotations are drawn over a finished picture, with its camera, before a [`legend`](crate::legend). The box
//! spans the picture; all else is in its corners. Texts have plates like a legend's, and lines have dark rims,
//! so that both are visible on bright and dark pictures.

mod outline;
mod scale_bar;
mod strokes;
mod triad;

use crate::annotate::strokes::fill_plate;
use crate::annotate::strokes::gap;
use crate::annotate::strokes::rim;
use glam::DVec3;

pub use self::outline::{BoxEdge, box_edges};
use self::scale_bar::ScaleBar;
use self::triad::Triad;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::overlay::{Font, Line, Rect, font_of};
use crate::view::{Bounds, Camera};

/// Annotations to draw over a picture; none by default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Annotations {
    /// A triad of the world's axes in the lower left corner, rotated as the camera sees it along its optical
    /// axis.
    pub axes: bool,
    /// A box, world units, whose edges are drawn in perspective over the picture. Edges that the box's own
    /// faces hide are dimmer; the scene hides none.
    pub outline: Option<Bounds>,
    /// A bar in the lower right corner, 1, 2 or 5 times a power of ten long. A segment of that length, parallel
    /// to the picture's rows, looks as long as the bar at the distance of this point, world units. Under an
    /// orthographic camera it does so everywhere.
    pub scale_at: Option<DVec3>,
    /// A line of text in the upper left corner.
    pub title: Option<String>,
    /// Number of the picture's columns that the title may use, from the left; all by default.
    pub title_columns: Option<usize>,
    /// A line of text in the lower left corner, above the triad.
    pub time_stamp: Option<String>,
}

/// Least number of a text's characters that must fit.
const LEAST_CHARACTERS: usize = 4;

/// Checks that the annotations fit into a camera's picture and have a place there, before the picture is drawn.
///
/// # Errors
/// A picture that is too small; a scale at a point in or behind the plane of a perspective eye.
pub fn check(camera: &Camera, annotations: &Annotations) -> Result<()> {
    Layout::of(camera, annotations).map(|_| ())
}

/// Draws annotations over a picture.
///
/// - `camera`: the camera of the picture.
///
/// Texts that are too long for the picture end in two dots. Characters beyond Latin-1, which the font lacks,
/// are drawn as `?`. Text is as large as in a [`legend`](crate::legend::draw_legend).
///
/// # Errors
/// The errors of [`check`]; a picture of another size than the camera's.
pub fn draw(image: &mut Image, camera: &Camera, annotations: &Annotations) -> Result<()> {
    if !image.is_whole() || [image.width, image.height] != [camera.width, camera.height] {
        return Err(Error::invalid(
            "annotations",
            "image",
            format!("{} x {} pixels", camera.width, camera.height),
            format!(
                "{} of {} x {}",
                image.pixels.len(),
                image.width,
                image.height
            ),
            "give the picture that this camera saw",
        ));
    }
    let layout = Layout::of(camera, annotations)?;
    if let Some(bounds) = annotations.outline {
        outline::draw(image, camera, bounds, layout.font);
    }
    if let Some(triad) = &layout.triad {
        triad.draw(image, layout.font);
    }
    for label in layout.title.iter().chain(&layout.time_stamp) {
        label.draw(image, layout.font);
    }
    if let Some(bar) = &layout.scale_bar {
        bar.draw(image, layout.font);
    }
    Ok(())
}

/// A line of text on a plate.
#[derive(Debug, Clone)]
struct Label {
    plate: Rect,
    line: Line,
}

impl Label {
    /// Returns the height of a label's plate, pixels.
    fn height(font: Font) -> usize {
        font.line_px() + 2 * rim(font)
    }

    /// Makes a label at `left` and `top`, shortened to a plate that ends before column `end`. Returns `None`
    /// for an empty text.
    fn of(text: &str, font: Font, [left, top]: [usize; 2], end: usize) -> Option<Self> {
        let gap = gap(font);
        // Line feeds and tabs become spaces.
        let text: String = text
            .trim()
            .chars()
            .map(|c| if c.is_whitespace() { ' ' } else { c })
            .collect();
        let text = font.shortened(&text, end.saturating_sub(left + 2 * gap));
        (!text.is_empty()).then(|| Self {
            plate: Rect {
                left,
                top,
                width: font.width_px(&text) + 2 * gap,
                height: Self::height(font),
            },
            line: Line {
                text,
                left: left + gap,
                top: top + rim(font),
            },
        })
    }

    /// Returns the least width of a shortened text, pixels.
    fn least_width(text: &str, font: Font) -> usize {
        let count = text.trim().chars().count().min(LEAST_CHARACTERS);
        count * font.advance_px() + 2 * gap(font)
    }

    fn draw(&self, image: &mut Image, font: Font) {
        fill_plate(image, self.plate);
        self.line.draw(font, image);
    }
}

/// Positions of all annotations.
#[derive(Debug, Clone)]
struct Layout {
    font: Font,
    title: Option<Label>,
    time_stamp: Option<Label>,
    triad: Option<Triad>,
    scale_bar: Option<ScaleBar>,
}

impl Layout {
    fn of(camera: &Camera, annotations: &Annotations) -> Result<Self> {
        let [width, height] = [camera.width, camera.height];
        let font = font_of([width, height]);
        let gap = gap(font);
        let scale_bar = match annotations.scale_at {
            Some(point) => Some(ScaleBar::of(camera, point, font)?),
            None => None,
        };
        let side = |is_there: bool| if is_there { Triad::side(font) } else { 0 };
        let triad_side = side(annotations.axes);
        let text = |text: &Option<String>| text.clone().filter(|t| !t.trim().is_empty());
        let (title, stamp) = (text(&annotations.title), text(&annotations.time_stamp));
        let with_gap = |px: usize| if px > 0 { px + gap } else { 0 };
        let text_height = |text: &Option<String>| text.as_ref().map_or(0, |_| Label::height(font));
        let text_width = |text: &Option<String>| {
            text.as_ref()
                .map_or(0, |text| Label::least_width(text, font))
        };
        let (bar_width, bar_height) = scale_bar.as_ref().map_or((0, 0), ScaleBar::size);
        // The triad is beside the bar, or the time stamp if there is no triad.
        let lower = match annotations.axes {
            true => triad_side,
            false => text_width(&stamp),
        };
        let rows = [
            with_gap(text_width(&title)),
            with_gap(text_width(&stamp)),
            with_gap(lower) + with_gap(bar_width),
        ];
        let at_left = with_gap(text_height(&stamp)) + with_gap(triad_side);
        let columns = with_gap(text_height(&title)) + at_left.max(with_gap(bar_height));
        let least = [gap + rows.into_iter().max().unwrap_or(0), gap + columns];
        // An empty layout fits everywhere.
        if least != [gap, gap] && (least[0] > width || least[1] > height) {
            return Err(Error::invalid(
                "annotations",
                "image size",
                format!("{} x {} pixels at least", least[0], least[1]),
                format!("{width} x {height}"),
                "draw a larger picture, or fewer annotations",
            ));
        }
        let inside = width.saturating_sub(gap);
        let title_end = annotations.title_columns.map_or(inside, |columns| {
            // Keep a gap before the following columns, if that leaves room for the text.
            let least = gap + text_width(&title);
            columns.saturating_sub(gap).clamp(least.min(inside), inside)
        });
        let title = title.and_then(|title| Label::of(&title, font, [gap, gap], title_end));
        let above_triad = height.saturating_sub(gap + with_gap(triad_side));
        let time_stamp = stamp.and_then(|stamp| {
            let end = match annotations.axes {
                true => inside,
                false => inside.saturating_sub(with_gap(bar_width)),
            };
            let top = above_triad.saturating_sub(Label::height(font));
            let top = if annotations.axes {
                top
            } else {
                top.min(height)
            };
            Label::of(&stamp, font, [gap, top], end)
        });
        let triad = annotations.axes.then(|| Triad::of(camera, font));
        Ok(Self {
            font,
            title,
            time_stamp,
            triad,
            scale_bar,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn cameras(size: [usize; 2]) -> Vec<Camera> {
        let (eye, target, up) = (
            DVec3::new(7.0, -9.0, 5.0),
            DVec3::new(1.0, 0.5, 0.2),
            DVec3::new(0.1, 0.2, 1.0),
        );
        vec![
            Camera::perspective(eye, target, up, 35.0, size),
            Camera::perspective(eye, target, DVec3::NEG_Y, 90.0, size),
            Camera::orthographic(eye, target, up, 6.0, size),
        ]
    }

    const SIZES: [[usize; 2]; 4] = [[200, 220], [320, 200], [1024, 1024], [2600, 3000]];

    fn everything() -> Annotations {
        Annotations {
            axes: true,
            outline: None,
            scale_at: Some(DVec3::ZERO),
            title: Some("A title that is far too long for the pictures of this test, ".repeat(4)),
            title_columns: None,
            time_stamp: Some(
                "t = 3.5\n\u{3c1} = 7, and so on until the edge is reached ".repeat(4),
            ),
        }
    }

    fn plates(layout: &Layout) -> Vec<Rect> {
        let labels = layout.title.iter().chain(&layout.time_stamp);
        let mut all: Vec<Rect> = labels.map(|label| label.plate).collect();
        all.extend(layout.triad.as_ref().map(Triad::square));
        all.extend(layout.scale_bar.as_ref().map(|bar| bar.plate));
        all
    }

    #[test]
    fn all_lies_in_its_own_place_and_nothing_else_changes() {
        let mut fewer = everything();
        fewer.axes = false;
        fewer.title_columns = Some(140);
        for annotations in [everything(), fewer] {
            for size in SIZES {
                for camera in cameras(size) {
                    let layout = Layout::of(&camera, &annotations).unwrap();
                    let places = plates(&layout);
                    for (i, a) in places.iter().enumerate() {
                        assert!(a.left > 0 && a.top > 0, "{a:?}");
                        assert!(a.right() < size[0] && a.bottom() < size[1], "{a:?}");
                        for b in &places[i + 1..] {
                            let apart = a.right() <= b.left
                                || b.right() <= a.left
                                || a.bottom() <= b.top
                                || b.bottom() <= a.top;
                            assert!(apart, "{a:?} {b:?}");
                        }
                    }
                    for label in layout.title.iter().chain(&layout.time_stamp) {
                        let right = label.line.left + layout.font.width_px(&label.line.text);
                        assert!(right < label.plate.right());
                        assert!(label.line.text.len() > 3, "{}", label.line.text);
                    }
                    let value = |i: usize| (i % 251) as f32 / 251.0;
                    let mut image = Image::new(size[0], size[1]);
                    for (i, pixel) in image.pixels.iter_mut().enumerate() {
                        *pixel = [value(i); 4];
                    }
                    draw(&mut image, &camera, &annotations).unwrap();
                    let mut changed = 0;
                    for (i, pixel) in image.pixels.iter().enumerate() {
                        let (x, y) = (i % size[0], i / size[0]);
                        let is_on = places.iter().any(|p| {
                            (p.left..p.right()).contains(&x) && (p.top..p.bottom()).contains(&y)
                        });
                        assert!(pixel.iter().all(|c| (0.0..=1.0).contains(c)));
                        changed += usize::from(*pixel != [value(i); 4]);
                        assert!(is_on || *pixel == [value(i); 4], "{x}, {y}");
                    }
                    assert!(changed > 1000);
                }
            }
        }
    }

    #[test]
    fn a_title_ends_before_the_columns_that_are_not_its() {
        let camera = &cameras([1024, 512])[0];
        let mut annotations = everything();
        annotations.title_columns = Some(600);
        let layout = Layout::of(camera, &annotations).unwrap();
        let title = layout.title.unwrap();
        assert!(title.plate.right() <= 600 && title.plate.right() > 560);
        assert!(title.line.text.ends_with(".."));
    }

    #[test]
    fn no_annotations_change_nothing() {
        for size in [[1, 1], [64, 40]] {
            for camera in cameras(size) {
                let mut image = Image::new(size[0], size[1]);
                draw(&mut image, &camera, &Annotations::default()).unwrap();
                let blank = Annotations {
                    title: Some(" ".into()),
                    ..Annotations::default()
                };
                draw(&mut image, &camera, &blank).unwrap();
                assert_eq!(image, Image::new(size[0], size[1]));
            }
        }
    }

    #[test]
    fn what_has_no_room_is_refused() {
        for size in [[0, 0], [60, 400], [400, 60]] {
            for camera in cameras(size) {
                assert!(check(&camera, &everything()).is_err(), "{size:?}");
            }
        }
        // A size other than the camera's.
        let camera = &cameras([300, 200])[0];
        let mut image = Image::new(200, 300);
        assert!(draw(&mut image, camera, &everything()).is_err());
        assert_eq!(image, Image::new(200, 300));
    }
}
