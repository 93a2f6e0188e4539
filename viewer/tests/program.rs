//! Tests the program: pictures of the whole window, and errors of usage.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const PROGRAM: &str = env!("CARGO_BIN_EXE_ewa-splat-view");

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fixtures")
        .join(name)
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns true if a window can be drawn. Fails if it must be (`EWA_REQUIRE_GPU=1`).
fn is_drawn(output: &Output) -> bool {
    if output.status.success() {
        return true;
    }
    let text = errors(output);
    assert!(text.contains("drawing the window"), "{text}");
    assert!(
        std::env::var_os("EWA_REQUIRE_GPU").is_none_or(|v| v != "1"),
        "{text}"
    );
    println!("skipped: {text}");
    false
}

/// Reads the pixels of a picture, four bytes each.
fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}

/// The command line starts the window, which shows the picture in its middle with text beside it.
#[test]
fn the_whole_window_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("window.png");
    let beside = Path::new(PROGRAM).parent().unwrap();
    let command_line = beside.join(format!("ewa-splat{}", std::env::consts::EXE_SUFFIX));
    let output = Command::new(command_line)
        .arg("view")
        .arg(fixture("wake.xyz"))
        .arg("--transfer-function")
        .arg(fixture("wake_transfer.json"))
        .args(["--size", "900x500", "--screenshot"])
        .arg(&picture)
        .output()
        .unwrap();
    if !is_drawn(&output) {
        return;
    }
    let (width, height, pixels) = pixels(&picture);
    assert_eq!((width, height), (900, 500));
    // Counts the data's blue and white light in the middle, and grey text and bars of the panels at
    // the sides.
    let count = |columns: std::ops::Range<u32>, is: fn(&[u8]) -> bool| {
        let at = |i: usize| columns.contains(&(u32::try_from(i).unwrap() % width));
        let all = pixels.chunks(4).enumerate();
        all.filter(|(i, pixel)| at(*i) && is(pixel)).count()
    };
    let is_blue = |p: &[u8]| p[2] > 150 && u16::from(p[2]) > u16::from(p[0]) + 40;
    let is_text = |p: &[u8]| p[0] > 130 && p[0].abs_diff(p[2]) < 10;
    assert!(
        count(300..550, is_blue) > 10_000,
        "{}",
        count(300..550, is_blue)
    );
    assert!(count(0..200, is_text) > 500, "{}", count(0..200, is_text));
    assert!(
        count(620..900, is_text) > 500,
        "{}",
        count(620..900, is_text)
    );
}

#[test]
fn what_a_window_does_not_do_is_refused() {
    for (words, part) in [
        (&["a.vtu", "--out", "a.png"][..], "--out"),
        (&["a.vtu", "--column-density"], "--column-density"),
        (&["absent.vtu", "--screenshot", "a.png"], "absent.vtu"),
        (&["a.vtu", "--tolerence", "1"], "--tolerance"),
    ] {
        let output = Command::new(PROGRAM).args(words).output().unwrap();
        assert!(!output.status.success());
        let text = errors(&output);
        assert!(text.starts_with("error: ") && text.contains(part), "{text}");
        assert!(!Path::new("a.png").exists());
    }
}

/// A replay prints the times of a turn and an edit, without a display.
#[test]
fn a_replay_says_how_long_pictures_take() {
    let output = Command::new(PROGRAM)
        .arg(fixture("wake.xyz"))
        .args(["--replay", "3"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    for part in [
        "turn: ",
        "edit: ",
        "of the pixels at a tolerance of",
        "for what is merged",
        "rest: whole after ",
        "its error after ",
    ] {
        assert!(text.contains(part), "{text}");
    }
}
