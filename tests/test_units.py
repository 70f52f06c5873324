"""Numbers with a unit: in job files, overrides and tables."""

import json
import tomllib
from decimal import Decimal

import jsonschema
import pytest
from conftest import ROOT, error_lines

from netfall.core.errors import InputError
from netfall.core.messages import code_of
from netfall.geometry.build import build_net
from netfall.geometry.tables import read_tables
from netfall.job.keys.fields import keys_of
from netfall.job.keys.schema import LIST_KEYS, LIST_MODELS, MODELS, TABLES, job_schema
from netfall.job.read import read_job
from netfall.job.units import EXAMPLES, QUANTITY, UnitError, factor, to_unit
from netfall.study.file import read_study_plan

JOB = """
[net]
nodes = "nodes.csv"
elements = "elements.csv"
[cable]
modulus = "160 GPa"
area = "4 cm2"
density = "7.85 t/m3"
prestress = "60 kN"
[load]
pressure = ["0.1 kN/m2", "0 N/m2", "-0.3 kN/m2"]
temperature = "-20 K"
"""
NODES = "id,x,y,z,fixed,load_z\n-,mm,mm,mm,-,kN\n1,0,0,0,1,\n2,10000,0,-1200.3,0,-12.1\n3,20000,0,0,1,\n"
ELEMENTS = "start,end,area,prestress\n,,mm2,kN\n1,2,400,50\n2,3,403.1,50\n"


@pytest.fixture
def tables(tmp_path):
    (tmp_path / "nodes.csv").write_text(NODES)
    (tmp_path / "elements.csv").write_text(ELEMENTS)
    path = tmp_path / "roof.toml"
    path.write_text(JOB)
    return path


def errors(path, overrides=()):
    """Return the lines of the error that reading a job and its tables raises."""
    return error_lines(lambda: read_tables(read_job(path, list(overrides))))


def test_texts_with_units_give_the_same_bits_as_numbers(tables):
    """Decimal factors are exact, so a unit changes no bit of a result."""
    job = read_job(tables)
    assert (job.cable.modulus, job.cable.area, job.cable.density) == (1.6e11, 4e-4, 7850.0)
    assert job.cable.prestress == 60e3 and job.load.temperature == -20.0
    assert job.load.pressure == [100.0, 0.0, -300.0]
    bare = {"modulus": 1.6e11, "area": 4e-4, "density": 7850.0, "prestress": 60e3}
    text = JOB
    for name, value in bare.items():
        line = next(line for line in JOB.splitlines() if line.startswith(f"{name} "))
        text = text.replace(line, f"{name} = {value!r}")
    (other := tables.with_name("bare.toml")).write_text(text)
    assert read_job(other).cable == job.cable


def test_a_row_of_units_converts_the_columns_of_a_table(tables):
    net, columns = read_tables(read_job(tables))
    assert net.x[1].tolist() == [10.0, 0.0, -1.2003] and net.load[1].tolist() == [0.0, 0.0, -12100.0]
    assert columns["area"].tolist() == [400e-6, 403.1e-6] and columns["prestress"].tolist() == [50e3, 50e3]


@pytest.mark.parametrize(
    "override, words",
    [
        ('cable.area="3 kN"', ("[cable] area", "another dimension", "m2")),
        ('cable.modulus="160 GQa"', ("[cable] modulus", "not a known unit", "160 GPa")),
        ('load.dead="0.3 kN m-2"', ("[load] dead", "not a known unit", "0.3 kN/m2")),
        ('cable.density="7.85 ton/m3"', ("[cable] density", "not a known unit", "7.85 t/m3")),
        ('cable.density="0.00785 kton/m3"', ("[cable] density", "not a known unit", "7.85 t/m3")),
        ('cable.modulus="160 l00"', ("[cable] modulus", "not a known unit", "160 GPa")),
        ('cable.modulus="160 Pa}"', ("[cable] modulus", "not a known unit", "160 GPa")),
        ('load.temperature="3 degC"', ("[load] temperature", "difference")),
        ('load.snow="fast"', ("[load] snow", "expected a number from 0 to 1e+09 N/m2")),
        ('cable.area="-400 mm2"', ("[cable] area", "from 1e-12 to")),
        ('net.unit="mm"', ("nodes.csv", "[net] unit")),
    ],
)
def test_a_wrong_unit_is_an_error_that_names_the_expected_one(tables, override, words):
    (line,) = errors(tables, [override])
    assert all(word in line for word in words)


@pytest.mark.parametrize("text", ["6.28 rad/s", "60 rpm", "1 cycle/s"])
def test_an_angular_velocity_is_not_a_frequency(text):
    """pint gives angles no dimension: 6.28 rad/s, which are 1 Hz, would be 6.28 Hz."""
    with pytest.raises(UnitError, match="another dimension"):
        to_unit(text, "Hz")
    assert to_unit("0.5 rad", "degrees") == pytest.approx(28.6479, abs=1e-4)


