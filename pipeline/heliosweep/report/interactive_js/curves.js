// Curves over a dimension, and points in a plane: a line for each value of another dimension.

const MARKED = 80;

class Curves {
  constructor(switches, place) {
    this.switches = switches;
    this.view = switches.view;
    this.plane = this.view.kind === 'plane';
    this.hidden = new Set();
    this.place = place;
    this.keys = place.parentElement.querySelector('.keys');
    this.open();
  }

  open() {
    this.lines = [];
    this.logarithmic = this.isGeometric();
    const aspect = this.plane ? { match_aspect: true } : {};
    const made = newFigure({ x_axis_type: this.logarithmic ? 'log' : 'linear', ...aspect }, [['', '@line'], ['', '@along'], ['', '@text']]);
    Object.assign(this, made);
    // Where nothing has a value, axes need something to stand on.
    this.nothing = new Bokeh.ColumnDataSource({ data: { x: [], y: [] } });
    this.figure.scatter({ field: 'x' }, { field: 'y' }, { source: this.nothing, fill_color: null, line_color: null });
    if (this.plane && this.view.outline) this.outline();
    this.fit();
    this.update();
    this.ready = show(this);
  }

  outline() {
    const [width, height] = this.view.outline;
    this.frame = this.figure.rect([0], [0], [width], [height], { fill_color: null, line_color: colours().ink, line_width: 1.5, line_dash: 'dashed' });
    // Points far off the aperture must not make it vanish: at first, only its surroundings are seen.
    const { shown, array } = this.switches;
    const far = [...decoded(array), ...decoded(this.view.arrays[shown.against])].map(Math.abs).filter(Number.isFinite).sort((a, b) => a - b);
    const most = Math.max(width, height);
    const side = Math.min(3 * most, Math.max(1.3 * most, 2.2 * (far[Math.floor(0.9 * far.length)] || 0)));
    const around = this.figure.rect([0], [0], [side], [side], { fill_color: null, line_color: null });
    for (const range of [this.figure.x_range, this.figure.y_range]) range.renderers = [around];
  }

  fit() {
    const width = this.place.clientWidth || 600;
    const height = this.plane ? Math.round(Math.min(width, 620)) : Math.round(Math.min(440, Math.max(300, 0.55 * width)));
    if (this.figure.height !== height) this.figure.height = height;
  }

  isGeometric() {
    const { values, kind } = this.view.dims[this.switches.along];
    if (this.plane || !this.view.dims[this.switches.along].joined || kind !== 'number' || values.length < 3 || !(Math.min(...values) > 0)) return false;
    const ratios = values.slice(1).map((value, i) => value / values[i]);
    return Math.max(...values) >= 10 * Math.min(...values) && ratios.every((ratio) => Math.abs(ratio / ratios[0] - 1) < 1e-4);
  }

  line(i) {
    while (this.lines.length <= i) {
      const source = new Bokeh.ColumnDataSource({ data: { x: [], y: [], line: [], along: [], text: [] } });
      // Of its own: a line is not drawn while a point of its source is pointed at.
      const whole = new Bokeh.ColumnDataSource({ data: { x: [], y: [] } });
      const path = this.figure.line({ field: 'x' }, { field: 'y' }, { source: whole, line_width: 1.8 });
      const marks = this.figure.scatter({ field: 'x' }, { field: 'y' }, { source, size: 6 });
      this.lines.push({ source, whole, path, marks });
    }
    return this.lines[i];
  }

  // Places along the axis in increasing order: words are numbered, numbers and dates are their values.
  get axis() {
    const dim = this.view.dims[this.switches.along];
    const values = dim.values || dim.texts.map((_, i) => i);
    return { dim, values, order: values.map((_, i) => i).sort((a, b) => values[a] - values[b]) };
  }

