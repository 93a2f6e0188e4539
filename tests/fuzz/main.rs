//! Reads and samples damaged files of every format: no panic, no hang, and never more memory than a
//! small multiple of the file.
//!
//! `EWA_FUZZ_CASES` sets the number of damaged files.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

#[path = "../support/mod.rs"]
mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use ewa_splat::io::{OpenOptions, RawLayout, RawType, format_of, formats, open};
#[cfg(feature = "prepared")]
use ewa_splat::prepared::{About, PreparedScene};
use ewa_splat::sample::{SampleOptions, volume};
#[cfg(feature = "prepared")]
use ewa_splat::{Renderer, SceneOptions, Settings, scene::PointVolume, view::Camera};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use support::damage::{apply, damage};
use support::seeds::Set;
use support::{Plot3dBlock, Plot3dEncoding, VtkEncoding, VtkPiece};

/// Number of bytes allocated now, and the largest number since the last reset.
static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator with counters.
struct Counting;

#[allow(
    unsafe_code,
    reason = "an allocator cannot be counted otherwise; every call is handed on as it came"
)]
// SAFETY: all requests go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

fn count(size: usize) {
    let now = NOW.fetch_add(size, Relaxed) + size;
    MOST.fetch_max(now, Relaxed);
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns the most bytes that reading a file of `len` bytes may allocate: a constant for tables
/// and decoders, and some numbers for each byte.
fn most_read(len: usize) -> usize {
    (64 << 20) + 16 * len
}

/// Returns the same limit with sampling: a multiple for positions, factors and values.
fn most_sampled(len: usize) -> usize {
    (64 << 20) + 64 * len
}

/// Longest time for a file: far more than a file of some thousand bytes needs, even on a busy
/// machine.
const LONGEST: Duration = Duration::from_secs(5);

/// Returns sound files that can be sampled.
fn seeds() -> Vec<Set> {
    let fixture = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        (name.to_owned(), std::fs::read(path.join(name)).unwrap())
    };
    let mut seeds = vec![
        fixture("gadget_old.h5"),
        fixture("gadget_old_packed.h5"),
        fixture("gadget_big_endian.h5"),
        fixture("swift.h5"),
        fixture("dark_matter.h5"),
        fixture("phantom.h5"),
        fixture("gadget_types.h5"),
        fixture("phantom_sinks.h5"),
        fixture("swift_units.h5"),
        fixture("snapshot.tipsy"),
        fixture("phantom/sarracen"),
        fixture("phantom/two_processes"),
        (
            "a.csv".into(),
            b"x,y,z,h,m\n1,2,3,.5,1\n4,5,6,.5,1\n".to_vec(),
        ),
        ("volume_4x4x4_uint8.raw".into(), vec![3; 64]),
    ];

    let encodings = VtkEncoding::all();
    for encoding in encodings.into_iter().step_by(3) {
        let piece = VtkPiece {
            extent: "0 2 0 2 0 1",
            point_data: vec![support::float32("a", 1, &[0.5; 18])],
            cell_data: vec![support::uint8("c", 1, &[1, 2, 3, 4])],
        };
        let attributes = "WholeExtent=\"0 2 0 2 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"";
        seeds.push(("a.vti".into(), support::vti(encoding, attributes, &[piece])));
    }

    let mut with_solutions = Vec::new();
    for encoding in Plot3dEncoding::all() {
        // A solution and functions lie beside each grid, so that there is something to sample.
        let [functions, grid, solution] = [2, 3, 5].map(|per_node| cubes(encoding, per_node));
        with_solutions.push(Set {
            files: vec![
                ("a.xyz".into(), encoding.grids(&grid)),
                ("a.q".into(), encoding.solutions(&solution)),
                ("a.f".into(), encoding.functions(&functions, 2)),
                ("a.nam".into(), b"lift\ndrag\n".to_vec()),
            ],
        });
    }

    let rows = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }\n";
    let named = "{'descr': [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), ('m', '<f8')], \
                 'fortran_order': False, 'shape': (3,), }\n";
    let reals: Vec<u8> = (0..12).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let array = support::npy(1, rows, &reals);
    let column = "{'descr': '<f4', 'fortran_order': False, 'shape': (4,), }\n";
    let column = support::npy(1, column, &[0, 0, 128, 63, 0, 0, 0, 63].repeat(2));
    let axes = ["x.npy", "y.npy", "z.npy", "h.npy"].map(|name| (name, column.clone()));
    seeds.push(("b.npy".into(), support::npy(2, named, &reals)));
    seeds.push(("a.npz".into(), support::npz(&axes, true)));
    seeds.push((
        "b.npz".into(),
        support::npz(&[("arr_0.npy", array.clone())], false),
    ));
    seeds.push(("a.npy".into(), array));
    let alone = seeds.into_iter().map(|file| Set { files: vec![file] });
    alone.chain(with_solutions).collect()
}

