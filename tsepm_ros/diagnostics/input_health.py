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
"""Health of an input: how often it comes, when it was heard last, and what is dropped of late.

Every input of every node is judged by the same rules, which `INPUTS` has in the entries of the
nodes without a session. A rule is a condition with a level, thresholds and a remedy; its judgement
returns the sentence that names the problem, or an empty one. `NodeHealth` has the history behind
them. docs/diagnostics.md lists the rules.

Counts are totals since the start or the last reset. A level tells what goes on: what happened once
is over after twice the interval of its input, and what comes again stays until it has not come for
twice the time between, at most for `DiagnosticsOptions.window`.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from tsepm_ros.diagnostics.health_figures import (
    LAST_SCANS,
    MAX_RECORDS,
    Connections,
    InputFigures,
    Level,
    Occurrences,
    Status,
    overall,
)
from tsepm_ros.session.drop_reasons import (
    DETECTIONS,
    INTERNAL_ERROR,
    OWN_SHIP,
    REPORT_IT,
    drop_reason_of,
)
from tsepm_ros.session.inputs import Now, input_waited
from tsepm_ros.settings.node_options import DiagnosticsOptions

IMAGES, TRACKS, FIX, PLAYBACK, NODE = "images", "tracks", "fix", "playback", "node"
TASK_OF_REASON = {
    **dict.fromkeys(("bad_own_ship", "no_own_ship", "frames"), OWN_SHIP),
    **dict.fromkeys(("bad_fix", "fix_jump", "no_position"), FIX),
    INTERNAL_ERROR: NODE,
}
"""Entries of the drops of the other nodes; all others are of the node's first entry."""
LOST_AFTER = 10.0
"""Time without any message of a publisher from which on it is said how they may be lost, s."""
_PUBLISHER = "Check the publisher"
MIN_SILENCE = 1.0
"""Time without a message that is said at least, s."""
Judgement = Callable[[Any], str]
"""Of `HealthFigures`, or of the `InputFigures` of an entry."""
CHECK_NAVIGATION = "Check the navigation; compare its clock with the sonar's"
NO_CONNECTIONS = Connections()
"""Connections of a session without a node."""
DEFAULT_OPTIONS = DiagnosticsOptions()


@dataclass(frozen=True)
class Rule:
    """One problem that an entry may have.

    Attributes
    ----------
    level : Level
        Level of an entry with the problem.
    condition : str
        When there is the problem, a sentence for docs/diagnostics.md.
    judge : callable
        Returns the sentence that names the problem, or an empty sentence.
    remedy : str
    thresholds : tuple of str
        Options of `DiagnosticsOptions` that are thresholds of the rule.
    """

    level: Level
    condition: str
    judge: Judgement
    remedy: str
    thresholds: tuple[str, ...] = ()


@dataclass(frozen=True)
class Entry:
    """One entry.

    Attributes
    ----------
    healthy : callable
        Returns the message if no rule applies.
    values : callable
        Returns the figures.
    rules : tuple of tuple of Rule
        Of the rules in one tuple, only the first that applies counts.
    """

    healthy: Judgement
    values: Callable[[Any], Mapping[str, object]]
    rules: tuple[tuple[Rule, ...], ...]


def said_when(applies: bool, sentence: str) -> str:
    """The sentence, if it applies."""
    return sentence if applies else ""


def said_dropped(drops: Mapping[str, int], connections: Connections = NO_CONNECTIONS) -> str:
    """Drops by reason, the most frequent first, and several publishers; empty without drops."""
    ordered = sorted(drops.items(), key=lambda drop: -drop[1])
    said = f"dropped: {', '.join(f'{n} {name}' for name, n in ordered)}"
    return said_when(bool(drops), said + connections.of_several)


def said_unread_type(now: InputFigures) -> str:
    """The input is published as a type that the node does not read."""
    connections = now.connections
    readable = connections.other_readable
    other = ", ".join(name for name in connections.unread if name not in readable)
    sentences = [f"{other}, which the node does not read"] if other else []
    if readable:
        after = f"after a new start: it has subscribed to {connections.subscribed_type}"
        sentences.append(f"{', '.join(readable)}, which the node reads only {after}")
    return said_when(
        bool(sentences), f"{connections.topic} is published as {'; and as '.join(sentences)}"
    )


def said_nothing_yet(now: InputFigures) -> str:
    """Nothing has arrived, whether or not it is published."""
    topic = now.connections.topic
    if not now.connections.publishers:
        return said_when(math.isnan(now.since), f"no publisher of {topic} yet")
    why = (
        f" for {now.waited:.3g} s: its publisher sends nothing, or all is lost on the way"
        + now.connections.best_effort
        * ". It offers best effort, by which messages of some MB are lost whole where buffers are "
        "small: let it offer reliable delivery, or raise net.core.rmem_max"
    )
    return said_when(
        math.isnan(now.since),
        f"no {now.noun} yet, though {topic} is published{why * (now.waited > LOST_AFTER)}",
    )


