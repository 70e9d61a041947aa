"""The sweeps of the methods, and the key of stored runs."""

import sys

import pytest

from tsepm_ros.methods.registry import METHODS, available_methods, method_class
from tsepm_ros.tools.evaluation.result_files import code_key
from tsepm_ros.tools.evaluation.simulated_run import operating_points
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box")


@pytest.mark.parametrize("method", available_methods())
def test_every_method_takes_the_options_of_its_points(method):
    points = operating_points([method])
    assert len(points) == len(method_class(method).operating_points) > 0
    for point in points:
        made = point.make(BOX).method
        assert type(made) is method_class(method)
        for name, value in point.options.items():
            assert getattr(made.options, name) == value


def test_an_option_goes_to_the_methods_that_have_it_and_replaces_what_their_sweep_varies():
    points = operating_points(["tsepm", "score"], {"miss_probability": 0.01, "max_speed": 5.0})
    for point in points:
        assert point.options["max_speed"] == 5.0
        assert ("miss_probability" in point.options) == (point.method == "score")
    assert len(points) == len(operating_points(["tsepm", "score"]))
    points = operating_points(["tsepm", "score"], {"min_hits": 4})
    given = [point for point in points if point.method == "tsepm"]
    assert [dict(point.options) for point in given] == [{"min_hits": 4}]
    assert len(points) == 1 + len(method_class("score").operating_points)


TOY = """
import {helper}
from tsepm_ros.methods.score import Score


class Toy(Score):
    pass
"""


def test_runs_of_a_method_outside_the_package_are_of_its_module_and_those_that_it_imports(
    tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "toy_rule.py").write_text("HITS = 3\n")
    (tmp_path / "toy_method.py").write_text(TOY.format(helper="toy_rule"))
    monkeypatch.setitem(METHODS, "toy", "toy_method:Toy")
    inside, codes = operating_points(["score"])[0].code, []
    for name in ("", "toy_rule.py", "toy_method.py"):  # each of the next processes has other code
        if name:
            with (tmp_path / name).open("a") as file:
                file.write("CHANGED = True\n")
        code_key.cache_clear()
        codes += [point.code for point in operating_points(["toy"])[:1]]
    assert len({inside, *codes}) == 4
    assert operating_points(["score"])[0].code == inside == code_key()
    for name in ("toy_rule", "toy_method"):
        monkeypatch.delitem(sys.modules, name)


def test_the_key_of_stored_runs_is_of_every_module_and_of_further_files(tmp_path):
    (tmp_path / "peer.py").write_text("rule = 3\n")
    assert code_key(tmp_path / "peer.py") != code_key()
