"""A recording and a scenario for the commands."""

import numpy as np
import pytest

SMALL = """
scans: 8
period: 12.0
sensor: {range_std: 5.0, range_std_fraction: 0.0, azimuth_std: 0.005, max_range: 3000.0,
         detection_probability: 1.0, clutter_density: 1.0e-7}
targets:
  - {state: [1500.0, 4.0, 700.0, -3.0]}
"""


@pytest.fixture
def recording(tmp_path):
    """A target at 5 m/s along x, 3 km north, seen 8 times by a sensor at rest."""
    rows = ["time_s,range_m,azimuth_rad"]
    for k in range(8):
        x, y = 5.0 * 12.0 * k, 3000.0
        rows.append(f"{12.0 * k},{np.hypot(x, y)},{np.arctan2(y, x)}")
    (tmp_path / "detections.csv").write_text("\n".join(rows))
    return str(tmp_path)


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return str(path)
