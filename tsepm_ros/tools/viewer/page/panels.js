/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* The panels beside the plan: health, tracks, the selected track. Text only, never HTML. */

const LEVELS = [["OK", "ok"], ["Warning", "warn"], ["Error", "error"], ["Stale", "error"]];
const STALE = 3, ORDER = [0, 1, 3, 2]; // levels from the best to the worst

function element(name, properties = {}, children = []) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/* Set properties that have changed: the browser lays out and paints for the others, too. */
function change(node, properties) {
  for (const [name, value] of Object.entries(properties)) if (node[name] !== value) node[name] = value;
}

function pairs(rows) {
  const list = element("dl");
  for (const [key, value] of rows) {
    list.append(element("dt", { textContent: key }), element("dd", { textContent: value }));
  }
  return list;
}

class HealthPanel {
  constructor(root, entries, chip) {
    this.root = root;
    this.entries = entries;
    this.chip = chip;
    this.shown = "";
    chip.addEventListener("click", () => {
      root.open = true;
      root.scrollIntoView({ block: "nearest" });
    });
  }

  /* `late`: whether the diagnostics of a node have stopped. */
  show(nodes, late) {
    this.root.hidden = this.chip.hidden = !nodes.length;
    if (!nodes.length) return;
    const levels = nodes.map((one) => (late(one) ? STALE : one.level));
    const worst = levels.reduce((one, other) => (ORDER.indexOf(other) > ORDER.indexOf(one) ? other : one));
    const [word, kind] = LEVELS[worst];
    change(this.chip, { textContent: `Health: ${word}`, className: `chip ${kind}` });
    const shown = JSON.stringify([nodes.map(({ heard, period, ...one }) => one), levels]);
    if (this.shown === shown) return;
    const opened = new Set([...this.entries.querySelectorAll("details[open]")].map((one) => one.dataset.key));
    const focused = this.entries.contains(document.activeElement)
      ? document.activeElement.closest("details").dataset.key : null;
    const all = nodes.flatMap((node, k) => (levels[k] === STALE && late(node)
      ? [{ task: "diagnostics", level: STALE, message: "no news of this node", values: [], node: node.node }]
      : node.entries.map((entry) => ({ ...entry, node: node.node }))));
    const several = nodes.length > 1;
    const [bad, good] = [all.filter(({ level }) => level > 0), all.filter(({ level }) => level === 0)];
    bad.sort((one, other) => ORDER.indexOf(other.level) - ORDER.indexOf(one.level));
    const folded = element("details", { open: opened.has("OK") }, [
      element("summary", { textContent: `OK (${good.length})` }),
      ...good.map((entry) => this.entry(entry, several, opened)),
    ]);
    folded.dataset.key = "OK";
    this.entries.replaceChildren(
      ...bad.map((entry) => this.entry(entry, several, opened)), ...(good.length ? [folded] : []));
    const again = [...this.entries.querySelectorAll("details")].find((one) => one.dataset.key === focused);
    if (again) again.querySelector("summary").focus({ preventScroll: true });
    if (!this.shown && worst > 0) this.root.open = true;
    this.shown = shown;
  }

  entry({ node, task, level, message, values }, several, opened) {
    const [word, kind] = LEVELS[level], key = `${node} ${task}`;
    const of = several ? `${node.replace(/^\//, "")}${task === "overall" ? "" : `, ${task}`}` : task;
    const parts = [element("p", {}, [
      element("strong", { className: kind, textContent: word }),
      element("span", { textContent: `${of}: ${message}` }),
    ])];
    if (values.length) {
      const figures = element("details", { open: opened.has(key) }, [
        element("summary", { textContent: "Figures" }),
        pairs(values),
      ]);
      figures.dataset.key = key;
      parts.push(figures);
    }
    return element("div", { className: "entry" }, parts);
  }
}

const HEADS = [["Id", "Target"], ["Range", "Range from own ship"], ["Brg", "Bearing from own ship"],
  ["", "Speed"], ["Crs", "Course"], ["CPA", "Distance of the closest approach"],
  ["TCPA", "Time to the closest approach"]];
const SEEN_BY = ["By", "Sensors that see it"]; // where there are several
const RELATIVE = { 2: ["Rel", "Bearing from the bow, clockwise"], 4: ["Crs", "Course from the bow, clockwise"] };

