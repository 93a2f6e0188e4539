//! Reads nodes, elements and the groups that elements belong to.
//!
//! | version | a node | an element |
//! |---|---|---|
//! | 2 | number, x, y, z | number, type, count of tags, tags (physical group, entity, count of partitions, partitions), nodes |
//! | 4.0 | in blocks of an entity: number, x, y, z and parameters | in blocks of an entity and a type: number, nodes |
//! | 4.1 | in blocks of an entity: all numbers, then x, y, z and parameters of each | as 4.0 |
//!
//! Binary elements of version 2 stand in blocks with a type, a count and a count of tags. In version 4 the sections
//! `$Entities` and `$PartitionedEntities` state the physical groups.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::elements::{Element, element};
use super::stream::Stream;
use crate::data::cells::CellMesh;
use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// Version of the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Version {
    Two,
    Four,
    FourOne,
}

/// An entity of the model: the dimensions and the number.
type EntityKey = (i64, i64);

/// Groups and partition of the elements on an entity.
#[derive(Debug, Clone, Copy, Default)]
struct Entity {
    physical: i32,
    /// The entity itself, or the one that was partitioned.
    own: i32,
    partition: i32,
}

/// Nodes, elements and groups.
#[derive(Default)]
pub(super) struct Mesh {
    pub(super) cells: CellMesh,
    /// Indices of nodes by their numbers.
    nodes: HashMap<u64, u32>,
    /// Whether each node's number is its index and one.
    are_in_order: bool,
    /// Number of each element.
    pub(super) numbers: Vec<u64>,
    /// Type of each element.
    pub(super) types: Vec<u8>,
    pub(super) physical: Vec<i32>,
    pub(super) entities: Vec<i32>,
    pub(super) partitions: Vec<i32>,
    groups: HashMap<EntityKey, Entity>,
    /// Dimensions, number and name of physical groups.
    pub(super) names: Vec<(i64, i64, String)>,
    /// Number of elements of types that are left out, because they have no nodes of their own.
    pub(super) left_out: usize,
    /// Number of elements of which only the corners are taken.
    pub(super) cut: usize,
    /// First run of elements of each type on each entity: their physical group and their indices.
    first_runs: HashMap<(u8, i32), (i32, Range<usize>)>,
    /// Nodes of the elements of a type on an entity that has several physical groups.
    listed: HashMap<(u8, i32), HashSet<Vec<u32>>>,
    /// Number of elements that are left out, because they are listed for another physical group.
    pub(super) again: usize,
}

impl Mesh {
    pub(super) fn new() -> Self {
        Self {
            cells: CellMesh {
                offsets: vec![0],
                ..CellMesh::default()
            },
            are_in_order: true,
            ..Self::default()
        }
    }

    /// Returns the index of a node.
    pub(super) fn node(&self, number: u64) -> Option<u32> {
        if self.are_in_order {
            let index = u32::try_from(number.checked_sub(1)?).ok()?;
            return ((index as usize) < self.cells.nodes.len()).then_some(index);
        }
        self.nodes.get(&number).copied()
    }

    fn add_node(&mut self, stream: &Stream<'_>, number: u64, at: glam::DVec3) -> Result<()> {
        let index = self.cells.nodes.len();
        let Ok(small) = u32::try_from(index) else {
            let expected = format!("at most {} nodes", u32::MAX);
            let advice = "save the partitions in several files";
            return Err(Error::format(
                stream.path,
                "nodes",
                expected,
                "more",
                advice,
            ));
        };
        if self.are_in_order && number != index as u64 + 1 {
            self.are_in_order = false;
            self.nodes = (0..small).map(|i| (u64::from(i) + 1, i)).collect();
        }
        if !self.are_in_order && self.nodes.insert(number, small).is_some() {
            return Err(stream.fault("each node once", &format!("node {number} again")));
        }
        self.cells.nodes.push(at);
        Ok(())
    }

    pub(super) fn read_names(&mut self, stream: &mut Stream<'_>) -> Result<()> {
        let expected = "a physical group: its dimensions, its number and its name";
        let count = stream.header_count("the number of physical groups")?;
        for _ in 0..count {
            let line = stream.header(expected)?;
            let fault = || stream.fault(expected, &line);
            let (numbers, name) = line.split_once('"').ok_or_else(fault)?;
            let mut numbers = numbers.split_whitespace().map(str::parse);
            let (Some(Ok(dimension)), Some(Ok(number))) = (numbers.next(), numbers.next()) else {
                return Err(fault());
            };
            let name = clip(name.trim_end_matches('"'));
            self.names.push((dimension, number, name));
        }
        Ok(())
    }

