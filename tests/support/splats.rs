//! Writes PLY, .splat, SPZ, glTF and .ksplat files.

use std::io::Write;

use super::gzip;

/// Element of a PLY file: name, properties as in the header, rows.
pub(crate) type Element<'a> = (&'a str, &'a [&'a str], &'a [Vec<f64>]);

/// The three encodings of PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ply {
    Ascii,
    Little,
    Big,
}

impl Ply {
    pub(crate) const ALL: [Self; 3] = [Self::Ascii, Self::Little, Self::Big];

    fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Little => "binary_little_endian",
            Self::Big => "binary_big_endian",
        }
    }

    fn number(self, out: &mut Vec<u8>, kind: &str, value: f64) {
        if self == Self::Ascii {
            write!(out, "{value} ").unwrap();
            return;
        }
        let mut bytes = match kind {
            "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
            "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
            "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
            "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
            "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
            "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
            "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
            "double" | "float64" => value.to_le_bytes().to_vec(),
            _ => panic!("{kind}"),
        };
        if self == Self::Big {
            bytes.reverse();
        }
        out.extend(bytes);
    }

    /// Writes a file of some elements: name, properties as in the header, rows. A list's length
    /// precedes its items.
    pub(crate) fn file(self, comments: &str, elements: &[Element<'_>]) -> Vec<u8> {
        let mut out = format!("ply\nformat {} 1.0\n{comments}", self.name()).into_bytes();
        for (name, properties, rows) in elements {
            writeln!(out, "element {name} {}", rows.len()).unwrap();
            for property in *properties {
                writeln!(out, "property {property}").unwrap();
            }
        }
        out.extend(b"end_header\n");
        for (_, properties, rows) in elements {
            for row in *rows {
                let mut values = row.iter().copied();
                for property in *properties {
                    let words: Vec<&str> = property.split(' ').collect();
                    match words.as_slice() {
                        ["list", count, item, _] => {
                            let n = values.next().unwrap();
                            self.number(&mut out, count, n);
                            for _ in 0..n as usize {
                                self.number(&mut out, item, values.next().unwrap());
                            }
                        }
                        [kind, _] => self.number(&mut out, kind, values.next().unwrap()),
                        _ => panic!("{property}"),
                    }
                }
                assert_eq!(values.next(), None);
                if self == Self::Ascii {
                    out.push(b'\n');
                }
            }
        }
        out
    }
}

/// Splat in plain numbers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Splat {
    pub(crate) position: [f64; 3],
    /// Standard deviations; two for a flat splat.
    pub(crate) scales: Vec<f64>,
    /// w, x, y, z.
    pub(crate) rotation: [f64; 4],
    pub(crate) opacity: f64,
    /// R, G, B per harmonic.
    pub(crate) harmonics: Vec<[f64; 3]>,
}

/// Returns some splats of a degree, all different.
pub(crate) fn some_splats(count: usize, degree: usize) -> Vec<Splat> {
    let of = |i: usize| {
        let t = i as f64;
        let coefficient = |k: usize, c: usize| ((7 * i + 3 * k + c) % 11) as f64 / 32.0 - 0.15;
        Splat {
            position: [0.5 + t, -0.25 * t, 2.0 - t],
            scales: vec![0.5, 0.25 + 0.125 * t, 0.0625],
            rotation: [0.5, 0.25 * t - 0.5, 0.25, 0.75],
            opacity: 0.25 + 0.5 * t / count as f64,
            harmonics: (0..(degree + 1).pow(2))
                .map(|k| [0, 1, 2].map(|c| coefficient(k, c)))
                .collect(),
        }
    };
    (0..count).map(of).collect()
}

