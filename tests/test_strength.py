"""Cables and their strength: breaking loads, catalogues, scatter."""

from statistics import NormalDist

import numpy as np
import pytest
from conftest import STEEL, error_lines

from netfall.geometry.build import build_net
from netfall.geometry.sections import strength_notes
from netfall.job.read import read_job

# Two lines that cross at node 5: 1-5-2 and 3-5-4; from 2 on the first bends by 20 degrees to node 6, and
# by 40 more to node 7; node 4 is a support, behind which the second goes on to node 8.
NODES = """id,x,y,z,fixed
1,-2,0,0,1
2,2,0,0,0
3,0,-2,0,1
4,0,2,0,1
5,0,0,0,0
6,3.87938524,0.68404029,0,0
7,4.87938524,2.41609110,0,1
8,0,4,0,1
"""
ENDS = [(1, 5), (3, 5), (5, 2), (4, 5), (2, 6), (6, 7), (4, 8)]


def net_of(workshop, elements: str, nodes=NODES, section=STEEL, overrides=()):
    return build_net(read_job(workshop.job(section, nodes, elements), list(overrides)))


def table(columns: str, rows) -> str:
    return f"start,end,{columns}\n" + "\n".join(f"{a},{b},{more}" for (a, b), more in zip(ENDS, rows)) + "\n"


def pieces(net) -> list[str]:
    return [net.cable_names[k] for k in net.cable]


def test_cables_continue_straight_and_end_at_bends_and_supports(workshop):
    """At a crossing each line continues. 20 degrees are straight, 40 are not; a support is an anchor."""
    net = net_of(workshop, table("id", range(20, 27)))
    assert pieces(net) == ["e20", "e21", "e20", "e21", "e20", "e25", "e26"]
    assert net.cable.tolist() == [0, 1, 0, 1, 0, 2, 3]  # numbered in the order of the rows


def test_groups_divide_cables_and_subdivision_does_not(workshop):
    groups = ["a", "b", "c", "b", "c", "c", "c"]
    net = net_of(workshop, table("group", groups), overrides=["net.subdivide=3"])
    assert pieces(net)[::3] == ["e0", "e1", "e2", "e1", "e2", "e5", "e6"]
    assert (net.cable.reshape(-1, 3) == net.cable[::3, None]).all()


def test_the_column_cable_names_cables(workshop):
    """A name is one cable, however it bends. Unnamed elements form their own cables."""
    net = net_of(workshop, table("cable", ["", "main", "main", "", "", "main", ""]))
    assert pieces(net) == ["e0", "main", "main", "e3", "e4", "main", "e6"]
    (line,) = error_lines(net_of, workshop, table("cable", ["", "e0", "", "", "", "", ""]))
    assert "elements.csv: cable = e0: a cable without a name has this name" in line


def test_lines_of_a_generated_net_are_its_cables(tmp_path):
    """A saddle of 32 cells, steep at its edge, has 31 cables in each direction; a wheel has 36 radials."""
    cells = 32
    path = tmp_path / "job.toml"
    path.write_text(f'[net]\ngenerator = "saddle"\n[net.saddle]\ncells = {cells}\n{STEEL}')
    net = build_net(read_job(path, []))
    across = np.unique(np.column_stack([net.group, net.cable]), axis=0)
    assert np.bincount(across[:, 0]).tolist() == [cells - 1] * 2
    assert (np.bincount(net.cable) == cells).all()


# --- sections of cables

CATALOGUE = (
    "name,mass_per_length,axial_stiffness,breaking_load\nFLC40,8.9,1.77e8,1.52e6\nFLC60,20.1,4.0e8,3.59e6\n"
)


def net_of_types(workshop, elements, groups):
    """Return the net of a table of elements; cables have the type FLC40 unless their group differs."""
    (workshop.folder / "cables.csv").write_text(CATALOGUE)
    common = '[cable]\ncatalogue = "cables.csv"\ntype = "FLC40"\nprestress = 1e5\n'
    return net_of(workshop, elements, section=common + groups)


