//! Converts keyword arguments to the library's options. Unknown arguments are refused by name.

use std::collections::HashMap;

use ewa_splat::io::{
    Dataset, LengthMeaning, OpenOptions, ParticleType, RawLayout, RawType, ReadAs, ScaleMeaning,
    SphKernel, StepChoice,
};
use ewa_splat::render::{Advanced, Blend, Classification, Order};
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, ParticleShape, PeriodicBox, SampleOptions,
    TransferChoice,
};
use ewa_splat::scene::{
    Light, LightFrame, Lighting, ScaleName, SplatRule, TransferDefaults, TransferFunction,
};
use ewa_splat::view::ClipPlane;
use ewa_splat::{Composite, Filter, Settings, Show};
use glam::DVec3;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::exception;

/// Keyword arguments, taken one by one.
pub(crate) struct Keywords<'py>(Option<Bound<'py, PyDict>>);

impl<'py> Keywords<'py> {
    pub(crate) fn new(dict: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        Ok(Self(dict.map(|dict| dict.copy()).transpose()?))
    }

    /// Takes an argument that is given and not None.
    pub(crate) fn take<T>(&self, name: &str) -> PyResult<Option<T>>
    where
        T: for<'a> FromPyObject<'a, 'py>,
    {
        let Some(dict) = &self.0 else {
            return Ok(None);
        };
        let Some(value) = dict.get_item(name)? else {
            return Ok(None);
        };
        dict.del_item(name)?;
        if value.is_none() {
            return Ok(None);
        }
        let value = value.extract::<T>().map_err(|error| {
            let error: PyErr = error.into();
            let text = format!("{name}: {}", error.value(dict.py()));
            match error.is_instance_of::<PyValueError>(dict.py()) {
                true => PyValueError::new_err(text),
                false => PyTypeError::new_err(text),
            }
        });
        value.map(Some)
    }

    /// Takes an argument that names one of several values.
    fn choice<T: Copy>(&self, name: &str, choices: &[(&str, T)]) -> PyResult<Option<T>> {
        let Some(text) = self.take::<String>(name)? else {
            return Ok(None);
        };
        let found = choices.iter().find(|(own, _)| *own == text);
        found.map(|(_, value)| Some(*value)).ok_or_else(|| {
            let names: Vec<&str> = choices.iter().map(|(own, _)| *own).collect();
            let names = names.join(", ");
            PyValueError::new_err(format!("{name}: expected one of {names}, found {text}"))
        })
    }

    /// Takes a number within bounds.
    fn number(
        &self,
        name: &str,
        expected: &str,
        is: impl Fn(f64) -> bool,
    ) -> PyResult<Option<f64>> {
        let number = self.take::<f64>(name)?;
        match number.filter(|x| !is(*x)) {
            None => Ok(number),
            Some(found) => Err(PyValueError::new_err(format!(
                "{name}: expected {expected}, found {found}"
            ))),
        }
    }

    fn positive(&self, name: &str) -> PyResult<Option<f64>> {
        self.number(name, "a number above 0", |x| x > 0.0 && x.is_finite())
    }

    /// Takes two numbers, the lower one first.
    fn range(&self, name: &str) -> PyResult<Option<[f64; 2]>> {
        let range = self.take::<[f64; 2]>(name)?;
        match range.filter(|[a, b]| !(a < b && a.is_finite() && b.is_finite())) {
            None => Ok(range),
            Some([a, b]) => Err(PyValueError::new_err(format!(
                "{name}: expected two finite numbers, the lower one first, found {a}, {b}"
            ))),
        }
    }

    /// Refuses arguments that were not taken.
    pub(crate) fn end(self) -> PyResult<()> {
        let Some(dict) = self.0 else {
            return Ok(());
        };
        match dict.keys().iter().next() {
            None => Ok(()),
            Some(name) => Err(PyTypeError::new_err(format!(
                "{name}: no such keyword argument here"
            ))),
        }
    }
}

/// Keyword arguments about arrays or files.
pub(crate) struct Said {
    pub(crate) options: SampleOptions,
    /// Direction up.
    pub(crate) up: Option<DVec3>,
    /// Unit of the field that is shown.
    pub(crate) unit: Option<String>,
    /// Units of fields by name.
    pub(crate) units: HashMap<String, String>,
    /// Opacity of the boundary that is drawn around a volume.
    pub(crate) around: Option<f64>,
}

