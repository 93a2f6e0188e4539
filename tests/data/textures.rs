//! Tests textures in WebP, lossless and lossy, and in KTX 2, named by an extension or not.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{Geometry, OpenOptions, TextureImage, read};
use serde_json::json;

use crate::common::real_data;
use crate::support::meshes::rich_gltf;
use crate::support::sog::webp;

/// Returns the image of a glTF file's only texture.
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

/// Pillow 13 (libwebp) reads the same pixels to within one step of 255.
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

#[cfg(feature = "ktx2")]
fn basisu() -> serde_json::Value {
    json!({ "extensions": { "KHR_texture_basisu": { "source": 0 } } })
}

/// Pixels of a gradient with opacities and the sums of all, as Binomial's decoder (alktx2 0.1.7)
/// reads them. The files hold five levels, those of UASTC in zstd; `alktx2.encode_raw_rgba_to_ktx2`
/// made them, 20 x 12, of quality 60.
#[cfg(feature = "ktx2")]
#[test]
fn ktx2_is_what_its_makers_decoder_reads() {
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for (name, pixels, sums) in [
        (
            "gradient_etc1s.ktx2",
            [
                [0, 4, 0, 255],
                [223, 206, 206, 102],
                [132, 124, 124, 178],
                [231, 50, 149, 124],
            ],
            [27_461, 26_326, 25_210, 43_092],
        ),
        (
            "gradient_uastc.ktx2",
            [
                [0, 0, 5, 255],
                [228, 217, 201, 103],
                [120, 122, 110, 172],
                [203, 59, 128, 122],
            ],
            [27_324, 26_280, 25_276, 42_804],
        ),
    ] {
        let bytes = std::fs::read(fixtures.join(name)).unwrap();
        let found = image(&bytes, basisu(), &["KHR_texture_basisu"]);
        assert_eq!((found.width, found.height), (20, 12));
        let places = [[0, 0], [11, 19], [6, 10], [3, 17]];
        assert_eq!(
            places.map(|[y, x]| found.pixels[20 * y + x]),
            pixels,
            "{name}"
        );
        let sum = |c: usize| found.pixels.iter().map(|p| u32::from(p[c])).sum::<u32>();
        assert_eq!([0, 1, 2, 3].map(sum), sums, "{name}");
    }
    let means = [
        [190.326_25, 162.505, 26.9825],
        [192.664_375, 161.725, 26.83],
    ];
    for (name, means) in ["2d_etc1s", "2d_uastc"].into_iter().zip(means) {
        let Some(path) = real_data(&format!("formats/meshes/ktx2/{name}.ktx2")) else {
            return;
        };
        let found = image(&std::fs::read(path).unwrap(), basisu(), &[]);
        assert_eq!((found.width, found.height), (40, 40));
        for (c, mean) in means.into_iter().enumerate() {
            let sum = found.pixels.iter().map(|p| u32::from(p[c])).sum::<u32>();
            assert!((f64::from(sum) / 1600.0 - mean).abs() < 1e-6, "{name}");
        }
    }
}

#[cfg(feature = "ktx2")]
#[test]
fn claims_of_ktx2_are_checked() {
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for (name, at, word, reason) in [
        (
            "gradient_etc1s.ktx2",
            20,
            60_000_u32,
            "more pixels than its bytes can hold",
        ),
        (
            "gradient_uastc.ktx2",
            24,
            400_000,
            "more pixels than its bytes can hold",
        ),
        ("gradient_uastc.ktx2", 24, 16, "another number of blocks"),
        ("gradient_uastc.ktx2", 24, 0, "no picture of two dimensions"),
        ("gradient_uastc.ktx2", 44, 3, "another code"),
        ("gradient_etc1s.ktx2", 80, 700, "cut off"),
        ("gradient_etc1s.ktx2", 40, 9999, "its tables"),
        ("gradient_etc1s.ktx2", 48, 9999, "no description"),
    ] {
        let mut file = std::fs::read(fixtures.join(name)).unwrap();
        file[at..at + 4].copy_from_slice(&word.to_le_bytes());
        if word == 60_000 {
            file[24..28].copy_from_slice(&word.to_le_bytes());
        }
        let mut gltf = rich_gltf();
        let uri = format!("data:image/ktx2;base64,{}", STANDARD.encode(&file));
        gltf.json["images"][0] = json!({ "uri": uri });
        let data = read("a.gltf", &gltf.text(), &OpenOptions::default()).unwrap();
        let is_told = data.notes.iter().any(|note| note.contains(reason));
        assert!(is_told, "{name} {at}: {:?}", data.notes);
    }
}

