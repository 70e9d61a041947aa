"""The command `tsepm init`: asks what a sonar is, and writes its parameter file."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.design.sonar_questions import (
    ESTIMATED_SCANS,
    QUESTIONS,
    Answers,
    Question,
    completed,
    expected,
    parameters,
)
from tsepm_ros.parameters import Value
from tsepm_ros.settings.rendering import section
from tsepm_ros.settings.session_options import OWN_SHIP_SOURCES
from tsepm_ros.settings.value_text import yaml_text
from tsepm_ros.whole_files import write_text

ODOMETRY = OWN_SHIP_SOURCES.index("odometry")
LEARNED = """the node learns the clutter density by place, the detection probability, and whether
targets have several detections in a ping"""


def add_init_arguments(parser: argparse.ArgumentParser) -> None:
    """Add an argument for each question."""
    parser.add_argument("file", nargs="?", default="my_sonar.yaml", help="default my_sonar.yaml")
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: defaults for what is not given"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the file if it exists")
    for question in QUESTIONS:
        parser.add_argument(
            question.argument,
            dest=question.name,
            metavar="|".join(question.choices)
            or question.unit.upper().replace("%", "PERCENT").replace(" ", "_"),
            help=f"{question.text}, {question.unit}. {question.explanation}".replace("%", "%%"),
        )


def run_init(options: argparse.Namespace) -> None:
    """Ask for the answers that are not given, write the parameter file and say what to expect.

    Nothing is asked where the input or the output is no terminal.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_init_arguments`.

    Raises
    ------
    ValueError
        If an answer is not allowed, or the file exists.
    """
    path = Path(options.file)
    if path.exists() and not options.force:
        raise ValueError(f"{path} exists; give another name, or --force to overwrite it")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"there is no folder for {path}")
    given = {
        question.name: question.read(text)
        for question in QUESTIONS
        if (text := getattr(options, question.name)) is not None
    }
    if not options.yes and sys.stdin.isatty() and sys.stdout.isatty():
        print("The sonar's data sheet has most answers. Enter alone takes the value in [ ].\n")
        given = asked(given, input)
    answers = completed(given)
    values = parameters(answers, known_interval="interval" in given)
    write_text(path, file_text(values, _line(path, answers, given)))
    missing = [question for question in QUESTIONS if question.name not in given]
    if missing:
        print("not given, defaults taken:")
        for question in missing:
            print(
                f"  {question.argument} {question.shown(answers[question.name])}  ({question.text})"
            )
    print(f"{LEARNED}\n\n{expectation_text(answers, path)}\n")
    source = values["own_ship_source"]
    more = {"odometry": " -r own_ship/odometry:=YOUR_ODOMETRY", "tf": " -p fixed_frame:=map"}
    print(f"written: {path}; run it with\n  {_run_line(path)}{more.get(str(source), '')}")
    if source == "none":
        print("on a moving vessel give --own-ship odometry, or tf")


def asked(given: Answers, ask: Callable[[str], str]) -> dict[str, float]:
    """Answers to the questions that are not given, each asked until it is allowed.

    Parameters
    ----------
    given : mapping of str to float
    ask : callable
        Shows a text and returns the answer.

    Raises
    ------
    ValueError
        If the input ends.
    """
    answers: dict[str, float] = {}
    for question in QUESTIONS:
        if question.name in given:
            answers[question.name] = question.checked(given[question.name])
        elif question.name.startswith("mounting") and answers["own_ship"] != ODOMETRY:
            answers[question.name] = question.default(answers)
        else:
            answers[question.name] = _asked_one(question, question.default(answers), ask)
    return answers


def _asked_one(question: Question, default: float, ask: Callable[[str], str]) -> float:
    shown = question.shown(default)
    prompt = f"{question.text} ({question.unit})\n  {question.explanation}\n  [{shown}]: "
    while True:
        try:
            text = ask(prompt).strip()
        except EOFError:
            raise ValueError(f"no answer to {question.argument}: the input has ended") from None
        try:
            return question.read(text) if text else question.checked(default)
        except ValueError as error:
            print(f"  {error}")


def file_text(values: dict[str, Value], line: str) -> str:
    """The parameter file, for a node of any name in any namespace."""
    lines = [
        f"# {line}",
        "# Clutter density and detection probability are learned; a density here is the start.",
        *section(),
        *(f"    {name}: {yaml_text(value)}" for name, value in values.items()),
    ]
    return "\n".join(lines) + "\n"


def expectation_text(answers: Answers, path: Path) -> str:
    """Table of the estimated performance by the number of false detections; a more exact way."""
    interval = answers["interval"]
    rows = []
    for number, estimate in expected(answers):
        row = [f"{number:g}"]
        for share in (0.5, 0.9):
            scans = estimate.scans_until(share)
            row += ["-", "-"] if scans is None else [f"{scans}", f"{(scans - 1) * interval:.3g} s"]
        rows.append(row)
    head = [
        "false detections per ping",
        "half found in pings",
        "time",
        "0.9 found in pings",
        "time",
    ]
    return (
        f"what to expect at {answers['false_tracks']:g} false tracks per hour, by theory,\n"
        f"of targets at {0.5 * answers['max_speed']:g} m/s, seen in 9 of 10 pings, a ping every "
        f"{interval:g} s (a dash: not within {ESTIMATED_SCANS} pings)\n{text_table(head, rows)}\n"
        "more exact, with a required P_D: "
        f"tsepm design --params-file {shlex.quote(str(path))} --interval {interval:g}"
        + ("" if answers["false_detections"] else " --false-detections YOURS")
    )


def _line(path: Path, answers: Answers, given: Answers) -> str:
    """The command line that writes the same file again: an interval only if it was given."""
    words = ["tsepm", "init", str(path), "--yes"]
    for question in QUESTIONS:
        if question.name != "interval" or question.name in given:
            words += [question.argument, question.shown(answers[question.name])]
    return shlex.join(words)


def _run_line(path: Path) -> str:
    return (
        shlex.join(
            [
                "ros2",
                "run",
                "tsepm_ros",
                "track_initiator",
                "--ros-args",
                "--params-file",
                str(path),
            ]
        )
        + " -r detections:=YOUR_TOPIC"
    )