@pytest.mark.parametrize("unit", ["percent", "%", "ppm", "count", "steradian", "byte"])
def test_a_plain_number_is_not_an_angle(unit):
    """pint gives radians no dimension: 50 percent, a slope, would be 28.6 degrees."""
    with pytest.raises(UnitError, match="another dimension"):
        factor(unit, "degrees")
    assert to_unit("100 gon", "degrees") == 90.0


@pytest.mark.parametrize("units, words", [("-,mm,kN,mm,-,kN", "dimension"), ("m,mm,mm,mm,m,kN", "no unit")])
def test_a_wrong_unit_of_a_column_is_an_error(tables, units, words):
    (tables.parent / "nodes.csv").write_text(NODES.replace("-,mm,mm,mm,-,kN", units))
    assert any("nodes.csv" in line and words in line for line in errors(tables))


@pytest.mark.parametrize("limit, warned", [("400", True), ('"400 mm"', False), ("0.4", False)])
def test_a_displacement_limit_larger_than_the_net_is_a_warning(tables, limit, warned):
    """The net is 20 m long: 400 without a unit probably means millimetres."""
    tables.write_text(JOB + f"[limits]\ndisplacement = {limit}\n")
    notes = build_net(read_job(tables)).notes
    assert [code_of(line) for line in notes] == ["W229"] * warned
    assert not warned or "displacement = 400 m: more than the largest dimension of the net (20 m)" in notes[0]


def test_each_unit_of_a_key_has_an_example_that_converts():
    """Messages show the example."""
    every = {key.unit for keys in (*TABLES.values(), *LIST_KEYS.values()) for key in keys if key.takes_units}
    for unit in every:
        number, given = QUANTITY.fullmatch(EXAMPLES.get(unit, f"1.5 {unit}")).groups()
        assert factor(given, unit) > 0 and Decimal(number)


@pytest.mark.parametrize(
    "text, unit, value",  # 1 lb = 0.45359237 kg, g = 9.80665 m/s2, 1 ft = 0.3048 m
    [
        ("20 psf", "N/m2", 20 * 0.45359237 * 9.80665 / 0.3048**2),
        ("0.02 ksf", "Pa", 20 * 0.45359237 * 9.80665 / 0.3048**2),
        ("50 plf", "N/m", 50 * 0.45359237 * 9.80665 / 0.3048),
        ("0.05 klf", "N/m", 50 * 0.45359237 * 9.80665 / 0.3048),
        ("490 pcf", "kg/m3", 490 * 0.45359237 / 0.3048**3),
    ],
)
def test_the_short_names_of_pounds_per_foot_are_known(text, unit, value):
    assert to_unit(text, unit) == pytest.approx(value, rel=1e-14)


def test_words_that_are_not_quantities_stay():
    assert to_unit(["auto", "1e5", "40", 3, {"a": "1/s"}], "s") == ["auto", "1e5", "40", 3, {"a": "1/s"}]
    with pytest.raises(UnitError):
        to_unit("3 parsnips", "m")


STUDY = """
job = "roof.toml"
[vary]
"load.snow" = ["0.5 kN/m2", 750.0]
[sampling]
count = 2
"cable.modulus" = {distribution = "normal", mean = "160 GPa", deviation = "5 GPa"}
"""


def test_a_study_compares_numbers_in_any_units(tables):
    """Inputs of samples are SI numbers. One value in two units occurs twice."""
    (path := tables.with_name("study.toml")).write_text(STUDY)
    plan = read_study_plan(path)
    assert plan.axes[0].values == [500.0, 750.0]
    assert plan.draws is not None and 1.3e11 < plan.draws.min() < plan.draws.max() < 1.9e11
    path.write_text(STUDY.replace("750.0", "500.0"))
    with pytest.raises(InputError, match="is listed twice"):
        read_study_plan(path)
    path.write_text(STUDY.replace("0.5 kN/m2", "0.5 kg"))
    with pytest.raises(InputError, match=r"\[vary\] load.snow.*another dimension"):
        read_study_plan(path)


# --- the schema of the job file


def test_the_schema_accepts_every_shipped_job_and_shows_a_wrong_key():
    """Editors use it to complete and mark keys."""
    schema = job_schema()
    validator = jsonschema.Draft202012Validator(schema)
    for path in sorted((ROOT / "jobs").glob("*.toml")):
        data = tomllib.loads(path.read_text())
        assert not [error.message for error in validator.iter_errors(data)], path.name
    wrong = {"net": {"generator": "saddle"}, "cable": {"area": "400 mm2", "aera": 1.0, "modulus": True}}
    messages = " ".join(error.message for error in validator.iter_errors(wrong))
    assert "aera" in messages and "True" in messages and "400 mm2" not in messages


def test_the_schema_has_each_key_with_meaning_and_unit():
    text = job_schema()["$defs"]
    for model in (*MODELS.values(), *LIST_MODELS.values()):
        properties = text[model.__name__]["properties"]
        for name, key in keys_of(model).items():
            description = properties[name]["description"]
            assert key.meaning in description and f"[{key.unit}]" in f"{description}[]", name
    assert json.dumps(job_schema())
