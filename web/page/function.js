// Transfer functions: their scales, their parts, and the editor over the histogram.

/** Position of a value on a function's scale, 0 to 1 over its range. */
export function share(f, value) {
  const [low, high] = f.range.map((x) => position(f, x));
  return (position(f, value) - low) / (high - low);
}

/** The value at a share of the range. */
export function valueAt(f, share) {
  const [low, high] = f.range.map((x) => position(f, x));
  const at = low + (high - low) * share;
  if (f.scale === 'log') return 10 ** at;
  if (f.scale === 'symlog') return Math.sign(at) * within(f) * Math.expm1(Math.abs(at) * Math.LN10);
  return at;
}

function position(f, value) {
  if (f.scale === 'log') return Math.log10(value);
  if (f.scale === 'symlog') return (Math.sign(value) * Math.log1p(Math.abs(value) / within(f))) / Math.LN10;
  return value;
}

const within = (f) => f.linear_within ?? Math.max(...f.range.map(Math.abs)) / 1000;

/** Interpolates rows [share, numbers ...] at a share. */
function between(rows, at) {
  const next = rows.findIndex(([share]) => share >= at);
  if (next === -1) return rows.at(-1).slice(1);
  if (next === 0) return rows[0].slice(1);
  const [a, b] = [rows[next - 1], rows[next]];
  const t = b[0] > a[0] ? (at - a[0]) / (b[0] - a[0]) : 1;
  return a.slice(1).map((x, i) => x + (b[i + 1] - x) * t);
}

/** Colours and opacities of a function as rows by share of its range. */
export function parts(f) {
  const of = (key, numbers) => f.points.filter((p) => p[key] !== undefined).map((p) => [share(f, p.value), ...numbers(p)]);
  return { colours: of('color', (p) => p.color), opacities: of('opacity', (p) => [p.opacity]) };
}

/** A function of other parts. */
export function joined(f, { colours, opacities }) {
  const points = [
    ...colours.map(([at, ...color]) => ({ at, color })),
    ...opacities.map(([at, opacity]) => ({ at, opacity })),
  ];
  points.sort((a, b) => a.at - b.at);
  return {
    ...f,
    points: points.map(({ at, ...rest }) => ({ value: at <= 0 ? f.range[0] : at >= 1 ? f.range[1] : valueAt(f, at), ...rest })),
  };
}

/** The same function over another range. */
export function ranged(f, range) {
  const own = parts(f);
  const next = { ...f, range };
  if (f.scale === 'symlog') delete next.linear_within;
  return joined(next, own);
}

/** Drops points that are within an error of the line between their neighbours (Ramer, Douglas and Peucker). */
export function fewer(rows, error) {
  const keeps = new Set([0, rows.length - 1]);
  const spans = [[0, rows.length - 1]];
  while (spans.length) {
    const [first, last] = spans.pop();
    let [far, most] = [0, error];
    for (let i = first + 1; i < last; i++) {
      const off = Math.abs(between([rows[first], rows[last]], rows[i][0])[0] - rows[i][1]);
      if (off > most) [far, most] = [i, off];
    }
    if (far) {
      keeps.add(far);
      spans.push([first, far], [far, last]);
    }
  }
  return rows.filter((_, i) => keeps.has(i));
}

const code = (x) => Math.round(255 * Math.min(1, Math.max(0, x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055)));

/** Colour of a row for a style sheet. */
function css(f, rgb) {
  const [r, g, b] = f.color_space === 'linear' ? rgb.map(code) : rgb.map((x) => Math.round(255 * x));
  return `rgb(${r} ${g} ${b})`;
}

/** Four digits of a number. */
export const short = (x) => (x === 0 ? '0' : Number(x.toPrecision(4)).toString());

const NS = 'http://www.w3.org/2000/svg';
const [WIDTH, HEIGHT, BAR] = [300, 120, 14];

/** The editor: a histogram, the curve of opacities with its points, and the colours below. */
export class Editor {
  constructor(svg, { changed, describe }) {
    Object.assign(this, { svg, changed, describe, f: null });
    svg.setAttribute('viewBox', `-8 -8 ${WIDTH + 16} ${HEIGHT + BAR + 20}`);
    svg.addEventListener('dblclick', (event) => this.add(this.place(event)));
  }

  /** Shows a function and the counts of values. */
  show(f, counts) {
    this.f = f;
    this.counts = counts ?? this.counts;
    const own = parts(f);
    this.colours = own.colours;
    this.opacities = fewer(own.opacities, 0.004);
    if (this.opacities.length > 24) this.opacities = fewer(own.opacities, 0.02);
    this.draw();
  }

