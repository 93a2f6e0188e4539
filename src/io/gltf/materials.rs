//! Materials and textures.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use glam::{Affine2, Mat2, Vec2};
use gltf_json::material::AlphaMode as StatedAlpha;
use gltf_json::texture::{Info, WrappingMode};
use gltf_json::validation::Checked;
use gltf_json::{self as json, Index};

use super::container::{Buffers, Source};
use crate::error::Result;
use crate::io::texture::ImageBudget;
use crate::io::vtk_xml::clip;
use crate::io::{AlphaMode, Material, Texture, TextureImage, TextureUse, Wrap};

/// Extensions that say how a texture is stored; without another source it is not read.
const TEXTURE_FORMATS: &[&str] = &["KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"];

/// The extensions that name an image in WebP or KTX 2, which is taken where there is no other.
const SOURCES: [&str; 2] = ["EXT_texture_webp", "KHR_texture_basisu"];

/// A material for the primitives that have certain sets of texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MaterialSets {
    /// Index of the material.
    pub(super) material: usize,
    /// The file's sets that become the first and the second of a part.
    pub(super) sets: [Option<u32>; 2],
}

/// A material and which of its three textures the primitive has coordinates for.
type Key = (Option<usize>, [bool; 3]);

/// Materials and textures, made as primitives ask for them.
pub(super) struct Materials<'b, 'f> {
    buffers: &'b Buffers<'f>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) notes: BTreeSet<String>,
    made: HashMap<Key, MaterialSets>,
    images: HashMap<usize, Option<Arc<TextureImage>>>,
    texture_index: HashMap<(usize, [Wrap; 2]), usize>,
    budget: ImageBudget,
}

impl<'b, 'f> Materials<'b, 'f> {
    pub(super) fn new(buffers: &'b Buffers<'f>) -> Self {
        Self {
            buffers,
            materials: Vec::new(),
            textures: Vec::new(),
            notes: BTreeSet::new(),
            made: HashMap::new(),
            images: HashMap::new(),
            texture_index: HashMap::new(),
            budget: ImageBudget::default(),
        }
    }

    /// The material of a primitive that has the sets of coordinates that `has_set` says.
    ///
    /// # Errors
    /// A material or a texture that is not there. Images that cannot be read are noted.
    pub(super) fn get(
        &mut self,
        material: Option<Index<json::Material>>,
        has_set: impl Fn(u32) -> bool,
    ) -> Result<MaterialSets> {
        let root = self.buffers.root;
        let default = json::Material::default();
        let stated = match material {
            None => &default,
            Some(index) => root.get(index).ok_or_else(|| {
                let expected = format!("one of {} materials", root.materials.len());
                let found = format!("material {}", index.value());
                self.buffers.refuse("primitive", expected, found)
            })?,
        };
        let index = material.map(|m| m.value());
        let (base, emissive) = (base_texture(stated), stated.emissive_texture.as_ref());
        let is_there = |info: Option<&Info>| info.is_some_and(|info| has_set(set_of(info)));
        let relief = stated.normal_texture.as_ref().map(of_normals);
        let relief = relief.as_ref();
        let key = (
            index,
            [is_there(base), is_there(emissive), is_there(relief)],
        );
        if let Some(&known) = self.made.get(&key) {
            return Ok(known);
        }
        let name = stated.name.clone().unwrap_or_default();
        for (info, is_there) in [base, emissive].into_iter().zip(key.1) {
            if let (Some(info), false) = (info, is_there) {
                self.notes.insert(format!(
                    "a primitive of material `{}` has no TEXCOORD_{}: the texture is not used \
                     there",
                    clip(&name),
                    set_of(info)
                ));
            }
        }
        let base_set = base.filter(|_| key.1[0]).map(set_of);
        let emissive_set = emissive.filter(|_| key.1[1]).map(set_of);
        let base_texture = match base.filter(|_| key.1[0]) {
            Some(info) => self.texture_use(info, 0)?,
            None => None,
        };
        // Both may use one set.
        let second = usize::from(base_texture.is_some() && base_set != emissive_set);
        let emissive_texture = match emissive.filter(|_| key.1[1]) {
            Some(info) => self.texture_use(info, second)?,
            None => None,
        };
        let mut sets = [None; 2];
        if base_texture.is_some() {
            sets[0] = base_set;
        }
        if emissive_texture.is_some() {
            sets[second] = emissive_set;
        }
        // Of a part's two sets one must be the relief's.
        let free = sets.iter().position(Option::is_none);
        let place = |set: u32| sets.iter().position(|own| *own == Some(set)).or(free);
        let relief = relief.filter(|_| key.1[2]);
        let normal_texture = match relief.and_then(|info| Some((info, place(set_of(info))?))) {
            Some((info, place)) => {
                let used = self.texture_use(info, place)?;
                if used.is_some() {
                    sets[place] = Some(set_of(info));
                }
                used
            }
            None => None,
        };
        let strength = stated
            .extensions
            .as_ref()
            .and_then(|e| e.emissive_strength.as_ref())
            .map_or(1.0, |e| e.emissive_strength.0);
        // Light through a texture that cannot be read would be light everywhere.
        let is_dark = emissive.is_some() && emissive_texture.is_none();
        let emissive = stated.emissive_factor.0;
        self.materials.push(Material {
            base_colour: base_colour(stated),
            base_texture,
            emissive: if is_dark {
                [0.0; 3]
            } else {
                emissive.map(|c| c * strength)
            },
            emissive_texture,
            normal_texture,
            normal_scale: stated.normal_texture.as_ref().map_or(1.0, |n| n.scale),
            is_unlit: stated
                .extensions
                .as_ref()
                .is_some_and(|e| e.unlit.is_some()),
            alpha: match stated.alpha_mode {
                Checked::Valid(StatedAlpha::Opaque) => AlphaMode::Opaque,
                Checked::Valid(StatedAlpha::Mask) => {
                    AlphaMode::Mask(stated.alpha_cutoff.map_or(0.5, |c| c.0))
                }
                Checked::Valid(StatedAlpha::Blend) => AlphaMode::Blend,
                Checked::Invalid => {
                    let place = format!("material `{}`, alphaMode", clip(&name));
                    let expected = "OPAQUE, MASK or BLEND";
                    return Err(self.buffers.refuse(place, expected, "another word"));
                }
            },
            is_double_sided: stated.double_sided,
            name,
        });
        let made = MaterialSets {
            material: self.materials.len() - 1,
            sets,
        };
        self.made.insert(key, made);
        Ok(made)
    }

