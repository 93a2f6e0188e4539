//! Writes small meshes for the tests of their readers.

use serde_json::{Value, json};

/// Returns the six tetrahedra of a cube along the paths from its corner `low` to the opposite one,
/// with corners from `node`. The last three have the opposite orientation.
pub(crate) fn tetrahedra_of_cube(
    low: [usize; 3],
    node: impl Fn([usize; 3]) -> u32,
) -> [[u32; 4]; 6] {
    [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ]
    .map(|order: [usize; 3]| {
        let mut at = low;
        let mut corners = [node(low); 4];
        for (corner, axis) in corners[1..].iter_mut().zip(order) {
            at[axis] += 1;
            *corner = node(at);
        }
        corners
    })
}

/// Returns a PNG image of these pixels, rows from the top.
pub(crate) fn png(width: usize, rgba: &[[u8; 4]]) -> Vec<u8> {
    let height = rgba.len() / width;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&rgba.concat()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// Returns a JPEG image of one colour.
pub(crate) fn jpeg(size: u16, rgb: [u8; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let numbers = rgb.repeat(usize::from(size) * usize::from(size));
    jpeg_encoder::Encoder::new(&mut bytes, 90)
        .encode(&numbers, size, size, jpeg_encoder::ColorType::Rgb)
        .unwrap();
    bytes
}

/// BIN chunk and JSON of a glTF file under construction.
#[derive(Debug, Clone)]
pub(crate) struct Gltf {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

pub(crate) const U8: u32 = 5121;
pub(crate) const I8: u32 = 5120;
pub(crate) const U16: u32 = 5123;
pub(crate) const I16: u32 = 5122;
pub(crate) const U32: u32 = 5125;
pub(crate) const F32: u32 = 5126;

/// Converts numbers to bytes of a component type.
pub(crate) fn component_bytes(component: u32, numbers: &[f64]) -> Vec<u8> {
    let bytes = |x: &f64| match component {
        U8 => vec![*x as u8],
        I8 => (*x as i8).to_le_bytes().to_vec(),
        U16 => (*x as u16).to_le_bytes().to_vec(),
        I16 => (*x as i16).to_le_bytes().to_vec(),
        U32 => (*x as u32).to_le_bytes().to_vec(),
        _ => (*x as f32).to_le_bytes().to_vec(),
    };
    numbers.iter().flat_map(bytes).collect()
}

impl Gltf {
    /// Creates an empty asset.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "byteLength": 0 }],
            "bufferViews": [], "accessors": [], "meshes": [], "nodes": [],
        });
        let bin = Vec::new();
        Self { json, bin }
    }

    fn push(&mut self, list: &str, item: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let items = self.json[list].as_array_mut().unwrap();
        items.push(item);
        items.len() - 1
    }

    /// Adds an item to a list of the JSON and returns its index.
    pub(crate) fn add(&mut self, list: &str, item: Value) -> usize {
        self.push(list, item)
    }

    /// Adds bytes as a view of their own.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        self.push("bufferViews", view)
    }

    /// Adds numbers as an accessor.
    pub(crate) fn accessor(
        &mut self,
        type_: &str,
        component: u32,
        normalized: bool,
        numbers: &[f64],
    ) -> usize {
        let width = match type_ {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let view = self.view(&component_bytes(component, numbers));
        let accessor = json!({
            "bufferView": view, "componentType": component, "type": type_,
            "count": numbers.len() / width, "normalized": normalized,
        });
        self.push("accessors", accessor)
    }

    /// Adds plain floats as an accessor.
    pub(crate) fn floats(&mut self, type_: &str, numbers: &[f64]) -> usize {
        self.accessor(type_, F32, false, numbers)
    }

    /// Adds a mesh of one primitive, shown by a node of its own.
    pub(crate) fn mesh(&mut self, primitive: Value) -> usize {
        let mesh = self.push("meshes", json!({ "primitives": [primitive] }));
        self.push("nodes", json!({ "mesh": mesh }))
    }

    /// Returns the file as `.glb`.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = serde_json::to_vec(&self.json).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &bin)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        let len = (bytes.len() as u32).to_le_bytes();
        bytes[8..12].copy_from_slice(&len);
        bytes
    }

    /// Returns the file as `.gltf` with the buffer inside.
    pub(crate) fn text(&self) -> Vec<u8> {
        use base64::Engine;
        let mut json = self.json.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
        serde_json::to_vec(&json).unwrap()
    }
}