    pub(super) fn read_nodes(
        &mut self,
        stream: &mut Stream<'_>,
        version: Version,
        are_parametric: bool,
    ) -> Result<()> {
        let number = "the number of a node";
        if version == Version::Two {
            let count = stream.header_count("the number of nodes")?;
            for _ in 0..count {
                let tag = stream.int(number)?;
                let at = stream.point()?;
                if are_parametric {
                    let dimension = stream.int("the dimensions of an entity")?;
                    stream.int("the number of an entity")?;
                    let parameters = if matches!(dimension, 1 | 2) {
                        dimension
                    } else {
                        0
                    };
                    for _ in 0..parameters {
                        stream.double("a parameter of a node")?;
                    }
                }
                let tag = u64::try_from(tag).map_err(|_| stream.fault(number, &tag.to_string()))?;
                self.add_node(stream, tag, at)?;
            }
            return Ok(());
        }
        let counts = "counts of blocks and nodes";
        let block_count = stream.size(counts)?;
        stream.size(counts)?;
        if version == Version::FourOne {
            stream.size("the least number of a node")?;
            stream.size("the greatest number of a node")?;
        }
        for _ in 0..block_count {
            let entity = [
                stream.int("the entity of a block")?,
                stream.int("the entity of a block")?,
            ];
            // Version 4.0 has the entity's number first.
            let dimension = if version == Version::FourOne {
                entity[0]
            } else {
                entity[1]
            };
            let is_parametric = stream.int("whether nodes have parameters")? != 0;
            let parameters = if is_parametric {
                dimension.clamp(0, 3)
            } else {
                0
            };
            let count = stream.size("the number of nodes in a block")?;
            let mut tags = Vec::new();
            if version == Version::FourOne {
                for _ in 0..count {
                    tags.push(stream.size(number)?);
                }
            }
            for i in 0..count {
                let tag = match usize::try_from(i).ok().and_then(|i| tags.get(i)) {
                    Some(&tag) => tag,
                    // Version 4.0 has integers here.
                    None => {
                        let tag = stream.int(number)?;
                        u64::try_from(tag).map_err(|_| stream.fault(number, &tag.to_string()))?
                    }
                };
                let at = stream.point()?;
                for _ in 0..parameters {
                    stream.double("a parameter of a node")?;
                }
                self.add_node(stream, tag, at)?;
            }
        }
        Ok(())
    }

