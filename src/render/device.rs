//! Draws frames on a device that the caller opened, into its textures, and without waiting.

use super::renderer::Renderer;
use crate::error::{Error, Result};
use crate::frame::backend::FrameReport;
use crate::frame::plan::FramePlan;
use crate::frame::settings::{ColumnSettings, Settings};
use crate::image::{ColumnImage, Image};
use crate::view::Camera;

impl Renderer {
    /// As [`Renderer::render`], without waiting for the device. The future completes when the device has
    /// drawn. It may move between threads, except in a browser.
    ///
    /// A browser drives the device by itself. Elsewhere the caller must poll the device
    /// ([`wgpu::Device::poll`]) while the future is pending. A window does so whenever it submits;
    /// `PollType::Poll` once per iteration of an event loop suffices.
    ///
    /// The future waits once per band of the image; most frames have one band. If buffers were too small,
    /// which mostly happens in the first frames, the frame is drawn again. Dropping the future costs the
    /// next frame its buffers, and nothing else.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # use ewa_splat::{Renderer, Settings, render::Gpu, scene::PointVolume, view::Camera, wgpu};
    /// # use glam::DVec3;
    /// # let scene = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
    /// # let camera = Camera::perspective(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
    /// # let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    /// # let wanted = wgpu::RequestAdapterOptions::default();
    /// # let Ok(adapter) = pollster::block_on(instance.request_adapter(&wanted)) else {
    /// #     return Ok(());
    /// # };
    /// # let asked = ewa_splat::render::device_descriptor(&adapter);
    /// # let (device, queue) = pollster::block_on(adapter.request_device(&asked))?;
    /// use std::task::{Context, Poll, Waker};
    ///
    /// let mut renderer = Renderer::new(vec![scene])?.on(Gpu::from_device(device.clone(), queue)?)?;
    /// let settings = Settings::default();
    /// let mut frame = std::pin::pin!(renderer.render_async(&camera, &settings));
    /// let mut context = Context::from_waker(Waker::noop());
    /// let image = loop {
    ///     if let Poll::Ready(image) = frame.as_mut().poll(&mut context) {
    ///         break image?;
    ///     }
    ///     // One turn of a loop that has other things to do.
    ///     device.poll(wgpu::PollType::Poll)?;
    /// };
    /// assert!(image.pixel(32, 24)[3] > 0.3);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; an aperture, which takes several pictures.
    pub async fn render_async(&mut self, camera: &Camera, settings: &Settings) -> Result<&Image> {
        settings.refuse_aperture("picture without waiting")?;
        let level = self.chosen(camera, settings)?;
        let drawn = self.at_level(level).render_samples_async(camera, settings);
        drawn.await?;
        self.take_from(level);
        Ok(&self.images.image)
    }

    async fn render_samples_async(&mut self, camera: &Camera, settings: &Settings) -> Result<()> {
        let mut plan = self.plan(camera, settings)?;
        let behind = self.take_background(&mut plan, settings);
        let mut report = self.draw_async(&plan).await?;
        for region in self.regions(&plan, settings, None)? {
            let finer = region.plan(&self.scene, &plan, settings)?;
            let samples = self.draw_async(&finer).await?;
            self.average(&region, &samples, &mut report);
        }
        self.lay_over(&behind);
        self.drawn(&plan, report);
        Ok(())
    }

