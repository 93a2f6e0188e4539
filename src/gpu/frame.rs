//! A scene kept on a device, and its frames: the scene is uploaded once, a frame uploads a camera.
//!
//! A frame has two passes where the scene has both: opaque surfaces are drawn first, and their pixels
//! stay on the device for the volumes among which they lie. A scene of one kind has one pass. Band
//! after band of the image takes all passes before it goes back.

use rayon::prelude::*;
use wgpu::CommandEncoder;

use super::device::Gpu;
use super::kernel::BoundKernel;
use super::pass::{Bands, Pass, PassFrame, PassKind, Seen, TileCounts};
use super::rasterise::picture_words;
use super::resolve::{Background, Resolve};
use super::tile::depth_of_word;
use super::timer::{Stage, Timer};
use crate::blocks::{BlockedVolume, Frustum, Layers};
use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::image::{DepthImage, Image, NormalImage};
use crate::layout::{ChoiceUniform, LightingUniform, ViewUniform};
use crate::scene::TransferFunction;
use crate::splat::{Composite, Filter};
use crate::stats::{FrameCounts, StageTimes};
use crate::view::Camera;
use glam::Vec3;

/// What a frame is asked for.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// The view.
    pub camera: &'a Camera,
    /// What it sees, widened by the reach of the low-pass filter.
    pub frustum: &'a Frustum,
    /// Whether blocks outside the frustum are left out.
    pub is_culled: bool,
    /// The view in f32; the device finds its `key_scale`.
    pub view: ViewUniform,
    /// The layers in which kernels are summed, if they are.
    pub layers: Option<Layers>,
    /// What classifies layers, where particles carry values.
    pub post: Option<&'a TransferFunction>,
    /// What blocks are drawn by.
    pub choice: ChoiceUniform,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau).
    pub linear_opacity: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether normals of opaque surfaces are wanted.
    pub normals: bool,
    /// Whether pixels count kernels instead of showing them.
    pub count: bool,
    /// Linear RGB behind everything.
    pub background: Option<[f32; 3]>,
    /// Light on what has normals.
    pub lighting: Option<LightingUniform>,
}

/// What makes a frame's buffers and pipelines differ from another's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameKind {
    pub(super) size: [u32; 2],
    filter: u32,
    orthographic: u32,
    pub(super) linear_opacity: bool,
    pub(super) depth: bool,
    pub(super) normals: bool,
    pub(super) count: bool,
    /// Whether planes clip.
    pub(super) clip: bool,
    pub(super) composite: Composite,
    /// Whether layers are classified.
    pub(super) post: bool,
    /// Whether merged particles may be drawn.
    pub(super) detail: bool,
    /// Whether there is light.
    pub(super) is_lit: bool,
}

impl FrameKind {
    fn of(input: &FrameInput<'_>) -> Self {
        Self {
            size: input.view.size,
            filter: input.view.filter_kind,
            orthographic: input.view.orthographic,
            linear_opacity: input.linear_opacity,
            depth: input.depth,
            normals: input.normals,
            count: input.count,
            clip: input.view.clip_count > 0,
            composite: Composite::ALL[input.view.composite as usize],
            post: input.post.is_some(),
            detail: input.choice.level_of_detail != 0,
            is_lit: input.lighting.is_some(),
        }
    }

    /// Whether a footprint may be on the exact path.
    pub(super) fn may_be_exact(&self) -> bool {
        let filters = [Filter::Adaptive as u32, Filter::Exact as u32];
        self.orthographic == 0 && filters.contains(&self.filter)
    }
}

/// What a frame draws into, the last two where they are asked for.
#[derive(Debug)]
pub struct FrameOutput<'a> {
    /// The picture.
    pub image: &'a mut Image,
    /// Depths.
    pub depth: &'a mut Option<DepthImage>,
    /// Normals of opaque surfaces.
    pub normals: &'a mut Option<NormalImage>,
}

