"use strict";
// The page of a result. k3d draws, turns and keeps the time; it has the form, whose opacity has the frames as
// its times and does not change. What is drawn at a moment is made here, from the
// numbers of the page: points, and of each state displacements, forces and strains as whole numbers of two
// bytes, in one unit for all displacements and one for each element. NONE is no value. Elements are m pairs of
// points; each is drawn with two points of its own.

const NONE = -32768;
// objects of k3d, beside the form, with times; guided: supports along some axes alone, or on springs
const TAUT = 2, SLACK = 3, BROKEN = 4, SUPPORTS = 5, PICKED = 6, GUIDED = 7;
const MARKS = [[SUPPORTS, "supports", "support"], [GUIDED, "guided", "guided"]]; // object, points, colour
const MOST_THICK = 20000; // elements that are drawn as bands; more as lines of one pixel
const THICK = [0.004, 0.009]; // widths of elements, as shares of the size of the net: of many, of few
const NEAR = 12; // pixels from a click to an element
const SCALES = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10];
const PLAYED = 8; // seconds that a motion takes, about, at the speed that is set at first

let begin;
const netfall = new Promise((resolve) => { begin = resolve; }); // gives the scene, once it is drawn

const byId = (name) => document.getElementById(name);
const short = (value, digits = 3) => String(Number(value.toPrecision(digits)));

function netfallPage(k3d) {
  const page = readPage(k3d);
  const [state, quantity] = [page.states[0], page.quantities[0]];
  const scene = { k3d, page, state, quantity, frame: 0, scale: 1, picked: -1 };
  byId("words").textContent = [page.net, ...page.left_out.map((words) => `shown: ${words}`)].join("; ");
  byId("told-start").textContent = `${page.from}, from which displacements count`;
  setControls(scene);
  return loadObjects(scene).then(() => {
    k3d.on(k3d.events.TIME_CHANGE, (time) => showTime(scene, time));
    k3d.on(k3d.events.AUTO_PLAY_CHANGE, (plays) => {
      byId("play").textContent = plays ? "\u275a\u275a stop" : "\u25b6 play";
    });
    lookFrom(scene, "space");
    choose(scene, 0);
    return scene;
  });
}

function fault(words) {
  byId("fault").textContent = words;
}

if (!document.createElement("canvas").getContext("webgl2")) {
  fault("This browser draws nothing in space: WebGL is switched off. Switch it on, or take another browser.");
}

// --- the numbers

function readPage(k3d) {
  const page = JSON.parse(byId("page-data").textContent);
  const packed = _base64ToArrayBuffer(byId("page-numbers").textContent.trim());
  const bytes = fflate.unzlibSync(new Uint8Array(packed));
  const KINDS = { Int16Array, Int32Array, Float32Array };
  const read = (of) => {
    const Kind = KINDS[of.kind];
    return new Kind(bytes.slice(of.from, of.from + of.length * Kind.BYTES_PER_ELEMENT).buffer);
  };
  const whole = (of, count) => { // the sums of the differences, which wrap around
    const values = read(of), size = values.length / count;
    for (let k = size; k < values.length; k++) values[k] += values[k - size];
    return { values, size, unit: read(of.unit) };
  };
  const form = Object.values(k3d.getWorld().ObjectsListJson)[0];
  Object.assign(page, { form: form.id, start: form.vertices.data, ends: form.indices.data });
  page.group = read(page.group);
  if (!Array.isArray(page.element)) page.element = read(page.element);
  for (const each of page.quantities) {
    for (const name of ["per", "values"]) each[name] = each[name] && read(each[name]);
  }
  for (const state of page.states) {
    for (const name of ["displacement", "tension", "strain", "hanging"]) {
      if (state[name]) state[name] = whole(state[name], state.slack.length);
    }
    state.away = state.away && read(state.away);
    for (const [, name] of MARKS) state[name] = read(state[name]);
  }
  return page;
}

// Value of a quantity in an element, in the unit of the file; NaN: none.
function valueOf(scene, e) {
  const { state, frame, quantity } = scene;
  if (quantity.values) return quantity.values[e];
  const of = quantity.of_file && state.strain ? state.strain : state.tension;
  const number = of.values[frame * of.size + e];
  if (number === NONE) return NaN;
  const value = number * of.unit[e];
  return quantity.per && of === state.tension ? value / quantity.per[e] : value;
}