def test_rows_override_groups_which_override_the_cable(workshop):
    """For stiffness, mass and breaking load of each element."""
    groups = "[group.steel]\nmodulus = 1.6e11\narea = 1e-3\ndensity = 8000.0\n[group.strong]\n"
    groups += 'type = "FLC60"\nbreaking_load = 3.0e6\n[group.light]\naxial_stiffness = 1e8\n'
    groups += "mass_per_length = 2.0\n"
    rows = ["a,,", "steel,,", "strong,,", "light,,", "steel,FLC60,", "strong,,2e6", "strong,FLC40,1e6"]
    net = net_of_types(workshop, table("group,type,breaking_load", rows), groups)
    stiffness = [1.77e8, 1.6e8, 4.0e8, 1e8, 4.0e8, 4.0e8, 1.77e8]
    mass = [8.9, 8.0, 20.1, 2.0, 20.1, 20.1, 8.9]
    load = [1.52e6, 1.52e6, 3.0e6, 1.52e6, 3.59e6, 2e6, 1e6]
    exact = lambda values: pytest.approx(values, rel=1e-15)  # a quotient and a product
    assert (net.modulus * net.section).tolist() == exact(stiffness)
    assert (net.density * net.section).tolist() == exact(mass)
    assert net.breaking_load.tolist() == load
    assert net.fracture_strain.tolist() == exact([f / k for f, k in zip(load, stiffness)])
    assert [net.type_names[k] if k >= 0 else "" for k in net.type] == (
        ["FLC40", "FLC40", "FLC60", "FLC40", "FLC60", "FLC60", "FLC40"]
    )


def test_bars_do_not_have_the_type_of_the_cables(workshop):
    """Tubes of 9120 mm2 are not the rope of [cable] in the shop list. A type of a bar applies."""
    groups = '[group.mast]\nkind = "bar"\nmodulus = 2.1e11\narea = 9.12e-3\ndensity = 7850.0\n[group.rod]\n'
    groups += 'kind = "bar"\ntype = "FLC60"\n'
    net = net_of_types(workshop, table("group", ["a", "mast", "rod", *["a"] * 4]), groups)
    assert net.type[:3].tolist() == [net.type_names.index("FLC40"), -1, net.type_names.index("FLC60")]


def test_an_area_of_a_row_that_changes_no_stiffness_is_named(workshop):
    """The group's axial stiffness stays, with modulus = EA / area. A modulus in the row replaces it."""
    section = STEEL + "[group.light]\naxial_stiffness = 1e8\nmass_per_length = 2.0\n"
    rows = ["light,5e-4,,", "light,5e-4,1e11,", "light,5e-4,1e11,8e3", "a,5e-4,,", *["light,,,"] * 3]
    net = net_of(workshop, table("group,area,modulus,density", rows), section=section)
    assert net.EA.tolist() == pytest.approx([1e8, 5e7, 5e7, 1.95e11 * 5e-4, 1e8, 1e8, 1e8])
    assert (net.density * net.section)[:3].tolist() == pytest.approx([2.0, 2.0, 4.0])
    notes = [note.partition(", which")[0] for note in net.notes if "column area" in note]
    elements, change = ("element 0", "2 elements (0, 1)"), ' of group "light": does not change '
    keys = "axial_stiffness", "mass_per_length"
    assert notes == [f"note: column area of {e}{change}{key}" for e, key in zip(elements, keys)]


@pytest.mark.parametrize(
    "own, keys", [("", ["axial_stiffness", "mass_per_length"]), ("modulus = 1e11\n", [])]
)
def test_an_area_of_a_group_that_changes_no_stiffness_is_named(workshop, own, keys):
    """EA of [cable] keeps stiffness and mass. With modulus and density the area counts."""
    own += "density = 7850.0\n" * bool(own)
    section = f"[cable]\naxial_stiffness = 1e8\nmass_per_length = 2.0\n[group.'e*']\narea = 5e-4\n{own}"
    net = net_of(workshop, table("group", ["edge", "end", *["a"] * 5]), section=section)
    assert net.EA[:3].tolist() == pytest.approx([1e8 if keys else 5e7] * 2 + [1e8])
    notes = [note for note in net.notes if "area: does not change" in note]
    start = "note: [group.e*] area: does not change"
    assert [note.partition(", which")[0] for note in notes] == [f"{start} {key}" for key in keys]


@pytest.mark.parametrize(
    ("column", "form", "is_noted"),
    [
        ("unstressed_length", "", True),
        ("force_density", '[form_finding]\nmethod = "force_density"\n', True),
        ("force_density", "[form_finding]\n", False),
    ],
)
def test_an_unused_prestress_of_a_row_is_named(workshop, column, form, is_noted):
    """For rows with both values; form finding by prestress uses it."""
    rows = ["5e4,2.0", "5e4,", ",2.0", *["5e4,"] * 4]
    net = net_of(workshop, table(f"prestress,{column}", rows), section=STEEL + form)
    notes = [note for note in net.notes if "column prestress" in note]
    assert [note[: note.index(". L")] for note in notes] == [
        f"note: column prestress of element 0: no effect: the same rows give {column}"
    ] * is_noted


