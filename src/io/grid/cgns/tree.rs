//! Finds nodes of a CGNS tree in an HDF5 file.
//!
//! | HDF5 | CGNS |
//! |---|---|
//! | a group | a node; its attributes `label` (as `Zone_t`) and `type` (as `R8`; `LK` for links) |
//! | its dataset ` data` | the node's numbers or text, with the fastest dimension last |
//! | its groups | the nodes below |
//!
//! Source: "HDF5 Implementation of CGIO" in the CGNS documentation.

use std::path::Path;

use hdf5_reader::group::Group;

use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::particles::hdf5::arrays::{ArrayFile, ShapedArray};
use crate::io::vtk::xml::clip;

pub(super) const DAMAGED: &str = "the file is damaged: write it again";

/// Name of the dataset with a node's numbers.
const DATA: &str = " data";

/// A node.
pub(super) struct Node {
    group: Group,
    pub(super) name: String,
    pub(super) label: String,
    has_data: bool,
}

/// An open file.
pub(super) struct Tree<'a> {
    pub(super) path: &'a Path,
    file: ArrayFile<'a>,
}

impl<'a> Tree<'a> {
    pub(super) fn open(input: Input<'a>) -> Result<Self> {
        Ok(Self {
            path: input.path,
            file: ArrayFile::open(input)?,
        })
    }

    /// Returns the bases.
    pub(super) fn bases(&self) -> Result<Vec<Node>> {
        let root = self.file.root()?;
        let nodes = self.below(&root, "")?;
        Ok(nodes
            .into_iter()
            .filter(|node| node.label == "CGNSBase_t")
            .collect())
    }

    /// Returns the nodes below a node.
    pub(super) fn children(&self, node: &Node) -> Result<Vec<Node>> {
        self.below(&node.group, &node.label)
    }

    fn below(&self, group: &Group, label: &str) -> Result<Vec<Node>> {
        let (groups, _) = self.file.names(group)?;
        let mut nodes = Vec::new();
        for name in groups.into_iter().filter(|name| !name.starts_with(' ')) {
            let mut child = self.file.child(group, &name)?;
            let (mut groups, mut datasets) = self.file.names(&child)?;
            let is_link = self
                .file
                .text(&child, "type")
                .is_some_and(|kind| kind == "LK");
            if is_link {
                let is_outside = datasets.iter().any(|name| name == " file");
                if is_outside || !groups.iter().any(|name| name == " link") {
                    let place = format!("node `{}`", clip(&name));
                    let advice = "join the files: `cgnsconvert -l FILE out.cgns`";
                    let found = "a link to another file";
                    return Err(Error::format(
                        self.path,
                        place,
                        "a node in this file",
                        found,
                        advice,
                    ));
                }
                child = self.file.child(&child, " link")?;
                (groups, datasets) = self.file.names(&child)?;
            }
            let stated = self
                .file
                .text(&child, "label")
                .filter(|label| !label.is_empty());
            let label = stated.unwrap_or_else(|| likely_label(label, &name, &groups).to_owned());
            nodes.push(Node {
                group: child,
                has_data: datasets.iter().any(|name| name == DATA),
                name,
                label,
            });
        }
        Ok(nodes)
    }

    /// Returns the numbers of a node, if it has any.
    pub(super) fn numbers(&self, node: &Node) -> Result<Option<ShapedArray>> {
        match node.has_data {
            true => self.file.array_in(&node.group, DATA).map(Some),
            false => Ok(None),
        }
    }

    /// Returns the text of a node, without padding.
    pub(super) fn text(&self, node: &Node) -> Result<String> {
        let array = self.numbers(node)?;
        let bytes = array.map(|array| array.bytes).unwrap_or_default();
        Ok(String::from_utf8_lossy(&bytes)
            .trim_matches(['\0', ' '])
            .to_owned())
    }

    pub(super) fn fault(&self, node: &Node, expected: impl Into<String>, found: String) -> Error {
        let place = format!("node `{}`", clip(&node.name));
        Error::format(self.path, place, expected, found, DAMAGED)
    }
}

/// The label of a node that states none, as some writers make them.
///
/// - `above`: label of the node above; empty for the root.
fn likely_label(above: &str, name: &str, groups: &[String]) -> &'static str {
    let has = |name: &str| groups.iter().any(|group| group == name);
    match above {
        "" if name != "CGNSLibraryVersion" => "CGNSBase_t",
        "CGNSBase_t" if has("GridCoordinates") => "Zone_t",
        "Zone_t" if name == "GridCoordinates" => "GridCoordinates_t",
        "Zone_t" if has("ElementRange") || has("ElementConnectivity") => "Elements_t",
        "GridCoordinates_t" | "FlowSolution_t" => "DataArray_t",
        _ => "",
    }
}
