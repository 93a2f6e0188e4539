//! Merges surfels whose surroundings look alike. What is left is small where colours change or the surface ends, and
//! large elsewhere.
//!
//! Neighbouring cells merge in pairs, the cheapest first (Ward's method on a graph of neighbours). A cell keeps the
//! moments of its parts. The cost of a pair is what its kernel shows wrongly of the surface under it, less what the
//! kernels of the two showed wrongly:
//!
//! - the variance of colours and of visible shares under the kernel,
//! - what lies beyond the surface's edges,
//! - normals that differ from the kernel's.
//!
//! All three are sums over the first surfels, weighted by the kernel. The kernel reaches beyond its cell, so cells beside
//! an edge of the texture stay narrow across it and become long along it.

use glam::DVec3;

use super::cells::Owned;
use super::surfels::{SQUARE, Surfel, axes};
use crate::error::Result;
use crate::parallel;
use crate::sample::pairs::Pairs;
use crate::sample::points::neighbours::square;
use crate::sample::positions::index_u32;
use crate::task::{Stage, Task};

/// Number of nearest neighbours with which a surfel may merge.
const NEIGHBOURS: usize = 6;

/// Greatest share of cells that merge in one round. On a cow and on a sphere, shares of .15 and .3 gave the same PSNR
/// within .1 dB, .5 gave .4 dB less.
const SHARE_PER_ROUND: f64 = 0.3;

/// Least cosine between the normals of two cells that merge.
const LEAST_COSINE: f64 = 0.8;

/// Cost of what a kernel shows beyond the surface, per area: the squared difference to an unknown background, summed over
/// three channels.
const BEYOND: f64 = 0.5;

/// Cost per area and per 1 - cosine between a kernel's normal and the surface's.
const TURNED: f64 = 0.5;

/// Cost of merging areas a and b at a distance d, over a b d² / (a + b): makes cells of one colour even in size, and is
/// small beside a visible difference.
const SIZE: f64 = 0.02;

/// Squared distance, in standard deviations, up to which a kernel is compared with the surface.
const REACH: f64 = 7.0;

/// The share of a Gaussian's mass within [`REACH`].
const WITHIN_REACH: f64 = 0.97;

/// Variance of a kernel along its normal, as a share of its variances in the plane. Surface farther off counts as missing.
const THICKNESS: f64 = 1e-3;

/// A cell: one surfel or several merged ones. Lengths are in spacings of the first surfels.
#[derive(Debug, Clone, Copy)]
struct Cell {
    centre: DVec3,
    /// Variance of the cell, without its kernel's blur: xx, xy, xz, yy, yz, zz.
    variance: [f64; 6],
    /// Unit normal.
    normal: DVec3,
    area: f64,
    /// Codes of the colour and the visible share, means under the kernel.
    look: [f64; 4],
    /// Cost of what the kernel shows wrongly.
    error: f64,
}

/// A surfel as it was sampled.
#[derive(Debug, Clone, Copy)]
struct Sample {
    centre: DVec3,
    normal: DVec3,
    area: f64,
    look: [f64; 4],
}

struct Merging {
    samples: Vec<Sample>,
    cells: Vec<Cell>,
    /// The next sample of the same cell; itself for the last one.
    next: Vec<u32>,
    /// The last sample of each cell.
    last: Vec<u32>,
    /// Variance of a kernel over that of its cell.
    widening: f64,
}

/// Returns about `count` surfels that look like the given ones, which are spread evenly. Surfels without a colour or a
/// visible share are left out of merging.
///
/// - `width`: standard deviation of the surfel of a square cell over the cell's side.
///
/// More than `count` are left if too few are neighbours or have similar normals.
pub(super) fn merged(
    surfels: &[Surfel],
    count: usize,
    width: f64,
    task: Option<&Task>,
) -> Result<Vec<Surfel>> {
    let (sound, mut rest): (Vec<Surfel>, Vec<Surfel>) =
        surfels.iter().partition(|surfel| surfel.is_seen());
    let centres: Vec<DVec3> = sound.iter().map(|s| s.centre).collect();
    let Some(mut pairs) = Pairs::of_nearest(&centres, NEIGHBOURS, task)? else {
        return Ok(surfels.to_vec());
    };
    let stage = Stage::new(task, "merging surfels", sound.len().saturating_sub(count));
    let mut merging = Merging::new(&sound, width);
    let mut alive = sound.len();
    let mut is_part = vec![false; sound.len()];
    while alive > count {
        stage.check()?;
        let merged = merging.round(&mut pairs, alive - count, alive);
        if merged.is_empty() {
            break;
        }
        alive -= merged.len();
        stage.advance(merged.len());
        for [_, part] in merged {
            is_part[part as usize] = true;
        }
    }
    let kept = (0..sound.len()).filter(|&i| !is_part[i]);
    let mut found: Vec<Surfel> = kept.map(|i| merging.surfel(i, &sound)).collect();
    found.append(&mut rest);
    Ok(found)
}

