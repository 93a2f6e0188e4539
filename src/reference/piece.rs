//! Classifies kernels over their own extent in f64, directly from the definition (section 9.1 of the
//! mathematics). It is the reference for the renderer's ghost layers, codes and tables.

use glam::{DMat3, DVec3};

use super::lobe::window_moments;
use crate::math::{lower_factor, principal_sigmas};
use crate::scene::{
    LOBE_REACH, Lattice, LatticeSpacing, Lobe, Lobes, MAX_PIECE_WIDTH, Particles, PointVolume,
    Strength, TransferFunction, Values,
};

/// The field of a volume over its kernels.
pub(super) struct FieldOf<'a> {
    volume: &'a PointVolume,
    values: &'a Values,
    transfer: &'a TransferFunction,
    /// Lobes, and the spread from which kernels are classified over their extents: the renderer's own rule, but
    /// none of its tables.
    lobes: Lobes,
    /// Value and extinction of the function's entries.
    knots: Vec<[f64; 2]>,
}

/// The part of a kernel that a lobe leaves.
pub(super) struct Piece {
    pub(super) extinction: f64,
    pub(super) colour: [f32; 3],
    /// Axis in the frame of the kernel's factor; zero if the kernel is unchanged.
    axis: DVec3,
    shift: f64,
    width: f64,
}

impl Piece {
    /// Returns centre and factor of the piece.
    pub(super) fn of(&self, position: DVec3, factor: DMat3) -> (DVec3, DMat3) {
        let across = DMat3::from_cols(
            self.axis * self.axis.x,
            self.axis * self.axis.y,
            self.axis * self.axis.z,
        );
        let shape = factor * (DMat3::IDENTITY + across * (self.width - 1.0));
        (position + factor * self.axis * self.shift, shape)
    }
}

/// Model of the field over one kernel.
struct Model {
    slope: DVec3,
    departure: f64,
    around: [f64; 2],
}

impl<'a> FieldOf<'a> {
    /// Returns `None` if nothing is known of the field around particles.
    pub(super) fn new(volume: &'a PointVolume) -> Option<Self> {
        let is_lattice = matches!(volume.particles, Particles::Lattice { .. });
        let is_classified = matches!(volume.strength, Strength::Classified { .. });
        if !is_classified || !(is_lattice || volume.local_models.is_some()) {
            return None;
        }
        let (values, transfer) = (volume.values.as_ref()?, volume.transfer_function.as_ref()?);
        let widest = |i: usize| {
            let (_, factor, _) = volume.particles.shape(i);
            principal_sigmas(lower_factor(factor))[0]
        };
        let sigma = (0..volume.particles.len()).map(widest).fold(0.0, f64::max);
        let [low, high] = transfer.range().map(f64::from);
        let last = (transfer.table().len() - 1) as f64;
        let knots = transfer.table().iter().enumerate();
        let knots = knots.map(|(i, entry)| {
            let share = i as f64 / last;
            [low * (1.0 - share) + high * share, f64::from(entry[3])]
        });
        Some(Self {
            volume,
            values,
            transfer,
            lobes: transfer.lobes(sigma as f32),
            knots: knots.collect(),
        })
    }

    /// Calls `each` for every piece of a particle's kernel.
    pub(super) fn pieces(&self, i: usize, mut each: impl FnMut(Piece)) {
        let value = self.values.get(i);
        if !value.is_finite() {
            return;
        }
        let own = f64::from(value);
        let model = self.model(i, own);
        let spread = model.slope.length();
        let middle = own + model.departure;
        for lobe in self.lobes.lobes() {
            if !(spread > f64::from(lobe.threshold)) {
                let [r, g, b, extinction] = self.transfer.classify(value);
                if lobe.holds(value) && extinction > 0.0 {
                    each(Piece {
                        extinction: extinction.into(),
                        colour: [r, g, b],
                        axis: DVec3::ZERO,
                        shift: 0.0,
                        width: 1.0,
                    });
                }
                continue;
            }
            let [first, last] = lobe.interval.map(f64::from);
            let outside = (middle - middle.clamp(first, last)) / spread;
            let beyond = f64::from(lobe.beyond[usize::from(outside > 0.0)]);
            if outside.abs() > f64::from(LOBE_REACH) && beyond == 0.0 {
                continue;
            }
            let reach = f64::from(LOBE_REACH) * spread;
            let lo = model.around[0].max(middle - reach).min(own);
            let hi = model.around[1].min(middle + reach).max(own);
            if !lobe.meets(lo as f32, hi as f32) {
                continue;
            }
            let knots = self.knots_of(lobe, 10.0 * spread + (middle - first).abs());
            let [first, last] = lobe.interval;
            let [r, g, b, _] = self.transfer.classify(value.clamp(first, last));
            for moments in window_moments(&self.lobes, lobe, &knots, middle, spread) {
                let Some([extinction, shift, variance]) = moments else {
                    continue;
                };
                each(Piece {
                    extinction,
                    colour: [r, g, b],
                    axis: model.slope / spread,
                    shift,
                    width: variance.sqrt().min(f64::from(MAX_PIECE_WIDTH)),
                });
            }
        }
    }

