//! Tests frames on a caller's device: into its textures, and without waiting.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};

use crate::common::Random;
use crate::common::gpu::gpu;
use crate::common::scene::{Particle, camera, volume};
use ewa_splat::image::srgb_from_linear;
use ewa_splat::render::{Gpu, device_descriptor};
use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::wgpu::{self, TextureFormat, TextureUsages};
use ewa_splat::{ColumnSettings, Composite, Error, Image, Renderer, Settings};
use glam::DVec3;

/// Device as a window opens it, with an error handler that must not be called.
struct Caller {
    adapter: wgpu::Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    /// GPU on that device: its clones share compiled pipelines.
    gpu: Gpu,
    heard: Arc<Mutex<Vec<String>>>,
}

impl Caller {
    /// Opens a device, or returns `None` if there is no adapter.
    fn new() -> Option<Self> {
        // It uses the adapter of the other tests.
        let name = gpu()?.adapter();
        let descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let is_it = |a: &wgpu::Adapter| {
            let info = a.get_info();
            name.starts_with(&info.name) && name.contains(&format!("{:?}", info.backend))
        };
        let adapter = adapters.into_iter().find(is_it).unwrap();
        let (device, queue) = Self::open(&adapter, &device_descriptor(&adapter));
        let heard = Arc::<Mutex<Vec<String>>>::default();
        let of_handler = Arc::clone(&heard);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            of_handler.lock().unwrap().push(e.to_string());
        }));
        Some(Self {
            gpu: Gpu::from_device(device.clone(), queue.clone()).unwrap(),
            adapter,
            device,
            queue,
            heard,
        })
    }

    fn open(
        adapter: &wgpu::Adapter,
        descriptor: &wgpu::DeviceDescriptor<'_>,
    ) -> (wgpu::Device, wgpu::Queue) {
        pollster::block_on(adapter.request_device(descriptor)).unwrap()
    }

    fn renderer(&self, scene: &[PointVolume]) -> Renderer {
        let renderer = Renderer::new(scene.to_vec()).unwrap();
        renderer.on(self.gpu.clone()).unwrap()
    }

    fn texture(&self, format: TextureFormat, [width, height]: [usize; 2]) -> wgpu::Texture {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        self.device
            .create_texture(&texture_descriptor(format, [width, height], usage))
    }

    /// Reads the bytes of a texture, row by row.
    fn read(&self, texture: &wgpu::Texture) -> Vec<u8> {
        let row = texture.width() * texture.format().block_copy_size(None).unwrap();
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(padded * texture.height()),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded),
                    rows_per_image: None,
                },
            },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., Result::unwrap);
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .unwrap();
        let bytes = staging.get_mapped_range(..).unwrap();
        let rows = bytes.chunks(padded as usize);
        rows.flat_map(|r| &r[..row as usize]).copied().collect()
    }

    fn heard_nothing(&self) {
        assert_eq!(*self.heard.lock().unwrap(), Vec::<String>::new());
    }
}

fn texture_descriptor(
    format: TextureFormat,
    [width, height]: [usize; 2],
    usage: TextureUsages,
) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: width as u32,
            height: height as u32,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    }
}

fn cloud() -> PointVolume {
    let mut random = Random::new(41);
    let particles: Vec<_> = (0..400)
        .map(|_| Particle {
            position: DVec3::Z * 4.0 + random.point(1.0),
            factor: random.factor(0.05, 3.0),
            mass: 4e-3,
            colour: [0; 3].map(|_| random.range(0.0, 1.0) as f32),
        })
        .collect();
    volume(&particles)
}

