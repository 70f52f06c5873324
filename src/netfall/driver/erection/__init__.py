"""Erection and prestressing: target tensions reached by unstressed lengths, and erection stages."""
