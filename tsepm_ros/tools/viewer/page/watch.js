/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* Where the frames come from, and the time that is shown. */

const byId = (id) => document.getElementById(id);

const source = document.body.dataset.source;
const scene = new Scene();
const plan = new Plan(byId("canvas"), scene);
const healthPanel = new HealthPanel(byId("health"), byId("entries"), byId("health-chip"));
const trackList = new TrackList(byId("tracks"), byId("tracks-title"), select);
const selectedPanel = new SelectedPanel(byId("selected"), plan, () => select(null));

const DRAW_PERIOD = 200; // ms between drawings of what comes; what the user does is drawn at once
const PANEL_PERIOD = 300; // ms between renewals of the panels while frames come
const IMAGE_PERIOD = 500; // ms between questions for a sonar image
const RETRY_PERIODS = [500, 1000, 2000, 5000]; // ms
const LATE = 5000; // ms, at least, after which missing diagnostics are stale
const LATE_INTERVALS = 3; // the same in their intervals
const SAID_PERIOD = 5000; // ms, at least, between changes of what is said to a screen reader
const OWN_SHIP_AGE = 5; // s, after which own ship is not known

const page = {
  index: 0, // the frame that is shown
  playing: source === "live", // live: follow the newest frame
  connected: source !== "live",
  failure: "",
  offset: 0, // ms, of the clock here to that of the server
  elapsed: 0, // s since the data, if it has stopped, else 0
  socket: null,
  drawn: false, // whether a drawing is due
  soon: 0, // timer of the next drawing of what came
  drew: 0, // when it was drawn last, ms
  panels: 0, // when the panels were renewed, ms
  later: 0, // timer of their next renewal
  limits: {}, // of the alarms, as the node has them
  sounded: new Set(), // keys of alarms that have sounded
  unheard: 0, // when the connection was lost, ms; 0: it is there
  hushed: false, // whether the user has silenced that
  audio: null, // made once the sound is on; a browser lets it run after a click
  theme: "light", // by day
  orientation: kept("orientation", null),
  tool: null, // what dragging does: "measure", "cursor", or it moves the view
  byPointer: false, // whether the focus was moved by a pointer
  cursor: null, // where the pointer is on the plan, px
  fitted: "", // what the view of a recording was chosen for
};

/* ---- drawing ---- */

function redraw() {
  if (page.drawn) return;
  page.drawn = true;
  requestAnimationFrame(() => {
    page.drawn = false;
    page.drew = performance.now();
    const { frames } = scene;
    if (page.playing && source === "live") page.index = frames.length - 1;
    page.index = Math.min(Math.max(page.index, 0), Math.max(frames.length - 1, 0));
    const frame = frames[page.index];
    plan.orientation = page.orientation || (scene.north(frame) ? "north" : "head");
    plan.resize();
    plan.orient(frame);
    if (!plan.moved && !plan.layers.follow && frames.length) fit();
    plan.guarded = alarmedIds(scene.alarms, "zone");
    plan.near = trackList.near = alarmedIds(scene.alarms, "cpa");
    plan.lost = lostPlaces(scene.alarms);
    plan.gates = scene.alarms.gates.map(([line, counts]) => [scene.exchanged(line), counts]);
    plan.draw(page.index);
    showTime();
    showCursor();
    showView();
    showOwnShip(frame);
    const now = performance.now();
    if (now - page.panels > PANEL_PERIOD || !page.playing) showPanels();
    else if (!page.later) page.later = setTimeout(showPanels, PANEL_PERIOD);
  });
}

/* Draw what came, but not more often than can be watched. */
function redrawSoon() {
  if (page.soon) return;
  page.soon = setTimeout(() => {
    page.soon = 0;
    redraw();
  }, Math.max(DRAW_PERIOD - (performance.now() - page.drew), 0));
}

/* Choose the view, until the user does: of a recording all of it, once; live what is shown, if it
   has left the view or become small in it. */
function fit() {
  const { frames } = scene;
  if (source === "live") {
    const box = scene.bounds(frames.slice(Math.max(page.index - plan.fading + 1, 0), page.index + 1));
    if (!plan.suits(box)) plan.fit(box);
    return;
  }
  const size = `${frames.length} ${plan.canvas.clientWidth} ${plan.canvas.clientHeight} ${plan.orientation}`;
  if (page.fitted === size) return;
  page.fitted = size;
  const step = Math.ceil(frames.length / 400);
  plan.fit(scene.bounds(frames.filter((_, k) => k % step === 0)));
}

