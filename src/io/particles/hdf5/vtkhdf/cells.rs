//! Reads unstructured grids and polygonal data. Parts follow one another, and so do time steps.
//!
//! | array | rows of a part |
//! |---|---|
//! | `NumberOfPoints`, `NumberOfCells`, `NumberOfConnectivityIds` | its own one |
//! | `Points` | its points |
//! | `Types` | its cells |
//! | `Offsets` | its cells and one more: where each cell's nodes begin, from 0 in each part |
//! | `Connectivity` | its connectivity, nodes counted from 0 in each part |
//! | `PolyhedronOffsets`, `PolyhedronToFaces`, `FaceOffsets`, `FaceConnectivity` | for polyhedra, like the last two: faces of cells, and nodes of faces |
//!
//! Polygonal data have the cells' arrays in groups `Vertices`, `Lines`, `Polygons` and `Strips`. Cells are numbered in
//! this order. At a time step, `NumberOfParts` parts from `PartOffsets` on are valid. The other arrays of `Steps` state
//! where their rows begin.

use std::ops::Range;

use hdf5_reader::group::Group;

use super::Block;
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::error::Result;
use crate::io::bytes::scalars;
use crate::io::vtk::meshes::{Part, Runs, face_streams, with_polyhedra, without_nodes};
use crate::io::vtk::vtp;

/// Groups of polygonal data, in the order of [`vtp::ELEMENTS`].
const GROUPS: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];

/// First rows of a part in the arrays of one kind of cells.
#[derive(Clone, Copy)]
struct Starts {
    cell: usize,
    id: usize,
}

impl Block<'_, '_> {
    /// Returns the parts of the time step.
    fn parts(&self, count: usize) -> Result<Range<usize>> {
        let Some(steps) = &self.steps else {
            return Ok(0..count);
        };
        let first = self.start("PartOffsets", 0)?;
        let of_step = self.start_in(steps, "NumberOfParts", 0)?;
        let of_step = of_step.unwrap_or(1);
        let end = first.saturating_add(of_step);
        if end > count {
            return Err(self.fault(
                "Steps/PartOffsets",
                &format!("parts of {count}"),
                format!("{first} to {end}"),
            ));
        }
        Ok(first..end)
    }

    /// Reads the parts of an unstructured grid.
    pub(super) fn solids(&self) -> Result<Vec<Part>> {
        let group = &self.group;
        let points = self.counts(group, "NumberOfPoints")?;
        let cells = self.counts(group, "NumberOfCells")?;
        let ids = self.counts(group, "NumberOfConnectivityIds")?;
        self.check_counts(&points, &[&cells, &ids])?;
        let faces = match self.file.has(group, "PolyhedronOffsets")? {
            true => Some(Faces::new(self, points.len())?),
            false => None,
        };
        let (point_start, cell_start) = (
            self.start("PointOffsets", 0)?,
            self.start("CellOffsets", 0)?,
        );
        let (mut point, mut cell) = (0_usize, 0_usize);
        let mut id = self.start("ConnectivityIdOffsets", 0)?;
        let mut face_starts = match &faces {
            Some(_) => FaceStarts::new(self)?,
            None => FaceStarts::default(),
        };
        let mut parts = Vec::new();
        for part in self.parts(points.len())? {
            let (point_count, cell_count, id_count) = (points[part], cells[part], ids[part]);
            let first = cell_start.saturating_add(cell);
            let kinds = self.indices(group, "Types", rows(first, cell_count), |n| {
                u8::try_from(n).ok().map(CellKind)
            })?;
            let starts = Starts {
                cell: first.saturating_add(part),
                id,
            };
            let runs = self.runs(
                group,
                ["Offsets", "Connectivity"],
                starts,
                [cell_count, id_count],
            )?;
            let has_polyhedra = kinds.contains(&CellKind::POLYHEDRON);
            let mesh = match &faces {
                Some(faces) if has_polyhedra => {
                    let of_cells =
                        faces.of_part(self, part, &face_starts, starts.cell, cell_count)?;
                    with_polyhedra(self.file.path, kinds, &runs, &of_cells)?
                }
                _ => without_nodes(kinds, runs),
            };
            if let Some(faces) = &faces {
                face_starts.step_over(faces, part);
            }
            let at = PartRows {
                points: rows(point, point_count),
                cells: rows(cell, cell_count),
                starts: [point_start, cell_start],
            };
            parts.extend(self.part(mesh, at)?);
            point = point.saturating_add(point_count);
            cell = cell.saturating_add(cell_count);
            id = id.saturating_add(id_count);
        }
        Ok(parts)
    }

