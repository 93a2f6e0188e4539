// The page: its controls, the picture and what it says.

import * as command from './command.js';
import { Editor, joined, parts, ranged, short } from './function.js';
import * as view from './view.js';

const at = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);

/** The longest time of a picture in motion, ms. */
const MOTION_MS = 90;
/** Factor of the tolerance in motion. */
const COARSE = 5;
/** Time without a change after which a picture is refined, ms. */
const REST_MS = 160;
/** The longest picture whose error is measured, ms. */
const MEASURED_MS = 10_000;

const state = {
  files: [],
  name: '',
  base: null,
  camera: null,
  settings: { background: command.BACKGROUND },
  function: null,
};
let about = null;
let program = null;
let drawn = null;

// ---- the worker -------------------------------------------------------------------------------------------------------

// The smallest module that has an instruction on vectors.
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);

/** Program and data of a page in one file (`ewa-splat export`). */
const embedded = at('embedded') && JSON.parse(at('embedded').textContent);

/** Unpacks what a page in one file holds. */
async function unpacked(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).blob();
}

const hasSimd = embedded || (query.get('simd') !== 'off' && WebAssembly.validate(SIMD));

/** Addresses of the worker and of the module's two files, or their contents. */
async function sources() {
  if (!embedded) {
    const of = (name) => new URL(name, import.meta.url).href;
    const folder = hasSimd ? 'simd' : 'plain';
    return { source: of('worker.js'), script: of(`${folder}/ewa_splat.js`), wasm: of(`${folder}/ewa_splat_bg.wasm`) };
  }
  const [own, script, wasm] = await Promise.all([embedded.worker, embedded.script, embedded.module].map(unpacked));
  const source = URL.createObjectURL(new Blob([own], { type: 'text/javascript' }));
  return { source, script: await script.text(), wasm: await wasm.arrayBuffer(), isText: true };
}

let worker;
/** Settles when the module is loaded. */
let ready;
let calls = new Map();
let count = 0;
/** True if the module was loaded: one that was not is not loaded again. */
let isStarted = false;

async function begin() {
  isStarted = false;
  const { source, script, wasm, isText } = await sources();
  // No module: browsers load those of pages in one file by no address.
  worker = new Worker(source);
  worker.onmessage = ({ data: { id, found, error, stopped, cancelled } }) => {
    const { resolve, reject } = calls.get(id) ?? {};
    calls.delete(id);
    if (error) {
      if (stopped && isStarted) restart();
      (reject ?? tell)(Object.assign(new Error(error), { cancelled }));
    } else resolve?.(found);
  };
  worker.onerror = (event) => {
    const what = isStarted ? 'the program has stopped' : 'the worker cannot be loaded';
    const text = `${what}: ${event.message ?? 'no such file'}`;
    for (const { reject } of calls.values()) reject(new Error(text));
    calls.clear();
    if (isStarted) restart();
    tell(text);
  };
  const text = isText ? new TextEncoder().encode(script) : script;
  program = await call('start', { backend: query.get('backend'), script: text, wasm });
  isStarted = true;
  return program;
}

function call(name, given = {}) {
  const id = ++count;
  return new Promise((resolve, reject) => {
    calls.set(id, { resolve, reject });
    worker.postMessage({ id, call: name, ...given });
  });
}

/** Starts a new module in place of one that has stopped; the data are gone with it. */
function restart() {
  worker.terminate();
  for (const { reject } of calls.values()) reject(new Error('the program has stopped'));
  calls.clear();
  about = null;
  at('controls').disabled = true;
  // What is opened next waits for the new module.
  ready = begin();
  ready.catch(tell);
}

// ---- what the page says -----------------------------------------------------------------------------------------------

function tell(error) {
  const text = error?.message ?? error;
  at('error').hidden = !text;
  at('error').textContent = text ?? '';
}

function mark(word) {
  document.body.dataset.state = word;
  at('busy').hidden = word !== 'busy';
}

function status(words) {
  at('status').textContent = words.filter(Boolean).join('  ·  ');
}

