"""Files that a run writes, by all ranks: result, checkpoints, locks."""
