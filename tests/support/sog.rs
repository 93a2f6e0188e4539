//! Writes SOG scenes.

use image_webp::{ColorType, WebPEncoder};
use serde_json::{Value, json};

use super::npz;
use super::splats::Splat;

/// Returns a lossless WebP image.
pub(crate) fn webp(width: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let height = pixels.len() as u32 / width;
    WebPEncoder::new(&mut bytes)
        .encode(pixels.as_flattened(), width, height, ColorType::Rgba8)
        .unwrap();
    bytes
}

/// Returns the files of a scene of splats, whose images are four pixels wide. Positions span -7 to
/// 7 before their logarithms. Version 2 has codebooks of even steps, and entry i of the harmonics'
/// palettes belongs to splat i.
pub(crate) fn scene(version: u32, splats: &[Splat]) -> Vec<(&'static str, Vec<u8>)> {
    let coefficients = splats[0].harmonics.len() - 1;
    let place = |share: f64, steps: f64| (share.clamp(0.0, 1.0) * steps).round();
    let byte = |x: f64, [least, most]: [f64; 2]| place((x - least) / (most - least), 255.0) as u8;
    let bound = 8_f64.ln();
    let means: Vec<[u16; 3]> = splats
        .iter()
        .map(|s| {
            s.position.map(|x| {
                let logarithm = x.abs().ln_1p().copysign(x);
                place((logarithm + bound) / (2.0 * bound), 65_535.0) as u16
            })
        })
        .collect();
    let part = |shift: u32| {
        let all = means.iter();
        all.map(|p| {
            let [x, y, z] = p.map(|x| (x >> shift & 255) as u8);
            [x, y, z, 255]
        })
        .collect::<Vec<_>>()
    };
    let scales = splats.iter().map(|s| {
        let [x, y, z] = [0, 1, 2].map(|i| byte(s.scales[i].ln(), SCALES));
        [x, y, z, 255]
    });
    let quats = splats.iter().map(|s| {
        let length = s.rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        let q = s.rotation.map(|q| q / length);
        let largest = (0..4)
            .max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs()))
            .unwrap();
        let mut pixel = [0, 0, 0, 252 + largest as u8];
        let others = (0..4).filter(|&i| i != largest);
        for (slot, i) in pixel.iter_mut().zip(others) {
            let c = q[i] * q[largest].signum() * std::f64::consts::SQRT_2;
            *slot = place(0.5 + 0.5 * c, 255.0) as u8;
        }
        pixel
    });
    let colours = splats.iter().map(|s| {
        let [r, g, b] = s.harmonics[0].map(|c| byte(c, COLOURS));
        let logit = (s.opacity / (1.0 - s.opacity)).ln();
        let opacity = match version {
            1 => byte(logit, LOGITS),
            _ => byte(s.opacity, [0.0, 1.0]),
        };
        [r, g, b, opacity]
    });
    let mut palette = vec![[0; 4]; 64 * coefficients];
    for (slot, c) in palette
        .iter_mut()
        .zip(splats.iter().flat_map(|s| &s.harmonics[1..]))
    {
        let [r, g, b] = c.map(|c| byte(c, REST));
        *slot = [r, g, b, 255];
    }
    let numbers = (0..splats.len()).map(|i| [i as u8, 0, 0, 255]);

    let filled = |pixels: Vec<[u8; 4]>| {
        let mut pixels = pixels;
        pixels.resize(pixels.len().next_multiple_of(4), [0, 0, 0, 255]);
        webp(4, &pixels)
    };
    let mut files = vec![
        ("means_l.webp", filled(part(0))),
        ("means_u.webp", filled(part(8))),
        ("scales.webp", filled(scales.collect())),
        ("quats.webp", filled(quats.collect())),
        ("sh0.webp", filled(colours.collect())),
    ];
    let mut meta = meta(version, splats.len(), coefficients, bound);
    if coefficients > 0 {
        files.push((
            "shN_centroids.webp",
            webp(64 * coefficients as u32, &palette),
        ));
        files.push(("shN_labels.webp", filled(numbers.collect())));
    } else {
        meta.as_object_mut().unwrap().remove("shN");
    }
    files.push(("meta.json", serde_json::to_vec(&meta).unwrap()));
    files
}

const SCALES: [f64; 2] = [-6.0, 2.0];
const COLOURS: [f64; 2] = [-0.5, 0.5];
const LOGITS: [f64; 2] = [-3.0, 3.0];
const REST: [f64; 2] = [-0.25, 0.25];

fn meta(version: u32, count: usize, coefficients: usize, bound: f64) -> Value {
    let spread = |[least, most]: [f64; 2], name: &str| {
        let entry = |i: u32| least + (most - least) * f64::from(i) / 255.0;
        let codebook: Vec<f64> = (0..256).map(entry).collect();
        json!({ "codebook": codebook, "files": [name] })
    };
    let bounds = |mins: Vec<f64>, maxs: Vec<f64>, name: &str| json!({ "mins": mins, "maxs": maxs, "files": [name] });
    let means = json!({
        "shape": [count, 3],
        "mins": vec![-bound; 3], "maxs": vec![bound; 3], "files": ["means_l.webp", "means_u.webp"],
    });
    let names = ["shN_centroids.webp", "shN_labels.webp"];
    if version == 1 {
        let colours = |side: usize| [[COLOURS[side]; 3].to_vec(), vec![LOGITS[side]]].concat();
        return json!({
            "means": means,
            "scales": bounds(vec![SCALES[0]; 3], vec![SCALES[1]; 3], "scales.webp"),
            "quats": { "encoding": "quaternion_packed", "files": ["quats.webp"] },
            "sh0": bounds(colours(0), colours(1), "sh0.webp"),
            "shN": { "mins": REST[0], "maxs": REST[1], "files": names },
        });
    }
    let mut rest = spread(REST, "");
    rest["files"] = json!(names);
    rest["bands"] = json!((coefficients + 1).isqrt() - 1);
    rest["count"] = json!(count);
    json!({
        "version": 2, "count": count, "antialias": true, "means": means,
        "scales": spread(SCALES, "scales.webp"),
        "quats": { "files": ["quats.webp"] },
        "sh0": spread(COLOURS, "sh0.webp"),
        "shN": rest,
    })
}

/// Returns the same scene in one archive.
pub(crate) fn archive(version: u32, splats: &[Splat], packed: bool) -> Vec<u8> {
    npz(&scene(version, splats), packed)
}
