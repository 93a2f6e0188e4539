//! Draws data in memory for front ends in other languages: the Python package, the C interface and the page for browsers.
//!
//! [`Drawable`]s hold data sets with their sampling options. A [`Session`] samples them for a picture, keeps the scene for
//! further pictures, and makes it anew when a picture needs another one. [`Arguments`] are settings by name, which each
//! language passes in its own way.

mod arguments;
mod columns;
mod drawable;
mod forked;
mod options;
mod picture;
mod ranks;
mod said;
mod sampled;
mod source;
mod state;
mod view;

pub use arguments::{Arguments, choice, number, positive, range};
pub use columns::{ColumnRequest, DrawnColumn};
pub use drawable::{Drawable, field};
pub use forked::with_workers;
pub use options::{Drawing, Opening, Sampling, drawing, lighting, opening, sampling};
pub use picture::{DrawnPicture, PictureRequest, check_size};
pub use said::{Refused, Said};
pub use sampled::{Purpose, Ready, Sampled, Summed};
pub use source::{Data, Source};
pub use state::{Session, State};
pub use view::{Placement, View, camera};
