//! Reads materials and textures.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use glam::{Affine2, Mat2, Vec2};

use super::container::{Buffers, Source};
use super::document::Object;
use crate::data::mesh::{AlphaMode, Material, Texture, TextureImage, TextureUse, Wrap};
use crate::error::Result;
use crate::io::mesh::texture::ImageBudget;
use crate::io::vtk::xml::clip;
use crate::math::narrowed;

/// Extensions for texture formats that are not read. A texture with no other source is left out.
const TEXTURE_FORMATS: &[&str] = &["KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"];

/// Extensions that name an image in WebP or KTX 2; it is used if there is no other image.
const SOURCES: [&str; 2] = ["EXT_texture_webp", "KHR_texture_basisu"];

/// Material for primitives with certain sets of texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MaterialSets {
    /// Index of the material.
    pub(super) material: usize,
    /// Indices of the file's sets that become the first and the second set of a part.
    pub(super) sets: [Option<u32>; 2],
}

/// Index of a material, and which of its three textures the primitive has coordinates for.
type Key = (Option<usize>, [bool; 3]);

/// Materials and textures, made when primitives request them.
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

    /// Returns the material of a primitive; `has_set` returns true for its sets of coordinates.
    ///
    /// # Errors
    /// A material or a texture does not exist. Images that cannot be read cause notes only.
    pub(super) fn get(
        &mut self,
        index: Option<usize>,
        has_set: impl Fn(u32) -> bool,
    ) -> Result<MaterialSets> {
        let document = self.buffers.document;
        let stated = match index {
            None => None,
            Some(index) => Some(document.get("materials", index, "primitive")?),
        };
        let Colours {
            base_colour,
            base,
            emissive: factor,
            emissive_texture: emissive,
            relief,
            relief_scale,
        } = Colours::of(stated)?;
        let (base, emissive, relief) = (base.as_ref(), emissive.as_ref(), relief.as_ref());
        let is_there = |info: Option<&Info>| info.is_some_and(|info| has_set(info.set));
        let key = (
            index,
            [is_there(base), is_there(emissive), is_there(relief)],
        );
        if let Some(&known) = self.made.get(&key) {
            return Ok(known);
        }
        let name = stated.as_ref().and_then(Object::name).unwrap_or_default();
        let name = name.to_owned();
        for (info, is_there) in [base, emissive].into_iter().zip(key.1) {
            if let (Some(info), false) = (info, is_there) {
                self.notes.insert(format!(
                    "a primitive of material `{}` has no TEXCOORD_{}: the texture is not used \
                     there",
                    clip(&name),
                    info.set
                ));
            }
        }
        let base_set = base.filter(|_| key.1[0]).map(|info| info.set);
        let emissive_set = emissive.filter(|_| key.1[1]).map(|info| info.set);
        let base_texture = match base.filter(|_| key.1[0]) {
            Some(info) => self.texture_use(info, 0)?,
            None => None,
        };
        // Both textures may use the same set.
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
        // A part has two sets; the normal map must use one of them.
        let free = sets.iter().position(Option::is_none);
        let place = |set: u32| sets.iter().position(|own| *own == Some(set)).or(free);
        let relief = relief.filter(|_| key.1[2]);
        let normal_texture = match relief.and_then(|info| Some((info, place(info.set)?))) {
            Some((info, place)) => {
                let used = self.texture_use(info, place)?;
                if used.is_some() {
                    sets[place] = Some(info.set);
                }
                used
            }
            None => None,
        };
        let alpha = match stated {
            None => AlphaMode::Opaque,
            Some(stated) => match stated.word("alphaMode")? {
                None | Some("OPAQUE") => AlphaMode::Opaque,
                Some("MASK") => {
                    AlphaMode::Mask(stated.number("alphaCutoff")?.map_or(0.5, narrowed))
                }
                Some("BLEND") => AlphaMode::Blend,
                Some(other) => {
                    let place = format!("material `{}`, alphaMode", clip(&name));
                    let expected = "OPAQUE, MASK or BLEND";
                    let found = format!("`{}`", clip(other));
                    return Err(self.buffers.refuse(place, expected, found));
                }
            },
        };
        let is_double_sided = match stated {
            None => false,
            Some(stated) => stated.flag("doubleSided")?,
        };
        // Emission would cover the whole surface without its texture, so it is dropped if the texture cannot be read.
        let is_dark = emissive.is_some() && emissive_texture.is_none();
        self.materials.push(Material {
            base_colour,
            base_texture,
            emissive: if is_dark { [0.0; 3] } else { factor },
            emissive_texture,
            normal_texture,
            normal_scale: relief_scale,
            is_unlit: stated.is_some_and(|s| s.extension("KHR_materials_unlit").is_some()),
            alpha,
            is_double_sided,
            name,
        });
        let made = MaterialSets {
            material: self.materials.len() - 1,
            sets,
        };
        self.made.insert(key, made);
        Ok(made)
    }

    /// Returns a texture with its transform and the part's set of coordinates. Returns `None` and adds a note if it
    /// cannot be read.
    fn texture_use(&mut self, info: &Info, coordinates: usize) -> Result<Option<TextureUse>> {
        let document = self.buffers.document;
        let texture = document.get("textures", info.texture, "material")?;
        let index = image_of(texture)?;
        let image = index.and_then(|index| Some((index, document.find("images", index)?)));
        let Some((source, image)) = image else {
            let extension = TEXTURE_FORMATS
                .iter()
                .find(|name| texture.extensions().any(|own| own == **name));
            let reason = extension.map_or("it has no image".to_owned(), |name| {
                format!("its only image needs {name}")
            });
            let texture = info.texture;
            self.notes
                .insert(format!("texture {texture} is not used: {reason}"));
            return Ok(None);
        };
        if !self.images.contains_key(&source) {
            let decoded = match self.decode(image, source) {
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
        let wrap = match texture.index("sampler")? {
            None => [Wrap::Repeat; 2],
            Some(index) => {
                let sampler = document.get("samplers", index, "texture")?;
                let mode = |key: &str| -> Result<Wrap> {
                    Ok(match sampler.integer(key)? {
                        Some(33_071) => Wrap::ClampToEdge,
                        Some(33_648) => Wrap::MirroredRepeat,
                        _ => Wrap::Repeat,
                    })
                };
                [mode("wrapS")?, mode("wrapT")?]
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
            transform: info.transform,
        }))
    }

    /// Decodes an image, or returns the reason why this fails.
    fn decode(&mut self, image: Object<'_>, index: usize) -> Result<TextureImage, String> {
        let place = format!("image {index}");
        let uri = image.word("uri").map_err(|e| e.to_string())?;
        let view = image.index("bufferView").map_err(|e| e.to_string())?;
        let owned;
        let bytes = match (uri, view) {
            (Some(uri), _) => {
                let source = Source::of(self.buffers.input, uri)?;
                self.notes.extend(source.note().map(str::to_owned));
                owned = source.read().map_err(|e| e.to_string())?;
                owned.as_slice()
            }
            (None, Some(view)) => {
                let view = self.buffers.view(view, &place).map_err(|e| e.to_string())?;
                view.0
            }
            (None, None) => return Err("it has neither a URI nor a buffer view".into()),
        };
        let name = match (uri, image.name()) {
            (Some(uri), _) if !uri.starts_with("data:") => format!("`{}`", clip(uri)),
            (_, Some(name)) => format!("`{}`", clip(name)),
            _ => "it".into(),
        };
        let decoded = self.budget.decode(bytes);
        decoded.map_err(|reason| format!("{name} {reason}"))
    }
}

