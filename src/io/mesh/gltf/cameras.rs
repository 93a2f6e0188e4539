//! Reads the cameras of a scene, with their animation.

use std::path::Path;

use serde::Deserialize;

use super::accessor::{ANY_NUMBERS, Accessor, ComponentType, Type};
use super::container::{Buffers, looks_like, split};
use super::document::Document;
use super::nodes::{Nodes, parent_from_node};
use crate::error::{Error, Result};
use crate::io::bytes::file::{HEAD, Input};
use crate::view::{Interpolation, LensOfShot, NamedCamera, NodeOfShot, Shot, Track, of_shots};

/// Members of the file that the reader of meshes skips.
#[derive(Deserialize)]
struct Members {
    #[serde(default)]
    cameras: Vec<Camera>,
    #[serde(default)]
    animations: Vec<Animation>,
    #[serde(default)]
    nodes: Vec<OfNode>,
}

#[derive(Deserialize)]
struct OfNode {
    camera: Option<usize>,
    name: Option<String>,
}

#[derive(Deserialize)]
struct Camera {
    perspective: Option<Perspective>,
    orthographic: Option<Orthographic>,
}

#[derive(Deserialize)]
struct Perspective {
    yfov: f64,
}

#[derive(Deserialize)]
struct Orthographic {
    ymag: f64,
}

#[derive(Deserialize)]
struct Animation {
    channels: Vec<Channel>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: Target,
}

#[derive(Deserialize)]
struct Target {
    node: Option<usize>,
    path: String,
    #[serde(default)]
    extensions: Extensions,
}

#[derive(Deserialize, Default)]
struct Extensions {
    #[serde(rename = "KHR_animation_pointer")]
    pointer: Option<Pointer>,
}

#[derive(Deserialize)]
struct Pointer {
    pointer: String,
}

#[derive(Deserialize)]
struct Sampler {
    input: usize,
    output: usize,
    interpolation: Option<String>,
}

/// Returns true if a file begins like a glTF file.
pub(crate) fn is_gltf(path: &Path) -> bool {
    // A camera may come through a pipe, which is read once.
    path.is_file()
        && Input::of_file(path)
            .head(HEAD)
            .is_ok_and(|(head, _)| looks_like(&head))
}

/// Reads the cameras of a glTF file: of all nodes with one, in the file's order; or all pictures of one camera that moves.
///
/// - `size`: width and height of the pictures; without it 1024 x 1024.
/// - `rate`: pictures per second from the first key of the animation to the last. Without it, each camera is where it is at
///   its first key.
///
/// # Errors
/// A damaged file; no camera; an animation of other numbers.
pub(crate) fn read_gltf_cameras(
    path: &Path,
    size: Option<[usize; 2]>,
    rate: Option<f64>,
) -> Result<Vec<NamedCamera>> {
    let input = Input::of_file(path);
    let bytes = input.read_all()?;
    let chunks = split(path, &bytes)?;
    let members: Members = serde_json::from_slice(chunks.json).map_err(|e| {
        let place = format!("line {}, column {}", e.line(), e.column());
        let advice = "export it again";
        Error::format(path, place, "cameras and animations", e.to_string(), advice)
    })?;
    let document = Document::parse(path, chunks.json)?;
    let buffers = Buffers::new(input, &document, chunks.bin, bytes.len());
    let shots = Scene::new(&buffers, &members)?.shots()?;
    if shots.is_empty() {
        let advice = "export the scene with its cameras";
        return Err(Error::format(
            path,
            "nodes",
            "a node with a camera",
            "none",
            advice,
        ));
    }
    of_shots(path, &shots, size, rate)
}

/// Nodes and what moves them.
struct Scene<'b> {
    buffers: &'b Buffers<'b>,
    members: &'b Members,
    parents: Vec<Option<usize>>,
    nodes: Vec<NodeOfShot>,
}

impl<'b> Scene<'b> {
    fn new(buffers: &'b Buffers<'b>, members: &'b Members) -> Result<Self> {
        // It refuses loops.
        let all = Nodes::new(buffers)?.all;
        let mut parents = vec![None; all.len()];
        let mut nodes = Vec::with_capacity(all.len());
        for (i, node) in all.iter().enumerate() {
            for &child in &node.children {
                parents[child] = Some(i);
            }
            nodes.push(NodeOfShot {
                rest: parent_from_node(buffers, node.object)?,
                position: None,
                rotation: None,
            });
        }
        Ok(Self {
            buffers,
            members,
            parents,
            nodes,
        })
    }

