//! Reads the pieces of a structured grid that an index (`.pvts`) names, some of them at a time, and planes of
//! the grid.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::array::Array;
use super::extent::{Extent, Part, check_cover};
use super::pieces::{self, ArrayKey, ArraysSeen, element_of, to_fields};
use super::vts;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, Geometry};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::scene::Values;

/// The files of a grid, each with pieces of it.
#[derive(Debug)]
pub(crate) struct VtsPieces {
    path: PathBuf,
    whole: Extent,
    /// Files in the index's order, each with its length in bytes.
    files: Vec<(PathBuf, u64)>,
}

/// Some of the pieces.
#[derive(Debug)]
pub(crate) struct SomeBlocks {
    parts: Vec<Part<Vec<DVec3>>>,
    /// Arrays that the pieces have, of nodes and of cells.
    pub(crate) seen: [ArraysSeen; 2],
}

/// A piece's part of some planes.
#[derive(Debug)]
pub(crate) struct BlockPlanes {
    /// The first and the last node along each axis.
    pub(crate) extent: [[i64; 3]; 2],
    pub(crate) nodes: Vec<DVec3>,
    /// The components of the arrays of nodes, then of those of cells, in order.
    pub(crate) values: Vec<Values>,
}

impl VtsPieces {
    /// Opens an index and looks for the files that it names; `None` for any other file.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open) for an index; a piece's missing file.
    pub(crate) fn open(path: &Path) -> Result<Option<Self>> {
        pieces::in_index(path, vts::KIND, |input, element| {
            Ok(Self {
                path: path.to_path_buf(),
                whole: Extent::whole(path, element)?,
                files: pieces::sources_with_lengths(input, element)?,
            })
        })
    }

    /// Path of the index.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Number of nodes along i, j and k.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.whole.dims(Association::Nodes)
    }

    /// The lengths of the files, in bytes.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = u64> {
        self.files.iter().map(|(_, length)| *length)
    }

    /// Reads the pieces of some of the files.
    ///
    /// # Errors
    /// The errors of [`open`](crate::io::open).
    pub(crate) fn read(&self, files: Range<usize>) -> Result<SomeBlocks> {
        let input = Input::of_file(&self.path);
        let files = self.files[files].iter().map(|(file, _)| file);
        let parts = pieces::read_files(input, files, vts::KIND, |piece| {
            vts::read_part(&self.whole, piece)
        })?;
        let seen = Association::BOTH.map(|association| {
            let with_any = parts.iter().filter(|part| part.has_any(association));
            let arrays: Vec<&[Array]> = with_any.map(|part| part.arrays(association)).collect();
            ArraysSeen::of(&arrays)
        });
        Ok(SomeBlocks { parts, seen })
    }

    /// Joins planes of nodes of constant k, with the cells between them.
    ///
    /// - `blocks`: the planes' parts in all pieces, in the order of the pieces.
    /// - `arrays`: arrays of nodes and of cells in the blocks.
    /// - `has_cells`: whether all pieces have an array of cells, so that they must cover the cells too.
    ///
    /// # Errors
    /// Pieces that do not cover the planes.
    pub(crate) fn planes(
        &self,
        planes: &Range<usize>,
        blocks: Vec<BlockPlanes>,
        arrays: [&[ArrayKey]; 2],
        has_cells: bool,
    ) -> Result<Dataset> {
        let slab = self.slab(planes);
        if has_cells {
            let extents = blocks.iter().map(|block| {
                let [first, last] = block.extent;
                Extent { first, last }
            });
            let extents: Vec<Extent> = extents.collect();
            let (cells, element) = (Association::Cells, element_of(Association::Cells));
            check_cover(&self.path, &slab, &extents, cells, element)?;
        }
        let parts = blocks.into_iter().map(|block| {
            let [first, last] = block.extent;
            let mut values = block.values.into_iter();
            let mut named = |keys: &[ArrayKey]| -> Vec<Array> {
                let each = keys.iter().map(|(name, kinds)| Array {
                    name: name.clone(),
                    components: values.by_ref().take(kinds.len()).collect(),
                });
                each.collect()
            };
            let [of_nodes, of_cells] = arrays.map(&mut named);
            Part::of(Extent { first, last }, block.nodes, of_nodes, of_cells)
        });
        let (nodes, fields, _) = vts::joined(&self.path, &slab, parts.collect())?;
        let dims = slab.dims(Association::Nodes);
        let blocks = vec![CurvilinearBlock { dims, nodes }];
        let geometry = Geometry::Curvilinear { blocks };
        Ok(Dataset::new(&self.path, vts::FORMAT, geometry, fields))
    }

    fn slab(&self, planes: &Range<usize>) -> Extent {
        let mut slab = self.whole;
        let plane = |n: usize| self.whole.first[2] + i64::try_from(n).unwrap_or(i64::MAX);
        slab.first[2] = plane(planes.start);
        slab.last[2] = plane(planes.end) - 1;
        slab
    }
}

