"""Erection and prestressing: unstressed lengths for target tensions, and stages of erection."""
