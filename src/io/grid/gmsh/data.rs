//! Reads results at nodes, in elements and at the nodes of elements.
//!
//! Each section has a name, a time, the number of a step and a count of components as text, then an entry for each node
//! or element that has a result: its number and its values. Sections of one name and one step belong together.

use std::collections::HashMap;

use super::elements::element;
use super::mesh::Mesh;
use super::stream::Stream;
use crate::data::association::Association;
use crate::data::dataset::{Field, FieldSource};
use crate::error::Result;
use crate::io::grid::budget::Budget;
use crate::scene::Values;

/// Greatest number of components of a result.
const MOST_COMPONENTS: usize = 16;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Place {
    Nodes,
    Elements,
    NodesOfElements,
}

impl Place {
    /// Returns the place of the results in a section of this name.
    pub(super) fn of(section: &str) -> Option<Self> {
        match section {
            "NodeData" => Some(Self::Nodes),
            "ElementData" => Some(Self::Elements),
            "ElementNodeData" => Some(Self::NodesOfElements),
            _ => None,
        }
    }
}

/// A section of results.
#[derive(Debug)]
pub(super) struct Section {
    pub(super) place: Place,
    pub(super) name: String,
    pub(super) time: f64,
    pub(super) step: i64,
    components: usize,
    count: u64,
    /// Place at which its entries begin.
    at: usize,
}

impl Section {
    /// Returns the name and the place, which sections of one result have in common.
    pub(super) fn result(&self) -> (&str, Place) {
        (&self.name, self.place)
    }

    /// Reads the text before the entries of a section.
    pub(super) fn read(stream: &mut Stream<'_>, place: Place) -> Result<Self> {
        let mut name = String::new();
        for i in 0..stream.header_count("a count of names")? {
            let line = stream.header("a name")?;
            if i == 0 {
                name = line.trim_matches('"').chars().take(120).collect();
            }
        }
        let mut time = 0.0;
        for i in 0..stream.header_count("a count of real numbers")? {
            let line = stream.header("a real number")?;
            if i == 0 {
                time = line.parse().map_err(|_| stream.fault("a time", &line))?;
            }
        }
        let mut numbers = Vec::new();
        for _ in 0..stream.header_count("a count of integers")? {
            numbers.push(stream.header_count("an integer")?);
        }
        let [step, components, count, ..] = numbers[..] else {
            let found = numbers.len().to_string();
            return Err(stream.fault(
                "a step, a count of components and a count of entries",
                &found,
            ));
        };
        let few = usize::try_from(components).ok();
        let few = few.filter(|n| (1..=MOST_COMPONENTS).contains(n));
        Ok(Self {
            place,
            name,
            time,
            step,
            components: few
                .ok_or_else(|| stream.fault("1 to 16 components", &components.to_string()))?,
            count: u64::try_from(count)
                .map_err(|_| stream.fault("a count of entries", &count.to_string()))?,
            at: stream.at,
        })
    }
}

/// The results of one step, field by field.
pub(super) struct Results<'a, 'm> {
    mesh: &'m Mesh,
    budget: &'m Budget<'a>,
    /// Indices of elements by their numbers.
    elements: HashMap<u64, usize>,
    fields: Vec<Building>,
    /// Number of entries of nodes or elements that do not exist.
    pub(super) strays: usize,
}

/// A field with some of its values.
struct Building {
    name: String,
    place: Place,
    components: Vec<Vec<f64>>,
    /// Number of values at each node, of results at nodes of elements.
    uses: Vec<u32>,
}

impl<'a, 'm> Results<'a, 'm> {
    pub(super) fn new(mesh: &'m Mesh, budget: &'m Budget<'a>, sections: &[&Section]) -> Self {
        let of_elements = sections.iter().any(|s| s.place != Place::Nodes);
        let numbers = mesh.numbers.iter().zip(0..).filter(|_| of_elements);
        Self {
            mesh,
            budget,
            elements: numbers.map(|(&number, i)| (number, i)).collect(),
            fields: Vec::new(),
            strays: 0,
        }
    }