class TrackList {
  constructor(root, title, select) {
    this.root = root;
    this.title = title;
    this.select = select;
    this.body = element("tbody");
    this.heads = HEADS.map(() => element("th", { scope: "col" }));
    this.signs = []; // of several sensors
    this.table = element("table", { hidden: true }, [
      element("thead", {}, [element("tr", {}, this.heads)]), this.body,
    ]);
    this.none = element("p", { className: "muted", textContent: "No track is held." });
    root.append(this.table, this.none);
    this.rows = new Map();
    this.order = []; // ids, as listed
    this.near = new Set(); // ids whose closest approach is below the alarm's limit
  }

  /* Renew the list. `elapsed`: s since the data, while none comes; `since`: s since the stamp. */
  show(frame, scene, selected, elapsed, since, withStanding) {
    const tracks = frame ? frame.tracks.filter((row) => withStanding || !stands(row)) : [];
    const up = scene.up(frame), ship = scene.ownShip(frame);
    change(this.title, { textContent: `Tracks (${frame ? countWords(frame) : 0})` });
    HEADS.forEach((head, k) => {
      const [words, title] = (!scene.isTrue(frame) && RELATIVE[k]) || head;
      const shown = words || units.speedName;
      if (this.heads[k].textContent !== shown) Object.assign(this.heads[k], { textContent: shown, title });
    });
    const names = scene.sensorNames;
    this.signs = sensorSigns(names);
    if (names.length && this.heads.length === HEADS.length) {
      this.heads.push(element("th", { scope: "col", textContent: SEEN_BY[0], title: SEEN_BY[1] }));
      this.table.tHead.rows[0].append(this.heads[HEADS.length]);
    }
    this.table.hidden = !tracks.length;
    this.table.classList.toggle("stale", elapsed > 0);
    this.none.hidden = Boolean(tracks.length);
    const focused = this.body.contains(document.activeElement) ? document.activeElement : null;
    const held = new Set(tracks.map((track) => track[Row.ID]));
    for (const [id, row] of this.rows) {
      if (!held.has(id)) {
        row.remove();
        this.rows.delete(id);
      }
    }
    const approaches = new Map(tracks.map((track) => [track[Row.ID], closestApproach(track)]));
    const trackOf = new Map(tracks.map((track) => [track[Row.ID], track]));
    const rank = (id) => {
      const approach = approaches.get(id);
      return approach && approach.time >= since && !stands(trackOf.get(id)) ? approach.time : Infinity;
    };
    const far = (id) => !this.near.has(id);
    this.order = [...held].sort((one, other) => far(one) - far(other)
      || (rank(one) === rank(other) ? one - other : rank(one) - rank(other)));
    for (const [line, id] of this.order.entries()) {
      const row = this.rows.get(id) || this.add(id), track = trackOf.get(id);
      if (this.body.rows[line] !== row) this.body.insertBefore(row, this.body.rows[line] || null);
      this.fill(row, track, ship, approaches.get(id), up, since);
      if (names.length) this.fillSeen(row.cells[HEADS.length] || row.insertCell(), scene.seenBy(track), names);
      row.classList.toggle("chosen", id === selected);
      row.classList.toggle("near", this.near.has(id));
      row.classList.toggle("coasting", coasts(track));
      change(row.cells[0].lastChild, { textContent: statusWords(track) });
      change(row, { title: missed(track) ? missedWords(track, since) : "" });
    }
    // A row that is moved loses the focus.
    if (focused && document.activeElement !== focused && focused.isConnected) focused.focus({ preventScroll: true });
  }

  fill(row, track, ship, approach, up, since) {
    const way = ship && [track[Row.X] - ship[0], track[Row.Y] - ship[1]];
    const still = stands(track), ahead = !still && approach && approach.time >= since;
    const texts = [
      way ? distance(Math.hypot(...way)) : "", way ? direction(...way, up) : "",
      still ? "" : speed(track[Row.VX], track[Row.VY]), still ? "" : direction(track[Row.VX], track[Row.VY], up),
      ahead ? distance(approach.distance) : "",
      ahead ? duration(approach.time - since) : approach && !still ? "past" : "",
    ];
    texts.forEach((words, place) => {
      const cell = row.cells[place + 1];
      if (cell.textContent !== words) cell.textContent = words;
    });
  }