function showTime() {
  const { frames } = scene;
  const frame = frames[page.index];
  const slider = byId("slider");
  change(slider, { max: String(Math.max(frames.length - 1, 0)), disabled: frames.length < 2 });
  change(slider, { value: String(page.index) });
  change(byId("back"), { disabled: page.index <= 0 });
  change(byId("forward"), { disabled: page.index >= frames.length - 1 });
  byId("clock").textContent = frame
    ? `${clock(frame.stamp)} · scan ${source === "live" ? frame.number : `${page.index + 1} of ${frames.length}`}`
    : "";
  slider.setAttribute("aria-valuetext", byId("clock").textContent);
  const play = page.playing ? "Pause" : source === "live" ? "Live" : "Play";
  change(byId("play"), { textContent: play });
  const counts = frame
    ? [countWords(frame, (number) => plural(number, "track")), plural(frame.detections.length / 2, "detection"), plural(frame.potential.length, "potential track")].join(", ")
    : "nothing";
  plan.canvas.setAttribute("aria-label", `Plan position: ${counts}`);
}

function showPanels() {
  page.panels = performance.now();
  clearTimeout(page.later);
  page.later = 0;
  watchData();
  if (page.playing && source === "live") page.index = Math.max(scene.frames.length - 1, 0);
  const frame = scene.frames[page.index];
  const elapsed = page.index === scene.frames.length - 1 ? page.elapsed : 0;
  change(document, { title: scene.info.title || document.title });
  change(byId("title"), { textContent: document.title });
  healthPanel.show(scene.health, ({ heard, period }) =>
    source === "live" && serverTime() - heard > Math.max(LATE, LATE_INTERVALS * period));
  trackList.show(frame, scene, plan.selected, elapsed, sinceStamp(frame), plan.layers.fixed);
  selectedPanel.show(plan.selected, frame, scene, elapsed, sinceStamp(frame));
  byId("save-csv").disabled = byId("save-geojson").disabled = !scene.histories.size;
  byId("save-geojson").hidden = !scene.info.geographic;
  showAlarm();
  showState();
  showLayers(frame);
  say(byId("said"), [byId("state").textContent.replace(/ for .*/, ""), byId("alarm-chip").textContent,
    byId("health-chip").textContent, plan.selected === null ? "" : `Track ${plan.selected}`].filter(Boolean).join(". "));
}

/* Tell a screen reader what has changed, now and then. */
function say(region, words) {
  const now = performance.now();
  if (region.textContent === words || now - (region.said || -Infinity) < SAID_PERIOD) return;
  region.said = now;
  region.textContent = words;
}

/* Range and bearing of the pointer from own ship, and its position. */
function showCursor() {
  const frame = scene.frames[page.index], ship = scene.ownShip(frame);
  byId("cursor").hidden = !page.cursor || !frame;
  if (!page.cursor || !frame) return;
  const [x, y] = plan.world(...page.cursor);
  byId("cursor").textContent = [
    ship && rangeAndBearing(ship, [x, y], scene.up(frame)),
    `x ${digits(x)}, y ${digits(y)} m`, geographicWords(scene.info, x, y),
  ].filter(Boolean).join(" · ");
}

/* ---- data and alarms ---- */

const serverTime = () => performance.now() - page.offset;

/* Time since the stamp of what a live page shows while it follows the data, s; else 0. */
function sinceStamp(frame) {
  if (source !== "live" || !frame || page.index < scene.frames.length - 1) return 0;
  return Math.max((frame.age || 0) + serverTime() - frame.arrived, 0) / 1000;
}

/* Whether data comes: what is shown is stale if not. */
function watchData() {
  if (source !== "live") return;
  const last = scene.frames[scene.frames.length - 1];
  const since = last ? (serverTime() - last.arrived) / 1000 : 0; // a viewer that starts again has none
  page.elapsed = since > scene.alarms.patience ? since : 0;
  if (plan.stale !== page.elapsed > 0) {
    plan.stale = page.elapsed > 0;
    redraw();
  }
}

/* The alarms of the node, after that of the page: a viewer that does not answer. */
function allAlarms() {
  const gone = page.unheard && performance.now() - page.unheard > DISCONNECTED;
  if (!gone) return scene.alarms.alarms;
  return [{
    key: "viewer", title: "Not connected", sentence: "the viewer does not answer, its alarms are not known",
    onset: "", time: Date.now() / 1000 - (performance.now() - page.unheard) / 1000, count: 1, places: {},
    state: page.hushed ? "silenced" : "unacknowledged", sounds: !page.hushed,
  }, ...scene.alarms.alarms];
}

function soundAlarms() {
  // What is played while it cannot be heard would come all at once after the click.
  const heard = byId("sound").checked && page.audio && page.audio.state === "running";
  if (heard && allAlarms().some(({ sounds }) => sounds)) sound(page.audio);
}

