// Arrays over named dimensions, and numbers as text.

const MINUS = '\u2212';
const NOTHING = '\u2013';

function decoded(array) {
  if (!array.values) {
    const bytes = Uint8Array.from(atob(array.data), (letter) => letter.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    array.values = new Float32Array(bytes.length / 4);
    for (let i = 0; i < array.values.length; i++) array.values[i] = view.getFloat32(4 * i, true);
  }
  return array.values;
}

// Values of an array along some dimensions, the last of which runs fastest, where the others stand at `at`.
function slice(array, along, at) {
  const values = decoded(array);
  const strides = {};
  let stride = 1;
  for (let i = array.dims.length - 1; i >= 0; i--) {
    strides[array.dims[i]] = stride;
    stride *= array.shape[i];
  }
  let start = 0;
  array.dims.forEach((dim, i) => {
    if (!along.includes(dim)) start += strides[dim] * Math.min(at[dim] || 0, array.shape[i] - 1);
  });
  const lengths = along.map((dim) => array.dims.includes(dim) ? array.shape[array.dims.indexOf(dim)] : 1);
  const found = new Float64Array(lengths.reduce((product, length) => product * length, 1));
  for (let i = 0; i < found.length; i++) {
    let left = i, place = start;
    for (let d = along.length - 1; d >= 0; d--) {
      place += (left % lengths[d]) * (strides[along[d]] || 0);
      left = Math.floor(left / lengths[d]);
    }
    found[i] = values[place];
  }
  return found;
}

// Least and largest finite value and their mean; null where there is none.
function extent(values) {
  let low = Infinity, high = -Infinity, sum = 0, count = 0;
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
    sum += value;
    count += 1;
  }
  return count ? { low, high, mean: sum / count, count } : null;
}

function text(value, unit) {
  if (!Number.isFinite(value)) return NOTHING;
  const size = Math.abs(value);
  let said = size !== 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : Number(value.toPrecision(5)).toString();
  said = said.replace('-', MINUS);
  return unit ? said + (unit.startsWith('\u00b0') ? '' : '\u00a0') + unit : said;
}
