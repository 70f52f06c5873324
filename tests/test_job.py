"""Wrong input gives one clear line for each error, and nothing is computed or left behind."""

import os
import re
import sys
from codecs import BOM_UTF8

import bad_inputs
import pytest
from bad_inputs import BAD_TABLES, JOB, text_of, wrong_values
from conftest import STEEL, error_lines, on_ranks, refused, run_netfall, run_on_standing_ranks, run_process

from netfall.geometry.build import build_net
from netfall.job.keys.schema import LIST_KEYS, TABLES
from netfall.job.read import read_job

WHOLE = text_of(JOB)
ALL_KEYS = [(section, key) for section, keys in TABLES.items() for key in keys]
NAMES = [f"{section}.{key.name}".lstrip(".") for section, key in ALL_KEYS]


def test_every_number_has_an_upper_bound():
    """The message names the key of a 1e300, instead of an overflow or no message."""
    numbers = ("number", "integer", "vector", "pressure", "points", "places", "polygon")
    rows = [key for keys in (*TABLES.values(), *LIST_KEYS.values()) for key in keys if key.kind in numbers]
    free = {"max_iterations"}  # of integers, which are refused beyond 64 bits
    assert {key.name for key in rows if key.high is None or key.high > 1e20} <= free | {"integers"}


@pytest.mark.parametrize("section, key", ALL_KEYS, ids=NAMES)
def test_each_key_refuses_what_its_row_forbids(workshop, section, key):
    """The line names file, section, key, value and allowed values."""
    path = workshop.job(WHOLE)
    for value in wrong_values(key):
        name = f"{section}.{key.name}".lstrip(".")
        lines = error_lines(read_job, path, [f"{name}={value}"])
        place = f"{path}: [{section}] {key.name}" if section else f"{path}: {key.name}"
        about = [line for line in lines if line.startswith(place)]
        # a table where a value belongs is reported as such; a list of pairs accepts no scalar, and so on
        assert about or any(key.name in line for line in lines), (value, lines)
        assert all("\n" not in line and "Traceback" not in line for line in lines)


@pytest.mark.parametrize(
    "section, key", [pair for pair in ALL_KEYS if pair[1].required and pair[0] != "net.ring"]
)
def test_missing_required_key_is_named(workshop, section, key):
    """Each required key, left out, is asked for with its unit."""
    path = workshop.job(re.sub(rf"^{key.name} = .*$", "", WHOLE, flags=re.M))
    assert error_lines(read_job, path, []) == [
        f"{path}: [{section}] {key.name}: missing; expected {key.expected()} [E127]"
    ]


def test_every_key_accepts_its_default(workshop):
    """The defaults of the schema are themselves valid."""
    path = workshop.job(WHOLE)
    for section, key in ALL_KEYS:
        of_other_generator = section.startswith("net.") and section != "net.saddle"
        if key.default is None or key.kind in ("vector", "points", "places") or of_other_generator:
            continue
        if key.name == "prestress":
            continue  # 0 is valid, but not with form finding
        value = str(key.default).lower() if key.kind == "flag" else repr(key.default).replace("'", '"')
        read_job(path, [f"{section}.{key.name}={value}".lstrip(".")])


def test_unknown_key_and_section_name_the_nearest(workshop):
    """A slip of the pen is answered with the word that was meant."""
    text = WHOLE.replace("duration = 0.01", "duration = 0.01\ndampin = 0.5")
    path = workshop.job(text + "[winds]\nspeed = 3.0\n")
    lines = error_lines(read_job, path, [])
    assert f'{path}: [dynamics] dampin: unknown key; did you mean "mass_damping"? [E125]' in lines
    assert f'{path}: [winds]: unknown section; did you mean "wind"? [E120]' in lines


def test_all_errors_come_at_once(workshop):
    """Three mistakes, three lines."""
    path = workshop.job(WHOLE)
    assert len(error_lines(read_job, path, ["wind.speed=-1", "cable.area=0", "dynamics.duration=inf"])) == 3


BROKEN = [b"", b"[net\n", b"\x00\x01\x02\xff\xfe", b"a = [[[[", b'title = "\xff"', b"[net]\n[net]\n"]


