//! Reads XDMF 2 and 3 (`.xdmf`, `.xmf`): XML that describes grids, with numbers in it, in HDF5 files or in files of
//! binary numbers beside it.
//!
//! | element | module |
//! |---|---|
//! | `Grid`, `Time`, `Geometry`, `Attribute` | here |
//! | `Topology` | [`topology`] |
//! | `DataItem` | [`item`] |
//! | references and inclusions | [`document`] |
//!
//! All grids of a time are drawn together. Grids that refer to the same `Topology` and `Geometry` are one grid with the
//! attributes of all, as dolfinx writes the mesh and each of its functions.
//!
//! Source: "XDMF Model and Format" of the XDMF project.

mod document;
mod item;
mod topology;

use glam::DVec3;
use roxmltree::{Node, NodeId};

use self::document::{Xml, attribute, is};
use self::item::Items;
use self::topology::Topology;
use super::highest::keep_highest;
use super::zones::{Shape, Zone, joined};
use crate::data::association::Association;
use crate::data::cells::CellMesh;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::io::particles::hdf5::arrays::ShapedArray;
use crate::io::particles::table::list;
use crate::io::time_steps::{self, TimeStep, chosen};
use crate::scene::{Lattice, LatticeSpacing};

/// Greatest number of components of an attribute.
const MOST_COMPONENTS: usize = 16;

/// Most collections within one another.
const MOST_DEPTH: usize = 16;

/// Whether a file that begins with `head` is XDMF.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with('<') && (text.contains("<Xdmf") || text.contains("<!DOCTYPE Xdmf"))
}

/// Reads the grids of one time.
///
/// # Errors
/// Damaged XML; elements of other kinds than those that are read; numbers that are missing or too few.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let text = String::from_utf8_lossy(&bytes);
    let xml = Xml::parse(path, &text)?;
    let items = Items::new(&xml, input, bytes.len());
    let mut file = File {
        items: &items,
        zones: Vec::new(),
        left_out: Vec::new(),
    };
    let times = file.times()?;
    let (step, note) = chosen(path, &times, time_step)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    for grid in file.grids()? {
        file.read(grid, times.get(step).copied(), 0)?;
    }
    if file.zones.is_empty() {
        return Err(xml.fault(xml.domain()?, "a grid of this time", "none"));
    }
    if !file.left_out.is_empty() {
        let names = list(file.left_out.iter().map(String::as_str));
        notes.push(format!(
            "Left out, because they are not numbers at nodes or cells: {names}."
        ));
    }
    let zones = file.zones.into_iter().map(|(_, zone)| zone).collect();
    let mut data = joined(path, "XDMF", zones, &items.budget, read_as)?;
    data.notes.splice(0..0, notes);
    if let Geometry::Cells(mesh) = &mut data.geometry {
        data.notes.extend(keep_highest(mesh, &mut data.fields));
    }
    Ok(data)
}

/// Reads the times of all grids.
///
/// # Errors
/// Damaged XML, or times that are no numbers.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let bytes = input.read_all()?;
    let text = String::from_utf8_lossy(&bytes);
    let xml = Xml::parse(input.path, &text)?;
    let items = Items::new(&xml, input, bytes.len());
    let file = File {
        items: &items,
        zones: Vec::new(),
        left_out: Vec::new(),
    };
    Ok(time_steps::of_file(input.path, &file.times()?))
}

/// Kinds of grids.
enum Kind {
    Uniform,
    Temporal,
    /// Grids that are drawn together.
    Together,
}

/// Elements that a grid's nodes and cells are read from: `Topology` and `Geometry`.
type Source = (NodeId, NodeId);

struct File<'a> {
    items: &'a Items<'a>,
    zones: Vec<(Source, Zone)>,
    /// Attributes that are not read.
    left_out: Vec<String>,
}

impl<'a> File<'a> {
    fn xml(&self) -> &'a Xml<'a> {
        self.items.xml
    }

    /// Returns the grids of the domain.
    fn grids(&self) -> Result<Vec<Node<'a, 'a>>> {
        self.grids_in(self.xml().domain()?)
    }

    fn grids_in(&self, node: Node<'a, 'a>) -> Result<Vec<Node<'a, 'a>>> {
        let children = self.xml().children(node)?;
        Ok(children
            .into_iter()
            .filter(|child| is(*child, "Grid"))
            .collect())
    }