impl FrameOutput<'_> {
    /// Images of the input's size: of the old ones those that have it.
    fn resize(&mut self, input: &FrameInput<'_>) {
        let (width, height) = (input.camera.width, input.camera.height);
        let size = (width, height);
        if (self.image.width, self.image.height) != size {
            *self.image = Image::new(width, height);
        }
        if !input.depth {
            *self.depth = None;
        } else if self
            .depth
            .as_ref()
            .is_none_or(|d| (d.width, d.height) != size)
        {
            *self.depth = Some(DepthImage {
                width,
                height,
                depths: vec![0.0; width * height],
            });
        }
        // Zeros where no pass writes any.
        *self.normals = input.normals.then(|| NormalImage {
            width,
            height,
            normals: vec![[0.0; 3]; width * height],
        });
    }
}

/// Bytes of the picture that one thread copies at a time.
const COPY_BYTES: usize = 1 << 20;

/// Volumes on a device, and the memory of their frames.
#[derive(Debug)]
pub struct DeviceScene {
    gpu: Gpu,
    block_count: usize,
    timer: Timer,
    /// In the order in which they are drawn.
    passes: Vec<Pass>,
    frame: Option<(FrameKind, Frame)>,
}

impl DeviceScene {
    /// Uploads volumes, each with its levels of detail after it.
    ///
    /// # Errors
    /// Too little memory on the device, or what only the CPU draws.
    pub fn new(gpu: Gpu, volumes: &[BlockedVolume]) -> Result<Self> {
        let is_any = |kind: PassKind| volumes.iter().any(|volume| kind.draws(volume));
        let is_cut = is_any(PassKind::Surface { is_picture: true });
        let is_picture = is_cut && !is_any(PassKind::Volumes { is_cut });
        let kinds = [
            is_cut.then_some(PassKind::Surface { is_picture }),
            (!is_picture).then_some(PassKind::Volumes { is_cut }),
        ];
        let passes = kinds.into_iter().flatten();
        let passes = passes.map(|kind| Pass::new(&gpu, kind, volumes));
        Ok(Self {
            passes: passes.collect::<Result<_>>()?,
            timer: Timer::new(&gpu)?,
            block_count: volumes.iter().map(|v| v.blocks.len()).sum(),
            frame: None,
            gpu,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Uploads the transfer function that a volume and its levels of detail were given: tables, no
    /// particle.
    pub fn set_transfer_function(&mut self, volume: usize, family: &[BlockedVolume]) {
        for pass in &self.passes {
            pass.scene.set_transfer_function(&self.gpu, volume, family);
        }
    }

    /// Draws a frame.
    ///
    /// # Errors
    /// Too little memory on the device, or a device that is lost.
    pub fn render(
        &mut self,
        input: &FrameInput<'_>,
        mut output: FrameOutput<'_>,
    ) -> Result<(FrameCounts, StageTimes)> {
        self.gpu.check()?;
        output.resize(input);
        let kind = FrameKind::of(input);
        loop {
            let frame = match self.frame.take() {
                Some((made_for, frame)) if made_for == kind => frame,
                // Its memory is free before the next one's is asked for.
                other => {
                    drop(other);
                    let made = Frame::new(&self.gpu, &self.passes, &input.view, &kind);
                    if made.is_err() {
                        // Another frame may need less than this one found it did.
                        for pass in &mut self.passes {
                            pass.forget_room(&self.gpu);
                        }
                    }
                    made?
                }
            };
            let seen = frame.draw(&self.gpu, &mut self.timer, input, &mut output)?;
            let mut fits = true;
            for (pass, seen) in self.passes.iter_mut().zip(&seen) {
                fits &= !pass.grow(&self.gpu, &kind, seen)?;
            }
            if fits {
                self.frame = Some((kind, frame));
                let times = self.timer.read(&self.gpu)?;
                return Ok((self.counts(&kind, &seen), times));
            }
        }
    }

    fn counts(&self, kind: &FrameKind, seen: &[Seen]) -> FrameCounts {
        let mut counts = FrameCounts {
            blocks: self.block_count,
            blocks_culled: self.block_count,
            ..FrameCounts::default()
        };
        for (pass, seen) in self.passes.iter().zip(seen) {
            pass.count(kind, seen, &mut counts);
        }
        counts
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
    fn new(gpu: &Gpu, passes: &[Pass], view: &ViewUniform, kind: &FrameKind) -> Result<Self> {
        let tiles = kind.size.map(|n| n.div_ceil(TILE_SIZE as u32));
        let mut rows = tiles[1];
        for pass in passes {
            rows = rows.min(pass.band_rows(gpu, kind)?);
        }
        let bands = Bands {
            size: kind.size,
            tiles,
            rows,
        };
        let background = gpu.uniform("background", &Background::new([0.0; 3], 0))?;
        let mut made: Vec<PassFrame> = Vec::with_capacity(passes.len());
        for pass in passes {
            let surface = made.last().map(|surface| &surface.pixels);
            made.push(PassFrame::new(
                gpu,
                pass,
                view,
                kind,
                bands,
                surface,
                &background,
            )?);
        }
        // There is one pass at least.
        let picture = &made[made.len() - 1].pixels;
        let pixels = bands.most_pixels();
        let has_surface = passes
            .iter()
            .any(|pass| matches!(pass.kind, PassKind::Surface { .. }));
        let has_normals = kind.normals && has_surface;
        let normals_back = has_normals.then(|| gpu.staging("normals", 12 * pixels));
        Ok(Self {
            resolve: Resolve::new(gpu).bind(gpu, &background, picture),
            pixels_back: gpu.staging("picture", 4 * picture_words(kind.depth) * pixels)?,
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
        input: &FrameInput<'_>,
        output: &mut FrameOutput<'_>,
    ) -> Result<Vec<Seen>> {
        timer.clear();
        for pass in &self.passes {
            pass.begin(gpu, timer, input);
        }
        let mut tiles = vec![TileCounts::default(); self.passes.len()];
        for band in 0..self.bands.count() {
            let pixels = self.bands.pixels(band);
            let background = Background::new(input.background.unwrap_or_default(), pixels);
            gpu.write(&self.background, bytemuck::bytes_of(&background));
            for pass in &self.passes {
                pass.draw_band(gpu, timer, band);
            }
            let mut encoder = gpu.encoder();
            self.encode_band_end(&mut encoder, timer, input, pixels);
            if band + 1 == self.bands.count() {
                timer.finish(&mut encoder);
            }
            gpu.submit(encoder);
            self.read_band(gpu, input, band, output)?;
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
        input: &FrameInput<'_>,
        pixels: u32,
    ) {
        if input.background.is_some() {
            let mut pass = timer.pass(encoder, Stage::Resolve);
            self.resolve.dispatch(&mut pass, Resolve::groups(pixels));
        }
        let picture = &self.passes[self.passes.len() - 1].pixels;
        let pixels = u64::from(pixels);
        let bytes = 4 * picture_words(input.depth) * pixels;
        encoder.copy_buffer_to_buffer(picture, 0, &self.pixels_back, 0, bytes);
        if let Some(normals_back) = &self.normals_back {
            let surface = &self.passes[0].pixels;
            let first = 4 * WORDS_BEFORE_NORMALS * pixels;
            encoder.copy_buffer_to_buffer(surface, first, normals_back, 0, 12 * pixels);
        }
    }

    /// Copies a band's rows into the images.
    fn read_band(
        &self,
        gpu: &Gpu,
        input: &FrameInput<'_>,
        band: u32,
        output: &mut FrameOutput<'_>,
    ) -> Result<()> {
        let (first_row, _) = self.bands.band(band);
        let FrameOutput {
            image,
            depth,
            normals,
        } = output;
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
            let world_from_camera = input.camera.camera_from_world.as_mat3().transpose();
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
