"""What netfall report and netfall info write."""
