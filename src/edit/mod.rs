//! Data sets moved and cut before anything is made of them.
//!
//! [`place`] resizes, turns and moves a data set, [`crop`] keeps what lies in a box ([`open_within`] of a file, of which it may read less).
//! All give a [`Dataset`] again, so
//! that all that follows (sampling, cameras, the true image) sees the edited data as if a file held them.
//!
//! ```
//! use ewa_splat::edit::{Placement, crop, place};
//! use ewa_splat::io::{OpenOptions, read};
//! use glam::{DQuat, DVec3};
//!
//! # fn main() -> ewa_splat::Result<()> {
//! let table = b"x,y,z,sigma\n1,0,0,0.5\n5,0,0,0.5\n";
//! let dataset = read("a.csv", table, &OpenOptions::default())?;
//! let upright = Placement {
//!     rotation: DQuat::from_rotation_y(-std::f64::consts::FRAC_PI_2),
//!     ..Placement::default()
//! };
//! let dataset = place(dataset, &upright)?;
//! assert_eq!(dataset.bounds(), Some((DVec3::Z, 5.0 * DVec3::Z)));
//! let lower = crop(dataset, DVec3::NEG_ONE, 2.0 * DVec3::ONE)?;
//! assert_eq!(lower.bounds(), Some((DVec3::Z, DVec3::Z)));
//! # Ok(())
//! # }
//! ```
//!
//! [`Dataset`]: crate::io::Dataset

mod columns;
mod crop;
#[cfg(test)]
mod fixtures;
mod place;
mod select;
mod within;

pub use crop::crop;
pub use place::{Placement, place};
pub use within::open_within;
