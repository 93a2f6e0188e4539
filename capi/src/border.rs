//! Exports the functions of the header: checks pointers, copies arrays and catches panics.

#![allow(
    unsafe_code,
    reason = "callers in C pass pointers; their duties are stated in the header"
)]

use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::ptr::{self, null_mut};
use std::sync::Arc;

#[cfg(feature = "mpi")]
use ewa_splat::distributed::MpiRank;
use ewa_splat::io::{Association, write_deep};
use ewa_splat::sample::TransferChoice;
use ewa_splat::session::{Drawable, Session, View, with_workers};
use ewa_splat::view::Lens;
use ewa_splat::{DeepImage, DepthImage, Progress, Task};
use glam::{DMat3, DVec3};

use super::arrays::Numbers;
use super::failure::{Failure, Result, Status, last, note};
use super::scenes::Named;
use super::{cameras, pictures, scenes};

/// Version of the interface: it rises with each change that compiled callers would notice.
const ABI_VERSION: i32 = 1;

/// `ewa_scene`.
pub(crate) struct Scene(Arc<Drawable>);
/// `ewa_transfer`.
pub(crate) struct Transfer(TransferChoice);
/// `ewa_camera`.
pub(crate) struct Camera(View);
/// `ewa_renderer`.
pub(crate) struct Renderer(Session);

/// `ewa_array`.
#[repr(C)]
pub(crate) struct Array {
    name: *const c_char,
    data: *const c_void,
    count: usize,
    stride: usize,
    kind: i32,
}

/// `ewa_points`.
#[repr(C)]
pub(crate) struct Points {
    x: *const c_void,
    y: *const c_void,
    z: *const c_void,
    count: usize,
    stride: usize,
    kind: i32,
}

/// `ewa_buffers`.
#[repr(C)]
pub(crate) struct Buffers {
    rgba: *mut f32,
    rgba_count: usize,
    rgba8: *mut u8,
    rgba8_count: usize,
    depth: *mut f32,
    depth_count: usize,
    normals: *mut f32,
    normals_count: usize,
}

/// `ewa_background`.
#[repr(C)]
pub(crate) struct Background {
    depth: *const f32,
    depth_count: usize,
    rgba: *const f32,
    rgba_count: usize,
}

/// Function that receives progress.
type Observer = extern "C" fn(stage: *const c_char, done: f64, user: *mut c_void);

/// An observer with the caller's pointer.
struct Observed(Observer, *mut c_void);

// SAFETY: the header allows calls of the observer, with its pointer, from any thread and at the same time.
unsafe impl Send for Observed {}
// SAFETY: as above.
unsafe impl Sync for Observed {}

impl Observed {
    fn call(&self, progress: Progress) {
        let stage = CString::new(progress.stage).unwrap_or_default();
        (self.0)(stage.as_ptr(), progress.done, self.1);
    }
}

/// Runs a call. It returns the code of its failure, and notes the text. A panic is a failure, too.
fn guarded(of: impl FnOnce() -> Result<()>) -> i32 {
    let result = catch_unwind(AssertUnwindSafe(of)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
        let text = text.unwrap_or("a panic without a message");
        Err(Failure {
            status: Status::Internal,
            text: format!("internal error: {text}; report it, with what was called"),
        })
    });
    match result {
        Ok(()) => {
            note("");
            Status::Ok as i32
        }
        Err(failure) => {
            note(&failure.text);
            failure.status as i32
        }
    }
}

fn null(name: &str) -> Failure {
    Failure::invalid(format!("{name}: expected a pointer, found NULL"))
}

/// Returns what a pointer points to.
///
/// # Safety
/// The pointer is null, or valid for reads while `'a` lasts.
unsafe fn of<'a, T>(pointer: *const T, name: &str) -> Result<&'a T> {
    // SAFETY: as the caller guarantees.
    unsafe { pointer.as_ref() }.ok_or_else(|| null(name))
}

/// Returns the numbers at a pointer to N of them; `None` for null.
///
/// # Safety
/// The pointer is null, or valid for reads of N numbers.
unsafe fn some<const N: usize, T: Copy>(pointer: *const T) -> Option<[T; N]> {
    // SAFETY: as the caller guarantees; the read needs no alignment.
    (!pointer.is_null()).then(|| unsafe { pointer.cast::<[T; N]>().read_unaligned() })
}

