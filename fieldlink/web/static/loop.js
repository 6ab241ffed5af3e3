// The charts of a loop: trends with zoom, PV over OP, S and J over weeks, cost over S and J.
"use strict";
const COLOUR = {
  op: "#8795a1", stem: "#d55e00", pv: "#0072b2", sp: "#111111", s: "#d55e00", j: "#0072b2",
  grid: "#e3e9ee", ink: "#14202b", mark: "#111111",
};
const api = (name, rest = "") => `/api/loops/${encodeURIComponent(name)}${rest}`;

function axis(label, extra = {}) {
  return {
    label, labelSize: 20, size: 58, stroke: COLOUR.ink, grid: { stroke: COLOUR.grid, width: 1 },
    ticks: { stroke: COLOUR.grid }, font: "13px system-ui, sans-serif",
    labelFont: "600 13px system-ui, sans-serif", ...extra,
  };
}

const TIME_AXIS = {
  space: 90,
  stroke: COLOUR.ink, grid: { stroke: COLOUR.grid, width: 1 }, ticks: { stroke: COLOUR.grid },
  font: "13px system-ui, sans-serif",
  values: [
    [86400 * 28, "{YYYY}-{MM}-{DD}", null, null, null, null, null, null, 1],
    [86400, "{MM}-{DD}", "\n{YYYY}", null, null, null, null, null, 1],
    [60, "{HH}:{mm}", "\n{YYYY}-{MM}-{DD}", null, "\n{MM}-{DD}", null, null, null, 1],
    [1, "{HH}:{mm}:{ss}", "\n{YYYY}-{MM}-{DD}", null, "\n{MM}-{DD}", null, null, null, 1],
    [0.001, ":{ss}.{fff}", "\n{HH}:{mm}", null, null, null, null, null, 1],
  ],
};

const digits = (value) => value == null ? "\u2013" : Number(value.toPrecision(4)).toString();

// A flat line is drawn in the middle of one unit.
function spread(low, high) {
  if (low == null) return [0, 1];
  const margin = Math.max(0.05 * (high - low), high - low < 1e-9 ? 0.5 : 0);
  return [low - margin, high + margin];
}

class Trend {
  constructor(name) {
    this.name = name;
    this.range = null;
    this.zoom = null;
    this.paused = false;
    this.asked = 0;
    this.note = document.getElementById("trend-note");
    this.values = document.getElementById("trend-values");
    const sync = uPlot.sync("trend");
    const series = (label, colour, extra = {}) =>
      ({ label, stroke: colour, width: 1.6, points: { show: false }, spanGaps: false, ...extra });
    const make = (id, height, label, lines) => {
      const holder = document.getElementById(id);
      return new uPlot({
        width: holder.clientWidth, height, legend: { show: false }, pxAlign: 0,
        cursor: { sync: { key: sync.key, setSeries: false }, drag: { x: true, y: false, setScale: false } },
        scales: { x: { time: true }, y: { range: (_, low, high) => spread(low, high) } },
        axes: [TIME_AXIS, axis(label)],
        series: [{}, ...lines],
        hooks: {
          setSelect: [(plot) => this.select(plot)],
          setCursor: [(plot) => this.say(plot.cursor.idx)],
        },
      }, [[], ...lines.map(() => [])], holder);
    };
    this.op = make("trend-op", 230, "OP", [
      series("OP", COLOUR.op), series("stem", COLOUR.stem, { width: 2 })]);
    this.pv = make("trend-pv", 230, "PV", [
      series("PV", COLOUR.pv), series("SP", COLOUR.sp, { dash: [6, 4], width: 1.4 })]);
    for (const plot of [this.op, this.pv]) {
      plot.over.addEventListener("dblclick", () => { this.zoom = null; this.look(true); });
    }
    this.pick("window");
    for (const button of document.querySelectorAll("[data-range]")) {
      button.addEventListener("click", () => { this.pick(button.dataset.range); this.look(true); });
    }
    const pause = document.getElementById("pause");
    pause.addEventListener("click", () => {
      this.paused = !this.paused;
      pause.setAttribute("aria-pressed", String(this.paused));
    });
    new ResizeObserver(() => this.fit()).observe(document.getElementById("trend-op"));
  }

