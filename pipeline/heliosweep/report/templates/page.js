// What Bokeh cannot do in a page without a server and without `eval`: choose the numbers that a plot shows and say them
// in words and as a table. Figures, axes, colours, scales and the tools behind the keys are made in Python.
const MOST_ROWS = 500;
const plots = JSON.parse(document.getElementById('heliosweep-plots').textContent);

function words(value, unit = '') {
  if (!Number.isFinite(value)) return '\u2013';
  const size = Math.abs(value);
  const number = size && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : String(Number(value.toPrecision(5)));
  return number.replace('-', '\u2212') + (unit && !unit.startsWith('\u00b0') ? '\u00a0' : '') + unit;
}

// Draw the plot of a view: its figure has a tag, `spec`, with all that it can show; the switches choose from that.
async function show(view) {
  const item = plots[view.id];
  if (!item) return;
  delete plots[view.id];
  await Bokeh.embed.embed_item(item);
  const { model: figure } = Bokeh.index.find_one_by_id(item.root_id);
  const [spec] = figure.tags, wide = Number(view.clientWidth > 560);
  const named = (name) => figure.document.get_model_by_name(name);
  const find = (selector) => view.querySelector(selector);
  const controls = find('.switches').elements;

  // Numbers along some dimensions, the last of which runs fastest, where the switches stand.
  function slice({ dims, strides, values }, along, at) {
    let places = [0];
    for (const dim of [...dims.filter((one) => !along.includes(one)), ...along]) {
      const steps = along.includes(dim) ? spec.dims[dim].texts.map((_, k) => k) : [at[dim] || 0];
      places = places.flatMap((from) => steps.map((k) => from + k * (strides[dim] || 0)));
    }
    return Float64Array.from(places, (from) => values[from]);
  }

  // Offer what the quantity has, and take what was chosen before, what is preferred, or the first.
  function offer(control, values, preferred) {
    for (const option of control.options) option.hidden = option.disabled = !values.includes(option.value);
    control.parentElement.hidden = values.length < 2;
    return control.value = [control.dataset.chosen, ...preferred, ...values].find((value) => values.includes(value));
  }

  // What the switches ask for; those that say nothing about the quantity are hidden.
  function asked() {
    const quantity = spec.quantities[controls.quantity.value], { dims } = quantity, at = {}, where = [];
    let drawn = spec.along;
    if (controls.along) {
      const along = offer(controls.along, drawn.filter((dim) => dims.includes(dim)), []);
      const more = dims.filter((dim) => dim !== along && spec.dims[dim].looks);
      drawn = [along, offer(controls.lines, ['', ...more], [...spec.lines, ''])].filter(Boolean);
    }
    for (const control of [...controls].filter((one) => one.dataset.dim)) {
      const { dim } = control.dataset, { prefix, texts } = spec.dims[dim], text = texts[control.value];
      control.parentElement.hidden = !dims.includes(dim) || drawn.includes(dim);
      if (control.name === 'less') continue;
      at[dim] = Number(control.value);
      control.ariaValueText = text;
      if (control.nextElementSibling) control.nextElementSibling.value = text;
      if (!control.parentElement.hidden) where.push(prefix + text);
    }
    const less = dims.includes(spec.less) ? Number(controls.less.value) : 0, shown = quantity.shown[less];
    const values = slice(quantity, drawn, at), across = quantity.across && slice(quantity.across, drawn, at);
    if (less) slice(quantity, drawn, { ...at, [spec.less]: less - 1 }).forEach((other, i) => { values[i] -= other; });
    const said = Array.from(values, (value) => words(value, shown.unit));
    const texts = across ? said.map((text, i) => `${words(across[i], shown.unit)}, ${text}`) : said;
    const names = drawn[1] ? spec.dims[drawn[1]].texts : [shown.label];
    return { quantity, drawn, at, values, across, shown, texts, names, where: where.join(', ') };
  }

  // Mirrors or pixels in the colours of their values.
  function colour({ drawn, at, values, shown, texts }, [low, high]) {
    const mapper = named('mapper'), source = named('source');
    if (controls.scale.value === 'all' || low > high) ({ low, high } = shown);
    const { signed } = shown, end = Math.max(-low, high);
    if (signed) [low, high] = [-end, end]; // zero in the middle
    const size = Math.max(Math.abs(low), Math.abs(high)), alike = high - low <= 1e-9 * size;
    const room = alike ? 0.01 * size || 0.5 : 0;
    mapper.setv({ palette: mapper.tags[signed ? 1 : 0], low: low - room, high: high + room });
    named('bar').title = shown.folded[2 * wide];
    const across = spec.dims[drawn[1]];
    if (across) figure.below[0].axis_label = across.folded[2 * wide];
    if (source.data.image) source.data.image[0].set(values);
    else {
      const places = Object.entries(spec.places).map(([side, array]) => [side, slice(array, drawn, at)]);
      source.data = { ...Object.fromEntries(places), name: spec.dims[drawn[0]].texts, value: values, text: texts };
    }
    source.change.emit();
  }

  // A line for each value of a dimension; and the axis that they run along.
  function curves({ quantity, drawn: [along, lines], values, across, shown, texts, names, where }, seen, told) {
    const dim = spec.dims[along];
    view.classList.toggle('joined', dim.joined);
    for (let i = 0; i < spec.most; i++) {
      const path = named(`path-${i}`), marks = named(`marks-${i}`), own = (_, k) => k % names.length === i;
      const { color, dash, mark } = lines && spec.dims[lines].looks[i] || spec.look, name = lines ? names[i] : where;
      path.visible = Boolean(seen[i] && dim.joined);
      marks.visible = Boolean(seen[i]);
      if (i >= names.length) continue;
      path.glyph.setv({ line_color: color, line_dash: dash });
      marks.glyph.setv({ marker: mark, fill_color: color, line_color: color, size: dim.size });
      path.data_source.data = {
        x: across ? across.filter(own) : dim.at, y: values.filter(own), text: texts.filter(own),
        line: dim.texts.map(() => name || quantity.title), along: dim.texts.map((text) => dim.prefix + text),
      };
    }
    for (const part of [...figure.below, ...figure.center]) part.visible = !part.name || part.name === along;
    figure.below.find((one) => one.visible).axis_label = (quantity.across || dim).folded[2 * wide];
    figure.left[0].axis_label = shown.folded[wide];
    // Where nothing has a value, axes need something to stand on.
    named('nothing').data_source.data = told.length ? { x: [], y: [] } : { x: [dim.at[0], dim.at.at(-1)], y: [0, 1] };
  }

  function tabulate({ drawn: [down], texts, names }) {
    const data = named('source')?.data, { label, texts: rows } = spec.dims[down], columns = [[label, (i) => rows[i]]];
    for (const [side, head] of spec.sides) columns.push([head, (i) => words(Math.round(10 * data[side][i]) / 10)]);
    // Of pixels some: nobody reads ten thousand.
    for (let j = 0; j < names.length; j += spec.steps[1]) columns.push([names[j], (i) => texts[i * names.length + j]]);
    const told = [...rows.keys()].filter((i) => i % spec.steps[0] === 0 && !Number.isNaN(data?.x?.[i]));
    const fill = (part, kind, lines) => find(part).replaceChildren(...lines.map((cells) => {
      const row = document.createElement('tr');
      for (const cell of cells) row.appendChild(document.createElement(kind)).textContent = cell;
      return row;
    }));
    fill('thead', 'th', [columns.map(([head]) => head)]);
    fill('tbody', 'td', told.slice(0, MOST_ROWS).map((i) => columns.map(([, cell]) => cell(i))));
    find('.values p').hidden = told.length <= MOST_ROWS;
  }

  function update() {
    const now = asked(), { quantity, drawn: [along, lines], values, shown, names, where } = now;
    for (const keys of view.querySelectorAll('.keys')) keys.hidden = keys.dataset.dim !== lines;
    const boxes = view.querySelectorAll('.keys:not([hidden]) input');
    const seen = names.map((_, i) => boxes[i]?.checked !== false);
    const told = values.filter((value, k) => Number.isFinite(value) && seen[k % names.length]);
    const ends = told.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
    if (spec.most) curves(now, seen, told); else colour(now, ends);
    const mean = words(told.reduce((a, b) => a + b, 0) / told.length, shown.unit);
    const more = spec.most ? '' : `, mean ${mean} of ${told.length.toLocaleString('en')} ${spec.what}`;
    const range = told.length ? ends.map((end) => words(end, shown.unit)).join(' to ') + more : 'no value';
    find('.said').textContent = [where, range].filter(Boolean).join(': ');
    if (spec.named) find('h3').textContent = `${quantity.heading} over ${spec.dims[along].title}`;
    find('.plot').ariaLabel = `${find('h3').textContent}: ${shown.label}, ${find('.said').textContent}`;
    if (find('details').open) tabulate(now);
  }

  if (matchMedia('(pointer: coarse)').matches) named('zoom').active = false; // a finger scrolls the page
  view.addEventListener('input', ({ target }) => { target.dataset.chosen = target.value; update(); });
  find('details').addEventListener('toggle', update);
  find('.plot').addEventListener('keydown', (event) => {
    const tool = !event.ctrlKey && !event.metaKey && !event.altKey && named(event.key);
    if (tool?.do) { tool.do.emit(); event.preventDefault(); }
  });
  // Colours are those of the page: Bokeh reads them from the style sheet when it paints, but for the bar.
  const dress = () => {
    const { color } = getComputedStyle(view);
    named('bar')?.setv({ title_text_color: color, major_label_text_color: color, major_tick_line_color: color });
    figure.change.emit();
  };
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', dress);
  dress();
  update();
  view.dataset.ready = true;
}

const views = document.querySelectorAll('figure.view');
const sight = new IntersectionObserver((seen) => {
  for (const { target, isIntersecting } of seen) if (isIntersecting) show(target);
}, { rootMargin: '300px' });
views.forEach((view) => sight.observe(view));
// Who prints without scrolling gets every plot: they are drawn when there is time, one after the other.
const rest = [...views], idle = window.requestIdleCallback ?? setTimeout;
const next = async () => { if (rest.length) { await show(rest.shift()); idle(next); } };
idle(next);
addEventListener('beforeprint', () => views.forEach(show));
