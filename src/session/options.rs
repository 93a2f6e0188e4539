//! Converts arguments to the library's options.

use glam::DVec3;

use super::arguments::{Arguments, choice, number, positive, range};
use crate::frame::backdrop::{DepthKind, GivenBackdrop};
use crate::frame::settings::{Advanced, Blend, Composite, Order, Settings, Show};
use crate::io::{
    Dataset, LengthMeaning, OpenOptions, ParticleType, RawLayout, RawType, ReadAs, ScaleMeaning,
    SphKernel, StepChoice,
};
use crate::sample::mesh::Spread;
use crate::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, ParticleShape, PeriodicBox, SampleOptions,
    TransferChoice,
};
use crate::scene::{
    Classification, Light, LightFrame, Lighting, MAX_SOFTNESS_DEG, ScaleName, Shadows, SplatRule,
};
use crate::splat::Filter;
use crate::view::{Aperture, ClipPlane};

/// Options that turn samples into kernels.
#[derive(Debug, Clone)]
pub struct Sampling {
    /// Options of the library.
    pub options: SampleOptions,
    /// Direction up.
    pub up: Option<DVec3>,
    /// Unit of the field that is shown.
    pub unit: Option<String>,
    /// Units of fields by name.
    pub units: Vec<(String, String)>,
    /// Opacity of the boundary that is drawn around a volume.
    pub around: Option<f64>,
}

impl Sampling {
    /// Gives the fields of a data set their units.
    pub(super) fn set_units(&self, dataset: &mut Dataset) {
        for field in &mut dataset.fields {
            if let Some((_, unit)) = self.units.iter().find(|(name, _)| *name == field.name) {
                field.unit = Some(unit.clone());
            }
        }
        let Some(unit) = &self.unit else { return };
        let mut fields = dataset.fields.iter_mut();
        let shown = match &self.options.field {
            Some(name) => fields.find(|field| field.name.eq_ignore_ascii_case(name)),
            None => fields.next(),
        };
        if let Some(field) = shown {
            field.unit = Some(unit.clone());
        }
    }
}

/// Options for opening files.
#[derive(Debug, Clone, Default)]
pub struct Opening {
    /// Options of the library.
    pub options: OpenOptions,
    /// Types of the particles that are taken from a snapshot.
    pub types: Vec<ParticleType>,
    /// Time step; by default the first.
    pub step: Option<StepChoice>,
}