@pytest.mark.parametrize("content", BROKEN)
def test_damaged_job_file_is_refused(workshop, content):
    """Empty, truncated, binary, doubled and missing files give lines, not tracebacks."""
    path = workshop.folder / "broken.toml"
    assert "No such file" in error_lines(read_job, path, [])[0]
    path.write_bytes(content)
    assert all(line.startswith(str(path)) for line in error_lines(read_job, path, []))
    path.write_bytes(BOM_UTF8 + WHOLE.encode() + "ü".encode("latin-1"))
    assert f"line {WHOLE.count(chr(10)) + 1}: not text in UTF-8" in error_lines(read_job, path, [])[0]


@pytest.mark.parametrize("override", ["speed", "wind.speed", "=3", "wind=3", ".x=1"])
def test_malformed_override_is_refused(workshop, override):
    """--set wants SECTION.KEY=VALUE."""
    assert error_lines(read_job, workshop.job(WHOLE), [override])


@pytest.mark.parametrize("name", BAD_TABLES)
def test_malformed_table_is_refused_with_its_line(workshop, name):
    """Each mistake in a table is named with file and line or element."""
    nodes, elements, message = BAD_TABLES[name]
    job = read_job(workshop.job(STEEL + "[form_finding]\n", nodes, elements))
    assert message in "\n".join(error_lines(build_net, job))


OVAL = ("length=66", "width=66", "rise=0", "spacing=30")


@pytest.mark.parametrize(
    "overrides, message",
    [
        (["net.saddle.cells=20000", "net.subdivide=10000"], "at most"),
        (["net.generator=stadium", "net.stadium.spacing=1e-5"], "spacing"),
        (["net.generator=stadium", "net.stadium.spacing=60"], "expected at most 16.5 m"),
        (["net.generator=wheel", "net.wheel.spokes=1000000", "net.wheel.hoops=100000"], "at most"),
        (["net.generator=wheel", "net.wheel.spokes=10"], "a multiple of 4"),
        (["net.generator=wheel", "net.wheel.opening=130"], "less than diameter"),
        (["net.generator=ring", *(f"net.ring.{key}" for key in OVAL)], "expected at most 16.5 m"),
        (["net.generator=ring"], "[net.ring] length: missing"),
        (["net.generator=dome", "net.dome.hoops=0", "net.dome.strut=12"], "expected more than 12 m"),
        (["net.generator=dome", "net.dome.spokes=4"], "the rings are too close for 4 spokes"),
        (["group.q.area=1"], "no element is of this group"),
        (["cable.prestress=2e6", "cable.yield_stress=1e6"], "yield force"),
        (["net.nodes=n.csv"], "exclude each other"),
        (["wind.file=speed.csv"], "exclude each other"),
        (["net.stadium.spacing=2.0"], "only for generator"),
        (["net.spacing=2.0"], "only for generator"),
    ],
)
def test_impossible_combinations_are_refused(workshop, overrides, message):
    """Values that are fine alone but not together, and sizes that no machine holds."""
    text = WHOLE
    if "net.generator" in str(overrides):
        text = text.replace("[net.saddle]\n", "").replace("cells = 4", "")
    lines = error_lines(lambda: build_net(read_job(workshop.job(text), overrides)))
    assert message in "\n".join(lines)


def test_the_command_answers_wrong_input(workshop):
    """In processes of its own: exit code 2, one line, no file; bad_inputs.py has all other input."""
    job = workshop.job(WHOLE)
    line = refused(
        "run", job, "--set", "dynamics.time_step=1.0", ranks=2, cwd=workshop.folder, run=run_netfall
    )
    assert line.startswith(f"error: {job}") and "above the stable step" in line
    assert {path.name for path in workshop.folder.iterdir()} == {"job.toml"}


def test_unwritable_place_is_refused(workshop):
    """A result that could not be written at the end is refused at the start."""
    job = workshop.job(WHOLE)
    done = run_on_standing_ranks("run", job, "-o", workshop.folder / "nowhere" / "x.vtkhdf", code=2)
    assert "does not exist" in done.stderr


