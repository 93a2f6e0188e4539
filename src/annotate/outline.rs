//! Draws the edges of a box in perspective.

use glam::{DVec2, DVec3};

use crate::annotate::strokes::{draw_rimmed, thickness_px};
use crate::image::Image;
use crate::overlay::{Font, Stroke};
use crate::view::{Bounds, Camera, Projection};

/// Linear grey level of lines.
const GREY: [f32; 3] = [0.75; 3];
/// Opacity of edges that the box itself hides.
const HIDDEN_OPACITY: f32 = 0.35;

/// An edge of a box as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxEdge {
    /// Ends, pixel coordinates: [`Camera::project_segment`].
    pub ends: [DVec2; 2],
    /// True if both faces that meet in the edge face away from the eye.
    pub is_hidden: bool,
}

/// Returns the edges of a box, world units, that lie at least partly in front of a camera, as an
/// [`outline`](super::Annotations::outline) draws them.
pub fn box_edges(camera: &Camera, (middle, half): Bounds) -> Vec<BoxEdge> {
    // True if the face across an axis, at its lower or its upper end, faces the eye.
    let is_turned = |axis: usize, is_upper: bool| {
        let sign = if is_upper { 1.0 } else { -1.0 };
        match camera.projection {
            Projection::Perspective => sign * (camera.eye[axis] - middle[axis]) > half[axis],
            Projection::Orthographic => sign * camera.forward()[axis] < 0.0,
        }
    };
    let corner = |at: [bool; 3]| {
        middle + half * DVec3::from(at.map(|is_upper| if is_upper { 1.0 } else { -1.0 }))
    };
    let mut edges = Vec::with_capacity(12);
    for along in 0..3 {
        let (u, v) = ((along + 1) % 3, (along + 2) % 3);
        for i in 0..4 {
            let mut at = [false; 3];
            (at[u], at[v]) = (i & 1 == 1, i & 2 == 2);
            let from = corner(at);
            at[along] = true;
            if let Some(ends) = camera.project_segment([from, corner(at)]) {
                let is_hidden = !is_turned(u, at[u]) && !is_turned(v, at[v]);
                edges.push(BoxEdge { ends, is_hidden });
            }
        }
    }
    edges
}

/// Draws the edges of a box, hidden ones first and dimmer.
pub(super) fn draw(image: &mut Image, camera: &Camera, bounds: Bounds, font: Font) {
    let edges = box_edges(camera, bounds);
    for (is_hidden, opacity) in [(true, HIDDEN_OPACITY), (false, 1.0)] {
        let strokes: Vec<Stroke> = edges
            .iter()
            .filter(|edge| edge.is_hidden == is_hidden)
            .map(|edge| Stroke {
                from: edge.ends[0],
                to: edge.ends[1],
                width_px: thickness_px(font),
            })
            .collect();
        draw_rimmed(image, &strokes, GREY, opacity);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::cameras;
    use super::*;
    use crate::overlay::font_of;

    const BOX: Bounds = (DVec3::new(1.0, 0.5, 0.0), DVec3::new(1.0, 1.5, 0.5));

    #[test]
    fn edges_join_the_corners_where_the_camera_sees_them() {
        for camera in cameras([400, 300]) {
            let edges = box_edges(&camera, BOX);
            assert_eq!(edges.len(), 12);
            for i in 0..8 {
                let sign = |axis: usize| if i >> axis & 1 == 0 { -1.0 } else { 1.0 };
                let corner = BOX.0 + BOX.1 * DVec3::new(sign(0), sign(1), sign(2));
                let place = camera.project(corner).unwrap();
                let meeting = edges.iter().flat_map(|edge| edge.ends);
                let meeting = meeting.filter(|end| (end - place).length() < 1e-9).count();
                assert_eq!(meeting, 3, "{corner}");
            }
            // A box seen at a corner hides the three edges that meet in the farthest corner.
            let hidden: Vec<&BoxEdge> = edges.iter().filter(|edge| edge.is_hidden).collect();
            assert_eq!(hidden.len(), 3);
            let farthest = BOX.0 + BOX.1 * DVec3::new(-1.0, 1.0, -1.0);
            let place = camera.project(farthest).unwrap();
            for edge in hidden {
                let is_at = |end: &DVec2| (end - place).length() < 1e-9;
                assert!(edge.ends.iter().any(is_at), "{edge:?}");
            }
        }
    }

    #[test]
    fn lines_are_drawn_on_the_edges() {
        for camera in cameras([400, 300]) {
            let mut image = Image::new(400, 300);
            draw(&mut image, &camera, BOX, font_of([400, 300]));
            for edge in box_edges(&camera, BOX) {
                for share in [0.2, 0.5, 0.8] {
                    let at = edge.ends[0].lerp(edge.ends[1], share);
                    if !(at.cmpge(DVec2::ZERO).all() && at.x < 400.0 && at.y < 300.0) {
                        continue;
                    }
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "in the picture"
                    )]
                    let [r, _, _, alpha] = image.pixel(at.x as usize, at.y as usize);
                    // The pixel's centre is at most half a diagonal away.
                    let least = if edge.is_hidden { 0.05 } else { 0.15 };
                    assert!(r > least && alpha > 0.3, "{r} {alpha} {edge:?}");
                }
            }
        }
    }

    /// From inside, all twelve edges count as hidden, and those that run behind the eye are cut.
    #[test]
    fn a_view_from_inside_has_the_edges_before_it() {
        let camera = Camera::perspective(BOX.0, BOX.0 + DVec3::Y, DVec3::Z, 60.0, [300, 200]);
        let edges = box_edges(&camera, BOX);
        assert_eq!(edges.len(), 8);
        assert!(edges.iter().all(|edge| edge.is_hidden));
        let beyond = camera.project(BOX.0 + BOX.1).unwrap();
        let ends = || edges.iter().flat_map(|edge| edge.ends);
        assert_eq!(
            ends().filter(|end| (end - beyond).length() < 1e-9).count(),
            3
        );
        assert!(ends().all(|end| end.is_finite()));
        let mut image = Image::new(300, 200);
        draw(&mut image, &camera, BOX, font_of([300, 200]));
        // Behind the eye nothing is drawn.
        let away = Camera::perspective(
            BOX.0 + DVec3::Y * 9.0,
            BOX.0 + DVec3::Y * 19.0,
            DVec3::Z,
            60.0,
            [300, 200],
        );
        assert_eq!(super::box_edges(&away, BOX), []);
    }
}