/// Returns an opaque plane obliquely across the cloud.
fn plane() -> PointVolume {
    let mut positions = Vec::new();
    let (across, along) = (DVec3::X * 0.1, DVec3::new(0.0, 0.08, 0.06));
    for n in 0..256 {
        let (i, j) = (f64::from(n % 16) - 7.5, f64::from(n / 16) - 7.5);
        positions.push(DVec3::Z * 4.0 + across * i + along * j);
    }
    let [a, b] = [across, along].map(|t| (0.7 * t).as_vec3());
    PointVolume {
        strength: Strength::Surface(vec![0.01; positions.len()]),
        colour: Colour::Uniform([0.7, 0.5, 0.2]),
        particles: Particles::Surfels {
            tangents: vec![[a.x, a.y, a.z, b.x, b.y, b.z]; positions.len()],
            positions,
            is_one_sided: false,
        },
        values: None,
        transfer_function: None,
        boundary: None,
        normals: None,
        local_models: None,
    }
}

fn view(size: [usize; 2]) -> Camera {
    camera(Projection::Perspective, [1.5 * size[0] as f64; 2], size)
}

/// Returns scenes of one pass and of two, at sizes that tiles do not divide, for comparisons to the
/// bit.
fn cases() -> Vec<(&'static str, Vec<PointVolume>, Camera, Settings)> {
    let all = Settings {
        depth: true,
        normals: true,
        background: Some([0.1, 0.2, 0.4]),
        ..Settings::default()
    };
    let slabs = Settings {
        composite: Composite::Slabs {
            thickness: Some(0.1),
        },
        depth: true,
        ..Settings::default()
    };
    let plain = Settings::default;
    let pixel = camera(Projection::Perspective, [20.0; 2], [1, 1]);
    vec![
        ("volume", vec![cloud()], view([64, 48]), plain()),
        ("volume, odd size", vec![cloud()], view([71, 37]), plain()),
        ("surface", vec![plane()], view([33, 50]), plain()),
        ("hybrid", vec![cloud(), plane()], view([71, 37]), plain()),
        ("hybrid, all", vec![cloud(), plane()], view([71, 37]), all),
        ("slabs", vec![cloud()], view([50, 41]), slabs),
        ("a pixel", vec![cloud(), plane()], pixel, plain()),
    ]
}

fn assert_same_bits(name: &str, bytes: &[u8], image: &Image) {
    let pixels = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(bytes);
    assert_eq!(pixels.len(), image.pixels.len(), "{name}");
    for (i, (got, expected)) in pixels.iter().zip(&image.pixels).enumerate() {
        let (x, y) = (i % image.width, i / image.width);
        assert_eq!(
            got.map(f32::to_bits),
            expected.map(f32::to_bits),
            "{name}, pixel ({x}, {y}): {got:?} and {expected:?}"
        );
    }
}

#[test]
fn a_float_texture_holds_the_picture_to_the_bit() {
    let Some(caller) = Caller::new() else { return };
    for (name, scene, camera, settings) in cases() {
        let on_own = Renderer::new(scene.clone()).unwrap();
        let mut on_own = on_own.on(gpu().unwrap().clone()).unwrap();
        on_own.render(&camera, &settings).unwrap();
        let expected = on_own.image();
        let lit = expected.pixels.iter().filter(|p| p[3] > 0.1).count();
        assert!(lit * 4 > expected.pixels.len(), "{name}: {lit} pixels");

        let texture = caller.texture(TextureFormat::Rgba32Float, [camera.width, camera.height]);
        let mut renderer = caller.renderer(&scene);
        // As the first frame, whose buffers may be too small; after one; and after a picture.
        for round in 0..3 {
            renderer
                .render_to_texture(&camera, &settings, &texture)
                .unwrap();
            assert_same_bits(name, &caller.read(&texture), expected);
            assert_eq!(renderer.counts(), on_own.counts(), "{name}");
            assert_eq!(renderer.depth(), on_own.depth(), "{name}");
            assert_eq!(renderer.normals(), on_own.normals(), "{name}");
            assert_eq!(renderer.depth().is_some(), settings.depth);
            if round == 0 {
                assert_eq!(renderer.image(), &Image::default(), "{name}: read back");
            } else {
                assert_eq!(renderer.render(&camera, &settings).unwrap(), expected);
            }
        }
    }
    caller.heard_nothing();
}

