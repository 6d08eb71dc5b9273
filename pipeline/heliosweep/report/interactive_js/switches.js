// The switches of a view: native controls with labels, shown where the quantity has what they choose.

const MOST_LINES = 26;
const LONG = 12;

function make(name, attributes, ...content) {
  const found = document.createElement(name);
  for (const [key, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== undefined && value !== false) found.setAttribute(key, value === true ? '' : value);
  }
  found.append(...content);
  return found;
}

class Switches {
  constructor(view, place, key, changed) {
    Object.assign(this, { view, place, key, changed, rows: {} });
    this.quantity = 0;
    this.scale = 'all';
    this.less = '';
    this.at = {};
    for (const dim of Object.keys(view.dims)) this.at[dim] = view.start[dim] || 0;
    this.build();
    this.settle();
  }

  get shown() { return this.view.quantities[this.quantity]; }

  get array() { return this.view.arrays[this.shown.name]; }

  get curved() { return this.view.kind === 'curves' || this.view.kind === 'plane'; }

  // Dimensions that are drawn along.
  get drawn() { return this.curved ? [this.along, this.lines].filter(Boolean) : this.view.along; }

  build() {
    const { view } = this;
    this.select('quantity', 'Quantity', view.quantities.map((one, i) => [i, one.label]), (value) => { this.quantity = +value; });
    if (this.curved) {
      const dims = view.along.map((dim) => [dim, view.dims[dim] ? view.dims[dim].title : dim]);
      this.select('along', view.kind === 'plane' ? 'Along' : 'Over', dims, (value) => { this.along = this.wanted = value; });
      const more = Object.keys(view.dims).filter((dim) => view.dims[dim].texts.length <= MOST_LINES);
      this.select('lines', 'A line for each', [['', 'one line only'], ...more.map((dim) => [dim, view.dims[dim].title])],
        (value) => { this.lines = this.wantedLines = value; });
    }
    for (const [dim, { title, texts }] of Object.entries(view.dims)) {
      if (texts.length < 2 || (!this.curved && view.along.includes(dim))) continue;
      if (texts.length > LONG) this.range(dim, title, texts);
      else this.select(`dim-${dim}`, title, texts.map((one, i) => [i, one]), (value) => { this.at[dim] = +value; });
    }
    if (view.less && view.dims[view.less] && !this.curved) {
      const texts = view.dims[view.less].texts.map((one, i) => [i, one]);
      this.select('less', 'Difference from', [['', 'nothing'], ...texts], (value) => { this.less = value; });
    }
    if (!this.curved) {
      this.select('scale', 'Colours', [['all', 'one scale for all'], ['one', 'scale of this one']], (value) => { this.scale = value; });
    }
  }

  row(name, title, control, ...more) {
    control.id = `${this.key}-${name}`;
    const row = make('div', { class: 'switch' }, make('label', { for: control.id }, title), control, ...more);
    this.rows[name] = { row, control };
    this.place.append(row);
  }

  select(name, title, options, act) {
    const control = make('select', {}, ...options.map(([value, words]) => make('option', { value }, words)));
    control.addEventListener('change', () => { act(control.value); this.settle(); this.changed(); });
    this.row(name, title, control);
  }

  range(dim, title, texts) {
    const control = make('input', { type: 'range', min: 0, max: texts.length - 1, step: 1 });
    const output = make('output', { for: `${this.key}-dim-${dim}` });
    this.row(`dim-${dim}`, title, control, output);
    control.addEventListener('input', () => { this.at[dim] = +control.value; this.settle(); this.changed(); });
  }

  // Bring everything into line with the quantity: what is drawn along, and which switches there are.
  settle() {
    const { view } = this;
    const dims = this.array.dims;
    const preferred = (wanted, options) => options.find((dim) => dim === wanted) || options[0] || '';
    if (this.curved) {
      const along = view.along.filter((dim) => dims.includes(dim));
      this.along = preferred(this.wanted, along);
      const lines = dims.filter((dim) => dim !== this.along && view.dims[dim].texts.length <= MOST_LINES);
      if (this.wantedLines === undefined) {
        this.lines = view.lines.find((dim) => lines.includes(dim)) || '';
      } else this.lines = preferred(this.wantedLines, ['', ...lines]);
      this.offer('along', along);
      this.offer('lines', ['', ...lines]);
      this.rows.along.control.value = this.along;
      this.rows.lines.control.value = this.lines;
    }
    for (const [name, { row, control }] of Object.entries(this.rows)) {
      if (!name.startsWith('dim-')) continue;
      const dim = name.slice(4);
      row.hidden = !dims.includes(dim) || this.drawn.includes(dim);
      control.value = this.at[dim];
      if (control.type !== 'range') continue;
      row.querySelector('output').textContent = view.dims[dim].texts[this.at[dim]];
      control.setAttribute('aria-valuetext', view.dims[dim].texts[this.at[dim]]);
    }
    this.rows.quantity.row.hidden = view.quantities.length < 2;
    if (this.rows.less) this.rows.less.row.hidden = !dims.includes(view.less);
  }

  offer(name, values) {
    const { row, control } = this.rows[name];
    for (const option of control.options) option.hidden = option.disabled = !values.includes(option.value);
    row.hidden = values.length < 2;
  }

  get differs() { return this.less !== '' && this.array.dims.includes(this.view.less) && !this.curved; }

  // Values that are drawn, less those of another value where that was asked for.
  values(along, at = this.at) {
    const found = slice(this.array, along, at);
    if (!this.differs) return found;
    const other = slice(this.array, along, { ...at, [this.view.less]: +this.less });
    return found.map((value, i) => value - other[i]);
  }

  // Where the switches stand, in words.
  get place_text() {
    const { view } = this;
    return this.array.dims.filter((dim) => !this.drawn.includes(dim)).map((dim) => {
      const { title, texts, kind } = view.dims[dim];
      const words = texts[Math.min(this.at[dim], texts.length - 1)];
      return kind === 'word' ? words : `${title} ${words}`;
    }).join(', ');
  }

  // A difference of percentages is in points.
  get unit() {
    return this.differs && this.shown.unit === '%' ? 'percentage points' : this.shown.unit;
  }

  // What is drawn over what.
  get title() {
    const title = `${this.shown.title} over ${this.view.dims[this.along].title}`;
    return title[0].toUpperCase() + title.slice(1);
  }

  get label() {
    if (!this.differs) return this.shown.label;
    const points = this.unit ? ` (${this.unit})` : '';
    return `${this.shown.title}, less that of ${this.view.dims[this.view.less].texts[+this.less]}${points}`;
  }
}
