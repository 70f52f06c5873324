"""Old names of keys are refused, each with an error that gives the new name. Patterns of groups."""

import pytest
from conftest import STEEL, error_lines, run_on_standing_ranks

from netfall.core.errors import InputError
from netfall.geometry.build import build_net
from netfall.job.keys.schema import GENERATOR_KEYS
from netfall.job.read import read_job
from netfall.job.renames import REMOVED_KEYS, RENAMED_KEYS, RENAMED_VALUES
from netfall.study.file import read_study_plan

NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"
ELEMENTS = "start,end,group\n1,2,a1\n2,3,a2\n"
OF_STUDIES = ("run", "failure")  # sections of study files
LISTS = ("slide", "target", "combination")


def of_jobs(names):
    return [name for name in names if name.partition(".")[0] not in OF_STUDIES]


def refusals(read, *arguments):
    """The lines with which a job or a study is refused, without its path."""
    return [line.partition("toml: ")[2] for line in error_lines(read, *arguments)]


def section_of(name):
    """The section of a key as a job file has it, [wind] or [[slide]], and the key."""
    section, _, key = name.partition(".")
    return (f"[[{section}]]" if section in LISTS else f"[{section}]"), key


@pytest.fixture
def write(workshop):
    return lambda text, name="job": workshop.job(text, NODES, ELEMENTS, name=name)


def with_key(name, value):
    section, key = section_of(name)
    return STEEL + f"{key} = {value}\n" if section == "[cable]" else f"{STEEL}{section}\n{key} = {value}\n"


@pytest.mark.parametrize("old", of_jobs(RENAMED_KEYS))
def test_an_old_key_is_refused_with_the_new_one(write, old):
    section, key = section_of(old)
    new_section, new = section_of(RENAMED_KEYS[old])
    new = new if new_section == section else f"{new_section} {new}"
    place = f"{section} 1:" if section.startswith("[[") else section
    line = f"{place} {key}: renamed in version 0.5; write {new}. [E113]"
    assert line in refusals(read_job, write(with_key(old, "1")))


@pytest.mark.parametrize("key", of_jobs(RENAMED_VALUES))
def test_an_old_value_is_refused_with_the_new_one(write, key):
    section, name = section_of(key)
    place = f"{section} 1:" if section.startswith("[[") else section
    for old, new in RENAMED_VALUES[key].items():
        line = f'{place} {name} = "{old}": renamed in version 0.5; write "{new}". [E113]'
        assert line in refusals(read_job, write(with_key(key, f'"{old}"')))


@pytest.mark.parametrize("key", REMOVED_KEYS)
def test_a_removed_key_is_refused_with_the_reason(write, key):
    section, name = section_of(key)
    line = f"{section} {name}: removed in version 0.5, {REMOVED_KEYS[key]}. Remove the key. [E114]"
    assert line in refusals(read_job, write(with_key(key, '"double"')))


@pytest.mark.parametrize("generator", GENERATOR_KEYS)
def test_dimensions_in_the_section_of_the_net_are_refused(workshop, generator):
    text = f'{STEEL}[net]\ngenerator = "{generator}"\n'
    for key in GENERATOR_KEYS[generator]:
        line = f"[net] {key}: renamed in version 0.5; write [net.{generator}] {key}. [E113]"
        assert line in refusals(read_job, workshop.job(f"{text}{key} = 3\n"))
    others = {key for keys in GENERATOR_KEYS.values() for key in keys} - set(GENERATOR_KEYS[generator])
    foreign = min(others)
    lines = refusals(read_job, workshop.job(f"{text}{foreign} = 8\n"))
    assert any(line.startswith(f"[net] {foreign}: only for generator = ") for line in lines)


def test_sections_of_groups_have_another_name(write):
    line = "[cable] a1: renamed in version 0.5; write [group.a1]. [E113]"
    assert refusals(read_job, write(STEEL + "[cable.a1]\narea = 1e-3\n")) == [line]
    assert refusals(read_job, write(STEEL), ["cable.a1.area=1e-3"]) == [line]


ZONED = """[load.zone.low]
air_mass = 3.0
[[zone]]
name = "low"
polygon = [[-1, -1], [9, -1], [9, 9]]
[[case]]
name = "one"
set = {"wind.speed" = 3.0, "wind.zone.low.shape_coefficient" = -3.0, wind = {shape_coefficient = -1.0}}
"""


