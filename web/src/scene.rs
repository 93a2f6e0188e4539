//! Data in memory, and the pictures of them.

use std::path::Path;
use std::sync::Arc;

use ewa_splat::io::{Ranges, column_colours, column_picture};
use ewa_splat::legend::{ColourBar, name_without_unit};
use ewa_splat::measure::ErrorSample;
use ewa_splat::render::Gpu;
use ewa_splat::scene::{ScaleName, TransferFunction};
use ewa_splat::session::{
    Arguments, ColumnRequest, Data, Drawable, DrawnColumn, PictureRequest, Ready, Refused, Said,
    Session, check_size, choice, drawing, opening, range, sampling,
};
use ewa_splat::view::Camera;
use ewa_splat::{Backend, Image, Settings, Task};
use serde::Deserialize;
use serde_json::{Value, json};
use wasm_bindgen::prelude::*;

use crate::camera::{GivenView, described};
use crate::column::Column;
use crate::file::Given;
use crate::picture::Picture;
use crate::{Device, legend, signal, thrown};

/// Data in memory with the scene made of them.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Scene {
    /// The data as they were opened.
    opened: Drawable,
    session: Session,
    /// Sampling options of the session, as text.
    sampling: String,
    /// Kind of the scene that was made last: nothing of it is sampled again. Empty if it is not known.
    made: String,
    device: Option<Gpu>,
    /// True if the session draws on the device.
    is_on_device: bool,
    last: Option<Last>,
}

/// The last picture, for what is asked of it afterwards.
#[derive(Debug)]
struct Last {
    camera: Camera,
    settings: Settings,
    image: Image,
    field: Option<String>,
    function: Option<TransferFunction>,
}

/// Picture that the page asks for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    size: [usize; 2],
    #[serde(default)]
    view: GivenView,
    /// Options that turn samples into kernels.
    #[serde(default)]
    sampling: Value,
    /// Settings of the picture, or of the columns.
    #[serde(default)]
    drawing: Value,
}

/// Returns the text of settings; empty for none.
fn text_of(settings: &Value) -> String {
    match settings {
        Value::Null => String::new(),
        settings => settings.to_string(),
    }
}

impl Request {
    fn parse(text: &str) -> Result<Self, JsError> {
        let request: Self = serde_json::from_str(text).map_err(thrown)?;
        check_size(request.size).map_err(thrown)?;
        Ok(request)
    }
}

