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
"""The command `tsepm design`: arguments and printed report."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Sequence

from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.consistency_checks import check_questions
from tsepm_ros.settings.node_options import DiagnosticsOptions
from tsepm_ros.settings.parameter_files import parse_parameter_file_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, options_by_sensor
from tsepm_ros.tools.commands.arguments import (
    Arguments,
    add_arguments,
    add_runs_arguments,
    positive,
)
from tsepm_ros.tools.commands.given_parameters import add_given_parameters, given_parameter_values
from tsepm_ros.tools.design.prediction import (
    FirstPrediction,
    PredictedCandidate,
    PredictedRule,
    PredictionCase,
    first_prediction,
    predicted_candidates,
    predicted_remedied_detection,
    predicted_rules_within,
    prediction_clutter_scans,
    prediction_scenes,
)
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.terminal import named_terminal_progress, terminal_table
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.sensor import SensorModel

MAX_REMEDY_RUNS = 100
"""Maximum number of targets simulated for each proposed change."""


ARGUMENTS: Arguments = {
    "--sensor": {"metavar": "NAME", "default": "", "help": "of several sensors, which"},
    "--interval": {
        "type": float,
        "help": "time between pings, s; default diagnostics.scan_period of the file, else 12",
    },
    "--false-detections": {
        "type": float,
        "metavar": "NUMBER",
        "help": "false detections per ping, over the whole coverage",
    },
    "--scans": {
        "type": positive,
        "default": 16,
        "help": "pings within which a target is to be found",
    },
    "--speed": {"type": float, "help": "speed of the targets, m/s; default half max_speed"},
    "--ratio": {
        "type": float,
        "metavar": "DB",
        "help": "signal-to-clutter ratio of the targets, dB, where detections have an intensity",
    },
    "--wanted": {"type": float, "default": 0.9, "help": "required share of targets that are found"},
}


def add_design_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a design."""
    add_arguments(parser, ARGUMENTS)
    add_runs_arguments(parser, 400, "simulated targets, at most")
    add_given_parameters(parser)


