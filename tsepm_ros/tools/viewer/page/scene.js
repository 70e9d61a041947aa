/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* What the page knows: the frames of a source, and the history of each track in them. */

const MAX_FRAMES = 4000; // of a live source; a recording is kept whole

const Row = { ID: 0, X: 1, Y: 2, VX: 3, VY: 4, MAJOR: 5, MINOR: 6, ANGLE: 7, SPEED_STD: 8, SINCE_HIT: 9, STATUS: 10, EXISTENCE: 11, TCPA: 12, CPA: 13, CPA_STD: 14 };
const SILENT = 2; // level of the diagnostics from which on a sensor is silent: an error, or stale
const SENSOR_COLOURS = 5; // of several sensors: those beyond begin again
const COASTING = 1, STANDS_STILL = 2; // of the states of a track: see TrackStatus

function coasts(row) {
  return row[Row.STATUS] === COASTING;
}

function stands(row) {
  return row[Row.STATUS] === STANDS_STILL;
}

/* Whether a track has no detection now: in this scan or, of several sensors, lately by any. */
function missed(row) {
  return row.seen === undefined ? row[Row.SINCE_HIT] > 0 : !row.seen;
}

/* What a track is said to be, where it does not move. */
function statusWords(row) {
  return coasts(row) ? "coasting" : stands(row) ? "stands still" : "";
}

/* Signs of several sensors: their first letters, or their numbers where letters are not unique. */
function sensorSigns(names) {
  const letters = names.map((name) => name.slice(0, 1).toUpperCase());
  return new Set(letters).size === names.length ? letters : names.map((_, k) => String(k + 1));
}

/* The tracks of a frame that do not coast. */
function sure(frame) {
  return frame.tracks.filter((row) => !coasts(row));
}

/* Number of what stands still: tracks, and fixed echoes that are none of them. */
function standing(frame) {
  const ids = new Set(frame.tracks.filter(stands).map((row) => row[Row.ID]));
  for (const row of frame.fixed) ids.add(row[Row.ID]);
  return ids.size;
}

/* How many tracks move, in words; and how many coast or stand still, if any. */
function countWords(frame, words = String) {
  const moving = frame.tracks.filter((row) => !statusWords(row)).length;
  const coasting = frame.tracks.filter(coasts).length, still = standing(frame);
  return words(moving) + (coasting ? `, ${coasting} coasting` : "") + (still ? `, ${still} standing still` : "");
}

class Scene {
  constructor() {
    this.clear();
  }

  clear() {
    this.info = {};
    this.frames = [];
    this.removed = 0; // frames forgotten before the first one
    this.facts = {};
    this.truth = [];
    this.images = []; // {stamp, cell, side, levels}, by stamp; live the newest
    this.health = []; // of each node: {node, level, entries, heard, period}
    this.alarms = NO_ALARMS; // as the server says them
    this.land = null; // as the server says it, with its picture once it was drawn
    this.northOf = ""; // the frame in which y is north, as own ship is known in it
    this.places = {}; // of several sensors, by name: x, y, yaw on own ship, where it moves
    this.histories = new Map(); // id: [{number, order, stamp, x, y, ...}], by number
    this.span = null; // [min x, min y, max x, max y] of everything seen, m
  }

  /* Take a message of the server, or a whole recording: see page_content.py. */
  merge(message) {
    if (message.all) this.clear();
    if (message.info) this.info = message.info;
    if (message.truth) this.truth = message.truth;
    if (message.images) this.images = message.images.map(convertedImage);
    if (message.health) {
      this.health = message.health;
      this.place();
    }
    if (message.alarms) this.alarms = message.alarms;
    if ("land" in message) this.land = message.land;
    if (message.facts) Object.assign(this.facts, message.facts);
    for (const frame of message.frames || []) this.take(converted(frame));
  }

  take(frame) {
    const last = this.frames[this.frames.length - 1];
    if (last && last.number === frame.number) this.frames.pop();
    this.frames.push(frame);
    if (frame.own_ship) this.northOf = frame.frame_id;
    for (const row of frame.tracks) {
      let history = this.histories.get(row[Row.ID]);
      if (!history) this.histories.set(row[Row.ID], history = []);
      if (history.length && history[history.length - 1].number === frame.number) history.pop();
      const before = history[history.length - 1], { first } = this.facts[row[Row.ID]] || {};
      const again = before && (frame.stamp < before.stamp || (first > before.stamp && first <= frame.stamp));
      history.push({
        life: before ? before.life + again : 0, // a track initiator that starts again gives ids again
        number: frame.number, order: this.removed + this.frames.length, stamp: frame.stamp,
        missed: missed(row), status: statusWords(row) || "confirmed", sinceHit: row[Row.SINCE_HIT], x: row[Row.X], y: row[Row.Y], vx: row[Row.VX], vy: row[Row.VY],
      });
    }
    if (this.info.kind === "live" && this.frames.length > MAX_FRAMES) this.forget();
  }

