/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* The plan position on a canvas: a view of the fixed frame, and what is drawn in it. */

const NEW_SCANS = 3; // a track counts as new for so many scans
const ARROW_TIMES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600];
const MAX_POTENTIAL_LINE = 24; // px
const RING_LABELS = [0, 0.5, -0.5, 0.8, -0.8, 1.2, -1.2, 1.6, -1.6, 2.4, -2.4, Math.PI]; // rad
const SENSOR_LABELS = [0.96, 0.75, 0.5, 0.3].flatMap((far) => [0.5, 0.3, 0.7, 0.1, 0.9].map((side) => [far, side])); // shares of the range and of the sector
const PICK_DISTANCE = 22; // px
const DASHES = [5, 4]; // px, of a track without a detection
const FAINT = 0.4; // opacity of a track that coasts

const LAYERS = [
  ["detections", "Detections, fading"],
  ["potential", "Potential tracks, by evidence"],
  ["tracks", "Tracks; dashed: no detection; triangle: coasting"],
  ["ellipses", "95 % ellipses"],
  ["trails", "Past positions"],
  ["labels", "Track ids and speeds"],
  ["fixed", "What stands still"],
  ["ownShip", "Own ship and its way"],
  ["sector", "Sector of the sensor"],
  ["zone", "Guard zone"],
  ["gates", "Gates and their counts"],
  ["land", "Land"],
  ["image", "Sonar image"],
  ["truth", "Truth"],
  ["rings", "Range rings"],
  ["follow", "Keep own ship centred"],
];

const OFF_AT_FIRST = ["potential", "follow", "image"];
const FULL_TURN = 2 * Math.PI - 0.05; // rad; a wider sector has no sides
const LABEL_ROOM = 14; // px, about the signs of tracks and own ship, without labels of rings
const SIGN_ROOM = 5; // px, about the same, without labels of tracks
const NEAR_HALF = 11; // px, of the square about a track of the alarm
const LEAST_WAY = 0.1; // m/s; slower, own ship has no course, and the course up is the heading
const MAX_DOTS = 400; // past positions of a track
const MIDDLE_LEVEL = 50; // of an image: the threshold of the detector

