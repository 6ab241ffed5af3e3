// The fleet's table: sort, filter, search, and rows that are replaced when they change.
"use strict";
document.addEventListener("DOMContentLoaded", () => {
  const table = document.getElementById("fleet");
  if (table === null) {
    // An empty page looks again until there is something to show.
    live.ask = async () => {
      const found = await ask("/fragments/fleet");
      put(document.getElementById("bar"), found.bar);
      if (found.order && found.order.length) location.reload();
    };
    return;
  }
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  const search = document.getElementById("search"), shown = document.getElementById("shown");
  const verdict = document.getElementById("verdict"), device = document.getElementById("device");
  let revision = Number(table.dataset.revision), sorted = { column: 0, up: true };

  const valueOf = (row, column, kind) => {
    const cell = row.cells[column];
    const text = cell.dataset.v ?? cell.textContent.trim();
    return kind === "n" ? Number(text) : text.toLowerCase();
  };

  function sort() {
    const { column, up } = sorted, kind = heads[column].querySelector("button").dataset.kind;
    const rows = [...body.rows], sign = up ? 1 : -1;
    const keys = new Map(rows.map((row) => [row, valueOf(row, column, kind)]));
    const ordered = rows.slice().sort((a, b) => {
      const [x, y] = [keys.get(a), keys.get(b)];
      if (x < y) return -sign;
      if (x > y) return sign;
      return Number(a.cells[0].dataset.v) - Number(b.cells[0].dataset.v);
    });
    if (ordered.some((row, k) => row !== rows[k])) {
      const before = document.activeElement;
      body.append(...ordered);
      if (body.contains(before)) before.focus();
    }
    heads.forEach((head, k) => {
      if (k === column) head.setAttribute("aria-sort", up ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
  }

  function filter() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    let number = 0;
    for (const row of body.rows) {
      const text = (row.dataset.name + " " + row.dataset.device).toLowerCase();
      const fits = words.every((word) => text.includes(word))
        && (!verdict.value || row.dataset.verdict === verdict.value)
        && (!device.value || row.dataset.device === device.value);
      row.hidden = !fits;
      number += fits;
    }
    shown.textContent = number === body.rows.length ? "" : `${number} of ${body.rows.length} shown`;
  }

  function replace(found) {
    put(document.getElementById("bar"), found.bar);
    put(document.getElementById("summary"), found.summary);
    put(document.getElementById("findings"), found.findings);
    if (found.order === null) return;
    const known = new Map([...body.rows].map((row) => [row.dataset.name, row]));
    const holder = document.createElement("template");
    for (const [name, html] of Object.entries(found.rows)) {
      holder.innerHTML = html;
      const fresh = holder.content.querySelector("tr"), old = known.get(name);
      localTimes(fresh);
      fresh.classList.add("changed");
      const focused = old && old.contains(document.activeElement);
      if (old) old.replaceWith(fresh); else body.append(fresh);
      if (focused) fresh.querySelector("a").focus();
      known.delete(name);
      known.set(name, fresh);
    }
    const wanted = new Set(found.order);
    for (const [name, row] of known) if (!wanted.has(name)) row.remove();
    found.order.forEach((name, k) => {
      const cell = known.get(name)?.cells[0];
      if (cell) { cell.dataset.v = k + 1; cell.textContent = k + 1; }
    });
    const hint = document.getElementById("hint");
    if (hint && body.querySelector('tr:not([data-verdict="none"])')) hint.remove();
    revision = found.revision;
    sort();
    filter();
  }

  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
    sorted = { column, up: sorted.column === column ? !sorted.up : true };
    sort();
  }));
  for (const input of [search, verdict, device]) input.addEventListener("input", filter);
  document.getElementById("filter").addEventListener("submit", (event) => event.preventDefault());
  live.ask = async () => replace(await ask(`/fragments/fleet?revision=${revision}`));
});
