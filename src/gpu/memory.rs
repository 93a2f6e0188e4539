//! Allocates, writes and reads buffers, within the limits of the device.

use std::future::poll_fn;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

use bytemuck::Pod;
use wgpu::{BufferUsages, CommandEncoder, ErrorFilter};

use super::device::{Gpu, one_line};
use crate::error::{Error, Result};

/// Bytes of a storage buffer without contents. A binding needs at least one element of the type that the
/// shader declares; the largest elements are near terms.
const EMPTY_BUFFER: u64 = 512;

/// A staging buffer that is being mapped for the CPU. Dropping it unmaps the buffer.
#[derive(Debug)]
struct Mapping<'a> {
    staging: &'a wgpu::Buffer,
    state: Arc<Mutex<MapState>>,
}

#[derive(Debug, Default)]
struct MapState {
    mapped: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}

impl<'a> Mapping<'a> {
    fn new(staging: &'a wgpu::Buffer) -> Self {
        let state = Arc::<Mutex<MapState>>::default();
        let of_callback = Arc::clone(&state);
        staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
            let mut state = of_callback.lock().unwrap_or_else(PoisonError::into_inner);
            state.mapped = Some(mapped);
            let waker = state.waker.take();
            drop(state);
            if let Some(waker) = waker {
                waker.wake();
            }
        });
        Self { staging, state }
    }

    fn poll(&mut self, context: &Context<'_>) -> Poll<Result<(), wgpu::BufferAsyncError>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        match &state.mapped {
            Some(mapped) => Poll::Ready(mapped.clone()),
            None => {
                state.waker = Some(context.waker().clone());
                Poll::Pending
            }
        }
    }
}

impl Drop for Mapping<'_> {
    fn drop(&mut self) {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let has_failed = matches!(state.mapped, Some(Err(_)));
        // Unmapping calls the callback if the device has not yet answered.
        drop(state);
        if !has_failed {
            self.staging.unmap();
        }
    }
}

