//! Reads the rows of a PLY file's vertices, column by column.

use std::path::Path;

use glam::DVec3;

use crate::data::dataset::Field;
use crate::error::{Error, Result};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles, positions, values};
use crate::io::particles::table::{position_columns, scalar_field};
use crate::scene::Values;

pub(in crate::io) struct Member {
    pub(in crate::io) name: String,
    pub(in crate::io) scalar: ScalarType,
    pub(in crate::io) offset: usize,
}

/// An element's scalars, row by row.
pub(in crate::io) struct Rows<'a> {
    pub(in crate::io) count: usize,
    pub(in crate::io) step: usize,
    pub(in crate::io) big_endian: bool,
    pub(in crate::io) members: Vec<Member>,
    pub(in crate::io) data: std::borrow::Cow<'a, [u8]>,
}

/// The rows with the file's name, for messages.
pub(in crate::io) struct Table<'a> {
    pub(in crate::io) path: &'a Path,
    pub(in crate::io) rows: &'a Rows<'a>,
}

impl Table<'_> {
    pub(in crate::io) fn index(&self, name: &str) -> Option<usize> {
        self.rows.members.iter().position(|m| m.name == name)
    }

    /// The index of a column by its name, in upper or lower case.
    pub(in crate::io) fn index_of(&self, name: &str) -> Option<usize> {
        let mut members = self.rows.members.iter();
        members.position(|m| m.name.eq_ignore_ascii_case(name))
    }

    /// A column in the type of the file, or in single precision.
    pub(in crate::io) fn values(&self, member: usize) -> Result<Values> {
        let (encoding, stride) = self.place(member);
        values(&self.rows.data, encoding, stride).ok_or_else(|| self.damaged())
    }

    fn place(&self, member: usize) -> (Encoding, Stride) {
        let member = &self.rows.members[member];
        let encoding = Encoding {
            scalar: member.scalar,
            big_endian: self.rows.big_endian,
        };
        let stride = Stride {
            first: member.offset,
            step: self.rows.step,
            count: self.rows.count,
        };
        (encoding, stride)
    }

    /// The error for missing rows; rows were checked before, so they exist.
    fn damaged(&self) -> Error {
        Error::format(
            self.path,
            "element `vertex`",
            "whole rows",
            "the end of the file",
            "the file is cut off: get it again",
        )
    }

    pub(in crate::io) fn floats(&self, member: usize) -> Result<Vec<f32>> {
        Ok(match self.values(member)? {
            Values::F32(column) => column,
            column => (0..column.len()).map(|i| column.get(i)).collect(),
        })
    }

    /// A column in double precision, which can represent every 32-bit number.
    pub(in crate::io) fn numbers(&self, member: usize) -> Result<Vec<f64>> {
        let (encoding, stride) = self.place(member);
        doubles(&self.rows.data, encoding, stride).ok_or_else(|| self.damaged())
    }

    pub(in crate::io) fn positions(&self) -> Result<(Vec<DVec3>, Vec<usize>)> {
        let names = self.rows.members.iter().map(|m| m.name.as_str());
        let columns = position_columns(self.path, names)?.of_space(self.path)?;
        let axes = columns.map(|column| self.place(column));
        let positions = positions(&self.rows.data, axes).ok_or_else(|| self.damaged())?;
        Ok((positions, columns.to_vec()))
    }

    /// All columns but the used ones.
    pub(in crate::io) fn fields(&self, used: &[usize]) -> Result<Vec<Field>> {
        let mut fields = Vec::new();
        for (i, member) in self.rows.members.iter().enumerate() {
            if !used.contains(&i) {
                fields.push(scalar_field(member.name.clone(), self.values(i)?));
            }
        }
        Ok(fields)
    }

    /// The columns of a splat layout, in the order of `names`.
    pub(in crate::io) fn columns<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N]> {
        let mut columns = [0; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.index(name).ok_or_else(|| {
                Error::format(
                    self.path,
                    "header",
                    "f_dc_0..2, opacity, scale_0, scale_1 and rot_0..3, as splats have them",
                    format!("no property `{name}`"),
                    "write all of them, or a particle table without f_dc_0",
                )
            })?;
        }
        Ok(columns)
    }
}