    /// As [`Renderer::column_density`], without waiting: see [`Renderer::render_async`].
    ///
    /// # Errors
    /// The errors of [`Renderer::column_density`].
    pub async fn column_density_async(
        &mut self,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<&ColumnImage> {
        let plan = self.column_plan(camera, settings)?;
        let report = self.draw_async(&plan).await?;
        self.column_drawn(report)
    }

    /// As [`Renderer::draw`], without waiting for the device.
    async fn draw_async(&mut self, plan: &FramePlan) -> Result<FrameReport> {
        let images = plan.target(&mut self.images, &mut self.samples);
        let drawn = match &mut self.device {
            Some(device) => {
                let drawing = device.draw_to(&self.scene, plan, images, None);
                Some(drawing.await)
            }
            None => None,
        };
        self.or_on_cpu(plan, drawn)
    }

    /// Draws a frame into a texture of the device; its pixels never leave the device.
    ///
    /// - `texture`: two-dimensional, of the camera's size, of one layer and one sample, with the usage
    ///   `RENDER_ATTACHMENT`, on the same device as this renderer. Its contents are replaced.
    ///
    /// | format | a pixel |
    /// |---|---|
    /// | `Rgba32Float`, `Rgba16Float` | linear, premultiplied: as [`Renderer::render`], the former bit for bit |
    /// | `Rgba8UnormSrgb`, `Bgra8UnormSrgb` | the same, encoded by the texture; a shader reads it as linear and premultiplied |
    /// | `Rgba8Unorm`, `Bgra8Unorm` | sRGB code values of the straight colour, as in a PNG, times alpha: what windows and egui blend |
    ///
    /// All tiles have one sample a pixel, whatever [`Advanced::opaque_edges`](crate::render::Advanced::opaque_edges)
    /// says. [`Renderer::image`] does not change. Depths and normals are read back if the settings ask for
    /// them. Otherwise only counts are read back, some hundred bytes plus 24 per tile; they tell whether
    /// buffers were too small and the frame must be drawn again. This call waits for the counts;
    /// [`Renderer::render_to_texture_async`] does not block. In both cases the texture is complete when
    /// the call or the future completes.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # use ewa_splat::{Renderer, Settings, render::Gpu, scene::PointVolume, view::Camera, wgpu};
    /// # use glam::DVec3;
    /// # let scene = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
    /// # let camera = Camera::perspective(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
    /// # let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    /// # let wanted = wgpu::RequestAdapterOptions::default();
    /// # let Ok(adapter) = pollster::block_on(instance.request_adapter(&wanted)) else {
    /// #     return Ok(());
    /// # };
    /// # let asked = ewa_splat::render::device_descriptor(&adapter);
    /// # let (device, queue) = pollster::block_on(adapter.request_device(&asked))?;
    /// let texture = device.create_texture(&wgpu::TextureDescriptor {
    ///     label: None,
    ///     size: wgpu::Extent3d { width: 64, height: 48, depth_or_array_layers: 1 },
    ///     mip_level_count: 1,
    ///     sample_count: 1,
    ///     dimension: wgpu::TextureDimension::D2,
    ///     format: wgpu::TextureFormat::Rgba8Unorm,
    ///     usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
    ///     view_formats: &[],
    /// });
    /// let mut renderer = Renderer::new(vec![scene])?.on(Gpu::from_device(device, queue)?)?;
    /// renderer.render_to_texture(&camera, &Settings::default(), &texture)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; an aperture; a texture of another size, format or kind, or of another device; a
    /// renderer that draws on the CPU. Nothing falls back to the CPU.
    pub fn render_to_texture(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        texture: &wgpu::Texture,
    ) -> Result<()> {
        let gpu = self.device.as_ref().ok_or_else(no_device)?.gpu().clone();
        gpu.block_on(self.render_to_texture_async(camera, settings, texture))
    }

    /// As [`Renderer::render_to_texture`], without waiting: see [`Renderer::render_async`].
    ///
    /// # Errors
    /// The errors of [`Renderer::render_to_texture`].
    pub async fn render_to_texture_async(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        texture: &wgpu::Texture,
    ) -> Result<()> {
        settings.refuse_aperture("picture in a texture")?;
        if self.device.is_none() {
            return Err(no_device());
        }
        let level = self.chosen(camera, settings)?;
        let at = self.at_level(level);
        at.samples_to_texture(camera, settings, texture).await?;
        self.take_report_from(level);
        Ok(())
    }

    async fn samples_to_texture(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        texture: &wgpu::Texture,
    ) -> Result<()> {
        if settings
            .backdrop
            .as_ref()
            .is_some_and(|b| b.colours().is_some())
        {
            return Err(Error::invalid(
                "settings",
                "backdrop",
                "depths alone, for a texture",
                "colours",
                "leave the colours out, and blend the texture over them",
            ));
        }
        let plan = self.plan(camera, settings)?;
        let device = self.device.as_mut().ok_or_else(no_device)?;
        let drawing = device.draw_to(&self.scene, &plan, &mut self.images, Some(texture));
        let report = drawing.await?;
        self.fallback = None;
        self.drawn(&plan, report);
        Ok(())
    }
}

fn no_device() -> Error {
    let expected = "a renderer that draws on a GPU, as Renderer::on makes it";
    Error::invalid(
        "texture",
        "renderer",
        expected,
        "one that draws on the CPU",
        "call Renderer::render",
    )
}
