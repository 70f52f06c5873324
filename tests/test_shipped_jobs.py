"""Every key is used by a shipped job or study that shows its purpose."""

import tomllib
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks
from scipy.optimize import brentq

from netfall.job.keys.schema import GENERATORS, LIST_KEYS, TABLES

FILES = sorted((ROOT / "jobs").rglob("*.toml"))
KEYS = [f"{name}.{key.name}" for name, keys in (TABLES | LIST_KEYS).items() for key in keys if name]
GIVES_UP = "where a run gives up; one that comes to its end never gets there"
NOT_SHOWN = {
    "form_finding.max_iterations": GIVES_UP,
    "load.max_iterations": GIVES_UP,
    "net.wheel.ring_groups": "as in [net.dome]",
}


def of_job(job: dict) -> set[str]:
    """Keys of a job, SECTION.KEY; those of a group or a zone count as those of the section."""
    used = set()
    for section, content in job.items():
        tables = content if isinstance(content, list) else [content]
        for table in (table for table in tables if isinstance(table, dict)):
            used |= {f"{section}.{key}" for key in table}
            for inner in table.get("zone", {}).values() if section in ("load", "wind") else ():
                used |= {f"{section}.{key}" for key in inner}
            if section == "group":
                used |= {f"cable.{key}" for inner in table.values() for key in inner}
            if section == "net":
                used |= {f"net.{name}.{key}" for name in GENERATORS for key in table.get(name, {})}
    return used


def of_study(study: dict) -> set[str]:
    """Keys of a job that a study varies or draws."""
    return {key for part in ("vary", "sample") for key in study.get(part, {}) if "." in key}


@pytest.fixture(scope="module")
def used():
    read = [tomllib.loads(path.read_text()) for path in FILES]
    return set().union(
        *(of_study(file) if isinstance(file.get("job"), str) else of_job(file) for file in read)
    )


@pytest.mark.parametrize("key", [key for key in KEYS if key not in NOT_SHOWN])
def test_each_key_is_in_a_shipped_job(key, used):
    """A key without a shipped job or study has no visible use."""
    assert key in used


def test_exceptions_are_keys():
    assert set(NOT_SHOWN) <= set(KEYS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_file_describes_itself_and_its_command(path):
    head = path.read_text().split("\n\n")[0]
    assert head.startswith("# ") and path.stem in head


SPAN, SIDES, HEAD = 40.0, 8, 20e6  # m; of the polygon; N/m
CARRYING, BRACING = (4.0, 300e3), (-3.0, 400e3)  # sag [m], horizontal force at prestress [N]


def horizontal_force(sag, prestress, EA, w, give):
    """Return H of a cable that sags by w [m], 20 K colder than at prestress; give : [m/N] of its supports."""
    stretch = 16 / 3 * (1 - 1 / SIDES**2) * (sag * w + w**2 / 2) / SPAN
    colder = 12e-6 * 20.0 * SPAN * (1 + 16 / 3 * (sag / SPAN) ** 2)
    return prestress + (stretch + colder) / (SPAN * (1 + 8 * (sag / SPAN) ** 2) / EA + give)


def truss(q, EA):
    """Return sag [m] under q [N/m] and forces [N] of its cables; EA : of the carrying one [N]."""
    forces = lambda w: np.array(
        [horizontal_force(*CARRYING, EA, w, 2 / HEAD), horizontal_force(*BRACING, 107e6, w, 0.0)]
    )
    sags = np.array([CARRYING[0], BRACING[0]])
    w = brentq(lambda w: forces(w) @ (sags + w) - q * SPAN**2 / 8, -1.0, 1.0)
    return w, forces(w)


@pytest.fixture(scope="module")
def snow(tmp_path_factory):
    """Return sag [m] of a node and tension [N] of an element of jobs/trusses.toml without its skylight."""
    path = tmp_path_factory.mktemp("trusses") / "result.vtkhdf"
    even = ("--set", "load.zone.skylight.dead=200", "--set", "dynamics.duration=0.01")
    job = ROOT / "jobs" / "trusses.toml"
    run_on_standing_ranks("run", job, "-o", path, "--quiet", *even, cwd=path.parent)
    with h5py.File(path) as f:
        node, element = (f[f"net/{name}_id"][:].tolist() for name in ("node", "element"))
        z, N = f["cases/snow/displacement"][:, 2], f["cases/snow/tension"][:]
    return SimpleNamespace(sunk=lambda i: -z[node.index(i)], tension=lambda i: N[element.index(i)])


@pytest.mark.parametrize(
    "first, width, EA, cable", [(200, 6.0, 168e6, 8.9), (100, 3.0, 107e6, 5.7)], ids=["inner", "outer"]
)
def test_trusses_sink_as_by_hand(snow, first, width, EA, cable):
    """The parabola of two cables that share the load: jobs/trusses.toml says how. Left out are what hangers
    get longer and that the load sits on nodes that go sideways: 1 % together.
    """
    weight = 9.81 * (1.053 * cable + 1.03 * 5.7 + 0.95)  # N/m, of cables, 3.75 m of hanger every 5 m
    w, (carrying, bracing) = truss((750.0 + 200.0 * 738.5 / 720.0) * width + weight, EA)
    assert snow.sunk(first + 4) == pytest.approx(w, rel=0.01)
    assert snow.tension(first + 3) * np.cos(np.arctan(0.05)) == pytest.approx(carrying, rel=0.01)
    assert snow.tension(first + 53) * np.cos(np.arctan(0.0375)) == pytest.approx(bracing, rel=0.01)
