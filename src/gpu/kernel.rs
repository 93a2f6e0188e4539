//! Defines a compute pipeline with the buffers bound to it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::constants::MAX_GROUPS;
use super::shader::Shader;

/// Ways in which a shader uses a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    Write,
    /// `var<uniform>`.
    Uniform,
}

/// A compute pipeline whose bindings are 0, 1, 2, ... of group 0.
#[derive(Debug, Clone)]
pub(super) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// A [`Kernel`] with its buffers: ready to be dispatched.
#[derive(Debug)]
pub(super) struct BoundKernel {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

/// Shader, entry point, and names and bits of the constants.
type KernelKey = (String, String, Vec<(String, u64)>);

/// The kernels that a device has compiled.
#[derive(Debug, Clone, Default)]
pub(super) struct KernelCache(Arc<Mutex<Compiled>>);

#[derive(Debug, Default)]
struct Compiled {
    modules: HashMap<String, wgpu::ShaderModule>,
    kernels: HashMap<KernelKey, Kernel>,
}

impl KernelCache {
    /// Returns an entry point of a shader, compiled at the first request.
    ///
    /// - `bindings`: uses of bindings 0, 1, 2, ...; unused bindings are allowed.
    /// - `constants`: values of the shader's `override` declarations.
    pub(super) fn kernel(
        &self,
        device: &wgpu::Device,
        shader: &Shader,
        entry: &str,
        bindings: &[Access],
        constants: &[(&str, f64)],
    ) -> Kernel {
        let bits = constants
            .iter()
            .map(|(n, v)| ((*n).to_string(), v.to_bits()));
        let name = shader.name.to_string();
        let key = (name.clone(), entry.to_string(), bits.collect());
        let cache = self.0.lock();
        let mut cache = cache.unwrap_or_else(PoisonError::into_inner);
        let Compiled { modules, kernels } = &mut *cache;
        if let Some(kernel) = kernels.get(&key) {
            return kernel.clone();
        }
        let module = modules.entry(name).or_insert_with(|| {
            let source = wgpu::ShaderSource::Wgsl(shader.source().into());
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(&shader.name),
                source,
            })
        });
        let kernel = Kernel::compile(device, module, entry, bindings, constants);
        kernels.entry(key).or_insert(kernel).clone()
    }
}

impl Kernel {
    fn compile(
        device: &wgpu::Device,
        module: &wgpu::ShaderModule,
        entry: &str,
        bindings: &[Access],
        constants: &[(&str, f64)],
    ) -> Self {
        let entries: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, access)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: match access {
                        Access::Read => wgpu::BufferBindingType::Storage { read_only: true },
                        Access::Write => wgpu::BufferBindingType::Storage { read_only: false },
                        Access::Uniform => wgpu::BufferBindingType::Uniform,
                    },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(entry),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(entry),
            bind_group_layouts: &[Some(&layout)],
            ..wgpu::PipelineLayoutDescriptor::default()
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&pipeline_layout),
            module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Every shader writes its workgroup memory before it reads it.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        });
        Self { pipeline, layout }
    }

    /// Binds buffers 0, 1, 2, ...
    pub(super) fn bind(
        &self,
        gpu: &impl AsRef<wgpu::Device>,
        buffers: &[&wgpu::Buffer],
    ) -> BoundKernel {
        let entries = whole(buffers);
        BoundKernel {
            pipeline: self.pipeline.clone(),
            group: gpu.as_ref().create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &self.layout,
                entries: &entries,
            }),
        }
    }
}

impl BoundKernel {
    /// Dispatches at least `groups` workgroups, folded into rows of [`MAX_GROUPS`]. A shader finds its
    /// number by `group_index` and ignores numbers that are too large.
    pub(super) fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, groups: u32) {
        if groups == 0 {
            return;
        }
        self.set(pass);
        pass.dispatch_workgroups(groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS), 1);
    }

    /// Dispatches the workgroups given by the three words at `offset` (bytes) of `arguments`.
    pub(super) fn dispatch_indirect(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        arguments: &wgpu::Buffer,
        offset: u64,
    ) {
        self.set(pass);
        pass.dispatch_workgroups_indirect(arguments, offset);
    }

    fn set(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
    }
}

/// Returns bindings 0, 1, 2, ... of whole buffers.
pub(super) fn whole<'a>(buffers: &[&'a wgpu::Buffer]) -> Vec<wgpu::BindGroupEntry<'a>> {
    (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        })
        .collect()
}
