"""The texts and pages that `netfall report` and `netfall info` write."""