/// Takes the sampling options, with the command line's meanings.
///
/// # Errors
/// Values outside an option's domain; options that exclude or need others.
pub fn sampling<A: Arguments>(said: &mut A) -> Result<Sampling, A::Error> {
    let defaults = SampleOptions::default();
    let count = said.count("count")?;
    let (density, spacing) = (
        positive(said, "density")?,
        positive(said, "surfel_spacing")?,
    );
    let spread = match (count, density, spacing) {
        (None, None, None) => Spread::Automatic,
        (Some(count), None, None) => Spread::Count(count),
        (None, Some(density), None) => Spread::Density(density),
        (None, None, Some(distance)) => Spread::Spacing(distance),
        _ => {
            let text = "count, density, surfel_spacing: expected one of them, found several";
            return Err(A::refused(text));
        }
    };
    let is_surface = said.flag("surface")?.unwrap_or(false);
    let is_share = |opacity: f64| opacity > 0.0 && opacity < 1.0;
    let around = number(
        said,
        "surface_opacity",
        "a number above 0 and below 1",
        is_share,
    )?;
    let centre = said.floats::<3>("centre")?.map(DVec3::from);
    let periodic = said.floats::<3>("box")?.map(|edges| {
        let whole = PeriodicBox::from_origin(edges.into());
        PeriodicBox {
            centre: centre.unwrap_or(whole.centre),
            ..whole
        }
    });
    if centre.is_some() && periodic.is_none() {
        let text = "centre: expected a box beside it, found none";
        return Err(A::refused(text));
    }
    let passes = said.count("shepard")?.unwrap_or(0);
    let passes = u32::try_from(passes).map_err(|_| {
        A::refused(format!(
            "shepard: expected a count of 32 bits, found {passes}"
        ))
    })?;
    let kernel = choice(
        said,
        "kernel",
        &[
            ("cubic", Some(SphKernel::CubicSpline)),
            ("quartic", Some(SphKernel::QuarticSpline)),
            ("quintic", Some(SphKernel::QuinticSpline)),
            ("wendland-c2", Some(SphKernel::WendlandC2)),
            ("wendland-c4", Some(SphKernel::WendlandC4)),
            ("wendland-c6", Some(SphKernel::WendlandC6)),
            ("gaussian", None),
        ],
    )?;
    let options = SampleOptions {
        field: said.text("field")?,
        preferred_field: None,
        kernels: KernelOptions {
            width: positive(said, "kernel_width")?.unwrap_or(defaults.kernels.width),
            length: choice(
                said,
                "length",
                &[
                    ("h", LengthMeaning::SmoothingLength),
                    ("support", LengthMeaning::Support),
                    ("sigma", LengthMeaning::Sigma),
                    ("fwhm", LengthMeaning::Fwhm),
                ],
            )?,
            smoothing: kernel.flatten(),
            gaussian: kernel == Some(None),
            radius: positive(said, "one_radius")?,
            shape: choice(
                said,
                "shape",
                &[
                    ("auto", ParticleShape::Automatic),
                    ("isotropic", ParticleShape::Isotropic),
                    ("covariance", ParticleShape::Covariance),
                    ("yu-turk", ParticleShape::YuTurk),
                ],
            )?
            .unwrap_or_default(),
            shepard_passes: passes,
            boundary: choice(
                said,
                "boundary",
                &[
                    ("auto", BoundaryChoice::Automatic),
                    ("sharp", BoundaryChoice::Sharp),
                    ("soft", BoundaryChoice::Soft),
                ],
            )?
            .unwrap_or(BoundaryChoice::Automatic),
            spread,
            splat_rule: choice(
                said,
                "splat_rule",
                &[
                    ("khr", SplatRule::Khr),
                    ("inria", SplatRule::Inria),
                    ("mip", SplatRule::Mip),
                    ("exact", SplatRule::Exact),
                ],
            )?,
            ..defaults.kernels
        },
        function: FunctionOptions {
            transfer: said
                .transfer("transfer_function")?
                .unwrap_or(TransferChoice::Automatic),
            unit_distance: positive(said, "unit_distance")?,
            range: range(said, "range")?,
            scale: choice(
                said,
                "scale",
                &[
                    ("linear", ScaleName::Linear),
                    ("log", ScaleName::Log),
                    ("symlog", ScaleName::Symlog),
                ],
            )?,
            opacity_scale: positive(said, "opacity_scale")?.unwrap_or(1.0),
        },
        periodic,
        motion: None,
        flatten: number(said, "flatten", "a finite number", f64::is_finite)?,
        surface: (is_surface && around.is_none()).then_some(1.0),
        ..defaults
    };
    let up = said.floats::<3>("up")?.map(DVec3::from);
    let up = match up {
        None => None,
        Some(up) => Some(
            up.try_normalize()
                .ok_or_else(|| A::refused("up: expected three numbers that are not all zero"))?,
        ),
    };
    let unit = said.text("unit")?;
    let units = said.pairs("units")?.unwrap_or_default();
    Ok(Sampling {
        options,
        up,
        unit,
        units,
        around,
    })
}

