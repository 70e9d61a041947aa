"use strict";

/* The panels beside the plan: health, tracks, the selected track. Text only, never HTML. */

const LEVELS = [["OK", "ok"], ["Warning", "warn"], ["Error", "error"], ["Stale", "stale"]];

function element(name, properties = {}, children = []) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
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
    this.shown = undefined;
    chip.addEventListener("click", () => {
      root.open = true;
      root.scrollIntoView({ block: "nearest" });
    });
  }

  show(health, late) {
    this.root.hidden = this.chip.hidden = !health;
    if (!health) return;
    const [word, kind] = LEVELS[late ? 3 : health.level];
    this.chip.textContent = `Health: ${word}`;
    this.chip.className = `chip ${kind}`;
    if (this.shown === health) return;
    const opened = new Set([...this.entries.querySelectorAll("details[open]")]
      .map((one) => one.dataset.task));
    this.entries.replaceChildren(...health.entries.map((entry) => this.entry(entry, opened)));
    if (this.shown === undefined && health.level > 0) this.root.open = true;
    this.shown = health;
  }

  entry({ task, level, message, values }, opened) {
    const [word, kind] = LEVELS[level];
    const parts = [element("p", {}, [
      element("strong", { className: kind, textContent: word }),
      element("span", { textContent: `${task}: ${message}` }),
    ])];
    if (values.length) {
      const figures = element("details", { open: opened.has(task) }, [
        element("summary", { textContent: "Figures" }),
        pairs(values),
      ]);
      figures.dataset.task = task;
      parts.push(figures);
    }
    return element("div", { className: "entry" }, parts);
  }
}

class TrackList {
  constructor(root, title, select) {
    this.root = root;
    this.title = title;
    this.select = select;
    this.body = element("tbody");
    this.heading = element("th");
    const heads = ["Id", "m/s", null, "CPA", "TCPA", "Unseen"].map((words) =>
      words === null ? this.heading : element("th", { textContent: words }));
    this.table = element("table", { hidden: true }, [
      element("thead", {}, [element("tr", {}, heads)]), this.body,
    ]);
    this.none = element("p", { className: "muted", textContent: "No track is held." });
    root.append(this.table, this.none);
    this.rows = new Map();
    this.near = new Set(); // ids whose closest approach is below the alarm's limit
  }

  show(frame, scene, selected) {
    const tracks = frame ? frame.tracks : [];
    const north = scene.north(frame);
    this.title.textContent = `Tracks (${tracks.length})`;
    this.heading.textContent = north ? "Course" : "Direction";
    this.table.hidden = !tracks.length;
    this.none.hidden = Boolean(tracks.length);
    const held = new Set(tracks.map((track) => track[Row.ID]));
    for (const [id, row] of this.rows) {
      if (!held.has(id)) {
        row.remove();
        this.rows.delete(id);
      }
    }
    const far = (track) => !this.near.has(track[Row.ID]);
    const order = [...tracks].sort((one, other) => far(one) - far(other) || one[Row.ID] - other[Row.ID]);
    for (const [line, track] of order.entries()) {
      const id = track[Row.ID];
      const row = this.rows.get(id) || this.add(id);
      if (this.body.rows[line] !== row) this.body.insertBefore(row, this.body.rows[line] || null);
      const approach = closestApproach(track, scene.ownShip(frame));
      const texts = [
        speed(track[Row.VX], track[Row.VY]),
        direction(track[Row.VX], track[Row.VY], north),
        approach && approach.time >= 0 ? distance(approach.distance) : "",
        approach && approach.time >= 0 ? duration(approach.time) : approach ? "past" : "",
        duration(track[Row.SINCE_HIT]),
      ];
      texts.forEach((words, place) => {
        const cell = row.cells[place + 1];
        if (cell.textContent !== words) cell.textContent = words;
      });
      row.classList.toggle("chosen", id === selected);
      row.classList.toggle("near", this.near.has(id));
      row.classList.toggle("coasting", track[Row.SINCE_HIT] > 0);
      row.title = track[Row.SINCE_HIT] > 0 ? coasting(track) : "";
    }
  }

