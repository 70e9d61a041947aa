"""Track splitting, evaluating, pruning and merging (TSEPM 2018)."""
