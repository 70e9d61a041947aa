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
import time
from pathlib import Path

import numpy as np
import pytest
from support.browser import Browser, Tab, need_browser
from support.pages import confirmed_track, live_state, numbered, served

from tsepm_ros.parameters import parameter_table
from tsepm_ros.settings.node_options import AlarmOptions
from tsepm_ros.tools.viewer import page_server
from tsepm_ros.tools.viewer.alarms import KINDS
from tsepm_ros.tools.viewer.page_state import PageState
from tsepm_ros.tracker.tracks import TrackStatus

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


def alarm(key: str, state: str = "unacknowledged", sentence: str = "", **more) -> dict:
    """An alarm as the node says it."""
    kind = key.partition(" ")[0]
    return {
        "key": key,
        "title": KINDS[kind],
        "state": state,
        "sounds": state in ("unacknowledged", "rectified"),
        "sentence": sentence,
        "onset": sentence,
        "time": 1.8e9,
        "count": 1,
        "places": {},
        **more,
    }


def put_alarms(state: PageState, *alarms: dict, **more) -> None:
    part = {"watched": "CPA 500 m", "patience": 5.0, "run": 1, "gates": []}
    state.put_part("alarms", {"alarms": list(alarms), **part, **more})


COUNTED_SOUNDS = """window.sounds = 0; window.sound = () => { sounds += 1; };
    window.AudioContext = class { state = "running"; resume() {} };"""
CPA = alarm(
    "cpa 7", sentence="track 7, 982 ± 120 m in 50 s", onset="track 7, 480 ± 60 m in 95 s", count=2
)


def remembering(state: PageState) -> list:
    """What browsers ask for; limits are set as the node does it."""
    asked: list = []
    known = {row.name: row.default for row in parameter_table(AlarmOptions)}
    state.put_info(alarm=dict(known))

    def take(content):
        asked.append(content)
        known.update(content.get("alarm", {}))
        state.put_info(alarm=dict(known))

    state.asked = take
    return asked


def opened(browser: Browser, url: str, *, frozen: bool = True) -> Tab:
    """A page with its first frames, whose time stands still: a busy machine makes no data stale."""
    tab = browser.tab(1300, 900)
    tab.open(url)
    tab.until("scene.frames.length > 0 && page.connected")
    if frozen:
        freeze(tab)
    return tab


