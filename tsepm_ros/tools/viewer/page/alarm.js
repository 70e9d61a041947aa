/* Copyright 2026 tsepm_ros developers
 * SPDX-License-Identifier: Apache-2.0 */
"use strict";

/* The alarms: the viewer's node holds them, also while no page is open. A page shows them, sounds
   while they are not acknowledged, and passes on what its user acknowledges. */

const MAX_SAID = 3; // alarms that the page shows before it is asked for all
const SOUND_PERIOD = 3000; // ms between sounds until the alarms are acknowledged
const DISCONNECTED = 5000; // ms without a word until the viewer is gone, and then until the page makes a sound
const STATES = {
  unacknowledged: "ALARM", silenced: "ALARM, silenced", rectified: "over, not acknowledged",
  acknowledged: "acknowledged",
};
const NO_ALARMS = { alarms: [], watched: "", patience: 5, run: 1, gates: [] };

/* Ids of the tracks with an alarm of a kind whose cause is there. */
function alarmedIds({ alarms, run }, kind) {
  const name = new RegExp(`^${kind} (\\d+)${run > 1 ? ` \\(run ${run}\\)` : ""}$`);
  return new Set(alarms.filter(({ state }) => state !== "rectified")
    .map(({ key }) => name.exec(key)).filter(Boolean).map(([, id]) => Number(id)));
}

/* Lost tracks: [name, x, y]. */
function lostPlaces({ alarms }) {
  return alarms.flatMap(({ places }) => Object.entries(places).map(([name, place]) => [name, ...place]));
}

/* What the page says of an alarm, besides its state. */
function alarmWords({ title, sentence, onset, time, count, state }) {
  const begun = `${count > 1 ? `${count} times since` : "since"} ${clock(time)}`;
  const first = onset !== sentence && title === "Closest approach"
    ? `; at the alarm ${inUnits(onset.replace(/^[^,]*, /, ""))}` : "";
  return `${title}: ${state === "rectified" ? "had been " : ""}${inUnits(sentence)}${first}, ${begun}`;
}

/* The words of the badge and its kind: what is raised, why no alarm can come, or what is watched. */
function alarmBadge({ alarms, watched }, hasData) {
  const raised = alarms.filter(({ state }) => state !== "acknowledged");
  if (!hasData) return ["Cannot alarm: no data", "error"];
  const lost = alarms.find(({ title }) => /^(Limits lost|Cannot alarm)$/.test(title));
  if (lost) return [lost.title === "Limits lost" ? lost.title : `${lost.title}: ${lost.sentence}`, "error"];
  if (raised.length) {
    const silenced = raised.every(({ state }) => state === "silenced") ? ", silenced" : "";
    return [`${plural(raised.length, "alarm")} not acknowledged${silenced}`, "error"];
  }
  if (alarms.length) return [`${plural(alarms.length, "alarm")} acknowledged`, "warn"];
  if (!watched) return ["Cannot alarm: the viewer holds none", "error"];
  return [`Alarm on: ${inUnits(watched)}`, watched === "data alone" ? "stale" : "ok"];
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
