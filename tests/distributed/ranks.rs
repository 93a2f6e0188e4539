//! Runs groups of ranks in threads, and compares their frames with those of one process.

use ewa_splat::distributed::{RankStats, Renderer, ThreadRank};
use ewa_splat::render::FrameCounts;
use ewa_splat::scene::PointVolume;
use ewa_splat::view::Camera;
use ewa_splat::{ColumnImage, ColumnSettings, DepthImage, Image, NormalImage};
use ewa_splat::{SceneOptions, Settings};

/// Numbers of ranks: one alone, few, and numbers that divide nothing evenly.
pub(crate) const SIZES: [usize; 5] = [1, 2, 3, 4, 7];

/// Runs `work` on each rank of a group, in threads of their own, and returns the results.
pub(crate) fn each<T: Send>(size: usize, work: impl Fn(ThreadRank) -> T + Sync) -> Vec<T> {
    let work = &work;
    std::thread::scope(|scope| {
        let ranks = ThreadRank::group(size).into_iter();
        let threads: Vec<_> = ranks.map(|rank| scope.spawn(move || work(rank))).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    })
}

/// All output of a frame; f32 numbers as bits.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    pixels: Vec<[u32; 4]>,
    depths: Option<Vec<u32>>,
    normals: Option<Vec<[u32; 3]>>,
    pub(crate) counts: FrameCounts,
}

impl Frame {
    fn of(
        image: &Image,
        depth: Option<&DepthImage>,
        normals: Option<&NormalImage>,
        counts: FrameCounts,
    ) -> Self {
        let bits = |numbers: &[f32]| numbers.iter().map(|n| n.to_bits()).collect();
        Self {
            pixels: image.pixels.iter().map(|p| p.map(f32::to_bits)).collect(),
            depths: depth.map(|depth| bits(&depth.depths)),
            normals: normals.map(|n| n.normals.iter().map(|n| n.map(f32::to_bits)).collect()),
            counts,
        }
    }

    /// Counts the pixels that show anything.
    pub(crate) fn shown(&self) -> usize {
        self.pixels.iter().filter(|p| p[3] != 0).count()
    }
}

/// Draws frames in one process, one after another with one renderer.
pub(crate) fn alone(scene: &[PointVolume], frames: &[(Camera, Settings)]) -> Vec<Frame> {
    drawn_alone(ewa_splat::Renderer::new(scene.to_vec()).unwrap(), frames)
}

/// Draws frames with the renderer of one process.
pub(crate) fn drawn_alone(
    mut renderer: ewa_splat::Renderer,
    frames: &[(Camera, Settings)],
) -> Vec<Frame> {
    let draw = |(camera, settings): &(Camera, Settings)| {
        let image = renderer.render(camera, settings).unwrap().clone();
        let (depth, normals) = (renderer.depth(), renderer.normals());
        Frame::of(&image, depth, normals, renderer.counts())
    };
    frames.iter().map(draw).collect()
}

/// Draws frames on a group of ranks that all start with the whole scene. Returns the frames, and
/// each rank's statistics of the last one.
pub(crate) fn together(
    size: usize,
    scene: &[PointVolume],
    frames: &[(Camera, Settings)],
) -> (Vec<Frame>, Vec<RankStats>) {
    let mut all = each(size, |rank| {
        let options = SceneOptions::default();
        let renderer = Renderer::of_whole(rank, scene.to_vec(), &options).unwrap();
        drawn(renderer, frames)
    });
    // Ranks other than the first get no pictures.
    assert!(all.iter().skip(1).all(|(frames, _)| frames.is_empty()));
    all.swap_remove(0)
}

/// Draws frames on one rank. Returns the frames (none except on the first rank) and all ranks' last
/// statistics.
pub(crate) fn drawn(
    mut renderer: Renderer,
    frames: &[(Camera, Settings)],
) -> (Vec<Frame>, Vec<RankStats>) {
    let mut drawn = Vec::new();
    for (camera, settings) in frames {
        let image = renderer.render(camera, settings).unwrap().cloned();
        if let Some(image) = image {
            let (depth, normals) = (renderer.depth(), renderer.normals());
            drawn.push(Frame::of(&image, depth, normals, renderer.counts()));
        }
    }
    (drawn, renderer.stats().to_vec())
}

/// Asserts that every number of ranks draws the frames of one process. Returns these.
pub(crate) fn assert_same(scene: &[PointVolume], frames: &[(Camera, Settings)]) -> Vec<Frame> {
    let expected = alone(scene, frames);
    for size in SIZES {
        let (found, stats) = together(size, scene, frames);
        for (n, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert_eq!(found.counts, expected.counts, "frame {n} of {size} ranks");
            assert!(found == expected, "frame {n} of {size} ranks");
        }
        assert_eq!(found.len(), expected.len());
        let sum = |of: fn(&RankStats) -> u64| stats.iter().map(of).sum::<u64>();
        assert_eq!(stats.len(), size);
        assert_eq!(sum(|s| s.footprints_sent), sum(|s| s.footprints_received));
        assert_eq!(sum(|s| s.bytes_sent), sum(|s| s.bytes_received));
        let count = ewa_splat::Renderer::new(scene.to_vec())
            .unwrap()
            .particle_count();
        assert_eq!(sum(|s| s.particles), count as u64);
    }
    expected
}

/// Asserts the same of column densities.
pub(crate) fn assert_same_column(
    scene: &[PointVolume],
    camera: &Camera,
    settings: &ColumnSettings,
) -> ColumnImage {
    let mut renderer = ewa_splat::Renderer::new(scene.to_vec()).unwrap();
    let expected = renderer.column_density(camera, settings).unwrap().clone();
    let counts = renderer.counts();
    let bits =
        |image: &ColumnImage| -> Vec<u32> { image.values.iter().map(|v| v.to_bits()).collect() };
    for size in SIZES {
        let all = each(size, |rank| {
            let options = SceneOptions::default();
            let mut renderer = Renderer::of_whole(rank, scene.to_vec(), &options).unwrap();
            let column = renderer.column_density(camera, settings).unwrap().cloned();
            (column, renderer.counts())
        });
        let (found, found_counts) = &all[0];
        let found = found.as_ref().unwrap();
        assert_eq!(*found_counts, counts, "{size} ranks");
        assert!(bits(found) == bits(&expected), "{size} ranks");
        assert!(all[1..].iter().all(|(column, _)| column.is_none()));
    }
    expected
}