    /// Reads the parts of polygonal data.
    pub(super) fn polygons(&self) -> Result<Vec<Part>> {
        struct Kind {
            group: Group,
            cells: Vec<usize>,
            ids: Vec<usize>,
            starts: Starts,
        }
        let points = self.counts(&self.group, "NumberOfPoints")?;
        let mut kinds = Vec::new();
        let mut cell_start = 0_usize;
        for (column, name) in GROUPS.into_iter().enumerate() {
            let Some(group) = self.file.child(&self.group, name)? else {
                kinds.push(None);
                continue;
            };
            let cells = self.counts(&group, "NumberOfCells")?;
            let ids = self.counts(&group, "NumberOfConnectivityIds")?;
            self.check_counts(&points, &[&cells, &ids])?;
            let starts = Starts {
                cell: self.start("CellOffsets", column)?,
                id: self.start("ConnectivityIdOffsets", column)?,
            };
            cell_start = cell_start.saturating_add(starts.cell);
            kinds.push(Some(Kind {
                group,
                cells,
                ids,
                starts,
            }));
        }
        let point_start = self.start("PointOffsets", 0)?;
        let (mut point, mut cell) = (0_usize, 0_usize);
        let mut parts = Vec::new();
        for part in self.parts(points.len())? {
            let mut mesh = CellMesh {
                offsets: vec![0],
                ..CellMesh::default()
            };
            let mut cell_count = 0_usize;
            for (kind, (_, _, kind_of)) in kinds.iter_mut().zip(vtp::ELEMENTS) {
                let Some(kind) = kind else { continue };
                let counts = [kind.cells[part], kind.ids[part]];
                let starts = Starts {
                    cell: kind.starts.cell.saturating_add(part),
                    ..kind.starts
                };
                let runs = self.runs(&kind.group, ["Offsets", "Connectivity"], starts, counts)?;
                vtp::append(self.file.path, &mut mesh, &runs, kind_of)?;
                kind.starts.cell = kind.starts.cell.saturating_add(counts[0]);
                kind.starts.id = kind.starts.id.saturating_add(counts[1]);
                cell_count = cell_count.saturating_add(counts[0]);
            }
            let at = PartRows {
                points: rows(point, points[part]),
                cells: rows(cell, cell_count),
                starts: [point_start, cell_start],
            };
            parts.extend(self.part(mesh, at)?);
            point = point.saturating_add(points[part]);
            cell = cell.saturating_add(cell_count);
        }
        Ok(parts)
    }

    /// Adds nodes and arrays to the cells of a part; returns `None` if the part is empty.
    fn part(&self, mut mesh: CellMesh, rows_of: PartRows) -> Result<Option<Part>> {
        if rows_of.points.is_empty() && rows_of.cells.is_empty() {
            return Ok(None);
        }
        let [point_start, cell_start] = rows_of.starts;
        let first = point_start.saturating_add(rows_of.points.start);
        let points = self.needed(
            &self.group,
            "Points",
            Some(rows(first, rows_of.points.len())),
        )?;
        let nodes = (points.components == 3)
            .then(|| scalars::points(&points.bytes, points.encoding, points.count));
        mesh.nodes = nodes.flatten().ok_or_else(|| {
            let found = format!("{} numbers each", points.components);
            self.fault("Points", "three numbers for each point", found)
        })?;
        mesh.check(self.file.path)?;
        let arrays = |association, start, rows| self.arrays(&self.group, association, start, rows);
        Ok(Some(Part::new(
            mesh,
            arrays(Association::Nodes, point_start, rows_of.points)?,
            arrays(Association::Cells, cell_start, rows_of.cells)?,
        )))
    }