    /// A texture under its transform, with the part's set of coordinates; `None` and a note where
    /// it cannot be read.
    fn texture_use(&mut self, info: &Info, coordinates: usize) -> Result<Option<TextureUse>> {
        let root = self.buffers.root;
        let texture = root.get(info.index).ok_or_else(|| {
            let expected = format!("one of {} textures", root.textures.len());
            let found = format!("texture {}", info.index.value());
            self.buffers.refuse("material", expected, found)
        })?;
        let Some(index) = image_of(texture).filter(|index| root.get(*index).is_some()) else {
            let extension = texture.extensions.as_ref().and_then(|e| {
                let known = |name: &&&str| e.others.contains_key(**name);
                TEXTURE_FORMATS.iter().find(known)
            });
            let reason = extension.map_or("it has no image".to_owned(), |name| {
                format!("its only image needs {name}")
            });
            let texture = info.index.value();
            self.notes
                .insert(format!("texture {texture} is not used: {reason}"));
            return Ok(None);
        };
        let source = index.value();
        if !self.images.contains_key(&source) {
            let decoded = match self.decode(&root.images[source], source) {
                Ok(decoded) => Some(Arc::new(decoded)),
                Err(reason) => {
                    self.notes
                        .insert(format!("image {source} is not used: {reason}"));
                    None
                }
            };
            self.images.insert(source, decoded);
        }
        let Some(Some(image)) = self.images.get(&source) else {
            return Ok(None);
        };
        let wrap = match texture.sampler {
            None => [Wrap::Repeat; 2],
            Some(index) => {
                let sampler = root.get(index).ok_or_else(|| {
                    let expected = format!("one of {} samplers", root.samplers.len());
                    let found = format!("sampler {}", index.value());
                    self.buffers.refuse("texture", expected, found)
                })?;
                [sampler.wrap_s, sampler.wrap_t].map(|mode| match mode {
                    Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
                    Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
                    Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
                })
            }
        };
        let textures = &mut self.textures;
        let texture = *self.texture_index.entry((source, wrap)).or_insert_with(|| {
            textures.push(Texture {
                image: Arc::clone(image),
                wrap,
            });
            textures.len() - 1
        });
        Ok(Some(TextureUse {
            texture,
            coordinates,
            transform: transform(info),
        }))
    }

