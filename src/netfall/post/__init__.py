"""Evaluation of results: checks by codes, plots, reports, pages for the browser, accuracy and scaling."""
