//! Places a plot's labels near their points and clear of each other.

/// Width of a letter over its height: sans-serif faces average about this.
const LETTER_WIDTH: f64 = 0.56;

/// A box in the plot, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Rect {
    /// Returns the area that two boxes share.
    fn overlap(&self, other: &Self) -> f64 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }

    fn around(x: f64, y: f64, radius: f64) -> Self {
        Self {
            left: x - radius,
            top: y - radius,
            right: x + radius,
            bottom: y + radius,
        }
    }

    fn inside(&self, outer: &Self) -> bool {
        self.left >= outer.left
            && self.top >= outer.top
            && self.right <= outer.right
            && self.bottom <= outer.bottom
    }

    /// Returns the point of the box nearest to (x, y).
    pub(super) fn nearest(&self, x: f64, y: f64) -> (f64, f64) {
        (
            x.clamp(self.left, self.right),
            y.clamp(self.top, self.bottom),
        )
    }
}

/// Returns one box per point for a text of `font_px` beside it, in the order of the points. `line` joins some
/// of the points; labels avoid it.
///
/// The method is greedy: each label takes the nearest free place in several rings around its point, or else the
/// one that overlaps least. Points in crowded regions choose first, because they have the fewest places.
pub(super) fn place(
    points: &[(f64, f64)],
    texts: &[&str],
    marker_radius: f64,
    font_px: f64,
    line: &[(f64, f64)],
    frame: &Rect,
) -> Vec<Rect> {
    let line = along(line);
    let markers: Vec<Rect> = points
        .iter()
        .map(|&(x, y)| Rect::around(x, y, marker_radius + 1.0))
        .collect();
    let crowd = |i: usize| {
        let (x, y) = points[i];
        let near = |&&(a, b): &&(f64, f64)| (a - x).abs() < 60.0 && (b - y).abs() < 30.0;
        points.iter().filter(near).count()
    };
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(crowd(i)));
    let mut placed: Vec<Option<Rect>> = vec![None; points.len()];
    for i in order {
        let width = texts[i].chars().count() as f64 * font_px * LETTER_WIDTH;
        let cost = |candidate: &Rect| {
            let labels = placed
                .iter()
                .flatten()
                .map(|other| candidate.overlap(other));
            let points = markers.iter().map(|other| candidate.overlap(other));
            let line = line.iter().map(|part| candidate.overlap(part));
            let outside = if candidate.inside(frame) { 0.0 } else { 1e6 };
            labels.sum::<f64>() + points.sum::<f64>() + line.sum::<f64>() / 4.0 + outside
        };
        let mut best: Option<(f64, Rect)> = None;
        for candidate in candidates(points[i], width, font_px, marker_radius) {
            let cost = cost(&candidate);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, candidate));
            }
            if cost <= 0.0 {
                break;
            }
        }
        placed[i] = best.map(|(_, rect)| rect);
    }
    placed.into_iter().flatten().collect()
}

/// Returns small boxes along a line.
fn along(line: &[(f64, f64)]) -> Vec<Rect> {
    const STEP_PX: f64 = 4.0;
    let mut boxes = Vec::new();
    for ends in line.windows(2) {
        let ((ax, ay), (bx, by)) = (ends[0], ends[1]);
        let length = (bx - ax).hypot(by - ay);
        let mut at = 0.0;
        while at < length {
            let s = at / length;
            boxes.push(Rect::around(
                ax + s * (bx - ax),
                ay + s * (by - ay),
                STEP_PX / 2.0,
            ));
            at += STEP_PX;
        }
    }
    boxes
}

/// Returns places around a point, the best first: right, left, above, below, then the diagonals, then farther
/// out.
fn candidates(
    (x, y): (f64, f64),
    width: f64,
    height: f64,
    marker_radius: f64,
) -> impl Iterator<Item = Rect> {
    const RINGS_PX: [f64; 7] = [3.0, 10.0, 20.0, 32.0, 46.0, 62.0, 80.0];
    const DIRECTIONS: usize = 16;
    // Every second direction first: the eight that readers expect.
    let turns = (0..DIRECTIONS).step_by(2).chain((1..DIRECTIONS).step_by(2));
    RINGS_PX.into_iter().flat_map(move |gap| {
        turns.clone().map(move |turn| {
            let angle = turn as f64 / DIRECTIONS as f64 * std::f64::consts::TAU;
            let reach = marker_radius + gap;
            let middle_x = x + angle.cos() * (reach + width / 2.0);
            let middle_y = y - angle.sin() * (reach + height / 2.0);
            Rect {
                left: middle_x - width / 2.0,
                right: middle_x + width / 2.0,
                top: middle_y - height / 2.0,
                bottom: middle_y + height / 2.0,
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_left_free_where_there_is_room() {
        let frame = Rect {
            left: 0.0,
            top: 0.0,
            right: 500.0,
            bottom: 500.0,
        };
        // A horizontal line to the right of the point, where the label would go first.
        let line = [(250.0, 250.0), (450.0, 250.0)];
        let rects = place(&line[..1], &["label"], 5.0, 12.0, &line, &frame);
        assert!(
            along(&line)
                .iter()
                .all(|part| part.overlap(&rects[0]) <= 0.0)
        );
    }

    #[test]
    fn labels_of_a_crowd_are_legible() {
        // Thirty points in a patch of 160 x 120 px, and two in a corner.
        let mut points: Vec<(f64, f64)> = (0..30)
            .map(|i| {
                let (a, b) = (f64::from(i * 37 % 31), f64::from(i * 53 % 29));
                (400.0 + a * 160.0 / 31.0, 300.0 + b * 120.0 / 29.0)
            })
            .collect();
        points.extend([(1.0, 1.0), (899.0, 599.0)]);
        let texts = vec!["isotropic"; points.len()];
        let frame = Rect {
            left: 0.0,
            top: 0.0,
            right: 900.0,
            bottom: 600.0,
        };
        let rects = place(&points, &texts, 5.0, 12.0, &[], &frame);
        assert_eq!(rects.len(), points.len());
        for (i, a) in rects.iter().enumerate() {
            assert!(a.inside(&frame), "{a:?}");
            for b in &rects[..i] {
                assert!(a.overlap(b) <= 0.0, "{a:?} {b:?}");
            }
        }
    }
}
