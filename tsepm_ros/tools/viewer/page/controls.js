/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* What the user does: keys, pointers, and the controls of the view and of the alarms. */

const PAN_STEP = 60; // px, of a key
const LENGTHS = ["cpa_limit", "guard_min_range", "guard_max_range", "lost_range"]; // limits
const SWITCHES = ["lost_targets", "guard_standing"];
const VECTOR_TIMES = [0, 10, 30, 60, 180, 360, 720, 1800]; // s; 0: as fits the view

/* Controls that a key is left to, while they have the focus: of a number its digits and the keys
   that edit it; of any other control, once the focus was moved by key, what it takes itself. */
function takesKey(control, key, shift) {
  const kind = control.tagName === "INPUT" ? control.type : control.tagName;
  if (kind === "number") return !/^[a-df-z +=\-]$/i.test(key) && !(shift && key.startsWith("Arrow"));
  if (page.byPointer) return false;
  if (kind === "range") return /^(Arrow|Home|End|Page)/.test(key);
  if (kind === "SELECT") return !/^[+=\-]$/.test(key);
  return /^(BUTTON|SUMMARY|checkbox)$/.test(kind) && /^( |Enter)$/.test(key);
}

function onKey(event) {
  if (event.key === "Tab") page.byPointer = false;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "Enter" && event.target.type === "number") event.target.blur();
  if (event.key !== "Escape" && takesKey(event.target, event.key, event.shiftKey)) return;
  const pan = (dx, dy) => { plan.pan(dx * PAN_STEP, dy * PAN_STEP); redraw(); };
  const keys = event.shiftKey ? {
    ArrowLeft: () => pan(1, 0), ArrowRight: () => pan(-1, 0),
    ArrowUp: () => pan(0, 1), ArrowDown: () => pan(0, -1),
    t: () => selectNext(-1),
  } : {
    ArrowLeft: () => move(-1), ArrowRight: () => move(1), t: () => selectNext(1),
  };
  Object.assign(keys, {
    " ": () => setPlaying(!page.playing),
    "+": () => zoomStep(false), "=": () => zoomStep(false),
    "-": () => zoomStep(true), "−": () => zoomStep(true),
    f: showAll,
    m: () => setTool("measure"),
    b: () => setTool("cursor"),
    a: acknowledge,
    Escape: () => {
      if (event.target.type === "number") event.target.blur();
      setTool(null);
      select(null);
    },
  });
  const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act) return;
  event.preventDefault();
  act();
}

function selectNext(by) {
  const id = trackList.next(plan.selected, by);
  if (id !== null) select(id);
}

/* ---- the view ---- */

function zoomStep(larger) {
  const before = plan.range;
  plan.zoom(before / nextScale(before, larger));
  redraw();
}

/* Measure, or the bearing line and range ring: on, or off if it is on. */
function setTool(tool) {
  page.tool = page.tool === tool ? null : tool;
  if (page.tool !== "measure" && page.tool !== "gate") plan.ruler = null;
  if (tool === "cursor" || tool === null) {
    const ship = scene.ownShip(scene.frames[page.index]);
    plan.cursor = page.tool === "cursor" && ship ? plan.cursor || { range: 0.5 * plan.range, bearing: ship[2] || 0 } : null;
  }
  byId("measure").setAttribute("aria-pressed", String(page.tool === "measure"));
  byId("draw-gate").setAttribute("aria-pressed", String(page.tool === "gate"));
  byId("bearing-line").setAttribute("aria-pressed", String(plan.cursor !== null));
  plan.canvas.classList.toggle("measuring", page.tool !== null);
  redraw();
}

function showAll() {
  plan.moved = false;
  page.fitted = "";
  plan.fittedBox = null;
  plan.layers.follow = false;
  redraw();
  showPanels();
}

function setOrientation(event) {
  page.orientation = event.target.value;
  keep("orientation", page.orientation);
  // A picture that turns about another place than own ship cannot be followed.
  const frame = scene.frames[page.index];
  if (page.orientation !== "north" && frame && frame.own_ship && plan.moved) plan.layers.follow = true;
  redraw();
  showPanels();
}

function setUnits(event) {
  units.nautical = event.target.value !== "";
  keep("nautical", units.nautical);
  fillRanges();
  showLimits(true);
  redraw();
  showPanels();
}

