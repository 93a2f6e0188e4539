//! Measures the time of each stage by the device's own clock.

use wgpu::{
    BufferUsages, CommandEncoder, ComputePass, ComputePassDescriptor, ComputePassTimestampWrites,
    QueryType,
};

use super::device::Gpu;
use crate::error::Result;
use crate::stats::StageTimes;

/// Greatest number of passes that one frame can time; further passes are not timed.
const MAX_PASSES: u32 = 1024;

/// A stage of a frame, as [`StageTimes`] lists them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Cull,
    Classify,
    Project,
    Sort,
    Bin,
    Rasterise,
    Resolve,
}

/// Timestamps around the passes of one frame.
#[derive(Debug)]
pub(super) struct Timer {
    queries: Option<Queries>,
    stages: Vec<Stage>,
}

#[derive(Debug)]
struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
}

/// Bytes of the timestamps, two per pass.
const BYTES: u64 = MAX_PASSES as u64 * 2 * 8;

impl Timer {
    /// Makes a timer.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let queries = if gpu.has_timestamps() {
            Some(Queries {
                set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                    label: Some("stages"),
                    ty: QueryType::Timestamp,
                    count: 2 * MAX_PASSES,
                }),
                resolved: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("timestamps"),
                    size: BYTES,
                    usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                }),
                staging: gpu.staging("timestamps", BYTES)?,
            })
        } else {
            None
        };
        Ok(Self {
            queries,
            stages: Vec::new(),
        })
    }

    /// Clears the last frame's passes.
    pub(super) fn clear(&mut self) {
        self.stages.clear();
    }

    /// Begins a pass of a stage.
    pub(super) fn pass<'a>(
        &mut self,
        encoder: &'a mut CommandEncoder,
        stage: Stage,
    ) -> ComputePass<'a> {
        let n = self.stages.len() as u32;
        let timestamp_writes = match &self.queries {
            Some(queries) if n < MAX_PASSES => {
                self.stages.push(stage);
                Some(ComputePassTimestampWrites {
                    query_set: &queries.set,
                    beginning_of_pass_write_index: Some(2 * n),
                    end_of_pass_write_index: Some(2 * n + 1),
                })
            }
            _ => None,
        };
        encoder.begin_compute_pass(&ComputePassDescriptor {
            label: None,
            timestamp_writes,
        })
    }

    /// Copies the timestamps to a readable buffer, after the frame's last pass.
    pub(super) fn finish(&self, encoder: &mut CommandEncoder) {
        let count = 2 * self.stages.len() as u32;
        if let Some(queries) = &self.queries
            && count > 0
        {
            encoder.resolve_query_set(&queries.set, 0..count, &queries.resolved, 0);
            let bytes = u64::from(count) * 8;
            encoder.copy_buffer_to_buffer(&queries.resolved, 0, &queries.staging, 0, bytes);
        }
    }

    /// Returns the times of the frame that has run; zeros if the adapter has no clock.
    ///
    /// # Errors
    /// A lost device.
    pub(super) async fn read(&self, gpu: &Gpu) -> Result<StageTimes> {
        let mut times = StageTimes::default();
        let Some(queries) = &self.queries else {
            return Ok(times);
        };
        if self.stages.is_empty() {
            return Ok(times);
        }
        let staging = &queries.staging;
        let ticks: Vec<u64> = gpu
            .read_staging(staging, bytemuck::pod_collect_to_vec)
            .await?;
        let period_ms = f64::from(gpu.queue.get_timestamp_period()) * 1e-6;
        for (stage, pair) in self.stages.iter().zip(ticks.chunks_exact(2)) {
            let ms = pair[1].saturating_sub(pair[0]) as f64 * period_ms;
            *match stage {
                Stage::Cull => &mut times.cull,
                Stage::Classify => &mut times.classify,
                Stage::Project => &mut times.project,
                Stage::Sort => &mut times.sort,
                Stage::Bin => &mut times.bin,
                Stage::Rasterise => &mut times.rasterise,
                Stage::Resolve => &mut times.resolve,
            } += ms;
        }
        Ok(times)
    }
}