    /// Returns the cameras of all nodes that have one.
    fn shots(mut self) -> Result<Vec<Shot>> {
        let mut angles: Vec<Option<Track<1>>> = vec![None; self.members.cameras.len()];
        // Of several animations the first counts: exporters write one for each of a scene's actions.
        for (a, animation) in self.members.animations.iter().enumerate() {
            for (c, channel) in animation.channels.iter().enumerate() {
                let place = format!("animation {a}, channel {c}");
                let target = &channel.target;
                let node = target.node.and_then(|node| self.nodes.get(node));
                let is_open = |of: fn(&NodeOfShot) -> bool| node.is_some_and(of);
                match (target.path.as_str(), &target.extensions.pointer) {
                    ("translation", _) if is_open(|own| own.position.is_none()) => {
                        let track = self.track(animation, channel, &place, Type::Vec3)?;
                        self.nodes[target.node.unwrap_or(0)].position = Some(track);
                    }
                    ("rotation", _) if is_open(|own| own.rotation.is_none()) => {
                        let track = self.track(animation, channel, &place, Type::Vec4)?;
                        self.nodes[target.node.unwrap_or(0)].rotation = Some(track);
                    }
                    ("pointer", Some(Pointer { pointer })) => {
                        let camera = pointer.strip_prefix("/cameras/");
                        let camera = camera.and_then(|own| own.strip_suffix("/perspective/yfov"));
                        let camera: Option<usize> = camera.and_then(|own| own.parse().ok());
                        let slot = camera.and_then(|own| angles.get_mut(own));
                        if let Some(slot) = slot.filter(|slot| slot.is_none()) {
                            *slot = Some(self.track(animation, channel, &place, Type::Scalar)?);
                        }
                    }
                    _ => {}
                }
            }
        }
        let mut shots = Vec::new();
        for (n, node) in self.members.nodes.iter().enumerate() {
            let Some(index) = node.camera else { continue };
            let place = format!("node {n}, camera");
            let expected = "a camera with perspective.yfov or orthographic.ymag";
            let missing = || {
                self.buffers
                    .refuse(place.clone(), expected, format!("camera {index}"))
            };
            let camera = self.members.cameras.get(index).ok_or_else(missing)?;
            let lens = match (&camera.perspective, &camera.orthographic) {
                (Some(own), _) => LensOfShot::Vertical(own.yfov, angles[index].clone(), 1.0),
                // Half the height.
                (None, Some(own)) => LensOfShot::Height(2.0 * own.ymag),
                (None, None) => return Err(missing()),
            };
            let mut chain = Vec::new();
            let mut next = Some(n);
            while let Some(node) = next.filter(|node| *node < self.nodes.len()) {
                chain.push(self.nodes[node].clone());
                next = self.parents[node];
            }
            chain.reverse();
            shots.push(Shot {
                name: node.name.clone().unwrap_or_else(|| n.to_string()),
                nodes: chain,
                lens,
            });
        }
        Ok(shots)
    }

    /// Reads the keys of a channel.
    fn track<const N: usize>(
        &self,
        animation: &Animation,
        channel: &Channel,
        place: &str,
        kind: Type,
    ) -> Result<Track<N>> {
        let refuse =
            |expected: &str, found: String| self.buffers.refuse(place.to_owned(), expected, found);
        let sampler = animation.samplers.get(channel.sampler);
        let sampler =
            sampler.ok_or_else(|| refuse("one of the samplers", channel.sampler.to_string()))?;
        let interpolation = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::Cubic,
            Some(other) => {
                let found = other.chars().take(40).collect();
                return Err(refuse("LINEAR, STEP or CUBICSPLINE", found));
            }
        };
        let open = |index: usize, kind: Type, components: &[ComponentType]| {
            Accessor::open(self.buffers, index, place, &[kind], components)
        };
        let times = open(sampler.input, Type::Scalar, &[ComponentType::F32])?;
        let values = open(sampler.output, kind, ANY_NUMBERS)?;
        let times: Vec<f64> = (0..times.len()).map(|i| times.numbers::<1>(i)[0]).collect();
        let values = (0..values.len()).map(|i| values.numbers(i)).collect();
        Track::new(times, values, interpolation).ok_or_else(|| {
            let expected = "finite keys in the order of time, and as many values";
            refuse(expected, "others".into())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};

    fn fixture() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cameras/moving.gltf")
    }

