//! Tests numbered images that form a volume.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, open};
use ewa_splat::scene::Values;

/// Returns a grey PNG image of `width` columns, of 8 or 16 bits.
fn grey(width: usize, numbers: &[u16], is_deep: bool) -> Vec<u8> {
    let mut file = Vec::new();
    let size = [width, numbers.len() / width].map(|n| u32::try_from(n).unwrap());
    let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
    encoder.set_color(png::ColorType::Grayscale);
    let bytes: Vec<u8> = if is_deep {
        encoder.set_depth(png::BitDepth::Sixteen);
        numbers.iter().flat_map(|n| n.to_be_bytes()).collect()
    } else {
        numbers.iter().map(|n| u8::try_from(*n).unwrap()).collect()
    };
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&bytes).unwrap();
    writer.finish().unwrap();
    file
}

fn series(folder: &Path, pattern: &str) -> ewa_splat::Result<Dataset> {
    open(&folder.join(pattern), &OpenOptions::default())
}

#[test]
fn layers_are_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    // Layers 8 to 11: by name, 10 precedes 8. There are 3 columns and 2 rows.
    for layer in 8..12_u16 {
        let numbers: Vec<u16> = (0..6).map(|i| 1000 * layer + i).collect();
        let name = format!("s_{layer}.png");
        std::fs::write(folder.path().join(name), grey(3, &numbers, true)).unwrap();
    }
    std::fs::write(folder.path().join("s_008.png"), b"of another pattern").unwrap();
    let data = series(folder.path(), "s_%d.png").unwrap();
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!("a lattice expected");
    };
    assert_eq!(lattice.dims, [3, 2, 4]);
    assert_eq!(lattice.position([1, 1, 3]).to_array(), [1.0, 1.0, 3.0]);
    let expected = (8..12).flat_map(|layer| (0..6).map(move |i| 1000 * layer + i));
    let values = data.scalar("value").unwrap().1;
    assert_eq!(values, Values::U16(expected.collect()));
    assert!(data.notes[0].contains("4 layers"), "{:?}", data.notes);
}

#[test]
fn colours_are_a_field_of_numbers() {
    let folder = tempfile::tempdir().unwrap();
    for layer in 0..2_u8 {
        let image = crate::support::meshes::png(1, &[[layer, 10, 20, 255], [layer, 11, 21, 255]]);
        std::fs::write(folder.path().join(format!("{layer:03}.png")), image).unwrap();
    }
    let data = series(folder.path(), "%03d.png").unwrap();
    let of = |channel: &str| data.scalar(&format!("rgba:{channel}")).unwrap().1;
    assert_eq!(of("0"), Values::U8(vec![0, 0, 1, 1]));
    assert_eq!(of("1"), Values::U8(vec![10, 11, 10, 11]));
    assert_eq!(of("3"), Values::U8(vec![255; 4]));
}

#[test]
fn what_is_missing_or_differs_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, image: &[u8]| std::fs::write(folder.path().join(name), image).unwrap();
    let refused = |pattern: &str| series(folder.path(), pattern).unwrap_err().to_string();
    assert!(refused("a%03d.png").contains("at least one file"));
    let image = grey(2, &[1, 2, 3, 4], false);
    write("a001.png", &image);
    write("a003.png", &image);
    assert!(refused("a%03d.png").contains("none between 1 and 3"));
    write("a002.png", &grey(1, &[1, 2], false));
    assert!(
        refused("a%03d.png").contains("a002.png"),
        "{}",
        refused("a%03d.png")
    );
    write("a002.png", &grey(2, &[1, 2, 3, 4], true));
    assert!(refused("a%03d.png").contains("type of channels"));
    write("a002.png", &image[..40]);
    assert!(
        refused("a%03d.png").contains("damaged"),
        "{}",
        refused("a%03d.png")
    );
    write("a002.png", b"P5 1 1 255 0");
    assert!(refused("a%03d.png").contains("PNG, JPEG, WebP or TIFF"));
    // A file with this name is read by itself.
    write("b%d.csv", b"x,y,z\n0,0,0\n1,1,1\n");
    assert!(series(folder.path(), "b%d.csv").is_ok());
}
