// Maps of heliostats and pictures of pixels, coloured by a value.

class Coloured {
  constructor(switches, place) {
    this.switches = switches;
    this.view = switches.view;
    this.place = place;
    this.mapper = new Bokeh.LinearColorMapper({ palette: data.palettes.values, low: 0, high: 1, nan_color: data.palettes.none[0] });
    this.open();
  }

  async show(attributes, rows) {
    const made = newFigure({ match_aspect: true, ...attributes }, rows);
    this.figure = made.figure;
    this.figure.toolbar.tools.find((tool) => tool.type === 'BoxZoomTool').match_aspect = true;
    this.draw();
    this.bar = new Bokeh.ColorBar({ color_mapper: this.mapper, height: 10, width: 'auto', padding: 8, margin: 0, title: '', title_standoff: 6 });
    this.figure.add_layout(this.bar, 'below');
    dressBar(this.bar);
    this.update();
    this.fit();
    await show(this);
  }

  // High enough for its width, yet not higher than a screen.
  fit() {
    const width = this.place.clientWidth || 600;
    const height = Math.round(Math.min(Math.max(this.aspect * (width - 70), 180), 560) + 130);
    if (this.figure.height !== height) this.figure.height = height;
  }

  scale(values) {
    const { switches } = this;
    let ends;
    if (switches.differs) {
      const all = switches.scale === 'one' ? values : this.differences();
      const end = Math.max(...['low', 'high'].map((name) => Math.abs((extent(all) || { [name]: 1 })[name] || 0)), 1e-9);
      ends = [-end, end];
    } else {
      const found = extent(switches.scale === 'one' ? values : decoded(switches.array)) || { low: 0, high: 1 };
      ends = found.low < found.high ? [found.low, found.high] : [found.low - 0.5, found.high + 0.5];
    }
    this.mapper.setv({ palette: switches.differs ? data.palettes.differences : data.palettes.values, low: ends[0], high: ends[1] });
  }

  // Of all points of the sweep.
  differences() {
    const { array, view, less } = this.switches;
    const whole = decoded(array);
    const other = slice(array, array.dims.filter((dim) => dim !== view.less), { [view.less]: +less });
    const inner = array.shape.slice(array.dims.indexOf(view.less) + 1).reduce((a, b) => a * b, 1);
    const length = array.shape[array.dims.indexOf(view.less)];
    return whole.map((value, i) => value - other[Math.floor(i / (inner * length)) * inner + i % inner]);
  }

  update() {
    const { switches } = this;
    const values = switches.values(this.along);
    this.scale(values);
    this.fill(values);
    this.folds = 0;
    this.name();
    const found = extent(values);
    const { unit } = switches;
    const range = found
      ? `${text(found.low, unit)} to ${text(found.high, unit)}, mean ${text(found.mean, unit)} of ${found.count.toLocaleString('en')} ${this.what}`
      : 'no value';
    this.said = [switches.place_text, range].filter(Boolean).join(': ');
  }

  name() { relabel(this, ...this.titles); }

  dress() {
    dress(this.figure);
    dressBar(this.bar);
  }
}

class Field extends Coloured {
  open() {
    this.along = this.view.along;
    this.what = 'heliostats';
    this.source = new Bokeh.ColumnDataSource({ data: {} });
    const [x, y] = ['x', 'y'].map((name) => extent(decoded(this.view.arrays[`place_${name}`])) || { low: 0, high: 1 });
    this.aspect = Math.min(1.2, Math.max(0.4, (Math.max(y.high, 0) - Math.min(y.low, 0)) / (Math.max(x.high, 0) - Math.min(x.low, 0) || 1)));
    this.titles = ['east (m)', 'north (m)'];
    this.ready = this.show({}, [['heliostat', '@name'], ['value', '@text'], ['east, north', '@place']]);
  }

  draw() {
    const { source, mapper } = this;
    this.squares = this.figure.rect({ field: 'x' }, { field: 'y' }, { field: 'width' }, { field: 'height' }, {
      source, angle: { field: 'angle' }, fill_color: { field: 'value', transform: mapper }, line_color: edge(), line_width: 0.4,
    });
    this.tower = this.figure.scatter([0], [0], { marker: 'triangle', size: 11, fill_color: colours().ink, line_color: colours().paper });
    this.figure.toolbar.tools.find((tool) => tool.type === 'HoverTool').renderers = [this.squares];
  }