impl SomeBlocks {
    /// Metadata of the fields that all pieces have, without nodes; notes name the other arrays. Each component
    /// has two values: the least and the greatest of these pieces.
    ///
    /// - `all`: arrays of nodes and of cells that all pieces have.
    pub(crate) fn head(&mut self, file: &VtsPieces, all: &[ArraysSeen; 2]) -> Dataset {
        let mut fields = Vec::new();
        let mut notes = Vec::new();
        for (association, seen) in Association::BOTH.into_iter().zip(all) {
            let parts = self.parts.iter_mut();
            parts.for_each(|part| seen.keep(part.arrays_mut(association)));
            notes.extend(seen.note(element_of(association)));
            let mut arrays: Vec<Array> = seen.common().map(Array::none_of).collect();
            for part in &self.parts {
                for (all, own) in arrays.iter_mut().zip(part.arrays(association)) {
                    for (all, own) in all.components.iter_mut().zip(&own.components) {
                        let joined = [&*all, own].map(Values::finite_range);
                        let joined: Vec<f64> = joined.into_iter().flatten().flatten().collect();
                        let joined = Values::F64(joined).finite_range();
                        *all = Values::of_type(own.type_name(), joined.as_ref().map_or(&[], |r| r));
                    }
                }
            }
            fields.extend(to_fields(arrays, association));
        }
        let blocks = Vec::new();
        let geometry = Geometry::Curvilinear { blocks };
        let mut data = Dataset::new(&file.path, vts::FORMAT, geometry, fields);
        data.name_units();
        Dataset { notes, ..data }
    }

    /// Keeps one field and the arrays that hide nodes and cells. Returns the keys of the kept arrays of nodes
    /// and of cells.
    pub(crate) fn keep(&mut self, head: &Dataset, field: &Field) -> [Vec<ArrayKey>; 2] {
        Association::BOTH.map(|association| {
            let is_kept = |name: &str, of: Association| {
                of == association
                    && ((name == field.name && of == field.association)
                        || Blanking::is_told_by(name))
            };
            for part in &mut self.parts {
                let arrays = part.arrays_mut(association);
                arrays.retain(|array| is_kept(&array.name, association));
            }
            let fields = head.fields.iter().cloned();
            let kept = fields.filter(|f| is_kept(&f.name, f.association));
            let arrays = kept.filter_map(Array::of_field);
            let keys: Vec<ArrayKey> = arrays.map(|array| pieces::key(&array)).collect();
            // A piece one node thick has no cells.
            let without = self
                .parts
                .iter_mut()
                .filter(|part| !part.has_any(association));
            for part in without {
                *part.arrays_mut(association) = keys.iter().map(Array::none_of).collect();
            }
            keys
        })
    }

    /// The pieces' parts of some planes.
    pub(crate) fn of_planes(&self, file: &VtsPieces, planes: &Range<usize>) -> Vec<BlockPlanes> {
        let slab = file.slab(planes);
        let of_part = |part: &Part<Vec<DVec3>>| {
            let own = part.extent;
            let mut extent = own;
            extent.first[2] = own.first[2].max(slab.first[2]);
            extent.last[2] = own.last[2].min(slab.last[2]);
            if extent.first[2] > extent.last[2] {
                return None;
            }
            // Planes of constant k lie one after another.
            let run = |association| {
                let [x, y, _] = own.dims(association);
                let skipped = extent.shift_from(&own)[2] * x * y;
                let count = extent.count(association).unwrap_or(0);
                skipped..skipped + count
            };
            let values = Association::BOTH.into_iter().flat_map(|association| {
                let components = part.arrays(association).iter().flat_map(|a| &a.components);
                components.map(move |values| values.part(run(association)))
            });
            Some(BlockPlanes {
                extent: [extent.first, extent.last],
                nodes: part.geometry[run(Association::Nodes)].to_vec(),
                values: values.collect(),
            })
        };
        self.parts.iter().filter_map(of_part).collect()
    }
}
