// The command line that makes the picture of the page.

const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
const list = (values) => values.map((x) => `${x}`).join(',');

/** The settings of a request, with the names that the module takes. */
export function request(state, size, tolerance) {
  const { camera, settings: s } = state;
  const clip = s.clip ? [s.clip] : undefined;
  if (s.columns) {
    return {
      size,
      view: camera ?? {},
      sampling: {},
      drawing: clean({
        of: s.of, mean: s.mean, map: s.map, range: s.range, scale: s.scale, tolerance, clip,
      }),
    };
  }
  const edited = state.function;
  return {
    size,
    view: camera ?? {},
    sampling: clean({
      field: s.field,
      transfer_function: edited ? undefined : s.map,
      range: edited ? undefined : s.range,
      scale: edited ? undefined : s.scale,
      opacity_scale: s.opacity,
      flatten: s.isosurface,
      surface: s.surface || undefined,
    }),
    drawing: clean({
      tolerance,
      composite: s.composite,
      slab_thickness: s.composite && s.composite !== 'over' ? s.thickness : undefined,
      lit: s.light === 'on' && !s.direction ? true : s.light === 'off' ? false : undefined,
      lights: s.light === 'on' && s.direction ? [[...s.direction, 1, 1, 1]] : undefined,
      shadows: s.shadows && s.light !== 'off' ? true : undefined,
      shadow_softness: s.shadows && s.light !== 'off' ? s.softness : undefined,
      clip,
      background: s.background ? linear(s.background) : undefined,
      transfer_function: edited ?? undefined,
    }),
  };
}

const finite = (x) => typeof x === 'number' && Number.isFinite(x);
const numbers = (count) => (list) => Array.isArray(list) && list.length === count && list.every(finite);
const point = [numbers(3), 'three numbers'];
const text = [(x) => typeof x === 'string', 'a text'];
const flag = [(x) => typeof x === 'boolean', 'true or false'];
const above = [(x) => finite(x) && x > 0, 'a number above 0'];
const ordered = [(list) => numbers(2)(list) && list[0] < list[1], 'two numbers, the lower one first'];
const direction = [(x) => numbers(3)(x) && x.some((n) => n !== 0), 'three numbers that are not all zero'];
const one = (...names) => [(x) => names.includes(x), names.join(', ')];