    /// Reads the physical groups of entities, of which some may be parts of others.
    pub(super) fn read_entities(
        &mut self,
        stream: &mut Stream<'_>,
        version: Version,
        are_partitioned: bool,
    ) -> Result<()> {
        const WHAT: &str = "an entity, as the section's counts say";
        // Version 4.0 has integers where 4.1 has counts of their own length.
        let small = |stream: &mut Stream<'_>| match version {
            Version::FourOne => stream.size(WHAT),
            _ => stream.int(WHAT).map(|n| u64::try_from(n).unwrap_or(0)),
        };
        if are_partitioned {
            stream.size(WHAT)?;
            let ghosts = stream.size(WHAT)?;
            stream.skip_ints(ghosts.saturating_mul(2), WHAT)?;
        }
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = stream.size(WHAT)?;
        }
        for (dimension, count) in (0..).zip(counts) {
            for _ in 0..count {
                let tag = stream.int(WHAT)?;
                let mut entity = Entity {
                    own: shortened(tag),
                    ..Entity::default()
                };
                if are_partitioned {
                    let parent_dimension = stream.int(WHAT)?;
                    let parent = stream.int(WHAT)?;
                    if parent_dimension == dimension {
                        entity.own = shortened(parent);
                    }
                    let partition_count = small(stream)?;
                    for i in 0..partition_count {
                        let partition = stream.int(WHAT)?;
                        if i == 0 {
                            entity.partition = shortened(partition);
                        }
                    }
                }
                let is_point = dimension == 0 && version == Version::FourOne;
                for _ in 0..if is_point { 3 } else { 6 } {
                    stream.double(WHAT)?;
                }
                let physical_count = stream.size(WHAT)?;
                for i in 0..physical_count {
                    let physical = stream.int(WHAT)?;
                    if i == 0 {
                        // The sign is the orientation.
                        entity.physical = shortened(physical.saturating_abs());
                    }
                }
                if dimension > 0 {
                    let bounding = stream.size(WHAT)?;
                    stream.skip_ints(bounding, WHAT)?;
                }
                self.groups.insert((dimension, tag), entity);
            }
        }
        Ok(())
    }

    pub(super) fn read_elements(
        &mut self,
        stream: &mut Stream<'_>,
        version: Version,
    ) -> Result<()> {
        match (version, stream.is_text) {
            (Version::Two, true) => self.read_lines(stream),
            (Version::Two, false) => self.read_blocks_of_two(stream),
            _ => self.read_blocks_of_four(stream, version),
        }
    }

    fn read_lines(&mut self, stream: &mut Stream<'_>) -> Result<()> {
        let count = stream.header_count("the number of elements")?;
        let expected = "an element: its number, type and tags, and as many nodes as its type has";
        let mut line = Vec::new();
        for _ in 0..count {
            let text = stream.header(expected)?;
            line.clear();
            for word in text.split_ascii_whitespace() {
                let number = word.parse::<i64>();
                line.push(number.map_err(|_| stream.fault(expected, word))?);
            }
            let fault = || stream.fault(expected, &text);
            let [number, kind, tag_count, rest @ ..] = line.as_slice() else {
                return Err(fault());
            };
            let tag_count = usize::try_from(*tag_count).map_err(|_| fault())?;
            let (tags, nodes) = rest.split_at_checked(tag_count).ok_or_else(fault)?;
            let Some(element) = element(*kind) else {
                self.left_out += 1;
                continue;
            };
            if nodes.len() != element.node_count {
                return Err(fault());
            }
            let nodes: Option<Vec<u64>> = nodes.iter().map(|&n| u64::try_from(n).ok()).collect();
            let nodes = nodes.ok_or_else(fault)?;
            let entity = of_tags(tags);
            let number = u64::try_from(*number).map_err(|_| fault())?;
            self.add(stream, (number, *kind, element), &nodes, entity)?;
        }
        Ok(())
    }

    fn read_blocks_of_two(&mut self, stream: &mut Stream<'_>) -> Result<()> {
        let count = stream.header_count("the number of elements")?;
        let count = u64::try_from(count).unwrap_or(0);
        let expected = "a block of elements: their type, their number and their count of tags";
        let mut done = 0;
        while done < count {
            let kind = stream.int(expected)?;
            let in_block = u64::try_from(stream.int(expected)?).unwrap_or(0);
            let tag_count = stream.int(expected)?;
            let Some(element) = element(kind) else {
                return Err(stream.fault("a type of elements that has nodes", &kind.to_string()));
            };
            if in_block == 0 || in_block > count - done {
                let expected = format!("{} elements or fewer", count - done);
                return Err(stream.fault(&expected, &in_block.to_string()));
            }
            let what = "an element";
            for _ in 0..in_block {
                let number = u64::try_from(stream.int(what)?).unwrap_or(0);
                let mut tags = Vec::new();
                for _ in 0..tag_count {
                    tags.push(stream.int(what)?);
                }
                let mut nodes = Vec::with_capacity(element.node_count);
                for _ in 0..element.node_count {
                    nodes.push(u64::try_from(stream.int(what)?).unwrap_or(0));
                }
                self.add(stream, (number, kind, element), &nodes, of_tags(&tags))?;
            }
            done += in_block;
        }
        // A line break may follow, and the end of the section.
        Ok(())
    }

    fn read_blocks_of_four(&mut self, stream: &mut Stream<'_>, version: Version) -> Result<()> {
        let counts = "counts of blocks and elements";
        let block_count = stream.size(counts)?;
        stream.size(counts)?;
        if version == Version::FourOne {
            stream.size("the least number of an element")?;
            stream.size("the greatest number of an element")?;
        }
        let what = "an element: its number and its nodes";
        for _ in 0..block_count {
            let entity = [
                stream.int("the entity of a block")?,
                stream.int("the entity of a block")?,
            ];
            let (dimension, tag) = match version {
                Version::FourOne => (entity[0], entity[1]),
                _ => (entity[1], entity[0]),
            };
            let kind = stream.int("a type of elements")?;
            let count = stream.size("the number of elements in a block")?;
            let Some(element) = element(kind) else {
                return Err(stream.fault("a type of elements that has nodes", &kind.to_string()));
            };
            let plain = Entity {
                own: shortened(tag),
                ..Entity::default()
            };
            let entity = self.groups.get(&(dimension, tag)).copied().unwrap_or(plain);
            let mut nodes = vec![0; element.node_count];
            let number = |stream: &mut Stream<'_>| match version {
                Version::FourOne => stream.size(what),
                // Version 4.0 has integers here.
                _ => stream.int(what).map(|n| u64::try_from(n).unwrap_or(0)),
            };
            for _ in 0..count {
                let own = number(stream)?;
                for node in &mut nodes {
                    *node = number(stream)?;
                }
                self.add(stream, (own, kind, element), &nodes, entity)?;
            }
        }
        Ok(())
    }

    fn add(
        &mut self,
        stream: &Stream<'_>,
        (number, kind, element): (u64, i64, Element),
        nodes: &[u64],
        entity: Entity,
    ) -> Result<()> {
        let first = self.cells.connectivity.len();
        for i in 0..element.taken {
            let place = element.order.map_or(i, |order| usize::from(order[i]));
            let node = self.node(nodes[place]);
            let node = node.ok_or_else(|| {
                let count = self.cells.nodes.len();
                let expected = format!("nodes among the {count} before the elements");
                stream.fault(&expected, &format!("node {}", nodes[place]))
            })?;
            self.cells.connectivity.push(node);
        }
        let end = u32::try_from(self.cells.connectivity.len()).map_err(|_| {
            let expected = format!("at most {} nodes of elements", u32::MAX);
            let advice = "save the partitions in several files";
            Error::format(stream.path, "elements", expected, "more", advice)
        })?;
        let kind = u8::try_from(kind).unwrap_or(0);
        if self.is_listed((kind, entity), first) {
            self.cells.connectivity.truncate(first);
            self.again += 1;
            return Ok(());
        }
        self.cells.offsets.push(end);
        self.cells.kinds.push(element.kind);
        self.cut += usize::from(element.is_cut);
        self.numbers.push(number);
        self.types.push(kind);
        self.physical.push(entity.physical);
        self.entities.push(entity.own);
        self.partitions.push(entity.partition);
        Ok(())
    }
}

