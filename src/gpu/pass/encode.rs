//! Encodes the commands of a pass: the stages common to all bands, then band after band, chunk after
//! chunk.

use wgpu::CommandEncoder;

use super::bind::{BoundRaster, CLASSIFIED_COUNT, PassFrame};
use super::report::{Seen, TileCounts};
use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::frame::backdrop::{RayEnds, of_surfels};
use crate::frame::plan::{Carries, FramePlan, PassPlan};
use crate::gpu::classify::AmplitudeUniform;
use crate::gpu::constants::PARTICLE_ARGUMENTS;
use crate::gpu::cull::camera_uniform;
use crate::gpu::device::Gpu;
use crate::gpu::rasterise::classes;
use crate::gpu::resolve::Resolve;
use crate::gpu::tile::word_of_depth;
use crate::gpu::timer::{Stage, Timer};
use crate::record::ChunkUniform;
use crate::scene::TransferFunction;
use crate::splat::Profiles;
use crate::view::Projection;

impl PassFrame {
    /// Submits the stages common to all bands: cull, classify, shade, project, sort.
    pub(in crate::gpu) fn begin(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        plan: &FramePlan,
        pass: &PassPlan,
        post: Option<&TransferFunction>,
    ) {
        let camera = camera_uniform(
            &plan.camera,
            &plan.frustum,
            plan.culls,
            plan.choice,
            pass.keys,
            pass.layers.as_ref(),
        );
        let shadows = plan.shadows.as_ref().map(|(_, uniform)| uniform);
        let lighting = plan.lighting.as_ref();
        self.buffers
            .write(gpu, &pass.view, &camera, lighting, shadows);
        if let Carries::Amplitude { scale, .. } = pass.carries {
            for (buffer, cell_volume) in self.amplitudes.iter().zip(&self.cell_volumes) {
                let uniform = AmplitudeUniform::new(scale, *cell_volume);
                gpu.write(buffer, bytemuck::bytes_of(&uniform));
            }
        }
        if let (Some(buffer), Some(transfer)) = (&self.classes, post) {
            gpu.write(buffer, bytemuck::cast_slice(&classes(transfer)));
        }
        if let (Some(buffer), true) = (&self.profiles, pass.axes.smooths) {
            let profiles = Profiles::of(pass.view.smoothing);
            gpu.write(buffer, bytemuck::bytes_of(profiles));
        }
        if let (Some(buffer), Some(tiles)) = (&self.drawn_tiles, &plan.tiles) {
            let words: Vec<u32> = tiles.iter().map(|is| u32::from(*is)).collect();
            gpu.write(buffer, bytemuck::cast_slice(&words));
        }
        let mut encoder = gpu.encoder();
        self.encode_until_sorted(&mut encoder, timer);
        gpu.submit(encoder);
    }

    /// Submits the commands that draw a band's pixels.
    pub(in crate::gpu) fn draw_band(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        plan: &FramePlan,
        band: u32,
    ) {
        let first_step = u64::from(band) * u64::from(self.cuts.chunks);
        if let Some(ends) = &plan.ends {
            self.write_ends(gpu, plan, ends, band);
        }
        for chunk in 0..self.cuts.chunks {
            self.write_step(gpu, band, chunk);
            let mut encoder = gpu.encoder();
            if chunk == 0 {
                encoder.clear_buffer(&self.progress, 0, None);
            }
            self.encode_chunk(&mut encoder, timer, band);
            let step = first_step + u64::from(chunk);
            self.report
                .encode_step(&mut encoder, step, &self.gather.state);
            if chunk + 1 == self.cuts.chunks {
                self.encode_band_end(&mut encoder, timer, band);
            }
            gpu.submit(encoder);
        }
    }

    /// Writes the depths at which the rays of a band end.
    fn write_ends(&self, gpu: &Gpu, plan: &FramePlan, ends: &RayEnds, band: u32) {
        let is_orthographic = plan.camera.projection == Projection::Orthographic;
        let width = plan.camera.width;
        let first = self.cuts.bands.band(band).0 as usize * TILE_SIZE * width;
        let pixels = self.cuts.bands.pixels(band);
        for of_pass in &self.ends {
            let word = |i: usize| {
                let depth = ends.at([i % width, i / width]);
                match of_pass.of_surfels {
                    true => of_surfels(depth, is_orthographic).clamp(-f32::MAX, f32::MAX),
                    false => word_of_depth(depth),
                }
            };
            let words: Vec<f32> = (first..first + pixels as usize).map(word).collect();
            let offset = 4 * of_pass.words_before * u64::from(pixels);
            gpu.write_at(&of_pass.buffer, offset, bytemuck::cast_slice(&words));
        }
    }