impl Gpu {
    /// Makes a storage buffer of `bytes`, rounded up to whole words; of [`EMPTY_BUFFER`] if that is 0.
    ///
    /// # Errors
    /// A size beyond the limit of a binding or the device's memory. The error states the size that was
    /// requested.
    pub(super) fn buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        let bytes = if bytes == 0 { EMPTY_BUFFER } else { bytes };
        let bytes = bytes.next_multiple_of(4);
        let limit = self.max_binding_bytes();
        if bytes > limit {
            return Err(self.out_of_memory(
                label,
                bytes,
                &format!("the adapter binds at most {limit} bytes"),
            ));
        }
        self.create(
            label,
            bytes,
            BufferUsages::STORAGE
                | BufferUsages::COPY_SRC
                | BufferUsages::COPY_DST
                | BufferUsages::INDIRECT,
        )
    }

    /// Makes a storage buffer with the contents `values`.
    ///
    /// # Errors
    /// The errors of [`Gpu::buffer`].
    pub(super) fn upload<T: Pod>(&self, label: &str, values: &[T]) -> Result<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let buffer = self.buffer(label, bytes.len() as u64)?;
        self.write(&buffer, bytes);
        Ok(buffer)
    }

    /// Makes a uniform buffer with the contents `value`. Stages on the device may write it as storage.
    ///
    /// # Errors
    /// The errors of [`Gpu::buffer`].
    pub(super) fn uniform<T: Pod>(&self, label: &str, value: &T) -> Result<wgpu::Buffer> {
        self.uniform_list(label, std::slice::from_ref(value))
    }

    /// As [`Gpu::uniform`], for an array.
    pub(super) fn uniform_list<T: Pod>(&self, label: &str, values: &[T]) -> Result<wgpu::Buffer> {
        let bytes = bytemuck::cast_slice(values);
        let buffer = self.create(
            label,
            bytes.len().next_multiple_of(16) as u64,
            BufferUsages::UNIFORM
                | BufferUsages::STORAGE
                | BufferUsages::COPY_SRC
                | BufferUsages::COPY_DST,
        )?;
        self.write(&buffer, bytes);
        Ok(buffer)
    }

    /// Writes words at the beginning of a buffer: see [`Gpu::write_at`].
    pub(super) fn write(&self, buffer: &wgpu::Buffer, bytes: &[u8]) {
        self.write_at(buffer, 0, bytes);
    }

    /// Writes words from a byte of a buffer on; an incomplete last word is filled up with zeros.
    ///
    /// Large data are written in slices, and each is submitted before the next: pending writes occupy
    /// memory of their own.
    pub(super) fn write_at(&self, buffer: &wgpu::Buffer, first: u64, bytes: &[u8]) {
        /// A multiple of a word.
        const SLICE: usize = 1 << 26;
        for (offset, slice) in (first..).step_by(SLICE).zip(bytes.chunks(SLICE)) {
            let whole = slice.len() / 4 * 4;
            self.queue.write_buffer(buffer, offset, &slice[..whole]);
            if whole < slice.len() {
                let mut word = [0; 4];
                word[..slice.len() - whole].copy_from_slice(&slice[whole..]);
                let last = offset + whole as u64;
                self.queue.write_buffer(buffer, last, &word);
            }
            if bytes.len() > SLICE {
                self.queue.submit([]);
            }
        }
    }

    /// Reads `count` values from the beginning of `buffer`, after everything submitted has run.
    ///
    /// # Errors
    /// A lost device, or no memory for the copy.
    pub(super) fn read<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.staging("read back", bytes)?;
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes.next_multiple_of(4));
        self.submit(encoder);
        self.block_on(self.read_staging(&staging, |bytes| {
            bytemuck::pod_collect_to_vec(&bytes[..count * size_of::<T>()])
        }))
    }

    /// Makes a buffer that the CPU can read.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn staging(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        self.create(
            label,
            bytes.max(4).next_multiple_of(4),
            BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        )
    }

    /// Passes the bytes of a staging buffer to `read` once the device has run everything submitted. The
    /// caller that drives the future polls the device, as [`Gpu::block_on`] does.
    ///
    /// # Errors
    /// A lost device.
    pub(super) async fn read_staging<R>(
        &self,
        staging: &wgpu::Buffer,
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<R> {
        let mut mapping = Mapping::new(staging);
        let mapped = poll_fn(|context| mapping.poll(context)).await;
        // The device's own error is more precise.
        self.check()?;
        mapped.map_err(|e| self.failed(e.to_string()))?;
        let view = staging
            .get_mapped_range(..)
            .map_err(|e| self.failed(e.to_string()))?;
        Ok(read(&view))
    }

    /// Runs one compute pass.
    pub(super) fn run(&self, encode: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        let mut encoder = self.encoder();
        encode(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        self.submit(encoder);
    }

    pub(super) fn encoder(&self) -> CommandEncoder {
        self.device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    pub(super) fn submit(&self, encoder: CommandEncoder) {
        self.queue.submit([encoder.finish()]);
    }

    /// Returns the greatest number of bytes of a storage buffer binding.
    pub(super) fn max_binding_bytes(&self) -> u64 {
        let limits = &self.limits;
        // Whole vectors of words, counted in 32 bits.
        limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size)
            .min(u32::MAX.into())
            / 16
            * 16
    }

    fn create(&self, label: &str, bytes: u64, usage: BufferUsages) -> Result<wgpu::Buffer> {
        let create = || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        if cfg!(target_family = "wasm") {
            // A browser reports errors later: the frame's own scopes catch them.
            return Ok(create());
        }
        let scopes = [ErrorFilter::Validation, ErrorFilter::OutOfMemory]
            .map(|filter| self.device.push_error_scope(filter));
        let buffer = create();
        let mut error = None;
        for scope in scopes.into_iter().rev() {
            // Elsewhere the result is known at once.
            error = pollster::block_on(scope.pop()).or(error);
        }
        match error {
            None => Ok(buffer),
            Some(e) => Err(self.out_of_memory(label, bytes, &e.to_string())),
        }
    }

    fn out_of_memory(&self, label: &str, bytes: u64, found: &str) -> Error {
        let most = self.limits.max_buffer_size;
        Error::OutOfMemory {
            adapter: self.adapter(),
            what: label.to_owned(),
            needed: bytes,
            available: (most < bytes).then_some(most),
            found: one_line(found),
        }
    }
}
