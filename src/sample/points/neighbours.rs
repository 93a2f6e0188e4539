//! Finds neighbours of scattered points, and computes spacings, shapes and normals from them.

use glam::DVec3;
use rayon::prelude::*;

use super::tree::{Near, Search, Tree, UNLIMITED};

use crate::error::Result;
use crate::math::{NO_NORMAL, normal_code};
use crate::parallel;
use crate::sample::field::fit::Fit;
use crate::sample::positions::{compare, index_u32, is_same};
use crate::task::{Task, fill};

/// Number of neighbours from which shapes are computed: enough to average, few enough to stay local.
pub(in crate::sample) const NEIGHBOUR_COUNT: usize = 14;

/// Factors by which the number of fitted neighbours grows if fewer lie in a plane.
const MORE: [usize; 3] = [2, 4, 8];

/// Greatest number of neighbours to which a field is fitted.
pub(in crate::sample) const MOST_FITTED: usize = MORE[2] * NEIGHBOUR_COUNT;

/// First and last neighbour from which spacings are computed. On regular sets neighbours come in shells: a ball
/// that ends at any one of them is too small or too large by a sixth. The mean is within 2 % on a cubic
/// lattice.
pub(in crate::sample) const SPACING_NEIGHBOURS: [usize; 2] = [7, 18];

/// Greatest average number of neighbours per kernel: a hundred times the usual number in smoothing.
pub(in crate::sample) const MOST_NEIGHBOURS: usize = 8192;

/// Name of the neighbour search in progress reports.
pub(in crate::sample) const FINDING: &str = "finding neighbours";

/// Exchange with other ranks, which have neighbours of some local points.
pub(crate) trait Remote {
    /// Returns the sums of `own` over all ranks.
    fn sums(&mut self, own: [u64; 2]) -> Result<[u64; 2]>;

    /// Appends to the tensors of the local points those of their remote neighbours.
    fn complete(&mut self, own: Vec<[f64; 6]>) -> Result<Vec<[f64; 6]>>;
}

/// Number of neighbours that an index may list for each group: as many as local models are fitted to.
pub(in crate::sample) const LISTED: usize = 24;
const _: () = assert!(LISTED >= SPACING_NEIGHBOURS[1] && LISTED >= NEIGHBOUR_COUNT);

/// A tree of the finite points of a set. Each distinct position is in it once, with a group of points.
pub(in crate::sample) struct PointIndex<'a> {
    positions: &'a [DVec3],
    groups: Groups,
}

/// The groups of a [`PointIndex`], without the positions of the points.
pub(in crate::sample) struct Groups {
    /// Indices of the finite points; those of a group are adjacent.
    order: Vec<u32>,
    /// Index in `order` at which each group begins; one more entry at the end.
    starts: Vec<u32>,
    tree: Tree,
    /// The group itself and its [`LISTED`] neighbours, nearest first; empty unless they were listed. In a set of fewer
    /// groups, the remaining entries are [`NO_GROUP`].
    lists: Vec<[u32; LISTED + 1]>,
}

/// Stands for a neighbour that a small set lacks.
const NO_GROUP: u32 = u32::MAX;

impl<'a> PointIndex<'a> {
    /// Returns `None` for fewer than two distinct positions.
    pub(in crate::sample) fn new(positions: &'a [DVec3]) -> Option<Self> {
        let finite = (0..).zip(positions).filter(|(_, p)| p.is_finite());
        // Positions beside the indices: to look them up would take most of the time. Exact capacity: they are twice
        // as large as the tree.
        let mut points = Vec::with_capacity(finite.clone().count());
        points.extend(finite.map(|(i, p): (u32, &DVec3)| (*p, i)));
        points.par_sort_unstable_by(|a, b| compare(a.0, b.0).then(a.1.cmp(&b.1)));
        let sorted: Vec<u32> = points.iter().map(|point| point.1).collect();
        // One item for each position: the place of its first point.
        for (place, point) in (0..).zip(&mut points) {
            point.1 = place;
        }
        points.dedup_by(|b, a| is_same(a.0, b.0));
        if points.len() < 2 {
            return None;
        }
        let mut is_first = vec![false; sorted.len() + 1];
        points
            .iter()
            .for_each(|point| is_first[point.1 as usize] = true);
        is_first[sorted.len()] = true;
        let tree = Tree::new(&mut points);
        let mut starts = Vec::with_capacity(points.len() + 1);
        let mut order = Vec::with_capacity(sorted.len());
        for &(_, first) in &points {
            starts.push(index_u32(order.len()));
            let first = first as usize;
            let others = is_first[first + 1..]
                .iter()
                .take_while(|is_first| !**is_first);
            order.extend_from_slice(&sorted[first..=first + others.count()]);
        }
        starts.push(index_u32(order.len()));
        let groups = Groups {
            order,
            starts,
            tree,
            lists: Vec::new(),
        };
        Some(Self { positions, groups })
    }

