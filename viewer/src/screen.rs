//! Maps the world to the window: pixels of the picture and points of the interface.

use egui::{Color32, Pos2, Rect, Vec2};
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};

/// Colours of x, y and z.
pub(crate) const AXES: [(&str, Color32); 3] = [
    ("x", Color32::from_rgb(235, 90, 80)),
    ("y", Color32::from_rgb(110, 200, 90)),
    ("z", Color32::from_rgb(100, 150, 250)),
];

/// Rectangle of the picture in the window, and its camera.
#[derive(Debug, Clone)]
pub(crate) struct Screen {
    pub(crate) camera: Camera,
    pub(crate) rect: Rect,
}

impl Screen {
    /// Returns the size of a pixel in points of the interface.
    fn scale(&self) -> DVec2 {
        let Vec2 { x, y } = self.rect.size();
        DVec2::new(
            f64::from(x) / self.camera.width as f64,
            f64::from(y) / self.camera.height as f64,
        )
    }

    /// Returns the point of the window at a pixel coordinate.
    pub(crate) fn point(&self, pixel: DVec2) -> Pos2 {
        let from = pixel * self.scale();
        #[expect(clippy::cast_possible_truncation, reason = "a place on the screen")]
        let from = Vec2::new(from.x as f32, from.y as f32);
        self.rect.min + from
    }

    /// Returns the pixel coordinate at a point of the window.
    pub(crate) fn pixel(&self, point: Pos2) -> DVec2 {
        let from = point - self.rect.min;
        DVec2::new(from.x.into(), from.y.into()) / self.scale()
    }

    /// Returns the point of the window where a point of the world is seen, if it is visible.
    pub(crate) fn place(&self, world: DVec3) -> Option<Pos2> {
        let at = self.point(self.camera.project(world)?);
        self.rect.expand(20.0).contains(at).then_some(at)
    }

    /// Clips a line, in pixel coordinates, to the window. Single-precision coordinates could not
    /// represent ends far outside of it.
    pub(crate) fn line(&self, [from, to]: [DVec2; 2]) -> Option<[Pos2; 2]> {
        const MARGIN: f64 = 16.0;
        let size = DVec2::new(self.camera.width as f64, self.camera.height as f64);
        let (low, high) = (DVec2::splat(-MARGIN), size + MARGIN);
        let along = to - from;
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            if along[axis] == 0.0 {
                if from[axis] < low[axis] || from[axis] > high[axis] {
                    return None;
                }
                continue;
            }
            let at = |bound: f64| (bound - from[axis]) / along[axis];
            let (enters, leaves) = (at(low[axis]), at(high[axis]));
            first = first.max(enters.min(leaves));
            last = last.min(enters.max(leaves));
        }
        (first <= last).then(|| [first, last].map(|t| self.point(from + along * t)))
    }

    /// Returns the part of a line of the world that the window shows.
    pub(crate) fn segment(&self, ends: [DVec3; 2]) -> Option<[Pos2; 2]> {
        self.line(self.camera.project_segment(ends)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screen() -> Screen {
        let eye = DVec3::new(0.0, -2.0, 0.0);
        Screen {
            camera: Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 90.0, [400, 200]),
            rect: Rect::from_min_size(Pos2::new(30.0, 10.0), Vec2::new(200.0, 100.0)),
        }
    }

    #[test]
    fn pixels_and_points_are_each_others() {
        let screen = screen();
        assert_eq!(screen.place(DVec3::ZERO), Some(Pos2::new(130.0, 60.0)));
        let point = Pos2::new(57.0, 33.5);
        assert_eq!(screen.point(screen.pixel(point)), point);
        assert_eq!(screen.place(DVec3::new(0.0, -3.0, 0.0)), None);
    }

    #[test]
    fn lines_end_just_outside_the_picture() {
        let screen = screen();
        let line = |from: [f64; 2], to: [f64; 2]| screen.line([from, to].map(DVec2::from_array));
        let [from, to] = line([100.0, -1e9], [100.0, 1e9]).unwrap();
        assert!((from - Pos2::new(80.0, 2.0)).length() < 1e-3);
        assert!((to - Pos2::new(80.0, 118.0)).length() < 1e-3);
        let inside = line([10.0, 20.0], [30.0, 40.0]).unwrap();
        assert_eq!(inside, [Pos2::new(35.0, 20.0), Pos2::new(45.0, 30.0)]);
        assert_eq!(line([500.0, 0.0], [500.0, 100.0]), None);
        assert_eq!(line([-100.0, 150.0], [100.0, 500.0]), None);
        // A line from behind the eye is visible from the near side on, in the direction from which
        // it comes.
        let ends = [DVec3::new(0.5, -5.0, 0.0), DVec3::new(0.5, 0.0, 0.0)];
        let [from, to] = screen.segment(ends).unwrap();
        assert_eq!(Some(to), screen.place(ends[1]));
        assert!(from.x > screen.rect.max.x && (from.y - 60.0).abs() < 1e-3);
    }
}
