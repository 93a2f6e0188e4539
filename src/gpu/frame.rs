//! Keeps a scene on a device and draws its frames: the scene is uploaded once, and a frame uploads only a
//! camera.
//!
//! If a scene has opaque surfaces and volumes, a frame has two passes. The surfaces are drawn first, and
//! their pixels stay on the device for the volumes among them. Other scenes have one pass. Each band of
//! the image goes through all passes before it is read back.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use wgpu::CommandEncoder;

use super::device::Gpu;
use super::kernel::BoundKernel;
use super::pass::{Bands, Pass, PassFrame, PassKind, Seen, TileCounts};
use super::present::{BoundPresent, Present, check_texture};
use super::rasterise::picture_words;
use super::resolve::{Background, Resolve};
use super::tile::depth_of_word;
use super::timer::{Stage, Timer};
use crate::blocks::BlockedScene;
use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::frame::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::frame::plan::{Draws, FramePlan};
use crate::frame::shadows::ShadowGrids;
use crate::stats::{FrameCounts, StageTimes, Stopwatch};
use crate::task;

/// Bytes of the picture that one thread copies at a time.
const COPY_BYTES: usize = 1 << 20;

/// Volumes on a device, and the memory of their frames.
#[derive(Debug)]
pub(crate) struct DeviceScene {
    gpu: Gpu,
    timer: Timer,
    /// Passes in drawing order.
    passes: Vec<Pass>,
    /// Buffers of the last picture, and those of the samples of its tiles.
    frames: [Option<(FrameKind, Frame)>; 2],
    /// Pipeline for textures of the last texture's format.
    present: Option<Present>,
    shadows: Option<ShadowBuffer>,
}

/// The grids and maps of lights on the device.
#[derive(Debug)]
struct ShadowBuffer {
    buffer: wgpu::Buffer,
    /// Grids and maps that the buffer holds.
    of: Arc<ShadowGrids>,
}

/// Properties by which the buffers of two frames differ.
#[derive(Debug, PartialEq)]
struct FrameKind {
    passes: Vec<PassKind>,
    /// True if the picture stays on the device.
    stays: bool,
}

impl DeviceScene {
    /// Makes an empty scene.
    ///
    /// # Errors
    /// Too little memory on the device.
    pub(crate) fn new(gpu: Gpu) -> Result<Self> {
        Ok(Self {
            timer: Timer::new(&gpu)?,
            passes: Vec::new(),
            frames: [None, None],
            present: None,
            shadows: None,
            gpu,
        })
    }

    /// Draws a frame: its picture into a texture if one is given, and into the images otherwise. Depths
    /// and normals go into the images if the plan asks for them. The caller that drives the future polls
    /// the device. If the future is dropped before its end, the scene stays as it was.
    ///
    /// # Errors
    /// The errors of [`DrawFrames::draw`]; a texture of another size than the plan's, or of an unsupported
    /// format or kind.
    pub(crate) async fn draw_to(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
        texture: Option<&wgpu::Texture>,
    ) -> Result<FrameReport> {
        let mut whole = Stopwatch::start();
        self.gpu.check()?;
        if let Some(texture) = texture {
            check_texture(texture, &plan.camera)?;
            images.resize_beside(plan);
        } else if plan.column().is_some() {
            images.resize_column(plan);
        } else {
            images.resize(plan);
        }
        let gpu = self.gpu.clone();
        if let Some(format) = texture.map(wgpu::Texture::format)
            && self.present.as_ref().is_none_or(|p| p.format != format)
        {
            let present = gpu.watched(|| Present::new(&gpu, format)).await?;
            self.present = Some(present);
        }
        self.upload_shadows(plan)?;
        let kind = FrameKind {
            passes: plan.passes.iter().map(|p| PassKind::of(plan, p)).collect(),
            stays: texture.is_some(),
        };
        let slot = usize::from(plan.tiles.is_some());
        loop {
            let words = self.shadows.as_ref().map(|own| &own.buffer);
            let frame = match self.frames[slot].take() {
                Some((made_for, frame)) if made_for == kind => frame,
                // Free its memory before allocating the next one's.
                other => {
                    drop(other);
                    let make = || Frame::new(&gpu, &self.passes, plan, &kind, words);
                    let made = gpu.watched(make).await.flatten();
                    if made.is_err() {
                        self.frames = [None, None];
                        // Another frame may need less memory than this one.
                        for pass in &mut self.passes {
                            pass.forget_capacity(&gpu);
                        }
                    }
                    made?
                }
            };
            let bound = match texture.zip(self.present.as_ref()) {
                Some((texture, present)) => {
                    let bind = || present.bind(&gpu, frame.picture(), texture);
                    Some(gpu.watched(bind).await.flatten()?)
                }
                None => None,
            };
            let drawn = frame.draw(&gpu, &mut self.timer, scene, plan, images, bound.as_ref());
            let seen = drawn.await?;
            let mut fits = true;
            for ((pass, kind), seen) in self.passes.iter_mut().zip(&kind.passes).zip(&seen) {
                fits &= !pass.grow(&gpu, kind, seen)?;
            }
            if fits {
                let counts = self.counts(scene, &kind.passes, &seen);
                self.frames[slot] = Some((kind, frame));
                let times = self.timer.read(&gpu).await?;
                return Ok(FrameReport {
                    counts,
                    times: StageTimes {
                        frame: whole.lap(),
                        ..times
                    },
                });
            }
            // The buffers of the other frame are too small, too.
            self.frames = [None, None];
        }
    }