  pick(range) {
    this.range = range;
    this.zoom = null;
    for (const button of document.querySelectorAll("[data-range]")) {
      button.setAttribute("aria-pressed", String(button.dataset.range === range));
    }
  }

  fit() {
    for (const plot of [this.op, this.pv]) {
      plot.setSize({ width: plot.root.parentElement.clientWidth, height: plot.height });
    }
  }

  select(plot) {
    if (plot.select.width < 4) return;
    const [from, to] = [plot.select.left, plot.select.left + plot.select.width].map((x) => plot.posToVal(x, "x"));
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.zoom = [from, to];
    this.look(true);
  }

  span() {
    if (this.zoom !== null) return `since=${this.zoom[0].toFixed(3)}&until=${this.zoom[1].toFixed(3)}`;
    return `last=${this.range === "window" ? (this.wall ?? 3600).toFixed(3) : this.range}`;
  }

  async look(forced = false) {
    if (!forced && (this.paused || this.zoom !== null || this.busy)) return;
    this.busy = true;
    // Answers may overtake each other: only the one to the last question is shown.
    const asked = ++this.asked;
    try {
      const wide = 4 * Math.max(1000, Math.min(2500, document.getElementById("trend-op").clientWidth));
      const found = await ask(api(this.name, `/samples?${this.span()}&points=${wide}`));
      if (asked === this.asked) this.show(found);
    } finally {
      if (asked === this.asked) this.busy = false;
    }
  }

  show(found) {
    const blank = found.time.map(() => null);
    // A window's length on the wall: plants that run faster than the clock have short ones.
    const whole = this.range === "window" && this.zoom === null && this.wall === undefined;
    const last = found.time.length - 1;
    const slots = found.slots ? found.slots[last] - found.slots[0] : found.samples;
    if (last > 20 && slots > 20 && (found.slots || whole)) {
      const window = Number(document.getElementById("loop").dataset.windowSamples) || 800;
      this.wall = Math.max(5, window * (found.time[last] - found.time[0]) / slots);
      if (whole) setTimeout(() => this.look(), 0);
    }
    this.found = found;
    this.op.setData([found.time, found.op, found.stem ?? blank]);
    this.pv.setData([found.time, found.pv, found.sp ?? blank]);
    this.note.textContent = `${found.samples} samples` + (found.thinned ? ", least and greatest of each moment shown" : "")
      + (this.zoom !== null ? "; double-click to go back" : "; drag to zoom");
    this.say(null);
  }

  say(k) {
    if (!this.found || this.found.time.length === 0) {
      this.values.textContent = this.found ? "no samples in this range" : "";
      return;
    }
    const at = k ?? this.found.time.length - 1, { time, op, pv, sp, stem } = this.found;
    const parts = [`OP ${digits(op[at])}`, stem ? `stem ${digits(stem[at])}` : "", `PV ${digits(pv[at])}`, sp ? `SP ${digits(sp[at])}` : ""];
    this.values.textContent = `${new Date(time[at] * 1000).toLocaleTimeString("sv")}   ` + parts.filter(Boolean).join("   ");
  }
}