impl Merging {
    fn new(surfels: &[Surfel], width: f64) -> Self {
        let widening = width * width / SQUARE;
        let sample = |surfel: &Surfel| {
            let [r, g, b] = surfel.codes();
            Sample {
                centre: surfel.centre,
                normal: surfel.normal(),
                area: surfel.area,
                look: [r, g, b, surfel.share],
            }
        };
        let samples: Vec<Sample> = surfels.iter().map(sample).collect();
        let cell = |(surfel, sample): (&Surfel, &Sample)| {
            let [a, b] = surfel.tangents.map(square);
            Cell {
                centre: sample.centre,
                variance: std::array::from_fn(|i| (a[i] + b[i]) / widening),
                normal: sample.normal,
                area: sample.area,
                look: sample.look,
                error: 0.0,
            }
        };
        let cells = surfels.iter().zip(&samples).map(cell).collect();
        let alone: Vec<u32> = (0..samples.len()).map(index_u32).collect();
        Self {
            samples,
            cells,
            next: alone.clone(),
            last: alone,
            widening,
        }
    }

    /// Merges the cheapest pairs, at most `most` of them; no cell takes part twice. Returns these pairs.
    fn round(&mut self, pairs: &mut Pairs, most: usize, alive: usize) -> Vec<[u32; 2]> {
        let around = Around::new(pairs, self.cells.len());
        pairs.price(|pair| {
            let [own, other] = pair.map(|c| &self.cells[c as usize]);
            self.united(pair, &around).map_or(f64::INFINITY, |united| {
                let apart = own.centre.distance_squared(other.centre);
                let even = SIZE * own.area * other.area / united.area * apart;
                united.error - own.error - other.error + even
            })
        });
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let most = most.min((SHARE_PER_ROUND * alive as f64).ceil() as usize);
        let merged = pairs.cheapest(most);
        let united = parallel::map(merged.len(), |i| self.united(merged[i], &around));
        for (&[own, other], united) in merged.iter().zip(united) {
            let (own, other) = (own as usize, other as usize);
            if let Some(united) = united {
                self.cells[own] = united;
            }
            self.next[self.last[own] as usize] = index_u32(other);
            self.last[own] = self.last[other];
        }
        pairs.merge(&merged);
        merged
    }

    /// Returns two cells as one, or `None` if their normals differ too much.
    fn united(&self, pair: [u32; 2], around: &Around) -> Option<Cell> {
        let [own, other] = pair.map(|c| &self.cells[c as usize]);
        if own.normal.dot(other.normal) < LEAST_COSINE {
            return None;
        }
        let area = own.area + other.area;
        let (a, b) = (own.area / area, other.area / area);
        let between = square(own.centre - other.centre);
        let mut cell = Cell {
            centre: a * own.centre + b * other.centre,
            variance: std::array::from_fn(|i| {
                a * own.variance[i] + b * other.variance[i] + a * b * between[i]
            }),
            normal: (a * own.normal + b * other.normal).try_normalize()?,
            area,
            look: own.look,
            error: 0.0,
        };
        let kernel = Kernel::new(&cell, self.widening);
        let mut sum = Sum::default();
        around.each(pair, |c| {
            let mut i = c;
            loop {
                sum.add(&self.samples[i as usize], &kernel);
                let next = self.next[i as usize];
                if next == i {
                    break;
                }
                i = next;
            }
        });
        if sum.weight > 0.0 {
            cell.look = sum.look.map(|look| look / sum.weight);
        }
        cell.error = sum.error() + BEYOND * (kernel.mass - sum.weight).max(0.0);
        Some(cell)
    }

