"""The keys of a job file: sections, lists of entries, cases and groups, and the rules between them."""