WRONG = {  # keys of [cable], a column of elements.csv, and words of the message
    "twice stiff": (
        STEEL + "axial_stiffness = 1e8\n",
        "",
        "[cable] modulus and axial_stiffness exclude each other",
    ),
    "twice heavy": (STEEL + "mass_per_length = 5.0\n", "", "density and mass_per_length exclude each other"),
    "no catalogue": (STEEL + 'type = "FLC40"\n', "", "[cable] type: has no effect without [cable] catalogue"),
    "unknown type": (
        STEEL + 'catalogue = "cables.csv"\ntype = "FLC4O"\n',
        "",
        '[cable] type = "FLC4O": no such type in the catalogue; did you mean "FLC40"?',
    ),
    "unknown type in a row": (
        STEEL + 'catalogue = "cables.csv"\n',
        "type:FLC50",
        'elements.csv: element 0: type = "FLC50": no such type',
    ),
    "nothing stiff": (
        "[cable]\narea = 1e-3\ndensity = 8e3\n",
        "",
        "[cable] modulus: missing for element 0; expected a number from 1 to 1e+15 Pa",
    ),
    "no area": (
        "[cable]\nmodulus = 1e11\nmass_per_length = 8.0\n",
        "",
        "[cable] area: missing for element 0; expected a number from 1e-12 to 10000 m2",
    ),
    "below the prestress": (
        STEEL + "breaking_load = 99e3\n",
        "",
        "element 0: breaking_load = 99000 N: below its prestress 100000 N. Lower the prestress",
    ),
    "above the yield force": (
        STEEL + "yield_stress = 1.0e9\nbreaking_load = 700e3\n",
        "",
        "element 0: breaking_load = 700000 N: above the yield force 683080 N, which the tension never",
    ),
    "not positive": (STEEL, "breaking_load:-5", "line 2: breaking_load = '-5': expected a number >= 1e-12 N"),
}


@pytest.mark.parametrize("case", WRONG)
def test_contradictions_are_refused(workshop, case):
    section, column, message = WRONG[case]
    (workshop.folder / "cables.csv").write_text(CATALOGUE)
    name, _, value = (column or "id:0").partition(":")
    rows = [value, *(range(1, 7) if name == "id" else [""] * 6)]
    (line,) = error_lines(net_of, workshop, table(name, rows), section=section)
    assert message in line


def test_breaking_load_and_fracture_strain_count_by_the_lesser(workshop):
    """Below the yield force the breaking load may be the lesser, above it only the strain."""
    section = STEEL + "yield_stress = 1.5e9\nfracture_strain = 0.03\n"  # yields at 1024.6 kN
    loads = ["", "9e5", "1.2e6", "1024620", "", "", ""]
    net = net_of(workshop, table("breaking_load", loads), section=section)
    EA = 1.95e11 * 683.08e-6
    expected = [0.03, 9e5 / EA, 0.03, 1024620 / EA, 0.03, 0.03, 0.03]
    assert net.fracture_strain.tolist() == pytest.approx(expected, rel=1e-15)


def test_strength_scatters_from_cable_to_cable(tmp_path):
    """398 cables have one factor each with the given mean and deviation. A seed changes all."""
    path = tmp_path / "job.toml"
    section = STEEL + "breaking_load = 1.2e6\nstrength_cov = 0.05\n"
    path.write_text(f'[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 200\n{section}')
    net = build_net(read_job(path, []))
    of_cable = net.strength[np.unique(net.cable, return_index=True)[1]]
    assert (net.strength == of_cable[net.cable]).all() and len(np.unique(of_cable)) == len(of_cable) == 398
    assert net.breaking_load.tolist() == (1.2e6 * net.strength).tolist()
    assert of_cable.mean() == pytest.approx(1.0, abs=4 * 0.05 / np.sqrt(398))  # four standard errors
    assert of_cable.std() == pytest.approx(0.05, rel=4 / np.sqrt(2 * 398))  # the same
    same = build_net(read_job(path, ["net.subdivide=2"])).strength[::2]
    other = build_net(read_job(path, ["cable.strength_seed=2"])).strength
    assert (same == net.strength).all() and not (other == net.strength).any()


def test_strengths_lengths_and_gusts_of_one_seed_share_no_random_number(workshop):
    """Gusts draw block b of their noise at b << 192. Otherwise equal seeds would correlate with strengths."""
    section = STEEL + "breaking_load = 1.2e6\nstrength_cov = 0.05\nlength_std = 0.01\n"
    net = net_of(workshop, table("breaking_load", [""] * 7), section=section)
    spread = np.sqrt(np.log1p(0.05**2))
    drawn = [np.log(net.strength) / spread + 0.5 * spread, net.length_error / 0.01]
    for block in range(3):
        raw = np.random.Philox(key=1, counter=block << 192).random_raw(100)
        drawn.append([NormalDist().inv_cdf(((int(word) >> 12) + 0.5) * 2.0**-52) for word in raw])
    numbers = np.round(np.concatenate(drawn), 5)
    assert len(np.unique(numbers)) == len(np.unique(np.round(drawn[0], 5))) * 2 + 300