// --- what is drawn

// The object that draws an element; undefined: it is not there.
function kindOf(scene, e) {
  const { state, frame } = scene;
  if (state.away && state.away[e]) return undefined;
  const at = frame * state.tension.size + e, N = state.tension.values[at];
  const slack = N === 0 || (state.hanging && state.hanging.values[at]);
  return N === NONE ? BROKEN : slack ? SLACK : TAUT;
}

function place(scene, points) {
  const { page, state, frame, scale } = scene;
  const { values, size, unit } = state.displacement;
  for (let k = 0; k < size; k++) {
    const number = values[frame * size + k];
    points[k] = number === NONE ? NaN : page.start[k] + scale * unit[0] * number;
  }
}

function colourOf(scene, e) {
  const { quantity, page } = scene, value = valueOf(scene, e);
  const ends = value >= 0 ? quantity.tension : quantity.compression;
  if (Number.isNaN(value) || !ends) return page.colours.none;
  if (quantity.over && value > ends[1]) return page.colours.over;
  const shades = value >= 0 ? page.colours.tension : page.colours.compression;
  const share = (Math.abs(value) - ends[0]) / (ends[1] - ends[0] || 1);
  return shades[Math.max(0, Math.min(shades.length - 1, Math.round(share * (shades.length - 1))))];
}

function draw(scene) {
  const { k3d, page, points, kinds, picked } = scene, m = page.ends.length / 2;
  place(scene, points);
  for (const kind of Object.values(kinds)) kind.vertices.fill(NaN);
  for (let e = 0; e < m; e++) {
    const kind = kinds[kindOf(scene, e)];
    if (!kind) continue;
    putEnds(page, points, e, kind.vertices, 6 * e);
    if (kind === kinds[TAUT]) kind.colours[2 * e] = kind.colours[2 * e + 1] = colourOf(scene, e);
  }
  if (picked >= 0 && kindOf(scene, picked)) putEnds(page, points, picked, kinds[PICKED].vertices, 0);
  for (const [id, kind] of Object.entries(kinds)) redraw(k3d, Number(id), kind);
  for (const [id, name] of MARKS) moveSquares(scene, id, name);
  k3d.render();
  tell(scene);
}

function putEnds(page, points, e, vertices, v) {
  for (const end of [0, 1]) {
    const p = 3 * page.ends[2 * e + end];
    for (const axis of [0, 1, 2]) vertices[v + 3 * end + axis] = points[p + axis];
  }
}

function redraw(k3d, id, kind) {
  const object = k3d.getWorld().ObjectsListJson[id];
  object.vertices = { data: kind.vertices, shape: [kind.vertices.length / 3, 3] };
  const changes = { vertices: object.vertices };
  if (kind.colours) changes.colors = object.colors = { data: kind.colours, shape: [kind.colours.length] };
  k3d.reload(object, changes, true);
}

function lines(scene, id, name, colour, width, vertices) {
  const m = vertices.length / 6;
  return {
    id, name, type: "Lines", visible: true, color: colour, opacity: 1, indices_type: "segment",
    shader: m > MOST_THICK ? "simple" : "thick", width: width * scene.extent,
    vertices: { data: vertices, shape: [2 * m, 3] },
    indices: { data: Uint32Array.from({ length: 2 * m }, (_, k) => k), shape: [m, 2] },
    colors: { data: new Uint32Array(2 * m).fill(colour), shape: [2 * m] },
    attribute: { data: new Float32Array(0), shape: [0] }, color_range: [],
    model_matrix: { data: new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), shape: [4, 4] },
  };
}