    /// Uploads the shadows of a plan unless they are on the device.
    fn upload_shadows(&mut self, plan: &FramePlan) -> Result<()> {
        /// Words of a buffer for each word that is needed, so that other directions of the lights fit, too.
        const ROOM: f64 = 1.25;
        let Some((grids, _)) = &plan.shadows else {
            return Ok(());
        };
        let is_there = |own: &ShadowBuffer| Arc::ptr_eq(&own.of, grids);
        if self.shadows.as_ref().is_some_and(is_there) {
            return Ok(());
        }
        let own = self.shadows.take();
        let bytes = size_of_val(grids.words()) as u64;
        let kept = own.filter(|own| own.buffer.size() >= bytes);
        let buffer = match kept {
            Some(own) => own.buffer,
            None => {
                // Frames are bound to the buffer before.
                self.frames = [None, None];
                let words = (grids.words().len() as f64 * ROOM) as u64;
                let most = self.gpu.max_binding_bytes().max(bytes);
                self.gpu.buffer("grids of lights", (4 * words).min(most))?
            }
        };
        self.gpu.write(&buffer, bytemuck::cast_slice(grids.words()));
        self.shadows = Some(ShadowBuffer {
            buffer,
            of: Arc::clone(grids),
        });
        Ok(())
    }

    /// Returns the device.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    fn counts(&self, scene: &BlockedScene, kinds: &[PassKind], seen: &[Seen]) -> FrameCounts {
        let mut counts = FrameCounts {
            blocks: scene.block_count(),
            blocks_culled: scene.block_count(),
            ..FrameCounts::default()
        };
        for ((pass, kind), seen) in self.passes.iter().zip(kinds).zip(seen) {
            pass.count(kind, seen, &mut counts);
        }
        counts
    }
}

impl DrawFrames for DeviceScene {
    fn adapter(&self) -> Option<String> {
        Some(self.gpu.adapter())
    }

    fn upload(&mut self, scene: &BlockedScene) -> Result<()> {
        let is_any = |draws: Draws| scene.volumes().iter().any(|volume| draws.draws(volume));
        let has_surface = is_any(Draws::Surfaces);
        let is_picture = has_surface && !is_any(Draws::Volumes);
        let kinds = [
            has_surface.then_some((Draws::Surfaces, is_picture)),
            (!is_picture).then_some((Draws::Volumes, true)),
        ];
        self.frames = [None, None];
        self.passes.clear();
        for (draws, is_picture) in kinds.into_iter().flatten() {
            self.passes
                .push(Pass::new(&self.gpu, draws, is_picture, scene)?);
        }
        Ok(())
    }

    fn edit(&mut self, scene: &BlockedScene, edit: Edit) -> Result<()> {
        let volume = match edit {
            Edit::TransferFunction(volume) => volume,
            // Particles are stored in the order of their values.
            Edit::Values => return self.upload(scene),
        };
        let family = scene.family(volume);
        for pass in &self.passes {
            pass.scene.set_transfer_function(&self.gpu, volume, family);
        }
        Ok(())
    }