#[test]
fn bands_lie_in_a_texture_where_they_lie_in_the_picture() {
    let Some(caller) = Caller::new() else { return };
    let settings = Settings {
        depth: true,
        ..Settings::default()
    };
    let camera = view([150, 100]);
    let scene = vec![cloud(), plane()];
    let (device, queue) = (caller.device.clone(), caller.queue.clone());
    let mut whole = Renderer::new(scene.clone())
        .unwrap()
        .on(Gpu::from_device(device, queue).unwrap())
        .unwrap();
    whole.render(&camera, &settings).unwrap();
    let expected = whole.image();
    // Two rows of tiles of five words twice: four bands.
    let limited = caller.gpu.clone().with_binding_limit(200_000);
    let mut cut = Renderer::new(scene).unwrap().on(limited).unwrap();
    let texture = caller.texture(TextureFormat::Rgba32Float, [150, 100]);
    cut.render_to_texture(&camera, &settings, &texture).unwrap();
    assert_same_bits("bands", &caller.read(&texture), expected);
    assert_eq!(cut.depth(), whole.depth());
    caller.heard_nothing();
}

/// Returns the value of an IEEE half.
fn wide(half: u16) -> f32 {
    let (exponent, mantissa) = (i32::from(half >> 10 & 31), f32::from(half & 1023));
    let magnitude = if exponent == 0 {
        mantissa * 2.0_f32.powi(-24)
    } else {
        (1.0 + mantissa / 1024.0) * 2.0_f32.powi(exponent - 15)
    };
    if half >> 15 == 0 {
        magnitude
    } else {
        -magnitude
    }
}

#[test]
fn other_formats_hold_what_the_table_says() {
    let Some(caller) = Caller::new() else { return };
    let (scene, camera) = ([cloud()], view([71, 37]));
    for background in [None, Some([0.05, 0.2, 0.6])] {
        let settings = Settings {
            background,
            ..Settings::default()
        };
        let mut renderer = caller.renderer(&scene);
        let expected = renderer.render(&camera, &settings).unwrap().clone();
        let mut drawn = |format| {
            let texture = caller.texture(format, [71, 37]);
            renderer
                .render_to_texture(&camera, &settings, &texture)
                .unwrap();
            caller.read(&texture)
        };

        let halves = drawn(TextureFormat::Rgba16Float);
        let halves = bytemuck::pod_collect_to_vec::<u8, [u16; 4]>(&halves);
        for (got, expected) in halves.iter().zip(&expected.pixels) {
            for (got, expected) in got.map(wide).iter().zip(expected) {
                // A mantissa of ten bits, truncated or rounded; the least number has no more.
                let bound = expected.abs() / 1024.0 + 2.0_f32.powi(-24);
                assert!((got - expected).abs() <= bound, "{got} {expected}");
            }
        }

        // Half a code comes from rounding. The rest comes from tables or short series in textures'
        // encoding (lavapipe is .62 off), and from inexact powers in shaders.
        let assert_codes = |name: &str, bytes: &[u8], code: fn([f32; 4]) -> [f32; 3]| {
            let bound = if name.ends_with("-srgb") { 0.75 } else { 0.6 };
            for (got, pixel) in bytes.chunks(4).zip(&expected.pixels) {
                let [r, g, b] = code(*pixel);
                for (got, expected) in got.iter().zip([r, g, b, pixel[3]]) {
                    let off = f32::from(*got) - 255.0 * expected.clamp(0.0, 1.0);
                    assert!(off.abs() <= bound, "{name}: {got}, {pixel:?}");
                }
            }
        };
        let swapped = |mut bytes: Vec<u8>| {
            bytes.chunks_mut(4).for_each(|p| p.swap(0, 2));
            bytes
        };
        let encoded: fn([f32; 4]) -> [f32; 3] =
            |p| [p[0], p[1], p[2]].map(|c| srgb_from_linear(c.clamp(0.0, 1.0)));
        assert_codes("rgba-srgb", &drawn(TextureFormat::Rgba8UnormSrgb), encoded);
        let bytes = swapped(drawn(TextureFormat::Bgra8UnormSrgb));
        assert_codes("bgra-srgb", &bytes, encoded);
        let straight: fn([f32; 4]) -> [f32; 3] = |p| {
            let alpha = if p[3] > 0.0 { p[3] } else { 1.0 };
            let code = |c: f32| p[3] * srgb_from_linear((c / alpha).clamp(0.0, 1.0));
            [code(p[0]), code(p[1]), code(p[2])]
        };
        assert_codes("rgba", &drawn(TextureFormat::Rgba8Unorm), straight);
        let bytes = swapped(drawn(TextureFormat::Bgra8Unorm));
        assert_codes("bgra", &bytes, straight);
    }
    caller.heard_nothing();
}