function loadObjects(scene) {
  const { k3d, page } = scene, { colours, ends, start } = page, m = ends.length / 2;
  for (const [name, value] of Object.entries(colours)) {
    colours[name] = Array.isArray(value) ? value.map(packed) : packed(value);
  }
  scene.extent = Math.max(...[0, 1, 2].map((axis) => page.window[1][axis] - page.window[0][axis]));
  const width = Math.min(THICK[1], Math.max(THICK[0], 0.16 / Math.sqrt(m)));
  scene.points = new Float32Array(start.length);
  scene.kinds = {};
  for (const id of [TAUT, SLACK, BROKEN]) scene.kinds[id] = { vertices: new Float32Array(6 * m).fill(NaN) };
  scene.kinds[PICKED] = { vertices: new Float32Array(6).fill(NaN) };
  scene.kinds[TAUT].colours = new Uint32Array(2 * m).fill(colours.none);
  const objects = [
    lines(scene, TAUT, "taut", colours.none, width, scene.kinds[TAUT].vertices.slice()),
    lines(scene, SLACK, "slack", colours.slack, 0.8 * width, scene.kinds[SLACK].vertices.slice()),
    lines(scene, BROKEN, "broken", colours.broken, 1.4 * width, scene.kinds[BROKEN].vertices.slice()),
    lines(scene, PICKED, "picked", colours.support, 2.5 * width, scene.kinds[PICKED].vertices.slice()),
  ];
  for (const [id, name, colour] of MARKS) {
    const n = Math.max(...page.states.map((state) => state[name].length));
    if (n) objects.push(squares(scene, id, name, colours[colour], n));
  }
  return k3d.load({ objects }).then(() => show(scene, page.form, false));
}

function packed(colour) {
  return parseInt(colour.slice(1), 16);
}

// Puts the squares of a kind at the supports of the state; a new number of them makes a new object.
function moveSquares({ k3d, state, points }, id, name) {
  const object = k3d.getWorld().ObjectsListJson[id], n = state[name].length;
  if (!object) return;
  const same = object.visible === n > 0 && object.positions.shape[0] === n;
  object.visible = n > 0;
  if (n) {
    const data = new Float32Array(3 * n);
    state[name].forEach((p, k) => data.set(points.subarray(3 * p, 3 * p + 3), 3 * k));
    object.positions = { data, shape: [n, 3] };
  }
  k3d.reload(object, same && n ? { positions: object.positions } : null, true);
}

function squares(scene, id, name, colour, n) {
  const places = scene.page.start.slice(0, 3 * n);
  const size = scene.extent * Math.min(0.008, 0.06 / Math.sqrt(n));
  return {
    id, name, type: "Points", visible: true, shader: "flat", point_size: size,
    opacity: 1,
    color: colour, positions: { data: places, shape: [n, 3] },
    colors: { data: new Uint32Array(0), shape: [0] }, attribute: { data: new Float32Array(0), shape: [0] },
    point_sizes: { data: new Float32Array(0), shape: [0] },
    opacities: { data: new Float32Array(0), shape: [0] },
    opacity_function: { data: new Float32Array(0), shape: [0] },
    color_range: [],
    model_matrix: { data: new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), shape: [4, 4] },
  };
}

function show(scene, id, visible) {
  const object = scene.k3d.getWorld().ObjectsListJson[id];
  object.visible = visible;
  return scene.k3d.reload(object, null, true).then(() => scene.k3d.render());
}

// --- the time

function showTime(scene, time) {
  if (!scene.state.time.length) return;
  const times = scene.state.time, last = times.length - 1, hair = 1e-9 * times[last];
  let frame = last;
  while (frame > 0 && times[frame] > time + hair) frame--;
  if (frame === scene.frame && scene.drawn === scene.state) return;
  scene.frame = frame;
  scene.drawn = scene.state;
  byId("time").value = frame;
  draw(scene);
}

function toFrame(scene, frame) {
  const times = scene.state.time;
  scene.k3d.setTime(times[Math.max(0, Math.min(times.length - 1, frame))]);
}

function choose(scene, k) {
  const { k3d, page } = scene;
  k3d.stopAutoPlay();
  scene.state = page.states[k];
  scene.frame = 0;
  byId("state").value = k;
  byId("foot").style.display = scene.state.time.length ? "flex" : "none";
  legend(scene);
  draw(scene);
  if (scene.state.time.length) toFrame(scene, 0);
}

function play(scene) {
  const { k3d } = scene;
  if (!scene.state.time.length) return;
  k3d.timeSeriesStartTick = null;
  if (k3d.autoPlayed) k3d.stopAutoPlay();
  else k3d.startAutoPlay();
}

// --- words

function tell(scene) {
  const { state, frame } = scene, slack = state.slack[frame], broken = state.broken[frame];
  byId("told-slack").textContent = `slack: ${slack}`;
  byId("told-broken").textContent = `broken or removed: ${broken}`;
  byId("clock").textContent = state.time.length
    ? `t = ${state.time[frame].toFixed(3)} s, frame ${frame + 1} of ${state.time.length}` : "";
  tellPicked(scene);
}

