// Show the selected variable at the selected values. Bokeh runs this script at the start and after each selection.
const quantity = quantities[choose.value];
const at = {};
for (const [dim, select] of Object.entries(selects)) {
  select.visible = quantity.dims.includes(dim);
  at[dim] = Number(select.value);
}
const words = (value, unit) => {
  if (!Number.isFinite(value)) return '\u2013';
  const size = Math.abs(value);
  const text = size && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : String(Number(value.toPrecision(5)));
  return text.replace('-', '\u2212') + (unit && !unit.startsWith('\u00b0') ? '\u00a0' : '') + unit;
};
// Return the values along the given dimensions; the last dimension varies fastest.
const slice = ({ strides, values }, along, fixed) => {
  let places = [0];
  for (const [dim, index] of Object.entries(fixed)) if (dim in strides && !along.includes(dim)) places[0] += index * strides[dim];
  for (const dim of along) {
    const count = dims[dim].texts.length;
    places = places.flatMap((from) => Array.from({ length: count }, (_, k) => from + k * (strides[dim] ?? 0)));
  }
  return places.map((place) => values[place]);
};
let values = [];
if (kind === 'curves' || kind === 'plane') {
  sources.forEach((source, k) => {
    const fixed = line ? { ...at, [line]: k } : at;
    const y = slice(quantity, axes, fixed);
    const x = kind === 'plane' ? slice(quantity.across, axes, fixed) : Array.from(dims[axes[0]].at);
    const names = axes.length ? dims[axes[0]].texts : [''];
    const text = y.map((value, i) => {
      const where = kind === 'plane' ? `${words(x[i], quantity.unit)}, ${words(value, quantity.unit)}` : words(value, quantity.unit);
      return [source.name, names[i % names.length], where].filter(Boolean).join(' \u00b7 ');
    });
    source.data = { x, y, text };
    values = values.concat(y);
  });
  if (kind === 'plane') {
    xaxis.axis_label = `to the right (${quantity.unit})`;
    yaxis.axis_label = `up (${quantity.unit})`;
  } else yaxis.axis_label = quantity.label;
} else {
  values = slice(quantity, axes, at);
  let { low, high } = quantity;
  if (quantity.signed) { high = Math.max(-low, high); low = -high; }
  mapper.palette = palettes[Number(quantity.signed)];
  mapper.low = low;
  mapper.high = high > low ? high : low + 1;
  bar.title = quantity.label;
  if (kind === 'map') source.data = { ...source.data, value: values };
  else {
    const data = source.data.image[0];
    values.forEach((value, i) => { data[i] = value; });
    source.data = { image: [data] };
    source.change.emit();
  }
}
const known = values.filter(Number.isFinite);
let range = known.length ? `${words(Math.min(...known), quantity.unit)} to ${words(Math.max(...known), quantity.unit)}` : 'no value';
const where = Object.entries(selects).filter(([dim, select]) => select.visible).map(([dim]) => dims[dim].texts[at[dim]]);
if (kind === 'plane' && known.length) range = `up ${range}`;
told.text = [where.join(', '), range].filter(Boolean).join(': ').replaceAll('<', '&lt;');
