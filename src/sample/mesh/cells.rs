//! Divides a surface into cells of about equal area. Each piece goes to its nearest site, each site to the
//! centroid of its pieces (Lloyd's relaxation, on pieces instead of the plane).
//!
//! Lengths are in units of the spacing, so that a cell has an area of about one.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::grid::Cubes;
use super::pieces::{Piece, cut};
use super::surface::{Surface, Triangle, area};
use crate::error::Result;
use crate::sample::points::neighbours::PointIndex;
use crate::sample::positions::index_u32;
use crate::task::{Stage, Task};

/// Longest side of a piece, in spacings: some seven pieces make a cell.
const LONGEST_SIDE: f64 = 0.9;

/// Side of the cubes into which pieces and sites are sorted, in spacings. The nearest site is closer than that,
/// and some fifteen sites are compared.
const CUBE_SIDE: f64 = 1.25;

/// Number of times that sites move towards their cells' centroids. Kernels compensate for irregular cells
/// (`surfels::tangents`), so more rounds gain little. On a plane under a low-pass filter as wide as the
/// spacing, sums of weights are off by .065, .051, .046 % rms after 2, 3 and 4 rounds.
const RELAXATIONS: usize = 2;

/// Step of a site, as a multiple of the way to the centroid: over-relaxation converges sooner.
const OVERSHOOT: f64 = 1.6;

/// Weight of the distance from a site's tangent plane relative to the distance within it: keeps the layers of a
/// thin shell apart.
const OFF_PLANE: f32 = 4.0;

/// Cosine of the greatest angle between normals within a cell: sharper edges separate cells.
const LEAST_COSINE: f32 = 0.5;

/// Penalty, in squared spacings, for a site across a sharp edge, on the other side of a sheet or on another
/// component. It exceeds any distance to a near site. It is finite, so that pieces without a fitting site still
/// belong to one.
const STRANGE: f32 = 16.0;

/// Marks a piece without an owner.
const NOBODY: u32 = u32::MAX;

/// The pieces of a surface, by cell.
#[derive(Debug)]
pub(super) struct Cells {
    pub(super) pieces: Vec<Piece>,
    /// Indices of pieces, cell by cell.
    owned: Owned,
}

/// A site, and the properties by which pieces choose it.
#[derive(Debug, Clone, Copy)]
struct Site {
    position: DVec3,
    normal: Vec3,
    component: u32,
    /// Cube of one of its pieces.
    home: u32,
}

impl Cells {
    /// Divides `triangles` into about `count` cells; each triangle has a part in at least one.
    pub(super) fn new(
        surface: &Surface,
        triangles: &[Triangle],
        count: usize,
        seed: u64,
        task: Option<&Task>,
    ) -> Result<Self> {
        let pieces = cut(surface, triangles, LONGEST_SIDE, count);
        let centres: Vec<DVec3> = pieces.par_iter().map(|p| p.centre).collect();
        let (cubes, order) = Cubes::new(&centres, CUBE_SIDE);
        drop(centres);
        let pieces: Vec<Piece> = order.par_iter().map(|&i| pieces[i as usize]).collect();
        let mut sites = first_sites(&pieces, triangles, &cubes, count, seed);
        let stage = Stage::new(task, "spreading surfels", RELAXATIONS);
        for _ in 0..RELAXATIONS {
            stage.check()?;
            let owned = owned(&pieces, triangles, &cubes, &sites);
            relax(&mut sites, &pieces, triangles, &cubes, &owned);
            stage.advance(1);
        }
        let owned = owned(&pieces, triangles, &cubes, &sites);
        Ok(Self { pieces, owned })
    }

    pub(super) fn len(&self) -> usize {
        self.owned.starts.len() - 1
    }

    /// Returns the indices of the pieces of a cell.
    pub(super) fn pieces_of(&self, cell: usize) -> &[u32] {
        self.owned.of(cell)
    }
}

