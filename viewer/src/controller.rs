//! Controls how coarse pictures are during motion, so that each fits the time of a frame.

use std::time::Duration;

use ewa_splat::scene::Classification;

/// Time of a frame while the camera or a transfer function moves.
pub(crate) const WANTED: Duration = Duration::from_millis(33);

/// Loosest tolerance of pictures in motion, in linear colour. Beyond it, they no longer resemble
/// pictures at rest.
const LOOSEST: f32 = 0.05;

/// Smallest share of the pixels that is drawn.
const LEAST: f32 = 1.0 / 16.0;

/// Largest factor by which merging may exceed its share of the tolerance, once fewer pixels save no
/// more time. With a million particles in clusters seen whole, a factor four times as large merges
/// thousands to one, and bars of the coarsest levels become visible.
const MOST_SLACK: f32 = 1024.0;

/// Factor between the merge slacks of successive pictures.
const SLACK_STEP: f32 = 4.0;

/// Ratio of the wanted to the actual frame time, at all pixels, above which the merge slack
/// decreases. The next level draws up to sixteen kernels in place of one.
const FAST: f32 = 4.0;

/// Coarseness of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coarseness {
    /// Share of the picture's pixels that are drawn, 1 for all.
    pub(crate) share: f32,
    /// Tolerance in linear colour.
    pub(crate) tolerance: f32,
    /// Factor by which merging may exceed its share of the tolerance; 1 keeps to the tolerance.
    pub(crate) merge_slack: f32,
}

impl Coarseness {
    /// Returns no coarseness: the picture that was asked for.
    pub(crate) fn none(tolerance: f32) -> Self {
        Self {
            share: 1.0,
            tolerance,
            merge_slack: 1.0,
        }
    }

    /// Returns the classification: merged kernels are classified by their value alone.
    pub(crate) fn classification(self, asked: Classification) -> Classification {
        match asked {
            Classification::Extent if self.merge_slack > 1.0 => Classification::Particle,
            _ => asked,
        }
    }

    /// Returns the width and height that are drawn for a picture of this size.
    pub(crate) fn size(self, size: [usize; 2]) -> [usize; 2] {
        let side = self.share.sqrt();
        size.map(|n| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "no larger than the window"
            )]
            let shorter = (n as f32 * side).round() as usize;
            shorter.clamp(1, n.max(1))
        })
    }
}

/// Finds the finest picture that fits the frame time, from the times of previous pictures.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Controller {
    share: f32,
    merge_slack: f32,
}

impl Default for Controller {
    fn default() -> Self {
        Self {
            share: 0.5,
            merge_slack: 1.0,
        }
    }
}

impl Controller {
    /// Returns the coarseness of the next picture in motion.
    pub(crate) fn next(&self, tolerance: f32) -> Coarseness {
        // Fewer pixels hide errors as they hide details, so the tolerance loosens with the share.
        let looser = tolerance / self.share;
        Coarseness {
            share: self.share,
            tolerance: looser.min(LOOSEST.max(tolerance)),
            merge_slack: self.merge_slack,
        }
    }

    /// Adapts to the time that the last picture took.
    pub(crate) fn took(&mut self, time: Duration) {
        let ratio = WANTED.as_secs_f32() / time.as_secs_f32().max(1e-4);
        // Costs grow more slowly than the number of pixels. A small exponent damps the change so
        // that it settles; it is larger for slow frames than for fast ones.
        let factor = ratio.powf(if ratio < 1.0 { 0.8 } else { 0.4 });
        if self.share <= LEAST && factor < 1.0 {
            self.merge_slack = (self.merge_slack * SLACK_STEP).min(MOST_SLACK);
        } else if self.share >= 1.0 && ratio > FAST {
            self.merge_slack = (self.merge_slack / SLACK_STEP).max(1.0);
        }
        self.share = (self.share * factor.clamp(0.25, 1.5)).clamp(LEAST, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simulates pictures with a fixed cost and a cost per pixel; returns the time once it settles.
    fn settled(fixed_ms: f32, all_ms: f32) -> f32 {
        let mut controller = Controller::default();
        for _ in 0..40 {
            let share = controller.next(0.004).share;
            controller.took(Duration::from_secs_f32((fixed_ms + all_ms * share) / 1e3));
        }
        fixed_ms + all_ms * controller.next(0.004).share
    }

    #[test]
    fn it_settles_at_the_time_that_is_wanted() {
        assert!((settled(5.0, 100.0) - 33.0).abs() < 3.0);
        assert!((settled(20.0, 60.0) - 33.0).abs() < 3.0);
        // A light scene draws all pixels, a heavy one the smallest share.
        assert!((settled(1.0, 10.0) - 11.0).abs() < 0.1);
        assert!((settled(40.0, 160.0) - 50.0).abs() < 0.1);
    }

    #[test]
    fn tolerances_loosen_with_the_pixels_and_never_tighten() {
        let of = |share| Controller {
            share,
            ..Controller::default()
        };
        let heavy = of(LEAST);
        assert_eq!(heavy.next(0.004).tolerance, LOOSEST);
        assert_eq!(heavy.next(0.2).tolerance, 0.2);
        let light = of(1.0);
        assert_eq!(light.next(0.004), Coarseness::none(0.004));
        assert_eq!(
            Coarseness {
                share: 0.25,
                ..Coarseness::none(0.0)
            }
            .size([1024, 640]),
            [512, 320]
        );
    }

    /// Simulates pictures whose cost depends on the number of kernels, of which merging leaves a
    /// sixteenth.
    #[test]
    fn kernels_are_merged_where_fewer_pixels_are_not_enough() {
        let mut controller = Controller::default();
        let mut took = |kernels_ms: f32, count: u32| {
            let mut last = controller.next(0.004);
            for _ in 0..count {
                last = controller.next(0.004);
                let merged = if last.merge_slack > 30.0 { 16.0 } else { 1.0 };
                let time = kernels_ms / merged + 30.0 * last.share;
                controller.took(Duration::from_secs_f32(time / 1e3));
            }
            last
        };
        let heavy = took(110.0, 40);
        assert!(heavy.merge_slack > 30.0 && heavy.share > 0.5, "{heavy:?}");
        // The slack stays constant, so that merged kernels do not flicker.
        assert_eq!(took(110.0, 1).merge_slack, heavy.merge_slack);
        let light = took(1.0, 40);
        assert_eq!(light.share, 1.0);
        // Few kernels and many pixels give no reason to merge less or more.
        assert!(light.merge_slack <= heavy.merge_slack);
        assert_eq!(Controller::default().next(0.004).merge_slack, 1.0);
    }
}
