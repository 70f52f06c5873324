"""The envelope of the history: against all of its rows, and its bits."""

import numpy as np
import pytest
from test_removal import TORN


@pytest.fixture(scope="module")
def torn(shared_workshop):
    """A net that is torn, whose frames are its rows of the history."""
    return shared_workshop.run(shared_workshop.job(TORN, name="torn"), output="torn.vtkhdf")


def test_the_envelope_is_that_of_all_rows(torn):
    """Of every frame in single precision, and of the probes exactly; slack time counts rows."""
    time, m, n = torn["history/time"][:], len(torn["net/elements"]), len(torn["net/particles"])
    assert torn["VTKHDF/Steps/Values"][:] == pytest.approx(time, abs=1e-12)
    frames = torn["VTKHDF/CellData/tension"][:].reshape(len(time), m)
    envelope = {name: torn[f"envelope/{name}"][:] for name in torn["envelope"]}
    assert (envelope["tension_max"].astype(np.float32) == frames.max(0)).all()
    assert (envelope["tension_min"].astype(np.float32) == frames.min(0)).all()
    broken = torn["VTKHDF/CellData/broken"][:].reshape(len(time), m)
    slack = ((frames == 0) & (broken == 0))[1:]  # all are cables
    assert envelope["slack_time"] == pytest.approx((slack * np.diff(time)[:, None]).sum(0), abs=1e-12)
    assert slack.any() and not slack.all(0).any()
    points = torn["VTKHDF/PointData/displacement"][:]
    offsets = torn["VTKHDF/Steps/PointDataOffsets/displacement"][:]
    moved = np.linalg.norm([points[a : a + n] for a in offsets.tolist()], axis=2)
    assert envelope["displacement_max"] == pytest.approx(moved.max(0), rel=1e-6)  # single precision
    element, particle = torn["history/probe_element"][:], torn["history/probe_particle"][:]
    tension = torn["history/probe_tension"][:]
    assert (envelope["tension_max"][element] == tension.max(0)).all()
    assert (envelope["tension_max_time"][element] == time[tension.argmax(0)]).all()
    u = np.linalg.norm(torn["history/probe_displacement"][:], axis=2)
    assert envelope["displacement_max"][particle] == pytest.approx(u.max(0), rel=1e-15)  # its root
    assert (envelope["displacement_max_time"][particle] == time[u.argmax(0)]).all()