/// Returns the nodes of two adjacent cubes, or of one if the encoding allows no more; or `per_node`
/// other numbers of each node.
fn cubes(encoding: Plot3dEncoding, per_node: usize) -> Vec<Plot3dBlock> {
    let cube = |x: f64| {
        let nodes = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(f64::from));
        let axis = |d: usize| {
            let nodes = nodes.clone();
            nodes.map(move |p| p[d % 3] + if d == 0 { x } else { 0.0 })
        };
        Plot3dBlock {
            dims: [3; 3],
            numbers: (0..per_node).flat_map(axis).collect(),
            iblank: vec![1; 27],
        }
    };
    let mut cubes = vec![cube(0.0), cube(2.0)];
    if !encoding.grid_count {
        cubes.pop();
    }
    cubes
}

fn options(path: &Path) -> OpenOptions {
    let is_raw = path.extension().is_some_and(|e| e == "raw");
    OpenOptions {
        raw: is_raw.then(|| RawLayout::new([4, 4, 4], RawType::U8)),
        ..OpenOptions::default()
    }
}

/// Result of a file, with its time and memory.
struct Answer {
    is_read: bool,
    is_sampled: bool,
    /// Most bytes allocated at a time, until the file was read and in all.
    bytes: [usize; 2],
    time: Duration,
}

/// Recognises, reads and samples a file.
fn answer(path: &Path) -> Answer {
    let before = NOW.load(Relaxed);
    MOST.store(before, Relaxed);
    let most = || MOST.load(Relaxed).saturating_sub(before);
    let start = Instant::now();
    let options = options(path);
    let steps = format_of(path, &options).and_then(|format| format.time_steps(path));
    #[cfg(feature = "prepared")]
    if path.extension().is_some_and(|e| e == "arrow") {
        let scene = PreparedScene::open(path);
        let read = most();
        let is_read = scene.is_ok();
        let is_drawn = scene.and_then(|(scene, _)| draw(scene)).is_ok();
        return Answer {
            is_read,
            is_sampled: is_drawn,
            bytes: [read, most()],
            time: start.elapsed(),
        };
    }
    let data = open(path, &options);
    let read = most();
    let (is_read, is_sampled) = match data {
        Ok(data) => (
            true,
            steps.is_ok() && volume(data, &SampleOptions::default()).is_ok(),
        ),
        Err(_) => (false, false),
    };
    Answer {
        is_read,
        is_sampled,
        bytes: [read, most()],
        time: start.elapsed(),
    }
}

/// Draws a scene at a tiny size.
#[cfg(feature = "prepared")]
fn draw(scene: PreparedScene) -> ewa_splat::Result<()> {
    let mut renderer = Renderer::with_options(vec![scene], ewa_splat::RendererOptions::default())?;
    let eye = glam::DVec3::new(9.0, -20.0, 7.0);
    let camera = Camera::perspective(eye, glam::DVec3::ZERO, glam::DVec3::Z, 40.0, [8, 6]);
    renderer.render(&camera, &Settings::default()).map(drop)
}

/// Returns prepared scenes with all columns that files may have, and some with few.
#[cfg(feature = "prepared")]
fn scenes(folder: &Path) -> Vec<Set> {
    let path = folder.join("scene.arrow");
    let positions = |count: u32| {
        let at = |i: u32| f64::from(i.wrapping_mul(2_654_435_761) % 1000) * 0.01;
        (0..count).map(move |i| glam::DVec3::new(at(i), at(i + 7), at(i + 91)))
    };
    let spheres = PointVolume::spheres(positions(900).collect::<Vec<_>>(), vec![0.2; 900])
        .with_masses(vec![0.1; 900]);
    let table = b"x,y,z,v\n0,0,0,1\n1,0,0,2\n0,1,0,3\n1,1,1,4\n2,1,0,5\n1,2,2,6\n".to_vec();
    let grid = VtkPiece {
        extent: "0 11 0 9 0 5",
        point_data: vec![support::uint8("a", 1, &[7, 100, 200].repeat(240))],
        cell_data: vec![],
    };
    let attributes = "WholeExtent=\"0 11 0 9 0 5\" Origin=\"0 0 0\" Spacing=\"1 1 1\"";
    let grid = support::vti(VtkEncoding::all()[0], attributes, &[grid]);
    let sampled = |name: &str, bytes: &[u8]| {
        let data = ewa_splat::io::read(name, bytes, &OpenOptions::default()).unwrap();
        volume(data, &SampleOptions::default()).unwrap().volume
    };
    let all = [
        vec![spheres],
        vec![sampled("a.csv", &table)],
        vec![sampled("a.vti", &grid), sampled("a.csv", &table)],
    ];
    let of = |volumes: Vec<PointVolume>| {
        let options = SceneOptions {
            keep_indices: true,
            ..SceneOptions::default()
        };
        let scene = PreparedScene::new(volumes, &options).unwrap();
        scene.write(&path, &About::default()).unwrap();
        Set {
            files: vec![("scene.arrow".into(), std::fs::read(&path).unwrap())],
        }
    };
    all.into_iter().map(of).collect()
}

