"use strict";

/* What an operator reads off: closest approaches and their alarm, places on the earth, files. */

const AWAY_SCANS = 5; // an approach is over once a track has gone away for so many scans
const MAX_SAID = 3; // approaches of which the alarm says more than their number
const LEAST_SPEED = 1e-3; // m/s; slower relative motion is rounding
const DEGREE_DIGITS = 7; // of GeoJSON: 1 cm

/* ---- closest point of approach ---- */

/* Distance (m) of the closest approach of a track to own ship, and the time (s) until then, at
   constant velocities: t = -p . v / |v|^2 and |p + v t|, relative to own ship. Null where own
   ship or its velocity is not known. */
function closestApproach(row, ship) {
  if (!ship || ship[3] === null) return null;
  const [x, y] = [row[Row.X] - ship[0], row[Row.Y] - ship[1]];
  const [vx, vy] = [row[Row.VX] - ship[3], row[Row.VY] - ship[4]];
  const square = vx * vx + vy * vy;
  const time = square > LEAST_SPEED ** 2 ? -(x * vx + y * vy) / square : 0;
  return { away: Math.hypot(x, y), distance: Math.hypot(x + vx * time, y + vy * time), time };
}

function approachWords({ away, distance: closest, time }) {
  return time < 0 ? `going away, ${distance(away)}` : `${distance(closest)} in ${duration(time)}`;
}

/* Raises the alarm once per approach. */
class Alarm {
  constructor() {
    this.limit = 0; // m; 0: off
    this.horizon = 1200; // s
    this.near = new Set(); // ids whose closest approach is below the limit now; one set for good
    this.clear();
  }

  clear() {
    this.approaches = new Map(); // id: scans since it turned away
    this.raised = new Set(); // ids that nobody has acknowledged
    this.near.clear();
  }

  /* Take the tracks of a frame; returns whether an approach has begun. */
  update(frame, scene) {
    if (frame.restart) this.clear();
    this.near.clear();
    let begun = false;
    for (const row of frame.tracks) {
      const id = row[Row.ID], approach = closestApproach(row, scene.ownShip(frame));
      if (!approach) continue;
      const { away, distance: closest, time } = approach;
      if (closest < this.limit && time >= 0 && time <= this.horizon) {
        this.near.add(id);
        if (!this.approaches.has(id)) {
          this.raised.add(id);
          begun = true;
        }
        this.approaches.set(id, 0);
      } else if (this.approaches.has(id) && time < 0 && away > this.limit) {
        this.approaches.set(id, this.approaches.get(id) + 1);
        if (this.approaches.get(id) >= AWAY_SCANS) this.forget(id);
      }
    }
    for (const id of this.approaches.keys()) if (!scene.histories.has(id)) this.forget(id);
    return begun;
  }

  forget(id) {
    this.approaches.delete(id);
    this.raised.delete(id);
  }

  /* What the page says of the approaches that nobody has acknowledged, the soonest first. */
  words(frame, scene) {
    const said = [...this.raised].map((id) => {
      const row = frame.tracks.find((one) => one[Row.ID] === id);
      const approach = row && closestApproach(row, scene.ownShip(frame));
      const what = !row ? "no longer seen" : approach ? approachWords(approach) : "own ship is not known";
      return [approach && approach.time >= 0 ? approach.time : 1e9, `track ${id}, ${what}`];
    });
    const words = said.sort(([one], [other]) => one - other).map(([, one]) => one);
    return words.length > MAX_SAID
      ? [...words.slice(0, MAX_SAID), `${words.length - MAX_SAID} more`] : words;
  }

  /* Whether the alarm watches, in words, and the kind of its badge. */
  state(frame, scene, connected) {
    if (!(this.limit > 0)) return ["Alarm off", "stale"];
    if (!connected || !frame) return ["Alarm: no data", "error"];
    const ship = scene.ownShip(frame);
    if (!ship || ship[3] === null) return ["Alarm: no own ship", "error"];
    if (this.near.size) return [`Alarm: ${plural(this.near.size, "track")}`, "error"];
    return [`Alarm on, ${distance(this.limit)}`, "ok"];
  }
}

/* Three short tones. */
function sound(context) {
  for (const begin of [0, 0.3, 0.6]) {
    const tone = context.createOscillator();
    tone.frequency.value = 880;
    tone.connect(context.destination);
    tone.start(context.currentTime + begin);
    tone.stop(context.currentTime + begin + 0.15);
  }
}

