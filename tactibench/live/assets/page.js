"use strict";

// The page of `tactibench demo` and of `hw live --serve`. It asks for one frame, draws it, and asks
// for the next; frames are plain numbers (see views.py).

const CIVIDIS = [[0, 34, 78], [26, 56, 111], [67, 78, 108], [97, 101, 111], [125, 124, 120],
  [155, 148, 118], [188, 174, 108], [222, 201, 88], [254, 232, 56]];
const READ = "#ff7a1a", SEEN = "#2ecc71", UNSEEN = "#ff5c5c";
const LAMP = [0.45, 0.54, 0.71];  // of length 1, so steep that the dome's own side is not dark
const STEP_MM = 0.1;
const RECENT = 40;  // answers over which speed is shown
const MOST_MEASURES = 2000;
const USUAL = { depth: 2, radius: 3, light: 1, shift: 0, instance: 0 };

const find = (selector) => document.querySelector(selector);
const state = { settings: null, tips: [], pointers: new Map(), last: null, changed: false, busy: false, events: [] };
const recent = { ms: [], at: [] };

function readMessage(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  for (const [name, [kind, height, width, start]] of Object.entries(head.pictures)) {
    const from = 4 + length + start;
    const values = kind === "u1"
      ? new Uint8Array(buffer, from, width * height)
      : new Float32Array(buffer.slice(from, from + 4 * width * height));
    head.pictures[name] = { width, height, values };
  }
  return head;
}

function post(path, body) {
  return fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

// Pictures of numbers, as small canvases that the browser scales.

const palette = new Uint8ClampedArray(3 * 256);
for (let level = 0; level < 256; level++) {
  const at = (level / 255) * (CIVIDIS.length - 1), low = Math.min(Math.floor(at), CIVIDIS.length - 2);
  for (let c = 0; c < 3; c++) {
    palette[3 * level + c] = CIVIDIS[low][c] + (at - low) * (CIVIDIS[low + 1][c] - CIVIDIS[low][c]);
  }
}

const scratch = new Map();
function paint(name, picture, colour) {
  let sheet = scratch.get(name);
  if (!sheet || sheet.width !== picture.width || sheet.height !== picture.height) {
    sheet = new OffscreenCanvas(picture.width, picture.height);
    scratch.set(name, sheet);
  }
  const context = sheet.getContext("2d");
  const image = context.createImageData(picture.width, picture.height);
  colour(image.data, picture);
  context.putImageData(image, 0, 0);
  return sheet;
}

function asGrey(data, { values }) {
  for (let k = 0; k < values.length; k++) {
    data[4 * k] = data[4 * k + 1] = data[4 * k + 2] = values[k];
    data[4 * k + 3] = 255;
  }
}

function asHeat(data, { values }) {
  for (let k = 0; k < values.length; k++) {
    const from = 3 * values[k];
    data[4 * k] = palette[from];
    data[4 * k + 1] = palette[from + 1];
    data[4 * k + 2] = palette[from + 2];
    data[4 * k + 3] = 255;
  }
}

// The skin from above, lit from the upper left: the dome's own slope and that of the dimple.
function asSkin(data, { values, width, height }) {
  const pitch = (2 * state.settings.half_mm) / width, dome = state.settings.dome_mm;
  const z = new Float32Array(values.length);
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const x = (j + 0.5) * pitch - state.settings.half_mm, y = (i + 0.5) * pitch - state.settings.half_mm;
      const high = dome ? Math.sqrt(Math.max(0, dome * dome - x * x - y * y)) : 0;
      z[i * width + j] = high - values[i * width + j];
    }
  }
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const k = i * width + j;
      const left = Math.max(0, j - 1), right = Math.min(width - 1, j + 1);
      const up = Math.max(0, i - 1), down = Math.min(height - 1, i + 1);
      const dx = (z[i * width + right] - z[i * width + left]) / ((right - left) * pitch);
      const dy = (z[down * width + j] - z[up * width + j]) / ((down - up) * pitch);
      const light = (LAMP[0] * dx + LAMP[1] * dy + LAMP[2]) / Math.hypot(dx, dy, 1);
      const shade = 45 + 205 * Math.max(0, light);
      const deep = Math.min(1, Math.max(0, values[k]) / 3);
      data[4 * k] = shade * (0.62 + 0.38 * deep);
      data[4 * k + 1] = shade * (0.74 - 0.25 * deep);
      data[4 * k + 2] = shade * (0.9 - 0.55 * deep);
      data[4 * k + 3] = 255;
    }
  }
}