/// The same four pixels, rows from the top, in the formats that older meshes use.
#[test]
fn textures_of_other_formats_have_their_pixels() {
    let pixels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [10, 20, 30]];
    let bgr = |i: usize| [pixels[i][2], pixels[i][1], pixels[i][0]];
    // Kind, size, bits, and whether rows run from the top.
    let tga = |kind: u8, flags: u8, body: &[u8]| {
        let header = [0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, flags];
        [&header[..], body].concat()
    };
    let from_top: Vec<u8> = (0..4).flat_map(bgr).collect();
    let from_bottom: Vec<u8> = [2, 3, 0, 1].into_iter().flat_map(bgr).collect();
    let runs: Vec<u8> = (0..4)
        .flat_map(|i| [&[0x80][..], &bgr(i)].concat())
        .collect();
    let mut bmp = b"BM".to_vec();
    for number in [
        70_u32,
        0,
        54,
        40,
        2,
        2,
        24 << 16 | 1,
        0,
        16,
        2835,
        2835,
        0,
        0,
    ] {
        bmp.extend(number.to_le_bytes());
    }
    for row in from_bottom.chunks(6) {
        bmp.extend(row);
        bmp.extend([0; 2]);
    }
    let by_crate = |format: image::ImageFormat| {
        let numbers = pixels.as_flattened().to_vec();
        let picture = image::RgbImage::from_raw(2, 2, numbers).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::DynamicImage::from(picture)
            .write_to(&mut bytes, format)
            .unwrap();
        bytes.into_inner()
    };
    for (name, file) in [
        ("tga from the top", tga(2, 0x20, &from_top)),
        ("tga from the bottom", tga(2, 0, &from_bottom)),
        ("tga in runs", tga(10, 0x20, &runs)),
        ("bmp", bmp),
        ("gif", by_crate(image::ImageFormat::Gif)),
        ("tiff", by_crate(image::ImageFormat::Tiff)),
    ] {
        let found = image(&file, json!({ "source": 0 }), &[]);
        assert_eq!((found.width, found.height), (2, 2), "{name}");
        for (found, [r, g, b]) in found.pixels.iter().zip(pixels) {
            assert_eq!(*found, [r, g, b, 255], "{name}");
        }
        // Truncated anywhere, it is an unreadable image without further effect.
        for len in 0..file.len() {
            let mut cut = rich_gltf();
            let uri = format!("data:image/tga;base64,{}", STANDARD.encode(&file[..len]));
            cut.json["images"][0] = json!({ "uri": uri });
            read("a.gltf", &cut.text(), &OpenOptions::default()).unwrap();
        }
    }
    // A size that its bytes cannot hold is refused before memory is allocated.
    let mut claims = tga(2, 0, &from_bottom);
    claims[12..16].fill(255);
    let mut file = rich_gltf();
    let uri = format!("data:image/tga;base64,{}", STANDARD.encode(&claims));
    file.json["images"][0] = json!({ "uri": uri });
    let data = read("a.gltf", &file.text(), &OpenOptions::default()).unwrap();
    assert!(
        data.notes[0].contains("claims 65535 x 65535 pixels"),
        "{:?}",
        data.notes
    );
}