class Plan {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.context = canvas.getContext("2d");
    this.center = [0, 0]; // m
    this.scale = 0.05; // px/m
    this.moved = false; // whether the user has chosen the view
    this.orientation = "north"; // what is up: "north" (or y), "course" or "head" of own ship
    this.turn = 0; // rad, of the picture, counter-clockwise
    this.stale = false; // whether data has stopped
    this.layers = Object.fromEntries(LAYERS.map(([name]) => [name, !OFF_AT_FIRST.includes(name)]));
    this.ruler = null; // [[x, y], [x, y]], m: the line from range and bearing
    this.cursor = null; // {range, bearing}, m and rad from x: bearing line and range ring of own ship
    this.guarded = new Set(); // ids that are new in the guard zone
    this.lost = []; // [name, x, y] of lost tracks that nobody has acknowledged
    this.gates = []; // [[x1, y1, x2, y2], [to the left, to the right]]
    this.zone = null; // [near, far, begin, end], m and rad from the bow
    this.fading = 8;
    this.trailing = 100;
    this.pastEvery = 0; // s between the points of past positions; 0: a line
    this.vectorTime = 0; // s; 0: as fits the view
    this.relative = false; // whether vectors are relative to own ship
    this.gain = 0; // of the image, in its levels
    this.contrast = 1;
    this.selected = null;
    this.near = new Set(); // ids whose closest approach is below the alarm's limit
    this.arrowTime = 60;
    this.fittedBox = null; // the box of the last `fit`
    this.readColours();
  }

  readColours() {
    const style = getComputedStyle(document.documentElement);
    this.colour = {};
    for (const name of ["plot", "ring", "text", "muted", "detection", "track", "new", "weak",
      "strong", "fixed", "ship", "truth", "accent", "error", "land"]) {
      this.colour[name] = style.getPropertyValue(`--${name}`).trim();
    }
    this.sensorColours = Array.from({ length: SENSOR_COLOURS }, (_, k) => style.getPropertyValue(`--sensor${k}`).trim());
  }

  /* Match the canvas to its size on the screen; returns whether it has one. */
  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    const width = Math.round(this.width * ratio), height = Math.round(this.height * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    return width > 0 && height > 0;
  }

  /* ---- view ---- */

  get turn() { return this.angle; }

  set turn(angle) {
    this.angle = angle;
    [this.cosine, this.sine] = [Math.cos(angle), Math.sin(angle)];
  }

  screen(x, y) { // called for every point that is drawn
    const { scale, cosine, sine } = this, dx = x - this.center[0], dy = y - this.center[1];
    return [
      0.5 * this.width + (cosine * dx - sine * dy) * scale,
      0.5 * this.height - (sine * dx + cosine * dy) * scale,
    ];
  }

  world(px, py) {
    const [dx, dy] = turned(
      (px - 0.5 * this.width) / this.scale, (0.5 * this.height - py) / this.scale, -this.turn);
    return [this.center[0] + dx, this.center[1] + dy];
  }

  /* Turn the picture as the orientation says, as far as own ship's heading or course is known. */
  orient(frame) {
    const ship = this.scene.ownShip(frame);
    const up = !ship || this.orientation === "north" ? null
      : this.orientation === "course" && Math.hypot(ship[3], ship[4]) > LEAST_WAY ? Math.atan2(ship[4], ship[3]) : ship[2];
    this.oriented = up !== null || this.orientation === "north";
    this.turn = up === null ? 0 : Math.PI / 2 - up;
  }

  /* The range scale, m: from the middle of the view to its nearest edge. */
  get range() {
    return 0.5 * Math.min(this.width, this.height) / this.scale;
  }

  set range(meters) {
    this.scale = 0.5 * Math.min(this.width, this.height) / meters;
    this.moved = true;
  }

  /* A box of the fixed frame about its turned corners, relative to the middle of the view. */
  turnedBox(box) {
    const corners = [[0, 1], [2, 1], [0, 3], [2, 3]].map(([i, j]) => turned(box[i], box[j], this.turn));
    const [xs, ys] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }

  /* Whether a box is in the view and not small in it. */
  suits(box) {
    if (!box) return true;
    if (!this.fittedBox || !this.resize()) return false;
    if (this.fittedSize !== `${this.width} ${this.height}`) return false;
    const half = [0.5 * this.width / this.scale, 0.5 * this.height / this.scale];
    const middle = turned(...this.center, this.turn);
    const around = this.turnedBox(box).map((value, k) => (value - middle[k % 2]) / half[k % 2]);
    return around.every((share) => Math.abs(share) <= 1)
      && Math.max(around[2] - around[0], around[3] - around[1]) > 0.8;
  }

  fit(box) {
    if (!box || !this.resize()) return;
    this.fittedBox = box;
    this.fittedSize = `${this.width} ${this.height}`;
    const [left, bottom, right, top] = this.turnedBox(box);
    const extent = Math.max(right - left, top - bottom, 1);
    this.center = turned(0.5 * (left + right), 0.5 * (bottom + top), -this.turn);
    const width = Math.max(right - left, 0.05 * extent);
    const height = Math.max(top - bottom, 0.05 * extent);
    this.scale = 0.9 * Math.min(this.width / width, this.height / height);
  }

  /* Zoom about a point of the screen, which stays where it is. */
  zoom(factor, px = 0.5 * this.width, py = 0.5 * this.height) {
    const [x, y] = this.world(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 1e-6), 1e4);
    const [nx, ny] = this.world(px, py);
    this.center = [this.center[0] + x - nx, this.center[1] + y - ny];
    this.moved = true;
  }

  pan(dx, dy) {
    this.center = this.world(0.5 * this.width - dx, 0.5 * this.height - dy);
    this.moved = true;
    this.layers.follow = false;
  }

  /* Id of the track nearest to a point of the screen, or null. */
  pick(frame, px, py) {
    let best = null, nearest = PICK_DISTANCE;
    for (const row of frame ? this.shown(frame) : []) {
      const [x, y] = this.screen(row[Row.X], row[Row.Y]);
      const away = Math.hypot(x - px, y - py);
      if (away < nearest) [best, nearest] = [row[Row.ID], away];
    }
    return best;
  }

  /* The tracks that are drawn: without those that stand still, if they are hidden. */
  shown(frame) {
    return frame.tracks.filter((row) => this.layers.fixed || !stands(row));
  }

  /* ---- drawing ---- */

  draw(index) {
    if (!this.resize()) return;
    const { context, colour, scene } = this;
    context.fillStyle = colour.plot;
    context.fillRect(0, 0, this.width, this.height);
    const frame = scene.frames[index];
    this.orient(frame);
    if (frame && this.layers.follow && frame.own_ship) {
      this.center = [frame.own_ship[0], frame.own_ship[1]];
    }
    this.taken = this.corners();
    if (frame && this.layers.land) this.drawLand(frame);
    if (frame && this.layers.image) this.drawImage(frame);
    if (this.layers.rings) this.drawRings(frame);
    if (frame) {
      const ship = scene.ownShip(frame);
      if (this.layers.sector) this.drawArea(ship, scene.sector(), colour.accent);
      if (this.layers.sector) this.drawSensors(frame);
      if (this.layers.zone) this.drawArea(ship, this.zone, colour.error, DASHES);
      this.chooseArrowTime(frame);
      if (this.layers.fixed) this.drawFixed(frame);
      if (this.layers.detections) this.drawDetections(index);
      if (this.layers.truth) this.drawTruth(frame);
      if (this.layers.potential) this.drawPotential(frame);
      if (this.layers.gates) this.drawGates();
      this.drawLost();
      this.drawTracks(frame);
      if (this.layers.ownShip) {
        this.drawWay(index);
        this.drawOwnShip(frame);
      }
    }
    if (this.layers.rings) this.drawRingLabels(frame);
    if (this.ruler) this.drawRuler(scene.up(frame));
    if (this.cursor) this.drawCursor(frame);
    this.drawScaleBar();
    this.drawOrientation(scene.north(frame));
  }

  /* Boxes of the scale bar, the arrow of north and the buttons, where no label goes. */
  corners() {
    const boxes = ["zoom", "own-ship"].map((id) => document.getElementById(id)).map(
      ({ offsetLeft: left, offsetTop: top, offsetWidth: width, offsetHeight: height }) =>
        [left, top, left + width, top + height]);
    return [[0, this.height - 44, 190, this.height], [this.width - 100, 0, this.width, 104], ...boxes];
  }

  /* Whether a box [left, top, right, bottom] covers no label that was placed before. */
  free(box) {
    return this.taken.every((other) =>
      box[0] > other[2] || box[2] < other[0] || box[1] > other[3] || box[3] < other[1]);
  }

  /* Colour of a sensor, of several, by its number. */
  sensorColour(number) {
    return this.sensorColours[number % SENSOR_COLOURS];
  }

  /* Coverages of several sensors with their names; of a silent one grey and dashed. */
  drawSensors(frame) {
    const { context, colour } = this;
    this.boldText("center");
    this.scene.sensors(frame).forEach(({ name, sign, sector, pose, silent }, number) => {
      if (!sector || !pose) return;
      const shown = silent ? colour.muted : this.sensorColour(number);
      this.drawArea(pose, sector, shown, silent ? [2, 5] : []);
      const words = (name.toUpperCase().startsWith(sign) ? name : `${sign} ${name}`) + (silent ? ", silent" : "");
      const half = 0.5 * context.measureText(words).width + 3, [near, far, begin, end] = sector;
      const box = SENSOR_LABELS.map(([share, side]) => {
        const away = near + share * (far - near), angle = pose[2] + begin + side * (end - begin);
        const [x, y] = this.screen(pose[0] + away * Math.cos(angle), pose[1] + away * Math.sin(angle));
        return [x - half, y - 9, x + half, y + 9];
      }).find((one) => one[0] > 0 && one[2] < this.width && one[1] > 34 && one[3] < this.height && this.free(one));
      if (!box) return;
      this.taken.push(box);
      context.fillStyle = shown;
      this.text(words, box[0] + half, box[1] + 9);
    });
  }

  /* A sector from the bow, in which the sensor hears or which is guarded, where the heading is
     known or does not matter; of several sensors from a sensor's place and axis. */
  drawArea(ship, sector, colour, dashes = []) {
    const { context } = this;
    if (!ship || !sector) return;
    const allRound = sector[3] - sector[2] > FULL_TURN;
    if (ship[2] === null && !allRound) return;
    const [x, y] = this.screen(ship[0], ship[1]);
    const [near, far] = [sector[0] * this.scale, sector[1] * this.scale];
    const [begin, end] = [-ship[2] - this.turn - sector[2], -ship[2] - this.turn - sector[3]];
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = dashes.length ? 1.5 : 1;
    context.setLineDash(dashes);
    context.beginPath();
    if (allRound) {
      context.arc(x, y, far, 0, 2 * Math.PI);
      context.moveTo(x + near, y);
      context.arc(x, y, near, 0, 2 * Math.PI, true);
    } else {
      context.arc(x, y, far, begin, end, true);
      context.arc(x, y, near, end, begin);
      context.closePath();
    }
    context.globalAlpha = 0.05;
    context.fill();
    context.globalAlpha = dashes.length ? 0.9 : 0.55;
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /* The land of the node's chart, in its own frame. */
  drawLand(frame) {
    const { land } = this.scene;
    if (!land || land.frame_id !== frame.frame_id) return;
    const { context, colour } = this;
    if (land.colour !== colour.land) {
      land.colour = colour.land;
      land.picture = landPicture(land, channels(colour.land));
    }
    context.save();
    context.imageSmoothingEnabled = false;
    context.translate(...this.screen(land.origin[0], land.origin[1]));
    context.rotate(-land.origin[2] - this.turn);
    context.scale(land.cell * this.scale, -land.cell * this.scale);
    context.drawImage(land.picture, 0, 0);
    context.restore();
  }

  /* The sonar image, where the sensor was: the stronger the more opaque. */
  drawImage(frame) {
    const { context, colour } = this;
    const image = this.scene.image(frame);
    if (!image) return;
    const { side } = image, look = [image.stamp, colour.detection, this.gain, this.contrast].join(" ");
    if (this.imageLook !== look) {
      this.imageLook = look;
      this.imagePicture = this.imageCells(image, channels(colour.detection));
    }
    const half = 0.5 * side * image.cell * this.scale, at = this.screen(image.x, image.y);
    const angle = -image.heading - this.turn, view = [look, half, angle, at, this.width, this.height].join(" ");
    if (this.imageView !== view) { // images come more rarely than scans
      this.imageView = view;
      this.imageLayer = this.imageLayer || document.createElement("canvas");
      [this.imageLayer.width, this.imageLayer.height] = [this.width, this.height];
      const layer = this.imageLayer.getContext("2d");
      layer.translate(...at);
      layer.rotate(angle);
      layer.drawImage(this.imagePicture, -half, -half, 2 * half, 2 * half);
    }
    context.drawImage(this.imageLayer, 0, 0);
  }

  imageCells({ side, levels }, [red, green, blue]) {
    const picture = new ImageData(side, side);
    const alphas = Uint8ClampedArray.from({ length: 128 }, (_, level) =>
      20 + 2.2 * (MIDDLE_LEVEL + this.gain + this.contrast * (level - MIDDLE_LEVEL)));
    const cells = new Uint32Array(picture.data.buffer), rgb = (blue << 16) | (green << 8) | red;
    for (let k = 0; k < levels.length; k += 1) {
      // Rows are from starboard to port: on the screen port is above.
      const place = (side - 1 - Math.floor(k / side)) * side + k % side;
      cells[place] = levels[k] < 0 ? 0 : ((alphas[levels[k]] << 24) | rgb) >>> 0;
    }
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = side;
    canvas.getContext("2d").putImageData(picture, 0, 0);
    return canvas;
  }

  /* Labels from here on are bold, with their middle at the height of their place. */
  boldText(align) {
    this.context.font = "600 13px system-ui, sans-serif";
    this.context.textAlign = align;
    this.context.textBaseline = "middle";
  }

  /* The sign of a lost track, a crossed square, where it was last. */
  drawLost() {
    const { context, colour } = this;
    context.strokeStyle = context.fillStyle = colour.error;
    this.boldText("left");
    for (const [id, wx, wy] of this.lost) {
      const [x, y] = this.screen(wx, wy), half = NEAR_HALF;
      context.lineWidth = 2.5;
      context.strokeRect(x - half, y - half, 2 * half, 2 * half);
      context.beginPath();
      context.moveTo(x - half, y - half); context.lineTo(x + half, y + half);
      context.moveTo(x - half, y + half); context.lineTo(x + half, y - half);
      context.stroke();
      const words = `${id} lost`, width = context.measureText(words).width;
      const box = [[half + 4, -8], [-half - 4 - width, -8], [-0.5 * width, half + 2], [-0.5 * width, -half - 18]]
        .map(([dx, dy]) => [x + dx, y + dy, x + dx + width, y + dy + 16]).find((one) => this.free(one));
      this.taken.push([x - half, y - half, x + half, y + half]);
      if (!box) continue;
      this.taken.push(box);
      this.text(words, box[0], box[1] + 8);
    }
  }

  /* Gates: at each side the number of tracks that have crossed to it. */
  drawGates() {
    const { context, colour } = this;
    context.strokeStyle = context.fillStyle = colour.strong;
    this.boldText("center");
    this.gates.forEach(([[x1, y1, x2, y2], [left, right]], order) => {
      const [[ax, ay], [bx, by]] = [this.screen(x1, y1), this.screen(x2, y2)];
      const length = Math.max(Math.hypot(bx - ax, by - ay), 1);
      const [nx, ny] = [(by - ay) / length, (ax - bx) / length]; // to the left, on the screen
      context.lineWidth = 3;
      context.beginPath();
      context.moveTo(ax, ay); context.lineTo(bx, by);
      context.stroke();
      context.lineWidth = 1.5;
      const [mx, my] = [0.5 * (ax + bx), 0.5 * (ay + by)];
      for (const [side, number] of [[1, left], [-1, right]]) {
        this.arrow(mx, my, mx + 26 * side * nx, my + 26 * side * ny);
        this.text(String(number), mx + 42 * side * nx, my + 42 * side * ny);
      }
      this.text(`Gate ${order + 1}`, ax - 22 * (bx - ax) / length, ay - 22 * (by - ay) / length);
    });
  }

  /* Bearing line and range ring of own ship, which move with it. */
  drawCursor(frame) {
    const { context, colour, scene, cursor } = this;
    const ship = scene.ownShip(frame);
    if (!ship) return;
    const [x, y] = this.screen(ship[0], ship[1]), pixels = cursor.range * this.scale;
    const angle = cursor.bearing + this.turn, far = this.width + this.height + pixels;
    context.strokeStyle = context.fillStyle = colour.strong;
    context.lineWidth = 1.5;
    context.setLineDash(DASHES);
    context.beginPath();
    context.arc(x, y, pixels, 0, 2 * Math.PI);
    context.moveTo(x, y);
    context.lineTo(x + far * Math.cos(angle), y - far * Math.sin(angle));
    context.stroke();
    context.setLineDash([]);
    const [px, py] = [x + pixels * Math.cos(angle), y - pixels * Math.sin(angle)];
    context.beginPath();
    context.arc(px, py, 4, 0, 2 * Math.PI);
    context.fill();
    this.boldText(px > 0.6 * this.width ? "right" : "left");
    this.text(cursorWords(cursor, scene.up(frame)), px + (px > 0.6 * this.width ? -10 : 10), py - 12);
  }

  drawRuler(up) {
    const { context, colour, ruler: [from, to] } = this;
    const [[x, y], [toX, toY]] = [this.screen(...from), this.screen(...to)];
    context.strokeStyle = context.fillStyle = colour.strong;
    context.lineWidth = 1.5;
    context.beginPath();
    context.arc(x, y, 3, 0, 2 * Math.PI);
    context.fill();
    this.arrow(x, y, toX, toY);
    this.boldText("center");
    const words = rangeAndBearing(from, to, up);
    // Beside the line, above it where it is level.
    const length = Math.max(Math.hypot(toX - x, toY - y), 1), side = toX < x ? -1 : 1;
    const [nx, ny] = [side * (toY - y) / length, side * (x - toX) / length];
    const away = 0.5 * context.measureText(words).width * Math.abs(nx) + 8 * Math.abs(ny) + 6;
    this.text(words, 0.5 * (x + toX) + away * nx, 0.5 * (y + toY) + away * ny);
  }

  /* Centre and step (px), step (m), and numbers of the first and last range ring in the view. */
  rings(frame) {
    const origin = frame && frame.own_ship ? frame.own_ship : [0, 0];
    const [x, y] = this.screen(origin[0], origin[1]);
    const least = Math.min(Math.max(120, 0.25 * Math.min(this.width, this.height)), 200) / this.scale;
    const unit = units.nautical && least > LEAST_MILES * NAUTICAL_MILE ? NAUTICAL_MILE : 1;
    const step = unit * roundDown(least / unit);
    const pixels = step * this.scale;
    const corners = [[0, 0], [this.width, 0], [0, this.height], [this.width, this.height]];
    const far = Math.max(...corners.map(([cx, cy]) => Math.hypot(cx - x, cy - y)));
    const inside = x >= 0 && x <= this.width && y >= 0 && y <= this.height;
    const near = inside ? 0 : Math.hypot(
      Math.max(-x, 0, x - this.width), Math.max(-y, 0, y - this.height));
    return {
      x, y, pixels, step, first: Math.max(Math.ceil(near / pixels), 1), last: Math.floor(far / pixels),
    };
  }

  drawRings(frame) {
    const { context, colour } = this;
    const { x, y, pixels, first, last } = this.rings(frame);
    context.strokeStyle = colour.ring;
    context.lineWidth = 1;
    for (let ring = first; ring <= last; ring += 1) {
      context.beginPath();
      context.arc(x, y, ring * pixels, 0, 2 * Math.PI);
      context.stroke();
    }
    context.beginPath();
    context.moveTo(x - 5, y); context.lineTo(x + 5, y);
    context.moveTo(x, y - 5); context.lineTo(x, y + 5);
    context.stroke();
  }

  /* After the tracks: beside their labels and signs, where a ring has room. */
  drawRingLabels(frame) {
    const { context, colour } = this;
    const { x, y, pixels, step, first, last } = this.rings(frame);
    context.fillStyle = colour.muted;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (let ring = first; ring <= last; ring += 1) {
      const words = roundDistance(ring * step);
      const half = 0.5 * context.measureText(words).width + 4;
      const box = RING_LABELS.map((angle) => [
        x + ring * pixels * Math.sin(angle), y - ring * pixels * Math.cos(angle),
      ]).map(([lx, ly]) => [lx - half, ly - 9, lx + half, ly + 9]).find((one) =>
        one[0] > 0 && one[2] < this.width && one[1] > 0 && one[3] < this.height && this.free(one));
      if (!box) continue;
      this.taken.push(box);
      this.text(words, box[0] + half, box[1] + 9);
    }
  }

  drawDetections(index) {
    const { context, colour, scene } = this;
    context.fillStyle = colour.detection;
    const oldest = Math.max(index - this.fading + 1, 0);
    let begin = index;
    while (begin > oldest && !scene.frames[begin].restart) begin -= 1;
    for (let k = begin; k <= index; k += 1) {
      const age = index - k, size = age ? 2 : 3;
      context.globalAlpha = age ? 0.45 * (1 - age / this.fading) : 0.85;
      const { detections: points, sensors } = scene.frames[k];
      for (let i = 0; i < points.length; i += 2) {
        const [x, y] = this.screen(points[i], points[i + 1]);
        if (sensors) context.fillStyle = this.sensorColour(sensors[i / 2]);
        context.fillRect(x - 0.5 * size, y - 0.5 * size, size, size);
      }
    }
    context.globalAlpha = 1;
  }

  drawPotential(frame) {
    const { context, colour } = this;
    for (const [x, y, vx, vy, evidence] of frame.potential) {
      const share = evidence === null ? 0 : evidence;
      context.strokeStyle = context.fillStyle = mixed(colour.weak, colour.strong, share);
      context.lineWidth = 1 + share;
      const [px, py] = this.screen(x, y);
      // The velocity of a few hits is uncertain: a short line says as much.
      const way = Math.hypot(vx, vy) * this.arrowTime * this.scale;
      const shown = Math.min(this.arrowTime, this.arrowTime * MAX_POTENTIAL_LINE / Math.max(way, 1e-9));
      const [qx, qy] = this.screen(x + vx * shown, y + vy * shown);
      context.globalAlpha = 0.25 + 0.75 * share;
      context.beginPath();
      context.moveTo(px, py); context.lineTo(qx, qy);
      context.stroke();
      context.globalAlpha = 0.45 + 0.55 * share;
      const half = 2.5 + 2 * share;
      context.beginPath(); // a diamond: the shape tells it from a track, too
      context.moveTo(px, py - half); context.lineTo(px + half, py);
      context.lineTo(px, py + half); context.lineTo(px - half, py);
      context.closePath();
      context.fill();
    }
    context.globalAlpha = 1;
  }

  drawTracks(frame) {
    const { layers, scene } = this;
    const isNew = (id) => {
      const confirmed = (scene.facts[id] || {}).confirmed;
      if (confirmed === null || confirmed === undefined) return false;
      const history = scene.trail(id, frame.number, NEW_SCANS + 1);
      return history.length <= NEW_SCANS && history.length > 0 && confirmed >= history[0].stamp - 1e-6;
    };
    const kind = (id, row) => (this.stale ? "muted" : this.near.has(id) || this.guarded.has(id) ? "error"
      : stands(row) ? "fixed" : isNew(id) ? "new" : "track");
    const tracks = this.shown(frame);
    const colours = new Map(tracks.map((row) => [row[Row.ID], this.colour[kind(row[Row.ID], row)]]));
    if (layers.trails) for (const row of tracks) this.drawTrail(frame, row, colours);
    if (layers.ellipses) for (const row of tracks) this.drawEllipse(row, colours.get(row[Row.ID]));
    const ship = scene.ownShip(frame);
    if (layers.tracks) for (const row of tracks) this.drawTrack(row, colours.get(row[Row.ID]), ship);
    this.drawNear(frame);
    if (this.selected !== null) this.drawSelected(frame);
    const signs = [...tracks.map((row) => [row[Row.X], row[Row.Y]]), frame.own_ship];
    const places = signs.filter(Boolean).map((sign) => this.screen(sign[0], sign[1]));
    const take = (room) => places.forEach(([x, y]) => this.taken.push([x - room, y - room, x + room, y + room]));
    take(SIGN_ROOM);
    if (layers.labels) this.drawLabels(frame, colours);
    take(LABEL_ROOM);
  }

  /* A square about each track of the alarm: its colour alone is not seen at night. */
  drawNear(frame) {
    const { context, colour } = this;
    context.strokeStyle = colour.error;
    context.lineWidth = 2.5;
    for (const row of frame.tracks) {
      if (!this.near.has(row[Row.ID]) && !this.guarded.has(row[Row.ID])) continue;
      const [x, y] = this.screen(row[Row.X], row[Row.Y]);
      context.strokeRect(x - NEAR_HALF, y - NEAR_HALF, 2 * NEAR_HALF, 2 * NEAR_HALF);
    }
  }

  drawTrail(frame, row, colours) {
    const { context } = this;
    const points = this.scene.trail(row[Row.ID], frame.number, this.trailing);
    if (points.length < 2) return;
    context.strokeStyle = colours.get(row[Row.ID]);
    context.globalAlpha = row[Row.ID] === this.selected ? 1 : 0.55;
    context.lineWidth = row[Row.ID] === this.selected ? 2.5 : 1.5;
    context.lineJoin = "round";
    if (this.pastEvery) {
      this.drawDots(points, colours.get(row[Row.ID]));
      return;
    }
    const places = points.map((point) => this.screen(point.x, point.y));
    for (const missed of [false, true]) {
      if (missed && !points.some((point) => point.missed)) continue;
      context.setLineDash(missed ? DASHES : []);
      context.beginPath();
      points.forEach((point, place) => {
        const before = points[place - 1];
        // No line where the track was not published.
        const joined = before && before.order === point.order - 1 && point.missed === missed;
        if (joined) context.lineTo(...places[place]);
        else context.moveTo(...places[place]);
      });
      context.stroke();
    }
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /* Past positions at equal times, between those of the scans. */
  drawDots(points, colour) {
    const { context, pastEvery: every } = this;
    context.fillStyle = colour;
    context.globalAlpha = 0.8;
    for (const [x, y] of equalTimes(points, every)) {
      const [px, py] = this.screen(x, y);
      context.beginPath();
      context.arc(px, py, 2.2, 0, 2 * Math.PI);
      context.fill();
    }
    context.globalAlpha = 1;
  }

  /* Dashed and not filled without a detection in this scan; faint where the track coasts. */
  drawEllipse(row, colour) {
    const { context } = this;
    const [x, y] = this.screen(row[Row.X], row[Row.Y]);
    context.beginPath();
    context.ellipse(x, y, row[Row.MAJOR] * this.scale, row[Row.MINOR] * this.scale,
      -row[Row.ANGLE] - this.turn, 0, 2 * Math.PI);
    context.globalAlpha = 0.14;
    context.fillStyle = context.strokeStyle = colour;
    if (missed(row) || coasts(row)) context.setLineDash(DASHES); else context.fill();
    context.globalAlpha = coasts(row) ? FAINT : 0.7;
    context.lineWidth = 1;
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /* The velocity of a vector: of a track, less own ship's where vectors are relative to it. */
  vector(row, ship) {
    const relative = this.relative && ship && ship[3] !== null;
    return [row[Row.VX] - (relative ? ship[3] : 0), row[Row.VY] - (relative ? ship[4] : 0)];
  }

  drawTrack(row, colour, ship = null) {
    const { context } = this;
    const [vx, vy] = this.vector(row, ship);
    const [x, y] = this.screen(row[Row.X], row[Row.Y]);
    context.fillStyle = context.strokeStyle = colour;
    context.lineWidth = 2;
    const uncertain = missed(row) || coasts(row);
    if (stands(row)) {
      this.drawFixedSign(x, y);
      return;
    }
    context.setLineDash(uncertain ? DASHES : []);
    context.globalAlpha = coasts(row) ? FAINT : 1;
    this.arrow(x, y, ...this.screen(row[Row.X] + vx * this.arrowTime, row[Row.Y] + vy * this.arrowTime));
    context.setLineDash([]);
    context.globalAlpha = 1;
    context.beginPath();
    if (coasts(row)) {
      context.moveTo(x, y - 10); context.lineTo(x + 9, y + 7); context.lineTo(x - 9, y + 7);
      context.closePath();
    } else {
      context.arc(x, y, 4, 0, 2 * Math.PI);
    }
    if (uncertain || this.stale) context.stroke(); else context.fill();
    context.globalAlpha = 1;
  }

  drawSelected(frame) {
    const { context, colour, scene } = this;
    const row = frame.tracks.find((one) => one[Row.ID] === this.selected);
    if (row) {
      const [x, y] = this.screen(row[Row.X], row[Row.Y]);
      context.strokeStyle = colour.accent;
      context.lineWidth = 2;
      context.beginPath();
      context.arc(x, y, 11, 0, 2 * Math.PI);
      context.stroke();
    }
    const hits = ((scene.facts[this.selected] || {}).hits || [])
      .filter(([stamp]) => stamp <= frame.stamp + 1e-6);
    context.strokeStyle = context.fillStyle = colour.accent;
    context.lineWidth = 1.5;
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "middle";
    hits.forEach(([, hx, hy, sensor], order) => {
      const [x, y] = this.screen(hx, hy);
      if (sensor !== undefined) context.strokeStyle = context.fillStyle = this.sensorColour(sensor);
      context.strokeRect(x - 5, y - 5, 10, 10);
      const box = [x + 6, y - 16, x + 22, y];
      if (!this.free(box)) return;
      this.taken.push(box);
      this.text(String(order + 1), x + 8, y - 8);
    });
  }

  /* Labels beside their tracks, where none covers another; the selected track's comes first. */
  drawLabels(frame, colours) {
    const { context } = this;
    this.boldText("left");
    const rank = (row) => (row[Row.ID] === this.selected) + 2 * this.near.has(row[Row.ID]);
    const rows = this.shown(frame).sort((one, other) => rank(other) - rank(one));
    const signs = sensorSigns(this.scene.sensorNames);
    for (const row of rows) {
      const [x, y] = this.screen(row[Row.X], row[Row.Y]);
      if (x < -50 || y < -20 || x > this.width + 50 || y > this.height + 20) continue;
      const seen = this.scene.seenBy(row).map((k) => `  ${signs[k]}`).join("");
      const label = `${row[Row.ID]}  ${statusWords(row) || speedWords(row[Row.VX], row[Row.VY])}${seen}`;
      const width = context.measureText(label).width;
      const side = turned(row[Row.VX], row[Row.VY], this.turn)[1] > 0 ? 11 : -11; // first where the arrow is not
      const middle = -0.5 * width;
      const place = [
        [9, side], [-9 - width, side], [9, -side], [-9 - width, -side], [middle, 2 * side], [middle, -2 * side],
      ].map(([dx, dy]) => [x + dx, y + dy - 8, x + dx + width, y + dy + 8]).find((box) =>
        this.free(box) && box[0] > 2 && box[2] < this.width - 2 && box[1] > 0 && box[3] < this.height);
      if (!place) continue;
      this.taken.push(place);
      context.fillStyle = colours.get(row[Row.ID]);
      this.text(label, place[0], 0.5 * (place[1] + place[3]));
    }
  }

  drawFixed(frame) {
    this.context.strokeStyle = this.colour.fixed;
    for (const row of frame.fixed) this.drawFixedSign(...this.screen(row[Row.X], row[Row.Y]));
  }

  /* A square with a stroke. */
  drawFixedSign(x, y) {
    const { context } = this;
    context.lineWidth = 1.5;
    context.strokeRect(x - 4, y - 4, 8, 8);
    context.beginPath();
    context.moveTo(x - 4, y - 4); context.lineTo(x + 4, y + 4);
    context.stroke();
  }

  drawTruth(frame) {
    const { context, colour, scene } = this;
    context.strokeStyle = colour.truth;
    context.lineWidth = 1;
    context.setLineDash([4, 4]);
    for (const path of scene.truth) {
      context.beginPath();
      for (const [, x, y] of path) context.lineTo(...this.screen(x, y));
      context.stroke();
    }
    context.setLineDash([]);
    for (const target of scene.targets(frame.stamp)) this.drawTarget(...this.screen(...target));
  }

  drawTarget(x, y) {
    const { context, colour } = this;
    context.strokeStyle = colour.truth;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y - 6); context.lineTo(x + 6, y);
    context.lineTo(x, y + 6); context.lineTo(x - 6, y);
    context.closePath();
    context.stroke();
  }

  /* The own ship's way, as long as the trails. */
  drawWay(index) {
    const { context, colour, scene } = this;
    context.strokeStyle = colour.ship;
    context.globalAlpha = 0.35;
    context.lineWidth = 1.5;
    context.beginPath();
    for (let k = Math.max(index - this.trailing + 1, 0); k <= index; k += 1) {
      const { own_ship: pose, restart } = scene.frames[k];
      if (restart) context.beginPath();
      if (!pose) continue;
      context.lineTo(...this.screen(pose[0], pose[1]));
    }
    context.stroke();
    context.globalAlpha = 1;
  }

  drawOwnShip(frame) {
    if (!frame.own_ship) return;
    const { context, colour } = this;
    const [wx, wy, heading, vx, vy] = frame.own_ship;
    const [x, y] = this.screen(wx, wy), known = typeof vx === "number" && !this.stale;
    if (known && !this.relative && this.arrowTime) {
      context.strokeStyle = context.fillStyle = colour.ship;
      context.lineWidth = 2;
      this.arrow(x, y, ...this.screen(wx + vx * this.arrowTime, wy + vy * this.arrowTime));
    }
    context.save();
    context.translate(x, y);
    context.fillStyle = known ? colour.ship : colour.plot; // hollow where it was, while it is not known
    context.strokeStyle = known ? colour.plot : colour.ship;
    context.lineWidth = 1.5;
    context.beginPath();
    if (heading === null) {
      context.arc(0, 0, 6, 0, 2 * Math.PI);
    } else {
      context.rotate(-heading - this.turn);
      context.moveTo(12, 0); context.lineTo(-7, 6.5); context.lineTo(-4, 0); context.lineTo(-7, -6.5);
    }
    context.closePath();
    context.fill();
    context.stroke();
    context.restore();
  }

  drawScaleBar() {
    const { context, colour } = this;
    const most = Math.min(160, 0.3 * this.width) / this.scale;
    const unit = units.nautical && most > LEAST_MILES * NAUTICAL_MILE ? NAUTICAL_MILE : 1;
    const length = unit * roundDown(most / unit);
    const { offsetLeft: left, offsetTop: top } = document.getElementById("zoom");
    const pixels = length * this.scale, x = 16, y = (left < pixels + 40 ? top : this.height) - 18;
    context.strokeStyle = colour.text;
    context.fillStyle = colour.text;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, y - 5); context.lineTo(x, y);
    context.lineTo(x + pixels, y); context.lineTo(x + pixels, y - 5);
    context.stroke();
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "bottom";
    this.text(roundDistance(length), x + 4, y - 5);
  }

  /* A north arrow, or the axes of a frame whose orientation is not known. */
  drawOrientation(north) {
    const { context, colour } = this;
    context.strokeStyle = context.fillStyle = colour.text;
    context.lineWidth = 1.8;
    this.boldText("center");
    const x = this.width - 50, y = 54;
    for (const [name, angle] of north ? [["N", Math.PI / 2]] : [["x", 0], ["y", Math.PI / 2]]) {
      const [dx, dy] = turned(Math.cos(angle), Math.sin(angle), this.turn);
      const begin = north ? -15 : 0;
      this.arrow(x + begin * dx, y - begin * dy, x + (begin + 30) * dx, y - (begin + 30) * dy);
      this.text(name, x + (begin + 41) * dx, y - (begin + 41) * dy);
    }
  }

  arrow(x, y, tipX, tipY) {
    const { context } = this;
    const length = Math.hypot(tipX - x, tipY - y);
    context.beginPath();
    context.moveTo(x, y); context.lineTo(tipX, tipY);
    context.stroke();
    if (length < 8) return;
    const [ux, uy] = [(tipX - x) / length, (tipY - y) / length];
    context.beginPath();
    context.moveTo(tipX + 3 * ux, tipY + 3 * uy);
    context.lineTo(tipX - 6 * ux - 4 * uy, tipY - 6 * uy + 4 * ux);
    context.lineTo(tipX - 6 * ux + 4 * uy, tipY - 6 * uy - 4 * ux);
    context.closePath();
    context.fill();
  }

  /* Text with a rim in the background's colour, so that it can be read over anything. */
  text(words, x, y) {
    const { context, colour } = this;
    context.save();
    context.strokeStyle = colour.plot;
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeText(words, x, y);
    context.restore();
    context.fillText(words, x, y);
  }

  /* The time whose way the arrows show: long enough to be seen, short enough not to cross. */
  chooseArrowTime(frame) {
    const speeds = frame.tracks.map((row) => Math.hypot(row[Row.VX], row[Row.VY])).sort((a, b) => a - b);
    if (this.vectorTime) {
      this.arrowTime = this.vectorTime;
      return;
    }
    const fast = speeds.length ? speeds[Math.floor(0.8 * (speeds.length - 1))] : 5;
    const wanted = 45 / Math.max(fast * this.scale, 1e-9);
    this.arrowTime = ARROW_TIMES.filter((time) => time <= wanted).pop() || ARROW_TIMES[0];
  }

  /* A layer's sign, for the list of layers. */
  drawSign(canvas, layer) {
    const sign = Object.create(this);
    sign.canvas = canvas;
    sign.context = canvas.getContext("2d");
    sign.layers = {};
    sign.selected = null;
    sign.center = [0, 0];
    sign.turn = 0;
    sign.relative = sign.stale = false;
    sign.scale = 1;
    if (!sign.resize()) return;
    const { context, colour } = sign;
    context.clearRect(0, 0, sign.width, sign.height);
    sign.arrowTime = 1;
    const row = [0, -6, 0, 16, 0, 11, 6, 0.2, 0];
    if (layer === "detections") {
      context.fillStyle = colour.detection;
      for (const [x, alpha] of [[4, 0.25], [11, 0.5], [18, 0.9]]) {
        context.globalAlpha = alpha;
        context.fillRect(x, 7, 4, 4);
      }
    } else if (layer === "potential") {
      sign.drawPotential({ potential: [[-7, 0, 0, 0, 0], [0, 0, 0, 0, 0.5], [7, 0, 0, 0, 1]] });
    } else if (layer === "tracks") {
      sign.drawTrack(row, colour.track);
    } else if (layer === "ellipses") {
      sign.drawEllipse([0, 0, 0, 0, 0, 11, 6, 0.3], colour.track);
    } else if (layer === "trails") {
      context.strokeStyle = colour.track;
      context.lineWidth = 1.5;
      context.beginPath();
      context.moveTo(2, 14); context.quadraticCurveTo(12, 14, 24, 4);
      context.stroke();
    } else if (layer === "labels") {
      context.fillStyle = colour.track;
      sign.boldText("center");
      context.fillText("12", 13, 9);
    } else if (layer === "fixed") {
      sign.drawFixed({ fixed: [[0, 0, 0]] });
    } else if (layer === "ownShip" || layer === "follow") {
      sign.drawOwnShip({ own_ship: [0, 0, layer === "follow" ? null : 0, 0, 0] });
    } else if (layer === "land") {
      context.fillStyle = colour.land;
      context.fillRect(3, 3, 20, 12);
    } else if (layer === "sector" || layer === "zone") {
      context.strokeStyle = layer === "zone" ? colour.error : colour.accent;
      context.setLineDash(layer === "zone" ? [3, 2] : []);
      context.beginPath();
      context.moveTo(3, 16); context.arc(3, 16, 19, -1.2, -0.2); context.closePath();
      context.stroke();
    } else if (layer === "gates") {
      context.strokeStyle = colour.strong;
      context.lineWidth = 3;
      context.beginPath();
      context.moveTo(3, 14); context.lineTo(23, 4);
      context.stroke();
    } else if (layer === "image") {
      context.fillStyle = colour.detection;
      for (let k = 0; k < 12; k += 1) {
        context.globalAlpha = 0.15 + 0.08 * (k * 5 % 11);
        context.fillRect(4 + 5 * (k % 4), 1 + 5 * Math.floor(k / 4), 5, 5);
      }
    } else if (layer === "truth") {
      sign.drawTarget(13, 9);
    } else {
      context.strokeStyle = colour.muted;
      context.beginPath();
      context.arc(13, 9, 7, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}

/* A vector, turned counter-clockwise. */
function turned(x, y, angle) {
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  return [cosine * x - sine * y, sine * x + cosine * y];
}

/* Positions at multiples of a time, the newest first, where two points of a track, oldest first,
   are neighbours. */
function equalTimes(points, every) {
  const found = [];
  for (let k = points.length - 1; k > 0 && found.length < MAX_DOTS; k -= 1) {
    const [from, to] = [points[k - 1], points[k]], span = to.stamp - from.stamp;
    if (!(span > 0) || from.order !== to.order - 1) continue;
    for (let time = every * Math.floor(to.stamp / every); time > from.stamp; time -= every) {
      const share = (time - from.stamp) / span;
      found.push([from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)]);
    }
  }
  return found;
}

function cursorWords({ range, bearing }, up) {
  return `EBL ${direction(Math.cos(bearing), Math.sin(bearing), up)}, VRM ${distance(range)}`;
}

/* Red, green and blue of a colour of the form #rrggbb. */
function channels(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

/* Land as a picture with a pixel for each cell. */
function landPicture({ width, bits }, colour) {
  const bytes = Uint8Array.from(atob(bits), (sign) => sign.charCodeAt(0));
  const picture = document.createElement("canvas");
  picture.width = width;
  picture.height = Math.floor(8 * bytes.length / width);
  const data = new ImageData(picture.width, picture.height);
  for (let k = 0; k < width * picture.height; k += 1) {
    if ((bytes[k >> 3] >> (7 - k % 8)) & 1) data.data.set([...colour, 255], 4 * k);
  }
  picture.getContext("2d").putImageData(data, 0, 0);
  return picture;
}

/* A colour between two of the form #rrggbb. */
function mixed(from, to, share) {
  const parts = [1, 3, 5].map((at) => {
    const [a, b] = [from, to].map((colour) => parseInt(colour.slice(at, at + 2), 16));
    return Math.round(a + share * (b - a));
  });
  return `rgb(${parts.join(",")})`;
}
