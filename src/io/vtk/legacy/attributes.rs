//! Reads the attributes of points and cells in legacy VTK files.
//!
//! | keyword | then | numbers for each point or cell |
//! |---|---|---|
//! | `SCALARS` | name, type, n (or 1); on the next line, mostly, `LOOKUP_TABLE` and a name | n |
//! | `COLOR_SCALARS` | name, n | n, of 0 to 1 in text and bytes in binary files |
//! | `VECTORS`, `NORMALS` | name, type | 3 |
//! | `TENSORS`, `TENSORS6` | name, type | 9, 6 |
//! | `TEXTURE_COORDINATES` | name, n, type | n |
//! | `GLOBAL_IDS`, `PEDIGREE_IDS`, `EDGE_FLAGS` | name, type | 1 |
//! | `FIELD` | a name, the number of arrays; for each name, n, tuples, type | n |
//! | `LOOKUP_TABLE` | name, size | 4 for each entry: colours, which are left out |
//!
//! Attributes after `POINT_DATA` belong to the points, those after `CELL_DATA` to the cells.

use super::scan::{DataType, Scanner};
use crate::data::association::Association;
use crate::data::dataset::{Field, FieldSource};
use crate::error::Result;
use crate::io::bytes::scalars::ScalarType;
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Greatest number of arrays without numbers that a note names.
const MOST_NOTED: usize = 64;

/// More components than any array has: a greater count is an error.
const MOST_COMPONENTS: usize = 1024;

/// Numbers of points and cells with attributes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples {
    pub(super) nodes: usize,
    pub(super) cells: usize,
    /// Whether the geometry can hold cell values: a flat structured grid cannot.
    pub(super) keeps_cells: bool,
}

/// Name and shape of an array.
#[derive(Debug)]
struct Heading {
    name: String,
    component_count: usize,
    tuple_count: usize,
    data_type: DataType,
}

impl Heading {
    fn number_count(&self, scan: &Scanner<'_>) -> Result<usize> {
        let count = self.tuple_count.checked_mul(self.component_count);
        count.ok_or_else(|| {
            let found = format!("{} x {}", self.tuple_count, self.component_count);
            scan.cut_short("an array that fits into memory", found)
        })
    }
}

/// Reads all attributes, to the end of the file. Returns the fields, and notes on what was left out.
pub(super) fn read(scan: &mut Scanner<'_>, samples: Samples) -> Result<(Vec<Field>, Vec<String>)> {
    let mut attributes = Attributes {
        samples,
        association: Association::Nodes,
        fields: Vec::new(),
        not_numbers: Vec::new(),
        flat: Vec::new(),
    };
    let mut count = None;
    loop {
        if scan.skip_metadata() {
            continue;
        }
        let Some(keyword) = scan.peek() else {
            break;
        };
        scan.word();
        match keyword.as_str() {
            "POINT_DATA" | "CELL_DATA" => {
                scan.section.clone_from(&keyword);
                attributes.association = match keyword.as_str() {
                    "POINT_DATA" => Association::Nodes,
                    _ => Association::Cells,
                };
                count = Some(scan.count("a number of points or cells")?);
                continue;
            }
            _ => scan.section = format!("{}, {keyword}", attributes.section()),
        }
        let Some(tuple_count) = count else {
            return Err(scan.fault("POINT_DATA or CELL_DATA", format!("`{keyword}`")));
        };
        attributes.read_one(scan, &keyword, tuple_count)?;
    }
    let mut notes = Vec::new();
    let mut note = |names: &[String], why: &str| {
        if !names.is_empty() {
            notes.push(format!("arrays left out: {} ({why})", names.join(", ")));
        }
    };
    note(&attributes.not_numbers, "they hold no numbers");
    note(
        &attributes.flat,
        "a grid one node thick has no cells of any volume",
    );
    Ok((attributes.fields, notes))
}

/// Skips a `FIELD` that belongs to the file as a whole, from the word after it on.
pub(super) fn skip_field(scan: &mut Scanner<'_>) -> Result<()> {
    for_each_array(scan, |scan, heading| {
        let count = heading.number_count(scan)?;
        match heading.data_type {
            texts @ (DataType::Text | DataType::Variant) => scan.skip_texts(texts, count),
            numbers => scan.array(numbers, count).map(drop),
        }
    })
}

