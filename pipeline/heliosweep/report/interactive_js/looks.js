// Colours of the page, light or dark, for what Bokeh draws on its canvas.

const dark = window.matchMedia('(prefers-color-scheme: dark)');
const touch = window.matchMedia('(pointer: coarse)');
const DASHES = ['solid', [6, 3], [2, 2], [8, 2, 2, 2], [12, 3], [4, 2]];
const MARKS = ['circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'plus', 'x'];

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { ink: of('--ink'), quiet: of('--quiet'), line: of('--line'), paper: of('--paper') };
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

// Colour of a line among so many: those of the figures for a few, a scale for many.
function lineLook(i, count) {
  const few = data.palettes.lines;
  if (count <= few.length + 1) {
    return { color: i < few.length ? few[i] : colours().ink, dash: DASHES[i % DASHES.length], mark: MARKS[i % MARKS.length] };
  }
  const scale = data.palettes.values;
  const ends = dark.matches ? [0.25, 1] : [0, 0.88];
  const at = ends[0] + (ends[1] - ends[0]) * i / (count - 1);
  return { color: scale[Math.round(at * (scale.length - 1))], dash: 'solid', mark: MARKS[0] };
}

// A figure with the same tools for all; the page shall scroll where a finger or a wheel moves over it.
function newFigure(attributes, tooltips, label) {
  const figure = new Bokeh.Plotting.figure({
    tools: 'box_zoom,pan,wheel_zoom,reset,save', active_drag: touch.matches ? null : 'box_zoom', active_scroll: null,
    toolbar_location: 'above', sizing_mode: 'stretch_width', height: 420, min_border_right: 12, ...attributes,
  });
  figure.toolbar.logo = null;
  const hover = new Bokeh.HoverTool({ tooltips, ...label });
  figure.add_tools(hover);
  dress(figure);
  return { figure, hover };
}