function backEnd() {
  if (drawn?.about?.adapter) return `WebGPU: ${program.adapter}`;
  const simd = hasSimd ? 'with SIMD' : 'without SIMD';
  return `processor, ${simd}${program?.why && program.why !== 'chosen' ? ` (${program.why})` : ''}`;
}

function say(error) {
  if (!drawn) return;
  const { size, ms, about, memory, isCoarse, tolerance } = drawn;
  const seconds = ms < 995 ? `${Math.round(ms)} ms` : `${(ms / 1000).toFixed(2)} s`;
  const measured = error
    ? `error ${error.percentile_999.toPrecision(2)} of 1 on 99.9 % of the pixels (measured), ${error.greatest.toPrecision(2)} at most`
    : `tolerance ${short(tolerance ?? 1 / 255)}`;
  status([
    about.fallback ? `${backEnd()} (${about.fallback})` : backEnd(),
    `${size[0]} × ${size[1]}`,
    seconds,
    isCoarse ? 'in motion' : measured,
    about.particles !== undefined ? `${about.particles.toLocaleString('en')} kernels` : null,
    `${Math.round(memory / 2 ** 20)} MiB`,
  ]);
}

function legend(bars) {
  const make = (bar) => {
    const plate = document.createElement('div');
    plate.className = 'bar';
    const title = document.createElement('h2');
    title.textContent = bar.title;
    const colours = document.createElement('div');
    colours.className = 'colours';
    const rgb = bar.colours.map((c) => `rgb(${c.slice(0, 3).map((x) => Math.round(255 * x)).join(' ')})`);
    colours.style.background = `linear-gradient(to top, ${rgb.join(', ')})`;
    const labels = document.createElement('div');
    labels.className = 'labels';
    for (const [share, text] of bar.labels) {
      const label = document.createElement('span');
      label.style.bottom = `${100 * share}%`;
      label.textContent = text;
      labels.append(label);
    }
    plate.append(title, colours, labels);
    return plate;
  };
  at('legend').replaceChildren(...bars.map(make));
}

// ---- pictures ---------------------------------------------------------------------------------------------------------

let isDrawing = false;
/** True if the scene was made for another size. */
let isNew = false;
let next = null;
let restTimer;
let motionScale = 0.4;

function stageSize() {
  const box = at('picture').getBoundingClientRect();
  const ratio = drawn?.about?.adapter ? Math.min(devicePixelRatio, 2) : 1;
  return [box.width, box.height].map((x) => Math.max(16, Math.round(x * ratio)));
}

/** The work that can be cancelled, with its signals: addresses of sampling and of drawing. */
let work = null;

/** Calls the worker for something that can be cancelled; undefined if it was. */
async function cancellable(name, given, about) {
  const signals = [0, 1].map(() => URL.createObjectURL(new Blob(['.'], { type: 'application/x-signal' })));
  const own = (work = { ...about, signals });
  try {
    return await call(name, { ...given, signals });
  } catch (error) {
    if (error.cancelled) {
      document.body.dataset.cancelled = Number(document.body.dataset.cancelled ?? 0) + 1;
      return undefined;
    }
    throw error;
  } finally {
    signals.forEach((signal) => URL.revokeObjectURL(signal));
    if (work === own) work = null;
  }
}

/** Cancels what is drawn; data are sampled on unless `isAll`. */
function cancel(isAll) {
  work?.signals.slice(isAll ? 0 : 1).forEach((signal) => URL.revokeObjectURL(signal));
}

/** What the scene of a picture depends on. */
const sampled = () => JSON.stringify([state.settings.columns, command.request(state, [1, 1]).sampling]);

/** Asks for a picture: coarse while something moves, and afterwards a fine one. */
function redraw(isMoving) {
  if (!about) return;
  writeCommand();
  // A picture in motion is shown; one of other data is not.
  const isOther = work && work.sampled !== sampled();
  if (isOther || !work?.isCoarse) cancel(isOther);
  next = isMoving ? 'coarse' : 'fine';
  clearTimeout(restTimer);
  if (!isDrawing) drawAll();
}