/// Returns the index of a texture's image: its own, or else the one that an extension names.
fn image_of(texture: Object<'_>) -> Result<Option<usize>> {
    if let Some(source) = texture.index("source")? {
        return Ok(Some(source));
    }
    let stated = SOURCES.into_iter().find_map(|name| texture.extension(name));
    match stated {
        Some(stated) => stated.index("source"),
        None => Ok(None),
    }
}

/// Reference from a material to a texture.
struct Info {
    /// Index of the texture.
    texture: usize,
    /// Index of its set of coordinates. The transform may override the material's.
    set: u32,
    transform: Affine2,
}

impl Info {
    fn of(stated: Object<'_>) -> Result<Self> {
        let texture = stated.size("index")?;
        let mut set = stated.integer("texCoord")?;
        let mut transform = Affine2::IDENTITY;
        if let Some(own) = stated.extension("KHR_texture_transform") {
            set = own.integer("texCoord")?.or(set);
            // The order is scale, rotation, translation. In glTF v points downwards, so a counterclockwise rotation
            // takes (u, v) to (u cos + v sin, v cos - u sin).
            let (sin, cos) = own.number("rotation")?.map_or(0.0, narrowed).sin_cos();
            let turn = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
            let pair = |numbers: Option<[f64; 2]>, otherwise| {
                numbers.map_or(otherwise, |n| Vec2::from_array(n.map(narrowed)))
            };
            let scale = Mat2::from_diagonal(pair(own.numbers("scale")?, Vec2::ONE));
            let offset = pair(own.numbers("offset")?, Vec2::ZERO);
            transform = Affine2::from_mat2_translation(turn * scale, offset);
        }
        Ok(Self {
            texture: usize::try_from(texture).unwrap_or(usize::MAX),
            set: u32::try_from(set.unwrap_or(0)).unwrap_or(u32::MAX),
            transform,
        })
    }

