//! Reads the cameras of captures and of other programs' scenes.
//!
//! | file | written by | cameras | axes of a camera |
//! |---|---|---|---|
//! | `transforms.json` (`frames` with `transform_matrix`) | nerfstudio, Instant NGP, BlenderNeRF | one a picture, in the file's order | right, up, backward |
//! | `images.bin` or `images.txt` with `cameras.*` beside it, or their folder | COLMAP | one a picture, by name | right, down, forward |
//! | `cameras.json` (an array with `position` and `rotation`) | the reference trainer of splats | one a picture, by name | right, down, forward |
//! | a camera path (`camera_path` with `camera_to_world`) | nerfstudio's viewer | one a frame | right, up, backward |
//! | a camera or a scene (`object` with `matrix`) | three.js, `toJSON` | one an object | right, up, backward |
//! | an `AnimationClip` (`tracks`), alone or in a scene's `animations` | three.js, `toJSON` | one that moves | right, up, backward |
//! | a camera (`eye`) | this library: [`read_camera`] | one | |
//!
//! Each camera is a pinhole's, and the mapping of its lens stands beside it if that bends the picture.

mod colmap;
mod json;
mod moving;
mod three;

use std::fs::read_to_string;
use std::path::Path;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::camera::{Camera, Projection};
use super::camera_file::camera_of;
use super::camera_path::CameraPath;
use super::distortion::Distortion;
use super::panorama::Mapping;
use crate::error::{Error, Place, Result};
pub(crate) use moving::{Interpolation, LensOfShot, NodeOfShot, Shot, Track, of_shots};

/// A camera with its name in the file.
#[derive(Debug, Clone)]
pub struct NamedCamera {
    /// Name of the picture that it took, or a number.
    pub name: String,
    /// The camera, as a pinhole.
    pub camera: Camera,
    /// Directions of the pixels, if they are not the pinhole's.
    pub mapping: Option<Mapping>,
}

impl NamedCamera {
    /// Returns true if no pinhole sees what the camera sees: a fisheye or a picture of all directions.
    pub fn is_wide(&self) -> bool {
        !matches!(
            self.mapping,
            None | Some(Mapping::Lens {
                distortion: Distortion::Radial { .. },
                ..
            })
        )
    }
}

/// The lens of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Optics {
    /// Focal lengths and optical axis, pixels of pictures of this width and height.
    Calibrated {
        focal_px: DVec2,
        centre_px: DVec2,
        size: [usize; 2],
    },
    /// Full angle in radians from the left to the right of a picture of any size.
    Horizontal(f64),
    /// Full angle in radians from the top to the bottom of the picture, whose size the file may leave open.
    Vertical(f64, Option<[usize; 2]>),
    /// Height of the picture, world units, of an orthographic camera.
    Orthographic(f64),
    /// All directions, in pictures of this width and height.
    Sphere(Option<[usize; 2]>),
}

/// A camera as its file states it.
#[derive(Debug, Clone)]
struct Stated {
    name: String,
    eye: DVec3,
    /// Rows: right, down and forward in the world.
    camera_from_world: DMat3,
    optics: Optics,
    distortion: Option<Distortion>,
}

/// Size of pictures that neither the file nor the caller states.
const DEFAULT_SIZE: [usize; 2] = [1024, 1024];

/// Reads the cameras of a file in one of the formats above, or of a folder with a model of COLMAP.
///
/// - `size`: width and height of the pictures; without it those that the file states for each.
///
/// # Errors
/// A file that cannot be read, is damaged or has no camera; a lens that is no pinhole's; numbers that are not finite, or no
/// rotation.
pub fn read_cameras(path: &Path, size: Option<[usize; 2]>) -> Result<Vec<NamedCamera>> {
    match contents(path, "opening the camera", None)? {
        Contents::Stated(stated) => at_size(path, stated, size),
        Contents::Other(text) => Ok(vec![NamedCamera {
            name: "0".into(),
            camera: camera_of(path, &text, size)?,
            mapping: None,
        }]),
    }
}

