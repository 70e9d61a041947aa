"""From the race's raw times to figures: summaries, ratios, exponents and requirements.

Times are wall time. Ratios and growth are of processor time: on an idle machine it is the same, and
on a busy one a contender that runs long enough to be interrupted would come off worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from contenders import CONTENDERS
from race import Lane
from scenes import Scene
from scipy.optimize import nnls

from tsepm_ros import SensorModel
from tsepm_ros.design.expected_counts import Expected, Gating, expected_counts
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.numerics.arrays import FloatArray

REFERENCE = "tsepm-5/8"
"""Whom the others' times are divided by."""
ORACLE = "oracle-5/8"
PEERS = ("stonesoup-5/8", "stonesoup-tuned-5/8", "stonesoup-xy-5/8")
SETTLED = max(entry.window for entry in CONTENDERS.values()) - 1
"""First scan whose window holds scans for every rule."""
FEWEST_PAIRS = 5
"""Settled scans below which the figures are taken from all scans but the first."""


@dataclass(frozen=True, eq=False)
class Heat:
    """One density's race.

    Attributes
    ----------
    name : str
        The density as asked for.
    scene : Scene
    lanes : dict of str to Lane
    theory : dict of str to Expected
        Of the contenders with method tsepm.
    """

    name: str
    scene: Scene
    lanes: dict[str, Lane]
    theory: dict[str, Expected]

    @property
    def density(self) -> float:
        """Clutter density, 1/m^2."""
        return self.scene.sea.clutter_density


@dataclass(frozen=True)
class Ratio:
    """Processor time over the reference's, scan by scan: median, 10 % and 90 %, and in sum."""

    median: float
    low: float
    high: float
    over_run: float
    pairs: int
    settled: bool


@dataclass(frozen=True)
class Summary:
    """Figures of a contender in one heat; times in s, memory in MB, counts per scan.

    Attributes
    ----------
    scans : int
        Scans that it finished.
    median, p95 : float
        Of the settled scans.
    mean_cpu : float
        Mean processor time of the settled scans.
    worst : float
        Of all scans.
    ratio : Ratio or None
        To the reference.
    memory, memory_at_start : float
        Peaks.
    mean_counts, most : dict
        Mean counts of the settled scans; largest of all scans.
    cut : int
        Hypotheses cut in all scans.
    new, of_target, first_of_target : int
        New tracks in all scans, those of the target, and the first scan with one (-1: none).
    stopped : str
        Why it did not finish; empty if it did.
    """

    scans: int
    median: float
    p95: float
    mean_cpu: float
    worst: float
    ratio: Ratio | None
    memory: float
    memory_at_start: float
    mean_counts: dict[str, float]
    most: dict[str, int]
    cut: int
    new: int
    of_target: int
    first_of_target: int
    stopped: str


@dataclass(frozen=True)
class Requirement:
    """A figure that must hold, as measured; `holds` is None where it was not measured."""

    text: str
    measured: str
    holds: bool | None


def theory_of(scene: Scene, names: Sequence[str]) -> dict[str, Expected]:
    """Expected counts for the contenders with method tsepm."""
    entries = {name: CONTENDERS[name] for name in names if name.startswith("tsepm")}
    sea = scene.sea
    gating = Gating(
        sensor=SensorModel(
            range_std_fraction=sea.range_std_fraction,
            azimuth_std=sea.azimuth_std,
            max_range=sea.max_range,
            clutter_density=sea.clutter_density,
        ),
        max_speed=sea.max_speed,
        interval=sea.period,
        gate_probability=sea.gate_probability,
    )
    return {
        name: expected_counts(gating, entry.min_hits, entry.window, len(scene.scans))
        for name, entry in entries.items()
    }


def settled(scans: int) -> slice:
    """The scans from which medians and means are taken."""
    return slice(SETTLED, scans) if scans >= SETTLED + FEWEST_PAIRS else slice(1, scans)


def ratio_to(lane: Lane, reference: Lane | None) -> Ratio | None:
    """Pair the times of the scans that both finished; None if there are too few."""
    if reference is None:
        return None
    pairs = min(len(lane.seconds), len(reference.seconds))
    if pairs < 2:
        return None
    own, other = np.array(lane.cpu[:pairs]), np.array(reference.cpu[:pairs])
    part = settled(pairs)
    each = (own / other)[part]
    low, median, high = np.percentile(each, [10, 50, 90])
    return Ratio(
        median, low, high, float(own.sum() / other.sum()), len(each), part.start == SETTLED
    )