    fn kind(&self, grid: Node<'a, 'a>) -> Result<Kind> {
        let of = attribute(grid, &["CollectionType"]);
        let usual = if of.is_some() {
            "Collection"
        } else {
            "Uniform"
        };
        let kind = attribute(grid, &["GridType", "Type"]).unwrap_or(usual);
        let of = of.unwrap_or("Spatial");
        match kind.to_ascii_lowercase().as_str() {
            "uniform" => Ok(Kind::Uniform),
            "collection" if of.eq_ignore_ascii_case("temporal") => Ok(Kind::Temporal),
            "collection" | "tree" => Ok(Kind::Together),
            _ => {
                Err(self
                    .xml()
                    .fault(grid, "a grid of the type Uniform, Collection or Tree", kind))
            }
        }
    }

    /// Returns the times of all grids, in order.
    fn times(&self) -> Result<Vec<f64>> {
        let mut times = Vec::new();
        for grid in self.grids()? {
            self.add_times(grid, &mut times, 0)?;
        }
        times.sort_by(f64::total_cmp);
        times.dedup();
        Ok(times)
    }

    fn add_times(&self, grid: Node<'a, 'a>, times: &mut Vec<f64>, depth: usize) -> Result<()> {
        self.check_depth(grid, depth)?;
        match self.kind(grid)? {
            Kind::Uniform => times.extend(self.time(grid)?),
            Kind::Temporal => times.extend(self.members(grid)?.into_iter().map(|(time, _)| time)),
            Kind::Together => {
                let own = self.time(grid)?;
                times.extend(own);
                for child in self.grids_in(grid)?.into_iter().filter(|_| own.is_none()) {
                    self.add_times(child, times, depth + 1)?;
                }
            }
        }
        Ok(())
    }

    fn check_depth(&self, grid: Node<'a, 'a>, depth: usize) -> Result<()> {
        match depth < MOST_DEPTH {
            true => Ok(()),
            false => Err(self
                .xml()
                .fault(grid, "collections at most 16 deep", "more")),
        }
    }

    /// Returns the grids of a temporal collection with their times: their own, those of the collection, or their
    /// indices.
    fn members(&self, collection: Node<'a, 'a>) -> Result<Vec<(f64, Node<'a, 'a>)>> {
        let grids = self.grids_in(collection)?;
        let stated = self.times_of(collection, grids.len())?;
        let mut members = Vec::new();
        for (i, grid) in grids.into_iter().enumerate() {
            let own = self.time(grid)?.or_else(|| stated.get(i).copied());
            // Several blocks of a step may each state the time.
            let within = || grid.descendants().find(|node| is(*node, "Time"));
            let time = match own.is_none().then(within).flatten() {
                Some(time) => self.value(time)?,
                None => own,
            };
            members.push((time.unwrap_or(i as f64), grid));
        }
        Ok(members)
    }

    /// Returns the time that a grid states for itself.
    fn time(&self, grid: Node<'a, 'a>) -> Result<Option<f64>> {
        let Some(time) = grid.children().find(|child| is(*child, "Time")) else {
            return Ok(None);
        };
        self.value(time)
    }

    /// Returns the value of a `Time`.
    fn value(&self, time: Node<'a, 'a>) -> Result<Option<f64>> {
        match attribute(time, &["Value"]) {
            Some(value) => {
                let number = value
                    .parse()
                    .map_err(|_| self.xml().fault(time, "a number", value));
                number.map(Some)
            }
            None => Ok(None),
        }
    }

    /// Returns the times that a collection states for its grids.
    fn times_of(&self, collection: Node<'a, 'a>, count: usize) -> Result<Vec<f64>> {
        let Some(time) = collection.children().find(|child| is(*child, "Time")) else {
            return Ok(Vec::new());
        };
        let kind = attribute(time, &["TimeType", "Type"]).unwrap_or("Single");
        if kind.eq_ignore_ascii_case("single") {
            return Ok(Vec::new());
        }
        let array = self.items.only(time)?;
        let stated = array.numbers(0, 1);
        match (kind.to_ascii_lowercase().as_str(), stated.as_slice()) {
            ("list", _) => Ok(stated),
            ("hyperslab", [start, stride, ..]) => {
                Ok((0..count).map(|i| start + stride * i as f64).collect())
            }
            ("range", [first, last, ..]) => {
                let step = (last - first) / (count.max(2) - 1) as f64;
                Ok((0..count).map(|i| first + step * i as f64).collect())
            }
            _ => Err(self
                .xml()
                .fault(time, "times of the type List, HyperSlab or Range", kind)),
        }
    }

