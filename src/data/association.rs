//! Elements of a grid that values belong to.

/// Elements that the values of a [`Field`](super::dataset::Field) belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Association {
    /// Nodes of a grid, or particles.
    Nodes,
    /// Cells of a grid. A structured grid has one cell fewer than nodes along each axis.
    Cells,
}

impl Association {
    /// Nodes and cells, in the order in which files store them.
    pub(crate) const BOTH: [Self; 2] = [Self::Nodes, Self::Cells];

    /// Word that selects this association in [`Dataset::scalar`](super::dataset::Dataset::scalar): `nodes` or `cells`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nodes => "nodes",
            Self::Cells => "cells",
        }
    }

    /// Splits a selector `NAME@cells` or `NAME@nodes` into its name and its association.
    pub(crate) fn split(selector: &str) -> Option<(&str, Self)> {
        let (name, word) = selector.rsplit_once('@')?;
        Some((name, Self::of_name(word)?))
    }

    /// Finds the association with this name.
    pub(crate) fn of_name(word: &str) -> Option<Self> {
        let is = |of: &Self| of.name().eq_ignore_ascii_case(word);
        Self::BOTH.into_iter().find(is)
    }
}
