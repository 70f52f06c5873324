"""The page of a result, to turn and to play in any browser, without network."""
