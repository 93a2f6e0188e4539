//! Converts the mesh of a case from faces, with the cells on their two sides, to cells in VTK's order.

use glam::DVec3;

use super::text::{CaseFile, Kind, Scanner};
use crate::data::cells::CellMesh;
use crate::error::{Error, Result};
use crate::io::grid::face_cells;

/// Cell index beyond the boundary.
const NONE: u32 = u32::MAX;

/// A mesh in the form of its files.
#[derive(Debug)]
pub(super) struct PolyMesh {
    points: Vec<DVec3>,
    /// Start of each face's nodes; one more at the end.
    face_starts: Vec<usize>,
    face_nodes: Vec<u32>,
    /// The cell out of which a face's normal points.
    owners: Vec<u32>,
    /// The cell into which it points, or [`NONE`].
    neighbours: Vec<u32>,
    pub(super) cell_count: usize,
}

/// The four files of a mesh.
#[derive(Debug)]
pub(super) struct MeshFiles {
    pub(super) points: CaseFile,
    pub(super) faces: CaseFile,
    pub(super) owner: CaseFile,
    pub(super) neighbour: CaseFile,
}

impl PolyMesh {
    /// Reads the mesh.
    ///
    /// # Errors
    /// A damaged file; faces with nodes that do not exist; cells that no faces enclose.
    pub(super) fn read(files: &MeshFiles) -> Result<Self> {
        let coordinates = Scanner::new(&files.points)?.list(Kind::Scalars(3), None)?;
        let points: Vec<DVec3> = coordinates.chunks_exact(3).map(DVec3::from_slice).collect();
        drop(coordinates);
        let (face_starts, face_nodes) = read_faces(&files.faces)?;
        let face_count = face_starts.len() - 1;
        let damaged = |file: &CaseFile, expected: String, found: String| {
            let advice = "the mesh is damaged: copy it again";
            Error::format(&file.path, file.name.as_str(), expected, found, advice)
        };
        if let Some(node) = face_nodes.iter().find(|&&n| n as usize >= points.len()) {
            let expected = format!("nodes below {}", points.len());
            return Err(damaged(&files.faces, expected, node.to_string()));
        }
        let owners = Scanner::new(&files.owner)?.labels(Some(face_count))?;
        let neighbours = Scanner::new(&files.neighbour)?.labels(None)?;
        if neighbours.len() > face_count {
            let expected = format!("at most {face_count} cells, one for each face");
            let found = neighbours.len().to_string();
            return Err(damaged(&files.neighbour, expected, found));
        }
        let cells = owners
            .iter()
            .chain(neighbours.iter().filter(|&&n| n != NONE));
        let cell_count = cells.max().map_or(0, |&last| last as usize + 1);
        // A cell has four faces at least, and a face two cells at most.
        if cell_count > face_count {
            let expected = format!("cells that {face_count} faces enclose");
            let found = format!("cell {}", cell_count - 1);
            return Err(damaged(&files.owner, expected, found));
        }
        Ok(Self {
            points,
            face_starts,
            face_nodes,
            owners,
            neighbours,
            cell_count,
        })
    }

    pub(super) fn point_count(&self) -> usize {
        self.points.len()
    }

    fn face(&self, i: usize) -> &[u32] {
        &self.face_nodes[self.face_starts[i]..self.face_starts[i + 1]]
    }

    /// The faces of all cells, concatenated, with the end of each cell.
    fn faces_of_cells(&self) -> (Vec<usize>, Vec<usize>) {
        let sides = [&self.owners, &self.neighbours];
        let mut ends = vec![0; self.cell_count];
        for &cell in sides.into_iter().flatten().filter(|&&cell| cell != NONE) {
            ends[cell as usize] += 1;
        }
        let mut start = 0;
        for end in &mut ends {
            (start, *end) = (start + *end, start);
        }
        let mut faces = vec![0; start];
        for side in sides {
            for (face, &cell) in side.iter().enumerate().filter(|(_, cell)| **cell != NONE) {
                let end = &mut ends[cell as usize];
                faces[*end] = face;
                *end += 1;
            }
        }
        (ends, faces)
    }

    /// Appends the cells to those of other pieces of the mesh.
    ///
    /// # Errors
    /// More entries than 32 bits count; the error has no details.
    pub(super) fn append_to(self, mesh: &mut CellMesh) -> Result<(), TooMany> {
        let first = u32::try_from(mesh.nodes.len()).map_err(|_| TooMany)?;
        u32::try_from(mesh.nodes.len() + self.points.len()).map_err(|_| TooMany)?;
        let (ends, faces) = self.faces_of_cells();
        let mut start = 0;
        let mut outward: Vec<Vec<u32>> = Vec::new();
        for (cell, &end) in ends.iter().enumerate() {
            outward.clear();
            outward.extend(faces[start..end].iter().map(|&face| {
                let nodes = self.face(face).iter().map(|&n| first + n);
                match self.owners[face] as usize == cell {
                    true => nodes.collect::<Vec<u32>>(),
                    false => nodes.rev().collect(),
                }
            }));
            start = end;
            face_cells::append(mesh, &outward).ok_or(TooMany)?;
        }
        mesh.nodes.extend(self.points);
        Ok(())
    }
}

/// The error for a mesh with more entries than 32 bits count.
#[derive(Debug, Clone, Copy)]
pub(super) struct TooMany;

fn read_faces(file: &CaseFile) -> Result<(Vec<usize>, Vec<u32>)> {
    let mut scanner = Scanner::new(file)?;
    let (mut starts, mut nodes) = (vec![0], Vec::new());
    if scanner.header.class == "faceCompactList" {
        let offsets = scanner.labels(None)?;
        nodes = scanner.labels(None)?;
        starts = offsets.iter().map(|&n| n as usize).collect();
        let rises = starts.first() == Some(&0) && starts.windows(2).all(|w| w[0] <= w[1]);
        if !rises || starts.last() != Some(&nodes.len()) {
            return Err(scanner.fault("places of faces that rise to the number of nodes"));
        }
    } else {
        let count = scanner.count()?;
        scanner.expect(b'(')?;
        for _ in 0..count {
            nodes.extend(scanner.labels(None)?);
            starts.push(nodes.len());
        }
        scanner.expect(b')')?;
    }
    match starts.windows(2).position(|w| w[1] - w[0] < 3) {
        Some(face) => Err(Error::format(
            &file.path,
            format!("{}, face {face}", file.name),
            "three nodes or more",
            (starts[face + 1] - starts[face]).to_string(),
            "the mesh is damaged: copy it again",
        )),
        None => Ok((starts, nodes)),
    }
}
