"""The pages that the package ships, and their printing by `netfall docs`."""