def freeze(tab: Tab) -> None:
    tab.value(f"{frozen_now()} showPanels()")


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
    put_alarms(state, patience=5.0)
    put(state, 1, approaching())
    put(state, 2, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        later(tab, 4.0)
        assert text(tab, "state") == "Live"
        assert text(tab, "alarm-chip") == "Alarm on: CPA 500 m"
        tab.value("select(7)")
        later(tab, 27.2)
        assert text(tab, "state") == "No data for 31 s"
        assert tab.value("byId('state').className") == "chip error"
        assert text(tab, "alarm-chip") == "Cannot alarm: no data"
        muted, track = tab.value("[plan.colour.muted, plan.colour.track]")
        found = colours(tab, 1000.0, 50.0)
        assert track not in found and muted in found
        cells = "[...document.querySelectorAll('#tracks td')].map((one) => one.textContent)"
        assert tab.value(cells)[5:] == ["50.0 m", "94 s"], "of 125 s"
        assert "Last detection31 s ago" in text(tab, "selected")
        assert "no data" in text(tab, "selected")
        come(tab, state, 3, approaching())
        assert text(tab, "state") == "Live"
        assert muted not in colours(tab, 1000.0, 50.0)


def test_the_page_waits_as_long_as_the_node_says(browser):
    state = live_state()
    put_alarms(state, patience=36.0)
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        later(tab, 30.0)
        assert text(tab, "state") == "Live"
        later(tab, 10.0)
        assert text(tab, "state") == "No data for 40 s"


def test_old_data_is_said_and_times_count_from_now(browser):
    state = live_state()
    put_alarms(state, alarm("age", sentence="stamps are 20 s old, or the clocks differ"))
    frame = numbered(1, approaching(x=240.0), own_ship=SHIP)
    state.put(frame | {"age": 20_000})
    with served(state) as server:
        tab = opened(browser, server.url)
        assert text(tab, "state") == "Old data"
        assert "Old data: stamps are 20 s old, or the clocks differ" in text(tab, "alarm-words")
        cells = "[...document.querySelectorAll('#tracks td')].map((one) => one.textContent)"
        assert tab.value(cells)[6] == "10.0 s", "of 30 s, 20 s late"


def test_a_page_that_is_loaded_after_the_data_has_stopped_says_so_at_once(browser):
    state = live_state()
    put(state, 1, approaching(), age=31.5)
    with served(state) as server:
        tab = opened(browser, server.url, frozen=False)
        tab.until("byId('state').textContent.startsWith('No data for 3') && plan.stale")
        tab.reload()
        tab.until("byId('state').textContent.startsWith('No data for 3')")


def test_a_viewer_that_does_not_answer_is_an_alarm_of_the_page_until_it_is_back(browser):
    state = live_state(2)
    with served(state) as server:
        port = int(server.url.rpartition(":")[2].strip("/"))
        tab = opened(browser, server.url)
    tab.until("!page.connected")
    tab.value(f"{COUNTED_SOUNDS} byId('sound').click()")
    later(tab, 60.0)
    assert text(tab, "state") == "No data for 60 s"
    assert "Not connected: the viewer does not answer" in text(tab, "alarm-words")
    tab.until("sounds >= 2")
    tab.press("#silence")
    assert "silenced" in text(tab, "alarm-words")
    tab.value("delete performance.now")
    with served(live_state(3), port=port):
        tab.until("page.connected && byId('state').textContent === 'Live'")
        assert tab.value("byId('alarm').hidden")
        tab.value("select(7)")
        assert not tab.value("byId('selected').hidden")
    with served(live_state(0), port=port):
        tab.until("page.connected && byId('state').textContent === 'Waiting'")
        assert tab.value("byId('selected').hidden"), "nothing is known of it"


def test_a_viewer_whose_machine_is_gone_without_a_word_is_given_up(browser, monkeypatch):
    monkeypatch.setattr(page_server, "SIGN_OF_LIFE", 600.0)
    with served(live_state(2)) as server:
        tab = opened(browser, server.url, frozen=False)
        tab.value("window.first = page.socket")
        tab.until("!page.connected && page.unheard > 0")
        tab.until("page.connected && page.socket !== first && !page.unheard")


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


def test_limits_are_those_of_every_browser_and_acknowledgements_go_to_the_node(browser):
    state = live_state()
    asked = remembering(state)
    put(state, 1, approaching())
    put_alarms(state, CPA, alarm("lost 5", sentence="track 5, 1000 m, 037°T"))
    with served(state) as server:
        one, other = opened(browser, server.url), opened(browser, server.url)
        one.value(
            "byId('cpa_limit').value = 60; byId('cpa_limit').dispatchEvent(new Event('change'))"
        )
        for tab in (one, other):
            tab.until("page.limits.cpa_limit === 60 && byId('cpa_limit').value === '60'")
        other.press("#acknowledge")
        one.press("#silence")
        one.until("true")
        assert asked[0] == {"alarm": {"cpa_limit": 60}}
        for wanted in ({"acknowledge": {"cpa 7": 2, "lost 5": 1}}, {"silence": True}):
            end = time.monotonic() + 5.0
            while wanted not in asked and time.monotonic() < end:
                time.sleep(0.02)
            assert wanted in asked


def test_each_state_has_its_words_and_look_and_the_value_at_the_alarm_stands_beside_that_now(
    browser,
):
    state = live_state()
    put(state, 1, approaching())
    put_alarms(state, CPA)
    with served(state) as server:
        tab = opened(browser, server.url)
        words = (
            "Closest approach: track 7, 982 m ± 120 m in 50 s; at the alarm 480 m ± 60.0 m in 95 s,"
            " 2 times since 08:00:00 UTC"
        )
        assert text(tab, "alarm-words") == f"ALARM{words}"
        error = tab.value("plan.colour.error")
        drawn(tab)
        assert error in colours(tab, 1000.0, 50.0, 12)
        assert text(tab, "alarm-chip") == "1 alarm not acknowledged"
        looks = []
        for name, said in (
            ("unacknowledged", "ALARM"),
            ("silenced", "ALARM, silenced"),
            ("acknowledged", "acknowledged"),
            ("rectified", "over, not acknowledged"),
        ):
            put_alarms(state, CPA | {"state": name, "sounds": name == "unacknowledged"})
            tab.until(f"Boolean(document.querySelector('#alarm-words .{name}'))")
            tab.value("showPanels()")
            assert tab.value("document.querySelector('#alarm-words b').textContent") == said
            style = "getComputedStyle(document.querySelector('#alarm-words b'))"
            looks.append(tab.value(f"[{style}.borderStyle, {style}.animationName].join(' ')"))
            assert tab.value("byId('silence').hidden") == (name != "unacknowledged")
            assert tab.value("byId('acknowledge').hidden") == (name == "acknowledged")
        assert len(set(looks)) == 4
        assert "had been track 7" in text(tab, "alarm-words")
        tab.value("redraw()")
        drawn(tab)
        assert error not in colours(tab, 1000.0, 50.0, 12), "over"


def test_the_badge_names_what_is_on_and_why_nothing_can_come(browser):
    state = live_state()
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        for alarms, watched, said in (
            ([], "lost targets", ["Alarm on: lost targets", "chip ok"]),
            ([], "CPA 500 m, guard zone", ["Alarm on: CPA 500 m, guard zone", "chip ok"]),
            ([], "data alone", ["Alarm on: data alone", "chip stale"]),
            ([], "", ["Cannot alarm: the viewer holds none", "chip error"]),
            (["cpa 7", "cpa 8"], "", ["2 alarms not acknowledged", "chip error"]),
            (["limits"], "", ["Limits lost", "chip error"]),
            (["watch"], "", ["Cannot alarm: no own ship", "chip error"]),
        ):
            put_alarms(
                state, *(alarm(key, sentence="no own ship") for key in alarms), watched=watched
            )
            tab.until(f"scene.alarms.watched === {json.dumps(watched)}")
            tab.until(f"scene.alarms.alarms.length === {len(alarms)}")
            assert text(tab, "alarm-chip") == said[0]
            assert tab.value("byId('alarm-chip').className") == said[1]
        tab.value("byId('approach').open = false")
        tab.press("#alarm-chip")
        assert tab.value("byId('approach').open && document.activeElement.id") == "cpa_limit"


def test_of_many_alarms_three_are_said_and_all_on_demand(browser):
    state = live_state()
    put(state, 1, approaching())
    put_alarms(state, *(alarm(f"cpa {k}", sentence=f"track {k}") for k in range(8)))
    with served(state) as server:
        tab = opened(browser, server.url)
        count = "document.querySelectorAll('#alarm-words li').length"
        assert tab.value(count) == 4 and text(tab, "alarm-words").endswith("5 more")
        tab.press("#more-alarms")
        assert tab.value(count) == 9 and text(tab, "alarm-words").endswith("Show less")


def test_lost_tracks_have_a_sign_with_words_that_cover_none_other_and_ids_are_of_a_run(browser):
    state = live_state()
    put(state, 1, confirmed_track(5, -500.0, 0.0), approaching())
    places = {"5": [600.0, 30.0], "6": [602.0, 32.0], "9": [604.0, 28.0]}
    put_alarms(state, alarm("lost when data stopped", places=places), alarm("zone 5"), run=2)
    with served(state) as server:
        tab = opened(browser, server.url)
        drawn(tab)
        error = tab.value("plan.colour.error")
        assert error in colours(tab, 600.0, 30.0, 12)
        assert error not in colours(tab, -500.0, 0.0, 14), "the 5 of now is another"
        boxes = tab.value(
            """(() => {
                const boxes = [], old = plan.text;
                plan.text = function (words, x, y) {
                    const width = this.context.measureText(words).width;
                    if (/lost/.test(words)) boxes.push([x, y - 8, x + width, y + 8]);
                    old.call(this, words, x, y);
                };
                plan.draw(0);
                plan.text = old;
                return boxes;
            })()"""
        )
        assert 1 <= len(boxes) <= 3
        for k, one in enumerate(boxes):
            for other in boxes[k + 1 :]:
                assert (
                    one[0] >= other[2]
                    or other[0] >= one[2]
                    or one[1] >= other[3]
                    or other[1] >= one[3]
                )
        put_alarms(state, alarm("zone 5 (run 2)"), run=2)
        tab.until("scene.alarms.alarms[0].key === 'zone 5 (run 2)'")
        tab.value("redraw()")
        drawn(tab)
        assert error in colours(tab, -500.0, 0.0, 14)
        assert error not in colours(tab, 600.0, 30.0, 12)


def test_a_sector_is_written_clockwise_from_the_bow_and_the_zone_is_drawn(browser):
    state = live_state()
    remembering(state)
    ship = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
    put(state, 1, confirmed_track(7, 3000.0, 0.0), own_ship=ship)
    with served(state) as server:
        tab = opened(browser, server.url)
        for name, value in (("guard_max_range", 1000), ("guard_from", 330), ("guard_to", 45)):
            tab.value(
                f"byId('{name}').value = {value}; byId('{name}').dispatchEvent(new Event('change'))"
            )
            tab.until(f"Number(byId('{name}').value) === {value} && page.limits.guard_max_range")
        tab.until("Math.abs(page.limits.guard_azimuth_min + Math.PI / 4) < 1e-6")
        for value in ("", "-5"):  # a browser gives a number that it cannot read as empty
            tab.value(
                f"byId('guard_max_range').value = '{value}';"
                "byId('guard_max_range').dispatchEvent(new Event('change'))"
            )
            assert tab.value("byId('guard_max_range').value") == "1000", "as it is"
        limits = tab.value("[page.limits.guard_azimuth_min, page.limits.guard_azimuth_max]")
        assert limits == pytest.approx(np.deg2rad([-45.0, 30.0]))
        drawn(tab)
        x, y = 1000.0 * math.cos(0.5 + 0.2), 1000.0 * math.sin(0.5 + 0.2)
        assert tab.value("plan.colour.error") not in colours(tab, -x, -y, 20)
        assert len(colours(tab, x, y, 20) - colours(tab, -x, -y, 20)) > 3, "its edge"


def test_without_north_bearings_are_relative_and_with_a_heading_one_chooses(browser):
    state = live_state()
    source = {"task": "own ship", "level": 0, "message": "", "values": [["source", "none"]]}
    state.put_health({"/n": {"node": "/n", "level": 0, "entries": [source]}})
    x, y = 500.0 * math.cos(math.radians(18.0)), -500.0 * math.sin(math.radians(18.0))
    put(state, 1, confirmed_track(7, x, y, 1.0, 0.0), own_ship=None)
    cells = "[...document.querySelectorAll('#tracks th, #tracks td')].map((d) => d.textContent)"
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.until("scene.health.length")
        tab.value("showPanels()")
        shown = tab.value(cells)
        assert (shown[2], shown[9], shown[11]) == ("Rel", "018°", "000°")
        drawn(tab)
        assert tab.value("[byId('bearings').value, byId('bearings').disabled]") == ["1", True]
    state = live_state()
    put(state, 1, confirmed_track(7, 0.0, 500.0, 1.0, 0.0), own_ship=(0.0, 0.0, 1.0, 1.0, 0.0, 0.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        shown = tab.value(cells)
        assert (shown[2], shown[9], shown[11]) == ("Brg", "000°", "090°")
        tab.value(
            "byId('bearings').value = '1'; byId('bearings').dispatchEvent(new Event('change'))"
        )
        shown = tab.value(cells)
        bow = round(math.degrees(1.0))  # 033 true
        assert (shown[2], shown[9], shown[11]) == ("Rel", f"{360 + bow - 90}°", f"0{bow}°")
        tab.value(
            "byId('bearings').value = ''; byId('bearings').dispatchEvent(new Event('change'))"
        )


def test_a_sound_that_needs_a_click_is_said_in_red_until_it_can_come(browser):
    state = live_state()
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("showPanels()")
        assert tab.value("byId('sound-chip').hidden"), "the sound is off"
        tab.value(
            """window.AudioContext = class {
                state = "suspended";
                resume() { if (window.clicked) { this.state = "running"; this.onstatechange(); } }
            }; window.sounds = 0; window.sound = () => { sounds += 1; };
            page.audio = null; byId('sound').checked = true; startSound(); showPanels()"""
        )
        assert not tab.value("byId('sound-chip').hidden")
        assert text(tab, "sound-chip") == "No sound: click here"
        tab.value("scene.alarms = { ...scene.alarms, alarms: [{ sounds: true }] }; soundAlarms()")
        assert tab.value("sounds") == 0, "all would be heard at once after the click"
        tab.value("scene.alarms = { ...scene.alarms, alarms: [] }")
        tab.value("window.clicked = true")
        tab.press("#sound-chip")
        tab.until("byId('sound-chip').hidden")


def test_what_stands_still_has_a_shape_and_words_and_can_be_hidden(browser):
    state = live_state()
    still = confirmed_track(9, -900.0, -900.0, 0.0, 0.0, status=TrackStatus.STANDS_STILL)
    coasting = confirmed_track(8, -500.0, -300.0, 3.0, 0.0, status=TrackStatus.COASTING)
    put(state, 1, approaching(), still, coasting)
    with served(state) as server:
        tab = opened(browser, server.url)
        drawn(tab)
        assert text(tab, "tracks-title") == "Tracks (1, 1 coasting, 1 standing still)"
        rows = (
            "[...document.querySelectorAll('#tracks tbody tr')].map((r) => r.cells[0].textContent)"
        )
        assert sorted(tab.value(rows)) == ["7", "8coasting", "9stands still"]
        tab.value(
            "window.said = []; const old = plan.text; plan.text = function (words, ...at) {"
            " said.push(words); old.call(this, words, ...at); }; redraw()"
        )
        drawn(tab)
        assert {"9  stands still", "8  coasting"} <= set(tab.value("said"))
        fixed = tab.value("plan.colour.fixed")
        assert fixed in colours(tab, -900.0, -900.0)
        tab.press("#layer-fixed")
        drawn(tab)
        assert fixed not in colours(tab, -900.0, -900.0)
        assert sorted(tab.value(rows)) == ["7", "8coasting"]
        assert text(tab, "tracks-title") == "Tracks (1, 1 coasting, 1 standing still)"


def test_a_gate_is_drawn_by_hand_and_its_counts_are_shown(browser):
    state = live_state()
    asked = remembering(state)
    put(state, 1, approaching(), confirmed_track(8, -1000.0, -500.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        drawn(tab)
        tab.press("#draw-gate")
        box = tab.value("(({ left, top }) => [left, top])(plan.canvas.getBoundingClientRect())")
        ends = [
            np.add(tab.value(f"plan.screen({x}, {y})"), box).tolist()
            for x, y in ((-200.0, -300.0), (300.0, -300.0))
        ]
        tab.mouse("mousePressed", *ends[0], button="left", clickCount=1)
        tab.mouse("mouseMoved", *ends[1], button="left", buttons=1)
        tab.mouse("mouseReleased", *ends[1], button="left", clickCount=1)
        tab.until("(page.limits.gates || '').length > 0")
        line = [float(value) for value in asked[-1]["alarm"]["gates"].split(",")]
        assert line == pytest.approx([-200.0, -300.0, 300.0, -300.0], abs=5.0)
        assert tab.value("page.tool") is None
        put_alarms(state, gates=[[[10.125, *line[1:]], [6, 4]]])
        tab.until("scene.alarms.gates.length")
        tab.value("addGate([[0, 0], [1 / 3, 1]])")
        tab.until("page.limits.gates.includes(';')")
        old, new = asked[-1]["alarm"]["gates"].split(";")
        assert list(map(float, old.split(","))) == [10.125, *line[1:]], "whose counts stay"
        assert new == "0.00,0.00,0.33,1.00"
        assert text(tab, "gate-counts") == "Gate 1: 6 to the left, 4 to the right"
        tab.value("redraw()")
        drawn(tab)
        assert tab.value("plan.colour.strong") in colours(tab, 50.0, -300.0)
        tab.press("#remove-gates")
        tab.until("page.limits.gates === ''")


def test_at_twice_the_zoom_the_plan_keeps_its_height_and_the_controls_fold(browser):
    state = live_state()
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.size(650, 450)
        drawn(tab)
        assert tab.value("plan.height") >= 330
        shown = "getComputedStyle(byId('bar')).display !== 'none'"
        assert not tab.value(shown)
        tab.press("#view")
        assert tab.value(shown)


def test_the_sound_repeats_until_the_alarm_is_acknowledged(browser):
    state = live_state()
    put_alarms(state, CPA)
    put(state, 1, approaching())
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value(f"{COUNTED_SOUNDS} byId('sound').click()")
        tab.until("sounds >= 3")
        put_alarms(state, CPA | {"state": "acknowledged", "sounds": False})
        tab.until("scene.alarms.alarms[0].state === 'acknowledged'")
        count = tab.value("sounds")
        tab.value("new Promise((done) => setTimeout(done, SOUND_PERIOD + 200))")
        assert tab.value("sounds") == count
        tab.reload()
        assert tab.value("byId('sound').checked"), "kept"


def test_an_alarm_that_the_node_refuses_is_said(browser):
    state = live_state(1)
    remembering(state)
    state.put_info(refused="alarm.guard_min_range must be below")
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
                        plan.relative = true;
                        return [rangeAndBearing(ship, [x, y], Math.PI / 2), speedWords(vx, vy),
                            direction(vx, vy, Math.PI / 2),
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
                assert said[3:] == pytest.approx([vx - sx, vy - sy, vx, vy])


def meters(words: str) -> float:
    number, unit = words.split()
    return float(number) * {"m": 1.0, "km": 1e3, "NM": MILE}[unit]


def turned(words: str, x: float, y: float) -> float:
    """Degrees between a course as it is said and a vector, clockwise from north."""
    return abs((float(words.rstrip("°")) - math.degrees(math.atan2(x, y)) + 180.0) % 360.0 - 180.0)


def test_the_units_are_one_switch_and_are_kept(browser):
    state = live_state()
    remembering(state)
    state.asked({"alarm": {"cpa_limit": 926.0}})
    put_alarms(state, watched="CPA 926 m")
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
        words = tab.value("cursorWords({ range: 500, bearing: Math.atan2(4, 3) }, Math.PI / 2)")
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
    state.put_part(
        "land",
        {
            "frame_id": "odom",
            "cell": 100.0,
            "origin": [200.0, 100.0, 0.0],
            "width": 2,
            "bits": bits,
        },
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
    "a": "asked",
    "Escape": "plan.selected",
    "ArrowUp": "plan.center[1]",
}


@pytest.mark.parametrize("place", CLICKS)
def test_every_key_works_after_every_click(browser, place):
    state = live_state()
    put(state, 1, approaching(7), approaching(8, 2000.0))
    with served(state) as server:
        tab = opened(browser, server.url)
        tab.value("window.asked = 0; window.ask = () => { asked += 1; }; showPanels()")
        for key, value in KEYS.items():
            before_click = (
                "select(null); plan.moved = true; plan.fittedBox = [0, 0, 1, 1]; page.tool = null;"
                "showPanels();"
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
    put_alarms(state, CPA)
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
    remembering(state)
    put_alarms(state, CPA, alarm("age", "acknowledged", "old"), gates=[[[0, 0, 90, 90], [6, 4]]])
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
