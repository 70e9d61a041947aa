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
"""The page in a real browser: what it shows, and what a user does."""

from __future__ import annotations

import json
import re
from urllib.parse import urlsplit

import numpy as np
import pytest
from support.browser import Tab, need_browser
from support.pages import confirmed_track, live_state, numbered, put_moving, served

from tsepm_ros.tools.viewer.page_content import page_image_frame, page_track_facts
from tsepm_ros.tools.viewer.page_files import write_page

need_browser()

SCANS = 12
EVIL = "<img src=x onerror=\"document.title='run'\"> sea"


@pytest.fixture
def tab(browser) -> Tab:
    return browser.tab()


def recording() -> str:
    """Track 3 moves east from scan 4 on, track 5 is held in scans 2 to 6."""
    frames = []
    corners = np.array([[-3000.0, -3000.0], [3000.0, 3000.0]])
    for number in range(1, SCANS + 1):
        tracks = [confirmed_track(3, 100.0 * number, 0.0, 8.0, 0.0)] if number >= 4 else []
        tracks += [confirmed_track(5, -2000.0, -1000.0, 0.0, -2.0)] if 2 <= number <= 6 else []
        frames.append(numbered(number, *tracks, detections=corners, own_ship=(0.0, 500.0, 1.57)))
        frames[-1]["potential"] = [[50_000, 150_000, 1000, 2000, 70], [70_000, 90_000, 0, 0, None]]
        frames[-1]["fixed"] = [[80, 100_000, -150_000, 0, 0, 1000, 1000, 0, 100]]
    hits = [[[12.0, 100.0, 5.0], [24.0, 200.0, -5.0], [48.0, 400.0, 0.0]]]
    facts = page_track_facts(
        [confirmed_track(3, 0.0, 0.0)], 48.0, reasons=["3 hits in 4 pings by the test"], hits=hits
    )
    facts["5"] = {"ended": [84.0, "its target was missed too often"]}
    entry = {"task": "detections", "level": 1, "message": EVIL, "values": [["scans", "12"]]}
    return json.dumps(
        {
            "all": True,
            "frames": frames,
            "facts": facts,
            "health": [{"node": "", "level": 1, "entries": [entry]}],
            "info": {"kind": "recording", "title": EVIL, "north": True},
            "truth": [[[12.0, 100.0, 40.0], [144.0, 1200.0, 40.0]]],
        }
    )


@pytest.fixture
def replay(tab, tmp_path) -> Tab:
    path = tmp_path / "page.html"
    write_page(path, EVIL, recording())
    tab.open(path.as_uri())
    tab.until("scene.frames.length > 0 && byId('clock').textContent")
    tab.value("move(scene.frames.length)")  # pauses at the end
    settled(tab)
    return tab


def text(tab: Tab, selector: str) -> str:
    return tab.value(f"document.querySelector({json.dumps(selector)}).textContent")