  side(name, at, count) {
    const array = this.view.arrays[name];
    const values = slice(array, this.along, at);
    const wanted = values.length === count ? values : new Float64Array(count).fill(values[0]);
    return array.least ? wanted.map((value) => Math.max(value, array.least)) : wanted;
  }

  fill(values) {
    const { view, switches } = this;
    const { at, unit } = switches;
    const count = values.length;
    const [x, y, width, height] = ['x', 'y', 'width', 'height'].map((name) => this.side(view.places[name], at, count));
    const names = view.dims[this.along[0]] ? view.dims[this.along[0]].texts : [];
    this.source.data = {
      x, y, width, height,
      angle: x.map((east, i) => (east || y[i] ? Math.atan2(-east, y[i]) : 0)),
      value: values,
      name: Array.from(values, (_, i) => names[i] || `${i}`),
      text: Array.from(values, (value) => text(value, unit)),
      place: Array.from(x, (east, i) => `${text(Math.round(east * 10) / 10)}, ${text(Math.round(y[i] * 10) / 10, 'm')}`),
    };
  }

  table() {
    const { x, y, name, text: values } = this.source.data;
    const rows = Array.from(x, (_, i) => [name[i], text(Math.round(x[i] * 10) / 10), text(Math.round(y[i] * 10) / 10), values[i]]);
    return { head: ['heliostat', 'east (m)', 'north (m)', this.switches.label], rows: rows.filter((_, i) => Number.isFinite(x[i])) };
  }

  dress() {
    super.dress();
    this.squares.glyph.line_color = edge();
    this.tower.glyph.setv({ fill_color: colours().ink, line_color: colours().paper });
  }
}

class Raster extends Coloured {
  open() {
    this.along = this.view.along;
    this.what = 'pixels';
    const [rows, columns] = this.along.map((dim) => this.view.dims[dim]);
    this.sides = [columns, rows].map(({ values, texts }) => {
      const places = values || texts.map((_, i) => i);
      const step = places.length > 1 ? Math.abs(places[1] - places[0]) : 1;
      return { low: Math.min(...places) - step / 2, high: Math.max(...places) + step / 2, down: places.length > 1 && places[1] < places[0] };
    });
    const [across, up] = this.sides.map(({ low, high }) => high - low);
    this.aspect = up / across;
    this.source = new Bokeh.ColumnDataSource({ data: { image: [], text: [] } });
    this.titles = [columns.label, rows.label];
    this.ready = this.show({}, [['value', '@image'], ['at', '$x, $y']]);
  }

  draw() {
    const [x, y] = this.sides;
    this.figure.image({
      image: { field: 'image' }, source: this.source, x: x.low, y: y.low, dw: x.high - x.low, dh: y.high - y.low, color_mapper: this.mapper,
    });
  }

  fill(values) {
    const [rows, columns] = this.along.map((dim) => this.view.dims[dim].texts.length);
    const [x, y] = this.sides;
    const placed = new Float64Array(values.length);
    for (let i = 0; i < rows; i++) {
      for (let j = 0; j < columns; j++) {
        placed[(y.down ? rows - 1 - i : i) * columns + (x.down ? columns - 1 - j : j)] = values[i * columns + j];
      }
    }
    this.drawn = values;
    this.source.data = { image: [Bokeh.require('core/util/ndarray').ndarray(placed, { shape: [rows, columns], dtype: 'float64' })] };
  }

  // Every so many pixels: nobody reads ten thousand.
  table() {
    const [rows, columns] = this.along.map((dim) => this.view.dims[dim]);
    const some = (length, most) => Array.from({ length: Math.min(length, most) }, (_, i) => Math.round(i * (length - 1) / (Math.min(length, most) - 1 || 1)));
    const chosen = some(columns.texts.length, 9);
    return {
      head: [`${rows.label} \\ ${columns.label}`, ...chosen.map((j) => columns.texts[j])],
      rows: some(rows.texts.length, 15).map((i) => [rows.texts[i], ...chosen.map((j) => text(this.drawn[i * columns.texts.length + j], this.switches.unit))]),
    };
  }
}
