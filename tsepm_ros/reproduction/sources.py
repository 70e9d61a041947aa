"""The sources that can be reproduced. A new source is a module here and a row in this table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tsepm_ros.reproduction import environment_2018, sequential_2014, split_merge_2016, tsepm_2018
from tsepm_ros.reproduction.document import Part
from tsepm_ros.reproduction.runs import Setting


@dataclass(frozen=True)
class Source:
    """A publication.

    Attributes
    ----------
    title : str
    reproduce : callable
        Returns the parts of its chapter.
    """

    title: str
    reproduce: Callable[[Setting], list[Part]]


SOURCES = {
    "tsepm_2018": Source("TSEPM 2018", tsepm_2018.reproduce),
    "split_merge_2016": Source("Split-merge 2016", split_merge_2016.reproduce),
    "sequential_2014": Source("Sequential 2014", sequential_2014.reproduce),
    "environment_2018": Source("Environment 2018", environment_2018.reproduce),
}
