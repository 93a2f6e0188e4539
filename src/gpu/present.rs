//! Stage: draws a band's pixels into a caller's texture, on the device.

use bytemuck::{Pod, Zeroable};
use wgpu::{TextureDimension, TextureFormat, TextureUsages};

use super::device::Gpu;
use super::kernel::whole;
use super::pass::Bands;
use super::shader::Shader;
use crate::constants::TILE_SIZE;
use crate::error::{Error, Result};
use crate::view::Camera;

/// Shader of the stage.
pub(super) const SHADER: Shader =
    Shader::new("present", &[include_str!("../../shaders/present.wgsl")]);

/// Formats of textures that frames can be drawn into.
const FORMATS: [TextureFormat; 6] = [
    TextureFormat::Rgba32Float,
    TextureFormat::Rgba16Float,
    TextureFormat::Rgba8UnormSrgb,
    TextureFormat::Bgra8UnormSrgb,
    TextureFormat::Rgba8Unorm,
    TextureFormat::Bgra8Unorm,
];

/// Position of a band in the texture, as the shader reads it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PresentBand {
    pub(super) first_row: u32,
    pub(super) width: u32,
}

/// The pipeline for textures of a format.
#[derive(Debug)]
pub(super) struct Present {
    pub(super) format: TextureFormat,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
}

/// A pipeline with its input pixels and its target texture.
#[derive(Debug)]
pub(super) struct BoundPresent<'a> {
    present: &'a Present,
    view: wgpu::TextureView,
    group: wgpu::BindGroup,
    band: wgpu::Buffer,
}

/// Checks whether a frame of a camera can be drawn into a texture.
///
/// # Errors
/// Another size, a format not in [`FORMATS`], or a texture that cannot be drawn into.
pub(super) fn check_texture(texture: &wgpu::Texture, camera: &Camera) -> Result<()> {
    let invalid = |place: &str, expected: String, found: String, advice: &str| {
        Err(Error::invalid("texture", place, expected, found, advice))
    };
    let format = texture.format();
    if !FORMATS.contains(&format) {
        let known = FORMATS.map(|f| format!("{f:?}")).join(", ");
        let advice = "draw into one of these and copy from there";
        return invalid(
            "format",
            format!("one of {known}"),
            format!("{format:?}"),
            advice,
        );
    }
    let is_plain = texture.dimension() == TextureDimension::D2
        && texture.depth_or_array_layers() == 1
        && texture.sample_count() == 1;
    if !is_plain {
        let found = format!(
            "{:?} of {} layers, {} samples a pixel",
            texture.dimension(),
            texture.depth_or_array_layers(),
            texture.sample_count()
        );
        let expected = "one layer in two dimensions, one sample a pixel".to_owned();
        return invalid("kind", expected, found, "create it so");
    }
    if !texture.usage().contains(TextureUsages::RENDER_ATTACHMENT) {
        let found = format!("{:?}", texture.usage());
        return invalid(
            "usage",
            "RENDER_ATTACHMENT".to_owned(),
            found,
            "create it with this usage too",
        );
    }
    let size = [texture.width() as usize, texture.height() as usize];
    if size != [camera.width, camera.height] {
        let expected = format!("the camera's {} x {} pixels", camera.width, camera.height);
        let found = format!("{} x {}", size[0], size[1]);
        return invalid(
            "size",
            expected,
            found,
            "give the camera the texture's size",
        );
    }
    Ok(())
}

impl Present {
    /// Makes the pipeline.
    ///
    /// - `format`: one of [`FORMATS`].
    pub(super) fn new(gpu: &Gpu, format: TextureFormat) -> Self {
        let device = &gpu.device;
        let buffer = |binding, ty, visibility| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let pixels = wgpu::BufferBindingType::Storage { read_only: true };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("present"),
            entries: &[
                buffer(
                    0,
                    wgpu::BufferBindingType::Uniform,
                    wgpu::ShaderStages::FRAGMENT,
                ),
                buffer(1, pixels, wgpu::ShaderStages::FRAGMENT),
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("present"),
            bind_group_layouts: &[Some(&layout)],
            ..wgpu::PipelineLayoutDescriptor::default()
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("present"),
            source: wgpu::ShaderSource::Wgsl(SHADER.source().into()),
        });
        let encodes = matches!(
            format,
            TextureFormat::Rgba8Unorm | TextureFormat::Bgra8Unorm
        );
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("present"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("present"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("ENCODES", f64::from(u8::from(encodes)))],
                    ..wgpu::PipelineCompilationOptions::default()
                },
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self {
            format,
            layout,
            pipeline,
        }
    }

    /// Binds the pipeline.
    ///
    /// - `pixels`: pixels of a band, as `resolve.wgsl` writes them.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        pixels: &wgpu::Buffer,
        texture: &wgpu::Texture,
    ) -> Result<BoundPresent<'_>> {
        let band = gpu.uniform("band of a texture", &PresentBand::zeroed())?;
        let entries = whole(&[&band, pixels]);
        // The first of its mip levels.
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            mip_level_count: Some(1),
            ..wgpu::TextureViewDescriptor::default()
        });
        Ok(BoundPresent {
            group: gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("present"),
                layout: &self.layout,
                entries: &entries,
            }),
            present: self,
            view,
            band,
        })
    }
}

impl BoundPresent<'_> {
    /// Draws a band's pixels into its rows of the texture.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        bands: &Bands,
        band: u32,
    ) {
        let width = bands.size[0];
        let first_row = bands.band(band).0 * TILE_SIZE as u32;
        let uniform = PresentBand { first_row, width };
        gpu.write(&self.band, bytemuck::bytes_of(&uniform));
        // The first band clears the texture.
        let load = if band == 0 {
            wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)
        } else {
            wgpu::LoadOp::Load
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("present"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load,
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.present.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.set_scissor_rect(0, first_row, width, bands.pixels(band) / width);
        pass.draw(0..3, 0..1);
    }
}