/// Returns the numbers at a pointer to N of them.
///
/// # Safety
/// As [`some`].
unsafe fn all<const N: usize, T: Copy>(pointer: *const T, name: &str) -> Result<[T; N]> {
    // SAFETY: as the caller guarantees.
    unsafe { some(pointer) }.ok_or_else(|| null(name))
}

/// Returns a text; `None` for null.
///
/// # Safety
/// The pointer is null, or points to bytes that end in zero.
unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<Option<&'a str>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: as the caller guarantees.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    let refused = |_| Failure::invalid(format!("{name}: expected UTF-8, found other bytes"));
    bytes.to_str().map(Some).map_err(refused)
}

/// Returns a text that must be there.
///
/// # Safety
/// As [`text`].
unsafe fn words<'a>(pointer: *const c_char, name: &str) -> Result<&'a str> {
    // SAFETY: as the caller guarantees.
    unsafe { text(pointer, name) }?.ok_or_else(|| null(name))
}

/// Copies numbers that lie `stride` bytes apart, or without gaps if it is 0.
///
/// # Safety
/// The pointer is null, or valid for reads of `count` numbers at these places.
unsafe fn copied<T: Copy>(
    data: *const c_void,
    count: usize,
    stride: usize,
    name: &str,
) -> Result<Vec<T>> {
    let size = size_of::<T>();
    let stride = if stride == 0 { size } else { stride };
    if count == 0 {
        return Ok(Vec::new());
    }
    if data.is_null() {
        return Err(null(name));
    }
    let end = (count - 1)
        .checked_mul(stride)
        .and_then(|start| start.checked_add(size));
    let fits = end.is_some_and(|end| isize::try_from(end).is_ok());
    let mut numbers = Vec::new();
    if !fits || numbers.try_reserve_exact(count).is_err() {
        return Err(Failure {
            status: Status::OutOfMemory,
            text: format!("{name}: expected as many numbers as memory holds, found {count}"),
        });
    }
    let first = data.cast::<u8>();
    // SAFETY: each place is within the caller's array, as the caller guarantees; reads need no alignment.
    numbers
        .extend((0..count).map(|i| unsafe { first.add(i * stride).cast::<T>().read_unaligned() }));
    Ok(numbers)
}

/// Copies numbers of a type that the header numbers.
///
/// # Safety
/// As [`copied`].
unsafe fn numbers(
    data: *const c_void,
    (count, stride, kind): (usize, usize, i32),
    name: &str,
) -> Result<Numbers> {
    // SAFETY: as the caller guarantees, for each type.
    unsafe {
        Ok(match kind {
            0 => Numbers::F64(copied(data, count, stride, name)?),
            1 => Numbers::F32(copied(data, count, stride, name)?),
            2 => Numbers::U8(copied(data, count, stride, name)?),
            3 => Numbers::I16(copied(data, count, stride, name)?),
            4 => Numbers::U16(copied(data, count, stride, name)?),
            5 => Numbers::I32(copied(data, count, stride, name)?),
            6 => Numbers::I64(copied(data, count, stride, name)?),
            other => {
                let text = format!("{name}: expected a type from 0 to 6, found {other}");
                return Err(Failure::invalid(text));
            }
        })
    }
}

/// Copies an array.
///
/// # Safety
/// The pointer is null, or points to an array as the header defines it.
unsafe fn array(pointer: *const Array, name: &str) -> Result<Numbers> {
    // SAFETY: as the caller guarantees.
    unsafe {
        let own = of(pointer, name)?;
        numbers(own.data, (own.count, own.stride, own.kind), name)
    }
}

/// Copies an array with its name; without one, it is called "value".
///
/// # Safety
/// As [`array`].
unsafe fn named(pointer: *const Array, name: &str) -> Result<Named> {
    // SAFETY: as the caller guarantees.
    unsafe {
        let own = of(pointer, name)?;
        let called = text(own.name, name)?.unwrap_or("value").to_string();
        let numbers = numbers(own.data, (own.count, own.stride, own.kind), &called)?;
        Ok(Named {
            name: called,
            numbers,
        })
    }
}

