/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* What an operator reads off: closest approaches, places on the earth, files. */

const DEGREE_DIGITS = 7; // of GeoJSON: 1 cm

/* ---- closest point of approach ---- */

/* The closest approach of a track to own ship, as its row has it; null where it is not known. */
function closestApproach(row) {
  return row[Row.CPA] === undefined ? null : { distance: row[Row.CPA], std: row[Row.CPA_STD], time: row[Row.TCPA] };
}

/* `since`: s since the stamp, so that the time counts from now. */
function approachWords({ distance: closest, std, time: then }, since) {
  const time = then - since;
  return time < 0 ? "passed" : `${distance(closest)} ± ${distance(std)} in ${duration(time)}`;
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

/* ---- files of the tracks ---- */

/* Positions of all tracks up to a frame, a line for each. */
function tracksAsCsv(scene, number) {
  const lines = ["track_id,time,x,y,vx,vy,time_since_hit,latitude,longitude,status"];
  for (const [id] of scene.histories) {
    for (const point of scene.lives(id, number).flat()) {
      const place = geographic(scene.info, point.x, point.y) || ["", ""];
      lines.push([
        id, point.stamp.toFixed(3), ...[point.x, point.y].map((value) => value.toFixed(2)),
        ...[point.vx, point.vy, point.sinceHit].map((value) => value.toFixed(3)),
        ...place.map((value) => value && value.toFixed(DEGREE_DIGITS)), point.status,
      ].join(","));
    }
  }
  return `${lines.join("\n")}\n`;
}

/* The same as GeoJSON (RFC 7946), a feature for each track; positions without a place are left out. */
function tracksAsGeoJson(scene, number) {
  const features = [];
  const tracks = [...scene.histories.keys()].flatMap((id) => scene.lives(id, number).map((life) => [id, life]));
  for (const [id, life] of tracks) {
    const points = life
      .map((point) => ({ ...point, place: geographic(scene.info, point.x, point.y) }))
      .filter((point) => point.place);
    if (!points.length) continue;
    const last = points[points.length - 1];
    const properties = {
      track_id: id, times: points.map((point) => new Date(1000 * point.stamp).toISOString()),
      status: points.map((point) => point.status),
      speed: Number(Math.hypot(last.vx, last.vy).toFixed(3)),
      course: Number(((Math.atan2(last.vx, last.vy) * 180 / Math.PI + 360) % 360).toFixed(1)) % 360,
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
