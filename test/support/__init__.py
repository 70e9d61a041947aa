"""What the tests share: builders, plain-loop oracles, drivers and nodes."""
