//! Loads inputs as one scene: files, each with its own choices, to volumes that are ready to be
//! rendered.
//!
//! [`load`] opens the inputs of a [`Request`], chooses the fields and the transfer functions that
//! they share, and samples them. [`Loaded`] holds the volumes, and what is known beside them.
//!
//! ```no_run
//! use ewa_splat::io::OpenOptions;
//! use ewa_splat::load::{Input, Request, load};
//! use ewa_splat::sample::SampleOptions;
//! use ewa_splat::{Result, SceneOptions};
//!
//! # fn main() -> Result<()> {
//! let inputs = [Input::parse("wing.vtu@pressure".into()), Input::file("hull.obj".into())];
//! let mut scene = load(&Request {
//!     inputs: &inputs,
//!     open: &OpenOptions::default(),
//!     sample: &SampleOptions::default(),
//!     cameras: &|_, _| Ok(Vec::new()),
//!     keeps_axes: false,
//!     observer: &|_| {},
//! })?;
//! let renderer = scene.renderer(&SceneOptions::default())?;
//! # Ok(())
//! # }
//! ```

#[cfg(feature = "cli")]
mod axes;
#[cfg(feature = "cli")]
pub(crate) mod collection;
#[cfg(feature = "cli")]
mod edit;
#[cfg(feature = "cli")]
pub(crate) mod facts;
#[cfg(feature = "cli")]
pub(crate) mod input;
#[cfg(feature = "cli")]
mod loaded;
#[cfg(feature = "cli")]
mod note;
pub(crate) mod parts;
#[cfg(feature = "cli")]
pub(crate) mod prepared;
#[cfg(feature = "cli")]
mod request;
#[cfg(feature = "cli")]
mod series;
#[cfg(feature = "cli")]
mod steps;
#[cfg(feature = "cli")]
mod surfels;

#[cfg(feature = "cli")]
pub use edit::Edit;
#[cfg(feature = "cli")]
pub use facts::{Corners, InputFacts, Kind};
#[cfg(feature = "cli")]
pub use input::Input;
#[cfg(feature = "cli")]
pub use loaded::{Loaded, load, load_series};
#[cfg(feature = "cli")]
pub(crate) use note::axis;
#[cfg(feature = "cli")]
pub use note::{Event, Note, Observer};
#[cfg(feature = "cli")]
pub use prepared::{Members, is_prepared};
#[cfg(feature = "cli")]
pub use request::{Cameras, Request};
#[cfg(feature = "cli")]
pub use series::Series;
#[cfg(feature = "cli")]
pub use steps::{Steps, steps};
#[cfg(feature = "cli")]
pub use surfels::Wanted;