/// Takes the options for opening files.
///
/// # Errors
/// Values outside an option's domain; options that exclude or need others.
pub fn opening<A: Arguments>(said: &mut A) -> Result<Opening, A::Error> {
    let dims = said.counts::<3>("dims")?;
    let scalar = choice(
        said,
        "type",
        &[
            ("u8", RawType::U8),
            ("i16", RawType::I16),
            ("u16", RawType::U16),
            ("f32", RawType::F32),
        ],
    )?;
    let (spacing, origin) = (said.floats::<3>("spacing")?, said.floats::<3>("origin")?);
    let big_endian = said.flag("big_endian")?;
    let of_raw = scalar.is_some() || spacing.is_some() || origin.is_some() || big_endian.is_some();
    if of_raw && dims.is_none() {
        let text = "dims: expected the counts of a raw volume's samples beside type, spacing, origin and big_endian";
        return Err(A::refused(text));
    }
    let raw = dims.map(|dims| RawLayout {
        dims,
        spacing: spacing.map_or(DVec3::ONE, DVec3::from),
        origin: origin.map_or(DVec3::ZERO, DVec3::from),
        scalar: scalar.unwrap_or(RawType::U8),
        big_endian: big_endian.unwrap_or(false),
    });
    let names = said.texts("particle_types")?.unwrap_or_default();
    let types = names.iter().map(|name| {
        ParticleType::of_name(name).ok_or_else(|| {
            let known = ParticleType::NAMED.map(|t| t.to_string()).join(", ");
            let text = format!("particle_type: expected {known} or a number, found {name}");
            A::refused(text)
        })
    });
    let types = types.collect::<Result<Vec<_>, _>>()?;
    let options = OpenOptions {
        raw,
        solution: said.path("solution")?,
        texture: said.path("texture")?,
        read_as: choice(
            said,
            "read_as",
            &[("points", ReadAs::Points), ("mesh", ReadAs::Mesh)],
        )?,
        scales: choice(
            said,
            "scales",
            &[
                ("linear", ScaleMeaning::Linear),
                ("log", ScaleMeaning::Logarithms),
            ],
        )?,
        particle_type: None,
        time_step: None,
    };
    let number = said.whole("time_step")?.map(|number| match number {
        -1 => Ok(StepChoice::Last),
        number => usize::try_from(number).map(StepChoice::Number),
    });
    let number = number.transpose().map_err(|_| {
        A::refused("time_step: expected a number from 0, or -1 for the last, found less")
    })?;
    let time = said.float("time")?.map(StepChoice::Time);
    if number.is_some() && time.is_some() {
        let text = "time: expected time_step or time, found both";
        return Err(A::refused(text));
    }
    let step = number.or(time);
    Ok(Opening {
        options,
        types,
        step,
    })
}

/// Settings of a picture, and the options that concern more than its frame.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// Settings of the library.
    pub settings: Settings,
    /// True if the variance of the low-pass filter was given.
    pub has_low_pass: bool,
    /// True if volumes are lit.
    pub is_lit: bool,
    /// Transfer function for all data, if one was given.
    pub transfer: Option<TransferChoice>,
    /// True if a colour bar is drawn into the picture.
    pub legend: bool,
    /// Another renderer's picture. Arguments name its kind of depths; front ends add its images.
    pub backdrop: GivenBackdrop,
}

