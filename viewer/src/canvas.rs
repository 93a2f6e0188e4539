//! Holds the picture that the window shows: uploaded, or drawn on the window's own device.

use std::sync::Arc;

use egui::{ColorImage, Context, TextureHandle, TextureId, TextureOptions};
use egui_wgpu::{RenderState, WgpuConfiguration, WgpuSetup};
use ewa_splat::render::{Backend, Gpu, device_descriptor};
use ewa_splat::wgpu::{FilterMode, TextureViewDescriptor};

use crate::worker::Picture;

/// Texture of the picture.
#[derive(Default)]
pub(crate) struct Canvas {
    /// The window's device; `None` without a window.
    window: Option<RenderState>,
    uploaded: Option<TextureHandle>,
    drawn: Option<TextureId>,
    /// Texture that is shown: one of the two above.
    shown: Option<TextureId>,
}

impl std::fmt::Debug for Canvas {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Canvas")
            .field("shown", &self.shown)
            .finish_non_exhaustive()
    }
}

impl Canvas {
    pub(crate) fn new(window: Option<RenderState>) -> Self {
        Self {
            window,
            ..Self::default()
        }
    }

    /// Returns the device for pictures that are not read back: the window's, if it is hardware or
    /// the GPU was asked for.
    pub(crate) fn device(&self, asked: Backend) -> Option<Gpu> {
        let window = self.window.as_ref()?;
        let gpu = Gpu::from_device(window.device.clone(), window.queue.clone()).ok()?;
        let suits = match asked {
            Backend::Cpu => false,
            _ if Gpu::is_adapter_named() => gpu.is_named(),
            Backend::Gpu => true,
            Backend::Auto => !gpu.is_software(),
        };
        suits.then_some(gpu)
    }

    /// Shows another picture.
    pub(crate) fn show(&mut self, context: &Context, picture: &Picture) {
        match picture {
            Picture::Pixels(image) => {
                let size = [image.width, image.height];
                let texels = ColorImage::from_rgba_unmultiplied(size, &image.to_srgb8());
                let options = TextureOptions::LINEAR;
                let id = match &mut self.uploaded {
                    Some(texture) => {
                        texture.set(texels, options);
                        texture.id()
                    }
                    None => {
                        let texture = context.load_texture("picture", texels, options);
                        self.uploaded.insert(texture).id()
                    }
                };
                self.shown = Some(id);
            }
            Picture::Texture(texture) => {
                let Some(window) = &self.window else {
                    return;
                };
                let view = texture.create_view(&TextureViewDescriptor::default());
                let mut renderer = window.renderer.write();
                let (device, filter) = (&window.device, FilterMode::Linear);
                match self.drawn {
                    Some(id) => {
                        renderer.update_egui_texture_from_wgpu_texture(device, &view, filter, id);
                    }
                    None => {
                        self.drawn = Some(renderer.register_native_texture(device, &view, filter));
                    }
                }
                self.shown = self.drawn;
            }
        }
    }

    /// Returns the texture of the picture, once there is one.
    pub(crate) fn texture(&self) -> Option<TextureId> {
        self.shown
    }
}

/// Returns options by which the window opens a device that the library can draw on.
pub(crate) fn options() -> WgpuConfiguration {
    let mut options = WgpuConfiguration::default();
    if let WgpuSetup::CreateNew(setup) = &mut options.wgpu_setup {
        setup.device_descriptor = Arc::new(device_descriptor);
    }
    options
}