/** What drawing told last. */
let failure = '';

async function drawAll() {
  let own = loads;
  isDrawing = true;
  mark('busy');
  try {
    while (next && about) {
      const kind = next;
      own = loads;
      next = null;
      await draw(kind === 'coarse');
      if (!next && drawn && kind === 'fine') await afterwards();
    }
    // What went wrong elsewhere, as in saving, stays.
    if (at('error').textContent === failure) tell(null);
  } catch (error) {
    failure = error.message;
    if (own === loads) tell(error);
  }
  isDrawing = false;
  if (isLoading) return;
  // Data that were opened while the last picture of others failed wait for theirs.
  if (next && about) return drawAll();
  // Without data, as after a stop, no finer picture follows.
  const isMoving = about && drawn?.isCoarse;
  mark(isMoving ? 'moving' : 'idle');
  if (isMoving) restTimer = setTimeout(() => redraw(false), REST_MS);
}

async function draw(isCoarse) {
  const begun = loads;
  const full = stageSize();
  const scale = isCoarse ? motionScale : 1;
  const size = full.map((x) => Math.max(16, Math.round(x * scale)));
  const own = state.settings.tolerance ?? 1 / 255;
  const tolerance = isCoarse ? Math.min(own * COARSE, 0.5) : state.settings.tolerance;
  const request = command.request(state, size, tolerance);
  const given = { columns: state.settings.columns, request, isNew };
  if (program.adapter && !drawn) status([`WebGPU: ${program.adapter}`, 'making the pipelines of this scene, which takes long once …']);
  const found = await cancellable('draw', given, { isCoarse, sampled: sampled() });
  if (begun !== loads || !found) return;
  isNew = false;
  // Pictures in motion take about as long as one can wait for.
  if (isCoarse) motionScale = Math.min(1, Math.max(0.1, scale * Math.sqrt(MOTION_MS / Math.max(found.ms, 5)) ** 0.7));
  show({ ...found, isCoarse, tolerance });
}

function show(found) {
  drawn = found;
  const [width, height] = found.size;
  const canvas = at('picture');
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const pixels = new Uint8ClampedArray(found.pixels.buffer, found.pixels.byteOffset, found.pixels.length);
  canvas.getContext('2d').putImageData(new ImageData(pixels, width, height), 0, 0);
  delete found.pixels;
  legend(found.about.bars);
  say(null);
}

/** What is asked of a fine picture: its function, and its error. */
async function afterwards() {
  const own = loads;
  if (state.settings.columns) return;
  if (!state.function) {
    const found = await call('function', { bins: 96 });
    // An edit that was made meanwhile stays.
    if (own !== loads || state.function) return;
    at('function').hidden = !found;
    automatic = found?.function ?? null;
    if (found) editor.show(found.function, found.counts);
    fillRange();
  }
  if (!next && drawn.ms < MEASURED_MS) {
    const error = await cancellable('measure', {}, { sampled: sampled() });
    if (error && !next && own === loads) say(error);
  }
}

// ---- data -------------------------------------------------------------------------------------------------------------

/** Endings of files that others name. */
const COMPANIONS = /\.(q|f|fun|mtl|png|jpe?g|webp|bin|raw|zraw|img|ktx2|tga|bmp)$/i;

/** Counts the files that were opened: what was asked of earlier ones is dropped. */
let loads = 0;
let isLoading = false;

/** Shows one of several files. */
async function open(files, name, base = null) {
  if (!files.length) return;
  const ranked = [...files].sort((a, b) => rank(a.name) - rank(b.name) || a.name.localeCompare(b.name));
  Object.assign(state, { files, base, name: name ?? ranked[0].name });
  const select = at('main');
  select.replaceChildren(...ranked.map((file) => new Option(file.name)));
  select.value = state.name;
  select.hidden = files.length < 2;
  at('name').textContent = files.length < 2 ? state.name : '';
  await load();
}

function rank(name) {
  const isKnown = program?.endings.some((ending) => name.toLowerCase().endsWith(`.${ending}`));
  return (COMPANIONS.test(name) ? 2 : 0) + (isKnown ? 0 : 1);
}

