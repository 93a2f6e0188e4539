// The worker that holds the module and the data. It does one thing at a time, in the order of messages.

let module, scene, device, adapter, last;
/** True if the page can cancel work. */
let hasSignals = false;

/**
 * Loads the module and opens a device.
 *
 * - `script`, `wasm`: addresses of the module's two files, or their contents.
 */
async function start({ backend, script, wasm }) {
  const address = typeof script === 'string' ? script : URL.createObjectURL(new Blob([script], { type: 'text/javascript' }));
  module = await import(address);
  const own = URL.createObjectURL(new Blob(['.']));
  hasSignals = isThere(own);
  URL.revokeObjectURL(own);
  hasSignals &&= !isThere(own);
  await module.default({ module_or_path: wasm });
  let why = 'chosen';
  if (backend !== 'cpu') {
    [device, why] = await opened(backend === 'gpu');
    if (!device && backend === 'gpu') throw new Error(`backend: expected WebGPU, found none: ${why}`);
  }
  return {
    version: module.version(),
    maps: module.colourMaps(),
    endings: module.endings(),
    adapter: device ? adapter : null,
    why,
  };
}

/** Opens a device of WebGPU, or says why the processor draws. An adapter in software is slower than the processor. */
async function opened(isAskedFor) {
  if (!navigator.gpu) return [null, 'no WebGPU'];
  try {
    const found = await navigator.gpu.requestAdapter();
    if (!found) return [null, 'no adapter'];
    const { vendor, architecture, device, description, isFallbackAdapter } = found.info ?? {};
    // Browsers leave out what they do not tell.
    adapter = [vendor, architecture, device, description].filter(Boolean).join(' ') || 'an adapter without a name';
    const isSoftware = isFallbackAdapter || found.isFallbackAdapter || /swiftshader|llvmpipe/i.test(adapter);
    if (isSoftware && !isAskedFor) return [null, 'an adapter in software alone'];
    return [await module.Device.open(), ''];
  } catch (error) {
    return [null, error.message ?? `${error}`];
  }
}

/** Returns true until an address of the page's own is revoked. */
function isThere(address) {
  const request = new XMLHttpRequest();
  try {
    request.open('GET', address, false);
    request.send();
  } catch {
    return false;
  }
  return request.status === 200;
}

/** True if the call that is under way was cancelled. */
let isCancelled = false;

/**
 * Returns a function that says whether work is to end. A worker receives no message while it works, but it sees that an
 * address is revoked.
 *
 * - `signals`: addresses that are there until the sampling, or the drawing, is to end.
 */
function asker(signals) {
  if (!signals || !hasSignals) return undefined;
  return (isDrawing) => (isCancelled = !isThere(signals[isDrawing ? 1 : 0]));
}

/** The parts of a path without `.` and `..`, but for those that leave its first folder. */
function plain(path) {
  const parts = [];
  for (const part of path.replaceAll('\\', '/').split('/')) {
    if (part === '..' && parts.length && parts.at(-1) !== '..') parts.pop();
    else if (part !== '.' && part !== '') parts.push(part);
  }
  return parts.join('/');
}

/** The address of a file that another one at `base` names; undefined if it lies on another server. */
function addressed(path, base) {
  const name = path.replaceAll('\\', '/');
  // A name is a path, and has no query and no fragment; some files give whole addresses.
  const isAddress = /^[a-z][a-z\d+.-]+:\//i.test(name);
  const address = new URL(isAddress ? name : name.split('/').map(encodeURIComponent).join('/'), base);
  return address.origin === new URL(base).origin ? address : undefined;
}

/** A file in the form that the module reads, a range at a time. */
function ranged(file) {
  const bytes = (blob) => new Uint8Array(new FileReaderSync().readAsArrayBuffer(blob));
  return { size: file.size, read: (from, length) => bytes(file.slice(from, from + length)) };
}