/// Copies a field's values.
///
/// # Safety
/// As [`array`].
unsafe fn field(pointer: *const Array, of: i32) -> Result<(Named, Association)> {
    let association = match of {
        0 => Association::Nodes,
        1 => Association::Cells,
        other => {
            let text = format!("of: expected EWA_NODES or EWA_CELLS, found {other}");
            return Err(Failure::invalid(text));
        }
    };
    // SAFETY: as the caller guarantees.
    Ok((unsafe { named(pointer, "values") }?, association))
}

/// Copies positions.
///
/// # Safety
/// The pointer is null, or points to points as the header defines them.
unsafe fn positions(pointer: *const Points) -> Result<Vec<DVec3>> {
    // SAFETY: as the caller guarantees.
    let [x, y, z] = unsafe {
        let own = of(pointer, "points")?;
        let layout = (own.count, own.stride, own.kind);
        [
            numbers(own.x, layout, "x")?.floats("x")?,
            numbers(own.y, layout, "y")?.floats("y")?,
            numbers(own.z, layout, "z")?.floats("z")?,
        ]
    };
    let rows = x.into_iter().zip(y).zip(z);
    Ok(rows.map(|((x, y), z)| DVec3::new(x, y, z)).collect())
}

/// Makes a handle of what `of` returns, and stores it at `out`; null if it fails.
///
/// # Safety
/// `out` is null, or valid for a write.
unsafe fn made<T>(out: *mut *mut T, make: impl FnOnce() -> Result<T>) -> i32 {
    guarded(|| {
        if out.is_null() {
            return Err(null("out"));
        }
        // SAFETY: not null, and valid as the caller guarantees.
        unsafe { out.write(null_mut()) };
        let handle = Box::into_raw(Box::new(make()?));
        // SAFETY: as above.
        unsafe { out.write(handle) };
        Ok(())
    })
}

/// Makes a scene, in a process that may have been forked.
fn scene(make: impl FnOnce() -> Result<Drawable> + Send) -> Result<Scene> {
    Ok(Scene(Arc::new(with_workers(make)?)))
}

/// Frees a handle.
///
/// # Safety
/// The pointer is null, or a handle that [`made`] stored and that was not freed.
unsafe fn freed<T>(handle: *mut T) {
    if !handle.is_null() {
        // A panic in a destructor ends here.
        // SAFETY: as the caller guarantees.
        let _ = catch_unwind(AssertUnwindSafe(|| drop(unsafe { Box::from_raw(handle) })));
    }
}

/// Checks that a buffer has room for so many numbers; a null buffer is not wanted.
fn roomy<T>(buffer: *mut T, count: usize, expected: usize, name: &str) -> Result<bool> {
    if buffer.is_null() && count > 0 {
        return Err(null(name));
    }
    if !buffer.is_null() && count != expected {
        let text = format!("{name}: expected a buffer of {expected} numbers, found {count}");
        return Err(Failure::invalid(text));
    }
    Ok(!buffer.is_null())
}

/// Copies a buffer of floats; `None` for null.
///
/// # Errors
/// Another count than expected.
///
/// # Safety
/// The buffer is null, or valid for reads of as many numbers.
unsafe fn floats(
    buffer: *const f32,
    count: usize,
    expected: usize,
    name: &str,
) -> Result<Option<Vec<f32>>> {
    if !roomy(buffer.cast_mut(), count, expected, name)? {
        return Ok(None);
    }
    // SAFETY: as the caller guarantees; the reads need no alignment.
    let copy = (0..count).map(|i| unsafe { buffer.add(i).read_unaligned() });
    Ok(Some(copy.collect()))
}

/// Copies numbers to a buffer, unless it is null.
///
/// # Safety
/// The buffer is null, or valid for writes of as many numbers.
unsafe fn filled<T: Copy>(buffer: *mut T, numbers: &[T]) {
    if !buffer.is_null() {
        // SAFETY: as the caller guarantees; bytes need no alignment, and the caller's cannot overlap ours.
        unsafe {
            let bytes = size_of_val(numbers);
            ptr::copy_nonoverlapping(numbers.as_ptr().cast::<u8>(), buffer.cast::<u8>(), bytes);
        }
    }
}

/// Returns a picture's size, and its number of pixels times `per_pixel`.
fn counted(width: usize, height: usize, per_pixel: usize) -> usize {
    width.saturating_mul(height).saturating_mul(per_pixel)
}