def summarise(heat: Heat, name: str) -> Summary:
    """Figures of one contender in one heat."""
    lane = heat.lanes[name]
    scans = len(lane.seconds)
    part = settled(scans)
    times = np.array(lane.seconds[part]) if scans > 1 else np.full(1, np.nan)
    keys = lane.counts[0] if lane.counts else {}
    targets = [sum(heat.scene.is_target(hits) for hits in new) for new in lane.hits]
    found = [scan for scan, count in enumerate(targets) if count]
    return Summary(
        scans=scans,
        median=float(np.median(times)),
        p95=float(np.percentile(times, 95)),
        mean_cpu=float(np.mean(lane.cpu[part])) if scans > 1 else float("nan"),
        worst=max(lane.seconds, default=float("nan")),
        ratio=ratio_to(lane, heat.lanes.get(REFERENCE)),
        memory=lane.memory,
        memory_at_start=lane.memory_at_start,
        mean_counts={
            key: float(np.mean([counts[key] for counts in lane.counts[part] or lane.counts]))
            for key in keys
        },
        most={key: max(counts[key] for counts in lane.counts) for key in keys},
        cut=sum(counts.get("cut", 0) for counts in lane.counts),
        new=sum(len(new) for new in lane.hits),
        of_target=sum(targets),
        first_of_target=found[0] if found else -1,
        stopped=lane.stopped,
    )


@dataclass(frozen=True)
class Agreement:
    """Scans in which the reference gives what the oracle gives.

    Attributes
    ----------
    scans : int
        Scans that both finished.
    same_tracks : int
        Scans with the same states.
    same_hits : int
        Scans with the same hits too. A merged track's hits are its best member's, and members can
        tie exactly in f_1: of five hits in five scans the residual of the second does not depend
        on the fifth. Rounding then decides.
    """

    scans: int
    same_tracks: int
    same_hits: int


def agreement(heats: Sequence[Heat]) -> Agreement:
    """Compare the outputs of reference and oracle in all heats."""
    tracks, hits = [], []
    for heat in heats:
        if REFERENCE not in heat.lanes or ORACLE not in heat.lanes:
            continue
        own, other = heat.lanes[REFERENCE], heat.lanes[ORACLE]
        tracks += [_same_states(*pair) for pair in zip(own.states, other.states, strict=False)]
        hits += [sorted(a) == sorted(b) for a, b in zip(own.hits, other.hits, strict=False)]
    return Agreement(len(tracks), sum(tracks), sum(hits))


def _same_states(one: FloatArray | None, other: FloatArray | None) -> bool:
    if one is None or other is None or one.shape != other.shape:
        return False
    in_order = [states[np.argsort(states[:, 0])] for states in (one, other)]
    return bool(np.allclose(*in_order, rtol=1e-9, atol=1e-6))


@dataclass(frozen=True)
class CostModel:
    """Processor time per scan as a sum over counts, s each; fitted, none below 0."""

    scan: float
    detection: float
    potential: float
    raw: float

    def predict(self, detections: float, expected: Expected, part: slice) -> float:
        """Mean time of the scans of a part, from expected counts within the limits."""
        limits = CommonOptions()
        potential = np.minimum(expected.potential, limits.max_potential_tracks)[part].mean()
        raw = np.minimum(expected.raw, limits.max_raw_confirmations)[part].mean()
        return float(
            self.scan + self.detection * detections + self.potential * potential + self.raw * raw
        )


def fit_cost(heats: Sequence[Heat], name: str) -> CostModel | None:
    """Fit the times of all a contender's scans, each weighted by 1/time; None if there are none."""
    rows, times = [], []
    for heat in heats:
        lane = heat.lanes[name]
        for seconds, counts in zip(lane.cpu, lane.counts, strict=True):
            rows.append([1.0, counts["detections"], counts["potential"], counts["raw"]])
            times.append(seconds)
    if len(times) < 2 * len(CostModel.__dataclass_fields__):
        return None
    weight = 1.0 / np.array(times)
    solution, _ = nnls(np.array(rows) * weight[:, None], np.ones(len(times)))
    return CostModel(*solution.tolist())


def exponents(heats: Sequence[Heat]) -> dict[str, list[float]]:
    """Growth d log(value) / d log(lambda) between neighbouring densities, by row.

    Rows are processor times of all contenders (mean of the settled scans) and, for method tsepm,
    counts as measured and as the theory has them. nan where a value is missing or 0.
    """
    densities = np.log([heat.density for heat in heats])
    return {
        row: (np.diff(_safe_log(values)) / np.diff(densities)).tolist()
        for row, values in _grown(heats).items()
    }


def _safe_log(values: Sequence[float]) -> FloatArray:
    array = np.array(values, float)
    return np.log(np.where(array > 0.0, array, np.nan))


