//! Reads the cameras of COLMAP's models, as text or binary.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::{Distortion, Optics, Stated, fault, size_of};
use crate::error::{Error, Result};

/// A model's two files that describe cameras.
pub(super) struct Model {
    images: PathBuf,
    cameras: PathBuf,
    is_binary: bool,
}

/// Returns the model that a path names: its folder, or its file of images or of cameras.
pub(super) fn model_of(path: &Path) -> Option<Model> {
    let folder = match path.is_dir() {
        true => path,
        false => {
            let stem = path.file_stem()?;
            let is_part = stem == "images" || stem == "cameras";
            let is_model = path.extension().is_some_and(|e| e == "bin" || e == "txt");
            (is_part && is_model).then(|| path.parent())??
        }
    };
    let wanted = path.extension().filter(|_| !path.is_dir());
    let has_binary = folder.join("images.bin").is_file();
    let is_binary = wanted.map_or(has_binary, |extension| extension == "bin");
    let extension = if is_binary { "bin" } else { "txt" };
    let part = |name: &str| folder.join(name).with_extension(extension);
    Some(Model {
        images: part("images"),
        cameras: part("cameras"),
        is_binary,
    })
}

/// COLMAP's kinds of lenses, by their numbers: name, parameters, and how many of the first are focal lengths; 0 for lenses that
/// are refused. The optical axis follows the focal lengths, distortion follows it.
const LENSES: [(&str, usize, usize); 11] = [
    ("SIMPLE_PINHOLE", 3, 1),
    ("PINHOLE", 4, 2),
    ("SIMPLE_RADIAL", 4, 1),
    ("RADIAL", 5, 1),
    ("OPENCV", 8, 2),
    ("OPENCV_FISHEYE", 8, 2),
    ("FULL_OPENCV", 12, 2),
    ("FOV", 5, 0),
    ("SIMPLE_RADIAL_FISHEYE", 4, 1),
    ("RADIAL_FISHEYE", 5, 1),
    ("THIN_PRISM_FISHEYE", 12, 0),
];

/// A lens and its distortion.
type Lens = (Optics, Option<Distortion>);

/// Returns the distortion of a lens by its parameters behind the optical axis.
fn distortion(model: &str, terms: &[f64]) -> Option<Distortion> {
    let term = |i: usize| terms.get(i).copied().unwrap_or(0.0);
    if model.ends_with("FISHEYE") {
        return Some(Distortion::Fisheye([term(0), term(1), term(2), term(3)]));
    }
    let is_open_cv = model.ends_with("OPENCV");
    // OpenCV's tangential terms stand between its second and its third radial one.
    let radial = |i: usize| if is_open_cv { term(i + 2) } else { 0.0 };
    let p = if is_open_cv {
        [term(2), term(3)]
    } else {
        [0.0; 2]
    };
    terms
        .iter()
        .any(|term| *term != 0.0)
        .then(|| Distortion::Radial {
            above: [term(0), term(1), radial(2), 0.0],
            below: [radial(3), radial(4), radial(5)],
            p,
        })
}

/// Pose of a picture in a file: quaternion (w, x, y, z) and translation of the map from world to camera, camera, name.
struct Image {
    rotation: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: String,
}

fn lens(
    path: &Path,
    id: u32,
    model: &str,
    [width, height]: [f64; 2],
    numbers: &[f64],
) -> Result<Lens> {
    let place = || format!("camera {id}");
    let known = LENSES.iter().find(|(name, ..)| *name == model);
    let &(_, count, focal) = known.filter(|(.., focal)| *focal > 0).ok_or_else(|| {
        fault(
            path,
            place(),
            "a pinhole camera, distorted or not, or a fisheye without a prism",
            model,
        )
    })?;
    if numbers.len() != count {
        return Err(fault(
            path,
            place(),
            &format!("{count} parameters of {model}"),
            numbers.len().to_string(),
        ));
    }
    let size = size_of(width, height).ok_or_else(|| {
        fault(
            path,
            place(),
            "a size of 1 to 65535 pixels",
            format!("{width} x {height}"),
        )
    })?;
    let optics = Optics::Calibrated {
        focal_px: DVec2::new(numbers[0], numbers[focal - 1]),
        centre_px: DVec2::new(numbers[focal], numbers[focal + 1]),
        size,
    };
    Ok((optics, distortion(model, &numbers[focal + 2..])))
}