def said_none_used(now: InputFigures) -> str:
    """Messages came, and all were dropped; but for bearings of the first turn."""
    came = not math.isnan(now.since) and not now.findings.get("turns")
    none = came and not now.arrivals and bool(now.dropped)
    return said_when(none, f"none of the {now.noun}s so far could be used")


def said_silence(now: InputFigures, limit: float, expected: str = "") -> str:
    """Nothing has arrived for longer than a limit, s."""
    gone = said_when(not now.connections.publishers, "; its publisher is gone")
    return said_when(now.since > limit, f"no {now.noun} for {now.since:.3g} s{expected}{gone}")


def said_stale(now: InputFigures) -> str:
    """Nothing has arrived for long."""
    return said_silence(now, now.options.stale_time)


def said_overdue(now: InputFigures) -> str:
    """The next message is overdue."""
    limit, period = max(now.max_interval, now.patience), now.period  # nan where that is unknown
    expected = "" if math.isnan(period) else f", expected is one every {period:.3g} s"
    return said_silence(now, limit, expected)


def said_gaps(now: InputFigures) -> str:
    """Messages are missing between others."""
    number = now.gaps
    gaps = "1 gap" if number == 1 else f"{number} gaps"
    return said_when(number > 0, f"{gaps} between {now.noun}s longer than {now.max_interval:.3g} s")


def said_behind(now: InputFigures) -> str:
    """The newest message is older than what needs it, or newer by more than any delay."""
    return said_when(
        now.behind > now.options.max_own_ship_age or -now.behind > now.options.stale_time,
        f"{now.noun} is {abs(now.behind):.3g} s {'older' if now.behind > 0.0 else 'newer'} than "
        f"the newest {now.user}",
    )


def finding(subject: str, condition: str, remedy: str) -> tuple[Rule, ...]:
    """The rule of what a node has found."""
    return (Rule(Level.WARN, condition, lambda now: now.findings.get(subject, ""), remedy),)


_DROPS = (
    Rule(
        Level.WARN,
        "Input of this entry is dropped",
        lambda now: said_dropped(now.late, now.connections),
        "The log says why",
    ),
)


def _entry(*more: tuple[Rule, ...]) -> Entry:
    """The entry of an input of a node other than the track initiator."""
    return Entry(
        lambda now: now.healthy,
        lambda now: {
            "interval_s": now.interval,
            "since_last_s": now.since,
            **now.values,
            **{f"dropped.{name}": number for name, number in now.dropped.items()},
        },
        (
            (
                Rule(
                    Level.ERROR,
                    "An input has a type that is not read",
                    said_unread_type,
                    "See docs/topics.md; restart the node",
                ),
                Rule(
                    Level.WARN,
                    "Nothing has arrived",
                    said_nothing_yet,
                    "Check the publisher; the message says what else",
                ),
                Rule(Level.STALE, "No message for a minute", said_stale, _PUBLISHER),
                Rule(Level.WARN, "The next message is overdue", said_overdue, _PUBLISHER),
                Rule(
                    Level.WARN,
                    "Own ship is older than images, or a minute newer",
                    said_behind,
                    _PUBLISHER,
                ),
            ),
            *more,
            _DROPS,
        ),
    )


INPUTS: dict[str, Entry] = {
    IMAGES: _entry(
        (Rule(Level.WARN, "No image could be used", said_none_used, "The log says why"),),
        finding(
            "slow",
            "Images come too fast",
            "Reduce their rate or size",
        ),
        finding("turns", "Bearings make no turn", "As the message says"),
        finding(
            "content",
            "An image has one value, or distances in place of amplitudes",
            "Look at the driver's display",
        ),
        finding(
            "range",
            "Fixed echoes lie at other ranges than before",
            "As the message says",
        ),
        finding(
            "anew",
            "The ranges or bearings of images change before the stated number is kept, ten times "
            "in a row",
            "As the message says",
        ),
    ),
    TRACKS: _entry(),
    OWN_SHIP: _entry(),
    FIX: _entry(),
    PLAYBACK: Entry(
        lambda now: now.healthy,
        lambda now: {f"dropped.{name}": number for name, number in now.dropped.items()},
        (
            finding("subscribers", "Playback waits for subscribers", "Start the subscriber"),
            _DROPS,
        ),
    ),
    NODE: Entry(
        lambda now: now.healthy,
        lambda now: {f"dropped.{name}": number for name, number in now.dropped.items()},
        (
            (
                Rule(
                    Level.ERROR,
                    "A callback failed",
                    lambda now: said_when(INTERNAL_ERROR in now.late, REPORT_IT),
                    "Report it",
                ),
            ),
        ),
    ),
}
"""Entries of the other nodes by their tasks."""


def status_of(task: str, entry: Entry, now: InputFigures) -> Status:
    """Return the status of an entry: the sentences of its rules that apply, the worst first."""
    sentences: list[tuple[Level, str]] = []
    for alternatives in entry.rules:
        judged = ((rule.level, rule.judge(now)) for rule in alternatives)
        sentences += [(level, sentence) for level, sentence in judged if sentence][:1]
    sentences = sorted(sentences, key=lambda judgement: -judgement[0]) or [
        (Level.OK, entry.healthy(now))
    ]
    message = "; ".join(sentence for _, sentence in sentences)
    return Status(task, sentences[0][0], message, entry.values(now))