    pub(super) fn read(&mut self, mut stream: Stream<'_>, section: &Section) -> Result<()> {
        stream.at = section.at;
        let at = self.field(section)?;
        let place = section.place;
        let mut values = vec![0.0; section.components];
        let what = "an entry: a number and its values";
        for _ in 0..section.count {
            let number = u64::try_from(stream.int(what)?).unwrap_or(0);
            if place != Place::NodesOfElements {
                for value in &mut values {
                    *value = stream.double(what)?;
                }
                let index = match place {
                    Place::Nodes => self.mesh.node(number).map(|i| i as usize),
                    _ => self.elements.get(&number).copied(),
                };
                let Some(index) = index else {
                    self.strays += 1;
                    continue;
                };
                for (component, value) in self.fields[at].components.iter_mut().zip(&values) {
                    component[index] = *value;
                }
                continue;
            }
            let node_count = stream.int(what)?;
            let cell = self.elements.get(&number).copied();
            self.strays += usize::from(cell.is_none());
            for place in 0..usize::try_from(node_count).unwrap_or(0) {
                for value in &mut values {
                    *value = stream.double(what)?;
                }
                let node = cell.and_then(|cell| self.node_of(cell, place));
                if let Some(node) = node {
                    self.fields[at].add(node, &values);
                }
            }
        }
        Ok(())
    }

    /// Returns the index of a field that has been begun.
    fn field(&mut self, section: &Section) -> Result<usize> {
        let is_own = |field: &Building| {
            field.name == section.name
                && field.place == section.place
                && field.components.len() == section.components
        };
        if let Some(at) = self.fields.iter().position(is_own) {
            return Ok(at);
        }
        let count = match section.place {
            Place::Elements => self.mesh.cells.cell_count(),
            _ => self.mesh.cells.nodes.len(),
        };
        let place = format!("result `{}`", section.name);
        self.budget
            .spend(&place, count, 8 * section.components + 4)?;
        let is_mean = section.place == Place::NodesOfElements;
        let empty = if is_mean { 0.0 } else { f64::NAN };
        self.fields.push(Building {
            name: section.name.clone(),
            place: section.place,
            components: vec![vec![empty; count]; section.components],
            uses: vec![0; if is_mean { count } else { 0 }],
        });
        Ok(self.fields.len() - 1)
    }

    /// Returns the node at a place of an element in the file's order.
    fn node_of(&self, cell: usize, place: usize) -> Option<usize> {
        let element = element(i64::from(self.mesh.types[cell]))?;
        let own = match element.order {
            Some(order) => order.iter().position(|&i| usize::from(i) == place)?,
            None => place,
        };
        self.mesh.cells.cell(cell).get(own).map(|&n| n as usize)
    }

    /// Returns the fields, and the names of those that are means over elements.
    pub(super) fn finish(self) -> (Vec<Field>, Vec<String>) {
        let mut means = Vec::new();
        let field = |mut building: Building| {
            if building.place == Place::NodesOfElements {
                means.push(building.name.clone());
                for component in &mut building.components {
                    for (value, &uses) in component.iter_mut().zip(&building.uses) {
                        // A node without values has NaN: 0 / 0.
                        *value /= f64::from(uses);
                    }
                }
            }
            let mut components: Vec<Values> =
                building.components.into_iter().map(Values::from).collect();
            Field {
                name: building.name,
                association: match building.place {
                    Place::Elements => Association::Cells,
                    _ => Association::Nodes,
                },
                source: match components.len() {
                    1 => FieldSource::Scalar(components.remove(0)),
                    _ => FieldSource::Vector(components),
                },
                unit: None,
            }
        };
        let fields = self.fields.into_iter().map(field).collect();
        (fields, means)
    }
}

impl Building {
    fn add(&mut self, node: usize, values: &[f64]) {
        for (component, value) in self.components.iter_mut().zip(values) {
            component[node] += *value;
        }
        self.uses[node] += 1;
    }
}