    /// Returns the surfel of a cell.
    fn surfel(&self, c: usize, surfels: &[Surfel]) -> Surfel {
        let cell = &self.cells[c];
        let mut i = c;
        let mut surfel = surfels[i];
        if self.next[i] as usize == i {
            return surfel;
        }
        let mut there = 0.0;
        let mut reflecting = DVec3::ZERO;
        let mut nearest = (f64::INFINITY, 0.0);
        loop {
            let part = &surfels[i];
            there += part.area * part.share;
            reflecting += part.reflecting;
            let offset = part.centre - cell.centre;
            let lift = offset.dot(cell.normal) / part.normal().dot(cell.normal);
            if offset.length_squared() < nearest.0 {
                nearest = (offset.length_squared(), lift);
            }
            let next = self.next[i] as usize;
            if next == i {
                break;
            }
            i = next;
        }
        surfel.tangents = axes(
            cell.normal,
            |a, b| dot(&cell.variance, a, b),
            |own| (self.widening * own).sqrt(),
        );
        // The centroid of a curved cell lies beside the surface: it moves back along the normal.
        let reach = surfel.tangents[0].length();
        let lift = if nearest.1.abs() <= reach {
            nearest.1
        } else {
            0.0
        };
        let [r, g, b, _] = cell.look;
        surfel.centre = cell.centre + lift * cell.normal;
        surfel.area = cell.area;
        surfel.set_codes([r, g, b]);
        surfel.share = there / cell.area;
        surfel.unpainted = 0.0;
        surfel.reflecting = reflecting;
        surfel
    }
}

/// Returns a · V b of a variance V.
fn dot([xx, xy, xz, yy, yz, zz]: &[f64; 6], a: DVec3, b: DVec3) -> f64 {
    xx * a.x * b.x
        + yy * a.y * b.y
        + zz * a.z * b.z
        + xy * (a.x * b.y + a.y * b.x)
        + xz * (a.x * b.z + a.z * b.x)
        + yz * (a.y * b.z + a.z * b.y)
}

/// The neighbours of all cells, ascending for each.
struct Around(Owned);

impl Around {
    fn new(pairs: &Pairs, cells: usize) -> Self {
        // First the smaller neighbours of each cell, then the larger ones.
        let [smaller, larger] = [0, 1].map(|place| pairs.all().map(move |pair| pair[place]));
        let owners: Vec<u32> = larger.clone().chain(smaller.clone()).collect();
        let others: Vec<u32> = smaller.chain(larger).collect();
        let mut of_cells = Owned::by(&owners, cells);
        for i in &mut of_cells.order {
            *i = others[*i as usize];
        }
        Self(of_cells)
    }

    /// Calls `visit` once for each cell of a pair and for each neighbour of them.
    fn each(&self, [own, other]: [u32; 2], mut visit: impl FnMut(u32)) {
        visit(own);
        visit(other);
        let (mut a, mut b) = (self.0.of(own as usize), self.0.of(other as usize));
        loop {
            let least = match (a.first(), b.first()) {
                (Some(&x), Some(&y)) => x.min(y),
                (Some(&x), None) | (None, Some(&x)) => x,
                (None, None) => return,
            };
            a = &a[usize::from(a.first() == Some(&least))..];
            b = &b[usize::from(b.first() == Some(&least))..];
            if least != own && least != other {
                visit(least);
            }
        }
    }
}

/// The kernel of a cell, in its plane.
struct Kernel {
    centre: DVec3,
    axes: [DVec3; 3],
    /// Inverse of the variance in the plane: xx, xy, yy.
    inverse: [f64; 3],
    /// Inverse of the variance along the normal.
    across: f64,
    /// Integral of exp(-Q/2) within [`REACH`].
    mass: f64,
}

impl Kernel {
    fn new(cell: &Cell, widening: f64) -> Self {
        let (x, y) = cell.normal.any_orthonormal_pair();
        let v = |a, b| widening * dot(&cell.variance, a, b);
        let (xx, xy, yy) = (v(x, x), v(x, y), v(y, y));
        let trace = (xx + yy).max(f64::MIN_POSITIVE);
        // Cells of wires have hardly any width.
        let determinant = (xx * yy - xy * xy).max(1e-9 * trace * trace);
        Self {
            centre: cell.centre,
            axes: [x, y, cell.normal],
            inverse: [yy, -xy, xx].map(|c| c / determinant),
            across: 1.0 / (THICKNESS * trace),
            mass: WITHIN_REACH * std::f64::consts::TAU * determinant.sqrt(),
        }
    }

    /// Returns the kernel at a point, zero beyond [`REACH`].
    fn at(&self, point: DVec3) -> f64 {
        let d = point - self.centre;
        let [x, y, z] = self.axes.map(|axis| axis.dot(d));
        let [xx, xy, yy] = self.inverse;
        let q = xx * x * x + 2.0 * xy * x * y + yy * y * y + self.across * z * z;
        if q > REACH { 0.0 } else { (-0.5 * q).exp() }
    }
}

/// Sums over the surface under a kernel.
#[derive(Default)]
struct Sum {
    weight: f64,
    look: [f64; 4],
    squares: f64,
    turned: f64,
}

