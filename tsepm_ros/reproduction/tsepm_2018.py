"""TSEPM 2018: Table 1 and Figs. 5-8."""

from __future__ import annotations

from tsepm_ros.reproduction import figures_5_to_8, table_1
from tsepm_ros.reproduction.document import Part
from tsepm_ros.reproduction.runs import Setting


def reproduce(setting: Setting) -> list[Part]:
    """Parts of the source's chapter."""
    return [*table_1.parts(setting), *figures_5_to_8.parts(setting)]
