//! Prepared scenes: blocks, levels of detail and what bounds them in a file, which is mapped into memory and not read.
//!
//! A file is in Arrow's IPC format, uncompressed. Each volume of a scene and each of its levels of detail is one record
//! batch, with **one row per block**: what bounds it, and lists of what its particles have. A list column's elements lie
//! one after the other for the whole batch, so that a renderer borrows them as slices; pages of blocks that no frame
//! asks for are never read.
//!
//! | file | subject |
//! |---|---|
//! | `columns.rs` | the columns: their names, and what they hold |
//! | `about.rs` | what is said of a scene beside its columns, as JSON |
//! | `file.rs` | Arrow's IPC format: where columns lie in a file |
//! | `write.rs` | a scene to a file |
//! | `read.rs` | a file to a scene, and what is refused of damaged ones |
//! | `point_file.rs` | points of a file as a stream of particles |

pub(crate) mod about;
mod columns;
mod file;
mod point_file;
mod read;
mod write;

use std::path::Path;

pub use about::About;
pub(crate) use point_file::Found;
pub use point_file::PointFile;
#[cfg(feature = "cli")]
pub(crate) use point_file::ROWS;

pub use crate::blocks::ParticleStream;
use crate::blocks::{BlockedParticles, BlockedScene, BlockedVolume, SceneOptions};
use crate::error::Result;
use crate::scene::{
    Colour, ColourIn, Particles, PointVolume, Requirements, Strength, StrengthIn, TransferFunction,
};

/// A scene that is ready to be drawn, in memory or in a file.
///
/// ```
/// use ewa_splat::prepared::{About, PreparedScene};
/// use ewa_splat::{Renderer, SceneOptions, Settings, scene::PointVolume, view::Camera};
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
/// let mut renderer = Renderer::of_prepared(vec![mapped])?;
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
    /// Those of [`Renderer::with_options`](crate::Renderer::with_options).
    pub fn new(volumes: Vec<PointVolume>, options: &SceneOptions) -> Result<Self> {
        Ok(Self {
            scene: BlockedScene::new(volumes, options)?,
        })
    }

    /// As [`PreparedScene::new`], of a volume of points that come a part at a time, the same to the last bit. They are
    /// sorted in temporary files, and so lie in memory what a tree over them knows (some 20 bytes for each while they
    /// are sorted, where blocks take as many) and a part of them at a time.
    ///
    /// - `folder`: where these files may lie, some 80 bytes for each particle. They have no names, and are gone with the
    ///   scene.
    ///
    /// # Errors
    /// Parts of several kinds; lattices, boundaries, local models and normals, which are made of all particles at once;
    /// those of the stream; a disk that is full.
    pub fn of_stream(
        stream: &mut dyn ParticleStream,
        options: &SceneOptions,
        folder: &Path,
    ) -> Result<Self> {
        Ok(Self {
            scene: BlockedScene::of_stream(stream, options, folder)?,
        })
    }

    /// Maps a file into memory. What is said of the scene and what bounds its blocks is read; particles are not.
    ///
    /// The file must not change as long as the scene is there: bytes that are written to it appear in pictures, and
    /// where it is cut short the system ends the program.
    ///
    /// # Errors
    /// A file that cannot be read, is of another format or version, or is damaged.
    pub fn open(path: &Path) -> Result<(Self, About)> {
        let (scene, about) = read::open(path)?;
        Ok((Self { scene }, about))
    }

    /// As [`PreparedScene::open`], of a file's bytes.
    ///
    /// # Errors
    /// Those of [`PreparedScene::open`], and bytes that are not aligned to 64.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<(Self, About)> {
        let (scene, about) = read::of_bytes(name, crate::scene::map::aligned(&bytes))?;
        Ok((Self { scene }, about))
    }

    /// Writes the scene, whole or not at all; returns how many bytes it took.
    ///
    /// # Errors
    /// A scene with numbers that JSON cannot hold, or a file that cannot be written.
    pub fn write(&self, path: &Path, about: &About) -> Result<u64> {
        write::write(path, &self.scene, about)
    }

    /// How many particles all volumes have.
    pub fn particle_count(&self) -> usize {
        self.scene.particle_count()
    }

    /// Bytes kept per particle, blocks and levels of detail included.
    pub fn bytes_per_particle(&self) -> f64 {
        self.scene.bytes_per_particle()
    }

    /// What each volume requires.
    pub fn requirements(&self) -> &[Requirements] {
        self.scene.requirements()
    }

    /// The volumes in blocks, each with its levels of detail after it.
    pub fn volumes(&self) -> &[BlockedVolume] {
        self.scene.volumes()
    }

    /// The transfer function of each volume that has one.
    pub fn transfer_functions(&self) -> Vec<Option<TransferFunction>> {
        let volumes = 0..self.scene.families().len();
        let shown = volumes.map(|volume| self.scene.shown_function(volume).cloned());
        shown.collect()
    }

    /// Replaces the transfer function of a volume; no particle is touched.
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

    /// A volume without particles for each of the scene's: of the same kind, with the same transfer function, and with
    /// normals where it has some. What is asked of the kinds of volumes can be asked of these.
    #[must_use]
    pub fn stand_ins(&self) -> Vec<PointVolume> {
        self.scene.data().map(stand_in).collect()
    }

    /// The scene that stages take.
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
        strength: match volume.strength {
            StrengthIn::Classified { .. } => Strength::Classified {
                volumes: Vec::new(),
            },
            StrengthIn::Mass(_) => Strength::Mass(Vec::new()),
            StrengthIn::PeakOpacity {
                is_anti_aliased, ..
            } => Strength::PeakOpacity {
                opacities: Vec::new(),
                is_anti_aliased,
            },
            StrengthIn::Surface(_) => Strength::Surface(Vec::new()),
            StrengthIn::Translucent(_) => Strength::Translucent(Vec::new()),
        },
        colour: match volume.colour {
            ColourIn::Classified => Colour::Classified,
            ColourIn::Uniform(colour) => Colour::Uniform(colour),
            ColourIn::PerParticle(_) | ColourIn::Harmonics { .. } => {
                Colour::PerParticle(Vec::new())
            }
        },
        values: None,
        transfer_function: volume.transfer_function.clone(),
        boundary: None,
        normals: volume.normals.as_ref().map(|_| Vec::new()),
        local_models: None,
    }
}

/// Whether a file is in the format of prepared scenes, by its first bytes.
pub fn looks_like(head: &[u8]) -> bool {
    head.starts_with(file::MAGIC)
}