    fn draw(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<FrameReport> {
        let gpu = self.gpu.clone();
        gpu.block_on(self.draw_to(scene, plan, images, None))
    }
}

/// Buffers and bindings of frames of one kind.
#[derive(Debug)]
struct Frame {
    /// One for each pass of the scene. The last one's pixels are the picture.
    passes: Vec<PassFrame>,
    bands: Bands,
    background: wgpu::Buffer,
    resolve: BoundKernel,
    /// Words of a pixel that stay on the device: those of its colour, or none.
    staying_words: u64,
    /// Staging buffer of the other words, if there are any.
    pixels_back: Option<wgpu::Buffer>,
    normals_back: Option<wgpu::Buffer>,
}

/// Floats of a pixel's colour and opacity, before those of its depth.
const COLOUR_WORDS: u64 = 4;

/// Floats of a pixel of a surface before its normal.
const WORDS_BEFORE_NORMALS: u64 = 5;

impl Frame {
    fn new(
        gpu: &Gpu,
        passes: &[Pass],
        plan: &FramePlan,
        kind: &FrameKind,
        shadow_words: Option<&wgpu::Buffer>,
    ) -> Result<Self> {
        let kinds = &kind.passes;
        let size = [plan.camera.width as u32, plan.camera.height as u32];
        let tiles = size.map(|n| n.div_ceil(TILE_SIZE as u32));
        let mut rows = tiles[1];
        for (pass, kind) in passes.iter().zip(kinds) {
            rows = rows.min(pass.band_rows(gpu, kind)?);
        }
        let bands = Bands { size, tiles, rows };
        let background = gpu.uniform("background", &Background::new(None, false, 0))?;
        let mut made: Vec<PassFrame> = Vec::with_capacity(passes.len());
        for ((pass, kind), of_plan) in passes.iter().zip(kinds).zip(&plan.passes) {
            let surface = made.last().map(|surface| &surface.pixels);
            made.push(PassFrame::new(
                gpu,
                pass,
                &of_plan.view,
                kind,
                bands,
                surface,
                shadow_words,
                &background,
            )?);
        }
        // There is at least one pass.
        let picture = &made[made.len() - 1].pixels;
        let pixels = bands.most_pixels();
        let has_surface = passes.iter().any(|pass| pass.draws == Draws::Surfaces);
        let has_normals = plan.normals && has_surface;
        let normals_back = has_normals.then(|| gpu.staging("normals", 12 * pixels));
        let staying_words = if kind.stays { COLOUR_WORDS } else { 0 };
        let words = picture_words(plan.depth) - staying_words;
        let pixels_back = (words > 0).then(|| gpu.staging("picture", 4 * words * pixels));
        Ok(Self {
            resolve: Resolve::new(gpu).bind(gpu, &background, picture),
            staying_words,
            pixels_back: pixels_back.transpose()?,
            normals_back: normals_back.transpose()?,
            background,
            bands,
            passes: made,
        })
    }

    /// Returns a band's pixels, after drawing.
    fn picture(&self) -> &wgpu::Buffer {
        &self.passes[self.passes.len() - 1].pixels
    }

    async fn draw(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
        present: Option<&BoundPresent<'_>>,
    ) -> Result<Vec<Seen>> {
        timer.clear();
        images.largest = 0.0;
        gpu.watched(|| {
            for (pass, of_plan) in self.passes.iter().zip(&plan.passes) {
                pass.begin(gpu, timer, plan, of_plan, scene.carried());
            }
        })
        .await?;
        let mut tiles = vec![TileCounts::default(); self.passes.len()];
        let bands = self.bands.count();
        let progress = task::Stage::new(plan.task.as_ref(), "drawing", bands as usize);
        for band in 0..bands {
            progress.check()?;
            gpu.watched(|| self.submit_band(gpu, timer, plan, band, present))
                .await?;
            match plan.column() {
                Some((_, per_mass)) => self.read_columns(gpu, per_mass, band, images).await?,
                None => self.read_band(gpu, plan, band, images).await?,
            }
            for (pass, counts) in self.passes.iter().zip(&mut tiles) {
                pass.read_tiles(gpu, band, counts).await?;
            }
            progress.advance(1);
        }
        progress.check()?;
        let mut seen = Vec::with_capacity(tiles.len());
        for (pass, tiles) in self.passes.iter().zip(tiles) {
            seen.push(pass.read_report(gpu, tiles).await?);
        }
        Ok(seen)
    }

    /// Submits all passes of a band, and its copy into a texture or back to the host.
    fn submit_band(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        plan: &FramePlan,
        band: u32,
        present: Option<&BoundPresent<'_>>,
    ) {
        let pixels = self.bands.pixels(band);
        let background = Background::new(plan.background, plan.is_encoded, pixels);
        gpu.write(&self.background, bytemuck::bytes_of(&background));
        for pass in &self.passes {
            pass.draw_band(gpu, timer, plan, band);
        }
        let mut encoder = gpu.encoder();
        self.encode_band_end(&mut encoder, timer, plan, &background);
        if let Some(present) = present {
            present.encode(gpu, &mut encoder, &self.bands, band);
        }
        if band + 1 == self.bands.count() {
            timer.finish(&mut encoder);
        }
        gpu.submit(encoder);
    }