/// Writes a PLY file in INRIA's layout; `extra` trails each row.
pub(crate) fn splat_ply(
    encoding: Ply,
    comments: &str,
    splats: &[Splat],
    extra: &[&str],
) -> Vec<u8> {
    let (sizes, harmonics) = (splats[0].scales.len(), splats[0].harmonics.len());
    let named = |name: &str, n: usize| (0..n).map(|i| format!("float {name}_{i}")).collect();
    let names: Vec<String> = [
        ["x", "y", "z"].map(|n| format!("float {n}")).to_vec(),
        named("f_dc", 3),
        named("f_rest", 3 * (harmonics - 1)),
        vec!["float opacity".into()],
        named("scale", sizes),
        named("rot", 4),
        extra.iter().map(|&e| e.to_owned()).collect(),
    ]
    .concat();
    let rows: Vec<Vec<f64>> = splats
        .iter()
        .map(|s| {
            let mut row = s.position.to_vec();
            row.extend(s.harmonics[0]);
            for channel in 0..3 {
                row.extend(s.harmonics[1..].iter().map(|rgb| rgb[channel]));
            }
            row.push((s.opacity / (1.0 - s.opacity)).ln());
            row.extend(s.scales.iter().map(|s| s.ln()));
            row.extend(s.rotation);
            row.extend(extra.iter().map(|_| 7.0));
            row
        })
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    encoding.file(comments, &[("vertex", &names, &rows)])
}

/// Writes 32-byte records.
pub(crate) fn splat_records(splats: &[Splat]) -> Vec<u8> {
    let mut out = Vec::new();
    for s in splats {
        for value in s.position.iter().chain(&s.scales) {
            out.extend((*value as f32).to_le_bytes());
        }
        let code = |c: f64| (255.0 * (0.5 + 0.282_094_791_773_878_14 * c)).round() as u8;
        out.extend(s.harmonics[0].map(code));
        out.push((255.0 * s.opacity).round() as u8);
        let length = s.rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        out.extend(
            s.rotation
                .map(|q| (128.0 + 128.0 * q / length).round() as u8),
        );
    }
    out
}

/// Returns an SPZ file of version 2 or 3 before compression, with 12 fractional bits. Positions,
/// rotations and harmonics are rotated to x right, y up, z back.
pub(crate) fn spz_unpacked(version: u32, flags: u8, splats: &[Splat]) -> Vec<u8> {
    let degree = splats[0].harmonics.len().isqrt() as u8 - 1;
    let mut out = b"NGSP".to_vec();
    out.extend(version.to_le_bytes());
    out.extend((splats.len() as u32).to_le_bytes());
    out.extend([degree, 12, flags, 0]);
    let turned = |v: [f64; 3]| [v[0], -v[1], -v[2]];
    for s in splats {
        for x in turned(s.position) {
            out.extend(&((x * 4096.0).round() as i32).to_le_bytes()[..3]);
        }
    }
    let byte = |x: f64| x.round().clamp(0.0, 255.0) as u8;
    out.extend(splats.iter().map(|s| byte(255.0 * s.opacity)));
    for s in splats {
        out.extend(s.harmonics[0].map(|c| byte(255.0 * (0.5 + 0.15 * c))));
    }
    for s in splats {
        out.extend(s.scales.iter().map(|s| byte(16.0 * (s.ln() + 10.0))));
    }
    for s in splats {
        let [w, x, y, z] = s.rotation;
        let length = s.rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        let q = [x, -y, -z, w].map(|c| c / length);
        if version < 3 {
            let sign = q[3].signum();
            out.extend(q[..3].iter().map(|c| byte(127.5 * (1.0 + sign * c))));
            continue;
        }
        let largest = (0..4)
            .max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs()))
            .unwrap();
        let mut packed = largest as u32;
        for i in (0..4).filter(|&i| i != largest) {
            let c = q[i] * q[largest].signum();
            let magnitude = (511.0 * c.abs() * std::f64::consts::SQRT_2).round() as u32;
            packed = packed << 10 | u32::from(c < 0.0) << 9 | magnitude;
        }
        out.extend(packed.to_le_bytes());
    }
    // Degree 1 is in the order y, z, x: only x keeps its sign.
    let signs = [
        1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
    ];
    for s in splats {
        for (k, rgb) in s.harmonics.iter().enumerate().skip(1) {
            out.extend(rgb.map(|c| byte(128.0 + 128.0 * signs.get(k).unwrap_or(&1.0) * c)));
        }
    }
    out
}