impl Sum {
    fn add(&mut self, sample: &Sample, kernel: &Kernel) {
        let cosine = sample.normal.dot(kernel.axes[2]);
        let weight = sample.area * kernel.at(sample.centre);
        if !(cosine > 0.0 && weight > 0.0) {
            return;
        }
        self.weight += weight;
        self.turned += weight * (1.0 - cosine);
        for (sum, look) in self.look.iter_mut().zip(sample.look) {
            *sum += weight * look;
            self.squares += weight * look * look;
        }
    }

    fn error(&self) -> f64 {
        if self.weight <= 0.0 {
            return 0.0;
        }
        let mean: f64 = self.look.iter().map(|look| look * look / self.weight).sum();
        (self.squares - mean).max(0.0) + TURNED * self.turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns surfels of `side`² unit cells in a plane, coloured by `colour` of a cell's middle.
    fn plane(side: usize, width: f64, colour: impl Fn(f64, f64) -> f64) -> Vec<Surfel> {
        (0..side * side)
            .map(|i| {
                let (x, y) = ((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
                Surfel {
                    centre: DVec3::new(x, y, 0.0),
                    tangents: [DVec3::X * width, DVec3::Y * width],
                    area: 1.0,
                    colour: [colour(x, y); 3],
                    share: 1.0,
                    unpainted: 0.0,
                    reflecting: DVec3::Z,
                }
            })
            .collect()
    }

    /// Area, first and second moments of cells are kept, whatever merges.
    #[test]
    fn moments_are_kept() {
        let fine = plane(12, 0.5, |x, _| if x < 4.0 { 0.1 } else { 0.8 });
        let few = merged(&fine, 18, 0.5, None).unwrap();
        assert_eq!(few.len(), 18);
        let moments = |surfels: &[Surfel]| {
            let mut sum = [0.0; 4];
            for s in surfels {
                let [a, b] = s.tangents.map(|t| t * (SQUARE.sqrt() / 0.5));
                let xx = a.x * a.x + b.x * b.x + s.centre.x * s.centre.x;
                let terms = [1.0, s.centre.x, s.centre.y, xx].map(|m| m * s.area);
                sum = std::array::from_fn(|i| sum[i] + terms[i]);
            }
            sum
        };
        for (a, b) in moments(&fine).into_iter().zip(moments(&few)) {
            assert!((a - b).abs() < 1e-9 * a, "{a} {b}");
        }
    }

    /// Cells stay narrow across a jump of the colour; none has the mean of both colours.
    #[test]
    fn cells_beside_an_edge_stay_narrow_across_it() {
        let fine = plane(24, 0.5, |x, _| if x < 12.0 { 0.0 } else { 1.0 });
        let few = merged(&fine, 72, 0.5, None).unwrap();
        let extent = |s: &Surfel, axis: DVec3| {
            let [a, b] = s.tangents.map(|t| t.dot(axis));
            a.hypot(b)
        };
        let (mut beside, mut away) = (Vec::new(), Vec::new());
        for s in &few {
            let own = f64::from(u8::from(s.centre.x > 12.0));
            assert!((s.colour[0] - own).abs() < 0.3, "{s:?}");
            let list = match (s.centre.x - 12.0).abs() {
                near if near < 1.5 => &mut beside,
                far if far > 4.0 => &mut away,
                _ => continue,
            };
            list.push([extent(s, DVec3::X), extent(s, DVec3::Y)]);
        }
        let mean = |list: &[[f64; 2]], axis: usize| {
            list.iter().map(|e| e[axis]).sum::<f64>() / list.len() as f64
        };
        assert!(mean(&beside, 0) < 0.8, "{}", mean(&beside, 0));
        assert!(mean(&beside, 1) > 1.2 * mean(&beside, 0));
        assert!(mean(&away, 0) > 1.4 * mean(&beside, 0));
    }

    /// Sheets whose normals differ do not merge, however many are asked for.
    #[test]
    fn sides_of_a_sheet_stay_apart() {
        let mut both = plane(4, 0.5, |_, _| 0.5);
        let back = both.clone().into_iter().map(|s| Surfel {
            tangents: [s.tangents[1], s.tangents[0]],
            ..s
        });
        both.extend(back.collect::<Vec<_>>());
        let few = merged(&both, 1, 0.5, None).unwrap();
        assert_eq!(few.len(), 2);
        assert!(few.iter().all(|s| (s.area - 16.0).abs() < 1e-9));
        assert!(few[0].normal().dot(few[1].normal()) < -0.99);
    }
}