/// Takes the settings of a picture.
///
/// # Errors
/// Values outside a setting's domain; settings without others that they need.
pub fn drawing<A: Arguments>(said: &mut A) -> Result<Drawing, A::Error> {
    let defaults = Settings::default();
    let tolerance = number(said, "tolerance", "a number between 0 and 1", |x| {
        x > 0.0 && x < 1.0
    })?;
    let low_pass = number(said, "low_pass", "a number from 0 up", |x| {
        x >= 0.0 && x.is_finite()
    })?;
    let cutoff = number(said, "cutoff", "a number above 0 and at most 7", |x| {
        x > 0.0 && x <= 7.0
    })?;
    let thickness = positive(said, "slab_thickness")?;
    let composite = choice(
        said,
        "composite",
        &[
            ("over", Composite::Over),
            ("sheets", Composite::SHEETS),
            ("axis-sheets", Composite::AXIS_SHEETS),
            ("slabs", Composite::SLABS),
            ("maximum", Composite::MAXIMUM),
        ],
    )?;
    let composite = composite.unwrap_or_default().with_thickness(thickness);
    if thickness.is_some() && composite == Composite::Over {
        let text = "slab_thickness: expected a composite of slabs, sheets, axis-sheets or maximum, found over";
        return Err(A::refused(text));
    }
    let in_slabs = said.flag("post_classification")?.unwrap_or(false);
    if in_slabs && !matches!(composite, Composite::Slabs { .. }) {
        let name = composite.name();
        let text = format!("post_classification: expected a composite of slabs, found {name}");
        return Err(A::refused(text));
    }
    let classifies_slabs = in_slabs || matches!(composite, Composite::Maximum { .. });
    let classify = choice(
        said,
        "classify",
        &[
            ("extent", Classification::Extent),
            ("particle", Classification::Particle),
        ],
    )?;
    if classify == Some(Classification::Particle) && classifies_slabs {
        let text = "classify: expected a composite that classifies particles, found one of slabs";
        return Err(A::refused(text));
    }
    let lights = said.rows::<6>("lights")?;
    let lit = said.flag("lit")?;
    let shadows = shadows(said)?;
    if shadows.is_some() && lit == Some(false) {
        return Err(A::refused(
            "lit: expected true, or nothing, beside shadows, found false",
        ));
    }
    let lit = shadows.map(|_| true).or(lit);
    let is_lit = lit == Some(true) || lights.is_some();
    // By default, surfaces are lit. Post-classified slabs would be lit with them, so then there
    // is no light.
    let lighting = lighting::<A>(lit, lights.as_deref(), !classifies_slabs)?;
    let lighting = lighting.map(|lighting| Lighting {
        shadows,
        ..lighting
    });
    let planes = said.rows::<4>("clip")?.unwrap_or_default();
    let drawing = Drawing {
        settings: Settings {
            tolerance: tolerance.map_or(defaults.tolerance, narrowed),
            filter: choice(
                said,
                "filter",
                &[
                    ("adaptive", Filter::Adaptive),
                    ("exact", Filter::Exact),
                    ("ewa", Filter::Ewa),
                    ("reconstruction", Filter::Reconstruction),
                    ("low-pass", Filter::LowPass),
                    ("isotropic", Filter::Isotropic),
                    ("uniform-scaling", Filter::UniformScaling),
                ],
            )?
            .unwrap_or(defaults.filter),
            advanced: Advanced {
                thresholds: said
                    .floats::<2>("thresholds")?
                    .map(|both| both.map(narrowed)),
                merge_slack: defaults.advanced.merge_slack,
                linear_opacity: said.flag("linear_opacity")?.unwrap_or(false),
                simd: defaults.advanced.simd,
                sub_pixel_opacity: said.flag("sub_pixel_opacity")?.unwrap_or(false),
                opaque_edges: said
                    .flag("opaque_edges")?
                    .unwrap_or(defaults.advanced.opaque_edges),
            },
            level_of_detail: said.flag("level_of_detail")?.unwrap_or(true),
            show: choice(
                said,
                "show",
                &[
                    ("scene", Show::Scene),
                    ("choice", Show::Choice),
                    ("count", Show::Count),
                ],
            )?
            .unwrap_or_default(),
            composite,
            classify: match in_slabs {
                true => Classification::Slab,
                false => classify.unwrap_or_default(),
            },
            clip: planes.iter().map(plane).collect(),
            low_pass_variance_px2: low_pass.map_or(defaults.low_pass_variance_px2, narrowed),
            cutoff: cutoff.map(narrowed),
            blend: choice(
                said,
                "blend",
                &[
                    ("auto", Blend::Auto),
                    ("encoded", Blend::Encoded),
                    ("linear", Blend::Linear),
                ],
            )?
            .unwrap_or_default(),
            order: choice(
                said,
                "order",
                &[
                    ("auto", Order::Auto),
                    ("distance", Order::Distance),
                    ("depth", Order::Depth),
                ],
            )?
            .unwrap_or_default(),
            background: said.floats::<3>("background")?.map(|rgb| rgb.map(narrowed)),
            backdrop: None,
            depth: said.flag("depth")?.unwrap_or(false),
            normals: said.flag("normals")?.unwrap_or(false),
            lighting,
            aperture: aperture(said)?,
            task: None,
        },
        has_low_pass: low_pass.is_some(),
        is_lit,
        transfer: said.transfer("transfer_function")?,
        legend: said.flag("legend")?.unwrap_or(false),
        backdrop: GivenBackdrop {
            kind: depth_kind(said)?,
            ..GivenBackdrop::default()
        },
    };
    Ok(drawing)
}