function tellPicked(scene) {
  const { page, state, picked } = scene;
  if (picked < 0) return;
  const told = page.quantities.map((quantity) => {
    const value = valueOf({ ...scene, quantity }, picked);
    const name = state.strain ? quantity.name : quantity.at_rest;
    // a compressed bar has no utilisation in tension
    if (Number.isNaN(value) || (quantity.over && value < 0)) return `${name} none`;
    const unit = quantity.unit === "-" ? "" : ` ${quantity.unit}`;
    return `${name} ${short(quantity.factor * value, 4)}${unit}`;
  });
  const group = page.groups[page.group[picked]], kind = kindOf(scene, picked);
  byId("picked").textContent = `element ${page.element[picked]}${group ? `, ${group}` : ""}: ` +
    (!kind ? "not there" : kind === BROKEN ? "broken or removed" : told.join("; "));
}

function legend(scene) {
  const { quantity, state, page } = scene, name = state.strain ? quantity.name : quantity.at_rest;
  const bars = [["tension", "tension"], ["compression", "compression"]].filter(([which]) => quantity[which]);
  byId("legend").innerHTML = "";
  for (const [which, word] of bars) {
    const [low, high] = quantity[which].map((end) => end * quantity.factor);
    const shades = page.colours[which].map((c) => `#${c.toString(16).padStart(6, "0")}`);
    const sign = quantity.compression ? `, ${word}` : "";
    const told = document.createElement("div");
    told.textContent = `${name}${sign} [${quantity.unit}]${quantity.over ? `; ${quantity.over}` : ""}`;
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.style.background = `linear-gradient(to right, ${shades.join(",")})`;
    const ticks = document.createElement("div");
    ticks.className = "ticks";
    for (const share of [0, 0.5, 1]) {
      const tick = document.createElement("span");
      tick.textContent = (share === 1 && !quantity.over ? "\u2265 " : "") + short(low + share * (high - low));
      ticks.append(tick);
    }
    byId("legend").append(told, bar, ticks);
  }
}

// --- controls

function setControls(scene) {
  const { page, k3d } = scene, times = page.states[0].time;
  const fill = (name, words, chosen) => {
    words.forEach((word, k) => byId(name).add(new Option(word, k, false, k === chosen)));
  };
  fill("state", page.states.map(({ name }) => name), 0);
  fill("quantity", page.quantities.map(({ name }) => name), 0);
  fill("scale", SCALES.map((scale) => (scale === 1 ? "as it is" : `${scale} times`)), 0);
  const span = times.length ? times[times.length - 1] - times[0] : 1;
  const usual = SPEEDS.reduce((best, speed) =>
    (Math.abs(Math.log(span / speed / PLAYED)) < Math.abs(Math.log(span / best / PLAYED)) ? speed : best));
  fill("speed", SPEEDS.map((speed) => (speed === 1 ? "as it was" : `${speed} times`)), SPEEDS.indexOf(usual));
  k3d.setTimeSpeed(usual);
  byId("time").max = Math.max(0, times.length - 1);
  const colour = page.colours.broken;
  const stroke = (t) => `<i style="left:${(100 * (t - times[0])) / (span || 1)}%;background:${colour}"></i>`;
  byId("strokes").innerHTML = times.length ? page.strokes.map(stroke).join("") : "";
  for (const name of ["slack", "broken"]) byId(`key-${name}`).style.background = page.colours[name];
  byId("key-start").style.background = page.colours.none;
  listen(scene);
}

