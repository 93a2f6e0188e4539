//! Describes the layer of a cloud of splats, for writers of either form.

use glam::{DMat3, DQuat, DVec3};

use super::field::{BY_DEPTH, BY_DISTANCE, ENCODED, FIELD, LINEAR, SPLATS, SURFLETS};
use crate::data::splats::SplatCloud;
use crate::math::{harmonics_count, narrowed};

/// Reach of a splat in the prim's extent, standard deviations.
const REACH: f64 = 3.0;

/// Name of the prim.
pub(super) const PRIM: &str = "splats";

/// Up axis, and the length of a unit. Files that state no unit are in centimetres. glTF's are in metres.
pub(super) const UP_AXIS: &str = "Y";
pub(super) const METRES_PER_UNIT: u8 = 1;

/// A layer with one prim.
pub(super) struct Layer<'a> {
    /// Schema of the prim.
    pub(super) kind: &'static str,
    /// Names of schemas applied to it.
    pub(super) schemas: Vec<String>,
    /// Attributes of the prim, by name.
    pub(super) attributes: Vec<Attribute<'a>>,
}

/// An attribute.
pub(super) struct Attribute<'a> {
    pub(super) name: &'static str,
    /// Name of its type.
    pub(super) kind: &'static str,
    pub(super) is_uniform: bool,
    pub(super) value: Value<'a>,
}

/// A value.
pub(super) enum Value<'a> {
    Token(&'static str),
    Tokens(&'static [&'static str]),
    Int(i32),
    Vector([f64; 3]),
    Array(Array<'a>),
}

/// An array whose elements are one number, a vector or a quaternion w, x, y, z.
pub(super) struct Array<'a> {
    pub(super) count: usize,
    pub(super) shape: Shape,
    /// Returns an element. Numbers beyond its shape's are not used.
    pub(super) of: Box<dyn Fn(usize) -> [f32; 4] + Sync + 'a>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Number,
    Vector,
    Quaternion,
}

impl Shape {
    pub(super) fn width(self) -> usize {
        match self {
            Self::Number => 1,
            Self::Vector => 3,
            Self::Quaternion => 4,
        }
    }
}

impl<'a> Layer<'a> {
    /// Describes splats. Those that are all flat become surflets.
    ///
    /// - `offset`: subtracted from positions, and added by the prim's transform.
    pub(super) fn of(cloud: &'a SplatCloud, offset: DVec3) -> Self {
        // Surflets have no hint for their order.
        let is_flat = |s: &[f32; 3]| s[2] == 0.0 && s[0] > 0.0 && s[1] > 0.0;
        let are_flat = !cloud.by_distance && cloud.scales.iter().all(is_flat);
        let mut schemas = Vec::new();
        if are_flat {
            schemas.push(SURFLETS.to_owned());
            let attributes = [
                "Position",
                "Orientation",
                "Scale",
                "Opacity",
                "SphericalHarmonics",
            ];
            schemas.extend(attributes.map(|name| format!("ParticleField{name}AttributeAPI")));
        }
        schemas.push("ColorSpaceAPI".to_owned());
        let count = cloud.positions.len();
        let place = move |i: usize| (cloud.positions[i] - offset).as_vec3().to_array();
        let extent = extent(cloud, offset);
        let sets = count * harmonics_count(cloud.harmonics_degree);
        let scales = move |i: usize| match are_flat {
            true => cloud.scales[i],
            false => cloud.thick_scales(i),
        };
        let order = match cloud.by_distance {
            true => BY_DISTANCE,
            false => BY_DEPTH,
        };
        let space = if cloud.is_linear { LINEAR } else { ENCODED };
        let mut attributes = vec![
            uniform("colorSpace:name", "token", Value::Token(space)),
            vectors("extent", "float3[]", 2, move |i| extent[i]),
            array("opacities", "float[]", count, Shape::Number, |i| {
                [cloud.opacities[i], 0.0, 0.0, 0.0]
            }),
            array("orientations", "quatf[]", count, Shape::Quaternion, |i| {
                cloud.unit_rotation(i).map(narrowed)
            }),
            vectors("positions", "point3f[]", count, place),
            vectors(
                "radiance:sphericalHarmonicsCoefficients",
                "float3[]",
                sets,
                |i| [0, 1, 2].map(|channel| cloud.harmonics[3 * i + channel]),
            ),
            uniform(
                "radiance:sphericalHarmonicsDegree",
                "int",
                Value::Int(cloud.harmonics_degree.into()),
            ),
            vectors("scales", "float3[]", count, scales),
        ];
        if !are_flat {
            attributes.push(uniform("sortingModeHint", "token", Value::Token(order)));
        }
        if offset != DVec3::ZERO {
            attributes.push(Attribute {
                name: "xformOp:translate",
                kind: "double3",
                is_uniform: false,
                value: Value::Vector(offset.to_array()),
            });
            let order = Value::Tokens(&["xformOp:translate"]);
            attributes.push(uniform("xformOpOrder", "token[]", order));
        }
        Self {
            kind: if are_flat { FIELD } else { SPLATS },
            schemas,
            attributes,
        }
    }
}

fn uniform<'a>(name: &'static str, kind: &'static str, value: Value<'a>) -> Attribute<'a> {
    Attribute {
        name,
        kind,
        is_uniform: true,
        value,
    }
}

fn array<'a>(
    name: &'static str,
    kind: &'static str,
    count: usize,
    shape: Shape,
    of: impl Fn(usize) -> [f32; 4] + Sync + 'a,
) -> Attribute<'a> {
    let of = Box::new(of);
    Attribute {
        name,
        kind,
        is_uniform: false,
        value: Value::Array(Array { count, shape, of }),
    }
}

fn vectors<'a>(
    name: &'static str,
    kind: &'static str,
    count: usize,
    of: impl Fn(usize) -> [f32; 3] + Sync + 'a,
) -> Attribute<'a> {
    let of = move |i: usize| {
        let [x, y, z] = of(i);
        [x, y, z, 0.0]
    };
    array(name, kind, count, Shape::Vector, of)
}

/// Returns the name and the version of the program, for a layer's documentation.
pub(super) fn documentation() -> String {
    format!("ewa-splat {}", env!("CARGO_PKG_VERSION"))
}

/// The box of the splats without the offset.
fn extent(cloud: &SplatCloud, offset: DVec3) -> [[f32; 3]; 2] {
    let mut corners = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for (i, position) in cloud.positions.iter().enumerate() {
        let [w, x, y, z] = cloud.unit_rotation(i);
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let axes = axes * DMat3::from_diagonal(DVec3::from(cloud.scales[i].map(f64::from)));
        let rows = axes.transpose();
        let half = DVec3::new(
            rows.x_axis.length(),
            rows.y_axis.length(),
            rows.z_axis.length(),
        );
        let middle = *position - offset;
        corners[0] = corners[0].min(middle - REACH * half);
        corners[1] = corners[1].max(middle + REACH * half);
    }
    let most = f64::from(f32::MAX);
    corners.map(|corner| {
        let corner = corner.clamp(DVec3::splat(-most), DVec3::splat(most));
        corner.as_vec3().to_array()
    })
}