function open(canvas) {
  const side = Math.max(1, Math.round(canvas.clientWidth * Math.min(2, window.devicePixelRatio || 1)));
  if (canvas.width !== side) {
    canvas.width = canvas.height = side;
  }
  const context = canvas.getContext("2d");
  context.imageSmoothingQuality = "high";
  return [context, side, side / canvas.clientWidth];
}

const place = (mm, side) => (mm / state.settings.half_mm + 1) * side / 2;

function ring(context, x, y, radius, scale) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.lineWidth = 4 * scale;
  context.strokeStyle = "#000";
  context.stroke();
  context.lineWidth = 2 * scale;
  context.strokeStyle = "#fff";
  context.stroke();
}

function cross(context, x, y, arm, scale) {
  for (const [width, colour] of [[4.5, "#000"], [2.5, READ]]) {
    context.beginPath();
    context.moveTo(x - arm, y);
    context.lineTo(x + arm, y);
    context.moveTo(x, y - arm);
    context.lineTo(x, y + arm);
    context.lineWidth = width * scale;
    context.strokeStyle = colour;
    context.stroke();
  }
}

function drawDome(message) {
  const [context, side, scale] = open(find("#dome canvas"));
  const { half_mm: half, learned_mm: learned } = state.settings;
  const cells = 64;
  const skin = message.pictures.skin || { width: cells, height: cells, values: new Float32Array(cells * cells) };
  context.drawImage(paint("skin", skin, asSkin), 0, 0, side, side);
  context.setLineDash([5 * scale, 5 * scale]);
  context.lineWidth = scale;
  context.strokeStyle = "rgba(255,255,255,.65)";
  const edge = place(-learned, side);
  context.strokeRect(edge, edge, side - 2 * edge, side - 2 * edge);
  context.setLineDash([]);
  for (const [x, y] of message.truth || []) {
    ring(context, place(x, side), place(y, side), 6 * scale, scale);
    context.beginPath();
    context.arc(place(x, side), place(y, side), find("#sliders").radius.value / half * side / 2, 0, 2 * Math.PI);
    context.lineWidth = scale;
    context.strokeStyle = "rgba(255,255,255,.5)";
    context.stroke();
  }
  find("#where").textContent = state.tips.length === 1
    ? `x ${state.tips[0][0].toFixed(1)}, y ${state.tips[0][1].toFixed(1)} mm`
    : state.tips.length ? `${state.tips.length} tips` : `± ${half.toFixed(1)} mm`;
}

function drawFrame(message) {
  const [context, side, scale] = open(find("#camera canvas"));
  const frame = message.pictures.frame;
  const long = Math.max(frame.width, frame.height), zoom = side / long;
  const left = (side - zoom * frame.width) / 2, top = (side - zoom * frame.height) / 2;
  context.fillStyle = "#000";
  context.fillRect(0, 0, side, side);
  context.drawImage(paint("frame", frame, asGrey), left, top, zoom * frame.width, zoom * frame.height);
  for (const seen of [1, 0]) {
    context.beginPath();
    for (const [x0, y0, x, y, found] of message.pins) {
      if (found === seen) {
        context.moveTo(left + (x0 + 0.5) * zoom, top + (y0 + 0.5) * zoom);
        context.lineTo(left + (x + 0.5) * zoom, top + (y + 0.5) * zoom);
      }
    }
    context.lineWidth = 2 * scale;
    context.strokeStyle = seen ? SEEN : UNSEEN;
    context.stroke();
  }
  const seen = message.pins.filter((pin) => pin[4]).length;
  find("#pins").textContent = message.pins.length ? `${seen}/${message.pins.length} pins` : "";
}

function errorLine(error) {
  if (!error) return "";
  const parts = [];
  if (error.mm !== null) {
    parts.push(`off by <b>${error.mm.toFixed(3)} mm</b>, depth by <b>${error.depth_mm.toFixed(3)} mm</b>`);
  }
  if (error.missed) parts.push(`<span class="bad">${error.missed} missed</span>`);
  if (error.false) parts.push(`<span class="bad">${error.false} false</span>`);
  return parts.join(", ") || "no contact, and none is read";
}

