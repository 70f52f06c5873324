"""Old names of job keys are accepted, with a warning that gives the new one, and mean the same job."""

import re
from dataclasses import fields, replace

import pytest
from conftest import ROOT, STEEL, run_on_standing_ranks

from netfall.core.errors import InputError
from netfall.geometry.build import build_net
from netfall.job.job import parse_tables
from netfall.job.keys.schema import GENERATOR_KEYS
from netfall.job.read import read_job
from netfall.job.renames import REMOVED_KEYS, RENAMED_KEYS, RENAMED_VALUES
from netfall.loads.wind.sectors import read_sectors
from netfall.study.file import read_study_plan

OLD_JOBS = sorted((ROOT / "tests" / "old_names").glob("*.toml"))  # as version 0.4 wrote shipped jobs
NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"
ELEMENTS = "start,end,group\n1,2,a1\n2,3,a2\n"
# A job with every key that has a new name. The tables of its net come from the fixture.
WHOLE = {
    "cable": {
        "modulus": "1.95e11",
        "area": "683.08e-6",
        "density": "7850.0",
        "prestress": "100e3",
        "thermal_expansion": "1e-5",
        "strain_measure": '"logarithmic"',
        "strength_cov": "0.1",
        "length_std": "0.001",
    },
    "form_finding": {"method": '"fpm"'},
    "load": {"added_mass": "1.0", "stop_at_strength": "true"},
    "wind": {
        "speed": "30.0",
        "pressure_coefficient": "-1.0",
        "turbulence_intensity": "0.1",
        "gust_field": '"area_mean"',
        "aerodynamic_damping": "0.5",
        "base_height": "0.0",
    },
    "dynamics": {
        "duration": "0.1",
        "mass_damping": "0.5",
        "axial_damping_ratio": "0.01",
        "axial_damping_band": "[1.0, 9.0]",
    },
    "output": {"history_interval": "0.01", "checkpoint_interval": "0.05"},
    "modes": {"count": "3"},
    "[slide]": {"group": '"a1"', "slip_resistance": "5.0"},
    "[target]": {"group": '"a1"', "force": "1.0", "adjust": '"a2"'},
    "[combination]": {"name": '"c"', "factors": "{}", "kind": '"SLS"'},
}


def given(tables):
    """The keys that each table gives."""
    return {name: table.given() for name, table in tables.items()}


def text_of(job):
    """The job as TOML."""
    return "".join(
        f"[{section}]\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())
        for section, keys in job.items()
    )


def place(name):
    """The section of a key as a job file has it, [wind] or [[slide]], and the key."""
    section, _, key = name.partition(".")
    return (section, key) if section in WHOLE else (f"[{section}]", key)


def with_key(name, value):
    """The job with a key in place of the renamed one."""
    job = {section: dict(keys) for section, keys in WHOLE.items()}
    section, key = place(name)
    job[section][key] = value
    return job


def same(one, other):
    """Whether two jobs have the same values."""
    names = [
        field.name for field in fields(one) if field.name not in ("path", "text", "overrides", "warnings")
    ]
    return all(getattr(one, name) == getattr(other, name) for name in names)


@pytest.fixture
def write(workshop):
    """A function that writes a job, and returns its path."""
    return lambda text, name="job": workshop.job(text, NODES, ELEMENTS, name=name)


@pytest.mark.parametrize("old, new", RENAMED_KEYS.items())
def test_an_old_key_is_read_as_the_new_one(write, old, new):
    """One warning, to the letter; the same values, and the same digest."""
    (section, key), (new_section, new_key) = place(old), place(new)
    job = {name: dict(keys) for name, keys in WHOLE.items()}
    if old == "wind.roughness":  # either of the two is given
        job["wind"]["surface_drag"] = "0.01"
        del job["wind"]["turbulence_intensity"]
    newer = read_job(write(text_of(job), "new"))
    value = job[new_section].pop(new_key)
    job[section][key] = value
    older = read_job(write(text_of(job)))
    target = new_key if section == new_section else f"[{new_section}] {new_key}"
    warning = f"warning: {older.path}: [{section}] {key}: renamed in version 0.5; write {target}. [W113]"
    assert older.warnings == (warning,) and newer.warnings == ()
    assert same(older, newer) and older.digest() == newer.digest()
    assert older.given() == newer.given()


