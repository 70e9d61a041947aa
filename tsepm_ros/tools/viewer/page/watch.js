"use strict";

/* Where the frames come from, the time that is shown, and the controls. */

const byId = (id) => document.getElementById(id);

const source = document.body.dataset.source;
const scene = new Scene();
const plan = new Plan(byId("canvas"), scene);
const healthPanel = new HealthPanel(byId("health"), byId("entries"), byId("health-chip"));
const trackList = new TrackList(byId("tracks"), byId("tracks-title"), select);
const selectedPanel = new SelectedPanel(byId("selected"), plan, () => select(null));

const alarm = new Alarm();
plan.near = trackList.near = alarm.near;
let audio = null; // made when the user turns the sound on

const PANEL_PERIOD = 300; // ms between renewals of the panels while frames come
const IMAGE_PERIOD = 500; // ms between questions for a sonar image
const RETRY_PERIODS = [500, 1000, 2000, 5000]; // ms
const LATE = 5000; // ms, at least, after which missing diagnostics are stale

const page = {
  index: 0, // the frame that is shown
  playing: source === "live", // live: follow the newest frame
  connected: source !== "live",
  failure: "",
  heard: 0, // when the last frame arrived, ms
  healthHeard: 0,
  healthPeriod: 0, // between the last two diagnostics, ms
  drawn: false,
  panels: 0,
  watched: null, // the frame that the alarm has seen last
  theme: "light", // by day
  measuring: false,
  cursor: null, // where the pointer is on the plan, px
  fitted: "", // what the view of a recording was chosen for
};

/* ---- drawing ---- */

function redraw() {
  if (page.drawn) return;
  page.drawn = true;
  requestAnimationFrame(() => {
    page.drawn = false;
    const { frames } = scene;
    if (page.playing && source === "live") page.index = frames.length - 1;
    page.index = Math.min(Math.max(page.index, 0), Math.max(frames.length - 1, 0));
    if (!plan.moved && !plan.layers.follow && frames.length) fit();
    if (source !== "live") watchApproaches(frames[page.index]);
    plan.draw(page.index);
    showTime();
    showCursor();
    const now = performance.now();
    if (now - page.panels > PANEL_PERIOD || !page.playing) showPanels();
  });
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
  const size = `${frames.length} ${plan.canvas.clientWidth} ${plan.canvas.clientHeight}`;
  if (page.fitted === size) return;
  page.fitted = size;
  const step = Math.ceil(frames.length / 400);
  plan.fit(scene.bounds(frames.filter((_, k) => k % step === 0)));
}

function showTime() {
  const { frames } = scene;
  const frame = frames[page.index];
  const slider = byId("slider");
  slider.max = Math.max(frames.length - 1, 0);
  slider.value = page.index;
  slider.disabled = frames.length < 2;
  byId("back").disabled = page.index <= 0;
  byId("forward").disabled = page.index >= frames.length - 1;
  byId("clock").textContent = frame
    ? `${clock(frame.stamp)} · scan ${source === "live" ? frame.number : `${page.index + 1} of ${frames.length}`}`
    : "";
  slider.setAttribute("aria-valuetext", byId("clock").textContent);
  byId("play").textContent = page.playing ? "Pause" : source === "live" ? "Live" : "Play";
  const counts = frame
    ? [plural(frame.tracks.length, "track"), plural(frame.detections.length / 2, "detection"),
      plural(frame.potential.length, "potential track")].join(", ")
    : "nothing";
  plan.canvas.setAttribute("aria-label", `Plan position: ${counts}`);
}

