//! Reads a curvilinear grid in pieces: each rank reads some pieces, and receives the planes that it samples.

use std::ops::Range;

use super::function::{
    PartRead, differences_of_all, found_by_all, models_of_all, outline_of_all, show,
};
use super::pieces::{assigned, head_of, seen_by_all};
use super::values::{put_values, take_values};
use crate::collective::Collective;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::data::up::Up;
use crate::error::Result;
use crate::io::{ArrayKey, BlockPlanes, VtsPieces};
use crate::load::facts::Corners;
use crate::math::ExactSum;
use crate::message::{put, take};
use crate::ranks::Share;
use crate::sample::Found;
use crate::sample::{
    GridPlanes, LEAST_PER_NODE, SampleOptions, SampleReport, Seam, Window, check_count, check_len,
    may_be_refined, planes_around, seam, shown_field, take_scalar,
};
use crate::scene::{Surroundings, Tiling, ValueScale, Values};
use crate::view::Camera;

/// Returns the planes of nodes, of `count`, that a rank samples.
fn own_planes(count: usize, rank: usize, size: usize) -> Range<usize> {
    rank * count / size..(rank + 1) * count / size
}

/// Reads this rank's pieces, receives its planes of constant k with the halo around them, and makes particles of them:
/// the particles that [`sample::volume`](crate::sample::volume) makes of the whole grid.
///
/// - `cameras`: returns the cameras of the pictures of a scene between two corners.
///
/// Returns `None` if one rank must read the whole grid. That is so for surfaces, iso-surfaces, grids that close along
/// k, grids with cells that finer cells replace, and refined kernels of cells. Some sampling options also need all
/// values on one rank.
///
/// # Errors
/// The errors of reading or sampling, on any rank; nothing that can be drawn; a rank that is gone.
pub(crate) fn read_grid(
    file: &VtsPieces,
    options: &SampleOptions,
    cameras: &dyn Fn(Corners, Up) -> Result<Vec<Camera>>,
    ranks: &mut dyn Collective,
) -> Result<Option<PartRead>> {
    let [ni, nj, count] = file.dims();
    let is_plain = !options.makes_surface()
        && options.kernels.shepard_passes == 0
        && !options.purpose.keeps_value_sample
        && ni.min(nj).min(count) > 1;
    if !is_plain {
        return Ok(None);
    }
    let (rank, size) = (ranks.rank(), ranks.size());
    let lengths: Vec<u64> = file.lengths().collect();
    let own = file.read(assigned(&lengths, rank, size));
    let mut own = ranks.agree(own)?;
    let seen = seen_by_all(&own.seen, ranks)?;
    let head = head_of(&own.head(file, &seen), ranks)?;
    let name = shown_field(&head, options)?;
    // An unknown name is an error on all ranks.
    head.scalar(&name)?;
    let Some((field, _)) = head.selected(&name) else {
        return Ok(None);
    };
    // Cells are refined as those of a mesh, by one rank.
    let cell_count = (ni - 1) * (nj - 1) * (count - 1);
    let of_cells = field.association == Association::Cells;
    if of_cells && may_be_refined(cell_count, false, options) {
        return Ok(None);
    }
    let arrays = own.keep(&head, field);
    let window = |rank: usize| match own_planes(count, rank, size) {
        // If there are more ranks than planes, some ranks sample none; they receive the first two.
        none if none.is_empty() => 0..2,
        own => planes_around(&own, count, options),
    };
    let to_rank = |rank: usize| {
        let mut bytes = Vec::new();
        let blocks = own.of_planes(file, &window(rank));
        blocks.iter().for_each(|block| put_block(block, &mut bytes));
        bytes
    };
    let blocks = ranks.exchange(Ok((0..size).map(to_rank).collect()))?;
    drop(own);
    let has_cells = head
        .fields
        .iter()
        .any(|f| f.association == Association::Cells);
    let planes = window(rank);
    let own = own_planes(count, rank, size);
    let window = Window {
        first: planes.start,
        count,
        own: match own.is_empty() {
            true => 0..0,
            false => own.start - planes.start..own.end - planes.start,
        },
    };
    let here = planes_of(file, planes, window, blocks, (&arrays, has_cells), &name);
    let (mut here, corners, is_refined) = ranks.agree(here)?;
    let is_refined = ranks.any(is_refined)?;
    let [i, j, k] = seams(&here, ranks)?;
    if is_refined || k {
        return Ok(None);
    }
    here.periodic = [i, j, k];
    let outline = outline_of_all(&here.nodes, ranks)?;
    here.differences = differences_of_all(&here.values, ranks)?;
    let mut volume_sum = ExactSum::default();
    let sampled = here.sampled(options, &mut volume_sum, ranks);
    let mut sampled = ranks.agree(sampled)?;
    let found = Found {
        report: SampleReport {
            field: Some(name),
            ..sampled.report.clone()
        },
        corners,
        volume_sum,
    };
    let before = ranks.sum_before(Ok(sampled.report.particle_count as u64))? as usize;
    let (mut found, spacing) = found_by_all(&found, &head, file.path(), options, ranks)?;
    let count = found.report.particle_count;
    let picked = sampled.picked(before, count);
    let kind = (count, (Surroundings::Included, Tiling::Whole));
    let shown = (&mut found, spacing);
    show(&mut sampled.volume, picked, kind, shown, options, ranks)?;
    if let Some(models) = sampled.models.take() {
        sampled.volume.local_models = Some(models_of_all(&models, ranks)?);
    }
    let outline = CurvilinearBlock {
        dims: [outline.len(), 1, 1],
        nodes: outline,
    };
    let geometry = Geometry::Curvilinear {
        blocks: vec![outline],
    };
    let head = Dataset { geometry, ..head };
    let mut options = options.clone();
    if let (Some(refinement), Some(corners)) = (&mut options.refinement, found.corners) {
        refinement.cameras = cameras(corners, head.up())?;
    }
    let finished = sampled.finished(&options, ranks);
    let (volume, counts, level) = ranks.agree(finished)?;
    // Samples of all ranks come first, then ghosts, then parts.
    let mut numbers = Vec::with_capacity(counts.len());
    let mut first = 0;
    let mut totals = [0; 3];
    for (count, total) in counts.into_iter().zip(&mut totals) {
        let before = ranks.sum_before(Ok(count as u64))? as usize;
        *total = ranks.sum(Ok(count as u64))? as usize;
        numbers.push(first + before..first + before + count);
        first += *total;
    }
    let numbers = numbers.into_iter().flatten();
    found.report.particle_count = totals.iter().sum();
    found.report.ghost_count = totals[1];
    found.report.refined_count = totals[2];
    let levels = ranks.gather_one(Ok(level))?.into_iter();
    found.report.refined_level = levels.max().unwrap_or(0);
    Ok(Some(PartRead {
        share: Share {
            numbers: Some(vec![numbers.map(|n| n as u64).collect()]),
            ..Share::from(vec![volume])
        },
        report: found.report,
        head,
        corners: found.corners,
    }))
}

