"""Methods of the node: `score` and `tsepm`."""
