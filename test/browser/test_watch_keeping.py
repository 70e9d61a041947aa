# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The page as a watch uses it: data that stops, alarms, units, orientations, keys, and access."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from support.browser import Browser, Tab, need_browser
from support.pages import confirmed_track, live_state, numbered, served

from tsepm_ros.settings.node_options import AlarmOptions
from tsepm_ros.tools.bridge.nmea import nmea_closest_approach
from tsepm_ros.tools.viewer.page_content import PageState, write_page

need_browser()

MILE, KNOT = 1852.0, 1852.0 / 3600.0
AXE = Path(os.environ.get("AXE", "node_modules/axe-core/axe.min.js"))
SHIP = (0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0)
SEEN = "byId('{}').textContent"


@pytest.fixture
def tab(browser) -> Tab:
    return browser.tab(1300, 900)


def put(state: PageState, number: int, *tracks, age: float = 0.0, own_ship=SHIP, **more) -> None:
    state.put(numbered(number, *tracks, own_ship=own_ship, **more), age=age)


def approaching(track_id: int = 7, x: float = 1000.0):
    """A track that passes own ship, at the origin, at 50 m, in 1/8 s per m."""
    return confirmed_track(track_id, x, 50.0, -8.0, 0.0)


def shared(state: PageState) -> None:
    """Alarms that are asked for are those of all browsers, as the node does it."""
    known = {"cpa_limit": 0.0, "lost_targets": True}
    state.put_info(alarm=dict(known))

    def set_alarm(values):
        known.update(values)
        state.put_info(alarm=dict(known))

    state.set_alarm = set_alarm


def opened(browser: Browser, url: str, *, frozen: bool = True) -> Tab:
    """A page with its first frames, whose time stands still: a busy machine makes no data stale."""
    tab = browser.tab(1300, 900)
    tab.open(url)
    tab.until("scene.frames.length > 0 && page.connected")
    if frozen:
        freeze(tab)
    return tab


def freeze(tab: Tab) -> None:
    tab.value(f"{frozen_now()} alarm.known.delete('data'); showPanels()")


def text(tab: Tab, name: str) -> str:
    tab.value("showPanels()")
    return tab.value(SEEN.format(name))