async function load() {
  const own = ++loads;
  cancel(true);
  isLoading = true;
  mark('busy');
  next = null;
  about = null;
  drawn = null;
  automatic = null;
  tell(null);
  at('controls').disabled = true;
  status([`Reading ${state.name} …`]);
  try {
    await ready;
    if (own !== loads) return;
    const given = { name: state.name, files: state.files, base: state.base, settings: command.opening(state.settings) };
    const opened = await call('open', given);
    if (own !== loads) return;
    about = opened;
    fill();
  } catch (error) {
    if (own !== loads) return;
    isLoading = false;
    about = null;
    tell(error);
    status([`${state.name} cannot be shown`]);
    at('legend').replaceChildren();
    const canvas = at('picture');
    canvas.getContext('2d').clearRect(0, 0, canvas.width, canvas.height);
    mark('idle');
    return;
  }
  isLoading = false;
  at('empty').hidden = true;
  at('controls').disabled = false;
  redraw(false);
}

/** Forgets what was set for other data. */
function reset() {
  Object.assign(state, { camera: null, function: null, settings: { background: command.BACKGROUND } });
}

async function given(files) {
  // A text that is dropped has no files.
  if (!files.length) return;
  reset();
  if (shared) {
    Object.assign(state, shared);
    shared = null;
  }
  await open(files);
}

async function entries(items) {
  const found = [];
  const walk = async (entry, path) => {
    if (entry.isFile) {
      const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
      found.push({ name: path + entry.name, file });
    } else {
      const list = entry.createReader();
      for (;;) {
        const some = await new Promise((resolve, reject) => list.readEntries(resolve, reject));
        if (!some.length) break;
        for (const child of some) await walk(child, `${path}${entry.name}/`);
      }
    }
  };
  for (const entry of items) await walk(entry, '');
  return found;
}

async function fetched(address) {
  const url = new URL(address, location.href);
  const name = decodeURIComponent(url.pathname.split('/').pop());
  status([`Fetching ${name} …`]);
  const own = loads;
  const answer = await fetch(url).catch((error) => {
    throw new Error(`${address}: fetching: expected an answer, found ${error.message}; the server must allow other pages to read it (CORS)`);
  });
  if (!answer.ok) throw new Error(`${address}: fetching: expected a file, found ${answer.status} ${answer.statusText}`);
  const file = await answer.blob();
  // Files that were dropped meanwhile stay.
  if (own === loads) await open([{ name, file }], name, url.href);
}

// ---- controls ---------------------------------------------------------------------------------------------------------

let automatic = null;
const editor = new Editor(at('editor'), {
  changed(f) {
    state.function = f;
    redraw(true);
  },
  describe(text) {
    at('point').textContent = text;
  },
});

/** Fills the controls from the data and the settings. */
function fill() {
  const { settings: s } = state;
  const options = (select, names, first) => {
    select.replaceChildren(new Option(first, ''), ...names.map((name) => new Option(name)));
  };
  options(at('field'), about.fields, 'automatic');
  options(at('of'), ['mass', ...about.fields.filter((name) => name !== 'mass')], 'automatic');
  options(at('mean'), about.fields, 'no');
  for (const id of ['field', 'of', 'mean', 'map', 'scale', 'composite', 'light']) at(id).value = s[id] ?? '';
  for (const id of ['opacity', 'tolerance', 'thickness', 'isosurface']) at(id).value = s[id] ?? '';
  at('step').value = s.step ?? '';
  at('surface').checked = !!s.surface;
  at('shadows').checked = !!s.shadows;
  at('softness').value = s.softness ?? '';
  at('columns').checked = !!s.columns;
  at('direction').value = s.direction?.join(', ') ?? '';
  at('background').value = s.background || command.BACKGROUND;
  at('transparent').checked = s.background === '';
  at('parallel').checked = !!state.camera?.ortho_height;
  fillClip();
  at('notes').replaceChildren(...about.notes.map((text) => Object.assign(document.createElement('li'), { textContent: text })));
  fillRange();
  fillSize();
  if (state.function) {
    at('function').hidden = false;
    editor.show(state.function, []);
  }
  at('function').hidden = !!s.columns;
}

