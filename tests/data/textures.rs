//! Textures in WebP: with and without losses, named by an extension or not.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{Geometry, OpenOptions, TextureImage, read};
use serde_json::json;

use crate::common::real_data;
use crate::support::meshes::rich_gltf;
use crate::support::sog::webp;

/// The image of a glTF file's only texture.
fn image(image: &[u8], texture: serde_json::Value, required: &[&str]) -> TextureImage {
    let mut file = rich_gltf();
    let uri = format!("data:image/webp;base64,{}", STANDARD.encode(image));
    file.json["images"][0] = json!({ "uri": uri });
    file.json["textures"][0] = texture;
    file.json["extensionsRequired"] = json!(required);
    let data = read("a.gltf", &file.text(), &OpenOptions::default()).unwrap();
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!()
    };
    assert_eq!(mesh.textures.len(), 1, "{:?}", data.notes);
    (*mesh.textures[0].image).clone()
}

fn by_extension() -> serde_json::Value {
    json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } })
}

#[test]
fn webp_without_losses_is_exact() {
    let pixels: Vec<[u8; 4]> = (0..35_u8).map(|i| [7 * i, 255 - i, i, 100 + i]).collect();
    let file = webp(7, &pixels);
    for (texture, required) in [
        (by_extension(), &["EXT_texture_webp"][..]),
        (json!({ "source": 0 }), &[]),
    ] {
        let found = image(&file, texture, required);
        assert_eq!((found.width, found.height), (7, 5));
        assert_eq!(found.pixels, pixels);
    }
}

/// Pillow 13 (libwebp) has the same pixels within one step of 255.
#[test]
fn webp_with_losses_is_what_libwebp_reads() {
    let Some(path) = real_data("formats/meshes/webp/test-lossy.webp") else {
        return;
    };
    let found = image(
        &std::fs::read(path).unwrap(),
        by_extension(),
        &["EXT_texture_webp"],
    );
    assert_eq!((found.width, found.height), (256, 256));
    for ([x, y], expected) in [
        ([0, 0], [215, 229, 188]),
        ([128, 128], [36, 43, 29]),
        ([255, 255], [95, 95, 97]),
        ([10, 20], [200, 213, 175]),
    ] {
        let [r, g, b, a] = found.pixels[y * 256 + x];
        let is_near = [r, g, b]
            .into_iter()
            .zip(expected)
            .all(|(a, b)| a.abs_diff(b) <= 1);
        assert!(is_near && a == 255, "{:?} at {x}, {y}", [r, g, b]);
    }
    let sum = |c: usize| found.pixels.iter().map(|p| u64::from(p[c])).sum::<u64>();
    for (c, expected) in [104.904_830_93, 101.250_305_18, 72.101_425_17]
        .into_iter()
        .enumerate()
    {
        let mean = sum(c) as f64 / 65_536.0;
        assert!((mean - expected).abs() < 0.05, "{c}: {mean}");
    }
}

#[test]
fn claims_of_webp_are_checked() {
    let mut file = webp(2, &[[1, 2, 3, 255]; 4]);
    // Width and height less 1 in 14 bits each.
    file[21..25].copy_from_slice(&[0xfe, 0xbf, 0xff, 0x0f]);
    let mut gltf = rich_gltf();
    let uri = format!("data:image/webp;base64,{}", STANDARD.encode(&file));
    gltf.json["images"][0] = json!({ "uri": uri });
    let data = read("a.gltf", &gltf.text(), &OpenOptions::default()).unwrap();
    let claims = |note: &String| note.contains("claims 16383 x 16383 pixels");
    assert!(data.notes.iter().any(claims), "{:?}", data.notes);
}
