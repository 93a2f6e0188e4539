//! Opens adapters, checks their limits, and collects the errors of devices.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use wgpu::{Backends, DeviceType, ErrorFilter, Features, Limits};

use super::kernel::{Access, Kernel, KernelCache};
use super::shader::Shader;
use crate::error::{Error, Hint, Result};

/// Time after which a running frame counts as hung. Software adapters take minutes for what a graphics
/// card does in milliseconds (twenty million particles: six minutes on two busy cores).
const TIMEOUT: Duration = Duration::from_secs(3600);

/// Text of errors if there is no adapter at all.
const NONE: &str = "none";

/// A choice of adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AdapterChoice {
    /// A hardware adapter if there is one, a software adapter otherwise.
    #[default]
    Any,
    /// A hardware adapter only.
    Hardware,
}

/// An open device, on which every stage of the GPU back end runs. Clones share the device and the
/// pipelines compiled for it.
#[derive(Debug, Clone)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) limits: Limits,
    kernels: KernelCache,
    info: wgpu::AdapterInfo,
    fault: Arc<Mutex<Option<String>>>,
    /// True if the caller opened the device. If so, uncaught errors are the caller's.
    is_callers: bool,
}

/// One limit of a device.
type Limit = fn(&Limits) -> u64;

/// Limits that every stage relies on. WebGPU guarantees all of them.
const NEEDED: [(&str, Limit); 7] = [
    ("max_storage_buffers_per_shader_stage", |l| {
        l.max_storage_buffers_per_shader_stage.into()
    }),
    ("max_uniform_buffer_binding_size", |l| {
        l.max_uniform_buffer_binding_size
    }),
    ("max_bindings_per_bind_group", |l| {
        l.max_bindings_per_bind_group.into()
    }),
    ("max_compute_workgroup_storage_size", |l| {
        l.max_compute_workgroup_storage_size.into()
    }),
    ("max_compute_invocations_per_workgroup", |l| {
        l.max_compute_invocations_per_workgroup.into()
    }),
    ("max_compute_workgroup_size_x", |l| {
        l.max_compute_workgroup_size_x.into()
    }),
    ("max_compute_workgroups_per_dimension", |l| {
        l.max_compute_workgroups_per_dimension.into()
    }),
];

/// Returns the device description to request from an adapter, so that [`Gpu::from_device`] accepts the
/// device. It asks for the limits that WebGPU guarantees, for buffers as large as the adapter's, and for
/// timestamps if available. Callers may raise other limits for their own needs. Smaller buffers suffice
/// too; frames are then divided into smaller pieces.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # use ewa_splat::wgpu;
/// # let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
/// # let wanted = wgpu::RequestAdapterOptions::default();
/// # let Ok(adapter) = pollster::block_on(instance.request_adapter(&wanted)) else {
/// #     return Ok(());
/// # };
/// use ewa_splat::render::{Gpu, device_descriptor};
///
/// let asked = device_descriptor(&adapter);
/// let (device, queue) = pollster::block_on(adapter.request_device(&asked))?;
/// let gpu = Gpu::from_device(device, queue)?;
/// println!("{}", gpu.adapter());
/// # Ok(())
/// # }
/// ```
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    let limits = adapter.limits();
    let required_limits = Limits {
        max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
        max_buffer_size: limits.max_buffer_size,
        ..Limits::default()
    };
    wgpu::DeviceDescriptor {
        label: Some("ewa-splat"),
        required_features: adapter.features() & Features::TIMESTAMP_QUERY,
        // A device of a lesser adapter opens as well; `from_device` reports the missing limit.
        required_limits: required_limits.or_worse_values_from(&limits),
        ..wgpu::DeviceDescriptor::default()
    }
}

/// Environment variable that names an adapter by a part of its description.
const ADAPTER_VARIABLE: &str = "EWA_ADAPTER";

impl Gpu {
    /// Returns whether the environment variable `EWA_ADAPTER` asks for a certain adapter.
    pub fn is_adapter_named() -> bool {
        Self::adapter_name().is_some()
    }

    fn adapter_name() -> Option<String> {
        std::env::var(ADAPTER_VARIABLE)
            .ok()
            .filter(|n| !n.is_empty())
    }