@pytest.mark.parametrize("old, new", RENAMED_KEYS.items())
def test_both_names_of_a_key_are_an_error(write, old, new):
    """The line names both."""
    job = with_key(old, with_key(new, "0")[place(new)[0]][place(new)[1]])
    if old == "wind.roughness":
        del job["wind"]["turbulence_intensity"]
    job[place(new)[0]].setdefault(place(new)[1], "0")
    with pytest.raises(InputError) as raised:
        read_job(write(text_of(job)))
    line = raised.value.lines[0]
    assert "two names of one key" in line, line
    assert all(f"[{section}] {key}" in line for section, key in map(place, (old, new))), line


@pytest.mark.parametrize("key", RENAMED_VALUES)
def test_an_old_value_is_read_as_the_new_one(write, key):
    """One warning for each, which gives the new value."""
    section, name = place(key)
    for old, new in RENAMED_VALUES[key].items():
        job = read_job(write(text_of(with_key(key, f'"{old}"'))))
        what = f'[{section}] {name} = "{old}": renamed in version 0.5; write "{new}". [W113]'
        assert job.warnings == (f"warning: {job.path}: {what}",)
        assert same(job, read_job(write(text_of(with_key(key, f'"{new}"')), "new")))


@pytest.mark.parametrize("key", REMOVED_KEYS)
def test_a_removed_key_is_ignored_with_its_old_value_alone(write, key):
    """A warning that says why; any other value is an error."""
    value, why = REMOVED_KEYS[key]
    section, name = place(key)
    job = read_job(write(text_of(with_key(key, f'"{value}"'))))
    what = f"[{section}] {name}: removed in version 0.5, {why}. Remove the key. [W114]"
    assert job.warnings == (f"warning: {job.path}: {what}",)
    with pytest.raises(InputError, match=r"removed in version 0\.5"):
        read_job(write(text_of(with_key(key, '"another"'))))


@pytest.mark.parametrize("generator", GENERATOR_KEYS)
def test_dimensions_in_the_section_of_the_net_are_those_of_its_generator(workshop, generator):
    """One warning for each key; a dimension of other generators is an error."""
    defaults = {"length": 60.0, "width": 50.0, "rise": 3.0, "spacing": 2.0} if generator == "ring" else {}
    values = {"halves": 2, "hoops": 3, "spokes": 8, "cells": 9, "ring_groups": "true"} | defaults
    lines = [f"{key} = {values.get(key, 30.0)}" for key in GENERATOR_KEYS[generator]]
    text = f'{STEEL}[net]\ngenerator = "{generator}"\n'
    old = read_job(workshop.job(text + "\n".join(lines)))
    new = read_job(workshop.job(f"{text}[net.{generator}]\n" + "\n".join(lines), name="new"))
    assert same(old, new) and new.warnings == ()
    assert old.warnings == tuple(
        f"warning: {old.path}: [net] {key}: renamed in version 0.5; write [net.{generator}] {key}. [W113]"
        for key in GENERATOR_KEYS[generator]
    )
    foreign = next(
        key for keys in GENERATOR_KEYS.values() for key in keys if key not in GENERATOR_KEYS[generator]
    )
    with pytest.raises(InputError, match=rf"\[net\] {foreign} = 8: only for generator = "):
        read_job(workshop.job(text + "\n".join([*lines, f"{foreign} = 8"])))