#[test]
fn textures_that_are_not_drawn_into_are_refused() {
    let Some(caller) = Caller::new() else { return };
    let (camera, settings) = (view([40, 30]), Settings::default());
    let mut renderer = caller.renderer(&[cloud()]);
    let usage = TextureUsages::RENDER_ATTACHMENT;
    let float = TextureFormat::Rgba32Float;
    let sound = texture_descriptor(float, [40, 30], usage);
    let layers = wgpu::TextureDescriptor {
        size: wgpu::Extent3d {
            depth_or_array_layers: 2,
            ..sound.size
        },
        ..sound.clone()
    };
    let samples = wgpu::TextureDescriptor {
        sample_count: 4,
        ..texture_descriptor(TextureFormat::Rgba8Unorm, [40, 30], usage)
    };
    for (descriptor, parts) in [
        (
            texture_descriptor(float, [30, 40], usage),
            ["size", "camera's 40 x 30", "30 x 40"],
        ),
        (
            texture_descriptor(TextureFormat::R8Unorm, [40, 30], usage),
            ["format", "one of Rgba32Float", "R8Unorm"],
        ),
        (
            texture_descriptor(float, [40, 30], TextureUsages::COPY_SRC),
            ["usage", "RENDER_ATTACHMENT", "COPY_SRC"],
        ),
        (layers, ["kind", "one layer", "2 layers"]),
        (samples, ["kind", "one sample", "4 samples"]),
    ] {
        let texture = caller.device.create_texture(&descriptor);
        let error = renderer.render_to_texture(&camera, &settings, &texture);
        let error = error.unwrap_err();
        assert!(!error.is_of_device(), "{error:?}");
        let error = error.to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }

    let texture = caller.device.create_texture(&sound);
    let mut on_cpu = Renderer::new(vec![cloud()]).unwrap();
    let error = on_cpu.render_to_texture(&camera, &settings, &texture);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("one that draws on the CPU"), "{error}");
    let wrong = Settings {
        tolerance: f32::NAN,
        ..Settings::default()
    };
    assert!(
        renderer
            .render_to_texture(&camera, &wrong, &texture)
            .is_err()
    );

    // A texture of another device of the same instance.
    let (other, _) = Caller::open(&caller.adapter, &device_descriptor(&caller.adapter));
    let foreign = other.create_texture(&sound);
    let error = renderer.render_to_texture(&camera, &settings, &foreign);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("expected a device that answers"), "{error}");
    // None of these errors affects the next frame.
    let texture = caller.texture(float, [40, 30]);
    renderer
        .render_to_texture(&camera, &settings, &texture)
        .unwrap();
    let bytes = caller.read(&texture);
    assert_same_bits(
        "after errors",
        &bytes,
        renderer.render(&camera, &settings).unwrap(),
    );
    caller.heard_nothing();
}

