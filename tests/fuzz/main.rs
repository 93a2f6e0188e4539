//! Damaged files of every format, read and sampled: no panic, no hang, and never more memory
//! than a small multiple of the file.
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
use std::cell::Cell;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use ewa_splat::io::{OpenOptions, RawLayout, RawType, open};
use ewa_splat::sample::{SampleOptions, volume};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use support::damage::{apply, damage};
use support::{Plot3dBlock, Plot3dEncoding, VtkEncoding, VtkPiece};

/// Bytes allocated now, and the most there were since it was last set.
static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, counting.
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

/// What reading and sampling a file of `len` bytes may allocate: a constant for threads and
/// tables, and a multiple for positions, factors and values.
fn most_bytes(len: usize) -> usize {
    (64 << 20) + 64 * len
}

/// Far more than any file of some thousand bytes needs, even on a busy machine.
const LONGEST: Duration = Duration::from_secs(20);

/// Names and contents of sound files, one entry each.
fn seeds() -> Vec<(String, Vec<u8>)> {
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

    for (i, encoding) in Plot3dEncoding::all().into_iter().enumerate() {
        let grids = cubes(encoding, 3);
        seeds.push((format!("{i}.xyz"), encoding.grids(&grids)));
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
    seeds
}

/// Two cubes beside each other, or one where the encoding holds no more: their nodes, or so
/// many other numbers of each node.
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

/// Reads and samples: whether the file was read, and whether it was sampled.
fn answer(path: &Path) -> (bool, bool) {
    let mut options = OpenOptions::default();
    if path.extension().is_some_and(|e| e == "raw") {
        options.raw = Some(RawLayout::new([4, 4, 4], RawType::U8));
    }
    match open(path, &options) {
        Ok(data) => (true, volume(data, &SampleOptions::default()).is_ok()),
        Err(_) => (false, false),
    }
}

/// One test, because the allocations of another would be counted with it.
#[test]
fn damaged_files_cost_no_more_than_sound_ones() {
    let seeds = seeds();
    let folder = tempfile::tempdir().unwrap();
    for (i, encoding) in Plot3dEncoding::all().into_iter().enumerate() {
        // A sound solution beside each grid, so that there is something to sample.
        let solution = encoding.solutions(&cubes(encoding, 5));
        std::fs::write(folder.path().join(format!("{i}.q")), solution).unwrap();
    }
    let measured = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let before = NOW.load(Relaxed);
        MOST.store(before, Relaxed);
        let start = Instant::now();
        let answer = answer(&path);
        let most = MOST.load(Relaxed).saturating_sub(before);
        std::fs::remove_file(&path).unwrap();
        (answer, most, start.elapsed())
    };
    for (name, bytes) in &seeds {
        let (answer, most, _) = measured(name, bytes);
        assert_eq!(answer, (true, true), "{name} is no sound file");
        assert!(most > bytes.len(), "allocations are not counted");
    }
    // Those of the other tests, not all of which have a volume; one kind of array encoding in
    // eight, so that no format has most of the seeds.
    let others = support::seeds::seeds().iter();
    let is_vtk_xml = |name: &str| {
        [".vti", ".vtr", ".vts", ".vtu", ".vtp"]
            .iter()
            .any(|e| name.ends_with(e))
    };
    let (vtk_xml, others): (Vec<_>, Vec<_>) =
        others.cloned().partition(|(name, _)| is_vtk_xml(name));
    let solutions = |(name, _): &(String, Vec<u8>)| !name.ends_with(".q");
    let mut seeds = seeds;
    seeds.extend(
        vtk_xml
            .into_iter()
            .enumerate()
            .filter(|(i, _)| i / 7 % 8 == 0)
            .map(|(_, s)| s),
    );
    seeds.extend(others.into_iter().filter(solutions));

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
        prop::collection::vec(damage(), 1..4),
    );
    let [run, read, sampled, most] = [const { Cell::new(0_usize) }; 4];
    let result = runner.run(&inputs, |(seed, damages)| {
        let (name, bytes) = seed.get(&seeds);
        let mut bytes = bytes.clone();
        damages.iter().for_each(|d| apply(&mut bytes, d));
        let (answer, bytes_used, time) = measured(name, &bytes);
        run.set(run.get() + 1);
        read.set(read.get() + usize::from(answer.0));
        sampled.set(sampled.get() + usize::from(answer.1));
        most.set(most.get().max(bytes_used));
        prop_assert!(
            bytes_used <= most_bytes(bytes.len()),
            "{name}: {bytes_used} bytes for a file of {}",
            bytes.len()
        );
        prop_assert!(time <= LONGEST, "{name}: {time:?}");
        Ok(())
    });
    println!(
        "{} damaged files of {} seeds: {} still read, {} still sampled; at most {} bytes",
        run.get(),
        seeds.len(),
        read.get(),
        sampled.get(),
        most.get()
    );
    if let Err(error) = result {
        panic!("{error}");
    }
}