  /* Forget the oldest quarter of the frames, and the tracks that were only in them. */
  forget() {
    this.removed += this.frames.splice(0, Math.floor(MAX_FRAMES / 4)).length;
    const first = this.frames[0].number;
    for (const [id, history] of this.histories) {
      const kept = history.filter((point) => point.number >= first);
      if (kept.length) {
        this.histories.set(id, kept);
      } else {
        this.histories.delete(id);
        delete this.facts[id];
      }
    }
  }

  /* Positions of the track that had an id last up to a frame, for the last `scans` scans. */
  trail(id, number, scans) {
    const history = this.histories.get(id) || [];
    let end = history.length;
    while (end > 0 && history[end - 1].number > number) end -= 1;
    let begin = end;
    const of = (place) => history[place - 1];
    while (begin > 0 && of(begin).number > number - scans && of(begin).life === of(end).life) begin -= 1;
    return history.slice(begin, end);
  }

  /* Positions up to a frame of each of the tracks that have had an id. */
  lives(id, number) {
    const found = [];
    for (const point of this.histories.get(id)) {
      if (point.number <= number) (found[point.life] = found[point.life] || []).push(point);
    }
    return found.filter(Boolean);
  }

  /* Whether y is north: said by a recording; live where own ship moves in the frame, also while
     nothing is known of it now. */
  north(frame) {
    if (this.info.north !== undefined) return this.info.north;
    const source = this.diagnostic("own ship", "source");
    return Boolean(frame) && (source === "odometry" || source === "tf" || (this.northOf !== "" && this.northOf === frame.frame_id));
  }

  /* A line in the axes of the fixed frame, of which the name may say that x is north, in east and
     north, or back. */
  exchanged([x1, y1, x2, y2]) {
    const frame = this.frames[this.frames.length - 1];
    const down = frame && /(^|[/_])(ned|frd)(_frame)?$/i.test(frame.frame_id);
    return down ? [y1, x1, y2, x2] : [x1, y1, x2, y2];
  }

  /* The direction from which others are measured, clockwise, rad from x: north, or the bow where
     north is not known or the user wants relative bearings. */
  up(frame) {
    const ship = this.ownShip(frame);
    return this.isTrue(frame) ? Math.PI / 2 : (ship && ship[2]) || 0;
  }

  /* Whether directions are true ones. */
  isTrue(frame) {
    const ship = this.ownShip(frame);
    return this.north(frame) && !(units.relative && ship && ship[2] !== null);
  }

  /* The entry of a task of the diagnostics, or undefined. */
  entry(task) {
    return this.health.flatMap((one) => one.entries).find((one) => one.task === task);
  }

  /* A value of the diagnostics, or undefined. */
  diagnostic(task, key) {
    const entry = this.entry(task);
    return ((entry && entry.values.find(([name]) => name === key)) || [])[1];
  }

  /* x, y, heading, vx, vy of own ship; at the origin where the diagnostics say that it does not
     move; else null. */
  ownShip(frame) {
    if (!frame || frame.own_ship) return frame ? frame.own_ship : null;
    return this.diagnostic("own ship", "source") === "none" ? [0, 0, 0, 0, 0] : null;
  }

  /* Names of several sensors, in the order of their numbers; empty: there is one. */
  get sensorNames() {
    if (this.info.sensors) return this.info.sensors.map(({ name }) => name);
    return (this.diagnostic("track initiation", "sensors") || "").split(" ").filter(Boolean);
  }

  /* Numbers that the diagnostics state for a sensor of several, or null. */
  numbers(name, key, count) {
    const words = (this.diagnostic(`${name}/detections`, key) || "").split(" ").filter(Boolean);
    return words.length === count && words.every((word) => Number.isFinite(Number(word))) ? words.map(Number) : null;
  }

  /* Note where on own ship the sensors are, by their last poses: it moves on until these are told
     again. Of one that was silent before own ship was known here, its place is not known. */
  place() {
    const { own_ship: ship } = this.frames[this.frames.length - 1] || {};
    for (const name of this.sensorNames) {
      const pose = this.numbers(name, "pose", 3), { level } = this.entry(`${name}/detections`) || {};
      if (!ship || ship[2] === null) delete this.places[name];
      else if (pose && level < SILENT) {
        this.places[name] = [...turned(pose[0] - ship[0], pose[1] - ship[1], -ship[2]), pose[2] - ship[2]];
      }
    }
  }

  /* Several sensors: name, sign, `sector` from its axis (m, rad), `pose` (x, y, yaw) in a frame,
     both null where not known, and whether it is silent. Empty where there is one. */
  sensors(frame) {
    const names = this.sensorNames, signs = sensorSigns(names);
    const ship = frame && frame.own_ship, [x, y, heading] = ship || [0, 0, 0];
    return names.map((name, k) => {
      const known = this.info.sensors && this.info.sensors[k], entry = this.entry(`${name}/detections`);
      const sector = known ? known.sector : this.numbers(name, "coverage", 4);
      const place = known ? known.place : ship && this.places[name];
      let pose = known ? null : this.numbers(name, "pose", 3);
      if (place && (heading !== null || (sector && sector[3] - sector[2] > FULL_TURN))) {
        const [dx, dy] = turned(place[0], place[1], heading);
        pose = [x + dx, y + dy, heading + place[2]];
      }
      const silent = known ? frame && frame.stamp > known.silent_from : entry && entry.level >= SILENT;
      return { name, sign: signs[k], sector, pose, silent };
    });
  }

