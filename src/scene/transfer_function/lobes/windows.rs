//! Divides lobes with steps into windows. At a jump of the extinction, a single Gaussian for the piece of a
//! kernel is off by half a level's width. Several Gaussians, one for each smooth window, are not.
//!
//! The windows of a lobe add up to 1 everywhere: they are Gaussians over their sum. Their distances from a step
//! grow by [`GROWTH`], and one window has the rest of the lobe. Distances are in units of the kernel's own w,
//! so that kernels far from a step, in these units, meet a single window.

use super::MAX_WINDOWS;

/// Distance of a step's first two windows, in standard deviations of a kernel's values.
const FIRST_DISTANCE: f64 = 0.5;

/// Growth of distances from window to window.
const GROWTH: f64 = 1.6;

/// Deviation of a window, as a share of its distance to the next.
const OVERLAP: f64 = 0.6;

/// Number of windows on one side of a step, besides the rest of the lobe.
///
/// Errors of opaque steps of 33³ and 65³ nodes, in grey levels: 10.7 and 6.0 without windows; 8.6 and 5.1 with
/// one besides the rest, 6.4 and 3.9 with two, 6.1 and 3.6 with three. These need 1.7 and 1.4, 2.4 and 1.9, 3.2
/// and 2.5 times the kernels. With half the distance three windows have errors of 5.4 and 3.5, with twice the
/// distance two have 7.4 and 4.1.
const GRADED: usize = 2;

/// A change of extinction from an entry to the next is a jump if it is above this share of the lobe's peak, and
/// this multiple of the changes on both sides.
const JUMP_SHARE: f64 = 1.0 / 16.0;
const JUMP_CONTRAST: f64 = 4.0;

/// Rate at which a window fades out if w leaves too little room for it. With 8, a row of a table is too far
/// from the next (a seventh of a faint window's mass).
const FADE: f64 = 2.0;

/// If a window needs this many times the room that it has, nothing is left: 2e-4.
const FADED: f64 = 3.0;

/// Least number of entries of a lobe with steps: in a shorter one a step is a ramp as wide as the lobe.
const LEAST_ENTRIES: usize = 16;

/// A window is 0 beyond this many of its deviations.
const FAR: f64 = 8.0;

/// A window before all are divided by their sum: 1 between two positions that move with w, and falling as a
/// Gaussian beyond them. Positions are in entries of the function's table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shape {
    /// Steps at which the window begins and ends (infinite if there is none), and its distances from them, in
    /// w.
    pub(super) anchors: [f64; 2],
    pub(super) offsets: [f64; 2],
    /// Standard deviation, in w.
    pub(super) deviation: f64,
    /// The window fades if `need` w is more than `room`.
    need: f64,
    room: f64,
    /// Whether the window is one of a step's, and not the rest of the lobe.
    pub(super) is_graded: bool,
}

impl Shape {
    /// The window of a lobe without steps.
    const WHOLE: Self = Self {
        anchors: [f64::NEG_INFINITY, f64::INFINITY],
        offsets: [0.0; 2],
        deviation: 1.0,
        need: 0.0,
        room: 1.0,
        is_graded: false,
    };

    /// The least w at which the window has faded.
    pub(super) fn gone(&self) -> f64 {
        FADED * self.room / self.need
    }

    /// Logarithm of the window at a position, for kernels of a standard deviation `w`; `None` if the window is
    /// negligible there.
    fn log(&self, place: f64, w: f64) -> Option<f64> {
        let [mut from, mut to] = [
            self.anchors[0] + self.offsets[0] * w,
            self.anchors[1] - self.offsets[1] * w,
        ];
        if from > to {
            from = 0.5 * (self.anchors[0] + self.anchors[1]);
            to = from;
        }
        let away = (place - place.clamp(from, to)) / (self.deviation * w);
        let mut lack = (self.need * w / self.room - 1.0).max(0.0);
        if self.is_graded {
            // For a kernel narrower than an entry, a jump is a ramp.
            lack = lack.max(1.0 / w - 1.0);
        }
        (away.abs() < FAR).then_some(-0.5 * away * away - FADE * lack * lack)
    }
}

/// The share of each window at a position; the shares add up to 1.
pub(crate) fn weights(shapes: &[Shape], place: f64, w: f64) -> [f64; MAX_WINDOWS] {
    let mut out = [0.0; MAX_WINDOWS];
    if shapes.len() == 1 {
        out[0] = 1.0;
        return out;
    }
    let mut logs = [None; MAX_WINDOWS];
    let mut most = f64::NEG_INFINITY;
    for (log, shape) in logs.iter_mut().zip(shapes) {
        *log = shape.log(place, w);
        most = log.map_or(most, |log| most.max(log));
    }
    let mut sum = 0.0;
    for (weight, log) in out.iter_mut().zip(logs) {
        *weight = log.map_or(0.0, |log| (log - most).exp());
        sum += *weight;
    }
    if !(sum > 0.0) {
        // Far from the lobe.
        out[0] = 1.0;
        return out;
    }
    out.iter_mut().for_each(|weight| *weight /= sum);
    out
}