    /// A point, and the pixels to which three.js 0.187 projects it in pictures of 640 x 480, four a second: its GLTFLoader
    /// and AnimationMixer move the camera, and the angle of view is set to .8 + .2 (t - .5) radians by hand.
    const POINT: DVec3 = DVec3::new(0.3, -0.2, 0.1);
    const PIXELS: [[f64; 2]; 7] = [
        [350.13562, 359.41616],
        [323.13182, 324.46553],
        [311.1091, 295.49973],
        [313.61815, 238.63081],
        [304.53269, 187.06487],
        [294.76356, 149.34734],
        [332.21218, 127.49303],
    ];

    #[test]
    fn a_camera_moves_as_in_three_js() {
        let path = fixture();
        assert!(is_gltf(&path));
        let cameras = read_gltf_cameras(&path, Some([640, 480]), Some(4.0)).unwrap();
        assert_eq!(cameras.len(), PIXELS.len());
        for (i, (own, pixel)) in cameras.iter().zip(PIXELS).enumerate() {
            let at = own.camera.project(POINT).unwrap();
            // three.js takes rotations of 16 bits as they are, whose lengths differ from 1 by 3e-5: of 100 pixels, 3e-3.
            assert!(at.distance(DVec2::from(pixel)) < 5e-3, "{i}: {at}");
        }
        // Without a rate each camera stands at its first key.
        let still = read_gltf_cameras(&path, Some([640, 480]), None).unwrap();
        let names: Vec<&str> = still.iter().map(|own| own.name.as_str()).collect();
        assert_eq!(names, ["eye", "still"]);
        let at = still[0].camera.project(POINT).unwrap();
        assert!(at.distance(DVec2::from(PIXELS[0])) < 5e-3);
        // Half of the height is 1.5: 160 pixels are a unit.
        assert!((still[1].camera.focal_px.y - 160.0).abs() < 1e-9);
    }

    #[test]
    fn damaged_cameras_are_one_error() {
        let good = std::fs::read_to_string(fixture()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        let read = |text: &[u8]| {
            std::fs::write(&path, text).unwrap();
            let still = read_gltf_cameras(&path, None, None).is_ok();
            still && read_gltf_cameras(&path, None, Some(25.0)).is_ok()
        };
        assert!(read(good.as_bytes()));
        let bare = good.split_whitespace().collect::<String>();
        assert!(read(bare.as_bytes()));
        for (old, new) in [
            ("\"camera\":0", "\"camera\":7"),
            ("\"perspective\":{", "\"other\":{"),
            ("\"ymag\":1.5", "\"ymag\":0"),
            ("\"sampler\":1", "\"sampler\":9"),
            ("CUBICSPLINE", "LINEAR"),
            ("\"STEP\"", "\"SMOOTH\""),
            ("\"output\":3", "\"output\":99"),
            ("\"scale\":[2,2,2]", "\"scale\":[2,0,2]"),
            ("\"scale\":[2,2,2]", "\"scale\":[2,9,2]"),
            ("\"children\":[1,2]", "\"children\":[0]"),
            ("\"camera\":", "\"cam\":"),
        ] {
            assert!(bare.contains(old), "{old}");
            assert!(!read(bare.replace(old, new).as_bytes()), "{new}");
        }
        // Four hours take too many pictures.
        let keys = [0.5_f32, 1.0, 2.0].map(f32::to_le_bytes).concat();
        let long = [0.5_f32, 1.0, 14_400.0].map(f32::to_le_bytes).concat();
        use base64::Engine;
        let base64 = base64::engine::general_purpose::STANDARD;
        let (keys, long) = (base64.encode(keys), base64.encode(long));
        assert!(bare.contains(&keys) && !read(bare.replace(&keys, &long).as_bytes()));
        for at in (0..bare.len()).step_by(3) {
            let mut bytes = bare.clone().into_bytes();
            let _ = read(&bytes[..at]);
            bytes[at] ^= 0x15;
            let _ = read(&bytes);
        }
    }
}