fn put_block(block: &BlockPlanes, bytes: &mut Vec<u8>) {
    put(bytes, block.extent.as_flattened());
    put(bytes, &block.nodes);
    block
        .values
        .iter()
        .for_each(|values| put_values(bytes, values));
}

fn take_block(bytes: &mut &[u8], kinds: &[&str]) -> Result<BlockPlanes> {
    let extent: Vec<i64> = take(bytes)?;
    let at = |n: usize| extent.get(n).copied().unwrap_or(0);
    let nodes = take(bytes)?;
    let mut values = Vec::with_capacity(kinds.len());
    for kind in kinds {
        values.push(take_values(bytes, &Values::of_type(kind, &[]))?);
    }
    Ok(BlockPlanes {
        extent: [[at(0), at(1), at(2)], [at(3), at(4), at(5)]],
        nodes,
        values,
    })
}

/// Assembles a rank's planes from the blocks that all ranks sent. Also returns the least and the greatest coordinates,
/// and whether finer cells replace some of these.
#[allow(
    clippy::type_complexity,
    reason = "three things that are found at once"
)]
fn planes_of(
    file: &VtsPieces,
    planes: Range<usize>,
    window: Window,
    blocks: Vec<Vec<u8>>,
    (arrays, has_cells): (&[Vec<ArrayKey>; 2], bool),
    name: &str,
) -> Result<(GridPlanes, Option<(glam::DVec3, glam::DVec3)>, bool)> {
    let kinds = arrays.iter().flatten().flat_map(|(_, kinds)| kinds);
    let kinds: Vec<&str> = kinds.map(String::as_str).collect();
    let mut own = Vec::new();
    for part in blocks {
        let mut part = part.as_slice();
        while !part.is_empty() {
            own.push(take_block(&mut part, &kinds)?);
        }
    }
    let keys = arrays.each_ref().map(Vec::as_slice);
    let mut dataset = file.planes(&planes, own, keys, has_cells)?;
    let corners = dataset.bounds();
    let blanking = Blanking::of(&dataset)?;
    let taken = take_scalar(&mut dataset, name)?;
    let Geometry::Curvilinear { blocks } = &mut dataset.geometry else {
        unreachable!("planes of a curvilinear grid are one")
    };
    let block = blocks.swap_remove(0);
    crate::memory::check(block.nodes.len(), LEAST_PER_NODE)
        .map_err(|e| e.in_file(&dataset.path))?;
    let samples = block.dims_of(taken.association).iter().product();
    check_count(&dataset, samples)?;
    check_len(&dataset, &taken, samples)?;
    let is_refined = taken.association == Association::Cells && blanking.has_refined_cells();
    let here = GridPlanes {
        dims: block.dims,
        nodes: block.nodes,
        blanking,
        association: taken.association,
        values: taken.values,
        differences: ValueScale::Linear,
        periodic: [false; 3],
        window,
    };
    Ok((here, corners, is_refined))
}

