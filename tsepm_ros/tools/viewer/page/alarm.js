/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* The alarms: on closest approaches, tracks new in a guard zone, lost tracks, and data that stops.

   Each has a key, such as "cpa 7", and the number of the frame in which it began. The server keeps
   up to which frame each key was acknowledged, for all browsers. */

const AWAY_SCANS = 5; // a cause is over once it has been absent for so many scans
const LOST_SCANS = 2; // a track is lost once it is missing in so many scans
const MAX_SAID = 3; // alarms of which the page says more than their number
const SOUND_PERIOD = 3000; // ms between sounds until the alarms are acknowledged
const NO_ALARM = {
  cpa_limit: 0, tcpa_limit: 1200, lost_targets: false, guard_min_range: 0, guard_max_range: 0,
  guard_azimuth_min: -Math.PI, guard_azimuth_max: Math.PI,
};

class Alarm {
  constructor() {
    this.settings = { ...NO_ALARM };
    this.near = new Set(); // ids whose closest approach is below the limit now; one set for good
    this.acknowledged = {}; // number of the frame by key
    this.clear();
  }

  /* Begin anew, as after a restart of the source; an alarm for missing data stays. */
  clear() {
    const data = this.known && this.known.get("data");
    this.known = new Map(data ? [["data", data]] : []); // alarms by key
    this.held = new Map(); // id: {row, missing}
    this.first = this.last = null; // numbers of frames
    this.near.clear();
  }

  /* Begin anew with a server, whose frames may count from 1 again. */
  renew() {
    const data = this.known.get("data");
    if (data && !this.isRaised(data)) this.known.delete("data");
    else if (data) data.number = 0.5;
    this.clear();
  }

  /* Take the tracks of a frame. */
  update(frame, scene) {
    if (frame.restart) this.clear();
    const again = frame.number === this.last;
    this.first = this.first === null ? frame.number : this.first;
    this.last = frame.number;
    this.near.clear();
    const ship = scene.ownShip(frame), { settings } = this;
    for (const row of sure(frame)) {
      const id = row[Row.ID], approach = closestApproach(row, ship);
      this.held.set(id, { row, missing: 0 });
      this.known.delete(`lost ${id}`);
      if (approach) {
        const { away, distance: closest, time } = approach;
        const begins = closest < settings.cpa_limit && time >= 0 && time <= settings.tcpa_limit;
        if (begins) this.near.add(id);
        this.note("cpa", id, frame, begins, time < 0 && away > settings.cpa_limit);
      }
      const inside = this.inZone(row, ship);
      this.note("zone", id, frame, inside, !inside);
    }
    for (const [id, track] of this.held) {
      if (!again && !sure(frame).some((row) => row[Row.ID] === id)) this.miss(id, track, frame);
    }
    for (const alarm of [...this.known.values()]) {
      const gone = alarm.kind === "lost" ? !this.isRaised(alarm) : alarm.id !== null && !scene.histories.has(alarm.id);
      if (gone) this.forget(alarm.id);
    }
  }

  /* Begin an alarm, or count the scans since its cause is over. */
  note(kind, id, frame, begins, over) {
    const key = `${kind} ${id}`, alarm = this.known.get(key);
    if (begins && !alarm) this.begin(key, kind, id, frame);
    else if (begins) alarm.away = 0;
    else if (alarm && over) {
      alarm.away += 1;
      if (alarm.away >= AWAY_SCANS) this.known.delete(key);
    }
  }

  begin(key, kind, id, frame, more = {}) {
    this.known.set(key, { key, kind, id, number: frame.number, stamp: frame.stamp, away: 0, ...more });
  }

  /* A track that is missing or coasts is lost, unless it stands still or is in the place of another. */
  miss(id, track, frame) {
    track.missing += 1;
    if (track.missing < LOST_SCANS) return;
    this.held.delete(id);
    const [x, y] = [track.row[Row.X], track.row[Row.Y]];
    const another = frame.fixed.some((row) => row[Row.ID] === id) || sure(frame).some((row) =>
      Math.hypot(row[Row.X] - x, row[Row.Y] - y) < track.row[Row.MAJOR]);
    const watched = this.settings.lost_targets || this.known.has(`cpa ${id}`) || this.known.has(`zone ${id}`);
    if (watched && !another) this.begin(`lost ${id}`, "lost", id, frame, { x, y });
  }

  /* Take that data has stopped, or goes on. */
  watchData(frame, stopped, seconds) {
    const alarm = this.known.get("data");
    if (stopped && frame && !(alarm && alarm.stopped)) {
      this.begin("data", "data", null, { number: frame.number + 0.5, stamp: frame.stamp }, { stopped, seconds });
    } else if (alarm) {
      if (stopped) alarm.seconds = seconds;
      else if (!this.isRaised(alarm)) this.known.delete("data");
      else alarm.stopped = false;
    }
  }

