"""Options of TSEPM 2018."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.initiation.mn_options import MnOptions
from tsepm_ros.parameters import parameter
from tsepm_ros.stages import evaluation, merging, pruning
from tsepm_ros.stages.estimation import ESTIMATORS


@dataclass(frozen=True, kw_only=True)
class TsepmOptions(MnOptions):
    """Options of the published method; the defaults are the paper's."""

    gate_probability: float = parameter(
        0.9,
        "Probability P that a detected target falls into the gate (Eq. 5)",
        positive=True,
        maximum=0.999999,
    )
    estimator: str = parameter(
        "unweighted",
        "Fit of a track. unweighted: least squares as published; weighted: least squares "
        "with errors re-evaluated at the fit; polar: maximum likelihood of ranges and "
        "azimuths",
        choices=ESTIMATORS,
    )
    evaluation: str = parameter(
        "normalized_distance",
        "Evaluation of a track: f_1 (Eq. 23) or Kennedy's f_2 (Eq. 25)",
        choices=evaluation.EVALUATIONS,
    )
    pruning_probability: float = parameter(
        0.99,
        "Probability P_TP that a true track's distance passes (Eq. 26)",
        positive=True,
        maximum=0.999999,
    )
    pruning_reading: str = parameter(
        "literal",
        "Compare f_1 with the threshold of Eq. 26 as printed, or squared",
        choices=pruning.READINGS,
    )
    clutter_test_size: float = parameter(
        0.05,
        "Nominal fraction of clutter tracks that pass Kennedy's test",
        positive=True,
        maximum=0.999999,
    )
    merging_probability: float = parameter(
        0.9, "Probability P_TM that two states overlap (Eq. 30)", positive=True, maximum=0.999999
    )
    merging: str = parameter(
        "moments",
        "Merged state from Eqs. 31-33, or fitted again to the union of the hits",
        choices=merging.MERGINGS,
    )