impl Said {
    /// Gives the fields of a data set their units.
    pub(crate) fn set_units(&self, dataset: &mut Dataset) {
        for field in &mut dataset.fields {
            if let Some(unit) = self.units.get(&field.name) {
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

/// Returns the sampling options, with the command line's meanings.
pub(crate) fn sample_options(dict: Option<&Bound<'_, PyDict>>) -> PyResult<Said> {
    let said = Keywords::new(dict)?;
    let defaults = SampleOptions::default();
    let count = said.take::<usize>("count")?;
    let (density, spacing) = (said.positive("density")?, said.positive("surfel_spacing")?);
    let spread = match (count, density, spacing) {
        (None, None, None) => Spread::Automatic,
        (Some(count), None, None) => Spread::Count(count),
        (None, Some(density), None) => Spread::Density(density),
        (None, None, Some(distance)) => Spread::Spacing(distance),
        _ => {
            let text = "count, density, surfel_spacing: expected one of them, found several";
            return Err(PyValueError::new_err(text));
        }
    };
    let is_surface = said.take::<bool>("surface")?.unwrap_or(false);
    let is_share = |opacity: f64| opacity > 0.0 && opacity < 1.0;
    let around = said.number("surface_opacity", "a number above 0 and below 1", is_share)?;
    let centre = said.take::<[f64; 3]>("centre")?.map(DVec3::from);
    let periodic = said.take::<[f64; 3]>("box")?.map(|edges| {
        let whole = PeriodicBox::from_origin(edges.into());
        PeriodicBox {
            centre: centre.unwrap_or(whole.centre),
            ..whole
        }
    });
    if centre.is_some() && periodic.is_none() {
        let text = "centre: expected a box beside it, found none";
        return Err(PyValueError::new_err(text));
    }
    let kernel = said.choice(
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
        field: said.take("field")?,
        preferred_field: None,
        kernels: KernelOptions {
            width: said
                .positive("kernel_width")?
                .unwrap_or(defaults.kernels.width),
            length: said.choice(
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
            radius: said.positive("one_radius")?,
            shape: said
                .choice(
                    "shape",
                    &[
                        ("auto", ParticleShape::Automatic),
                        ("isotropic", ParticleShape::Isotropic),
                        ("covariance", ParticleShape::Covariance),
                        ("yu-turk", ParticleShape::YuTurk),
                    ],
                )?
                .unwrap_or_default(),
            shepard_passes: said.take("shepard")?.unwrap_or(0),
            boundary: said
                .choice(
                    "boundary",
                    &[
                        ("auto", BoundaryChoice::Automatic),
                        ("sharp", BoundaryChoice::Sharp),
                        ("soft", BoundaryChoice::Soft),
                    ],
                )?
                .unwrap_or(BoundaryChoice::Automatic),
            spread,
            splat_rule: said.choice(
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
            transfer: transfer(&said)?.unwrap_or(TransferChoice::Automatic),
            unit_distance: said.positive("unit_distance")?,
            range: said.range("range")?,
            scale: said.choice(
                "scale",
                &[
                    ("linear", ScaleName::Linear),
                    ("log", ScaleName::Log),
                    ("symlog", ScaleName::Symlog),
                ],
            )?,
            opacity_scale: said.positive("opacity_scale")?.unwrap_or(1.0),
        },
        periodic,
        flatten: said.number("flatten", "a finite number", f64::is_finite)?,
        surface: (is_surface && around.is_none()).then_some(1.0),
        ..defaults
    };
    let up = said.take::<[f64; 3]>("up")?.map(DVec3::from);
    let up = match up {
        None => None,
        Some(up) => Some(up.try_normalize().ok_or_else(|| {
            PyValueError::new_err("up: expected three numbers that are not all zero")
        })?),
    };
    let unit = said.take("unit")?;
    let units = said.take("units")?.unwrap_or_default();
    said.end()?;
    Ok(Said {
        options,
        up,
        unit,
        units,
        around,
    })
}

/// Takes a transfer function, passed as its kind and its name, path or text.
pub(crate) fn transfer(said: &Keywords<'_>) -> PyResult<Option<TransferChoice>> {
    let given = said.take::<(String, String)>("transfer_function")?;
    Ok(given.map(|(kind, text)| match kind.as_str() {
        "name" => TransferChoice::Named(text),
        "path" => TransferChoice::File(text.into()),
        _ => TransferChoice::Text(text),
    }))
}

/// Parses a transfer function's text, so that its errors are reported when it is made.
#[pyfunction]
pub(crate) fn check_transfer_function(text: &str) -> PyResult<()> {
    let defaults = TransferDefaults {
        range: [0.0, 1.0],
        unit_distance: 1.0,
    };
    let read = TransferFunction::from_json("transfer function".as_ref(), text, &defaults);
    read.map(|_| ()).map_err(|error| exception(&error))
}

/// Returns the options for opening files, the particle types and the time step.
pub(crate) fn open_options(
    dict: Option<&Bound<'_, PyDict>>,
) -> PyResult<(OpenOptions, Vec<ParticleType>, Option<StepChoice>)> {
    let said = Keywords::new(dict)?;
    let dims = said.take::<[usize; 3]>("dims")?;
    let scalar = said.choice(
        "type",
        &[
            ("u8", RawType::U8),
            ("i16", RawType::I16),
            ("u16", RawType::U16),
            ("f32", RawType::F32),
        ],
    )?;
    let (spacing, origin) = (
        said.take::<[f64; 3]>("spacing")?,
        said.take::<[f64; 3]>("origin")?,
    );
    let big_endian = said.take::<bool>("big_endian")?;
    let of_raw = scalar.is_some() || spacing.is_some() || origin.is_some() || big_endian.is_some();
    if of_raw && dims.is_none() {
        let text = "dims: expected the counts of a raw volume's samples beside type, spacing, origin and big_endian";
        return Err(PyValueError::new_err(text));
    }
    let raw = dims.map(|dims| RawLayout {
        dims,
        spacing: spacing.map_or(DVec3::ONE, DVec3::from),
        origin: origin.map_or(DVec3::ZERO, DVec3::from),
        scalar: scalar.unwrap_or(RawType::U8),
        big_endian: big_endian.unwrap_or(false),
    });
    let names = said
        .take::<Vec<String>>("particle_types")?
        .unwrap_or_default();
    let types = names.iter().map(|name| {
        ParticleType::of_name(name).ok_or_else(|| {
            let known = ParticleType::NAMED.map(|t| t.to_string()).join(", ");
            let text = format!("particle_type: expected {known} or a number, found {name}");
            PyValueError::new_err(text)
        })
    });
    let types = types.collect::<PyResult<Vec<_>>>()?;
    let options = OpenOptions {
        raw,
        solution: said.take("solution")?,
        texture: said.take("texture")?,
        read_as: said.choice(
            "read_as",
            &[("points", ReadAs::Points), ("mesh", ReadAs::Mesh)],
        )?,
        scales: said.choice(
            "scales",
            &[
                ("linear", ScaleMeaning::Linear),
                ("log", ScaleMeaning::Logarithms),
            ],
        )?,
        particle_type: None,
        time_step: None,
    };
    let number = said.take::<i64>("time_step")?.map(|number| match number {
        -1 => Ok(StepChoice::Last),
        number => usize::try_from(number).map(StepChoice::Number),
    });
    let number = number.transpose().map_err(|_| {
        PyValueError::new_err("time_step: expected a number from 0, or -1 for the last, found less")
    })?;
    let time = said.take("time")?.map(StepChoice::Time);
    if number.is_some() && time.is_some() {
        let text = "time: expected time_step or time, found both";
        return Err(PyValueError::new_err(text));
    }
    let step = number.or(time);
    said.end()?;
    Ok((options, types, step))
}

/// Settings of a picture, and the options that concern more than its frame.
pub(crate) struct Drawing {
    pub(crate) settings: Settings,
    /// True if the variance of the low-pass filter was given.
    pub(crate) has_low_pass: bool,
    /// True if volumes are lit.
    pub(crate) is_lit: bool,
    pub(crate) transfer: Option<TransferChoice>,
    pub(crate) legend: bool,
    pub(crate) measure_error: bool,
}

/// Returns the settings of a picture.
///
/// # Errors
/// Unknown names; values outside a setting's domain; settings without others that they need.
pub(crate) fn drawing(dict: Option<&Bound<'_, PyDict>>) -> PyResult<Drawing> {
    let said = Keywords::new(dict)?;
    let defaults = Settings::default();
    let tolerance = said.number("tolerance", "a number between 0 and 1", |x| {
        x > 0.0 && x < 1.0
    })?;
    let low_pass = said.number("low_pass", "a number from 0 up", |x| {
        x >= 0.0 && x.is_finite()
    })?;
    let cutoff = said.number("cutoff", "a number above 0 and at most 7", |x| {
        x > 0.0 && x <= 7.0
    })?;
    let thickness = said.positive("slab_thickness")?;
    let composite = said.choice(
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
        return Err(PyValueError::new_err(text));
    }
    let in_slabs = said.take("post_classification")?.unwrap_or(false);
    if in_slabs && !matches!(composite, Composite::Slabs { .. }) {
        let name = composite.name();
        let text = format!("post_classification: expected a composite of slabs, found {name}");
        return Err(PyValueError::new_err(text));
    }
    let classifies_slabs = in_slabs || matches!(composite, Composite::Maximum { .. });
    let classify = said.choice(
        "classify",
        &[
            ("extent", Classification::Extent),
            ("particle", Classification::Particle),
        ],
    )?;
    if classify == Some(Classification::Particle) && classifies_slabs {
        let text = "classify: expected a composite that classifies particles, found one of slabs";
        return Err(PyValueError::new_err(text));
    }
    let lights = said.take::<Vec<[f64; 6]>>("lights")?;
    let lit = said.take::<bool>("lit")?;
    let is_lit = lit == Some(true) || lights.is_some();
    // By default, surfaces are lit. Post-classified slabs would be lit with them, so then there
    // is no light.
    let lighting = lighting(lit, lights.as_deref(), !classifies_slabs)?;
    let planes = said.take::<Vec<[f64; 4]>>("clip")?.unwrap_or_default();
    let drawing = Drawing {
        settings: Settings {
            tolerance: tolerance.map_or(defaults.tolerance, narrowed),
            filter: said
                .choice(
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
                thresholds: said.take("thresholds")?,
                merge_slack: defaults.advanced.merge_slack,
                linear_opacity: said.take("linear_opacity")?.unwrap_or(false),
                simd: defaults.advanced.simd,
                sub_pixel_opacity: said.take("sub_pixel_opacity")?.unwrap_or(false),
                opaque_edges: said
                    .take("opaque_edges")?
                    .unwrap_or(defaults.advanced.opaque_edges),
            },
            level_of_detail: said.take("level_of_detail")?.unwrap_or(true),
            show: said
                .choice(
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
            blend: said
                .choice(
                    "blend",
                    &[
                        ("auto", Blend::Auto),
                        ("encoded", Blend::Encoded),
                        ("linear", Blend::Linear),
                    ],
                )?
                .unwrap_or_default(),
            order: said
                .choice(
                    "order",
                    &[
                        ("auto", Order::Auto),
                        ("distance", Order::Distance),
                        ("depth", Order::Depth),
                    ],
                )?
                .unwrap_or_default(),
            background: said.take("background")?,
            depth: said.take("depth")?.unwrap_or(false),
            normals: said.take("normals")?.unwrap_or(false),
            lighting,
            task: None,
        },
        has_low_pass: low_pass.is_some(),
        is_lit,
        transfer: transfer(&said)?,
        legend: said.take("legend")?.unwrap_or(false),
        measure_error: said.take("measure_error")?.unwrap_or(false),
    };
    said.end()?;
    Ok(drawing)
}

/// Returns the lighting that is asked for.
///
/// - `is_default`: true if there is light unless something else is said.
pub(crate) fn lighting(
    lit: Option<bool>,
    lights: Option<&[[f64; 6]]>,
    is_default: bool,
) -> PyResult<Option<Lighting>> {
    match (lights, lit) {
        (Some(_), Some(false)) => Err(PyValueError::new_err(
            "lit: expected True, or nothing, beside lights, found False",
        )),
        (Some(lights), _) => Ok(Some(Lighting {
            lights: lights.iter().map(light).collect(),
            ..Lighting::default()
        })),
        (None, lit) => Ok(lit.unwrap_or(is_default).then(Lighting::default)),
    }
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