    fn within(stated: Object<'_>, key: &'static str) -> Result<Option<Self>> {
        stated.object(key)?.map(Self::of).transpose()
    }
}

/// Colours and textures of a material.
struct Colours {
    /// Linear colour.
    base_colour: [f32; 4],
    base: Option<Info>,
    /// Linear colour.
    emissive: [f32; 3],
    emissive_texture: Option<Info>,
    relief: Option<Info>,
    relief_scale: f32,
}

impl Colours {
    /// Returns the colours of a material; without one, those of the format's default material.
    fn of(stated: Option<Object<'_>>) -> Result<Self> {
        let mut colours = Self {
            base_colour: [1.0; 4],
            base: None,
            emissive: [0.0; 3],
            emissive_texture: None,
            relief: None,
            relief_scale: 1.0,
        };
        let Some(stated) = stated else {
            return Ok(colours);
        };
        if let Some(metallic) = stated.object("pbrMetallicRoughness")? {
            if let Some(factor) = metallic.numbers("baseColorFactor")? {
                colours.base_colour = factor.map(narrowed);
            }
            colours.base = Info::within(metallic, "baseColorTexture")?;
        }
        // The older extension gives the colours if the material states none itself.
        let says_nothing = colours.base.is_none() && colours.base_colour.iter().all(|c| *c >= 1.0);
        let older = stated.extension("KHR_materials_pbrSpecularGlossiness");
        if let Some(older) = older.filter(|_| says_nothing) {
            if let Some(factor) = older.numbers("diffuseFactor")? {
                colours.base_colour = factor.map(narrowed);
            }
            colours.base = Info::within(older, "diffuseTexture")?;
        }
        let strength = match stated.extension("KHR_materials_emissive_strength") {
            Some(extension) => extension.number("emissiveStrength")?.map_or(1.0, narrowed),
            None => 1.0,
        };
        if let Some(factor) = stated.numbers::<3>("emissiveFactor")? {
            colours.emissive = factor.map(|c| narrowed(c) * strength);
        }
        colours.emissive_texture = Info::within(stated, "emissiveTexture")?;
        if let Some(relief) = stated.object("normalTexture")? {
            colours.relief_scale = relief.number("scale")?.map_or(1.0, narrowed);
            colours.relief = Some(Info::of(relief)?);
        }
        Ok(colours)
    }
}