function showAlarm() {
  const alarms = allAlarms(), live = source === "live";
  byId("alarm").hidden = !alarms.length;
  byId("alarm").classList.toggle("calm", alarms.every((one) => one.state === "acknowledged"));
  const shown = alarms.slice(0, page.allAlarms ? alarms.length : MAX_SAID);
  const lines = shown.map((one) => [one.state, STATES[one.state], alarmWords(one)]);
  if (alarms.length > MAX_SAID) lines.push(["more", "", page.allAlarms ? "Show less" : `${alarms.length - MAX_SAID} more`]);
  const text = JSON.stringify(lines);
  if (page.alarmText !== text) {
    page.alarmText = text;
    byId("alarm-words").replaceChildren(...lines.map(([state, badge, words]) => (state === "more"
      ? element("li", {}, [element("button", { type: "button", id: "more-alarms", textContent: words })])
      : element("li", { className: state }, [element("b", { textContent: badge }), element("span", { textContent: words })]))));
  }
  const raised = alarms.filter(({ sounds }) => sounds);
  const keys = raised.map(({ key, count }) => `${key} ${count}`);
  if (keys.some((key) => !page.sounded.has(key))) soundAlarms();
  page.sounded = new Set(keys);
  byId("silence").hidden = !raised.length;
  byId("acknowledge").hidden = !alarms.some(({ state, key }) => state !== "acknowledged" && key !== "viewer");
  say(byId("warned"), raised.map(({ title, key }) => `${title}: ${key}`).join(". "));
  const hasData = page.connected && scene.frames.length > 0 && !page.elapsed;
  const [state, kind] = alarmBadge(scene.alarms, hasData);
  change(byId("alarm-chip"), { textContent: state, className: `chip ${kind}`, hidden: !live });
  change(byId("sound-chip"), { hidden: !live || !byId("sound").checked || Boolean(page.audio && page.audio.state === "running") });
  showGates();
}

function showGates() {
  const { gates } = scene.alarms;
  byId("gate-counts").replaceChildren(...gates.map(([, [left, right]], order) =>
    element("li", { textContent: `Gate ${order + 1}: ${left} to the left, ${right} to the right` })));
  byId("gate-files").hidden = !gates.length;
}

function showState() {
  let [words, kind] = ["Recording", "stale"];
  if (source === "live") {
    [words, kind] = page.playing ? ["Live", "ok"] : ["Paused", "warn"];
    const old = scene.alarms.alarms.find(({ key, state }) => key === "age" && state !== "rectified");
    if (page.elapsed) [words, kind] = [`No data for ${wholeSeconds(page.elapsed)}`, "error"];
    else if (!page.connected) [words, kind] = ["Not connected", "error"];
    else if (old) [words, kind] = ["Old data", "error"];
    else if (!scene.frames.length) [words, kind] = ["Waiting", "stale"];
  }
  change(byId("state"), { textContent: words, className: `chip ${kind}` });
  let notice = page.failure;
  if (source === "live" && !page.connected) {
    notice = "The viewer does not answer. The page connects again as soon as it runs; if it has another token then, open the address that it prints.";
  } else if (!notice && !scene.frames.length) {
    notice = source === "live"
      ? waiting(scene.info)
      : "No scan was processed. Health says why.";
  }
  change(byId("notice"), { textContent: notice, hidden: !notice || (scene.frames.length > 0 && page.connected) });
}

function waiting({ topic, published }) {
  return published
    ? `No scan yet. A node publishes ${topic}; the page waits for its first scan.`
    : `Nothing publishes ${topic || "tracks"} yet. Start the node track_initiator.`;
}

function showLayers(frame) {
  const has = {
    truth: scene.truth.length > 0,
    sector: Boolean(scene.sector() && scene.ownShip(frame)) || scene.sensors(frame).some(({ sector, pose }) => sector && pose),
    zone: plan.zone !== null, gates: plan.gates.length > 0, land: scene.land !== null,
    image: source === "live" || scene.images.length > 0,
    ownShip: Boolean(frame && frame.own_ship), follow: Boolean(frame && frame.own_ship),
  };
  for (const [name] of LAYERS) {
    const item = byId(`layer-${name}`).closest("li");
    item.hidden = has[name] === false;
    byId(`layer-${name}`).checked = plan.layers[name];
    if (name === "fixed") item.querySelector("span").textContent = `What stands still (${frame ? standing(frame) : 0})`;
  }
  byId("look").hidden = !has.image || !plan.layers.image;
}

/* ---- time ---- */

function show(index) {
  page.index = index;
  redraw();
}