function listen(scene) {
  const { k3d, page } = scene, on = (name, event, act) => byId(name).addEventListener(event, act);
  const redrawn = (act) => (event) => { act(event); legend(scene); draw(scene); };
  on("state", "change", (event) => choose(scene, Number(event.target.value)));
  on("quantity", "change", redrawn((event) => { scene.quantity = page.quantities[event.target.value]; }));
  on("scale", "change", redrawn((event) => { scene.scale = SCALES[event.target.value]; }));
  on("speed", "change", (event) => {
    k3d.setTimeSpeed(SPEEDS[event.target.value]);
    k3d.timeSeriesStartTick = null;
  });
  on("time", "input", (event) => toFrame(scene, Number(event.target.value)));
  on("play", "click", () => play(scene));
  for (const [name, id] of [["slack", SLACK], ["broken", BROKEN], ["start", page.form]]) {
    on(`show-${name}`, "change", (event) => show(scene, id, event.target.checked).then(() => draw(scene)));
  }
  for (const button of document.querySelectorAll("#views button")) {
    button.addEventListener("click", () => lookFrom(scene, button.dataset.view));
  }
  for (const control of document.querySelectorAll("button, #head input")) { // so that keys lead the time again
    control.addEventListener("click", () => control.blur());
  }
  document.addEventListener("keydown", (event) => press(scene, event));
  const canvas = k3d.getWorld().targetDOMNode;
  let from = null;
  canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; }, true);
  window.addEventListener("pointerup", (event) => {
    const still = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 4;
    if (still) pick(scene, canvas.getBoundingClientRect(), event);
    from = null;
  }, true);
}

function press(scene, event) {
  if (["SELECT", "INPUT"].includes(event.target.tagName) || !scene.state.time.length) return;
  if (event.key === " ") play(scene);
  else if (event.key === "ArrowRight") toFrame(scene, scene.frame + 1);
  else if (event.key === "ArrowLeft") toFrame(scene, scene.frame - 1);
  else return;
  event.preventDefault();
}

// --- where it is seen from

function lookFrom(scene, name) {
  const { k3d, page } = scene, [low, high] = page.window, world = k3d.getWorld();
  const middle = low.map((value, axis) => (value + high[axis]) / 2);
  const views = { space: [0.44, -0.76, 0.48], plan: [0, -1e-3, 1], front: [0, -1, 0], side: [1, 0, 0] };
  const away = farEnough(low.map((value, axis) => (high[axis] - value) / 2), views[name], k3d, world);
  k3d.setCamera([...middle.map((value, axis) => value + away * views[name][axis]), ...middle, 0, 0, 1]);
  world.camera.updateMatrixWorld();
  world.controls.dispatchEvent({ type: "change" }); // or k3d takes the grid's numbers for out of sight
  k3d.render(true); // once more, where it is drawing just now
}

// Distance from which all corners of a box are seen, with room for the grid's numbers.
// half : its half sizes; towards : unit vector to where it is seen from
function farEnough(half, towards, k3d, world) {
  const [x, y, z] = towards, level = Math.hypot(x, y), right = [-y / level, x / level, 0];
  const up = [-z * right[1], z * right[0], x * right[1] - y * right[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const slope = Math.tan((Math.PI / 360) * k3d.parameters.cameraFov), wide = slope * (world.width / world.height);
  let away = 0;
  for (let k = 0; k < 8; k++) {
    const corner = half.map((value, axis) => (k & (1 << axis) ? value : -value));
    const aside = Math.max(Math.abs(dot(corner, right)) / wide, Math.abs(dot(corner, up)) / slope);
    away = Math.max(away, dot(corner, towards) + 1.1 * aside);
  }
  return away;
}

// The element nearest to a click, and what it carries.
function pick(scene, box, event) {
  const { camera } = scene.k3d.getWorld(), { ends } = scene.page;
  const onScreen = (p) => {
    const at = camera.position.clone().set(...scene.points.subarray(3 * p, 3 * p + 3)).project(camera);
    return [box.left + (0.5 + 0.5 * at.x) * box.width, box.top + (0.5 - 0.5 * at.y) * box.height, at.z];
  };
  let best = NEAR;
  scene.picked = -1;
  for (let e = 0; e < ends.length / 2; e++) {
    const a = onScreen(ends[2 * e]), b = onScreen(ends[2 * e + 1]);
    const away = distance([event.clientX, event.clientY], a, b);
    if (away < best && a[2] < 1 && b[2] < 1) [best, scene.picked] = [away, e];
  }
  byId("picked").textContent = "";
  tellPicked(scene);
}

function distance(point, a, b) {
  const along = [b[0] - a[0], b[1] - a[1]], square = along[0] ** 2 + along[1] ** 2;
  const share = square ? ((point[0] - a[0]) * along[0] + (point[1] - a[1]) * along[1]) / square : 0;
  const at = Math.max(0, Math.min(1, share));
  return Math.hypot(point[0] - a[0] - at * along[0], point[1] - a[1] - at * along[1]);
}
