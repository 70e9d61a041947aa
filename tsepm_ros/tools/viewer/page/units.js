/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* Numbers and words in the units that the user has chosen, and what a browser keeps of its user. */

const DATE = 1e8; // a larger stamp is a date, s since 1970
const NAUTICAL_MILE = 1852; // m
const KNOT = NAUTICAL_MILE / 3600; // m/s
const LEAST_MILES = 0.005; // shorter distances are in m, also in nautical units
const NAUTICAL_RANGES = [0.125, 0.25, 0.5, 0.75, 1.5, 3, 6, 12, 24, 48, 96]; // NM, of radars
const LEAST_RANGE = 0.5; // m, of the range scales
const MOST_RANGE = 2e5; // m

/* A setting that was kept in this browser, which may keep none. */
function kept(name, otherwise) {
  try {
    return JSON.parse(localStorage.getItem(`tsepm ${name}`)) ?? otherwise;
  } catch {
    return otherwise;
  }
}

function keep(name, value) {
  try {
    localStorage.setItem(`tsepm ${name}`, JSON.stringify(value));
  } catch { /* it is asked again */ }
}

const units = {
  nautical: kept("nautical", false),
  relative: kept("bearings", false), // whether bearings are from the bow where north is known, too
  /* Metres of the unit of distances, and m/s of that of speeds. */
  get length() { return this.nautical ? NAUTICAL_MILE : 1; },
  get speed() { return this.nautical ? KNOT : 1; },
  get lengthName() { return this.nautical ? "NM" : "m"; },
  get speedName() { return this.nautical ? "kn" : "m/s"; },
};

function clock(stamp) {
  if (stamp < DATE) return `${stamp.toFixed(1)} s`;
  return `${new Date(1000 * stamp).toISOString().slice(11, 19)} UTC`;
}

function duration(seconds) {
  if (!(seconds >= 0)) return "unknown";
  if (seconds < 120) return `${seconds.toFixed(seconds < 10 ? 1 : 0)} s`;
  if (seconds < 7200) return `${(seconds / 60).toFixed(seconds < 600 ? 1 : 0)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

function wholeSeconds(seconds) {
  return seconds < 120 ? `${Math.floor(seconds)} s` : duration(seconds);
}

/* A number of three digits or more, and at most two decimals. */
function digits(value) {
  const size = Math.abs(value);
  return value.toFixed(size < 10 ? 2 : size < 100 ? 1 : 0);
}

/* A speed given in m/s, a number in the unit of speeds. */
function speed(vx, vy = 0) {
  const size = Math.hypot(vx, vy) / units.speed;
  return size.toFixed(size < 1 ? 2 : 1);
}

function speedWords(vx, vy = 0) {
  return `${speed(vx, vy)} ${units.speedName}`;
}

function distance(meters) {
  const miles = meters / NAUTICAL_MILE;
  if (units.nautical && miles >= LEAST_MILES) {
    return `${miles.toFixed(miles < 0.1 ? 3 : miles < 10 ? 2 : 1)} NM`;
  }
  if (meters >= 10000) return `${(meters / 1000).toFixed(1)} km`;
  if (meters >= 1000) return `${(meters / 1000).toFixed(2)} km`;
  return `${digits(meters)} m`;
}

/* The same without zeros at the end: of range rings and scales. */
function roundDistance(meters) {
  const miles = meters / NAUTICAL_MILE;
  if (units.nautical && miles >= LEAST_MILES) return `${Number(miles.toPrecision(4))} NM`;
  return meters >= 1000 ? `${Number((meters / 1000).toPrecision(4))} km` : `${Number(meters.toPrecision(4))} m`;
}

/* A direction in degrees, clockwise from a direction `up`, rad from x: see Scene.up. */
function direction(dx, dy, up) {
  const degrees = (up - Math.atan2(dy, dx)) * 180 / Math.PI;
  return `${String(((Math.round(degrees) % 360) + 360) % 360).padStart(3, "0")}°`;
}

/* A sentence of the node, which has distances in m, in the units that the user has chosen. */
function inUnits(words) {
  return words.replace(/([\d.]+)(?: ± ([\d.]+))? m\b/g, (_, value, error) =>
    distance(Number(value)) + (error === undefined ? "" : ` ± ${distance(Number(error))}`));
}

function plural(number, word) {
  return `${number} ${word}${number === 1 ? "" : "s"}`;
}

/* Range and bearing from one point to another. */
function rangeAndBearing([x, y], [toX, toY], up) {
  return `${distance(Math.hypot(toX - x, toY - y))}, ${direction(toX - x, toY - y, up)}`;
}

/* The largest of 1, 2 and 5 times a power of ten that is at most a number. */
function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const step = [5, 2, 1].find((factor) => factor * power <= value * (1 + 1e-9)) || 1;
  return step * power;
}

/* The range scales, m. */
function rangeScales() {
  const found = [];
  for (let range = LEAST_RANGE; range < MOST_RANGE * 1.01; range = roundDown(2.6 * range)) found.push(range);
  if (!units.nautical) return found;
  const miles = NAUTICAL_RANGES.map((one) => one * NAUTICAL_MILE);
  return [...found.filter((range) => range < miles[0]), ...miles];
}

/* The range scale next to a range, m: the larger one if `larger`, else the smaller one. */
function nextScale(range, larger) {
  const scales = rangeScales();
  const found = larger ? scales.find((one) => one > range * 1.001) : scales.findLast((one) => one < range * 0.999);
  return found === undefined ? scales[larger ? scales.length - 1 : 0] : found;
}