/// Takes the kind of the depths of a backdrop.
///
/// # Errors
/// A range of planes for depths that are none of OpenGL, or none for those that are.
fn depth_kind<A: Arguments>(said: &mut A) -> Result<DepthKind, A::Error> {
    let name = "background_depth_is";
    let names = [("z", 0), ("distance", 1), ("opengl", 2)];
    let kind = choice(said, name, &names)?.unwrap_or_default();
    match (kind, said.floats::<2>("background_depth_range")?) {
        (2, Some([near, far])) => Ok(DepthKind::OpenGl { near, far }),
        (2, None) => Err(A::refused(
            "background_depth_range: expected the near and the far plane of opengl, found none",
        )),
        (_, Some(_)) => Err(A::refused(
            "background_depth_range: expected background_depth_is \"opengl\" beside it, found another kind",
        )),
        (1, None) => Ok(DepthKind::Distance),
        (_, None) => Ok(DepthKind::Z),
    }
}

/// Returns the lighting that is asked for.
///
/// - `is_default`: true if there is light unless something else is said.
///
/// # Errors
/// Lights beside a wish for none.
pub fn lighting<A: Arguments>(
    lit: Option<bool>,
    lights: Option<&[[f64; 6]]>,
    is_default: bool,
) -> Result<Option<Lighting>, A::Error> {
    match (lights, lit) {
        (Some(_), Some(false)) => Err(A::refused(
            "lit: expected true, or nothing, beside lights, found false",
        )),
        (Some(lights), _) => Ok(Some(Lighting {
            lights: lights.iter().map(light).collect(),
            ..Lighting::default()
        })),
        (None, lit) => Ok(lit.unwrap_or(is_default).then(Lighting::default)),
    }
}

/// Returns the opening of the lens that is asked for.
fn aperture<A: Arguments>(said: &mut A) -> Result<Option<Aperture>, A::Error> {
    let diameter = positive(said, "aperture")?;
    let focus = positive(said, "focus")?;
    let pictures = said.count("exposures")?;
    match (diameter, focus) {
        (Some(diameter), Some(focus)) => Ok(Some(Aperture {
            diameter,
            focus,
            pictures: pictures.unwrap_or(Aperture::DEFAULT_PICTURES),
        })),
        (Some(_), None) => Err(A::refused(
            "aperture: expected focus beside it, the depth that is sharp, found none",
        )),
        (None, _) if focus.is_some() || pictures.is_some() => Err(A::refused(
            "focus, exposures: expected aperture beside them, the diameter of the lens's opening, found none",
        )),
        (None, _) => Ok(None),
    }
}

/// Returns the shadows that are asked for.
fn shadows<A: Arguments>(said: &mut A) -> Result<Option<Shadows>, A::Error> {
    let wanted = said.flag("shadows")?;
    let expected = "degrees from 0 to 15";
    let range = 0.0..=MAX_SOFTNESS_DEG;
    let softness = number(said, "shadow_softness", expected, |x| range.contains(&x))?;
    if wanted == Some(false) && softness.is_some() {
        return Err(A::refused(
            "shadows: expected true, or nothing, beside shadow_softness, found false",
        ));
    }
    let is_any = wanted == Some(true) || softness.is_some();
    Ok(is_any.then(|| Shadows {
        softness_deg: softness.unwrap_or_default(),
    }))
}

fn light(&[x, y, z, r, g, b]: &[f64; 6]) -> Light {
    Light {
        direction: DVec3::new(x, y, z),
        frame: LightFrame::World,
        colour: [r, g, b].map(narrowed),
    }
}

fn plane(&[x, y, z, distance]: &[f64; 4]) -> ClipPlane {
    ClipPlane {
        normal: DVec3::new(x, y, z),
        distance,
    }
}

#[expect(clippy::cast_possible_truncation, reason = "settings are of f32")]
fn narrowed(x: f64) -> f32 {
    x as f32
}