@pytest.mark.parametrize("kind, scatter", [("strength", "strength_cov"), ("length", "length_std")])
def test_a_seed_without_scatter_is_named(workshop, kind, scatter):
    section = STEEL + "breaking_load = 1.2e6\n[form_finding]\n"
    job = workshop.job(section, NODES, "start,end\n" + "".join(f"{a},{b}\n" for a, b in ENDS))
    note = f"note: [cable] {kind}_seed: no effect: {scatter} = 0."
    for more, stands in ([], True), ([f"cable.{scatter}=0.01"], False):
        given = read_job(job, [f"cable.{kind}_seed=3", *more])
        assert any(line.startswith(note) for line in strength_notes(given, build_net(given))) == stands


F = 3590e3  # N, breaking load
AREA, EA = 2.5e-3, 4.0e8


@pytest.mark.parametrize(
    "law, strain",
    [
        ("elastic", "engineering"),
        ("plastic", "engineering"),
        ("plastic", "logarithmic"),
        ("elastic", "logarithmic"),
    ],
)
def test_a_cable_holds_just_below_its_breaking_load_and_breaks_just_above(workshop, law, strain):
    """Released at N0 under P an undamped mass reaches 2 P - N0: 100 N above the breaking load breaks it."""
    below, above = F - 200.0, F  # N, load; the start is 100 N lower, the peak 100 N higher
    loads = (below, above, below, above)
    nodes = "id,x,y,z,fixed,load_z,mass\n" + "".join(
        f"{2 * k + 1},0,{k},-10,0,{-load},5e4\n{2 * k},0,{k},0,1,0,0\n" for k, load in enumerate(loads)
    )  # of the two at [0, k] the first is the probe
    elements = "start,end,prestress\n" + "".join(
        f"{2 * k},{2 * k + 1},{P - 100.0}\n" for k, P in enumerate(loads)
    )
    section = f"[cable]\naxial_stiffness = {EA}\nmass_per_length = 20.0\narea = {AREA}\n"
    section += f'strain_measure = "{strain}"\nbreaking_load = {F}\n'
    if law == "plastic":
        section += f"yield_stress = {3600e3 / AREA}\n"
    probes = ", ".join(f"[0.0, {k}.0]" for k in range(4))
    run = f"[dynamics]\nduration = 0.3\n[output]\nframes = 3\nhistory_interval = 0.001\nprobes = [{probes}]\n"
    with workshop.solve(section + run, nodes, elements) as f:
        assert sorted(set(f["events/element"][:].tolist())) == [1, 3]
        peak = f["history/probe_tension"][:].max(0)
        # the step of some 7 ms in a period of 0.22 s samples the peak to 1 percent of the swing of 100 N
        assert peak[[0, 2]] == pytest.approx([3589.9e3] * 2, abs=2.0)
        # a step takes 2 pi dt / T of the swing at most; the tension of the step that breaks it is seen
        assert (peak[[1, 3]] > F).all() and (peak[[1, 3]] < F + 20.0).all()
        assert f["net/breaking_load"][:].tolist() == [F] * 4


def test_random_strengths_break_equally_on_two_ranks(both_ways):
    text = '[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 4\nside = 20.0\nrise = 2.0\n' + STEEL
    text += "breaking_load = 200e3\nstrength_cov = 0.2\n[form_finding]\n[load]\nself_weight = false\n"
    text += "dead = 500.0\npressure = [0.0, 0.0, 1500.0]\n[dynamics]\nduration = 0.5\n[output]\nframes = 3\n"
    with both_ways.solve(text) as f:
        strength, broken = f["net/strength"][:], np.unique(f["events/element"][:])
        assert 0 < len(broken) < len(strength) and (f["net/breaking_load"][:] == 200e3).all()
        limit = 200e3 * strength / (1.95e11 * 683.08e-6)
        strain = f["events/strain"][:]
        first = np.unique(f["events/element"][:], return_index=True)[1]
        assert (strain[first] >= limit[broken]).all()


def test_a_bar_that_may_yield_before_its_breaking_load_is_refused(workshop):
    """The bar may yield in compression, and its strain at the breaking load is then unknown."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,5,0,0,0\n3,10,0,0,1\n"
    done = workshop.solve(
        '[cable]\nkind = "bar"\nmodulus = 1e11\narea = 1e-4\ndensity = 7850.0\nyield_stress = 1e8\n'
        "breaking_load = 8e3\n[dynamics]\nduration = 0.1\n",
        nodes,
        "start,end\n1,2\n2,3\n",
        code=2,
    )
    assert "element 0: breaking_load = 8000 N: below the yield force 10000 N of a bar" in done.stderr
