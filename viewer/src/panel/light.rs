//! Shows the direction of the light on a ball, lit as surfaces are, on which the user drags it.

use egui::{Color32, Pos2, Response, Sense, Slider, Ui, Vec2};
use ewa_splat::scene::{Light, LightFrame, Lighting, MAX_SOFTNESS_DEG, Shadows};
use glam::DVec3;

use super::row::{button, group, row, section, switch};
use crate::app::App;

const RADIUS: f32 = 40.0;

pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let tip = "Where the light comes from that surfaces are shaded by";
    section(ui, "Light", false, tip, |ui| {
        let lighting = &mut app.settings.lighting;
        let mut is_lit = lighting.is_some();
        let tip = "Shade surfaces by their normals; volumes by their gradients where the window was started with --lit\n\
                   --lit, --unlit";
        if switch(ui, "Shading", tip, &mut is_lit).changed() {
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
        let tip = "Where the light comes from, as the camera sees it: drag on the ball\n--light x,y,z[,r,g,b]";
        let dragged = group(ui, "Direction", tip, |ui, row| {
            let (ball, dragged) = ball(ui, towards.normalize_or(DVec3::NEG_Z));
            row.tells(ball);
            dragged
        });
        if let Some(towards) = dragged {
            // The light is fixed to the world, as the command line's lights are.
            let light = Light {
                direction: turn.transpose() * towards,
                frame: LightFrame::World,
                colour: first.colour,
            };
            lighting.lights = vec![light];
        }
        let tip =
            "The light that moves with the camera, over the left shoulder\n--lit without --light";
        if button(ui, "Headlight", tip) {
            *lighting = Lighting {
                shadows: lighting.shadows,
                ..Lighting::default()
            };
        }
        let mut has_shadows = lighting.shadows.is_some();
        let tip = "Let everything that is shown cast shadows of the lights\n--shadows";
        if switch(ui, "Shadows", tip, &mut has_shadows).changed() {
            lighting.shadows = has_shadows.then_some(Shadows::SHARP);
        }
        if let Some(shadows) = &mut lighting.shadows {
            let tip = "Size of the lights, a standard deviation in degrees: shadows blur with distance\n--shadow-softness";
            row(ui, "Softness", tip, |ui| {
                let slider = Slider::new(&mut shadows.softness_deg, 0.0..=MAX_SOFTNESS_DEG);
                ui.add(slider.suffix("°").max_decimals(1))
            });
        }
    });
}

/// Draws the ball. Returns the direction to which the light was dragged, in camera axes: x right, y
/// down, z away.
fn ball(ui: &mut Ui, towards: DVec3) -> (Response, Option<DVec3>) {
    let (response, painter) =
        ui.allocate_painter(Vec2::splat(2.0 * RADIUS + 4.0), Sense::click_and_drag());
    let centre = response.rect.center();
    // Concentric discs become lighter towards the light.
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
    let at: Option<Pos2> = response.interact_pointer_pos();
    let at = at.filter(|_| response.dragged() || response.clicked());
    let towards = at.map(|at| {
        let from = (at - centre) / RADIUS;
        let (x, y) = (f64::from(from.x), f64::from(from.y));
        let length = (x * x + y * y).sqrt();
        match length < 1.0 {
            true => DVec3::new(x, y, -(1.0 - length * length).sqrt()),
            false => DVec3::new(x, y, 0.0) / length,
        }
    });
    (response, towards)
}