    /// Makes the index of positions whose groups may be known. Returns `None` for fewer than two distinct positions.
    pub(in crate::sample) fn of(positions: &'a [DVec3], groups: Option<Groups>) -> Option<Self> {
        match groups {
            Some(groups) => Some(Self { positions, groups }),
            None => Self::new(positions),
        }
    }

    /// Keeps the groups, for another index of the same positions.
    pub(in crate::sample) fn into_groups(self) -> Groups {
        self.groups
    }

    /// Lists the neighbours of all groups, so that later searches find them. A list takes 100 bytes.
    pub(in crate::sample) fn list(&mut self, task: Option<&Task>) -> Result<()> {
        let around = |neighbours: &mut Neighbours<'_>, g| {
            let mut list = [NO_GROUP; LISTED + 1];
            for (slot, (other, _)) in list.iter_mut().zip(neighbours.of(g, LISTED)) {
                *slot = index_u32(other);
            }
            list
        };
        self.groups.lists = self.of_groups(task, FINDING, around)?;
        Ok(())
    }

    /// Returns the number of distinct positions.
    pub(in crate::sample) fn group_count(&self) -> usize {
        self.groups.starts.len() - 1
    }

    /// Returns the points at one position.
    pub(in crate::sample) fn group(&self, g: usize) -> &[u32] {
        &self.groups.order[self.groups.starts[g] as usize..self.groups.starts[g + 1] as usize]
    }

    /// Returns the number of finite points.
    pub(in crate::sample) fn len(&self) -> usize {
        self.groups.order.len()
    }

    /// Returns the finite point at position `place` of a spatially coherent order, and its group.
    pub(in crate::sample) fn in_order(&self, place: usize) -> (u32, usize) {
        let begun = |start: &u32| *start as usize <= place;
        let group = self.groups.starts.partition_point(begun) - 1;
        (self.groups.order[place], group)
    }

    /// Returns the finite points in a spatially coherent order.
    pub(in crate::sample) fn order(&self) -> &[u32] {
        &self.groups.order
    }

    /// Returns a point's position.
    pub(in crate::sample) fn position(&self, i: u32) -> DVec3 {
        self.positions[i as usize]
    }

    /// Returns the number of points, finite or not.
    pub(in crate::sample) fn point_count(&self) -> usize {
        self.positions.len()
    }

    /// Returns the position of a group.
    fn place(&self, g: usize) -> DVec3 {
        self.groups.tree.position(g)
    }

    /// Returns the offset from one group to another; it does not depend on other points of the set.
    pub(in crate::sample) fn offset(&self, from: usize, to: usize) -> DVec3 {
        self.place(to) - self.place(from)
    }

    /// Begins searches for neighbours, one after the other.
    pub(in crate::sample) fn search(&self) -> Neighbours<'_> {
        Neighbours {
            search: Search::new(&self.groups.tree),
            index: self,
            found: Vec::new(),
        }
    }

    /// Returns `of` for each group, as a stage.
    pub(in crate::sample) fn of_groups<T: Clone + Default + Send>(
        &self,
        task: Option<&Task>,
        name: &'static str,
        of: impl Fn(&mut Neighbours<'_>, usize) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut all = vec![T::default(); self.group_count()];
        fill(task, name, &mut all, |first, some| {
            let mut neighbours = self.search();
            for (g, own) in (first..).zip(some) {
                *own = of(&mut neighbours, g);
            }
        })?;
        Ok(all)
    }

    /// Returns the squared distance from any position to the last of its `count + 1` nearest distinct
    /// positions. Returns `None` if fewer are within `radius`.
    pub(in crate::sample) fn last_within(
        &self,
        from: DVec3,
        count: usize,
        radius: f64,
    ) -> Option<f64> {
        let mut search = Search::new(&self.groups.tree);
        let found = search.nearest(from, count, radius * radius);
        found.get(count).map(|near| near.squared)
    }

    /// Returns the point nearest to a finite position; the first of those that coincide.
    pub(in crate::sample) fn nearest_to(&self, position: DVec3) -> Option<u32> {
        let mut search = Search::new(&self.groups.tree);
        let nearest = search.nearest(position, 0, UNLIMITED).first()?;
        self.group(nearest.index as usize).first().copied()
    }

    /// Spreads one value per group to its points; other points get `missing`.
    fn spread<T: Copy + Send>(&self, of_groups: &[T], missing: T) -> Vec<T> {
        let mut of_points = vec![missing; self.positions.len()];
        for (g, value) in of_groups.iter().enumerate() {
            for &i in self.group(g) {
                of_points[i as usize] = *value;
            }
        }
        of_points
    }

    /// Estimates the volume of each point from the distances to its neighbours. The ball that reaches to the
    /// n-th neighbour is divided among the n points within. The result is the mean over [`SPACING_NEIGHBOURS`].
    ///
    /// Points at one position divide the volume that a single one would have. Points that are not finite get
    /// NaN.
    pub(in crate::sample) fn volumes(&self, task: Option<&Task>) -> Result<Vec<f64>> {
        let [first, last] = SPACING_NEIGHBOURS;
        let volume = |neighbours: &mut Neighbours<'_>, g| {
            let mut within = 0;
            let mut outermost = 0.0;
            let (mut sum, mut count) = (0.0, 0.0);
            for (other, squared_radius) in neighbours.of(g, last) {
                within += self.group(other).len();
                let ball =
                    4.0 / 3.0 * std::f64::consts::PI * squared_radius * squared_radius.sqrt();
                let share = ball / (within - 1).max(1) as f64;
                outermost = share;
                if within > first && share > 0.0 {
                    sum += share;
                    count += 1.0;
                }
            }
            if count > 0.0 { sum / count } else { outermost }
        };
        let volumes = self.of_groups(task, FINDING, volume)?;
        Ok(self.spread(&volumes, f64::NAN))
    }

    /// Returns the covariance of the positions of groups about their mean: xx, xy, xz, yy, yz, zz.
    fn covariance(&self, groups: impl Iterator<Item = usize> + Clone) -> [f64; 6] {
        let Some(first) = groups.clone().next() else {
            return [f64::NAN; 6];
        };
        // Relative to one of the positions, so that a distant origin costs no digits.
        let offsets = groups.map(|g| self.offset(first, g));
        let count = offsets.clone().count() as f64;
        let mean = offsets.clone().sum::<DVec3>() / count;
        let mut sum = [0.0; 6];
        for d in offsets.map(|d| d - mean) {
            for (sum, term) in sum.iter_mut().zip(square(d)) {
                *sum += term / count;
            }
        }
        sum
    }

    /// Returns the covariance of the nearest neighbours of each point, averaged over these neighbours, which
    /// reduces noise by far.
    ///
    /// - `remote`: gives the covariances of the points behind the first `count`; other ranks have those
    ///   points' neighbours.
    pub(in crate::sample) fn covariances(
        &self,
        task: Option<&Task>,
        count: usize,
        remote: Option<&mut dyn Remote>,
    ) -> Result<Vec<[f64; 6]>> {
        // In a smaller set the remaining slots name the group itself.
        let around = |neighbours: &mut Neighbours<'_>, g| {
            let mut groups = [index_u32(g); NEIGHBOUR_COUNT + 1];
            for (slot, (other, _)) in groups.iter_mut().zip(neighbours.of(g, NEIGHBOUR_COUNT)) {
                *slot = index_u32(other);
            }
            groups
        };
        let nearest = self.of_groups(task, FINDING, around)?;
        let mut own: Vec<[f64; 6]> = nearest
            .par_iter()
            .map(|groups| self.covariance(groups.iter().map(|&g| g as usize)))
            .collect();
        if let Some(remote) = remote {
            let mut of_points = self.spread(&own, [f64::NAN; 6]);
            of_points.truncate(count);
            let of_points = remote.complete(of_points)?;
            let of_group = |g| of_points[self.group(g)[0] as usize];
            own = (0..self.group_count()).map(of_group).collect();
        }
        let smooth = |groups: &[u32; NEIGHBOUR_COUNT + 1]| {
            let mut sum = [0.0; 6];
            for &other in groups {
                for (sum, term) in sum.iter_mut().zip(own[other as usize]) {
                    *sum += term / groups.len() as f64;
                }
            }
            sum
        };
        let smoothed: Vec<[f64; 6]> = parallel::map(nearest.len(), |i| smooth(&nearest[i]));
        Ok(self.spread(&smoothed, [f64::NAN; 6]))
    }

    /// Returns the covariances of `neighbour_count` neighbours of some points.
    pub(in crate::sample) fn covariances_of(
        &self,
        points: &[u32],
        neighbour_count: usize,
    ) -> Vec<[f64; 6]> {
        let covariance = |&i: &u32| {
            let mut search = Search::new(&self.groups.tree);
            let nearest = search.nearest(self.position(i), neighbour_count, UNLIMITED);
            self.covariance(nearest.iter().map(|near| near.index as usize))
        };
        parallel::map(points.len(), |i| covariance(&points[i]))
    }

    /// Returns the mean of the finite values at one position; it does not depend on the order of the points.
    pub(in crate::sample) fn mean_of(&self, g: usize, value: impl Fn(usize) -> f32) -> f64 {
        let values = self.group(g).iter().map(|&i| value(i as usize));
        let mut finite: Vec<f32> = values.filter(|v| v.is_finite()).collect();
        finite.sort_unstable_by(f32::total_cmp);
        finite.iter().copied().map(f64::from).sum::<f64>() / finite.len() as f64
    }

    /// Returns codes of the directions in which a field grows fastest. A linear function is fitted by least
    /// squares to the values at a point and its nearest neighbours. Points at one position count once, with
    /// their mean value. More neighbours are fitted if the nearest lie in a plane. Values that are not finite
    /// are ignored.
    pub(in crate::sample) fn normals(
        &self,
        task: Option<&Task>,
        value: impl Fn(usize) -> f32 + Sync,
    ) -> Result<(Vec<u32>, Vec<u32>)> {
        let means = (0..self.group_count()).into_par_iter();
        let means: Vec<f64> = means.map(|g| self.mean_of(g, &value)).collect();
        let normal = |neighbours: &mut Neighbours<'_>, g: usize| {
            let mut fit = |count: usize| {
                let offset = |(other, _)| (self.offset(g, other), means[other] - means[g]);
                Fit::of(neighbours.of(g, count).map(offset))
            };
            let mut best = fit(NEIGHBOUR_COUNT);
            let mut is_far = false;
            for factor in MORE {
                if best.spans() || !means[g].is_finite() {
                    break;
                }
                best = fit(factor * NEIGHBOUR_COUNT);
                is_far = true;
            }
            (normal_code(best.gradient()), is_far)
        };
        let normals = self.of_groups(task, "fitting gradients", normal)?;
        let far = (0..).zip(&normals).filter(|(_, (_, is_far))| *is_far);
        let far = far.flat_map(|(g, _)| self.group(g).iter().copied());
        let far = far.collect();
        let codes: Vec<u32> = normals.into_iter().map(|(code, _)| code).collect();
        Ok((self.spread(&codes, NO_NORMAL), far))
    }

    /// Calls `visit` for each point within `radius` of `centre`, with its offset from the centre.
    pub(in crate::sample) fn for_each_within(
        &self,
        centre: DVec3,
        radius: f64,
        mut visit: impl FnMut(u32, DVec3),
    ) {
        self.groups.tree.within(centre, radius, |g| {
            let offset = self.place(g) - centre;
            for &i in self.group(g) {
                visit(i, offset);
            }
        });
    }
}

