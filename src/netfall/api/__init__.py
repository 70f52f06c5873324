"""The Python interface: `netfall.run` and `netfall.Net`."""