function fillRanges() {
  byId("range").replaceChildren(element("option", { value: "" }), ...rangeScales().map((meters) =>
    element("option", { value: String(meters), textContent: `Range ${roundDistance(meters)}` })));
  for (const one of document.querySelectorAll("#limits .length")) one.textContent = units.lengthName;
}

/* What the view's controls say. */
function showView() {
  const { range } = plan, select = byId("range");
  const step = rangeScales().find((one) => Math.abs(one / range - 1) < 1e-3);
  change(select.options[0], { textContent: `Range ${distance(range)}`, hidden: step !== undefined });
  change(select, { value: step === undefined ? "" : String(step) });
  change(byId("orientation"), { value: plan.orientation });
  const frame = scene.frames[page.index];
  change(byId("bearings"), { value: scene.isTrue(frame) ? "" : "1", disabled: !scene.north(frame) });
  change(byId("vectors").options[0], { textContent: `Vectors ${duration(plan.arrowTime)}, auto` });
}

function showOwnShip(frame) {
  const ship = scene.ownShip(frame), north = scene.north(frame), up = scene.up(frame), line = byId("own-ship");
  const age = ship && ship.length > 5 ? ship[5] : 0, moves = Boolean(frame && frame.own_ship);
  const words = [];
  let fails = false;
  if (moves && ship[3] === null && age > OWN_SHIP_AGE) {
    [words[0], fails] = [`No own ship for ${wholeSeconds(age + page.elapsed)}`, true];
  } else if (moves) {
    if (ship[2] === null) words.push("no heading");
    else if (north) words.push(`HDG ${direction(Math.cos(ship[2]), Math.sin(ship[2]), Math.PI / 2)}`);
    if (ship[3] !== null) {
      if (Math.hypot(ship[3], ship[4]) > LEAST_WAY) words.push(`COG ${direction(ship[3], ship[4], north ? Math.PI / 2 : up)}`);
      words.push(`SOG ${speedWords(ship[3], ship[4])}`);
    }
  } else {
    words.push(noOwnShip(frame));
  }
  if (frame && plan.relative && !(ship && ship[3] !== null)) words.push("no speed of own ship: true vectors");
  if (frame && !plan.oriented) words.push(`no ${plan.orientation === "head" ? "heading" : "course"}: ${north ? "north" : "y"} up`);
  const shown = words.filter(Boolean).join(" · ");
  change(line, { textContent: shown, className: fails ? "error" : "", hidden: !shown });
}

/* Why no own ship is drawn; empty if it is, or if the diagnostics have not said it yet. */
function noOwnShip(frame) {
  if (!frame || frame.own_ship) return "";
  const entry = scene.entry("own ship");
  if (!entry || scene.diagnostic("own ship", "source") === "none") return "";
  return `No own ship is drawn: ${scene.diagnostic("own ship", "source") === "tf" ? "this page does not read tf" : entry.message}`;
}

/* ---- alarms ---- */

function allRound({ guard_azimuth_min: begin, guard_azimuth_max: end }) {
  return end - begin > 2 * Math.PI - 1e-6;
}

/* Show the limits of the alarms, but in a field that is being written. */
function showLimits(all = false) {
  const settings = page.limits;
  if (settings.cpa_limit === undefined) return;
  const clockwise = (angle) => ((-angle * 180 / Math.PI) % 360 + 360) % 360;
  const shown = {
    tcpa_limit: settings.tcpa_limit / 60,
    guard_from: allRound(settings) ? 0 : clockwise(settings.guard_azimuth_max),
    guard_to: allRound(settings) ? 360 : clockwise(settings.guard_azimuth_min),
  };
  for (const id of LENGTHS) shown[id] = settings[id] / units.length;
  for (const [id, value] of Object.entries(shown)) {
    const field = byId(id), words = String(Number(value.toPrecision(4)));
    if ((all || document.activeElement !== field) && field.value !== words) field.value = words;
  }
  for (const id of SWITCHES) byId(id).checked = settings[id];
  change(byId("alarm-note"), { textContent: scene.info.refused || "", hidden: !scene.info.refused });
}

/* The parameters that a field sets. */
function limitsOf(id) {
  const value = (field) => Math.max(Number(byId(field).value) || 0, 0);
  if (SWITCHES.includes(id)) return { [id]: byId(id).checked };
  if (id === "tcpa_limit") return { [id]: 60 * value(id) };
  if (!/^guard_(from|to)$/.test(id)) return { [id]: value(id) * units.length };
  let [from, to] = [value("guard_from") % 360, value("guard_to") % 360];
  if (from === to) return { guard_azimuth_min: -Math.PI, guard_azimuth_max: Math.PI };
  if (from > to) from -= 360;
  return { guard_azimuth_min: -to * Math.PI / 180, guard_azimuth_max: -from * Math.PI / 180 };
}