#[wasm_bindgen]
impl Scene {
    /// Opens a file.
    ///
    /// - `name`: its name, perhaps with folders. Errors contain it.
    /// - `file`: its bytes; or an object with its `size`, and `read(from, length)`, which returns bytes. Such a file is read
    ///   in ranges, and is not held whole where its format allows it.
    /// - `settings`: options for opening and sampling, as JSON, with the command line's names.
    /// - `beside`: returns another file by its path, in the same form, or undefined.
    ///
    /// # Errors
    /// Unreadable files, with the command line's words; settings that do not apply.
    pub fn open(
        name: &str,
        #[wasm_bindgen(
            unchecked_param_type = "Uint8Array | { size: number, read: (from: number, length: number) => Uint8Array }"
        )]
        file: JsValue,
        settings: &str,
        beside: &js_sys::Function,
    ) -> Result<Scene, JsError> {
        let (how, own) = Said::all(Some(settings), |said| Ok((opening(said)?, sampling(said)?)))
            .map_err(thrown)?;
        let beside = |path: &Path| {
            let path = JsValue::from_str(&path.to_string_lossy());
            let found = beside.call1(&JsValue::NULL, &path).ok()?;
            Given::of(found).map(|file| Box::new(file) as Box<dyn Ranges>)
        };
        let expected = "file: expected bytes, or an object with size and read, found another value";
        let file = Given::of(file).ok_or_else(|| thrown(expected))?;
        let opened = Drawable::open_with(name, &file, &beside, &how, &own).map_err(thrown)?;
        let session = Session::new(
            vec![Arc::new(opened.sampled_by(&own).map_err(thrown)?)],
            Backend::Cpu,
            false,
        );
        Ok(Self {
            opened,
            session,
            sampling: String::new(),
            made: String::new(),
            device: None,
            is_on_device: false,
            last: None,
        })
    }

    /// Draws pictures on a device of WebGPU from now on.
    ///
    /// # Errors
    /// A call within another.
    pub fn on(&mut self, device: &Device) -> Result<(), JsError> {
        self.device = Some(device.gpu.clone());
        self.place(true, true)
    }

    /// Forgets the scene, which the next picture makes for its own size: surfaces get as many surfels as it shows.
    ///
    /// # Errors
    /// A call within another.
    pub fn renew(&mut self) -> Result<(), JsError> {
        let is_on_device = self.is_on_device;
        self.place(is_on_device, true)
    }

    /// Facts about the data, as JSON: `fields`, `notes`, `bounds`, `up`.
    #[wasm_bindgen(getter)]
    pub fn about(&self) -> String {
        let bounds = self.opened.bounds();
        let bounds = bounds.map(|(low, high)| [low.to_array(), high.to_array()]);
        let up = self.opened.ups().next().map(|up| up.direction.to_array());
        json!({
            "fields": self.opened.fields(),
            "notes": self.opened.notes(),
            "bounds": bounds,
            "up": up,
        })
        .to_string()
    }

    /// Draws a picture.
    ///
    /// - `request`: JSON with `size`, `view`, `sampling` and `drawing`; the names of the last two are the command line's.
    /// - `cancelled`: returns true if the work is to end, and is asked some sixty times a second; its argument is false
    ///   while data are sampled, and true while the picture is drawn.
    ///
    /// # Errors
    /// Data that cannot be sampled; settings that do not apply; cancelled work.
    pub async fn render(
        &mut self,
        request: String,
        cancelled: Option<js_sys::Function>,
    ) -> Result<Picture, JsError> {
        let request = Request::parse(&request)?;
        self.sample_by(&text_of(&request.sampling))?;
        let is_on_device = self.device.is_some();
        self.place(is_on_device, false)?;
        let drawing = Said::all(Some(&text_of(&request.drawing)), drawing).map_err(thrown)?;
        let view = request.view.view().map_err(thrown)?;
        let request = PictureRequest {
            view: Some(&view),
            size: request.size,
            drawing: &drawing,
        };
        let cancelled = cancelled.as_ref();
        let task = signal::task(cancelled, false);
        // A session keeps its function until it is told of another: none is told as well.
        self.session
            .set_transfer(drawing.transfer.clone(), &task)
            .map_err(thrown)?;
        let further = |ready: &mut Ready, image: &Image, camera: &Camera, settings: Settings| {
            let about = about_picture(ready, camera);
            let (image, camera) = (image.clone(), camera.clone());
            let (field, function) = (ready.title.0.clone(), first(&ready.functions));
            let last = Last {
                camera,
                settings,
                image,
                field,
                function,
            };
            Ok((about, last))
        };
        self.last = None;
        let made = format!("picture {}", self.sampling);
        if made != self.made {
            self.made.clear();
            self.session.ready(request, &task).map_err(thrown)?;
            self.made = made;
        }
        let task = signal::task(cancelled, true);
        let drawn = self.session.render_async(request, &task, further).await;
        let (drawn, (about, last)) = drawn.map_err(thrown)?;
        self.last = Some(last);
        Ok(Picture {
            image: drawn.image,
            depths: drawn.depth,
            about: about.to_string(),
        })
    }

    /// Measures the error of the last picture by tiles that are drawn again with everything exact. Returns JSON, or
    /// undefined if a device drew it or there is none.
    ///
    /// - `cancelled`: as for pictures.
    ///
    /// # Errors
    /// Settings that cannot be drawn exactly; cancelled work.
    pub fn measure(
        &mut self,
        cancelled: Option<js_sys::Function>,
    ) -> Result<Option<String>, JsError> {
        let Some(last) = self.last.as_ref().filter(|_| !self.is_on_device) else {
            return Ok(None);
        };
        let task = signal::task(cancelled.as_ref(), true);
        let mut state = self.session.lock(&task).map_err(thrown)?;
        let ready = state.opened(&last.camera).map_err(thrown)?;
        let thickness = ready.renderer.layers().map(|layers| layers.thickness);
        let composite = match thickness {
            Some(_) => last.settings.composite.with_thickness(thickness),
            None => last.settings.composite,
        };
        let settings = Settings {
            composite,
            task: Some(task.clone()),
            ..last.settings.clone()
        };
        let sample =
            ErrorSample::draw(&mut ready.renderer, &last.camera, &settings).map_err(thrown)?;
        Ok(Some(json!(sample.error_of(&last.image)).to_string()))
    }

    /// Transfer function of the last picture, in the form of its files; undefined without one.
    pub fn function(&self) -> Option<String> {
        let function = self.last.as_ref()?.function.as_ref()?;
        Some(function.to_json())
    }

    /// Counts the values of the field of the last picture over the range of its transfer function.
    ///
    /// - `bins`: number of intervals, evenly on the function's scale.
    ///
    /// # Errors
    /// A field that cannot be derived.
    pub fn histogram(&self, bins: usize) -> Result<Vec<u32>, JsError> {
        let mut counts = vec![0; bins];
        let Some(last) = &self.last else {
            return Ok(counts);
        };
        let (Some(field), Some(function)) = (&last.field, &last.function) else {
            return Ok(counts);
        };
        let ([low, high], scale) = (function.range(), function.value_scale());
        for source in &self.opened.sources {
            let Data::Set(set) = &source.data else {
                continue;
            };
            let Ok((_, values)) = set.scalar(field) else {
                continue;
            };
            for i in 0..values.len() {
                let share = (scale.position(values.wide(i)) - low) / (high - low);
                if (0.0..=1.0).contains(&share) {
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a share of a count"
                    )]
                    let bin = (f64::from(share) * bins as f64) as usize;
                    counts[bin.min(bins - 1)] += 1;
                }
            }
        }
        Ok(counts)
    }

    /// Draws a column density on the processor.
    ///
    /// - `request`: as for pictures; `drawing` may have `of`, `mean`, `slice`, `clip`, `tolerance`, `filter`, `low_pass`
    ///   and `cutoff`, and `map`, `range` and `scale` of the colours.
    /// - `cancelled`: as for pictures.
    ///
    /// # Errors
    /// Data that cannot be sampled or summed; settings that do not apply; cancelled work.
    pub fn columns(
        &mut self,
        request: &str,
        cancelled: Option<js_sys::Function>,
    ) -> Result<Column, JsError> {
        let request = Request::parse(request)?;
        self.sample_by(&text_of(&request.sampling))?;
        self.place(false, false)?;
        self.last = None;
        let given = Said::all(Some(&text_of(&request.drawing)), Columns::of).map_err(thrown)?;
        let view = request.view.view().map_err(thrown)?;
        // Columns are seen along z, unless something else is said.
        let own = ColumnRequest {
            view: Some(&view).filter(|_| request.view.is_given()),
            size: request.size,
            drawing: &given.drawing,
            of: given.of.as_deref(),
            mean: given.mean.as_deref(),
            slice: given.slice,
        };
        let made = format!("columns {:?} {:?} {}", given.of, given.mean, self.sampling);
        let task = signal::task(cancelled.as_ref(), made == self.made);
        self.made.clear();
        let drawn = self.session.columns(own, &task).map_err(thrown)?;
        self.made = made;
        given.coloured(drawn)
    }
}

