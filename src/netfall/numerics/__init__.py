"""Functions, arithmetic and dense solutions that give the same bits on any processor."""
