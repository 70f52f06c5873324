"""The prestress of a geometry that is given: its states of self-stress; sparse systems solved directly."""