/// Statistics of the damaged files of one format.
#[derive(Default)]
struct Count {
    files: usize,
    read: usize,
    sampled: usize,
    most: usize,
    longest: Duration,
}

/// Sound files of one format, written to a folder, with the file to open.
struct Seed {
    folder: PathBuf,
    set: Set,
}

impl Seed {
    /// Writes all files of a set into a folder of its own.
    fn new(folder: PathBuf, set: Set) -> Self {
        let seed = Self { folder, set };
        for (name, bytes) in &seed.set.files {
            seed.write(name, bytes);
        }
        seed
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    /// Returns the path of the file to open.
    fn path(&self) -> PathBuf {
        self.folder.join(self.set.opened())
    }

    fn len(&self) -> usize {
        self.set.files.iter().map(|(_, bytes)| bytes.len()).sum()
    }
}

/// All cases form one test, because the allocations of another would be counted with it.
#[test]
fn damaged_files_cost_no_more_than_sound_ones() {
    let folder = tempfile::tempdir().unwrap();
    let mut count = 0;
    let mut seed = |set: Set| {
        count += 1;
        Seed::new(folder.path().join(count.to_string()), set)
    };

    // This file's own seeds are complete; not all seeds of other tests give a volume.
    let own = seeds();
    #[cfg(feature = "prepared")]
    let own = own.into_iter().chain(scenes(folder.path()));
    let own: Vec<Seed> = own.into_iter().map(&mut seed).collect();
    for seed in &own {
        let answer = answer(&seed.path());
        let name = &seed.set.files[0].0;
        assert!(
            answer.is_read && answer.is_sampled,
            "{name} is no sound file"
        );
        // Mapped memory is not allocated.
        let is_mapped = name.ends_with(".arrow");
        assert!(
            is_mapped || answer.bytes[1] > seed.len(),
            "allocations are not counted"
        );
    }
    let others = support::seeds::seeds().iter().cloned();
    let others = others
        .filter(|(name, _)| !name.ends_with(".q"))
        .map(|file| Set { files: vec![file] });
    let others: Vec<Seed> = others.chain(support::seeds::sets()).map(seed).collect();

    // Cases are grouped by format, so that each is damaged equally often.
    let mut by_format: BTreeMap<&str, Vec<Seed>> = BTreeMap::new();
    for seed in own.into_iter().chain(others) {
        let path = seed.path();
        let format = format_of(&path, &options(&path)).unwrap().name;
        by_format.entry(format).or_default().push(seed);
    }
    for format in formats() {
        let name = format.name;
        assert!(
            by_format.contains_key(name),
            "no sound file of {name} is damaged"
        );
    }
    let seeds: Vec<(&str, Vec<Seed>)> = by_format.into_iter().collect();

    let cases = std::env::var("EWA_FUZZ_CASES")
        .ok()
        .and_then(|n| n.parse().ok());
    let mut runner = TestRunner::new(Config {
        cases: cases.unwrap_or(1000),
        failure_persistence: None,
        ..Config::default()
    });
    let inputs = (
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        prop::collection::vec(damage(), 1..4),
    );
    let counts: RefCell<BTreeMap<&str, Count>> = RefCell::default();
    let result = runner.run(&inputs, |(format, seed, file, damages)| {
        let (format, seeds) = format.get(&seeds);
        let seed = seed.get(seeds);
        let (name, sound) = file.get(&seed.set.files);
        let mut bytes = sound.clone();
        damages.iter().for_each(|d| apply(&mut bytes, d));
        seed.write(name, &bytes);
        let answer = answer(&seed.path());
        seed.write(name, sound);
        let mut counts = counts.borrow_mut();
        let count = counts.entry(format).or_default();
        count.files += 1;
        count.read += usize::from(answer.is_read);
        count.sampled += usize::from(answer.is_sampled);
        count.most = count.most.max(answer.bytes[1]);
        count.longest = count.longest.max(answer.time);
        let len = seed.len() + bytes.len() - sound.len();
        for (used, most) in answer.bytes.iter().zip([most_read(len), most_sampled(len)]) {
            prop_assert!(*used <= most, "{name}: {used} bytes for a file of {len}");
        }
        prop_assert!(answer.time <= LONGEST, "{name}: {:?}", answer.time);
        Ok(())
    });
    println!("format                    damaged      read   sampled  most bytes   longest");
    for (format, count) in counts.borrow().iter() {
        println!(
            "{format:<24} {:>8} {:>9} {:>9} {:>11} {:>6.1} ms",
            count.files,
            count.read,
            count.sampled,
            count.most,
            1e3 * count.longest.as_secs_f64()
        );
    }
    if let Err(error) = result {
        panic!("{error}");
    }
}