function drawModel(figure, message, number) {
  const [context, side, scale] = open(figure.querySelector("canvas"));
  const answer = message.answers[number], map = message.pictures[`map${number}`];
  if (map) {
    context.drawImage(paint(`map${number}`, map, asHeat), 0, 0, side, side);
  } else {
    context.fillStyle = `rgb(${CIVIDIS[0]})`;
    context.fillRect(0, 0, side, side);
  }
  for (const [x, y] of message.truth || []) {
    ring(context, place(x, side), place(y, side), 9 * scale, scale);
  }
  for (const [x, y] of answer.contacts) {
    cross(context, place(x, side), place(y, side), 8 * scale, scale);
  }
  figure.querySelector(".ms").textContent = `${answer.ms.toFixed(1)} ms`;
  // Numbers alone are put in as HTML; names and words are text.
  const error = figure.querySelector(".error");
  if (message.truth) {
    error.innerHTML = errorLine(answer.error);
  } else {
    error.textContent = answer.words;
  }
  figure.querySelector(".drawn").textContent = answer.drawn ? " · drawn from its contacts" : "";
  figure.querySelector("canvas").setAttribute("aria-label", `Map of the model. It reads: ${answer.words}`);
}

function draw(message) {
  if (state.settings.kind === "press") drawDome(message);
  drawFrame(message);
  document.querySelectorAll(".model").forEach((figure, number) => drawModel(figure, message, number));
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length ? sorted[Math.floor(sorted.length / 2)] : NaN;
}

// After the frame that shows an answer was handed on: a message comes behind the painting.
const painted = new MessageChannel();
const waiting = [];
painted.port1.onmessage = () => waiting.splice(0).forEach((done) => done());
function shown() {
  return new Promise((done) => {
    requestAnimationFrame(() => {
      waiting.push(done);
      painted.port2.postMessage(0);
    });
  });
}

function measure(events) {
  const now = performance.now();
  for (const start of events) {
    performance.measure("mouse to answer", { start, end: now });
    recent.ms.push(now - start);
  }
  performance.mark("answer shown");
  recent.at.push(now);
  recent.ms.splice(0, recent.ms.length - RECENT);
  recent.at.splice(0, recent.at.length - RECENT);
  if (performance.getEntriesByType("measure").length > MOST_MEASURES) performance.clearMeasures();
  if (performance.getEntriesByType("mark").length > MOST_MEASURES) performance.clearMarks();
  showSpeed();
}

function showSpeed() {
  const within = recent.at.filter((at) => at > performance.now() - 1000);
  const rate = within.length > 4 ? `${within.length} pictures a second` : "";
  // A camera's frame is waited for: the time from a request would say how often frames come.
  const pressed = state.settings.kind === "press" && recent.ms.length;
  const delay = pressed ? `${median(recent.ms).toFixed(0)} ms from mouse to answer on this page (median)` : "";
  find("#speed").textContent = [delay, rate].filter(Boolean).join(" · ");
}

// Presses.

function values() {
  const form = find("#sliders");
  return Object.fromEntries(Object.keys(USUAL).map((name) => [name, Number(form[name].value)]));
}

async function ask() {
  if (state.busy) return;
  state.busy = true;
  while (state.changed) {
    const events = state.events.splice(0);
    state.changed = false;
    try {
      const response = await post("press", { tips: state.tips, ...values() });
      if (response.ok) {
        state.last = readMessage(await response.arrayBuffer());
        find("#note").textContent = "";
        draw(state.last);
      } else {
        find("#note").textContent = await response.text();
      }
    } catch (error) {
      find("#note").textContent = "The program has ended or does not answer. Start `tactibench demo` again.";
      break;
    }
    await shown();
    measure(events);
  }
  state.busy = false;
}

function change(event) {
  state.changed = true;
  if (event) state.events.push(event.timeStamp);
  ask();
}

function toMillimetres(event) {
  const box = find("#dome canvas").getBoundingClientRect(), { half_mm: half } = state.settings;
  const inside = (value) => Math.max(-half, Math.min(half, value));
  return [inside(((event.clientX - box.left) / box.width * 2 - 1) * half),
    inside(((event.clientY - box.top) / box.height * 2 - 1) * half)];
}

