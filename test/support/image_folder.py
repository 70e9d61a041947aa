"""The geometry of a folder of sonar images."""

GEOMETRY = "range: [1.0, 20.9]\nazimuth: [-1.0, 1.0]\nfalse_detections_per_ping: 5\n"