  add(id) {
    const button = element("button", { type: "button", textContent: String(id) });
    const row = element("tr", {}, [
      element("td", {}, [button]), ...[1, 2, 3, 4, 5].map(() => element("td")),
    ]);
    row.addEventListener("click", () => this.select(id));
    this.rows.set(id, row);
    return row;
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

  show(id, frame, scene) {
    this.root.hidden = id === null;
    if (id === null || !frame) return;
    const facts = scene.facts[id] || {};
    const history = scene.trail(id, frame.number, Infinity);
    const row = frame.tracks.find((one) => one[Row.ID] === id);
    const last = history[history.length - 1];
    this.name.textContent = `Track ${id}`;
    const [state, kind] = this.stateOf(id, row, last, frame, scene);
    this.state.textContent = state;
    this.state.className = `chip ${kind}`;
    this.reason.textContent = this.why(facts, history, frame);
    const rows = row ? this.present(row, facts, frame, scene) : [];
    if (!row && last) rows.push(["Last held", clock(last.stamp)]);
    if (state === "ended") rows.push(["Reason", facts.ended[1]]);
    this.now.replaceChildren(pairs(rows));
    this.drawGraph(history);
    const hits = facts.hits || [];
    this.hits.hidden = !hits.length;
    if (this.hitsOf !== id && hits.length) {
      this.hitsOf = id;
      const cells = hits.map(([stamp, x, y], order) => element("tr", {}, [
        element("td", { textContent: String(order + 1) }), element("td", { textContent: clock(stamp) }),
        element("td", { textContent: digits(x) }), element("td", { textContent: digits(y) }),
      ]));
      const heads = ["", "Time", "x, m", "y, m"].map((words) => element("th", { textContent: words }));
      this.hitList.replaceChildren(element("table", {}, [
        element("thead", {}, [element("tr", {}, heads)]), element("tbody", {}, cells),
      ]));
    }
  }

  /* What has become of a track, and the kind of its badge. Only a recording knows the ends. */
  stateOf(id, row, last, frame, scene) {
    const { ended } = scene.facts[id] || {};
    if (row && row[Row.SINCE_HIT] > 0) return [coasting(row), "warn"];
    if (row) return ["held", "ok"];
    if (frame.fixed.some((one) => one[Row.ID] === id)) return ["fixed echo", "stale"];
    if (ended && ended[0] <= frame.stamp + 1e-6) return ["ended", "stale"];
    if (!last) return ["not yet confirmed", "stale"];
    return [scene.info.kind === "live" ? "ended or withheld" : "withheld", "stale"];
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

  present(row, facts, frame, scene) {
    const north = scene.north(frame);
    const [x, y, vx, vy] = [row[Row.X], row[Row.Y], row[Row.VX], row[Row.VY]];
    const rows = [
      ["Speed", `${speed(vx, vy)} ± ${speed(row[Row.SPEED_STD])} m/s`],
      [north ? "Course" : "Direction from x", direction(vx, vy, north)],
    ];
    const origin = scene.ownShip(frame);
    if (origin) {
      const [dx, dy] = [x - origin[0], y - origin[1]];
      rows.push(["Range", distance(Math.hypot(dx, dy))]);
      rows.push([north ? "Bearing" : "Direction of it", direction(dx, dy, north)]);
    }
    const approach = closestApproach(row, origin);
    if (approach) rows.push(["Closest approach", approachWords(approach)]);
    rows.push(["Position x, y", `${digits(x)}, ${digits(y)} m`]);
    const place = geographicWords(scene.info, x, y);
    if (place) rows.push(["Latitude, longitude", place]);
    rows.push(["Last detection", `${duration(row[Row.SINCE_HIT])} ago`]);
    rows.push(["95 % ellipse", `${distance(row[Row.MAJOR])} by ${distance(row[Row.MINOR])}`]);
    if (typeof facts.first === "number") {
      rows.push(["Since the first hit", duration(frame.stamp - facts.first)]);
    }
    return rows;
  }

  /* Speed over time. */
  drawGraph(history) {
    const enough = history.length > 1;
    this.graph.hidden = this.graphTitle.hidden = !enough;
    if (!enough) return;
    const speeds = history.map((point) => Math.hypot(point.vx, point.vy));
    const top = Math.max(roundUp(Math.max(...speeds)), 1e-3);
    const span = history[history.length - 1].stamp - history[0].stamp;
    this.graphTitle.textContent = `Speed over the last ${duration(span)}, 0 to ${top} m/s`;
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

function coasting(row) {
  return `coasting ${duration(row[Row.SINCE_HIT])}`;
}

function roundUp(value) {
  if (!(value > 0)) return 1;
  const down = roundDown(value);
  return down >= value ? down : [1, 2, 5, 10].map((f) => f * 10 ** Math.floor(Math.log10(value)))
    .find((one) => one >= value);
}