/// Reads the first camera of a file, as [`read_cameras`].
///
/// # Errors
/// The errors of [`read_cameras`].
pub fn read_camera(path: &Path, size: Option<[usize; 2]>) -> Result<Camera> {
    let cameras = read_cameras(path, size)?;
    let first = cameras.into_iter().next();
    first
        .map(|first| first.camera)
        .ok_or_else(|| no_camera(path))
}

/// Reads the cameras of a sequence of pictures: those of a [`CameraPath`], all of a file as [`read_cameras`], or those of the
/// first camera that moves, from its first key to its last.
///
/// - `size`: width and height of the pictures; without it those of the first camera, or `default`.
/// - `rate`: pictures per second of a camera that moves.
///
/// # Errors
/// The errors of [`read_cameras`] and of [`CameraPath::read`].
pub fn read_sequence(
    path: &Path,
    size: Option<[usize; 2]>,
    default: [usize; 2],
    rate: f64,
) -> Result<Vec<NamedCamera>> {
    match contents(path, "opening the camera path", Some(rate))? {
        Contents::Stated(stated) => {
            let first = stated.first().and_then(|first| first.optics.size());
            let cameras = at_size(path, stated, Some(size.or(first).unwrap_or(default)))?;
            match cameras.iter().find(|camera| camera.is_wide()) {
                None => Ok(cameras),
                Some(wide) => {
                    let place = format!("camera {}", wide.name);
                    let expected = "pinhole cameras, distorted or not, for a sequence";
                    Err(fault(path, place, expected, "a fisheye or a sphere"))
                }
            }
        }
        Contents::Other(text) => {
            let cameras = CameraPath::parse(path, &text)?.cameras(size.unwrap_or(default));
            let numbered = cameras.into_iter().enumerate();
            let named = numbered.map(|(i, camera)| NamedCamera {
                name: i.to_string(),
                camera,
                mapping: None,
            });
            Ok(named.collect())
        }
    }
}

/// Contents of a file.
enum Contents {
    /// Cameras of another program.
    Stated(Vec<Stated>),
    /// JSON of this library's, or no cameras.
    Other(String),
}

fn contents(path: &Path, doing: &'static str, rate: Option<f64>) -> Result<Contents> {
    if let Some(model) = colmap::model_of(path) {
        return Ok(Contents::Stated(model.read()?));
    }
    let text = read_to_string(path).map_err(|e| Error::io(path, doing, e, "check the path"))?;
    crate::opened::note(path);
    Ok(match json::stated(path, &text, rate)? {
        Some(stated) => Contents::Stated(stated),
        None => Contents::Other(text),
    })
}

/// Returns cameras for pictures of one size, or of their own.
fn at_size(path: &Path, stated: Vec<Stated>, size: Option<[usize; 2]>) -> Result<Vec<NamedCamera>> {
    if stated.is_empty() {
        return Err(no_camera(path));
    }
    let at = |own: Stated| {
        let size = size.or(own.optics.size()).unwrap_or(DEFAULT_SIZE);
        own.at(path, size)
    };
    stated.into_iter().map(at).collect()
}

fn no_camera(path: &Path) -> Error {
    fault(path, "cameras", "one or more", "none")
}

impl Optics {
    /// Returns the size of the pictures, if it is known.
    fn size(&self) -> Option<[usize; 2]> {
        match *self {
            Self::Calibrated { size, .. } => Some(size),
            Self::Vertical(_, size) | Self::Sphere(size) => size,
            Self::Horizontal(_) | Self::Orthographic(_) => None,
        }
    }
}

