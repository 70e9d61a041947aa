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
"""Build of tsepm_ros for both worlds: `colcon build` (ament_python) and pip."""

from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "tsepm_ros"
# The one place that states the version, the people, the addresses and the keywords.
MANIFEST = ElementTree.parse("package.xml").getroot()
URLS = {url.get("type"): url.text for url in MANIFEST.findall("url")}


def manifest(tag: str) -> str:
    """Return the text of one element of package.xml, on one line."""
    return " ".join(MANIFEST.findtext(tag, "").split())


# ROS comes from apt through package.xml, so it never stands in install_requires; without apt it
# comes as these wheels. Only the names with "ros-jazzy-" in front are sure to be Jazzy.
ROS_WHEELS = [
    "ros-jazzy-rclpy[fastrtps]",
    "ros-jazzy-builtin-interfaces",
    "ros-jazzy-diagnostic-msgs",
    "ros-jazzy-geometry-msgs",
    "ros-jazzy-nav-msgs",
    "ros-jazzy-rcl-interfaces",
    "ros-jazzy-rosgraph-msgs",
    "ros-jazzy-sensor-msgs",
    "ros-jazzy-std-msgs",
    "ros-jazzy-std-srvs",
    "ros-jazzy-visualization-msgs",
]

setup(
    name=NAME,
    version=manifest("version"),
    description=manifest("description"),
    license=manifest("license"),
    author=manifest("author"),
    author_email=MANIFEST.find("author").get("email"),
    maintainer=manifest("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    url=URLS["website"],
    project_urls={"Repository": URLS["repository"], "Issues": URLS["bugtracker"]},
    keywords=[tag.text for tag in MANIFEST.findall("export/rosindex/tags/tag")],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering",
        "Typing :: Typed",
    ],
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*", "msg_adapters", "msg_adapters.*"]),
    package_data={
        NAME: ["py.typed", "tools/simulation/scenarios/*.yaml", "tools/viewer/page/*"],
        "msg_adapters": ["py.typed"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.xml"))),
        (f"share/{NAME}/examples", sorted(glob("examples/*.*"))),
        (f"share/{NAME}/rviz", sorted(glob("config/rviz/*"))),
        (f"share/{NAME}/foxglove", sorted(glob("config/foxglove/*"))),
        (f"share/{NAME}/sros2", sorted(glob("config/sros2/*"))),
    ],
    zip_safe=False,
    install_requires=["numpy>=1.26", "scipy>=1.11", "PyYAML>=6.0.1"],
    extras_require={
        "ros": ROS_WHEELS,
        "progress": ["tqdm>=4.64"],
        "plot": ["matplotlib>=3.6"],
        "bags": ["rosbags>=0.11"],
        "viewer": ["tornado>=6.2"],
        "bridge": ["pyproj>=3.4"],
        "docs": ["mkdocs>=1.6,<2", "mkdocstrings[python]>=0.26"],
        "test": [
            "coverage>=7.10",
            "hypothesis>=6.98",
            "pynmea2>=1.19",
            "pyproj>=3.4",
            "rosbags>=0.11",
            "tornado>=6.2",
            "tqdm>=4.64",
            "pytest>=7.4",
            "pytest-timeout>=2.2",
            "pytest-xdist>=3.4",
            "ruff>=0.9",
            "mypy>=1.11",
            "types-PyYAML>=6.0.12",
        ],
    },
    entry_points={
        "console_scripts": [
            "track_initiator = tsepm_ros.ending_signals:track_initiator",
            "sonar_simulator = tsepm_ros.ending_signals:sonar_simulator",
            "scan_player = tsepm_ros.ending_signals:scan_player",
            "sonar_detector = tsepm_ros.ending_signals:sonar_detector",
            "track_viewer = tsepm_ros.ending_signals:track_viewer",
            "track_bridge = tsepm_ros.ending_signals:track_bridge",
            "tsepm_demo = tsepm_ros.ending_signals:tsepm_demo",
            "tsepm = tsepm_ros.ending_signals:tsepm",
        ],
    },
)
