//! Defines the cell of a simulation: its box, which may be sheared and periodic.

use glam::DVec3;

/// A cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// The corner that the edges begin at.
    pub(super) origin: DVec3,
    pub(super) edges: [DVec3; 3],
    /// The edges along which it repeats itself.
    pub(super) is_periodic: [bool; 3],
}

impl Cell {
    /// Returns the position of coordinates that are shares of the edges.
    pub(super) fn at(&self, shares: DVec3) -> DVec3 {
        let [a, b, c] = self.edges;
        self.origin + shares.x * a + shares.y * b + shares.z * c
    }

    /// Returns the lengths of the edges, if they lie along x, y and z.
    fn size(&self) -> Option<DVec3> {
        let [a, b, c] = self.edges;
        let size = DVec3::new(a.x, b.y, c.z);
        let is_straight = [a, b, c] == [DVec3::X * a.x, DVec3::Y * b.y, DVec3::Z * c.z];
        is_straight.then_some(size)
    }

    /// Returns a note on a periodic cell; `None` if it is not periodic or has no volume.
    pub(super) fn note(&self) -> Option<String> {
        let [a, b, c] = self.edges;
        let has_volume = self.origin.is_finite() && a.cross(b).dot(c).abs() > 0.0;
        let axes = ["x", "y", "z"].into_iter().zip(self.is_periodic);
        let axes: Vec<&str> = axes.filter_map(|(axis, is)| is.then_some(axis)).collect();
        if !has_volume || axes.is_empty() {
            return None;
        }
        let Some(size) = self.size() else {
            return Some("The box is periodic and sheared: it is not wrapped.".to_owned());
        };
        if axes.len() < 3 {
            let axes = axes.join(" and ");
            return Some(format!(
                "The box is periodic along {axes} alone: it is not wrapped (--periodic wraps along all axes)."
            ));
        }
        let list = |v: DVec3| v.to_array().map(shown).join(",");
        let [least, middle] = [
            self.origin.min(self.origin + size),
            self.origin + size / 2.0,
        ];
        let size = size.abs();
        let centre = match least == DVec3::ZERO {
            true => String::new(),
            false => format!(" --centre {}", list(middle)),
        };
        let edges = size.to_array().map(shown).join(" x ");
        Some(format!(
            "The box is periodic ({edges}): what lies beyond its faces is drawn, or lost, outside, unless it is wrapped \
             (--periodic {}{centre}).",
            list(size)
        ))
    }
}

/// Returns a number as options accept it, in a few characters.
fn shown(number: f64) -> String {
    match number == 0.0 || (1e-4..1e9).contains(&number.abs()) {
        true => number.to_string(),
        false => format!("{number:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_state_the_options_that_wrap_the_box() {
        let straight = Cell {
            origin: DVec3::new(-0.5, 0.0, 0.0),
            edges: [DVec3::X, 2.0 * DVec3::Y, 1e12 * DVec3::Z],
            is_periodic: [true; 3],
        };
        let note = |cell: Cell| cell.note().unwrap_or_default();
        assert!(note(straight).contains("(--periodic 1,2,1e12 --centre 0,1,5e11)"));
        let at_origin = Cell {
            origin: DVec3::ZERO,
            ..straight
        };
        assert!(note(at_origin).contains("(--periodic 1,2,1e12)"));
        let layer = Cell {
            is_periodic: [true, true, false],
            ..straight
        };
        assert!(note(layer).contains("along x and y alone"));
        let sheared = Cell {
            edges: [DVec3::X, DVec3::new(0.1, 2.0, 0.0), DVec3::Z],
            ..straight
        };
        assert!(note(sheared).contains("sheared"));
        let (mut open, mut flat) = (straight, straight);
        open.is_periodic = [false; 3];
        flat.edges[2] = DVec3::ZERO;
        assert_eq!([open.note(), flat.note()], [None, None]);
        let inside = Cell {
            origin: DVec3::ONE,
            edges: [DVec3::X, DVec3::new(0.5, 2.0, 0.0), DVec3::Z],
            ..straight
        };
        assert_eq!(inside.at(DVec3::splat(0.5)), DVec3::new(1.75, 2.0, 1.5));
    }
}