/// Searches for the neighbours of groups. Consecutive searches near one another share work.
pub(in crate::sample) struct Neighbours<'a> {
    search: Search<'a>,
    index: &'a PointIndex<'a>,
    found: Vec<(usize, f64)>,
}

impl Neighbours<'_> {
    /// Returns the `count` distinct positions nearest to a group, after the group itself, with their squared
    /// distances.
    ///
    /// The result does not depend on points farther away: positions at equal distances are ordered by their
    /// coordinates.
    pub(in crate::sample) fn of(
        &mut self,
        g: usize,
        count: usize,
    ) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.found.clear();
        match self.index.groups.lists.get(g) {
            Some(list) if count <= LISTED => {
                let listed = list[..=count].iter().filter(|other| **other != NO_GROUP);
                let pair = |&other: &u32| {
                    let other = other as usize;
                    (other, self.index.offset(g, other).length_squared())
                };
                self.found.extend(listed.map(pair));
            }
            _ => {
                let pair = |near: &Near| (near.index as usize, near.squared);
                let found = self.search.around(g, count);
                self.found.extend(found.iter().map(pair));
            }
        }
        self.found.iter().copied()
    }
}

/// x xᵀ as xx, xy, xz, yy, yz, zz.
pub(in crate::sample) fn square(x: DVec3) -> [f64; 6] {
    [
        x.x * x.x,
        x.x * x.y,
        x.x * x.z,
        x.y * x.y,
        x.y * x.z,
        x.z * x.z,
    ]
}