    /// Reads the cells or faces of a part. Its offsets must begin with 0.
    fn runs(
        &self,
        group: &Group,
        [offsets, entries]: [&str; 2],
        starts: Starts,
        [count, entry_count]: [usize; 2],
    ) -> Result<Runs> {
        if count == 0 {
            return Ok(Runs {
                offsets: vec![0],
                connectivity: Vec::new(),
            });
        }
        let index = |n: i128| u32::try_from(n).ok();
        let bounds = self.indices(
            group,
            offsets,
            rows(starts.cell, count.saturating_add(1)),
            index,
        )?;
        let connectivity = self.indices(group, entries, rows(starts.id, entry_count), index)?;
        let rises = bounds.windows(2).all(|w| w[0] <= w[1]);
        let ends = [bounds.first(), bounds.last()].map(|n| n.map(|n| *n as usize));
        if !rises || ends != [Some(0), Some(connectivity.len())] {
            let expected = format!("numbers that rise from 0 to {entry_count}");
            return Err(self.fault(offsets, &expected, format!("{ends:?}")));
        }
        Ok(Runs {
            offsets: bounds,
            connectivity,
        })
    }

    /// Checks that each array has one count per part.
    fn check_counts(&self, points: &[usize], others: &[&[usize]]) -> Result<()> {
        match others.iter().find(|counts| counts.len() != points.len()) {
            None => Ok(()),
            Some(counts) => Err(self.fault(
                "NumberOfCells",
                &format!("a count for each of {} parts", points.len()),
                counts.len().to_string(),
            )),
        }
    }
}

/// Rows of a part relative to its step, and the first rows of points and cells of the step.
struct PartRows {
    points: Range<usize>,
    cells: Range<usize>,
    starts: [usize; 2],
}

fn rows(first: usize, count: usize) -> Range<usize> {
    first..first.saturating_add(count)
}

/// Numbers of faces, of nodes of faces, and of faces that cells name, for each part.
struct Faces {
    faces: Vec<usize>,
    nodes: Vec<usize>,
    of_cells: Vec<usize>,
}

/// First rows of a part in the arrays of polyhedra.
#[derive(Default)]
struct FaceStarts {
    face: usize,
    node: usize,
    of_cells: usize,
}

impl FaceStarts {
    fn new(block: &Block<'_, '_>) -> Result<Self> {
        Ok(Self {
            face: block.start("FaceOffsetsOffsets", 0)?,
            node: block.start("FaceConnectivityOffsets", 0)?,
            of_cells: block.start("PolyhedronToFaceIdOffsets", 0)?,
        })
    }

    fn step_over(&mut self, faces: &Faces, part: usize) {
        self.face = self.face.saturating_add(faces.faces[part]);
        self.node = self.node.saturating_add(faces.nodes[part]);
        self.of_cells = self.of_cells.saturating_add(faces.of_cells[part]);
    }
}

impl Faces {
    fn new(block: &Block<'_, '_>, part_count: usize) -> Result<Self> {
        let counts = |name| block.counts(&block.group, name);
        let faces = Self {
            faces: counts("NumberOfFaces")?,
            nodes: counts("NumberOfFaceConnectivityIds")?,
            of_cells: counts("NumberOfPolyhedronToFaceIds")?,
        };
        let points = vec![0; part_count];
        block.check_counts(&points, &[&faces.faces, &faces.nodes, &faces.of_cells])?;
        Ok(faces)
    }

    /// Returns the polyhedra of a part in the form of [`CellMesh`].
    fn of_part(
        &self,
        block: &Block<'_, '_>,
        part: usize,
        starts: &FaceStarts,
        cell: usize,
        cell_count: usize,
    ) -> Result<Runs> {
        let group = &block.group;
        let of_faces = Starts {
            cell: starts.face.saturating_add(part),
            id: starts.node,
        };
        let names = ["FaceOffsets", "FaceConnectivity"];
        let faces = block.runs(group, names, of_faces, [self.faces[part], self.nodes[part]])?;
        let of_cells = Starts {
            cell,
            id: starts.of_cells,
        };
        let names = ["PolyhedronOffsets", "PolyhedronToFaces"];
        let cells = block.runs(group, names, of_cells, [cell_count, self.of_cells[part]])?;
        face_streams(block.file.path, "PolyhedronToFaces", &faces, &cells)
    }
}
