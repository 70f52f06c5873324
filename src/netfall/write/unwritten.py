"""The place of a result file in runs of which a few numbers are enough."""


class Unwritten:
    """Takes what a run reports, as `result.Result` does, and keeps none of it."""

    def __init__(self, comm):
        self.comm, self.file = comm, self
        self.losses = 0

    def _nothing(self, *_):
        pass

    write_frame = write_static_step = write_equilibrium = write_whole = _nothing
    write_envelope = write_final = close = discard = discard_all = discard_after = _nothing
