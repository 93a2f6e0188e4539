//! Transforms and crops data sets before they are sampled.
//!
//! [`displace`] moves points by a vector field. [`place`] resizes, rotates and translates a data set. [`crop`] keeps the part in a box. [`open_within`] reads the
//! part of a file in a box, and may skip the rest of the file. All return a [`Dataset`]. Sampling, cameras and the
//! reference image then use the edited data as if they came from a file.
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
mod displace;
#[cfg(test)]
mod fixtures;
mod place;
mod select;
mod within;

pub use crop::crop;
pub(crate) use displace::note_displacement;
pub use displace::{Displacement, displace};
pub use place::{Placement, place};
pub use within::open_within;
