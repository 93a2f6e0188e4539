//! Loads inputs as one scene: files, each with its own choices, to volumes that are ready to be
//! rendered.
//!
//! [`load`] opens the inputs of a [`Request`], chooses the fields and the transfer functions that
//! they share, and samples them. [`Loaded`] holds the volumes and their metadata.
//!
//! ```
//! use ewa_splat::distributed::{Alone, Collective, Renderer, ThreadRank};
//! use ewa_splat::io::OpenOptions;
//! use ewa_splat::load::{Input, Request, load};
//! use ewa_splat::sample::SampleOptions;
//! use ewa_splat::{Image, Result, SceneOptions, Settings, view::Camera};
//! use glam::DVec3;
//!
//! # fn main() -> Result<()> {
//! let inputs = [Input::parse("fixtures/pieces/duct.pvtu@load".into())];
//! let (open, sample) = (OpenOptions::default(), SampleOptions::default());
//! let request = || Request::new(&inputs, &open, &sample);
//! let (eye, target) = (DVec3::new(0.6, -4.0, 2.0), DVec3::new(0.6, 0.7, 0.4));
//! let camera = Camera::perspective(eye, target, DVec3::Z, 30.0, [40, 30]);
//!
//! // In one process:
//! let mut scene = load(&request(), &mut Alone::default())?;
//! let mut renderer = scene.renderer(&SceneOptions::default())?;
//! let expected = renderer.render(&camera, &Settings::default())?;
//!
//! // On ranks, each of which reads some of the pieces: the same call, and the same image.
//! let draw = |mut rank: ThreadRank| -> Result<Option<Image>> {
//!     let scene = load(&request(), &mut rank)?;
//!     let mut renderer = Renderer::of_loaded(rank, scene, &SceneOptions::default())?;
//!     Ok(renderer.render(&camera, &Settings::default())?.cloned())
//! };
//! let images = std::thread::scope(|scope| {
//!     let ranks = ThreadRank::group(3).into_iter();
//!     let threads: Vec<_> = ranks.map(|rank| scope.spawn(move || draw(rank))).collect();
//!     threads.into_iter().map(|t| t.join().unwrap()).collect::<Result<Vec<_>>>()
//! })?;
//! assert_eq!(images[0].as_ref(), Some(expected));
//! # Ok(())
//! # }
//! ```

mod alone;
mod axes;
pub(crate) mod choices;
pub(crate) mod collection;
mod edit;
pub(crate) mod facts;
pub(crate) mod input;
mod loaded;
pub(crate) mod note;
pub(crate) mod partitioned;
pub(crate) mod parts;
pub(crate) mod prepared;
mod read;
mod renderers;
mod request;
mod series;
mod steps;
mod surfels;

pub use alone::load_series;
pub use choices::{prefer, sample_together};
pub use edit::Edit;
pub use facts::{Corners, InputFacts, Kind};
pub use input::Input;
pub use loaded::Loaded;
pub use note::{Event, Note, Observer};
pub use prepared::{Members, is_prepared};
pub use read::load;
pub use request::{Cameras, Checks, Request};
pub use series::Series;
pub use steps::{Steps, steps};
pub use surfels::SurfelDemand;