impl Stated {
    /// Returns the camera of pictures of a size.
    fn at(self, path: &Path, size: [usize; 2]) -> Result<NamedCamera> {
        let [width, height] = size.map(|n| n as f64);
        let half = DVec2::new(width, height) / 2.0;
        let (focal_px, centre_px) = match self.optics {
            Optics::Calibrated {
                focal_px,
                centre_px,
                size,
            } => {
                // A picture of another shape shows more at two sides: pixels stay square.
                let own = DVec2::from(size.map(|n| n as f64));
                let scale = (DVec2::new(width, height) / own).min_element();
                (focal_px * scale, (centre_px - own / 2.0) * scale + half)
            }
            Optics::Horizontal(angle) => (DVec2::splat(half.x / (angle / 2.0).tan()), half),
            Optics::Vertical(angle, _) => (DVec2::splat(half.y / (angle / 2.0).tan()), half),
            Optics::Orthographic(world) => (DVec2::splat(height / world), half),
            Optics::Sphere(_) => (DVec2::splat(height / std::f64::consts::PI), half),
        };
        let camera = Camera {
            projection: match self.optics {
                Optics::Orthographic(_) => Projection::Orthographic,
                _ => Projection::Perspective,
            },
            eye: self.eye,
            camera_from_world: self.camera_from_world,
            focal_px,
            centre_px,
            width: size[0],
            height: size[1],
        };
        camera.validate().map_err(|error| {
            let expected = "finite numbers, and positive focal lengths";
            fault(
                path,
                format!("camera {}", self.name),
                expected,
                error.to_string(),
            )
        })?;
        let of_lens = |distortion| Mapping::Lens {
            distortion,
            focal_px,
            centre_px,
        };
        let mapping = match self.optics {
            Optics::Sphere(_) => Some(Mapping::Equirectangular),
            _ => self.distortion.map(of_lens),
        };
        Ok(NamedCamera {
            name: self.name,
            camera,
            mapping,
        })
    }
}

/// Returns the error for a file that does not hold what its format states.
fn fault(path: &Path, place: impl Into<Place>, expected: &str, found: impl Into<String>) -> Error {
    Error::format(path, place, expected, found, "see docs/command-line.md")
}

/// Returns the rotation from the world to axes right, down and forward.
///
/// - `axes`: the camera's axes in the world, as columns: right, down and forward, or right, up and backward (`is_gl`). Their
///   lengths may differ from 1.
fn rotation(axes: DMat3, is_gl: bool) -> Option<DMat3> {
    let sign = if is_gl { -1.0 } else { 1.0 };
    let unit = |axis: DVec3| axis.try_normalize();
    let own = DMat3::from_cols(
        unit(axes.x_axis)?,
        unit(axes.y_axis)? * sign,
        unit(axes.z_axis)? * sign,
    );
    super::camera::is_rotation(own).then(|| {
        let exact = DQuat::from_mat3(&own).normalize();
        DMat3::from_quat(exact).transpose()
    })
}

fn not_a_rotation(path: &Path, name: &str, rows: &dyn std::fmt::Debug) -> Error {
    fault(
        path,
        format!("camera {name}"),
        "a rotation and a position",
        format!("{rows:?}"),
    )
}

/// Returns the angle in radians if it is one of a field of view.
fn angle(path: &Path, name: &str, radians: f64) -> Result<f64> {
    if radians > 0.0 && radians < std::f64::consts::PI {
        return Ok(radians);
    }
    let expected = "a field of view above 0 and below 180 degrees";
    Err(fault(
        path,
        format!("camera {name}"),
        expected,
        format!("{} degrees", radians.to_degrees()),
    ))
}