/// Places one site in each stretch of equal area along the pieces, which are ordered along a space-filling
/// curve.
fn first_sites(
    pieces: &[Piece],
    triangles: &[Triangle],
    cubes: &Cubes,
    count: usize,
    seed: u64,
) -> Vec<Site> {
    let each = area(triangles) / count as f64;
    let mut sites: Vec<Site> = Vec::with_capacity(count);
    let mut passed = 0.0;
    let mut stretch = 0_u64;
    // In the middle half of each stretch: neither in step with the mesh nor too uneven.
    let point = |stretch: u64| each * (stretch as f64 + 0.25 + 0.5 * random(seed, stretch));
    let mut next = point(0);
    for cube in 0..cubes.len() {
        for i in cubes.points(cube) {
            let piece = &pieces[i];
            let triangle = &triangles[piece.triangle as usize];
            passed += triangle.area * piece.share();
            let is_last = i + 1 == pieces.len();
            if passed <= next && !(is_last && sites.is_empty()) {
                continue;
            }
            sites.push(Site {
                position: piece.centre,
                normal: triangle.normal,
                component: triangle.component,
                home: index_u32(cube),
            });
            // If several points lie in one piece, one of them becomes a site.
            stretch = stretch.max(whole(passed / each).saturating_sub(1));
            while next < passed {
                stretch += 1;
                next = point(stretch);
            }
        }
    }
    sites
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count, rounded down"
)]
fn whole(count: f64) -> u64 {
    count as u64
}