    /// Adds the counts of the tiles of the last band drawn.
    ///
    /// # Errors
    /// A lost device.
    pub(in crate::gpu) async fn read_tiles(
        &self,
        gpu: &Gpu,
        band: u32,
        counts: &mut TileCounts,
    ) -> Result<()> {
        let tiles = self.cuts.bands.tiles[0] * self.cuts.bands.band(band).1;
        self.report.read_tiles(gpu, tiles, counts).await
    }

    /// Reads the report of the pass, after all bands are drawn.
    ///
    /// # Errors
    /// A lost device.
    pub(in crate::gpu) async fn read_report(&self, gpu: &Gpu, tiles: TileCounts) -> Result<Seen> {
        self.report.read(gpu, tiles).await
    }

    /// Encodes cull, classify, shade, project and sort, and their part of the report.
    fn encode_until_sorted(&self, encoder: &mut CommandEncoder, timer: &mut Timer) {
        encoder.clear_buffer(&self.near, 0, Some(8));
        encoder.clear_buffer(&self.gather.state, 0, None);
        self.cull.encode(&mut timer.pass(encoder, Stage::Cull));
        {
            let mut pass = timer.pass(encoder, Stage::Classify);
            self.classify.iter().for_each(|p| p.encode(&mut pass));
            self.shade.iter().for_each(|p| p.encode(&mut pass));
            self.light.iter().for_each(|p| p.encode(&mut pass));
            self.encode.iter().for_each(|p| p.encode(&mut pass));
        }
        let count = u64::from(4 * CLASSIFIED_COUNT);
        for (i, part) in (0..).zip(&self.parts) {
            encoder.copy_buffer_to_buffer(&part.state, count, &self.counts, 4 * i, 4);
        }
        {
            let mut pass = timer.pass(encoder, Stage::Project);
            for (project, part) in self.project.iter().zip(&self.parts) {
                let particles = u64::from(4 * PARTICLE_ARGUMENTS);
                project.dispatch_indirect(&mut pass, &part.arguments, particles);
            }
        }
        self.sort.encode(&mut timer.pass(encoder, Stage::Sort));
        let parts = self.parts.iter().map(|part| &part.state);
        let (sort, frame) = (&self.sort.state, &self.buffers.state);
        self.report
            .encode_counts(encoder, parts, sort, &self.near, frame);
    }

    /// Writes the uniform of the next submission: a chunk of a band.
    fn write_step(&self, gpu: &Gpu, band: u32, chunk: u32) {
        let (first_row, rows) = self.cuts.bands.band(band);
        let of_chunk = ChunkUniform {
            start: chunk * self.cuts.chunk,
            capacity: self.cuts.chunk,
            band_first: [0, first_row],
            band_size: [self.cuts.bands.tiles[0], rows],
            is_last: u32::from(chunk + 1 == self.cuts.chunks),
            unused: 0,
        };
        gpu.write(&self.chunk, bytemuck::bytes_of(&of_chunk));
    }

    fn encode_chunk(&self, encoder: &mut CommandEncoder, timer: &mut Timer, band: u32) {
        {
            let mut pass = timer.pass(encoder, Stage::Bin);
            self.gather.encode(&mut pass);
            self.bin.encode(&mut pass);
        }
        let tiles = self.cuts.bands.tiles[0] * self.cuts.bands.band(band).1;
        let mut pass = timer.pass(encoder, Stage::Rasterise);
        let rasterise = match &self.rasterise {
            BoundRaster::Surface(surface) => &surface.tiles,
            BoundRaster::Volumes(tiles, _) => tiles,
        };
        rasterise.encode(&mut pass, tiles, self.cuts.chunk);
    }

    /// Encodes the commands after a band's last chunk, and the copy of its counts to the host.
    fn encode_band_end(&self, encoder: &mut CommandEncoder, timer: &mut Timer, band: u32) {
        let pixels = self.cuts.bands.pixels(band);
        match &self.rasterise {
            BoundRaster::Surface(surface) => {
                surface.encode_pixels(&mut timer.pass(encoder, Stage::Rasterise), pixels);
            }
            BoundRaster::Volumes(_, Some(compose)) => {
                let mut pass = timer.pass(encoder, Stage::Rasterise);
                compose.dispatch(&mut pass, Resolve::groups(pixels));
            }
            BoundRaster::Volumes(_, None) => {}
        }
        self.report.encode_tiles(encoder, &self.progress);
    }
}