/** Returns a function that reads other files: of those given, or from the same address. */
function reader(files, base) {
  const named = new Map(files.map(({ name, file }) => [plain(name), file]));
  const last = (path) => plain(path).split('/').pop();
  // Files that are picked one by one have lost their folders; in a folder, another's file of the same name is not meant.
  const isFlat = !base && files.every(({ name }) => plain(name) === last(name));
  return (path) => {
    const same = isFlat ? files.filter(({ name }) => plain(name) === last(path)) : [];
    const given = named.get(plain(path)) ?? (same.length === 1 ? same[0].file : undefined);
    if (given) return ranged(given);
    if (!base) return undefined;
    const request = new XMLHttpRequest();
    try {
      const address = addressed(path, base);
      if (!address) return undefined;
      request.open('GET', address, false);
      request.responseType = 'arraybuffer';
      request.send();
    } catch {
      return undefined;
    }
    return request.status === 200 ? new Uint8Array(request.response) : undefined;
  };
}

const calls = {
  start,

  /** Opens one of several files. */
  open({ name, files, base, settings }) {
    close();
    const beside = reader(files, base);
    const main = files.find((file) => file.name === name).file;
    scene = module.Scene.open(name, ranged(main), JSON.stringify(settings), beside);
    if (device) scene.on(device);
    return { ...JSON.parse(scene.about), memory: module.memoryBytes() };
  },

  /** Draws a picture or columns. */
  async draw({ columns, request, isNew, signals }) {
    forget();
    if (isNew) scene.renew();
    const begun = performance.now();
    const text = JSON.stringify(request);
    last = columns ? scene.columns(text, asker(signals)) : await scene.render(text, asker(signals));
    const pixels = last.pixels();
    const about = JSON.parse(last.about);
    return { pixels, about, size: request.size, ms: performance.now() - begun, memory: module.memoryBytes() };
  },

  /** Measures the error of the last picture. */
  measure({ signals }) {
    const measured = scene.measure(asker(signals));
    return measured ? JSON.parse(measured) : null;
  },

  /** The function of the last picture, and the counts of values over its range. */
  function({ bins }) {
    const text = scene.function();
    return text ? { function: JSON.parse(text), counts: scene.histogram(bins) } : null;
  },

  /** A colour map as a function over 0 to 1. */
  map({ name }) {
    return JSON.parse(module.mapFunction(name));
  },

  png() {
    return last.png();
  },

  floats() {
    return last.floats?.() ?? last.values();
  },

  memory() {
    return module.memoryBytes();
  },
};

function forget() {
  last?.free();
  last = undefined;
}

/** Frees the data. */
function close() {
  forget();
  scene?.free();
  scene = undefined;
}

/** What the page says of an error, and whether the module has stopped: then it is not used again. */
function described(error) {
  const stopped = error instanceof WebAssembly.RuntimeError;
  const text = stopped
    ? `the program has stopped: ${globalThis.panicked ?? 'most likely the data do not fit into 4 GiB, the most that a page has'}`
    : error?.message ?? `${error}`;
  return { error: text, stopped, cancelled: isCancelled && !stopped };
}

let queue = Promise.resolve();
/** The call that is under way. */
let running;
onmessage = ({ data: { id, call, ...given } }) => {
  queue = queue.then(async () => {
    running = id;
    isCancelled = false;
    try {
      const found = await calls[call](given);
      const moved = [found, found?.pixels].filter((bytes) => ArrayBuffer.isView(bytes));
      postMessage({ id, found }, moved.map((bytes) => bytes.buffer));
    } catch (error) {
      postMessage({ id, ...described(error) });
    }
    running = undefined;
  });
};

// A module that stops while it draws does so in a task of its own: the promise of the call never settles.
function stop(event, error) {
  event.preventDefault();
  postMessage({ id: running, ...described(error), stopped: true });
}
addEventListener('error', (event) => stop(event, event.error ?? event.message));
addEventListener('unhandledrejection', (event) => stop(event, event.reason));