/// Returns a cube of n³ points with spacing 1, from `offset` on along each axis.
#[cfg(test)]
pub(in crate::sample) fn lattice(n: u32, offset: f64) -> Vec<DVec3> {
    let at = |i: u32| f64::from(i) + offset;
    (0..n * n * n)
        .map(|i| DVec3::new(at(i % n), at(i / n % n), at(i / (n * n))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn neighbour_volumes(points: &[DVec3]) -> Option<Vec<f64>> {
        PointIndex::new(points).map(|index| index.volumes(None).unwrap())
    }

    #[test]
    fn a_lattice_of_spacing_one_has_volumes_near_one() {
        for offset in [0.0, 1e7] {
            let volumes = neighbour_volumes(&lattice(9, offset)).unwrap();
            // Neighbours 7 to 18 lie at sqrt(2): 4/3 pi 2^1.5 times the mean of 1/7 to 1/18, 1.0325.
            let centre = volumes[4 + 9 * (4 + 9 * 4)];
            assert!((centre - 1.0325).abs() < 1e-3, "{centre}");
        }
    }

    #[test]
    fn duplicates_and_bad_points_are_borne() {
        let mut points = lattice(8, 0.0);
        points.extend(std::iter::repeat_n(DVec3::splat(3.0), 5000));
        points.push(DVec3::NAN);
        let volumes = neighbour_volumes(&points).unwrap();
        assert!(volumes.last().unwrap().is_nan());
        assert!(volumes[..5512].iter().all(|v| *v > 0.0 && v.is_finite()));
        assert!(neighbour_volumes(&[DVec3::ONE; 100]).is_none());
        assert!(neighbour_volumes(&[]).is_none());
        assert!(neighbour_volumes(&[DVec3::ONE, DVec3::ZERO]).is_some());
        // All points in a plane, and on a line.
        let plane: Vec<DVec3> = lattice(20, 0.0)
            .into_iter()
            .map(|p| p.with_z(0.0))
            .collect();
        assert!(neighbour_volumes(&plane).unwrap().iter().all(|v| *v > 0.0));
        let line: Vec<DVec3> = (0..5000).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(neighbour_volumes(&line).unwrap().iter().all(|v| *v > 0.0));
    }

    /// Compares with a brute-force search, with other points far away. Neighbours are ordered by distance, and
    /// by coordinates at equal distances.
    #[test]
    fn the_nearest_do_not_depend_on_what_is_far_away() {
        let near: Vec<DVec3> = lattice(8, 3.0).into_iter().map(|p| p * 1e-3).collect();
        for far in [vec![], vec![1e9, -3e12], vec![1e200, 1e-300]] {
            let mut points = near.clone();
            points.extend(far.iter().map(|&x| DVec3::new(x, 0.0, 0.5 * x)));
            let index = PointIndex::new(&points).unwrap();
            for count in [1, 14, 24, 60] {
                for g in 0..index.group_count() {
                    let own = index.place(g);
                    if !near.contains(&own) {
                        continue;
                    }
                    let mut all: Vec<DVec3> = near.clone();
                    all.sort_by(|a, b| {
                        let [da, db] = [a, b].map(|p| (*p - own).length_squared());
                        da.total_cmp(&db).then_with(|| compare(*a, *b))
                    });
                    let mut neighbours = index.search();
                    let found = neighbours.of(g, count).map(|(g, _)| index.place(g));
                    let is_near = |p: &DVec3| near.contains(p);
                    let found: Vec<DVec3> = found.filter(is_near).collect();
                    assert_eq!(found, all[..found.len()]);
                    // A distant point may lie among them.
                    assert!(found.len() >= count);
                }
            }
        }
        // Distances whose squares overflow.
        let points: Vec<DVec3> = near.iter().map(|p| *p * 1e163).collect();
        let index = PointIndex::new(&points).unwrap();
        assert!(index.search().of(0, 14).count() <= 15);
    }

    /// Results do not change once neighbours are listed, whatever the number of groups, and for distances whose squares
    /// vanish.
    #[test]
    fn listed_neighbours_are_those_of_a_search() {
        let mut crowded = lattice(7, 0.5);
        crowded.extend([crowded[5]; 40]);
        crowded.push(DVec3::NAN);
        crowded.extend([1e-200, 2e-200, 3e-200].map(|x| DVec3::new(x, 0.0, 0.0)));
        for points in [crowded.clone(), lattice(2, 0.0)] {
            let index = PointIndex::new(&points).unwrap();
            let mut listed = PointIndex::new(&points).unwrap();
            listed.list(None).unwrap();
            let listed = PointIndex::of(&points, Some(listed.into_groups())).unwrap();
            let (mut a, mut b) = (index.search(), listed.search());
            for g in 0..index.group_count() {
                for count in [1, 14, LISTED, LISTED + 1] {
                    let [a, b] = [a.of(g, count), b.of(g, count)].map(|of| of.collect::<Vec<_>>());
                    assert_eq!(a, b);
                }
            }
            let count = points.len();
            let volumes = |index: &PointIndex<'_>| {
                let volumes = index.volumes(None).unwrap();
                volumes.into_iter().map(f64::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(volumes(&index), volumes(&listed));
            let covariances = |index: &PointIndex<'_>| {
                let all = index.covariances(None, count, None).unwrap();
                all.into_iter()
                    .flatten()
                    .map(f64::to_bits)
                    .collect::<Vec<_>>()
            };
            assert_eq!(covariances(&index), covariances(&listed));
        }
    }

    #[test]
    fn covariances_are_those_of_the_neighbours() {
        // Spacing 2 along x: the nearest 14 neighbours of a point start with those in its plane x = const.
        let points: Vec<DVec3> = lattice(11, 0.0)
            .into_iter()
            .map(|p| p * DVec3::new(2.0, 1.0, 1.0))
            .collect();
        let index = PointIndex::new(&points).unwrap();
        let centre = index.covariances(None, points.len(), None).unwrap()[5 + 11 * (5 + 11 * 5)];
        assert!(
            (centre[3] - centre[5]).abs() < 0.3 * centre[3],
            "{centre:?}"
        );
        let beside = [centre[1], centre[2], centre[4]];
        assert!(
            beside.iter().all(|c| c.abs() < 0.2 * centre[3]),
            "{centre:?}"
        );
        assert_eq!(index.covariances_of(&[3, 700], 20).len(), 2);
    }
}
