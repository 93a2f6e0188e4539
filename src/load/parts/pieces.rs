//! Reads an unstructured grid in pieces, some pieces on each rank.

use std::ops::Range;

use super::cell_subset::CellSubset;
use super::function::{
    PartRead, differences_of_all, found_by_all, models_of_all, outline_of_all, show,
};
use super::ghost_layers::GhostLayers;
use super::planes::joined;
use crate::collective::Collective;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::data::first_order::is_of_higher_order;
use crate::error::Result;
use crate::io::{ArraysSeen, VtuPieces};
use crate::math::ExactSum;
use crate::ranks::Share;
use crate::sample::Found;
use crate::sample::{
    CellField, LEAST_PER_NODE, PartitionedCells, SampleOptions, SampleReport, check_len,
    may_be_refined, may_refine, shown_field, take_scalar, turned,
};
use crate::scene::{Surroundings, Tiling, ValueScale, Values};

/// Assigns a reader a run of files, so that all readers get about as many bytes.
pub(crate) fn assigned(lengths: &[u64], reader: usize, readers: usize) -> Range<usize> {
    let all: u128 = lengths.iter().map(|&length| u128::from(length)).sum();
    let mut before = 0;
    let middle = |&length: &u64| {
        before += u128::from(length);
        2 * before - u128::from(length)
    };
    let middles: Vec<u128> = lengths.iter().map(middle).collect();
    // A reader gets the files whose middle byte lies in its share of all bytes.
    let first = |reader: usize| match reader {
        0 => 0,
        _ => middles.partition_point(|middle| middle * readers as u128 <= 2 * all * reader as u128),
    };
    first(reader)..first(reader + 1)
}

