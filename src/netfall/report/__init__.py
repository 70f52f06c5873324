"""Output of `netfall report` and `netfall info`."""