// A plain chart of points in a canvas: margins, ticks, and a function from figures to pixels.
function frame(canvas, xs, ys, labelX, labelY) {
  const context = canvas.getContext("2d"), scale = window.devicePixelRatio || 1;
  const width = canvas.parentElement.clientWidth - 34, height = Math.round(width * 0.62);
  canvas.style.width = `${width}px`;
  canvas.width = width * scale;
  canvas.height = height * scale;
  context.scale(scale, scale);
  context.clearRect(0, 0, width, height);
  const bounds = (values) => {
    const known = values.filter((value) => value != null);
    let [low, high] = [Math.min(...known), Math.max(...known)];
    if (!(high > low)) { low -= 1; high += 1; }
    const margin = 0.04 * (high - low);
    return [low - margin, high + margin];
  };
  const [x0, x1] = bounds(xs), [y0, y1] = bounds(ys), left = 62, bottom = height - 46, right = width - 12, top = 10;
  const px = (x) => left + (x - x0) / (x1 - x0) * (right - left);
  const py = (y) => bottom - (y - y0) / (y1 - y0) * (bottom - top);
  const steps = (low, high) => {
    const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high; v += step) found.push(Number(v.toPrecision(8)));
    return found;
  };
  context.font = "13px system-ui, sans-serif";
  context.fillStyle = COLOUR.ink;
  context.strokeStyle = COLOUR.grid;
  context.textAlign = "center";
  for (const x of steps(x0, x1)) {
    context.beginPath(); context.moveTo(px(x), top); context.lineTo(px(x), bottom); context.stroke();
    context.fillText(String(x), px(x), bottom + 18);
  }
  context.textAlign = "right";
  for (const y of steps(y0, y1)) {
    context.beginPath(); context.moveTo(left, py(y)); context.lineTo(right, py(y)); context.stroke();
    context.fillText(String(y), left - 6, py(y) + 4);
  }
  context.font = "600 13px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillText(labelX, (left + right) / 2, height - 8);
  context.save();
  context.translate(14, (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(labelY, 0, 0);
  context.restore();
  return { context, px, py, left, right, top, bottom };
}

function message(canvas, text) {
  const context = canvas.getContext("2d"), scale = window.devicePixelRatio || 1;
  const width = canvas.parentElement.clientWidth - 34;
  canvas.style.width = `${width}px`;
  canvas.width = width * scale;
  canvas.height = 90 * scale;
  context.scale(scale, scale);
  context.font = "16px system-ui, sans-serif";
  context.fillStyle = COLOUR.ink;
  let line = "", y = 24;
  for (const word of text.split(" ")) {
    if (context.measureText(`${line} ${word}`).width > width) { context.fillText(line, 0, y); line = ""; y += 22; }
    line = line ? `${line} ${word}` : word;
  }
  context.fillText(line, 0, y);
}

// The stem comes with the map: where the valve stood at the window's begin is known by judging it.
let identified = { estimate: null, stem: [] };
async function drawPhase(name) {
  const canvas = document.getElementById("phase");
  let found;
  try {
    found = await ask(api(name, "/window"));
  } catch (error) {
    if (!error.answered) throw error;
    return message(canvas, "no window has been judged yet");
  }
  if (found.op.length === 0) return message(canvas, "the samples of the judged window are no longer stored");
  const stem = identified.estimate === found.estimate ? identified.stem : [];
  const { context, px, py } = frame(canvas, [...found.op, ...stem], found.pv, "OP, stem", "PV");
  const line = (xs, colour) => {
    context.strokeStyle = colour;
    context.lineWidth = 1;
    context.beginPath();
    let pen = false;
    xs.forEach((x, k) => {
      const y = found.pv[k];
      if (x == null || y == null) { pen = false; return; }
      if (pen) context.lineTo(px(x), py(y)); else context.moveTo(px(x), py(y));
      pen = true;
    });
    context.stroke();
  };
  line(found.op, COLOUR.op);
  context.fillStyle = COLOUR.stem;
  stem.forEach((x, k) => {
    if (x != null && found.pv[k] != null) context.fillRect(px(x) - 1.5, py(found.pv[k]) - 1.5, 3, 3);
  });
}

// From dark to light for low to high cost; readable in grey too (viridis, five of its colours).
const SHADES = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function shade(share) {
  const at = Math.min(3.999, Math.max(0, share * 4)), k = Math.floor(at), part = at - k;
  return `rgb(${SHADES[k].map((c, i) => Math.round(c + part * (SHADES[k + 1][i] - c))).join(",")})`;
}

async function drawMap(name) {
  const canvas = document.getElementById("map"), note = document.getElementById("map-note");
  let found;
  for (;;) {
    try {
      found = await ask(api(name, "/map"));
    } catch (error) {
      if (!error.answered) throw error;
      return void (note.textContent = "there is a map when a window has been judged");
    }
    if (found.state !== "computing") break;
    note.textContent = "being computed";
    await new Promise((done) => setTimeout(done, 1000));
  }
  if (found.state === "failed") return void (note.textContent = found.message);
  identified = { estimate: found.estimate, stem: found.sticky ? found.stem : [] };
  await drawPhase(name);
  if (found.cost.length === 0) return void (note.textContent = "this window has no map: it could not be judged");
  const S = found.stick_band, J = found.slip_jump;
  const { context, px, py } = frame(canvas, [0, ...S], J, "stick band S", "slip jump J");
  const logs = found.cost.flat().filter((v) => v != null && v > 0).map(Math.log10);
  const [low, high] = [Math.min(...logs), Math.max(...logs)];
  const dx = S[1] - S[0], dy = J[1] - J[0];
  found.cost.forEach((row, i) => row.forEach((cost, j) => {
    if (cost == null || cost <= 0) return;
    context.fillStyle = shade((Math.log10(cost) - low) / (high - low || 1));
    const [x, y] = [px(S[i] - dx / 2), py(J[j] + dy / 2)];
    context.fillRect(x, y, px(S[i] + dx / 2) - x + 0.6, py(J[j] - dy / 2) - y + 0.6);
  }));
  const loop = await ask(api(name));
  const [s, j] = [loop.stick_band, loop.slip_jump];
  if (s.value != null && j.value != null) {
    for (const [colour, width] of [["#fff", 5], ["#c00000", 2.4]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(px(s.low ?? s.value) - 4, py(j.value)); context.lineTo(px(s.high ?? s.value) + 4, py(j.value));
      context.moveTo(px(s.value), py(j.low ?? j.value) + 4); context.lineTo(px(s.value), py(j.high ?? j.value) - 4);
      context.stroke();
    }
  }
  note.textContent = "dark: fits well; light: fits badly (logarithmic); the cross is the estimate with its intervals";
}

let coursePlot = null;
async function drawCourse(name, tries = 10) {
  const loop = await ask(api(name)), holder = document.getElementById("course"), c = loop.course;
  if (c.time.length === 0) {
    holder.textContent = "no estimates yet";
    // The estimates of a store that was opened just now are read in the background.
    if (loop.estimate && tries > 0) setTimeout(() => drawCourse(name, tries - 1).catch(() => {}), 1000);
    return;
  }
  if (c.stick_band.every((S) => S === null)) { holder.textContent = "no window has shown a sticky valve"; return; }
  const marks = [
    ...loop.orders.filter((one) => one.action === "annotate").map((one) => ({ at: Date.parse(one.time) / 1000, text: one.why })),
    ...c.changes.map(([kind, at]) => ({ at, text: kind === "increase" ? "rises from here" : "falls from here" })),
  ];
  const line = (label, colour, extra = {}) => ({ label, stroke: colour, width: 1.8, points: { show: c.time.length < 60, size: 6 }, ...extra });
  const edge = { stroke: "transparent", width: 0, points: { show: false } };
  // uPlot shows a single point in a thousand days.
  const only = c.time.length === 1 ? [c.time[0] - 43200, c.time[0] + 43200] : null;
  const data = [c.time, c.stick_band, c.stick_band_low, c.stick_band_high, c.slip_jump, c.slip_jump_low, c.slip_jump_high];
  holder.textContent = "";
  if (coursePlot) coursePlot.destroy();
  coursePlot = new uPlot({
    width: holder.clientWidth, height: Math.round(holder.clientWidth * 0.55), legend: { show: false },
    scales: {
      x: { time: true, range: (_, low, high) => only ?? (high > low ? [low - 0.03 * (high - low), high + 0.03 * (high - low)] : [low - 60, high + 60]) },
      y: { range: (_, low, high) => [0, 1.1 * Math.max(high, 1e-9)] },
    },
    axes: [TIME_AXIS, axis("S and J, units of OP")],
    series: [{}, line("S", COLOUR.s), edge, edge, line("J", COLOUR.j, { dash: [6, 3] }), edge, edge],
    bands: [{ series: [3, 2], fill: "#d55e0033" }, { series: [6, 5], fill: "#0072b222" }],
    hooks: {
      draw: [(plot) => {
        const { ctx } = plot, { top, height, left, width } = plot.bbox;
        ctx.save();
        ctx.font = `${13 * uPlot.pxRatio}px system-ui, sans-serif`;
        ctx.fillStyle = ctx.strokeStyle = COLOUR.mark;
        marks.forEach((mark, k) => {
          const x = plot.valToPos(mark.at, "x", true);
          if (x < left || x > left + width) return;
          ctx.setLineDash([5, 4]);
          ctx.beginPath(); ctx.moveTo(x, top); ctx.lineTo(x, top + height); ctx.stroke();
          const near = x > left + width / 2;
          ctx.textAlign = near ? "right" : "left";
          ctx.fillText(mark.text.slice(0, 40), x + (near ? -6 : 6), top + (18 + 18 * (k % 3)) * uPlot.pxRatio);
        });
        ctx.restore();
      }],
    },
  }, data, holder);
}

function actions(name) {
  const form = document.getElementById("act");
  if (form === null) return;
  const result = document.getElementById("act-result"), dialog = document.getElementById("confirm");
  const choice = document.getElementById("action"), text = document.getElementById("confirm-text");
  const means = () => choice.selectedOptions[0].dataset.means;
  choice.addEventListener("change", () => { document.getElementById("means").textContent = means(); });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    text.textContent = `${choice.selectedOptions[0].textContent} for ${name}. ${means()}`;
    dialog.showModal();
  });
  document.getElementById("confirm-no").addEventListener("click", () => dialog.close());
  document.getElementById("confirm-yes").addEventListener("click", async () => {
    dialog.close();
    result.className = "";
    result.textContent = "asking";
    try {
      const found = await ask(api(name, "/actions"), {
        method: "POST",
        headers: { "Authorization": `Bearer ${document.getElementById("token").value.trim()}`, "Content-Type": "application/json" },
        body: JSON.stringify({ action: choice.value, who: form.who.value, why: form.why.value }),
      });
      result.className = "good";
      result.textContent = `Done: ${found.done}.`;
      await turn();
    } catch (error) {
      result.className = "bad";
      result.textContent = error.answered ? `Refused: ${error.message}.` : "No answer: the daemon has stopped, or the connection to it is lost.";
    }
  });
}

document.addEventListener("DOMContentLoaded", () => {
  const holder = document.getElementById("loop");
  if (holder === null) return;
  const name = holder.dataset.name, trend = new Trend(name);
  let estimate = holder.dataset.estimate, seen = false;
  const later = (work) => work.catch((error) => console.info(`not drawn: ${error.message}`));
  trend.look(true).then(() => trend.look(true)).catch((error) => console.info(error.message));
  const watch = new IntersectionObserver((entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    seen = true;
    later(drawMap(name));
  });
  for (const id of ["phase", "map"]) watch.observe(document.getElementById(id));
  live.listeners.push(async (found) => {
    await trend.look();
    const now = String(found.estimate ?? "");
    if (now === estimate) return;
    estimate = now;
    await Promise.all([drawPhase(name), drawCourse(name)]);
    if (seen) later(drawMap(name));
  });
  let redraw = null;
  new ResizeObserver(() => {
    clearTimeout(redraw);
    redraw = setTimeout(() => {
      later(drawPhase(name));
      later(drawCourse(name));
      if (seen) later(drawMap(name));
    }, 200);
  }).observe(holder);
  actions(name);
});
