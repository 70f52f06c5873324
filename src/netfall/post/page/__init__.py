"""The interactive page of a result, for any browser, without network."""
