//! A scene kept on a device, and its frames: the scene is uploaded once, a frame uploads a camera.
//!
//! A frame has two passes where the scene has both: opaque surfaces are drawn first, and their pixels
//! stay on the device for the volumes among which they lie. A scene of one kind has one pass. Band
//! after band of the image takes all passes before it goes back.

use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use wgpu::CommandEncoder;

use super::device::Gpu;
use super::kernel::BoundKernel;
use super::pass::{Bands, Pass, PassFrame, PassKind, Seen, TileCounts};
use super::rasterise::picture_words;
use super::resolve::{Background, Resolve};
use super::tile::depth_of_word;
use super::timer::{Stage, Timer};
use crate::blocks::BlockedScene;
use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::render::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::render::plan::{Draws, FramePlan};
use crate::stats::{FrameCounts, StageTimes};

/// Bytes of the picture that one thread copies at a time.
const COPY_BYTES: usize = 1 << 20;

/// Volumes on a device, and the memory of their frames.
#[derive(Debug)]
pub(crate) struct DeviceScene {
    gpu: Gpu,
    timer: Timer,
    /// In the order in which they are drawn.
    passes: Vec<Pass>,
    frame: Option<(Vec<PassKind>, Frame)>,
}

impl DeviceScene {
    /// Nothing yet.
    ///
    /// # Errors
    /// Too little memory on the device.
    pub(crate) fn new(gpu: Gpu) -> Result<Self> {
        Ok(Self {
            timer: Timer::new(&gpu)?,
            passes: Vec::new(),
            frame: None,
            gpu,
        })
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
        self.frame = None;
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
            // Particles lie in the order of their values.
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
        let start = Instant::now();
        self.gpu.check()?;
        if plan.column().is_some() {
            images.resize_column(plan);
        } else {
            images.resize(plan);
        }
        let kinds: Vec<_> = plan.passes.iter().map(|p| PassKind::of(plan, p)).collect();
        loop {
            let frame = match self.frame.take() {
                Some((made_for, frame)) if made_for == kinds => frame,
                // Its memory is free before the next one's is asked for.
                other => {
                    drop(other);
                    let made = Frame::new(&self.gpu, &self.passes, plan, &kinds);
                    if made.is_err() {
                        // Another frame may need less than this one found it did.
                        for pass in &mut self.passes {
                            pass.forget_capacity(&self.gpu);
                        }
                    }
                    made?
                }
            };
            let seen = frame.draw(&self.gpu, &mut self.timer, scene, plan, images)?;
            let mut fits = true;
            for ((pass, kind), seen) in self.passes.iter_mut().zip(&kinds).zip(&seen) {
                fits &= !pass.grow(&self.gpu, kind, seen)?;
            }
            if fits {
                let counts = self.counts(scene, &kinds, &seen);
                self.frame = Some((kinds, frame));
                let times = StageTimes {
                    frame: start.elapsed().as_secs_f64() * 1e3,
                    ..self.timer.read(&self.gpu)?
                };
                return Ok(FrameReport { counts, times });
            }
        }
    }
}

/// Buffers and bindings of frames of one kind.
#[derive(Debug)]
struct Frame {
    /// As the scene's; the picture is the last one's.
    passes: Vec<PassFrame>,
    bands: Bands,
    background: wgpu::Buffer,
    resolve: BoundKernel,
    pixels_back: wgpu::Buffer,
    normals_back: Option<wgpu::Buffer>,
}

/// Floats of a pixel of a surface before its normal.
const WORDS_BEFORE_NORMALS: u64 = 5;