    /// Reads the uniform grids of a grid.
    ///
    /// - `time`: the time that is wanted, until a collection has chosen it.
    fn read(&mut self, grid: Node<'a, 'a>, time: Option<f64>, depth: usize) -> Result<()> {
        self.check_depth(grid, depth)?;
        // Times are compared as they were read.
        let is_other = |own: Option<f64>| {
            time.is_some_and(|time| own.is_some_and(|own| own.total_cmp(&time).is_ne()))
        };
        match self.kind(grid)? {
            Kind::Temporal => {
                let members = self.members(grid)?;
                let wanted = members.into_iter().find(|(own, _)| !is_other(Some(*own)));
                match wanted {
                    Some((_, grid)) => self.read(grid, None, depth + 1),
                    None => Ok(()),
                }
            }
            _ if is_other(self.time(grid)?) => Ok(()),
            Kind::Together => {
                let time = if self.time(grid)?.is_some() {
                    None
                } else {
                    time
                };
                let grids = self.grids_in(grid)?;
                grids
                    .into_iter()
                    .try_for_each(|grid| self.read(grid, time, depth + 1))
            }
            Kind::Uniform => self.read_uniform(grid),
        }
    }

    fn read_uniform(&mut self, grid: Node<'a, 'a>) -> Result<()> {
        let children = self.xml().children(grid)?;
        let only = |name: &str| {
            let found = children.iter().find(|child| is(**child, name)).copied();
            found.ok_or_else(|| self.xml().fault(grid, format!("a `{name}` in it"), "none"))
        };
        let (topology, geometry) = (only("Topology")?, only("Geometry")?);
        let source = (topology.id(), geometry.id());
        let known = self.zones.iter().position(|(own, _)| *own == source);
        let at = match known {
            Some(at) => at,
            None => {
                let shape = self.shape(topology, geometry)?;
                let fields = Vec::new();
                self.zones.push((source, Zone { shape, fields }));
                self.zones.len() - 1
            }
        };
        for child in children.into_iter().filter(|child| is(*child, "Attribute")) {
            if let Some(field) = self.field(child, at)? {
                let fields = &mut self.zones[at].1.fields;
                let is_same =
                    |own: &Field| own.name == field.name && own.association == field.association;
                if !fields.iter().any(is_same) {
                    fields.push(field);
                }
            }
        }
        Ok(())
    }

    fn field(&mut self, node: Node<'a, 'a>, zone: usize) -> Result<Option<Field>> {
        let xml = self.xml();
        let name = attribute(node, &["Name"]).unwrap_or("attribute");
        let name: String = name.chars().take(120).collect();
        let centre = attribute(node, &["Center"]).unwrap_or("Node");
        let association = match centre.to_ascii_lowercase().as_str() {
            "node" => Association::Nodes,
            "cell" => Association::Cells,
            _ => {
                self.left_out.push(name);
                return Ok(None);
            }
        };
        let kind = attribute(node, &["ItemType"]).unwrap_or("Uniform");
        if kind.eq_ignore_ascii_case("FiniteElementFunction") {
            self.left_out.push(name);
            return Ok(None);
        }
        let array = self.items.only(node)?;
        let count = self.zones[zone].1.shape.count_of(association);
        let has = array.bytes.len() / array.encoding.scalar.size();
        let components = has / count.max(1);
        let kind = attribute(node, &["AttributeType", "Type"]).unwrap_or_default();
        let is_scalar = kind.eq_ignore_ascii_case("scalar");
        if components == 0 || components * count != has || is_scalar && components > 1 {
            let what = if is_scalar { "a number" } else { "numbers" };
            let expected = format!("{what} for each of {count} {}", association.name());
            return Err(xml.fault(node, expected, format!("{has} numbers")));
        }
        if components > MOST_COMPONENTS {
            self.left_out.push(name);
            return Ok(None);
        }
        let mut values: Vec<_> = (0..components)
            .map(|i| array.values(i, components))
            .collect();
        Ok(Some(Field {
            name,
            association,
            source: match components {
                1 => FieldSource::Scalar(values.remove(0)),
                _ => FieldSource::Vector(values),
            },
            unit: None,
        }))
    }