function fillRange() {
  const range = state.function?.range ?? state.settings.range;
  const own = state.settings.columns ? null : automatic?.range;
  ['low', 'high'].forEach((id, i) => {
    at(id).value = range ? short(range[i]) : '';
    at(id).placeholder = own ? short(own[i]) : 'automatic';
  });
}

let isSized = false;
function fillSize() {
  if (isSized) return;
  [at('width').value, at('height').value] = stageSize();
}

function savedSize() {
  const size = [at('width'), at('height')].map((input) => Number(input.value));
  if (size.some((n) => !(Number.isInteger(n) && n >= 1 && n <= 65535))) {
    throw new Error(`size: expected a width and a height from 1 to 65535, found ${size.join(', ')}`);
  }
  return size;
}

function writeCommand() {
  try {
    at('command').value = command.line(state, state.name, savedSize(), `picture.${at('format').value}`);
  } catch (error) {
    at('command').value = error.message;
  }
}

/** A number in an input: undefined if it is empty. */
function number(id, expected, isGood = () => true) {
  const text = at(id).value.trim();
  at(id).classList.remove('wrong');
  if (text === '') return undefined;
  const [a, b] = text.split('/');
  const value = b === undefined ? Number(a) : Number(a) / Number(b);
  if (Number.isFinite(value) && isGood(value)) return value;
  at(id).classList.add('wrong');
  throw new Error(`${id}: expected ${expected}, found ${text}`);
}

/** Runs `change` at the change of a control, and draws again. */
function on(id, change, event = 'change') {
  at(id).addEventListener(event, async () => {
    try {
      await change(at(id));
      tell(null);
      redraw(event === 'input');
    } catch (error) {
      tell(error);
    }
  });
}

const set = (name, value) => {
  if (value === undefined || value === '' || value === false) delete state.settings[name];
  else state.settings[name] = value;
};

on('field', ({ value }) => {
  set('field', value);
  state.function = null;
  delete state.settings.range;
});
at('step').addEventListener('change', ({ target }) => {
  set('step', target.value === '' ? undefined : Number(target.value));
  load();
});
on('isosurface', () => set('isosurface', number('isosurface', 'a number')));
on('surface', ({ checked }) => set('surface', checked));
on('map', async ({ value }) => {
  set('map', value);
  if (!state.function) return;
  // The edited opacities stay.
  if (!value) return;
  const begun = loads;
  const map = await call('map', { name: value });
  if (begun !== loads || !state.function) return;
  const colours = parts(map).colours;
  const own = parts(state.function).opacities;
  state.function = joined({ ...state.function, color_space: 'linear' }, { colours, opacities: own });
  editor.show(state.function);
});
for (const id of ['low', 'high']) {
  on(id, () => {
    const own = state.function?.range ?? state.settings.range ?? (state.settings.columns ? null : automatic?.range) ?? [];
    const range = [number('low', 'a number') ?? own[0], number('high', 'a number') ?? own[1]];
    if (at('low').value === '' && at('high').value === '') {
      state.function = null;
      set('range', undefined);
    } else if (!(range[0] < range[1])) {
      throw new Error(`range: expected two finite numbers, the lower one first, found ${range.join(', ')}`);
    } else if (state.function) {
      state.function = ranged(state.function, range);
      editor.show(state.function);
    } else set('range', range);
  });
}
on('scale', ({ value }) => {
  set('scale', value);
  state.function = null;
});
on('opacity', () => set('opacity', number('opacity', 'a number above 0', (x) => x > 0)));
at('automatic').addEventListener('click', () => {
  state.function = null;
  for (const name of ['map', 'range', 'scale', 'opacity']) set(name, undefined);
  fill();
  redraw(false);
});
on('columns', ({ checked }) => {
  set('columns', checked);
  state.camera = null;
  at('function').hidden = checked;
  fillRange();
});
on('of', ({ value }) => set('of', value));
on('mean', ({ value }) => set('mean', value));
on('tolerance', () => set('tolerance', number('tolerance', 'a number between 0 and 1', (x) => x > 0 && x < 1)));
on('composite', ({ value }) => set('composite', value));
on('thickness', () => set('thickness', number('thickness', 'a number above 0', (x) => x > 0)));
on('light', ({ value }) => set('light', value));
on('shadows', ({ checked }) => {
  set('shadows', checked);
  if (!checked) set('softness', (at('softness').value = ''));
});
on('softness', () => {
  const softness = number('softness', 'degrees from 0 to 15', (x) => x >= 0 && x <= 15);
  set('softness', softness);
  if (softness !== undefined) set('shadows', (at('shadows').checked = true));
});
on('direction', ({ value }) => {
  const numbers = value.split(/[\s,]+/).filter(Boolean).map(Number);
  if (numbers.length && (numbers.length !== 3 || numbers.some((x) => !Number.isFinite(x)))) {
    throw new Error(`light: expected three numbers, found ${value}`);
  }
  set('direction', numbers.length ? numbers : undefined);
  if (numbers.length) set('light', (at('light').value = 'on'));
});
const background = () => {
  state.settings.background = at('transparent').checked ? '' : at('background').value;
};
on('background', background, 'input');
on('transparent', background);