pub(crate) fn spz(version: u32, flags: u8, splats: &[Splat]) -> Vec<u8> {
    gzip(&spz_unpacked(version, flags, splats))
}

/// Returns a zstd frame of one uncompressed block, at most 128 KiB (RFC 8878). It holds a
/// descriptor (the size has four bytes, and there is no window), the size, and the block's header.
pub(crate) fn stored(bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![0x28, 0xb5, 0x2f, 0xfd, 0xa0];
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(&(1 | (bytes.len() as u32) << 3).to_le_bytes()[..3]);
    out.extend(bytes);
    out
}

/// Writes an SPZ file of version 4, whose arrays `pack` compresses as zstd streams.
pub(crate) fn spz_streams(flags: u8, splats: &[Splat], pack: &dyn Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut out = spz_unpacked(3, flags, splats);
    let mut body = out.split_off(16);
    let rest = 3 * (splats[0].harmonics.len() - 1);
    let sizes = [9, 1, 3, 3, 4, rest];
    let count = sizes.iter().filter(|s| **s > 0).count();
    out[4] = 4;
    out[15] = count as u8;
    out.extend(32_u32.to_le_bytes());
    out.resize(32, 0);
    let mut streams = Vec::new();
    for size in &sizes[..count] {
        let others = body.split_off(size * splats.len());
        let packed = pack(&body);
        out.extend((packed.len() as u64).to_le_bytes());
        out.extend((body.len() as u64).to_le_bytes());
        streams.extend(packed);
        body = others;
    }
    out.extend(streams);
    out
}

/// Writes a .glb file.
pub(crate) fn glb(json: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let len = 28 + json.len() + binary.len();
    let word = |n: usize| (n as u32).to_le_bytes();
    let head = [
        &b"glTF"[..],
        &word(2),
        &word(len),
        &word(json.len()),
        b"JSON",
    ]
    .concat();
    [
        head,
        json,
        word(binary.len()).to_vec(),
        b"BIN\0".to_vec(),
        binary,
    ]
    .concat()
}