impl Frame {
    fn new(gpu: &Gpu, passes: &[Pass], plan: &FramePlan, kinds: &[PassKind]) -> Result<Self> {
        let size = [plan.camera.width as u32, plan.camera.height as u32];
        let tiles = size.map(|n| n.div_ceil(TILE_SIZE as u32));
        let mut rows = tiles[1];
        for (pass, kind) in passes.iter().zip(kinds) {
            rows = rows.min(pass.band_rows(gpu, kind)?);
        }
        let bands = Bands { size, tiles, rows };
        let background = gpu.uniform("background", &Background::new([0.0; 3], 0))?;
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
                &background,
            )?);
        }
        // There is one pass at least.
        let picture = &made[made.len() - 1].pixels;
        let pixels = bands.most_pixels();
        let has_surface = passes.iter().any(|pass| pass.draws == Draws::Surfaces);
        let has_normals = plan.normals && has_surface;
        let normals_back = has_normals.then(|| gpu.staging("normals", 12 * pixels));
        Ok(Self {
            resolve: Resolve::new(gpu).bind(gpu, &background, picture),
            pixels_back: gpu.staging("picture", 4 * picture_words(plan.depth) * pixels)?,
            normals_back: normals_back.transpose()?,
            background,
            bands,
            passes: made,
        })
    }

    fn draw(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<Vec<Seen>> {
        timer.clear();
        images.largest = 0.0;
        for (pass, of_plan) in self.passes.iter().zip(&plan.passes) {
            pass.begin(gpu, timer, plan, of_plan, scene.carried());
        }
        let mut tiles = vec![TileCounts::default(); self.passes.len()];
        for band in 0..self.bands.count() {
            let pixels = self.bands.pixels(band);
            let background = Background::new(plan.background.unwrap_or_default(), pixels);
            gpu.write(&self.background, bytemuck::bytes_of(&background));
            for pass in &self.passes {
                pass.draw_band(gpu, timer, band);
            }
            let mut encoder = gpu.encoder();
            self.encode_band_end(&mut encoder, timer, plan, pixels);
            if band + 1 == self.bands.count() {
                timer.finish(&mut encoder);
            }
            gpu.submit(encoder);
            match plan.column() {
                Some((_, per_mass)) => self.read_columns(gpu, per_mass, band, images)?,
                None => self.read_band(gpu, plan, band, images)?,
            }
            for (pass, counts) in self.passes.iter().zip(&mut tiles) {
                pass.read_tiles(gpu, band, counts)?;
            }
        }
        let passes = self.passes.iter().zip(tiles);
        passes
            .map(|(pass, tiles)| pass.read_report(gpu, tiles))
            .collect()
    }

    /// The background, and the way back.
    fn encode_band_end(
        &self,
        encoder: &mut CommandEncoder,
        timer: &mut Timer,
        plan: &FramePlan,
        pixels: u32,
    ) {
        if plan.background.is_some() {
            let mut pass = timer.pass(encoder, Stage::Resolve);
            self.resolve.dispatch(&mut pass, Resolve::groups(pixels));
        }
        let picture = &self.passes[self.passes.len() - 1].pixels;
        let pixels = u64::from(pixels);
        let bytes = 4 * picture_words(plan.depth) * pixels;
        encoder.copy_buffer_to_buffer(picture, 0, &self.pixels_back, 0, bytes);
        if let Some(normals_back) = &self.normals_back {
            let surface = &self.passes[0].pixels;
            let first = 4 * WORDS_BEFORE_NORMALS * pixels;
            encoder.copy_buffer_to_buffer(surface, first, normals_back, 0, 12 * pixels);
        }
    }

    /// Adds up the sums of a band's column densities.
    ///
    /// - `per_mass`: field x length per unit of a sum of masses.
    fn read_columns(&self, gpu: &Gpu, per_mass: f64, band: u32, images: &mut Images) -> Result<()> {
        let (first_row, _) = self.bands.band(band);
        let Images {
            column, largest, ..
        } = images;
        let first = first_row as usize * TILE_SIZE * column.width;
        let count = self.bands.pixels(band) as usize;
        gpu.read_staging(&self.pixels_back, |bytes| {
            let sums = bytemuck::cast_slice::<u8, [f32; 4]>(&bytes[..16 * count]);
            let values = &mut column.values[first..first + count];
            for (value, sums) in values.iter_mut().zip(sums) {
                // From 0, and the coarsest first: they are the largest.
                let sum = sums
                    .iter()
                    .rev()
                    .fold(0.0, |sum, part| sum + f64::from(*part));
                let density = sum * per_mass;
                // NaN, were there one, would not be lost in `max`.
                if !(density.abs() <= *largest) {
                    *largest = density.abs();
                }
                *value = density as f32;
            }
        })
    }

    /// Copies a band's rows into the images.
    fn read_band(&self, gpu: &Gpu, plan: &FramePlan, band: u32, images: &mut Images) -> Result<()> {
        let (first_row, _) = self.bands.band(band);
        let Images {
            image,
            depth,
            normals,
            ..
        } = images;
        let first = first_row as usize * TILE_SIZE * image.width;
        let count = self.bands.pixels(band) as usize;
        gpu.read_staging(&self.pixels_back, |bytes| {
            let (colours, depths) = bytes.split_at(16 * count);
            let pixels = bytemuck::cast_slice_mut::<_, u8>(&mut image.pixels[first..first + count]);
            // On a graphics card one thread's copy would take longer than the frame.
            pixels
                .par_chunks_mut(COPY_BYTES)
                .zip(colours.par_chunks(COPY_BYTES))
                .for_each(|(to, from)| to.copy_from_slice(from));
            if let Some(depth) = depth {
                let words = bytemuck::cast_slice::<u8, f32>(&depths[..4 * count]);
                for (out, word) in depth.depths[first..first + count].iter_mut().zip(words) {
                    *out = depth_of_word(*word);
                }
            }
        })?;
        if let (Some(normals_back), Some(normals)) = (&self.normals_back, normals) {
            let world_from_camera = plan.camera.camera_from_world.as_mat3().transpose();
            gpu.read_staging(normals_back, |bytes| {
                let words = bytemuck::cast_slice::<u8, [f32; 3]>(&bytes[..12 * count]);
                let out = &mut normals.normals[first..first + count];
                for (out, normal) in out.iter_mut().zip(words) {
                    *out = (world_from_camera * Vec3::from(*normal)).into();
                }
            })?;
        }
        Ok(())
    }
}
