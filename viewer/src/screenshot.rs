//! Draws a picture of the window without a display.

use std::path::Path;
use std::time::Duration;

use egui_wgpu::wgpu;
use ewa_splat::command::ViewRequest;
use ewa_splat::io::write_bytes_atomically;

use crate::app::App;
use crate::headless::Headless;

/// Default width and height of the picture.
const SIZE: [u32; 2] = [1280, 800];

/// Pause between two checks whether the drawing is complete.
const PAUSE: Duration = Duration::from_millis(10);

/// Draws the window once all work is done, and writes it.
///
/// # Errors
/// The error that the window shows; no adapter, not even a software one; a file that cannot be
/// written.
pub(crate) fn write(request: ViewRequest, path: &Path) -> Result<(), String> {
    let size = request.size().map_or(SIZE, |size| {
        size.map(|n| u32::try_from(n).unwrap_or(u32::MAX))
    });
    let mut window = Headless::new(request, size.map(|n| n as usize), PAUSE);
    let mut painter = Painter::new(size)?;
    window.until(App::is_at_rest, |output| {
        painter.update(output.textures_delta)
    })?;
    // The passes after the last picture update the layout.
    painter.update(window.pass().textures_delta);
    let output = window.pass();
    painter.update(output.textures_delta);
    let scale = output.pixels_per_point;
    let shapes = window.context.tessellate(output.shapes, scale);
    let bytes = png(&painter.draw(&shapes, scale)?, size)?;
    write_bytes_atomically(path, &bytes).map_err(|error| error.to_string())
}

fn png(pixels: &[u8], [width, height]: [u32; 2]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(pixels));
    written.map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// Draws the interface into a texture.
struct Painter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    renderer: egui_wgpu::Renderer,
    size: [u32; 2],
}

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

impl Painter {
    fn new(size: [u32; 2]) -> Result<Self, String> {
        let instance = wgpu::Instance::default();
        let adapter =
            pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
        let adapter = adapter.map_err(|error| {
            format!("drawing the window: {error}; install a graphics driver (a software one: Mesa's lavapipe)")
        })?;
        let device = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()));
        let (device, queue) = device.map_err(|error| format!("drawing the window: {error}"))?;
        let renderer =
            egui_wgpu::Renderer::new(&device, FORMAT, egui_wgpu::RendererOptions::default());
        Ok(Self {
            device,
            queue,
            renderer,
            size,
        })
    }

    fn update(&mut self, mut textures: egui::TexturesDelta) {
        for (id, deltas) in &textures.set {
            for delta in deltas {
                self.renderer
                    .update_texture(&self.device, &self.queue, *id, delta);
            }
        }
        for id in &textures.free {
            self.renderer.free_texture(id);
        }
        textures.clear();
    }

    /// Returns the pixels, four bytes each.
    fn draw(
        &mut self,
        shapes: &[egui::ClippedPrimitive],
        pixels_per_point: f32,
    ) -> Result<Vec<u8>, String> {
        let [width, height] = self.size;
        let extent = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("window"),
            size: extent,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let screen = egui_wgpu::ScreenDescriptor {
            size_in_pixels: self.size,
            pixels_per_point,
        };
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.renderer
            .update_buffers(&self.device, &self.queue, &mut encoder, shapes, &screen);
        {
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("window"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..wgpu::RenderPassDescriptor::default()
            });
            self.renderer
                .render(&mut pass.forget_lifetime(), shapes, &screen);
        }
        self.queue.submit([encoder.finish()]);
        texels(&self.device, &self.queue, &texture)
    }
}

/// Reads the texels of a texture, four bytes each.
///
/// # Errors
/// A device that is lost.
pub(crate) fn texels(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
) -> Result<Vec<u8>, String> {
    let [width, height] = [texture.width(), texture.height()];
    let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("texels"),
        size: u64::from(row) * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    let slice = buffer.slice(..);
    slice.map_async(wgpu::MapMode::Read, |_| ());
    device
        .poll(wgpu::PollType::wait_indefinitely())
        .map_err(|error| format!("reading a texture: {error}"))?;
    let mapped = slice
        .get_mapped_range()
        .map_err(|error| error.to_string())?;
    let rows = mapped.chunks(row as usize);
    Ok(rows
        .flat_map(|r| &r[..4 * width as usize])
        .copied()
        .collect())
}
