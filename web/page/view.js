// Cameras: an eye, a target, what is up, and a field of view or a height.

export const add = (a, b, f = 1) => a.map((x, i) => x + f * b[i]);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const length = (a) => Math.hypot(...a);
const unit = (a) => a.map((x) => x / length(a));

/** A vector turned about an axis by radians (Rodrigues). */
function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(v.map((x) => x * c), cross(axis, v), s), axis, dot(axis, v) * (1 - c));
}

/** The camera of a picture, as one that looks at a point amid what is visible. */
export function of(camera, visible, up) {
  const [, down, forward] = camera.camera_from_world;
  const [low, high] = visible ?? [[-1, -1, -1], [1, 1, 1]];
  const middle = low.map((x, i) => (x + high[i]) / 2);
  const size = length(add(high, low, -1));
  const distance = Math.max(dot(add(middle, camera.eye, -1), forward), size * 1e-3, 1e-30);
  const own = { eye: camera.eye, target: add(camera.eye, forward, distance) };
  // What is up in the data stays up, unless the camera looks along it.
  own.up = up && Math.abs(dot(unit(up), forward)) < 0.999 ? unit(up) : down.map((x) => -x);
  const height = camera.size[1] / camera.focal_px[1];
  if (camera.projection === 'orthographic') own.ortho_height = height;
  else own.fov_deg = (2 * Math.atan(height / 2) * 180) / Math.PI;
  return own;
}

function axes({ eye, target, up }) {
  const offset = add(eye, target, -1);
  const forward = unit(offset).map((x) => -x);
  const right = unit(cross(forward, up));
  return { offset, forward, right, above: cross(right, forward) };
}

/** Turns a camera about its target, degrees. It stops before it looks along what is up. */
export function orbit(view, azimuth, elevation) {
  const up = unit(view.up);
  let { offset } = axes(view);
  offset = turned(offset, up, (-azimuth * Math.PI) / 180);
  const right = unit(cross(offset.map((x) => -x), up));
  const now = Math.asin(Math.max(-1, Math.min(1, dot(unit(offset), up))));
  const most = (89 * Math.PI) / 180;
  const wanted = Math.max(-most, Math.min(most, now + (elevation * Math.PI) / 180));
  return { ...view, eye: add(view.target, turned(offset, right, now - wanted)) };
}

/** Height of the picture at the target, world units. */
export function height(view) {
  if (view.ortho_height) return view.ortho_height;
  return 2 * length(add(view.eye, view.target, -1)) * Math.tan((view.fov_deg * Math.PI) / 360);
}

/** Moves what is seen, by shares of the picture's height. */
export function pan(view, right, down) {
  const own = axes(view);
  const by = add(own.right.map((x) => -x * right * height(view)), own.above, down * height(view));
  return { ...view, eye: add(view.eye, by), target: add(view.target, by) };
}

/** Comes nearer by a factor. */
export function zoom(view, factor) {
  if (view.ortho_height) return { ...view, ortho_height: view.ortho_height / factor };
  return { ...view, eye: add(view.target, add(view.eye, view.target, -1), 1 / factor) };
}

/** The same place seen along an axis: `x`, `-y` and so on. */
export function along(view, axis, up) {
  const sign = axis.startsWith('-') ? 1 : -1;
  const direction = [0, 0, 0];
  direction['xyz'.indexOf(axis.at(-1))] = sign;
  const distance = length(add(view.eye, view.target, -1));
  const isAlong = Math.abs(dot(unit(up), direction)) > 0.9;
  const above = isAlong ? (Math.abs(direction[1]) > 0.5 ? [0, 0, 1] : [0, 1, 0]) : up;
  return { ...view, eye: add(view.target, direction, distance), up: above };
}

/** Changes between perspective and parallel rays; the target stays as large. */
export function projected(view, isParallel) {
  const own = { ...view };
  if (isParallel && !view.ortho_height) {
    own.ortho_height = height(view);
    delete own.fov_deg;
  } else if (!isParallel && view.ortho_height) {
    own.fov_deg = 35;
    delete own.ortho_height;
    const distance = view.ortho_height / 2 / Math.tan((35 * Math.PI) / 360);
    own.eye = add(view.target, unit(add(view.eye, view.target, -1)), distance);
  }
  return own;
}