def test_sections_of_groups_have_another_name(write):
    """One warning for all of them; keys inside are renamed too."""
    groups = "[cable.a1]\nexpansion = 2e-5\narea = 1e-3\n[cable.a2]\narea = 2e-3\n"
    job = read_job(write(STEEL + groups))
    assert given(job.groups) == {"a1": {"thermal_expansion": 2e-5, "area": 1e-3}, "a2": {"area": 2e-3}}
    assert [line.partition("job.toml: ")[2] for line in job.warnings] == [
        "[cable.a1] (and 1 more): renamed in version 0.5; write [group.a1]. [W113]",
        "[cable.a1] expansion: renamed in version 0.5; write [group.a1] thermal_expansion. [W113]",
    ]
    with pytest.raises(InputError, match=r"\[cable.a1\] area and \[group.a1\] area: two names of one key"):
        read_job(write(STEEL + "[group.a1]\narea = 1e-3\n" + groups))


ZONED = """[load.zone.low]
air_mass = 3.0
[wind.zone.low]
shape_coefficient = -2.0
[[zone]]
name = "low"
polygon = [[-1, -1], [9, -1], [9, 9]]
[[case]]
name = "one"
set = {"wind.speed" = 3.0, "wind.zone.low.shape_coefficient" = -3.0, wind = {shape_coefficient = -1.0}}
"""


def test_zones_cases_and_overrides_may_have_old_names(write):
    """An override counts more than the file, whichever name either of them has."""
    path = write(text_of(WHOLE).replace("added_mass", "air_mass") + ZONED)
    settings = ["wind.air_damping=0.25", "load.air_mass=7", "cable.a1.expansion=3e-5", "output.modes=4"]
    job = read_job(path, settings)
    assert job.wind.aerodynamic_damping == 0.25 and job.load.added_mass == 7.0 and job.modes.count == 4
    assert given(job.load.zone) == {"low": {"added_mass": 3.0}}
    assert given(job.groups) == {"a1": {"thermal_expansion": 3e-5}}
    assert given(job.wind.zone) == {"low": {"pressure_coefficient": -2.0}}
    assert job.cases[0].set["wind.pressure_coefficient"] == -1.0
    assert job.cases[0].set["wind.zone.low.pressure_coefficient"] == -3.0
    assert [line.partition("job.toml: ")[2] for line in job.warnings] == [
        "[load] air_mass (and 2 more): renamed in version 0.5; write added_mass. [W113]",
        "[wind.zone.low] shape_coefficient (and 2 more): renamed in version 0.5; write pressure_coefficient. "
        "[W113]",
        "--set wind.air_damping: renamed in version 0.5; write wind.aerodynamic_damping. [W113]",
        "--set cable.a1.expansion: renamed in version 0.5; write group.a1.thermal_expansion. [W113]",
        "--set output.modes: renamed in version 0.5; write modes.count. [W113]",
    ]
    assert parse_tables(job.text, settings)["group"] == {"a1": {"thermal_expansion": 3e-5}}
    with pytest.raises(InputError, match=r"--set wind\.air_damping.*: two names of one key"):
        read_job(path, ["wind.aerodynamic_damping=1", "wind.air_damping=1"])


def test_dimensions_may_be_set_by_their_old_names(workshop):
    """Of the generator that is set, wherever that stands among the options."""
    path = workshop.job('[net]\ngenerator = "saddle"\n' + STEEL)
    assert read_job(path, ["net.cells=4", "net.saddle.side=9"]).net.saddle.cells == 4
    assert read_job(path, ["net.halves=2", "net.generator=stadium"]).net.stadium.halves == 2


def test_the_column_of_the_roof_may_have_its_old_name(write):
    """In a table of sectors; a warning gives the new name."""
    path = write(STEEL + '[wind]\nspeed = 9.0\nsectors = "cp.csv"\nsurface_drag = 0.0\nbase_height = 0.0\n')
    path.write_text(path.read_text() + "[dynamics]\nduration = 0.1\n")
    table = path.parent / "cp.csv"
    table.write_text("direction,shape_coefficient\n0,-1\n90,-2\n")
    sectors = read_sectors(read_job(path), [])
    assert sectors.of_roof.tolist() == [-1.0, -2.0]
    what = "column shape_coefficient: renamed in version 0.5; write pressure_coefficient. [W119]"
    assert sectors.notes == [f"warning: {table}: {what}"]