impl Model {
    /// Reads the cameras, in the order of their pictures' names.
    pub(super) fn read(&self) -> Result<Vec<Stated>> {
        let images = match self.is_binary {
            true => binary_images(&self.images)?,
            false => text_images(&self.images)?,
        };
        // A lens that no picture uses may be of any kind.
        let used: BTreeSet<u32> = images.iter().map(|image| image.camera).collect();
        let lenses = match self.is_binary {
            true => binary_lenses(&self.cameras, &used)?,
            false => text_lenses(&self.cameras, &used)?,
        };
        let mut cameras: Vec<Stated> = Vec::new();
        for image in images {
            let (optics, distortion) = *lenses.get(&image.camera).ok_or_else(|| {
                let expected = format!("a camera of {}", self.cameras.display());
                fault(
                    &self.images,
                    format!("image {}", image.name),
                    &expected,
                    format!("camera {}", image.camera),
                )
            })?;
            let [w, x, y, z] = image.rotation;
            let turn = DQuat::from_xyzw(x, y, z, w);
            let length = turn.length();
            if !(length > 0.5 && length < 2.0) {
                let found = format!("{:?}", image.rotation);
                return Err(fault(
                    &self.images,
                    format!("image {}", image.name),
                    "a unit quaternion",
                    found,
                ));
            }
            let camera_from_world = DMat3::from_quat(turn.normalize());
            cameras.push(Stated {
                name: image.name,
                eye: -(camera_from_world.transpose() * DVec3::from(image.translation)),
                camera_from_world,
                optics,
                distortion,
            });
        }
        cameras.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(cameras)
    }
}

fn open(path: &Path) -> Result<BufReader<File>> {
    let file = File::open(path).map_err(|e| {
        Error::io(
            path,
            "opening the cameras",
            e,
            "name the folder with images and cameras, .bin or .txt",
        )
    })?;
    crate::opened::note(path);
    Ok(BufReader::new(file))
}

/// Reads the lines of a file that are no comments.
fn lines(path: &Path) -> Result<impl Iterator<Item = Result<(usize, String)>>> {
    let lines = open(path)?.lines().enumerate();
    let path = path.to_owned();
    let lines = lines.map(move |(i, line)| {
        let line =
            line.map_err(|e| Error::io(&path, "reading the cameras", e, "check the file"))?;
        Ok((i + 1, line))
    });
    Ok(lines.filter(|line| !line.as_ref().is_ok_and(|(_, line)| line.starts_with('#'))))
}