/* ---- places on the earth ---- */

/* Latitude and longitude, degrees, of a position: see geographic_terms in page_content.py. Null
   where they are not known. */
function geographic({ geographic: known }, x, y) {
  if (!known || Math.hypot(x, y) > known.reach) return null;
  let [latitude, longitude] = known.origin;
  for (const [i, j, north, east] of known.terms) {
    const power = (x / known.reach) ** i * (y / known.reach) ** j;
    latitude += north * power;
    longitude += east * power;
  }
  return [latitude, (longitude + 540) % 360 - 180];
}

/* Degrees and minutes, such as 59°39.012′N. */
function degrees(value, width, letters) {
  const minutes = Math.round(Math.abs(value) * 60000);
  const whole = String(Math.floor(minutes / 60000)).padStart(width, "0");
  const rest = ((minutes % 60000) / 1000).toFixed(3).padStart(6, "0");
  return `${whole}°${rest}′${letters[value < 0 ? 1 : 0]}`;
}

function geographicWords(info, x, y) {
  const place = geographic(info, x, y);
  return place ? `${degrees(place[0], 2, "NS")} ${degrees(place[1], 3, "EW")}` : "";
}

/* Range and bearing from one point to another. */
function rangeAndBearing([x, y], [toX, toY], north) {
  return `${distance(Math.hypot(toX - x, toY - y))}, ${direction(toX - x, toY - y, north)}`;
}

/* ---- files of the tracks ---- */

/* Positions of all tracks up to a frame, a line for each. */
function tracksAsCsv(scene, number) {
  const lines = ["track_id,time,x,y,vx,vy,time_since_hit,latitude,longitude"];
  for (const [id] of scene.histories) {
    for (const point of scene.trail(id, number, Infinity)) {
      const place = geographic(scene.info, point.x, point.y) || ["", ""];
      lines.push([
        id, point.stamp.toFixed(3), ...[point.x, point.y].map((value) => value.toFixed(2)),
        ...[point.vx, point.vy, point.sinceHit].map((value) => value.toFixed(3)),
        ...place.map((value) => value && value.toFixed(DEGREE_DIGITS)),
      ].join(","));
    }
  }
  return `${lines.join("\n")}\n`;
}

/* The same as GeoJSON (RFC 7946), a feature for each track; positions without a place are left out. */
function tracksAsGeoJson(scene, number) {
  const features = [];
  for (const [id] of scene.histories) {
    const points = scene.trail(id, number, Infinity)
      .map((point) => ({ ...point, place: geographic(scene.info, point.x, point.y) }))
      .filter((point) => point.place);
    if (!points.length) continue;
    const last = points[points.length - 1];
    const properties = {
      track_id: id, times: points.map((point) => new Date(1000 * point.stamp).toISOString()),
      speed: Number(Math.hypot(last.vx, last.vy).toFixed(3)),
      course: Number(((Math.atan2(last.vx, last.vy) * 180 / Math.PI + 360) % 360).toFixed(1)),
    };
    const places = points.map(({ place: [latitude, longitude] }) =>
      [longitude, latitude].map((value) => Number(value.toFixed(DEGREE_DIGITS))));
    features.push({ type: "Feature", geometry: geometry(places), properties });
  }
  return `${JSON.stringify({ type: "FeatureCollection", features })}\n`;
}

/* A point, a line, or lines that are cut at 180 degrees of longitude. */
function geometry(places) {
  if (places.length === 1) return { type: "Point", coordinates: places[0] };
  const parts = [[]];
  places.forEach(([longitude, latitude], order) => {
    const [before, beforeLatitude] = places[Math.max(order - 1, 0)];
    if (Math.abs(longitude - before) > 180) {
      const side = before < 0 ? -180 : 180, way = longitude + 2 * side - before;
      const share = way ? (side - before) / way : 0;
      const crossing = beforeLatitude + share * (latitude - beforeLatitude);
      parts[parts.length - 1].push([side, crossing]);
      parts.push([[-side, crossing]]);
    }
    parts[parts.length - 1].push([longitude, latitude]);
  });
  if (parts.length === 1) return { type: "LineString", coordinates: parts[0] };
  return { type: "MultiLineString", coordinates: parts };
}

/* Hand a text to the browser as a file. */
function download(name, type, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