#[test]
fn a_device_with_too_low_limits_is_refused_in_words() {
    let Some(caller) = Caller::new() else { return };
    let mut descriptor = device_descriptor(&caller.adapter);
    descriptor
        .required_limits
        .max_storage_buffers_per_shader_stage = 4;
    let (device, queue) = Caller::open(&caller.adapter, &descriptor);
    let error = Gpu::from_device(device, queue).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error:?}");
    let error = error.to_string();
    for part in ["max_storage_buffers_per_shader_stage is 8", "found 4"] {
        assert!(error.contains(part), "{error}");
    }
    // Small buffers suffice: frames are split.
    let mut descriptor = device_descriptor(&caller.adapter);
    let limits = &mut descriptor.required_limits;
    limits.max_storage_buffer_binding_size = 200_000;
    let (device, queue) = Caller::open(&caller.adapter, &descriptor);
    let (camera, settings) = (view([150, 100]), Settings::default());
    let mut small = Renderer::new(vec![cloud()])
        .unwrap()
        .on(Gpu::from_device(device, queue).unwrap())
        .unwrap();
    let mut large = caller.renderer(&[cloud()]);
    assert_eq!(
        small.render(&camera, &settings).unwrap(),
        large.render(&camera, &settings).unwrap()
    );
}

/// Drives a future as a window does: it polls the future and the device once per turn. Returns how
/// often it was pending.
fn drive<T>(device: &wgpu::Device, future: impl Future<Output = T> + Send) -> (T, usize) {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    let mut turns = 0;
    loop {
        if let Poll::Ready(done) = future.as_mut().poll(&mut context) {
            return (done, turns);
        }
        turns += 1;
        device.poll(wgpu::PollType::Poll).unwrap();
    }
}

#[test]
fn frames_without_waiting_are_those_that_wait() {
    let Some(caller) = Caller::new() else { return };
    for (name, scene, camera, settings) in cases().split_off(3) {
        let mut waits = caller.renderer(&scene);
        waits.render(&camera, &settings).unwrap();
        let expected = waits.image();
        let mut renderer = caller.renderer(&scene);
        // The future is dropped at each of the first turns, with buffers in flight.
        for turns in 0..4 {
            let mut future = Box::pin(renderer.render_async(&camera, &settings));
            let mut context = Context::from_waker(Waker::noop());
            for _ in 0..=turns {
                if future.as_mut().poll(&mut context).is_ready() {
                    break;
                }
                caller
                    .device
                    .poll(wgpu::PollType::wait_indefinitely())
                    .unwrap();
            }
        }
        let (image, turns) = drive(&caller.device, renderer.render_async(&camera, &settings));
        assert_eq!(image.unwrap(), expected, "{name}");
        assert!(turns > 0, "{name}");
        assert_eq!(renderer.counts(), waits.counts(), "{name}");
        assert_eq!(renderer.depth(), waits.depth(), "{name}");

        let texture = caller.texture(TextureFormat::Rgba32Float, [camera.width, camera.height]);
        let drawing = renderer.render_to_texture_async(&camera, &settings, &texture);
        drive(&caller.device, drawing).0.unwrap();
        assert_same_bits(name, &caller.read(&texture), expected);
    }
    // Column densities, and the CPU, which never waits.
    let (camera, settings) = (view([40, 30]), ColumnSettings::default());
    let mut waits = caller.renderer(&[cloud()]);
    let mut renderer = caller.renderer(&[cloud()]);
    let drawing = renderer.column_density_async(&camera, &settings);
    let column = drive(&caller.device, drawing).0.unwrap();
    assert_eq!(column, waits.column_density(&camera, &settings).unwrap());
    let mut on_cpu = Renderer::new(vec![cloud()]).unwrap();
    let settings = Settings::default();
    let drawn = drive(&caller.device, on_cpu.render_async(&camera, &settings));
    assert!(drawn.0.is_ok() && drawn.1 == 0);
    caller.heard_nothing();
}

#[test]
fn a_caller_that_loses_its_device_is_told() {
    let Some(caller) = Caller::new() else { return };
    let (camera, settings) = (view([40, 30]), Settings::default());
    let mut renderer = caller.renderer(&[cloud()]);
    renderer.render(&camera, &settings).unwrap();
    caller.device.destroy();
    for _ in 0..2 {
        let error = renderer.render(&camera, &settings).unwrap_err();
        assert!(error.is_of_device(), "{error:?}");
        let texture = caller.texture(TextureFormat::Rgba32Float, [40, 30]);
        let error = renderer.render_to_texture(&camera, &settings, &texture);
        assert!(error.unwrap_err().is_of_device());
    }
}
