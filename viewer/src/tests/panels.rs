//! Tests the panels as a first-time user sees them.

use egui::accesskit::Role;
use egui_kittest::kittest::NodeT as _;
use ewa_splat::command::Over;

use super::*;

/// Sources of the panels.
const SOURCES: [&str; 14] = [
    include_str!("../panel/camera.rs"),
    include_str!("../panel/clip.rs"),
    include_str!("../panel/help.rs"),
    include_str!("../panel/inputs.rs"),
    include_str!("../panel/light.rs"),
    include_str!("../panel/method.rs"),
    include_str!("../panel/output.rs"),
    include_str!("../panel/over.rs"),
    include_str!("../panel/path.rs"),
    include_str!("../panel/probe.rs"),
    include_str!("../panel/statistics.rs"),
    include_str!("../panel/status.rs"),
    include_str!("../panel/time.rs"),
    include_str!("../panel/transfer.rs"),
];

/// Roles of the widgets that a user can operate.
const USED: [Role; 8] = [
    Role::Button,
    Role::CheckBox,
    Role::ColorWell,
    Role::ComboBox,
    Role::Slider,
    Role::SpinButton,
    Role::TextInput,
    Role::RadioButton,
];

/// Widgets at the ends of rows. Their tooltips, given like all others, do not come up under the pointer of this test,
/// for a reason not known.
const NOT_SEEN: [&str; 4] = ["Normal", "Flip", "-z", "Save view"];

/// Each widget has a tooltip that describes it.
#[test]
fn everything_has_a_tooltip() {
    let mut window = wake();
    window.set_size(Vec2::new(1280.0, 2400.0));
    window.ctx.all_styles_mut(|style| {
        style.interaction.tooltip_delay = 0.0;
        style.interaction.show_tooltips_only_when_still = false;
    });
    for name in [
        "Clip",
        "Annotations",
        "Light",
        "Camera path",
        "Output",
        "Statistics",
    ] {
        window.get_by_label(name).click();
        window.step();
        window.step();
    }
    for name in ["Box", "Plane", "Save view", "Add key frame"] {
        window.get_by_label(name).click();
        window.step();
        window.step();
    }
    rest(&mut window);
    window.run_steps(30);
    let nodes: Vec<_> = window
        .root()
        .children_recursive()
        .filter(|node| USED.contains(&node.accesskit_node().role()))
        .map(|node| {
            let label = node.accesskit_node().label().unwrap_or_default();
            (node.accesskit_node().role(), label, node.rect())
        })
        .collect();
    assert!(nodes.len() > 70, "{}", nodes.len());
    let mut silent = Vec::new();
    let picture = place(&window);
    let is_handle = |label: &str| label.ends_with(" face") || label.ends_with("clip plane");
    for (role, label, rect) in nodes {
        // The pointer does not reach handles beside the picture.
        if is_handle(&label) && !picture.contains(rect.center()) {
            continue;
        }
        let has_tooltip = |window: &Harness<'_, App>| {
            window.ctx.memory(|memory| {
                let layers = memory.areas().visible_layer_ids();
                layers
                    .iter()
                    .any(|layer| layer.order == egui::Order::Tooltip)
            })
        };
        // From afar: the tooltip of a neighbour would cover a widget. A frame that lays the panels out anew hides a
        // tooltip, so the pointer comes again.
        let is_told = (0..3).any(|_| {
            window.event(Event::PointerMoved(Pos2::new(1.0, 1.0)));
            window.run_steps(4);
            window.event(Event::PointerMoved(rect.center()));
            (0..8).any(|_| {
                window.run_steps(1);
                has_tooltip(&window)
            })
        });
        if !is_told && !NOT_SEEN.contains(&label.as_str()) {
            silent.push(format!("{role:?} {label} at {rect:?}"));
        }
    }
    assert!(silent.is_empty(), "{silent:#?}");
}

/// Options named in tooltips are options of `ewa-splat render`.
#[test]
fn tooltips_name_options_that_there_are() {
    let help = std::process::Command::new(ewa_splat_program())
        .args(["render", "--help"])
        .output()
        .unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let is_part = |c: char| c.is_ascii_lowercase() || c == '-';
    let mut count = 0;
    for source in SOURCES {
        for after in source.split("--").skip(1) {
            let name: String = after.chars().take_while(|c| is_part(*c)).collect();
            if name.is_empty() {
                continue;
            }
            let is_there = help.match_indices(&format!("--{name}")).any(|(at, found)| {
                let next = help[at + found.len()..].chars().next();
                next.is_none_or(|next| !is_part(next))
            });
            assert!(is_there, "--{name}");
            count += 1;
        }
    }
    assert!(count > 60, "{count}");
}

/// The manual and the window list the same keys and gestures.
#[test]
fn the_manual_lists_what_keys_and_the_mouse_do() {
    let manual = include_str!("../../../docs/viewer.md");
    for (_, rows) in crate::panel::help::LISTS {
        for (done, effect) in rows {
            let row = format!("| {done} | {effect} |");
            assert!(manual.contains(&row), "{row}");
        }
    }
}

