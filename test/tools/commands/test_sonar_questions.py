"""Questions of the first set-up: what a data sheet says, as parameters."""

import math

import pytest

from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups
from tsepm_ros.tools.commands.init_command import QUESTIONS, completed, parameters
from tsepm_ros.tracker.sensor import SensorModel

BY_NAME = {question.name: question for question in QUESTIONS}


def sensor(**given: float) -> SensorModel:
    made: SensorModel = make_groups(TRACK_INITIATOR, parameters(completed(given)))[SensorModel]
    return made


def test_widths_of_beam_and_cell_are_uniform_distributions():
    made = sensor(beam_width=2.0, range_cell=0.5)
    assert made.azimuth_resolution == pytest.approx(math.radians(2.0), rel=1e-5)
    assert made.azimuth_std == pytest.approx(math.radians(2.0) / math.sqrt(12.0), rel=1e-2)
    assert made.range_resolution == 0.5
    assert made.range_std == pytest.approx(0.5 / math.sqrt(12.0), rel=1e-2)
    assert sensor(beam_width=2.0, bearing_accuracy=0.1).azimuth_std == pytest.approx(
        math.radians(0.1), rel=1e-5
    )


def test_a_sector_lies_about_its_middle():
    made = sensor(sector=120.0, sector_centre=-30.0)
    assert math.degrees(made.azimuth_min) == pytest.approx(-90.0, abs=1e-3)
    assert math.degrees(made.azimuth_max) == pytest.approx(30.0, abs=1e-3)
    assert sensor(sector=360.0, sector_centre=90.0).all_round


@pytest.mark.parametrize(
    ("range_", "speed", "interval"),
    [(9000.0, 1500.0, 12.0), (200.0, 1500.0, 0.27), (750.0, 1500.0, 1.0), (100.0, 0.0, 12.0)],
)
def test_pings_follow_each_other_as_sound_allows(range_, speed, interval):
    answers = completed({"max_range": range_, "sound_speed": speed})
    assert answers["interval"] == pytest.approx(interval)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("max_range", " 200 m ", 200.0),
        ("sector", "90°", 90.0),
        ("beam_width", "1.5 deg", 1.5),
        ("range_error", ".5%", 0.5),
        ("sound_speed", "1.48e3", 1480.0),
    ],
)
def test_an_answer_may_have_its_unit(name, text, value):
    assert BY_NAME[name].read(text) == value


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("max_range", "2 km"),
        ("max_range", "far"),
        ("max_range", "0"),
        ("max_range", "-5"),
        ("sector", "400"),
        ("beam_width", "1,5"),
        ("min_range", ""),
        ("max_speed", "nan"),
        ("max_range", "1e999"),
    ],
)
def test_an_answer_that_is_none_is_refused_by_name(name, text):
    with pytest.raises(ValueError, match=f"^{BY_NAME[name].argument} must be "):
        BY_NAME[name].read(text)


def test_answers_that_contradict_each_other_are_refused():
    with pytest.raises(ValueError, match=r"sensor\.min_range must be below max_range"):
        parameters(completed({"min_range": 500.0, "max_range": 100.0}))
    with pytest.raises(ValueError, match="range_std and range_std_fraction"):
        parameters(completed({"range_error": 0.0}))