  /* Signs of the sensors that see a track, in their colours. */
  fillSeen(cell, seen, names) {
    change(cell, { title: seen.map((k) => names[k]).join(", ") });
    const marks = seen.map((k) => element("b", { textContent: this.signs[k], className: `sensor${k % SENSOR_COLOURS}` }));
    if (cell.textContent !== seen.map((k) => this.signs[k]).join("")) cell.replaceChildren(...marks);
  }

  add(id) {
    const button = element("button", { type: "button", textContent: String(id) });
    button.setAttribute("aria-label", `Track ${id}`);
    const row = element("tr", {}, [
      element("td", {}, [button, element("small")]), ...HEADS.slice(1).map(() => element("td")),
    ]);
    row.addEventListener("click", () => this.select(id));
    this.rows.set(id, row);
    return row;
  }

  /* The id after or before the selected one in the list, or null. */
  next(selected, by) {
    const { order } = this, place = order.indexOf(selected);
    if (!order.length) return null;
    return order[(place < 0 ? (by > 0 ? 0 : order.length - 1) : place + by + order.length) % order.length];
  }
}

class SelectedPanel {
  constructor(root, plan, deselect) {
    this.root = root;
    this.plan = plan;
    this.name = element("span");
    this.state = element("span", { className: "chip" });
    const close = element("button", { type: "button", textContent: "Close", title: "Escape" });
    close.addEventListener("click", deselect);
    this.reason = element("p");
    this.now = element("div");
    this.graph = element("canvas", { role: "img" });
    this.graphTitle = element("h3");
    this.hits = element("details", {}, [element("summary", { textContent: "Hits" })]);
    this.hitList = element("div");
    this.hits.append(this.hitList);
    root.append(element("h2", {}, [this.name, this.state, close]), this.reason, this.now,
      this.graphTitle, this.graph, this.hits);
    this.hitsOf = null;
  }

  show(id, frame, scene, elapsed, since) {
    this.root.hidden = id === null || !frame;
    if (this.root.hidden) return;
    const facts = scene.facts[id] || {};
    const history = scene.trail(id, frame.number, Infinity);
    const row = frame.tracks.find((one) => one[Row.ID] === id);
    const last = history[history.length - 1];
    this.name.textContent = `Track ${id}`;
    const [state, kind] = this.stateOf(id, row, last, frame, scene, elapsed);
    this.state.textContent = state;
    this.state.className = `chip ${kind}`;
    this.reason.textContent = this.why(facts, history, frame);
    const rows = row ? this.present(row, facts, frame, scene, since) : [];
    if (!row && last) rows.push(["Last held", clock(last.stamp)]);
    if (state === "ended") rows.push(["Reason", facts.ended[1]]);
    this.now.replaceChildren(pairs(rows));
    this.drawGraph(history);
    const hits = facts.hits || [];
    this.hits.hidden = !hits.length;
    if (this.hitsOf !== id && hits.length) {
      this.hitsOf = id;
      const names = scene.sensorNames;
      const cells = hits.map(([stamp, x, y, sensor], order) => element("tr", {}, [
        String(order + 1), clock(stamp), digits(x), digits(y), ...(names.length ? [names[sensor] || ""] : []),
      ].map((words) => element("td", { textContent: words }))));
      const heads = ["", "Time", "x, m", "y, m", ...(names.length ? ["Sensor"] : [])].map((words) => element("th", { textContent: words }));
      this.hitList.replaceChildren(element("table", {}, [
        element("thead", {}, [element("tr", {}, heads)]), element("tbody", {}, cells),
      ]));
    }
  }

  /* What has become of a track, and the kind of its badge. Only a recording knows the ends. */
  stateOf(id, row, last, frame, scene, elapsed) {
    const { ended } = scene.facts[id] || {};
    if (row && elapsed) return ["no data", "error"];
    if (row) return [statusWords(row) || "confirmed", coasts(row) || missed(row) ? "warn" : "ok"];
    if (frame.fixed.some((one) => one[Row.ID] === id)) return ["fixed echo", "stale"];
    if (ended && ended[0] <= frame.stamp + 1e-6) return ["ended", "stale"];
    if (!last) return ["not yet confirmed", "stale"];
    return [scene.info.kind === "live" ? "ended or not published" : "not published", "stale"];
  }