  update() {
    if (this.isGeometric() !== this.logarithmic) {
      this.place.replaceChildren();
      this.open();
      return;
    }
    const { switches, view } = this;
    const { dim, values, order } = this.axis;
    const names = switches.lines ? view.dims[switches.lines].texts : [''];
    const unit = switches.shown.unit;
    const all = [];
    names.forEach((name, i) => {
      const { source, whole, path, marks } = this.line(i);
      const at = switches.lines ? { ...switches.at, [switches.lines]: i } : switches.at;
      const y = switches.values([switches.along], at);
      const x = this.plane ? slice(view.arrays[switches.shown.against], [switches.along], at) : values;
      source.data = {
        x: Float64Array.from(order, (k) => x[k]), y: Float64Array.from(order, (k) => y[k]),
        line: order.map(() => name || switches.place_text || switches.shown.title), along: order.map((k) => `${dim.title} ${dim.texts[k]}`),
        text: order.map((k) => (this.plane ? `${text(x[k], unit)}, ${text(y[k], unit)}` : text(y[k], unit))),
      };
      whole.data = { x: source.data.x, y: source.data.y };
      const shown = !this.hidden.has(name);
      const { color, dash, mark } = this.look(i, names);
      path.glyph.setv({ line_color: color, line_dash: dash });
      const alpha = order.length <= MARKED || !dim.joined ? 1 : 0;
      marks.glyph.setv({ fill_color: color, line_color: color, marker: mark, fill_alpha: alpha, line_alpha: alpha });
      path.visible = shown && dim.joined;
      marks.visible = shown;
      if (shown) all.push(...y);
    });
    this.lines.slice(names.length).forEach(({ path, marks }) => { path.visible = marks.visible = false; });
    const shown = this.lines.slice(0, names.length);
    this.hover.renderers = shown.map(({ marks }) => marks);
    this.axes(dim);
    this.legend(names, switches.lines);
    const found = extent(all);
    const ends = extent(this.plane ? [0, 1] : values);
    this.nothing.data = found ? { x: [], y: [] } : { x: [ends.low, ends.high], y: [0, 1] };
    const range = found ? `${text(found.low, unit)} to ${text(found.high, unit)}` : 'no value';
    this.said = [switches.place_text, range].filter(Boolean).join(': ');
  }

  look(i, names) {
    const { colours: known } = this.view;
    return lineLook(i, names.length, Object.hasOwn(known, names[i]) && known[names[i]]);
  }

  name() {
    const { shown, along, label } = this.switches;
    relabel(this, this.plane ? this.view.labels[shown.against] : this.view.dims[along].label, label);
  }

  axes(dim) {
    const x = this.figure.xaxes[0];
    this.folds = 0;
    this.name();
    if (this.plane || this.logarithmic) return;
    if (dim.kind === 'word') {
      const step = Math.ceil(dim.texts.length / 13);
      const ticks = dim.texts.map((_, i) => i).filter((i) => i % step === 0);
      x.setv({
        ticker: new Bokeh.FixedTicker({ ticks }), formatter: new Bokeh.BasicTickFormatter(),
        major_label_overrides: new Map(ticks.map((i) => [i, dim.texts[i]])), major_label_orientation: dim.texts.length > 5 ? 0.7 : 'horizontal',
      });
    } else if (!dim.joined) {
      const step = Math.ceil(dim.values.length / 13);
      const ticks = dim.values.filter((_, i) => i % step === 0);
      x.setv({
        ticker: new Bokeh.FixedTicker({ ticks }), formatter: new Bokeh.BasicTickFormatter(),
        major_label_overrides: new Map(), major_label_orientation: 'horizontal',
      });
    } else {
      const date = dim.kind === 'date';
      x.setv({
        ticker: date ? new Bokeh.DatetimeTicker() : new Bokeh.BasicTicker(), major_label_overrides: new Map(), major_label_orientation: 'horizontal',
        formatter: date ? new Bokeh.DatetimeTickFormatter() : new Bokeh.BasicTickFormatter(),
      });
    }
    this.figure.xgrids[0].ticker = x.ticker;
  }

  // Below the plot, where narrow pages have room: a button for each line hides it and shows it again.
  legend(names, dim) {
    const told = dim ? names : [];
    const { joined } = this.axis.dim;
    const telling = [...told, dark.matches, joined].join('\n');
    if (this.told === telling) return;
    this.told = telling;
    const about = make('span', { class: 'about-lines' }, dim ? `${this.view.dims[dim].title}:` : '');
    this.keys.replaceChildren(about, ...told.map((name, i) => {
      const button = make('button', { type: 'button', 'aria-pressed': `${!this.hidden.has(name)}` }, swatch(this.look(i, names), joined), name);
      button.addEventListener('click', () => {
        if (!this.hidden.delete(name)) this.hidden.add(name);
        button.setAttribute('aria-pressed', `${!this.hidden.has(name)}`);
        this.update();
        this.after();
      });
      return button;
    }));
    this.keys.setAttribute('role', 'group');
    this.keys.setAttribute('aria-label', 'Lines: press to hide or show');
  }

  table() {
    const { switches } = this;
    const { dim, order } = this.axis;
    const names = switches.lines ? this.view.dims[switches.lines].texts : [switches.label];
    const texts = names.map((_, i) => this.lines[i].source.data.text);
    return { head: [dim.label, ...names], rows: order.map((k, i) => [dim.texts[k], ...texts.map((column) => column[i])]) };
  }

  dress() {
    dress(this.figure);
    if (this.frame) this.frame.glyph.line_color = colours().ink;
    this.update();
  }
}
