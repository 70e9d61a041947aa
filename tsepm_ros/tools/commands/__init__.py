"""The command `tsepm`."""
