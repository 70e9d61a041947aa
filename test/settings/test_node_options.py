"""Groups of the nodes' options: each field is described and checked."""

import dataclasses

import pytest

from tsepm_ros import SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.parameters import parameter_table
from tsepm_ros.settings.node_options import (
    InitiatorNodeOptions,
    PlaybackOptions,
    PlayerNodeOptions,
    SessionOptions,
    SimulatorNodeOptions,
    ViewerNodeOptions,
)
from tsepm_ros.tracker.options import CommonOptions

GROUPS = [
    CommonOptions,
    TsepmOptions,
    SensorModel,
    SessionOptions,
    InitiatorNodeOptions,
    PlaybackOptions,
    SimulatorNodeOptions,
    PlayerNodeOptions,
]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_field_of_every_group_is_in_its_table_with_a_description(group):
    rows = {row.name: row for row in parameter_table(group)}
    assert list(rows) == [field.name for field in dataclasses.fields(group)]
    for row in rows.values():
        assert row.description
        assert not row.description.endswith(".")
        assert row.check(row.default) == row.default


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_group_checks_itself(group):
    for row in parameter_table(group):
        with pytest.raises(ValueError, match=f"^{row.name} must be"):
            group(**{row.name: object()})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"host": ""}, "host must not be empty"),
        ({"token": "short"}, "at least .* characters"),
        ({"token": "ä" * 40}, "ASCII"),
    ],
)
def test_an_address_or_token_that_the_page_cannot_use_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        ViewerNodeOptions(**values)