/// Returns the caller's task, or one that nobody cancels.
///
/// # Safety
/// The pointer is null or a task's handle.
unsafe fn task_of(task: *const Task) -> Task {
    // SAFETY: as the caller guarantees.
    unsafe { task.as_ref() }.cloned().unwrap_or_default()
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn ewa_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => c"",
        };
    VERSION.as_ptr()
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn ewa_abi_version() -> i32 {
    ABI_VERSION
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn ewa_last_error() -> *const c_char {
    last()
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_task_new(
    observer: Option<Observer>,
    user: *mut c_void,
    out: *mut *mut Task,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            Ok(match observer {
                None => Task::new(),
                Some(observer) => {
                    let observed = Observed(observer, user);
                    Task::observed(move |progress| observed.call(progress))
                }
            })
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_task_cancel(task: *const Task) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        unsafe { of(task, "task") }?.cancel();
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_task_free(task: *mut Task) {
    // SAFETY: as the header demands.
    unsafe { freed(task) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_points(
    points: *const Points,
    columns: *const Array,
    column_count: usize,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let places = positions(points)?;
            if columns.is_null() && column_count > 0 {
                return Err(null("columns"));
            }
            let own = (0..column_count).map(|i| named(columns.add(i), "columns"));
            let own = own.collect::<Result<Vec<_>>>()?;
            let options = text(options, "options")?;
            scene(|| scenes::points(places, own, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_grid(
    dims: *const usize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
    values: *const Array,
    association: i32,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let dims = all(dims, "dims")?;
            let origin = some(origin).map_or(DVec3::ZERO, DVec3::from_array);
            let spacing = some(spacing).map_or(DVec3::ONE, DVec3::from_array);
            let direction = some(direction).map_or(DMat3::IDENTITY, |all| {
                DMat3::from_cols_array(&all).transpose()
            });
            let values = field(values, association)?;
            let options = text(options, "options")?;
            scene(|| scenes::grid(dims, origin, spacing, direction, values, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_rectilinear(
    x: *const Array,
    y: *const Array,
    z: *const Array,
    values: *const Array,
    association: i32,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let coordinates = [array(x, "x")?, array(y, "y")?, array(z, "z")?];
            let values = field(values, association)?;
            let options = text(options, "options")?;
            scene(|| scenes::rectilinear(coordinates, values, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_structured(
    dims: *const usize,
    points: *const Points,
    values: *const Array,
    association: i32,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let (dims, nodes) = (all(dims, "dims")?, positions(points)?);
            let values = field(values, association)?;
            let options = text(options, "options")?;
            scene(|| scenes::structured(dims, nodes, values, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_cells(
    points: *const Points,
    types: *const Array,
    offsets: *const Array,
    connectivity: *const Array,
    values: *const Array,
    association: i32,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let nodes = positions(points)?;
            let (kinds, offsets) = (array(types, "types")?, array(offsets, "offsets")?);
            let connectivity = array(connectivity, "connectivity")?;
            let values = field(values, association)?;
            let options = text(options, "options")?;
            scene(|| scenes::cells(nodes, kinds, offsets, connectivity, values, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_mesh(
    points: *const Points,
    triangles: *const Array,
    colours: *const Array,
    values: *const Array,
    association: i32,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let (vertices, triangles) = (positions(points)?, array(triangles, "triangles")?);
            let colours = match colours.is_null() {
                true => None,
                false => Some(array(colours, "colours")?),
            };
            let values = match values.is_null() {
                true => None,
                false => Some(field(values, association)?),
            };
            let options = text(options, "options")?;
            scene(|| scenes::mesh(vertices, triangles, colours, values, options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_file(
    path: *const c_char,
    options: *const c_char,
    out: *mut *mut Scene,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let (path, options) = (words(path, "path")?, text(options, "options")?);
            scene(|| scenes::file(Path::new(path), options))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_bounds(
    scene: *const Scene,
    low: *mut f64,
    high: *mut f64,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let scene = unsafe { of(scene, "scene") }?;
        if low.is_null() || high.is_null() {
            return Err(null("low, high"));
        }
        let ends = with_workers(|| scene.0.bounds());
        let (least, greatest) = ends
            .ok_or_else(|| Failure::invalid("scene: expected data with positions, found none"))?;
        // SAFETY: both have room for three numbers, as the header demands.
        unsafe {
            filled(low, &least.to_array());
            filled(high, &greatest.to_array());
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_scene_free(scene: *mut Scene) {
    // SAFETY: as the header demands.
    unsafe { freed(scene) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_transfer_json(
    json: *const c_char,
    out: *mut *mut Transfer,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let json = words(json, "json")?;
            Ok(Transfer(scenes::transfer(json)?))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_transfer_colour_map(
    name: *const c_char,
    low: f64,
    high: f64,
    unit_distance: f64,
    out: *mut *mut Transfer,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let name = words(name, "name")?;
            let map = scenes::colour_map(name, [low, high], unit_distance)?;
            Ok(Transfer(map))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_transfer_free(transfer: *mut Transfer) {
    // SAFETY: as the header demands.
    unsafe { freed(transfer) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_fitted(
    azimuth_deg: f64,
    elevation_deg: f64,
    zoom: f64,
    orthographic: i32,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let view = cameras::fitted(azimuth_deg, elevation_deg, zoom, orthographic != 0);
            Ok(Camera(view))
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_perspective(
    eye: *const f64,
    target: *const f64,
    up: *const f64,
    fov_deg: f64,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe { looking(eye, target, up, Lens::FovDeg(fov_deg), out) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_orthographic(
    eye: *const f64,
    target: *const f64,
    up: *const f64,
    height: f64,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe { looking(eye, target, up, Lens::OrthoHeight(Some(height)), out) }
}

/// Makes a camera that looks at a target.
///
/// # Safety
/// As the header demands of the two above.
unsafe fn looking(
    eye: *const f64,
    target: *const f64,
    up: *const f64,
    lens: Lens,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the caller guarantees.
    unsafe {
        made(out, || {
            let eye = all(eye, "eye").map(DVec3::from_array)?;
            let target = all(target, "target").map(DVec3::from_array)?;
            let up = some(up).map(DVec3::from_array);
            cameras::look_at(eye, target, up, lens).map(Camera)
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_along(
    axis: *const c_char,
    centre: *const f64,
    width: f64,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let axis = words(axis, "axis")?;
            let centre = some(centre).map(DVec3::from_array);
            cameras::along(axis, centre, width).map(Camera)
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_calibrated(
    eye: *const f64,
    rotation: *const f64,
    focal_px: *const f64,
    centre_px: *const f64,
    width: usize,
    height: usize,
    orthographic: i32,
    out: *mut *mut Camera,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let eye = all(eye, "eye").map(DVec3::from_array)?;
            let rotation = all(rotation, "rotation")?;
            let (focal_px, centre_px) = (all(focal_px, "focal_px")?, some(centre_px));
            let (size, flat) = ([width, height], orthographic != 0);
            cameras::calibrated(eye, rotation, focal_px, centre_px, size, flat).map(Camera)
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_camera_free(camera: *mut Camera) {
    // SAFETY: as the header demands.
    unsafe { freed(camera) }
}

/// Returns the scenes of an array of handles.
///
/// # Safety
/// The pointer is null, or valid for reads of as many handles.
unsafe fn handles(scenes: *const *const Scene, count: usize) -> Result<Vec<Arc<Drawable>>> {
    if scenes.is_null() && count > 0 {
        return Err(null("scenes"));
    }
    // SAFETY: as the caller guarantees; reads need no alignment.
    let own = (0..count).map(|i| unsafe {
        let scene = of(scenes.add(i).read_unaligned(), "scenes")?;
        Ok(Arc::clone(&scene.0))
    });
    own.collect()
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_new(
    scenes: *const *const Scene,
    scene_count: usize,
    options: *const c_char,
    out: *mut *mut Renderer,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let own = handles(scenes, scene_count)?;
            let options = text(options, "options")?;
            pictures::renderer(own, options).map(Renderer)
        })
    }
}

#[cfg_attr(
    not(feature = "mpi"),
    expect(unused_variables, reason = "only MPI has communicators")
)]
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_new_mpi(
    scenes: *const *const Scene,
    scene_count: usize,
    communicator: i32,
    options: *const c_char,
    out: *mut *mut Renderer,
) -> i32 {
    if !out.is_null() {
        // SAFETY: not null, and valid as the header demands.
        unsafe { out.write(null_mut()) };
    }
    #[cfg(not(feature = "mpi"))]
    return guarded(|| {
        Err(Failure {
            status: Status::Unsupported,
            text: "ewa_renderer_new_mpi: expected a library with MPI, found one without; build it with --features mpi".into(),
        })
    });
    // Null pointers and bad options are errors of this rank, of which the others are told.
    #[cfg(feature = "mpi")]
    guarded(|| {
        // SAFETY: as the header demands.
        let ranks = unsafe { MpiRank::of_fortran(communicator) }?;
        let own = || {
            if out.is_null() {
                return Err(null("out"));
            }
            // SAFETY: as the header demands.
            unsafe { Ok((handles(scenes, scene_count)?, text(options, "options")?)) }
        };
        let own = own();
        let session = with_workers(|| pictures::shared(own, ranks))?;
        let handle = Box::into_raw(Box::new(Renderer(session)));
        // SAFETY: not null, and valid as the header demands.
        unsafe { out.write(handle) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_free(renderer: *mut Renderer) {
    // SAFETY: as the header demands.
    unsafe { freed(renderer) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_set_values(
    renderer: *const Renderer,
    scene: usize,
    values: *const Array,
    task: *const Task,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let (renderer, values, task) = unsafe {
            (
                of(renderer, "renderer")?,
                array(values, "values"),
                task_of(task),
            )
        };
        let values = values.and_then(|values| values.values("values"));
        let values = renderer.0.agreed("ewa_renderer_set_values", values)?;
        with_workers(|| renderer.0.set_values(scene, values, &task))?;
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_set_transfer(
    renderer: *const Renderer,
    transfer: *const Transfer,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let (renderer, transfer) = unsafe { (of(renderer, "renderer")?, transfer.as_ref()) };
        let choice = transfer.map(|transfer| transfer.0.clone());
        with_workers(|| renderer.0.set_transfer(choice, &Task::new()))?;
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_renderer_adapter(
    renderer: *const Renderer,
    buffer: *mut c_char,
    capacity: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let renderer = unsafe { of(renderer, "renderer") }?;
        if buffer.is_null() {
            return Err(null("buffer"));
        }
        let adapter = renderer.0.adapter(&Task::new())?.unwrap_or_default();
        let name = CString::new(adapter.replace('\0', "")).unwrap_or_default();
        let bytes = name.as_bytes_with_nul();
        if bytes.len() > capacity {
            let expected = bytes.len();
            let text = format!("buffer: expected {expected} bytes, found {capacity}");
            return Err(Failure::invalid(text));
        }
        // SAFETY: the buffer has room for as many bytes.
        unsafe { filled(buffer.cast::<u8>(), bytes) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_render(
    renderer: *const Renderer,
    camera: *const Camera,
    settings: *const c_char,
    width: usize,
    height: usize,
    task: *const Task,
    buffers: *const Buffers,
) -> i32 {
    let none = std::ptr::null();
    // SAFETY: as the header demands; without a background.
    unsafe {
        ewa_render_over(
            renderer, camera, settings, width, height, none, task, buffers,
        )
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_render_over(
    renderer: *const Renderer,
    camera: *const Camera,
    settings: *const c_char,
    width: usize,
    height: usize,
    background: *const Background,
    task: *const Task,
    buffers: *const Buffers,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let session = unsafe { &of(renderer, "renderer")?.0 };
        let is_first = session.is_first();
        let size = [width, height];
        let given = || -> Result<_> {
            // SAFETY: as the header demands.
            let (camera, settings, own, background) = unsafe {
                (
                    camera.as_ref(),
                    text(settings, "settings")?,
                    // Only the first of several ranks has buffers and a background.
                    is_first.then(|| of(buffers, "buffers")).transpose()?,
                    background.as_ref().filter(|_| is_first),
                )
            };
            // SAFETY: as the header demands.
            let behind = background.map(|own| unsafe { behind(own, size) });
            let wanted = own.map_or(Ok([false; 4]), |own| wanted(own, size))?;
            Ok((camera, settings, own, behind.transpose()?, wanted))
        };
        let (camera, settings, own, behind, wanted) = session.agreed("ewa_render", given())?;
        let [_, is_encoded, with_depth, with_normals] = session.of_first(wanted)?;
        // SAFETY: as the header demands.
        let task = unsafe { task_of(task) };
        let (drawn, bytes) = with_workers(|| {
            let view = camera.map(|camera| &camera.0);
            let drawn = pictures::render(
                session,
                view,
                size,
                settings,
                behind.unwrap_or_default(),
                [with_depth, with_normals],
                &task,
            )?;
            let bytes = (is_encoded && is_first).then(|| drawn.image.to_srgb8());
            Ok::<_, Failure>((drawn, bytes.unwrap_or_default()))
        })?;
        let Some(own) = own else {
            return Ok(());
        };
        let missing = |name: &str| {
            Failure::invalid(format!(
                "{name}: expected a picture that has them, found another"
            ))
        };
        let depth = match with_depth {
            true => drawn.depth.ok_or_else(|| missing("depth"))?,
            false => Vec::new(),
        };
        let normals = match with_normals {
            true => drawn.normals.ok_or_else(|| missing("normals"))?,
            false => Vec::new(),
        };
        // SAFETY: each buffer that is not null has room for exactly as many numbers: a picture has `width` times
        // `height` pixels.
        unsafe {
            filled(own.rgba, drawn.image.pixels.as_flattened());
            filled(own.rgba8, &bytes);
            filled(own.depth, &depth);
            filled(own.normals, normals.as_flattened());
        }
        Ok(())
    })
}

/// Copies the depths and the colours of a background.
///
/// # Safety
/// As the header demands of backgrounds.
unsafe fn behind(own: &Background, [width, height]: [usize; 2]) -> Result<[Option<Vec<f32>>; 2]> {
    let pixels = |per_pixel| counted(width, height, per_pixel);
    let (depth, rgba) = ("depth of the background", "rgba of the background");
    // SAFETY: as the caller guarantees.
    unsafe {
        Ok([
            floats(own.depth, own.depth_count, pixels(1), depth)?,
            floats(own.rgba, own.rgba_count, pixels(4), rgba)?,
        ])
    }
}

/// Returns which buffers the caller gives, each with room for a picture: colours, codes, depths, normals.
fn wanted(own: &Buffers, [width, height]: [usize; 2]) -> Result<[bool; 4]> {
    let room = |per_pixel| counted(width, height, per_pixel);
    let is_wanted = [
        roomy(own.rgba, own.rgba_count, room(4), "rgba")?,
        roomy(own.rgba8, own.rgba8_count, room(4), "rgba8")?,
        roomy(own.depth, own.depth_count, room(1), "depth")?,
        roomy(own.normals, own.normals_count, room(3), "normals")?,
    ];
    match is_wanted.contains(&true) {
        true => Ok(is_wanted),
        false => Err(Failure::invalid(
            "buffers: expected one or more, found none",
        )),
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_render_deep(
    renderer: *const Renderer,
    camera: *const Camera,
    settings: *const c_char,
    width: usize,
    height: usize,
    task: *const Task,
    out: *mut *mut DeepImage,
) -> i32 {
    // SAFETY: as the header demands.
    unsafe {
        made(out, || {
            let (renderer, camera) = (of(renderer, "renderer")?, camera.as_ref());
            let (settings, task) = (text(settings, "settings")?, task_of(task));
            with_workers(|| {
                let view = camera.map(|camera| &camera.0);
                pictures::deep(&renderer.0, view, [width, height], settings, &task)
            })
        })
    }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_free(deep: *mut DeepImage) {
    // SAFETY: as the header demands.
    unsafe { freed(deep) }
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_count(deep: *const DeepImage, count: *mut usize) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let deep = unsafe { of(deep, "deep") }?;
        if count.is_null() {
            return Err(null("count"));
        }
        // SAFETY: not null, and valid as the header demands.
        unsafe { filled(count, &[deep.samples.len()]) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_samples(
    deep: *const DeepImage,
    counts: *mut usize,
    front: *mut f32,
    back: *mut f32,
    rgba: *mut f32,
    count: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let deep = unsafe { of(deep, "deep") }?;
        if count != deep.samples.len() {
            let expected = deep.samples.len();
            let text = format!("count: expected {expected}, that of ewa_deep_count, found {count}");
            return Err(Failure::invalid(text));
        }
        let samples = &deep.samples;
        let own_counts: Vec<usize> = deep.firsts.windows(2).map(|p| p[1] - p[0]).collect();
        let fronts: Vec<f32> = samples.iter().map(|sample| sample.front).collect();
        let backs: Vec<f32> = samples.iter().map(|sample| sample.back).collect();
        let colours: Vec<f32> = samples.iter().flat_map(|sample| sample.rgba).collect();
        // SAFETY: each buffer that is not null has room for as many numbers, as the header demands.
        unsafe {
            filled(counts, &own_counts);
            filled(front, &fronts);
            filled(back, &backs);
            filled(rgba, &colours);
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_before(
    deep: *const DeepImage,
    depth: *const f32,
    rgba: *mut f32,
    pixel_count: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let deep = unsafe { of(deep, "deep") }?;
        let [width, height] = [deep.width, deep.height];
        pixels_of(deep, rgba, pixel_count, "rgba")?;
        let count = if depth.is_null() { 0 } else { pixel_count };
        // SAFETY: as the header demands.
        let depths = unsafe { floats(depth, count, width * height, "depth") }?;
        let image = match depths {
            None => deep.flat(),
            Some(depths) => {
                let depth = DepthImage {
                    width,
                    height,
                    depths,
                };
                let image = deep.before(&depth);
                image.ok_or_else(|| Failure::invalid("depth: expected a number for each pixel"))?
            }
        };
        // SAFETY: the buffer has room for four numbers for each pixel.
        unsafe { filled(rgba, image.pixels.as_flattened()) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_transmittance(
    deep: *const DeepImage,
    depth: f32,
    values: *mut f32,
    pixel_count: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let deep = unsafe { of(deep, "deep") }?;
        pixels_of(deep, values, pixel_count, "values")?;
        // SAFETY: the buffer has room for a number for each pixel.
        unsafe { filled(values, &deep.transmittance(depth)) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_depth(
    deep: *const DeepImage,
    kind: *const c_char,
    values: *mut f32,
    pixel_count: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let (deep, kind) = unsafe { (of(deep, "deep")?, words(kind, "kind")?) };
        pixels_of(deep, values, pixel_count, "values")?;
        let depths = pictures::depths(deep, kind)?;
        // SAFETY: the buffer has room for a number for each pixel.
        unsafe { filled(values, &depths) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_deep_write(deep: *const DeepImage, path: *const c_char) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let (deep, path) = unsafe { (of(deep, "deep")?, words(path, "path")?) };
        with_workers(|| write_deep(Path::new(path), deep))?;
        Ok(())
    })
}

/// Checks that a caller gives a buffer and the number of pixels of a deep image.
fn pixels_of<T>(deep: &DeepImage, buffer: *mut T, count: usize, name: &str) -> Result<()> {
    if buffer.is_null() {
        return Err(null(name));
    }
    let expected = deep.width * deep.height;
    if count != expected {
        let text = format!("pixel_count: expected {expected}, found {count}");
        return Err(Failure::invalid(text));
    }
    Ok(())
}

#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ewa_columns(
    renderer: *const Renderer,
    camera: *const Camera,
    settings: *const c_char,
    width: usize,
    height: usize,
    task: *const Task,
    kind: i32,
    values: *mut c_void,
    count: usize,
    pixel_area: *mut f64,
) -> i32 {
    guarded(|| {
        // SAFETY: as the header demands.
        let session = unsafe { &of(renderer, "renderer")?.0 };
        let is_first = session.is_first();
        let given = || -> Result<_> {
            // SAFETY: as the header demands.
            let (camera, settings) = unsafe { (camera.as_ref(), text(settings, "settings")?) };
            // Only the first of several ranks has a buffer.
            if is_first && !roomy(values, count, counted(width, height, 1), "values")? {
                return Err(null("values"));
            }
            if ![0, 1].contains(&kind) {
                let text = format!("type: expected EWA_F32 or EWA_F64, found {kind}");
                return Err(Failure::invalid(text));
            }
            Ok((camera, settings))
        };
        let (camera, settings) = session.agreed("ewa_columns", given())?;
        // SAFETY: as the header demands.
        let task = unsafe { task_of(task) };
        let drawn = with_workers(|| {
            let view = camera.map(|camera| &camera.0);
            pictures::columns(session, view, [width, height], settings, &task)
        })?;
        if !is_first {
            return Ok(());
        }
        // SAFETY: the buffer has room for as many numbers of this type, and the area for one.
        unsafe {
            let column = &drawn.column;
            if kind == 1 {
                filled(values.cast::<f32>(), &column.values);
            } else {
                let wide: Vec<f64> = column.values.iter().copied().map(f64::from).collect();
                filled(values.cast::<f64>(), &wide);
            }
            filled(pixel_area, &[column.pixel_area.unwrap_or(f64::NAN)]);
        }
        Ok(())
    })
}