impl Mesh {
    /// Returns whether an element is there already: version 2 lists the elements of an entity for each of its physical groups.
    ///
    /// - `first`: place of its nodes, the last of the connectivity.
    fn is_listed(&mut self, (kind, entity): (u8, Entity), first: usize) -> bool {
        if entity.own == 0 {
            return false;
        }
        let (key, next) = ((kind, entity.own), self.cells.kinds.len());
        let run = self.first_runs.entry(key);
        let (group, run) = run.or_insert_with(|| (entity.physical, next..next));
        if *group == entity.physical {
            if run.end == next {
                run.end += 1;
            }
            // Groups may take turns.
            if let Some(listed) = self.listed.get_mut(&key) {
                listed.insert(self.cells.connectivity[first..].to_vec());
            }
            return false;
        }
        let cells = &self.cells;
        let listed = self.listed.entry(key).or_insert_with(|| {
            let of_run = run.clone().map(|i| cells.cell(i).to_vec());
            of_run.collect()
        });
        !listed.insert(self.cells.connectivity[first..].to_vec())
    }
}

/// Returns the groups and the partition that the tags of version 2 state. Three tags are those of version 2.0.
fn of_tags(tags: &[i64]) -> Entity {
    let tag = |i: usize| tags.get(i).copied().map_or(0, shortened);
    Entity {
        // A negative group turns the element round.
        physical: tag(0).saturating_abs(),
        own: tag(1),
        partition: match tags.len() {
            3 => tag(2),
            _ if tag(2) > 0 => tag(3),
            _ => 0,
        },
    }
}

fn shortened(tag: i64) -> i32 {
    i32::try_from(tag).unwrap_or(0)
}