    /// Returns the entries of a lobe; an open end extends as a constant by `far`.
    fn knots_of(&self, lobe: &Lobe, far: f64) -> Vec<[f64; 2]> {
        let [first, last] = lobe.interval.map(f64::from);
        // Half an entry on either side, so that rounding loses none.
        let margin = 0.5 * (self.knots[1][0] - self.knots[0][0]);
        let begin = self.knots.partition_point(|k| k[0] < first - margin);
        let end = self.knots.partition_point(|k| k[0] <= last + margin);
        let mut knots = Vec::with_capacity(end - begin + 2);
        if lobe.beyond[0] > 0.0 {
            knots.push([first - far, lobe.beyond[0].into()]);
        }
        knots.extend_from_slice(&self.knots[begin..end]);
        if lobe.beyond[1] > 0.0 {
            knots.push([last + far, lobe.beyond[1].into()]);
        }
        knots
    }

    fn model(&self, i: usize, own: f64) -> Model {
        let Particles::Lattice {
            lattice,
            kernel_width,
        } = &self.volume.particles
        else {
            let Some(models) = &self.volume.local_models else {
                return Model {
                    slope: DVec3::ZERO,
                    departure: 0.0,
                    around: [own; 2],
                };
            };
            // As stored: here the codes are the data.
            let model = models.get(i);
            return Model {
                slope: model.slope.as_dvec3(),
                departure: model.departure.into(),
                around: [own - f64::from(model.below), own + f64::from(model.above)],
            };
        };
        let [nx, ny, nz] = lattice.dims.map(|n| n as i64);
        let at = i as i64;
        let cell = [at % nx, at / nx % ny, at / (nx * ny)];
        let value = |steps: [i64; 3]| {
            let [x, y, z] = [0, 1, 2].map(|a| cell[a] + steps[a]);
            let inside = (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z);
            let value = inside.then(|| self.values.get((x + nx * (y + ny * z)) as usize))?;
            value.is_finite().then_some(f64::from(value))
        };
        let (mut slope, mut second) = (DVec3::ZERO, 0.0);
        for axis in 0..3 {
            let side = |step: i64| {
                let mut steps = [0; 3];
                steps[axis] = step;
                let position = |n: i64| {
                    let mut other = cell.map(|c| c as usize);
                    other[axis] = (cell[axis] + n) as usize;
                    lattice.position(other)[axis]
                };
                value(steps).map(|v| (v - own, position(step) - position(0)))
            };
            match (side(-1), side(1)) {
                (Some((below, _)), Some((above, _))) if !is_rectilinear(lattice) => {
                    slope[axis] = 0.5 * (above - below);
                    second += above + below;
                }
                (Some((below, left)), Some((above, right))) => {
                    slope[axis] = 0.5 * (above - below);
                    let gradient = (above - below) / (right - left);
                    second += above + below - gradient * (right + left);
                }
                (Some((below, _)), None) => slope[axis] = -below,
                (None, Some((above, _))) => slope[axis] = above,
                (None, None) => {}
            }
        }
        let near = -2..=2_i64;
        let mut around = [own; 2];
        for dz in near.clone() {
            for dy in near.clone() {
                for dx in near.clone() {
                    if let Some(v) = value([dx, dy, dz]) {
                        around = [around[0].min(v), around[1].max(v)];
                    }
                }
            }
        }
        Model {
            slope: slope * *kernel_width,
            departure: 0.5 * kernel_width * kernel_width * second,
            around,
        }
    }
}

fn is_rectilinear(lattice: &Lattice) -> bool {
    matches!(lattice.spacing, LatticeSpacing::Rectilinear { .. })
}