def _grown(heats: Sequence[Heat]) -> dict[str, list[float]]:
    """What the exponents are of, a value per heat."""
    rows: dict[str, list[float]] = {}
    for name in heats[0].lanes:
        summaries = [summarise(heat, name) for heat in heats]
        rows[f"{name} time"] = [summary.mean_cpu for summary in summaries]
        if not name.startswith("tsepm"):
            continue
        parts = [settled(summary.scans) for summary in summaries]
        theory = [heat.theory[name] for heat in heats]
        cost = fit_cost(heats, name)
        if cost is not None:
            rows[f"{name} time, theory"] = [
                cost.predict(summary.mean_counts.get("detections", 0.0), expected, part)
                for summary, expected, part in zip(summaries, theory, parts, strict=True)
            ]
        rows[f"{name} potential"] = [
            summary.mean_counts.get("potential", 0.0) for summary in summaries
        ]
        rows[f"{name} potential, theory"] = [
            float(expected.potential[part].mean())
            for expected, part in zip(theory, parts, strict=True)
        ]
        rows[f"{name} raw"] = [raw_before_cut(summary.mean_counts) for summary in summaries]
        rows[f"{name} raw, theory"] = [
            float(expected.raw[part].mean()) for expected, part in zip(theory, parts, strict=True)
        ]
    return rows


def raw_before_cut(counts: dict[str, float]) -> float:
    """Raw confirmations with those that the limit cut."""
    return counts.get("raw", 0.0) + counts.get("cut_raw", 0.0)


def requirements(heats: Sequence[Heat]) -> list[Requirement]:
    """What must hold, beside what was measured."""
    by_name = {heat.name: heat for heat in heats}
    found = [_at_least(by_name.get("1e-06"), peer, 150.0, "median ratio at 1e-6") for peer in PEERS]
    found.append(_oracle_ratio(by_name.get("3e-06")))
    found.append(_same_output(heats))
    found.extend(_bounded(by_name.get("5e-06"), 0.1, 1000.0))
    found.extend(_bounded(by_name.get("1e-05"), 1.0, None))
    found.extend(_at_least(by_name.get("calm"), peer, 20.0, "median ratio, calm") for peer in PEERS)
    return found


def _at_least(heat: Heat | None, peer: str, needed: float, text: str) -> Requirement:
    text = f"{text}: {peer} / {REFERENCE} at least {needed:g}"
    ratio = summarise(heat, peer).ratio if heat and peer in heat.lanes else None
    if ratio is None:
        return Requirement(text, "not measured", None)
    measured = f"{ratio.median:.0f} ({ratio.low:.0f} to {ratio.high:.0f}, {ratio.pairs} scans)"
    if not ratio.settled:
        return Requirement(text, f"{measured}: too few scans", None)
    return Requirement(text, measured, bool(ratio.median >= needed))


def _oracle_ratio(heat: Heat | None) -> Requirement:
    text = f"over the run at 3e-6: {ORACLE} / {REFERENCE} at least 20"
    ratio = summarise(heat, ORACLE).ratio if heat and ORACLE in heat.lanes else None
    if heat is None or ratio is None:
        return Requirement(text, "not measured", None)
    scans = len(heat.lanes[ORACLE].seconds)
    return Requirement(text, f"{ratio.over_run:.0f} (first {scans} scans)", ratio.over_run >= 20)


def _same_output(heats: Sequence[Heat]) -> Requirement:
    text = "the oracle's tracks in every scan that it finished"
    found = agreement(heats)
    if not found.scans:
        return Requirement(text, "not measured", None)
    measured = f"{found.same_tracks} of {found.scans} scans, with the same hits {found.same_hits}"
    return Requirement(text, measured, found.same_tracks == found.scans)


def _bounded(heat: Heat | None, share: float, megabytes: float | None) -> list[Requirement]:
    """Worst scan within a share of the period, peak memory within a bound."""
    if heat is None or REFERENCE not in heat.lanes:
        return [Requirement(f"worst scan within {share:g} of the period", "not measured", None)]
    summary = summarise(heat, REFERENCE)
    limit = share * heat.scene.sea.period
    finished = not summary.stopped
    found = [
        Requirement(
            f"worst scan at {heat.name}: {REFERENCE} at most {limit:g} s",
            f"{summary.worst:.2f} s, {summary.cut} cut in {summary.scans} scans",
            finished and summary.worst <= limit,
        )
    ]
    if megabytes is not None:
        found.append(
            Requirement(
                f"peak memory at {heat.name}: {REFERENCE} under {megabytes:g} MB",
                f"{summary.memory:.0f} MB",
                finished and summary.memory < megabytes,
            )
        )
    return found
