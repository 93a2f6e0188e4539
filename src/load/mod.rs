//! Loads inputs as one scene: files, each with its own choices, to volumes that are ready to be
//! rendered.
//!
//! [`load`] opens the inputs of a [`Request`], chooses the fields and the transfer functions that
//! they share, and samples them. [`Loaded`] holds the volumes, and what is known beside them.
//!
//! ```no_run
//! use ewa_splat::distributed::Alone;
//! use ewa_splat::io::OpenOptions;
//! use ewa_splat::load::{Input, Request, load};
//! use ewa_splat::sample::SampleOptions;
//! use ewa_splat::{Result, SceneOptions};
//!
//! # fn main() -> Result<()> {
//! let inputs = [Input::parse("wing.vtu@pressure".into()), Input::file("hull.obj".into())];
//! let request = Request {
//!     inputs: &inputs,
//!     open: &OpenOptions::default(),
//!     sample: &SampleOptions::default(),
//!     cameras: &|_, _| Ok(Vec::new()),
//!     keeps_axes: false,
//!     takes_parts: true,
//!     checks: &(),
//!     observer: &|_| {},
//! };
//! let mut scene = load(&request, &mut Alone::default())?;
//! let renderer = scene.renderer(&SceneOptions::default())?;
//! # Ok(())
//! # }
//! ```

#[cfg(feature = "prepared")]
mod alone;
#[cfg(feature = "prepared")]
mod axes;
#[cfg(feature = "prepared")]
mod choices;
#[cfg(feature = "prepared")]
pub(crate) mod collection;
#[cfg(feature = "prepared")]
mod edit;
#[cfg(feature = "prepared")]
pub(crate) mod facts;
#[cfg(feature = "prepared")]
pub(crate) mod input;
#[cfg(feature = "prepared")]
mod loaded;
#[cfg(feature = "prepared")]
mod note;
#[cfg(feature = "prepared")]
pub(crate) mod partitioned;
pub(crate) mod parts;
#[cfg(feature = "prepared")]
pub(crate) mod prepared;
#[cfg(feature = "prepared")]
mod read;
#[cfg(feature = "prepared")]
mod request;
#[cfg(feature = "prepared")]
mod series;
#[cfg(feature = "prepared")]
mod steps;
#[cfg(feature = "prepared")]
mod surfels;

#[cfg(feature = "prepared")]
pub use alone::load_series;
#[cfg(feature = "prepared")]
pub use choices::{prefer, sample_together};
#[cfg(feature = "prepared")]
pub use edit::Edit;
#[cfg(feature = "prepared")]
pub use facts::{Corners, InputFacts, Kind};
#[cfg(feature = "prepared")]
pub use input::Input;
#[cfg(feature = "prepared")]
pub use loaded::Loaded;
#[cfg(feature = "prepared")]
pub(crate) use note::axis;
#[cfg(feature = "prepared")]
pub use note::{Event, Note, Observer};
#[cfg(feature = "prepared")]
pub use prepared::{Members, is_prepared};
#[cfg(feature = "prepared")]
pub use read::load;
#[cfg(feature = "prepared")]
pub use request::{Cameras, Checks, Request};
#[cfg(feature = "prepared")]
pub use series::Series;
#[cfg(feature = "prepared")]
pub use steps::{Steps, steps};
#[cfg(feature = "prepared")]
pub use surfels::SurfelDemand;
