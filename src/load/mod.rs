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

mod axes;
mod choices;
pub(crate) mod collection;
mod edit;
pub(crate) mod facts;
pub(crate) mod input;
mod loaded;
mod note;
pub(crate) mod prepared;
mod request;
mod series;
mod steps;
mod surfels;

pub use choices::{prefer, sample_together};
pub use edit::Edit;
pub use facts::{Corners, InputFacts, Kind};
pub use input::Input;
pub use loaded::{Loaded, load, load_series};
pub(crate) use note::axis;
pub use note::{Event, Note, Observer};
pub use prepared::{Members, is_prepared};
pub use request::{Cameras, Request};
pub use series::Series;
pub use steps::{Steps, steps};
pub use surfels::SurfelDemand;