/// Returns a random number, uniform in [0, 1), that depends on the two arguments alone (splitmix64).
pub(super) fn random(seed: u64, index: u64) -> f64 {
    let mut z = seed.wrapping_add(index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Number of sites that are compared at a time.
const LANES: usize = 8;

/// The sites among which the pieces of one cube choose, relative to one point.
#[derive(Debug, Default)]
struct Candidates {
    indices: Vec<u32>,
    bundles: Vec<Bundle>,
}

/// A group of sites in lanes. Unused lanes lie far away.
#[derive(Debug, Clone, Copy)]
struct Bundle {
    offset: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
    component: [u32; LANES],
}

impl Bundle {
    const EMPTY: Self = Self {
        offset: [[1e15; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        component: [0; LANES],
    };
}

/// Number of cubes whose pieces are assigned to sites at a time.
const CUBES_OF_CHUNK: usize = 256;

/// Assigns each piece to a site.
fn owned(pieces: &[Piece], triangles: &[Triangle], cubes: &Cubes, sites: &[Site]) -> Owned {
    let homes: Vec<u32> = sites.iter().map(|s| s.home).collect();
    let sites_of = Owned::by(&homes, cubes.len());
    let chunk = |first: usize| {
        let last = (first + CUBES_OF_CHUNK).min(cubes.len());
        let mut found = Vec::with_capacity(cubes.points(last - 1).end - cubes.points(first).start);
        let mut near = Candidates::default();
        for cube in first..last {
            let points = cubes.points(cube);
            let reference = pieces[points.start].centre;
            near.gather(cubes.around(cube), &sites_of, sites, reference);
            near.choose(&pieces[points], triangles, reference, &mut found);
        }
        found
    };
    let firsts = (0..cubes.len()).into_par_iter().step_by(CUBES_OF_CHUNK);
    let lists: Vec<Vec<u32>> = firsts.map(chunk).collect();
    let mut owners = lists.concat();
    if owners.contains(&NOBODY) {
        // Pieces far from all sites, as small parts of a scattered mesh may be.
        let positions: Vec<DVec3> = sites.iter().map(|s| s.position).collect();
        if let Some(index) = PointIndex::new(&positions) {
            let nearest = |piece: &Piece| index.nearest_to(piece.centre).unwrap_or(0);
            let lost = owners
                .par_iter_mut()
                .zip(pieces)
                .filter(|(o, _)| **o == NOBODY);
            lost.for_each(|(owner, piece)| *owner = nearest(piece));
        }
        // All sites coincide: take the first.
        owners
            .iter_mut()
            .filter(|o| **o == NOBODY)
            .for_each(|o| *o = 0);
    }
    Owned::by(&owners, sites.len())
}

impl Candidates {
    fn gather(&mut self, around: &[u32], sites_of: &Owned, sites: &[Site], reference: DVec3) {
        self.indices.clear();
        self.bundles.clear();
        for &cube in around {
            for &index in sites_of.of(cube as usize) {
                let site = &sites[index as usize];
                let lane = self.indices.len() % LANES;
                if lane == 0 {
                    self.bundles.push(Bundle::EMPTY);
                }
                self.indices.push(index);
                let Some(bundle) = self.bundles.last_mut() else {
                    continue;
                };
                let offset = (site.position - reference).as_vec3();
                for axis in 0..3 {
                    bundle.offset[axis][lane] = offset[axis];
                    bundle.normal[axis][lane] = site.normal[axis];
                }
                bundle.component[lane] = site.component;
            }
        }
    }

    /// Finds the nearest site to each of some pieces.
    fn choose(
        &self,
        pieces: &[Piece],
        triangles: &[Triangle],
        reference: DVec3,
        found: &mut Vec<u32>,
    ) {
        // Compiled for the processor's vector instructions, without fused operations: the choice is the same on
        // all processors.
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                for piece in pieces {
                    let triangle = &triangles[piece.triangle as usize];
                    let at = (piece.centre - reference).as_vec3();
                    found.push(self.best(at, triangle).unwrap_or(NOBODY));
                }
            },
        );
    }

    /// Returns the nearest site to a piece at `at`; the first of equally near ones.
    #[inline(always)]
    fn best(&self, at: Vec3, triangle: &Triangle) -> Option<u32> {
        let mut least = [f32::INFINITY; LANES];
        let mut best = [0_u32; LANES];
        for (number, bundle) in (0_u32..).zip(&self.bundles) {
            let [x, y, z] = &bundle.offset;
            let [nx, ny, nz] = &bundle.normal;
            for lane in 0..LANES {
                let (dx, dy, dz) = (at.x - x[lane], at.y - y[lane], at.z - z[lane]);
                let off_plane = dx * nx[lane] + dy * ny[lane] + dz * nz[lane];
                let cosine = triangle.normal.x * nx[lane]
                    + triangle.normal.y * ny[lane]
                    + triangle.normal.z * nz[lane];
                let distance = dx * dx + dy * dy + dz * dz;
                let is_across = cosine < LEAST_COSINE;
                let is_apart = bundle.component[lane] != triangle.component;
                let cost = distance
                    + OFF_PLANE * off_plane * off_plane
                    + if is_across { STRANGE } else { 0.0 }
                    + if is_apart { STRANGE } else { 0.0 };
                let is_better = cost < least[lane];
                least[lane] = if is_better { cost } else { least[lane] };
                best[lane] = if is_better { number } else { best[lane] };
            }
        }
        let place = |lane: usize| best[lane] as usize * LANES + lane;
        let first = (0..LANES).min_by(|&a, &b| {
            let by_cost = least[a].total_cmp(&least[b]);
            by_cost.then(place(a).cmp(&place(b)))
        })?;
        self.indices.get(place(first)).copied()
    }
}

/// Moves sites towards their pieces' centroids, and sets their normals to the mean of the pieces'.
fn relax(
    sites: &mut [Site],
    pieces: &[Piece],
    triangles: &[Triangle],
    cubes: &Cubes,
    owned: &Owned,
) {
    sites.par_iter_mut().enumerate().for_each(|(i, site)| {
        let (mut whole, mut position, mut normal) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for &piece in owned.of(i) {
            let piece = &pieces[piece as usize];
            let triangle = &triangles[piece.triangle as usize];
            let area = triangle.area * piece.share();
            whole += area;
            position += area * piece.centre;
            normal += area * triangle.normal.as_dvec3();
        }
        if !(whole > 0.0) {
            return;
        }
        let centroid = position / whole;
        site.position += OVERSHOOT * (centroid - site.position);
        if let Some(normal) = normal.try_normalize() {
            site.normal = normal.as_vec3();
        }
        if let Some(cube) = cubes.at(site.position) {
            site.home = index_u32(cube);
        }
    });
}

/// Indices by owner, ascending within each.
#[derive(Debug)]
pub(super) struct Owned {
    pub(super) order: Vec<u32>,
    /// Index in `order` at which each owner's list begins; one more entry at the end.
    starts: Vec<u32>,
}

impl Owned {
    pub(super) fn by(owners: &[u32], count: usize) -> Self {
        let mut starts = vec![0_u32; count + 1];
        for &owner in owners {
            starts[owner as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut order = vec![0; owners.len()];
        for (i, &owner) in owners.iter().enumerate() {
            let place = &mut next[owner as usize];
            order[*place as usize] = index_u32(i);
            *place += 1;
        }
        Self { order, starts }
    }

    pub(super) fn of(&self, owner: usize) -> &[u32] {
        &self.order[self.starts[owner] as usize..self.starts[owner + 1] as usize]
    }
}
