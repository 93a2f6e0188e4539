//! Finds the share that each particle has in a pixel.
//!
//! The colour of a pixel is linear in the colours of the footprints, whatever composites them. If one
//! footprint is red and everything else is black, the pixel's red is that footprint's share. The stages
//! that draw pictures compute the shares, three footprints at a time. This module does not depend on how
//! kernels are evaluated, cut or composited.

use super::frame::CpuFrames;
use super::sort::footprint_index;
use crate::blocks::BlockedScene;
use crate::error::Result;
use crate::frame::backend::{DrawFrames, FrameReport};
use crate::frame::plan::{Draws, FramePlan};
use crate::record::Carried;

/// A particle's share of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Share {
    /// Index of its volume among the blocked volumes.
    pub(crate) volume: usize,
    /// Its block.
    pub(crate) block: u32,
    /// Its index in the block.
    pub(crate) local: u32,
    /// Share of the pixel's colour.
    pub(crate) share: f32,
}

const BLACK: Carried = Carried::of_colour([0.0; 3]);

/// Returns the shares above 0 that particles have in the one pixel of a plan: surfaces first, then the
/// others, each front to back.
///
/// # Errors
/// Cancelled.
pub(crate) fn shares(scene: &BlockedScene, plan: &FramePlan) -> Result<Vec<Share>> {
    let mut pixel = Pixel::new(scene, plan)?;
    let mut shares = Vec::new();
    for number in 0..plan.passes.len() {
        let frames = &pixel.passes[number];
        let order: Vec<usize> = frames.order.iter().map(|&n| footprint_index(n)).collect();
        if plan.passes[number].draws == Draws::Volumes {
            // Shares of volumes do not come from the surface.
            pixel.draw_surface();
        }
        for three in order.chunks(3) {
            let of_three = pixel.draw_in_colours(number, three);
            for (&footprint, share) in three.iter().zip(of_three) {
                if share > 0.0 {
                    shares.push(pixel.share_of(number, footprint, share));
                }
            }
        }
    }
    Ok(shares)
}

/// A pixel that can be drawn repeatedly with other colours.
struct Pixel<'a> {
    scene: &'a BlockedScene,
    plan: &'a FramePlan,
    /// The state of each pass with its own footprints, in black.
    passes: Vec<CpuFrames>,
}

impl<'a> Pixel<'a> {
    fn new(scene: &'a BlockedScene, plan: &'a FramePlan) -> Result<Self> {
        let draw = |pass| -> Result<CpuFrames> {
            let mut frames = CpuFrames::default();
            frames.upload(scene)?;
            frames.draw_pass(scene, plan, pass, &mut FrameReport::default())?;
            for footprint in &mut frames.footprints {
                footprint.carried = BLACK;
            }
            Ok(frames)
        };
        Ok(Self {
            scene,
            plan,
            passes: plan.passes.iter().map(draw).collect::<Result<_>>()?,
        })
    }

    /// Draws the surface, if there is one, and copies it to the passes of volumes.
    fn draw_surface(&mut self) {
        let Some((frames, others)) = self.passes.split_first_mut() else {
            return;
        };
        let pass = &self.plan.passes[0];
        if pass.draws != Draws::Surfaces {
            return;
        }
        frames.rasterise_surface(self.plan, pass, &pass.view);
        for volumes in others {
            volumes.surface.clone_from(&frames.surface);
        }
    }

    /// Draws the pixel with footprints of a pass in red, green and blue.
    fn draw_in_colours(&mut self, pass: usize, footprints: &[usize]) -> [f32; 3] {
        for (channel, &i) in footprints.iter().enumerate() {
            let mut colour = [0.0; 3];
            colour[channel] = 1.0;
            self.passes[pass].footprints[i].carried = Carried::of_colour(colour);
        }
        if self.plan.passes[pass].draws == Draws::Surfaces {
            self.draw_surface();
        }
        let last = self.passes.len() - 1;
        let (frames, plan) = (&mut self.passes[last], &self.plan.passes[last]);
        let tile = if plan.draws == Draws::Volumes {
            frames.rasterise(self.scene, self.plan, plan, &plan.view);
            &frames.tiles[0]
        } else {
            &frames.surface[0]
        };
        let shares = [tile.red[0], tile.green[0], tile.blue[0]];
        for &i in footprints {
            self.passes[pass].footprints[i].carried = BLACK;
        }
        shares
    }

    fn share_of(&self, pass: usize, footprint: usize, share: f32) -> Share {
        let frames = &self.passes[pass];
        let mut first = 0;
        let mut volume = 0;
        while footprint >= first + frames.totals[volume] {
            first += frames.totals[volume];
            volume += 1;
        }
        let particle = &frames.classified[footprint];
        Share {
            volume,
            block: frames.views[volume][particle.view as usize].block,
            local: particle.local,
            share,
        }
    }
}
