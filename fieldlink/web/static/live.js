// Keeps a page up to date: asks its parts every two seconds, says within seconds when nobody answers.
"use strict";
const EVERY = 2000, PATIENCE = 5000;
const link = document.getElementById("link"), lost = document.getElementById("lost");
const live = { ask: null, since: null, listeners: [] };

function localTimes(root) {
  for (const at of root.querySelectorAll("time[datetime]")) {
    const moment = new Date(at.getAttribute("datetime"));
    if (isNaN(moment)) continue;
    at.title = at.getAttribute("datetime");
    at.textContent = at.hasAttribute("data-day")
      ? moment.toLocaleDateString("sv") : moment.toLocaleString("sv");
  }
}

function put(element, html) {
  // Equal markup stays: a selection, an open menu or the focus in it stay too.
  if (element.markup === html) return false;
  const before = document.activeElement, inside = element.contains(before) && before !== element;
  const address = inside ? before.getAttribute("href") : null;
  const unfolded = element.querySelector("details[open]") !== null;
  element.markup = html;
  element.innerHTML = html;
  if (unfolded) for (const one of element.querySelectorAll("details")) one.open = true;
  localTimes(element);
  if (address !== null) {
    for (const other of element.querySelectorAll("a")) {
      if (other.getAttribute("href") === address) { other.focus(); break; }
    }
  }
  return true;
}

function answering() {
  live.since = null;
  lost.hidden = true;
  lost.textContent = "";
  link.className = "link live";
  link.textContent = "live " + new Date().toLocaleTimeString("sv");
}

function silent(what, why) {
  live.since ??= new Date();
  lost.hidden = false;
  const at = live.since.toLocaleTimeString("sv");
  const text = `${what} since ${at}: ${why}. What is shown is old. Tried again every two seconds.`;
  if (lost.textContent !== text) lost.textContent = text;
  link.className = "link";
  link.textContent = "not live";
}

async function ask(address, options = {}) {
  const answer = await fetch(address, { ...options, signal: AbortSignal.timeout(PATIENCE) });
  if (answer.status === 401 && !options.method) { location.href = "/login"; }
  const found = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(found.error), { answered: true, found });
  return found;
}

async function turn() {
  if (live.ask === null) return;
  try {
    await live.ask();
    answering();
  } catch (error) {
    if (error.answered) silent("Fieldlink cannot tell this", error.message);
    else silent("No answer from fieldlink", "the daemon has stopped, or the connection to it is lost");
  }
}

async function run() {
  for (;;) {
    if (!document.hidden || live.since !== null) await turn();
    await new Promise((done) => setTimeout(done, EVERY));
  }
}

async function askParts(holder) {
  const found = await ask(holder.dataset.live);
  put(document.getElementById("bar"), found.bar);
  const parts = holder.hasAttribute("data-part") ? [holder] : holder.querySelectorAll("[data-part]");
  for (const part of parts) put(part, found.parts[part.dataset.part]);
  for (const listener of live.listeners) await listener(found);
}

document.addEventListener("visibilitychange", () => { if (!document.hidden) turn(); });
document.addEventListener("DOMContentLoaded", () => {
  localTimes(document);
  const large = document.getElementById("large");
  const enlarge = (on) => {
    document.documentElement.classList.toggle("large", on);
    large.setAttribute("aria-pressed", String(on));
  };
  enlarge(localStorage.getItem("large") === "1");
  large.addEventListener("click", () => {
    const on = large.getAttribute("aria-pressed") !== "true";
    localStorage.setItem("large", on ? "1" : "0");
    enlarge(on);
  });
  const holder = document.querySelector("[data-live]");
  if (holder !== null) live.ask = () => askParts(holder);
  link.textContent = "connecting";
  run();
});