function showPanels() {
  page.panels = performance.now();
  const frame = scene.frames[page.index];
  document.title = byId("title").textContent = scene.info.title || document.title;
  const late = silence(page.healthHeard) > Math.max(LATE, 3 * page.healthPeriod);
  healthPanel.show(scene.health, source === "live" && late);
  trackList.show(frame, scene, plan.selected);
  selectedPanel.show(plan.selected, frame, scene);
  byId("arrows").textContent = `Arrows show the way of ${duration(plan.arrowTime)}.${noOwnShip(frame)}`;
  byId("save-csv").disabled = byId("save-geojson").disabled = !scene.histories.size;
  byId("save-geojson").hidden = !scene.info.geographic;
  showAlarm();
  showState();
  showLayers(frame);
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

/* ---- alarm ---- */

/* Take a frame once; one that goes back in a recording begins the approaches anew. */
function watchApproaches(frame) {
  if (!frame || frame === page.watched) return;
  if (source !== "live" && page.watched && frame.number < page.watched.number) alarm.clear();
  page.watched = frame;
  if (!alarm.update(frame, scene)) return;
  if (byId("sound").checked && audio) sound(audio);
  showPanels();
}

function showAlarm() {
  const words = page.watched ? alarm.words(page.watched, scene) : [];
  if (byId("alarm-words").textContent !== `Closest approach: ${words.join(" · ")}`) {
    const parts = words.map((one) => element("span", { textContent: one }));
    byId("alarm-words").replaceChildren("Closest approach: ", ...parts.flatMap((one) => [" · ", one]).slice(1));
  }
  byId("alarm").hidden = !words.length;
  const [state, kind] = alarm.state(page.watched, scene, page.connected);
  byId("alarm-chip").textContent = state;
  byId("alarm-chip").className = `chip ${kind}`;
}

function setAlarm() {
  alarm.limit = Number(byId("limit").value);
  alarm.horizon = 60 * Number(byId("horizon").value);
  alarm.clear();
  page.watched = null;
  redraw();
  watchApproaches(source === "live" ? scene.frames[scene.frames.length - 1] : scene.frames[page.index]);
  showPanels();
}

function setSound() {
  if (byId("sound").checked) {
    audio = audio || new AudioContext();
    audio.resume();
    sound(audio);
  }
}

/* Why no own ship is drawn; empty if it is, or if the diagnostics have not said it yet. */
function noOwnShip(frame) {
  if (!frame || frame.own_ship) return "";
  const entry = ((scene.health && scene.health.entries) || []).find(({ task }) => task === "own ship");
  if (!entry) return "";
  const tf = entry.values.some(([key, value]) => key === "source" && value === "tf");
  return ` No own ship is drawn: ${tf ? "this page does not read tf" : entry.message}.`;
}

const silence = (since) => performance.now() - since;

function showState() {
  let [words, kind] = ["Recording", "stale"];
  if (source === "live") {
    [words, kind] = page.playing ? ["Live", "ok"] : ["Paused", "warn"];
    const quiet = silence(page.heard) / 1000;
    if (!page.connected) [words, kind] = ["Not connected", "error"];
    else if (!scene.frames.length) [words, kind] = ["Waiting", "stale"];
    else if (page.playing && quiet > 3) words = `Live, last scan ${duration(Math.floor(quiet))} ago`;
  }
  byId("state").textContent = words;
  byId("state").className = `chip ${kind}`;
  let notice = page.failure;
  if (source === "live" && !page.connected) {
    notice = "The viewer does not answer. The page connects again as soon as it runs.";
  } else if (!notice && !scene.frames.length) {
    notice = source === "live"
      ? waiting(scene.info)
      : "No scan was processed. Health says why.";
  }
  byId("notice").textContent = notice;
  byId("notice").hidden = !notice || (scene.frames.length > 0 && page.connected);
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
    image: source === "live" || scene.images.length > 0,
    ownShip: Boolean(frame && frame.own_ship), follow: Boolean(frame && frame.own_ship),
  };
  for (const [name] of LAYERS) {
    const item = byId(`layer-${name}`).closest("li");
    item.hidden = has[name] === false;
    byId(`layer-${name}`).checked = plan.layers[name];
  }
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

/* ---- controls ---- */

function connectControls() {
  byId("play").addEventListener("click", () => setPlaying(!page.playing));
  byId("back").addEventListener("click", () => move(-1));
  byId("forward").addEventListener("click", () => move(1));
  byId("slider").addEventListener("input", (event) => {
    page.playing = false;
    show(Number(event.target.value));
  });
  byId("speed").addEventListener("change", step);
  byId("speed-label").hidden = source === "live";
  byId("zoom-in").addEventListener("click", () => { plan.zoom(1.5); redraw(); });
  byId("zoom-out").addEventListener("click", () => { plan.zoom(1 / 1.5); redraw(); });
  byId("fit").addEventListener("click", showAll);
  byId("fading").addEventListener("change", (event) => { plan.fading = Number(event.target.value); redraw(); });
  byId("trailing").addEventListener("change", (event) => { plan.trailing = Number(event.target.value); redraw(); });
  byId("theme").addEventListener("click", () => setTheme(page.theme === "dark" ? "light" : "dark"));
  byId("night").addEventListener("click", () => {
    setTheme(document.documentElement.dataset.theme === "night" ? page.theme : "night");
  });
  byId("measure").addEventListener("click", () => setMeasuring(!page.measuring));
  for (const id of ["limit", "horizon"]) byId(id).addEventListener("change", setAlarm);
  byId("sound").addEventListener("change", setSound);
  byId("alarm-chip").addEventListener("click", () => {
    byId("approach").open = true;
    byId("limit").focus();
  });
  byId("acknowledge").addEventListener("click", () => { alarm.raised.clear(); showPanels(); });
  byId("save-csv").addEventListener("click", () => save("csv", "text/csv", tracksAsCsv));
  byId("save-geojson").addEventListener("click", () => {
    save("geojson", "application/geo+json", tracksAsGeoJson);
  });
  const layers = byId("layers");
  for (const [name, words] of LAYERS) {
    const box = element("input", { type: "checkbox", id: `layer-${name}`, checked: plan.layers[name] });
    box.addEventListener("change", () => { plan.layers[name] = box.checked; redraw(); });
    const sign = element("canvas");
    sign.setAttribute("aria-hidden", "true");
    sign.dataset.layer = name;
    layers.append(element("li", {}, [element("label", {}, [box, sign, element("span", { textContent: words })])]));
  }
  new ResizeObserver(redraw).observe(byId("plot"));
  document.addEventListener("keydown", onKey);
  connectPointers();
}

function save(ending, type, text) {
  const frame = scene.frames[page.index];
  if (frame) download(`tracks.${ending}`, type, text(scene, frame.number));
}

function setMeasuring(on) {
  page.measuring = on;
  plan.ruler = null;
  byId("measure").setAttribute("aria-pressed", String(on));
  plan.canvas.classList.toggle("measuring", on);
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

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (/^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(event.target.tagName) && event.key !== "Escape") return;
  const keys = {
    " ": () => setPlaying(!page.playing),
    ArrowLeft: () => move(-1),
    ArrowRight: () => move(1),
    "+": () => { plan.zoom(1.5); redraw(); },
    "-": () => { plan.zoom(1 / 1.5); redraw(); },
    f: showAll,
    F: showAll,
    m: () => setMeasuring(!page.measuring),
    M: () => setMeasuring(!page.measuring),
    Escape: () => { setMeasuring(false); select(null); },
  };
  if (keys[event.key]) {
    event.preventDefault();
    keys[event.key]();
  }
}

/* Drag to pan, or to measure, wheel or two fingers to zoom, click to select. */
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
    } else if (page.measuring) {
      plan.ruler = [begin, plan.world(...now)];
    } else {
      plan.pan(now[0] - before[0], now[1] - before[1]);
    }
    redraw();
  });
  const end = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (!pointers.size) canvas.classList.remove("dragging");
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
  if (message.frames && message.frames.length) page.heard = performance.now();
  if (source === "live") watchApproaches(scene.frames[scene.frames.length - 1]);
  if (message.health) {
    page.healthPeriod = page.healthHeard ? silence(page.healthHeard) : 0;
    page.healthHeard = performance.now();
  }
  redraw();
}

/* Ask for the newest sonar image, while it is shown. */
async function askImage() {
  if (!plan.layers.image || !page.connected || document.hidden) return;
  const image = await fetch("image").then((answer) => answer.json()).catch(() => null);
  if (!image || !page.playing) return;
  scene.merge({ images: [image] });
  redraw();
}

let failures = 0;

function follow() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(`${scheme}//${location.host}/updates`);
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
  if (source === "live") {
    follow();
    setInterval(askImage, IMAGE_PERIOD);
  } else {
    replay(source === "embedded" ? embedded() : fetch("recording").then((answer) => answer.text()))
      .catch(fail);
  }
}

begin();