class NodeHealth:
    """Records what arrives at a node, and what it drops, for its diagnostics.

    Parameters
    ----------
    nouns : mapping of str to str
        By the tasks of the node's inputs, the first is the main one: a message of it in words. The
        entry `NODE` follows.
    options : DiagnosticsOptions, optional

    Attributes
    ----------
    options : DiagnosticsOptions
        May be replaced at any time.
    nouns : dict of str to str
        May be added to.
    period : float
        Time between reports, s: each drop is in one at least.
    """

    def __init__(
        self, nouns: Mapping[str, str], options: DiagnosticsOptions = DEFAULT_OPTIONS
    ) -> None:
        self.options, self.nouns, self.period = options, dict(nouns), 0.0
        self.reset()

    def reset(self) -> None:
        """Discard the history."""
        self._heard: dict[str, Now] = {}
        self._published: dict[str, float] = {}  # since when
        self._arrivals: defaultdict[str, deque[tuple[float, float]]]
        self._arrivals = defaultdict(lambda: deque(maxlen=MAX_RECORDS))
        self._late: defaultdict[str, Occurrences] = defaultdict(Occurrences)

    def heard(self, task: str, now: Now, stamp: float | None = None) -> None:
        """Record an arrival, used or not; with its stamp, s, where each message has one."""
        self._heard[task] = now
        if stamp is not None:
            self.arrived(stamp, now, task)

    def arrived(self, stamp: float, now: Now, task: str = DETECTIONS) -> None:
        """Record the stamp (s) of an arriving scan, or image, processed or not."""
        self.remember(self._arrivals[task], (first_clock(now), stamp))

    def forget_arrivals(self, task: str = DETECTIONS) -> None:
        """Discard the stamps so far: those to come are of other intervals."""
        self._arrivals[task].clear()

    def dropped(self, reason: str, now: Now, total: int) -> None:
        """Record that something was dropped, and how often so far."""
        self._late[reason].note(first_clock(now), total)

    def figures(
        self, task: str, now: Now, connections: Connections, **others: Any
    ) -> dict[str, Any]:
        """Arguments of the `InputFigures` of an entry."""
        time, is_heard = first_clock(now), task in self._heard
        if not connections.publishers:
            self._published[task] = time
        return {
            "options": self.options,
            "noun": self.nouns.get(task, "message"),
            "connections": connections,
            "arrivals": tuple(self._arrivals[task]),
            "since": input_waited(self._heard[task], now) if is_heard else math.nan,
            "waited": time - self._published.setdefault(task, time),
            "patience": self.options.max_own_ship_age if task == OWN_SHIP else MIN_SILENCE,
            "time": time,
        } | others

    def late(self, dropped: Mapping[str, int], now: Now, interval: float) -> Counter[str]:
        """Drops that go on, by reason: their numbers in the window."""
        for reason, total in dropped.items():
            self.dropped(reason, now, total)
        time, window, interval = first_clock(now), self.options.window, max(self.period, interval)
        return +Counter(
            {name: each.number(time, interval, window) for name, each in self._late.items()}
        )

    def report_inputs(
        self,
        now: Now,
        dropped: Mapping[str, int],
        connections: Mapping[str, Connections],
        found: Mapping[str, Mapping[str, Any]],
    ) -> list[Status]:
        """Return the status of every task.

        Parameters
        ----------
        now : float or tuple of float
            Time on the clocks of `heard`, s. The first clock measures the window.
        dropped : mapping of str to int
            Drops by reason.
        connections : mapping of str to Connections
            By task.
        found : mapping of str to mapping
            Further arguments of `InputFigures` by task.
        """
        tasks, statuses = [*self.nouns, NODE], list[Status]()
        main = tasks[0]
        interval = InputFigures(**self.figures(main, now, NO_CONNECTIONS)).interval
        late = self.late(dropped, now, interval)
        for task in tasks:
            own = [name for name in dropped if task == _task_of(name, main, tasks)]
            given = {
                "dropped": {name: dropped[name] for name in own},
                "late": Counter({name: late[name] for name in own if late[name]}),
                "connections": connections.get(task, NO_CONNECTIONS),
                **found.get(task, {}),
            }
            figures = InputFigures(**self.figures(task, now, **given))
            statuses.append(status_of(task, INPUTS[task], figures))
        return [overall(statuses), *statuses]

    def remember(self, records: deque[Any], newest: tuple[Any, ...]) -> None:
        """Add a record; forget those before the window, except the last `LAST_SCANS` of all."""
        records.append(newest)
        while len(records) > LAST_SCANS and records[0][0] < newest[0] - self.options.window:
            records.popleft()


def _task_of(reason: str, main: str, tasks: Collection[str]) -> str:
    """The entry of a drop reason."""
    known = TASK_OF_REASON.get(reason) or drop_reason_of(reason).task
    return known if known in tasks else main


def first_clock(now: Now) -> float:
    """The time on the first clock, s."""
    return now[0] if isinstance(now, tuple) else now