    /// An image's pixels, or why there are none.
    fn decode(&mut self, image: &json::Image, index: usize) -> Result<TextureImage, String> {
        let place = format!("image {index}");
        let owned;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                owned = Source::of(self.buffers.input, uri)
                    .and_then(|source| source.read().map_err(|e| e.to_string()))?;
                owned.as_slice()
            }
            (None, Some(view)) => {
                let view = self.buffers.view(view, &place).map_err(|e| e.to_string())?;
                view.0
            }
            (None, None) => return Err("it has neither a URI nor a buffer view".into()),
        };
        let name = match (&image.uri, &image.name) {
            (Some(uri), _) if !uri.starts_with("data:") => format!("`{}`", clip(uri)),
            (_, Some(name)) => format!("`{}`", clip(name)),
            _ => "it".into(),
        };
        let decoded = self.budget.decode(bytes);
        decoded.map_err(|reason| format!("{name} {reason}"))
    }
}

/// The image of a texture: its own, or else the one that an extension names.
fn image_of(texture: &json::Texture) -> Option<Index<json::Image>> {
    // What is missing is the greatest index.
    if texture.source.value() != u32::MAX as usize {
        return Some(texture.source);
    }
    let others = &texture.extensions.as_ref()?.others;
    let stated = SOURCES.iter().find_map(|name| others.get(*name));
    let source = stated?.get("source")?.as_u64()?;
    u32::try_from(source).ok().map(Index::new)
}

/// The texture of the base colour; of `KHR_materials_pbrSpecularGlossiness` where the material
/// states its colour by that alone.
fn base_texture(stated: &json::Material) -> Option<&Info> {
    let metallic = stated.pbr_metallic_roughness.base_color_texture.as_ref();
    metallic.or_else(|| specular(stated)?.diffuse_texture.as_ref())
}

fn base_colour(stated: &json::Material) -> [f32; 4] {
    specular(stated).map_or(
        stated.pbr_metallic_roughness.base_color_factor.0,
        |specular| specular.diffuse_factor.0,
    )
}

/// The older description of colours, where the newer one says nothing.
fn specular(stated: &json::Material) -> Option<&json::extensions::material::PbrSpecularGlossiness> {
    let metallic = &stated.pbr_metallic_roughness;
    let says_nothing = metallic.base_color_texture.is_none()
        && metallic.base_color_factor.0.iter().all(|c| *c >= 1.0);
    let extensions = stated.extensions.as_ref().filter(|_| says_nothing)?;
    extensions.pbr_specular_glossiness.as_ref()
}

/// A texture of normals as others are stated.
fn of_normals(stated: &json::material::NormalTexture) -> Info {
    let others = stated.extensions.as_ref().map(|e| &e.others);
    let transform = others.and_then(|others| others.get("KHR_texture_transform"));
    let texture_transform = transform.and_then(|t| serde_json::from_value(t.clone()).ok());
    Info {
        index: stated.index,
        tex_coord: stated.tex_coord,
        extensions: Some(json::extensions::texture::Info {
            texture_transform,
            ..json::extensions::texture::Info::default()
        }),
        extras: stated.extras.clone(),
    }
}

/// The set of coordinates of a texture; a transform may name another.
fn set_of(info: &Info) -> u32 {
    let transform = info
        .extensions
        .as_ref()
        .and_then(|e| e.texture_transform.as_ref());
    transform
        .and_then(|t| t.tex_coord)
        .unwrap_or(info.tex_coord)
}

/// `KHR_texture_transform`: scaled, then turned, then moved. With v downwards, as glTF has it, a
/// turn against the clock takes (u, v) to (u cos + v sin, v cos - u sin).
fn transform(info: &Info) -> Affine2 {
    let Some(stated) = info
        .extensions
        .as_ref()
        .and_then(|e| e.texture_transform.as_ref())
    else {
        return Affine2::IDENTITY;
    };
    let (sin, cos) = stated.rotation.0.sin_cos();
    let turn = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let scale = Mat2::from_diagonal(Vec2::from_array(stated.scale.0));
    Affine2::from_mat2_translation(turn * scale, Vec2::from_array(stated.offset.0))
}