/// Returns, for each index, whether the first and the last plane of the whole grid coincide.
fn seams(here: &GridPlanes, ranks: &mut dyn Collective) -> Result<[bool; 3]> {
    let [ni, nj, planes] = here.dims;
    let Window { count, own, .. } = &here.window;
    let plane = |k: usize| &here.nodes[k * ni * nj..(k + 1) * ni * nj];
    let mut found = [0, 1]
        .map(|d| seam(here.dims, &here.nodes, d, own.clone()))
        .to_vec();
    // The last rank holds the last planes, the first rank the first planes.
    let is_last = ranks.rank() + 1 == ranks.size();
    let mut last = Vec::new();
    if is_last && planes > 1 {
        put(&mut last, plane(planes - 2));
        put(&mut last, plane(planes - 1));
    }
    let lasts = ranks.gather_on_first(Ok(last))?;
    let along_k = match lasts.last().filter(|last| !last.is_empty()) {
        Some(last) if *count > 3 => {
            let mut last = last.as_slice();
            let (before, last) = (take(&mut last)?, take(&mut last)?);
            Seam::of_planes([plane(0), plane(1), &before, &last])
        }
        _ => Seam {
            is_closed: ranks.rank() > 0,
            is_crossed: false,
        },
    };
    found.push(along_k);
    let own: Vec<u8> = found
        .iter()
        .flat_map(|seam| [u8::from(seam.is_closed), u8::from(seam.is_crossed)])
        .collect();
    let mut all = [Seam::NOTHING; 3];
    for own in ranks.gather_records(Ok(own))? {
        for (all, pair) in all.iter_mut().zip(own.chunks_exact(2)) {
            *all = all.and(Seam {
                is_closed: pair[0] != 0,
                is_crossed: pair[1] != 0,
            });
        }
    }
    Ok(all.map(Seam::is_seam))
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::path::{Path, PathBuf};

    use glam::DVec3;

    use super::super::function::check_file;
    use super::*;
    use crate::ranks::ThreadRank;
    use crate::sample::{BoundaryChoice, Sampled, TransferChoice};
    use crate::sample::{FunctionOptions, KernelOptions, PurposeOptions, Refinement};
    use crate::scene::{Boundary, ScaleName, TransferFunction};

    const DIMS: [usize; 3] = [9, 8, 75];

    /// Writes a grid in pieces that share planes: two along j, four along k.
    ///
    /// - `place`: position of a node.
    fn write(folder: &Path, place: &dyn Fn([usize; 3]) -> DVec3) -> PathBuf {
        let [x, y, z] = DIMS.map(|n| n - 1);
        let mut index = format!(
            r#"<VTKFile type="PStructuredGrid" version="1.0"><PStructuredGrid WholeExtent="0 {x} 5 {} -3 {}">"#,
            y + 5,
            z - 3
        );
        // The last piece is one node thick.
        let cuts = [[0, 20], [20, 41], [41, 44], [44, z], [60, 60]];
        for n in 0..9 {
            let (js, ks) = ([[0, 3], [3, y]][n % 2], cuts[n / 2]);
            let nodes = || {
                (ks[0]..=ks[1]).flat_map(move |k| {
                    (js[0]..=js[1]).flat_map(move |j| (0..=x).map(move |i| [i, j, k]))
                })
            };
            let cells = || {
                (ks[0]..ks[1]).flat_map(move |k| {
                    (js[0]..js[1]).flat_map(move |j| (0..x).map(move |i| [i, j, k]))
                })
            };
            let (mut points, mut heat, mut flow) = (String::new(), String::new(), String::new());
            for [i, j, k] in nodes() {
                let p = place([i, j, k]);
                writeln!(points, "{:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
                let value = match i + 11 * j + 100 * k {
                    2_455 | 4_013 => f64::NAN,
                    _ => 2.0 + (0.8 * p.x).sin() + 0.2 * p.y * (0.1 * p.z).cos(),
                };
                writeln!(heat, "{value}").unwrap();
                writeln!(flow, "{} {} 0", p.y, -p.x).unwrap();
            }
            let (mut load, mut ghosts) = (String::new(), String::new());
            for [i, j, k] in cells() {
                write!(load, "{} ", (i * 7 + j * k) % 23).unwrap();
                let is_hidden = (k == 30 && i < 3) || [i, j, k] == [4, 4, 52];
                write!(ghosts, "{} ", u8::from(is_hidden) * 32).unwrap();
            }
            let array = |name: &str, kind: &str, more: &str, body: &str| {
                format!(
                    r#"<DataArray type="{kind}" Name="{name}" {more} format="ascii">{body}</DataArray>"#
                )
            };
            let extent = format!(
                "0 {x} {} {} {} {}",
                js[0] + 5,
                js[1] + 5,
                ks[0] as i64 - 3,
                ks[1] as i64 - 3
            );
            let own = if n == 1 {
                array("only_here", "Float32", "", &heat)
            } else {
                String::new()
            };
            let text = format!(
                r#"<VTKFile type="StructuredGrid" version="1.0" byte_order="LittleEndian"><StructuredGrid WholeExtent="{extent}">
<Piece Extent="{extent}"><PointData>{own}{}{}</PointData><CellData>{}{}</CellData><Points>{}</Points></Piece></StructuredGrid></VTKFile>"#,
                array("flow", "Float32", r#"NumberOfComponents="3""#, &flow),
                array("heat", "Float32", "", &heat),
                array("load", "UInt8", "", &load),
                array("vtkGhostType", "UInt8", "", &ghosts),
                array("Points", "Float64", r#"NumberOfComponents="3""#, &points),
            );
            std::fs::write(folder.join(format!("{n}.vts")), text).unwrap();
            write!(index, r#"<Piece Extent="{extent}" Source="{n}.vts"/>"#).unwrap();
        }
        index += "</PStructuredGrid></VTKFile>";
        let path = folder.join("all.pvts");
        std::fs::write(&path, index).unwrap();
        path
    }

    /// A sheared and jittered grid whose steps grow and jump; one node has no position.
    fn bent([i, j, k]: [usize; 3]) -> DVec3 {
        let jitter = |d: usize| {
            let n = i + 31 * j + 1_009 * k + 7 * d;
            ((n as f64 * 0.618_034).fract() - 0.5) * 0.1
        };
        if [i, j, k] == [6, 5, 60] {
            return DVec3::NAN;
        }
        let grown = |n: usize| n as f64 + if n > 4 { 0.8 * (n - 4) as f64 } else { 0.0 };
        let along_k = k as f64 + 0.5 * ((k / 12) as f64) + 0.002 * (k * k) as f64;
        DVec3::new(
            grown(i) + 0.2 * j as f64 + jitter(0),
            1.3 * j as f64 + jitter(1),
            along_k + 0.1 * i as f64 + jitter(2),
        )
    }

    /// A grid that closes along i.
    fn ring([i, j, k]: [usize; 3]) -> DVec3 {
        let turn = std::f64::consts::TAU * i as f64 / (DIMS[0] - 1) as f64;
        let radius = 2.0 + 0.5 * j as f64 + 0.01 * (j * j) as f64;
        DVec3::new(radius * turn.cos(), radius * turn.sin(), -0.4 * k as f64)
    }

    fn check(path: &Path, options: &SampleOptions, sizes: &[usize]) -> Sampled {
        check_file(path, options, sizes, |ranks| {
            let file = VtsPieces::open(path).unwrap().unwrap();
            let refinement = options.refinement.as_ref();
            let cameras = || refinement.map_or(Vec::new(), |own| own.cameras.clone());
            read_grid(&file, options, &|_, _| Ok(cameras()), ranks)
                .unwrap()
                .unwrap()
        })
    }

    #[test]
    fn planes_of_pieces_that_ranks_read_are_sampled_as_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), &bent);
        let automatic = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Automatic,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        let found = check(&path, &automatic, &[1, 2, 3, 4, 7]);
        assert_eq!(found.report.field.as_deref(), Some("heat"));
        assert!(found.volume.local_models.is_some() && found.report.left_out_count() >= 3);
        let sharp = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Sharp,
                width: 0.8,
                ..automatic.kernels
            },
            purpose: PurposeOptions {
                normals: true,
                ..automatic.purpose
            },
            field: Some("flow".into()),
            function: FunctionOptions {
                transfer: TransferChoice::Named("plasma".into()),
                unit_distance: Some(0.4),
                ..automatic.function.clone()
            },
            ..automatic.clone()
        };
        let found = check(&path, &sharp, &[2, 3, 7]);
        assert!(matches!(found.volume.boundary, Some(Boundary::Planes(_))));
        assert!(found.volume.normals.is_some());
        let soft = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Soft,
                ..automatic.kernels
            },
            purpose: PurposeOptions {
                local_models: false,
                ..automatic.purpose
            },
            function: FunctionOptions {
                scale: Some(ScaleName::Log),
                ..automatic.function.clone()
            },
            ..automatic.clone()
        };
        let found = check(&path, &soft, &[5]);
        assert!(found.volume.boundary.is_none());
        let of_cells = SampleOptions {
            field: Some("load".into()),
            purpose: PurposeOptions {
                normals: true,
                ..automatic.purpose
            },
            ..automatic.clone()
        };
        check(&path, &of_cells, &[2, 4]);
        // More ranks than planes.
        check(&path, &soft, &[80]);
    }

    #[test]
    fn refined_kernels_are_those_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), &bent);
        let hat = |v: f32| (1.0 - (v - 2.4).abs() / 0.05).max(0.0) * 0.9;
        let function =
            TransferFunction::from_curves(|_| [1.0, 0.5, 0.2], hat, [1.0, 4.0], 0.5).unwrap();
        let eye = DVec3::new(40.0, -60.0, 30.0);
        let target = DVec3::new(6.0, 5.0, 40.0);
        let refined = SampleOptions {
            function: FunctionOptions {
                transfer: TransferChoice::Given(function),
                ..FunctionOptions::default()
            },
            refinement: Some(Refinement {
                cameras: vec![Camera::orthographic(eye, target, DVec3::Z, 80.0, [800; 2])],
                ..Refinement::for_tolerance(1.0 / 255.0)
            }),
            ..SampleOptions::default()
        };
        let soft = check(&path, &refined, &[1, 2, 3, 7]);
        assert!(soft.report.refined_count > 1000 && soft.report.refined_level > 1);
        let sharp = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Sharp,
                ..KernelOptions::default()
            },
            ..refined
        };
        let sharp = check(&path, &sharp, &[2, 5]);
        assert!(sharp.report.refined_count > soft.report.refined_count);
    }

    #[test]
    fn grids_that_close_are_cut_across_their_seams_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), &ring);
        let sharp = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Sharp,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        let found = check(&path, &sharp, &[1, 3, 4]);
        let on_seam = |f: &crate::sample::Finding| f.reason.contains("seam") && f.count == 600;
        assert!(found.report.findings.iter().any(on_seam));
        // A grid that closes along k is read by one rank.
        let last = DIMS[2] - 1;
        let path = write(folder.path(), &|[i, j, k]| {
            let turn = std::f64::consts::TAU * k as f64 / last as f64;
            let radius = 9.0 + i as f64;
            DVec3::new(radius * turn.cos(), radius * turn.sin(), j as f64)
        });
        let own = ThreadRank::group(1).swap_remove(0);
        let file = VtsPieces::open(&path).unwrap().unwrap();
        let mut ranks = own;
        let read = read_grid(&file, &sharp, &|_, _| Ok(Vec::new()), &mut ranks);
        assert!(read.unwrap().is_none());
    }
}