/// Writes splats of degree 0 or 1 under a node that rotates and stretches them.
pub(crate) fn glb_splats(splats: &[Splat]) -> Vec<u8> {
    let mut binary = Vec::new();
    let (mut accessors, mut views) = (Vec::new(), Vec::new());
    let mut attributes = serde_json::Map::new();
    let mut push = |name: String, kind: &str, values: Vec<f64>| {
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|x| (*x as f32).to_le_bytes())
            .collect();
        attributes.insert(name, accessors.len().into());
        accessors.push(
            serde_json::json!({ "bufferView": views.len(), "componentType": 5126,
                                           "count": splats.len(), "type": kind }),
        );
        views.push(serde_json::json!({ "buffer": 0, "byteOffset": binary.len(),
                                       "byteLength": bytes.len() }));
        binary.extend(bytes);
    };
    let name = |n: &str| format!("KHR_gaussian_splatting:{n}");
    let all = |of: &dyn Fn(&Splat) -> Vec<f64>| splats.iter().flat_map(of).collect::<Vec<f64>>();
    push("POSITION".into(), "VEC3", all(&|s| s.position.to_vec()));
    push(name("SCALE"), "VEC3", all(&|s| s.scales.clone()));
    let rotation = |s: &Splat| {
        let [w, x, y, z] = s.rotation;
        vec![x, y, z, w]
    };
    push(name("ROTATION"), "VEC4", all(&rotation));
    push(name("OPACITY"), "SCALAR", all(&|s| vec![s.opacity]));
    for k in 0..splats[0].harmonics.len() {
        let (degree, n) = if k == 0 { (0, 0) } else { (1, k - 1) };
        let rgb = |s: &Splat| s.harmonics[k].to_vec();
        push(
            name(&format!("SH_DEGREE_{degree}_COEF_{n}")),
            "VEC3",
            all(&rgb),
        );
    }
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "children": [1], "rotation": [0.5, 0.5, 0.5, 0.5] },
                  { "mesh": 0, "scale": [1.0, 2.0, 0.5], "translation": [1.0, 0.0, 0.0] }],
        "meshes": [{ "primitives": [{ "mode": 0, "attributes": attributes,
            "extensions": { "KHR_gaussian_splatting": { "kernel": "ellipse" } } }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    glb(&json, &binary)
}

/// Writes a .glb file whose splats are compressed in an SPZ stream, under a node that moves them by
/// (1, 2, 3).
pub(crate) fn glb_packed(stream: &[u8]) -> Vec<u8> {
    let packed = serde_json::json!({ "bufferView": 0 });
    let extension = serde_json::json!({
        "kernel": "ellipse",
        "extensions": { "KHR_gaussian_splatting_compression_spz_2": packed },
    });
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": [1.0, 2.0, 3.0] }],
        "meshes": [{ "primitives": [{ "mode": 0, "attributes": { "POSITION": 0 },
            "extensions": { "KHR_gaussian_splatting": extension } }] }],
        "accessors": [{ "componentType": 5126, "count": 1, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": stream.len() }],
        "buffers": [{ "byteLength": stream.len() }],
    });
    glb(&json, stream)
}

/// Writes a .ksplat file of several sections, with buckets of two splats: one is full, the others
/// are not, and some are empty. There is space for one more section and for one more splat in each.
pub(crate) fn ksplat(mode: u16, sections: &[&[Splat]]) -> Vec<u8> {
    /// Side of a bucket, and number of steps in half of it.
    const SIDE: f64 = 16.0;
    const STEPS: f64 = 32_767.0;
    let count: usize = sections.iter().map(|s| s.len()).sum();
    let mut out = vec![0_u8; 4096 + 1024 * (sections.len() + 1)];
    let put = |out: &mut Vec<u8>, at: usize, bytes: &[u8]| {
        out[at..at + bytes.len()].copy_from_slice(bytes);
    };
    let word = |n: usize| (n as u32).to_le_bytes();
    out[1] = 1;
    put(&mut out, 4, &word(sections.len() + 1));
    put(&mut out, 8, &word(sections.len()));
    put(&mut out, 12, &word(count));
    put(&mut out, 16, &word(count));
    put(&mut out, 20, &mode.to_le_bytes());
    put(&mut out, 36, &(-0.25_f32).to_le_bytes());
    put(&mut out, 40, &0.25_f32.to_le_bytes());
    let float = |x: f64| match mode {
        0 => (x as f32).to_le_bytes().to_vec(),
        _ => half(x).to_le_bytes().to_vec(),
    };
    for (i, splats) in sections.iter().enumerate() {
        let degree = splats[0].harmonics.len().isqrt() - 1;
        // Sizes: a full bucket of two splats, then an empty one, then buckets of one.
        let mut sizes = vec![0];
        sizes.resize(splats.len() - 1, 1);
        let mut middles = vec![splats[0].position];
        middles.extend([[0.0; 3]]);
        middles.extend(splats[2..].iter().map(|s| s.position.map(|x| x + 0.5)));
        let mut data: Vec<u8> = sizes.iter().flat_map(|s| word(*s)).collect();
        for x in middles.as_flattened() {
            data.extend((*x as f32).to_le_bytes());
        }
        for (k, s) in splats.iter().enumerate() {
            let middle = middles[if k < 2 { 0 } else { k }];
            for (x, middle) in s.position.iter().zip(middle) {
                let steps = (x - middle) / (0.5 * SIDE) * STEPS + STEPS;
                match mode {
                    0 => data.extend((*x as f32).to_le_bytes()),
                    _ => data.extend((steps.round() as u16).to_le_bytes()),
                }
            }
            data.extend(s.scales.iter().chain(&s.rotation).flat_map(|x| float(*x)));
            let code = |c: f64| (255.0 * (0.5 + 0.282_094_791_773_878_14 * c)).round() as u8;
            data.extend(s.harmonics[0].map(code));
            data.push((255.0 * s.opacity).round() as u8);
            for l in 1..=degree {
                for channel in 0..3 {
                    for rgb in &s.harmonics[l * l..(l + 1) * (l + 1)] {
                        match mode {
                            2 => data.push((255.0 * (rgb[channel] + 0.25) / 0.5).round() as u8),
                            _ => data.extend(float(rgb[channel])),
                        }
                    }
                }
            }
        }
        let record = (data.len() - 4 * sizes.len() - 12 * middles.len()) / splats.len();
        data.resize(data.len() + record, 0);
        let at = 4096 + 1024 * i;
        for (place, n) in [
            (0, splats.len()),
            (4, splats.len() + 1),
            (8, 2),
            (12, middles.len()),
            (28, data.len()),
            (32, 1),
            (36, sizes.len()),
        ] {
            put(&mut out, at + place, &word(n));
        }
        put(&mut out, at + 16, &(SIDE as f32).to_le_bytes());
        put(&mut out, at + 20, &12_u16.to_le_bytes());
        put(&mut out, at + 24, &word(32_767));
        put(&mut out, at + 40, &(degree as u16).to_le_bytes());
        out.extend(data);
    }
    out
}

/// Returns the half float nearest to a number whose size is from 6.2e-5 to 65504, or to 0.
fn half(x: f64) -> u16 {
    if x == 0.0 {
        return 0;
    }
    let exponent = x.abs().log2().floor();
    let steps = (x.abs() / exponent.exp2() * 1024.0).round() as u16;
    // Rounding up to the next power of two carries into the exponent.
    let size = (((exponent + 15.0) as u16) << 10) + (steps - 1024);
    u16::from(x < 0.0) << 15 | size
}

/// Writes 258 splats as compressed PLY, in two chunks. The fields of each word are: positions 2046,
/// 1, 2047; scales 0, 1023, 1023; rotations omit component i mod 4 and are 0, 512, 256; colours 0,
/// 255, 102; opacity 51.
///
/// - `has_colours`: whether chunks have boxes of colours.
pub(crate) fn packed_ply(encoding: Ply, degree: usize, has_colours: bool) -> Vec<u8> {
    let mut names = Vec::new();
    for (prefix, axes) in [("", "xyz"), ("scale_", "xyz"), ("", "rgb")] {
        for bound in ["min", "max"] {
            names.extend(axes.chars().map(|a| format!("float {bound}_{prefix}{a}")));
        }
    }
    names.truncate(if has_colours { 18 } else { 12 });
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let boxes = [[[-1.0, 0.0, 5.0], [1.0, 2.0, 5.0]], [[10.0; 3], [20.0; 3]]];
    let chunks = boxes.map(|[least, most]| {
        let scales = [[-4.0; 3], [0.0; 3]];
        let colours = [[0.5; 3], [1.5; 3]];
        let all = [least, most, scales[0], scales[1], colours[0], colours[1]];
        all.concat()[..names.len()].to_vec()
    });
    let words = [
        "uint packed_position",
        "uint packed_rotation",
        "uint packed_scale",
        "uint packed_color",
    ];
    let vertices: Vec<Vec<f64>> = (0..258_u32)
        .map(|i| {
            let position = 2046 << 21 | 1 << 11 | 2047;
            let rotation = (i % 4) << 30 | 512 << 10 | 256;
            let scale = 1023 << 11 | 1023;
            let colour = 255 << 16 | 102 << 8 | 51;
            [position, rotation, scale, colour].map(f64::from).to_vec()
        })
        .collect();
    let rest = 3 * ((degree + 1).pow(2) - 1);
    let rest_names: Vec<String> = (0..rest).map(|i| format!("uchar f_rest_{i}")).collect();
    let rest_names: Vec<&str> = rest_names.iter().map(String::as_str).collect();
    let byte = |i: usize| match i {
        0 => 0.0,
        1 => 255.0,
        n => n as f64 - 1.0,
    };
    let harmonics = vec![(0..rest).map(byte).collect::<Vec<f64>>(); 258];
    let mut elements: Vec<Element<'_>> =
        vec![("chunk", &names, &chunks), ("vertex", &words, &vertices)];
    if rest > 0 {
        elements.push(("sh", &rest_names, &harmonics));
    }
    encoding.file("comment Generated by hand\n", &elements)
}
