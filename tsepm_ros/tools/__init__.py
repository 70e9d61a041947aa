"""Tools around the node: page, replay, simulation, design, evaluation, commands."""