    fn shape(&self, topology: Node<'a, 'a>, geometry: Node<'a, 'a>) -> Result<Shape> {
        let xml = self.xml();
        let name = attribute(topology, &["TopologyType", "Type"]).unwrap_or_default();
        let Some(kind) = topology::of(name) else {
            let expected = "a `TopologyType` that is read: Triangle, Mixed, 3DSMesh and the like";
            return Err(xml.fault(topology, expected, name));
        };
        let places = attribute(geometry, &["GeometryType", "Type"]).unwrap_or("XYZ");
        let places = places.to_ascii_uppercase();
        if let Topology::One(..) | Topology::Mixed = kind {
            let nodes = self.nodes(geometry, &places)?;
            let mesh = self.cells(topology, &kind, nodes)?;
            mesh.check(xml.path)?;
            return Ok(Shape::Cells(mesh));
        }
        let dims = attribute(topology, &["Dimensions", "NumberOfElements"]);
        let dims = dims.unwrap_or_default();
        let axes: Option<Vec<usize>> = dims
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|n| !n.is_empty())
            .map(|n| n.parse().ok())
            .collect();
        // Counts are at least one, and the slowest axis comes first.
        let axes = axes.filter(|axes| !axes.contains(&0));
        let dims = match axes.as_deref() {
            Some([z, y, x]) => [*x, *y, *z],
            Some([y, x]) => [*x, *y, 1],
            _ => {
                return Err(xml.fault(
                    topology,
                    "`Dimensions`: nodes along two or three axes",
                    dims,
                ));
            }
        };
        let count = dims.iter().try_fold(1_usize, |n, &m| n.checked_mul(m));
        let count = count.ok_or_else(|| xml.fault(topology, "fewer nodes", format!("{dims:?}")))?;
        match (kind, places.as_str()) {
            (_, "ORIGIN_DXDYDZ" | "ORIGIN_DXDY") => self.uniform(geometry, dims, count),
            (_, "VXVYVZ" | "VXVY") => self.rectilinear(geometry, dims, count),
            _ => {
                let nodes = self.nodes(geometry, &places)?;
                if nodes.len() != count {
                    let expected = format!("{count} nodes, as the `Topology` has");
                    return Err(xml.fault(geometry, expected, nodes.len().to_string()));
                }
                Ok(Shape::Block(CurvilinearBlock { dims, nodes }))
            }
        }
    }

    /// Checks that values of a grid, of which the file may hold none, fit into the budget.
    fn check_count(&self, geometry: Node<'a, 'a>, count: usize) -> Result<()> {
        // A lattice takes no memory for its nodes, but what is drawn of it does.
        self.items.budget.spend(Xml::place(geometry), count, 1)
    }

    fn uniform(&self, geometry: Node<'a, 'a>, dims: [usize; 3], count: usize) -> Result<Shape> {
        self.check_count(geometry, count)?;
        let items = self.items.of(geometry)?;
        let mut stated = Vec::new();
        for item in items {
            stated.push(self.items.read(item, 0)?.numbers(0, 1));
        }
        // Both name the slowest axis first.
        let turned = |numbers: &[f64], absent: f64| match numbers {
            [z, y, x] => Some(DVec3::new(*x, *y, *z)),
            [y, x] => Some(DVec3::new(*x, *y, absent)),
            _ => None,
        };
        let found = match stated.as_slice() {
            [origin, steps] => turned(origin, 0.0).zip(turned(steps, 1.0)),
            _ => None,
        };
        let (origin, step) = found.ok_or_else(|| {
            let expected = "two items: the origin, and the steps along each axis";
            self.xml()
                .fault(geometry, expected, format!("{} items", stated.len()))
        })?;
        let lattice = Lattice::uniform(dims, origin, step);
        if dims.contains(&1) || lattice.validate().is_err() {
            self.items.budget.spend(Xml::place(geometry), count, 24)?;
            return Ok(Shape::Block(block(dims, count, |[i, j, k]| {
                origin + step * DVec3::new(i as f64, j as f64, k as f64)
            })));
        }
        Ok(Shape::Lattice(lattice))
    }

    fn rectilinear(&self, geometry: Node<'a, 'a>, dims: [usize; 3], count: usize) -> Result<Shape> {
        self.check_count(geometry, count)?;
        let mut axes = Vec::new();
        for item in self.items.of(geometry)? {
            axes.push(self.items.read(item, 0)?.numbers(0, 1));
        }
        if axes.len() == 2 && dims[2] == 1 {
            axes.push(vec![0.0]);
        }
        let lengths: Vec<usize> = axes.iter().map(Vec::len).collect();
        if lengths != dims {
            let expected = format!("coordinates of {dims:?} nodes along x, y and z");
            return Err(self.xml().fault(geometry, expected, format!("{lengths:?}")));
        }
        let rises = |axis: &Vec<f64>| {
            axis.iter().all(|x| x.is_finite()) && axis.windows(2).all(|w| w[0] < w[1])
        };
        if dims.contains(&1) || !axes.iter().all(rises) {
            self.items.budget.spend(Xml::place(geometry), count, 24)?;
            return Ok(Shape::Block(block(dims, count, |[i, j, k]| {
                DVec3::new(axes[0][i], axes[1][j], axes[2][k])
            })));
        }
        let mut axes = axes.into_iter();
        let mut next = || axes.next().unwrap_or_default();
        Ok(Shape::Lattice(Lattice {
            dims,
            spacing: LatticeSpacing::Rectilinear {
                coordinates: [next(), next(), next()],
            },
        }))
    }

    /// Reads positions one by one.
    fn nodes(&self, geometry: Node<'a, 'a>, places: &str) -> Result<Vec<DVec3>> {
        let xml = self.xml();
        let per_axis = |arrays: Vec<Vec<f64>>| {
            let count = arrays.first().map_or(0, Vec::len);
            if arrays.iter().any(|axis| axis.len() != count) {
                return Err(xml.fault(geometry, "as many numbers of each axis", "others"));
            }
            self.items.budget.spend(Xml::place(geometry), count, 24)?;
            let at = |axis: usize, i: usize| arrays.get(axis).map_or(0.0, |numbers| numbers[i]);
            Ok((0..count)
                .map(|i| DVec3::new(at(0, i), at(1, i), at(2, i)))
                .collect())
        };
        let together = |array: &ShapedArray, axes: usize| {
            let count = array.bytes.len() / array.encoding.scalar.size();
            if !count.is_multiple_of(axes) {
                let expected = format!("{axes} numbers of each node");
                return Err(xml.fault(geometry, expected, format!("{count} in all")));
            }
            self.items.budget.spend(Xml::place(geometry), count, 8)?;
            per_axis((0..axes).map(|axis| array.numbers(axis, axes)).collect())
        };
        match places {
            "XYZ" => together(&self.items.only(geometry)?, 3),
            "XY" => together(&self.items.only(geometry)?, 2),
            "X_Y_Z" | "X_Y" => {
                let mut axes = Vec::new();
                for item in self.items.of(geometry)? {
                    axes.push(self.items.read(item, 0)?.numbers(0, 1));
                }
                if axes.len() != places.len().div_ceil(2) {
                    let expected = "an item for each axis";
                    return Err(xml.fault(geometry, expected, axes.len().to_string()));
                }
                per_axis(axes)
            }
            _ => {
                let expected = "a `GeometryType` that fits the `Topology`: XYZ, XY, X_Y_Z, VXVYVZ or ORIGIN_DXDYDZ";
                Err(xml.fault(geometry, expected, places))
            }
        }
    }

    fn cells(
        &self,
        topology: Node<'a, 'a>,
        kind: &Topology,
        nodes: Vec<DVec3>,
    ) -> Result<CellMesh> {
        let xml = self.xml();
        let stated = |names: &[&str]| match attribute(topology, names) {
            None => Ok(None),
            Some(text) => {
                let number = text.parse::<i64>();
                number
                    .map(Some)
                    .map_err(|_| xml.fault(topology, format!("`{}`, a number", names[0]), text))
            }
        };
        let node_count = nodes.len();
        let mut mesh = CellMesh {
            nodes,
            offsets: vec![0],
            ..CellMesh::default()
        };
        let offset = stated(&["BaseOffset"])?.unwrap_or(0);
        let order = attribute(topology, &["Order"]).unwrap_or_default();
        let mut wanted = 0..;
        let is_plain = order
            .split_whitespace()
            .all(|n| n.parse() == Ok(wanted.next().unwrap_or(0)));
        if !is_plain {
            return Err(xml.fault(topology, "nodes in their usual order (no `Order`)", order));
        }
        let node = |number: i64| {
            let index = number.checked_sub(offset);
            let index = index.filter(|&i| usize::try_from(i).is_ok_and(|i| i < node_count));
            index.and_then(|i| u32::try_from(i).ok()).ok_or_else(|| {
                xml.fault(
                    topology,
                    format!("nodes among {node_count}"),
                    number.to_string(),
                )
            })
        };
        let has_numbers = !self.items.of(topology)?.is_empty();
        let element_count = stated(&["NumberOfElements", "Dimensions"]);
        let numbers = match (has_numbers, kind) {
            (true, _) => self.items.integers(topology, &self.items.only(topology)?)?,
            // Without numbers, elements have the nodes one after another.
            (false, Topology::One(_, per)) => {
                let per = self.per_element(topology, *per)?;
                let count = element_count?.and_then(|n| usize::try_from(n).ok());
                let count = count.unwrap_or(node_count / per).checked_mul(per);
                let count = count.filter(|&n| n <= node_count);
                let count =
                    count.ok_or_else(|| xml.fault(topology, "a `DataItem` in it", "none"))?;
                (0..count).map(|i| i as i64 + offset).collect()
            }
            (false, _) => return Err(xml.fault(topology, "a `DataItem` in it", "none")),
        };
        match *kind {
            Topology::One(cell, per) => {
                let per = self.per_element(topology, per)?;
                if !numbers.len().is_multiple_of(per) {
                    let expected = format!("{per} nodes of each element");
                    return Err(xml.fault(topology, expected, format!("{} in all", numbers.len())));
                }
                self.items
                    .budget
                    .spend(Xml::place(topology), numbers.len(), 4)?;
                self.items
                    .budget
                    .spend(Xml::place(topology), numbers.len() / per, 5)?;
                topology::of_one_kind(xml.path, &mut mesh, cell, per, &numbers, &node)?;
            }
            _ => {
                let fault = |expected: &str, found: String| xml.fault(topology, expected, found);
                self.items
                    .budget
                    .spend(Xml::place(topology), numbers.len(), 9)?;
                topology::mixed(xml.path, &mut mesh, &numbers, &node, &fault)?;
            }
        }
        // A list of several kinds states how many elements it has.
        let count = stated(&["NumberOfElements"])?;
        if let Some(count) = count.filter(|_| matches!(kind, Topology::Mixed))
            && usize::try_from(count) != Ok(mesh.cell_count())
        {
            let expected = format!("{count} elements, as `NumberOfElements` says");
            return Err(xml.fault(topology, expected, mesh.cell_count().to_string()));
        }
        Ok(mesh)
    }

    /// Returns the number of nodes of each element.
    fn per_element(&self, topology: Node<'a, 'a>, of_kind: usize) -> Result<usize> {
        let stated = attribute(topology, &["NodesPerElement"]);
        let number = match (stated, of_kind) {
            (_, 1..) => Some(of_kind),
            (None, _) => Some(1),
            (Some(text), _) => text.parse().ok().filter(|&n: &usize| n > 0),
        };
        number.ok_or_else(|| {
            let found = stated.unwrap_or_default();
            self.xml()
                .fault(topology, "`NodesPerElement`, a count", found)
        })
    }
}

/// Makes a block of nodes, x fastest.
fn block(dims: [usize; 3], count: usize, at: impl Fn([usize; 3]) -> DVec3) -> CurvilinearBlock {
    let [x, y, _] = dims;
    let nodes = (0..count)
        .map(|n| at([n % x, n / x % y, n / (x * y)]))
        .collect();
    CurvilinearBlock { dims, nodes }
}