const SETTINGS = {
  field: text,
  map: text,
  of: text,
  mean: text,
  scale: one('linear', 'log', 'symlog'),
  composite: one('over', 'sheets', 'axis-sheets', 'slabs', 'maximum'),
  light: one('on', 'off'),
  background: [(x) => typeof x === 'string' && /^(#[0-9a-f]{6})?$/i.test(x), 'a colour as #rrggbb'],
  step: [(x) => Number.isInteger(x) && x >= -1, 'a count, or -1'],
  isosurface: [finite, 'a number'],
  opacity: above,
  thickness: above,
  tolerance: [(x) => finite(x) && x > 0 && x < 1, 'a number between 0 and 1'],
  surface: flag,
  shadows: flag,
  softness: [(x) => finite(x) && x >= 0 && x <= 15, 'degrees from 0 to 15'],
  columns: flag,
  range: ordered,
  direction,
  clip: [(x) => numbers(4)(x) && x.slice(0, 3).some((n) => n !== 0), 'four numbers, the first three not all zero'],
};
const CAMERA = {
  eye: point,
  target: point,
  up: direction,
  fov_deg: [(x) => finite(x) && x > 0 && x < 180, 'degrees between 0 and 180'],
  ortho_height: above,
};

/** Checks the parts of something by name. */
function checkParts(place, given, known) {
  if (typeof given !== 'object' || Array.isArray(given)) throw new Error(`${place}: expected names and values, found ${JSON.stringify(given)}`);
  for (const [name, value] of Object.entries(given)) {
    const [isGood, expected] = Object.hasOwn(known, name) ? known[name] : [() => false, `none but ${Object.keys(known).join(', ')}`];
    if (!isGood(value)) throw new Error(`${place}: ${name}: expected ${expected}, found ${JSON.stringify(value)}`);
  }
}

/** Checks the view of a link, which anybody may have written. Throws an error that names what is wrong. */
export function check(view) {
  if (view === null || typeof view !== 'object') throw new Error(`view: expected camera, settings and function, found ${JSON.stringify(view)}`);
  const { camera, settings, function: edited } = view;
  checkParts('view: settings', settings ?? {}, SETTINGS);
  if (camera) {
    checkParts('view: camera', camera, CAMERA);
    const { eye, target, up, fov_deg: fov, ortho_height: height } = camera;
    const isWhole = eye && target && up && (fov === undefined) !== (height === undefined);
    if (!isWhole || eye.every((x, i) => x === target[i])) {
      throw new Error('view: camera: expected eye, target, up, and fov_deg or ortho_height, with two different points, found others');
    }
  }
  if (edited) {
    const isPoint = (p) =>
      p && finite(p.value) && (p.color === undefined || numbers(3)(p.color)) && (p.opacity === undefined || finite(p.opacity));
    const { range, points } = edited;
    const isGood = ordered[0](range) && Array.isArray(points) && points.every(isPoint) &&
      points.some((p) => p.color) && points.some((p) => p.opacity !== undefined);
    if (!isGood) throw new Error('view: function: expected a range and points with colours and opacities, found others');
  }
}

/** Options for opening a file. */
export function opening(settings) {
  return clean({ time_step: settings.step });
}

function clean(settings) {
  return Object.fromEntries(Object.entries(settings).filter(([, value]) => value !== undefined && value !== null && value !== ''));
}

/** Linear colour of #rrggbb. */
export function linear(hex) {
  return [1, 3, 5].map((at) => {
    const code = parseInt(hex.slice(at, at + 2), 16) / 255;
    return code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4;
  });
}

/** Colour of the background that the program takes by default. */
export const BACKGROUND = '#1c1c21';

/** The words of the command line, quoted for a shell. */
export function line(state, name, size, out) {
  const { camera, settings: s } = state;
  // What begins with a minus would be an option: a file gets its folder, and a value is joined to its option.
  const words = ['ewa-splat', 'render', name.startsWith('-') ? `./${name}` : name, '--size', size.join('x')];
  const option = (option, value) => {
    const text = `${value ?? ''}`;
    if (text.startsWith('-')) words.push(`--${option}=${text}`);
    else if (text) words.push(`--${option}`, text);
  };
  option('step', s.step === -1 ? 'last' : s.step);
  if (camera) {
    option('eye', list(camera.eye));
    option('target', list(camera.target));
    option('up', list(camera.up));
    option('fov', camera.fov_deg);
    option('ortho', camera.ortho_height);
  }
  if (s.columns) {
    words.push('--column-density');
    option('column-of', s.of);
    option('column-mean', s.mean);
  } else {
    // The program fits kernels of grids to the camera; the page draws one set of kernels from all sides.
    option('refine', 'off');
    option('field', s.field);
    option('opacity-scale', s.opacity);
    option('isosurface', s.isosurface);
    if (s.surface) words.push('--surface');
  }
  if (state.function && !s.columns) {
    option('transfer-function', 'function.json');
  } else {
    option('transfer-function', s.map);
    option('range', s.range && list(s.range));
    option('scale', s.scale);
  }
  option('tolerance', s.tolerance);
  if (!s.columns) {
    option('composite', s.composite);
    if (s.composite && s.composite !== 'over') option('slab-thickness', s.thickness);
    if (s.light === 'off') words.push('--unlit');
    if (s.light === 'on' && !s.direction) words.push('--lit');
    if (s.light === 'on' && s.direction) option('light', list(s.direction));
    if (s.shadows && s.light !== 'off') words.push('--shadows');
    if (s.shadows && s.light !== 'off') option('shadow-softness', s.softness);
    // Pictures in numbers are transparent by default.
    if (s.background !== BACKGROUND || !out.endsWith('.png')) option('background', s.background || 'none');
  }
  option('clip', s.clip && list(s.clip));
  words.push('--out', out);
  return words.map(quoted).join(' ');
}