/// Returns a size of whole pixels.
fn size_of(width: f64, height: f64) -> Option<[usize; 2]> {
    let side = |n: f64| {
        let is_side = n.fract() == 0.0 && (1.0..=65_535.0).contains(&n);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number from 1 to 65,535"
        )]
        is_side.then_some(n as usize)
    };
    Some([side(width)?, side(height)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::panorama::Panorama;

    /// The point that pycolmap 4.2 and numpy project to the pixels below, without distortion, in pictures of each camera's
    /// size.
    const POINT: DVec3 = DVec3::new(0.3, -0.2, 0.1);

    fn fixture(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("fixtures/cameras")
            .join(name)
    }

    fn check(
        name: &str,
        size: Option<[usize; 2]>,
        expected: &[(&str, [usize; 2], [f64; 2], bool)],
    ) {
        let cameras = read_cameras(&fixture(name), size).unwrap();
        assert_eq!(cameras.len(), expected.len(), "{name}");
        for (own, (camera, size, pixel, is_bent)) in cameras.iter().zip(expected) {
            assert_eq!(
                (own.name.as_str(), own.mapping.is_some()),
                (*camera, *is_bent),
                "{name}"
            );
            assert_eq!([own.camera.width, own.camera.height], *size, "{name}");
            let at = own.camera.project(POINT).unwrap();
            // The numbers are printed to 1e-8.
            assert!(
                at.distance(DVec2::from(*pixel)) < 1e-6,
                "{name}, {camera}: {at}"
            );
        }
    }

    const ONE: [f64; 2] = [452.285_894_86, 298.561_721_1];
    const TWO: [f64; 2] = [307.249_043_75, 258.466_332_86];
    const C: [f64; 2] = [364.707_988_73, 231.951_121_74];

    #[test]
    fn cameras_project_as_their_programs_do() {
        let (large, small) = ([800, 600], [640, 480]);
        let model = [
            ("a/one.png", large, ONE, false),
            ("b two.jpg", small, TWO, false),
            ("c.png", small, C, true),
        ];
        for name in ["text", "bin", "text/images.txt", "bin/cameras.bin"] {
            check(name, None, &model);
        }
        let captured = [
            ("images/c.png", small, C, true),
            ("images/a/one.png", large, ONE, false),
            ("images/b two.jpg", small, TWO, false),
        ];
        check("transforms.json", None, &captured);
        // The optical axis is in the middle of the picture.
        let trained = [
            ("a/one.png", large, [451.285_894_86, 299.561_721_1], false),
            ("b two.jpg", small, [304.749_043_75, 260.216_332_86], false),
            ("c.png", small, C, false),
        ];
        check("trained.json", None, &trained);
        let frames = [
            [406.020_763_795_6, 231.714_779_940_2],
            [397.708_442_211_8, 239.682_289_984_8],
            [344.905_024_046_7, 260.009_568_801_3],
        ];
        check(
            "path.json",
            None,
            &[0, 1, 2].map(|i| (["0", "1", "2"][i], [720, 480], frames[i], false)),
        );
        check(
            "blender.json",
            Some(small),
            &[(
                "./train/r_0",
                small,
                [379.233_646_070_7, 229.336_035_472_7],
                false,
            )],
        );
        check(
            "three.json",
            Some(small),
            &[("view", small, [389.031_145_693_4, 227.572_169_910_4], false)],
        );
    }

    #[test]
    fn lenses_bend_as_their_programs_do() {
        // Parameters, and the pixel at which pycolmap 4.2 sees the direction (.5, -.4, 1).
        let lenses = [
            (
                "OPENCV",
                "500 510 320 240 -.28 .09 .001 -.002",
                [543.972_25, 57.113_184],
            ),
            (
                "FULL_OPENCV",
                "500 510 320 240 .1 .05 .001 -.002 .01 .08 .02 .003",
                [572.200_946_713_665_1, 34.078_567_481_649_316],
            ),
            ("SIMPLE_RADIAL", "500 320 240 -.1", [559.75, 48.2]),
            ("RADIAL", "500 320 240 -.1 .03", [561.010_75, 47.191_4]),
            (
                "OPENCV_FISHEYE",
                "300 310 320 240 .05 -.01 .002 -.0001",
                [455.452_033_822_993, 128.026_318_706_325_7],
            ),
            (
                "SIMPLE_RADIAL_FISHEYE",
                "300 320 240 .05",
                [455.583_453_130_011_5, 131.533_237_495_990_8],
            ),
            (
                "RADIAL_FISHEYE",
                "300 320 240 .05 -.01",
                [455.443_074_610_477, 131.645_540_311_618_4],
            ),
        ];
        let direction = DVec3::new(0.5, -0.4, 1.0).normalize();
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("images.txt"), "1 1 0 0 0 0 0 0 1 a.png\n\n").unwrap();
        let check = |path: &Path, model: &str, pixel: [f64; 2]| {
            let named = read_cameras(path, None).unwrap().remove(0);
            let mapping = named.mapping.unwrap();
            let panorama = Panorama::of_camera(&named.camera, mapping);
            let found = panorama.direction([0, 0], DVec2::from(pixel)).unwrap();
            assert!(found.abs_diff_eq(direction, 1e-8), "{model}: {found}");
            assert_eq!(named.is_wide(), model.ends_with("FISHEYE"), "{model}");
        };
        for (model, numbers, pixel) in lenses {
            let line = format!("1 {model} 640 480 {numbers}\n");
            std::fs::write(path("cameras.txt"), line).unwrap();
            check(folder.path(), model, pixel);
        }
        let matrix = "[[1,0,0,0],[0,-1,0,0],[0,0,-1,0],[0,0,0,1]]";
        for (model, terms, pixel) in [
            (
                "OPENCV",
                r#""k1": -0.28, "k2": 0.09, "p1": 0.001, "p2": -0.002"#,
                lenses[0].2,
            ),
            (
                "FULL_OPENCV",
                r#""k1": 0.1, "k2": 0.05, "p1": 0.001, "p2": -0.002, "k3": 0.01, "k4": 0.08, "k5": 0.02, "k6": 0.003"#,
                lenses[1].2,
            ),
            (
                "OPENCV_FISHEYE",
                r#""k1": 0.05, "k2": -0.01, "k3": 0.002, "k4": -0.0001"#,
                lenses[4].2,
            ),
        ] {
            let focal = match model {
                "OPENCV_FISHEYE" => [300, 310],
                _ => [500, 510],
            };
            let json = format!(
                r#"{{"camera_model": "{model}", "fl_x": {}, "fl_y": {}, "cx": 320, "cy": 240, "w": 640, "h": 480,
                {terms}, "frames": [{{"transform_matrix": {matrix}}}]}}"#,
                focal[0], focal[1]
            );
            std::fs::write(path("a.json"), json).unwrap();
            check(&path("a.json"), model, pixel);
        }
        let sphere = format!(
            r#"{{"camera_model": "EQUIRECTANGULAR", "w": 64, "h": 32, "frames": [{{"transform_matrix": {matrix}}}]}}"#
        );
        std::fs::write(path("a.json"), sphere).unwrap();
        let named = read_cameras(&path("a.json"), None).unwrap().remove(0);
        assert_eq!(named.mapping, Some(Mapping::Equirectangular));
        assert_eq!([named.camera.width, named.camera.height], [64, 32]);
        assert!(read_sequence(&path("a.json"), None, DEFAULT_SIZE, 25.0).is_err());
    }

    #[test]
    fn a_sequence_has_pictures_of_one_size() {
        let cameras = read_sequence(&fixture("text"), None, DEFAULT_SIZE, 25.0).unwrap();
        assert!(
            cameras
                .iter()
                .all(|own| [own.camera.width, own.camera.height] == [800, 600])
        );
        let at = cameras[1].camera.project(POINT).unwrap();
        assert!(at.distance(DVec2::from(TWO) * 1.25) < 1e-6);
        let cameras = read_sequence(&fixture("blender.json"), None, [64, 48], 25.0).unwrap();
        assert_eq!(
            [cameras[0].camera.width, cameras[0].camera.height],
            [64, 48]
        );
        // A picture of another shape is not stretched: the whole capture lies in its middle.
        let wide = read_sequence(&fixture("text"), Some([1280, 480]), DEFAULT_SIZE, 25.0).unwrap();
        let at = wide[1].camera.project(POINT).unwrap();
        assert!(at.distance(DVec2::from(TWO) + DVec2::new(320.0, 0.0)) < 1e-6);
    }

    /// Cameras of three.js that move, and the pixels to which three.js 0.187 projects the point in pictures of 640 x 480, four a
    /// second, by its ObjectLoader and AnimationMixer.
    #[test]
    fn cameras_move_as_in_three_js() {
        let scene = [
            [348.175_1, 410.055_57],
            [331.744_26, 393.401_27],
            [322.245_1, 376.116_7],
            [318.515_11, 358.572_97],
            [319.607_02, 341.035_56],
            [328.083_6, 310.969_43],
            [330.194_96, 264.896_52],
            [335.034_93, 244.037_27],
            [339.600_96, 222.024_68],
        ];
        let clip = [
            [401.265_53, 294.177_02],
            [412.669_54, 295.984_15],
            [432.099_31, 295.924_34],
            [458.088_63, 295.279_68],
            [489.757_63, 294.960_84],
        ];
        for (name, pixels) in [
            ("moving_scene.json", &scene[..]),
            ("moving_clip.json", &clip[..]),
        ] {
            let path = fixture(name);
            let cameras = read_sequence(&path, None, [640, 480], 4.0).unwrap();
            assert_eq!(cameras.len(), pixels.len(), "{name}");
            for (own, pixel) in cameras.iter().zip(pixels) {
                let at = own.camera.project(POINT).unwrap();
                // three.js interpolates in f32.
                let distance = at.distance(DVec2::from(*pixel));
                assert!(distance < 1e-3, "{name}, {}: {at}", own.name);
            }
            let first = read_cameras(&path, Some([640, 480])).unwrap();
            assert_eq!(first.len(), 1);
            let at = first[0].camera.project(POINT).unwrap();
            assert!(at.distance(DVec2::from(pixels[0])) < 1e-3, "{name}");
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        let read = |text: &[u8]| {
            std::fs::write(&file, text).unwrap();
            let still = read_cameras(&file, None).is_ok();
            still && read_sequence(&file, None, DEFAULT_SIZE, 25.0).is_ok()
        };
        let bare = |name: &str| -> String {
            let text = std::fs::read_to_string(fixture(name)).unwrap();
            text.split_whitespace().collect()
        };
        let (scene, clip) = (bare("moving_scene.json"), bare("moving_clip.json"));
        for (good, old, new) in [
            (
                &clip,
                "\"name\":\".position\"",
                "\"name\":\"other.position\"",
            ),
            (&clip, "\"times\":[0,1]", "\"times\":[1,0]"),
            (&clip, "\"times\":[0,1]", "\"times\":[0,1,2]"),
            (&clip, "\"times\":[0,1]", "\"times\":[0,1e9]"),
            (&clip, "[0,0,2,", "[0,0,1e999,"),
            (&scene, "PerspectiveCamera", "CubeCamera"),
            (&scene, "\"interpolation\":2300", "\"interpolation\":2302"),
            (&scene, "\"fov\":40", "\"fov\":0"),
        ] {
            assert!(read(good.as_bytes()) && good.contains(old), "{old}");
            assert!(!read(good.replace(old, new).as_bytes()), "{new}");
        }
        for good in [&scene, &clip] {
            for at in (0..good.len()).step_by(3) {
                let mut bytes = good.clone().into_bytes();
                let _ = read(&bytes[..at]);
                bytes[at] ^= 0x15;
                let _ = read(&bytes);
            }
        }
    }

    #[test]
    fn damaged_cameras_are_one_error() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["images", "cameras"] {
            let bytes = std::fs::read(fixture("bin").join(name).with_extension("bin")).unwrap();
            for other in ["images", "cameras"] {
                std::fs::copy(
                    fixture("bin").join(other).with_extension("bin"),
                    folder.path().join(other).with_extension("bin"),
                )
                .unwrap();
            }
            let file = folder.path().join(name).with_extension("bin");
            for cut in 0..bytes.len() {
                std::fs::write(&file, &bytes[..cut]).unwrap();
                // The points of the last picture are not read.
                let is_whole = name == "images" && cut + 2 * 24 >= bytes.len();
                assert_eq!(
                    read_cameras(folder.path(), None).is_ok(),
                    is_whole,
                    "{name} {cut}"
                );
            }
            for place in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[place] ^= 0x91;
                std::fs::write(&file, &damaged).unwrap();
                let _ = read_cameras(folder.path(), None);
            }
        }
        let json = folder.path().join("a.json");
        let good = std::fs::read_to_string(fixture("transforms.json")).unwrap();
        for (old, new) in [
            ("OPENCV", "THIN_PRISM_FISHEYE"),
            ("\"fl_x\": 500.0", "\"fl_x\": -500.0"),
            ("\"w\": 640", "\"w\": 640.5"),
            ("\"w\": 640", "\"w\": 1e300"),
            ("transform_matrix", "matrix"),
            ("frames", "is_fisheye\": true, \"frames"),
        ] {
            assert!(good.contains(old), "{old}");
            std::fs::write(&json, good.replace(old, new)).unwrap();
            assert!(read_cameras(&json, None).is_err(), "{new}");
        }
        for text in [
            "",
            "{",
            "[]",
            "{\"frames\": []}",
            "{\"frames\": [{\"transform_matrix\": [[1]], \"camera_angle_x\": 1}]}",
        ] {
            std::fs::write(&json, text).unwrap();
            assert!(read_cameras(&json, None).is_err(), "{text}");
        }
    }
}