STUDY = """job = "job.toml"
[vary]
"wind.roughness" = [0.01, 0.02]
"wind.gusts" = ["means", "points"]
"net.cells" = [4]
[sampling]
count = 2
"cable.strength_deviation" = {distribution = "uniform", from = 0.0, to = 0.1}
"""


def test_a_study_may_vary_old_names(workshop):
    """Its inputs have the new ones, with a warning for each."""
    text = (
        '[net]\ngenerator = "saddle"\n'
        + STEEL
        + "[wind]\nspeed = 20\npressure_coefficient = -1\nbase_height = 0\nsurface_drag = 0\n"
    )
    workshop.job(text + "[dynamics]\nduration = 0.1\n")
    path = workshop.folder / "study.toml"
    path.write_text(STUDY)
    plan = read_study_plan(path)
    assert plan.inputs == ["wind.surface_drag", "wind.gust_field", "net.saddle.cells", "cable.strength_cov"]
    assert plan.axes[1].values == ["area_mean", "point"]
    assert [line.partition("study.toml: ")[2] for line in plan.notes] == [
        "[vary] wind.roughness: renamed in version 0.5; write wind.surface_drag. [W113]",
        "[vary] wind.gusts: renamed in version 0.5; write wind.gust_field. [W113]",
        '[vary] wind.gusts = "means": renamed in version 0.5; write "area_mean". [W113]',
        '[vary] wind.gusts = "points": renamed in version 0.5; write "point". [W113]',
        "[vary] net.cells: renamed in version 0.5; write net.saddle.cells. [W113]",
        "[sampling] cable.strength_deviation: renamed in version 0.5; write cable.strength_cov. [W113]",
    ]


@pytest.mark.parametrize("old", OLD_JOBS, ids=lambda path: path.stem)
def test_a_job_of_the_version_before_is_the_shipped_one(old):
    """The same values and digest, under old names. (Who changes one of these jobs changes both texts.)"""
    shipped = read_job(ROOT / "jobs" / old.name)
    job = replace(read_job(old), path=shipped.path)  # beside its tables
    assert same(job, shipped) and job.digest() == shipped.digest()
    assert job.warnings and shipped.warnings == ()


@pytest.mark.parametrize("command", ["check", "run", "partition"])
def test_each_command_prints_the_warnings_once(write, command):
    """On two ranks too; a result holds them."""
    job = write(STEEL + "[form_finding]\n[cable.a1]\narea = 1e-3\n[output]\nframes = 1\ncheckpoint = 0\n")
    options = {"check": (), "run": ("-o", job.parent / "r.vtkhdf"), "partition": ("-n", 2)}[command]
    ranks = 2 if command == "run" else 1
    done = run_on_standing_ranks(command, job, *options, ranks=ranks, cwd=job.parent)
    for text in ("[cable.a1]: renamed in", "[output] checkpoint: renamed in"):
        assert len(re.findall(re.escape(text), done.stdout + done.stderr)) == 1, done.stdout
    if command == "run":
        assert "[cable.a1]: renamed in" in run_on_standing_ranks("info", options[1]).stdout


# --- patterns of groups


def areas(write, text):
    """The areas of both elements."""
    return build_net(read_job(write(STEEL + text))).section.tolist()