let clipAxis = null;
let clipNormal = null;
/** Where the data begin and end along a direction. */
function reach(normal) {
  const [low, high] = about.bounds;
  const corners = Array.from({ length: 8 }, (_, i) => low.map((x, k) => ((i >> k) & 1 ? high[k] : x)));
  const along = corners.map((corner) => view.dot(corner, normal));
  return [Math.min(...along), Math.max(...along)];
}

/** Fills the controls of the clip plane, so that moving it begins where it is. */
function fillClip() {
  const { clip } = state.settings;
  clipNormal = clip ? clip.slice(0, 3) : null;
  const axes = ['x', 'y', 'z', '-x', '-y', '-z'];
  const normalOf = (axis) => [...'xyz'].map((name) => (axis.at(-1) !== name ? 0 : axis.startsWith('-') ? -1 : 1));
  const isNormal = (axis) => normalOf(axis).every((x, i) => x === clipNormal[i]);
  clipAxis = clip ? (axes.find(isNormal) ?? 'view') : '';
  at('clip').value = clipAxis;
  if (!clip || !about.bounds) return;
  const [least, most] = reach(clipNormal);
  at('depth').value = (-clip[3] - least) / (most - least || 1);
}

const clip = () => {
  const axis = at('clip').value;
  if (axis !== clipAxis) clipNormal = null;
  clipAxis = axis;
  if (!axis) return set('clip', undefined);
  if (axis === 'view' && !clipNormal) {
    const { eye, target } = current();
    const offset = view.add(target, eye, -1);
    clipNormal = offset.map((x) => Number((x / Math.hypot(...offset)).toFixed(4)));
  } else if (axis !== 'view') {
    clipNormal = [0, 0, 0];
    clipNormal['xyz'.indexOf(axis.at(-1))] = axis.startsWith('-') ? -1 : 1;
  }
  const [least, most] = reach(clipNormal);
  const distance = -(least + (most - least) * Number(at('depth').value));
  set('clip', [...clipNormal, Number(distance.toPrecision(6))]);
};
on('clip', clip);
on('depth', clip, 'input');

// ---- the camera -------------------------------------------------------------------------------------------------------

/** The camera of the picture; the automatic one becomes the user's. */
function current() {
  return state.camera ?? view.of(drawn.about.camera, drawn.about.visible ?? about.bounds, about.up);
}

function move(change) {
  if (!about || !drawn) return;
  state.camera = change(current());
  redraw(true);
}