/// A jump of a lobe's extinction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Jump {
    /// Position, in entries of the function's table.
    pub(super) place: f64,
    /// Change of the extinction.
    pub(super) size: f64,
    /// Whether the lobe continues on both sides.
    pub(super) is_inside: bool,
}

impl Jump {
    /// Number of windows that a lobe has for the jump, besides the rest.
    pub(super) fn window_count(&self) -> usize {
        if self.is_inside { 2 * GRADED } else { GRADED }
    }
}

/// The jumps of a lobe.
///
/// - `first`: the entry of the first of `values`.
/// - `least`: least change of extinction that counts.
pub(super) fn jumps(values: &[f64], first: f64, least: f64) -> Vec<Jump> {
    if values.len() < LEAST_ENTRIES {
        return Vec::new();
    }
    let peak = values.iter().copied().fold(0.0, f64::max);
    let change = |i: usize| match (values.get(i), values.get(i + 1)) {
        (Some(a), Some(b)) => (b - a).abs(),
        _ => 0.0,
    };
    let before = |i: usize| if i > 0 { change(i - 1) } else { 0.0 };
    let least = least.max(JUMP_SHARE * peak);
    let is_end = |i: usize| {
        let last = values.len() - 1;
        (i == 0 && values[0] == 0.0) || (i + 1 == last && values[last] == 0.0)
    };
    let is_jump = |&i: &usize| {
        let beside = change(i + 1).max(before(i));
        change(i) > least && change(i) > JUMP_CONTRAST * beside
    };
    (0..values.len())
        .filter(is_jump)
        .map(|i| Jump {
            place: first + i as f64 + 0.5,
            size: change(i),
            is_inside: !is_end(i),
        })
        .collect()
}

/// The windows of a lobe.
///
/// - `ends`: first and last entry of the lobe.
/// - `is_open`: whether the lobe continues beyond them.
/// - `jumps`: in the order of their positions.
pub(super) fn shapes(ends: [f64; 2], is_open: [bool; 2], jumps: &[Jump]) -> Vec<Shape> {
    let [Some(first_jump), Some(last_jump)] = [jumps.first(), jumps.last()] else {
        return vec![Shape::WHOLE];
    };
    let is_first = |jump: &Jump| !jump.is_inside && jump.place < ends[0] + 1.0;
    let ends = [
        if is_open[0] {
            f64::NEG_INFINITY
        } else {
            ends[0]
        },
        if is_open[1] { f64::INFINITY } else { ends[1] },
    ];
    let own = GRADED;
    let distance = |n: usize| FIRST_DISTANCE * (0..n).map(|_| GROWTH).product::<f64>();
    // Offset of window n, and its deviation.
    let offset = |n: usize| (0..n).map(distance).sum::<f64>();
    let deviation = |n: usize| {
        let before = distance(n.saturating_sub(1));
        let after = if n < own { distance(n) } else { before };
        OVERLAP * (before * after).sqrt()
    };
    let mut shapes = Vec::new();
    // The rest between two steps is one window.
    let mut rest = |from: Option<f64>, to: Option<f64>| {
        let at = |step: Option<f64>| step.map_or(0.0, |_| offset(own));
        let length = to.unwrap_or(ends[1]) - from.unwrap_or(ends[0]);
        shapes.push(Shape {
            anchors: [
                from.unwrap_or(f64::NEG_INFINITY),
                to.unwrap_or(f64::INFINITY),
            ],
            offsets: [at(from), at(to)],
            deviation: deviation(own),
            // Less than any of a step's windows: the rest stays when all fade.
            need: 0.1 * FIRST_DISTANCE,
            room: length,
            is_graded: false,
        });
    };
    if !is_first(first_jump) {
        rest(None, Some(first_jump.place));
    }
    for pair in jumps.windows(2) {
        rest(Some(pair[0].place), Some(pair[1].place));
    }
    if last_jump.is_inside || is_first(last_jump) {
        rest(Some(last_jump.place), None);
    }
    for (i, jump) in jumps.iter().enumerate() {
        // Half the distance to another step, all of it to the lobe's end.
        let below = match i.checked_sub(1) {
            Some(i) => 0.5 * (jump.place - jumps[i].place),
            None => jump.place - ends[0],
        };
        let above = match jumps.get(i + 1) {
            Some(next) => 0.5 * (next.place - jump.place),
            None => ends[1] - jump.place,
        };
        for n in 0..own {
            let mut graded = |side: f64, room: f64| {
                shapes.push(Shape {
                    anchors: [jump.place; 2],
                    offsets: [side * offset(n), -side * offset(n)],
                    deviation: deviation(n),
                    need: offset(n) + 2.0 * deviation(n),
                    room,
                    is_graded: true,
                });
            };
            if jump.is_inside && n == 0 {
                graded(0.0, below.min(above));
                continue;
            }
            if jump.is_inside || is_first(jump) {
                graded(1.0, above);
            }
            if jump.is_inside || !is_first(jump) {
                graded(-1.0, below);
            }
        }
    }
    shapes
}
