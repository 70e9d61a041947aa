"""Strengths of simulated echoes: their laws, texture, and fluctuating targets."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import (
    ClutterStrength,
    Strengths,
    TargetStrength,
    scenario_from,
)

BOX = load_scenario("box")
MANY = 20_000


def clutter(law: ClutterStrength, n: int = MANY, seed: int = 1, position=None, time: float = 0.0):
    drawn = Strengths(law, [], np.random.default_rng(seed))
    position = np.zeros((n, 2)) if position is None else position
    return drawn.draw(position, np.full(len(position), -1), time)


def echoes(target: TargetStrength, seed: int = 1):
    drawn = Strengths(ClutterStrength(), [target], np.random.default_rng(seed))
    return drawn.draw(np.zeros((MANY, 2)), np.zeros(MANY, np.int64), 0.0)


def test_rayleigh_clutter_is_exponential_of_mean_1():
    assert stats.kstest(clutter(ClutterStrength()), "expon").pvalue > 0.01


def test_k_clutter_is_a_gamma_texture_times_an_exponential():
    found = clutter(ClutterStrength("k", 0.5))
    expected = np.random.default_rng(2).gamma(0.5, 2.0, MANY)
    expected = expected * np.random.default_rng(3).exponential(size=MANY)
    assert stats.ks_2samp(found, expected).pvalue > 0.01


def test_a_swerling_1_target_is_exponential_of_mean_1_and_the_ratio():
    found = echoes(TargetStrength(6.0)) / (1.0 + 10.0**0.6)
    assert stats.kstest(found, "expon").pvalue > 0.01


def test_a_steady_target_is_rician():
    power = 10.0
    found = echoes(TargetStrength(10.0, "steady"))
    # 2 |sqrt(P) + c|^2 is noncentral chi-square of two degrees of freedom.
    assert stats.kstest(2.0 * found, stats.ncx2(2, 2.0 * power).cdf).pvalue > 0.01


def test_a_swerling_3_target_fluctuates_less_than_one_of_swerling_1():
    power = 10.0
    variance = {}
    for kind in ("swerling_1", "swerling_3", "steady"):
        found = echoes(TargetStrength(10.0, kind))
        assert found.mean() == pytest.approx(1.0 + power, rel=0.03)
        variance[kind] = found.var()
    # Var |A + c|^2 = Var P + 2 P + 1, with Var P = P^2, P^2 / 2 and 0.
    expected = {"swerling_1": power**2, "swerling_3": power**2 / 2.0, "steady": 0.0}
    for kind, of_power in expected.items():
        assert variance[kind] == pytest.approx(of_power + 2.0 * power + 1.0, rel=0.06)


@pytest.mark.parametrize(("apart", "later"), [(0.0, 0.0), (250.0, 0.0), (0.0, 90.0), (2000.0, 0.0)])
def test_texture_is_common_to_neighbours_and_fades(apart, later):
    law = ClutterStrength("log_normal", 1.0, texture_length=500.0, texture_time=180.0)
    pairs = []
    for seed in range(400):
        drawn = Strengths(law, [], np.random.default_rng(seed))
        origin = np.array([-1])
        one = drawn.draw(np.zeros((1, 2)), origin, 0.0)[0]
        other = drawn.draw(np.array([[apart, 0.0]]), origin, later)[0]
        pairs.append((math.log(one), math.log(other)))
    found = np.corrcoef(np.array(pairs).T)[0, 1]
    expected = math.exp(-0.5 * (apart / 500.0) ** 2 - later / 180.0)
    assert found == pytest.approx(expected, abs=0.12)


def test_strengths_change_no_position_of_a_seed():
    strong = dataclasses.replace(
        BOX, clutter_strength=ClutterStrength("k", 0.5), target_strengths=(TargetStrength(6.0),)
    )
    for plain, other in zip(Simulator(BOX, 3), Simulator(strong, 3), strict=True):
        assert plain.scan.range.tobytes() == other.scan.range.tobytes()
        assert plain.scan.azimuth.tobytes() == other.scan.azimuth.tobytes()
        assert "intensity" not in plain.scan.features
        assert np.isfinite(other.scan.features["intensity"]).all()


def test_a_scenario_file_gives_strengths():
    scene = scenario_from(
        {
            "clutter_strength": {"law": "k", "shape": 0.5, "texture_length": 500},
            "targets": [
                {"state": [1, 0, 1, 0], "strength": {"ratio_db": 6, "fluctuation": "steady"}},
                {
                    "ranges": [100, 2000],
                    "azimuths": [0, 1],
                    "speed": 2.0,
                    "strength": {"ratio_db": 3.0},
                },
            ],
        }
    )
    assert scene.clutter_strength == ClutterStrength("k", 0.5, 500.0)
    assert scene.target_strengths == (TargetStrength(6.0, "steady"),)
    assert scene.areas[0].strength == TargetStrength(3.0)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"clutter_strength": {"law": "chi"}}, "clutter_strength: law must be one of rayleigh"),
        ({"clutter_strength": {"law": "k", "shape": 0.0}}, "shape must be from"),
        ({"clutter_strength": {"texture_length": -1.0}}, "texture_length must be"),
        ({"clutter_strength": 3}, "clutter_strength must be a mapping"),
        (
            {"targets": [{"state": [1, 0, 1, 0], "strength": {"ratio_db": 6.0}}]},
            "clutter_strength must be given too",
        ),
        (
            {
                "clutter_strength": {},
                "targets": [{"state": [1, 0, 1, 0], "strength": {"fluctuation": "steady"}}],
            },
            "targets[0].strength",
        ),
        (
            {
                "clutter_strength": {},
                "targets": [{"state": [1, 0, 1, 0], "strength": {"ratio_db": 900.0}}],
            },
            "ratio_db must be from -100 to 100",
        ),
        (
            {
                "clutter_strength": {},
                "targets": [
                    {
                        "state": [1, 0, 1, 0],
                        "strength": {"ratio_db": 6, "fluctuation": "swerling_2"},
                    }
                ],
            },
            "fluctuation must be one of",
        ),
    ],
)
def test_a_wrong_strength_is_refused_by_its_name(content, said):
    with pytest.raises(ValueError, match=said.replace("[", r"\[")):
        scenario_from(content)


def test_a_target_without_a_strength_has_none():
    scene = dataclasses.replace(BOX, clutter_strength=ClutterStrength(), target_strengths=(None,))
    for simulated in Simulator(scene, 1):
        missing = np.isnan(simulated.scan.features["intensity"])
        assert (missing == (simulated.origin == 0)).all()