const pointers = new Map();
const canvas = at('picture');
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('pointerdown', (event) => {
  canvas.focus({ preventScroll: true });
  try {
    canvas.setPointerCapture(event.pointerId);
  } catch {
    // Events that a program makes have no pointer to capture.
  }
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});
canvas.addEventListener('pointermove', (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const by = view.add(now, before, -1);
  const { height } = canvas.getBoundingClientRect();
  if (pointers.size === 2) {
    const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    const distance = (place) => Math.hypot(...view.add(place, other, -1));
    const factor = distance(now) / Math.max(distance(before), 1);
    move((own) => view.zoom(view.pan(own, by[0] / height / 2, by[1] / height / 2), factor || 1));
  } else if (event.shiftKey || event.buttons & 6) {
    move((own) => view.pan(own, by[0] / height, by[1] / height));
  } else {
    move((own) => view.orbit(own, (by[0] / height) * 220, (by[1] / height) * 220));
  }
  pointers.set(event.pointerId, now);
});
for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
  canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
}
canvas.addEventListener(
  'wheel',
  (event) => {
    event.preventDefault();
    const pixels = event.deltaMode ? event.deltaY * 30 : event.deltaY;
    move((own) => view.zoom(own, Math.exp(-pixels / 500)));
  },
  { passive: false },
);
canvas.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const arrow = arrows[event.key];
  const key = event.key.toLowerCase();
  if (arrow && event.shiftKey) move((own) => view.pan(own, arrow[0] * 0.05, arrow[1] * 0.05));
  else if (arrow) move((own) => view.orbit(own, arrow[0] * 8, arrow[1] * 8));
  else if (key === '+' || key === '=') move((own) => view.zoom(own, 1.15));
  else if (key === '-' || key === '_') move((own) => view.zoom(own, 1 / 1.15));
  else if (key === 'home' || key === 'r') fit();
  else if ('xyz'.includes(key)) look((event.shiftKey ? '-' : '') + key);
  else return;
  event.preventDefault();
});

function fit() {
  state.camera = null;
  at('parallel').checked = false;
  redraw(false);
}

function look(axis) {
  move((own) => view.along(own, axis, about.up ?? [0, 0, 1]));
}

at('fit').addEventListener('click', fit);
at('along').addEventListener('change', ({ target }) => {
  if (target.value) look(target.value);
  target.value = '';
});
at('parallel').addEventListener('change', ({ target }) => move((own) => view.projected(own, target.checked)));

// ---- saving -----------------------------------------------------------------------------------------------------------

function save(name, content, type) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

function button(id, act) {
  at(id).addEventListener('click', () => Promise.resolve().then(act).catch(tell));
}

async function still() {
  while (isDrawing) await new Promise((resolve) => setTimeout(resolve, 20));
}

button('save', async () => {
  const size = savedSize();
  clearTimeout(restTimer);
  await still();
  if (!about) throw new Error('picture: expected data, found none');
  const own = loads;
  // Data that are opened meanwhile take the place of those of the picture.
  const same = (found) => {
    if (own === loads) return found;
    throw new Error('picture: expected the same data until it is saved, found others');
  };
  isDrawing = true;
  mark('busy');
  try {
    const request = command.request(state, size, state.settings.tolerance);
    // The scene is made for this size, as the program makes it.
    const isNumbers = at('format').value === 'npy';
    same(await call('draw', { columns: state.settings.columns, request, isNew: true }));
    const content = same(await call(isNumbers ? 'floats' : 'png'));
    if (isNumbers) save('picture.npy', npy(content, size), 'application/octet-stream');
    else save('picture.png', content, 'image/png');
  } finally {
    isDrawing = false;
    isNew = true;
    if (!about && !isLoading) mark('idle');
    redraw(false);
  }
});
/** A file of NumPy: linear, premultiplied numbers, or the values of columns. */
function npy(numbers, [width, height]) {
  const shape = numbers.length === width * height ? `${height}, ${width}` : `${height}, ${width}, 4`;
  const text = `{'descr': '<f4', 'fortran_order': False, 'shape': (${shape}), }`;
  const padded = text.padEnd(128 - 10 - 1) + '\n';
  const head = Uint8Array.from([0x93, ...'NUMPY\x01\x00'].map((c) => (typeof c === 'number' ? c : c.charCodeAt(0))));
  return new Blob([head, new Uint8Array([padded.length, 0]), padded, numbers]);
}

