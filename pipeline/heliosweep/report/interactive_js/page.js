// Every view of the page, drawn when it comes into sight.

const data = JSON.parse(document.getElementById('heliosweep-data').textContent);
const KINDS = { field: Field, raster: Raster, curves: Curves, plane: Curves };
const MOST_ROWS = 500;
const plots = {};

function tabulate(plot, place) {
  const { head, rows } = plot.table();
  const line = (name, cells) => make('tr', {}, ...cells.map((cell) => make(name, name === 'th' ? { scope: 'col' } : {}, cell)));
  const table = make('table', {}, make('thead', {}, line('th', head)), make('tbody', {}, ...rows.slice(0, MOST_ROWS).map((row) => line('td', row))));
  const box = make('div', { class: 'scroll', role: 'region', tabindex: 0, 'aria-label': `Values: ${plot.switches.label}` }, table);
  const more = rows.length > MOST_ROWS ? [make('p', {}, `The first ${MOST_ROWS} of ${rows.length.toLocaleString('en')} rows; all are in the data set.`)] : [];
  place.replaceChildren(box, ...more);
}

function open(figure) {
  if (plots[figure.id]) return;
  const view = data.views[+figure.dataset.view];
  const find = (name) => figure.querySelector(name);
  const details = find('.values');
  const after = () => {
    const plot = plots[figure.id];
    const about = [plot.switches.label, plot.said].join(', ');
    find('.said').textContent = plot.said;
    if (view.named) view.title = find('h3').textContent = plot.switches.title;
    find('.plot').setAttribute('aria-label', `${view.title}: ${about}`);
    find('.plot').removeAttribute('aria-labelledby');
    if (details.open) tabulate(plot, details.lastElementChild);
  };
  const switches = new Switches(view, find('.switches'), figure.id, () => {
    plots[figure.id].update();
    after();
  });
  const plot = plots[figure.id] = new KINDS[view.kind](switches, find('.plot'));
  plot.after = after;
  details.addEventListener('toggle', after);
  after();
  plot.ready.then(() => { figure.dataset.ready = 'true'; });
}

const figures = [...document.querySelectorAll('figure.view')];
const seen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (isIntersecting) {
      seen.unobserve(target);
      open(target);
    }
  }
}, { rootMargin: '300px' });
for (const figure of figures) seen.observe(figure);
window.addEventListener('beforeprint', () => figures.forEach(open));
dark.addEventListener('change', () => Object.values(plots).forEach((plot) => plot.dress()));
window.heliosweep = { plots, open };