  place({ clientX, clientY }) {
    const at = new DOMPoint(clientX, clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    const clamp = (x) => Math.min(1, Math.max(0, x));
    return [clamp(at.x / WIDTH), this.opacity(clamp(1 - at.y / HEIGHT))];
  }

  // Opacities are small: the square root leaves room for them.
  height(opacity) {
    return Math.sqrt(Math.max(0, opacity));
  }

  opacity(height) {
    return height * height;
  }

  add([at, opacity]) {
    if (!this.f) return;
    const i = this.opacities.findIndex(([other]) => other > at);
    const index = i === -1 ? this.opacities.length - 1 : Math.max(i, 1);
    this.opacities.splice(index, 0, [at, opacity]);
    this.draw();
    this.tell();
    this.svg.querySelectorAll('circle')[index].focus();
  }

  remove(i) {
    if (i === 0 || i === this.opacities.length - 1) return;
    this.opacities.splice(i, 1);
    this.draw();
    this.tell();
    this.svg.querySelectorAll('circle')[Math.min(i, this.opacities.length - 1)].focus();
  }

  /** Moves a point; the ends stay at the ends, and points stay in their order. */
  move(i, [at, opacity]) {
    const rows = this.opacities;
    const isEnd = i === 0 || i === rows.length - 1;
    const own = isEnd ? rows[i][0] : Math.min(rows[i + 1][0], Math.max(rows[i - 1][0], at));
    rows[i] = [own, Math.min(1, Math.max(0, opacity))];
    this.draw(i);
    this.tell();
  }

  tell() {
    this.changed(joined(this.f, { colours: this.colours, opacities: this.opacities }));
  }

  draw(focused) {
    const make = (name, attributes) => {
      const element = document.createElementNS(NS, name);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      return element;
    };
    const active = focused ?? [...this.svg.querySelectorAll('circle')].indexOf(document.activeElement);
    const stops = this.colours.map(([at, ...rgb]) => make('stop', { offset: at, 'stop-color': css(this.f, rgb) }));
    const gradient = make('linearGradient', { id: 'colours' });
    gradient.append(...stops);
    const defs = make('defs', {});
    defs.append(gradient);
    const bars = make('path', { class: 'histogram', d: this.histogram() });
    const curve = this.opacities.map(([x, y]) => `${x * WIDTH},${(1 - this.height(y)) * HEIGHT}`).join(' ');
    const points = this.opacities.map(([x, y], i) => {
      const text = `${short(valueAt(this.f, x))}: opacity ${y.toFixed(3)}`;
      const point = make('circle', {
        cx: x * WIDTH, cy: (1 - this.height(y)) * HEIGHT, r: 5.5, tabindex: 0, role: 'slider',
        'aria-label': `Point ${i + 1} of ${this.opacities.length}`, 'aria-valuemin': 0, 'aria-valuemax': 1,
        'aria-valuenow': y.toFixed(3), 'aria-valuetext': text, 'aria-orientation': 'vertical',
      });
      const title = make('title', {});
      title.textContent = text;
      point.append(title);
      point.addEventListener('pointerdown', (event) => this.grip(event, i));
      point.addEventListener('dblclick', (event) => {
        event.stopPropagation();
        this.remove(i);
      });
      point.addEventListener('keydown', (event) => this.key(event, i));
      point.addEventListener('focus', () => this.describe(text));
      return point;
    });
    this.svg.replaceChildren(
      defs,
      make('rect', { class: 'field', width: WIDTH, height: HEIGHT }),
      bars,
      make('polyline', { class: 'under', points: curve }),
      make('polyline', { class: 'curve', points: curve }),
      make('rect', { y: HEIGHT + 4, width: WIDTH, height: BAR, fill: 'url(#colours)' }),
      ...points,
    );
    if (active >= 0) points[active]?.focus();
  }

  histogram() {
    const counts = this.counts ?? [];
    // Logarithms, or the most frequent value alone would show.
    const most = Math.log1p(Math.max(...counts, 1));
    const step = WIDTH / Math.max(counts.length, 1);
    const tops = [...counts].map((n, i) => {
      const y = HEIGHT * (1 - Math.log1p(n) / most);
      return `L${i * step},${y}L${(i + 1) * step},${y}`;
    });
    return `M0,${HEIGHT}${tops.join('')}L${WIDTH},${HEIGHT}Z`;
  }

  grip(event, i) {
    event.preventDefault();
    this.svg.setPointerCapture(event.pointerId);
    this.svg.querySelectorAll('circle')[i].focus();
    const moved = (event) => this.move(i, this.place(event));
    this.svg.addEventListener('pointermove', moved);
    const done = () => this.svg.removeEventListener('pointermove', moved);
    this.svg.addEventListener('pointerup', done, { once: true });
    this.svg.addEventListener('pointercancel', done, { once: true });
  }

  key(event, i) {
    const [x, y] = this.opacities[i];
    const step = event.shiftKey ? 0.002 : 0.02;
    const up = (by) => this.opacity(Math.min(1, Math.max(0, this.height(y) + by)));
    const moves = {
      ArrowLeft: [x - step, y], ArrowRight: [x + step, y], ArrowUp: [x, up(step)], ArrowDown: [x, up(-step)],
    };
    if (moves[event.key]) this.move(i, moves[event.key]);
    else if (event.key === 'Delete' || event.key === 'Backspace') this.remove(i);
    else if (event.key === 'Insert' || event.key === 'Enter') {
      const next = this.opacities[i + 1] ?? this.opacities[i - 1];
      this.add([(x + next[0]) / 2, (y + next[1]) / 2]);
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