/* Acknowledge what the page has, in messages that are not too large: what has begun since stays. */
function acknowledge() {
  const counts = scene.alarms.alarms.map(({ key, count }) => [key, count]);
  for (let k = 0; k < counts.length; k += 50) ask({ acknowledge: Object.fromEntries(counts.slice(k, k + 50)) });
}

function silence() {
  page.hushed = true;
  ask({ silence: true });
  showPanels();
}

/* A browser makes no sound before the user has done something: the page says so until then. */
function startSound() {
  if (!byId("sound").checked) return;
  page.audio = page.audio || new AudioContext();
  page.audio.onstatechange = showPanels;
  page.audio.resume();
}

function setSound() {
  keep("sound", byId("sound").checked);
  startSound();
  if (byId("sound").checked) sound(page.audio);
  showPanels();
}

/* Gates as the node's parameter has them, and with another line: counts are those of a line that
   stays the same to the last digit. */
function setGates(lines) {
  ask({ alarm: { gates: lines.join(";") } });
}

function addGate([[x1, y1], [x2, y2]]) {
  const line = scene.exchanged([x1, y1, x2, y2]).map((value) => value.toFixed(2));
  setGates([...scene.alarms.gates.map(([other]) => other), line]);
  setTool(null);
}

/* ---- pointers ---- */

/* Drag to pan, or with a tool, wheel or two fingers to zoom, click to select. */
function connectPointers() {
  const { canvas } = plan;
  const pointers = new Map();
  let travelled = 0, begin = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) travelled = 0;
    begin = plan.world(...place(event));
    canvas.classList.add("dragging");
  });
  canvas.addEventListener("pointerleave", () => { page.cursor = null; showCursor(); });
  canvas.addEventListener("pointermove", (event) => {
    page.cursor = place(event);
    showCursor();
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    pointers.set(event.pointerId, now);
    travelled += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (travelled < 5) return; // a click, not a drag
    if (others.length) {
      const [other] = others;
      const apart = (at) => Math.max(Math.hypot(at[0] - other[0], at[1] - other[1]), 10);
      plan.zoom(apart(now) / apart(before), 0.5 * (now[0] + other[0]), 0.5 * (now[1] + other[1]));
      plan.pan(0.5 * (now[0] - before[0]), 0.5 * (now[1] - before[1]));
    } else if (page.tool === "measure" || page.tool === "gate") {
      plan.ruler = [begin, plan.world(...now)];
    } else if (page.tool === "cursor" && plan.cursor) {
      const ship = scene.ownShip(scene.frames[page.index]) || [0, 0], [x, y] = plan.world(...now);
      plan.cursor = { range: Math.hypot(x - ship[0], y - ship[1]), bearing: Math.atan2(y - ship[1], x - ship[0]) };
    } else {
      plan.pan(now[0] - before[0], now[1] - before[1]);
    }
    redraw();
  });
  const end = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (!pointers.size) canvas.classList.remove("dragging");
    if (event.type === "pointerup" && page.tool === "gate" && plan.ruler && travelled >= 5) addGate(plan.ruler);
    if (event.type === "pointerup" && !pointers.size && travelled < 5) {
      select(plan.pick(scene.frames[page.index], ...place(event)));
    }
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    plan.zoom(Math.exp(-0.0015 * lines * event.deltaY), ...place(event));
    redraw();
  }, { passive: false });
}

/* ---- controls ---- */