@pytest.mark.parametrize("ranks, cases", [(1, 400), (2, 80)])
def test_malformed_inputs_made_from_the_schema_are_refused(ranks, cases, monkeypatch, capsys):
    """Jobs and tables at random (bad_inputs.py): exit code 2, a line for each error on one rank, no file."""
    if ranks == 1:
        monkeypatch.setattr(os, "_exit", os._exit)  # main changes both
        monkeypatch.setattr(sys, "argv", sys.argv)
        with pytest.raises(SystemExit, match="0"):
            bad_inputs.main(cases)
        output = capsys.readouterr().out
    else:
        output = run_process(*on_ranks(ranks), sys.executable, bad_inputs.__file__, cases).stdout
    assert output.splitlines()[-1] == f"{cases} malformed inputs on {ranks} ranks, 0 answered wrong"


WINDS = (
    ("speed = 20.0\n", ("turbulence_intensity: missing", "base_height: missing")),
    ("speed = 20.0\nturbulence_intensity = 0.0\n", ("base_height: missing",)),
    ("speed = 20.0\nsurface_drag = 0.0\nprofile_exponent = 0.0\n", ()),
    ("speed = 20.0\nturbulence_intensity = 0.2\nbase_height = 0.0\n", ()),
    (
        "speed = 20.0\nturbulence_intensity = 0.0\nsurface_drag = 0.0\nbase_height = 0.0\n",
        ("surface_drag and turbulence_intensity excl",),
    ),
    ("file = 'speeds.csv'\n", ("base_height: missing",)),
    ("file = 'speeds.csv'\nprofile_exponent = 0.0\n", ()),
)


@pytest.mark.parametrize("keys, missing", WINDS)
def test_a_generated_wind_needs_its_turbulence_and_the_height_of_the_net(workshop, keys, missing):
    """Neither has a default. A measured wind needs only the height, for the profile over it."""
    text = WHOLE.partition("[wind]")[0] + "[wind]\npressure_coefficient = -1.0\n" + keys
    path = workshop.job(text + "[dynamics]\nduration = 0.1\n")
    if missing:
        lines = error_lines(read_job, path, [])
        assert all(line.startswith(f"{path}: [wind] {m}") for line, m in zip(lines, missing)), lines
        assert len(lines) == len(missing), lines
    else:
        read_job(path)


def test_a_static_wind_takes_the_height_of_the_section_or_of_its_case(workshop):
    """Given in [wind] or in the case; the error names the case. Gusts do not act in it."""
    case = '[[case]]\nname = "west"\nset = {"wind.speed" = 20.0, "wind.pressure_coefficient" = -1.0MORE}\n'
    text = WHOLE.partition("[wind]")[0] + case
    (line,) = error_lines(read_job, workshop.job(text.replace("MORE", "")), [])
    assert "[[case]] west: set: wind.base_height: missing; expected the height of z = 0 above ground" in line
    for more in (', "wind.base_height" = 4.0', ', "wind.profile_exponent" = 0.0'):
        assert read_job(workshop.job(text.replace("MORE", more))).wind is None
    read_job(workshop.job(WHOLE + case.replace("MORE", "")))


@pytest.mark.parametrize("key", ["load.dead", "wind.speed"])
def test_a_setting_that_is_given_nested_and_quoted_is_refused(workshop, key):
    """TOML reads both as different keys; neither of the values may silently win. [wind] is shared."""
    text = '[net]\ngenerator = "saddle"\n' + STEEL + "[wind]\nair_density = 1.2\n"
    path = workshop.job(text + f'[[case]]\nname = "a"\nset = {{{key} = 5.0, "{key}" = 50.0}}\n')
    message = f'[[case]] a: set: {key} and "{key}" exclude each other.'
    assert any(message in line for line in error_lines(read_job, path, []))


@pytest.mark.parametrize("action", ['set = {load.snow = "much"}', "load_table = 5", 'load_tabel = "rig.csv"'])
def test_a_faulty_action_of_a_case_is_one_error(workshop, action):
    """netfall does not add that the case has no action."""
    text = '[net]\ngenerator = "saddle"\n' + STEEL + f'[[case]]\nname = "a"\n{action}\n'
    (line,) = error_lines(read_job, workshop.job(text), [])
    assert "[[case]] a: " in line and "E162" not in line