def test_a_pattern_gives_its_keys_to_all_groups_that_it_matches(write):
    """An exact name goes before it, key by key, and stiffness by another key replaces it."""
    assert areas(write, '[group."a*"]\narea = 1e-3\n') == [1e-3, 1e-3]
    assert areas(write, '[group."a*"]\narea = 1e-3\n[group.a2]\narea = 2e-3\n') == [1e-3, 2e-3]
    assert areas(write, '[group.a2]\narea = 2e-3\n[group."a[12]"]\narea = 1e-3\nprestress = 5.0\n') == [
        1e-3,
        2e-3,
    ]
    text = '[group."a?"]\naxial_stiffness = 1e8\n[group.a1]\nmodulus = 1e11\n'
    net = build_net(read_job(write(STEEL + text)))
    assert net.modulus[0] == 1e11 and net.EA[1] == pytest.approx(1e8, rel=1e-15)
    job = write(STEEL + '[group."a*"]\nprestress = 5.0\n[group.a2]\narea = 2e-3\n')
    net = build_net(read_job(job, ["group.a*.area=3e-3", 'group."a2".prestress=7']))
    assert net.section.tolist() == [3e-3, 2e-3] and net.prestress.tolist() == [5.0, 7.0]


@pytest.mark.parametrize(
    "text, line",
    [
        ('[group."b*"]\narea = 1e-3\n', "[group.b*]: no group matches this pattern"),
        ("[group.b]\narea = 1e-3\n", "[group.b]: no element is of this group"),
        (
            '[group."a*"]\narea = 1e-3\n[group."*1"]\narea = 2e-3\n',
            '[group.a*] and [group.*1] both give area to the group "a1". Keep it in one of them',
        ),
        (
            '[group."a*"]\nmodulus = 1e11\n[group."*1"]\naxial_stiffness = 1e8\n',
            '[group.a*] and [group.*1] both give axial_stiffness to the group "a1"',
        ),
    ],
)
def test_a_wrong_pattern_is_one_line(write, text, line):
    """A pattern or a name of no group, and two patterns that give one group the same."""
    with pytest.raises(InputError) as raised:
        build_net(read_job(write(STEEL + text)))
    assert len(raised.value.lines) == 1 and line in raised.value.lines[0], raised.value.lines


# --- [combinations], [modes]


def test_combinations_may_stand_in_one_table(write):
    """After the entries of [[combination]]; kind is a key beside the factors, also an old one."""
    text = '[[case]]\nname = "snow"\nset = {"load.snow" = 1.0}\n'
    text += '[[combination]]\nname = "A"\nfactors = {snow = 1.0}\n'
    text += '[combinations]\n"ULS 1" = {permanent = 1.35, snow = 1.5}\nSLS = {kind = "SLS", snow = 1.0}\n'
    job = read_job(write(STEEL + text + 'old = {kind = "service"}\n'))
    found = [(each.name, each.kind, each.factors) for each in job.combinations]
    assert found == [
        ("A", "ULS", {"snow": 1.0}),
        ("ULS 1", "ULS", {"permanent": 1.35, "snow": 1.5}),
        ("SLS", "SLS", {"snow": 1.0}),
        ("old", "SLS", {}),
    ]
    assert len(job.warnings) == 1 and 'write "SLS"' in job.warnings[0]
    for wrong, line in (
        ("A = {snow = 1.0}\n", "[[combination]] A: name: entry 1 has this name already"),
        ("B = 3\n", "[combinations] B = 3: expected a table of factors"),
        (
            "B = {snaw = 1.0}\n",
            '[[combination]] B: factors: snaw: no case has this name; did you mean "snow"?',
        ),
        ('B = {kind = "ELU"}\n', '[[combination]] B: kind = "ELU": expected one of "ULS", "SLS"'),
    ):
        with pytest.raises(InputError) as raised:
            read_job(write(STEEL + text + wrong))
        assert any(line in error for error in raised.value.lines), raised.value.lines
    with pytest.raises(InputError, match='"kind" has a meaning in combinations'):
        read_job(write(STEEL + '[[case]]\nname = "kind"\nset = {"load.snow" = 1.0}\n'))


def test_the_section_of_modes_asks_for_ten(write):
    """Without a key; without the section there are none."""
    assert read_job(write(STEEL + "[modes]\n")).modes.count == 10 and read_job(write(STEEL)).modes is None