function connectControls() {
  // What a browser writes into fields after a reload is not what the page has.
  for (const field of document.querySelectorAll("input, select")) field.autocomplete = "off";
  const on = (id, kind, act) => byId(id).addEventListener(kind, act);
  const choose = (id, act) => on(id, "change", (event) => { act(Number(event.target.value)); redraw(); showPanels(); });
  on("play", "click", () => setPlaying(!page.playing));
  on("back", "click", () => move(-1));
  on("forward", "click", () => move(1));
  on("slider", "input", (event) => {
    page.playing = false;
    show(Number(event.target.value));
  });
  on("speed", "change", step);
  byId("speed-label").hidden = source === "live";
  on("zoom-in", "click", () => zoomStep(false));
  on("zoom-out", "click", () => zoomStep(true));
  on("fit", "click", showAll);
  on("measure", "click", () => setTool("measure"));
  on("bearing-line", "click", () => setTool("cursor"));
  choose("range", (meters) => { if (meters) plan.range = meters; });
  choose("fading", (scans) => { plan.fading = scans; });
  choose("trailing", (scans) => { plan.trailing = scans; });
  choose("past", (seconds) => { plan.pastEvery = seconds; keep("past", seconds); });
  choose("vectors", (seconds) => { plan.vectorTime = seconds; keep("vectors", seconds); });
  choose("relative", (is) => { plan.relative = Boolean(is); keep("relative", is); });
  on("gain", "input", (event) => { plan.gain = Number(event.target.value); redraw(); });
  on("contrast", "input", (event) => { plan.contrast = Number(event.target.value); redraw(); });
  on("orientation", "change", setOrientation);
  on("units", "change", setUnits);
  on("theme", "click", () => setTheme(page.theme === "dark" ? "light" : "dark"));
  on("night", "click", () => {
    setTheme(document.documentElement.dataset.theme === "night" ? page.theme : "night");
  });
  for (const field of document.querySelectorAll("#limits input, #lost_targets, #guard_standing")) {
    field.required = field.type === "number";
    field.addEventListener("change", () => {
      if (field.validity.valid) ask({ alarm: limitsOf(field.id) });
      else showLimits(true); // what cannot be read is no limit of 0
    });
  }
  on("sound", "change", setSound);
  on("sound-chip", "click", startSound);
  on("silence", "click", silence);
  on("alarm-words", "click", (event) => {
    if (event.target.id !== "more-alarms") return;
    page.allAlarms = !page.allAlarms;
    showPanels();
  });
  on("draw-gate", "click", () => setTool("gate"));
  on("remove-gates", "click", () => setGates([]));
  choose("bearings", (is) => { units.relative = Boolean(is); keep("bearings", units.relative); });
  on("view", "click", () => {
    const open = byId("bar").classList.toggle("open");
    byId("view").setAttribute("aria-expanded", String(open));
  });
  for (const id of ["approach", "gates"]) byId(id).hidden = source !== "live";
  on("alarm-chip", "click", () => {
    byId("approach").open = true;
    byId("cpa_limit").focus();
  });
  on("acknowledge", "click", acknowledge);
  on("save-csv", "click", () => save("csv", "text/csv", tracksAsCsv));
  on("save-geojson", "click", () => save("geojson", "application/geo+json", tracksAsGeoJson));
  const layers = byId("layers");
  for (const [name, words] of LAYERS) {
    const box = element("input", { type: "checkbox", id: `layer-${name}`, checked: plan.layers[name] });
    box.addEventListener("change", () => { plan.layers[name] = box.checked; redraw(); showPanels(); });
    const sign = element("canvas");
    sign.setAttribute("aria-hidden", "true");
    sign.dataset.layer = name;
    layers.append(element("li", {}, [element("label", {}, [box, sign, element("span", { textContent: words })])]));
  }
  for (const seconds of VECTOR_TIMES) {
    byId("vectors").append(element("option", { value: String(seconds), textContent: `Vectors ${duration(seconds)}` }));
  }
  plan.vectorTime = kept("vectors", 0);
  plan.relative = Boolean(kept("relative", 0));
  plan.pastEvery = kept("past", 0);
  byId("vectors").value = String(plan.vectorTime);
  byId("relative").value = plan.relative ? "1" : "";
  byId("past").value = String(plan.pastEvery);
  byId("units").value = units.nautical ? "1" : "";
  byId("bearings").value = units.relative ? "1" : "";
  byId("sound").checked = kept("sound", false);
  startSound();
  fillRanges();
  showLimits();
  new ResizeObserver(redraw).observe(byId("plot"));
  document.addEventListener("keydown", onKey);
  // Firefox presses a button on the way up.
  document.addEventListener("keyup", (event) => {
    if (event.key === " " && page.byPointer && event.target.tagName === "BUTTON") event.preventDefault();
  });
  document.addEventListener("pointerdown", () => {
    page.byPointer = true;
    startSound();
  }, true);
  connectPointers();
}

function save(ending, type, text) {
  const frame = scene.frames[page.index];
  if (frame) download(`tracks.${ending}`, type, text(scene, frame.number));
}