  /* Whether a track is in the guard zone: its sector is from the bow. */
  inZone(row, ship) {
    const { guard_min_range: near, guard_max_range: far } = this.settings;
    if (!(far > 0) || !ship) return false;
    const [dx, dy] = [row[Row.X] - ship[0], row[Row.Y] - ship[1]];
    const away = Math.hypot(dx, dy);
    if (away < near || away > far) return false;
    if (this.allRound()) return true;
    if (ship[2] === null) return false;
    const { guard_azimuth_min: begin, guard_azimuth_max: end } = this.settings;
    const from = (Math.atan2(dy, dx) - ship[2] - begin) % (2 * Math.PI);
    return (from + 2 * Math.PI) % (2 * Math.PI) <= end - begin;
  }

  allRound() {
    return this.settings.guard_azimuth_max - this.settings.guard_azimuth_min > 2 * Math.PI - 1e-6;
  }

  forget(id) {
    for (const kind of ["cpa", "zone", "lost"]) this.known.delete(`${kind} ${id}`);
    this.held.delete(id);
  }

  /* Look anew for closest approaches and targets in the zone, as with other limits. */
  forgetApproaches() {
    for (const [key, { kind }] of this.known) if (kind === "cpa" || kind === "zone") this.known.delete(key);
  }

  /* Whether nobody has acknowledged an alarm. One that was there when the page was loaded began
     before, so that a former acknowledgement counts. */
  isRaised({ key, number }) {
    const upTo = this.acknowledged[key], lasts = /^(cpa|zone)/.test(key);
    return upTo === undefined || (number > upTo && !(lasts && number - this.first < AWAY_SCANS));
  }

  /* The alarms that nobody has acknowledged. A lost track has its alarm for that alone. */
  raised() {
    return [...this.known.values()].filter((alarm) => this.isRaised(alarm)
      && (alarm.kind === "lost" || !this.known.has(`lost ${alarm.id}`)));
  }

  /* What acknowledges all of them. */
  acknowledgement() {
    return Object.fromEntries([...this.known.values()].filter((alarm) => this.isRaised(alarm))
      .map(({ key, number }) => [key, number]));
  }

  /* What the page says of them, the most urgent first: [lead, words] of each. */
  words(frame, scene, elapsed = 0) {
    const ship = scene.ownShip(frame), north = scene.north(frame);
    const from = (place) => (ship ? `, ${rangeAndBearing(ship, place, north)}` : "");
    const said = this.raised().map(({ kind, id, stamp, stopped, seconds, x, y }) => {
      if (kind === "data") {
        return [-1, "", `${stopped ? "No data" : "Data had stopped"} for ${wholeSeconds(seconds)}`];
      }
      if (kind === "lost") return [2e9, "Lost: ", `track ${id}${from([x, y])}, at ${clock(stamp)}`];
      const row = sure(frame).find((one) => one[Row.ID] === id);
      if (kind === "zone") return [1.5e9, "Guard zone: ", `track ${id}${row ? from([row[Row.X], row[Row.Y]]) : ""}`];
      const approach = row && closestApproach(row, ship);
      const what = !row ? "no longer seen" : approach ? approachWords(approach, elapsed) : "own ship is not known";
      return [approach && approach.time >= elapsed ? approach.time : 1e9, "Closest approach: ", `track ${id}, ${what}`];
    });
    const words = said.sort(([one], [other]) => one - other).map(([, ...one]) => one);
    return words.length > MAX_SAID
      ? [...words.slice(0, MAX_SAID), ["", `${words.length - MAX_SAID} more`]] : words;
  }

  /* Whether the alarm watches, in words, and the kind of its badge. */
  state(frame, scene, hasData) {
    const { cpa_limit: limit, guard_max_range: far } = this.settings;
    if (!hasData || !frame) return ["Cannot alarm: no data", "error"];
    if (!(limit > 0) && !(far > 0) && !this.raised().length) return ["Alarm off", "stale"];
    const ship = scene.ownShip(frame);
    if (!ship || (limit > 0 && ship[3] === null)) return ["Cannot alarm: no own ship", "error"];
    if (far > 0 && ship[2] === null && !this.allRound()) return ["Cannot alarm: no heading", "error"];
    const about = new Set([...this.near, ...this.raised().map(({ id }) => id).filter((id) => id !== null)]);
    if (about.size) return [`Alarm: ${plural(about.size, "track")}`, "error"];
    const on = [limit > 0 && `CPA ${distance(limit)}`, far > 0 && "guard zone"].filter(Boolean);
    return [`Alarm on: ${on.join(", ")}`, "ok"];
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