function listen(canvas) {
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    canvas.setPointerCapture(event.pointerId);
    if (!state.pointers.size && !event.shiftKey) state.tips = [];
    if (state.tips.length >= state.settings.most_tips) return;
    const tip = toMillimetres(event);
    state.tips.push(tip);
    state.pointers.set(event.pointerId, tip);
    change(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const tip = state.pointers.get(event.pointerId);
    if (!tip) return;
    [tip[0], tip[1]] = toMillimetres(event);
    change(event);
  });
  const lifted = (event) => state.pointers.delete(event.pointerId);
  canvas.addEventListener("pointerup", lifted);
  canvas.addEventListener("pointercancel", lifted);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    deepen(event.deltaY < 0 ? 1 : -1, event);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (way) {
      if (!state.tips.length) state.tips = [[0, 0]];
      const tip = state.tips[state.tips.length - 1], { half_mm: half } = state.settings;
      way.forEach((step, axis) => { tip[axis] = Math.max(-half, Math.min(half, tip[axis] + step * STEP_MM)); });
      change(event);
    } else if (event.key === "+" || event.key === "-") {
      deepen(event.key === "+" ? 1 : -1, event);
    } else if (event.key === "Delete" || event.key === "Escape") {
      lift(event);
    } else {
      return;
    }
    event.preventDefault();
  });
}

function deepen(steps, event) {
  const slider = find("#sliders").depth;
  slider.value = Number(slider.value) + steps * 2 * Number(slider.step);
  showValues();
  change(event);
}

function lift(event) {
  state.tips = [];
  state.pointers.clear();
  change(event);
}

function showValues() {
  for (const input of document.querySelectorAll("#sliders input")) {
    const digits = (input.step.split(".")[1] || "").length, unit = input.dataset.unit;
    input.parentElement.querySelector("output").textContent = `${Number(input.value).toFixed(digits)}${unit ? ` ${unit}` : ""}`;
  }
}

function preparePresses() {
  const form = find("#sliders"), { ranges } = state.settings;
  for (const [name, [low, high]] of Object.entries(ranges)) {
    const input = form[name];
    input.min = low;
    input.max = high;
    input.defaultValue = USUAL[name];
    input.value = USUAL[name];
    input.parentElement.hidden = low === high;
  }
  form.addEventListener("input", (event) => { showValues(); change(event); });
  form.addEventListener("reset", (event) => setTimeout(() => { showValues(); change(event); }));
  form.addEventListener("submit", (event) => event.preventDefault());
  find("#lift").addEventListener("click", lift);
  find("#most").textContent = state.settings.most_tips;
  for (const part of [find("#how"), find("#dome"), form]) part.hidden = false;
  listen(find("#dome canvas"));
  showValues();
  state.tips = [[2.5, -1.5]];
  change(null);
}

// Frames of a camera.

async function watch() {
  let after = 0;
  for (;;) {
    try {
      const began = performance.now();
      const response = await post("next", { after });
      const message = readMessage(await response.arrayBuffer());
      after = message.number;
      if (message.ended) {
        find("#note").textContent = "The program has ended.";
        return;
      }
      if (message.answers) {
        state.last = message;
        draw(message);
        await shown();
        measure([began]);
      }
    } catch (error) {
      find("#note").textContent = "The program has ended or does not answer.";
      return;
    }
  }
}

async function begin() {
  state.settings = await (await fetch("settings.json")).json();
  const { models, kind, sensor } = state.settings;
  find("#what").textContent = kind === "press" ? `demo on ${sensor}` : "live";
  models.forEach(({ label, colour }) => {
    const figure = find("#model").content.firstElementChild.cloneNode(true);
    figure.querySelector("b").textContent = label;
    figure.querySelector("b").title = label;
    figure.style.setProperty("--colour", colour);
    if (kind === "watch") figure.querySelector(".ring").nextSibling.remove(), figure.querySelector(".ring").remove();
    find("#panels").append(figure);
  });
  find("#panels").dataset.models = models.length;
  find("#panels").style.setProperty("--count", models.length + (kind === "press" ? 2 : 1));
  new ResizeObserver(() => { if (state.last) draw(state.last); }).observe(find("#panels"));
  document.documentElement.dataset.ready = "yes";
  if (kind === "press") preparePresses(); else watch();
}

begin();
