//! What lies under a pixel.

use egui::{CollapsingHeader, Ui};
use ewa_splat::render::Picked;
use glam::DVec3;

use crate::app::App;

/// A pixel that was asked about, and what lies under it.
#[derive(Debug, Clone)]
pub(crate) struct Probe {
    pixel: [usize; 2],
    /// Whether the camera is to look at it.
    recentres: bool,
    found: Option<Found>,
}

/// The particle that a pixel shows most of, and where half of its light is gone.
#[derive(Debug, Clone)]
struct Found {
    volume: usize,
    particle: usize,
    position: DVec3,
    share: f32,
    count: usize,
}

impl Probe {
    pub(crate) fn asked(pixel: [usize; 2], recentres: bool) -> Self {
        Self {
            pixel,
            recentres,
            found: None,
        }
    }
}

/// Takes what the worker found.
pub(crate) fn found(app: &mut App, picked: &[Picked]) {
    let most = picked.iter().max_by(|a, b| a.share.total_cmp(&b.share));
    let Some(probe) = &mut app.probe else {
        return;
    };
    probe.found = most.map(|most| Found {
        volume: most.volume,
        particle: most.particle,
        position: most.position,
        share: most.share,
        count: picked.len(),
    });
    let target = probe.found.as_ref().map(|found| found.position);
    if let (true, Some(target), Some(orbit)) = (probe.recentres, target, &mut app.orbit) {
        orbit.recentre(target);
    }
    if target.is_none() {
        app.say("nothing is there".into());
    }
}

pub(crate) fn show(app: &App, ui: &mut Ui) {
    CollapsingHeader::new("Probe")
        .default_open(true)
        .show(ui, |ui| {
            let Some(probe) = &app.probe else {
                ui.label("click in the picture");
                return;
            };
            let [x, y] = probe.pixel;
            ui.label(format!("pixel {x}, {y}"));
            let Some(found) = &probe.found else {
                ui.label("nothing");
                return;
            };
            let p = found.position;
            ui.label(format!("{:.6} {:.6} {:.6}", p.x, p.y, p.z));
            let volumes = app.loaded.as_ref().map(|loaded| &loaded.volumes);
            let title = volumes.and_then(|volumes| volumes.get(found.volume));
            let title = title.map_or("particle", |volume| &volume.title);
            ui.label(format!("{title}: particle {}", found.particle));
            ui.label(format!(
                "{:.1} % of the pixel, which shows {} particles",
                100.0 * found.share,
                found.count
            ));
        });
}