def test_old_names_in_zones_cases_and_overrides_are_refused(write):
    """A name in `set` is given as it stands there."""
    lines = refusals(read_job, write(STEEL + ZONED), ["group.a1.expansion=3e-5", "output.modes=4"])
    assert {
        "[load.zone.low] air_mass: renamed in version 0.5; write added_mass. [E113]",
        "[[case]] one: set: wind.zone.low.shape_coefficient: renamed in version 0.5; write "
        "wind.zone.low.pressure_coefficient. [E113]",
        "[[case]] one: set: wind.shape_coefficient: renamed in version 0.5; write wind.pressure_coefficient. "
        "[E113]",
        "[group.a1] expansion: renamed in version 0.5; write thermal_expansion. [E113]",
        "[output] modes: renamed in version 0.5; write [modes] count. [E113]",
    } <= set(lines)


def test_a_study_refuses_old_names(workshop):
    workshop.job('[net]\ngenerator = "saddle"\n' + STEEL + "[load]\nsnow = 1.0\n")
    path = workshop.folder / "study.toml"
    vary = 'job = "job.toml"\n[vary]\n'
    path.write_text(vary + '"load.breaking" = [true]\n"net.cells" = [4]\n')
    lines = refusals(read_study_plan, path)
    assert any("[load] breaking: renamed in version 0.5; write stop_at_strength. [E113]" in x for x in lines)
    assert any("[net] cells: renamed in version 0.5; write [net.saddle] cells. [E113]" in x for x in lines)
    path.write_text(
        vary + '"load.snow" = [1.0]\n[run]\nkeep = "all"\n[[failure]]\nname = "a"\nof = "roof_lost"\n'
        'above = 0.1\n[[failure]]\nname = "b"\noutcome = "roof_lost"\nlimit = 0.1\n'
    )
    assert {
        "[run] keep: renamed in version 0.5; write keep_results. [E113]",
        "[[failure]] a: of: renamed in version 0.5; write outcome. [E113]",
        "[[failure]] a: above: renamed in version 0.5; write limit. [E113]",
        '[[failure]] b: outcome = "roof_lost": renamed in version 0.5; write "detached_area". [E113]',
    } <= set(refusals(read_study_plan, path))


def test_an_old_option_is_refused_with_the_new_one(tmp_path):
    for words in (["--member", "3"], ["--member=3"]):
        error = run_on_standing_ranks("info", "a.study.h5", *words, cwd=tmp_path, code=2).stderr
        assert "--member" in error and "since version 0.5 it is --sample" in error


# --- patterns of groups


def areas(write, text):
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
    (error,) = error_lines(lambda: build_net(read_job(write(STEEL + text))))
    assert line in error


# --- [combinations], [modes]


def test_combinations_may_be_in_one_table(write):
    """The table follows the entries of [[combination]]; kind is a key next to the factors."""
    text = '[[case]]\nname = "snow"\nset = {"load.snow" = 1.0}\n'
    text += '[[combination]]\nname = "A"\nfactors = {snow = 1.0}\n'
    text += '[combinations]\n"ULS 1" = {permanent = 1.35, snow = 1.5}\nSLS = {kind = "SLS", snow = 1.0}\n'
    job = read_job(write(STEEL + text))
    combinations = [(each.name, each.kind, each.factors) for each in job.combinations]
    assert combinations == [
        ("A", "ULS", {"snow": 1.0}),
        ("ULS 1", "ULS", {"permanent": 1.35, "snow": 1.5}),
        ("SLS", "SLS", {"snow": 1.0}),
    ]
    for wrong, line in (
        ("A = {snow = 1.0}\n", "[[combination]] A: name: entry 1 has this name already"),
        ("B = 3\n", "[combinations] B = 3: expected a table of factors"),
        (
            "B = {snaw = 1.0}\n",
            '[[combination]] B: factors: snaw: no case has this name; did you mean "snow"?',
        ),
        ('B = {kind = "ELU"}\n', '[[combination]] B: kind = "ELU": expected one of "ULS", "SLS"'),
    ):
        assert line in "\n".join(error_lines(read_job, write(STEEL + text + wrong)))
    with pytest.raises(InputError, match='"kind" has a meaning in combinations'):
        read_job(write(STEEL + '[[case]]\nname = "kind"\nset = {"load.snow" = 1.0}\n'))


def test_the_section_of_modes_asks_for_ten(write):
    assert read_job(write(STEEL + "[modes]\n")).modes.count == 10 and read_job(write(STEEL)).modes is None