fn text_lenses(path: &Path, used: &BTreeSet<u32>) -> Result<BTreeMap<u32, Lens>> {
    let mut all = BTreeMap::new();
    for line in lines(path)? {
        let (number, line) = line?;
        let wrong = || {
            let expected = "number, lens, width, height and parameters of a camera";
            fault(path, format!("line {number}"), expected, clipped(&line))
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let (id, model, numbers) = match words.as_slice() {
            [] => continue,
            [id, model, numbers @ ..] => (id, model, numbers),
            [_] => return Err(wrong()),
        };
        let id = id.parse().map_err(|_| wrong())?;
        let numbers: Vec<f64> = { numbers.iter() }
            .map(|word| word.parse())
            .collect::<Result<_, _>>()
            .map_err(|_| wrong())?;
        let [width, height, parameters @ ..] = numbers.as_slice() else {
            return Err(wrong());
        };
        if used.contains(&id) {
            all.insert(id, lens(path, id, model, [*width, *height], parameters)?);
        }
    }
    Ok(all)
}

fn text_images(path: &Path) -> Result<Vec<Image>> {
    let mut images = Vec::new();
    let mut lines = lines(path)?;
    while let Some(line) = lines.next() {
        let (number, line) = line?;
        if line.trim().is_empty() {
            continue;
        }
        let wrong = || {
            let expected = "number, quaternion, translation, camera and name of an image";
            fault(path, format!("line {number}"), expected, clipped(&line))
        };
        let mut words = line.trim().splitn(10, ' ');
        let mut number_of = || words.next().and_then(|word| word.parse::<f64>().ok());
        let mut numbers = [0.0; 8];
        for number in &mut numbers {
            *number = number_of().ok_or_else(wrong)?;
        }
        let [_, w, x, y, z, translation @ ..] = numbers;
        let camera = words
            .next()
            .and_then(|word| word.parse().ok())
            .ok_or_else(wrong)?;
        let name = words.next().ok_or_else(wrong)?.to_owned();
        images.push(Image {
            rotation: [w, x, y, z],
            translation,
            camera,
            name,
        });
        // Its points in the picture are a line of their own, which may be empty.
        lines.next().transpose()?;
    }
    Ok(images)
}

/// Returns the beginning of a line.
fn clipped(line: &str) -> String {
    line.chars().take(60).collect()
}

/// A binary file with its path for errors.
struct Binary<'a>(&'a Path, BufReader<File>);

impl Binary<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.1.read_exact(&mut bytes).map_err(|e| {
            Error::io(
                self.0,
                "reading the cameras",
                e,
                "the file may have been cut off",
            )
        })?;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }

    fn f64(&mut self) -> Result<f64> {
        Ok(f64::from_le_bytes(self.bytes()?))
    }
}

fn binary_lenses(path: &Path, used: &BTreeSet<u32>) -> Result<BTreeMap<u32, Lens>> {
    let mut file = Binary(path, open(path)?);
    let mut all = BTreeMap::new();
    for _ in 0..file.u64()? {
        let (id, number) = (file.u32()?, file.u32()?);
        let size = [file.u64()? as f64, file.u64()? as f64];
        let known = usize::try_from(number)
            .ok()
            .and_then(|number| LENSES.get(number));
        let &(model, count, _) = known.ok_or_else(|| {
            fault(
                path,
                format!("camera {id}"),
                "a lens of COLMAP",
                number.to_string(),
            )
        })?;
        let numbers: Vec<f64> = (0..count).map(|_| file.f64()).collect::<Result<_>>()?;
        if used.contains(&id) {
            all.insert(id, lens(path, id, model, size, &numbers)?);
        }
    }
    Ok(all)
}

fn binary_images(path: &Path) -> Result<Vec<Image>> {
    /// Bytes of a point in a picture: two coordinates, and the number of a point in space.
    const POINT: u64 = 24;
    let mut file = Binary(path, open(path)?);
    let mut images = Vec::new();
    for _ in 0..file.u64()? {
        let id = file.u32()?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = file.f64()?;
        }
        let [w, x, y, z, translation @ ..] = numbers;
        let camera = file.u32()?;
        let mut name = Vec::new();
        loop {
            match file.bytes()? {
                [0] => break,
                [byte] => name.push(byte),
            }
            if name.len() > 4096 {
                return Err(fault(
                    path,
                    format!("image {id}"),
                    "a name of at most 4096 bytes",
                    "a longer one",
                ));
            }
        }
        let name = String::from_utf8_lossy(&name).into_owned();
        images.push(Image {
            rotation: [w, x, y, z],
            translation,
            camera,
            name,
        });
        let skipped = file
            .u64()?
            .checked_mul(POINT)
            .and_then(|bytes| i64::try_from(bytes).ok());
        let skipped = skipped.ok_or_else(|| {
            fault(
                path,
                format!("image {id}"),
                "a number of points",
                "more than a file holds",
            )
        })?;
        file.1.seek_relative(skipped).map_err(|e| {
            Error::io(
                path,
                "reading the cameras",
                e,
                "the file may have been cut off",
            )
        })?;
    }
    Ok(images)
}
