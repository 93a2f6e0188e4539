//! Defines cameras, the mapping from world space to camera space to pixels, and clip planes.
//!
//! The world is right-handed. Camera space is the papers': x right, y down, z forward,
//! projection plane z = 1. A pixel coordinate is (fx x/z + cx, fy y/z + cy), and the centre of
//! pixel (i, j) is (i + 0.5, j + 0.5).

mod along;
mod aperture;
mod camera;
mod camera_file;
mod camera_path;
mod captured;
mod clip;
mod distortion;
mod fit;
mod motion;
mod panorama;

pub use along::{Along, Window};
pub use aperture::Aperture;
pub use camera::{Camera, Projection};
pub use camera_path::{CameraPath, KeyCamera};
pub(crate) use captured::{Interpolation, LensOfShot, NodeOfShot, Shot, Track, of_shots};
pub use captured::{NamedCamera, read_camera, read_cameras, read_sequence};
pub use clip::{ClipPlane, clip_boxes, left_of};
pub use distortion::Distortion;
pub use fit::{Bounds, DEFAULT_FOV_DEG, Lens, Viewpoint, sphere_around};
pub(crate) use panorama::Face;
pub use panorama::{FisheyeRule, MOST_FISHEYE_DEG, Mapping, Panorama};
