"""Construction of a prestressed state: targets reached by lengths, and stages of erection."""