  why(facts, history, frame) {
    const reason = facts.reason ? ` ${facts.reason}.` : "";
    if (typeof facts.confirmed === "number") {
      if (facts.confirmed > frame.stamp + 1e-6) return `Confirmed later, at ${clock(facts.confirmed)}.`;
      return `Confirmed at ${clock(facts.confirmed)}:${reason || " no reason given."}`;
    }
    const begin = history.length ? ` Seen here from ${clock(history[0].stamp)} on.` : "";
    return `Confirmed before this page's history began.${reason}${begin}`;
  }

  present(row, facts, frame, scene, since) {
    const up = scene.up(frame), from = scene.isTrue(frame) ? "" : " from the bow";
    const [x, y, vx, vy] = [row[Row.X], row[Row.Y], row[Row.VX], row[Row.VY]];
    const rows = [
      ["Speed", `${speed(vx, vy)} ± ${speedWords(row[Row.SPEED_STD])}`],
      [`Course${from}`, direction(vx, vy, up)],
    ];
    const origin = scene.ownShip(frame);
    if (origin) {
      const [dx, dy] = [x - origin[0], y - origin[1]];
      rows.push(["Range", distance(Math.hypot(dx, dy))]);
      rows.push([`Bearing${from}`, direction(dx, dy, up)]);
    }
    const approach = closestApproach(row);
    if (approach) rows.push(["Closest approach", approachWords(approach, since)]);
    rows.push(["Position x, y", `${digits(x)}, ${digits(y)} m`]);
    const place = geographicWords(scene.info, x, y);
    if (place) rows.push(["Latitude, longitude", place]);
    const names = scene.sensorNames, seen = scene.seenBy(row).map((k) => names[k]);
    if (names.length) rows.push(["Seen by", seen.join(", ") || "no sensor"]);
    if (coasts(row)) rows.push(["Exists with", `${Math.round(100 * row[Row.EXISTENCE])} %`]);
    rows.push(["Last detection", `${duration(row[Row.SINCE_HIT] + since)} ago`]);
    // Its axes, not their halves.
    rows.push(["95 % ellipse", `${distance(2 * row[Row.MAJOR])} by ${distance(2 * row[Row.MINOR])}`]);
    if (typeof facts.first === "number") {
      rows.push(["Since the first hit", duration(frame.stamp - facts.first + since)]);
    }
    return rows;
  }

  /* Speed over time. */
  drawGraph(history) {
    const enough = history.length > 1;
    this.graph.hidden = this.graphTitle.hidden = !enough;
    if (!enough) return;
    const speeds = history.map((point) => Math.hypot(point.vx, point.vy) / units.speed);
    const top = Math.max(roundUp(speeds.reduce((one, other) => Math.max(one, other))), 1e-3);
    const span = history[history.length - 1].stamp - history[0].stamp;
    this.graphTitle.textContent = `Speed over the last ${duration(span)}, 0 to ${top} ${units.speedName}`;
    this.graph.setAttribute("aria-label", this.graphTitle.textContent);
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.graph.clientWidth, this.graph.clientHeight];
    this.graph.width = Math.round(width * ratio);
    this.graph.height = Math.round(height * ratio);
    const context = this.graph.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const { colour } = this.plan;
    context.strokeStyle = colour.ring;
    for (const share of [0, 0.5, 1]) {
      context.beginPath();
      context.moveTo(0, 2 + share * (height - 4)); context.lineTo(width, 2 + share * (height - 4));
      context.stroke();
    }
    context.strokeStyle = colour.track;
    context.lineWidth = 1.8;
    context.beginPath();
    history.forEach((point, place) => {
      const share = span > 0 ? (point.stamp - history[0].stamp) / span : place / (history.length - 1);
      context.lineTo(share * width, height - 2 - (speeds[place] / top) * (height - 4));
    });
    context.stroke();
  }
}

function missedWords(row, since) {
  return `${coasts(row) ? "coasting, " : ""}no detection for ${duration(row[Row.SINCE_HIT] + since)}`;
}

function roundUp(value) {
  if (!(value > 0)) return 1;
  const down = roundDown(value);
  return down >= value ? down : [1, 2, 5, 10].map((f) => f * 10 ** Math.floor(Math.log10(value)))
    .find((one) => one >= value);
}