/// Corners of a unit square in the plane z = 0, and their texture coordinates.
pub(crate) const SQUARE: [f64; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
pub(crate) const SQUARE_UV: [f64; 8] = [0., 1., 1., 1., 1., 0., 0., 0.];

/// Returns a file that uses many features of the format: textures, a sparse accessor, a skin, morph
/// targets, instances, strips.
pub(crate) fn rich_gltf() -> Gltf {
    let mut file = Gltf::new();
    let positions = file.floats("VEC3", &SQUARE);
    let uv = file.accessor("VEC2", U8, true, &SQUARE_UV.map(|x| 255.0 * x));
    let normals = file.accessor("VEC3", I8, true, &[0., 0., 127.].repeat(4));
    let colours = file.accessor("VEC4", U16, true, &[65535., 0., 65535., 65535.].repeat(4));
    let indices = file.accessor("SCALAR", U16, false, &[0., 1., 2., 0., 2., 3.]);
    let strip = file.accessor("SCALAR", U8, false, &[0., 1., 3., 2.]);
    let joints = file.accessor("VEC4", U8, false, &[0., 1., 0., 0.].repeat(4));
    // Weights need not sum to 1.
    let weights = file.floats("VEC4", &[0.25, 0.25, 0., 0.].repeat(4));
    let one = [
        1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.,
    ];
    let binds = file.floats("MAT4", &one.repeat(2));
    let translations = file.floats("VEC3", &[0., 0., 1., 0., 0., 2.]);
    let sparse_indices = file.view(&[1, 3]);
    let sparse_values = file.view(&component_bytes(F32, &[0., 0., 1., 0., 0., 2.]));
    let target = file.add(
        "accessors",
        json!({
            "componentType": F32, "type": "VEC3", "count": 4,
            "sparse": {
                "count": 2,
                "indices": { "bufferView": sparse_indices, "componentType": U8 },
                "values": { "bufferView": sparse_values },
            },
        }),
    );
    let image = file.view(&png(2, &[[255, 0, 0, 255], [0, 255, 0, 128]].repeat(2)));
    file.add(
        "images",
        json!({ "bufferView": image, "mimeType": "image/png" }),
    );
    file.add("samplers", json!({ "wrapS": 33071, "wrapT": 33648 }));
    file.add("textures", json!({ "source": 0, "sampler": 0 }));
    file.add(
        "materials",
        json!({
            "name": "painted", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "baseColorTexture": {
                "index": 0,
                "extensions": { "KHR_texture_transform": { "offset": [0.5, 0.0], "scale": [2, 1] } },
            } },
            "emissiveFactor": [1, 0, 0],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 2.0 } },
        }),
    );
    file.mesh(json!({
        "attributes": {
            "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uv, "COLOR_0": colours,
        },
        "indices": indices, "material": 0, "targets": [{ "POSITION": target }],
    }));
    file.json["meshes"][0]["weights"] = json!([0.5]);
    file.json["nodes"][0]["translation"] = json!([1, 0, 0]);
    file.mesh(json!({
        "attributes": { "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights },
        "indices": strip, "mode": 5,
    }));
    let joint = file.add(
        "nodes",
        json!({ "children": [3], "translation": [0, 0, 4] }),
    );
    file.add("nodes", json!({ "scale": [1, 1, -2] }));
    file.add(
        "skins",
        json!({ "joints": [joint, joint + 1], "inverseBindMatrices": binds }),
    );
    file.json["nodes"][1]["skin"] = json!(0);
    file.json["nodes"][1]["extensions"] = json!({
        "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations } }
    });
    file.json["extensionsUsed"] = json!(["KHR_texture_transform", "EXT_mesh_gpu_instancing"]);
    file.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    file
}

/// OBJ file that uses many features of the format.
pub(crate) const RICH_OBJ: &str = "# made by hand
mtllib a.mtl
o thing
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 1 1 0 0 0 1
v 0 1 0
v 0.5 0.25 0 1.0
vt 0 0
vt 1 0
vt 1 1 0
vt 0 1
vn 0 0 1
usemtl\tred paint
f 1/1/1 2/2/1 3/3/1 4/4/1
f 1 2 \\
  3 5
usemtl none
f -5//1 -4//1 -3//1
l 1 2 3
p 1
f 1/1 2/2 3
";

/// Materials of [`RICH_OBJ`].
pub(crate) const RICH_MTL: &str = "newmtl red paint
Kd 1 0 0
d 0.5
map_Kd -s 2 2 a.png
newmtl other
Tr 0.5
";