def run_design(options: argparse.Namespace) -> None:
    """Design, and print the predicted performance.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_design_arguments`.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    _check_design(options)
    values = given_parameter_values(options.parameter)
    values.pop("method", None)  # the design chooses it
    of_sensor = f"{options.sensor}." * bool(options.sensor)
    own = [name for name in values if name.startswith(of_sensor)]
    values |= {name.removeprefix(of_sensor): values[name] for name in own}
    groups = make_groups(TRACK_INITIATOR, values)
    if options.sensor not in (names := options_by_sensor(groups)):
        raise ValueError(f"--sensor must be one of {[*names]}; got {options.sensor!r}")
    if options.false_detections is not None:
        density = options.false_detections / groups[SensorModel].coverage_area
        values["sensor.clutter_density"] = density
        groups = make_groups(TRACK_INITIATOR, values)
    if options.interval is None:
        options.interval = groups[DiagnosticsOptions].scan_period or PredictionCase.interval
    for question in check_questions(groups[SensorModel], groups[Mounting]):
        print(f"note: {question}", file=sys.stderr)
    common = groups[CommonOptions]
    case = PredictionCase(
        sensor=groups[SensorModel],
        common=common,
        interval=options.interval,
        scans=options.scans,
        target_speed=0.5 * common.max_speed if options.speed is None else options.speed,
        ratio_db=options.ratio,
    )
    prediction_scenes(case, options.runs, options.seed)  # refuses targets that leave the coverage
    score, tsepm = groups[ScoreOptions], groups[TsepmOptions]
    target_rate = score.false_tracks_per_hour
    print(design_case_lines(case, target_rate), flush=True)
    first = first_prediction(case, score, given_window="score.window" in values)
    score = dataclasses.replace(score, window=first.window)
    print(design_first_line(first, case), flush=True)
    rules = predicted_rules_within(case, tsepm, target_rate, options.workers)
    print(
        "\nM/N rules of the method tsepm that keep the target false-track rate:"
        + ("" if rules else " none")
    )
    if rules:
        print(design_rule_table(rules), flush=True)
    simulation = {
        "runs": options.runs,
        "seed": options.seed,
        "processes": options.workers,
        "progress": named_terminal_progress,
    }
    performances = list(
        predicted_candidates(case, score, tsepm, rules, wanted=options.wanted, **simulation)
    )
    hours = prediction_clutter_scans(case, target_rate) / case.scans_per_hour
    print(
        f"\nsimulated: up to {options.runs} targets, {hours:.1f} h of clutter alone, seed "
        f"{options.seed}; score with window {score.window}; 95 % intervals; a dash: not simulated, "
        "since fewer targets are found"
    )
    print(design_candidate_table(performances))
    assumed = ""
    if "sensor.clutter_density" not in values:
        assumed = (
            f"the clutter is not given; with the default, {case.detections_per_scan:.3g} false "
            "detections per ping (yours: --false-detections NUMBER), "
        )
    print(f"\n{assumed}{design_verdict(performances, options.wanted, target_rate)}", flush=True)
    if max(candidate.targets.found.high for candidate in performances) < options.wanted:
        simulation["runs"] = min(options.runs, MAX_REMEDY_RUNS)
        changes = predicted_remedied_detection(
            case, score, given_window="score.window" in values, **simulation
        )
        now = ("as it is", performances[0].targets.found)
        print(design_remedy_table([now, *changes]))


def _check_design(options: argparse.Namespace) -> None:
    """Refuse arguments early that would fail after the simulation."""
    values = parse_parameter_file_values(
        assignment for assignment in options.parameter if isinstance(assignment, str)
    )
    if options.false_detections is not None and not 0.0 < options.false_detections < math.inf:
        raise ValueError(f"--false-detections must be above 0; got {options.false_detections:g}")
    if options.false_detections is not None and "sensor.clutter_density" in values:
        raise ValueError("give --false-detections or sensor.clutter_density, not both")
    if "method" in values:
        raise ValueError("method follows from the design; leave it out")
    if not 0.0 < options.wanted < 1.0:
        raise ValueError(f"wanted must be between 0 and 1; got {options.wanted!r}")


def design_case_lines(case: PredictionCase, false_per_hour: float) -> str:
    """The case of a design in two lines."""
    sensor = case.sensor
    strength = "" if case.ratio_db is None else f", {case.ratio_db:g} dB above the clutter"
    return (
        f"sonar: {sensor.coverage_area / 1e6:.4g} km^2, a ping every {case.interval:g} s, "
        f"{case.detections_per_scan:.3g} false detections in each: {case.starts_per_hour:.0f} "
        f"an hour; target false-track rate {false_per_hour:g} per hour\n"
        f"targets: {case.target_speed:g} m/s (up to {case.common.max_speed:g} allowed), anywhere "
        f"in the coverage{strength}, to be found within {case.scans} pings "
        f"({(case.scans - 1) * case.interval:g} s) inside it"
    )


def design_first_line(estimate: FirstPrediction, case: PredictionCase) -> str:
    """The first estimate in a line."""
    if not estimate.found[-1] > 0.0:
        return "first estimate, without simulation: no target is found in time"
    half, text = estimate.scans_until(0.5), ""
    if half is not None:
        text = f", half of the targets within {half} pings ({(half - 1) * case.interval:g} s)"
    return (
        f"first estimate, without simulation: score (threshold {estimate.threshold:.1f}) finds "
        f"about {estimate.found[-1]:.2f} of the targets in time{text}"
    )


def design_rule_table(rules: Sequence[PredictedRule]) -> str:
    """Table of the M/N rules that keep the target false-track rate."""
    return terminal_table(
        ["M/N", "found by one start", "in time, evaluated", "false/h at most"],
        [
            [
                f"{rule.min_hits}/{rule.window}",
                f"{rule.one_start:.4f}",
                f"{rule.in_time:.3f}",
                f"{rule.false_per_hour:.2g}",
            ]
            for rule in rules
        ],
    )


def design_candidate_table(candidates: Sequence[PredictedCandidate]) -> str:
    """Table of the candidates' simulated performance."""
    return terminal_table(
        [
            "method",
            "targets",
            "targets found, 95 %",
            "time [s]",
            "95 % by",
            "bound/h",
            "false/h, 95 %",
        ],
        [
            [
                candidate.name,
                f"{candidate.targets.targets}",
                candidate.targets.found.text(".3f"),
                f"{candidate.targets.confirmation_time.value:.4g}",
                f"{candidate.targets.slow_confirmation_time:.4g}",
                f"{candidate.false_bound:.2g}",
                candidate.false_simulated.text(".2g"),
            ]
            for candidate in candidates
        ],
    )


def design_verdict(
    candidates: Sequence[PredictedCandidate], wanted: float, false_per_hour: float
) -> str:
    """Sentence on whether P_DT is reached at the target false-track rate, and by which method."""
    keeping = [candidate for candidate in candidates if candidate.keeps(false_per_hour)]
    if not keeping:
        return f"infeasible: every method has more than {false_per_hour:g} false tracks per hour"
    best = max(keeping, key=lambda candidate: candidate.targets.found.value)
    share = best.targets.found
    text = f"{best.name} finds {share:.2f} of the targets in time"
    if share.low >= wanted:
        return f"feasible: {text}, at least {wanted:g}"
    if share.high >= wanted:
        return f"undecided by the runs: {text}, wanted {wanted:g}"
    return f"infeasible: {text}, less than {wanted:g}"


def design_remedy_table(remedies: Sequence[tuple[str, IntervalEstimate]]) -> str:
    """Table of P_DT with each change, the present case first and then by P_DT, descending."""
    ordered = [remedies[0], *sorted(remedies[1:], key=lambda row: -row[1].value)]
    return terminal_table(
        ["with a change", "targets found, 95 %"],
        [[text, f"{share:.2f}"] for text, share in ordered],
    )