/// Passes the headings of the arrays of a `FIELD` to `read`, which reads their values.
fn for_each_array(
    scan: &mut Scanner<'_>,
    mut read: impl FnMut(&mut Scanner<'_>, Heading) -> Result<()>,
) -> Result<()> {
    scan.name()?;
    let count = scan.count("a number of arrays")?;
    for _ in 0..count {
        while scan.skip_metadata() {}
        let name = scan.name()?;
        if name == "NULL_ARRAY" {
            continue;
        }
        let heading = Heading {
            component_count: scan.count("a number of components")?,
            tuple_count: scan.count("a number of tuples")?,
            data_type: scan.data_type()?,
            name,
        };
        read(scan, heading)?;
    }
    Ok(())
}

/// The attributes read so far.
struct Attributes {
    samples: Samples,
    /// Association of the current section.
    association: Association,
    fields: Vec<Field>,
    /// Arrays of text and of values of many types.
    not_numbers: Vec<String>,
    /// Cell arrays of flat grids.
    flat: Vec<String>,
}

impl Attributes {
    fn section(&self) -> &'static str {
        match self.association {
            Association::Nodes => "POINT_DATA",
            Association::Cells => "CELL_DATA",
        }
    }

    /// Reads one attribute, from the word after `keyword` on.
    fn read_one(
        &mut self,
        scan: &mut Scanner<'_>,
        keyword: &str,
        tuple_count: usize,
    ) -> Result<()> {
        let component_count = match keyword {
            "FIELD" => return for_each_array(scan, |scan, heading| self.add(scan, heading)),
            "SCALARS" => return self.scalars(scan, tuple_count),
            "COLOR_SCALARS" => return self.colours(scan, tuple_count),
            "LOOKUP_TABLE" => {
                scan.name()?;
                let entries = scan.count("a number of colours")?;
                let colours = entries.saturating_mul(4);
                scan.array(colour_type(scan), colours)?;
                return Ok(());
            }
            "TEXTURE_COORDINATES" => {
                let name = scan.name()?;
                let component_count = scan.count("a number of components")?;
                let heading = Heading {
                    name,
                    component_count,
                    tuple_count,
                    data_type: scan.data_type()?,
                };
                return self.add(scan, heading);
            }
            "VECTORS" | "NORMALS" => 3,
            "TENSORS" => 9,
            "TENSORS6" => 6,
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => 1,
            _ => {
                scan.section = self.section().to_owned();
                let expected = "an attribute, as SCALARS, VECTORS, FIELD ...";
                return Err(scan.fault(expected, format!("`{keyword}`")));
            }
        };
        let heading = Heading {
            name: scan.name()?,
            component_count,
            tuple_count,
            data_type: scan.data_type()?,
        };
        self.add(scan, heading)
    }

    fn scalars(&mut self, scan: &mut Scanner<'_>, tuple_count: usize) -> Result<()> {
        let name = scan.name()?;
        let data_type = scan.data_type()?;
        let mut component_count = 1;
        let mut table_here = false;
        if let Some(word) = scan.word_on_line() {
            table_here = word == "lookup_table";
            if !table_here {
                component_count = word
                    .parse()
                    .map_err(|_| scan.fault("a number of components", format!("`{word}`")))?;
                table_here = scan.word_on_line().as_deref() == Some("lookup_table");
            }
        }
        // Some programs leave the line out.
        if !table_here && scan.peek().as_deref() == Some("LOOKUP_TABLE") {
            table_here = scan.word().is_some();
        }
        if table_here {
            scan.expect("the name of a lookup table")?;
        }
        let heading = Heading {
            name,
            component_count,
            tuple_count,
            data_type,
        };
        self.add(scan, heading)
    }

    /// Colours become bytes, as in binary files.
    fn colours(&mut self, scan: &mut Scanner<'_>, tuple_count: usize) -> Result<()> {
        let heading = Heading {
            name: scan.name()?,
            component_count: scan.count("a number of components")?,
            tuple_count,
            data_type: colour_type(scan),
        };
        let before = self.fields.len();
        self.add(scan, heading)?;
        for field in &mut self.fields[before..] {
            let components = match &mut field.source {
                FieldSource::Scalar(values) => std::slice::from_mut(values),
                FieldSource::Vector(components) => components,
                FieldSource::Derived(_) => &mut [],
            };
            for values in components {
                if matches!(values, Values::F32(_) | Values::F64(_)) {
                    let bytes = (0..values.len()).map(|i| byte(values.get(i)));
                    *values = Values::U8(bytes.collect());
                }
            }
        }
        Ok(())
    }

    /// Reads the numbers of an array.
    fn add(&mut self, scan: &mut Scanner<'_>, heading: Heading) -> Result<()> {
        scan.section = format!("{}, array `{}`", self.section(), clip(&heading.name));
        let number_count = heading.number_count(scan)?;
        let (expected, one) = match self.association {
            Association::Nodes => (self.samples.nodes, "point"),
            Association::Cells => (self.samples.cells, "cell"),
        };
        if let texts @ (DataType::Text | DataType::Variant) = heading.data_type {
            scan.skip_texts(texts, number_count)?;
            if self.not_numbers.len() < MOST_NOTED && !self.not_numbers.contains(&heading.name) {
                self.not_numbers.push(heading.name);
            }
            return Ok(());
        }
        if heading.tuple_count != expected {
            return Err(scan.fault(
                format!("{expected} tuples, one for each {one}"),
                format!("{}", heading.tuple_count),
            ));
        }
        if heading.component_count > MOST_COMPONENTS {
            let expected = format!("at most {MOST_COMPONENTS} components");
            return Err(scan.fault(expected, format!("{}", heading.component_count)));
        }
        let block = scan.array(heading.data_type, number_count)?;
        if number_count == 0 {
            return Ok(());
        }
        if self.association == Association::Cells && !self.samples.keeps_cells {
            self.flat.push(heading.name);
            return Ok(());
        }
        let component = |c| {
            let values = block.component(c, heading.component_count);
            values.ok_or_else(|| scan.fault(format!("{number_count} numbers"), "fewer"))
        };
        let source = if heading.component_count == 1 {
            FieldSource::Scalar(component(0)?)
        } else {
            let components = (0..heading.component_count).map(component);
            FieldSource::Vector(components.collect::<Result<_>>()?)
        };
        self.fields.push(Field {
            name: heading.name,
            association: self.association,
            source,
            unit: None,
        });
        Ok(())
    }
}

/// The type of colours' numbers.
fn colour_type(scan: &Scanner<'_>) -> DataType {
    DataType::Number(if scan.is_binary {
        ScalarType::U8
    } else {
        ScalarType::F32
    })
}

fn byte(intensity: f32) -> u8 {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped, and not-a-number becomes 0"
    )]
    {
        (intensity.clamp(0.0, 1.0) * 255.0).round() as u8
    }
}
