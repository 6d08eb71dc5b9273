// Colours of the page, light or dark, for what Bokeh draws on its canvas.

const dark = window.matchMedia('(prefers-color-scheme: dark)');
const touch = window.matchMedia('(pointer: coarse)');
const DASHES = ['solid', [6, 3], [2, 2], [8, 2, 2, 2], [12, 3], [4, 2]];
const OUTLINES = {
  circle: 'M-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0z', square: 'M-3-3h6v6h-6z', triangle: 'M0-3.5L3.5 3h-7z', diamond: 'M0-4L3 0L0 4L-3 0z',
  inverted_triangle: 'M0 3.5L3.5-3h-7z', plus: 'M-4 0h8M0-4v8', x: 'M-3-3L3 3M-3 3L3-3',
};
const MARKS = ['circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'plus', 'x'];

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { ink: of('--ink'), quiet: of('--quiet'), line: of('--line'), paper: of('--paper') };
}

// Of mirrors: the darkest and the palest would vanish without it.
function edge() {
  return dark.matches ? '#ffffff66' : '#00000055';
}

function dress(figure) {
  const { ink, quiet, line, paper } = colours();
  figure.setv({ background_fill_color: paper, border_fill_color: paper, outline_line_color: quiet });
  for (const axis of figure.axes) {
    axis.setv({
      axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: quiet,
      major_tick_line_color: quiet, minor_tick_line_color: null,
      axis_label_text_font_style: 'normal', axis_label_text_font: 'system-ui, sans-serif',
      major_label_text_font: 'system-ui, sans-serif', axis_label_text_font_size: '13px',
      major_label_text_font_size: '12px',
    });
  }
  for (const grid of figure.grids) grid.setv({ grid_line_color: line });
}

function dressBar(bar) {
  const { ink, paper } = colours();
  bar.setv({
    background_fill_color: paper, major_label_text_color: ink, title_text_color: ink, bar_line_color: null,
    major_tick_line_color: ink, title_text_font_style: 'normal', title_text_font: 'system-ui, sans-serif',
    title_text_font_size: '13px', major_label_text_font_size: '12px',
  });
}

// Colour of a line among so many: the one that is known for its name, else those of the figures for a few, a scale for many.
function lineLook(i, count, known) {
  const few = data.palettes.lines;
  if (known) return { color: known, dash: DASHES[i % DASHES.length], mark: MARKS[i % MARKS.length] };
  if (count <= few.length + 1) {
    return { color: i < few.length ? few[i] : colours().ink, dash: DASHES[i % DASHES.length], mark: MARKS[i % MARKS.length] };
  }
  const scale = data.palettes.values;
  const ends = dark.matches ? [0.25, 1] : [0, 0.88];
  const at = ends[0] + (ends[1] - ends[0]) * i / (count - 1);
  return { color: scale[Math.round(at * (scale.length - 1))], dash: 'solid', mark: MARKS[0] };
}

// Rows of what a hovering pointer tells; Bokeh escapes the values that it fills in.
function tip(rows) {
  return rows.map(([name, value]) => `<div><span style="color: var(--quiet)">${name}</span> ${value}</div>`).join('');
}

// A figure with the same tools for all; the page shall scroll where a finger or a wheel moves over it.
function newFigure(attributes, rows) {
  const figure = new Bokeh.Plotting.figure({
    tools: 'box_zoom,pan,wheel_zoom,reset,save', active_drag: touch.matches ? null : 'box_zoom', active_scroll: null,
    toolbar_location: 'above', sizing_mode: 'stretch_width', height: 420, min_border_right: 12, ...attributes,
  });
  figure.toolbar.logo = null;
  const hover = new Bokeh.HoverTool({ tooltips: tip(rows) });
  figure.add_tools(hover);
  dress(figure);
  return { figure, hover };
}

const pen = document.createElement('canvas').getContext('2d');
const MOST_FOLDS = 4;