    /// Encodes the background, and the copy to the host.
    fn encode_band_end(
        &self,
        encoder: &mut CommandEncoder,
        timer: &mut Timer,
        plan: &FramePlan,
        background: &Background,
    ) {
        let pixels = background.pixels;
        if background.is_needed() {
            let mut pass = timer.pass(encoder, Stage::Resolve);
            self.resolve.dispatch(&mut pass, Resolve::groups(pixels));
        }
        let pixels = u64::from(pixels);
        if let Some(pixels_back) = &self.pixels_back {
            let first = 4 * self.staying_words * pixels;
            let bytes = 4 * picture_words(plan.depth) * pixels - first;
            encoder.copy_buffer_to_buffer(self.picture(), first, pixels_back, 0, bytes);
        }
        if let Some(normals_back) = &self.normals_back {
            let surface = &self.passes[0].pixels;
            let first = 4 * WORDS_BEFORE_NORMALS * pixels;
            encoder.copy_buffer_to_buffer(surface, first, normals_back, 0, 12 * pixels);
        }
    }

    /// Adds up the sums of a band's column densities.
    ///
    /// - `per_mass`: field x length per unit of mass in a sum.
    async fn read_columns(
        &self,
        gpu: &Gpu,
        per_mass: f64,
        band: u32,
        images: &mut Images,
    ) -> Result<()> {
        let Some(pixels_back) = &self.pixels_back else {
            return Ok(());
        };
        let (first_row, _) = self.bands.band(band);
        let Images {
            column, largest, ..
        } = images;
        let first = first_row as usize * TILE_SIZE * column.width;
        let count = self.bands.pixels(band) as usize;
        gpu.read_staging(pixels_back, |bytes| {
            let sums = bytemuck::cast_slice::<u8, [f32; 4]>(&bytes[..16 * count]);
            let values = &mut column.values[first..first + count];
            for (value, sums) in values.iter_mut().zip(sums) {
                // From 0, and the coarsest first, because they are the largest.
                let sum = sums
                    .iter()
                    .rev()
                    .fold(0.0, |sum, part| sum + f64::from(*part));
                let density = sum * per_mass;
                // Phrased so that `max` would not lose a NaN.
                if !(density.abs() <= *largest) {
                    *largest = density.abs();
                }
                *value = density as f32;
            }
        })
        .await
    }

    /// Copies a band's rows into the images.
    async fn read_band(
        &self,
        gpu: &Gpu,
        plan: &FramePlan,
        band: u32,
        images: &mut Images,
    ) -> Result<()> {
        let (first_row, _) = self.bands.band(band);
        let Images {
            image,
            depth,
            normals,
            ..
        } = images;
        let first = first_row as usize * TILE_SIZE * plan.camera.width;
        let count = self.bands.pixels(band) as usize;
        if let Some(pixels_back) = &self.pixels_back {
            let colour_words = COLOUR_WORDS - self.staying_words;
            let read = gpu.read_staging(pixels_back, |bytes| {
                let (colours, depths) = bytes.split_at(4 * colour_words as usize * count);
                if !colours.is_empty() {
                    let pixels = &mut image.pixels[first..first + count];
                    // On a graphics card a copy by one thread would take longer than the frame.
                    bytemuck::cast_slice_mut::<_, u8>(pixels)
                        .par_chunks_mut(COPY_BYTES)
                        .zip(colours.par_chunks(COPY_BYTES))
                        .for_each(|(to, from)| to.copy_from_slice(from));
                }
                if let Some(depth) = depth {
                    let words = bytemuck::cast_slice::<u8, f32>(&depths[..4 * count]);
                    for (out, word) in depth.depths[first..first + count].iter_mut().zip(words) {
                        *out = depth_of_word(*word);
                    }
                }
            });
            read.await?;
        }
        if let (Some(normals_back), Some(normals)) = (&self.normals_back, normals) {
            let world_from_camera = plan.camera.camera_from_world.as_mat3().transpose();
            gpu.read_staging(normals_back, |bytes| {
                let words = bytemuck::cast_slice::<u8, [f32; 3]>(&bytes[..12 * count]);
                let out = &mut normals.normals[first..first + count];
                for (out, normal) in out.iter_mut().zip(words) {
                    *out = (world_from_camera * Vec3::from(*normal)).into();
                }
            })
            .await?;
        }
        Ok(())
    }
}