/// Reads this rank's pieces and makes particles of them: the particles that [`sample::volume`](crate::sample::volume)
/// makes of the whole grid.
///
/// Returns `None` if one rank must read the whole grid. That is so for grids without solid cells, high-order cells,
/// iso-surfaces, and sampling options that need all values on one rank. It is also so if the boundary may be sharp,
/// because faces on the boundary can be found only in the whole mesh, and if the mesh may be refined.
///
/// # Errors
/// The errors of reading or sampling, on any rank; nothing that can be drawn; a rank that is gone.
pub(crate) fn read_pieces(
    file: &VtuPieces,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Option<PartRead>> {
    if options.makes_surface()
        || options.kernels.shepard_passes > 0
        || options.purpose.keeps_value_sample
    {
        return Ok(None);
    }
    let lengths: Vec<u64> = file.lengths().collect();
    let own = file.read(assigned(&lengths, ranks.rank(), ranks.size()));
    let own = ranks.agree(own)?;
    let seen = seen_by_all(&own.seen, ranks)?;
    // Number of pieces with solid cells, and with cells of higher order.
    let has_solid = |mesh: &&CellMesh| mesh.kinds.iter().any(|kind| kind.is_solid());
    let solid = own.meshes().filter(has_solid).count() as u64;
    let higher = own.meshes().filter(|mesh| is_of_higher_order(mesh)).count() as u64;
    let [solid, higher] = ranks.sums(Ok(vec![solid, higher]))?[..] else {
        return Ok(None);
    };
    if solid == 0 || higher > 0 {
        return Ok(None);
    }
    let dataset = own.dataset(file.path(), &seen);
    let dataset = ranks.agree(dataset)?;
    held_cells(dataset, options, ranks)
}

/// Makes particles of cells in memory, of which each rank holds some: the particles that
/// [`sample::volume`](crate::sample::volume) makes of all, one rank after another. Nodes at one position are one node.
///
/// - `dataset`: this rank's cells, with the same fields on every rank; some rank has solid ones, and none has cells of
///   higher order.
///
/// Returns `None` as [`read_pieces`].
///
/// # Errors
/// As [`read_pieces`].
pub(super) fn held_cells(
    dataset: Dataset,
    options: &SampleOptions,
    ranks: &mut dyn Collective,
) -> Result<Option<PartRead>> {
    let count = match &dataset.geometry {
        Geometry::Cells(mesh) => mesh.cell_count() as u64,
        _ => 0,
    };
    let count = ranks.sum(Ok(count))? as usize;
    let path = dataset.path.clone();
    let head = head_of(&dataset, ranks)?;
    let field = shown_field(&head, options)?;
    let corners = dataset.bounds();
    let own = ranks.agree(subset_of(dataset, &field))?;
    let differences = differences_of_all(&own.values, ranks)?;
    let counts = turned(&own.mesh).into_iter().flatten();
    let counts = ranks.sums(Ok(counts.map(|count| count as u64).collect()))?;
    let turned: Vec<[usize; 2]> = counts
        .chunks_exact(2)
        .map(|pair| [pair[0] as usize, pair[1] as usize])
        .collect();
    // Layers of ghost cells. Kernels need the cells around a sample. Normals also need the kernels of these cells'
    // samples. Local models also need the neighbours of these samples.
    let layers = match (options.purpose.local_models, options.purpose.normals) {
        (true, _) => 3,
        (false, true) => 2,
        (false, false) => 1,
    };
    let of_nodes = own.association == Association::Nodes;
    let is_sharp = options.is_sharp() && of_nodes;
    if (is_sharp && options.is_sharp_anyway()) || may_be_refined(count, of_nodes, options) {
        return Ok(None);
    }
    let outline = outline_of_all(&own.mesh.nodes, ranks)?;
    let layers = GhostLayers::around(own, layers, ranks);
    let layers = ranks.agree(layers)?;
    let mut volume_sum = ExactSum::default();
    let sampled = sampled(layers, &turned, differences, options, &mut volume_sum);
    let PartitionedCells {
        mut volume,
        models,
        on_boundary,
        report,
    } = ranks.agree(sampled)?;
    let before = ranks.sum_before(Ok(report.particle_count as u64))?;
    let found = Found {
        report: SampleReport {
            field: Some(field),
            may_refine: may_refine(count),
            ..report
        },
        corners,
        volume_sum,
    };
    let (mut found, spacing) = found_by_all(&found, &head, &path, options, ranks)?;
    let count = found.report.particle_count;
    let picked = PartitionedCells::picked(&volume, before as usize, count);
    let shown = (&mut found, spacing);
    show(
        &mut volume,
        picked,
        (count, (Surroundings::Absent, Tiling::Whole)),
        shown,
        options,
        ranks,
    )?;
    let is_cut = is_sharp && options.cuts(&volume, on_boundary.into_iter());
    if ranks.any(is_cut)? {
        return Ok(None);
    }
    if let Some(models) = models {
        volume.local_models = Some(models_of_all(&models, ranks)?);
    }
    let geometry = Geometry::Cells(CellMesh {
        nodes: outline,
        ..CellMesh::default()
    });
    Ok(Some(PartRead {
        share: Share::from(vec![volume]),
        report: found.report,
        head: Dataset { geometry, ..head },
        corners: found.corners,
    }))
}

/// Returns the arrays of nodes and of cells in the pieces of all ranks.
pub(super) fn seen_by_all(
    own: &[ArraysSeen; 2],
    ranks: &mut dyn Collective,
) -> Result<[ArraysSeen; 2]> {
    let own = own.each_ref().map(|seen| (seen.parts, seen.arrays.clone()));
    let mut all: [ArraysSeen; 2] = Default::default();
    for seen in ranks.gather_values(own)? {
        for (all, (parts, arrays)) in all.iter_mut().zip(seen) {
            all.add(ArraysSeen { parts, arrays });
        }
    }
    Ok(all)
}

/// Returns the fields of all ranks without nodes and cells. Each component stores only its least and greatest value
/// over all ranks, by which the field to show is chosen.
pub(super) fn head_of(own: &Dataset, ranks: &mut dyn Collective) -> Result<Dataset> {
    let range = |values: &Values| {
        let range = values.finite_range();
        range.unwrap_or([f64::INFINITY, f64::NEG_INFINITY])
    };
    let ranges = own
        .fields
        .iter()
        .flat_map(|field| field.arrays().iter().map(range));
    let all = ranks.gather_records(Ok(ranges.collect()))?;
    let mut n = 0..;
    let mut head = |values: &Values| {
        let place = n.next().unwrap_or(usize::MAX);
        let of_ranks = all.iter().filter_map(|ranges| ranges.get(place).copied());
        let range = of_ranks
            .filter(|[lo, hi]| lo <= hi)
            .map(Some)
            .fold(None, joined);
        Values::of_type(
            values.type_name(),
            &range.map_or(Vec::new(), |r| r.to_vec()),
        )
    };
    let fields = own.fields.iter().map(|field| Field {
        name: field.name.clone(),
        association: field.association,
        source: match &field.source {
            FieldSource::Scalar(values) => FieldSource::Scalar(head(values)),
            FieldSource::Vector(components) => {
                FieldSource::Vector(components.iter().map(&mut head).collect())
            }
            FieldSource::Derived(derive) => FieldSource::Derived(*derive),
        },
        unit: field.unit.clone(),
    });
    let geometry = Geometry::Points {
        positions: Vec::new(),
    };
    Ok(Dataset {
        notes: own.notes.clone(),
        ..Dataset::new(&own.path, own.format, geometry, fields.collect())
    })
}

/// Returns this rank's cells with the field that is shown.
fn subset_of(mut dataset: Dataset, field: &str) -> Result<CellSubset> {
    let blanking = Blanking::of(&dataset)?;
    let taken = take_scalar(&mut dataset, field)?;
    let Geometry::Cells(mesh) = &mut dataset.geometry else {
        unreachable!("pieces of an unstructured grid are cells")
    };
    let mesh = std::mem::take(mesh);
    let blanking = blanking.of_mesh(&mesh);
    // One kernel for each node, or for each cell.
    let count = mesh.nodes.len().min(mesh.cell_count());
    crate::memory::check(count, LEAST_PER_NODE).map_err(|e| e.in_file(&dataset.path))?;
    check_len(&dataset, &taken, mesh.count_of(taken.association))?;
    Ok(CellSubset {
        hidden_nodes: (0..mesh.nodes.len())
            .map(|i| blanking.node(i).into())
            .collect(),
        hidden_cells: (0..mesh.cell_count())
            .map(|i| blanking.cell(i).into())
            .collect(),
        mesh,
        association: taken.association,
        values: taken.values,
    })
}

/// Makes the particles of a rank's own nodes or cells.
fn sampled(
    layers: GhostLayers,
    turned: &[[usize; 2]],
    differences: ValueScale,
    options: &SampleOptions,
    volume_sum: &mut ExactSum,
) -> Result<PartitionedCells> {
    let GhostLayers {
        subset,
        nodes,
        cells,
        ..
    } = layers;
    let blanking = Blanking::of_masks(
        subset
            .hidden_nodes
            .into_iter()
            .map(|own| own != 0)
            .collect(),
        subset
            .hidden_cells
            .into_iter()
            .map(|own| own != 0)
            .collect(),
    );
    let seen = differences.seen(&subset.values);
    let field = CellField {
        mesh: &subset.mesh,
        blanking: &blanking,
        association: subset.association,
        values: &subset.values,
        seen: &seen,
        nodes,
        cells,
    };
    field.sampled(turned, options, volume_sum)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::path::{Path, PathBuf};

    use glam::DVec3;

    use super::super::function::check_file;
    use super::*;
    use crate::data::cells::CellKind;
    use crate::ranks::ThreadRank;
    use crate::sample::{BoundaryChoice, Refinement, Sampled, TransferChoice};
    use crate::sample::{FunctionOptions, KernelOptions, PurposeOptions};

    const CELLS: [usize; 3] = [20, 5, 5];

    /// Number of a node without a position.
    const NOWHERE: usize = 1 << 20;

    /// Six tetrahedra around a cube's diagonal, by the cube's corners, x fastest.
    const TETRAHEDRA: [[usize; 4]; 6] = [
        [0, 1, 3, 7],
        [0, 2, 6, 7],
        [0, 4, 5, 7],
        [0, 5, 1, 7],
        [0, 3, 2, 7],
        [0, 6, 4, 7],
    ];

    /// Returns a number from -1 to 1 that depends on `n` alone.
    fn noise(n: usize) -> f64 {
        let hashed = (n as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let hashed = (hashed ^ (hashed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hashed ^ (hashed >> 29)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A piece of a mesh, and its nodes' numbers in the lattice that the mesh is made of.
    #[derive(Default)]
    struct Piece {
        nodes: Vec<usize>,
        cells: Vec<(CellKind, Vec<usize>)>,
    }

    impl Piece {
        fn add(&mut self, kind: CellKind, corners: &[usize]) {
            let place = |&node: &usize| {
                let known = self.nodes.iter().position(|own| *own == node);
                known.unwrap_or_else(|| {
                    self.nodes.push(node);
                    self.nodes.len() - 1
                })
            };
            let entries = corners.iter().map(place).collect();
            self.cells.push((kind, entries));
        }

        fn write(&self, n: usize, path: &Path, place: impl Fn(usize) -> DVec3) {
            let is_second = n == 1;
            let (mut points, mut heat, mut flow) = (String::new(), String::new(), String::new());
            for &node in &self.nodes {
                let p = place(node);
                writeln!(points, "{:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
                let value = (p.x * 0.7).sin() + 0.3 * p.y * p.z - 0.01 * n as f64;
                // Some values are missing, so that other nodes have fewer neighbours; one value stands out.
                let value = match node {
                    n if n % 41 == 5 => f64::NAN,
                    n if n == 2 + 21 * (1 + 6) => 20.0,
                    _ => value,
                };
                writeln!(heat, "{value}").unwrap();
                writeln!(flow, "{} {} 0", p.y, -p.x).unwrap();
            }
            let [mut kinds, mut ends, mut entries, mut ghosts, mut load] =
                [(); 5].map(|()| String::new());
            let mut end = 0;
            for (i, (kind, cell)) in self.cells.iter().enumerate() {
                end += cell.len();
                write!(kinds, "{} ", kind.0).unwrap();
                write!(ends, "{end} ").unwrap();
                cell.iter().for_each(|n| write!(entries, "{n} ").unwrap());
                write!(ghosts, "{} ", u8::from(is_second && i % 19 == 3) * 32).unwrap();
                write!(load, "{} ", (i * 7 + n) % 23).unwrap();
            }
            let array = |name: &str, kind: &str, more: &str, body: &str| {
                format!(
                    r#"<DataArray type="{kind}" Name="{name}" {more} format="ascii">{body}</DataArray>"#
                )
            };
            let own = if is_second {
                array("only_here", "Float32", "", &heat)
            } else {
                String::new()
            };
            let text = format!(
                r#"<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"><UnstructuredGrid>
<Piece NumberOfPoints="{}" NumberOfCells="{}"><PointData>{own}{}{}</PointData><CellData>{}{}</CellData>
<Points>{}</Points><Cells>{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>"#,
                self.nodes.len(),
                self.cells.len(),
                array("flow", "Float32", r#"NumberOfComponents="3""#, &flow),
                array("heat", "Float32", "", &heat),
                array("vtkGhostType", "UInt8", "", &ghosts),
                array("load", "UInt8", "", &load),
                array("Points", "Float64", r#"NumberOfComponents="3""#, &points),
                array("connectivity", "Int64", "", &entries),
                array("offsets", "Int64", "", &ends),
                array("types", "UInt8", "", &kinds),
            );
            std::fs::write(path, text).unwrap();
        }
    }

    /// Writes a block of hexahedra and tetrahedra in pieces whose borders are not plane; one piece is empty.
    ///
    /// - `gap`: distance between each piece and the one before.
    fn write(folder: &Path, gap: f64) -> PathBuf {
        let mut pieces: Vec<Piece> = (0..7).map(|_| Piece::default()).collect();
        let [x, y, z] = CELLS;
        let node = |i: usize, j: usize, k: usize| i + (x + 1) * (j + (y + 1) * k);
        for n in 0..x * y * z {
            let [i, j, k] = [n % x, n / x % y, n / (x * y)];
            let corners: [usize; 8] =
                std::array::from_fn(|c| node(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)));
            // Slabs with teeth, and one cell of another piece within a slab.
            let own = match (i + (j + k) % 2) / 7 {
                _ if (i, j, k) == (16, 3, 3) => 5,
                _ if i > 17 => 6,
                slab => slab,
            };
            let mut corners = corners;
            if matches!([i, j, k], [7 | 10, 2, 2]) {
                // Two cells three apart that share one node, and it has no position.
                corners[7] = NOWHERE;
            }
            if (i + j * k) % 4 == 0 {
                for t in TETRAHEDRA {
                    pieces[own].add(CellKind::TETRA, &t.map(|c| corners[c]));
                }
            } else {
                pieces[own].add(CellKind::VOXEL, &corners);
            }
        }
        // A node of no cell, and a node without a position among the cells around it.
        pieces[1].nodes.push(node(0, 0, 0));
        let nowhere = node(8, 2, 2);
        let mut index = String::from(
            r#"<VTKFile type="PUnstructuredGrid" version="1.0"><PUnstructuredGrid GhostLevel="0">"#,
        );
        for (n, piece) in pieces.iter().enumerate() {
            let place = |node: usize| {
                let at = [
                    node % (x + 1),
                    node / (x + 1) % (y + 1),
                    node / ((x + 1) * (y + 1)),
                ];
                let own = DVec3::from([0, 1, 2].map(|d| at[d] as f64 + 0.2 * noise(3 * node + d)));
                // -0 and 0 are the same position where pieces meet.
                let own = if node == 0 {
                    DVec3::splat(if n == 0 { -0.0 } else { 0.0 })
                } else {
                    own
                };
                if node == nowhere || node == NOWHERE {
                    DVec3::NAN
                } else {
                    own + DVec3::X * (gap * n as f64)
                }
            };
            piece.write(n, &folder.join(format!("{n}.vtu")), place);
            write!(index, r#"<Piece Source="{n}.vtu"/>"#).unwrap();
        }
        index += "</PUnstructuredGrid></VTKFile>";
        let path = folder.join("all.pvtu");
        std::fs::write(&path, index).unwrap();
        path
    }

    fn check(path: &Path, options: &SampleOptions, sizes: &[usize]) -> Sampled {
        check_file(path, options, sizes, |ranks| {
            let file = VtuPieces::open(path).unwrap().unwrap();
            read_pieces(&file, options, ranks).unwrap().unwrap()
        })
    }

    #[test]
    fn pieces_that_ranks_read_are_sampled_as_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), 0.0);
        let plain = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Soft,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        let found = check(&path, &plain, &[1, 2, 3, 4, 7, 9]);
        assert_eq!(found.report.field.as_deref(), Some("heat"));
        assert!(found.volume.boundary.is_none() && found.volume.local_models.is_some());
        assert!(found.report.left_out_count() > 10);
        let lit = SampleOptions {
            field: Some("load".into()),
            purpose: PurposeOptions {
                normals: true,
                ..plain.purpose
            },
            function: FunctionOptions {
                transfer: TransferChoice::Named("plasma".into()),
                unit_distance: Some(0.4),
                ..plain.function.clone()
            },
            ..plain.clone()
        };
        let found = check(&path, &lit, &[2, 3, 7]);
        assert!(found.volume.normals.is_some());
        let lit = SampleOptions {
            field: Some("flow:y".into()),
            purpose: PurposeOptions {
                local_models: false,
                ..lit.purpose
            },
            ..lit
        };
        check(&path, &lit, &[3]);
        // The function shows values inside only, where one stands out.
        let inside = r#"{"range": [-5, 20], "points": [{"value": 12, "color": [1, 1, 1], "opacity": 0},
            {"value": 20, "color": [1, 0, 0], "opacity": 0.9}]}"#;
        let inside = SampleOptions {
            function: FunctionOptions {
                transfer: TransferChoice::Text(inside.into()),
                ..plain.function.clone()
            },
            kernels: KernelOptions {
                boundary: BoundaryChoice::Automatic,
                ..plain.kernels
            },
            ..plain.clone()
        };
        let found = check(&path, &inside, &[1, 3]);
        assert!(found.volume.boundary.is_none());
        let bare = SampleOptions {
            field: Some("load".into()),
            purpose: PurposeOptions {
                local_models: false,
                for_columns: true,
                ..plain.purpose
            },
            kernels: KernelOptions {
                boundary: BoundaryChoice::Automatic,
                ..plain.kernels
            },
            ..plain
        };
        check(&path, &bare, &[4]);
    }

    #[test]
    fn files_are_assigned_by_their_lengths() {
        for lengths in [
            &[][..],
            &[0, 0, 0],
            &[7, 1, 1, 1, 1, 1, 2],
            &[u64::MAX; 5],
            &[3],
        ] {
            for readers in 1..9 {
                let mut next = 0;
                for reader in 0..readers {
                    let part = assigned(lengths, reader, readers);
                    assert_eq!(part.start, next, "{lengths:?} {readers}");
                    next = part.end;
                }
                assert_eq!(next, lengths.len(), "{lengths:?} {readers}");
            }
        }
        assert_eq!(
            [0, 1].map(|n| assigned(&[7, 1, 1, 1, 1, 1, 2], n, 2)),
            [0..1, 1..7]
        );
    }

    #[test]
    fn what_may_end_sharply_is_left_to_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), 0.0);
        let read = |options: &SampleOptions| {
            let file = VtuPieces::open(&path).unwrap().unwrap();
            let own = ThreadRank::group(1).swap_remove(0);
            let mut ranks = own;
            read_pieces(&file, options, &mut ranks).unwrap().is_some()
        };
        let automatic = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Automatic,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        assert!(!read(&automatic));
        let sharp = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Sharp,
                ..automatic.kernels
            },
            ..automatic.clone()
        };
        assert!(!read(&sharp));
        let soft = SampleOptions {
            kernels: KernelOptions {
                boundary: BoundaryChoice::Soft,
                ..automatic.kernels
            },
            ..automatic.clone()
        };
        check(&path, &soft, &[2, 5]);
        // Values of cells have no boundary.
        let of_cells = SampleOptions {
            field: Some("load".into()),
            ..automatic
        };
        check(&path, &of_cells, &[3]);
    }
    #[test]
    fn what_may_be_refined_is_left_to_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), 0.0);
        let is_read = |field: &str| {
            let options = SampleOptions {
                field: Some(field.into()),
                refinement: Some(Refinement::for_tolerance(1.0 / 255.0)),
                ..SampleOptions::default()
            };
            let file = VtuPieces::open(&path).unwrap().unwrap();
            let mut ranks = ThreadRank::group(1).swap_remove(0);
            read_pieces(&file, &options, &mut ranks).unwrap().is_some()
        };
        assert!(!is_read("heat") && !is_read("load"));
    }
}