button('saveFunction', async () => {
  const f = state.function ?? automatic;
  if (!f) throw new Error('transfer function: expected data with a field, found none');
  save('function.json', `${JSON.stringify(f, null, 2)}\n`, 'application/json');
});
button('saveCamera', async () => save('camera.json', `${JSON.stringify(fileOf(current()), null, 2)}\n`, 'application/json'));

/** A camera in the form of its files. */
function fileOf({ eye, target, up, fov_deg, ortho_height }) {
  return ortho_height ? { eye, target, up, ortho_height } : { eye, target, up, fov_deg };
}

async function copied(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    status([`${what} copied`]);
  } catch {
    at('command').value = text;
    at('command').select();
    status([`${what}: select and copy it from the box`]);
  }
}

button('copy', () => copied(at('command').value, 'Command'));
button('link', async () => {
  const link = new URL(location.pathname, location.href);
  if (state.base) link.searchParams.set('data', state.base);
  const { camera, settings, function: edited } = state;
  link.searchParams.set('view', JSON.stringify({ camera, settings, function: edited }));
  await copied(link.href, state.base ? 'Link' : 'Link (without the data, which are on this machine: drop them there)');
});

// ---- files ------------------------------------------------------------------------------------------------------------

at('pick').addEventListener('change', ({ target }) => {
  given([...target.files].map((file) => ({ name: file.name, file })));
  target.value = '';
});
at('main').addEventListener('change', ({ target }) => {
  reset();
  open(state.files, target.value);
});
for (const name of ['dragenter', 'dragover']) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    at('stage').classList.add('dropping');
  });
}
document.addEventListener('dragleave', (event) => {
  if (!event.relatedTarget) at('stage').classList.remove('dropping');
});
document.addEventListener('drop', async (event) => {
  event.preventDefault();
  at('stage').classList.remove('dropping');
  const { items, files } = event.dataTransfer;
  const listed = [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  const plain = [...files].map((file) => ({ name: file.name, file }));
  try {
    await given(listed.length ? await entries(listed) : plain);
  } catch (error) {
    tell(error);
  }
});
for (const id of ['width', 'height', 'format']) {
  at(id).addEventListener('change', () => {
    isSized = isSized || id !== 'format';
    writeCommand();
  });
}
new ResizeObserver(() => {
  fillSize();
  if (about && drawn) redraw(true);
}).observe(at('stage'));

// ---- start ------------------------------------------------------------------------------------------------------------

mark('loading');
let shared = null;

/** A view of a link with what it leaves out. */
function whole(given) {
  command.check(given);
  const { camera, settings, function: edited } = given;
  return { camera: camera ?? null, function: edited ?? null, settings: { background: command.BACKGROUND, ...settings } };
}

ready = begin().then((found) => {
  at('map').replaceChildren(new Option('automatic', ''), ...found.maps.map((name) => new Option(name)));
  at('endings').textContent = `.${[...new Set(found.endings)].sort().join(' .')}`;
  status([`ewa-splat ${found.version}`, found.adapter ? `WebGPU: ${found.adapter}` : backEnd()]);
});
const failed = (words) => (error) => {
  tell(error);
  status([words]);
  mark('idle');
};

/** Reads a view of a link. */
function parsed(text) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`view: expected JSON, found ${error.message}`);
  }
}

/** Shows what the page's address or the page itself names. */
async function first() {
  if (query.get('view')) shared = whole(parsed(query.get('view')));
  if (embedded) {
    if (embedded.view) Object.assign(state, whole(embedded.view));
    const files = embedded.files.map(async ({ name, data }) => ({ name, file: await unpacked(data) }));
    await open(await Promise.all(files), embedded.files[0].name);
  } else if (query.get('data')) {
    Object.assign(state, shared);
    shared = null;
    await fetched(query.get('data'));
  } else mark('idle');
}

ready.then(
  () => first().catch(failed('What the link names cannot be shown')),
  failed('The program cannot be loaded'),
);
