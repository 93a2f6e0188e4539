//! Adds ghosts around a lattice: their values are extrapolated linearly, all else is copied from the nearest
//! sample.

use std::convert::Infallible;

use bytemuck::Pod;

use super::storage::Owned;
use crate::scene::boundary::Boundary;
use crate::scene::columns::{Columns, Visitor};
use crate::scene::lattice::Lattice;
use crate::scene::point_volume::{Particles, PointVolume};

impl PointVolume {
    /// Adds its ghosts to a lattice that has a boundary; leaves other volumes as they are.
    pub(crate) fn with_ghosts(mut self) -> Self {
        let (Some(Boundary::Lattice), Particles::Lattice { lattice, .. }) =
            (&self.boundary, &mut self.particles)
        else {
            return self;
        };
        let own = lattice.clone();
        *lattice = own.with_ghosts();
        let values = self.values.take();
        let values = values.map(|values| own.values_with_ghosts(&values));
        let Ok(()) = self.visit(&mut Copying(&own));
        Self { values, ..self }
    }
}

/// Copies entries of a lattice's samples to its ghosts.
struct Copying<'a>(&'a Lattice);

impl Visitor<Owned> for Copying<'_> {
    type Error = Infallible;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        width: usize,
        column: &mut Vec<T>,
    ) -> Result<(), Infallible> {
        // Volumes may follow from the index.
        if !column.is_empty() {
            *column = match width {
                1 => self.0.copied_to_ghosts(column),
                _ => {
                    let sets: Vec<&[T]> = column.chunks_exact(width).collect();
                    self.0.copied_to_ghosts(&sets).concat()
                }
            };
        }
        Ok(())
    }
}