/// Keys and the button show the lists; Escape hides them.
#[test]
fn keys_and_the_mouse_are_explained() {
    let mut window = wake();
    let is_shown = |window: &Harness<'_, App>| window.query_by_label("Keys and mouse").is_some();
    assert!(!is_shown(&window));
    for key in [egui::Key::Questionmark, egui::Key::F1] {
        window.key_press(key);
        window.run_steps(3);
        assert!(is_shown(&window));
        window.key_press(egui::Key::Escape);
        window.run_steps(20);
        assert!(!is_shown(&window));
    }
    window.get_by_label("?").click();
    window.run_steps(3);
    assert!(is_shown(&window));
}

/// By default, the window shows a legend and axes over its picture, and its command's picture has
/// them, too.
#[test]
fn legends_and_axes_are_there_unasked() {
    let request = ViewRequest::of_files(vec![fixture("wake.xyz").into()]).unwrap();
    let app = App::new(request, &egui::Context::default(), Canvas::default());
    let mut window = Harness::builder()
        .with_size(Vec2::new(800.0, 600.0))
        .build_ui_state(|ui, app: &mut App| crate::window::show(app, ui), app);
    rest(&mut window);
    let wanted = Over {
        legend: true,
        axes: true,
        outline: false,
    };
    assert_eq!(window.state().shown_over(), wanted);
    let line = crate::panel::output::command(window.state_mut()).unwrap();
    assert!(
        line.contains("--legend") && line.contains("--axes"),
        "{line}"
    );
    // The panels leave half of a small window to the picture.
    let [width, height] = window.state().size;
    assert!(width >= 400 && height > 550, "{width} x {height}");
}

/// Panels keep their width and stay open or closed in the next session: eframe writes and reads
/// egui's state, as RON.
#[test]
fn panels_stay_as_they_were_left() {
    let mut first = wake();
    let [width, _] = first.state().size;
    first.get_by_label("Clip").click();
    first.run_steps(20);
    assert!(first.query_by_label("Box").is_some());
    // On the panel's side of its edge: the picture answers on the other.
    let edge = Pos2::new(place(&first).left() - 2.0, 300.0);
    let to = edge + Vec2::new(40.0, 0.0);
    drag(&mut first, edge, to, PointerButton::Primary);
    first.run_steps(5);
    let narrower = first.state().size;
    assert!(narrower[0] + 30 < width, "{width} {narrower:?}");
    rest(&mut first);
    let kept = first.ctx.memory(|memory| ron::to_string(memory).unwrap());

    let mut again = wake();
    assert!(again.query_by_label("Box").is_none());
    let kept: egui::Memory = ron::from_str(&kept).unwrap();
    again.ctx.memory_mut(|memory| *memory = kept);
    again.run_steps(5);
    assert!(again.query_by_label("Box").is_some());
    assert_eq!(again.state().size, narrower);
}

/// Returns the rectangle of the picture in the window.
fn place(window: &Harness<'_, App>) -> egui::Rect {
    let texture = window.state().canvas.texture().unwrap();
    let shapes = window.output().shapes.iter();
    let picture = shapes
        .map(|clipped| &clipped.shape)
        .find(|shape| shape.texture_id() == texture);
    picture.unwrap().visual_bounding_rect()
}

/// The data are centred between the panels, whatever the panels' sizes.
#[test]
fn the_data_are_in_the_middle_between_the_panels() {
    let mut window = wake();
    for size in [[1280.0, 800.0], [800.0, 600.0]] {
        window.set_size(size.into());
        window.step();
        rest(&mut window);
        let rect = place(&window);
        let sides = ["Data", "Transfer function"].map(|name| window.get_by_label(name).rect());
        assert!(rect.left() > sides[0].right() && rect.right() < sides[1].left());
        let [width, height] = window.state().size.map(|n| n as f32);
        assert!((rect.width() - width).abs() < 1.0 && (rect.height() - height).abs() < 1.0);
        // Finds the pixels that differ from the background, along both axes.
        let pixels = pixels(&window);
        let is_seen = |i: usize| {
            let pixel = &pixels[4 * i..4 * i + 3];
            let differences = pixel.iter().zip(&pixels[..3]).map(|(a, b)| a.abs_diff(*b));
            differences.max() > Some(24)
        };
        let [columns, rows] = window.state().size;
        let seen: Vec<usize> = (0..columns * rows).filter(|&i| is_seen(i)).collect();
        let ends = |of: fn(usize, usize) -> usize| {
            let all = || seen.iter().map(|&i| of(i, columns));
            all().min().unwrap() + all().max().unwrap()
        };
        let across = ends(|i, columns| i % columns);
        let down = ends(|i, columns| i / columns);
        // Compares the doubled centre of these pixels to the picture's size, with a tolerance of a
        // twentieth of the picture: the function shows less on one side.
        assert!(
            across.abs_diff(columns) < columns / 10,
            "{across} {columns}"
        );
        assert!(down.abs_diff(rows) < rows / 10, "{down} {rows}");
    }
}
