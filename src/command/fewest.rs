//! Finds the fewest splats that show a mesh with a stated error.
//!
//! Viewers widen splats, so that every outline is a pixel too wide, however many splats there are. Pixels at outlines are
//! therefore not compared.

use glam::DVec3;
use serde_json::{Value, json};

use super::fewer::{Pictures, percentile};
use crate::Result;
use crate::data::mesh::Mesh;
use crate::data::splats::SplatCloud;
use crate::image::Image;
use crate::reference::{MeshTracer, MeshTracerSettings};
use crate::splat::SPLAT_LOW_PASS_PX2;
use crate::view::{Camera, Projection};

/// Rays of each pixel in pictures of a mesh. The codes of pixels on outlines have errors of about .02.
const RAYS: usize = 36;
/// Distance from an outline up to which pixels are not compared, pixels: three standard deviations of a viewer's filter.
const OUTLINE_PX: usize = 2;
/// Second difference of distances between neighbouring pixels that makes an outline, in pixels at that distance.
const JUMP_PX: f64 = 8.0;
/// Number of splats of one try, as a share of the next larger.
const STEP: f64 = 0.8;

/// Pictures of a mesh and of all its splats from the same sides.
struct Compared {
    pictures: Pictures,
    truth: Vec<Image>,
    /// The pixels that are compared, of each picture.
    inside: Vec<Vec<bool>>,
}

impl Compared {
    fn new(mesh: &Mesh, cloud: SplatCloud, up: DVec3) -> Result<Self> {
        let pictures = Pictures::of(cloud, up)?;
        let tracer = MeshTracer::new(mesh);
        let settings = MeshTracerSettings {
            variance_px2: SPLAT_LOW_PASS_PX2.into(),
            rays: RAYS,
            blends_codes: true,
        };
        let truth = pictures.cameras.iter();
        let truth: Vec<Image> = truth
            .map(|camera| tracer.render(camera, &settings))
            .collect();
        let pairs = truth.iter().zip(&pictures.cameras);
        let inside = pairs.map(|(image, camera)| inside(image, &tracer.distances(camera), camera));
        let inside = inside.collect();
        Ok(Self {
            pictures,
            truth,
            inside,
        })
    }

    /// Returns the error of splats, of which `images` are the pictures.
    fn error(&self, images: &[Image]) -> f64 {
        percentile(&self.truth, images, Some(&self.inside))
    }
}

/// Returns the pixels that are farther than [`OUTLINE_PX`] from an outline; all, if these are less than half of what the mesh
/// covers. Outlines are where the opacity or the distance jumps: parts of a mesh before others have outlines, too.
///
/// - `distances`: distance to what each pixel shows.
fn inside(image: &Image, distances: &[f64], camera: &Camera) -> Vec<bool> {
    let (width, height) = (image.width, image.height);
    let jumps = |before: usize, at: usize, after: usize| {
        let [a, b, c] = [before, at, after].map(|i| distances[i]);
        let length = match camera.projection {
            Projection::Perspective => b / camera.focal_px.x,
            Projection::Orthographic => 1.0 / camera.focal_px.x,
        };
        // Where all three are infinite, nothing is seen.
        b.is_finite() && !((a - 2.0 * b + c).abs() < JUMP_PX * length)
    };
    let is_outline = |x: usize, y: usize| {
        let at = y * width + x;
        let across = x > 0 && x + 1 < width && jumps(at - 1, at, at + 1);
        across || (y > 0 && y + 1 < height && jumps(at - width, at, at + width))
    };
    let near =
        |at: usize, end: usize| at.saturating_sub(OUTLINE_PX)..(at + OUTLINE_PX + 1).min(end);
    let is_inside = |i: usize| {
        let around =
            near(i / width, height).flat_map(|y| near(i % width, width).map(move |x| (x, y)));
        // Panes have the same opacity around.
        let first = image.pixels[i][3];
        let same = |&(x, y): &(usize, usize)| {
            (image.pixels[y * width + x][3] - first).abs() < 0.5 / 255.0 && !is_outline(x, y)
        };
        around.into_iter().all(|at| same(&at))
    };
    let found: Vec<bool> = (0..image.pixels.len()).map(is_inside).collect();
    let is_covered = |i: &usize| image.pixels[*i][3] > 0.0;
    let covered = (0..found.len()).filter(is_covered).count();
    let left = (0..found.len()).filter(is_covered).filter(|i| found[*i]);
    match 2 * left.count() < covered {
        true => vec![true; found.len()],
        false => found,
    }
}

/// Makes fewer splats of a mesh, as long as 99.9 % of the compared pixels in pictures from four sides differ from the mesh itself by no
/// more than stated. Returns `all` if they differ by more already.
///
/// Numbers of splats fall in steps of a fifth. The step is found by bisection, as if each had a larger error than the one before.
///
/// - `cloud`: returns the splats of what is made.
/// - `most`: greatest difference of sRGB codes, 0 to 1.
/// - `up`: direction that points up.
/// - `make`: makes about as many splats as stated.
///
/// # Errors
/// The errors of drawing and of `make`.
pub(super) fn fewest<T>(
    mesh: &Mesh,
    all: T,
    cloud: impl Fn(&T) -> &SplatCloud,
    (most, up): (f64, DVec3),
    make: impl Fn(usize) -> Result<T>,
) -> Result<(T, Value)> {
    let given = cloud(&all).positions.len();
    let compared = Compared::new(mesh, cloud(&all).clone(), up)?;
    let pictures = &compared.pictures;
    let of_all = compared.error(&pictures.images);
    let (mut best, mut best_error) = (all, of_all);
    let number = |step: u32| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let number = (given as f64 * STEP.powf(step.into())) as usize;
        number.max(1)
    };
    // The step `good` has an error that is small enough; `bad` has none, or no splats.
    let (mut good, mut bad) = (0, 1);
    while number(bad) > 1 {
        bad += 1;
    }
    while of_all <= most && bad - good > 1 {
        let step = good.midpoint(bad);
        let few = make(number(step))?;
        let error = compared.error(&pictures.again(cloud(&few).clone())?);
        if error <= most {
            (good, best, best_error) = (step, few, error);
        } else {
            bad = step;
        }
    }
    let mut summary = pictures.summary(given, cloud(&best))?;
    summary["mesh"] = json!({ "given": of_all, "splats": best_error });
    Ok((best, summary))
}