impl Scene {
    /// Samples the data by other options, if they differ from the last.
    fn sample_by(&mut self, text: &str) -> Result<(), JsError> {
        if text == self.sampling {
            return Ok(());
        }
        let own = Said::all(Some(text), sampling).map_err(thrown)?;
        let things = vec![Arc::new(self.opened.sampled_by(&own).map_err(thrown)?)];
        self.session = Session::new(things, Backend::Cpu, false);
        self.sampling = text.into();
        let is_on_device = self.is_on_device;
        self.place(is_on_device, true)
    }

    /// Draws on the device or on the processor.
    ///
    /// - `is_new`: true if the session does not know where it draws.
    fn place(&mut self, is_on_device: bool, is_new: bool) -> Result<(), JsError> {
        if is_new || is_on_device != self.is_on_device {
            let device = self.device.clone().filter(|_| is_on_device);
            let mut state = self.session.lock(&Task::new()).map_err(thrown)?;
            state.set_device(device);
            self.is_on_device = is_on_device;
        }
        Ok(())
    }
}

/// Settings of columns.
struct Columns {
    of: Option<String>,
    mean: Option<String>,
    slice: Option<f64>,
    map: Option<String>,
    range: Option<[f64; 2]>,
    scale: Option<ScaleName>,
    drawing: ewa_splat::session::Drawing,
}

