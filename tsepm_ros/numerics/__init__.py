"""Numerics: arrays, Gaussians, discs, groups."""