def drawn(tab: Tab) -> None:
    tab.value(
        "redraw(); new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )


def later(tab: Tab, seconds: float) -> None:
    """Let time pass at the page alone, from when the newest frame came on."""
    tab.value(
        f"if (!window.frozen || !{seconds}) {{ {frozen_now()} }}"
        f"frozen += {1e3 * seconds}; showPanels()"
    )
    drawn(tab)


def come(tab: Tab, state: PageState, number: int, *tracks, **more) -> None:
    """A frame, and the page has it, at the time when it came."""
    tab.value(frozen_now())
    put(state, number, *tracks, **more)
    tab.until(f"scene.frames.at(-1).number === {number}")
    later(tab, 0.0)


def frozen_now() -> str:
    """Script that stops the page's time where the newest frame came."""
    return (
        "window.frozen = scene.frames.at(-1).arrived + page.offset + 0.2;"
        "performance.now = () => frozen;"
    )


def write(tab: Tab, name: str, value: float) -> None:
    """Write a limit of the alarms into its field; the node has it."""
    tab.value(f"byId('{name}').value = {value}; byId('{name}').dispatchEvent(new Event('change'))")
    key = "guard_azimuth_max" if name.startswith("guard_") and "range" not in name else name
    tab.until(f"page.connected && '{key}' in (scene.info.alarm || {{}})")


def colours(tab: Tab, x: float, y: float, half: int = 7) -> set[str]:
    """Colours of the plan about a place."""
    return set(
        tab.value(
            f"""(() => {{
                const [x, y] = plan.screen({x}, {y}).map((value) => Math.round(value) - {half});
                const {{ data }} = plan.context.getImageData(x, y, {2 * half}, {2 * half});
                const found = new Set();
                for (let i = 0; i < data.length; i += 4) {{
                    found.add("#" + [...data.slice(i, i + 3)]
                        .map((v) => v.toString(16).padStart(2, "0")).join(""));
                }}
                return [...found];
            }})()"""
        )
    )


# ---- data that stops ----


def test_data_that_stops_is_seen_and_ages_and_times_go_on(browser):
    state = live_state()
    state.put_info(alarm={"cpa_limit": 100.0})
    put(state, 1, approaching())
    put(state, 2, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        later(tab, 4.0)
        assert text(tab, "state") == "Live"
        assert text(tab, "alarm-chip") == "Alarm: 1 track"
        track = tab.value("plan.colour.error")
        assert track in colours(tab, 1000.0, 50.0)
        tab.value("select(7)")
        later(tab, 27.2)
        assert text(tab, "state") == "No data for 31 s"
        assert tab.value("byId('state').className") == "chip error"
        assert text(tab, "alarm-chip") == "Cannot alarm: no data"
        assert text(tab, "alarm-words").startswith("No data for 31 s · Closest approach: track 7")
        muted = tab.value("plan.colour.muted")
        assert track not in colours(tab, 1000.0, 50.0) and muted in colours(tab, 1000.0, 50.0)
        cells = "[...document.querySelectorAll('#tracks td')].map((one) => one.textContent)"
        assert tab.value(cells)[5:] == ["50.0 m", "94 s"], "of 125 s"
        assert "Last detection31 s ago" in text(tab, "selected")
        assert "no data" in text(tab, "selected")
        tab.press("#acknowledge")
        later(tab, 30.0)
        assert tab.value("byId('alarm').hidden"), "acknowledged, but the badges stay"
        assert text(tab, "state") == "No data for 61 s"
        come(tab, state, 3, approaching())
        assert text(tab, "state") == "Live" and text(tab, "alarm-chip") == "Alarm: 1 track"
        assert track in colours(tab, 1000.0, 50.0)


def test_the_page_of_a_slow_sonar_waits_for_three_of_its_intervals(browser):
    state = live_state()
    for number in range(1, 6):
        put(state, number, approaching(), age=12.0 * (5 - number))
    with served(state) as server:
        tab = opened(browser, server.url)
        later(tab, 30.0)
        assert text(tab, "state") == "Live"
        later(tab, 10.0)
        assert text(tab, "state") == "No data for 40 s"


def test_a_page_that_is_loaded_after_the_data_has_stopped_says_so_at_once(browser):
    state = live_state()
    put(state, 1, approaching(), age=31.5)
    with served(state) as server:
        tab = opened(browser, server.url, frozen=False)
        tab.until("byId('state').textContent.startsWith('No data for 3') && plan.stale")
        tab.reload()
        tab.until("byId('state').textContent.startsWith('No data for 3')")
        assert text(tab, "alarm-words").startswith("No data for 3")


def test_the_sign_that_data_had_stopped_stays_until_it_is_acknowledged(browser):
    state = live_state()
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        later(tab, 20.2)
        come(tab, state, 2, approaching())
        assert text(tab, "alarm-words") == "Data had stopped for 20 s"
        tab.press("#acknowledge")
        assert tab.value("byId('alarm').hidden")


def test_a_viewer_that_ends_and_comes_back_leaves_the_sign_and_one_acknowledgement_suffices(
    browser,
):
    state = live_state(2)
    with served(state) as server:
        port = int(server.url.rpartition(":")[2].strip("/"))
        tab = opened(browser, server.url)
    tab.until("!page.connected")
    later(tab, 60.0)
    assert text(tab, "state") == "No data for 60 s"
    tab.value("delete performance.now")
    with served(live_state(3), port=port):
        tab.until("page.connected && byId('state').textContent === 'Live'")
        assert "Data had stopped" in text(tab, "alarm-words")
        tab.press("#acknowledge")
        tab.until("'data' in (scene.info.acknowledged || {})")
        assert text(tab, "alarm-words") == ""


def test_a_node_whose_diagnostics_stop_is_said_beside_the_others(browser):
    state = live_state(1)
    entry = {"task": "overall", "level": 0, "message": "fine", "values": []}
    with served(state) as server:
        for node in ("/sonar_detector", "/track_bridge"):
            state.put_health({node: {"node": node, "level": 0, "entries": [entry]}})
        tab = opened(browser, server.url)
        tab.until("scene.health.length === 2")
        assert text(tab, "health-chip") == "Health: OK"
        tab.value(
            "scene.health[0].heard -= 6000; scene.health[1].period = 10000; page.offset -= 500"
        )
        assert text(tab, "health-chip") == "Health: Stale"
        assert text(tab, "entries").startswith("Stalesonar_detector, diagnostics: no news")
        assert "OK (1)" in text(tab, "entries")


def test_an_open_health_leaves_alarm_and_tracks_on_a_screen_of_900_rows(browser):
    state = live_state()
    put(state, 1, *(confirmed_track(k, 100.0 * k, 50.0) for k in range(1, 30)))
    values = [[f"figure {k}", "1"] for k in range(20)]
    entries = [
        {"task": f"task {k}", "level": int(k > 5), "message": "a sentence " * 9, "values": values}
        for k in range(9)
    ]
    state.put_health({"/n": {"node": "/n", "level": 1, "entries": entries}})
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.until("scene.health.length")
        tab.press("#health-chip")
        tab.value(
            "for (const one of document.querySelectorAll('#entries details')) one.open = true"
        )
        for part in ("#tracks", "#limits", "#entries"):
            box = tab.value(
                f"(({{ top, bottom }}) => [top, bottom])"
                f"(document.querySelector('{part}').getBoundingClientRect())"
            )
            assert 0 <= box[0] < box[1] <= 900, part
        levels = tab.value(
            "[...document.querySelectorAll('#entries > *')]"
            ".map((one) => one.textContent.slice(0, 7))"
        )
        assert levels == ["Warning", "Warning", "Warning", "OK (6)O"]


# ---- alarms ----


def test_limits_are_those_of_every_browser_and_of_a_page_that_is_loaded_anew(browser):
    state = live_state()
    shared(state)
    put(state, 1, approaching())
    with served(state) as server:
        one, other = opened(browser, server.url), opened(browser, server.url)
        write(one, "cpa_limit", 60)
        for tab in (one, other):
            tab.until("alarm.settings.cpa_limit === 60 && byId('cpa_limit').value === '60'")
            assert text(tab, "alarm-words").startswith("Closest approach: track 7, 50.0 m in 2.1")
        other.reload()
        other.until("page.connected && byId('cpa_limit').value === '60'")
        other.press("#acknowledge")
        for tab in (one, other):
            tab.until("!alarm.raised().some(({ kind }) => kind === 'cpa')")
            assert "Closest" not in text(tab, "alarm-words")
        one.reload()
        one.until("alarm.known.has('cpa 7')")
        assert "Closest" not in text(one, "alarm-words"), "acknowledged on the other page"


def test_a_lost_target_keeps_its_alarm_and_its_sign_until_it_is_acknowledged(browser):
    state = live_state(kept=3)
    shared(state)
    still = confirmed_track(9, -900.0, -900.0, 0.0, 0.0)
    put(state, 1, confirmed_track(7, 600.0, 800.0, 0.0, 1.0), still)
    with served(state) as server:
        one, other = opened(browser, server.url), opened(browser, server.url)
        put(state, 2, still)
        for tab in (one, other):
            tab.until("scene.frames.length === 2")
            assert text(tab, "alarm-words") == "", "it may be vague for a scan"
        put(state, 3, still)
        words = "Lost: track 7, 1.00 km, 037°, at 36.0 s"
        for tab in (one, other):
            tab.until("scene.frames.length === 3")
            assert text(tab, "alarm-words") == words
        drawn(one)
        error = one.value("plan.colour.error")
        assert error in colours(one, 600.0, 800.0, 12)
        for number in range(4, 9):
            come(one, state, number, still)
        one.reload()
        one.until("scene.frames.length === 3 && alarm.known.size")
        assert words in text(one, "alarm-words"), "the frames of then are no longer there"
        other.press("#acknowledge")
        one.until("!alarm.raised().some(({ kind }) => kind === 'lost')")
        one.value("redraw()")
        drawn(one)
        assert error not in colours(one, 600.0, 800.0, 12)
        assert "Lost" not in text(one, "alarm-words")


def test_what_has_become_a_fixed_echo_or_another_s_or_comes_back_is_not_lost(tab):
    with served(live_state(1)) as server:
        tab.open(server.url)
        found = tab.value(
            """(() => {
                const ship = [0, 0, 0, 0, 0], row = (id, x) => [id, x, 0, 1, 0, 20, 20, 0, 1, 0];
                const histories = new Map([1, 2, 3, 4].map((k) => [k, []]));
                const one = new Alarm(); one.settings.lost_targets = true;
                const take = (number, tracks, fixed = []) =>
                    one.update({ number, stamp: number, tracks, fixed },
                        { ownShip: () => ship, histories });
                const all = [row(1, 0), row(2, 500), row(3, 1000), row(4, 2000)];
                take(1, all);
                for (const number of [2, 3]) take(number, [row(5, 510)], [row(1, 0)]);
                const lost = [...one.known.keys()];
                take(4, [row(4, 2000), row(5, 510)]);
                return [lost, [...one.known.keys()]];
            })()"""
        )
    assert found == [["lost 3", "lost 4"], ["lost 3"]]


def test_a_track_that_coasts_raises_no_alarm_but_that_it_is_lost(tab):
    with served(live_state(1)) as server:
        tab.open(server.url)
        found = tab.value(
            """(() => {
                const row = (id, x, status) => [id, x, 0, -1, 0, 20, 20, 0, 1, 0, status, 0.1];
                const one = new Alarm(), histories = new Map([[1, []], [2, []]]);
                one.settings = { ...NO_ALARM, lost_targets: true, cpa_limit: 60 };
                const take = (number, ...tracks) =>
                    one.update({ number, stamp: number, tracks, fixed: [] },
                        { ownShip: () => [0, 0, 0, 0, 0], histories });
                take(1, row(1, 500, COASTING), row(2, 5000, 0));
                const coasting = [...one.known.keys()];
                for (const number of [2, 3]) take(number, row(1, 499, COASTING), row(2, 5000, 1));
                const lost = [...one.known.keys()];
                take(4, row(1, 498, 0), row(2, 5000, 0));
                return [coasting, lost, [...one.known.keys()]];
            })()"""
        )
    assert found == [[], ["lost 2"], ["cpa 1"]]


def test_a_target_that_is_new_in_the_guard_zone_raises_an_alarm_and_the_zone_is_drawn(browser):
    state = live_state()
    shared(state)
    ship = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
    put(state, 1, confirmed_track(7, 3000.0, 0.0), own_ship=ship)
    with served(state) as server:
        tab = opened(browser, server.url)
        write(tab, "guard_min_range", 100)
        write(tab, "guard_max_range", 1000)
        write(tab, "guard_from", 330)
        tab.until("alarm.settings.guard_azimuth_max < 1")
        write(tab, "guard_to", 45)
        tab.until(
            "alarm.settings.guard_azimuth_min < -0.5 && alarm.settings.guard_max_range === 1000"
        )
        limits = tab.value("[alarm.settings.guard_azimuth_min, alarm.settings.guard_azimuth_max]")
        assert limits == pytest.approx(np.deg2rad([-45.0, 30.0]))
        AlarmOptions(
            **{f"guard_azimuth_{k}": v for k, v in zip(("min", "max"), limits, strict=True)}
        )
        drawn(tab)
        x, y = 1000.0 * math.cos(0.5 + 0.2), 1000.0 * math.sin(0.5 + 0.2)
        assert tab.value("plan.colour.error") not in colours(tab, -x, -y, 20)
        assert len(colours(tab, x, y, 20) - colours(tab, -x, -y, 20)) > 3, "its edge"
        assert text(tab, "alarm-words") == "" and text(tab, "alarm-chip") == "Alarm on: guard zone"
        put(state, 2, confirmed_track(8, 500.0, 0.0), own_ship=ship)
        tab.until("scene.frames.length === 2")
        assert text(tab, "alarm-words") == "Guard zone: track 8, 500 m, 090°"


def test_the_guard_zone_is_the_sector_of_the_closed_form(tab):
    rng = np.random.default_rng(5)
    places = rng.uniform(-1500.0, 1500.0, (200, 2)).round(2)
    with served(live_state(1)) as server:
        tab.open(server.url)
        for begin, end, heading in rng.uniform((-3.0, 0.3, -3.0), (0.0, 3.0, 3.0), (8, 3)):
            found = tab.value(
                f"""(() => {{
                    const one = new Alarm();
                    Object.assign(one.settings, {{ guard_min_range: 200, guard_max_range: 1000,
                        guard_azimuth_min: {begin}, guard_azimuth_max: {end} }});
                    return {json.dumps(places.tolist())}.map(([x, y]) =>
                        one.inZone([1, x, y], [10, 20, {heading}, 0, 0]));
                }})()"""
            )
            way = (places - (10.0, 20.0)) @ (1.0, 1.0j)
            bearing = np.angle(way * np.exp(-1j * (heading + 0.5 * (begin + end))))
            inside = (np.abs(bearing) <= 0.5 * (end - begin)) & (np.abs(way) >= 200.0)
            assert found == (inside & (np.abs(way) <= 1000.0)).tolist()


def test_the_sound_repeats_until_the_alarm_is_acknowledged(browser):
    state = live_state()
    state.put_info(alarm={"cpa_limit": 100.0})
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("window.sounds = 0; window.sound = () => { sounds += 1; }; byId('sound').click()")
        tab.until("sounds >= 3")
        tab.press("#acknowledge")
        count = tab.value("sounds")
        tab.value("new Promise((done) => setTimeout(done, SOUND_PERIOD + 200))")
        assert tab.value("sounds") == count
        tab.reload()
        assert tab.value("byId('sound').checked"), "kept"


def test_an_alarm_that_the_node_refuses_is_said(browser):
    state = live_state(1)
    state.put_info(alarm={"cpa_limit": 0.0}, refused="alarm.guard_min_range must be below")
    with served(state) as server:
        tab = opened(browser, server.url)
        assert text(tab, "alarm-note").startswith("alarm.guard_min_range must")


def test_the_focus_stays_in_its_row_while_frames_come_and_rows_change_places(browser):
    state = live_state()
    put(state, 1, approaching(1, 3000.0), approaching(2, 5000.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("showPanels(); document.querySelectorAll('#tracks button')[1].focus()")
        ids = "[...document.querySelectorAll('#tracks tbody button')].map((b) => b.textContent)"
        for number, x in enumerate((4000.0, 2500.0, 1000.0), 2):
            put(state, number, approaching(1, 3000.0), approaching(2, x))
            tab.until(f"scene.frames.length === {number}")
            tab.value("showPanels()")
            assert tab.value("document.activeElement.textContent") == "2"
        assert tab.value(ids) == ["2", "1"]


# ---- units, orientations, vectors ----


def test_ranges_bearings_speeds_and_approaches_agree_with_closed_forms_in_both_units(tab):
    rng = np.random.default_rng(3)
    rows = np.concatenate(
        [rng.uniform(-2e4, 2e4, (30, 2)), rng.uniform(-12.0, 12.0, (30, 4))], axis=1
    ).round(3)
    with served(live_state(1)) as server:
        tab.open(server.url)
        for nautical in (False, True):
            found = tab.value(
                f"""(() => {{
                    const trueVector = (row, ship) => {{
                        plan.relative = false;
                        return plan.vector(row, ship);
                    }};
                    units.nautical = {json.dumps(nautical)};
                    return {json.dumps(rows.tolist())}.map(([x, y, vx, vy, sx, sy]) => {{
                        const row = [1, x, y, vx, vy], ship = [0, 0, 0, sx, sy];
                        const approach = closestApproach(row, ship);
                        plan.relative = true;
                        return [rangeAndBearing(ship, [x, y], true), speedWords(vx, vy),
                            direction(vx, vy, true), distance(approach.distance), approach.time,
                            ...plan.vector(row, ship), ...trueVector(row, ship)];
                    }});
                }})()"""
            )
            length, speed = (MILE, KNOT) if nautical else (1.0, 1.0)
            unit = "NM" if nautical else "m"
            for (x, y, vx, vy, sx, sy), said in zip(rows, found, strict=True):
                away, bearing = said[0].split(", ")
                assert meters(away) == pytest.approx(
                    math.hypot(x, y), rel=0.006, abs=0.006 * length
                )
                assert away.endswith(unit) and turned(bearing, x, y) <= 0.5
                assert said[1].split()[1] == ("kn" if nautical else "m/s")
                knots = math.hypot(vx, vy) / speed
                assert float(said[1].split()[0]) == pytest.approx(knots, abs=0.051)
                assert turned(said[2], vx, vy) <= 0.5
                time, closest = nmea_closest_approach(
                    np.array([[x, y]]), np.array([[vx - sx, vy - sy]])
                )
                assert said[4] == pytest.approx(float(time[0]), rel=1e-6)
                assert meters(said[3]) == pytest.approx(float(closest[0]), rel=0.006, abs=10.0)
                assert said[5:] == pytest.approx([vx - sx, vy - sy, vx, vy])


def meters(words: str) -> float:
    number, unit = words.split()
    return float(number) * {"m": 1.0, "km": 1e3, "NM": MILE}[unit]


def turned(words: str, x: float, y: float) -> float:
    """Degrees between a course as it is said and a vector, clockwise from north."""
    return abs((float(words.rstrip("°")) - math.degrees(math.atan2(x, y)) + 180.0) % 360.0 - 180.0)


def test_the_units_are_one_switch_and_are_kept(browser):
    state = live_state()
    state.put_info(alarm={"cpa_limit": 926.0})
    put(state, 1, confirmed_track(7, 3704.0, 0.0, 0.0, 5.144), own_ship=(0, 0, 0, 2.572, 0.0, 0.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("byId('units').value = '1'; byId('units').dispatchEvent(new Event('change'))")
        cells = "[...document.querySelectorAll('#tracks td')].map((one) => one.textContent)"
        for _ in range(2):
            drawn(tab)
            tab.value("showPanels()")
            assert tab.value(cells)[1:5] == ["2.00 NM", "090°", "10.0", "000°"]
            assert tab.value("byId('cpa_limit').value") == "0.5"
            assert "SOG 5.0 kn" in tab.value(SEEN.format("own-ship"))
            assert text(tab, "alarm-chip") == "Alarm on: CPA 0.50 NM"
            tab.reload()
            tab.until("scene.frames.length === 1 && page.connected")
            freeze(tab)


@pytest.mark.parametrize("orientation", ["north", "course", "head"])
def test_each_orientation_turns_the_plan_with_the_vessel(browser, orientation):
    state = live_state()
    with served(state) as server:
        put(state, 1, approaching())
        tab = opened(browser, server.url)
        tab.value(
            f"byId('orientation').value = '{orientation}';"
            "byId('orientation').dispatchEvent(new Event('change')); plan.moved = true;"
            "plan.layers.follow = true; plan.scale = 0.1; redraw()"
        )
        for number, heading in enumerate(np.linspace(-3.0, 3.0, 7), 2):
            course = heading + 0.3
            ship = (50.0, 80.0, heading, 4.0 * math.cos(course), 4.0 * math.sin(course), 0.0)
            put(state, number, approaching(), own_ship=ship)
            tab.until(f"scene.frames.length === {number}")
            drawn(tab)
            up = {"north": math.pi / 2, "course": course, "head": heading}[orientation]
            for angle in (heading, 0.7):
                place = 50.0 + 900.0 * math.cos(angle), 80.0 + 900.0 * math.sin(angle)
                middle = np.array(tab.value("[0.5 * plan.width, 0.5 * plan.height]"))
                on_screen = np.array(tab.value(f"plan.screen({place[0]}, {place[1]})"))
                clockwise = up - angle  # from the top of the screen
                expected = middle + 90.0 * np.array([math.sin(clockwise), -math.cos(clockwise)])
                assert on_screen == pytest.approx(expected, abs=0.3)
                back = tab.value(f"plan.world({on_screen[0]}, {on_screen[1]})")
                assert back == pytest.approx(place, abs=0.1)


def test_the_fan_of_an_imaging_sonar_opens_upwards(browser):
    state = live_state()
    source = {"task": "own ship", "level": 0, "message": "", "values": [["source", "none"]]}
    sensor = [["min_range", "1"], ["max_range", "60"], ["azimuth_min", "-1"], ["azimuth_max", "1"]]
    entries = [source, {"task": "sensor parameters", "level": 0, "message": "", "values": sensor}]
    state.put_health({"/n": {"node": "/n", "level": 0, "entries": entries}})
    put(state, 1, confirmed_track(7, 30.0, 10.0), confirmed_track(8, 50.0, 0.0), own_ship=None)
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.until("scene.health.length")
        tab.value("redraw()")
        drawn(tab)
        assert tab.value("byId('orientation').value") == "head"
        (x, y), (ahead, above), (port, _) = (
            tab.value(f"plan.screen({place})") for place in ("0, 0", "50, 0", "30, 10")
        )
        assert ahead == pytest.approx(x, abs=0.5) and above < y and port < x


def test_a_course_keeps_its_meaning_when_odometry_stops(browser):
    state = live_state()
    put(state, 1, confirmed_track(7, 500.0, 0.0, 0.0, 5.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        put(state, 2, confirmed_track(7, 500.0, 0.0, 0.0, 5.0), own_ship=None)
        tab.until("scene.frames.length === 2")
        tab.value("showPanels()")
        assert "Crs000°" not in text(tab, "tracks")  # head and cell are apart
        cells = tab.value("[...document.querySelectorAll('#tracks td')].map((d) => d.textContent)")
        assert cells[4] == "000°" and "Crs" in text(tab, "tracks")
        put(state, 3, own_ship=(0.0, 0.0, 0.5, math.nan, math.nan, 14.0))
        tab.until("scene.frames.length === 3")
        drawn(tab)
        assert text(tab, "own-ship") == "No own ship for 14 s"


def test_past_positions_are_points_at_equal_times(tab):
    with served(live_state(1)) as server:
        tab.open(server.url)
        found = tab.value(
            """equalTimes([0, 7, 13, 40, 46].map((stamp, k) =>
                ({ stamp, order: k < 3 ? k : k + 1, x: 2 * stamp, y: -stamp })), 5)"""
        )
    assert np.array(found) == pytest.approx(np.array([[90, -45], [20, -10], [10, -5]]), abs=1e-9), (
        "none while the track was not published"
    )


def test_bearing_line_and_range_ring_are_dragged_and_move_with_own_ship(browser):
    state = live_state()
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        drawn(tab)
        tab.press("#bearing-line")
        box = tab.value("(({ left, top }) => [left, top])(plan.canvas.getBoundingClientRect())")

        def at(x, y):
            return np.add(tab.value(f"plan.screen({x}, {y})"), box).tolist()

        tab.mouse("mousePressed", *at(100.0, 0.0), button="left", clickCount=1)
        tab.mouse("mouseMoved", *at(300.0, 0.0), button="left", buttons=1)
        tab.mouse("mouseMoved", *at(300.0, 400.0), button="left", buttons=1)
        tab.mouse("mouseReleased", *at(300.0, 400.0), button="left", clickCount=1)
        drawn(tab)
        assert tab.value("plan.cursor.range") == pytest.approx(500.0, rel=0.02)
        words = tab.value("cursorWords({ range: 500, bearing: Math.atan2(4, 3) }, true)")
        assert words == "EBL 037°, VRM 500 m"
        assert tab.value("plan.colour.strong") in colours(tab, 300.0, 400.0)
        put(state, 2, approaching(), own_ship=(500.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        tab.until("scene.frames.length === 2")
        drawn(tab)
        assert tab.value("plan.colour.strong") in colours(tab, 800.0, 400.0)


def test_range_scales_are_steps_in_each_unit(tab):
    with served(live_state(1)) as server:
        tab.open(server.url)
        assert tab.value("rangeScales().slice(0, 7)") == [0.5, 1, 2, 5, 10, 20, 50]
        assert tab.value("rangeScales().at(-1)") == 200_000
        tab.value("byId('units').value = '1'; byId('units').dispatchEvent(new Event('change'))")
        miles = tab.value(f"rangeScales().slice(-11).map((one) => one / {MILE})")
        assert miles == [0.125, 0.25, 0.5, 0.75, 1.5, 3, 6, 12, 24, 48, 96]
        tab.until("scene.frames.length === 1")
        tab.value(f"plan.range = 6 * {MILE}; redraw()")
        drawn(tab)
        assert tab.value("byId('range').selectedOptions[0].textContent") == "Range 6 NM"
        for key, range_ in (("=", 3), ("-", 6), ("-", 12), ("+", 6)):
            tab.key(key)
            assert tab.value(f"plan.range / {MILE}") == pytest.approx(range_)


def test_land_is_drawn_in_its_place(browser):
    state = live_state()
    put(state, 1, approaching())
    bits = "wA=="  # two of 2 x 2 cells: the first row
    state.put_land(
        {"frame_id": "odom", "cell": 100.0, "origin": [200.0, 100.0, 0.0], "width": 2, "bits": bits}
    )
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.until("scene.land && !byId('layer-land').closest('li').hidden")
        tab.value("plan.moved = true; plan.center = [300, 200]; plan.scale = 1; redraw()")
        drawn(tab)
        land = tab.value("plan.colour.land")
        assert land in colours(tab, 250.0, 150.0) and land in colours(tab, 350.0, 120.0)
        assert land not in colours(tab, 250.0, 250.0)


# ---- right as it is read ----


def test_the_axes_of_the_ellipse_are_whole_and_truth_has_one_sign(browser):
    state = live_state()
    put(state, 1, confirmed_track(7, 500.0, 0.0, covariance=np.diag([400.0, 1.0, 900.0, 4.0])))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("select(7)")
        assert "95 % ellipse147 m by 97.9 m" in text(tab, "selected"), "2 x 2.4477 x 30 and 20 m"
        strokes = tab.value(
            """(() => {
                window.calls = [];
                const old = Plan.prototype.drawTarget;
                Plan.prototype.drawTarget = function () { calls.push(this.canvas.id); };
                scene.truth = [[[0, 0, 0], [1e6, 10, 10]]];
                plan.drawTruth(scene.frames[0]);
                plan.drawSign(document.createElement("canvas"), "truth");
                plan.drawSign(document.querySelector("[data-layer=rings]"), "truth");
                Plan.prototype.drawTarget = old;
                return calls;
            })()"""
        )
        assert strokes == ["canvas", ""]


CLICKS = {
    "the plan": "#canvas",
    "a track": "#tracks tbody button",
    "a row": "#tracks tbody td:nth-child(3)",
    "a button": "#theme",
    "a badge": "#state",
    "a box": "#layer-labels",
    "a heading": "#show summary",
    "a menu": "#fading",
    "a number": "#cpa_limit",
}
KEYS = {
    " ": "page.playing",
    "+": "plan.scale",
    "=": "plan.scale",
    "-": "plan.scale",
    "f": "String(plan.fittedBox)",
    "m": "page.tool",
    "b": "page.tool",
    "t": "plan.selected",
    "a": "alarm.acknowledged.seen",
    "Escape": "plan.selected",
    "ArrowUp": "plan.center[1]",
}


@pytest.mark.parametrize("place", CLICKS)
def test_every_key_works_after_every_click(browser, place):
    state = live_state()
    put(state, 1, approaching(7), approaching(8, 2000.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("window.acknowledgement = 0; showPanels()")
        for key, value in KEYS.items():
            before_click = (
                "select(null); plan.moved = true; plan.fittedBox = [0, 0, 1, 1]; page.tool = null;"
                "alarm.acknowledgement = () => ({ seen: Math.random() }); showPanels();"
                f"document.querySelector('{CLICKS[place]}').scrollIntoView({{ block: 'nearest' }})"
            )
            tab.value(before_click)
            x, y = tab.value(
                "(({ left, top, width, height }) =>"
                " [left + width / 2, top + Math.min(height / 2, 300)])"
                f"(document.querySelector('{CLICKS[place]}').getBoundingClientRect())"
            )
            tab.click(x, y)
            if place == "a menu":
                tab.key("Escape")
            if key == "Escape":
                tab.value("select(8)")
            before = tab.value(value)
            tab.key(key, shift=key.startswith("Arrow"))
            drawn(tab)
            assert tab.value(value) != before, (place, key)
        assert tab.complaints == []


def test_steps_by_key_work_after_a_click_and_a_control_reached_by_key_keeps_its_own_keys(browser):
    state = live_state(3)
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.until("scene.frames.length === 3")
        drawn(tab)
        tab.press("#play")
        tab.click(
            *tab.value("((b) => [b.left + 9, b.top + 9])(byId('theme').getBoundingClientRect())")
        )
        for key, index in (("ArrowLeft", 1), ("ArrowLeft", 0), ("ArrowRight", 1)):
            tab.key(key)
            assert tab.value("page.index") == index
        tab.key("Tab")
        tab.value("byId('fading').focus()")
        tab.key("m")
        assert tab.value("page.tool") is None, "a menu looks for a word"
        tab.value("byId('measure').focus()")
        tab.key("m")
        assert tab.value("page.tool") == "measure"


def test_tracks_are_chosen_and_the_plan_is_moved_by_key(browser):
    state = live_state()
    put(state, 1, approaching(7), approaching(8, 2000.0), approaching(9, 500.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("showPanels()")
        chosen = []
        for shift in (False, False, False, False, True, True):
            tab.key("T" if shift else "t", shift=shift)
            chosen.append(tab.value("plan.selected"))
        assert chosen == [9, 7, 8, 9, 8, 7]
        for key, axis, sign in (("ArrowLeft", 0, -1), ("ArrowRight", 0, 1), ("ArrowUp", 1, 1)):
            before = tab.value("plan.center")
            tab.key(key, shift=True)
            assert sign * (tab.value("plan.center")[axis] - before[axis]) > 0


def test_what_is_said_to_a_screen_reader_changes_at_most_every_5_s(browser):
    state = live_state()
    state.put_info(alarm={"cpa_limit": 100.0})
    with served(state) as server:
        put(state, 1, approaching())
        tab = opened(browser, server.url, frozen=False)
        regions = (
            "[...document.querySelectorAll('[role=status], [role=alert], [aria-live], output')]"
        )
        assert tab.value(f"{regions}.map((one) => one.id)") == ["said", "warned"]
        tab.value(
            "window.changes = []; for (const id of ['said', 'warned'])"
            " new MutationObserver(() => changes.push([id, performance.now()]))"
            ".observe(byId(id), { childList: true })"
        )
        for number in range(2, 70):
            tracks = [approaching(k, 1000.0 + number) for k in range(1, 2 + number % 5)]
            put(state, number, *tracks)
            tab.value(f"select({number % 5 + 1}); showPanels()")
        changes = tab.value("changes")
        for region in ("said", "warned"):
            times = [time for name, time in changes if name == region]
            assert all(np.diff(times) >= 5000.0)


def test_the_picture_fills_a_window_that_grew(browser):
    state = live_state()
    put(state, 1, approaching(7), approaching(8, -2000.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.size(900, 700)
        drawn(tab)
        small = tab.value("plan.scale")
        tab.size(1900, 1200)
        tab.until("plan.width > 1200")
        drawn(tab)
        assert tab.value("plan.scale") > 1.5 * small


# ---- access ----


@pytest.mark.skipif(
    not AXE.is_file(), reason="no axe-core: npm install axe-core, or AXE=axe.min.js"
)
@pytest.mark.parametrize("theme", ["light", "dark", "night"])
@pytest.mark.parametrize("size", [(1300, 900), (1920, 1080), (400, 800)])
def test_axe_finds_nothing_serious(browser, tmp_path, theme, size):
    state = live_state()
    state.put_info(alarm={"cpa_limit": 100.0, "lost_targets": True, "guard_max_range": 900.0})
    entry = {"task": "detections", "level": 2, "message": "no scan", "values": [["a", "1"]]}
    good = {"task": "clutter", "level": 0, "message": "fine", "values": [["a", "1"]]}
    state.put_health({"/n": {"node": "/n", "level": 2, "entries": [entry, good]}})
    put(state, 1, approaching(7), approaching(8, 2000.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.size(*size, phone=size[0] == 400)
        tab.value(f"setTheme('{theme}'); select(7); byId('health').open = true; showPanels()")
        drawn(tab)
        tab.call("Page.setBypassCSP", enabled=True)
        tab.value(AXE.read_text(encoding="utf-8") + "; 0")
        found = tab.value(
            "axe.run().then(({ violations }) => violations.map(({ id, impact, nodes }) =>"
            " [id, impact, nodes.map((one) => one.html + (one.any[0] || {}).message)]))"
        )
    assert [one for one in found if one[1] in ("serious", "critical")] == []


def test_a_recording_has_its_alarms_in_the_page_alone(tab, tmp_path):
    frames = [numbered(k, approaching(7, 1000.0 - 96.0 * k), own_ship=SHIP) for k in range(1, 4)]
    recording = {"all": True, "frames": frames, "facts": {}, "health": [], "truth": []}
    recording["info"] = {"kind": "recording", "title": "sea", "north": True}
    path = tmp_path / "page.html"
    write_page(path, "sea", json.dumps(recording))
    tab.open(path.as_uri())
    tab.until("scene.frames.length === 3")
    tab.value(
        "show(2); const field = byId('cpa_limit'); field.value = 60;"
        "field.dispatchEvent(new Event('change'))"
    )
    drawn(tab)
    assert text(tab, "alarm-words").startswith("Closest approach: track 7, 50.0 m")
    tab.press("#acknowledge")
    assert text(tab, "alarm-words") == ""
    assert text(tab, "state") == "Recording"
    assert tab.complaints == []