impl Columns {
    fn of(said: &mut Said) -> Result<Self, Refused> {
        said.only(&[
            "clip",
            "cutoff",
            "filter",
            "low_pass",
            "mean",
            "of",
            "slice",
            "tolerance",
            "map",
            "range",
            "scale",
        ])?;
        let scales = [
            ("linear", ScaleName::Linear),
            ("log", ScaleName::Log),
            ("symlog", ScaleName::Symlog),
        ];
        Ok(Self {
            of: said.text("of")?,
            mean: said.text("mean")?,
            slice: said.float("slice")?,
            map: said.text("map")?,
            range: range(said, "range")?,
            scale: choice(said, "scale", &scales)?,
            drawing: drawing(said)?,
        })
    }

    /// Colours a column density, as the program does.
    fn coloured(&self, drawn: DrawnColumn) -> Result<Column, JsError> {
        let DrawnColumn {
            column,
            camera,
            amplitudes,
            title: (field, unit),
        } = drawn;
        #[expect(clippy::cast_possible_truncation, reason = "ranges are of f32")]
        let range = self.range.map(|range| range.map(|x| x as f32));
        let colours = column_colours(&column, self.map.as_deref(), range, self.scale);
        let colours = colours.map_err(thrown)?;
        let title = match (&self.mean, &field) {
            (Some(mean), _) => format!("mean {mean}"),
            (None, Some(field)) => format!("column of {}", name_without_unit(field)),
            (None, None) => "column density".into(),
        };
        let (image, bars) = match &colours {
            Some(colours) => {
                let bar = ColourBar::of_column(&title, colours);
                (
                    column_picture(&column, colours),
                    vec![legend::described(&bar)],
                )
            }
            None => (Image::new(column.width, column.height), Vec::new()),
        };
        let about = json!({
            "camera": described(&camera),
            "bars": bars,
            "sum": amplitudes.sum,
            "field": field,
            "unit": unit,
            "pixel_area": column.pixel_area,
        });
        Ok(Column {
            column,
            image,
            about: about.to_string(),
        })
    }
}

fn first(functions: &[Option<TransferFunction>]) -> Option<TransferFunction> {
    functions.iter().flatten().next().cloned()
}

/// Describes a picture that was drawn.
fn about_picture(ready: &Ready, camera: &Camera) -> Value {
    let renderer = &ready.renderer;
    let boxes = renderer.fitted_boxes();
    let corners = boxes
        .iter()
        .map(|(centre, half)| (*centre - *half, *centre + *half));
    let bounds = corners.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let bars: Vec<Value> = ready.bars.iter().map(legend::described).collect();
    json!({
        "camera": described(camera),
        "bars": bars,
        "visible": bounds.map(|(low, high)| [low.to_array(), high.to_array()]),
        "particles": renderer.particle_count(),
        "footprints": renderer.counts().footprints,
        "frame_ms": renderer.times().frame,
        "read_ms": ready.read_ms,
        "prepare_ms": ready.prepare_ms,
        "field": ready.title.0,
        "unit": ready.title.1,
        "adapter": renderer.adapter(),
        "fallback": renderer.fallback(),
    })
}
