//! Stores prepared scenes in files: blocks, levels of detail and their bounds. A file is mapped into memory rather than
//! read.
//!
//! A file is in Arrow's IPC format, uncompressed. Each volume of a scene and each of its levels of detail is one record
//! batch, with **one row per block**: the block's bounds, and lists with the columns of its particles. The elements of
//! a list column are contiguous over the whole batch, so that a renderer borrows them as slices. Pages of blocks that
//! no frame needs are never read.
//!
//! | file | subject |
//! |---|---|
//! | `columns.rs` | the columns: their names and types |
//! | `about.rs` | metadata of a scene, as JSON |
//! | `file.rs` | Arrow's IPC format: places of columns in a file |
//! | `write.rs` | writing a scene |
//! | `read.rs` | reading a scene, and checks for damaged files |
//! | `point_file.rs` | points of a file as a stream of particles |

pub(crate) mod about;
mod columns;
mod file;
mod point_file;
mod read;
mod write;

use std::path::Path;

pub use about::About;
pub use point_file::PointFile;

pub use crate::blocks::ParticleStream;
use crate::blocks::{BlockedParticles, BlockedScene, BlockedVolume, SceneOptions};
use crate::error::Result;
use crate::scene::headers::{ColourHeader, StrengthHeader};
use crate::scene::{Colour, Particles, PointVolume, Requirements, TransferFunction};

/// A scene that is ready to be rendered, in memory or in a file.
///
/// ```
/// use ewa_splat::prepared::{About, PreparedScene};
/// use ewa_splat::{Renderer, RendererOptions, SceneOptions, Settings, scene::PointVolume, view::Camera};
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("ball.arrow");
/// let ball = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
/// let camera = Camera::perspective(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
/// let scene = PreparedScene::new(vec![ball.clone()], &SceneOptions::default())?;
/// scene.write(&path, &About::default())?;
/// let (mapped, _) = PreparedScene::open(&path)?;
/// let mut renderer = Renderer::with_options(vec![mapped], RendererOptions::default())?;
/// let picture = renderer.render(&camera, &Settings::default())?.clone();
/// assert_eq!(&picture, Renderer::new(vec![ball])?.render(&camera, &Settings::default())?);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct PreparedScene {
    scene: BlockedScene,
}

impl PreparedScene {
    /// Sorts volumes into blocks and makes their levels of detail, as [`Renderer::with_options`] does.
    ///
    /// [`Renderer::with_options`]: crate::Renderer::with_options
    ///
    /// # Errors
    /// The errors of [`Renderer::with_options`](crate::Renderer::with_options).
    pub fn new(volumes: Vec<PointVolume>, options: &SceneOptions) -> Result<Self> {
        Ok(Self {
            scene: BlockedScene::new(volumes, options)?,
        })
    }

    /// Prepares a volume of points that arrive a part at a time; the result equals that of [`PreparedScene::new`] to
    /// the last bit.
    ///
    /// The points are sorted in temporary files. Memory holds one part at a time, and the tree over all points: some 20
    /// bytes for each while they are sorted, and as many for their blocks.
    ///
    /// - `folder`: folder for the temporary files, some 80 bytes for each particle. The files have no names, and
    ///   disappear with the scene.
    ///
    /// # Errors
    /// Parts of several kinds; lattices, boundaries, local models and normals, which need all particles at once; the
    /// errors of the stream; a full disk.
    pub fn of_stream(
        stream: &mut dyn ParticleStream,
        options: &SceneOptions,
        folder: &Path,
    ) -> Result<Self> {
        Ok(Self {
            scene: BlockedScene::of_stream(stream, options, folder)?,
        })
    }

    /// Maps a file into memory. Reads the scene's metadata and the blocks' bounds, but no particles.
    ///
    /// The file must not change while the scene exists: bytes that are written to it appear in images, and if it is
    /// truncated, the system ends the program.
    ///
    /// # Errors
    /// A file that cannot be read, has another format or version, or is damaged.
    pub fn open(path: &Path) -> Result<(Self, About)> {
        let (scene, about) = read::open(path)?;
        Ok((Self { scene }, about))
    }

    /// Opens a scene from the bytes of a file, as [`PreparedScene::open`] does.
    ///
    /// # Errors
    /// The errors of [`PreparedScene::open`], and bytes that are not aligned to 64.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<(Self, About)> {
        let (scene, about) = read::of_bytes(name, crate::scene::map::aligned(&bytes))?;
        Ok((Self { scene }, about))
    }

    /// Writes the scene, entirely or not at all; returns the number of bytes written.
    ///
    /// # Errors
    /// A scene with numbers that JSON cannot store, or a file that cannot be written.
    pub fn write(&self, path: &Path, about: &About) -> Result<u64> {
        write::write(path, &self.scene, about)
    }

    /// Number of particles in all volumes.
    pub fn particle_count(&self) -> usize {
        self.scene.particle_count()
    }

    /// Bytes kept per particle, including blocks and levels of detail.
    pub fn bytes_per_particle(&self) -> f64 {
        self.scene.bytes_per_particle()
    }

    /// Features that a frame needs to draw each volume.
    pub fn requirements(&self) -> &[Requirements] {
        self.scene.requirements()
    }

    /// Volumes in blocks, each followed by its levels of detail.
    pub fn volumes(&self) -> &[BlockedVolume] {
        self.scene.volumes()
    }

    /// Returns the transfer function of each volume, if it has one.
    pub fn transfer_functions(&self) -> Vec<Option<TransferFunction>> {
        let volumes = 0..self.scene.families().len();
        let shown = volumes.map(|volume| self.scene.shown_function(volume).cloned());
        shown.collect()
    }

    /// Replaces the transfer function of a volume; no particle changes.
    ///
    /// # Errors
    /// No such volume, or one that is not classified.
    pub fn set_transfer_function(
        &mut self,
        volume: usize,
        transfer: TransferFunction,
    ) -> Result<()> {
        self.scene.set_transfer_function(volume, transfer)
    }

    /// Returns a volume without particles for each volume of the scene, of the same kind and with the same transfer
    /// function. It has normals if the volume does. Use these where only the kinds of volumes matter.
    #[must_use]
    pub fn stand_ins(&self) -> Vec<PointVolume> {
        self.scene.data().map(stand_in).collect()
    }

    /// Takes the scene in blocks.
    pub(crate) fn into_scene(self) -> BlockedScene {
        self.scene
    }
}

fn stand_in(volume: &BlockedVolume) -> PointVolume {
    PointVolume {
        particles: match &volume.particles {
            BlockedParticles::Surfels { is_one_sided, .. } => Particles::Surfels {
                positions: Vec::new(),
                tangents: Vec::new(),
                is_one_sided: *is_one_sided,
            },
            _ => Particles::Anisotropic {
                positions: Vec::new(),
                factors: Vec::new(),
            },
        },
        strength: StrengthHeader::of(&volume.strength).empty(),
        colour: match ColourHeader::of(&volume.colour) {
            ColourHeader::Harmonics { .. } => Colour::PerParticle(Vec::new()),
            other => other.empty(),
        },
        values: None,
        transfer_function: volume.transfer_function.clone(),
        boundary: None,
        normals: volume.normals.as_ref().map(|_| Vec::new()),
        local_models: None,
    }
}

/// Whether the first bytes of a file are those of a prepared scene.
pub fn looks_like(head: &[u8]) -> bool {
    head.starts_with(file::MAGIC)
}