// A label on several lines where it is longer than its axis, cut off where even those do not hold it. [pixel]
function folded(label, room) {
  pen.font = '13px system-ui, sans-serif';
  const fits = (words) => pen.measureText(words).width <= Math.max(room, 60);
  const cut = (words) => {
    let end = words.length;
    while (end > 1 && !fits(`${words.slice(0, end)}\u2026`)) end -= 1;
    return `${words.slice(0, end).trimEnd()}\u2026`;
  };
  const lines = [''];
  for (const word of label.split(/\s+/)) {
    const line = lines[lines.length - 1];
    if (line && !fits(`${line} ${word}`)) lines.push(word);
    else lines[lines.length - 1] = line ? `${line} ${word}` : word;
  }
  if (lines.length > MOST_FOLDS) lines.splice(MOST_FOLDS - 1, lines.length, cut(lines.slice(MOST_FOLDS - 1).join(' ')));
  return lines.map((line) => (fits(line) ? line : cut(line))).join('\n');
}

// Fold the labels of a plot: to its frame as measured, and until it is drawn to about what that will be.
function relabel(plot, across, up) {
  const { figure, place } = plot;
  const view = Bokeh.index.find_one(figure);
  const frame = view ? view.frame.bbox : {};
  const width = (frame.width || (place.clientWidth || 600) - 90) - 4;
  const height = (frame.height || figure.height - 110) - 4;
  for (const [axis, label, room] of [[figure.xaxes[0], across, width], [figure.yaxes[0], up, height]]) {
    const words = folded(label, room);
    if (axis.axis_label !== words) axis.axis_label = words;
  }
  const title = plot.bar ? folded(plot.switches.label, width - 16) : '';
  if (plot.bar && plot.bar.title !== title) plot.bar.title = title;
}

// The key of a line: its dashes, if it is one, and its mark.
function swatch({ color, dash, mark }, joined) {
  const draw = (name, attributes) => {
    const found = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, value);
    return found;
  };
  const svg = draw('svg', { class: 'swatch', viewBox: '0 0 32 10', width: 32, height: 10, 'aria-hidden': 'true' });
  const line = { stroke: color, 'stroke-width': 2, fill: 'none' };
  if (joined) svg.append(draw('path', { d: 'M0 5H32', ...line, ...(dash === 'solid' ? {} : { 'stroke-dasharray': dash.join(' ') }) }));
  else svg.append(draw('path', { d: OUTLINES[mark], ...line, fill: color, 'stroke-width': 1.5, transform: 'translate(16 5)' }));
  return svg;
}

// Show the figure of a plot in its place, which then moves and zooms by keys as well.
function show(plot) {
  const { place, figure } = plot;
  figure.toolbar.tools.find((tool) => tool.type === 'SaveTool').filename = plot.view.title;
  if (!plot.watched) {
    plot.watched = new ResizeObserver(() => { plot.folds = 0; plot.fit(); });
    plot.watched.observe(place);
    place.addEventListener('keydown', (event) => {
      if (event.target === place && !event.ctrlKey && !event.metaKey && !event.altKey && move(plot.figure, event.key)) event.preventDefault();
    });
  }
  // Folding a label changes the frame, so a few times at the most for each size; not while that is being laid out.
  plot.folds = 0;
  const measured = () => { if (plot.figure === figure && plot.folds++ < MOST_FOLDS) plot.name(); };
  for (const side of ['inner_width', 'inner_height']) figure.properties[side].change.connect(() => setTimeout(measured));
  return Bokeh.Plotting.show(figure, place);
}

const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };

function move(figure, key) {
  if (key === '0') figure.reset.emit();
  const zoom = { '+': 0.8, '=': 0.8, '-': 1.25 }[key];
  const step = MOVES[key];
  if (zoom || step) {
    [[figure.x_range, figure.x_scale], [figure.y_range, figure.y_scale]].forEach(([range, scale], i) => {
      const logarithmic = scale.type === 'LogScale';
      const [start, end] = [range.start, range.end].map((at) => (logarithmic ? Math.log(at) : at));
      const middle = (start + end) / 2 + (step ? 0.1 * step[i] * (end - start) : 0);
      const half = (end - start) / 2 * (zoom || 1);
      const [low, high] = [middle - half, middle + half].map((at) => (logarithmic ? Math.exp(at) : at));
      range.setv({ start: low, end: high });
    });
  }
  return Boolean(zoom || step || key === '0');
}