    /// Wraps a device that the caller opened and continues to use, such as a window's. See
    /// [`device_descriptor`] for the device to request. The caller's handlers of errors and of a lost
    /// device stay in place. An error in a frame is returned by the frame.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if a limit of the device is lower than the stages require.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self> {
        let (limits, info) = (device.limits(), device.adapter_info());
        let guaranteed = Limits::default();
        for (name, of) in NEEDED {
            let (expected, found) = (of(&guaranteed), of(&limits));
            if found < expected {
                return Err(Error::Unsupported {
                    place: describe(&info),
                    expected: format!("a device whose {name} is {expected} or more"),
                    found: found.to_string(),
                    advice: "request the device by render::device_descriptor, or draw on the CPU"
                        .into(),
                });
            }
        }
        Ok(Self {
            device,
            queue,
            limits,
            kernels: KernelCache::default(),
            info,
            fault: Arc::default(),
            is_callers: true,
        })
    }

    /// Opens an adapter: discrete before integrated before software. If the environment variable
    /// `EWA_ADAPTER` is set, it opens the first adapter whose name contains it (in any case).
    ///
    /// # Errors
    /// No adapter, none of that name, or one that cannot be opened. The error lists the adapters.
    pub fn open(choice: AdapterChoice) -> Result<Self> {
        pollster::block_on(Self::open_async(choice))
    }

    /// As [`Gpu::open`], without waiting: for browsers, which must not block.
    ///
    /// # Errors
    /// The errors of [`Gpu::open`].
    pub async fn open_async(choice: AdapterChoice) -> Result<Self> {
        Self::find(choice, Self::adapter_name().as_deref()).await
    }

    /// As [`Gpu::open`], with the name given instead of read from the environment. A name takes
    /// precedence over the choice.
    ///
    /// # Errors
    /// The errors of [`Gpu::open`].
    pub fn open_named(choice: AdapterChoice, name: Option<&str>) -> Result<Self> {
        pollster::block_on(Self::find(choice, name))
    }

    async fn find(choice: AdapterChoice, name: Option<&str>) -> Result<Self> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        // No validation flags: the stages' own arguments are in range by construction.
        descriptor.flags = wgpu::InstanceFlags::empty();
        let instance = wgpu::Instance::new(descriptor);
        let mut adapters = instance.enumerate_adapters(Backends::PRIMARY).await;
        adapters.retain(|a| {
            a.get_downlevel_capabilities()
                .flags
                .contains(wgpu::DownlevelFlags::COMPUTE_SHADERS)
        });
        let described = |adapters: &[wgpu::Adapter]| {
            let names: Vec<_> = adapters
                .iter()
                .map(|a| {
                    let info = a.get_info();
                    let kind = if is_software(&info) {
                        ", a software adapter"
                    } else {
                        ""
                    };
                    describe(&info) + kind
                })
                .collect();
            if names.is_empty() {
                NONE.to_string()
            } else {
                names.join("; ")
            }
        };
        let found = described(&adapters);
        if let Some(name) = name {
            let name = name.to_lowercase();
            adapters.retain(|a| describe(&a.get_info()).to_lowercase().contains(&name));
        } else if choice == AdapterChoice::Hardware {
            adapters.retain(|a| !is_software(&a.get_info()));
        }
        adapters.sort_by_key(|a| rank(a.get_info().device_type));
        let Some(adapter) = adapters.into_iter().next() else {
            return Err(no_adapter(choice, name, found));
        };
        let opened = adapter.request_device(&device_descriptor(&adapter)).await;
        let (device, queue) = opened.map_err(|e| Error::NoAdapter {
            place: describe(&adapter.get_info()),
            expected: "an adapter that opens".into(),
            found: e.to_string(),
            advice: Hint::OtherAdapterOrCpu.into(),
        })?;
        let gpu = Self {
            is_callers: false,
            ..Self::from_device(device, queue)?
        };
        let on_lost = Arc::clone(&gpu.fault);
        gpu.device.set_device_lost_callback(move |reason, message| {
            note(&on_lost, format!("device lost: {reason:?} {message}"));
        });
        let on_error = Arc::clone(&gpu.fault);
        gpu.device
            .on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
                note(&on_error, error.to_string());
            }));
        Ok(gpu)
    }

    /// Limits bindings to at most `bytes`, as on a smaller adapter. Larger data are divided into parts,
    /// depth chunks and bands.
    #[must_use]
    pub fn with_binding_limit(mut self, bytes: u64) -> Self {
        let limit = &mut self.limits.max_storage_buffer_binding_size;
        *limit = bytes.min(*limit);
        self
    }

    /// Returns whether a thread may have more memory of its own than the 8,192 bytes that WGSL guarantees.
    pub(super) fn has_more_private_memory(&self) -> bool {
        !matches!(
            self.info.backend,
            wgpu::Backend::BrowserWebGpu | wgpu::Backend::Metal
        )
    }

    /// Returns the adapter's name, driver and interface.
    pub fn adapter(&self) -> String {
        describe(&self.info)
    }

    /// Returns the device, on which the caller makes the textures that frames are drawn into.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Returns the device's queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Returns whether the environment variable `EWA_ADAPTER` asks for this adapter.
    pub fn is_named(&self) -> bool {
        let own = self.adapter().to_lowercase();
        Self::adapter_name().is_some_and(|name| own.contains(&name.to_lowercase()))
    }

    /// Returns whether the adapter runs in software on the CPU.
    pub fn is_software(&self) -> bool {
        is_software(&self.info)
    }

    /// Returns whether stages can be timed.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(Features::TIMESTAMP_QUERY)
    }

    /// Destroys the device, including a caller's, with all memory that scenes hold on it. Any drawing
    /// with this `Gpu` or its clones, now or later, returns an error.
    pub fn close(&self) {
        note(&self.fault, "a device that was closed".to_string());
        self.device.destroy();
        // The memory is free once nothing runs; the error is expected.
        drop(self.wait());
    }

    /// Returns an entry point of a shader: see [`KernelCache::kernel`].
    pub(super) fn kernel(
        &self,
        shader: &Shader,
        entry: &str,
        bindings: &[Access],
        constants: &[(&str, f64)],
    ) -> Kernel {
        self.kernels
            .kernel(&self.device, shader, entry, bindings, constants)
    }

    /// Waits until everything submitted has run.
    ///
    /// # Errors
    /// A lost or hung device, and any error that it has reported since it was opened.
    pub(super) fn wait(&self) -> Result<()> {
        let poll = || {
            self.device.poll(wgpu::PollType::Wait {
                submission_index: None,
                timeout: Some(TIMEOUT),
            })
        };
        // wgpu panics if the wait itself finds the device lost, after the device's callback has noted it.
        let polled = catch_unwind(AssertUnwindSafe(poll));
        self.check()?;
        match polled {
            Ok(polled) => polled.map(|_| ()).map_err(|e| self.failed(e.to_string())),
            Err(_) => Err(self.failed("a device that cannot be waited for".to_string())),
        }
    }

    /// Drives a future that the device completes, waiting for the device in between.
    ///
    /// # Errors
    /// The errors of the future and of [`Gpu::wait`]. In a browser, which cannot wait, a future that does not
    /// complete at once.
    pub(crate) fn block_on<T>(&self, future: impl Future<Output = Result<T>>) -> Result<T> {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(done) = future.as_mut().poll(&mut context) {
                return done;
            }
            if cfg!(target_family = "wasm") {
                return Err(Error::Unsupported {
                    place: self.adapter(),
                    expected: "a call that does not wait".to_owned(),
                    found: "one that does, in a browser".to_owned(),
                    advice: "await the function of this name that ends in _async".into(),
                });
            }
            self.wait()?;
        }
    }

    /// Issues commands to the device. Errors of a caller's device do not reach the caller's handler.
    ///
    /// # Errors
    /// Errors that a caller's device reports.
    pub(super) async fn watched<R>(&self, commands: impl FnOnce() -> R) -> Result<R> {
        if !self.is_callers {
            return Ok(commands());
        }
        let (out, scopes) = {
            let filters = [
                ErrorFilter::Validation,
                ErrorFilter::OutOfMemory,
                ErrorFilter::Internal,
            ];
            let scopes = filters.map(|filter| self.device.push_error_scope(filter));
            let out = commands();
            let popped = scopes.into_iter().rev().map(wgpu::ErrorScopeGuard::pop);
            (out, popped.collect::<Vec<_>>())
        };
        let mut error = None;
        for scope in scopes {
            error = scope.await.or(error);
        }
        match error {
            None => Ok(out),
            Some(error) => Err(self.failed(error.to_string())),
        }
    }

    /// Checks for errors.
    ///
    /// # Errors
    /// The first error that the device has reported since it was opened.
    pub(super) fn check(&self) -> Result<()> {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        fault
            .as_ref()
            .map_or(Ok(()), |m| Err(self.failed(m.clone())))
    }

    /// Returns the error of a device that has failed.
    pub(super) fn failed(&self, found: String) -> Error {
        Error::DeviceLost {
            adapter: self.adapter(),
            found: one_line(&found),
        }
    }
}

