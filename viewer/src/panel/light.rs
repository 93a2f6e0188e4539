//! Where the light comes from: a ball that is lit as surfaces are, on which it is dragged.

use egui::{CollapsingHeader, Color32, Pos2, Sense, Ui, Vec2};
use ewa_splat::scene::{Light, LightFrame, Lighting};
use glam::DVec3;

use crate::app::App;

const RADIUS: f32 = 40.0;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    CollapsingHeader::new("Light").show(ui, |ui| {
        let lighting = &mut app.settings.lighting;
        let mut is_lit = lighting.is_some();
        if ui
            .checkbox(&mut is_lit, "lit")
            .on_hover_text("surfaces; volumes where the window was started with --lit")
            .changed()
        {
            *lighting = is_lit.then(Lighting::default);
        }
        let (Some(lighting), Some(orbit)) = (lighting, &app.orbit) else {
            return;
        };
        let turn = orbit.camera([2, 2]).camera_from_world;
        let Some(first) = lighting.lights.first().copied() else {
            return;
        };
        let towards = match first.frame {
            LightFrame::World => turn * first.direction,
            LightFrame::Camera => first.direction,
        };
        if let Some(towards) = ball(ui, towards.normalize_or(DVec3::NEG_Z)) {
            // Fixed to the world, as the command line's are.
            let light = Light {
                direction: turn.transpose() * towards,
                frame: LightFrame::World,
                colour: first.colour,
            };
            lighting.lights = vec![light];
        }
        if ui.button("Headlight").clicked() {
            *lighting = Lighting::default();
        }
    });
}

/// Draws the ball; where the light was dragged to, as the camera sees it: x right, y down, z away.
fn ball(ui: &mut Ui, towards: DVec3) -> Option<DVec3> {
    let (response, painter) =
        ui.allocate_painter(Vec2::splat(2.0 * RADIUS + 4.0), Sense::click_and_drag());
    let centre = response.rect.center();
    // Rings of ever lighter discs, towards the light.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "components of a unit vector"
    )]
    let (x, y, faces) = (towards.x as f32, towards.y as f32, -towards.z as f32);
    for i in 0..20_u8 {
        let t = f32::from(i) / 20.0;
        let grey = 40.0 + 180.0 * t * (0.4 + 0.6 * faces.max(0.0));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "from 40 to 220"
        )]
        let colour = Color32::from_gray(grey as u8);
        let middle = centre + Vec2::new(x, y) * (RADIUS * t * 0.9);
        painter.circle_filled(middle, RADIUS * (1.0 - t), colour);
    }
    let label = format!(
        "light from {:.2} {:.2} {:.2}",
        towards.x, towards.y, towards.z
    );
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, &label));
    let at: Pos2 = response.interact_pointer_pos()?;
    if !(response.dragged() || response.clicked()) {
        return None;
    }
    let from = (at - centre) / RADIUS;
    let (x, y) = (f64::from(from.x), f64::from(from.y));
    let length = (x * x + y * y).sqrt();
    Some(match length < 1.0 {
        true => DVec3::new(x, y, -(1.0 - length * length).sqrt()),
        false => DVec3::new(x, y, 0.0) / length,
    })
}
