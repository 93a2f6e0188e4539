//! Tests the editor of the transfer function.

use ewa_splat::command::Automatic;
use ewa_splat::scene::{ScaleName, TransferFunction};

use super::*;

fn function(window: &mut Harness<'_, App>) -> TransferFunction {
    window.state_mut().history().unwrap().function().clone()
}

fn click(window: &mut Harness<'_, App>, name: &str) {
    window.get_by_label(name).click();
    window.step();
    window.step();
}

/// Undo and redo step through the edits without changing them.
#[test]
fn what_is_undone_can_be_redone() {
    let mut window = wake();
    let first = function(&mut window);
    let mut made = Vec::new();
    let point = window.get_by_label_contains("opacity 0.350");
    let mut point = point.rect().center();
    for down in [-40.0, 15.0] {
        let to = point + Vec2::new(0.0, down);
        drag(&mut window, point, to, PointerButton::Primary);
        made.push(function(&mut window));
        point = to;
    }
    assert!(made[0] != first && made[1] != made[0]);
    click(&mut window, "Undo");
    assert_eq!(function(&mut window), made[0]);
    click(&mut window, "Undo");
    assert_eq!(function(&mut window), first);
    click(&mut window, "Redo");
    click(&mut window, "Redo");
    assert_eq!(function(&mut window), made[1]);
    assert!(!window.state_mut().history().unwrap().can_redo());
}

/// Functions chosen from the values match those of the options, also when they replace edits or
/// change the scale.
#[test]
fn functions_are_found_as_the_command_finds_them() {
    let grid = fixture("wake.xyz");
    let mut window = window(&[&grid, "--refine", "off"]);
    let before = function(&mut window);
    let [low, high] = before.range();
    let middle = (low + high) / 2.0;
    // Edits the function by the number at the end of its range.
    let app = window.state_mut();
    let history = app.history().unwrap();
    let mut curve = history.curve().clone();
    curve.set_range([low, middle].map(f64::from));
    history.edit(curve, false).unwrap();
    app.automatic.map = Some("plasma".into());
    window.step();
    click(&mut window, "Automatic");
    rest(&mut window);
    let found = function(&mut window);
    assert_eq!(found.range(), [low, middle]);
    assert!(!window.state_mut().history().unwrap().can_undo());
    assert_eq!(pixels(&window), of_command(&mut window));

    window.state_mut().automatic = Automatic {
        scale: Some(ScaleName::Symlog),
        ..Automatic::default()
    };
    click(&mut window, "Automatic");
    rest(&mut window);
    let history = window.state_mut().history().unwrap();
    assert_eq!(history.curve().scale_name(), ScaleName::Symlog);
    assert_eq!(pixels(&window), of_command(&mut window));
    let volume = &window.state().loaded.as_ref().unwrap().volumes[0];
    let bars = &volume.histogram.as_ref().unwrap().counts;
    assert!(bars.iter().filter(|count| **count > 0).count() > 20);
    // A failed choice leaves the current function.
    let good = function(&mut window);
    window.state_mut().automatic.range = Some([-2.0, -1.0]);
    window.state_mut().automatic.scale = Some(ScaleName::Log);
    window.state_mut().find_functions();
    rest(&mut window);
    assert!(window.state().message.as_ref().unwrap().is_error);
    assert_eq!(function(&mut window), good);
    assert_eq!(window.state().automatic.scale, Some(ScaleName::Symlog));
}