impl AsRef<wgpu::Device> for Gpu {
    fn as_ref(&self) -> &wgpu::Device {
        &self.device
    }
}

/// Returns a message of wgpu on one line, as errors are printed.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Stores the first error that a device reports.
fn note(fault: &Mutex<Option<String>>, message: String) {
    let mut fault = fault.lock().unwrap_or_else(PoisonError::into_inner);
    fault.get_or_insert(message);
}

fn rank(kind: DeviceType) -> u32 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == DeviceType::Cpu
}

fn describe(info: &wgpu::AdapterInfo) -> String {
    let driver = [&info.driver, &info.driver_info].map(String::as_str);
    let driver = driver.join(" ");
    format!("{} ({}, {:?})", info.name, driver.trim(), info.backend)
}

fn no_adapter(choice: AdapterChoice, name: Option<&str>, found: String) -> Error {
    let expected = match (name, choice) {
        (Some(name), _) => format!("an adapter whose name contains '{name}' (EWA_ADAPTER)"),
        (None, AdapterChoice::Hardware) => "a hardware adapter".to_string(),
        (None, AdapterChoice::Any) => "a Vulkan, Metal or DirectX 12 adapter".to_string(),
    };
    let advice = if name.is_some() && found != NONE {
        Hint::ListedAdapterOrCpu
    } else {
        Hint::InstallDriverOrCpu
    };
    Error::NoAdapter {
        place: "adapters".into(),
        expected,
        found,
        advice: advice.into(),
    }
}
