// Search, sort and group the list of studies. Without this script, the page lists all studies, latest first.
const list = document.querySelector('.studies');
const all = [...list.children];
const form = document.querySelector('.finder');
const { words, order, family } = form.elements;

function update() {
  const asked = words.value.toLowerCase().split(/\s+/).filter(Boolean);
  const shown = all.filter((one) => (!family.value || one.dataset.family === family.value)
    && asked.every((word) => one.textContent.toLowerCase().includes(word)));
  const key = order.value;
  const sorted = key ? [...all].sort((a, b) => a.dataset[key].localeCompare(b.dataset[key], 'en', { numeric: true })) : all;
  let before;
  for (const one of sorted) {
    one.hidden = !shown.includes(one);
    const group = key === 'family' && !one.hidden && one.dataset.family !== before;
    if (group) before = one.dataset.family;
    one.dataset.group = group ? before || 'unknown family' : '';
    list.append(one);
  }
  form.querySelector('output').value = `${shown.length} of ${all.length}`;
}

form.hidden = false;
form.addEventListener('input', update);
form.addEventListener('submit', (event) => event.preventDefault());
update();