def settled(tab: Tab) -> None:
    """Wait until what was asked for is drawn."""
    tab.value(
        "redraw(); new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )


def place(tab: Tab, x: float, y: float) -> list[float]:
    """Where a point of the plan is on the screen."""
    return tab.value(
        f"""(() => {{
            const box = plan.canvas.getBoundingClientRect();
            const at = plan.screen({x}, {y});
            return [at[0] + box.left, at[1] + box.top];
        }})()"""
    )


def colours(tab: Tab, x: float, y: float, half: int = 9) -> set[str]:
    """Colours of the plan around a point of it."""
    return set(
        tab.value(
            f"""(() => {{
                const [x, y] = plan.screen({x}, {y}).map((value) => Math.round(value) - {half});
                const {{ data }} = plan.context.getImageData(x, y, {2 * half}, {2 * half});
                const found = new Set();
                for (let i = 0; i < data.length; i += 4) {{
                    const parts = [...data.slice(i, i + 3)];
                    found.add("#" + parts.map((v) => v.toString(16).padStart(2, "0")).join(""));
                }}
                return [...found];
            }})()"""
        )
    )


def test_the_file_needs_nothing_complains_of_nothing_and_its_text_never_becomes_markup(replay):
    assert replay.complaints == []
    asked = [url for url in replay.requests if not url.startswith("data:")]
    assert len(asked) == 1 and asked[0].startswith("file:"), "the page itself"
    assert text(replay, "#title") == EVIL
    assert EVIL in text(replay, "#entries")
    assert replay.value("document.title") == EVIL
    assert replay.value("document.querySelectorAll('img').length") == 0


def test_without_own_ship_data_it_is_said_why_and_at_the_origin_if_it_does_not_move(replay):
    said = replay.value(
        """(() => {
            const says = (source, message) => {
                const values = [["source", source]];
                const entry = { task: "own ship", level: 0, message, values };
                scene.health = [{ node: "", level: 0, entries: [entry] }];
                return [noOwnShip({ own_ship: null }), scene.ownShip({ own_ship: null })];
            };
            return [...says("tf", "own-ship data from tf"), ...says("none", "not needed"),
                noOwnShip({ own_ship: [0, 0, 0] })];
        })()"""
    )
    assert said == [
        *("No own ship is drawn: this page does not read tf", None),
        *("", [0, 0, 0, 0, 0]),
        "",
    ]


def test_the_slider_goes_back(replay):
    assert text(replay, "#clock") == "144.0 s · scan 12 of 12"
    assert replay.value("byId('slider').max") == str(SCANS - 1)
    replay.value("byId('slider').value = 1; byId('slider').dispatchEvent(new Event('input'))")
    settled(replay)
    assert text(replay, "#clock") == "24.0 s · scan 2 of 12"
    replay.until("byId('tracks-title').textContent === 'Tracks (1, 1 standing still)'")
    assert text(replay, "#tracks tbody td") == "5"


def test_play_runs_from_the_beginning_to_the_end(replay):
    replay.value(
        "seen = []; new MutationObserver(() => seen.push([page.index, byId('play').textContent]))"
        ".observe(byId('clock'), {childList: true}); byId('speed').value = 30"
    )
    replay.press("#play")
    replay.until("!page.playing && byId('play').textContent === 'Play'")
    assert text(replay, "#clock") == "144.0 s · scan 12 of 12"
    seen = replay.value("seen")
    assert {index for index, _ in seen} == set(range(SCANS))
    indices = [index for index, _ in seen]
    begin = indices.index(0)  # before, the page may have shown the end once more
    assert indices[begin:] == sorted(indices[begin:])
    assert "Pause" in {words for _, words in seen}


def test_keys_step_and_pause(replay):
    for key in ("ArrowLeft", "ArrowLeft", "ArrowRight"):
        replay.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    settled(replay)
    assert text(replay, "#clock") == "132.0 s · scan 11 of 12"
    replay.call("Input.dispatchKeyEvent", type="keyDown", key=" ")
    assert replay.value("page.playing")


def test_each_thing_is_drawn_in_its_place_and_colour_and_layers_can_be_hidden(replay):
    named = replay.value("plan.colour")
    assert named["track"] in colours(replay, 1200.0, 0.0)
    assert named["ship"] in colours(replay, 0.0, 500.0)
    assert named["detection"] not in colours(replay, -2500.0, 2500.0)
    assert named["truth"] in colours(replay, 1200.0, 40.0)
    assert named["fixed"] in colours(replay, 1000.0, -1500.0)
    assert named["track"] not in colours(replay, -2000.0, -1000.0), "track 5 has ended"
    without = colours(replay, 500.0, 1500.0)
    replay.press("#layer-potential")
    settled(replay)
    assert without < colours(replay, 500.0, 1500.0), "potential tracks are off at first"
    track = replay.value("plan.colour.track")
    for layer in ("trails", "ellipses", "labels", "tracks"):
        assert track in colours(replay, 1200.0, 0.0)
        replay.press(f"#layer-{layer}")
        settled(replay)
    assert track not in colours(replay, 1200.0, 0.0, 30)


def test_the_sonar_image_is_drawn_from_the_sensor_once_it_is_switched_on(replay):
    levels = np.full((64, 64), -1, np.int8)
    levels[40:44, 40:44] = 100  # ahead and to port
    image = page_image_frame(24.0, 50.0, levels.tobytes())
    replay.value(f"scene.merge({{ images: [{json.dumps(image)}] }}); showPanels()")
    # Own ship heads north: ahead and to port is north-west.
    where = -0.5 * (8 + 12) * 50.0, 500.0 + 0.5 * (8 + 12) * 50.0
    replay.value("scene.frames.at(-1).stamp = 30; redraw()")
    before = colours(replay, *where)
    replay.press("#layer-image")
    settled(replay)
    assert colours(replay, *where) - before
    assert replay.value("scene.image(scene.frames.at(-1)).heading") == pytest.approx(1.57, abs=0.01)


def test_a_click_on_a_track_shows_its_history_and_reason(replay):
    replay.click(*place(replay, 1200.0, 0.0))
    replay.until("!byId('selected').hidden")
    shown = text(replay, "#selected")
    assert "Track 3" in shown and "confirmed" in shown
    assert "Confirmed at 48.0 s: 3 hits in 4 pings by the test." in shown
    assert "Speed8.0 ± 1.0 m/s" in shown and "Course090°" in shown
    assert "Range1.30 km" in shown and "Bearing113°" in shown
    assert replay.value("document.querySelectorAll('#selected tbody tr').length") == 3
    settled(replay)
    assert replay.value("plan.colour.accent") in colours(replay, 100.0, 5.0), "its first hit"
    long = "Array.from({ length: 130000 }, (_, stamp) => ({ stamp, vx: 1, vy: 0 }))"
    replay.value(f"selectedPanel.drawGraph({long})")
    assert "0 to 1 m/s" in text(replay, "#selected h3"), "of hours at ten pings a second"
    replay.click(*place(replay, -2500.0, 2500.0))
    replay.until("byId('selected').hidden")


def test_a_track_without_a_detection_is_dashed_and_says_for_how_long(replay):
    replay.click(*place(replay, 1200.0, 0.0))
    replay.until("!byId('selected').hidden")
    assert "Track 3confirmed" in text(replay, "#selected")
    replay.value(
        "window.dashes = []; const set = plan.context.setLineDash;"
        "plan.context.setLineDash = function (d) { dashes.push(String(d)); set.call(this, d); };"
        "scene.frames[page.index].tracks[0][Row.SINCE_HIT] = 3; redraw(); showPanels()"
    )
    settled(replay)
    assert "Last detection3.0 s ago" in text(replay, "#selected")
    title = replay.value("document.querySelector('#tracks tbody tr').title")
    assert title == "no detection for 3.0 s"
    assert not replay.value("document.querySelector('#selected .chip').classList.contains('ok')")
    assert "5,4" in replay.value("dashes.join(' ')"), "the truth has other dashes"


def test_a_track_that_coasts_is_a_hollow_triangle_counted_apart_and_no_part_of_the_view(replay):
    named = "plan.colour.track"
    for layer in ("trails", "labels"):
        replay.press(f"#layer-{layer}")
    settled(replay)
    assert replay.value(named) in colours(replay, 1200.0, 0.0, 2)
    box = replay.value("scene.bounds(scene.frames)")
    replay.value(
        "const row = scene.frames[page.index].tracks[0];"
        "row[Row.STATUS] = COASTING; row[Row.EXISTENCE] = 0.031;"
        "scene.take({ ...scene.frames.pop() }); select(3); show(scene.frames.length - 1)"
    )
    settled(replay)
    assert replay.value(named) not in colours(replay, 1200.0, 0.0, 2)
    assert replay.value(named) in colours(replay, 1200.0, 0.0, 9)
    assert text(replay, "#tracks-title") == "Tracks (0, 1 coasting, 1 standing still)"
    label = replay.value("plan.canvas.getAttribute('aria-label')")
    assert label.startswith("Plan position: 0 tracks, 1 coasting, 1 standing still, ")
    assert replay.value("document.querySelectorAll('#tracks tr.coasting').length") == 1
    assert "Track 3coasting" in text(replay, "#selected")
    assert "Exists with3 %" in text(replay, "#selected")
    assert replay.value("tracksAsCsv(scene, 12)").splitlines()[-1].endswith(",coasting")
    replay.value("scene.frames.at(-1).tracks[0][Row.X] = 1e6")
    assert replay.value("scene.bounds(scene.frames)") == box


def test_a_trail_is_dashed_where_the_track_was_missed_and_broken_where_it_was_not_published(replay):
    replay.value(
        "scene.histories.get(3)[2].missed = true; scene.histories.get(3).splice(4, 1);"
        "window.parts = []; const { context } = plan;"
        "for (const name of ['lineTo', 'moveTo', 'setLineDash']) {"
        " const old = context[name]; context[name] = function (...given) {"
        " parts.push(name[0]); old.apply(this, given); }; }"
        "plan.drawTrail(scene.frames.at(-1), scene.frames.at(-1).tracks[0], new Map([[3, '#000']]))"
    )
    # Nine scans from the fourth on: two detected, a missed one, one detected, none, four.
    assert "".join(replay.value("parts")) == "s" + "mlmlmlll" + "s" + "mmlmmmmm" + "s"


def test_a_tank_is_shown_to_the_centimetre(replay):
    assert replay.value("[digits(0.034), digits(-3.21), digits(42.16), digits(-4213.7)]") == [
        *("0.03", "-3.21", "42.2", "-4214")
    ]
    assert replay.value("[speed(0.03, 0.04), speed(3, 4)]") == ["0.05", "5.0"]


def test_a_track_of_the_list_that_has_ended_says_so(replay):
    replay.value("show(2); showPanels()")
    replay.until("document.querySelectorAll('#tracks tbody tr').length === 1")
    replay.press("#tracks tbody button")
    replay.value("show(10); showPanels()")
    settled(replay)
    replay.value("showPanels()")
    assert "Track 5ended" in text(replay, "#selected")
    assert "Reasonits target was missed too often" in text(replay, "#selected")
    # Before its end, or without a fact of it, it is not published.
    replay.value("show(5); scene.frames[5].tracks.pop(); showPanels()")
    assert "Track 5not published" in text(replay, "#selected")
    replay.value("scene.frames[5].fixed[0][Row.ID] = 5; showPanels()")
    assert "Track 5fixed echo" in text(replay, "#selected")
    assert "Last held72.0 s" in text(replay, "#selected")


def test_wheel_drag_and_two_fingers_change_the_view(replay):
    x, y = place(replay, 1200.0, 0.0)
    scale = replay.value("plan.scale")
    replay.mouse("mouseWheel", x, y, deltaX=0, deltaY=-400)
    replay.until(f"plan.scale > {1.5 * scale}")
    assert place(replay, 1200.0, 0.0) == pytest.approx([x, y], abs=1.0)
    replay.mouse("mousePressed", x, y, button="left", clickCount=1)
    replay.mouse("mouseMoved", x + 60, y + 30, button="left", buttons=1)
    replay.mouse("mouseReleased", x + 60, y + 30, button="left", clickCount=1)
    settled(replay)
    assert place(replay, 1200.0, 0.0) == pytest.approx([x + 60, y + 30], abs=1.0)
    assert replay.value("byId('selected').hidden"), "a drag selects nothing"
    replay.press("#fit")
    settled(replay)
    assert replay.value("plan.scale") == pytest.approx(scale)

    def touch(kind, *points):
        replay.call(
            "Input.dispatchTouchEvent",
            type=kind,
            touchPoints=[{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)],
        )

    replay.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    touch("touchStart", (300, 400), (500, 400))
    for step in range(1, 11):
        touch("touchMove", (300 - 10 * step, 400), (500 + 10 * step, 400))
    touch("touchEnd")
    replay.until(f"plan.scale > {1.7 * scale}")
    assert replay.value("plan.scale") == pytest.approx(2.0 * scale, rel=0.1)


def test_dark_and_light_follow_the_system_and_the_button(browser, tmp_path):
    path = tmp_path / "page.html"
    write_page(path, "sea", recording())
    brightness = {}
    for theme in ("dark", "light"):
        tab = browser.tab(theme=theme)
        tab.open(path.as_uri())
        assert tab.value("document.documentElement.dataset.theme") == theme
        red = tab.value("getComputedStyle(document.body).backgroundColor").split("(")[1]
        brightness[theme] = int(red.split(",")[0])
        tab.press("#theme")
        assert tab.value("document.documentElement.dataset.theme") != theme
    assert brightness["dark"] < 60 < 200 < brightness["light"]


def test_a_phone_shows_all_without_scrolling_sideways_and_a_finger_finds_every_button(replay):
    replay.size(390, 844, phone=True)
    settled(replay)
    assert replay.value("document.documentElement.scrollWidth") <= 390
    box = replay.value(
        "(() => { const box = byId('play').getBoundingClientRect();"
        " return [box.top, box.bottom, innerHeight]; })()"
    )
    assert 0 < box[0] < box[1] <= box[2], "the controls are on the screen"
    small = replay.value(
        """[...document.querySelectorAll(
            'header button, #zoom button, #controls button, select, summary, aside label')]
            .filter((one) => one.offsetParent && one.getBoundingClientRect().height < 44)
            .map((one) => one.id || one.textContent)"""
    )
    assert small == []


def test_a_recording_shows_no_alarms_and_no_gates(replay):
    for part in ("alarm", "alarm-chip", "approach", "gates", "sound-chip"):
        assert replay.value(f"byId('{part}').hidden"), part


def test_the_track_list_has_range_bearing_and_closest_approach(replay):
    replay.value(
        "Object.assign(scene.frames.at(-1).tracks[0], { [Row.VX]: -8, [Row.SINCE_HIT]: 24,"
        " [Row.CPA]: 500, [Row.TCPA]: 150, [Row.CPA_STD]: 82 });"
        "scene.frames.at(-1).own_ship = [0, 500, 1.57, 0, 0]; select(3); showPanels()"
    )
    cells = replay.value(
        "[...document.querySelectorAll('#tracks tbody td')].map((d) => d.textContent)"
    )
    assert cells == ["3", "1.30 km", "113°", "8.0", "270°", "500 m", "2.5 min"]
    assert "Closest approach500 m ± 82.0 m in 2.5 min" in text(replay, "#selected")
    assert "Last detection24 s ago" in text(replay, "#selected")


def test_latitude_and_longitude_are_shown_where_the_origin_is_known(replay):
    replay.value("select(3)")
    assert "Latitude" not in text(replay, "#selected")
    assert replay.value("byId('save-geojson').hidden")
    # A degree for 100 km, either way.
    replay.value(
        "scene.info.geographic = { origin: [59.5, -179.995], reach: 1e5,"
        " terms: [[0, 1, 1, 0], [1, 0, 0, -1]] }; showPanels()"
    )
    assert "Latitude, longitude59°30.000′N 179°59.580′E" in text(replay, "#selected")
    assert replay.value("geographic(scene.info, 8e4, 8e4)") is None, "beyond the reach"
    found = replay.value("[degrees(-0.99999999, 3, 'EW'), degrees(5.5, 2, 'NS')]")
    assert found == ["001°00.000′W", "05°30.000′N"]


def test_the_tracks_are_saved_as_csv_and_geojson(replay):
    lines = replay.value("tracksAsCsv(scene, 5)").splitlines()
    assert lines[0] == "track_id,time,x,y,vx,vy,time_since_hit,latitude,longitude,status"
    assert [line.split(",")[:2] for line in lines[1:]] == [
        *([["5", f"{12 * k}.000"] for k in range(2, 6)] + [["3", "48.000"], ["3", "60.000"]])
    ]
    assert lines[-1] == "3,60.000,500.00,0.00,8.000,0.000,0.000,,,confirmed"
    replay.value(
        "scene.info.geographic = { origin: [59.5, -179.994], reach: 1e5,"
        " terms: [[0, 1, 1, 0], [1, 0, 0, -1]] }"
    )
    collection = json.loads(replay.value("tracksAsGeoJson(scene, 12)"))
    kinds = {f["properties"]["track_id"]: f["geometry"] for f in collection["features"]}
    assert kinds[5]["type"] == "LineString" and kinds[5]["coordinates"][0] == [-179.974, 59.49]
    cut = kinds[3]
    assert cut["type"] == "MultiLineString", "it crosses 180 degrees"
    assert [cut["coordinates"][0][-1][0], cut["coordinates"][1][0][0]] == [-180.0, 180.0]
    assert len(collection["features"][1]["properties"]["times"]) == 9
    assert collection["features"][1]["properties"]["status"] == ["confirmed"] * 9
    replay.value(
        "window.saved = []; HTMLAnchorElement.prototype.click = function () {"
        " saved.push(this.download); }"
    )
    replay.press("#save-csv")
    assert replay.value("saved") == ["tracks.csv"] and replay.complaints == []


def test_an_id_that_is_given_again_is_another_track(replay):
    replay.value(
        """scene.clear();
        const row = (x) => [3, 100 * x, 0, 0, 0, 1, 1, 0, 0];
        const shown = { own_ship: null, detections: [], potential: [], fixed: [] };
        for (const [number, x, first] of [[1, 10, 0], [2, 11, 0], [3, -90, 2.5], [4, -91, 2.5]]) {
            const frame = { ...shown, number, stamp: number, frame_id: "odom", tracks: [row(x)] };
            scene.merge({ facts: { 3: { first } }, frames: [frame] });
        }"""
    )
    trail = "scene.trail(3, {}, Infinity).map(({{ x }}) => Math.round(x))"
    assert replay.value(trail.format(2)) == [10, 11]
    assert replay.value(trail.format(4)) == [-90, -91], "not joined with the other"
    assert len(replay.value("tracksAsCsv(scene, 4)").splitlines()) == 5, "none is left out"


def test_a_line_of_range_and_bearing_is_drawn_by_hand(replay):
    centre = replay.value("plan.center")
    replay.press("#measure")
    begin, end = place(replay, 0.0, 0.0), place(replay, 300.0, 400.0)
    replay.mouse("mousePressed", *begin, button="left", clickCount=1)
    replay.mouse("mouseMoved", *end, button="left", buttons=1)
    replay.mouse("mouseReleased", *end, button="left", clickCount=1)
    settled(replay)
    assert np.array(replay.value("plan.ruler")) == pytest.approx(
        np.array([[0.0, 0.0], [300.0, 400.0]]), abs=20.0
    )
    assert replay.value("rangeAndBearing([0, 0], [300, 400], Math.PI / 2)") == "500 m, 037°"
    assert replay.value("plan.center") == centre, "the view stays"
    assert replay.value("plan.colour.strong") in colours(replay, 150.0, 200.0)
    replay.press("#measure")
    assert replay.value("plan.ruler") is None


def plane(words: str) -> tuple[float, float]:
    """x and y of a read-out."""
    return tuple(map(float, re.search(r"x (\S+), y (\S+) m", words).groups()))


def test_the_pointer_s_range_bearing_and_position_are_read_out(replay):
    replay.mouse("mouseMoved", *place(replay, 1000.0, 500.0))
    replay.until("!byId('cursor').hidden")
    x, y = plane(text(replay, "#cursor"))
    assert (x, y) == pytest.approx((1000.0, 500.0), abs=10.0)
    assert ", 090° · " in text(replay, "#cursor")
    replay.mouse("mouseMoved", 1200, 10)
    replay.until("byId('cursor').hidden")


def test_the_sector_is_drawn_from_the_bow_and_live_is_that_of_the_diagnostics(replay):
    accent = replay.value(
        "scene.info.sector = [100, 2000, -0.5, 0.5]; showPanels();"
        "window.arcs = []; const { context } = plan, arc = context.arc;"
        "context.arc = function (...given) { arcs.push(given); arc.apply(this, given); };"
        "const ship = scene.ownShip(scene.frames.at(-1));"
        "plan.drawArea(ship, scene.sector(), '#000000'); context.arc = arc; arcs"
    )
    scale = replay.value("plan.scale")
    assert accent[0][2:5] == pytest.approx([2000 * scale, -1.57 + 0.5, -1.57 - 0.5])
    assert accent[1][2] == pytest.approx(100 * scale)
    assert not replay.value("byId('layer-sector').closest('li').hidden")
    replay.value("delete scene.info.sector; scene.health = []")
    assert replay.value("scene.sector()") is None
    found = replay.value(
        """(scene.health = [{ entries: [
            { task: "own ship", values: [["source", "odometry"], ["mounting_yaw", "0.5"]] },
            { task: "sensor parameters", values: [["min_range", "1"], ["max_range", "60.0"],
              ["azimuth_min", "-0.7"], ["azimuth_max", "0.7"]] },
        ] }], scene.sector())"""
    )
    assert found == pytest.approx([1.0, 60.0, -0.2, 1.2])


def test_coverages_and_detections_of_several_sensors_are_told_apart_and_a_silent_one_is_grey(
    replay,
):
    plain = replay.value("document.querySelectorAll('#tracks th').length")
    hits = replay.value(
        """(() => {
            const sector = [100, 2000, -0.5, 0.5];
            scene.info.sensors = [
                { name: "port", sector, place: [0, 0, 0.6], silent_from: 1e9 },
                { name: "starboard", sector, place: [10, -20, -0.6], silent_from: 1 },
            ];
            scene.frames.forEach((frame) => {
                frame.sensors = [1, 0];
                frame.tracks.filter((row) => row[0] === 3).forEach((row) => { row.seen = 3; });
            });
            scene.facts[3].hits = scene.facts[3].hits.map((hit, k) => [...hit, k % 2]);
            select(3);
            return 0;
        })()"""
    )
    assert hits == 0
    settled(replay)
    port, starboard = replay.value("scene.sensors(scene.frames.at(-1))")
    assert (port["sign"], starboard["sign"]) == ("P", "S")
    # Own ship is at (0, 500) m with the bow to the north.
    assert port["pose"] == pytest.approx([0.0, 500.0, 1.57 + 0.6])
    assert starboard["pose"] == pytest.approx([20.0, 510.0, 1.57 - 0.6], abs=0.1)
    assert (bool(port["silent"]), bool(starboard["silent"])) == (False, True)
    words = replay.value(
        """(() => {
            const found = [], { context } = plan;
            plan.text = (words) => { found.push([words, context.fillStyle]); };
            context.fillRect = (x, y, side) => { found.push([`${side} px`, context.fillStyle]); };
            plan.draw(scene.frames.length - 1);
            delete plan.text;
            delete context.fillRect;
            return found;
        })()"""
    )
    colour = replay.value("plan.sensorColours")
    assert ["port", colour[0]] in words
    assert ["starboard, silent", replay.value("plan.colour.muted")] in words
    assert any(one.startswith("3  ") and one.endswith("  P  S") for one, _ in words)
    assert [shown for side, shown in words if side == "3 px"] == [colour[1], colour[0]]
    assert replay.value("document.querySelectorAll('#tracks th').length") == plain + 1
    assert text(replay, "#tracks tbody td:last-child") == "PS"
    assert "Seen byport, starboard" in text(replay, "#selected")
    replay.value("byId('selected').querySelector('details').open = true")
    rows = replay.value(
        "[...document.querySelectorAll('#selected tbody tr')].map((r) => r.textContent)"
    )
    assert [row.endswith("port") for row in rows] == [True, False, True]
    assert replay.value("sensorSigns(['sonar_1', 'sonar_2'])") == ["1", "2"]
    row = "Object.assign([3, 0, 0, 0, 0, 0, 0, 0, 0, 0.5], { seen: %d })"
    assert [replay.value(f"missed({row % bits})") for bits in (2, 0)] == [False, True], "by any"


def test_live_coverages_are_those_of_the_diagnostics_and_stay_aboard(replay):
    replay.value(
        """(() => {
            const values = (pose) => [["coverage", "1 60 -0.7 0.7"], ["pose", pose]];
            const entries = [
                { task: "track initiation", level: 0,
                  values: [["sensors", "port starboard radar"]] },
                { task: "port/detections", level: 0, values: values("10 500 1.57") },
                { task: "starboard/detections", level: 3, values: values("0 490 0.57") },
                { task: "radar/detections", level: 1, values: [] },
            ];
            delete scene.info.sector;
            scene.merge({ health: [{ node: "", level: 3, entries }] });
        })()"""
    )
    moved = "{ ...scene.frames.at(-1), own_ship: [100, 500, 0, 0, 0] }"
    port, starboard, radar = replay.value(f"scene.sensors({moved})")
    assert port["sector"] == [1.0, 60.0, -0.7, 0.7]
    # 10 m to starboard of own ship, whose bow has turned by 90 degrees to the right.
    assert port["pose"] == pytest.approx([100.0, 490.0, 0.0], abs=0.1)
    assert (starboard["silent"], radar["silent"]) == (True, False)
    assert starboard["pose"] == [0, 490, 0.57], "where it was: it was silent from the beginning"
    assert (radar["sector"], radar["pose"]) == (None, None)
    assert replay.value("scene.sensors({ own_ship: null })")[0]["pose"] == [10, 500, 1.57]
    replay.value(
        """(() => {
            scene.frames.at(-1).own_ship = [100, 500, 0, 0, 0];
            scene.health[0].entries[1].level = 3;
            scene.merge({ health: scene.health });
        })()"""
    )
    port = replay.value("scene.sensors(scene.frames.at(-1))")[0]
    assert port["pose"] == pytest.approx([100.0, 490.0, 0.0], abs=0.1), "it stays aboard, silent"


def test_no_label_covers_another(replay):
    boxes = replay.value(
        """(() => {
            const frame = scene.frames.at(-1);
            for (let k = 0; k < 60; k += 1) {
                const vy = k % 2 ? 4 : -4;
                frame.tracks.push([100 + k, 40 * k, 1500 - 50 * k, 3, vy, 9, 9, 0, 1, 0]);
            }
            const found = [], text = plan.text;
            plan.text = function (words, x, y) {
                const width = plan.context.measureText(words).width;
                const shift = { left: 0, center: 0.5 }[plan.context.textAlign];
                found.push([words, x - shift * width, y - 6, x + (1 - shift) * width, y + 6]);
                const [, left, , right] = found.at(-1);
                if (words.includes("m/s") && (left < 0 || right > plan.width)) {
                    throw new Error(`${words} is cut`);
                }
            };
            plan.draw(scene.frames.length - 1);
            plan.text = text;
            return found;
        })()"""
    )
    words = [box[0] for box in boxes]
    assert any("km" in one for one in words[:-2]) and sum("m/s" in one for one in words) > 20
    for k, (first, left, top, right, bottom) in enumerate(boxes):
        for second, x0, y0, x1, y1 in boxes[k + 1 :]:
            apart = left >= x1 or right <= x0 or top >= y1 or bottom <= y0
            assert apart, (first, second)


def test_one_button_gives_night_colours_and_takes_them_back(replay):
    day = replay.value("document.documentElement.dataset.theme")
    replay.press("#night")
    background = "getComputedStyle(document.body).backgroundColor"
    red, green, blue = replay.value(f"{background}.match(/\\d+/g).map(Number)")
    assert max(red, green, blue) < 10 and green == blue == 0
    for name, colour in replay.value("plan.colour").items():
        red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
        assert max(green, blue) <= 0.65 * red, name
    replay.press("#night")
    assert replay.value("document.documentElement.dataset.theme") == day


def test_a_recording_that_cannot_be_read_is_said(tab, tmp_path):
    path = tmp_path / "page.html"
    write_page(path, "sea", "{")
    tab.open(path.as_uri())
    tab.until("byId('notice').textContent.includes('cannot be shown')")


def test_a_served_recording_is_the_same_page(tab):
    with served(recording=recording()) as server:
        tab.open(server.url)
        tab.until("scene.frames.length === 12 && byId('clock').textContent")
        tab.until("byId('clock').textContent === '144.0 s · scan 12 of 12'")
        assert tab.complaints == []
        assert all(url.startswith((server.url, "data:")) for url in tab.requests)


def test_a_live_page_follows_pauses_and_goes_on(tab):
    state = live_state(3)
    with served(state) as server:
        tab.open(server.url)
        tab.until("scene.frames.length === 3 && byId('state').textContent === 'Live'")
        tab.until("byId('clock').textContent === '36.0 s · scan 3'")
        put_moving(state, 4)
        tab.until("byId('clock').textContent === '48.0 s · scan 4'")
        tab.press("#play")
        put_moving(state, 5)
        tab.until("scene.frames.length === 5")
        settled(tab)
        assert text(tab, "#clock") == "48.0 s · scan 4" and text(tab, "#state") == "Paused"
        tab.press("#play")
        settled(tab)
        assert text(tab, "#clock") == "60.0 s · scan 5"
        entry = {"task": "detections", "level": 2, "message": "no scan", "values": []}
        state.put_health({"/n": {"node": "/n", "level": 2, "entries": [entry]}})
        tab.until("byId('health-chip').textContent === 'Health: Error'")
        assert tab.complaints == []
        port = urlsplit(server.url).port
        assert all(f"127.0.0.1:{port}/" in url or url.startswith("data:") for url in tab.requests)


def test_a_live_page_that_was_cut_off_comes_back_with_the_present_state(tab):
    state = live_state(3)
    with served(state) as server:
        port = urlsplit(server.url).port
        tab.open(server.url)
        tab.until("scene.frames.length === 3")
    tab.until("byId('state').textContent === 'Not connected'")
    with served(live_state(9), port=port):
        tab.until("scene.frames.length === 9 && byId('state').textContent === 'Live'")
        tab.until("byId('clock').textContent === '108.0 s · scan 9'")


def test_a_live_page_without_scans_says_what_it_waits_for(tab):
    state = live_state()
    with served(state) as server:
        tab.open(server.url)
        tab.until("byId('notice').textContent.startsWith('Nothing publishes /tracks/current yet')")
        assert text(tab, "#state") == "Waiting"
        state.put_info(published=True)
        tab.until("byId('notice').textContent.includes('waits for its first scan')")


def test_a_page_behind_a_token_works(tab):
    with served(live_state(2), host="127.0.0.1", token="a-token-of-some-length") as server:
        tab.open(server.url)
        tab.until("scene.frames.length === 2")
        assert "token" not in tab.value("location.href")
        assert tab.complaints == []


def test_a_live_page_keeps_a_bounded_history_and_the_paused_frame(tab):
    state = live_state(2)
    with served(state) as server:
        tab.open(server.url)
        tab.until("scene.frames.length === 2")
        tab.value(
            "for (let n = 3; n <= MAX_FRAMES; n += 1) take({frames: [{...scene.frames[0],"
            " number: n, stamp: n}]})"
        )
        tab.value("page.playing = false; page.index = 2000; redraw()")
        settled(tab)
        number = tab.value("scene.frames[page.index].number")
        tab.value("take({frames: [{...scene.frames[0], number: 1e6, stamp: 1e6}]})")
        assert tab.value("scene.frames.length") == 3001
        assert tab.value("scene.frames[page.index].number") == number
        assert tab.value("scene.histories.get(7).length") <= 3001
