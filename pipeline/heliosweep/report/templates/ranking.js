// Sort, filter and save the tables of ranked points. Cells keep what they show; data-value has the number in full.
"use strict";
for (const box of document.querySelectorAll(".ranked")) {
  const table = box.querySelector("table"), body = table.tBodies[0], rows = [...body.rows];
  const heads = [...table.tHead.rows[0].cells], filters = [...box.querySelectorAll("thead input")];
  const said = box.querySelector(".said");
  const value = (row, column) => {
    const cell = row.cells[column], given = cell.dataset.value;
    return given === undefined ? cell.textContent : given === "" ? NaN : Number(given);
  };
  const wanted = (text) => {
    const between = text.match(/^\s*(-?[\d.eE+-]+)\s*\.\.\s*(-?[\d.eE+-]+)\s*$/), sign = text.match(/^\s*(<=|>=|<|>|=)\s*(-?[\d.eE+-]+)\s*$/);
    if (between) return (found) => found >= Number(between[1]) && found <= Number(between[2]);
    if (sign) {
      const bound = Number(sign[2]);
      return { "<": (x) => x < bound, "<=": (x) => x <= bound, ">": (x) => x > bound, ">=": (x) => x >= bound, "=": (x) => x === bound }[sign[1]];
    }
    return (found, shown) => shown.toLowerCase().includes(text.trim().toLowerCase());
  };
  const filter = () => {
    const tests = filters.map((one) => (one.value.trim() ? wanted(one.value) : null));
    let left = 0;
    for (const row of rows) {
      row.hidden = !tests.every((test, column) => !test || test(value(row, column), row.cells[column].textContent));
      left += !row.hidden;
    }
    said.textContent = `${left.toLocaleString("en")} of ${rows.length.toLocaleString("en")} rows`;
  };
  heads.forEach((head, column) => {
    head.querySelector("button").addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "descending", way = down ? 1 : -1;
      heads.forEach((one) => one.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "ascending" : "descending");
      const lost = (x) => typeof x === "number" && Number.isNaN(x);
      rows.sort((one, other) => {
        const a = value(one, column), b = value(other, column);
        if (lost(a) || lost(b)) return lost(a) - lost(b);
        return way * (typeof a === "number" ? a - b : a.localeCompare(b));
      });
      body.append(...rows);
    });
  });
  filters.forEach((one) => one.addEventListener("input", filter));
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  box.querySelector(".save").addEventListener("click", () => {
    const lines = [heads.map((head) => head.dataset.name)];
    for (const row of body.rows) if (!row.hidden) lines.push([...row.cells].map((cell) => cell.dataset.value ?? cell.textContent));
    const text = lines.map((line) => line.map(quoted).join(",")).join("\n") + "\n";
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    link.download = "points.csv";
    link.click();
    URL.revokeObjectURL(link.href);
  });
  box.classList.add("live");
  filter();
}
