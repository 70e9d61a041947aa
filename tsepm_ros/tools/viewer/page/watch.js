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

const alarm = new Alarm();
plan.near = trackList.near = alarm.near;

const DRAW_PERIOD = 200; // ms between drawings of what comes; what the user does is drawn at once
const PANEL_PERIOD = 300; // ms between renewals of the panels while frames come
const IMAGE_PERIOD = 500; // ms between questions for a sonar image
const RETRY_PERIODS = [500, 1000, 2000, 5000]; // ms
const LATE = 5000; // ms, at least, after which missing data or diagnostics are stale
const LATE_INTERVALS = 3; // the same in intervals of what is missing
const LAST_INTERVALS = 9; // of which the median is taken
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
  watched: null, // the frame that the alarm has seen last
  sounded: new Set(), // keys of alarms that have sounded
  audio: null, // made when the user turns the sound on
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
    if (source !== "live") watchAlarms(frame);
    plan.guarded = new Set(alarm.raised().filter(({ kind }) => kind === "zone").map(({ id }) => id));
    plan.lost = alarm.raised().filter(({ kind }) => kind === "lost").map(({ id, x, y }) => [id, x, y]);
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
    ? [countWords(frame, (number) => plural(number, "track")), `${frame.fixed.length} standing still`,
      plural(frame.detections.length / 2, "detection"), plural(frame.potential.length, "potential track")].join(", ")
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
  trackList.show(frame, scene, plan.selected, elapsed);
  selectedPanel.show(plan.selected, frame, scene, elapsed);
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
    ship && rangeAndBearing(ship, [x, y], scene.north(frame)),
    `x ${digits(x)}, y ${digits(y)} m`, geographicWords(scene.info, x, y),
  ].filter(Boolean).join(" · ");
}

/* ---- data and alarms ---- */

const serverTime = () => performance.now() - page.offset;

/* Time since the newest frame of a live page came, and from which on that is too long, ms. */
function silence() {
  const arrivals = scene.frames.slice(-LAST_INTERVALS - 1).map(({ arrived }) => arrived);
  const intervals = arrivals.slice(1).map((one, k) => one - arrivals[k]).sort((one, other) => one - other);
  const known = 1000 * Number(scene.diagnostic("detections", "scan_interval_s"));
  const interval = intervals.length ? intervals[Math.floor(intervals.length / 2)] : known || 0;
  return [serverTime() - arrivals[arrivals.length - 1], Math.max(LATE, LATE_INTERVALS * interval)];
}

/* Whether data comes: what is shown is stale if not. */
function watchData() {
  if (source !== "live" || !scene.frames.length) return;
  const [since, most] = silence();
  page.elapsed = since > most ? since / 1000 : 0;
  alarm.watchData(scene.frames[scene.frames.length - 1], since > most, since / 1000);
  if (plan.stale !== since > most) {
    plan.stale = since > most;
    redraw();
  }
}

/* Take a frame once; one that goes back in a recording begins the alarms anew. */
function watchAlarms(frame) {
  if (!frame || frame === page.watched) return;
  if (source !== "live" && page.watched && frame.number < page.watched.number) alarm.clear();
  page.watched = frame;
  alarm.update(frame, scene);
}

/* The lost tracks are kept in this browser, as the frames of then may be no more after a reload. */
function keepAlarms() {
  const lost = [...alarm.known.values()].filter(({ kind }) => kind === "lost");
  const text = JSON.stringify(lost);
  if (source !== "live" || !scene.info.begun || text === page.kept) return;
  page.kept = text;
  keep("lost", { begun: scene.info.begun, lost });
}

function restoreAlarms({ begun, lost }) {
  if (begun !== scene.info.begun) return;
  for (const one of lost) {
    if (!alarm.held.has(one.id) && alarm.isRaised(one)) alarm.known.set(one.key, one);
  }
}

function soundAlarms() {
  if (alarm.raised().length && byId("sound").checked && page.audio) sound(page.audio);
}

function showAlarm() {
  const raised = alarm.raised();
  const words = raised.length && page.watched ? alarm.words(page.watched, scene, page.elapsed) : [];
  const text = words.map((parts) => parts.join("")).join(" · ");
  if (byId("alarm-words").textContent !== text) {
    const parts = words.map((one) => element("span", { textContent: one.join("") }));
    byId("alarm-words").replaceChildren(
      ...parts.flatMap((one) => [element("i", { textContent: " · " }), one]).slice(1));
  }
  byId("alarm").hidden = !words.length;
  const keys = raised.map(({ key, number }) => `${key} ${number}`);
  if (keys.some((key) => !page.sounded.has(key))) soundAlarms();
  page.sounded = new Set(keys);
  say(byId("warned"), raised.map(({ kind, id }) =>
    (kind === "data" ? "No data" : `${{ cpa: "Closest approach", zone: "Guard zone", lost: "Lost" }[kind]}: track ${id}`)).join(". "));
  const hasData = source !== "live" || (page.connected && !page.elapsed);
  const [state, kind] = alarm.state(page.watched, scene, hasData);
  change(byId("alarm-chip"), { textContent: state, className: `chip ${kind}` });
  keepAlarms();
}

function showState() {
  let [words, kind] = ["Recording", "stale"];
  if (source === "live") {
    [words, kind] = page.playing ? ["Live", "ok"] : ["Paused", "warn"];
    if (page.elapsed) [words, kind] = [`No data for ${wholeSeconds(page.elapsed)}`, "error"];
    else if (!page.connected) [words, kind] = ["Not connected", "error"];
    else if (!scene.frames.length) [words, kind] = ["Waiting", "stale"];
  }
  change(byId("state"), { textContent: words, className: `chip ${kind}` });
  let notice = page.failure;
  if (source === "live" && !page.connected) {
    notice = "The viewer does not answer. The page connects again as soon as it runs.";
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
    sector: Boolean(scene.sector() && scene.ownShip(frame)),
    zone: plan.zone !== null, land: scene.land !== null,
    image: source === "live" || scene.images.length > 0,
    ownShip: Boolean(frame && frame.own_ship), follow: Boolean(frame && frame.own_ship),
  };
  for (const [name] of LAYERS) {
    const item = byId(`layer-${name}`).closest("li");
    item.hidden = has[name] === false;
    byId(`layer-${name}`).checked = plan.layers[name];
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
  const removed = scene.removed, lost = message.all ? kept("lost", {}) : null;
  scene.merge(message);
  page.index -= Math.max(scene.removed - removed, 0); // the same frame is shown while paused
  if (message.all && source === "live") {
    page.offset = performance.now() - message.now;
    alarm.renew();
  }
  if (message.info) takeInfo(message.info);
  if (source === "live") {
    for (const { number } of message.frames || []) {
      watchAlarms(scene.frames.findLast((one) => one.number === number));
    }
    if (lost) restoreAlarms(lost);
    watchData();
  }
  redrawSoon();
}

/* Take what all browsers share: the alarms' limits, and which alarms were acknowledged. */
function takeInfo({ alarm: limits, acknowledged }) {
  alarm.acknowledged = { ...acknowledged };
  if (limits && JSON.stringify(limits) !== page.limits) {
    page.limits = JSON.stringify(limits);
    setAlarm(limits);
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
  socket.addEventListener("message", (event) => {
    failures = 0;
    take(JSON.parse(event.data));
    if (!page.connected) {
      page.connected = true;
      showPanels();
    }
  });
  socket.addEventListener("close", () => {
    page.connected = false;
    showPanels();
    setTimeout(follow, RETRY_PERIODS[Math.min(failures, RETRY_PERIODS.length - 1)]);
    failures += 1;
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