function setPlaying(playing) {
  page.playing = playing;
  if (playing && source !== "live") {
    if (page.index >= scene.frames.length - 1) page.index = 0;
    step();
  }
  redraw();
  showPanels();
}

let timer = 0;

/* Show the next frame of a recording when its time comes. */
function step() {
  clearTimeout(timer);
  if (!page.playing || source === "live") return;
  const { frames } = scene;
  if (page.index >= frames.length - 1) {
    setPlaying(false);
    return;
  }
  const rate = Number(byId("speed").value);
  const gap = frames[page.index + 1].stamp - frames[page.index].stamp;
  const seconds = rate > 0 ? 1 / rate : Math.min(Math.max(gap, 0), 60);
  timer = setTimeout(() => {
    if (!page.playing) return;
    show(page.index + 1);
    step();
  }, 1000 * seconds);
}

function move(by) {
  page.playing = false;
  show(page.index + by);
  showPanels();
}

function select(id) {
  plan.selected = id;
  redraw();
  showPanels();
}

/* "light" or "dark" by day, or "night". */
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  if (theme !== "night") page.theme = theme;
  byId("night").setAttribute("aria-pressed", String(theme === "night"));
  byId("theme").textContent = page.theme === "dark" ? "Light" : "Dark";
  plan.readColours();
  for (const sign of document.querySelectorAll("#layers canvas")) plan.drawSign(sign, sign.dataset.layer);
  redraw();
  showPanels();
}

/* ---- sources ---- */

function take(message) {
  const removed = scene.removed;
  scene.merge(message);
  page.index -= Math.max(scene.removed - removed, 0); // the same frame is shown while paused
  if (message.all && source === "live") {
    page.offset = performance.now() - message.now;
    showPanels();
  }
  if (message.info) takeInfo(message.info);
  if (source === "live") watchData();
  if (message.alarms) showAlarm();
  redrawSoon();
}

/* Take what all browsers share: the limits of the alarms. */
function takeInfo({ alarm: limits }) {
  if (limits && JSON.stringify(limits) !== JSON.stringify(page.limits)) {
    page.limits = limits;
    const { guard_min_range: near, guard_max_range: far, guard_azimuth_min: begin, guard_azimuth_max: end } = limits;
    plan.zone = far > 0 ? [near, far, begin, end] : null;
  }
  showLimits();
}

/* Ask the server of a live page for something. */
function ask(content) {
  if (page.connected) page.socket.send(JSON.stringify(content));
}

/* Ask for the newest sonar image, while it is shown. */
async function askImage() {
  if (!plan.layers.image || !page.connected || document.hidden) return;
  const image = await fetch("image").then((answer) => answer.json()).catch(() => null);
  if (!image || !page.playing) return;
  scene.merge({ images: [image] });
  redrawSoon();
}

let failures = 0;

function follow() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = page.socket = new WebSocket(`${scheme}//${location.host}/updates`);
  let silent = 0;
  const lose = () => {
    if (page.socket !== socket) return;
    clearTimeout(silent);
    page.socket = null;
    socket.close();
    page.connected = false;
    page.unheard = page.unheard || performance.now();
    showPanels();
    setTimeout(follow, RETRY_PERIODS[Math.min(failures, RETRY_PERIODS.length - 1)]);
    failures += 1;
  };
  socket.addEventListener("close", lose);
  socket.addEventListener("message", (event) => {
    if (page.socket !== socket) return;
    failures = 0;
    clearTimeout(silent);
    silent = setTimeout(lose, DISCONNECTED); // no browser closes what a dead network leaves open
    take(JSON.parse(event.data));
    if (!page.connected) {
      page.connected = true;
      page.unheard = 0;
      page.hushed = false;
      showPanels();
    }
  });
}

async function replay(text) {
  take(JSON.parse(await text));
  show(0);
  setPlaying(true);
}

/* The recording in the page itself: compressed, in base64. */
async function embedded() {
  const bytes = Uint8Array.from(atob(byId("recording").textContent), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

function fail(error) {
  page.failure = `The recording cannot be shown: ${error.message || error}`;
  showPanels();
}

function begin() {
  connectControls();
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => {
    page.theme = dark.matches ? "dark" : "light";
    if (document.documentElement.dataset.theme !== "night") setTheme(page.theme);
  });
  setTheme(dark.matches ? "dark" : "light");
  setInterval(showPanels, 1000);
  setInterval(soundAlarms, SOUND_PERIOD);
  if (source === "live") {
    follow();
    setInterval(askImage, IMAGE_PERIOD);
  } else {
    replay(source === "embedded" ? embedded() : fetch("recording").then((answer) => answer.text()))
      .catch(fail);
  }
}

begin();