  /* Numbers of the sensors that see a track, of several. */
  seenBy(row) {
    return this.sensorNames.map((_, k) => k).filter((k) => Math.floor((row.seen || 0) / 2 ** k) % 2);
  }

  /* Nearest and farthest range (m) and the sector from the bow (rad): said by a recording; live by
     the diagnostics; null where not known. */
  sector() {
    if (this.info.sector) return this.info.sector;
    const given = ["min_range", "max_range", "azimuth_min", "azimuth_max"].map((name) =>
      Number(this.diagnostic("sensor parameters", name)));
    const yaw = Number(this.diagnostic("own ship", "mounting_yaw") || 0);
    const [near, far, begin, end] = given;
    return given.every(Number.isFinite) ? [near, far, begin + yaw, end + yaw] : null;
  }

  /* The newest sonar image up to a frame, with x, y and heading of the sensor then; or null. */
  image(frame) {
    const upTo = this.images.filter(({ stamp }) => stamp <= frame.stamp + 1e-3);
    const image = upTo[upTo.length - 1];
    const then = image && this.frames.findLast(({ stamp }) => stamp <= image.stamp + 1e-3);
    const ship = then && this.ownShip(then);
    if (!ship || ship[2] === null || frame.stamp - image.stamp > 30) return null;
    const yaw = this.info.mounting_yaw === undefined
      ? Number(this.diagnostic("own ship", "mounting_yaw") || 0) : this.info.mounting_yaw;
    return { ...image, x: ship[0], y: ship[1], heading: ship[2] + yaw };
  }

  /* Truth at a stamp: [x, y] of each target that exists then. */
  targets(stamp) {
    const found = [];
    for (const path of this.truth) {
      const after = path.findIndex((point) => point[0] >= stamp);
      if (after < 0 || (after === 0 && path[0][0] > stamp)) continue;
      const [t1, x1, y1] = path[after];
      const [t0, x0, y0] = path[Math.max(after - 1, 0)];
      const share = t1 > t0 ? (stamp - t0) / (t1 - t0) : 0;
      found.push([x0 + share * (x1 - x0), y0 + share * (y1 - y0)]);
    }
    return found;
  }

  /* Rectangle around what some frames show: [min x, min y, max x, max y], or null. */
  bounds(frames) {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    const include = (x, y) => {
      box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
    };
    for (const frame of frames) {
      const points = frame.detections;
      for (let i = 0; i < points.length; i += 2) include(points[i], points[i + 1]);
      for (const row of sure(frame)) include(row[Row.X], row[Row.Y]);
      for (const row of frame.fixed) include(row[Row.X], row[Row.Y]);
      if (frame.own_ship) include(frame.own_ship[0], frame.own_ship[1]);
    }
    for (const path of this.truth) for (const [, x, y] of path) include(x, y);
    return box[0] <= box[2] ? box : null;
  }
}

/* An image with its levels as signed bytes. */
function convertedImage({ stamp, cell, levels }) {
  const bytes = Int8Array.from(atob(levels), (sign) => sign.charCodeAt(0));
  return { stamp, cell, side: Math.round(Math.sqrt(bytes.length)), levels: bytes };
}

/* A frame in SI: the integers of page_content.py are cm, mm/s, mrad, ms and percent. */
function converted(frame) {
  const track = ([id, x, y, vx, vy, major, minor, angle, speedStd, sinceHit = 0, status = 0, existence = 100, ...approach]) => [
    id, 0.01 * x, 0.01 * y, 0.001 * vx, 0.001 * vy,
    0.01 * major, 0.01 * minor, 0.001 * angle, 0.001 * speedStd, 0.001 * sinceHit, status, 0.01 * existence,
    ...approach.map((value, k) => (k ? 0.01 : 0.001) * value),
  ];
  const pose = frame.own_ship;
  return {
    ...frame,
    own_ship: pose && [
      0.01 * pose[0], 0.01 * pose[1],
      ...pose.slice(2, 6).map((value) => (typeof value === "number" ? 0.001 * value : null)),
    ],
    detections: frame.detections.map((value) => 0.01 * value),
    potential: frame.potential.map(([x, y, vx, vy, evidence]) => [
      0.01 * x, 0.01 * y, 0.001 * vx, 0.001 * vy, evidence === null ? null : 0.01 * evidence,
    ]),
    tracks: frame.tracks.map((row, k) => Object.assign(track(row), frame.seen && { seen: frame.seen[k] })),
    fixed: frame.fixed.map(track),
  };
}
